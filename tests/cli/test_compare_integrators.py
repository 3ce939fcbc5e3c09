"""`clrender compare --integrators` as a user meets it: tiny renders, their table, files and exit codes."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest
from cases import for_each
from cli_support import call

from clrender.image.files import read_image

if TYPE_CHECKING:
    from clrender.device import Device

SMALL = ("--size", "44x36", "--spp", "64", "--quiet")


def test_path_agrees_with_itself_and_differs_from_direct_as_it_must(device: Device, tmp_path: Path) -> None:
    on = ("-d", str(device.info.index))
    result = call(
        "compare", "--integrators", "path,path,direct", "cornell", *SMALL, *on, "-o", "out", "--check", folder=tmp_path
    )
    assert result.returncode == 0 and not result.stderr, result.stderr
    assert "path and path-2 agree; differences of" in result.stdout
    assert "path and direct differ as they must: direct has no light between diffuse surfaces" in result.stdout

    numbers = json.loads((tmp_path / "out" / "agreement.json").read_text())
    assert [one["label"] for one in numbers["integrators"]] == ["path", "path-2", "direct"]
    seeds = [seed for one in numbers["integrators"] for seed in one["seeds"]]
    assert len(seeds) == len(set(seeds)) == 3 * numbers["batches"] == 48
    assert (numbers["width"], numbers["height"], numbers["tiles"]) == (44, 36, [6, 5])
    same, other = numbers["pairs"][0], numbers["pairs"][1]
    assert (same["verdict"], same["tiles_differ"]) == ("agree", 0) and abs(same["largest_z"]) < 5.0
    low, high = same["mean_ratio_95"]
    assert low < same["mean_ratio"] < high and 0.9 < low < 1.01 and 0.99 < high < 1.1
    assert (other["verdict"], other["tiles_darker"]) == ("differ as they must", 0) and other["tiles_differ"] > 20
    assert 1.2 < other["mean_ratio"] < 1.4

    # Mean images, and maps in which path is brighter than direct: red
    for label, one in zip(("path", "path-2", "direct"), numbers["integrators"], strict=True):
        image = read_image(tmp_path / "out" / f"{label}.exr")
        assert image.shape == (36, 44, 3)
        np.testing.assert_allclose(image.mean(axis=(0, 1)), one["mean"], rtol=1e-5)
        assert (tmp_path / "out" / f"{label}.png").is_file()
    colors = read_image(tmp_path / "out" / "z_path-minus-direct_blue-6_white-0_red+6.png")
    assert colors.shape == (36, 44, 3) and (colors[..., 0] == 1.0).mean() > 0.95 and colors[..., 2].mean() < 0.3
    assert len(list((tmp_path / "out").iterdir())) == 3 * 2 + 3 + 1


@pytest.mark.thorough
def test_json_is_printed_and_the_same_command_prints_it_again(device: Device) -> None:
    size = ("--size", "44x36", "--spp", "8", "--batches", "8", "--quiet")
    line = ("--integrators", "direct,direct", "cornell", *size, "-d", str(device.info.index), "--json")
    first, again, other = (json.loads(call("compare", *line, *more).stdout) for more in ((), (), ("--seed", "1")))
    for one in (*first["integrators"], *again["integrators"]):
        del one["seconds"]
    assert first == again
    assert not set(first["integrators"][0]["seeds"]) & set(other["integrators"][0]["seeds"])
    assert other["pairs"][0]["mean_ratio"] != first["pairs"][0]["mean_ratio"]
    assert all(each["pairs"][0]["verdict"] == "agree" for each in (first, other))


BAD = {
    "unknown": ("--integrators path,whited room", ('"whited"', 'did you mean "whitted"')),
    "nothing near": ("--integrators path,xyz room", ('"xyz"', "path, bdpt, direct, photon, radiosity, reuse, whitted")),
    "only one": ("--integrators path room", ("at least two", "whitted")),
    "an empty name": ("--integrators path, room", ('""',)),
    "two scenes": ("--integrators path,direct room cornell", ("one scene", "'cornell'")),
    "no such scene": ("--integrators path,direct rom", ('"rom"', '"room"')),
    "no scene": ("--integrators path,direct", ("missing", "SCENE")),
    "an option of the other way": ("a.npy b.npy --spp 4", ("--spp", "--integrators")),
    "a flag of the other way": ("a.npy b.npy --check", ("--check", "--integrators")),
    "few batches": ("--integrators path,direct room --batches 7", ("--batches", "at least 8")),
    "no such folder": ("--integrators path,direct room -o no/where", ("no/where", "cannot be made")),
    # Refused before path is rendered, or the device would be the fault
    "mirrors for radiosity": (
        "--integrators path,radiosity room -d nothing",
        ("shapes[10].material", "radiosity does not take"),
    ),
    "a file": ("--integrators path,direct room -o file", ("file", "is a file")),
}


@pytest.mark.thorough
@for_each("case", BAD)
def test_bad_command_lines_are_refused_in_one_sentence(case: str, tmp_path: Path) -> None:
    line, words = BAD[case]
    (tmp_path / "file").write_text("")
    result = call("compare", *line.split(), folder=tmp_path)
    assert result.returncode == 2 and result.stderr.count("\n") == 1 and result.stderr.startswith("error: ")
    assert all(word in result.stderr for word in words), result.stderr
    assert not result.stdout and [path.name for path in tmp_path.iterdir()] == ["file"]


@pytest.mark.parametrize("there", [False, True])
def test_what_fails_leaves_no_folder_behind(tmp_path: Path, there: bool) -> None:
    folder = tmp_path / "out"
    if there:
        folder.mkdir()
    result = call(
        "compare", "--integrators", "path,direct", "cornell", "-d", "no such device", "-o", "out", folder=tmp_path
    )
    assert result.returncode != 0 and "no such device" in result.stderr
    assert folder.exists() == there
