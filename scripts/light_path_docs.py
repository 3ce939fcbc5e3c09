"""Make the figure of docs/light-paths.md: the page of its firefly in Chromium. Needs Playwright and Chromium."""

from __future__ import annotations

import io
import sys
import tempfile
from pathlib import Path

from doc_pictures import DOCS
from PIL import Image

import clrender

sys.path.insert(0, str(DOCS.parent / "tests" / "cli"))

from view_browser import chromium

__all__: list[str] = []


def main() -> int:
    """Write the figure."""
    found = clrender.paths(clrender.load("caustic"), (112, 137), size=(240, 240), spp=64, surroundings=True)
    with tempfile.TemporaryDirectory() as folder, chromium() as browser:
        file = Path(folder) / "paths.html"
        found.save(file)
        page = browser.new_page(viewport={"width": 1360, "height": 1000}, color_scheme="light")
        page.goto(file.as_uri())
        page.wait_for_selector(".lp-samples tbody tr")
        # Of the samples only the first are of interest
        page.add_style_tag(content=".lp-samples { max-height: 9rem !important; overflow: hidden; }")
        page.wait_for_timeout(500)
        picture = Image.open(io.BytesIO(page.screenshot(full_page=True)))
        picture.convert("RGB").save(DOCS / "light-paths.jpg", quality=85, optimize=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
