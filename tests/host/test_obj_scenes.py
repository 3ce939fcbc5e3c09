"""OBJ files with material libraries as scenes: shapes, materials, pictures, and what is said of the rest."""

from __future__ import annotations

import math
import re
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cases import for_each
from PIL import Image

import clrender
from clrender.errors import SceneError
from clrender.flatten.flat_scene import flatten
from clrender.flatten.surfaces import placed_normals
from clrender.meshes.data import MeshData
from clrender.meshes.read import read_mesh
from clrender.scene import Mesh, Scene
from clrender.scene.transforms import affine

SQUARE = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\n"
FACE = "f 1/1 2/2 3/3 4/4\n"


def load(folder: Path, obj: str, mtl: str | None = None) -> Scene:
    (folder / "m.obj").write_text(obj)
    if mtl is not None:
        (folder / "m.mtl").write_text(mtl)
    return clrender.load(folder / "m.obj")


def material(folder: Path, mtl: str) -> tuple[dict[str, Any], Any]:
    """The material that a library makes, and the emission of its shape."""
    scene = load(folder, f"mtllib m.mtl\n{SQUARE}usemtl a\n{FACE}", f"newmtl a\n{mtl}")
    flatten(scene, 8, 8)
    found = scene.materials["a"].model_dump(exclude_unset=True)
    return found, scene.shapes[0].emission


def said(scene: Scene) -> str:
    return "\n".join(scene.notes)


def test_pictures_are_looked_up_beside_their_own_library(tmp_path: Path) -> None:
    for folder, name, color in (("a", "x", (255, 0, 0)), ("b", "y", (0, 255, 0))):
        (tmp_path / folder).mkdir()
        Image.new("RGB", (2, 2), color).save(tmp_path / folder / "same.png")
        (tmp_path / folder / f"{name}.mtl").write_text(f"newmtl {name}\nKd 1 1 1\nmap_Kd same.png\n")
    scene = load(tmp_path, f"mtllib a/x.mtl\nmtllib b/y.mtl\n{SQUARE}usemtl x\n{FACE}usemtl y\n{FACE}")
    pictures = {name: scene.materials[name].model_dump()["reflectance"]["texture"] for name in ("x", "y")}
    assert pictures == {"x": "a/same.png", "y": "b/same.png"} and "left out" not in said(scene)


# --- materials --------------------------------------------------------------------------------------------------------

ROUGH = (2.0 / 98.0) ** 0.25
"""Of Ns 96."""


