"""Textures on the host: what a scene may say, files that are broken, hashes, memory, and texture coordinates."""

from __future__ import annotations

import io
import os
import subprocess
import sys
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cases import for_each
from PIL import Image
from special_files import special

import clrender
from clrender.errors import SceneError
from clrender.flatten.emission_means import EmissionMeans
from clrender.flatten.flat_scene import flatten
from clrender.image.files import write_image
from clrender.image.texel_tiles import TILE_BYTES, tile_shape
from clrender.meshes.read import read_mesh
from clrender.rendering.job import RenderJob
from clrender.scene import Scene
from clrender.scene.pictures import TexelStore
from clrender.scene.portable import scene_from_portable, scene_to_portable
from clrender.scene.textures import ImageTexture

ROOT = Path(__file__).resolve().parents[2]
CAMERA = {"position": [0, 0, 5], "target": [0, 0, 0]}
RNG = np.random.default_rng(730)
COLORS = RNG.integers(0, 256, (9, 6, 3), np.uint8)


def lambert(reflectance: Any, **more: Any) -> dict[str, Any]:
    return {"type": "lambert", "reflectance": reflectance, **more}


def scene(folder: Path, *shapes: dict[str, Any], **materials: Any) -> Scene:
    return Scene(camera=CAMERA, shapes=shapes, materials=materials).placed("s.toml", folder)


# --- what may be said -------------------------------------------------------------------------------------------------


@for_each(
    ("reflectance", "expected"),
    [
        ([0.5, 0.5], "materials.m.reflectance has only 2 entries, but must have 3"),
        ([0.5, 2.0, 0.5], "materials.m.reflectance[1] is 2.0, but must be at most 1"),
        ("a.png", "materials.m.reflectance is the text"),
        ({"texture": 3}, "materials.m.reflectance.texture is 3, but must be a text"),
        ({"textur": "a.png"}, 'materials.m.reflectance.textur is an unknown key; did you mean "texture"?'),
        ({"texture": "a.png", "wrap": "repaet"}, 'reflectance.wrap[0] is "repaet", which is not known; did you mean'),
        ({"texture": "a.png", "wrap": ["clamp"]}, "reflectance.wrap has only one entry, but must have 2"),
        ({"texture": "a.png", "uv_set": 2}, "reflectance.uv_set is 2, but must be one of 0, 1"),
        ({"texture": "a.png", "scale": [1, 2]}, "reflectance.scale has only 2 entries, but must have 3"),
        ({"texture": "a.png", "transform": {"scale": 1e9}}, "transform.scale[0] is 1000000000.0, but must be at most"),
        ({"checker": [[0, 0, 0]]}, "materials.m.reflectance.checker has only one entry, but must have 2"),
        ({"checker": [0, 1], "size": 0}, "materials.m.reflectance.size[0] is 0, but must be greater than 0"),
        ({"ramp": [0.5]}, "materials.m.reflectance.ramp has too few entries; at least 2 would be right"),
        ({"ramp": [0.5, -1]}, "materials.m.reflectance.ramp[1][0] is -1, but must be at least 0"),
    ],
)
def test_bad_textures(reflectance: Any, expected: str) -> None:
    with pytest.raises(SceneError) as error:
        Scene(camera=CAMERA, materials={"m": lambert(reflectance)})
    assert str(error.value).startswith("Scene: ") and expected in str(error.value), str(error.value)


@for_each(
    ("emission", "expected"),
    [
        ([1.0, -1.0, 1.0], "shapes[0].emission[1] is -1.0, but must be at least 0"),
        ("a.png", "shapes[0].emission is the text"),
        ({"texture": 3}, "shapes[0].emission.texture is 3, but must be a text"),
        ({"textur": "a.png"}, 'shapes[0].emission.textur is an unknown key; did you mean "texture"?'),
        ({"checker": [1, -1]}, "shapes[0].emission.checker[1][0] is -1, but must be at least 0"),
    ],
)
def test_bad_emissions(emission: Any, expected: str) -> None:
    with pytest.raises(SceneError) as error:
        Scene(camera=CAMERA, shapes=[{"type": "sphere", "radius": 1, "emission": emission}])
    assert expected in str(error.value), str(error.value)


