"""The number types of a scene file, with their bounds, and the base class of its tables."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Final, TypeAlias

from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    Strict,
    StringConstraints,
    ValidationError,
    WithJsonSchema,
)
from pydantic_core import CoreSchema, PydanticCustomError, core_schema

from clrender.errors import SceneError
from clrender.limits import NotAllowed
from clrender.meshes.data import COORDINATE_LIMIT
from clrender.scene.changes import changes_by_place, plain, table_values, validated
from clrender.scene.frozen import FrozenDict, refuse_change
from clrender.scene.validation_errors import scene_error
from clrender.settings import Setting
from clrender.wording import shown

if TYPE_CHECKING:
    from typing_extensions import Self

__all__ = [
    "INLINE_LIMIT",
    "NAME_LIMIT",
    "NUMBER_OR_TRIPLE",
    "POWER_LIMIT",
    "SHAPE_LIMIT",
    "Color",
    "Extinction",
    "FileName",
    "Finite",
    "Flag",
    "Index",
    "LayerName",
    "Length",
    "Lengths",
    "Matrix",
    "Name",
    "Part",
    "Reflectance",
    "Row",
    "SettingValue",
    "Share",
    "Termination",
    "Text",
    "Vector",
    "cross",
    "fault",
    "length",
    "number_as_triple",
]

POWER_LIMIT: Final = 1e12
"""Largest magnitude of a radiometric quantity: if directly visible, the film can store it (below 2^43)."""
SHAPE_LIMIT: Final = 2**20
"""Most shapes, and most lights, of one scene."""
INLINE_LIMIT: Final = 2**22
"""Most vertices or faces of a mesh written into the scene file itself; larger ones belong in a mesh file."""


def encodable(value: str) -> str:
    """Refuses what no file can hold: half of a surrogate pair."""
    try:
        value.encode("utf-8")
    except UnicodeEncodeError:
        raise fault("text", f"is {shown(value)}, but must be a text without lone surrogates") from None
    return value


def layer_name(value: str) -> str:
    """Refuses names that are too long for the channels of an OpenEXR file, 255 bytes, or not printable."""
    if not (1 <= len(value) <= LAYER_NAME_LIMIT and value.isprintable()):
        raise fault("text", f"is {shown(value)}, but must be a text of 1 to {LAYER_NAME_LIMIT} printable characters")
    return value


Finite = Annotated[float, Strict(), Field(allow_inf_nan=False)]
Coordinate = Annotated[Finite, Field(ge=-COORDINATE_LIMIT, le=COORDINATE_LIMIT)]
Length = Annotated[Finite, Field(gt=0.0, le=COORDINATE_LIMIT)]
Power = Annotated[Finite, Field(ge=0.0, le=POWER_LIMIT)]
Share = Annotated[Finite, Field(ge=0.0, le=1.0)]
Index = Annotated[Finite, Field(gt=0.0, le=1000.0)]
Extinction = Annotated[Finite, Field(ge=0.0, le=1000.0)]
NAME_LIMIT: Final = 200
LAYER_NAME_LIMIT: Final = 60
Name = Annotated[str, StringConstraints(strict=True, min_length=1, max_length=NAME_LIMIT)]
LayerName = Annotated[str, Strict(), AfterValidator(layer_name)]
FileName = Annotated[str, StringConstraints(strict=True, min_length=1, max_length=4096)]
Text = Annotated[str, Strict(), AfterValidator(encodable)]
Flag = Annotated[bool, Strict()]
Vector: TypeAlias = tuple[Coordinate, Coordinate, Coordinate]
Lengths: TypeAlias = tuple[Length, Length, Length]
Termination: TypeAlias = Annotated[Finite, Field(ge=0.0, lt=1.0)] | None
Row: TypeAlias = tuple[Finite, Finite, Finite, Finite]
Matrix: TypeAlias = tuple[Row, Row, Row, Row]


NUMBER_OR_TRIPLE: Final[dict[str, Any]] = {
    "anyOf": [{"type": "number"}, {"type": "array", "items": {"type": "number"}, "minItems": 3, "maxItems": 3}]
}
"""JSON Schema of the values that `number_as_triple` accepts."""


def number_as_triple(value: Any) -> Any:
    """Accepts one number for three equal ones."""
    return (value, value, value) if isinstance(value, int | float) and not isinstance(value, bool) else value


def _number_or_triple(**limits: float) -> WithJsonSchema:
    """JSON Schema of a number, or of three, within limits."""
    one = {"type": "number", **limits}
    return WithJsonSchema({"anyOf": [one, {"type": "array", "items": one, "minItems": 3, "maxItems": 3}]})


Color: TypeAlias = Annotated[
    tuple[Power, Power, Power],
    BeforeValidator(number_as_triple),
    _number_or_triple(minimum=0.0, maximum=POWER_LIMIT),
]
"""Red, green and blue; one number is a grey."""
Reflectance: TypeAlias = Annotated[
    tuple[Share, Share, Share], BeforeValidator(number_as_triple), _number_or_triple(minimum=0.0, maximum=1.0)
]


class Part(BaseModel):
    """Base of every table of a scene file: frozen, unknown keys forbidden.

    Attributes
    ----------
    late_keys : frozenset of str
        Keys that there were not yet when films were first written: at their defaults they are not part of the hash.
    """

    late_keys: ClassVar[frozenset[str]] = frozenset()

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False, defer_build=True)

    def __init__(self, **values: Any) -> None:
        # A table built in code fails like one read from a file, with a `SceneError` of one sentence.
        try:
            super().__init__(**values)
        except ValidationError as error:
            converted = plain(values)
            if converted is values:
                raise scene_error(error, type(self), type(self).__name__) from None
            self.__init__(**converted)  # type: ignore[misc]

    # Nested tables must not use this constructor, which would lose their locations.
    __init__.__pydantic_base_init__ = True  # type: ignore[attr-defined]

    def __setattr__(self, name: str, value: Any) -> None:
        if name in type(self).model_fields:
            refuse_change(f"{type(self).__name__}.{name}")
        super().__setattr__(name, value)

    def __delattr__(self, name: str) -> None:
        if name in type(self).model_fields:
            refuse_change(f"{type(self).__name__}.{name}")
        super().__delattr__(name)

    def changed(self, paths: Mapping[Any, Any] | None = None, /, **named: Any) -> Self:
        """A copy with other values, validated like a scene file; what was not named stays the same object.

        Parameters
        ----------
        paths : mapping of str to value, optional
            Places, as error messages write them, and their new values: ``{"materials.white.reflectance[1]": 0.5}``. A
            tuple of steps is a place too. A new name adds an entry to a table, and the index after the last one adds
            one to a list. None takes an entry away, or gives a key its default. All indices are those before the
            change.
        **named : values
            The same for places whose names are words, with two underscores between the steps:
            ``camera__vertical_fov=30.0``.

        Raises
        ------
        SceneError
            There is no such place, or a value is not allowed.
        """
        return self._changed(changes_by_place({} if paths is None else paths, named))

    def _changed(self, changes: Any) -> Self:
        source = type(self).__name__
        made: Self = validated(type(self), table_values(self, changes, (), source), (), source)
        return made

    def model_copy(self, *, update: Mapping[str, Any] | None = None, deep: bool = False) -> Self:
        """A copy; with values to update, it is `changed`."""
        same = super().model_copy(deep=deep)
        return same.changed({(name,): value for name, value in update.items()}) if update else same

    def with_checked(self, **values: Any) -> Self:
        """A copy with these values, which have been validated before."""
        update = {name: FrozenDict(each) if isinstance(each, dict) else each for name, each in values.items()}
        return super().model_copy(update=update)

    @classmethod
    def model_construct(cls, _fields_set: set[str] | None = None, **values: Any) -> Self:  # type: ignore[override]
        """Refused: it would validate nothing."""
        raise SceneError(f"{cls.__name__}.model_construct would check nothing; write {cls.__name__}(...) instead")


def fault(kind: str, message: str, *place: str | int) -> PydanticCustomError:
    """A custom validation error: the message continues after the name of its `place`, relative to the current table."""
    return PydanticCustomError(kind, "{sentence}", {"sentence": message, "below": place})


class SettingValue:
    """Annotation of a scene file's key for a render setting: the table of settings defines the allowed values.

    Parameters
    ----------
    setting : Setting
    """

    def __init__(self, setting: Setting) -> None:
        self._setting = setting

    def _checked(self, value: Any) -> Any:
        try:
            return self._setting.accept(value)
        except NotAllowed as error:
            raise fault("setting", str(error)) from None

    def __get_pydantic_core_schema__(self, _source: Any, _handler: Any) -> CoreSchema:
        return core_schema.no_info_plain_validator_function(self._checked)

    def __get_pydantic_json_schema__(self, _schema: CoreSchema, _handler: Any) -> dict[str, Any]:
        return self._setting.schema()


def length(vector: Vector) -> float:
    """Euclidean length, without intermediate overflow or underflow."""
    largest = max(abs(x) for x in vector)
    if largest == 0.0:
        return 0.0
    x, y, z = (component / largest for component in vector)
    return largest * math.sqrt(x * x + y * y + z * z)


def cross(a: Vector, b: Vector) -> Vector:
    """Cross product."""
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])
