"""`clrender furnace` as a user meets it: its table, page and numbers, bad input and exit codes."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from cases import for_each
from cli_support import call

if TYPE_CHECKING:
    from clrender.device import Device

SCENE = """
[camera]
position = [0, 0, 5]
target = [0, 0, 0]
[materials.clay]
type = "lambert"
reflectance = [0.8, 0.5, 0.3]
[materials.glass]
type = "dielectric"
ior = 1.5
"""


@pytest.mark.long
def test_a_scene_as_table_page_and_numbers(device: Device, tmp_path: Path) -> None:
    (tmp_path / "scene.toml").write_text(SCENE)
    on = ("-d", str(device.info.index))
    result = call("furnace", "scene.toml", "-o", "out", "--check", "--quick", *on, folder=tmp_path)
    assert result.returncode == 0, result.stderr
    assert re.search(r"^clay +lambert +0\.3000 to 0\.8000 +1\.0000 to 1\.0000", result.stdout, re.MULTILINE)
    assert "its colour absorbs 20.0 % of red, 50.0 % of green and 70.0 % of blue light" in result.stdout
    assert "glass:\n  conserves energy" in result.stdout and "is a delta" in result.stdout
    assert "FAULT" not in result.stdout
    assert "1 of 2: clay" in result.stderr

    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == ["furnace.html", "furnace.json"]
    page = (tmp_path / "out" / "furnace.html").read_text()
    assert page.count("<svg") == 3 and "<h2>glass</h2>" in page
    assert not re.search(r"<(script|link|img|iframe)|(src|href)=\"(?!#)|@import|url\((?!#)", page)
    numbers = json.loads((tmp_path / "out" / "furnace.json").read_text())
    assert [each["material"] for each in numbers] == ["clay", "glass"]
    for each in numbers:
        assert {"energy_max", "energy_min", "reciprocity_max", "chi2_p_min"} <= set(each)
    assert numbers[0]["energy_max"] == pytest.approx(0.8, abs=1e-5)
    assert numbers[0]["energy_min"] == pytest.approx(0.3, abs=1e-5)
    assert numbers[0]["reciprocity_max"] < 1e-5 and numbers[0]["chi2_p_min"] > 0.001


@pytest.mark.long
def test_json_is_printed_and_the_seed_makes_it(device: Device, tmp_path: Path) -> None:
    (tmp_path / "scene.toml").write_text(SCENE)
    line = ("furnace", "scene.toml", "--material", "clay", "--json", "--quiet", "--quick", "-d", str(device.info.index))
    first, again, other = (call(*line, *more, folder=tmp_path) for more in ((), (), ("--seed", "1")))
    assert first.returncode == 0 and not first.stderr
    assert first.stdout == again.stdout != other.stdout
    assert [each["material"] for each in json.loads(first.stdout)] == ["clay"]


@pytest.mark.long
def test_places_of_a_texture(device: Device, tmp_path: Path) -> None:
    """Three squares of a checker; what has no texture is measured once, and is called by its name alone."""
    checker = '[materials.board]\ntype = "lambert"\nreflectance = { checker = [0.2, 0.6] }\n'
    (tmp_path / "scene.toml").write_text(SCENE + checker)
    places = ("--uv", "0.25,0.25", "--uv", "0.75,0.25", "--uv", "-7.75,0.25", "--uv", "0.25,0.25")
    line = ("furnace", "scene.toml", "--material", "board", "--material", "clay", *places, "--quick")
    result = call(*line, "-d", str(device.info.index), "-o", "out", folder=tmp_path)
    assert result.returncode == 0, result.stderr
    assert "4 of 4: board at -7.75, 0.25" in result.stderr
    assert re.search(r"^board at 0.75, 0.25 +lambert +0\.6000 to 0\.6000", result.stdout, re.MULTILINE)
    numbers = json.loads((tmp_path / "out" / "furnace.json").read_text())
    assert [each["material"] for each in numbers] == ["clay", "board", "board", "board"]
    assert [each["uv"] for each in numbers] == [None, [0.25, 0.25], [0.75, 0.25], [-7.75, 0.25]]
    for each, expected in zip(numbers[1:], (0.2, 0.6, 0.2), strict=True):
        assert each["energy_max"] == pytest.approx(expected, abs=1e-5) == each["energy_min"]
    assert "<h2>board at 0.25, 0.25</h2>" in (tmp_path / "out" / "furnace.html").read_text()


@pytest.mark.thorough
@for_each(
    ("arguments", "expected"),
    [
        (["conducto"], 'did you mean "conductor"'),
        (['{type = "conductor", metal = "Au", roughness = 2}'], "roughness is 2"),
        (["{type"], "no inline table of TOML"),
        (["metals", "--material", "golt"], 'did you mean "gold"'),
        (["conductor", "--material", "gold"], "--material chooses among the materials of a scene"),
        (["conductor", "--seed", "-1"], "--seed"),
        (["conductor", "--uv", "0.5,0.5"], "--uv chooses a place in textures, and no material here has any"),
        (["textures", "--uv", "0.5"], "'0.5' is not two numbers such as 0.25,0.5"),
        (["textures", "--uv", "nan,1"], "has to be two finite numbers of at most 100000 in size"),
        (["conductor", "-o", "file"], "file: is a file; name a folder"),
        (["conductor", "-d", "nothing-like-it"], "nothing-like-it"),
    ],
)
def test_bad_input_is_one_sentence(arguments: list[str], expected: str, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    result = call("furnace", *arguments, folder=tmp_path)
    assert result.returncode == 2
    assert result.stderr.count("\n") == 1 and result.stderr.startswith("error: ") and expected in result.stderr
    assert [path.name for path in tmp_path.iterdir()] == ["file"]
