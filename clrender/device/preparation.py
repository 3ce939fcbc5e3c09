"""What a pipeline's kernels need on each device beside the scene."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Protocol, runtime_checkable

if TYPE_CHECKING:
    import numpy as np
    import numpy.typing as npt

    from clrender.device.device import Argument, Buffer
    from clrender.film.unit import Unit

__all__ = ["DevicePreparation", "SplattingPreparation"]


class DevicePreparation(Protocol):
    """Additional data for a pipeline's kernels on one device."""

    def arguments(self, sample: int) -> Sequence[Argument]:
        """Arguments for the kernel after its own, for this sample of the pixels (and later ones, unless the pipeline
        renders sample by sample). The queue is empty on return."""

    def take_rays(self) -> int:
        """Number of rays traced for this since the last call."""

    def release(self) -> None:
        """Release the device memory."""


@runtime_checkable
class SplattingPreparation(DevicePreparation, Protocol):
    """The same for pipelines that splat: it adds to the pixels of a unit."""

    def begin_unit(self, unit: Unit, splats: Buffer) -> None:
        """Splat into the pixels of this unit from here on: (slots, 3, 4) uint32 of 128-bit sums, lowest word first."""

    def take_splats(self) -> npt.NDArray[np.uint32] | None:
        """The splats since the last call, where the worker lists them; see `UnitSums.listed`."""

    def recorded_splats(self, splats: npt.NDArray[np.uint32]) -> npt.NDArray[np.uint32]:
        """The light paths of some of these: (n, `INSPECT_ROWS`, `INSPECT_WORDS`) uint32."""
