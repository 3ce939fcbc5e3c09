"""Keys that tables of scene files had by another name in earlier versions: they are still read.

Such a key is a field with a validation alias, of which the first choice is its present name; `former_keys` tells them.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from typing import Any, TypeVar

from pydantic import AliasChoices, BaseModel

from clrender.errors import SceneError
from clrender.limits import given_too
from clrender.wording import place

__all__ = ["former_keys", "present_keys"]

_T = TypeVar("_T")


@cache
def former_keys(table: type[BaseModel]) -> Mapping[str, str]:
    """Former names of a table's keys, and the present ones."""
    found: dict[str, str] = {}
    for name, field in table.model_fields.items():
        if isinstance(field.validation_alias, AliasChoices):
            found |= {str(each): name for each in field.validation_alias.choices if each != name}
    return found


def present_keys(
    table: type[BaseModel], given: Mapping[Any, _T], source: str, at: tuple[str | int, ...] = ()
) -> dict[Any, _T]:
    """Entries of a table by the present names of its keys.

    Parameters
    ----------
    table : type
    given : mapping
        By present or former names; other names are not changed.
    source : str
        Name of the scene in messages.
    at : tuple of str or int
        Place of the table.

    Raises
    ------
    SceneError
        A key is given by both of its names.
    """
    former = former_keys(table)
    for old, name in former.items():
        if old in given and name in given:
            raise SceneError(f"{source}: {place((*at, old))} {given_too(name)}")
    return {former.get(key, key): value for key, value in given.items()}
