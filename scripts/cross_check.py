"""Random scenes of every shape, material, texture and light: do clrender and Mitsuba agree?

    .venv/bin/python scripts/cross_check.py FIRST LAST --mitsuba PYTHON [--with media,spots,cameras] [--folder DIR]
    .venv/bin/python scripts/cross_check.py spheres --mitsuba PYTHON [--folder DIR]

Renders the scenes of the seeds FIRST to LAST - 1 six times each with both, and compares means and tiles by Welch's
t-test with Holm's correction over all of them. PYTHON is one that has Mitsuba. New seeds are always a blind test. The
materials are those whose definitions agree: rough metals and glass lose what meets a second facet, as Mitsuba's do,
and alpha is at most 0.09: beyond it one sees that Mitsuba's masking and shadowing do not depend on each other.

`--with` adds kinds of things, each in most of the scenes: `media` (clouds, filled glass, fog), `spots`, `cameras`
(orthographic, and with a lens), `opacity` (constant, and pictures with holes), `skies`, `tent` (that pixel filter),
`roughness` (pictures of it, on metals and glass), `plastics` (smooth, rough and textured) and `cylinders`. With
`spectra` some colours are spectra, and both render wavelengths (Mitsuba's `scalar_spectral`). Of Mitsuba's
integrators media and opacity take `volpath`. Its cylinders are round, and ours have 128 sides. Its plastics are those
of mitsuba_plastic.py, because its own have another Fresnel term; `spheres` shows how far they are off.

Mitsuba 3.9.1 loses light of spheres that stand close to a cloud: of seed 8192, a lamp 4 cm from one, it returns 16 %
less single scattering than a plain Monte Carlo integral of it, with which clrender agrees to 0.02 %.

With `spheres` the scenes are single spheres between two lamps, one material each; some are defined differently.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final
from xml.etree import ElementTree

import numpy as np
import numpy.typing as npt

_BATCHES: Final = 6
_SIDE: Final = 48
_SPP: Final = 512
_TILES: Final = 4
_ROUNDING: Final = 1e-4
"""Relative tolerance of a mean for single precision and image formats: some tiles have no noise at all."""
_LEVEL: Final = 0.01
"""Probability of a false alarm over all means, and over all tiles."""
_SHARP: Final = 0.002
"""Largest standard error of a mean that can reveal 0.5 %: caustics of small lights leave some scenes undecided."""
_CYLINDER: Final = "cylinder"
"""Beginning of names of meshes that are cylinders of radius 1, from 0 to 1 along z, under their transforms."""
_ROWS: Final = 64
"""Rows of triangles of such a mesh."""
_BLACK: Final = {"type": "lambert", "reflectance": [0.0, 0.0, 0.0]}
_SPECTRAL: Final = "CROSS_CHECK_SPECTRAL"
"""Environment variable that is set where both render wavelengths."""
_HALF: Final = 2.0
"""Half the side of the room, metres."""
_MORE: Final = (
    "media",
    "spots",
    "cameras",
    "opacity",
    "skies",
    "tent",
    "roughness",
    "plastics",
    "cylinders",
    "spectra",
)
"""Optional features of scenes."""
_WAVES: Final = [360.0, 420.0, 480.0, 560.0, 620.0, 830.0]
_INDEX_WAVES: Final = [360.0, 451.0, 549.0, 617.0, 830.0]
_MOST: Final = 0.8
"""Fraction of the scenes that have a feature."""


def _rounded(values: npt.NDArray[np.float64]) -> list[float]:
    return [float(x) for x in values.round(4)]


def _seeds(number: int) -> range:
    """Seeds of the batches of a scene; other scenes have others, as directly visible parts are alike in many."""
    return range(1 + number * _BATCHES, 1 + (number + 1) * _BATCHES)


class _Maker:
    """Generator of one random scene."""

    def __init__(self, seed: int, folder: Path, more: frozenset[str] = frozenset()) -> None:
        self.random = np.random.default_rng(seed)
        self.folder = folder
        self.more = more
        self.media: dict[str, Any] = {}
        self.fog: str | None = None
        self.shapes: list[dict[str, Any]] = []
        self.lights: list[dict[str, Any]] = []
        self.materials: dict[str, Any] = {"black": dict(_BLACK)}
        self.flat = [self._material(f"diffuse{i}", self._diffuse()) for i in range(3)]
        self.flat += [self._material(f"texture{i}", self._textured(i)) for i in range(2)]
        self.any = [f"diffuse{i}" for i in range(3)]
        self.any.append(self._material("mirror", {"type": "mirror", "reflectance": self._color(0.6, 0.95)}))
        self.any.append(self._material("glass", {"type": "dielectric", "ior": round(self._number(1.2, 1.9), 3)}))
        rough: dict[str, Any] = {"ior": round(self._number(1.2, 1.8), 3), "roughness": round(self._number(0.1, 0.3), 3)}
        rough |= {"multiple_scattering": False, "microfacets": ("ggx", "beckmann")[seed % 2]}
        self.any.append(self._material("rough_glass", {"type": "dielectric", **rough}))
        metal = {
            "eta": self._color(0.2, 3.0),
            "k": self._color(2.0, 4.5),
            "roughness": round(self._number(0.1, 0.3), 3),
            "multiple_scattering": False,
            "microfacets": ("beckmann", "ggx")[seed % 2],
        }
        self.any.append(self._material("metal", {"type": "conductor", **metal}))
        if "roughness" in more:
            for name in ("rough_glass", "metal"):
                self.materials[name]["roughness"] = self._roughness(name, 0.3)
        if "plastics" in more:
            self._plastics()

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
        """A Lambertian texture of a few large texels; the second one also has a normal map."""
        from PIL import Image

        from clrender.image.files import write_image

        texels = self.random.integers(30, 240, (int(self.random.integers(2, 9)), int(self.random.integers(2, 9)), 3))
        Image.fromarray(texels.astype(np.uint8)).save(self.folder / f"texture{number}.png")
        made: dict[str, Any] = {
            "type": "lambert",
            "reflectance": {"texture": f"texture{number}.png", "color_space": "srgb"},
        }
        if number == 1:
            # Small slopes: the two renderers correct normals that face away from the viewer in different ways. Not 8
            # bits, whose middle is 128 here and 127.5 there.
            tilts = self.random.normal(size=(8, 8, 3)) * [0.02, 0.02, 0.0] + [0.5, 0.5, 1.0]
            write_image(self.folder / "normals.exr", tilts.astype(np.float32))
            made["normal_map"] = {"texture": "normals.exr"}
            # Mitsuba interpolates between texels, clrender's paths pick one of them, with the same random numbers for
            # all textures at a vertex. The result is the same for one texture that enters linearly, as that of number 0
            for picture in (made["reflectance"], made["normal_map"]):
                picture["filter"] = "nearest"
        return made

    def _roughness(self, name: str, most: float) -> dict[str, Any]:
        """A picture of roughness from 0.1, of a few large texels."""
        from PIL import Image

        texels = self.random.integers(26, round(255 * most), self.random.integers(2, 9, 2))
        Image.fromarray(texels.astype(np.uint8)).save(self.folder / f"{name}.png")
        return {"texture": f"{name}.png", "channel": "r", "filter": "nearest"}

    def _plastics(self) -> None:
        """A smooth, a textured and a rough one."""
        bases = [self._color(0.1, 0.9), self.materials["texture0"]["reflectance"] | {"filter": "nearest"}]
        rough = self._roughness("plastic", 0.6) if "roughness" in self.more else round(self._number(0.1, 0.6), 3)
        for number, (base, roughness) in enumerate(zip([*bases, bases[0]], (0.0, 0.0, rough), strict=True)):
            made = {"type": "principled", "base_color": base, "ior": round(self._number(1.2, 1.9), 3)}
            self.any.append(self._material(f"plastic{number}", {**made, "roughness": roughness}))

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
        # At the end, so that the scene of a seed without them does not change
        for kind, add in (
            ("spots", self._spots),
            ("opacity", self._masks),
            ("skies", self._sky),
            ("cylinders", self._cylinders),
        ):
            if kind in self.more and self.random.random() < _MOST:
                add()
        if closed and not any("emission" in each or each["type"] in ("point", "spot") for each in self._all()):
            # Else the only light would be leaks by rounding between two walls
            self._quad((-0.5, 1.9, -0.5), (1.0, 0.0, 0.0), (0.0, 0.0, 1.0), emission=[6.0] * 3, material="black")
        if "media" in self.more and self.random.random() < _MOST:
            self._fill(closed)
        if "cameras" in self.more and self.random.random() < _MOST:
            camera = self._lens(camera)
        if "spectra" in self.more:
            self._spectra()
        made = {"camera": camera, "materials": self.materials, "shapes": self.shapes, "lights": self.lights}
        if self.media:
            made["media"] = self.media
        if "tent" in self.more:
            made["render"] = {"filter": "tent"}
        return made if self.fog is None else {**made, "fog": self.fog}

    def _spectra(self) -> None:
        """Spectra in the place of some colours, and of the indices of metals.

        Of an index that is three numbers, Mitsuba 3.9.1 cuts off at 1 what is more.
        """
        for material in self.materials.values():
            color = material.get("reflectance")
            if isinstance(color, list) and max(color) > 0.0 and self.random.random() < 0.5:
                shares = self.random.uniform(0.05, 1.0, 6) * max(color)
                material["reflectance"] = {"wavelengths": _WAVES, "values": _rounded(shares)}
            for key in {"eta", "k"} & material.keys():
                red, green, blue = material[key]
                material[key] = {"wavelengths": _INDEX_WAVES, "values": [blue, blue, green, red, red]}
        for each in self._all():
            for key in ("emission", "intensity", "irradiance", "radiance"):
                if isinstance(each.get(key), list) and self.random.random() < 0.5:
                    scale = round(0.5 * max(each[key]), 4)
                    kind = str(self.random.choice(["A", "D50", "E", "FL11", "LED-B3", "HP1", "blackbody"]))
                    said = {"blackbody": round(self._number(2000.0, 9000.0))}
                    each[key] = {**(said if kind == "blackbody" else {"illuminant": kind}), "scale": scale}

    def _all(self) -> list[dict[str, Any]]:
        return [*self.shapes, *self.lights]

    def _spots(self) -> None:
        for _ in range(int(self.random.integers(1, 3))):
            place = np.array(_rounded(self.random.uniform([-1.5, 0.5, -1.5], [1.5, 1.8, 1.5])))
            cone = {"cone_degrees": round(self._number(30.0, 130.0), 2), "blend": round(self._number(0.05, 1.0), 3)}
            towards = _rounded(np.array(self._place(0.8)) - [0.0, 1.0, 0.0] - place)
            bright = _rounded(self.random.uniform(0.3, 1.0, 3) * self._number(5.0, 40.0))
            self.lights.append(
                {"type": "spot", "position": place.tolist(), "direction": towards, "intensity": bright, **cone}
            )

    def _lens(self, camera: dict[str, Any]) -> dict[str, Any]:
        """An orthographic camera, or a thin lens instead of a pinhole."""
        if self.random.random() < 0.5:
            lens = {"aperture_radius": round(self._number(0.02, 0.12), 3), "focus_distance": self._number(1.0, 5.0)}
            return {**camera, **lens}
        # Nearly straight on: its rays begin in a plane that contains no object. Horizontal rays would all hit the
        # horizon, where a sky without ground has two values
        x, y, z = round(self._number(-0.4, 0.4), 3), round(self._number(-0.4, 0.4), 3), camera["position"][2]
        both = {"position": [x, y, z], "target": [x, y - 0.05, 0.0], "height": round(self._number(1.5, 3.0), 3)}
        return {"type": "orthographic", **both}

    def _medium(self, most: float) -> str:
        name = f"medium{len(self.media)}"
        scattering = self.random.uniform(0.2, 1.0, 3) * self._number(0.1, 1.0) * most
        absorption = self.random.uniform(0.0, 0.4, 3) * scattering
        g = round(self._number(-0.5, 0.8), 3)
        self.media[name] = {"absorption": _rounded(absorption), "scattering": _rounded(scattering), "g": g}
        return name

    def _fill(self, closed: bool) -> None:
        """Clouds, milk in glass, and in closed rooms fog; transmissive shapes must not overlap."""
        clear = ("glass", "rough_glass")
        apart: list[dict[str, Any]] = []
        for shape in list(self.shapes):
            if shape.get("material") in clear:
                if all(_apart(shape, other) for other in apart):
                    apart.append(shape)
                else:
                    self.shapes.remove(shape)
        for shape in apart:
            if self.random.random() < 0.4:
                shape["interior"] = self._medium(6.0)
        for _ in range(int(self.random.integers(1, 4))):
            place = _rounded(self.random.uniform(-1.1, 1.1, 3))
            if self.random.random() < 0.6:
                cloud: dict[str, Any] = {"type": "sphere", "center": place, "radius": round(self._number(0.3, 0.7), 3)}
            else:
                cloud = {"type": "box", "center": place, "size": _rounded(self.random.uniform(0.3, 0.9, 3))}
            if all(_apart(cloud, other) for other in apart):
                apart.append(cloud)
                self.shapes.append({**cloud, "interior": self._medium(6.0)})
        near = all(light["type"] in ("point", "spot") for light in self.lights)
        if closed and near and self.random.random() < 0.6:
            self.fog = self._medium(0.3)

    def _masks(self) -> None:
        """Quads with opacity: constant, or textured with holes."""
        from PIL import Image

        for number in range(int(self.random.integers(1, 4))):
            described: dict[str, Any] = self._diffuse()
            if self.random.random() < 0.4:
                described["opacity"] = round(self._number(0.1, 0.9), 3)
            else:
                texels = self.random.integers(0, 2, (8, 8, 4)) * 255
                if self.random.random() < 0.5:
                    texels = self.random.integers(0, 256, (8, 8, 4))
                Image.fromarray(texels.astype(np.uint8), "RGBA").save(self.folder / f"mask{number}.png")
                described["opacity"] = {"texture": f"mask{number}.png", "channel": "a", "filter": "nearest"}
            name = self._material(f"mask{number}", described)
            self._quad(self._place(), self._place(1.2), self._place(1.2), material=name)

    def _sky(self) -> None:
        """Replaces another environment by the sky alone, since the sun's disc differs in both."""
        self.lights = [light for light in self.lights if light["type"] != "environment"]
        x, y, z = self._normal()
        sky = {"sun_direction": [x, abs(y) + 0.1, z], "turbidity": round(self._number(2.0, 8.0), 2)}
        ground = {"ground": False, "ground_albedo": round(self._number(0.0, 0.8), 3)}
        scales = {"sun_scale": 0.0, "sky_scale": 0.01}
        self.lights.append({"type": "sun_sky", **sky, **ground, **scales})

    def _cylinders(self) -> None:
        """Open cylinders; their material is opaque, as they enclose nothing."""
        _write_cylinder(self.folder / "cylinder.ply")
        opaque = [name for name in self.any if "glass" not in name] + ["texture0"]
        for number in range(int(self.random.integers(1, 4))):
            turn, _ = np.linalg.qr(self.random.normal(size=(3, 3)))
            turn[:, 0] *= np.linalg.det(turn)
            radius, size = self.random.uniform([0.1, 0.2], [0.5, 1.5])
            matrix = np.column_stack([turn * [radius, radius, size], self._place()])
            shape: dict[str, Any] = {"type": "mesh", "file": "cylinder.ply", "name": f"{_CYLINDER}{number}"}
            shape |= {"transform": {"matrix": [*matrix.tolist(), [0.0, 0.0, 0.0, 1.0]]}}
            shape |= {"material": str(self.random.choice(opaque))}
            if self.random.random() < 0.2:
                shape |= {"material": "black", "emission": self._color(1.0, 8.0)}
            self.shapes.append(shape)

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
            # Without the normal map: from behind, clrender reverses the normal, as glTF asks, but Mitsuba mirrors it
            place, u, v, flat = self._place(), self._place(0.8), self._place(0.8), str(self.random.choice(self.flat))
            self._quad(place, u, v, material="texture0" if flat == "texture1" else flat)

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


