"""`clrender render --shard` and `clrender merge`: parts of one render, put together in any order, are the render."""

from __future__ import annotations

import itertools
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cases import for_each
from cli_support import call
from PIL import Image

from clrender.errors import RenderError
from clrender.film import Film
from clrender.film.merge import merge_films
from clrender.image.files import image_sha256, read_image, read_provenance
from clrender.rendering.rendered_image import RenderedImage

SIZE = ("--size", "37x22", "--spp", "8", "--quiet")


@pytest.fixture(scope="module")
def shards(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a whole render and its three shards, cut in other ways."""
    folder = tmp_path_factory.mktemp("shards")
    assert call("render", "room", "-o", "whole.film", *SIZE, folder=folder).returncode == 0
    for number, tile in ((1, 4), (2, 16), (3, 64)):
        done = call(
            "render", "room", "-o", f"{number}.film", "--shard", f"{number}/3", "--tile", str(tile), *SIZE,
            folder=folder,
        )  # fmt: skip
        assert done.returncode == 0, done.stderr
    return folder


@pytest.mark.thorough
@for_each("order", list(itertools.permutations("123")))
def test_shards_in_any_order_are_the_render(shards: Path, order: tuple[str, ...]) -> None:
    output = f"merged-{''.join(order)}.film"
    done = call("merge", *(f"{number}.film" for number in order), "-o", output, folder=shards)
    assert (done.returncode, done.stderr) == (0, "")
    whole, merged = Film.load(shards / "whole.film"), Film.load(shards / output)
    np.testing.assert_array_equal(np.concatenate(merged.bands()), np.concatenate(whole.bands()))
    assert merged.ledger == whole.ledger and merged.request == whole.request
    for name in ("image_sha256", "samples", "rays", "spp", "scene_sha256", "kernel_sha256", "nonfinite_samples"):
        assert merged.provenance[name] == whole.provenance[name], name


def test_each_output_is_tried(shards: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    save = RenderedImage.save

    def full(self: RenderedImage, path: Path, *arguments: Any, **more: Any) -> None:
        if path.suffix == ".png":
            raise RenderError(f"{path.name}: no room.")
        save(self, path, *arguments, **more)

    monkeypatch.setattr(RenderedImage, "save", full)
    outputs = [argument for name in ("a.png", "b.exr", "c.png") for argument in ("-o", str(tmp_path / name))]
    done = call("merge", "whole.film", *outputs, folder=shards)
    assert (done.returncode, done.stderr) == (1, "error: a.png: no room\nerror: c.png: no room\n")
    assert not done.stdout and (tmp_path / "b.exr").exists()


def test_layers_that_films_do_not_hold_are_not_told(tmp_path: Path) -> None:
    outputs = ("-o", "a.exr", "-o", "a.film", "-o", "a.png")
    made = call("render", "sky", *SIZE, "--alpha", "--aov", "depth", *outputs, folder=tmp_path)
    assert made.returncode == 0, made.stderr
    assert call("merge", "a.film", "-o", "b.exr", folder=tmp_path).returncode == 0
    assert call("tonemap", "a.exr", "-o", "b.png", folder=tmp_path).returncode == 0
    told = [(read_provenance(tmp_path / name) or {}).get("layers") for name in ("a.exr", "b.exr", "b.png")]
    assert told == [["depth", "alpha"], None, ["alpha"]]
    rendered, mapped = (np.asarray(Image.open(tmp_path / name)) for name in ("a.png", "b.png"))
    assert rendered.shape[2] == 4 and 0 < rendered[..., 3].mean() < 255
    np.testing.assert_array_equal(mapped, rendered)
    assert call("verify", "b.png", "--fraction", "1", folder=tmp_path).returncode == 0


@for_each("nonsense", ["many", None, [1], True, float("nan"), -5, 10**30])
def test_numbers_that_make_no_sense_do_not_count(shards: Path, tmp_path: Path, nonsense: Any) -> None:
    """They are no part of the image."""
    film = Film.load(shards / "1.film")
    names = ("samples", "rays", "shadow_rays", "render_seconds", "max_depth", "devices")
    film.save(tmp_path / "odd.film", {**film.provenance, **dict.fromkeys(names, nonsense)})
    merged = merge_films([tmp_path / "odd.film", shards / "2.film"])
    other = Film.load(shards / "2.film").provenance
    assert {name: merged.provenance[name] for name in names} == {name: other[name] for name in names}


@pytest.mark.thorough
def test_images_of_merged_shards_are_those_of_the_render(shards: Path) -> None:
    """In every format, from any number of films at once; they can be verified as a render's can."""
    assert call("render", "room", *SIZE, *outputs("whole"), folder=shards).returncode == 0
    done = call("merge", "3.film", "1.film", "2.film", *outputs("merged"), "-o", "united.film", folder=shards)
    assert (done.returncode, done.stderr) == (0, "")
    again = call("merge", "united.film", *outputs("again"), folder=shards)
    assert again.returncode == 0 and "of 1 film, image sha256" in again.stdout
    for ending in ("exr", "npy", "hdr"):
        wanted = read_image(shards / f"whole.{ending}")
        for name in ("merged", "again"):
            np.testing.assert_array_equal(read_image(shards / f"{name}.{ending}"), wanted, ending)
    assert done.stdout.strip().endswith(image_sha256(read_image(shards / "whole.exr")))
    with Image.open(shards / "whole.png") as whole, Image.open(shards / "merged.png") as merged:
        np.testing.assert_array_equal(np.asarray(merged), np.asarray(whole))
    for name in ("merged.exr", "merged.png", "again.exr"):
        done = call("verify", name, "--fraction", "1", folder=shards)
        assert done.returncode == 0, done.stdout + done.stderr


def outputs(name: str) -> list[str]:
    return [part for ending in ("exr", "npy", "hdr", "png") for part in ("-o", f"{name}.{ending}")]


@pytest.mark.thorough
def test_the_image_of_one_film_is_for_display_or_linear(shards: Path, tmp_path: Path) -> None:
    """As by `tonemap`, with the options of a photograph; the image of a shard knows its samples."""
    tone = ("--tone-map", "agx", "--exposure", "1.5", "--f-stop", "4", "--shutter", "1/60", "--iso", "400")
    film = str(shards / "2.film")
    for command, output in (("merge", "a.png"), ("tonemap", "b.png")):
        done = call(command, film, "-o", output, *tone, folder=tmp_path)
        assert done.returncode == 0, done.stderr
    assert (tmp_path / "a.png").stat().st_size > 200
    with Image.open(tmp_path / "a.png") as a, Image.open(tmp_path / "b.png") as b:
        np.testing.assert_array_equal(np.asarray(a), np.asarray(b))
    done = call("merge", film, "-o", "a.exr", "--exr-type", "half", folder=tmp_path)
    assert done.returncode == 0, done.stderr
    told = read_provenance(tmp_path / "a.exr")
    assert told is not None and told["stored"]["exr_type"] == "half"
    assert (told["first_sample"], told["sample_count"], told["spp"]) == (2, 3, 8)
    done = call("verify", "a.exr", "--fraction", "1", folder=tmp_path)
    assert done.returncode == 0, done.stdout + done.stderr
    done = call("tonemap", film, "-o", "linear.exr", folder=tmp_path)
    assert done.returncode == 2 and f"`clrender merge {film} -o linear.exr` writes the linear image" in done.stderr


def test_a_missing_shard_is_told(shards: Path, tmp_path: Path) -> None:
    whole = call("merge", "1.film", "2.film", "3.film", "-o", str(tmp_path / "a.npy"), folder=shards).stdout
    asked = Film.load(shards / "whole.film").provenance["spp"]
    assert f", {asked} samples per pixel, of 3 films" in whole
    part = call("merge", "1.film", "3.film", "-o", str(tmp_path / "b.npy"), folder=shards).stdout
    held = int(Film.load(shards / "1.film").ledger.taken().max() + Film.load(shards / "3.film").ledger.taken().max())
    assert held < asked and f", {held} of {asked} samples per pixel, of 2 films" in part


def test_images_of_gaps_are_verified_by_their_film(shards: Path, tmp_path: Path) -> None:
    exr, film = str(tmp_path / "gap.exr"), str(tmp_path / "gap.film")
    assert call("merge", "1.film", "3.film", "-o", exr, "-o", film, folder=shards).returncode == 0
    done = call("verify", exr)
    assert done.returncode == 2
    assert "was merged from films between which parts are missing" in done.stderr
    assert "verify its .film" in done.stderr
    done = call("verify", film)
    assert done.returncode == 0, done.stderr


def refused(folder: Path, *arguments: str) -> str:
    before = sorted(folder.iterdir())
    done = call("merge", *arguments, "-o", "refused.film", folder=folder)
    assert done.returncode == 2 and done.stderr.startswith("error: ") and done.stderr.count("\n") == 1, done.stderr
    assert sorted(folder.iterdir()) == before
    return done.stderr


@pytest.mark.thorough
def test_what_does_not_go_together_is_refused_with_both_names(shards: Path) -> None:
    assert "1.film and 1.film overlap: samples 0 to 1" in refused(shards, "1.film", "1.film")
    assert "2.film and whole.film overlap" in refused(shards, "2.film", "whole.film")
    assert "3.film and 3.film overlap" in refused(shards, "1.film", "3.film", "3.film")
    assert call("render", "room", "-o", "seed.film", "--seed", "1", *SIZE, folder=shards).returncode == 0
    message = refused(shards, "1.film", "seed.film")
    assert "1.film and seed.film differ in seed: seed 0 and 1" in message
    done = call("render", "room", "-o", "filter.film", "--filter", "gaussian", "--shard", "2/3", *SIZE, folder=shards)
    assert done.returncode == 0, done.stderr
    assert "1.film and filter.film differ in filter" in refused(shards, "1.film", "filter.film")
    film = Film.load(shards / "2.film")
    film.request["kernel_sha256"] = "0" * 64
    film.save(shards / "kernels.film")
    message = refused(shards, "1.film", "kernels.film")
    assert "1.film and kernels.film differ in kernel_sha256" in message
    damaged = bytearray((shards / "2.film").read_bytes())
    damaged[len(damaged) // 2] ^= 4
    (shards / "damaged.film").write_bytes(damaged)
    assert "damaged.film: not a whole clrender film" in refused(shards, "1.film", "damaged.film")


@pytest.mark.thorough
def test_bad_uses_of_merge(shards: Path) -> None:
    for arguments in (
        ("1.film",),
        ("1.film", "-o", "a.bmp"),
        ("1.film", "-o", "a.exr", "--tone-map", "agx"),
        ("1.film", "-o", "a.png", "--exr-type", "half"),
        ("1.film", "-o", "a.film", "-o", "a.png", "--f-stop", "4"),
        ("1.film", "-o", "a.png", "-o", "a.png"),
        ("1.film", "-o", "1.film"),
        ("1.film", "-o", "no/a.film"),
    ):
        done = call("merge", *arguments, folder=shards)
        assert done.returncode == 2 and done.stderr.startswith("error: ") and "Traceback" not in done.stderr
    assert not list(shards.glob("a.*"))


@for_each("shard", ["0/3", "4/3", "1/9", "x/3", "1/0", "1", "1/2/3", "-1/3"])
def test_shards_that_there_are_not(tmp_path: Path, shard: str) -> None:
    done = call("render", "room", "-o", "a.film", "--shard", shard, *SIZE, folder=tmp_path)
    assert done.returncode == 2 and done.stderr.count("\n") == 1 and shard in done.stderr
    assert not list(tmp_path.iterdir())


def test_a_shard_goes_to_a_film(tmp_path: Path) -> None:
    done = call("render", "room", "-o", "a.png", "--shard", "1/2", *SIZE, folder=tmp_path)
    assert done.returncode == 2 and "a.png" in done.stderr and ".film" in done.stderr


def test_a_shard_says_which_samples_it_holds(shards: Path) -> None:
    held = [Film.load(shards / f"{number}.film") for number in (1, 2, 3)]
    assert [film.ledger.ranges(0, 0) for film in held] == [((0, 2),), ((2, 5),), ((5, 8),)]
    assert [film.provenance["sample_count"] for film in held] == [2, 3, 3]
    assert json.dumps(held[0].request, sort_keys=True) == json.dumps(held[2].request, sort_keys=True)
