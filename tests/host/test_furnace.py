"""What is measured of a material, without a device: what is meant, directions, and faults of materials in NumPy."""

from __future__ import annotations

import math
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cases import for_each
from furnace_support import material

from clrender.errors import SceneError, UsageError
from clrender.furnace import Measured, findings, subjects_of
from clrender.furnace.directions import NARROWEST, around, incident, jittered, mirrored, polar, refracted
from clrender.furnace.energy import Tally, measure_energy
from clrender.furnace.measure import Lobe
from clrender.furnace.reciprocity import measure_reciprocity
from clrender.furnace.sampling import measure_sampling
from clrender.furnace.subjects import ROUGHNESSES, whitened
from clrender.scene.description import MATERIAL_TYPES


def measured(eta: float = 1.0, **of: Any) -> Measured:
    """All measurements of a material in NumPy."""
    what, rng, tally = material(eta=eta, **of), np.random.default_rng(610), Tally()
    front = measure_energy(what, "m", eta, rng, tally, angles=(0.0, 45.0, 80.0), side=16)
    sides = (False, True) if front.transmits else (False,)
    energies = tuple(
        measure_energy(what, "m", eta, rng, tally, below=below, angles=(0.0, 80.0), side=16) for below in sides
    )
    tests = tuple(
        measure_sampling(what, "m", eta, angle, rng, tally, below=below, count=1 << 15)
        for below in sides
        for angle in (0.0, 60.0)
    )
    reciprocity = measure_reciprocity(what, "m", eta, rng, front.transmits, 16)
    lobe = Lobe(0.0, np.zeros(2), np.zeros((2, 3)))
    return Measured("m", "lambert", {}, energies, energies, tests, reciprocity, tally, (), (lobe,))


def faults(**of: Any) -> dict[str, float]:
    """Kinds of the faults that are found, with how much."""
    return {each.kind: each.amount for each in findings(measured(**of)) if each.fault}


def test_right_materials_have_no_faults() -> None:
    assert faults() == {}
    assert faults(through=0.6) == {}
    assert faults(through=0.5, eta=1.5) == {}


@pytest.mark.thorough
def test_energy_is_named_with_how_much() -> None:
    assert faults(energy=1.02) == {"gain": pytest.approx(0.02, abs=1e-4)}
    assert faults(energy=1.1, through=0.5, eta=1.5) == {"gain": pytest.approx(0.1, abs=1e-4)}
    found = findings(measured(energy=0.97))
    assert found[0].kind == "loss" and found[0].amount == pytest.approx(0.03, abs=1e-4) and not found[1].fault
    assert "only 97.00 % of the light leaves the surface at" in found[0].sentence


def test_light_is_to_go_either_way() -> None:
    found = faults(energy=0.5, uneven=0.2)
    assert found["reciprocity"] == pytest.approx(1.0 - 1.0 / 1.2, abs=0.02)
    # What crosses has the squares of two indices between its directions; the measurement has those of others
    what = material(through=0.5, eta=1.5)
    found_with = [measure_reciprocity(what, "m", eta, np.random.default_rng(640), True, 4) for eta in (1.5, 1.2)]
    assert found_with[0].largest < 1e-6 and found_with[0].compared > 1000
    assert found_with[1].largest == pytest.approx(1.0 - (1.2 / 1.5) ** 2, abs=1e-6)


def test_directions_that_do_not_follow_the_density() -> None:
    found = faults(crooked=0.4)
    assert found["directions"] < 1e-10 and "reciprocity" not in found
    assert faults(crooked=0.4, through=0.5)["directions"] < 1e-10


def test_samples_that_are_no_numbers_or_negative() -> None:
    found = faults(energy=0.5, nan_share=1e-3, negative_share=2e-3)
    assert 0 < found["nonfinite"] < found["negative"]
    assert "nonfinite" in faults(nan_share=1e-5)  # one of each set of samples


def test_directions_around_a_pole_and_back() -> None:
    rng = np.random.default_rng(620)
    for pole in (incident(0.0), incident(60.0), incident(89.9, below=True), incident(30.0, turn=0.6)):
        angle = NARROWEST * np.exp(math.log(3.0 / NARROWEST) * rng.random(1000))
        turn = 2.0 * math.pi * rng.random(1000)
        directions = around(pole, angle, turn)
        np.testing.assert_allclose(np.linalg.norm(directions, axis=1), 1.0, atol=1e-7)
        again, turned = polar(pole, directions)
        np.testing.assert_allclose(again, angle, atol=2e-7)
        wide = angle > 1e-3
        np.testing.assert_allclose(np.cos(turned - turn)[wide], 1.0, atol=1e-6)


def test_mirror_and_refraction() -> None:
    wo = incident(40.0)
    np.testing.assert_allclose(mirrored(wo) + wo, [0.0, 0.0, 2.0 * wo[2]], atol=1e-7)
    for eta, side in ((1.5, wo), (1.0 / 1.5, wo), (1.5, -wo)):
        through = refracted(side, eta)
        assert through[2] * side[2] < 0.0
        assert np.linalg.norm(through) == pytest.approx(1.0, abs=1e-6)
        np.testing.assert_allclose(through[:2] * eta, -side[:2], atol=1e-7)
    total = refracted(incident(80.0), 1.0 / 1.5)
    assert -1e-3 < total[2] < 0.0 and np.linalg.norm(total) == pytest.approx(1.0, abs=1e-6)


