"""Sequences of images: names, what is kept of them, and that each is the image that is rendered alone."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cli_support import call

import clrender
from clrender.cli.frames import Frames, is_done
from clrender.image.files import read_image, write_image
from clrender.rendering.job import RenderJob
from clrender.rendering.statistics import job_stats, layer_stats

SCENE = """
[camera]
position = [0.0, 1.5, 4.0]
target = [0.0, 0.6, 0.0]
[materials.w]
type = "lambert"
reflectance = [0.7, 0.6, 0.5]
[[shapes]]
type = "box"
center = [0, 0.3, 0]
size = [0.6, 0.6, 0.6]
material = "w"
motion = [{time = 0.0, translate = [-1.5, 0, 0]}, {time = 1.0, translate = [1.5, 0, 0], rotate_degrees = [0, 90, 0]}]
[[lights]]
type = "environment"
radiance = [1, 1, 1]
"""
SMALL = ("--size", "24x16", "--spp", "2", "--quiet")


@pytest.fixture
def scene(tmp_path: Path) -> Path:
    path = tmp_path / "scene.toml"
    path.write_text(SCENE)
    return path


def hashes(text: str) -> dict[str, str]:
    """Hashes of images by frame, of what the command prints."""
    return dict(re.findall(r"frame (-?\d+): .*image sha256 ([0-9a-f]{64})", text))


def test_a_note_on_the_scene_comes_once(scene: Path, tmp_path: Path) -> None:
    scene.write_text(SCENE.partition("[[lights]]")[0])
    result = call("render", str(scene), "--frames", "0:2", "-o", str(tmp_path / "f%d.png"), *SMALL[:-1])
    assert result.returncode == 0, result.stderr
    assert result.stderr.count("nothing in it emits light") == 1 and result.stdout.count("frame ") == 3


def test_frames_are_what_is_rendered_alone(scene: Path, tmp_path: Path) -> None:
    names = ["-o", str(tmp_path / "f_%03d.png"), "-o", str(tmp_path / "f_%03d.exr")]
    result = call("render", str(scene), "--frames", "-1:7:4", "--fps", "8", "--shutter", "0:1/16", *names, *SMALL)
    assert result.returncode == 0, result.stderr
    found = hashes(result.stdout)
    assert list(found) == ["-1", "3", "7"]
    assert sorted(path.name for path in tmp_path.glob("f_*")) == [
        f"f_{number}.{ending}" for number in ("-01", "003", "007") for ending in ("exr", "png")
    ]
    for frame, digest in found.items():
        still = clrender.load(scene, time_at=int(frame) / 8, shutter=(0.0, 1.0 / 16))
        assert clrender.render(still, size=(24, 16), spp=2).stats["image_sha256"] == digest
    verified = call("verify", str(tmp_path / "f_003.png"), "--fraction", "1", "--json")
    assert json.loads(verified.stdout)["sound"]


def test_frames_that_are_done_are_kept(scene: Path, tmp_path: Path) -> None:
    pattern = str(tmp_path / "f_%d.png")

    def rendered(*more: str) -> list[str]:
        result = call("render", str(scene), "--frames", "0:3", "-o", pattern, *SMALL, *more)
        assert result.returncode == 0, result.stderr
        return list(hashes(result.stdout))

    assert rendered() == ["0", "1", "2", "3"]
    assert rendered("--resume") == []
    (tmp_path / "f_1.png").unlink()
    (tmp_path / "f_2.png").write_bytes(b"half of a picture")
    assert rendered("--resume") == ["1", "2"]
    assert rendered("--resume", "--tone-map", "agx") == ["0", "1", "2", "3"]
    assert rendered("--resume", "--tone-map", "agx", "--seed", "3") == ["0", "1", "2", "3"]
    scene.write_text(SCENE.replace("time = 1.0", "time = 2.0"))
    assert rendered("--resume", "--tone-map", "agx", "--seed", "3") == ["0", "1", "2", "3"]


OF_ERROR = ("--replicate-spp", "4", "--spp", "256")
KEPT = (
    ("png", ("--f-stop", "8", "--shutter", "1/60"), ("--f-stop", "4", "--shutter", "1/60")),
    ("exr", ("--aov", "depth,albedo"), ("--aov", "depth,uv")),
    *(
        pytest.param(*case, marks=pytest.mark.long)
        for case in (
            ("png", (*OF_ERROR, "--error", "0.5"), (*OF_ERROR, "--error", "0.0001")),
            ("exr", ("--light-groups",), ("--light-groups", "--aov", "depth")),
            ("exr", ("--hide-environment",), ("--alpha",)),
        )
    ),
)


@pytest.mark.parametrize(("ending", "first", "then"), KEPT, ids=lambda each: str(each)[:30])
def test_frames_are_kept_if_they_hold_what_is_asked(
    scene: Path, tmp_path: Path, ending: str, first: tuple[str, ...], then: tuple[str, ...]
) -> None:
    """Exposures of the camera, errors that are reached before all samples are taken, and layers."""

    def rendered(*more: str) -> list[str]:
        pattern = str(tmp_path / f"f_%d.{ending}")
        result = call("render", str(scene), "--frames", "0:1", "-o", pattern, *SMALL, *more)
        assert result.returncode == 0, result.stderr
        return list(hashes(result.stdout))

    assert rendered(*first) == ["0", "1"]
    assert rendered(*first, "--resume") == []
    assert rendered(*then, "--resume") == ["0", "1"]


@pytest.mark.long
def test_frames_of_opencolorio_are_kept(scene: Path, tmp_path: Path) -> None:
    pytest.importorskip("PyOpenColorIO")
    ways = ["render", str(scene), "--frames", "0:0", "-o", str(tmp_path / "f_%d.png"), *SMALL, "--ocio", "builtin"]
    for more, made in ((), True), (("--resume",), False), (("--resume", "--view", "Un-tone-mapped"), True):
        result = call(*ways, *more)
        assert result.returncode == 0, result.stderr
        assert bool(hashes(result.stdout)) == made


def test_an_interruption_leaves_whole_frames(scene: Path, tmp_path: Path) -> None:
    arguments = ["render", str(scene), "--frames", "0:999", "-o", str(tmp_path / "f_%d.exr"), *SMALL]
    with subprocess.Popen([sys.executable, "-m", "clrender", *arguments], stderr=subprocess.PIPE, text=True) as process:
        deadline = time.monotonic() + 120.0
        while len(list(tmp_path.glob("f_*.exr"))) < 2 and time.monotonic() < deadline:
            time.sleep(0.02)
        process.send_signal(signal.SIGINT)
        _, told = process.communicate(timeout=60)
    assert process.returncode == 130 and "--resume keeps the others" in told
    made = list(tmp_path.glob("f_*"))
    assert len(made) >= 2
    for path in made:
        assert np.isfinite(read_image(path)).all()


SLEEPING = """
import sys, time
from clrender.rendering.session import Session
from clrender.cli import main
render, calls = Session.render, []
def slow(*arguments, **settings):
    calls.append(None)
    if len(calls) > {frames}:
        print("asleep", flush=True)
        time.sleep(60)
    return render(*arguments, **settings)
