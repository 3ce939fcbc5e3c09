"""A moving shape on a device, with its own BVH, so that a step does not rebuild that of everything else."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from clrender.device import bvh

if TYPE_CHECKING:
    from clrender.device.device import Argument, Device
    from clrender.flatten.flat_scene import FlatScene

__all__ = ["Moving"]

_Floats = NDArray[np.float64]


class Moving:
    """BVHs of a scene of patches in which one shape moves.

    Parameters
    ----------
    device : Device
    shape : int
        Its index in the scene's list.
    sides : (int, int)
        First side of the shape, and the one after its last.
    convex : bool
        Whether rays that leave the front of the shape cannot hit it again.

    Attributes
    ----------
    shape : int
    others : Bvh
        Over everything but the shape, or over everything.
    """

    def __init__(self, device: Device, shape: int, sides: tuple[int, int], convex: bool) -> None:
        self._device, self.shape, self._sides, self._convex = device, shape, sides, convex
        self._own: bvh.Bvh | None = None
        self._over_all = False
        self._place = device.empty(4 * 18)

    def step(self, scene: FlatScene, boxes: NDArray[np.float32], at: _Floats, by: _Floats, inside: bool) -> None:
        """Take a step of the shape; `others` is valid until the next step.

        Parameters
        ----------
        scene : FlatScene
            Scene of patches, at their current positions.
        boxes : (2, 6) float32
            Bounds of the shape before and after the step: low x, y, z and high x, y, z.
        at : (3,) float64
            One of its points.
        by : (3,) float64
            The step.
        inside : bool
            Whether it may intersect a box or tetrahedron, or is one that another shape may intersect. Rays from inside
            hit two coplanar surfaces, the box's and that of the floor below it, and the rounding of the BVH's boxes
            decides which is nearer: then the BVH must equal the one built from scratch.

        Raises
        ------
        RenderError
            If the device runs out of memory.
        """
        if self._own is None:
            self._own, self._begin = self._build(scene, moving=True, others=False), at
            self.others = self._build(scene, moving=inside, others=True)
        elif inside or self._over_all:
            self._release(self.others)
            self.others = self._build(scene, moving=inside, others=True)
        self._over_all = inside
        # Kernels size their stacks for the deeper of the two.
        self.others = replace(self.others, levels=max(self.others.levels, self._own.levels))
        self._device.write(self._place, np.concatenate([boxes.reshape(-1), at - self._begin, by]).astype(np.float32))

    def _build(self, scene: FlatScene, moving: bool, others: bool) -> bvh.Bvh:
        device = self._device
        arrays = {name: device.upload(scene.arrays[name]) for name in bvh.SOURCE_NAMES}
        source = bvh.SourceArrays.of(arrays, scene.triangle_count, scene.analytic_count)
        among = np.full(scene.triangle_count + scene.analytic_count, others)
        among[self._sides[0] // 2 : self._sides[1] // 2] = moving
        among[scene.triangle_count :] = True
        tree = bvh.build(device, source, among)
        for buffer in arrays.values():
            device.release(buffer)
        return tree

    @property
    def arguments(self) -> list[Argument]:
        """Kernel arguments for ``MOVING_PARAMETERS``."""
        assert self._own is not None
        first, end = self._sides
        numbers = [np.uint32(n) for n in (first, end, self._convex)]
        tree = self._own
        return [*tree.buffers, self._place, *numbers]

    def _release(self, tree: bvh.Bvh) -> None:
        for buffer in tree.buffers:
            self._device.release(buffer)

    def release(self) -> None:
        """Release the device's memory."""
        self._device.release(self._place)
        if self._own is not None:
            self._release(self._own)
            self._release(self.others)
