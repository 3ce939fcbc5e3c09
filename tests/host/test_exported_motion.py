"""Scenes with motion, in the formats of other programs and in the own one."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import clrender
from clrender.errors import SceneError
from clrender.exporters import write_cycles, write_luxcore, write_mitsuba
from clrender.flatten.bounds import scene_bounds
from clrender.scene import Scene
from clrender.scene.resting import opened

KEYS = [{"time": 0.0}, {"time": 2.0, "translate": [2.0, 1.0, 0.0], "rotate_degrees": [0.0, 0.0, 90.0]}]


def scene(**camera: Any) -> Scene:
    box = {"type": "box", "size": [1, 1, 1], "material": "m"}
    return Scene(
        camera={"position": [0, 0, 9], "target": [0, 0, 0], **camera},
        materials={"m": {"type": "lambert", "reflectance": [0.5, 0.5, 0.5]}},
        groups={"g": {"shapes": [box]}},
        shapes=[{**box, "motion": KEYS}, {"type": "instance", "group": "g", "motion": KEYS}],
        lights=[{"type": "environment", "radiance": [1, 1, 1]}],
    )


@pytest.mark.parametrize("write", [write_mitsuba, write_luxcore, write_cycles], ids=lambda each: each.__name__)
def test_what_moves_is_where_it_is_when_the_shutter_opens(tmp_path: Path, write: Any) -> None:
    moving, still = scene(time=1.0, shutter=[0.0, 0.5]), scene(time=1.0)
    names = [tmp_path / f"{name}.xml" for name in ("moving", "still")]
    notes = write(moving, names[0])
    assert any("shapes[0].motion" in note and "shutter opens" in note for note in notes)
    assert not any("motion" in note for note in write(still, names[1]))
    texts = [path.read_text().replace(path.stem, "NAME") for path in names]
    assert texts[0] == texts[1]
    with pytest.raises(SceneError, match="motion"):
        write(moving, tmp_path / "strict.xml", strict=True)


def test_mitsuba_gets_the_pose(tmp_path: Path) -> None:
    write_mitsuba(scene(time=1.0), tmp_path / "a.xml")
    again = clrender.load(tmp_path / "a.xml")
    np.testing.assert_allclose(scene_bounds(again), scene_bounds(opened(scene(time=1.0))), atol=1e-5)


def test_the_own_format_keeps_motions(tmp_path: Path) -> None:
    from clrender.exporters import exported, scene_text

    moving = scene(time=1.0, shutter=[0.0, 0.5], motion=[{"time": 0.0}, {"time": 1.0, "position": [0, 1, 9]}])
    path = tmp_path / "a.toml"
    path.write_bytes(scene_text(exported(moving, "files").description, ".toml", "a"))
    assert clrender.load(path).sha256() == moving.sha256()
