"""What readers of other renderers' scene files have in common."""

from __future__ import annotations

__all__: list[str] = []
