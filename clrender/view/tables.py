"""Contents of messages to the page: settings, layers, devices, scene and state, as JSON-able values."""

from __future__ import annotations

import importlib.util
from collections.abc import Collection, Mapping, Sequence
from typing import Any, Final, TypeVar

from clrender.errors import ClrenderError
from clrender.extras import install_command
from clrender.image.exposure import photographic_stops
from clrender.image.tone_map import TONE_MAPS
from clrender.integrators import INTEGRATORS
from clrender.settings import IMAGE, SETTINGS
from clrender.version import __version__
from clrender.view.edited_scene import NOT_LIVE, EditedScene, camera_toml, pose_as_opened
from clrender.view.environments import environment_told
from clrender.view.frames import LAYERS
from clrender.view.lights import ADDED, emitter_parameters, label_of
from clrender.view.messages import MESSAGE_BYTES, PROTOCOL
from clrender.view.parameters import parameters

__all__ = ["MOST_MATERIALS", "devices", "hello", "scene", "state"]

MOST_MATERIALS: Final = 500
"""Materials that are listed, besides those that were picked or edited; a probe of a pixel has any other."""
_MOST_LIGHTS: Final = 200
"""Lights and shining shapes that are listed, besides the environment and those that were edited or added."""

_Part = TypeVar("_Part")


def hello(known: Sequence[dict[str, Any]], saves: Sequence[str], look: Mapping[str, Any]) -> dict[str, Any]:
    """What does not change while a view runs.

    Parameters
    ----------
    known : sequence of dict
        As of `devices`; empty while they are being looked for.
    saves : sequence of str
        Names of files that may be written.
    look : mapping
        ``tone_map`` and ``exposure`` with which pages begin.
    """
    needs = {"stderr": "replicates", "error": "replicates"}
    no_denoiser = importlib.util.find_spec("pyoidn") is None
    if no_denoiser:
        needs["denoised"] = "denoise"
    return {
        "protocol": PROTOCOL,
        "version": __version__,
        "settings": [
            {
                "name": name,
                "group": setting.group,
                "help": setting.help,
                "default": setting.default,
                "default_words": setting.default_words,
                "schema": setting.schema(),
                "integrator": setting.integrator,
                "restarts": setting.group == IMAGE,
            }
            for name, setting in SETTINGS.items()
            if name not in NOT_LIVE
        ],
        "integrators": [
            {
                "name": name,
                "bias": integrator.bias,
                "has_errors": integrator.has_errors,
                "leaves_out": list(integrator.leaves_out),
            }
            for name, integrator in INTEGRATORS.items()
        ],
        "devices": list(known),
        "layers": [
            {"name": name, "label": label, "kind": kind, "needs": needs.get(name, "")}
            for name, (label, kind) in LAYERS.items()
        ],
        "install_denoiser": install_command("denoise") if no_denoiser else "",
        "tone_maps": list(TONE_MAPS),
        "look": dict(look),
        "saves": list(saves),
        "light_kinds": list(ADDED),
        "limits": {"message_bytes": MESSAGE_BYTES},
    }


def devices() -> list[dict[str, Any]]:
    """The devices that work, probed if they were not yet; that may take a minute."""
    from clrender.drivers.probe import devices as all_devices

    try:
        found = all_devices()
    except ClrenderError:
        return []
    keys = ("index", "name", "platform", "type")
    return [{key: each[key] for key in keys} for each in found if each["probe"] == "ok"]


def scene(edited: EditedScene, also: Collection[str] = ()) -> dict[str, Any]:
    """What is in a scene, with the materials and lights as they are now.

    Parameters
    ----------
    edited : EditedScene
    also : collection of str
        Materials and places of lights that are listed in any case, as are those that differ from the scene file, and
        the environment.
    """
    now = edited.checked.scene
    shining, around = edited.emitters, edited.environment
    materials = _listed(now.materials, MOST_MATERIALS, {*edited.materials, *also})
    lights = _listed(shining, _MOST_LIGHTS, {*edited.lights, *also, around})
    return {
        "title": now.title,
        "source": now.source,
        "shapes": len(now.shapes),
        "lights": len(now.lights),
        "materials": {name: {"type": each.type, "parameters": parameters(each)} for name, each in materials.items()},
        "material_count": len(now.materials),
        "emitters": {
            place: {
                "label": label_of(place, each),
                "type": each.type,
                "parameters": emitter_parameters(each),
                "removable": place.startswith("lights") or not edited.is_own(place),
            }
            for place, each in lights.items()
        },
        "emitter_count": len(shining),
        "environment": None if around is None else {"place": around, **environment_told(shining[around])},
    }


def _listed(parts: Mapping[str, _Part], most: int, also: Collection[str | None]) -> dict[str, _Part]:
    """The first parts, and those of these names, in their order."""
    return {name: part for index, (name, part) in enumerate(parts.items()) if index < most or name in also}


def state(edited: EditedScene) -> dict[str, Any]:
    """Camera and settings as they are now."""
    settings = edited.checked.settings
    return {
        "width": settings.film_size[0],
        "height": settings.film_size[1],
        "camera": {
            **edited.camera.model_dump(mode="json", include=edited.camera.own_keys),
            **{name: list(each) for name, each in pose_as_opened(edited.camera).items()},
        },
        "camera_toml": camera_toml(edited.camera),
        "camera_stops": photographic_stops(**(edited.camera.exposure or {})),
        "settings": {name: getattr(settings, name) for name in SETTINGS if name not in NOT_LIVE},
        "changed": edited.edits,
    }
