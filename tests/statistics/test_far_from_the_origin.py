"""A scene far from the world's origin gives the image that it gives there: coordinates are relative to the camera."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from render_support import Studio, lambert, quad, scene, sphere

import clrender
from clrender.device import Device
from clrender.flatten.flat_scene import flatten, scene_origin
from clrender.scene import Scene

FAR = [(1e5, 0.0, 0.0), (-3e6, 7e5, 1e6), (0.0, 1e9, -2e9)]


def small_things(x: float, y: float, z: float) -> Scene:
    """A floor, a sphere, a box and a point light about a place in the world."""
    moved = {"translate": [x, y, z]}
    return scene(
        [
            quad((-2.0, 0.0, 2.0), (4.0, 0.0, 0.0), (0.0, 0.0, -4.0), material="white", transform=moved),
            sphere((0.4, 0.3, 0.2), 0.3, material="white", transform=moved),
            {"type": "box", "center": [-0.5, 0.2, 0], "size": [0.4] * 3, "material": "white", "transform": moved},
            quad((-0.3, 1.5, -0.3), (0.6, 0, 0), (0, 0, 0.6), emission=4.0, transform=moved),
        ],
        [{"type": "point", "position": [x + 1.0, y + 1.5, z + 1.0], "intensity": [1.0] * 3}],
        {"position": [x, y + 0.8, z + 3.0], "target": [x, y + 0.3, z], "vertical_fov": 40.0},
        white=lambert(0.7),
    )


@pytest.mark.parametrize("place", FAR, ids=str)
@pytest.mark.parametrize(
    "integrator", ["path", "bdpt", "whitted", "reuse", "photon", pytest.param("radiosity", marks=pytest.mark.long)]
)
def test_the_image_is_the_same_far_away(studio: Studio, place: tuple[float, float, float], integrator: str) -> None:
    """The same numbers are drawn, so nearly every path is the same path; coordinates differ by roundings."""
    few: dict[str, Any] = {"photon": {"photons": 4096, "photon_radius": 0.1}, "radiosity": {"patches": 300}}
    settings = {"spp": 4, "integrator": integrator, "seed": 3, **few.get(integrator, {})}
    near, far = (studio.image(small_things(*at), 32, **settings) for at in ((0.0, 0.0, 0.0), place))
    assert_same_paths(near, far)


def assert_same_paths(near: np.ndarray[Any, Any], far: np.ndarray[Any, Any]) -> None:
    off = np.abs(far - near).max(axis=2) > 1e-3 * near.max()
    assert off.mean() < 0.02 and far.mean() == pytest.approx(near.mean(), rel=1e-3)


def written_there(folder: Path, x: float, y: float, z: float) -> Scene:
    """Shapes whose own coordinates are about a place in the world: an octahedron of a file, a sphere and a floor."""
    points = [(0.4 * s * (k == 0), 0.4 * s * (k == 1) + 0.4, 0.4 * s * (k == 2)) for k in range(3) for s in (1, -1)]
    ring = ((1, 5), (5, 2), (2, 6), (6, 1))
    lines = [f"v {x + a:.9f} {y + b:.9f} {z + c:.9f}" for a, b, c in points]
    lines += [f"f {b} {a} 3\nf {a} {b} 4" for a, b in ring]
    (folder / "octahedron.obj").write_text("\n".join([*lines, ""]))
    shapes = [
        {"type": "mesh", "file": "octahedron.obj", "material": "white"},
        sphere((x + 0.8, y + 0.3, z - 0.2), 0.3, material="white"),
        quad((x - 2.0, y, z + 2.0), (4.0, 0.0, 0.0), (0.0, 0.0, -4.0), material="white"),
        quad((x - 0.3, y + 1.5, z - 0.3), (0.6, 0.0, 0.0), (0.0, 0.0, 0.6), emission=4.0),
    ]
    camera = {"position": [x, y + 0.8, z + 3.0], "target": [x, y + 0.3, z], "vertical_fov": 40.0}
    return scene(shapes, (), camera, white=lambert(0.7)).placed("written there", folder)


@pytest.mark.parametrize("place", FAR, ids=str)
@pytest.mark.parametrize("integrator", ["path", pytest.param("radiosity", marks=pytest.mark.long)])
def test_coordinates_of_shapes_and_meshes_may_be_far_themselves(
    studio: Studio, tmp_path: Path, place: tuple[float, float, float], integrator: str
) -> None:
    settings: dict[str, Any] = {"spp": 4, "integrator": integrator, "seed": 3}
    settings |= {"patches": 300} if integrator == "radiosity" else {}
    near, far = (studio.image(written_there(tmp_path, *at), 32, **settings) for at in ((0.0, 0.0, 0.0), place))
    assert_same_paths(near, far)


def test_layers_stay_in_world_space(device: Device) -> None:
    x, y, z = 1e5, -2e5, 3e5
    settings: dict[str, Any] = {"device": device.info.index, "size": (16, 16), "spp": 4, "aov": ("position", "depth")}
    near = clrender.render(small_things(0.0, 0.0, 0.0), **settings).aovs
    far = clrender.render(small_things(x, y, z), **settings).aovs
    seen = np.isfinite(near["position"])
    place = np.array([x, y, z], np.float32)
    np.testing.assert_allclose((far["position"] - place)[seen], near["position"][seen], atol=0.05)
    np.testing.assert_allclose(far["depth"], near["depth"], rtol=1e-3)


def test_near_scenes_keep_the_worlds_origin() -> None:
    for name in ("room", "cornell", "caustic", "bumpy"):
        assert flatten(clrender.load(name), 16, 16).origin == (0.0, 0.0, 0.0)


def test_a_camera_that_moves_keeps_the_arrays() -> None:
    """Only where it goes far does the origin change; until then all that depends on the camera is its row."""
    scenes = [small_things(1e6, 0.0, 0.0)]
    for step in ((0.5, 0.2, -1.0), (20.0, 5.0, 3.0)):
        camera = scenes[0].camera
        moved = {
            name: tuple(a + b for a, b in zip(getattr(camera, name), step, strict=True))
            for name in ("position", "target")
        }
        scenes.append(scenes[0].model_copy(update={"camera": camera.model_copy(update=moved)}))
    flats = [flatten(each, 16, 16) for each in scenes]
    assert len({flat.origin for flat in flats}) == 1 and flats[0].origin != (0.0, 0.0, 0.0)
    for flat in flats[1:]:
        assert not np.array_equal(flat.camera, flats[0].camera)
        # By their bytes: some columns hold whole numbers, whose bits may be those of no number
        assert all(flat.arrays[name].tobytes() == array.tobytes() for name, array in flats[0].arrays.items())
    away = scenes[0].camera.model_copy(update={"position": (0.0, 0.8, 3.0), "target": (0.0, 0.3, 0.0)})
    assert scene_origin(away) == (0.0, 0.0, 0.0)


def test_another_origin_can_be_asked_for() -> None:
    flat = flatten(small_things(1e6, 0.0, 0.0), 16, 16, origin=(1e6, 0.0, 0.0))
    assert flat.origin == (1e6, 0.0, 0.0)
    assert np.abs(flat.arrays["vertices"]).max() <= 2.0
    assert flat.arrays["lights"]["position"][-1, :3].tolist() == [1.0, 1.5, 1.0]
