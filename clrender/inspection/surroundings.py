"""What a page shows around the paths of a pixel: the image, the pixels beside it, and points of the scene."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import numpy.typing as npt

if TYPE_CHECKING:
    from clrender.rendering.job import RenderJob
    from clrender.rendering.job_render import Recorded
    from clrender.rendering.session import Session
    from clrender.scene.camera import Camera
    from clrender.settings import RenderSettings

__all__ = ["Surroundings", "pose_of", "surroundings_of"]

_IMAGE_SIDE: Final = 384
_CLOUD_SIDE: Final = 192
"""Longer side of the small image, and of the grid of points, pixels."""
_IMAGE_SPP: Final = 16
_CLOUD_SPP: Final = 1
_NEAR: Final = 10
"""Pixels on each side of the pixel that are shown with the samples of the render."""


@dataclass(frozen=True)
class Surroundings:
    """Pictures and points of the scene that the paths are in.

    Attributes
    ----------
    image : (h, w, 3) float32
        The whole image, smaller and with few samples, W/(sr m2).
    near : (n, m, 3) float32
        Pixels around the pixel, with the settings of the render.
    near_corner : (int, int)
        Column and row of the upper left one of these.
    points : (p, 3) float32
        First hits of the camera, world space, metres.
    colors : (p, 3) float32
        Radiance seen there.
    point_rows : int
        Rows of the grid of rays that found them.
    camera : mapping
        ``position``, ``right``, ``up``, ``forward`` (world space), ``fov``, degrees, upright, and ``projects``: whether
        these say where a point is in the image.
    stops : float
        Exposure of the pictures, stops; by default that of the scene's camera.
    tone_map : str
        Tone mapping of the pictures.
    """

    image: npt.NDArray[np.float32]
    near: npt.NDArray[np.float32]
    near_corner: tuple[int, int]
    points: npt.NDArray[np.float32]
    colors: npt.NDArray[np.float32]
    point_rows: int
    camera: dict[str, Any]
    stops: float
    tone_map: str = "srgb"


def surroundings_of(
    session: Session,
    job: RenderJob,
    pixel: tuple[int, int],
    recorded: Recorded,
    should_stop: Callable[[], bool] | None = None,
) -> Surroundings:
    """Render what a page shows around the paths of a pixel.

    Parameters
    ----------
    session : Session
    job : RenderJob
        The render of the whole image.
    pixel : (int, int)
    recorded : Recorded
    should_stop : callable, optional
        See `Session.render`.
    """
    wanted, field = job.settings, recorded.guiding_field
    (x, y), guiding = pixel, "off" if field is None else "on"
    left, top = max(x - _NEAR, 0), max(y - _NEAR, 0)
    crop = left, top, min(x + _NEAR + 1, wanted.width) - left, min(y + _NEAR + 1, wanted.height) - top
    close = _job(job, dataclasses.replace(wanted, crop=crop, guiding=guiding), guiding_field=field)
    near = session.render(close, should_stop=should_stop, keep_film=False)
    whole = dataclasses.replace(
        _smaller(wanted, _IMAGE_SIDE), spp=min(wanted.spp, _IMAGE_SPP), guiding="off", replicate_spp=None
    )
    image = session.render(_job(job, whole), should_stop=should_stop, keep_film=False)
    few = dataclasses.replace(_smaller(whole, _CLOUD_SIDE), spp=_CLOUD_SPP)
    layer = session.layers(_job(job, few, aov=("position",)), should_stop)["position"]
    height, width = layer.shape[:2]
    rows = np.minimum(((np.arange(height) + 0.5) * image.linear.shape[0] / height).astype(int), len(image.linear) - 1)
    across = image.linear.shape[1]
    columns = np.minimum(((np.arange(width) + 0.5) * across / width).astype(int), across - 1)
    hit = np.isfinite(layer).all(axis=2)
    colors = image.linear[rows][:, columns][hit]
    points = np.ascontiguousarray(layer[hit])
    stops = image.camera_stops
    return Surroundings(
        image.linear, near.linear, (left, top), points, colors, height, pose_of(job.scene.camera), stops
    )


def pose_of(camera: Camera) -> dict[str, Any]:
    """Where a camera is and how it looks, as `Surroundings.camera`."""
    opened = camera.opened
    right, up, forward = opened.axes
    return {
        "position": list(opened.position),
        "right": list(right),
        "up": list(up),
        "forward": list(forward),
        "fov": float(opened.vertical_fov) if opened.type == "perspective" else 45.0,
        # A sample of a camera that moves was taken from where it was at the time of the sample
        "projects": opened.type == "perspective"
        and not any(opened.lens_shift)
        and not opened.mirrored
        and camera.track is None,
    }


def _job(job: RenderJob, settings: RenderSettings, **more: Any) -> RenderJob:
    """The job of a picture."""
    count = settings.spp
    given: dict[str, Any] = {"guiding_field": None, "aov": (), **more}
    return dataclasses.replace(job, settings=settings, first_sample=0, sample_count=count, **given)


def _smaller(settings: RenderSettings, most: int) -> RenderSettings:
    """Settings of an image of the same shape whose longer side has at most so many pixels."""
    share = min(1.0, most / max(settings.width, settings.height))
    width, height = (max(1, round(side * share)) for side in (settings.width, settings.height))
    return dataclasses.replace(settings, width=width, height=height)
