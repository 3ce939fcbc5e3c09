"""The exporter to Mitsuba: its files are read again as the scene that went in, and it names what they lack."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest
from cases import for_each
from export_support import BALL, CAMERA, GREY, MIRRORED_MAPS, QUAD, described, near, texels
from numpy.typing import NDArray
from PIL import Image

import clrender
from clrender.cli import main
from clrender.errors import SceneError, UsageError
from clrender.exporters import exported_to_mitsuba, write_cycles, write_luxcore, write_mitsuba
from clrender.exporters.mesh_ply import write_ply
from clrender.exporters.triangles import world_mesh
from clrender.flatten.assembly import written_out
from clrender.flatten.flat_scene import flatten
from clrender.flatten.sky import scene_sun
from clrender.image.files import read_image, write_image
from clrender.image.pixel_filter import PIXEL_FILTERS
from clrender.meshes.data import MeshData
from clrender.meshes.read import read_mesh
from clrender.scene import Scene
from clrender.scene.groups import TransformArray
from clrender.scene.spectra import SpectralColor
from clrender.spectra.lifting import unbounded_spectra

RNG = np.random.default_rng(3)
SAME: tuple[str, ...] = (
    "bumpy",
    "caustic",
    "cornell",
    "directional-plane",
    "furnace-glass",
    "furnace-room",
    "furnace-sphere",
    "furnace",
)
SAME += ("haze", "inside-sphere", "mirror-light", "point-plane", "quad-plane", "room-diffuse", "room-glass")
SAME += ("room-mirror", "room-report", "room", "sky", "slab", "sphere-plane")
"""Scenes without anything that Mitsuba lacks."""


def written(scene: Scene, folder: Path, **options: Any) -> tuple[Any, tuple[str, ...]]:
    """The scene, exported and read again, and what is left out."""
    notes = write_mitsuba(scene.placed("test", folder), folder / "out.xml", **options)
    return clrender.load(folder / "out.xml"), notes


def xml(folder: Path) -> Any:
    return ElementTree.parse(folder / "out.xml").getroot()


def of_shapes(arrays: Any, field: str) -> NDArray[Any]:
    """A field of the material of each shape."""
    return np.asarray(arrays["materials"][field][arrays["shapes"]["material"]])


@pytest.mark.long
@for_each("name", SAME)
def test_built_in_scenes(tmp_path: Path, name: str) -> None:
    scene = clrender.load(name)
    assert write_mitsuba(scene, tmp_path / "out.xml", strict=True) == ()
    again = clrender.load(tmp_path / "out.xml")
    assert again.image == scene.image and again.render.model_dump() == scene.render.model_dump()
    one, other = flatten(scene, 8, 8).arrays, flatten(again, 8, 8).arrays
    for key in ("triangles", "primitive_shape"):
        assert np.array_equal(other[key], one[key]), key
    for key in ("vertices", "normals", "media_rows"):
        assert near(other[key], one[key], 1e-4), key
    for key in ("lights", "analytic_shapes"):
        for field in one[key].dtype.names or ():
            assert near(other[key][field], one[key][field], 1e-4), (key, field)
    for field in ("kind", "color", "ior"):
        assert near(of_shapes(other, field), of_shapes(one, field)), field


# --- textures


def texture_scene(texture: Any, key: str = "reflectance", **more: Any) -> Any:
    return described(materials={"m": {**GREY, key: texture, **more}}, shapes=[{**QUAD, "material": "m"}])


@pytest.fixture
def pictures(tmp_path: Path) -> Path:
    Image.fromarray(RNG.integers(0, 255, (4, 6, 4), np.uint8)).save(tmp_path / "a.png")
    Image.fromarray(RNG.integers(0, 255, (4, 6), np.uint8)).save(tmp_path / "grey.png")
    Image.fromarray(RNG.integers(0, 255, (4, 6, 3), np.uint8)).save(tmp_path / "a.webp", lossless=True)
    write_image(tmp_path / "a.exr", RNG.random((4, 6, 3)).astype(np.float32))
    write_image(tmp_path / "a.hdr", RNG.random((4, 6, 3)).astype(np.float32))
    return tmp_path


@for_each(
    "texture",
    [
        {"texture": "a.png"},
        {"texture": "a.png", "color_space": "linear", "wrap": "mirror", "filter": "nearest"},
        {"texture": "a.png", "wrap": "clamp", "transform": {"scale": [2.0, -3.0], "offset": [0.1, 0.2]}},
        {"texture": "a.exr", "transform": {"rotate_degrees": 30.0, "scale": 0.5, "offset": [0.3, -0.4]}},
        {"checker": [0.2, [0.1, 0.3, 0.9]], "transform": {"scale": [3.0, 2.0], "offset": [0.25, 0.5]}},
    ],
)
def test_textures_that_stay(pictures: Path, texture: Any) -> None:
    scene = texture_scene(texture)
    again, notes = written(scene, pictures)
    one, other = scene.materials["m"].reflectance, again.materials["m"].reflectance
    assert notes == () and type(other) is type(one)
    for key in ("offset", "scale", "rotate_degrees"):
        assert near(getattr(other.transform, key), getattr(one.transform, key)), key
    if "texture" in texture:
        assert (other.wrap, other.filter) == (one.wrap, one.filter)
        assert (pictures / other.texture).read_bytes() == (pictures / one.texture).read_bytes()
        assert (other.color_space or "linear") == (one.color_space or ("srgb" if "png" in one.texture else "linear"))
    else:
        assert near(other.checker, one.checker)


def test_sizes_of_checkers_are_part_of_the_transform(pictures: Path) -> None:
    again, _ = written(texture_scene({"checker": [0.2, 0.7], "size": [0.25, 1.0]}), pictures)
    assert near(again.materials["m"].reflectance.transform.scale, [2.0, 0.5])


def values(folder: Path, texture: Any) -> NDArray[np.float32]:
    """Linear values of the one picture of a scene that was exported."""
    return read_image(folder / texture.texture)


@for_each(
    "texture",
    [
        {"texture": "a.png", "color_space": "linear", "scale": [0.5, 0.25, 1.0]},
        {"texture": "a.webp", "color_space": "linear"},
        {"texture": "a.hdr"},
    ],
)
def test_textures_that_are_computed_anew(pictures: Path, texture: dict[str, Any]) -> None:
    again, _ = written(texture_scene(texture), pictures)
    other = again.materials["m"].reflectance
    found = values(pictures, other)
    if texture["texture"].endswith(".hdr"):
        expected: Any = read_image(pictures / "a.hdr")
    else:
        expected = np.asarray(Image.open(pictures / texture["texture"]).convert("RGBA"))[..., :3] / 255.0
    assert near(found, expected * np.array(texture.get("scale", 1.0)))
    assert other.texture.endswith(".exr") and other.color_space in (None, "linear")


def test_numbers_are_one_channel(pictures: Path) -> None:
    metal = {
        "type": "principled",
        "metallic": {"texture": "a.png", "channel": "b"},
        "roughness": {"texture": "grey.png"},
    }
    scene = described(materials={"m": metal}, shapes=[{**QUAD, "material": "m"}])
    again, _ = written(scene, pictures)
    other = again.materials["m"]
    blue = np.asarray(Image.open(pictures / other.metallic.texture))
    assert np.array_equal(blue, np.asarray(Image.open(pictures / "a.png"))[..., 2])
    assert (pictures / other.roughness.texture).read_bytes() == (pictures / "grey.png").read_bytes()
    assert other.metallic.color_space == other.roughness.color_space == "linear"


def test_ramps_end_at_the_edges(pictures: Path) -> None:
    again, _ = written(texture_scene({"ramp": [0.1, 0.5, 0.9]}), pictures)
    other = again.materials["m"].reflectance
    assert near(values(pictures, other)[0], [[0.1] * 3, [0.5] * 3, [0.9] * 3]) and other.wrap == ("clamp", "clamp")
    # u = 0 and u = 1 are the centres of the first and the last of three texels
    assert near(other.transform.scale[0], 2.0 / 3.0) and near(other.transform.offset[0], 1.0 / 6.0)


def test_maps(pictures: Path) -> None:
    maps = {"normal_map": {"texture": "a.exr", "scale": 2.0}}
    heights = {"bump_map": {"texture": "grey.png", "scale": 0.02}}
    scene = described(
        materials={"m": {**GREY, **maps}, "h": {**GREY, **heights}},
        shapes=[{**QUAD, "material": "m"}, {**QUAD, "material": "h"}],
    )
    again, notes = written(scene, pictures)
    assert notes == ()
    expected = read_image(pictures / "a.exr")
    expected[..., :2] = (expected[..., :2] - 0.5) * 2.0 + 0.5
    assert near(values(pictures, again.materials["m"].normal_map), expected)
    other = again.materials["h"]
    assert other.bump_map.scale == 0.02 and other.bump_map.texture.endswith(".png")
    _, notes = written(described(materials={"m": {**GREY, **maps, **heights}}, shapes=scene.shapes[:1]), pictures)
    assert len(notes) == 1 and "the bump map beside a normal map" in notes[0]
    glass = {"type": "dielectric", "ior": 1.5, **heights}
    _, notes = written(described(materials={"m": glass}, shapes=[{**BALL, "material": "m"}]), pictures)
    assert len(notes) == 1 and "some light that passes glass" in notes[0]


def relief(folder: Path) -> list[tuple[Any, ...]]:
    """Texels of the normal maps and factors of the bump maps of each BSDF, the front before the back."""
    found = []
    for bsdf in xml(folder).findall("bsdf"):
        maps = bsdf.iterfind(".//texture[@name='normalmap']/string[@name='filename']")
        scales = bsdf.iterfind(".//bsdf[@type='bumpmap']/float[@name='scale']")
        pixels = [texels(folder / each.get("value")) for each in maps]
        found.append((*pixels, *(float(each.get("value")) for each in scales)))
    return found


@for_each(("shape", "turned"), MIRRORED_MAPS)
def test_green_of_normal_maps_is_where_mitsuba_looks_for_it(
    pictures: Path, shape: dict[str, Any], turned: bool
) -> None:
    pixels = texels(pictures / "a.png")
    wide = {"texture": "a.png", "scale": 2.0}
    for given, factor in (({"texture": "a.png"}, 1.0), (wide, 2.0)):
        scene = described(materials={"m": {**GREY, "normal_map": given}}, shapes=[{**shape, "material": "m"}])
        _, notes = written(scene, pictures)
        ((front, back),) = relief(pictures)
        assert notes == ()
        signs = factor * np.array([1.0, -1.0 if turned else 1.0])
        expected = np.array(pixels)
        expected[..., :2] = (pixels[..., :2] - 0.5) * signs + 0.5
        assert near(front, expected)
        # Behind, the same surface; Mitsuba mirrors the front
        expected[..., :2] = 1.0 - expected[..., :2]
        assert near(back, expected)


@for_each(
    ("transform", "red", "green"),
    [({"rotate_degrees": 90.0}, 2, -1), ({"scale": [-2.0, 3.0]}, -1, 2), ({"scale": [2.0, -3.0]}, 1, -2)],
)
def test_slopes_of_normal_maps_turn_with_the_picture(
    pictures: Path, transform: dict[str, Any], red: int, green: int
) -> None:
    """The channel, counted from 1, that red and green become; below 0 inverted."""
    given = {"texture": "a.png", "transform": transform}
    written(described(materials={"m": {**GREY, "normal_map": given}}, shapes=[{**QUAD, "material": "m"}]), pictures)
    ((front, _),) = relief(pictures)
    pixels = texels(pictures / "a.png")
    for made, channel in ((0, red), (1, green)):
        plain = pixels[..., abs(channel) - 1]
        assert near(front[..., made], plain if channel > 0 else 1.0 - plain)


def test_bump_maps_from_behind(pictures: Path) -> None:
    heights = {**GREY, "bump_map": {"texture": "grey.png", "scale": 0.5}}
    _, notes = written(described(materials={"m": heights}, shapes=[{**QUAD, "material": "m"}]), pictures)
    assert relief(pictures) == [(0.5, -0.5)] and notes == ()


def test_green_of_normal_maps_in_mirrored_instances(pictures: Path) -> None:
    maps = {"normal_map": {"texture": "a.png"}, "two_sided": False}
    scene = described(
        materials={"m": {**GREY, **maps}},
        groups={"g": {"shapes": [{**QUAD, "material": "m"}]}},
        shapes=[{"type": "instance", "group": "g", "transform": {"scale": [sign, 1.0, 1.0]}} for sign in (1.0, -1.0)],
    )
    _, notes = written(scene, pictures)
    (one,), (other,) = relief(pictures)
    assert near(other[..., 1], 1.0 - one[..., 1]) and near(other[..., 0], one[..., 0]) and notes == ()
    assert [each.get("type") for each in xml(pictures).findall("shape")] == ["shapegroup", "instance"] * 2


def test_normal_maps_where_some_texture_coordinates_are_mirrored(pictures: Path) -> None:
    points, faces = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [2, 0, 0]], [[0, 1, 2], [0, 2, 3], [1, 4, 2]]
    uvs = [[0, 0], [1, 0], [1, 1], [0, 1], [0, 0]]
    mesh = {"type": "mesh", "vertices": points, "faces": faces, "uvs": uvs, "material": "m"}
    scene = described(materials={"m": {**GREY, "normal_map": {"texture": "a.png"}}}, shapes=[mesh])
    _, notes = written(scene, pictures)
    assert len(notes) == 1 and "a part of the texture coordinates is mirrored" in notes[0] and "shapes[0]" in notes[0]


@for_each("more", [{"flip_normals": True}, {"transform": {"scale": [-1.0, 1.0, 1.0]}}])
def test_textures_of_merged_shapes_stay(pictures: Path, more: dict[str, Any]) -> None:
    scene = described(
        materials={"m": {**GREY, "reflectance": {"texture": "a.png"}}}, shapes=[{**QUAD, "material": "m", **more}]
    )
    again, _ = written(scene, pictures, merge=True)
    mesh = again.mesh(0)
    of_corners = {
        tuple(np.round(point, 5)): tuple(uv) for point, uv in zip(corners(mesh), mesh.uvs.reshape(-1, 2), strict=True)
    }
    whole = world_mesh(scene, ("shapes", 0), scene.shapes[0])
    assert whole.uvs is not None
    for point, uv in zip(corners(whole), whole.uvs.reshape(-1, 2), strict=True):
        assert of_corners[tuple(np.round(point, 5))] == tuple(uv)


def corners(mesh: MeshData) -> NDArray[np.floating]:
    return mesh.vertices[mesh.triangles].reshape(-1, 3)


def test_vertices_are_split_where_textures_are_cut(pictures: Path) -> None:
    uvs = np.array([[[0, 0], [1, 0], [1, 1]], [[0.5, 0.5], [1, 1], [0, 1]]], np.float32)
    mesh = {"type": "mesh", "file": "cut.ply", "material": "m"}
    points, faces = (
        np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]),
        np.array([[0, 1, 2], [0, 2, 3]], np.uint32),
    )

    with (pictures / "cut.ply").open("wb") as file:
        write_ply(file, MeshData(points, faces, uvs=uvs))
    again, _ = written(
        described(materials={"m": {**GREY, "reflectance": {"texture": "a.png"}}}, shapes=[mesh]), pictures
    )
    found = again.mesh(0)
    assert np.array_equal(found.uvs, uvs) and len(found.vertices) == 5
    assert np.array_equal(found.vertices[found.triangles], points[faces])


# --- materials


@for_each(
    "material",
    [
        {"type": "lambert", "reflectance": [0.1, 0.2, 0.3], "two_sided": False},
        {"type": "mirror", "reflectance": [0.7, 0.8, 0.9]},
        {"type": "conductor", "metal": "Au", "roughness": 0.0},
        {"type": "conductor", "metal": "Cu", "roughness": 0.3, "multiple_scattering": False, "microfacets": "beckmann"},
        {"type": "dielectric", "ior": 1.7, "exterior_ior": 1.2},
        {"type": "dielectric", "ior": 1.5, "roughness": 0.4, "multiple_scattering": False},
        {"type": "dielectric", "ior": 1.5, "thin": True},
        {"type": "principled", "base_color": [0.2, 0.4, 0.1], "roughness": 0.0, "specular_color": [0.5, 0.6, 0.7]},
        {"type": "principled", "base_color": [0.2, 0.4, 0.1], "roughness": 0.4, "ior": 1.4, "metallic": 0.3}
        | {"multiple": True},
        {"type": "lambert", "reflectance": [0.1, 0.2, 0.3], "opacity": 0.25},
    ],
)
def test_materials_that_stay(tmp_path: Path, material: dict[str, Any]) -> None:
    material = {**material}
    multiple = material.pop("multiple", False)  # of which its reflections are then left out
    scene = described(materials={"a.b $x": material}, shapes=[{**BALL, "material": "a.b $x"}])
    again, notes = written(scene, tmp_path)
    assert notes == () or multiple
    one, other = scene.materials["a.b $x"], again.materials["ab x"]
    if "metal" in material:
        assert near(one.index, other.index)
        skipped = {"metal", "eta", "k"}
    else:
        skipped = set()
    # What has no facets is not of a kind of them
    skipped |= set() if material.get("roughness") else {"multiple_scattering", "microfacets"}
    for key, expected in one.model_dump(exclude=skipped).items():
        found = getattr(other, key)
        assert near(found, expected) if isinstance(expected, float | tuple) else found == expected, key


@for_each(
    ("material", "words"),
    [
        ({"type": "oren_nayar", "reflectance": [0.5, 0.5, 0.5]}, "the roughness of oren_nayar"),
        ({"type": "conductor", "metal": "Au", "roughness": 0.3}, "multiple scattering"),
        ({"type": "conductor", "metal": "Au", "roughness": 0.0, "iridescence": 1.0}, "thin films"),
        ({"type": "dielectric", "ior": 1.5, "roughness": 0.3, "thin": True}, "the roughness of thin glass"),
        ({"type": "subsurface", "albedo": 0.8, "radius": 0.1}, "the inside of subsurface"),
        ({"type": "principled", "diffuse_transmission": 0.5}, "the gloss of sheets"),
        ({"type": "principled", "diffuse_roughness": 0.5}, "the roughness of the diffuse part"),
        ({"type": "principled", "roughness": 0.4}, "the balance of principled"),
        ({"type": "principled", "coat": 1.0}, "the strength of clear coats"),
        ({"type": "principled", "microfacets": "beckmann"}, "the Beckmann microfacets of principled"),
        ({"type": "principled", "sheen_color": [0.5, 0.5, 0.5]}, "the roughness of sheen"),
        ({"type": "principled", "metallic": 0.5, "specular_color": [1.0, 0.5, 0.5]}, "colour of the dielectric"),
    ],
)
def test_what_materials_lose(tmp_path: Path, material: dict[str, Any], words: str) -> None:
    scene = described(materials={"x": material}, shapes=[{**BALL, "material": "x"}])
    _, notes = written(scene, tmp_path)
    assert any(note.startswith("left out: ") and words in note and "(materials.x" in note for note in notes), notes
    with pytest.raises(SceneError, match=words):
        write_mitsuba(scene, tmp_path / "strict.xml", strict=True)
    assert not (tmp_path / "strict.xml").exists()


@for_each("more", [{}, {"thin": True}, {"thin": True, "transmission": 0.5, "roughness": 0.2}])
def test_sheets_with_diffuse_transmission_are_thin(tmp_path: Path, more: dict[str, Any]) -> None:
    sheet = {"type": "principled", "diffuse_transmission": 0.3, **more}
    written(described(materials={"x": sheet}, shapes=[{**QUAD, "material": "x"}]), tmp_path)
    bsdf = xml(tmp_path).find("bsdf")
    numbers = {each.get("name"): float(each.get("value")) for each in bsdf.findall("float")}
    assert bsdf.get("type") == "principledthin" and numbers["diff_trans"] == 0.6 and "metallic" not in numbers


def test_weaker_plastics_have_a_lower_index(tmp_path: Path) -> None:
    """At normal incidence they reflect `specular` times as much; what they do not reflect is not lost."""
    for specular, index in ((0.25, 11.0 / 9.0), (1e-9, 1.001), (0.0, None)):
        plastic = {"type": "principled", "roughness": 0.0, "ior": 1.5, "specular": specular}
        again, _ = written(described(materials={"m": plastic}, shapes=[{**BALL, "material": "m"}]), tmp_path)
        made = again.materials["m"]
        if index is None:
            assert made.type == "lambert" and made.reflectance == (1.0, 1.0, 1.0)
        else:
            assert made.ior == pytest.approx(index) and made.specular_color == (1.0, 1.0, 1.0)


def test_anisotropy(tmp_path: Path) -> None:
    """Both alphas, by the plugins' definitions: Disney's are r^2 / s and r^2 s, where s^2 = 1 - 0.9 anisotropic."""
    brushed = {"roughness": 0.5, "anisotropy": 0.3, "multiple_scattering": False}
    least, most = 0.25, 0.25 + 0.75 * 0.09
    for material in ({"metal": "Au"}, {"metal": "Au", "anisotropy_rotation": 90.0}, {"f0": [0.9, 0.6, 0.3]}):
        made = {"type": "conductor", **brushed, **material}
        written(described(materials={"x": made}, shapes=[{**BALL, "material": "x"}]), tmp_path)
        found = {each.get("name"): float(each.get("value", "")) for each in xml(tmp_path).findall(".//bsdf/float")}
        if "f0" in material:
            stretch, alpha = math.sqrt(1.0 - 0.9 * found["anisotropic"]), found["roughness"] ** 2
            assert near((alpha / stretch, alpha * stretch), (most, least))
        else:
            turned = "anisotropy_rotation" in material
            assert near((found["alpha_u"], found["alpha_v"]), (least, most) if turned else (most, least))


@for_each(
    ("degrees", "outer", "told"),
    [
        ([0.0, 40.0, 0.0], None, False),
        ([180.0, 0.0, 0.0], None, False),
        ([30.0, 0.0, 0.0], None, True),
        ([30.0, 0.0, 0.0], [-30.0, 0.0, 0.0], False),
        ([0.0, 0.0, 0.0], [0.0, 0.0, 20.0], True),
    ],
)
def test_anisotropy_of_turned_spheres(tmp_path: Path, degrees: list[float], outer: Any, told: bool) -> None:
    metal = {"type": "conductor", "metal": "Cu", "roughness": 0.3, "anisotropy": 0.5, "multiple_scattering": False}
    shapes: list[dict[str, Any]] = [{**BALL, "material": "x", "transform": {"rotate_degrees": degrees}}]
    groups = {}
    if outer is not None:
        groups = {"g": {"shapes": shapes}}
        shapes = [{"type": "instance", "group": "g", "transform": {"rotate_degrees": outer}}]
    _, notes = written(described(materials={"x": metal}, groups=groups, shapes=shapes), tmp_path)
    assert any("whose y axis is turned" in each for each in notes) == told


@pytest.mark.parametrize("roughness", [0.0, 1e-170])
def test_smooth_metals_have_no_direction(tmp_path: Path, roughness: float) -> None:
    made = {"type": "conductor", "f0": [0.9, 0.6, 0.3], "roughness": roughness, "anisotropy": 0.9}
    again, _ = written(described(materials={"x": made}, shapes=[{**BALL, "material": "x"}]), tmp_path)
    (read,) = again.materials.values()
    assert read.roughness == 0.0


def test_mixtures_and_cutoffs(tmp_path: Path) -> None:
    materials = {
        "both": {"type": "mix", "materials": ["m", "glass"], "weight": 0.3, "opacity": 0.4},
        "m": GREY,
        "glass": {"type": "dielectric", "ior": 1.5, "thin": True},
        "cut": {**GREY, "opacity": 0.4, "opacity_cutoff": 0.5},
    }
    shapes = [{**QUAD, "material": name} for name in ("both", "cut")]
    again, notes = written(described(materials=materials, shapes=shapes), tmp_path)
    both, cut = (again.materials[shape.material] for shape in again.shapes)
    assert notes == () and both.materials == ("m", "glass") and (both.weight, both.opacity) == (0.3, 0.4)
    assert cut.opacity == 0.0


# --- media


def test_lamps_shine_by_their_opacity(tmp_path: Path) -> None:
    """Mitsuba's shine in full, whatever passes through them."""
    lamp = {"type": "principled", "emission": [1.0, 0.5, 0.25], "emission_strength": 2.0}
    holes = {"opacity": {"checker": [1.0, 0.0]}}
    scene = described(
        materials={"half": {**GREY, "opacity": 0.5}, "lamp": {**lamp, "opacity": 0.25}, "holes": {**GREY, **holes}},
        shapes=[
            {**QUAD, "material": "half", "emission": [3.0, 2.0, 1.0]},
            {**QUAD, "material": "lamp"},
            {**QUAD, "material": "holes", "emission": [3.0, 2.0, 1.0]},
        ],
    )
    _, notes = written(scene, tmp_path)
    found = [each.get("value") for each in xml(tmp_path).findall("shape/emitter/rgb")]
    assert found == ["1.5 1.0 0.5", "0.5 0.25 0.125", "3.0 2.0 1.0"]
    assert sum("the opacity of lamps" in each and "shapes[2])" in each for each in notes) == 1


