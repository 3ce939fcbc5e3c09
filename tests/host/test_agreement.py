"""Statistics and verdicts of `compare --integrators`: made-up batches whose truth is known, and scenes described."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import numpy.typing as npt
import pytest
from cases import for_each
from scipy import stats

import clrender
import clrender.agreement.integrators
from clrender.agreement.batches import Batches, compare_batches, tile_means
from clrender.agreement.integrators import check_integrators, common_indirect_rays
from clrender.agreement.significance import has_outlier, holm, welch
from clrender.agreement.verdict import AGREE, FAULT, MAY, MUST, light_kinds, verdict
from clrender.cli import main
from clrender.errors import UsageError
from clrender.integrators import (
    BETWEEN_DIFFUSE,
    CAUSTICS,
    DELTA_CAUSTICS,
    ENVIRONMENT_ON_DIFFUSE,
    INTEGRATORS,
    SOFT_SHADOWS,
)
from clrender.integrators.descriptor import Pipeline
from clrender.scene import Scene, load
from clrender.statistics.student_t import critical_value, p_value

Floats = npt.NDArray[np.float64]

TILES = (10, 15, 3)
CHANCE = 1e-4
"""That a count of alarms fails although the tests are right; the seeds are fixed."""


@pytest.fixture(scope="module")
def cornell() -> Scene:
    return load("cornell")


def batches(seed: int, name: str = "path", count: int = 16, noise: float = 0.1) -> Batches:
    """Normal noise that grows from left to right, alike in the channels of a tile: an image without fireflies."""
    random = np.random.default_rng(seed)
    sigma = noise * np.geomspace(0.2, 5.0, TILES[1])[:, None]
    common = random.normal(size=(count, *TILES[:2], 1))
    tiles = 1.0 + sigma * (0.8 * common + 0.6 * random.normal(size=(count, *TILES)))
    return of_tiles(tiles, name)


def of_tiles(tiles: Floats, name: str = "path") -> Batches:
    image = np.repeat(np.repeat(tiles.mean(axis=0), 8, axis=0), 8, axis=1).astype(np.float32)
    numbers = {"spp": 64, "nonfinite_samples": 0}
    return Batches(name, name, tiles, 8, tiles.mean(axis=(1, 2, 3)), image, numbers)


# --- the tests themselves --------------------------------------------------------------------------------------------


@for_each("df", [1.0, 2.0, 7.0, 15.0, 22.7, 62.0, 1000.0])
def test_students_distribution_is_scipys(df: float) -> None:
    t = np.concatenate([[0.0], np.logspace(-6, 2, 200), [np.inf]])
    np.testing.assert_allclose(p_value(t, df), 2.0 * stats.t.sf(t, df), rtol=1e-9, atol=1e-290)
    np.testing.assert_array_equal(p_value(-t, df), p_value(t, df))
    for probability in (0.05, 1e-5, 1e-9):
        found = critical_value(probability, [df])
        np.testing.assert_allclose(found, stats.t.isf(probability / 2.0, df), rtol=1e-8)


def test_the_default_install_is_enough() -> None:
    """Neither SciPy nor Matplotlib is needed to compare integrators, nor to import what needs them."""
    code = """if True:
        import sys
        sys.modules.update(dict.fromkeys(("scipy", "matplotlib")))
        import clrender.agreement.integrators, clrender.report.runs, clrender.report.verdicts
        print(clrender.statistics.student_t.p_value(0.0, 3.0))
    """
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout == "1.0\n"


def test_welch_is_scipys() -> None:
    random = np.random.default_rng(3)
    a, b = random.normal(size=(12, 40)), random.normal(0.3, 4.0, size=(20, 40))
    found, right = welch(a, b), stats.ttest_ind(a, b, equal_var=False)
    np.testing.assert_allclose(found.p, right.pvalue, rtol=1e-9)
    np.testing.assert_allclose(found.df, right.df, rtol=1e-12)
    np.testing.assert_allclose(found.z, stats.norm.isf(right.pvalue / 2.0) * np.sign(right.statistic), rtol=1e-7)


def test_welch_without_noise_tells_rounding_from_difference() -> None:
    one = np.ones((8, 3))
    found = welch(one, one * [1.0, 1.0 + 1e-7, 1.5], 4e-6)
    np.testing.assert_array_equal(found.p, [1.0, 1.0, 0.0])
    np.testing.assert_allclose(found.z, [0.0, 0.0, -37.06], atol=0.05)


def test_holm() -> None:
    # Of four at 0.05: 0.05/4, 0.05/3, 0.05/2, 0.05; the first that is kept keeps all that follow.
    np.testing.assert_array_equal(holm([0.016, 0.06, 0.01, 0.02], 0.05), [True, False, True, True])
    np.testing.assert_array_equal(holm([0.03, 0.03, 0.001, 0.03], 0.05), [False, False, True, False])
    np.testing.assert_array_equal(holm([0.018, 0.001, 0.01, 0.02], 0.05), [True] * 4)
    np.testing.assert_array_equal(holm([0.02, 0.3], 0.05), [True, False])
    assert not holm([0.03, 0.04], 0.05).any() and not holm(np.ones(5), 0.05).any()


def test_fireflies_are_found_and_normal_noise_has_none() -> None:
    rows = np.random.default_rng(5).normal(size=(16, 20000))
    false = int(has_outlier(rows, 1e-3).sum())
    # Bonferroni inside Grubbs' test keeps it at or a little below its level.
    assert stats.binomtest(false, 20000, 1e-3, alternative="greater").pvalue > CHANCE and false > 0
    rows[3] += 12.0
    assert has_outlier(rows, 1e-3).mean() > 0.99
    assert not has_outlier(np.ones((16, 2)), 1e-3).any()


# --- many tests at once ----------------------------------------------------------------------------------------------


@pytest.mark.long
def test_integrators_that_agree_raise_alarms_as_rarely_as_promised(cornell: Scene) -> None:
    level, trials = 0.05, 120
    alarms = {"equal noise": 0, "five times the noise": 0}
    for trial in range(trials):
        plain = batches(2 * trial + 1)
        for case, noise in (("equal noise", 0.1), ("five times the noise", 0.02)):
            other = batches(2 * trial + 2, noise=noise)
            alarms[case] += compare_batches(cornell, plain, other, level).verdict.kind != AGREE
    for case, count in alarms.items():
        assert stats.binomtest(count, trials, level, alternative="greater").pvalue > CHANCE, case
        # Neither is the level wasted: channels that hang together cost some of it.
        assert stats.binomtest(count, trials, level / 3.0, alternative="less").pvalue > CHANCE, case


def test_light_found_rarely_does_not_look_like_light_left_out(cornell: Scene) -> None:
    # One sees a flash in a quarter of its batches, the other always sees their mean. In 2 of 100 tiles no batch has a
    # flash, and there is no spread: by itself such a tile would be dark beyond doubt.
    alarms, trials = 0, 100
    for trial in range(trials):
        random = np.random.default_rng(trial)
        flashes = random.poisson(0.25, (16, *TILES[:2], 1))
        rare = of_tiles(1.0 + random.normal(0.0, 0.01, (16, *TILES)) + 4.0 * flashes)
        calm = of_tiles(random.normal(2.0, 0.01, (16, *TILES)))
        alarms += compare_batches(cornell, rare, calm).verdict.kind != AGREE
    assert stats.binomtest(alarms, trials, 0.01, alternative="greater").pvalue > CHANCE


def test_without_correction_there_would_be_alarms(cornell: Scene) -> None:
    pairs = [compare_batches(cornell, batches(2 * trial), batches(2 * trial + 1)) for trial in range(10)]
    chances = 2.0 * stats.norm.sf(np.abs([pair.scores for pair in pairs]))
    assert (chances < 0.01).any() and all(pair.verdict.kind == AGREE for pair in pairs)


def test_a_patch_that_is_a_twentieth_brighter_is_found(cornell: Scene) -> None:
    found = 0
    for trial in range(20):
        plain, other = batches(3 * trial, noise=0.01), batches(3 * trial + 1, noise=0.01)
        tiles = other.tiles.copy()
        tiles[:, 4:6, 7:9] *= 1.05
        pair = compare_batches(cornell, of_tiles(tiles), plain)
        found += pair.verdict.kind == FAULT and pair.numbers["tiles_brighter"] >= 1
        column, row = pair.numbers["largest_z_tile"]
        assert column in (7, 8) and row in (4, 5) and pair.numbers["tiles_darker"] == 0
    assert found == 20


@pytest.mark.long
def test_differences_said_to_be_visible_are_seen_nine_times_in_ten(cornell: Scene) -> None:
    # All tiles alike, so that the median is every tile's.
    random, seen, trials = np.random.default_rng(11), 0, 100
    shape = (16, 5, 6, 3)
    for _ in range(trials):
        a, b = random.normal(1.0, 0.05, shape), random.normal(1.0, 0.05, shape)
        visible = compare_batches(cornell, of_tiles(a), of_tiles(b)).numbers["visible_in_tile"]
        a[:, 2, 3, 1] += visible
        seen += compare_batches(cornell, of_tiles(a), of_tiles(b)).numbers["tiles_brighter"] > 0
    assert stats.binomtest(seen, trials, 0.9).pvalue > CHANCE


def test_a_difference_too_small_for_any_tile_shows_in_the_mean(cornell: Scene) -> None:
    tiles = np.random.default_rng(1).normal(1.0, 0.05, (2, 16, *TILES))
    pair = compare_batches(cornell, of_tiles(1.01 * tiles[0]), of_tiles(tiles[1]))
    assert pair.numbers["tiles_differ"] == 0 and pair.numbers["mean_p_value"] < 0.001
    assert pair.verdict.kind == FAULT
    low, high = pair.numbers["mean_ratio_95"]
    assert low < 1.01 < high and low > 1.0


@pytest.mark.long
def test_the_interval_of_the_ratio_holds_it_in_95_of_100(cornell: Scene) -> None:
    held = 0
    for trial in range(100):
        pair = compare_batches(cornell, of_tiles(1.5 * batches(2 * trial).tiles), batches(2 * trial + 1))
        low, high = pair.numbers["mean_ratio_95"]
        held += low < 1.5 < high
    assert stats.binomtest(held, 100, 0.95).pvalue > CHANCE


def test_black_images_agree(cornell: Scene) -> None:
    black = of_tiles(np.zeros((16, *TILES)))
    pair = compare_batches(cornell, black, black)
    assert pair.verdict.kind == AGREE and pair.numbers["mean_ratio"] is None and pair.numbers["visible_in_tile"] is None


def test_what_could_be_rounding_is_not_said_to_be_visible(cornell: Scene) -> None:
    plain = of_tiles(np.ones((16, *TILES)))
    pair = compare_batches(cornell, plain, of_tiles((1.0 + 3e-6) * plain.tiles))
    assert pair.verdict.kind == AGREE
    assert pair.numbers["visible_in_tile"] > 3e-6 and pair.numbers["visible_in_mean"] > 3e-6
    assert compare_batches(cornell, plain, of_tiles((1.0 + 5e-6) * plain.tiles)).verdict.kind == FAULT


def test_tiles_at_the_edge_are_smaller() -> None:
    image = np.random.default_rng(0).random((11, 13, 3))
    means = tile_means(image, 4)
    assert means.shape == (3, 4, 3)
    np.testing.assert_allclose(means[0, 1], image[:4, 4:8].mean(axis=(0, 1)))
    np.testing.assert_allclose(means[2, 3], image[8:, 12:].mean(axis=(0, 1)))


# --- verdicts --------------------------------------------------------------------------------------------------------

WHITE: dict[str, object] = {"type": "lambert", "reflectance": [0.5, 0.5, 0.5]}
QUAD: dict[str, object] = {
    "type": "quad",
    "origin": [0, 0, 0],
    "edge_u": [1, 0, 0],
    "edge_v": [0, 0, 1],
    "material": "white",
}
BALL: dict[str, object] = {"type": "sphere", "center": [0, 2, 0], "radius": 1, "material": "white"}
POINT: dict[str, object] = {"type": "point", "position": [0, 1, 0], "intensity": [1, 1, 1]}
SKY: dict[str, object] = {"type": "environment", "radiance": [1, 1, 1]}
LAMP: dict[str, object] = {**QUAD, "origin": [0, 3, 0], "emission": [1, 1, 1]}
del LAMP["material"]


def scene(*parts: dict[str, object], **materials: dict[str, object]) -> Scene:
    lights = [part for part in parts if part["type"] in ("point", "environment")]
    return clrender.Scene.model_validate(
        {
            "camera": {"position": [0, 0, -3], "target": [0, 0, 0]},
            "materials": {"white": WHITE, **materials},
            "shapes": [part for part in parts if part not in lights],
            "lights": lights,
        }
    )


@for_each(
    ("parts", "kinds"),
    [
        ([QUAD, POINT], set()),
        ([BALL, POINT], {BETWEEN_DIFFUSE}),
        ([QUAD, QUAD, POINT], {BETWEEN_DIFFUSE}),
        ([QUAD, LAMP], {SOFT_SHADOWS}),
        ([QUAD, SKY], {ENVIRONMENT_ON_DIFFUSE}),
        ([QUAD, {**BALL, "material": "glass"}, POINT], {CAUSTICS, DELTA_CAUSTICS}),
        ([QUAD, {**BALL, "material": "glass"}, SKY], {CAUSTICS, ENVIRONMENT_ON_DIFFUSE}),
        ([{**BALL, "material": "glass"}, SKY, LAMP], set()),
        ([{**BALL, "material": "black"}, SKY, LAMP], set()),
    ],
)
def test_the_light_that_a_scene_may_have(parts: list[dict[str, object]], kinds: set[str]) -> None:
    glass = {"type": "dielectric", "ior": 1.5}
    described = scene(*parts, glass=glass, black={**WHITE, "reflectance": [0, 0, 0]})
    assert light_kinds(described) == kinds
    foggy = described.changed(media={"fog": {"scattering": [0.1] * 3}}, fog="fog")
    assert light_kinds(foggy) == kinds | {BETWEEN_DIFFUSE}


def test_verdicts(cornell: Scene, monkeypatch: pytest.MonkeyPatch) -> None:
    plane, lamp = scene(QUAD, POINT), scene(QUAD, LAMP)
    assert verdict("path", "path", cornell, False, False).kind == AGREE
    assert verdict("path", "path", cornell, True, False).kind == FAULT
    must = verdict("path", "direct", cornell, False, True)
    assert must.kind == MUST and must.reason == "direct has no light between diffuse surfaces"
    # What is left out darkens: brighter for the lack of it is a fault, but for lights that shine from their centres.
    assert verdict("path", "direct", cornell, True, True).kind == FAULT
    assert verdict("direct", "path", cornell, False, True).kind == FAULT
    assert verdict("path", "whitted", cornell, True, True).kind == MUST
    assert verdict("direct", "whitted", cornell, True, True).kind == MUST
    # A scene without what is left out
    assert verdict("path", "whitted", plane, False, True).kind == FAULT
    assert verdict("path", "direct", lamp, False, True).kind == FAULT
    assert "does not show" in verdict("path", "direct", cornell, False, False).reason
    # Caustics of lights without extent, of which specular chains find some
    glass = scene(QUAD, {**BALL, "material": "glass"}, POINT, glass={"type": "dielectric", "ior": 1.5})
    assert verdict("path", "bdpt", glass, True, False).kind == MUST
    assert verdict("path", "bdpt", glass, False, True).kind == FAULT
    assert verdict("path", "reuse", glass, False, True).kind == FAULT
    assert verdict("path", "reuse", glass, False, True, specular_chains=True).kind == MUST
    assert verdict("path", "bdpt", glass, True, False, specular_chains=True).kind == MUST
    # One that is not unbiased, and one that leaves out what is not known here
    odd = clrender.integrators.Integrator(Pipeline("", ""), bias="consistent", leaves_out=("mirrors and glass",))
    monkeypatch.setattr("clrender.agreement.verdict.INTEGRATORS", {**INTEGRATORS, "odd": odd})
    assert verdict("path", "odd", plane, False, True).kind == MUST
    may = verdict("odd", "path", plane, False, True)
    assert may.kind == MAY and "odd is consistent, not unbiased" in may.reason


def test_all_take_as_many_indirect_rays() -> None:
    told: list[str] = []
    direct_only = scene(QUAD, POINT).changed(render={"indirect_rays": 0})
    assert common_indirect_rays(direct_only, ["path", "direct"], told.append) == {} and not told
    assert common_indirect_rays(direct_only, ["path", "bdpt"], told.append) == {"indirect_rays": 1}
    assert "all of them take 1" in told[0]
    assert common_indirect_rays(scene(QUAD, POINT), ["path", "bdpt"], None) == {}


def test_names_are_checked() -> None:
    with pytest.raises(UsageError, match='"whited"; did you mean "whitted"'):
        check_integrators(["path", "whited"])
    with pytest.raises(UsageError, match="at least two"):
        check_integrators(["path"])
    check_integrators(["path", "path"])


@pytest.mark.parametrize(("factor", "option", "code"), [(1.0, "--check", 0), (1.1, "--check", 1), (1.1, "--quiet", 0)])
def test_the_exit_code_tells_a_fault_only_when_asked(
    factor: float, option: str, code: int, cornell: Scene, monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    a, b = batches(1, "direct"), batches(2, "path")
    a.tiles[:] *= factor
    a.whole[:] *= factor
    a.tiles[0, :3] += 30.0
    b.numbers["nonfinite_samples"] = 5
    made = [a, b], [compare_batches(cornell, a, b)]
    monkeypatch.setattr(clrender.agreement.integrators, "compare_integrators", lambda *_, **__: made)
    with pytest.raises(SystemExit) as end:
        main(["compare", "--integrators", "direct,path", "cornell", option])
    assert end.value.code == code
    text = capsys.readouterr().out
    assert "discarded samples that were not finite: path: 5" in text
    if factor > 1.0:
        assert "differ where they should agree" in text and "direct / path" in text
        assert "but then path cannot be darker than direct anywhere; fireflies in 45 tiles make" in text
