"""Enforces the memory limit of a render, on the host and on each device."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager

from clrender.aov import GUIDES, channel_count
from clrender.device import Device
from clrender.film.unit import slot_count, tile_side
from clrender.process.memory import ERROR_BYTES, IMAGE_BYTES, check_host, film_bytes, process_bytes, unit_slots
from clrender.process.memory import shown as amount
from clrender.rendering.job import RenderJob
from clrender.scheduling.contributions import MOST_BYTES

__all__ = ["limited", "needs", "told"]

_UNITS_WAITING = 10
"""Units on the host in addition to those that workers hold: some wait to be merged."""

_WORTH_TELLING = 1 << 30


def needs(job: RenderJob, devices: int, *, checkpoint: bool, resumed: bool, held: bool) -> dict[str, int]:
    """Host memory that a render needs at one time, bytes, by purpose.

    Parameters
    ----------
    job : RenderJob
        Its scene has already been flattened.
    devices : int
        Number of devices that share the render.
    checkpoint : bool
        Whether the film is saved during the render.
    resumed : bool
        Whether its film has already been read.
    held : bool
        Whether a device holds a film of its own, of which it delivers copies.
    """
    settings = job.settings
    replicates = settings.replicate_spp is not None
    pixels, pixel_bytes = math.prod(job.film_size), film_bytes(replicates)
    side = tile_side(settings.tile, *job.film_size)
    slots = min(unit_slots(settings.max_memory, replicates) or 0, slot_count(*job.film_size, side))
    layers = channel_count({*job.aov, *(GUIDES if job.denoise else ())})
    return {
        "this program and the scene": process_bytes(),
        "the film": 0 if resumed else pixel_bytes * pixels,
        "a copy of it for the checkpoint": pixel_bytes * pixels * checkpoint,
        "what devices that turn out to be wrong did": pixel_bytes * pixels * (resumed and devices > 1),
        "the image": IMAGE_BYTES * pixels * (2 if job.denoise else 1),
        "layers": (4 * layers + film_bytes(False) * resumed) * pixels if layers else 0,
        "standard errors": ERROR_BYTES * pixels * replicates,
        "units of work": (_UNITS_WAITING + devices) * pixel_bytes * slots,
        "a copy of what the device holds": pixel_bytes * pixels * held,
    }


@contextmanager
def limited(devices: Sequence[Device], limit: int | None, wanted: Mapping[str, int]) -> Iterator[int]:
    """Limit the memory of devices for the duration of a render.

    Parameters
    ----------
    devices : sequence of Device
    limit : int or None
        Bytes, of the host and of each device.
    wanted : mapping of str to int
        See `needs`.

    Yields
    ------
    int
        Bytes that the films of individual devices may take.

    Raises
    ------
    MemoryRefused
        When the host's memory is not enough.
    """
    before = [device.memory_limit for device in devices]
    total = check_host(limit, wanted)
    try:
        if limit is not None:
            for device in devices:
                # The buffers of a CPU device are host memory too
                device.memory_limit = limit - total if device.is_cpu else limit
        yield MOST_BYTES if limit is None else min(MOST_BYTES, limit - total)
    finally:
        for device, each in zip(devices, before, strict=True):
            device.memory_limit = each


def told(job: RenderJob) -> str | None:
    """A message about the memory that a large image will take; None for smaller images."""
    width, height = job.film_size
    pixels = width * height
    wanted = film_bytes(job.settings.replicate_spp is not None) * pixels
    if wanted < _WORTH_TELLING:
        return None
    return (
        f"the exact sums of {width} x {height} pixels take {amount(wanted)} of "
        f"memory, also of a device that adds them up, and the image {amount(IMAGE_BYTES * pixels)} more"
    )
