"""Two workers differ: who is wrong? Asked again, a worker that is broken mostly contradicts itself.

Order of evidence: whoever contradicts itself or fails at it is wrong. Of the others, those whose answer is that of most
drivers are right: devices of one driver run the same programs, so they are one witness, unless that driver is all there
is. Where that leaves a draw, each is put to the probe, whose result is known. Whoever fails it is wrong, if another
passes. Else nobody can tell.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field

from clrender.scheduling.spot_check import Piece

__all__ = ["Dispute", "judge"]


def judge(answers: Mapping[int, Sequence[bytes]], drivers: Sequence[str]) -> tuple[set[int], set[int]]:
    """Who is wrong, and between whom that cannot be told from their answers.

    Parameters
    ----------
    answers : mapping of int to sequence of bytes
        All that each worker answered; an empty sequence where it failed.
    drivers : sequence of str
        Of all workers.

    Returns
    -------
    wrong, undecided : set of int
        One of them is empty at least, unless some contradict themselves and the others are undecided.
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
    """A piece that came out differently, until it is decided who is wrong.

    Attributes
    ----------
    piece : Piece
        With the answer of the worker that did it first.
    other : int
        Who checked it.
    answers : dict of int to list of bytes
    waiting : dict of int to int
        How many answers are still to come from each worker that is asked.
    passed : dict of int to bool
        Who was put to the probe, and how that went.
    """

    piece: Piece
    other: int
    answers: dict[int, list[bytes]] = field(default_factory=dict)
    waiting: dict[int, int] = field(default_factory=dict)
    passed: dict[int, bool] = field(default_factory=dict)

    @property
    def parties(self) -> tuple[int, int]:
        """Who differs."""
        return self.piece.worker, self.other

    @property
    def answered(self) -> bool:
        """Whether nobody is waited for."""
        return not any(self.waiting.values())

    def ask(self, worker: int, times: int) -> None:
        """So many answers of a worker will come."""
        self.waiting[worker] = times
        self.answers.setdefault(worker, [])

    def heard(self, worker: int, answer: bytes | bool) -> None:
        """An answer of a worker: what the piece came to, or how its probe went."""
        self.waiting[worker] = max(0, self.waiting.get(worker, 0) - 1)
        if isinstance(answer, bool):
            self.passed[worker] = answer and self.passed.get(worker, True)
        else:
            self.answers[worker].append(answer)

    def left(self, worker: int) -> None:
        """A worker failed, or is gone: of the two that differ it counts as wrong, others no longer count."""
        if self.waiting.pop(worker, 0) == 0 and worker not in self.parties:
            return
        if worker in self.parties:
            self.answers[worker] = []
            self.passed.pop(worker, None)
        else:
            self.answers.pop(worker, None)

    def after_probe(self, undecided: Collection[int]) -> set[int]:
        """Of those that the probe was put to, who is wrong: all, where it cannot tell."""
        failed = {worker for worker in undecided if not self.passed.get(worker, False)}
        return failed if 0 < len(failed) < len(undecided) else set(undecided)
