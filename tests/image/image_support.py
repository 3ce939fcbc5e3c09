"""What the table of equal hashes is made of: scenes, the ways to cut the work, and a render of one on given devices."""

from __future__ import annotations

import functools
import itertools
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final
from unittest.mock import patch

import numpy as np

import clrender
from clrender.bench import write_scene
from clrender.film.unit import Unit, slot_count
from clrender.scene.materials import Lambert, OrenNayar
from clrender.scheduling.policy import Plan

if TYPE_CHECKING:
    from clrender.device import Device
    from clrender.rendering.rendered_image import RenderedImage
    from clrender.scene import Scene

__all__ = [
    "LANES",
    "SCENES",
    "SPP",
    "TRAVERSALS",
    "WIDTH_HEIGHT",
    "Cutting",
    "ShuffledUnits",
    "covering",
    "product",
    "render",
    "small_units",
]

SCENES: Final = (
    "room",
    "room-glass",
    "cornell",
    "bumpy",
    "surfaces",
    "sky",
    "drink",
    "haze",
    "candles",
    "textures",
    "lamps",
    "sundial",
    "S4",
)
"""Built-in ones, and the benchmark's room with a thousand lights, which has a tree of lights."""
WIDTH_HEIGHT: Final = (50, 39)
"""No multiple of a tile's side, nor of a block's."""
SPP: Final = 20
"""More than a unit's 16 samples, and no multiple of what goes into a launch."""

LANES: Final = (1, 4, 8, 16)
TRAVERSALS: Final = ("packet", "single")
TILES: Final = (16, 64, 65536)
PASSES: Final = (1, 4, 16)
WORK_GROUPS: Final = (16, 64)
ORDERS: Final = ("in order", "shuffled")


@dataclass(frozen=True)
class Cutting:
    """One way to cut the work of a render; none of it may change a bit.

    Attributes
    ----------
    lanes, tile, samples_per_pass, work_group : int or None
    traversal, code, kernels : str or None
        None, as for the numbers: as the device would choose.
    order : str
        ``in order``, or ``shuffled``: single tiles and few samples in random order.
    """

    lanes: int | None = None
    traversal: str | None = None
    tile: int = 64
    samples_per_pass: int | None = None
    work_group: int | None = None
    order: str = "in order"
    code: str | None = None
    kernels: str | None = None

    def __str__(self) -> str:
        words = [f"lanes {self.lanes}", f"{self.traversal}", f"tile {self.tile}", f"pass {self.samples_per_pass}"]
        return ", ".join(
            [*words, f"group {self.work_group}", self.order, f"{self.code} code", f"{self.kernels} kernels"]
        )


def product(lanes: Sequence[int] = LANES, traversals: Sequence[str] = TRAVERSALS) -> Iterator[Cutting]:
    """Every combination, those of one program together."""
    for values in itertools.product(lanes, traversals, TILES, PASSES, WORK_GROUPS, ORDERS):
        # Both codes, at no further program
        yield Cutting(*values, "fast" if values[1] == "packet" else "small")


def covering(lanes: Sequence[int] = LANES, traversals: Sequence[str] = TRAVERSALS) -> list[Cutting]:
    """Few combinations among which every value of every choice meets every value of every other.

    Greedy: next comes the combination with the most pairs not met yet.
    """
    everything = [tuple(vars(each).values()) for each in product(lanes, traversals)]
    pairs = {each: set(itertools.combinations(enumerate(each), 2)) for each in everything}
    missing = set().union(*pairs.values())
    chosen: list[Cutting] = []
    while missing:
        best = max(everything, key=lambda each: len(pairs[each] & missing))
        missing -= pairs[best]
        chosen.append(Cutting(*best))
    return chosen


