"""Arrays of a flat scene whose kernels render wavelengths: spectra in the place of some of its numbers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from clrender import layout
from clrender.spectra.kernel_table import kernel_table
from clrender.spectra.lifting import reflectance_spectra, unbounded_spectra

__all__ = ["SpectralPlace", "disperses", "spectral_arrays"]

_COLUMNS: Final = layout.columns("MEDIUM")


@dataclass(frozen=True)
class SpectralPlace:
    """Numbers of an array that a spectrum says.

    Attributes
    ----------
    array : str
        As `clrender.flatten.flat_scene.FlatScene` has it.
    rows : int or slice
    column : int or str
        Of the first of its numbers, or the name of a member.
    count : int
        3: a colour; 1: an index of refraction.
    values : (95,) float64
        The spectrum, at the lines of tables of spectra.
    """

    array: str
    rows: int | slice
    column: int | str
    count: int
    values: NDArray[np.float64]


class _Given:
    """The spectra of a scene, each once, and the numbers that stand for them in arrays (kernels/spectral/color.h)."""

    def __init__(self) -> None:
        self._numbers: dict[bytes, int] = {}

    def mark(self, values: NDArray[np.float64]) -> float:
        """The number that stands for a spectrum: -1, -2, ..."""
        spectrum = values.astype(np.float32).tobytes()
        return -1.0 - self._numbers.setdefault(spectrum, len(self._numbers))

    def table(self) -> NDArray[np.float32]:
        """All of them, one after the other, and one of zeros."""
        none = np.zeros(layout.SPECTRA_LINES, np.float32)
        return np.concatenate([*(np.frombuffer(each, np.float32) for each in self._numbers), none])


def disperses(places: Sequence[SpectralPlace]) -> bool:
    """Whether any index of refraction depends on the wavelength."""
    return any(place.count == 1 for place in places)


def spectral_arrays(
    arrays: Mapping[str, NDArray[Any]],
    places: Sequence[SpectralPlace] = (),
    bands: tuple[int, int] | None = None,
    film: NDArray[np.float64] | None = None,
) -> dict[str, NDArray[Any]]:
    """Arrays that kernels read in place of those of the same names, or beside them.

    Parameters
    ----------
    arrays : mapping of str to ndarray
        Those of a `clrender.flatten.flat_scene.FlatScene`.
    places : sequence of SpectralPlace
        Its `spectral`.
    bands : (int, int), optional
    film : (95, 4) float64, optional
        See `clrender.spectra.kernel_table.kernel_table`.

    Returns
    -------
    dict of str to ndarray
    """
    given = _Given()
    changed: dict[str, NDArray[Any]] = {"media_rows": _media(arrays["media_rows"], given)}
    for place in places:
        array = changed.setdefault(place.array, arrays[place.array].copy())
        mark = given.mark(place.values)
        if isinstance(place.column, str):
            member = array[place.column]
            member[place.rows] = mark if place.count == 1 else _color(mark, member[place.rows])
        else:
            at = slice(place.column, place.column + place.count)
            array[place.rows, at] = mark if place.count == 1 else (mark, 1.0, 0.0)
    return {**changed, "spectra": np.concatenate([kernel_table(bands, film), given.table()])}


def _color(mark: float, before: NDArray[np.float32]) -> NDArray[np.float32]:
    """Colours of four numbers, the last of which stays."""
    after = before.copy()
    after[..., :3] = mark, 1.0, 0.0
    return after


def _media(rows: NDArray[np.float32], given: _Given) -> NDArray[np.float32]:
    """Rows of media whose coefficients are spectra: what is scattered is never more than what is met."""
    rows = rows.copy()

    def put(row: NDArray[np.float32], column: str, spectrum: NDArray[np.float64]) -> None:
        row[_COLUMNS[column] : _COLUMNS[column] + 3] = given.mark(spectrum), 1.0, 0.0

    for row in rows:
        sigma, extinction, scattering = (
            row[_COLUMNS[name] : _COLUMNS[name] + 3].astype(np.float64)
            for name in ("SIGMA", "EXTINCTION", "SCATTERING")
        )
        if not _grey(sigma):
            put(row, "SIGMA", unbounded_spectra(sigma))
        if not (_grey(extinction) and _grey(scattering)):
            met = unbounded_spectra(extinction)
            albedo = np.divide(scattering, extinction, out=np.zeros(3), where=extinction > 0.0)
            put(row, "EXTINCTION", met)
            put(row, "SCATTERING", met * reflectance_spectra(albedo))
    return rows


def _grey(color: NDArray[np.float64]) -> bool:
    return bool(color[0] == color[1] == color[2])
