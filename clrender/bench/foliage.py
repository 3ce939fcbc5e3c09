"""The benchmark's foliage, S6: a tree of twenty thousand leaves, squares with an alpha texture, under sun and sky."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt
from PIL import Image

from clrender.bench.shapes import Corners, Points, quad, write_ply
from clrender.image.files import write_image

__all__ = ["LEAVES", "foliage_scene"]

LEAVES: Final = 20_000
_SIDE: Final = 256
"""Side of the leaf's texture, texels."""
_SKY: Final = (1024, 2048)
"""Rows and columns. Mitsuba maps one row less from pole to pole, so that everything is slightly shifted."""
_ACROSS: Final = 4
"""Side of the sun in texels: 0.7 degrees."""
_CROWN: Final = ((0.0, 3.4, 0.0), (1.7, 1.5, 1.7))
"""Centre and semi-axes of the ellipsoid in which twigs end, metres."""
_TWIGS: Final = 400
_BRANCHES: Final = 24
_SUN: Final = (1.0, 0.9, 0.75)


def foliage_scene(folder: Path) -> dict[str, Any]:
    """Make the description of S6, and write its meshes and images.

    Texels are not interpolated, because renderers differ in whether they interpolate colour and opacity separately or
    their product. The sun is part of the environment map, so that all renderers have the same light and may sample it
    in their own way.

    Parameters
    ----------
    folder : Path
        Output folder.

    Returns
    -------
    dict
        As a scene file.
    """
    random = np.random.default_rng(6)
    _write_leaf(folder / "leaf.png")
    _write_sky(folder / "sky.exr")
    twigs = _twigs(random)
    write_ply(folder / "wood.ply", *_wood(twigs))
    points, faces, coordinates = _leaves(random, twigs)
    write_ply(folder / "leaves.ply", points, faces, coordinates=coordinates)
    picture = {"texture": "leaf.png", "filter": "nearest"}
    leaf = {
        "type": "lambert",
        "reflectance": {**picture, "color_space": "srgb"},
        "opacity": {**picture, "channel": "a"},
    }
    return {
        "camera": {"position": [0.0, 1.7, 8.0], "target": [0.0, 2.6, 0.0], "vertical_fov": 40.0},
        "materials": {
            "leaf": leaf,
            "wood": {"type": "lambert", "reflectance": [0.2, 0.13, 0.08]},
            "ground": {"type": "lambert", "reflectance": [0.25, 0.3, 0.12]},
        },
        "shapes": [
            quad((-40.0, 0.0, 40.0), (40.0, 0.0, 40.0), (-40.0, 0.0, -40.0), material="ground"),
            {"type": "mesh", "file": "wood.ply", "material": "wood"},
            {"type": "mesh", "file": "leaves.ply", "material": "leaf"},
        ],
        "lights": [{"type": "environment", "file": "sky.exr"}],
    }


def _write_leaf(path: Path) -> None:
    """A pointed oval, which fills slightly more than half of the square, with a stem and pale veins."""
    at = (np.arange(_SIDE) + 0.5) / _SIDE
    across, up = at[None, :] - 0.5, 1.0 - at[:, None]
    along = np.clip((up - 0.1) / 0.88, 0.0, 1.0)
    half = 0.46 * np.sin(np.pi * along**0.8) ** 0.8 * (1.0 + 0.04 * np.sin(40.0 * along))
    inside = np.abs(across) < half
    stem = (np.abs(across) < 0.012) & (up < 0.95)
    slanted = np.mod(up - 0.7 * np.abs(across), 0.11) < 0.012
    vein = stem | (inside & slanted)
    shade = 1.0 - 0.25 * np.abs(across) / 0.5 + 0.06 * np.sin(9.0 * up)
    color = np.where(vein[..., None], (150, 170, 90), np.array((66, 118, 38)) * shade[..., None])
    alpha = np.where(inside | stem, 255, 0)
    rgba = np.concatenate([color, alpha[..., None]], axis=2)
    Image.fromarray(rgba.round().clip(0, 255).astype(np.uint8), "RGBA").save(path, compress_level=1)


