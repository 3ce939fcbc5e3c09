"""Radiosity of the patches of a diffuse scene, solved once for all views."""

from __future__ import annotations

__all__: list[str] = []
