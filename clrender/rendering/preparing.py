"""What an integrator computes before the first sample of a render."""

from __future__ import annotations

import dataclasses
import importlib
from collections.abc import Callable
from typing import TYPE_CHECKING

from clrender.device.prepared import Prepared, Request

if TYPE_CHECKING:
    import numpy as np
    import numpy.typing as npt

    from clrender.device import Device
    from clrender.device.launch import LaunchConfig
    from clrender.device.preparation import DevicePreparation
    from clrender.device.worker import DeviceWorker
    from clrender.flatten.flat_scene import FlatScene
    from clrender.integrators import Pipeline
    from clrender.rendering.job import RenderJob
    from clrender.rendering.residency import Residency

__all__ = ["prepare"]


def prepare(
    job: RenderJob, flat: FlatScene, residency: Residency, launch: LaunchConfig, should_stop: Callable[[], bool]
) -> Prepared:
    """Do it, and return the scene and the kernels that the integrator renders with.

    What guides paths stays in the session, for the next render of the same job.

    Parameters
    ----------
    job : RenderJob
    flat : FlatScene
        The job's scene.
    residency : Residency
        Its devices do the work.
    launch : LaunchConfig
    should_stop : callable
        If it returns True, the preparation ends early.
    """
    pipeline = job.integrator.pipeline
    if not job.preparation:
        return Prepared(flat, pipeline)
    guided = job.sha256() if job.guided else None
    if guided is not None and residency.guided is not None and residency.guided[0] == guided:
        return dataclasses.replace(residency.guided[1], flat=flat)

    def worker(
        device: Device,
        settings: npt.NDArray[np.void],
        pipeline: Pipeline,
        on_device: Callable[[DeviceWorker], DevicePreparation],
    ) -> DeviceWorker:
        return residency.worker(device, flat, settings, pipeline, launch, on_device)

    request = Request(
        job.scene,
        flat,
        job.settings,
        pipeline,
        residency.devices,
        launch,
        residency.tell,
        should_stop,
        worker,
        job.guiding_field,
    )
    with residency.stages.during("preparing"):
        made: Prepared = importlib.import_module(job.preparation).prepare(request)
    if guided is not None and not should_stop():
        residency.guided = guided, made
    return made
