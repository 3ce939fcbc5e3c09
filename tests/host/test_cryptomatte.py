"""Cryptomatte: ids by the specification, ranks by counting, names of shapes that no image depends on."""

from __future__ import annotations

import json
from collections import Counter

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import ValidationError

import clrender
from clrender.aov import matte_attributes, matte_names
from clrender.aov.cryptomatte import murmur3, name_id, ranked
from clrender.aov.samples import PrimitiveSamples
from clrender.errors import RenderError
from clrender.film.unit import Unit, UnitSums, tile_slots
from clrender.scene import Scene

PUBLISHED = {
    "hello": 6.0705627102400005616e-17,
    "cube": -4.08461912519e15,
    "sphere": 2.79018604383e15,
    "plane": 3.66557617593e-11,
    "\u0440\u0430\u0432\u043d\u0438\u043d\u0430": -1.3192631212399999468e-25,
    "m\u00e4dchen": 6.2361298211599995797e25,
}
"""Ids that the tests of Psyop's reference implementation give (github.com/Psyop/Cryptomatte, CryptoHashing)."""

HASHES = {
    b"": 0,
    b"a": 0x3C2569B2,
    b"ab": 0x9BBFD75F,
    b"abc": 0xB3DD93FA,
    b"test": 0xBA6BD213,
    b"Hello, world!": 0xC0363E43,
    b"The quick brown fox jumps over the lazy dog": 0x2E4FF723,
}
"""MurmurHash3_x86_32 with the seed 0, of every length of the last part."""


def as_float(number: int) -> np.float32:
    return np.float32(np.uint32(number).view(np.float32))


def test_hashes() -> None:
    assert {data: murmur3(data) for data in HASHES} == HASHES


def test_ids_of_names() -> None:
    assert {name: as_float(name_id(name)) for name in PUBLISHED} == {
        name: np.float32(number) for name, number in PUBLISHED.items()
    }


@given(st.text(max_size=20))
def test_every_id_is_an_ordinary_number(name: str) -> None:
    number = as_float(name_id(name))
    assert np.isfinite(number) and abs(number) >= np.finfo(np.float32).tiny


def test_exponents_without_or_with_all_bits_are_mended() -> None:
    """Of a thousand names about eight have one: theirs is the hash with one bit turned round, all others' the hash."""
    hashes = {name: murmur3(name.encode()) for name in map(str, range(2000))}
    odd = {name for name, number in hashes.items() if number >> 23 & 255 in (0, 255)}
    assert 4 < len(odd) < 40
    assert all(name_id(name) == number ^ ((name in odd) << 23) for name, number in hashes.items())


def test_header() -> None:
    said = matte_attributes({"crypto_object": ["cube", "m\u00e4dchen", "cube", None]})
    key = next(iter(said)).split("/")[1]
    assert len(key) == 7 and f"{murmur3(b'CryptoObject'):08x}".startswith(key)
    assert {name.split("/")[2]: text for name, text in said.items() if not name.endswith("manifest")} == {
        "name": "CryptoObject",
        "hash": "MurmurHash3_32",
        "conversion": "uint32_to_float32",
    }
    manifest = json.loads(said[f"cryptomatte/{key}/manifest"])
    assert {name: as_float(int(number, 16)) for name, number in manifest.items()} == {
        name: np.float32(PUBLISHED[name]) for name in ("cube", "m\u00e4dchen")
    }
    assert all(len(number) == 8 for number in manifest.values())


