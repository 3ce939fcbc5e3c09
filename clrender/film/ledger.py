"""The ledger of a film: which units of work its sums hold, so that none is added twice and none is forgotten."""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from collections.abc import Iterator, Mapping
from typing import Any

from clrender.errors import UsageError

__all__ = ["UnitSet"]


class UnitSet:
    """A set of integers, kept as sorted half-open ranges.

    Parameters
    ----------
    cut : mapping, optional
        How a number names a piece of work, JSON-able (tile side, samples to a unit, …). Sets with different
        cuts speak of different pieces and cannot be united.
    """

    def __init__(self, cut: Mapping[str, Any] | None = None) -> None:
        self.cut: dict[str, Any] = dict(cut or {})
        self._starts: list[int] = []
        self._stops: list[int] = []

    def __len__(self) -> int:
        return sum(self._stops) - sum(self._starts)

    def __contains__(self, unit: int) -> bool:
        index = bisect_right(self._starts, unit) - 1
        return index >= 0 and unit < self._stops[index]

    def __eq__(self, other: object) -> bool:
        return isinstance(other, UnitSet) and self.to_json() == other.to_json()

    __hash__ = None  # type: ignore[assignment]  # mutable

    def ranges(self) -> Iterator[tuple[int, int]]:
        """Disjoint ranges (start, stop), ascending, stop not included."""
        return zip(self._starts, self._stops, strict=True)

    def overlap(self, start: int, stop: int) -> tuple[int, int] | None:
        """First range of units from `start` to `stop` (not included) that are already held, or None."""
        index = bisect_right(self._stops, start)
        if start < stop and index < len(self._starts) and self._starts[index] < stop:
            return max(start, self._starts[index]), min(stop, self._stops[index])
        return None

    def add(self, start: int, stop: int | None = None) -> None:
        """Record the units from `start` to `stop` (not included; by default the one unit `start`).

        Raises
        ------
        UsageError
            One of them is held already.
        """
        stop = start + 1 if stop is None else stop
        if start >= stop:
            return
        if held := self.overlap(start, stop):
            raise UsageError(f"units {held[0]} to {held[1] - 1} are in the film already; each may be added once.")
        first = bisect_left(self._stops, start)
        last = first
        if last < len(self._starts) and self._stops[last] == start:
            start = self._starts[last]
            last += 1
        if last < len(self._starts) and self._starts[last] == stop:
            stop = self._stops[last]
            last += 1
        self._starts[first:last] = [start]
        self._stops[first:last] = [stop]

    def update(self, other: UnitSet) -> None:
        """Add all units of another set.

        Raises
        ------
        UsageError
            Another cut, or a unit that both hold. This set is then unchanged.
        """
        if self.cut != other.cut:
            raise UsageError(
                f"the films' work is cut in different ways ({self.cut} and {other.cut}); merge films rendered with "
                "the same tile and samples per pass."
            )
        for start, stop in other.ranges():
            if held := self.overlap(start, stop):
                raise UsageError(
                    f"units {held[0]} to {held[1] - 1} are in both films; merge films that hold different units."
                )
        for start, stop in other.ranges():
            self.add(start, stop)

    def to_json(self) -> dict[str, Any]:
        """JSON-able description, the same for equal sets."""
        return {"cut": self.cut, "done": [list(pair) for pair in self.ranges()]}

    @classmethod
    def from_json(cls, description: Mapping[str, Any]) -> UnitSet:
        """The set that `to_json` described.

        Raises
        ------
        ValueError, TypeError, KeyError
            The description is not one.
        """
        units = cls(description["cut"])
        for start, stop in description["done"]:
            if type(start) is not int or type(stop) is not int or not 0 <= start < stop:
                raise ValueError(f"[{start!r}, {stop!r}] is not a range of units")
            if units._stops and start <= units._stops[-1]:
                raise ValueError(f"the range from {start} is out of order")
            units._starts.append(start)
            units._stops.append(stop)
        return units
