"""Grids of densities: their files, what is refused, where they are, and how they go from one place to another."""

from __future__ import annotations

import io
import re
import struct
import tracemalloc
import zlib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from grid_files import nanovdb_bytes, vol_bytes
from vdb_files import vdb_bytes

import clrender
from clrender import layout
from clrender.errors import SceneError
from clrender.exporters import (
    exported,
    exported_to_cycles,
    exported_to_luxcore,
    exported_to_mitsuba,
    scene_text,
    write_mitsuba,
)
from clrender.flatten.flat_scene import flatten
from clrender.flatten.grids import black_body_hue, brick_words
from clrender.grids import GridData, grid_names, read_grid
from clrender.grids.compression import unzipped
from clrender.grids.sparse import DenseBox
from clrender.scene.grid_placement import grid_placement
from clrender.scene.medium import Density
from clrender.scene.portable import scene_from_portable, scene_to_portable

VALUES = np.random.RandomState(3).uniform(0.0, 2.0, (4, 5, 6)).astype(np.float32)
CAMERA: dict[str, Any] = {"position": [0.0, 0.0, 5.0], "target": [0.0, 0.0, 0.0]}
BOX: dict[str, Any] = {"type": "box", "size": [1.0, 1.0, 1.0], "interior": "smoke"}


def grid_of(scene: clrender.Scene, wanted: str = "density") -> tuple[Any, GridData]:
    """The grid of the only medium that has one of this kind, and what its file holds."""
    ((name, grid),) = [(at[1], grid) for at, grid in scene.grids() if at[2] == wanted]
    return grid, scene.grid(name, wanted, grid)


def described(density: Any, **more: Any) -> dict[str, Any]:
    medium = {"scattering": 2.0, "density": density}
    return {"camera": CAMERA, "shapes": [BOX], "media": {"smoke": medium}, **more}


def read(folder: Path, name: str, data: bytes) -> GridData:
    (folder / name).write_bytes(data)
    return read_grid(name, folder, (), "here")


def npy(values: Any) -> bytes:
    file = io.BytesIO()
    np.save(file, values)
    return file.getvalue()


@pytest.mark.parametrize("kind", ["<f4", ">f8", "u1", "<i2"])
def test_numpy_files(tmp_path: Path, kind: str) -> None:
    given = (VALUES * 10.0).astype(kind)
    grid = read(tmp_path, "a.npy", npy(given))
    assert grid.values.dtype == np.float32 and np.array_equal(grid.values, given.astype(np.float32))
    assert np.array_equal(grid.placement, np.eye(4)[:3])


def test_mitsuba_files(tmp_path: Path) -> None:
    grid = read(tmp_path, "a.vol", vol_bytes(VALUES, (-1.0, -2.0, -3.0, 1.0, 2.0, 4.0)))
    assert np.array_equal(grid.values, VALUES)
    assert grid.placement.tolist() == [[2.0, 0.0, 0.0, -1.0], [0.0, 4.0, 0.0, -2.0], [0.0, 0.0, 7.0, -3.0]]
    halves = read(tmp_path, "b.vol", vol_bytes(VALUES.astype(np.float16)))
    assert np.array_equal(halves.values, VALUES.astype(np.float16).astype(np.float32))
    bytes_ = read(tmp_path, "c.vol", vol_bytes((VALUES * 100).astype(np.uint8)))
    assert bytes_.values.max() == pytest.approx((VALUES * 100).astype(np.uint8).max() / 255.0)


@pytest.mark.parametrize("first", [(0, 0, 0), (-5, -130, 4090)])
@pytest.mark.parametrize("way", [{}, {"codec": 1}, {"codec": 2, "chunk": 2**19}, {"tiles": True}], ids=str)
def test_nanovdb_files(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, first: tuple[int, int, int], way: dict[str, Any]
) -> None:
    """One more value on each side: the zeros to which densities fall."""
    monkeypatch.setattr("clrender.grids.nanovdb._BLOSC_CHUNK", 2**19)  # so that a grid has several parts
    given = np.random.RandomState(2).uniform(size=(20, 13, 150)).astype(np.float32)
    given[:10, :10, :10] = 0.5
    grid = read(tmp_path, "a.nvdb", nanovdb_bytes(given, first, 0.25, (1.0, 2.0, 3.0), **way))
    assert np.array_equal(grid.values[1:-1, 1:-1, 1:-1], given.transpose(2, 1, 0))
    inside = np.zeros_like(grid.values)
    inside[1:-1, 1:-1, 1:-1] = grid.values[1:-1, 1:-1, 1:-1]
    assert np.array_equal(inside, grid.values)
    # The value `first` is at first * voxel + offset: in the cube at the middle of the second cell
    sides = np.array(given.shape) + 2
    middle = grid.placement[:, :3] @ (1.5 / sides) + grid.placement[:, 3]
    assert middle == pytest.approx(np.array(first) * 0.25 + [1.0, 2.0, 3.0])


def write_files(files: Any, folder: Path) -> None:
    for name, write in files.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        with (folder / name).open("wb") as file:
            write(file)


def head(data: bytes, at: int, new: bytes) -> bytes:
    return data[:at] + new + data[at + len(new) :]


NVDB = nanovdb_bytes(VALUES)
ZIPPED = nanovdb_bytes(VALUES, codec=1)
(ZIPPED_BYTES,) = struct.unpack("<Q", ZIPPED[24:32])


