"""Normal and bump maps of pbrt and Mitsuba: which way green points, how heights are coded; textures of round shapes."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import numpy as np
from cases import for_each
from PIL import Image

import clrender.importers.mitsuba
import clrender.importers.pbrt
from clrender.image.pictures import open_picture
from clrender.importers import load
from clrender.importers.asset_files import AssetFiles
from clrender.importers.draft import Draft
from clrender.importers.shared.matrices import handedness
from clrender.importers.shared.meshes import sphere_mesh, sphere_part_mesh
from clrender.meshes.data import MeshData

CODED = np.array([[0, 60], [128, 255]], np.uint8)


def pictures(folder: Path) -> None:
    Image.fromarray(np.dstack([CODED, CODED.T, CODED])).save(folder / "n.png")
    Image.fromarray(CODED).save(folder / "h.png")


def pbrt(folder: Path, world: str) -> Draft:
    pictures(folder)
    (folder / "s.pbrt").write_text(f'Camera "perspective"\nWorldBegin\n{world}\n', encoding="utf-8")
    return clrender.importers.pbrt.read(folder / "s.pbrt", AssetFiles("s", folder))


def mitsuba(folder: Path, inside: str, version: str = "3.0.0") -> Draft:
    pictures(folder)
    (folder / "s.xml").write_text(f'<scene version="{version}">{inside}</scene>', encoding="utf-8")
    return clrender.importers.mitsuba.read(folder / "s.xml", AssetFiles("s", folder))


def pixels(draft: Draft, name: str) -> Any:
    data, ending = draft.pictures[name]
    (band,) = open_picture(io.BytesIO(data), ending).bands()
    return np.asarray(band, np.float64)[..., :3]


# --- green


def turned(draft: Draft) -> bool:
    """Whether green of the normal map of the only shape, here along v, was turned round; by its map or tangents."""
    (shape,) = draft.description["shapes"]
    material = draft.description["materials"][shape["material"]]
    material = material if "materials" not in material else draft.description["materials"][material["materials"][0]]
    if shape["type"] != "mesh":
        name = material["normal_map"]["texture"]
        if name == "n.png":
            return False
        # The middle of 8 bits, 128, is 0; it stays so but for rounding, so that flat maps stay flat
        slopes = np.array([[-128.0, 0.0], [-68.0, 127.0]]) / 127.0
        np.testing.assert_allclose(pixels(draft, name)[..., 1] * 2.0 - 1.0, -slopes, atol=1e-6)

        return True
    assert material["normal_map"]["texture"] == "n.png"
    mesh = draft.meshes[shape["file"]]
    if mesh.tangents is None:
        return False
    sign = -1.0 if shape.get("flip_normals", False) else 1.0
    for way in (shape.get("transform"), *shape.get("motion", ())[:1]):
        sign *= 1.0 if way is None else handedness(np.array(way["matrix"]))
    check_tangents(mesh, sign)
    return bool(mesh.tangents.any())


def check_tangents(mesh: MeshData, sign: float) -> None:
    """Tangents are along dp/du, and their sign is that which makes green normal x tangent behind all reflections."""
    assert mesh.tangents is not None and mesh.uvs is not None
    given = mesh.tangents.any(axis=(1, 2))
    assert (mesh.tangents[given, :, 3] == sign).all()
    for at in np.flatnonzero(given)[[0, -1] if given.sum() < 8 else [given.sum() // 2, given.sum() // 3]]:
        a, b, c = np.asarray(mesh.vertices, np.float64)[mesh.triangles[at]]
        uvs = mesh.uvs[at].astype(np.float64)
        along, _ = np.linalg.lstsq(uvs[1:] - uvs[0], np.stack([b - a, c - a]), rcond=None)[0]
        np.testing.assert_allclose(mesh.tangents[at, 1, :3], along / np.linalg.norm(along), atol=1e-3)


NORMAL = 'Material "diffuse" "string normalmap" "n.png"\n'
QUAD = 'Shape "trianglemesh" "point3 P" [-1 -1 0 1 -1 0 1 1 0 -1 1 0] "integer indices" [0 1 2 0 2 3] "point2 uv" [{}]'
UPRIGHT, MIRRORED = "0 0 1 0 1 1 0 1", "0 1 1 1 1 0 0 0"


@for_each(
    ("world", "expected"),
    [
        (QUAD.format(UPRIGHT), False),
        (QUAD.format(MIRRORED), True),
        ("Scale 1 -1 1\n" + QUAD.format(UPRIGHT), True),
        ("Scale 1 -1 1\n" + QUAD.format(MIRRORED), False),
        ("ReverseOrientation\n" + QUAD.format(UPRIGHT), True),
        ("ReverseOrientation\n" + QUAD.format(MIRRORED), False),
        ('Shape "sphere"', False),
        ('Scale -1 1 1\nShape "sphere"', True),
        ('ReverseOrientation\nShape "sphere"', True),
        ('Shape "sphere" "float phimax" 90', False),
        ('Scale -1 1 1\nShape "sphere" "float phimax" 90', True),
        ("ActiveTransform All\nScale 1 -1 1\nActiveTransform EndTime\nTranslate 1 0 0\n" + QUAD.format(UPRIGHT), True),
    ],
)
def test_green_of_pbrt_is_across_red(tmp_path: Path, world: str, expected: bool) -> None:
    assert turned(pbrt(tmp_path, NORMAL + world)) == expected


RAW = '<boolean name="raw" value="true"/>'
MAP = f'<texture name="normalmap" type="bitmap"><string name="filename" value="n.png"/>{RAW}</texture>'
BUMPY = f'<bsdf type="normalmap">{MAP}<bsdf type="diffuse"/></bsdf>'
IN_A_MIX = f'<bsdf type="blendbsdf">{BUMPY}<bsdf type="diffuse"/></bsdf>'
OBJ = "v -2 -2 0\nv 2 -2 0\nv 2 2 0\nvt 0 0\nvt 1 0\nvt 1 1\nf 1/1 2/2 3/3\n"
SHAPE = '<shape type="{}">{}<transform name="to_world">{}</transform>{}</shape>'


@for_each(
    ("kind", "inside", "way", "expected"),
    [
        # The transform of its pictures turns them upside down, and with them green
        ("rectangle", "", "", True),
        ("rectangle", "", '<scale y="-1"/>', False),
        ("sphere", "", "", False),  # v runs from +z to -z
        ("sphere", "", '<scale y="-1"/>', False),  # inside out as well
        ("obj", '<string name="filename" value="q.obj"/>', "", True),  # which is flipped twice in all
        (
            "obj",
            '<string name="filename" value="q.obj"/><boolean name="flip_tex_coords" value="false"/>',
            "",
            True,
        ),
        ("cube", "", "", None),
    ],
)
@for_each("bsdf", [BUMPY, IN_A_MIX])
def test_green_of_mitsuba_is_across_red(
    tmp_path: Path, bsdf: str, kind: str, inside: str, way: str, expected: bool | None
) -> None:
    (tmp_path / "q.obj").write_text(OBJ, encoding="utf-8")
    found = turned(mitsuba(tmp_path, SHAPE.format(kind, inside, way, bsdf)))
    assert expected is None or found == expected


# --- heights


def linear(coded: Any) -> Any:
    """sRGB's own formula."""
    values = np.asarray(coded) / 255.0
    return np.where(values <= 0.04045, values / 12.92, ((values + 0.055) / 1.055) ** 2.4)


