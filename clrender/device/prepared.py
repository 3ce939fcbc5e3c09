"""Precomputation of an integrator for a render, before the first sample."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from clrender.integrators.descriptor import Pipeline

if TYPE_CHECKING:
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
