"""Random scenes of everything that a scene file may hold, in three kinds whose answer is known.

``python tests/statistics/mixed_scenes.py KIND NUMBER -o DIR`` writes one of them, with the files that it names.

What is added to the schema is added here: `test_mixed_scenes.py` fails if some key, type or word of it appears in no
scene.
"""

from __future__ import annotations

import argparse
import json
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import numpy as np
from mixed_files import files
from mixed_films import filmed
from mixed_measured import measured
from mixed_parts import Draw, Json, emission_for_white, medium
from mixed_plugins import PLUGINS, plugged
from mixed_shapes import Things
from mixed_spectra import spectral
from mixed_strands import stranded
from mixed_ways import has_delta_lights

from clrender.cameras.poses import CONVENTIONS, pose_matrix
from clrender.exact.matrices import inverse
from clrender.scene import Camera, Scene
from clrender.scene.poses import Transform
from clrender.scene.transforms import affine

__all__ = ["KINDS", "Mixed", "mixed_scene"]

KINDS: Final = ("white", "light", "black")
"""A white furnace, of radiance `Mixed.exact`; a scene whose image does not depend on strategies; a black one."""
_REACH: Final = 4.5
"""Half the size of rooms; cameras are within, things in the middle third of it."""
_LAMP_ROOM: Final = 0.8
"""Half the size of closed boxes with lamps in black scenes."""


@dataclass(frozen=True)
class Mixed:
    """A random scene.

    Attributes
    ----------
    name : str
        Kind and number.
    content : dict
        What a scene file says.
    exact : float or None
        Radiance of every pixel, if known.
    inner : bool
        Whether this holds for the middle half of the image only.
    """

    name: str
    content: Json
    exact: float | None = None
    inner: bool = False
    facts: Json = field(default_factory=dict)

    def scene(self, folder: Path) -> Scene:
        """The scene, with its files in a folder."""
        return Scene(**self.content).placed(self.name, folder).with_plugins(PLUGINS)

    def write(self, folder: Path) -> Path:
        """Write the scene and the files that it names; returns the scene's path."""
        folder.mkdir(parents=True, exist_ok=True)
        text = json.dumps(self.content, indent=1)
        for name, data in files().items():
            if json.dumps(name) in text:
                (folder / name).write_bytes(data)
        path = folder / f"{self.name.replace(' ', '-')}.json"
        path.write_text(text)
        return path


def mixed_scene(kind: str, number: int) -> Mixed:
    """The random scene of this kind and number.

    Parameters
    ----------
    kind : str
        One of `KINDS`.
    number : int
    """
    draw = Draw(f"{kind} {number}", kind == "white")
    mixed = {"white": _white, "light": _light, "black": _black}[kind](draw, f"{kind} {number}")
    _standing(mixed)
    _as_seen_by_machines(mixed.name, mixed.content["camera"])
    _grouped(mixed.name, mixed.content)
    _categorized(mixed.name, mixed.content)
    _moving(mixed)
    _uneven(mixed)
    _glowing(mixed)
    _dyed(mixed, kind == "white")
    stranded(mixed.name, mixed.content, kind == "white")
    measured(mixed.name, mixed.content, kind == "white", kind == "black")
    filmed(mixed.name, mixed.content, kind == "white")
    plugged(mixed.name, mixed.content)
    spectral(mixed.name, mixed.content, kind == "white")
    return mixed


_SOLID: Final = ("lambert", "oren_nayar", "conductor", "mirror")
"""Materials that have no inside."""


def _standing(mixed: Mixed) -> None:
    """Let a solid stand exactly on a small floor, below all else; by random numbers of their own.

    Not beside lights whose caustics some integrators do not find: there these are compared without mirrors and glass.
    """
    draw, content = Draw(f"standing in {mixed.name}", white=False), mixed.content
    if mixed.exact == 0.0 or has_delta_lights(content) or not draw.chance(0.4):
        return
    white = mixed.exact is not None
    x, _, z = draw.point(1.0)
    floor = {"type": "quad", "origin": [x - 1.5, -2.0, z + 1.5], "edge_u": [3.0, 0.0, 0.0], "edge_v": [0.0, 0.0, -3.0]}
    half = draw.between(0.4, 0.8)
    solid: Json = draw.one(
        (
            {"type": "sphere", "center": [x, half - 2.0, z], "radius": half},
            {"type": "box", "center": [x, half - 2.0, z], "size": [2.0 * half] * 3},
        )
    )
    made: Json = draw.one(
        ({"type": "dielectric", "ior": 1.5}, {"type": "mirror", "reflectance": 1.0 if white else 0.8})
    )
    content.setdefault("materials", {}).update(
        {"floor below": {"type": "lambert", "reflectance": [1.0 if white else 0.6] * 3}, "stands": made}
    )
    content["shapes"] += [{**floor, "material": "floor below"}, {**solid, "material": "stands"}]