@for_each(
    ("mtl", "expected"),
    [
        ("Kd .5 .25 0\nKs .5 .5 .5\nillum 1", {"type": "lambert", "reflectance": (0.5, 0.25, 0.0)}),
        ("Kd .5", {"type": "lambert", "reflectance": (0.5, 0.5, 0.5)}),
        ("Kd .5 .25 0\nKs 0 0 0\nillum 2", {"type": "lambert", "reflectance": (0.5, 0.25, 0.0)}),
        ("Ka 1 1 1\nillum 0", {"type": "lambert", "reflectance": (0.6, 0.6, 0.6)}),
        # A highlight (illum 2) reflects 0.08 Ks straight on, a mirror on top (illum 5) Ks itself
        (
            "Kd .5 .5 .5\nKs .5 .25 0\nNs 96\nillum 2",
            {"type": "principled", "base_color": (0.5, 0.5, 0.5), "ior": 1.5, "specular_color": (1, 0.5, 0)}
            | {"roughness": ROUGH},
        ),
        (
            "Kd .5 .5 .5\nKs .25 .25 .25\nillum 5",
            {"type": "principled", "base_color": (0.5, 0.5, 0.5), "ior": 3.0, "specular_color": (1, 1, 1)}
            | {"roughness": 0.0},
        ),
        ("Kd 0 0 0\nKs .9 .8 .7\nillum 3", {"type": "mirror", "reflectance": (0.9, 0.8, 0.7)}),
        ("Kd 0 0 0\nKs .9 .8 .7\nNs 96\nillum 3", {"type": "conductor", "f0": (0.9, 0.8, 0.7), "roughness": ROUGH}),
        ("Kd 1 1 1\nNi 1.33\nillum 7", {"type": "dielectric", "ior": 1.33, "roughness": 0.0}),
        ("Ni 1.33\nd .5\nillum 4", {"type": "dielectric", "ior": 1.33, "roughness": 0.0, "thin": True}),
        (
            "Tf .5 1 .5\nillum 6",
            {"type": "principled", "base_color": (0.5, 1, 0.5), "transmission": 1.0, "ior": 1.5, "roughness": 0.0},
        ),
        ("Kd 1 1 1\nd .25", {"type": "lambert", "reflectance": (1, 1, 1), "opacity": 0.25}),
        ("Kd 1 1 1\nTr .25", {"type": "lambert", "reflectance": (1, 1, 1), "opacity": 0.75}),
        ("Kd 1 1 1\nd -halo .25 # c", {"type": "lambert", "reflectance": (1, 1, 1), "opacity": 0.25}),
        (
            "Kd .5 .5 .5\nPr .3\nPm 1\nPs .2\nPc .5\nPcr .1\naniso .5\nanisor .25",
            {"type": "principled", "base_color": (0.5, 0.5, 0.5), "ior": 1.5, "roughness": 0.3, "metallic": 1.0}
            | {"sheen_color": (0.2, 0.2, 0.2), "coat": 0.5, "coat_roughness": 0.1, "anisotropy": 0.5}
            | {"anisotropy_rotation": 90.0},
        ),
        (
            "Kd .5 .5 .5\nPr .3\nNi 1.4\nd .25\nillum 7",
            {"type": "principled", "base_color": (0.5, 0.5, 0.5), "ior": 1.4, "roughness": 0.3}
            | {"transmission": 0.75, "thin": False},
        ),
    ],
)
def test_materials(tmp_path: Path, mtl: str, expected: dict[str, Any]) -> None:
    found, emission = material(tmp_path, mtl)
    assert emission is None and found.keys() == expected.keys()
    for key, value in expected.items():
        assert found[key] == (value if isinstance(value, str) else pytest.approx(value, rel=1e-12)), key


def test_highlight_reflects_what_it_should(tmp_path: Path) -> None:
    found, _ = material(tmp_path, "Kd 0 0 0\nKs .9 .9 .9\nNs 10\nillum 2")
    index = found["ior"]
    assert math.isclose(((index - 1) / (index + 1)) ** 2, 0.08 * 0.9, rel_tol=1e-12)


def test_xyz_white_is_white(tmp_path: Path) -> None:
    found, _ = material(tmp_path, "Kd xyz .475235 .5 .544415")
    assert found["reflectance"] == pytest.approx((0.5, 0.5, 0.5), abs=2e-4)


def test_emission(tmp_path: Path) -> None:
    assert material(tmp_path, "Kd 1 1 1\nKe 3 2 1")[1] == (3, 2, 1)
    scene = load(tmp_path, f"mtllib m.mtl\n{SQUARE}usemtl a\n{FACE}", "newmtl a\nKa 20 20 20\nKd 1 1 1\n")
    assert scene.shapes[0].emission == (20, 20, 20) and "has a Ka above 1" in said(scene)
    assert "there is no light" not in said(scene)


# --- pictures ---------------------------------------------------------------------------------------------------------


def pictures(folder: Path) -> None:
    (folder / "maps").mkdir()
    Image.new("RGB", (4, 4), (200, 100, 50)).save(folder / "maps" / "a b.png")
    Image.new("RGB", (4, 4), (128, 128, 255)).save(folder / "n.png")
    Image.new("L", (4, 4), 99).save(folder / "grey.png")


