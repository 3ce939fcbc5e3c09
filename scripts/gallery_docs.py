"""Make the figures of docs/gallery.md: built-in scenes with many samples, one at three times of day, one that moves."""

from __future__ import annotations

import argparse
import shutil
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Final

from doc_pictures import shown, write_animation, write_sheet
from PIL import Image

import clrender

__all__: list[str] = []

_SCENES: Final = {
    "interior": 256,
    "canal": 256,
    "metalware": 512,
    "still-life": 192,
    "drink": 512,
    "veranda": 128,
    "balustrade": 128,
    "museum": 192,
    "attic": 192,
    "cloud": 96,
    "smoke": 128,
    "campfire": 256,
    "chick": 96,
    "candles": 256,
    "foliage": 256,
    "product": 1024,
    "fisheye": 512,
    "pool": 128,
    "dispersion": 512,
}
"""Samples per pixel, by built-in scene."""
_DENOISED: Final = (
    *("interior", "canal", "metalware", "cradle", "dispersion"),
    *("still-life", "veranda", "balustrade", "museum", "attic", "cloud"),
    *("smoke", "campfire", "chick", "candles", "drink"),
)
"""Scenes whose light is hard to find for their integrator, or that scatter it: what noise is left is taken away."""
_WIDTH: Final = 640
_WIDE: Final = ("interior", "canal", "metalware", "still-life", "veranda", "balustrade", "cloud")
"""Scenes whose details are seen at one and a half times that width."""
_PERIOD: Final = 16
"""Frames of one period of the scene `cradle`, 24 a second."""
_FRAME_SIZE: Final = (480, 320)
_FRAME_SPP: Final = 64
_PBRT: Final = ("classroom", "dining-room")
_PBRT_SETTINGS: Final[dict[str, Any]] = {"size": (560, 315), "spp": 256, "denoise": True}
_COW: Final = """
[camera]
position = [1.75, 0.42, -2.35]
target = [0.0, 0.12, 0.05]
vertical_fov = 36.0

[materials.cow]
type = "principled"
base_color = { texture = "spot_texture.png" }
roughness = 0.3
coat = 0.5
coat_roughness = 0.05

[materials.ground]
type = "lambert"
reflectance = [0.42, 0.44, 0.4]

[[shapes]]
type = "mesh"
file = "spot_triangulated.obj"
material = "cow"
smooth_angle = 60

[[shapes]]
type = "disk"
center = [0.0, -0.735, 0.0]
normal = [0.0, 1.0, 0.0]
radius = 300.0
material = "ground"

[[lights]]
type = "sun_sky"
sun_direction = [0.6, 0.7, -0.25]
scale = 0.028
"""
"""A scene around the model Spot, an OBJ file with a picture."""
_FILES: Final = ("bitterli/veach-mis/mitsuba/scene_v3.xml", "gltf/TransmissionTest/TransmissionTest.glb")
_FILES_SETTINGS: Final[dict[str, Any]] = {"size": (424, 318), "spp": 128, "denoise": True}
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


def swinging(session: clrender.Session) -> list[Image.Image]:
    """The frames of one period of the scene `cradle`, as `--frames 0:15` renders them."""
    scene = clrender.load("cradle")
    frames = []
    for number in range(_PERIOD):
        camera = scene.camera.changed({"time": number / 24.0})
        image = session.render(scene.changed({"camera": camera}), spp=_FRAME_SPP, size=_FRAME_SIZE, denoise=True)
        frames.append(shown(image))
    return frames


def of_files(session: clrender.Session, assets: Path) -> list[Image.Image]:
    """Scenes from files of three formats: an OBJ file in a scene around it, Mitsuba's, and glTF."""
    with TemporaryDirectory() as folder:
        for each in (assets / "meshes" / "spot").iterdir():
            shutil.copy(each, folder)
        around = Path(folder, "cow.toml")
        around.write_text(_COW, encoding="utf-8")
        scenes = [around, *(assets / name for name in _FILES)]
        return [shown(session.render(clrender.load(each), **_FILES_SETTINGS)) for each in scenes]


def main() -> None:
    """Render all figures, or those of the scenes that are named."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("scenes", nargs="*", metavar="SCENE", help="all but pbrt and files, if none is named")
    parser.add_argument("--standard", type=Path, help="folder with Bitterli's scenes in pbrt's format, for pbrt")
    parser.add_argument("--assets", type=Path, help="folder with models of Khronos, Crane and Bitterli, for files")
    arguments = parser.parse_args()
    wanted = arguments.scenes or [*_SCENES, "cradle", "sundial"]
    with clrender.Session() as session:
        for name, spp in _SCENES.items():
            if name not in wanted:
                continue
            scene = clrender.load(name)
            width = _WIDTH * 3 // 2 if name in _WIDE else _WIDTH
            height = round(width * scene.image.height / scene.image.width)
            image = session.render(scene, spp=spp, size=(width, height), denoise=name in _DENOISED)
            write_sheet(f"gallery-{name}.jpg", [[shown(image)]])
        if "cradle" in wanted:
            write_animation("gallery-cradle.webp", swinging(session))
        if "pbrt" in wanted:
            files = [arguments.standard / name / "scene-v4.pbrt" for name in _PBRT]
            rooms = [shown(session.render(clrender.load(file), **_PBRT_SETTINGS)) for file in files]
            write_sheet("gallery-pbrt.jpg", [rooms])
        if "files" in wanted:
            write_sheet("gallery-files.jpg", [of_files(session, arguments.assets)])
        if "sundial" not in wanted:
            return
        scene = clrender.load("sundial")
        hours = [at(scene, hour, shutter) for hour, shutter in _HOURS.items()]
        pictures = [shown(session.render(each, spp=_HOUR_SPP, size=_HOUR_SIZE)) for each in hours]
        write_sheet("gallery-sundial.jpg", [pictures], gap=0)


if __name__ == "__main__":
    main()