def _moving(mixed: Mixed) -> None:
    """Move things and the camera while the shutter is open; by random numbers of their own."""
    draw, content = Draw(f"motion of {mixed.name}", white=False), mixed.content
    if not draw.chance(0.35):
        return
    begin = draw.between(-1.0, 1.0)
    camera = content["camera"]
    camera |= {"shutter": [begin, begin + draw.between(0.1, 1.0)]}
    camera |= {"time": draw.between(-9.0, 9.0)} if draw.chance(0.5) else {}
    middle = camera.get("time", 0.0) + begin + 0.2
    for shape in content["shapes"]:
        if _may_move(mixed, shape) and draw.chance(0.6):
            shape["motion"] = _keys(draw, middle)
    _grouped_moving(mixed, middle)
    _deforming(mixed, middle)
    _lamps_moving(mixed, middle)
    # Of a camera in a ball of its own the ball would stay behind
    if "position" in camera and "lens" not in content.get("materials", {}) and draw.chance(0.6):
        near = _plus(camera["position"], draw.point(0.1))
        keys = [{"position": camera["position"]}, {"position": near, "target": draw.point(0.3)}]
        keys[1] |= {"up": camera["up"]} if draw.chance(0.5) else {}
        camera["motion"] = [{"time": middle + at, **key} for at, key in zip((-0.3, 0.4), keys, strict=True)]


def _grouped_moving(mixed: Mixed, middle: float) -> None:
    """Let shapes of groups move by themselves; by random numbers of their own."""
    draw = Draw(f"motion in groups of {mixed.name}", white=False)
    for group in mixed.content.get("groups", {}).values():
        for shape in group["shapes"]:
            if _may_move(mixed, shape) and draw.chance(0.4):
                shape["motion"] = _keys(draw, middle)


def _lamps_moving(mixed: Mixed, middle: float) -> None:
    """Let lights turn and move that are no surfaces; by random numbers of their own."""
    draw = Draw(f"moving lamps of {mixed.name}", white=False)
    for light in mixed.content["lights"]:
        # Those of black scenes are in boxes of their own, and would come out
        if light["type"] not in ("point", "spot", "ies", "projector", "directional") or mixed.exact is not None:
            continue
        if draw.chance(0.6):
            light["motion"] = [{**key, **({"scale": 1.0} if "scale" in key else {})} for key in _keys(draw, middle)]


def _deforming(mixed: Mixed, middle: float) -> None:
    """Let meshes change their form; by random numbers of their own."""
    draw = Draw(f"poses of {mixed.name}", white=False)
    inside = (each for group in mixed.content.get("groups", {}).values() for each in group["shapes"])
    for shape in (*mixed.content["shapes"], *inside):
        shines = "emission" in shape or "emission" in mixed.content.get("materials", {}).get(shape.get("material"), {})
        if shape["type"] != "mesh" or "vertices" not in shape or shines or not _may_move(mixed, shape):
            continue
        if draw.chance(0.6):
            moments = (-0.3, 0.1, 0.5)[: draw.count(2, 3)]
            forms = [[_plus(point, draw.point(0.1)) for point in shape["vertices"]] for _ in moments]
            shape["poses"] = [{"time": middle + at, "vertices": form} for at, form in zip(moments, forms, strict=True)]


