"""What is computed before the first sample: by an integrator for a render, and for its kernels on each device."""

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
    """What a pipeline's kernels take beside the scene, on one device."""

    def arguments(self, sample: int) -> Sequence[Argument]:
        """What the kernel takes after its own parameters, for this sample of the pixels (and any after it, unless the
        pipeline goes sample by sample). The queue is empty on return."""

    def take_rays(self) -> int:
        """Rays traced for that since this was last asked."""

    def release(self) -> None:
        """Give the device's memory back."""


@dataclass(frozen=True)
class Request:
    """What an integrator may ask about before it renders.

    Attributes
    ----------
    scene : Scene
    flat : FlatScene
        Of the scene.
    settings : RenderSettings
    pipeline : Pipeline
        The integrator's.
    devices : sequence of Device
    launch : LaunchConfig
    notify : callable
        Told, in a line, what the user may want to know.
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
    """What an integrator renders with.

    Attributes
    ----------
    flat : FlatScene
        The request's, or another in its place.
    pipeline : Pipeline
    on_device : callable, optional
        Makes what the pipeline needs on a device, given the worker there.
    """

    flat: FlatScene
    pipeline: Pipeline
    on_device: Callable[[DeviceWorker], DevicePreparation] | None = None
