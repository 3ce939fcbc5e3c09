"""Images compared by the means of their parts, over seeds (Welch), all comparisons of a test together (Holm)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np

import clrender
from clrender.agreement.significance import holm
from clrender.scene import Scene
from clrender.statistics.student_t import p_value

__all__ = ["SEEDS", "SIZE", "apart", "judge", "rendered"]

SEEDS: Final = 10
SIZE: Final = (16, 12)
ALARM: Final = 1e-3
"""Chance that a test fails by chance alone."""
PARTS: Final = 3


def parts_of(image: np.ndarray[Any, Any]) -> np.ndarray[Any, Any]:
    """Means of parts of an image."""
    blocks = [each for row in np.array_split(image, PARTS) for each in np.array_split(row, PARTS, axis=1)]
    return np.array([each.mean() for each in blocks] + [image.mean()])


def rendered(session: clrender.Session, what: Scene, first: int, settings: Mapping[str, Any]) -> np.ndarray[Any, Any]:
    """(SEEDS, parts) of images with seeds from `first` on."""
    asked = {"size": SIZE, "keep_film": False, **settings}
    return np.array(
        [parts_of(session.render(what, seed=first + number, **asked).linear) for number in range(SEEDS)], np.float64
    )


def apart(a: np.ndarray[Any, Any], b: np.ndarray[Any, Any]) -> np.ndarray[Any, Any]:
    """Probability of such a difference between means, of each part, where they are the same (Welch)."""
    va, vb = a.var(axis=0, ddof=1) / len(a), b.var(axis=0, ddof=1) / len(b)
    together = np.maximum(va + vb, 1e-30)
    freedom = together**2 / np.maximum(va**2 / (len(a) - 1) + vb**2 / (len(b) - 1), 1e-60)
    difference = a.mean(axis=0) - b.mean(axis=0)
    return np.where(np.abs(difference) < 1e-12, 1.0, p_value(np.abs(difference) / np.sqrt(together), freedom))


def judge(found: Sequence[tuple[str, np.ndarray[Any, Any]]]) -> None:
    """None of these probabilities is too small, for all together."""
    every = np.concatenate([p for _, p in found])
    names = np.concatenate([[name] * len(p) for name, p in found])
    refused = holm(every, ALARM)
    assert not refused.any(), sorted(set(names[refused].tolist()))