def test_pictures_that_are_no_radiance(tmp_path: Path) -> None:
    write_image(tmp_path / "dark.exr", np.full((3, 2, 3), -0.5))
    write_image(tmp_path / "sun.exr", np.full((3, 2, 3), 1e6))
    write_image(tmp_path / "p.exr", np.ones((3, 2, 3)))
    for emission, expected in (
        ({"texture": "none.png"}, r's.toml: shapes\[0\].emission.texture: "none.png" does not exist'),
        ({"texture": "dark.exr"}, r"s.toml: shapes\[0\].emission: the picture holds -0.5, but radiance is at least 0"),
        ({"texture": "sun.exr", "scale": 1e7}, r"shapes\[0\].emission: makes a radiance of 1e\+13; at most 1e\+12"),
        ({"texture": "p.exr", "color_space": "srgb"}, r's.toml: shapes\[0\].emission.color_space is "srgb", but the p'),
    ):
        with pytest.raises(SceneError, match=expected):
            flatten(scene(tmp_path, {"type": "sphere", "radius": 1, "emission": emission}), 8, 8)
    glow = {"type": "principled", "emission": {"texture": "dark.exr"}, "emission_strength": 2.0}
    with pytest.raises(SceneError, match=r"s.toml: materials.glow.emission: the picture holds -1, but radiance is"):
        flatten(scene(tmp_path, {"type": "sphere", "radius": 1, "material": "glow"}, glow=glow), 8, 8)
    corners = {"vertices": [[0, 0, 0], [1, 0, 0], [0, 1, 0]], "faces": [[0, 1, 2]]}
    with pytest.raises(SceneError, match=r"shapes\[0\] has no texture coordinates, which its emission needs; export"):
        flatten(scene(tmp_path, {"type": "mesh", **corners, "emission": {"texture": "p.exr"}}), 8, 8)
    with pytest.raises(SceneError, match=r"shapes\[0\].emission is a texture, which the integrator radiosity does not"):
        what = scene(tmp_path, {"type": "sphere", "radius": 1, "emission": {"checker": [0, 1]}})
        RenderJob.of(what, integrator="radiosity")


def test_one_emission_and_none_in_mixtures() -> None:
    glow = {"type": "principled", "emission": {"checker": [0, 1]}}
    ball = {"type": "sphere", "radius": 1, "material": "glow"}
    expected = r"shapes\[0\].emission is given beside materials.glow.emission; keep one of them"
    with pytest.raises(SceneError, match=expected):
        Scene(camera=CAMERA, shapes=[{**ball, "emission": [1, 1, 1]}], materials={"glow": glow})
    Scene(
        camera=CAMERA, shapes=[{**ball, "emission": [1, 1, 1]}], materials={"glow": {**glow, "emission_strength": 0.0}}
    )
    mixed = {"type": "mix", "materials": ["glow", "glow"]}
    with pytest.raises(
        SceneError, match=r'materials.m.materials\[0\] names "glow", which has emission; in a mixture it'
    ):
        Scene(camera=CAMERA, materials={"glow": glow, "m": mixed})
    bright = {"type": "principled", "emission": [0, 1e9, 0], "emission_strength": 1e4}
    with pytest.raises(SceneError, match=r"materials.m.emission_strength makes a radiance of 1e\+13; at most 1e\+12"):
        Scene(camera=CAMERA, materials={"m": bright})


def test_emission_travels_with_the_scene(tmp_path: Path) -> None:
    """To another process, and into the scene's hash: by the pixels, not by the name of the file."""
    Image.fromarray(COLORS).save(tmp_path / "a.png")
    Image.fromarray(COLORS).save(tmp_path / "b.png")
    Image.fromarray(COLORS[::-1]).save(tmp_path / "c.png")

    def lamps(name: str) -> Scene:
        glow = {"type": "principled", "emission": {"texture": name}, "emission_strength": 2.0}
        balls = [{"type": "sphere", "radius": 1, "emission": {"texture": name}}, {"type": "sphere", "radius": 2}]
        return scene(tmp_path, balls[0], {**balls[1], "material": "glow"}, glow=glow)

    assert lamps("a.png").sha256() == lamps("b.png").sha256() != lamps("c.png").sha256()
    sent = scene_from_portable(*scene_to_portable(lamps("a.png")))
    assert flatten(sent, 8, 8).sha256 == flatten(lamps("a.png"), 8, 8).sha256
    # One row for each strength, after those of materials
    lights = flatten(sent, 8, 8).arrays["lights"]
    assert lights["texture"].tolist() == [1, 2]
    np.testing.assert_allclose(lights["radiance"][1, :3], 2.0 * lights["radiance"][0, :3], rtol=1e-6)


