"""What records of a PLY file become, however they are encoded: tables of numbers, and lists end to end."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from clrender.errors import SceneError
from clrender.scene.mesh_data import TRIANGLE_LIMIT
from clrender.scene.ply_header import Element

__all__ = ["Lists", "joined_lists", "property_table"]

Lists: TypeAlias = tuple[NDArray[np.int64], NDArray[np.int64]]
"""Entries of the lists of some records, one list after the other, and how many entries each record has."""


def property_table(element: Element, names: list[str]) -> NDArray[np.floating]:
    """Room for properties of all records: float32 where that holds them all, else float64."""
    kinds = {entry.kind for entry in element.properties if entry.name in names}
    single = kinds <= {"f4", "i1", "u1", "i2", "u2"}
    return np.empty((element.count, len(names)), np.float32 if single else np.float64)


def joined_lists(parts: Iterator[Lists], label: str) -> Lists:
    """All entries and all counts, as long as they are not too many."""
    entries, counts, total = [], [], 0
    for some, count in parts:
        entries.append(some)
        counts.append(count)
        total += len(some)
        if total > 3 * TRIANGLE_LIMIT:
            raise SceneError(f"{label} has faces of more than {3 * TRIANGLE_LIMIT} corners in all; split it")
    return np.concatenate(entries), np.concatenate(counts)
