"""Descriptions of data sets: what they may say, what is drawn and with which distribution, and that it stays."""

from __future__ import annotations

import json
import math
import re
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from dataset_support import SCENE, SPEC, write_dataset
from scipy.stats import chisquare, kstest

import clrender
from clrender.datasets import DatasetPlan, load_spec
from clrender.datasets.values import drawn
from clrender.errors import ClrenderError, SceneError
from clrender.exact.counters import Draws
from clrender.scene.transforms import affine

ALARM = 1e-5
"""Chance that a right distribution fails a test, when its bits change."""


def plan_of(folder: Path, **changes: Any) -> DatasetPlan:
    path = write_dataset(folder, **changes)
    return DatasetPlan.of(load_spec(path), str(path), folder)


def draws(place: str) -> Draws:
    return Draws(0, place, 0)


def many(value: Any, count: int = 4000) -> list[Any]:
    def one(index: int) -> Any:
        return drawn(value, lambda place: Draws(1, f"test{place}", index))

    return [one(index) for index in range(count)]


# --- distributions ---------------------------------------------------------------------------------------------------


def test_uniform_numbers_and_vectors() -> None:
    assert kstest(many({"uniform": [2.0, 6.0]}), "uniform", (2.0, 4.0)).pvalue > ALARM
    points = np.array(many({"uniform": [[0, -1, 5], [1, 1, 5]]}))
    assert (points[:, 2] == 5.0).all() and abs(np.corrcoef(points[:, :2].T)[0, 1]) < 0.08
    assert kstest(points[:, 1], "uniform", (-1.0, 2.0)).pvalue > ALARM


def test_log_uniform_and_normal_numbers() -> None:
    logs = np.log(many({"log_uniform": [0.01, 10.0]}))
    assert kstest(logs, "uniform", (math.log(0.01), math.log(1000.0))).pvalue > ALARM
    assert kstest(many({"normal": [3.0, 0.5]}), "norm", (3.0, 0.5)).pvalue > ALARM
    within = np.array(many({"normal": [0.0, 1.0], "within": [-0.5, 1.0]}))
    assert within.min() >= -0.5 and within.max() <= 1.0
    assert kstest(within, "truncnorm", (-0.5, 1.0)).pvalue > ALARM


def test_whole_numbers_and_choices() -> None:
    counts = Counter(many({"integer": [-1, 4]}))
    assert sorted(counts) == list(range(-1, 5)) and chisquare(list(counts.values())).pvalue > ALARM
    chosen = Counter(many({"choice": ["a", "b", "c"], "weights": [1, 0, 3]}))
    assert set(chosen) == {"a", "c"} and chisquare([chosen["a"], chosen["c"]], [1000, 3000]).pvalue > ALARM
    nested = many({"choice": [{"uniform": [0, 1]}, {"type": "x", "size": {"integer": [2, 2]}}]}, 50)
    assert {"type": "x", "size": 2} in nested and any(isinstance(each, float) for each in nested)


def test_temperatures_are_colours_of_their_power() -> None:
    warm, cold = (drawn({"temperature": kelvin, "power": 5.0}, draws) for kelvin in (2700, 10000))
    for red, green, blue in (warm, cold):
        assert 0.2126 * red + 0.7152 * green + 0.0722 * blue == pytest.approx(5.0)
    assert warm[0] > warm[1] > warm[2] and cold[2] > cold[0]


def test_what_is_no_distribution_stays() -> None:
    for value in (
        3,
        [1.0, {"a": [True]}],
        {"normal": [0, 1, 0], "type": "disk"},
        {"checker": [0.1, 0.9]},
        "text",
        None,
    ):
        assert drawn(value, draws) == value


# --- images ----------------------------------------------------------------------------------------------------------


def test_cameras_are_uniform_over_the_shell(tmp_path: Path) -> None:
    """Heights above the target and azimuths, between their bounds."""
    plan = plan_of(
        tmp_path, images=3000, objects=None, distractors=None, vary=None,
        camera={"type": "sphere", "target": [1, 2, 3], "distance": {"uniform": [2, 3]}, "elevation_degrees": [-30, 60]},
    )  # fmt: skip
    away = np.array([plan.image(n).scene.camera.position for n in range(3000)]) - (1.0, 2.0, 3.0)
    distance = np.linalg.norm(away, axis=1)
    assert kstest(distance, "uniform", (2.0, 1.0)).pvalue > ALARM
    assert kstest(away[:, 1] / distance, "uniform", (-0.5, 0.5 + math.sin(math.radians(60)))).pvalue > ALARM
    assert kstest(np.arctan2(away[:, 0], away[:, 2]), "uniform", (-math.pi, 2 * math.pi)).pvalue > ALARM
    assert all(plan.image(n).scene.camera.target == (1.0, 2.0, 3.0) for n in range(3))


