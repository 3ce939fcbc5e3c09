"""Pairs of features, each right by itself, that made or lost light where they met."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from PIL import Image

import clrender
from clrender.device import Device

pytestmark = pytest.mark.long

SEEDS = (1, 2, 3)
FLOOR = """
[[shapes]]
type = "quad"
origin = [-1.0, 0.0, 1.0]
edge_u = [2.0, 0.0, 0.0]
edge_v = [0.0, 0.0, -2.0]
material = "floor"
"""
TILTED = """
[materials.floor]
type = "lambert"
reflectance = 0.8
normal_map = { texture = "tilted.png" }
"""

Rendered = Callable[..., npt.NDArray[np.float64]]


@pytest.fixture
def rendered(tmp_path: Path, device: Device) -> Rendered:
    """Renders the text of a scene; returns the mean of each seed's image, (seeds, 3)."""
    Image.new("RGB", (4, 4), (200, 128, 230)).save(tmp_path / "tilted.png")
    Image.new("RGB", (4, 4), (128, 200, 230)).save(tmp_path / "away.png")
    Image.new("RGB", (4, 4), (56, 128, 230)).save(tmp_path / "left.png")
    np.save(tmp_path / "ones.npy", np.ones((2, 2, 2), np.float32))

    def of(text: str, **settings: Any) -> npt.NDArray[np.float64]:
        path = tmp_path / "scene.toml"
        path.write_text(text, encoding="utf-8")
        given = {"size": (8, 8), "spp": 64, **settings}
        with clrender.Session(device) as session:
            images = [session.render(clrender.load(path), seed=seed, **given).linear for seed in SEEDS]
        return np.array([image.mean(axis=(0, 1), dtype=np.float64) for image in images])

    return of


def agree(a: npt.NDArray[np.float64], b: npt.NDArray[np.float64], tolerance: float) -> None:
    np.testing.assert_allclose(a.mean(axis=0), b.mean(axis=0), rtol=tolerance)


def test_normal_maps_of_light_paths(rendered: Rendered) -> None:
    """Normals are bent towards who looks. Light paths took those that are bent towards the light: 27 % were lost."""
    spot = """
    [camera]
    position = [0.0, 0.12, 1.0]
    target = [0.0, 0.0, 0.0]
    vertical_fov = 4.0
    [[lights]]
    type = "spot"
    position = [0.0, 3.0, 0.0]
    direction = [0.0, -1.0, 0.0]
    cone_degrees = 10.0
    intensity = 5.0
    """
    scene = spot + TILTED.replace("tilted", "away") + FLOOR
    path = rendered(scene)
    agree(rendered(scene, integrator="bdpt", spp=16, light_paths=100_000), path, 2e-3)


@pytest.mark.parametrize("position", [[0.5, 3.0, 0.0], [3.0, 0.3, 0.0]], ids=["from above", "from the side"])
def test_normal_maps_below_photons(rendered: Rendered, position: list[float]) -> None:
    """From a mirror they come at a grazing angle; seen from the side the normal is bent towards the camera."""
    mirrored = f"""
    [camera]
    position = {position}
    target = [0.5, 0.0, 0.0]
    up = {[0.0, 0.0, -1.0] if position[1] > 1.0 else [0.0, 1.0, 0.0]}
    vertical_fov = 2.0
    [materials.mirror]
    type = "mirror"
    reflectance = 1.0
    [[shapes]]
    type = "quad"
    origin = [-1.0, 0.0, 1.0]
    edge_u = [0.0, 0.0, -2.0]
    edge_v = [0.0, 2.0, 0.0]
    material = "mirror"
    [[lights]]
    type = "spot"
    position = [2.0, 0.9, 0.0]
    direction = [-3.0, -0.6, 0.0]
    cone_degrees = 5.0
    intensity = 50.0
    """
    scene = mirrored + TILTED.replace("tilted", "left" if position[1] < 1.0 else "tilted") + FLOOR
    path = rendered(scene, specular_chains="on", spp=128)
    agree(rendered(scene, integrator="photon", spp=8, photons=100_000, photon_radius=0.03), path, 0.03)


