"""Results of a render: the image with its film and statistics, and progress reports."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from numbers import Real
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from clrender.aov import LABELS, MATTES, Label, exact_channels, exr_channels, matte_attributes
from clrender.errors import RenderError, UsageError
from clrender.files.access import atomic_write
from clrender.files.npy import write_npy
from clrender.film import Film
from clrender.film.replicates import relative_error
from clrender.image.deep_png import deep_png_bytes
from clrender.image.exposure import camera_exposure, photographic_stops
from clrender.image.exr_write import ExrFormat
from clrender.image.files import png_bytes, write_image
from clrender.image.tone_map import DisplayMap, record_of
from clrender.limits import checked_path
from clrender.rendering.amodal import amodal_channels
from clrender.rendering.bands import band_channels
from clrender.rendering.light_groups import group_channels

if TYPE_CHECKING:
    from clrender.guiding.field import GuidingField

__all__ = ["IncompleteRender", "Progress", "RenderedImage", "check_mattes"]


@dataclass(frozen=True)
class Progress:
    """Progress of a render.

    Attributes
    ----------
    samples_done, samples_total : int
        Summed over all pixels.
    seconds : float
        Time since the first launch.
    rays : int
    film : Film or None
        The samples committed so far, if a single render is observed. `Film.snapshot` is cheap and works in any thread.
    samples_resumed : int
        The part of `samples_done` that came from a checkpoint.
    """

    samples_done: int
    samples_total: int
    seconds: float
    rays: int
    film: Film | None = None
    samples_resumed: int = 0

    @property
    def fraction(self) -> float:
        """Fraction of the samples that are done, between 0 and 1."""
        return self.samples_done / self.samples_total if self.samples_total else 1.0

    @property
    def samples_per_second(self) -> float:
        """Mean speed so far, without the resumed samples."""
        return (self.samples_done - self.samples_resumed) / self.seconds if self.seconds > 0.0 else 0.0

    @property
    def seconds_left(self) -> float:
        """Estimated time left at the mean speed so far; infinite before the first sample."""
        speed = self.samples_per_second
        return (self.samples_total - self.samples_done) / speed if speed > 0.0 else float("inf")

    @property
    def relative_error(self) -> float | None:
        """Mean standard error of the pixels' luminance over their mean luminance, from a few thousand pixels.

        Computing it takes a few milliseconds. It is None if unknown: without replicates, before each pixel has two of
        them, or if no single render is observed. Read it only within `on_progress`: later the film may be in the middle
        of an update.
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
        The statistics that ``--stats`` writes.
    film : Film
        The exact sums; released after developing unless they were to be kept.
    interrupted : bool
        Whether some of the requested samples are missing.
    denoised : (height, width, 3) float32 or None
        The denoised image, if requested; `save` then writes this one.
    aovs : dict of str to (height, width, channels) float32
        The requested layers; see `clrender.aov.first_hits` for their contents.
    mattes : dict of str to sequence of str or None
        For each layer that is a matte, the names of the scene's shapes or materials (`clrender.aov.matte_names`).
    guiding_field : GuidingField or None
        The field that guided its paths; None if none did, or if a cluster took the samples.
    spectrum : (height, width, bands) float32 or None
        Mean radiance in bands of equal width from 360 to 830 nm, W/(sr m2) as `linear`: of light that is the same at
        all wavelengths each band has the luminance.
    light_groups : dict of str to (height, width, 3) float32
        The part of `linear` that each light group contributes, if they were asked for. Sums of all of them in single
        precision, in any order, are `linear` to the bit, unless the pixel filter is negative somewhere.
    labels : mapping of str to tuple of Label
        For each of the layers ``instance``, ``category`` and ``part``: what the numbers that cover something stand
        for, and their areas.
    amodal : dict of int to (height, width) float32
        Of each instance of `amodal`: the share of every pixel that it would cover if nothing stood before it.
    """

    linear: npt.NDArray[np.float32]
    stats: dict[str, Any]
    film: Film
    interrupted: bool
    denoised: npt.NDArray[np.float32] | None = None
    aovs: dict[str, npt.NDArray[np.float32]] = field(default_factory=dict)
    mattes: Mapping[str, Sequence[str | None]] = field(default_factory=dict)
    guiding_field: GuidingField | None = None
    light_groups: dict[str, npt.NDArray[np.float32]] = field(default_factory=dict)
    spectrum: npt.NDArray[np.float32] | None = None
    labels: Mapping[str, tuple[Label, ...]] = field(default_factory=dict)
    amodal: dict[int, npt.NDArray[np.float32]] = field(default_factory=dict)

    def __array__(self, dtype: npt.DTypeLike | None = None, copy: bool | None = None) -> npt.NDArray[Any]:
        """`linear`, for `numpy.asarray` and what else takes arrays."""
        if dtype is None or np.dtype(dtype) == self.linear.dtype:
            return self.linear.copy() if copy else self.linear
        if copy is False:
            raise ValueError(f"an image of float32 becomes one of {np.dtype(dtype)} by a copy only")
        return self.linear.astype(dtype)

    @property
    def picture(self) -> npt.NDArray[np.float32]:
        """The image to write and display, (height, width, 3) float32: `denoised` if there is one, else `linear`."""
        return self.linear if self.denoised is None else self.denoised

    @property
    def alpha(self) -> npt.NDArray[np.float32] | None:
        """The layer ``alpha``, (height, width) float32, 0 to 1: the fourth channel of `.png` and `.exr` files.

        `linear` is premultiplied: over a background C it is linear + (1 - alpha) C. None without that layer.
        """
        return self.aovs["alpha"][..., 0] if "alpha" in self.aovs else None

    @property
    def camera_stops(self) -> float:
        """Exposure of display images, in stops, from the camera's f-stop, shutter and iso; 0 without them."""
        return photographic_stops(**camera_exposure(self.stats, {}))

    def mask(self, layer: str) -> npt.NDArray[np.uint32]:
        """The numbers of a layer of labels: what covers most of each pixel.

        Parameters
        ----------
        layer : str
            ``instance``, ``category`` or ``part``, which the image must have.

        Returns
        -------
        (height, width) uint32
            From 1, see `labels`; 0 for nothing.

        Raises
        ------
        UsageError
            The image has no such layer.
        """
        if layer not in self.aovs or layer not in LABELS:
            have = ", ".join(name for name in self.aovs if name in LABELS) or "none"
            raise UsageError(f"layer is {layer!r}, but the layers of labels that this image has are: {have}")
        return self.aovs[layer][..., 0].astype(np.uint32)

    def save_mask(self, path: str | Path, layer: str) -> None:
        """Write the numbers of a layer of labels.

        Parameters
        ----------
        path : str or Path
            `.png`: grey with 16 bits; `.npy`: (height, width) uint32.
        layer : str
            See `mask`.

        Raises
        ------
        UsageError
            The image has no such layer, the ending is another one, or the numbers are too large for a `.png`.
        RenderError
            When the file cannot be written.
        """
        path, numbers = checked_path(path, "path"), self.mask(layer)
        ending = path.suffix.lower()
        if ending not in (".png", ".npy"):
            raise UsageError(f"{path}: masks are written to .png and .npy; end it in one of them")
        largest = int(numbers.max())
        if ending == ".png" and largest > 65535:
            raise UsageError(f"{path}: has the number {largest}, but a .png holds at most 65535; write a .npy")
        with atomic_write(path) as file:
            if ending == ".png":
                file.write(deep_png_bytes(numbers.astype(np.uint16)))
            else:
                write_npy(file, numbers)

    def save(
        self,
        path: str | Path,
        tone_map: str | DisplayMap = "srgb",
        exposure: float = 0.0,
        *,
        exr_type: str = "float",
        exr_compression: str = "zip",
        exr_tile: int | None = None,
    ) -> None:
        """Write the image in the format of the file suffix. `.film` keeps the exact sums, `.exr` also the layers.

        Parameters
        ----------
        path : str or Path
        tone_map : str or DisplayMap
            For display formats: a tone curve, or a view of OpenColorIO (`clrender.display_view`).
        exposure : float
            In stops, for display formats. It is added to the exposure of the camera's f-stop, shutter and iso, if set.
        exr_type, exr_compression : str
            For `.exr`: `type` and `compression` of `clrender.image.exr_write.ExrFormat`.
        exr_tile : int, optional
            For `.exr`: `tile` of the same class, pixels.

        Raises
        ------
        UsageError
            When the suffix or the tone map is unknown, or the compression of an `.exr` would lose the ids of mattes.
        RenderError
            When the file cannot be written; no partial file is left.
        """
        path = checked_path(path, "path")
        if not isinstance(exposure, Real):
            raise UsageError(f"exposure is {exposure!r}, but must be a number of stops")
        exposure = float(exposure)
        exr = ExrFormat(exr_type, exr_compression, exr_tile)
        if path.suffix.lower() == ".film":
            told = {name: value for name, value in self.stats.items() if not name.startswith("denois")}
            self.film.save(path, {**told, "denoised": False})
        elif path.suffix.lower() == ".exr":
            check_mattes(self.aovs, exr)
            exact, attributes = exact_channels(self.aovs), matte_attributes(self.mattes)
            more = group_channels(self.light_groups) | amodal_channels(self.amodal) | band_channels(self.spectrum)
            exact, channels = exact | more.keys(), exr_channels(self.aovs) | more
            stored = {"exr_type": exr_type, "exr_compression": exr_compression, "exr_tile": exr_tile}
            told = {**self.stats, "stored": stored}
            write_image(path, self.picture, told, channels=channels, exr=exr, exact=exact, attributes=attributes)
        else:
            exposure += self.camera_stops
            told = {**self.stats, "stored": record_of(tone_map, exposure)}
            write_image(path, self.picture, told, tone_map, exposure, alpha=self.alpha)

    def _repr_html_(self) -> str:
        from clrender.rendering.image_html import image_html

        return image_html(self)

    def _repr_png_(self) -> bytes:
        from clrender.rendering.image_html import IMAGE_SIDE, shrunk

        return png_bytes(shrunk(self.picture, IMAGE_SIDE), exposure=self.camera_stops)


def check_mattes(layers: Iterable[str], exr: ExrFormat) -> None:
    """Check that an `.exr` file keeps the ids of mattes and the numbers of labels, if there are any.

    Raises
    ------
    UsageError
        When there are mattes or labels and the compression is lossy.
    """
    matte = next((name for name in layers if name in MATTES or name in LABELS), None)
    if matte is not None and exr.lossy:
        raise UsageError(
            f"exr_compression is {exr.compression!r}, which changes numbers, and those of {matte} have to stay as "
            "they are; choose another, such as zip"
        )


class IncompleteRender(RenderError):
    """Every device failed before the render was done; the finished samples are kept.

    Attributes
    ----------
    image : RenderedImage
        Image of the finished samples.
    """

    def __init__(self, message: str, image: RenderedImage) -> None:
        super().__init__(message)
        self.image = image
