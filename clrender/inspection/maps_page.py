"""The page of the maps of an image: one HTML file that needs nothing else."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from html import escape
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from clrender.drawing.html import html_document, html_table, paragraphs
from clrender.drawing.pictures import data_uri, figure_of, shrunk
from clrender.drawing.table import Table
from clrender.image.tone_map import LUMINANCE, to_display
from clrender.wording import counted

__all__ = ["Shown", "maps_page"]

_MOST: Final = 900
"""Largest longer side of a picture, pixels."""
_EXTREME: Final = 99.0
"""Percentile of a map that gets the brightest colour."""
_STOPS: Final = ((0, 0, 0), (52, 16, 92), (150, 38, 104), (232, 98, 60), (252, 191, 86), (255, 255, 220))
"""Colours from the least number of a map to the largest, ever lighter, so that they can be told apart without hue."""
_STRATEGIES: Final = {
    "mis": "both strategies, weighted",
    "light": "light sampling alone",
    "bsdf": "BSDF sampling alone",
}


@dataclass(frozen=True)
class Shown:
    """What the page shows; see `clrender.inspection.maps.PathMaps`.

    Attributes
    ----------
    about : mapping
    image, bounces, length : ndarray of float32
    errors : mapping of str to ndarray of float32
    shares : ndarray of float64
    noise : mapping of str to float
    stops : float
    """

    about: Mapping[str, Any]
    image: npt.NDArray[np.float32]
    bounces: npt.NDArray[np.float32]
    length: npt.NDArray[np.float32]
    errors: Mapping[str, npt.NDArray[np.float32]]
    shares: npt.NDArray[np.float64]
    noise: Mapping[str, float]
    stops: float


def maps_page(maps: Shown) -> str:
    """HTML of maps.

    Parameters
    ----------
    maps : Shown
    """
    about, name = maps.about, Path(maps.about["scene"]).stem
    size, spp = f"{about['width']} × {about['height']} pixels", about["spp"]
    parts = [
        *paragraphs(
            [f"{name}, {size}, {counted(spp, 'sample')} per pixel, seed {about['seed']}. clrender {about['version']}."]
        ),
        figure_of(_picture(maps.image, maps.stops, f"The image of {name}"), "The image."),
        "<h2>What each bounce adds</h2>",
        *paragraphs(
            [
                "Radiance that arrives after so many scattering events; the parts add up to the image. Dark ones are "
                "shown brighter than it, as they say."
            ]
        ),
        _row([_bounce(maps, number) for number in range(len(maps.bounces))]),
        html_table(
            Table(
                "Share of the luminance of the image, and what is there with all parts before it.",
                ("scattering events", "share", "sum"),
                _share_rows(maps),
            ),
            "short",
            [],
        ),
        "<h2>How long paths are</h2>",
        _length(maps),
        "<h2>What is noisy</h2>",
        *paragraphs(
            [
                "Standard error of the luminance of each pixel, if the light of surfaces is found by one strategy "
                "alone, and by both. All three maps have one scale."
            ]
        ),
        _errors(maps),
        html_table(
            Table(
                "Root mean square of the standard errors over the image, relative to its mean luminance.",
                ("strategy", "error"),
                [(_STRATEGIES[key], f"{value:.2%}") for key, value in maps.noise.items()],
            ),
            "short",
            [],
        ),
    ]
    return html_document(f"Where the light of {name} comes from", parts)


def _row(figures: list[str]) -> str:
    return f'<div class="row" style="--columns: 3">{"".join(figures)}</div>'


def _words(maps: Shown, number: int) -> str:
    if number == len(maps.bounces) - 1:
        return f"{number} and more"
    return "0: seen directly" if number == 0 else "1: direct light" if number == 1 else str(number)


def _bounce(maps: Shown, number: int) -> str:
    words, part = _words(maps, number), maps.bounces[number]
    more = _stops_to(part, maps.image)
    picture = _picture(part, maps.stops + more, f"Light after scattering events: {words}")
    brighter = f", {counted(more, 'stop')} brighter" if more else ""
    return figure_of(picture, f"{words} ({maps.shares[number]:.1%}{brighter})")


def _stops_to(part: npt.NDArray[np.float32], whole: npt.NDArray[np.float32]) -> int:
    """Stops after which the lightest places of a part are about as light as those of the image, at most 8."""
    bright, light = (float(np.percentile(shrunk(each, 64) @ np.array(LUMINANCE), 90.0)) for each in (whole, part))
    if not (bright > 0.0 and light > 0.0):
        return 0
    return int(np.clip(np.floor(np.log2(bright / light)), 0, 8))


def _share_rows(maps: Shown) -> list[tuple[str, str, str]]:
    shares = maps.shares
    sums = np.cumsum(shares)
    return [(_words(maps, n), f"{shares[n]:.2%}", f"{sums[n]:.2%}") for n in range(len(shares))]


def _length(maps: Shown) -> str:
    length = maps.length
    known = length[np.isfinite(length)]
    most = max(float(np.percentile(known, _EXTREME)) if known.size else 1.0, 1e-6)
    mean = float(np.sum(maps.shares * np.arange(len(maps.shares))))
    caption = (
        f"Mean number of scattering events on the way of each pixel's light, weighted by luminance; {mean:.2f} over "
        "the image. Black pixels have none."
    )
    picture = _map(np.nan_to_num(length) / most, "Mean number of scattering events")
    return _row([figure_of(picture + _scale("0", f"{most:.3g}"), caption)])


def _errors(maps: Shown) -> str:
    most = max(float(np.percentile(error, _EXTREME)) for error in maps.errors.values()) or 1.0
    figures = [
        figure_of(
            _map(error / most, f"Standard error with {_STRATEGIES[key]}") + _scale("0", f"{most:.3g} W/(sr m²)"),
            _STRATEGIES[key],
        )
        for key, error in maps.errors.items()
    ]
    return _row(figures)


def _picture(linear: npt.NDArray[np.float32], stops: float, words: str) -> str:
    return _image(to_display(np.maximum(shrunk(linear, _MOST), 0.0), "srgb", stops), words)


def _map(values: npt.NDArray[np.float32], words: str) -> str:
    return _image(_colored(shrunk(values, _MOST)), words)


def _image(pixels: npt.NDArray[np.uint8], words: str) -> str:
    height, width, _ = pixels.shape
    return f'<img src="{data_uri(pixels, lossless=True)}" width="{width}" height="{height}" alt="{escape(words)}">'


def _colored(values: npt.ArrayLike) -> npt.NDArray[np.uint8]:
    """Colours of numbers from 0 to 1."""
    stops = np.array(_STOPS, np.float64)
    at = np.clip(np.asarray(values, np.float64), 0.0, 1.0) * (len(stops) - 1)
    left = np.minimum(at.astype(np.int64), len(stops) - 2)
    share = (at - left)[..., None]
    return np.asarray(np.round(stops[left] + (stops[left + 1] - stops[left]) * share), np.uint8)


def _scale(low: str, high: str) -> str:
    colors = ", ".join("#" + bytes(color).hex() for color in _STOPS)
    return (
        f'<div class="scale" style="--colors: linear-gradient(90deg, {colors})"><span>{escape(low)}</span><i></i>'
        f"<span>{escape(high)}</span></div>"
    )
