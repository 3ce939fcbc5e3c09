"""What the statistical tests share: the one false-alarm rate, the tests themselves, and what a failure leaves behind.

Seeds are fixed, so a test that passes goes on passing until a kernel changes its bits. Then all is drawn anew, and
`ALARM` is the chance that a correct renderer fails anything at all in this folder. It is shared out once, here: every
`Evidence` method takes one or two *judgements*, each made at `LEVEL`, and a judgement over many numbers at once (the
tiles of an image) corrects for how many they are. Both corrections are Šidák's.

Samples of one pixel are stratified against each other, so their spread says nothing about the error of their mean.
Only *batches* are compared: images of different seeds, or pixels that see the same thing. Each pixel and each seed has
its own scrambling of the sequence, so those are independent.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt
from PIL import Image
from scipy import stats

__all__ = ["ALARM", "JUDGEMENTS", "LEVEL", "ROUNDING", "Evidence", "within"]

ALARM: Final = 1e-3
"""Chance that any test of this folder fails on a correct renderer, each time its bits change."""
JUDGEMENTS: Final = 4000
"""At least as many as are made; `Evidence` refuses to make more."""
LEVEL: Final = -math.expm1(math.log1p(-ALARM) / JUDGEMENTS)
"""Significance of a judgement: 1 - (1 - ALARM)^(1 / JUDGEMENTS), one in four million."""
ROUNDING: Final = 64 * 2.0**-24
"""Relative error allowed beside noise: the result of a few dozen operations in single precision, 3.8e-6."""

Floats = npt.NDArray[np.float64]

_made: dict[str, int] = {}


def within(level: float, count: int) -> float:
    """Significance of each of `count` independent comparisons that are to raise a false alarm with chance `level`."""
    return -math.expm1(math.log1p(-level) / count)


class Evidence:
    """Judges one test's measurements, and writes down what speaks against them.

    Parameters
    ----------
    folder : Path
        A failure's picture or histogram goes here.
    test : str
        Name of the test.
    note : callable
        Told (name, number) of every statistic: normal scores, so that numbers of different kinds can be compared.
    """

    def __init__(self, folder: Path, test: str, note: Callable[[str, object], None]) -> None:
        self.folder = folder
        self.test = test
        self.note = note
        _made[test] = 0

    def mean_is(
        self,
        name: str,
        batches: npt.ArrayLike,
        exact: npt.ArrayLike,
        scale: npt.ArrayLike | None = None,
        rounding: float = ROUNDING,
    ) -> None:
        """The means of independent batches are `exact`: Student's t-test, two judgements when there are many columns.

        Parameters
        ----------
        name : str
        batches : (n,) or (n, k) float
            Rows: independent batches. Columns: independent quantities, such as tiles of an image.
        exact : float or (k,) float
        scale : float or (k,) float, optional
            Magnitude that `rounding` is relative to; that of `exact` when absent.
        rounding : float
            Systematic relative error that single precision may cause.

        Raises
        ------
        AssertionError
            When the largest deviation is too large for chance, or all of them together are.
        """
        rows = np.asarray(batches, np.float64)
        rows = rows[:, None] if rows.ndim == 1 else rows
        wanted = np.broadcast_to(np.asarray(exact, np.float64), rows.shape[1:])
        size = np.abs(wanted if scale is None else np.broadcast_to(np.asarray(scale, np.float64), wanted.shape))
        assert np.isfinite(rows).all(), f"{name}: not all numbers are finite"
        score = _scores(rows, wanted, rounding * size)
        worst = int(np.abs(score).argmax())
        columns = score.size
        self._judge(
            f"{name}: largest",
            float(score[worst]),
            2.0 * stats.norm.sf(abs(score[worst])),
            columns,
            lambda: (
                f"{rows.mean(axis=0)[worst]:.7g} in place of {wanted[worst]:.7g} +- "
                f"{rows.std(axis=0, ddof=1)[worst] / math.sqrt(len(rows)):.2g}"
                + (f" in column {worst} of {columns}" if columns > 1 else ""),
                self._keep_scores(name, rows, wanted, score),
            ),
        )
        if columns > 1:
            chance = float(stats.chi2.sf(np.square(score).sum(), columns))
            self._judge(
                f"{name}: together",
                _normal_score(chance),
                chance,
                1,
                lambda: (
                    f"the {columns} columns together deviate from what is exact by {_rms(score):.3g} standard errors",
                    self._keep_scores(name, rows, wanted, score),
                ),
            )

    def equal(self, name: str, first: npt.ArrayLike, second: npt.ArrayLike, rounding: float = ROUNDING) -> None:
        """Two ways to measure the same thing have the same mean: t-test of the differences, batch by batch.

        Parameters
        ----------
        name : str
        first, second : (n,) or (n, k) float
            As `batches` of `mean_is`. Row i of both may have a seed in common: that only makes the test sharper.
        """
        a, b = np.asarray(first, np.float64), np.asarray(second, np.float64)
        self.mean_is(name, a - b, 0.0, scale=np.abs(a).mean(axis=0), rounding=rounding)

    def histogram(self, name: str, counts: npt.ArrayLike, chances: npt.ArrayLike) -> None:
        """Counts of independent events follow these probabilities: Pearson's χ², cells with few pooled.

        Parameters
        ----------
        name : str
        counts : (...) int
        chances : (...) float
            Same shape; add up to 1.
        """
        seen, expected = np.asarray(counts, np.float64), np.asarray(chances, np.float64)
        assert seen.shape == expected.shape
        assert abs(expected.sum() - 1.0) < 1e-5, f"{name}: the probabilities add up to {expected.sum():.7g}"
        expected = expected / expected.sum() * seen.sum()
        order = np.argsort(expected, axis=None)
        few = int(np.searchsorted(np.cumsum(expected.ravel()[order]), 5.0, side="right")) + 1
        few = max(few, int((expected < 5.0).sum()))
        few = 0 if expected.min() >= 5.0 else few
        pooled = order[:few]
        cells_seen = np.append(seen.ravel()[order[few:]], seen.ravel()[pooled].sum() if few else [])
        cells = np.append(expected.ravel()[order[few:]], expected.ravel()[pooled].sum() if few else [])
        statistic, freedom = float((np.square(cells_seen - cells) / cells).sum()), len(cells) - 1
        assert freedom > 0
        chance = float(stats.chi2.sf(statistic, freedom))
        self._judge(
            name,
            _normal_score(chance),
            chance,
            1,
            lambda: (
                f"chi-squared {statistic:.5g} with {freedom} degrees of freedom",
                self._keep(name, seen, expected),
            ),
        )

    def share(self, name: str, count: int, total: int, chance: float) -> None:
        """So many of `total` independent events had the probability `chance` each: exact binomial test."""
        p = float(stats.binomtest(int(count), int(total), min(max(chance, 0.0), 1.0)).pvalue)
        score = math.copysign(_normal_score(p / 2.0), count - total * chance)
        self._judge(name, score, p, 1, lambda: (f"{count} of {total} in place of {chance * total:.6g}", None))

    def holds(self, name: str, wrong: npt.NDArray[Any], message: str = "") -> None:
        """Nothing left to chance: no element of `wrong` is true."""
        if np.any(wrong):
            path = self._keep(name, wrong, np.zeros(wrong.shape))
            raise AssertionError(f"{name}: {int(np.count_nonzero(wrong))} of {wrong.size} wrong {message}; see {path}")

    def _judge(
        self, name: str, score: float, chance: float, count: int, explain: Callable[[], tuple[str, Path | None]]
    ) -> None:
        _made[self.test] += 1
        assert sum(_made.values()) <= JUDGEMENTS, "more judgements than the false-alarm rate was shared out for"
        self.note(name, round(score, 2))
        level = within(LEVEL, count)
        if not chance >= level:
            message, path = explain()
            where = f"; see {path}" if path else ""
            raise AssertionError(
                f"{self.test}: {name}: {message}: z = {score:.2f}, chance {chance:.2g} below {level:.2g}{where}"
            )

    def _keep_scores(self, name: str, rows: Floats, wanted: Floats, score: Floats) -> Path:
        np.save(self._path(name, "npy"), rows)
        return self._keep(name, rows.mean(axis=0), wanted, score)

    def _keep(self, name: str, seen: npt.NDArray[Any], expected: Floats, score: Floats | None = None) -> Path:
        """A picture of seen, expected and their difference side by side, and the numbers beside it."""
        parts = [_grid(np.asarray(seen, np.float64)), _grid(np.asarray(expected, np.float64))]
        top = max(float(np.abs(parts[1]).max()), float(np.abs(parts[0]).max()), 1e-300)
        difference = _grid(score) if score is not None else parts[0] - parts[1]
        reach = max(float(np.abs(difference).max()), 1e-300)
        panels = [parts[0] / top, parts[1] / top, 0.5 + 0.5 * difference / reach]
        zoom = max(1, 256 // max(parts[0].shape))
        picture = np.concatenate([np.kron(np.clip(p, 0.0, 1.0), np.ones((zoom, zoom))) for p in panels], axis=1)
        path = self._path(name, "png")
        Image.fromarray((picture * 255.0).astype(np.uint8)).save(path)
        np.savez(self._path(name, "npz"), seen=seen, expected=expected)
        return path

    def _path(self, name: str, ending: str) -> Path:
        return self.folder / ("".join(c if c.isalnum() else "-" for c in name) + "." + ending)


def _scores(rows: Floats, wanted: Floats, allowance: Floats) -> Floats:
    """Normal scores of Student's t of each column, after the rounding allowed is taken off."""
    count = len(rows)
    assert count >= 8, "fewer than 8 batches say too little"
    off = rows.mean(axis=0) - wanted
    beyond = np.maximum(np.abs(off) - allowance, 0.0)
    error = rows.std(axis=0, ddof=1) / math.sqrt(count)
    t = np.divide(beyond, error, out=np.where(beyond > 0.0, 1e9, 0.0), where=error > 0.0)
    tail = np.asarray(stats.t.logsf(t, count - 1))
    # Beyond what the normal distribution can express a score of 37 says enough.
    score = np.where(tail > -690.0, stats.norm.isf(np.exp(np.maximum(tail, -690.0))), 37.0)
    return np.asarray(np.copysign(score, off), np.float64)


def _normal_score(chance: float) -> float:
    return float(stats.norm.isf(min(max(chance, 1e-300), 1.0 - 1e-16)))


def _rms(score: Floats) -> float:
    return float(np.sqrt(np.square(score).mean()))


def _grid(values: Floats) -> Floats:
    """Numbers as a picture: two dimensions stay, one becomes as square as it divides."""
    if values.ndim == 2:
        return values
    flat = values.ravel()
    height = next(h for h in range(int(math.sqrt(flat.size)), 0, -1) if flat.size % h == 0)
    return flat.reshape(height, -1)
