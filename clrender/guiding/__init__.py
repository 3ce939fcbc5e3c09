"""Path guiding: a field of the light that arrives, learned from training paths and then frozen."""

from __future__ import annotations

__all__: list[str] = []
