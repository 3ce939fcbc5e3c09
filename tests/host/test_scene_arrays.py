"""Scenes from arrays are those of files with the same content; and what is refused of arrays."""

from __future__ import annotations

import copy
import pickle
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from PIL import Image

import clrender
from clrender.errors import SceneError
from clrender.flatten.flat_scene import flatten
from clrender.image.files import write_image
from clrender.scene import Scene

if TYPE_CHECKING:
    from clrender.device import Device

VERTICES = np.array([[-1.0, -1.0, 0.0], [1.0, -1.0, 0.0], [1.0, 1.0, 0.2], [-1.0, 1.0, 0.1]], np.float32)
FACES = np.array([[0, 1, 2], [0, 2, 3]])
UVS = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]], np.float32)
NORMALS = np.array([[0.1, 0.0, 1.0], [0.0, 0.1, 1.0], [-0.1, 0.0, 1.0], [0.0, 0.0, 1.0]], np.float32)
RNG = np.random.default_rng(1)


def described(mesh: str = "body", texture: str = "paint.png", around: str = "sky.exr", **more: Any) -> Scene:
    return Scene(
        camera={"position": [0, 0, 4], "target": [0, 0, 0], "vertical_fov": 40.0},
        materials={"m": {"type": "lambert", "reflectance": {"texture": texture, "color_space": "srgb"}}},
        shapes=[{"type": "mesh", "file": mesh, "material": "m", **more}],
        lights=[{"type": "environment", "file": around}],
    )


def arrays(**more: Any) -> dict[str, Any]:
    return {"vertices": VERTICES, "faces": FACES, "normals": NORMALS, "uvs": UVS, **more}


def obj(folder: Path) -> None:
    lines = [f"v {x!r} {y!r} {z!r}" for x, y, z in VERTICES.tolist()]
    lines += [f"vt {u!r} {v!r}" for u, v in UVS.tolist()] + [f"vn {x!r} {y!r} {z!r}" for x, y, z in NORMALS.tolist()]
    lines += ["f " + " ".join(f"{n + 1}/{n + 1}/{n + 1}" for n in face) for face in FACES.tolist()]
    (folder / "body.obj").write_text("\n".join(lines) + "\n")


def test_arrays_are_what_files_of_their_content_are(device: Device, tmp_path: Path) -> None:
    obj(tmp_path)
    paint = RNG.integers(0, 256, (6, 5, 3), np.uint8)
    Image.fromarray(paint).save(tmp_path / "paint.png")
    sky = RNG.random((4, 8, 3)).astype(np.float32)
    write_image(tmp_path / "sky.exr", sky)
    files = described("body.obj").placed("files", tmp_path)
    given = described().with_arrays(
        meshes={"body": arrays()}, textures={"paint.png": paint}, environments={"sky.exr": sky}
    )
    assert given.sha256() == files.sha256()
    assert flatten(given, 8, 8).arrays_sha256 == flatten(files, 8, 8).arrays_sha256
    with clrender.Session(device.info.index) as session:
        first, second = (session.render(each, size=(24, 20), spp=4) for each in (given, files))
    assert first.stats["image_sha256"] == second.stats["image_sha256"]
    assert first.linear.std() > 0.0


def test_scenes_of_arrays_are_copied_and_pickled(device: Device) -> None:
    sky = np.ones((4, 8, 3), np.float32)
    scene = described().with_arrays(
        meshes={"body": arrays()}, textures={"paint.png": np.full((2, 2), 128, np.uint8)}, environments={"sky.exr": sky}
    )
    job = clrender.RenderJob.of(scene, size=(8, 8), spp=2)
    for same in (copy.copy(scene), copy.deepcopy(scene), pickle.loads(pickle.dumps(scene))):
        assert same.sha256() == scene.sha256() and flatten(same, 8, 8).sha256 == flatten(scene, 8, 8).sha256
    again = pickle.loads(pickle.dumps(job))
    assert again.sha256() == job.sha256()
    with clrender.Session(device.info.index) as session:
        image = session.render(job)
    for same in (copy.deepcopy(image), pickle.loads(pickle.dumps(image))):
        np.testing.assert_array_equal(same.linear, image.linear)
        np.testing.assert_array_equal(same.film.mean(), image.film.mean())


