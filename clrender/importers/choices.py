"""The user's choices in a scene file: moment of the animation, and material variant."""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["Choices"]


@dataclass(frozen=True)
class Choices:
    """Choices among what a scene file offers.

    Attributes
    ----------
    time_at : float or None
        Moment of its animation, seconds; None: the rest pose.
    variant : str or None
        Name of a material variant; None: the default materials.
    """

    time_at: float | None = None
    variant: str | None = None
