"""The physics of materials, measured with the rendering kernels: energy, reciprocity, sampling."""

from clrender.furnace.findings import Finding, findings
from clrender.furnace.measure import Measured, measure
from clrender.furnace.numbers import as_json, summary
from clrender.furnace.page import furnace_page
from clrender.furnace.subjects import Subject, subjects_of

__all__ = ["Finding", "Measured", "Subject", "as_json", "findings", "furnace_page", "measure", "subjects_of", "summary"]