@for_each("wanted", ["sRGB", "linear"])
@for_each("kind", ["pbrt", "mitsuba"])
def test_heights_are_coded_as_their_picture(tmp_path: Path, kind: str, wanted: str) -> None:
    if kind == "pbrt":
        texture = f'Texture "h" "float" "imagemap" "string filename" "h.png" "string encoding" "{wanted}"'
        world = f'{texture} "float scale" 3\nMaterial "diffuse" "texture displacement" "h"\nShape "sphere"'
        draft = pbrt(tmp_path, world)
    else:
        file = f'<string name="filename" value="h.png"/>{RAW if wanted == "linear" else ""}'
        bump = f'<texture type="bitmap">{file}</texture><float name="scale" value="3"/>'
        bsdf = f'<bsdf type="bumpmap">{bump}<bsdf type="diffuse"/></bsdf>'
        draft = mitsuba(tmp_path, SHAPE.format("sphere", "", "", bsdf))
    ((material),) = draft.description["materials"].values()
    made = material["bump_map"]
    assert made["scale"] == 3.0 and "color_space" not in made
    if wanted == "linear":
        assert made["texture"] == "h.png"
    else:
        # In single precision: that of half spoils slopes
        np.testing.assert_allclose(pixels(draft, made["texture"])[..., 0], linear(CODED), atol=1e-6)


def test_normal_maps_of_mitsuba_that_are_not_raw_are_decoded(tmp_path: Path) -> None:
    draft = mitsuba(tmp_path, SHAPE.format("rectangle", "", '<scale y="-1"/>', BUMPY.replace(RAW, "")))
    (material,) = draft.description["materials"].values()
    found = pixels(draft, material["normal_map"]["texture"])
    np.testing.assert_allclose(found, linear(np.dstack([CODED, CODED.T, CODED])), atol=1e-6)