def _uneven(mixed: Mixed) -> None:
    """Give media a grid of densities, but the fog, and those of groups that move; by random numbers of their own."""
    draw, content = Draw(f"grids of {mixed.name}", white=False), mixed.content
    moving = {each["group"] for each in content["shapes"] if each["type"] == "instance" and "motion" in each}
    inside = [(name, shape) for name, group in content.get("groups", {}).items() for shape in group["shapes"]]
    apart = {shape.get("interior") for name, shape in inside if name in moving or {"motion", "poses"} & shape.keys()}
    for name, made in content.get("media", {}).items():
        if name == content.get("fog") or name in apart or not draw.chance(0.35):
            continue
        density: Json = {"file": draw.one(("cloud.npy", "cloud.vol"))}
        if draw.chance(0.6):
            low, size = draw.point(1.0), draw.between(0.6, 3.0)
            density["box"] = [[x - size for x in low], [x + size for x in low]]
        elif draw.chance(0.7):
            density["transform"] = {"scale": draw.between(0.5, 2.0), "translate": draw.point(0.5)}
        if draw.chance(0.4):
            density["edges"] = draw.one(("keep", "fall"))
        made["density"] = density


def _glowing(mixed: Mixed) -> None:
    """Let media shine; in white scenes as much as they absorb, which is not seen. By random numbers of their own."""
    draw, content = Draw(f"glow of {mixed.name}", white=False), mixed.content
    shapes = [*content["shapes"], *(each for group in content.get("groups", {}).values() for each in group["shapes"])]
    filled = {shape["interior"] for shape in shapes if "interior" in shape and "material" in shape}
    for name, made in content.get("media", {}).items():
        if mixed.exact == 0.0 or not draw.chance(0.3):
            continue
        if mixed.exact is None:
            made["absorption"], made["emission"] = draw.color(0.1, 1.0), draw.one((0.2, draw.color(0.0, 0.5)))
        elif name not in filled:  # in glass there is more radiance
            made["absorption"] = made["emission"] = draw.color(0.1, 1.0)


def _may_move(mixed: Mixed, shape: Json) -> bool:
    """Not the walls; and where radiance is known, nothing that has an inside, or shines."""
    if shape.get("flip_normals") or max(shape.get("size", [0.0])) > _REACH or shape.get("radius", 0.0) > _REACH:
        return False
    if mixed.exact == 0.0 and min(shape.get("size", [0.0])) >= 2.0 * _LAMP_ROOM - 1e-9:
        return False  # its lamps would come out
    if mixed.exact is None:
        return "edge_u" not in shape or max(map(abs, shape["edge_u"])) < _REACH
    parts = mixed.content["groups"][shape["group"]]["shapes"] if shape["type"] == "instance" else [shape]
    kinds = {mixed.content["materials"][part["material"]]["type"] for part in parts if "material" in part}
    whole = all("material" in part and not {"interior", "emission"} & part.keys() for part in parts)
    return whole and kinds <= set(_SOLID)


def _keys(draw: Draw, middle: float) -> list[Json]:
    """Keys of a motion about a time: a step, a turn, or a matrix."""
    way = draw.one(("step", "turn", "matrix"))
    there: Json = {"translate": draw.point(0.3)}
    if way == "turn":
        there |= {"rotate_degrees": draw.point(25.0), "scale": draw.between(0.9, 1.1)}
    if way == "matrix":
        turned = affine(Transform(rotate_degrees=tuple(draw.point(25.0)))).linear
        rows = [[*row, step] for row, step in zip(turned, draw.point(0.3), strict=True)]
        there = {"matrix": [*rows, [0.0, 0.0, 0.0, 1.0]]}
    keys: list[Json] = [{}, there, {}][: draw.count(2, 3)]
    return [{"time": middle - 0.4 + 0.5 * number, **key} for number, key in enumerate(keys)]


def _plus(point: list[float], by: list[float]) -> list[float]:
    return [a + b for a, b in zip(point, by, strict=True)]


def _grouped(name: str, content: Json) -> None:
    """Name groups of lights, which changes no image; by random numbers of their own."""
    draw = Draw(f"light groups of {name}", white=False)
    shapes = [*content["shapes"], *(shape for group in content.get("groups", {}).values() for shape in group["shapes"])]
    for part in (*shapes, *content["lights"]):
        if part["type"] != "instance" and draw.chance(0.3):
            part["light_group"] = draw.one(("a", "b"))


def _categorized(name: str, content: Json) -> None:
    """Say what some shapes are, which changes no image; by random numbers of their own."""
    draw = Draw(f"categories of {name}", white=False)
    inside = [shape for group in content.get("groups", {}).values() for shape in group["shapes"]]
    for part in (*content["shapes"], *inside):
        if draw.chance(0.3):
            part["category"] = draw.one(("ball", "lamp", "wall"))


