"""The render command around a renderer that is none: what it passes on, writes, prints and exits with."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
import time
import types
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import numpy as np
import pytest

from clrender.cli import main
from clrender.cli.rescue import rescue
from clrender.errors import RenderError
from clrender.film import Film
from clrender.film.unit import Unit, UnitSums, tile_side
from clrender.image.files import image_sha256, read_image, read_provenance, write_image
from clrender.settings import SETTINGS

if TYPE_CHECKING:
    from clrender.rendering.rendered_image import RenderedImage

SCENE = """
title = "nothing"
[camera]
position = [0.0, 0.0, -3.0]
target = [0.0, 0.0, 0.0]
[image]
width = 6
height = 4
[render]
spp = 4
[[lights]]
type = "environment"
radiance = [1.0, 1.0, 1.0]
"""


@dataclass
class FakeImage:
    """What the command line needs of a rendered image."""

    linear: Any
    stats: dict[str, Any]
    film: Film
    interrupted: bool = False

    def save(self, path: Path, tone_map: str = "srgb", exposure: float = 0.0, **exr: Any) -> None:
        if path.suffix == ".film":
            self.film.save(path, self.stats)
        else:
            write_image(path, self.linear, self.stats, tone_map, exposure)


@dataclass
class FakeProgress:
    samples_done: int
    samples_total: int
    seconds: float
    samples_per_second: float = 5.0
    seconds_left: float = 3.0
    relative_error: float | None = None

    @property
    def fraction(self) -> float:
        return self.samples_done / self.samples_total


@dataclass
class FakeRenderer:
    """A module `clrender.api` that counts to `spp` instead of rendering."""

    calls: list[dict[str, Any]] = field(default_factory=list)
    during: Callable[[int], None] = lambda sample: None
    nonfinite: int = 0

    def render(
        self,
        job: Any,
        *,
        device: Any = None,
        on_progress: Callable[[Any], None] | None = None,
        should_stop: Callable[[], bool] | None = None,
        notify: Callable[[str], None] | None = None,
        on_stage: Callable[[str], None] | None = None,
        keep_film: bool = True,
    ) -> FakeImage:
        asked = {name: value for name, value in vars(job.settings).items() if value != SETTINGS[name].default}
        self.calls.append({"device": device, **asked})
        width, height, spp = job.settings.width, job.settings.height, job.sample_count
        film, side = Film(width, height), tile_side(1024, width, height)
        slots = side * side
        words = np.zeros((slots, 3, 4), np.uint32)
        words[..., 2] = 1
        stopped = False
        for sample in range(spp):
            self.during(sample)
            if should_stop is not None and should_stop():
                stopped = True
                break
            done = UnitSums(words, np.ones(slots, np.uint32), np.ones(slots // 16, np.uint32), 0, 0, 0)
            film.commit(Unit(0, slots, sample, 1, side), done)
            if on_progress is not None:
                on_progress(FakeProgress(film.samples, spp * width * height, 2.0 * (sample + 1)))
        linear = film.mean()
        stats = {"image_sha256": image_sha256(linear), "spp": spp, "render_seconds": 0.5, "setup_seconds": 0.25}
        stats |= {"samples": film.samples, "devices": [{"name": "abacus"}], "nonfinite_samples": self.nonfinite}
        return FakeImage(linear, stats, film, stopped)


@pytest.fixture
def renderer(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Iterator[FakeRenderer]:
    fake = FakeRenderer()
    module = types.ModuleType("clrender.api")
    module.render = fake.render  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "clrender.api", module)
    monkeypatch.chdir(tmp_path)
    Path("scene.toml").write_text(SCENE)
    yield fake


def run(*arguments: str) -> int:
    """Exit code of `clrender ARGUMENTS`."""
    with pytest.raises(SystemExit) as caught:
        main(list(arguments))
    assert isinstance(caught.value.code, int)
    return caught.value.code


def test_every_output_is_written(renderer: FakeRenderer, capsys: pytest.CaptureFixture[str]) -> None:
    names = ["a.png", "a.jpg", "a.exr", "a.npy", "a.hdr", "a.film"]
    assert run("render", "scene.toml", *(f"-o{name}" for name in names), "--stats", "stats.json") == 0
    assert all(Path(name).exists() for name in names)
    np.testing.assert_array_equal(read_image("a.exr"), np.ones((4, 6, 3)))
    np.testing.assert_array_equal(Film.load("a.film").mean(), np.ones((4, 6, 3)))
    stats = json.loads(Path("stats.json").read_text())
    for provenance in (read_provenance("a.png"), read_provenance("a.exr"), Film.load("a.film").provenance):
        assert provenance is not None and provenance["image_sha256"] == stats["image_sha256"]
    assert (
        stats["wall_seconds"] > stats["write_seconds"] > 0
        and stats["setup_seconds"] > 0.25
        and stats["load_seconds"] >= stats["read_seconds"] > 0
    )
    out, err = capsys.readouterr()
    assert out.count("\n") == 1 and "6x4, 4 samples per pixel" in out and "abacus" in out
    assert re.fullmatch(r"( ..% .* of 96 samples, 5 samples/s, 3 s left\n|100% .*\n)+", err)


def test_settings_are_passed_on(renderer: FakeRenderer) -> None:
    assert run("render", "scene.toml", "-o", "a.npy", "--quiet") == 0
    assert renderer.calls[0] == {"device": None, "width": 6, "height": 4, "spp": 4}
    options = (
        "--spp 2 --size 5x3 --seed 9 -d cpu -d 1 --integrator direct --shadow-rays 3 --indirect-rays 0 --max-depth 7"
    )
    options += (
        " --roulette constant --termination 0.25 --tile 8 --samples-per-pass 2 --work-group 16 --lanes 8 --time 60"
    )
    assert run("render", "scene.toml", "-o", "b.npy", "--quiet", *options.split()) == 0
    assert renderer.calls[1] == {
        "device": ["cpu", "1"],
        "width": 5,
        "height": 3,
        "spp": 2,
        "seed": 9,
        "integrator": "direct",
        "shadow_rays": 3,
        "indirect_rays": 0,
        "max_depth": 7,
        "roulette": "constant",
        "termination": 0.25,
        "tile": 8,
        "samples_per_pass": 2,
        "work_group": 16,
        "lanes": 8,
        "time_limit": 60.0,
    }


def test_quiet_says_nothing_but_the_result(renderer: FakeRenderer, capsys: pytest.CaptureFixture[str]) -> None:
    assert run("render", "scene.toml", "-o", "a.npy", "--quiet", "--spp", "9") == 0
    out, err = capsys.readouterr()
    assert out.startswith("a.npy: 6x4") and not err


def test_display_options_reach_the_file(renderer: FakeRenderer) -> None:
    assert run("render", "scene.toml", "-o", "a.png", "--tone-map", "linear", "--exposure", "-1", "--quiet") == 0
    assert read_image("a.png").max() == pytest.approx(((127.5 / 255 + 0.055) / 1.055) ** 2.4, abs=0.005)


def test_samples_left_out_are_reported(renderer: FakeRenderer, capsys: pytest.CaptureFixture[str]) -> None:
    renderer.nonfinite = 3
    assert run("render", "scene.toml", "-o", "a.npy", "--quiet") == 0
    assert "3 samples were not finite and discarded" in capsys.readouterr().out


def test_one_bad_output_does_not_lose_the_others(
    renderer: FakeRenderer, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    save = FakeImage.save

    def fill_up(self: FakeImage, path: Path, **how: Any) -> None:
        if path.suffix == ".png":
            raise RenderError(f"{path}: cannot be written, no room is left.")
        save(self, path, **how)

    monkeypatch.setattr(FakeImage, "save", fill_up)
    assert run("render", "scene.toml", "-o", "a.png", "-o", "a.npy", "--quiet") == 1
    assert Path("a.npy").exists() and not Path("a.png").exists()
    assert capsys.readouterr().err == "error: a.png: cannot be written, no room is left\n"


@pytest.mark.parametrize("place", ["beside", "working folder", "temporary folder", "nowhere"])
def test_a_finished_render_is_kept_where_its_output_cannot_be_written(
    renderer: FakeRenderer,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    tmp_path: Path,
    place: str,
) -> None:
    """The folder of the output goes away while the render runs, or the disk is full."""
    places = {"beside": tmp_path / "out", "working folder": tmp_path, "temporary folder": tmp_path / "temporary"}
    for folder in (tmp_path / "out", tmp_path / "temporary"):
        folder.mkdir()
    (tmp_path / "a.film").write_bytes(b"another")
    monkeypatch.setattr("tempfile.tempdir", str(places["temporary folder"]))
    save, left = FakeImage.save, list(places).index(place) if place in places else len(places)

    def save_there(self: FakeImage, path: Path, **how: Any) -> None:
        if path.suffix == ".film" and path.parent in list(places.values())[left:]:
            save(self, path, **how)
        else:
            raise RenderError(f"{path}: cannot be written, no room is left.")

    monkeypatch.setattr(FakeImage, "save", save_there)
    assert run("render", "scene.toml", "-o", "out/a.png", "--quiet") == 1
    told = capsys.readouterr().err
    assert told.startswith("error: out/a.png: cannot be written, no room is left; ") and told.count("\n") == 1
    if place == "nowhere":
        assert "lost" in told
        return
    film = places[place] / ("a-2.film" if place == "working folder" else "a.film")
    assert f"the render is kept in {film}" in told
    np.testing.assert_array_equal(Film.load(film).mean(), np.ones((4, 6, 3)))
    assert (tmp_path / "a.film").read_bytes() == b"another"


def test_a_folder_that_goes_away_while_the_render_runs(
    renderer: FakeRenderer, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    (tmp_path / "out").mkdir()
    renderer.during = lambda sample: (tmp_path / "out").rmdir() if sample == 2 else None
    assert run("render", "scene.toml", "-o", "out/a.png", "--quiet") == 1
    assert f"the render is kept in {tmp_path / 'a.film'}" in capsys.readouterr().err
    np.testing.assert_array_equal(Film.load("a.film").mean(), np.ones((4, 6, 3)))


def test_of_a_large_image_the_image_is_kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The sums of its film were released, which would take gigabytes."""
    monkeypatch.chdir(tmp_path)
    image = FakeImage(np.ones((4, 6, 3), np.float32), {}, Film(6, 4, {}))
    image.film.develop()
    assert rescue(cast("RenderedImage", image), tmp_path / "a.png") == tmp_path / "a.npy"
    np.testing.assert_array_equal(np.load(tmp_path / "a.npy"), image.linear)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_keeps_the_picture_so_far(
    renderer: FakeRenderer, capsys: pytest.CaptureFixture[str], number: signal.Signals
) -> None:
    def stop(sample: int) -> None:
        if sample == 3:
            os.kill(os.getpid(), number)
            time.sleep(0.1)

    renderer.during = stop
    before = signal.getsignal(number)
    assert run("render", "scene.toml", "-o", "a.npy", "--spp", "100", "--quiet") == 128 + number
    assert signal.getsignal(number) is before
    out, err = capsys.readouterr()
    assert "stopped early with 72 of 2400 samples (3 a pixel)" in out and not err
    np.testing.assert_array_equal(read_image("a.npy"), np.ones((4, 6, 3)))


