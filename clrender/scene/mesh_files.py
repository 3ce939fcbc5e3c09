"""PLY and OBJ files as triangles: trimesh parses, and what it would guess at or pass over is refused before."""

from __future__ import annotations

import io
import re
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import pairwise
from typing import Any, BinaryIO, Final

import numpy as np
from numpy.typing import NDArray
from trimesh.exchange.obj import load_obj
from trimesh.exchange.ply import load_ply

from clrender.errors import SceneError
from clrender.scene.mesh_io import TRIANGLE_LIMIT, MeshData
from clrender.scene.ply_header import PlyHeader, read_header
from clrender.scene.wording import quoted

__all__ = ["read_obj", "read_ply"]

_NUMBER: Final = r"[-+]?(?:[0-9]+(?:\.[0-9]*)?|\.[0-9]+)(?:[eE][-+]?[0-9]{1,4})?"
_INDEX: Final = r"-?0*[1-9][0-9]{0,9}"
_CORNER: Final = rf"{_INDEX}(?:/{_INDEX}|/(?:{_INDEX})?/{_INDEX})?"
# Each finds the first line of its kind that is not what the format asks for.
_BAD_LINES: Final = (
    (re.compile(rf"^vn?(?: (?!{_NUMBER}(?: {_NUMBER}){{2,}}$)|$)", re.M), "is not a position or normal of 3 numbers"),
    (re.compile(rf"^f(?: (?!{_CORNER}(?: {_CORNER}){{2,}}$)|$)", re.M), "is not a face of 3 or more vertex indices"),
)


@contextmanager
def _parsing(label: str) -> Iterator[None]:
    """Turns whatever the library trips over into one sentence; a warning of it means that it guessed."""
    try:
        with warnings.catch_warnings(), np.errstate(all="raise"):
            warnings.simplefilter("error")
            yield
    except (SceneError, MemoryError):
        raise
    except IndexError:
        raise SceneError(f"{label} has a face that names a vertex or normal the file does not hold") from None
    except Exception as error:
        reason = quoted(str(error).replace("\n", " ") or type(error).__name__)
        raise SceneError(f"{label} cannot be read as a mesh: {reason}; export it again") from None


def read_ply(file: BinaryIO, size: int, label: str) -> MeshData:
    """Read a PLY file, ASCII or binary, with polygons split into fans.

    Parameters
    ----------
    file : binary file
        At its start.
    size : int
        Bytes.
    label : str
        Start of an error message.

    Raises
    ------
    SceneError
        If it is truncated, damaged or not a mesh.
    """
    header = read_header(file, label)
    faces_element = header.element("face")
    assert faces_element is not None
    source: BinaryIO = file
    if header.is_ascii:
        source = io.BytesIO(_sound_ascii(file, header, label))
    else:
        least = header.size + sum(element.least_bytes for element in header.elements)
        if size < least:
            raise SceneError(f"{label} is truncated: it has {size} bytes, but its header promises at least {least}")
        file.seek(0)
    with _parsing(label):
        try:
            found = load_ply(source, skip_materials=True, fix_texture=False)
        except ValueError as error:
            if "unexpected length" not in str(error):
                raise
            raise SceneError(
                f"{label} has not the length its header promises: it is truncated, damaged, or mixes triangles with "
                "polygons; export it again as triangles"
            ) from None
        vertex = found["metadata"]["_ply_raw"]["vertex"]["data"]
        if not header.is_ascii:
            lists = found["metadata"]["_ply_raw"]["face"]["data"][faces_element.index_list]
            if (lists["f0"] != lists["f0"][0]).any():
                raise SceneError(f"{label} is damaged: its faces differ in size, which its length does not allow")
        vertices = np.ascontiguousarray(found["vertices"])
        faces = np.asarray(found["faces"])
        normals = found.get("vertex_normals")
        if normals is None and {"nx", "ny", "nz"} <= set(vertex if isinstance(vertex, dict) else vertex.dtype.names):
            raise SceneError(f"{label} has normals that cannot be read")
    if faces.ndim == 2 and len(faces) == faces_element.count and faces.shape[1] < 3:
        raise SceneError(f"{label} has faces of fewer than three vertices")
    return MeshData(vertices, _triangles(faces, len(vertices), label), None if normals is None else np.asarray(normals))


