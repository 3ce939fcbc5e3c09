"""Buffer views compressed by meshoptimizer: read by meshopt in a process of its own, or refused by name."""

from __future__ import annotations

import base64
import hashlib
import importlib
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from cases import for_each
from gltf_files import Model, meshopt_compressed

import clrender
from clrender.errors import SceneError
from clrender.importers.gltf import decoding, meshopt
from clrender.importers.gltf.meshopt_filters import FILTERS
from clrender.scene import Scene

needs_meshopt = pytest.mark.skipif(not meshopt.meshopt_is_there(), reason="meshopt is not installed: the extra gltf")
NAMES = ("EXT_meshopt_compression", "KHR_meshopt_compression")
AT = "/bufferViews/0/extensions/EXT_meshopt_compression"


def library() -> Any:
    return importlib.import_module("meshopt")


def sheet(side: int, indices: str = "uint16") -> Model:
    """A wavy sheet with all attributes that a mesh commonly has."""
    model = Model()
    x, y = (each.ravel() for each in np.meshgrid(*[np.linspace(0.0, 1.0, side)] * 2, indexing="ij"))
    a = (np.arange(side - 1)[:, None] * side + np.arange(side - 1)).ravel()
    corners = np.stack([a, a + side, a + side + 1, a, a + side + 1, a + 1], 1)
    places = np.stack([x, y, 0.1 * np.sin(7.0 * x)], 1)
    normals = np.stack([-0.7 * np.cos(7.0 * x), 0.0 * x, np.ones_like(x)], 1)
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    attributes = {"POSITION": places, "NORMAL": normals, "TEXCOORD_0": np.stack([x, 1.0 - y], 1)}
    picture = {"index": model.texture([[[9, 9, 9]]])}
    primitive: dict[str, Any] = {
        "attributes": {name: model.accessor(numbers) for name, numbers in attributes.items()},
        "indices": model.accessor(corners.ravel(), indices),
        "material": model.add("materials", {"pbrMetallicRoughness": {"baseColorTexture": picture}}),
    }
    primitive["attributes"]["COLOR_0"] = model.accessor(np.stack([x, y, x, y], 1) * 255, "uint8", normalized=True)
    model.node(mesh=model.add("meshes", {"primitives": [primitive]}))
    return model


def loaded(folder: Path, model: Model, **options: Any) -> Scene:
    return clrender.load(model.write(folder / "m.glb"), **options)


@needs_meshopt
@for_each("name", NAMES)
@for_each("version", (0, 1))
def test_the_scene_is_that_of_the_uncompressed_file(tmp_path: Path, name: str, version: int) -> None:
    plain = sheet(33, "uint32" if version else "uint16")
    packed = meshopt_compressed(plain, name, version)
    assert len(packed.data) < len(plain.data)
    scene = loaded(tmp_path, packed, strict=True)
    assert scene.sha256() == loaded(tmp_path, plain).sha256() and not any("meshopt" in note for note in scene.notes)
    mesh = scene.mesh(0)
    assert len(mesh.vertices) == 33**2 and mesh.vertices[:, 2].max() > 0.09  # neither is empty


def with_view(kind: str, filter_name: str, stride: int, packed: Any, mode: str = "ATTRIBUTES") -> Model:
    """A quad with an attribute, or ``indices``, in a view of this content; normals of 16 bits."""
    model = Model()
    mesh = model.quad()
    primitive = model.root["meshes"][mesh]["primitives"][0]
    data = library().encode_gltf_buffer(packed, mode)
    view = {"count": len(packed), "byteStride": stride, "mode": mode, "filter": filter_name}
    view |= model.root["bufferViews"].pop(model.view(data))
    if kind == "NORMAL":
        primitive["attributes"][kind] = model.accessor(np.zeros((4, 3)), "int16", normalized=True)
    number = primitive["indices"] if kind == "indices" else primitive["attributes"][kind]
    place = model.root["bufferViews"][model.root["accessors"][number]["bufferView"]]
    place.update({"buffer": 1, "byteOffset": 0, "byteLength": len(packed) * stride, "extensions": {NAMES[0]: view}})
    if mode == "ATTRIBUTES":
        place["byteStride"] = stride
    model.extend(NAMES[0], required=True)
    model.more_buffers.append({"byteLength": len(packed) * stride, "extensions": {NAMES[0]: {"fallback": True}}})
    model.node(mesh=mesh)
    return model


