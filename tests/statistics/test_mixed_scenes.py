"""Random scenes of everything: white furnaces are white, black scenes black, and all ways to an image agree.

A failure names its scenes. ``python tests/statistics/mixed_scenes.py KIND NUMBER -o DIR`` writes one as a file.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from contextlib import nullcontext
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING, Any

import mixed_oracles
import numpy as np
import pytest
from mixed_coverage import parts_of_scene, parts_of_schema
from mixed_files import written
from mixed_moves import PLACES, compiled_for_volumes, moved, with_all_features
from mixed_oracles import Comparison, Oracle, different, surprising
from mixed_parts import Draw, Json
from mixed_scenes import KINDS, Mixed, mixed_scene
from mixed_ways import UNUSED, biased_ways, black_ways, ways, white_ways

import clrender
from clrender.errors import SceneError
from clrender.flatten.flat_scene import flatten
from clrender.flatten.plugin_rows import used_plugins
from clrender.limits import Choice
from clrender.scene import Scene
from clrender.settings import IMAGE, SETTINGS

if TYPE_CHECKING:
    from clrender.device import Device

ALARM = 1e-3
"""Chance that a correct renderer fails either of the two tests of scenes, each time its bits change."""
FEW = {"white": (5, 20), "light": (3, 37), "black": (8, 32)}
"""Of two programs, with an environment map and without: `test_few_programs_are_compiled`."""
SIDE_BY_SIDE = {"white": (5,), "light": (18, 3), "black": (8, 17)}
"""Of one program, with volumes, where an index of refraction once depended on the materials of other paths."""
MANY = 500
PARTS = 10
NATURAL = 10
"""Of so many scenes one is rendered without the features that it lacks, by the program of the path tracer alone."""
OF_ALL_PROGRAMS = 50
"""Of so many scenes one is rendered without them by all programs. To compile those takes longer than all images."""
PROGRAMS = ("filter", "splitting", "photon", "whitted", "reuse", "direct", "shadow_rays", "guided", "chains", "bdpt")
"""Ways that need programs of their own."""
NEVER = {
    ("Scene", "title"),
    ("Scene", "image"),
    ("Scene", "render"),
    *((camera, key) for camera in ("Camera",) for key in ("f_stop", "iso")),  # of display images
    ("Camera", "response"),  # other colours (tests/image/test_spectral.py)
    ("Spectrum", "color"),  # of files of other programs (tests/host/test_mitsuba_spectra.py)
    *(("Response", key) for key in ("wavelengths", "red", "green", "blue", "white")),
    ("Camera", "flow_step"),  # of layers (tests/image/test_flow.py)
    ("Camera", "rolling_shutter"),  # refused by half of the integrators (tests/image/test_motion_blur.py)
    *((shape, "interior") for shape in ("Quad", "Disk", "Triangle")),  # of closed shapes
    *(("Curves", key) for key in ("emission", "interior", "flip_normals")),  # refused
    *((grid, "name") for grid in ("Density", "ColorGrid", "Temperature")),  # of sparse files (tests/host/test_grids.py)
    ("MeshPose", "file"),  # (tests/image/test_deforming.py)
    *(("Subsurface", key) for key in ("opacity", "opacity_cutoff")),  # refused
}
"""Keys that no mixed scene has. Of the settings in a scene file see `test_every_setting_is_varied`."""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of the files."""
    return written(tmp_path_factory.mktemp("mixed"))


@pytest.fixture(scope="module")
def session(device: Device) -> Iterator[clrender.Session]:
    """Renders on the device under test."""
    with clrender.Session(device.info.index) as opened:
        yield opened


@pytest.fixture
def oracle(session: clrender.Session, folder: Path) -> Oracle:
    """Without the ways that need programs of their own, which take longer to compile than all images."""
    return Oracle(session, folder, without=PROGRAMS)


def told(found: list[Comparison]) -> str:
    return "\n".join(f"{each.scene}: {each.way}: {each.text}, chance {each.chance:.2g}" for each in found)


@pytest.mark.thorough
def test_a_few_mixed_scenes(oracle: Oracle) -> None:
    scenes = [mixed_scene(kind, number) for kind, numbers in FEW.items() for number in numbers]
    made = [comparison for mixed in scenes for comparison in oracle.judged(mixed)]
    assert len(made) > 20
    assert not (found := surprising(made, ALARM)), told(found)