@pytest.mark.parametrize("up", ["x", "y", "z"])
def test_up_and_roll(tmp_path: Path, up: str) -> None:
    table = {"type": "sphere", "target": [0, 0, 0], "distance": 2.0, "elevation_degrees": [80, 90], "roll_degrees": 0.0}
    axis = np.eye(3)["xyz".index(up)]
    level = plan_of(tmp_path, up=up, camera=table)
    rolled = plan_of(tmp_path, up=up, camera={**table, "roll_degrees": 30.0})
    for n in range(5):
        (right, upward, forward), (turned, _, ahead) = (each.image(n).scene.camera.axes for each in (level, rolled))
        assert np.dot(forward, axis) < -0.98 and np.dot(upward, axis) > 0.0 and abs(np.dot(right, axis)) < 1e-12
        np.testing.assert_allclose(ahead, forward, atol=1e-12)
        assert np.dot(turned, right) == pytest.approx(math.cos(math.radians(30.0)))
        assert np.dot(turned, upward) == pytest.approx(-math.sin(math.radians(30.0))), (
            "clockwise, as the camera sees it"
        )


def test_a_camera_straight_above(tmp_path: Path) -> None:
    plan = plan_of(
        tmp_path, camera={"type": "sphere", "distance": 2.0, "target": [0, 0, 0], "elevation_degrees": [90, 90]}
    )
    np.testing.assert_allclose(plan.image(0).scene.camera.position, (0.0, 2.0, 0.0), atol=1e-12)


def test_cameras_of_a_file(tmp_path: Path) -> None:
    write_dataset(tmp_path)
    pose: list[list[float]] = [[1, 0, 0, 0.5], [0, 1, 0, 1.0], [0, 0, 1, 4.0], [0, 0, 0, 1]]
    frames = list[dict[str, Any]]()
    for n in range(3):
        matrix = [row[:] for row in pose]
        matrix[0][3] += n
        frames.append({"file_path": f"{n}.png", "transform_matrix": matrix, "fl_x": 40 + n, "w": 36, "h": 28})
    (tmp_path / "transforms.json").write_text(json.dumps({"frames": frames}))
    vary = {"camera.cx": {"uniform": [10.0, 20.0]}}
    plan = plan_of(tmp_path, size=None, camera={"type": "file", "file": "transforms.json"}, vary=vary)
    cameras = [plan.image(n) for n in range(6)]
    assert [each.scene.camera.position[0] for each in cameras] == [0.5, 1.5, 2.5] * 2
    assert [each.scene.camera.fx for each in cameras] == [40.0, 41.0, 42.0] * 2 and cameras[0].size == (36, 28)
    assert len({each.scene.camera.cx for each in cameras}) == 6
    several = plan_of(tmp_path, vary=None, camera={"type": "file", "file": "transforms.json", "order": "random"})
    assert len({several.image(n).drawn["camera.file"] for n in range(20)}) == 3


def test_objects_stand_where_they_are_put(tmp_path: Path) -> None:
    """The pivot comes to the position, and rotation and scale are about it; distractors are added."""
    objects = [{"name": "ball", "pivot": [0.7, 0.3, 0.0], "position": [1, 2, 3], "yaw_degrees": 90.0, "scale": 2.0},
               {"name": ["stool", "floor"], "position": [0, 5, 0]}]  # fmt: skip
    varied = plan_of(tmp_path, objects=objects, distractors=None).image(0)
    floor, stool, ball = varied.scene.shapes
    place = affine(ball.transform)
    np.testing.assert_allclose(place.point((0.7, 0.3, 0.0)), (1, 2, 3), atol=1e-12)
    np.testing.assert_allclose(place.point((1.7, 0.3, 0.0)), (1, 2, 1), atol=1e-12)  # x turns to -z about y
    for shape in (floor, stool):
        np.testing.assert_allclose(affine(shape.transform).point((1.0, 1.0, 1.0)), (1.0, 6.0, 1.0))
    counts = [len(plan_of(tmp_path).image(n).scene.shapes) for n in range(30)]
    assert min(counts) == 2 and max(counts) == 6
    present = [any(shape.name == "ball" for shape in plan_of(tmp_path).image(n).scene.shapes) for n in range(60)]
    assert 30 < sum(present) < 55


