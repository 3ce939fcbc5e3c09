"""Progress as a user or a program meets it: bars with errors, JSON, and pictures in terminals of each kind."""

from __future__ import annotations

import io
import itertools
import json
import re
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest
from cli_support import call
from fake_terminal import cursor_rows, pictures, run_at_terminal
from replicate_support import REQUEST, SIZE, film_of, samples_of

from clrender.cli import preview
from clrender.cli.options import PROGRESS_STYLES
from clrender.cli.progress import STYLES, state
from clrender.cli.terminal import Terminal
from clrender.film import Film
from clrender.film.replicates import relative_error
from clrender.image.files import read_image
from clrender.image.terminal import PROTOCOLS, encode, fit, resized
from clrender.image.tone_map import to_display
from clrender.rendering.rendered_image import Progress

SMALL = ("render", "room", "--size", "96x64", "--spp", "32", "-o", "a.png")
KEYS = {"event", "samples", "samples_total", "seconds", "samples_per_second", "seconds_left", "relative_error"}


def display(path: Path) -> npt.NDArray[np.uint8]:
    """A .png as it is stored."""
    from PIL import Image

    return np.asarray(Image.open(path).convert("RGB"))


# --- pictures in the terminal ----------------------------------------------------------------------------------------


@pytest.mark.long
@pytest.mark.parametrize("kind", PROTOCOLS)
def test_the_picture_in_the_terminal_is_the_image(tmp_path: Path, kind: str) -> None:
    shown = run_at_terminal(kind, *SMALL, "--preview", folder=tmp_path)
    assert shown.code == 0 and shown.restored, shown.text
    last, image = pictures(shown.text)[-1], display(tmp_path / "a.png")
    assert last.shape == image.shape
    if kind == "sixel":  # of 64 colours, as this terminal said
        assert len(np.unique(last.reshape(-1, 3), axis=0)) <= 64
        assert np.abs(last.astype(float) - image).mean() < 6.0
    else:
        assert (last == image).all()