def _assembled(things: Things, camera: Json, lights: list[Json], **more: Any) -> Json:
    tables = {"materials": things.materials, "media": things.media, "groups": things.groups}
    return {
        "camera": camera,
        "shapes": things.shapes,
        "lights": lights,
        **{k: v for k, v in tables.items() if v},
        **more,
    }


def _dyed(mixed: Mixed, white: bool) -> None:
    """Grids of colours for media that have a grid of densities; by random numbers of their own."""
    draw = Draw(f"colours of {mixed.name}", white=False)
    for made in mixed.content.get("media", {}).values():
        if white or "density" not in made or not draw.chance(0.6):
            continue
        turned = {"translate": draw.point(0.3), "rotate_degrees": draw.point(20.0)}
        place = {"box": [[-1.0] * 3, [1.0] * 3], "transform": turned}
        if np.max(made.get("scattering", 0.0)) > 0.0:
            made["albedo"] = {"file": draw.one(("shares.npy", "shares.vol")), **place}
        if np.max(made.get("emission", 0.0)) > 0.0:
            if draw.chance(0.5):
                made["emission_grid"] = {"file": draw.one(("shares.npy", "shares.vol")), **place}
            else:
                heat = {"scale": draw.between(2000.0, 6000.0), "offset": draw.between(0.0, 0.4)}
                made["temperature"] = {"file": "shares.npy", **heat, **place}


def _as_seen_by_machines(name: str, camera: Json) -> None:
    """Turn some perspective cameras into calibrated ones, and shift some; by random numbers of their own."""
    draw = Draw(f"camera of {name}", white=False)
    if camera["type"] in ("perspective", "orthographic") and draw.chance(0.15):
        camera["lens_shift"] = [draw.between(-0.3, 0.3), draw.between(-0.3, 0.3)]
    elif camera["type"] == "perspective" and draw.chance(0.4):
        camera["type"], camera["resolution"] = "intrinsics", [160, 120]
        camera["fx"] = round(60.0 / math.tan(math.radians(camera.pop("vertical_fov") / 2.0)), 2)
        camera["fy"] = round(camera["fx"] * draw.between(0.9, 1.1), 2)
        camera |= {"cx": draw.between(70.0, 90.0), "cy": draw.between(50.0, 70.0)} if draw.chance(0.7) else {}
        camera |= {"skew": draw.between(-3.0, 3.0)} if draw.chance(0.3) else {}
        camera |= {"pixel_origin": draw.one(("corner", "center"))} if draw.chance(0.5) else {}
        model = draw.one(("brown-conrady", "kannala-brandt"))
        if model == "kannala-brandt" and "aperture_radius" not in camera:
            camera["distortion"] = {"model": model, "k": [draw.between(-0.08, 0.08) for _ in range(4)]}
        elif draw.chance(0.8):
            k = [draw.between(-0.08, 0.08) for _ in range(draw.one((1, 2, 3, 6)))]
            p = {"p": [draw.between(-0.01, 0.01) for _ in range(2)]} if draw.chance(0.5) else {}
            camera["distortion"] = {"model": "brown-conrady", "k": k, **p}
        if draw.chance(0.5) and not ("aperture_radius" in camera and "focus_distance" not in camera):
            _posed(draw, camera)


def _posed(draw: Draw, camera: Json) -> None:
    """Write a camera's position, target and up as a matrix."""
    right, up, forward = (np.array(each) for each in Camera(**{**camera, "mirrored": False}).axes)
    convention = draw.one(tuple(CONVENTIONS))
    matrix = pose_matrix(camera.pop("position"), [right, -up, forward], convention)
    del camera["target"], camera["up"]
    inward = draw.chance(0.5)
    camera["world_to_camera" if inward else "camera_to_world"] = (inverse(matrix) if inward else matrix).tolist()
    camera["convention"] = convention