def test_vertices_move_from_frame_to_frame(device: Device) -> None:
    """What is not given stays; with a session that refits, only the BVH is brought up to date."""
    lit = {"paint.png": np.full((1, 1), 50, np.uint8)}
    scene = described().with_arrays(
        meshes={"body": arrays(normals=None)}, textures=lit, environments={"sky.exr": np.ones((2, 4, 3), np.float32)}
    )
    moved = [VERTICES + np.array([0.1 * n, 0.0, 0.0]) for n in range(3)]
    frames = [scene.with_arrays(meshes={"body": {"vertices": each}}) for each in moved]
    with clrender.Session(device.info.index, refit=True) as session:
        images = [session.render(frame, size=(24, 20), spp=16) for frame in frames]
    dark = [1.0 - image.linear[..., 1].astype(np.float64).sum(axis=0) / 20.0 for image in images]
    left = [float(each @ np.arange(24) / each.sum()) for each in dark]
    assert left[1] - left[0] == pytest.approx(left[2] - left[1], rel=0.2) and left[1] > left[0] + 0.3


def test_more_than_numpy() -> None:
    """Lists, what has ``__array__``, and what has ``__dlpack__`` alone."""

    class Tensor:
        def __init__(self, array: Any) -> None:
            self.array = array

        def __dlpack__(self, **_: Any) -> Any:
            return self.array.__dlpack__()

        def __dlpack_device__(self) -> Any:
            return self.array.__dlpack_device__()

    plain = described().with_arrays(meshes={"body": arrays()})
    for turn in (np.ndarray.tolist, Tensor, memoryview):
        given = {key: turn(array) for key, array in arrays().items()}
        meshes = described().with_arrays(meshes={"body": given})._files.meshes
        assert meshes["body", None].sha256() == plain._files.meshes["body", None].sha256()


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16, np.float16, np.float32, np.float64])
@pytest.mark.parametrize("channels", [0, 1, 3, 4])
def test_pictures_of_all_kinds(dtype: Any, channels: int) -> None:
    shape = (3, 5, channels) if channels else (3, 5)
    values = RNG.random(shape) if np.dtype(dtype).kind == "f" else RNG.integers(0, 250, shape)
    scene = described().with_arrays(textures={"paint.png": values.astype(dtype)})
    stored, tiles = scene._files.textures["paint.png"]
    assert (stored.width, stored.height, stored.channels) == (5, 3, 4 if channels >= 3 else 1)
    assert stored.coding == {1: "unorm8", 2: "half" if dtype is np.float16 else "unorm16"}.get(
        np.dtype(dtype).itemsize, "float"
    )
    assert tiles.shape == (stored.tiles, 64)


