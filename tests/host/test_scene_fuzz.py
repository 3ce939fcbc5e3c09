"""The loader under random and mutated input: it answers with a scene or a `SceneError`, soon, and with nothing else."""

from __future__ import annotations

import copy
import json
import math
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from clrender import scene as scenes
from clrender.errors import SceneError
from clrender.files.package_data import scenes_folder
from clrender.flatten.flat_scene import flatten

BUILTIN = ("room", "cornell", "directional-plane", "furnace-sphere", "slab", "point-plane")
MESH = {
    "camera": {"position": [0, 0, 5], "target": [0, 0, 0]},
    "shapes": [
        {"type": "mesh", "vertices": [[0, 0, 0], [1, 0, 0], [0, 1, 0]], "faces": [[0, 1, 2]]},
        {"type": "disk", "normal": [0, 1, 0], "radius": 1, "transform": {"scale": 2, "rotate_degrees": [1, 2, 3]}},
        {"type": "triangle", "vertices": [[0, 0, 0], [1, 0, 0], [0, 1, 0]], "transform": {"matrix": [1.0] * 16}},
    ],
}
PLY = (
    b"ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n"
    b"element face 2\nproperty list uchar int vertex_indices\nend_header\n"
    b"0 0 0\n1 0 0\n1 1 0\n0 1 0\n4 0 1 2 3\n3 0 2 3\n"
)
BINARY = (
    PLY[: PLY.index(b"end_header\n") + 11].replace(b"ascii", b"binary_little_endian")
    + b"\x00\x00\x80\x3f" * 12
    + (b"\x03" + b"\x01\x00\x00\x00" * 3) * 2
)
OBJ = b"# a\nv 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvt 0 0\nvn 0 0 1\nf 1/1/1 2/1/1 3/1/1\nf -4//1 -2//1 -1//1\n"

# `derandomize` keeps a run repeatable; the minute-long one below looks further.
SHORT = settings(
    max_examples=250, deadline=5000, derandomize=True, suppress_health_check=list(HealthCheck), database=None
)
LONG = settings(SHORT, max_examples=11000, derandomize=False)

NUMBERS = st.one_of(
    st.sampled_from([0, 1, -1, 0.0, -0.0, 1e-40, 1e-300, 1e15, 1e16, 1e308, math.nan, math.inf, -math.inf]),
    st.sampled_from([2**31, 2**64, 10**40]),
    st.integers(),
    st.floats(),
)  # fmt: skip
WORDS = st.one_of(
    st.sampled_from(
        ["type", "sphere", "mesh", "file", "material", "white", "..", "/dev/zero", "a.ply", "", "\x00", "[key]"]
    ),
    st.text(max_size=12),
)
JUNK = st.recursive(
    st.one_of(st.none(), st.booleans(), NUMBERS, WORDS),
    lambda inner: st.one_of(st.lists(inner, max_size=5), st.dictionaries(WORDS, inner, max_size=4)),
    max_leaves=12,
)


def answers(path: Path) -> None:
    """Load and flatten; any exception but `SceneError` fails the test."""
    try:
        scene = scenes.load(path)
        flatten(scene, 8, 8)
        scene.sha256()
    except SceneError as error:
        message = str(error)
        assert "\n" not in message and message.isprintable() and len(message) < 6000
        assert path.name in message


