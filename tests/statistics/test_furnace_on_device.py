"""`clrender furnace` with the kernels: right materials have no faults, made-up faults are found and named."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
import scipy.stats
from render_support import scene

from clrender.device.launch import LaunchConfig
from clrender.furnace import Subject, as_json, findings, measure
from clrender.furnace.directions import incident, jittered
from clrender.furnace.energy import Tally, measure_energy
from clrender.furnace.findings import ALARM
from clrender.furnace.reciprocity import measure_reciprocity
from clrender.furnace.sampling import measure_sampling
from clrender.furnace.surfaces import Surfaces

if TYPE_CHECKING:
    from clrender.device import Device

GLASS = {"type": "dielectric", "ior": 1.5}
CLAY = {"type": "lambert", "reflectance": [0.8, 0.5, 0.3]}
GOLD = {"type": "conductor", "metal": "Au", "roughness": 0.4}


def subject(**materials: dict[str, Any]) -> Subject:
    what = scene((), (), None, **materials)
    return Subject("test", what, tuple(what.materials), {})


@pytest.mark.long
def test_right_materials_have_no_faults(device: Device) -> None:
    """False alarms: 1 %, by a fixed seed."""
    clay, gold, glass = measure(subject(clay=CLAY, gold=GOLD, glass=GLASS), device, side=16)
    for each in (clay, gold, glass):
        assert [found.sentence for found in findings(each, 3) if found.fault] == []
    np.testing.assert_allclose(clay.energies[0].sampled, np.tile([0.8, 0.5, 0.3], (11, 1)), rtol=1e-5)
    assert clay.reciprocity.largest < 1e-6 and clay.reciprocity.compared > 5000
    assert not clay.transmits and not clay.only_deltas

    # Glass: Fresnel's equations, straight on and beyond total internal reflection
    assert glass.only_deltas and glass.transmits and len(glass.energies) == 2
    front, back = glass.energies
    assert float(front.through[0, 0]) == pytest.approx(0.96, abs=5e-3)
    assert float(back.through[0, 0]) == pytest.approx(0.96, abs=5e-3)
    assert not back.through[3:].any() and front.through.all()
    np.testing.assert_allclose([front.sampled, back.sampled], 1.0, atol=1e-6)
    numbers = as_json(glass, findings(glass))
    assert (numbers["chi2_tests"], numbers["chi2_p_min"], numbers["reciprocity_max"]) == (0, 1.0, 0.0)


@pytest.mark.long
@pytest.mark.parametrize(
    ("fault", "kinds"),
    [
        ("FURNACE_WEIGHT=1.05f", {"gain", "estimators", "weight"}),
        pytest.param("FURNACE_WEIGHT=0.95f", {"loss", "estimators", "weight"}, marks=pytest.mark.slow),
        ("FURNACE_PDF=1.05f", {"directions", "integral", "weight"}),
        pytest.param("FURNACE_PDF=0.95f", {"directions", "weight"}, marks=pytest.mark.slow),
        pytest.param("FURNACE_VALUE=1.05f", {"estimators", "weight"}, marks=pytest.mark.slow),
    ],
)
def test_a_fault_of_5_percent_is_found_and_named(device: Device, fault: str, kinds: set[str]) -> None:
    white = {"type": "oren_nayar", "reflectance": [1.0, 1.0, 1.0], "roughness": 0.5}
    name, value = fault.split("=")
    (measured,) = measure(subject(white=white), device, side=32, faults={name: value})
    found = {each.kind: each.amount for each in findings(measured) if each.fault}
    assert set(found) == kinds
    off = float(value.rstrip("f")) - 1.0
    for kind in {"gain", "loss", "estimators"} & kinds:
        assert abs(found[kind]) == pytest.approx(0.05, abs=1e-2)
    assert found["weight"] == pytest.approx((off if name != "FURNACE_VALUE" else 1.0 / 1.05 - 1.0), abs=1e-3)
    sentence = next(each.sentence for each in findings(measured) if each.kind in kinds)
    assert "°" in sentence or "%" in sentence


@pytest.mark.slow
def test_lanes_and_order_change_nothing(device: Device) -> None:
    what, rng = subject(gold=GOLD, clay=CLAY).scene, np.random.default_rng(650)
    numbers = jittered(rng, 1, 16).reshape(2, -1)
    results = []
    for lanes in (1, 16):
        surfaces = Surfaces(device, what, LaunchConfig(lanes=lanes))
        samples = surfaces.sample("gold", incident(70.0), numbers)
        again = surfaces.evaluate("gold", incident(70.0), samples.directions[::-1])
        surfaces.release()
        np.testing.assert_array_equal(again[1][::-1], samples.density)
        results.append(samples)
    for name in ("directions", "weights", "pdf", "values", "density"):
        np.testing.assert_array_equal(getattr(results[0], name), getattr(results[1], name))


def test_places_have_the_colours_that_the_texture_has_there(device: Device) -> None:
    """A ramp along u, and one along v; without a place as before: u = 0.58, v = 0.31."""
    ramps = {
        "u": {"type": "lambert", "reflectance": {"ramp": [0.0, 1.0]}},
        "v": {"type": "lambert", "reflectance": {"ramp": [0.0, 1.0], "transform": {"rotate_degrees": -90.0}}},
    }
    uvs = [(0.25, 0.875), (1.0, 0.0), (0.1, 0.1), (0.5, -3.0)]
    surfaces = Surfaces(device, subject(**ramps).scene, uvs=uvs)
    up = np.array([[0.0, 0.0, 1.0]])
    for uv in (None, *uvs):
        for name, share in zip("uv", uv or (0.58, 0.31), strict=True):
            values, _ = surfaces.at(uv).evaluate(name, up[0], up)
            np.testing.assert_allclose(values * math.pi, np.clip(share, 0.0, 1.0), atol=3e-7)
    surfaces.release()


@pytest.mark.long
def test_mixtures_are_the_mean_of_their_parts(device: Device) -> None:
    """At a point one of them is met; measured is what many points show. Evaluated by shares found to 2^-16."""
    inner = {"type": "mix", "materials": ["clay", "glass"], "weight": 0.25}
    outer = {"type": "mix", "materials": ["gold", "inner"], "weight": 0.4}
    surfaces = Surfaces(device, subject(clay=CLAY, gold=GOLD, glass=GLASS, inner=inner, outer=outer).scene)
    shares = {"gold": 0.6, "clay": 0.3, "glass": 0.1}
    found = sorted(share for share, _ in surfaces.parts("outer"))
    np.testing.assert_allclose(found, sorted(shares.values()), atol=2.0**-16)
    assert surfaces.parts("gold") == [(1.0, 0.5)]

    wo, rng = incident(40.0), np.random.default_rng(660)
    numbers = jittered(rng, 1, 64).reshape(2, -1)
    samples = surfaces.sample("outer", wo, numbers)
    several = {name: surfaces.evaluate(name, wo, samples.directions) for name in shares}
    for which in (0, 1):
        expected = sum(share * several[name][which] for name, share in shares.items())
        np.testing.assert_allclose(surfaces.evaluate("outer", wo, samples.directions)[which], expected, atol=1e-4)
    # Samples go through the parts evenly, so that each has its share of them but for a few
    assert samples.delta.mean() == pytest.approx(0.1, abs=8 / 4096)
    surfaces.release()


@pytest.mark.long
def test_a_mixture_has_no_faults(device: Device) -> None:
    """One point alone would be no mixture, and which one is met would hang on rounding: it would not be reciprocal."""
    mixed = {"type": "mix", "materials": ["clay", "gold"], "weight": 0.4}
    clay, gold, both = measure(subject(clay=CLAY, gold=GOLD, both=mixed), device, side=16)
    assert [found.sentence for found in findings(both, 3) if found.fault] == []
    assert both.reciprocity.largest < 1e-6 and both.reciprocity.compared > 5000
    expected = 0.6 * clay.energies[0].sampled + 0.4 * gold.energies[0].sampled
    error = np.hypot(both.energies[0].sampled_error, 0.4 * gold.energies[0].sampled_error)
    np.testing.assert_array_less(np.abs(both.energies[0].sampled - expected), 5.0 * error + 1e-4)
    absorbs = next(found for found in findings(both, 3) if found.kind == "absorbs")
    assert absorbs.amount > 0.3


@pytest.mark.slow
def test_every_roughness_keeps_all_light(device: Device) -> None:
    """Of white conductors and white rough diffuse surfaces, from alpha 0.001 to 1; false alarms: 1 %."""
    white_metal = {"type": "conductor", "eta": [1e-3] * 3, "k": [1000.0] * 3}
    alphas = [0.0012, 0.003, 0.01, 0.03, 0.1, 0.25, 0.5, 0.75, 1.0]
    metals = {f"metal {a}": {**white_metal, "roughness": math.sqrt(a)} for a in alphas}
    chalks = {
        f"chalk {r}": {"type": "oren_nayar", "reflectance": [1.0] * 3, "roughness": r} for r in (0.0, 0.3, 0.7, 1.0)
    }
    measured = measure(subject(**metals, **chalks), device)
    for each in measured:
        assert [found.sentence for found in findings(each, len(measured)) if found.fault] == [], each.name


@pytest.mark.slow
def test_false_alarms_are_as_rare_as_stated(device: Device) -> None:
    """200 seeds: no more alarms than `ALARM` allows, and p-values that are uniform; each checked at 1e-3."""
    what = subject(gold=GOLD, clay={**CLAY, "type": "oren_nayar", "roughness": 0.7})
    surfaces = Surfaces(device, what.scene)
    alarms, p = 0, []
    for seed in range(200):
        for name in what.names:
            measured = measure_lightly(surfaces, name, seed)
            alarms += any(each.fault for each in findings(measured))
            p += [each.fit.p for each in measured.tests]
    surfaces.release()
    uniform = float(scipy.stats.kstest(p, "uniform").pvalue)
    print(f"{alarms} alarms of 400; smallest p of {len(p)}: {min(p):.2g}; Kolmogorov: {uniform:.2g}")
    assert scipy.stats.binom.sf(alarms - 1, 400, ALARM) > 1e-3, f"{alarms} alarms of 400"
    assert uniform > 1e-3


def measure_lightly(surfaces: Surfaces, name: str, seed: int) -> Any:
    """As `measure`, with a quarter of the samples at a few angles."""
    from clrender.furnace import Measured

    rng, tally = np.random.default_rng([670, seed]), Tally()
    energy = measure_energy(surfaces, name, 1.0, rng, tally, angles=(0.0, 60.0, 80.0, 88.0), side=16)
    tests = tuple(measure_sampling(surfaces, name, 1.0, angle, rng, tally, count=1 << 15) for angle in (0.0, 60.0))
    reciprocity = measure_reciprocity(surfaces, name, 1.0, rng, False, 8)
    # Losses are those of the colour: gains of the material itself, and what white loses, are tested above
    white = (energy_in_white(energy),)
    return Measured(name, "", {}, (energy,), white, tests, reciprocity, tally, (), ())


def energy_in_white(energy: Any) -> Any:
    import dataclasses

    return dataclasses.replace(energy, sampled=np.ones_like(energy.sampled))
