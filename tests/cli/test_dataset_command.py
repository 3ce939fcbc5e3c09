"""`clrender dataset`, and `clrender verify` of what it makes, as a user types them."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path

import pytest
from cli_support import call, run
from dataset_support import write_dataset


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A data set of three small images, as a file."""
    write_dataset(tmp_path, images=3, writers=["images"], size=[16, 12])
    return tmp_path


def test_parts_and_proof(folder: Path) -> None:
    first = call("dataset", "set.json", "-o", "out", "--part", "1/2", "--quiet", folder=folder)
    assert first.returncode == 0 and first.stdout == "out: 1 image rendered, 2 of 3 are missing\n" and not first.stderr
    second = call("dataset", "set.json", "-o", "out", "--images", "1:3", "--quiet", folder=folder)
    digest = hashlib.sha256((folder / "out/manifest.json").read_bytes()).hexdigest()
    assert second.stdout == f"out: 2 images rendered, all 3 are there, manifest sha256 {digest}\n"
    again = call("dataset", "set.json", "-o", "out", "--quiet", folder=folder)
    assert again.stdout.startswith("out: 0 images rendered, all 3 are there")
    other = call("dataset", "set.json", "-o", "b", "--merge", "out", folder=folder)
    assert other.stdout == f"b: 3 images copied, all 3 are there, manifest sha256 {digest}\n"
    sound = call("verify", "out", "--sample", "2", "--quiet", folder=folder)
    assert sound.returncode == 0, sound.stderr
    assert "files of 3 images as the manifest says, 2 rendered again, identical bit for bit; if " in sound.stdout
    (folder / "out/images/000001.json").write_text("{}")
    found = call("verify", "out", "--json", "--quiet", folder=folder)
    assert found.returncode == 1 and json.loads(found.stdout)["faults"]
    assert found.stderr == (
        "error: out: verification failed: images/000001.json: its bytes are not those of the manifest\n"
    )


def test_a_dry_run_renders_nothing(folder: Path) -> None:
    before = sorted(folder.rglob("*"))
    result = call("dataset", "set.json", "--dry-run", "--part", "2/3", folder=folder)
    assert result.returncode == 0 and sorted(folder.rglob("*")) == before
    (line,) = result.stdout.splitlines()
    told = json.loads(line)
    assert told["image"] == 1 and told["camera"]["type"] == "perspective" and "camera.distance" in told["drawn"]


def test_a_category_that_nothing_has_is_told(tmp_path: Path) -> None:
    write_dataset(tmp_path, images=1, writers=["coco"], size=[16, 12], categories=["furniture", "toys", "toy"])
    for options in (("-o", "out"), ("--dry-run",)):
        result = call("dataset", "set.json", *options, folder=tmp_path)
        assert result.returncode == 0
        (warning,) = [line for line in result.stderr.splitlines() if "categor" in line]
        assert warning == (
            'warning: set.json: categories[1]: nothing in the scene has the category "toys", so that no image shows it'
            '; did you mean "toy"?'
        )
    assert call("dataset", "set.json", "--dry-run", "--quiet", folder=tmp_path).stderr == ""


OBJ = "v -1 0 0\nv 1 0 0\nv 1 1 0\nv -1 1 0.5\nf 1 2 3\nf 1 3 4\n"


def test_a_note_on_the_scene_comes_once(tmp_path: Path) -> None:
    (tmp_path / "m.obj").write_text(OBJ)
    camera = {"type": "hemisphere", "distance": 3.0, "elevation_degrees": [10.0, 70.0]}
    spec = {"scene": "m.obj", "images": 3, "size": [8, 8], "writers": ["images"], "render": {"spp": 1}}
    (tmp_path / "set.json").write_text(json.dumps({**spec, "camera": camera}))
    for command in (("dataset", "set.json", "-o", "out"), ("verify", "out", "--sample", "3")):
        result = call(*command, folder=tmp_path)
        assert result.returncode == 0, result.stderr
        assert result.stderr.count("there is no light in it") == 1


BAD = {
    "no output": ("dataset set.json", ("--output", "-o DIR")),
    "no such file": ("dataset nothing.json -o a", ("nothing.json", "no such file")),
    "a range that ends before it begins": ("dataset set.json -o a --images 3:1", ("3:1", "0:100")),
    "a range beyond the end": ("dataset set.json -o a --images 0:9", ("0:9", "3 images")),
    "a part of none": ("dataset set.json -o a --part 3/2", ("3/2", "1/7")),
    "an unknown writer": ("dataset set.json -o a --writers image", ('"image"', 'did you mean "images"')),
    "a part that is merged": (
        "dataset set.json -o a --merge b --part 1/2",
        ("--merge", "leave --images and --part out"),
    ),
    "an output that is a file": ("dataset set.json -o scene.json", ("scene.json", "cannot be made")),
    "a merge into a file": ("dataset set.json -o scene.json --merge .", ("scene.json", "cannot be made")),
    "a sample of an image": ("verify a.png --sample 3", ("--sample is for data sets", "--fraction")),
    "a folder that is none": ("verify .", ("has no manifest.json",)),
    "an environment of a data set": ("verify . --environment 1", ("--environment is not for data sets",)),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_command_lines_are_refused_in_one_sentence(case: str, folder: Path) -> None:
    line, words = BAD[case]
    result = call(*line.split(), folder=folder)
    assert result.returncode == 2, result.stderr
    assert result.stderr.startswith("error: ") and result.stderr.count("\n") == 1
    assert all(word in result.stderr for word in words), result.stderr


@pytest.mark.thorough
def test_a_process_makes_one(folder: Path) -> None:
    result = run("dataset", "set.json", "-o", "out", folder=folder)
    assert result.returncode == 0 and "all 3 are there" in result.stdout
