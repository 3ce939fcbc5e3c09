"""The command line as a user meets it: help, versions, images in and out, and bad input in one sentence."""

from __future__ import annotations

import importlib
import json
import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from cases import for_each
from cli_support import call, run

from clrender.cli import COMMANDS
from clrender.cli.options import EXR_COMPRESSIONS, TONE_MAPS
from clrender.image.exr_write import COMPRESSIONS
from clrender.image.files import read_image, write_image
from clrender.image.tone_map import TONE_MAPS as OPERATORS

RENDER_OPTIONS = (
    "output spp size seed device integrator filter filter-radius shadow-rays indirect-rays max-depth roulette "
    "termination sampling light-sampler kernels code reuse photons photon-radius light-paths guiding guiding-paths "
    "guiding-memory guiding-field save-guiding-field specular-chains spectral no-spectral spectrum patches patch-rays "
    "radiosity-display tone-map ocio display view exposure aov denoise tile "
    "f-stop shutter iso environment time-at frames fps variant samples-per-pass work-group lanes time shard stats "
    "quiet allow-path plugin strict up define camera crop alpha hide-environment light-groups amodal "
    "exr-type exr-compression exr-tile checkpoint resume max-memory cluster "
    "replicate-spp error confidence share error-floor progress preview"
)


def assert_refused(result: subprocess.CompletedProcess[str], *words: str, code: int = 2) -> None:
    """One sentence on stderr that has these words, no traceback, and this exit code."""
    assert result.returncode == code, result.stderr
    assert result.stderr.startswith("error: ") and result.stderr.count("\n") == 1, result.stderr
    assert all(word in result.stderr for word in words), result.stderr
    assert not result.stdout


# --- help and version ------------------------------------------------------------------------------------------------


def test_version() -> None:
    result = run("--version")
    assert result.returncode == 0 and re.match(r"clrender \d+\.\d+\.\d+\S*\n", result.stdout)


def test_help_lists_every_command() -> None:
    result = run("--help")
    assert result.returncode == 0 and not result.stderr
    for again in (call("--help"), call()):
        assert (again.returncode, again.stdout, again.stderr) == (0, result.stdout, "")
    for name, line in COMMANDS.items():
        assert re.search(rf"^  {name} +{re.escape(line.split()[0])}", result.stdout, re.MULTILINE)


@for_each("name", COMMANDS)
def test_every_command_exists_and_has_help(name: str) -> None:
    result = call(name, "-h")
    assert result.returncode == 0 and result.stdout.startswith(f"Usage: clrender {name}")


def test_help_names_the_options_of_render_that_exist() -> None:
    text = call("render", "--help").stdout
    found = set(re.findall(r"--[a-z-]+", text)) - {"--help"}
    assert found == {f"--{name}" for name in RENDER_OPTIONS.split()}


def test_no_command_is_loaded_for_help_or_version() -> None:
    code = "import sys; from clrender.cli import main\ntry: main([{!r}])\nfinally: print(*sys.modules, file=sys.stderr)"
    for option in ("--help", "--version"):
        result = subprocess.run(
            [sys.executable, "-c", code.format(option)], capture_output=True, text=True, timeout=60, check=False
        )
        heavy = {"numpy", "pyopencl", "PIL", "pydantic", "rich", "OpenEXR"} & set(result.stderr.split())
        assert not heavy


def test_names_without_numpy_are_the_names_there_are() -> None:
    assert TONE_MAPS == OPERATORS
    assert tuple(COMPRESSIONS) == EXR_COMPRESSIONS
    for name in COMMANDS:
        assert hasattr(importlib.import_module(f"clrender.cli.{name}"), name)


# --- bad input -------------------------------------------------------------------------------------------------------