@pytest.mark.parametrize("first", [(0, 0, 0), (-5, -130, 4090)])
@pytest.mark.parametrize(
    "way",
    [(), ("zipped",), ("half", "zipped"), ("masked",), ("masked", "blosc"), ("tiles",), ("blosc", "half", "tiles")],
    ids=lambda way: "-".join(way) or "plain",
)
def test_openvdb_files(tmp_path: Path, first: tuple[int, int, int], way: tuple[str, ...]) -> None:
    given = np.random.RandomState(2).uniform(0.1, 1.0, size=(20, 13, 30)).astype(np.float32)
    given[:10, :10, :10] = 0.5
    keys: dict[str, Any] = dict.fromkeys(way, True)
    grids = {"temperature": given * 900.0, "density": given}
    (tmp_path / "a.vdb").write_bytes(vdb_bytes(grids, first, 0.25, (1.0, 2.0, 3.0), **keys))
    assert grid_names("a.vdb", tmp_path, (), "here") == ("temperature", "density")
    for within, factor in (("density", 1.0), ("temperature", 900.0)):
        grid = read_grid("a.vdb", tmp_path, (), "here", within)
        # Leaves are whole; the box has one more number on each side
        low = np.array(first) // 8 * 8 - 1
        at = tuple(slice(int(a), int(a) + n) for a, n in zip(np.array(first) - low, given.shape, strict=True))
        numbers = grid.values.transpose(2, 1, 0)
        np.testing.assert_allclose(numbers[at], given * np.float32(factor), rtol=1e-3 if "half" in way else 0.0)
        assert np.count_nonzero(numbers) == given.size
        corner = (low - 0.5) * 0.25 + (1.0, 2.0, 3.0)
        np.testing.assert_allclose(grid.placement[:, 3], corner)


@pytest.mark.parametrize(
    ("keys", "said"),
    [
        ({"grid_class": "level set"}, "is a level set"),
        ({"background": 1.0}, "has 1 everywhere outside"),
        ({"kind": "vec3s"}, "has no grid \"density\" of floats; its grids are 'density'"),
    ],
)
def test_refused_openvdb_files(tmp_path: Path, keys: dict[str, Any], said: str) -> None:
    (tmp_path / "a.vdb").write_bytes(vdb_bytes({"density": VALUES}, **keys))
    with pytest.raises(SceneError, match=re.escape(said)):
        read_grid("a.vdb", tmp_path, (), "here")


def test_numbers_that_are_far_apart_are_refused() -> None:
    DenseBox((0, 0, 0), (2**8 - 1,) * 3, 1, "here")
    with pytest.raises(SceneError, match="here spreads 1000 numbers over a box of 512 x 512 x 512; leave out"):
        DenseBox((0, 0, 0), (2**9 - 1,) * 3, 1000, "here")
    DenseBox((0, 0, 0), (2**9 - 1,) * 3, 2**18, "here")


def test_empty_trees_are_empty_grids(tmp_path: Path) -> None:
    """Such as the first frame of a simulation."""
    nothing = np.zeros((3, 3, 3), np.float32)
    for name, data in (
        ("a.vdb", vdb_bytes({"density": nothing}, tiles=True)),
        ("a.nvdb", _emptied(nanovdb_bytes(VALUES))),
    ):
        grid = read(tmp_path, name, data)
        assert grid.values.shape == (3, 3, 3) and not grid.values.any()


def _emptied(data: bytes) -> bytes:
    """A grid without branches, whose box is empty."""
    root = data.rindex(struct.pack("<6i", 0, 0, 0, 3, 4, 5))
    return head(data, root, struct.pack("<6iI", *[2**31 - 1] * 3, *[-(2**31)] * 3, 0))


def test_numbers_below_zero_of_sparse_files_are_zero(tmp_path: Path) -> None:
    grid = read(tmp_path, "a.vdb", vdb_bytes({"density": VALUES - 1.0}))
    assert grid.values.min() == 0.0 and grid.values.max() == (VALUES - 1.0).max()


def test_ambient_temperatures_are_the_background(tmp_path: Path) -> None:
    heat = vdb_bytes({"temperature": VALUES * 900.0}, background=293.0)
    (tmp_path / "a.vdb").write_bytes(heat)
    grid = read_grid("a.vdb", tmp_path, (), "here", "temperature")
    assert grid.values[0, 0, 0] == 293.0 and grid.values.max() == (VALUES * np.float32(900.0)).max()


def test_trees_that_repeat_a_branch_are_refused(tmp_path: Path) -> None:
    data = bytearray(vdb_bytes({"density": VALUES[:, :, :2]}, (4094, 0, 0)))
    second = data.index(struct.pack("<3i", 4096, 0, 0))
    data[second : second + 4] = struct.pack("<i", 0)
    with pytest.raises(SceneError, match="a branch of its tree is in a place where none can be"):
        read(tmp_path, "a.vdb", bytes(data))


@pytest.mark.parametrize(
    ("name", "data"),
    [("a.vdb", vdb_bytes({"density": VALUES}, blosc=True)), ("a.nvdb", nanovdb_bytes(VALUES, codec=2))],
    ids=["openvdb", "nanovdb"],
)
def test_blosc_needs_its_extra(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str, data: bytes) -> None:
    (tmp_path / name).write_bytes(data)
    monkeypatch.setattr("clrender.grids.compression.find_spec", lambda _: None)
    with pytest.raises(SceneError, match="compressed by blosc, which needs numcodecs; install it") as info:
        read_grid(name, tmp_path, (), "here")
    assert info.value.extra == "vdb"


