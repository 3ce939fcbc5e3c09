"""`clrender warmup` as a user meets it: what it compiles, and that later renders compile nothing."""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from cli_support import call, run

if TYPE_CHECKING:
    from clrender.device import Device


def test_the_kernels_of_a_scene(device: Device, tmp_path: Path) -> None:
    on = ("-d", str(device.info.index))
    done = call("warmup", "point-plane", *on, folder=tmp_path)
    assert done.returncode == 0, done.stderr
    assert re.search(r"^compiled for point-plane, in \d+\.\d s: ", done.stderr, re.MULTILINE)
    assert call("warmup", "point-plane", "--quiet", *on, folder=tmp_path).stderr == ""


def test_a_scene_that_is_not_there(device: Device, tmp_path: Path) -> None:
    done = call("warmup", "point-plan", folder=tmp_path)
    assert done.returncode == 2
    assert "point-plan" in done.stderr


@pytest.mark.long
def test_later_renders_of_any_scene_compile_nothing(
    device: Device, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    if not device.compiles_small_code:
        pytest.skip("it is not known what this driver has compiled")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    on = ("-d", str(device.info.index))
    done = run("warmup", *on, folder=tmp_path)
    assert done.returncode == 0, done.stderr
    assert "compiled for any scene" in done.stderr
    compiled = {path.name for path in tmp_path.glob("cache/clrender/compiled/*/run/*")}
    assert compiled
    for scene in ("drink", "sky", "candles"):
        more = ("--size", "24x16", "--spp", "2", "--aov", "depth", "-o", f"{scene}.exr")
        done = run("render", scene, *more, *on, folder=tmp_path)
        assert done.returncode == 0, done.stderr
    assert {path.name for path in tmp_path.glob("cache/clrender/compiled/*/run/*")} == compiled
