"""The table of specular chains: lights, and the surfaces that may be deltas."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
import numpy.typing as npt
import pytest

import clrender
from clrender import layout
from clrender.errors import SceneError
from clrender.flatten import chains
from clrender.flatten.chains import chain_table
from clrender.flatten.flat_scene import FlatScene, flatten

HEAD: Final = layout.columns("CHAIN_HEAD")
MATERIALS: Final[dict[str, Any]] = {
    "matt": {"type": "lambert", "reflectance": (0.5, 0.5, 0.5)},
    "mirror": {"type": "mirror", "reflectance": (0.9, 0.9, 0.9)},
    "glass": {"type": "dielectric", "ior": 1.5},
    "rough": {"type": "dielectric", "ior": 1.5, "roughness": 0.3},
    "gold": {"type": "conductor", "metal": "Au", "roughness": 0.0},
    "brushed": {"type": "conductor", "metal": "Au", "roughness": 0.4},
    "marbled": {"type": "conductor", "metal": "Au", "roughness": {"checker": [0.0, 0.5]}},
}


def flat(shapes: list[dict[str, Any]], lights: list[dict[str, Any]], **more: Any) -> FlatScene:
    camera = {"position": (0, 0, 5), "target": (0, 0, 0)}
    made = clrender.Scene(camera=camera, materials=MATERIALS, shapes=tuple(shapes), lights=tuple(lights), **more)
    return flatten(made, 8, 8)


def ball(material: str, at: float = 0.0, radius: float = 1.0, **more: Any) -> dict[str, Any]:
    return {"type": "sphere", "center": (at, 0, 0), "radius": radius, "material": material, **more}


def head(words: npt.NDArray[np.float32], name: str) -> int:
    return int(words.view(np.uint32)[HEAD[name]])


def surfaces(words: npt.NDArray[np.float32]) -> npt.NDArray[np.uint32]:
    """(N, 4): the entries of the surfaces."""
    first, count = head(words, "FIRST_SURFACE"), head(words, "SURFACES")
    return words.view(np.uint32)[first : first + 4 * count].reshape(-1, 4)


POINT: Final = {"type": "point", "position": (0, 3, 0), "intensity": (1, 1, 1)}


def test_surfaces_are_those_that_may_be_deltas() -> None:
    names = list(MATERIALS)
    made = flat([ball(name, 3.0 * number) for number, name in enumerate(names)], [POINT])
    words = chain_table(made)
    wanted = [names.index(name) for name in ("mirror", "glass", "gold", "marbled")]
    assert sorted(surfaces(words)[:, 0].tolist()) == wanted
    assert head(words, "GLASS") == 1 and head(words, "LIGHTS") == 1
    assert head(chain_table(flat([ball("mirror")], [POINT])), "GLASS") == 0


def test_lights_are_all_but_the_environment() -> None:
    sky = {"type": "environment", "radiance": (1, 1, 1)}
    sun = {"type": "directional", "direction": (0, -1, 0), "irradiance": (1, 1, 1)}
    made = flat([ball("glass"), ball("matt", 4.0, 0.1, emission=(5, 5, 5))], [POINT, sun, sky])
    words = chain_table(made)
    assert head(words, "ALL_LIGHTS") == 4 and head(words, "LIGHTS") == 3
    chances = words[layout.CHAIN_HEAD : layout.CHAIN_HEAD + 4]
    environment = made.environment
    assert chances[environment] == 0.0 and (np.delete(chances, environment) > 0.0).all()
    assert chances.sum() == pytest.approx(1.0, abs=1e-6)


def test_every_instance_counts() -> None:
    group = {
        "balls": {
            "shapes": [ball("glass"), ball("matt", 3.0), {"type": "box", "size": (1, 1, 1), "material": "mirror"}]
        }
    }
    places = [
        {"type": "instance", "group": "balls", "transform": {"translate": (0, 0, 5.0 * k), "scale": 1.0 + k}}
        for k in range(3)
    ]
    made = flat([ball("mirror", -9.0), *places], [POINT], groups=group)
    entries = surfaces(chain_table(made))
    rows, instance = made.instances.rows_of(entries[:, 0].astype(np.int64))
    assert len(entries) == 1 + 3 * 13 and len(np.unique(entries[:, 0])) == len(entries)
    assert np.bincount(instance + 1).tolist() == [1, 13, 13, 13]
    kinds = made.arrays["materials"]["kind"][made.arrays["shapes"]["material"][made.arrays["primitive_shape"][rows]]]
    assert set(kinds.tolist()) == {layout.MATERIAL_MIRROR, layout.MATERIAL_DIELECTRIC}


@pytest.mark.parametrize(("material", "lights"), [("matt", [POINT]), ("glass", []), ("rough", [POINT])])
def test_there_may_be_nothing_for_chains(material: str, lights: list[dict[str, Any]]) -> None:
    words = chain_table(flat([ball(material)], lights))
    assert head(words, "LIGHTS") == head(words, "SURFACES") == 0


def test_too_many_surfaces_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(chains, "_MOST_SURFACES", 3)
    with pytest.raises(SceneError, match="at most 3 triangles of mirrors and glass, and the scene has 4; render it"):
        chain_table(flat([ball("mirror", 3.0 * k) for k in range(4)], [POINT]))
