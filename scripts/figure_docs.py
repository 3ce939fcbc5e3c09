"""Make the figures of docs/. Arguments: names of files, or patterns such as `how-*` (all). `scripts/docs --figures`.

Figures of a single page are made by that page's own script, which is called here.
"""

from __future__ import annotations

import fnmatch
import math
import subprocess
import sys
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Final

import numpy as np
import numpy.typing as npt
from doc_blocks import blocks
from doc_pictures import DOCS, shown, shown_linear, write_sheet

import clrender
from clrender.drawing.svg import BLUE, GREY, ORANGE
from clrender.image.compare import relative_squared_error
from clrender.report.plots import Series, plot
from clrender.scene.camera import Camera
from clrender.scene.materials import Conductor
from clrender.scene.shapes import Quad, Sphere

__all__ = ["FIGURES", "OTHERS"]

_SCRIPTS: Final = DOCS.parent / "scripts"
_Vector = npt.NDArray[np.float64]


def _builtin(name: str, **settings: Any) -> Callable[[str], None]:
    """Figure of an unmodified built-in scene."""

    def make(file: str) -> None:
        write_sheet(file, [[shown(clrender.render(clrender.load(name), **settings))]])

    return make


def _hero(file: str) -> None:
    """The picture at the top of README.md, whose caption has the command."""
    settings: dict[str, Any] = {"size": (1440, 960), "crop": (0, 60, 1440, 840), "spp": 128, "denoise": True}
    write_sheet(file, [[shown(clrender.render(clrender.load("canal"), **settings))]])


def _denoise(file: str) -> None:
    image = clrender.render(clrender.load("room"), spp=16, size=(400, 400), denoise=True)
    assert image.denoised is not None
    write_sheet(file, [[shown_linear(image.linear), shown_linear(image.denoised)]], gap=0)


def _plugins(file: str) -> None:
    """The scenes beside the plugins of docs/write-a-material.md."""
    folder = DOCS.parent / "scenes" / "plugins"
    given = sorted(folder.glob("*.cl"))
    images = [
        clrender.render(clrender.load(folder / f"{name}.toml", plugins=given), spp=400) for name in ("moon", "workshop")
    ]
    write_sheet(file, [[shown(image) for image in images]])


def _stage(file: str) -> None:
    """The scene of lights of plugins, for the same page."""
    folder = DOCS.parent / "scenes" / "plugins"
    scene = clrender.load(folder / "stage.toml", plugins=sorted(folder.glob("*.cl")))
    write_sheet(file, [[shown(clrender.render(scene, spp=1024))]])


def _first(file: str) -> None:
    """Figure of the scene in docs/start.md."""
    (block,) = [each for each in blocks(DOCS / "start.md") if each.file == "first.toml"]
    scene = DOCS / ".first.toml"
    scene.write_text(block.text)
    try:
        write_sheet(file, [[shown(clrender.render(clrender.load(str(scene)), spp=256))]])
    finally:
        scene.unlink()


def _noise(file: str) -> None:
    room = clrender.load("room")
    few = clrender.render(room, spp=16, size=(320, 320), denoise=True)
    assert few.denoised is not None
    many = clrender.render(room, spp=256, size=(320, 320))
    write_sheet(file, [[shown_linear(few.linear), shown(many), shown_linear(few.denoised)]])


def _black(file: str) -> None:
    """Figure of a scene in docs/troubleshooting.md, whose light only some integrators find."""
    (block,) = [each for each in blocks(DOCS / "troubleshooting.md") if each.file == "bulb.toml"]
    scene = DOCS / ".bulb.toml"
    scene.write_text(block.text)
    try:
        bulb = clrender.load(str(scene))
        images = [clrender.render(bulb, spp=256, size=(320, 240), integrator=name) for name in ("path", "bdpt")]
    finally:
        scene.unlink()
    write_sheet(file, [[shown(image) for image in images]])


def _depth(file: str) -> None:
    room = clrender.load("room")
    wanted: dict[str, Any] = {"size": (240, 240), "spp": 256}
    write_sheet(file, [[shown(clrender.render(room, max_depth=depth, **wanted)) for depth in (0, 1, 2, None)]])


