"""A film on a device against that of the host: the same sums, counts, squares and means, to the bit."""

from __future__ import annotations

import itertools
import random
from typing import TYPE_CHECKING

import numpy as np
import pytest

import clrender
from clrender import layout
from clrender.device.device_film import DeviceFilm
from clrender.device.worker import DeviceWorker
from clrender.errors import RenderError
from clrender.film import Film
from clrender.film.unit import BLOCK_SLOTS, Unit, UnitSums, slot_count
from clrender.flatten.flat_scene import flatten

if TYPE_CHECKING:
    from collections.abc import Iterator

    from clrender.device import Buffer, Device

WIDTH, HEIGHT, TILE = 75, 50, 16
SLOTS = slot_count(WIDTH, HEIGHT, TILE)
AREA = TILE * TILE


@pytest.fixture(autouse=True)
def low_bands(monkeypatch: pytest.MonkeyPatch) -> None:
    """Bands of seven rows, which tiles cross."""
    monkeypatch.setattr("clrender.film.film._BAND_BYTES", 7 * 48 * WIDTH)


@pytest.fixture
def settings(device: Device) -> Iterator[Buffer]:
    fields = np.zeros(1, layout.dtype("Settings"))
    fields["width"], fields["height"], fields["tile"] = WIDTH, HEIGHT, TILE
    buffer = device.upload(fields)
    yield buffer
    device.release(buffer)


def device_film(device: Device, settings: Buffer, film: Film) -> DeviceFilm:
    return DeviceFilm(device, settings, film)


