"""Renders scenes of Blender by Cycles and by the add-on, and compares their means.

``PYTHON scripts/blender_check.py ADDON.zip --program CLRENDER -o FOLDER`` with a Python that has Blender's module bpy.
It prints a line of JSON for each scene, and exits with 1 when the means of a region differ by more than the limit.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
import tempfile
import time
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

import bpy
import numpy as np
from numpy.typing import NDArray

__all__ = ["main"]

MODULE: Final = "clrender_blender"
LIMIT: Final = 0.05
"""Largest relative difference of the means of a region."""
_REGIONS: Final = 4
"""Regions along a side of the image."""
_BRIGHT: Final = 16.0
"""Times the mean of the image at which pixels are cut off: single samples of caustics would decide means otherwise."""
_DIM: Final = 0.02
"""Share of the image's mean that is added to both means of a region, where a black one would have no ratio."""


def _material(name: str, color: tuple[float, float, float], **values: float) -> Any:
    made = bpy.data.materials.new(name)
    made.use_nodes = True
    inputs = made.node_tree.nodes["Principled BSDF"].inputs
    inputs["Base Color"].default_value = (*color, 1.0)
    for key, value in values.items():
        inputs[key.replace("_", " ")].default_value = value
    return made


def _given(material: Any, smooth: bool = False) -> Any:
    placed = bpy.context.object
    placed.data.materials.append(material)
    if smooth:
        bpy.ops.object.shade_smooth()
    return placed


def _plane(material: Any, size: float, location: Any, rotation: Any = (0.0, 0.0, 0.0)) -> None:
    bpy.ops.mesh.primitive_plane_add(size=size, location=location, rotation=rotation)
    _given(material)


def _light(kind: str, location: Any, rotation: Any, **values: Any) -> Any:
    light = bpy.data.lights.new(kind.lower(), kind)
    for name, value in values.items():
        setattr(light, name, value)
    placed = bpy.data.objects.new(kind.lower(), light)
    placed.location, placed.rotation_euler = location, rotation
    bpy.context.scene.collection.objects.link(placed)
    return placed


def _camera(location: Any, target: Any, **values: Any) -> Any:
    camera = bpy.data.cameras.new("camera")
    for name, value in values.items():
        setattr(camera, name, value)
    placed = bpy.data.objects.new("camera", camera)
    bpy.context.scene.collection.objects.link(placed)
    placed.location = location
    direction = placed.location.copy()
    direction.x, direction.y, direction.z = (b - a for a, b in zip(location, target, strict=True))
    placed.rotation_euler = direction.to_track_quat("-Z", "Y").to_euler()
    bpy.context.scene.camera = placed
    return camera


def _world(color: tuple[float, float, float], strength: float) -> Any:
    world = bpy.data.worlds.new("world")
    world.use_nodes = True
    bpy.context.scene.world = world
    node = world.node_tree.nodes["Background"]
    node.inputs["Color"].default_value, node.inputs["Strength"].default_value = (*color, 1.0), strength
    return world


def _things(x: float, y: float) -> None:
    """A cube with bevelled edges, a ball of glass, and a head with a subdivided surface."""
    bpy.ops.mesh.primitive_cube_add(size=0.9, location=(x - 1.0, y + 0.5, 0.45), rotation=(0.0, 0.0, 0.4))
    bevel = _given(_material("blue", (0.1, 0.2, 0.6), Roughness=0.5)).modifiers.new("bevel", "BEVEL")
    bevel.width, bevel.segments = 0.08, 3
    bpy.ops.mesh.primitive_uv_sphere_add(radius=0.4, location=(x + 0.1, y - 0.5, 0.4), segments=64, ring_count=32)
    _given(_material("glass", (1.0, 1.0, 1.0), Roughness=0.0, Transmission_Weight=1.0, IOR=1.5), smooth=True)
    bpy.ops.mesh.primitive_monkey_add(size=1.1, location=(x + 0.95, y + 0.2, 0.6), rotation=(-0.4, 0.0, 0.5))
    head = _given(_material("orange", (0.8, 0.35, 0.08), Roughness=0.3, Coat_Weight=0.3), smooth=True)
    subdivision = head.modifiers.new("subdivision", "SUBSURF")
    subdivision.levels, subdivision.render_levels = 0, 2


