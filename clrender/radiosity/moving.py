"""A shape that moves, on a device: its own tree and one of all else, so that a step of it needs no tree anew."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from clrender.device import bvh

if TYPE_CHECKING:
    from clrender.device.device import Argument, Device
    from clrender.flatten import FlatScene

__all__ = ["Moving"]

_Floats = NDArray[np.float64]


class Moving:
    """Trees of a scene of patches in which one shape moves.

    Parameters
    ----------
    device : Device
    shape : int
        Its place in the scene's list.
    sides : (int, int)
        First side of the shape, and the one after its last.
    convex : bool
        Whether rays that leave the front of the shape cannot meet it again.

    Attributes
    ----------
    shape : int
    others : Bvh
        Over all but the shape, or over all.
    """

    def __init__(self, device: Device, shape: int, sides: tuple[int, int], convex: bool) -> None:
        self._device, self.shape, self._sides, self._convex = device, shape, sides, convex
        self._own: bvh.Bvh | None = None
        self._over_all = False
        self._place = device.empty(4 * 18)

    def step(self, scene: FlatScene, boxes: NDArray[np.float32], at: _Floats, by: _Floats, inside: bool) -> None:
        """The shape has moved; `others` is good until the next step.

        Parameters
        ----------
        scene : FlatScene
            Of patches, where they are now.
        boxes : (2, 6) float32
            Around the shape, before the step and after: low x, y, z and high x, y, z.
        at : (3,) float64
            One of its points.
        by : (3,) float64
            The step.
        inside : bool
            Whether it may reach into a box or tetrahedron, or it is one and another shape reaches into it. Rays from in
            there meet two surfaces in one plane, a box's and that of the floor below it, and which of them is nearer is
            for roundings of a tree's boxes to say: then there has to be the tree that a fresh start has.

        Raises
        ------
        RenderError
            When the device has not the memory.
        """
        if self._own is None:
            self._own, self._begin = self._build(scene, moving=True, others=False), at
            self.others = self._build(scene, moving=inside, others=True)
        elif inside or self._over_all:
            self._release(self.others)
            self.others = self._build(scene, moving=inside, others=True)
        self._over_all = inside
        # Kernels have room for the deeper of them
        self.others = replace(self.others, levels=max(self.others.levels, self._own.levels))
        self._device.write(self._place, np.concatenate([boxes.reshape(-1), at - self._begin, by]).astype(np.float32))

    def _build(self, scene: FlatScene, moving: bool, others: bool) -> bvh.Bvh:
        device, names = self._device, ("vertices", "triangles", "analytic_shapes", "primitive_shape", "shapes")
        arrays = {name: device.upload(scene.arrays[name]) for name in names}
        source = bvh.SourceArrays(**arrays, triangle_count=scene.triangle_count, analytic_count=scene.analytic_count)
        among = np.full(scene.triangle_count, others)
        among[self._sides[0] // 2 : self._sides[1] // 2] = moving
        tree = bvh.build(device, source, among)
        for buffer in arrays.values():
            device.release(buffer)
        return tree

    @property
    def arguments(self) -> list[Argument]:
        """What kernels take for ``MOVING_PARAMETERS``."""
        assert self._own is not None
        first, end = self._sides
        numbers = [np.uint32(n) for n in (first, end, self._convex)]
        tree = self._own
        return [tree.nodes, tree.triangle_packs, tree.analytic_packs, self._place, *numbers]

    def _release(self, tree: bvh.Bvh) -> None:
        for buffer in (tree.nodes, tree.triangle_packs, tree.analytic_packs):
            self._device.release(buffer)

    def release(self) -> None:
        """Give the device's memory back."""
        self._device.release(self._place)
        if self._own is not None:
            self._release(self._own)
            self._release(self.others)
