"""What a file claims about its image, and the bits that a render must therefore produce."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from clrender.errors import UsageError
from clrender.film import Film
from clrender.film.consistency import contradictions
from clrender.film.ledger import Ledger
from clrender.film.request import film_size
from clrender.image.exr_write import COMPRESSIONS, half_of
from clrender.image.files import (
    DISPLAY_ENDINGS,
    FILM_ENDINGS,
    image_sha256,
    read_alpha,
    read_coverage,
    read_image,
    read_provenance,
    uncovered,
)
from clrender.image.tone_map import EXPOSURE_LIMIT, TONE_MAPS, srgb_decode, to_display

__all__ = ["Claim", "FilmClaim", "ImageClaim", "claim_of"]

_HASHES: Final = ("scene_sha256", "kernel_sha256", "version")
_FIELD: Final = "guiding_field_sha256"
"""Only of images that were guided by a field from a file."""
_PLUGINS: Final = "plugins"
"""Only of images whose scenes use plugins: hashes by name."""
_NAMED_TWICE: Final = ("width", "height", "seed", "integrator", *_HASHES)
_Mask = npt.NDArray[np.bool_]


class Claim(ABC):
    """A file's claim about its image.

    Attributes
    ----------
    request : dict
        How the image was made, as far as recorded; see `clrender.rendering.job.RenderJob.request`.
    ledger : Ledger
        The samples that it contains.
    provenance : mapping
    faults : list of str
        Its contradictions, a sentence each.
    has_alpha : bool
        Whether it has coverage beside its colours, which `compare` then needs.
    beside : str
        What differs where the means of its pixels do not.
    """

    has_alpha = False
    beside = "squares, on which error estimates rest, and not in the image"

    def __init__(self, request: Mapping[str, Any], ledger: Ledger, provenance: Mapping[str, Any]) -> None:
        self.request = dict(request)
        self.ledger = ledger
        self.provenance = provenance
        self.faults: list[str] = []
        said = {name: provenance[name] for name in _NAMED_TWICE if name in provenance}
        settings = provenance.get("settings", {})
        if crop := self.request.get("crop"):
            # Statistics have the size of the crop, requests that of the whole image
            for name, size in zip(("width", "height"), crop[2:], strict=True):
                if said.pop(name, size) != size:
                    self.faults.append(f"it contains contradictory values of {name}: {size} and {provenance[name]}")
        for name, value in self.request.items():
            for other in (said.get(name, value), settings.get(name, value)):
                if other != value:
                    self.faults.append(f"it contains contradictory values of {name}: {value} and {other}")
                    break

    @property
    def samples_end(self) -> int:
        """The first sample number after all that it contains."""
        sets, numbers = self.ledger.sets_of(np.arange(len(self.ledger.taken())))
        return max((sets[number][-1][1] for number in np.unique(numbers).tolist() if sets[number]), default=0)

    @abstractmethod
    def compare(
        self, film: Film, rows: slice, columns: slice, alpha: npt.NDArray[np.float32] | None = None
    ) -> tuple[_Mask, npt.NDArray[np.float64]]:
        """Compare a rectangle with a new render.

        Parameters
        ----------
        film : Film
            Contains the same samples of these pixels.
        rows, columns : slice
        alpha : (H, W) float32, optional
            Coverage of the whole image, rendered again; without it that of the file counts.

        Returns
        -------
        differs : (h, w) bool
            Pixels whose bits differ.
        pair : (2, h, w, 3) float64
            Pixels of the file and of the film, to measure their difference.
        """


class FilmClaim(Claim):
    """Claim of a `.film`: exact sums, and the ledger of their samples."""

    def __init__(self, path: Path) -> None:
        self._film = Film.load(path)
        super().__init__(self._film.request, self._film.ledger, self._film.provenance)
        self._mean = self._film.mean()
        said = self.provenance.get("image_sha256")
        if said is not None and said != image_sha256(self._mean):
            self.faults.append("the hash of the pixels does not match its image_sha256")
        self.faults += contradictions(self._film)

    def compare(
        self, film: Film, rows: slice, columns: slice, alpha: npt.NDArray[np.float32] | None = None
    ) -> tuple[_Mask, npt.NDArray[np.float64]]:
        differs = self._film.counts[rows, columns] != film.counts[rows, columns]
        for row in range(rows.start, rows.stop):
            band, inside = divmod(row, film.band_rows)
            pairs = [(self._film.bands(), film.bands()), (self._film.square_bands(), film.square_bands())]
            for there, here in pairs[: 2 if self._film.replicate_spp else 1]:
                unequal = there[band][inside, columns] != here[band][inside, columns]
                differs[row - rows.start] |= unequal.any(axis=(1, 2))
        pair = np.stack([self._mean[rows, columns], film.mean_of(rows, columns)]).astype(np.float64)
        return differs, pair


def _of_data_set(path: Path) -> str:
    """What to do with a file that is one of a data set's; empty if it is none."""
    folder = next((each for each in list(path.absolute().parents)[:3] if (each / "manifest.json").is_file()), None)
    return "" if folder is None else f"it belongs to a data set, which `clrender verify {folder}` checks"


