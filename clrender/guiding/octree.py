"""Growth of the field between rounds of training: leaves with many records are divided."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from clrender import layout
from clrender.guiding.field import FACES, MOST_NODES, GuidingField, cell_rows, histogram_words

__all__ = ["LEAST_RECORDS", "SPLIT_RECORDS", "Growing", "Sums"]

SPLIT_RECORDS: Final = 8000
"""Records of a round above which a leaf is divided."""
LEAST_RECORDS: Final = 400
"""Records of a round from which on one of a leaf's faces has a cell."""
LEAST_LIGHT: Final = 0.125
"""Least probability of light samples: training may have missed what they bring."""
_KNOWN_RECORDS: Final = 32
"""Records from which on the mean of a cell is used."""
_CHILDREN: Final = 4.0
"""Of an octant's records, how many times fewer than of its node's: surfaces pass through half of the eight."""
_TRAINING_SHARE: Final = 0.5
"""Share of directions that are drawn from histograms while others may still be learned."""
_OWN_WEIGHT: Final = 48.0
"""Weight of a bin, beside 1 for each of the sixteen bins of its square: a quarter of a histogram is smoothed."""


@dataclass(frozen=True)
class Sums:
    """Sums of a round of training.

    Attributes
    ----------
    cells : (c, `clrender.layout.TRAINING_SUMS`) float64
        Whole numbers: sums of each cell in units of 2^-`clrender.layout.TRAINING_BITS`.
    records : (n, 8) int64
        Records of each place in the nodes.
    """

    cells: npt.NDArray[np.float64]
    records: npt.NDArray[np.int64]


