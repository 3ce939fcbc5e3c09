"""Keeps a render whose outputs cannot be written, in a film or an image at another place."""

from __future__ import annotations

import itertools
import tempfile
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

from clrender.errors import ClrenderError

if TYPE_CHECKING:
    from clrender.rendering.rendered_image import RenderedImage

__all__ = ["rescue"]


def rescue(image: RenderedImage, output: Path) -> Path | None:
    """Save a render beside an output, in the working folder or in the temporary folder.

    Parameters
    ----------
    image : RenderedImage
        It is saved as a film, or as a linear image if the sums of its film have been released.
    output : Path
        The output that could not be written. No existing file is replaced.

    Returns
    -------
    Path or None
        The film or image; None if none could be written.
    """
    for folder in _folders(output):
        with suppress(ClrenderError, OSError):
            kept = _free(folder, output.stem, ".npy" if image.film.developed else ".film")
            image.save(kept)
            return kept
    return None


def _folders(output: Path) -> Iterator[Path]:
    for folder in (output.parent.absolute, Path.cwd, lambda: Path(tempfile.gettempdir())):
        with suppress(OSError):  # the working folder may be gone
            yield folder()


def _free(folder: Path, stem: str, suffix: str) -> Path:
    names = itertools.chain([f"{stem}{suffix}"], (f"{stem}-{number}{suffix}" for number in itertools.count(2)))
    return next(path for path in (folder / name for name in names) if not path.exists())
