"""The names of layers, and their channels in files."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Final

import numpy as np
import numpy.typing as npt

from clrender.errors import UsageError
from clrender.wording import suggestion

__all__ = [
    "AOVS",
    "ERRORS",
    "FLOWS",
    "LABELS",
    "MATTES",
    "NAMED",
    "OF_FILM",
    "OF_RENDERS",
    "RANKS",
    "SHADOW_CATCHER",
    "channel_count",
    "check_aovs",
    "exact_channels",
    "exr_channels",
]

_Array = npt.NDArray[np.float32]

RANKS: Final = 6
"""Number of ids that a matte stores per pixel, by descending coverage; two of them form a layer of a file."""

AOVS: Final[Mapping[str, str]] = {
    "alpha": "A",
    "albedo": "RGB",
    "emission": "RGB",
    "normal": "XYZ",
    "normal_camera": "XYZ",
    "tangent": "XYZ",
    "depth": "Z",
    "z_depth": "Z",
    "position": "XYZ",
    "flow": "UV",
    "scene_flow": "XYZ",
    "uv": "UV",
    "object": "V",
    "material": "V",
    "instance": "VA",
    "category": "VA",
    "part": "VA",
    "samples": "V",
    "stderr": "RGB",
    "unconverged": "V",
    "crypto_object": "RGBA",
    "crypto_material": "RGBA",
    "shadow_catcher": "RGB",
}
"""Every layer, and the letters of its channels; for mattes, those of each of their layers."""

ERRORS: Final = frozenset(("stderr", "unconverged"))
"""The layers that estimate the image's error."""

OF_FILM: Final = frozenset(("samples", *ERRORS))
"""The layers that come from the image's own film instead of first hits."""

SHADOW_CATCHER: Final = "shadow_catcher"
OF_RENDERS: Final = frozenset((SHADOW_CATCHER,))
"""The layers that come from renders of other scenes."""

FLOWS: Final = frozenset(("flow", "scene_flow"))
"""The layers of what moves from the time of the image to another."""

MATTES: Final[Mapping[str, str]] = {"crypto_object": "CryptoObject", "crypto_material": "CryptoMaterial"}
"""The layers that are mattes, and their names in files."""

LABELS: Final = ("instance", "category", "part")
"""The layers of exact numbers; see `clrender.aov.labels`."""

NAMED: Final = frozenset((*LABELS, *MATTES, "object", "material"))
"""The layers that depend on names in the scene, or on the order of its tables, which its image does not."""

_HALF: Final = ("alpha", "albedo", "emission", "normal", "normal_camera", "tangent")
"""Shares, colours and directions, for which half precision suffices."""


def check_aovs(names: Iterable[str]) -> tuple[str, ...]:
    """The requested layers, without duplicates; a text may have several, with commas.

    Raises
    ------
    UsageError
        If one is unknown.
    """
    if not isinstance(names, Iterable):
        raise UsageError(f"aov is {names!r}, but must be names of layers, such as ('albedo', 'normal')")
    given = [name.strip() for name in names.split(",")] if isinstance(names, str) else names
    wanted = tuple(dict.fromkeys(given))
    for name in wanted:
        if name not in AOVS:
            known = suggestion(name, AOVS) or f"; there are {', '.join(AOVS)}"
            raise UsageError(f"aov: there is no layer {name!r}{known}")
    return wanted


def exr_channels(layers: Mapping[str, _Array]) -> dict[str, _Array]:
    """The layers as channels of an EXR file: ``albedo.R``, ``normal.X``, ``depth.Z``, ``CryptoObject00.R``, …

    Parameters
    ----------
    layers : mapping of str to (H, W, C) float32
        Channels that are contiguous in memory, such as those of `first_hits`, are not copied.

    Returns
    -------
    dict of str to (H, W) float32
    """
    return {
        name: np.ascontiguousarray(layer[..., channel])
        for layer_name, layer in layers.items()
        for channel, name in enumerate(_channel_names(layer_name))
    }


def exact_channels(layers: Iterable[str]) -> frozenset[str]:
    """The channels of these layers that half precision would ruin: distances, positions and ids."""
    return frozenset(name for layer in layers if layer not in _HALF for name in _channel_names(layer))


def channel_count(layers: Iterable[str]) -> int:
    """Number of channels of all these layers."""
    return sum(len(_channel_names(layer)) for layer in layers)


def _channel_names(layer: str) -> list[str]:
    if layer == "alpha":
        return [AOVS[layer]]  # the fourth channel of the image
    if layer not in MATTES:
        return [f"{layer}.{letter}" for letter in AOVS[layer]]
    return [f"{MATTES[layer]}{number:02}.{letter}" for number in range(RANKS // 2) for letter in AOVS[layer]]
