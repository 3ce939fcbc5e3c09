"""When a session uploads a scene again, and when a new camera is enough."""

from __future__ import annotations

import math

import pytest

import clrender
from clrender.rendering.job import RenderJob
from clrender.rendering.residency import _Geometry
from clrender.scene import Scene


def geometry(scene: Scene) -> _Geometry:
    return _Geometry.of(RenderJob.of(scene, width=16, height=16))


def test_a_camera_needs_no_comparison_of_contents(monkeypatch: pytest.MonkeyPatch) -> None:
    scene = clrender.load("room")
    moved = scene.changed({"camera": scene.camera.changed({"vertical_fov": 30.0})})
    monkeypatch.setattr(Scene, "content_sha256", lambda scene: pytest.fail("the contents were hashed"))
    assert geometry(scene).same(geometry(moved), math.inf)


def test_a_scene_with_other_media_is_another_scene() -> None:
    haze = {"scattering": [0.1, 0.1, 0.1], "absorption": [0.0, 0.0, 0.0]}
    camera = {"position": [0, 0, 3], "target": [0, 0, 0]}
    clear = Scene.model_validate({"camera": camera, "media": {"haze": haze}})
    foggy = clear.changed({"fog": "haze"})
    thick = foggy.changed(
        {
            "media": Scene.model_validate(
                {"camera": camera, "media": {"haze": {**haze, "scattering": [1.0, 1.0, 1.0]}}}
            ).media
        }
    )
    assert geometry(foggy).same(geometry(foggy), math.inf)
    assert not geometry(foggy).same(geometry(clear), math.inf)
    assert not geometry(foggy).same(geometry(thick), math.inf)


def test_a_camera_far_away_is_another_scene_where_what_touches_depends_on_it() -> None:
    near = clrender.load("room")
    far = near.changed({"camera.position": [0.0, 0.0, 1000.0]})
    assert geometry(near).same(geometry(far), 1024.0)
    assert not geometry(near).same(geometry(far), 1000.0)
    assert geometry(near).same(geometry(near), 0.0)
