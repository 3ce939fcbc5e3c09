"""Reads the container: the JSON of a `.gltf`, or the chunks of a `.glb` (glTF 2.0 specification, section 4)."""

from __future__ import annotations

import json
import struct
from pathlib import Path
from typing import Any, Final

from clrender.errors import SceneError
from clrender.importers.asset_files import AssetFiles
from clrender.importers.draft import Draft
from clrender.importers.gltf.document import Document
from clrender.wording import counted, shown

__all__ = ["opened"]

_MAGIC: Final = b"glTF"
_JSON, _BIN = 0x4E4F534A, 0x004E4942


def opened(path: Path, files: AssetFiles, draft: Draft) -> Document:
    """The parts of a file, whose first bytes tell `.gltf` from `.glb`.

    Parameters
    ----------
    path : pathlib.Path
    files : AssetFiles
    draft : Draft
        Receives the notes.

    Raises
    ------
    SceneError
        It cannot be read, is truncated, or has invalid JSON.
    """
    data = memoryview(files.scene(path))
    if bytes(data[:4]) == _MAGIC:
        text, binary = _chunks(data, files.source, draft)
        return Document(_parsed(bytes(text), files, draft), binary, files, draft)
    if path.suffix.lower() == ".glb" and bytes(data[:64]).lstrip()[:1] not in (b"", b"{", b"[", b"\xef"):  # nor JSON
        raise SceneError(f'{files.source}: byte 0: a GLB begins with "glTF", but this file does not; export it again')
    return Document(_parsed(bytes(data), files, draft), None, files, draft)


def _chunks(data: memoryview, source: str, draft: Draft) -> tuple[memoryview, memoryview]:
    """The JSON and the binary chunk of a GLB, empty if there is none."""
    if len(data) < 20:
        raise SceneError(f"{source}: byte {len(data)}: the GLB ends within its header; export it again")
    _, version, total = struct.unpack_from("<III", data)
    if version != 2:
        raise SceneError(f"{source}: byte 4: GLB of version {version}, but only version 2 is read; export it as glTF 2")
    if total > len(data):
        text = f"says that it has {counted(total, 'byte')}, but has {len(data)}"
        raise SceneError(f"{source}: byte 8: the GLB {text}; it is cut off, copy or export it again")
    if total < len(data):
        draft.note(f"byte {total}: {counted(len(data) - total, 'byte')} behind the end of the GLB left out")
    found: dict[int, memoryview] = {}
    at, number = 12, 0
    while at + 8 <= total:
        size, kind = struct.unpack_from("<II", data, at)
        if at + 8 + size > total:
            raise SceneError(
                f"{source}: byte {at}: the chunk of {counted(size, 'byte')} goes beyond the end; export it again"
            )
        if (kind == _JSON) != (number == 0):
            order = "the first chunk of a GLB has to be its JSON" if number == 0 else "there is a second JSON chunk"
            raise SceneError(f"{source}: byte {at}: {order}; export it again")
        if kind == _BIN and number == 1:
            found[kind] = data[at + 8 : at + 8 + size]
        elif kind != _JSON:
            draft.note(f"byte {at}: a chunk of an unknown kind was left out")
        found.setdefault(kind, data[at + 8 : at + 8 + size])
        at, number = at + 8 + size, number + 1
    if _JSON not in found:
        raise SceneError(f"{source}: byte 12: the GLB has no JSON chunk; export it again")
    return found[_JSON], found.get(_BIN, memoryview(b""))


class _NoJson(ValueError):
    pass


def _constant(name: str) -> Any:
    raise _NoJson(f"{name} is no number of JSON")


def _parsed(text: bytes, files: AssetFiles, draft: Draft) -> dict[str, Any]:
    """Root object of JSON in UTF-8."""
    source = files.source
    if text[:3] == b"\xef\xbb\xbf":
        fault = f"{source}: byte 0: the JSON begins with a byte order mark, which glTF forbids; save without it"
        draft.forgive(SceneError(fault), source, files.strict)
        text = text[3:]
    if not text.strip():
        raise SceneError(f"{source}: the file is empty; it must hold the JSON of a glTF scene")
    try:
        root = json.loads(text.decode("utf-8"), parse_constant=_constant)
    except UnicodeDecodeError as error:
        raise SceneError(f"{source}: byte {error.start}: the JSON is not UTF-8; save it so") from None
    except json.JSONDecodeError as error:
        where = f"line {error.lineno} column {error.colno}"
        raise SceneError(f"{source}: {where}: the JSON is damaged: {error.msg}; export it again") from None
    except RecursionError:
        raise SceneError(f"{source}: the JSON is nested too deeply; export it again") from None
    except _NoJson as error:
        raise SceneError(f"{source}: the JSON is damaged: {error}; export it again") from None
    except ValueError:  # integers with thousands of digits
        raise SceneError(f"{source}: the JSON holds a number that is too long; export it again") from None
    if not isinstance(root, dict):
        raise SceneError(f"{source}: the root of its JSON is {shown(root)}, but must be an object; export it again")
    return root
