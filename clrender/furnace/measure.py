"""Measures the materials of a scene, for the report."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from contextlib import ExitStack
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from clrender.device.launch import LaunchConfig
from clrender.flatten.plugin_rows import used_plugins
from clrender.furnace.bits import same_bits
from clrender.furnace.directions import Floats
from clrender.furnace.energy import ANGLES, Energy, Tally, measure_energy
from clrender.furnace.reciprocity import Reciprocity, measure_reciprocity
from clrender.furnace.sampling import TEST_ANGLES, SamplingTest, measure_sampling
from clrender.furnace.subjects import Subject, whitened
from clrender.furnace.surfaces import Surfaces, Uv
from clrender.scene.materials import PluginMaterial

if TYPE_CHECKING:
    from clrender.device import Device

__all__ = ["LOBE_ANGLES", "Lobe", "Measured", "RoughnessRow", "measure", "place_title"]

LOBE_ANGLES: Final = (0.0, 30.0, 60.0, 80.0)
_LOBE_STEPS: Final = 1440


@dataclass(frozen=True)
class Lobe:
    """Scattering of one angle of incidence, in the plane of incidence.

    Attributes
    ----------
    incident : float
        Degrees from the normal.
    angles : (n,) float64, degrees from the normal, towards the direction of specular reflection
    values : (n, 3) float64, f |cosθ| by colour, 1/sr, without deltas
    """

    incident: float
    angles: Floats
    values: Floats


@dataclass(frozen=True)
class RoughnessRow:
    """A material with one roughness: in its colour, and in white."""

    roughness: float
    energy: Energy
    white: Energy


@dataclass(frozen=True)
class Measured:
    """Measurements of a material.

    Attributes
    ----------
    name, kind : str
        Name of the material, and of its type.
    keys : dict
        The material's table in a scene file, JSON-able.
    energies, white : tuple of Energy
        Energies of the front, and of the back if light is transmitted; as it is, and without its colour.
    tests : tuple of SamplingTest
    reciprocity : Reciprocity
    tally : Tally
    rows : tuple of RoughnessRow
    lobes : tuple of Lobe
    uv : (float, float), optional
        Texture coordinates of the measured point; None: the furnace's default.
    claims : frozenset of str
        See `clrender.furnace.subjects.Subject.claims`.
    same_with_one_lane : bool or None
        Whether a plugin gives the same bits with one lane as with several; None: not known, or no plugin.
    """

    name: str
    kind: str
    keys: dict[str, Any]
    energies: tuple[Energy, ...]
    white: tuple[Energy, ...]
    tests: tuple[SamplingTest, ...]
    reciprocity: Reciprocity
    tally: Tally
    rows: tuple[RoughnessRow, ...]
    lobes: tuple[Lobe, ...]
    uv: Uv | None = None
    claims: frozenset[str] = frozenset(("reciprocal", "lossless"))
    same_with_one_lane: bool | None = None

    @property
    def title(self) -> str:
        """The name, and the texture coordinates, if given."""
        return place_title(self.name, self.uv)

    @property
    def transmits(self) -> bool:
        """Whether light is transmitted."""
        return self.energies[0].transmits

    @property
    def only_deltas(self) -> bool:
        """Whether all light is in delta distributions, which only sampling finds."""
        return all(not each.smooth.any() for each in self.energies)


def measure(
    subject: Subject,
    device: Device,
    *,
    seed: int = 0,
    side: int = 64,
    step: Callable[[str], None] | None = None,
    faults: Mapping[str, str] | None = None,
) -> list[Measured]:
    """Measure materials.

    Parameters
    ----------
    subject : Subject
    device : Device
    seed : int
        Seed of the random numbers; the measurements of a material depend only on it and the material.
    side : int
        Each of 16 estimates of an energy takes side² samples.
    step : callable, optional
        Called with a title before each measurement; an exception from it ends the work.
    faults : mapping, optional
        See `clrender.furnace.surfaces.Surfaces`.

    Returns
    -------
    list of Measured

    Raises
    ------
    SceneError
        If a material names a file that cannot be read.
    RenderError, DeviceError
        If the driver fails.
    """
    with ExitStack() as owned:
        given = Surfaces(device, subject.scene, faults=faults, uvs=subject.uvs)
        owned.callback(given.release)
        white = Surfaces(device, whitened(subject.scene), faults=faults, uvs=subject.uvs)
        owned.callback(white.release)
        single = None
        if given.lanes > 1 and used_plugins(subject.scene):
            single = Surfaces(device, subject.scene, LaunchConfig(lanes=1), faults, subject.uvs)
            owned.callback(single.release)
        tell = step or (lambda name: None)
        found = []
        for name, uv in subject.places:
            at = given.at(uv)
            made = _measured(subject, name, uv, at, white.at(uv), seed, side, partial(tell, place_title(name, uv)))
            if single is not None and subject.has_plugin(name):
                rng = np.random.default_rng([seed, 1, *name.encode()])
                same = same_bits(at, single.at(uv), name, rng, made.transmits)
                made = replace(made, same_with_one_lane=same)
            found.append(made)
        return found


def place_title(name: str, uv: Uv | None) -> str:
    """Title of a material and its texture coordinates."""
    return name if uv is None else f"{name} at {uv[0]}, {uv[1]}"


def _measured(
    subject: Subject, name: str, uv: Uv | None, given: Surfaces, white: Surfaces, seed: int, side: int,
    tell: Callable[[], None],
) -> Measured:  # fmt: skip
    material: Any = subject.scene.materials[name]
    eta, tally = subject.eta(name), Tally()
    rng = np.random.default_rng([seed, *name.encode()])
    front = _energy(given, name, eta, rng, tally, side, tell)
    sides = (False, True) if front.transmits else (False,)
    energies = (front, *(_energy(given, name, eta, rng, tally, side, tell, below=True) for _ in sides[1:]))
    plain = tuple(_energy(white, name, eta, rng, Tally(), side, tell, below=below, evaluate=False) for below in sides)
    tests = []
    for below in sides:
        for angle in TEST_ANGLES:
            tell()
            tests.append(measure_sampling(given, name, eta, angle, rng, tally, below=below, count=side * side * 32))
    tell()
    reciprocity = measure_reciprocity(given, name, eta, rng, front.transmits)
    rows = []
    for value, other in subject.swept.get(name, ()):
        both = [_energy(which, other, eta, rng, tally, side // 2, tell, evaluate=False) for which in (given, white)]
        rows.append(RoughnessRow(value, both[0], both[1]))
    lobes = tuple(_lobe(given, name, angle, front.transmits) for angle in LOBE_ANGLES)
    keys = material.model_dump(mode="json", exclude_defaults=True)
    found = (keys, energies, plain, tuple(tests), reciprocity, tally, tuple(rows), lobes)
    return Measured(name, _kind(material), *found, uv, subject.claims(name))


def _kind(material: Any) -> str:
    return material.plugin if isinstance(material, PluginMaterial) else str(material.type)


def _energy(
    surfaces: Surfaces, name: str, eta: float, rng: np.random.Generator, tally: Tally, side: int,
    tell: Callable[[], None], *, below: bool = False, evaluate: bool = True,
) -> Energy:  # fmt: skip
    """Energy of one side; calls `tell` first."""
    tell()
    return measure_energy(surfaces, name, eta, rng, tally, below=below, angles=ANGLES, side=side, evaluate=evaluate)


def _lobe(surfaces: Surfaces, name: str, incident: float, transmits: bool) -> Lobe:
    tilt = math.radians(incident)
    wo = np.array([-math.sin(tilt), 0.0, math.cos(tilt)])
    reach = 180.0 if transmits else 90.0
    angles = (np.arange(_LOBE_STEPS) + 0.5) / _LOBE_STEPS * 2.0 * reach - reach
    wi = np.stack([np.sin(np.radians(angles)), np.zeros(_LOBE_STEPS), np.cos(np.radians(angles))], axis=1)
    values, _ = surfaces.evaluate(name, wo, wi)
    return Lobe(incident, angles, np.where(np.isfinite(values), values, 0.0))