@needs_meshopt
def test_triangles_begin_at_any_of_their_corners(tmp_path: Path) -> None:
    indices = np.array([0, 1, 2, 3, 0, 2], np.uint16)
    scene = loaded(tmp_path, with_view("indices", "NONE", 2, indices, "TRIANGLES"))
    found = [tuple(np.roll(each, -each.argmin())) for each in scene.mesh(0).triangles]
    assert found == [(0, 1, 2), (0, 2, 3)]


@needs_meshopt
def test_filtered_positions_and_normals_of_a_file(tmp_path: Path) -> None:
    corners = np.array([[-1, -1, 0], [1, -1, 0.25], [1, 1, 0], [-1, 1, 0.125]], np.float32)
    packed = library().encode_filter_exp(corners, 24)
    scene = loaded(tmp_path, with_view("POSITION", "EXPONENTIAL", 12, packed))
    np.testing.assert_array_equal(scene.mesh(0).vertices, corners)
    normals = np.array([[0, 0, 1, 0], [0.6, 0, 0.8, 0], [0, -0.8, 0.6, 0], [-0.6, 0, 0.8, 0]], np.float32)
    model = with_view("NORMAL", "OCTAHEDRAL", 8, library().encode_filter_oct(normals, 8, 16))
    model.extend("KHR_mesh_quantization")
    found = loaded(tmp_path, model).mesh(0).normals
    assert found is not None
    np.testing.assert_allclose(found, normals[:, :3], atol=1e-4)


def unit(columns: int, rows: int = 500) -> npt.NDArray[np.float32]:
    numbers = np.random.default_rng(columns).normal(size=(rows, columns))
    found: npt.NDArray[np.float32] = (numbers / np.linalg.norm(numbers, axis=1)[:, None]).astype(np.float32)
    return found


@needs_meshopt
@for_each("stride", (4, 8))
def test_octahedral_and_color_filters_return_what_went_in(stride: int) -> None:
    kind, bits = f"<i{stride // 4}", 2 * stride
    largest = np.iinfo(kind).max
    given = np.concatenate([unit(3), np.ones((500, 1), np.float32)], 1)
    found = FILTERS["OCTAHEDRAL"].undone(library().encode_filter_oct(given, stride, bits)).view(kind)
    np.testing.assert_allclose(found / largest, given, atol=2.5 / largest)
    given = np.random.default_rng(1).random((500, 4), np.float32)
    found = FILTERS["COLOR"].undone(library().encode_filter_color(given, stride, bits)).view(kind.replace("i", "u"))
    np.testing.assert_allclose(found / (2.0 * largest + 1.0), given, atol=4.0 / largest)


@needs_meshopt
def test_quaternion_and_exponential_filters_return_what_went_in() -> None:
    given = unit(4)
    found = FILTERS["QUATERNION"].undone(library().encode_filter_quat(given, 8, 16)).view("<i2") / 32767.0
    np.testing.assert_allclose(found * np.sign((found * given).sum(axis=1))[:, None], given, atol=1e-4)
    given *= np.float32(2.0) ** np.arange(-40, 40, 20).astype(np.float32)
    found = FILTERS["EXPONENTIAL"].undone(library().encode_filter_exp(given, 15, "Separate")).view("<f4")
    np.testing.assert_allclose(found, given, rtol=1e-4)


