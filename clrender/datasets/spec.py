"""What a file that describes a data set may say: the validated model."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Annotated, Any, Final, Literal, TypeAlias

from pydantic import (
    AfterValidator,
    BeforeValidator,
    Discriminator,
    Field,
    Strict,
    Tag,
    ValidationError,
    model_validator,
)

from clrender.aov import check_aovs
from clrender.datasets.values import checked_value
from clrender.errors import SceneError, UsageError
from clrender.limits import checked_path
from clrender.scene.load import parsed_file
from clrender.scene.validation_errors import scene_error
from clrender.scene.values import FileName, Finite, Flag, Name, Part, Share, Vector, fault
from clrender.sensor import Sensor
from clrender.settings import SETTINGS
from clrender.wording import printable, quoted, shown, suggestion

__all__ = ["WRITERS", "CameraTable", "DistractorTable", "ObjectTable", "SensorTable", "Spec", "load_spec"]

WRITERS: Final = ("images", "coco", "bop", "transforms", "webdataset")
"""Names of what a data set may be written as."""

_OWN: Final = {"size": "size", "width": "size", "height": "size", "seed": "seed", "time_limit": "spp", "crop": "size"}
"""Settings that a data set has elsewhere, or not at all, and what to use."""
_OF_CAMERAS: Final = {
    "distance": ("sphere", "hemisphere"),
    "elevation_degrees": ("sphere", "hemisphere"),
    "azimuth_degrees": ("sphere", "hemisphere"),
    "position": ("box",),
    "file": ("file",),
    "order": ("file",),
}
_NEEDED: Final = {"sphere": "distance", "hemisphere": "distance", "box": "position", "file": "file"}

Value: TypeAlias = Annotated[Any, AfterValidator(checked_value)]
"""A value of a scene file, or distributions in its place."""
_Degrees = Annotated[Finite, Field(ge=-360.0, le=360.0)]
_Whole = Annotated[int, Strict()]


class CameraTable(Part):
    """Where the camera is: that of the scene; on a shell around a target; in a box; or the cameras of a file."""

    type: Literal["scene", "sphere", "hemisphere", "box", "file"] = "scene"
    target: Value = None
    distance: Value = None
    elevation_degrees: tuple[_Degrees, _Degrees] | None = None
    azimuth_degrees: tuple[_Degrees, _Degrees] = (0.0, 360.0)
    position: Value = None
    file: FileName | None = None
    order: Literal["sequence", "random"] = "sequence"
    roll_degrees: Value = 0.0

    @model_validator(mode="after")
    def _has_what_its_type_has(self) -> CameraTable:
        needed = _NEEDED.get(self.type)
        if needed is not None and getattr(self, needed) is None:
            raise fault("camera", f"the key `{needed}` is missing; cameras of type {self.type} need it")
        for key in self.model_fields_set & _OF_CAMERAS.keys():
            if self.type not in _OF_CAMERAS[key]:
                types = " and ".join(_OF_CAMERAS[key])
                raise fault("camera", f"is for cameras of type {types} only; leave it out", key)
        low, high = self.elevations
        if not -90.0 <= low <= high <= 90.0:
            raise fault("camera", "must be two angles from -90 to 90, the smaller first", "elevation_degrees")
        return self

    @property
    def elevations(self) -> tuple[float, float]:
        """Smallest and largest elevation above the horizon, degrees."""
        return self.elevation_degrees or ((0.0, 90.0) if self.type == "hemisphere" else (-90.0, 90.0))


class _Placed(Part):
    """How something is placed: scaled and rotated about its pivot, which comes to `position`."""

    position: Value = None
    yaw_degrees: Value = 0.0
    rotate_degrees: Value = None
    rotation: Literal["any"] | None = None
    scale: Value = 1.0
    pivot: Vector = (0.0, 0.0, 0.0)

    @model_validator(mode="after")
    def _turns_in_one_way(self) -> _Placed:
        given = [key for key in ("rotation", "rotate_degrees") if getattr(self, key) is not None]
        given += ["yaw_degrees"] if "yaw_degrees" in self.model_fields_set and self.rotation else []
        if self.rotation and len(given) > 1:
            raise fault("object", 'is given beside rotation = "any"; leave one of them out', given[1])
        return self


def _several(value: Any) -> Any:
    return [value] if isinstance(value, str) else value


class ObjectTable(_Placed):
    """Objects of the scene that stand elsewhere in each image, or in some images only."""

    name: Annotated[tuple[Name, ...], BeforeValidator(_several), Field(min_length=1)]
    group: Value = None
    present: Share = 1.0


class DistractorTable(_Placed):
    """Instances of groups that are added to the scene."""

    groups: Annotated[tuple[Name, ...], Field(min_length=1)]
    count: Value = 1
    category: Name | None = None


class SensorTable(Part):
    """A camera's sensor; see `clrender.Sensor`."""

    full_well: Finite = 20000.0
    exposure: Finite = 0.0
    read_noise: Finite = 2.0
    shot_noise: Flag = True
    bits: _Whole = 12
    black_level: _Whole = 0
    gain: Finite | None = None
    bayer: str | None = None
    demosaic: Flag = True
    encoding: str = "linear"

    @model_validator(mode="after")
    def _is_a_sensor(self) -> SensorTable:
        try:
            self.sensor()
        except UsageError as error:
            key, _, rest = str(error).partition(" ")
            raise fault("sensor", rest, key) from None
        return self

    def sensor(self) -> Sensor:
        """The sensor."""
        return Sensor(**self.model_dump())


