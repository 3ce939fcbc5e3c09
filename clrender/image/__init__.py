"""Images: files, tone mapping, comparison, denoising."""

from __future__ import annotations

__all__: list[str] = []
