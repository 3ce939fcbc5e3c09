"""glTF 2.0 (Khronos; ISO/IEC 12113:2022) and its extensions, imported as our own scenes."""

from __future__ import annotations

from clrender.importers.gltf.reader import read

__all__ = ["read"]
