"""IES files on the host: what their numbers mean, and their place in scenes and jobs."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cases import for_each

from clrender import RenderJob, layout
from clrender.errors import SceneError
from clrender.flatten.flat_scene import flatten
from clrender.flatten.lamp_tables import lamp_table
from clrender.flatten.lamps import lamp_directions
from clrender.image.exposure import LUMENS_PER_WATT
from clrender.scene import IesLight, Scene, SpotLight, load
from clrender.scene.ies import IesProfile, read_ies
from clrender.scene.portable import scene_from_portable, scene_to_portable

TEXT = (
    '[camera]\nposition = [0, 0, 5]\ntarget = [0, 0, 0]\n[[lights]]\ntype = "ies"\nposition = [0, 2, 0]\nfile = "{}"\n'
)
CAMERA: dict[str, Any] = {"position": (0, 0, 5), "target": (0, 0, 0)}
PLAIN = "TILT=NONE\n1 -1 2 3 1 1 2 0 0 0\n{}\n0 45 90\n0\n100 50 10\n"


def read(folder: Path, text: str, **more: str) -> IesProfile:
    (folder / "a.ies").write_bytes(text.encode("latin-1"))
    for name, other in more.items():
        (folder / f"{name}.tlt").write_text(other)
    return read_ies("a.ies", folder, (), "here")


@pytest.mark.parametrize(
    ("header", "factors", "expected"),
    [
        ("A lamp of 1986, of which nothing is said before its name\nand more\n", "0.5 0.25 80", 0.25),
        ("IESNA91\n[TEST] x\n", "0.5 0.25 80", 0.25),
        ("IESNA:LM-63-1995\n", "0.5 0.25 80", 0.25),
        ("IESNA:LM-63-2002\n", "0.5 0.25 80", 1.0),
        ("IES:LM-63-2019\n[TEST] TILT=x\n", "0.5 1.10000 80", 1.0),
    ],
)
def test_factors_count_as_in_the_standard_of_the_year(
    tmp_path: Path, header: str, factors: str, expected: float
) -> None:
    """The multiplier is 2 and the ballast factor a half; the second factor has been another number since 2002."""
    profile = read(tmp_path, header + PLAIN.format(factors))
    assert profile.vertical.tolist() == [0.0, 45.0, 90.0] and profile.horizontal.tolist() == [0.0]
    np.testing.assert_allclose(profile.candela[:, 0], np.array([100.0, 50.0, 10.0]) * expected)


def test_numbers_may_be_spread_in_any_way(tmp_path: Path) -> None:
    plain = read(tmp_path, "IESNA91\n" + PLAIN.format("1 1 1"))
    text = (
        "IESNA91\r\n[TEST] \xe9\r\n tilt = None\r1,-1\r2.0e0, 3\r\n1\t1 2 0 0 0 1 1 1 0 45 +90. 0 100 50 .1E2\r\n\x1a"
    )
    other = read(tmp_path, text)
    assert plain.sha256() == other.sha256()
    assert read(tmp_path, "IESNA91\n" + PLAIN.format("1 1 1").replace("50", "51")).sha256() != plain.sha256()


TILT = "1\n3\n0 30 90\n1.0 0.5 0.9\n"


@pytest.mark.parametrize("how", ["included", "beside"])
def test_tilt(tmp_path: Path, how: str) -> None:
    """A lamp that is not upright is as much darker as the file says."""
    text = PLAIN.format("1 1 1").replace("NONE", "INCLUDE\n" + TILT.strip() if how == "included" else "b.tlt")
    profile = read(tmp_path, text, b=TILT)
    assert [profile.tilt_factor(angle) for angle in (0.0, 15.0, 30.0, 60.0, 90.0, 180.0)] == [
        1.0,
        0.75,
        0.5,
        pytest.approx(0.7),
        0.9,
        0.9,
    ]
    for direction, factor in (((0, -1, 0), 1.0), ((0, -3, math.sqrt(3.0)), 0.5), ((1, 0, 0), 0.9), ((0, 1, 0), 0.9)):
        light = {"type": "ies", "position": (0, 0, 0), "direction": direction, "file": "a.ies"}
        what = Scene.model_validate({"camera": CAMERA, "lights": [light]}).placed("here", tmp_path)
        peak = flatten(what, 8, 8).arrays["lights"]["radiance"][0, 0]
        assert peak == pytest.approx(200.0 * factor / LUMENS_PER_WATT, rel=1e-6)
    # A lamp that stays horizontal has no tilt
    text = PLAIN.format("1 1 1").replace("NONE", "INCLUDE\n2" + TILT.strip()[1:])
    assert read(tmp_path, text).tilt_factor(30.0) == 1.0


@for_each(
    ("angles", "values", "around", "expected"),
    [
        ("0 90", "1 1 2 2", [0, 90, 180, 270, 360], [1, 2, 1, 2, 1]),
        ("0 180", "1 1 2 2", [0, 180, 360], [1, 2, 1]),
        ("0 60 180", "1 1 2 2 3 3", [0, 60, 180, 300, 360], [1, 2, 3, 2, 1]),
        ("0 90 180 270", "1 1 2 2 3 3 4 4", [0, 90, 180, 270, 360], [1, 2, 3, 4, 1]),
        ("0 180 360", "1 1 2 2 3 3", [0, 180, 360], [1, 2, 3]),
        ("90 180 270", "1 1 2 2 3 3", [0, 90, 180, 270, 360], [2, 1, 2, 3, 2]),
        ("90 150 270", "1 1 2 2 3 3", [0, 30, 90, 150, 270, 360], [2.25, 2, 1, 2, 3, 2.25]),
    ],
)
def test_symmetry(tmp_path: Path, angles: str, values: str, around: list[float], expected: list[float]) -> None:
    count = len(angles.split())
    text = f"TILT=NONE\n1 -1 1 2 {count} 1 2 0 0 0\n1 1 1\n0 90\n{angles}\n{values}\n"
    profile = read(tmp_path, text)
    assert profile.horizontal.tolist() == around
    np.testing.assert_allclose(profile.candela, [expected, expected], rtol=1e-12)


def test_flux_of_known_lamps() -> None:
    """Lambert's 1000 cos: π 1000; even from 60 to 120 degrees: 2π of it. But for what a chord leaves out of an arc."""
    degrees = np.arange(91.0)
    lambert = IesProfile(degrees, np.zeros(1), 1000.0 * np.cos(np.radians(degrees))[:, None], np.zeros((2, 0)))
    table = lamp_table(lambert)
    assert table.flux * table.peak == pytest.approx(1000.0 * math.pi, rel=1e-4)
    np.testing.assert_allclose(table.mean, [0.0, 0.0, 2.0 / 3.0], atol=1e-4)
    ring = IesProfile(
        np.array([59.99, 60.0, 120.0, 120.01]), np.zeros(1), np.array([[0.0], [5.0], [5.0], [0.0]]), np.zeros((2, 0))
    )
    table = lamp_table(ring)
    assert table.flux * table.peak == pytest.approx(5.0 * 2.0 * math.pi, rel=2e-4)
    assert table.least == pytest.approx(math.cos(math.radians(59.99))) == pytest.approx(-table.most)


