"""A scene with the edits of viewers: to its camera, its materials, its lights and the settings."""

from __future__ import annotations

import contextlib
import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

from pydantic import ValidationError

from clrender.errors import ClrenderError, UsageError
from clrender.exporters.own import toml_text
from clrender.image.exposure import photographic_stops
from clrender.integrators import INTEGRATORS
from clrender.limits import nearest, shown
from clrender.rendering.job import RenderJob
from clrender.scene import Scene
from clrender.scene.camera import Camera
from clrender.scene.former_keys import present_keys
from clrender.scene.spectra import SpectralColor
from clrender.scene.validation_errors import scene_error
from clrender.settings import IMAGE, SETTINGS, present, settings_of
from clrender.view.environments import environment_light, is_environment
from clrender.view.lights import added_light, emitter_keys, emitters, free_place, place_of_shape, with_emitters
from clrender.view.parameters import changeable, is_plain

if TYPE_CHECKING:
    from clrender.scene.materials import Material
    from clrender.scene.values import Part
    from clrender.view.lights import Emitter

__all__ = ["NOT_LIVE", "POSE", "EditedScene", "camera_toml", "pose_as_opened"]

POSE: Final = ("position", "target", "up")
"""Keys of a camera that say where it is."""


NOT_LIVE: Final = ("time_limit", "max_memory", "traversal", "kernels", "code")
"""Settings that a page cannot change: somebody who watches stops by hand, and memory is the command line's affair."""

_ONLY_WITH: Final = {
    "termination": ("roulette", "constant"),
    "confidence": ("error", None),
    "share": ("error", None),
    "error_floor": ("error", None),
}
"""Settings that only count beside another: of this value, or (None) of any."""

_OF_ERRORS: Final = ("error", "replicate_spp")
"""Settings for estimates of errors, which biased integrators have none of."""


