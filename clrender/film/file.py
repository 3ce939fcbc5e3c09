"""The `.film` file format: exact sums, so that a film can be stored, resumed and merged without loss.

It is an uncompressed NumPy archive (`.npz`) of members, which `numpy.load` reads too: `header` (JSON text
as bytes), `ledger` (blocks,) uint32, the index of each block's set of samples in the header's table, `counts` (H, W)
uint32 and `sums` (H, W, 3, 2) uint64, low word first, in quanta of 2^-64; with replicates `squares` (H, W, 3, 4)
uint64, lowest word first, in quanta of 2^-128, too.
"""

from __future__ import annotations

import json
import struct
import textwrap
import tokenize
import zipfile
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path
from types import TracebackType
from typing import IO, Any, Final

import numpy as np
import numpy.typing as npt

from clrender.errors import UsageError
from clrender.files.access import atomic_write, open_input
from clrender.film.ledger import Ledger
from clrender.film.unit import blocks_across
from clrender.wording import counted

__all__ = ["FORMAT", "FilmReader", "write_film"]

FORMAT: Final = "clrender film 1"

_HEADER_LIMIT: Final = 256 << 20
_DAMAGES: Final = (
    AttributeError,
    tokenize.TokenError,
    SyntaxError,
    OverflowError,
    MemoryError,
    RecursionError,
    zipfile.BadZipFile,
    EOFError,
    KeyError,
    NotImplementedError,
    RuntimeError,
    TypeError,
    ValueError,
    struct.error,
)


def write_film(
    path: Path,
    header: Mapping[str, Any],
    blocks: npt.NDArray[np.uint32],
    counts: npt.NDArray[np.uint32],
    bands: Sequence[npt.NDArray[np.uint64]],
    squares: Sequence[npt.NDArray[np.uint64]] = (),
    beside: str | None = None,
) -> None:
    """Write a film file atomically.

    Parameters
    ----------
    path : Path
        Output file; an existing file is replaced.
    header : mapping
        Width, height, request, ledger and provenance, as JSON values.
    blocks : (blocks,) uint32
        Indices of the ledger.
    counts : (H, W) uint32
    bands : sequence of (rows, W, 3, 2) uint64
        Sums, top first.
    squares : sequence of (rows, W, 3, 4) uint64
        Sums of squared replicates, top first; empty without replicates.
    beside : str, optional
        See `clrender.files.access.atomic_write`.

    Raises
    ------
    RenderError
        When the file cannot be written.
    """
    text = json.dumps({"format": FORMAT, **header}, sort_keys=True).encode()
    with (
        atomic_write(path, beside) as file,
        zipfile.ZipFile(file, "w", zipfile.ZIP_STORED, allowZip64=True) as archive,
    ):
        _write_member(archive, "header", (len(text),), [np.frombuffer(text, np.uint8)])
        _write_member(archive, "ledger", blocks.shape, [blocks])
        _write_member(archive, "counts", counts.shape, [counts])
        _write_member(archive, "sums", (*counts.shape, 3, 2), bands)
        if squares:
            _write_member(archive, "squares", (*counts.shape, 3, 4), squares)


