"""Pictures of glTF files in KTX2: read by opengl-basisu in a process of its own, or left out with a note."""

from __future__ import annotations

import base64
import io
import re
import struct
import zlib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cases import for_each
from gltf_files import Model, picture_uri
from ktx2_files import ETC1S, ETC1S_BLOCKS, blocks_of, ktx2, plain, uastc, zstd

import clrender
from clrender.errors import SceneError
from clrender.image.pictures import open_picture
from clrender.importers.asset_files import AssetFiles
from clrender.importers.gltf import ktx2 as reader
from clrender.importers.gltf.decoding import decoded
from clrender.importers.gltf.reader import read
from clrender.scene import Scene

needs_basis = pytest.mark.skipif(not reader.basis_is_there(), reason="opengl-basisu is not installed: the extra gltf")
COLORS = np.random.default_rng(4).integers(0, 256, (3, 5, 4), np.uint8)
PIXELS = blocks_of(COLORS)
UASTC = uastc(COLORS)


def uri(data: bytes) -> str:
    return f"data:image/ktx2;base64,{base64.b64encode(data).decode()}"


def quad(*textures: dict[str, Any]) -> Model:
    """Quads with a texture each; images are given by their URIs, those in KTX2 under ``ktx2``."""
    model = Model()
    model.extend("KHR_texture_basisu")
    for given in textures:
        texture: dict[str, Any] = {}
        if "ktx2" in given:
            source = model.add("images", {"uri": given["ktx2"], "mimeType": "image/ktx2"})
            texture["extensions"] = {"KHR_texture_basisu": {"source": source}}
        if "other" in given:
            texture["source"] = model.add("images", {"uri": given["other"]})
        base = {"baseColorTexture": {"index": model.add("textures", texture)}}
        material = {"pbrMetallicRoughness": base, "alphaMode": "BLEND"}
        model.node(mesh=model.quad(model.add("materials", material)))
    return model


def loaded(folder: Path, model: Model, **options: Any) -> Scene:
    return clrender.load(model.write(folder / "m.gltf"), **options)


def pixels(folder: Path, model: Model) -> dict[str, Any]:
    """Pixels of the pictures that the importer makes."""
    path = model.write(folder / "m.gltf")
    draft = read(path, AssetFiles("m.gltf", folder))
    found = {}
    for name, (data, ending) in draft.pictures.items():
        found[name] = np.concatenate(list(open_picture(io.BytesIO(data), ending).bands()))
    return found


SOUND = {
    "UASTC": ktx2(20, 12, UASTC, model=166),
    "UASTC, compressed again": ktx2(20, 12, zstd(UASTC), model=166, scheme=2, room=len(UASTC)),
    "one layer": ktx2(20, 12, UASTC, model=166, layers=1),
    "RGBA": plain(PIXELS),
    "RGBA, deflated": plain(PIXELS, True),
}


@needs_basis
@for_each("name", SOUND)
def test_the_scene_is_that_of_the_same_picture_in_png(tmp_path: Path, name: str) -> None:
    model = quad({"ktx2": uri(SOUND[name])})
    model.root["extensionsRequired"] = ["KHR_texture_basisu"]
    scene = loaded(tmp_path, model, strict=True)
    assert scene.sha256() == loaded(tmp_path, quad({"other": picture_uri(PIXELS)})).sha256()
    assert scene.sha256() != loaded(tmp_path, quad({"other": picture_uri(PIXELS[::-1])})).sha256()
    assert not any("basisu" in note or "KTX2" in note for note in scene.notes)


@needs_basis
def test_sizes_that_are_no_multiples_of_four_and_etc1s(tmp_path: Path) -> None:
    cut = ktx2(18, 11, UASTC, model=166)
    found = pixels(tmp_path, quad({"ktx2": uri(cut)}, {"ktx2": uri(ETC1S)}, {"ktx2": uri(plain(PIXELS[:7, :9, :3]))}))
    np.testing.assert_array_equal(found["/images/0"], PIXELS[:11, :18])
    np.testing.assert_allclose(found["/images/1"].astype(float), blocks_of(ETC1S_BLOCKS), atol=4.0)
    np.testing.assert_array_equal(found["/images/2"][..., :3], PIXELS[:7, :9, :3])
    assert (found["/images/2"][..., 3] == 255).all()