@dataclass(frozen=True)
class EditedScene:
    """A scene with edits, immutable: each edit returns another. `EditedScene.of` makes the first.

    Attributes
    ----------
    scene : Scene
        As it was read.
    given : mapping
        Settings of the command line, or of the call.
    camera : Camera
    materials : mapping
        Those that were changed.
    lights : mapping
        Lights and shining shapes that were changed, added, or (None) removed, by their places; see `with_emitters`.
    settings : mapping
        Those that were changed.
    checked : RenderJob
        All of it, but the camera may have moved since.
    """

    scene: Scene
    given: Mapping[str, Any]
    camera: Camera
    materials: Mapping[str, Material]
    lights: Mapping[str, Emitter | None]
    settings: Mapping[str, Any]
    checked: RenderJob

    @classmethod
    def of(cls, scene: Scene, given: Mapping[str, Any]) -> EditedScene:
        """A scene without edits.

        Raises
        ------
        UsageError, SceneError
            As of `RenderJob.of`.
        """
        return cls._made(scene, present(given), scene.camera, {}, {}, {})

    @classmethod
    def _made(
        cls,
        scene: Scene,
        given: Mapping[str, Any],
        camera: Camera,
        materials: Mapping[str, Material],
        lights: Mapping[str, Emitter | None],
        settings: Mapping[str, Any],
    ) -> EditedScene:
        changed = scene.changed({("materials", name): material for name, material in materials.items()})
        seen = changed if camera is scene.camera else changed.with_checked(camera=camera)
        checked = RenderJob.of(with_emitters(seen, lights), **_in_force(scene, given, settings))
        return cls(scene, given, camera, materials, lights, settings, checked)

    @property
    def asked(self) -> Mapping[str, Any]:
        """Settings of the command line and of viewers that have an effect together."""
        return _in_force(self.scene, self.given, self.settings)

    @property
    def job(self) -> RenderJob:
        """What is to be rendered."""
        scene = self.checked.scene
        if scene.camera is self.camera:
            return self.checked
        return dataclasses.replace(self.checked, scene=scene.with_checked(camera=self.camera))

    def moved(self, keys: Mapping[str, Any]) -> EditedScene:
        """With other keys of the camera; None stands for a key's default.

        A camera in motion that gets another place rests from then on, and has the rest of it from where it was as the
        shutter opened.

        Raises
        ------
        SceneError
            There is no such camera, or the integrator takes none that moves.
        """
        values = {name: getattr(self.camera, name) for name in self.camera.model_fields_set}
        if self.camera.motion and "motion" not in keys and any(name in keys for name in POSE):
            values |= {"motion": None, **pose_as_opened(self.camera)}
        values |= keys
        values = {name: value for name, value in values.items() if value is not None}
        try:
            camera = Camera.model_validate(values)
        except ValidationError as error:
            raise scene_error(error, Camera, "camera") from None
        if _timing(camera) == _timing(self.camera):
            return dataclasses.replace(self, camera=camera)
        # Not all integrators take what moves while the shutter is open
        return self._made(self.scene, self.given, camera, self.materials, self.lights, self.settings)

    def set(self, values: Mapping[str, Any]) -> EditedScene:
        """With other settings; None takes a change back. What no longer has an effect is forgotten.

        What the command line gave and the integrator does not take rests, until another one takes it.

        Raises
        ------
        UsageError, SceneError
            A name is unknown, or a value is not allowed or has no effect.
        """
        values = present(values)
        for name in values:
            if name not in SETTINGS or name in NOT_LIVE:
                near = nearest(name, [each for each in SETTINGS if each not in NOT_LIVE])
                raise UsageError(f"there is no setting {shown(name)} to change here{near}")
        settings = {**self.settings, **values}
        settings = {name: value for name, value in settings.items() if value is not None}
        merged = {**self.scene.render.model_dump(), **self.given, **settings}
        kept = _taken(settings, merged)
        kept |= {name: settings[name] for name in values if name in settings}
        return self._made(self.scene, self.given, self.camera, self.materials, self.lights, kept)

    def with_material(self, name: str, values: Mapping[str, Any]) -> EditedScene:
        """With other values of a material: numbers, colours, choices and truth values, and no files.

        Raises
        ------
        UsageError, SceneError
            There is no such material or key, or the value is not allowed.
        """
        material = self.checked.scene.materials.get(name)
        if material is None:
            raise UsageError(f"there is no material {shown(name)}{nearest(name, self.scene.materials)}")
        other = _with_values(material, values, changeable(material), f"materials.{name}")
        materials = {**self.materials, name: other}
        return self._made(self.scene, self.given, self.camera, materials, self.lights, self.settings)

    def with_light(self, name: str, values: Mapping[str, Any]) -> EditedScene:
        """With other values of a light or a shining shape: numbers, colours, places and truth values, and no files.

        Parameters
        ----------
        name : str
            Its place in the scene, such as ``lights[0]``.
        values : mapping

        Raises
        ------
        UsageError, SceneError
            There is no such light or key, or the value is not allowed.
        """
        known = self._emitter(name)
        return self._lit({**self.lights, name: _with_values(known, values, emitter_keys(known), name)})

    @property
    def emitters(self) -> Mapping[str, Emitter]:
        """Lights and shining shapes as they are now, by place."""
        return emitters(self.scene, self.lights)

    def _emitter(self, name: str) -> Emitter:
        known = self.emitters
        if name not in known:
            raise UsageError(f"there is no light {shown(name)}{nearest(name, known)}")
        return known[name]

    def _lit(self, lights: Mapping[str, Emitter | None]) -> EditedScene:
        return self._made(self.scene, self.given, self.camera, self.materials, lights, self.settings)

    def is_own(self, name: str) -> bool:
        """Whether a light or shining shape is of the scene file, and not added."""
        return name in emitters(self.scene)

    def place_of_shape(self, index: int) -> str:
        """The place of a shape, by its index in the scene as it is rendered."""
        return place_of_shape(self.scene, self.lights, index)

    def with_added_light(self, kind: str, position: Sequence[float] | None) -> tuple[EditedScene, str]:
        """With another light above a point (None: above what the camera looks at), and its place.

        Parameters
        ----------
        kind : str
            Of `clrender.view.lights.ADDED`.
        position : (float, float, float), optional
            Metres.
        """
        camera = self.camera.opened
        at = camera.target if position is None else position
        try:
            table, light = added_light(kind, at, camera, self._stops)
        except ValidationError as error:
            raise scene_error(error, Camera, "the light") from None
        name = free_place(self.scene, self.lights, table)
        return self._lit({**self.lights, name: light}), name

    def without_light(self, name: str) -> EditedScene:
        """Without a light, or an added lamp.

        Raises
        ------
        UsageError
            There is none of that name, or it is a shape of the scene file.
        """
        self._emitter(name)
        if not self.is_own(name):
            return self._lit({place: light for place, light in self.lights.items() if place != name})
        if name.startswith("shapes"):
            raise UsageError(f"{name} is a shape of the scene file; set its emission to 0 instead of removing it")
        return self._lit({**self.lights, name: None})

    @property
    def environment(self) -> str | None:
        """Place of the environment; None: there is none."""
        return next((name for name, light in self.emitters.items() if is_environment(light)), None)

    def with_environment(self, kind: str, file: str) -> EditedScene:
        """With another environment; see `clrender.view.environments`.

        Raises
        ------
        UsageError, SceneError
            There is no such file, or it cannot be read.
        """
        own = next((name for name, light in emitters(self.scene).items() if is_environment(light)), None)
        name = self.environment or own or free_place(self.scene, self.lights, "lights")
        others = {place: light for place, light in self.lights.items() if place != name}
        if kind == "scene":
            return self._lit(others)
        if kind == "none":
            return self._lit(others if own is None else {**others, name: None})
        before = self.emitters.get(name) or emitters(self.scene).get(name)  # removed: as the scene has it
        light = environment_light(kind, file, self.scene, before, self._stops)
        edited = self._lit({**others, name: light})
        edited.checked.scene.environment_picture()  # read now: it is refused where it cannot be
        return edited

    @property
    def _stops(self) -> float:
        return photographic_stops(**(self.camera.exposure or {}))

    def reset(self, what: str) -> EditedScene:
        """As in the scene and the command line again: ``camera``, ``settings``, ``materials`` or ``lights``."""
        camera = self.scene.camera if what == "camera" else self.camera
        materials = {} if what == "materials" else self.materials
        lights = {} if what == "lights" else self.lights
        settings = {} if what == "settings" else self.settings
        return self._made(self.scene, self.given, camera, materials, lights, settings)

    def reread(self, scene: Scene) -> EditedScene:
        """Of the scene as it is now: its camera counts if it has another one than before.

        Changed materials and lights are forgotten, unless what the scene consists of is the same. A changed setting
        that the scene does not take, such as a crop that is not within its image, is forgotten; if none is it alone,
        all are.

        Raises
        ------
        UsageError, SceneError
            It cannot be rendered with the settings of the command line.
        """
        camera = self.camera if scene.camera == self.scene.camera else scene.camera
        materials, lights = self.materials, self.lights
        if (materials or lights) and not _is_same(scene, self.scene):
            materials, lights = {}, {}

        def with_settings(settings: Mapping[str, Any]) -> EditedScene:
            return self._made(scene, self.given, camera, materials, lights, settings)

        with contextlib.suppress(ClrenderError):
            return with_settings(self.settings)
        bare = with_settings({})  # raises what the file itself is to blame for
        own = {**scene.render.model_dump(), **self.given}
        for without in self.settings:
            others = {name: value for name, value in self.settings.items() if name != without}
            with contextlib.suppress(ClrenderError):
                return with_settings(_taken(others, {**own, **others}))
        return bare

    @property
    def edits(self) -> list[str]:
        """What viewers have changed: ``camera``, names of settings, ``materials.NAME``, and places of lights."""
        return [
            *(["camera"] if self.camera != self.scene.camera else []),
            *sorted(self.settings),
            *(f"materials.{name}" for name in sorted(self.materials)),
            *sorted(self.lights),
        ]

    def ended(self, before: EditedScene) -> list[str]:
        """Edits of a scene before that this one has no more; a camera that is the same has not ended."""
        left = {*self.edits, *(["camera"] if self.camera == before.camera else [])}
        return [name for name in before.edits if name not in left]

    def restarts(self, other: EditedScene) -> bool:
        """Whether another edited scene has another image, of which samples are of no use here."""
        a, b = self.checked.settings, other.checked.settings
        names = [name for name, setting in SETTINGS.items() if setting.group == IMAGE]
        return (
            any(getattr(a, name) != getattr(b, name) for name in names)
            or self.camera != other.camera
            or self.scene is not other.scene
            or self.materials != other.materials
            or self.lights != other.lights
        )


