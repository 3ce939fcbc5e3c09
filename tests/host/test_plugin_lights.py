"""Lights of plugins without a device: headers, code, what scenes may say, and the power by which they are sampled."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from cases import for_each
from plugin_files import CORNER, EVEN, LED, MINNAERT, SEARCHLIGHT, edited, example

from clrender import layout
from clrender.errors import SceneError, UsageError
from clrender.flatten.flat_scene import flatten
from clrender.flatten.plugin_lights import Emitted, light_grid, light_spread, measured_lights
from clrender.furnace import named_light, subjects_of
from clrender.plugins import kernel_files, plugin
from clrender.rendering.job import RenderJob
from clrender.scene import Scene
from clrender.scene.resting import opened
from clrender.view.edited_scene import EditedScene

CAMERA = {"position": [0.0, 0.0, 4.0], "target": [0.0, 0.0, 0.0]}
BALL = {"type": "sphere", "radius": 1.0}
LIGHT: dict[str, Any] = {
    "type": "plugin",
    "plugin": "led",
    "position": [0.0, 3.0, 0.0],
    "direction": [0.0, -2.0, 0.0],
}


def scene(*lights: dict[str, Any], **others: Any) -> Scene:
    made = Scene(camera=CAMERA, shapes=[BALL], lights=list(lights or [LIGHT]), **others)
    return made.with_plugins([LED, SEARCHLIGHT, EVEN, CORNER, MINNAERT])


def refused(text: str) -> str:
    with pytest.raises(UsageError) as error:
        plugin(text)
    assert str(error.value).count("\n") == 0
    return str(error.value)


def test_the_examples_are_read() -> None:
    led, beam = example("led"), example("searchlight")
    assert (led.kind, led.header.cone_degrees, beam.kind, beam.header.cone_degrees) == ("light", 180.0, "light", 120.0)
    assert plugin(EVEN).header.cone_degrees == 360.0
    assert all(len(text.split("\n")) <= 41 for text in (LED, SEARCHLIGHT))


@for_each(
    ("text", "change", "words"),
    [
        (LED, ("cone_degrees = 180.0", "cone_degrees = 400"), ":7: the header's cone_degrees is 400, but must be"),
        (LED, ("cone_degrees = 180.0", "cone_degrees = true"), "must be a number from 0.01 to 360"),
        (LED, ("cone_degrees = 180.0", 'needs = ["uv"]'), "names"),
        (LED, ("cone_degrees = 180.0", "transmits = true"), "is for a bsdf"),
        (LED, ("cone_degrees = 180.0", 'claims = ["reciprocal"]'), "names"),
        (MINNAERT, ('claims = ["reciprocal"]', "cone_degrees = 90"), "cone_degrees is for a light"),
        (
            EVEN,
            ("even_intensity", "even_value"),
            "no function `static vec3 even_intensity(const EvenParameters*, vec3)`",
        ),
        (EVEN, ("vec3 direction)", "vec3 direction, vfloat u)"), "has to be `static vec3 even_intensity("),
        (EVEN, ("static vec3 even", "static vfloat even"), "has to be `static vec3 even_intensity("),
        (SEARCHLIGHT, ("searchlight_sample", "searchlight_other"), "no function `static vec3 searchlight_sample("),
        (EVEN, ("p->color;", "scale(p->color, p->color.x / direction.z);"), "write quotient(a, b)"),
        (EVEN, ("p->color;", "scale(p->color, pow(direction.z, p->color.x));"), "write power(x, y)"),
        (EVEN, ("p->color;", "even_intensity(p, direction);"), "calls itself"),
    ],
)
def test_faults_of_texts(text: str, change: tuple[str, str], words: str) -> None:
    said = refused(text.replace(*change) if "searchlight" in change[0] else edited(text, change))
    assert words in said, said


def test_a_light_may_leave_its_directions_to_the_cone() -> None:
    assert "searchlight_sample(&p" in kernel_files([plugin(SEARCHLIGHT)])["plugin/given.h"]
    assert "led_sample" not in kernel_files([plugin(LED)])["plugin/given.h"]
    assert "PLUGIN_LIGHTS" not in kernel_files([plugin(MINNAERT)])["plugin/given.h"]


@for_each(
    ("changes", "words"),
    [
        ({"plugin": "lamp"}, ('lights[0].plugin names the plugin "lamp", which is not given', "--plugin FILE")),
        ({"plugin": "minnaert"}, ("which is the plugin of a BSDF; a light is wanted here",)),
        ({"parameters": {"ring": 0.5}}, ("lights[0].parameters.ring is a number, but must be a colour",)),
        ({"parameters": {"ring_width": 0.0}}, ("is 0, but must be from 1 to 90",)),
        ({"parameters": {"rings": 1.0}}, ("is no parameter of the plugin led",)),
    ],
)
def test_faults_of_scenes(changes: dict[str, Any], words: tuple[str, ...]) -> None:
    made = scene({**LIGHT, **changes})
    for check in (RenderJob.of, lambda each: flatten(each, 8, 8)):
        with pytest.raises(SceneError) as error:
            check(made)
        assert all(each in str(error.value) for each in words), error.value


@for_each(
    ("changes", "words"),
    [
        ({"direction": [0.0, 0.0, 0.0]}, "has length zero"),
        ({"up": [0.0, 1.0, 0.0]}, "lies along `direction`"),
        ({"up": [0.0, 0.0, 0.0]}, "has length zero"),
        ({"parameters": {"ring": {"checker": [0.1, 0.2]}}}, "ring"),
        ({"file": "led.cl"}, "file is an unknown key"),
    ],
)
def test_what_no_scene_may_say(changes: dict[str, Any], words: str) -> None:
    with pytest.raises(SceneError, match=words):
        scene({**LIGHT, **changes})


def test_a_bsdf_wants_no_light() -> None:
    made = scene().changed({"materials": {"m": {"type": "plugin", "plugin": "led"}}})
    with pytest.raises(SceneError, match="which is the plugin of a light; a BSDF is wanted here"):
        flatten(made, 8, 8)


# --- its power -----------------------------------------------------------------------------------------------------


@for_each("spread", [2.0, 1.0, 0.25, 1e-6])
def test_the_grid_integrates(spread: float) -> None:
    """Solid angle, cosine and its square; the directions are unit vectors in the cone."""
    grid = light_grid(spread)
    z = grid.directions[:, 2].astype(np.float64)
    np.testing.assert_allclose(np.linalg.norm(grid.directions, axis=1), 1.0, atol=1e-7)
    assert (1.0 - z <= spread + 1e-7).all()
    edge = 1.0 - spread
    for power in range(3):
        exact = 2.0 * math.pi * (1.0 - edge ** (power + 1)) / (power + 1)
        assert (grid.solid_angles * z**power).sum() == pytest.approx(exact, rel=2e-3, abs=1e-3 * 2.0 * math.pi * spread)
    assert abs((grid.directions[:, :2] * grid.solid_angles[:, None]).sum(axis=0)).max() < 1e-6


def said(plugins: Any, number: int, numbers: Any, directions: npt.NDArray[np.float32]) -> npt.NDArray[np.float32]:
    """A formula for all: red along x, green twice the cosine, and blue nothing, in the half-space of z."""
    x, z = directions[:, 0], directions[:, 2]
    made: npt.NDArray[np.float32] = np.stack([np.maximum(x, 0.0), np.maximum(2.0 * z, 0.0), 0.0 * z], axis=1)
    return made


def test_what_a_formula_gives_is_integrated() -> None:
    found = measured_lights(scene({**LIGHT, "plugin": "even"}), said)[0]
    assert found.integral == pytest.approx((math.pi, 2.0 * math.pi, 0.0), rel=3e-3)
    assert found.peak == pytest.approx(2.0, rel=1e-3)
    mean = found.mean((0.0, 1.0, 0.0))
    assert mean == pytest.approx((0.0, 0.0, 2.0 / 3.0), abs=2e-3)
    assert found.flux((1.0, 1.0, 1.0), 2.0) == pytest.approx(math.pi, rel=3e-3)
    assert Emitted((0.0, 0.0, 0.0), ((0.0,) * 3,) * 3, 0.0).flux((1.0, 1.0, 1.0), 2.0) > 0.0  # it may shine in between


def test_only_the_choice_of_lights_depends_on_it() -> None:
    lights = [{**LIGHT, "scale": 0.5}, {**LIGHT, "plugin": "even"}]
    lights.append({"type": "point", "position": [1, 1, 1], "intensity": 1.0})
    made = scene(*lights)
    plain = flatten(made, 8, 8, "power")
    bright = flatten(made, 8, 8, "power", emitted=measured_lights(made, said))
    assert plain.light_count == bright.light_count == 3
    names = ("probability", "alias_threshold", "alias")
    for name in plain.arrays["lights"].dtype.names or ():
        same = np.array_equal(plain.arrays["lights"][name], bright.arrays["lights"][name])
        assert same is (name not in names) or name == "alias", name
    probability = bright.arrays["lights"]["probability"]
    assert probability[1] / probability[2] == pytest.approx(
        (0.2126 * math.pi + 0.7152 * 2.0 * math.pi) / (4.0 * math.pi), rel=3e-3
    )
    assert plain.arrays["lights"]["kind"].tolist() == [layout.LIGHT_PLUGIN] * 2 + [layout.LIGHT_POINT]
    assert flatten(scene({**LIGHT, "scale": 0.0}), 8, 8).light_count == 0


def test_its_rows_say_what_the_kernels_need() -> None:
    made = scene(LIGHT, {**LIGHT, "plugin": "searchlight", "direction": [0, 0, -3], "parameters": {"power": 7.0}})
    flat = flatten(made, 8, 8)
    rows = flat.arrays["lamp_tables"].reshape(-1, 16)
    places = flat.arrays["lights"]["axis"][:, 0].astype(int)
    head = layout.columns("GIVEN")
    numbers = rows[:, head["PLUGIN"]].view(np.uint32)[places]
    assert numbers.tolist() == [1, 2]  # of those that it uses, by name
    assert rows[places, head["SPREAD"]].tolist() == pytest.approx([1.0, 0.5])
    for place, axis, right in ((0, (0, -1, 0), (-1, 0, 0)), (1, (0, 0, -1), (1, 0, 0))):
        row = rows[places[place]]
        assert row[head["AXIS"] : head["AXIS"] + 3].tolist() == pytest.approx(axis)
        assert row[head["RIGHT"] : head["RIGHT"] + 3].tolist() == pytest.approx(right)
    assert rows[places[1] + 1, :5].tolist() == [7.0, 1.0, 1.0, 1.0, 3.0]
    assert light_spread(plugin(EVEN)) == 2.0


def test_cones_of_the_light_bvh_hold_its_light() -> None:
    lights = [{**LIGHT, "position": [x, 2.0, 0.0]} for x in range(8)]
    flat = flatten(scene(*lights), 8, 8, "bvh")
    assert flat.light_levels > 0
    cones = flat.arrays["light_cones"].reshape(-1, 4)
    used = cones[np.abs(cones[:, :3]).any(axis=1)]
    assert len(used) >= 14 and (used[:, 3] <= 0.0).all() and (used[:, 3] > -0.01).all()
    assert np.allclose(used[:, :3], (0.0, -1.0, 0.0), atol=1e-6)


@for_each(
    ("value", "words"),
    [
        (-0.25, "gives the intensity -0.25 W/sr"),
        (math.nan, "gives the intensity nan"),
        (2e12, "gives the intensity 2e"),
    ],
)
def test_a_formula_that_gives_no_intensity_is_refused(value: float, words: str) -> None:
    def wrong(plugins: Any, number: int, numbers: Any, directions: npt.NDArray[np.float32]) -> Any:
        made = np.ones_like(directions)
        made[1234, 1] = value
        return made

    with pytest.raises(SceneError) as error:
        measured_lights(scene({"type": "point", "position": [1, 1, 1], "intensity": 1.0}, LIGHT), wrong)
    assert f"lights[1]: the plugin led {words}" in str(error.value) and "from 0 to 1e+12" in str(error.value)


def test_an_intensity_that_its_scale_makes_too_large_is_refused() -> None:
    made = scene({**LIGHT, "scale": 1e12})
    with pytest.raises(SceneError, match=r"lights\[0\].scale: makes an intensity of 2e\+12 W/sr"):
        flatten(made, 8, 8, emitted=measured_lights(made, said))


# --- what else meets it --------------------------------------------------------------------------------------------


def test_it_is_part_of_the_request_and_in_no_message() -> None:
    job = RenderJob.of(scene())
    assert job.request()["plugins"] == {"led": plugin(LED).sha256}
    with pytest.raises(UsageError, match="jobs carry no plugins"):
        job.to_json()
    edited_scene = EditedScene.of(scene(), {})
    for key, value in (("plugin", "even"), ("parameters", {"ring_angle": 30.0})):
        with pytest.raises(UsageError, match="cannot be changed here"):
            edited_scene.with_light("lights[0]", {key: value})
    brighter = edited_scene.with_light("lights[0]", {"scale": [2.0, 2.0, 2.0]})
    assert brighter.checked.scene.lights[0].scale == (2.0, 2.0, 2.0)  # type: ignore[union-attr]


def test_it_is_turned_with_its_motion() -> None:
    keys = [{"time": 0.0}, {"time": 1.0, "rotate_degrees": [0.0, 0.0, 90.0], "translate": [0.0, 1.0, 0.0]}]
    made = scene({**LIGHT, "up": [1.0, 1.0, 0.0], "motion": keys}, {**LIGHT, "motion": keys}).changed(
        {"camera.time": 1.0}
    )
    light: Any = opened(made).lights[0]
    assert light.position == pytest.approx((-3.0, 1.0, 0.0))
    assert light.direction == pytest.approx((2.0, 0.0, 0.0)) and light.up == pytest.approx((-1.0, 1.0, 0.0))
    assert opened(made).lights[1].up == pytest.approx((0.0, 0.0, 1.0))  # type: ignore[union-attr]
    assert not light.motion
    assert flatten(made.changed({"camera.shutter": [-0.5, 0.0]}), 8, 8).features.moving_lights


def test_other_programs_are_told_what_is_left_out(tmp_path: Path) -> None:
    from clrender.exporters import exported, exported_to_cycles, exported_to_luxcore, exported_to_mitsuba

    for export in (exported_to_cycles, exported_to_luxcore, exported_to_mitsuba):
        notes = export(scene(), "files").notes
        assert any("the lights of plugins" in note and "lights[0]" in note for note in notes), notes
    assert exported(scene(), "own-files").description["lights"][0]["plugin"] == "led"


def test_the_furnace_knows_lights_by_name() -> None:
    plugins = [plugin(LED), plugin(MINNAERT)]
    light = named_light("led", plugins, others=False)
    assert light is not None and light.name == "led" and named_light("minnaert", plugins, others=True) is None
    with pytest.raises(UsageError, match="led is a light, which has no --material"):
        named_light("led", plugins, others=True)
    with pytest.raises(UsageError, match="led is a light, which is no material"):
        subjects_of("led", plugins=plugins)


def test_no_light_is_lost_over_mirrors_without_a_word() -> None:
    made = scene().changed({"materials": {"m": {"type": "mirror"}}, "shapes": [{**BALL, "material": "m"}]})
    assert "light of plugin lights, reflected by the mirror" in flatten(made, 8, 8).lost_light
