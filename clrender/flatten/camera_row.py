"""The camera as the kernels read it (kernels/camera/), and the media around it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from clrender import layout
from clrender.cameras.distortion import BrownConrady, KannalaBrandt
from clrender.cameras.projection import Intrinsics, Projection, Rectilinear
from clrender.errors import SceneError
from clrender.exact.angles import tan_degrees
from clrender.exact.matrices import lengths
from clrender.flatten.instances import FlatInstances, box_of
from clrender.flatten.interiors import media_around, media_in_box, packed
from clrender.flatten.surfaces import SMALLEST
from clrender.meshes.data import COORDINATE_LIMIT
from clrender.scene.description import Camera, Scene
from clrender.scene.values import Vector
from clrender.settings import FILTER_RADII

__all__ = ["camera_row", "other_shape", "surrounded"]

_Rows: TypeAlias = NDArray[np.void]
_FARTHEST: Final = 1e6
"""In place of an infinite end of the field."""


def camera_row(scene: Scene, width: int, height: int, origin: Vector) -> _Rows:
    """The camera for kernels/camera/camera.h; right-handed, image right = forward x up unless it is mirrored.

    Parameters
    ----------
    scene : Scene
    width, height : int
        Size of the image, pixels.
    origin : (3,) float
        World space, metres: origin of the coordinates on the device.

    Returns
    -------
    (1,) `Camera`

    Raises
    ------
    SceneError
        The view is too large or small for single precision.
    """
    camera = scene.camera
    right, upward, forward = camera.axes
    row = np.zeros(1, dtype=layout.dtype("Camera"))
    row["origin"][0, :3], row["world"][0, :3] = _difference(camera.position, origin), origin
    row["kind"] = layout.CAMERA_PERSPECTIVE
    row["open"] = camera.row_share
    row["readout"] = 1.0 - camera.row_share
    if camera.type != "intrinsics":
        row["kind"] = getattr(layout, f"CAMERA_{camera.type.upper()}")
    unit_axes = {"right": right, "down": _scaled(upward, -1.0), "axis": forward}
    if camera.type in ("panoramic", "fisheye"):
        _put(row, unit_axes)
        row["aspect"], row["angle"] = width / height, camera.vertical_fov / 720.0
        return row
    row["blades"], row["blade_turn"] = camera.blades, camera.blade_rotation_degrees % 360.0 / 360.0
    _put(row, {name: _scaled(axis, camera.aperture_radius) for name, axis in (("lens_u", right), ("lens_v", upward))})
    projection = camera.projection(width, height, (scene.image.width, scene.image.height))
    if isinstance(projection, Intrinsics):
        _put(row, unit_axes)
        _calibrate(row[0], projection, camera.focus, (width, height))
        return row

    # The film's rectangle on the plane of focus
    left, top, across, down = _rectangle(camera, projection, width, height)
    distance = camera.focus
    corner = [f * distance + r * left + u * top for f, r, u in zip(forward, right, upward, strict=True)]
    _put(row, {"corner": corner, "right": _scaled(right, across), "down": _scaled(upward, -down)})
    _put(row, {"axis": _scaled(forward, distance)})
    if not (min(across, down) >= SMALLEST and max(across, down) <= COORDINATE_LIMIT):
        low, high = f"{min(across, down):g}", f"{max(across, down):g}"
        text = f"the view spans {low} to {high} metres at the focus distance, too extreme for single precision"
        keys = {"perspective": "vertical_fov or focus_distance", "orthographic": "height"}.get(camera.type, "fx or fy")
        raise SceneError(f"{scene.source}: camera: {text}; choose a more moderate {keys}")
    return row


def other_shape(scene: Scene, width: int, height: int) -> list[str]:
    """A warning of an image that has not the shape to which the camera's intrinsics apply."""
    camera = scene.camera
    across, down = camera.resolution or (scene.image.width, scene.image.height)
    if camera.type != "intrinsics" or abs(across * height - down * width) <= max(across, down):
        return []
    text = f"its numbers are of images of {across}x{down} pixels, and one of {width}x{height} has another shape"
    return [f"{scene.source}: camera: {text}: it shows the same from top to bottom, and more or less at both sides"]


def _rectangle(camera: Camera, projection: Projection, width: int, height: int) -> tuple[float, float, float, float]:
    """The view on the plane of focus, metres: its left edge, its upper edge upward, its width and its height."""
    distance = camera.focus
    if camera.type == "intrinsics":
        assert isinstance(projection, Rectilinear)
        sides = (projection.left, -projection.top, projection.width, projection.height)
        return tuple(each * distance for each in sides)  # type: ignore[return-value]
    spread = distance * tan_degrees(camera.vertical_fov / 2.0) if camera.type == "perspective" else camera.height / 2.0
    half_height, half_width = spread, spread * width / height
    shift_right, shift_up = camera.lens_shift
    left, top = (2.0 * shift_right - 1.0) * half_width, (2.0 * shift_up + 1.0) * half_height
    return left, top, 2.0 * half_width, 2.0 * half_height


