"""Scenes as the kernels read them: from the validated description to contiguous arrays."""

from __future__ import annotations

__all__: list[str] = []