def room() -> None:
    """A room that is open towards the camera."""
    white = _material("white", (0.7, 0.7, 0.7), Roughness=1.0, Specular_IOR_Level=0.0)
    half = math.pi / 2.0
    _plane(white, 4.0, (0.0, 0.0, 0.0))
    _plane(white, 4.0, (0.0, 0.0, 3.0), (math.pi, 0.0, 0.0))
    _plane(white, 4.0, (0.0, 2.0, 1.0), (half, 0.0, 0.0))
    _plane(_material("red", (0.6, 0.08, 0.06), Roughness=0.9), 4.0, (-2.0, 0.0, 1.0), (0.0, half, 0.0))
    _plane(_material("green", (0.1, 0.5, 0.1), Roughness=0.9), 4.0, (2.0, 0.0, 1.0), (0.0, -half, 0.0))
    _things(0.0, 0.3)
    _light("AREA", (0.0, 0.0, 2.9), (0.0, 0.0, 0.0), energy=60.0, shape="RECTANGLE", size=1.2, size_y=0.6)
    _light("SUN", (0.0, -5.0, 5.0), (0.9, 0.2, 0.0), energy=1.5, angle=0.0)
    _light("POINT", (-1.3, -1.0, 1.9), (0.0, 0.0, 0.0), energy=40.0, color=(1.0, 0.8, 0.6), shadow_soft_size=0.1)
    _light("SPOT", (1.2, -1.2, 2.5), (0.3, 0.0, 0.0), energy=80.0, spot_size=0.8, spot_blend=0.3, shadow_soft_size=0.0)
    _world((0.2, 0.3, 0.5), 0.4)
    _camera((0.3, -5.6, 1.6), (0.0, 0.0, 1.2), lens=40.0)


def outdoor() -> None:
    """A meadow below an environment map, which is turned; a camera with lens shift and depth of field."""
    _plane(_material("ground", (0.25, 0.3, 0.12), Roughness=0.8), 40.0, (0.0, 0.0, 0.0))
    _things(0.0, 0.0)
    bpy.ops.mesh.primitive_uv_sphere_add(radius=0.45, location=(-0.4, 1.9, 0.45), segments=64, ring_count=32)
    _given(_material("metal", (0.9, 0.7, 0.4), Metallic=1.0, Roughness=0.2), smooth=True)
    world = _world((1.0, 1.0, 1.0), 1.5)
    tree = world.node_tree
    picture, mapping, given = (
        tree.nodes.new(f"ShaderNode{kind}") for kind in ("TexEnvironment", "Mapping", "TexCoord")
    )
    picture.image = _sky(256, 128)
    mapping.inputs["Rotation"].default_value = (0.0, 0.0, math.radians(50.0))
    tree.links.new(given.outputs["Generated"], mapping.inputs["Vector"])
    tree.links.new(mapping.outputs["Vector"], picture.inputs["Vector"])
    tree.links.new(picture.outputs["Color"], tree.nodes["Background"].inputs["Color"])
    camera = _camera((1.5, -5.5, 1.6), (0.0, 0.0, 0.5), lens=50.0, shift_x=0.03, shift_y=0.1, sensor_fit="VERTICAL")
    camera.dof.use_dof, camera.dof.focus_distance, camera.dof.aperture_fstop = True, 5.5, 0.5


def _sky(width: int, height: int) -> Any:
    """A sky with a bright patch, bluer above, and with a dark side."""
    image = bpy.data.images.new("sky", width, height, float_buffer=True)
    across, up = np.meshgrid((np.arange(width) + 0.5) / width, (np.arange(height) + 0.5) / height)
    shade = 0.35 + 0.25 * np.cos(2.0 * np.pi * (across - 0.2)) + 0.3 * up
    glow = 30.0 * np.exp(-(((across - 0.3) / 0.03) ** 2) - ((up - 0.75) / 0.05) ** 2)
    pixels = np.ones((height, width, 4), np.float32)
    for channel, (tint, warm) in enumerate(((0.6, 1.0), (0.8, 0.85), (1.1, 0.6))):
        pixels[..., channel] = shade * tint + glow * warm
    image.pixels.foreach_set(pixels.ravel())
    image.pack()
    return image


