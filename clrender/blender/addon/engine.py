"""The render engine: what Blender calls for an image."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any, Final

import bpy
import numpy as np
from numpy.typing import NDArray

from .exporting import ExportError, exported
from .program import INTERRUPTED, RenderOptions, found_program, region, render_command, run
from .reading import image_size

__all__ = ["ENGINE", "RenderEngine", "chosen_program", "options_of", "pixels_of"]

ENGINE: Final = "CLRENDER"
"""Identifier of the engine in Blender."""


def chosen_program() -> str:
    """The program of the add-on's preferences; empty if none is chosen."""
    entry = bpy.context.preferences.addons.get(__package__)
    return str(entry.preferences.program) if entry is not None and entry.preferences is not None else ""


def options_of(scene: Any) -> RenderOptions:
    """What the settings of a scene ask for.

    Parameters
    ----------
    scene : bpy.types.Scene
    """
    chosen, render = scene.clrender, scene.render
    crop = None
    if render.use_border:
        across, upward = (render.border_min_x, render.border_max_x), (render.border_min_y, render.border_max_y)
        crop = region(image_size(render), across, upward)
    return RenderOptions(
        spp=chosen.spp,
        seed=chosen.seed,
        integrator=chosen.integrator,
        light_sampler=chosen.light_sampler,
        filter=chosen.filter,
        max_depth=chosen.max_depth,
        error=chosen.error,
        seconds=chosen.seconds,
        device=chosen.device,
        denoise=chosen.denoise,
        alpha=render.film_transparent,
        crop=crop,
        more=chosen.more,
    )


def pixels_of(path: Path) -> NDArray[np.float32]:
    """The pixels of an `.exr`, (height, width, 4), the lowest row first, with premultiplied colours.

    Parameters
    ----------
    path : Path
    """
    image = bpy.data.images.load(str(path))
    try:
        image.colorspace_settings.name = "Non-Color"
        width, height = image.size
        values = np.empty(width * height * image.channels, np.float32)
        image.pixels.foreach_get(values)
        pixels = np.ones((height, width, 4), np.float32)
        pixels[..., : image.channels] = values.reshape(height, width, image.channels)
        return pixels
    finally:
        bpy.data.images.remove(image)


class RenderEngine(bpy.types.RenderEngine):  # type: ignore[misc]
    """Exports the scene, runs `clrender render`, and gives Blender its image."""

    bl_idname = ENGINE
    bl_label = "clrender"
    bl_use_preview = False
    bl_use_postprocess = True
    bl_use_eevee_viewport = True
    bl_use_shading_nodes_custom = False

    def render(self, depsgraph: Any) -> None:
        """Render a view layer."""
        with tempfile.TemporaryDirectory(prefix="clrender-") as name:
            try:
                self._render(depsgraph, Path(name))
            except (ExportError, OSError, RuntimeError, ValueError) as error:
                self._fail(str(error))

    def _render(self, depsgraph: Any, folder: Path) -> None:
        scene = depsgraph.scene
        program, options = found_program(chosen_program()), options_of(scene)
        self.update_stats("", "clrender: exporting the scene")
        try:
            path, notes = exported(depsgraph, folder, program, self.test_break)
        except ExportError:
            if self.test_break():
                return
            raise
        for note in notes:
            self.report({"INFO"}, f"clrender: {note}")
        output = folder / "image.exr"
        finished = run([*program, *render_command(path, output, options)], self.test_break, self._show)
        for message in finished.messages:
            self.report({"INFO"}, f"clrender: {message}")
        if finished.error:
            self._fail(finished.error)
        elif output.is_file():
            self._take(output, scene, options)
        elif finished.code != INTERRUPTED:
            self._fail("the image is missing")

    def _show(self, event: dict[str, Any]) -> None:
        """Progress."""
        total = event.get("samples_total")
        if event.get("event") != "progress" or not total:
            return
        self.update_progress(event["samples"] / total)
        left, error = event.get("seconds_left"), event.get("relative_error")
        told = [f"{100.0 * event['samples'] / total:.0f} % of the samples"]
        told += [f"{left:.0f} s left"] if left is not None else []
        told += [f"error {100.0 * error:.2g} %"] if error is not None else []
        self.update_stats("", f"clrender: {', '.join(told)}")

    def _take(self, output: Path, scene: Any, options: RenderOptions) -> None:
        """Linear radiance, to which Blender's view transform applies."""
        width, height = image_size(scene.render) if options.crop is None else options.crop[2:]
        pixels = pixels_of(output)
        if pixels.shape[:2] != (height, width):
            self._fail(f"the image has {pixels.shape[1]} x {pixels.shape[0]} pixels instead of {width} x {height}")
            return
        result = self.begin_result(0, 0, width, height)
        result.layers[0].passes["Combined"].rect.foreach_set(pixels.ravel())
        self.end_result(result)
        self.update_progress(1.0)

    def _fail(self, text: str) -> None:
        # Not `error_set`, by which Blender 5.0 crashes when no image has begun
        self.report({"ERROR"}, f"clrender: {text}")
