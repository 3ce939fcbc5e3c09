"""Punctual lights (KHR_lights_punctual), in radiometric units."""

from __future__ import annotations

import math
from typing import Any, Final

from clrender.exact.angles import sin_cos
from clrender.importers.gltf.document import Document
from clrender.importers.gltf.matrices import Matrix
from clrender.importers.gltf.motion import NodeMotion
from clrender.importers.gltf.nodes import Nodes

__all__ = ["LUMENS_PER_WATT", "add_lights"]

LUMENS_PER_WATT: Final = 683.0
"""Conversion of candela and lux; as for IES lights, 683 cd is 1 W/sr in each channel."""
_LEAST_CONE: Final = 0.01


def add_lights(document: Document, nodes: Nodes, motion: NodeMotion) -> None:
    """Add the lights of the scene to the draft's description."""
    lights = (document.extension(document.root, "KHR_lights_punctual") or {}).get("lights", [])
    for index in nodes.shown:
        place = document.extension(document.items("nodes")[index], "KHR_lights_punctual")
        if place is not None:
            at = f"/extensions/KHR_lights_punctual/lights/{place['light']}"
            made = _made(document, lights[place["light"]], motion.start(index), at)
            if made is not None:
                if keys := motion.rigid_keys(index):
                    made["motion"] = keys
                document.draft.description["lights"].append(made)
                text = "its lights are in candela and lux; 683 of them are 1 W/sr and 1 W/m2"
                document.note(f"{text}, so use --exposure where the image is dark")


def _made(document: Document, light: dict[str, Any], world: Matrix, at: str) -> dict[str, Any] | None:
    kind = light.get("type")
    if kind is None:
        document.note(f"{at} was left out: its type is not known")
        return None
    strength = light.get("intensity", 1.0) / LUMENS_PER_WATT
    color = [min(strength * share, 1e12) for share in light.get("color", [1.0] * 3)]
    position = [world[row][3] for row in range(3)]
    direction = [-world[row][2] for row in range(3)]
    if kind != "point" and not any(direction):
        document.note(f"{at} was left out: its node's transform leaves it no direction")
        return None
    if kind == "directional":
        return {"type": "directional", "direction": direction, "irradiance": color}
    if "range" in light:
        document.note(f"{at}/range was left out: light falls off with the square of the distance, without end")
    if kind == "point":
        return {"type": "point", "position": position, "intensity": color}
    spot = light.get("spot", {})
    outer = min(spot.get("outerConeAngle", math.pi / 4.0), math.pi / 2.0)
    inner = spot.get("innerConeAngle", 0.0)
    if inner >= outer:
        document.note(f"{at}/spot/innerConeAngle is not below outerConeAngle; the edge is sharp")
        inner = outer
    # The fraction of the cone's solid angle that is not fully lit
    lit, edge = sin_cos(inner)[1], sin_cos(outer)[1]
    blend = (lit - edge) / (1.0 - edge) if outer > 1e-6 else 0.0
    return {
        "type": "spot",
        "position": position,
        "direction": direction,
        "intensity": color,
        "cone_degrees": max(math.degrees(2.0 * outer), _LEAST_CONE),
        "blend": min(max(blend, 0.0), 1.0),
    }
