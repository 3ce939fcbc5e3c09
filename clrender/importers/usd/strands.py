"""Converts the curves of a USD stage to strands."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from clrender.errors import SceneError
from clrender.importers.asset_files import AssetFiles
from clrender.importers.draft import Draft
from clrender.importers.shared.matrices import Matrix
from clrender.importers.shared.strands import StrandCollector, has_inside, placed_rows
from clrender.importers.usd.process import Stage
from clrender.wording import counted, quoted

__all__ = ["Strands"]

_Floats = NDArray[np.float64]
_LEAST: Final = {"linear": 2, "bezier": 4, "bspline": 4, "catmullRom": 4}


class Strands:
    """Adds curves to a draft: those of one material become one shape.

    Parameters
    ----------
    draft : Draft
    files : AssetFiles
    stage : Stage
    """

    def __init__(self, draft: Draft, files: AssetFiles, stage: Stage) -> None:
        self._draft, self._files, self._stage = draft, files, stage
        self._collector = StrandCollector(draft, files.source)

    def add(self, item: dict[str, Any], material: str, matrices: NDArray[np.float64]) -> None:
        """Add the curves of an item.

        Parameters
        ----------
        item : dict
            See `clrender.importers.usd.extraction`.
        material : str
            Name in the draft.
        matrices : (n, 4, 4) float64
            Where they are.
        """
        place = quoted(item["path"])
        if has_inside(self._draft, material):
            self._draft.note(f"{place} was left out: light goes through its material, and curves have no inside")
            return
        try:
            strands, basis = self._strands(item)
        except SceneError as fault:
            self._draft.leave_out(fault, self._files.source, self._files.strict)
            return
        if item["ribbon"]:
            self._draft.note("curves with normals, which are flat, are drawn as round ones of the same width")
        for matrix in matrices:
            for rows in strands:
                shape = self._collector.add((material, basis), self._placed(rows, matrix), basis)
                if shape is not None:
                    self._draft.description["shapes"].append({**shape, "material": material})

    def _placed(self, rows: _Floats, matrix: Matrix) -> _Floats:
        return placed_rows(self._draft, rows, matrix)

    def finish(self) -> None:
        """Write all strands to the draft."""
        self._collector.finish()

    def _strands(self, item: dict[str, Any]) -> tuple[list[_Floats], str]:
        """Control points with radii of each curve, (n, 4), and what they are control points of."""
        place = f"{self._files.source}: {quoted(item['path'])}"
        points, counts = self._stage.array(item["points"]), self._stage.array(item["counts"])
        if points is None or counts is None:
            raise SceneError(f"{place} has no points, or no curveVertexCounts; export it again")
        if int(np.maximum(counts, 0).sum()) != len(points) or (len(counts) and counts.min() < 0):
            text = f"has {counted(len(points), 'point')}, but its curveVertexCounts are of another number"
            raise SceneError(f"{place} {text}; export it again")
        if not np.isfinite(points).all():
            raise SceneError(f"{place} has points that are not finite; export it again")
        kind = "linear" if item["kind"] == "linear" else item["basis"]
        if kind not in _LEAST:
            raise SceneError(f"{place} has the basis {quoted(kind)}, which is not known; export it as another")
        widths = self._stage.array(item["widths"])
        if widths is None or not len(widths) or not np.isfinite(widths).all():
            self._draft.note(f"{quoted(item['path'])} has no widths: curves of a width of 1")
            widths, item = np.ones(1), {**item, "widths_interpolation": "constant"}
        found: list[_Floats] = []
        ends = np.cumsum(counts)
        at_varying = 0
        for number, (end, count) in enumerate(zip(ends.tolist(), counts.tolist(), strict=True)):
            start, varying = end - count, _varying(kind, item["wrap"], count)
            part = points[start:end]
            if count < (2 if item["wrap"] == "pinned" else _LEAST[kind]):
                self._draft.note(f"{quoted(item['path'])}: curves of too few points were left out")
            else:
                given = _widths(widths, item["widths_interpolation"], number, (start, end), (at_varying, varying))
                rows = np.concatenate([part, _at_points(given, kind, item["wrap"], count)[:, None] / 2.0], axis=1)
                found.append(_wrapped(rows, kind, item["wrap"]))
            at_varying += varying
        return found, "bezier" if kind == "catmullRom" else kind


def _varying(kind: str, wrap: str, count: int) -> int:
    """Number of values that vary along a curve: at the ends of its segments."""
    if kind == "linear":
        return count
    step = 3 if kind == "bezier" else 1
    if wrap == "periodic":
        return max(count // step, 0)
    if kind == "bezier":
        return max((count - 1) // 3 + 1, 0)
    return max(count if wrap == "pinned" else count - 2, 0)


def _widths(
    widths: _Floats, interpolation: str, number: int, points: tuple[int, int], varying: tuple[int, int]
) -> _Floats:
    """The widths of a curve: one, or one for each of its points or of the ends of its segments."""
    first, last = {
        "constant": (0, 1),
        "uniform": (number, number + 1),
        "vertex": points,
    }.get(interpolation, (varying[0], varying[0] + varying[1]))
    found = widths[first:last]
    return found if len(found) == last - first and len(found) else widths[:1]


def _at_points(widths: _Floats, kind: str, wrap: str, count: int) -> _Floats:
    """A width for each control point."""
    if len(widths) == count:
        return widths
    if len(widths) == 1:
        return np.full(count, widths[0])
    step = 3 if kind == "bezier" else 1
    # Between the ends of segments, and beyond them like these
    places = np.arange(count) / step - (1.0 if step == 1 and wrap == "nonperiodic" else 0.0)
    held = np.clip(places, 0.0, len(widths) - 1.0)
    low = np.minimum(held.astype(np.int64), len(widths) - 2)
    share = held - low
    return np.asarray(widths[low] * (1.0 - share) + widths[low + 1] * share)


def _wrapped(rows: _Floats, kind: str, wrap: str) -> _Floats:
    """Control points of the whole curve, of Bezier curves in the place of Catmull-Rom splines."""
    if wrap == "periodic":
        rows = np.concatenate([rows, rows[: 1 if kind in ("linear", "bezier") else 3]])
    elif wrap == "pinned" and kind in ("bspline", "catmullRom"):
        first, last = 2.0 * rows[:1] - rows[1:2], 2.0 * rows[-1:] - rows[-2:-1]
        first[:, 3], last[:, 3] = rows[0, 3], rows[-1, 3]
        rows = np.concatenate([first, rows, last])
    if kind == "bezier":
        rows = rows[: (len(rows) - 1) // 3 * 3 + 1]
    if kind != "catmullRom":
        return rows
    a, b, c, d = rows[:-3], rows[1:-2], rows[2:-1], rows[3:]
    parts = np.stack([b, b + (c - a) / 6.0, c - (d - b) / 6.0], axis=1)
    parts[:, 1, 3], parts[:, 2, 3] = b[:, 3] + (c - b)[:, 3] / 3.0, b[:, 3] + 2.0 * (c - b)[:, 3] / 3.0
    return np.concatenate([parts.reshape(-1, 4), c[-1:]])
