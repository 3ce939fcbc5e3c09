"""`render()`: one session for one job.

(Not ``render.py``: a module of that name would take the place of the function `clrender.render`.)
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from clrender.job import RenderJob
from clrender.session import Session

if TYPE_CHECKING:
    from clrender.device import Device
    from clrender.rendered_image import Progress, RenderedImage
    from clrender.scene import Scene

__all__ = ["render"]


def render(
    scene: Scene | RenderJob,
    *,
    device: str | int | Device | Sequence[str | int | Device] | None = None,
    on_progress: Callable[[Progress], None] | None = None,
    should_stop: Callable[[], bool] | None = None,
    notify: Callable[[str], None] | None = None,
    keep_film: bool = True,
    checkpoint: str | Path | None = None,
    resume: bool = False,
    **settings: Any,
) -> RenderedImage:
    """Render a scene on devices that are opened for it and released at its end.

    Parameters
    ----------
    scene : Scene or RenderJob
    device : str, int, Device, sequence of them, optional
        As ``--device``; default: ``CLRENDER_DEVICE``, else the best that works.
    on_progress, should_stop, notify, keep_film, checkpoint, resume, **settings
        As `Session.render`, which says what is returned and raised, too.
    """
    job = RenderJob.given(scene, **settings)
    with Session(device, notify=notify) as session:
        return session.render(
            job,
            on_progress=on_progress,
            should_stop=should_stop,
            keep_film=keep_film,
            checkpoint=checkpoint,
            resume=resume,
        )
