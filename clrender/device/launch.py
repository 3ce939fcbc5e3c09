"""How a worker divides its work into launches, and the memory that they share."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from clrender.device.device import Buffer, Device

__all__ = ["SLICE_SECONDS", "LaunchConfig", "Scratch"]

SLICE_SECONDS: Final = 0.15
"""Target duration of a launch: short enough for progress, Ctrl-C and drivers with a watchdog."""


@dataclass(frozen=True)
class LaunchConfig:
    """How work is divided into launches. None of these changes a bit of the image.

    Attributes
    ----------
    lanes : int or None
        Paths per work-item, in SIMD fashion: 1, 4, 8 or 16; None: by the kind of device.
    work_group : int or None
        Work-items in a group.
    samples_per_pass : int or None
        Samples per pixel in one launch; None: adapted during the render.
    traversal : str or None
        ``packet`` (the default) or ``single``.
    slice_seconds : float
        Target duration of a launch. A render stops after at most two launches.
    samples : int or None
        About how many samples the device is to trace; None: many.
    staged : bool
        Whether samples are traced in stages, where an integrator has kernels for that; one path per work-item.
    code : str or None
        Kernels are compiled to ``fast`` code, in less time to ``small`` code, or to fast code for ``any`` scene; None:
        by `samples`.
    stand_ins : bool
        Whether a program for any scene may trace samples while the scene's own is not compiled, if `code` is None.
    prepared : LaunchConfig or None
        The same of what an integrator prepares; None: as this one.
    """

    lanes: int | None = None
    work_group: int | None = None
    samples_per_pass: int | None = None
    traversal: str | None = None
    slice_seconds: float = SLICE_SECONDS
    samples: int | None = None
    staged: bool = False
    code: str | None = None
    stand_ins: bool = False
    prepared: LaunchConfig | None = None

    @property
    def compiled_for(self) -> int | None:
        """Samples to compile kernels for; see `Device.program`."""
        return {"fast": None, "any": None, "small": 0}.get(self.code or "", self.samples)


class Scratch:
    """Buffers of a device that are reused by successive launches and workers.

    Allocating new memory costs more than rendering into it.
    """

    def __init__(self, device: Device) -> None:
        self._device = device
        self._kept: dict[str, Buffer] = {}

    def buffer(self, name: str, nbytes: int) -> Buffer:
        """The buffer with this name, of at least `nbytes` bytes, with undefined contents."""
        kept = self._kept.get(name)
        if kept is None or kept.nbytes < nbytes:
            if kept is not None:
                self._device.finish()  # a launch in progress may use it
                self._device.release(self._kept.pop(name))
            kept = self._kept[name] = self._device.empty(nbytes)
        return kept

    def held(self, *names: str) -> int:
        """Bytes of the buffers with these names."""
        return sum(self._kept[name].nbytes for name in names if name in self._kept)

    def give_back(self, *names: str) -> None:
        """Release the buffers with these names."""
        for name in names:
            if (kept := self._kept.pop(name, None)) is not None:
                self._device.release(kept)

    def release(self) -> None:
        """Release all buffers."""
        while self._kept:
            self._device.release(self._kept.popitem()[1])