def test_media_around_surfaces(tmp_path: Path) -> None:
    """Nested ones by the smallest volume around each; that of the camera is that of the ball around it."""
    box = {"type": "box", "center": [0.1, 0.2, 5.0], "size": [20.0, 20.0, 20.0], "interior": "haze"}
    glass = {**BALL, "radius": 0.3, "material": "glass"}
    scene = described(
        media={"haze": {"scattering": 0.1}, "milk": {"absorption": [0.1, 0.2, 0.0], "scattering": [3, 2, 1], "g": 0.4}},
        materials={
            "glass": {"type": "dielectric", "ior": 1.5, "attenuation_color": [0.5, 0.25, 1.0]}
            | {"attenuation_distance": 2.0}
        },
        shapes=[{**BALL, "interior": "milk"}, box, glass],
    )
    again, notes = written(scene, tmp_path)
    assert notes == () and again.fog is None
    root = xml(tmp_path)
    sides = [
        {each.get("name"): each.get("id") for each in shape.findall("ref") if each.get("name")}
        for shape in root.findall("shape")
    ]
    assert sides == [
        {"interior": "milk", "exterior": "haze"},
        {"interior": "haze"},
        {"interior": "inside of glass", "exterior": "milk"},
    ]
    assert [each.get("id") for each in root.findall("sensor/ref")] == ["haze"]
    for name in ("haze", "milk"):
        assert near(again.media[name].numbers[0], scene.media[name].numbers[0])
        assert (
            near(again.media[name].numbers[1], scene.media[name].numbers[1])
            and again.media[name].g == scene.media[name].g
        )
    absorption = [math.log(2.0) / 2.0, math.log(4.0) / 2.0, 0.0]
    assert near(again.media["inside of glass"].absorption, absorption)


