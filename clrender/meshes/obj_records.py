"""Records of a Wavefront OBJ file: positions, colours, texture coordinates, normals, faces, statements.

Format: Wavefront Technologies, "Object Files (.obj)", appendix B1 of the Advanced Visualizer's manual.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import BinaryIO, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from clrender.errors import SceneError
from clrender.meshes.data import TRIANGLE_LIMIT, filled
from clrender.meshes.obj_bulk import Run, alike_corners, alike_vectors, runs
from clrender.meshes.obj_faces import Lines, bad_line, face_corners
from clrender.meshes.text import CONTINUATION, Block, line_blocks, parse_numbers, word_spans
from clrender.wording import grouped

__all__ = ["ObjRecords", "Statement", "read_records"]

_Whole = NDArray[np.int64]
_NUMBER: Final = re.compile(r"[-+]?(?:[0-9]+(?:\.[0-9]*)?|\.[0-9]+)(?:[eE][-+]?[0-9]{1,4})?")
_NO_NUMBER: Final = re.compile(r"[-+]?(?:nan(?:\([^)]*\))?|inf(?:inity)?)", re.IGNORECASE)
"""What C libraries print for a number that is not finite."""
_INDEXED: Final = ("v", "vt", "vn")
"""Keywords of the records that corners of faces index, in this order."""
_VECTORS: Final = {2: "pair of texture coordinates", 3: "position or normal", 6: "position with a colour"}
"""Meaning of a vector by its number of components, for messages."""
_KEPT: Final = frozenset(("o", "s", "usemtl", "mtllib"))
"""Keywords of statements that are kept, as shapes depend on them."""
_STATEMENT_LIMIT: Final = 2**20
"""Most statements that differ from the last one of their kind."""
_OUTLINES: Final = re.compile(rb"(?m)^([ \t]*)fo(?=[ \t])")
_FACES: Final = "such faces are left out"
_NORMALS: Final = "such corners have the normal of their face"
_GAPS: Final = {
    "v": "the faces of such vertices are left out",
    "vt": "such texture coordinates are taken as 0",
    "vn": _NORMALS,
}
_KIND_LIMIT: Final = 256
"""Most other keywords that are counted."""


class Statement(NamedTuple):
    """A line that applies to the faces after it, or names a material library.

    Attributes
    ----------
    keyword, rest : str
        Its first word, and the rest without surrounding blanks.
    faces : int
        Number of faces before it.
    line : int
        Line number in the file, counted from 1.
    """

    keyword: str
    rest: str
    faces: int
    line: int


@dataclass
class ObjRecords:
    """Records of the blocks read so far.

    Attributes
    ----------
    positions : list of (n, 3) float64, or (n, 6) with a colour behind each position
    normals : list of (n, 3) float64
    uvs : list of (n, 2) float64
    sizes : list of (n,) int64
        Numbers of corners of faces.
    corners, corner_uvs, corner_normals : lists of (n,) int64
        Indices of the vertex, texture coordinates and normal of each corner, from 0; -1 for missing ones.
    counts : dict
        Numbers of vertices, texture coordinates, normals and faces.
    largest : dict
        Largest index used, of vertices and of normals, and the line that uses it.
    statements : list of Statement
        If requested; those that repeat the last one of their kind are omitted.
    others : dict of str to int
        Number of lines by other keywords.
    latest : dict of str to str
        The last statement of each kind.
    some_colored : bool
        Whether only some positions have colours, or more than were requested.
    strict : bool
        Whether faces that cannot be drawn refuse the file.
    faults, forgiven : list of str
        What was left out otherwise; what was read all the same.
    doubtful : bool
        Whether there may be such faces.
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
    statements: list[Statement] = field(default_factory=list)
    others: dict[str, int] = field(default_factory=dict)
    latest: dict[str, str] = field(default_factory=dict)
    some_colored: bool = False
    strict: bool = False
    faults: list[str] = field(default_factory=list)
    forgiven: list[str] = field(default_factory=list)
    doubtful: bool = False

    def tell(self, fault: SceneError, label: str, what: str) -> None:
        """Note a fault for which something is left out, the first of its kind alone, or raise it if `strict`."""
        self._note(self.faults, fault, label, what)

    def forgive(self, fault: SceneError, label: str, what: str) -> None:
        """Note a fault that leaves no doubt, the first of its kind alone, or raise it if `strict`."""
        self._note(self.forgiven, fault, label, what)

    @property
    def told(self) -> list[str]:
        """All faults."""
        return [*self.faults, *self.forgiven]

    def _note(self, into: list[str], fault: SceneError, label: str, what: str) -> None:
        if self.strict:
            raise fault
        if not any(known.endswith(what) for known in into):
            into.append(f"{str(fault).removeprefix(label).lstrip(': ')}: {what}")


