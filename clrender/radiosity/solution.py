"""A scene's radiosity from beginning to end: patches, form factors, direct light, the solution, refinement."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray

from clrender.errors import UsageError
from clrender.radiosity.corners import Corners
from clrender.radiosity.factors import FormFactors, factors_of_hits
from clrender.radiosity.patches import Patches, cut_into_patches
from clrender.radiosity.solve import Balance, gather
from clrender.radiosity.tracer import MOST_DIRECT_SAMPLES, Stopped, Tracer
from clrender.scene.description import PointLight
from clrender.scene.shapes import Box, Sphere, Tetrahedron

if TYPE_CHECKING:
    from clrender.device.device import Device
    from clrender.device.worker import Cut
    from clrender.flatten import FlatScene
    from clrender.scene import Scene

__all__ = [
    "Solution",
    "Sought",
    "carried_radiance",
    "check_sought",
    "first_sides",
    "lifted",
    "open_share",
    "own_radiance",
    "sealed_sides",
    "side_areas",
    "solve_scene",
    "summary",
    "traced_sides",
]

_COARSE_SHARE: Final = 0.5
"""Of the patches wanted, before those are halved across which the radiance changes most."""
_MOST_PATCHES: Final = 1 << 20

_Floats = NDArray[np.float64]
_Uints = NDArray[np.uint32]


@dataclass(frozen=True)
class Sought:
    """What a solution is asked for.

    Attributes
    ----------
    patches : int
        How many, about.
    rays : int
        From each side of a patch that is in use.
    direct_samples : int
        Points of each side from which a light is looked at, at most 32.
    tolerance : float
        Share of the power that may be left unshot.
    seed : int
    refine : bool
        Begin with half of the patches, and halve those across which the radiance changes most.
    """

    patches: int = 8000
    rays: int = 256
    direct_samples: int = MOST_DIRECT_SAMPLES
    tolerance: float = 1e-5
    seed: int = 0
    refine: bool = True


@dataclass(frozen=True)
class Solution:
    """How bright each side of each patch is.

    Attributes
    ----------
    patches : Patches
    flat : FlatScene
        The patches as a device reads them.
    balance : Balance
    reflected : (2 n + 1, 3) float64
        Radiance that each side reflects, W/(sr m²).
    used : (2 n + 1,) bool
        Sides that were solved for; the others are seen by nothing.
    open_share : (2 n + 1,) float64
        Of each side's area; the rest is covered by something closed that stands on it.
    steps : int
    unshot : float
        Share of the power.
    seconds : dict of str to float
        What took how long.
    complete : bool
        False when it was stopped.
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

    @property
    def factors(self) -> FormFactors:
        """Form factors of the sides in use."""
        return self.balance.factors

    @property
    def sent(self) -> _Floats:
        """(2 n + 1, 3) float64: radiance of each side, its own and what it reflects; the last is the environment's."""
        return self.reflected + own_radiance(self.patches)

    @property
    def radiosity(self) -> _Floats:
        """(2 n, 3) float64, W/m²."""
        return math.pi * self.sent[:-1]


def summary(solution: Solution) -> str:
    """What was done, in a line."""
    if not solution.complete:
        return "radiosity: stopped before it was solved"
    sums = solution.factors.row_sums()
    text = (
        f"radiosity: {len(solution.patches)} patches, {len(solution.factors.sides)} sides in use, each sees "
        f"{sums.mean():.3f} of the others; solved in {sum(solution.seconds.values()):.1f} s and {solution.steps} steps"
    )
    if solution.unshot > 1e-3:
        text += f"; warning: {solution.unshot:.1%} of the light is still on its way, for surfaces absorb next to none"
    return text


def check_sought(sought: Sought) -> None:
    """Refuse what makes no sense.

    Raises
    ------
    UsageError
    """
    for name, least, most in (
        ("patches", 1, _MOST_PATCHES), ("rays", 1, 1 << 16), ("direct_samples", 1, MOST_DIRECT_SAMPLES),
    ):  # fmt: skip
        value = getattr(sought, name)
        if not least <= value <= most:
            raise UsageError(f"radiosity: {name} is {value}; it must be from {least} to {most}")


