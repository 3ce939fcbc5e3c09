"""Spectra, measured reflectance, curves and grids for `mutate_files.py`: sound files, and how they are read."""

from __future__ import annotations

import copy
import json
import math
import random
import struct
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

import numpy as np
import peer_scenes
from measured_files import rgl_fields, tensor_bytes
from numpy.typing import NDArray
from vdb_files import vdb_bytes

from clrender.errors import ClrenderError
from clrender.flatten.flat_scene import flatten
from clrender.flatten.spectral import spectral_arrays
from clrender.importers import load
from clrender.scene import Scene

__all__ = ["MEASURED", "READERS", "SOUND", "changed_merl", "changed_scene"]

MITSUBA_SPECTRUM: Final = "-mitsuba.spd"
MITSUBA_SPECTRA: Final = "-spectra.xml"
PBRT_SPECTRA: Final = "-spectra.pbrt"
OWN_SPECTRA: Final = "-spectra.json"
OWN_TEXT: Final = "-spectra.toml"
CURVES: Final = "-strands.npy"
CURVES_TEXT: Final = "-strands.txt"
PBRT_CURVES: Final = "-strands.pbrt"
MEASURED: Final = (".bsdf", ".binary")

_STEPS = (90, 90, 180)
_CAMERA = {"position": [0.0, 0.0, 5.0], "target": [0.0, 0.0, 0.0]}
_TABLE = {"wavelengths": [400.0, 500.0, 550.0, 700.0], "values": [0.1, 0.8, 0.3, 0.5]}
_IES = b"IESNA:LM-63-1995\nTILT=NONE\n1 1000 1 3 1 1 2 .1 .1 0\n1 1 70\n0 45 90\n0\n100 90 20\n"

_SPD: Final = b"# spectrum\n400 0.1\n450.5 .8  # a peak\n500 1e-1\n700 0.5\n720 0\n"
_PBRT: Final = 'LookAt 0 0 5  0 0 0  0 1 0\nCamera "perspective"\n{}WorldBegin\n{}Shape "sphere"\n'
_PBRT_USES: Final = [
    ("", 'Material "diffuse" "spectrum reflectance" "NAME"\n'),
    ("", 'Material "conductor" "spectrum eta" "NAME" "spectrum k" "NAME"\n'),
    ("", 'Material "dielectric" "spectrum eta" "NAME"\n'),
    ("", 'LightSource "point" "spectrum I" "NAME"\nAreaLightSource "diffuse" "spectrum L" "NAME"\n'),
    ("", 'Material "subsurface" "spectrum sigma_a" "NAME" "spectrum sigma_s" "NAME"\n'),
    (
        'MakeNamedMedium "m" "string type" "homogeneous" "spectrum sigma_a" "NAME" "spectrum Le" "NAME"\n',
        'MediumInterface "m" ""\nMaterial "interface"\n',
    ),
    ("", 'LightSource "infinite" "spectrum L" "NAME" "float illuminance" 3\n'),
    ("", 'Material "hair" "spectrum reflectance" "NAME"\nShape "curve" "point3 P" [0 0 0 0 1 0 0 2 0 0 3 0]\n'),
]
"""What a file of a spectrum may be in pbrt's scenes."""
_XML: Final = '<scene version="3.0.0"><sensor type="perspective"/>{}</scene>'
_XML_USES: Final = [
    '<shape type="sphere"><bsdf type="diffuse"><spectrum name="reflectance" filename="NAME"/></bsdf></shape>',
    '<shape type="sphere"><bsdf type="conductor"><spectrum name="eta" filename="NAME"/>'
    '<spectrum name="k" filename="NAME"/></bsdf></shape>',
    '<shape type="sphere"><emitter type="area"><spectrum name="radiance" filename="NAME"/></emitter></shape>',
    '<shape type="sphere"/><emitter type="point"><spectrum name="intensity" filename="NAME"/></emitter>',
    '<shape type="sphere"><bsdf type="null"/><medium name="interior" type="homogeneous">'
    '<spectrum name="sigma_t" filename="NAME"/><spectrum name="albedo" filename="NAME"/></medium></shape>',
    '<shape type="sphere"><bsdf type="null"/><medium name="interior" type="homogeneous">'
    '<spectrum name="sigma_a" filename="NAME"/><rgb name="sigma_s" value="1"/></medium></shape>',
    '<shape type="sphere"><bsdf type="plastic"><spectrum name="diffuse_reflectance" filename="NAME"/></bsdf></shape>',
]

