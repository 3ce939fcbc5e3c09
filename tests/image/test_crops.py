"""A crop has the pixels of the whole image, to the bit."""

from __future__ import annotations

import random
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

import clrender
from clrender.errors import UsageError

if TYPE_CHECKING:
    from clrender.device import Device

SIZE = (50, 38)
LAYERS = ("normal", "depth", "object", "crypto_object")
WAYS: list[dict[str, Any]] = [
    {},
    {"filter": "mitchell", "kernels": "staged"},
    {"integrator": "direct", "shadow_rays": 2},
    {"integrator": "whitted"},
    {"integrator": "bdpt", "filter": "mitchell"},
    {"integrator": "photon", "photons": 2000},
    {"integrator": "radiosity"},
    {"integrator": "reuse"},
    {"guiding": "on", "guiding_paths": 20000},
    {"replicate_spp": 1, "filter": "gaussian"},
]


def scene(integrator: str) -> clrender.Scene:
    return clrender.load("cornell" if integrator == "radiosity" else "room")


def crop_of(rng: random.Random, step: int) -> tuple[int, int, int, int]:
    """A rectangle within the image, whose edges are multiples of `step` or those of the image."""

    def side(length: int) -> tuple[int, int]:
        begin = rng.randrange(0, length, step)
        ends = [*range(begin + step, length, step), length]
        return begin, rng.choice(ends) - begin

    (x, width), (y, height) = side(SIZE[0]), side(SIZE[1])
    return x, y, width, height


def same(session: clrender.Session, way: dict[str, Any], seed: int, count: int) -> None:
    """`count` random crops of one image."""
    what, rng = scene(way.get("integrator", "path")), random.Random(seed)
    whole = session.render(what, size=SIZE, spp=2, aov=LAYERS, **way)
    for _ in range(count):
        x, y, width, height = crop = crop_of(rng, 4 if way.get("integrator") == "reuse" else 1)
        part = session.render(what, size=SIZE, spp=2, aov=LAYERS, crop=crop, **way)
        assert part.linear.shape == (height, width, 3)
        inside = np.s_[y : y + height, x : x + width]
        np.testing.assert_array_equal(part.linear, whole.linear[inside], err_msg=str(crop))
        for name in LAYERS:
            np.testing.assert_array_equal(part.aovs[name], whole.aovs[name][inside], err_msg=f"{crop} {name}")


def test_a_crop_has_the_bits_of_the_whole(device: Device) -> None:
    with clrender.Session(device.info.index) as session:
        same(session, {}, 1, 4)


@pytest.mark.long
@pytest.mark.parametrize("way", WAYS, ids=str)
def test_crops_have_the_bits_of_the_whole(device: Device, way: dict[str, Any]) -> None:
    """Ten random ones for each of ten ways."""
    with clrender.Session(device.info.index) as session:
        same(session, way, 2, 10)


def test_errors_of_a_crop_are_those_of_the_whole(device: Device) -> None:
    what = clrender.load("room")
    with clrender.Session(device.info.index) as session:
        whole = session.render(what, size=SIZE, spp=32, aov="stderr", replicate_spp=8)
        part = session.render(what, size=SIZE, spp=32, aov="stderr", replicate_spp=8, crop=(5, 6, 20, 11))
    np.testing.assert_array_equal(part.aovs["stderr"], whole.aovs["stderr"][6:17, 5:25])


def test_a_crop_is_cut_resumed_and_verified(device: Device, tmp_path: Path) -> None:
    what = clrender.load("room")
    how: dict[str, Any] = {"size": SIZE, "spp": 8, "crop": (9, 3, 33, 30)}
    with clrender.Session(device.info.index) as session:
        image = session.render(what, **how)
        cut = session.render(what, **how, tile=8, samples_per_pass=1)
        assert cut.stats["image_sha256"] == image.stats["image_sha256"]
        assert (image.stats["width"], image.stats["height"]) == (33, 30)
        assert image.stats["crop"] == [9, 3, 33, 30, 50, 38]
        first = session.render(what, **how, samples=(0, 3), checkpoint=tmp_path / "part.film")
        assert first.stats["samples"] == 3 * 33 * 30
        parts = [session.render(clrender.RenderJob.of(what, **how).shard(number, 3)) for number in (1, 2, 3)]
        for number, part in enumerate(parts):
            part.save(tmp_path / f"{number}.film")
        image.save(tmp_path / "image.exr")
        found = clrender.verify(tmp_path / "image.exr", scene=what, fraction=1.0, device=device.info.index)
        assert found.sound and found.checked == found.tiles
    from clrender.film.merge import merge_films

    merged = merge_films([tmp_path / f"{number}.film" for number in range(3)])
    np.testing.assert_array_equal(merged.develop(), image.linear)
    assert merged.request["crop"] == [9, 3, 33, 30]


def test_a_crop_of_everything_is_the_image() -> None:
    job = clrender.RenderJob.of(clrender.load("room"), size=SIZE, crop=(0, 0, *SIZE))
    assert (
        job.settings.crop is None and job.sha256() == clrender.RenderJob.of(clrender.load("room"), size=SIZE).sha256()
    )


@pytest.mark.parametrize(
    ("crop", "more", "words"),
    [
        ((0, 0, 51, 1), {}, r"crop is 0,0,51x1, which is not within the image of 50 x 38"),
        ((0, 0, 0, 1), {}, r"crop is .*, the last two at least 1"),
        ((0, 0, 1), {}, r"crop is .*, but must be four whole numbers"),
        ((0, 0, 1.5, 2), {}, r"crop is .*, but must be four whole numbers"),
        ("0,0,1x1", {}, r"crop is .*, but must be four whole numbers"),
        ((1, 0, 8, 8), {"integrator": "reuse"}, r"share light in blocks of 4 x 4: its edges must be multiples of 4"),
    ],
)
def test_wrong_crops_are_refused(crop: Any, more: dict[str, Any], words: str) -> None:
    with pytest.raises(UsageError, match=words):
        clrender.RenderJob.of(clrender.load("room"), size=SIZE, crop=crop, **more)
