"""Scenes written in our own format, with everything that they name beside them."""

from __future__ import annotations

from clrender.exporters.own import Export, exported, scene_text

__all__ = ["Export", "exported", "scene_text"]