_MITSUBA_SPECTRA: Final = b"""<scene version="3.5.0">
  <sensor type="perspective"><float name="fov" value="40"/>
    <transform name="to_world"><lookat origin="0, 1, 5" target="0, 0.5, 0" up="0, 1, 0"/></transform></sensor>
  <bsdf type="diffuse" id="paint"><spectrum name="reflectance" value="400:0.2, 550:0.9, 700:0.1"/></bsdf>
  <bsdf type="diffuse" id="table"><spectrum name="reflectance" type="irregular">
    <string name="wavelengths" value="400, 500, 650.5"/><string name="values" value="0.1, 0.5, 0.25"/></spectrum></bsdf>
  <bsdf type="conductor" id="metal"><spectrum name="eta" value="400:1.2, 700:0.3"/>
    <spectrum name="k" value="400:2, 700:4"/></bsdf>
  <medium type="homogeneous" id="dye"><spectrum name="sigma_t" value="400:0.5, 500:3, 700:1.2"/>
    <spectrum name="albedo" value="360:0.9, 830:0.2"/><float name="scale" value="2"/>
    <phase type="hg"><float name="g" value="0.4"/></phase></medium>
  <medium type="homogeneous" id="ink"><rgb name="albedo" value="0.8, 0.5, 0.1"/>
    <spectrum name="sigma_t" type="regular"><float name="wavelength_min" value="380"/>
      <float name="wavelength_max" value="720"/><string name="values" value="1 2 3 4"/></spectrum></medium>
  <medium type="homogeneous" id="milk"><spectrum name="sigma_a" value="400:0, 700:1"/>
    <rgb name="sigma_s" value="3, 2, 1"/></medium>
  <medium type="heterogeneous" id="cloud"><volume name="sigma_t" type="gridvolume">
      <string name="filename" value="smoke.vol"/></volume>
    <volume name="albedo" type="constvolume"><spectrum name="value" value="400:0.9, 700:0.5"/></volume></medium>
  <shape type="sphere"><ref id="paint"/></shape>
  <shape type="cube"><ref id="metal"/></shape>
  <shape type="sphere"><point name="center" x="3" y="0" z="0"/><bsdf type="null"/>
    <ref name="interior" id="dye"/></shape>
  <shape type="sphere"><point name="center" x="6" y="0" z="0"/><bsdf type="null"/>
    <ref name="interior" id="ink"/></shape>
  <shape type="sphere"><point name="center" x="9" y="0" z="0"/><bsdf type="null"/>
    <ref name="interior" id="cloud"/></shape>
  <shape type="cube"><bsdf type="null"/><ref name="interior" id="milk"/></shape>
  <shape type="rectangle"><ref id="table"/><emitter type="area">
    <spectrum name="radiance" type="irregular"><string name="wavelengths" value="400, 700"/>
      <string name="values" value="1, 2"/></spectrum></emitter></shape>
  <emitter type="point"><spectrum name="intensity" type="blackbody"><float name="temperature" value="3000"/>
    </spectrum></emitter>
  <emitter type="point"><spectrum name="intensity" type="d65"><float name="scale" value="2"/></spectrum></emitter>
  <emitter type="constant"><spectrum name="radiance" type="uniform"><float name="value" value="0.5"/>
    </spectrum></emitter>
</scene>
"""

