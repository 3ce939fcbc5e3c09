"""Colours of vertices: what is read of which file, in which encoding, and what is refused."""

from __future__ import annotations

import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cases import for_each

from clrender.errors import SceneError
from clrender.flatten.flat_scene import flatten
from clrender.flatten.supported import check_materials
from clrender.image.tone_map import srgb_decode
from clrender.meshes.read import read_mesh
from clrender.rendering.job import RenderJob
from clrender.scene import Scene

POINTS = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)]
BYTES = np.array([[0, 10, 255], [1, 11, 128], [2, 128, 200], [99, 3, 77]])
FACES = [[0, 1, 2], [0, 2, 3]]
GREY = {"type": "lambert", "reflectance": [0.5] * 3}


def scene(folder: Path, *shapes: dict[str, Any], **materials: Any) -> Scene:
    camera = {"position": [0, 0, 5], "target": [0, 0, 0]}
    return Scene(camera=camera, shapes=shapes, materials={"m": GREY, **materials}).placed("here", folder)


def inline(**more: Any) -> dict[str, Any]:
    return {"type": "mesh", "vertices": POINTS, "faces": FACES, "material": "m", **more}


def ply(path: Path, kind: str, colors: np.ndarray, names: str = "red green blue", binary: bool = False) -> None:
    properties = "".join(f"property {kind} {name}\n" for name in [*names.split(), "alpha"])
    text = (
        f"ply\nformat {'binary_little_endian' if binary else 'ascii'} 1.0\nelement vertex 4\n"
        f"property float x\nproperty float y\nproperty float z\n{properties}"
        "element face 1\nproperty list uchar int vertex_indices\nend_header\n"
    )
    if binary:
        letter = {"uchar": "B", "float": "f"}[kind]
        rows = [struct.pack("<3f4" + letter, *p, *c, 0) for p, c in zip(POINTS, colors.tolist(), strict=True)]
        path.write_bytes(text.encode() + b"".join(rows) + struct.pack("<B4i", 4, 0, 1, 2, 3))
    else:
        lines = [" ".join(map(str, (*p, *c, 0))) for p, c in zip(POINTS, colors.tolist(), strict=True)]
        path.write_text(text + "\n".join([*lines, "4 0 1 2 3", ""]))


def corners(folder: Path, name: str, encoding: Any = "auto") -> np.ndarray:
    colors = read_mesh(name, folder, (), "here", encoding).colors
    assert colors is not None
    return colors


@pytest.mark.parametrize("binary", [False, True])
def test_ply(tmp_path: Path, binary: bool) -> None:
    """Bytes are sRGB and floats are linear, unless something else is said."""
    share = (BYTES / 255).astype(np.float32)
    ply(tmp_path / "b.ply", "uchar", BYTES, binary=binary)
    ply(tmp_path / "f.ply", "float", share, binary=binary)
    decoded = srgb_decode(BYTES / 255).astype(np.float32)
    for name, auto in (("b.ply", decoded), ("f.ply", share)):
        np.testing.assert_array_equal(corners(tmp_path, name), auto[FACES])
        np.testing.assert_array_equal(corners(tmp_path, name, "srgb"), decoded[FACES])
        np.testing.assert_allclose(corners(tmp_path, name, "linear"), share[FACES], rtol=1e-7)
    assert read_mesh("b.ply", tmp_path, (), "here").colors is None


def test_sixteen_bits(tmp_path: Path) -> None:
    ply(tmp_path / "m.ply", "ushort", BYTES * 257)
    np.testing.assert_array_equal(corners(tmp_path, "m.ply"), srgb_decode(BYTES / 255).astype(np.float32)[FACES])


def test_obj(tmp_path: Path) -> None:
    """Vertices that have several normals are repeated, and their colours with them; sRGB unless said."""
    lines = [f"v {x} {y} {z} {r:.6f} {g:.6f} {b:.6f}" for (x, y, z), (r, g, b) in zip(POINTS, BYTES / 255, strict=True)]
    faces = {"plain": ["f 1 2 3 4"], "normals": ["vn 0 0 1", "vn 0 1 1", "f 1//1 2//1 3//1", "f 1//2 3//2 4//2"]}
    for name, more in faces.items():
        (tmp_path / f"{name}.obj").write_text("\n".join([*lines, *more, ""]))
        decoded = srgb_decode(BYTES / 255).astype(np.float32)
        np.testing.assert_array_equal(corners(tmp_path, f"{name}.obj"), decoded[FACES])
        np.testing.assert_allclose(corners(tmp_path, f"{name}.obj", "linear"), (BYTES / 255)[FACES], atol=1e-6)
        assert read_mesh(f"{name}.obj", tmp_path, (), "here").colors is None