class ImageClaim(Claim):
    """Claim of an `.exr` or `.png` with its settings: pixels that have all samples of a render."""

    beside = "coverage, and not in their colours"

    def __init__(self, path: Path, provenance: Mapping[str, Any]) -> None:
        missing = [key for key in ("settings", "first_sample", "sample_count", *_HASHES) if key not in provenance]
        if missing == ["first_sample", "sample_count"] and provenance.get("merged_films"):
            raise UsageError(
                f"{path}: was merged from films between which parts are missing, so its pixels do not have the same "
                "samples from a first to a last one, and only a .film records those of each pixel; verify its .film, "
                "or merge all parts"
            )
        if missing:
            cure = _of_data_set(path) or "render it again"
            raise UsageError(f"{path}: does not contain its settings ({missing[0]} is missing); {cure}")
        self._image = read_image(path)
        height, width = self._image.shape[:2]
        settings = {name: value for name, value in provenance["settings"].items() if name != "spp"}
        if film_size({"width": None, "height": None, **settings}) != (width, height):
            raise UsageError(
                f"{path}: has {width} x {height} pixels, but was rendered in another size; verify the original file"
            )
        first, count = provenance["first_sample"], provenance["sample_count"]
        if provenance.get("denoised"):
            raise UsageError(
                f"{path}: is denoised, so it cannot be verified; verify an image or .film rendered without denoising"
            )
        if provenance.get("samples") != width * height * count:
            raise UsageError(
                f"{path}: was stopped early, and only a .film records the samples of each pixel; verify its .film, or "
                "a finished image"
            )
        self._stored = provenance.get("stored", {})
        self._display = path.suffix.lower() in DISPLAY_ENDINGS
        self._alpha: npt.NDArray[Any] | None = read_alpha(path) if self._display else read_coverage(path)
        self.has_alpha = self._alpha is not None
        if self.has_alpha and not isinstance(provenance.get("alpha_samples"), int):
            raise UsageError(f"{path}: does not say of how many samples its alpha is; verify its .film")
        self._check_stored(path)
        ledger = Ledger(width, height)
        blocks = np.arange(len(ledger.taken()))
        ledger.add(blocks, first, np.full(len(blocks), count))
        hashes = {key: provenance[key] for key in (*_HASHES, _FIELD, _PLUGINS) if key in provenance}
        super().__init__({**settings, **hashes}, ledger, provenance)
        if provenance.get("spp") != provenance["settings"].get("spp"):
            self.faults.append(
                f"it contains contradictory values of spp: {provenance.get('spp')} and "
                f"{provenance['settings'].get('spp')}"
            )
        whole = not self._display and self._stored["exr_type"] == "float"
        if whole and provenance.get("image_sha256") != image_sha256(self._image):
            self.faults.append("the hash of the pixels does not match its image_sha256")

    def _check_stored(self, path: Path) -> None:
        """Check that the file stores the render's numbers, or such as follow from them."""
        stored = self._stored
        if self._display and stored.get("tone_map") == "ocio":
            text = "was made by OpenColorIO, whose numbers are not those of another version; verify its .exr or .film"
            raise UsageError(f"{path}: {text}")
        known = stored.get("exr_type", "float") in ("float", "half")
        if self._display:
            known &= stored.get("tone_map") in TONE_MAPS and abs(stored.get("exposure", math.inf)) <= EXPOSURE_LIMIT
        if not known or not (self._display or {"exr_type", "exr_compression"} <= {*stored}):
            raise UsageError(f"{path}: does not record how its pixels were stored; render it again")
        compression = self._stored.get("exr_compression", "none")
        if COMPRESSIONS.get(compression, True):
            raise UsageError(
                f"{path}: the compression {compression} is lossy; verify the .film, or an .exr with lossless "
                "compression"
            )

    def _stored_alpha(self, alpha: npt.NDArray[np.float32]) -> npt.NDArray[Any]:
        """Coverage as the file stores it; one for display may have been made from a file with half precision."""
        stored = half_of(alpha).astype(np.float32) if self._stored.get("exr_type") == "half" else alpha
        return np.rint(stored * np.float32(255.0)).astype(np.uint8) if self._display else stored

    def compare(
        self, film: Film, rows: slice, columns: slice, alpha: npt.NDArray[np.float32] | None = None
    ) -> tuple[_Mask, npt.NDArray[np.float64]]:
        there, here = np.ascontiguousarray(self._image[rows, columns]), film.mean_of(rows, columns)
        if self._stored.get("exr_type") == "half":
            here = half_of(here).astype(np.float32)
        covered = None if alpha is None else self._stored_alpha(alpha[rows, columns])
        if self._display:
            if self._alpha is not None:
                here = uncovered(here, self._alpha[rows, columns] if covered is None else covered)
            shown = to_display(here, self._stored["tone_map"], self._stored["exposure"])
            here = srgb_decode(np.arange(256) / 255).astype(np.float32)[shown]
        differs: _Mask = (there.view(np.uint32) != np.ascontiguousarray(here).view(np.uint32)).any(axis=2)
        if self._alpha is not None and covered is not None:
            differs |= self._alpha[rows, columns] != covered
        return differs, np.stack([there, here]).astype(np.float64)


def claim_of(path: Path) -> Claim:
    """The claim of a file.

    Raises
    ------
    UsageError
        It cannot be read, does not record how it was made, or its pixels were changed after the render.
    """
    ending = path.suffix.lower()
    if ending not in (*FILM_ENDINGS, ".exr", ".png"):
        if not path.exists():
            raise UsageError(f"{path}: does not exist; check its name and folder")
        raise UsageError(f"{path}: only .film, .exr and .png files contain their settings; verify one of those")
    provenance = None if ending in FILM_ENDINGS else read_provenance(path)
    if provenance is None and ending not in FILM_ENDINGS:
        raise UsageError(
            f"{path}: does not contain its settings, so it cannot be verified; "
            f"{_of_data_set(path) or 'give a file written by clrender'}"
        )
    try:
        return FilmClaim(path) if provenance is None else ImageClaim(path, provenance)
    except (AttributeError, KeyError, TypeError, ValueError, OverflowError) as error:
        raise UsageError(f"{path}: its settings are invalid ({error}); render it again") from None