_PBRT_SPECTRA: Final = b"""LookAt 0 1 5  0 0.5 0  0 1 0
Camera "perspective" "float fov" [40]
Film "rgb" "integer xresolution" 32 "integer yresolution" 32 "string sensor" "canon_eos_5d" "float iso" 100
MakeNamedMedium "dye" "string type" "homogeneous" "spectrum sigma_s" [400 1 500 3 700 2] "float scale" 3
  "spectrum sigma_a" [300 0.1 900 0.4] "spectrum Le" [400 1 700 2] "float Lescale" 0.5
MakeNamedMedium "smoke" "string type" "uniformgrid" "integer nx" 2 "integer ny" 1 "integer nz" 1
  "float density" [0.5 1] "spectrum sigma_s" [400 1 700 2] "spectrum sigma_a" [400 0.5 700 0]
WorldBegin
LightSource "point" "spectrum I" "stdillum-F2" "float scale" 3
LightSource "distant" "spectrum L" [400 1 500 3 700 2] "float illuminance" 10
LightSource "infinite" "blackbody L" 5000 "float power" 4
Material "dielectric" "spectrum eta" [400 1.6 550 1.55 700 1.5]
Shape "sphere"
Translate 3 0 0
Material "dielectric" "spectrum eta" "glass-F11"
Shape "sphere"
Material "diffuse" "spectrum reflectance" [300 0.5 600 0.9 900 0.1]
Shape "disk"
Material "conductor" "spectrum eta" [400 1 700 0.2] "spectrum k" [400 2 700 4]
Shape "disk"
Material "conductor" "spectrum eta" "metal-Cu-eta" "spectrum k" "metal-Cu-k"
Shape "disk"
Material "subsurface" "spectrum sigma_a" [400 0.1 700 0.2] "spectrum sigma_s" [400 5 700 9] "float eta" 1.4
Shape "sphere"
AttributeBegin
  AreaLightSource "diffuse" "spectrum L" [400 1 700 1] "float scale" 2
  Shape "disk"
AttributeEnd
Material "interface"
Translate 3 0 0
MediumInterface "dye" ""
Shape "sphere"
Translate 3 0 0
MediumInterface "smoke" ""
Shape "sphere"
"""

_PBRT_CURVES: Final = b"""LookAt 0 0 5  0 0 0  0 1 0
Camera "perspective"
WorldBegin
LightSource "infinite" "rgb L" [1 1 1]
Material "hair" "float eumelanin" 0.3 "float pheomelanin" 0.5 "float beta_m" 0.2 "float beta_n" 0.4 "float alpha" 3
Shape "curve" "string type" "cylinder" "point3 P" [-1 0 0 -0.3 1 0 0.3 -1 0 1 0 0] "float width0" 0.2
  "float width1" 0.05
Material "hair" "rgb sigma_a" [1 2 3] "float eta" 1.6
Shape "curve" "string basis" "bspline" "integer degree" 3 "point3 P" [0 0 0 0 1 0 1 1 0 1 2 0 2 2 0 2 3 1]
  "float width" 0.1 "integer splitdepth" 3
Shape "curve" "string basis" "bspline" "integer degree" 2 "point3 P" [0 0 0 0 1 0 1 1 0 1 2 0 2 2 0] "float width" 0.1
Scale 2 2 2
Material "diffuse" "rgb reflectance" [1 0 0]
Shape "curve" "string type" "ribbon" "point3 P" [-1 0 0 -0.3 1 0 0.3 -1 0 1 0 0] "normal N" [0 0 1 0 1 1]
  "float width" 0.1
Shape "curve" "string type" "flat" "integer degree" 2 "string basis" "bezier" "point3 P" [0 0 0 0 1 0 1 1 0 1 2 0 2 2 0]
  "float width" 0.1
"""


