"""The command line in a broken environment: closed or full streams, odd names, outputs that are inputs."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest
from cases import for_each
from cli_support import call
from plugin_files import MINNAERT

import clrender
from clrender.image.files import read_image, write_image

if TYPE_CHECKING:
    from clrender.device import Device

PRINTING = (
    "--help", "--version", "scenes", "check room", "schema", "devices --json", "doctor --json", "bench --list",
    "compare a.npy a.npy", "compare a.npy a.npy --json", "tonemap a.npy -o b.png", "render --help",
)  # fmt: skip
"""Command lines whose result is on stdout; there are no drivers for them, because to probe those takes long."""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    write_image(tmp_path / "a.npy", np.full((3, 3, 3), 0.5))
    (tmp_path / "no drivers").mkdir()
    return tmp_path


def shell(line: str, folder: Path, **variables: str) -> subprocess.CompletedProcess[str]:
    """A line of bash in which `clrender` is this one."""
    paths = {"PYTHONPATH": str(Path(clrender.__path__[0]).parent)}
    return subprocess.run(
        ["bash", "-c", f'clrender() {{ "{sys.executable}" -m clrender "$@"; }}; {line}'],
        cwd=folder, capture_output=True, text=True, errors="replace", timeout=300, check=False,
        env={**os.environ, **paths, **variables},
    )  # fmt: skip


@pytest.mark.long
@pytest.mark.parametrize("line", PRINTING)
def test_a_full_disk_below_stdout_is_one_sentence(line: str, folder: Path) -> None:
    result = shell(f"clrender {line} > /dev/full", folder, OCL_ICD_VENDORS="no drivers")
    assert result.returncode == 1
    assert result.stderr == "error: standard output cannot be written (No space left on device)\n"


@pytest.mark.long
@pytest.mark.parametrize("line", PRINTING)
def test_a_reader_that_leaves_is_no_error(line: str, folder: Path) -> None:
    # `sleep`, so that it has left when there is something to read
    pipe = f"{{ sleep 0.1; clrender {line}; }} | true; exit ${{PIPESTATUS[0]}}"
    result = shell(pipe, folder, OCL_ICD_VENDORS="no drivers")
    assert (result.returncode, result.stderr) == (0, "")


@pytest.mark.long
@pytest.mark.parametrize("line", PRINTING)
def test_all_streams_may_be_closed(line: str, folder: Path) -> None:
    result = shell(f"clrender {line} <&- >&- 2>&-", folder, OCL_ICD_VENDORS="no drivers")
    assert (result.returncode, result.stdout, result.stderr) == (3 if "doctor" in line else 0, "", "")


@pytest.mark.long
@pytest.mark.parametrize("line", ["--version", "check room", "devices --json", "tonemap a.npy -o b.png"])
def test_one_stream_may_be_closed(line: str, folder: Path) -> None:
    plain = shell(f"clrender {line}", folder, OCL_ICD_VENDORS="no drivers")
    assert plain.returncode == 0 and plain.stdout
    for closed in (">&-", "2>&-"):
        result = shell(f"clrender {line} {closed}", folder, OCL_ICD_VENDORS="no drivers")
        assert (result.returncode, result.stderr) == (0, ""), closed
        assert result.stdout == ("" if closed == ">&-" else plain.stdout)


@pytest.mark.long
@pytest.mark.parametrize("where", ["2>&-", "2> /dev/full", "2>&- >&- <&-"])
def test_the_exit_code_says_what_stderr_cannot(where: str, folder: Path) -> None:
    result = shell(f"clrender check nothing.toml {where}", folder)
    assert (result.returncode, result.stdout, result.stderr) == (2, "", "")


@pytest.mark.long
@pytest.mark.parametrize(
    ("streams", "code"),
    [("2>&-", 0), ("2> /dev/full", 0), (">&-", 0), ("<&- >&- 2>&-", 0), ("> /dev/full", 1), ("2> >(true)", 0)],
)
def test_a_render_ends_whatever_its_streams(streams: str, code: int, folder: Path, device: Device) -> None:
    """Also with progress to show: nobody reads it."""
    line = f"clrender render room --size 40x30 --spp 4 -d {device.info.index} -o a.exr --stats a.json {streams}"
    result = shell(line, folder)
    assert result.returncode == code, result.stderr
    assert "Traceback" not in result.stderr and (folder / "a.json").stat().st_size > 100
    assert read_image(folder / "a.exr").shape == (30, 40, 3)


GONE = {
    "scenes": 0,
    "check room": 0,
    "check a.toml": 2,
    "tonemap a.npy -o a.png": 2,
    "compare a.npy b.npy": 2,
    "render room -o a.png": 2,
    "render room -o /proc/self/cwd/a.png": 2,
    "report -o pages": 2,
    "radiosity room-diffuse --move 1 --by 0,0,1 -o frames": 2,
    "compare --integrators path,direct room -o maps": 2,
}


@pytest.mark.long
@pytest.mark.parametrize("line", GONE)
def test_the_working_folder_may_be_gone(line: str, tmp_path: Path) -> None:
    (tmp_path / "gone").mkdir()
    result = shell(f"cd gone && rmdir ../gone && clrender {line}", tmp_path)
    assert result.returncode == GONE[line], result.stderr
    assert result.stderr.startswith("error: ") and result.stderr.count("\n") == 1 if GONE[line] else result.stdout


def test_a_name_need_not_be_text(folder: Path) -> None:
    result = shell(r"clrender tonemap a.npy -o $'b\xff.png'", folder)
    assert (result.returncode, result.stderr) == (0, "")
    assert result.stdout.startswith(r"b\udcff.png: 3x3")
    assert (folder / os.fsdecode(b"b\xff.png")).is_file()
    refused = shell(r"clrender tonemap $'c\xff.npy' -o d.png", folder)
    assert refused.returncode == 2 and refused.stderr.count("\n") == 1 and r"c\udcff.npy" in refused.stderr


def test_a_terminal_may_know_ascii_only(folder: Path) -> None:
    result = shell("clrender render --help", folder, PYTHONIOENCODING="ascii")
    assert result.returncode == 0 and "--spp" in result.stdout


def test_warnings_of_libraries_are_not_shown(folder: Path) -> None:
    """But a developer may ask for them."""
    write_image(folder / "large.npy", np.full((3, 3, 3), 3e38))
    # Two lines: Python 3.13 shows the line that a warning comes from
    code = "import warnings; warnings.warn('of a library'); import clrender.cli.streams as s; s.guard_streams()\n"
    code += "warnings.warn('of another')"
    assert "of another" not in shell(f'"{sys.executable}" -c "{code}"', folder).stderr
    assert "of another" in shell(f'"{sys.executable}" -W always -c "{code}"', folder).stderr
    assert shell("clrender compare large.npy a.npy", folder).stderr == ""


# --- outputs that are inputs -----------------------------------------------------------------------------------------

SCENE = """
[camera]
position = [0.0, 0.0, 3.0]
target = [0.0, 0.0, 0.0]
[[shapes]]
type = "mesh"
file = "one.ply"
"""
PICTURED = """
material = "m"
[materials.m]
type = "lambert"
reflectance = {texture = "NAME"}
"""
PLY = """ply
format ascii 1.0
element vertex 3
property float x
property float y
property float z
element face 1
property list uchar int vertex_indices
end_header
0 0 0
1 0 0
0 1 0
3 0 1 2
"""
OVERWRITING = {
    "the scene": "render s.toml -o a.png --stats s.toml",
    "the scene, by another way": "render s.toml -o a.png --stats sub/../s.toml",
    "the scene, by its full name": "render s.toml -o a.png --stats $PWD/s.toml",
    "the scene, by a link": "render s.toml -o a.png --stats link.json",
    "the scene, by its second name": "render s.toml -o twin.exr",
    "a scene that is a link": "render link.toml -o a.png --stats s.toml",
    "its mesh": "render s.toml -o a.png --stats one.ply",
    "its mesh, by a link": "render s.toml -o mesh.exr",
    "numbers of a comparison": "compare --integrators path,direct agreement.json -o .",
    "the image": "tonemap image.exr -o image.png",
    "a plugin": "render s.toml -o a.png --plugin p.cl --stats p.cl",
    "a camera": "render s.toml -o a.png --camera camera.json#0 --stats camera.json",
    "a picture, by a frame": "render t.toml -o frame-%04d.png --frames -2:3",
    "a picture, by a frame of the solution": "radiosity t.toml --move 0 --by 1,0,0 -o .",
    "a picture, by a mean": "compare --integrators path,direct u.toml -o .",
    "materials that are measured": "furnace furnace.json -o .",
}


@for_each("case", OVERWRITING)
def test_no_output_takes_the_place_of_an_input(case: str, tmp_path: Path) -> None:
    (tmp_path / "s.toml").write_text(SCENE)
    (tmp_path / "one.ply").write_text(PLY)
    (tmp_path / "agreement.json").write_text('{"camera": {"position": [0, 0, 3], "target": [0, 0, 0]}}')
    (tmp_path / "furnace.json").write_text((tmp_path / "agreement.json").read_text())
    (tmp_path / "camera.json").write_text("{}")
    (tmp_path / "p.cl").write_text(MINNAERT)
    for scene, name in (("t.toml", "frame-0001.png"), ("u.toml", "direct.png")):
        (tmp_path / scene).write_text(SCENE + PICTURED.replace("NAME", name))
        write_image(tmp_path / name, np.full((3, 3, 3), 0.5))
    write_image(tmp_path / "image.png", np.full((3, 3, 3), 0.5))
    (tmp_path / "image.exr").symlink_to("image.png")
    (tmp_path / "sub").mkdir()
    for link, target in (("link.json", "s.toml"), ("link.toml", "s.toml"), ("mesh.exr", "one.ply")):
        (tmp_path / link).symlink_to(target)
    (tmp_path / "twin.exr").hardlink_to(tmp_path / "s.toml")
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir() if path.is_file()}
    result = call(*OVERWRITING[case].replace("$PWD", str(tmp_path)).split(), folder=tmp_path)
    assert result.returncode == 2 and result.stderr.count("\n") == 1 and "is an input of this command" in result.stderr
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir() if path.is_file()} == before


def test_a_data_set_keeps_its_scene(tmp_path: Path) -> None:
    (tmp_path / "images").mkdir()
    (tmp_path / "s.toml").write_text(SCENE + PICTURED.replace("NAME", "images/000000.png"))
    (tmp_path / "one.ply").write_text(PLY)
    (tmp_path / "set.toml").write_text('scene = "s.toml"\nimages = 1\nwriters = ["images"]\n')
    write_image(tmp_path / "images" / "000000.png", np.full((3, 3, 3), 0.5))
    result = call("dataset", "set.toml", "-o", ".", folder=tmp_path)
    assert result.returncode == 2 and "has an input of this command (images/000000.png)" in result.stderr
    assert not (tmp_path / "records").exists()


def test_two_names_of_one_output_are_refused(tmp_path: Path) -> None:
    (tmp_path / "b.png").symlink_to("a.png")
    (tmp_path / "c.png").write_bytes(b"old")
    (tmp_path / "d.png").hardlink_to(tmp_path / "c.png")
    for pair in ("-o a.png -o b.png", "-o a.png --stats a.png", "-o c.png -o d.png", "-o a.exr --stats ./a.exr"):
        result = call("render", "room", *pair.split(), folder=tmp_path)
        assert result.returncode == 2 and "named twice as an output" in result.stderr, pair