def _camera(draw: Draw, kinds: tuple[str, ...] = ("perspective", "orthographic", "panoramic", "fisheye")) -> Json:
    """A camera that looks at the middle from outside of what is there."""
    axis = draw.direction()
    distance = 3.6 / math.sqrt(sum(x * x for x in axis))
    kind = draw.one(kinds) if draw.chance(0.5) else "perspective"
    camera: Json = {"type": kind, "position": [round(distance * x, 4) for x in axis], "target": draw.point(0.3)}
    camera["up"] = draw.direction()
    if kind in ("perspective", "fisheye"):
        camera["vertical_fov"] = draw.between(20.0, 50.0 if kind == "perspective" else 100.0)
    if kind == "orthographic":
        camera["height"] = draw.between(0.5, 2.5)
    if kind in ("perspective", "orthographic") and draw.chance(0.4):
        camera |= {"aperture_radius": draw.between(0.01, 0.2), "focus_distance": draw.between(1.0, 5.0)}
        camera |= (
            {"blades": draw.count(3, 8), "blade_rotation_degrees": draw.between(-90, 90)} if draw.chance(0.5) else {}
        )
    if kind in ("perspective", "orthographic") and draw.chance(0.2):
        camera["mirrored"] = True
    return camera


def _white(draw: Draw, name: str) -> Mixed:
    things = Things(draw, media=draw.chance(0.6), solids=draw.chance(0.8))
    lights: list[Json] = []
    more: Json = {}
    around = draw.one(("constant", "map", "shining room", "grey room"))
    if around == "constant":
        share = draw.one((1.0, 0.5, 0.25))
        lights.append({"type": "environment", "radiance": [share] * 3, "scale": 1.0 / share})
    elif around == "map":
        lights.append({"type": "environment", "file": "white.exr", "rotate_degrees": draw.between(-180, 180)})
    else:
        room: Json = draw.one(({"type": "box", "size": [2.0 * _REACH] * 3}, {"type": "sphere", "radius": 1.6 * _REACH}))
        room = {**room, "flip_normals": True, "emission": [1.0, 1.0, 1.0]}
        if around == "grey room":
            reflectance, room["emission"] = emission_for_white(draw, second_set=False)
            things.materials["walls"] = {"type": "lambert", "reflectance": reflectance}
            room["material"] = "walls"
        things.shapes.append(room)
        if things.may_scatter and draw.chance(0.5):
            things.media["fog"] = medium(draw, 0.3)
            more["fog"] = "fog"
    for _ in range(draw.count(1, 5)):
        things.add()
    if draw.chance(0.3):
        things.shining(0.7, white=True)
    camera, exact = _camera(draw), 1.0
    if things.may_enter and camera["type"] != "fisheye" and draw.chance(0.2):
        # The camera in a ball of its own, in which radiance is the square of the index
        exact = _around_camera(draw, things, camera)
    return Mixed(name, _assembled(things, camera, lights, **more), exact, inner=camera["type"] == "fisheye")


def _around_camera(draw: Draw, things: Things, camera: Json) -> float:
    index, radius = draw.between(1.1, 1.7), draw.between(0.2, 0.4)
    things.materials["lens"] = {"type": "dielectric", "ior": index, "priority": 9}
    camera.pop("aperture_radius", None)
    # From the middle of a sphere no light is reflected for ever, as it is in the corners of a box
    ball = {"type": "sphere", "radius": radius, "center": camera["position"], "material": "lens"}
    if camera["type"] == "orthographic":
        camera["height"] = 0.8 * radius
    things.shapes.append(ball)
    return index * index


def _light(draw: Draw, name: str) -> Mixed:
    things = Things(draw, media=draw.chance(0.45), solids=draw.chance(0.75))
    more: Json = {}
    if draw.chance(0.7):
        floor = things.flat_material("lambert", "oren_nayar", "principled", "conductor")
        shape = {"type": "quad", "origin": [-3.0, -1.5, 3.0], "edge_u": [6.0, 0.0, 0.0], "edge_v": [0.0, 0.0, -6.0]}
        things.shapes.append({**shape, "material": floor})
    for _ in range(draw.count(1, 5)):
        things.add()
    lights = list(_lights(draw, things))
    if things.may_scatter and draw.chance(0.25):
        things.media["fog"] = medium(draw, 0.4)
        more["fog"] = "fog"
    elif things.may_scatter and draw.chance(0.25):
        things.media["haze"] = medium(draw, 0.3)
        things.shapes.append({"type": "box", "size": [11.0, 10.0, 9.0], "interior": "haze"})
    if draw.chance(0.3):
        walls = things.flat_material("lambert", "oren_nayar")
        things.shapes.append({"type": "box", "size": [2.0 * _REACH] * 3, "material": walls, "flip_normals": True})
        lights = [light for light in lights if light["type"] in ("point", "spot", "ies", "projector")] or [_point(draw)]
    return Mixed(name, _assembled(things, _camera(draw), lights, **more))


