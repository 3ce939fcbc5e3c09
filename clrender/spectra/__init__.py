"""Spectra, and the colours that they have: the observer of CIE 1931 and linear Rec. 709."""

from __future__ import annotations

__all__: list[str] = []
