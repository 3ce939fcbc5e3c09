"""Values that depend on a scene's contents alone, computed once for all copies of the scene that share them."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

__all__ = ["ContentsMemo"]

_T = TypeVar("_T")


class ContentsMemo:
    """What has been computed from these contents.

    Copies and pickles are empty: they may go where the contents are others, and values may be large.

    Parameters
    ----------
    contents : tuple of object
        All that the values depend on. Contents are the same if all objects are the very same ones.
    """

    def __init__(self, contents: tuple[object, ...] = ()) -> None:
        self._contents = contents
        self._values: dict[str, Any] = {}

    def __reduce__(self) -> tuple[type[ContentsMemo], tuple[()]]:
        return ContentsMemo, ()

    def holds(self, contents: tuple[object, ...]) -> bool:
        """Whether the values belong to these contents."""
        same = len(contents) == len(self._contents)
        return same and all(a is b for a, b in zip(contents, self._contents, strict=True))

    def value(self, name: str, compute: Callable[[], _T]) -> _T:
        """The value of this name, computed if it is asked for the first time.

        Parameters
        ----------
        name : str
        compute : callable
            Returns the value. If it raises an error, nothing is kept.

        Returns
        -------
        object
            As `compute` returns it.
        """
        if name not in self._values:
            self._values[name] = compute()
        found: _T = self._values[name]
        return found
