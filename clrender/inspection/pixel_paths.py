"""The light paths of a pixel, sorted by what they contribute, and their files."""

from __future__ import annotations

import json
import operator
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import numpy.typing as npt

from clrender.errors import UsageError
from clrender.files.access import atomic_write
from clrender.inspection.document import document
from clrender.inspection.light_path import LightPath, Splats
from clrender.limits import shown
from clrender.wording import counted, grouped

if TYPE_CHECKING:
    from clrender.inspection.surroundings import Surroundings

__all__ = ["ENDINGS", "PixelPaths", "check_ending", "check_pixel"]

ENDINGS: Final = (".json", ".html")


def check_ending(path: str | Path) -> None:
    """Check that a file of light paths can have this name.

    Raises
    ------
    UsageError
    """
    if Path(path).suffix.lower() not in ENDINGS:
        raise UsageError(f"{path}: light paths are written to a .json or an .html file; name one, such as paths.html")


def check_pixel(pixel: object, width: int, height: int) -> tuple[int, int]:
    """Check the column and row of a pixel, and return them.

    Raises
    ------
    UsageError
    """
    try:
        x, y = (operator.index(each) for each in pixel)  # type: ignore[attr-defined]  # it looks
    except (TypeError, ValueError):
        raise UsageError(f"pixel is {shown(pixel)}, but must be a column and a row, such as 400,300") from None
    if not (0 <= x < width and 0 <= y < height):
        raise UsageError(
            f"pixel {x},{y} is not within the image of {width} x {height}; columns and rows count from 0, at the "
            "upper left"
        )
    return x, y


@dataclass(frozen=True)
class PixelPaths:
    """Light paths of a pixel.

    Attributes
    ----------
    about : mapping
        What the paths are of, as JSON values: ``scene``, ``scene_sha256``, ``kernel_sha256``, ``version``,
        ``integrator``, ``guided``, ``spectral``, ``width``, ``height``, ``seed``, ``spp``, ``device``, ``driver``.
    pixel : (int, int)
        Column and row, from the upper left.
    radiance : (3,) float32
        The pixel, W/(sr m2): that of a render with these settings, bit for bit. It is the mean of `values`, and of
        `splats` where there are any.
    values : (spp, 3) float32
        What each sample adds to the sum of the pixel, by number.
    nonfinite_samples : int
        Samples that are left out, because they are not finite or brighter than 2^43.
    samples : tuple of LightPath
        The samples with the largest contributions, by luminance, the largest first.
    splats : Splats or None
        Of integrator `bdpt`: what paths from lights that the camera sees bring.
    surroundings : Surroundings or None
        Pictures and points of the scene for a page.
    """

    about: Mapping[str, Any]
    pixel: tuple[int, int]
    radiance: npt.NDArray[np.float32]
    values: npt.NDArray[np.float32]
    nonfinite_samples: int
    samples: tuple[LightPath, ...]
    splats: Splats | None = field(default=None, repr=False)
    surroundings: Surroundings | None = field(default=None, repr=False)

    def __repr__(self) -> str:
        x, y = self.pixel
        return f"<light paths of pixel {x},{y}: {grouped(len(self.samples))} of {counted(len(self.values), 'sample')}>"

    def to_json(self) -> str:
        """The paths as JSON, in the format ``clrender light paths 1``."""
        parts = document(
            self.about, self.pixel, self.radiance, self.nonfinite_samples, self.values, self.samples, self.splats
        )
        samples = parts.pop("samples")
        head = json.dumps(parts, ensure_ascii=False, allow_nan=False, separators=(",", ":"))
        lines = [json.dumps(each, ensure_ascii=False, allow_nan=False, separators=(",", ":")) for each in samples]
        return f'{head[:-1]},"samples":[\n' + ",\n".join(lines) + "\n]}\n"

    def to_html(self) -> str:
        """A self-contained page of the paths; with pictures and a sketch of the scene if there are `surroundings`."""
        from clrender.inspection.page import paths_page

        (x, y), scene = self.pixel, Path(self.about["scene"]).stem
        return paths_page(f"Light paths of pixel {x},{y} of {scene}", self.to_json(), self.surroundings)

    def save(self, path: str | Path) -> None:
        """Write the paths to a file.

        Parameters
        ----------
        path : str or pathlib.Path
            Of a ``.json`` or an ``.html`` file.

        Raises
        ------
        UsageError
            When the file has another ending, or cannot be written.
        """
        check_ending(path)
        text = self.to_html() if Path(path).suffix.lower() == ".html" else self.to_json()
        with atomic_write(path) as file:
            file.write(text.encode())
