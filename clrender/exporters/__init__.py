"""Exports scenes in clrender's own format, together with all files that they name."""

from __future__ import annotations

from clrender.exporters.own import Export, exported, scene_text

__all__ = ["Export", "exported", "scene_text"]
