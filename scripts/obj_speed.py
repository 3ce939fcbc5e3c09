"""CPU time of reading an OBJ file of a million triangles: as a mesh, as a scene, and by tinyobjloader.

    python scripts/obj_speed.py [--turns N]

Each measurement is a separate process, which has read a small file before; the readers take turns. Needs
`pip install --pre tinyobjloader`, whose times are for parsing alone.
"""

from __future__ import annotations

import argparse
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from typing import Any, Final

import numpy as np

_FORMS: Final = {"v": "{0}", "v/vt": "{0}/{0}", "v//vn": "{0}//{0}", "v/vt/vn": "{0}/{0}/{0}"}
_READERS: Final = ("tinyobjloader", "mesh", "scene")
_SIDE: Final = 708
"""Vertices along each side of the height field."""


def write(path: Path, form: str, side: int) -> None:
    """A height field of 2 (side - 1)^2 triangles."""
    y, x = np.mgrid[0:side, 0:side] * 1.0
    z = 20.0 * np.sin(0.03 * x) * np.cos(0.05 * y) + np.random.default_rng(0).random((side, side))
    slope_y, slope_x = np.gradient(z)
    normals = np.stack([-slope_x, -slope_y, np.ones_like(z)], axis=-1)
    normals /= np.sqrt((normals**2).sum(axis=-1))[..., None]
    tables = {"v": np.stack([x, y, z], axis=-1) / 100.0 - 3.0}
    tables |= {"vt": np.stack([x, y], axis=-1) / side} if "/{0}" in form.replace("//", "") else {}
    tables |= {"vn": normals} if "//" in form or form.count("/") == 2 else {}
    corner = (np.arange(side - 1)[:, None] * side + np.arange(side - 1)).reshape(-1) + 1
    right, up = corner + 1, corner + side
    faces = np.stack([corner, right, up + 1, corner, up + 1, up], axis=1).reshape(-1, 3)
    with path.open("w") as file:
        for kind, table in tables.items():
            rows = table.reshape(-1, table.shape[-1]).tolist()
            file.writelines(f"{kind} {' '.join(f'{number:.6f}' for number in row)}\n" for row in rows)
        file.writelines(f"f {' '.join(form.format(index) for index in row)}\n" for row in faces.tolist())


def reader(name: str) -> Callable[[Path], Any]:
    """A function that reads a file with one of the three readers."""
    if name == "tinyobjloader":
        tinyobjloader = import_module(name)
        return lambda path: tinyobjloader.ObjReader().ParseFromFile(str(path))
    if name == "scene":
        import clrender

        return clrender.load
    from clrender.meshes.read import read_mesh

    return lambda path: read_mesh(path.name, path.parent, (), "speed")


def main() -> None:
    """Print medians, and their ratios to tinyobjloader's."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--turns", type=int, default=5)
    parser.add_argument("--one", nargs=2, help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.one:
        read, path = reader(given.one[0]), Path(given.one[1])
        read(path.parent / "small.obj")
        start = time.process_time()
        if read(path) is False:
            sys.exit(f"{given.one[0]} cannot read {path}")
        print(time.process_time() - start)
        return
    with tempfile.TemporaryDirectory() as folder:
        write(Path(folder) / "small.obj", _FORMS["v"], 3)
        for number, form in enumerate(_FORMS.values()):
            write(Path(folder) / f"{number}.obj", form, _SIDE)
        seconds: dict[tuple[int, str], list[float]] = {}
        for _ in range(given.turns):
            for number in range(len(_FORMS)):
                for name in _READERS:
                    command = [sys.executable, __file__, "--one", name, str(Path(folder) / f"{number}.obj")]
                    output = subprocess.run(command, check=True, capture_output=True, text=True).stdout
                    seconds.setdefault((number, name), []).append(float(output))
    for number, form in enumerate(_FORMS):
        medians = {name: statistics.median(seconds[number, name]) for name in _READERS}
        text = "  ".join(f"{name} {m:.3f} s ({m / medians['tinyobjloader']:.2f})" for name, m in medians.items())
        print(f"{form:8} {text}")


if __name__ == "__main__":
    main()
