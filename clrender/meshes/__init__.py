"""Mesh files, and what their bytes mean."""

from __future__ import annotations

__all__: list[str] = []