@settings(deadline=None)
@given(st.integers(1, 40), st.integers(0, 2**32 - 1))
def test_ranks_are_those_of_counting(samples: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    ids = np.concatenate([[0], rng.integers(1 << 23, 0x7F000000, 11)]).astype(np.uint32)
    ids[3] = ids[7]  # two shapes of one name
    ids[5] = 0  # and one without
    numbers = rng.integers(0, 12, (17, samples)).astype(np.uint32)
    taken = rng.integers(1, samples + 1, 17).astype(np.uint32)
    numbers[np.arange(samples) >= taken[:, None]] = 0
    found = ranked(numbers, taken, ids)
    for pixel in range(17):
        counts = Counter(int(each) for each in ids[numbers[pixel]] if each)
        expected = sorted(counts.items(), key=lambda each: (-each[1], each[0]))[:6]
        for rank in range(6):
            number, count = expected[rank] if rank < len(expected) else (0, 0)
            assert found[2 * rank, pixel].view(np.uint32) == number
            assert found[2 * rank + 1, pixel] == np.float32(count / taken[pixel])


def test_ranks_do_not_depend_on_the_order_of_samples() -> None:
    rng = np.random.default_rng(2)
    numbers = rng.integers(0, 9, (400, 64)).astype(np.uint32)
    ids = np.concatenate([[0], rng.integers(1 << 23, 0x7F000000, 8)]).astype(np.uint32)
    taken = np.full(400, 64, np.uint32)
    before = ranked(numbers, taken, ids)
    assert before.tobytes() == ranked(rng.permuted(numbers, axis=1), taken, ids).tobytes()
    assert (before[11] > 0.0).any(), "some pixels have six names"


def test_samples_find_their_pixels() -> None:
    """Two rows of tiles, of which the last reaches beyond the image; a tile of the second sample was not taken."""
    seen = PrimitiveSamples(10, 7, (0, 2), 2, 4)
    assert (seen.top, seen.bottom) == (0, 7)
    primitive = np.arange(6 * 16, dtype=np.uint32) * 70001  # beyond 2^16
    none = np.zeros((0, 3, 4), np.uint32), np.zeros(0, np.uint32)
    samples = np.full((2, 3, 96), np.nan, np.float32)
    samples[0, :2] = primitive & 0xFFFF, primitive >> 16
    samples[0, :, 3] = 1e30
    result = UnitSums(*none, np.full(6, 1, np.uint32), 0, 0, 0, samples=samples)
    assert seen.commit(Unit(0, 96, 0, 2, 4), result) == 70
    slot = tile_slots(4).reshape(4, 4)
    assert seen.numbers[5, 9, 0] == primitive[5 * 16 + slot[1, 1]] + 1
    assert seen.numbers[0, 3, 0] == 0 and not seen.numbers[..., 1].any() and (seen.taken == 1).all()
    with pytest.raises(RenderError, match="single samples"):
        seen.commit(Unit(0, 96, 0, 2, 4), UnitSums.nothing(Unit(0, 96, 0, 2, 4)))


# --- names of shapes -------------------------------------------------------------------------------------------------

BALL = {"type": "sphere", "radius": 1.0}


def scene(*shapes: dict[str, object]) -> Scene:
    camera = {"position": [0, 0, 5], "target": [0, 0, 0]}
    materials = {"red": {"type": "lambert", "reflectance": [0.5, 0.1, 0.1]}}
    return Scene.model_validate({"camera": camera, "materials": materials, "shapes": list(shapes)})


def test_shapes_without_a_name_have_their_type_and_place() -> None:
    what = scene({**BALL, "name": "\u00e4pfel"}, {**BALL, "material": "red"})
    assert matte_names(what) == {"crypto_object": ["\u00e4pfel", "sphere_1"], "crypto_material": [None, "red"]}


def test_names_are_no_part_of_the_hash() -> None:
    plain, named = scene(BALL), scene({**BALL, "name": "ball"})
    assert plain.sha256() == named.sha256() and plain.content_sha256() == named.content_sha256()
    assert clrender.RenderJob.of(plain).sha256() == clrender.RenderJob.of(named).sha256()


def test_a_name_that_is_none() -> None:
    for name in ("", 3, "x" * 201):
        with pytest.raises(ValidationError, match=r"shapes\.0.*name"):
            scene({**BALL, "name": name})
