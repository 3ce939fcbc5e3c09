"""What a sample without faults implies for the whole: the hypergeometric distribution."""

from __future__ import annotations

from abc import ABC, abstractmethod

__all__ = ["SampledCheck", "detection_probability", "least_detected"]


class SampledCheck(ABC):
    """What was found in a sample of parts, and what that says of the others."""

    checked: int
    """Number of parts that were drawn at random."""
    faults: tuple[str, ...]
    """Sentences about what is wrong."""

    @property
    @abstractmethod
    def parts(self) -> int:
        """Number of all parts."""

    @property
    def sound(self) -> bool:
        """Whether nothing was found to be wrong."""
        return not self.faults

    def detection(self, wrong: int) -> float:
        """Probability that a fault would have been found if this many parts were wrong.

        Parameters
        ----------
        wrong : int

        Returns
        -------
        float
        """
        return detection_probability(self.parts, self.checked, wrong)

    def detected(self, confidence: float = 0.95) -> int:
        """The smallest number of wrong parts of which one would have been found with this probability.

        Parameters
        ----------
        confidence : float
            The probability.

        Returns
        -------
        int
        """
        return least_detected(self.parts, self.checked, confidence)


def detection_probability(total: int, checked: int, wrong: int) -> float:
    """Probability that at least one wrong part is among those checked.

    Parameters
    ----------
    total : int
        Number of parts.
    checked : int
        Number of parts drawn at random, without replacement.
    wrong : int
        Number of wrong parts.

    Returns
    -------
    float
        1 - C(total - wrong, checked) / C(total, checked).
    """
    if wrong <= 0 or checked <= 0:
        return 0.0
    if wrong > total - checked:
        return 1.0
    missed = 1.0
    # Probability that each wrong part in turn is not checked; the formula is symmetric in both numbers
    for number in range(min(wrong, checked)):
        missed *= (total - max(wrong, checked) - number) / (total - number)
    return 1.0 - missed


def least_detected(total: int, checked: int, confidence: float) -> int:
    """The smallest number of wrong parts of which one is found with probability of at least `confidence`.

    Parameters
    ----------
    total, checked : int
        See `detection_probability`; at least one is checked.
    confidence : float
        Below 1.
    """
    low, high = 0, total
    while high - low > 1:
        middle = (low + high) // 2
        if detection_probability(total, checked, middle) >= confidence:
            high = middle
        else:
            low = middle
    return high