def made_up(rng: np.random.Generator, unit: Unit, squares: bool) -> UnitSums:
    """Any sums of a unit; those of slots outside the image, too, which nobody may look at."""
    slots = unit.slot_count
    sums = rng.integers(0, 2**32, (slots, 3, 4), np.uint32)
    sums[..., 3] = (sums[..., 3].astype(np.int32) >> 12).astype(np.uint32)  # of a magnitude far below 2^62
    counts = rng.integers(0, unit.sample_count + 1, slots, np.uint32)
    done = np.full(slots // BLOCK_SLOTS, unit.sample_count, np.uint32)
    of_squares = rng.integers(0, 2**32, (slots, 3, 8), np.uint32) if squares else None
    return UnitSums(sums, counts, done, 1, 1, 1, of_squares)


def add(device: Device, held: DeviceFilm, unit: Unit, result: UnitSums) -> None:
    given = [result.sums, result.counts] + ([] if result.squares is None else [result.squares])
    buffers = [device.upload(each) for each in given]
    held.add(unit, *buffers)
    for buffer in buffers:
        device.release(buffer)


def units(sample: int, count: int) -> list[Unit]:
    """All of the image: several rows of tiles, parts of a row, a single tile, and blocks of one."""
    cuts = [0, AREA // 2, AREA, 2 * AREA, 7 * AREA, 13 * AREA, SLOTS]
    return [Unit(a, b - a, sample, count, TILE) for a, b in itertools.pairwise(cuts)]


@pytest.mark.parametrize("replicates", [False, True])
def test_units_come_to_the_same_film(device: Device, settings: Buffer, replicates: bool) -> None:
    rng, before = np.random.default_rng(70), device.buffers
    film = Film(WIDTH, HEIGHT, {"replicate_spp": 2} if replicates else {})
    assert len(film.bands()) > 5
    for unit in units(0, 6)[:3]:  # what it begins with
        film.commit(unit, made_up(rng, unit, replicates))
    held = device_film(device, settings, film)
    for unit in [*units(0, 6)[3:], *units(6, 4)]:
        result = made_up(rng, unit, replicates)
        film.commit(unit, result)
        add(device, held, unit, result)
    for last in (False, True):
        copy = held.copy(sums=True, image=True, last=last)
        assert copy.image is not None and copy.bands is not None
        np.testing.assert_array_equal(copy.counts, film.counts)
        for ours, theirs in zip([*copy.bands, *copy.squares], [*film.bands(), *film.square_bands()], strict=True):
            np.testing.assert_array_equal(ours, theirs)
        np.testing.assert_array_equal(copy.image.view(np.uint32), film.mean().view(np.uint32))
    with pytest.raises(RenderError):
        held.copy(sums=True, image=True)
    held.release()
    assert device.buffers == before


def pixel_sums(rng: random.Random) -> int:
    """A sum of any length, of both signs, often with many zeros at its end, so that roundings are ties."""
    value = rng.getrandbits(rng.randrange(1, 126))
    if rng.random() < 0.5:
        value = (value >> (cut := rng.randrange(70))) << cut
    return rng.choice((-1, 1)) * value


def test_means_are_rounded_as_on_the_host(device: Device, settings: Buffer) -> None:
    """Against Python's own arithmetic: an integer to double precision, over the count, to single precision."""
    rng = random.Random(71)
    film = Film(WIDTH, HEIGHT)
    numbers = [[pixel_sums(rng) for _ in range(3)] for _ in range(WIDTH * HEIGHT)]
    counts = [
        rng.choice((0, 1, 2**32 - 1, 1 << rng.randrange(32), rng.getrandbits(rng.randrange(1, 33)))) for _ in numbers
    ]
    words = b"".join((value % 2**128).to_bytes(16, "little") for pixel in numbers for value in pixel)
    sums = np.frombuffer(words, "<u8").reshape(HEIGHT, WIDTH, 3, 2)
    for top, band in zip(range(0, HEIGHT, film.band_rows), film.bands(), strict=True):
        band[:] = sums[top : top + len(band)]
    film.counts[:] = np.reshape(counts, (HEIGHT, WIDTH))
    blocks = np.arange(len(film.ledger.taken()))
    film.ledger.add(blocks, 0, np.ones_like(blocks))
    held = device_film(device, settings, film)
    image = held.copy(sums=False, image=True, last=True).image
    held.release()
    wanted = [
        [np.float32(float(value) * 2.0**-64 / max(count, 1)) for value in pixel]
        for pixel, count in zip(numbers, counts, strict=True)
    ]
    assert image is not None
    np.testing.assert_array_equal(image.reshape(-1, 3).view(np.uint32), np.array(wanted, np.float32).view(np.uint32))


@pytest.mark.parametrize(
    ("sums", "counts", "error"),
    [
        ((2**62) << 64, 2**19, "beyond 2\\^62"),
        (-((2**62) << 64) - 1, 2**19, "beyond 2\\^62"),
        (0, 2**32 - 1, "4294967295 samples"),
    ],
)
def test_what_a_film_cannot_hold_ends_the_render(
    device: Device, settings: Buffer, sums: int, counts: int, error: str
) -> None:
    unit, before = units(0, 2)[1], device.buffers
    held = device_film(device, settings, Film(WIDTH, HEIGHT))
    words = np.frombuffer((sums % 2**128).to_bytes(16, "little"), "<u4")
    number = np.zeros((unit.slot_count, 3, 4), np.uint32)
    number[5, 1] = words
    result = UnitSums(number, np.full(unit.slot_count, counts, np.uint32), np.zeros(1, np.uint32), 0, 0, 0)
    with pytest.raises(RenderError, match=error):
        for _ in range(2):
            add(device, held, unit, result)
    with pytest.raises(RenderError):
        held.copy(sums=True, image=False)
    held.release()
    device.release_but(before)


def test_a_device_without_the_memory_is_left_as_it_was(
    device: Device, settings: Buffer, monkeypatch: pytest.MonkeyPatch
) -> None:
    before = device.buffers
    monkeypatch.setattr(device, "memory_limit", sum(each.nbytes for each in before) + 40 * WIDTH * HEIGHT)
    monkeypatch.setattr(device, "_held_bytes", sum(each.nbytes for each in before))
    with pytest.raises(RenderError, match="may use"):
        device_film(device, settings, Film(WIDTH, HEIGHT))
    assert device.buffers == before


def test_what_was_never_delivered_is_forgotten(device: Device) -> None:
    """By a worker that is to begin with a film once more, of which it has a unit more than it delivered."""
    size, film = 16, Film(16, 16)
    fields = np.zeros(1, layout.dtype("Settings"))
    for name in ("width", "height", "tile"):
        fields[name] = size
    for name in ("shadow_rays", "indirect_rays", "light_samples", "bsdf_samples"):
        fields[name] = 1
    fields["max_depth"] = 2
    worker = DeviceWorker(device, flatten(clrender.load("cornell"), size, size), fields)
    first, second = (Unit(0, size * size, sample, 1, size) for sample in (0, 1))
    assert worker.hold(film)
    held = worker.render_held(first)
    film.receive(worker.copy_held(sums=True, image=False, last=False), [(first, held)])
    worker.render_held(second)
    assert worker.hold(film)
    again = worker.copy_held(sums=True, image=False, last=True)
    worker.release()
    np.testing.assert_array_equal(again.counts, film.counts)
    np.testing.assert_array_equal(np.concatenate(again.bands or []), np.concatenate(film.bands()))
