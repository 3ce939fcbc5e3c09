"""Make the pictures of docs/gallery.md: built-in scenes as they are, of one width, with many samples."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Final

from PIL import Image

import clrender

__all__: list[str] = []

_DOCS: Final = Path(__file__).resolve().parents[1] / "docs"
_SCENES: Final = {
    "metals": 512,
    "surfaces": 512,
    "drink": 1024,
    "textures": 256,
    "sky": 512,
    "lamps": 512,
    "haze": 1024,
    "candles": 256,
}
"""Built-in scene -> samples per pixel."""
_WIDTH: Final = 640


def main() -> None:
    """Render all of them; the denoiser is not used."""
    with clrender.Session() as session:
        for name, spp in _SCENES.items():
            scene = clrender.load(name)
            height = round(_WIDTH * scene.image.height / scene.image.width)
            image = session.render(scene, spp=spp, size=(_WIDTH, height))
            path = _DOCS / f"gallery-{name}.jpg"
            Image.open(io.BytesIO(image._repr_png_())).convert("RGB").save(path, quality=85, optimize=True)
            print(f"{path.name}: {path.stat().st_size / 1024:.0f} KiB, {image.stats['render_seconds']:.0f} s")


if __name__ == "__main__":
    main()
