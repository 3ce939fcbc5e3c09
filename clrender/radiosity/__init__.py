"""Radiosity: how bright each patch of a diffuse scene is, found once for all views."""

from __future__ import annotations

__all__: list[str] = []
