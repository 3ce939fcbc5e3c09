"""Changes of a scene by the places of its values, such as ``materials.white.reflectance[1]``, all validated."""

from __future__ import annotations

import ast
import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final, TypeAlias

import numpy as np
from pydantic import BaseModel, ValidationError

from clrender.errors import SceneError
from clrender.scene.former_keys import present_keys
from clrender.scene.validation_errors import scene_error
from clrender.wording import counted, place, quoted, shown, suggestion

__all__ = ["changes_by_place", "plain", "with_changes"]

Step: TypeAlias = str | int
Place: TypeAlias = tuple[Step, ...]
_STEP: Final = re.compile(r'\[(-?\d+)\]|(?:^|\.)(?:"((?:[^"\\]|\\.)*)"|([^.\[\]"]+))')


@dataclass(frozen=True)
class _New:
    """A new value; None takes the old one away."""

    value: Any


Changes: TypeAlias = dict[Step, "_New | Changes"]


def changes_by_place(paths: Mapping[Any, Any], named: Mapping[str, Any]) -> Changes:
    """The changes as a tree of places.

    Parameters
    ----------
    paths : mapping of str or tuple of (str or int) to value
        Places as error messages write them, or their steps.
    named : mapping of str to value
        Places whose steps are joined by two underscores.

    Raises
    ------
    SceneError
        A place is not written like one, or is inside of another.
    """
    if not isinstance(paths, Mapping):
        raise SceneError(f"changes are a table of places and values, and not {shown(paths)}")
    tree: Changes = {}
    given = [(_steps(path), value) for path, value in paths.items()]
    given += [(tuple(name.split("__")), value) for name, value in named.items()]
    for steps, value in given:
        branch = tree
        for step in steps[:-1]:
            below = branch.setdefault(step, {})
            if isinstance(below, _New):
                raise SceneError(f"{place(steps)} is inside of another place that is given too; keep one of them")
            branch = below
        if steps[-1] in branch:
            raise SceneError(f"{place(steps)} is given twice, or has another place inside; keep one of them")
        branch[steps[-1]] = _New(value)
    return tree


def _steps(path: Any) -> Place:
    if isinstance(path, tuple) and path and all(isinstance(step, str | int) for step in path):
        return path
    at, steps = 0, list[Step]()
    while isinstance(path, str) and (found := _STEP.match(path, at)):
        index, name, bare = found.groups()
        steps.append(int(index) if index else ast.literal_eval(f'"{name}"') if name is not None else bare)
        at = found.end()
    if not steps or at < len(path):
        example = "materials.white.reflectance, shapes[2].radius"
        raise SceneError(f"{shown(path)} is not a place in a scene; write it like {example}")
    return tuple(steps)


def with_changes(node: Any, changes: Changes, at: Place, source: str) -> Any:
    """A value of a scene with changes below it; tables are validated.

    Parameters
    ----------
    node : BaseModel, mapping, sequence or None
        None is a table that is not there yet.
    changes : Changes
    at : tuple of str or int
        Its place.
    source : str
        Name of the scene in messages.

    Raises
    ------
    SceneError
        There is no such place, or the value is not allowed.
    """
    if hasattr(node, "model_fields_set"):
        values = table_values(node, changes, at, source)
        # Another type makes another kind of table, which the one around it knows
        return values if "type" in changes else validated(type(node), values, at, source)
    if isinstance(node, tuple | list):
        return _list(node, changes, at, source)
    if node is not None and not isinstance(node, Mapping):
        step = next(iter(changes))
        raise SceneError(f"{source}: {place(at)} is {shown(node)}, which has no {quoted(str(step))} inside")
    entries = dict(node or {})
    for step, change in changes.items():
        if isinstance(change, _New):
            if change.value is None and node is not None and step not in entries:
                raise _missing(step, entries, at, source)
            entries = {key: value for key, value in entries.items() if key != step or change.value is not None}
            if change.value is not None:
                entries[step] = change.value
        elif node is not None and step not in entries:
            raise _missing(step, entries, at, source)
        else:
            entries[step] = with_changes(entries.get(step), change, (*at, step), source)
    return entries


def table_values(node: BaseModel, changes: Changes, at: Place, source: str) -> dict[str, Any]:
    """The keys that a table was given, with changes."""
    known = type(node).model_fields
    values = {name: getattr(node, name) for name in known if name in node.model_fields_set}
    for step, change in present_keys(type(node), changes, source, at).items():
        if step not in known:
            raise SceneError(f"{source}: {place((*at, step))} is an unknown key{suggestion(step, known)}")
        name = str(step)
        if not isinstance(change, _New):
            values[name] = with_changes(getattr(node, name), change, (*at, name), source)
        elif change.value is None:
            values.pop(name, None)
        else:
            values[name] = change.value
    return values


def validated(kind: type[BaseModel], values: dict[str, Any], at: Place, source: str) -> Any:
    """A table of these keys."""
    try:
        return kind.model_validate(values)
    except ValidationError as error:
        converted = plain(values)
        if converted is values:
            raise scene_error(error, kind, source, at) from None
    return validated(kind, converted, at, source)


def plain(value: Any) -> Any:
    """A value with Python's numbers and lists in the place of NumPy's; the same object if there are none."""
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    if type(value) is dict:
        table = {key: plain(each) for key, each in value.items()}
        return table if any(table[key] is not each for key, each in value.items()) else value
    if type(value) in (list, tuple):
        entries = [plain(each) for each in value]
        return entries if any(a is not b for a, b in zip(entries, value, strict=True)) else value
    return value


def _list(node: tuple[Any, ...] | list[Any], changes: Changes, at: Place, source: str) -> list[Any]:
    entries, removed = list(node), set[int]()
    for step, change in sorted(changes.items(), key=lambda item: str(item[0]).zfill(20)):
        index = int(step) if isinstance(step, int) or step.isdecimal() else -1
        new = isinstance(change, _New) and change.value is not None
        if not 0 <= index < len(entries) + new:
            has = (
                f"has {counted(len(node), 'entry', 'entries')}, from [0] on; the index after the last one adds an entry"
            )
            raise SceneError(f"{source}: {place((*at, step))} is not there: {place(at)} {has}")
        if not isinstance(change, _New):
            entries[index] = with_changes(entries[index], change, (*at, index), source)
        elif change.value is None:
            removed.add(index)
        else:
            entries[index : index + 1] = [change.value]
    return [entry for index, entry in enumerate(entries) if index not in removed]


def _missing(step: Step, entries: Mapping[Any, Any], at: Place, source: str) -> SceneError:
    return SceneError(f"{source}: {place((*at, step))} is not there{suggestion(step, entries)}")
