"""Film: exact sums of samples, which samples they hold, and the file that keeps them."""

from __future__ import annotations

from clrender.film.film import Film

__all__ = ["Film"]
