"""The live view: an image that refines while its camera, settings and materials change; engine, web server and page."""

from __future__ import annotations

from clrender.view.engine import Engine
from clrender.view.viewer import Viewer

__all__ = ["Engine", "Viewer"]
