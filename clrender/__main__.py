"""`python -m clrender` is `clrender`."""

from __future__ import annotations

from clrender.cli import main

__all__: list[str] = []

if __name__ == "__main__":
    main()
