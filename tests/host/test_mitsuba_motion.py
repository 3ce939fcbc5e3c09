"""Animated transforms of Mitsuba's files: of shapes, instances and the camera."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from cases import for_each
from moved_points import placed_at

from clrender.errors import SceneError
from clrender.importers import load
from clrender.scene import Scene
from clrender.scene.resting import opened

SENSOR = """<sensor type="perspective"><float name="fov" value="40"/>{}</sensor>"""
OPEN = '<float name="shutterOpen" value="0.25"/><float name="shutterClose" value="0.75"/>'
SLIDES = '<translate x="{}"/>'


def animated(*keys: tuple[float, str], name: str = "toWorld") -> str:
    inside = "".join(f'<transform time="{time}">{steps}</transform>' for time, steps in keys)
    return f'<animation name="{name}">{inside}</animation>'


SLIDE = animated((0.0, SLIDES.format(0)), (1.0, SLIDES.format(2)))


def mitsuba(folder: Path, world: str, sensor: str = OPEN) -> Scene:
    """The scene of a file of 0.6, which has such transforms."""
    path = folder / "scene.xml"
    path.write_text(f'<scene version="0.6.0">{SENSOR.format(sensor)}{world}</scene>', encoding="utf-8")
    return load(path)


def test_a_shape_moves_through_its_keys(tmp_path: Path) -> None:
    keys = animated((0.0, SLIDES.format(0)), (0.5, SLIDES.format(1)), (1.0, SLIDES.format(5)))
    scene = mitsuba(tmp_path, f'<shape type="sphere"><point name="center" y="3"/>{keys}</shape>')
    assert placed_at(scene, 0, 0.25, (0.0, 0.0, 0.0)) == pytest.approx([0.5, 3.0, 0.0], abs=1e-12)
    assert placed_at(scene, 0, 0.75, (0.0, 0.0, 0.0)) == pytest.approx([3.0, 3.0, 0.0], abs=1e-12)
    assert scene.camera.shutter == (0.25, 0.75)
    assert not [note for note in scene.notes if "mo" in note and "first" in note]


def test_a_shape_turns_before_it_is_moved(tmp_path: Path) -> None:
    """Steps of a transform act in their order, and each key is whole."""
    keys = animated((0.0, '<translate x="5"/>'), (1.0, '<rotate z="1" angle="90"/><translate x="5"/>'))
    scene = mitsuba(tmp_path, f'<shape type="rectangle">{keys}</shape>')
    half = 0.5**0.5
    centre = placed_at(scene, 0, 0.5, (0.0, 0.0, 0.0))
    assert centre == pytest.approx([5.0, 0.0, 0.0], abs=1e-12)
    assert placed_at(scene, 0, 0.5, (1.0, 0.0, 0.0)) == pytest.approx([5.0 + half, half, 0.0], abs=1e-12)


def test_an_instance_moves_as_a_whole(tmp_path: Path) -> None:
    group = (
        '<shape type="shapegroup" id="group"><shape type="cube"><transform name="toWorld"><translate y="4"/>'
        "</transform></shape></shape>"
    )
    instance = f'<shape type="instance"><ref id="group"/>{SLIDE}</shape>'
    scene = mitsuba(tmp_path, group + instance + instance.replace(SLIDE, ""))
    assert [len(shape.motion) for shape in scene.shapes] == [2, 0]
    assert placed_at(scene, 0, 0.5, (0.0, 0.0, 0.0)) == pytest.approx([1.0, 4.0, 0.0], abs=1e-12)


def test_what_moves_is_where_its_instances_are(tmp_path: Path) -> None:
    """A shape that moves in an instance at rest, and one at rest in an instance at rest in one that moves."""
    far = '<transform name="toWorld"><translate z="7"/></transform>'
    up = '<transform name="toWorld"><translate y="4"/></transform>'
    world = (
        f'<shape type="shapegroup" id="moving"><shape type="cube">{SLIDE}</shape></shape>'
        f'<shape type="shapegroup" id="still"><shape type="cube">{up}</shape></shape>'
        f'<shape type="shapegroup" id="outer"><shape type="instance"><ref id="still"/>{far}</shape></shape>'
        f'<shape type="instance"><ref id="moving"/>{far}</shape><shape type="instance"><ref id="outer"/>{SLIDE}</shape>'
    )
    scene = mitsuba(tmp_path, world)
    assert placed_at(scene, 0, 0.5, (0.0, 0.0, 0.0)) == pytest.approx([1.0, 0.0, 7.0], abs=1e-12)
    assert placed_at(scene, 1, 0.5, (0.0, 0.0, 0.0)) == pytest.approx([1.0, 4.0, 7.0], abs=1e-12)


def test_the_camera_moves(tmp_path: Path) -> None:
    ways = [(time, f'<lookat origin="{x}, 0, 5" target="{x}, 0, 0" up="0, 1, 0"/>') for time, x in ((0, -1), (1, 1))]
    camera = mitsuba(tmp_path, '<shape type="sphere"/>', OPEN + animated(*ways)).camera
    assert [key.time for key in camera.motion] == [0.0, 1.0] and camera.shutter == (0.25, 0.75)
    assert [key.position for key in camera.motion] == [(-1.0, 0.0, 5.0), (1.0, 0.0, 5.0)]


def test_a_closed_shutter_sees_one_moment(tmp_path: Path) -> None:
    scene = mitsuba(tmp_path, f'<shape type="sphere">{SLIDE}</shape>', '<float name="shutterOpen" value="0.5"/>')
    assert scene.camera.shutter is None and scene.camera.time == 0.5 and scene.shapes[0].motion


def test_keys_that_are_equal_are_no_motion(tmp_path: Path) -> None:
    rest = animated((0.0, SLIDES.format(2)), (1.0, SLIDES.format(2)))
    scene = mitsuba(tmp_path, f'<shape type="sphere">{rest}</shape>')
    assert not scene.shapes[0].motion and scene.camera.shutter is None


def test_moving_lamps_shine(tmp_path: Path) -> None:
    lamp = f'<shape type="rectangle">{SLIDE}<emitter type="area"><rgb name="radiance" value="2"/></emitter></shape>'
    shape = mitsuba(tmp_path, lamp).shapes[0]
    assert shape.motion and shape.emission is not None


def test_lights_move(tmp_path: Path) -> None:
    """Of their transforms only places and directions count: the size of a lamp's space is no size of the lamp."""
    keys = animated((0.0, '<scale value="2"/>'), (1.0, '<scale value="3"/><rotate x="1" angle="90"/>'))
    spot = f'<emitter type="spot">{animated((0.0, SLIDES.format(0)), (1.0, SLIDES.format(2)))}</emitter>'
    point = f'<emitter type="point"><point name="position" y="1"/>{keys}</emitter>'
    sun = f'<emitter type="directional">{keys}</emitter>'
    scene = mitsuba(tmp_path, f'<shape type="sphere"/>{spot}{point}{sun}')
    lights: Any = scene.lights
    assert [len(light.motion) for light in lights] == [2, 2, 2] and scene.camera.shutter == (0.25, 0.75)
    found: Any = [
        opened(scene.changed({"camera.shutter": [0.0, 0.0], "camera.time": time})).lights for time in (0.0, 0.5, 1.0)
    ]
    assert found[1][0].position == pytest.approx((1.0, 0.0, 0.0))
    assert [lights[1].position for lights in found[::2]] == [pytest.approx(each) for each in ((0, 2, 0), (0, 0, 3))]
    assert [lights[2].direction for lights in found[::2]] == [pytest.approx(each) for each in ((0, 0, 2), (0, -2, 0))]


