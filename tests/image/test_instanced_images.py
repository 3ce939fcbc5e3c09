"""Images with instances: those of the same scene with all written out, by every integrator, of every material."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt
import pytest
from gltf_files import Model
from PIL import Image

import clrender
from clrender.bench.shapes import geodesic
from clrender.device import Device
from clrender.flatten.assembly import written_out
from clrender.flatten.flat_scene import flatten
from clrender.scene import MeshData, Scene

_CAMERA: Final = {"position": [0.3, 1.5, 5.0], "target": [0.0, 0.6, 0.0], "vertical_fov": 40.0}
_LIGHTS: Final = ({"type": "environment", "radiance": [0.6, 0.7, 0.9]},)
_FLOOR: Final = {
    "type": "quad", "origin": [-5, 0, 5], "edge_u": [10, 0, 0], "edge_v": [0, 0, -10], "material": "floor",
}  # fmt: skip
_PLACES: Final = (
    [[0.8, 0.0, 0.3, -1.2], [0.0, 0.9, 0.0, 0.6], [-0.3, 0.0, 0.8, 0.0], [0.0, 0.0, 0.0, 1.0]],
    [[-0.7, 0.0, 0.0, 0.2], [0.0, 0.7, 0.0, 0.7], [0.0, 0.0, 0.7, 0.8], [0.0, 0.0, 0.0, 1.0]],
    [[0.6, 0.2, 0.0, 1.4], [0.0, 0.8, 0.1, 0.8], [0.0, 0.0, -0.6, -0.3], [0.0, 0.0, 0.0, 1.0]],
)
"""The second and the third mirror; the third shears."""
_SIMILAR: Final = ({"translate": [-1.2, 0.5, 0.0]}, {"translate": [1.0, 0.6, 0.3], "scale": -1.1})
_MATERIALS: Final[dict[str, Any]] = {
    "floor": {"type": "lambert", "reflectance": [0.5, 0.5, 0.5]},
    "lambert": {"type": "lambert", "reflectance": [0.7, 0.3, 0.2]},
    "metal": {"type": "conductor", "metal": "Cu", "roughness": 0.3, "anisotropy": 0.7},
    "glass": {"type": "dielectric", "ior": 1.5, "attenuation_color": [0.9, 0.5, 0.4], "attenuation_distance": 0.5},
    "wax": {"type": "subsurface", "albedo": [0.8, 0.6, 0.4], "radius": [0.2, 0.1, 0.05]},
    "holes": {"type": "lambert", "reflectance": [0.3, 0.6, 0.2], "opacity": {"texture": "holes.png", "channel": "a"}},
    "picture": {"type": "lambert", "reflectance": {"texture": "holes.png"}},
    "bumps": {"type": "lambert", "reflectance": [0.6, 0.6, 0.6], "normal_map": {"texture": "bumps.png"}},
    "faint": {"type": "lambert", "reflectance": [0.5, 0.5, 0.5], "opacity": 0.5},
}


def ball(**more: Any) -> dict[str, Any]:
    return {"type": "mesh", "file": "ball", **more}


def body(tangents: bool) -> MeshData:
    points, faces = geodesic(6)
    around = np.arctan2(points[:, 2], points[:, 0]) / (2.0 * np.pi)
    uvs = np.stack([4.0 * around, 2.0 * points[:, 1]], axis=1).astype(np.float32)[faces]
    directions = None
    if tangents:
        along = np.cross(points, [0.3, 1.0, 0.2])
        along /= np.sqrt((along * along).sum(axis=1))[:, None]
        directions = np.concatenate([along, np.where(points[:, :1] > 0.0, 1.0, -1.0)], axis=1).astype(np.float32)[faces]
        directions[:, :, 3] = directions[:, :1, 3]
    return MeshData(points * 0.6, faces.astype(np.uint32), points, "", uvs, tangents=directions)


@pytest.fixture(scope="module")
def pictures(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("pictures")
    random = np.random.default_rng(2)
    rgba = random.integers(60, 255, (16, 16, 4), np.uint8)
    rgba[:, :, 3] = 255 * (np.add.outer(np.arange(16) // 4, np.arange(16) // 4) % 2)
    Image.fromarray(rgba).save(folder / "holes.png")
    bumps = np.full((16, 16, 3), (128, 128, 255), np.uint8)
    bumps[::4, :, 0], bumps[:, ::4, 1] = 200, 90
    Image.fromarray(bumps).save(folder / "bumps.png")
    return folder


def scene(folder: Path, *shapes: dict[str, Any], similar: bool = False, tangents: bool = False, **more: Any) -> Scene:
    instance = {"type": "instance", "group": "one"}
    places = [{"transform": each} for each in _SIMILAR] if similar else [{"transforms": list(_PLACES)}]
    used = {name: _MATERIALS[name] for name in {"floor", *(shape.get("material", "floor") for shape in shapes)}}
    made = Scene.model_validate(
        {
            "camera": _CAMERA, "lights": _LIGHTS, "materials": used, "groups": {"one": {"shapes": list(shapes)}},
            "shapes": [_FLOOR, *({**instance, **each} for each in places)], **more,
        }
    )  # fmt: skip
    return made.placed("scene", folder).with_files(meshes={("ball", None): body(tangents)})


def render(what: Scene, device: Device, **settings: Any) -> npt.NDArray[np.float32]:
    settings = {"size": (48, 40), "spp": 32, **settings}
    return clrender.render(what, device=device.info.index, **settings).linear


def agree(what: Scene, device: Device, **settings: Any) -> None:
    """The same random numbers meet the same surfaces, but for a few that rounding moves past an edge."""
    one, other = render(what, device, **settings), render(written_out(what), device, **settings)
    assert abs(one.mean() / other.mean() - 1.0) < 2e-3
    apart = np.abs(one - other).max(axis=2) / other.mean()
    assert np.mean(apart < 1e-3) > 0.9, np.mean(apart < 1e-3)
    assert np.mean(apart) < 5e-3, np.mean(apart)


@pytest.mark.long
@pytest.mark.parametrize(
    "material", ["lambert", "glass", "picture", "bumps", pytest.param("wax", marks=pytest.mark.slow)]
)
def test_meshes_of_every_material(device: Device, pictures: Path, material: str) -> None:
    agree(scene(pictures, ball(material=material)), device)


@pytest.mark.long
@pytest.mark.parametrize("material", [pytest.param("metal", marks=pytest.mark.slow), "bumps"])
def test_given_tangents(device: Device, pictures: Path, material: str) -> None:
    agree(scene(pictures, ball(material=material), tangents=True), device)


@pytest.mark.long
@pytest.mark.parametrize(
    ("material", "kind"),
    [
        ("holes", "ball"),
        pytest.param("holes", "round", marks=pytest.mark.slow),
        pytest.param("faint", "ball", marks=pytest.mark.slow),
        pytest.param("faint", "round", marks=pytest.mark.slow),
    ],
)
def test_opacity(device: Device, pictures: Path, material: str, kind: str) -> None:
    """Which surfaces are there is drawn by the primitives' numbers, which are others: only means are the same."""
    shapes = {
        "ball": [ball(material=material)],
        "round": [{"type": "sphere", "radius": 0.6, "material": material}, ball(material="lambert")],
    }[kind]
    what = scene(pictures, *shapes, similar=kind == "round")
    one, other = (render(each, device, size=(24, 20), spp=1024) for each in (what, written_out(what)))
    assert abs(one.mean() / other.mean() - 1.0) < 2e-3
    blocks = [image.reshape(5, 4, 6, 4, 3).mean(axis=(1, 3)) for image in (one, other)]
    assert np.abs(blocks[0] / blocks[1] - 1.0).max() < 0.03


