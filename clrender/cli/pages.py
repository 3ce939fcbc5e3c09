"""HTML pages that commands write."""

from __future__ import annotations

from pathlib import Path

from clrender.errors import UsageError

__all__ = ["check_page", "write_page"]


def check_page(path: Path) -> None:
    """Check, before any work, that a page with plots can be created and written.

    Raises
    ------
    UsageError
    """
    from clrender.drawing.svg import require_matplotlib
    from clrender.files.access import check_writable

    if path.suffix.lower() not in (".html", ".htm"):
        raise UsageError(f"{path}: the page is written as HTML; give it a name that ends in .html")
    check_writable(path)
    require_matplotlib()


def write_page(path: Path, page: str) -> None:
    """Write a page atomically."""
    from clrender.files.access import atomic_write

    with atomic_write(path) as file:
        file.write(page.encode("utf-8", "backslashreplace"))
