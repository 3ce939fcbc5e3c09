"""Scenes never change: nothing in them can be assigned to, and `changed` makes others, validated like a file."""

from __future__ import annotations

import copy
import math
import pickle
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cases import for_each

import clrender
from clrender import scene as scenes
from clrender.errors import SceneError
from clrender.meshes.data import MeshData
from clrender.scene.environment import EnvironmentPicture
from clrender.scene.frozen import frozen_array
from clrender.scene.groups import TransformArray

MESH: dict[str, Any] = {"type": "mesh", "file": "a.ply", "material": "white"}


def room() -> scenes.Scene:
    return scenes.load("room")


@for_each(
    "assign",
    [
        lambda s: setattr(s.image, "width", 5),
        lambda s: setattr(s, "camera", None),
        lambda s: setattr(s.materials["white"], "reflectance", (0.0, 0.0, 0.0)),
        lambda s: delattr(s, "materials"),
        lambda s: s.materials.__setitem__("white", s.materials["red"]),
        lambda s: s.materials.__delitem__("white"),
        lambda s: s.materials.update(white=s.materials["red"]),
        lambda s: s.materials.pop("white"),
        lambda s: s.materials.popitem(),
        lambda s: s.materials.clear(),
        lambda s: s.materials.setdefault("new", s.materials["red"]),
        lambda s: s.materials.__ior__({"white": s.materials["red"]}),
        lambda s: s.groups.__setitem__("a", 1),
        lambda s: s.media.__setitem__("a", 1),
        lambda s: s.files.meshes.__setitem__(("a", None), 1),
    ],
)
def test_assignments_are_refused_with_the_cure(assign: Callable[[Any], None]) -> None:
    scene = room()
    before = scene.sha256()
    for same in (scene, pickle.loads(pickle.dumps(scene)), copy.copy(scene), copy.deepcopy(scene), scene.model_copy()):
        with pytest.raises(SceneError, match=r"cannot be assigned to, because scenes never change; .*scene\.changed\("):
            assign(same)
        assert same.sha256() == before
    assert scene.materials == dict(scene.materials)
    loaded = clrender.load("room")
    with pytest.raises(SceneError, match="cannot be assigned to"):
        loaded.origin["name"] = "another"  # type: ignore[index]
    assert loaded.origin == {"name": "room"}
    assert list(scene.model_dump()["materials"]) == list(scene.materials)


def test_arrays_cannot_be_written_to(tmp_path: Path) -> None:
    (tmp_path / "a.ply").write_text(
        "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
        "element face 1\nproperty list uchar int vertex_indices\nend_header\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n"
    )
    camera = {"position": (0.0, 0.0, 3.0), "target": (0.0, 0.0, 0.0)}
    group = {"balls": {"shapes": [{"type": "sphere", "radius": 1.0}]}}
    placed = {"type": "instance", "group": "balls", "transforms": "places.npy"}
    scene = scenes.Scene.model_validate(
        {"camera": camera, "materials": {"white": {"type": "mirror"}}, "groups": group, "shapes": [MESH, placed]}
        | {"lights": [{"type": "environment", "file": "sky"}]}
    ).placed("scene", tmp_path)
    maps, pixels = np.tile(np.eye(3, 4), (2, 1, 1)), np.ones((2, 4, 3), np.float32)
    pictures = {"sky": EnvironmentPicture(pixels[:])}
    scene = scene.with_files(transforms={"places.npy": TransformArray(maps)}, environments=pictures)
    before = scene.sha256()
    picture = scene.environment_picture()
    assert picture is not None
    for array in (scene.mesh(0).vertices, scene.mesh(0).triangles, scene.transforms(1).maps, picture.pixels):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 0
    maps[:], pixels[:] = 7.0, 7.0  # the caller's own arrays are another matter
    other = scene.model_copy()
    assert other.sha256() == before == pickle.loads(pickle.dumps(scene)).sha256()
    vertices = np.eye(3, dtype=np.float32)
    mesh = MeshData(vertices, np.array([[0, 1, 2]], np.uint32))
    given = scene.with_files(meshes={"a.ply": mesh})
    vertices[:] = 9.0
    assert given.mesh(0).vertices.tolist() == np.eye(3).tolist()
    assert given.mesh(0).sha256() != scene.mesh(0).sha256()
    assert given.with_files(meshes={"a.ply": given.mesh(0)}).mesh(0) is given.mesh(0)  # no copy of what is read-only


