"""Writes a scene of Blender as a scene file of clrender."""

from __future__ import annotations

import contextlib
import io
import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import bmesh
import bpy
import numpy as np

from .cameras import camera_table
from .lights import light_tables
from .program import run
from .reading import camera_of, light_of, world_of
from .scene_files import Placed, SceneParts, assembled
from .worlds import world_table

__all__ = ["ExportError", "exported"]

_SURFACES: Final = ("MESH", "CURVE", "SURFACE", "FONT", "META")
_UNSEEN: Final = {
    "CURVES": "hair curves",
    "POINTCLOUD": "point clouds",
    "VOLUME": "volumes",
    "GREASEPENCIL": "Grease Pencil",
    "GPENCIL": "Grease Pencil",
    "LATTICE": "",
    "EMPTY": "",
}
"""What is left out of objects by their types; those without a name are not rendered by Blender either."""
_READ_NODES: Final = ("ShaderNodeBsdfPrincipled", "ShaderNodeEmission", "ShaderNodeEeveeSpecular")
_BEHIND: Final = 1e-4
"""Distance of a back side from its front, relative to the size of the mesh."""
_BARE: Final = 0.8
"""Reflectance of a surface without a material."""
_TOLD_OF_MODELS: Final = (
    *("there is no camera", "there is no light"),  # the scene has its own
    "double-sided materials shine",  # whose back sides are added here
)
"""Beginnings of notes about the glTF file that are not true of the scene."""


class ExportError(Exception):
    """The scene cannot be rendered; the message says why."""


@dataclass
class _Collected:
    """Objects of a scene of their own, which is exported, and what the file cannot say of them.

    The sheets are names of meshes with open edges.
    """

    parts: SceneParts
    scene: Any
    meshes: dict[Any, Any] = field(default_factory=dict)
    sheets: set[str] = field(default_factory=set)
    bare: Any = None
    notes: list[str] = field(default_factory=list)

    def bare_material(self) -> Any:
        """What Cycles gives to a surface without a material; a glTF file would give it a metal."""
        if self.bare is None:
            self.bare = bpy.data.materials.new("without a material")
            self.bare.use_nodes = True
            inputs = next(n for n in self.bare.node_tree.nodes if n.bl_idname == "ShaderNodeBsdfPrincipled").inputs
            inputs["Base Color"].default_value = (*[_BARE] * 3, 1.0)
            inputs["Roughness"].default_value, inputs["Specular IOR Level"].default_value = 1.0, 0.0
        return self.bare

    def note(self, text: str) -> None:
        """Each once."""
        if text not in self.notes:
            self.notes.append(text)


def exported(
    depsgraph: Any, folder: Path, program: Sequence[str], stopped: Callable[[], bool] = lambda: False
) -> tuple[Path, list[str]]:
    """The scene file, and notes of what was left out.

    Parameters
    ----------
    depsgraph : bpy.types.Depsgraph
        Evaluated for the frame.
    folder : Path
        Where it is written, with its meshes and pictures.
    program : sequence of str
        The command that starts clrender, which reads the glTF file.
    stopped : callable
        Asked while clrender reads.

    Raises
    ------
    ExportError
    """
    scene = depsgraph.scene
    if scene.camera is None:
        raise ExportError("the scene has no camera; add one, and make it the scene's camera")
    camera = camera_of(scene.camera.evaluated_get(depsgraph), scene)
    table, notes = camera_table(camera)
    parts = SceneParts(table, camera.width, camera.height)
    world, told = world_of(scene.world, folder)
    notes += told
    parts.environment, told = world_table(world)
    notes += told
    collected = _Collected(parts, bpy.data.scenes.new("clrender export"), notes=notes)
    try:
        whole = {each.object.original.name_full for each in depsgraph.object_instances if _is_own_geometry(each)}
        for instance in depsgraph.object_instances:
            # Texts and curves are in the graph once more, as the mesh that they make
            if instance.is_instance or instance.object.type == "MESH" or instance.object.name_full not in whole:
                _take(instance, depsgraph, collected)
        converted = _converted(collected, folder, program, stopped) if collected.meshes else {}
    finally:
        _forget(collected)
    path = folder / "scene.json"
    path.write_text(json.dumps(assembled(converted, parts), indent=1), encoding="utf-8")
    return path, collected.notes