@for_each(
    ("mtl", "key", "expected"),
    [
        ("Kd .5 1 1\nmap_Kd maps/a b.png", "reflectance", {"texture": "maps/a b.png", "scale": (0.5, 1.0, 1.0)}),
        ("map_Kd maps\\a b.png", "reflectance", {"texture": "maps/a b.png", "scale": (1.0, 1.0, 1.0)}),
        (
            "map_Kd -s 2 3 1 -o .5 -clamp on -blendu on -mm 0 .5 grey.png",
            "reflectance",
            {"texture": "grey.png", "scale": (0.5, 0.5, 0.5), "wrap": ("clamp", "clamp")}
            | {"transform": {"scale": (2.0, 3.0), "offset": (0.5, 0.0)}},
        ),
        ("map_Kd -imfchan g grey.png", "reflectance", {"texture": "grey.png", "scale": (1, 1, 1), "channel": "g"}),
        ("d .5\nmap_d grey.png", "opacity", {"texture": "grey.png", "scale": (0.5,) * 3, "channel": "luminance"}),
        (
            "map_Kd grey.png\nmap_d grey.png",
            "opacity",
            {"texture": "grey.png", "scale": (1.0, 1.0, 1.0), "channel": "a"},
        ),
        ("norm -bm .5 n.png", "normal_map", {"texture": "n.png", "scale": 0.5}),
        ("map_Bump -bm 2 n.png", "normal_map", {"texture": "n.png", "scale": 2.0}),
        (
            "bump -bm 2 grey.png",
            "bump_map",
            {"texture": "grey.png", "scale": 0.02 * math.sqrt(2), "channel": "luminance"},
        ),
        (
            "bump -bm 2 -mm .3 1.5 grey.png",
            "bump_map",
            {"texture": "grey.png", "scale": 0.03 * math.sqrt(2), "channel": "luminance"},
        ),
        (
            "illum 4\nd .5\nmap_d grey.png",
            "opacity",
            {"texture": "grey.png", "scale": (1.0, 1.0, 1.0), "channel": "luminance"},
        ),
        (
            "Pr .5\nillum 4\nd .5\nmap_d grey.png",
            "opacity",
            {"texture": "grey.png", "scale": (1.0, 1.0, 1.0), "channel": "luminance"},
        ),
        ("Pr .5\nmap_Pr grey.png", "roughness", {"texture": "grey.png", "scale": (0.5,) * 3, "channel": "r"}),
        ("map_Pm grey.png", "metallic", {"texture": "grey.png", "scale": (1.0,) * 3, "channel": "r"}),
        (
            "Ks 0 0 0\nillum 2\nmap_Ks grey.png",
            "specular_color",
            {"texture": "grey.png", "scale": (1.0, 1.0, 1.0)},
        ),
    ],
)
def test_pictures(tmp_path: Path, mtl: str, key: str, expected: dict[str, Any]) -> None:
    pictures(tmp_path)
    found, _ = material(tmp_path, mtl)
    assert {k: v if isinstance(v, str | dict) else pytest.approx(v) for k, v in found[key].items()} == expected


def test_pictures_of_a_library_in_a_folder_lie_beside_it(tmp_path: Path) -> None:
    pictures(tmp_path)
    (tmp_path / "maps" / "x.mtl").write_text("newmtl a\nmap_Kd C:\\work\\a b.png\n")
    scene = load(tmp_path, f"mtllib maps/x.mtl\n{SQUARE}usemtl a\n{FACE}")
    assert scene.texture_files()[0][1].texture == "maps/a b.png"
    assert '"C:\\\\work\\\\a b.png" is not there: "maps/a b.png" is taken' in said(scene)


def test_emission_of_a_picture(tmp_path: Path) -> None:
    pictures(tmp_path)
    _, emission = material(tmp_path, "Ke 2 2 2\nmap_Ke grey.png")
    assert emission.texture == "grey.png" and emission.scale == (2.0, 2.0, 2.0)


