"""Which materials and lights an integrator takes."""

from __future__ import annotations

from clrender.errors import SceneError
from clrender.integrators import INTEGRATORS
from clrender.scene.description import Scene

__all__ = ["check_materials"]


def check_materials(scene: Scene, integrator: str) -> None:
    """Make sure that an integrator takes the materials of all shapes, and the environment.

    Parameters
    ----------
    scene : Scene
    integrator : str
        Name.

    Raises
    ------
    SceneError
        It names the first shape or light that it does not take, and what to do.
    """
    light = scene.environment
    if light is not None and light.file is not None and not INTEGRATORS[integrator].environment_pictures:
        raise SceneError(
            f"{scene.source}: lights[{scene.lights.index(light)}].file: the integrator {integrator} takes no picture "
            "of the environment; give its radiance instead, or use --integrator path"
        )
    taken = INTEGRATORS[integrator].materials
    for index, shape in enumerate(scene.shapes):
        kind = scene.materials[shape.material].type if shape.material is not None else None
        if taken and kind is not None and kind not in taken:
            raise SceneError(
                f"{scene.source}: shapes[{index}].material: {shape.material!r} is of type {kind}, which the integrator "
                f"{integrator} does not take; give the shape a material of type {' or '.join(taken)}, or use "
                "--integrator path"
            )