def _samples(file: str) -> None:
    room = clrender.load("room")
    with clrender.Session() as session:
        pictures = [shown(session.render(room, spp=spp, size=(192, 192))) for spp in (1, 4, 16, 64, 256)]
    write_sheet(file, [pictures])


def _strategies(file: str) -> None:
    scene = _plates()
    with clrender.Session() as session:
        pictures = [
            shown(session.render(scene, sampling=name, spp=16, size=(320, 240))) for name in ("light", "bsdf", "mis")
        ]
    write_sheet(file, [pictures])


def _plates() -> clrender.Scene:
    """Plates that reflect four spheres of equal power into the camera; after Veach's thesis (1997), figure 9.2."""
    eye, lights = np.array([0.0, 2.0, 9.0]), np.array([0.0, 4.6, -1.5])
    shapes: list[Quad | Sphere] = []
    materials = {}
    for k, (roughness, place) in enumerate(zip((0.55, 0.4, 0.25, 0.12), np.linspace(0.0, 1.0, 4), strict=True)):
        middle = np.array([0.0, 1.9 - 2.1 * place, -0.6 + 3.0 * place])
        normal = _unit(_unit(eye - middle) + _unit(lights - middle))
        across = np.array([5.6, 0.0, 0.0])
        down = 0.95 * np.cross(_unit(across), normal) * -1.0  # across x down points along the normal
        materials[f"plate-{k}"] = Conductor(type="conductor", metal="Al", roughness=roughness)
        origin = middle - across / 2.0 - down / 2.0
        shapes.append(
            Quad(type="quad", origin=_three(origin), edge_u=_three(across), edge_v=_three(down), material=f"plate-{k}")
        )
    for x, radius in zip((-2.2, -0.8, 0.6, 2.0), (0.03, 0.1, 0.28, 0.6), strict=True):
        radiance = 0.2 / radius**2
        shapes.append(
            Sphere(
                type="sphere", center=(x, lights[1], lights[2]), radius=radius, emission=(radiance, radiance, radiance)
            )
        )
    camera = Camera(position=_three(eye), target=(0.0, 1.6, 0.0), vertical_fov=44.0)
    return clrender.Scene(camera=camera, materials=materials, shapes=tuple(shapes))


def _unit(vector: _Vector) -> _Vector:
    return np.asarray(vector / np.linalg.norm(vector), np.float64)


def _three(vector: _Vector) -> tuple[float, float, float]:
    return (float(vector[0]), float(vector[1]), float(vector[2]))


_COUNTS: Final = (1, 4, 16, 64, 256)
_SEEDS: Final = 4


def _sampler(file: str) -> None:
    scene = clrender.load("cornell")
    wanted: dict[str, Any] = {"size": (64, 64)}
    series = []
    kinds: list[tuple[str, str, dict[str, Any]]] = [
        ("independent samples", ORANGE, {"replicate_spp": 1}),
        ("scrambled Sobol points", BLUE, {}),
    ]
    with clrender.Session() as session:
        truth = session.render(scene, spp=32768, seed=999, **wanted).linear.astype(np.float64)
        for title, colour, more in kinds:
            points = []
            for spp in _COUNTS:
                images = [session.render(scene, spp=spp, seed=seed, **wanted, **more) for seed in range(_SEEDS)]
                errors = [relative_squared_error(image.linear - truth, truth) for image in images]
                points.append((float(spp), float(np.mean(errors)), min(errors), max(errors)))
            series.append(Series(title, points, colour))
    first = series[0].points[0][1]
    series.append(Series("1/N", [(float(n), first / n, first / n, first / n) for n in _COUNTS], GREY, "--"))
    caption = "relMSE against samples per pixel"
    drawn = plot("sampler", caption, ("samples per pixel", "relMSE"), series, _COUNTS)
    (DOCS / file).write_text(drawn.svg + "\n")
    print(f"{file}: " + "; ".join(f"{each.title} {each.points[-1][1]:.3g}" for each in series))