LINES: Any = {"wavelengths": [400.0, 450.0, 455.0, 700.0], "values": [0.5, 0.0, 2.0, 1.5]}
RAMP: Any = {"wavelengths": [360.0, 830.0], "values": [0.0, 3.0], "scale": 0.5}
REST: Any = {"wavelengths": [360.0, 830.0], "values": [1.5, 0.0]}


@for_each(
    ("absorption", "scattering"),
    [(LINES, RAMP), (LINES, 0.0), (0.0, LINES), (0.3, LINES), (LINES, [1.0, 2.0, 3.0]), (RAMP, RAMP)],
)
def test_spectra_of_media_stay(tmp_path: Path, absorption: Any, scattering: Any) -> None:
    scene = described(
        media={"dye": {"absorption": absorption, "scattering": scattering}}, shapes=[{**BALL, "interior": "dye"}]
    )
    again, notes = written(scene, tmp_path)
    assert notes == ()
    for name in ("absorption", "scattering"):
        found, wanted = (getattr(each.media["dye"], name) for each in (again, scene))
        if isinstance(wanted, SpectralColor):
            assert np.allclose(found.values, wanted.values, rtol=1e-12, atol=1e-12)
        elif wanted != (0.0, 0.0, 0.0):
            assert np.allclose(found.values, unbounded_spectra(np.array(wanted)), rtol=1e-12, atol=1e-12)
        if absorption == scattering or 0.0 in (absorption, scattering):  # others are products of colours there
            assert near(found, wanted, 1e-6)


