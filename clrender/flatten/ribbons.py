"""Ribbons of a scene become meshes, as which they are rendered."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

from clrender.flatten.tubes import curve_mesh
from clrender.scene.shapes import AnyShape, Curves, Mesh, Surface
from clrender.wording import place

if TYPE_CHECKING:
    from clrender.meshes.data import MeshData
    from clrender.scene.description import Scene
    from clrender.scene.groups import Group, ShapeOrInstance

__all__ = ["with_ribbons_as_meshes"]

_STEPS: Final = 8
"""Pairs of triangles of a curve of a ribbon."""


def with_ribbons_as_meshes(scene: Scene) -> Scene:
    """The scene with a mesh in the place of each shape of ribbons.

    Parameters
    ----------
    scene : Scene

    Raises
    ------
    SceneError
        A file cannot be read, or a strand has a wrong number of control points.
    """
    flat = [(at, shape) for at, shape in scene.all_shapes() if isinstance(shape, Curves) and shape.profile == "ribbon"]
    if not flat:
        return scene
    shapes, groups, meshes = scene.of_contents("ribbons", lambda: _replaced(scene, flat))
    return scene.with_checked(shapes=shapes, groups=groups).with_files(meshes=meshes)


def _replaced(
    scene: Scene, flat: list[tuple[tuple[str | int, ...], Curves]]
) -> tuple[tuple[ShapeOrInstance, ...], dict[str, Group], dict[str, MeshData]]:
    """Shapes, groups, and the meshes that they name."""
    meshes: dict[str, MeshData] = {}
    made: dict[tuple[str | int, ...], AnyShape] = {}
    for at, shape in flat:
        where = place(at)
        name = f"ribbons of {where}"
        meshes[name] = curve_mesh(shape, scene.strands(at, shape), f"{scene.source}: {where}", _STEPS)
        given = shape.model_fields_set & Surface.model_fields.keys()
        keys: dict[str, Any] = {key: getattr(shape, key) for key in given}
        made[at] = Mesh.model_validate({**keys, "type": "mesh", "file": name})
    shapes = tuple(made.get(("shapes", index), shape) for index, shape in enumerate(scene.shapes))
    groups = {
        name: group.with_checked(
            shapes=tuple(made.get(("groups", name, "shapes", i), shape) for i, shape in enumerate(group.shapes))
        )
        for name, group in scene.groups.items()
    }
    return shapes, groups, meshes