def _is_same(scene: Scene, other: Scene) -> bool:
    """Whether two scenes consist of the same, but for camera, image and settings."""
    return scene.plugins == other.plugins and scene.content_sha256() == other.content_sha256()


def _timing(camera: Camera) -> tuple[Any, ...]:
    """What of a camera decides which integrators take it."""
    return camera.motion, camera.interval, camera.row_share


def _in_force(scene: Scene, given: Mapping[str, Any], settings: Mapping[str, Any]) -> dict[str, Any]:
    """Settings of the command line, as far as they count beside those of viewers, and those."""
    if not settings:
        return dict(given)  # all: one without an effect is refused, as by `clrender render`
    return {**_taken(given, {**scene.render.model_dump(), **given, **settings}), **settings}


def _taken(values: Mapping[str, Any], merged: Mapping[str, Any]) -> dict[str, Any]:
    """Of some settings those that the integrator takes and that have an effect beside all others.

    Parameters
    ----------
    values : mapping
    merged : mapping
        All settings, these among them.
    """
    integrator = INTEGRATORS.get(str(merged["integrator"]))
    if integrator is None:
        return dict(values)
    kept = {
        name: value
        for name, value in settings_of(str(merged["integrator"]), values).items()
        if value in integrator.takes.get(name, (value,))
        if integrator.has_errors or name not in _OF_ERRORS
        if integrator.specular_chains or name != "specular_chains"
    }
    for name, (other, value) in _ONLY_WITH.items():
        there = merged.get(other) if integrator.has_errors or other not in _OF_ERRORS else None
        if there is None or (value is not None and there != value):
            kept.pop(name, None)
    if merged.get("guiding") == "off":
        for name in ("guiding_paths", "guiding_memory"):
            kept.pop(name, None)
    return kept


