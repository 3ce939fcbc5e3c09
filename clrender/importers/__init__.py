"""Importers of other programs' scene formats, which produce the same validated `Scene` as our own format."""

from __future__ import annotations

from clrender.importers.load import CHOICES, SCENE_ENDINGS, load

__all__ = ["CHOICES", "SCENE_ENDINGS", "load"]
