"""Bands of the spectrum as channels of files."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from clrender.spectra.kernel_table import band_edges

__all__ = ["band_channels"]


def band_channels(spectrum: npt.NDArray[np.float32] | None) -> dict[str, npt.NDArray[np.float32]]:
    """Bands as channels of an EXR file, by their middles: ``S0.380,500000nm``, …

    The names are those of Fichet, Pacanowski and Wilkie, "A spectral image format based on OpenEXR", JCGT 10(3), 2021.

    Parameters
    ----------
    spectrum : (H, W, bands) float32 or None

    Returns
    -------
    dict of str to (H, W) float32
    """
    if spectrum is None:
        return {}
    edges = band_edges(spectrum.shape[2])
    middles = (edges[1:] + edges[:-1]) / 2.0
    names = [f"S0.{middle:.6f}nm".replace(".", ",").replace("S0,", "S0.") for middle in middles.tolist()]
    return {name: np.ascontiguousarray(spectrum[..., band]) for band, name in enumerate(names)}
