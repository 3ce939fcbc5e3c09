"""Mattes: coverage that is known exactly, the same bits however the work is cut, and what files say of them."""

from __future__ import annotations

import itertools
import json
import sys
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

import clrender
from clrender.aov.cryptomatte import name_id
from clrender.device import Device
from clrender.scene import Scene

WIDTH, HEIGHT = 8, 4
SHARES = (15, 13, 11, 9, 7, 5, 3, 1)
"""In 64ths of a pixel's width, together all of it."""
NAMES = ("\u00c4pfel", "b", "\u7acb\u65b9\u4f53", "d", "e", "f", "g", "h")


def strip(left: float, right: float, name: str, material: str) -> dict[str, Any]:
    """From top to bottom of the view."""
    return {
        "type": "quad",
        "name": name,
        "origin": [left, -9.0, 0.0],
        "edge_u": [right - left, 0.0, 0.0],
        "edge_v": [0.0, 18.0, 0.0],
        "material": material,
    }


def scene(*shapes: dict[str, Any]) -> Scene:
    """Pixels are squares of one metre; the middle of the image is x = 0."""
    camera = {"type": "orthographic", "position": [0, 0, 5], "target": [0, 0, 0], "height": HEIGHT}
    grey = {"type": "lambert", "reflectance": [0.5, 0.5, 0.5]}
    return Scene.model_validate({"camera": camera, "materials": {"left": grey, "right": grey}, "shapes": list(shapes)})


def strips() -> Scene:
    """The pixels of the column from x = 1 to 2 hold eight strips, in no order; another shape covers those before it."""
    edges = 1.0 + np.cumsum([0, *SHARES]) / 64.0
    parts = [strip(edges[i], edges[i + 1], NAMES[i], "right" if i % 2 else "left") for i in (3, 0, 7, 2, 5, 1, 6, 4)]
    return scene(*parts, strip(-9.0, 1.0, "wall", "left"))


def mattes(device: Device, what: Scene, **settings: Any) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.float32]]:
    with clrender.Session(device) as session:
        names = ("crypto_object", "crypto_material")
        image = session.render(what, aov=names, **{"size": (WIDTH, HEIGHT), "spp": 64, **settings})
    return image.aovs["crypto_object"], image.aovs["crypto_material"]


def pairs(pixel: npt.NDArray[np.float32]) -> list[tuple[int, float]]:
    """Ids and coverages."""
    return [(int(pixel[i].view(np.uint32)), float(pixel[i + 1])) for i in range(0, 12, 2)]


@pytest.mark.parametrize("share", [1, 16, 48, 63])
def test_an_edge_covers_what_lies_on_its_side(device: Device, share: int) -> None:
    """The 64 samples of a pixel stand one in each 64th of its width."""
    found, _ = mattes(device, scene(strip(-9.0, -2.0 + share / 64.0, "wall", "left")))
    wall = name_id("wall")
    for x in range(WIDTH):
        expected = 1.0 if x < 2 else share / 64.0 if x == 2 else 0.0
        for y in range(HEIGHT):
            first, *rest = pairs(found[y, x])
            assert first == ((wall, expected) if expected else (0, 0.0)), (x, y)
            assert rest == [(0, 0.0)] * 5


def test_more_names_than_ranks(device: Device) -> None:
    objects, materials = mattes(device, strips())
    expected = [(name_id(name), share / 64.0) for name, share in zip(NAMES, SHARES, strict=True)]
    for y in range(HEIGHT):
        assert pairs(objects[y, 5]) == expected[:6]
        assert pairs(materials[y, 5])[:3] == [(name_id("left"), 36 / 64), (name_id("right"), 28 / 64), (0, 0.0)]
        assert pairs(objects[y, 4]) == [(name_id("wall"), 1.0), *[(0, 0.0)] * 5]


def test_shapes_of_one_name_are_one(device: Device) -> None:
    halves = scene(strip(-9.0, 0.25, "wall", "left"), strip(0.25, 0.75, "wall", "right"))
    found, _ = mattes(device, halves)
    assert pairs(found[1, 4]) == [(name_id("wall"), 0.75), *[(0, 0.0)] * 5]


def test_of_equal_shares_the_smaller_id_comes_first(device: Device) -> None:
    found, _ = mattes(device, scene(strip(0.0, 0.5, "p", "left"), strip(0.5, 1.0, "q", "left")))
    assert pairs(found[0, 4])[:2] == [(number, 0.5) for number in sorted((name_id("p"), name_id("q")))]


def test_what_has_no_material_is_in_one_matte_only(device: Device) -> None:
    lamp = {**strip(-9.0, 9.0, "lamp", ""), "emission": [1, 1, 1]}
    del lamp["material"]
    objects, materials = mattes(device, scene(lamp))
    assert (objects[..., 1] == 1.0).all() and not materials.any()


@pytest.mark.long
def test_the_pixel_filter_decides_where_samples_lie(device: Device) -> None:
    """Beyond its own rim, too: half of the weight of a pixel's filter is on the left of its middle."""
    what = scene(strip(-9.0, 0.5, "wall", "left"))
    found, _ = mattes(device, what, filter="gaussian")
    assert abs(found[0, 4, 1] - 0.5) <= 1 / 64 and 0.0 < found[0, 5, 1] < 0.5 < found[0, 3, 1] < 1.0


ONE: tuple[int, int, int | None] = (1, 64, None)


@pytest.mark.long
@pytest.mark.parametrize(("lanes", "tile", "passes"), [ONE, (4, 8, 1), (16, 16, 3)])
def test_the_same_bits_however_the_work_is_cut(
    device: Device, lanes: int, tile: int, passes: int | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    what = clrender.load("room")
    expected = mattes(device, what, size=(40, 50), spp=6)
    # One row of tiles at a time
    monkeypatch.setattr(sys.modules["clrender.aov.first_hits"], "_SAMPLES_BYTES", 1)
    found = mattes(device, what, size=(40, 50), spp=6, lanes=lanes, tile=tile, samples_per_pass=passes)
    assert [each.tobytes() for each in found] == [each.tobytes() for each in expected]
    assert (expected[0][..., 3] > 0.0).any(), "some pixels have two objects"


def test_a_file_says_what_its_ids_mean(device: Device, tmp_path: Path) -> None:
    import OpenEXR

    image = clrender.render(strips(), size=(WIDTH, HEIGHT), spp=64, device=device, aov=["crypto_object"])
    image.save(tmp_path / "a.exr")
    with OpenEXR.File(str(tmp_path / "a.exr"), separate_channels=True) as file:
        header = {name: str(value) for name, value in file.header().items() if name.startswith("cryptomatte/")}
        held = {name: np.array(channel.pixels) for name, channel in file.channels().items()}
    (key,) = {name.split("/")[1] for name in header}
    assert header[f"cryptomatte/{key}/name"] == "CryptoObject"
    manifest = json.loads(header[f"cryptomatte/{key}/manifest"])
    assert set(manifest) == {*NAMES, "wall"}
    for name, share in zip(NAMES, SHARES, strict=True):
        number = np.uint32(int(manifest[name], 16)).view(np.float32)
        cover = np.zeros((HEIGHT, WIDTH))
        for layer, pair in itertools.product(("CryptoObject00", "CryptoObject01", "CryptoObject02"), ("RG", "BA")):
            cover += np.where(held[f"{layer}.{pair[0]}"] == number, held[f"{layer}.{pair[1]}"], 0.0)
        assert np.all(cover[:, 5] == (share / 64.0 if name in NAMES[:6] else 0.0))
