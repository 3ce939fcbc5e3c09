"""Display of an image in a notebook: self-contained HTML with its layers and statistics."""

from __future__ import annotations

import base64
import secrets
from collections.abc import Mapping
from html import escape
from string import Template
from typing import Any, Final, Protocol

import numpy as np
import numpy.typing as npt

from clrender.aov import LABELS, MATTES
from clrender.image.display import jpeg_bytes, png_bytes
from clrender.image.tone_map import LUMINANCE, to_display
from clrender.wording import grouped, rounded

__all__ = ["IMAGE_SIDE", "LAYER_SIDE", "ShownImage", "image_html", "shrunk"]

_Array = npt.NDArray[np.float32]
_Bytes = npt.NDArray[np.uint8]

IMAGE_SIDE: Final = 1024
LAYER_SIDE: Final = 512
"""Longer side of a layer in a notebook, pixels, at most: notebooks store every image that they display."""

_PAGE: Final = Template("""<div class="clrender-image" id="$name">
<style>
#$name { font: 13px/1.5 system-ui, sans-serif; }
#$name figure { display: none; margin: .4em 0; }
#$name figure img { max-width: 100%; height: auto; display: block; }
#$name figcaption, #$name th { opacity: .75; }
#$name > input { position: absolute; opacity: 0; }
#$name > label { display: inline-block; margin: 0 .3em .3em 0; padding: .1em .6em; border: 1px solid #8888;
  border-radius: 4px; cursor: pointer; }
#$name > input:checked + label { background: #8884; font-weight: 600; }
#$name > input:focus-visible + label { outline: 2px solid #1559b0; }
#$name summary { cursor: pointer; }
#$name table { border-collapse: collapse; font-variant-numeric: tabular-nums; }
#$name th { text-align: left; font-weight: 400; padding-right: 1.5em; }
#$name td { text-align: left; }
$rules
</style>
$buttons
$figures
<details><summary>Numbers</summary><table>
$numbers
</table></details>
</div>""")


class ShownImage(Protocol):
    """What of a `clrender.rendering.rendered_image.RenderedImage` is shown."""

    @property
    def linear(self) -> _Array: ...

    @property
    def denoised(self) -> _Array | None: ...

    @property
    def picture(self) -> _Array: ...

    @property
    def aovs(self) -> Mapping[str, _Array]: ...

    @property
    def stats(self) -> Mapping[str, Any]: ...

    @property
    def camera_stops(self) -> float: ...


def image_html(image: ShownImage) -> str:
    """HTML of an image: one image or layer at a time, selected by buttons, and the statistics collapsed below.

    It uses no scripts, so that it works in exported notebooks and where scripts are not run. Images are reduced to
    `IMAGE_SIDE` and layers to `LAYER_SIDE` pixels; the caption says so.
    """
    name = f"clrender-{secrets.token_hex(6)}"
    shown = [("image", "Image", _radiance(image.picture, image, IMAGE_SIDE), "")]
    if image.denoised is not None:
        shown[0] = ("image", "Denoised", *shown[0][2:])
        shown.append(("noisy", "Before denoising", _radiance(image.linear, image, IMAGE_SIDE), ""))
    shown += [(key, key, *_layer(key, layer, image)) for key, layer in image.aovs.items()]
    height, width = image.linear.shape[:2]
    buttons, figures, rules = [], [], []
    for number, (key, label, pixels, meaning) in enumerate(shown):
        if len(shown) > 1:
            checked = " checked" if number == 0 else ""
            buttons.append(
                f'<input type="radio" name="{name}" id="{name}-{number}"{checked}><label for="{name}-{number}">'
                f"{escape(label)}</label>"
            )
            rules.append(f"#{name}-{number}:checked ~ .clrender-{number} {{ display: block; }}")
        caption = _caption(pixels, width, height, meaning)
        figures.append(
            f'<figure class="clrender-{number}"><img src="{_source(key, pixels)}" alt="{escape(label)}" '
            f'width="{pixels.shape[1]}"><figcaption>{escape(caption)}</figcaption></figure>'
        )
    if len(shown) == 1:
        rules.append(f"#{name} figure {{ display: block; }}")
    rows = [f"<tr><th>{escape(what)}</th><td>{escape(text)}</td></tr>" for what, text in _numbers(image.stats)]
    return _PAGE.substitute(
        name=name,
        rules="\n".join(rules),
        buttons="\n".join(buttons),
        figures="\n".join(figures),
        numbers="\n".join(rows),
    )