def _write_cylinder(path: Path) -> None:
    """A cylinder with texture coordinates as Mitsuba's has them.

    In rows, since the test of a ray and a triangle allows for rounding, by a share of the length of slender triangles.
    """
    from clrender.exporters.triangles import write_plain_ply
    from clrender.importers.shared.meshes import cylinder_mesh
    from clrender.meshes.data import MeshData

    tube = cylinder_mesh(1.0, 0.0, 1.0)
    assert tube.uvs is not None and tube.normals is not None
    rise = np.arange(_ROWS)
    vertices = np.tile(tube.vertices, (_ROWS, 1, 1))
    vertices[..., 2] = (vertices[..., 2] + rise[:, None]) / _ROWS
    uvs = np.tile(tube.uvs, (_ROWS, 1, 1, 1))
    uvs[..., 1] = (uvs[..., 1] + rise[:, None, None]) / _ROWS
    triangles = tube.triangles + np.uint32(len(tube.vertices)) * rise.astype(np.uint32)[:, None, None]
    normals = np.tile(tube.normals, (_ROWS, 1))
    mesh = MeshData(vertices.reshape(-1, 3), triangles.reshape(-1, 3), normals=normals, uvs=uvs.reshape(-1, 3, 2))
    with path.open("wb") as file:
        write_plain_ply(file, mesh, mesh.uvs)


