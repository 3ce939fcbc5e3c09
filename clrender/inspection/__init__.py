"""Light paths of a pixel as the integrators traced them, and maps of where the light of an image comes from."""

from __future__ import annotations

from clrender.inspection.light_path import (
    Addition,
    Guidance,
    LightPath,
    LightSubpath,
    PathVertex,
    Roulette,
    Splat,
    Splats,
)
from clrender.inspection.maps import PathMaps, path_maps
from clrender.inspection.pixel_paths import PixelPaths
from clrender.inspection.tracing import paths

__all__ = [
    "Addition",
    "Guidance",
    "LightPath",
    "LightSubpath",
    "PathMaps",
    "PathVertex",
    "PixelPaths",
    "Roulette",
    "Splat",
    "Splats",
    "path_maps",
    "paths",
]
