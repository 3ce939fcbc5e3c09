"""The user's choices in a scene file: moment of the animation, and material variant."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

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
    shutter : (float, float) or None
        When the camera's shutter opens and closes, seconds from that moment; None: the image is of the moment itself.
    define : mapping of str to str
        Values of its parameters by name; for others it has defaults.
    """

    time_at: float | None = None
    variant: str | None = None
    define: Mapping[str, str] = field(default_factory=dict)
    shutter: tuple[float, float] | None = None