def _ball(shape: dict[str, Any]) -> tuple[Any, float]:
    """Centre and radius of a bounding sphere of a sphere or box."""
    size = shape["radius"] if shape["type"] == "sphere" else 0.5 * np.linalg.norm(shape["size"])
    return np.array(shape["center"]), float(size)


def _apart(one: dict[str, Any], other: dict[str, Any]) -> bool:
    (a, r), (b, s) = _ball(one), _ball(other)
    return bool(np.linalg.norm(a - b) > r + s + 1e-3)


_GOLD: Final = {"eta": [0.21, 0.43, 1.38], "k": [3.272, 2.455, 1.914]}
_RED: Final = {"type": "lambert", "reflectance": [0.7, 0.3, 0.1]}
_SILK: Final = {"type": "conductor", **_GOLD, "roughness": 0.1}
_ONCE: Final[dict[str, dict[str, Any]]] = {
    "GGX": {"multiple_scattering": False},
    "Beckmann": {"multiple_scattering": False, "microfacets": "beckmann"},
}
_SPHERES: Final[dict[str, dict[str, Any]]] = {
    "lambert": _RED,
    "mirror": {"type": "mirror", "reflectance": [0.9, 0.8, 0.7]},
    "smooth gold": {"type": "conductor", **_GOLD, "roughness": 0.0},
    "gold, alpha 0.01": _SILK,
    "brushed gold, alpha 0.003 and 0.01": {"type": "conductor", **_GOLD, "roughness": 0.0548, "anisotropy": 0.084},
    "smooth glass": {"type": "dielectric", "ior": 1.5},
    "thin glass": {"type": "dielectric", "ior": 1.5, "thin": True},
    "rough glass, alpha 0.01": {"type": "dielectric", "ior": 1.5, "roughness": 0.1},
    **{
        f"gold, alpha 0.1 of {name}, that reflects once": {
            "type": "conductor",
            **_GOLD,
            "roughness": 0.316227766,
            **once,
        }
        for name, once in _ONCE.items()
    },
    **{
        f"glass, alpha 0.1 of {name}, met once": {"type": "dielectric", "ior": 1.5, "roughness": 0.316227766, **once}
        for name, once in _ONCE.items()
    },
    "plastic": {"type": "principled", "base_color": [0.7, 0.3, 0.1], "roughness": 0.0},
    "rough plastic, alpha 0.16": {"type": "principled", "base_color": [0.7, 0.3, 0.1], "roughness": 0.4},
    # Without smooth parts: Mitsuba's `blendbsdf` adds the probability of a delta to the density of the other part
    "mixture of lambert and gold": {"type": "mix", "materials": ["red", "silk"], "weight": 0.3},
}
"""Spheres of materials with the same definition in both."""
_OTHERS: Final[dict[str, tuple[dict[str, Any], str]]] = {
    "gold, alpha 0.2": (
        {"type": "conductor", **_GOLD, "roughness": 0.4472135955},
        "Mitsuba loses what is scattered more than once",
    ),
    "rough glass, alpha 0.1": (
        {"type": "dielectric", "ior": 1.5, "roughness": 0.316227766},
        "Mitsuba loses what is scattered more than once",
    ),
    "Mitsuba's plastic": (
        {"type": "principled", "base_color": [0.7, 0.3, 0.1], "roughness": 0.0},
        "Schlick's Fresnel term here, Fresnel's own there",
    ),
    "Mitsuba's rough plastic": (
        {"type": "principled", "base_color": [0.7, 0.3, 0.1], "roughness": 0.4},
        "glTF's plastic here, Disney's there",
    ),
}
"""Spheres of materials with different definitions, and why."""


