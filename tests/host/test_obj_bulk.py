"""Lines of OBJ files that are written alike: what is read of them at once is what is read of them word by word."""

from __future__ import annotations

import io
import random
from collections.abc import Callable, Iterator
from typing import Final

import numpy as np
import pytest
from cases import for_each

from clrender.errors import SceneError
from clrender.meshes import obj_bulk, obj_records
from clrender.meshes.decimals import digit_values
from clrender.meshes.obj_bulk import Run, alike_corners, alike_vectors, runs
from clrender.meshes.obj_records import ObjRecords, read_records
from clrender.meshes.text import Block, line_blocks

VECTORS: Final[list[Callable[[random.Random], str]]] = [
    lambda r: f"{r.uniform(-9, 9):.6f}",
    lambda r: f"{r.uniform(-1, 1) * 10 ** r.randrange(8):.{r.randrange(1, 16)}f}",
    lambda r: repr(r.uniform(-1, 1)),
    lambda r: f"{r.choice(['-', ''])}{r.randrange(10**12)}.{r.randrange(10**6)}",
    lambda r: r.choice(["-.5", ".25", "1.", "-3.", "-0.0", "0.0", "-0.", "00.10", "-.0"]),
]
"""Ways to write a decimal."""
ODD_VECTORS = [
    "{0} 1.0  2.0 3.0",
    "{0} 1.0 2.0 3.0 ",
    "{0} 1-2.0 1.0 2.0",
    "{0} --1.0 1.0 2.0",
    "{0} . 1.0 2.0",
    "{0} -. 1.0 2.0",
    "{0} 1..0 1.0 2.0",
    "{0} 1.0 2.0 3.0 4.0",
    "{0} +1.0 2e0 3.0",
    "{0} 9007199254740993.0 0.90071992547409931 3.0",
    "{0} 12345678901234567.5 1.12345678901234567 2.0",
    "{0} 0.1234567890123456 123456789.123456789 2.0",
]
ODD_CORNERS = ["0", "-1", "1/", "1//", "1/2/", "/1", "1x", "+3", "007", "1234567890123456", "99999999999999999", "1 "]


def test_digits() -> None:
    """0 to 16 digits are what Python makes of them, wherever they stand; more are not read."""
    draw = random.Random(1)
    words = ["".join(draw.choices("0123456789", k=k)) for k in [*range(17), *draw.choices(range(17), k=500)]]
    text = np.frombuffer("".join(f"{word}/" for word in words).encode(), np.uint8)
    lengths = np.array([len(word) for word in words])
    values = digit_values(text, np.flatnonzero(text == ord("/")), lengths)
    assert values is not None and values.tolist() == [int(word or 0) for word in words]
    assert digit_values(np.frombuffer(b"12345678901234567 ", np.uint8), np.array([17]), np.array([17])) is None


def test_vectors_are_as_python_reads_them() -> None:
    """Correctly rounded, with the signs of zeros."""
    for seed, style in enumerate(VECTORS * 4):
        draw = random.Random(seed)
        rows = [[style(draw) for _ in range(3)] for _ in range(300)]
        text = "".join(f"vn {' '.join(row)}\n" for row in rows).encode()
        values = alike_vectors(Run("vn", Block(text, 1), len(rows)))
        expected = np.array([[float(word) for word in row] for row in rows])
        if values is None:  # a number with more digits than double precision holds
            assert max(sum(map(str.isdigit, word)) for row in rows for word in row) > 15
        else:
            np.testing.assert_array_equal(values.view(np.int64), expected.view(np.int64))


@for_each(("form", "columns"), [("{0}", 1), ("{0}/{1}", 2), ("{0}//{2}", 2), ("{0}/{1}/{2}", 3)])
@for_each("size", [3, 4, 7])
def test_corners(form: str, columns: int, size: int) -> None:
    draw = np.random.default_rng(size)
    indices = 10 ** draw.integers(0, 9, (400 * size, 3)) + draw.integers(0, 9, (400 * size, 3))
    words = [form.format(*row) for row in indices.tolist()]
    lines = [f"f {' '.join(words[k : k + size])}\n" for k in range(0, len(words), size)]
    found = alike_corners(Run("f", Block("".join(lines).encode(), 1), len(lines)))
    assert found is not None and found[1] == size
    named = [column for column in range(3) if f"{{{column}}}" in form]
    assert len(named) == columns
    for column in range(3):
        np.testing.assert_array_equal(found[0][column], indices[:, column] if column in named else 0)


def any_file(seed: int) -> bytes:
    """Lines that are alike in runs, and now and then one that is not."""
    draw = random.Random(seed)
    lines: list[str] = []
    counts = {"v": draw.randrange(20, 60), "vt": draw.choice([0, 30]), "vn": draw.choice([0, 25])}
    for kind, count in counts.items():
        style, numbers = draw.choice(VECTORS), draw.choice([2, 3] if kind == "vt" else [3, 3, 6])
        some = [f"{kind} {' '.join(style(draw) for _ in range(numbers))}" for _ in range(count)]
        if count and draw.random() < 0.1:
            some[draw.randrange(count)] = draw.choice(ODD_VECTORS).format(kind)
        lines += some
    forms = ["{0}", "{0}/{1}", "{0}//{2}", "{0}/{1}/{2}", "{0}/"][: draw.randrange(1, 6)]
    for _ in range(draw.randrange(1, 4)):
        form, size = draw.choice(forms), draw.choice([3, 3, 4])
        faces = []
        for _ in range(draw.randrange(10, 30)):
            corners = [form.format(*(draw.randrange(1, (n or 1) + 1) for n in counts.values())) for _ in range(size)]
            if draw.random() < 0.005:
                corners[draw.randrange(size)] = draw.choice(ODD_CORNERS)
            faces.append(f"f {' '.join(corners)}")
        lines += [*faces, draw.choice(["usemtl a", "o b", "", "# c", "f 1 2 3"])]
    return "\n".join(lines).encode()


def content(found: ObjRecords) -> list[object]:
    tables = (found.positions, found.normals, found.uvs, found.sizes)
    indices = (found.corners, found.corner_uvs, found.corner_normals)
    joined = [np.concatenate(parts).tobytes() if parts else b"" for parts in (*tables, *indices)]
    return [*joined, found.counts, found.largest, found.statements]


def outcome(data: bytes) -> list[object]:
    try:
        return content(read_records(io.BytesIO(data), "mesh", False, statements=True))
    except SceneError as error:
        return [str(error)]


@pytest.mark.long
def test_runs_are_read_as_words_are(monkeypatch: pytest.MonkeyPatch) -> None:
    """Same bits, and same errors, for 400 files; most of them have runs."""
    monkeypatch.setattr(obj_bulk, "_LEAST", 3)
    files = [any_file(seed) for seed in range(400)]
    at_once = [outcome(data) for data in files]
    kinds = [
        run.kind for data in files for block in line_blocks(io.BytesIO(data), "mesh", obj=True) for run in runs(block)
    ]
    assert np.mean([kind != "" for kind in kinds]) > 0.5
    refused = sum(len(each) == 1 for each in at_once)
    assert 20 < refused < 200

    def no_runs(block: Block) -> Iterator[Run]:
        yield Run("", block, block.text.count(b"\n"))

    monkeypatch.setattr(obj_records, "runs", no_runs)
    assert [outcome(data) for data in files] == at_once
