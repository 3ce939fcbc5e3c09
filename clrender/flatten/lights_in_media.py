"""Refuses lights inside dielectrics, for integrators whose paths do not know what is around the light they start at."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from clrender import layout
from clrender.errors import SceneError
from clrender.flatten.interiors import light_inside
from clrender.flatten.lamps import POINT_KINDS, lamp_tables
from clrender.flatten.lights import points_that_shine

if TYPE_CHECKING:
    from clrender.flatten.flat_scene import FlatScene
    from clrender.scene import Scene

__all__ = ["refuse_lights_in_media"]

_LIGHT_INSIDE: Final = (
    "{}: shines from inside of a dielectric with priority or attenuation, where the integrator {} does not know "
    "what its light starts in; move it out, or use --integrator path"
)


def refuse_lights_in_media(scene: Scene, flat: FlatScene, integrator: str) -> None:
    """Refuse a scene with such a light.

    Raises
    ------
    SceneError
        Which light it is.
    """
    if (light := light_inside(flat.arrays, flat.triangle_count, flat.light_count, flat.instances)) is not None:
        place = _light_place(flat, scene, light)
        raise SceneError(f"{scene.source}: {_LIGHT_INSIDE.format(place, integrator)}")


def _light_place(flat: FlatScene, scene: Scene, light: int) -> str:
    """Location in the scene file of a light of the arrays."""
    lights = flat.arrays["lights"]
    if lights[light]["primitive"] != layout.NONE:
        return f"shapes[{flat.instances.own_places[flat.arrays['primitive_shape'][lights[light]['primitive']]]}]"
    at_point = np.isin(lights["kind"][:light], POINT_KINDS)
    return f"lights[{points_that_shine(scene, lamp_tables(scene))[int(at_point.sum())]}]"