def _folder_name(name: str) -> str:
    return re.sub("[^a-zA-Z0-9.]+", "_", name)


def _lamp(origin: list[float], u: list[float], v: list[float], emission: list[float]) -> dict[str, Any]:
    return {"type": "quad", "origin": origin, "edge_u": u, "edge_v": v, "emission": emission, "material": "black"}


def _spheres(folder: Path) -> list[Path]:
    """Write the scenes: the sphere nearly fills the image, between two lamps under a constant sky."""
    folders = []
    for name, made in (_SPHERES | {name: made for name, (made, _) in _OTHERS.items()}).items():
        place = folder / _folder_name(name)
        place.mkdir(parents=True, exist_ok=True)
        scene = {
            "camera": {"position": [0.0, 1.0, 3.9], "target": [0.0, 0.0, 0.0], "vertical_fov": 26.0},
            "materials": {"black": _BLACK, "red": _RED, "silk": _SILK, "this": made},
            "shapes": [
                {"type": "sphere", "center": [0.0, 0.0, 0.0], "radius": 1.0, "material": "this"},
                _lamp([-3.0, 0.5, 3.0], [1.5, 0.0, 1.0], [0.0, 1.5, 0.0], [9.0, 8.0, 6.0]),
                _lamp([1.5, -2.0, -3.0], [1.5, 0.0, 0.0], [0.0, 1.0, 0.5], [3.0, 5.0, 8.0]),
            ],
            "lights": [{"type": "environment", "radiance": [0.4, 0.5, 0.6]}],
        }
        (place / "scene.json").write_text(json.dumps(scene), encoding="utf-8")
        folders.append(place)
    return folders