def pose_as_opened(camera: Camera) -> dict[str, Any]:
    """`POSE` of a camera as the shutter opens: what a view shows, and what its moves begin with."""
    opened = camera.opened
    return {name: getattr(opened, name) for name in POSE}


def camera_toml(camera: Camera) -> str:
    """The table of a scene file."""
    return toml_text({"camera": camera.model_dump(mode="json", exclude_none=True, exclude_unset=True)})


def _with_values(part: Part, values: Mapping[str, Any], allowed: Sequence[str], at: str) -> Any:
    """A table of the scene with other numbers, colours, names and truth values; of a spectrum another factor.

    Raises
    ------
    UsageError, SceneError
        There is no such key, or the value is not allowed.
    """
    values = dict(present_keys(type(part), values, at))
    for key, value in tuple(values.items()):
        if key not in allowed:
            raise UsageError(f"{at}: {shown(key)} cannot be changed here{nearest(key, allowed)}")
        if not is_plain(value):
            raise UsageError(f"{at}.{key} is {shown(value)}, but must be a number, a colour or a name")
        color = getattr(part, key)
        if isinstance(color, SpectralColor) and value is not None:
            if isinstance(value, bool) or not isinstance(value, int | float):
                raise UsageError(
                    f"{at}.{key} is a spectrum, which {shown(value)} would replace; give a number, its factor"
                )
            values[key] = {**color.spectrum.model_dump(exclude_unset=True), "scale": value}
    merged: dict[str, Any] = {key: getattr(part, key) for key in part.model_fields_set}
    merged = {key: value for key, value in {**merged, **values}.items() if key not in values or value is not None}
    try:
        return type(part).model_validate(merged)
    except ValidationError as error:
        raise scene_error(error, type(part), at) from None
