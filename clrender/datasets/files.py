"""Files of one image: written atomically, and described by hashes of their pixels, which do not depend on libraries."""

from __future__ import annotations

import hashlib
import importlib
import io
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from clrender.errors import UsageError
from clrender.files.access import atomic_write, open_input
from clrender.image.deep_png import deep_png_bytes
from clrender.image.display import deep_pixels, is_deep, open_display, png_bytes
from clrender.image.exr import exr_size
from clrender.image.exr_write import write_exr

__all__ = ["ImageFiles", "channels_sha256", "decoded", "json_bytes", "png_of", "read_json"]

_Array = npt.NDArray[Any]
_EXR: Final = ".exr"


def json_bytes(content: Any) -> bytes:
    """JSON with sorted keys, and a line's end: the same bytes for the same content."""
    return json.dumps(content, sort_keys=True, separators=(",", ":"), allow_nan=False).encode() + b"\n"


def read_json(path: Path) -> Any:
    """Content of a JSON file.

    Raises
    ------
    UsageError
        It cannot be read, or is no JSON.
    """
    with open_input(path) as file:
        data = file.read()
    try:
        return json.loads(data)
    except (ValueError, RecursionError) as error:
        raise UsageError(f"{path}: is no JSON ({str(error)[:100]}); make the data set again") from None


def channels_sha256(channels: Mapping[str, _Array]) -> str:
    """Hash of arrays by name: of names, kinds, shapes and little-endian numbers, whatever the file's compression.

    Parameters
    ----------
    channels : mapping of str to ndarray
    """
    digest = hashlib.sha256()
    for name in sorted(channels):
        array = channels[name]
        plain = np.ascontiguousarray(array, array.dtype.newbyteorder("<"))
        digest.update(f"{name} {plain.dtype.str} {plain.shape}\n".encode())
        digest.update(plain.reshape(-1).view(np.uint8).data)
    return digest.hexdigest()


def png_of(pixels: _Array) -> bytes:
    """A PNG of (H, W) or (H, W, 3) pixels of uint8 or uint16."""
    return deep_png_bytes(pixels) if pixels.dtype == np.uint16 else png_bytes(np.ascontiguousarray(pixels), {})


def decoded(name: str, data: bytes) -> dict[str, _Array]:
    """The arrays of a file, as `channels_sha256` takes them.

    Parameters
    ----------
    name : str
        Its name: `.png`, `.exr`, or another that is a text.
    data : bytes

    Returns
    -------
    dict of str to ndarray
        A PNG's pixels, an EXR's channels, a text's bytes.

    Raises
    ------
    Exception
        Of any kind, if it is damaged.
    """
    if name.endswith(".png"):
        file = io.BytesIO(data)
        with open_display(file) as picture:
            pixels = deep_pixels(file, picture) if is_deep(picture) else np.asarray(picture)
        return {"": pixels[..., 0] if pixels.ndim == 3 and pixels.shape[2] == 1 else pixels}
    if name.endswith(_EXR):
        exr_size(io.BytesIO(data))  # refuses more pixels than the file can hold
        library: Any = importlib.import_module("OpenEXR")
        with library.File(io.BytesIO(data), separate_channels=True) as picture:
            return {each: np.asarray(channel.pixels) for each, channel in picture.channels().items()}
    return {"": np.frombuffer(data, np.uint8)}


class ImageFiles:
    """The files of one image.

    Parameters
    ----------
    folder : Path or None
        Of the data set; None: nothing is written, only hashes are made.
    keep : bool
        Whether to keep the arrays, to compare them.

    Attributes
    ----------
    pixels : dict of str to str
        `channels_sha256` of each file, by its name in the data set; of a member of an archive ``ARCHIVE#MEMBER``.
    written : dict of str to [int, str]
        Bytes and SHA-256 of each file on disk.
    arrays : dict of str to dict
        What the hashes are of, if it is kept.
    """

    def __init__(self, folder: Path | None, keep: bool = False) -> None:
        self._folder, self._keep = folder, keep
        self.pixels: dict[str, str] = {}
        self.written: dict[str, list[Any]] = {}
        self.arrays: dict[str, dict[str, _Array]] = {}

    def png(self, name: str, pixels: _Array) -> None:
        """Write (H, W) or (H, W, 3) pixels of uint8 or uint16."""
        self.note(name, {"": pixels})
        if self._folder is not None:
            self.put(name, png_of(pixels))

    def text(self, name: str, data: bytes) -> None:
        """Write a text, whose bytes count."""
        self.note(name, {"": np.frombuffer(data, np.uint8)})
        self.put(name, data)

    def exr(
        self,
        name: str,
        linear: npt.NDArray[np.float32],
        channels: Mapping[str, _Array],
        note: Mapping[str, Any],
        attributes: Mapping[str, str],
    ) -> None:
        """Write (H, W, 3) radiance and (H, W) channels, with attributes in the header that they need."""
        every = {"R": linear[..., 0], "G": linear[..., 1], "B": linear[..., 2], **channels}
        self.note(name, every)
        if self._folder is not None:
            file = io.BytesIO()
            write_exr(file, linear, {"clrender": json.dumps(note, sort_keys=True), **attributes}, channels)
            self.put(name, file.getvalue())

    def note(self, name: str, arrays: dict[str, _Array]) -> None:
        """Note the hash of what a file holds."""
        self.pixels[name] = channels_sha256(arrays)
        if self._keep:
            self.arrays[name] = arrays

    def put(self, name: str, data: bytes) -> None:
        """Write a file under its name, complete or not at all."""
        if self._folder is None:
            return
        path = self._folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        with atomic_write(path, durable=False) as file:  # the record proves it, or it is made again
            file.write(data)
        self.written[name] = [len(data), hashlib.sha256(data).hexdigest()]
