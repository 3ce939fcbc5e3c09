"""Colours of vertices in images: against barycentric interpolation in NumPy, and against constants, to the bit."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from render_support import Studio, quad, sphere

import clrender
from clrender.scene import Scene

if TYPE_CHECKING:
    from clrender.device import Device

ACROSS = {"position": [0.0, 0.0, 1.0], "target": [0.0, 0.0, 0.0], "vertical_fov": 90.0}
"""Sees the square from -1 to 1 in the plane z = 0 and no more."""
SUN = {"type": "directional", "direction": [0, 0, -1], "irradiance": [math.pi] * 3}
"""Of which a diffuse surface that faces it sends back its reflectance."""
CORNERS = np.array([[-1.5, -1.25, 0.0], [1.25, -1.5, 0.0], [0.25, 1.75, 0.0]])
COLORS = np.array([[0.9, 0.1, 0.3], [0.2, 0.8, 0.0], [0.05, 0.4, 1.0]])


def triangle(**more: Any) -> dict[str, Any]:
    mesh = {"type": "mesh", "vertices": CORNERS.tolist(), "faces": [[0, 1, 2]], "colors": COLORS.tolist()}
    return {**mesh, "material": "m", **more}


def scene(shapes: list[dict[str, Any]], materials: dict[str, Any], **more: Any) -> Scene:
    return Scene(camera=ACROSS, shapes=shapes, materials=materials, **{"lights": [SUN], **more})


def interpolated(size: int) -> tuple[np.ndarray, np.ndarray]:
    """Colour at the centre of each pixel, and which pixels lie in the triangle."""
    steps = (np.arange(size) + 0.5) / size * 2 - 1
    x, y = np.meshgrid(steps, -steps)
    system = np.concatenate([CORNERS[:, :2], np.ones((3, 1))], axis=1).T
    weights = np.linalg.solve(system, np.stack([x.ravel(), y.ravel(), np.ones(size * size)])).T
    return (weights @ COLORS).reshape(size, size, 3), (weights.min(axis=1) > 1.5 / size).reshape(size, size)


@pytest.mark.parametrize(
    ("integrator", "material"),
    [
        ("path", "lambert"),
        ("path", "mix"),
        pytest.param("whitted", "lambert", marks=pytest.mark.long),
        *(pytest.param(name, "lambert", marks=pytest.mark.slow) for name in ("direct", "reuse", "photon")),
    ],
)
def test_a_triangle_is_interpolated(studio: Studio, integrator: str, material: str) -> None:
    """As it is, with its corners reversed, and mirrored; times a constant, and times a checker of half a pixel."""
    size = 16
    more: dict[str, Any] = {"integrator": integrator, "spp": 64}
    if integrator == "photon":
        more["photons"] = 16
    checker = {"checker": [[0.2, 0.4, 0.1], [0.9, 0.5, 0.3]], "size": 0.25 / size}
    # The others make the row of colours another one than the first
    around = [sphere([-4, 0, 5], 0.5, material="board"), quad([4, 0, 5], [1, 0, 0], [0, 1, 0], material="board")]
    expected, inside = interpolated(size)
    for reflectance, factor in (([0.5, 1.0, 0.75], [0.5, 1.0, 0.75]), (checker, [0.55, 0.45, 0.2])):
        m = {"type": "lambert", "reflectance": reflectance}
        named: dict[str, Any] = {"m": m, "board": {"type": "lambert", "reflectance": checker}}
        if material == "mix":
            named = {**named, "m": {"type": "mix", "materials": ["a", "b"]}, "a": m, "b": {**m, "type": "oren_nayar"}}
            named["b"]["roughness"] = 0.0
        for turned in ({}, {"flip_normals": True}, {"transform": {"scale": [-1, 1, 1]}}):
            uvs = (CORNERS[:, :2] / 2 + 0.5).tolist()
            image = studio.image(scene([*around, triangle(uvs=uvs, **turned)], named), size, **more)
            image = image[:, ::-1] if "transform" in turned else image
            atol = 0.02 if isinstance(reflectance, dict) else 2.0 / size / 64
            np.testing.assert_allclose(image[inside], (expected * factor)[inside], atol=atol)
            error = (image - expected * factor)[inside].mean(axis=0)
            np.testing.assert_allclose(error, 0.0, atol=2e-3 if isinstance(reflectance, dict) else 2e-4)


@pytest.mark.parametrize("kind", ["lambert", "principled", "conductor"])
def test_three_equal_colours_are_that_colour_to_the_bit(device: Device, kind: str) -> None:
    key = {"lambert": "reflectance", "principled": "base_color", "conductor": "f0"}[kind]
    color, black = [0.25, 0.5, 0.75], {"type": "lambert", "reflectance": {"checker": [0, 0]}}
    lights = [{"type": "environment", "radiance": [0.5] * 3}, SUN]
    hashes = set()
    for reflectance, colors in ((color, []), ([1.0] * 3, [color] * 3), ([0.5, 0.5, 1.0], [[0.5, 1.0, 0.75]] * 3)):
        shapes = [triangle(colors=colors), sphere([0.4, 0.0, 0.3], 0.2, material="b")]
        what = scene(shapes, {"m": {"type": kind, key: reflectance}, "b": black}, lights=lights)
        hashes.add(clrender.render(what, device=device, size=(24, 24), spp=4).stats["image_sha256"])
    assert len(hashes) == 1


@pytest.mark.slow
def test_the_same_bits_with_any_number_of_lanes(device: Device) -> None:
    what = scene([triangle()], {"m": {"type": "principled", "base_color": [0.9, 0.8, 0.7]}})
    images = [clrender.render(what, device=device, size=(24, 24), spp=4, lanes=lanes) for lanes in (1, 4, 16)]
    assert len({image.stats["image_sha256"] for image in images}) == 1


def test_files_show_what_inline_meshes_show(studio: Studio, tmp_path: Path) -> None:
    """Bytes of a PLY, an OBJ of as many digits, and their linear values."""
    bytes_ = np.array([[255, 0, 55], [128, 1, 200], [9, 77, 254]])
    head = "ply\nformat ascii 1.0\nelement vertex 3\n" + "".join(f"property float {x}\n" for x in "xyz")
    head += "".join(f"property uchar {name}\n" for name in ("red", "green", "blue", "alpha"))
    head += "element face 1\nproperty list uchar int vertex_indices\nend_header\n"
    rows = [f"{x} {y} {z}" for x, y, z in CORNERS]
    ply = [f"{row} {r} {g} {b} 17" for row, (r, g, b) in zip(rows, bytes_, strict=True)]
    (tmp_path / "m.ply").write_text(head + "\n".join([*ply, "3 0 1 2", ""]))
    obj = [f"v {row} {r:.5f} {g:.5f} {b:.5f}" for row, (r, g, b) in zip(rows, bytes_ / 255, strict=True)]
    (tmp_path / "m.obj").write_text("\n".join([*obj, "f 1 2 3", ""]))
    linear = clrender.image.tone_map.srgb_decode(bytes_ / 255).astype(np.float32).tolist()
    files = [{"type": "mesh", "file": name, "material": "m", "vertex_colors": "auto"} for name in ("m.ply", "m.obj")]
    material = {"m": {"type": "lambert", "reflectance": [1.0] * 3}}
    images = [
        studio.image(scene([shape], material).placed("here", tmp_path), 16, spp=4)
        for shape in (triangle(colors=linear), *files)
    ]
    np.testing.assert_array_equal(images[1], images[0])
    np.testing.assert_array_equal(images[2], images[0])
