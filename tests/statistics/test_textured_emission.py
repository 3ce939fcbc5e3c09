"""Surfaces that shine as a texture: against quadrature, against constants to the bit, and how lights are chosen."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt
import pytest
from exact import mirrored, polygon_irradiance
from photon_support import ALBEDO, PHOTONS, photon_map
from PIL import Image
from render_support import Studio, disk, lambert, quad, scene, sphere
from stats_support import Evidence

import clrender
from clrender.flatten.flat_scene import flatten
from clrender.image.files import write_image

if TYPE_CHECKING:
    from clrender.device import Device
    from clrender.scene import Scene

Floats = npt.NDArray[np.float64]
WEIGHTS = np.array([0.5, 0.3, 0.2])
"""Of the channels, as `Studio.pixels` takes them together."""
FLOOR = quad([-50.0, 0.0, 50.0], [100.0, 0.0, 0.0], [0.0, 0.0, -100.0], material="floor")
FINE = 480
"""Points along each texture coordinate of a quadrature: a multiple of the squares of the checker, and of texels."""
RNG = np.random.default_rng(740)
PICTURE = RNG.random((6, 8, 3)).astype(np.float32) ** 4 * 10.0
HALVES = ((1.0, 2.0, 0.5), (6.0, 0.0, 4.0))

SHARED: tuple[dict[str, Any], ...] = (
    {"type": "box", "center": [-0.6, 0.5, -0.4], "size": [0.4, 0.5, 0.3]},
    {"type": "tetrahedron", "vertices": [[0, 0, 0], [0.5, 0, 0], [0.2, 0.5, 0.1], [0.2, 0.1, 0.5]]},
    sphere([0.7, 0.6, 0.1], 0.25),
    sphere([0.0, 0.0, 0.0], 9.0, flip_normals=True),
    disk([-0.2, 1.2, 0.3], [0.3, -1.0, 0.2], 0.3),
    quad([0.3, 1.0, -0.6], [0.4, 0.1, 0.0], [0.0, 0.2, 0.4], flip_normals=True),
    {"type": "mesh", "vertices": [[-1, 0.1, 0], [-1, 0.4, 0.4], [-0.9, 0.6, 0]], "faces": [[0, 1, 2]]}
    | {"uvs": [[0.1, 0.2], [2.0, -1.0], [0.3, 0.7]]},
)  # fmt: skip


def hats(place: Floats, count: int) -> Floats:
    """Weights of texels in linear interpolation that does not wrap, (points, texels)."""
    at = np.clip(place * count, 0.5, count - 0.5)
    return np.maximum(0.0, 1.0 - np.abs(at[:, None] - (np.arange(count) + 0.5)))


def as_picture(u: Floats, v: Floats) -> Floats:
    value: Floats = np.einsum("ui,vj,jic->uvc", hats(u, 8), hats(1.0 - v, 6), PICTURE.astype(np.float64))
    return value


def as_checker(u: Floats, v: Floats) -> Floats:
    odd = (np.floor(u[:, None] / 0.25) + np.floor(v[None, :] / 0.25)) % 2 == 1
    return np.where(odd[..., None], HALVES[1], HALVES[0])


TEXTURES: dict[str, tuple[dict[str, Any], Callable[[Floats, Floats], Floats]]] = {
    "picture": ({"texture": "p.exr", "wrap": "clamp"}, as_picture),
    "checker": ({"checker": HALVES, "size": 0.25}, as_checker),
}


def placed(what: Scene, folder: Path) -> Scene:
    write_image(folder / "p.exr", PICTURE)
    return what.placed("here", folder)


# --- to the bit -------------------------------------------------------------------------------------------------------


@pytest.mark.long
@pytest.mark.parametrize(
    "integrator",
    ["path", "whitted", *(pytest.param(name, marks=pytest.mark.slow) for name in ("direct", "reuse", "photon"))],
)
def test_a_texture_of_one_value_is_a_constant_to_the_bit(device: Device, tmp_path: Path, integrator: str) -> None:
    """On every shape, with and without a material, itself with a texture; and as the emission of a material."""
    write_image(tmp_path / "one.exr", np.tile(np.array([0.5, 0.25, 0.125], np.float32), (3, 5, 1)))
    principled = {"type": "principled", "base_color": [0.5, 0.25, 0.75], "roughness": 0.75}

    def sha(emission: Any, reflectance: Any = (0.25, 0.5, 0.75), **of_material: Any) -> str:
        own = None if of_material else emission
        materials = {"m": {"type": "lambert", "reflectance": reflectance}, "floor": lambert(0.5)}
        if "principled" in of_material:
            materials["m"] = {**principled, **of_material["principled"]}
        shapes = [FLOOR, *({**shape, "emission": own, "material": "m"} for shape in SHARED[:4])]
        shapes += [{**shape, "emission": emission} for shape in SHARED[4:]]
        camera = {"position": [0.0, 0.8, 3.0], "target": [0.0, 0.5, 0.0]}
        lights = [{"type": "point", "position": [0.0, 2.0, 1.0], "intensity": [0.5] * 3}]
        what = scene(shapes, lights, camera, **materials).placed("here", tmp_path)
        more: dict[str, Any] = {"photons": 4096} if integrator == "photon" else {}
        image = clrender.render(what, device=device, size=(40, 30), spp=4, integrator=integrator, **more)
        assert image.stats["nonfinite_samples"] == 0
        return str(image.stats["image_sha256"])

    bright, dim = (2.0, 1.0, 0.5), (0.5, 0.25, 0.125)
    expected = sha(bright)
    picture = {"texture": "one.exr", "scale": 4.0, "transform": {"scale": 3.0}}
    assert sha({"ramp": [bright, bright]}) == sha({"checker": [bright, bright]}) == expected
    assert sha(picture) == sha(picture, {"ramp": [[0.25, 0.5, 0.75]] * 2}) == expected
    assert sha({"ramp": [bright, dim]}) != expected
    if integrator != "path":  # others take the material as well, but not all
        return
    expected = sha(bright, principled={"emission": bright})
    assert sha(bright, principled={"emission": dim, "emission_strength": 4.0}) == expected
    assert sha(bright, principled={"emission": {"texture": "one.exr"}, "emission_strength": 4.0}) == expected
    assert sha(picture, principled={"emission": picture}) == expected
    assert sha(bright, principled={"emission": bright, "emission_strength": 0.0}) != expected


def test_emission_of_a_material_is_that_of_its_shapes(device: Device) -> None:
    """A glowing material on two shapes, or the same material with the emission in the shapes."""
    glow = {"emission": {"checker": [0.0, [1.0, 0.5, 0.25]], "size": 0.1}}
    made = []
    for of_material, of_shape in ((glow, {}), ({}, glow)):
        shapes = [{**shape, "material": "m", **of_shape} for shape in (SHARED[0], SHARED[2])]
        materials = {"m": {"type": "principled", "base_color": [0.5, 0.25, 0.75], **of_material}}
        what = scene(
            [FLOOR, *shapes], (), {"position": [0, 1, 3], "target": [0, 0.5, 0]}, floor=lambert(0.5), **materials
        )
        made.append(clrender.render(what, device=device, size=(40, 30), spp=4).stats["image_sha256"])
    assert made[0] == made[1]


@pytest.mark.slow
@pytest.mark.parametrize("integrator", ["path", "photon"])
def test_the_same_bits_in_any_lanes(device: Device, tmp_path: Path, integrator: str) -> None:
    emissions = [{"texture": "p.exr"}, {"checker": HALVES}, {"ramp": [0.0, [1, 2, 3]]}, [1.0, 0.5, 0.25]]
    shapes = [{**shape, "emission": emissions[number % 4]} for number, shape in enumerate(SHARED)]
    camera = {"position": [0.0, 0.8, 3.0], "target": [0.0, 0.5, 0.0]}
    what = placed(scene([FLOOR, *shapes], (), camera, floor=lambert(0.5)), tmp_path)
    more: dict[str, Any] = {"photons": 512} if integrator == "photon" else {}
    made = [
        clrender.render(what, device=device, size=(40, 30), spp=4, lanes=lanes, integrator=integrator, **more)
        for lanes in (1, 4, 16)
    ]
    assert len({image.stats["image_sha256"] for image in made}) == 1


# --- seen directly ----------------------------------------------------------------------------------------------------


@pytest.mark.long
@pytest.mark.parametrize(
    "integrator",
    ["path", "whitted", *(pytest.param(name, marks=pytest.mark.slow) for name in ("direct", "reuse", "photon"))],
)
def test_a_pixel_shows_the_mean_of_its_footprint(studio: Studio, tmp_path: Path, integrator: str) -> None:
    """Of a checker of half a pixel and of a large one with black squares; nothing is clamped at 1."""
    camera = {"position": [0.0, 0.0, 1.0], "target": [0.0, 0.0, 0.0], "vertical_fov": 90.0}
    more: dict[str, Any] = {"integrator": integrator, "spp": 64, **({"photons": 16} if integrator == "photon" else {})}
    dark, light, size = [0.0, 0.0, 0.0], [90.0, 0.5, 3.0], 8

    def seen(emission: Any) -> Floats:
        shape = quad([-1, -1, 0], [2, 0, 0], [0, 2, 0], emission=emission)
        return studio.image(placed(scene([shape], camera=camera), tmp_path), size, **more)

    image = seen({"checker": [dark, light], "size": 0.5 / size})
    np.testing.assert_allclose(image, np.broadcast_to(np.array(light) / 2, image.shape), rtol=2e-6)
    odd = (np.arange(size)[None, :] + np.arange(size)[::-1, None]) % 2 == 1
    image = seen({"checker": [dark, light], "size": 1.0 / size})
    np.testing.assert_allclose(image, np.where(odd[..., None], light, dark), rtol=2e-6)
    image = seen(
        {"texture": "p.exr", "filter": "nearest", "scale": [1.0, 2.0, 3.0], "transform": {"scale": [1, 8 / 6]}}
    )
    np.testing.assert_allclose(image[2:], PICTURE * np.array([1.0, 2.0, 3.0]), rtol=2e-6)


@pytest.mark.long
def test_a_black_texture_is_no_light(studio: Studio, tmp_path: Path) -> None:
    """And black texels shine on nothing; a picture's alpha, or its scale, may make it black as well."""
    Image.fromarray(np.zeros((3, 3, 4), np.uint8) + np.array([9, 9, 9, 0], np.uint8)).save(tmp_path / "clear.png")
    for black in (
        {"checker": [0.0, 0.0]},
        {"texture": "clear.png", "channel": "a"},
        {"texture": "p.exr", "scale": 0.0},
    ):
        what = placed(scene([FLOOR, {**SHARED[2], "emission": black}], floor=lambert(0.5)), tmp_path)
        assert flatten(what, 8, 8).light_count == 0
        assert not studio.image(what, 8, spp=4).any()
    # The half over the floor is black; the other lies below it
    light = quad(
        [1.0, -1.0, -1.0], [0.0, 2.0, 0.0], [0.0, 0.0, 2.0], emission={"checker": [1.0, 0.0], "size": [0.5, 2.0]}
    )
    light["flip_normals"] = True
    for sampling in ("light", "bsdf"):
        assert not studio.image(scene([FLOOR, light], floor=lambert(0.5)), 16, spp=64, sampling=sampling).any()


