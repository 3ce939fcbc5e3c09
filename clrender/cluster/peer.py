"""A worker of a cluster, as its scheduler lists it."""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["Peer"]


@dataclass(frozen=True)
class Peer:
    """A worker as listed by the scheduler.

    Attributes
    ----------
    key : str
        Identifier that stays the same when its nanny restarts it.
    address : str
        Address of its process.
    name, host : str
    """

    key: str
    address: str
    name: str
    host: str

    @property
    def title(self) -> str:
        """Name in messages."""
        return f"worker {self.name}" if self.host in self.name else f"worker {self.name} on {self.host}"