def test_arrays_over_memory_of_others_are_copied(tmp_path: Path) -> None:
    """That they cannot be written to says nothing about the file or the buffer that they show."""
    corners, file = np.eye(3, dtype=np.float32), tmp_path / "corners.npy"
    np.save(file, corners)
    buffer = bytearray(corners.tobytes())
    mapped = np.load(file, mmap_mode="r")
    viewed = np.frombuffer(memoryview(buffer).toreadonly(), np.float32).reshape(3, 3)
    faces = np.array([[0, 1, 2]], np.uint32)
    scene = room().with_files(meshes={name: MeshData(array, faces) for name, array in (("m", mapped), ("b", viewed))})
    np.lib.format.open_memmap(file, "r+")[:] = 9.0
    buffer[:] = bytes(len(buffer))
    assert (mapped == 9.0).all()
    assert not viewed.any()
    for name in "mb":
        kept = scene._files.meshes[name, None].vertices
        assert type(kept) is np.ndarray
        assert kept.tolist() == corners.tolist()
    constant = np.frombuffer(corners.tobytes(), np.float32)
    assert frozen_array(constant, copied=True) is constant  # nobody can write to bytes


def test_contents_of_another_kind_are_refused() -> None:
    with pytest.raises(SceneError, match=r'"mesh" is no kind of a scene.s files; did you mean "meshes"\?'):
        room().with_files(mesh={})
    with pytest.raises(SceneError, match=r"meshes: the content of .*a.* is .*, but must be a MeshData"):
        room().with_files(meshes={"a": np.zeros((3, 3))})


def test_values_are_changed_by_their_places() -> None:
    scene = room()
    count = len(scene.shapes)
    made = scene.changed({"materials.white.reflectance[1]": 0.5, "camera.position": np.array([0, 1, -4])}, title="new")
    white, old = made.materials["white"], scene.materials["white"]
    assert isinstance(white, scenes.Lambert)
    assert isinstance(old, scenes.Lambert)
    assert white.reflectance == (old.reflectance[0], 0.5, old.reflectance[2])  # type: ignore[index]
    assert made.camera.position == (0.0, 1.0, -4.0)
    assert made.title == "new"
    assert made.materials["red"] is scene.materials["red"]
    assert made.lights is scene.lights
    moved = scene.changed(camera__vertical_fov=30.0, image__width=8)
    assert (moved.camera.vertical_fov, moved.image.width) == (30.0, 8)
    assert moved.materials is scene.materials
    assert moved.shares_contents(scene)
    assert moved.changed(camera__vertical_fov=None).camera.vertical_fov == 45.0
    ball = {"type": "sphere", "radius": 0.1, "material": "gold leaf"}
    more = scene.changed(
        {f"shapes[{count}]": ball, "shapes[0]": None, ("materials", "gold leaf"): {"type": "mirror"}, "image": None}
    )
    assert len(more.shapes) == count
    assert more.shapes[:-1] == scene.shapes[1:]
    assert more.image == scenes.Image()
    assert more.changed({'materials."gold leaf".reflectance': [0.5] * 3}).sha256() != more.sha256()
    assert more.changed({"materials.gold leaf": None, f"shapes[{count - 1}]": None}).materials == scene.materials
    shifted = scene.changed({"shapes[1].transform.translate": [0.0, 0.1, 0.0]})
    assert shifted.shapes[1].transform.translate == (0.0, 0.1, 0.0)
    assert scene.changed({"materials.white.type": "mirror"}).materials["white"] == scenes.Mirror(
        type="mirror", **old.model_dump(exclude_unset=True, exclude={"type"})
    )
    assert scene.changed().sha256() == scene.changed({}).sha256() == scene.sha256()
    assert scene.camera.changed(vertical_fov=20.0).vertical_fov == 20.0
    assert (scene.changed(title="a").source, scene.changed(title="a").base_folder) == (scene.source, scene.base_folder)