@pytest.mark.slow
@pytest.mark.parametrize("part", range(PARTS))
def test_many_mixed_scenes(session: clrender.Session, folder: Path, part: int) -> None:
    """In parts of some minutes each, which share the chance of a false alarm."""
    whole, path = Oracle(session, folder, more=4), Oracle(session, folder, more=4, without=PROGRAMS)
    made: list[Comparison] = []
    for number in range(part * MANY // PARTS, (part + 1) * MANY // PARTS):
        mixed = mixed_scene(KINDS[number % len(KINDS)], number // len(KINDS))
        natural = number % NATURAL == 0
        oracle = path if natural and number % OF_ALL_PROGRAMS else whole
        made += oracle.judged(mixed, all_features=not natural)
    assert not (found := surprising(made, ALARM / PARTS)), told(found)


def cut(session: clrender.Session, folder: Path, mixed: Mixed, *cuts: dict[str, Any], **settings: Any) -> set[str]:
    """Hashes of a small image by a program with all features, whole and with the work cut in other ways."""
    what = Mixed(mixed.name, with_all_features(mixed.content)).scene(folder)
    with compiled_for_volumes():
        made = [session.render(what, size=(24, 20), spp=4, **settings, **each) for each in ({}, *cuts)]
    return {image.stats["image_sha256"] for image in made}


IN_PIECES: dict[str, Any] = {"tile": 16, "samples_per_pass": 1}


@pytest.mark.thorough
def test_mixed_scenes_have_the_same_bits_however_they_are_cut(
    session: clrender.Session, device: Device, folder: Path
) -> None:
    """Other paths lie side by side then, and what one of them has met must not matter to another.

    A GPU has not the registers for several lanes of a program with all features.
    """
    scenes = [mixed_scene(kind, number) for kind, numbers in SIDE_BY_SIDE.items() for number in numbers]
    cuts = (IN_PIECES, {"kernels": "staged"}, {"lanes": 4})[: 3 if device.is_cpu else 2]
    assert [mixed.name for mixed in scenes if len(cut(session, folder, mixed, *cuts)) != 1] == []


@pytest.mark.slow
@pytest.mark.parametrize("settings", [{}, {"shadow_rays": 2, "indirect_rays": 2}, {"specular_chains": "on"}], ids=str)
def test_mixed_scenes_have_the_same_bits_in_stages(
    session: clrender.Session, folder: Path, settings: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Few paths are under way, so that others take the places of those which end."""
    monkeypatch.setattr("clrender.device.worker._staged_paths", lambda *_: 96)
    scenes = [mixed_scene(kind, number) for kind, number in product(KINDS, range(25))]
    ways = {mixed.name: cut(session, folder, mixed, {"kernels": "staged"}, **settings) for mixed in scenes}
    assert [name for name, hashes in ways.items() if len(hashes) != 1] == []


@pytest.mark.long
@pytest.mark.parametrize(
    "scenes",
    [(("white", 3),), pytest.param(tuple(product(KINDS, range(40))), marks=pytest.mark.slow)],
    ids=["one", "many"],
)
def test_volumes_that_a_scene_lacks_change_no_bit(
    device: Device, folder: Path, scenes: tuple[tuple[str, int], ...]
) -> None:
    """Where kernels are compiled for them."""
    changed, lacking = [], 0
    for kind, number in scenes:
        mixed = mixed_scene(kind, number)
        what = Mixed(mixed.name, with_all_features(mixed.content)).scene(folder)
        hashes, macros = set(), list[dict[str, int | str]]()
        for compiled in (nullcontext, compiled_for_volumes):
            with compiled(), clrender.Session(device) as session:
                hashes.add(session.render(what, size=(24, 20), spp=4).stats["image_sha256"])
                macros.append(flatten(what, 24, 20).features.macros)
        lacking += macros[0] != macros[1]
        changed += [mixed.name] if len(hashes) != 1 else []
    assert not changed
    assert lacking


@pytest.mark.slow
def test_mixed_scenes_have_the_same_bits_in_all_lanes(session: clrender.Session, folder: Path) -> None:
    scenes = [mixed_scene(kind, number) for kind in KINDS for number in range(16)]
    ways = (IN_PIECES, *({"lanes": lanes, "code": "fast"} for lanes in (1, 4, 8, 16)))
    assert [mixed.name for mixed in scenes if len(cut(session, folder, mixed, *ways)) != 1] == []


@pytest.mark.slow
def test_a_wrong_image_is_found(oracle: Oracle, monkeypatch: pytest.MonkeyPatch) -> None:
    """Lights that are 10 % brighter in one of two images, 2 % of a white furnace, and a room without walls."""

    def brighter(content: Json, factor: float, by: list[float]) -> Json:
        made = moved(content, factor, by)
        made["lights"][0]["scale"] = [1.1 * share for share in made["lights"][0]["scale"]]
        return made

    monkeypatch.setattr(mixed_oracles, "moved", brighter)
    ball = {"type": "sphere", "radius": 1.0, "material": "grey"}
    content = {
        "camera": {"position": [0.0, 0.0, 5.0], "target": [0.0, 0.0, 0.0]},
        "materials": {"grey": {"type": "lambert", "reflectance": [0.5] * 3}},
        "shapes": [ball],
        "lights": [{"type": "environment", "radiance": [1.0] * 3}],
    }
    lit = Mixed("lit", content)
    assert {each.way.partition(" ")[0] for each in surprising(list(oracle.judged(lit)), ALARM)} == {"moved"}
    assert surprising(list(oracle.judged(dataclasses.replace(mixed_scene("white", 20), exact=1.02))), ALARM)
    assert surprising(list(oracle.judged(dataclasses.replace(lit, exact=0.0))), ALARM)


def test_deviations_are_judged_by_mean_and_median() -> None:
    rng = np.random.default_rng(1)
    even = rng.normal(1.0, 0.1, (64, 4))
    assert different(even, 1.0, (0.0, 0.0), robust=True)[0] > 1e-3
    assert different(even + 0.1, 1.0, (0.0, 0.0), robust=True)[0] < 1e-6
    assert different(even + 0.1, 1.0, (0.0, 0.1), robust=True)[0] > 1e-3
    assert different(even - 0.1, 1.0, (0.0, 0.1), robust=True)[0] < 1e-6
    rare = even - 0.05 * (rng.random(even.shape) < 0.99)  # what is missing here is found one time in a hundred
    assert different(np.zeros((8, 4)), 0.0, (0.0, 0.0), robust=False)[0] == 1.0
    assert different(rare, 1.0, (0.0, 0.0), robust=True)[0] < 1e-3


def test_holm() -> None:
    made = [Comparison("", "", chance, "") for chance in (0.5, 1e-9, 0.0004, 0.0003, 0.9)]
    assert [each.chance for each in surprising(made, 1e-3)] == [1e-9]
    assert [each.chance for each in surprising(made, 1.3e-3)] == [1e-9, 0.0003, 0.0004]


def test_scenes_have_all_of_the_schema() -> None:
    """Whatever is added to the schema has to be added to the mixed scenes, or to `NEVER` with a reason."""
    schema = Scene.model_json_schema()
    known = {part for part in parts_of_schema(schema) if part[:2] not in NEVER and part[0] not in ("Image", "Render")}
    found = {
        part for kind in KINDS for n in range(MANY) for part in parts_of_scene(schema, mixed_scene(kind, n).content)
    }
    assert not known - found
    assert found <= parts_of_schema(schema)


def test_few_programs_are_compiled(folder: Path) -> None:
    """By the tests that are not slow: to compile one takes longer than their images."""
    found = []
    for chosen in (FEW, SIDE_BY_SIDE):
        macros = set()
        for mixed in (mixed_scene(kind, number) for kind, numbers in chosen.items() for number in numbers):
            what = Mixed(mixed.name, with_all_features(mixed.content)).scene(folder)
            with compiled_for_volumes():
                macros.add(tuple(sorted(flatten(what, 24, 20).features.macros.items(), key=str)))
        found.append(macros)
    assert [len(macros) for macros in found] == [2, 1] and found[1] < found[0]


def test_every_setting_is_varied() -> None:
    """All settings of the image, and all words that they take."""
    used: dict[str, set[Any]] = {}
    for kind in KINDS:
        for number in range(100):
            mixed, draw = mixed_scene(kind, number), Draw(f"{number}", white=False)
            made = [
                *ways(draw, mixed.content),
                *biased_ways(mixed.content),
                *white_ways(draw, mixed.content),
                *black_ways(draw),
            ]
            for name, value in (item for way in made for item in way.settings.items()):
                used.setdefault(name, set()).add(value)
    for name, setting in SETTINGS.items():
        if setting.group != IMAGE or name in UNUSED:
            continue
        words = set(setting.domain.members) if isinstance(setting.domain, Choice) else set()
        left = (
            {word for word in words if isinstance(word, str)} - used.get(name, set()) - {setting.default, "radiosity"}
        )
        assert name in used and not left, (name, left)


@pytest.mark.thorough
def test_every_scene_is_accepted(folder: Path) -> None:
    """With all features and without: the slow tests render most of them."""
    refused = dict[str, str]()
    for mixed in (mixed_scene(KINDS[number % len(KINDS)], number // len(KINDS)) for number in range(MANY)):
        for content in (mixed.content, with_all_features(mixed.content)):
            try:
                used_plugins(Mixed(mixed.name, content).scene(folder))
            except SceneError as error:
                refused[mixed.name] = str(error)
    assert not refused


def test_scenes_are_the_same_each_time(folder: Path) -> None:
    assert mixed_scene("light", 3) == mixed_scene("light", 3) != mixed_scene("light", 4)
    path = mixed_scene("light", 3).write(folder / "written")
    assert clrender.load(path).sha256() == mixed_scene("light", 3).scene(folder).sha256()


def test_moves_know_the_places(folder: Path) -> None:
    np.testing.assert_allclose(np.load(folder / "places.npy"), np.array(PLACES)[:, :3])
    content: dict[str, Any] = mixed_scene("white", 0).content
    there_and_back = moved(moved(content, 4.0, [1.0, 2.0, 3.0]), 0.25, [-0.25, -0.5, -0.75])
    np.testing.assert_allclose(there_and_back["camera"]["position"], content["camera"]["position"])
    Mixed("all", with_all_features(content)).scene(folder)


@pytest.mark.slow
def test_one_program_renders_all_scenes(session: clrender.Session, folder: Path) -> None:
    """With the bits of each scene's own program, without the features that it lacks."""
    different_ones = []
    for kind, number in product(("light", "white"), range(20)):
        mixed = mixed_scene(kind, number)
        scene, images = mixed.scene(folder), set()
        for code in ("any", "small"):
            image = session.render(scene, size=(48, 36), spp=8, code=code)
            images.add(image.stats["image_sha256"])
        if len(images) > 1:
            different_ones.append(mixed.name)
    assert different_ones == []