def _calibrate(row: np.void, projection: Intrinsics, distance: float, size: tuple[int, int]) -> None:
    """Write the lens of a calibrated camera."""
    lens = projection.lens
    row["focal"] = (*projection.focal, projection.skew, distance)
    # A pixel filter sees points beyond the film's edges
    (left, right), (top, bottom) = ((-FILTER_RADII[1] / pixels, 1.0 + FILTER_RADII[1] / pixels) for pixels in size)
    corners = projection.on_film(np.array([(x, y) for x in (left, right) for y in (top, bottom)]))
    farthest = float(lengths(corners).max())
    if isinstance(lens, BrownConrady):
        row["kind"] = layout.CAMERA_BROWN_CONRADY
        row["principal"] = (*projection.principal, *lens.p)
        row["radial"][:3], row["rational"][:3] = lens.k[:3], lens.k[3:]
    else:
        assert isinstance(lens, KannalaBrandt)
        row["kind"] = layout.CAMERA_KANNALA_BRANDT
        row["principal"][:2], row["radial"] = projection.principal, lens.k
    row["field"][:2] = lens.bound(farthest), min(lens.limit, _FARTHEST)


def _put(row: _Rows, vectors: Mapping[str, Sequence[float]]) -> None:
    for name, vector in vectors.items():
        row[0][name][:3] = vector


def surrounded(
    row: _Rows,
    arrays: Mapping[str, NDArray[Any]],
    triangle_count: int,
    instances: FlatInstances,
    camera: Camera,
    origin: Vector,
    size: tuple[int, int],
) -> _Rows:
    """The camera's row with the media around one of its rays, and whether its film or lens cuts the surface of one.

    Parameters
    ----------
    row : (1,) `Camera`
        Changed in place.
    arrays : mapping of str to ndarray
        As `clrender.flatten.flat_scene.FlatScene` has them.
    triangle_count : int
    instances : FlatInstances
    camera : Camera
    origin : (3,) float
        World space, metres: origin of the coordinates on the device.
    size : (int, int)
        Of the image, pixels.
    """
    known = np.array(_difference(camera.position, origin))
    low, high = _origins_of_rays(row[0], camera, size)
    if (instances.moves or row["segments"][0]) and len(arrays["media_rows"]) > 1:
        # Where rays begin changes with time, and so do the volumes there; far outside there are none
        row[0]["cuts_media"] = 1
        row[0]["around"][:3] = _outside(arrays, triangle_count, instances, low, high)
        return row
    if (low < high).any() and media_in_box(arrays, triangle_count, low, high, instances):
        row[0]["cuts_media"] = 1
        row[0]["around"][:3] = _origin_aside(row[0], camera)
        known = row[0]["around"][:3].astype(np.float64)
    row[0]["interior_first"], row[0]["interior_last"] = packed(media_around(arrays, triangle_count, known, instances))
    return row


def _outside(
    arrays: Mapping[str, NDArray[Any]],
    triangle_count: int,
    instances: FlatInstances,
    low: NDArray[np.float64],
    high: NDArray[np.float64],
) -> NDArray[np.float64]:
    """A point outside of all volumes of a scene, and beyond the origins of the camera's rays."""
    own = arrays["analytic_shapes"]["center_radius"][: instances.own_analytic]
    shapes = box_of(arrays["vertices"][: instances.own_vertices], own, instances.boxes)
    low = np.minimum(low, np.where(np.isfinite(shapes[0]), shapes[0], low))
    high = np.maximum(high, np.where(np.isfinite(shapes[1]), shapes[1], high))
    size = high - low
    return np.asarray(high + np.array([0.37, 0.29, 0.43]) * size + 1e-3 * (1.0 + np.abs(high)))


def _origin_aside(row: np.void, camera: Camera) -> NDArray[np.float64]:
    """Origin of a ray that is not in the middle of the film or lens, which is often placed exactly on a surface."""
    corner, right, down, axis, lens_u, lens_v = _film_and_lens(row)
    on_lens = row["origin"][:3].astype(np.float64) + 0.31 * lens_u + 0.17 * lens_v
    on_film = corner - axis + 0.61 * right + 0.42 * down if camera.type == "orthographic" else np.zeros(3)
    return np.asarray(on_lens + on_film)


def _origins_of_rays(
    row: np.void, camera: Camera, size: tuple[int, int]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Box that contains the origins of all rays of a camera."""
    corner, right, down, axis, lens_u, lens_v = _film_and_lens(row)
    low = high = row["origin"][:3].astype(np.float64)
    if camera.type == "orthographic":
        # As wide again on all sides, or wider: a pixel filter sees points beyond the film's edges
        across, along = (max(1.0, FILTER_RADII[1] / pixels) for pixels in size)
        ends = [corner - axis + right * x + down * y for x in (-across, 1.0 + across) for y in (-along, 1.0 + along)]
        low, high = low + np.min(ends, axis=0), high + np.max(ends, axis=0)
    reach = np.abs(lens_u) + np.abs(lens_v)
    return low - reach, high + reach


def _film_and_lens(row: np.void) -> tuple[NDArray[np.float64], ...]:
    names = ("corner", "right", "down", "axis", "lens_u", "lens_v")
    return tuple(row[name][:3].astype(np.float64) for name in names)


def _difference(a: Vector, b: Vector) -> Vector:
    return (a[0] - b[0], a[1] - b[1], a[2] - b[2])


def _scaled(a: Vector, factor: float) -> Vector:
    return (a[0] * factor, a[1] * factor, a[2] * factor)