def test_a_stop_by_time_is_a_success(renderer: FakeRenderer, capsys: pytest.CaptureFixture[str]) -> None:
    real = renderer.render

    def timed(scene: Any, **how: Any) -> FakeImage:
        image = real(scene, **how)
        image.interrupted = True
        return image

    sys.modules["clrender.api"].render = timed  # type: ignore[attr-defined]
    assert run("render", "scene.toml", "-o", "a.npy", "--time", "1", "--quiet") == 0
    assert "stopped early with 96 of 96" in capsys.readouterr().out


def test_a_signal_before_the_first_sample_writes_nothing(
    renderer: FakeRenderer, capsys: pytest.CaptureFixture[str]
) -> None:
    def stop(sample: int) -> None:
        os.kill(os.getpid(), signal.SIGINT)
        time.sleep(0.1)

    renderer.during = stop
    Path("a.npy").write_bytes(b"old")
    assert run("render", "scene.toml", "-o", "a.npy", "--quiet") == 130
    assert Path("a.npy").read_bytes() == b"old"
    assert "interrupted before the first sample; nothing was written" in capsys.readouterr().err


STUCK = """
import sys, time, types
module = types.ModuleType("clrender.api")
def render(scene, *, on_progress, should_stop, **settings):
    class Progress:
        samples_done, samples_total, seconds, samples_per_second, seconds_left = {done}, 10, 1.0, 1.0, 9.0
    on_progress(Progress)
    print("stuck", flush=True)
    import ctypes
    ctypes.CDLL(None).sleep({sleep})  # a device that does not come back: no Python runs in this thread
    time.sleep(60)
module.render = render
sys.modules["clrender.api"] = module
from clrender.cli import main
main(["render", "scene.toml", "-o", "a.npy"])
"""