@pytest.mark.long
@pytest.mark.parametrize("material", ["lambert", "glass", "picture", "bumps"])
def test_spheres_disks_and_boxes(device: Device, pictures: Path, material: str) -> None:
    shapes = (
        {"type": "sphere", "radius": 0.4, "material": material},
        {"type": "disk", "center": [0.0, 0.7, 0.1], "normal": [0.3, 1.0, 0.4], "radius": 0.4, "material": "lambert"},
        {"type": "box", "center": [0.7, 0.0, 0.0], "size": [0.3, 0.5, 0.4], "material": "lambert"},
    )
    agree(scene(pictures, *shapes, similar=True), device)


@pytest.mark.long
def test_lights_of_instances(device: Device, pictures: Path) -> None:
    lamp = {"type": "sphere", "center": [0.0, 0.9, 0.0], "radius": 0.15, "emission": [8.0, 6.0, 4.0]}
    agree(scene(pictures, ball(material="lambert"), lamp, similar=True, lights=()), device)


@pytest.mark.long
def test_fog_and_filled_instances(device: Device, pictures: Path) -> None:
    media = {"milk": {"scattering": [4.0, 4.0, 4.0]}, "mist": {"scattering": [0.05, 0.05, 0.05]}}
    lights = ({"type": "point", "position": [1.0, 4.0, 2.0], "intensity": [30.0, 30.0, 30.0]},)
    what = scene(pictures, ball(interior="milk"), media=media, fog="mist", lights=lights)
    agree(what, device, spp=64, max_depth=100)  # in fog that absorbs nothing, some paths have 30,000 events


@pytest.mark.long
@pytest.mark.parametrize("integrator", ["bdpt", "direct", "whitted", "reuse", "photon", "radiosity"])
def test_every_integrator(device: Device, pictures: Path, integrator: str) -> None:
    shapes = ({"type": "box", "size": [0.7, 0.9, 0.5], "material": "lambert"},)
    lamp = {
        "type": "quad",
        "origin": [-1, 4, -1],
        "edge_u": [2, 0, 0],
        "edge_v": [0, 0, 2],
        "emission": [6.0, 6.0, 5.0],
    }
    what = scene(pictures, *shapes, similar=True, lights=())
    what = what.model_copy(
        update={"shapes": (*what.shapes, *Scene.model_validate({"camera": _CAMERA, "shapes": [lamp]}).shapes)}
    )
    more = {"photons": 4000} if integrator == "photon" else {"patches": 200} if integrator == "radiosity" else {}
    agree(what, device, integrator=integrator, **more)


