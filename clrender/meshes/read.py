"""Reads and validates the mesh files that scenes name."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, BinaryIO, Final, TypeVar

import numpy as np

from clrender.errors import OutOfMemory, SceneError
from clrender.files.named import allowed_file, open_named_file
from clrender.meshes.data import COORDINATE_LIMIT, CORNER_ARRAYS, MeshData, filled
from clrender.meshes.vertex_colors import VertexColors
from clrender.wording import counted, quoted

__all__ = ["FILE_LIMIT", "checked_mesh", "read_mesh", "read_serialized_mesh"]

_Found = TypeVar("_Found")

FILE_LIMIT: Final = 2**33
"""Largest mesh file, bytes."""
UV_LIMIT: Final = 1e6
"""Largest magnitude of a texture coordinate: single precision still resolves a sixteenth there."""


def read_mesh(
    name: str, base_folder: Path, allow_paths: Sequence[Path], place: str, colors: VertexColors | None = None
) -> MeshData:
    """Read a mesh file named by a scene.

    Parameters
    ----------
    name : str
        As the scene names it, relative to `base_folder` or absolute; the extension chooses the reader.
    base_folder : pathlib.Path
    allow_paths : sequence of pathlib.Path
        Folders besides `base_folder` whose files, and those of their subfolders, may be read; links are resolved first.
    place : str
        Location of the name in the scene, for error messages.
    colors : VertexColors, optional
        Also read vertex colours, with this encoding.

    Raises
    ------
    SceneError
        If it may not be read, is not a valid mesh, or lacks the colours.
    """
    label = f"{place}: {quoted(name)}"
    read = _reader(
        "".join(Path(name.lower()).suffixes[-2:]) if name.lower().endswith(".gz") else Path(name).suffix.lower()
    )
    if read is None:
        allowed_file(name, base_folder, allow_paths, label)
        raise SceneError(f"{label} is of no kind that can be read; meshes may be .ply, .ply.gz, .obj or .stl")
    mesh = _read(name, base_folder, allow_paths, label, lambda file, size: read(file, size, label, colors))
    if colors is not None and mesh.colors is None:
        text = "has no colours of vertices (red, green, blue), which vertex_colors asks for"
        raise SceneError(f"{label} {text}; export the mesh with them, or leave vertex_colors out")
    return checked_mesh(mesh, label)


def read_serialized_mesh(
    name: str, base_folder: Path, allow_paths: Sequence[Path], place: str, index: int
) -> tuple[MeshData, bool]:
    """Read one mesh of a Mitsuba `.serialized` file.

    Parameters
    ----------
    name, base_folder, allow_paths, place
        See `read_mesh`.
    index : int
        Index of the mesh in the file, from 0.

    Returns
    -------
    mesh : MeshData
    faceted : bool
        Whether the file requests flat shading.

    Raises
    ------
    SceneError
        If it may not be read or is not a valid mesh.
    """
    from clrender.meshes.serialized import read_serialized

    label = f"{place}: {quoted(name)}"
    found = _read(name, base_folder, allow_paths, label, lambda file, size: read_serialized(file, size, label, index))
    return checked_mesh(found.mesh, label), found.faceted


def _read(
    name: str, base_folder: Path, allow_paths: Sequence[Path], label: str, read: Callable[[BinaryIO, int], _Found]
) -> _Found:
    """Open a file and apply a reader to it and its size."""
    file, size = open_named_file(name, base_folder, allow_paths, label, FILE_LIMIT)
    with file:
        if size == 0:
            raise SceneError(f"{label} is empty; it must hold a mesh")
        try:
            return read(file, size)
        except MemoryError:
            raise OutOfMemory(f"{label} is too large for the memory of this machine") from None
        except OSError as error:
            raise SceneError(f"{label} cannot be read: {error.strerror or error}") from None


def _reader(ending: str) -> Callable[[BinaryIO, int, str, VertexColors | None], MeshData] | None:
    """The reader for a file extension, imported on demand: a user's first scenes mostly have no files."""
    if ending == ".ply":
        from clrender.meshes.ply import read_ply

        return read_ply
    if ending == ".ply.gz":
        from clrender.meshes.ply import read_packed_ply

        return read_packed_ply
    if ending == ".obj":
        from clrender.meshes.obj import read_obj

        return read_obj
    if ending == ".stl":
        from clrender.meshes.stl import read_stl

        return read_stl
    return None