def test_faces_without_texture_coordinates(tmp_path: Path) -> None:
    pictures(tmp_path)
    scene = load(tmp_path, f"mtllib m.mtl\n{SQUARE}usemtl a\nf 1 2 3\n", "newmtl a\nmap_Kd grey.png\n")
    assert "have no texture coordinates" in said(scene) and flatten(scene, 8, 8).triangle_count == 1


# --- what is said of the rest -----------------------------------------------------------------------------------------


@for_each(
    ("obj", "mtl", "expected"),
    [
        ("mtllib none.mtl\nusemtl a\n", None, 'line 1: "none.mtl" does not exist'),
        ("mtllib ../none.mtl\n", None, '"../none.mtl" lies outside the scene\'s own folder'),
        ("mtllib m.mtl\nusemtl b\n", "newmtl a\n", 'the material "b" is in no library'),
        ("mtllib m.mtl\nusemtl a\n", "newmtl a\nmap_Kd no.png\n", '"no.png" does not exist'),
        ("mtllib m.mtl\nusemtl a\n", "newmtl a\nmap_Kd m.mtl\n", "is left out: pictures may be .png"),
        ("mtllib m.mtl\nusemtl a\n", "newmtl a\nsharpness 60\n", '"sharpness" of materials is not read'),
        ("mtllib m.mtl\nusemtl a\n", "newmtl a\nKd 2 1 1\n", "has Kd 2 1 1: held between 0 and 1"),
        ("mtllib m.mtl\nusemtl a\n", "newmtl a\nd 1\nTr 1\n", "contradict each other: d counts"),
        ("mtllib m.mtl\nusemtl a\n", "newmtl a\nillum 77\n", "has illum 77, which is not known"),
        ("mtllib m.mtl\nusemtl a\n", "newmtl a\nNi .5\nillum 7\n", "has Ni 0.5, which is no index"),
        ("mtllib m.mtl\nusemtl a\n", "newmtl a\nTf 1 0 0\n", "has Tf, which is read of glass"),
        ("mtllib m.mtl\nusemtl a\n", "newmtl a\nmap_Kd -boost 2 g.png\n", "the option -boost of pictures is not read"),
        ("mtllib m.mtl\nusemtl a\n", "newmtl a\nmap_Kd -mm .5 1 g.png\n", "the base 0.5 of -mm is not added"),
        ("mtllib m.mtl\nusemtl a\n", "newmtl a\nnorm -mm 0 .5 g.png\n", "-mm is not read of normal maps"),
        ("mtllib m.mtl\nusemtl a\n", "newmtl a\nillum 7\nmap_d g.png\n", "has a picture of d, which glass"),
        ("mtllib m.mtl\nusemtl a\n", "newmtl a\nillum 7\nmap_Kd g.png\n", "has a picture of Kd, which is not read"),
        ("l 1 2\nl 2 3\n", None, '2 lines with "l", lines, not read'),
        ("curv 0 1\n", None, '1 line with "curv", curves, not read'),
        ("v 0 0 0 1 1 1\n", None, "some vertices have colours and others have none"),
    ],
)
def test_notes(tmp_path: Path, obj: str, mtl: str | None, expected: str) -> None:
    Image.new("L", (4, 4), 99).save(tmp_path / "g.png")
    scene = load(tmp_path, obj + SQUARE + FACE, mtl)
    assert expected in said(scene), said(scene)
    assert all(note.startswith(f"{tmp_path}/m.obj: ") and note.count(str(tmp_path)) == 1 for note in scene.notes)