def _in_mitsuba(folders: list[Path]) -> None:
    """The Mitsuba side: `folder`/scene.xml -> `folder`/mitsuba.npy, (batches, height, width, 3)."""
    import mitsuba
    import mitsuba_plastic

    # Under LLVM 15 the vectorised spectral variant has no code for some processors
    mitsuba.set_variant("scalar_spectral" if os.environ.get(_SPECTRAL) else "llvm_ad_rgb")
    mitsuba_plastic.register(mitsuba)
    others = {_folder_name(name) for name in _OTHERS}
    for number, folder in enumerate(folders):
        file = folder / "scene.xml"
        file = file if folder.name in others else mitsuba_plastic.with_plastics(file)
        # Mitsuba 3.9.1 omits merged meshes from the scene's bounding box, and shadow rays to a sky then end too early
        scene = mitsuba.load_file(str(file), optimize=False)
        images = [np.array(mitsuba.render(scene, spp=_SPP, seed=seed)) for seed in _seeds(number)]
        np.save(folder / "mitsuba.npy", np.array(images, np.float32))
        print(folder.name, flush=True)


def _for_mitsuba(folder: Path) -> None:
    """Write `folder`/scene.json as scene.xml."""
    import clrender
    from clrender.exporters import write_mitsuba

    settings = {"image.width": _SIDE, "image.height": _SIDE, "render.spp": _SPP}
    write_mitsuba(clrender.load(folder / "scene.json").changed(settings), folder / "scene.xml")
    tree = ElementTree.parse(folder / "scene.xml")
    for shape in tree.iter("shape"):
        if shape.get("id", "").startswith(_CYLINDER):
            shape.set("type", "cylinder")
            shape.remove(shape.find("string"))  # type: ignore[arg-type]
    tree.write(folder / "scene.xml")


