"""The camera: its position, its direction, and its projection."""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import cached_property
from typing import Annotated, Any, ClassVar, Final, Literal, TypeAlias

import numpy as np
import numpy.typing as npt
from pydantic import AfterValidator, Discriminator, Field, Strict, Tag, model_validator

from clrender.cameras.distortion import BrownConrady, KannalaBrandt, LensModel
from clrender.cameras.poses import pose_of
from clrender.cameras.projection import Equidistant, Intrinsics, LatitudeLongitude, Parallel, Projection, Rectilinear
from clrender.errors import SceneError, UsageError
from clrender.exact.angles import tan_degrees
from clrender.exact.matrices import inner, lengths
from clrender.image.exposure import PHOTOGRAPHIC
from clrender.meshes.data import COORDINATE_LIMIT
from clrender.scene.camera_motion import CameraMotion, CameraTrack
from clrender.scene.poses import TIME_LIMIT, Seconds
from clrender.scene.spectra import Response
from clrender.scene.values import Finite, Flag, Length, Part, Row, Vector, cross, fault, length
from clrender.wording import counted

__all__ = ["Camera", "Distortion"]

_Floats = npt.NDArray[np.float64]

_FLAT: Final = ("perspective", "orthographic", "intrinsics")
_OF_CAMERAS: Final[Mapping[str, tuple[str, ...]]] = {
    "vertical_fov": ("perspective", "fisheye"),
    "height": ("orthographic",),
    "aperture_radius": _FLAT,
    "focus_distance": _FLAT,
    "blades": _FLAT,
    "blade_rotation_degrees": _FLAT,
    "mirrored": _FLAT,
    "lens_shift": ("perspective", "orthographic"),
    **dict.fromkeys(("fx", "fy", "cx", "cy", "skew", "resolution", "pixel_origin", "distortion"), ("intrinsics",)),
}
"""Camera types that allow these keys; all types allow the others."""
_POSES: Final = ("camera_to_world", "world_to_camera")
_FRAME: Final = ("position", "target", "up")
_TERMS: Final = {"brown-conrady": 6, "kannala-brandt": 4}
"""Largest numbers of radial coefficients."""

_Pixels = Annotated[int, Strict(), Field(ge=1, le=65536)]
_Focal = Annotated[Finite, Field(gt=0.0, le=1e7)]
_Place = Annotated[Finite, Field(ge=-1e7, le=1e7)]
_Coefficient = Annotated[Finite, Field(ge=-1e6, le=1e6)]
_Shift = Annotated[Finite, Field(ge=-100.0, le=100.0)]
_Pose = Annotated[tuple[Row, ...], Field(min_length=3, max_length=4)]
_FStop = Annotated[Finite, Field(ge=PHOTOGRAPHIC["f_stop"].low, le=PHOTOGRAPHIC["f_stop"].high)]
_Shutter = Annotated[Finite, Field(ge=PHOTOGRAPHIC["shutter"].low, le=PHOTOGRAPHIC["shutter"].high)]
_Shutters: TypeAlias = Annotated[
    Annotated[tuple[Seconds, Seconds], Tag("<interval>")] | Annotated[_Shutter, Tag("<seconds>")],
    Discriminator(lambda value: "<interval>" if isinstance(value, list | tuple) else "<seconds>"),
]
_Speed = Annotated[Finite, Field(ge=PHOTOGRAPHIC["iso"].low, le=PHOTOGRAPHIC["iso"].high)]


def _not_zero(value: float) -> float:
    if value == 0.0:
        raise fault("flow_step", "is 0, but must be above or below 0")
    return value


class Distortion(Part):
    """Lens distortion of a calibrated camera."""

    model: Literal["brown-conrady", "kannala-brandt"] = Field(
        description="brown-conrady: radial and tangential, OpenCV's usual model; kannala-brandt: OpenCV's fisheye model"
    )
    k: Annotated[tuple[_Coefficient, ...], Field(max_length=6)] = Field(
        (),
        description="radial coefficients k1, k2, ...: up to 6 of brown-conrady, where k4 to k6 are the denominator's; "
        "up to 4 of kannala-brandt",
    )
    p: tuple[_Coefficient, _Coefficient] = Field(
        (0.0, 0.0), description="brown-conrady: tangential coefficients p1 and p2"
    )

    @model_validator(mode="after")
    def _has_what_its_model_has(self) -> Distortion:
        most = _TERMS[self.model]
        if len(self.k) > most:
            raise fault("distortion", f"has {counted(len(self.k), 'number')}, but {self.model} has at most {most}", "k")
        if self.model == "kannala-brandt" and any(self.p):
            raise fault("distortion", "is for the model brown-conrady only; leave it out", "p")
        return self

    @cached_property
    def lens(self) -> LensModel:
        """The model with these coefficients."""
        k = (*self.k, *[0.0] * (_TERMS[self.model] - len(self.k)))
        return BrownConrady(k, self.p) if self.model == "brown-conrady" else KannalaBrandt(k)


