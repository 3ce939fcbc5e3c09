"""Scheduling: which unit of work goes to whom, and what happens when a device fails."""

from __future__ import annotations

__all__: list[str] = []