@for_each(
    ("obj", "mtl", "expected"),
    [
        ("usemtl a\nf 1 2 x\n", "", "line 11 is not a face"),
        ("usemtl a\nf 1 2 9\n", "", "line 11 has a face that names vertex 9"),
        ("v 1e13 0 0\nf -1 2 3\n", "", "is (1e+13, 0, 0), but must be"),
        (FACE, "Kd 1 1 1\n", '"m.mtl": line 1: "kd" stands before the first newmtl'),
        ("usemtl a\n" + FACE, "newmtl a\n\nKd 1 x 1\n", '"m.mtl": line 3: kd is "1 x 1", but must be'),
        ("usemtl a\n" + FACE, "newmtl a\nNs 1e999\nKs 1 1 1\n", 'line 2: ns is "1e999", but must be one number'),
        ("usemtl a\n" + FACE, "newmtl a\nmap_Kd -bm x.png\n", "line 2: -bm of map_kd must be followed by a number"),
        ("usemtl a\n" + FACE, "newmtl a\nmap_Kd -clamp on\n", "line 2: map_kd names no picture"),
        (FACE, "newmtl a\0\n", '"m.mtl" is no text file'),
    ],
)
def test_what_is_refused(tmp_path: Path, obj: str, mtl: str, expected: str) -> None:
    with pytest.raises(SceneError) as error:
        load(tmp_path, f"mtllib m.mtl\n{SQUARE}{obj}", mtl)
    assert expected in str(error.value) and "\n" not in str(error.value), str(error.value)


# --- shapes ----------------------------------------------------------------------------------------------------------


def meshes(scene: Scene) -> list[MeshData]:
    return [scene.mesh(index) for index in range(len(scene.shapes))]


def test_a_shape_for_each_material_of_each_object(tmp_path: Path) -> None:
    text = (
        f"mtllib m.mtl\n{SQUARE}o one\nusemtl a\nf 1 2 3\nusemtl b\nf 1 3 4\ng x\nusemtl a\nf 2 3 4\no two\nf 4 3 2\n"
    )
    scene = load(tmp_path, text, "newmtl a\nKd 1 0 0\nnewmtl b\nKd 0 1 0\nnewmtl c\nKd 0 0 1\n")
    assert sorted(scene.materials) == ["a", "b"]
    found = [(shape.material, len(mesh.triangles)) for shape, mesh in zip(scene.shapes, meshes(scene), strict=True)]
    assert sorted(found) == [("a", 1), ("a", 2), ("b", 1)]
    one = next(mesh for mesh in meshes(scene) if len(mesh.triangles) == 2)
    np.testing.assert_array_equal(
        one.vertices[one.triangles][:, :, :2], [[[0, 0], [1, 0], [1, 1]], [[1, 0], [1, 1], [0, 1]]]
    )


def test_names_with_blanks_and_long_ones(tmp_path: Path) -> None:
    long = "x" * 300
    text = f"mtllib m.mtl\n{SQUARE}usemtl my red\nf 1 2 3\nusemtl {long}1\nf 1 3 4\nusemtl {long}2\nf 2 3 4\n"
    scene = load(tmp_path, text, f"newmtl my red\nKd 1 0 0\nnewmtl {long}1\nKd 1 0 0\nnewmtl {long}2\nKd 0 1 0\n")
    assert len(scene.materials) == 3 and "my red" in scene.materials and not any("library" in n for n in scene.notes)


def test_faces_with_and_without_normals(tmp_path: Path) -> None:
    scene = load(tmp_path, f"{SQUARE}vn 0 0 1\nf 1//1 2//1 3//1\nf 1 3 4\n")
    assert [mesh.normals is not None for mesh in meshes(scene)] == [False, True]


def test_smoothing_groups(tmp_path: Path) -> None:
    roof = "v 0 0 0\nv 1 0 0\nv 1 1 1\nv 0 1 1\nv 1 2 0\nv 0 2 0\n"
    flat = flatten(load(tmp_path, f"{roof}f 1 2 3 4\nf 4 3 5 6\n"), 8, 8)
    assert len(flat.arrays["normals"]) == 1
    smooth = meshes(load(tmp_path, f"{roof}s 1\nf 1 2 3 4\nf 4 3 5 6\n"))[0]
    apart = meshes(load(tmp_path, f"{roof}s 1\nf 1 2 3 4\ns 2\nf 4 3 5 6\n"))[0]
    off = meshes(load(tmp_path, f"{roof}s 1\nf 1 2 3 4\ns off\nf 4 3 5 6\nf 6 5 3\n"))[0]
    assert smooth.normals is not None and not smooth.normals.any()
    assert [len(mesh.vertices) for mesh in (smooth, apart, off)] == [6, 8, 4 + 4 + 3]


