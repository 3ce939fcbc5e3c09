"""The physics of plugins: `clrender furnace` tells right ones from faulty ones; strategies and integrators agree."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from plugin_files import EVEN, EXAMPLES, GRAIN, LED, MINNAERT, PAPER, SEARCHLIGHT, SHIRLEY, edited

import clrender
from clrender.agreement import compare_integrators
from clrender.agreement.verdict import AGREE
from clrender.furnace import Measured, as_json, findings, light_findings, measure, measure_light, subjects_of
from clrender.plugins import plugin
from clrender.scene import Scene

if TYPE_CHECKING:
    from clrender.device import Device


def measured(device: Device, subject: str, *plugins: str, side: int = 16) -> list[Measured]:
    return measure(subjects_of(subject, plugins=plugins), device, side=side)


def faults(made: Measured, count: int = 1) -> dict[str, str]:
    return {each.kind: each.sentence for each in findings(made, count) if each.fault}


def kinds(made: Measured) -> set[str]:
    return {each.kind for each in findings(made)}


@pytest.mark.long
@pytest.mark.parametrize("name", ["minnaert", "ashikhmin_shirley"])
def test_the_examples_have_no_faults(device: Device, name: str) -> None:
    """With their defaults, and with the bounds of each of their numbers. False alarms: 1 %, by a fixed seed."""
    made = measured(device, name, str(EXAMPLES / f"{name}.cl"))
    assert len(made) == (3 if name == "minnaert" else 5)
    assert [faults(each, len(made)) for each in made] == [{}] * len(made)
    assert all(each.reciprocity.compared > 5000 and not each.only_deltas for each in made)
    if device.info.type == "cpu":
        assert {each.same_with_one_lane for each in made} == {True}
    assert {"loses", "reciprocal", "sampled"} <= kinds(made[0])
    if name == "minnaert":
        angles = np.radians(made[0].energies[0].angles)
        np.testing.assert_allclose(made[0].energies[0].sampled[:, 0], 0.5 * np.cos(angles) ** 0.3, rtol=2e-5)
        assert "keeps" in kinds(made[1]), "with k = 1 it is Lambertian"


@pytest.mark.long
def test_a_sheet_is_measured_on_both_sides(device: Device) -> None:
    (made, *_) = measured(device, "paper", PAPER)
    assert made.transmits and len(made.energies) == 2 and faults(made) == {}
    np.testing.assert_allclose(made.energies[0].through, 0.4, atol=2e-2)
    assert {"keeps", "transmits", "reciprocal"} <= kinds(made)


@pytest.mark.long
def test_a_texture_is_measured_as_a_colour(device: Device) -> None:
    (made,) = measured(device, "grain", GRAIN)
    assert faults(made) == {} and as_json(made, findings(made))["type"] == "lambert"
    at = (3.0 * 0.58 + 0.31) % 1.0
    np.testing.assert_allclose(
        made.energies[0].sampled[0], np.array([0.3, 0.4, 0.5]) + at * np.array([0.5, 0.3, 0.1]), rtol=1e-3
    )


@pytest.mark.long
@pytest.mark.parametrize(
    ("changes", "found"),
    [
        ([("(0.5f * INV_PI) * limb", "(0.5f * INV_PI) * limb * 2.5f")], "gain"),
        ([("INV_PI) * power(wi.z, p->k)", "INV_PI) * power(wi.z, p->k) * 1.05f")], "integral"),
        ([("p->k + 1.0f)), r", "p->k + 1.2f)), r")], "directions"),
        ([("power(wo.z * wi.z, p->k - 1.0f)", "power(wo.z, p->k - 1.0f)")], "reciprocity"),
        ([("(0.5f * INV_PI) * limb", "(0.5f * INV_PI) * (limb - 0.9f)")], "negative"),
        ([('["reciprocal"]', '["reciprocal", "lossless"]')], "loss"),
        ([("(0.5f * INV_PI) * limb", "(0.5f * INV_PI) * limb * vfloat_of((wo.z > 0.0f) + 2)")], "lanes"),
    ],
)
def test_faulty_plugins_are_found_and_named(device: Device, changes: list[tuple[str, str]], found: str) -> None:
    if found == "lanes" and device.info.type != "cpu":
        pytest.skip("a GPU has one lane")
    made = measured(device, "minnaert", edited(MINNAERT, *changes))
    assert any(found in faults(each, len(made)) for each in made), [faults(each) for each in made]


@pytest.mark.long
def test_what_is_not_claimed_is_no_fault(device: Device) -> None:
    one_way = ("power(wo.z * wi.z, p->k - 1.0f)", "power(wo.z, p->k - 1.0f) * 0.3f")
    text = edited(MINNAERT, one_way, ('claims = ["reciprocal"]', "claims = []"))
    (made, *_) = measured(device, "minnaert", text)
    assert faults(made, 3) == {} and {"unreciprocal", "loses"} <= kinds(made)


@pytest.mark.long
@pytest.mark.parametrize("text", [LED, SEARCHLIGHT, EVEN], ids=["led", "searchlight", "even"])
def test_lights_have_no_faults(device: Device, text: str) -> None:
    """With their defaults, and with the bounds of each of their numbers. False alarms: 1 %, by a fixed seed."""
    made = measure_light(plugin(text), device)
    found = [{each.kind for each in light_findings(one, len(made))} for one in made]
    assert found == [{"sampled", "bits"} if device.is_cpu else {"sampled"}] * len(made)
    assert all(abs(each.integral - 1.0) < 2e-3 for each in made)
    if text == SEARCHLIGHT:
        assert made[0].power == pytest.approx([100.0] * 3, rel=1e-3)
    if text == EVEN:
        assert made[0].power == pytest.approx([4.0 * math.pi] * 3, rel=1e-5)


@pytest.mark.long
@pytest.mark.parametrize(
    ("text", "changes", "found"),
    [
        (LED, [("along(lobe, p->ring", "along(sub(lobe, vec3_all(0.01f)), p->ring")], "negative"),
        (LED, [("return exp2_of(-(x * x))", "return exp2_of(-(x * x)) * (x > 2.0f ? x * FAR * FAR : x)")], "nonfinite"),
        (SEARCHLIGHT, [("(2.0f * INV_PI)", "(2.2f * INV_PI)")], "integral"),
        (SEARCHLIGHT, [("(2.0f * INV_PI)", "(1.9f * INV_PI)")], "directions"),
        (SEARCHLIGHT, [("-0.34657359f", "-0.4f")], "directions"),
        (SEARCHLIGHT, [("unit(vec3_of(t * c, t * s, splat(1.0f)))", "vec3_all(0.0f)")], "directions"),
        (EVEN, [], "unsent"),
        (EVEN, [("return p->color", "return scale(p->color, vfloat_of((direction.z > 0.0f) + 2))")], "lanes"),
    ],
    ids=lambda each: each if isinstance(each, str) and len(each) < 20 else "",
)
def test_faulty_lights_are_found_and_named(
    device: Device, text: str, changes: list[tuple[str, str]], found: str
) -> None:
    if found == "lanes" and not device.is_cpu:
        pytest.skip("a GPU has one lane")
    made = edited(text, *changes)
    if found == "unsent":
        half = "static vec3 even_sample(const EvenParameters* p, vfloat u, vfloat v) "
        half += "{ return warp_cone(u, v, splat(1.0f)); }"
        density = "{ return direction.z > 0.0f ? splat(0.5f * INV_PI) : splat(0.0f); }"
        made += f"{half}\nstatic vfloat even_pdf(const EvenParameters* p, vec3 direction) {density}\n"
    measured_ = measure_light(plugin(made), device, count=1 << 15)
    assert any(found in {each.kind for each in light_findings(one, 1) if each.fault} for one in measured_)


def corner(material: str) -> Scene:
    """A ball and a floor of a plugin's material in a corner, below a lamp."""
    table: dict[str, Any] = {"type": "plugin", "plugin": material}
    grey = {"type": "lambert", "reflectance": (0.6, 0.5, 0.4)}
    wide = {"type": "quad", "edge_u": (4, 0, 0)}
    return Scene(
        camera={"position": (0.5, 1.2, 3.5), "target": (0.0, 0.4, 0.0), "vertical_fov": 40.0},
        materials={"given": table, "grey": grey},
        shapes=[
            {**wide, "origin": (-2, 0, 2), "edge_v": (0, 0, -4), "material": "given"},
            {**wide, "origin": (-2, 0, -1.5), "edge_v": (0, 3, 0), "material": "grey"},
            {"type": "sphere", "center": (0.0, 0.5, 0.0), "radius": 0.5, "material": "given"},
            {"type": "disk", "center": (0.6, 2, 0.8), "normal": (0, -1, 0), "radius": 0.4, "emission": (6, 5, 4)},
        ],
    )  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize(("name", "text"), [("minnaert", MINNAERT), ("ashikhmin_shirley", SHIRLEY), ("paper", PAPER)])
