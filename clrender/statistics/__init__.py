"""Statistical distributions and tests."""

from __future__ import annotations

__all__: list[str] = []
