"""Arbitration: decides which worker is wrong when two results for the same piece differ."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Final

from clrender.film.unit import UnitSums
from clrender.scheduling.dispute import Dispute, judge
from clrender.scheduling.spot_check import Piece, digest, finished
from clrender.scheduling.work import Kind, Task, Work
from clrender.scheduling.worker import Candidate

__all__ = ["Arbitration"]

_TIMES: Final = 6
"""Repetitions of a piece by each worker, enough for one that errs sometimes to give different results."""
_PROBES: Final = 3
"""Renders of the probe's tile by each worker, for the same reason."""


class Arbitration:
    """Settles disputes between workers, one at a time.

    Parameters
    ----------
    candidates : sequence of Candidate
    work : Work
        Used to give orders to workers.
    exclude : callable
        Called with a worker that is wrong, and the reason.
    """

    def __init__(self, candidates: Sequence[Candidate], work: Work, exclude: Callable[[int, str], None]) -> None:
        self._candidates = candidates
        self._work = work
        self._exclude = exclude
        self._dispute: Dispute | None = None
        self._later: list[tuple[Piece, int, bytes]] = []
        self._undecided: set[int] = set()
        self._excluded: set[int] = set()

    @property
    def undecided(self) -> str:
        """Names of the workers of the open dispute; empty if there is none."""
        return self._names(self._dispute.parties) if self._dispute else ""

    def open(self, piece: Piece, other: int, result: UnitSums) -> None:
        """Open a dispute, or queue it: another worker's result for a piece differs."""
        self._open(piece, other, digest(result))

    def _open(self, piece: Piece, other: int, answer: bytes) -> None:
        if not self._excluded.isdisjoint((piece.worker, other)):
            return  # the results of excluded workers are withdrawn already; those of hung workers are not
        if self._dispute is not None:
            self._later.append((piece, other, answer))
            return
        self._dispute = dispute = Dispute(piece, other)
        self._work.dispute(True)
        voters = self._work.in_service()
        for worker in voters:
            dispute.ask(worker, _TIMES)
            for _ in range(_TIMES):
                self._work.order(worker, Kind.REPEAT, piece)
        for party, said in zip(dispute.parties, (piece.answer, answer), strict=True):
            dispute.answers.setdefault(party, []).append(said)
        for party in set(dispute.parties) - voters:
            self.left(party)

    def hear(self, task: Task, result: UnitSums | bool | None) -> None:
        """Take in a worker's answer in the open dispute."""
        dispute = self._dispute
        if dispute is None:
            return
        if task.kind is Kind.PROBE:
            dispute.heard(task.worker, bool(result))
        elif isinstance(result, UnitSums) and task.piece is dispute.piece and finished(task.piece.unit, result):
            dispute.heard(task.worker, digest(result))
        else:
            return
        self._decide()

    def left(self, worker: int) -> None:
        """Note that a worker failed or is gone."""
        if self._dispute is not None:
            self._dispute.left(worker)
            self._decide()

    def _decide(self) -> None:
        dispute = self._dispute
        if dispute is None or not dispute.answered:
            return
        if not self._undecided:
            wrong, self._undecided = judge(dispute.answers, [each.driver for each in self._candidates])
            for worker in sorted(wrong):
                self._excluded.add(worker)
                self._exclude(worker, _reason(dispute.answers[worker]))
            if self._undecided:
                for worker in sorted(self._undecided):
                    dispute.ask(worker, _PROBES)
                    for _ in range(_PROBES):
                        self._work.order(worker, Kind.PROBE)
                return
            if not wrong:
                raise AssertionError("whoever differs once either contradicts itself or differs from another")
        else:
            wrong = dispute.after_probe(self._undecided)
            between = self._names(sorted(self._undecided))
            why = "it fails the probe that every device has to pass"
            if wrong == self._undecided:
                why = (
                    f"{between} give different results for the same samples, each the same every time, and the probe "
                    "does not tell which is right; render on one of them alone, or on a third"
                )
            for worker in sorted(wrong):
                self._excluded.add(worker)
                self._exclude(worker, why)
        self._close()

    def _close(self) -> None:
        self._dispute, self._undecided = None, set()
        later, self._later = self._later, []
        for piece, other, answer in later:
            self._open(piece, other, answer)
        self._work.dispute(self._dispute is not None)

    def _names(self, workers: Sequence[int]) -> str:
        return " and ".join(self._candidates[worker].name for worker in workers)


def _reason(answers: Sequence[bytes]) -> str:
    if not answers:
        return "another device gets a different one, and it failed when it was to do that again"
    if len(set(answers)) > 1:
        return "it gets different ones each time"
    return "other drivers agree on different ones"
