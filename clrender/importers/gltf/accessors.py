"""Reads accessors as arrays: interleaved, sparse, normalised, matrices; without copies where possible."""

from __future__ import annotations

from functools import cached_property
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from clrender.importers.gltf.document import Document
from clrender.importers.gltf.meshopt import compression, decode_meshopt, unread_fallbacks
from clrender.importers.gltf.schema import COMPONENTS
from clrender.importers.gltf.validator import element_bytes
from clrender.wording import counted, quoted

__all__ = ["Accessors"]

_KINDS: Final = {5120: "i1", 5121: "u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
_LARGEST: Final = {5120: 127.0, 5121: 255.0, 5122: 32767.0, 5123: 65535.0}
_WITHOUT_DATA: Final = 2**22
"""Most elements of an accessor without bytes in the file, whose count is not limited by the file's size."""
_LOOSE: Final = 1e-5
"""Relative tolerance of the bounds of floats: exporters round bounds to few digits."""


class Accessors:
    """The arrays of a file.

    Parameters
    ----------
    document : Document
        Validated.

    Raises
    ------
    SceneError
        A buffer cannot be read or decoded, or is too short.
    """

    def __init__(self, document: Document) -> None:
        self._document = document
        self._buffers = _buffers(document)
        self._decoded = decode_meshopt(document, self._buffers)
        self._arrays: dict[int, NDArray[Any]] = {}

    def view(self, index: int) -> memoryview:
        """Bytes of a buffer view."""
        if index in self._decoded:
            return self._decoded[index]
        view = self._document.items("bufferViews")[index]
        start = view.get("byteOffset", 0)
        data = self._buffers[view["buffer"]]
        if data is None:
            text = "has no `uri`, so that nobody knows its bytes, but they are used; export it again"
            raise self._document.fault(f"/buffers/{view['buffer']}", text)
        part: memoryview = data[start : start + view["byteLength"]]
        return part

    def raw(self, index: int) -> NDArray[Any]:
        """Numbers as stored in the file: (count,), (count, n) for vectors, (count, rows, columns) for matrices.

        The array must not be modified.
        """
        if index not in self._arrays:
            self._arrays[index] = self._read(index)
        return self._arrays[index]

    def provide(self, index: int, numbers: NDArray[Any]) -> None:
        """Set the numbers of an accessor whose data an extension contains."""
        kind = np.dtype(_KINDS[self._document.items("accessors")[index]["componentType"]])
        self._arrays[index] = numbers if numbers.dtype.kind in "ui" and kind.kind == "u" else numbers.astype(kind)

    def floats(self, index: int) -> NDArray[np.float32]:
        """Numbers as float32, normalised if the file says so."""
        accessor = self._document.items("accessors")[index]
        numbers = self.raw(index)
        if not accessor.get("normalized"):
            plain: NDArray[np.float32] = numbers.astype(np.float32, copy=False)
            return plain
        shares = numbers.astype(np.float32) / np.float32(_LARGEST[accessor["componentType"]])
        held: NDArray[np.float32] = np.maximum(shares, np.float32(-1.0))
        return held

    def check(self) -> None:
        """Check that all accessors have finite numbers within their bounds.

        Raises
        ------
        SceneError
            For the first one that does not.
        """
        for index, accessor in enumerate(self._document.items("accessors")):
            if self.known(index):
                self._check(index, accessor)

    def known(self, index: int) -> bool:
        """Whether an accessor has data."""
        accessor = self._document.items("accessors")[index]
        if "type" not in accessor or not ("bufferView" in accessor or "sparse" in accessor):
            return False
        sparse = accessor.get("sparse")
        parts = [accessor] + ([sparse["indices"], sparse["values"]] if sparse else [])
        views = [part["bufferView"] for part in parts if "bufferView" in part]
        buffers = {index: self._document.items("bufferViews")[index]["buffer"] for index in views}
        return all(index in self._decoded or self._buffers[buffers[index]] is not None for index in views)

    def _named(self, *beginnings: str) -> set[int]:
        """Accessors of attributes whose names begin so."""
        primitives = [each for mesh in self._document.items("meshes") for each in mesh["primitives"]]
        attributes = [item for each in primitives for item in each["attributes"].items()]
        return {accessor for name, accessor in attributes if name.startswith(beginnings)}

    @cached_property
    def _dispensable(self) -> set[int]:
        return self._named("NORMAL", "TANGENT", "TEXCOORD_")

    @cached_property
    def _positions(self) -> set[int]:
        return self._named("POSITION")

    def _check(self, index: int, accessor: dict[str, Any]) -> None:
        at = f"/accessors/{index}"
        numbers = self.raw(index)
        low, high = _extremes(numbers)
        if numbers.dtype.kind == "f" and not (np.isfinite(low).all() and np.isfinite(high).all()):
            finite = np.isfinite(numbers.reshape(len(numbers), -1)).all(axis=1)
            text = f"has a number in element {int(np.argmax(~finite))} that is not finite; export it again"
            if index in self._positions:
                return  # the triangles there are left out, by whoever knows them
            if index not in self._dispensable:
                raise self._document.fault(at, text)
            self._document.forgive(at, text)
            # As of no length: there the surface has its own normal
            self._arrays[index] = np.where(finite[:, None], numbers, numbers.dtype.type(0))
            return
        for key, found, sign in (("min", low, 1.0), ("max", high, -1.0)):
            if key not in accessor:
                continue
            # Matrices, and their bounds, are stored column by column
            given = np.asarray(accessor[key])
            there = np.asarray(np.atleast_1d(found.T if found.ndim == 2 else found), np.float64).reshape(-1)
            slack = _LOOSE * np.maximum(np.abs(given), np.abs(there)) + 1e-9 if numbers.dtype.kind == "f" else 0.0
            bad = sign * (given - there) > slack
            if bad.any():
                part = int(np.argmax(bad))
                text = f"is {given[part]:g}, but there is a number {there[part]:g} in the data; export it again"
                self._document.forgive(f"{at}/{key}/{part}", text)

    def _read(self, index: int) -> NDArray[Any]:
        accessor, at = self._document.items("accessors")[index], f"/accessors/{index}"
        if "type" not in accessor:
            raise self._document.fault(f"{at}/type", "is not known, but the accessor is used; export it again")
        columns, rows = COMPONENTS[accessor["type"]]
        kind, count = np.dtype(_KINDS[accessor["componentType"]]), accessor["count"]
        shape = (count,) if columns * rows == 1 else (count, rows) if columns == 1 else (count, rows, columns)
        if "bufferView" in accessor:
            view = self._document.items("bufferViews")[accessor["bufferView"]]
            data = self.view(accessor["bufferView"])[accessor.get("byteOffset", 0) :]
            found = self._strided(data, accessor, count, view.get("byteStride"))
        else:
            if count > _WITHOUT_DATA:
                raise self._document.fault(
                    f"{at}/count", f"is {count}, but there are no bytes for that; export it again"
                )
            found = np.zeros(shape, kind)
        sparse = accessor.get("sparse")
        if sparse is None:
            return found
        indices = self._sparse_indices(sparse, count, at)
        values = self.view(sparse["values"]["bufferView"])[sparse["values"].get("byteOffset", 0) :]
        found = found.copy()
        found[indices] = self._strided(values, accessor, sparse["count"], None)
        return found

    def _strided(self, data: memoryview, accessor: dict[str, Any], count: int, stride: int | None) -> NDArray[Any]:
        """Elements a stride apart; the data may end right after the last one."""
        columns, rows = COMPONENTS[accessor["type"]]
        kind = np.dtype(_KINDS[accessor["componentType"]])
        _, step, column = element_bytes(accessor)
        step = stride or step
        if columns > 1:
            strides = (step, kind.itemsize, column)
            return np.ndarray((count, rows, columns), kind, data, strides=strides)
        if rows == 1:
            return np.ndarray((count,), kind, data, strides=(step,))
        return np.ndarray((count, rows), kind, data, strides=(step, kind.itemsize))

    def _sparse_indices(self, sparse: dict[str, Any], count: int, at: str) -> NDArray[Any]:
        part = sparse["indices"]
        data = self.view(part["bufferView"])[part.get("byteOffset", 0) :]
        indices = np.frombuffer(data, _KINDS[part["componentType"]], sparse["count"])
        if int(indices[-1]) >= count or (indices[1:] <= indices[:-1]).any():
            text = f"must grow, and be below the accessor's count of {count}; export it again"
            raise self._document.fault(f"{at}/sparse/indices", text)
        return indices


def _extremes(numbers: NDArray[Any]) -> tuple[NDArray[Any], NDArray[Any]]:
    """Minimum and maximum of each component; NaN if it contains one."""
    if numbers.ndim != 2:
        return numbers.min(axis=0), numbers.max(axis=0)
    columns = [numbers[:, column] for column in range(numbers.shape[1])]  # several times as fast as along rows
    return np.array([each.min() for each in columns]), np.array([each.max() for each in columns])


def _buffers(document: Document) -> list[memoryview | None]:
    """Bytes of all buffers; None for one that is neither readable nor used."""
    views = document.items("bufferViews")
    extensions = [packed[1] for view in views if (packed := compression(document, view)) is not None]
    used = {each["buffer"] for each in (*views, *extensions)}
    unread = unread_fallbacks(document)
    found: list[memoryview | None] = []
    for index, buffer in enumerate(document.items("buffers")):
        at, uri = f"/buffers/{index}", buffer.get("uri")
        size = buffer["byteLength"]
        if index in unread or (uri is None and (index > 0 or document.binary is None)):
            found.append(None)
            continue
        if uri is None:
            assert document.binary is not None
            data = document.binary
            if len(data) > size + 3:
                document.note(f"{at} has {counted(size, 'byte')}, fewer than the binary chunk; the rest was left out")
        elif index not in used and uri.partition("://")[0].lower() in ("http", "https"):
            document.note(f"{at}/uri {quoted(uri)} was left out: nothing is fetched, and nothing uses it")
            found.append(None)
            continue
        else:
            data = memoryview(_content(document, uri, at))
        if len(data) < size:
            raise document.fault(
                f"{at}", f"has a byteLength of {size}, but holds only {counted(len(data), 'byte')}; export it again"
            )
        found.append(data[:size])
    return found


def _content(document: Document, uri: str, at: str) -> bytes:
    if uri[:5].lower() == "data:":
        head = uri[5:].partition(",")[0].lower()
        kind = head.partition(";")[0]
        if ";;" in head or head.endswith(";"):
            raise document.fault(f"{at}/uri", "is a data URI with an empty parameter; export it again")
        if kind not in ("application/octet-stream", "application/gltf-buffer"):
            raise document.fault(f"{at}/uri", f"is a data URI of the kind {quoted(kind)}, not application/octet-stream")
    return document.files.read(uri, f"{at}/uri")
