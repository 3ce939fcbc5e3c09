"""Light paths as JSON values. `FORMAT` changes whenever a key changes its meaning; docs/light-paths.md lists them."""

from __future__ import annotations

import dataclasses
import math
from typing import TYPE_CHECKING, Any, Final

import numpy as np

if TYPE_CHECKING:
    from clrender.inspection.pixel_paths import PixelPaths

__all__ = ["FORMAT", "document", "plain"]

FORMAT: Final = "clrender light paths 1"


def document(paths: PixelPaths) -> dict[str, Any]:
    """All of `paths` but its pictures, as JSON values; numbers that are not finite become None."""
    return {
        "format": FORMAT,
        **plain(dict(paths.about)),
        "pixel": list(paths.pixel),
        "radiance": plain(paths.radiance),
        "nonfinite_samples": paths.nonfinite_samples,
        "values": plain(paths.values),
        "samples": [plain(each) for each in paths.samples],
    }


def plain(value: Any) -> Any:
    """Dataclasses as objects and arrays as lists, with the fewest digits that give the same float32 or float64."""
    if dataclasses.is_dataclass(value):
        return {each.name: plain(getattr(value, each.name)) for each in dataclasses.fields(value)}
    if isinstance(value, dict):
        return {name: plain(each) for name, each in value.items()}
    if isinstance(value, (tuple, list)):
        return [plain(each) for each in value]
    if isinstance(value, np.ndarray):
        return [plain(each) for each in value]
    if isinstance(value, np.float32):
        return float(str(value)) if np.isfinite(value) else None
    if isinstance(value, float):
        return float(value) if math.isfinite(value) else None
    return value.item() if isinstance(value, np.generic) else value
