"""Sequences of images: the frames of an animation, their names, and which of them are there already."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import click

from clrender.errors import ClrenderError, UsageError
from clrender.limits import shown
from clrender.wording import counted

if TYPE_CHECKING:
    from clrender.rendering.job import RenderJob

__all__ = ["FRAMES_PER_SECOND", "Frames", "can_resume", "check_one", "frames", "is_done", "named"]

FRAMES_PER_SECOND: Final = 24.0
_MOST: Final = 10**6
_NUMBER: Final = re.compile(r"%(0\d)?d")
_EMBEDDED: Final = (".png", ".exr")
"""Extensions of files that say how they were made, as `frames` of a render that is resumed have to."""
_JPEG: Final = frozenset({".jpg", ".jpeg"})


@dataclass(frozen=True)
class Frames:
    """Numbers of frames.

    Attributes
    ----------
    first, last, step : int
        The first, the last, which may be between two, and what to add from one to the next.
    """

    first: int
    last: int
    step: int

    def __iter__(self) -> Iterator[int]:
        return iter(range(self.first, self.last + 1, self.step))

    def __len__(self) -> int:
        return len(range(self.first, self.last + 1, self.step))

    def check(self, outputs: Sequence[Path], others: Mapping[str, object], resume: bool) -> None:
        """Check the names of the outputs, and that nothing is asked for that is of one image.

        Parameters
        ----------
        outputs : sequence of pathlib.Path
            Patterns of names.
        others : mapping of str to object
            Values of options that are for one image.
        resume : bool
            Whether frames that are there are kept.

        Raises
        ------
        UsageError
        """
        for output in outputs:
            if len(_NUMBER.findall(output.name)) != 1 or "%" in _NUMBER.sub("", output.name):
                stem = _NUMBER.sub("", output.stem).replace("%", "").rstrip("_-.") or "frame"
                raise UsageError(
                    f"{output}: with --frames a name has one place for the number of the frame; write one such as "
                    f"{stem}_%04d{output.suffix}"
                )
        for option, value in others.items():
            if value is not None and value is not False:  # 0 is a value
                raise UsageError(f"{option}: is for one image, and --frames makes {len(self)}; leave one of them out")
        if resume and not can_resume(outputs):
            raise UsageError("--resume: of frames only .png and .exr say how they were made; name one of those with -o")
        endings = {output.suffix.lower() for output in outputs}
        if resume and _JPEG.intersection(endings) and ".png" not in endings:
            raise UsageError(
                "--resume: a .jpg does not say by which display settings it was made; name a .png beside it, or in its "
                "place"
            )


def can_resume(outputs: Sequence[Path]) -> bool:
    """Whether one of a frame's files says how it was made."""
    return any(output.suffix.lower() in _EMBEDDED for output in outputs)


def check_one(outputs: Sequence[Path]) -> None:
    """Check that outputs of one image have no place for the number of a frame.

    Raises
    ------
    UsageError
    """
    for output in outputs:
        if place := _NUMBER.search(output.name):
            raise UsageError(
                f"{output}: {place[0]} stands for the number of a frame; name the frames with --frames, such as 1:48"
            )


def frames(value: str) -> Frames:
    """Parse ``A:B`` or ``A:B:S``; used as a click type.

    Raises
    ------
    click.BadParameter
        It is nothing of that kind.
    """
    match = re.fullmatch(r"(-?\d{1,7}):(-?\d{1,7})(?::(\d{1,7}))?", value, re.ASCII)
    if not match:
        raise click.BadParameter(f"{shown(value)} is no range of frames such as 1:48, or 1:48:2 for every second one.")
    found = Frames(int(match[1]), int(match[2]), int(match[3] or 1))
    if found.step < 1 or not 1 <= len(found) <= _MOST:
        raise click.BadParameter(
            f"{shown(value)} holds {counted(max(len(found), 0) if found.step else 0, 'frame')}; name 1 to {_MOST}."
        )
    return found


def named(outputs: Sequence[Path], number: int) -> list[Path]:
    """The outputs of a frame."""
    return [output.with_name(output.name % number) for output in outputs]


def is_done(paths: Sequence[Path], job: RenderJob, how: Mapping[str, Any]) -> bool:
    """Whether the files of a frame are there, and those that say how they were made were made in this way.

    Parameters
    ----------
    paths : sequence of pathlib.Path
    job : RenderJob
    how : mapping
        ``tone_map``, ``exposure``, ``exr_type``, ``exr_compression`` and ``exr_tile`` of files.
    """
    from clrender.image.exposure import photographic_stops
    from clrender.image.files import read_provenance
    from clrender.image.tone_map import record_of
    from clrender.rendering.statistics import asked_layers, layer_stats

    if not all(path.is_file() for path in paths):
        return False
    request = json.loads(json.dumps(job.request()))
    del request["sampler_sha256"]  # a part of the kernels
    exposure = how["exposure"] + photographic_stops(**(job.scene.camera.exposure or {}))
    wanted = {**how, **record_of(how["tone_map"], exposure)}
    layers, told = {*asked_layers(job)}, layer_stats(job)
    for path in paths:
        if path.suffix.lower() not in _EMBEDDED:
            continue
        try:
            said = read_provenance(path) or {}
        except ClrenderError:
            return False
        settings = {name: value for name, value in said.get("settings", {}).items() if name != "spp"}
        made = {**settings, **{name: said.get(name) for name in request if name not in settings}}
        stored, held = said.get("stored", {}), said.get("layers", [])
        if made != request or not _has_samples(said, job):
            return False
        if said.get("denoised") != job.denoise or any(stored[name] != wanted.get(name) for name in stored):
            return False
        is_exr = path.suffix.lower() == ".exr"
        if not (layers if is_exr else layers & {"alpha"}).issubset(held):
            return False
        if is_exr and ("exr_tile" not in stored or any(said.get(name) != value for name, value in told.items())):
            return False  # or of a version that did not record these
    return True


def _has_samples(said: Mapping[str, Any], job: RenderJob) -> bool:
    """Whether an image has the samples of a job, or as many as were enough for the error that it asks for."""
    width, height = job.settings.film_size
    if said.get("samples") == width * height * job.sample_count:
        return True
    asked = {name: getattr(job.settings, name) for name in ("error", "confidence", "share", "error_floor")}
    return job.settings.error is not None and said.get("converged") is True and asked.items() <= said.items()