def own_radiance(patches: Patches) -> _Floats:
    """(2 n + 1, 3): what sides send out by themselves, and last what comes from outside."""
    own = np.zeros((2 * len(patches) + 1, 3))
    own[:-1:2] = patches.emission
    own[-1] = patches.environment
    return own


def carried_radiance(patches: Patches) -> _Floats:
    """The part of `own_radiance` that form factors carry; shadow rays find the rest."""
    own = own_radiance(patches)
    if patches.shadow_rays_find_emission:
        own[:-1] = 0.0
    return own


def side_areas(patches: Patches) -> _Floats:
    """(2 n + 1,) float64; outside has none."""
    return np.append(np.repeat(patches.areas, 2), 0.0)


def sealed_sides(patches: Patches) -> NDArray[np.bool_]:
    """Sides that are the dark inside of something closed: (2 n + 1,) bool.

    A sphere, box or tetrahedron is, when neither the camera nor anything that shines reaches into the box around it.
    """
    sealed = np.zeros(2 * len(patches) + 1, bool)
    scene = patches.scene
    spans = [tuple(side // 2 for side in patches.sides_of(shape)) for shape in range(len(scene.shapes))]
    boxes = [patches.corners[first:end].reshape(-1, 3) for first, end in spans]
    lows, highs = [b.min(axis=0) for b in boxes], [b.max(axis=0) for b in boxes]
    points = [light.position for light in scene.lights if isinstance(light, PointLight)]
    points.append(scene.camera.position)
    reach = scene.camera.aperture_radius
    for index, shape in enumerate(scene.shapes):
        if not isinstance(shape, Sphere | Box | Tetrahedron) or shape.flip_normals:
            continue
        low, high = lows[index], highs[index]
        open_ = any(((np.array(p) >= low - reach) & (np.array(p) <= high + reach)).all() for p in points)
        for other, source in enumerate(scene.shapes):
            if other != index and source.emission is not None:
                open_ = open_ or bool(((lows[other] <= high) & (highs[other] >= low)).all())
        if not open_:
            sealed[2 * spans[index][0] + 1 : 2 * spans[index][1] : 2] = True
    return sealed


def open_share(hits: _Uints, sealed: NDArray[np.bool_]) -> _Floats:
    """Share of each side's area that is in the open, and not inside of something closed that stands on it.

    Nothing reaches the covered part, and nobody sees it: a side's radiance is that of its part in the open.

    Parameters
    ----------
    hits : (r, rays) uint32
        A ray that meets a sealed side has set out from the covered part.
    sealed : (2 n + 1,) bool

    Returns
    -------
    (r,) float64
    """
    if not sealed.any():
        return np.ones(len(hits))
    covered = np.count_nonzero(sealed[hits], axis=1)
    return 1.0 - covered / hits.shape[1]


def lifted(reflectance: _Floats, share: _Floats) -> _Floats:
    """Reflectance that turns what arrives on the whole of a side, by mean, into what its open part reflects."""
    return np.divide(reflectance, share[:, None], out=np.zeros_like(reflectance), where=share[:, None] > 0.0)


def first_sides(patches: Patches) -> _Uints:
    """All fronts, and the backs that the camera may look at."""
    camera = patches.scene.camera
    x, y, z = (patches.centers - np.array(camera.position)).T
    normal_x, normal_y, normal_z = patches.normals.T
    used = np.zeros(2 * len(patches), bool)
    used[::2] = True
    used[1::2] = (x * normal_x + y * normal_y) + z * normal_z > -camera.aperture_radius
    return np.flatnonzero(used & ~sealed_sides(patches)[:-1]).astype(np.uint32)


def traced_sides(tracer: Tracer, sides: _Uints, known: NDArray[np.bool_]) -> tuple[_Uints, _Uints]:
    """Rays from these sides, and from every side that they see.

    Parameters
    ----------
    tracer : Tracer
    sides : (k,) uint32
        Ascending.
    known : (2 n + 1,) bool
        Sides whose rays are traced already, or need not be.

    Returns
    -------
    sides : (r,) uint32
        Ascending.
    hits : (r, rays) uint32
    """
    hits = tracer.hits(sides)
    while True:
        seen = np.zeros(tracer.outside + 1, bool)
        seen[hits] = True
        seen[sides] = False
        seen &= ~known
        new = np.flatnonzero(seen[:-1]).astype(np.uint32)
        if not len(new):
            return sides, hits
        every = np.concatenate([sides, new])
        order = np.argsort(every, kind="stable")
        sides, hits = every[order], np.concatenate([hits, tracer.hits(new)])[order]


def solve_scene(
    scene: Scene,
    device: Device,
    sought: Sought | None = None,
    size: tuple[int, int] = (64, 64),
    cut: Cut | None = None,
    light_choice: str = "auto",
    should_stop: Callable[[], bool] | None = None,
) -> Solution:
    """Find the radiosity of a scene.

    Parameters
    ----------
    scene : Scene
        Of diffuse surfaces only.
    device : Device
    sought : Sought, optional
    size : (int, int)
        Of the image that the camera is for.
    cut : Cut, optional
        Never changes the result.
    light_choice : str
    should_stop : callable, optional
        When it says yes, what is returned is not `complete`.

    Raises
    ------
    SceneError
        When a shape is not diffuse.
    UsageError, RenderError
    """
    wanted = sought or Sought()
    check_sought(wanted)
    begin = time.perf_counter()
    patches = cut_into_patches(scene, math.ceil(wanted.patches * (_COARSE_SHARE if wanted.refine else 1.0)))
    cutting = time.perf_counter() - begin
    try:
        solution = _solve(patches, device, wanted, size, cut, light_choice, should_stop)
        while wanted.refine and len(solution.patches) < wanted.patches:
            begin = time.perf_counter()
            finer = _refined(solution, wanted.patches)
            cutting += time.perf_counter() - begin
            if len(finer) == len(solution.patches):
                break
            before, solution = solution, _solve(finer, device, wanted, size, cut, light_choice, should_stop)
            for name, seconds in before.seconds.items():
                solution.seconds[name] += seconds
    except Stopped:
        return _nothing(patches, size, light_choice)
    solution.seconds["patches"] = cutting
    return solution


def _solve(
    patches: Patches,
    device: Device,
    wanted: Sought,
    size: tuple[int, int],
    cut: Cut | None,
    light_choice: str,
    should_stop: Callable[[], bool] | None,
) -> Solution:
    times = [time.perf_counter()]
    flat = patches.flat(*size, light_choice)
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
    share = open_share(hits, sealed)
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
    return Solution(patches, flat, balance, balance.spread(done.reflected), used, open_, done.steps, left, seconds)


def _refined(solution: Solution, count: int) -> Patches:
    """Patches across which the brightness changes most, halved; at most `count` in all."""
    patches = solution.patches
    corners = Corners(patches)
    contrast = np.zeros(len(patches))
    for back in (0, 1):
        side = slice(back, 2 * len(patches), 2)
        contrast = np.maximum(contrast, corners.contrast(solution.reflected[side], solution.used[side]))
    most = min(count - len(patches), len(patches) // 2)
    which = np.zeros(len(patches), bool)
    best = np.argsort(-contrast, kind="stable")[:most]
    which[best[contrast[best] > 0.0]] = True
    return patches.bisected(which)


def _nothing(patches: Patches, size: tuple[int, int], light_choice: str) -> Solution:
    """In place of a solution that nobody waited for."""
    columns = 2 * len(patches) + 1
    factors = factors_of_hits(np.zeros(0, np.uint32), np.zeros((0, 1), np.uint32), columns)
    empty = np.zeros((0, 3))
    balance = Balance(factors, empty, empty, carried_radiance(patches), side_areas(patches))
    flat = patches.flat(*size, light_choice)
    none, nowhere = np.zeros(columns, bool), np.zeros(columns)
    return Solution(patches, flat, balance, np.zeros((columns, 3)), none, nowhere, 0, 1.0, {}, False)