def test_linear_light_is_not_srgb(tmp_path: Path) -> None:
    write_image(tmp_path / "a.exr", np.ones((2, 2, 3)))
    what = scene(tmp_path, m=lambert({"texture": "a.exr", "color_space": "srgb"}))
    with pytest.raises(
        SceneError, match=r's.toml: materials.m.reflectance.color_space is "srgb", but the picture hold'
    ):
        flatten(what, 8, 8)


# --- files ------------------------------------------------------------------------------------------------------------


def png(width: int, height: int, rows: bytes, color: int = 0) -> bytes:
    """A PNG by hand: of 8 bits, grey or RGB."""

    def chunk(kind: bytes, data: bytes) -> bytes:
        return len(data).to_bytes(4, "big") + kind + data + zlib.crc32(kind + data).to_bytes(4, "big")

    head = width.to_bytes(4, "big") + height.to_bytes(4, "big") + bytes([8, color, 0, 0, 0])
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", rows) + chunk(b"IEND", b"")


def good_png() -> bytes:
    file = io.BytesIO()
    Image.fromarray(COLORS).save(file, "PNG")
    return file.getvalue()


def bad_exr(folder: Path) -> bytes:
    image = np.ones((3, 4, 3), np.float32)
    image[1, 2, 0] = np.nan
    write_image(folder / "bad.exr", image)
    return (folder / "bad.exr").read_bytes()


BAD: dict[str, tuple[str, Callable[[Path], bytes | None], str]] = {
    "missing": ("a.png", lambda _: None, "does not exist"),
    "empty": ("a.png", lambda _: b"", "is empty; it must hold a picture"),
    "truncated": ("a.png", lambda _: good_png()[:-60], "is no sound picture"),
    "no header": ("a.png", lambda _: b"\x89PNG\r\n\x1a\n", "is no sound picture"),
    "damaged": ("a.png", lambda _: png(40, 40, b"nothing that deflates"), "is no sound picture"),
    "text": ("a.jpg", lambda _: b"a text", "it is neither a PNG nor a JPEG"),
    "no jpeg": ("a.jpg", lambda _: b"\xff\xd8\xff", "is no sound picture"),
    "no webp": ("a.webp", lambda _: b"RIFF\x10\0\0\0WEBPVP8 ", "is no sound picture"),
    "no exr": ("a.exr", lambda _: b"v/1\x01 and nothing", "is no sound picture"),
    "no hdr": ("a.hdr", lambda _: b"#?RADIANCE\n\n-Y 3 +X x\n", "its size is not given as -Y height +X width"),
    "kind": ("a.psd", lambda _: b"8BPS", "is of no kind that can be read; textures may be .png .jpg"),
    "not a number": ("a.exr", bad_exr, "its pixel (2, 1) is no finite number"),
    "bomb": (
        "a.png",
        lambda _: png(20000, 20000, bytes(400_000)),
        "it has 20000 x 20000 pixels, but at most 268,435,456 are read",
    ),
    "promise": ("a.png", lambda _: png(16000, 16000, b"x"), "too small for the size its header gives"),
    "huge": ("a.png", lambda _: png(2**31 - 1, 2**31 - 1, b"x"), "pixels are not between 1 and"),
    "huge hdr": ("a.hdr", lambda _: b"#?RADIANCE\n\n-Y 999999999 +X 999999999\n", "pixels are not between 1 and"),
}


@for_each("name", BAD)
def test_bad_files(tmp_path: Path, name: str) -> None:
    """One sentence, with the place and the file, and little memory taken."""
    file, content, expected = BAD[name]
    data = content(tmp_path)
    if data is not None:
        (tmp_path / file).write_bytes(data)
    what = scene(tmp_path, m=lambert([0.5] * 3, normal_map={"texture": file}))
    with pytest.raises(SceneError) as error:
        what.textures()
    text = str(error.value)
    assert text.startswith(f's.toml: materials.m.normal_map.texture: "{file}" ') and expected in text, text
    assert "\n" not in text and len(text) < 400