def test_zip_gives_what_is_expected_and_never_much_more() -> None:
    much = zlib.compress(bytes(2**25))
    for size in (0, 1):
        tracemalloc.start()
        with pytest.raises(ValueError, match="another size"):
            unzipped(much, size)
        peak = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        assert peak < 2**20
    for size in range(300):
        assert unzipped(zlib.compress(bytes(size)), size) == bytes(size)
        with pytest.raises(ValueError, match="another size"):
            unzipped(zlib.compress(bytes(size + 1)), size)


@pytest.mark.parametrize("way", [{}, {"zipped": True}, {"blosc": True, "masked": True, "half": True}])
def test_mutated_openvdb_files_are_read_or_refused(tmp_path: Path, way: dict[str, Any]) -> None:
    whole, dice = vdb_bytes({"density": VALUES}, **way), np.random.RandomState(4)
    outcomes = set()
    for _ in range(100):
        data = bytearray(whole)
        for place in dice.randint(0, 420 if dice.rand() < 0.6 else len(data), dice.randint(1, 5)):
            data[place] = dice.randint(256)
        data = data[: dice.randint(len(data))] if dice.rand() < 0.2 else data
        try:
            outcomes.add(bool(np.isfinite(read(tmp_path, "a.vdb", bytes(data)).values).all()))
        except SceneError as error:
            assert "\n" not in str(error) and len(str(error)) < 400
            outcomes.add(False)
    assert outcomes == {True, False}


@pytest.mark.parametrize(("kind", "bits"), [(13, 4), (14, 8), (15, 16), (16, 1), (16, 2), (16, 16)])
def test_quantized_nanovdb_files(tmp_path: Path, kind: int, bits: int) -> None:
    grid = read(tmp_path, "a.nvdb", nanovdb_bytes(VALUES.transpose(2, 1, 0), kind=kind, bits=bits))
    np.testing.assert_allclose(grid.values[1:-1, 1:-1, 1:-1], VALUES, atol=2.0 / (2**bits - 1) / 2.0 + 1e-6)
    assert np.unique(grid.values).size <= 2**bits + 1


def test_nanovdb_files_of_several_grids(tmp_path: Path) -> None:
    """Each after a head of its own, as tools write them."""
    parts = [
        nanovdb_bytes(VALUES * n, name=name) for n, name in ((1.0, "heat"), (2.0, "density"), (3.0, "temperature"))
    ]
    (tmp_path / "a.nvdb").write_bytes(b"".join(parts) + b"and more")
    assert grid_names("a.nvdb", tmp_path, (), "here") == ("heat", "density", "temperature")
    for within, factor in (("density", 2.0), ("temperature", 3.0), ("heat", 1.0)):
        grid = read_grid("a.nvdb", tmp_path, (), "here", within)
        assert np.array_equal(grid.values[1:-1, 1:-1, 1:-1].transpose(2, 1, 0), VALUES * np.float32(factor))
    with pytest.raises(
        SceneError, match="has no grid \"cold\" of floats; its grids are 'heat', 'density', 'temperature'"
    ):
        read_grid("a.nvdb", tmp_path, (), "here", "cold")


@pytest.mark.parametrize(
    ("name", "data", "said"),
    [
        ("a.npy", npy(VALUES[0]), "must hold numbers of the shape (nz, ny, nx)"),
        ("a.npy", npy(-VALUES), "numbers of grids are from 0"),
        ("a.npy", npy(np.where(VALUES.max() == VALUES, np.nan, VALUES)), "numbers of grids are from 0"),
        ("a.npy", npy(VALUES)[:-4], "bytes of numbers"),
        ("a.npy", npy(VALUES.astype(complex)), "must hold numbers"),
        ("a.vol", vol_bytes(VALUES)[:-1], "bytes of numbers"),
        ("a.vol", b"VOLX" + vol_bytes(VALUES)[4:], "its version is"),
        ("a.vol", vol_bytes(np.repeat(VALUES[..., None], 2, axis=-1), channels=2), "has 2 channels"),
        ("a.vol", b"nothing", "does not begin with VOL"),
        ("a.nvdb", b"nothing", "ends too early"),
        ("a.nvdb", NVDB[:5000], "ends too early"),
        ("a.nvdb", head(NVDB, 8, b"\0\0\0\0"), "its version is 0"),
        ("a.nvdb", nanovdb_bytes(VALUES, background=1.0), "outside of what it stores"),
        ("a.nvdb", nanovdb_bytes(VALUES, grid_class=1), "is a level set"),
        ("a.nvdb", head(NVDB, 14, b"\3\0"), "is compressed in an unknown way"),
        ("a.nvdb", head(NVDB, 14, b"\2\0"), "another size than its head says"),
        ("a.nvdb", nanovdb_bytes(VALUES, codec=2)[:-9], "ends too early"),
        ("a.nvdb", head(ZIPPED, 24, struct.pack("<Q", ZIPPED_BYTES + 1)), "another size than its head says"),
        ("a.nvdb", nanovdb_bytes(VALUES, codec=2, chunk=2**18), "another size than it should have"),
        ("a.nvdb", head(NVDB, 16 + 32, b"\2\0\0\0"), 'has no grid "density" of floats'),
        ("a.txt", b"", "grids may be .npy, .vol, .nvdb, .vdb"),
    ],
)
def test_refused_files(tmp_path: Path, name: str, data: bytes, said: str) -> None:
    with pytest.raises(SceneError, match=re.escape(said)) as error:
        read(tmp_path, name, data)
    assert "\n" not in str(error.value) and repr(name)[1:-1] in str(error.value)


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (described({"file": "a.npy", "box": [[0, 0, 0], [1, 0, 1]]}), "media.smoke.density.box has no volume"),
        (described({"file": "a.npy", "transform": {"scale": 0.0}}), "must not be zero"),
        (described({"file": "a.npy", "edges": "soft"}), "edges"),
        (described({"file": "a.npy", "name": "fog"}), "media.smoke.density.name is of a grid in an .nvdb or .vdb"),
        (described({"file": "a.npy"}, fog="smoke"), "give a box as large an `interior`"),
        (described({}), "file"),
        ({**described(None), "media": {"smoke": {"emission": [0, 1, 0], "absorption": [1, 0, 1]}}}, "shines in green"),
    ],
)
def test_refused_scenes(content: dict[str, Any], said: str) -> None:
    with pytest.raises(SceneError, match=re.escape(said)):
        clrender.Scene(**content)


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    scene = clrender.Scene(**described({"file": "a.npy"})).placed("scene", tmp_path)
    with pytest.raises(SceneError, match=r'scene: media\.smoke\.density\.file: "a\.npy"'):
        scene.read_named()


