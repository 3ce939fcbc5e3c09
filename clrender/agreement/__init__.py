"""Whether integrators agree: images of independent batches, tested tile by tile, with a verdict on each difference."""

from clrender.agreement.batches import Batches, Pair
from clrender.agreement.integrators import check_integrators, compare_integrators
from clrender.agreement.verdict import Verdict

__all__ = ["Batches", "Pair", "Verdict", "check_integrators", "compare_integrators"]