@for_each(("absorption", "albedo", "stays"), [(REST, False, True), (LINES, False, False), (REST, True, False)])
def test_spectra_of_media_with_grids(tmp_path: Path, absorption: Any, albedo: bool, stays: bool) -> None:
    """They stay where the extinction is the same at all wavelengths: Mitsuba's grids have three channels."""
    np.save(tmp_path / "smoke.npy", np.arange(24.0, dtype=np.float32).reshape(2, 3, 4))
    medium: dict[str, Any] = {"absorption": absorption, "scattering": RAMP, "density": {"file": "smoke.npy"}}
    if albedo:
        medium["albedo"] = {"file": "share.npy"}
        np.save(tmp_path / "share.npy", np.full((2, 3, 4), 0.5, np.float32))
    scene = described(media={"smoke": medium}, shapes=[{**BALL, "interior": "smoke"}])
    notes = write_mitsuba(scene.placed("test", tmp_path), tmp_path / "out.xml")
    assert (
        any("spectra of media with grids, which are written as colours (media.smoke)" in each for each in notes)
        != stays
    )
    if stays:
        found, wanted = (each.media["smoke"] for each in (clrender.load(tmp_path / "out.xml"), scene))
        for name in ("absorption", "scattering"):
            assert np.allclose(getattr(found, name).values, getattr(wanted, name).values, rtol=1e-12, atol=1e-12)


