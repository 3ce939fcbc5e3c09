"""Where the prims of a USD stage are: their transform operations as matrices."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from clrender.exact.angles import sin_cos_degrees
from clrender.exact.matrices import inverse, lengths, product
from clrender.importers.shared.matrices import Matrix, identity, is_affine, scaling, translation
from clrender.importers.usd.process import Stage

__all__ = ["Places", "instance_matrices", "root_matrix"]

_AXES: Final = "XYZ"


def root_matrix(up: str, meters: float) -> Matrix:
    """From the space of a stage to ours: metres, and +y up.

    Parameters
    ----------
    up : {"X", "Y", "Z"}
    meters : float
        Length of its unit.
    """
    made = scaling(meters, meters, meters)
    if up == "Z":
        made[:3] = made[[0, 2, 1]]
        made[2] *= -1.0
    return made + 0.0


class Places:
    """Transforms of the nodes of a stage.

    Parameters
    ----------
    stage : Stage
    """

    def __init__(self, stage: Stage) -> None:
        self._nodes: list[list[Any]] = stage.tables["nodes"]
        self._ops: list[list[Any]] = stage.tables["ops"]
        self._local: dict[tuple[int, int], Matrix] = {}
        self._chains: dict[tuple[int, int], Matrix] = {}

    def moves(self, node: int) -> bool:
        """Whether a node moves relative to the root of its list."""
        while node >= 0:
            parent, ops, _ = self._nodes[node]
            if any(len(values) > 1 for _, _, values in self._ops[ops]):
                return True
            node = parent
        return False

    def chain(self, node: int, number: int = 0) -> Matrix:
        """From the space of a node to that of the root of its list, at one of the times.

        What is not invertible is in it as it is.
        """
        way: list[int] = []
        while node >= 0 and (node, number) not in self._chains:
            way.append(node)
            node = self._nodes[node][0]
        made = self._chains[node, number] if node >= 0 else identity()
        for each in reversed(way):
            made = product(made, self._of(self._nodes[each][1], number))
            self._chains[each, number] = made
        return made

    def _of(self, ops: int, number: int) -> Matrix:
        key = (ops, number)
        if key not in self._local:
            made = identity()
            for kind, inverted, values in self._ops[ops]:
                made = product(made, _matrix(kind, inverted, values[min(number, len(values) - 1)]))
            self._local[key] = made
        return self._local[key]


def _matrix(kind: str, inverted: bool, value: Any) -> Matrix:
    """The matrix of a transform operation, for column vectors; the identity for one without a value."""
    if value is None:
        return identity()
    if kind.startswith("rotate"):
        letters, angles = kind[6:], value if isinstance(value, list) else [value]
        made = identity()
        for letter in letters:
            made = product(_turn(letter, angles[_AXES.index(letter)] if len(letters) > 1 else angles[0]), made)
        # The inverse of a rotation, without rounding
        return made.T.copy() if inverted else made
    if kind == "orient":
        made = identity()
        made[:3, :3] = _rotations(np.array([value]))[0]
        return made.T.copy() if inverted else made
    if kind == "transform":
        made = np.array(value, np.float64).T.copy()
    elif kind[:-1] in ("translate", "scale"):
        three = [0.0 if kind[0] == "t" else 1.0] * 3
        three[_AXES.index(kind[-1])] = value
        made = _matrix(kind[:-1], False, three)
    elif kind == "translate":
        return translation(*(-x if inverted else x for x in value))
    else:
        made = scaling(*value)
    if not inverted:
        return made
    return inverse(made) if is_affine(made) else identity()


def _turn(letter: str, degrees: float) -> Matrix:
    """A rotation about an axis."""
    sine, cosine = sin_cos_degrees(degrees) if np.isfinite(degrees) else (0.0, 1.0)
    first, second = {"X": (1, 2), "Y": (2, 0), "Z": (0, 1)}[letter]
    made = identity()
    made[first, first] = made[second, second] = cosine
    made[first, second], made[second, first] = -sine, sine
    return made


def _rotations(quaternions: NDArray[np.float64]) -> NDArray[np.float64]:
    """Rotations of quaternions with the real part first, (n, 4), of any length; (n, 3, 3)."""
    sizes = lengths(quaternions)
    sound = np.isfinite(sizes) & (sizes > 0.0)
    unit = np.where(sound[:, None], quaternions / np.where(sound, sizes, 1.0)[:, None], [1.0, 0.0, 0.0, 0.0])
    w, x, y, z = unit.T
    rows = [
        [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)],
        [2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)],
        [2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)],
    ]
    return np.moveaxis(np.array(rows), 2, 0)


def instance_matrices(
    positions: NDArray[np.float64] | None,
    orientations: NDArray[np.float64] | None,
    scales: NDArray[np.float64] | None,
    count: int,
) -> NDArray[np.float64]:
    """The transforms of the points of an instancer: scaled, turned, moved; (count, 4, 4).

    Parameters
    ----------
    positions, scales : (count, 3) float64 or None
    orientations : (count, 4) float64 or None
        Quaternions, the real part first.
    count : int
    """
    made = np.tile(np.eye(4), (count, 1, 1))
    if orientations is not None:
        made[:, :3, :3] = _rotations(orientations)
    if scales is not None:
        made[:, :3, :3] *= scales[:, None, :]
    if positions is not None:
        made[:, :3, 3] = positions
    return made