def shrunk(pixels: _Array, most: int) -> _Array:
    """Reduce an image so that its longer side has at most `most` pixels, by averaging square blocks of pixels.

    Parameters
    ----------
    pixels : (height, width, channels) float32
    most : int

    Returns
    -------
    (h, w, channels) float32
        The given image if it is small enough. Incomplete blocks at the right and bottom edges are dropped.
    """
    step = _step(pixels, most)
    if step == 1:
        return pixels
    height, width = pixels.shape[0] // step, pixels.shape[1] // step
    squares = pixels[: height * step, : width * step].reshape(height, step, width, step, -1)
    mean: _Array = squares.mean(axis=(1, 3), dtype=np.float32)
    return mean


def _step(pixels: _Array, most: int) -> int:
    longer, shorter = max(pixels.shape[:2]), min(pixels.shape[:2])
    step: int = min(-(-longer // most), shorter)
    return step


def _radiance(linear: _Array, image: ShownImage, most: int) -> _Bytes:
    return to_display(shrunk(linear, most), exposure=image.camera_stops)


def _layer(key: str, layer: _Array, image: ShownImage) -> tuple[_Bytes, str]:
    """A layer as 8-bit colours, and the meaning of the colours."""
    step = _step(layer, LAYER_SIDE)
    some = layer[::step, ::step]  # not averaged: ids and directions have no mean, and infinite values would spread
    match key:
        case "albedo":
            return to_display(shrunk(layer, LAYER_SIDE)), ""
        case "emission":
            return _radiance(layer, image, LAYER_SIDE), ""
        case "normal" | "normal_camera" | "tangent":
            return _bytes(0.5 + 0.5 * some), "red, green, blue: x, y, z from -1 to 1"
        case "uv":
            u, v = np.moveaxis(some % 1.0, 2, 0)
            return _bytes(np.stack([u, v, np.zeros_like(u)], axis=2)), "red: u, green: v, what is left of whole numbers"
        case "position":
            return _ranged(some, "red, green, blue: x, y, z", "m")
        case "flow":
            return _ranged(some, "red, green: to the right, down", "pixels")
        case "scene_flow":
            return _ranged(some, "red, green, blue: along x, y, z", "m")
        case "depth" | "z_depth":
            return _ranged(some, "distance", "m")
        case "object" | "material":
            return _colored(some[..., 0].astype(np.int64)), "a colour for each number; black: nothing"
        case _ if key in LABELS:
            return _colored(some[..., 0].astype(np.int64) - 1), "a colour for each number; black: nothing"
        case _ if key in MATTES:
            names = np.ascontiguousarray(some[..., 0]).view(np.uint32).astype(np.int64)
            return _colored(
                np.where(some[..., 1] > 0.0, names, -1)
            ), "a colour for the name that covers most of a pixel"
        case "stderr":
            return _ranged((some @ np.asarray(LUMINANCE, np.float32))[..., None], "luminance", "W/(sr m²)")
        case _:
            return _ranged(some, "number", "")


def _ranged(values: _Array, what: str, unit: str) -> tuple[_Bytes, str]:
    """Map each channel linearly from its minimum, black, to its maximum, white; also returns these limits as text."""
    finite = np.isfinite(values)
    low = np.where(finite, values, np.inf).min(axis=(0, 1))
    high = np.where(finite, values, -np.inf).max(axis=(0, 1))
    if not np.isfinite([low, high]).all():
        return _bytes(np.zeros((*values.shape[:2], 3), np.float32)), "no finite value"
    with np.errstate(invalid="ignore"):
        shares = (values - low) / np.where(high > low, high - low, 1.0)
    shares = np.where(finite, shares, 0.0)
    ends = [", ".join(f"{end:.4g}" for end in each) for each in (low, high)]
    caption = f"{what} from {ends[0]} (black) to {ends[1]} {unit}".rstrip()
    if shares.shape[2] == 2:
        shares = np.concatenate([shares, np.zeros_like(shares[..., :1])], axis=2)
    return _bytes(np.broadcast_to(shares, (*values.shape[:2], 3))), f"{caption} (white)"


def _colored(numbers: npt.NDArray[np.int64]) -> _Bytes:
    """A light colour for each id, equal for equal ids; black for negative ids."""
    mixed = (numbers.astype(np.uint64) * np.uint64(0x9E3779B97F4A7C15)) >> np.uint64(40)
    channels = [(mixed >> np.uint64(shift)) & np.uint64(255) for shift in (16, 8, 0)]
    colors = (64 + np.stack(channels, axis=2).astype(np.float64) * (191 / 255)).astype(np.uint8)
    colors[numbers < 0] = 0
    return colors


def _bytes(shares: npt.NDArray[Any]) -> _Bytes:
    """Values between 0 and 1 as 8 bits per channel, without a tone curve."""
    pixels: _Bytes = (np.nan_to_num(np.clip(shares, 0.0, 1.0)) * 255.0 + 0.5).astype(np.uint8)
    return pixels


def _source(key: str, pixels: _Bytes) -> str:
    """An image as a data URL: a PNG if colours stand for ids, else a JPEG, which is far smaller for noisy images."""
    exact = key in ("object", "material") or key in MATTES or key in LABELS
    data, kind = (png_bytes(pixels, {}), "png") if exact else (jpeg_bytes(pixels), "jpeg")
    return f"data:image/{kind};base64,{base64.b64encode(data).decode()}"


def _caption(pixels: _Bytes, width: int, height: int, meaning: str) -> str:
    h, w = pixels.shape[:2]
    size = f"{width} × {height}" if (w, h) == (width, height) else f"{w} × {h} of {width} × {height}"
    return "; ".join(filter(None, (f"{size} pixels", meaning)))


def _numbers(stats: Mapping[str, Any]) -> list[tuple[str, str]]:
    """The statistics shown with an image: names and values as text."""

    def number(key: str, words: str) -> list[str]:
        value = stats.get(key)
        return [] if value is None else [f"{rounded(value, 4)}{words}"]

    devices = [str(device["name"]) for device in stats.get("devices", [])]
    taken = stats.get("samples", 0) / max(stats.get("width", 0) * stats.get("height", 0), 1)
    rows = {
        "Integrator": [str(stats["integrator"])] if "integrator" in stats else [],
        "Samples per pixel": [rounded(taken, 4)] if taken else [],
        "Seed": [str(stats["seed"])] if "seed" in stats else [],
        "Standard error of the mean": _means(stats.get("mean_stderr")),
        "Devices": devices,
        "Time": number("render_seconds", " s"),
        "Speed": number("msamples_per_second", " million samples/s") + number("mrays_per_second", " million rays/s"),
        "Samples that were not finite": [grouped(stats["nonfinite_samples"])] if stats.get("nonfinite_samples") else [],
        "SHA-256": [str(stats["image_sha256"])] if "image_sha256" in stats else [],
        "Version": [str(stats["version"])] if "version" in stats else [],
    }
    return [(what, ", ".join(texts)) for what, texts in rows.items() if texts]


def _means(errors: Any) -> list[str]:
    return [] if errors is None else [f"{each:.3g}" for each in np.atleast_1d(np.asarray(errors, np.float64))]
