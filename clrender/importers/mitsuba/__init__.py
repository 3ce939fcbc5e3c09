"""Importer of the XML scenes of Mitsuba 3 (and 2), and of 0.6 as far as their meaning is the same."""

from __future__ import annotations

from clrender.importers.mitsuba.read import read

__all__ = ["read"]