# --- irradiance -------------------------------------------------------------------------------------------------------


def irradiance(points: Floats, normals: Floats, areas: Floats, radiance: Floats) -> float:
    """At the origin, for the normal (0, 1, 0): of (..., 3) points with areas, radiances and normals."""
    distance = np.sqrt((points**2).sum(-1))
    towards = points / distance[..., None]
    cosines = np.maximum(towards[..., 1], 0.0) * np.maximum(-(towards * normals).sum(-1), 0.0)
    return float(((radiance @ WEIGHTS) * cosines * areas / distance**2).sum())


def even() -> Floats:
    return (np.arange(FINE) + 0.5) / FINE


def of_quad(shape: dict[str, Any], radiance: Callable[[Floats, Floats], Floats]) -> float:
    origin, edge_u, edge_v = (np.array(shape[key]) for key in ("origin", "edge_u", "edge_v"))
    points = origin + even()[:, None, None] * edge_u + even()[None, :, None] * edge_v
    normal = np.cross(edge_u, edge_v)
    area = np.full((FINE, FINE), np.linalg.norm(normal) / FINE**2)
    return irradiance(points, normal / np.linalg.norm(normal), area, radiance(even(), even()))


def of_disk(shape: dict[str, Any], radiance: Callable[[Floats, Floats], Floats]) -> float:
    """Of one that faces down: u runs along x there, and v along z."""
    x, z = np.meshgrid(even() * 2 - 1, even() * 2 - 1, indexing="ij")
    points = np.array(shape["center"]) + shape["radius"] * np.stack([x, np.zeros_like(x), z], -1)
    area = np.where(x * x + z * z < 1.0, (2 * shape["radius"] / FINE) ** 2, 0.0)
    return irradiance(points, np.array([0.0, -1.0, 0.0]), area, radiance(even(), even()))


