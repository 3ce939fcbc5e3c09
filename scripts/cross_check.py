"""Random scenes of every shape, material, texture and light: do clrender and Mitsuba agree?

    .venv/bin/python scripts/cross_check.py FIRST LAST --mitsuba PYTHON [--folder DIR]

Renders the scenes of the seeds FIRST to LAST - 1 six times each with both, and compares means and tiles by Welch's
t-test with Holm's correction over all of them. PYTHON is one that has Mitsuba. New seeds are always a blind test. The
materials are those whose definitions agree: Mitsuba's metals and rough glass lose what is scattered more than once, so
they are nearly smooth here.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt

_ROOT: Final = Path(__file__).resolve().parents[1]
_BATCHES: Final = 6
_SIDE: Final = 48
_SPP: Final = 512
_TILES: Final = 4
_ROUNDING: Final = 1e-4
"""What single precision and the pictures' formats may change, of a mean: some tiles have no noise at all."""
_LEVEL: Final = 0.01
"""False alarms over all means, and over all tiles."""
_SHARP: Final = 0.002
"""Standard error of a mean of which 0.5 % can be told: caustics of small lights leave some without an answer."""
_HALF: Final = 2.0
"""Half the side of the room, metres."""


def _rounded(values: npt.NDArray[np.float64]) -> list[float]:
    return [float(x) for x in values.round(4)]


