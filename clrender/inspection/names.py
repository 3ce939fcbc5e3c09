"""Names of what paths met: shapes, materials and lights of a scene, by the numbers that kernels use."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from clrender import layout
from clrender.aov import matte_names
from clrender.flatten.assembly import assemble

if TYPE_CHECKING:
    from clrender.flatten.flat_scene import FlatScene
    from clrender.scene import Scene

__all__ = ["LIGHT_KINDS", "Names"]

LIGHT_KINDS: Final = {
    layout.LIGHT_POINT: "point",
    layout.LIGHT_DIRECTIONAL: "directional",
    layout.LIGHT_AREA_TRIANGLE: "triangle",
    layout.LIGHT_AREA_SPHERE: "sphere",
    layout.LIGHT_AREA_DISK: "disk",
    layout.LIGHT_ENVIRONMENT: "environment",
    layout.LIGHT_SPOT: "spot",
    layout.LIGHT_IES: "ies",
    layout.LIGHT_SUN: "sun",
    layout.LIGHT_PROJECTOR: "projector",
    layout.LIGHT_PLUGIN: "plugin",
}


class Names:
    """Names of primitives and lights.

    Parameters
    ----------
    scene : Scene
    flat : FlatScene
        Its arrays.
    """

    def __init__(self, scene: Scene, flat: FlatScene) -> None:
        self._scene, self._flat = scene, flat
        assembly, names = assemble(scene), matte_names(scene)
        self._places = assembly.seen_place.tolist()
        self._objects, self._materials = names["crypto_object"], names["crypto_material"]

    def _seen(self, primitive: int) -> int:
        shapes = self._flat.arrays["primitive_shape"]
        return int(self._flat.instances.seen(np.array([primitive], np.int64), shapes)[0])

    def of_primitive(self, primitive: int) -> tuple[int, str | None, str | None, str | None]:
        """Index and name of the shape that has a primitive, and name and type of its material."""
        seen = self._seen(primitive)
        material = self._materials[seen]
        kind = None if material is None else self._scene.materials[material].type
        return self._places[seen], self._objects[seen], material, kind

    def of_light(self, light: int, kind: int) -> tuple[str, str | None, str | None]:
        """Kind of a light, name of the shape that it is, and its light group."""
        primitive = int(self._flat.arrays["lights"]["primitive"][light])
        is_shape = kind in (layout.LIGHT_AREA_TRIANGLE, layout.LIGHT_AREA_SPHERE, layout.LIGHT_AREA_DISK)
        groups = self._flat.light_groups
        group = groups[light] if light < len(groups) and groups[light] else None
        return LIGHT_KINDS[kind], self._objects[self._seen(primitive)] if is_shape else None, group
