"""Plugins: BSDFs, textures and lights that users write in OpenCL C; their headers, rules, and kernel files."""

from __future__ import annotations

from clrender.plugins.plugin import Plugin, as_plugins, combined, plugin
from clrender.plugins.program import kernel_files

__all__ = ["Plugin", "as_plugins", "combined", "kernel_files", "plugin"]
