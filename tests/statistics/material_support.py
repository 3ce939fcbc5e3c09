"""Runs the kernels of materials.cl: a material alone, from directions asked for."""

from __future__ import annotations

import math
import runpy
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt
from sampling_support import random_bits

from clrender import layout
from clrender.flatten.flat_scene import flatten
from clrender.scene import Scene

if TYPE_CHECKING:
    from clrender.device import Device

__all__ = [
    "WHITE",
    "WHITE_METAL",
    "Floats",
    "chances",
    "conductor",
    "counted",
    "covers_leave",
    "dielectric",
    "directions",
    "evaluated",
    "oren_nayar",
    "principled",
    "run",
    "sampled",
    "towards",
]

Floats = npt.NDArray[np.float64]
Described = dict[str, Any]

SOURCE = Path(__file__).resolve().with_name("materials.cl")
LANES = 8
DEFINES = {"LANES": LANES, "BECKMANN": 1, "TURNED_GLASS": 1}
WHITE = (1.0, 1.0, 1.0)
WHITE_METAL: Described = {"eta": [1e-3] * 3, "k": [1000.0] * 3}
"""It reflects all but 4e-9 of the light."""


def oren_nayar(roughness: float, reflectance: float = 1.0) -> Described:
    return {"type": "oren_nayar", "reflectance": [reflectance] * 3, "roughness": roughness}


def conductor(alpha: float, **of: Any) -> Described:
    metal = {} if {"metal", "f0", "eta"} & of.keys() else WHITE_METAL
    return {"type": "conductor", "roughness": math.sqrt(alpha), **metal, **of}


def dielectric(alpha: float, ior: float = 1.5, **of: Any) -> Described:
    return {"type": "dielectric", "ior": ior, "roughness": math.sqrt(alpha), **of}


def principled(alpha: float = 0.25, **of: Any) -> Described:
    return {"type": "principled", "roughness": math.sqrt(alpha), **of}


def towards(degrees: float, turn: float = 0.1) -> Floats:
    """A unit vector so far from z."""
    tilt, around = math.radians(degrees), 2.0 * math.pi * turn
    return np.array([math.sin(tilt) * math.cos(around), math.sin(tilt) * math.sin(around), math.cos(tilt)])


def directions(seed: int, count: int, least: float = 1e-3) -> Floats:
    """Directions (count, 3) of the upper hemisphere, exact in single precision."""
    all_of = np.random.default_rng(seed).normal(size=(count, 3))
    all_of[:, 2] = np.abs(all_of[:, 2]) + least
    unit: Floats = (all_of / np.linalg.norm(all_of, axis=1, keepdims=True)).astype(np.float32).astype(np.float64)
    return unit


