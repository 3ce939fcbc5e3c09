"""Strands as the cubic polynomials that the kernels intersect, cut where they turn."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray

from clrender import layout
from clrender.errors import SceneError
from clrender.wording import counted, quoted

if TYPE_CHECKING:
    from clrender.curves import CurveData
    from clrender.scene.shapes import Curves
    from clrender.scene.transforms import Affine

__all__ = ["FlatCurves", "bezier_segments", "flat_curves", "strand_radii", "strands_place"]

_Floats = NDArray[np.float64]
_STRAIGHT: Final = 0.94
"""Least cosine between legs of a control polygon: of more the four steps of kernels/geometry/curve.inc would not do."""
_MOST_CUTS: Final = 5
_MOST_STOPS: Final = 3
"""Most cuts for the sake of a curve's speed: what is left is an eighth of it, and very short."""
_EVEN: Final = 0.05
"""Largest second difference of the radius, by the length, that is not cut."""
_ALIKE: Final = 0.01
"""And by the radius."""
_EMPTY: Final = 80.0
"""Curves are halved whose `_emptiness` is above this: measured with 300,000 thin ones."""
_ROUNDING: Final = 2.0**-24
_SMALLEST: Final = 1e-18


@dataclass(frozen=True)
class FlatCurves:
    """The curves of a shape.

    Attributes
    ----------
    shapes : (R,) `AnalyticShape`
        Bounding boxes, and which curves go on from each other.
    rows : (R, 16) float32
        See ``CURVE_ROW_*`` of ``kernels/types.h``.
    along : (R, 2) float32
        Where each begins and ends along its strand, from 0 at the root to 1 at the tip.
    """

    shapes: NDArray[np.void]
    rows: NDArray[np.float32]
    along: NDArray[np.float32]


def strands_place(shape: Curves, place: str) -> str:
    """Beginning of messages about strands: the place of the shape, and the file that they are from."""
    return place if shape.file is None else f"{place}.file: {quoted(shape.file)}"


def strand_radii(shape: Curves, data: CurveData, place: str) -> _Floats:
    """Radius at each control point, metres, before the shape's transform.

    Parameters
    ----------
    shape : Curves
    data : CurveData
        Its strands.
    place : str
        Beginning of error messages.

    Returns
    -------
    (N,) float64

    Raises
    ------
    SceneError
        It is not known, or has another length.
    """
    count = len(data.points)
    if not shape.radius:
        if data.radii is None:
            raise SceneError(f"{place}.radius is missing, and its file has none; give a number of metres")
        if not data.radii.any():
            where = strands_place(shape, place)
            raise SceneError(f"{where}: all radii of its file are 0, so that nothing can be seen of it; give a radius")
        return data.radii
    if len(shape.radius) == 1:
        return np.full(count, shape.radius[0])
    if len(shape.radius) == count:
        return np.array(shape.radius)
    if len(shape.radius) != 2:
        text = f"has {len(shape.radius)} entries; give one, two for roots and tips, or {count}"
        raise SceneError(f"{place}.radius {text}")
    root, tip = shape.radius
    first = np.repeat(np.cumsum(data.counts) - data.counts, data.counts)
    share = (np.arange(count) - first) / np.maximum(np.repeat(data.counts, data.counts) - 1, 1)
    return np.asarray(root + (tip - root) * share)


def bezier_segments(
    points: _Floats, counts: NDArray[np.int64], basis: str, place: str
) -> tuple[_Floats, NDArray[np.int64]]:
    """Cubic Bezier curves of strands.

    Parameters
    ----------
    points : (N, 4) float64
        Control points and radii.
    counts : (S,) int64
        Control points of each strand.
    basis : str
        See `clrender.scene.shapes.Curves`.
    place : str
        Beginning of error messages.

    Returns
    -------
    controls : (K, 4, 4) float64
        Four control points of each curve: x, y, z and the radius.
    strand : (K,) int64
        Strand of each; its curves come in the order of its points.

    Raises
    ------
    SceneError
        A strand has too few points, or not as many as its basis needs.
    """
    least, step, unused = {"bspline": (4, 1, 3), "bezier": (4, 3, 1), "catmull-rom": (2, 1, 1), "linear": (2, 1, 1)}[
        basis
    ]
    wrong = (counts < least) | ((counts - unused) % step != 0)
    if wrong.any():
        number = int(np.argmax(wrong))
        needs = "4, 7, 10 and so on" if basis == "bezier" else f"at least {least}"
        text = (
            f"strand {number} has {counted(counts[number], 'control point')}, but curves of the basis {basis} "
            f"need {needs}"
        )
        raise SceneError(f"{place}: {text}")
    firsts = np.cumsum(counts) - counts
    each = (counts - unused) // step
    strand = np.repeat(np.arange(len(counts)), each)
    within = np.arange(len(strand)) - np.repeat(np.cumsum(each) - each, each)
    first = np.repeat(firsts, each) + step * within
    if basis == "bezier":
        return points[first[:, None] + np.arange(4)], strand
    if basis == "linear":
        a, b = points[first], points[first + 1]
        return np.stack([a, a + (b - a) / 3.0, b - (b - a) / 3.0, b], axis=1), strand
    if basis == "bspline":
        a, b, c, d = (points[first + k] for k in range(4))
        return np.stack(
            [(a + 4.0 * b + c) / 6.0, (2.0 * b + c) / 3.0, (b + 2.0 * c) / 3.0, (b + 4.0 * c + d) / 6.0], 1
        ), strand
    a, b = points[first], points[first + 1]
    last = first + 2 == np.repeat(firsts + counts, each)
    before = np.where((within == 0)[:, None], 2.0 * a - b, points[np.maximum(first - 1, 0)])
    after = np.where(last[:, None], 2.0 * b - a, points[np.minimum(first + 2, len(points) - 1)])
    controls = np.stack([a, a + (b - before) / 6.0, b - (after - a) / 6.0, b], axis=1)
    controls[..., 3] = np.maximum(controls[..., 3], 0.0)
    return controls, strand


