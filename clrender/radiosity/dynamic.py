"""Radiosity of a changing scene: a move recomputes only what it affects, near the observer first."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from clrender.errors import UsageError
from clrender.radiosity.moving import Moving
from clrender.radiosity.patches import Patches, cut_into_patches
from clrender.radiosity.rows import Rows, Traced
from clrender.radiosity.sides import (
    box_around,
    carried_radiance,
    first_sides,
    importance,
    is_convex,
    light_boxes,
    lights_differ,
    reaches_inside,
    sealed_sides,
    traced_sides,
)
from clrender.radiosity.solution import RadiositySettings, check_settings, solve_scene
from clrender.radiosity.tracer import Changes, PreviousDirectLight, Tracer

if TYPE_CHECKING:
    from clrender.device.device import Device
    from clrender.device.launch import LaunchConfig
    from clrender.scene import Scene

__all__ = ["DynamicRadiosity", "Update"]

_Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Update:
    """The cost of an update.

    Attributes
    ----------
    rays : int
        Rays that were traced again, out of `all_rays`.
    all_rays : int
    sweeps : int
    seconds : float
    """

    rays: int
    all_rays: int
    sweeps: int
    seconds: float


class DynamicRadiosity:
    """A scene's radiosity, updated while shapes and lights move.

    Each side uses the same numbered rays in every frame, so an update converges to the solution from scratch with the
    same patches, up to the tolerance. It shoots the residual of each side: the difference, positive or negative,
    between its new and its old radiosity (Chen 1990; George, Sillion & Greenberg 1990). The tolerance of sides far from
    the observer grows with the square of their distance (after Shcherbakov); their residual is not lost but propagated
    in a later frame or by `settle`.

    Parameters
    ----------
    scene : Scene
        Must have only diffuse surfaces.
    device : Device
    settings : RadiositySettings, optional
        `tolerance` is relative to the mean radiance of the scene.
    size : (int, int)
        Size of the camera's image, pixels.
    cut : LaunchConfig, optional
    patches : Patches, optional
        Initial patches; default: made from the scene, and refined if `settings` says so.

    Attributes
    ----------
    patches : Patches
    flat : FlatScene
    started : Update
        Cost of the first solution.

    Raises
    ------
    SceneError, UsageError, RenderError
    """

    def __init__(
        self,
        scene: Scene,
        device: Device,
        settings: RadiositySettings | None = None,
        size: tuple[int, int] = (64, 64),
        cut: LaunchConfig | None = None,
        patches: Patches | None = None,
    ) -> None:
        self._settings = settings or RadiositySettings(tolerance=1e-3)
        check_settings(self._settings)
        self._device, self._size, self._cut = device, size, cut
        self.patches = patches or self._cut_up(scene)
        self._tracer: Tracer | None = None
        self._moving: Moving | None = None
        self._held: Rows | None = None
        self._weights = importance(self.patches)
        self.started = self.start_again()

    @property
    def rows(self) -> Rows:
        """State of the sides in the solution."""
        assert self._held is not None
        return self._held

    @property
    def reflected(self) -> _Floats:
        """(2 n + 1, 3) float64: radiance that each side reflects."""
        return self.rows.reflected

    @property
    def used(self) -> NDArray[np.bool_]:
        """(2 n + 1,) bool: sides in the solution."""
        return self.rows.used

    def start_again(self) -> Update:
        """Solve from scratch for the current patches; kernel compilation is not timed."""
        begin = self._clock()
        self._stand_still()
        self._sealed = sealed_sides(self.patches)
        traced = self._traced(first_sides(self.patches, self._sealed), self._sealed)
        if self._held is not None:
            self._held.release()
        self._held = Rows(self._device, traced, self._sealed)
        sweeps = self.settle()
        return Update(traced.hits.size, traced.hits.size, sweeps, self._clock() - begin)

    def move(self, shape: int, by: Sequence[float]) -> Update:
        """Move a shape and update the solution.

        Parameters
        ----------
        shape : int
            Its index among the shapes of `patches.scene`, in which instances are written out
            (`clrender.flatten.assembly.numbers_written_out`). The first move of a shape takes longer.
        by : three floats
            Metres.

        Raises
        ------
        UsageError
            If there is no such shape.
        """
        begin, scene = self._clock(), self.patches.scene
        if not 0 <= shape < len(scene.plain_shapes):
            raise UsageError(f"there is no shape {shape}; the scene has {len(scene.plain_shapes)}, counted from 0")
        before = self.flat
        self._step(shape, (float(by[0]), float(by[1]), float(by[2])))
        changes = self._follow()
        shines = self.patches.shadow_rays_find_emission and scene.plain_shapes[shape].emission is not None
        self._direct(shines or lights_differ(before, self.flat))
        return self._update(begin, changes.rays + self._add_sides(changes.unknown))

    def settle(self) -> int:
        """Hold every side to the tolerance, at any distance; returns the number of sweeps."""
        return self.rows.settle(self.patches, self._settings.tolerance, None)

    def release(self) -> None:
        """Release the device's memory."""
        for held in (self._tracer, self._held, self._moving):
            if held is not None:
                held.release()
        self._tracer = self._held = self._moving = None

    @property
    def _rays(self) -> Tracer:
        assert self._tracer is not None
        return self._tracer

    def _clock(self) -> float:
        return time.perf_counter() - self._device.compile_seconds

    def _cut_up(self, scene: Scene) -> Patches:
        if self._settings.refine:
            return solve_scene(scene, self._device, self._settings, self._size, self._cut).patches
        return cut_into_patches(scene, self._settings.patches)

    def _place(self) -> None:
        """Upload the patches at their current positions."""
        if self._tracer is not None:
            self._tracer.release()
        settings, moving = self._settings, self._moving
        self._tracer = Tracer(self._device, self.flat, settings.rays, settings.seed, self._cut, moving=moving)

    def _stand_still(self) -> None:
        """Like `_place`, with one BVH over all patches."""
        if self._moving is not None:
            self._moving.release()
        self._moving, self.flat = None, self.patches.flat(*self._size)
        self._place()

    def _step(self, shape: int, by: tuple[float, float, float]) -> None:
        """Like `_place`, after a step of a shape."""
        moved = self.patches.sides_of(shape)
        before = box_around(self.patches, moved)
        self.patches = self.patches.moved(shape, by)
        self.flat = self.patches.flat(*self._size)
        if self._moving is None or self._moving.shape != shape:
            if self._moving is not None:
                self._moving.release()
            self._moving = Moving(self._device, shape, moved, is_convex(self.patches.scene.plain_shapes[shape]))
        boxes, inside = np.stack([before, box_around(self.patches, moved)]), reaches_inside(self.patches, shape)
        self._moving.step(self.flat, boxes, self.patches.corners[moved[0] // 2, 0], np.array(by), inside)
        self._place()

    def _traced(self, sides: NDArray[np.uint32], known: NDArray[np.bool_]) -> Traced:
        """Trace rays and shadow rays of these sides, and of further sides that they see."""
        every, hits = traced_sides(self._rays, sides, known)
        return Traced(every, hits, *self._rays.direct(every, self._settings.direct_samples))

    def _follow(self) -> Changes:
        """Retrace the rays that the move may have changed."""
        rows = self.rows
        sent = np.zeros((2 * len(self.patches) + 1, 4), np.float32)
        sent[:, :3] = carried_radiance(self.patches) + rows.reflected
        kinds = np.where(self._sealed, 1, np.where(rows.used, 0, 2)).astype(np.uint8)
        kinds[-1] = 0
        changes = self._rays.follow(rows.sides, rows.hits, sent, kinds)
        rows.take(changes)
        sealed = sealed_sides(self.patches)
        if not np.array_equal(sealed, self._sealed):
            self._sealed = sealed
            rows.cover(sealed)
        return changes

    def _add_sides(self, met: bool) -> int:
        """Add sides without a row that the camera may see now, or that rays hit (`met`); returns the rays traced."""
        rows = self.rows
        known = rows.used | self._sealed
        new = np.zeros(len(known), bool)
        new[first_sides(self.patches, self._sealed)] = True
        if met:
            new[rows.met] = True
        new[-1] = False
        new &= ~known
        if not new.any():
            return 0
        self._stand_still()
        more = self._traced(np.flatnonzero(new).astype(np.uint32), known)
        self._held = rows.joined(more, self._sealed)
        return more.hits.size

    def _direct(self, everywhere: bool) -> None:
        """Update direct light, everywhere or where the moving shape may have changed it."""
        rows = self.rows
        known = None if everywhere else PreviousDirectLight(rows.irradiance, rows.seen, light_boxes(self.patches))
        rows.irradiance, rows.seen = self._rays.direct(rows.sides, self._settings.direct_samples, known)

    def _update(self, begin: float, rays: int) -> Update:
        sweeps = self.rows.settle(self.patches, self._settings.tolerance, self._weights)
        return Update(rays, len(self.rows.sides) * self._settings.rays, sweeps, self._clock() - begin)