def objects() -> None:
    """Copies by a collection and by geometry nodes, text, several materials, pictures, and what only cameras miss."""
    data, collection = bpy.data, bpy.context.scene.collection
    _plane(_material("grey", (0.5, 0.5, 0.5), Roughness=0.8), 8.0, (0.0, 0.0, 0.0))
    group = data.collections.new("cones")
    bpy.ops.mesh.primitive_cone_add(location=(0.0, 0.0, 0.3), depth=0.6, radius1=0.3)
    cone = _given(_material("cone", (0.7, 0.2, 0.2), Roughness=0.6))
    collection.objects.unlink(cone)
    group.objects.link(cone)
    for x in (-1.5, -0.7):
        copy = data.objects.new("cones", None)
        copy.instance_type, copy.instance_collection = "COLLECTION", group
        copy.location, copy.scale = (x, 1.0, 0.0), (1.0, 1.0, 1.5)
        collection.objects.link(copy)
    bpy.ops.object.text_add(location=(-1.5, -1.2, 0.05))
    _given(_material("text", (0.2, 0.4, 0.8), Roughness=0.7)).data.body = "Hi"
    bpy.context.object.data.extrude = 0.1
    bpy.ops.mesh.primitive_cube_add(size=0.7, location=(0.5, -0.6, 0.35))
    cube = _given(_material("yellow", (0.9, 0.9, 0.1), Roughness=0.9))
    cube.data.materials.append(_material("teal", (0.1, 0.7, 0.7), Roughness=0.9))
    cube.data.polygons[0].material_index = cube.data.polygons[3].material_index = 1
    places = ((1.5, -0.6, 0.35), (-0.3, -1.0, 1.0), (-0.3, -1.0, 1.5))
    own, unseen, hidden = (cube.copy() for _ in places)
    for copy, place in zip((own, unseen, hidden), places, strict=True):
        copy.location = place
        collection.objects.link(copy)
    own.material_slots[0].link = "OBJECT"
    own.material_slots[0].material = _material("pink", (0.8, 0.1, 0.6), Roughness=0.9)
    unseen.visible_camera, hidden.hide_render = False, True
    bpy.ops.mesh.primitive_cube_add(size=0.4, location=(-2.2, 0.0, 0.2))  # without a material
    _balls((1.4, 1.0, 0.3))
    bpy.ops.mesh.primitive_plane_add(size=1.2, location=(0.0, 2.0, 0.9), rotation=(1.3, 0.0, 0.2))
    _given(_pictured("picture"))
    bpy.ops.mesh.primitive_plane_add(size=0.5, location=(2.2, 0.4, 0.6), rotation=(math.pi / 2.0, 0.0, 0.0))
    shining = _given(_material("shining", (0.0, 0.0, 0.0), Emission_Strength=3.0)).data.materials[0]
    shining.node_tree.nodes["Principled BSDF"].inputs["Emission Color"].default_value = (1.0, 0.8, 0.5, 1.0)
    _light("AREA", (-2.0, -2.0, 3.0), (0.6, -0.5, 0.0), energy=120.0, size=1.0, shape="DISK")
    _world((0.5, 0.6, 0.8), 0.5)
    _camera((0.5, -6.0, 3.5), (0.0, 0.3, 0.3), lens=45.0)


def _balls(location: Any) -> None:
    """A plane with balls at its corners, by geometry nodes."""
    bpy.ops.mesh.primitive_plane_add(size=1.0, location=location)
    tree = bpy.data.node_groups.new("balls", "GeometryNodeTree")
    bpy.context.object.modifiers.new("balls", "NODES").node_group = tree
    for direction in ("INPUT", "OUTPUT"):
        tree.interface.new_socket("Geometry", in_out=direction, socket_type="NodeSocketGeometry")
    given, made, at, ball, paint = (
        tree.nodes.new(kind)
        for kind in (
            *("NodeGroupInput", "NodeGroupOutput", "GeometryNodeInstanceOnPoints", "GeometryNodeMeshUVSphere"),
            "GeometryNodeSetMaterial",
        )
    )
    ball.inputs["Radius"].default_value = 0.25
    paint.inputs["Material"].default_value = _material("balls", (0.2, 0.8, 0.3), Roughness=0.7)
    for source, target in (
        (given.outputs[0], at.inputs["Points"]),
        (ball.outputs["Mesh"], paint.inputs["Geometry"]),
        (paint.outputs["Geometry"], at.inputs["Instance"]),
        (at.outputs[0], made.inputs[0]),
    ):
        tree.links.new(source, target)


def _pictured(name: str) -> Any:
    """A material with four squares of colour as its picture."""
    image = bpy.data.images.new(name, 64, 64)
    pixels = np.ones((64, 64, 4), np.float32)
    pixels[:32, :, 0], pixels[:, :32, 1] = 0.2, 0.3
    image.pixels.foreach_set(pixels.ravel())
    image.pack()
    made = _material(name, (1.0, 1.0, 1.0), Roughness=0.8)
    tree = made.node_tree
    texture = tree.nodes.new("ShaderNodeTexImage")
    texture.image = image
    tree.links.new(texture.outputs["Color"], tree.nodes["Principled BSDF"].inputs["Base Color"])
    return made


SCENES: Final[dict[str, Callable[[], None]]] = {"room": room, "outdoor": outdoor, "objects": objects}


