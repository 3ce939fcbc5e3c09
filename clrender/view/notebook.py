"""The live view in a notebook: the page's viewer in an output of a cell. It needs the extra `notebook`."""

from __future__ import annotations

import atexit
import contextlib
import importlib
import secrets
import threading
import time
from collections.abc import Sequence
from concurrent.futures import CancelledError
from functools import cache
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from clrender.drawing.bundle import style_sheet, widget_module
from clrender.errors import RenderError, UsageError
from clrender.extras import missing_extra
from clrender.image.files import check_output
from clrender.view.displays import Displays
from clrender.view.engine import Engine

if TYPE_CHECKING:
    from clrender.rendering.rendered_image import RenderedImage
    from clrender.scene import Scene

__all__ = ["View"]

_FIRST_SECONDS: Final = 10.0
"""What a display waits for a first picture, at most."""
_LAST_SECONDS: Final = 10.0
"""What is waited at the end for the last picture, at most."""
_UNWATCHED_SECONDS: Final = 10.0
"""How long a view that nobody displays any more goes on: a cell that runs again takes its output away for a moment."""
_POLL_SECONDS: Final = 0.05


class View:
    """A scene in a notebook while it renders; camera, settings and materials may change meanwhile.

    It is displayed where it is the last value of a cell, or by ``display``, as often as one likes. It renders from the
    beginning, displayed or not, and ends with `close`, with the last output that displays it, or with the kernel; what
    is on the devices is released then. Below the view stands its picture, hidden as long as the view is live: it is
    what a notebook that is exported, or opened without a kernel, shows.

    Parameters
    ----------
    scene : Scene
    device : str, int, Device, sequence of them, optional
        As of `clrender.render`.
    outputs : sequence of path
        Files that the view's button may write; no others are.
    height : int
        Of the output, CSS pixels.
    **settings
        ``size``, (width, height) in pixels, and the fields of `RenderSettings`.

    Raises
    ------
    UsageError, SceneError
        The scene cannot be rendered with these settings, or the extra is not installed.
    DeviceError
        No device works.

    Examples
    --------
    >>> view = clrender.View(clrender.load("room"), size=(640, 360))  # doctest: +SKIP
    >>> view  # doctest: +SKIP
    """

    def __init__(
        self,
        scene: Scene,
        *,
        device: Any = None,
        outputs: Sequence[str | Path] = (),
        height: int = 560,
        **settings: Any,
    ) -> None:
        self._key = secrets.token_hex(8)
        for path in outputs:
            check_output(path)
        widget = _widget_class()
        if (size := settings.pop("size", None)) is not None:
            settings["width"], settings["height"] = _sides(size)
        self._engine = Engine(scene, device=device, outputs=outputs, **settings)
        self._widget = widget(still=self._key, height=height)
        self._stills: list[Any] = []
        self._drawn: str | None = None
        self._last: RenderedImage | None = None
        self._closing = threading.Lock()
        self._closed = False
        self._displays = Displays(self._engine, self._widget.send, self._on_tick)
        self._widget.on_msg(lambda _widget, content, _buffers: self._displays.receive(content))
        atexit.register(self.close)

    def __enter__(self) -> View:
        return self

    def __exit__(self, *details: Any) -> None:
        self.close()

    def __repr__(self) -> str:
        edited = self._engine.edited_scene
        settings = edited.job.settings
        name = edited.scene.title or edited.scene.source
        return f"<clrender.View of {name}, {settings.width} x {settings.height}{', closed' if self._closed else ''}>"

    @property
    def widget(self) -> Any:
        """The ``anywidget``, to be placed in layouts of ``ipywidgets``; a view displays itself without."""
        return self._widget

    @property
    def scene(self) -> Scene:
        """The scene as it is now: with the camera and the materials of the view."""
        return self._engine.edited_scene.job.scene

    @property
    def image(self) -> RenderedImage | None:
        """The image so far, with its numbers; of a closed view the last one. None: there is no sample yet."""
        if not self._closed:
            with contextlib.suppress(CancelledError, TimeoutError):
                self._last = self._engine.image().result(_LAST_SECONDS) or self._last
        return self._last

    def wait(self, seconds: float | None = None) -> RenderedImage:
        """Wait until all samples are there.

        The cell is busy meanwhile: most kernels answer what one does in the view after it only.

        Parameters
        ----------
        seconds : float, optional
            At most so long.

        Returns
        -------
        RenderedImage
            With all samples, or those that there are after so long.

        Raises
        ------
        RenderError
            The render failed; there is no sample after so long, or the view was closed before there was one.
        """
        end = None if seconds is None else time.monotonic() + seconds
        while not self._closed and (end is None or time.monotonic() < end):
            state = self._engine.image_state
            if state is not None and state.sha256 is not None:
                break
            if (problem := self._engine.problem) is not None:
                raise RenderError(problem)
            time.sleep(_POLL_SECONDS)
        image = self.image
        if image is None:
            raise RenderError("the view has no sample yet")
        return image

    def close(self) -> None:
        """End: the view becomes its last picture, and devices are released. A second call does nothing."""
        with self._closing:
            if self._closed:
                return
            atexit.unregister(self.close)
            with contextlib.suppress(Exception):  # the end must come, with a last picture or without
                self._draw(self.image)
            self._closed = True
            self._engine.close()
            self._displays.close()
            with contextlib.suppress(Exception):  # the kernel may end, and take no messages any more
                self._widget.close()

    def _ipython_display_(self) -> None:
        display = importlib.import_module("IPython.display").display
        if not self._closed:
            display(self._widget)
        end = time.monotonic() + _FIRST_SECONDS
        while (image := self.image) is None and not self._closed and time.monotonic() < end:
            if self._engine.problem is not None:
                break
            time.sleep(_POLL_SECONDS)
        self._stills.append(display(self._still(image), raw=True, display_id=True))

    # --- the thread that sends ---

    def _on_tick(self) -> None:
        """Update the pictures when an image is finished, and end the view when no output displays it any more."""
        state = self._engine.image_state
        finished = None if state is None else state.sha256
        if finished is not None and finished != self._drawn and self._stills:
            self._drawn = finished
            self._draw(self.image)
        if self._displays.unwatched_seconds > _UNWATCHED_SECONDS:
            threading.Thread(target=self.close, name="clrender view ends").start()

    def _draw(self, image: RenderedImage | None) -> None:
        for handle in self._stills:
            handle.update(self._still(image), raw=True)

    def _still(self, image: RenderedImage | None) -> dict[str, str]:
        shown = "<p>There is no picture yet.</p>" if image is None else image._repr_html_()
        return {
            "text/plain": f"picture of {self!r}",
            "text/html": f'<div data-clrender-still="{escape(self._key)}">{shown}</div>',
        }


def _sides(size: Any) -> tuple[int, int]:
    try:
        width, height = size
    except (TypeError, ValueError):
        raise UsageError(f"size is {size!r:.60}, but must be (width, height) in pixels") from None
    return width, height


@cache
def _widget_class() -> Any:
    """The widget: what it shows and how is text, which front ends that know ``anywidget`` run."""
    try:
        anywidget = importlib.import_module("anywidget")
        traitlets = importlib.import_module("traitlets")
    except ImportError as missing:
        raise missing_extra(
            "notebook", f"the view in a notebook needs {missing.name or 'anywidget'}, which is not installed"
        ) from None
    parts = {
        "_esm": widget_module(),
        "_css": style_sheet(),
        "still": traitlets.Unicode().tag(sync=True),
        "height": traitlets.Int().tag(sync=True),
    }
    return type("ViewWidget", (anywidget.AnyWidget,), parts)