def test_dark_lamps_are_no_lights(tmp_path: Path) -> None:
    (tmp_path / "a.ies").write_text(PLAIN.format("1 1 1").replace("100 50 10", "0 0 0"))
    (tmp_path / "a.toml").write_text(TEXT.format("a.ies"))
    assert flatten(load(tmp_path / "a.toml"), 8, 8).light_count == 0


def test_directions_of_a_lamp() -> None:
    """Right-handed about straight up: angle 90 is counter-clockwise of 0 as seen from above."""
    for direction, zero, expected in (
        ((0.0, -2.0, 0.0), None, ((0, -1, 0), (0, 0, 1), (1, 0, 0))),
        ((0.0, 0.0, 3.0), None, ((0, 0, 1), (0, 1, 0), (1, 0, 0))),
        ((0.0, -1.0, 0.0), (5.0, 7.0, 0.0), ((0, -1, 0), (1, 0, 0), (0, 0, -1))),
    ):
        light = IesLight(type="ies", position=(0, 0, 0), direction=direction, horizontal_zero=zero, file="a")
        np.testing.assert_allclose(lamp_directions(light), expected, atol=1e-15)


def test_power_and_rows_of_spots() -> None:
    """Chosen by their flux, 2π (1 - cos half) (1 - blend/2) times the intensity."""
    spots = [
        SpotLight(type="spot", position=(0, k, 0), direction=(0, -2, 0), intensity=(1, 1, 1), cone_degrees=c, blend=b)
        for k, (c, b) in enumerate(((60.0, 0.0), (60.0, 1.0), (360.0, 0.5)))
    ]
    lights = flatten(Scene(camera=CAMERA, lights=tuple(spots)), 8, 8).arrays["lights"]
    flux = np.array([1.0 - math.sqrt(0.75), (1.0 - math.sqrt(0.75)) / 2.0, 1.5])
    np.testing.assert_allclose(lights["probability"], flux / flux.sum(), rtol=1e-6)
    assert (lights["kind"] == layout.LIGHT_SPOT).all() and lights["axis"][0, :3].tolist() == [0.0, -1.0, 0.0]


