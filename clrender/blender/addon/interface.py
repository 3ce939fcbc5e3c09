"""Settings, panels, preferences and commands in Blender's interface."""

from __future__ import annotations

import atexit
import contextlib
import shutil
import subprocess
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

import bpy

from .engine import ENGINE, RenderEngine, chosen_program
from .exporting import ExportError, exported
from .program import child_environment, found_program

__all__ = ["register", "unregister"]

_INTEGRATORS: Final = (
    ("path", "Path tracing", "Paths from the camera"),
    ("bdpt", "Bidirectional", "Paths from the camera and from lights, which find caustics sooner"),
    ("photon", "Photon mapping", "Progressive photon mapping: biased by its radius"),
    ("reuse", "Path reuse", "Pixels share indirect light"),
    ("direct", "Direct light", "Without indirect light"),
)
_LIGHT_SAMPLERS: Final = (
    ("auto", "Automatic", "What the integrator and the scene suit"),
    ("bvh", "Light BVH", "By power, distance and direction"),
    ("power", "Power", "By power alone, whose cost does not depend on the number of lights"),
    ("uniform", "Uniform", "All lights alike"),
)
_FILTERS: Final = (
    ("blackman-harris", "Blackman-Harris", "1.5 pixels wide, as in Cycles"),
    ("box", "Box", "The area of the pixel"),
    ("tent", "Tent", "2 pixels wide"),
    ("gaussian", "Gaussian", "3 pixels wide"),
    ("mitchell", "Mitchell", "4 pixels wide, sharper"),
)
_ERROR: Final = (
    "Stop when most pixels are within this relative error; 0: never. "
    "Samples are then the most of a pixel; below 256, too few for an estimate, they do not count"
)
_SHARED: Final = (
    *("DATA_PT_camera_dof", "DATA_PT_camera_dof_aperture", "DATA_PT_EEVEE_light", "EEVEE_WORLD_PT_surface"),
    *("EEVEE_MATERIAL_PT_context_material", "EEVEE_MATERIAL_PT_surface", "MATERIAL_PT_preview"),
)
"""Panels of Eevee that are about the scene, not about Eevee."""
_OTHERS: Final = ("RENDER_PT_gpencil", "RENDER_PT_freestyle", "VIEWLAYER_PT_freestyle", "DATA_PT_preview")
"""Beginnings of the names of panels that are of no use here."""


def _class(name: str, base: Any, properties: dict[str, Any], members: dict[str, Any]) -> Any:
    """A class with properties of Blender, which are annotations of a class."""
    return type(name, (base,), {"__annotations__": properties, "__module__": __name__, **members})


def _integer(name: str, default: int, low: int, text: str) -> Any:
    return bpy.props.IntProperty(name=name, default=default, min=low, description=text)


def _number(name: str, text: str, **limits: float) -> Any:
    return bpy.props.FloatProperty(name=name, default=0.0, min=0.0, description=text, **limits)


def _text(name: str, text: str) -> Any:
    return bpy.props.StringProperty(name=name, default="", description=text)


Settings: Final = _class(
    "CLRENDER_settings",
    bpy.types.PropertyGroup,
    {
        "spp": _integer("Samples", 64, 1, "Samples per pixel"),
        "seed": _integer("Seed", 0, 0, "Of the random numbers"),
        "integrator": bpy.props.EnumProperty(name="Integrator", items=_INTEGRATORS, default="path"),
        "light_sampler": bpy.props.EnumProperty(name="Light Sampler", items=_LIGHT_SAMPLERS, default="auto"),
        "filter": bpy.props.EnumProperty(name="Pixel Filter", items=_FILTERS, default="blackman-harris"),
        "max_depth": _integer("Depth", 0, 0, "Most scattering events of a path; 0: no limit"),
        "error": _number("Error", _ERROR, max=1.0),
        "seconds": _number("Time Limit", "Stop after this many seconds; 0: never"),
        "device": _text("Device", "auto, cpu, gpu, all, a number of `clrender devices`, or a part of a name"),
        "denoise": bpy.props.BoolProperty(name="Denoise", description="With Open Image Denoise, if it is installed"),
        "more": _text("Other Options", "Of `clrender render`, as on a command line"),
    },
    {"__doc__": "Settings of a scene."},
)


def _draw_preferences(self: Any, context: Any) -> None:
    self.layout.prop(self, "program")
    with contextlib.suppress(OSError):
        found = found_program(self.program)
        self.layout.label(text=f"Found: {' '.join(found)}", icon="CHECKMARK")
        return
    self.layout.label(text="clrender was not found; choose its program, or a Python that has it", icon="ERROR")


