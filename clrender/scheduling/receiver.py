"""Where units go when they are done."""

from __future__ import annotations

from typing import Protocol, runtime_checkable

from clrender.film import Film
from clrender.film.unit import Unit, UnitSums

__all__ = ["Receiver", "Reversible"]


class Receiver(Protocol):
    """Where units go when they are done: a film, or whatever adds them up in another way."""

    def commit(self, unit: Unit, result: UnitSums) -> int:
        """Take in what was done of a unit; gives its samples, over all pixels of the image."""


@runtime_checkable
class Reversible(Receiver, Protocol):
    """One from which it can be taken out again: a film, or the checkpoint of one."""

    @property
    def width(self) -> int:
        """Of the image, pixels."""

    @property
    def height(self) -> int:
        """Of the image, pixels."""

    def take_out(self, other: Film) -> None:
        """Subtract a film whose samples were committed."""
