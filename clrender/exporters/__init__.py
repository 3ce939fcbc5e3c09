"""Exports scenes in clrender's own format, Mitsuba's, LuxCore's and Cycles', together with all files that they name."""

from __future__ import annotations

from clrender.exporters.cycles import exported_to_cycles, write_cycles
from clrender.exporters.luxcore import exported_to_luxcore, write_luxcore
from clrender.exporters.mitsuba import MitsubaExport, exported_to_mitsuba, write_mitsuba
from clrender.exporters.own import Export, exported, scene_text
from clrender.exporters.target import ForeignExport

__all__ = [
    "Export",
    "ForeignExport",
    "MitsubaExport",
    "exported",
    "exported_to_cycles",
    "exported_to_luxcore",
    "exported_to_mitsuba",
    "scene_text",
    "write_cycles",
    "write_luxcore",
    "write_mitsuba",
]
