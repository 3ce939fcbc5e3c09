"""A glTF file during import: its JSON, its binary chunk, and its error messages."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from clrender.errors import SceneError
from clrender.importers.asset_files import AssetFiles
from clrender.importers.draft import Draft
from clrender.wording import quoted

__all__ = ["Document", "escaped"]


def escaped(step: str) -> str:
    """A step of a JSON pointer (RFC 6901), printable and truncated."""
    return quoted(step.replace("~", "~0").replace("/", "~1"))[1:-1]


@dataclass
class Document:
    """The content of a glTF file.

    Attributes
    ----------
    root : dict
        The JSON object, after `clrender.importers.gltf.validator.validate`.
    binary : memoryview or None
        The binary chunk of a GLB, empty if it has none; None for a `.gltf`.
    files : AssetFiles
    draft : Draft
        What becomes of it.
    """

    root: dict[str, Any]
    binary: memoryview | None
    files: AssetFiles
    draft: Draft

    def fault(self, pointer: str, sentence: str) -> SceneError:
        """An error at a JSON pointer, after which the sentence continues."""
        return SceneError(f"{self.files.source}: {pointer or 'the root of its JSON'} {sentence}")

    def forgive(self, pointer: str, sentence: str) -> None:
        """Note what the specification forbids, but leaves no doubt about the image; see `Draft.forgive`."""
        self.draft.forgive(self.fault(pointer, sentence), self.files.source, self.files.strict)

    def leave_out(self, pointer: str, sentence: str) -> None:
        """Note why a part is left out; see `Draft.leave_out`."""
        self.draft.leave_out(self.fault(pointer, sentence), self.files.source, self.files.strict)

    def note(self, sentence: str) -> None:
        """Add a note about a deviation from the file, unless it is a duplicate."""
        self.draft.note(sentence)

    def items(self, collection: str) -> list[Any]:
        """The objects of one of the root's arrays, such as ``nodes``."""
        found: list[Any] = self.root.get(collection, [])
        return found

    def extension(self, holder: dict[str, Any], name: str) -> dict[str, Any] | None:
        """The object of an extension, if the holder has it."""
        found: dict[str, Any] | None = holder.get("extensions", {}).get(name)
        return found
