"""Records of kernels as light paths; ``kernels/integrator/inspect.h`` writes them."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import TYPE_CHECKING, Final

import numpy as np
import numpy.typing as npt

from clrender import layout
from clrender.inspection.light_path import Addition, Guidance, LightPath, LightSubpath, PathVertex, Roulette, Splat

if TYPE_CHECKING:
    from clrender.inspection.names import Names

__all__ = [
    "as_rows",
    "counts",
    "highest",
    "light_path",
    "luminance",
    "sample_values",
    "splat",
    "splat_values",
    "written",
]

_Words = npt.NDArray[np.uint32]
_Floats = npt.NDArray[np.float32]

_SAMPLE: Final = layout.columns("INSPECT_SAMPLE")
_VERTEX: Final = layout.columns("INSPECT_VERTEX")
_LIGHT: Final = layout.columns("INSPECT_LIGHT")
_SPLAT: Final = {name: 1 + first for name, first in layout.columns("SPLAT").items()}
"""After the number of the sample."""
_STRATEGIES: Final = {
    layout.INSPECT_LIGHT_SAMPLE: "light sample",
    layout.INSPECT_EMISSION: "emission",
    layout.INSPECT_CHAIN: "specular chain",
    layout.INSPECT_GLOW: "medium emission",
    layout.INSPECT_JOIN: "connection",
}
_OF_LIGHT_PATHS: Final = (layout.INSPECT_LIGHT_START, layout.INSPECT_LIGHT_VERTEX)
_LIMIT: Final = np.float32(2.0**43)
"""Magnitude from which on the film leaves a sample out."""


def as_rows(records: _Words) -> _Words:
    """Records of n samples as rows: (n, `INSPECT_ROWS`, `INSPECT_WORDS`)."""
    return records.reshape(-1, layout.INSPECT_ROWS, layout.INSPECT_WORDS)


def written(rows: _Words) -> _Words:
    """A copy of those rows of a sample, (`INSPECT_ROWS`, `INSPECT_WORDS`), that were written."""
    return rows[: max(1, min(int(rows[0, _SAMPLE["USED"]]), layout.INSPECT_ROWS))].copy()


def sample_values(records: _Words) -> tuple[_Floats, npt.NDArray[np.bool_]]:
    """What each sample adds to its pixel, (n, 3), and which samples are complete, (n,)."""
    heads = as_rows(records)[:, 0]
    values = heads[:, _SAMPLE["VALUE"] : _SAMPLE["VALUE"] + 3].copy().view(np.float32)
    return values, heads[:, _SAMPLE["ENDS"]] == 1


def counts(values: _Floats) -> npt.NDArray[np.bool_]:
    """Which samples the film takes: all channels are finite and below 2^43."""
    with np.errstate(invalid="ignore"):
        return np.asarray((np.abs(values) < _LIMIT).all(axis=-1))


class _Row:
    """A row of a record, by its columns."""

    def __init__(self, words: _Words, columns: dict[str, int]) -> None:
        self._words, self._floats, self._columns = words, words.view(np.float32), columns

    def bits(self, column: str) -> int:
        return int(self._words[self._columns[column]])

    def number(self, column: str) -> float:
        return float(self._floats[self._columns[column]])

    def vector(self, column: str) -> _Floats:
        first = self._columns[column]
        return self._floats[first : first + 3].copy()


def light_path(
    index: int,
    value: _Floats,
    splat: _Floats | None,
    rows: _Words,
    names: Names,
    origin: Sequence[float],
    share: float,
    integrator: str,
    spectral: bool,
) -> LightPath:
    """The path of a sample.

    Parameters
    ----------
    index : int
        Number of the sample.
    value : (3,) float32
        What it adds to its pixel; NaN if the kernel has not finished it.
    splat : (3,) float32, optional
        See `LightPath`.
    rows : (n, `INSPECT_WORDS`) uint32
        What the kernel has written.
    names : Names
    origin : (3,) float
        World space, metres: what positions in the record are relative to.
    share : float
        See `LightPath`.
    integrator : str
    spectral : bool
        Whether it has wavelengths.
    """
    head = _Row(rows[0], _SAMPLE)
    used, filter_weight = head.bits("USED"), head.number("FILTER")
    vertices: list[PathVertex] = []
    current: _Row | None = None
    before: list[Addition] = []
    additions: list[Addition] = []
    here = np.asarray(origin, np.float64)
    ray: tuple[npt.NDArray[np.float64], _Floats] | None = None
    for place, words in enumerate(rows[1:], 1):
        kind = int(words[0])
        if kind in _OF_LIGHT_PATHS:
            continue
        if kind != layout.INSPECT_VERTEX:
            made = _addition(_Row(words, _LIGHT), kind, names, here, np.float32(filter_weight), integrator)
            if kind == layout.INSPECT_JOIN:
                joined = _Row(words, _LIGHT)
                subpath = _light_subpath(
                    joined.bits("PATH"), joined.number("STANDS_FOR"), rows[place + 1 :], names, here
                )
                made = _with_light_path(made, subpath)
            # A medium shines before the path arrives, which its vertex then has
            (before if kind == layout.INSPECT_GLOW else additions).append(made)
            continue
        if current is not None:
            vertices.append(_vertex(current, names, here, additions, integrator))
        current, additions, before = _Row(words, _VERTEX), before, []
        if ray is None:
            ray = current.vector("ORIGIN") + here, current.vector("ARRIVES")
    if current is not None:
        vertices.append(_vertex(current, names, here, [*additions, *before], integrator))
    start, direction = ray or (here, np.zeros(3, np.float32))
    return LightPath(
        index,
        value,
        splat,
        share,
        head.vector("RADIANCE"),
        head.vector("WAVELENGTHS") if spectral else None,
        filter_weight,
        start,
        direction,
        head.number("TIME"),
        bool(counts(value)),
        tuple(vertices),
        max(used - layout.INSPECT_ROWS, 0),
        head.vector("REST"),
    )


def _addition(
    row: _Row, kind: int, names: Names, origin: npt.NDArray[np.float64], filter_weight: np.float32, integrator: str
) -> Addition:
    flags, light = row.bits("FLAGS"), row.bits("LIGHT")
    light_kind = name = group = None
    known = light != layout.NONE
    if known:
        light_kind, name, group = names.of_light(light, row.bits("LIGHT_KIND"))
    sampled, joined = kind == layout.INSPECT_LIGHT_SAMPLE, kind == layout.INSPECT_JOIN
    infinite, whitted = bool(flags & layout.INSPECT_INFINITE), integrator == "whitted"
    strategy = "light centre" if sampled and whitted else _STRATEGIES[kind]
    chain, bidirectional = kind == layout.INSPECT_CHAIN, integrator == "bdpt"
    light_weight, bsdf_weight = row.number("LIGHT_WEIGHT"), row.number("BSDF_WEIGHT")
    light_vertices = row.bits("EVENTS") + 2 if joined else int(sampled)
    contribution: _Floats = row.vector("COLOR") * filter_weight
    return Addition(
        strategy,
        row.bits("ORDER"),
        light if known else None,
        light_kind,
        name,
        group,
        row.vector("TARGET") + origin if joined or (sampled and not infinite) else None,
        row.vector("DIRECTION") if known or joined else None,
        row.vector("EMITTED"),
        row.number("CHOICE"),
        row.number("LIGHT_PDF"),
        row.number("BSDF_PDF"),
        None if chain or whitted else row.bits("DEPTH") + 2,
        None if chain or whitted else light_vertices,
        None if chain else light_weight if sampled else bsdf_weight,
        None if bidirectional else light_weight,
        None if bidirectional else bsdf_weight,
        bool(flags & layout.INSPECT_IN_FULL),
        bool(flags & layout.INSPECT_DELTA),
        bool(flags & layout.INSPECT_ASKED),
        bool(flags & layout.INSPECT_ARRIVED),
        row.vector("UNSHADOWED"),
        row.vector("ADDED"),
        contribution,
        None,
    )


def _with_light_path(made: Addition, path: LightSubpath | None) -> Addition:
    """A connection with its light path, and the light that this is from."""
    if path is None:
        return made
    light = {name: getattr(path, name) for name in ("light", "light_kind", "object", "light_group")}
    return dataclasses.replace(made, light_path=path, **light)


def splat_values(listed: _Words) -> _Floats:
    """What splats add to their pixel, (n, 3), of rows of `UnitSums.listed`."""
    return np.ascontiguousarray(listed[:, _SPLAT["COLOR"] : _SPLAT["COLOR"] + 3]).view(np.float32)


def splat(listed: _Words, rows: _Words, names: Names, origin: Sequence[float], share: float) -> Splat:
    """A splat.

    Parameters
    ----------
    listed : (1 + `SPLAT_WORDS`,) uint32
        Its row of `UnitSums.listed`.
    rows : (n, `INSPECT_WORDS`) uint32
        What the kernel has written about its light path, after a head.
    names, origin, share
        See `light_path`.
    """
    row, here = _Row(listed, _SPLAT), np.asarray(origin, np.float64)
    path, events = row.bits("PATH"), row.bits("DEPTH")
    subpath = _light_subpath(path, 1.0, rows[1:], names, here)
    return Splat(int(listed[0]), path, row.vector("COLOR"), share, row.number("WEIGHT"), events + 2, subpath)


def _light_subpath(
    path: int, stands_for: float, rows: _Words, names: Names, origin: npt.NDArray[np.float64]
) -> LightSubpath | None:
    """A light path by the rows that begin with its own; None: it was not recorded, at least not to its end."""
    if not len(rows) or int(rows[0, 0]) != layout.INSPECT_LIGHT_START:
        return None
    start, vertices = _Row(rows[0], _VERTEX), []
    for words in rows[1:]:
        if int(words[0]) != layout.INSPECT_LIGHT_VERTEX:
            break
        vertices.append(_vertex(_Row(words, _VERTEX), names, origin, (), "bdpt"))
    if not vertices or vertices[-1].ended is None:
        return None
    vertices[-1] = dataclasses.replace(vertices[-1], event="connection", ended=None)
    return LightSubpath(
        path,
        stands_for,
        start.bits("LIGHT"),
        *names.of_light(start.bits("LIGHT"), start.bits("MATERIAL")),
        start.vector("POINT") + origin if start.bits("FLAGS") & layout.INSPECT_FOUND else None,
        start.vector("LEAVES"),
        start.vector("AFTER"),
        tuple(vertices),
    )


def _vertex(
    row: _Row, names: Names, origin: npt.NDArray[np.float64], additions: Sequence[Addition], integrator: str
) -> PathVertex:
    flags = row.bits("FLAGS")
    ended = _ended(row, flags, integrator)
    found, in_medium = bool(flags & layout.INSPECT_FOUND), bool(flags & layout.INSPECT_IN_MEDIUM)
    on_surface = found and not in_medium
    shape = name = material = kind = None
    if on_surface:
        shape, name, material, kind = names.of_primitive(row.bits("PRIMITIVE"))
    goes = found and ended not in ("depth", "diffuse") and bool(row.vector("LEAVES").any())
    guided = bool(flags & layout.INSPECT_GUIDED)
    light = row.bits("LIGHT")
    with np.errstate(invalid="ignore", over="ignore"):
        contribution: _Floats = sum((each.contribution for each in additions), np.zeros(3, np.float32))
    roulette = None
    if flags & layout.INSPECT_ROULETTE and flags & layout.INSPECT_CARRIES and not flags & layout.INSPECT_STRAIGHT:
        survival, random = row.number("SURVIVAL"), row.number("RANDOM")
        roulette = Roulette(survival, random, random < survival)
    light_share = row.number("LIGHT_SHARE")
    guiding = None
    if guided or light_share < 1.0:
        guiding = Guidance(row.number("SHARE"), bool(flags & layout.INSPECT_BY_FIELD), light_share)
    return PathVertex(
        _event(flags, goes and ended != "absorbed"),
        row.bits("DEPTH"),
        bool(flags & layout.INSPECT_BACK),
        row.vector("POINT") + origin if found else None,
        row.number("DISTANCE") if found else None,
        row.vector("NORMAL") if on_surface else None,
        row.vector("SHADING") if on_surface else None,
        bool(flags & layout.INSPECT_FRONT),
        shape,
        name,
        material,
        "medium" if in_medium else kind,
        light if light != layout.NONE and on_surface else None,
        row.vector("ARRIVES"),
        row.vector("LEAVES") if goes else None,
        row.vector("BEFORE"),
        row.vector("AFTER") if goes else np.zeros(3, np.float32),
        row.vector("WEIGHT") if goes else None,
        row.number("PDF") if goes else None,
        row.number("BSDF_PDF") if goes else None,
        row.number("INDEX") if goes else None,
        roulette,
        guiding,
        ended,
        tuple(additions),
        contribution,
    )


def _ended(row: _Row, flags: int, integrator: str) -> str | None:
    """Why a path ends at a vertex."""
    if flags & layout.INSPECT_GOES_ON:
        return None
    if not flags & layout.INSPECT_FOUND:
        return "escape"
    if not flags & layout.INSPECT_SCATTERS:
        return "depth"
    if flags & layout.INSPECT_CARRIES:
        return "roulette"
    if not (row.vector("AFTER") > 0.0).any():
        return "absorbed"
    if integrator == "bdpt":
        return "roulette"
    return "diffuse" if integrator != "path" or flags & layout.INSPECT_SAMPLES_LIGHTS else "roulette"


def _event(flags: int, goes: bool) -> str:
    if not flags & layout.INSPECT_FOUND:
        return "escape"
    if not goes:
        return "end"
    if flags & layout.INSPECT_STRAIGHT:
        return "straight"
    if flags & layout.INSPECT_IN_MEDIUM:
        return "scattering"
    way = "transmission" if flags & layout.INSPECT_CROSSES else "reflection"
    return f"specular {way}" if flags & layout.INSPECT_SPECULAR else way


def highest(values: _Floats, taken: npt.NDArray[np.bool_], most: int) -> npt.NDArray[np.intp]:
    """Indices of the samples with the largest luminance, by magnitude, in that order; those that do not count first."""
    size = np.where(taken, np.abs(luminance(values)), np.inf)
    return np.argsort(-size, kind="stable")[:most]


def luminance(values: _Floats) -> npt.NDArray[np.float64]:
    """Luminance of linear Rec. 709 colours, (n,) float64."""
    with np.errstate(invalid="ignore", over="ignore"):
        wide = values.astype(np.float64)
        return wide[..., 0] * 0.2126 + wide[..., 1] * 0.7152 + wide[..., 2] * 0.0722
