"""`clrender render --environment FILE`: a picture as environment, for scenes that have none."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from cli_support import call

from clrender.image.files import read_image, write_image

SCENE = "[camera]\nposition = [0, 0, 0]\ntarget = [0, 0, 1]\nvertical_fov = 1.0\n"


@pytest.mark.thorough
def test_it_is_what_the_scene_would_say(tmp_path: Path) -> None:
    (tmp_path / "skies").mkdir()
    pixels = np.zeros((4, 8, 3), np.float32)
    pixels[:, 3:5] = (1.0, 0.5, 0.25)
    write_image(tmp_path / "skies" / "a.exr", pixels)
    (tmp_path / "plain.toml").write_text(SCENE)
    sky = '[[lights]]\ntype = "environment"\nfile = "skies/a.exr"\n'
    (tmp_path / "lit.toml").write_text(SCENE + sky)
    common = ["--size", "4x4", "--spp", "1", "--quiet", "-d", "pocl"]
    hashes = []
    for name, more in (("plain", ["--environment", "skies/a.exr"]), ("lit", [])):
        outputs = ["-o", f"{name}.npy", "--stats", f"{name}.json"]
        done = call("render", f"{name}.toml", *outputs, *common, *more, folder=tmp_path)
        assert done.returncode == 0, done.stderr
        stats = json.loads((tmp_path / f"{name}.json").read_text())
        hashes.append(stats["image_sha256"])
    assert hashes[0] == hashes[1]
    np.testing.assert_allclose(read_image(tmp_path / "lit.npy"), np.broadcast_to(pixels[0, 3], (4, 4, 3)), rtol=1e-5)
    command = ["render", "plain.toml", "-o", "skies/a.exr", "--environment", "skies/a.exr"]
    done = call(*command, folder=tmp_path)
    assert done.returncode == 2 and "is an input of this command" in done.stderr and done.stderr.count("\n") == 1