def flat_curves(shape: Curves, data: CurveData, transform: Affine, place: str, most: int = 0) -> FlatCurves:
    """The curves of a shape in the coordinates of the device.

    Parameters
    ----------
    shape : Curves
    data : CurveData
    transform : Affine
        A similarity.
    place : str
        Beginning of error messages.
    most : int
        Up to so many, curves that fill little of their boxes are cut, so that rays look into fewer.

    Raises
    ------
    SceneError
        A strand has too few points, or a radius is missing or too small for single precision.
    """
    radii = strand_radii(shape, data, place) * transform.scale
    if float(radii.max()) < _SMALLEST:
        raise SceneError(f"{place}.radius is {radii.max():g} metres in the world, too small for single precision")
    x, y, z = data.points.T
    placed = np.stack(
        [(a * x + b * y) + c * z + o for (a, b, c), o in zip(transform.linear, transform.offset, strict=True)]
    )
    controls, strand = bezier_segments(
        np.concatenate([placed, radii[None]]).T, data.counts, shape.basis, strands_place(shape, place)
    )
    each = np.bincount(strand, minlength=len(data.counts))
    within = np.arange(len(strand)) - (np.cumsum(each) - each)[strand]
    pieces = _cut(_Pieces(controls, strand, within / each[strand], (within + 1) / each[strand]), most)
    controls, strand = pieces.controls, pieces.strand
    rows = np.zeros((len(controls), 4, 4), np.float32)
    a, b, c, d = (controls[:, k] for k in range(4))
    rows[:, 0], rows[:, 1], rows[:, 2] = a, 3.0 * (b - a), 3.0 * ((a - b) + (c - b))
    rows[:, 3] = (d - a) + 3.0 * (b - c)
    goes_on = strand[1:] == strand[:-1]
    before, after = np.concatenate([[False], goes_on]), np.concatenate([goes_on, [False]])
    shapes = np.zeros(len(controls), layout.dtype("AnalyticShape"))
    shapes["normal"][:, 3] = layout.ANALYTIC_SHAPE_CURVE + before + 2 * after
    _write_boxes(shapes, controls)
    return FlatCurves(shapes, rows.reshape(-1, 16), np.stack([pieces.begin, pieces.end], axis=1).astype(np.float32))


@dataclass(frozen=True)
class _Pieces:
    """Curves under way: control points (K, 4, 4), strands (K,), and where they begin and end along these (K,)."""

    controls: _Floats
    strand: NDArray[np.int64]
    begin: _Floats
    end: _Floats

    def halved(self, chosen: NDArray[np.bool_]) -> _Pieces:
        """Some of them in two halves, in the same order (de Casteljau)."""
        at = np.repeat(np.arange(len(self.controls)), np.where(chosen, 2, 1))
        second = np.concatenate([[False], at[1:] == at[:-1]])
        first = np.concatenate([second[1:], [False]])
        a, b, c, d = (self.controls[chosen, k] for k in range(4))
        ab, bc, cd = (a + b) / 2.0, (b + c) / 2.0, (c + d) / 2.0
        abc, bcd = (ab + bc) / 2.0, (bc + cd) / 2.0
        middle = (abc + bcd) / 2.0
        controls, begin, end = self.controls[at], self.begin[at], self.end[at]
        controls[first], controls[second] = (
            np.stack([a, ab, abc, middle], axis=1),
            np.stack([middle, bcd, cd, d], axis=1),
        )
        half = (self.begin[chosen] + self.end[chosen]) / 2.0
        end[first], begin[second] = half, half
        return _Pieces(controls, self.strand[at], begin, end)


