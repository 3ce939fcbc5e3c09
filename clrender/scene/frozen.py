"""What makes scenes immutable: mappings and arrays that cannot be assigned to."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import is_dataclass, replace
from typing import Any, Final, NoReturn, TypeVar

import numpy as np
from numpy.typing import NDArray

from clrender.errors import SceneError

__all__ = ["FrozenDict", "frozen", "frozen_array", "refuse_change"]

_Key = TypeVar("_Key")
_Value = TypeVar("_Value")
_CURE: Final = 'make another scene instead, as scene.changed({"camera.vertical_fov": 30.0, "materials.old": None})'


def refuse_change(what: str) -> NoReturn:
    """Raise the error of an assignment to a part of a scene.

    Raises
    ------
    SceneError
    """
    raise SceneError(f"{what} cannot be assigned to, because scenes never change; {_CURE}")


class FrozenDict(dict[_Key, _Value]):
    """A dictionary that cannot be changed; `dict.__setitem__` is for its owner, which may cache contents in it."""

    def _refuse(self, *_values: Any, **_named: Any) -> NoReturn:
        refuse_change("a table of a scene")

    __setitem__ = __delitem__ = __ior__ = clear = pop = popitem = setdefault = update = _refuse

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), (dict(self),)


def frozen_array(array: NDArray[Any], copied: bool = False) -> NDArray[Any]:
    """Make an array read-only, with those that it is a view of.

    Parameters
    ----------
    array : ndarray
    copied : bool
        Return a copy, unless nobody can write to the array any more.
    """
    owners = [array]
    while isinstance(owners[-1].base, np.ndarray):
        owners.append(owners[-1].base)
    # Memory that is not an array's own may change under it, as a mapped file does; only that of bytes never does
    lent = not isinstance(owners[-1].base, bytes | None)
    if copied and (lent or any(owner.flags.writeable for owner in owners)):
        owners = [np.array(array, order="C")]
    for owner in owners:
        owner.flags.writeable = False
    return owners[0]


def frozen(content: Any, copied: bool = False) -> Any:
    """Contents of a file with arrays that are read-only; parameters as of `frozen_array`.

    Parameters
    ----------
    content : MeshData, TransformArray, EnvironmentPicture, IesProfile, or tuple
        Objects with arrays as attributes; of a tuple, its arrays.
    copied : bool
    """
    if isinstance(content, tuple):
        return tuple(frozen_array(each, copied) if isinstance(each, np.ndarray) else each for each in content)
    attributes: Mapping[str, Any] = vars(content) if hasattr(content, "__dict__") else {}
    arrays = {name: value for name, value in attributes.items() if isinstance(value, np.ndarray)}
    read_only = {name: frozen_array(array, copied) for name, array in arrays.items()}
    if all(read_only[name] is array for name, array in arrays.items()):
        return content
    if is_dataclass(content) and not isinstance(content, type):
        return replace(content, **read_only)
    return type(content)(**read_only)
