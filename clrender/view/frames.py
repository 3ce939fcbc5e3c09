"""Frames: the newest pixels of a layer, and the binary message that carries them."""

from __future__ import annotations

import json
import threading
import time
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from clrender.aov import GUIDES, LAYER_KINDS
from clrender.errors import ClrenderError
from clrender.film import Film
from clrender.film.replicates import standard_error
from clrender.film.running import RunningFilm
from clrender.image.denoise import Denoiser
from clrender.image.tone_map import LUMINANCE
from clrender.view.image_state import ImageState, Pixels

__all__ = ["LAYERS", "Frame", "Frames", "encode", "first_hit_layers_of", "shown_image"]


LAYERS: Final[Mapping[str, tuple[str, str]]] = {
    "image": ("Image", "radiance"),
    "denoised": ("Denoised", "radiance"),
    "stderr": ("Standard error", "scalar"),
    "error": ("Relative standard error", "scalar"),
    "samples": ("Samples", "scalar"),
    "alpha": ("Alpha", "scalar"),
    "albedo": ("Albedo", "color"),
    "emission": ("Emission", "radiance"),
    "normal": ("Normal", "vector"),
    "depth": ("Depth", "scalar"),
    "position": ("Position", "vector"),
    "uv": ("Texture coordinates", "vector"),
    "tangent": ("Tangent", "vector"),
    "object": ("Object", "number"),
    "material": ("Material", "number"),
}
"""What may be shown: label and kind of each."""

_SINGLE: Final = ("depth", "position", "object", "material", "samples")
"""Layers whose numbers half precision would spoil."""
_DARK: Final = 0.1
"""Of the mean luminance: what is darker is as far off as if it had this, as of `clrender.film.convergence`."""
_HALF_MOST: Final = 65504.0
_SHARE: Final = 8.0
"""Between two frames of a layer there is so many times what the first took: viewers must not slow the render down."""
_LEAST_SECONDS: Final = 1.0 / 30.0
_MOST_SECONDS: Final = 2.0
_MORE_SAMPLES: Final = 1.25
"""A frame with fewer times the samples of the one before looks the same: its noise is less by a tenth at most."""
_SAME_SECONDS: Final = 1.0
"""But after so long there is another one, so that people see that it goes on."""
_MOST_KEPT: Final = 32
"""Frames that are kept: sixteen viewers show two layers each."""


@dataclass(frozen=True)
class Frame:
    """Pixels of a layer at one moment.

    Attributes
    ----------
    state : ImageState
    layer : str
    pixels : (h, w, c) float32
    changes : int
        That of the image state when they were taken.
    samples : float
        Of a pixel, mean.
    coarse, final : bool
    """

    state: ImageState
    layer: str
    pixels: Pixels
    changes: int
    samples: float
    coarse: bool
    final: bool