def test_specular_chains_through_grids(rendered: Rendered) -> None:
    """What a grid leaves is a random estimate; where it was nothing there was no chain, and so nothing was absorbed."""
    smoke = """
    [camera]
    position = [0.0, 1.0, 3.0]
    target = [0.0, 0.0, 0.0]
    vertical_fov = 4.0
    [materials.floor]
    type = "lambert"
    reflectance = 0.8
    [materials.mirror]
    type = "mirror"
    reflectance = 1.0
    [[shapes]]
    type = "quad"
    origin = [-2.0, 3.0, 2.0]
    edge_u = [0.0, 0.0, -4.0]
    edge_v = [4.0, 0.0, 0.0]
    material = "mirror"
    [[shapes]] # in the direct way
    type = "quad"
    origin = [0.6, 1.2, 0.5]
    edge_u = [1.0, 0.0, 0.0]
    edge_v = [0.0, 0.0, -1.0]
    [[lights]]
    type = "point"
    position = [1.2, 2.2, 0.0]
    intensity = 20.0
    [[shapes]]
    type = "box"
    center = [0.0, 1.5, 0.0]
    size = [0.9, 1.0, 2.0]
    interior = "smoke"
    [media.smoke]
    absorption = 3.0
    """
    grid = """
    [media.smoke.density]
    file = "ones.npy"
    box = [[-0.45, 1.0, -1.0], [0.45, 2.0, 1.0]]
    """
    even = rendered(smoke + FLOOR, specular_chains="on", spp=256)
    agree(rendered(smoke + FLOOR + grid, specular_chains="on", spp=512), even, 0.08)


@pytest.mark.parametrize("material", ["lambert", "principled"])
def test_spectra_with_colors_of_vertices(rendered: Rendered, material: str) -> None:
    """The colours were multiplied to the number of the spectrum, which then was another one."""
    key = {"lambert": "reflectance", "principled": "specular = 0.0\nbase_color"}[material]
    scene = f"""
    [camera]
    position = [0.0, 0.0, 2.0]
    target = [0.0, 0.0, 0.0]
    vertical_fov = 5.0
    [materials.other]
    type = "lambert"
    reflectance = {{ wavelengths = [400.0, 700.0], values = [0.9, 0.1] }}
    [materials.painted]
    type = "{material}"
    {key} = {{ wavelengths = [400.0, 700.0], values = [0.1, 0.8] }}
    [[shapes]]
    type = "sphere"
    center = [10.0, 0.0, 0.0]
    radius = 0.1
    material = "other"
    [[shapes]]
    type = "mesh"
    vertices = [[-1.0, -1.0, 0.0], [1.0, -1.0, 0.0], [1.0, 1.0, 0.0], [-1.0, 1.0, 0.0]]
    faces = [[0, 1, 2], [0, 2, 3]]
    material = "painted"
    colors = [[0.5, 0.5, 0.5], [0.5, 0.5, 0.5], [0.5, 0.5, 0.5], [0.5, 0.5, 0.5]]
    [[lights]]
    type = "environment"
    radiance = 1.0
    """
    agree(rendered(scene, spectral=True), rendered(scene), 2e-3)


def test_light_groups_of_spectra(tmp_path: Path, device: Device) -> None:
    """Each group had all lights whose colour a spectrum says."""
    lamp = """
    [[lights]]
    type = "point"
    position = [{x}, 1.0, 0.0]
    intensity = {{ wavelengths = [400.0, 700.0], values = [{value}, {value}] }}
    light_group = "{group}"
    """
    text = """
    [camera]
    position = [0.0, 1.0, 3.0]
    target = [0.0, 0.0, 0.0]
    vertical_fov = 10.0
    [materials.floor]
    type = "lambert"
    reflectance = 0.5
    """
    text += FLOOR + lamp.format(x=-1.0, value=4.0, group="left") + lamp.format(x=1.0, value=1.0, group="right")
    path = tmp_path / "scene.toml"
    path.write_text(text, encoding="utf-8")
    with clrender.Session(device) as session:
        colors, waves = (
            session.render(clrender.load(path), size=(8, 8), spp=16, light_groups=True, spectral=spectral).light_groups
            for spectral in (False, True)
        )
    for group in ("left", "right"):
        np.testing.assert_allclose(waves[group].mean(axis=(0, 1)), colors[group].mean(axis=(0, 1)), rtol=0.03)
    assert waves["left"].mean() > 3.0 * waves["right"].mean()