Session.render = slow
main(sys.argv[1:])
"""
"""The command line, whose second image takes a minute."""


@pytest.mark.parametrize(
    ("command", "frames", "told"),
    [
        ("render SCENE --frames 3:5 -o f_%d.png", 1, "interrupted before frame 4 was done; --resume keeps the others"),
        ("render SCENE --frames 3:5 -o f_%d.hdr", 1, "interrupted before frame 4 was done; the others are written"),
        ("render SCENE --frames 3:5 -o f_%d.png", 0, "interrupted before frame 3 was done; nothing was written"),
        ("render SCENE -o a.png", 0, "interrupted before the first sample; nothing was written"),
        ("compare SCENE --integrators path,direct --batches 8", 1, "interrupted; nothing was written"),
    ],
)
def test_an_interruption_says_what_is_lost(scene: Path, tmp_path: Path, command: str, frames: int, told: str) -> None:
    arguments = [*command.replace("SCENE", str(scene)).split(), "--size", "24x16", "--spp", "16", "--quiet"]
    code = SLEEPING.replace("{frames}", str(frames))
    paths = {"PYTHONPATH": str(Path(clrender.__path__[0]).parent)}
    with subprocess.Popen(
        [sys.executable, "-c", code, *arguments],
        cwd=tmp_path,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, **paths},
    ) as process:
        assert process.stdout is not None
        while "asleep" not in (line := process.stdout.readline()):
            assert line, process.communicate()
        process.send_signal(signal.SIGINT)
        _, said = process.communicate(timeout=60)
    assert process.returncode == 130 and said.strip() == f"error: {told}"


def test_frames_are_made_for_no_reader(scene: Path, tmp_path: Path) -> None:
    arguments = ["render", str(scene), "--frames", "0:3", "-o", str(tmp_path / "f_%d.png"), *SMALL]
    paths = {"PYTHONPATH": str(Path(clrender.__path__[0]).parent)}
    with subprocess.Popen(
        [sys.executable, "-m", "clrender", *arguments], stdout=subprocess.PIPE, env={**os.environ, **paths}
    ) as process:
        assert process.stdout is not None
        process.stdout.close()
        assert process.wait(timeout=120) == 0
    assert len(list(tmp_path.glob("f_*"))) == 4


def test_a_folder_may_be_named_with_a_percent_sign(scene: Path, tmp_path: Path) -> None:
    (tmp_path / "a%2Fb%d").mkdir()
    result = call("render", str(scene), "--frames", "1:1", "-o", str(tmp_path / "a%2Fb%d" / "f_%d.png"), *SMALL)
    assert result.returncode == 0 and (tmp_path / "a%2Fb%d" / "f_1.png").exists(), result.stderr


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--frames", "0:3", "-o", "x.png"), "one place for the number"),
        (("--frames", "0:3", "-o", "x_%d_%d.png"), "of the frame; write one such as x_%04d.png"),
        (("--frames", "0:3", "-o", "x_%s.png"), "one place for the number"),
        (("-o", "x_%04d.png"), "%04d stands for the number of a frame"),
        (("--frames", "3:0", "-o", "x_%d.png"), "0 frames"),
        (("--frames", "0:3:0", "-o", "x_%d.png"), "0 frames"),
        (("--frames", "all", "-o", "x_%d.png"), "no range of frames"),
        (("--frames", "0:3", "-o", "x_%d.png", "--checkpoint", "a.film"), "--checkpoint"),
        (("--frames", "0:3", "-o", "x_%d.png", "--time-at", "1"), "--time-at"),
        (("--frames", "0:3", "-o", "x_%d.hdr", "--resume"), ".png and .exr"),
        (("--fps", "3", "-o", "x.png"), "--frames"),
        (("--frames", "9:10", "-o", "x_%d.png", "-o", "x_%02d.png"), "x_10.png: is named twice as an output"),
        (("--frames", "0:3", "-o", "x_%d.exr", "-o", "x_%d.jpg", "--resume"), "display settings"),
        (("--frames", "0:3", "-o", "x_%d.png", "--time-at", "0"), "--time-at"),
        (("--frames", "0:3", "-o", "x_%d.png", "--time", "1"), "--time: is for one image"),
        (("--shutter", "1:0", "-o", "x.png"), "no interval"),
        (("--shutter", "0:x", "-o", "x.png"), "no interval"),
    ],
)
def test_what_is_refused(scene: Path, tmp_path: Path, arguments: tuple[str, ...], words: str) -> None:
    given = [str(tmp_path / each) if each.startswith("x") else each for each in arguments]
    result = call("render", str(scene), *given, *SMALL)
    assert result.returncode == 2 and words in result.stderr and result.stderr.count("\n") == 1, result.stderr
    assert not list(tmp_path.glob("x*"))


def test_numbers_of_frames() -> None:
    assert list(Frames(1, 6, 2)) == [1, 3, 5] and len(Frames(1, 6, 2)) == 3


LAYERED = SCENE.replace('material = "w"\n', 'material = "w"\nname = "ball"\ncategory = "toy"\n').replace(
    "[1, 1, 1]\n", '[1, 1, 1]\nlight_group = "sky"\n'
)
HOW = {"tone_map": "srgb", "exposure": 0.0, "exr_type": "float", "exr_compression": "zip", "exr_tile": None}
OF_NAMES = {"names_sha256"}
ASKED = (
    ({"aov": ("instance",)}, {"shapes[0].name": "moon"}, OF_NAMES),
    ({"aov": ("category",)}, {"shapes[0].category": "moon"}, OF_NAMES),
    ({"aov": ("crypto_object",)}, {"shapes[0].name": None}, OF_NAMES),
    ({"light_groups": True}, {"lights[0].light_group": "key"}, OF_NAMES),
    ({"aov": ("instance",), "amodal": "all"}, {"shapes[0].name": "moon"}, OF_NAMES),
    ({"aov": ("flow",)}, {"camera.flow_step": 0.25}, {"flow_step"}),
    ({"aov": ("scene_flow",)}, {"camera.flow_step": -0.5}, {"flow_step"}),
    ({"aov": ("part", "flow")}, {"camera.flow_step": 0.25}, {*OF_NAMES, "flow_step"}),
)


@pytest.mark.parametrize(
    ("asked", "change", "recorded"), ASKED, ids=lambda each: str(sorted(each) if isinstance(each, set) else each)[:40]
)
def test_frames_with_layers_of_other_names_are_not_done(
    scene: Path, tmp_path: Path, asked: dict[str, Any], change: dict[str, Any], recorded: set[str]
) -> None:
    """What the hash of the scene leaves out, since its image does not depend on it. Nothing is rendered."""
    scene.write_text(LAYERED)
    here = clrender.load(scene).changed({"camera.flow_step": 0.5})
    there = here.changed(change)
    assert there.sha256() == here.sha256()

    def job(scene: clrender.Scene, **layers: Any) -> RenderJob:
        return RenderJob.of(scene, size=(4, 3), spp=1, **layers)

    def is_kept(made: RenderJob, wanted: RenderJob) -> bool:
        stats = {**job_stats(made, made.request()), "samples": 12, "denoised": False}
        stored = {name: HOW[name] for name in ("exr_type", "exr_compression", "exr_tile")}
        path = tmp_path / "f_0.exr"
        write_image(path, np.zeros((3, 4, 3), np.float32), {**stats, "stored": stored})
        return is_done([path], wanted, HOW)

    made = job(here, **asked)
    assert {"names_sha256", "flow_step"} & job_stats(made, made.request()).keys() == recorded
    assert is_kept(made, made) and is_kept(made, job(clrender.load(scene).changed({"camera.flow_step": 0.5}), **asked))
    assert not is_kept(made, job(there, **asked))
    assert is_kept(job(here, aov=("depth",)), job(there, aov=("depth",)))  # whose layers do not depend on it


def test_orders_that_number_layers_count(scene: Path) -> None:
    """Materials in another order are the same scene, but have other numbers in the layer `material`."""
    one = clrender.load(scene).changed({"materials.a": {"type": "lambert", "reflectance": 0.5}})
    other = one.changed({("materials",): dict(reversed(one.materials.items()))})
    assert one.sha256() == other.sha256() and [*one.materials] != [*other.materials]
    told = [layer_stats(RenderJob.of(each, size=(4, 3), spp=1, aov=("material",))) for each in (one, other)]
    assert told[0] != told[1]


def test_frames_with_other_tiles_or_names_are_rendered_again(scene: Path, tmp_path: Path) -> None:
    def rendered(*more: str) -> list[str]:
        pattern = ("-o", str(tmp_path / "f_%d.exr"), "--aov", "instance,category")
        result = call("render", str(scene), "--frames", "0:0", *pattern, *SMALL, *more)
        assert result.returncode == 0, result.stderr
        return list(hashes(result.stdout))

    scene.write_text(LAYERED)
    assert rendered() == ["0"]
    assert rendered("--resume") == []
    assert rendered("--resume", "--exr-tile", "16") == ["0"]
    assert rendered("--resume", "--exr-tile", "16") == []
    scene.write_text(LAYERED.replace("toy", "tool"))
    assert rendered("--resume", "--exr-tile", "16") == ["0"]