@for_each(
    ("at", "radius", "outside"),
    [
        ((0.0, 0.0, -2.0), 0.5, ["smoke"]),  # behind the front of the room
        ((2.6, 2.6, -2.0), 0.5, []),  # seen past it
        ((0.0, 0.0, 2.0), 0.5, []),  # before it
    ],
)
def test_glass_in_a_room_of_smoke(
    tmp_path: Path, at: tuple[float, float, float], radius: float, outside: list[str]
) -> None:
    """Of the smoke there is only the front; its other sides are the walls."""
    front = {"type": "quad", "origin": [-1.5, -1.5, 0.0], "edge_u": [3.0, 0.0, 0.0], "edge_v": [0.0, 3.0, 0.0]}
    points = [[-1.5, -1.5, 0.0], [1.5, -1.5, 0.0], [1.5, 1.5, 0.0], [-1.5, 1.5, 0.0]]
    mesh = {"type": "mesh", "vertices": points, "faces": [[0, 1, 2], [0, 2, 3]], "interior": "smoke"}
    wall = {**front, "origin": [-1.5, -1.5, -4.0], "material": "m"}
    scene = described(
        media={"smoke": {"scattering": 0.1}},
        materials={"glass": {"type": "dielectric", "ior": 1.5}, "m": GREY},
        shapes=[mesh, wall, {**BALL, "center": list(at), "radius": radius, "material": "glass"}],
    )
    assert tuple(scene.camera.position)[2] > 3.0
    written(scene, tmp_path)
    ball = xml(tmp_path).findall("shape")[2]
    assert [each.get("id") for each in ball.findall("ref[@name='exterior']")] == outside
    assert not ball.findall("ref[@name='interior']")


def test_fog_is_outside_of_all(tmp_path: Path) -> None:
    """Also if a shape has the same medium inside, and around glass."""
    scene = described(
        media={"haze": {"scattering": 0.1}},
        fog="haze",
        materials={"glass": {"type": "dielectric", "ior": 1.5}, "m": GREY},
        shapes=[{**BALL, "interior": "haze"}, {**BALL, "material": "glass"}, {**QUAD, "material": "m"}],
    )
    again, _ = written(scene, tmp_path)
    assert again.fog == "haze" and list(again.media) == ["haze"]
    outside = [
        [each.get("id") for each in shape.findall("ref[@name='exterior']")] for shape in xml(tmp_path).findall("shape")
    ]
    assert outside == [["haze"], ["haze"], []]


def test_priorities_are_indices_around(tmp_path: Path) -> None:
    liquid = {"type": "dielectric", "ior": 1.33, "priority": 1}
    cup = {"type": "dielectric", "ior": 1.5, "priority": 2}
    apart = [{**BALL, "material": "cup"}, {**BALL, "radius": 0.5, "material": "liquid"}]
    again, notes = written(described(materials={"liquid": liquid, "cup": cup}, shapes=apart), tmp_path)
    assert notes == () and [(m.ior, m.exterior_ior) for m in again.materials.values()] == [(1.5, 1.0), (1.33, 1.5)]
    crossing = [apart[0], {**apart[1], "center": [1.4, 0.0, 0.0]}]
    _, notes = written(described(materials={"liquid": liquid, "cup": cup}, shapes=crossing), tmp_path)
    assert any("the order of media that overlap (shapes[0], shapes[1])" in note for note in notes)