def _cut(pieces: _Pieces, most: int) -> _Pieces:
    """Halve curves that turn too much; then, up to a number, those that fill little of their boxes."""
    for number in range(_MOST_CUTS):
        cut = _turns(pieces.controls) | _swells(pieces.controls)
        if number < _MOST_STOPS:
            cut |= _stops(pieces.controls)
        if not cut.any():
            break
        pieces = pieces.halved(cut)
    for _ in range(_MOST_CUTS):
        emptiness = _emptiness(pieces.controls)
        count = min(int(np.count_nonzero(emptiness > _EMPTY)), most - len(pieces.controls))
        if count <= 0:
            break
        chosen = np.zeros(len(emptiness), bool)
        chosen[np.argsort(-emptiness, kind="stable")[:count]] = True
        pieces = pieces.halved(chosen)
    return pieces


def _emptiness(controls: _Floats) -> _Floats:
    """Area of the box around each curve, by that of its tube: what rays look into in vain."""
    radius = controls[:, :, 3].max(axis=1)
    x, y, z = (np.ptp(controls[:, :, axis], axis=1) + 2.0 * radius for axis in range(3))
    chord = controls[:, 3, :3] - controls[:, 0, :3]
    length = np.sqrt((chord[:, 0] * chord[:, 0] + chord[:, 1] * chord[:, 1]) + chord[:, 2] * chord[:, 2])
    return np.asarray((x * y + (y * z + z * x)) / ((length + 2.0 * radius) * np.maximum(radius, 1e-30)))


def _turns(controls: _Floats) -> NDArray[np.bool_]:
    """Whether the legs of control polygons, or these and the chord, differ too much in direction."""
    legs = np.diff(controls[:, :, :3], axis=1)
    turns = np.zeros(len(controls), bool)
    for a, b in ((legs[:, 0], legs[:, 1]), (legs[:, 1], legs[:, 2])):
        dot = (a[:, 0] * b[:, 0] + a[:, 1] * b[:, 1]) + a[:, 2] * b[:, 2]
        sizes = [(e[:, 0] * e[:, 0] + e[:, 1] * e[:, 1]) + e[:, 2] * e[:, 2] for e in (a, b)]
        turns |= (dot < 0.0) | (dot * dot < _STRAIGHT * _STRAIGHT * (sizes[0] * sizes[1]))
    return turns


def _swells(controls: _Floats) -> NDArray[np.bool_]:
    """Whether the radius changes by more and less, compared with the length: steps take it for a cone's."""
    radii = controls[:, :, 3]
    change = np.abs(np.diff(radii, n=2, axis=1)).max(axis=1)
    legs = np.diff(controls[:, :, :3], axis=1)
    length = np.sqrt((legs * legs).sum(axis=2)).sum(axis=1)
    return np.asarray((change > _EVEN * length) & (change > _ALIKE * radii.max(axis=1)))


def _stops(controls: _Floats) -> NDArray[np.bool_]:
    """Whether the curve nearly stops on its way, as at doubled control points, and is longer than it is thick."""
    legs = np.diff(controls[:, :, :3], axis=1)
    sizes = (legs * legs).sum(axis=2)
    longest, radius = sizes.max(axis=1), controls[:, :, 3].max(axis=1)
    thin = 0.1 * radius
    return np.asarray((sizes.min(axis=1) < longest / 16.0) & (longest > thin * thin))


def _write_boxes(shapes: NDArray[np.void], controls: _Floats) -> None:
    """Boxes around control points, which curves stay within, and spheres around those."""
    radius = controls[:, :, 3].max(axis=1)[:, None]
    low, high = controls[:, :, :3].min(axis=1) - radius, controls[:, :, :3].max(axis=1) + radius
    # What the device computes of the polynomials, and the middle in single precision
    more = 16.0 * _ROUNDING * (np.maximum(np.abs(low), np.abs(high)) + (high - low))
    center = ((low + high) / 2.0).astype(np.float32)
    extent = np.maximum(high - center, center - low) + more
    shapes["center_radius"][:, :3] = center
    shapes["normal"][:, :3] = np.nextafter(extent.astype(np.float32), np.float32(np.inf))
    extent = shapes["normal"][:, :3].astype(np.float64)
    around = np.sqrt((extent[:, 0] * extent[:, 0] + extent[:, 1] * extent[:, 1]) + extent[:, 2] * extent[:, 2])
    shapes["center_radius"][:, 3] = np.nextafter(around.astype(np.float32), np.float32(np.inf))
