"""A scene as LuxCore's properties, with its meshes and pictures beside it.

One file holds the properties of the scene, for ``Scene.Parse`` of pyluxcore, and settings, for its ``RenderConfig``.
Paths of meshes and pictures are relative to it, and LuxCore looks them up in its working directory.
"""

from __future__ import annotations

from pathlib import Path

from clrender.exporters.luxcore_camera import camera_properties, settings
from clrender.exporters.luxcore_lights import LightWriter
from clrender.exporters.luxcore_materials import MaterialWriter
from clrender.exporters.luxcore_shapes import ShapeWriter
from clrender.exporters.luxcore_text import NO_ID, Properties, property_text
from clrender.exporters.luxcore_textures import TextureWriter
from clrender.exporters.surfaces import inside_named, tell_of_glow
from clrender.exporters.target import ForeignExport, Target, write_foreign
from clrender.scene import Scene

__all__ = ["LuxCoreExport", "exported_to_luxcore", "write_luxcore"]


class LuxCoreExport(ForeignExport):
    """A scene as LuxCore's properties, and its files."""

    program = "LuxCore"


def exported_to_luxcore(scene: Scene, folder: str, merge: bool = False) -> LuxCoreExport:
    """A scene for LuxCore, with its meshes and pictures as files in a folder.

    Parameters
    ----------
    scene : Scene
    folder : str
        Relative to the file that will be written.
    merge : bool
        Whether quads, triangles, boxes and tetrahedra of the same surface become one mesh, as programs for modelling
        write them.

    Returns
    -------
    LuxCoreExport

    Raises
    ------
    SceneError
        LuxCore has no such camera, or a file cannot be read.
    """
    target = Target(scene, folder, NO_ID, "-")
    scene = target.scene
    properties: Properties = {}
    textures = TextureWriter(target, properties)
    materials = MaterialWriter(target, properties, textures)
    if scene.fog is not None:
        inside = inside_named(scene, scene.fog)
        tell_of_glow(target, inside)
        properties["scene.world.volume.default"] = materials.volume(None, inside)
    ShapeWriter(target, properties, materials, merge).write()
    LightWriter(target, properties, textures).write()
    whole = settings(target) | camera_properties(target) | properties
    return LuxCoreExport(target.files.files, text=property_text(whole), notes=target.notes())


def write_luxcore(scene: Scene, output: str | Path, strict: bool = False, merge: bool = False) -> tuple[str, ...]:
    """Write a scene for LuxCore.

    Parameters
    ----------
    scene : Scene
    output : str or pathlib.Path
        The file, usually ``.scn``; meshes and pictures are written to the folder ``NAME-files`` beside it.
    strict : bool
        Refuse a scene of which something would be left out.
    merge : bool
        See `exported_to_luxcore`.

    Returns
    -------
    tuple of str
        What LuxCore cannot express, a sentence each.

    Raises
    ------
    SceneError
        Like `exported_to_luxcore`; or something would be left out, if `strict`.
    UsageError
        A file cannot be written.
    """
    return write_foreign(exported_to_luxcore, scene, output, strict, merge)