@dataclass
class _Comparison:
    """Result for one scene; each array has the shape (k,)."""

    name: str
    ratio: float
    """Our mean over theirs."""
    error: float
    """Relative standard error of the mean of the worst channel."""
    means: npt.NDArray[np.float64]
    tiles: npt.NDArray[np.float64]
    """p-values."""
    deviate: float
    """Deviate of the tile with the largest difference."""


def _ours(session: Any, folder: Path, number: int) -> npt.NDArray[np.float32]:
    import clrender

    scene = clrender.load(str(folder / "scene.json"))
    size = (_SIDE, _SIDE)
    spectral = bool(os.environ.get(_SPECTRAL))
    own = np.array(
        [session.render(scene, spp=_SPP, size=size, seed=seed, spectral=spectral).linear for seed in _seeds(number)]
    )
    np.save(folder / "clrender.files.npy", own)
    return own


def _comparison(name: str, own: npt.NDArray[np.float32], other: npt.NDArray[np.float32]) -> _Comparison:
    from clrender.agreement.significance import welch

    side = _SIDE // _TILES
    split = [
        x.mean(-1).reshape(-1, _TILES, side, _TILES, side).mean((2, 4)).reshape(_BATCHES, -1) for x in (own, other)
    ]
    whole = [x.astype(np.float64).mean((1, 2)) for x in (own, other)]
    mean, tile = (welch(a, b, _ROUNDING * b.mean(0)) for a, b in (whole, split))
    with np.errstate(divide="ignore", invalid="ignore"):  # for completely black scenes
        error = float(np.abs(mean.error / whole[1].mean(0)).max())
        ratio = float(whole[0].mean() / whole[1].mean())
    return _Comparison(name, ratio, error, mean.p, tile.p, float(tile.z[np.abs(tile.z).argmax()]))


