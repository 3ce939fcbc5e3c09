"""How often the statistical tests may fail on right code, and the t-test they share.

All of them together may raise a false alarm in one of a thousand complete runs with other seeds; with the seeds they
have, they pass or fail the same way on every machine. Each test gets its share by Šidák's correction.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from scipy import stats

__all__ = ["FAMILY_FALSE_ALARMS", "FAMILY_TESTS", "assert_means", "threshold"]

FAMILY_FALSE_ALARMS = 1e-3
FAMILY_TESTS = 400


def threshold() -> float:
    """Two-sided p-value below which one test of the family fails."""
    return float(1.0 - (1.0 - FAMILY_FALSE_ALARMS) ** (1.0 / FAMILY_TESTS))


def assert_means(batches: npt.ArrayLike, expected: npt.ArrayLike, what: str, rounding: float = 2e-6) -> None:
    """Student's t-test of the mean of independent batches against an exact value, channel by channel.

    Parameters
    ----------
    batches : (n, k) array
        Independent estimates of k numbers.
    expected : (k,) array or float
    what : str
        For the message.
    rounding : float
        Relative error that single precision may leave, added to the standard error: an estimator without variance is
        still rounded.
    """
    values = np.asarray(batches, np.float64)
    count = len(values)
    exact = np.broadcast_to(np.asarray(expected, np.float64), values.shape[1:])
    error = values.std(axis=0, ddof=1) / np.sqrt(count) + rounding * np.abs(exact)
    t = (values.mean(axis=0) - exact) / error
    p = 2.0 * stats.t.sf(np.abs(t), count - 1)
    assert (p > threshold()).all(), f"{what}: mean {values.mean(axis=0)}, exact {exact}, t = {t}, p = {p}"
