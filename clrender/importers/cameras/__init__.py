"""Cameras from files: our own tables, camera matrices, COLMAP, transforms.json and glTF."""

from __future__ import annotations

from clrender.importers.cameras.read import camera_keys_of, load_cameras

__all__ = ["camera_keys_of", "load_cameras"]