@for_each(
    ("world", "words"),
    [
        (
            f'<shape type="sphere">{animated((0, "<scale value=$1$/>"), (1, "<scale z=$2$/>"))}</shape>',
            "stretches a sphere, disk or curve: what moves like that stands",
        ),
        (
            f'<shape type="cube">{animated((0, "<scale value=$1$/>"), (1, "<scale x=$-1$/>"))}</shape>',
            "makes a shape flat on its way",
        ),
        (
            f'<shape type="shapegroup" id="a"><shape type="cube">{SLIDE}</shape></shape>'
            f'<shape type="instance"><ref id="a"/>{SLIDE}</shape>',
            "within an instance that moves",
        ),
        (
            f'<shape type="sphere"/><emitter type="constant">{SLIDE}</emitter>',
            'the animated transform of the emitter of type "constant" is read as it is at its first moment',
        ),
    ],
)
def test_what_does_not_move_is_named(tmp_path: Path, world: str, words: str) -> None:
    scene = mitsuba(tmp_path, world.replace("$", '"'))
    assert words in " ".join(scene.notes)
    assert [len(shape.motion) for shape in scene.shapes] == ([2] if "within" in words else [0])


@for_each(
    ("keys", "words"),
    [
        ('<animation name="toWorld"></animation>', "line 1: the animation has no transform; give one"),
        (
            '<animation name="toWorld"><transform/></animation>',
            'line 1: <transform> has no "time"; give it',
        ),
        (animated((1.0, ""), (1.0, "")), "line 1: the time 1 of the animation does not grow; sort its transforms"),
        ('<animation name="toWorld"><scale/></animation>', "line 1: <scale> is no part of an animation"),
    ],
)
def test_faults_of_animations(tmp_path: Path, keys: str, words: str) -> None:
    with pytest.raises(SceneError) as caught:
        mitsuba(tmp_path, f'<shape type="sphere">{keys}</shape>')
    assert words in str(caught.value)


def test_a_shutter_that_closes_before_it_opens(tmp_path: Path) -> None:
    sensor = '<float name="shutterOpen" value="1"/><float name="shutterClose" value="0.5"/>'
    with pytest.raises(SceneError, match=r"the shutter closes at 0\.5, before it opens at 1"):
        mitsuba(tmp_path, f'<shape type="sphere">{SLIDE}</shape>', sensor)


def test_the_time_of_the_image_is_chosen(tmp_path: Path) -> None:
    """The shutter of the file opens that much later; it may be replaced."""
    mitsuba(tmp_path, f'<shape type="sphere">{SLIDE}</shape>')
    later = load(tmp_path / "scene.xml", time_at=2.0).camera
    assert later.time == 2.0 and later.shutter == (0.25, 0.75)
    other = load(tmp_path / "scene.xml", time_at=2.0, shutter=(0.0, 0.5)).camera
    assert other.time == 2.0 and other.shutter == (0.0, 0.5)
