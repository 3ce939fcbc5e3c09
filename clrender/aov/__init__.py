"""Layers of an image (AOVs): data of the first hits of its camera rays."""

from __future__ import annotations

from clrender.aov.cryptomatte import matte_attributes, matte_names
from clrender.aov.first_hits import (
    FIRST_HITS,
    GUIDE_SAMPLES,
    GUIDES,
    LAYER_KINDS,
    LAYER_SAMPLES,
    LayerArguments,
    LayerKind,
    alpha_samples,
    first_hits,
    hit_counts,
)
from clrender.aov.labels import Label, Labelling, labels_told
from clrender.aov.names import (
    AOVS,
    ERRORS,
    FLOWS,
    LABELS,
    MATTES,
    NAMED,
    OF_FILM,
    OF_RENDERS,
    SHADOW_CATCHER,
    channel_count,
    check_aovs,
    exact_channels,
    exr_channels,
)

__all__ = [
    "AOVS",
    "ERRORS",
    "FIRST_HITS",
    "FLOWS",
    "GUIDES",
    "GUIDE_SAMPLES",
    "LABELS",
    "LAYER_KINDS",
    "LAYER_SAMPLES",
    "MATTES",
    "NAMED",
    "OF_FILM",
    "OF_RENDERS",
    "SHADOW_CATCHER",
    "Label",
    "Labelling",
    "LayerArguments",
    "LayerKind",
    "alpha_samples",
    "channel_count",
    "check_aovs",
    "exact_channels",
    "exr_channels",
    "first_hits",
    "hit_counts",
    "labels_told",
    "matte_attributes",
    "matte_names",
]