def read_records(
    file: BinaryIO, label: str, colors: bool | None, statements: bool = False, strict: bool = False
) -> ObjRecords:
    """Read all lines of an OBJ file.

    Parameters
    ----------
    file : binary file
        Positioned at its start.
    label : str
        Prefix of error messages.
    colors : bool, optional
        Whether each position must have a colour after it, as in ``v x y z r g b``; None: read them if all have one.
    statements : bool
        Whether to keep statements, which are neither vertices nor faces.
    strict : bool
        Whether faces that cannot be drawn refuse the file; else they are left out.

    Raises
    ------
    SceneError
        If it is damaged, or has no faces.
    """
    found = ObjRecords(strict=strict)
    for block in line_blocks(file, label, obj=True):
        if b"fo" in block.text:  # what faces were called once
            block = replace(block, text=_OUTLINES.sub(rb"\1f ", block.text))
        for run in runs(block):
            if not (run.kind and _add_alike(run, found, colors)):
                _read_block(run.block, found, label, colors, statements)
        for kind, what in (("v", "vertices"), ("vt", "texture coordinates"), ("vn", "normals"), ("f", "faces")):
            if found.counts[kind] > TRIANGLE_LIMIT:
                raise SceneError(
                    f"{label} holds more than {grouped(TRIANGLE_LIMIT)} {what}; at most that many are read"
                )
    for kind, what in (("v", "vertices"), ("f", "faces")):
        if found.counts[kind] == 0:
            raise SceneError(f"{label} holds no {what}; a mesh needs vertices and faces")
    for kind, what in (("v", "vertex"), ("vn", "normal")):
        index, line = found.largest[kind]
        if index >= found.counts[kind]:
            held = f"only {found.counts[kind]} are in the file" if found.counts[kind] else "none is in the file"
            fault = SceneError(f"{label}: line {line} has a face that names {what} {index + 1}, but {held}")
            found.tell(fault, label, _FACES if kind == "v" else _NORMALS)
            found.doubtful = True
    if found.doubtful:
        _leave_out(found, label)
    return found


def _leave_out(found: ObjRecords, label: str) -> None:
    """Take out faces of fewer than three corners, or of vertices that there are not, and such normals."""
    sizes, corners, uvs, normals = (
        np.concatenate(parts) for parts in (found.sizes, found.corners, found.corner_uvs, found.corner_normals)
    )
    kept = sizes >= 3
    parts = [filled(part) for part in found.positions]
    found.positions = [part for part, _ in parts]
    gaps = np.concatenate([np.zeros(len(part), bool) if wrong is None else wrong for part, wrong in parts])
    face = np.repeat(np.arange(len(sizes)), sizes)
    kept[face[(corners < 0) | (corners >= found.counts["v"])]] = False
    kept[face[gaps[np.clip(corners, 0, len(gaps) - 1)]]] = False
    if not kept.any():
        raise SceneError(f"{label} holds no face that can be drawn: {found.faults[0].rpartition(': ')[0]}")
    normals[normals >= found.counts["vn"]] = -1
    of_kept = kept[face]
    found.sizes, found.counts["f"] = [sizes[kept]], int(np.count_nonzero(kept))
    found.corners, found.corner_uvs, found.corner_normals = [corners[of_kept]], [uvs[of_kept]], [normals[of_kept]]
    before = np.concatenate([[0], np.cumsum(kept)])
    found.statements = [each._replace(faces=int(before[each.faces])) for each in found.statements]


