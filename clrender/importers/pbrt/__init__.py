"""Importer of pbrt-v4 scenes."""

from __future__ import annotations

from clrender.importers.pbrt.read import read

__all__ = ["read"]
