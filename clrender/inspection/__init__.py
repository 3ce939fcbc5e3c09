"""Light paths of a pixel, as the integrators traced them: every vertex, density, weight and contribution."""

from __future__ import annotations

from clrender.inspection.light_path import Addition, Guidance, LightPath, PathVertex, Roulette
from clrender.inspection.pixel_paths import PixelPaths
from clrender.inspection.tracing import paths

__all__ = ["Addition", "Guidance", "LightPath", "PathVertex", "PixelPaths", "Roulette", "paths"]