def test_any_rotation_is_uniform(tmp_path: Path) -> None:
    objects = [{"name": "stool", "rotation": "any"}]
    plan = plan_of(tmp_path, objects=objects, distractors=None, vary=None, images=2000)
    turns = np.array([affine(plan.image(n).scene.shapes[1].transform).linear for n in range(2000)])
    np.testing.assert_allclose(turns @ np.swapaxes(turns, 1, 2), np.broadcast_to(np.eye(3), turns.shape), atol=1e-12)
    np.testing.assert_allclose(np.linalg.det(turns), 1.0)
    for i in range(3):  # each column is uniform over the sphere, whose heights are (Archimedes)
        for j in range(3):
            assert kstest(turns[:, i, j], "uniform", (-1.0, 2.0)).pvalue > ALARM


def test_choice_among_models(tmp_path: Path) -> None:
    objects = [{"name": "stool", "group": {"choice": ["stool", "cube", "orb"]}}]
    plan = plan_of(tmp_path, objects=objects, distractors=None)
    assert {plan.image(n).scene.shapes[1].group for n in range(30)} == {"stool", "cube", "orb"}  # type: ignore[union-attr]


def test_an_image_depends_on_its_number_only(tmp_path: Path) -> None:
    """Neither on how many there are, nor on what else varies."""
    one = plan_of(tmp_path).image(4)
    vary = {"materials.floor.reflectance": {"uniform": [[0, 0, 0], [1, 1, 1]]}, **SPEC["vary"]}
    other = plan_of(tmp_path, images=10**6, vary=vary, categories=["toy", "furniture"]).image(4)
    assert other.drawn.pop("vary.materials.floor.reflectance") and other.drawn == one.drawn
    assert (other.seed, other.scene.camera) == (one.seed, one.scene.camera)
    assert plan_of(tmp_path, seed=8).image(4).drawn != one.drawn
    assert plan_of(tmp_path).image(4).scene.sha256() == one.scene.sha256()
    assert one.scene.sha256() == "ebaee4c1ccdf17138f44b79c0da7c4cf5f02648def4739ce4f19d04f43b84380", "on every machine"


def test_the_order_of_tables_does_not_matter(tmp_path: Path) -> None:
    """A manifest has them sorted."""
    lamp = {
        "type": "point",
        "position": {"uniform": [[-1] * 3, [1] * 3]},
        "intensity": {"temperature": 3000, "power": {"uniform": [1, 9]}},
    }
    vary: dict[str, dict[str, Any]] = {"lights[2]": lamp, "camera.vertical_fov": {"uniform": [30, 50]}}
    turned = {key: dict(reversed(each.items())) for key, each in reversed(vary.items())}
    one, other = (plan_of(tmp_path, vary=each) for each in (vary, turned))
    assert one.spec.sha256() == other.spec.sha256() and one.image(3).drawn == other.image(3).drawn
    assert one.image(3).scene.sha256() == other.image(3).scene.sha256()


def test_hash_of_the_description(tmp_path: Path) -> None:
    plain = load_spec(write_dataset(tmp_path))
    assert load_spec(write_dataset(tmp_path, up="y", exposure=0.0)).sha256() == plain.sha256(), (
        "defaults count for nothing"
    )
    assert load_spec(write_dataset(tmp_path, seed=8)).sha256() != plain.sha256()
    path = tmp_path / "set.toml"
    path.write_text('scene = "scene.json"\nimages = 2\n[render]\nspp = 3\n')
    (tmp_path / "other.json").write_text('{"render": {"spp": 3}, "images": 2, "scene": "scene.json"}')
    assert load_spec(path).sha256() == load_spec(tmp_path / "other.json").sha256()
    assert load_spec(path, ["coco"]).writers == ("coco",)


# --- bad input -------------------------------------------------------------------------------------------------------

