"""The founding report reproduced: its table, its figures, and which of its conclusions hold."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from clrender.report.runs import Stopped

if TYPE_CHECKING:
    from clrender.report.page import Page

__all__ = ["Stopped", "make_report", "write_files"]


def make_report(
    size: tuple[int, int],
    quick: bool = False,
    device: str | None = None,
    should_stop: Callable[[], bool] = lambda: False,
    say: Callable[[str], None] = lambda line: None,
) -> dict[str, bytes]:
    """Render the founding report's table and figures.

    Parameters
    ----------
    size : (int, int)
        Width and height of every image.
    quick : bool
        Fewer runs and samples.
    device : str, optional
        As for ``--device``.
    should_stop : callable
        Called often.
    say : callable
        Called with a line of text per render.

    Returns
    -------
    dict
        Contents by file name; the last one is ``report.html``, which is self-contained.

    Raises
    ------
    ClrenderError
        If Matplotlib is missing or nothing can be rendered.
    Stopped
        If `should_stop` returned True.
    """
    from clrender.drawing.svg import require_matplotlib
    from clrender.importers import load
    from clrender.rendering.session import Session
    from clrender.report.drawing import hemisphere, room_dimensions
    from clrender.report.page import Page
    from clrender.report.pictures import Figure, figures
    from clrender.report.plan import SCENE
    from clrender.report.plots import plots
    from clrender.report.runs import Renderer, measure

    require_matplotlib()
    with Session(device) as session:
        measured = measure(Renderer(size, session, device, should_stop, say), quick)
    drawn = [
        Figure(
            "figure-1",
            "Figure 1: the room",
            "Its dimensions, drawn from the scene.",
            svg=room_dimensions(load(SCENE)),
        ),
        Figure(
            "figure-3",
            "Figure 3: the hemisphere",
            "Directions of indirect light by the report's formula, θ = asin √y and φ = 2πx.",
            svg=hemisphere(),
        ),
    ]
    pictures = figures(measured.images, measured.results)
    return _files(Page(measured.results, [drawn[0], pictures[0], drawn[1], *pictures[1:]], plots(measured.results)))


def _files(page: Page) -> dict[str, bytes]:
    from dataclasses import asdict

    from clrender.report.page import html_page, markdown_page, picture_name
    from clrender.report.pictures import strip
    from clrender.report.verdicts import verdicts

    files = {picture_name(each): each.svg.encode() for each in page.plots}
    for figure in page.figures:
        files[picture_name(figure)] = figure.svg.encode() if figure.svg else strip(figure)
    numbers = {**page.results.as_json(), "verdicts": [asdict(each) for each in verdicts(page.results)]}
    return {
        **files,
        "report.json": json.dumps(numbers, indent=1, ensure_ascii=False).encode() + b"\n",
        "report.md": markdown_page(page).encode(),
        "report.html": html_page(page).encode(),
    }


def write_files(folder: Path, files: dict[str, bytes]) -> None:
    """Write the files, each atomically, to a folder, which is created if necessary.

    Raises
    ------
    RenderError
        If one cannot be written.
    """
    from clrender.errors import RenderError
    from clrender.files.access import atomic_write

    try:
        folder.mkdir(exist_ok=True)
    except OSError as error:
        raise RenderError(f"{folder}: cannot be made ({error.strerror}); choose another place.") from None
    for name, content in files.items():
        with atomic_write(folder / name) as file:
            file.write(content)
