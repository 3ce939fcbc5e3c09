"""Scenes of one instance alone, for its amodal mask: what it would cover if nothing stood before it."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from clrender.aov import Labelling
from clrender.scene import Scene
from clrender.scene.groups import Instance, ShapeOrInstance
from clrender.scene.materials import Mix
from clrender.scene.shapes import Transform

__all__ = ["alone", "amodal_channels"]


def alone(scene: Scene, labelling: Labelling, number: int) -> Scene:
    """The scene with the shapes of one instance, and no lights.

    Rays of the camera meet these shapes with the very bits that they have in the whole scene: coordinates on devices
    depend on the camera only, and an intersection on the ray and the shape only.

    Parameters
    ----------
    scene : Scene
    labelling : Labelling
        Numbers of the scene's instances.
    number : int
        Of the instance.

    Returns
    -------
    Scene
    """
    shapes = tuple(_placed(scene, entry, turn) for entry, turn in labelling.entries(number))
    groups = {shape.group: scene.groups[shape.group] for shape in shapes if isinstance(shape, Instance)}
    inside = [shape for group in groups.values() for shape in group.shapes]
    names = {shape.material for shape in (*shapes, *inside)} - {None}
    while (
        parts := {
            part for name in names if isinstance(made := scene.materials[str(name)], Mix) for part in made.materials
        }
        - names
    ):
        names |= parts
    materials = {name: made for name, made in scene.materials.items() if name in names}
    return scene.with_checked(shapes=shapes, groups=groups, materials=materials, lights=())


def _placed(scene: Scene, entry: int, turn: int | None) -> ShapeOrInstance:
    """An entry of the scene's list, or one of its transforms."""
    shape = scene.shapes[entry]
    if turn is None or not isinstance(shape, Instance):
        return shape
    rows = scene.transforms(entry).maps[turn].tolist()
    transform = Transform(matrix=(*map(tuple, rows), (0.0, 0.0, 0.0, 1.0)))
    return shape.with_checked(transforms=None, transform=transform)


def amodal_channels(masks: dict[int, npt.NDArray[np.float32]]) -> dict[str, npt.NDArray[np.float32]]:
    """Amodal masks as channels of an EXR file: ``amodal.NUMBER.V``.

    Parameters
    ----------
    masks : dict of int to (H, W) float32

    Returns
    -------
    dict of str to (H, W) float32
    """
    return {f"amodal.{number}.V": np.ascontiguousarray(mask) for number, mask in masks.items()}