def _adjusted(p_values: list[npt.NDArray[np.float64]]) -> tuple[float, int, int]:
    """The smallest p-value after Holm's correction, the number of significant ones, and their total."""
    from clrender.agreement.significance import holm

    p = np.concatenate(p_values)
    return min(1.0, float(p.min()) * len(p)), int(holm(p, _LEVEL).sum()), len(p)


def _compare(folders: list[Path]) -> bool:
    """Render with clrender, print a line per scene and a verdict; returns whether all agree."""
    import clrender

    found = []
    with clrender.Session() as session:
        for number, folder in enumerate(folders):
            one = _comparison(folder.name, _ours(session, folder, number), np.load(folder / "mitsuba.npy"))
            found.append(one)
            words = f"ratio {one.ratio:.5f}, error {one.error:.5f}, worst tile z {one.deviate:+.1f}"
            print(f"{one.name}: {words}", flush=True)
    return _verdict(found)


def _verdict(found: list[_Comparison]) -> bool:
    (p_mean, means, mean_count), (p_tile, tiles, tile_count) = (
        _adjusted(each) for each in ([one.means for one in found], [one.tiles for one in found])
    )
    sharp = [one.ratio for one in found if one.error < _SHARP]
    far = sum(abs(ratio - 1.0) > 0.005 for ratio in sharp)
    print(
        f"{len(found)} scenes: {means} of {mean_count} means and {tiles} of {tile_count} tiles differ significantly "
        f"(smallest p after Holm's correction {p_mean:.2g} and {p_tile:.2g}); "
        f"of {len(sharp)} means that are known to {_SHARP:.1%} {far} differ by 0.5 %"
    )
    return means + tiles == 0