def places(value: Any, path: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    """All places in a scene, the containers too."""
    found = [path] if path else []
    if isinstance(value, dict):
        found += [place for key in value for place in places(value[key], (*path, key))]
    elif isinstance(value, list):
        found += [place for key, item in enumerate(value) for place in places(item, (*path, key))]
    return found


def valid_scenes() -> list[dict[str, Any]]:
    loaded = [scenes.load(name).model_dump(mode="json", exclude_unset=True) for name in BUILTIN]
    return [*loaded, MESH]


VALID = valid_scenes()


@st.composite
def mutated(draw: st.DrawFn) -> Any:
    """A valid scene with a few places changed, removed, doubled, renamed or swapped."""
    scene = copy.deepcopy(draw(st.sampled_from(VALID)))
    for _ in range(draw(st.integers(1, 3))):
        spots = places(scene)
        if not spots:
            break
        *way, last = draw(st.sampled_from(spots))
        holder = scene
        for step in way:
            holder = holder[step]
        action = draw(st.sampled_from(["replace", "number", "remove", "double", "rename", "add"]))
        if action == "replace":
            holder[last] = draw(JUNK)
        elif action == "number":
            holder[last] = draw(NUMBERS)
        elif action == "remove":
            del holder[last]
        elif action == "double" and isinstance(holder, list):
            holder.append(copy.deepcopy(holder[last]))
        elif isinstance(holder, dict):
            value = holder.pop(last) if action == "rename" else draw(JUNK)
            holder[draw(WORDS)] = value
    return scene


def check_mutation(scene: Any, folder: Path) -> None:
    path = folder / "fuzz.json"
    path.write_text(json.dumps(scene))
    answers(path)


def check_bytes(data: bytes, folder: Path, name: str) -> None:
    path = folder / name
    path.write_bytes(data)
    answers(path)


def check_mesh(data: bytes, folder: Path, ending: str) -> None:
    (folder / f"m.{ending}").write_bytes(data)
    path = folder / "fuzz.json"
    path.write_text(json.dumps({**MESH, "shapes": [{"type": "mesh", "file": f"m.{ending}"}]}))
    answers(path)


@st.composite
def damaged(draw: st.DrawFn, *originals: bytes) -> bytes:
    """A file with pieces cut out, overwritten, repeated or inserted."""
    data = bytearray(draw(st.sampled_from(originals)))
    pieces = st.one_of(
        st.binary(max_size=8),
        st.sampled_from(
            [b"nan", b"-1", b"1e999", b"99999999999", b"\n", b" ", b"/", b"-", b"end_header\n", b"property "]
        ),
    )
    for _ in range(draw(st.integers(1, 4))):
        start = draw(st.integers(0, len(data)))
        data[start : start + draw(st.integers(0, 8))] = draw(pieces)
    return bytes(data[: draw(st.integers(0, len(data)))]) if draw(st.booleans()) else bytes(data)


TEXTS = [(scenes_folder() / f"{name}.toml").read_bytes() for name in BUILTIN]
RANDOM = st.one_of(
    st.binary(max_size=200), st.text(max_size=200).map(lambda text: text.encode("utf-8", "surrogatepass"))
)


@SHORT
@given(scene=mutated())
def test_mutated_scenes(scene: Any, tmp_path_factory: pytest.TempPathFactory) -> None:
    check_mutation(scene, tmp_path_factory.getbasetemp())


@SHORT
@given(scene=JUNK)
def test_random_json(scene: Any, tmp_path_factory: pytest.TempPathFactory) -> None:
    check_mutation(scene, tmp_path_factory.getbasetemp())


@SHORT
@given(data=st.one_of(RANDOM, damaged(*TEXTS)), name=st.sampled_from(["fuzz.toml", "fuzz.json"]))
def test_damaged_text(data: bytes, name: str, tmp_path_factory: pytest.TempPathFactory) -> None:
    check_bytes(data, tmp_path_factory.getbasetemp(), name)


@SHORT
@given(data=st.one_of(RANDOM, damaged(PLY, BINARY)))
def test_damaged_ply(data: bytes, tmp_path_factory: pytest.TempPathFactory) -> None:
    check_mesh(data, tmp_path_factory.getbasetemp(), "ply")


@SHORT
@given(data=st.one_of(RANDOM, damaged(OBJ)))
def test_damaged_obj(data: bytes, tmp_path_factory: pytest.TempPathFactory) -> None:
    check_mesh(data, tmp_path_factory.getbasetemp(), "obj")


@pytest.mark.slow
@LONG
@given(scene=mutated(), text=st.one_of(RANDOM, damaged(*TEXTS)), ply=damaged(PLY, BINARY), obj=damaged(OBJ))
def test_for_a_minute(
    scene: Any, text: bytes, ply: bytes, obj: bytes, tmp_path_factory: pytest.TempPathFactory
) -> None:
    folder = tmp_path_factory.getbasetemp()
    check_mutation(scene, folder)
    check_bytes(text, folder, "fuzz.toml")
    check_mesh(ply, folder, "ply")
    check_mesh(obj, folder, "obj")
