"""Reads the mesh files that scenes name: only from allowed folders, only regular files, only sound triangles."""

from __future__ import annotations

import hashlib
import os
import stat
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import BinaryIO, Final

import numpy as np
from numpy.typing import NDArray

from clrender.errors import SceneError
from clrender.scene.values import COORDINATE_LIMIT
from clrender.scene.wording import quoted

__all__ = ["FILE_LIMIT", "TRIANGLE_LIMIT", "MeshData", "inline_mesh", "open_regular", "read_mesh"]

FILE_LIMIT: Final = 2**33
"""Largest mesh file, bytes."""
TRIANGLE_LIMIT: Final = 2**27
"""Most vertices, and most triangles, of a mesh and of a scene."""


@dataclass(frozen=True)
class MeshData:
    """Triangles as a file holds them, before any transform.

    Attributes
    ----------
    vertices : (V, 3) float32 or float64
        Finite, object space.
    triangles : (T, 3) uint32
        Indices below V.
    normals : (V, 3) float32 or float64, or None
        Finite, of any length; zero where the file has none.
    """

    vertices: NDArray[np.floating]
    triangles: NDArray[np.uint32]
    normals: NDArray[np.floating] | None = None

    def sha256(self) -> str:
        """Hash of the three arrays (in float64, so that the width in the file does not count)."""
        return self._sha256

    @cached_property
    def _sha256(self) -> str:
        digest = hashlib.sha256(f"{self.vertices.shape} {self.triangles.shape} {self.normals is None}".encode())
        for array, kind in ((self.vertices, "<f8"), (self.normals, "<f8"), (self.triangles, "<u4")):
            for start in range(0, 0 if array is None else len(array), 2**18):
                assert array is not None
                digest.update(np.ascontiguousarray(array[start : start + 2**18], dtype=kind).tobytes())
        return digest.hexdigest()


def inline_mesh(vertices: Sequence[Sequence[float]], faces: Sequence[Sequence[int]]) -> MeshData:
    """A mesh written into the scene file; its indices have been checked by the model."""
    return MeshData(np.array(vertices, dtype=np.float64), np.array(faces, dtype=np.uint32))


def open_regular(path: Path, label: str, limit: int) -> tuple[BinaryIO, int]:
    """Open a file for reading if it is a regular one of sane size.

    Parameters
    ----------
    path : pathlib.Path
    label : str
        Start of the error message.
    limit : int
        Largest size, bytes.

    Returns
    -------
    file, size
        Positioned at its start; size in bytes.

    Raises
    ------
    SceneError
        If it is missing, unreadable, a folder, a device, a pipe, or too large.
    """
    try:
        # Without O_NONBLOCK, opening a pipe that nobody writes to would wait for ever.
        descriptor = os.open(path, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0))
    except FileNotFoundError:
        raise SceneError(f"{label} does not exist; check its name and folder") from None
    except IsADirectoryError:
        raise SceneError(f"{label} is a folder; name a file in it") from None
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or "the name is not a valid path"
        raise SceneError(f"{label} cannot be opened: {reason}") from None
    try:
        status = os.fstat(descriptor)
        if stat.S_ISDIR(status.st_mode):
            raise SceneError(f"{label} is a folder; name a file in it")
        if not stat.S_ISREG(status.st_mode):
            raise SceneError(f"{label} is a device or a pipe; only regular files are read")
        if status.st_size > limit:
            raise SceneError(f"{label} has {status.st_size} bytes, but at most {limit} are read")
        return os.fdopen(descriptor, "rb"), status.st_size
    except BaseException:
        os.close(descriptor)
        raise


def read_mesh(name: str, base_folder: Path, allow_paths: Sequence[Path], place: str) -> MeshData:
    """Read a mesh file named by a scene.

    Parameters
    ----------
    name : str
        As the scene names it, relative to `base_folder` or absolute; its ending chooses the reader.
    base_folder : pathlib.Path
    allow_paths : sequence of pathlib.Path
        Folders besides `base_folder` from which, and from below which, files may come; links are followed first.
    place : str
        Where the scene names it, for the message.

    Raises
    ------
    SceneError
        If it may not be read or is not a sound mesh.
    """
    label = f"{place}: {quoted(name)}"
    path = _allowed(name, base_folder, allow_paths, label)
    ending = Path(name).suffix.lower()
    if ending not in (".ply", ".obj"):
        raise SceneError(f"{label} is of no kind that can be read; meshes may be .ply or .obj")
    file, size = open_regular(path, label, FILE_LIMIT)
    with file:
        if size == 0:
            raise SceneError(f"{label} is empty; it must hold a mesh")
        try:
            # Imported here: the library behind it takes half a second, and most scenes name no file.
            from clrender.scene.mesh_files import read_obj, read_ply

            mesh = (read_ply if ending == ".ply" else read_obj)(file, size, label)
        except MemoryError:
            raise SceneError(f"{label} is too large for the memory of this machine") from None
    return _checked(mesh, label)


def _allowed(name: str, base_folder: Path, allow_paths: Sequence[Path], label: str) -> Path:
    """The file behind a name with all links followed, if it lies where files may be read."""
    try:
        path = (base_folder / name).resolve(strict=True)
        folders = [folder.resolve() for folder in (base_folder, *allow_paths)]
    except FileNotFoundError:
        # A message must not tell which files exist outside, so a missing one there reads like any other there.
        path = (base_folder / name).resolve()
        if not any(path.is_relative_to(folder.resolve()) for folder in (base_folder, *allow_paths)):
            raise SceneError(_outside(label)) from None
        raise SceneError(f"{label} does not exist; check its name and folder") from None
    except (OSError, RuntimeError, ValueError) as error:
        reason = getattr(error, "strerror", None)
        if isinstance(error, RuntimeError):
            reason = "its links go round in a circle"
        raise SceneError(f"{label} cannot be opened: {reason or 'the name is not a valid path'}") from None
    if not any(path.is_relative_to(folder) for folder in folders):
        raise SceneError(_outside(label))
    return path


def _outside(label: str) -> str:
    cure = "move it there or allow its folder with --allow-path (allow_paths in Python)"
    return f"{label} lies outside the scene's own folder; {cure}"


def _checked(mesh: MeshData, label: str) -> MeshData:
    """The mesh, if all its numbers are finite and in range."""
    for array, what in ((mesh.vertices, "vertex"), (mesh.normals, "normal")):
        for start in range(0, 0 if array is None else len(array), 2**20):
            assert array is not None
            chunk = array[start : start + 2**20]
            bad = ~(np.abs(chunk) <= COORDINATE_LIMIT).all(axis=1)
            if bad.any():
                row = int(np.argmax(bad))
                values = ", ".join(f"{x:g}" for x in chunk[row])
                limit = f"finite and at most {COORDINATE_LIMIT:g} in size"
                raise SceneError(f"{label}: {what} {start + row} is ({values}), but must be {limit}")
    return mesh
