"""The nodes of a glTF scene in world space."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, Final

from clrender.importers.gltf.animation import Moved
from clrender.importers.gltf.document import Document
from clrender.importers.gltf.matrices import IDENTITY, Matrix, composed, from_columns, product
from clrender.meshes.data import COORDINATE_LIMIT

__all__ = ["TRS", "Nodes"]

TRS: Final = {"translation": (0.0, 0.0, 0.0), "rotation": (0.0, 0.0, 0.0, 1.0), "scale": (1.0, 1.0, 1.0)}
"""Transform properties of a node, and their defaults."""


class Nodes:
    """World transforms of all nodes, and which nodes are in the scene.

    Parameters
    ----------
    document : Document
        Validated.
    moved : Moved
        Animated values, which replace the nodes' own.

    Attributes
    ----------
    world : list of Matrix
        Transform of each node to world space.
    shown : list of int
        The nodes of the scene in depth-first order.
    """

    def __init__(self, document: Document, moved: Moved) -> None:
        self._nodes = document.items("nodes")
        self._moved = moved
        self.world: list[Matrix] = [IDENTITY] * len(self._nodes)
        children = {child for node in self._nodes for child in node.get("children", [])}
        for index in self._walk([i for i in range(len(self._nodes)) if i not in children], hidden=True):
            if max(abs(x) for row in self.world[index] for x in row) > COORDINATE_LIMIT:
                text = f"is scaled or moved by more than {COORDINATE_LIMIT:g}; make its transform smaller"
                raise document.fault(f"/nodes/{index}", text)
        self.shown = list(self._walk(self._roots(document, children)))

    def weights(self, index: int, mesh: dict[str, Any]) -> list[float]:
        """Weights of the morph targets of a node's mesh."""
        own: list[float] = self._nodes[index].get("weights") or mesh.get("weights") or []
        return self._moved.get((index, "weights"), own)

    def _roots(self, document: Document, children: set[int]) -> list[int]:
        scenes = document.items("scenes")
        if not scenes:
            if self._nodes:
                document.note("it has no scene; the image shows all of its nodes")
            return [i for i in range(len(self._nodes)) if i not in children]
        chosen: int = document.root.get("scene", 0)
        if len(scenes) > 1:
            document.note(f"it has {len(scenes)} scenes; the image is of /scenes/{chosen}")
        roots: list[int] = scenes[chosen].get("nodes", [])
        return roots

    def _walk(self, roots: list[int], hidden: bool = False) -> Iterator[int]:
        """Nodes from parents to children; the first traversal computes their world transforms."""
        stack = list(reversed(roots))
        while stack:
            index = stack.pop()
            node = self._nodes[index]
            children = node.get("children", [])
            if hidden:
                self.world[index] = product(self.world[index], self._local(index))
                for child in children:
                    self.world[child] = self.world[index]
            elif not node.get("extensions", {}).get("KHR_node_visibility", {}).get("visible", True):
                continue
            yield index
            stack += reversed(children)

    def _local(self, index: int) -> Matrix:
        node = self._nodes[index]
        if "matrix" in node:
            return from_columns(node["matrix"])
        parts = [self._moved.get((index, key), node.get(key, default)) for key, default in TRS.items()]
        return composed(*parts)
