"""Universal Scene Description (AOUSD), imported as our own scenes; needs usd-core, the extra ``usd``."""

from __future__ import annotations

from clrender.importers.usd.read import read

__all__ = ["read"]