def _sound_ascii(file: BinaryIO, header: PlyHeader, label: str) -> bytes:
    """The whole file with one record on each line and nothing besides, so that nothing is left to guess."""
    lines = [line for line in file.read().splitlines() if line.strip()]
    total = sum(element.count for element in header.elements)
    if len(lines) != total:
        state = "is truncated" if len(lines) < total else "has lines left over"
        raise SceneError(f"{label} {state}: its header promises {total} records, but {len(lines)} follow")
    start, triangles = 0, 0
    for element in header.elements:
        for number, line in enumerate(lines[start : start + element.count]):
            words, at = line.split(), 0
            for entry in element.properties:
                step = 1
                if len(entry) == 3:
                    is_count = at < len(words) and words[at].isdigit() and len(words[at]) < 9
                    step = 1 + int(words[at]) if is_count else len(words) + 1
                    if entry[0] == element.index_list and element.name == "face":
                        triangles += max(0, step - 3)
                        step = step if step > 3 else len(words) + 1
                at += step
            if at != len(words):
                text = f"record {number} of element {quoted(element.name)} has not the numbers its header promises"
                raise SceneError(f"{label} is damaged: {text}")
        start += element.count
    if triangles > TRIANGLE_LIMIT:
        raise SceneError(f"{label} holds {triangles} triangles, but at most {TRIANGLE_LIMIT} are read")
    # The library splits polygons of one file only when all have one size, so faces are split here.
    file.seek(0)
    return _only_triangles(file.read(header.size), lines, header)


def _only_triangles(head: bytes, lines: list[bytes], header: PlyHeader) -> bytes:
    """The file with every polygon as a fan of triangles and no element but vertices and faces."""
    vertex, face = header.element("vertex"), header.element("face")
    assert vertex is not None and face is not None
    starts, at = {}, 0
    for element in header.elements:
        starts[element.name] = at
        at += element.count
    before = face.properties[: [entry[0] for entry in face.properties].index(str(face.index_list))]
    fans: list[bytes] = []
    for line in lines[starts["face"] : starts["face"] + face.count]:
        words, skip = line.split(), 0
        for entry in before:
            skip += 1 + int(words[skip]) if len(entry) == 3 else 1
        corners = words[skip + 1 : skip + 1 + int(words[skip])]
        fans += [b"3 %b %b %b" % (corners[0], b, c) for b, c in pairwise(corners[1:])]
    properties = "".join(
        f"property {' '.join(['list', *e[1:]] if len(e) == 3 else e[1:])} {e[0]}\n" for e in vertex.properties
    )
    clean = (
        f"ply\nformat ascii 1.0\nelement vertex {vertex.count}\n{properties}"
        f"element face {len(fans)}\nproperty list uchar int vertex_indices\nend_header\n"
    )
    body = lines[starts["vertex"] : starts["vertex"] + vertex.count] + fans
    return clean.encode("latin-1") + b"\n".join(body) + b"\n"


