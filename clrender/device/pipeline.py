"""The kernels that make samples of pixels, as a worker launches them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, Protocol

if TYPE_CHECKING:
    from clrender.device.device import Argument

__all__ = ["PATH", "Pipeline", "Preparation"]


@dataclass(frozen=True)
class Pipeline:
    """Kernels that are launched one after the other over the same samples.

    Attributes
    ----------
    entry, kernel : str
        File below the kernels folder, and the kernel in it that makes samples of pixels.
    then : tuple of str
        Kernels of the same file that are launched after it, in order, with the same arguments.
    record_bytes : int
        Memory that these share, for each sample of a launch.
    packets : int
        Packets of paths that its kernel takes turns with where rays part (kernels/core/lane.h).
    sample_by_sample : bool
        A launch makes one sample of each pixel, because something is computed first for that sample of all of them;
        then as much of the image as possible is one unit.
    """

    entry: str
    kernel: str
    then: tuple[str, ...] = ()
    record_bytes: int = 0
    packets: int = 1
    sample_by_sample: bool = False


PATH: Final = Pipeline("integrator/path.cl", "integrator_path", packets=8)
"""Path tracing; what the probe of a device renders with."""


class Preparation(Protocol):
    """What a pipeline needs on a device beside the scene, computed there before it makes samples."""

    def arguments(self, sample: int) -> Sequence[Argument]:
        """What the kernel takes after its own parameters, for this sample of the pixels (and any after it, unless the
        pipeline goes sample by sample). The queue is empty on return."""

    def take_rays(self) -> int:
        """Rays traced for that since this was last asked."""

    def release(self) -> None:
        """Give the device's memory back."""
