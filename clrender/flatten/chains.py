"""The table of specular chains: which lights they lead to, and which surfaces they can go over."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray

from clrender import layout
from clrender.errors import SceneError
from clrender.flatten.alias import alias_table
from clrender.flatten.lamps import POINT_KINDS
from clrender.flatten.surfaces import triangle_areas
from clrender.flatten.texture_rows import SLOTS
from clrender.wording import counted

if TYPE_CHECKING:
    from clrender.flatten.flat_scene import FlatScene

__all__ = ["chain_table"]

_MOST_SURFACES: Final = 2**24
_SMOOTH: Final = 1e-3
"""Alphas below it make a delta: LAYERING_SMOOTH of kernels/material/layering.h."""
_HEAD: Final = layout.columns("CHAIN_HEAD")
_KINDS: Final = (layout.MATERIAL_MIRROR, layout.MATERIAL_DIELECTRIC, layout.MATERIAL_CONDUCTOR)
_AREA_KINDS: Final = (layout.LIGHT_AREA_TRIANGLE, layout.LIGHT_AREA_SPHERE, layout.LIGHT_AREA_DISK)
_LIGHT_KINDS: Final = (*POINT_KINDS, *_AREA_KINDS, layout.LIGHT_DIRECTIONAL, layout.LIGHT_SUN)
"""Kinds of lights that chains lead to: all but the environment."""


def chain_table(flat: FlatScene) -> NDArray[np.float32]:
    """The words that ``kernels/specular/table.h`` reads.

    Parameters
    ----------
    flat : FlatScene

    Returns
    -------
    (N,) float32
        Without lights or surfaces for chains, both counts are 0.

    Raises
    ------
    SceneError
        If there are more than 2**24 surfaces for chains, with all instances counted.
    """
    primitives, areas, glass = _surfaces(flat)
    if len(primitives) > _MOST_SURFACES:
        raise SceneError(
            f"specular chains know at most {counted(_MOST_SURFACES, 'triangle')} of mirrors and glass, and the "
            "scene has "
            f"{len(primitives)}; render it without, or use simpler meshes for them"
        )
    rows = flat.arrays["lights"]
    found = np.flatnonzero(np.isin(rows["kind"][: flat.light_count], _LIGHT_KINDS))
    if not len(found) or not len(primitives):
        found, primitives, areas, glass = found[:0], primitives[:0], areas[:0], glass[:0]
    lights = np.zeros(len(rows))
    head = np.zeros(layout.CHAIN_HEAD, np.uint32)
    head[_HEAD["LIGHTS"]], head[_HEAD["ALL_LIGHTS"]], head[_HEAD["SURFACES"]] = len(found), len(lights), len(primitives)
    head[_HEAD["FIRST_SURFACE"]] = layout.CHAIN_HEAD + len(lights) + 4 * len(found)
    head[_HEAD["GLASS"]] = int(glass.any())
    ends = np.zeros((len(found), 4), np.uint32)
    if len(found):
        lights[found], threshold, alias = alias_table(rows["probability"][found].astype(np.float64))
        ends[:, 0], ends[:, 1], ends[:, 2] = found, _words(threshold), alias
    places = np.zeros((len(primitives), 4), np.uint32)
    if len(primitives):
        _, threshold, alias = alias_table(areas)
        places[:, 0], places[:, 1], places[:, 2] = primitives, _words(threshold), alias
    words = np.concatenate([head, _words(lights), ends.ravel(), places.ravel()])
    return words.view(np.float32)


def _words(numbers: NDArray[np.float64]) -> NDArray[np.uint32]:
    return numbers.astype(np.float32).view(np.uint32)


def _deltas(flat: FlatScene) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """(M,) each: whether each material can be a delta, and whether it is glass."""
    materials, rows = flat.arrays["materials"], flat.arrays["material_rows"]
    by_row = materials["kind"] == layout.MATERIAL_BY_ROW
    at = np.where(by_row, materials["row"], 0)
    first = rows[np.minimum(2 * at, len(rows) - 1)]
    kind = np.where(by_row, first[:, layout.columns("MATERIAL")["KIND"]].view(np.uint32), materials["kind"])
    roughness = first[:, layout.columns("MATERIAL")["ROUGHNESS"]]
    slots = flat.arrays["texture_slots"].view(np.uint32)
    textured = np.zeros(len(materials), bool)
    if flat.features.textures:
        textured = slots[np.minimum(at, len(slots) - 1), SLOTS["roughness"]] != layout.NONE
    rough = by_row & ~textured & (roughness * roughness >= _SMOOTH)
    return np.isin(kind, _KINDS) & ~rough, kind == layout.MATERIAL_DIELECTRIC


def _surfaces(flat: FlatScene) -> tuple[NDArray[np.int64], NDArray[np.float64], NDArray[np.bool_]]:
    """The primitives that may be deltas, with all instances: numbers, areas up to a factor, whether they are glass."""
    delta, glass = _deltas(flat)
    count = flat.triangle_count + flat.analytic_count
    material = flat.arrays["shapes"]["material"][flat.arrays["primitive_shape"][:count]]
    chosen = np.flatnonzero(delta[material])
    round_ones = chosen >= flat.triangle_count
    kind = flat.arrays["analytic_shapes"]["normal"][np.where(round_ones, chosen - flat.triangle_count, 0), 3]
    # Curves are none: kernels/specular/delta.h
    chosen = chosen[~(round_ones & (kind >= layout.ANALYTIC_SHAPE_CURVE))]
    triangles = chosen[chosen < flat.triangle_count]
    radius = flat.arrays["analytic_shapes"]["center_radius"][chosen[len(triangles) :] - flat.triangle_count, 3]
    areas = np.concatenate(
        [
            triangle_areas(flat.arrays["vertices"], flat.arrays["triangles"][triangles]),
            4.0 * math.pi * radius.astype(np.float64) * radius,
        ]
    )
    areas = np.maximum(areas, 1e-30)
    of = flat.instances
    own = (chosen < of.own_triangles) | (
        (chosen >= flat.triangle_count) & (chosen < flat.triangle_count + of.own_analytic)
    )
    numbers, sizes, kinds = [chosen[own]], [areas[own]], [glass[material[chosen[own]]]]
    linear = of.rows.reshape(-1, 2, 16)[:, 1, :3].astype(np.float64)
    words = of.rows.view(np.uint32).reshape(-1, 2, 16).astype(np.int64)
    total = len(numbers[0])
    for index, group in enumerate(of.groups):
        inside = np.zeros(count, bool)
        inside[group.triangles] = True
        inside[flat.triangle_count :][group.analytic(flat.triangle_count)] = True
        some = np.flatnonzero(inside[chosen])
        places = np.flatnonzero(of.group_of == index)
        total += len(some) * len(places)
        if not len(some) or total > _MOST_SURFACES:
            continue
        names = ("TRIANGLE_OFFSET", "ANALYTIC_OFFSET")
        round_ones = chosen[some] >= flat.triangle_count
        offsets = np.stack([words[places, 0, layout.columns("INSTANCE")[name]] for name in names], axis=1)
        of_each = np.where(round_ones[None, :], offsets[:, 1:], offsets[:, :1])
        numbers.append(((chosen[some][None, :] + of_each) & 0xFFFFFFFF).ravel())
        scales = (linear[places] * linear[places]).sum(axis=1)
        sizes.append((areas[some][None, :] * scales[:, None]).ravel())
        kinds.append(np.tile(glass[material[chosen[some]]], len(places)))
    if total > _MOST_SURFACES:
        return np.zeros(total, np.int64), np.zeros(0), np.zeros(0, bool)
    return np.concatenate(numbers), np.concatenate(sizes), np.concatenate(kinds)
