"""Tests whether integrators agree, tile by tile over batches of images, and whether two films agree, pixel by pixel."""

from clrender.agreement.batches import Batches, Pair
from clrender.agreement.films import compare_films
from clrender.agreement.integrators import check_integrators, compare_integrators
from clrender.agreement.verdict import Verdict

__all__ = ["Batches", "Pair", "Verdict", "check_integrators", "compare_films", "compare_integrators"]