class Watched:
    """A preview on a screen of 80 x 24, with a clock of its own, of a render that always is where a film is."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, kind: str, seconds: float = 0.0) -> None:
        self.now, self.film = 0.0, film_of(samples_of(3, 40 * 90, SIZE), 40, 90, [SIZE], REQUEST)
        self.written = io.StringIO()
        monkeypatch.setattr(sys, "stderr", self.written)
        monkeypatch.setenv("COLUMNS", "80")
        monkeypatch.setenv("LINES", "24")
        monkeypatch.setattr("time.perf_counter", lambda: self.now)

        def develop(linear: npt.NDArray[np.float32]) -> npt.NDArray[np.uint8]:
            self.now += seconds
            return to_display(linear)

        self.preview = preview.Preview(Terminal(kind, (8, 16)), develop)

    def show(self, now: float) -> None:
        self.now = now
        self.preview.show(Progress(7, 10, 1.0, 0, self.film))

    def rows(self) -> list[tuple[str, int]]:
        return cursor_rows(self.written.getvalue(), 24)


@pytest.mark.parametrize("kind", PROTOCOLS)
def test_the_picture_comes_again_and_stays_in_its_place(monkeypatch: pytest.MonkeyPatch, kind: str) -> None:
    watched = Watched(monkeypatch, kind)
    for moment in (0.0, 0.1, 0.2, 0.3, 0.5, 0.6):  # drawn at 0, 0.3 and 0.6
        watched.show(moment)
    watched.preview.say("a line")
    watched.show(1.0)
    watched.preview.close()
    drawn = pictures(watched.written.getvalue())
    assert len(drawn) == 4 and all(picture.shape == (90, 40, 3) for picture in drawn)
    said = " 70% 7 of 10 samples, 7 samples/s, 0 s left"
    # 90 pixels are six rows of 16
    state = [("picture", 0), (said, 6)]
    assert watched.rows() == [*state, *state, *state, ("a line", 6), ("picture", 0), (said, 7)]


def test_a_picture_that_has_left_the_screen_gets_a_new_place(monkeypatch: pytest.MonkeyPatch) -> None:
    watched = Watched(monkeypatch, "kitty")
    watched.show(0.0)
    for number in range(30):
        watched.preview.say(f"line {number}")
    watched.show(1.0)
    assert [row for what, row in watched.rows() if what == "picture"] == [0, 36]


def test_drawing_takes_a_twentieth_of_the_time(monkeypatch: pytest.MonkeyPatch) -> None:
    watched = Watched(monkeypatch, "kitty", seconds=0.5)
    for moment in range(200):
        watched.show(0.5 * moment)
    assert len(pictures(watched.written.getvalue())) == 10  # of 100 s


def test_nothing_is_drawn_before_there_is_light(monkeypatch: pytest.MonkeyPatch) -> None:
    watched = Watched(monkeypatch, "kitty")
    watched.film = Film(40, 90, REQUEST)
    watched.show(0.0)
    assert [what for what, _ in watched.rows()] == [" 70% 7 of 10 samples, 7 samples/s, 0 s left"]


def test_a_picture_fits_into_a_small_terminal(tmp_path: Path) -> None:
    arguments = ("render", "room", "--size", "1200x300", "--spp", "1", "-o", "a.png", "--preview")
    shown = run_at_terminal("kitty", *arguments, folder=tmp_path, size=(30, 10))
    height, width, _ = pictures(shown.text)[-1].shape
    assert (width, height) == (240, 60)


@pytest.mark.long
@pytest.mark.parametrize("kind", ["none", "silent"])
def test_a_terminal_without_pictures_is_told_of_and_the_render_goes_on(tmp_path: Path, kind: str) -> None:
    shown = run_at_terminal(kind, *SMALL, "--preview", folder=tmp_path)
    assert shown.code == 0 and shown.restored
    assert shown.text.count("--preview: this terminal does not say that it shows pictures") == 1
    assert not pictures(shown.text) and (tmp_path / "a.png").is_file()


def test_nothing_is_asked_where_stderr_is_no_terminal(tmp_path: Path) -> None:
    done = call(*SMALL, "--preview", folder=tmp_path)
    assert done.returncode == 0
    assert done.stderr.startswith("--preview: stderr is no terminal") and "\x1b" not in done.stderr


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--preview", "--quiet"), "--preview and --quiet"),
        (("--preview", "--progress", "json"), "--preview and --progress json"),
        (("--quiet", "--progress", "json"), "--quiet and --progress json"),
        (("--progress", "xml"), "--progress is 'xml', but must be auto or json"),
    ],
)
def test_contradictions_are_refused(tmp_path: Path, options: Sequence[str], words: str) -> None:
    done = call(*SMALL, *options, folder=tmp_path)
    assert done.returncode == 2 and words in done.stderr and done.stderr.count("\n") == 1


def test_areas_have_the_shape_of_the_picture() -> None:
    assert fit((800, 800), (80, 22), (8, 16)) == (44, 22)
    assert fit((1600, 100), (80, 22), (8, 16)) == (80, 3)
    assert fit((64, 48), (80, 22), (8, 16)) == (8, 3)  # never enlarged
    assert fit((1, 5000), (80, 22), (8, 16)) == (1, 22)


@pytest.mark.parametrize("size", [(1, 1), (7, 5), (6, 300), (13, 12)])
def test_pictures_of_all_sizes_survive_each_protocol(size: tuple[int, int]) -> None:
    noise = np.random.default_rng(1).integers(0, 4, (*size, 3), dtype=np.uint8) * np.uint8(85)
    assert resized(noise, 1000, 1000).shape[0] >= size[0]
    for protocol in PROTOCOLS:
        text = encode(noise, protocol, number=7)
        assert text.isascii()
        (picture,) = pictures(text)
        assert np.abs(picture.astype(int) - noise).max() <= (2 if protocol == "sixel" else 0)


# --- what is said ----------------------------------------------------------------------------------------------------


def test_styles_without_loading_them_are_the_styles_there_are() -> None:
    assert tuple(STYLES) == PROGRESS_STYLES


def test_progress_as_json(tmp_path: Path) -> None:
    arguments = ("--size", "100x75", "--spp", "128", "--replicate-spp", "4", "--progress", "json")
    done = call("render", "room", *arguments, "-o", "a.film", "--stats", "s.json", folder=tmp_path)
    assert done.returncode == 0, done.stderr
    events = [json.loads(line) for line in done.stderr.splitlines()]
    progress = [each for each in events if each["event"] == "progress"]
    assert progress and all(set(each) == KEYS for each in progress)
    moments = [each["seconds"] for each in progress]
    assert all(after - before >= 0.25 for before, after in itertools.pairwise(moments[:-1]))
    counts = [each["samples"] for each in progress]
    assert counts == sorted(counts) and counts[-1] == progress[-1]["samples_total"] == 100 * 75 * 128
    stats = json.loads((tmp_path / "s.json").read_text())
    told = {name: stats[name] for name in ("samples", "render_seconds", "image_sha256")}
    assert events[-1] == {"event": "end", **told, "interrupted": False}
    error = relative_error(Film.load(tmp_path / "a.film"))
    assert error is not None and progress[-1]["relative_error"] == pytest.approx(error, rel=1e-6)


def test_errors_are_said_only_where_they_are_known(tmp_path: Path) -> None:
    values = samples_of(3, 9 * 7, 3 * SIZE)
    known = film_of(values, 9, 7, [3 * SIZE], REQUEST)
    error = relative_error(known)
    assert error is not None
    words = "7 of 10 samples, 7 samples/s"
    assert state(Progress(7, 10, 1.0, 0, known)) == f"{words}, error {100 * error:.2g} %, 0 s left"
    assert state(Progress(5, 1000, 2.0, 0, None)) == "5 of 1.0 k samples, 2 samples/s"  # of what is compiled first
    assert state(Progress(5, 1000, 12.0, 0, None)).endswith(" left")
    for film in (None, Film(9, 7, REQUEST), film_of(values, 9, 7, [SIZE], REQUEST), Film(9, 7)):
        assert state(Progress(7, 10, 1.0, 0, film)) == f"{words}, 0 s left"
    done = call(*SMALL, "--progress", "json", folder=tmp_path)
    assert {json.loads(line)["relative_error"] for line in done.stderr.splitlines() if '"progress"' in line} == {None}


def test_bad_input_is_a_plain_line_also_beside_json(tmp_path: Path) -> None:
    done = call("render", "rooom", "--progress", "json", "-o", "a.png", folder=tmp_path)
    assert done.returncode == 2 and done.stderr.startswith("error: ") and done.stderr.count("\n") == 1


# --- a first scene ---------------------------------------------------------------------------------------------------


@pytest.mark.long
def test_a_first_scene_renders_at_once(tmp_path: Path) -> None:
    made = call("new", "my scenes", folder=tmp_path)
    assert made.returncode == 0 and not made.stderr
    assert [path.name for path in (tmp_path / "my scenes").iterdir()] == ["scene.toml"]
    # What it says is to be typed, typed
    line = re.search(r"clrender (render .*)\n", made.stdout)
    assert line and "'my scenes/scene.toml'" in line[1]
    words = [word.strip("'") for word in re.findall(r"'[^']*'|\S+", line[1])]
    done = call(*words, "--spp", "2", "--size", "64x40", folder=tmp_path)
    assert done.returncode == 0, done.stderr
    assert read_image(tmp_path / "my scenes" / "picture.png").shape == (40, 64, 3)


def test_what_the_comments_of_the_first_scene_offer_is_valid(tmp_path: Path) -> None:
    call("new", "a", folder=tmp_path)
    scene = tmp_path / "a" / "scene.toml"
    for offer in ("aperture_radius", "focus_distance", "metallic"):
        text, count = re.subn(rf"^# ({offer} = )", r"\1", scene.read_text(), flags=re.MULTILINE)
        assert count == 1
        scene.write_text(text)
    assert call("check", str(scene)).returncode == 0


def test_a_first_scene_overwrites_nothing(tmp_path: Path) -> None:
    (tmp_path / "a").mkdir()
    (tmp_path / "a" / "other").write_text("kept")
    assert call("new", "a", folder=tmp_path).returncode == 0
    (tmp_path / "a" / "scene.toml").write_text("mine")
    (tmp_path / "link").mkdir()
    (tmp_path / "link" / "scene.toml").symlink_to(tmp_path / "nowhere")
    for folder in ("a", "link"):
        again = call("new", folder, folder=tmp_path)
        assert again.returncode == 2 and "exists already and is not overwritten" in again.stderr
    assert (tmp_path / "a" / "scene.toml").read_text() == "mine"
    assert not (tmp_path / "nowhere").exists()


def test_a_first_scene_in_an_impossible_place_leaves_nothing(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    for folder in ("file", "no/such/place", "file/below"):
        done = call("new", folder, folder=tmp_path)
        assert done.returncode == 2 and done.stderr.startswith(f"error: {folder}"), done.stderr
    assert [path.name for path in tmp_path.iterdir()] == ["file"]