def left_out(folder: Path, model: Model) -> tuple[Scene, str]:
    """The scene, and the one note of a picture that was left out."""
    scene = loaded(folder, model)
    (note,) = (note for note in scene.notes if note.endswith(": left out"))
    with pytest.raises(SceneError) as error:
        loaded(folder, model, strict=True)
    assert note == f"{error.value}: left out" and "\n" not in note
    return scene, note


def test_without_the_library_it_is_left_out_by_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(reader, "basis_is_there", lambda: False)
    model = quad({"ktx2": uri(ETC1S)})
    scene, note = left_out(tmp_path, model)
    assert scene.materials["material 0"].model_dump()["base_color"] == (0.5, 0.5, 0.5)
    assert "m.gltf: /images/0 is a KTX2 (Basis Universal); install what reads it with `" in note
    with pytest.raises(SceneError) as error:
        loaded(tmp_path, model, strict=True)
    assert error.value.extra == "gltf"
    plain_one = loaded(tmp_path, quad({"ktx2": uri(plain(PIXELS))}), strict=True)
    assert not any("left out" in note for note in plain_one.notes)


def texture_of(scene: Scene) -> Any:
    return scene.materials["material 0"].model_dump()["base_color"]["texture"]


@needs_basis
def test_of_two_forms_the_one_that_can_be_read_counts(tmp_path: Path) -> None:
    both = quad({"ktx2": uri(SOUND["UASTC"]), "other": picture_uri(PIXELS)})
    assert texture_of(loaded(tmp_path, both, strict=True)) == "/images/1"
    no_png = quad({"ktx2": uri(SOUND["UASTC"]), "other": "not-there.png"})
    scene, note = left_out(tmp_path, no_png)
    assert texture_of(scene) == "/images/0" and "not-there.png" in note
    neither = quad({"ktx2": uri(ETC1S[:90]), "other": "not-there.png"})
    scene = loaded(tmp_path, neither)
    assert sum(note.endswith("left out") for note in scene.notes) == 2
    assert scene.materials["material 0"].model_dump()["base_color"] == (0.5, 0.5, 0.5)


@needs_basis
def test_a_ktx2_without_the_extension_is_forgiven(tmp_path: Path) -> None:
    model = quad({"other": uri(SOUND["UASTC"])})
    del model.root["extensionsUsed"]
    scene = loaded(tmp_path, model)
    assert texture_of(scene) == "/images/0"
    assert any("/images/0 is a KTX2, which only KHR_texture_basisu allows: read" in note for note in scene.notes)