def test_subsurface_is_glass_around_its_medium(tmp_path: Path) -> None:
    wax = {"type": "subsurface", "albedo": [0.9, 0.5, 0.2], "radius": [0.1, 0.2, 0.4], "g": 0.2, "ior": 1.4}
    again, _ = written(described(materials={"wax": wax}, shapes=[{**BALL, "material": "wax"}]), tmp_path)
    medium = again.media["inside of wax"]
    assert near(np.add(medium.absorption, medium.scattering), [10.0, 5.0, 2.5]) and medium.g == 0.2
    assert again.materials["wax"].ior == 1.4 and again.shapes[0].interior == "inside of wax"


# --- shapes


def fronts(arrays: Any) -> NDArray[np.float64]:
    """Centre and area normal of each triangle, sorted; then the spheres and disks."""
    corners = arrays["vertices"][arrays["triangles"]].astype(np.float64)
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    rows = np.round(np.concatenate([corners.mean(axis=1), normals], axis=1), 4) + 0.0
    rows = rows[np.lexsort(rows.T)].ravel()
    return np.concatenate([rows, *(arrays["analytic_shapes"][key].ravel() for key in ("center_radius", "normal"))])


def test_sides_under_reflections(tmp_path: Path) -> None:
    """Fronts, and with them the sides that shine, are where they were."""
    mirror = {"scale": [-1.0, 1.0, 1.0], "rotate_degrees": [10.0, 20.0, 30.0]}
    further = {**mirror, "translate": [3.0, 2.0, 1.0]}
    corner = {"type": "mesh", "vertices": [[0, 0, 0], [1, 0, 0], [0, 1, 0.1]], "faces": [[0, 1, 2]]}
    shapes: list[dict[str, Any]] = [
        {"type": "triangle", "vertices": [[0, 0, 0], [1, 0, 0], [0, 1, 0]]},
        {"type": "tetrahedron", "vertices": [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]},
        {"type": "box", "size": [1, 2, 3]},
        {"type": "disk", "normal": [0.1, 1.0, 0.3], "radius": 0.5},
        BALL,
        QUAD,
        corner,
    ]
    # Somewhere else each, so that none can be taken for another
    places: tuple[dict[str, Any], ...] = (
        {},
        {"flip_normals": True},
        {"transform": mirror},
        {"transform": further, "flip_normals": True},
    )
    every = [{**shape, **more, "emission": [1.0, 2.0, 3.0]} for shape in shapes for more in places]
    scene = described(shapes=every)
    for merge in (False, True):
        again, _ = written(scene, tmp_path, merge=merge)
        assert near(fronts(flatten(again, 8, 8).arrays), fronts(flatten(scene, 8, 8).arrays), 1e-4), merge
    assert len(again.shapes) == 1 + 3 * 4


def test_media_are_behind_fronts_under_reflections(tmp_path: Path) -> None:
    """Mitsuba decides about media by the order of corners in space, also where a mesh has normals."""
    faces = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]], np.uint32)
    corners = np.concatenate([np.zeros((1, 3)), np.eye(3)])
    with (tmp_path / "tip.ply").open("wb") as file:
        write_ply(file, MeshData(corners, faces, (corners - 0.25).astype(np.float32)))
    kinds: list[dict[str, Any]] = [
        {"type": "mesh", "file": "tip.ply"},
        {"type": "box", "size": [1, 2, 3], "center": [9, 0, 0]},
    ]
    turn = {"scale": [-1.0, 1.0, 2.0], "rotate_degrees": [10.0, 20.0, 30.0], "translate": [1.0, 2.0, 3.0]}
    scene = described(
        media={"m": {"absorption": [1.0, 1.0, 1.0]}},
        shapes=[{**each, "interior": "m", "transform": turn} for each in kinds],
    )
    again, notes = written(scene, tmp_path)
    for shape in xml(tmp_path).findall("shape"):
        matrix = np.array(shape.find("transform/matrix").get("value").split(), float).reshape(4, 4)
        assert np.linalg.det(matrix) > 0.0 and shape.find("boolean") is None
    mesh = again.mesh(0)
    a, b, c = (mesh.vertices[mesh.triangles[:, i]] for i in range(3))
    assert (np.sum(np.cross(b - a, c - a) * mesh.normals[mesh.triangles].sum(axis=1), axis=1) > 0.0).all()
    assert notes == ()
    one, other = (fronts(flatten(each, 8, 8).arrays) for each in (scene.placed("test", tmp_path), again))
    assert near(other, one, 1e-4)


@for_each("kind", ["mitsuba", "luxcore", "cycles"])
def test_averaged_normals_are_written(tmp_path: Path, kind: str) -> None:
    """Rows of zeros, which stand for them here, are black elsewhere."""
    roof = {"vertices": [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], "faces": [[0, 1, 2], [0, 3, 1]]}
    turn = {"scale": [-1.0, 1.0, 2.0], "rotate_degrees": [10.0, 20.0, 30.0]}
    scene = described(
        materials={"m": GREY},
        shapes=[{"type": "mesh", "smooth_angle": 180.0, "material": "m", "transform": turn, **roof}],
    )
    mesh = world_mesh(scene, ("shapes", 0), scene.shapes[0])
    expected = flatten(scene, 8, 8).arrays["normals"]
    assert mesh.normals is not None and near(mesh.normals, expected, 1e-6)
    ending = {"mitsuba": ".xml", "luxcore": ".scn", "cycles": ".py"}[kind]
    write = {"mitsuba": write_mitsuba, "luxcore": write_luxcore, "cycles": write_cycles}[kind]
    write(scene.placed("test", tmp_path), tmp_path / f"out{ending}")
    (file,) = (each for each in (tmp_path / "out-files").iterdir() if each.suffix in (".ply", ".npz"))
    if kind == "cycles":
        normals = np.load(file)["normals"].reshape(-1, 3)
    else:
        found = read_mesh(file.name, file.parent, (), file.name).normals
        assert found is not None
        normals = found
    assert near(np.sum(normals * normals, axis=1), 1.0, 1e-5)