def test_files_are_read_from_the_folder_of_the_scene_only(tmp_path: Path) -> None:
    (tmp_path / "inside").mkdir()
    (tmp_path / "a.png").write_bytes(good_png())
    (tmp_path / "inside" / "link.png").symlink_to(tmp_path / "a.png")
    for name in ("../a.png", str(tmp_path / "a.png"), "link.png", "../none.png"):
        with pytest.raises(SceneError, match="lies outside the scene's own folder; move it there or allow its folder"):
            scene(tmp_path / "inside", m=lambert({"texture": name})).textures()
    allowed = scene(tmp_path, m=lambert({"texture": "../a.png"})).placed("s", tmp_path / "inside", [tmp_path])
    assert allowed.textures().texels.shape == (6, 64)


@pytest.mark.parametrize("kind", ["pipe", "folder"])
def test_special_files(tmp_path: Path, kind: str) -> None:
    problem = pytest.raises(SceneError, match=r"materials\.m\.reflectance\.texture.*(only regular files|is a folder)")
    with special(tmp_path / "a.png", kind), problem:
        scene(tmp_path, m=lambert({"texture": "a.png"})).textures()


# --- texels -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("bits", range(5))
def test_tiles_fill_a_line_of_memory(bits: int) -> None:
    across, down = tile_shape(bits)
    assert across * down << bits == TILE_BYTES and across in (down, 2 * down)


def store(folder: Path, *names: str) -> TexelStore:
    return TexelStore([("here", ImageTexture(texture=name)) for name in names], folder, (), {}, {})


def test_a_picture_used_twice_is_stored_once(tmp_path: Path) -> None:
    Image.fromarray(COLORS).save(tmp_path / "a.png")
    Image.fromarray(COLORS).save(tmp_path / "b.webp", lossless=True, quality=0)
    (tmp_path / "c.png").symlink_to("a.png")
    Image.fromarray(COLORS[::-1]).save(tmp_path / "d.png")
    one = store(tmp_path, "a.png")
    same = store(tmp_path, "a.png", "b.webp", "a.png", "c.png")
    np.testing.assert_array_equal(one.texels, same.texels)
    assert len(set(same.pictures.values())) == 1
    assert len(store(tmp_path, "a.png", "d.png").texels) == 2 * len(one.texels)
    assert one.texels.ctypes.data % 4096 == 0


def test_a_copy_of_a_scene_may_have_other_textures(tmp_path: Path) -> None:
    """After the first one's files were read; neither forgets its own."""
    Image.fromarray(COLORS).save(tmp_path / "a.png")
    Image.fromarray(COLORS[::-1]).save(tmp_path / "b.png")
    first = scene(tmp_path, m=lambert({"texture": "a.png"}))
    store = first.textures()
    second = first.changed({"materials": scene(tmp_path, m=lambert({"texture": "b.png"})).materials})
    third = first.changed({"shapes": ()})
    assert list(second.textures().pictures) == ["b.png"]
    assert first.textures() is store and third.textures() is store
    assert first.content_sha256() != second.content_sha256()


def test_a_hash_looks_for_textures_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """And not for each shape that has one: ten thousand shapes would take minutes."""
    emission = {"checker": [0.5, 2.0], "size": 0.5}
    write_image(tmp_path / "a.exr", np.ones((2, 2, 3), np.float32))
    shapes = [{"type": "sphere", "radius": 1.0, "emission": each} for each in 20 * [emission, {"texture": "a.exr"}]]
    lamps, looked, look = scene(tmp_path, *shapes), 0, Scene.placed_textures

    def counted(self: Scene) -> Any:
        nonlocal looked
        looked += 1
        return look(self)

    monkeypatch.setattr(Scene, "placed_textures", counted)
    lamps.sha256()
    assert 0 < looked <= 2


