"""Reads mutated files of every format, in a process of its own: `mutate_files.py FOLDER COUNT SEED ENDING…`.

Prints a line for each file that is answered with anything but what it should hold or one sentence, and at
the end how many there were, how many of them were read all the same, and the most memory the program took, in MiB.
"""

from __future__ import annotations

import copy
import math
import random
import re
import signal
import struct
import sys
import time
import traceback
import zlib
from collections.abc import Callable, Iterator
from pathlib import Path
from types import FrameType
from typing import Any

import mutated_formats
import numpy as np
import OpenEXR
import peer_scenes
from gltf_files import Model, meshopt_compressed
from grid_files import nanovdb_bytes, vol_bytes
from ktx2_files import ETC1S, ktx2, plain, uastc, zstd
from PIL import Image
from serialized_files import serialized

from clrender.errors import ClrenderError
from clrender.film import Film
from clrender.flatten.flat_scene import flatten
from clrender.flatten.lamp_tables import lamp_table
from clrender.image.files import read_image, read_provenance, write_image
from clrender.importers import load
from clrender.meshes.read import read_mesh, read_serialized_mesh
from clrender.scene import Scene
from clrender.scene.ies import read_ies
from clrender.spectra.kernel_table import kernel_table

__all__ = ["main"]

PLACES = "-places.npy"
"""Not a format's ending: `.npy` alone is an image."""
MESHOPT = "-meshopt.glb"
"""Not a format's ending: a `.glb` compressed by meshoptimizer, each of which takes a process."""
SECONDS = 10
RASTER: dict[str, list[dict[str, Any]]] = {
    ".tga": [{}, {"compression": "tga_rle"}],
    ".bmp": [{}],
    ".ppm": [{}],
    ".tif": [{}, *({"compression": name} for name in ("tiff_lzw", "tiff_adobe_deflate", "packbits", "jpeg"))],
    ".gif": [{}],
    ".dds": [{}, {"pixel_format": "DXT1"}, {"pixel_format": "DXT5"}],
}
"""Formats of other programs, and the ways in which they are saved."""
WORDS = [b"nan", b"-1", b"1e999", b"99999999999", b"\n", b" ", b"/", b"-", b"\\\n", b"#", b"0", b"(", b"'", b"\0", b"="]
NUMBERS = [0, 1, 2, 127, 128, 255, 256, 32767, 65535, 65536, 2**20, 2**31 - 1, 2**31, 2**32 - 1]
VALUES: list[Any] = [None, True, -1, 0.5, 1e308, 10**400, "", "x", "\ud800", [], {}, [0], [[]], {"a": {}}, [1, 2, 3]]
PLY = (
    b"ply\nformat %b 1.0\ncomment c\nelement vertex 5\nproperty float x\nproperty float y\nproperty float z\n"
    b"property uchar red\nproperty uchar green\nproperty uchar blue\n"
    b"element face 4\nproperty list uchar int vertex_indices\nend_header\n"
)
FACES = [[0, 1, 2], [0, 1, 2, 3], [2, 3, 4], [0, 1, 2, 3, 4]]
OBJ = (
    b"# a mesh\no thing\nv 0 0 0 1 0 0\nv 1 0 0 0 .5 1\nv 1 1 .25 1 1 1\nv 0 1e0 0 0 0 0\n"
    b"v .5 .5 1. 0 1 0\nvt 0 0\nvn 0 0 1\nvn 0 1 0\n"
    b"f 1//1 2//1 3//2\nf 1/1/1 2/1/1 3/1/1 4/1/1\nf -5//1 -4//1 \\\n-1//-1\nf 1//1 2//1 3//1 5//1 4//1\n"
)
MTL = (
    b"# materials\nnewmtl red\nKa 1 1 1\nKd .8 0.1 .1\nKs .5 .5 .5\nNs 96.1\nNi 1.45\nd .9\nillum 2\n"
    b"map_Kd -s 2 2 1 -o .5 0 -clamp on no picture.png\nbump -bm .5 no.png\nnewmtl glass\nillum 7\nTf .9 1 .9\nNi 1.5\n"
    b"newmtl paint\nKd 1 .5 0\nPr .3\nPm 1\nPc .5\nPcr 0.1\nPs .2\naniso .5\nanisor .25\nKe 1 2 3\nTr .1\n"
)
USES = b"mtllib mutated.mtl\n" + OBJ.replace(b"f 1//1 2", b"usemtl red\ns 1\nf 1//1 2", 1).replace(
    b"f -5", b"o other\nusemtl glass\nf -5"
)
STL = (
    b"solid a b\nfacet normal 0 0 1\n outer loop\n  vertex 0 0 0\n  vertex 1 0 0\n  vertex 1 1 2.5e-1\n endloop\n"
    b"endfacet\nfacet normal 0 0 -1\nouter loop\nvertex 0 0 0\nvertex 1. 0 .0\nvertex -1 +1 0\nendloop\nendfacet\n"
    b"endsolid a b\n"
)


