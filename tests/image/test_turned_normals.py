"""Shading normals against the winding of a mesh are turned round with it, so that either mesh looks the same."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import numpy.typing as npt

import clrender
from clrender.device import Device

VERTICES = """v -1 -1 0\nv 1 -1 0\nv 1 1 0\nv -1 1 0\nvn 0.6 0 0.8\nvn 0 0 1\nvn -0.6 0 0.8\nvn 0 0.6 0.8\n"""
FACES = {
    "right": "f 1//1 2//2 3//3\nf 1//1 3//3 4//4\n",
    "inverted": "f 3//3 2//2 1//1\nf 4//4 3//3 1//1\n",
    "one of two": "f 1//1 2//2 3//3\nf 4//4 3//3 1//1\n",
}


def test_normals_against_the_winding_are_turned(device: Device, tmp_path: Path) -> None:
    camera = {"position": [0.0, 0.0, 2.5], "target": [0.0, 0.0, 0.0]}
    layers: dict[str, npt.NDArray[np.float32]] = {}
    for name, faces in FACES.items():
        (tmp_path / "quad.obj").write_text(VERTICES + faces)
        shape = {"type": "mesh", "file": "quad.obj", "transform": {"rotate_degrees": [10.0, 20.0, 30.0]}}
        what = clrender.Scene(camera=camera, shapes=(shape,)).placed("scene", tmp_path)
        told: list[str] = []
        made = clrender.render(
            what, device=device.info.index, size=(24, 24), spp=1, aov=("normal",), notify=told.append
        )
        layers[name] = made.aovs["normal"]
        assert any("point to their backs" in line for line in told) == (name != "right")
    middle = layers["right"][8:16, 8:16]
    flat = middle.reshape(-1, 3)
    assert np.ptp(flat, axis=0).max() > 0.05, "the normals are interpolated"
    for name in ("inverted", "one of two"):
        np.testing.assert_allclose(layers[name], layers["right"], atol=1e-6, err_msg=name)
