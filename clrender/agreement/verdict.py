"""Decides whether a difference between two integrators on a scene is expected, or a fault."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

from clrender.integrators import (
    BETWEEN_DIFFUSE,
    CAUSTICS,
    DELTA_CAUSTICS,
    ENVIRONMENT_ON_DIFFUSE,
    INTEGRATORS,
    SOFT_SHADOWS,
)

if TYPE_CHECKING:
    from clrender.scene import Scene

__all__ = ["AGREE", "FAULT", "MAY", "MUST", "Verdict", "light_kinds", "verdict"]

AGREE: Final = "agree"
MUST: Final = "differ as they must"
MAY: Final = "differ as they may"
FAULT: Final = "differ where they should agree"

_FLAT: Final = ("quad", "triangle", "disk")
_MATT: Final = ("", "lambert", "oren_nayar")
_LIGHTS_WITH_EXTENT: Final = ("environment", "sun_sky")


@dataclass(frozen=True)
class Verdict:
    """Whether two integrators agree, and if not, whether they should.

    Attributes
    ----------
    kind : str
        `AGREE`, `MUST` (one omits light that the scene has), `MAY` (one is not unbiased) or `FAULT`.
    reason : str
        Why; for `AGREE`, what one omits without a visible difference. May be empty.
    """

    kind: str
    reason: str


def verdict(
    first: str, second: str, scene: Scene, darker: bool, brighter: bool, specular_chains: bool = False
) -> Verdict:
    """Judge two integrators by where they differ significantly.

    Omitted light can only darken, except for soft shadows: a light sampled at its centre alone also moves its light.

    Parameters
    ----------
    first, second : str
        Keys of `clrender.integrators.INTEGRATORS`.
    scene : Scene
    darker, brighter : bool
        Whether the first is somewhere darker than the second; whether it is somewhere brighter.
    specular_chains : bool
        Whether integrators that can sample light over specular chains do so.
    """
    missing = _missing(first, second, scene, specular_chains)
    others = _missing(second, first, scene, specular_chains)
    reasons = [f"{name} has no {_listed(out)}" for name, out in ((first, missing), (second, others)) if out]
    moved = SOFT_SHADOWS in (*missing, *others)
    inexact = [f"{n} is {INTEGRATORS[n].bias}, not unbiased" for n in (first, second) if _biased(n)]
    if not (darker or brighter):
        return Verdict(AGREE, "; ".join(f"{each}, which does not show here" for each in reasons))
    unexplained = (darker and not (missing or moved)) or (brighter and not (others or moved))
    if not unexplained:
        return Verdict(MUST, "; ".join(reasons))
    if inexact:
        return Verdict(MAY, "; ".join((*reasons, *dict.fromkeys(inexact))))
    if not reasons:
        return Verdict(FAULT, "neither omits any light that the other finds here")
    wrong = first if not missing else second
    right = second if wrong == first else first
    return Verdict(FAULT, f"{'; '.join(reasons)}, but then {wrong} cannot be darker than {right} anywhere")


def light_kinds(scene: Scene) -> frozenset[str]:
    """Kinds of light, among those that integrators omit, that this scene may have; in doubt, a kind is included."""
    shapes = [shape for _, shape in scene.all_shapes()]
    types = [scene.materials[shape.material].type if shape.material else "" for shape in shapes]
    diffuse = [
        shape
        for shape, kind in zip(shapes, types, strict=True)
        if shape.material and kind not in ("mirror", "dielectric") and not _black(scene, shape.material)
    ]
    kinds = set()
    scatters = any(medium.scatters for medium in scene.media.values())
    if len(diffuse) > 1 or scatters or any(scene.instances()) or any(shape.type not in _FLAT for shape in diffuse):
        kinds.add(BETWEEN_DIFFUSE)
    if diffuse and any(kind not in _MATT for kind in types):
        kinds.add(CAUSTICS)
        if any(light.type not in _LIGHTS_WITH_EXTENT for light in scene.lights):
            kinds.add(DELTA_CAUSTICS)
    if diffuse and any(shape.shines for shape in shapes):
        kinds.add(SOFT_SHADOWS)
    if diffuse and (around := scene.environment) and (around.file is not None or max(around.constant) > 0.0):
        kinds.add(ENVIRONMENT_ON_DIFFUSE)
    if diffuse and scene.sky is not None:
        kinds.update((ENVIRONMENT_ON_DIFFUSE, SOFT_SHADOWS))
    return frozenset(kinds)


def _black(scene: Scene, material: str) -> bool:
    reflectance = getattr(scene.materials[material], "reflectance", None)
    return isinstance(reflectance, tuple) and max(reflectance) == 0.0


def _missing(name: str, other: str, scene: Scene, specular_chains: bool) -> list[str]:
    """Light of this scene that `name` omits and `other` does not; kinds that are unknown here count as present."""
    judged = {BETWEEN_DIFFUSE, CAUSTICS, DELTA_CAUSTICS, SOFT_SHADOWS, ENVIRONMENT_ON_DIFFUSE}
    has = light_kinds(scene)
    out = [kind for kind in INTEGRATORS[name].leaves_out if kind in has or kind not in judged]
    # Specular chains find some of such caustics, and not those of longer chains
    found = {DELTA_CAUSTICS} if specular_chains and INTEGRATORS[other].specular_chains else set()
    return [kind for kind in out if kind in found or kind not in INTEGRATORS[other].leaves_out]


def _biased(name: str) -> bool:
    return INTEGRATORS[name].bias != "unbiased"


def _listed(kinds: Iterable[str]) -> str:
    *most, last = kinds
    return f"{', '.join(most)} or {last}" if most else last