def test_sheen_beside_glass_that_disperses(rendered: Rendered) -> None:
    """What lies below had what the sheen leaves at the strongest of the path's wavelengths, whichever these were."""
    scene = """
    [camera]
    position = [0.0, 0.0, 2.0]
    target = [0.0, 0.0, 0.0]
    vertical_fov = 40.0
    [materials.cloth]
    type = "principled"
    base_color = 0.9
    roughness = 1.0
    specular = 0.0
    sheen_color = [1.0, 0.05, 0.05]
    sheen_roughness = 0.5
    [materials.glass]
    type = "dielectric"
    ior = 1.5
    dispersion = { abbe = 30.0 }
    [[shapes]]
    type = "sphere"
    radius = 0.6
    center = [0.0, 0.0, 0.0]
    material = "cloth"
    [[shapes]]
    type = "sphere"
    radius = 0.01
    center = [0.0, 0.0, 5.0]
    material = "glass"
    [[lights]]
    type = "environment"
    radiance = 1.0
    visible_to_camera = false
    """
    path = rendered(scene, spectral=True, spp=128)
    agree(rendered(scene, spectral=True, spp=128, integrator="bdpt"), path, 0.03)


def test_whitted_out_of_rough_colored_glass(rendered: Rendered) -> None:
    """Light from beyond the surface was absorbed as if all of its way were in the glass."""
    scene = """
    [camera]
    position = [0.0, 0.0, 0.0]
    target = [0.0, 0.0, -1.0]
    vertical_fov = 60.0
    [materials.glass]
    type = "principled"
    transmission = 1.0
    roughness = 0.5
    base_color = 1.0
    ior = 1.5
    attenuation_color = [0.2, 0.5, 0.9]
    attenuation_distance = 1.0
    [[shapes]]
    type = "sphere"
    center = [0.0, 0.0, 0.0]
    radius = 1.0
    material = "glass"
    [[lights]]
    type = "point"
    position = [0.0, 0.5, -5.0]
    intensity = 10.0
    """
    agree(rendered(scene, integrator="whitted", max_depth=1), rendered(scene, max_depth=1), 1e-3)


def test_photons_from_hair_in_a_mixture(rendered: Rendered) -> None:
    """The material was chosen anew where the photon arrives and leaves, so an eighth of it was left and not a half."""

    def scene(material: str) -> str:
        return f"""
        [camera]
        position = [0.0, 0.9, 2.0]
        target = [0.0, 0.0, 0.3]
        vertical_fov = 8.0
        [materials.floor]
        type = "lambert"
        reflectance = 0.8
        [materials.white]
        type = "hair"
        absorption_coefficient = [0.0, 0.0, 0.0]
        [materials.black]
        type = "lambert"
        reflectance = 0.0
        [materials.mixed]
        type = "mix"
        materials = ["white", "black"]
        weight = 0.5
        [[shapes]]
        type = "quad"
        origin = [-2.0, 0.0, 2.0]
        edge_u = [4.0, 0.0, 0.0]
        edge_v = [0.0, 0.0, -4.0]
        material = "floor"
        [[shapes]]
        type = "curves"
        points = [[-1.0, 1.0, 0.0], [1.0, 1.0, 0.0]]
        radius = 0.1
        basis = "linear"
        material = "{material}"
        [[lights]]
        type = "spot"
        position = [0.0, 1.0, 4.0]
        direction = [0.0, 0.0, -1.0]
        cone_degrees = 8.0
        intensity = 100.0
        """

    settings = {"integrator": "photon", "photons": 100_000, "photon_radius": 0.05, "spp": 16}
    agree(rendered(scene("mixed"), **settings), 0.5 * rendered(scene("white"), **settings), 0.08)


def test_guiding_in_fog_knows_no_first_primitive(rendered: Rendered) -> None:
    """Where light scatters in a medium, the colour of the scene's first primitive was taken for the albedo there."""

    def scene(reflectance: float) -> str:
        return f"""
        fog = "fog"
        [camera]
        position = [0.0, 0.0, 2.5]
        target = [0.0, 0.0, 0.0]
        vertical_fov = 45.0
        [media.fog]
        scattering = 1.0
        absorption = 0.05
        [materials.first]
        type = "lambert"
        reflectance = {reflectance}
        [materials.wall]
        type = "lambert"
        reflectance = 0.7
        [[shapes]]
        type = "triangle"
        vertices = [[0.0, -1.4, -1.4], [1e-6, -1.4, -1.4], [0.0, -1.399999, -1.4]]
        material = "first"
        [[shapes]]
        type = "box"
        center = [0.0, 0.0, 1.0]
        size = [3.0, 3.0, 6.0]
        material = "wall"
        flip_normals = true
        [[shapes]]
        type = "quad"
        origin = [-0.2, 1.49, -0.2]
        edge_u = [0.4, 0.0, 0.0]
        edge_v = [0.0, 0.0, 0.4]
        emission = 20.0
        """

    black, white = (rendered(scene(each), spp=8, guiding="on", guiding_paths=20_000) for each in (0.0, 1.0))
    np.testing.assert_array_equal(black, white)


