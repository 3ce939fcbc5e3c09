"""Precomputation of an integrator for a render, before the first sample."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from clrender.integrators.descriptor import Pipeline

if TYPE_CHECKING:
    import numpy as np
    import numpy.typing as npt

    from clrender.device.device import Device
    from clrender.device.launch import LaunchConfig
    from clrender.device.preparation import DevicePreparation
    from clrender.device.worker import DeviceWorker
    from clrender.flatten.flat_scene import FlatScene
    from clrender.scene import Scene
    from clrender.settings import RenderSettings

__all__ = ["Prepared", "Request"]


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
    worker : callable
        Makes a worker for the scene: of a device, the kernels' settings, a pipeline, and a function that creates the
        pipeline's data there.
    given : Any
        What an earlier preparation gave as its `result`, to be used again; None: there is nothing.
    """

    scene: Scene
    flat: FlatScene
    settings: RenderSettings
    pipeline: Pipeline
    devices: Sequence[Device]
    launch: LaunchConfig
    notify: Callable[[str], None]
    should_stop: Callable[[], bool]
    worker: Callable[
        [Device, npt.NDArray[np.void], Pipeline, Callable[[DeviceWorker], DevicePreparation]], DeviceWorker
    ]
    given: Any = None


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
    stats : mapping
        Entries of the render's statistics, as JSON values.
    result : Any
        What later renders may be given, if anything.
    """

    flat: FlatScene
    pipeline: Pipeline
    on_device: Callable[[DeviceWorker], DevicePreparation] | None = None
    stats: Mapping[str, Any] = field(default_factory=dict)
    result: Any = None