@pytest.mark.parametrize("between", ["usemtl b\n", "o x\n", "usemtl b\ns off\nf 1 2 5\ns 1\no y\n"])
def test_smoothing_groups_go_on_across_materials_and_objects(tmp_path: Path, between: str) -> None:
    roof = "mtllib m.mtl\nusemtl a\nv 0 0 0\nv 1 0 0\nv 1 1 1\nv 0 1 1\nv 1 3 0\nv 0 3 0\ns 1\nf 1 2 3 4\n"
    mtl = "newmtl a\nnewmtl b\n"

    def ridge(scene: Scene) -> set[tuple[float, ...]]:
        """Normals of the smooth meshes at the corners of height 1."""
        found = set()
        for index, mesh in enumerate(meshes(scene)):
            if mesh.normals is not None:
                normals = np.empty(mesh.normals.shape, np.float32)
                vertices = mesh.vertices.astype(np.float32)
                placed_normals(
                    mesh.normals, affine(scene.shapes[index].transform), vertices, mesh.triangles, normals, flip=False
                )
                found |= set(map(tuple, normals[vertices[:, 2] == 1.0].tolist()))
        return found

    whole = ridge(load(tmp_path, f"{roof}f 4 3 5 6\n", mtl))
    parts = load(tmp_path, f"{roof}{between}f 4 3 5 6\n", mtl)
    assert len(parts.shapes) == 1 + len(re.findall("usemtl|o ", between)) and len(whole) == 2
    assert ridge(parts) == whole
    # Corners that no other mesh has are left to the mesh
    assert sum(int((~mesh.normals.any(axis=1)).sum()) for mesh in meshes(parts) if mesh.normals is not None) == 4


def test_colours_of_vertices(tmp_path: Path) -> None:
    text = "v 0 0 0 1 0 0\nv 1 0 0 0 1 0\nv 0 1 0 0 0 1\nf 1 2 3\n"
    scene = load(tmp_path, text)
    shape = scene.shapes[0]
    assert isinstance(shape, Mesh) and shape.vertex_colors == "linear"
    np.testing.assert_array_equal(meshes(scene)[0].colors, np.eye(3)[None])
    assert shape.material is not None and scene.materials[shape.material].reflectance == (1, 1, 1)  # type: ignore[union-attr]
    assert "colours of vertices are not all from 0 to 1" in said(
        load(tmp_path, text.replace("1 0 0\nv 1", "2 0 0\nv 1"))
    )


def test_many_objects_become_one_shape_for_each_material(tmp_path: Path) -> None:
    scene = load(tmp_path, SQUARE + "".join(f"o {i}\nf 1 2 3\n" for i in range(5000)))
    assert len(scene.shapes) == 1 and "5000 parts of objects are too many" in said(scene)


# --- the quick way and the other --------------------------------------------------------------------------------------


def same(first: MeshData, second: MeshData) -> bool:
    arrays = [
        (getattr(first, name), getattr(second, name)) for name in ("vertices", "triangles", "normals", "uvs", "colors")
    ]
    return all((a is None) == (b is None) and (a is None or a.tobytes() == b.tobytes()) for a, b in arrays)


