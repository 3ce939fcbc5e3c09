"""The assets of the project, which are not in the repository."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Final

import pytest

__all__ = ["ASSETS", "needs_assets"]

ASSETS: Final = Path(os.environ.get("CLRENDER_ASSETS") or Path(__file__).resolve().parents[3] / "shared" / "assets")
"""Beside the repository, or where ``CLRENDER_ASSETS`` says; they may be missing."""
needs_assets: Final = pytest.mark.skipif(not ASSETS.is_dir(), reason="the assets of the project are not here")
