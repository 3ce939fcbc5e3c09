"""`render()` and `render_batch()`: one session for one job, or for many cameras.

(Not ``render.py``: a module of that name would shadow the function `clrender.render`.)
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Any

from clrender.rendering.job import RenderJob
from clrender.rendering.session import Session
from clrender.rendering.telling import once

if TYPE_CHECKING:
    import numpy as np
    import numpy.typing as npt

    from clrender.device import Device
    from clrender.rendering.rendered_image import Progress, RenderedImage
    from clrender.scene import Camera, Scene

__all__ = ["render", "render_batch"]


def render(
    scene: Scene | RenderJob,
    *,
    device: str | int | Device | Sequence[str | int | Device] | None = None,
    on_progress: Callable[[Progress], None] | None = None,
    should_stop: Callable[[], bool] | None = None,
    notify: Callable[[str], None] | None = None,
    on_stage: Callable[[str], None] | None = None,
    keep_film: bool = True,
    checkpoint: str | Path | None = None,
    resume: bool = False,
    cluster: str | None = None,
    **settings: Any,
) -> RenderedImage:
    """Render a scene on devices that are opened for it and released at its end.

    Parameters
    ----------
    scene : Scene or RenderJob
    device : str, int, Device, sequence of them, optional
        See ``--device``. Default: ``CLRENDER_DEVICE``, else the best device that works. With a cluster, the device of
        each worker.
    on_progress, should_stop : callable, optional
        See `Session.render`.
    notify, on_stage : callable, optional
        See `Session`.
    keep_film : bool
        See `Session.render`.
    checkpoint : path, optional
        See `Session.render`.
    resume : bool
        See `Session.render`.
    cluster : str, optional
        ``tcp://HOST:PORT`` of a Dask scheduler whose workers take the samples, or ``local:N`` for N processes on this
        machine. For several renders, use `clrender.cluster.open_cluster`.
    **settings
        See `Session.render`: ``size``, ``samples``, ``aov``, ``denoise``, ``plugins`` and the fields of
        `RenderSettings`.

    Returns
    -------
    RenderedImage

    Raises
    ------
    SceneError, UsageError, DeviceError, RenderError
        See `Session.render`.
    """
    job = RenderJob.given(scene, **settings)
    notify = once(notify)
    with ExitStack() as stack:
        opened = None
        if cluster is not None:
            job.check_for_cluster()
            from clrender.cluster import open_cluster

            opened = stack.enter_context(open_cluster(cluster, device=device, notify=notify))  # type: ignore[arg-type]  # it looks
        session = stack.enter_context(Session(device, notify=notify, on_stage=on_stage))
        return session.render(
            job,
            on_progress=on_progress,
            should_stop=should_stop,
            keep_film=keep_film,
            checkpoint=checkpoint,
            resume=resume,
            cluster=opened,
        )


def render_batch(
    scene: Scene,
    cameras: Iterable[Camera | Mapping[str, Any]],
    *,
    device: str | int | Device | Sequence[str | int | Device] | None = None,
    **settings: Any,
) -> npt.NDArray[np.float32]:
    """Render a scene as many cameras see it; see `Session.render_batch`.

    Parameters
    ----------
    scene : Scene
    cameras : iterable of Camera or mapping
        Cameras, or keys of them; without a pose they stay where the scene's camera is.
    device : str, int, Device, sequence of them, optional
        See `render`.
    **settings
        See `Session.render_batch`. All images have the same size and seed.

    Returns
    -------
    (n, height, width, 3) float32
        Radiance, denoised if asked for; with the layer ``alpha``, (n, height, width, 4).

    Raises
    ------
    SceneError, UsageError, DeviceError, RenderError
        See `Session.render`.
    """
    with Session(device) as session:
        return session.render_batch(scene, cameras, **settings)
