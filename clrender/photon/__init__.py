"""Photon maps: what the integrator `photon` prepares."""

from __future__ import annotations

__all__: list[str] = []
