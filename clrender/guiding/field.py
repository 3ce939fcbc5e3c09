"""The guiding field as data: an octree with histograms of directions, and its file."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from clrender import layout
from clrender.errors import UsageError
from clrender.files.access import UnreadableFile, atomic_write, open_input
from clrender.files.npy import read_npy_header, read_npy_items, write_npy

__all__ = ["FACES", "MOST_NODES", "GuidingField", "cell_rows", "empty_field", "histogram_words", "octets"]

FACES: Final = 7
"""Cells of a leaf: for surfaces that face along +x, -x, +y, -y, +z and -z, and for media."""
MOST_NODES: Final = 1 << 20
"""So that the place of a cell and a bin fit into one word (``RECORD_ROW_PLACE``)."""

_FORMAT: Final = 0x31444C46
"""First word of a file: ``FLD1``."""
_HEAD: Final = 7

_BINS: Final = layout.columns("FIELD")["BINS"]
_SHARES: Final = layout.columns("FIELD")["SHARES"]
_GUIDED: Final = layout.columns("FIELD")["GUIDED"]
_REFLECTED: Final = layout.columns("FIELD")["REFLECTED"]
_OUTGOING: Final = layout.columns("FIELD")["OUTGOING"]
_LIGHT: Final = layout.columns("FIELD")["LIGHT"]


@dataclass(frozen=True, eq=False)
class GuidingField:
    """A frozen field, as kernels read it (``kernels/guiding/field.h``).

    Attributes
    ----------
    nodes : (n, 8) uint32
        Of an inner node, the nodes of its octants, of which leaves have the bit `clrender.layout.FIELD_LEAF`; of a
        leaf, its cells, or `clrender.layout.NONE`. Node 0 is the root, and an inner node.
    cells : (c, `clrender.layout.FIELD_WORDS`) uint32
        Rows ``FIELD`` of `clrender.layout`; at least one, even if no leaf refers to it.
    frame : (4,) float32
        Lowest corner of the box, metres, and the inverse of its side.
    """

    nodes: npt.NDArray[np.uint32]
    cells: npt.NDArray[np.uint32]
    frame: npt.NDArray[np.float32]

    @property
    def words(self) -> npt.NDArray[np.uint32]:
        """(w,) uint32: everything, as files hold it."""
        head = np.array([_FORMAT, len(self.nodes), len(self.cells)], np.uint32)
        parts = [head, self.frame.view(np.uint32), self.nodes.ravel(), self.cells.ravel()]
        return np.concatenate(parts).astype("<u4", copy=False)

    @property
    def cell_count(self) -> int:
        """Number of cells that leaves refer to."""
        return int((self.nodes[self._leaves()][:, :FACES] != layout.NONE).sum())

    @property
    def nbytes(self) -> int:
        """Bytes on a device."""
        return self.nodes.nbytes + self.cells.nbytes

    def sha256(self) -> str:
        """Hash of the field; fields of equal hashes guide alike."""
        return hashlib.sha256(self.words.tobytes()).hexdigest()

    def save(self, path: str | Path) -> None:
        """Write the field to a file in NumPy's format.

        Raises
        ------
        UsageError
            When the file cannot be written.
        """
        with atomic_write(path) as file:
            write_npy(file, self.words)

    @classmethod
    def read(cls, path: str | Path) -> GuidingField:
        """Read a field that `save` wrote.

        Raises
        ------
        UsageError
            When the file cannot be read, or is no valid field.
        """
        try:
            with open_input(path) as file:
                header = read_npy_header(file)
                if header.kind != np.dtype("<u4") or len(header.shape) != 1:
                    raise ValueError(f"it holds {header}")
                return cls.of_words(read_npy_items(file, header))
        except UnreadableFile as error:
            raise UsageError(f"{path}: {error}") from None
        except ValueError as error:
            raise UsageError(
                f"{path}: is no guiding field ({error}); make one with --save-guiding-field of this version of clrender"
            ) from None

    @classmethod
    def of_words(cls, words: npt.NDArray[np.uint32]) -> GuidingField:
        """The field that `words` are of.

        Raises
        ------
        ValueError
            When they are of none: a field that contradicts itself would make images wrong.
        """
        if len(words) < _HEAD or words[0] != _FORMAT:
            raise ValueError("it does not begin as one")
        node_count, cell_count = int(words[1]), int(words[2])
        split = _HEAD + 8 * node_count
        if len(words) != split + layout.FIELD_WORDS * cell_count:
            raise ValueError("it is not as long as its numbers of nodes and cells say")
        if not (0 < node_count <= MOST_NODES and cell_count):
            raise ValueError("it has no nodes or no cells, or too many")
        words = words.astype(np.uint32)
        nodes, cells = words[_HEAD:split].reshape(-1, 8), words[split:].reshape(-1, layout.FIELD_WORDS)
        field = cls(nodes, cells, words[3:_HEAD].view(np.float32))
        field._check()
        return field

    def _leaves(self) -> npt.NDArray[np.int64]:
        """Numbers of the leaves, by a walk from the root; every node is reached once."""
        leaves, level = [np.zeros(0, np.int64)], np.zeros(1, np.int64)
        for _ in range(layout.FIELD_LEVELS):
            if not len(level):
                break
            children = self.nodes[level].ravel()
            leaf = children >= layout.FIELD_LEAF
            leaves.append((children[leaf] & np.uint32(layout.FIELD_LEAF - 1)).astype(np.int64))
            level = children[~leaf].astype(np.int64)
            if len(level) and level.max() >= len(self.nodes):
                raise ValueError("a node has a child that is not there")
            if sum(map(len, leaves)) + len(level) > len(self.nodes):
                raise ValueError("its nodes are no tree")
        if len(level):
            raise ValueError("its tree is too deep")
        return np.concatenate(leaves)

    def _check(self) -> None:
        if not np.isfinite(self.frame).all() or not self.frame[3] > 0.0:
            raise ValueError("its box is none")
        leaves = self._leaves()
        if len(leaves) and leaves.max() >= len(self.nodes):
            raise ValueError("a node has a child that is not there")
        named = self.nodes[leaves][:, :FACES]
        if (named[named != layout.NONE] >= len(self.cells)).any():
            raise ValueError("a leaf has a cell that is not there")
        numbers = self.cells[:, _GUIDED : _LIGHT + 1].view(np.float32)
        light = numbers[:, _LIGHT - _GUIDED]
        known = (numbers >= 0.0).all() and np.isin(numbers[:, 0], (0.0, 0.25, 0.5, 0.75)).all()
        if not (np.isfinite(numbers).all() and known and (light > 0.0).all() and (light <= 1.0).all()):
            raise ValueError("a number of a cell is not allowed")
        of_bins, shares = octets(self.cells[:, _BINS : _BINS + 64]), octets(self.cells[:, _SHARES : _SHARES + 64])
        for begin in range(0, len(self.cells), 4096):
            part = of_bins[begin : begin + 4096].astype(np.int64)
            flat = part + layout.FIELD_BINS * np.arange(len(part))[:, None]
            counted = np.bincount(flat.ravel(), minlength=part.size).reshape(part.shape)
            guided = numbers[begin : begin + 4096, 0] > 0.0
            if (counted != shares[begin : begin + 4096])[guided].any():
                raise ValueError("a cell's histogram contradicts its samples")


def octets(words: npt.NDArray[np.uint32]) -> npt.NDArray[np.uint8]:
    """(c, 64) uint32 as (c, 256) numbers of eight bits, the lowest of a word first."""
    return np.ascontiguousarray(words).astype("<u4").view(np.uint8)


def histogram_words(weights: npt.NDArray[np.float64]) -> npt.NDArray[np.uint32]:
    """Columns ``BINS`` and ``SHARES`` for histograms.

    Parameters
    ----------
    weights : (c, `clrender.layout.FIELD_BINS`) float64
        Whole numbers of at most 2^52 in sum; of each cell at least one is above 0.

    Returns
    -------
    (c, 128) uint32
    """
    bins = layout.FIELD_BINS
    running = np.cumsum(weights, axis=1)
    ends = np.floor(running / running[:, -1:] * bins + 0.5).astype(np.int64)
    ends[:, -1] = bins
    # A word has room for at most 255 shares of a bin: one of 256 goes to the bin beside it.
    shares = np.diff(ends, axis=1, prepend=0)
    full = np.nonzero(shares.max(axis=1) == bins)[0]
    largest = shares[full].argmax(axis=1)
    shares[full, largest] -= 1
    shares[full, largest ^ 1] += 1
    of_bins = np.repeat(np.tile(np.arange(bins, dtype=np.uint8), len(shares)), shares.ravel()).reshape(-1, bins)
    both = np.concatenate([of_bins, shares.astype(np.uint8)], axis=1)
    result: npt.NDArray[np.uint32] = both.view("<u4").astype(np.uint32)
    return result


def cell_rows(histograms: npt.NDArray[np.uint32], numbers: npt.NDArray[np.float64]) -> npt.NDArray[np.uint32]:
    """Rows of cells.

    Parameters
    ----------
    histograms : (c, 128) uint32
        Of `histogram_words`.
    numbers : (c, 4) float64
        Columns ``GUIDED``, ``REFLECTED``, ``OUTGOING`` and ``LIGHT``.
    """
    rows = np.zeros((max(len(histograms), 1), layout.FIELD_WORDS), np.uint32)
    rows[:, _LIGHT] = np.float32(1.0).view(np.uint32)
    rows[: len(histograms), :128] = histograms
    rows[: len(histograms), _GUIDED : _LIGHT + 1] = numbers.astype(np.float32).view(np.uint32)
    return rows


def empty_field(low: npt.NDArray[Any], side: float) -> GuidingField:
    """The field that knows nothing, over a cube.

    Parameters
    ----------
    low : (3,) array
        Its lowest corner, metres.
    side : float
        Metres.
    """
    nodes = np.full((9, 8), layout.NONE, np.uint32)
    nodes[0] = np.uint32(layout.FIELD_LEAF) | np.arange(1, 9, dtype=np.uint32)
    frame = np.array([*low, 1.0 / side], np.float32)
    return GuidingField(nodes, cell_rows(np.zeros((0, 128), np.uint32), np.zeros((0, 4))), frame)