def own_scene() -> dict[str, Any]:
    """A scene of ours with everything that may be a spectrum."""
    materials = {
        "paint": {"type": "lambert", "reflectance": _TABLE},
        "gold": {"type": "conductor", "eta": {**_TABLE, "scale": 2.0}, "k": _TABLE, "roughness": 0.2},
        "tint": {"type": "conductor", "f0": _TABLE},
        "glass": {"type": "dielectric", "dispersion": {"glass": "SF11"}},
        "abbe": {"type": "dielectric", "ior": 1.6, "dispersion": {"abbe": 40.0}},
        "cauchy": {"type": "dielectric", "dispersion": {"cauchy": [1.5, 0.004]}},
        "lens": {"type": "dielectric", "dispersion": {"sellmeier": [1.04, 0.006, 0.23, 0.02, 1.01, 103.56]}},
        "table": {"type": "dielectric", "dispersion": {"wavelengths": [400.0, 700.0], "values": [1.55, 1.5]}},
        "plastic": {"type": "principled", "base_color": _TABLE, "sheen_color": _TABLE, "specular_color": _TABLE},
    }
    materials["hair"] = {"type": "hair", "reflectance": [0.5, 0.3, 0.1]}
    shapes: list[dict[str, Any]] = [
        {"type": "sphere", "center": [3.0 * at, 0.0, 0.0], "radius": 1.0, "material": name}
        for at, name in enumerate(materials)
        if name != "hair"
    ]
    shapes.append({"type": "sphere", "center": [0.0, 3.0, 0.0], "radius": 1.0, "interior": "dye"})
    shapes.append({"type": "disk", "center": [0.0, 6.0, 0.0], "normal": [0, 0, 1], "radius": 1.0, "emission": _TABLE})
    light = {"intensity": {"illuminant": "FL2", "scale": 3.0}, "position": [0.0, 9.0, 0.0]}
    return {
        "camera": {
            **_CAMERA,
            "response": {
                "wavelengths": [400.0, 500.0, 600.0, 700.0],
                "red": [0.0, 0.1, 0.9, 0.2],
                "green": [0.1, 0.8, 0.3, 0.0],
                "blue": [0.9, 0.2, 0.0, 0.0],
                "white": "A",
            },
        },
        "render": {"spectral": True},
        "materials": materials,
        "media": {"dye": {"absorption": {**_TABLE, "scale": 3.0}, "scattering": _TABLE, "emission": _TABLE}},
        "shapes": shapes,
        "lights": [
            {"type": "point", **light},
            {"type": "ies", "file": "lamp.ies", "position": [0.0, 8.0, 0.0], "scale": {"blackbody": 3000.0}},
            {"type": "directional", "direction": [0, -1, 0], "irradiance": _TABLE},
            {"type": "environment", "radiance": {"blackbody": 6500.0, "scale": 0.3}},
        ],
    }


def _own_text() -> bytes:
    """The same as TOML."""

    def said(value: Any) -> str:
        if isinstance(value, dict):
            return "{ " + ", ".join(f"{key} = {said(inside)}" for key, inside in value.items()) + " }"
        return json.dumps(value)

    lines = []
    for key, value in own_scene().items():
        parts = value if isinstance(value, list) else [value]
        nested = isinstance(value, dict) and key in ("materials", "media")
        for part in parts:
            lines.append(f"[[{key}]]" if isinstance(value, list) else "" if nested else f"[{key}]")
            for name, inside in part.items():
                if nested:
                    lines.append(f"[{key}.{name}]")
                    lines += [f"{one} = {said(each)}" for one, each in inside.items()]
                else:
                    lines.append(f"{name} = {said(inside)}")
    return "\n".join(lines).encode()


def changed_scene(rng: random.Random, values: list[Any], numbers: list[int]) -> bytes:
    """A scene some of whose values are others, missing or doubled."""
    whole = copy.deepcopy(own_scene())
    for _ in range(rng.choice([1, 1, 2, 4])):
        places = [
            (table, key)
            for name in ("camera", "materials", "media", "lights", "shapes")
            for table, key in _places(whole[name])
        ]
        place, key = rng.choice(places)
        inside = place[key]
        match rng.randrange(6):
            case 0:
                del place[key]
            case 1 if isinstance(place, list):
                place.append(copy.deepcopy(inside))
            case 2 if isinstance(inside, dict):
                inside[rng.choice(["scale", "values", "wavelengths", "illuminant", "color"])] = copy.deepcopy(
                    rng.choice(values)
                )
            case 3:
                place[key] = rng.choice(
                    [copy.deepcopy(_TABLE), {"illuminant": "E"}, {"blackbody": 1e4}, 0.5, [0.1, 0.2, 0.3]]
                )
            case _ if isinstance(inside, float):
                place[key] = rng.choice([-inside, inside * 1e3, inside + 100.0, 0.0, 1e-40, 1e12, rng.choice(numbers)])
            case _:
                place[key] = copy.deepcopy(rng.choice(values))
    return json.dumps(whole).encode()


def _places(value: Any) -> list[tuple[Any, Any]]:
    found: list[tuple[Any, Any]] = []
    for key, inside in value.items() if isinstance(value, dict) else enumerate(value):
        found.append((value, key))
        if isinstance(inside, dict | list):
            found += _places(inside)
    return found


