"""Light paths: for each sample of the pixels, traced on the device before that sample is taken."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import TYPE_CHECKING, Final

import numpy as np
import numpy.typing as npt

from clrender import layout
from clrender.bidirectional.listed_splats import ListedSplats
from clrender.device.prepared import Prepared, Request
from clrender.flatten.interiors import has_volumes

if TYPE_CHECKING:
    from clrender.device.device import Argument, Buffer
    from clrender.device.worker import DeviceWorker
    from clrender.film.unit import Unit
    from clrender.flatten.flat_scene import FlatScene

__all__ = ["LightPaths", "prepare"]

_VERTEX_BYTES: Final = 64
_MOST_KEPT: Final = 1 << 14
"""Light paths of a sample whose vertices are kept to join with: 8 MiB, which a processor's cache may hold."""
_MOST_TRACED: Final = 1 << 17
"""Light paths of a launch."""


def light_paths_per_item(lanes: int) -> int:
    """Paths that a work-item traces: ``LIGHT_PATHS_PER_ITEM`` of ``kernels/bidirectional/light_paths.cl``."""
    return 1 if lanes == 1 else 16 * lanes


class LightPaths:
    """The light paths of a render on one device; those of one sample are in memory at a time.

    Paths of sample `n` are a function of the scene, the settings and `n`, so every device that traces them gets the
    same bits. What they bring to the pixels of a unit is part of these pixels' samples, whatever else is rendered: so a
    device traces all of them for each of its units.

    Parameters
    ----------
    worker : DeviceWorker
        The paths are traced in its scene.
    flat : FlatScene
        The same scene.
    count : int
        Light paths for each sample of all pixels.
    """

    def __init__(self, worker: DeviceWorker, flat: FlatScene, count: int) -> None:
        self._worker = worker
        self._count = count
        self._kept = min(count, _MOST_KEPT)
        more: dict[str, int | str] = {"LIGHTS_IN_MEDIA": 1} if has_volumes(flat.arrays) else {}
        self._listed = ListedSplats(worker) if worker.lists_splats else None
        if self._listed is not None:
            more["SPLATS_LISTED"] = 1
        self._program = worker.program("bidirectional/light_paths.cl", more)
        self._dark = flat.light_count == 0
        self._unit: Unit | None = None
        self._splats: Buffer | None = None
        self._ready: int | None = None
        self._rays = 0
        device = worker.device
        self._vertices = device.empty(_VERTEX_BYTES * layout.LIGHT_VERTICES * self._kept)
        self._counts = device.empty(4 * self._kept)
        device.write(self._counts, np.zeros(self._kept, np.uint32))
        # Lanes that ask for no vertex read the first one, and compute along
        device.write(self._vertices, np.zeros(self._vertices.nbytes, np.uint8))
        self._held = [self._vertices, self._counts]

    def take_rays(self) -> int:
        """Number of rays traced since the last call."""
        rays, self._rays = self._rays, 0
        return rays

    def begin_unit(self, unit: Unit, splats: Buffer) -> None:
        """Splat into the pixels of this unit from here on.

        Parameters
        ----------
        unit : Unit
        splats : Buffer
            (slots, 3, 4) uint32, zero: 128-bit sums, the lowest word first.
        """
        self._unit, self._splats, self._ready = unit, splats, None

    def arguments(self, sample: int) -> Sequence[Argument]:
        """The light paths of this sample of every pixel, as arguments of ``kernels/integrator/bdpt.cl``."""
        if self._ready != sample:
            self._trace(sample)
            self._ready = sample
        return [self._vertices, self._counts, np.uint32(self._kept)]

    def _trace(self, sample: int) -> None:
        unit, splats = self._unit, self._splats
        if self._dark or unit is None or splats is None:
            return
        for first in range(0, self._count, _MOST_TRACED):
            last = min(first + _MOST_TRACED, self._count)
            span = [np.uint32(number) for number in (sample, first, last, unit.first_slot, unit.slot_count)]
            self._rays += self._launch(span, splats)
            if self._listed is not None:
                self._listed.keep(sample, partial(self._list_again, span, splats.nbytes))

    def _launch(self, span: Sequence[np.uint32], splats: Buffer) -> int:
        """Trace the light paths of a span: sample, first, last, and the slots of the unit; returns the rays."""
        worker, device = self._worker, self._worker.device
        items = worker.padded(-(-int(span[2] - span[1]) // light_paths_per_item(worker.lanes)))
        rays, traced = device.empty(4 * items), np.empty(items, np.uint32)
        arguments: list[Argument] = [*span, splats, self._vertices, self._counts, np.uint32(self._kept), rays]
        worker.launch(
            self._program, "light_paths", items, [*arguments, *(self._listed.arguments() if self._listed else ())]
        )
        device.read(rays, traced)
        device.release(rays)
        return int(traced.sum(dtype=np.uint64))

    def _list_again(self, span: Sequence[np.uint32], nbytes: int) -> None:
        """Trace them for the list alone; their splats were added before."""
        nowhere = self._worker.device.empty(nbytes)
        self._launch(span, nowhere)
        self._worker.device.release(nowhere)

    def take_splats(self) -> npt.NDArray[np.uint32] | None:
        """The splats since the last call; see `ListedSplats.take`. None: they are not listed."""
        return None if self._listed is None else self._listed.take()

    def recorded_splats(self, splats: npt.NDArray[np.uint32]) -> npt.NDArray[np.uint32]:
        """The light paths of some of them; see `ListedSplats.recorded`."""
        assert self._listed is not None, "there are some"
        return self._listed.recorded(splats)

    def release(self) -> None:
        """Release the device memory."""
        for buffer in self._held:
            self._worker.device.release(buffer)
        if self._listed is not None:
            self._listed.release()
        self._held, self._ready = [], None


def prepare(request: Request) -> Prepared:
    """Prepare light paths on each device."""
    count = request.settings.light_paths or request.settings.width * request.settings.height
    return Prepared(request.flat, request.pipeline, partial(LightPaths, flat=request.flat, count=count))
