"""Maps of where the light of an image comes from: parts by bounces, lengths of paths, errors by strategy."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import OpenEXR
import pytest

import clrender
from clrender.errors import RenderError, UsageError
from clrender.inspection.maps import STRATEGIES

if TYPE_CHECKING:
    from clrender.device import Device
    from clrender.inspection import PathMaps


def closed(reflectance: float) -> clrender.Scene:
    """A ball, seen from inside, that shines with a radiance of 1 everywhere: n events leave reflectance to the n."""
    return clrender.Scene(
        camera={"position": [0.0, 0.0, 0.0], "target": [0.0, 0.0, 1.0]},
        materials={"m": {"type": "lambert", "reflectance": reflectance}},
        shapes=[{"type": "sphere", "radius": 1.0, "material": "m", "emission": 1.0, "flip_normals": True}],
    )


@pytest.fixture(scope="module")
def maps(device: Device) -> PathMaps:
    """Of a room."""
    return clrender.path_maps(clrender.load("cornell"), size=(24, 20), spp=64, bounces=3, device=device)


def test_parts_add_up_to_the_image(device: Device, maps: PathMaps) -> None:
    image = clrender.render(clrender.load("cornell"), size=(24, 20), spp=64, aov=("stderr",), device=device)
    assert maps.about["image_sha256"] == image.stats["image_sha256"]
    np.testing.assert_array_equal(maps.image, image.linear)
    assert maps.bounces.shape == (5, 20, 24, 3) and set(maps.errors) == set(STRATEGIES)
    np.testing.assert_allclose(maps.bounces.sum(axis=0), maps.image, atol=1e-5 * float(maps.image.max()))
    assert maps.shares.sum() == pytest.approx(1.0) and (maps.shares > 0.0).all()
    # The first is the lamp as it is seen, the second direct light, which reaches no lamp
    lamp = maps.bounces[0].max(axis=2) > 0.0
    assert 0 < lamp.sum() < lamp.size / 10
    assert maps.noise["bsdf"] > 2.0 * maps.noise["mis"] > 0.0


@pytest.mark.long
def test_one_field_guides_all_parts(device: Device) -> None:
    """So that they are of the same samples, and no part is negative."""
    how: dict[str, Any] = {"guiding": "on", "guiding_paths": 8192, "size": (24, 24), "spp": 32}
    made = clrender.path_maps(clrender.load("cornell"), bounces=3, device=device, **how)
    assert made.bounces.min() > -1e-6


def test_parts_of_a_closed_ball_are_powers_of_its_reflectance(device: Device) -> None:
    found = clrender.path_maps(closed(0.5), size=(16, 16), spp=64, bounces=4, device=device)
    means = found.bounces.astype(np.float64).mean(axis=(1, 2, 3))
    assert means == pytest.approx([1.0, 0.5, 0.25, 0.125, 0.0625, 0.0625], rel=0.05)
    # Of 1 + 1/2 + 1/4 ... the mean of 0, 1, 2, ... and 5 for what comes after
    wanted = (0.5 + 2 * 0.25 + 3 * 0.125 + 4 * 0.0625 + 5 * 0.0625) / 2.0
    assert float(found.length.mean()) == pytest.approx(wanted, rel=0.05)


def test_a_limit_of_depth_ends_the_parts(device: Device) -> None:
    found = clrender.path_maps(closed(0.5), size=(8, 8), spp=32, bounces=3, max_depth=1, device=device)
    assert (found.bounces[2:] == 0.0).all() and found.bounces[1].mean() == pytest.approx(0.5, rel=0.05)


def test_files_have_the_numbers(maps: PathMaps, tmp_path: Path) -> None:
    for ending in ("json", "exr", "html"):
        maps.save(tmp_path / f"m.{ending}")
    read = json.loads((tmp_path / "m.json").read_text())
    assert read["format"] == "clrender path maps 1" and read["spp"] == 64
    np.testing.assert_array_equal(np.array(read["bounces"], np.float32), maps.bounces)
    np.testing.assert_array_equal(np.array(read["errors"]["light"], np.float32), maps.errors["light"])
    assert read["shares"] == pytest.approx(maps.shares.tolist())
    with OpenEXR.File(str(tmp_path / "m.exr"), separate_channels=True) as file:
        channels = {name: channel.pixels for name, channel in file.parts[0].channels.items()}
    np.testing.assert_array_equal(channels["bounce.1.G"], maps.bounces[1][..., 1])
    np.testing.assert_array_equal(channels["length"], maps.length)
    np.testing.assert_array_equal(channels["error.bsdf"], maps.errors["bsdf"])
    page = (tmp_path / "m.html").read_text()
    assert page.count("<img ") == 1 + len(maps.bounces) + 1 + len(STRATEGIES)
    assert not re.search(r"(src|href)=\"(?!data:)", page) and "<script" not in page
    with pytest.raises(UsageError, match=r"\.html, \.json or \.exr"):
        maps.save(tmp_path / "m.png")


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"integrator": "bdpt"}, "integrator bdpt has no maps"),
        ({"bounces": 33}, "from 0 to 32"),
        ({"bounces": 1.5}, "from 0 to 32"),
        ({"crop": (0, 0, 2, 2)}, "crop has no effect"),
        ({"aov": ("albedo",)}, "aov has no effect"),
        ({"spp": 16}, "give 32 or more"),
    ],
)
def test_what_is_refused(device: Device, settings: dict[str, Any], words: str) -> None:
    with pytest.raises(UsageError, match=words):
        clrender.path_maps(closed(0.5), device=device, **{"size": (8, 8), "spp": 32, **settings})


def test_a_stop_leaves_nothing(device: Device) -> None:
    with pytest.raises(RenderError, match="not complete"):
        clrender.path_maps(closed(0.5), size=(8, 8), spp=32, device=device, should_stop=lambda: True)