def _strands() -> NDArray[np.float64]:
    return np.random.default_rng(4).uniform(0.1, 1.0, (3, 5, 4))


def _hair_06() -> list[bytes]:
    points = _strands()[..., :3]
    text = b"# hair\n" + b"\n\n".join(
        b"\n".join(b"%.3f %.3f %.3f" % tuple(row) for row in each.tolist()) for each in points
    )
    numbers = [number for each in points for number in [math.inf, *each.ravel().tolist()]]
    return [text, b"BINARY_HAIR" + struct.pack(f"<I{len(numbers) - 1}f", points.size // 3, *numbers[1:])]


def _arrays(folder: Path) -> list[bytes]:
    rows, parted = _strands(), _strands().reshape(-1, 4)
    parted[5] = np.nan
    wide = np.concatenate([rows, rows[..., :3]], axis=-1).astype(np.float32)
    found = []
    for array in (rows, parted, wide, np.asfortranarray(rows[..., :3])):
        np.save(folder / "original.npy", array)
        found.append((folder / "original.npy").read_bytes())
    return found


def _text(columns: int) -> bytes:
    return b"\n\n".join(
        b"\n".join(b" ".join(b"%.4f" % number for number in row[:columns]) for row in each)
        for each in _strands().tolist()
    )


def _volumes() -> list[bytes]:
    values = np.random.default_rng(5).uniform(0.0, 1.0, (9, 7, 5)).astype(np.float32)
    ways: list[dict[str, Any]] = [{}, {"zipped": True}, {"blosc": True, "masked": True, "half": True}, {"tiles": True}]
    return [vdb_bytes({"density": values, "temperature": values}, **way) for way in ways]


def _with_parts(folder: Path, data: bytes) -> list[bytes]:
    peer_scenes.write_parts(folder)
    (folder / "lamp.ies").write_bytes(_IES)
    head = struct.pack("<3sBiiiii6f", b"VOL", 3, 1, 2, 1, 1, 1, 0, 0, 0, 1, 1, 1)
    (folder / "smoke.vol").write_bytes(head + struct.pack("<2f", 0.5, 1.0))
    return [data]


SOUND: Final[dict[str, Callable[[Path], list[bytes]]]] = {
    ".spd": lambda folder: [_SPD],
    MITSUBA_SPECTRUM: lambda folder: [_SPD],
    MITSUBA_SPECTRA: lambda folder: _with_parts(folder, _MITSUBA_SPECTRA),
    PBRT_SPECTRA: lambda folder: [_PBRT_SPECTRA],
    OWN_SPECTRA: lambda folder: _with_parts(folder, json.dumps(own_scene()).encode()),
    OWN_TEXT: lambda folder: _with_parts(folder, _own_text()),
    CURVES: _arrays,
    CURVES_TEXT: lambda folder: [_text(3), _text(4)],
    ".hair": lambda folder: _hair_06(),
    PBRT_CURVES: lambda folder: [_PBRT_CURVES],
    ".bsdf": lambda folder: [
        tensor_bytes(rgl_fields(spectral=spectral, phis=phis, side=5, views=3))
        for spectral, phis in ((True, 1), (False, 3))
    ],
    ".binary": lambda folder: [struct.pack("<3i", *_STEPS)],
    ".vdb": lambda folder: _volumes(),
}
"""A few sound files of each format, written into a folder if need be; of MERL's only the head."""


def changed_merl(rng: random.Random) -> bytes:
    """A file of the MERL database, of whose numbers few are not 0, and seldom all are there, as it takes 35 MB."""
    head = bytearray(struct.pack("<3i", *_STEPS))
    size = 3 * 8 * math.prod(_STEPS)
    if rng.random() < 0.97:
        for _ in range(rng.randint(1, 3)):
            head[rng.randrange(12)] = rng.choice([0, 1, 90, 180, 255, rng.randrange(256)])
        return bytes(head[: rng.choice([12, 12, 12, rng.randrange(12)])]) + bytes(rng.choice([0, 1, 8, 1000, 4097]))
    data = head + bytearray(size + rng.choice([0, 0, 0, 0, 0, -8, 1, -size // 2]))
    for _ in range(rng.randint(1, 4)):
        at = 12 + 8 * rng.randrange((len(data) - 12) // 8)
        data[at : at + 8] = struct.pack("<d", rng.choice([1.0, 1e3, -1.0, 1e308, 1e-310, math.nan, math.inf]))
    return bytes(data)


def _whole(scene: Scene) -> Any:
    """As kernels see it where wavelengths are rendered."""
    flat = flatten(scene, 8, 8)
    response = scene.camera.response
    return spectral_arrays(flat.arrays, flat.spectral, None, None if response is None else response.film())


def _choice(path: Path, count: int) -> int:
    return zlib.crc32(path.read_bytes()) % count


def _by(path: Path, scene: Path) -> Any:
    """What names the file; in its place the error's sentence names the scene."""
    try:
        return _whole(load(scene, strict=True))
    except ClrenderError as error:
        raise type(error)(str(error).replace(scene.name, f"{scene.name}: {path.name}")) from None


def _pbrt_spectrum(path: Path) -> Any:
    before, world = _PBRT_USES[_choice(path, len(_PBRT_USES))]
    scene = path.with_name("uses.pbrt")
    scene.write_text(_PBRT.format(before, world).replace("NAME", path.name), encoding="utf-8")
    return _by(path, scene)


def _mitsuba_spectrum(path: Path) -> Any:
    scene = path.with_name("uses.xml")
    use = _XML_USES[_choice(path, len(_XML_USES))]
    scene.write_text(_XML.format(use).replace("NAME", path.name), encoding="utf-8")
    return _by(path, scene)


def _scene(path: Path) -> Any:
    return _whole(load(path))


def _curves(path: Path) -> Any:
    if path.suffix == ".txt" and _choice(path, 2):
        kind = ("bsplinecurve", "linearcurve")[_choice(path, 4) // 2]
        shape = f'<shape type="{kind}"><string name="filename" value="{path.name}"/></shape>'
        scene = path.with_name("uses.xml")
        scene.write_text(_XML.format(shape + '<emitter type="constant"/>'), encoding="utf-8")
        return _by(path, scene)
    basis = ("linear", "bezier", "bspline", "catmull-rom")[_choice(path, 4)]
    described = {"type": "curves", "file": path.name, "radius": 0.1, "basis": basis}
    own = Scene.model_validate({"camera": _CAMERA, "shapes": [described]}).placed("here", path.parent)
    try:
        return flatten(own, 8, 8)
    except ClrenderError as error:
        raise type(error)(str(error).replace("shapes[0] reaches", f"{path.name} reaches")) from None


def _hair(path: Path) -> Any:
    scene = path.with_name("uses.xml")
    shape = (
        f'<shape type="hair"><string name="filename" value="{path.name}"/><float name="radius" value="0.02"/></shape>'
    )
    text = _XML.format(shape + '<emitter type="constant"/>').replace("3.0.0", "0.6.0")
    scene.write_text(text, encoding="utf-8")
    return _by(path, scene)


def _measured(path: Path) -> Any:
    described = {
        "camera": _CAMERA,
        "materials": {"m": {"type": "measured", "file": path.name}},
        "shapes": [{"type": "sphere", "center": [0.0, 0.0, 0.0], "radius": 1.0, "material": "m"}],
    }
    arrays = flatten(Scene.model_validate(described).placed("here", path.parent), 8, 8).arrays
    words = arrays["measured_words"]
    if not np.isfinite(words).all():
        raise AssertionError("numbers of a material that are not finite")
    return words


READERS: Final[dict[str, Callable[[Path], Any]]] = {
    ".spd": _pbrt_spectrum,
    MITSUBA_SPECTRUM: _mitsuba_spectrum,
    MITSUBA_SPECTRA: _scene,
    PBRT_SPECTRA: _scene,
    OWN_SPECTRA: _scene,
    OWN_TEXT: _scene,
    CURVES: _curves,
    CURVES_TEXT: _curves,
    ".hair": _hair,
    PBRT_CURVES: _scene,
    ".bsdf": _measured,
    ".binary": _measured,
}