class _Maker:
    """One random scene."""

    def __init__(self, seed: int, folder: Path) -> None:
        self.random = np.random.default_rng(seed)
        self.folder = folder
        self.shapes: list[dict[str, Any]] = []
        self.lights: list[dict[str, Any]] = []
        self.materials: dict[str, Any] = {"black": {"type": "lambert", "reflectance": [0.0, 0.0, 0.0]}}
        self.flat = [self._material(f"diffuse{i}", self._diffuse()) for i in range(3)]
        self.flat += [self._material(f"texture{i}", self._textured(i)) for i in range(2)]
        self.any = [f"diffuse{i}" for i in range(3)]
        self.any.append(self._material("mirror", {"type": "mirror", "reflectance": self._color(0.6, 0.95)}))
        self.any.append(self._material("glass", {"type": "dielectric", "ior": round(self._number(1.2, 1.9), 3)}))
        rough = {"ior": round(self._number(1.2, 1.8), 3), "roughness": round(self._number(0.1, 0.15), 3)}
        self.any.append(self._material("rough_glass", {"type": "dielectric", **rough}))
        metal = {
            "eta": self._color(0.2, 3.0),
            "k": self._color(2.0, 4.5),
            "roughness": round(self._number(0.1, 0.15), 3),
        }
        self.any.append(self._material("metal", {"type": "conductor", **metal}))

    def _number(self, low: float, high: float) -> float:
        return float(self.random.uniform(low, high))

    def _color(self, low: float, high: float) -> list[float]:
        return _rounded(self.random.uniform(low, high, 3))

    def _place(self, reach: float = 1.3) -> list[float]:
        return _rounded(self.random.uniform(-reach, reach, 3))

    def _normal(self) -> list[float]:
        direction = self.random.normal(size=3)
        return _rounded(direction / np.linalg.norm(direction))

    def _material(self, name: str, described: dict[str, Any]) -> str:
        self.materials[name] = described
        return name

    def _diffuse(self) -> dict[str, Any]:
        return {"type": "lambert", "reflectance": self._color(0.1, 0.9)}

    def _textured(self, number: int) -> dict[str, Any]:
        """A lambertian picture of a few large texels; the second one has a normal map as well."""
        from PIL import Image

        from clrender.image.files import write_image

        texels = self.random.integers(30, 240, (int(self.random.integers(2, 9)), int(self.random.integers(2, 9)), 3))
        Image.fromarray(texels.astype(np.uint8)).save(self.folder / f"texture{number}.png")
        made: dict[str, Any] = {
            "type": "lambert",
            "reflectance": {"texture": f"texture{number}.png", "color_space": "srgb"},
        }
        if number == 1:
            # Little: where a normal turns away from the viewer the two renderers mend it in different ways. Not of 8
            # bits, whose middle is 128 here and 127.5 there.
            tilts = self.random.normal(size=(8, 8, 3)) * [0.02, 0.02, 0.0] + [0.5, 0.5, 1.0]
            write_image(self.folder / "normals.exr", tilts.astype(np.float32))
            made["normal_map"] = {"texture": "normals.exr"}
        return made

    def make(self) -> dict[str, Any]:
        closed = self.random.random() < 0.6
        self._room() if closed else self._floor()
        for _ in range(int(self.random.integers(2, 6))):
            self._thing()
        for _ in range(int(self.random.integers(1, 4))):
            self._light()
        if not self.lights and not any("emission" in shape for shape in self.shapes):
            self._environment()
        position = [self._number(-1.8, 1.8), self._number(-1.0, 1.5), 1.9 if closed else 5.0]
        camera = {"position": position, "target": self._place(0.5), "vertical_fov": round(self._number(45.0, 75.0), 2)}
        return {"camera": camera, "materials": self.materials, "shapes": self.shapes, "lights": self.lights}

    def _quad(self, origin: Any, u: Any, v: Any, **more: Any) -> None:
        self.shapes.append({"type": "quad", "origin": list(origin), "edge_u": list(u), "edge_v": list(v), **more})

    def _floor(self) -> None:
        self._quad(
            (-9.0, -_HALF, -9.0), (0.0, 0.0, 18.0), (18.0, 0.0, 0.0), material=str(self.random.choice(self.flat))
        )

    def _room(self) -> None:
        h, s = _HALF, 2.0 * _HALF
        for origin, u, v in (
            ((-h, -h, -h), (0.0, 0.0, s), (s, 0.0, 0.0)),
            ((-h, h, -h), (s, 0.0, 0.0), (0.0, 0.0, s)),
            ((-h, -h, -h), (s, 0.0, 0.0), (0.0, s, 0.0)),
            ((-h, -h, h), (0.0, s, 0.0), (s, 0.0, 0.0)),
            ((-h, -h, -h), (0.0, s, 0.0), (0.0, 0.0, s)),
            ((h, -h, -h), (0.0, 0.0, s), (0.0, s, 0.0)),
        ):
            self._quad(origin, u, v, material=str(self.random.choice(self.flat)))

    def _thing(self) -> None:
        kind = self.random.choice(["sphere", "box", "disk", "triangle", "quad"])
        material, plain = str(self.random.choice(self.any)), f"diffuse{self.random.integers(3)}"
        if kind == "sphere":
            radius = round(self._number(0.15, 0.6), 3)
            self.shapes.append({"type": "sphere", "center": self._place(), "radius": radius, "material": material})
        elif kind == "box":
            size = _rounded(self.random.uniform(0.2, 0.9, 3))
            self.shapes.append({"type": "box", "center": self._place(), "size": size, "material": material})
        elif kind == "disk":
            radius = round(self._number(0.2, 0.7), 3)
            disk = {"center": self._place(), "normal": self._normal(), "radius": radius, "material": plain}
            self.shapes.append({"type": "disk", **disk})
        elif kind == "triangle":
            corners = [_rounded(np.array(self._place()) + self.random.uniform(-0.7, 0.7, 3)) for _ in range(3)]
            self.shapes.append({"type": "triangle", "vertices": corners, "material": plain})
        else:
            self._quad(self._place(), self._place(0.8), self._place(0.8), material=str(self.random.choice(self.flat)))

    def _light(self) -> None:
        kind = self.random.choice(["sphere", "disk", "quad", "point", "directional", "constant", "map"])
        place = _rounded(self.random.uniform([-1.5, 0.8, -1.5], [1.5, 1.8, 1.5]))
        bright = {"emission": _rounded(self.random.uniform(0.3, 1.0, 3) * self._number(3.0, 25.0)), "material": "black"}
        if kind == "sphere":
            self.shapes.append(
                {"type": "sphere", "center": place, "radius": round(self._number(0.05, 0.3), 3), **bright}
            )
        elif kind == "disk":
            disk = {"center": place, "normal": self._normal(), "radius": round(self._number(0.1, 0.4), 3)}
            self.shapes.append({"type": "disk", **disk, **bright})
        elif kind == "quad":
            self._quad(place, self._place(0.6), self._place(0.6), **bright)
        elif kind == "point":
            self.lights.append({"type": "point", "position": place, "intensity": bright["emission"]})
        elif kind == "directional":
            x, y, z = self._normal()
            self.lights.append(
                {"type": "directional", "direction": [x, -abs(y) - 0.3, z], "irradiance": bright["emission"]}
            )
        else:
            self._environment(mapped=bool(kind == "map"))

    def _environment(self, mapped: bool = False) -> None:
        if any(light["type"] == "environment" for light in self.lights):
            return
        if not mapped:
            self.lights.append({"type": "environment", "radiance": self._color(0.1, 1.0)})
            return
        from clrender.image.files import write_image

        sky = self.random.uniform(0.1, 1.0, (32, 64, 3)).astype(np.float32)
        row, column = int(self.random.integers(4, 14)), int(self.random.integers(64))
        sky[row, column] = self._number(100.0, 400.0)
        # In blocks: the rows of Mitsuba's maps reach from pole to pole, so that one of H is H / (H - 1) of ours. Not as
        # .hdr, whose mantissas are m + 1/2 here, as in Radiance, and m there.
        write_image(self.folder / "sky.exr", sky.repeat(32, axis=0).repeat(32, axis=1))
        self.lights.append({"type": "environment", "file": "sky.exr"})


