"""Sheets that transmit diffuse light: what comes through, and what does not, is known without computing it."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

import clrender
from clrender.scene import Scene

if TYPE_CHECKING:
    from clrender.device import Device

SIZE = (8, 8)
LEAF: dict[str, Any] = {
    "type": "principled",
    "specular": 0.0,
    "base_color": (0.5, 0.4, 0.3),
    "diffuse_transmission": 0.6,
    "diffuse_transmission_color": (0.2, 0.4, 0.8),
}


def sheet(material: dict[str, Any], light: dict[str, Any], behind: bool = False) -> Scene:
    """A square in the plane z = 0, seen from its front or its back."""
    camera = {"position": (0.0, 0.0, -3.0 if behind else 3.0), "target": (0.0, 0.0, 0.0), "vertical_fov": 20.0}
    square = {"type": "quad", "origin": (-2, -2, 0), "edge_u": (4, 0, 0), "edge_v": (0, 4, 0), "material": "sheet"}
    content = {"camera": camera, "materials": {"sheet": material}, "shapes": [square], "lights": [light]}
    return Scene(**content)


def sun(towards: tuple[float, float, float]) -> dict[str, Any]:
    """Light of irradiance pi on a surface across it."""
    return {"type": "directional", "direction": towards, "irradiance": (math.pi,) * 3}


@pytest.mark.parametrize("behind", [False, True], ids=["front", "back"])
@pytest.mark.parametrize(
    "integrator", ["path", "direct", *(pytest.param(each, marks=pytest.mark.slow) for each in ("reuse", "whitted"))]
)
def test_a_leaf_in_the_sun(device: Device, integrator: str, behind: bool) -> None:
    """With irradiance E the radiance is (1 - d) c E / pi on the lit side, and d c' E / pi on the other."""
    slant = math.cos(math.radians(60.0))
    lit = (math.sqrt(0.75), 0.0, slant if behind else -slant)
    for towards, share, color in (
        (lit, 0.4, LEAF["base_color"]),
        ((lit[0], 0.0, -lit[2]), 0.6, LEAF["diffuse_transmission_color"]),
    ):
        scene = sheet(LEAF, sun(towards), behind)
        image = clrender.render(scene, device=device, size=SIZE, spp=4, integrator=integrator)
        expected = np.broadcast_to(np.array(color) * share * slant, image.linear.shape)
        np.testing.assert_allclose(image.linear, expected, rtol=2e-5)


@pytest.mark.parametrize("sampling", ["light", "bsdf", "mis"])
def test_a_leaf_under_the_sky(device: Device, sampling: str) -> None:
    """In an even environment the radiance is the albedo for the whole sphere of directions, which the layer shows."""
    scene = sheet({**LEAF, "specular": 1.0, "roughness": 0.5}, {"type": "environment", "radiance": (1.0, 1.0, 1.0)})
    image = clrender.render(scene, device=device, size=SIZE, spp=1024, sampling=sampling, aov=["albedo"], seed=7)
    found = image.linear.reshape(-1, 3)
    error = found.std(axis=0) / math.sqrt(len(found))
    albedo = image.aovs["albedo"].reshape(-1, 3).mean(axis=0)
    print(found.mean(axis=0), error, albedo)
    assert (np.abs(found.mean(axis=0) - albedo) < 4.0 * error + 2e-3).all()


def test_nothing_comes_through_without_it(device: Device) -> None:
    opaque = {key: value for key, value in LEAF.items() if not key.startswith("diffuse_transmission")}
    image = clrender.render(sheet(opaque, sun((0.0, 0.0, 1.0))), device=device, size=SIZE, spp=4)
    assert not image.linear.any()


@pytest.mark.parametrize(
    ("more", "words"),
    [
        ({"transmission": 0.5}, "is for sheets"),
        ({"two_sided": False}, "needs a surface with two sides"),
        ({"diffuse_transmission": 1.5}, "1.5"),
    ],
)
def test_what_is_no_sheet_is_refused(more: dict[str, Any], words: str) -> None:
    with pytest.raises(clrender.SceneError, match=words):
        sheet({**LEAF, **more}, sun((0.0, 0.0, 1.0)))


def test_films_from_before_know_their_scenes() -> None:
    """Keys at their defaults are not part of a scene's hash: this one is of a version that did not have them yet."""
    bare = {key: value for key, value in LEAF.items() if not key.startswith("diffuse_transmission")}
    scene = sheet(bare, sun((0.0, 0.0, 1.0)))
    corners = {"vertices": ((0, 0, 0), (1, 0, 0), (0, 1, 0)), "faces": ((0, 1, 2),)}
    old = scene.changed(lights=[], shapes=[*scene.shapes, {"type": "mesh", **corners, "material": "sheet"}])
    assert old.sha256() == "b481d0c5c530f411ca0a636570482d8327ee7226f1a3d5e158d1ba7f2f5e813c"
    assert old.changed(materials__sheet__diffuse_transmission=0.5).sha256() != old.sha256()