@pytest.mark.parametrize("corner", ["{0}", "{0}/{1}", "{0}//{2}", "{0}/{1}/{2}", "{0}/", "{0}/{1}/"])
@pytest.mark.parametrize("size", [3, 4, 6])
def test_lines_written_alike_are_read_as_others_are(tmp_path: Path, corner: str, size: int) -> None:
    rng = np.random.default_rng(7)
    values = np.concatenate([rng.normal(size=1200), [-0.0, 0.0, 1e-7, -12345.678901, 0.1, 1 / 3]])
    rows = values.reshape(-1, 3)
    lines = [f"v {x:.6f} {y:.9f} {z:.2f}" for x, y, z in rows.tolist()]
    lines += [f"vt {x:.4f} {y:.4f}" for x, y, _ in rows.tolist()]
    lines += [f"vn {x:.3f} {y:.3f} {z:.3f}" for x, y, z in rows.tolist()]
    faces = rng.integers(1, len(rows) + 1, (500, size, 3))
    lines += ["f " + " ".join(corner.format(*corners) for corners in face) for face in faces.tolist()]
    (tmp_path / "a.obj").write_text("\n".join(lines) + "\n")
    (tmp_path / "b.obj").write_text("".join(f"{line} \n" for line in lines))  # the blank is another form
    assert same(read_mesh("a.obj", tmp_path, (), "x"), read_mesh("b.obj", tmp_path, (), "x"))


@for_each(
    "line",
    [
        "f 1 2 0",
        "f 1 2 3x",
        "v 1.0 2.0 .",
        "v 1.0 2.0 -.",
        "v 1.0 2.0",
        "v 1.0 2.0 3-.0",
    ],
)
def test_a_wrong_line_among_many_alike(tmp_path: Path, line: str) -> None:
    text = "v 0.0 1.0 2.0\n" * 600 + "f 1 2 3\n" * 600
    at = 300 if line[0] == "v" else 900
    lines = text.splitlines()
    (tmp_path / "m.obj").write_text("\n".join([*lines[:at], line, *lines[at:]]) + "\n")
    with pytest.raises(SceneError, match=f"line {at + 1} "):
        read_mesh("m.obj", tmp_path, (), "x")


def test_a_number_that_is_not_finite_among_many_alike(tmp_path: Path) -> None:
    lines = ["v 0.0 1.0 2.0"] * 600 + ["f 1 2 3"] * 600
    lines[300], lines[900] = "v 1. 2. nan", "f 1 301 3"
    (tmp_path / "m.obj").write_text("\n".join(lines) + "\n")
    mesh = read_mesh("m.obj", tmp_path, (), "x")
    assert mesh.warning.startswith("line 301 has a number that is not finite") and mesh.left_out == 1
    assert len(mesh.triangles) == 599 and np.isfinite(mesh.vertices).all()


def test_many_statements_beside_one_continued_line(tmp_path: Path) -> None:
    """Their lines are counted at once: one by one they would take minutes."""
    text = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 \\\n3\n" + "s 1\ns 2\n" * 20_000 + "mtllib none.mtl\n"
    begun = time.process_time()
    assert 'line 40006: "none.mtl" does not exist' in said(load(tmp_path, text))
    assert time.process_time() - begun < 5.0
    scene = load(tmp_path, SQUARE + "".join(f"usemtl m{i}\nf 1 2 3\n" for i in range(3000)))
    assert len(scene.shapes) == 1 and "2984 more materials are in no library" in said(scene)


# --- faults that are forgiven ----------------------------------------------------------------------------------------


@for_each(
    ("wrong", "words"),
    [
        ("f 1 2 9999", "names vertex 9999, but only"),
        ("f 1 2 99999999999999999", "names vertex 99999999999999999, but only"),
        ("f -9999 2 1", "names vertex -9999, which the file does not hold"),
        ("f 1 2", "is not a face of 3 or more vertex indices"),
        ("f", "is not a face of 3 or more vertex indices"),
    ],
)
def test_faces_that_cannot_be_drawn_are_left_out(tmp_path: Path, wrong: str, words: str) -> None:
    """Alone or among many, between objects, and by `strict` they refuse the file."""
    many = "v 0.0 1.0 2.0\nv 1.0 1.0 2.0\nv 0.0 2.0 2.0\n" * 200 + "o a\n" + "f 1 2 3\n" * 300
    for text in (f"{SQUARE}o a\nf 1 2 3\nf 1 3 4\n", many):
        sound = load(tmp_path, text + "o b\nf 1 2 3\n")
        scene = load(tmp_path, f"{text}{wrong}\no b\n{wrong}\nf 1 2 3\n")
        assert scene.sha256() == sound.sha256() and [each.name for each in scene.shapes] == ["a", "b"]
        assert words in said(scene) and "such faces are left out" in said(scene)
    mesh = read_mesh("m.obj", tmp_path, (), "x")
    assert "such faces are left out" in mesh.warning and len(mesh.triangles) == 301
    with pytest.raises(SceneError, match=r"m\.obj: line \d+ "):
        clrender.load(tmp_path / "m.obj", strict=True)


