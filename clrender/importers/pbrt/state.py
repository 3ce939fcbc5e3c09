"""pbrt's graphics state, which applies to later shapes and lights: transform, material, emission."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any, Final

import numpy as np

from clrender.exact.matrices import product
from clrender.importers.pbrt.parameters import Parameters
from clrender.importers.pbrt.tokens import Directive
from clrender.importers.shared.matrices import (
    Matrix,
    identity,
    inverse,
    look_at,
    rotation,
    scaling,
    translation,
)

__all__ = ["TRANSFORMS", "Graphics", "moved"]


@dataclass(frozen=True)
class Graphics:
    """The current graphics state.

    Attributes
    ----------
    matrix : (4, 4) float64
        From current object space to world space (to camera space before ``WorldBegin``), when the motion begins.
    late : (4, 4) float64
        The same, when it ends.
    active : str
        Which of both directives change: ``All``, ``StartTime`` or ``EndTime``.
    material : callable
        Returns the name of the current one, empty for the default; None for ``interface``. To be called at the end of
        the file.
    emission : Parameters or None
        Parameters of the current area light.
    inside, outside : str
        Names of media; empty for none.
    reversed : bool
    defaults : mapping of str to Parameters
        Defaults of ``Attribute``, by target.
    """

    matrix: Matrix = field(default_factory=identity)
    late: Matrix = field(default_factory=identity)
    active: str = "All"
    material: Callable[[], str | None] = str
    emission: Parameters | None = None
    inside: str = ""
    outside: str = ""
    reversed: bool = False
    defaults: Any = field(default_factory=dict)

    @property
    def moves(self) -> bool:
        """Whether the transform changes with time."""
        return not np.array_equal(self.matrix, self.late)

    def with_both(self, matrix: Matrix, late: Matrix) -> Graphics:
        """The state with other transforms."""
        return replace(self, matrix=matrix, late=late)


TRANSFORMS: Final = frozenset(
    [
        "Identity",
        "Translate",
        "Scale",
        "Rotate",
        "LookAt",
        "Transform",
        "ConcatTransform",
        "CoordinateSystem",
        "CoordSysTransform",
    ]
)
"""Directives that change the transform."""


def moved(state: Graphics, directive: Directive, systems: dict[str, tuple[Matrix, Matrix]]) -> Graphics:
    """The state after one of `TRANSFORMS`.

    Parameters
    ----------
    state : Graphics
    directive : Directive
    systems : dict of str to pair of (4, 4) float64
        Named coordinate systems at both times; one may be added.

    Raises
    ------
    SceneError
        It lacks numbers, or its transform is not affine.
    """
    name = directive.name
    if name == "CoordinateSystem":
        systems[directive.text(0, "name")] = state.matrix, state.late
        return state
    if name == "CoordSysTransform":
        wanted = directive.text(0, "name")
        if wanted not in systems:
            raise directive.fault(f"the coordinate system {wanted[:60]!a} is not defined; define it before")
        return state.with_both(*systems[wanted])
    if state.active == "All" and not state.moves:
        made = _made(state.matrix, directive)
        return state.with_both(made, made)
    matrix = state.matrix if state.active == "EndTime" else _made(state.matrix, directive)
    return state.with_both(matrix, state.late if state.active == "StartTime" else _made(state.late, directive))


def _made(matrix: Matrix, directive: Directive) -> Matrix:
    """What a directive makes of a transform."""
    name = directive.name
    if name == "Identity":
        return identity()
    made = _by_columns(directive) if name == "Transform" else product(matrix, _step(directive))
    # One that cannot be inverted does no harm unless something is placed by it
    if not (np.isfinite(made).all() and np.allclose(made[3], [0.0, 0.0, 0.0, 1.0], rtol=0.0, atol=1e-6)):
        raise directive.fault(f"{name} makes a transform that is no affine one; give other numbers")
    return made


def _by_columns(directive: Directive) -> Matrix:
    return np.array(directive.floats(16), np.float64).reshape(4, 4).T


def _step(directive: Directive) -> Matrix:
    name = directive.name
    try:
        if name == "Translate":
            return translation(*directive.floats(3))
        if name == "Scale":
            return scaling(*directive.floats(3))
        if name == "Rotate":
            degrees, *axis = directive.floats(4)
            return rotation(axis, degrees)
        if name == "LookAt":
            numbers = directive.floats(9)
            return inverse(look_at(numbers[:3], numbers[3:6], numbers[6:]))
    except ValueError as error:
        raise directive.fault(f"{error}; give other numbers") from None
    return _by_columns(directive)