def test_filters_have_the_same_bits_everywhere() -> None:
    """Of arbitrary bytes, too: damaged data may divide by 0, and may hold more than fits."""
    rows = np.random.default_rng(2).integers(0, 256, (5000, 8), np.uint8)
    rows[:50] = 0
    digest = hashlib.sha256()
    for name, each in FILTERS.items():
        for stride in {"QUATERNION": (8,), "EXPONENTIAL": (4, 8)}.get(name, (4, 8)):
            found = each.undone(rows[:, :stride])
            assert found.shape == (5000, stride) and found.dtype == np.uint8
            digest.update(found.tobytes())
    assert digest.hexdigest()[:16] == "f02d060da841eb93"


def test_without_the_library_it_is_refused_by_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    model = placeholder()
    monkeypatch.setattr(meshopt, "meshopt_is_there", lambda: False)
    told = rf"m\.glb: {AT} is compressed by meshoptimizer; .*`.*pip install .*meshopt.*` .*, or export it without"
    with pytest.raises(SceneError, match=told) as error:
        loaded(tmp_path, model)
    assert error.value.extra == "gltf"


def placeholder(**changes: Any) -> Model:
    """A quad whose positions are compressed, by an encoder that is not needed: no data begin like these."""
    model = Model()
    mesh = model.quad()
    packed = {
        "count": 4,
        "byteStride": 12,
        "mode": "ATTRIBUTES",
        **model.root["bufferViews"].pop(model.view(bytes(64))),
    }
    packed = {key: value for key, value in {**packed, **changes}.items() if value is not None}
    model.root["bufferViews"][0].update({"buffer": 1, "byteOffset": 0, "extensions": {NAMES[0]: packed}})
    model.extend(NAMES[0], required=True)
    model.more_buffers.append({"byteLength": 48, "extensions": {NAMES[0]: {"fallback": True}}})
    model.node(mesh=mesh)
    return model