def test_corners_without_normals_have_that_of_their_face(tmp_path: Path) -> None:
    text = SQUARE + "vn 0 0 1\n"
    some = load(tmp_path, f"{text}f 1//1 2//1 3\n")
    assert "got that of their face" in meshes(some)[0].warning
    normals = meshes(some)[0].normals
    assert normals is not None and (np.abs(normals).sum(axis=1) == 0.0).any()
    bad = load(tmp_path, f"{text}f 1//1 2//1 3//7\n")
    assert bad.sha256() == some.sha256() and "names normal 7, but only 1 are in the file" in said(bad)


def test_what_follows_a_position_need_not_be_a_colour(tmp_path: Path) -> None:
    scene = load(tmp_path, "v 0 0 0 1 0 0\nv 1 0 0 nan nan nan\nv 0 1 0 1 0 0\nf 1 2 3\n")
    assert scene.sha256() == load(tmp_path, "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n").sha256()


def test_the_old_word_for_faces(tmp_path: Path) -> None:
    assert load(tmp_path, SQUARE + "fo 1 2 3\n").sha256() == load(tmp_path, SQUARE + "f 1 2 3\n").sha256()


def test_a_material_without_a_name_and_one_by_a_spectrum(tmp_path: Path) -> None:
    scene = load(tmp_path, f"mtllib m.mtl\n{SQUARE}usemtl\nf 1 2 3\n", "newmtl \nKd 0.8 0 0\n")
    assert next(iter(scene.materials)) == "unnamed"
    scene = load(tmp_path, f"mtllib m.mtl\n{SQUARE}usemtl a\nf 1 2 3\n", "newmtl a\nKd spectral x.rfl 1\n")
    assert "has a Kd by a spectrum (.rfl), which is not read" in said(scene)


def test_tr_of_one_without_d_means_opaque(tmp_path: Path) -> None:
    scene = load(tmp_path, f"mtllib m.mtl\n{SQUARE}usemtl a\nf 1 2 3\n", "newmtl a\nKd 1 0 0\nTr 1\n")
    assert "Tr 1 without d" in said(scene) and scene.materials["a"].opacity == 1.0


def test_decimal_commas(tmp_path: Path) -> None:
    text = "v 0.5 0.0 -1.25\nv 1.5 0.0 0.0\nv 0.0 1.0 1e1\nvt 0.5 0.0\nvt 0.25 1.0\nvt 0.0 0.0\nf 1/1 2/2 3/3\n"
    scene = load(tmp_path, text.replace(".", ","))
    assert scene.sha256() == load(tmp_path, text).sha256()
    assert "its commas are read as decimal points" in said(scene)
    assert scene.faults == {"forgiven": 1, "left_out": 0}
    load(tmp_path, text.replace(".", ","))
    assert "its commas are read as decimal points" in read_mesh("m.obj", tmp_path, (), "x").warning
    with pytest.raises(SceneError, match="line 1 is not a position"):
        clrender.load(tmp_path / "m.obj", strict=True)


@for_each(
    "line",
    ["v 0,0 0,0", "v 0,0 0,0 0.5", "v 0,0,0 0 0", "v 0,0 0,0 0,0 0,0", "v 0,x 0,0 0,0", "v , , ,"],
)
def test_commas_that_may_be_separators_are_refused(tmp_path: Path, line: str) -> None:
    with pytest.raises(SceneError, match="line 1 is not a position"):
        load(tmp_path, f"{line}\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