def _write_sky(path: Path) -> None:
    """Bluer and darker towards the zenith, brighter about the sun, dark below the horizon; and the sun."""
    rows, columns = _SKY
    polar = (np.arange(rows) + 0.5) / rows * np.pi
    turn = (np.arange(columns) + 0.5) / columns * 2.0 * np.pi - np.pi
    direction = np.stack(
        np.broadcast_arrays(
            np.sin(polar)[:, None] * np.sin(turn), np.cos(polar)[:, None], np.sin(polar)[:, None] * np.cos(turn)
        ),
        axis=2,
    )
    row, column = int(rows * 45 / 180), int(columns * 0.62)
    sun = direction[row, column]
    height = np.clip(direction[..., 1:2], 0.0, 1.0)
    sky = (0.25 + 0.75 * (1.0 - height) ** 3) * (np.array((0.35, 0.6, 1.0)) * height**0.4 + 0.5 * (1.0 - height**0.4))
    sky += 0.8 * np.exp(-8.0 * (1.0 - direction @ sun))[..., None] * np.array(_SUN)
    sky = np.where(direction[..., 1:2] > 0.0, sky, (0.08, 0.09, 0.05))
    # An irradiance of 5 on surfaces that face it; the sky's is about 1.5
    texels = _ACROSS**2 * (np.pi / rows) ** 2 * np.sin(polar[row])
    sky[row : row + _ACROSS, column : column + _ACROSS] = 5.0 / texels * np.array(_SUN)
    write_image(path, sky.astype(np.float32))


def _twigs(random: np.random.Generator) -> Points:
    """Ends of twigs, mostly near the surface of the crown."""
    out = random.normal(size=(_TWIGS, 3))
    out /= np.linalg.norm(out, axis=1, keepdims=True)
    center, half = (np.array(each) for each in _CROWN)
    ends: Points = center + out * half * random.uniform(0.2, 1.0, (_TWIGS, 1)) ** 0.5
    return ends


def _leaves(random: np.random.Generator, twigs: Points) -> tuple[Points, Corners, Points]:
    """Squares of 7 to 12 cm around the ends of twigs, with stems towards these, nearly horizontal."""
    twig = random.integers(0, len(twigs), LEAVES)
    up = random.normal(size=(LEAVES, 3)) * (1.0, 0.5, 1.0) - (0.0, 0.3, 0.0)
    up /= np.linalg.norm(up, axis=1, keepdims=True)
    across = np.cross(up, random.normal(size=(LEAVES, 3)) * 0.6 + (0.0, 1.0, 0.0))
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    size = random.uniform(0.07, 0.12, (LEAVES, 1))
    stem = twigs[twig] + random.normal(size=(LEAVES, 3)) * 0.13
    u, v = across * size, up * size
    corners = np.stack([stem - 0.5 * u, stem + 0.5 * u, stem + 0.5 * u + v, stem - 0.5 * u + v], axis=1)
    faces = np.array([[0, 1, 2], [0, 2, 3]]) + 4 * np.arange(LEAVES)[:, None, None]
    coordinates = np.tile([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]], (LEAVES, 1))
    return corners.reshape(-1, 3), faces.reshape(-1, 3).astype(np.int32), coordinates


def _wood(twigs: Points) -> tuple[Points, Corners]:
    """A trunk, branches from it, and twigs from the nearest branch ends, all as six-sided cones."""
    fork = np.array((0.0, 2.0, 0.0))
    ends = twigs[:_BRANCHES] * 0.6 + 0.4 * fork
    parts = [_cone(np.zeros(3), fork, 0.22, 0.14), _cone(fork, np.array((0.0, 4.4, 0.0)), 0.14, 0.02)]
    parts += [_cone(fork + np.array((0.0, 0.04 * i, 0.0)), end, 0.06, 0.025) for i, end in enumerate(ends)]
    for twig in twigs:
        parts.append(_cone(ends[np.linalg.norm(ends - twig, axis=1).argmin()], twig, 0.02, 0.005))
    offsets = np.cumsum([0, *(len(points) for points, _ in parts[:-1])])
    points = np.concatenate([points for points, _ in parts])
    return points, np.concatenate([faces + at for (_, faces), at in zip(parts, offsets, strict=True)]).astype(np.int32)


def _cone(
    low: npt.NDArray[np.float64], high: npt.NDArray[np.float64], below: float, above: float
) -> tuple[Points, npt.NDArray[np.int64]]:
    """The side of a truncated cone, with these radii."""
    axis = (high - low) / np.linalg.norm(high - low)
    x = np.cross(axis, (1.0, 0.0, 0.0) if abs(axis[0]) < 0.9 else (0.0, 1.0, 0.0))
    x /= np.linalg.norm(x)
    turn = np.arange(6) * np.pi / 3.0
    around = np.cos(turn)[:, None] * x + np.sin(turn)[:, None] * np.cross(axis, x)
    i = np.arange(6)
    j = (i + 1) % 6
    faces = np.concatenate([np.stack([i, j, j + 6], 1), np.stack([i, j + 6, i + 6], 1)])
    return np.concatenate([low + below * around, high + above * around]), faces