_Environment: TypeAlias = Annotated[
    Annotated[FileName, Tag("<file>")] | Annotated[Finite, Tag("<radiance>")],
    Discriminator(lambda value: "<file>" if isinstance(value, str) else "<radiance>"),
]


class LoadTable(Part):
    """How the scene is read; see `clrender.load`."""

    environment: _Environment | None = None
    time_at: Finite | None = None
    shutter: tuple[Finite, Finite] | None = None
    variant: str | None = None
    up: Literal["y", "z"] | None = None
    define: dict[str, str] | None = None
    hide_environment: Flag = False


class Spec(Part):
    """A data set."""

    scene: FileName
    images: Annotated[int, Strict(), Field(ge=1, le=10**9)]
    seed: Annotated[int, Strict(), Field(ge=0, lt=2**32)] = 0
    size: Annotated[tuple[_Whole, ...], Field(min_length=2, max_length=2)] | None = None
    writers: Annotated[tuple[str, ...], Field(min_length=1)] = ("images",)
    layers: tuple[str, ...] = ()
    amodal: Flag = False
    categories: Annotated[tuple[Name, ...], Field(min_length=1)] | None = None
    up: Literal["x", "y", "z"] = "y"
    exposure: Annotated[Finite, Field(ge=-64.0, le=64.0)] = 0.0
    depth_scale: Annotated[Finite, Field(gt=0.0, le=1e6)] = 1.0
    images_per_shard: Annotated[int, Strict(), Field(ge=1, le=10**6)] = 1000
    load: LoadTable = LoadTable()
    render: dict[str, Any] = Field(default_factory=dict)
    camera: CameraTable = CameraTable()
    vary: dict[str, Value] = Field(default_factory=dict)
    objects: tuple[ObjectTable, ...] = ()
    distractors: tuple[DistractorTable, ...] = ()
    sensor: SensorTable | None = None

    @model_validator(mode="after")
    def _names_are_known(self) -> Spec:
        for index, name in enumerate(self.writers):
            if name not in WRITERS:
                sentence = f"is {quoted(name)}, which is not known{suggestion(name, WRITERS)}"
                raise fault("spec", sentence, "writers", index)
        try:
            check_aovs(self.layers)
        except UsageError as error:
            raise fault("spec", f"names {str(error).partition(': ')[2]}", "layers") from None
        for name in self.render:
            if name in _OWN:
                sentence = f"is not set here; use {_OWN[name]}, so that an image depends on its number only"
                raise fault("spec", sentence, "render", name)
            if name not in SETTINGS:
                raise fault("spec", f"is an unknown setting{suggestion(name, SETTINGS)}", "render", name)
        if self.categories is not None and len(set(self.categories)) < len(self.categories):
            raise fault("spec", "has a name twice; keep one of them", "categories")
        names = [name for each in self.objects for name in each.name]
        for name in names:
            if names.count(name) > 1:
                raise fault("spec", f"place {quoted(name)} twice; keep one of them", "objects")
        return self

    def content(self) -> dict[str, Any]:
        """All that it says beyond the defaults, JSON-able."""
        found: dict[str, Any] = self.model_dump(mode="json", exclude_defaults=True)
        return found

    def sha256(self) -> str:
        """Hash of all that it says, independent of spelling."""
        return hashlib.sha256(json.dumps(self.content(), sort_keys=True, separators=(",", ":")).encode()).hexdigest()

    @classmethod
    def of(cls, content: Any, source: str) -> Spec:
        """A data set as a file says it.

        Parameters
        ----------
        content : mapping
        source : str
            Name of the file in messages.

        Raises
        ------
        SceneError
            It is no data set: file, place, problem and cure.
        """
        if not isinstance(content, Mapping):
            raise SceneError(f"{source}: is {shown(content)}, but must be a table")
        try:
            return cls.model_validate(dict(content))
        except ValidationError as error:
            raise scene_error(error, cls, source) from None


def load_spec(path: str | Path, writers: Iterable[str] | None = None) -> Spec:
    """Read a data set's file.

    Parameters
    ----------
    path : path
        `.toml` or `.json`.
    writers : iterable of str, optional
        In place of those of the file.

    Raises
    ------
    SceneError
        It cannot be read, or is not valid: file, place, problem and cure.
    """
    path = checked_path(path, "a data set")
    source = printable(str(path))
    if path.suffix.lower() not in (".toml", ".json"):
        raise SceneError(f"{source}: is no description of a data set; name a file that ends in .toml or .json")
    content = parsed_file(path, source, "the file of the data set")
    if writers is not None and isinstance(content, Mapping):
        content = {**content, "writers": list(writers)}
    return Spec.of(content, source)
