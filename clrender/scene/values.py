"""The numbers a scene file may hold, with their bounds, and the base of all its tables."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Annotated, Any, Final, TypeAlias

from pydantic import BaseModel, ConfigDict, Field, Strict, StringConstraints, ValidationError
from pydantic_core import PydanticCustomError

__all__ = [
    "COORDINATE_LIMIT",
    "INLINE_LIMIT",
    "PIXEL_LIMIT",
    "POWER_LIMIT",
    "SHAPE_LIMIT",
    "Absorption",
    "Color",
    "Count",
    "Finite",
    "Flag",
    "Index",
    "Length",
    "Lengths",
    "Matrix",
    "Name",
    "Part",
    "Reflectance",
    "Vector",
    "cross",
    "fault",
    "length",
]

COORDINATE_LIMIT: Final = 1e12
"""Largest magnitude of a coordinate, metres: its cube, which a triangle's distance needs, fits single precision."""
POWER_LIMIT: Final = 1e12
"""Largest magnitude of a radiometric quantity: seen directly, it is a sample that the film takes (below 2^43)."""
PIXEL_LIMIT: Final = 2**30
SHAPE_LIMIT: Final = 2**20
"""Most shapes, and most lights, of one scene."""
INLINE_LIMIT: Final = 2**22
"""Most vertices or faces of a mesh written into the scene file itself; larger ones belong in a mesh file."""

Finite = Annotated[float, Strict(), Field(allow_inf_nan=False)]
Coordinate = Annotated[Finite, Field(ge=-COORDINATE_LIMIT, le=COORDINATE_LIMIT)]
Length = Annotated[Finite, Field(gt=0.0, le=COORDINATE_LIMIT)]
Power = Annotated[Finite, Field(ge=0.0, le=POWER_LIMIT)]
Share = Annotated[Finite, Field(ge=0.0, le=1.0)]
Index = Annotated[Finite, Field(gt=0.0, le=1000.0)]
Count = Annotated[int, Strict()]
Name = Annotated[str, StringConstraints(strict=True, min_length=1, max_length=200)]
Flag = Annotated[bool, Strict()]
Vector: TypeAlias = tuple[Coordinate, Coordinate, Coordinate]
Lengths: TypeAlias = tuple[Length, Length, Length]
Color: TypeAlias = tuple[Power, Power, Power]
Reflectance: TypeAlias = tuple[Share, Share, Share]
Absorption: TypeAlias = Annotated[Finite, Field(ge=0.0, lt=1.0)] | None
_Row: TypeAlias = tuple[Finite, Finite, Finite, Finite]
Matrix: TypeAlias = tuple[_Row, _Row, _Row, _Row]


if TYPE_CHECKING:
    from pydantic._internal._model_construction import ModelMetaclass as _Metaclass
else:
    _Metaclass = type(BaseModel)  # it has no public name


class _Table(_Metaclass):
    """Makes a table built in code fail like a table read from a file: with a `SceneError` of one sentence."""

    def __call__(cls: Any, *args: Any, **keys: Any) -> Any:
        try:
            return type(BaseModel).__call__(cls, *args, **keys)
        except ValidationError as error:
            from clrender.scene.validation_errors import (
                scene_error,  # problems.py words errors of all tables, so imports them
            )

            raise scene_error(error, cls, cls.__name__) from None


class Part(BaseModel, metaclass=_Table):
    """Base of every table of a scene file: frozen, unknown keys forbidden."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


def fault(kind: str, message: str, *place: str | int) -> PydanticCustomError:
    """A validation error worded here: the message goes on from the name of its `place` below the table at hand."""
    return PydanticCustomError(kind, "{sentence}", {"sentence": message, "below": place})


def length(vector: Vector) -> float:
    """Euclidean length, without overflow or underflow in between."""
    largest = max(abs(x) for x in vector)
    if largest == 0.0:
        return 0.0
    x, y, z = (component / largest for component in vector)
    return largest * math.sqrt(x * x + y * y + z * z)


def cross(a: Vector, b: Vector) -> Vector:
    """Cross product."""
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])