def _finite(mesh: MeshData) -> MeshData:
    """The mesh without what is not finite.

    Where normals are not, it has those of its triangles. Texture coordinates become 0, and triangles with such a corner
    are left out, unless all are: then the mesh stays as it is.
    """
    said = [mesh.warning] if mesh.warning else []
    changes: dict[str, Any] = {}
    forgiven, left_out = mesh.forgiven, mesh.left_out
    if mesh.normals is not None:
        normals, gaps = filled(mesh.normals)
        if gaps is not None:
            changes["normals"] = normals
            said.append(
                f"{np.count_nonzero(gaps)} normals are not finite: there the surface has those of its triangles"
            )
            forgiven += 1
    for name in ("uvs", "uvs_1"):
        given = getattr(mesh, name)
        uvs, gaps = (None, None) if given is None else filled(given)
        if gaps is not None:
            changes[name] = uvs
            said.append(f"{np.count_nonzero(gaps)} corners have texture coordinates that are not finite: taken as 0")
            forgiven += 1
    vertices, gaps = filled(mesh.vertices)
    if gaps is not None and (kept := ~gaps[mesh.triangles].any(axis=1)).any():
        changes["vertices"] = vertices
        for name in ("triangles", *CORNER_ARRAYS):
            rows = changes.get(name, getattr(mesh, name))
            changes[name] = None if rows is None else rows[kept]
        if not kept.all():
            said.append(
                f"{counted(int(np.count_nonzero(~kept)), 'triangle has', 'triangles have')} a corner that is not "
                "finite: left out"
            )
            left_out += 1
    return replace(mesh, **changes, warning="; ".join(said), forgiven=forgiven, left_out=left_out) if changes else mesh


def checked_mesh(mesh: MeshData, label: str) -> MeshData:
    """Validate that all numbers of a mesh are in range, and mend what is not finite as far as it leaves something.

    Raises
    ------
    SceneError
        The message begins with `label`.
    """
    mesh = _finite(mesh)
    for array, what in ((mesh.vertices, "vertex"), (mesh.normals, "normal")):
        for start in range(0, 0 if array is None else len(array), 2**20):
            assert array is not None
            chunk = array[start : start + 2**20]
            if chunk.min() >= -COORDINATE_LIMIT and chunk.max() <= COORDINATE_LIMIT:
                continue
            bad = ~(np.abs(chunk) <= COORDINATE_LIMIT).all(axis=1)
            if bad.any():
                row = int(np.argmax(bad))
                values = ", ".join(f"{x:g}" for x in chunk[row])
                limit = f"finite and at most {COORDINATE_LIMIT:g} in size"
                raise SceneError(f"{label}: {what} {start + row} is ({values}), but must be {limit}")
    if mesh.tangents is not None and not np.isfinite(mesh.tangents).all():
        row = int(np.argmax(~np.isfinite(mesh.tangents).all(axis=(1, 2))))
        raise SceneError(f"{label}: triangle {row} has a tangent that is not finite; export it again")
    if mesh.uvs is not None:
        for start in range(0, len(mesh.uvs), 2**20):
            chunk = mesh.uvs[start : start + 2**20]
            if chunk.min() >= -UV_LIMIT and chunk.max() <= UV_LIMIT:
                continue
            worst = np.abs(chunk).max(axis=(1, 2))
            bad = ~(worst <= UV_LIMIT)
            if bad.any():
                row = int(np.argmax(bad))
                found = f"triangle {start + row} has a texture coordinate of size {worst[row]:g}"
                raise SceneError(f"{label}: {found}, but they must be finite and at most {UV_LIMIT:g} in size")
    return mesh
