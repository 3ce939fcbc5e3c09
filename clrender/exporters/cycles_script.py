"""Builds a scene in Blender; a file for Blender is this, and the description of its scene after it."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import bpy
import mathutils
import numpy as np

__all__ = ["build"]


def image_of(folder: Path, name: str) -> Any:
    """A picture of linear values."""
    image = bpy.data.images.load(str(folder / name), check_existing=True)
    image.colorspace_settings.name, image.alpha_mode = "Non-Color", "NONE"
    return image


def fill(tree: Any, described: dict[str, Any], output: str, folder: Path) -> None:
    """Nodes, each after those that it takes something from, and what the tree gives."""
    tree.nodes.clear()
    made: list[Any] = []

    def socket(given: Sequence[Any]) -> Any:
        return made[given[0]].outputs[given[1]]

    for kind, attributes, inputs in described["nodes"]:
        node = tree.nodes.new(f"ShaderNode{kind}")
        for name, value in attributes.items():
            setattr(node, name, image_of(folder, value) if name == "image" else value)
        for name, value, linked in inputs:
            into = node.inputs[name]
            if linked:
                tree.links.new(socket(value), into)
            else:
                into.default_value = (*value, 1.0) if into.type == "RGBA" else value
        node.location = (220.0 * len(made), 0.0)
        made.append(node)
    end = tree.nodes.new(f"ShaderNodeOutput{output}")
    end.location = (220.0 * len(made), 0.0)
    for name in ("Surface", "Volume"):
        if described.get(name) is not None:
            tree.links.new(socket(described[name]), end.inputs[name])


def material_of(name: str, described: dict[str, Any], folder: Path) -> Any:
    made = bpy.data.materials.new(name)
    made.use_nodes = True
    fill(made.node_tree, described, "Material", folder)
    if described["front_shines"]:
        made.cycles.emission_sampling = "FRONT"
    return made


def mesh_of(name: str, file: str, material: Any, folder: Path) -> Any:
    arrays = np.load(folder / file)
    points, triangles = arrays["points"], arrays["triangles"]
    mesh = bpy.data.meshes.new(name)
    mesh.vertices.add(len(points))
    mesh.vertices.foreach_set("co", points.ravel())
    mesh.loops.add(triangles.size)
    mesh.loops.foreach_set("vertex_index", triangles.ravel())
    mesh.polygons.add(len(triangles))
    mesh.polygons.foreach_set("loop_start", np.arange(0, triangles.size, 3, dtype=np.int32))
    mesh.update(calc_edges=True)
    if "uvs" in arrays:
        mesh.uv_layers.new(name="UVMap").uv.foreach_set("vector", arrays["uvs"].ravel())
    if "normals" in arrays:
        mesh.shade_smooth()
        mesh.normals_split_custom_set(arrays["normals"].reshape(-1, 3).tolist())
    else:
        mesh.shade_flat()
    mesh.materials.append(material)
    return mesh


def place(scene: Any, name: str, data: Any, matrix: Sequence[Sequence[float]]) -> Any:
    made = bpy.data.objects.new(name, data)
    scene.collection.objects.link(made)
    x, y, z, last = matrix
    # Up is +y, and in Blender +z
    made.matrix_world = mathutils.Matrix((x, [-each for each in z], y, last))
    return made


def light_of(described: dict[str, Any]) -> Any:
    light = bpy.data.lights.new(described["name"], described["kind"])
    for name, value in described["values"].items():
        setattr(light, name, value)
    return light


def apply(target: Any, values: dict[str, Any]) -> None:
    """Set attributes; those that another version of Blender lacks stay away."""
    for name, value in values.items():
        at, _, last = name.rpartition(".")
        part = target
        for each in at.split(".") if at else ():
            part = getattr(part, each, None)
        if hasattr(part, last):
            setattr(part, last, value)


def build(described: dict[str, Any], folder: Path) -> Any:
    """Replace what is there by the scene.

    Parameters
    ----------
    described : dict
        As `clrender.exporters.cycles` writes it.
    folder : Path
        Where its meshes and pictures are looked up.
    """
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    scene = bpy.context.scene
    materials = {name: material_of(name, each, folder) for name, each in described["materials"].items()}
    meshes = {
        name: mesh_of(name, file, materials[material], folder) for name, (file, material) in described["meshes"].items()
    }
    for name, mesh, matrix, seen in described["objects"]:
        made = place(scene, name, meshes[mesh], matrix)
        apply(made, seen)
        apply(made, {f"shadow_terminator_{kind}_offset": 0.0 for kind in ("normal", "geometry")})
    for each in described["lights"]:
        place(scene, each["name"], light_of(each), each["matrix"])
    scene.world = bpy.data.worlds.new("world")
    scene.world.use_nodes = True
    scene.world.cycles_visibility.camera = described["world_visible"]
    fill(scene.world.node_tree, described["world"], "World", folder)
    camera = bpy.data.cameras.new("camera")
    apply(camera, described["camera"]["values"])
    scene.camera = place(scene, "camera", camera, described["camera"]["matrix"])
    scene.render.engine = "CYCLES"
    apply(scene, described["settings"])
    return scene


def run(text: str) -> Any:
    """Build the scene that JSON describes, with the files beside this one."""
    return build(json.loads(text), Path(__file__).resolve().parent)