@pytest.mark.thorough
def test_a_stop_that_takes_long_says_how_to_end_at_once(renderer: FakeRenderer) -> None:
    with subprocess.Popen(
        [sys.executable, "-c", STUCK.format(done=5, sleep=60)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))},
    ) as child:
        assert child.stdout is not None and child.stdout.readline() == "stuck\n" and child.stderr is not None
        child.send_signal(signal.SIGINT)
        for line in child.stderr:
            if "interrupt again to end at once" in line:
                child.send_signal(signal.SIGINT)
                break
        _, err = child.communicate(timeout=50)
    assert child.returncode == 130 and "interrupted twice; nothing more was written" in err


@pytest.mark.thorough
@pytest.mark.parametrize(("done", "signals"), [(0, 1), (5, 2)])
def test_a_stuck_device_does_not_hold_the_user(renderer: FakeRenderer, done: int, signals: int) -> None:
    with subprocess.Popen(
        [sys.executable, "-c", STUCK.format(done=done, sleep=60)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))},
    ) as child:
        assert child.stdout is not None and child.stdout.readline() == "stuck\n"
        for _ in range(signals):
            child.send_signal(signal.SIGINT)
            time.sleep(0.2)
        _, err = child.communicate(timeout=50)  # the device is stuck for a minute
    assert child.returncode == 130
    assert ("before the first sample" if signals == 1 else "interrupted twice") in err and "Traceback" not in err
    assert sorted(path.name for path in Path().iterdir()) == ["scene.toml"]


