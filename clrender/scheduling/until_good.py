"""A run that ends when the image is good enough: look after look, each with all samples up to there in the film."""

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

__all__ = ["run_until_good"]


def run_until_good(
    plan: Plan,
    candidates: Sequence[Candidate],
    film: Film,
    settings: RenderSettings,
    take: Callable[..., Tally] = run,
    on_progress: Callable[[int, int], None] | None = None,
) -> tuple[Tally, Convergence]:
    """Do the work of a plan until enough pixels have small enough errors, or all of it.

    What is decided at a look follows from the film, which then has exactly the samples up to there. So the render stops
    after the same samples whoever computed them, and however often it was interrupted: looks that a resumed film is
    beyond have been taken. A worker that turns out to be wrong after a look to which it has contributed spoils all that
    was done for looks before: that is taken back, and begun anew by the others.

    Parameters
    ----------
    plan : Plan
        All samples of the render, from 0 on.
    candidates, on_progress
        As of `run`.
    film : Film
        With replicates; it may hold some of the samples.
    settings : RenderSettings
        With an error.
    take : callable
        `run`, with whatever else it is to be given.

    Returns
    -------
    Tally
        Complete when enough pixels are good, or there are no more samples to take.
    Convergence
        Of what is in the film now.
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
                # Of earlier looks it is not known who did what
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
    """Leave in a film what was there before, if anything was."""
    film.take_out(film)
    if before is not None:
        film.merge(before)