def test_textures_lie_where_they_were(pictures: Path) -> None:
    """Coordinates of all corners, and the axes of spheres, also if they are mirrored."""
    turned = {"scale": [1.0, -1.0, 1.0], "rotate_degrees": [40.0, 20.0, 10.0]}
    shapes = [BALL, {**BALL, "transform": turned}, {"type": "box", "size": [1, 2, 3]}, QUAD]
    scene = described(
        materials={"m": {**GREY, "reflectance": {"texture": "a.png"}}},
        shapes=[{**each, "material": "m"} for each in shapes],
    )
    again, notes = written(scene, pictures)
    assert notes == ()
    one, other = (flatten(each, 8, 8).arrays for each in (scene.placed("test", pictures), again))
    assert near(other["attribute_rows"][:, :12], one["attribute_rows"][:, :12])
    assert near(other["analytic_shapes"]["center_radius"], one["analytic_shapes"]["center_radius"])


def test_groups_and_their_lights(tmp_path: Path) -> None:
    """Instances stay instances, but for the shapes that shine: Mitsuba has no lights in groups."""
    maps = RNG.normal(size=(3, 3, 4))
    maps[0] = np.eye(3, 4)
    lamp = {"type": "triangle", "vertices": [[0, 0, 0], [1, 0, 0], [0, 1, 0]], "emission": [1.0, 2.0, 3.0]}
    scene = described(
        groups={"g": {"shapes": [{**QUAD, "material": "m"}, lamp]}},
        shapes=[{"type": "instance", "group": "g", "transforms": "places"}],
    )
    scene = scene.with_files(transforms={"places": TransformArray.checked(maps, "places")})
    write_mitsuba(scene, tmp_path / "out.xml")
    kinds = [shape.get("type") for shape in xml(tmp_path).findall("shape")]
    assert kinds == ["ply"] * 3 + ["shapegroup"] + ["instance"] * 3
    again = clrender.load(tmp_path / "out.xml")
    one, other = (flatten(each, 8, 8) for each in (scene, again))
    assert other.light_count == one.light_count == 3
    # The importer writes out few instances
    assert near(fronts(other.arrays), fronts(flatten(written_out(scene), 8, 8).arrays), 1e-4)


def test_names(tmp_path: Path) -> None:
    """Ids are unique, and have no dots or dollar signs, which mean something else there."""
    shapes = [{**BALL, "name": name} for name in ("a.b", "ab", "ab", "$", "_x")]
    again, _ = written(described(shapes=shapes), tmp_path)
    assert [shape.name for shape in again.shapes] == ["ab", "ab 2", "ab 3", "shape", "x"]


# --- cameras and settings


@for_each(
    "camera",
    [
        {"vertical_fov": 30.0, "up": [0.3, 1.0, 0.0], "mirrored": True},
        {"aperture_radius": 0.1, "focus_distance": 3.3},
        {"aperture_radius": 0.1},
        {"type": "orthographic", "height": 3.0},
        {"vertical_fov": 30.0, "lens_shift": [0.2, -0.3]},
    ],
)
def test_cameras(tmp_path: Path, camera: dict[str, Any]) -> None:
    scene = described(camera={**CAMERA, **camera}, image={"width": 60, "height": 20}, shapes=[BALL])
    again, notes = written(scene, tmp_path)
    one, other = scene.camera, again.camera
    assert notes == () and (other.type, other.mirrored) == (one.type, one.mirrored)
    assert near(other.position, one.position)
    ahead, wanted = (np.subtract(each.target, each.position) for each in (other, one))
    assert near(ahead / np.linalg.norm(ahead), wanted / np.linalg.norm(wanted))
    for key in ("vertical_fov", "height", "aperture_radius", "lens_shift"):
        assert near(getattr(other, key), getattr(one, key)), key
    if "aperture_radius" in camera:
        assert near(other.focus_distance, one.focus_distance or float(np.linalg.norm(wanted)))


@for_each(
    "camera",
    [
        {"type": "orthographic", "height": 3.0, "lens_shift": [0.2, -0.3]},
        {"type": "intrinsics", "fx": 90.0, "fy": 90.0, "cx": 22.0, "cy": 12.0},
    ],
)
def test_cameras_that_are_others_there(tmp_path: Path, camera: dict[str, Any]) -> None:
    """A shift of parallel rays moves the camera; an undistorted calibrated camera has a shifted lens. Pixels stay."""
    scene = described(camera={**CAMERA, **camera}, image={"width": 60, "height": 20}, shapes=[BALL])
    again, notes = written(scene, tmp_path)
    points = np.random.default_rng(1).normal(0.0, 1.0, (20, 3))
    assert notes == ()
    assert near(again.camera.project(points, size=(60, 20)), scene.camera.project(points, size=(60, 20)))


@for_each(
    ("camera", "words"),
    [
        ({"skew": 3.0}, "the skew of the camera matrix"),
        ({"fy": 99.0}, "pixels that are not square"),
        ({"distortion": {"model": "brown-conrady", "k": [0.1]}}, "the distortion of the lens"),
    ],
)
def test_what_calibrated_cameras_lose(tmp_path: Path, camera: dict[str, Any], words: str) -> None:
    calibrated = {**CAMERA, "type": "intrinsics", "fx": 90.0, **camera}
    _, notes = written(described(camera=calibrated, shapes=[BALL]), tmp_path)
    assert len(notes) == 1 and words in notes[0]


def test_cameras_that_mitsuba_lacks(tmp_path: Path) -> None:
    for kind in ("fisheye", "panoramic"):
        with pytest.raises(SceneError, match=f"camera is of type {kind}, which Mitsuba has not"):
            write_mitsuba(described(camera={**CAMERA, "type": kind}), tmp_path / "out.xml")
    bladed = described(camera={**CAMERA, "aperture_radius": 0.1, "blades": 5, "f_stop": 8.0, "shutter": 0.1})
    _, notes = written(bladed, tmp_path)
    assert any("camera.blades" in note for note in notes) and any("camera.f_stop" in note for note in notes)


@for_each(
    ("render", "depth", "left_out"),
    [
        ({"max_depth": 5, "spp": 7, "filter": "mitchell"}, 5, False),
        ({"max_depth": 0}, 0, False),
        ({"integrator": "direct"}, 1, False),
        ({"integrator": "photon", "filter": "gaussian"}, None, True),
        ({"filter": "blackman-harris", "roulette": "none"}, None, True),
    ],
)
def test_settings(tmp_path: Path, render: dict[str, Any], depth: int | None, left_out: bool) -> None:
    again, notes = written(described(render=render, shapes=[BALL]), tmp_path)
    assert again.render.max_depth == depth and again.render.spp == render.get("spp", 64)
    assert again.render.filter == {"blackman-harris": "gaussian"}.get(
        render.get("filter", "box"), render.get("filter", "box")
    )
    assert bool(notes) is left_out
    assert ("rr_depth" in (tmp_path / "out.xml").read_text()) is (render.get("roulette") == "none")


