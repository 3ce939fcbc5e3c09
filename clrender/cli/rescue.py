"""Keeps a render whose outputs cannot be written, in a film at another place."""

from __future__ import annotations

import itertools
import tempfile
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

from clrender.errors import ClrenderError

if TYPE_CHECKING:
    from clrender.rendered_image import RenderedImage

__all__ = ["rescue"]


def rescue(image: RenderedImage, output: Path) -> Path | None:
    """Save a render as a film beside an output, in the working folder or in the temporary folder.

    Parameters
    ----------
    image : RenderedImage
        With its film.
    output : Path
        The output that could not be written. No existing file is replaced.

    Returns
    -------
    Path or None
        The film; None if none could be written.
    """
    for folder in _folders(output):
        with suppress(ClrenderError, OSError):
            film = _free(folder, output.stem)
            image.save(film)
            return film
    return None


def _folders(output: Path) -> Iterator[Path]:
    for folder in (output.parent.absolute, Path.cwd, lambda: Path(tempfile.gettempdir())):
        with suppress(OSError):  # the working folder may be gone
            yield folder()


def _free(folder: Path, stem: str) -> Path:
    names = itertools.chain([f"{stem}.film"], (f"{stem}-{number}.film" for number in itertools.count(2)))
    return next(path for path in (folder / name for name in names) if not path.exists())