def test_scaled_heights_of_old_mitsuba(tmp_path: Path) -> None:
    inner = '<texture type="bitmap"><string name="filename" value="h.png"/><float name="gamma" value="1"/></texture>'
    scaled = f'<texture type="scale"><float name="scale" value="0.5"/>{inner}</texture>'
    draft = mitsuba(
        tmp_path, SHAPE.format("sphere", "", "", f'<bsdf type="bump">{scaled}<bsdf type="diffuse"/></bsdf>'), "0.6.0"
    )
    (material,) = draft.description["materials"].values()
    assert material["bump_map"]["texture"] == "h.png" and material["bump_map"]["scale"] == 0.5


@for_each(("bsdf", "told"), [(BUMPY, True), (IN_A_MIX, True), ('<bsdf type="diffuse"/>', False)])
def test_maps_of_two_sided_surfaces_are_told(tmp_path: Path, bsdf: str, told: bool) -> None:
    draft = mitsuba(tmp_path, SHAPE.format("rectangle", "", "", f'<bsdf type="twosided">{bsdf}</bsdf>'))
    assert any("from behind" in note for note in draft.notes) == told


# --- round shapes


def test_ellipsoids_have_their_poles_where_parts_of_spheres_have_them() -> None:
    """From our sphere to pbrt's, whose part from pole to pole is made by pbrt's own formulas."""
    to_pbrt = clrender.importers.pbrt.shapes._POLES[:3, :3]
    whole, part = sphere_mesh(2.0), sphere_part_mesh(2.0, -2.0, 2.0, 1.0)
    assert whole.uvs is not None and part.uvs is not None
    for mesh, to in ((whole, to_pbrt), (part, np.eye(3))):
        assert mesh.uvs is not None
        points = np.asarray(mesh.vertices)[mesh.triangles].reshape(-1, 3) @ to.T / 2.0
        u, v = mesh.uvs.reshape(-1, 2).astype(np.float64).T
        phi, theta = 2.0 * np.pi * u, np.pi * (1.0 - v)
        wanted = np.stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)], axis=1)
        np.testing.assert_allclose(points, wanted, atol=1e-6)


def test_textures_of_mitsubas_disks_lie_around_them(tmp_path: Path) -> None:
    """u is the distance from the middle, v the turn; the upper side is the front."""
    picture = '<texture name="reflectance" type="bitmap"><string name="filename" value="n.png"/></texture>'
    draft = mitsuba(tmp_path, SHAPE.format("disk", "", "", f'<bsdf type="diffuse">{picture}</bsdf>'))
    (shape,) = draft.description["shapes"]
    mesh = draft.meshes[shape["file"]]
    assert mesh.uvs is not None and not draft.notes
    corners = np.asarray(mesh.vertices)[mesh.triangles]
    x, y, z = corners.reshape(-1, 3).T
    u, v = mesh.uvs.reshape(-1, 2).astype(np.float64).T
    np.testing.assert_allclose(x, u * np.cos(2.0 * np.pi * v), atol=1e-5)
    np.testing.assert_allclose(y, u * np.sin(2.0 * np.pi * v), atol=1e-5)
    assert (z == 0.0).all()
    assert (np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])[:, 2] >= 0.0).all()


TEXTURED = 'Texture "t" "spectrum" "imagemap" "string filename" "n.png"\nMaterial "diffuse" "texture reflectance" "t"\n'
SHINING = 'AreaLightSource "diffuse" "string filename" "n.png"\n'


@for_each(("before", "kind"), [(TEXTURED, "mesh"), (SHINING, "mesh"), ("", "disk")])
def test_textures_of_disks_lie_around_them(tmp_path: Path, before: str, kind: str) -> None:
    draft = pbrt(tmp_path, f'{before}Shape "disk" "float radius" 2 "float height" 1')
    (shape,) = draft.description["shapes"]
    assert shape["type"] == kind
    if kind == "mesh":
        mesh = draft.meshes[shape["file"]]
        assert mesh.uvs is not None and "radius" not in shape
        x, y, z = np.asarray(mesh.vertices)[mesh.triangles].reshape(-1, 3).T
        u, v = mesh.uvs.reshape(-1, 2).astype(np.float64).T
        np.testing.assert_allclose(np.hypot(x, y), 2.0 * (1.0 - v), atol=1e-6)
        np.testing.assert_allclose(x, 2.0 * (1.0 - v) * np.cos(2.0 * np.pi * u), atol=1e-5)
        assert (z == 1.0).all()
        load(tmp_path / "s.pbrt")