WRONG: list[tuple[dict[str, Any], str]] = [
    ({"meshes": {"Body": arrays()}}, 'meshes: nothing in the scene names "Body"; did you mean "body"?'),
    ({"textures": {"paint": np.zeros((2, 2))}}, 'textures: nothing in the scene names "paint"; did you mean "paint'),
    ({"environments": {"sun": np.zeros((2, 4, 3))}}, 'environments: nothing in the scene names "sun"; known here: sky'),
    ({"grids": {"fog": np.zeros((2, 2, 2))}}, 'grids: nothing in the scene names "fog"; there is none here'),
    ({"curves": {"hair": np.ones((2, 4, 4))}}, 'curves: nothing in the scene names "hair"; there is none here'),
    ({"meshes": {"Body": {"vertices": VERTICES}}}, 'meshes: nothing in the scene names "Body"; did you mean "body"?'),
    (
        {"textures": {Path("paint.png"): np.zeros((2, 2))}},
        "paint.png') is no text; give the name of a file as the scene",
    ),
    ({"textures": {3: np.zeros((2, 2))}}, "textures: 3 is no text; give the name of a file as the scene writes it"),
    ({"meshes": [1]}, "meshes is a list of one, but must be a table of arrays by the names of files"),
    ({"meshes": {"body": {"vertices": VERTICES}}}, 'meshes: "body": faces are missing; add them'),
    ({"meshes": {"body": arrays(face=FACES)}}, 'meshes: "body": "face" is an unknown array; did you mean "faces"?'),
    ({"meshes": {"body": arrays(vertices=VERTICES[:, :2])}}, "vertices have the shape (4, 2), but must have (n, 3)"),
    ({"meshes": {"body": arrays(vertices="abc")}}, "vertices is of the type str"),
    ({"meshes": {"body": arrays(vertices=VERTICES * np.nan)}}, "vertices have numbers that are not finite"),
    ({"meshes": {"body": arrays(faces=FACES + 2)}}, "faces have the index 5, but the mesh has 4 vertices"),
    ({"meshes": {"body": arrays(faces=FACES - 1)}}, "faces have the index -1; indices count from 0"),
    ({"meshes": {"body": arrays(faces=FACES * 0.5)}}, "must have (n, 3) of whole numbers"),
    ({"meshes": {"body": arrays(normals=NORMALS[:2])}}, "it has 2 normals, but 4 vertices"),
    (
        {"meshes": {"body": arrays(uvs=UVS[:3])}},
        "uvs have the shape (3, 2), but must have (4, 2), for vertices, or (2, 3, 2)",
    ),
    ({"meshes": {"body": arrays(colors=np.full((4, 3), 2.0))}}, "colors have numbers that are not between 0 and 1"),
    ({"meshes": {"body": 3}}, 'meshes: "body" is 3, but must be a table of arrays'),
    (
        {"textures": {"paint.png": np.zeros((2, 2, 2))}},
        'textures: "paint.png" has the shape (2, 2, 2) of float64, but must have',
    ),
    ({"textures": {"paint.png": np.zeros((2, 2), np.int32)}}, "of uint8, uint16, float16 or float32"),
    ({"textures": {"paint.png": np.full((2, 2), np.inf)}}, "has numbers that are not finite"),
    ({"environments": {"sky.exr": np.zeros((2, 2))}}, 'environments: "sky.exr" has the shape (2, 2) of float64'),
    ({"environments": {"sky.exr": np.full((2, 2, 3), -1.0)}}, "radiance must be"),
    # Beyond single precision, and no numbers
    ({"environments": {"sky.exr": np.full((2, 2, 3), 1e300)}}, "radiance must be"),
    ({"textures": {"paint.png": np.full((2, 2), 1e39)}}, "has numbers that are not finite"),
    ({"grids": {"g": np.full((2, 2, 2), 1e300)}}, "but numbers of grids are from 0 to"),
    ({"meshes": {"body": arrays(uvs=np.full((4, 2), 1e39))}}, "uvs have numbers that are not finite"),
    ({"grids": {"g": np.array([[[None]]])}}, 'grids: "g" is an array of object, but must be an array of real numbers'),
    ({"grids": {"g": np.ma.masked_less(np.eye(2)[None], 0.5)}}, 'grids: "g" has numbers that are masked; say what'),
    ({"curves": {"c": None}}, 'curves: "c" is of the type NoneType, but must be an array of real numbers'),
]


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize(("given", "words"), WRONG)
def test_wrong_arrays_are_refused(given: dict[str, Any], words: str) -> None:
    scene = described()
    if given.get("grids", {}).keys() & {"g"}:
        medium = {"smoke": {"scattering": [1.0, 1.0, 1.0], "density": {"file": "g"}}}
        scene = scene.changed({"media": medium, "shapes[1]": {"type": "box", "size": [1, 1, 1], "interior": "smoke"}})
    elif given.get("curves", {}).keys() & {"c"}:
        scene = scene.changed({"shapes[1]": {"type": "curves", "file": "c", "material": "m"}})
    with pytest.raises(SceneError) as caught:
        scene.with_arrays(**given)
    assert words in str(caught.value) and "\n" not in str(caught.value)


def test_normals_do_not_stay_behind() -> None:
    scene = described().with_arrays(meshes={"body": arrays()})
    with pytest.raises(SceneError, match="has normals, which do not follow its vertices; give new ones, or None"):
        scene.with_arrays(meshes={"body": {"vertices": VERTICES * 2.0}})
    assert (
        scene.with_arrays(meshes={"body": {"vertices": VERTICES, "normals": None}})._files.meshes["body", None].normals
        is None
    )
    with pytest.raises(SceneError, match="has uvs of 2 faces, but there are 1; give uvs as well"):
        scene.with_arrays(meshes={"body": {"faces": FACES[:1]}})