def test_where_a_grid_is() -> None:
    grid = GridData(VALUES, np.array([[2.0, 0.0, 0.0, 1.0], [0.0, 3.0, 0.0, 0.0], [0.0, 0.0, 4.0, 0.0]]))
    media = clrender.Scene(**described({"file": "a.vol", "transform": {"translate": [0.0, 5.0, 0.0]}})).media
    density = media["smoke"].density
    assert density is not None
    wanted = [[2.0, 0.0, 0.0, 1.0], [0.0, 3.0, 0.0, 5.0], [0.0, 0.0, 4.0, 0.0]]
    assert grid_placement(density, grid).tolist() == wanted
    boxed = density.with_checked(box=((-1.0, -1.0, -1.0), (1.0, 1.0, 0.0)))
    wanted = [[2.0, 0.0, 0.0, -1.0], [0.0, 2.0, 0.0, 4.0], [0.0, 0.0, 1.0, -1.0]]
    assert grid_placement(boxed, grid).tolist() == wanted


@pytest.mark.parametrize("falls", [False, True])
def test_bricks_have_every_number_and_those_around(falls: bool) -> None:
    values = np.random.RandomState(1).uniform(size=(9, 4, 30)).astype(np.float32)
    values[:, :, 9:20] = 0.0
    side, table, words = brick_words(GridData(values), falls)
    padded = np.pad(values, 1) if falls else np.pad(values, 1, mode="edge")
    counts = [-(-(n + 1) // side) for n in values.shape]
    entries = table.reshape(*counts, 2)
    empty = 0
    for k, j, i in np.ndindex(*counts):
        at, most = int(entries[k, j, i, 0].view(np.uint32)), float(entries[k, j, i, 1])
        part = padded[k * side : (k + 1) * side + 1, j * side : (j + 1) * side + 1, i * side : (i + 1) * side + 1]
        assert most == part.max()
        if most == 0.0:
            empty += 1
            continue
        brick = words[at : at + (side + 1) ** 3].reshape(side + 1, side + 1, side + 1)
        assert np.array_equal(brick[tuple(slice(n) for n in part.shape)], part)
    assert empty > 0


def test_arrays_of_python() -> None:
    scene = clrender.Scene(**described({"file": "mine"})).with_arrays(grids={"mine": VALUES.tolist()})
    assert np.array_equal(grid_of(scene)[1].values, VALUES)
    with pytest.raises(SceneError, match=r'grids: "mine" .*must hold numbers'):
        scene.with_arrays(grids={"mine": VALUES[0]})


def test_scenes_that_are_sent_and_written_are_the_same(tmp_path: Path) -> None:
    (tmp_path / "a.vol").write_bytes(vol_bytes(VALUES, (-1.0, -2.0, -3.0, 1.0, 2.0, 4.0)))
    density = {"file": "a.vol", "transform": {"rotate_degrees": [10.0, 20.0, 30.0]}, "edges": "fall"}
    scene = clrender.Scene(**described(density)).placed("scene", tmp_path)
    assert scene_from_portable(*scene_to_portable(scene)).sha256() == scene.sha256()
    export = exported(scene, "files")
    write_files(export.files, tmp_path / "out")
    (tmp_path / "out" / "b.toml").write_bytes(scene_text(export.description, ".toml", "a test"))
    again = clrender.load(tmp_path / "out" / "b.toml")
    assert again.sha256() == scene.sha256()
    assert np.array_equal(flatten(again, 8, 8).arrays["grid_rows"], flatten(scene, 8, 8).arrays["grid_rows"])


def test_hashes_follow_the_numbers_and_their_place() -> None:
    def sha256(values: Any, **density: Any) -> str:
        return clrender.Scene(**described({"file": "a", **density})).with_arrays(grids={"a": values}).sha256()

    hashes = [sha256(VALUES), sha256(2.0 * VALUES), sha256(VALUES, edges="fall")]
    hashes += [sha256(VALUES, box=[[0.0, 0.0, 0.0], [2.0, 1.0, 1.0]]), sha256(VALUES.transpose(2, 1, 0))]
    assert len(set(hashes)) == len(hashes)
    assert sha256(VALUES, box=[[0.0, 0.0, 0.0], [1.0, 1.0, 1.0]]) == hashes[0]


def test_grids_in_groups_that_move_are_refused() -> None:
    content = described({"file": "a"})
    keys = [{"time": 0.0}, {"time": 1.0, "translate": [1.0, 0.0, 0.0]}]
    content |= {"groups": {"cloud": {"shapes": [BOX]}}, "camera": {**CAMERA, "shutter": [0.0, 1.0]}}
    content["shapes"] = [{"type": "instance", "group": "cloud", "motion": keys}]
    scene = clrender.Scene(**content).with_arrays(grids={"a": VALUES})
    with pytest.raises(SceneError, match=r'shapes\[0\] moves the group "cloud", .*grids rest'):
        flatten(scene, 8, 8)


PBRT = """LookAt 0 0 5  0 0 0  0 1 0
Camera "perspective" "float fov" 40
WorldBegin
LightSource "infinite" "rgb L" [1 1 1]
Translate 1 0 0
{}
MediumInterface "m" ""
Material "interface"
Shape "sphere"
"""


def test_pbrt_grids(tmp_path: Path) -> None:
    numbers = " ".join(f"{x:.9g}" for x in VALUES.ravel())
    uniform = 'MakeNamedMedium "m" "string type" "uniformgrid" "integer nx" 6 "integer ny" 5 "integer nz" 4 '
    uniform += f'"float density" [{numbers}] "point3 p0" [-1 -1 -1] "point3 p1" [1 2 3]'
    (tmp_path / "a.pbrt").write_text(PBRT.format(uniform))
    (tmp_path / "x.nvdb").write_bytes(nanovdb_bytes(VALUES.transpose(2, 1, 0)))
    sparse = 'MakeNamedMedium "m" "string type" "nanovdb" "string filename" "x.nvdb" "float scale" 3 '
    sparse += '"rgb Le" [1 2 0] "float Lescale" 2'
    (tmp_path / "b.pbrt").write_text(PBRT.format(sparse))
    first, second = (clrender.load(tmp_path / name) for name in ("a.pbrt", "b.pbrt"))
    assert not first.notes and not second.notes
    (density, values), (its, others) = grid_of(first), grid_of(second)
    assert isinstance(density, Density) and density.edges == "fall" and np.array_equal(values.values, VALUES)
    placed = grid_placement(density, values)
    assert placed.tolist() == [[2.0, 0.0, 0.0, 0.0], [0.0, 3.0, 0.0, -1.0], [0.0, 0.0, 4.0, -1.0]]
    (medium,) = second.media.values()
    assert medium.scattering == (3.0, 3.0, 3.0) and medium.emission == (6.0, 12.0, 0.0)
    placed = grid_placement(its, others)
    assert placed[:, 3] == pytest.approx([-1.5 + 1.0, -1.5, -1.5])


@pytest.mark.parametrize(
    ("medium", "said"),
    [
        ('"string type" "uniformgrid" "float density" [1 2]', "has 2 densities for 1 x 1 x 1"),
        ('"string type" "uniformgrid"', 'has no "density"'),
        ('"string type" "uniformgrid" "float density" [-1]', "numbers of grids are from 0"),
        ('"string type" "nanovdb"', 'has no "filename"'),
    ],
)
def test_refused_pbrt_grids(tmp_path: Path, medium: str, said: str) -> None:
    (tmp_path / "a.pbrt").write_text(PBRT.format(f'MakeNamedMedium "m" {medium}'))
    with pytest.raises(SceneError, match=re.escape(said)):
        clrender.load(tmp_path / "a.pbrt")


MITSUBA = """<scene version="3.0.0"><sensor type="perspective"/><emitter type="constant"/>
<shape type="cube"><bsdf type="null"/><medium name="interior" type="heterogeneous"><float name="scale" value="8"/>
<rgb name="albedo" value="0.75, 0.5, 0.25"/><volume name="sigma_t" type="gridvolume">
<string name="filename" value="{}"/>{}</volume></medium></shape></scene>"""


def test_mitsuba_grids(tmp_path: Path) -> None:
    (tmp_path / "x.vol").write_bytes(vol_bytes(VALUES, (-1.0, -1.0, -1.0, 1.0, 1.0, 1.0)))
    moved = '<transform name="to_world"><translate x="3"/></transform>'
    own = '<boolean name="use_grid_bbox" value="true"/>'
    corners = []
    for more in (moved, own):
        (tmp_path / "a.xml").write_text(MITSUBA.format("x.vol", more))
        scene = clrender.load(tmp_path / "a.xml")
        density, values = grid_of(scene)
        (medium,) = scene.media.values()
        assert medium.scattering == (6.0, 4.0, 2.0) and medium.absorption == (2.0, 4.0, 6.0)
        corners.append(grid_placement(density, values)[:, 3].tolist())
    assert corners == [[3.0, 0.0, 0.0], [-1.0, -1.0, -1.0]]
    (tmp_path / "a.xml").write_text(MITSUBA.format("y.vol", ""))
    with pytest.raises(SceneError, match=r'line 3: "y\.vol" does not exist'):
        clrender.load(tmp_path / "a.xml")
    ball = '<shape type="sphere"/></scene>'
    (tmp_path / "a.xml").write_text(MITSUBA.format("y.vol", "").replace("</scene>", ball))
    assert any("y.vol" in note and "left out" in note for note in clrender.load(tmp_path / "a.xml").notes)


@pytest.mark.parametrize("colored", [False, True])
def test_mitsuba_gets_grids(tmp_path: Path, colored: bool) -> None:
    """With a channel for each colour where these have different coefficients."""
    content = described({"file": "a", "box": [[0.0, 0.0, 0.0], [2.0, 2.0, 2.0]], "edges": "fall"})
    content["media"]["smoke"]["scattering"] = [1.0, 2.0, 4.0] if colored else 4.0
    scene = clrender.Scene(**content).with_arrays(grids={"a": VALUES})
    notes = write_mitsuba(scene, tmp_path / "a.xml")
    assert notes == ("left out: grids that fall to zero at their edges, which keep their numbers (media.smoke)",)
    (file,) = (tmp_path / "a-files").glob("*.vol")
    numbers = np.frombuffer(file.read_bytes()[48:], "<f4").reshape(*VALUES.shape, -1)
    assert np.array_equal(numbers, VALUES[..., None] * np.array([0.25, 0.5, 1.0] if colored else [1.0], np.float32))
    text = (tmp_path / "a.xml").read_text()
    assert 'type="heterogeneous"' in text and ('name="raw"' in text) == colored
    again = clrender.load(tmp_path / "a.xml")
    density, values = grid_of(again)
    assert values.channels == 1 and (colored or np.array_equal(values.values, VALUES))
    assert grid_placement(density, values).tolist() == np.diag([2.0] * 4)[:3].tolist()
    (medium,) = again.media.values()
    for key in ("absorption", "scattering"):
        given = np.broadcast_to(getattr(scene.media["smoke"], key), 3)
        found = values.values[..., None].astype(np.float64) * np.array(getattr(medium, key))
        assert np.allclose(found, VALUES[..., None] * given, rtol=1e-6, atol=0.0)
    assert not any("colours" in note for note in again.notes)


@pytest.mark.parametrize("hues", ["none", "varying"])
def test_mitsuba_grids_of_colors(tmp_path: Path, hues: str) -> None:
    """Numbers take their place, and one hue; nothing is nothing."""
    colors = np.zeros((2, 3, 4, 3), np.float32) if hues == "none" else np.random.default_rng(1).random((2, 3, 4, 3))
    (tmp_path / "x.vol").write_bytes(vol_bytes(colors.astype(np.float32), channels=3))
    (tmp_path / "a.xml").write_text(MITSUBA.format("x.vol", ""))
    scene = clrender.load(tmp_path / "a.xml")
    _, values = grid_of(scene)
    (medium,) = scene.media.values()
    total = np.array(medium.scattering) + np.array(medium.absorption)
    if hues == "none":
        assert not values.values.any() and total.tolist() == [8.0] * 3
    else:
        assert ["colours weaken alike everywhere" in note for note in scene.notes] == [True]
        assert np.allclose(values.values, colors.mean(axis=-1), rtol=1e-6)
        assert np.allclose(total, 8.0 * colors.mean(axis=(0, 1, 2)) / colors.mean(), rtol=1e-5)


@pytest.mark.parametrize("export", [exported_to_luxcore, exported_to_cycles, exported_to_mitsuba])
@pytest.mark.parametrize("where", ["fog", "shape"])
def test_other_programs_are_told_of_emission(export: Any, where: str) -> None:
    content = described(None, **({"fog": "smoke", "shapes": [{**BOX, "interior": None}]} if where == "fog" else {}))
    content["media"]["smoke"]["emission"] = 1.0
    assert "left out: the emission of media (media.smoke.emission)" in export(clrender.Scene(**content), "files").notes


@pytest.mark.parametrize("export", [exported_to_luxcore, exported_to_cycles])
def test_other_programs_are_told(export: Any) -> None:
    scene = clrender.Scene(**described({"file": "a"})).with_arrays(grids={"a": VALUES})
    notes = export(scene, "files").notes
    assert "left out: grids of densities, of which media have 1 everywhere (media.smoke.density)" in notes


COLORS = np.random.RandomState(8).uniform(0.0, 1.0, (4, 5, 6, 3)).astype(np.float32)


def colored(**keys: Any) -> clrender.Scene:
    """A scene of a medium with grids of colours, and a temperature, of 1000 to 3000."""
    content = described({"file": "a"})
    medium = {"emission": 1.0, "albedo": {"file": "c"}, "temperature": {"file": "t", "scale": 2.0}, **keys}
    content["media"]["smoke"] |= {key: value for key, value in medium.items() if value is not None}
    return filled(content, {"a": VALUES, "c": COLORS, "t": VALUES * 500.0 + 500.0})


def filled(content: dict[str, Any], grids: dict[str, Any]) -> clrender.Scene:
    """A scene with those of these grids that it names."""
    scene = clrender.Scene(**content)
    return scene.with_arrays(grids={grid.file: grids[grid.file] for _, grid in scene.grids()})


def test_grids_of_colours_go_to_other_processes_and_files(tmp_path: Path) -> None:
    scene = colored(albedo={"file": "c", "transform": {"translate": [1.0, 0.0, 0.0]}})
    text, assets = scene_to_portable(scene)
    assert len(assets) == 3 and scene_from_portable(text, assets).sha256() == scene.sha256()
    export = exported(scene, "files")
    with export.written(tmp_path / "a.toml"):
        (tmp_path / "a.toml").write_bytes(scene_text(export.description, ".toml", "a test"))
    again = clrender.load(tmp_path / "a.toml")
    assert again.sha256() == scene.sha256()
    assert flatten(again, 8, 8).arrays_sha256 == flatten(scene, 8, 8).arrays_sha256


def test_scenes_are_known_by_all_their_grids() -> None:
    others = [
        colored(albedo={"file": "t"}).with_arrays(grids={"t": COLORS[..., 0]}),
        colored(temperature={"file": "t", "scale": 2.1}),
        colored(temperature={"file": "t", "scale": 2.0, "offset": 1.0}),
        colored(temperature=None, emission_grid={"file": "t"}),
        colored(albedo=None),
    ]
    scenes = [colored(), *others[1:]]
    assert len({each.sha256() for each in scenes}) == len(scenes)
    assert len({flatten(each, 8, 8).arrays_sha256 for each in scenes}) == len(scenes)


@pytest.mark.parametrize(
    ("keys", "said"),
    [
        ({"albedo": {"file": "t"}}, r"media\.smoke\.albedo\.file goes beyond 1, which scatters more"),
        (
            {"temperature": {"file": "c"}},
            r"media\.smoke\.temperature\.file has colours, but a temperature is one number",
        ),
        ({"density": {"file": "c"}}, r"media\.smoke\.density\.file has colours, but a density is one number"),
        ({"emission": 0.0}, r"media\.smoke\.temperature does nothing without emission"),
        ({"scattering": 0.0, "absorption": 1.0}, r"media\.smoke\.albedo does nothing without scattering"),
        ({"density": None}, r"media\.smoke\.albedo is given without a density"),
        ({"emission_grid": {"file": "c"}}, r"media\.smoke\.emission_grid is given beside temperature"),
    ],
)
def test_refused_grids_of_colours(keys: dict[str, Any], said: str) -> None:
    content = described({"file": "a"})
    table = {"emission": 1.0, "albedo": {"file": "c"}, "temperature": {"file": "t"}, **keys}
    content["media"]["smoke"] |= table
    content["media"]["smoke"] = {key: value for key, value in content["media"]["smoke"].items() if value is not None}
    with pytest.raises(SceneError, match=said):
        flatten(filled(content, {"a": VALUES, "c": COLORS, "t": VALUES * 500.0}), 8, 8)


def test_pbrt_temperatures_and_emissions(tmp_path: Path) -> None:
    def numbers(values: Any) -> str:
        return " ".join(f"{x:.9g}" for x in np.asarray(values).ravel())

    sides = '"integer nx" 6 "integer ny" 5 "integer nz" 4 '
    hot = f'"string type" "uniformgrid" {sides} "float density" [{numbers(VALUES)}] "rgb sigma_a" [1 2 3] '
    hot += f'"float temperature" [{numbers(VALUES * 900)}] "float temperatureoffset" 10 "float temperaturescale" 2'
    shining = f'"string type" "uniformgrid" {sides} "float density" [{numbers(VALUES)}] "rgb Le" [4 2 1] '
    shining += f'"float Lescale" [{numbers(VALUES * 3)}] "float scale" 5'
    dyed = f'"string type" "rgbgrid" {sides} "rgb sigma_s" [{numbers(COLORS)}] "rgb sigma_a" [{numbers(1.5 - COLORS)}] '
    dyed += f'"rgb Le" [{numbers(COLORS)}] "float Lescale" 2 "float scale" 4 "float g" 0.5'
    (tmp_path / "x.nvdb").write_bytes(nanovdb_bytes(VALUES) + nanovdb_bytes(VALUES * 900, name="temperature"))
    sparse = '"string type" "nanovdb" "string filename" "x.nvdb" "float Lescale" 3 "float temperaturecutoff" 20'
    scenes = []
    for number, medium in enumerate((hot, shining, dyed, sparse)):
        (tmp_path / f"{number}.pbrt").write_text(PBRT.format(f'MakeNamedMedium "m" {medium}'))
        scenes.append(clrender.load(tmp_path / f"{number}.pbrt"))
        assert not scenes[-1].notes
        flatten(scenes[-1], 8, 8)
    first, second, third, fourth = (next(iter(each.media.values())) for each in scenes)
    assert first.emission == (1.0, 2.0, 3.0) and first.temperature is not None
    assert (first.temperature.offset, first.temperature.scale) == (10.0, 2.0)
    assert np.array_equal(grid_of(scenes[0], "temperature")[1].values, (VALUES * 900).astype(np.float32))
    assert second.emission == (20.0, 10.0, 5.0)
    np.testing.assert_allclose(grid_of(scenes[1], "emission_grid")[1].values, VALUES * 3, rtol=1e-6)
    assert third.scattering == pytest.approx((4.0, 4.0, 4.0)) and third.absorption == (0.0, 0.0, 0.0)
    assert third.g == 0.5 and third.emission == (8.0, 8.0, 8.0)
    np.testing.assert_allclose(grid_of(scenes[2])[1].values, 1.5, rtol=1e-6)
    np.testing.assert_allclose(grid_of(scenes[2], "albedo")[1].values, COLORS / 1.5, rtol=1e-6)
    glow = grid_of(scenes[2], "emission_grid")[1].values
    np.testing.assert_allclose(glow, (1.5 - COLORS) * COLORS / 1.5, rtol=1e-5, atol=1e-7)
    assert fourth.emission == (3.0, 3.0, 3.0) and fourth.temperature is not None and fourth.temperature.offset == 20.0
    heat = grid_of(scenes[3], "temperature")[1].values[1:-1, 1:-1, 1:-1]
    assert np.array_equal(heat.transpose(2, 1, 0), (VALUES * 900).astype(np.float32))


@pytest.mark.parametrize(
    ("medium", "said"),
    [
        ('"string type" "rgbgrid" "rgb sigma_s" [1 1 1 1 1 1]', 'has 2 colours of "sigma_s" for 1 x 1 x 1'),
        ('"string type" "rgbgrid"', 'has neither "sigma_a" nor "sigma_s"'),
        ('"string type" "uniformgrid" "float density" 1 "float temperature" [1 2]', 'has 2 numbers of "temperature"'),
        ('"string type" "uniformgrid" "float density" 1 "float temperature" 2 "float temperaturescale" 0', "above 0"),
    ],
)
def test_refused_pbrt_colours(tmp_path: Path, medium: str, said: str) -> None:
    (tmp_path / "a.pbrt").write_text(PBRT.format(f'MakeNamedMedium "m" {medium}'))
    with pytest.raises(SceneError, match=re.escape(said)):
        clrender.load(tmp_path / "a.pbrt")


@pytest.mark.parametrize(
    ("keys", "emission", "density"),
    [
        ('"rgb sigma_a" [1 0 0] "rgb sigma_s" [0 0 0] "rgb Le" [1 1 1]', (1.0, 0.0, 0.0), True),
        ('"rgb sigma_a" [0 0 0] "rgb sigma_s" [0 0 0]', (0.0, 0.0, 0.0), False),
        ('"rgb sigma_a" [1 1 1] "rgb sigma_s" [1 1 1] "float scale" 0', (0.0, 0.0, 0.0), False),
    ],
)
def test_pbrt_grids_of_little_or_nothing(tmp_path: Path, keys: str, emission: Any, density: bool) -> None:
    (tmp_path / "a.pbrt").write_text(PBRT.format(f'MakeNamedMedium "m" "string type" "rgbgrid" {keys}'))
    (medium,) = clrender.load(tmp_path / "a.pbrt").media.values()
    assert (medium.emission == (0.0, 0.0, 0.0)) == (emission == (0.0, 0.0, 0.0))
    assert [each > 0.0 for each in medium.emission] == [each > 0.0 for each in emission]
    assert (medium.density is not None) == density


def test_one_hot_place_leaves_the_colours_of_others() -> None:
    values = np.full((2, 2, 2), 1200.0, np.float32)
    values[0, 0, 0] = 1e6
    content = described({"file": "a"})
    content["media"]["smoke"] |= {"emission": 1.0, "temperature": {"file": "t"}}
    scene = clrender.Scene(**content).with_arrays(grids={"a": VALUES, "t": values})
    arrays = flatten(scene, 8, 8).arrays
    columns = layout.columns("GRID_COLORS")
    row = arrays["grid_rows"].reshape(-1, 32)[1]
    first, count = row.view(np.uint32)[columns["COLORS"]], int(row[columns["COLOR_LAST"]]) + 1
    colors = arrays["grid_words"][first : first + 3 * count].reshape(count, 3)
    place = np.log2(1200.0 / 100.0) * layout.COLORS_PER_DOUBLING
    low = int(place)
    red = colors[low, 0] + (place - low) * (colors[low + 1, 0] - colors[low, 0])
    assert red == pytest.approx(black_body_hue(1200.0)[0], rel=5e-3)
    assert count < 900


def test_hues_of_pbrt_grids_that_vary_are_told(tmp_path: Path) -> None:
    colors = '"integer nx" 2 "rgb sigma_s" [1 0.2 0.1 0.1 0.2 1] "rgb sigma_a" [0 0 0 0 0 0]'
    (tmp_path / "a.pbrt").write_text(PBRT.format(f'MakeNamedMedium "m" "string type" "rgbgrid" {colors}'))
    assert "colours weaken alike everywhere" in " ".join(clrender.load(tmp_path / "a.pbrt").notes)


def test_albedos_of_mitsuba_go_there_and_back(tmp_path: Path) -> None:
    scene = colored(emission=0.0, temperature=None)
    assert write_mitsuba(scene, tmp_path / "a.xml") == ()
    again = clrender.load(tmp_path / "a.xml")
    (medium,) = again.media.values()
    assert medium.scattering == pytest.approx((2.0, 2.0, 2.0)) and medium.absorption == (0.0, 0.0, 0.0)
    np.testing.assert_allclose(grid_of(again, "albedo")[1].values, COLORS, rtol=1e-6)
    np.testing.assert_allclose(grid_of(again)[1].values, VALUES, rtol=1e-6)
    notes = exported_to_cycles(scene, "f").notes
    assert any("albedos" in each for each in notes)