class Frames:
    """Makes frames when viewers ask for them, and caches the newest of each layer and size. Any thread may ask.

    The cache holds frames of one image only: one of an earlier image would keep that image's film in memory.
    """

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._kept: dict[tuple[str, int], Frame] = {}  # by layer and size; the one made last is last
        self._due: dict[tuple[str, int], tuple[float, float]] = {}  # earliest and latest time of the next one
        self._denoiser: Denoiser | None = None

    def newest(self, state: ImageState, layer: str, most: int, seen: tuple[int, int]) -> Frame | None:
        """A frame that is newer than the viewer's, if there is one and it is time for it.

        Parameters
        ----------
        state : ImageState
        layer : str
            Of `LAYERS`.
        most : int
            Pixels of the longer side, at most.
        seen : (int, int)
            Revision and changes of the frame before.
        """
        if (state.revision, state.changes) == seen:
            return None
        key = (layer, most)
        with self._lock:
            kept = self._kept.get(key)
            if kept is not None and kept.state is state and kept.changes == state.changes:
                return kept
            if kept is not None and not self._is_due(key, kept, state):
                return kept if (state.revision, kept.changes) != seen else None
            begin = time.monotonic()
            frame = self._made(state, layer, most)
            if frame is not None:
                self._keep(key, frame)
                now = time.monotonic()
                earliest = now + min(max(_LEAST_SECONDS, _SHARE * (now - begin)), _MOST_SECONDS)
                self._due[key] = earliest, max(earliest, now + _SAME_SECONDS)
            return frame

    def release(self) -> None:
        """Release the cache and the denoiser."""
        with self._lock:
            self._kept.clear()
            if self._denoiser is not None:
                self._denoiser.release()
                self._denoiser = None

    def _keep(self, key: tuple[str, int], frame: Frame) -> None:
        self._kept = {other: kept for other, kept in self._kept.items() if other != key and kept.state is frame.state}
        self._kept[key] = frame
        if len(self._kept) > _MOST_KEPT:
            del self._kept[next(iter(self._kept))]
        self._due = {other: when for other, when in self._due.items() if other in self._kept}

    def _is_due(self, key: tuple[str, int], kept: Frame, state: ImageState) -> bool:
        """Whether it is time for a newer frame than the one that is kept."""
        # One that was final is not any more, if the image has changed since.
        if kept.state is not state or kept.coarse or kept.final or state.idle:
            return True
        now, (earliest, latest) = time.monotonic(), self._due[key]
        return now >= latest or (now >= earliest and state.samples >= _MORE_SAMPLES * kept.samples)

    def _made(self, state: ImageState, layer: str, most: int) -> Frame | None:
        changes, samples, final = state.changes, state.samples, state.sha256 is not None
        step = max(1, -(-max(state.width, state.height) // most))
        film = state.film
        coarse = False
        if layer == "image" or (layer == "denoised" and not self._can_denoise(state)):
            pixels, coarse = shown_image(state, step)
        elif layer == "denoised":
            assert film is not None
            whole = Film.snapshot(film, max(state.width, state.height))
            pixels = self._denoised(whole, state)[::step, ::step]
        elif layer == "samples":
            pixels = None if film is None else film.counts[::step, ::step, None].astype(np.float32)
        elif layer in ("stderr", "error"):
            known = film is not None and film.replicate_spp is not None
            pixels = _errors(film, layer == "error")[::step, ::step] if film is not None and known else None
        else:
            found = state.layers.get(layer)
            coarse = not state.is_whole(layer)
            pixels = found if found is None or coarse else found[::step, ::step]
        return None if pixels is None else Frame(state, layer, pixels, changes, samples, coarse, final)

    def _can_denoise(self, state: ImageState) -> bool:
        if state.film is None or int(state.film.counts.min()) == 0:
            return False
        return all(map(state.is_whole, GUIDES))

    def _denoised(self, linear: Pixels, state: ImageState) -> Pixels:
        try:
            self._denoiser = self._denoiser or Denoiser()
            return self._denoiser(linear, *(state.layers[guide] for guide in GUIDES))
        except ClrenderError:
            return linear  # `Engine.hello` says that there is no denoiser


def first_hit_layers_of(layer: str) -> tuple[str, ...]:
    """First-hit layers that a layer is made from."""
    if layer == "denoised":
        return GUIDES
    return (layer,) if layer in LAYER_KINDS or layer in ("object", "material") else ()


def shown_image(state: ImageState, step: int) -> tuple[Pixels | None, bool]:
    """The image, or every so many pixels of it, with the preview where there is no sample yet; whether it is coarse."""
    film, preview = state.film, state.preview
    if film is None or not film.changes:
        return preview, preview is not None
    empty = film.counts[::step, ::step] == 0  # before the sums: they only gain samples meanwhile
    pixels = film.snapshot(-(-max(state.width, state.height) // step))
    if preview is not None and empty.any():
        rows, columns = np.nonzero(empty)
        height, width = preview.shape[:2]
        pixels[rows, columns] = preview[
            np.minimum(rows * step * height // state.height, height - 1),
            np.minimum(columns * step * width // state.width, width - 1),
        ]
    return pixels, False


def _errors(film: RunningFilm, relative: bool) -> Pixels:
    """Standard errors of radiance, or, of luminance, as a share of it."""
    copy = RunningFilm(film.width, film.height, {"replicate_spp": film.replicate_spp})
    film.copy_to(copy)
    errors = standard_error(copy)
    if relative:
        luminance = copy.mean() @ np.array(LUMINANCE)
        floor = max(_DARK * float(luminance.mean()), 1e-30)
        errors = (errors @ np.array(LUMINANCE) / np.maximum(luminance, floor))[..., None]
    return errors.astype(np.float32)


def encode(frame: Frame, number: int, half: bool, answers: int | str | None) -> bytes:
    """A frame as a binary message.

    Parameters
    ----------
    frame : Frame
    number : int
        To acknowledge.
    half : bool
        Whether half precision is wanted, where the layer takes it.
    answers : int, str or None
        The viewer's newest camera message in it.
    """
    pixels = frame.pixels
    height, width, channels = pixels.shape
    header: dict[str, Any] = {
        "frame": number,
        "revision": frame.state.revision,
        "layer": frame.layer,
        "channels": channels,
        "width": width,
        "height": height,
        "image_width": frame.state.width,
        "image_height": frame.state.height,
        "samples": round(frame.samples, 3),
        "coarse": frame.coarse,
        "final": frame.final,
        "answers": answers,
        "range": None if LAYERS[frame.layer][1] in ("radiance", "color") else _range(pixels),
    }
    half = half and frame.layer not in _SINGLE
    header["format"] = "float16" if half else "float32"
    numbers = np.clip(pixels, -_HALF_MOST, _HALF_MOST).astype("<f2") if half else pixels.astype("<f4", copy=False)
    text = json.dumps(header, separators=(",", ":")).encode()
    text += b" " * (-(4 + len(text)) % 8)
    return b"".join((len(text).to_bytes(4, "little"), text, np.ascontiguousarray(numbers).data))


def _range(pixels: Pixels) -> list[float] | None:
    """Lowest and highest finite number."""
    finite = pixels[np.isfinite(pixels)]
    return [float(finite.min()), float(finite.max())] if finite.size else None
