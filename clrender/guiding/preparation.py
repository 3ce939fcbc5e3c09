"""Guiding in a render: a field is trained or read, and guides the paths on all devices."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import TYPE_CHECKING, Final

from clrender.device.prepared import Prepared, Request
from clrender.guiding.field import GuidingField
from clrender.guiding.training import Trained, train
from clrender.integrators.descriptor import Pipeline

if TYPE_CHECKING:
    from clrender.device.device import Argument
    from clrender.device.worker import DeviceWorker

__all__ = ["PIPELINE", "GuidedPaths", "prepare"]

PIPELINE: Final = Pipeline("integrator/guided.cl", "integrator_guided", packets=8)
_WORTH: Final = 1.25
"""How much less a guided render has to cost by training, for ``auto`` to guide."""


class GuidedPaths:
    """A field on a device, as arguments of ``kernels/integrator/guided.cl``.

    Parameters
    ----------
    worker : DeviceWorker
    field : GuidingField
    """

    def __init__(self, worker: DeviceWorker, field: GuidingField) -> None:
        self._device = worker.device
        self._held = [self._device.upload(field.nodes), self._device.upload(field.cells)]
        self._arguments: list[Argument] = [*self._held, field.frame]

    def arguments(self, sample: int) -> Sequence[Argument]:
        """The same for all samples."""
        return self._arguments

    def take_rays(self) -> int:
        """None: the training's are not of the image."""
        return 0

    def release(self) -> None:
        """Release the device memory."""
        held, self._held = self._held, []
        for buffer in held:
            self._device.release(buffer)


def prepare(request: Request) -> Prepared:
    """Train a field, or take the one of the request; where it does not pay, paths are not guided."""
    given = request.given
    trained = Trained(given, 0, 0, 1.0) if given is not None else train(request)
    field, asked = trained.field, request.settings.guiding
    guided = given is not None or asked == "on" or trained.gain >= _WORTH
    told = {
        "guided": guided,
        "guiding_cells": field.cell_count,
        "guiding_bytes": field.nbytes,
        "guiding_paths": trained.paths,
        "guiding_rays": trained.rays,
        "guiding_gain": round(trained.gain, 3),
        "guiding_sha256": field.sha256(),
    }
    if not guided:
        return Prepared(request.flat, request.pipeline, stats=told)
    complete = given is not None or trained.paths > 0  # else the render stops
    return Prepared(request.flat, PIPELINE, partial(GuidedPaths, field=field), told, field if complete else None)
