"""Wavefront OBJ files: positions, colours, texture coordinates, normals and faces; the rest is passed over.

Format: Wavefront Technologies, "Object Files (.obj)", appendix B1 of the Advanced Visualizer's manual.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import BinaryIO, Final

import numpy as np
from numpy.typing import NDArray

from clrender.errors import SceneError
from clrender.scene.mesh_data import TRIANGLE_LIMIT, MeshData, crossed_warning
from clrender.scene.mesh_text import Block, line_blocks, parse_numbers, parse_whole, word_spans
from clrender.scene.polygons import triangulate
from clrender.scene.vertex_colors import VertexColors, linear_colors
from clrender.scene.wording import quoted

__all__ = ["read_obj"]

_Whole = NDArray[np.int64]
_NUMBER: Final = re.compile(r"[-+]?(?:[0-9]+(?:\.[0-9]*)?|\.[0-9]+)(?:[eE][-+]?[0-9]{1,4})?")
# Vertex, texture coordinate, normal; some programs write the slashes of what is missing too: 1/ or 1//.
_CORNER: Final = re.compile(r"(-?[0-9]{1,18})(?:/(-?[0-9]{1,18})?(?:/(-?[0-9]{1,18})?)?)?")
_FACE_BYTES: Final = b"0123456789-/ \t\n\x0b"
_INDEXED: Final = ("v", "vt", "vn")
"""What the corners of faces name, in this order."""
_VECTORS: Final = {2: "pair of texture coordinates", 3: "position or normal", 6: "position with a colour"}
"""What so many numbers are, for messages."""


@dataclass
class _Found:
    """What the blocks read so far hold.

    Attributes
    ----------
    positions : list of (n, 3) float64, or (n, 6) with a colour behind each position
    normals : list of (n, 3) float64
    uvs : list of (n, 2) float64
    sizes : list of (n,) int64
        Corners of faces.
    corners, corner_uvs, corner_normals : lists of (n,) int64
        Vertex, texture coordinates and normal of each corner, counted from 0; -1 where there are no coordinates.
    counts : dict
        Vertices, texture coordinates, normals and faces.
    largest : dict
        Of vertices and normals: the largest index named, and the line that names it.
    """

    positions: list[NDArray[np.float64]] = field(default_factory=list)
    normals: list[NDArray[np.float64]] = field(default_factory=list)
    uvs: list[NDArray[np.float64]] = field(default_factory=list)
    sizes: list[_Whole] = field(default_factory=list)
    corners: list[_Whole] = field(default_factory=list)
    corner_uvs: list[_Whole] = field(default_factory=list)
    corner_normals: list[_Whole] = field(default_factory=list)
    counts: dict[str, int] = field(default_factory=lambda: dict.fromkeys(("v", "vt", "vn", "f"), 0))
    largest: dict[str, tuple[int, int]] = field(default_factory=lambda: dict.fromkeys(("v", "vt", "vn"), (-1, 0)))


@dataclass(frozen=True)
class _Lines:
    """The lines of one kind in a block.

    Attributes
    ----------
    places : (n,) int64
        Bytes at which they begin.
    words : (n,) int64
        How many words follow the keyword.
    text : bytes
        The lines, each with blanks for its keyword.
    """

    places: _Whole
    words: _Whole
    text: bytes


def read_obj(file: BinaryIO, size: int, label: str, colors: VertexColors | None = None) -> MeshData:
    """Read an OBJ file, with polygons split into triangles.

    Parameters
    ----------
    file : binary file
        At its start.
    size : int
        Bytes.
    label : str
        Start of an error message.
    colors : VertexColors, optional
        Read a colour behind each position, as ``v x y z r g b`` has it, encoded like this; auto: sRGB.

    Raises
    ------
    SceneError
        If it is truncated, damaged or not a mesh.
    """
    del size
    found = _Found()
    for block in line_blocks(file, label, obj=True):
        _read_block(block, found, label, 3 if colors is None else 6)
        for kind, what in (("v", "vertices"), ("vt", "texture coordinates"), ("vn", "normals"), ("f", "faces")):
            if found.counts[kind] > TRIANGLE_LIMIT:
                raise SceneError(f"{label} holds more than {TRIANGLE_LIMIT} {what}; at most that many are read")
    for kind, what in (("v", "vertices"), ("f", "faces")):
        if found.counts[kind] == 0:
            raise SceneError(f"{label} holds no {what}; a mesh needs vertices and faces")
    for kind, what in (("v", "vertex"), ("vn", "normal")):
        index, line = found.largest[kind]
        if index >= found.counts[kind]:
            held = f"only {found.counts[kind]} are in the file" if found.counts[kind] else "none is in the file"
            raise SceneError(f"{label}: line {line} has a face that names {what} {index + 1}, but {held}")
    return _mesh(found, label, colors)


def _mesh(found: _Found, label: str, colors: VertexColors | None) -> MeshData:
    table = np.concatenate(found.positions)
    vertices = np.ascontiguousarray(table[:, :3])
    corners, sizes = np.concatenate(found.corners), np.concatenate(found.sizes)
    total = len(corners) - 2 * len(sizes)
    if total > TRIANGLE_LIMIT:
        raise SceneError(f"{label} holds {total} triangles, but at most {TRIANGLE_LIMIT} are read")
    uvs, warning = _corner_uvs(found)
    triangles, crossed = None, 0
    if (sizes > 3).any():
        triangles, crossed = triangulate(vertices, corners, sizes, label)
    shades = None if colors is None else linear_colors(table[:, 3:], colors != "linear", label)[corners]
    normals = None
    if found.corner_normals:
        vertices, normals, corners = _with_normals(
            vertices, np.concatenate(found.normals), corners, np.concatenate(found.corner_normals)
        )
    faces = corners.reshape(-1, 3) if triangles is None else corners[triangles]
    warnings = [each for each in (crossed_warning(crossed), warning) if each]
    if uvs is not None:
        uvs = uvs.reshape(-1, 3, 2) if triangles is None else uvs[triangles]
    if shades is not None:
        shades = shades.reshape(-1, 3, 3) if triangles is None else shades[triangles]
    return MeshData(vertices, faces.astype(np.uint32), normals, "; ".join(warnings), uvs, colors=shades)


def _corner_uvs(found: _Found) -> tuple[NDArray[np.float32] | None, str]:
    """Texture coordinates of every corner, if any has them; and of how many there are none."""
    if not found.uvs:
        return None, ""
    index = np.concatenate(found.corner_uvs)
    table = np.concatenate(found.uvs)
    held = (index >= 0) & (index < len(table))
    if not held.any():
        return None, ""
    with np.errstate(over="ignore"):  # what float32 cannot hold is infinite, and refused with its place
        uvs = table[np.where(held, index, 0)].astype(np.float32)
    missing = len(index) - int(np.count_nonzero(held))
    uvs[~held] = 0.0
    return uvs, f"{missing} corners of faces have no texture coordinates, and got (0, 0)" if missing else ""


def _with_normals(
    vertices: NDArray[np.float64], normals: NDArray[np.float64], corners: _Whole, corner_normals: _Whole
) -> tuple[NDArray[np.float64], NDArray[np.float64], _Whole]:
    """Vertices that have one normal each: those with several are repeated."""
    normal_of = np.zeros(len(vertices), np.int64)
    normal_of[corners] = corner_normals
    if (normal_of[corners] == corner_normals).all():
        used = np.zeros(len(vertices), bool)
        used[corners] = True
        return vertices, np.where(used[:, None], normals[normal_of], 0.0), corners
    pairs, corners = np.unique(corners * len(normals) + corner_normals, return_inverse=True)
    return vertices[pairs // len(normals)], normals[pairs % len(normals)], corners.reshape(-1)


def _read_block(block: Block, found: _Found, label: str, of_vertex: int) -> None:
    """Add what a block holds; of a vertex so many numbers."""
    data = np.frombuffer(block.text, np.uint8)
    starts, _ = word_spans(data)
    line_ends = np.flatnonzero(data == ord("\n"))
    line_starts = np.concatenate([[0], line_ends[:-1] + 1])
    words_before = np.searchsorted(starts, line_starts)
    words = np.diff(words_before, append=len(starts))
    filled = np.flatnonzero(words)
    keys = starts[words_before[filled]]
    # A line ends in a line feed, so a byte behind a keyword exists, and two behind one of two letters.
    first, second = data[keys], data[keys + 1]
    third = data[np.minimum(keys + 2, len(data) - 1)]
    is_kind = {
        "v": (first == ord("v")) & (second <= 32),
        "vt": (first == ord("v")) & (second == ord("t")) & (third <= 32),
        "vn": (first == ord("v")) & (second == ord("n")) & (third <= 32),
        "f": (first == ord("f")) & (second <= 32),
    }
    before = {kind: found.counts[kind] + np.cumsum(is_kind[kind]) for kind in _INDEXED}
    blanked = data.copy()
    for keyword in is_kind:
        for letter in range(len(keyword)):
            blanked[keys[is_kind[keyword]] + letter] = ord(" ")

    def lines(kind: str) -> _Lines:
        chosen = filled[is_kind[kind]]
        in_a_row = len(chosen) and chosen[-1] - chosen[0] + 1 == len(chosen)
        if in_a_row:
            text = blanked[line_starts[chosen[0]] : line_ends[chosen[-1]] + 1]
        else:
            mask = np.zeros(len(line_starts), bool)
            mask[chosen] = True
            text = blanked[np.repeat(mask, line_ends + 1 - line_starts)]
        return _Lines(line_starts[chosen], words[chosen] - 1, text.tobytes())

    for kind, into, size in (("v", found.positions, of_vertex), ("vt", found.uvs, 2), ("vn", found.normals, 3)):
        if is_kind[kind].any():
            into.append(_vectors(lines(kind), size, block, label))
            found.counts[kind] += len(into[-1])
    if is_kind["f"].any():
        of_faces = {kind: counts[is_kind["f"]] for kind, counts in before.items()}
        _add_faces(lines("f"), of_faces, block, found, label)


def _vectors(lines: _Lines, size: int, block: Block, label: str) -> NDArray[np.float64]:
    """The first numbers of each line, as many as `size` says; more may follow (a weight, a colour)."""
    numbers = parse_numbers(lines.text)
    if size == 2 and (lines.words == 1).all() and numbers is not None:
        return np.stack([numbers, np.zeros_like(numbers)], axis=1)  # of a picture that is a line
    if numbers is None or (lines.words < size).any() or not np.isfinite(numbers).all():
        what = f"is not a {_VECTORS[size]} of {size} numbers"
        for place in lines.places.tolist():
            words = block.line(place).split()[1:]
            if len(words) < size or not all(_NUMBER.fullmatch(word) and np.isfinite(float(word)) for word in words):
                raise _bad_line(block, place, label, what)
        raise _bad_line(block, int(lines.places[0]), label, "or one after it holds what is no number")
    if (lines.words == size).all():
        return numbers.reshape(-1, size)
    first = np.cumsum(lines.words) - lines.words
    return np.asarray(numbers[first[:, None] + np.arange(size)])


def _bad_line(block: Block, place: int, label: str, what: str) -> SceneError:
    return SceneError(f"{label}: line {block.line_number(place)} {what}: {quoted(block.line(place))}")


def _add_faces(lines: _Lines, before: Mapping[str, _Whole], block: Block, found: _Found, label: str) -> None:
    """Corners of the faces of a block; `before` says how many vertices and the like stand before each face."""
    parsed = _uniform_corners(lines) if (lines.words >= 3).all() else None
    if parsed is None:
        parsed = _any_corners(lines, block, label)
    for column, kind in enumerate(_INDEXED):
        index = parsed[:, column]
        if kind == "vn" and not index.any():
            continue
        face = np.repeat(np.arange(len(lines.words)), lines.words)
        if (index <= 0).any():
            index = np.where(index < 0, before[kind][face] + 1 + index, index)
            if kind != "vt" and (index < 1).any():
                wrong = int(np.argmax(index < 1))
                what = {"v": "vertex", "vn": "normal"}[kind]
                named = f"names {what} {parsed[wrong, column]}, which the file does not hold"
                raise _bad_line(block, int(lines.places[face[wrong]]), label, named)
        top = int(np.argmax(index))
        if index[top] - 1 > found.largest[kind][0]:
            found.largest[kind] = (int(index[top]) - 1, block.line_number(int(lines.places[face[top]])))
        (found.corners, found.corner_uvs, found.corner_normals)[column].append(index - 1)
    with_normals, without = sum(map(len, found.corner_normals)), sum(map(len, found.corners))
    if with_normals not in (0, without):
        raise SceneError(f"{label} gives normals to some corners of its faces only; give them to all or to none")
    found.counts["f"] += len(lines.words)
    found.sizes.append(lines.words)


def _uniform_corners(lines: _Lines) -> _Whole | None:
    """Vertex, texture coordinates and normal of each corner, where all of a block are written alike; else None.

    Returns
    -------
    (corners, 3) int64
        As the file counts; 0 where there is none.
    """
    total = int(lines.words.sum())
    if lines.text.translate(None, _FACE_BYTES):
        return None
    data = np.frombuffer(lines.text, np.uint8)
    minus = np.flatnonzero(data == ord("-"))
    if len(minus) and not ((data[minus - 1] <= 32) | (data[minus - 1] == ord("/"))).all():
        return None
    slashes = np.flatnonzero(data == ord("/"))
    if not len(slashes):
        return _spread(_columns(parse_whole(lines.text), total, 1), (0,))
    each, odd = divmod(len(slashes), total)
    if odd or each > 2:
        return None
    starts, ends = word_spans(data)
    inside = slashes.reshape(total, each)
    if not ((inside > starts[:, None]) & (inside < ends[:, None])).all():
        return None
    numbers = parse_whole(lines.text.replace(b"/", b" "))
    count = 0 if numbers is None else len(numbers) // total
    # Every word begins with a number and holds one more, at most, after each slash: the total tells of each.
    table = _columns(numbers, total, count)
    if count == 2 and each == 2:
        return _spread(table, (0, 2)) if (inside[:, 1] - inside[:, 0] == 1).all() else None
    return _spread(table, range(count))


def _spread(table: _Whole | None, columns: Sequence[int]) -> _Whole | None:
    """A table's columns as these of three; the others are 0."""
    if table is None or len(columns) == 3:
        return table
    whole = np.zeros((len(table), 3), np.int64)
    whole[:, list(columns)] = table
    return whole


def _columns(numbers: _Whole | None, rows: int, columns: int) -> _Whole | None:
    """The numbers as a table, if they are exactly as many; zero is no index."""
    if numbers is None or columns == 0 or len(numbers) != rows * columns or (numbers == 0).any():
        return None
    return numbers.reshape(rows, columns)


def _any_corners(lines: _Lines, block: Block, label: str) -> _Whole:
    """The same of each corner, one by one; finds the line that is wrong."""
    kept: list[tuple[int, int, int]] = []
    words = iter(lines.text.split())
    for place, count in zip(lines.places.tolist(), lines.words.tolist(), strict=True):
        good = count >= 3
        for word in (next(words) for _ in range(count)):
            match = _CORNER.fullmatch(word.decode("latin-1"))
            indices = [int(each) for each in match.groups() if each] if match else [0]
            good = good and 0 not in indices
            if match:
                kept.append((int(match[1]), int(match[2] or 0), int(match[3] or 0)))
        if not good:
            raise _bad_line(block, place, label, "is not a face of 3 or more vertex indices")
    table = np.array(kept, np.int64)
    without = table[:, 2] == 0
    if without.any() and not without.all():
        raise SceneError(f"{label} gives normals to some corners of its faces only; give them to all or to none")
    return table
