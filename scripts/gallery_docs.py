"""Make the pictures of docs/gallery.md: built-in scenes, with many samples; one of them at three hours."""

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
    "foliage": 256,
    "product": 1024,
    "fisheye": 512,
}
"""Built-in scene -> samples per pixel."""
_WIDTH: Final = 640
_HOURS: Final = {"06:00": 1 / 80, "12:00": 1 / 180, "19:30": 1 / 50}
"""Time of day of the scene `sundial` -> shutter, seconds."""
_HOUR_SIZE: Final = (426, 266)
_HOUR_SPP: Final = 1024


def at(scene: clrender.Scene, hour: str, shutter: float) -> clrender.Scene:
    """The same day at another hour."""
    light = scene.sky
    assert light is not None and light.time is not None
    day, offset = light.time[:11], light.time[19:]
    other = light.model_copy(update={"time": f"{day}{hour}:00{offset}"})
    return scene.model_copy(update={"lights": (other,)}).with_exposure(shutter=shutter)


def main() -> None:
    """Render all of them; the denoiser is not used."""
    with clrender.Session() as session:
        for name, spp in _SCENES.items():
            scene = clrender.load(name)
            height = round(_WIDTH * scene.image.height / scene.image.width)
            image = session.render(scene, spp=spp, size=(_WIDTH, height))
            save(name, [image])
        scene = clrender.load("sundial")
        hours = [at(scene, hour, shutter) for hour, shutter in _HOURS.items()]
        save("sundial", [session.render(each, spp=_HOUR_SPP, size=_HOUR_SIZE) for each in hours])


def save(name: str, images: list[clrender.RenderedImage]) -> None:
    """Write pictures of one size side by side."""
    pictures = [Image.open(io.BytesIO(image._repr_png_())).convert("RGB") for image in images]
    width, height = pictures[0].size
    together = Image.new("RGB", (width * len(pictures), height))
    for number, picture in enumerate(pictures):
        together.paste(picture, (width * number, 0))
    path = _DOCS / f"gallery-{name}.jpg"
    together.save(path, quality=85, optimize=True)
    seconds = sum(image.stats["render_seconds"] for image in images)
    print(f"{path.name}: {path.stat().st_size / 1024:.0f} KiB, {seconds:.0f} s")


if __name__ == "__main__":
    main()
