"""Path tracing in stages: kernels of one step each, which are launched in turn for many paths at once."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from typing import TYPE_CHECKING, Final

import numpy as np

if TYPE_CHECKING:
    from clrender.device.device import Argument, Buffer, Device

__all__ = ["StagedTracing"]

_STAGES: Final = ("extend", "light", "scatter", "shadow", "begin")
_MASKED_STAGES: Final = ("extend", "masked", "light", "scatter", "shadow", "masked_shadow", "begin")
"""Steps of a round, in order, in a scene without masked surfaces, and in others; the last prepares the next round."""
_BLOCK: Final = 32
"""Paths whose states lie side by side (kernels/staged/state.h)."""
_SHARE: Final = 8
"""The part of a limit's free memory that paths under way may take."""
_STATS_BYTES: Final = 16
"""Bytes of statistics per path."""
_MOST_ROUNDS: Final = 16
"""Rounds between two looks at whether any path is left."""
_COUNTS: Final = 2
"""Counters that the host reads: samples that were handed out, and active paths."""


class StagedTracing:
    """The kernels and buffers with which a device traces the samples of launches in stages (kernels/staged/stage.h).

    The samples are those of the kernel for whole paths, bit for bit.

    Parameters
    ----------
    device : Device
    macros : mapping of str to int or str
        With which the kernels are compiled; of one lane.
    group : int
        Work-items of a group.
    samples : int or None
        See `Device.program`.
    paths : int
        Number of paths that are traced side by side, at most; fewer where memory is limited.

    Attributes
    ----------
    paths : int
        That number, in whole groups and blocks.
    waits : bool
        Whether `trace` returns only when the samples are there.

    Raises
    ------
    RenderError, DeviceError
        When the device lacks the memory, or its driver fails. Everything is then released.
    """

    waits: Final = True

    def __init__(
        self, device: Device, macros: Mapping[str, int | str], group: int, samples: int | None, paths: int
    ) -> None:
        self._device, self._group = device, group
        stages = _MASKED_STAGES if "OPACITY" in macros else _STAGES
        self._programs = {stage: device.program(f"staged/{stage}.cl", macros, samples) for stage in stages}
        with ExitStack() as undone:
            undone.callback(self.release)
            self._buffers: list[Buffer] = []
            sizes = np.empty(4, np.uint32)
            answer = self._empty(sizes.nbytes)
            device.launch(self._programs["begin"], "stage_sizes", group, group, [answer])
            device.read(answer, sizes)
            words, queues, counters, block = map(int, sizes)
            assert block == _BLOCK, "kernels/staged/state.h"
            whole = int(np.lcm(group, _BLOCK))
            in_room = device.free_bytes / _SHARE / (4 * (words + queues) + _STATS_BYTES)
            self.paths = max(1, -(-int(min(paths, in_room)) // whole)) * whole
            self._state = self._empty(4 * words * self.paths)
            self._queued = self._empty(4 * queues * self.paths)
            self._counters = self._empty(4 * counters)
            self._clear(self._state)  # no path is under way; nor is one after a launch
            undone.pop_all()

    def _empty(self, nbytes: int) -> Buffer:
        buffer = self._device.empty(-(-nbytes // 8) * 8)
        self._buffers.append(buffer)
        return buffer

    def _clear(self, buffer: Buffer) -> None:
        words = np.uint32(buffer.nbytes // 8)
        self._device.launch_each(self._device.common_program(), "film_clear_words", int(words), [buffer, words])

    def improve(self, rays: int) -> None:
        """There is no other program to change to, as `TracingProgram.improve` does."""

    def rows(self, slots: int, samples: int) -> int:
        """Rows of statistics of a launch with so many samples of so many slots: one for each path under way."""
        whole = int(np.lcm(self._group, _BLOCK))
        return min(self.paths, -(-slots * samples // whole) * whole)

    def trace(
        self,
        scene: Sequence[Argument],
        span: Sequence[np.uint32],
        samples: Buffer,
        stats: Buffer,
        more: Sequence[Argument],
    ) -> None:
        """Trace the samples of a launch; returns when no path is left.

        Parameters
        ----------
        scene : sequence
            Arguments of kernels that read the scene.
        span : sequence of numpy.uint32
            First slot, slots, first sample, samples of each.
        samples, stats : Buffer
            Where results go, and the statistics of each of `rows`.
        more : sequence
            Nothing: integrators with kernels in stages prepare nothing.
        """
        slots, each = int(span[1]), int(span[3])
        total, paths = slots * each, self.rows(slots, each)
        arguments = [*scene, *span, samples, stats, self._state, self._queued, self._counters, np.uint32(paths)]
        self._clear(stats)
        self._clear(self._counters)
        counts = np.zeros(_COUNTS, np.uint32)
        items, rounds = paths, 1
        self._launch("begin", paths, arguments)
        while True:
            self._device.read(self._counters, counts)
            taken, active = map(int, counts)
            if taken >= total:
                if not active:
                    return
                items = -(-active // self._group) * self._group  # no path is added any more
            for _ in range(rounds):
                for stage in self._programs:
                    self._launch(stage, paths if stage == "begin" else items, arguments)
            rounds = min(2 * rounds, _MOST_ROUNDS)

    def _launch(self, stage: str, items: int, arguments: Sequence[Argument]) -> None:
        self._device.launch(self._programs[stage], f"stage_{stage}", items, self._group, arguments)

    def release(self) -> None:
        """Release the buffers."""
        while self._buffers:
            self._device.release(self._buffers.pop())
