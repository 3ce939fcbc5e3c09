"""Renders a benchmark scene with Cycles; run by a Python that has bpy. See peer_scene.py."""

from __future__ import annotations

import os
import re
import tempfile
import time
from pathlib import Path
from typing import Any

import bpy
import mathutils
import numpy as np
from peer_scene import Job, Part, answer, camera_of, job, parts_of, refuse_rich, timed

__all__: list[str] = []


def material(part: Part) -> Any:
    made = bpy.data.materials.new(part.name)
    made.use_nodes = True
    tree = made.node_tree
    tree.nodes.clear()
    new, link = tree.nodes.new, tree.links.new
    if part.emission is not None:
        node = new("ShaderNodeEmission")
        node.inputs["Color"].default_value = (*part.emission, 1.0)
        geometry, front = new("ShaderNodeNewGeometry"), new("ShaderNodeMath")
        front.operation, front.inputs[0].default_value = "SUBTRACT", 1.0
        link(geometry.outputs["Backfacing"], front.inputs[1])
        link(front.outputs[0], node.inputs["Strength"])
        made.cycles.emission_sampling = "FRONT"
    elif part.material["type"] == "dielectric":
        node = new("ShaderNodeBsdfGlass")
        node.inputs["Color"].default_value = (1.0, 1.0, 1.0, 1.0)
        node.inputs["Roughness"].default_value, node.inputs["IOR"].default_value = 0.0, part.material["ior"]
    else:
        mirror = part.material["type"] == "mirror"
        node = new("ShaderNodeBsdfAnisotropic" if mirror else "ShaderNodeBsdfDiffuse")
        node.inputs["Color"].default_value = (*part.material["reflectance"], 1.0)
        node.inputs["Roughness"].default_value = 0.0
    link(node.outputs[0], new("ShaderNodeOutputMaterial").inputs["Surface"])
    return made


def add_mesh(part: Part) -> None:
    mesh = bpy.data.meshes.new(part.name)
    count = len(part.faces)
    mesh.vertices.add(len(part.vertices))
    mesh.vertices.foreach_set("co", np.ascontiguousarray(part.vertices, np.float32).ravel())
    mesh.loops.add(3 * count)
    mesh.loops.foreach_set("vertex_index", np.ascontiguousarray(part.faces, np.int32).ravel())
    mesh.polygons.add(count)
    mesh.polygons.foreach_set("loop_start", np.arange(0, 3 * count, 3, dtype=np.int32))
    mesh.update(calc_edges=False)
    if part.normals is None:
        mesh.shade_flat()
    else:
        mesh.shade_smooth()
        mesh.normals_split_custom_set_from_vertices(part.normals.tolist())
    mesh.materials.append(material(part))
    bpy.context.scene.collection.objects.link(bpy.data.objects.new(part.name, mesh))


def set_up(one: Job) -> None:
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene, described = bpy.context.scene, camera_of(one)
    for part in parts_of(one)[0]:
        add_mesh(part)
    camera = bpy.data.cameras.new("camera")
    placed = bpy.data.objects.new("camera", camera)
    scene.collection.objects.link(placed)
    scene.camera = placed
    camera.sensor_fit, camera.angle = "VERTICAL", np.radians(described["vertical_fov"])
    camera.clip_start, camera.clip_end = 1e-3, 1e4
    view = mathutils.Vector(described["target"]) - mathutils.Vector(described["position"])
    turned = view.to_track_quat("-Z", "Y").to_matrix().to_4x4()
    placed.matrix_world = mathutils.Matrix.Translation(described["position"]) @ turned
    render, cycles = scene.render, scene.cycles
    render.engine, render.resolution_x, render.resolution_y = "CYCLES", one.width, one.height
    render.resolution_percentage, render.threads_mode = 100, "FIXED"
    render.threads = len(os.sched_getaffinity(0))
    render.use_compositing = render.use_sequencer = False
    render.dither_intensity, render.use_stamp_render_time = 0, True
    render.image_settings.file_format, render.image_settings.color_depth = "OPEN_EXR", "32"
    render.image_settings.color_mode, render.image_settings.exr_codec = "RGB", "NONE"
    scene.view_settings.view_transform = "Raw"
    bounces = one.segments - 2
    for name in ("max", "diffuse", "glossy", "transmission"):
        setattr(cycles, f"{name}_bounces", bounces)
    cycles.transparent_max_bounces, cycles.volume_bounces = bounces, 0
    cycles.min_light_bounces = cycles.min_transparent_bounces = 1024
    cycles.device, cycles.samples, cycles.seed = "CPU", one.spp, one.seed
    cycles.use_adaptive_sampling = cycles.use_denoising = cycles.use_guiding = cycles.use_auto_tile = False
    cycles.sample_clamp_direct = cycles.sample_clamp_indirect = cycles.blur_glossy = cycles.light_sampling_threshold = 0
    cycles.caustics_reflective = cycles.caustics_refractive = True
    cycles.use_light_tree = one.variant == "tree"
    cycles.pixel_filter_type, cycles.filter_width = "BOX", 1.0


def seconds_in(path: Path) -> float | None:
    """Render time without set-up as Cycles reports it, in the header of the image file."""
    header = path.read_bytes()[:65536]
    found = re.search(rb"cycles\.[^\0]*?\.render_time\0string\0(.{4})([0-9:.]+)", header, re.S)
    if found is None:
        return None
    parts = found[2][: int.from_bytes(found[1], "little")].decode().split(":")
    return sum(float(part) * 60.0**power for power, part in enumerate(reversed(parts)))


def main() -> None:
    begin = time.perf_counter()
    one = job()
    refuse_rich(one, "Cycles")
    set_up(one)
    setup = time.perf_counter() - begin
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "image.exr"
        bpy.context.scene.render.filepath = str(path)
        _, wall, cpu = timed(lambda: bpy.ops.render.render(write_still=True))
        inside = seconds_in(path)
        loaded = bpy.data.images.load(str(path))
        loaded.colorspace_settings.name = "Non-Color"
        pixels = np.empty(one.width * one.height * 4, np.float32)
        loaded.pixels.foreach_get(pixels)
    image = pixels.reshape(one.height, one.width, 4)[::-1, :, :3]
    share = 1.0 if inside is None else min(inside / wall, 1.0)
    answer(one, image, wall * share, cpu * share, bpy.app.version_string, setup + wall * (1.0 - share))


if __name__ == "__main__":
    main()