SKY = """
[[lights]]
type = "environment"
radiance = 1.0
"""


def on_a_floor(solid: str, camera: str) -> str:
    """The text of a scene: a solid of the material `solid` on a floor under a white sky."""
    floor = """
    [materials.floor]
    type = "lambert"
    reflectance = 0.5
    [[shapes]]
    type = "quad"
    origin = [-2.0, 0.0, 2.0]
    edge_u = [4.0, 0.0, 0.0]
    edge_v = [0.0, 0.0, -4.0]
    material = "floor"
    """
    return camera + SKY + solid + floor


CLEAR = {
    "a ball": """
    [materials.solid]
    type = "dielectric"
    ior = 1.001
    [[shapes]]
    type = "sphere"
    center = [0.0, 0.5, 0.0]
    radius = 0.5
    material = "solid"
    """,
    "a box": """
    [materials.solid]
    type = "principled"
    roughness = 0.0
    specular = 0.0
    transmission = 1.0
    ior = 1.001
    [[shapes]]
    type = "box"
    center = [0.0, 0.41, 0.0]
    size = [0.8, 0.8, 0.8]
    material = "solid"
    """,
}


@pytest.mark.parametrize("solid", CLEAR)
def test_photons_below_clear_solids(rendered: Rendered, solid: str) -> None:
    """They arrive there, and the disk's points were taken for covered: five times too bright where glass stands."""
    above = """
    [camera]
    position = [0.0, 3.0, 0.01]
    target = [0.0, 0.0, 0.0]
    vertical_fov = 10.0
    """
    settings = {"integrator": "photon", "photons": 100_000, "photon_radius": 0.1, "spp": 8}
    np.testing.assert_allclose(rendered(on_a_floor(CLEAR[solid], above), **settings).mean(axis=0), 0.5, rtol=0.03)


def test_photons_around_the_foot_of_a_mirror(rendered: Rendered) -> None:
    """A floor below a ball that reflects has photons up to where it touches; around there it was twice too bright."""
    beside = """
    [camera]
    position = [0.0, 0.12, 2.0]
    target = [0.0, 0.015, 0.0]
    vertical_fov = 2.0
    """
    mirror = CLEAR["a ball"].replace('"dielectric"\n    ior = 1.001', '"mirror"\n    reflectance = 1.0')
    scene = on_a_floor(mirror, beside)
    photons = rendered(scene, integrator="photon", photons=100_000, photon_radius=0.05, spp=8)
    agree(photons, rendered(scene, spp=512), 0.05)


def test_photons_behind_panes_in_smoke(rendered: Rendered) -> None:
    """They were gathered, and their part of the ball was out of reach: 15 % too bright."""
    panes = "".join(
        f"""
        [[shapes]]
        type = "box"
        center = [{x}, 0.0, 0.0]
        size = [0.02, 1.2, 1.2]
        material = "glass"
        """
        for x in (-0.3, -0.15, 0.0, 0.15, 0.3)
    )
    scene = (
        SKY
        + panes
        + """
    [camera]
    position = [0.0, 0.0, 3.0]
    target = [0.0, 0.0, 0.0]
    vertical_fov = 15.0
    [materials.glass]
    type = "dielectric"
    ior = 1.001
    [media.smoke]
    scattering = 3.0
    absorption = 0.0
    [[shapes]]
    type = "box"
    center = [0.0, 0.0, 0.0]
    size = [1.4, 1.4, 1.4]
    interior = "smoke"
    """
    )
    smoke = rendered(scene, integrator="photon", photons=50_000, photon_radius=0.1, spp=16)
    np.testing.assert_allclose(smoke.mean(axis=0), 1.0, rtol=0.02)
