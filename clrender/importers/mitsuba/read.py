"""Reads a Mitsuba scene into a draft."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

from clrender.exact.matrices import length
from clrender.importers.asset_files import AssetFiles
from clrender.importers.choices import Choices
from clrender.importers.draft import Draft
from clrender.importers.mitsuba.emitters import EmitterReader
from clrender.importers.mitsuba.fields_of_view import vertical_field
from clrender.importers.mitsuba.materials import MaterialReader
from clrender.importers.mitsuba.media import MediumReader
from clrender.importers.mitsuba.plugins import Plugin
from clrender.importers.mitsuba.shapes import ShapeReader
from clrender.importers.mitsuba.textures import TextureReader
from clrender.importers.mitsuba.tree import scene_tree
from clrender.importers.mitsuba.xml_elements import FILE_LIMIT
from clrender.importers.shared.cameras import camera_keys
from clrender.importers.shared.matrices import is_affine
from clrender.importers.shared.motions import fault_of_motion
from clrender.importers.shared.normal_maps import with_green_across
from clrender.importers.shared.staging import Staging
from clrender.settings import SPP_LIMIT
from clrender.wording import quoted

__all__ = ["read"]

_CAMERAS: Final = ("perspective", "thinlens", "orthographic")
_PATHS: Final = frozenset(["path", "volpath", "volpathmis", "prb", "prbvolpath", "mlt", "pssmlt", "erpt"])
_BIDIRECTIONAL: Final = frozenset(["bdpt", "ptracer"])
_PHOTON_MAPS: Final = frozenset(["photonmapper", "ppm", "sppm"])
_FILTERS: Final = {"box": ("radius", 0.5, 1.0), "tent": ("radius", 1.0, 1.0), "gaussian": ("stddev", 0.5, 3.0)}
"""Pixel filters that we have too, each with the parameter that stretches it, its default and our radius over it."""
_MITCHELL: Final = 1.0 / 3.0
_NEAR_FILTER: Final = {"catmullrom": "mitchell", "lanczos": "mitchell", "windowedsinc": "mitchell"}


def read(path: Path, files: AssetFiles, choices: Choices | None = None) -> Draft:
    """The scene of an XML file.

    Parameters
    ----------
    path : pathlib.Path
    files : AssetFiles
    choices : Choices, optional
        Values of its parameters.

    Raises
    ------
    SceneError
        It is not a valid scene; the message names the line.
    """
    staging = Staging(files)
    scene, old = scene_tree(files.scene(path, FILE_LIMIT), files, staging.note, (choices or Choices()).define)
    textures = TextureReader(staging, old)
    materials = MaterialReader(staging, textures, old)
    media = MediumReader(staging, textures)
    shapes, emitters = ShapeReader(staging, textures, materials, media, old), EmitterReader(staging, textures)
    for plugin in scene.children:
        if plugin.kind == "shape":
            shapes.read(plugin)
        elif plugin.kind == "emitter":
            emitters.read(plugin)
    _Settings(staging, media, shapes.moves or emitters.moves).read(scene)
    fog = staging.draft.description.get("fog")
    if fog is not None:
        for shape in shapes.unfilled:
            shape["interior"] = fog
    elif shapes.unfilled and media.bounded:
        staging.note_empty_glass()
    with_green_across(staging)
    return staging.draft


class _Settings:
    """Camera, size of the image, and default render settings."""

    def __init__(self, staging: Staging, media: MediumReader, moves: bool) -> None:
        self._staging, self._media, self._moves = staging, media, moves

    def read(self, scene: Plugin) -> None:
        sensors, integrators = scene.children_of("sensor"), scene.children_of("integrator")
        if len(sensors) > 1:
            self._staging.note(f"of {len(sensors)} sensors only the first one is read")
        if sensors:
            self._sensor(sensors[0])
        if integrators:
            self._integrator(integrators[0])

    def _hide_lights(self) -> None:
        """Hide from the camera what shines."""
        description = self._staging.draft.description
        materials = description["materials"]
        for shape in description["shapes"]:
            material = materials.get(shape.get("material"), {})
            passes = material.get("type") in ("dielectric", "subsurface") or material.get("transmission", 0.0) != 0.0
            solid = passes and not material.get("thin")
            if "emission" in shape and (solid or "interior" in shape):
                self._staging.note("a light with an inside is seen although the file hides lights")
            elif "emission" in shape:
                shape["visible_to_camera"] = False
        for light in description["lights"]:
            if light["type"] in ("environment", "sun_sky"):
                light["visible_to_camera"] = False

    def _tell_unused(self, plugin: Plugin) -> None:
        for name in plugin.unused():
            self._staging.note(f"{quoted(name)} of {plugin.label} is not understood and does nothing")

    def _render(self) -> dict[str, Any]:
        made: dict[str, Any] = self._staging.draft.description.setdefault("render", {})
        return made

    def _sensor(self, plugin: Plugin) -> None:
        width, height = self._film(plugin)
        for sampler in plugin.children_of("sampler"):
            if sampler.has("sample_count"):
                self._render()["spp"] = min(max(sampler.whole("sample_count", 4), 1), SPP_LIMIT)
        if plugin.type not in _CAMERAS:
            self._staging.note(f"{plugin.label} is not known: another camera in its place")
            return
        matrix = plugin.matrix()
        if not is_affine(matrix):
            raise plugin.fault("the camera's to_world is no affine transform that can be inverted; give it another")
        plugin.ignore("near_clip", "far_clip", "srf", "shutter_open", "shutter_close")
        motion = self._motion(plugin)
        distance = plugin.number("focus_distance", 1.0) if plugin.has("focus_distance") else None
        camera = camera_keys(matrix, rightward=False, distance=distance if plugin.type == "thinlens" else None)
        if plugin.type == "orthographic":
            # The image is 2 wide before the transform
            size = 2.0 * length(matrix[:3, 1]) * height / width
            if abs(length(matrix[:3, 0]) - length(matrix[:3, 1])) > 1e-6 * length(matrix[:3, 1]):
                self._staging.note("an orthographic camera that its transform scales differently along x has that of y")
            camera |= {"type": "orthographic", "height": size}
        else:
            camera["vertical_fov"] = vertical_field(plugin, width, height)
        if motion:
            camera["motion"] = motion
        if motion or self._moves:
            camera |= _shutter(plugin)
        shift = [plugin.number("principal_point_offset_x", 0.0), -plugin.number("principal_point_offset_y", 0.0)]
        if any(shift):
            camera["lens_shift"] = shift
        if plugin.type == "thinlens":
            camera["aperture_radius"] = plugin.number("aperture_radius", 0.1)
            camera["focus_distance"] = distance if distance is not None else 1.0
        medium = plugin.child("medium") or next(iter(plugin.children_of("medium")), None)
        name = None if medium is None else self._media.name(medium)
        if name is not None and name not in self._media.bounded:
            self._staging.fog(name)
        self._staging.draft.description["camera"] = camera
        self._tell_unused(plugin)

    def _motion(self, plugin: Plugin) -> list[dict[str, Any]]:
        """The value of ``motion`` of the camera; empty if it rests."""
        keys = plugin.keys()
        if fault_of_motion("camera", [matrix for _, matrix in keys]):
            self._staging.note("a motion makes the camera flat on its way: it stands where it is at first")
            return []
        ends = [{"time": time, **camera_keys(matrix, rightward=False)} for time, matrix in keys]
        for end in ends:
            end.pop("mirrored", None)  # equal for all, and a key of the camera
        return ends

    def _film(self, sensor: Plugin) -> tuple[int, int]:
        films = sensor.children_of("film")
        width, height = 768, 576
        if films:
            film = films[0]
            width, height = film.whole("width", 768), film.whole("height", 576)
            if film.has("crop_width", "crop_height", "crop_offset_x", "crop_offset_y"):
                self._staging.note("the crop of the film is left out: the whole image is rendered")
            self._filter(film)
        if not (1 <= width <= 65536 and 1 <= height <= 65536):
            raise (films[0] if films else sensor).fault(
                f"the film's size is {width} x {height}, but must be 1 to 65536"
            )
        self._staging.draft.description["image"] = {"width": width, "height": height}
        return width, height

    def _filter(self, film: Plugin) -> None:
        kinds = film.children_of("rfilter")
        kind = kinds[0].type if kinds else "gaussian"
        near = kind if kind in (*_FILTERS, "mitchell") else _NEAR_FILTER.get(kind, "box")
        self._render()["filter"] = near
        if kind != near:
            self._staging.note(f"the pixel filter {quoted(kind)} is not known: {quoted(near)} in its place")
        elif kind == "mitchell":
            for name in ("B", "C"):
                given = kinds[0].number(name, _MITCHELL)
                if abs(given - _MITCHELL) > 1e-3:
                    self._staging.note(f'the pixel filter "mitchell" has a {name} of {given:g}: 1/3 in its place')
        elif kinds:
            name, default, radius = _FILTERS[kind]
            self._render().update(self._staging.pixel_filter(kind, radius * kinds[0].number(name, default)))

    def _integrator(self, plugin: Plugin) -> None:
        inner = plugin.children_of("integrator")
        if inner and plugin.type not in _PATHS:
            plugin = inner[0]  # additional outputs are options of the command line here
        if plugin.type == "direct":
            self._render()["max_depth"] = 1
        elif plugin.type in _PHOTON_MAPS:
            self._render()["integrator"] = "photon"
        elif plugin.type in _BIDIRECTIONAL:
            self._render()["integrator"] = "bdpt"
        elif plugin.type not in _PATHS:
            self._staging.note(f'{plugin.label} is read as "path"')
        depth = plugin.whole("max_depth", -1)
        if depth == 0:
            self._staging.note("a max_depth of 0, which shows nothing, is read as 1")
        if depth >= 0:
            self._render()["max_depth"] = max(depth - 1, 0)
        if plugin.flag("hide_emitters", False):
            self._hide_lights()


def _shutter(sensor: Plugin) -> dict[str, Any]:
    """When the shutter of a camera that sees motions is open."""
    opens = sensor.number("shutter_open", 0.0)
    closes = sensor.number("shutter_close", opens)
    if closes < opens:
        raise sensor.fault(f"the shutter closes at {closes:g}, before it opens at {opens:g}; exchange the two")
    return {"shutter": [opens, closes]} if opens < closes else {"time": opens}