BAD: list[tuple[Any, str]] = [
    ({"camera.vertcal_fov": 40.0}, 'camera.vertcal_fov is an unknown key; did you mean "vertical_fov"'),
    ({"camra.position": 1}, 'camra is an unknown key; did you mean "camera"'),
    ({"materials.whit.reflectance": [0.1] * 3}, r'materials\.whit is not there; did you mean "white"'),
    ({"materials.whit": None}, r'materials\.whit is not there; did you mean "white"'),
    ({"materials.white.reflectance": math.nan}, r"white\.reflectance\[0\] is nan, but must be a finite number"),
    ({"materials.white.reflectance": "grey"}, r'white\.reflectance is the text "grey", but must be a list'),
    ({"materials.white.reflectance[2]": math.nan}, r"materials\.white\.reflectance\[2\] is nan, but must be a finite"),
    (
        {"materials.white.reflectance": [0.5, -1, 0.5]},
        r"materials\.white\.reflectance\[1\] is -1, but must be at least",
    ),
    ({"materials.white.reflectance": "red"}, r'materials\.white\.reflectance is the text "red"'),
    ({"materials.white": {"type": "lambrt"}}, r'materials\.white\.type is "lambrt", .* did you mean "lambert"'),
    ({"camera.vertical_fov": 400}, r"camera\.vertical_fov is 400, but must be at most 360"),
    ({"camera.target": (0.0, 0.0, 0.0), "camera.position": (0.0, 0.0, 0.0)}, "camera"),
    ({"camera": None}, "the key `camera` is missing"),
    ({"materials.white": None}, r'shapes\[0\]\.material names a material "white" that does not exist'),
    ({"shapes[0].material": "whit"}, r'shapes\[0\]\.material names .* did you mean "white"'),
    ({"shapes[99].radius": 1.0}, r"shapes\[99\] is not there: shapes has \d+ entries"),
    ({"shapes[99]": None}, r"shapes\[99\] is not there"),
    ({"shapes[-1].material": "red"}, r"shapes\[-1\] is not there"),
    ({"shapes[0].transform.translate": [0, "a", 0]}, r'shapes\[0\]\.transform\.translate\[1\] is the text "a"'),
    ({"title.x": 1}, r'title is the text .* which has no "x" inside'),
    ({"fog": "smoke"}, "fog names a medium"),
    ({"": 1}, "is not a place in a scene; write it like"),
    ({"a..b": 1}, "is not a place in a scene"),
    ({3: 1}, "3 is not a place in a scene"),
    ({"camera": {}, "camera.up": 1}, "is inside of another place"),
    ({"camera.up": 1, "camera": {}}, "has another place inside"),
    ("camera", "changes are a table of places and values"),
]


@for_each(("paths", "message"), BAD)
def test_what_is_not_allowed_is_refused(paths: Any, message: str) -> None:
    with pytest.raises(SceneError, match=message):
        room().changed(paths)


@pytest.mark.parametrize(
    "update",
    [{"camra": 1}, {"title": 5}, {"camera": {"position": "red"}}, {"materials": {}}, {"image": {"width": -1}}],
)
def test_copies_with_updates_are_validated(update: dict[str, Any]) -> None:
    with pytest.raises(SceneError):
        room().model_copy(update=update)


def test_copies_with_updates_are_changes() -> None:
    scene = room()
    assert scene.model_copy(update={"title": "a"}).title == "a"
    with pytest.raises(SceneError, match="vertical_fov is 400"):
        scene.camera.model_copy(update={"vertical_fov": 400})
    with pytest.raises(SceneError, match="would check nothing"):
        scenes.Camera.model_construct(position=1)  # type: ignore[arg-type]


def test_numbers_of_numpy_are_numbers() -> None:
    mesh = {"vertices": np.eye(3, dtype=np.float32), "faces": np.array([[0, 1, 2]], np.int32), "type": "mesh"}
    camera = scenes.Camera(position=(np.float32(0.0), np.int64(0), 3), target=np.zeros(3, np.float32))
    scene = scenes.Scene(camera=camera, shapes=[mesh], image={"width": np.int16(4), "height": 4})
    plain = scene.changed({"shapes[0].faces": [[0, 1, 2]], "shapes[0].vertices": np.eye(3).tolist()})
    assert plain.sha256() == scene.sha256()
    assert type(scene.image.width) is int
    with pytest.raises(SceneError, match=r"shapes\[0\]\.faces\[0\]\[0\] is 0\.5"):
        scene.changed({"shapes[0].faces": np.array([[0.5, 1.0, 2.0]])})
