"""Exports scenes in clrender's own format and in Mitsuba's, together with all files that they name."""

from __future__ import annotations

from clrender.exporters.mitsuba import MitsubaExport, exported_to_mitsuba, write_mitsuba
from clrender.exporters.own import Export, exported, scene_text

__all__ = ["Export", "MitsubaExport", "exported", "exported_to_mitsuba", "scene_text", "write_mitsuba"]
