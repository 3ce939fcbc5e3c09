"""A compilation in another process: what it is told, and what is known of it. Only data, independent of devices."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

__all__ = ["Aside", "Compilation"]


@dataclass(frozen=True)
class Compilation:
    """A program that is to be compiled in another process, so that the driver's cache has it. All are JSON values.

    Attributes
    ----------
    entry : str
        File below the kernels folder.
    macros : dict
    kernels : list of str
        Its kernels that trace.
    group : int
        Work-items of a group, for which drivers compile.
    records : bool
        Whether the kernels share records of samples.
    """

    entry: str
    macros: dict[str, int | str]
    kernels: list[str]
    group: int
    records: bool


class Aside(Protocol):
    """A compilation in another process."""

    @property
    def ended(self) -> bool:
        """Whether it has ended, in any way."""