def _point(draw: Draw) -> Json:
    return {"type": "point", "position": [*draw.point(1.5)[:2], 2.2], "intensity": draw.color(2.0, 9.0)}


def _lights(draw: Draw, things: Things) -> Iterator[Json]:
    """One to three lights; those that are shapes go to the things."""
    surrounds = False
    for _ in range(draw.count(1, 3)):
        kind = draw.one(("shape", "shape", "point", "spot", "ies", "directional", "environment", "sun_sky"))
        if kind == "shape":
            things.shining(1.4, white=False)
            things.shapes[-1].setdefault("transform", {})
        elif kind == "point":
            yield _point(draw)
        elif kind == "spot":
            above = [*draw.point(1.0)[:2], 3.0]
            spot = {"type": kind, "position": above, "direction": [0.1, -0.1, -1.0], "intensity": draw.color(5.0, 20.0)}
            yield {**spot, "cone_degrees": draw.between(60, 120), **draw.one(({}, {"blend": draw.between(0.2, 1.0)}))}
        elif kind == "ies":
            lamp: Json = {
                "type": kind,
                "position": [0.3, 2.6, 0.2],
                "file": "lamp.ies",
                "scale": draw.between(0.5, 2.0),
            }
            lamp |= draw.one(({}, {"direction": [0.2, -1.0, 0.1], "horizontal_zero": draw.direction()}))
            yield lamp if lamp["scale"] < 1.25 else _projector(lamp)
        elif kind == "directional":
            yield {"type": kind, "direction": draw.direction(), "irradiance": draw.color(0.5, 4.0)}
        elif not surrounds:
            surrounds = True
            hidden = {"visible_to_camera": False} if draw.chance(0.15) else {}
            yield (_environment(draw) if kind == "environment" else _sky(draw)) | hidden


def _projector(lamp: Json) -> Json:
    """In the place of a lamp: later choices remain as they are."""
    to: Json = {"direction": lamp.get("direction", [0.0, 0.0, -1.0])}
    to |= {"up": lamp["horizontal_zero"], "even": False} if "direction" in lamp else {"vertical_fov": 70.0}
    return {**to, "type": "projector", "position": lamp["position"], "file": "colors.exr", "scale": lamp["scale"]}


def _environment(draw: Draw) -> Json:
    if draw.chance(0.4):
        return {"type": "environment", "radiance": draw.color(0.2, 1.5)}
    file = draw.one(("around.hdr", "around.exr", "around.png"))
    return {
        "type": "environment",
        "file": file,
        "rotate_degrees": draw.between(-180, 180),
        "scale": draw.color(0.3, 1.5),
    }


def _sky(draw: Draw) -> Json:
    where: Json = {"sun_direction": [draw.between(-1, 1), draw.between(0.2, 1), draw.between(-1, 1)]}
    if draw.chance(0.3):
        where = {"latitude": 48.0, "longitude": 11.0, "time": "2026-06-21T12:30:00+02:00"}
    more: Json = {"turbidity": draw.between(2.0, 9.0)} if draw.chance(0.5) else {}
    more |= {"ground": False} if draw.chance(0.4) else {"ground_albedo": draw.color()}
    more |= {"rotate_degrees": draw.between(-90, 90)} if draw.chance(0.5) else {}
    scales: Json = {"scale": 0.02, "sun_scale": draw.between(0.2, 1.0), "sky_scale": draw.color(0.3, 1.0)}
    return {"type": "sun_sky", **where, **more, **scales}


