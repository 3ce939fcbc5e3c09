"""Which materials and lights an integrator takes."""

from __future__ import annotations

from clrender.errors import SceneError
from clrender.integrators import INTEGRATORS
from clrender.scene.description import Dielectric, Scene
from clrender.scene.textures import textures_of

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
    taken, volumes = INTEGRATORS[integrator].materials, INTEGRATORS[integrator].volumes
    for index, shape in enumerate(scene.shapes):
        material = scene.materials[shape.material] if shape.material is not None else None
        if isinstance(material, Dielectric) and not volumes:
            for key in ("priority", "attenuation_color"):
                if getattr(material, key) is not None:
                    raise SceneError(
                        f"{scene.source}: shapes[{index}].material: {shape.material!r} has {key}, which the integrator "
                        f"{integrator} does not take; leave it out, or use --integrator path"
                    )
        kind = scene.materials[shape.material].type if shape.material is not None else None
        if taken and kind is not None and kind not in taken:
            raise SceneError(
                f"{scene.source}: shapes[{index}].material: {shape.material!r} is of type {kind}, which the integrator "
                f"{integrator} does not take; give the shape a material of type {' or '.join(taken)}, or use "
                "--integrator path"
            )
        if shape.material is not None and not INTEGRATORS[integrator].textures:
            for key, _ in textures_of(scene.materials[shape.material]):
                raise SceneError(
                    f"{scene.source}: shapes[{index}].material: {shape.material!r} has a texture ({key}), which the "
                    f"integrator {integrator} does not take; give it a constant, or use --integrator path"
                )