Preferences: Final = _class(
    "CLRENDER_preferences",
    bpy.types.AddonPreferences,
    {
        "program": bpy.props.StringProperty(
            name="Program",
            subtype="FILE_PATH",
            description="clrender, or the Python in which it is installed; empty: clrender on the PATH",
        )
    },
    {"bl_idname": __package__, "draw": _draw_preferences},
)


def _is_chosen(cls: Any, context: Any) -> bool:
    return bool(context.engine == ENGINE)


def _draw_render(self: Any, context: Any) -> None:
    layout, chosen = self.layout, context.scene.clrender
    layout.use_property_split = True
    layout.use_property_decorate = False
    for group in (
        ("integrator", "light_sampler", "max_depth"),
        ("spp", "error", "seconds"),
        ("seed", "filter", "denoise"),
    ):
        column = layout.column(align=True)
        for name in group:
            column.prop(chosen, name)
    layout.prop(context.scene.render, "film_transparent", text="Transparent")
    column = layout.column(align=True)
    column.prop(chosen, "device")
    column.prop(chosen, "more")
    layout.operator("clrender.view", icon="HIDE_OFF")


RenderPanel: Final = _class(
    "RENDER_PT_clrender",
    bpy.types.Panel,
    {},
    {
        "bl_label": "clrender",
        "bl_space_type": "PROPERTIES",
        "bl_region_type": "WINDOW",
        "bl_context": "render",
        "COMPAT_ENGINES": {ENGINE},
        "poll": classmethod(_is_chosen),
        "draw": _draw_render,
    },
)


class _LiveView:
    """`clrender view`, which loads the scene again when it is exported again."""

    def __init__(self) -> None:
        self.folder: Path | None = None
        self.process: subprocess.Popen[bytes] | None = None

    def show(self, depsgraph: Any) -> list[str]:
        """Export the scene, and start the view unless it is there; gives notes."""
        program = found_program(chosen_program())
        if self.folder is None:
            self.folder = Path(tempfile.mkdtemp(prefix="clrender-view-"))
        path, notes = exported(depsgraph, self.folder, program)
        if self.process is None or self.process.poll() is not None:
            words = [*program, "view", str(path)]
            self.process = subprocess.Popen(words, stdin=subprocess.DEVNULL, env=child_environment())
        return notes

    def close(self) -> None:
        """End the view, and remove its scene."""
        if self.process is not None and self.process.poll() is None:
            self.process.terminate()
            self.process.wait(timeout=10.0)
        if self.folder is not None:
            shutil.rmtree(self.folder, ignore_errors=True)
        self.folder = self.process = None


_VIEW: Final = _LiveView()


def _open_view(self: Any, context: Any) -> set[str]:
    try:
        notes = _VIEW.show(context.evaluated_depsgraph_get())
    except (ExportError, OSError) as error:
        self.report({"ERROR"}, f"clrender: {error}")
        return {"CANCELLED"}
    for note in notes:
        self.report({"INFO"}, f"clrender: {note}")
    return {"FINISHED"}


ViewOperator: Final = _class(
    "ViewOperator",
    bpy.types.Operator,
    {},
    {
        "__doc__": "Show the scene in the browser while it renders; once more, after a change, to update it",
        "bl_idname": "clrender.view",
        "bl_label": "Open in clrender view",
        "execute": _open_view,
    },
)

_CLASSES: Final = (Settings, Preferences, RenderEngine, RenderPanel, ViewOperator)


def _panels() -> Iterator[Any]:
    """Panels of Blender that serve this engine, too."""
    waiting = list(bpy.types.Panel.__subclasses__())
    while waiting:
        panel = waiting.pop()
        waiting += panel.__subclasses__()
        engines, name = getattr(panel, "COMPAT_ENGINES", ()), panel.__name__
        if name in _SHARED or ("BLENDER_RENDER" in engines and not name.startswith(_OTHERS)):
            yield panel


def register() -> None:
    """Add the engine, its settings and its panels."""
    for each in _CLASSES:
        bpy.utils.register_class(each)
    bpy.types.Scene.clrender = bpy.props.PointerProperty(type=Settings)
    for panel in _panels():
        panel.COMPAT_ENGINES.add(ENGINE)
    atexit.register(_VIEW.close)


def unregister() -> None:
    """Remove them again."""
    atexit.unregister(_VIEW.close)
    _VIEW.close()
    for panel in _panels():
        panel.COMPAT_ENGINES.discard(ENGINE)
    del bpy.types.Scene.clrender
    for each in reversed(_CLASSES):
        bpy.utils.unregister_class(each)
