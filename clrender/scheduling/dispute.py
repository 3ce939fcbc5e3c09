"""Rules that decide which of two workers is wrong when their results differ.

All workers repeat the piece; a broken device mostly gives different results each time. A worker that contradicts
itself, or fails, is wrong. Of the others, those that agree with the majority of drivers are right. Devices of one
driver run the same programs, so they have one vote, unless there is only one driver. In a tie, each worker renders the
probe, whose result is known. Those that fail it are wrong, if another passes; otherwise it cannot be decided.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field

from clrender.scheduling.spot_check import Piece

__all__ = ["Dispute", "judge"]


def judge(answers: Mapping[int, Sequence[bytes]], drivers: Sequence[str]) -> tuple[set[int], set[int]]:
    """Find the workers that are wrong, and those between which the answers cannot decide.

    Parameters
    ----------
    answers : mapping of int to sequence of bytes
        All answers of each worker; an empty sequence if it failed.
    drivers : sequence of str
        Drivers of all workers.

    Returns
    -------
    wrong, undecided : set of int
        At least one of them is empty, unless some workers contradict themselves and the others are undecided.
    """
    wrong = {worker for worker, given in answers.items() if len(set(given)) != 1}
    sides: dict[bytes, set[int]] = defaultdict(set)
    for worker in answers.keys() - wrong:
        sides[answers[worker][0]].add(worker)
    if len(sides) < 2:
        return wrong, set()
    weights = {answer: (len({drivers[worker] for worker in side}), len(side)) for answer, side in sides.items()}
    same_drivers = len({frozenset(drivers[worker] for worker in side) for side in sides.values()}) == 1
    ranked = sorted(sides, key=weights.__getitem__, reverse=True)
    first, second = (weights[answer] if same_drivers else weights[answer][:1] for answer in ranked[:2])
    if first == second:
        return wrong, set().union(*sides.values())
    return wrong | set().union(*(sides[answer] for answer in ranked[1:])), set()


@dataclass
class Dispute:
    """A piece with two different results, until it is decided which worker is wrong.

    Attributes
    ----------
    piece : Piece
        The piece, with the result of the worker that rendered it first.
    other : int
        The worker that checked it.
    answers : dict of int to list of bytes
    waiting : dict of int to int
        Number of pending answers of each worker that was asked.
    passed : dict of int to bool
        Whether each worker that was probed has passed so far.
    """

    piece: Piece
    other: int
    answers: dict[int, list[bytes]] = field(default_factory=dict)
    waiting: dict[int, int] = field(default_factory=dict)
    passed: dict[int, bool] = field(default_factory=dict)

    @property
    def parties(self) -> tuple[int, int]:
        """The two workers whose results differ."""
        return self.piece.worker, self.other

    @property
    def answered(self) -> bool:
        """Whether no answer is pending."""
        return not any(self.waiting.values())

    def ask(self, worker: int, times: int) -> None:
        """Expect this many answers of a worker."""
        self.waiting[worker] = times
        self.answers.setdefault(worker, [])

    def heard(self, worker: int, answer: bytes | bool) -> None:
        """Record an answer of a worker: the digest of its result, or whether it passed the probe."""
        self.waiting[worker] = max(0, self.waiting.get(worker, 0) - 1)
        if isinstance(answer, bool):
            self.passed[worker] = answer and self.passed.get(worker, True)
        else:
            self.answers[worker].append(answer)

    def left(self, worker: int) -> None:
        """Note that a worker failed or is gone: one of the two parties counts as wrong; others no longer vote."""
        if self.waiting.pop(worker, 0) == 0 and worker not in self.parties:
            return
        if worker in self.parties:
            self.answers[worker] = []
            self.passed.pop(worker, None)
        else:
            self.answers.pop(worker, None)

    def after_probe(self, undecided: Collection[int]) -> set[int]:
        """The wrong workers among those that were probed; all of them if the probe cannot decide."""
        failed = {worker for worker in undecided if not self.passed.get(worker, False)}
        return failed if 0 < len(failed) < len(undecided) else set(undecided)
