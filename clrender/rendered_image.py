"""What a render gives: the image with its film and numbers, and the progress on the way."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from clrender.aov import MATTES, exact_channels, exr_channels, matte_attributes
from clrender.errors import RenderError, UsageError
from clrender.exposure import camera_exposure, photographic_stops
from clrender.film import Film
from clrender.film.replicates import relative_error
from clrender.image.exr_write import ExrFormat
from clrender.image.files import png_bytes, write_image

__all__ = ["IncompleteRender", "Progress", "RenderedImage", "check_mattes"]


@dataclass(frozen=True)
class Progress:
    """How far a render is.

    Attributes
    ----------
    samples_done, samples_total : int
        Over all pixels.
    seconds : float
        Since the first launch.
    rays : int
    film : Film or None
        What is committed so far, where one render is watched: `Film.snapshot` of it is cheap, in any thread.
    samples_resumed : int
        Of `samples_done`, those that came from a checkpoint.
    """

    samples_done: int
    samples_total: int
    seconds: float
    rays: int
    film: Film | None = None
    samples_resumed: int = 0

    @property
    def fraction(self) -> float:
        """Between 0 and 1."""
        return self.samples_done / self.samples_total if self.samples_total else 1.0

    @property
    def samples_per_second(self) -> float:
        """Mean so far."""
        return (self.samples_done - self.samples_resumed) / self.seconds if self.seconds > 0.0 else 0.0

    @property
    def seconds_left(self) -> float:
        """At the mean speed so far; infinite before the first sample."""
        speed = self.samples_per_second
        return (self.samples_total - self.samples_done) / speed if speed > 0.0 else float("inf")

    @property
    def relative_error(self) -> float | None:
        """Mean standard error of the pixels' luminance over their mean luminance, by some thousand of the pixels.

        It takes some milliseconds. None where it is not known: without replicates, before each of them has two, or for
        who does not watch one render. Only for `on_progress`: a later look at the film may meet half a change.
        """
        return relative_error(self.film) if self.film is not None else None


@dataclass
class RenderedImage:
    """A finished (or interrupted) render.

    Attributes
    ----------
    linear : (height, width, 3) float32
        Radiance, linear Rec. 709.
    stats : dict
        What ``--stats`` writes.
    film : Film
        The exact sums; released for huge images unless they were asked for.
    interrupted : bool
        Some of the samples asked for are missing.
    denoised : (height, width, 3) float32 or None
        The image without noise, where that was asked for: what `save` writes.
    aovs : dict of str to (height, width, channels) float32
        The layers asked for; `clrender.aov.first_hits` says what each holds.
    mattes : dict of str to sequence of str or None
        Of those that are mattes, the names of the scene's shapes or materials (`clrender.aov.matte_names`).
    """

    linear: npt.NDArray[np.float32]
    stats: dict[str, Any]
    film: Film
    interrupted: bool
    denoised: npt.NDArray[np.float32] | None = None
    aovs: dict[str, npt.NDArray[np.float32]] = field(default_factory=dict)
    mattes: Mapping[str, Sequence[str | None]] = field(default_factory=dict)

    @property
    def picture(self) -> npt.NDArray[np.float32]:
        """What is written and shown, (height, width, 3) float32: `denoised` where there is one, else `linear`."""
        return self.linear if self.denoised is None else self.denoised

    @property
    def camera_stops(self) -> float:
        """Exposure of display images by the camera's f-stop, shutter and iso; 0 without them."""
        return photographic_stops(**camera_exposure(self.stats, {}))

    def save(
        self,
        path: str | Path,
        tone_map: str = "srgb",
        exposure: float = 0.0,
        *,
        exr_type: str = "float",
        exr_compression: str = "zip",
        exr_tile: int | None = None,
    ) -> None:
        """Write the image; the ending says how. `.film` keeps the exact sums, `.exr` the layers too.

        Parameters
        ----------
        path : str or Path
        tone_map : str
            For display formats.
        exposure : float
            In stops, for display formats; added to that of the camera's f-stop, shutter and iso, where it has them.
        exr_type, exr_compression : str
            Of `.exr`: `type` and `compression` of `clrender.image.exr_write.ExrFormat`.
        exr_tile : int, optional
            Its `tile`, pixels.

        Raises
        ------
        UsageError
            When the ending or the tone map is unknown, or the compression of an `.exr` would lose the ids of mattes.
        RenderError
            When the file cannot be written; nothing is left half-written.
        """
        exr = ExrFormat(exr_type, exr_compression, exr_tile)
        if Path(path).suffix.lower() == ".film":
            told = {name: value for name, value in self.stats.items() if not name.startswith("denois")}
            self.film.save(path, {**told, "denoised": False})
        elif Path(path).suffix.lower() == ".exr":
            check_mattes(self.aovs, exr)
            exact, attributes = exact_channels(self.aovs), matte_attributes(self.mattes)
            channels = exr_channels(self.aovs)
            stored = {"exr_type": exr_type, "exr_compression": exr_compression}
            told = {**self.stats, "stored": stored}
            write_image(path, self.picture, told, channels=channels, exr=exr, exact=exact, attributes=attributes)
        else:
            exposure += self.camera_stops
            told = {**self.stats, "stored": {"tone_map": tone_map, "exposure": exposure}}
            write_image(path, self.picture, told, tone_map, exposure)

    def _repr_html_(self) -> str:
        from clrender.image_html import image_html

        return image_html(self)

    def _repr_png_(self) -> bytes:
        from clrender.image_html import IMAGE_SIDE, shrunk

        return png_bytes(shrunk(self.picture, IMAGE_SIDE), exposure=self.camera_stops)


def check_mattes(layers: Iterable[str], exr: ExrFormat) -> None:
    """Make sure that a file keeps the ids of mattes, if there are some.

    Raises
    ------
    UsageError
    """
    matte = next((name for name in layers if name in MATTES), None)
    if matte is not None and exr.lossy:
        raise UsageError(
            f"exr_compression is {exr.compression!r}, which changes numbers, and the ids of {matte} have to stay as "
            "they are; choose another, such as zip"
        )


class IncompleteRender(RenderError):
    """Every device failed before the render was done; what was finished by then is kept.

    Attributes
    ----------
    image : RenderedImage
        Of the samples that were finished.
    """

    def __init__(self, message: str, image: RenderedImage) -> None:
        super().__init__(message)
        self.image = image
