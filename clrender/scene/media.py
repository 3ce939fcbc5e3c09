"""What fills dielectrics and clear principled shapes: media numbered by their priorities, with index and absorption."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from decimal import Decimal
from typing import Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from clrender.errors import SceneError
from clrender.scene.description import Scene
from clrender.scene.materials import Dielectric, Material, Principled
from clrender.scene.values import Vector

__all__ = ["MEDIA_LIMIT", "Media", "absorption_coefficients", "scene_media"]

MEDIA_LIMIT: Final = 255
"""Most media of a scene: a path keeps their numbers in a byte each (``kernels/material/interior.h``)."""

_Medium: TypeAlias = tuple[int | None, float, Vector]
_VACUUM: Final = (1.0, (0.0, 0.0, 0.0))


@dataclass(frozen=True)
class Media:
    """Media of a scene.

    Attributes
    ----------
    rows : (n + 1, 16) float32
        ``MEDIUM_ROW_*`` of ``kernels/types.h``; row 0 is what is in no medium. One row: paths need no account of media.
    of_material : mapping of str to int
        Row of each material that bounds one: a dielectric, or a principled material with transmission; none is thin.
    no_boundary : frozenset of str
        Dielectrics whose shapes change nothing wherever they are, so that they are left out unless they shine.
    """

    rows: NDArray[np.float32]
    of_material: Mapping[str, int]
    no_boundary: frozenset[str]


def scene_media(scene: Scene) -> Media:
    """Number the media of all shapes' materials, the one that wins last.

    Those without a priority come first, then the others by their priorities; of equal ones, the material that stands
    first in the scene wins. Materials that agree in priority, index and absorption are one medium.

    Parameters
    ----------
    scene : Scene

    Raises
    ------
    SceneError
        There are more than `MEDIA_LIMIT`.
    """
    used = {shape.material for shape in scene.shapes}
    shining = {shape.material for shape in scene.shapes if shape.shines}
    media = {
        n: _medium(m)
        for n, m in scene.materials.items()
        if n in used and isinstance(m, Dielectric | Principled) and m.solid
    }
    dark = {name for name in media if _is_matched(scene.materials[name])}
    ranked = _by_priority(media)
    # Of a medium of index 1 that loses to all others nothing is seen.
    while ranked and ranked[0][1:] == _VACUUM and ranked[0] not in [media[n] for n in media if n in shining]:
        dark |= {name for name, medium in media.items() if medium == ranked[0]}
        del ranked[0]
    kept = {name: medium for name, medium in media.items() if name not in dark or name in shining}
    if not any(priority is not None or any(sigma) for priority, _, sigma in kept.values()):
        return Media(np.zeros((1, 16), np.float32), {}, frozenset(dark))
    unranked = list(dict.fromkeys(medium for medium in kept.values() if medium[0] is None))
    numbers = {medium: number for number, medium in enumerate([*unranked, *ranked], 1)}
    if len(numbers) > MEDIA_LIMIT:
        text = f"the dielectrics of its shapes are {len(numbers)} different media, but paths tell {MEDIA_LIMIT} apart"
        raise SceneError(f"{scene.source}: materials: {text}; let more of them agree in index, absorption and priority")
    rows = np.zeros((len(numbers) + 1, 16), np.float32)
    rows[0, 0], rows[0, 4] = 1.0, np.uint32(len(unranked)).view(np.float32)
    for (_, ior, sigma), number in numbers.items():
        rows[number, 0], rows[number, 1:4] = ior, sigma
    return Media(rows, {name: numbers[medium] for name, medium in kept.items()}, frozenset(dark))


def absorption_coefficients(material: Dielectric | Principled) -> Vector:
    """σ = -ln(color) / distance, per metre (Beer's law; glTF, KHR_materials_volume).

    The logarithm is `decimal`'s, which rounds alike on all machines.
    """
    if material.attenuation_color is None or material.attenuation_distance is None:
        return (0.0, 0.0, 0.0)
    distance = Decimal(material.attenuation_distance)
    red, green, blue = (max(0.0, float(-Decimal(share).ln() / distance)) for share in material.attenuation_color)
    return (red, green, blue)


def _medium(material: Dielectric | Principled) -> _Medium:
    priority = material.priority if isinstance(material, Dielectric) else None
    return (priority, material.ior, absorption_coefficients(material))


def _by_priority(media: Mapping[str, _Medium]) -> list[_Medium]:
    """Media with a priority, each once; the one that wins is last."""
    places: dict[_Medium, int] = {}
    for place, medium in enumerate(media.values()):
        places.setdefault(medium, place)
    ranked = [(medium[0], -place, medium) for medium, place in places.items() if medium[0] is not None]
    return [medium for _, _, medium in sorted(ranked)]


def _is_matched(material: Material) -> bool:
    """Whether it is the same on both sides of its shapes, and its surface is nothing but a boundary."""
    if not isinstance(material, Dielectric):
        return False
    same = material.priority is None and material.ior == material.exterior_ior
    return same and not any(absorption_coefficients(material))
