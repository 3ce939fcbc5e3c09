"""Mutated files of every format: each is read or answered with one sentence, soon, and in little memory."""

from __future__ import annotations

import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import pytest

FILES = [".npy", ".exr", ".png", ".hdr", ".ies", ".film", ".vol", ".nvdb"]
SCENES = [".ply", ".obj", ".mtl", ".stl", ".serialized", ".gltf", ".glb", ".xml", ".pbrt", "-places.npy"]
COMPRESSED = ["-meshopt.glb", ".ktx2"]
"""Each of these takes a process."""
SPECTRA = [".spd", "-mitsuba.spd", "-spectra.xml", "-spectra.pbrt", "-spectra.json", "-spectra.toml"]
STRANDS = ["-strands.npy", "-strands.txt", "-strands.pbrt", ".hair"]
TABLES = [".bsdf", ".binary", ".vdb"]
RASTERS = [".tga", ".bmp", ".ppm", ".tif", ".gif", ".dds", ".pfm"]
PROGRAM = Path(__file__).with_name("mutate_files.py")
needs_decoders = pytest.mark.skipif(
    find_spec("meshopt") is None or find_spec("opengl_basisu") is None, reason="needs all of the extra gltf"
)
MEMORY = 700
"""MiB. A file of ten thousand bytes may hold a DWA image of 2^15 times as many; see `clrender.image.exr`."""


def answers(folder: Path, count: int, seed: int, endings: list[str]) -> None:
    """Read that many mutated files of each format in a process of its own."""
    command = [sys.executable, str(PROGRAM), str(folder), str(count), str(seed), *endings]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    said = "" if ".tif" in endings else done.stderr  # libtiff itself writes there what it finds wrong
    assert done.returncode == 0 and said == "", done.stderr[-2000:]
    *wrong, summary = done.stdout.splitlines()
    assert not wrong, "\n".join(wrong[:20])
    files, read, memory = (int(part.split()[0]) for part in summary.split(", ")[:3])
    assert files == count * len(endings) and read < files and memory < MEMORY, summary


@pytest.mark.thorough
@pytest.mark.parametrize("endings", [FILES, RASTERS, SCENES], ids=["files", "pictures", "scenes"])
def test_mutated_files(tmp_path: Path, endings: list[str]) -> None:
    answers(tmp_path, 60, 1, endings)


@pytest.mark.thorough
def test_mutated_spectra_strands_and_tables(tmp_path: Path) -> None:
    answers(tmp_path, 8, 7, [*SPECTRA, *STRANDS, *TABLES])


@pytest.mark.long
@needs_decoders
def test_mutated_compressed_scenes(tmp_path: Path) -> None:
    answers(tmp_path, 20, 1, COMPRESSED)


@pytest.mark.long
def test_two_thousand_serialized_meshes(tmp_path: Path) -> None:
    answers(tmp_path, 2000, 4, [".serialized"])


@pytest.mark.slow
@pytest.mark.parametrize("ending", SCENES)
def test_ten_thousand_mutated_scenes(tmp_path: Path, ending: str) -> None:
    answers(tmp_path, 10_000, 3, [ending])


@pytest.mark.slow
@pytest.mark.parametrize("ending", RASTERS)
def test_ten_thousand_mutated_pictures(tmp_path: Path, ending: str) -> None:
    answers(tmp_path, 10_000, 5, [ending])


@pytest.mark.slow
@pytest.mark.parametrize("ending", [*SPECTRA, *STRANDS, *TABLES, ".ies", ".vol", ".nvdb"])
def test_ten_thousand_mutated_spectra_strands_and_tables(tmp_path: Path, ending: str) -> None:
    answers(tmp_path, 10_000, 8, [ending])


@pytest.mark.slow
@needs_decoders
@pytest.mark.parametrize("ending", COMPRESSED)
def test_a_thousand_mutated_compressed_scenes(tmp_path: Path, ending: str) -> None:
    answers(tmp_path, 1000, 6, [ending])


@pytest.mark.slow
def test_five_thousand_mutated_files(tmp_path: Path) -> None:
    answers(tmp_path, 840, 2, FILES)