def of_sphere(shape: dict[str, Any], radiance: Callable[[Floats, Floats], Floats]) -> float:
    longitude, latitude = np.meshgrid((even() - 0.5) * 2 * math.pi, (even() - 0.5) * math.pi, indexing="ij")
    out = np.stack([np.sin(longitude) * np.cos(latitude), np.sin(latitude), np.cos(longitude) * np.cos(latitude)], -1)
    area = shape["radius"] ** 2 * np.cos(latitude) * 2 * math.pi**2 / FINE**2
    sign = -1.0 if shape.get("flip_normals") else 1.0
    return irradiance(np.array(shape["center"]) + shape["radius"] * out, sign * out, area, radiance(even(), even()))


def net(shape: dict[str, Any], side: int) -> dict[str, Any]:
    """A quad as a mesh of 2 side^2 triangles with the same texture coordinates."""
    origin, edge_u, edge_v = (np.array(shape[key]) for key in ("origin", "edge_u", "edge_v"))
    uvs = np.stack(np.meshgrid(np.arange(side + 1), np.arange(side + 1), indexing="ij"), -1).reshape(-1, 2) / side
    corner = (np.arange(side)[:, None] * (side + 1) + np.arange(side)).ravel()
    around = [corner, corner + side + 1, corner + side + 2, corner + 1]
    faces = np.concatenate([np.stack([around[i] for i in order], 1) for order in ((0, 1, 2), (0, 2, 3))])
    vertices = origin + uvs[:, :1] * edge_u + uvs[:, 1:] * edge_v
    return {"type": "mesh", "vertices": vertices.tolist(), "faces": faces.tolist(), "uvs": uvs.tolist()}


