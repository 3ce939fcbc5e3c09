"""glTF meshes compressed by Draco: read by DracoPy in a process of its own, or refused with the name of the extra."""

from __future__ import annotations

import importlib
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from gltf_files import Model

import clrender
from clrender.errors import SceneError
from clrender.importers.gltf import draco
from clrender.scene import Scene

needs_draco = pytest.mark.skipif(not draco.draco_is_there(), reason="DracoPy is not installed: the extra gltf")
AT = "/meshes/0/primitives/0/extensions/KHR_draco_mesh_compression"


def grid(side: int) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.float32], npt.NDArray[np.uint32]]:
    """Positions, texture coordinates and triangles of a wavy sheet."""
    x, y = (each.ravel() for each in np.meshgrid(*[np.linspace(0.0, 1.0, side)] * 2, indexing="ij"))
    places = np.stack([x, y, 0.1 * np.sin(7.0 * x)], 1).astype(np.float32)
    a = (np.arange(side - 1)[:, None] * side + np.arange(side - 1)).ravel()
    corners = np.concatenate([np.stack([a, a + side, a + side + 1], 1), np.stack([a, a + side + 1, a + 1], 1)])
    return places, np.stack([x, 1.0 - y], 1).astype(np.float32), corners.astype(np.uint32)


def encoded(side: int) -> tuple[bytes, dict[str, int]]:
    """Draco's data of that sheet, and the numbers of its attributes."""
    library: Any = importlib.import_module("DracoPy")
    places, uvs, corners = grid(side)
    data: bytes = library.encode(places, corners, quantization_bits=16, tex_coord=uvs.astype(np.float64))
    names = {0: "POSITION", 3: "TEXCOORD_0"}
    return data, {names[each["attribute_type"]]: each["unique_id"] for each in library.decode(data).attributes}


def compressed(data: bytes, numbers: dict[str, int], vertices: int, triangles: int) -> Model:
    model = Model()
    model.extend("KHR_draco_mesh_compression", required=True)
    float_, whole = {"componentType": 5126, "count": vertices}, {"componentType": 5125, "count": 3 * triangles}
    texture = model.texture([[[9, 9, 9]]])
    primitive = {
        "attributes": {
            "POSITION": model.add("accessors", {**float_, "type": "VEC3", "min": [0, 0, -0.1], "max": [1, 1, 0.1]}),
            "TEXCOORD_0": model.add("accessors", {**float_, "type": "VEC2"}),
        },
        "indices": model.add("accessors", {**whole, "type": "SCALAR"}),
        "material": model.add("materials", {"pbrMetallicRoughness": {"baseColorTexture": {"index": texture}}}),
        "extensions": {"KHR_draco_mesh_compression": {"bufferView": model.view(data), "attributes": numbers}},
    }
    model.node(mesh=model.add("meshes", {"primitives": [primitive]}))
    return model


def loaded(folder: Path, model: Model) -> Scene:
    return clrender.load(model.write(folder / "m.glb"))


@needs_draco
def test_a_sheet_is_the_one_that_went_in(tmp_path: Path) -> None:
    side = 20
    scene = loaded(tmp_path, compressed(*encoded(side), side * side, 2 * (side - 1) ** 2))
    mesh = scene.mesh(0)
    places, uvs, corners = grid(side)
    assert mesh.uvs is not None and len(mesh.triangles) == len(corners)

    def sorted_corners(places: Any, uvs: Any) -> Any:
        """Vertices and triangles come in another order, and rounded to 16 bits; compare triangles by their middles."""
        middle = np.concatenate([places.mean(axis=1), uvs.mean(axis=1)], axis=1)
        return middle[np.lexsort(np.round(middle, 3).T)]

    found, given = sorted_corners(mesh.vertices[mesh.triangles], mesh.uvs), None
    given = sorted_corners(places[corners], np.array([0.0, 1.0]) + [1.0, -1.0] * uvs[corners])
    np.testing.assert_allclose(found, given, atol=2e-4)
    assert not any("Draco" in note or "draco" in note for note in scene.notes)


def test_without_the_library_it_is_refused_by_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(draco, "draco_is_there", lambda: False)
    model = compressed(bytes(64), {"POSITION": 0, "TEXCOORD_0": 1}, 4, 2)
    with pytest.raises(
        SceneError, match=rf"m\.glb: {AT} is compressed by Draco; .*pip install 'DracoPy[^']*'.*`, or export"
    ):
        loaded(tmp_path, model)


def test_what_is_there_without_compression_needs_no_library(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(draco, "draco_is_there", lambda: False)
    model = Model()
    model.extend("KHR_draco_mesh_compression")
    mesh = model.quad()
    attached = {"bufferView": model.view(bytes(64)), "attributes": {"POSITION": 0}}
    model.root["meshes"][mesh]["primitives"][0]["extensions"] = {"KHR_draco_mesh_compression": attached}
    model.node(mesh=mesh)
    assert len(loaded(tmp_path, model).mesh(0).triangles) == 2


@needs_draco
def test_what_does_not_fit_is_told_with_its_place(tmp_path: Path) -> None:
    data, numbers = encoded(5)
    for vertices, more, words in (
        (26, numbers, f"{AT}/attributes/TEXCOORD_0 holds 25 x 2 numbers, but the accessor says 26 x 2"),
        (25, {**numbers, "POSITION": 77}, f"{AT}/attributes/POSITION is 77, but the data hold no attribute of"),
        (25, {**numbers, "NORMAL": 0}, f"{AT}/attributes/NORMAL is no attribute of the primitive"),
    ):
        with pytest.raises(SceneError) as error:
            loaded(tmp_path, compressed(data, more, vertices, 32))
        assert words in str(error.value)


def hostile(count: int) -> list[bytes]:
    """Damaged data, and such as promise more than any memory holds."""
    data, _ = encoded(12)
    rng = np.random.default_rng(19)
    huge = b"\xff\xff\xff\x3f"  # 2^27 - 1 as a number of seven bits a byte
    found = [data[:40], b"", b"DRACO\x02\x02\x01\x00\x00\x00" + huge * 2 + bytes(64)]
    found.append(b"DRACO\x02\x02\x01\x01\x00\x00\x00" + huge * 2 + bytes(64))
    while len(found) < count:
        damaged = np.frombuffer(data, np.uint8).copy()
        damaged[rng.integers(11, len(damaged), 3)] = rng.integers(0, 256, 3)
        found.append(damaged.tobytes())
    return found


def survive(folder: Path, count: int) -> None:
    _, numbers = encoded(12)
    refused = 0
    for data in hostile(count):
        try:
            scene = loaded(folder, compressed(data or b"\0", numbers, 144, 242))
        except SceneError as error:
            assert "\n" not in str(error) and "/meshes/0/primitives/0" in str(error)
            refused += 1
        else:
            assert all(np.isfinite(scene.mesh(i).vertices).all() for i in range(len(scene.shapes)))
    assert refused >= 4


@needs_draco
def test_damaged_data_harm_nothing(tmp_path: Path) -> None:
    survive(tmp_path, 12)


@needs_draco
@pytest.mark.slow
def test_much_damaged_data_harm_nothing(tmp_path: Path) -> None:
    survive(tmp_path, 400)
