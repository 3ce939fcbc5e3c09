"""Whether integrators agree, by batches of images and tile by tile, and whether two films do, pixel by pixel."""

from clrender.agreement.batches import Batches, Pair
from clrender.agreement.films import compare_films
from clrender.agreement.integrators import check_integrators, compare_integrators
from clrender.agreement.verdict import Verdict

__all__ = ["Batches", "Pair", "Verdict", "check_integrators", "compare_films", "compare_integrators"]