def small_units(plan: Plan, samples: int = 5, seed: int = 1) -> Iterator[Unit]:
    """The plan's work as single tiles of few samples, in random order."""
    area = plan.tile * plan.tile
    stop, samples = plan.first_sample + plan.sample_count, -(-samples // plan.whole) * plan.whole
    units = [
        Unit(slot, area, sample, min(samples, stop - sample), plan.tile)
        for sample in range(plan.first_sample, stop, samples)
        for slot in range(0, slot_count(plan.width, plan.height, plan.tile), area)
    ]
    order = np.random.default_rng(seed).permutation(len(units))
    return iter([units[index] for index in order])


class ShuffledUnits:
    """Stands for what remains to be done: single tiles of few samples, in random order."""

    def __init__(self, plan: Plan, workers: int) -> None:
        self._units = list(small_units(plan))

    @property
    def is_empty(self) -> bool:
        return not self._units

    def take(self, worker: int) -> Unit | None:
        return self._units.pop(0) if self._units else None

    def put_back(self, unit: Unit) -> None:
        self._units.insert(0, unit)

    def measured(self, worker: int, unit: Unit, seconds: float) -> None:
        """Every unit is as small as the others."""

    def retire(self, worker: int) -> None:
        """Nobody counts workers here."""


@functools.cache
def _many_lights() -> Scene:
    with tempfile.TemporaryDirectory() as folder:
        return clrender.load(str(write_scene("S4", Path(folder))))


@functools.cache
def _rich_room() -> Scene:
    """Matt walls around all kinds of other materials: what integrators share is between them."""
    materials: dict[str, Any] = {
        "wall": {"type": "lambert", "reflectance": [0.8, 0.6, 0.4]},
        "floor": {"type": "lambert", "reflectance": {"checker": [0.2, 0.9], "size": 0.25}},
        "gold": {"type": "conductor", "metal": "Au", "roughness": 0.4},
        "plastic": {"type": "principled", "base_color": [0.7, 0.3, 0.2], "roughness": 0.4, "coat": 1.0},
        "frosted": {"type": "dielectric", "ior": 1.5, "roughness": 0.4},
        "mirror": {"type": "mirror"},
        "mixed": {"type": "mix", "materials": ["wall", "mirror"], "weight": 0.4},
    }
    shapes: list[dict[str, Any]] = [
        {"type": "box", "size": [2, 2, 2], "flip_normals": True, "material": "wall"},
        {"type": "quad", "origin": [-1, -0.99, 1], "edge_u": [2, 0, 0], "edge_v": [0, 0, -2], "material": "floor"},
        {"type": "quad", "origin": [-0.4, 0.98, -0.4], "edge_u": [0.8, 0, 0], "edge_v": [0, 0, 0.8]},
        {"type": "sphere", "center": [-0.5, -0.6, -0.1], "radius": 0.35, "material": "gold"},
        {"type": "sphere", "center": [0.3, -0.65, 0.2], "radius": 0.3, "material": "plastic"},
        {"type": "sphere", "center": [-0.1, -0.7, 0.5], "radius": 0.2, "material": "frosted"},
        {"type": "box", "center": [0.5, -0.5, -0.6], "size": [0.5, 0.9, 0.4], "material": "mixed"},
    ]
    shapes[2]["emission"] = [4.0, 4.0, 4.0]
    camera = {"position": [0.0, 0.1, 0.95], "target": [0.0, -0.4, -0.2], "vertical_fov": 80.0}
    return clrender.Scene.model_validate({"camera": camera, "materials": materials, "shapes": shapes})


@functools.cache
def _matt_textures() -> Scene:
    """The scene `textures`, all of it lambert, below a light that shines as one: a program without lobes."""
    scene = clrender.load("textures")
    floor = scene.materials["floor"]
    assert isinstance(floor, OrenNayar)
    matt = {"type": "lambert", "reflectance": floor.reflectance, "normal_map": floor.normal_map}
    *others, lamp = scene.shapes
    checkered = {"checker": [[9.0, 8.7, 8.2], [1.0, 0.5, 0.25]], "size": 0.5}
    return scene.model_copy(
        update={
            "materials": {**scene.materials, "floor": Lambert.model_validate(matt)},
            "shapes": (*others, type(lamp).model_validate({**lamp.model_dump(), "emission": checkered})),
        }
    )


@functools.cache
def _leaves() -> Scene:
    """Triangles, parallelograms, spheres and disks with all kinds of holes; one shines, some lie in the same place."""
    rng = np.random.default_rng(3)
    materials: dict[str, Any] = {
        "ramp": {"type": "lambert", "reflectance": [0.2, 0.6, 0.1], "opacity": {"ramp": [0.0, 0.0, 1.0, 1.0, 0.3]}},
        "squares": {
            "type": "principled",
            "base_color": {"checker": [0.2, 0.9]},
            "opacity": {"checker": [0.0, 1.0], "size": [0.3, 0.2]},
            "opacity_cutoff": 0.5,
        },
        "veil": {"type": "mirror", "opacity": 0.3},
        "pane": {"type": "dielectric", "ior": 1.5, "thin": True, "roughness": 0.3, "opacity": {"checker": [0.1, 0.8]}},
        "floor": {"type": "lambert", "reflectance": [0.6, 0.5, 0.4]},
    }
    count = 100
    corners = rng.uniform(-1.0, 1.0, (count, 1, 3)) + rng.uniform(-0.3, 0.3, (count, 3, 3))
    fourth = corners[:, 1] + corners[:, 2] - corners[:, 0]
    squares = np.stack([corners[:, 0], corners[:, 1], fourth, corners[:, 2]], axis=1)
    uvs = rng.uniform(-1.2, 1.2, (count * 4, 2))
    faces = np.arange(count)[:, None, None] * 4 + np.array([[0, 1, 2], [0, 2, 3]])

    def mesh(points: Any, triangles: Any, material: str, **more: Any) -> dict[str, Any]:
        points, triangles = points.reshape(-1, 3).tolist(), triangles.reshape(-1, 3).tolist()
        uv = uvs[: len(points)].tolist()
        return {"type": "mesh", "vertices": points, "faces": triangles, "uvs": uv, "material": material, **more}

    same = mesh(corners[:9], np.arange(27), "veil")
    shapes: list[dict[str, Any]] = [
        mesh(squares, faces, "squares"),
        mesh(corners, np.arange(count * 3), "ramp"),
        same,
        same,
        mesh(squares[:3] + np.array([0.1, 0.4, 0.2]), faces[:3], "squares", emission=[5.0, 4.0, 3.0]),
        {"type": "sphere", "center": [0.6, -0.6, 0.8], "radius": 0.4, "material": "pane"},
        {"type": "sphere", "center": [-0.7, -0.9, 0.9], "radius": 0.3, "material": "veil"},
        {"type": "disk", "center": [0.0, 0.9, 0.5], "normal": [0.2, -1.0, 0.3], "radius": 0.6, "material": "ramp"},
        {"type": "quad", "origin": [-3, -1.4, -3], "edge_u": [0, 0, 6], "edge_v": [6, 0, 0], "material": "floor"},
        {"type": "quad", "origin": [-1, -1.2, 0], "edge_u": [2, 0, 0], "edge_v": [0, 1, 0], "material": "squares"},
    ]
    lights = [
        {"type": "directional", "direction": [-0.3, -1.0, -0.2], "irradiance": [3.0, 3.0, 3.0]},
        {"type": "environment", "radiance": [0.4, 0.5, 0.7]},
    ]
    camera = {"position": [0.0, 0.5, 4.0], "target": [0.0, -0.1, 0.0], "vertical_fov": 40.0}
    return clrender.Scene.model_validate({"camera": camera, "materials": materials, "shapes": shapes, "lights": lights})


_MADE: Final = {"leaves": _leaves, "S4": _many_lights, "rich room": _rich_room, "matt textures": _matt_textures}


def render(scene: str, devices: Sequence[Device], cutting: Cutting | None = None, **settings: Any) -> RenderedImage:
    """One of `SCENES` on these very devices, whose programs stay built from one render to the next.

    Parameters
    ----------
    scene : str
        Or ``rich room``, ``matt textures`` or ``leaves``.
    devices : sequence of Device
    cutting : Cutting, optional
        Default: as the devices choose.
    **settings
        Others of the render; the size and the samples of the table where they are not given.
    """
    cutting = cutting or Cutting()
    with ExitStack() as stack:
        session = stack.enter_context(clrender.Session(devices))
        if cutting.order == "shuffled":
            stack.enter_context(patch("clrender.scheduling.run.Remaining", ShuffledUnits))
        return session.render(
            _MADE[scene]() if scene in _MADE else clrender.load(scene),
            **{
                "size": WIDTH_HEIGHT,
                "spp": SPP,
                "lanes": cutting.lanes,
                "traversal": cutting.traversal,
                "tile": cutting.tile,
                "samples_per_pass": cutting.samples_per_pass,
                "work_group": cutting.work_group,
                "code": cutting.code,
                "kernels": cutting.kernels,
                **settings,
            },
        )