def _is_own_geometry(instance: Any) -> bool:
    """Whether it is a mesh that an object itself makes, such as a text, or with geometry nodes."""
    if not instance.is_instance or instance.object.type != "MESH" or instance.parent is None:
        return False
    return bool(instance.object.original == instance.parent.original)


def _take(instance: Any, depsgraph: Any, collected: _Collected) -> None:
    """Take an object, or a copy of one that an instancer makes."""
    placed = instance.object
    # Outside of renders, the graph also has what is in the viewport only
    if not instance.show_self or placed.original.hide_render:
        return
    if placed.type == "LIGHT":
        light = light_of(placed, placed.original.name, instance.matrix_world)
        lights, shapes, notes = light_tables(light)
        collected.parts.lights += lights
        collected.parts.shapes += shapes
        for note in notes:
            collected.note(note)
    elif placed.type in _SURFACES:
        _take_mesh(instance, depsgraph, collected)
    elif _UNSEEN.get(placed.type):
        collected.note(f"{_UNSEEN[placed.type]} were left out: {placed.original.name}")


def _take_mesh(instance: Any, depsgraph: Any, collected: _Collected) -> None:
    placed, own = instance.object, _is_own_geometry(instance)
    slots = placed.data.materials if own else [slot.material for slot in placed.material_slots]
    materials = [each.original if each is not None else None for each in slots]
    key = (placed.data.as_pointer(), tuple(each.name_full if each else "" for each in materials))
    if key not in collected.meshes:
        made = _copied(placed.data) if own else _applied(placed, depsgraph)
        collected.meshes[key] = _finished(made, materials, collected)
    mesh = collected.meshes[key]
    if mesh is None:
        return
    if any(system.settings.type == "HAIR" for system in getattr(placed, "particle_systems", ())):
        collected.note(f"hair of particles was left out: {placed.original.name}")
    if getattr(placed, "is_holdout", False):
        collected.note(f"that {placed.original.name} is a holdout was left out")
    # Not the object's own name, to which Blender would append a number
    made = bpy.data.objects.new(f"clrender {len(collected.parts.objects)}", mesh)
    made.matrix_world = instance.matrix_world.copy()
    collected.scene.collection.objects.link(made)
    catcher = bool(getattr(placed, "is_shadow_catcher", False))
    is_open = mesh.name in collected.sheets
    collected.parts.objects[made.name] = Placed(placed.original.name, bool(placed.visible_camera), catcher, is_open)


def _applied(placed: Any, depsgraph: Any) -> Any:
    """A mesh of what an object looks like with its modifiers."""
    return bpy.data.meshes.new_from_object(placed, preserve_all_data_layers=True, depsgraph=depsgraph)


def _copied(mesh: Any) -> Any:
    """A mesh of its own of one that is in the graph only."""
    made, edited = bpy.data.meshes.new("instance"), bmesh.new()
    edited.from_mesh(mesh)
    edited.to_mesh(made)
    edited.free()
    return made


def _finished(mesh: Any, materials: Sequence[Any], collected: _Collected) -> Any:
    """The mesh with materials; None without faces."""
    if not mesh.polygons:
        bpy.data.meshes.remove(mesh)
        return None
    materials = [each or collected.bare_material() for each in materials or [None]]
    for index, material in enumerate(materials):  # those of the object take precedence over those of the mesh
        if index < len(mesh.materials):
            mesh.materials[index] = material
        else:
            mesh.materials.append(material)
    used = {each.name: each for each in materials}
    for name, material in used.items():
        _tell_of_nodes(name, material, collected)
    if not _is_closed(mesh):
        collected.sheets.add(mesh.name)
        _shine_from_behind(mesh)
    return mesh


def _is_closed(mesh: Any) -> bool:
    """Whether each edge has a face at both sides."""
    edges = np.empty(len(mesh.loops), np.int32)
    mesh.loops.foreach_get("edge_index", edges)
    return bool((np.bincount(edges, minlength=len(mesh.edges)) == 2).all())


