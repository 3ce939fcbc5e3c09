"""Bad scenes made by hand: each ends in one sentence that names the place and the problem, never in a traceback."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest
from cases import for_each
from cli_support import call

from clrender import scene as scenes
from clrender.errors import SceneError
from clrender.flatten.flat_scene import flatten
from clrender.importers import SCENE_ENDINGS
from clrender.scene import validation_errors

ROOT = Path(__file__).resolve().parents[2]

CAMERA = "[camera]\nposition = [0, 0, 5]\ntarget = [0, 0, 0]\n"
WHITE = '[materials.white]\ntype = "lambert"\nreflectance = [0.7, 0.7, 0.7]\n'
MIX = '[materials.{}]\ntype = "mix"\nmaterials = ["{}", "{}"]\n[materials.m]\ntype = "mirror"\n'
METAL = '[materials.m]\ntype = "conductor"\n'
GLASS = '[materials.g]\ntype = "dielectric"\nior = 1.5\n'
MESH = '[[shapes]]\ntype = "mesh"\nfile = "{}"\n'
SKY = CAMERA + '[[lights]]\ntype = "environment"\n{}\n'
SPOT = CAMERA + '[[lights]]\ntype = "spot"\nposition = [0,2,0]\ndirection = [0, -1, 0]\nintensity = [1,1,1]\n{}\n'
SUN = CAMERA + '[[lights]]\ntype = "sun_sky"\n{}\n'
NOON = SUN.format("sun_direction = [0, 1, 0]\n{}")
PLACED = SUN.format("latitude = 52.5\nlongitude = 13.4\ntime = {}")
IES = CAMERA + '[[lights]]\ntype = "ies"\nposition = [0,2,0]\nfile = "{}"\n{}\n'
LAMP = "IESNA:LM-63-2002\n[TEST] none\nTILT=NONE\n1 1000 1 3 1 1 2 0 0 0\n1 1 100\n0 45 90\n0\n100 50 0\n"
HDR = "#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y {} +X {}\n"
WIDE = "#?RADIANCE\nPRIMARIES=0.708 0.292 0.170 0.797 0.131 0.046 0.3127 0.329\n\n-Y 1 +X 1\n"
"""A picture whose green is none of Rec. 709."""
HEAD = "ply\nformat {} 1.0\nelement vertex {}\nproperty float x\nproperty float y\nproperty float z\n"
FACES = "element face {}\nproperty list uchar int vertex_indices\nend_header\n"
ASCII = HEAD.format("ascii", 3) + FACES.format(1)
BINARY = HEAD.format("binary_little_endian", 3) + FACES.format(1)


@dataclass(frozen=True)
class Bad:
    """A scene file, files beside it, and what the message has to hold."""

    name: str
    text: str | bytes
    expected: tuple[str, ...]
    files: dict[str, str | bytes] = field(default_factory=dict)
    suffix: str = ".toml"
    cli: bool = False
    prepare: Callable[[Path], object] | None = None


def sphere(extra: str = "", radius: str = "1.0") -> str:
    return f'{CAMERA}{WHITE}[[shapes]]\ntype = "sphere"\nradius = {radius}\n{extra}'


def shape(text: str) -> str:
    return f"{CAMERA}[[shapes]]\n{text}"


def lamp(name: str, data: str | bytes | None, *expected: str, more: str = "", cli: bool = False, **beside: str) -> Bad:
    files: dict[str, str | bytes] = {"a.ies": data} if data is not None else {}
    files.update({f"{key}.tlt": text for key, text in beside.items()})
    return Bad(f"lamp {name}", IES.format("a.ies", more), ("lights[0]", *expected), files, cli=cli)


def sky(name: str, file: str, data: str | bytes | None, *expected: str, cli: bool = False, more: str = "") -> Bad:
    files = {} if data is None else {file: data}
    text = SKY.format(f'file = "{file}"\n{more}')
    return Bad(f"sky {name}", text, ("lights[0]", *expected), files, cli=cli)


def ply(name: str, data: str | bytes, *expected: str, cli: bool = False) -> Bad:
    return Bad(name, CAMERA + MESH.format("m.ply"), ("shapes[0].file", "m.ply", *expected), {"m.ply": data}, cli=cli)


def obj(name: str, data: str | bytes, *expected: str) -> Bad:
    return Bad(name, CAMERA + MESH.format("m.obj"), ("shapes[0].file", "m.obj", *expected), {"m.obj": data})


def _sparse(path: Path) -> None:
    with path.open("wb") as file:
        file.truncate(2**34)


def _circle(folder: Path) -> None:
    (folder / "a.ply").symlink_to("b.ply")
    (folder / "b.ply").symlink_to("a.ply")


SYNTAX = [
    Bad("toml syntax", "[camera\nposition = 1\n", ("line 1, column 8", "TOML"), cli=True),
    Bad("toml truncated", '[camera]\nposition = [0, 0, "', ("line 2", "TOML")),
    Bad("toml duplicate key", CAMERA + "position = [1, 1, 1]\n", ("line 4", "overwrite")),
    Bad("toml duplicate table", CAMERA + CAMERA, ("line 4", "TOML")),
    Bad("toml nested deeply", "a = " + "[" * 100_000, ("nested too deeply",)),
    Bad("toml dotted key", "a" + ".a" * 50_000 + " = 1\n", ("line 1", "nested too deeply")),
    Bad("toml digits", f"a = {'9' * 5000}\n", ("digits",)),
    Bad("toml invalid utf-8", b"# \xff\n" + CAMERA.encode(), ("line 1, column 3", "UTF-8"), cli=True),
    Bad("toml utf-16", CAMERA.encode("utf-16"), ("line 1, column 1", "UTF-8")),
    Bad("toml empty", "", ("`camera` is missing",)),
    Bad("json syntax", '{"camera": }', ("line 1, column 12", "JSON"), suffix=".json", cli=True),
    Bad("json empty", "", ("line 1, column 1", "JSON"), suffix=".json"),
    Bad("json list", "[]", ("a list", "table"), suffix=".json"),
    Bad("json number", "5", ("is 5", "table"), suffix=".json"),
    Bad("json null", "null", ("is null", "table"), suffix=".json"),
    Bad("json nested deeply", "[" * 200_000, ("nested too deeply",), suffix=".json", cli=True),
    Bad("json objects nested deeply", '{"a":' * 100_000, ("nested too deeply",), suffix=".json"),
    Bad("json duplicate key", '{"title": "a", "title": "b"}', ('"title" is given twice',), suffix=".json"),
    Bad("json digits", '{"title": ' + "1" * 5000 + "}", ("digits",), suffix=".json"),
    Bad("json surrogate", '{"camera": {"type": "\\ud800"}}', ("camera.type",), suffix=".json"),
]

VALUES = [
    Bad("no camera", WHITE, ("the key `camera` is missing",)),
    Bad("camera without target", "[camera]\nposition = [0, 0, 0]\n", ("camera", "`target` is missing")),
    Bad("target is position", CAMERA.replace("5", "0"), ("camera.target", "same point"), cli=True),
    Bad("up parallel", CAMERA + "up = [0, 0, -2]\n", ("camera.up", "parallel")),
    Bad("up zero", CAMERA + "up = [0, 0, 0]\n", ("camera.up", "length zero")),
    Bad("fov 0", CAMERA + "vertical_fov = 0\n", ("camera.vertical_fov", "greater than 0")),
    Bad("fov 180", CAMERA + "vertical_fov = 180.0\n", ("camera.vertical_fov is 180", "less than 180")),
    Bad("fov tiny", CAMERA + "vertical_fov = 1e-30\n", ("camera", "vertical_fov")),
    Bad("fov text", CAMERA + 'vertical_fov = "45"\n', ("camera.vertical_fov", 'the text "45"', "a number")),
    Bad("focus 0", CAMERA + "focus_distance = 0.0\n", ("camera.focus_distance", "greater than 0")),
    Bad("focus negative", CAMERA + "focus_distance = -3\n", ("camera.focus_distance", "greater than 0")),
    Bad("aperture negative", CAMERA + "aperture_radius = -0.1\n", ("camera.aperture_radius", "at least 0")),
    Bad("camera type", CAMERA + 'type = "perspectiv"\n', ("camera.type", 'did you mean "perspective"')),
    Bad(
        "fov of parallel rays",
        CAMERA + 'type = "orthographic"\nvertical_fov = 50\n',
        ("camera.vertical_fov", "fisheye only"),
    ),
    Bad("height of a perspective", CAMERA + "height = 3.0\n", ("camera.height", "orthographic only", "leave it out")),
    Bad("height 0", CAMERA + 'type = "orthographic"\nheight = 0\n', ("camera.height", "greater than 0")),
    Bad("height huge", CAMERA + 'type = "orthographic"\nheight = 1e13\n', ("camera.height", "at most")),
    Bad(
        "lens of a panorama",
        CAMERA + 'type = "panoramic"\naperture_radius = 0.1\n',
        ("camera.aperture_radius", "leave it out"),
    ),
    Bad("fov 361", CAMERA + 'type = "fisheye"\nvertical_fov = 361\n', ("camera.vertical_fov", "at most 360")),
    Bad("two blades", CAMERA + "blades = 2\n", ("camera.blades is 2", "at least 3")),
    Bad("half a blade", CAMERA + "blades = 2.5\n", ("camera.blades", "whole number")),
    Bad("camera key", CAMERA + "vertical_fow = 45\n", ("camera.vertical_fow", 'did you mean "vertical_fov"'), cli=True),
    Bad("position too short", CAMERA.replace("0, 0, 5", "0, 5"), ("camera.position", "2 entries")),
    Bad("position too long", CAMERA.replace("0, 0, 5", "0, 0, 5, 1"), ("camera.position", "at most 3")),
    Bad("position nan", CAMERA.replace("5", "nan"), ("camera.position[2] is nan", "finite"), cli=True),
    Bad("position infinite", CAMERA.replace("5", "-inf"), ("camera.position[2] is -inf", "finite")),
    Bad("position huge", CAMERA.replace("5", "1e16"), ("camera.position[2]", "at most 1e+12")),
    Bad("position a truth", CAMERA.replace("5", "true"), ("camera.position[2] is true", "a number")),
    Bad("position a date", CAMERA.replace("[0, 0, 5]", "2020-01-01"), ("camera.position", "a list")),
    Bad("top key", "matirials = 3\n" + CAMERA, ("matirials", 'did you mean "materials"')),
    Bad("width 0", CAMERA + "[image]\nwidth = 0\n", ("image.width is 0", "at least 1")),
    Bad("width 65537", CAMERA + "[image]\nwidth = 65537\n", ("image.width", "at most 65536")),
    Bad("width a fraction", CAMERA + "[image]\nwidth = 10.5\n", ("image.width is 10.5", "whole number")),
    Bad("too many pixels", CAMERA + "[image]\nwidth = 65536\nheight = 65536\n", ("image", "pixels"), cli=True),
    Bad("spp 0", CAMERA + "[render]\nspp = 0\n", ("render.spp is 0", "at least 1")),
    Bad("spp huge", CAMERA + "[render]\nspp = 1048577\n", ("render.spp", "at most")),
    Bad("integrator", CAMERA + '[render]\nintegrator = "paht"\n', ("render.integrator", "did you mean 'path'?")),
    Bad("integrator not built", CAMERA + '[render]\nintegrator = "mlt"\n', ("render.integrator", "path, bdpt")),
    Bad("render termination", CAMERA + "[render]\ntermination = 1.0\n", ("render.termination", "below 1")),
    Bad("by its former name", CAMERA + "[render]\nabsorption = 1.0\n", ("render.absorption", "below 1")),
    Bad(
        "render termination twice",
        CAMERA + "[render]\nabsorption = 0.5\ntermination = 0.5\n",
        ("render.absorption is the former name of termination", "leave one of them out"),
    ),
    Bad("seed negative", CAMERA + "[render]\nseed = -1\n", ("render.seed", "at least 0")),
    Bad(
        "reflectance over 1",
        CAMERA + WHITE.replace("0.7, 0.7,", "0.7, 1.5,"),
        ("materials.white.reflectance[1] is 1.5", "at most 1"),
        cli=True,
    ),
    Bad(
        "reflectance negative",
        CAMERA + WHITE.replace("[0.7", "[-0.7"),
        ("materials.white.reflectance[0]", "at least 0"),
    ),
    Bad(
        "reflectance a text",
        CAMERA + WHITE.replace("[0.7, 0.7, 0.7]", '"grey"'),
        ("materials.white.reflectance", "a list"),
    ),
    Bad("reflectance misspelt", CAMERA + WHITE.replace("tance", "tence"), ('did you mean "reflectance"',)),
    Bad(
        "material type", CAMERA + WHITE.replace("lambert", "lamber"), ("materials.white.type", 'did you mean "lambert"')
    ),
    Bad("material type later", CAMERA + WHITE.replace("lambert", "velvet"), ("materials.white.type", "dielectric")),
    Bad("material type missing", CAMERA + "[materials.white]\n", ("materials.white", "`type` is missing")),
    Bad("material type a list", CAMERA + "[materials.white]\ntype = [1]\n", ("materials.white.type",)),
    Bad("material a number", CAMERA + "[materials]\nwhite = 1\n", ("materials.white",)),
    Bad("material name odd", CAMERA + '[materials."a b"]\ntype = "mirrow"\n', ('materials."a b".type', '"mirror"')),
    Bad("material name empty", CAMERA + '[materials.""]\ntype = "mirror"\n', ("materials", "names")),
    Bad("ior 0", CAMERA + '[materials.g]\ntype = "dielectric"\nior = 0\n', ("materials.g.ior", "greater than 0")),
    Bad("metal and eta", CAMERA + METAL + 'metal = "Au"\neta = [1, 1, 1]\n', ("materials.m.metal", "beside eta or k")),
    Bad("metal unknown", CAMERA + METAL + 'metal = "Zz"\n', ("materials.m.metal", "Ag")),
    Bad("metal without k", CAMERA + METAL + "eta = [1, 1, 1]\n", ("materials.m", "needs a metal", "both eta and k")),
    Bad("f0 and metal", CAMERA + METAL + 'metal = "Au"\nf0 = [1, 1, 1]\n', ("materials.m.f0", "beside metal")),
    Bad("opacity of more than all", CAMERA + WHITE + "opacity = 1.5\n", ("materials.white.opacity",)),
    Bad(
        "cutoff of nothing",
        CAMERA + WHITE + "opacity_cutoff = 0.5\n",
        ("materials.white.opacity_cutoff", "without opacity"),
    ),
    Bad(
        "cutoff of all",
        CAMERA + WHITE + "opacity = 0.5\nopacity_cutoff = 0.0\n",
        ("materials.white.opacity_cutoff", "is 0"),
    ),
    Bad("holes in glass", CAMERA + GLASS + "opacity = 0.5\n", ("materials.g.opacity", "make it thin"), cli=True),
    Bad(
        "holes in skin",
        CAMERA + '[materials.s]\ntype = "subsurface"\nalbedo = 0.5\nradius = 0.1\nopacity = 0.5\n',
        ("materials.s.opacity", "has an inside", "leave it out"),
    ),
    Bad(
        "holes in a part of a mixture",
        CAMERA + MIX.format("a", "m", "w") + '[materials.w]\ntype = "mirror"\nopacity = 0.5\n',
        ("materials.a.materials[1]", '"w"', "which has an opacity; give the mixture one"),
    ),
    Bad("mix of none", CAMERA + MIX.format("a", "m", "no"), ("materials.a.materials[1]", '"no"', "does not exist")),
    Bad(
        "mix of itself",
        CAMERA + MIX.format("a", "b", "m") + MIX.format("b", "a", "m").split("[materials.m]")[0],
        ("materials.a", "itself"),
    ),
    Bad("mix of one", CAMERA + '[materials.a]\ntype = "mix"\nmaterials = ["a"]\n', ("materials.a.materials",)),
    Bad("coat 2", CAMERA + '[materials.m]\ntype = "principled"\ncoat = 2\n', ("materials.m.coat", "at most 1")),
    Bad("ior 0.5", CAMERA + '[materials.m]\ntype = "principled"\nior = 0.5\n', ("materials.m.ior", "at least 1")),
    Bad("eta 0", CAMERA + METAL + "eta = [1, 0, 1]\nk = [1, 1, 1]\n", ("materials.m.eta", "at least 1e-06")),
    Bad("roughness 2", CAMERA + METAL + 'metal = "Au"\nroughness = 2\n', ("materials.m.roughness", "at most 1")),
    Bad("ior missing", CAMERA + '[materials.g]\ntype = "dielectric"\n', ("materials.g", "`ior` is missing")),
    Bad("priority -1", CAMERA + GLASS + "priority = -1\n", ("materials.g.priority", "at least 0")),
    Bad("priority 1.5", CAMERA + GLASS + "priority = 1.5\n", ("materials.g.priority", "whole number")),
    Bad(
        "priority and exterior",
        CAMERA + GLASS + "priority = 1\nexterior_ior = 1.3\n",
        ("materials.g.exterior_ior", "beside priority", "leave it out"),
        cli=True,
    ),
    Bad(
        "attenuation alone",
        CAMERA + GLASS + "attenuation_color = [1, 0.5, 0.5]\n",
        ("materials.g.attenuation_color", "needs attenuation_distance"),
    ),
    Bad(
        "attenuation to nothing",
        CAMERA + GLASS + "attenuation_color = [1, 0.5, 0]\nattenuation_distance = 1\n",
        ("materials.g.attenuation_color[2]", "is 0", "0.001"),
    ),
    Bad(
        "attenuation to more",
        CAMERA + GLASS + "attenuation_color = [1, 1.5, 1]\nattenuation_distance = 1\n",
        ("materials.g.attenuation_color[1]", "at most 1"),
    ),
    Bad(
        "attenuation distance 0",
        CAMERA + GLASS + "attenuation_color = [1, 1, 1]\nattenuation_distance = 0\n",
        ("materials.g.attenuation_distance", "greater than 0"),
    ),
    Bad(
        "exterior ior", CAMERA + '[materials.g]\ntype = "dielectric"\nior = 1.5\nexterior_ior = -1\n', ("exterior_ior",)
    ),
    Bad("termination 1", CAMERA + WHITE + "termination = 1\n", ("materials.white.termination", "less than 1")),
    Bad("its former name", CAMERA + WHITE + "absorption = 1\n", ("materials.white.absorption", "less than 1")),
    Bad(
        "termination twice",
        CAMERA + WHITE + "absorption = 0.5\ntermination = 0.5\n",
        ("materials.white.absorption is the former name of termination", "leave one of them out"),
    ),
]

SHAPES = [
    Bad("radius 0", sphere(radius="0"), ("shapes[0].radius is 0", "greater than 0")),
    Bad("radius negative", sphere(radius="-1.5"), ("shapes[0].radius is -1.5", "greater than 0"), cli=True),
    Bad("radius tiny", sphere(radius="1e-40"), ("shapes[0].radius", "too small")),
    Bad("radius out of range", sphere("[shapes.transform]\nscale = 1e12\n", "1e12"), ("shapes[0]", "1e+12")),
    Bad(
        "unknown material",
        sphere('material = "whiet"\n'),
        ("shapes[0].material", "whiet", 'did you mean "white"'),
        cli=True,
    ),
    Bad("material unnamed", sphere('material = ""\n'), ("shapes[0].material",)),
    Bad(
        "no materials", shape('type = "sphere"\nradius = 1\nmaterial = "a"\n'), ("shapes[0].material", "does not exist")
    ),
    Bad("emission negative", sphere("emission = [1, -1, 1]\n"), ("shapes[0].emission[1] is -1", "at least 0")),
    Bad("emission infinite", sphere("emission = [1, inf, 1]\n"), ("shapes[0].emission[1] is inf", "finite")),
    Bad("flip a number", sphere("flip_normals = 1\n"), ("shapes[0].flip_normals is 1", "true or false")),
    Bad("shape type", shape('type = "spere"\nradius = 1\n'), ("shapes[0].type", 'did you mean "sphere"')),
    Bad("shape type case", shape('type = "Sphere"\nradius = 1\n'), ("shapes[0].type", '"sphere"')),
    Bad("shape type later", shape('type = "cylinder"\n'), ("shapes[0].type", "tetrahedron")),
    Bad("shape type missing", shape("radius = 1\n"), ("shapes[0]", "`type` is missing")),
    Bad("shapes a table", CAMERA + "[shapes]\na = 1\n", ("shapes", "a list")),
    Bad(
        "quad without edge", shape('type = "quad"\norigin = [0, 0, 0]\nedge_u = [1, 0, 0]\n'), ("`edge_v` is missing",)
    ),
    Bad(
        "quad degenerate",
        shape('type = "quad"\norigin = [0, 0, 0]\nedge_u = [1, 0, 0]\nedge_v = [2, 0, 0]\n'),
        ("shapes[0]", "degenerate"),
    ),
    Bad(
        "triangle degenerate",
        shape('type = "triangle"\nvertices = [[0, 0, 0], [1, 1, 1], [2, 2, 2]]\n'),
        ("shapes[0]", "degenerate"),
        cli=True,
    ),
    Bad(
        "triangle of two",
        shape('type = "triangle"\nvertices = [[0, 0, 0], [1, 1, 1]]\n'),
        ("shapes[0].vertices", "2 entries"),
    ),
    Bad(
        "tetrahedron degenerate",
        shape('type = "tetrahedron"\nvertices = [[0, 0, 0], [1, 0, 0], [2, 0, 0], [0, 1, 0]]\n'),
        ("shapes[0]", "degenerate"),
    ),
    Bad(
        "tetrahedron flat",
        shape('type = "tetrahedron"\nvertices = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]\n'),
        ("shapes[0]", "flat"),
    ),
    Bad("box size 0", shape('type = "box"\nsize = [1, 0, 1]\n'), ("shapes[0].size[1] is 0", "greater than 0")),
    Bad("disk normal 0", shape('type = "disk"\nnormal = [0, 0, 0]\nradius = 1\n'), ("shapes[0].normal", "length zero")),
    Bad("scale 0", sphere("transform = { scale = 0 }\n"), ("shapes[0].transform.scale", "zero")),
    Bad("scale uneven", sphere("transform = { scale = [1, 2, 1] }\n"), ("shapes[0].transform.scale", "unevenly")),
    Bad(
        "rotate misspelt",
        sphere("transform = { rotate = [0, 90, 0] }\n"),
        ("shapes[0].transform.rotate", '"rotate_degrees"'),
    ),
    Bad(
        "matrix and scale",
        sphere("transform = { scale = 2, matrix = [1,0,0,0, 0,1,0,0, 0,0,1,0, 0,0,0,1] }\n"),
        ("shapes[0].transform.scale", "matrix"),
    ),
    Bad(
        "matrix singular",
        shape('type = "box"\nsize = [1, 1, 1]\ntransform = { matrix = [1,0,0,0, 0,1,0,0, 1,1,0,0, 0,0,0,1] }\n'),
        ("shapes[0].transform.matrix", "inverted"),
    ),
    Bad(
        "matrix projective",
        shape('type = "box"\nsize = [1, 1, 1]\ntransform = { matrix = [1,0,0,0, 0,1,0,0, 0,0,1,0, 0,0,1,1] }\n'),
        ("shapes[0].transform.matrix[3]", "[0, 0, 0, 1]"),
    ),
    Bad(
        "matrix 3x3",
        shape('type = "box"\nsize = [1, 1, 1]\ntransform = { matrix = [[1,0,0], [0,1,0], [0,0,1]] }\n'),
        ("shapes[0].transform.matrix",),
    ),
    Bad("mesh of nothing", shape('type = "mesh"\n'), ("shapes[0]", "`file`", "`vertices`")),
    Bad("mesh without faces", shape('type = "mesh"\nvertices = [[0,0,0],[1,0,0],[0,1,0]]\n'), ("shapes[0]", "`faces`")),
    Bad(
        "mesh index",
        shape('type = "mesh"\nvertices = [[0,0,0],[1,0,0],[0,1,0]]\nfaces = [[0, 1, 3]]\n'),
        ("shapes[0].faces[0][2] is 3", "0 to 2"),
        cli=True,
    ),
    Bad(
        "mesh index negative",
        shape('type = "mesh"\nvertices = [[0,0,0],[1,0,0],[0,1,0]]\nfaces = [[0, 1, -1]]\n'),
        ("shapes[0].faces[0][2] is -1", "at least 0"),
    ),
    Bad(
        "mesh all degenerate",
        shape('type = "mesh"\nvertices = [[0,0,0],[1,0,0],[2,0,0]]\nfaces = [[0, 1, 2]]\n'),
        ("shapes[0]", "degenerate"),
    ),
    Bad("light type", CAMERA + '[[lights]]\ntype = "pont"\n', ("lights[0].type", 'did you mean "point"')),
    Bad("sun of nothing", SUN.format(""), ("lights[0] needs `sun_direction`, or `latitude`, `longitude` and `time`",)),
    Bad(
        "sun of half a place",
        SUN.format("latitude = 1.0\ntime = 2026-06-21T12:00:00Z"),
        ("has `latitude`, but no `long",),
    ),
    Bad("sun of both", SUN.format("sun_direction = [0, 1, 0]\nlatitude = 1.0"), ("has both `sun_direction` and `lat",)),
    Bad(
        "sun nowhere", SUN.format("sun_direction = [0, 0, 0]"), ("lights[0].sun_direction", "length zero", "[0, 1, 0]")
    ),
    Bad(
        "sun below the horizon",
        SUN.format("sun_direction = [1, -1, 0]"),
        ("sun_direction", "45 degrees below the horizon", "y is"),
    ),
    Bad("sun at night", PLACED.format("2026-06-21T00:00:00Z"), ("lights[0].time", "below the horizon", "another time")),
    Bad("sun at no time", PLACED.format('"noon"'), ("lights[0].time is no date and time of ISO 8601", "2026-06-21T")),
    Bad(
        "sun at a local time", PLACED.format("2026-06-21T12:00:00"), ("lights[0].time has no offset from UTC", "+02:00")
    ),
    Bad("sun on a date", PLACED.format("2026-06-21"), ("lights[0].time has no offset",)),
    Bad("sun long ago", PLACED.format("1500-06-21T12:00:00Z"), ("lights[0].time is in the year 1500", "1901")),
    Bad("sun at a number", PLACED.format("17"), ("lights[0].time",)),
    Bad("sun beyond the pole", SUN.format("latitude = 91.0"), ("lights[0].latitude", "90")),
    Bad("turbidity too low", NOON.format("turbidity = 0.5"), ("lights[0].turbidity", "at least 1")),
    Bad("turbidity too high", NOON.format("turbidity = 11.0"), ("lights[0].turbidity", "at most 10")),
    Bad("ground brighter than white", NOON.format("ground_albedo = 1.5"), ("lights[0].ground_albedo", "at most 1")),
    Bad("sky scale negative", NOON.format("sky_scale = -1.0"), ("lights[0].sky_scale", "at least 0")),
    Bad("sun too bright", NOON.format("sun_scale = 1e7"), ("lights[0]: makes a radiance of", "at most 1e+12 is known")),
    Bad(
        "clear sky too bright",
        NOON.format("sky_scale = 1e12"),
        ("lights[0]: makes a radiance of", "at most 1e+12 is known"),
    ),
    Bad("sky misspelt", NOON.format("turbidty = 3.0"), ("lights[0].turbidty", "turbidity")),
    Bad(
        "sky and environment",
        NOON.format("") + '[[lights]]\ntype = "environment"\nradiance = [1,1,1]\n',
        ("lights[1]", "second", "lights[0]"),
    ),
    Bad("spot without cone", SPOT.format("blend = 0.5"), ("lights[0]", "cone_degrees")),
    Bad("spot of no width", SPOT.format("cone_degrees = 0.001"), ("lights[0].cone_degrees", "at least 0.01")),
    Bad("spot too wide", SPOT.format("cone_degrees = 361.0"), ("lights[0].cone_degrees", "360")),
    Bad("spot blend", SPOT.format("cone_degrees = 40.0\nblend = 1.5"), ("lights[0].blend", "1")),
    Bad(
        "spot without direction",
        SPOT.replace("[0, -1, 0]", "[0, 0, 0]").format("cone_degrees = 40.0"),
        ("lights[0].direction", "length zero"),
    ),
    Bad(
        "direction 0",
        CAMERA + '[[lights]]\ntype = "directional"\ndirection = [0,0,0]\nirradiance = [1,1,1]\n',
        ("lights[0].direction", "length zero"),
    ),
    Bad("environment of nothing", SKY.format(""), ("lights[0] needs either `radiance` or `file`",)),
    Bad("environment of both", SKY.format('file = "a.exr"\nradiance = [1, 1, 1]'), ("lights[0] has both",)),
    Bad("environment scale", SKY.format("radiance = [1e9, 0, 0]\nscale = 1e9"), ("lights[0].scale", "1e+18")),
    Bad(
        "environment negative scale", SKY.format("radiance = [1, 1, 1]\nscale = -2"), ("lights[0].scale", "at least 0")
    ),
    Bad("environment turned by a word", SKY.format('file = "a.exr"\nrotate_degrees = "left"'), ("rotate_degrees",)),
    Bad(
        "two environments",
        CAMERA + 2 * '[[lights]]\ntype = "environment"\nradiance = [1,1,1]\n',
        ("lights[1]", "second"),
    ),
    Bad(
        "intensity negative",
        CAMERA + '[[lights]]\ntype = "point"\nposition = [0,0,0]\nintensity = [0,0,-1]\n',
        ("lights[0].intensity[2] is -1",),
    ),
]

TRIANGLE = "0 0 0\n1 0 0\n0 1 0\n"

FILES = [
    lamp("missing", None, '"a.ies" does not exist', cli=True),
    lamp("empty", b"", "no line that begins with TILT="),
    lamp("no IES file", bytes(range(256)) * 40, "no line that begins with TILT="),
    lamp("cut off", LAMP[: LAMP.index("50")], "line 8", "ends before an intensity", "get it again", cli=True),
    lamp("cut off early", LAMP[: LAMP.index("0 45")], "line 5", "ends before a vertical angle"),
    lamp("with nothing after TILT", "TILT=NONE\n", "line 2", "ends before the number of lamps"),
    lamp("of words", LAMP.replace("100 50", "100 fifty"), "line 8", 'an intensity is "fifty"', "finite number"),
    lamp("of no number", LAMP.replace("100 50", "100 nan"), "line 8", '"nan"'),
    lamp("of a huge number", LAMP.replace("100 50", "100 1e999"), "line 8", '"1e999"'),
    lamp("negative", LAMP.replace("100 50", "100 -50"), "line 8", "-50 candela", "at least 0"),
    lamp("too bright", LAMP.replace("100 50", "100 1e13"), "line 8", "1e+13 candela", "at most 1e+12"),
    lamp("angles descending", LAMP.replace("0 45 90", "0 90 45"), "line 6", "45 degrees follows on 90", "must ascend"),
    lamp("angles equal", LAMP.replace("0 45 90", "0 90 90"), "line 6", "90 degrees follows on 90"),
    lamp("angles from 5", LAMP.replace("0 45 90", "5 45 90"), "line 6", "from 5 to 90 degrees", "from 0 or 90"),
    lamp("angles too far", LAMP.replace("0 45 90", "0 45 270"), "line 6", "to 90 or 180"),
    lamp(
        "horizontal angles",
        LAMP.replace("3 1 1 2", "3 2 1 2").replace("90\n0\n100", "90\n0 45\n1 2 3 100"),
        *("line 7", "from 0 to 45 degrees", "from 90 to 270"),
    ),
    lamp("of too many angles", LAMP.replace("1000 1 3 1", "1000 1 4000000000 1"), "line 4", "only", "numbers follow"),
    lamp("of no angles", LAMP.replace("1000 1 3 1", "1000 1 0 1"), "line 4", "vertical angles is 0", "at least 2"),
    lamp("of half an angle", LAMP.replace("1000 1 3 1", "1000 1 2.5 1"), "line 4", "2.5", "whole number"),
    lamp("that goes on", LAMP + "7 7\n", "line 9", "more follows"),
    lamp("of type B", LAMP.replace("3 1 1 2", "3 1 2 2"), "line 4", "type B", "only type C"),
    lamp("of type A", LAMP.replace("3 1 1 2", "3 1 3 2"), "line 4", "type A", "only type C"),
    lamp("of type 7", LAMP.replace("3 1 1 2", "3 1 7 2"), "line 4", "is 7;", "only type C"),
    lamp("multiplier 0", LAMP.replace("1000 1 3", "1000 0 3"), "line 4", "candela multiplier is 0", "above 0"),
    lamp("ballast 0", LAMP.replace("1 1 100", "0 1 100"), "line 5", "ballast factor is 0", "above 0"),
    lamp("tilt geometry", LAMP.replace("NONE", "INCLUDE\n4\n1\n0\n1"), "line 4", "geometry is 4", "1, 2 or 3"),
    lamp("tilt factor", LAMP.replace("NONE", "INCLUDE\n1\n2\n0 90\n1 -1"), "line 7", "-1", "at least 0"),
    lamp("tilt angles", LAMP.replace("NONE", "INCLUDE\n1\n2\n90 0\n1 1"), "line 6", "must ascend"),
    lamp("tilt file missing", LAMP.replace("NONE", "b.tlt"), "line 3", 'TILT="b.tlt" does not exist'),
    lamp("tilt file broken", LAMP.replace("NONE", "b.tlt"), "line 3", "line 2", '"x"', b="1\nx\n0\n1\n"),
    lamp("tilt file outside", LAMP.replace("NONE", "../b.tlt"), "line 3", "outside the scene's own folder"),
    lamp("scale", LAMP.replace("100 50", "1e12 50"), "lights[0].scale", "1.46413e+18 W/sr", more="scale = 1e9"),
    lamp("zero along", LAMP, "lights[0].horizontal_zero", "across", more="horizontal_zero = [0, 2, 0]"),
    Bad("lamp outside", IES.format("../a.ies", ""), ("lights[0].file", "outside the scene's own folder")),
    sky("missing", "no.hdr", None, "does not exist", cli=True),
    sky("of no kind", "a.psd", b"8BPS", "environments may be .exr, .hdr, .pfm"),
    sky("outside", "../a.hdr", None, "outside the scene's own folder"),
    sky("empty", "a.hdr", b"", "not a readable .hdr image", cli=True),
    sky("garbage", "a.exr", b"\x76\x2f\x31\x01" + b"x" * 300, "not a readable .exr image", cli=True),
    sky("too large", "a.hdr", HDR.format(20000, 20000), "20000 x 20000 pixels"),
    sky("cut short", "a.hdr", HDR.format(4, 4) + "abc", "ends too early"),
    sky("negative", "a.hdr", WIDE.encode() + b"\0\xff\0\x80", "pixel (0, 0)", "at least 0"),
    sky("too bright", "a.hdr", HDR.format(1, 1).encode() + b"\xff" * 4, "pixel (0, 0)", "at most 1e+12"),
    sky("scaled too much", "a.hdr", HDR.format(1, 1).encode() + b"\xff\xff\xff\x90", "scale", more="scale = 1e9"),
    Bad("mesh missing", CAMERA + MESH.format("no.ply"), ("shapes[0].file", '"no.ply"', "does not exist"), cli=True),
    Bad("mesh ending", CAMERA + MESH.format("m.off"), ("shapes[0].file", ".ply.gz, .obj or .stl"), {"m.off": "OFF"}),
    Bad("mesh outside", CAMERA + MESH.format("../outside.ply"), ("shapes[0].file", "outside the scene's own folder"),
        cli=True, prepare=lambda folder: (folder.parent / "outside.ply").write_text(ASCII + TRIANGLE + "3 0 1 2\n")),
    Bad("mesh absolute", CAMERA + MESH.format("/etc/passwd"), ("shapes[0].file", "outside the scene's own folder")),
    Bad("mesh missing outside", CAMERA + MESH.format("../../no/such.ply"), ("outside the scene's own folder",)),
    Bad("mesh link outside", CAMERA + MESH.format("link.ply"), ("outside the scene's own folder",),
        prepare=lambda folder: (folder / "link.ply").symlink_to("/etc/passwd")),
    Bad("mesh link circle", CAMERA + MESH.format("a.ply"), ("shapes[0].file", "circle"), cli=True,
        prepare=_circle),
    Bad("mesh a device", CAMERA + MESH.format("zero.ply"), ("outside the scene's own folder",),
        prepare=lambda folder: (folder / "zero.ply").symlink_to("/dev/zero")),
    Bad("mesh a pipe", CAMERA + MESH.format("pipe.ply"), ("shapes[0].file", "device or a pipe"),
        prepare=lambda folder: os.mkfifo(folder / "pipe.ply")),
    Bad("mesh a folder", CAMERA + MESH.format("dir.ply"), ("shapes[0].file", "folder"),
        prepare=lambda folder: (folder / "dir.ply").mkdir()),
    Bad("mesh name with nul", CAMERA + MESH.format("a\\u0000.ply"), ("shapes[0].file", "not a valid path")),
    Bad("mesh name too long", CAMERA + MESH.format("a" * 4000 + ".ply"), ("shapes[0].file",)),
    Bad("mesh huge", CAMERA + MESH.format("m.ply"), ("shapes[0].file", "at most"),
        prepare=lambda folder: _sparse(folder / "m.ply")),
    ply("ply empty", "", "is empty", cli=True),
    ply("ply garbage", b"\x00\x01garbage\xff" * 50, "no PLY file"),
    ply("ply without header end", "ply\nformat ascii 1.0\n", "no complete header"),
    ply("ply endless header", "ply\nformat ascii 1.0\n" + "comment x\n" * 20_000, "no complete header"),
    ply("ply format", ASCII.replace("ascii", "morse") + TRIANGLE + "3 0 1 2\n", '"morse"'),
    ply("ply without x", ASCII.replace("float x", "float q") + TRIANGLE + "3 0 1 2\n", '"x"'),
    ply("ply without faces", HEAD.format("ascii", 3) + "end_header\n" + TRIANGLE, "face"),
    ply("ply property", ASCII.replace("float x", "flaot x") + TRIANGLE, "flaot"),
    ply("ply count", ASCII.replace("vertex 3", "vertex many"), '"many"'),
    ply("ply huge counts", BINARY.replace("vertex 3", "vertex 999999999999"), "at most", cli=True),
    ply("ply promises too much", BINARY.replace("vertex 3", "vertex 100000000") + "abc", "truncated"),
    ply("ply ascii truncated", ASCII + "0 0 0\n1 0 0\n", "truncated"),
    ply("ply ascii surplus", ASCII + TRIANGLE + "3 0 1 2\n3 0 1 2\n", "left over"),
    ply("ply ascii short record", ASCII + "0 0\n1 0 0\n0 1 0\n3 0 1 2\n", "record 0"),
    ply("ply ascii words", ASCII + "0 0 zero\n1 0 0\n0 1 0\n3 0 1 2\n", "cannot be read"),
    ply("ply ascii two corners", ASCII + TRIANGLE + "2 0 1\n", "face 0", "fewer than three"),
    ply("ply ascii index", ASCII + TRIANGLE + "3 0 1 7\n", "vertex 7", "0 to 2"),
    ply("ply ascii index negative", ASCII + TRIANGLE + "3 0 1 -2\n", "vertex -2"),
    ply("ply ascii nan", ASCII + "0 0 nan\n1 0 0\n0 1 0\n3 0 1 2\n", "vertex 0", "finite"),
    ply("ply ascii infinite", ASCII + "0 0 1e999\n1 0 0\n0 1 0\n3 0 1 2\n", "finite"),
    ply("ply binary truncated", BINARY.encode() + b"\x00" * 30, "truncated", cli=True),
    ply("ply binary cut face", BINARY.encode() + b"\x00" * 36 + b"\x03\x00\x00", "length"),
    ply("ply binary index", BINARY.encode() + b"\x00" * 36 + b"\x03" + b"\xff\xff\xff\x7f" * 3, "vertex 2147483647"),
    ply("ply binary nan", BINARY.encode() + b"\xff" * 36 + b"\x03" + bytes(12), "finite"),
    obj("obj empty of faces", "v 0 0 0\nv 1 0 0\nv 0 1 0\n", "no faces"),
    obj("obj garbage", b"\x00\xff\xfe garbage \n\n\x80", "no text file", "zero bytes"),
    obj("obj text", "some\nother text\n", "no vertices"),
    obj("obj of blanks", "v" + " " * 1_000_000 + "x\n", "line 1"),
    obj("obj index", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 4\n", "face"),
    obj("obj index 0", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 0 1 2\n", "line 4", '"f 0 1 2"'),
    obj("obj index relative", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf -4 -2 -1\n", "line 4", "-4"),
    obj("obj two corners", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2\n", "line 4"),
    obj("obj word", "v 0 0 zero\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", "line 1", "0 0 zero"),
    obj("obj nan", "v 0 0 nan\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", "line 1"),
    obj("obj overflow", "v 0 0 1e999\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", "m.obj"),
    obj("obj far away", "v 0 0 1e20\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", "vertex 0", "1e+12"),
    obj("obj cut", "v 0 0 0\nv 1 0 0\nv 0 1\nf 1 2 3", "line 3"),
]  # fmt: skip

ALL = SYNTAX + VALUES + SHAPES + FILES


def _write(bad: Bad, folder: Path) -> Path:
    folder.mkdir(exist_ok=True)
    path = folder / f"bad{bad.suffix}"
    path.write_bytes(bad.text if isinstance(bad.text, bytes) else bad.text.encode())
    for name, data in bad.files.items():
        (folder / name).write_bytes(data if isinstance(data, bytes) else data.encode())
    if bad.prepare:
        bad.prepare(folder)
    return path


def test_there_are_enough() -> None:
    assert len(ALL) >= 60
    assert len({bad.name for bad in ALL}) == len(ALL)


@for_each("bad", ALL)
def test_one_sentence(bad: Bad, tmp_path: Path) -> None:
    path = _write(bad, tmp_path / "scene")
    with pytest.raises(SceneError) as caught:
        flatten(scenes.load(path), 64, 64)
    message = str(caught.value)
    for part in (path.name, *bad.expected):
        assert part in message, f"{part!r} is not in: {message}"
    assert "\n" not in message and len(message) < 6000 and message.isprintable()


@pytest.mark.thorough
@for_each("bad", [bad for bad in ALL if bad.cli])
def test_command_line(bad: Bad, tmp_path: Path) -> None:
    path = _write(bad, tmp_path / "scene")
    done = call("check", str(path), folder=tmp_path)
    assert done.returncode == 2
    assert done.stdout == ""
    assert done.stderr.startswith("error: ") and done.stderr.count("\n") == 1, done.stderr


@pytest.mark.thorough
@for_each(
    ("arguments", "expected"),
    [
        (["check", "romo"], ('"romo"', 'did you mean "room"')),
        (["check", "no/such.toml"], ("no/such.toml", "does not exist")),
        (["check", "."], ("is a folder",)),
        (["check", "folder.toml"], ("folder.toml", "folder")),
        (["check", "picture.png"], ("picture.png", ".toml, .json, .gltf")),
        (["check", "room", "--allow-path", "nowhere"], ("--allow-path", "'nowhere'", "not exist")),
        (["check"], ("SCENE",)),
    ],
)
def test_bad_arguments(arguments: list[str], expected: tuple[str, ...], tmp_path: Path) -> None:
    (tmp_path / "folder.toml").mkdir()
    done = call(*arguments, folder=tmp_path)
    assert done.returncode == 2
    assert done.stdout == "" and done.stderr.startswith("error: ") and "Traceback" not in done.stderr
    for part in expected:
        assert part in done.stderr


def test_check_allows_paths(tmp_path: Path) -> None:
    (tmp_path / "meshes").mkdir()
    (tmp_path / "meshes" / "m.ply").write_text(ASCII + TRIANGLE + "3 0 1 2\n")
    (tmp_path / "scene").mkdir()
    path = tmp_path / "scene" / "s.toml"
    light = '\n[[lights]]\ntype = "environment"\nradiance = [1, 1, 1]\n'
    path.write_text(CAMERA + MESH.format("../meshes/m.ply") + light)
    done = call("check", "scene/s.toml", "--allow-path", "meshes", folder=tmp_path)
    assert done.returncode == 0, done.stderr
    assert "triangles            1\n" in done.stdout and done.stderr == ""


@pytest.mark.thorough
@pytest.mark.parametrize("name", ["scene.yaml", "room.fbx"])
def test_another_format_is_answered_with_those_that_are_read(tmp_path: Path, name: str) -> None:
    (tmp_path / name).write_text("")
    done = call("check", name, folder=tmp_path)
    assert done.returncode == 2 and done.stdout == ""
    assert all(ending in done.stderr for ending in SCENE_ENDINGS) and "clrender scenes" in done.stderr


@pytest.mark.parametrize(
    ("text", "end"),
    [
        ("", '"vertical_fov"?'),
        ("blades = -1", " (also wrong: camera.blades)"),
        (
            "blades = -1\nup = 3\nshutter = -1\niso = -1\nf_stop = -1",
            " (also wrong: camera.up, camera.blades, camera.f_stop, and more)",
        ),
    ],
    ids=["none", "one", "many"],
)
def test_other_places_with_problems_are_named(tmp_path: Path, text: str, end: str) -> None:
    """The first one is explained. A misspelt key comes first, as others may only follow from it."""
    (tmp_path / "a.toml").write_text(f"{CAMERA}vertical_fow = 5\n{text}\n")
    with pytest.raises(SceneError) as error:
        scenes.load(tmp_path / "a.toml")
    assert "camera.vertical_fow is an unknown key" in str(error.value)
    assert str(error.value).endswith(end)


def test_the_key_that_a_misspelt_one_leaves_missing_is_no_other_problem(tmp_path: Path) -> None:
    wrong = WHITE.replace("reflectance", "reflectence")
    (tmp_path / "a.toml").write_text(CAMERA + wrong)
    with pytest.raises(SceneError, match=r'reflectence is an unknown key; did you mean "reflectance"\?$'):
        scenes.load(tmp_path / "a.toml")
    (tmp_path / "a.toml").write_text(CAMERA + wrong + wrong.replace("white", "grey"))
    with pytest.raises(SceneError, match=r"\(also wrong: materials.grey.reflectence\)$"):
        scenes.load(tmp_path / "a.toml")


def test_of_thousands_of_problems_a_few_are_explained(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Each may need a look at all the others, so all of them would take minutes."""
    looked: list[Any] = []
    explained = validation_errors._explained

    def counted(item: Any, *given: Any) -> Any:
        looked.append(item)
        return explained(item, *given)

    monkeypatch.setattr(validation_errors, "_explained", counted)
    short = '[materials.m{}]\ntype = "lambert"\nreflectance = [0.5]\n'
    (tmp_path / "a.toml").write_text(CAMERA + "".join(short.format(number) for number in range(8000)))
    end = " (also wrong: materials.m1.reflectance, materials.m2.reflectance, materials.m3.reflectance, and more)"
    with pytest.raises(SceneError) as error:
        scenes.load(tmp_path / "a.toml")
    assert str(error.value).endswith(f"materials.m0.reflectance has only one entry, but must have 3{end}")
    assert len(looked) < 20


@pytest.mark.thorough
def test_what_is_left_out_of_a_file_is_a_note_wherever_it_is_told(tmp_path: Path) -> None:
    (tmp_path / "a.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    small = ("--size", "8x8", "--spp", "1")
    commands = (["check", "a.obj"], ["render", "a.obj", *small, "-o", "a.png"], ["convert", "a.obj", "a.toml"])
    for command in commands:
        done = call(*command, folder=tmp_path)
        told = [line for line in done.stderr.splitlines() if "no light in it" in line]
        assert done.returncode == 0 and len(told) == 1 and told[0].startswith("note: a.obj: "), done.stderr


@pytest.mark.thorough
def test_list_and_schema(tmp_path: Path) -> None:
    done = call("scenes", folder=tmp_path)
    assert done.returncode == 0 and done.stderr == ""
    assert {line.split()[0] for line in done.stdout.splitlines()} == set(scenes.builtin_names())
    done = call("schema", folder=tmp_path)
    assert done.returncode == 0 and '"$schema"' in done.stdout