def _settings(size: tuple[int, int], spp: int) -> None:
    scene = bpy.context.scene
    scene.render.resolution_x, scene.render.resolution_y, scene.render.resolution_percentage = *size, 100
    scene.render.image_settings.file_format, scene.render.image_settings.color_depth = "OPEN_EXR", "32"
    scene.clrender.spp = spp
    cycles = scene.cycles
    cycles.samples, cycles.use_adaptive_sampling, cycles.use_denoising = spp, False, False
    # As many bounces as here, nothing clamped or blurred
    for kind in ("max", "diffuse", "glossy", "transmission", "transparent_max"):
        setattr(cycles, f"{kind}_bounces", 64)
    cycles.sample_clamp_indirect = cycles.sample_clamp_direct = cycles.blur_glossy = 0.0
    cycles.caustics_reflective = cycles.caustics_refractive = True
    scene.render.threads_mode, scene.render.threads = "FIXED", 2


def _rendered(engine: str, path: Path) -> NDArray[np.float64]:
    scene = bpy.context.scene
    scene.render.engine, scene.render.filepath = engine, str(path)
    bpy.ops.render.render(write_still=True)
    image = bpy.data.images.load(str(path))
    values = np.empty(image.size[0] * image.size[1] * 4, np.float32)
    image.pixels.foreach_get(values)
    pixels = values.reshape(image.size[1], image.size[0], 4)[::-1, :, :3]
    bpy.data.images.remove(image)
    return pixels.astype(np.float64)


def _means(pixels: NDArray[np.float64]) -> NDArray[np.float64]:
    """Means of the regions."""
    rows = np.array_split(pixels, _REGIONS, axis=0)
    return np.array([[part.mean() for part in np.array_split(row, _REGIONS, axis=1)] for row in rows])


def compared(name: str, folder: Path) -> dict[str, Any]:
    """Render the scene that is open by both, and compare.

    Parameters
    ----------
    name : str
    folder : Path
        Where the images are written.
    """
    seconds, images = {}, {}
    for engine in ("CYCLES", "CLRENDER"):
        began = time.perf_counter()
        images[engine] = _rendered(engine, folder / f"{name}-{engine.lower()}.exr")
        seconds[engine] = round(time.perf_counter() - began, 1)
    theirs, ours = images["CYCLES"], images["CLRENDER"]
    floor, most = _DIM * theirs.mean(), _BRIGHT * theirs.mean()
    regions = (_means(np.minimum(ours, most)) + floor) / (_means(np.minimum(theirs, most)) + floor) - 1.0
    return {
        "scene": name,
        "cycles": theirs.mean(axis=(0, 1)).round(5).tolist(),
        "clrender": ours.mean(axis=(0, 1)).round(5).tolist(),
        "difference": round(ours.mean() / theirs.mean() - 1.0, 4),
        "regions": regions.round(3).tolist(),
        "worst": round(float(np.abs(regions).max()), 4),
        "seconds": seconds,
    }


def installed(archive: Path, folder: Path, program: str) -> None:
    """Enable the add-on from its archive.

    Parameters
    ----------
    archive, folder : Path
        The folder is where it is unpacked.
    program : str
        For its preferences.
    """
    import addon_utils

    with zipfile.ZipFile(archive) as packed:
        packed.extractall(folder)
    sys.path.insert(0, str(folder))
    bpy.ops.wm.read_factory_settings(use_empty=True)
    if addon_utils.enable(MODULE, default_set=True) is None:
        raise SystemExit(f"{archive}: Blender does not enable the add-on")
    bpy.context.preferences.addons[MODULE].preferences.program = program


def main() -> int:
    """Command line; gives the exit code."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("archive", type=Path)
    parser.add_argument("--program", default="")
    parser.add_argument("-o", "--output", type=Path, required=True)
    parser.add_argument("--scene", choices=SCENES, action="append")
    parser.add_argument("--size", type=int, nargs=2, default=(160, 120))
    parser.add_argument("--spp", type=int, default=256)
    given = parser.parse_args()
    given.output.mkdir(parents=True, exist_ok=True)
    worst = 0.0
    with tempfile.TemporaryDirectory() as folder:
        installed(given.archive, Path(folder), given.program)
        for name in given.scene or SCENES:
            bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=False)
            for each in (bpy.data.materials, bpy.data.worlds, bpy.data.images):
                for one in list(each):
                    each.remove(one)
            SCENES[name]()
            _settings(tuple(given.size), given.spp)
            report = compared(name, given.output)
            print(json.dumps(report), flush=True)
            worst = max(worst, report["worst"])
    return int(worst > LIMIT)


if __name__ == "__main__":
    sys.exit(main())