SCREEN = quad([-0.2, 0.3, -0.9], [1.1, 0.2, 0.0], [0.1, 0.9, 0.3])
CASES: dict[str, tuple[dict[str, Any], Callable[..., float], dict[str, Any]]] = {
    "quad": (SCREEN, of_quad, SCREEN),
    "mesh": (net(SCREEN, 9), of_quad, SCREEN),
    "disk": (disk([0.4, 0.7, -0.2], [0, -1, 0], 0.6), of_disk, {}),
    "sphere": (sphere([0.5, 0.9, 0.3], 0.6), of_sphere, {}),
    "inward sphere": (sphere([0.3, 0.4, -0.2], 1.5, flip_normals=True), of_sphere, {}),
}


FAST = ({("quad", "picture", each) for each in ("mis", "light", "bsdf")} | {("mesh", "picture", "light")}) | {
    (name, "picture", "mis") for name in ("disk", "sphere", "inward sphere")
}


@pytest.mark.parametrize(
    ("name", "texture", "sampling"),
    [
        pytest.param(name, texture, sampling, marks=[] if (name, texture, sampling) in FAST else pytest.mark.slow)
        for name in CASES
        for texture in (("picture", "checker") if name == "quad" else ("picture",))
        for sampling in ("mis", "light", "bsdf")
    ],
)
def test_irradiance(evidence: Evidence, studio: Studio, tmp_path: Path, name: str, texture: str, sampling: str) -> None:
    shape, quadrature, of = CASES[name]
    described, radiance = TEXTURES[texture]
    what = placed(scene([FLOOR, {**shape, "emission": described}], floor=lambert(0.6)), tmp_path)
    pixels = studio.pixels(what, spp=64, sampling=sampling, max_depth=1)
    exact = quadrature(of or shape, radiance)
    # The quadrature's own error is that of a disk's rim and of the horizon
    evidence.mean_is("radiance", pixels, 0.6 / math.pi * exact, rounding=5e-5)