# --- lights


def test_spots_fall_as_here(tmp_path: Path) -> None:
    """Mitsuba multiplies its fall, linear in the angle, by the picture."""
    half, blend = 35.0, 0.4
    spot = {"type": "spot", "position": [0, 3, 0], "direction": [0.1, -1, 0.2], "intensity": [1, 2, 3]}
    again, notes = written(described(lights=[{**spot, "cone_degrees": 2.0 * half, "blend": blend}]), tmp_path)
    (light,) = again.lights
    assert (
        notes == ()
        and near((light.cone_degrees, light.blend), (2.0 * half, blend))
        and near(light.intensity, [1, 2, 3])
    )
    assert near(np.array(light.direction), np.array([0.1, -1, 0.2]) / np.linalg.norm([0.1, -1, 0.2]))
    picture = read_image(tmp_path / xml(tmp_path).find("emitter/texture/string[@name='filename']").get("value"))
    side = len(picture)
    column = int(0.95 * side)
    radius = math.hypot(2.0 * (column + 0.5) / side - 1.0, 1.0 / side) * math.tan(math.radians(half))
    angle = math.degrees(math.atan(radius))
    edge = math.cos(math.radians(half))
    inner = math.degrees(math.acos(edge + blend * (1.0 - edge)))
    t = (math.cos(math.radians(angle)) - edge) / (blend * (1.0 - edge))
    assert 0.0 < t < 1.0
    assert near(picture[side // 2, column, 0] * (half - angle) / (half - inner), t * t * (3.0 - 2.0 * t), 1e-4)


def exported_map(folder: Path) -> NDArray[np.float32]:
    """The rows of the environment map just written, which is removed."""
    (name,) = (folder / "out-files").glob("*.exr")
    rows = read_image(name)
    name.unlink()
    return rows


def test_environments(tmp_path: Path) -> None:
    pixels = RNG.random((4, 8, 3)).astype(np.float32)
    write_image(tmp_path / "sky.exr", pixels)
    for scale, expected in ((2.0, pixels), ([1.0, 2.0, 3.0], pixels * np.array([1.0, 2.0, 3.0], np.float32))):
        light = {"type": "environment", "file": "sky.exr", "rotate_degrees": 40.0, "scale": scale}
        again, notes = written(described(lights=[light]), tmp_path)
        other = again.environment
        assert notes == () and other is not None and near(other.rotate_degrees, 40.0)
        assert near(other.scale, scale if isinstance(scale, float) else 1.0)
        rows = exported_map(tmp_path)
        assert near(rows[1::2], expected) and near(rows[0], expected[0]) and near(rows[-1], expected[-1])
        assert near(rows[2], (expected[0] + expected[1]) / 2.0)
    again, _ = written(described(lights=[{"type": "environment", "radiance": [1, 2, 3], "scale": 0.5}]), tmp_path)
    assert again.environment.radiance == (0.5, 1.0, 1.5)


@pytest.mark.long
def test_the_sun_is_drawn_into_a_map(tmp_path: Path) -> None:
    """Its irradiance is that of the sun, and it stands where it stood."""
    sky = {"type": "sun_sky", "sun_direction": [0.4, 0.5, -0.3], "rotate_degrees": 25.0}
    scene = described(lights=[sky])
    again, notes = written(scene, tmp_path)
    pixels = exported_map(tmp_path)[1::2]
    assert any("the edge of the sun" in note for note in notes)
    sun = scene_sun(scene)
    assert sun is not None
    written(described(lights=[{**sky, "sun_scale": 0.0, "ground": False, "sky_scale": [1.0, 1.0, 1.001]}]), tmp_path)
    plain = exported_map(tmp_path)[1::2].repeat(4, axis=0).repeat(4, axis=1)
    assert again.environment is not None
    height, width = pixels.shape[:2]
    polar = (np.arange(height) + 0.5) / height * np.pi
    solid = np.sin(polar)[:, None, None] * (np.pi / height) * (2.0 * np.pi / width)
    extra = np.maximum(pixels[: height // 2] - plain[: height // 2], 0.0)
    bright = extra * (extra > 10.0)
    assert near((bright * solid[: height // 2]).sum((0, 1)), np.array(sun.mean) * 2.0 * np.pi * sun.spread, 5e-3)
    row, column = np.unravel_index(bright[..., 1].argmax(), bright.shape[:2])
    turn = math.radians(again.environment.rotate_degrees) + ((column + 0.5) / width - 0.5) * -2.0 * np.pi
    theta = polar[row]
    towards = [math.sin(theta) * math.sin(turn), math.cos(theta), math.sin(theta) * math.cos(turn)]
    assert float(np.dot(towards, sun.axis)) > math.cos(math.radians(0.4))


def test_lamps_are_named(tmp_path: Path) -> None:
    notes = exported_to_mitsuba(clrender.load("lamps"), "files").notes
    assert "left out: the lamps of IES files (lights[0], lights[1], lights[2])" in notes


# --- the command


def convert(*arguments: object) -> None:
    main.main([str(each) for each in ("convert", *arguments)], standalone_mode=False)


@pytest.mark.long
def test_the_command(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    convert("room", tmp_path / "room.xml")
    said = capsys.readouterr()
    assert said.err == "" and "room.xml: 13 shapes" in said.out
    with pytest.raises(UsageError, match="exists already"):
        convert("room", tmp_path / "room.xml")
    convert("foliage", tmp_path / "foliage.xml")
    said = capsys.readouterr()
    assert said.err.count("note: left out: the roughness of oren_nayar") == 1
    assert clrender.load(tmp_path / "foliage.xml").shapes
    with pytest.raises(SceneError, match=r"foliage\.toml: Mitsuba cannot express all of it: left out: "):
        convert("foliage", tmp_path / "strict.xml", "--strict")
    with pytest.raises(SceneError, match="camera is of type fisheye"):
        convert("fisheye", tmp_path / "strict.xml")
    assert not list(tmp_path.glob("strict*"))


@for_each("name", PIXEL_FILTERS)
def test_pixel_filters(tmp_path: Path, name: str) -> None:
    for radius in (None, 1.25):
        again, notes = written(described(render={"filter": name, "filter_radius": radius}), tmp_path)
        assert again.render.filter == ("gaussian" if name == "blackman-harris" else name)
        lost = name == "blackman-harris" or (name == "mitchell" and radius is not None)
        assert any("pixel filter" in note for note in notes) is lost
        assert again.render.filter_radius == pytest.approx(None if name == "mitchell" else radius)
        border = xml(tmp_path).find("sensor/film/boolean[@name='sample_border']")
        assert (border is None) is (name == "box" and radius is None)
        assert border is None or border.get("value") == "true"