def _black(draw: Draw, name: str) -> Mixed:
    """Light outside of a closed room that is looked at, inside one that is not, beyond endless fog, or turned away."""
    way = draw.one(("outside", "outside", "inside", "fog", "away"))
    things = Things(draw, media=draw.chance(0.4), solids=draw.chance(0.7))
    camera = _camera(draw, ("perspective", "panoramic"))
    camera.pop("aperture_radius", None)
    for _ in range(draw.count(1, 4)):
        things.add()
    for made in things.materials.values():
        made.pop("emission", None)
    lights: list[Json] = []
    more: Json = {}
    if way == "fog":
        things.media["fog"] = {**medium(draw, 0.5), **draw.one(({}, {"absorption": 0.2}))}
        more["fog"] = "fog"
        lights = [{"type": "directional", "direction": draw.direction(), "irradiance": draw.color(0.5, 4.0)}]
        lights += [draw.one((_environment, _sky))(draw)]
    elif way == "away":
        for _ in range(3):
            x, z = draw.between(-3, 3), draw.between(-3, 3)
            lamp = {"type": "disk", "center": [x, 6.0, z], "normal": [0.0, 1.0, 0.0], "radius": 0.7}
            things.shapes.append({**lamp, "emission": draw.color(1.0, 9.0)})
        things.shapes.append(_closed(things.shapes[-1]))
    else:
        _hidden_lights(draw, things, lights, None if way == "outside" else camera["position"])
    return Mixed(name, _assembled(things, camera, lights, **more), 0.0)


def _closed(lamp: Json) -> Json:
    """A sphere that shines inwards only, above a disk."""
    x, y, z = lamp["center"]
    ball = {"type": "sphere", "center": [x, y + 2.0 * lamp["radius"], z], "radius": lamp["radius"]}
    return {**ball, "flip_normals": True, "emission": lamp["emission"]}


def _hidden_lights(draw: Draw, things: Things, lights: list[Json], inside: list[float] | None) -> None:
    """Lamps behind the walls of a closed box, some of them very near to it, and volumes with the very faces of the box.

    The box is around everything else, or opposite to the camera at `inside` with the lamps in it.
    """
    walls = things.flat_material("lambert", "mirror", "oren_nayar", "conductor")
    made = things.materials[walls]
    made.pop("opacity", None)
    made.pop("opacity_cutoff", None)
    if made["type"] == "mirror":  # where nothing is absorbed, paths meet so many edges that some get out
        made["reflectance"] = [0.5] * 3
    outside = inside is None
    half, middle = (_REACH, [0.0, 0.0, 0.0]) if inside is None else (_LAMP_ROOM, [-1.4 * x for x in inside])
    gap = draw.decades(-5.0, -0.5) * half
    top = middle[1] + half
    things.shapes.append(
        {"type": "box", "center": middle, "size": [2.0 * half] * 3, "material": walls, "flip_normals": draw.chance(0.5)}
    )
    y = top + gap if outside else top - gap
    lamp = {
        "type": "quad",
        "origin": [middle[0] - 0.3 * half, y, middle[2] - 0.3 * half],
        "edge_u": [0.6 * half, 0.0, 0.0],
        "edge_v": [0.0, 0.0, 0.6 * half],
    }
    things.shapes.append({**lamp, "emission": draw.color(1.0, 9.0), "flip_normals": not outside and draw.chance(0.5)})
    if outside:
        lights += [{"type": "directional", "direction": draw.direction(), "irradiance": draw.color(0.5, 4.0)}]
        lights += [{"type": "point", "position": [0.2, y, 0.1], "intensity": draw.color(1.0, 9.0)}]
        lights += [draw.one((_environment, _sky))(draw)] if draw.chance(0.6) else []
    else:
        lights += [{"type": "point", "position": middle, "intensity": draw.color(1.0, 9.0)}]
    if things.may_enter and draw.chance(0.5):  # a volume on the floor of the room, or of exactly its size
        volume = {"type": "box", "center": middle, "size": [2.0 * half] * 3}
        if outside and draw.chance(0.5):
            volume = {"type": "box", "center": [0.0, -half + 0.5, 0.0], "size": [1.0, 1.0, 1.0]}
        things.materials["touching"] = {"type": "dielectric", "ior": 1.4, "priority": 5}
        things.shapes.append({**volume, "material": "touching"})
    elif things.may_scatter and draw.chance(0.5):
        volume = {"type": "box", "center": middle, "size": [2.0 * half] * 3}
        things.shapes.append({**volume, "interior": things.medium()})


def _written(arguments: Mapping[str, Any]) -> Path:
    return mixed_scene(arguments["kind"], arguments["number"]).write(arguments["output"])


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("kind", choices=KINDS)
    parser.add_argument("number", type=int)
    parser.add_argument("-o", "--output", type=Path, default=Path())
    print(_written(vars(parser.parse_args())))