BAD: dict[str, tuple[dict[str, Any], str]] = {
    "an unknown key": ({"image": 3}, r'image is an unknown key; did you mean "images"'),
    "no images": ({"images": 0}, "images is 0, but must be at least 1"),
    "no scene": ({"scene": None}, "the key `scene` is missing"),
    "an unknown writer": ({"writers": ["cocoo"]}, r'writers\[0\] is "cocoo", which is not known; did you mean "coco"'),
    "an unknown layer": ({"layers": ["dept"]}, 'layers names there is no layer .dept.; did you mean "depth"'),
    "bounds that are exchanged": (
        {"vary": {"camera.vertical_fov": {"uniform": [3, 1]}}},
        "vertical_fov.*uniform goes from 3 to 1",
    ),
    "one bound": (
        {"vary": {"a": {"uniform": [3]}}},
        r"vary\.a\.uniform is a list of one, but must be \[lowest, highest\]",
    ),
    "vectors of two lengths": ({"vary": {"a": {"uniform": [[1, 2], [3]]}}}, "two lists of as many"),
    "logarithm of zero": ({"vary": {"a": {"log_uniform": [0, 3]}}}, "begins at 0, but must begin above 0"),
    "fractions": ({"vary": {"a": {"integer": [0, 3.5]}}}, "must have whole numbers"),
    "no choice": ({"vary": {"a": {"choice": []}}}, "must be a list of what is chosen from"),
    "weights": ({"vary": {"a": {"choice": [1, 2], "weights": [1]}}}, "must be 2 whole numbers"),
    "a negative deviation": ({"vary": {"a": {"normal": [0, -1]}}}, "must not be negative"),
    "within without the mean": ({"vary": {"a": {"normal": [0, 1], "within": [1, 2]}}}, "leaves out the mean 0"),
    "no such place": (
        {"vary": {"materials.rd.reflectance": [0, 0, 0]}},
        'image 0: .*materials.rd is not there; did you mean "red"',
    ),
    "what the place does not take": (
        {"vary": {"camera.vertical_fov": {"choice": ["wide"]}}},
        "image 0: .*vertical_fov is the text",
    ),
    "no such object": (
        {"objects": [{"name": "stol"}]},
        'image 0: objects: there is no shape of the name "stol"; did you mean "stool"',
    ),
    "no such group": (
        {"distractors": [{"groups": ["cub"]}]},
        r'distractors\[0\].groups names the group "cub", which the scene does not have; did you mean "cube"',
    ),
    "a group that a later image draws": (
        {"objects": [{"name": "stool", "group": {"choice": ["stool", {"choice": ["cub"]}], "weights": [1000, 1]}}]},
        r'objects\[0\].group names the group "cub", which the scene does not have; did you mean "cube"',
    ),
    "a distribution misspelt": (
        {"vary": {"a": [1, {"unifrom": [0, 1]}]}},
        r"vary\.a\[1\]\.unifrom is no distribution; did you mean uniform",
    ),
    "an object twice": ({"objects": [{"name": "ball"}, {"name": ["ball"]}]}, 'objects place "ball" twice'),
    "a group of what has none": (
        {"objects": [{"name": "ball", "group": "cube"}]},
        '"ball" is no instance, so it has no group',
    ),
    "two rotations": (
        {"objects": [{"name": "ball", "rotation": "any", "yaw_degrees": 3.0}]},
        "yaw_degrees is given beside rotation",
    ),
    "a position of two numbers": (
        {"objects": [{"name": "ball", "position": [1, 2]}]},
        "objects.ball.position is .*three numbers",
    ),
    "scale of zero": ({"objects": [{"name": "ball", "scale": 0}]}, "objects.ball.scale is 0, but must be"),
    "distance of a box": (
        {"camera": {"type": "box", "position": [1, 1, 1], "distance": 2}},
        "camera.distance is for cameras of type sphere",
    ),
    "no distance": ({"camera": {"type": "sphere"}}, "the key `distance` is missing; cameras of type sphere need it"),
    "elevations": (
        {"camera": {"type": "sphere", "distance": 1, "elevation_degrees": [50, 20]}},
        "elevation_degrees must be two angles",
    ),
    "a camera in its target": (
        {"camera": {"type": "box", "position": [0, 0, 0], "target": [0, 0, 0]}},
        "is where camera.target is",
    ),
    "a setting elsewhere": ({"render": {"seed": 3}}, r"render\.seed is not set here; use seed"),
    "an unknown setting": ({"render": {"sp": 3}}, r'render\.sp is an unknown setting; did you mean "spp"'),
    "a wrong setting": ({"render": {"spp": 0}}, "render: .*spp.*at least 1"),
    "a wrong sensor": ({"sensor": {"bits": 20}}, r"sensor\.bits is 20, but must be"),
    "a mosaic of one pixel": (
        {"size": [1, 1], "sensor": {"bayer": "rggb"}},
        r"image 0: sensor\.bayer: an image of 1 x 1 pixels has no mosaic; two a side are needed \(size\)",
    ),
    "a wrong filter": ({"sensor": {"bayer": "rgb"}}, r"sensor\.bayer is"),
    "a category that is not listed": (
        {"categories": ["toy"]},
        'image 0: the category "furniture" is not in categories',
    ),
    "a category twice": ({"categories": ["toy", "toy"]}, "categories has a name twice"),
    "no such scene": ({"scene": "scen.json"}, "scen.json.*no such file"),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_descriptions_are_refused_in_one_sentence(tmp_path: Path, case: str) -> None:
    changes, words = BAD[case]
    more = {} if "objects" in changes or case == "no such group" else {"objects": None}
    with pytest.raises(ClrenderError, match=words) as caught:
        plan_of(tmp_path, **{"vary": None, **more, **changes})
    assert "\n" not in str(caught.value) and ("set.json" in str(caught.value) or case == "no such scene")


@pytest.mark.parametrize("key", ["position", "target", "up", "motion[0].position"])
@pytest.mark.parametrize("way", ["sphere", "hemisphere", "box", "target", "roll", "motion", "half a motion", "scene"])
def test_cameras_drawn_without_effect(tmp_path: Path, key: str, way: str) -> None:
    """They would be recorded as if they were so."""
    stops: list[dict[str, Any]] = [{"time": 0.0, "position": [0, 0, 4]}, {"time": 1.0, "position": [0, 0, 3]}]
    (stops if way != "half a motion" else stops[:1])[-1]["up"] = [0, 1, 0]
    moves = "motion" in way or "motion" in key
    (tmp_path / "scene.json").write_text(
        json.dumps({**SCENE, "camera": {**SCENE["camera"], "motion": stops if moves else []}})
    )
    cameras: dict[str, dict[str, Any]] = {
        "sphere": {"type": "sphere", "distance": 3},
        "hemisphere": {"type": "hemisphere", "distance": 3},
        "box": {"type": "box", "position": [5, 5, 5], "target": [0, 0, 0]},
        "target": {"target": [0, 0, 0]},
        "roll": {"roll_degrees": 3},
    }
    camera = cameras.get(way, {})
    placed = {"position", "up"} if way in ("sphere", "hemisphere", "box") else set[str]()
    without = placed | ({"target"} if "target" in camera else set()) | ({"motion[0].position"} if camera else set())
    without |= {"position"} if moves and not camera else set()
    table: dict[str, Any] = {"scene": "scene.json", "images": 1, "camera": camera}
    table["vary"] = {f"camera.{key}": {"uniform": [[0.1, 0.9, 0.1], [0.2, 1.0, 0.2]]}}
    if key in without:
        with pytest.raises(ClrenderError, match=f"vary.camera.{re.escape(key)} has no effect, since"):
            DatasetPlan.from_table(table, tmp_path)
    else:
        assert f"vary.camera.{key}" in DatasetPlan.from_table(table, tmp_path).image(0).drawn


def test_places_of_values_of_two_kinds(tmp_path: Path) -> None:
    """They have the names of the file, and none of the validation's."""
    camera = {"position": [0, 0, 1], "target": [0, 0, 0]}
    for shutter, said in (
        ([0.0, "a"], 'camera.shutter[1] is the text "a", but must be a number'),
        ([0.0], "camera.shutter has only one entry, but must have 2"),
        ("1/60", 'camera.shutter is the text "1/60", but must be a number'),
        (0.0, "camera.shutter is 0.0, but must be at least"),
    ):
        with pytest.raises(SceneError) as caught:
            clrender.Scene(camera={**camera, "shutter": shutter})
        assert str(caught.value).startswith(f"Scene: {said}")
    write_dataset(tmp_path, load={"environment": [1.0]})
    with pytest.raises(SceneError, match=r"load\.environment is a list of one, but must be a number"):
        load_spec(tmp_path / "set.json")


def test_files_that_are_none(tmp_path: Path) -> None:
    with pytest.raises(SceneError, match=r"no description of a data set; name a file that ends in \.toml or \.json"):
        load_spec(tmp_path / "a.yaml")
    (tmp_path / "a.json").write_text("[1]")
    with pytest.raises(SceneError, match=r"a\.json: is a list of one, but must be a table"):
        load_spec(tmp_path / "a.json")


def test_the_shutter_with_which_a_scene_is_read(tmp_path: Path) -> None:
    """As that of `clrender.load`: motion of the scene's own shapes then blurs the images."""
    plan = plan_of(tmp_path, load={"shutter": [0.0, 0.25]})
    assert plan.base.camera.shutter == (0.0, 0.25) == plan.image(2).scene.camera.shutter
    assert plan_of(tmp_path).base.camera.shutter is None
