"""Scenes in other formats, and scenes that were converted, give the images that they should."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import clrender
from clrender.cli import main
from clrender.device import Device

MODEL = (
    "mtllib m.mtl\nv -1 0 -1\nv 1 0 -1\nv 1 0 1\nv -1 0 1\nv -.5 .1 0 \nv .5 .1 0\nv .5 1 0\nv -.5 1 0\n"
    "vt 0 0\nvt 1 0\nvt 1 1\nusemtl floor\nf 4 3 2 1\nusemtl sign\nf 5/1 6/2 7/3 8/1\nusemtl lamp\nv -1 2 -1\n"
    "v 1 2 -1\nv 1 2 1\nf -3 -2 -1\n"
)
LIBRARY = (
    "newmtl floor\nKd .5 .6 .7\nKs .5 .5 .5\nNs 50\nillum 2\nnewmtl sign\nKd .9 .2 .1\nd .7\nnewmtl lamp\nKe 5 5 5\n"
)


@pytest.mark.parametrize("name", ["room", "textures", "model"])
def test_image_of_a_converted_scene(tmp_path: Path, device: Device, name: str) -> None:
    (tmp_path / "m.obj").write_text(MODEL)
    (tmp_path / "m.mtl").write_text(LIBRARY)
    scene = str(tmp_path / "m.obj") if name == "model" else name
    main.main(["convert", scene, str(tmp_path / "out.json")], standalone_mode=False)
    hashes = {
        clrender.render(clrender.load(each), size=(40, 30), spp=4, device=device).stats["image_sha256"]
        for each in (scene, str(tmp_path / "out.json"))
    }
    assert len(hashes) == 1


def test_highlight_of_a_black_surface_has_the_brightness_that_ks_says(tmp_path: Path, device: Device) -> None:
    """Straight on, under even light of 1, a smooth black surface shows its reflectance: Ks, or 0.08 Ks (illum 2)."""
    head = "mtllib m.mtl\nusemtl a\nv -50 -50 0\nv 50 -50 0\nv 0 90 0\nf 1 2 3\n"
    (tmp_path / "m.obj").write_text(head)
    for illum, expected in ((2, 0.08 * 0.6), (5, 0.6)):
        (tmp_path / "m.mtl").write_text(f"newmtl a\nKd 0 0 0\nKs .6 .6 .6\nNs 1e9\nillum {illum}\n")
        scene = clrender.load(tmp_path / "m.obj", environment=1.0)
        camera = {"position": (0.0, 0.0, 1.0), "target": (0.0, 0.0, 0.0), "vertical_fov": 2.0}
        scene = scene.model_copy(update={"camera": scene.camera.model_copy(update=camera)})
        image = clrender.render(scene, size=(8, 8), spp=256, device=device).linear
        assert np.mean(image) == pytest.approx(expected, rel=0.05)