class FilmReader:
    """An open film file. Each fault in the file raises an error of one sentence.

    Parameters
    ----------
    path : Path

    Attributes
    ----------
    header : dict
        The header, with checked keys and checked against the file size: it cannot request more memory than the file has
        bytes.

    Raises
    ------
    UsageError
        When the file does not exist or is no complete film; also raised from within the block.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.header: dict[str, Any] = {}

    def __enter__(self) -> FilmReader:
        with ExitStack() as stack:
            stack.push(self._sentence)
            file = stack.enter_context(open_input(self.path))
            self._archive = stack.enter_context(zipfile.ZipFile(file))
            self.header = self._checked_header()
            self._open = stack.pop_all()
        return self

    def __exit__(self, *details: Any) -> None:
        self._open.__exit__(*details)

    def require(self, holds: bool, fault: str) -> None:
        """Refuse the file with this fault unless a condition holds."""
        if not holds:
            raise ValueError(fault)

    def ledger(self) -> Ledger:
        """The ledger of the samples that the film holds."""
        width, height = self.header["width"], self.header["height"]
        blocks = np.empty(blocks_across(width) * blocks_across(height), np.uint32)
        self._fill("ledger", blocks.shape, np.dtype("<u4"), [blocks])
        return Ledger.from_file(width, height, self.header["ledger"], blocks)

    def fill(
        self,
        counts: npt.NDArray[np.uint32],
        bands: Sequence[npt.NDArray[np.uint64]],
        squares: Sequence[npt.NDArray[np.uint64]] = (),
    ) -> None:
        """Fill `counts` (H, W), `bands` (rows, W, 3, 2) and any `squares` (rows, W, 3, 4) in place."""
        self._fill("counts", counts.shape, np.dtype("<u4"), [counts])
        self._fill("sums", (*counts.shape, 3, 2), np.dtype("<u8"), bands)
        if squares:
            self._fill("squares", (*counts.shape, 3, 4), np.dtype("<u8"), squares)

    def _fill(self, name: str, shape: tuple[int, ...], kind: np.dtype[Any], arrays: Sequence[npt.NDArray[Any]]) -> None:
        with self._archive.open(_stored(self._archive, name)) as member:
            _expect(member, shape, kind)
            for array in arrays:
                _fill(member, array)
            self.require(member.read(1) == b"", f"{name} go on too long")  # at the end, zipfile verifies the CRC

    def _checked_header(self) -> dict[str, Any]:
        header = json.loads(_read_member(self._archive, "header", None, np.dtype(np.uint8)).tobytes())
        if not isinstance(header, dict) or header.get("format") != FORMAT:
            raise ValueError(f"its header does not say {FORMAT!r}")
        width, height = header.get("width"), header.get("height")
        if type(width) is not int or type(height) is not int or width < 1 or height < 1:
            raise ValueError(f"a film of {width} x {height} pixels holds nothing")
        missing = [key for key in ("request", "ledger", "provenance") if not isinstance(header.get(key), dict)]
        if missing:
            raise ValueError(f"its header has no {missing[0]!r}")
        replicate_spp = header["request"].get("replicate_spp")
        if replicate_spp is not None and (type(replicate_spp) is not int or replicate_spp < 1):
            raise ValueError(f"replicates of {replicate_spp!r} samples make no sense")
        blocks = blocks_across(width) * blocks_across(height)
        sizes = {"ledger": 4 * blocks, "counts": 4 * width * height, "sums": 48 * width * height}
        if replicate_spp is not None:
            sizes["squares"] = 96 * width * height
        for name, size in sizes.items():
            if not size < self._archive.getinfo(f"{name}.npy").file_size < size + 65536:
                raise ValueError(f"{name} are not those of {width} x {height} pixels")
        return header

    def _sentence(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if isinstance(error, _DAMAGES):
            reason = textwrap.shorten(str(error), 200) or type(error).__name__
            film = self.path.suffix.lower() == ".film"
            cure = "render it again" if film else "name a .film, which `clrender render -o FILE.film` writes"
            raise UsageError(f"{self.path}: not a whole clrender film ({reason}); {cure}.") from None


def _write_member(
    archive: zipfile.ZipFile, name: str, shape: tuple[int, ...], parts: Sequence[npt.NDArray[Any]]
) -> None:
    kind = parts[0].dtype.newbyteorder("<")
    # A fixed date, so that equal films give identical files.
    info = zipfile.ZipInfo(f"{name}.npy", (1980, 1, 1, 0, 0, 0))
    with archive.open(info, "w", force_zip64=True) as member:
        description = {"descr": np.lib.format.dtype_to_descr(kind), "fortran_order": False, "shape": shape}
        np.lib.format.write_array_header_1_0(member, description)
        for part in parts:
            data = np.ascontiguousarray(part, kind).reshape(-1)
            for first in range(0, len(data), 1 << 20):
                member.write(data[first : first + (1 << 20)].data)


def _stored(archive: zipfile.ZipFile, name: str) -> zipfile.ZipInfo:
    """Find member `name`, which must be uncompressed, so that a small file cannot request much memory."""
    info = archive.getinfo(f"{name}.npy")
    if info.compress_type != zipfile.ZIP_STORED or info.file_size != info.compress_size:
        raise ValueError(f"{name} are compressed")
    return info


def _read_member(
    archive: zipfile.ZipFile, name: str, shape: tuple[int, ...] | None, kind: np.dtype[Any]
) -> npt.NDArray[Any]:
    info = _stored(archive, name)
    if info.file_size > _HEADER_LIMIT:
        raise ValueError(f"{name} is larger than {counted(_HEADER_LIMIT, 'byte')}")
    with archive.open(info) as member:
        found = _expect(member, shape, kind)
        return np.frombuffer(member.read(), kind).reshape(found)


def _expect(member: IO[bytes], shape: tuple[int, ...] | None, kind: np.dtype[Any]) -> tuple[int, ...]:
    """Read and check the array header of a member."""
    if np.lib.format.read_magic(member) != (1, 0):
        raise ValueError("an array is not of NumPy's format 1.0")
    found, fortran, found_kind = np.lib.format.read_array_header_1_0(member)
    if fortran or found_kind != kind or (shape is not None and found != shape):
        raise ValueError(f"an array is {found_kind} {found}, not {kind} {shape}")
    return tuple(found)


def _fill(member: IO[bytes], array: npt.NDArray[Any]) -> None:
    flat = array.reshape(-1)
    step = 1 << 20
    for first in range(0, len(flat), step):
        part = flat[first : first + step]
        data = member.read(part.nbytes)
        if len(data) != part.nbytes:
            raise EOFError("the file ends too early")
        part[:] = np.frombuffer(data, array.dtype.newbyteorder("<"))