def read_obj(file: BinaryIO, size: int, label: str) -> MeshData:
    """Read an OBJ file: positions, normals and faces; everything else in it is passed over.

    Parameters and errors are those of `read_ply`.
    """
    del size
    text = _plain_obj(file.read().decode("utf-8", errors="replace"))
    for pattern, what in _BAD_LINES:
        bad = pattern.search(text)
        if bad:
            line = text[bad.start() : bad.start() + 80].split("\n", 1)[0]
            number = text.count("\n", 0, bad.start())
            raise SceneError(f"{label}: line {number} {what}: {quoted(line)}")
    counts = {kind: text.count(f"\n{kind} ") for kind in ("v", "vn", "f")}
    for kind, what in (("v", "vertices"), ("f", "faces")):
        if counts[kind] == 0:
            raise SceneError(f"{label} holds no {what}; a mesh needs vertices and faces")
        if counts[kind] > TRIANGLE_LIMIT:
            raise SceneError(f"{label} holds {counts[kind]} {what}, but at most {TRIANGLE_LIMIT} are read")
    # Texture coordinates do not count, and would only split vertices.
    text = re.sub(r"/-?[0-9]+/(?=[-0-9])", "//", text)
    text = re.sub(r"(?<=[0-9])/-?[0-9]+(?=[ \n])", "", text)
    if re.search(r"^f (?:.*-|(?:[^ \n]+ ){3})", text, re.M):
        text = _absolute_triangles(text, counts, label)
    corners, with_normals = 3 * text.count("\nf "), text.count("//")
    if with_normals not in (0, corners):
        raise SceneError(f"{label} gives normals to some corners of its faces only; give them to all or to none")
    with _parsing(label):
        found: dict[str, Any] = load_obj(io.StringIO(text), skip_materials=True, group_material=False)
        meshes = list(found.get("geometry", {}).values())
        if len(meshes) != 1:
            raise SceneError(f"{label} cannot be read as one mesh")
        vertices, faces = np.ascontiguousarray(meshes[0]["vertices"]), np.asarray(meshes[0]["faces"])
        normals = meshes[0].get("vertex_normals")
    if with_normals and normals is None:
        raise SceneError(f"{label} has a face that names a normal the file does not hold")
    return MeshData(vertices, _triangles(faces, len(vertices), label), normals)


def _plain_obj(text: str) -> str:
    """Lines of vertices, normals and faces with single blanks; all others emptied, so that line numbers stay."""
    text = "\n" + text.replace("\r\n", "\n").replace("\r", "\n").replace("\\\n", " ") + "\n"
    # Blanks are joined before anything looks across them: a pattern that begins with many tries each of them anew.
    text = re.sub(r"[ \t]+", " ", re.sub(r"#.*", "", text))
    text = re.sub(r"^ |/{0,2} ?$", "", text, flags=re.M)
    # Some programs write the slashes of what is missing: 1/ or 1//.
    text = re.sub(r"(?<=[0-9])/{1,2}(?= )", "", text)
    return re.sub(r"^(?!(?:v|vn|f)(?: |$)).+", "", text, flags=re.M)


def _absolute_triangles(text: str, counts: dict[str, int], label: str) -> str:
    """Faces as triangles with indices counted from the start; relative ones count back from the line they are in."""
    seen = {"v": 0, "vn": 0}
    kept: list[str] = []
    for number, line in enumerate(text.split("\n")):
        kind = line.split(" ", 1)[0]
        if kind != "f":
            seen[kind] = seen.get(kind, 0) + 1
            kept.append(line)
            continue
        corners = []
        for corner in line.split(" ")[1:]:
            parts = corner.split("//")
            absolute = []
            for part, of in zip(parts, ("v", "vn"), strict=False):
                index = int(part)
                index = index if index > 0 else seen[of] + 1 + index
                if not 1 <= index <= counts[of]:
                    what = {"v": "vertex", "vn": "normal"}[of]
                    raise SceneError(f"{label}: line {number} names {what} {part}, which the file does not hold")
                absolute.append(str(index))
            corners.append("//".join(absolute))
        kept += [f"f {corners[0]} {b} {c}" for b, c in pairwise(corners[1:])]
    return "\n".join(kept)


def _triangles(faces: NDArray[Any], vertex_count: int, label: str) -> NDArray[np.uint32]:
    """Polygons of one size as fans of triangles with indices in range."""
    if faces.ndim != 2 or faces.shape[1] < 3 or faces.dtype.kind not in "iu":
        raise SceneError(f"{label} has faces that cannot be split into triangles")
    if len(faces) * (faces.shape[1] - 2) > TRIANGLE_LIMIT:
        raise SceneError(f"{label} holds more than {TRIANGLE_LIMIT} triangles")
    low, high = int(faces.min()), int(faces.max())
    if low < 0 or high >= vertex_count:
        wrong = low if low < 0 else high
        raise SceneError(f"{label} has a face that names vertex {wrong}, but only 0 to {vertex_count - 1} exist")
    if faces.shape[1] == 3:
        return np.ascontiguousarray(faces, dtype=np.uint32)
    fans = [faces[:, [0, i, i + 1]] for i in range(1, faces.shape[1] - 1)]
    return np.ascontiguousarray(np.stack(fans, axis=1).reshape(-1, 3), dtype=np.uint32)
