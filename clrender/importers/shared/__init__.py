"""Code shared by the importers of other renderers' scene files."""

from __future__ import annotations

__all__: list[str] = []
