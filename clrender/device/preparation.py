"""What a pipeline's kernels need on each device beside the scene."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    from clrender.device.device import Argument

__all__ = ["DevicePreparation"]


class DevicePreparation(Protocol):
    """Additional data for a pipeline's kernels on one device."""

    def arguments(self, sample: int) -> Sequence[Argument]:
        """Arguments for the kernel after its own, for this sample of the pixels (and later ones, unless the pipeline
        renders sample by sample). The queue is empty on return."""

    def take_rays(self) -> int:
        """Number of rays traced for this since the last call."""

    def release(self) -> None:
        """Release the device memory."""