def test_integrators_agree_on_plugins(device: Device, name: str, text: str) -> None:
    """Among them those that evaluate a BSDF from its other end. The chance of a false alarm is 1 % each."""
    scene = corner(name).with_plugins(text)
    settings: dict[str, Any] = {"size": (64, 48), "spp": 96, "batches": 8}
    _, pairs = compare_integrators(scene, ("path", "bdpt", "reuse"), device=device.info.index, **settings)
    assert [(pair.first, pair.second, pair.numbers) for pair in pairs if pair.verdict.kind != AGREE] == []


@pytest.mark.thorough
@pytest.mark.parametrize(
    "way",
    [
        {"sampling": "light"},
        {"sampling": "bsdf"},
        pytest.param({"guiding": "on", "guiding_paths": 4096}, marks=pytest.mark.long),
    ],
    ids=str,
)
def test_ways_to_sample_agree(device: Device, way: dict[str, Any]) -> None:
    """The means of tiles over seeds, by t-tests with 5 % in all, and Sidak's correction."""
    from scipy import stats

    scene = corner("ashikhmin_shirley").with_plugins(SHIRLEY)
    groups = []
    with clrender.Session(device) as session:
        for settings in ({}, way):
            rows = []
            for seed in range(12):
                image = session.render(scene, size=(32, 24), spp=64, seed=seed + (100 if settings else 0), **settings)
                rows.append(image.linear.mean(axis=2).reshape(3, 8, 4, 8).mean(axis=(1, 3)).ravel())
            groups.append(np.array(rows, np.float64))
    p = stats.ttest_ind(*groups, equal_var=False).pvalue
    level = -math.expm1(math.log1p(-0.05) / len(p))
    assert p.min() > level, (way, p)
    assert abs(groups[0].mean() / groups[1].mean() - 1.0) < 0.01