@needs_basis
def test_pictures_are_decoded_together_and_a_damaged_one_spoils_no_other(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    damaged = bytearray(SOUND["UASTC, compressed again"])
    damaged[-len(UASTC) - 12] ^= 255  # in the head of the frame
    calls: list[int] = []

    def counted(source: str, decoder: str, parts: Any, *limits: int) -> Any:
        calls.append(len(parts))
        return decoded(source, decoder, parts, *limits)

    monkeypatch.setattr(reader, "decoded", counted)
    files = [SOUND["UASTC"], bytes(damaged), ETC1S, SOUND["one layer"]]
    model = quad(*({"ktx2": uri(each)} for each in files))
    path = model.write(tmp_path / "m.gltf")
    draft = read(path, AssetFiles("m.gltf", tmp_path))
    assert calls == [4, 2] and set(draft.pictures) == {"/images/0", "/images/2", "/images/3"}
    (note,) = (note for note in draft.notes if note.endswith("left out"))
    assert note.startswith("/images/1 is a KTX2 that Basis Universal cannot decode")


WRONG = {
    "nothing": (reader.KTX2_MAGIC, "it is truncated"),
    "half a header": (ETC1S[:70], "it is truncated"),
    "without its end": (SOUND["UASTC"][:-1], "it is truncated"),
    "a volume": (ktx2(20, 12, UASTC, model=166, depth=1), "it is a volume, an array or a cube map"),
    "an array": (ktx2(20, 12, UASTC, model=166, layers=2), "it is a volume, an array or a cube map"),
    "a cube map": (ktx2(20, 12, UASTC, model=166, faces=6), "it is a volume, an array or a cube map"),
    "no pixels": (ktx2(0, 12, UASTC, model=166), "0 x 12 pixels are not between"),
    "too many": (ktx2(1 << 16, 1 << 16, UASTC, model=166), "65536 x 65536 pixels are not between"),
    "ASTC": (ktx2(20, 12, UASTC, 157, 162), r"\(format 157, colour model 162, supercompression 0\)"),
    "ETC1S without tables": (ktx2(20, 12, UASTC, model=163), "neither ETC1S nor UASTC"),
    "few blocks": (ktx2(24, 12, UASTC, model=166), "it is too small for the size its header gives"),
    "few bytes": (ktx2(24, 12, UASTC, 43), "it is too small for the size its header gives"),
    "few deflated bytes": (ktx2(6000, 6000, zlib.compress(UASTC), 43, 1, 3), "it is too small for the size"),
    "damaged bytes": (ktx2(20, 12, UASTC, 43, 1, 3), "its data are damaged"),
    "plain in Zstandard": (ktx2(20, 12, zstd(UASTC), 43, 1, 2), "its supercompression 2 is not read"),
    "a bomb": (ktx2(16000, 16000, zstd(UASTC[:48]), model=166, scheme=2, room=256_000_000), "it is too small for"),
    "a bomb of tables": (ETC1S[:20] + struct.pack("<2I", 16000, 16000) + ETC1S[28:], "it is too small for the size"),
}


@for_each("case", WRONG)
def test_what_cannot_be_read_is_known_before_it_is_decoded(
    tmp_path: Path, case: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    def never(*_: Any) -> Any:
        raise AssertionError("it was decoded")

    monkeypatch.setattr(reader, "decoded", never)
    data, words = WRONG[case]
    _, note = left_out(tmp_path, quad({"ktx2": uri(data)}))
    assert re.search(rf"m\.gltf: /images/0 is a KTX2 that cannot be read, because .*{words}.*; export it as PNG", note)


@needs_basis
def test_a_file_that_promises_much_takes_neither_memory_nor_time(tmp_path: Path) -> None:
    """As many pixels as are allowed of so few bytes."""
    level = zstd(UASTC[:48]) + bytes(9000)
    big = ktx2(16384, 16384, level, model=166, scheme=2, room=1 << 28)
    _, note = left_out(tmp_path, quad({"ktx2": uri(big)}))
    assert "Basis Universal cannot decode" in note


def survive(folder: Path, count: int) -> None:
    """Damaged files are left out, or read."""
    rng = np.random.default_rng(11)
    files = []
    for index in range(count):
        data = np.frombuffer([ETC1S, SOUND["UASTC"], SOUND["UASTC, compressed again"]][index % 3], np.uint8).copy()
        data[rng.integers(48, len(data), 3)] = rng.integers(0, 256, 3)
        files.append(data.tobytes())
    path = quad(*({"ktx2": uri(each)} for each in files)).write(folder / "m.gltf")
    draft = read(path, AssetFiles("m.gltf", folder))
    assert 0 < len(draft.pictures) < count and len(draft.pictures) + draft.left_out == count


@pytest.mark.long
@needs_basis
def test_damaged_files_harm_nothing(tmp_path: Path) -> None:
    survive(tmp_path, 20)


@needs_basis
@pytest.mark.slow
def test_many_damaged_files_harm_nothing(tmp_path: Path) -> None:
    survive(tmp_path, 500)
