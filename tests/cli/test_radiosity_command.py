"""`clrender radiosity`: frames of an animation, and what is wrong with a command line."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from cases import for_each
from cli_support import call

from clrender.image.files import read_image

if TYPE_CHECKING:
    from clrender.device import Device

MOVE = ("--move", "12", "--by", "0.05,0,0")
SMALL = ("--frames", "2", "--patches", "300", "--patch-rays", "16", "--spp", "1", "--size", "32x24")


@pytest.mark.long
def test_a_frame_is_a_picture_and_a_line(device: Device, tmp_path: Path) -> None:
    result = call(
        "radiosity", "room-diffuse", *MOVE, *SMALL, "-d", str(device.info.index), "-o", "out", folder=tmp_path
    )
    assert result.returncode == 0, result.stderr
    names = [path.name for path in sorted((tmp_path / "out").iterdir())]
    assert names == ["frame-0000.png", "frame-0001.png"]
    first, second = (read_image(tmp_path / "out" / name) for name in names)
    assert first.shape == second.shape == (24, 32, 3) and first.any() and (first != second).any()
    lines = result.stdout.splitlines()
    assert "frame-0000.png: 100.0% of" in lines[0] and "frame-0001.png: " in lines[1] and "full solution" in lines[2]


@pytest.mark.long
def test_a_scene_may_read_from_folders_that_are_named(device: Device, tmp_path: Path) -> None:
    (tmp_path / "meshes").mkdir()
    (tmp_path / "scene").mkdir()
    (tmp_path / "meshes" / "one.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    scene = tmp_path / "scene" / "s.toml"
    scene.write_text(
        "[camera]\nposition = [0.3, 0.3, 3.0]\ntarget = [0.3, 0.3, 0.0]\n"
        '[materials.white]\ntype = "lambert"\nreflectance = [0.5, 0.5, 0.5]\n'
        '[[shapes]]\ntype = "mesh"\nfile = "../meshes/one.obj"\nmaterial = "white"\n'
        '[[shapes]]\ntype = "quad"\norigin = [0.0, 0.0, 1.0]\nedge_u = [0.0, 1.0, 0.0]\nedge_v = [1.0, 0.0, 0.0]\n'
        'material = "white"\nemission = [1.0, 1.0, 1.0]\n'
    )
    line = ("scene/s.toml", "--move", "1", "--by", "0,0,0.1", *SMALL, "-d", str(device.info.index), "-o", "out")
    refused = call("radiosity", *line, folder=tmp_path)
    assert refused.returncode == 2 and "one.obj" in refused.stderr and not (tmp_path / "out").exists()
    allowed = call("radiosity", *line, "--allow-path", "meshes", folder=tmp_path)
    assert allowed.returncode == 0, allowed.stderr
    assert len(list((tmp_path / "out").iterdir())) == 2


BAD = {
    "no such shape": ("--move 13 --by 0,0,0 -o out", ("--move", "13")),
    "no vector": ("--move 1 --by 1,2 -o out", ("'1,2'", "three numbers")),
    "not finite": ("--move 1 --by nan,0,0 -o out", ("finite",)),
    "a file": ("--move 1 --by 0,0,0 -o file", ("file", "is a file")),
    "no such place": ("--move 1 --by 0,0,0 -o no/where", ("no/where", "cannot be made")),
    "no such device": ("--move 1 --by 0,0,0 -o out -d nothing", ("nothing", "--device")),
}


@pytest.mark.thorough
@for_each("case", BAD)
def test_bad_command_lines_are_refused_in_one_sentence(case: str, tmp_path: Path) -> None:
    line, words = BAD[case]
    (tmp_path / "file").write_text("")
    result = call("radiosity", "room-diffuse", *line.split(), folder=tmp_path)
    assert result.returncode == 2 and result.stderr.count("\n") == 1 and result.stderr.startswith("error: ")
    assert all(word in result.stderr for word in words), result.stderr
    assert not result.stdout and [path.name for path in tmp_path.iterdir()] == ["file"]
