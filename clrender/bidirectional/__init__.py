"""Paths from the lights: what the integrator `bdpt` prepares."""

from __future__ import annotations

__all__: list[str] = []
