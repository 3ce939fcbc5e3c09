"""A glTF file on its way in: its JSON, its binary chunk, and how to say what is wrong with it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from clrender.errors import SceneError
from clrender.importers.asset_files import AssetFiles
from clrender.importers.draft import Draft
from clrender.scene.wording import quoted

__all__ = ["Document", "escaped"]


def escaped(step: str) -> str:
    """One step of a JSON pointer (RFC 6901), printable anywhere and not too long."""
    return quoted(step.replace("~", "~0").replace("/", "~1"))[1:-1]


@dataclass
class Document:
    """The content of a glTF file.

    Attributes
    ----------
    root : dict
        The JSON object; `clrender.importers.gltf.validator.validate` has it checked.
    binary : memoryview or None
        The binary chunk of a GLB, empty if it has none; of a `.gltf` None.
    files : AssetFiles
    draft : Draft
        What becomes of it.
    """

    root: dict[str, Any]
    binary: memoryview | None
    files: AssetFiles
    draft: Draft

    def fault(self, pointer: str, sentence: str) -> SceneError:
        """The error of a place, which the sentence goes on from."""
        return SceneError(f"{self.files.source}: {pointer or 'the root of its JSON'} {sentence}")

    def note(self, sentence: str) -> None:
        """Say something once, of what was done instead of what the file asks for."""
        self.draft.note(sentence)

    def items(self, collection: str) -> list[Any]:
        """The objects of one of the root's arrays, such as ``nodes``."""
        found: list[Any] = self.root.get(collection, [])
        return found

    def extension(self, holder: dict[str, Any], name: str) -> dict[str, Any] | None:
        """The object of an extension, if there is one there."""
        found: dict[str, Any] | None = holder.get("extensions", {}).get(name)
        return found