@pytest.mark.long
def test_whitted_takes_the_mean_from_the_centre(studio: Studio, tmp_path: Path) -> None:
    """Each triangle of a mesh shines from its centre with its mean radiance, a disk and a sphere with theirs."""
    side = 3
    shape = net(SCREEN, side)
    checker = {"checker": HALVES, "size": 1 / side}
    what = scene([FLOOR, {**shape, "emission": checker}], floor=lambert(0.6))
    corners = np.array(shape["vertices"])[np.array(shape["faces"])]
    doubled = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    areas = np.linalg.norm(doubled, axis=1)
    cells = (np.array(shape["uvs"])[np.array(shape["faces"])].mean(1) * side).astype(int).sum(1)
    exact = irradiance(corners.mean(1), doubled / areas[:, None], areas / 2, np.array(HALVES)[cells % 2])
    found = studio.pixels(what, 4, spp=1, integrator="whitted")
    np.testing.assert_allclose(found, 0.6 / math.pi * exact, rtol=1e-4)  # pixels see points a little apart
    # A ramp over a sphere or disk has the mean of its middle, by symmetry
    for one in (SHARED[2], disk([0.4, 0.7, -0.2], [0, -1, 0], 0.6)):
        images = [
            studio.pixels(
                scene([FLOOR, {**one, "emission": emission}], floor=lambert(0.6)), 4, spp=1, integrator="whitted"
            )
            for emission in ({"ramp": HALVES}, [3.5, 1.0, 2.25])
        ]
        np.testing.assert_allclose(images[0], images[1], rtol=1e-5)


# --- the choice of lights ---------------------------------------------------------------------------------------------


def test_lights_are_chosen_by_their_mean_power(tmp_path: Path) -> None:
    """Of a picture of nearest texels whose rims are edges of the mesh, and by the exact integral of a linear one."""
    side, size = 12, 4
    bright = np.zeros((size, size, 3), np.float32)
    bright[1, 2] = [3.0, 5.0, 7.0]
    bright[3, 0] = [0.5, 0.25, 0.125]
    write_image(tmp_path / "p.exr", bright)
    shape = net(SCREEN, side)
    luminance = bright.astype(np.float64) @ [0.2126, 0.7152, 0.0722]
    middle = np.array(shape["uvs"])[np.array(shape["faces"])].mean(1)
    expected = luminance[((1 - middle[:, 1]) * size).astype(int), (middle[:, 0] * size).astype(int)]
    for keys in ({"texture": "p.exr", "filter": "nearest"}, {"texture": "p.exr", "filter": "nearest", "uv_set": 1}):
        emission = {"emission": keys, "uvs_1": shape["uvs"]}
        lights = flatten(scene([{**shape, **emission}]).placed("here", tmp_path), 8, 8, "power").arrays["lights"]
        found = lights["probability"] / lights["probability"].sum()
        share = np.maximum(expected, 1e-3 * expected.mean())
        np.testing.assert_allclose(found, share / share.sum(), rtol=1e-5)
        assert (lights["texture"] == 1).all()
    linear = {"texture": "p.exr", "wrap": "clamp"}
    row = flatten(scene([{**shape, "emission": linear}]).placed("here", tmp_path), 8, 8, "power").arrays["lights"]
    weights = (np.stack(np.meshgrid(np.arange(200), np.arange(200), indexing="ij"), -1).reshape(-1, 2) + 0.5) / 200
    b, c = np.where(weights.sum(1, keepdims=True) > 1.0, 1.0 - weights, weights).T
    corners = np.array(shape["uvs"])[np.array(shape["faces"])]
    for number in range(0, len(corners), 7):
        p, q, r = corners[number]
        u, v = (p + b[:, None] * (q - p) + c[:, None] * (r - p)).T
        exact = np.einsum("pi,pj,jic->pc", hats(u, size), hats(1 - v, size), bright.astype(np.float64)).mean(0)
        np.testing.assert_allclose(row["radiance"][number, :3], exact, atol=0.02)


