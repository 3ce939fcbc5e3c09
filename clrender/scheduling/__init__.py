"""Scheduling: assigns units of work to workers, and handles the failure of devices."""

from __future__ import annotations

__all__: list[str] = []
