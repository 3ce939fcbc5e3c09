"""Files: access that is atomic and says what to do, files that scenes name, and NumPy's format."""

from __future__ import annotations

__all__: list[str] = []