@pytest.mark.long
def test_many_small_groups(device: Device, pictures: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """They are written out, and the image is that of the trees that they would have."""
    shapes: list[dict[str, Any]] = [_FLOOR]
    groups = {}
    for number in range(66):
        x, z = number % 11 * 0.4 - 2.0, number // 11 * 0.6 - 2.0
        groups[f"{number}"] = {"shapes": [ball(material="lambert", transform={"scale": 0.2 + 0.002 * number})]}
        shapes += [
            {"type": "instance", "group": f"{number}", "transform": {"translate": [x, y, z]}} for y in (0.3, 0.9)
        ]
    more: dict[str, Any] = {"shapes": shapes, "groups": groups}
    what = scene(pictures, ball(material="lambert"), **more)
    assert flatten(what, 8, 8).instances.count == 0
    written = render(what, device)
    monkeypatch.setattr("clrender.flatten.placed_shapes._MANY", 66)
    assert flatten(what, 8, 8).instances.count == 132
    one = render(scene(pictures, ball(material="lambert"), **more), device)
    assert abs(one.mean() / written.mean() - 1.0) < 2e-3
    assert np.mean(np.abs(one - written).max(axis=2) / written.mean() < 1e-3) > 0.9


@pytest.mark.long
def test_layers_tell_instances_apart(device: Device, pictures: Path) -> None:
    what = scene(
        pictures,
        ball(material="lambert"),
        {"type": "sphere", "center": [0, 0.8, 0], "radius": 0.2, "material": "glass"},
        similar=True,
    )
    names = ("object", "material", "normal", "position", "depth", "uv", "tangent", "crypto_object")
    one = clrender.render(what, device=device.info.index, size=(64, 48), spp=8, aov=names)
    other = clrender.render(written_out(what), device=device.info.index, size=(64, 48), spp=8, aov=names)
    assert set(np.unique(one.aovs["object"])) == {-1.0, 0.0, 1.0, 2.0}
    # Written out, each shape of the first instance is 1 or 2, of the second 3 or 4
    told = np.array([-1.0, 0.0, 1.0, 1.0, 2.0, 2.0])[other.aovs["object"].astype(int) + 1]
    assert np.mean(one.aovs["object"] == told) > 0.998
    assert np.mean(one.aovs["material"] == other.aovs["material"]) > 0.998
    for name, most in (("normal", 1e-3), ("position", 1e-3), ("depth", 1e-3), ("uv", 1e-3), ("tangent", 5e-3)):
        a, b = one.aovs[name], other.aovs[name]
        same = np.isclose(a, b, atol=most, equal_nan=True) | (np.isinf(a) & np.isinf(b))
        assert same.mean() > 0.98, (name, same.mean())
    covered = one.aovs["crypto_object"]
    assert np.unique(covered[..., 0].view(np.uint32)).size == 4, "nothing, the floor, and each instance"


@pytest.mark.slow
@pytest.mark.parametrize("thoroughly", [False, True])
def test_one_hash_on_every_device_and_cut(all_devices: list[Device], pictures: Path, thoroughly: bool) -> None:
    """Rusticl takes two minutes to compile what a plain scene needs, and more for `avenue` with holes and glass."""
    plain = scene(pictures, ball(material="lambert"), {"type": "box", "size": [0.9, 0.2, 0.9], "material": "lambert"})
    for what, slow in ((plain, True), (clrender.load("avenue"), False)):
        hashes = set()
        for each in all_devices:
            one_lane = "rusticl" in each.info.platform.lower()
            if one_lane and not (slow and thoroughly):
                continue
            more: list[dict[str, Any]] = [{"lanes": 8}, {"traversal": "single"}] if thoroughly else []
            cuts: list[dict[str, Any]] = [{}] if one_lane else [{}, {"lanes": 1}, *more]
            hashes |= {render(what, each, size=(40, 30), spp=4, **cut).tobytes() for cut in cuts}
        assert len(hashes) == 1


@pytest.mark.long
def test_instances_of_a_gltf_node(device: Device, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """As a group, and as a shape for each."""
    random, model = np.random.default_rng(3), Model()
    model.extend("EXT_mesh_gpu_instancing", required=True)
    attributes = {
        "TRANSLATION": model.accessor(random.uniform(-3.0, 3.0, (60, 3))),
        "ROTATION": model.accessor(random.normal(size=(60, 4))),
        "SCALE": model.accessor(random.uniform(0.3, 1.0, (60, 3))),
    }
    model.node(mesh=model.quad(), extensions={"EXT_mesh_gpu_instancing": {"attributes": attributes}})
    shapes = clrender.load(model.write(tmp_path / "m.glb"))
    monkeypatch.setattr("clrender.importers.instancing._WORTH", 1)
    group = clrender.load(tmp_path / "m.glb")
    assert (len(shapes.shapes), len(group.shapes)) == (60, 1)
    one, other = render(group, device), render(shapes, device)
    assert abs(one.mean() / other.mean() - 1.0) < 2e-3
    assert np.mean(np.abs(one - other).max(axis=2) / other.mean() < 1e-3) > 0.9
