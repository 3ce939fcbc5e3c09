"""The layers beside an image: known answers, and the same bits however the work is cut."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

import clrender
from clrender.aov import AOVS, OF_FILM, OF_RENDERS, exr_channels
from clrender.device import Device
from clrender.errors import UsageError
from clrender.image.files import read_image
from clrender.scene import Scene

ASKED = tuple(name for name in AOVS if name not in OF_FILM | OF_RENDERS)
WIDTH, HEIGHT = 40, 24

COLOURS = {"red": [0.63, 0.065, 0.05], "green": [0.14, 0.45, 0.091]}
MIRROR = [0.9, 0.8, 0.7]


def scene(shapes: list[dict[str, Any]], lights: list[dict[str, Any]] | None = None, **camera: Any) -> Scene:
    """Shapes seen from the origin along -z, 90 degrees high, unless `camera` says otherwise."""
    materials: dict[str, Any] = {name: {"type": "lambert", "reflectance": rgb} for name, rgb in COLOURS.items()}
    materials["mirror"] = {"type": "mirror", "reflectance": MIRROR}
    materials["glass"] = {"type": "dielectric", "ior": 1.5}
    view = {"position": [0.0, 0.0, 0.0], "target": [0.0, 0.0, -1.0], "vertical_fov": 90.0, "flow_step": 1.0, **camera}
    return Scene.model_validate({"camera": view, "materials": materials, "shapes": shapes, "lights": lights or []})


def wall(z: float, **more: Any) -> dict[str, Any]:
    """A quad across the whole view, facing +z."""
    return {"type": "quad", "origin": [-99.0, -99.0, z], "edge_u": [198, 0, 0], "edge_v": [0, 198, 0], **more}


def layers(
    device: Device, what: Scene, names: tuple[str, ...] = ASKED, **settings: Any
) -> dict[str, npt.NDArray[np.float32]]:
    """Layers of a small image."""
    with clrender.Session(device) as session:
        return session.render(what, size=(WIDTH, HEIGHT), aov=names, **{"spp": 64, **settings}).aovs


def single(numbers: npt.ArrayLike) -> npt.NDArray[np.float32]:
    """As the kernels hold them."""
    return np.asarray(numbers, np.float32)


def same(layer: npt.NDArray[np.float32], rgb: npt.ArrayLike) -> bool:
    """Whether every pixel holds these numbers, to the bit."""
    return bool((layer == single(rgb)).all())


# --- albedo ----------------------------------------------------------------------------------------------------------


def test_albedo_is_the_reflectance_to_the_bit(device: Device) -> None:
    for name, rgb in COLOURS.items():
        assert same(layers(device, scene([wall(-2.0, material=name)]), ("albedo",))["albedo"], rgb)


def test_albedo_in_a_mirror_is_tinted_by_it(device: Device) -> None:
    behind = wall(3.0, material="red")
    behind["edge_u"], behind["edge_v"] = behind["edge_v"], behind["edge_u"]
    tinted = single(MIRROR) * single(COLOURS["red"])
    assert same(layers(device, scene([wall(-2.0, material="mirror"), behind]), ("albedo",))["albedo"], tinted)


def test_albedo_through_glass_is_what_is_behind(device: Device) -> None:
    """In a room of one colour, glass shows that colour, whichever way the ray leaves it. One that turns sixteen times
    inside the ball is given up, as white: here one of 61440."""
    room = {"type": "box", "center": [0, 0, 0], "size": [9, 9, 9], "material": "green"}
    ball = {"type": "sphere", "center": [0, 0, -2.0], "radius": 1.0, "material": "glass"}
    green = single(COLOURS["green"])
    albedo = layers(device, scene([room, ball]), ("albedo",))["albedo"]
    given_up = (albedo - green) / (1.0 - green)
    assert (given_up != 0.0).any(axis=2).sum() <= 2 and (given_up >= 0.0).all() and given_up.mean() < 1e-4


def test_albedo_of_what_shines_is_its_radiance_at_most_one(device: Device) -> None:
    sky = [{"type": "environment", "radiance": [0.25, 0.5, 7.0]}]
    assert same(layers(device, scene([wall(3.0)], sky), ("albedo",))["albedo"], [0.25, 0.5, 1.0])
    shining = wall(-2.0, material="red", emission=[0.125, 0.0, 4.0])
    expected = single(COLOURS["red"]) + single([0.125, 0.0, 0.0])
    assert same(layers(device, scene([shining]), ("albedo",))["albedo"], [*expected[:2], 1.0])


def test_between_two_mirrors_the_albedo_comes_to_an_end(device: Device) -> None:
    albedo = layers(device, scene([wall(-2.0, material="mirror"), wall(2.0, material="mirror")]), ("albedo",))["albedo"]
    assert albedo.max() <= 0.9 and np.isfinite(albedo).all()


# --- normal, depth, position -----------------------------------------------------------------------------------------


def test_normal_of_a_quad_is_on_the_side_it_is_seen_from(device: Device) -> None:
    up = np.array([0.0, 3.0, 4.0]) / 5.0
    tilted = {"type": "quad", "origin": [-99, -80, 58], "edge_u": [198, 0, 0], "edge_v": [0, 160.0, -120.0]}
    for flip in (False, True):
        normal = layers(device, scene([{**tilted, "material": "red", "flip_normals": flip}]), ("normal",))["normal"]
        assert np.abs(normal - up).max() < 1e-6


def test_what_meets_nothing(device: Device) -> None:
    nothing = layers(device, scene([wall(3.0)]))
    assert same(nothing["normal"], 0.0) and same(nothing["albedo"], 0.0)
    assert np.isposinf(nothing["depth"]).all() and np.isnan(nothing["position"]).all()
    assert same(nothing["object"], -1.0) and same(nothing["material"], -1.0)


def test_position_and_depth_of_a_plane_across_the_view(device: Device) -> None:
    """Parallel to the film, position is linear on it. The 64 samples of a pixel stand one in each 64th of its width and
    of its height, so their mean is at most a 128th of a pixel from its middle; depth is between its least and most."""
    distance = 2.0
    found = layers(device, scene([wall(-distance, material="red")]), ("position", "depth"))
    pixel = 2.0 * distance / HEIGHT
    rows, columns = np.mgrid[:HEIGHT, :WIDTH]
    x, y = (columns + 0.5 - WIDTH / 2) * pixel, (HEIGHT / 2 - rows - 0.5) * pixel
    position = found["position"]
    assert np.abs(position[..., 0] - x).max() <= pixel / 128 + 1e-5
    assert np.abs(position[..., 1] - y).max() <= pixel / 128 + 1e-5
    assert np.abs(position[..., 2] + distance).max() <= 1e-6
    corners = [
        np.sqrt((x + i * pixel / 2) ** 2 + (y + j * pixel / 2) ** 2 + distance**2) for i in (-1, 1) for j in (-1, 1)
    ]
    depth = found["depth"][..., 0]
    assert (depth >= np.min(corners, axis=0) * (1 - 1e-6)).all() and (
        depth <= np.max(corners, axis=0) * (1 + 1e-6)
    ).all()


def test_one_sample_of_a_sphere_agrees_with_itself(device: Device) -> None:
    """Its position is on the sphere, the normal points from the centre to it, and its depth is its distance."""
    center, radius, eye = np.array([0.3, 0.2, -4.0]), 1.5, np.array([0.5, -0.25, 1.0])
    ball = {"type": "sphere", "center": center.tolist(), "radius": radius, "material": "mirror"}
    found = layers(device, scene([ball], position=eye.tolist(), target=center.tolist()), spp=1)
    hit = found["object"][..., 0] == 0
    outward = (found["position"][hit] - center) / radius
    assert 20 < hit.sum() < hit.size and np.abs(np.linalg.norm(outward, axis=1) - 1.0).max() < 1e-5
    assert np.abs(found["normal"][hit] - outward).max() < 1e-5
    assert np.abs(found["depth"][hit][:, 0] - np.linalg.norm(found["position"][hit] - eye, axis=1)).max() < 1e-5


def test_object_and_material_are_places_in_the_scene(device: Device) -> None:
    half = {**wall(-2.0, material="green"), "origin": [0.0, -99.0, -2.0]}
    block = {"type": "box", "center": [-2.0, 0.0, -2.0], "size": [3.9, 50.0, 1.0], "material": "mirror"}
    found = layers(device, scene([wall(-9.0, material="red"), half, block]), ("object", "material"))
    object_, material = found["object"][..., 0], found["material"][..., 0]
    assert set(np.unique(object_)) == {0.0, 1.0, 2.0}
    assert (object_[:, WIDTH // 2 + 1 :] == 1.0).all() and (object_[:, : WIDTH // 2 - 2] == 2.0).all()
    assert (material == np.array([0.0, 1.0, 2.0])[object_.astype(int)]).all()


# --- emission, texture coordinates, tangents -------------------------------------------------------------------------


def test_emission_is_that_of_the_first_surface(device: Device) -> None:
    """Of its bright side, as much as it is; neither of what is behind glass nor of the environment."""
    sky = [{"type": "environment", "radiance": [0.25, 0.5, 7.0]}]
    lamp = wall(-3.0, emission=[12.5, 0.5, 3.0])
    assert same(layers(device, scene([lamp], sky), ("emission",))["emission"], [12.5, 0.5, 3.0])
    assert same(layers(device, scene([{**lamp, "flip_normals": True}]), ("emission",))["emission"], 0.0)
    assert same(layers(device, scene([wall(3.0)], sky), ("emission",))["emission"], 0.0)
    pane = wall(-2.0, material="glass")
    assert same(layers(device, scene([lamp, pane]), ("emission",))["emission"], 0.0)


@pytest.mark.long
def test_emission_of_a_texture_and_of_half_a_pixel(device: Device) -> None:
    half = {**wall(-2.0, emission=[8.0, 4.0, 2.0]), "origin": [0.0, -99.0, -2.0]}
    found = layers(device, scene([half]), ("emission",))["emission"]
    assert same(found[:, WIDTH // 2 :], [8, 4, 2]) and same(found[:, : WIDTH // 2], 0.0)
    chequered = wall(-2.0, emission={"checker": [[2.0, 2.0, 2.0], [6.0, 6.0, 6.0]], "size": 0.001})
    found = layers(device, scene([chequered]), ("emission",))["emission"]
    assert found.min() >= 2.0 and found.max() <= 6.0 and abs(found.mean() - 4.0) < 0.2


@pytest.mark.long
@pytest.mark.parametrize("material", ["red", "glass", "checked"])
def test_coordinates_of_a_quad(device: Device, material: str) -> None:
    """Along its edges, from its origin; whether or not anything uses them, and whichever way it faces."""
    tilted = {"type": "quad", "origin": [-99, -80, 58], "edge_u": [198, 0, 0], "edge_v": [0, 160.0, -120.0]}
    what = scene([{**tilted, "material": "red"}]).model_dump(exclude_unset=True)
    what["materials"]["checked"] = {"type": "lambert", "reflectance": {"checker": [0.1, 0.9], "size": 0.1}}
    for flip in (False, True):
        what["shapes"] = [{**tilted, "material": material, "flip_normals": flip}]
        found = layers(device, Scene.model_validate(what), ("uv", "tangent", "position"))
        place = found["position"] - np.array(tilted["origin"], np.float64)
        u, v = place[..., 0] / 198.0, place[..., 1] / 160.0
        assert np.abs(found["uv"] - np.stack([u, v], axis=2)).max() < 1e-5
        assert np.abs(found["tangent"] - [1.0, 0.0, 0.0]).max() < 1e-6


def test_coordinates_of_a_sphere_and_a_disk(device: Device) -> None:
    """By longitude and latitude; of a disk, by its square."""
    ball = {"type": "sphere", "center": [0.0, 0.0, -2.0], "radius": 1.0, "material": "red"}
    found = layers(device, scene([ball]), ("uv", "tangent", "normal"), spp=1)
    x, y, z = np.moveaxis(found["normal"].astype(np.float64), 2, 0)
    hit = np.abs(found["normal"]).max(axis=2) > 0.0
    u = np.arctan2(x, z) / (2.0 * np.pi) + 0.5
    v = np.arcsin(np.clip(y, -1.0, 1.0)) / np.pi + 0.5
    assert np.abs(found["uv"] - np.stack([u, v], axis=2))[hit].max() < 1e-4
    east = np.stack([z, np.zeros_like(z), -x], axis=2) / np.hypot(x, z)[..., None].clip(1e-9)
    assert np.abs(found["tangent"] - east)[hit].max() < 1e-4
    assert np.isnan(found["uv"][~hit]).all() and same(found["tangent"][~hit], 0.0)
    disk = {"type": "disk", "center": [0, 0, -2.0], "normal": [0, 0, 1], "radius": 4.0, "material": "red"}
    found = layers(device, scene([disk]), ("uv", "tangent", "position"))
    assert np.abs(found["uv"] - (found["position"][..., :2] / 8.0 + 0.5)).max() < 1e-5
    assert np.abs(found["tangent"] - [1, 0, 0]).max() < 1e-6


def test_coordinates_of_meshes_with_and_without(device: Device) -> None:
    corners = [[-99, -99, -2], [99, -99, -2], [0, 200, -2]]
    mesh = {"type": "mesh", "vertices": corners, "faces": [[0, 1, 2]], "material": "red"}
    without = layers(device, scene([mesh]), ("uv", "tangent"))
    assert same(without["uv"], 0.0) and same(without["tangent"], 0.0)
    uvs = [[3.0, 1.0], [3.0, 5.0], [-1.0, 1.0]]  # u grows downwards
    found = layers(device, scene([{**mesh, "uvs": uvs}]), ("uv", "tangent", "position"))
    x, y = found["position"][..., 0], found["position"][..., 1]
    top = (y + 99.0) / 299.0
    expected = np.stack([3.0 - 4.0 * top, 1.0 + 4.0 * (x + 99.0 - 99.0 * top) / 198.0], axis=2)
    assert np.abs(found["uv"] - expected).max() < 1e-4
    assert (found["tangent"][..., 1] < -0.8).all()


def test_shapes_without_a_material_are_of_none(device: Device) -> None:
    found = layers(device, scene([wall(-2.0)]), ("object", "material"))
    assert same(found["object"], 0.0) and same(found["material"], -1.0)


@pytest.mark.long
def test_a_material_in_several_media_is_one(device: Device) -> None:
    what = scene([wall(-9.0, material="red"), wall(-8.0, material="red")]).model_dump(exclude_unset=True)
    what["media"] = {"smoke": {"scattering": [0.1, 0.1, 0.1]}}
    ball = {"type": "sphere", "center": [0, 0, -4.0], "radius": 3.0, "material": "glass", "interior": "smoke"}
    what["shapes"] = [*what["shapes"], ball]
    found = layers(device, Scene.model_validate(what), ("material",))["material"]
    assert set(np.unique(found)) == {0.0, 3.0}


# --- the same bits ---------------------------------------------------------------------------------------------------


ONE: tuple[int, int, int | None] = (1, 64, None)
CUTS = {"room": (ONE, (4, 16, 1), (8, 64, 5), (16, 16, 3)), "bumpy": ((1, 16, 3),)}


@pytest.mark.long
@pytest.mark.parametrize("name", CUTS)
def test_the_same_bits_however_the_work_is_cut(device: Device, name: str) -> None:
    what = clrender.load(name).changed(camera__flow_step=1.0)
    expected = layers(device, what, spp=6)
    for lanes, tile, passes in CUTS[name]:
        found = layers(device, what, lanes=lanes, samples_per_pass=passes, spp=6, tile=tile)
        for layer, array in expected.items():
            assert array.tobytes() == found[layer].tobytes(), f"{layer} in {lanes} lanes and tiles of {tile}"


# --- as a user asks for them -----------------------------------------------------------------------------------------


def test_depth_along_the_view_and_normals_of_the_camera(device: Device) -> None:
    """From the layers of the world, by the camera's axes; of calibrated and orthographic cameras too."""
    room = clrender.load("room")
    here = {key: getattr(room.camera, key) for key in ("position", "target", "up")}
    lens = {"type": "intrinsics", "fx": 20.0, "resolution": (WIDTH, HEIGHT)}
    barrel = {**lens, "distortion": {"model": "brown-conrady", "k": [-0.1]}}
    for more in ({}, lens, barrel, {"type": "orthographic", "height": 1.0}, {"mirrored": True}):
        what = room.changed(camera={**here, **more})
        found = layers(device, what, ("z_depth", "normal_camera", "position", "normal", "depth"), spp=4)
        right, up, forward = (np.array(axis) for axis in what.camera.axes)
        away = found["position"].astype(np.float64) - what.camera.position
        np.testing.assert_allclose(found["z_depth"][..., 0], away @ forward, rtol=0.0, atol=3e-6)
        axes = np.stack([right, up, -forward], axis=1)
        np.testing.assert_allclose(found["normal_camera"], found["normal"] @ axes, rtol=0.0, atol=1e-6)
        assert (found["z_depth"] <= found["depth"] + 1e-6).all()
    nothing = layers(device, scene([]), ("z_depth", "normal_camera"))
    assert np.isposinf(nothing["z_depth"]).all() and (nothing["normal_camera"] == 0.0).all()


