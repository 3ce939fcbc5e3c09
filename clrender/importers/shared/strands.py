"""Curves of other formats, collected: those of one material become one shape."""

from __future__ import annotations

from collections.abc import Hashable
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from clrender.curves import CurveData
from clrender.exact.angles import root
from clrender.exact.matrices import determinant
from clrender.importers.draft import Draft
from clrender.importers.shared.matrices import Matrix, is_similarity

__all__ = ["StrandCollector", "placed_rows"]

_Floats = NDArray[np.float64]
_UNEVEN: Final = "curves that a transform stretches unevenly keep round cross sections"


def placed_rows(draft: Draft, rows: _Floats, matrix: Matrix, *, scaled: bool = True) -> _Floats:
    """Control points under a transform, with their radii.

    Parameters
    ----------
    draft : Draft
        Gets a note if tubes would not stay round.
    rows : (N, 4) float64
        x, y, z and the radius.
    matrix : (4, 4) float64
    scaled : bool
        Whether the radii are scaled, too.
    """
    x, y, z, radii = rows.T
    points = [((a * x + b * y) + c * z) + d for a, b, c, d in matrix[:3].tolist()]
    if scaled:
        if not is_similarity(matrix):
            draft.note(_UNEVEN)
        radii = radii * root(abs(float(determinant(matrix[:3, :3]))), 3)
    return np.stack([*points, radii], axis=1)


class StrandCollector:
    """Collects strands until a file has been read.

    Parameters
    ----------
    draft : Draft
    """

    def __init__(self, draft: Draft) -> None:
        self._draft = draft
        self._collected: dict[Hashable, tuple[str, list[_Floats]]] = {}

    def add(self, key: Hashable, rows: _Floats, basis: str) -> dict[str, Any] | None:
        """Add a strand.

        Parameters
        ----------
        key : hashable
            Strands with equal keys belong to one shape.
        rows : (N, 4) float64
            Control points and radii.
        basis : str
            See `clrender.scene.shapes.Curves`; part of the key.

        Returns
        -------
        dict or None
            The description of the shape, if this is its first strand.
        """
        key = (key, basis)
        if key in self._collected:
            self._collected[key][1].append(rows)
            return None
        name = f"curves {len(self._collected) + 1}"
        self._collected[key] = name, [rows]
        return {"type": "curves", "file": name, "basis": basis}

    def finish(self) -> None:
        """Write all strands to the draft.

        Raises
        ------
        SceneError
            There are too many, or a number is not allowed.
        """
        for name, strands in self._collected.values():
            counts = np.array([len(each) for each in strands], np.int64)
            self._draft.curves[name] = CurveData.checked(np.concatenate(strands), counts, name)
