"""Scenes written in a line or two, and their renders as independent batches."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import numpy.typing as npt

import clrender

if TYPE_CHECKING:
    from clrender.device import Device
    from clrender.scene import Scene

__all__ = [
    "Studio",
    "disk",
    "down",
    "hashes_by_lanes_and_cuts",
    "lambert",
    "quad",
    "room",
    "scene",
    "sphere",
    "triangle",
]

_WEIGHTS: Final = np.array([0.5, 0.3, 0.2])
"""Channels become one number: they are not independent of each other, and unequal weights tell them apart."""

Floats = npt.NDArray[np.float64]
Vector = Sequence[float]


class Studio:
    """Renders on one device, in one session: what two renders share is compiled and uploaded once.

    Parameters
    ----------
    session : clrender.Session
        Of one device.
    """

    def __init__(self, session: clrender.Session) -> None:
        self._session = session

    def image(self, what: Scene, size: int | tuple[int, int] = 32, **settings: Any) -> Floats:
        """(height, width, 3) radiance; every sample has to be finite."""
        wanted = (size, size) if isinstance(size, int) else size
        made = self._session.render(what, size=wanted, **settings)
        assert made.stats["nonfinite_samples"] == 0
        return made.linear.astype(np.float64)

    def layer(self, what: Scene, size: int, name: str) -> Floats:
        """(size, size, channels) layer of an image of few samples."""
        made = self._session.render(what, size=(size, size), spp=4, aov=(name,))
        return made.aovs[name].astype(np.float64)

    def gray(self, what: Scene, size: int | tuple[int, int] = 32, **settings: Any) -> Floats:
        """(height, width) weighted radiance: the channels together in one number, each with another weight."""
        weighted: Floats = self.image(what, size, **settings) @ _WEIGHTS
        return weighted

    def pixels(self, what: Scene, size: int = 32, **settings: Any) -> Floats:
        """(size * size,) weighted radiance of each pixel of one image: batches when all of them see the same thing."""
        return self.gray(what, size, **settings).ravel()

    def patches(self, what: Scene, **settings: Any) -> Floats:
        """(64, 64) weighted radiance: the pixels, as batches, of each of the 8 x 8 patches of an image of 64 x 64."""
        picture = self.gray(what, 64, **settings).reshape(8, 8, 8, 8)
        return picture.transpose(1, 3, 0, 2).reshape(64, 64)

    def tiles(
        self, what: Scene, seeds: Iterable[int] = range(16), size: int = 32, tiles: int = 4, **settings: Any
    ) -> Floats:
        """(seeds, tiles * tiles) weighted mean radiance of the tiles of images of different seeds."""
        rows = []
        for seed in seeds:
            picture = self.gray(what, size, seed=seed, **settings)
            side = size // tiles
            rows.append(picture.reshape(tiles, side, tiles, side).mean(axis=(1, 3)).ravel())
        return np.array(rows)


def scene(
    shapes: Sequence[Mapping[str, Any]],
    lights: Sequence[Mapping[str, Any]] = (),
    camera: Mapping[str, Any] | None = None,
    **materials: Mapping[str, Any],
) -> Scene:
    """A scene of dictionaries; without a camera it looks from above at the point (0, 0, 0), and at nothing else."""
    return clrender.Scene(
        camera=down() if camera is None else camera, shapes=tuple(shapes), lights=tuple(lights), materials=materials
    )


def down(target: Vector = (0.0, 0.0, 0.0), height: float = 0.25, degrees: float = 0.01) -> dict[str, Any]:
    """A camera that looks down (along -y) at a point from so little above that it is below all lights.

    The view is so narrow that all pixels see the same: batches.
    """
    return {
        "position": [target[0], target[1] + height, target[2]],
        "target": list(target),
        "up": [0.0, 0.0, -1.0],
        "vertical_fov": degrees,
    }


def lambert(reflectance: float | Vector) -> dict[str, Any]:
    """A diffuse material, grey when given one number."""
    color = [reflectance] * 3 if isinstance(reflectance, int | float) else list(reflectance)
    return {"type": "lambert", "reflectance": color}


def quad(origin: Vector, edge_u: Vector, edge_v: Vector, **more: Any) -> dict[str, Any]:
    """A parallelogram; it faces along edge_u x edge_v."""
    return {"type": "quad", "origin": list(origin), "edge_u": list(edge_u), "edge_v": list(edge_v), **_colors(more)}


def triangle(vertices: Sequence[Vector], **more: Any) -> dict[str, Any]:
    """A triangle."""
    return {"type": "triangle", "vertices": [list(v) for v in vertices], **_colors(more)}


def sphere(center: Vector, radius: float, **more: Any) -> dict[str, Any]:
    """A sphere."""
    return {"type": "sphere", "center": list(center), "radius": radius, **_colors(more)}


def room(size: Vector, **more: Any) -> dict[str, Any]:
    """A box that is looked at from within."""
    return {"type": "box", "size": list(size), "flip_normals": True, **_colors(more)}


def disk(center: Vector, normal: Vector, radius: float, **more: Any) -> dict[str, Any]:
    """A disk."""
    return {"type": "disk", "center": list(center), "normal": list(normal), "radius": radius, **_colors(more)}


def _colors(more: Mapping[str, Any]) -> dict[str, Any]:
    """`emission` may be one number."""
    return {k: [v] * 3 if k == "emission" and isinstance(v, int | float) else v for k, v in more.items()}


def hashes_by_lanes_and_cuts(
    device: Device, what: Scene, lanes: Sequence[int] = (1, 4, 8, 16), **settings: Any
) -> set[str]:
    """Hashes of a small image as the device would render it, in small tiles and single samples, and in some lanes."""
    ways: list[dict[str, Any]] = [{}, {"tile": 8, "samples_per_pass": 1}, *({"lanes": number} for number in lanes)]
    fixed: dict[str, Any] = {"device": device.info.index, "size": (40, 31), "spp": 4, **settings}
    images = (clrender.render(what, **fixed, **way) for way in ways)
    return {str(image.stats["image_sha256"]) for image in images}