@pytest.mark.long
def test_a_small_bright_region_is_found(studio: Studio, tmp_path: Path) -> None:
    """Chosen by power it makes little noise; chosen alike, much."""
    bright = np.full((16, 16, 3), 1e-3, np.float32)
    bright[5, 9] = 100.0
    write_image(tmp_path / "p.exr", bright)
    shape = {**net(SCREEN, 16), "emission": {"texture": "p.exr", "filter": "nearest"}}
    what = scene([FLOOR, shape], floor=lambert(0.6)).placed("here", tmp_path)
    noise = {
        sampler: studio.pixels(what, spp=16, light_sampler=sampler, sampling="light").std()
        for sampler in ("power", "bvh", "uniform")
    }
    assert noise["power"] * 20 < noise["uniform"] and noise["bvh"] * 20 < noise["uniform"], noise


# --- photons ----------------------------------------------------------------------------------------------------------


@pytest.mark.long
def test_photons_carry_the_power_of_the_texture(evidence: Evidence, device: Device) -> None:
    """Inside a sphere that shines inwards nothing is lost: the deposits hold its power, in each channel."""
    checker = {"checker": HALVES, "size": 0.25}
    what = scene([sphere([0, 0, 0], 1.0, emission=checker, flip_normals=True, material="wall")], wall=lambert(ALBEDO))
    flux = [photon_map(device, what, number)[6:9].sum(axis=1, dtype=np.float64) / PHOTONS for number in range(8)]
    exact = math.pi * 4.0 * math.pi * np.mean(HALVES, axis=0) * ALBEDO / (1.0 - ALBEDO)
    evidence.mean_is("power", np.array(flux) @ WEIGHTS, float(exact @ WEIGHTS))


@pytest.mark.slow
def test_photons_start_where_the_texture_is_bright(evidence: Evidence, studio: Studio, tmp_path: Path) -> None:
    """The half of a light that shines, seen again in a mirror wall: r times the irradiance of the mirrored half."""
    wall = quad([-0.2, -5.0, 5.0], [0.0, 10.0, 0.0], [0.0, 0.0, -10.0], material="wall")
    light = quad(
        [0.0, 1.0, -0.4], [0.8, 0.0, 0.0], [0.0, 0.0, 0.8], emission={"checker": [0.0, 2.0], "size": [0.5, 2.0]}
    )
    corners = [[0.4, 1.0, -0.4], [0.8, 1.0, -0.4], [0.8, 1.0, 0.4], [0.4, 1.0, 0.4]]
    exact = 2.0 * (polygon_irradiance(corners) + 0.8 * polygon_irradiance(mirrored(corners, 0, -0.2)))
    more: dict[str, Any] = {"floor": lambert(0.6), "wall": {"type": "mirror", "reflectance": [0.8] * 3}}
    means = [
        studio.pixels(
            scene([FLOOR, wall, light], **more), 8, spp=8, seed=seed, integrator="photon", photon_radius=0.08
        ).mean()
        for seed in range(24)
    ]
    evidence.mean_is("radiance", means, 0.6 / math.pi * exact, rounding=2e-3)