class Growing:
    """A field that is being trained.

    Parameters
    ----------
    field : GuidingField
        The one that it begins with; it has no cells.
    most_cells : int
    """

    def __init__(self, field: GuidingField, most_cells: int) -> None:
        self._frame, self._most = field.frame, most_cells
        self._nodes = field.nodes.copy()
        self._leaf = np.arange(len(field.nodes)) > 0
        self._level = np.arange(len(field.nodes)).clip(0, 1)
        self._entry = np.array([[0, max(node - 1, 0)] for node in range(len(field.nodes))])
        self._weights = np.zeros((0, layout.FIELD_BINS))
        self._means = np.zeros((0, 2))
        self._squares = np.zeros((0, 4))
        self._counts = np.zeros(0, np.int64)

    def learn(self, sums: Sums) -> None:
        """Replace what cells know by what a round has found; where that is nothing they keep it."""
        count = len(self._weights)
        self._counts = np.zeros(count, np.int64)
        places = self._nodes[self._leaf][:, :FACES]
        named = places != layout.NONE
        self._counts[places[named]] = sums.records[self._leaf][:, :FACES][named]
        cells = sums.cells[:count]
        bins = cells[:, : layout.FIELD_BINS]
        found = bins.sum(axis=1) > 0.0
        self._weights[found] = bins[found]
        known = self._counts >= _KNOWN_RECORDS
        means = cells[:, layout.TRAINING_REFLECTED : layout.TRAINING_OUTGOING + 1] / 2.0**layout.TRAINING_BITS
        self._means[known] = means[known] / self._counts[known][:, None]
        self._squares = cells[:, layout.TRAINING_SQUARES : layout.TRAINING_SQUARES + 4]

    def grow(self, records: npt.NDArray[np.int64], more: float) -> None:
        """Divide leaves, for a round of `more` times as many records; new cells begin with what their leaf's knew."""
        origin, part = self._divide(records[:, :FACES].sum(axis=1) * more)
        leaves = np.nonzero(self._leaf)[0]
        expected = records[origin[leaves]][:, :FACES] * (more * part[leaves])[:, None]
        wanted = np.argwhere(expected >= LEAST_RECORDS)
        if len(wanted) > self._most:
            order = np.argsort(-expected[wanted[:, 0], wanted[:, 1]], kind="stable")
            wanted = wanted[np.sort(order[: self._most])]
        before = self._nodes[leaves[wanted[:, 0]], wanted[:, 1]]
        self._nodes[leaves] = layout.NONE
        self._nodes[leaves[wanted[:, 0]], wanted[:, 1]] = np.arange(len(wanted), dtype=np.uint32)
        was = before != layout.NONE
        weights, means = np.zeros((len(wanted), layout.FIELD_BINS)), np.zeros((len(wanted), 2))
        weights[was], means[was] = self._weights[before[was]], self._means[before[was]]
        self._weights, self._means = weights, means

    def _divide(self, expected: npt.NDArray[np.float64]) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.float64]]:
        """Divide leaves with too many expected records; returns of each node the former one, and its part of it."""
        count = np.where(self._leaf, expected, 0.0).tolist()
        nodes, leaf, level, entry = list(self._nodes), self._leaf.tolist(), self._level.tolist(), self._entry.tolist()
        origin, part = list(range(len(nodes))), [1.0] * len(nodes)
        waiting = deque(sorted(range(len(nodes)), key=lambda node: -count[node]))
        while waiting:
            node = waiting.popleft()
            full = len(nodes) + 8 > min(MOST_NODES, 8 * self._most + 9)
            if count[node] <= SPLIT_RECORDS or level[node] >= layout.FIELD_LEVELS or full:
                continue
            first = len(nodes)
            inherited, (parent, octant) = nodes[node], entry[node]
            nodes[parent][octant] = node
            nodes[node] = np.uint32(layout.FIELD_LEAF) | np.arange(first, first + 8, dtype=np.uint32)
            leaf[node] = False
            for k in range(8):
                nodes.append(inherited.copy())
                leaf.append(True)
                level.append(level[node] + 1)
                entry.append([node, k])
                origin.append(origin[node])
                part.append(part[node] / _CHILDREN)
                count.append(count[node] / _CHILDREN)
                waiting.append(first + k)
        self._nodes, self._leaf = np.array(nodes, np.uint32), np.array(leaf)
        self._level, self._entry = np.array(level), np.array(entry)
        return np.array(origin), np.array(part)

    def field(self, final: bool) -> GuidingField:
        """The field as it is now; if it is final, each cell guides as much as pays, else all alike."""
        known = self._weights.sum(axis=1) > 0.0
        # Whole numbers below 2^52 in sum, whatever was found: 2^24 records of at most 10 in units of 2^-16, times 64.
        squares = self._weights.reshape(-1, 4, 4, 4, 4).sum(axis=(2, 4))
        around = np.broadcast_to(squares[:, :, None, :, None], (len(known), 4, 4, 4, 4)).reshape(self._weights.shape)
        smooth = np.where(known[:, None], _OWN_WEIGHT * self._weights + around, 1.0)
        share = self._shares() if final else np.full(len(known), _TRAINING_SHARE)
        numbers = np.column_stack([np.where(known, share, 0.0), self._means, self._light()])
        return GuidingField(self._nodes, cell_rows(histogram_words(smooth), numbers), self._frame)

    def _light(self) -> npt.NDArray[np.float64]:
        """Probabilities of light samples: 1 where a quarter of what is reflected is light straight from the lights."""
        reflected, outgoing = self._means.T
        direct = 1.0 - reflected / np.where(outgoing > 0.0, outgoing, 1.0)
        return np.where(outgoing > 0.0, (4.0 * direct).clip(LEAST_LIGHT, 1.0), 1.0)

    def _shares(self) -> npt.NDArray[np.float64]:
        """The share of guided directions with the least second moment in the last round, of 0, 1/4, 1/2 and 3/4.

        A cell's own moments count the more, the more records it had; the rest is as in all cells together.
        """
        total = self._squares.sum(axis=0)
        if not total[0] > 0.0:
            return np.zeros(len(self._squares))
        own = self._squares / np.where(self._squares[:, :1] > 0.0, self._squares[:, :1], 1.0)
        trust = 0.1 + 100.0 / self._counts.clip(1)[:, None]
        shares: npt.NDArray[np.float64] = 0.25 * (own + trust * (total / total[0])).argmin(axis=1)
        return shares
