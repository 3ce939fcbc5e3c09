"""Renders Blender's scenes with clrender: what Blender loads first.

Modules that need Blender are imported when it registers the add-on, so that the conversions can be imported and
tested without it.
"""

from __future__ import annotations

__all__ = ["bl_info", "register", "unregister"]

bl_info = {
    "name": "clrender",
    "author": "clrender",
    "version": (0, 1, 0),
    "blender": (4, 2, 0),
    "location": "Properties, Render, Render Engine",
    "description": "Renders with clrender, and shows scenes in its live view",
    "category": "Render",
}
"""For Blender when it does not read `blender_manifest.toml`, as of add-ons that are no extensions."""


def register() -> None:
    """Called by Blender when the add-on is enabled."""
    from . import interface

    interface.register()


def unregister() -> None:
    """Called by Blender when the add-on is disabled."""
    from . import interface

    interface.unregister()
