"""`clrender render` and `check` of a glTF file: a moment, a variant, notes on stderr, and inputs that stay."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cli_support import call
from gltf_files import Model
from PIL import Image

from clrender.image.files import read_image


@pytest.mark.thorough
def test_moments_variants_and_pictures_beside_the_file(tmp_path: Path) -> None:
    """A quad that shows a picture on its way to the right, or in a variant a colour."""
    Image.new("RGB", (1, 1), (255, 0, 0)).save(tmp_path / "a b.png")
    model = Model()
    model.extend("KHR_materials_unlit", "KHR_materials_variants")
    texture = model.add("textures", {"source": model.add("images", {"uri": "a%20b.png"})})
    unlit: dict[str, Any] = {"extensions": {"KHR_materials_unlit": {}}}
    first = model.add("materials", {"pbrMetallicRoughness": {"baseColorTexture": {"index": texture}}, **unlit})
    blue = model.add("materials", {"pbrMetallicRoughness": {"baseColorFactor": [0, 0, 1, 1]}, **unlit})
    model.root["extensions"] = {"KHR_materials_variants": {"variants": [{"name": "blue"}]}}
    mesh = model.quad(first)
    mapping = {"mappings": [{"variants": [0], "material": blue}]}
    model.root["meshes"][mesh]["primitives"][0]["extensions"] = {"KHR_materials_variants": mapping}
    node = model.node(mesh=mesh)
    sampler = {"input": model.times([0.0, 2.0]), "output": model.accessor([(0, 0, 0), (4, 0, 0)])}
    channel = {"sampler": 0, "target": {"node": node, "path": "translation"}}
    model.add("animations", {"samplers": [sampler], "channels": [channel]})
    lens = {"xmag": 1.0, "ymag": 1.0, "znear": 0.1, "zfar": 9.0}
    model.node(camera=model.add("cameras", {"type": "orthographic", "orthographic": lens}), translation=[0, 0, 5])
    model.write(tmp_path / "m.gltf")
    common = ["-o", "a.npy", "--size", "4x4", "--spp", "4", "-d", "pocl", "--environment", "1"]
    for more, left, right in (
        ([], (1.0, 0.0, 0.0), (1.0, 0.0, 0.0)),
        (["--variant", "blue"], (0.0, 0.0, 1.0), (0.0, 0.0, 1.0)),
        (["--time-at", "0.5"], (1.0, 1.0, 1.0), (1.0, 0.0, 0.0)),
    ):
        done = call("render", "m.gltf", *common, *more, folder=tmp_path)
        assert done.returncode == 0, done.stderr
        image = read_image(tmp_path / "a.npy")
        np.testing.assert_allclose(image[:, 0], np.broadcast_to(left, (4, 3)), atol=1e-5)
        np.testing.assert_allclose(image[:, 3], np.broadcast_to(right, (4, 3)), atol=1e-5)
        assert done.stderr.count("m.gltf: unlit materials shine") == 1
    done = call("check", "m.gltf", "--variant", "bleu", folder=tmp_path)
    assert done.returncode != 0 and 'no variant "bleu"; did you mean "blue"?' in done.stderr
    done = call("render", "m.gltf", "-o", "a b.png", folder=tmp_path)
    assert done.returncode == 2 and "is an input of this command" in done.stderr
    assert json.loads((tmp_path / "m.gltf").read_text())["asset"] == {"version": "2.0"}