def _compare_spheres(folders: list[Path]) -> bool:
    """Render with clrender and print a table; returns whether all agree that should."""
    import clrender

    with clrender.Session() as session:
        names = [*_SPHERES, *_OTHERS]
        found = [
            _comparison(name, _ours(session, folder, number), np.load(folder / "mitsuba.npy"))
            for number, (name, folder) in enumerate(zip(names, folders, strict=True))
        ]
    print("| sphere | mean over Mitsuba's | ± | worst tile, standard deviations | |\n|---|---:|---:|---:|---|")
    for one in found:
        reason = _OTHERS[one.name][1] if one.name in _OTHERS else ""
        print(f"| {one.name} | {one.ratio:.5f} | {one.error:.5f} | {one.deviate:+.1f} | {reason} |")
    return _verdict([one for one in found if one.name in _SPHERES])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("scenes", nargs="+", metavar="FIRST LAST | spheres")
    parser.add_argument("--mitsuba", help="a Python that has Mitsuba")
    parser.add_argument("--with", dest="more", default="", metavar="KINDS", help=", ".join(_MORE) + ", by commas")
    parser.add_argument("--folder", type=Path, default=Path("cross_check"))
    parser.add_argument("--in-mitsuba", action="store_true", help=argparse.SUPPRESS)
    asked = parser.parse_args()
    folder = asked.folder.resolve()
    if asked.in_mitsuba:
        _in_mitsuba([folder / name for name in asked.scenes])
        return
    more = frozenset(filter(None, asked.more.split(",")))
    if not more <= set(_MORE):
        parser.error(f"--with takes {', '.join(_MORE)}")
    if "spectra" in more:
        os.environ[_SPECTRAL] = "1"
    spheres = asked.scenes == ["spheres"]
    if spheres:
        folders = _spheres(folder)
    elif len(asked.scenes) == 2 and all(text.isdecimal() for text in asked.scenes):
        first, last = map(int, asked.scenes)
        folders = [folder / str(seed) for seed in range(first, last)]
        for seed, place in enumerate(folders, first):
            place.mkdir(parents=True, exist_ok=True)
            (place / "scene.json").write_text(json.dumps(_Maker(seed, place, more).make()), encoding="utf-8")
    else:
        parser.error("give the first seed and the one after the last, such as 0 100, or `spheres`")
    if asked.mitsuba:
        for place in folders:
            _for_mitsuba(place)
        names = [place.name for place in folders]
        command = [asked.mitsuba, __file__, *names, "--folder", str(folder), "--in-mitsuba"]
        subprocess.run(command, check=True, env={**os.environ, "PYTHONPATH": ""})
    sys.exit(0 if (_compare_spheres if spheres else _compare)(folders) else 1)


if __name__ == "__main__":
    main()
