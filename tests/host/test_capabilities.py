"""The table of docs/integrators.md that says what scenes may be made of, cell by cell."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cases import for_each
from plugin_files import EVEN

import clrender
from clrender.errors import SceneError
from clrender.image.files import write_image
from clrender.integrators import INTEGRATORS

PAGE = Path(__file__).parents[2] / "docs" / "integrators.md"
LAMBERT: dict[str, Any] = {"type": "lambert", "reflectance": [0.5, 0.5, 0.5]}
PICTURE = {"texture": "p.exr"}
NET: dict[str, Any] = {"type": "mesh", "vertices": [[0, 0, 0], [1, 0, 0], [0, 1, 0]], "faces": [[0, 1, 2]]}
SPOT = {"type": "spot", "position": [0, 4, 0], "direction": [0, -1, 0], "intensity": [1, 1, 1], "cone_degrees": 40.0}
LAMP = {"type": "ies", "position": [0, 4, 0], "file": "p.ies"}
GIVEN = {"type": "plugin", "plugin": "even", "position": [0, 4, 0], "direction": [0, -1, 0]}
PROJECTOR = {"type": "projector", "position": [0, 4, 0], "direction": [0, 0, -1], "file": "p.exr"}
LAMBERT_AND_MIRROR = {"plain": LAMBERT, "shiny": {"type": "mirror"}}

SMOKE = {"media": {"smoke": {"scattering": 1.0}}}

# Each row's materials, shapes beside those that have them, lights, and what else the scene has.
SCENES: dict[str, list[tuple[Any, ...]]] = {
    "`lambert`": [({"m": LAMBERT},)],
    "`mirror` and smooth `dielectric`": [({"m": {"type": "mirror"}},), ({"m": {"type": "dielectric", "ior": 1.5}},)],
    "`conductor`, `principled`, `oren_nayar`, `mix`, rough or thin `dielectric`, materials that are not two-sided": [
        ({"m": {"type": "conductor", "metal": "Au"}},),
        ({"m": {"type": "principled"}},),
        ({"m": {"type": "oren_nayar", "reflectance": [0.5, 0.5, 0.5]}},),
        ({"m": {"type": "mix", "materials": ["plain", "shiny"]}, **LAMBERT_AND_MIRROR},),
        ({"m": {"type": "dielectric", "ior": 1.5, "roughness": 0.5}},),
        ({"m": {"type": "dielectric", "ior": 1.5, "thin": True}},),
        ({"m": {**LAMBERT, "two_sided": False}},),
    ],
    "textures of the `reflectance` of `lambert`": [
        ({"m": {"type": "lambert", "reflectance": each}},)
        for each in (PICTURE, {"checker": [0.1, 0.9]}, {"ramp": [0.1, 0.9]})
    ],
    "other textures, normal maps and bump maps": [
        ({"m": {**LAMBERT, "normal_map": PICTURE}},),
        ({"m": {**LAMBERT, "bump_map": PICTURE}},),
        ({"m": {"type": "conductor", "f0": PICTURE, "roughness": {"ramp": [0.1, 0.9]}}},),
    ],
    "colours of vertices": [({"m": LAMBERT}, [{**NET, "material": "m", "colors": [[1, 0, 0], [0, 1, 0], [0, 0, 1]]}])],
    "emission by a texture": [
        ({"m": LAMBERT}, [{"type": "sphere", "center": [0, 3, 0], "radius": 1.0, "emission": {"checker": [0.1, 0.9]}}])
    ],
    "media that scatter, in shapes or as fog": [
        ({"m": LAMBERT}, [{"type": "sphere", "center": [0, 3, 0], "radius": 1.0, "interior": "smoke"}], [], SMOKE),
        ({"m": LAMBERT}, [], [], {**SMOKE, "fog": "smoke"}),
    ],
    "`opacity`": [({"m": {**LAMBERT, "opacity": 0.5}},), ({"m": {**LAMBERT, "opacity": PICTURE}},)],
    "`opacity` of what shines": [
        (
            {"m": {**LAMBERT, "opacity": 0.5}},
            [{"type": "sphere", "center": [0, 3, 0], "radius": 1.0, "material": "m", "emission": [1, 1, 1]}],
        )
    ],
    "`subsurface`": [
        ({"m": {"type": "subsurface", "albedo": 0.8, "radius": 0.1}},),
        ({"m": {"type": "subsurface", "albedo": 0.8, "radius": 0.1, "ior": 1.4, "roughness": 0.3, "priority": 1}},),
    ],
    "dielectrics with a `priority`, or that absorb": [
        ({"m": {"type": "dielectric", "ior": 1.5, "priority": 1}},),
        ({"m": {"type": "dielectric", "ior": 1.5, "attenuation_color": [0.5] * 3, "attenuation_distance": 1.0}},),
        ({"m": {"type": "principled", "transmission": 1.0, "attenuation_color": [0.5] * 3,
                "attenuation_distance": 1.0}},),
    ],
    "spots, lamps of IES files, projectors, lights of plugins": [
        ({"m": LAMBERT}, [], [light]) for light in (SPOT, LAMP, PROJECTOR, GIVEN)
    ],
    "sun and sky": [({"m": LAMBERT}, [], [{"type": "sun_sky", "sun_direction": [0, 1, 0]}])],
    "a picture of the environment": [({"m": LAMBERT}, [], [{"type": "environment", "file": "p.exr"}])],
}  # fmt: skip


def table() -> dict[tuple[str, str], str]:
    """(what a scene has, integrator) -> yes or refused, as the page says."""
    lines = PAGE.read_text(encoding="utf-8").splitlines()
    begin = next(number for number, line in enumerate(lines) if line.startswith("| a scene has |"))
    rows = []
    for line in lines[begin:]:
        if not line.startswith("|"):
            break
        rows.append([cell.strip() for cell in line.strip("|").split("|")])
    return {
        (row[0], name.strip("`")): cell for row in rows[2:] for name, cell in zip(rows[0][1:], row[1:], strict=True)
    }


CELLS = table()


def test_the_page_has_a_cell_for_each() -> None:
    assert set(CELLS) == {(row, name) for row in SCENES for name in INTEGRATORS}


@for_each(("row", "name"), list(CELLS))
def test_cell(tmp_path: Path, row: str, name: str) -> None:
    write_image(tmp_path / "p.exr", np.full((4, 8, 3), 0.5, np.float32))
    (tmp_path / "p.ies").write_text("TILT=NONE\n1 1 1 2 1 1 2 0 0 0 1 1 1 0 90 0 7 7")
    for materials, *more in SCENES[row]:
        given: list[Any] = [*more, *([], [], {})[len(more) :]]
        shapes, lights, others = given
        ball = {"type": "sphere", "center": [0, 0, 0], "radius": 1.0, "material": "m"}
        what = (
            clrender.Scene.model_validate(
                {
                    "camera": {"position": [0, 0, 5], "target": [0, 0, 0]},
                    "materials": materials,
                    "shapes": [ball, *shapes],
                    "lights": lights,
                    **others,
                }
            )
            .placed("here", tmp_path)
            .with_plugins(EVEN)
        )
        if CELLS[row, name] == "yes":
            assert clrender.RenderJob.of(what, integrator=name).settings.integrator == name
            continue
        assert CELLS[row, name] == "refused"
        # In one sentence: the place, what is wrong, and a cure
        with pytest.raises(SceneError, match=rf"here: (fog |(shapes|lights)\[\d\]\.).*{name}.*use --integrator path"):
            clrender.RenderJob.of(what, integrator=name)
