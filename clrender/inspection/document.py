"""Light paths as JSON values. `FORMAT` changes whenever a key changes its meaning; docs/light-paths.md lists them."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import numpy.typing as npt

if TYPE_CHECKING:
    from clrender.inspection.light_path import LightPath, Splats

__all__ = ["FORMAT", "document", "plain"]

FORMAT: Final = "clrender light paths 1"


def document(
    about: Mapping[str, Any],
    pixel: tuple[int, int],
    radiance: npt.NDArray[np.float32],
    nonfinite_samples: int,
    values: npt.NDArray[np.float32],
    samples: Sequence[LightPath],
    splats: Splats | None,
) -> dict[str, Any]:
    """The paths of a pixel as JSON values; numbers that are not finite become None.

    Parameters
    ----------
    about, pixel, radiance, nonfinite_samples, values, samples, splats
        See `clrender.inspection.pixel_paths.PixelPaths`.
    """
    return {
        "format": FORMAT,
        **plain(dict(about)),
        "pixel": list(pixel),
        "radiance": plain(radiance),
        "nonfinite_samples": nonfinite_samples,
        "values": plain(values),
        "splats": plain(splats),
        "samples": [plain(each) for each in samples],
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