def _shine_from_behind(mesh: Any) -> None:
    """Give faces that shine a back side, which shines too, as in Cycles; closely behind them."""
    shining = {index for index, each in enumerate(mesh.materials) if each is not None and _shines(each)}
    if not shining:
        return
    edited = bmesh.new()
    edited.from_mesh(mesh)
    edited.normal_update()
    faces = [face for face in edited.faces if face.material_index in shining]
    if faces:
        size = max(max(axis) - min(axis) for axis in zip(*(vertex.co for vertex in edited.verts), strict=True))
        around = {part for face in faces for part in (*face.verts, *face.edges)}
        made = bmesh.ops.duplicate(edited, geom=[*faces, *around])["geom"]
        for vertex in [each for each in made if isinstance(each, bmesh.types.BMVert)]:
            vertex.co -= _BEHIND * size * vertex.normal
        bmesh.ops.reverse_faces(edited, faces=[each for each in made if isinstance(each, bmesh.types.BMFace)])
        edited.to_mesh(mesh)
    edited.free()


def _shines(material: Any) -> bool:
    """Whether a material may emit light."""
    for node in material.node_tree.nodes if material.node_tree is not None else ():
        if node.bl_idname not in ("ShaderNodeBsdfPrincipled", "ShaderNodeEmission"):
            continue
        own = node.bl_idname == "ShaderNodeEmission"
        strength = node.inputs["Strength" if own else "Emission Strength"]
        color = node.inputs["Color" if own else "Emission Color"]
        bright = strength.is_linked or strength.default_value > 0.0
        if bright and (color.is_linked or any(share > 0.0 for share in tuple(color.default_value)[:3])):
            return True
    return False


def _tell_of_nodes(name: str, material: Any, collected: _Collected) -> None:
    tree = material.node_tree
    if tree is None:
        return
    ends = [node for node in tree.nodes if node.bl_idname == "ShaderNodeOutputMaterial" and node.is_active_output]
    for end in ends:
        for link in end.inputs["Surface"].links:
            if link.from_node.bl_idname not in _READ_NODES:
                kind = link.from_node.bl_label
                collected.note(f"material {name}: its {kind} may be lost; of shaders glTF has the Principled BSDF")
        if end.inputs["Volume"].is_linked:
            collected.note(f"material {name}: its volume was left out")
        if end.inputs["Displacement"].is_linked:
            collected.note(f"material {name}: its displacement was left out")


def _converted(
    collected: _Collected, folder: Path, program: Sequence[str], stopped: Callable[[], bool]
) -> dict[str, Any]:
    """Meshes and materials by Blender's exporter of glTF, as clrender reads them."""
    model, scene = folder / "model.glb", folder / "meshes.json"
    layer = collected.scene.view_layers[0]
    said = io.StringIO()
    with bpy.context.temp_override(scene=collected.scene, view_layer=layer), contextlib.redirect_stdout(said):
        result = bpy.ops.export_scene.gltf(
            filepath=str(model),
            export_format="GLB",
            use_active_scene=True,
            export_apply=False,  # modifiers are applied already
            export_yup=True,
            export_animations=False,
            export_morph=False,
            export_skins=False,
            export_cameras=False,
            export_lights=False,
        )
    if "FINISHED" not in result or not model.is_file():
        raise ExportError(f"Blender's exporter of glTF wrote no file: {said.getvalue().strip()[-300:]}")
    finished = run([*program, "convert", str(model), str(scene), "--force"], stopped)
    if finished.error:
        raise ExportError(finished.error)
    if finished.code:
        raise ExportError("interrupted")
    for message in finished.messages:
        text = message.removeprefix("note:").strip().removeprefix(f"{model}: ").removeprefix("model.glb: ")
        if not text.startswith(_TOLD_OF_MODELS):
            collected.note(text)
    made: dict[str, Any] = json.loads(scene.read_text(encoding="utf-8"))
    scene.unlink()
    return made


def _forget(collected: _Collected) -> None:
    """Remove the scene that was made for the export."""
    for placed in list(collected.scene.collection.objects):
        bpy.data.objects.remove(placed)
    for mesh in collected.meshes.values():
        if mesh is not None:
            bpy.data.meshes.remove(mesh)
    if collected.bare is not None:
        bpy.data.materials.remove(collected.bare)
    bpy.data.scenes.remove(collected.scene)