def test_jittered_numbers_lie_one_in_each_cell() -> None:
    numbers = jittered(np.random.default_rng(630), 3, 8)
    assert numbers.shape == (2, 3, 64) and numbers.min() >= 0.0 and numbers.max() < 1.0
    for copy in range(3):
        cells = (numbers[:, copy] * 8).astype(int)
        assert len({tuple(cell) for cell in cells.T.tolist()}) == 64


def test_what_is_meant() -> None:
    conductor = subjects_of("conductor")
    assert conductor.names == ("conductor",)
    assert [value for value, _ in conductor.swept["conductor"]] == list(ROUGHNESSES)
    assert len(conductor.scene.materials) == 1 + len(ROUGHNESSES)
    table = subjects_of('{type = "dielectric", ior = 1.6, exterior_ior = 1.2}')
    assert table.names == ("dielectric",) and not table.swept
    assert table.eta("dielectric") == pytest.approx(1.6 / 1.2)
    metals = subjects_of("metals")
    assert {"gold", "clay"} < set(metals.names)
    assert subjects_of("metals", ["clay", "gold"]).names == tuple(n for n in metals.names if n in ("clay", "gold"))
    assert metals.eta("gold") == 1.0


@for_each("kind", [kind for kind in MATERIAL_TYPES if kind != "plugin"])
def test_every_type_is_known_by_its_name_or_says_what_it_needs(kind: str) -> None:
    try:
        subject = subjects_of(kind)
    except SceneError as error:
        assert f"materials.{kind}" in str(error) and "is missing" in str(error)
    else:
        assert subject.names == (kind,)


def test_white_materials() -> None:
    white = whitened(subjects_of("metals").scene)
    assert white.materials["clay"].reflectance == (1.0, 1.0, 1.0)  # type: ignore[union-attr]
    gold = white.materials["gold"]
    assert gold.metal is None and max(gold.index[0]) < 0.01 and min(gold.index[1]) > 100.0  # type: ignore[union-attr, index]


@for_each("color", ["eumelanin = 1.0", "pheomelanin = 2.0", "absorption_coefficient = [1, 2, 3]", "tilt_degrees = 1"])
def test_white_hair_has_no_pigment(color: str) -> None:
    (hair,) = whitened(subjects_of(f'{{type = "hair", {color}}}').scene).materials.values()
    assert hair.reflectance == (1.0, 1.0, 1.0) and hair.absorption_of is None  # type: ignore[union-attr]


@for_each(
    ("text", "expected"),
    [
        ("conducto", ['"conducto"', 'did you mean "conductor"']),
        ("metal", ['"metal"', 'did you mean "metals"']),
        ("xyzzy", ["no material type and no built-in scene", "types: lambert"]),
        ("nowhere.toml", ["nowhere.toml"]),
        ('{type = "conductor"', ["no inline table of TOML"]),
        ('{type = "conductor", type = "mirror"}', ["no inline table of TOML"]),
        ("{}\nx = 1", ["no inline table of TOML"]),
        ("{}", ["materials.material", "`type` is missing"]),
        ('{type = "conducto"}', ['did you mean "conductor"']),
        ('{type = "conductor", metal = "Au", roughness = 2.0}', ["materials.conductor.roughness", "2.0", "at most 1"]),
        ('{type = "lambert"}', ["materials.lambert", "`reflectance` is missing"]),
        ('{type = "lambert", reflektance = [1.0, 1.0, 1.0]}', ["reflektance", 'did you mean "reflectance"']),
    ],
)
def test_bad_input_gets_one_sentence(text: str, expected: list[str]) -> None:
    with pytest.raises((UsageError, SceneError)) as caught:
        subjects_of(text)
    message = str(caught.value)
    assert "\n" not in message and all(part in message for part in expected), message


def test_bad_names_of_materials(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match='no material "golt"; did you mean "gold"'):
        subjects_of("metals", ["golt"])
    with pytest.raises(UsageError, match="--material chooses among the materials of a scene"):
        subjects_of("conductor", ["gold"])
    (tmp_path / "empty.toml").write_text("[camera]\nposition = [0, 0, 5]\ntarget = [0, 0, 0]\n")
    with pytest.raises(UsageError, match=r"empty\.toml: the scene has no materials"):
        subjects_of(str(tmp_path / "empty.toml"))


def test_every_kind_of_finding_has_its_place_on_the_page() -> None:
    """The kinds are told in the docstring of findings."""
    from clrender.furnace.findings import Finding
    from clrender.furnace.page import _TOPICS

    told = (Finding.__doc__ or "").partition("kind : str")[2].partition("fault : bool")[0]
    kinds = {word for part in re.findall(r"``([^`]*)``", told) for word in part.split()}
    assert len(kinds) > 20 and kinds == set(_TOPICS)
