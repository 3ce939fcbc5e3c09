"""Reads cameras, lights and worlds of Blender into plain values."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any, Final

import bpy
import numpy as np

from .cameras import BlenderCamera
from .lights import BlenderLight
from .worlds import BlenderWorld, linear, pfm_bytes

__all__ = ["camera_of", "image_size", "light_of", "rows", "world_of"]

_COPIED: Final = (".exr", ".hdr")
_LINEAR: Final = ("Linear Rec.709", "Linear", "Non-Color", "Raw")


def rows(matrix: Any) -> tuple[tuple[float, ...], ...]:
    """A matrix of Blender as numbers."""
    return tuple(tuple(float(x) for x in row) for row in matrix)


def camera_of(placed: Any, scene: Any) -> BlenderCamera:
    """The camera of a scene.

    Parameters
    ----------
    placed : bpy.types.Object
        Evaluated.
    scene : bpy.types.Scene
    """
    camera, render = placed.data, scene.render
    width, height = image_size(render)
    dof = camera.dof
    matrix = placed.matrix_world
    focus = dof.focus_distance
    if dof.focus_object is not None:
        away = dof.focus_object.matrix_world.translation - matrix.translation
        focus = abs(away.dot(matrix.to_3x3().col[2].normalized()))
    cycles = getattr(camera, "cycles", None)  # has the panoramas of versions before 5.0
    panorama = camera if hasattr(camera, "panorama_type") else cycles
    return BlenderCamera(
        matrix=rows(matrix),
        width=width,
        height=height,
        type=camera.type,
        lens=camera.lens,
        sensor_fit=camera.sensor_fit,
        sensor_width=camera.sensor_width,
        sensor_height=camera.sensor_height,
        shift_x=camera.shift_x,
        shift_y=camera.shift_y,
        ortho_scale=camera.ortho_scale,
        pixel_aspect=render.pixel_aspect_y / render.pixel_aspect_x,
        panorama_type=getattr(panorama, "panorama_type", "EQUIRECTANGULAR"),
        fisheye_fov=getattr(panorama, "fisheye_fov", np.pi),
        use_dof=dof.use_dof,
        focus_distance=focus,
        fstop=dof.aperture_fstop,
        blades=dof.aperture_blades,
        blade_rotation=dof.aperture_rotation,
        aperture_ratio=dof.aperture_ratio,
    )


def image_size(render: Any) -> tuple[int, int]:
    """Size of the whole image, pixels."""
    share = render.resolution_percentage
    return max(render.resolution_x * share // 100, 1), max(render.resolution_y * share // 100, 1)


def light_of(placed: Any, name: str, matrix: Any) -> BlenderLight:
    """A light of a scene.

    Parameters
    ----------
    placed : bpy.types.Object
        Evaluated.
    name : str
    matrix : mathutils.Matrix
        Where it is.
    """
    light = placed.data
    color = tuple(light.color)
    if getattr(light, "use_temperature", False):
        color = tuple(a * b for a, b in zip(color, light.temperature_color, strict=True))
    spot, area = light.type == "SPOT", light.type == "AREA"
    return BlenderLight(
        name=name,
        matrix=rows(matrix),
        type=light.type,
        color=color,
        energy=light.energy * 2.0 ** getattr(light, "exposure", 0.0),
        normalize=getattr(light, "normalize", True),
        radius=getattr(light, "shadow_soft_size", 0.0),
        angle=getattr(light, "angle", 0.0),
        **({"spot_size": light.spot_size, "spot_blend": light.spot_blend} if spot else {}),
        **({"shape": light.shape, "size": light.size, "size_y": light.size_y, "spread": light.spread} if area else {}),
        visible_camera=placed.visible_camera,
        use_shadow=light.use_shadow,
        use_nodes=light.use_nodes and _has_own_nodes(light.node_tree),
        is_portal=getattr(getattr(light, "cycles", None), "is_portal", False),
    )


def _has_own_nodes(tree: Any) -> bool:
    """Whether nodes of a light do more than the white emission of strength 1 that they begin with."""
    end = _end(tree, "ShaderNodeOutputLight")
    source = _source(end, "Surface") if end is not None else None
    if source is None:
        return False
    if source.bl_idname != "ShaderNodeEmission" or any(each.is_linked for each in source.inputs):
        return True
    return source.inputs["Strength"].default_value != 1.0 or tuple(source.inputs["Color"].default_value)[:3] != (
        1,
        1,
        1,
    )


def world_of(world: Any, folder: Path) -> tuple[BlenderWorld, list[str]]:
    """The world of a scene, with its picture in a folder, and notes of what is left out.

    Parameters
    ----------
    world : bpy.types.World or None
    folder : Path
    """
    if world is None:
        return BlenderWorld(), []
    visible = getattr(getattr(world, "cycles_visibility", None), "camera", True)
    tree = world.node_tree if getattr(world, "use_nodes", True) else None
    if tree is None:
        return BlenderWorld(color=tuple(world.color), visible_camera=visible), []
    notes: list[str] = []
    end = _end(tree, "ShaderNodeOutputWorld")
    if end is not None and _source(end, "Volume") is not None:
        notes.append("the world's volume was left out")
    node = _source(end, "Surface") if end is not None else None
    if node is None:
        return BlenderWorld(visible_camera=visible), notes
    if node.bl_idname != "ShaderNodeBackground":
        notes.append(f"the world was left out: of its nodes a Background is read, but not {node.bl_label}")
        return BlenderWorld(visible_camera=visible), notes
    if node.inputs["Strength"].is_linked:
        notes.append("the world's strength has nodes, which were left out; its number counts")
    strength = max(node.inputs["Strength"].default_value, 0.0)
    picture = _source(node, "Color")
    if picture is None:
        color = tuple(max(x, 0.0) * strength for x in tuple(node.inputs["Color"].default_value)[:3])
        return BlenderWorld(color=color, visible_camera=visible), notes
    if picture.bl_idname != "ShaderNodeTexEnvironment" or picture.image is None:
        what = "an environment map without a picture" if picture.bl_idname.endswith("Environment") else picture.bl_label
        notes.append(f"the world was left out: of its colours a picture is read, but not {what}")
        return BlenderWorld(visible_camera=visible), notes
    if picture.projection != "EQUIRECTANGULAR":
        notes.append("the world was left out: mirror balls are not read, but maps of latitude and longitude")
        return BlenderWorld(visible_camera=visible), notes
    rotation, inverse = _rotation(picture, notes)
    name = _written(picture.image, folder, notes)
    if name is None:
        return BlenderWorld(visible_camera=visible), notes
    made = BlenderWorld(strength=strength, file=name, rotation=rotation, inverse=inverse, visible_camera=visible)
    return made, notes


def _end(tree: Any, kind: str) -> Any:
    """The node of a tree that gives its result."""
    ends = [node for node in tree.nodes if node.bl_idname == kind]
    active = [node for node in ends if node.is_active_output]
    return (active or ends or [None])[0]


def _source(node: Any, name: str) -> Any:
    """The node that an input comes from, past reroutes; None without one."""
    links = node.inputs[name].links
    while links:
        source = links[0].from_node
        if source.bl_idname != "NodeReroute":
            return source
        links = source.inputs[0].links
    return None


def _rotation(picture: Any, notes: list[str]) -> tuple[tuple[float, float, float], bool]:
    """How a map is turned, and whether the other way."""
    node = _source(picture, "Vector")
    if node is None or node.bl_idname == "ShaderNodeTexCoord":
        return (0.0, 0.0, 0.0), False
    if node.bl_idname != "ShaderNodeMapping" or node.inputs["Rotation"].is_linked:
        notes.append(f"where the environment map is looked up ({node.bl_label}) was left out; a Mapping is read")
        return (0.0, 0.0, 0.0), False
    moved = any(node.inputs["Location"].default_value) if "Location" in node.inputs else False
    if moved or any(scale != 1.0 for scale in node.inputs["Scale"].default_value):
        notes.append("location and scale of the environment map's Mapping were left out; its rotation counts")
    x, y, z = node.inputs["Rotation"].default_value
    return (x, y, z), node.vector_type == "TEXTURE"


def _written(image: Any, folder: Path, notes: list[str]) -> str | None:
    """Name of the file of a picture in a folder; None if it has no pixels."""
    space = image.colorspace_settings.name
    path = Path(bpy.path.abspath(image.filepath, library=image.library))
    if (
        image.source == "FILE"
        and image.packed_file is None
        and not image.is_dirty
        and path.suffix.lower() in _COPIED
        and space in _LINEAR
        and path.is_file()
    ):
        name = f"environment{path.suffix.lower()}"
        shutil.copyfile(path, folder / name)
        return name
    width, height = image.size
    if not width or not height:
        notes.append(f"the environment map {image.name} was left out: it has no pixels")
        return None
    values = np.empty(width * height * image.channels, np.float32)
    image.pixels.foreach_get(values)
    pixels = values.reshape(height, width, image.channels)
    pixels = pixels[..., :3] if image.channels >= 3 else np.repeat(pixels[..., :1], 3, axis=2)
    if not image.is_float:  # whose values are linear already
        if space == "sRGB":
            pixels = linear(pixels)
        elif space not in _LINEAR:
            notes.append(f"the colour space {space} of {image.name} was left out; its numbers count as they are")
    (folder / "environment.pfm").write_bytes(pfm_bytes(np.maximum(pixels, 0.0)))
    return "environment.pfm"
