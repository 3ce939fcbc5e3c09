"""The physics of materials as a page: one self-contained HTML file."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape
from typing import Any, Final

from clrender.drawing.html import html_document, html_table, paragraphs
from clrender.drawing.pictures import figure_of
from clrender.drawing.table import Table
from clrender.furnace.findings import ALARM, ALLOWED, Finding
from clrender.furnace.measure import Measured
from clrender.furnace.numbers import summary
from clrender.furnace.plots import energy_plot, lobe_plot, roughness_plot

__all__ = ["furnace_page"]

_TOPICS: Final = {
    **dict.fromkeys(("gain", "loss", "keeps", "loses", "absorbs", "transmits"), "energy"),
    **dict.fromkeys(("estimators", "weight", "density", "unseen"), "sampling and evaluation"),
    **dict.fromkeys(("directions", "integral", "sampled", "deltas", "integration"), "directions"),
    **dict.fromkeys(("reciprocity", "reciprocal", "unreciprocal"), "reciprocity"),
    **dict.fromkeys(("lanes", "bits"), "bits"),
    **dict.fromkeys(("nonfinite", "negative"), "samples"),
}
_PROMISES: Final = ("keeps", "sampled", "reciprocal", "bits")
_ENERGY: Final = (
    "Directional albedo: fraction of uniform light that leaves the surface towards the viewer, against the angle from "
    "the normal. Circles: mean weight of sampled directions; crosses: integral of the evaluated BSDF plus deltas; the "
    "two must agree. Dashed: the material without its colour. Error bars: three standard errors."
)
_ROUGH: Final = (
    "The same against roughness, mean of the colours. Energy that a rough surface loses in white is a fault."
)
_LOBE: Final = (
    "BSDF times cosine in the plane of incidence, mean of the colours, without deltas: cube root, each curve scaled to "
    "its maximum. The marks show the viewing directions."
)


def furnace_page(
    title: str, measured: Sequence[Measured], found: Sequence[Sequence[Finding]], numbers: Sequence[dict[str, Any]],
    how: Sequence[str],
) -> str:  # fmt: skip
    """The page.

    Parameters
    ----------
    title : str
        Source of the materials.
    measured, found, numbers
        For each material: its measurements, the findings on them, and `clrender.furnace.numbers.as_json` of both.
    how : sequence of str
        Sentences on device, seed and version.
    """
    parts = [
        *paragraphs(
            [
                "Each material is tested in a white furnace, that is, under uniform light from all directions. The "
                "energy that leaves it, its reciprocity, and whether sampled directions match the probability "
                "density are measured with the rendering kernels."
            ]
        ),
        html_table(summary(numbers), "", []),
    ]
    for place, (each, sentences) in enumerate(zip(measured, found, strict=True)):
        parts += _material(place, each, sentences)
    parts += ["<h2>How it was measured</h2>", *paragraphs([*_method(), *how])]
    return html_document(f"Physics of materials: {title}", parts)


def _material(place: int, measured: Measured, found: Sequence[Finding]) -> list[str]:
    keys = ", ".join(f"{key} = {value}" for key, value in measured.keys.items() if key != "type")
    outcomes = ["fails" if each.fault else "holds" if each.kind in _PROMISES else "" for each in found]
    rows = [
        [_TOPICS[each.kind], outcome, _capital(each.sentence)] for each, outcome in zip(found, outcomes, strict=True)
    ]
    table = Table(f"{measured.kind}{': ' if keys else ''}{keys}", ("property", "", "result"), rows, words=3)
    parts = [
        f"<h2>{escape(measured.title)}</h2>",
        html_table(table, "prose", outcomes),
        figure_of(energy_plot(measured, f"energy-{place}"), _ENERGY),
    ]
    if measured.rows:
        parts.append(figure_of(roughness_plot(measured, f"roughness-{place}"), _ROUGH))
    if not measured.only_deltas:
        parts.append(figure_of(lobe_plot(measured, f"lobe-{place}"), _LOBE))
    return parts


def _capital(sentence: str) -> str:
    return f"{sentence[:1].upper()}{sentence[1:]}."


def _method() -> list[str]:
    return [
        "Energy by sampling: 16 independent estimates at each angle, each from a jittered grid of random numbers; "
        "their spread gives the standard error. Energy by evaluation: directions chosen independently of the "
        "material's density, around the normal and, at all scales, around the mirror and refraction directions. "
        "Transmitted light is measured as flux: radiance times the square of the relative index.",
        "Directions: counts in cells around the mirror and refraction directions, compared with the density integrated "
        "over each cell (Pearson's χ² test). A density whose integral, together with the deltas and the samples "
        "without light, is not 1 also fails the test.",
        f"If all materials are correct, the probability of a false fault is at most {100 * ALARM:g} % in total. "
        f"Energies may deviate by {100 * ALLOWED:g} % in addition to noise.",
    ]
