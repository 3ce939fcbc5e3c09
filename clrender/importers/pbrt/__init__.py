"""Scenes of pbrt-v4."""

from __future__ import annotations

from clrender.importers.pbrt.read import read

__all__ = ["read"]
