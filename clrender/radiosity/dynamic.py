"""Radiosity of a scene that changes: only light that a move touches is followed again, near the observer first."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray

from clrender.errors import UsageError
from clrender.radiosity.patches import Patches, cut_into_patches
from clrender.radiosity.sides import (
    box_around,
    carried_radiance,
    covered_rays,
    first_sides,
    importance,
    largest,
    lifted,
    lights_differ,
    sealed_sides,
    side_areas,
    traced_sides,
)
from clrender.radiosity.solution import Sought, check_sought, solve_scene
from clrender.radiosity.sweeper import Sweeper
from clrender.radiosity.tracer import Tracer
from clrender.scene.description import PointLight

if TYPE_CHECKING:
    from clrender.device.device import Buffer, Device
    from clrender.device.worker import Cut
    from clrender.scene import Scene

__all__ = ["DynamicRadiosity", "Update"]

_MOST_SWEEPS: Final = 1000

_Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Update:
    """What a change took.

    Attributes
    ----------
    rays : int
        Traced again, of `all_rays`.
    all_rays : int
    sweeps : int
    seconds : float
    """

    rays: int
    all_rays: int
    sweeps: int
    seconds: float


class DynamicRadiosity:
    """A scene's radiosity, kept up to date while shapes and lights move.

    The rays of each side are numbered and the same in every frame, so an update ends at the solution that a fresh start
    with the same patches ends at, but for the tolerance. Light is corrected by shooting the difference between what a
    side sends and what it now should: less light than before is a negative amount (Chen 1990; George, Sillion &
    Greenberg 1990). Sides near the observer are held to the tolerance, others to more in proportion to the square of
    their distance (after Shcherbakov); what they keep back is not lost, but waits for a later frame or for `settle`.

    Parameters
    ----------
    scene : Scene
        Of diffuse surfaces only.
    device : Device
    sought : Sought, optional
        `tolerance` is that of a side's radiance against the mean radiance of the scene.
    size : (int, int)
        Of the image that the camera is for.
    cut : Cut, optional
    patches : Patches, optional
        To begin with; else found for the scene as it is, refined where it wants it.

    Attributes
    ----------
    patches : Patches
    flat : FlatScene
    started : Update
        What it took to begin.

    Raises
    ------
    SceneError, UsageError, RenderError
    """

    def __init__(
        self,
        scene: Scene,
        device: Device,
        sought: Sought | None = None,
        size: tuple[int, int] = (64, 64),
        cut: Cut | None = None,
        patches: Patches | None = None,
    ) -> None:
        self._sought = sought or Sought(tolerance=1e-3)
        check_sought(self._sought)
        self._device, self._size, self._cut = device, size, cut
        self.patches = patches or self._cut_up(scene)
        self._tracer: Tracer | None = None
        self._on_device: Buffer | None = None
        self._weights = importance(self.patches)
        self.started = self.start_again()

    @property
    def reflected(self) -> _Floats:
        """(2 n + 1, 3) float64: radiance that each side reflects."""
        wide = np.zeros((2 * len(self.patches) + 1, 3))
        wide[self._sides] = self._reflected
        return wide

    @property
    def used(self) -> NDArray[np.bool_]:
        """(2 n + 1,) bool: sides that are solved for."""
        used = np.zeros(2 * len(self.patches) + 1, bool)
        used[self._sides] = True
        return used

    def start_again(self) -> Update:
        """Forget all and solve anew, for the patches as they are now; its time leaves the driver's compiler out."""
        begin = time.perf_counter() - self._device.compile_seconds
        self._place()
        assert self._tracer is not None
        self._sealed = sealed_sides(self.patches)
        self._sides, self._hits = traced_sides(self._tracer, first_sides(self.patches), self._sealed)
        self._covered = covered_rays(self._hits, self._sealed)
        self._keep_hits()
        self._irradiance, self._seen = self._tracer.direct(self._sides, self._sought.direct_samples)
        self._reflected = np.zeros((len(self._sides), 3))
        sweeps = self._settle(None)
        seconds = time.perf_counter() - self._device.compile_seconds - begin
        return Update(self._hits.size, self._hits.size, sweeps, seconds)

    def move(self, shape: int, by: Sequence[float]) -> Update:
        """Move a shape, and bring the light up to date.

        Parameters
        ----------
        shape : int
            Its place in the scene's list.
        by : three floats
            Metres.

        Raises
        ------
        UsageError
            When there is no such shape.
        """
        begin = time.perf_counter()
        if not 0 <= shape < len(self.patches.scene.shapes):
            raise UsageError(f"there is no shape {shape}; the scene has {len(self.patches.scene.shapes)}, from 0")
        moved, before = self.patches.sides_of(shape), self.flat
        old = box_around(self.patches, moved)
        self.patches = self.patches.moved(shape, (float(by[0]), float(by[1]), float(by[2])))
        boxes = np.stack([old, box_around(self.patches, moved)])
        self._place()
        assert self._tracer is not None and self._on_device is not None
        listed, met = self._tracer.trace_again(self._sides, self._on_device, moved, boxes[1])
        self._take(listed, met)
        rays = len(listed) + self._add_sides(met)
        shines = self.patches.shadow_rays_find_emission and self.patches.scene.shapes[shape].emission is not None
        self._direct(None if shines or lights_differ(before, self.flat) else (moved, boxes))
        sweeps = self._settle(self._weights)
        return Update(rays, self._hits.size, sweeps, time.perf_counter() - begin)

    def move_light(self, light: int, by: Sequence[float]) -> Update:
        """Move a point light, and bring the light up to date.

        Parameters
        ----------
        light : int
            Its place in the scene's list of lights; shapes that shine are moved with `move`.
        by : three floats
            Metres.

        Raises
        ------
        UsageError
            When there is no such light, or it is infinitely far away.
        """
        begin, scene = time.perf_counter(), self.patches.scene
        if not 0 <= light < len(scene.lights):
            raise UsageError(f"there is no light {light}; the scene has {len(scene.lights)}, from 0")
        old = scene.lights[light]
        if not isinstance(old, PointLight):
            raise UsageError(f"light {light} is {old.type} and infinitely far away, so it cannot be moved")
        place = tuple(p + float(d) for p, d in zip(old.position, by, strict=True))
        new = PointLight(type="point", position=place, intensity=old.intensity)
        lights = (*scene.lights[:light], new, *scene.lights[light + 1 :])
        self.patches = self.patches.lit_by(scene.model_copy(update={"lights": lights}))
        self._place()
        self._direct(None)
        sweeps = self._settle(self._weights)
        return Update(0, self._hits.size, sweeps, time.perf_counter() - begin)

    def settle(self) -> int:
        """Hold every side to the tolerance, however far it is; the number of sweeps it took."""
        return self._settle(None)

    def _cut_up(self, scene: Scene) -> Patches:
        if self._sought.refine:
            return solve_scene(scene, self._device, self._sought, self._size, self._cut).patches
        return cut_into_patches(scene, self._sought.patches)

    def release(self) -> None:
        """Give the device's memory back."""
        if self._tracer is not None:
            self._tracer.release()
        if self._on_device is not None:
            self._device.release(self._on_device)
        self._tracer = self._on_device = None

    def _place(self) -> None:
        """Put the patches, where they are now, on the device."""
        if self._tracer is not None:
            self._tracer.release()
        self.flat = self.patches.flat(*self._size)
        self._tracer = Tracer(self._device, self.flat, self._sought.rays, self._sought.seed, self._cut)

    def _keep_hits(self) -> None:
        """Have what rays met on the device as well."""
        if self._on_device is not None:
            self._device.release(self._on_device)
        self._on_device = self._device.upload(self._hits)

    def _take(self, listed: NDArray[np.int64], met: NDArray[np.uint32]) -> None:
        """Put what was traced again in the place of what was."""
        flat, sealed = self._hits.reshape(-1), sealed_sides(self.patches)
        old, flat[listed] = flat[listed], met
        change = sealed[met].astype(np.float64) - sealed[old]
        self._covered += np.bincount(listed // self._sought.rays, change, len(self._sides)).astype(np.int64)
        if not np.array_equal(sealed, self._sealed):
            self._covered, self._sealed = covered_rays(self._hits, sealed), sealed

    def _add_sides(self, met: NDArray[np.uint32]) -> int:
        """Take in sides that are met now and were not before; the number of rays that took."""
        assert self._tracer is not None
        known = self.used | self._sealed
        seen = np.zeros(len(known), bool)
        seen[met] = True
        seen[first_sides(self.patches)] = True
        new = np.flatnonzero(seen[:-1] & ~known[:-1]).astype(np.uint32)
        if not len(new):
            return 0
        sides, hits = traced_sides(self._tracer, new, known)
        every = np.concatenate([self._sides, sides])
        order = np.argsort(every, kind="stable")
        self._sides = every[order]
        self._hits = np.concatenate([self._hits, hits])[order]
        self._covered = np.concatenate([self._covered, covered_rays(hits, self._sealed)])[order]
        self._keep_hits()
        self._reflected = np.concatenate([self._reflected, np.zeros((len(sides), 3))])[order]
        irradiance, bits = self._tracer.direct(sides, self._sought.direct_samples)
        self._irradiance = np.concatenate([self._irradiance, irradiance])[order]
        self._seen = np.concatenate([self._seen, bits])[order]
        return hits.size

    def _direct(self, change: tuple[tuple[int, int], NDArray[np.float32]] | None) -> None:
        """Direct light, all of it or where a moved shape may have changed it."""
        assert self._tracer is not None
        known = (self._seen, *change) if change else ()
        self._irradiance, self._seen = self._tracer.direct(self._sides, self._sought.direct_samples, *known)

    def _settle(self, weights: _Floats | None) -> int:
        """Shoot what sides send too much or too little of, until it is small; the number of sweeps."""
        share = 1.0 - self._covered / self._sought.rays
        reflectance = lifted(self.patches.reflectance[self._sides // 2], share)
        assert self._on_device is not None
        sweeper = Sweeper(self._device, self._on_device, self._sought.rays, reflectance, 2 * len(self.patches) + 1)
        everything = carried_radiance(self.patches)
        everything[self._sides] += self._reflected
        direct = reflectance * self._irradiance / math.pi
        left = direct + sweeper.reflected(everything) - self._reflected
        weight = np.ones(len(self._sides)) if weights is None else weights[self._sides]
        areas = side_areas(self.patches)[self._sides]
        sweeps, shot = 1, np.zeros_like(everything)
        while sweeps < _MOST_SWEEPS:
            mean = float((largest(self._reflected + left) * areas).sum() / areas.sum())
            chosen = largest(left) * weight > self._sought.tolerance * mean
            if not chosen.any():
                break
            shot[self._sides] = now = np.where(chosen[:, None], left, 0.0)
            self._reflected += now
            left += sweeper.reflected(shot) - now
            sweeps += 1
        sweeper.release()
        return sweeps