def _add_alike(run: Run, found: ObjRecords, colors: bool | None) -> bool:
    """Add lines if they all have the same form; returns whether they do."""
    if run.kind == "f":
        corners = alike_corners(run)
        if corners is None:
            return False
        indices, size = corners
        columns = (found.corners, found.corner_uvs, found.corner_normals)
        for kind, index, into in zip(_INDEXED, indices, columns, strict=True):
            index -= 1
            into.append(index)
            largest = int(index.max())
            if largest > found.largest[kind][0]:
                found.largest[kind] = (largest, run.block.first_line + int(np.argmax(index)) // size)
        found.counts["f"] += run.lines
        found.sizes.append(np.full(run.lines, size))
        return True
    numbers = alike_vectors(run)
    if numbers is None:
        return False
    size = {"v": 6 if colors or (colors is None and numbers.shape[1] >= 6) else 3, "vt": 2, "vn": 3}[run.kind]
    if numbers.shape[1] < size:
        return False
    {"v": found.positions, "vt": found.uvs, "vn": found.normals}[run.kind].append(numbers[:, :size])
    found.counts[run.kind] += run.lines
    return True


def _read_block(block: Block, found: ObjRecords, label: str, colors: bool | None, statements: bool) -> None:
    """Add the records of a block."""
    data = np.frombuffer(block.text, np.uint8)
    starts, ends = word_spans(data)
    line_ends = np.flatnonzero(data == ord("\n"))
    line_starts = np.concatenate([[0], line_ends[:-1] + 1])
    words_before = np.searchsorted(starts, line_starts)
    words = np.diff(words_before, append=len(starts))
    filled = np.flatnonzero(words)
    keys = starts[words_before[filled]]
    # Lines end in a line feed, so a byte after a keyword exists, and two after one of two letters.
    first, second = data[keys], data[keys + 1]
    third = data[np.minimum(keys + 2, len(data) - 1)]
    is_kind = {
        "v": (first == ord("v")) & (second <= 32),
        "vt": (first == ord("v")) & (second == ord("t")) & (third <= 32),
        "vn": (first == ord("v")) & (second == ord("n")) & (third <= 32),
        "f": (first == ord("f")) & (second <= 32),
    }
    before = {kind: found.counts[kind] + np.cumsum(is_kind[kind]) for kind in (*_INDEXED, "f")}
    if statements:
        others = ~(is_kind["v"] | is_kind["vt"] | is_kind["vn"] | is_kind["f"])
        places = line_starts[filled[others]]
        breaks = np.flatnonzero((data == ord("\n")) | (data == ord(CONTINUATION)))
        numbers = block.first_line + np.searchsorted(breaks, places)
        _add_statements(block, found, keys[others], numbers, before["f"][others], label)
    blanked = data.copy()
    for keyword in is_kind:
        for letter in range(len(keyword)):
            blanked[keys[is_kind[keyword]] + letter] = ord(" ")

    def lines(kind: str) -> Lines:
        chosen = filled[is_kind[kind]]
        in_a_row = len(chosen) and chosen[-1] - chosen[0] + 1 == len(chosen)
        if in_a_row:
            begin, end = int(line_starts[chosen[0]]), int(line_ends[chosen[-1]]) + 1
            text = blanked[begin:end].tobytes()
            used = np.ones(int(words[chosen].sum()), bool)
            used[words_before[chosen] - words_before[chosen[0]]] = False
            here = slice(int(words_before[chosen[0]]), int(words_before[chosen[0]]) + len(used))
            spans = starts[here][used] - begin, ends[here][used] - begin
        else:
            mask = np.zeros(len(line_starts), bool)
            mask[chosen] = True
            text = blanked[np.repeat(mask, line_ends + 1 - line_starts)].tobytes()
            spans = word_spans(np.frombuffer(text, np.uint8))
        return Lines(line_starts[chosen], words[chosen] - 1, text, *spans)

    if is_kind["v"].any():
        some = lines("v")
        size = 6 if colors or (colors is None and bool((some.words >= 6).all())) else 3
        try:
            found.positions.append(_vectors(some, "v", size, block, found, label))
        except SceneError:
            if size == 3 or colors:
                raise
            size = 3
            found.positions.append(_vectors(some, "v", size, block, found, label))
        found.some_colored |= size == 3 and bool((some.words >= 6).any())
        found.counts["v"] += len(some.words)
    for kind, into, size in (("vt", found.uvs, 2), ("vn", found.normals, 3)):
        if is_kind[kind].any():
            into.append(_vectors(lines(kind), kind, size, block, found, label))
            found.counts[kind] += len(into[-1])
    if is_kind["f"].any():
        of_faces = {kind: before[kind][is_kind["f"]] for kind in _INDEXED}
        _add_faces(lines("f"), of_faces, block, found, label)


def _add_statements(block: Block, found: ObjRecords, keys: _Whole, lines: _Whole, faces: _Whole, label: str) -> None:
    """Add statements of a block, whose keywords begin at these bytes."""
    if len(found.statements) > _STATEMENT_LIMIT:
        raise SceneError(f"{label} changes object or material more than {grouped(_STATEMENT_LIMIT)} times; split it")
    for key, line, count in zip(keys.tolist(), lines.tolist(), faces.tolist(), strict=True):
        text = block.text[key : block.text.index(b"\n", key)].replace(CONTINUATION, b" ").decode("utf-8", "replace")
        keyword, *rest = text.split(None, 1)
        if keyword not in _KEPT:
            if len(found.others) < _KIND_LIMIT or keyword in found.others:
                found.others[keyword] = found.others.get(keyword, 0) + 1
            continue
        said = rest[0].strip() if rest else ""
        if found.latest.get(keyword) != said:
            found.latest[keyword] = said
            found.statements.append(Statement(keyword, said, count, line))


def _vectors(lines: Lines, kind: str, size: int, block: Block, found: ObjRecords, label: str) -> NDArray[np.float64]:
    """The first `size` numbers of each line; more may follow (a weight, a colour)."""
    numbers = parse_numbers(lines.text, (lines.starts, lines.ends))
    if size == 2 and (lines.words == 1).all() and numbers is not None:
        return np.stack([numbers, np.zeros_like(numbers)], axis=1)  # texture coordinates of a 1D texture
    sound = numbers is not None and bool(np.isfinite(numbers).all())
    if not sound and size == 3 and (lines.words > size).any() and (lines.words >= size).all():
        # What follows a position need not be numbers
        number_of = np.arange(len(lines.starts)) - np.repeat(np.cumsum(lines.words) - lines.words, lines.words)
        leading = number_of < size
        kept = [lines.text[a:b] for a, b in zip(lines.starts[leading], lines.ends[leading], strict=True)]
        numbers = parse_numbers(b" ".join(kept) + b"\n")
        if numbers is not None and np.isfinite(numbers).all():
            return numbers.reshape(-1, size)
    if numbers is None or (lines.words < size).any() or not np.isfinite(numbers).all():
        what = f"is not a {_VECTORS[size]} of {size} numbers"
        # As many words as numbers, and no point in any: a comma is the decimal point of some languages
        if b"," in lines.text and b"." not in lines.text and (lines.words == size).all():
            numbers = parse_numbers(lines.text.replace(b",", b"."), (lines.starts, lines.ends))
            if numbers is not None and np.isfinite(numbers).all():
                fault = bad_line(block, int(lines.places[0]), label, what)
                found.forgive(fault, label, "its commas are read as decimal points")
                return numbers.reshape(-1, size)
        with_gaps = _with_gaps(lines, kind, size, block, found, label)
        if with_gaps is not None:
            return with_gaps
        for place in lines.places.tolist():
            words = block.line(place).split()[1:]
            if len(words) < size or not all(_NUMBER.fullmatch(word) and np.isfinite(float(word)) for word in words):
                raise bad_line(block, place, label, what)
        raise bad_line(block, int(lines.places[0]), label, "or one after it holds what is no number")
    if (lines.words == size).all():
        return numbers.reshape(-1, size)
    first = np.cumsum(lines.words) - lines.words
    return np.asarray(numbers[first[:, None] + np.arange(size)])


def _with_gaps(
    lines: Lines, kind: str, size: int, block: Block, found: ObjRecords, label: str
) -> NDArray[np.float64] | None:
    """Lines of numbers, some of which are not finite; None if some hold no numbers at all."""
    rows = np.empty((len(lines.words), size))
    for row, place in enumerate(lines.places.tolist()):
        words = block.line(place).split()[1 : size + 1]
        if len(words) < size or not all(_NUMBER.fullmatch(word) or _NO_NUMBER.fullmatch(word) for word in words):
            return None
        rows[row] = [float(word) if _NUMBER.fullmatch(word) else np.nan for word in words]
    gaps = ~np.isfinite(rows).all(axis=1)
    if not gaps.any() or not np.isfinite(rows[:, 3:]).all():
        return None
    fault = bad_line(block, int(lines.places[np.argmax(gaps)]), label, "has a number that is not finite")
    if kind == "v":
        found.tell(fault, label, _GAPS[kind])
        found.doubtful = True
    else:
        found.forgive(fault, label, _GAPS[kind])
        rows[gaps] = 0.0
    return rows


def _add_faces(lines: Lines, before: Mapping[str, _Whole], block: Block, found: ObjRecords, label: str) -> None:
    """Add the faces of a block; `before` holds the number of vertices and other records before each face."""
    if (lines.words < 3).any():
        place = int(lines.places[np.argmax(lines.words < 3)])
        found.tell(bad_line(block, place, label, "is not a face of 3 or more vertex indices"), label, _FACES)
        found.doubtful = True
    parsed = face_corners(lines, block, label)
    face: _Whole | None = None
    for column, kind in enumerate(_INDEXED):
        index = parsed[:, column]
        if (index <= 0).any():
            face = np.repeat(np.arange(len(lines.words)), lines.words) if face is None else face
            given = index
            index = np.where(given < 0, before[kind][face] + 1 + given, given)
            wrong = (index < 1) & (given != 0)
            if kind != "vt" and wrong.any():
                corner = int(np.argmax(wrong))
                what = {"v": "vertex", "vn": "normal"}[kind]
                named = f"names {what} {given[corner]}, which the file does not hold"
                fault = bad_line(block, int(lines.places[face[corner]]), label, named)
                found.tell(fault, label, _FACES if kind == "v" else _NORMALS)
                index = np.where(wrong, 0, index)
                found.doubtful = True
        top = int(np.argmax(index)) if len(index) else 0
        if len(index) and index[top] - 1 > found.largest[kind][0]:
            at = int(np.searchsorted(np.cumsum(lines.words), top, side="right"))
            found.largest[kind] = (int(index[top]) - 1, block.line_number(int(lines.places[at])))
        (found.corners, found.corner_uvs, found.corner_normals)[column].append(index - 1)
    found.counts["f"] += len(lines.words)
    found.sizes.append(lines.words)