def run(
    device: Device,
    kernel: str,
    material: Described,
    numbers: npt.NDArray[Any],
    outputs: int,
    *more: Any,
    front: bool = True,
    others: dict[str, Described] | None = None,
    folder: Path | None = None,
) -> Floats:
    """(outputs, count) results of a kernel of materials.cl.

    `others` are named by a mixture; `folder` has the file of a measured material.
    """
    # It has all tables made, so that one program does for all materials
    turned: Described = {"type": "principled", "transmission": 1.0, "anisotropy": 0.5}
    materials = {"m": material, "turned": turned, **(others or {})}
    scene = Scene.model_validate({"camera": {"position": (0, 0, 3), "target": (0, 0, 0)}, "materials": materials})
    flat = flatten(scene if folder is None else scene.placed("test", folder, ()), 8, 8)
    count = numbers.shape[1]
    tables = ("material_rows", "albedo_tables", "measured_rows", "measured_words")
    arrays = (numbers, *(flat.arrays[name] for name in tables))
    buffers = [device.upload(np.ascontiguousarray(array)) for array in arrays]
    results = device.empty(4 * outputs * count)
    ior = flat.arrays["materials"]["ior"][0]
    given = [*buffers, np.float32(ior), np.uint32(front), *more, np.uint32(count), results]
    assert len(flat.arrays["albedo_tables"]) == layout.ALBEDO_TURNED_GLASS_END
    defines = DEFINES if folder is None else {**DEFINES, "MEASURED": 1}
    device.launch(device.program(SOURCE, defines), kernel, count // LANES, 16, given)
    out = np.empty((outputs, count), np.float32)
    device.read(results, out)
    for buffer in (*buffers, results):
        device.release(buffer)
    return out.astype(np.float64)


def sampled(
    device: Device, material: Described, wo: Floats, seed: int, count: int = 2**18, **how: Any
) -> tuple[Floats, Floats, Floats]:
    """Directions (n, 3), weights (n, 3) of flux, and densities (n,)."""
    four = np.append(wo, 0.0).astype(np.float32)
    out = run(device, "material_sample", material, random_bits(seed, count), 8, four, **how)
    return out[:3].T, (out[3:6] / out[7]).T, out[6]


def evaluated(device: Device, material: Described, wo: Floats, wi: Floats, **how: Any) -> tuple[Floats, Floats, Floats]:
    """f |cosθ| (n, 3), densities (n,) and albedos (n, 3); `wo` and `wi` are (n, 3)."""
    numbers = np.concatenate([wo.T, wi.T]).astype(np.float32)
    out = run(device, "material_eval", material, numbers, 7, **how)
    return out[:3].T, out[3], out[4:].T


def chances(device: Device, material: Described, wo: Floats, cells: tuple[int, int], fine: int, **how: Any) -> Floats:
    """Integral of the density over cells of the sphere that are even in the cosine and in the angle around z."""
    rows, columns = cells[0] * fine, cells[1] * fine
    z, turn = np.meshgrid(
        1.0 - 2.0 * (np.arange(rows) + 0.5) / rows, (np.arange(columns) + 0.5) / columns, indexing="ij"
    )
    sine, around = np.sqrt(1.0 - z**2).ravel(), 2.0 * math.pi * turn.ravel()
    wi = np.stack([sine * np.cos(around), sine * np.sin(around), z.ravel()], axis=1)
    _, pdf, _ = evaluated(device, material, np.broadcast_to(wo, wi.shape), wi, **how)
    parts = pdf * 4.0 * math.pi / (rows * columns)
    sums: Floats = parts.reshape(cells[0], fine, cells[1], fine).sum(axis=(1, 3))
    return sums


def counted(wi: Floats, weight: Floats, cells: tuple[int, int]) -> tuple[npt.NDArray[np.int64], int]:
    """How many directions lie in each of those cells, and how many were lost."""
    there = weight.max(axis=1) > 0.0
    row = np.minimum(((1.0 - wi[there, 2]) / 2.0 * cells[0]).astype(int), cells[0] - 1)
    turn = np.mod(np.arctan2(wi[there, 1], wi[there, 0]) / (2.0 * math.pi), 1.0)
    column = np.minimum((turn * cells[1]).astype(int), cells[1] - 1)
    counts = np.bincount(row * cells[1] + column, minlength=cells[0] * cells[1]).reshape(cells)
    return counts, int(np.count_nonzero(~there))


@cache
def _tables() -> dict[str, Any]:
    """Those of ``scripts/albedo_tables.py``, and its functions."""
    made = runpy.run_path(str(SOURCE.parents[2] / "scripts" / "albedo_tables.py"))
    with np.load(made["FILE"]) as file:
        return {"interpolated": made["interpolated"], **file}


def covers_leave(material: Described, cosine: Floats, *, gloss: bool = False) -> Floats:
    """The share of light that coat and sheen leave along directions, and with `gloss` that of the base, too."""
    tables = _tables()
    table = tables["interpolated"]

    def reflected(alpha: float, f0: float) -> Floats:
        row = math.sqrt(alpha)
        all_of = table(tables["ggx"], row, np.sqrt(cosine * (1.0 + alpha) / (cosine + alpha)))
        share: Floats = all_of * (f0 + (1.0 - f0) * table(tables["schlick"], row, np.sqrt(cosine)) ** 5)
        return share

    left = np.ones_like(cosine)
    if gloss:
        ior = material.get("ior", 1.5)
        left *= 1.0 - material.get("specular", 1.0) * reflected(
            material["roughness"] ** 2, ((ior - 1) / (ior + 1)) ** 2
        )
    if "sheen_color" in material:
        row = max(material.get("sheen_roughness", 0.3), 0.1)
        left *= 1.0 - max(material["sheen_color"]) * table(tables["sheen"], row, np.sqrt(cosine))
    left *= 1.0 - material.get("coat", 0.0) * reflected(max(material.get("coat_roughness", 0.0) ** 2, 1e-3), 0.04)
    return left