IES = (
    b"IESNA:LM-63-1995\r\n[TEST] x\r\nTILT=INCLUDE\r\n1\r\n2\r\n0 90\r\n1. .9\r\n"
    b"1 1200 1.5 5 3 1 2 .1 .1 0\r\n1 0.9 70\r\n0 22.5 45,67.5 90\r\n0 45 90\r\n"
    b"100 90 60 20 0\r\n100 80. 5e1 2 0\r\n100 70 40 1 0\r\n"
)


def glTF() -> Model:
    """A model with something of all that is read."""
    model = Model()
    model.extend(
        "KHR_lights_punctual", "KHR_texture_transform", "EXT_mesh_gpu_instancing", "KHR_materials_transmission"
    )
    light = {"type": "spot", "spot": {"outerConeAngle": 0.5}, "intensity": 100.0}
    model.root["extensions"] = {"KHR_lights_punctual": {"lights": [light]}}
    turned = {"KHR_texture_transform": {"rotation": 1.0, "offset": [0.5, 0.0], "scale": [2.0, 3.0]}}
    picture = {"index": model.texture([[[1, 2, 3, 4]] * 3] * 2, {"wrapS": 33071}), "extensions": turned}
    glass = {"KHR_materials_transmission": {"transmissionFactor": 1.0, "transmissionTexture": picture}}
    base = {"baseColorTexture": picture, "baseColorFactor": [1, 1, 1, 0.5]}
    material = model.add("materials", {"pbrMetallicRoughness": base, "alphaMode": "BLEND", "extensions": glass})
    mesh = model.quad(material, WEIGHTS_0=[(1, 0, 0, 0)] * 4, NORMAL=[(0, 0, 1)] * 4, COLOR_0=[(1, 0, 0.5)] * 4)
    primitive = model.root["meshes"][mesh]["primitives"][0]
    primitive["attributes"]["JOINTS_0"] = model.accessor([(0, 1, 0, 0)] * 4, "uint8")
    primitive["targets"] = [{"POSITION": model.accessor([(0, 0, 1)] * 4)}]
    sparse = {"bufferView": model.view(bytes([1, 0, 3, 0])), "componentType": 5123}
    values = {"bufferView": model.view(np.ones((2, 3), "<f4").tobytes())}
    model.root["accessors"][0]["sparse"] = {"count": 2, "indices": sparse, "values": values}
    bound = model.accessor(np.tile(np.eye(4), (2, 1, 1)).reshape(2, 16))
    model.add("skins", {"joints": [1, 2], "inverseBindMatrices": bound})
    model.node(mesh=mesh, skin=0, weights=[0.5])
    model.node(translation=[0, 1, 0], rotation=[0, 0, 0, 1], children=[2])
    model.add("nodes", {"scale": [1, -1, 1], "mesh": mesh})
    model.add("cameras", {"type": "perspective", "perspective": {"yfov": 1.0, "znear": 0.1, "aspectRatio": 1.5}})
    moves = {"EXT_mesh_gpu_instancing": {"attributes": {"TRANSLATION": model.accessor([(0, 0, 1), (0, 0, 2)])}}}
    model.node(camera=0, mesh=mesh, extensions={"KHR_lights_punctual": {"light": 0}, **moves})
    sampler = {"input": model.times([0.0, 1.0]), "output": model.accessor([(0, 0, 0), (0, 2, 0)])}
    channel = {"sampler": 0, "target": {"node": 1, "path": "translation"}}
    model.add("animations", {"samplers": [sampler], "channels": [channel]})
    return model


