"""The physics of materials, measured with the rendering kernels: energy, reciprocity, sampling."""

from clrender.furnace.findings import Finding, findings
from clrender.furnace.lights import (
    MeasuredLight,
    light_findings,
    light_json,
    light_summary,
    measure_light,
    named_light,
)
from clrender.furnace.measure import Measured, measure
from clrender.furnace.numbers import as_json, summary
from clrender.furnace.page import furnace_page
from clrender.furnace.subjects import Subject, subjects_of

__all__ = [
    "Finding",
    "Measured",
    "MeasuredLight",
    "Subject",
    "as_json",
    "findings",
    "furnace_page",
    "light_findings",
    "light_json",
    "light_summary",
    "measure",
    "measure_light",
    "named_light",
    "subjects_of",
    "summary",
]
