"""Measurements of materials as numbers: JSON for programs, a table for people."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

import numpy as np

from clrender.drawing.table import Table
from clrender.furnace.energy import Energy
from clrender.furnace.findings import Finding
from clrender.furnace.measure import Measured, place_title

__all__ = ["as_json", "summary"]

_HEADER: Final = ("material", "type", "energy", "in white", "reciprocity", "χ² p", "faults")
_CAPTION: Final = (
    "Energy: smallest and largest fraction of uniform light that leaves the surface, over angles, colours and, where "
    "they are varied, roughnesses; in white: the same for the material without its colour. Reciprocity: largest "
    "relative difference of f(a, b) and f(b, a). χ² p: smallest p-value of the tests of sampled directions, corrected "
    "for their number; – for pure delta distributions."
)


def as_json(measured: Measured, found: Sequence[Finding]) -> dict[str, Any]:
    """All results, JSON-able.

    Parameters
    ----------
    measured : Measured
    found : sequence of Finding

    Returns
    -------
    dict
        ``material energy_max energy_min reciprocity_max chi2_p_min`` and more. If no direction can be tested, because
        all light is in delta distributions, ``chi2_tests`` is 0 and ``chi2_p_min`` 1.
    """
    own, white = _energies(measured, white=False), _energies(measured, white=True)
    tested = [each for each in measured.tests if each.tested]
    return {
        "material": measured.name,
        "uv": measured.uv,
        "type": measured.kind,
        "keys": measured.keys,
        "energy_max": max(float(each.sampled.max()) for each in own),
        "energy_min": min(float(each.sampled.min()) for each in own),
        "energy_error": max(float(each.sampled_error.max()) for each in own),
        "white_energy_max": max(float(each.sampled.max()) for each in white),
        "white_energy_min": min(float(each.sampled.min()) for each in white),
        "white_energy_error": max(float(each.sampled_error.max()) for each in white),
        "reciprocity_max": measured.reciprocity.largest,
        "reciprocity_pairs": measured.reciprocity.compared,
        "chi2_p_min": _smallest_p(measured),
        "chi2_tests": len(tested),
        "only_deltas": measured.only_deltas,
        "samples": measured.tally.samples,
        "nonfinite": measured.tally.nonfinite,
        "negative": measured.tally.negative,
        "faults": sum(each.fault for each in found),
        "findings": [
            {"kind": each.kind, "fault": each.fault, "amount": each.amount, "sentence": each.sentence} for each in found
        ],
        "energy": [_energy(each) for each in measured.energies],
        "white_energy": [_energy(each, evaluated=False) for each in measured.white],
        "roughness": [
            {
                "roughness": row.roughness,
                "energy": _energy(row.energy, evaluated=False),
                "white_energy": _energy(row.white, evaluated=False),
            }
            for row in measured.rows
        ],
        "chi2": [
            {
                "side": _side(each.below),
                "angle": each.angle,
                "statistic": each.fit.statistic,
                "degrees_of_freedom": each.fit.freedom,
                "p": each.fit.p,
                "pdf_integral": each.integral,
                "delta_share": each.delta_share,
                "tested": each.tested,
            }
            for each in measured.tests
        ],
    }


def summary(numbers: Sequence[dict[str, Any]]) -> Table:
    """A table with a row for each material.

    Parameters
    ----------
    numbers : sequence of dict
        See `as_json`.
    """
    rows = [
        [
            place_title(each["material"], each["uv"]),
            each["type"],
            f"{each['energy_min']:.4f} to {each['energy_max']:.4f}",
            f"{each['white_energy_min']:.4f} to {each['white_energy_max']:.4f}",
            f"{each['reciprocity_max']:.1g}" if each["reciprocity_pairs"] else "–",
            f"{each['chi2_p_min']:.2g}" if each["chi2_tests"] else "–",
            str(each["faults"]),
        ]
        for each in numbers
    ]
    return Table(_CAPTION, _HEADER, rows, words=2)


def _energies(measured: Measured, white: bool) -> list[Energy]:
    rows = [row.white if white else row.energy for row in measured.rows]
    return [*(measured.white if white else measured.energies), *rows]


def _smallest_p(measured: Measured) -> float:
    p = [each.fit.p for each in measured.tests if each.tested]
    return float(-np.expm1(len(p) * np.log1p(-min(p)))) if p and min(p) < 1.0 else 1.0


def _side(below: bool) -> str:
    return "back" if below else "front"


def _energy(energy: Energy, evaluated: bool = True) -> dict[str, Any]:
    columns = {"angles": energy.angles, "sampled": energy.sampled, "sampled_error": energy.sampled_error}
    if evaluated:
        columns |= {"evaluated": energy.evaluated, "evaluated_error": energy.evaluated_error}
    columns |= {"delta": energy.delta, "through": energy.through}
    return {"side": _side(energy.below), **{name: column.tolist() for name, column in columns.items()}}
