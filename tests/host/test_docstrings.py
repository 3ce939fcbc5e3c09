"""Every public name says what it takes and returns: numpydoc's own checks, and shapes and types of arrays."""

from __future__ import annotations

import dataclasses
import inspect
import re
from collections.abc import Iterator
from typing import Any

import pydantic
from cases import for_each
from numpydoc.docscrape import NumpyDocString
from numpydoc.validate import validate

import clrender
import clrender.cluster
import clrender.film
import clrender.verification

RETURNED = {
    "clrender.film.Film": clrender.film.Film,
    "clrender.verification.Verification": clrender.verification.Verification,
    "clrender.cluster.open_cluster": clrender.cluster.open_cluster,
}
"""What the names of `clrender` return or are given, and what the documentation names besides."""
FAULTS = {
    "GL08",  # there is no docstring
    "SS01",  # no summary
    "PR01",  # a parameter is not documented
    "PR02",  # one that there is not, is
    "PR03",  # wrong order
    "PR04",  # one has no type
    "PR08",
    "RT02",  # a returned value has no type
}
"""Those of numpydoc's checks that are not a matter of taste."""
_ARRAY = re.compile(r"NDArray|ndarray")
_SHAPE = re.compile(r"\([^()]*,[^()]*\)")
_DTYPE = re.compile(
    r"\b(float32|float64|uint8|uint16|uint32|uint64|int32|int64|bool)\b|`[A-Z]\w+`"
)  # or a struct of the kernels


def public() -> Iterator[tuple[str, Any]]:
    """Names and what they stand for: functions, classes, and the methods and properties of these."""
    tops = {f"clrender.{name}": getattr(clrender, name) for name in clrender.__all__ if name != "__version__"}
    for name, thing in {**tops, **RETURNED}.items():
        yield name, thing
        if inspect.isclass(thing) and not issubclass(thing, Exception):
            for part, value in vars(thing).items():
                if not part.startswith(("_", "model_")) and (
                    callable(value) or isinstance(value, classmethod | property)
                ):
                    yield f"{name}.{part}", getattr(thing, part)


NAMES = dict(public())


def function_of(thing: Any) -> Any:
    """What has the annotations."""
    if isinstance(thing, property):
        return thing.fget
    return thing.__init__ if inspect.isclass(thing) else thing


def fields_of(thing: Any) -> dict[str, str]:
    """Fields of a class of data, with their annotations; none of anything else."""
    if dataclasses.is_dataclass(thing):
        return {each.name: str(each.type) for each in dataclasses.fields(thing) if not each.name.startswith("_")}
    if inspect.isclass(thing) and issubclass(thing, pydantic.BaseModel):
        return {field: str(about.annotation) for field, about in thing.model_fields.items()}
    return {}


def documented(name: str, section: str) -> dict[str, str]:
    """Names of a section, and the type that it gives each."""
    doc = NumpyDocString(inspect.getdoc(NAMES[name]) or "")
    return {part.strip(): each.type for each in doc[section] for part in each.name.split(",")}


@for_each("name", NAMES)
def test_it_has_a_docstring_with_its_parameters(name: str) -> None:
    faults = FAULTS - ({"PR01"} if fields_of(NAMES[name]) else set())  # which are documented as attributes
    assert not [(code, text) for code, text in validate(name)["errors"] if code in faults]


@for_each("name", NAMES)
def test_what_it_returns_is_said(name: str) -> None:
    thing = NAMES[name]
    returned = str(getattr(function_of(thing), "__annotations__", {}).get("return", "None"))
    doc = inspect.getdoc(thing) or ""
    if inspect.isclass(thing) or isinstance(thing, property) or returned in ("None", "NoReturn"):
        return
    # A method without parameters may say in its one sentence what it gives.
    taken = [each for each in inspect.signature(thing).parameters if each not in ("self", "cls")]
    assert not taken or re.search(r"^(Returns|Yields)$", doc, re.MULTILINE), f"{name} returns {returned}"


@for_each("name", NAMES)
def test_arrays_have_shapes_and_types(name: str) -> None:
    thing = NAMES[name]
    doc = inspect.getdoc(thing) or ""
    annotations = dict(getattr(function_of(thing), "__annotations__", {}))
    if fields := fields_of(thing):
        told = {**documented(name, "Attributes"), **documented(name, "Parameters")}
        annotations = fields
        assert set(annotations) <= set(told), "a field is not documented"
    else:
        told = documented(name, "Parameters")
    for parameter, annotation in annotations.items():
        if not _ARRAY.search(str(annotation)) and not re.search(r"\bSums\b|\bCounts\b", str(annotation)):
            continue
        text = doc if parameter == "return" else told.get(parameter, "")
        assert _SHAPE.search(text) and _DTYPE.search(text), f"{name}: {parameter}: {text!r}"
