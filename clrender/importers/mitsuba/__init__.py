"""Scenes of Mitsuba 3 (and 2), and those of 0.6 where they say the same: XML."""

from __future__ import annotations

from clrender.importers.mitsuba.read import read

__all__ = ["read"]
