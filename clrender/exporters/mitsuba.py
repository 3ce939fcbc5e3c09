"""A scene as Mitsuba 3's XML, with its meshes and pictures beside it."""

from __future__ import annotations

from pathlib import Path
from typing import Final
from xml.etree import ElementTree

import numpy as np

from clrender.exporters.mitsuba_camera import integrator, sensor
from clrender.exporters.mitsuba_lights import LightWriter
from clrender.exporters.mitsuba_materials import MaterialWriter
from clrender.exporters.mitsuba_media import MediumWriter
from clrender.exporters.mitsuba_shapes import ShapeWriter
from clrender.exporters.mitsuba_textures import TextureWriter
from clrender.exporters.mitsuba_xml import NO_ID, element
from clrender.exporters.target import ForeignExport, Target, write_foreign
from clrender.scene import Scene

__all__ = ["MitsubaExport", "exported_to_mitsuba", "write_mitsuba"]

_VERSION: Final = "3.0.0"


class MitsubaExport(ForeignExport):
    """A scene as Mitsuba's XML, and its files."""

    program = "Mitsuba"


def exported_to_mitsuba(scene: Scene, folder: str, merge: bool = False) -> MitsubaExport:
    """A scene for Mitsuba 3, with its meshes and pictures as files in a folder.

    Parameters
    ----------
    scene : Scene
    folder : str
        Relative to the XML file that will be written.
    merge : bool
        Whether quads, triangles, boxes and tetrahedra of the same surface become one mesh, as programs for modelling
        write them.

    Returns
    -------
    MitsubaExport
        `clrender.load` reads the scene from it again, but for what its notes say.

    Raises
    ------
    SceneError
        Mitsuba has no such camera, or a file cannot be read.
    """
    target = Target(scene, folder, NO_ID)
    scene = target.scene
    textures = TextureWriter(target)
    materials, media = MaterialWriter(target, textures), MediumWriter(target)
    shapes = ShapeWriter(target, textures, materials, media, merge).shapes()
    lights = LightWriter(target, textures).lights()
    inside = media.around(np.array([scene.camera.position]), None, lambda: None)[0]
    camera = sensor(target, inside)
    masked = any(each.masked for each in scene.materials.values())
    through = bool(media.written) or masked or any(each.interior is not None for _, each in scene.all_shapes())
    parts = [integrator(target, through), *media.written, camera, *materials.written, *shapes, *lights]
    whole = element("scene", *parts, version=_VERSION)
    ElementTree.indent(whole)
    text = ElementTree.tostring(whole, encoding="utf-8", xml_declaration=True) + b"\n"
    return MitsubaExport(target.files.files, text=text, notes=target.notes())


def write_mitsuba(scene: Scene, output: str | Path, strict: bool = False, merge: bool = False) -> tuple[str, ...]:
    """Write a scene for Mitsuba 3.

    Parameters
    ----------
    scene : Scene
    output : str or pathlib.Path
        The XML file; meshes and pictures are written to the folder ``NAME-files`` beside it.
    strict : bool
        Refuse a scene of which something would be left out.
    merge : bool
        See `exported_to_mitsuba`.

    Returns
    -------
    tuple of str
        What Mitsuba cannot express, a sentence each.

    Raises
    ------
    SceneError
        Like `exported_to_mitsuba`; or something would be left out, if `strict`.
    UsageError
        A file cannot be written.
    """
    return write_foreign(exported_to_mitsuba, scene, output, strict, merge)
