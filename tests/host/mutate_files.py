"""Reads mutated files of every format, in a process of its own: `mutate_files.py FOLDER COUNT SEED ENDING…`.

Prints a line for each file that is answered with anything but an image, a mesh, a lamp, a film or one sentence, and at
the end how many there were, how many of them were read all the same, and the most memory the program took, in MiB.
"""

from __future__ import annotations

import random
import re
import signal
import struct
import sys
import time
import traceback
import zlib
from collections.abc import Callable
from pathlib import Path
from types import FrameType
from typing import Any

import numpy as np
import OpenEXR
import rival_scenes

from clrender.errors import ClrenderError
from clrender.film import Film
from clrender.flatten import flatten
from clrender.image.files import read_image, read_provenance, write_image
from clrender.importers import load
from clrender.scene.ies import read_ies
from clrender.scene.lamp_tables import lamp_table
from clrender.scene.mesh_io import read_mesh

__all__ = ["main"]

SECONDS = 10
WORDS = [b"nan", b"-1", b"1e999", b"99999999999", b"\n", b" ", b"/", b"-", b"\\\n", b"#", b"0", b"(", b"'", b"\0", b"="]
NUMBERS = [0, 1, 2, 127, 128, 255, 256, 32767, 65535, 65536, 2**20, 2**31 - 1, 2**31, 2**32 - 1]
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


IES = (
    b"IESNA:LM-63-1995\r\n[TEST] x\r\nTILT=INCLUDE\r\n1\r\n2\r\n0 90\r\n1. .9\r\n"
    b"1 1200 1.5 5 3 1 2 .1 .1 0\r\n1 0.9 70\r\n0 22.5 45,67.5 90\r\n0 45 90\r\n"
    b"100 90 60 20 0\r\n100 80. 5e1 2 0\r\n100 70 40 1 0\r\n"
)


def originals(folder: Path, ending: str) -> list[bytes]:
    """A few sound files of a format."""
    y, x = np.mgrid[0:24, 0:40]
    image = np.stack([x / 7, y / 5, (x * y) % 11], -1).astype(np.float32)
    path = folder / f"original{ending}"
    if ending == ".ply":
        rows = [(np.float32(i % 3), np.float32(i // 2), np.float32(i * 0.1)) for i in range(5)]
        text = b"".join(b"%g %g %g 7 8 9\n" % row for row in rows)
        text += b"".join(b"%d %b\n" % (len(f), " ".join(map(str, f)).encode()) for f in FACES)
        binary = b"".join(struct.pack("<3f3B", *row, 7, 8, 9) for row in rows)
        binary += b"".join(struct.pack(f"<B{len(f)}i", len(f), *f) for f in FACES)
        return [PLY % b"ascii" + text, PLY % b"binary_little_endian" + binary]
    if ending == ".obj":
        return [OBJ, OBJ.replace(b"//", b" ").replace(b"/1/1", b"")]
    if ending == ".ies":
        one = IES[: IES.index(b"100 80.")].replace(b"5 3 1 2", b"5 1 1 2").replace(b"0 45 90\r\n", b"0\r\n")
        return [IES, one[one.index(b"TILT") :]]
    if ending in (".xml", ".pbrt"):
        rival_scenes.write_parts(folder)
        texts = [rival_scenes.PBRT] if ending == ".pbrt" else [rival_scenes.MITSUBA, rival_scenes.MITSUBA_06]
        return [text.encode() for text in texts]
    if ending == ".film":
        film = Film(6, 5)
        film.save(path, {"seed": 1})
        return [path.read_bytes()]
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


def mutated(data: bytes, rng: random.Random) -> bytes:
    """The file with some of its bytes changed, cut out, doubled or put in; headers more often than the rest."""
    new = bytearray(data)
    words = b"scene version" in data or b"WorldBegin" in data  # it is all of one kind
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
    read_mesh(path.name, path.parent, (), "here")
    return read_mesh(path.name, path.parent, (), "here", "auto")


def _image(path: Path) -> Any:
    read_provenance(path)
    return read_image(path)


def _lamp(path: Path) -> Any:
    return lamp_table(read_ies(path.name, path.parent, (), "here"))


def _scene(path: Path) -> Any:
    scene = load(path)
    # Some of them: it takes ten times as long
    return flatten(scene, 8, 8) if zlib.crc32(path.read_bytes()) % 8 == 0 else scene


READERS: dict[str, Callable[[Path], Any]] = {
    ".ply": _mesh,
    ".obj": _mesh,
    ".ies": _lamp,
    ".film": Film.load,
    ".xml": _scene,
    ".pbrt": _scene,
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
        for number in range(count):
            rng = random.Random(f"{seed} {ending} {number}")
            path = folder / f"mutated{ending}"
            path.write_bytes(mutated(rng.choice(sources), rng))
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
