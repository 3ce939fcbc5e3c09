"""What the rest of the host knows of an integrator."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Final

from clrender.device.pipeline import Pipeline, Preparation

if TYPE_CHECKING:
    from clrender.device import Device
    from clrender.device.worker import DeviceWorker, LaunchConfig
    from clrender.flatten import FlatScene
    from clrender.scene import Scene
    from clrender.settings import RenderSettings

__all__ = [
    "BETWEEN_DIFFUSE",
    "CAUSTICS",
    "ENVIRONMENT_ON_DIFFUSE",
    "SOFT_SHADOWS",
    "Integrator",
    "Prepared",
    "Request",
]

BETWEEN_DIFFUSE: Final = "light between diffuse surfaces"
CAUSTICS: Final = "caustics"
SOFT_SHADOWS: Final = "soft shadows"
ENVIRONMENT_ON_DIFFUSE: Final = "the environment on diffuse surfaces"


@dataclass(frozen=True)
class Request:
    """What an integrator may ask about before it renders.

    Attributes
    ----------
    scene : Scene
    flat : FlatScene
        Of the scene.
    settings : RenderSettings
    devices : sequence of Device
    launch : LaunchConfig
    notify : callable
        Told, in a line, what the user may want to know.
    should_stop : callable
    """

    scene: Scene
    flat: FlatScene
    settings: RenderSettings
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
    on_device: Callable[[DeviceWorker], Preparation] | None = None


@dataclass(frozen=True)
class Integrator:
    """A way to follow light.

    Attributes
    ----------
    pipeline : Pipeline
        Its kernels.
    leaves_out : tuple of str
        Light that it does not find, however many samples it takes.
    bias : str
        Of the light it does find: ``unbiased``, ``consistent`` (the error of the mean falls as samples are added) or
        ``discretised`` (it falls with the size of patches).
    takes : mapping of str to tuple
        Values of settings that it takes, where it does not take all.
    fixed : mapping of str to object
        Values of settings that its kernels are given, whatever the user says of other integrators.
    auto_light_sampler : str
        What the light sampler ``auto`` stands for.
    prepare : callable, optional
        Computes what it needs before the first sample; without it, that is the scene alone.
    """

    pipeline: Pipeline
    leaves_out: tuple[str, ...] = ()
    bias: str = "unbiased"
    takes: Mapping[str, tuple[object, ...]] = field(default_factory=dict)
    fixed: Mapping[str, object] = field(default_factory=dict)
    auto_light_sampler: str = "auto"
    prepare: Callable[[Request], Prepared] | None = None

    def prepared(self, request: Request) -> Prepared:
        """What it renders a request with."""
        return self.prepare(request) if self.prepare else Prepared(request.flat, self.pipeline)
