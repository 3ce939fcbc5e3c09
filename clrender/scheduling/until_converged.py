"""A run that ends when the error criterion is met. It is tested at fixed sample counts."""

from __future__ import annotations

import dataclasses
from collections import deque
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

from clrender.film import Film
from clrender.film.convergence import Convergence, judge, looks
from clrender.scheduling.policy import Plan
from clrender.scheduling.run import run
from clrender.scheduling.tally import Tally, WorkerTally
from clrender.scheduling.worker import Candidate

if TYPE_CHECKING:
    from clrender.settings import RenderSettings

__all__ = ["run_until_converged"]


def run_until_converged(
    plan: Plan,
    candidates: Sequence[Candidate],
    film: Film,
    settings: RenderSettings,
    take: Callable[..., Tally] = run,
    on_progress: Callable[[int, int], None] | None = None,
) -> tuple[Tally, Convergence]:
    """Render the samples of a plan until enough pixels have small enough errors, or until all are taken.

    Each test depends only on the film, which then holds exactly the samples up to that test. So the render stops at the
    same sample count whichever workers took part and however often it was interrupted. Tests at lower sample counts
    than those of a resumed film are skipped. If a worker turns out to be wrong after it contributed to an earlier test,
    all samples of this run are withdrawn, and the other workers start over.

    Parameters
    ----------
    plan : Plan
        All samples of the render, from 0 on.
    candidates, on_progress
        See `run`.
    film : Film
        A film with replicates; it may already hold some of the samples.
    settings : RenderSettings
        Settings with `error`.
    take : callable
        `run`, with its other arguments bound.

    Returns
    -------
    Tally
        Complete if the error criterion is met or all samples are taken.
    Convergence
        Convergence of the film at the end.
    """
    tally = Tally(complete=True, workers=[WorkerTally(candidate.name) for candidate in candidates])
    able = list(range(len(candidates)))
    before = _copy(film) if len(candidates) > 1 and film.ledger.samples else None
    found: Convergence | None = None
    ahead = deque(looks(settings))
    while ahead:
        samples = ahead.popleft()
        if int(film.ledger.taken().max()) > samples:
            continue
        part = dataclasses.replace(plan, sample_count=samples, wanted=film.ledger.lacking(0, samples))
        found = None
        if part.samples:
            done, rays = tally.samples, tally.rays

            def advance(more: int, more_rays: int, done: int = done, rays: int = rays) -> None:
                if on_progress is not None:
                    on_progress(done + more, rays + more_rays)

            tally.absorb(take(part, [candidates[n] for n in able], film, advance), able)
            wrong = [number for number in able if tally.workers[number].state == "wrong"]
            able = [number for number in able if tally.workers[number].state == "ok"]
            if any(tally.workers[number].samples for number in wrong):
                # The contributions of each worker to earlier tests are not known
                _take_back(film, before)
                tally.take_back()
                ahead = deque(looks(settings) if able else ())
                continue
            if not tally.complete:
                break
        found = judge(film, settings)
        if found.reached:
            break
    return tally, found or judge(film, settings)


def _copy(film: Film) -> Film:
    copy = Film(film.width, film.height, film.request)
    film.copy_to(copy)
    return copy


def _take_back(film: Film, before: Film | None) -> None:
    """Reset a film to an earlier copy, or to an empty film."""
    film.take_out(film)
    if before is not None:
        film.merge(before)
