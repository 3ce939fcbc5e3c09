"""Which materials an integrator takes."""

from __future__ import annotations

from clrender.errors import SceneError
from clrender.integrators import INTEGRATORS
from clrender.scene.description import Scene
from clrender.scene.material_rows import has_row
from clrender.scene.materials import Dielectric

__all__ = ["check_materials"]


def check_materials(scene: Scene, integrator: str) -> None:
    """Make sure that an integrator takes the materials of all shapes.

    Parameters
    ----------
    scene : Scene
    integrator : str
        Name.

    Raises
    ------
    SceneError
        It names the first shape that it does not take, and what to do.
    """
    taken = INTEGRATORS[integrator].materials
    for index, shape in enumerate(scene.shapes):
        if not taken or shape.material is None:
            continue
        material = scene.materials[shape.material]
        of = f"of type {material.type}"
        if material.type in taken and has_row(material):
            rough = isinstance(material, Dielectric) and material.rough
            of += " with roughness" if rough else " and thin" if isinstance(material, Dielectric) else ", not two_sided"
        elif material.type in taken:
            continue
        raise SceneError(
            f"{scene.source}: shapes[{index}].material: {shape.material!r} is {of}, which the integrator "
            f"{integrator} does not take; give the shape a {'smooth ' if 'dielectric' in taken else ''}material "
            f"of type {' or '.join(taken)}, or use --integrator path"
        )
