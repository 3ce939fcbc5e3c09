"""What a file leaves open that holds more than one image: which moment, which materials."""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["Choices"]


@dataclass(frozen=True)
class Choices:
    """Of what a scene file offers.

    Attributes
    ----------
    time_at : float or None
        Moment of its animation, seconds; None: as it is at rest.
    variant : str or None
        Name of a variant of its materials; None: those that the file names first.
    """

    time_at: float | None = None
    variant: str | None = None
