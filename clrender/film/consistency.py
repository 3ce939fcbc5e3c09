"""What the arrays of a film must have in common, whatever its image is."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from clrender.errors import UsageError
from clrender.film.unit import BLOCK, blocks_across

if TYPE_CHECKING:
    from pathlib import Path

    from clrender.film.film import Film

__all__ = ["check_consistency", "contradictions"]


def check_consistency(film: Film, path: str | Path) -> None:
    """Refuse a film whose arrays contradict each other, before it is added to.

    Raises
    ------
    UsageError
        The message names the file.
    """
    if found := contradictions(film):
        raise UsageError(f"{path}: is not a sound film: {found[0]}; render it again")


def contradictions(film: Film) -> list[str]:
    """Sentences about arrays of a film that contradict each other; empty if none do.

    A pixel without samples has no sums. Samples that the ledger has and the counts lack were not finite, and the film
    says how many were not. R replicates with the sums x have R Σx² >= (Σx)² (Cauchy and Schwarz).

    Parameters
    ----------
    film : Film
        Loaded from a file.
    """
    found = []
    dark = film.counts == 0
    every = [*zip(_tops(film), film.bands(), strict=True), *zip(_tops(film), film.square_bands(), strict=False)]
    if any(band[dark[top : top + len(band)]].any() for top, band in every):
        found.append("pixels without samples have nonzero sums")
    lacking, discarded = film.ledger.samples - film.samples, film.provenance.get("nonfinite_samples")
    if isinstance(discarded, int) and lacking > discarded:
        said = f"{discarded} discarded samples" if discarded else "no discarded samples"
        found.append(f"it has fewer samples than its ledger records, although it reports {said}")
    if film.replicate_spp and any(not _possible(film, top, index) for index, top in enumerate(_tops(film))):
        found.append("its squares are smaller than its sums allow")
    return found


def _tops(film: Film) -> range:
    return range(0, film.height, film.band_rows)


def _possible(film: Film, top: int, index: int) -> bool:
    """Whether the squares of a band of rows are not too small, up to rounding."""
    words, of_squares = film.bands()[index], film.square_bands()[index]
    sums: npt.NDArray[np.float64] = words[..., 1].view(np.int64) + words[..., 0] * 2.0**-64
    large, small = of_squares[..., 2:] * [1.0, 2.0**64], of_squares[..., :2] * [2.0**-128, 2.0**-64]
    squares: npt.NDArray[np.float64] = large[..., 1] + large[..., 0] + small[..., 1] + small[..., 0]
    rows = np.arange(top, top + len(sums)) // BLOCK
    taken = film.ledger.taken().reshape(-1, blocks_across(film.width))[rows][:, np.arange(film.width) // BLOCK]
    replicates = taken[..., None] // (film.replicate_spp or 1)
    return bool((replicates * squares * (1.0 + 1e-9) + 1e-20 >= sums * sums).all())
