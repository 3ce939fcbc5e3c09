"""A scene's radiosity: patches, form factors, direct light, solution, refinement."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray

from clrender.errors import UsageError
from clrender.radiosity.corners import Corners
from clrender.radiosity.factors import FormFactors, factors_of_hits
from clrender.radiosity.patches import Patches, cut_into_patches
from clrender.radiosity.sides import (
    carried_radiance,
    covered_rays,
    first_sides,
    lifted,
    own_radiance,
    sealed_sides,
    side_areas,
    traced_sides,
)
from clrender.radiosity.solve import Balance, gather
from clrender.radiosity.tracer import MOST_DIRECT_SAMPLES, Stopped, Tracer
from clrender.wording import counted

if TYPE_CHECKING:
    from clrender.device.device import Device
    from clrender.device.launch import LaunchConfig
    from clrender.flatten.flat_scene import FlatScene
    from clrender.scene import Scene

__all__ = ["RadiositySettings", "Solution", "check_settings", "solve_scene", "summary"]

_COARSE_SHARE: Final = 0.5
"""Fraction of the desired patches to begin with, before those with the largest contrast are subdivided."""
_MOST_PATCHES: Final = 1 << 20
_PILOT_RAYS: Final = 64
_PILOT_ROUNDS: Final = 4
"""Rounds of subdivision for a final gather, each decided by a solution with few rays."""

_Floats = NDArray[np.float64]


@dataclass(frozen=True)
class RadiositySettings:
    """Settings of a solution.

    Attributes
    ----------
    patches : int
        Approximate number of patches.
    rays : int
        Rays from each side in use.
    direct_samples : int
        Shadow rays from each side, at most 32.
    tolerance : float
        Fraction of the power that may remain unshot.
    seed : int
    refine : bool
        Begin with half of the patches, and bisect those with the largest contrast.
    gathered : bool
        For a final gather, which samples direct light itself: refine by indirect radiance.
    """

    patches: int = 8000
    rays: int = 256
    direct_samples: int = MOST_DIRECT_SAMPLES
    tolerance: float = 1e-5
    seed: int = 0
    refine: bool = True
    gathered: bool = False


@dataclass(frozen=True)
class Solution:
    """The radiosity of each side of each patch.

    Attributes
    ----------
    patches : Patches
    flat : FlatScene
        The patches as a device reads them.
    balance : Balance
    reflected : (2 n + 1, 3) float64
        Radiance that each side reflects, W/(sr m²).
    used : (2 n + 1,) bool
        Sides in the solution; the others are not visible.
    open_share : (2 n + 1,) float64
        Uncovered fraction of each side's area; the rest is covered by closed shapes standing on it.
    steps : int
    unshot : float
        Fraction of the power.
    seconds : dict of str to float
        By step.
    complete : bool
        False if it was stopped early.
    direct_light, indirect_light : (2 n + 1, 3) float64, or None
        Radiance that each side would reflect if it were white: of light from shadow rays, and of all other light. None
        if no patch is textured.
    """

    patches: Patches
    flat: FlatScene
    balance: Balance
    reflected: _Floats
    used: NDArray[np.bool_]
    open_share: _Floats
    steps: int
    unshot: float
    seconds: dict[str, float]
    complete: bool = True
    direct_light: _Floats | None = None
    indirect_light: _Floats | None = None

    @property
    def factors(self) -> FormFactors:
        """Form factors of the sides in use."""
        return self.balance.factors

    @property
    def sent(self) -> _Floats:
        """(2 n + 1, 3) float64: emitted and reflected radiance of each side; the last is the environment's."""
        return self.reflected + own_radiance(self.patches)

    @property
    def indirect(self) -> _Floats:
        """(2 n + 1, 3) float64: `reflected` without direct light from shadow rays."""
        return self.reflected - self.balance.spread(self.balance.direct)

    @property
    def shown(self) -> _Floats:
        """(2 n + 1, 3) float64: `reflected`, but for textured sides as if they were white."""
        if self.direct_light is None or self.indirect_light is None:
            return self.reflected
        return np.where(self.patches.textured_sides[:, None], self.direct_light + self.indirect_light, self.reflected)

    @property
    def shown_indirect(self) -> _Floats:
        """(2 n + 1, 3) float64: `indirect`, but for textured sides as if they were white."""
        if self.indirect_light is None:
            return self.indirect
        return np.where(self.patches.textured_sides[:, None], self.indirect_light, self.indirect)

    @property
    def radiosity(self) -> _Floats:
        """(2 n, 3) float64, W/m²."""
        return math.pi * self.sent[:-1]


