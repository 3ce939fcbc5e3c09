"""What is known of holes without a look at the texture: of fine meshes by the triangle, of large triangles by cells."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from gltf_files import Model

import clrender
from clrender.flatten.flat_scene import flatten


@pytest.mark.parametrize("count", [1, 150])
def test_rows_of_fine_and_coarse_meshes(tmp_path: Path, count: int) -> None:
    """A picture with a hole on its left half on a grid of squares: only few of fine triangles are of both kinds."""
    pixels = np.full((64, 64, 4), 255, np.uint8)
    pixels[:, :32, 3] = 0
    model = Model()
    base = {"baseColorTexture": {"index": model.texture(pixels, {"wrapS": 33071, "wrapT": 33071})}}
    material = model.add("materials", {"alphaMode": "MASK", "pbrMetallicRoughness": base})
    at = np.linspace(0.0, 1.0, count + 1)
    u, v = (each.ravel() for each in np.meshgrid(at, at))
    first = (np.arange(count)[:, None] * (count + 1) + np.arange(count)).ravel()
    below = first + count + 1
    order = np.stack([first, first + 1, below, first + 1, below + 1, below], axis=1).ravel()
    attributes = {
        "POSITION": model.accessor(np.stack([u, v, 0 * u], axis=1)),
        "TEXCOORD_0": model.accessor(np.stack([u, v], axis=1)),
    }
    primitive = {"attributes": attributes, "indices": model.accessor(order, "uint32"), "material": material}
    model.node(mesh=model.add("meshes", {"primitives": [primitive]}))
    flat = flatten(clrender.load(model.write(tmp_path / "m.glb")), 8, 8)
    rows = flat.arrays["hole_rows"][1:]
    assert len(rows) == 2 * count * count
    hole, whole = (np.unpackbits(half.copy().view(np.uint8), axis=1).mean() for half in (rows[:, :32], rows[:, 32:]))
    assert hole == pytest.approx(0.5, abs=0.04) and whole == pytest.approx(0.5, abs=0.04)