def originals(folder: Path, ending: str) -> list[bytes]:
    """A few sound files of a format."""
    y, x = np.mgrid[0:24, 0:40]
    image = np.stack([x / 7, y / 5, (x * y) % 11], -1).astype(np.float32)
    path = folder / f"original{ending}"
    if ending in mutated_formats.SOUND:
        return mutated_formats.SOUND[ending](folder)
    if ending == ".ply":
        rows = [(np.float32(i % 3), np.float32(i // 2), np.float32(i * 0.1)) for i in range(5)]
        text = b"".join(b"%g %g %g 7 8 9\n" % row for row in rows)
        text += b"".join(b"%d %b\n" % (len(f), " ".join(map(str, f)).encode()) for f in FACES)
        binary = b"".join(struct.pack("<3f3B", *row, 7, 8, 9) for row in rows)
        binary += b"".join(struct.pack(f"<B{len(f)}i", len(f), *f) for f in FACES)
        return [PLY % b"ascii" + text, PLY % b"binary_little_endian" + binary]
    if ending == ".obj":
        return [OBJ, OBJ.replace(b"//", b" ").replace(b"/1/1", b""), USES]
    if ending == ".mtl":
        (folder / "model.obj").write_bytes(USES + b"usemtl paint\nf 1//1 2//1 5//1\n")
        return [MTL]
    if ending == ".stl":
        facets = [struct.pack("<12fH", 0, 0, 1, *(float(i * j % 5) for j in range(9)), 0) for i in range(1, 4)]
        return [STL, b"binary".ljust(80) + struct.pack("<I", 3) + b"".join(facets)]
    if ending == ".ies":
        one = IES[: IES.index(b"100 80.")].replace(b"5 3 1 2", b"5 1 1 2").replace(b"0 45 90\r\n", b"0\r\n")
        return [IES, one[one.index(b"TILT") :]]
    if ending in (".vol", ".nvdb"):
        numbers = image[:7, :6, :].clip(0.0)
        if ending == ".vol":
            return [vol_bytes(numbers), vol_bytes(numbers.astype(np.uint8), (-1, -1, -1, 1, 1, 1))]
        grids = [nanovdb_bytes(numbers, codec=codec, tiles=True) for codec in (1, 2)]
        return [*grids, nanovdb_bytes(numbers, (-9, 4090, 3), codec=0)]
    if ending in (".gltf", ".glb", MESHOPT):
        model = meshopt_compressed(glTF()) if ending == MESHOPT else glTF()
        return [model.gltf() if ending == ".gltf" else model.glb()]
    if ending == ".ktx2":
        model = Model()
        model.extend("KHR_texture_basisu")
        source = model.add("images", {"uri": "mutated.ktx2"})
        texture = model.add("textures", {"extensions": {"KHR_texture_basisu": {"source": source}}})
        base = {"baseColorTexture": {"index": texture}}
        model.node(mesh=model.quad(model.add("materials", {"pbrMetallicRoughness": base})))
        model.write(folder / "picture.gltf")
        blocks = uastc(np.arange(240).reshape(5, 12, 4))
        packed = ktx2(48, 20, zstd(blocks), model=166, scheme=2, room=len(blocks))
        return [ETC1S, ktx2(48, 20, blocks, model=166), packed, plain(np.clip(image * 9.0, 0, 255), True)]
    if ending in (".xml", ".pbrt"):
        peer_scenes.write_parts(folder)
        texts = [peer_scenes.PBRT] if ending == ".pbrt" else [peer_scenes.MITSUBA, peer_scenes.MITSUBA_06]
        return [text.encode() for text in texts]
    if ending == ".serialized":
        points = np.arange(15).reshape(5, 3) * 0.3
        sheet = {"vertices": points, "triangles": [[0, 1, 2], [2, 3, 4]], "normals": points, "uvs": points[:, :2]}
        double = {"vertices": points, "triangles": [[0, 1, 4]], "colors": points / 5.0, "double": True, "flags": 0x10}
        return [serialized([sheet, double], 3), serialized([double, sheet], 4), serialized([sheet])]
    if ending == ".film":
        film = Film(6, 5)
        film.save(path, {"seed": 1})
        return [path.read_bytes()]
    if ending == PLACES:
        maps = np.tile(np.eye(4)[:3], (5, 1, 1)) + np.arange(60).reshape(5, 3, 4) * 0.01
        found = []
        for array in (maps, np.asfortranarray(maps.astype(np.float32)), np.tile(np.eye(4, dtype=np.int8), (2, 1, 1))):
            np.save(path.with_suffix(".npy"), array)
            found.append(path.with_suffix(".npy").read_bytes())
        return found
    if ending in RASTER:
        return _rasters(path, np.clip(image * 50.0, 0, 255).astype(np.uint8), RASTER[ending])
    if ending == ".pfm":
        return [
            kind + image[::-1].tobytes()[: 4 * 40 * 24 * n]
            for kind, n in ((b"PF\n40 24\n-1\n", 3), (b"Pf 40 24 1 \n", 1))
        ]
    write_image(path, image, {"seed": 1})
    found = [path.read_bytes()]
    if ending == ".exr":
        for compression in ("NO", "RLE", "PIZ", "PXR24", "B44", "DWAA"):
            header = {"compression": getattr(OpenEXR, f"{compression}_COMPRESSION"), "type": OpenEXR.scanlineimage}
            with OpenEXR.File(header, {"RGB": image.astype(np.float16)}) as file:
                file.write(str(path))
            found.append(path.read_bytes())
    if ending == ".hdr":
        row = b"\2\2\0\12" + b"".join(bytes([134, value, 4, 1, 2, 3, 200]) for value in (128, 64, 32)) + b"\x8a\x81"
        found.append(b"#?RADIANCE\nEXPOSURE=2\nFORMAT=32-bit_rle_rgbe\n\n-Y 9 +X 10\n" + row * 9)
    return found


def _rasters(path: Path, pixels: Any, ways: list[dict[str, Any]]) -> list[bytes]:
    """Pictures of Pillow, in colours, with alpha, grey and in 16 bits, as far as the format has them."""
    found = []
    for mode in ("RGB", "RGBA", "L", "P", "1", "I;16"):
        for way in ways:
            picture = (
                Image.fromarray(pixels[..., 0].astype(np.uint16) * 257) if mode == "I;16" else Image.fromarray(pixels)
            )
            try:
                (picture if mode == "I;16" else picture.convert(mode)).save(path, **way)
            except (OSError, KeyError, ValueError):
                continue
            found.append(path.read_bytes())
    return found


def _places(value: Any) -> Iterator[tuple[Any, Any]]:
    """All tables and lists of JSON, each with each of its keys."""
    for key, inside in value.items() if isinstance(value, dict) else enumerate(value):
        yield value, key
        if isinstance(inside, dict | list):
            yield from _places(inside)


def changed_model(rng: random.Random, ending: str) -> bytes:
    """A model some values of whose JSON are others, missing or doubled, and some numbers of whose buffer."""
    model = glTF()
    for _ in range(rng.choice([1, 1, 2, 4])):
        place, key = rng.choice(list(_places(model.root)))
        inside = place[key]
        number = isinstance(inside, int | float) and rng.random() < 0.7
        match rng.randrange(10):
            case 0:
                del place[key]
            case 1 if isinstance(place, list):
                place.append(copy.deepcopy(inside))
            case 2 if isinstance(inside, dict):
                inside[rng.choice(["mesh", "sparse", "targets", "extensions", "a/b~", "children"])] = copy.deepcopy(
                    rng.choice(VALUES)
                )
            case _ if number:
                place[key] = rng.choice(
                    [inside + 1, inside - 1, 0.3 * min(inside, 1e9), rng.randrange(8), rng.choice(NUMBERS)]
                )
            case _:
                place[key] = copy.deepcopy(rng.choice(VALUES))
    if rng.random() < 0.3:
        at = rng.randrange(0, len(model.data), 4)
        model.data[at : at + 4] = struct.pack("<f", rng.choice([math.nan, math.inf, 1e38, -1e-40, 7.0]))
    return model.gltf() if ending == ".gltf" else model.glb()


def changed_compression(rng: random.Random) -> bytes:
    """A compressed model some of whose encoded bytes are others, or numbers that say how they are encoded."""
    model = meshopt_compressed(glTF())
    packed = [view for view in model.root["bufferViews"] if "extensions" in view]
    for view in rng.sample(packed, rng.randint(1, 3)):
        extension = view["extensions"]["EXT_meshopt_compression"]
        if rng.random() < 0.7:
            at = extension["byteOffset"] + rng.randrange(extension["byteLength"])
            model.data[at] = rng.randrange(256)
            continue
        match rng.randrange(4):
            case 0:
                extension["filter"] = rng.choice(["OCTAHEDRAL", "QUATERNION", "EXPONENTIAL", "COLOR"])
            case 1:
                extension["mode"] = rng.choice(["TRIANGLES", "INDICES", "ATTRIBUTES"])
            case 2:
                extension["byteLength"] = max(extension["byteLength"] - rng.randint(1, 40), 1)
            case _:
                extension["count"] *= 1024
                view["byteLength"] *= 1024
                model.more_buffers[0]["byteLength"] = 2**20
    return model.glb()


def changed_meshes(data: bytes, rng: random.Random) -> bytes:
    """The file with some of the bytes of its first mesh changed before they were compressed."""
    inflate = zlib.decompressobj()
    body = inflate.decompress(data[4:])
    packed = zlib.compress(mutated(body, rng))
    if rng.random() < 0.2:
        return data[:4] + packed + inflate.unused_data
    kind = "<I" if data[2] == 3 else "<Q"
    count = int.from_bytes(data[-4:], "little")
    second = [4 + len(packed)] if count == 2 else []
    rest = inflate.unused_data[: -4 - count * struct.calcsize(kind)]
    table = b"".join(struct.pack(kind, place) for place in (0, *second))
    return data[:4] + packed + rest + table + data[-4:]


def mutated(data: bytes, rng: random.Random, ending: str = "") -> bytes:
    """The file with some of its bytes changed, cut out, doubled or put in; headers more often than the rest."""
    if ending in (".gltf", ".glb") and rng.random() < 0.8:
        return changed_model(rng, ending)
    if ending == MESHOPT and rng.random() < 0.9:
        return changed_compression(rng)
    if ending == ".serialized" and rng.random() < 0.7:
        return changed_meshes(data, rng)
    if ending == ".binary":
        return mutated_formats.changed_merl(rng)
    if ending == "-spectra.json" and rng.random() < 0.8:
        return mutated_formats.changed_scene(rng, VALUES, NUMBERS)
    new = bytearray(data)
    words = any(mark in data for mark in (b"scene version", b"WorldBegin", b"# spectrum", b"[camera]", b"# hair"))
    for _ in range(rng.randint(1, 4)):
        if words and rng.random() < 0.8:
            _exchange(new, rng)
            continue
        reach = min(len(new), 500) if rng.random() < 0.6 and not words else len(new)
        at = rng.randrange(reach + 1)
        match rng.randrange(7):
            case 0:
                new[at : at + 1] = bytes([rng.randrange(256)])
            case 1:
                new[at : at + 4] = struct.pack(rng.choice("<>") + "I", rng.choice(NUMBERS))
            case 2:
                del new[at : at + rng.randint(1, 30)]
            case 3:
                new[at:at] = new[at : at + rng.randint(1, 60)]
            case 4:
                new[at:at] = rng.choice(WORDS)
            case 5:
                new[at : at + 2] = rng.choice(WORDS)
            case _:
                del new[rng.randrange(len(new) + 1) :]
    return mended(bytes(new)) if rng.random() < 0.5 else bytes(new)


def _exchange(new: bytearray, rng: random.Random) -> None:
    """Put a word, or number, in the place of another of the same text."""
    values = rb'(?<=")[^"<>]*(?=")' if b"<scene" in new and rng.random() < 0.8 else rb"[\w.$-]+"
    found = list(re.finditer(values, bytes(new)))
    if found:
        one, other = rng.choice(found), rng.choice(found)
        new[one.start() : one.end()] = rng.choice([other[0], rng.choice(WORDS), b"1e9", b"-3", b"$spp"])


def mended(data: bytes) -> bytes:
    """A PNG with the checksums that its chunks should have, so that more of it is looked at."""
    if data[:8] != b"\x89PNG\r\n\x1a\n":
        return data
    new, at = bytearray(data), 8
    while at + 12 <= len(new):
        size = int.from_bytes(new[at : at + 4], "big")
        if at + 12 + size > len(new):
            break
        new[at + 8 + size : at + 12 + size] = struct.pack(">I", zlib.crc32(new[at + 4 : at + 8 + size]))
        at += 12 + size
    return bytes(new)


def _mesh(path: Path) -> Any:
    """As a scene of its own, and as a scene names it."""
    problem: ClrenderError | None = None
    try:
        load(path)
    except ClrenderError as error:
        problem = error
    read_mesh(path.name, path.parent, (), "here", None if path.suffix == ".stl" else "auto")
    if problem is not None:
        raise problem


def _serialized(path: Path) -> Any:
    return read_serialized_mesh(path.name, path.parent, (), "here", zlib.crc32(path.read_bytes()) % 3 // 2)


def _library(path: Path) -> Any:
    return load(path.with_name("model.obj"))


def _texture(path: Path) -> Any:
    try:
        return load(path.with_name("picture.gltf"), strict=True)
    except ClrenderError as error:
        raise type(error)(str(error).replace("picture.gltf", f"picture.gltf: {path.name}")) from None


def _image(path: Path) -> Any:
    read_provenance(path)
    return read_image(path)


def _lamp(path: Path) -> Any:
    return lamp_table(read_ies(path.name, path.parent, (), "here"))


def _scene(path: Path) -> Any:
    if path.suffix in (".gltf", ".glb"):
        return flatten(load(path, time_at=0.5), 8, 8)
    scene = load(path)
    # Some of them: it takes ten times as long
    return flatten(scene, 8, 8) if zlib.crc32(path.read_bytes()) % 8 == 0 else scene


def _placements(path: Path) -> Any:
    """As placements of instances."""
    box = {"type": "box", "size": [0.1, 0.1, 0.1]}
    described = {
        "camera": {"position": [0, 0, 5], "target": [0, 0, 0]},
        "groups": {"a": {"shapes": [box]}},
        "shapes": [{"type": "instance", "group": "a", "transforms": path.name}],
    }
    return flatten(Scene.model_validate(described).placed("here", path.parent), 8, 8)


def _grid(path: Path) -> Any:
    """As the density of a medium."""
    medium = {"scattering": 1.0, "density": {"file": path.name}}
    described = {
        "camera": {"position": [0, 0, 5], "target": [0, 0, 0]},
        "shapes": [{"type": "box", "size": [0.1, 0.1, 0.1], "interior": "m"}],
        "media": {"m": medium},
    }
    return flatten(Scene.model_validate(described).placed("here", path.parent), 8, 8)


READERS: dict[str, Callable[[Path], Any]] = {
    ".ply": _mesh,
    ".obj": _mesh,
    ".stl": _mesh,
    ".serialized": _serialized,
    ".mtl": _library,
    ".ies": _lamp,
    ".vol": _grid,
    ".nvdb": _grid,
    ".ktx2": _texture,
    ".film": Film.load,
    ".gltf": _scene,
    ".glb": _scene,
    MESHOPT: _scene,
    ".xml": _scene,
    ".pbrt": _scene,
    PLACES: _placements,
    ".vdb": _grid,
    **mutated_formats.READERS,
}


def _hangs(number: int, frame: FrameType | None) -> None:
    raise BaseException(f"takes more than {SECONDS} seconds")


def _peak_mib() -> int:
    """Most memory that this program held. (`ru_maxrss` begins with that of the process that started it.)"""
    match = re.search(r"VmHWM:\s+(\d+) kB", Path("/proc/self/status").read_text())
    assert match
    return int(match[1]) >> 10


def main(folder: Path, count: int, seed: int, endings: list[str]) -> None:
    signal.signal(signal.SIGALRM, _hangs)
    read = total = 0
    start = time.monotonic()
    for ending in endings:
        sources = originals(folder, ending)
        if ending in mutated_formats.READERS:
            kernel_table()  # once in a process, which takes seconds
        for number in range(count):
            rng = random.Random(f"{seed} {ending} {number}")
            path = folder / f"mutated{ending}"
            path.write_bytes(mutated(rng.choice(sources), rng, ending))
            signal.alarm(SECONDS)
            total += 1
            try:
                READERS.get(ending, _image)(path)
                read += 1
            except ClrenderError as error:
                if "\n" in str(error) or path.name not in str(error) or len(str(error)) > 2000:
                    print(f"{ending} {number}: not one sentence: {error}")
            except BaseException as error:
                where = traceback.extract_tb(error.__traceback__)[-1]
                print(f"{ending} {number}: {type(error).__name__}: {error} ({where.name}, line {where.lineno})")
            signal.alarm(0)
    peak = _peak_mib()
    print(f"{total} files, {read} read, {peak} MiB, {time.monotonic() - start:.0f} s")


if __name__ == "__main__":
    main(Path(sys.argv[1]), int(sys.argv[2]), int(sys.argv[3]), sys.argv[4:])
