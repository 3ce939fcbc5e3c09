"""Images: files, tone curves, comparison, denoising."""

from __future__ import annotations

__all__: list[str] = []
