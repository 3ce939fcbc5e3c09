"""This process: its clocks, signals, locks and memory."""

from __future__ import annotations

__all__: list[str] = []
