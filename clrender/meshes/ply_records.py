"""Arrays of the records of a PLY file, independent of its encoding: tables of numbers, and concatenated lists."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from clrender.errors import SceneError
from clrender.meshes.data import TRIANGLE_LIMIT
from clrender.meshes.ply_header import Element

__all__ = ["Lists", "joined_lists", "property_table", "widened"]

Lists: TypeAlias = tuple[NDArray[Any], NDArray[np.int64]]
"""Concatenated entries of the lists of some records, and how many of them each record has."""


def property_table(element: Element, names: list[str]) -> NDArray[np.floating]:
    """Empty table for properties of all records: float32 if that represents them all, else float64."""
    kinds = {entry.kind for entry in element.properties if entry.name in names}
    single = kinds <= {"f4", "i1", "u1", "i2", "u2"}
    return np.empty((element.count, len(names)), np.float32 if single else np.float64)


def joined_lists(parts: Iterator[list[Lists]], label: str) -> list[Lists]:
    """Concatenate entries and counts of several lists, unless the first one has too many entries."""
    columns: list[list[Lists]] = []
    total = 0
    for some in parts:
        columns.append(some)
        total += len(some[0][0])
        if total > 3 * TRIANGLE_LIMIT:
            raise SceneError(f"{label} has faces of more than {3 * TRIANGLE_LIMIT} corners in all; split it")
    return [
        (np.concatenate([entries for entries, _ in column]), np.concatenate([counts for _, counts in column]))
        for column in zip(*columns, strict=True)
    ]


def widened(entries: NDArray[Any]) -> NDArray[Any]:
    """Entries of a list: integers as int64, others unchanged."""
    return entries.astype(np.int64 if entries.dtype.kind in "iu" else entries.dtype.newbyteorder("="))