def test_a_fallback_with_bytes_is_read_without_the_library(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(meshopt, "meshopt_is_there", lambda: False)
    model = placeholder()
    data = base64.b64encode(bytes(model.data[:48])).decode()
    model.more_buffers[0]["uri"] = f"data:application/octet-stream;base64,{data}"
    assert loaded(tmp_path, model).mesh(0).vertices[:, 0].tolist() == [-1, 1, 1, -1]


@needs_meshopt
def test_a_fallback_is_not_needed_with_the_library(tmp_path: Path) -> None:
    plain = sheet(5)
    model = meshopt_compressed(plain)
    model.more_buffers[0]["uri"] = "not-there.bin"
    assert loaded(tmp_path, model).sha256() == loaded(tmp_path, plain).sha256()
    del model.root["bufferViews"][0]["extensions"]  # this view has nothing but the fallback
    with pytest.raises(SceneError, match=r"not-there\.bin"):
        loaded(tmp_path, model)


FAULTS: dict[str, tuple[dict[str, Any], str]] = {
    "mode": ({"mode": "POINTS"}, '/mode is "POINTS", but must be ATTRIBUTES, TRIANGLES or INDICES'),
    "no mode": ({"mode": None}, " has no `mode`, which EXT_meshopt_compression must have"),
    "filter": ({"filter": "X"}, '/filter is "X", but must be NONE, OCTAHEDRAL or QUATERNION or EXPONENTIAL or COLOR'),
    "stride of a filter": ({"filter": "OCTAHEDRAL"}, "/byteStride is 12, which ATTRIBUTES with the filter OCTAHEDRAL"),
    "stride of indices": ({"mode": "INDICES"}, "/byteStride is 12, which INDICES with the filter NONE cannot have"),
    "filtered indices": (
        {"mode": "INDICES", "byteStride": 4, "filter": "COLOR"},
        "/byteStride is 4, which INDICES with the filter COLOR cannot have",
    ),
    "odd stride": ({"byteStride": 6, "count": 8}, "/byteStride is 6, which ATTRIBUTES with the filter NONE cannot"),
    "triangles": (
        {"mode": "TRIANGLES", "byteStride": 4, "count": 13},
        "/count is 13, but must be a multiple of 3",
    ),
    "count": ({"count": 5}, "/count times byteStride is 60 bytes, but the view has 48"),
    "huge": ({"count": 2**52}, "/count times byteStride is"),
    "beyond the end": ({"byteLength": 9999}, "/byteLength takes it to byte "),
    "no buffer": ({"buffer": 7}, "/buffer is 7, but of buffers there are only 2"),
    "itself": ({"buffer": 1}, "/buffer names a buffer without bytes, but they are needed"),
    "damaged": ({}, " holds data that meshoptimizer cannot decode"),
}


@needs_meshopt
@for_each("case", FAULTS)
def test_what_does_not_fit_is_told_with_its_place(tmp_path: Path, case: str) -> None:
    changes, words = FAULTS[case]
    with pytest.raises(SceneError) as error:
        loaded(tmp_path, placeholder(**changes))
    assert f"m.glb: {AT}{words}" in str(error.value) and "\n" not in str(error.value)


@needs_meshopt
def test_a_few_bytes_cannot_promise_much(tmp_path: Path) -> None:
    model = placeholder(count=12 * 2**20, byteLength=64)
    model.root["bufferViews"][0]["byteLength"] = model.more_buffers[0]["byteLength"] = 144 * 2**20
    with pytest.raises(SceneError, match=f"{AT}/byteLength is 64, too few for 150,994,944 bytes"):
        loaded(tmp_path, model)


def test_all_views_together_have_a_bound(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(meshopt, "_LIMIT", 47)
    with pytest.raises(SceneError, match=f"{AT} and others take more than 47 bytes, which is the most"):
        loaded(tmp_path, placeholder())


@needs_meshopt
def test_bounds_of_compressed_numbers_are_checked(tmp_path: Path) -> None:
    model = meshopt_compressed(sheet(5))
    model.root["accessors"][0].update(min=[0, 0, -1], max=[0.5, 1, 1])
    notes = loaded(tmp_path, model).notes
    assert any("/accessors/0/max/0 is 0.5, but there is a number 1 in the data" in note for note in notes)


@needs_meshopt
@for_each("limits", ({"_MEMORY": 1 << 20}, {"_SECONDS": 0.01, "_SHARE": 0}))
def test_a_process_beyond_its_limits_is_ended(monkeypatch: pytest.MonkeyPatch, limits: dict[str, Any]) -> None:
    numbers = np.arange(64, dtype=np.uint8).reshape(4, 16)
    part = decoding.Encoded(library().encode_vertex_buffer(numbers), {"count": 4, "size": 16, "mode": "ATTRIBUTES"})
    (found,) = decoding.decoded("m.glb", "meshopt", [part], 0, 0)
    assert found["bytes"].tolist() == list(range(64))
    for name, value in limits.items():
        monkeypatch.setattr(decoding, name, value)
    assert decoding.decoded("m.glb", "meshopt", [part], 0, 0) == []


def survive(folder: Path, count: int) -> None:
    """Damaged data are refused, or hold what is finite."""
    model = meshopt_compressed(sheet(12))
    sound, rng, refused = bytes(model.data), np.random.default_rng(19), 0
    for _ in range(count):
        damaged = np.frombuffer(sound, np.uint8).copy()
        damaged[rng.integers(0, len(damaged), 3)] = rng.integers(0, 256, 3)
        model.data = bytearray(damaged.tobytes())
        try:
            scene = loaded(folder, model)
        except SceneError as error:
            assert "\n" not in str(error)
            refused += 1
        else:
            assert np.isfinite(scene.mesh(0).vertices).all()
    assert refused > 0


@pytest.mark.long
@needs_meshopt
def test_damaged_data_harm_nothing(tmp_path: Path) -> None:
    survive(tmp_path, 12)


@needs_meshopt
@pytest.mark.slow
def test_much_damaged_data_harm_nothing(tmp_path: Path) -> None:
    survive(tmp_path, 400)