def test_outputs_are_checked_before_rendering(renderer: FakeRenderer, capsys: pytest.CaptureFixture[str]) -> None:
    assert run("render", "scene.toml", "-o", "a.png", "-o", "nowhere/b.png") == 2
    assert run("render", "scene.toml", "-o", "a.png", "-o", "./a.png") == 2
    assert run("render", "scene.toml", "-o", "a.png", "--stats", "a.png") == 2
    assert run("render", "scene.toml", "-o", "a.png", "--stats", "nowhere/stats.json") == 2
    assert not renderer.calls and not list(Path().glob("*.png"))
    errors = capsys.readouterr().err.splitlines()
    assert len(errors) == 4 and all(line.startswith("error: ") for line in errors)


def test_more_memory_than_there_is_is_refused(
    renderer: FakeRenderer, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("clrender.process.memory.os.sysconf", lambda name: 4096 if name == "SC_PAGE_SIZE" else 1000)
    assert run("render", "scene.toml", "-o", "a.png", "--size", "1000x1000") == 2
    assert "61.0 MiB of memory" in capsys.readouterr().err and not renderer.calls


def test_an_image_is_told_whose_field_cannot_be_written(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    from clrender.cli.render import _write

    def full(path: Path) -> None:
        raise RenderError(f"{path.name}: no room.")

    image: Any = types.SimpleNamespace(
        stats={}, save=lambda path, **how: path.touch(), guiding_field=types.SimpleNamespace(save=full)
    )
    with pytest.raises(RenderError, match=r"^a\.npy: no room$"):
        _write(image, [tmp_path / "a.png"], {}, lambda: "a.png is there", field=tmp_path / "a.npy")
    assert capsys.readouterr().out == "a.png is there\n" and (tmp_path / "a.png").exists()
