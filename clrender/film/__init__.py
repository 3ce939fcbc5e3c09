"""Film: exact sums of samples, the ledger of the samples they contain, and the film file format."""

from __future__ import annotations

from clrender.film.film import Film

__all__ = ["Film"]