def summary(solution: Solution) -> str:
    """A summary of the solution in one line."""
    if not solution.complete:
        return "radiosity: stopped before it was solved"
    sums = solution.factors.row_sums()
    text = (
        f"radiosity: {counted(len(solution.patches), 'patch', 'patches')}, "
        f"{counted(len(solution.factors.sides), 'side')} in use, mean form factor "
        f"to all others {sums.mean():.3f}; solved in {sum(solution.seconds.values()):.1f} s and "
        f"{counted(solution.steps, 'step')}"
    )
    if solution.unshot > 1e-3:
        text += f"; warning: not converged, {solution.unshot:.1%} of the light is unshot, as surfaces absorb hardly any"
    return text


def check_settings(settings: RadiositySettings) -> None:
    """Validate the settings.

    Raises
    ------
    UsageError
    """
    for name, least, most in (
        ("patches", 1, _MOST_PATCHES), ("rays", 1, 1 << 16), ("direct_samples", 1, MOST_DIRECT_SAMPLES),
    ):  # fmt: skip
        value = getattr(settings, name)
        if not least <= value <= most:
            raise UsageError(f"radiosity: {name} is {value}; it must be from {least} to {most}")


def solve_scene(
    scene: Scene,
    device: Device,
    settings: RadiositySettings | None = None,
    size: tuple[int, int] = (64, 64),
    cut: LaunchConfig | None = None,
    light_sampler: str = "auto",
    should_stop: Callable[[], bool] | None = None,
    patches: Patches | None = None,
) -> Solution:
    """Solve for the radiosity of a scene.

    Parameters
    ----------
    scene : Scene
        Must have only diffuse surfaces.
    device : Device
    settings : RadiositySettings, optional
    size : (int, int)
        Size of the camera's image, pixels.
    cut : LaunchConfig, optional
        Does not affect the result.
    light_sampler : str
    should_stop : callable, optional
        If it returns True, the solution is not `complete`.
    patches : Patches, optional
        Initial patches, such as those of another solution; default: made from the scene.

    Raises
    ------
    SceneError
        If a shape is not diffuse.
    UsageError, RenderError
    """
    wanted = settings or RadiositySettings()
    check_settings(wanted)
    begin = time.perf_counter()
    if patches is None:
        patches = cut_into_patches(scene, math.ceil(wanted.patches * (_COARSE_SHARE if wanted.refine else 1.0)))
    cutting = time.perf_counter() - begin
    pilots: list[Solution] = []
    try:
        if wanted.refine and wanted.gathered:
            pilot = replace(wanted, rays=min(wanted.rays, _PILOT_RAYS))
            for left in range(_PILOT_ROUNDS, 0, -1):
                pilots.append(_solve(patches, device, pilot, size, cut, light_sampler, should_stop))
                begin = time.perf_counter()
                patches = _refined(pilots[-1], len(patches) + (wanted.patches - len(patches)) // left, gathered=True)
                cutting += time.perf_counter() - begin
        solution = _solve(patches, device, wanted, size, cut, light_sampler, should_stop)
        while wanted.refine and not wanted.gathered and len(solution.patches) < wanted.patches:
            begin = time.perf_counter()
            finer = _refined(solution, wanted.patches)
            cutting += time.perf_counter() - begin
            if len(finer) == len(solution.patches):
                break
            pilots.append(solution)
            solution = _solve(finer, device, wanted, size, cut, light_sampler, should_stop)
    except Stopped:
        return _nothing(patches, size, light_sampler)
    for before in pilots:
        for name, seconds in before.seconds.items():
            solution.seconds[name] += seconds
    solution.seconds["patches"] = cutting
    return solution


def _solve(
    patches: Patches,
    device: Device,
    wanted: RadiositySettings,
    size: tuple[int, int],
    cut: LaunchConfig | None,
    light_sampler: str,
    should_stop: Callable[[], bool] | None,
) -> Solution:
    times = [time.perf_counter()]
    flat = patches.flat(*size, light_sampler)
    tracer = Tracer(device, flat, wanted.rays, wanted.seed, cut, should_stop)
    times.append(time.perf_counter())
    try:
        sealed = sealed_sides(patches)
        sides, hits = traced_sides(tracer, first_sides(patches), sealed)
        times.append(time.perf_counter())
        irradiance, _ = tracer.direct(sides, wanted.direct_samples)
    finally:
        tracer.release()
    times.append(time.perf_counter())
    factors = factors_of_hits(sides, hits, 2 * len(patches) + 1)
    share = 1.0 - covered_rays(hits, sealed) / wanted.rays
    reflectance = lifted(patches.reflectance[sides // 2], share)
    direct = reflectance * irradiance / math.pi
    balance = Balance(factors, reflectance, direct, carried_radiance(patches), side_areas(patches))
    times.append(time.perf_counter())
    done = gather(balance, wanted.tolerance)
    times.append(time.perf_counter())
    used = np.zeros(factors.columns, bool)
    used[sides] = True
    left = balance.power(done.unshot) / max(balance.power(done.reflected), 1e-300)
    names = ("upload", "form_factors", "direct", "matrix", "solve")
    seconds = {name: end - start for name, start, end in zip(names, times[:-1], times[1:], strict=True)}
    open_ = np.zeros(factors.columns)
    open_[sides] = share
    reflected = balance.spread(done.reflected)
    solution = Solution(patches, flat, balance, reflected, used, open_, done.steps, left, seconds)
    if not patches.textured.any():
        return solution
    white = lifted(np.ones_like(reflectance), share)
    straight, other = white * irradiance / math.pi, white * factors.gathered(balance.sent + reflected)
    return replace(solution, direct_light=balance.spread(straight), indirect_light=balance.spread(other))


def _refined(solution: Solution, count: int, gathered: bool = False) -> Patches:
    """Subdivide the patches with the largest contrast; at most `count` patches in all.

    For a final gather the contrast is that of indirect light, and large patches come first, as their edges are not
    visible.
    """
    patches = solution.patches
    shown = solution.shown_indirect if gathered else solution.shown
    if patches.textured.any():
        # Use the shape's mean colour: the visible texture does not depend on the patch size
        weights = np.bincount(patches.shape, patches.areas)
        means = np.stack(
            [np.bincount(patches.shape, patches.areas * c) / weights for c in patches.reflectance.T], axis=1
        )
        color = np.append(np.repeat(means[patches.shape], 2, axis=0), [[1.0, 1.0, 1.0]], axis=0)
        shown = np.where(patches.textured_sides[:, None], shown * color, shown)
    corners = Corners(patches)
    sides = [slice(back, 2 * len(patches), 2) for back in (0, 1)]
    contrast = np.maximum(*(corners.contrast(shown[side], solution.used[side]) for side in sides))
    if gathered:
        contrast = contrast * np.sqrt(patches.areas)
    most = min(max(count - len(patches), 0), len(patches) // 2)
    which = np.zeros(len(patches), bool)
    best = np.argsort(-contrast, kind="stable")[:most]
    which[best[contrast[best] > 0.0]] = True
    return patches.bisected(which)


def _nothing(patches: Patches, size: tuple[int, int], light_sampler: str) -> Solution:
    """An empty solution, after an interruption."""
    columns = 2 * len(patches) + 1
    factors = factors_of_hits(np.zeros(0, np.uint32), np.zeros((0, 1), np.uint32), columns)
    empty = np.zeros((0, 3))
    balance = Balance(factors, empty, empty, carried_radiance(patches), side_areas(patches))
    flat = patches.flat(*size, light_sampler)
    none, nowhere = np.zeros(columns, bool), np.zeros(columns)
    return Solution(patches, flat, balance, np.zeros((columns, 3)), none, nowhere, 0, 1.0, {}, False)
