"""Names of earlier versions, `absorption` for `termination`: they are still read, and kept by hashes and films."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path
from typing import Any

import pytest

import clrender
from clrender.cli import main
from clrender.cli.render import render as render_command
from clrender.errors import ClrenderError
from clrender.film import Film
from clrender.film.request import differences, options_for
from clrender.rendering.job import RenderJob
from clrender.scene import Scene
from clrender.settings import settings_for
from clrender.view.edited_scene import EditedScene

NAMES = [("absorption", "absorption"), ("termination", "constant")]
"""Former and present names of the setting and of its roulette."""
CAMERA: dict[str, Any] = {"position": [0, 0, 5], "target": [0, 0, 0]}
TEXT = """
[camera]
position = [0, 0, 5]
target = [0, 0, 0]
[render]
roulette = "{1}"
{0} = 0.5
[materials.white]
type = "lambert"
reflectance = [0.75, 0.75, 0.75]
{0} = 0.25
[materials.glass]
type = "dielectric"
ior = 1.5
[[shapes]]
type = "sphere"
radius = 1.0
material = "white"
"""
REQUESTED = {"roulette": "absorption", "absorption": 0.5}
"""In a request."""


def plain(**materials: Any) -> Scene:
    white = {"type": "lambert", "reflectance": [0.75, 0.75, 0.75], **materials}
    return Scene(
        camera=CAMERA,
        materials={"white": white},
        shapes=[{"type": "sphere", "radius": 1.0, "material": "white"}],
    )


def sha256_of(request: dict[str, Any]) -> str:
    return hashlib.sha256(json.dumps(request, sort_keys=True, separators=(",", ":")).encode()).hexdigest()


@pytest.mark.parametrize("names", NAMES)
def test_a_file_has_the_hashes_that_it_always_had(tmp_path: Path, names: tuple[str, str]) -> None:
    (tmp_path / "scene.toml").write_text(TEXT.format(*names))
    scene = clrender.load(tmp_path / "scene.toml")
    assert (scene.render.roulette, scene.render.termination) == ("constant", 0.5)
    assert scene.materials["white"].termination == 0.25 and scene.materials["glass"].termination is None
    # Computed by the last version that knew the former names only
    assert scene.sha256() == "a2da1b3f884453e703f40e12cbb0ca9e0a33eca015d08b29dee61cccb14780c9"
    request = settings_for(scene, None, {}).request()
    assert sha256_of(request) == "f28ab2b9e8f7c4f182d78283ef1dbeca760bee9a4e5a24991c8fb4fae720488f"
    job = RenderJob.of(scene)
    assert RenderJob.from_json(*job.to_json()).sha256() == job.sha256()


@pytest.mark.parametrize(("name", "kind"), NAMES)
def test_every_way_to_give_a_setting_takes_both_names(name: str, kind: str) -> None:
    line = ["room", "-oa.png", f"--roulette={kind}", f"--{name}=0.5"]
    options = render_command.make_context("render", line, main.make_context("clrender", ["render"])).params
    called: dict[str, Any] = {
        key: options[key] for key in ("roulette", "absorption", "termination") if options[key] is not None
    }
    given: dict[str, Any] = {"roulette": kind, name: 0.5}
    edited = EditedScene.of(plain(), {}).set(given)
    made = [
        RenderJob.of(plain(), **called).settings,
        RenderJob.of(plain(), **given).settings,
        RenderJob.of(Scene(camera=CAMERA, render=given)).settings,
        RenderJob.of(plain().changed({"render.roulette": kind, f"render.{name}": 0.5})).settings,
        EditedScene.of(plain(), given).job.settings,
        edited.job.settings,
    ]
    assert all((each.roulette, each.termination) == ("constant", 0.5) for each in made)
    assert all(each.request().items() >= REQUESTED.items() for each in made)
    assert edited.settings == {"roulette": "constant", "termination": 0.5}
    assert edited.set({name: None}).settings == {"roulette": "constant"}
    assert edited.set({"roulette": None}).settings == {}


@pytest.mark.parametrize("name", ["absorption", "termination"])
def test_every_way_to_give_a_material_takes_both_names(name: str) -> None:
    edited = EditedScene.of(plain(termination=0.75), {}).with_material("white", {name: 0.25})
    made = [
        plain(**{name: 0.25}),
        plain(termination=0.75).changed({f"materials.white.{name}": 0.25}),
        edited.job.scene,
    ]
    assert all(each.materials["white"].termination == 0.25 for each in made)
    assert len({each.sha256() for each in made}) == 1 != len({plain().sha256(), made[0].sha256()})
    assert edited.with_material("white", {name: None}).job.scene.sha256() == plain().sha256()


BOTH: dict[str, Any] = {"absorption": 0.5, "termination": 0.5}


@pytest.mark.parametrize(
    "way",
    [
        lambda: RenderJob.of(plain(), roulette="constant", **BOTH),
        lambda: Scene(camera=CAMERA, render=BOTH),
        lambda: plain(**BOTH),
        lambda: plain().changed({f"materials.white.{name}": value for name, value in BOTH.items()}),
        lambda: EditedScene.of(plain(), {}).set({"roulette": "constant", **BOTH}),
        lambda: EditedScene.of(plain(), {}).with_material("white", BOTH),
    ],
)
def test_both_names_at_once_are_refused(way: Any) -> None:
    with pytest.raises(ClrenderError, match="absorption is the former name of termination, which is given too; leave"):
        way()


def test_films_are_compared_by_former_names_and_told_of_by_present_ones(tmp_path: Path) -> None:
    there = settings_for(plain(), (8, 8), {"roulette": "constant", "termination": 0.5}).request()
    here = settings_for(plain(), (8, 8), {}).request()
    Film(8, 8, there).save(tmp_path / "a.film")
    film = Film.load(tmp_path / "a.film")
    assert film.request == there and film.request.items() >= REQUESTED.items()
    found = differences(film.request, here)
    assert found == {
        "roulette": "roulette is constant there and throughput here",
        "termination": "termination is 0.5 there and None here",
    }
    assert options_for(film.request, dict(sorted(found.items()))) == "--roulette constant --termination 0.5"
    with pytest.raises(ClrenderError, match="'constant' and 'throughput'; termination 0"):
        film.merge(Film(8, 8, here))


def test_a_setting_that_came_later_is_in_no_request_that_leaves_it_out() -> None:
    assert "filter_radius" not in settings_for(plain(), (8, 8), {"filter": "tent"}).request()
    there, here = (settings_for(plain(), (8, 8), each).request() for each in ({"filter_radius": 2.0}, {}))
    assert there["filter_radius"] == 2.0
    assert list(differences(there, here)) == ["filter_radius"] == list(differences(here, there))
