"""Maps between points and pixels: lens distortion, and conventions of poses."""

from __future__ import annotations

__all__: list[str] = []
