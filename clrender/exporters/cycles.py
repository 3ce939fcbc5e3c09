"""A scene as a Python program that builds it in Blender, for Cycles, with its meshes and pictures beside it."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Final

from clrender.exporters.cycles_camera import camera, settings
from clrender.exporters.cycles_lights import LightWriter
from clrender.exporters.cycles_materials import MaterialWriter
from clrender.exporters.cycles_nodes import NO_ID
from clrender.exporters.cycles_shapes import ShapeWriter
from clrender.exporters.cycles_textures import TextureWriter
from clrender.exporters.target import ForeignExport, Target, write_foreign
from clrender.scene import EnvironmentLight, Scene, SunSkyLight

__all__ = ["CyclesExport", "exported_to_cycles", "write_cycles"]

_BUILDER: Final = Path(__file__).with_name("cycles_script.py")


class CyclesExport(ForeignExport):
    """A scene as a program for Blender, and its files."""

    program = "Cycles"


def exported_to_cycles(scene: Scene, folder: str, merge: bool = False) -> CyclesExport:
    """A scene for Cycles, with its meshes and pictures as files in a folder.

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
    CyclesExport

    Raises
    ------
    SceneError
        Cycles has no such camera, or a file cannot be read.
    """
    target = Target(scene, folder, NO_ID, ".", apart=True)
    scene = target.scene
    textures = TextureWriter(target)
    materials, lights = MaterialWriter(target, textures), LightWriter(target, textures)
    shapes = ShapeWriter(target, materials, merge)
    shapes.write()
    around = [each for each in scene.lights if isinstance(each, EnvironmentLight | SunSkyLight)]
    described = {
        "world": lights.write(),
        "world_visible": all(each.visible_to_camera for each in around),
        "materials": materials.written,
        "meshes": shapes.meshes,
        "objects": shapes.objects,
        "lights": lights.written,
        "camera": camera(target),
        "settings": settings(target),
    }
    text = f"{_BUILDER.read_text(encoding='utf-8')}\nrun({json.dumps(described)!r})\n"
    return CyclesExport(target.files.files, text=text.encode("utf-8"), notes=target.notes())


def write_cycles(scene: Scene, output: str | Path, strict: bool = False, merge: bool = False) -> tuple[str, ...]:
    """Write a scene for Cycles.

    Parameters
    ----------
    scene : Scene
    output : str or pathlib.Path
        The file, usually ``.py``, to be run in Blender; meshes and pictures are written to the folder ``NAME-files``
        beside it.
    strict : bool
        Refuse a scene of which something would be left out.
    merge : bool
        See `exported_to_cycles`.

    Returns
    -------
    tuple of str
        What Cycles cannot express, a sentence each.

    Raises
    ------
    SceneError
        Like `exported_to_cycles`; or something would be left out, if `strict`.
    UsageError
        A file cannot be written.
    """
    return write_foreign(exported_to_cycles, scene, output, strict, merge)