def _error(file: str) -> None:
    room = clrender.load("room")
    wanted: dict[str, Any] = {"size": (240, 240)}
    with clrender.Session() as session:
        image = session.render(room, spp=256, aov=("stderr",), **wanted)
        truth = session.render(room, spp=4096, seed=999, **wanted).linear
    stated, true = _luminance(image.aovs["stderr"]), _luminance(np.abs(image.linear - truth))
    print(f"{file}: root mean square: stated {_rms(stated):.4f}, true {_rms(true):.4f}")
    write_sheet(file, [[shown(image), _in_colour(stated), _in_colour(true)]])


def _luminance(linear: npt.NDArray[np.float32]) -> npt.NDArray[np.float64]:
    return np.asarray(linear @ np.array([0.2126, 0.7152, 0.0722]), np.float64)


def _rms(values: npt.NDArray[np.float64]) -> float:
    return math.sqrt(float((values**2).mean()))


def _in_colour(values: npt.NDArray[np.float64]) -> Any:
    """Logarithmic colour map from 0.001 (black) to 0.3 (white)."""
    from matplotlib import colormaps
    from PIL import Image

    share = np.log(np.maximum(values, 1e-3) / 1e-3) / math.log(0.3 / 1e-3)
    return Image.fromarray(np.uint8(255.0 * colormaps["inferno"](np.clip(share, 0.0, 1.0))[..., :3]))


FIGURES: Final[Mapping[str, Callable[[str], None]]] = {
    "hero.jpg": _hero,
    "room.jpg": _builtin("room", size=(480, 480), spp=256),
    "cornell.jpg": _builtin("cornell", size=(480, 480), spp=256),
    "radiosity.jpg": _builtin("room-diffuse", size=(480, 480), spp=16, integrator="radiosity"),
    "denoise.jpg": _denoise,
    "start-first.jpg": _first,
    "trouble-noise.jpg": _noise,
    "trouble-black.jpg": _black,
    "how-depth.jpg": _depth,
    "how-samples.jpg": _samples,
    "how-strategies.jpg": _strategies,
    "how-sampler.svg": _sampler,
    "how-error.jpg": _error,
    "write-a-material.jpg": _plugins,
    "write-a-light.jpg": _stage,
}
"""Functions that make the files, by name."""

OTHERS: Final[Mapping[str, Sequence[str]]] = {
    "gallery-*.jpg": ["gallery_docs.py"],
    "integrators.jpg": ["integrator_docs.py", "pictures"],
    "caustic.jpg": ["integrator_docs.py", "caustic"],
    "light-paths.jpg": ["light_path_docs.py"],
    "hard-light.jpg": ["integrator_docs.py", "hard"],
    "hard-light-peers.jpg": ["hard_bench.py", "picture", "--images", "images"],
    "speed-equal-time.jpg": ["equal_time.py"],
    "speed.jpg": ["speed_docs.py", "pictures"],
    "speed-growth.svg": ["speed_docs.py"],
    "report-*": ["report_docs"],
    "view.jpg": ["view_page.py", "--documentation"],
}
"""Commands of the scripts that make other files, by file pattern."""


def main() -> int:
    """Make the requested figures, or all."""
    wanted = sys.argv[1:] or ["*"]
    found = [name for name in [*FIGURES, *OTHERS] if any(_asked(name, each) for each in wanted)]
    if not found:
        print(f"there is no picture of that name; choose of {', '.join([*FIGURES, *OTHERS])}", file=sys.stderr)
        return 2
    for name in found:
        if name in FIGURES:
            FIGURES[name](name)
        else:
            script, *arguments = OTHERS[name]
            python = [sys.executable] if script.endswith(".py") else []
            subprocess.run([*python, str(_SCRIPTS / script), *arguments], check=True)
    return 0


def _asked(name: str, wanted: str) -> bool:
    return fnmatch.fnmatch(name, wanted) or fnmatch.fnmatch(wanted, name)


if __name__ == "__main__":
    sys.exit(main())
