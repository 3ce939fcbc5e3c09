"""Numbers of labels of what rays hit, and which of them most samples of a pixel have."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np
import numpy.typing as npt

from clrender.aov.labels import Labelling, is_many
from clrender.flatten.assembly import assemble

if TYPE_CHECKING:
    from clrender.flatten.flat_scene import FlatScene
    from clrender.scene import Scene

__all__ = ["LabelNumbers", "majority"]

_Integers = npt.NDArray[np.int64]

_CHUNK: Final = 1 << 21


class LabelNumbers:
    """Numbers of what rays hit.

    Parameters
    ----------
    labelling : Labelling
    flat : FlatScene
        The arrays of its scene.
    """

    def __init__(self, labelling: Labelling, flat: FlatScene) -> None:
        scene, assembly = labelling.scene, assemble(labelling.scene)
        instances = flat.instances
        first = np.append(labelling.firsts, 0)
        own, placed = instances.own_places, instances.placed
        self._own_instance = first[own] + instances.own_turns * _many(scene, own)
        self._placed_instance = first[placed[:, 0]] + placed[:, 1] * _many(scene, placed[:, 0])
        places = {place: number for number, (place, _) in enumerate(scene.all_shapes(), 1)}
        shapes = assembly.scene.shapes
        self._part = np.array([places[assembly.scene.place_of(at)] for at in range(len(shapes))], np.int64)
        numbers: dict[str | None, int] = {None: 0} | {name: n for n, name in enumerate(labelling.categories, 1)}
        of_entry = np.array([*(numbers[shape.category] for shape in scene.shapes), 0], np.int64)
        self._shape_category = np.array([numbers[shape.category] for shape in shapes], np.int64)
        self._own_category, self._placed_category = of_entry[own], of_entry[placed[:, 0]]

    def of(self, layer: str, shape: _Integers, instance: _Integers) -> _Integers:
        """Numbers of a layer.

        Parameters
        ----------
        layer : str
            One of `clrender.aov.names.LABELS`.
        shape : (n,) int64
            Shapes of the assembled scene that were hit.
        instance : (n,) int64
            Instances that they are in; -1: none.

        Returns
        -------
        (n,) int64
        """
        if layer == "part":
            return self._part[shape]
        own, placed = {
            "instance": (self._own_instance, self._placed_instance),
            "category": (self._own_category, self._placed_category),
        }[layer]
        # What is in an instance comes after all shapes in world space
        found = np.append(own, 0)[np.minimum(shape, len(own))]
        found = np.where(instance >= 0, np.append(placed, 0)[instance], found)
        return np.where(found == 0, self._shape_category[shape], found) if layer == "category" else found


def majority(numbers: npt.NDArray[np.uint32], taken: npt.NDArray[np.uint32]) -> npt.NDArray[np.float32]:
    """The number that most samples of each pixel have, and its share of them.

    Parameters
    ----------
    numbers : (P, N) uint32
        Of the samples of each pixel; 0: nothing.
    taken : (P,) uint32
        Number of samples of each pixel; further entries of `numbers` are 0.

    Returns
    -------
    (2, P) float32
        Numbers, the smallest of those that are equally frequent, and shares, the count divided by `taken` and rounded
        once. Zeros where no samples were taken.
    """
    result = np.zeros((2, len(numbers)), np.float32)
    rows = max(1, _CHUNK // max(numbers.shape[1], 1))
    for begin in range(0, len(numbers), rows):
        part = slice(begin, begin + rows)
        found = np.sort(numbers[part], axis=1)
        starts = np.ones(found.shape, bool)
        np.not_equal(found[:, 1:], found[:, :-1], out=starts[:, 1:])
        places = np.flatnonzero(starts)
        counts = np.diff(places, append=found.size)
        pixels, values = places // found.shape[1], found.reshape(-1)[places]
        counts = counts - np.where(values == 0, found.shape[1] - taken[part].astype(np.int64)[pixels], 0)
        order = np.lexsort((values, -counts, pixels))
        _, first = np.unique(pixels[order], return_index=True)
        best = order[first]
        share = np.divide(counts[best], taken[part], out=np.zeros(len(best)), where=taken[part] > 0)
        result[0, part], result[1, part] = values[best], share
    return result


def _many(scene: Scene, entries: _Integers) -> _Integers:
    """1 where an entry's transforms are instances of their own, else 0."""
    return np.array([*(is_many(shape) for shape in scene.shapes), False], np.int64)[entries]
