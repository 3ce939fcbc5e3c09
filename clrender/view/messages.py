"""What a page may say: one model for each type of message, with its limits."""

from __future__ import annotations

import functools
from typing import Annotated, Any, Final, Literal, TypeAlias

from pydantic import BaseModel, ConfigDict, Field, Strict, TypeAdapter, ValidationError

from clrender.errors import UsageError
from clrender.image.tone_map import TONE_MAPS
from clrender.meshes.data import COORDINATE_LIMIT
from clrender.view.environments import KINDS
from clrender.view.lights import ADDED
from clrender.wording import counted

__all__ = [
    "MESSAGE_BYTES",
    "PROTOCOL",
    "Ack",
    "AddLight",
    "CopyTable",
    "DeviceChoice",
    "Environments",
    "Message",
    "MoveCamera",
    "Outline",
    "Paths",
    "Probe",
    "Redo",
    "RemoveLight",
    "Reset",
    "Restart",
    "Run",
    "Save",
    "SetEnvironment",
    "SetLight",
    "SetMaterial",
    "SetSettings",
    "Show",
    "StopPaths",
    "Undo",
    "parse",
]

PROTOCOL: Final = 1
"""Number of the protocol, which `docs/view.md` describes."""

MESSAGE_BYTES: Final = 65536
"""Longest message of a page, as UTF-8."""

_Whole = Annotated[int, Strict(), Field(ge=0, le=2**53)]
_Text = Annotated[str, Strict(), Field(max_length=200)]
_Exposure = Annotated[float, Strict(), Field(ge=-128.0, le=128.0, allow_inf_nan=False)]
_ToneMap: TypeAlias = Literal[tuple(TONE_MAPS)]  # type: ignore[valid-type]  # the table of tone maps


_Metres = Annotated[float, Field(ge=-COORDINATE_LIMIT, le=COORDINATE_LIMIT, allow_inf_nan=False)]
_LightKind: TypeAlias = Literal[tuple(ADDED)]  # type: ignore[valid-type]  # the list of kinds
_EnvironmentKind: TypeAlias = Literal[tuple(KINDS)]  # type: ignore[valid-type]  # as above


class Message(BaseModel):
    """What all have in common."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    id: _Whole | Annotated[str, Strict(), Field(max_length=64)] | None = None


class MoveCamera(Message):
    """Replace keys of the camera."""

    type: Literal["camera"]
    camera: Annotated[dict[_Text, Any], Field(max_length=32)]


class SetSettings(Message):
    """Replace settings."""

    type: Literal["set"]
    settings: Annotated[dict[_Text, Any], Field(max_length=64)]


class DeviceChoice(Message):
    """Render on another device."""

    type: Literal["device"]
    device: _Whole | _Text


class SetMaterial(Message):
    """Change keys of a material."""

    type: Literal["material"]
    name: _Text
    values: Annotated[dict[_Text, Any], Field(max_length=64)]


class SetLight(Message):
    """Change keys of a light, or of a shape that shines."""

    type: Literal["light"]
    name: _Text
    values: Annotated[dict[_Text, Any], Field(max_length=64)]


class AddLight(Message):
    """Add a light above a point."""

    type: Literal["add_light"]
    kind: _LightKind
    position: Annotated[tuple[_Metres, _Metres, _Metres], Field()] | None = None


class RemoveLight(Message):
    """Remove a light, or an added lamp."""

    type: Literal["remove_light"]
    name: _Text


class SetEnvironment(Message):
    """Replace the environment."""

    type: Literal["environment"]
    kind: _EnvironmentKind
    file: _Text = ""


class Environments(Message):
    """Tell which files there are to choose an environment from."""

    type: Literal["environments"]


class Reset(Message):
    """Take back what was changed."""

    type: Literal["reset"]
    what: Literal["camera", "settings", "materials", "lights"]


class Undo(Message):
    """Take back the last edit."""

    type: Literal["undo"]


class Redo(Message):
    """Do again what was undone last."""

    type: Literal["redo"]


class CopyTable(Message):
    """Tell a table of the scene as it is now, or the settings as a command line."""

    type: Literal["copy"]
    what: Literal["camera", "settings", "material", "light"]
    name: _Text = ""


class Run(Message):
    """Go on, or stop."""

    type: Literal["run"]
    run: Annotated[bool, Strict()]


class Restart(Message):
    """Begin the image anew."""

    type: Literal["restart"]


class Probe(Message):
    """Tell what is known of a pixel."""

    type: Literal["probe"]
    x: _Whole
    y: _Whole


class Paths(Message):
    """Trace the light paths of a pixel."""

    type: Literal["paths"]
    x: _Whole
    y: _Whole
    samples: Annotated[int, Strict(), Field(ge=1, le=4096)] = 256


class StopPaths(Message):
    """Trace no more."""

    type: Literal["stop_paths"]


class Outline(Message):
    """Tell where an object is seen."""

    type: Literal["outline"]
    object: _Whole


class Show(Message):
    """What frames hold."""

    type: Literal["show"]
    layers: Annotated[tuple[_Text, ...], Field(min_length=1, max_length=3)]
    format: Literal["float16", "float32"] = "float16"
    max_side: Annotated[int, Strict(), Field(ge=16, le=8192)] = 2048


class Ack(Message):
    """A frame has arrived."""

    type: Literal["ack"]
    frame: _Whole


class Save(Message):
    """Write a file that the command line named."""

    type: Literal["save"]
    name: _Text
    tone_map: _ToneMap = "srgb"
    exposure: _Exposure = 0.0
    alpha: Annotated[bool, Strict()] = False


_Any: TypeAlias = (
    MoveCamera
    | SetSettings
    | DeviceChoice
    | SetMaterial
    | SetLight
    | AddLight
    | RemoveLight
    | SetEnvironment
    | Environments
    | Reset
    | Undo
    | Redo
    | CopyTable
    | Run
    | Restart
    | Probe
    | Outline
    | Paths
    | StopPaths
    | Show
    | Ack
    | Save
)


@functools.cache
def _adapter() -> TypeAdapter[_Any]:
    return TypeAdapter(Annotated[_Any, Field(discriminator="type")])


def parse(text: str) -> _Any:
    """A page's message.

    Parameters
    ----------
    text : str
        JSON.

    Raises
    ------
    UsageError
        It is none, in one sentence.
    """
    if len(text) > MESSAGE_BYTES or len(text.encode(errors="replace")) > MESSAGE_BYTES:
        raise UsageError(f"a message has at most {counted(MESSAGE_BYTES, 'byte')}")
    try:
        return _adapter().validate_json(text)
    except ValidationError as error:
        first = error.errors(include_url=False, include_input=False)[0]
        place = ".".join(str(step)[:40] for step in first["loc"][1:])
        sentence = first["msg"][:1].lower() + first["msg"][1:200]
        raise UsageError(f"{place}: {sentence}" if place else sentence) from None
