"""Says before a render that its integrator does far more work than the image alone would take."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Final, NamedTuple

from clrender.wording import counted

if TYPE_CHECKING:
    from clrender.rendering.job import RenderJob

__all__ = ["effort_told"]

_FAR: Final = 4.0
"""Paths for each path from the camera, beyond which a render is far slower than that of the integrator path."""


class _Paths(NamedTuple):
    """The paths that an integrator traces beside those from the camera."""

    count: Callable[[RenderJob], int]
    words: Callable[[RenderJob], str]
    cure: str


def _light_paths(job: RenderJob) -> int:
    return job.settings.light_paths or job.settings.width * job.settings.height


_PATHS: Final[Mapping[str, _Paths]] = {
    "photon": _Paths(
        lambda job: job.settings.photons * job.sample_count,
        lambda job: f"{counted(job.settings.photons, 'photon')} for each sample",
        "--photons N sets their number",
    ),
    "bdpt": _Paths(
        lambda job: _light_paths(job) * job.sample_count,
        lambda job: f"{counted(_light_paths(job), 'light path')} for each sample",
        "--light-paths N sets their number",
    ),
    "radiosity": _Paths(
        lambda job: job.settings.patches * job.settings.patch_rays,
        lambda job: (
            f"{counted(job.settings.patch_rays, 'ray')} from each of about "
            f"{counted(job.settings.patches, 'patch', 'patches')}"
        ),
        "--patches N and --patch-rays N set their numbers",
    ),
}


def effort_told(job: RenderJob) -> str | None:
    """A line about a render that takes far longer than the same one by path tracing; None for others.

    It counts paths and knows nothing about the machine, so it is the same everywhere.

    Returns
    -------
    str or None
    """
    settings = job.settings
    paths = _PATHS.get(settings.integrator)
    camera = math.prod(job.film_size) * job.sample_count
    if paths is None or not camera or (ratio := paths.count(job) / camera) < _FAR:
        return None
    image = "image" if settings.film_size == (settings.width, settings.height) else "part of the image"
    return (
        f"note: the integrator {settings.integrator} traces {paths.words(job)}, {ratio:.0f} times as many paths as "
        f"from the camera for this {image}, so it is far slower here than the integrator path; {paths.cure}"
    )
