"""What the exporter to Mitsuba and `scripts/peer_files.py` write is read again as the scene that it was."""

from __future__ import annotations

import copy
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

import clrender
from clrender.exporters import write_mitsuba
from clrender.scene import Scene

SCRIPTS = Path(__file__).resolve().parents[2] / "scripts"
GREY = {"type": "lambert", "reflectance": [0.5, 0.5, 0.5]}
SCENE: dict[str, Any] = {
    "camera": {"position": [0.2, 0.5, 4.0], "target": [0.1, 0.0, 0.0], "vertical_fov": 50.0},
    "materials": {
        "grey": GREY,
        "glass": {"type": "dielectric", "ior": 1.5},
        "veil": {**GREY, "opacity": 0.25},
        "leaf": {**GREY, "opacity": {"texture": "leaf.png", "channel": "a", "filter": "nearest"}},
    },
    "shapes": [
        {"type": "sphere", "center": [0.0, 0.0, 0.0], "radius": 0.5, "material": "glass", "interior": "milk"},
        {"type": "sphere", "center": [2.0, 0.0, 0.0], "radius": 0.5, "interior": "cloud"},
        *(
            {"type": "quad", "origin": [x, 0, 0], "edge_u": [1, 0, 0], "edge_v": [0, 1, 0], "material": name}
            for x, name in ((-3, "grey"), (-2, "veil"), (-1, "leaf"))
        ),
    ],
    "lights": [
        {
            "type": "spot",
            "position": [0.0, 2.0, 1.0],
            "direction": [0.3, -1.0, 0.2],
            "intensity": [3.0, 2.0, 1.0],
            "cone_degrees": 70.0,
            "blend": 0.4,
        },
        {
            "type": "sun_sky",
            "sun_direction": [0.6, 0.5, 0.3],
            "turbidity": 4.0,
            "ground": False,
            "ground_albedo": 0.25,
            "sun_scale": 0.0,
            "sky_scale": 0.02,
        },
    ],
    "media": {
        "milk": {"absorption": [0.1, 0.0, 0.2], "scattering": [3.0, 4.0, 0.0], "g": 0.5},
        "cloud": {"absorption": [0.0, 0.0, 0.0], "scattering": [1.0, 2.0, 3.0]},
        "haze": {"absorption": [0.01, 0.02, 0.03], "scattering": [0.1, 0.1, 0.1], "g": -0.25},
    },
    "fog": "haze",
}
CAMERAS = {
    "lens": {**SCENE["camera"], "aperture_radius": 0.05, "focus_distance": 2.5},
    "parallel": {"type": "orthographic", "position": [0.2, 0.5, 4.0], "target": [0.2, 0.4, 0.0], "height": 3.0},
}


@pytest.fixture(params=["xml", "pbrt"])
def read(request: pytest.FixtureRequest, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Any:
    """Writes a scene in another format, and reads it."""
    monkeypatch.syspath_prepend(SCRIPTS)
    from peer_files import as_pbrt_has_it, pbrt_text

    alpha = np.random.default_rng(1).integers(0, 255, (4, 6), np.uint8)
    Image.fromarray(np.dstack([alpha * 0, alpha * 0, alpha * 0, alpha])).save(tmp_path / "leaf.png")

    def read(described: dict[str, Any]) -> tuple[str, Scene]:
        path = tmp_path / f"s.{request.param}"
        if request.param == "xml":
            write_mitsuba(Scene.model_validate(described).placed("test", tmp_path), path)
        else:
            path.write_text(pbrt_text(as_pbrt_has_it(described), 32, 4))
        return request.param, clrender.load(path)

    return read


def near(found: Any, expected: Any) -> bool:
    return bool(np.allclose(found, expected, rtol=1e-5, atol=1e-6))


def test_media(read: Any) -> None:
    _, scene = read(SCENE)
    assert set(scene.media) == set(SCENE["media"]) and scene.fog == "haze"
    for name, expected in SCENE["media"].items():
        medium = scene.media[name]
        assert near(medium.absorption, expected["absorption"]) and near(medium.scattering, expected["scattering"])
        assert medium.g == pytest.approx(expected.get("g", 0.0))
    milk, cloud, *_ = scene.shapes
    assert milk.interior == "milk" and scene.materials[milk.material or ""].type == "dielectric"
    assert cloud.interior == "cloud" and cloud.material is None


def test_opacity(read: Any, tmp_path: Path) -> None:
    kind, scene = read(SCENE)
    grey, veil, leaf = (scene.materials[shape.material or ""] for shape in scene.shapes[2:])
    assert not grey.masked and veil.opacity == pytest.approx(0.25)
    if kind == "pbrt":
        assert leaf.opacity == 0.5
        return
    with Image.open(tmp_path / leaf.opacity.texture) as grey_picture, Image.open(tmp_path / "leaf.png") as whole:
        assert np.array_equal(np.asarray(grey_picture), np.asarray(whole)[..., 3])
    assert leaf.opacity.color_space == "linear" and leaf.opacity.filter == "nearest"


def test_spots_and_skies(read: Any) -> None:
    kind, scene = read(SCENE)
    spot, around = scene.lights
    expected, sky = SCENE["lights"]
    assert near(spot.position, expected["position"]) and spot.cone_degrees == pytest.approx(70.0)
    direction = np.array(expected["direction"])
    assert near(np.array(spot.direction) / np.linalg.norm(spot.direction), direction / np.linalg.norm(direction))
    assert near(spot.intensity, expected["intensity"])
    assert spot.blend == pytest.approx(0.4)
    if kind == "pbrt":
        assert around.type == "environment" and around.file is None
        return
    towards = np.array(sky["sun_direction"])
    assert near(around.sun_direction, towards / np.linalg.norm(towards))
    assert around.turbidity == 4.0 and not around.ground
    assert near(around.sky_scale, [0.02] * 3) and near(around.sun_scale, 0.0)
    assert near(around.ground_albedo, [0.25] * 3)


@pytest.mark.parametrize("name", CAMERAS)
def test_cameras(read: Any, name: str) -> None:
    described = {**copy.deepcopy(SCENE), "camera": CAMERAS[name]}
    camera, expected = read(described)[1].camera, Scene.model_validate({"camera": CAMERAS[name]}).camera
    assert (camera.type, camera.mirrored) == (expected.type, False)
    assert near(camera.position, expected.position)
    ahead, wanted = (np.subtract(each.target, each.position) for each in (camera, expected))
    assert near(ahead / np.linalg.norm(ahead), wanted / np.linalg.norm(wanted))
    for key in ("height", "vertical_fov", "aperture_radius"):
        assert near(getattr(camera, key) or 0.0, getattr(expected, key) or 0.0), key
    if name == "lens":
        assert camera.focus_distance == pytest.approx(2.5)
