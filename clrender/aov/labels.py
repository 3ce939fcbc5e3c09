"""Labels: which instance, category and part of a scene covers most of a pixel, as exact numbers from 1; 0 is nothing.

All is decided by counting samples, so that bits depend neither on their order nor on the device.
"""

from __future__ import annotations

import bisect
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import numpy.typing as npt

from clrender.errors import SceneError
from clrender.scene.groups import Instance
from clrender.wording import counted, grouped, quoted, suggestion

if TYPE_CHECKING:
    from clrender.scene import Scene

__all__ = ["Label", "Labelling", "is_many", "labels_told"]

_Integers = npt.NDArray[np.int64]

_MOST: Final = 1 << 24
"""Whole numbers up to this one are exact in single precision."""


@dataclass(frozen=True)
class Label:
    """A number of a layer, and what it stands for.

    Attributes
    ----------
    number : int
        From 1.
    name : str
        Instances: the name of the shape or of its entry, ``NAME[3]`` for the fourth of its `transforms`, else type and
        index such as ``mesh_3``. Parts: likewise, after that of their group, such as ``chair/leg``.
    category : str or None
        Of an instance, if it has one; None for other layers.
    area : float
        Pixels that it covers: the sum of its coverage over the image, also where others cover more.
    whole_area : float or None
        Of an instance: what that would be if nothing stood before it, if this was rendered (``amodal``).
    """

    number: int
    name: str
    category: str | None
    area: float
    whole_area: float | None = None

    @property
    def hidden(self) -> float | None:
        """Share of `whole_area` that other things hide, 0 to 1; None if that is unknown or zero."""
        if not self.whole_area:
            return None
        return max(0.0, 1.0 - self.area / self.whole_area)

    def told(self) -> dict[str, Any]:
        """Its attributes that are known, JSON-able."""
        return {name: value for name, value in vars(self).items() if value is not None}


@dataclass(frozen=True)
class Labelling:
    """Numbers of a scene's instances, categories and parts; a function of the scene alone.

    Attributes
    ----------
    categories, parts : tuple of str
        Names of the numbers from 1 on: sorted categories; the scene's shapes, then those of its groups, in order.
    count : int
        Number of instances. Shapes and instances of the same `name` are one, as in mattes; each of the `transforms` of
        an entry is one of its own.
    """

    scene: Scene
    categories: tuple[str, ...]
    parts: tuple[str, ...]
    count: int
    _first: _Integers  # of each entry of the scene's list: its first number
    _runs: tuple[int, ...]  # first numbers, ascending
    _entries: tuple[int, ...]  # of each run

    @classmethod
    def of(cls, scene: Scene) -> Labelling:
        """Number a scene.

        Raises
        ------
        SceneError
            It has more instances than a layer can number.
        """
        found: Labelling = scene.of_contents("labels", lambda: cls._made(scene))
        return found

    @classmethod
    def _made(cls, scene: Scene) -> Labelling:
        first, runs, entries, known, count = [], list[int](), list[int](), dict[str, int](), 0
        for at, shape in enumerate(scene.shapes):
            many = is_many(shape)
            if not many and shape.name in known:
                first.append(known[shape.name])
                continue
            first.append(count + 1)
            runs.append(count + 1)
            entries.append(at)
            if not many and shape.name is not None:
                known[shape.name] = count + 1
            count += len(scene.transforms(at).maps) if many else 1
        if count > _MOST:
            text = f"{counted(count, 'instance')}, but a layer numbers at most {grouped(_MOST)}; ask for other layers"
            raise SceneError(f"{scene.source}: has {text}")
        categories = {shape.category for _, shape in scene.all_shapes()} | {
            each.category for _, each in scene.instances()
        }
        parts = []
        for place, shape in scene.all_shapes():
            own = _named(shape, int(place[-1]))
            parts.append(own if place[0] == "shapes" else f"{place[1]}/{own}")
        told = tuple(sorted(each for each in categories if each is not None))
        return cls(scene, told, tuple(parts), count, np.array(first, np.int64), tuple(runs), tuple(entries))

    @property
    def firsts(self) -> _Integers:
        """The first number of each entry of the scene's list of shapes, (entries,) int64."""
        return self._first

    def name(self, layer: str, number: int) -> str:
        """The name of a number of a layer."""
        if layer != "instance":
            return (self.categories if layer == "category" else self.parts)[number - 1]
        run = bisect.bisect_right(self._runs, number) - 1
        entry = self._entries[run]
        shape = self.scene.shapes[entry]
        return _named(shape, entry) + (f"[{number - self._runs[run]}]" if is_many(shape) else "")

    def entries(self, number: int) -> Iterator[tuple[int, int | None]]:
        """Entries of the scene's list that make up an instance.

        Yields
        ------
        entry : int
        turn : int or None
            Which of the entry's `transforms`; None if it has none.
        """
        entry = self._entries[bisect.bisect_right(self._runs, number) - 1]
        if is_many(self.scene.shapes[entry]):
            yield entry, number - int(self._first[entry])
            return
        for at in np.flatnonzero(self._first == number).tolist():
            if not is_many(self.scene.shapes[at]):
                yield at, None

    def category(self, number: int) -> str | None:
        """The category of an instance: that of all its shapes, if they have one in common."""
        found = {each for entry, _ in self.entries(number) for each in self._categories(entry)}
        return found.pop() if len(found) == 1 else None

    def _categories(self, entry: int) -> set[str | None]:
        shape = self.scene.shapes[entry]
        if isinstance(shape, Instance) and shape.category is None:
            return {each.category for each in self.scene.groups[shape.group].shapes}
        return {shape.category}

    def numbered(self, names: Sequence[str]) -> list[int]:
        """Numbers of the instances that have these names, ascending; all if one of them is ``all``.

        Raises
        ------
        SceneError
            There is none of that name.
        """
        if "all" in names:
            return list(range(1, self.count + 1))
        every: dict[str, list[int]] = {}
        for number in range(1, self.count + 1):
            name = self.name("instance", number)
            every.setdefault(name, []).append(number)
            if name.endswith("]"):  # all of an entry's
                every.setdefault(name.rpartition("[")[0], []).append(number)
        for name in names:
            if name not in every:
                raise SceneError(f"{self.scene.source}: has no instance {quoted(name)}{suggestion(name, every)}")
        return sorted({number for name in names for number in every[name]})


def labels_told(
    scene: Scene,
    areas: Mapping[str, Mapping[int, float]],
    whole: Mapping[int, float],
) -> dict[str, tuple[Label, ...]]:
    """The labels of an image.

    Parameters
    ----------
    scene : Scene
    areas : mapping of str to mapping of int to float
        For each layer, pixels that its numbers cover.
    whole : mapping of int to float
        Pixels that instances would cover if nothing stood before them.

    Returns
    -------
    dict of str to tuple of Label
        For each layer those that cover something, and those of `whole`, by ascending number.
    """
    labelling = Labelling.of(scene)
    made = {}
    for layer, covered in areas.items():
        of_instances = layer == "instance"
        numbers = sorted({*covered, *(whole if of_instances else ())})
        made[layer] = tuple(
            Label(
                number,
                labelling.name(layer, number),
                labelling.category(number) if of_instances else None,
                covered.get(number, 0.0),
                whole.get(number) if of_instances else None,
            )
            for number in numbers
        )
    return made


def is_many(shape: Any) -> bool:
    """Whether an entry of a scene's list has `transforms`, each of which is an instance of its own."""
    return isinstance(shape, Instance) and shape.transforms is not None


def _named(shape: Any, at: int) -> str:
    return f"{shape.type}_{at}" if shape.name is None else str(shape.name)
