"""Amounts of memory: how they are written, added up and told."""

from __future__ import annotations

from pathlib import Path

import pytest
from cases import for_each

import clrender
from clrender.errors import MemoryRefused, UsageError
from clrender.film import Film
from clrender.film.unit import slot_count, tile_side
from clrender.limits import Bytes, NotAllowed
from clrender.process.memory import check_host, check_image, film_bytes, largest_tile, process_bytes, shown, unit_slots
from clrender.rendering.job import RenderJob
from clrender.rendering.memory import needs, told

GIB = 1 << 30
AMOUNT = Bytes(1 << 24)


@for_each(("text", "value"), [
    ("16777216", 1 << 24), ("16384K", 1 << 24), ("16m", 1 << 24), ("1.5G", 3 * GIB // 2), ("2GiB", 2 * GIB),
    ("2 GB", 2 * GIB), ("1T", 1 << 40),
])  # fmt: skip
def test_amounts_have_suffixes(text: str, value: int) -> None:
    assert AMOUNT.parse(text) == value == AMOUNT.accept(value)


@for_each("text", ["", "G", "1,5G", "-2G", "2X", "1e9", "inf", "15.9M", "9" * 30, "2G 1M", "٣G"])
def test_other_texts_are_no_amounts(text: str) -> None:
    with pytest.raises(NotAllowed, match=r"must be a number of bytes from 16777216 to"):
        AMOUNT.parse(text)


def test_a_film_takes_what_is_reckoned() -> None:
    film = Film(173, 91)
    assert sum(band.nbytes for band in film.bands()) + film.counts.nbytes == 173 * 91 * film_bytes(False)


@for_each("limit", [1 << 24, 100 << 20, GIB])
@for_each("tile", [8, 64, 65536])
def test_a_unit_has_room_for_a_tile(limit: int, tile: int) -> None:
    side = tile_side(largest_tile(limit, tile), 8192, 8192)
    slots = unit_slots(limit)
    assert slots is not None and side * side <= slots and film_bytes(False) * slots <= limit // 64
    with_squares = unit_slots(limit, True)
    assert with_squares is not None and film_bytes(True) * with_squares <= max(limit // 64, 16 * film_bytes(True))
    assert largest_tile(None, tile) == tile and unit_slots(None) is None


@pytest.mark.parametrize(("size", "amounts"), [((8192, 8192), ("3.2 GiB", "768.0 MiB")), ((65536, 400), ("1.3 GiB",))])
def test_large_images_are_told(size: tuple[int, int], amounts: tuple[str, ...]) -> None:
    line = told(RenderJob.of(clrender.load("room"), size=size, spp=1))
    assert line is not None and f"{size[0]} x {size[1]} pixels" in line
    assert all(amount in line for amount in amounts)
    assert told(RenderJob.of(clrender.load("room"), size=(1920, 1080), spp=1)) is None


def test_what_a_render_needs_is_all_that_it_holds(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("clrender.rendering.memory.process_bytes", lambda: 123 << 20)
    job = RenderJob.of(clrender.load("room"), size=(1000, 500), spp=4, aov=("depth", "normal"), max_memory=GIB)
    pixels = 1000 * 500
    plain = needs(job, 2, checkpoint=False, resumed=False, held=False)
    assert plain["the film"] == 52 * pixels and plain["the image"] == 12 * pixels
    assert plain["layers"] == 4 * (1 + 3) * pixels
    assert plain["units of work"] == 12 * 52 * min(GIB // 64 // 52, slot_count(1000, 500, 64))
    assert plain["this program and the scene"] == 123 << 20
    judged = needs(RenderJob.of(job.scene, size=(1000, 500), error=0.1), 1, checkpoint=False, resumed=False, held=False)
    assert plain["standard errors"] == 0 and judged["standard errors"] == 144 * pixels
    assert judged["the film"] == 148 * pixels
    saved = needs(job, 2, checkpoint=True, resumed=True, held=False)
    assert saved["the film"] == 0, "it is in memory already"
    assert (
        saved["a copy of it for the checkpoint"] == saved["what devices that turn out to be wrong did"] == 52 * pixels
    )


def test_a_process_knows_what_it_holds() -> None:
    """Linux tells; where a system does not, nothing is counted."""
    assert 1 << 20 < process_bytes() < 1 << 40 or not Path("/proc/self/status").exists()


def test_too_much_is_refused_with_all_amounts() -> None:
    assert check_host(100, {"a": 60, "b": 40}) == check_host(None, {"a": 60, "b": 40}) == 100
    with pytest.raises(MemoryRefused, match=r"takes 101 bytes of the host's memory \(61 bytes for a, 40 bytes for b\)"):
        check_host(100, {"a": 61, "nothing": 0, "b": 40})
    check_image(1000, 1000, 64 * 10**6)
    with pytest.raises(UsageError, match=r"takes 61\.0 MiB of memory, 52 bytes a pixel .* allows 61\.0 MiB; ask for"):
        check_image(1000, 1000, 64 * 10**6 - 1)
    assert [shown(each) for each in (5, 1536, 3 << 20, 5 * GIB // 2)] == ["5 bytes", "1.5 KiB", "3.0 MiB", "2.5 GiB"]