BAD_COMMAND_LINES: dict[str, tuple[str, tuple[str, ...]]] = {
    "unknown command": ("rendr room -o a.png", ("'rendr'", "did you mean 'render'?")),
    "unknown command, nothing near": ("xyzzy", ("'xyzzy'", "choose one of render, view")),
    "unknown option": ("render room -o a.png --sp 4", ("--sp", "--spp")),
    "misspelt option": ("render room -o a.png --shadow-ray 4", ("--shadow-ray", "--shadow-rays")),
    "unknown option of the program": ("--verson", ("--verson", "--version")),
    "no output": ("render room", ("'--output'", "missing")),
    "no scene": ("render -o a.png", ("SCENE", "missing")),
    "too many scenes": ("render room cornell -o a.png", ("cornell",)),
    "option without value": ("render room -o a.png --spp", ("--spp",)),
    "no samples": ("render room -o a.png --spp 0", ("--spp", "'0'", "at least 1")),
    "negative samples": ("render room -o a.png --spp -3", ("--spp", "'-3'", "at least 1")),
    "half a sample": ("render room -o a.png --spp 1.5", ("--spp", "'1.5'", "whole number")),
    "too many samples": ("render room -o a.png --spp 99999999999", ("--spp", "at most 1048576")),
    "a very long number": (f"render room -o a.png --spp {'9' * 5000}", ("--spp", "at most 1048576")),
    "samples in words": ("render room -o a.png --spp many", ("--spp", "'many'", "whole number")),
    "size without cross": ("render room -o a.png --size 800", ("--size", "'800'", "800x600")),
    "size of nothing": ("render room -o a.png --size 0x600", ("--size", "width of '0x600' is 0", "at least 1")),
    "negative size": ("render room -o a.png --size -8x6", ("--size", "'-8x6'", "800x600")),
    "too wide": ("render room -o a.png --size 65537x1", ("--size", "width of '65537x1'", "at most 65536")),
    "too large": ("render room -o a.png --size 65536x65536", ("--size", "1,073,741,824 pixels")),
    "size with three sides": ("render room -o a.png --size 8x6x4", ("--size", "'8x6x4'")),
    "negative seed": ("render room -o a.png --seed -1", ("--seed", "at least 0")),
    "seed of 33 bits": ("render room -o a.png --seed 4294967296", ("--seed", "at most 4294967295")),
    "unknown integrator": (
        "render room -o a.png --integrator pathh",
        ("--integrator", "'pathh'", "did you mean 'path'?"),
    ),
    "no such integrator": ("render room -o a.png --integrator metropolis", ("--integrator", "path, bdpt, direct")),
    "no shadow rays": ("render room -o a.png --shadow-rays 0", ("--shadow-rays", "at least 1")),
    "negative indirect rays": ("render room -o a.png --indirect-rays -1", ("--indirect-rays", "at least 0")),
    "negative depth": ("render room -o a.png --max-depth -1", ("--max-depth", "at least 0")),
    "unknown roulette": ("render room -o a.png --roulette russian", ("--roulette", "throughput, constant or none")),
    "certain termination": ("render room -o a.png --termination 1", ("--termination", "below 1")),
    "termination that is none": ("render room -o a.png --termination nan", ("--termination", "'nan'")),
    "certain termination by its former name": ("render room -o a.png --absorption 1", ("--absorption", "below 1")),
    "termination by both names": (
        "render room -o a.png --termination 0.5 --absorption 0.5",
        ("absorption is the former name of termination", "leave one of them out"),
    ),
    "unknown tone map": ("render room -o a.png --tone-map filmic", ("--tone-map", "'filmic'", "aces or agx")),
    "endless exposure": ("render room -o a.png --exposure inf", ("--exposure", "'inf'", "at most 128")),
    "f-stop of nothing": ("render room -o a.png --f-stop 0", ("--f-stop", "at least 0.1")),
    "shutter by nothing": ("render room -o a.png --f-stop 8 --shutter 1/0", ("--shutter", "'1/0'", "at least 1e-06")),
    "half an exposure": ("render room -o a.png --f-stop 8", ("f_stop", "without shutter", "give f_stop and shutter")),
    "photograph of linear images": ("render room -o a.exr --iso 100", ("--iso", ".png and .jpg")),
    "unknown filter": (
        "render room -o a.png --filter lanczos",
        ("--filter", "box, tent, gaussian, blackman-harris or mitchell"),
    ),
    "no tile": ("render room -o a.png --tile 0", ("--tile", "at least 1")),
    "no samples in a pass": ("render room -o a.png --samples-per-pass 0", ("--samples-per-pass", "at least 1")),
    "no work-group": ("render room -o a.png --work-group 0", ("--work-group", "at least 1")),
    "three lanes": ("render room -o a.png --lanes 3", ("--lanes", "1, 4, 8 or 16")),
    "no time": ("render room -o a.png --time 0", ("--time", "above 0")),
    "time that is none": ("render room -o a.png --time nan", ("--time", "'nan'", "above 0")),
    "endless time": ("render room -o a.png --time inf", ("--time", "'inf'")),
    "settings of another integrator": (
        "render room -o a.png --photons 9",
        ("photons has no effect with the integrator path", "belongs to photon"),
    ),
    "termination without its roulette": (
        "render room -o a.png --termination 0.5",
        ("termination has no effect with the roulette throughput",),
    ),
    "termination by its former name without its roulette": (
        "render room -o a.png --absorption 0.5",
        ("absorption has no effect with the roulette throughput",),
    ),
    "light BVH for photons": (
        "render room -o a.png --integrator photon --light-sampler bvh",
        ("light_sampler is 'bvh'", "photon takes auto, power or uniform"),
    ),
    "exposure of linear images": ("render room -o a.exr --exposure 1", ("--exposure", ".png and .jpg")),
    "tone map of sums": ("render room -o a.film --tone-map aces", ("--tone-map", ".png and .jpg")),
    "denoised sums": ("render room -o a.film --denoise", ("--denoise", ".film")),
    "no such allowed folder": ("render room -o a.png --allow-path nowhere", ("--allow-path", "nowhere")),
    "unknown ending": ("render room -o a.gif", ("a.gif", "'.gif'", ".png")),
    "no ending": ("render room -o a", ("no ending", ".film")),
    "no such folder": ("render room -o nowhere/a.png", ("nowhere/a.png", "create it")),
    "a folder": ("render room -o .", (".:", "ending")),
    "one output twice": ("render room -o a.png -o ./a.png", ("a.png", "twice")),
    "unknown layer": ("render room -o a.exr --aov albedo,dept", ("'dept'", '"depth"')),
    "no layer": ("render room -o a.exr --aov=", ("--aov is ''", "albedo, emission")),
    "layers nowhere to go": ("render room -o a.png --aov depth", ("--aov", "only .exr", "-o image.exr")),
    "alpha nowhere to go": ("render room -o a.jpg --aov alpha", ("--aov alpha", "only .png and .exr", "-o image.png")),
    "a wide .jpg": ("render room -o a.jpg --size 65501x1", ("a.jpg", "65500 pixels a side", "65501 x 1", ".png")),
    "a place that takes no files": ("render room -o /proc/a.png", ("/proc/a.png", "'/proc' takes no files")),
    "tiles of no .exr": ("render room -o a.png --exr-tile 64", ("--exr-tile", "no output is an .exr")),
    "unknown compression": ("render room -o a.exr --exr-compression zipp", ("--exr-compression", "'zip'")),
    "tiles that are too small": ("render room -o a.exr --exr-tile 8", ("--exr-tile", "16")),
    "mattes that would be lost": (
        "render room -o a.exr --aov crypto_object --exr-compression pxr24",
        ("exr_compression", "crypto_object", "zip"),
    ),
    "statistics nowhere": ("render room -o a.png --stats nowhere/s.json", ("nowhere/s.json", "create it")),
    "tonemap of nothing": ("tonemap nothing.npy -o a.png", ("nothing.npy", "no such file")),
    "tonemap of a display image": ("tonemap a.png -o b.png", ("a.png", "linear image")),
    "tonemap to a linear file": ("tonemap good.npy -o b.exr", ("b.exr", ".png")),
    "tonemap without output": ("tonemap good.npy", ("'--output'",)),
    "tonemap of what is no image": ("tonemap text.npy -o a.png", ("text.npy", "not a readable .npy image")),
    "tonemap of what is no film": ("tonemap text.film -o a.png", ("text.film", "not a whole clrender film")),
    "tonemap of an empty file": ("tonemap empty.exr -o a.png", ("empty.exr", "the file is empty", "name another")),
    "merge of no films": ("merge good.npy -o a.film", ("good.npy", "not a whole clrender film", "name a .film")),
    "an empty film": ("merge empty.film -o a.film", ("empty.film", "the file is empty")),
    "an unknown layer that is like none": (
        "render room -o a.exr --aov xyzzy",
        ("no layer 'xyzzy'; there are alpha, ",),
    ),
    "an unknown scene that is like none": ("render xyzzy -o a.png", ('scene "xyzzy"', "`clrender scenes` lists them")),
    "more shards than samples": (
        "render room -o a.film --spp 1 --shard 1/2",
        ("1 sample a pixel makes at most 1 shard", "more samples"),
    ),
    "tonemap twice to one file": ("tonemap good.npy -o a.png -o ./a.png", ("a.png", "twice")),
    "tonemap of a pipe": ("tonemap pipe.npy -o a.png", ("pipe.npy", "only regular files")),
    "tonemap of a film that is a pipe": ("tonemap pipe.film -o a.png", ("pipe.film", "a pipe")),
    "tonemap of a folder": ("tonemap folder.npy -o a.png", ("folder.npy", "is a folder")),
    "compare with a pipe": ("compare good.npy pipe.npy", ("pipe.npy", "a pipe")),
    "render a pipe": ("render pipe.toml -o a.png", ("pipe.toml", "pipe")),
    "check a device": ("check device.toml", ("device.toml", "device")),
    "compare with nothing": ("compare good.npy nothing.exr", ("nothing.exr", "no such file")),
    "compare one": ("compare good.npy", ("'B'",)),
    "compare sizes": ("compare good.npy small.npy", ("4 x 3 and 2 x 2",)),
    "compare with a seed": ("compare good.npy good.npy --seed 0", ("--seed goes with --integrators",)),
    "compare with a scene": ("compare good.npy room", ("room: the name has no ending", ".film")),
    "compare what is not finite": ("compare good.npy nan.npy", ("1 pixel that is not finite",)),
}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Some images, good and bad."""
    folder = tmp_path_factory.mktemp("images")
    write_image(folder / "good.npy", np.ones((3, 4, 3)))
    write_image(folder / "small.npy", np.ones((2, 2, 3)))
    for name in ("empty.exr", "empty.film"):
        (folder / name).touch()
    odd = np.ones((3, 4, 3))
    odd[1, 1] = np.nan
    write_image(folder / "nan.npy", odd)
    (folder / "text.npy").write_text("hello")
    (folder / "text.film").write_text("hello")
    (folder / "folder.npy").mkdir()
    for name in ("pipe.npy", "pipe.film", "pipe.toml"):
        os.mkfifo(folder / name)
    (folder / "device.toml").symlink_to("/dev/zero")
    return folder


@for_each("case", BAD_COMMAND_LINES)
def test_bad_command_lines_are_refused_in_one_sentence(case: str, folder: Path) -> None:
    line, words = BAD_COMMAND_LINES[case]
    before = sorted(folder.iterdir())
    assert_refused(call(*line.split(), folder=folder), *words)
    assert sorted(folder.iterdir()) == before


def test_a_process_refuses_a_bad_command_line_as_well(folder: Path) -> None:
    assert_refused(run("render", "room", "-o", "a.gif", folder=folder), "a.gif", "'.gif'", ".png")


# --- tonemap and compare ---------------------------------------------------------------------------------------------


def test_tonemap_makes_the_display_image(tmp_path: Path) -> None:
    image = np.random.default_rng(0).random((5, 7, 3)).astype(np.float32)
    write_image(tmp_path / "a.exr", image, {"seed": 1})
    result = call("tonemap", "a.exr", "-o", "a.png", "--tone-map", "agx", "--exposure", "1.5", folder=tmp_path)
    assert result.returncode == 0 and "7x5" in result.stdout and not result.stderr
    stored = {"tone_map": "agx", "exposure": 1.5}
    write_image(tmp_path / "b.png", image, {"seed": 1, "stored": stored}, "agx", 1.5)
    assert (tmp_path / "a.png").read_bytes() == (tmp_path / "b.png").read_bytes()


def test_tonemap_writes_every_output(tmp_path: Path) -> None:
    write_image(tmp_path / "a.npy", np.full((5, 7, 3), 0.25))
    result = call("tonemap", "a.npy", "-o", "a.png", "-o", "b.jpg", folder=tmp_path)
    assert result.returncode == 0 and result.stdout.count("7x5") == 2
    assert read_image(tmp_path / "a.png").shape == read_image(tmp_path / "b.jpg").shape == (5, 7, 3)


def test_compare_prints_a_table_or_json(tmp_path: Path) -> None:
    image = np.random.default_rng(0).random((20, 30, 3)).astype(np.float32)
    write_image(tmp_path / "a.npy", image * 1.5)
    write_image(tmp_path / "b.exr", image)
    table = call("compare", "a.npy", "b.exr", folder=tmp_path)
    assert table.returncode == 0 and re.search(r"^difference of means +0\.5$", table.stdout, re.MULTILINE)
    numbers = json.loads(call("compare", "a.npy", "b.exr", "--json", folder=tmp_path).stdout)
    assert numbers["difference_of_means"] == pytest.approx(0.5, abs=1e-6) and not numbers["identical"]
    assert {"mean", "rmse", "relmse", "mean_relative_difference", "flip"} <= set(numbers)
    assert json.loads(call("compare", "b.exr", "b.exr", "--json", folder=tmp_path).stdout)["identical"]


def test_compare_knows_of_alpha(tmp_path: Path) -> None:
    """Colours are compared over black, and coverage beside them."""
    covered = np.where(np.arange(30) < 15, 1.0, 0.5).astype(np.float32) * np.ones((20, 1), np.float32)
    image = np.repeat(covered[..., None], 3, axis=2) * np.float32(0.5)
    write_image(tmp_path / "a.png", image, alpha=covered)
    write_image(tmp_path / "b.png", image)
    write_image(tmp_path / "a.exr", image, channels={"A": covered})
    write_image(tmp_path / "b.exr", image, channels={"A": np.ones_like(covered)})
    for line in ("a.png b.png", "a.exr b.exr", "a.exr a.exr"):
        names = line.split()
        found = call("compare", *names, "--json", folder=tmp_path)
        numbers, same = json.loads(found.stdout), names[0] == names[1]
        assert numbers["max_alpha_difference"] == pytest.approx(0.0 if same else 0.5, abs=0.003)
        assert numbers["identical"] == same and numbers["max_difference"] < 0.01
        assert ("b.png has none" in found.stderr) == (names[1] == "b.png")


# --- bench -----------------------------------------------------------------------------------------------------------


def test_bench_prints_a_line_a_run_and_a_table() -> None:
    result = call("bench", "S1", "--size", "16x16", "--spp", "1", "--repeats", "2")
    assert result.returncode == 0, result.stderr
    lines = [json.loads(line) for line in result.stdout.splitlines()]
    assert [(line["scene"], line["renderer"], line["repeat"]) for line in lines] == [
        ("S1", "clrender", k) for k in (0, 1)
    ]
    assert lines[0]["image_sha256"] != lines[1]["image_sha256"], "each turn has a seed of its own"
    assert lines[0]["paths"] == 256 and lines[0]["mpaths_per_second"] > 0
    assert re.search(r"^S1 +clrender +\d", result.stderr, re.M)


def test_bench_refuses_what_it_does_not_know() -> None:
    assert_refused(call("bench", "S9"), "S9", "S3-1M")
    assert_refused(call("bench", "S1", "--peer", "blender=python"), "blender", "mitsuba")
    assert "S3-4M" in call("bench", "--list").stdout
