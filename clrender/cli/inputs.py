"""Reading of images for commands: linear files, display files and films."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import numpy as np
    import numpy.typing as npt

__all__ = ["read_linear"]


def read_linear(path: Path) -> tuple[npt.NDArray[np.float32], dict[str, Any] | None]:
    """Read a linear image, (H, W, 3) float32, and its provenance, if the file has any.

    Raises
    ------
    UsageError
        When the file does not exist, is no regular file, or is no readable image.
    """
    from clrender.film import Film
    from clrender.image.files import FILM_ENDINGS, read_image, read_provenance

    if path.suffix.lower() in FILM_ENDINGS:
        film = Film.load(path)
        return film.develop(), film.provenance
    return read_image(path, FILM_ENDINGS), read_provenance(path)
