"""Make the figures of docs/gallery.md: built-in scenes with many samples, one of them at three times of day."""

from __future__ import annotations

import sys
from typing import Final

from doc_pictures import shown, write_sheet

import clrender

__all__: list[str] = []

_SCENES: Final = {
    "metals": 512,
    "surfaces": 512,
    "drink": 1024,
    "textures": 256,
    "sky": 256,
    "lamps": 512,
    "haze": 256,
    "cloud": 256,
    "smoke": 256,
    "campfire": 768,
    "chick": 96,
    "candles": 256,
    "foliage": 256,
    "product": 1024,
    "fisheye": 512,
    "pool": 128,
    "prism": 1024,
}
"""Samples per pixel, by built-in scene."""
_DENOISED: Final = ("haze", "sky")
"""Scenes whose light is hard to find for their integrator: what noise is left is taken away, as a user would."""
_WIDTH: Final = 640
_HOURS: Final = {"06:00": 1 / 80, "12:00": 1 / 180, "19:30": 1 / 50}
"""Shutter times of the scene `sundial`, seconds, by time of day."""
_HOUR_SIZE: Final = (426, 266)
_HOUR_SPP: Final = 1024


def at(scene: clrender.Scene, hour: str, shutter: float) -> clrender.Scene:
    """The scene on the same day at another hour."""
    light = scene.sky
    assert light is not None and light.time is not None
    day, offset = light.time[:11], light.time[19:]
    other = light.changed({"time": f"{day}{hour}:00{offset}"})
    return scene.changed({"lights": (other,)}).with_exposure(shutter=shutter)


def main() -> None:
    """Render all figures, or those of the scenes that are named."""
    wanted = sys.argv[1:] or [*_SCENES, "sundial"]
    with clrender.Session() as session:
        for name, spp in _SCENES.items():
            if name not in wanted:
                continue
            scene = clrender.load(name)
            height = round(_WIDTH * scene.image.height / scene.image.width)
            image = session.render(scene, spp=spp, size=(_WIDTH, height), denoise=name in _DENOISED)
            write_sheet(f"gallery-{name}.jpg", [[shown(image)]])
        if "sundial" not in wanted:
            return
        scene = clrender.load("sundial")
        hours = [at(scene, hour, shutter) for hour, shutter in _HOURS.items()]
        pictures = [shown(session.render(each, spp=_HOUR_SPP, size=_HOUR_SIZE)) for each in hours]
        write_sheet("gallery-sundial.jpg", [pictures], gap=0)


if __name__ == "__main__":
    main()
