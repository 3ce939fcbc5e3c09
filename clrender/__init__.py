"""clrender: a physically based renderer whose image is bit-identical on every OpenCL device.

>>> import clrender
>>> image = clrender.render(clrender.load("room"), spp=16, size=(200, 200))  # doctest: +SKIP
>>> image.save("room.png")  # doctest: +SKIP
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from clrender.version import __version__

if TYPE_CHECKING:
    from clrender.api import render as render
    from clrender.api import render_batch as render_batch
    from clrender.drivers import devices as devices
    from clrender.errors import ClrenderError as ClrenderError
    from clrender.errors import DeviceError as DeviceError
    from clrender.errors import RenderError as RenderError
    from clrender.errors import SceneError as SceneError
    from clrender.errors import UsageError as UsageError
    from clrender.image.ocio import display_view as display_view
    from clrender.importers.cameras.read import load_cameras as load_cameras
    from clrender.importers.load import load as load
    from clrender.inspection import PathMaps as PathMaps
    from clrender.inspection import PixelPaths as PixelPaths
    from clrender.inspection import path_maps as path_maps
    from clrender.inspection import paths as paths
    from clrender.plugins import plugin as plugin
    from clrender.rendering.convergence_plot import ConvergencePlot as ConvergencePlot
    from clrender.rendering.job import RenderJob as RenderJob
    from clrender.rendering.rendered_image import Progress as Progress
    from clrender.rendering.rendered_image import RenderedImage as RenderedImage
    from clrender.rendering.session import Session as Session
    from clrender.scene import Scene as Scene
    from clrender.sensor import Sensor as Sensor
    from clrender.verification import verify as verify
    from clrender.view.notebook import View as View

# Module of each name. Names are imported when first used: `clrender --version` must not load NumPy.
_HOMES = {
    "ClrenderError": "clrender.errors",
    "ConvergencePlot": "clrender.rendering.convergence_plot",
    "DeviceError": "clrender.errors",
    "PathMaps": "clrender.inspection",
    "PixelPaths": "clrender.inspection",
    "Progress": "clrender.rendering.rendered_image",
    "RenderError": "clrender.errors",
    "RenderedImage": "clrender.rendering.rendered_image",
    "RenderJob": "clrender.rendering.job",
    "Scene": "clrender.scene",
    "SceneError": "clrender.errors",
    "Sensor": "clrender.sensor",
    "Session": "clrender.rendering.session",
    "UsageError": "clrender.errors",
    "View": "clrender.view.notebook",
    "devices": "clrender.drivers",
    "display_view": "clrender.image.ocio",
    "load": "clrender.importers",
    "load_cameras": "clrender.importers.cameras",
    "path_maps": "clrender.inspection",
    "paths": "clrender.inspection",
    "plugin": "clrender.plugins",
    "render": "clrender.api",
    "render_batch": "clrender.api",
    "verify": "clrender.verification",
}

__all__ = ["__version__", *_HOMES]  # noqa: PLE0604


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module 'clrender' has no attribute {name!r}")
    import importlib

    value = getattr(importlib.import_module(_HOMES[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted(__all__)
