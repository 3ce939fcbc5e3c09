"""Cameras of Blender as tables `[camera]` of clrender."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from .axes import Matrix, column, unit

__all__ = ["BlenderCamera", "camera_table"]


@dataclass(frozen=True)
class BlenderCamera:
    """A camera of Blender, and the image that it takes, by Blender's own names.

    Attributes
    ----------
    matrix : Matrix
        To Blender's world.
    width, height : int
        Of the image, pixels.
    type : str
        ``PERSP``, ``ORTHO``, ``PANO``, or another.
    lens : float
        Focal length, millimetres.
    sensor_fit : str
        ``AUTO``, ``HORIZONTAL`` or ``VERTICAL``.
    sensor_width, sensor_height : float
        Millimetres.
    shift_x, shift_y : float
        In units of the side of the image that the sensor fits.
    ortho_scale : float
        Metres along that side.
    pixel_aspect : float
        Height of a pixel over its width.
    panorama_type : str
    fisheye_fov : float
        Radians.
    use_dof : bool
    focus_distance : float
        Metres along the direction of view.
    fstop : float
    blades : int
        0: a round aperture.
    blade_rotation : float
        Radians.
    aperture_ratio : float
    """

    matrix: Matrix
    width: int
    height: int
    type: str = "PERSP"
    lens: float = 50.0
    sensor_fit: str = "AUTO"
    sensor_width: float = 36.0
    sensor_height: float = 24.0
    shift_x: float = 0.0
    shift_y: float = 0.0
    ortho_scale: float = 6.0
    pixel_aspect: float = 1.0
    panorama_type: str = "EQUIRECTANGULAR"
    fisheye_fov: float = math.pi
    use_dof: bool = False
    focus_distance: float = 10.0
    fstop: float = 2.8
    blades: int = 0
    blade_rotation: float = 0.0
    aperture_ratio: float = 1.0

    @property
    def fits_width(self) -> bool:
        """Whether the sensor fits the width of the image."""
        if self.sensor_fit == "AUTO":
            return self.width >= self.height * self.pixel_aspect
        return self.sensor_fit == "HORIZONTAL"

    @property
    def sensor(self) -> float:
        """Side of the sensor that fits the image, millimetres; in the fit `AUTO`, its width is for either side."""
        return self.sensor_height if self.sensor_fit == "VERTICAL" else self.sensor_width

    @property
    def fitted(self) -> float:
        """Side of the image that the sensor fits, in widths of a pixel."""
        return self.width if self.fits_width else self.height * self.pixel_aspect


def camera_table(camera: BlenderCamera) -> tuple[dict[str, Any], list[str]]:
    """The table `[camera]`, and notes of what is left out.

    Parameters
    ----------
    camera : BlenderCamera
    """
    position, forward, up = column(camera.matrix, 3), column(camera.matrix, 2), column(camera.matrix, 1)
    forward = unit([-x for x in forward])
    # Far enough away for the direction to survive the rounding of large coordinates
    away = max(1.0, *(abs(x) for x in position))
    target = [p + away * d for p, d in zip(position, forward, strict=True)]
    table: dict[str, Any] = {"position": list(position), "target": target, "up": list(unit(up))}
    notes: list[str] = []
    if camera.type == "PANO":
        return {**table, **_panorama(camera, notes)}, notes
    if camera.type not in ("PERSP", "ORTHO"):
        notes.append(f"cameras of the type {camera.type} are not known; a perspective one is taken")
    orthographic = camera.type == "ORTHO"
    rows = camera.height * camera.pixel_aspect
    if orthographic:
        table |= {"type": "orthographic", "height": camera.ortho_scale * rows / camera.fitted}
        if camera.pixel_aspect != 1.0:
            notes.append("pixels that are not square were left out of an orthographic camera")
    elif camera.pixel_aspect != 1.0:
        table |= _intrinsics(camera)
    else:
        table["vertical_fov"] = math.degrees(
            2.0 * math.atan(camera.sensor * rows / (2.0 * camera.lens * camera.fitted))
        )
    if (camera.shift_x or camera.shift_y) and table.get("type") != "intrinsics":
        table["lens_shift"] = [camera.shift_x * camera.fitted / camera.width, camera.shift_y * camera.fitted / rows]
    if camera.use_dof:
        table |= _lens(camera, orthographic, notes)
    return table, notes


def _intrinsics(camera: BlenderCamera) -> dict[str, Any]:
    """Focal lengths in pixels, for pixels that are not square."""
    focal = camera.lens / camera.sensor * camera.fitted
    return {
        "type": "intrinsics",
        "resolution": [camera.width, camera.height],
        "fx": focal,
        "fy": focal / camera.pixel_aspect,
        "cx": camera.width / 2.0 - camera.shift_x * camera.fitted,
        "cy": camera.height / 2.0 + camera.shift_y * camera.fitted / camera.pixel_aspect,
    }


def _lens(camera: BlenderCamera, orthographic: bool, notes: list[str]) -> dict[str, Any]:
    """Depth of field. The lens of an orthographic camera is as if its focal length were a metre."""
    focal = 1.0 if orthographic else 1e-3 * camera.lens
    made: dict[str, Any] = {
        "aperture_radius": focal / (2.0 * max(camera.fstop, 1e-5)),
        "focus_distance": max(camera.focus_distance, 1e-6),
    }
    if camera.blades >= 3:
        # Blender's polygon begins in the middle of a side, clrender's at a corner
        turn = math.degrees(camera.blade_rotation) + 180.0 / camera.blades
        made |= {"blades": camera.blades, "blade_rotation_degrees": turn}
    if camera.aperture_ratio != 1.0:
        notes.append("the ratio of the aperture was left out: its bokeh is not stretched")
    return made


def _panorama(camera: BlenderCamera, notes: list[str]) -> dict[str, Any]:
    kind = camera.panorama_type
    if kind == "FISHEYE_EQUIDISTANT":
        if camera.width != camera.height:
            notes.append("a fisheye is round; Blender stretches it over an image that is not square")
        return {"type": "fisheye", "vertical_fov": min(math.degrees(camera.fisheye_fov), 360.0)}
    if kind != "EQUIRECTANGULAR":
        notes.append(f"panoramas of the type {kind} are not known; an equirectangular one is taken")
    return {"type": "panoramic"}