class Camera(Part):
    """Camera. With an `aperture_radius` above 0, only objects at the `focus_distance` are in focus."""

    late_keys: ClassVar[frozenset[str]] = frozenset(
        {"mirrored", "lens_shift", "fx", "fy", "cx", "cy", "skew", "resolution", "pixel_origin", "distortion"}
        | {*_POSES, "convention", "time", "rolling_shutter", "flow_step", "motion", "response"}
    )

    type: Literal["perspective", "orthographic", "panoramic", "fisheye", "intrinsics"] = Field(
        "perspective",
        description="orthographic: parallel projection; panoramic: all directions, latitude-longitude; fisheye: "
        "equidistant projection, black outside of vertical_fov; intrinsics: a calibrated camera",
    )
    position: Vector = Field((0.0, 0.0, 0.0), description="position, metres, world space")
    target: Vector = Field((0.0, 0.0, 0.0), description="point at the centre of the image, metres, world space")
    up: Vector = Field((0.0, 1.0, 0.0), description="up direction; need not be perpendicular to the view direction")
    camera_to_world: _Pose | None = Field(
        None,
        description="pose in place of position, target and up: rotation and translation, 3 or 4 rows of 4 numbers, "
        "acting on columns",
    )
    world_to_camera: _Pose | None = Field(None, description="its inverse, in place of it")
    convention: Literal["opencv", "opengl", "ros"] = Field(
        "opencv",
        description="camera axes of the pose. opencv: x right, y down, z forward; opengl, also Blender's: x right, "
        "y up, z backward; ros: x forward, y left, z up",
    )
    vertical_fov: Annotated[Finite, Field(gt=0.0, le=360.0)] = Field(
        45.0, description="field of view, degrees; perspective: below 180; fisheye: at most 360, usually 180"
    )
    height: Length = Field(2.0, description="orthographic only: height of the visible region, metres")
    lens_shift: tuple[_Shift, _Shift] = Field(
        (0.0, 0.0),
        description="perspective, orthographic: shifts the visible region, by widths of the image to its right and by "
        "heights up",
    )
    fx: _Focal | None = Field(None, description="intrinsics only: focal length along x, pixels")
    fy: _Focal | None = Field(None, description="the same along y; default: fx")
    cx: _Place | None = Field(None, description="x of the principal point, pixels; default: the middle of the image")
    cy: _Place | None = Field(None, description="y of the principal point, pixels, downward; default: the middle")
    skew: _Place = Field(0.0, description="entry of the camera matrix to the right of fx, pixels")
    resolution: tuple[_Pixels, _Pixels] | None = Field(
        None,
        description="width and height of the image, pixels, to which these numbers apply; images of other sizes show "
        "the same from top to bottom; default: those in [image]",
    )
    pixel_origin: Literal["corner", "center"] = Field(
        "corner",
        description="where pixel coordinates are 0, 0: at the corner of the upper left pixel, whose centre is then "
        "0.5, 0.5 (COLMAP, transforms.json), or at its center (OpenCV, ROS)",
    )
    distortion: Distortion | None = Field(
        None, description="lens distortion; black where it cannot be inverted; default: none"
    )
    aperture_radius: Annotated[Finite, Field(ge=0.0, le=COORDINATE_LIMIT)] = Field(
        0.0, description="radius of the lens, metres; 0: pinhole"
    )
    focus_distance: Length | None = Field(
        None, description="metres along the view direction; default: distance of the target"
    )
    blades: Annotated[int, Strict(), Field(ge=0, le=64)] = Field(
        0, description="number of aperture blades, at least 3; 0: circular aperture"
    )
    blade_rotation_degrees: Annotated[Finite, Field(ge=-360.0, le=360.0)] = Field(
        0.0, description="rotation of the aperture, from image right towards image up"
    )
    mirrored: Flag = Field(
        False, description="flips the image horizontally, for scenes from left-handed coordinate systems"
    )
    f_stop: _FStop | None = Field(
        None,
        description="f-number; with shutter, sets the exposure of display images; does not affect depth of field",
    )
    shutter: _Shutters | None = Field(
        None,
        description="when the shutter opens and when it closes, seconds from `time`: what moves meanwhile is blurred; "
        "or the exposure time of display images alone, seconds, without motion blur",
    )
    iso: _Speed | None = Field(None, description="film speed, with f_stop and shutter (default: 100)")
    time: Seconds = Field(
        0.0, description="time of the image, seconds: where what moves is, and what shutter counts from"
    )
    rolling_shutter: Annotated[Finite, Field(ge=0.0, le=TIME_LIMIT)] = Field(
        0.0,
        description="seconds from the opening of the first row of the image to that of the one below the last: rows "
        "are exposed one after the other",
    )
    flow_step: Annotated[Finite, Field(ge=-TIME_LIMIT, le=TIME_LIMIT), AfterValidator(_not_zero)] | None = Field(
        None,
        description="seconds from the time of the image to the one to which the layers flow and scene_flow lead, which "
        "is earlier if they are below 0; default: from the opening of the shutter to its closing",
    )
    response: Response | None = Field(
        None, description="sensitivity of the camera's colours (`spectral`; default: the image is linear Rec. 709)"
    )
    motion: CameraMotion = Field((), description="keys of a motion of the camera; times ascend")

    @model_validator(mode="after")
    def _has_a_frame(self) -> Camera:
        self._take_pose()
        for key in ("position", "target"):
            if key not in self.model_fields_set:
                meaning = type(self).model_fields[key].description
                raise fault("camera", f"the key `{key}` is missing; add it: {meaning}")
        view: Vector = tuple(t - p for t, p in zip(self.target, self.position, strict=True))  # type: ignore[assignment]
        if length(view) == 0.0:
            raise fault("camera", "is the same point as the camera's position; give another point to look at", "target")
        if length(self.up) == 0.0:
            raise fault("camera", "has length zero; give a direction such as [0, 1, 0]", "up")
        unit = tuple(v / length(view) for v in view)
        upward = tuple(v / length(self.up) for v in self.up)
        if length(cross(unit, upward)) < 1e-7:  # type: ignore[arg-type]
            raise fault("camera", "is parallel to the view from position to target; give another direction", "up")
        return self

    def _take_pose(self) -> None:
        """Turn a matrix into position, target and up, which is how all else knows a pose."""
        given = [key for key in _POSES if getattr(self, key) is not None]
        if not given:
            if self.convention != "opencv":
                raise fault("camera", f"is for {' and '.join(_POSES)} only; leave it out", "convention")
            return
        others = [key for key in (*given[1:], *_FRAME) if key in self.model_fields_set]
        if others:
            raise fault("camera", f"is given with {given[0]}, which says it too; leave one of them out", others[0])
        try:
            position, forward, up = pose_of(getattr(self, given[0]), self.convention, given[0] == "world_to_camera")
        except ValueError as error:
            raise fault("camera", str(error), given[0]) from None
        if self.aperture_radius and self.focus_distance is None:
            raise fault("camera", "the key `focus_distance` is missing; add it: a pose has no target at that distance")
        if not (np.abs(position) <= COORDINATE_LIMIT).all():
            raise fault("camera", f"has a position beyond {COORDINATE_LIMIT:g} metres", given[0])
        # So far that the direction survives the rounding of large coordinates
        away = max(1.0, *np.abs(position).tolist())
        target = (position + away * forward).tolist()
        for key, vector in zip(_FRAME, (position.tolist(), target, up.tolist()), strict=True):
            object.__setattr__(self, key, tuple(vector))
        for key, default in (*dict.fromkeys(_POSES).items(), ("convention", "opencv")):
            object.__setattr__(self, key, default)
        self.model_fields_set.difference_update((*_POSES, "convention"))
        self.model_fields_set.update(_FRAME)

    @property
    def axes(self) -> tuple[Vector, Vector, Vector]:
        """Image right, image up and forward; unit vectors of world space."""
        view: Vector = tuple(t - p for t, p in zip(self.target, self.position, strict=True))  # type: ignore[assignment]
        forward = _scaled(view, 1.0 / length(view))
        right = cross(forward, _scaled(self.up, 1.0 / length(self.up)))
        right = _scaled(right, 1.0 / length(right))
        upward = cross(right, forward)
        return _scaled(right, -1.0) if self.mirrored else right, upward, forward

    @property
    def focus(self) -> float:
        """Distance of the plane of focus from `position`, metres."""
        if self.focus_distance is not None:
            return self.focus_distance
        return length(tuple(t - p for t, p in zip(self.target, self.position, strict=True)))  # type: ignore[arg-type]

    @property
    def film(self) -> _Floats | None:
        """What it sees of wavelengths, if it has a `response`: `clrender.spectra.film.sensor_table`."""
        return None if self.response is None else self.response.film()

    @property
    def own_keys(self) -> set[str]:
        """Keys that cameras of its type have."""
        return {key for key in type(self).model_fields if self.type in _OF_CAMERAS.get(key, (self.type,))}

    @property
    def is_distorted(self) -> bool:
        """Whether its image is more than a rectangle on a plane: it has lens distortion, or skewed axes."""
        return self.distortion is not None or self.skew != 0.0

    @property
    def lens(self) -> LensModel:
        """Its lens distortion."""
        return BrownConrady() if self.distortion is None else self.distortion.lens

    def projection(self, width: int, height: int, resolution: tuple[int, int] | None = None) -> Projection:
        """The map from points to places in the image.

        Parameters
        ----------
        width, height : int
            Size of the image, pixels.
        resolution : (int, int), optional
            `resolution`, if the camera has none; default: the size of the image.
        """
        if self.type == "panoramic":
            return LatitudeLongitude()
        if self.type == "fisheye":
            return Equidistant(math.radians(self.vertical_fov) / 2.0, width / height)
        if self.type == "intrinsics":
            return self._intrinsics(width, height, self.resolution or resolution or (width, height))
        spread = tan_degrees(self.vertical_fov / 2.0) if self.type == "perspective" else self.height / 2.0
        half_width, (right, up) = spread * width / height, self.lens_shift
        corner = (2.0 * right - 1.0) * half_width, (-2.0 * up - 1.0) * spread
        kind = Rectilinear if self.type == "perspective" else Parallel
        return kind(*corner, 2.0 * half_width, 2.0 * spread)

    def _intrinsics(self, width: int, height: int, resolution: tuple[int, int]) -> Projection:
        across, down = resolution
        assert self.fx is not None
        fy = self.fx if self.fy is None else self.fy
        cx = across / 2.0 if self.cx is None else self.cx + self._pixel_offset
        cy = down / 2.0 if self.cy is None else self.cy + self._pixel_offset
        # In an image of another shape the height is the same, as with other cameras: more or less is seen at both sides
        wide = across if across * height == down * width else down * width / height
        focal, principal = (self.fx / wide, fy / down), (0.5 + (cx - across / 2.0) / wide, cy / down)
        if self.is_distorted:
            return Intrinsics(focal, principal, self.skew / wide, self.lens)
        return Rectilinear(-principal[0] / focal[0], -principal[1] / focal[1], 1.0 / focal[0], 1.0 / focal[1])

    def project(self, points: npt.ArrayLike, size: tuple[int, int] | None = None) -> _Floats:
        """Pixel coordinates at which the camera sees points, as the shutter opens.

        Parameters
        ----------
        points : (..., 3) floats
            World space, metres.
        size : (int, int), optional
            Width and height of the image, pixels; default: `resolution`.

        Returns
        -------
        (..., 2) float64
            x to the right and y down, from the corner of the upper left pixel, or with a `pixel_origin` of ``center``
            from its centre. They may lie outside of the image; NaN where the point is behind the camera, or outside of
            the field that its lens can see.

        Raises
        ------
        UsageError
            The size is missing, or the points have not three coordinates.
        """
        width, height = self._size(size)
        given = _vectors(points, 3, "points")
        camera = self.opened
        right, upward, forward = camera.axes
        away = given.reshape(-1, 3) - np.array(camera.position)
        frame = np.stack([inner(away, np.array(axis)) for axis in (right, _scaled(upward, -1.0), forward)], axis=1)
        places = self.projection(width, height).places(frame) * np.array([width, height], np.float64)
        return np.asarray((places - self._pixel_offset).reshape(*given.shape[:-1], 2))

    def unproject(self, pixels: npt.ArrayLike, size: tuple[int, int] | None = None) -> tuple[_Floats, _Floats]:
        """Rays along which the camera sees points of its image as the shutter opens: the inverse of `project`.

        Parameters
        ----------
        pixels : (..., 2) floats
            As `project` returns them.
        size : (int, int), optional
            Width and height of the image, pixels; default: `resolution`.

        Returns
        -------
        origins, directions : (..., 3) float64
            World space; metres, and unit vectors. Directions are NaN where there is no ray: outside of a fisheye's
            image, and where lens distortion cannot be inverted. Rays of a camera with an aperture pass the middle of
            its lens.

        Raises
        ------
        UsageError
            See `project`.
        """
        width, height = self._size(size)
        given = _vectors(pixels, 2, "pixels")
        places = (given.reshape(-1, 2) + self._pixel_offset) / np.array([width, height], np.float64)
        camera = self.opened
        right, upward, forward = camera.axes
        axes = np.array([right, _scaled(upward, -1.0), forward])
        origins, directions = self.projection(width, height).rays(places)
        origins, directions = (
            (each[:, :1] * axes[0] + each[:, 1:2] * axes[1]) + each[:, 2:] * axes[2] for each in (origins, directions)
        )
        directions = directions / lengths(directions)[:, None]
        shape = (*given.shape[:-1], 3)
        return np.asarray((origins + np.array(camera.position)).reshape(shape)), directions.reshape(shape)

    @property
    def _pixel_offset(self) -> float:
        return 0.5 if self.pixel_origin == "center" else 0.0

    def _size(self, size: tuple[int, int] | None) -> tuple[int, int]:
        if size is None and self.resolution is None:
            raise UsageError("the size of the image is needed: give size=(width, height)")
        width, height = size or self.resolution or (0, 0)
        if width < 1 or height < 1:
            raise UsageError(f"an image of {width}x{height} pixels has no pixels; give positive numbers")
        return width, height

    def stereo_pair(self, baseline: float) -> tuple[Camera, Camera]:
        """Cameras of a left and a right eye, with parallel axes, at equal distances from this camera at each key.

        Parameters
        ----------
        baseline : float
            Distance between the two, metres.

        Returns
        -------
        left, right : Camera
        """

        def beside(camera: Camera, side: float) -> dict[str, Any]:
            step = _scaled(camera.axes[0], side)
            places = {"position": camera.position, "target": camera.target}
            return {key: tuple(a + b for a, b in zip(place, step, strict=True)) for key, place in places.items()}

        def eye(side: float) -> Camera:
            stops = zip(self.motion, self._stop_cameras, strict=True)
            keys = [{"time": key.time, "up": at.up, **beside(at, side)} for key, at in stops]
            return self.changed({**beside(self, side), **({"motion": keys} if keys else {})})

        return eye(-0.5 * baseline), eye(0.5 * baseline)

    @property
    def interval(self) -> tuple[float, float]:
        """When the shutter of the first row opens, and when that of the last one closes, seconds."""
        begin, end = self.shutter if isinstance(self.shutter, tuple) else (0.0, 0.0)
        return self.time + begin, self.time + end + self.rolling_shutter

    @property
    def row_share(self) -> float:
        """Share of `interval` for which each row of the image is exposed; 1 for an interval of length zero."""
        if not isinstance(self.shutter, tuple):
            return 0.0 if self.rolling_shutter > 0.0 else 1.0
        exposure = self.shutter[1] - self.shutter[0]
        return exposure / (exposure + self.rolling_shutter) if exposure > 0.0 else float(self.rolling_shutter == 0.0)

    @property
    def track(self) -> CameraTrack | None:
        """Its motion; None if it rests while the shutter is open."""
        if not self.motion:
            return None
        (begin, end), times = self.interval, [key.time for key in self.motion]
        first = max((index for index, time in enumerate(times) if time <= begin), default=0)
        last = min((index for index, time in enumerate(times) if time >= end), default=len(times) - 1)
        some = self._stops[first : last + 1]
        if begin == end or all(each == some[0] for each in some):
            return None
        return self._whole_track

    @property
    def _stops(self) -> list[tuple[Vector, Vector, Vector]]:
        """Position, target and up direction of each key."""
        return [(key.position or self.position, key.target or self.target, key.up or self.up) for key in self.motion]

    @property
    def _stop_cameras(self) -> list[Camera]:
        """The camera at each key, resting."""
        resting = self.with_checked(motion=())
        return [resting.changed(dict(zip(_FRAME, stop, strict=True))) for stop in self._stops]

    @property
    def _whole_track(self) -> CameraTrack:
        cameras = self._stop_cameras
        frames = [camera.with_checked(mirrored=False).axes for camera in cameras]
        distances = [camera.with_checked(focus_distance=None).focus for camera in cameras]
        times = [key.time for key in self.motion]
        return CameraTrack.of(times, [camera.position for camera in cameras], frames, distances)

    @property
    def opened(self) -> Camera:
        """The camera where it is when the shutter opens, without its motion."""
        if not self.motion:
            return self
        times, stops, begin = [key.time for key in self.motion], self._stops, self.interval[0]
        before = max((index for index, time in enumerate(times) if time <= begin), default=None)
        after = min((index for index, time in enumerate(times) if time >= begin), default=None)
        if before is None or after is None or stops[before] == stops[after]:
            pose = stops[after or 0] if before is None else stops[before]
        else:
            pose = self._whole_track.pose(begin)
        return self.with_checked(motion=(), **dict(zip(_FRAME, pose, strict=True)))

    @property
    def reach(self) -> float:
        """Largest distance from `position` to a ray's origin, metres; infinite for an orthographic camera."""
        return math.inf if self.type == "orthographic" else self.aperture_radius

    @property
    def exposure(self) -> dict[str, float] | None:
        """The exposure settings, which affect only display images and not radiance; None if not given."""
        given = {name: getattr(self, name) for name in PHOTOGRAPHIC}
        if isinstance(self.shutter, tuple):
            given["shutter"] = self.shutter[1] - self.shutter[0] if self.f_stop is not None else None
        return {name: value for name, value in given.items() if value is not None} or None

    @model_validator(mode="after")
    def _has_times(self) -> Camera:
        if isinstance(self.shutter, tuple):
            begin, end = self.shutter
            if end < begin:
                raise fault("camera", f"closes at {end:g}, before it opens at {begin:g}; exchange them", "shutter")
            if self.f_stop is not None and not end - begin >= PHOTOGRAPHIC["shutter"].low:
                low = PHOTOGRAPHIC["shutter"].low
                raise fault("camera", f"is open for {end - begin:g} s, but with f_stop for {low:g} at least", "shutter")
        for index, stop in enumerate(self._stops):
            try:
                self.with_checked(motion=()).changed(dict(zip(_FRAME, stop, strict=True)))
            except SceneError as error:
                raise fault("camera", f"is no place for a camera: {error}", "motion", index) from None
        return self

    @model_validator(mode="after")
    def _is_a_whole_exposure(self) -> Camera:
        for given in self.exposure or ():
            for missing in ("f_stop", "shutter"):
                if getattr(self, missing) is None:
                    cure = f"give f_stop and shutter, or leave {given} out"
                    raise fault("camera", f"is given without {missing}; {cure}", given)
        return self

    @model_validator(mode="after")
    def _has_what_its_type_has(self) -> Camera:
        for key, types in _OF_CAMERAS.items():
            if self.type not in types and getattr(self, key) != type(self).model_fields[key].default:
                raise fault("camera", f"is for cameras of type {' and '.join(types)} only; leave it out", key)
        if self.type == "perspective" and self.vertical_fov >= 180.0:
            raise fault(
                "camera", f"is {self.vertical_fov:g}, but of type perspective must be less than 180", "vertical_fov"
            )
        if self.blades in (1, 2):
            raise fault("camera", f"is {self.blades}, but must be 0, or at least 3", "blades")
        if self.type == "intrinsics":
            if self.fx is None:
                raise fault("camera", f"the key `fx` is missing; add it: {type(self).model_fields['fx'].description}")
            if self.aperture_radius and self.distortion is not None and self.distortion.model == "kannala-brandt":
                text = "is not for cameras with the distortion kannala-brandt, whose rays meet in a point; leave it out"
                raise fault("camera", text, "aperture_radius")
        return self


def _vectors(values: npt.ArrayLike, size: int, what: str) -> _Floats:
    """Numbers as an array of vectors."""
    try:
        given = np.asarray(values, np.float64)
    except (TypeError, ValueError):
        given = np.zeros(0)
    if given.ndim == 0 or given.shape[-1] != size:
        shape: Any = np.shape(values) if isinstance(values, np.ndarray) else values
        raise UsageError(f"{what} are {shape!r}, but must be an array of shape (..., {size})")
    return given


def _scaled(a: Vector, factor: float) -> Vector:
    return (a[0] * factor, a[1] * factor, a[2] * factor)
