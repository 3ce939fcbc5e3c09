"""Denoises an image with Open Image Denoise, guided by albedo and normal. It needs the extra `denoise`."""

from __future__ import annotations

import importlib
from collections.abc import Mapping
from importlib.util import find_spec
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from clrender.errors import RenderError, UsageError
from clrender.extras import install_command, missing_extra

__all__ = ["Denoiser", "check_denoiser"]

_Image = npt.NDArray[np.float32]

_DIM: Final = -10
"""Binary exponent of the median radiance below which an image is brightened for the library, which takes what is below
1e-8 for black when it chooses an exposure."""
_BRIGHTEST: Final = 60
"""Binary exponent that no pixel exceeds then."""


def check_denoiser() -> None:
    """Check that the library is installed, without loading it.

    Raises
    ------
    UsageError
    """
    if find_spec("pyoidn") is None:
        raise missing_extra("denoise", "denoising needs Open Image Denoise, which is not installed")


class Denoiser:
    """Open Image Denoise on the CPU (Áfra, openimagedenoise.org; the `pyoidn` package contains its library).

    Its output depends on the library's version and on the CPU, so it is not reproducible bit by bit.

    Attributes
    ----------
    name : str
        Library and version, as reported by the loaded library.

    Raises
    ------
    UsageError
        If the extra is not installed, or its library cannot be loaded.
    """

    def __init__(self) -> None:
        check_denoiser()
        try:
            self._library: Any = importlib.import_module("pyoidn")
        except ImportError as error:
            raise UsageError(
                f"denoising needs Open Image Denoise, which cannot be loaded ({error}); install it anew with "
                f"`{install_command('denoise')} --force-reinstall`"
            ) from None
        try:
            self._device: Any = self._library.Device()
            # Its threads would otherwise be pinned to cores that the renderer's threads use too.
            self._device.set_bool("setAffinity", False)
            self._device.commit()
            problem = self._device.get_error()
        except OSError as error:
            problem = str(error)
        if problem is not None:
            raise UsageError(f"Open Image Denoise does not work on this machine: {problem}; render without denoising")
        number = int(self._device.get_int("version"))
        self.name = f"Open Image Denoise {number // 10000}.{number // 100 % 100}.{number % 100}"

    def __call__(
        self,
        linear: npt.ArrayLike,
        albedo: npt.ArrayLike,
        normal: npt.ArrayLike,
        coverage: npt.ArrayLike | None = None,
    ) -> _Image:
        """Denoise a linear image.

        The guides are first denoised separately, and then treated as noise-free: this preserves edges and textures best
        (documentation of Open Image Denoise 2, "Prefiltering").

        Of an image with coverage the colours are denoised as they are without it, and multiplied by it again, so that
        its edges stay those of the coverage, whose noise they have in common. Beyond the edges the colours and guides
        go on evenly meanwhile. What has no coverage stays as it is.

        Parameters
        ----------
        linear : (H, W, 3) float32
            Radiance, linear Rec. 709.
        albedo : (H, W, 3) float32
            Between 0 and 1.
        normal : (H, W, 3) float32
            Each component between -1 and 1.
        coverage : (H, W) float32, optional
            0 to 1; only for images without a background, which are multiplied by it.

        Returns
        -------
        (H, W, 3) float32

        Raises
        ------
        RenderError
            If the library fails.
        """
        image, guides = _image(linear), {"albedo": _image(albedo), "normal": _image(normal)}
        if coverage is None:
            return self._guided(image, guides)
        share = np.ascontiguousarray(coverage, np.float32)[..., None]
        bare = {name: np.clip(_uncovered(guide, share), -1.0, 1.0) for name, guide in guides.items()}
        denoised = self._guided(_uncovered(image, share), bare)
        return np.where(share > 0.0, denoised * share, image)

    def _guided(self, image: _Image, guides: Mapping[str, _Image]) -> _Image:
        """A denoised image. The library is given one that is neither black nor very dim."""
        sizes = np.abs(image)
        lit = sizes[np.isfinite(sizes) & (sizes > 0.0)]
        if not lit.size:
            return image.copy()
        clean = {name: self._run({name: guide}, {}) for name, guide in guides.items()}
        stops = -int(np.frexp(np.median(lit))[1])
        stops = min(stops, _BRIGHTEST - int(np.frexp(lit.max())[1])) if stops > -_DIM else 0
        denoised = self._run({"color": np.ldexp(image, max(stops, 0)), **clean}, {"hdr": True, "cleanAux": True})
        return np.ldexp(denoised, -max(stops, 0))

    def _run(self, images: Mapping[str, _Image], options: Mapping[str, bool]) -> _Image:
        """Run one filter on these images; returns its output."""
        library = self._library
        output = np.zeros_like(next(iter(images.values())))
        run = library.Filter(self._device, library.OIDN_FILTER_TYPE_RT)
        try:
            for name, image in (*images.items(), ("output", output)):
                run.set_image(name, image, library.OIDN_FORMAT_FLOAT3)
            for name, value in options.items():
                run.set_bool(name, value)
            run.commit()
            run.execute()
            problem = self._device.get_error()
        finally:
            run.release()
        if problem is not None:
            raise RenderError(f"Open Image Denoise failed: {problem}")
        return output

    def release(self) -> None:
        """Release the library's memory; the denoiser must not be used afterwards."""
        self._device.release()


def _uncovered(image: _Image, coverage: _Image) -> _Image:
    """An image divided by its coverage, (H, W, 1); pixels without any are even continuations of those around.

    They are the means of pixels in squares, the smallest of 2, 4, 8, … a side that have one with coverage (Gortler,
    Grzeszczuk, Szeliski and Cohen 1996, "The Lumigraph", section 3.4: pull and push).
    """
    has = coverage > 0.0
    bare = np.divide(image, coverage, out=np.zeros_like(image), where=has)
    sums, weights = bare, has.astype(np.float32)
    finer: list[tuple[_Image, _Image]] = []
    while max(weights.shape) > 1 and not weights.all():
        finer.append((sums, weights))
        sums, weights = _halved(sums), _halved(weights)
    values = np.divide(sums, weights, out=np.zeros_like(sums), where=weights > 0.0)
    for sums, weights in reversed(finer):
        height, width = weights.shape[:2]
        coarse = values.repeat(2, axis=0).repeat(2, axis=1)[:height, :width]
        values = np.divide(sums, weights, out=np.ascontiguousarray(coarse), where=weights > 0.0)
    return np.ascontiguousarray(values)


def _halved(sums: _Image) -> _Image:
    """Sums over two by two pixels."""
    height, width, channels = sums.shape
    even = np.pad(sums, ((0, height % 2), (0, width % 2), (0, 0)))
    total: _Image = even.reshape((height + 1) // 2, 2, (width + 1) // 2, 2, channels).sum(axis=(1, 3))
    return total


def _image(array: npt.ArrayLike) -> _Image:
    return np.ascontiguousarray(array, np.float32)
