"""Pictures of the environment on the host: their table, their place in scenes and jobs, and one for a scene without."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from clrender import layout
from clrender.errors import SceneError
from clrender.flatten.environment import HEAD_WORDS, EnvironmentTable, environment_table
from clrender.flatten.flat_scene import flatten
from clrender.image.files import write_image
from clrender.rendering.job import RenderJob
from clrender.scene import EnvironmentLight, Scene, load
from clrender.scene.environment import EnvironmentPicture
from clrender.scene.portable import scene_from_portable, scene_to_portable

CAMERA = {"position": (0, 0, 5), "target": (0, 0, 0)}
TEXT = '[camera]\nposition = [0, 0, 5]\ntarget = [0, 0, 0]\n[[lights]]\ntype = "environment"\nfile = "{}"\n'


def table_of(pixels: Any, scale: tuple[float, float, float] = (1.0, 1.0, 1.0)) -> EnvironmentTable:
    return environment_table(EnvironmentPicture(np.asarray(pixels, np.float32)), 0.25, scale)


def decoded(table: EnvironmentTable, height: int, width: int) -> Any:
    """(H, W, 3) radiance of the packed pixels."""
    first = HEAD_WORDS + 8 * (height + 1) + (1 << ((height + 1).bit_length() - 1)) + 1
    words = table.words.view(np.uint32)[first : first + 3 * height * (width + 1)].reshape(height, width + 1, 3)[..., 1:]
    assert np.array_equal(words[:, 0], words[:, width])
    low, high = words[:, :width].reshape(-1, 2).astype(np.int64).T
    mantissas = np.stack([low & 0x7FFFF, (low >> 19) | (high & 0x3F) << 13, (high >> 6) & 0x7FFFF], axis=1)
    return np.ldexp(mantissas.astype(np.float64), (high >> 25)[:, None] - 64).reshape(height, width, 3)


def test_pixels_keep_nineteen_bits_of_their_brightest_channel() -> None:
    pixels = (10.0 ** np.random.default_rng(1).uniform(-18.0, 11.0, (5, 7, 3))).astype(np.float32)
    pixels[0, 0] = 0.0
    pixels[0, 1] = (np.nextafter(np.float32(1.0), np.float32(0.0)), 1.0, 0.5)
    pixels[0, 2], pixels[0, 3] = 1e12, 1.0 - 2.0**-20
    found = decoded(table_of(pixels), 5, 7)
    error = np.abs(found - pixels).max(axis=-1)
    assert (error <= np.maximum(pixels.max(axis=-1) * 2.0**-19, 2.0**-65)).all()
    # What a .hdr or a .png of 8 bits holds is kept exactly.
    bytes_ = np.ldexp(np.random.default_rng(2).integers(0, 256, (5, 7, 3)) + 0.5, -6)
    assert np.array_equal(decoded(table_of(bytes_), 5, 7), bytes_)


def test_mean_radiance_and_sums() -> None:
    pixels = np.random.default_rng(3).random((6, 4, 3)).astype(np.float32)
    scale = (2.0, 0.5, 1.0)
    table = table_of(pixels, scale)
    bands = table.words[HEAD_WORDS : HEAD_WORDS + 56].astype(np.float64).reshape(7, 8)
    columns = {name: bands[:, at] for name, at, _, _ in layout.ROWS["BAND"]}
    shares, sums = (np.append(columns[name], columns[f"NEXT_{name}"][-1]) for name in ("SHARE", "SUM"))
    north, next_north = columns["DROP"], columns["NEXT_DROP"]
    assert np.array_equal(north, north[::-1]) and np.array_equal(next_north, next_north[::-1])
    drops = np.concatenate([north[:4], 2.0 - north[3::-1]])
    np.testing.assert_allclose(drops[1:7], 1.0 - np.cos((np.arange(6) + 0.5) * math.pi / 6), rtol=1e-7)
    np.testing.assert_allclose(next_north[:4], drops[1:5], rtol=1e-7)
    assert (drops[0], drops[7], shares[0], shares[7]) == (0.0, 2.0, 0.0, 1.0)
    light = (pixels * scale).astype(np.float64)
    np.testing.assert_allclose(sums[1:7], (light @ [0.2126, 0.7152, 0.0722]).sum(axis=1), rtol=1e-5)
    # The mean over all directions: each row by the solid angle of the hat function around it.
    weights = np.concatenate([[drops[2] + drops[1]], drops[3:7] - drops[1:5], [4.0 - drops[6] - drops[5]]]) / 2.0
    np.testing.assert_allclose(table.radiance, weights @ light.mean(axis=1) / 2.0, rtol=1e-5)
    assert table.words[2] == 0.25


def test_black_pictures_are_no_light() -> None:
    table = table_of(np.zeros((2, 2, 3)))
    assert table.radiance == (0.0, 0.0, 0.0) and len(table.words) == 1
    what = Scene(camera=CAMERA, lights=(EnvironmentLight(type="environment", file="a"),))
    flat = flatten(what.with_files(environments={"a": EnvironmentPicture(np.zeros((2, 2, 3), np.float32))}), 8, 8)
    assert (flat.environment, flat.light_count) == (layout.NONE, 0)


def test_a_scale_counts_for_a_constant_environment_too() -> None:
    what = {"type": "environment", "radiance": (1.0, 2.0, 3.0), "scale": 2.0, "rotate_degrees": 90.0}
    flat = flatten(Scene.model_validate({"camera": CAMERA, "lights": [what]}), 8, 8)
    assert flat.arrays["lights"]["radiance"][0, :3].tolist() == [2.0, 4.0, 6.0]
    assert len(flat.arrays["environment_map"]) == 1


@pytest.mark.parametrize("how", ["even", "picture", "even picture"])
@pytest.mark.parametrize("light_sampler", ["power", "bvh"])
def test_what_is_left_to_the_bsdf_is_not_chosen(how: str, light_sampler: str) -> None:
    """Beside other lights, before and after it; a picture keeps what of it is above the mean."""
    around = {"type": "environment", **({"radiance": (1, 1, 1)} if how == "even" else {"file": "a"})}
    lamps = [{"type": "point", "position": (x, 2, 0), "intensity": (1, 1, 1)} for x in (-1, 1)]
    ball = {"type": "sphere", "center": (0, 0, 0), "radius": 1}
    what = Scene.model_validate({"camera": CAMERA, "shapes": [ball], "lights": [lamps[0], around, lamps[1]]})
    pixels = np.ones((4, 8, 3), np.float32)
    if how == "picture":
        pixels[0, 0] = 100.0
    if how != "even":
        what = what.with_files(environments={"a": EnvironmentPicture(pixels)})
    whole = flatten(what, 8, 8, light_sampler)
    assert (whole.light_count, whole.environment) == (3, 1)
    assert whole.arrays["lights"]["probability"].sum() == pytest.approx(1.0)
    flat = flatten(what, 8, 8, light_sampler, compensated=True)
    lights = flat.arrays["lights"]
    assert len(lights) == 3 and lights["kind"][flat.environment] == layout.LIGHT_ENVIRONMENT
    assert lights["probability"].sum() == pytest.approx(1.0)
    if how == "picture":
        assert (flat.light_count, flat.environment) == (3, 1)
        assert 0.0 < lights["probability"][1] < whole.arrays["lights"]["probability"][1]
    else:
        assert (flat.light_count, flat.environment) == (2, 2)
        assert (lights["probability"][2], lights["place"][2]) == (0.0, layout.NONE)


@pytest.mark.parametrize("ending", [".hdr", ".exr", ".png"])
def test_a_scene_counts_by_the_pixels_and_not_by_the_name(tmp_path: Path, ending: str) -> None:
    pixels = np.random.default_rng(4).random((3, 5, 3)).astype(np.float32)
    for name in ("a", "b"):
        write_image(tmp_path / f"{name}{ending}", pixels, tone_map="srgb")
    write_image(tmp_path / f"c{ending}", pixels[::-1])
    for name in "abc":
        (tmp_path / f"{name}.toml").write_text(TEXT.format(f"{name}{ending}"))
    a, b, c = (load(tmp_path / f"{name}.toml") for name in "abc")
    assert a.sha256() == b.sha256() != c.sha256()
    assert a.content_sha256() == b.content_sha256() != c.content_sha256()
    picture = a.environment_picture()
    assert picture is not None
    tolerance = {".hdr": 1 / 128, ".exr": 0.0, ".png": 1 / 100}[ending]
    np.testing.assert_allclose(picture.pixels, pixels, atol=tolerance)


def test_a_job_carries_the_picture(tmp_path: Path) -> None:
    write_image(tmp_path / "a.hdr", np.random.default_rng(5).random((3, 5, 3)).astype(np.float32))
    (tmp_path / "a.toml").write_text(TEXT.format("a.hdr"))
    scene = load(tmp_path / "a.toml")
    text, assets = RenderJob.of(scene).to_json()
    assert len(assets) == 1 and "a.hdr" not in text
    again = RenderJob.from_json(text, assets)
    assert again.request() == RenderJob.of(scene).request()
    description, _ = scene_to_portable(scene)
    key, data = next(iter(assets.items()))
    for bad, problem in (({}, "missing"), ({key: data[:-30]}, "cannot be read"), ({"0" * 64: data}, "missing")):
        with pytest.raises(SceneError, match=rf"lights\[0\].file: the asset {key} .*{problem}"):
            scene_from_portable(description, bad)


def test_an_environment_for_a_scene_that_has_none(tmp_path: Path) -> None:
    folder = tmp_path / "elsewhere"
    folder.mkdir()
    write_image(folder / "a.hdr", np.ones((3, 5, 3), np.float32))
    lit = load("cornell").with_environment(folder / "a.hdr")
    assert lit.environment is not None and lit.environment_picture() is not None
    with pytest.raises(SceneError, match=r"lights\[0\]: is an environment already"):
        lit.with_environment(folder / "a.hdr")
    for name, problem in (("no.hdr", "does not exist"), ("a.psd", "no kind")):
        with pytest.raises(SceneError, match=f"the environment: .*{name}.* {problem}"):
            load("cornell").with_environment(folder / name)


def test_a_picture_that_is_too_large_takes_no_memory(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("clrender.scene.environment._PIXEL_LIMIT", 14)
    for ending in (".hdr", ".exr", ".png"):
        write_image(tmp_path / f"a{ending}", np.ones((3, 5, 3), np.float32))
        with pytest.raises(SceneError, match="5 x 3 pixels are not between 1 and 14"):
            EnvironmentPicture.read(f"a{ending}", tmp_path, (), "x")
