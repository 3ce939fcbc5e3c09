"""The founding report, measured again: its table, its figures, and what holds of its conclusions."""

from __future__ import annotations

__all__: list[str] = []