def test_lights_of_one_texture_are_averaged_together(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Once for all spheres, and for the triangles of all shapes; each with the mean that it has alone."""
    write_image(tmp_path / "a.exr", RNG.random((6, 9, 3)).astype(np.float32))
    shape = {"emission": {"texture": "a.exr"}}
    square = {"type": "quad", "origin": [0, 0, 0], "edge_u": [1, 0, 0], "edge_v": [0, 1, 0]}
    corners = {"vertices": [[0, 0, 0], [1, 0, 0], [0, 1, 0]], "faces": [[0, 1, 2]], "uvs": [[0, 0], [0.4, 0.1], [0, 3]]}
    kinds: list[dict[str, Any]] = [{"type": "sphere", "radius": 1.0}, square, {"type": "mesh", **corners}]
    alone = [flatten(scene(tmp_path, {**each, **shape}), 8, 8).arrays["lights"]["radiance"] for each in kinds]
    asked: list[str] = []

    def counted(name: str) -> Callable[..., Any]:
        ask = getattr(EmissionMeans, name)

        def asks(*given: Any) -> Any:
            asked.append(name)
            return ask(*given)

        return asks

    for name in ("sphere", "triangles"):
        monkeypatch.setattr(EmissionMeans, name, counted(name))
    lights = flatten(scene(tmp_path, *({**each, **shape} for each in kinds * 4)), 8, 8).arrays["lights"]
    assert sorted(asked) == ["sphere", "triangles"]
    assert np.array_equal(lights["radiance"], np.concatenate(alone * 4))


def test_hashes_follow_the_pixels(tmp_path: Path) -> None:
    Image.fromarray(COLORS).save(tmp_path / "a.png")
    Image.fromarray(COLORS).save(tmp_path / "b.png", compress_level=0)
    changed = COLORS.copy()
    changed[3, 2, 1] ^= 1
    Image.fromarray(changed).save(tmp_path / "c.png")
    scenes = [scene(tmp_path, m=lambert({"texture": name})) for name in ("a.png", "b.png", "c.png")]
    hashes = [each.sha256() for each in scenes]
    assert hashes[0] == hashes[1] != hashes[2]
    flats = [flatten(each, 8, 8).sha256 for each in scenes]
    assert flats[0] == flats[1] != flats[2]


def test_jobs_carry_their_pictures(tmp_path: Path) -> None:
    Image.fromarray(COLORS).save(tmp_path / "a.png")
    write_image(tmp_path / "n.exr", RNG.random((5, 7, 3)))
    material = lambert({"texture": "a.png", "wrap": "mirror"}, normal_map={"texture": "n.exr"})
    ball = {"type": "sphere", "radius": 1.0, "material": "m"}
    mesh = {"type": "mesh", "vertices": [[0, 0, 0], [1, 0, 0], [0, 1, 0]], "faces": [[0, 1, 2]], "material": "m"}
    mesh["uvs"] = [[0, 0], [1, 0], [0, 2]]
    job = RenderJob.of(scene(tmp_path, ball, mesh, m=material, z=lambert({"checker": [0, 1]})), size=(8, 8), spp=1)
    text, assets = job.to_json()
    assert len(assets) == 2
    for name in ("a.png", "n.exr"):
        (tmp_path / name).unlink()
    again = RenderJob.from_json(text, assets)
    assert again.sha256() == job.sha256()
    assert flatten(again.scene, 8, 8).sha256 == flatten(job.scene, 8, 8).sha256
    some = next(iter(assets))
    with pytest.raises(SceneError, match=f"the asset {some} is missing; send it along"):
        RenderJob.from_json(text, {name: data for name, data in assets.items() if name != some})
    other = {**assets, some: next(data for name, data in assets.items() if name != some)}
    with pytest.raises(SceneError, match="has another content than its hash says"):
        RenderJob.from_json(text, other)


@pytest.mark.long
def test_the_pictures_of_the_built_in_scene_are_those_of_their_script() -> None:
    script = ROOT / "scripts" / "make_textures.py"
    subprocess.run([sys.executable, str(script), "--check"], check=True)


# --- texture coordinates ----------------------------------------------------------------------------------------------

CHECKER = lambert({"checker": [0.1, 0.9]})


def corner_uvs(what: Scene, second: bool = False) -> np.ndarray:
    flat = flatten(what, 8, 8)
    first = 6 if second else 0
    return flat.arrays["attribute_rows"][: flat.triangle_count, first : first + 6].reshape(-1, 3, 2)


PLY = (
    "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n{}"
    "element face 1\nproperty list uchar int vertex_indices\nend_header\n"
)
POINTS = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)]
UVS = [(0.0, 0.5), (2.0, 0.25), (3.0, -1.0), (0.125, 4.0)]
SPLIT = np.array([[UVS[0], UVS[1], UVS[2]], [UVS[0], UVS[2], UVS[3]]])


@for_each("names", ["s t", "u v", "texture_u texture_v"])
@for_each("normals", [False, True])
def test_ply(tmp_path: Path, names: str, normals: bool) -> None:
    more = "".join(f"property float {name}\n" for name in [*(["nx", "ny", "nz"] if normals else []), *names.split()])
    middle = "0 0 1 " if normals else ""
    lines = [f"{x} {y} {z} {middle}{u} {v}" for (x, y, z), (u, v) in zip(POINTS, UVS, strict=True)]
    (tmp_path / "m.ply").write_text(PLY.format(more) + "\n".join([*lines, "4 0 1 2 3", ""]))
    what = scene(tmp_path, {"type": "mesh", "file": "m.ply", "material": "m"}, m=CHECKER)
    np.testing.assert_array_equal(corner_uvs(what), SPLIT.astype(np.float32))
    assert (read_mesh("m.ply", tmp_path, (), "here").normals is not None) == normals


@pytest.mark.parametrize("form", ["{0}/{1}", "{0}/{1}/1", "{0}/-{2}"])
def test_obj(tmp_path: Path, form: str) -> None:
    order = [2, 0, 3, 1]
    lines = [f"v {x} {y} {z}" for x, y, z in POINTS]
    lines += [f"vt {UVS[k][0]} {UVS[k][1]}{' 0.5' if form.endswith('1}') else ''}" for k in order]
    lines += ["vn 0 0 1", "f " + " ".join(form.format(k + 1, order.index(k) + 1, 4 - order.index(k)) for k in range(4))]
    (tmp_path / "m.obj").write_text("\n".join([*lines, ""]))
    what = scene(tmp_path, {"type": "mesh", "file": "m.obj", "material": "m"}, m=CHECKER)
    np.testing.assert_array_equal(corner_uvs(what), SPLIT.astype(np.float32))


def test_obj_with_some_coordinates(tmp_path: Path) -> None:
    text = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvt 1 2\nf 1/1 2/1 3/1\nf 1 3 4\nf 1/7 3/1 4/1\n"
    (tmp_path / "m.obj").write_text(text)
    mesh = read_mesh("m.obj", tmp_path, (), "here")
    assert mesh.uvs is not None and mesh.uvs.tolist()[1] == [[0, 0]] * 3 and mesh.uvs.tolist()[0] == [[1, 2]] * 3
    assert mesh.warning == "4 corners of faces have no texture coordinates, and got (0, 0)"


def test_meshes_without_coordinates(tmp_path: Path) -> None:
    mesh = {"type": "mesh", "vertices": POINTS[:3], "faces": [[0, 1, 2]], "material": "m"}
    with pytest.raises(SceneError, match=r"shapes\[0\] has no texture coordinates, which reflectance of the material"):
        flatten(scene(tmp_path, mesh, m=CHECKER), 8, 8)
    second = lambert({"checker": [0.1, 0.9], "uv_set": 1})
    with pytest.raises(SceneError, match=r"shapes\[0\] has no second set of texture coordinates \(uvs_1\), which"):
        flatten(scene(tmp_path, {**mesh, "uvs": UVS[:3]}, m=second), 8, 8)
    what = scene(tmp_path, {**mesh, "uvs": UVS[:3], "uvs_1": UVS[1:]}, m=second)
    assert corner_uvs(what, True).tolist() == [[list(each) for each in UVS[1:]]]
    with pytest.raises(SceneError, match=r"uvs has 2 entries, but the mesh has 3 vertices"):
        scene(tmp_path, {**mesh, "uvs": UVS[:2]})


@pytest.mark.parametrize("mirrored", [False, True])
@pytest.mark.parametrize("flip", [False, True])
def test_turned_triangles_keep_their_coordinates(tmp_path: Path, mirrored: bool, flip: bool) -> None:
    """u + 2 v = x + 2 y of the corner it belongs to, whatever order they come in; a flat triangle is left out."""
    mesh = {
        "type": "mesh",
        "vertices": [*POINTS, [5, 5, 0]],
        "faces": [[0, 1, 2], [4, 4, 4], [0, 2, 3]],
        "material": "m",
    }
    mesh["uvs"] = [[x, y] for x, y, _ in [*POINTS, (5, 5, 0)]]
    transform = {"scale": [-1.0, 1.0, 1.0]} if mirrored else {}
    flat = flatten(scene(tmp_path, {**mesh, "transform": transform, "flip_normals": flip}, m=CHECKER), 8, 8)
    corners = flat.arrays["vertices"][flat.arrays["triangles"]]
    assert len(corners) == 2
    uvs = flat.arrays["attribute_rows"][:, :6].reshape(-1, 3, 2)
    np.testing.assert_array_equal(uvs[..., 0], corners[..., 0] * (-1 if mirrored else 1))
    np.testing.assert_array_equal(uvs[..., 1], corners[..., 1])


def test_faces_of_a_box_show_the_picture_upright(tmp_path: Path) -> None:
    """u runs to the right and v upward as seen from outside; on top, v runs away from the viewer who looks along -z."""
    flat = flatten(scene(tmp_path, {"type": "box", "size": [2, 4, 6], "material": "m"}, m=CHECKER), 8, 8)
    corners = flat.arrays["vertices"][flat.arrays["triangles"]].astype(np.float64)
    uvs = flat.arrays["attribute_rows"][:, :6].reshape(-1, 3, 2).astype(np.float64)
    for at, uv in zip(corners, uvs, strict=True):
        normal = np.cross(at[1] - at[0], at[2] - at[0])
        normal /= np.linalg.norm(normal)
        map_ = np.linalg.solve((uv[1:] - uv[0]), (at[1:] - at[0]))  # rows: derivatives by u and v
        up = np.array([0, 1, 0]) if abs(normal[1]) < 0.5 else np.array([0, 0, -normal[1]])
        np.testing.assert_allclose(map_[1] / np.linalg.norm(map_[1]), up, atol=1e-12)
        np.testing.assert_allclose(np.cross(map_[0], map_[1]) / np.linalg.norm(np.cross(*map_)), normal, atol=1e-12)
        assert {*uv.ravel()} == {0.0, 1.0}


# --- memory -----------------------------------------------------------------------------------------------------------

LARGE = """
import resource, sys
import numpy as np
import clrender
image = clrender.render(clrender.load(sys.argv[1]), size=(32, 32), spp=4, device="pocl")
print(image.stats["peak_rss_bytes"], image.stats["device_bytes"], float(image.linear.mean()))
"""


@pytest.mark.slow
def test_large_pictures_take_less_than_twice_their_size(tmp_path: Path) -> None:
    """Four of 8192 x 8192 pixels, 3 bytes each, in a process of their own; what the process is without them counts."""
    side = 8192
    shapes, materials = [], []
    for number in range(4):
        noise = np.random.default_rng(number).integers(0, 256, (64, 64, 3), np.uint8)
        picture = np.tile(noise, (side // 64, side // 64, 1))
        picture[0, 0] = number
        Image.fromarray(picture).save(tmp_path / f"{number}.png", compress_level=1)
        materials.append(f'[materials.m{number}]\ntype = "lambert"\nreflectance = {{ texture = "{number}.png" }}\n')
        shapes.append(
            f'[[shapes]]\ntype = "sphere"\nradius = 0.5\ncenter = [{number - 1.5}, 0, 0]\nmaterial = "m{number}"\n'
        )
    camera = "[camera]\nposition = [0, 0, 5]\ntarget = [0, 0, 0]\n"
    light = '[[lights]]\ntype = "environment"\nradiance = [1, 1, 1]\n'
    (tmp_path / "s.toml").write_text("\n".join([camera, *materials, *shapes, light]))
    environment = {**os.environ, "PYTHONPATH": str(Path(clrender.__file__).parents[1])}
    command = [sys.executable, "-c", LARGE, str(tmp_path / "s.toml")]
    done = subprocess.run(command, capture_output=True, text=True, check=True, env=environment)
    peak, device, mean = (float(word) for word in done.stdout.split())
    raw = 4 * 3 * side * side
    print(
        f"peak {peak / 2**20:.0f} MiB, on the device {device / 2**20:.0f} MiB, raw {raw / 2**20:.0f} MiB, mean {mean}"
    )
    assert device >= 4 * 4 * side * side and mean > 0.0
    assert peak < 2 * raw
