"""What is put behind an image later, and how much shadow catchers darken it: from renders with and without objects."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from clrender.flatten.emission import emits
from clrender.scene import Scene
from clrender.scene.groups import Instance, ShapeOrInstance
from clrender.scene.shapes import AnyShape

__all__ = ["caught", "whole_and_bare"]

_Image = npt.NDArray[np.float32]


def whole_and_bare(scene: Scene) -> tuple[Scene, Scene]:
    """The scenes in which shadow catchers are shapes like others: the whole one, and the one without other shapes.

    Parameters
    ----------
    scene : Scene

    Returns
    -------
    whole, bare : Scene
        Without an environment behind them. `bare` has the shadow catchers, and all that shines.
    """
    hidden = scene.with_hidden_environment()

    def plain(shape: AnyShape) -> AnyShape:
        return shape.with_checked(shadow_catcher=False) if shape.shadow_catcher else shape

    def stays(shape: AnyShape) -> bool:
        return shape.shadow_catcher or emits(scene, shape)

    return _with_shapes(hidden, plain, lambda shape: True), _with_shapes(hidden, plain, stays)


def _with_shapes(scene: Scene, made: Callable[[AnyShape], AnyShape], stays: Callable[[AnyShape], bool]) -> Scene:
    groups = {}
    for name, group in scene.groups.items():
        if some := tuple(made(shape) for shape in group.shapes if stays(shape)):
            groups[name] = group.with_checked(shapes=some)
    shapes: list[ShapeOrInstance] = []
    for shape in scene.shapes:
        if isinstance(shape, Instance):
            shapes += [shape] if shape.group in groups else []
        elif stays(shape):
            shapes.append(made(shape))
    return scene.with_checked(shapes=tuple(shapes), groups=groups)


def caught(
    image: _Image, alpha: _Image, whole: tuple[_Image, _Image], bare: tuple[_Image, _Image]
) -> tuple[_Image, _Image]:
    """The layer of shadow catchers, and alpha.

    A background in a shadow catcher's place is darkened as the catcher itself is, when the objects come there (Debevec
    1998, "Rendering Synthetic Objects into Real Scenes", but as a ratio).

    Parameters
    ----------
    image : (H, W, 3) float32
        Radiance of all but shadow catchers and what is behind them.
    alpha : (H, W) float32
        Its alpha, in which shadow catchers do not count.
    whole, bare : pair of (H, W, 3) and (H, W) float32
        Radiance and alpha of the scenes of `whole_and_bare`.

    Returns
    -------
    factor : (H, W, 3) float32
        What a background is to be multiplied by, before the image is added to it. Each channel is contiguous in memory.
    alpha : (H, W) float32
        One less the mean of that over the channels, 0 to 1.
    """
    of_catchers = np.maximum(whole[0].astype(np.float64) - image, 0.0)
    lit = bare[0].astype(np.float64)
    covered = np.broadcast_to((whole[1].astype(np.float64) - alpha)[..., None], lit.shape)
    share = np.divide(of_catchers * bare[1][..., None], lit, out=np.maximum(covered, 0.0), where=lit > 0.0)
    behind = 1.0 - whole[1].astype(np.float64)[..., None]
    factor = np.minimum(behind + share, np.finfo(np.float32).max)
    planes = np.ascontiguousarray(np.moveaxis(factor, 2, 0), np.float32)
    return np.moveaxis(planes, 0, 2), np.clip(1.0 - factor.mean(axis=2), 0.0, 1.0).astype(np.float32)
