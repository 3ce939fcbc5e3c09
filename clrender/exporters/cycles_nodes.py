"""Trees of Blender's shader nodes."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from typing import Any, Final, TypeAlias

import numpy as np

__all__ = ["NO_ID", "Inputs", "NodeTree", "Socket"]

Inputs: TypeAlias = dict[Any, Any]
"""By name or number of an input of a node: a number, several of them, or a `Socket`."""

NO_ID: Final = re.compile(r"[^ -~]")
"""What names lack: all that is not ASCII, of which Blender keeps 63 bytes."""


@dataclass(frozen=True)
class Socket:
    """What a node gives: the number of the node, and the name or number of its output."""

    node: int
    output: str | int


@dataclass
class NodeTree:
    """Nodes, each after those that it takes something from.

    Attributes
    ----------
    nodes : list
        Of each its type without ``ShaderNode``, its attributes, and its inputs: name or number, value, and whether the
        value is the output of a node.
    """

    nodes: list[Any] = field(default_factory=list)

    def node(self, kind: str, inputs: Inputs, output: str | int = 0, **attributes: Any) -> Socket:
        """A new node; gives one of its outputs.

        Parameters
        ----------
        kind : str
            Its type.
        inputs : dict
            See `Inputs`.
        output : str or int
            Name or number of the output.
        **attributes : bool, float or str
            Its other properties.
        """
        made = []
        for name, value in inputs.items():
            linked = isinstance(value, Socket)
            plain = [value.node, value.output] if isinstance(value, Socket) else np.asarray(value, np.float64).tolist()
            made.append([name, plain, linked])
        self.nodes.append([kind, attributes, made])
        return Socket(len(self.nodes) - 1, output)

    def math(self, operation: str, *operands: Any) -> Socket:
        """Arithmetic with numbers.

        Parameters
        ----------
        operation : str
            Blender's name for it.
        *operands : float or Socket
        """
        return self.node("Math", dict(enumerate(operands)), operation=operation)

    def behind(self) -> Socket:
        """1 where a surface is met from its back, else 0."""
        return self.node("NewGeometry", {}, "Backfacing")

    def mixed(self, amount: Any, first: Socket, second: Socket) -> Socket:
        """Two closures; `amount` is the share of the second."""
        return self.node("MixShader", {0: amount, 1: first, 2: second})

    def added(self, first: Socket | None, second: Socket | None) -> Socket | None:
        """Two closures on each other, or one of them."""
        if first is None or second is None:
            return first or second
        return self.node("AddShader", {0: first, 1: second})

    def described(self, surface: Socket | None = None, volume: Socket | None = None) -> dict[str, Any]:
        """The tree as JSON has it, with the closures that it ends in."""
        ends = {"Surface": surface, "Volume": volume}
        told = {name: None if end is None else [end.node, end.output] for name, end in ends.items()}
        return {"nodes": self.nodes, **told}