def _in_mitsuba(folders: list[Path]) -> None:
    """The Mitsuba side: `folder`/scene.json -> `folder`/mitsuba.npy, (batches, height, width, 3)."""
    sys.path.insert(0, str(_ROOT / "clrender" / "bench"))
    import mitsuba

    mitsuba.set_variant("llvm_ad_rgb")
    import peer_mitsuba  # type: ignore[import-not-found]
    from peer_scene import Job

    for folder in folders:
        job = Job("llvm_ad_rgb", folder / "scene.json", _SIDE, _SIDE, _SPP, -1, folder / "mitsuba.npy")
        scene = peer_mitsuba.load(job)
        images = [np.array(mitsuba.render(scene, spp=_SPP, seed=1 + k)) for k in range(_BATCHES)]
        np.save(job.image, np.array(images, np.float32))
        print(folder.name, flush=True)


def _compare(folders: list[Path]) -> bool:
    """Render with clrender, print a line a scene and a verdict; whether all agree."""
    import clrender
    from clrender.agreement.significance import holm, welch

    means, tiles, ratios, errors = [], [], [], []
    with clrender.Session() as session:
        for folder in folders:
            scene = clrender.load(str(folder / "scene.json"))
            size = (_SIDE, _SIDE)
            own = np.array([session.render(scene, spp=_SPP, size=size, seed=100 + k).linear for k in range(_BATCHES)])
            other = np.load(folder / "mitsuba.npy")
            side = _SIDE // _TILES
            split = [
                x.mean(-1).reshape(-1, _TILES, side, _TILES, side).mean((2, 4)).reshape(_BATCHES, -1)
                for x in (own, other)
            ]
            whole = [x.astype(np.float64).mean((1, 2)) for x in (own, other)]
            mean, tile = (welch(a, b, _ROUNDING * b.mean(0)) for a, b in (whole, split))
            ratios.append(float(whole[0].mean() / whole[1].mean()))
            means.append(mean.p)
            tiles.append(tile.p)
            z = tile.z[np.abs(tile.z).argmax()]
            errors.append(float(np.abs(mean.error / whole[1].mean(0)).max()))
            print(f"{folder.name}: ratio {ratios[-1]:.5f}, error {errors[-1]:.5f}, worst tile z {z:+.1f}", flush=True)
    rejected = [int(holm(np.concatenate(p), _LEVEL).sum()) for p in (means, tiles)]
    sharp = [ratio for ratio, error in zip(ratios, errors, strict=True) if error < _SHARP]
    far = sum(abs(ratio - 1.0) > 0.005 for ratio in sharp)
    print(
        f"{len(folders)} scenes: {rejected[0]} means and {rejected[1]} tiles differ significantly; "
        f"of {len(sharp)} means that are known to {_SHARP:.1%} {far} differ by 0.5 %"
    )
    return not any(rejected)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("first", type=int)
    parser.add_argument("last", type=int)
    parser.add_argument("--mitsuba", help="a Python that has Mitsuba")
    parser.add_argument("--folder", type=Path, default=Path("cross_check"))
    parser.add_argument("--in-mitsuba", action="store_true", help=argparse.SUPPRESS)
    asked = parser.parse_args()
    folders = [asked.folder.resolve() / str(seed) for seed in range(asked.first, asked.last)]
    if asked.in_mitsuba:
        _in_mitsuba(folders)
        return
    for seed, folder in enumerate(folders, asked.first):
        folder.mkdir(parents=True, exist_ok=True)
        (folder / "scene.json").write_text(json.dumps(_Maker(seed, folder).make()), encoding="utf-8")
    if asked.mitsuba:
        command = [
            asked.mitsuba,
            __file__,
            str(asked.first),
            str(asked.last),
            "--folder",
            str(asked.folder),
            "--in-mitsuba",
        ]
        subprocess.run(command, check=True, env={**os.environ, "PYTHONPATH": ""})
    sys.exit(0 if _compare(folders) else 1)


if __name__ == "__main__":
    main()
