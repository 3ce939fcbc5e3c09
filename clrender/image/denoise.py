"""Denoises an image with Open Image Denoise, guided by albedo and normal. It needs the extra `denoise`."""

from __future__ import annotations

import importlib
from collections.abc import Mapping
from importlib.util import find_spec
from typing import Any

import numpy as np
import numpy.typing as npt

from clrender.errors import RenderError, UsageError
from clrender.extras import install_command, missing_extra

__all__ = ["Denoiser", "check_denoiser"]

_Image = npt.NDArray[np.float32]


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

    def __call__(self, linear: npt.ArrayLike, albedo: npt.ArrayLike, normal: npt.ArrayLike) -> _Image:
        """Denoise a linear image.

        The guides are first denoised separately, and then treated as noise-free: this preserves edges and textures best
        (documentation of Open Image Denoise 2, "Prefiltering").

        Parameters
        ----------
        linear : (H, W, 3) float32
            Radiance, linear Rec. 709.
        albedo : (H, W, 3) float32
            Between 0 and 1.
        normal : (H, W, 3) float32
            Each component between -1 and 1.

        Returns
        -------
        (H, W, 3) float32

        Raises
        ------
        RenderError
            If the library fails.
        """
        guides = {"albedo": _image(albedo), "normal": _image(normal)}
        clean = {name: self._run({name: guide}, {}) for name, guide in guides.items()}
        return self._run({"color": _image(linear), **clean}, {"hdr": True, "cleanAux": True})

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


def _image(array: npt.ArrayLike) -> _Image:
    return np.ascontiguousarray(array, np.float32)
