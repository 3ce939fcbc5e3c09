"""Named things of a pbrt scene, which may be used before the file defines them."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterator
from typing import Generic, TypeVar

__all__ = ["Definitions"]

_K = TypeVar("_K", bound=Hashable)
_T = TypeVar("_T")


class _Late(Generic[_T]):
    """What is made once, when it is first asked for."""

    def __init__(self, make: Callable[[], _T]) -> None:
        self._make: Callable[[], _T] | None = make
        self._made: list[_T] = []

    @property
    def busy(self) -> bool:
        """Whether it is being made, so that it cannot be part of itself."""
        return self._make is None and not self._made

    def __call__(self) -> _T:
        if self._make is not None:
            make, self._make = self._make, None
            self._made.append(make())
        return self._made[0]


class Definitions(Generic[_K, _T]):
    """Things by name: the last one that is defined before its use, or else the first one after it."""

    def __init__(self) -> None:
        self._held: dict[_K, _Late[_T]] = {}

    def define(self, name: _K, make: Callable[[], _T]) -> Callable[[], None]:
        """Define something.

        Parameters
        ----------
        name : hashable
        make : callable
            Makes it.

        Returns
        -------
        callable
            To be called at the end of the file, in the order of its directives: makes the thing, unless something
            before it needed it already. What is called after it finds this one by the name.
        """
        late = _Late(make)
        self._held.setdefault(name, late)

        def come() -> None:
            self._held[name] = late
            late()

        return come

    def __contains__(self, name: _K) -> bool:
        return name in self._held and not self._held[name].busy

    def __getitem__(self, name: _K) -> _T:
        return self._held[name]()

    def __iter__(self) -> Iterator[_K]:
        return iter(self._held)
