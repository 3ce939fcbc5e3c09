"""Cryptomatte 1.2.0 (Friedman and Jones, Psyop): ids of names, and their coverage of each pixel.

A name's id is the MurmurHash3_x86_32 of its UTF-8 bytes, changed so that it is a normal float32 and stored as the
float32 of the same bits. A pixel has six pairs of an id and its coverage, the largest coverage first.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Final

import numpy as np
import numpy.typing as npt

from clrender.aov.names import MATTES, RANKS
from clrender.flatten.assembly import assemble

if TYPE_CHECKING:
    from clrender.scene import Scene

__all__ = ["matte_attributes", "matte_names", "murmur3", "name_id", "ranked"]

_WORD: Final = 0xFFFFFFFF
_EXPONENT: Final = 0x7F800000
_CHUNK: Final = 1 << 21


def murmur3(data: bytes) -> int:
    """MurmurHash3_x86_32 with the seed 0 (Appleby, SMHasher): 32 bits."""
    total = 0
    whole = len(data) // 4 * 4
    for start in range(0, whole, 4):
        total ^= _scrambled(int.from_bytes(data[start : start + 4], "little"))
        total = (_rotated(total, 13) * 5 + 0xE6546B64) & _WORD
    total ^= _scrambled(int.from_bytes(data[whole:], "little")) ^ len(data)
    for shift, factor in ((16, 0x85EBCA6B), (13, 0xC2B2AE35), (16, 1)):
        total = ((total ^ total >> shift) * factor) & _WORD
    return total


def _scrambled(word: int) -> int:
    return _rotated(word * 0xCC9E2D51 & _WORD, 15) * 0x1B873593 & _WORD


def _rotated(word: int, by: int) -> int:
    return (word << by | word >> (32 - by)) & _WORD


def name_id(name: str) -> int:
    """The id of a name, as bits of a float32 that is neither zero, denormal, infinite nor NaN.

    If all or none of the exponent's bits are set, its lowest bit is flipped, as the specification says.
    """
    number = murmur3(name.encode("utf-8"))
    return number ^ (1 << 23) if number & _EXPONENT in (0, _EXPONENT) else number


def matte_names(scene: Scene) -> dict[str, list[str | None]]:
    """Names in each of `MATTES` of the objects that `assemble` distinguishes, in its order; None: no name.

    A shape without a name is named by its type and its index, such as ``mesh_3``. The shapes of an instance have its
    name, but each its own material.
    """
    objects = [f"{shape.type}_{at}" if shape.name is None else shape.name for at, shape in enumerate(scene.shapes)]
    assembly = assemble(scene)
    return {
        "crypto_object": [objects[at] for at in assembly.seen_place.tolist()],
        "crypto_material": [assembly.scene.shapes[at].material for at in assembly.seen_shape.tolist()],
    }


def matte_attributes(mattes: Mapping[str, Sequence[str | None]]) -> dict[str, str]:
    """The Cryptomatte metadata for a file's header.

    Parameters
    ----------
    mattes : mapping of str to sequence of str or None
        As from `matte_names`, for each layer of the file.

    Returns
    -------
    dict of str to str
        ``cryptomatte/<key>/name``, ``hash``, ``conversion`` and ``manifest``: JSON that maps each name to its id in
        eight hexadecimal digits. The key is the first seven digits of the id of the layer's own name.
    """
    attributes: dict[str, str] = {}
    for layer, names in mattes.items():
        title = MATTES[layer]
        manifest = {name: f"{name_id(name):08x}" for name in sorted({name for name in names if name is not None})}
        said = {
            "name": title,
            "hash": "MurmurHash3_32",
            "conversion": "uint32_to_float32",
            "manifest": json.dumps(manifest, ensure_ascii=False, separators=(",", ":")),
        }
        key = f"{name_id(title):08x}"[:7]
        attributes |= {f"cryptomatte/{key}/{what}": text for what, text in said.items()}
    return attributes


def ranked(
    numbers: npt.NDArray[np.uint32], taken: npt.NDArray[np.uint32], ids: npt.NDArray[np.uint32]
) -> npt.NDArray[np.float32]:
    """Ids and their coverage of pixels, by counting samples, so that their order does not matter.

    Parameters
    ----------
    numbers : (P, N) uint32
        Objects that the samples of each pixel hit, counted from 1; 0: nothing.
    taken : (P,) uint32
        Number of samples of each pixel, including those that hit nothing; further entries of `numbers` are 0.
    ids : (K + 1,) uint32
        `name_id` of each object; 0: no name.

    Returns
    -------
    (2 * RANKS, P) float32
        Pairs of an id and its coverage, the count divided by `taken` and rounded once. Sorted by descending coverage,
        then by ascending id. Missing pairs are zero; pairs beyond `RANKS` are omitted.
    """
    result = np.zeros((2 * RANKS, len(numbers)), np.float32)
    rows = max(1, _CHUNK // max(numbers.shape[1], 1))
    for first in range(0, len(numbers), rows):
        part = slice(first, first + rows)
        _rank(np.sort(ids[numbers[part]], axis=1), taken[part], result[:, part])
    return result


def _rank(found: npt.NDArray[np.uint32], taken: npt.NDArray[np.uint32], result: npt.NDArray[np.float32]) -> None:
    """Write the pairs of pixels whose ids are sorted."""
    begins = np.ones(found.shape, bool)
    np.not_equal(found[:, 1:], found[:, :-1], out=begins[:, 1:])
    places = np.flatnonzero(begins)
    counts = np.diff(places, append=found.size)
    pixels, ids = places // found.shape[1], found.reshape(-1)[places]
    named = ids != 0
    pixels, ids, counts = pixels[named], ids[named], counts[named]
    order = np.lexsort((-counts, pixels))  # stable: ids of equal counts keep their order
    pixels, ids, counts = pixels[order], ids[order], counts[order]
    rank = np.arange(len(pixels)) - np.searchsorted(pixels, pixels)
    kept = rank < RANKS
    pixels, rank = pixels[kept], rank[kept]
    result[2 * rank, pixels] = ids[kept].view(np.float32)
    result[2 * rank + 1, pixels] = (counts[kept] / taken[pixels]).astype(np.float32)
