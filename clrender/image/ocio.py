"""Display images by the views of an OpenColorIO configuration, ACES 2.0 among them; needs the extra ``ocio``."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, field
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from clrender.errors import UsageError
from clrender.extras import missing_extra
from clrender.limits import shown

__all__ = ["BUILTIN", "DisplayView", "display_view"]

BUILTIN: Final = "builtin"
"""Name of the library's newest configuration for computer graphics."""
_BUILTIN_URI: Final = "ocio://cg-config-latest"
_SPACE: Final = "Linear Rec.709 (sRGB)"
"""The colour space of our images, by its name in the configurations of the library."""
_NAMES: Final = (
    "lin_rec709_srgb",
    "lin_rec709_scene",
    "lin_rec709",
    "lin_srgb",
    "Linear Rec.709",
    "Linear BT.709",
    "Utility - Linear - sRGB",
    "Utility - Linear - Rec.709",
)
"""Its names in others."""


@dataclass(frozen=True)
class DisplayView:
    """A view of a display, by an OpenColorIO configuration; a `clrender.image.tone_map.DisplayMap`.

    Attributes
    ----------
    config : str
        Name of the configuration, or its file.
    display, view : str
    space : str
        Name of the colour space in it that is linear Rec. 709.
    processor : PyOpenColorIO.CPUProcessor
    """

    config: str
    display: str
    view: str
    space: str
    processor: Any = field(repr=False, compare=False)

    @property
    def record(self) -> dict[str, Any]:
        """What a file says of it."""
        import PyOpenColorIO

        used = {"config": self.config, "display": self.display, "view": self.view, "version": PyOpenColorIO.__version__}
        return {"tone_map": "ocio", "ocio": used}

    def __str__(self) -> str:
        return f"{self.view}, {self.display}"

    def shown(self, linear: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        """Display values of linear ones, any shape (..., 3)."""
        pixels = np.ascontiguousarray(linear, np.float32).reshape(-1, 3)
        if len(pixels):
            self.processor.applyRGB(pixels)
        # What a configuration makes no number of is black
        return np.nan_to_num(pixels.reshape(linear.shape).astype(np.float64), nan=0.0)


def display_view(config: str | Path = BUILTIN, display: str | None = None, view: str | None = None) -> DisplayView:
    """A view of an OpenColorIO configuration, for `tone_map` of display images.

    Parameters
    ----------
    config : str or Path
        A file (``.ocio``, ``.ocioz``), a configuration of the library such as
        ``ocio://studio-config-v4.0.0_aces-v2.0_ocio-v2.5``, or ``builtin``, its newest for computer graphics.
    display, view : str, optional
        Default: those of the configuration.

    Returns
    -------
    DisplayView
        For `tone_map` of `clrender.RenderedImage.save`, for one.

    Raises
    ------
    UsageError
        The library is not installed; the configuration cannot be read, or has no such display or view, or no colour
        space that is linear Rec. 709.
    """
    if find_spec("PyOpenColorIO") is None:
        raise missing_extra("ocio", "OpenColorIO is not installed, which --ocio needs")
    import PyOpenColorIO

    name = str(config)
    try:
        if name == BUILTIN or name.startswith("ocio://"):
            found = PyOpenColorIO.Config.CreateFromBuiltinConfig(_BUILTIN_URI if name == BUILTIN else name)
            name = f"ocio://{found.getName()}"
        else:
            found = PyOpenColorIO.Config.CreateFromFile(name)
        found.validate()
    except (PyOpenColorIO.Exception, PyOpenColorIO.ExceptionMissingFile) as error:
        raise UsageError(f"--ocio {name}: it is no configuration that OpenColorIO reads: {_told(error)}") from None
    displays = list(found.getDisplays())
    if not displays:
        raise UsageError(f"--ocio {name}: it has no displays; name another configuration")
    display = _chosen(name, "display", display, displays, found.getDefaultDisplay())
    views = list(found.getViews(display))
    view = _chosen(f"{name}, {display}", "view", view, views, found.getDefaultView(display))
    space = _linear_space(found)
    if space is None:
        text = "it has no colour space that is known to be linear Rec. 709, as images are here"
        raise UsageError(f"--ocio {name}: {text}; give one of its spaces the alias lin_rec709_scene")
    try:
        transform = PyOpenColorIO.DisplayViewTransform(src=space, display=display, view=view)
        processor = found.getProcessor(transform).getDefaultCPUProcessor()
    except (PyOpenColorIO.Exception, PyOpenColorIO.ExceptionMissingFile) as error:
        raise UsageError(f"--ocio {name}: the view {shown(view)} cannot be made: {_told(error)}") from None
    return DisplayView(name, display, view, space, processor)


def _told(error: Exception) -> str:
    return " ".join(str(error).split())[:300].rstrip(".")


def _chosen(where: str, what: str, asked: str | None, known: list[str], default: str) -> str:
    if asked is None:
        return default
    if asked not in known:
        raise UsageError(f"--{what}: {where} has no {what} {shown(asked)}; it has {', '.join(map(repr, known))}")
    return asked


def _linear_space(config: Any) -> str | None:
    """The name of the colour space that is linear Rec. 709, by its transform, or else by its name."""
    import PyOpenColorIO

    with suppress(PyOpenColorIO.Exception):
        builtin = PyOpenColorIO.Config.CreateFromBuiltinConfig(_BUILTIN_URI)
        found: str = PyOpenColorIO.Config.IdentifyBuiltinColorSpace(config, builtin, _SPACE)
        if found:
            return found
    for name in (_SPACE, *_NAMES):
        space = config.getColorSpace(name)
        if space is not None:
            return str(space.getName())
    return None
