"""What an error suggests is accepted; texts that no file can hold are refused, and end in no traceback."""

from __future__ import annotations

import json
import logging
import os
import re
import sys
from pathlib import Path

import pytest
from cases import for_each
from cli_support import call

from clrender import SceneError, UsageError
from clrender.drivers import discover
from clrender.rendering.job import RenderJob
from clrender.scene import Scene, load


def job(**settings: object) -> RenderJob:
    return RenderJob.of(load("room"), size=(8, 8), **settings)  # type: ignore[arg-type]


@for_each("spp", [1, 15, 17, 31, 33, 100, 255, 257, 300])
@for_each("more", [{"replicate_spp": 16}, {"error": 0.5}, {"aov": ("stderr",)}, {"error": 0.5, "aov": ("stderr",)}])
def test_numbers_of_samples_that_are_suggested_are_accepted(spp: int, more: dict[str, object]) -> None:
    with pytest.raises(UsageError) as refused:
        job(spp=spp, **more)
    said = re.search(r"for example ([\d or]+)|set it to (\d+) or more|ask for (\d+) samples", str(refused.value))
    assert said is not None, refused.value
    for suggested in re.findall(r"\d+", said[0]):
        assert job(spp=int(suggested), **more).settings.spp == int(suggested)


@for_each(
    ("arguments", "message"),
    [
        (["--samples", "4"], "no such option '--samples'; did you mean '--spp'?"),
        (["--bounces", "4"], "no such option '--bounces'; did you mean '--max-depth'?"),
        (["--integratr", "path"], "no such option '--integratr'; did you mean '--integrator'?"),
        (["--threads", "4"], "no such option '--threads';"),
        (["--time", "inf"], "--time is 'inf', but must be a finite number of seconds above 0"),
        (["--time", "nan"], "--time is 'nan', but must be a number of seconds above 0"),
        (["--time", "5s"], "--time is '5s', but must be a number of seconds above 0"),
        (
            ["--replicate-spp", "15"],
            "--replicate-spp is '15', but must be 1, 2, 4, 8, 16, 32, 64, 128, 256, 512, 1024, 2048 or 4096; see",
        ),
    ],
)
def test_options(arguments: list[str], message: str) -> None:
    done = call("render", "room", *arguments, "-o", "a.png")
    assert done.returncode == 2
    assert f"error: {message}" in done.stderr
    assert "light-sampler" not in done.stderr
    assert "lanes" not in done.stderr


def test_a_movement_that_is_too_far_is_refused_at_once(tmp_path: Path) -> None:
    done = call("radiosity", "room-diffuse", "--move", "5", "--by", "1e30,0,0", "-o", str(tmp_path / "r"))
    assert (done.returncode, done.stdout) == (2, "")
    assert "--by: 24 frames would move the shape 2.3e+31 metres; 1e+12 is the most" in done.stderr
    assert not (tmp_path / "r").exists()


def test_lone_surrogates_are_refused(tmp_path: Path) -> None:
    camera = {"position": (0.0, 0.0, 1.0), "target": (0.0, 0.0, 0.0)}
    (tmp_path / "a.json").write_text(json.dumps({"title": "\ud800", "camera": camera}))
    done = call("convert", "a.json", "b.toml", folder=tmp_path)
    assert done.returncode == 2
    assert 'a.json: title is the text "\\ud800", but must be a text without lone surrogates' in done.stderr
    with pytest.raises(SceneError, match=r"title is .* without lone surrogates"):
        Scene.model_validate({"title": "a", "camera": camera}).changed(title="\ud800")
    with pytest.raises(SceneError, match=r"title is .* without lone surrogates"):
        Scene(title="\udcff", camera=camera)


def test_file_names_that_are_no_text(tmp_path: Path) -> None:
    odd = os.fsdecode(b"a\xff.toml")
    done = call("convert", "sky", odd, folder=tmp_path)
    assert done.returncode == 2
    assert "a\\udcff.toml: the name is no UTF-8" in done.stderr
    assert list(tmp_path.iterdir()) == []
    assert call("convert", "room", odd, folder=tmp_path).returncode == 0
    assert load(tmp_path / odd).sha256() == load("room").sha256()


def test_a_page_of_an_image_whose_name_is_no_text(tmp_path: Path) -> None:
    import numpy as np

    pytest.importorskip("matplotlib")
    for name in (b"a\xff.npy", b"b.npy"):
        np.save(tmp_path / os.fsdecode(name), np.ones((8, 8, 3), np.float32))
    done = call("compare", os.fsdecode(b"a\xff.npy"), "b.npy", "-o", "page.html", folder=tmp_path)
    assert done.returncode == 0, done.stderr
    assert "a\\udcff.npy" in (tmp_path / "page.html").read_text("utf-8")


def test_a_driver_that_disappears_is_no_error(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """As while it is uninstalled."""
    library = tmp_path / "libgone.so"
    library.write_bytes(b"")
    driver = discover.Driver(str(library), "a.icd", str(library))
    before = discover.fingerprint(driver)
    library.unlink()
    assert discover.fingerprint(driver) != before
    monkeypatch.setenv("POCL_ODD", os.fsdecode(b"\xff"))
    assert len(discover.fingerprint(driver)) == 64


def test_bytes_of_a_client_are_not_logged_as_a_fault() -> None:
    server = pytest.importorskip("clrender.view.server")
    records = []
    for fault in (UnicodeDecodeError("utf-8", b"\xff", 0, 1, "invalid"), ValueError("ours")):
        try:
            raise fault
        except ValueError:
            records.append(logging.LogRecord("uvicorn.error", logging.ERROR, "", 0, "x", (), sys.exc_info()))
    assert [server._is_ours(record) for record in records] == [False, True]