@pytest.mark.parametrize("mirrored", [False, True])
@pytest.mark.parametrize("flip", [False, True])
def test_turned_triangles_keep_their_colours(tmp_path: Path, mirrored: bool, flip: bool) -> None:
    """Red is x and green is y of the corner; a flat triangle is left out, a plain mesh and a sphere stand before."""
    mesh = inline(vertices=[*POINTS, [5, 5, 0]], faces=[[0, 1, 2], [4, 4, 4], [0, 2, 3]], flip_normals=flip)
    mesh["colors"] = [*POINTS, (0, 0, 0)]
    mesh["transform"] = {"scale": [-1.0, 1.0, 1.0]} if mirrored else {}
    flat = flatten(scene(tmp_path, {"type": "sphere", "radius": 1, "material": "m"}, inline(), mesh), 8, 8)
    rows = flat.arrays["attribute_rows"]
    numbers = rows.view(np.uint32)[:, 12]
    assert numbers.tolist() == [0, 0, 5, 6, 0, 0, 0] and rows.shape == (7, 16)
    at = flat.arrays["vertices"][flat.arrays["triangles"][2:]] * [-1 if mirrored else 1, 1, 1]
    np.testing.assert_array_equal(rows[5:, :9].reshape(-1, 3, 3), at)


def test_what_is_not_asked_for_changes_nothing(tmp_path: Path) -> None:
    ply(tmp_path / "m.ply", "uchar", BYTES)
    shape = {"type": "mesh", "file": "m.ply", "material": "m"}
    plain = flatten(scene(tmp_path, shape), 8, 8)
    assert not plain.arrays["attribute_rows"].any() and not plain.arrays["shapes"]["flags"].any()
    both = scene(tmp_path, shape, {**shape, "vertex_colors": "srgb"}, {**shape, "vertex_colors": "linear"})
    assert [both.mesh(i).colors is None for i in range(3)] == [True, False, False]
    assert len({both.mesh(i).sha256() for i in range(3)}) == 3


def test_jobs_carry_colours(tmp_path: Path) -> None:
    ply(tmp_path / "m.ply", "uchar", BYTES)
    shape = {"type": "mesh", "file": "m.ply", "material": "m"}
    what = scene(tmp_path, {**shape, "vertex_colors": "auto"}, shape, inline(colors=[[1, 0, 0]] * 4))
    job = RenderJob.of(what, size=(8, 8), spp=1)
    text, assets = job.to_json()
    again = RenderJob.from_json(text, assets)
    assert len(assets) == 2 and again.sha256() == job.sha256()
    assert flatten(again.scene, 8, 8).sha256 == flatten(job.scene, 8, 8).sha256


@for_each(
    ("more", "message"),
    [
        ({"colors": [[1, 0, 0]] * 3}, r"colors has 3 entries, but the mesh has 4 vertices"),
        ({"colors": [[1, 0, -0.5]] * 4}, r"colors\[0\]\[2\]"),
        ({"colors": [[1, float("nan"), 0]] * 4}, r"colors\[0\]\[1\]"),
        ({"colors": [[1, 2.0, 0]] * 4}, r"colors\[0\]\[1\]"),
        ({"vertex_colors": "auto"}, r"vertex_colors is for a `file`; an inline mesh has `colors`"),
        ({"colors": [[1, 0, 0]] * 4, "material": None}, r"colors is given, but the shape has no material"),
        (
            {"colors": [[1, 0, 0]] * 4, "material": "both"},
            r'would multiply the colour of the material "glass", which has none; give it one of reflectance, ',
        ),
    ],
)
def test_scenes_that_are_refused(tmp_path: Path, more: dict[str, Any], message: str) -> None:
    mix = {"type": "mix", "materials": ["m", "glass"]}
    with pytest.raises(SceneError, match=message) as error:
        scene(tmp_path, inline(**more), glass={"type": "dielectric", "ior": 1.5}, both=mix)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("value", [1.5, -0.25, float("nan"), float("inf")])
def test_colours_that_are_none(tmp_path: Path, value: float) -> None:
    colors = BYTES / 255
    colors[2, 1] = value
    ply(tmp_path / "m.ply", "float", colors)
    with pytest.raises(SceneError, match=r"vertex 2 has the colour \(.*\), but the numbers must be from 0 to 1$"):
        corners(tmp_path, "m.ply")


def test_files_that_are_refused(tmp_path: Path) -> None:
    ply(tmp_path / "int.ply", "int", BYTES)
    with pytest.raises(SceneError, match=r"has colours that are not all uchar, ushort or float; export them as uchar"):
        corners(tmp_path, "int.ply")
    ply(tmp_path / "none.ply", "uchar", BYTES, names="a b c")
    (tmp_path / "none.obj").write_text("v 0 0 0 1 0 0\nv 1 0 0 1\nv 0 1 0\nf 1 2 3\n")
    with pytest.raises(SceneError, match=r"has no colours of vertices .* leave vertex_colors out"):
        corners(tmp_path, "none.ply")
    with pytest.raises(SceneError, match=r'line 2 is not a position with a colour of 6 numbers: "v 1 0 0 1"'):
        corners(tmp_path, "none.obj")
    (tmp_path / "bytes.obj").write_text("v 0 0 0 255 0 0\nv 1 0 0 1 1 1\nv 0 1 0 0 0 0\nf 1 2 3\n")
    with pytest.raises(SceneError, match=r"vertex 0 has the colour \(255, 0, 0\), but the numbers must be from 0 to 1"):
        corners(tmp_path, "bytes.obj")


def test_radiosity_takes_none(tmp_path: Path) -> None:
    with pytest.raises(SceneError, match=r"shapes\[0\].colors: the integrator radiosity takes no colours of vertices"):
        check_materials(scene(tmp_path, inline(colors=[[1, 0, 0]] * 4)), "radiosity")
