"""Precomputation before the first sample: by an integrator for a render, and for its kernels on each device."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

from clrender.integrators.descriptor import Pipeline

if TYPE_CHECKING:
    from clrender.device.device import Argument, Device
    from clrender.device.worker import DeviceWorker, LaunchConfig
    from clrender.flatten import FlatScene
    from clrender.scene import Scene
    from clrender.settings import RenderSettings

__all__ = ["DevicePreparation", "Prepared", "Request"]


class DevicePreparation(Protocol):
    """Additional data for a pipeline's kernels on one device."""

    def arguments(self, sample: int) -> Sequence[Argument]:
        """Arguments for the kernel after its own, for this sample of the pixels (and later ones, unless the pipeline
        renders sample by sample). The queue is empty on return."""

    def take_rays(self) -> int:
        """Number of rays traced for this since the last call."""

    def release(self) -> None:
        """Release the device memory."""


@dataclass(frozen=True)
class Request:
    """Input of an integrator's preparation.

    Attributes
    ----------
    scene : Scene
    flat : FlatScene
        The flattened scene.
    settings : RenderSettings
    pipeline : Pipeline
        The integrator's pipeline.
    devices : sequence of Device
    launch : LaunchConfig
    notify : callable
        Called with one line of text for the user.
    should_stop : callable
    """

    scene: Scene
    flat: FlatScene
    settings: RenderSettings
    pipeline: Pipeline
    devices: Sequence[Device]
    launch: LaunchConfig
    notify: Callable[[str], None]
    should_stop: Callable[[], bool]


@dataclass(frozen=True)
class Prepared:
    """Result of an integrator's preparation.

    Attributes
    ----------
    flat : FlatScene
        The request's flattened scene, or a replacement.
    pipeline : Pipeline
    on_device : callable, optional
        Called with the worker of a device; creates the pipeline's data there.
    """

    flat: FlatScene
    pipeline: Pipeline
    on_device: Callable[[DeviceWorker], DevicePreparation] | None = None