def test_layers_of_a_render_and_in_a_file(device: Device, tmp_path: Path) -> None:
    import OpenEXR

    what = clrender.load("room").changed(camera__flow_step=1.0)
    errors: dict[str, Any] = {"size": (WIDTH, HEIGHT), "spp": 32, "replicate_spp": 2, "error": 1e-6}
    plain = clrender.render(what, **errors)
    asked = [name for name in AOVS if name not in OF_RENDERS]
    image = clrender.render(what, **errors, aov=asked)
    assert plain.aovs == {} and list(image.aovs) == asked
    assert image.stats["image_sha256"] == plain.stats["image_sha256"] and not image.stats["denoised"]
    assert same(image.aovs["samples"], 32.0)
    # What is written is not copied
    assert all(layer[..., i].flags.c_contiguous for layer in image.aovs.values() for i in range(layer.shape[2]))
    image.save(tmp_path / "a.exr")
    image.save(tmp_path / "a.png")
    assert (read_image(tmp_path / "a.exr") == image.linear).all()
    with OpenEXR.File(str(tmp_path / "a.exr"), separate_channels=True) as file:
        held = {name: channel.pixels for name, channel in file.channels().items()}
    assert set(held) == {"R", "G", "B", *exr_channels(image.aovs)}
    assert (held["normal.Y"] == image.aovs["normal"][..., 1]).all() and (
        held["depth.Z"] == image.aovs["depth"][..., 0]
    ).all()


def test_a_layer_that_is_unknown() -> None:
    with pytest.raises(UsageError, match=r"no layer 'albdo'; did you mean .albedo"):
        clrender.render(clrender.load("room"), aov=["albdo"])