def test_a_scene_counts_by_the_numbers_and_not_by_the_name(tmp_path: Path) -> None:
    for name, text in (("a", "100 50 10"), ("b", "100  50 1e1"), ("c", "100 50 11")):
        (tmp_path / f"{name}.ies").write_text(PLAIN.format("1 1 1").replace("100 50 10", text))
        (tmp_path / f"{name}.toml").write_text(TEXT.format(f"{name}.ies"))
    a, b, c = (load(tmp_path / f"{name}.toml") for name in "abc")
    assert a.sha256() == b.sha256() != c.sha256()
    assert a.content_sha256() == b.content_sha256() != c.content_sha256()


def test_a_job_carries_the_file(tmp_path: Path) -> None:
    (tmp_path / "a.ies").write_text(PLAIN.format("1 1 1").replace("NONE", "INCLUDE\n" + TILT.strip()))
    (tmp_path / "a.toml").write_text(TEXT.format("a.ies"))
    scene = load(tmp_path / "a.toml")
    text, assets = RenderJob.of(scene).to_json()
    assert len(assets) == 1 and "a.ies" not in text
    assert RenderJob.from_json(text, assets).request() == RenderJob.of(scene).request()
    description, _ = scene_to_portable(scene)
    again = scene_from_portable(description, assets)
    assert flatten(again, 8, 8).sha256 == flatten(scene, 8, 8).sha256
    key, data = next(iter(assets.items()))
    for bad, problem in (({}, "missing"), ({key: data[:-30]}, "cannot be read"), ({"0" * 64: data}, "missing")):
        with pytest.raises(SceneError, match=rf"lights\[0\].file: the asset {key} .*{problem}"):
            scene_from_portable(description, bad)


@for_each("wrong", ["shape", "order", "negative", "open", "beyond", "tilt"])
def test_assets_that_are_no_lamps(wrong: str) -> None:
    """Kernels would read beyond their tables."""
    arrays = {
        "vertical": np.array([0.0, 90.0, 180.0]),
        "horizontal": np.array([0.0, 180.0, 360.0]),
        "candela": np.ones((3, 3)),
        "tilt": np.zeros((2, 0)),
    }
    IesProfile.checked(**arrays)
    name, value = {
        "shape": ("candela", np.ones((3, 2))),
        "order": ("vertical", np.array([0.0, 120.0, 90.0])),
        "negative": ("candela", -np.ones((3, 3))),
        "open": ("horizontal", np.array([0.0, 180.0, 350.0])),
        "beyond": ("vertical", np.array([0.0, 90.0, 190.0])),
        "tilt": ("tilt", np.zeros(3)),
    }[wrong]
    with pytest.raises(ValueError, match="no table of intensities"):
        IesProfile.checked(**{**arrays, name: value})
