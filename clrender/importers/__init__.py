"""Scenes in the formats of other programs, read into the same validated `Scene` as our own."""

from __future__ import annotations

from clrender.importers.load import SCENE_ENDINGS, load

__all__ = ["SCENE_ENDINGS", "load"]
