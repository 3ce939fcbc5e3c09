"""Collects an importer's results in the form of our scene files: materials, shapes with matrices, meshes, notes."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any, Final, TypeVar

import numpy as np

from clrender.curves import CurveData, read_curves, read_mitsuba_hair
from clrender.errors import OutOfMemory, SceneError
from clrender.exact.matrices import inner, length, product, times
from clrender.files.named import allowed_file
from clrender.grids import GridData, grid_names, read_grid
from clrender.image.pixel_filter import PIXEL_FILTERS
from clrender.importers.asset_files import AssetFiles
from clrender.importers.draft import Draft
from clrender.importers.shared.matrices import (
    Matrix,
    handedness,
    identity,
    is_affine,
    is_similarity,
    transform_key,
    translation,
)
from clrender.importers.shared.meshes import disk_mesh, sphere_mesh
from clrender.measured import RglTables, read_measured
from clrender.meshes.data import MeshData
from clrender.meshes.read import read_mesh
from clrender.scene.values import SHAPE_LIMIT
from clrender.settings import FILTER_RADII
from clrender.spectra.colors import Color
from clrender.wording import counted, quoted

__all__ = ["Staging", "roughness_of"]

_T = TypeVar("_T")
_NAME_LIMIT: Final = 160


def roughness_of(alpha: float) -> float:
    """Our roughness for a microfacet alpha, which is its square."""
    return math.sqrt(min(max(alpha, 0.0), 1.0))


class Staging:
    """A draft under construction.

    Parameters
    ----------
    files : AssetFiles

    Attributes
    ----------
    draft : Draft
    files : AssetFiles
    """

    def __init__(self, files: AssetFiles) -> None:
        self.draft = Draft()
        self.files = files
        self._read: dict[tuple[str, str], tuple[str, bool]] = {}

    def note(self, sentence: str) -> None:
        """Add a note about a deviation from the file, without duplicates."""
        self.draft.note(sentence)

    def leave_out(self, line: int, sentence: str) -> None:
        """Leave something out, and tell why; in strict reading, raise. See `fault` and `Draft.leave_out`."""
        self.draft.leave_out(self.fault(line, sentence), self.files.source, self.files.strict)

    def fault(self, line: int, sentence: str, source: str | None = None) -> SceneError:
        """An error that names the file and the line.

        Parameters
        ----------
        line : int
            From 1.
        sentence : str
        source : str, optional
            Name of an included file.
        """
        return SceneError(f"{source or self.files.source}: line {line}: {sentence}")

    def pixel_filter(self, name: str, radius: float) -> dict[str, Any]:
        """Settings of a pixel filter of ours, stretched to a radius in pixels."""
        own = float(PIXEL_FILTERS[name][1][-1])
        if abs(radius - own) <= 1e-6 * own:
            return {"filter": name}
        least, most = FILTER_RADII
        if not least <= radius <= most:
            self.note(f"the pixel filter {quoted(name)} has a radius of {radius:g}: {least:g} to {most:g} are known")
            radius = min(max(radius, least), most)
        return {"filter": name, "filter_radius": radius}

    def material(self, wanted: str, described: dict[str, Any]) -> str:
        """Add a material; returns its name, which is `wanted` if that is free."""
        materials = self.draft.description["materials"]
        wanted = wanted[:_NAME_LIMIT] or described["type"]
        name, number = wanted, 2
        while name in materials:
            if materials[name] == described:
                return name
            name, number = f"{wanted} {number}", number + 1
        materials[name] = described
        return name

    def medium(self, wanted: str, described: dict[str, Any]) -> str:
        """Add a medium; returns its name, which is `wanted` if that is free or of an equal medium."""
        media = self.draft.description.setdefault("media", {})
        name, number = wanted[:_NAME_LIMIT], 2
        while media.get(name, described) != described:
            name, number = f"{wanted[:_NAME_LIMIT]} {number}", number + 1
        media[name] = described
        return name

    def vacuum(self) -> str:
        """Name of the medium inside of bubbles in others."""
        return self.medium("vacuum", {"absorption": [0.0, 0.0, 0.0]})

    def fog(self, name: str) -> str | None:
        """Fill all space with a medium around the camera; returns its name, or None if it has a grid, which ends."""
        if "density" in self.draft.description["media"][name]:
            self.note(f"the medium {quoted(name)} around the camera, whose grid ends at no shape, is left out")
            return None
        self.draft.description["fog"] = name
        return name

    def note_empty_glass(self) -> None:
        """Tell that glass without media of its own is empty, though it may stand in one."""
        self.note("glass that names no media is empty, also where it stands in one, which goes on in it there")

    def is_solid(self, material: str | None) -> bool:
        """Whether a medium may be inside of the shapes of a material; None is an invisible surface."""
        if material is None:
            return True
        described = self.draft.description["materials"][material]
        lets_in = described["type"] == "dielectric" or described.get("transmission", 0.0) != 0.0
        return lets_in and not described.get("thin")

    def shape(self, described: dict[str, Any], matrix: Matrix, line: int) -> None:
        """Add a shape with a transform.

        Raises
        ------
        SceneError
            There are too many, or the matrix is singular.
        """
        shapes = self.draft.description["shapes"]
        if len(shapes) >= SHAPE_LIMIT:
            raise self.fault(
                line, f"makes more than {counted(SHAPE_LIMIT, 'shape')}, which is the most; use fewer instances"
            )
        if not is_affine(matrix):
            raise self.fault(line, "the shape's transform is no affine one that can be inverted; give it another")
        shapes.append({**described, **transform_key(matrix)})

    def sphere(self, described: dict[str, Any], radius: float, matrix: Matrix, line: int) -> None:
        """Add a sphere about the origin; as triangles if the matrix makes it an ellipsoid."""
        if not radius > 0.0:
            raise self.fault(line, f"the sphere's radius is {radius:g}; it must be above 0")
        if not is_affine(matrix) or is_similarity(matrix):
            self.shape({"type": "sphere", "radius": radius, **described}, matrix, line)
            return
        self.note("a sphere that a transform makes an ellipsoid is approximated by 16384 triangles")
        self.mesh(described, f"sphere of radius {radius!r}", lambda: sphere_mesh(radius), matrix, line)

    def disk(self, described: dict[str, Any], radius: float, height: float, matrix: Matrix, line: int) -> None:
        """Add a disk perpendicular to +z, at `height`; as triangles if the matrix makes it an ellipse."""
        if not is_affine(matrix) or is_similarity(matrix):
            own = {"type": "disk", "center": [0.0, 0.0, height], "normal": [0.0, 0.0, 1.0], "radius": radius}
            self.shape({**own, **described}, matrix, line)
            return
        across, along = matrix[:3, 0], matrix[:3, 1]
        size = length(across)
        if abs(float(inner(along, along)) - size * size) + abs(float(inner(across, along))) > 2e-6 * size * size:
            self.note("a disk that a transform makes an ellipse is approximated by 128 triangles")
            matrix = product(matrix, translation(0.0, 0.0, height))
            self.mesh(described, f"disk of radius {radius!r}", lambda: disk_mesh(radius), matrix, line)
            return
        normal = handedness(matrix) * np.cross(across, along)
        center = times(matrix, [0.0, 0.0, height, 1.0])
        own = {"type": "disk", "center": [float(x) for x in center[:3]], "normal": [float(x) for x in normal]}
        self.shape({**own, "radius": radius * size, **described}, identity(), line)

    def mesh(
        self, described: dict[str, Any], name: str, make: Callable[[], MeshData], matrix: Matrix, line: int
    ) -> None:
        """Add a mesh, which is made when the first shape needs it."""
        if name not in self.draft.meshes:
            self.draft.meshes[name] = make()
        self.shape({"type": "mesh", "file": name, **described}, matrix, line)

    def is_textured(self, described: dict[str, Any]) -> bool:
        """Whether anything on a shape varies over its surface."""
        if isinstance(described.get("emission"), dict):
            return True
        name = described.get("material")
        parts = [name] if name else []
        materials = self.draft.description["materials"]
        while parts:
            material = materials[parts.pop()]
            if any(isinstance(value, dict) for value in material.values()):
                return True
            parts += material.get("materials", [])
        return False

    def lacks_uvs(self, name: str, described: dict[str, Any]) -> bool:
        """Whether a mesh of the draft has no texture coordinates although something on its shape is textured."""
        return self.draft.meshes[name].uvs is None and self.is_textured(described)

    def mesh_of_file(
        self,
        uri: str,
        kind: str,
        line: int,
        adapt: Callable[[MeshData], MeshData],
        read: Callable[[str, Path, Sequence[Path], str], MeshData] = read_mesh,
    ) -> tuple[str, bool] | None:
        """Read a mesh file, once for each way of adapting it.

        A file that is missing or damaged is left out, with a note.

        Parameters
        ----------
        uri : str
        kind : str
            Name of the way of adapting it.
        line : int
        adapt : callable
            Adapts the mesh.
        read : callable
            Like `clrender.meshes.read.read_mesh`.

        Returns
        -------
        name : str
            Name in the draft's meshes.
        had_normals : bool
            Whether the file has vertex normals.

        Raises
        ------
        SceneError
            The file is in a folder that is not allowed, or too large for this machine; or it is missing or damaged, and
            the files are strict.
        """
        key = (uri, kind)
        if key not in self._read:
            place = f"line {line}"
            name = self.files.name(uri, place)
            label = f"{self.files.source}: {place}"
            allowed_file(name, self.files.folder, self.files.allow_paths, f"{label}: {quoted(name)}")
            try:
                mesh = read(name, self.files.folder, self.files.allow_paths, label)
            except OutOfMemory:
                raise
            except SceneError as fault:
                self.draft.leave_out(fault, self.files.source, self.files.strict)
                return None
            self._read[key] = (f"{uri} ({kind})", mesh.normals is not None)
            self.draft.meshes[f"{uri} ({kind})"] = adapt(mesh)
        return self._read[key]

    def grid_of_file(self, uri: str, line: int, within: str = "density") -> str | None:
        """Read the file of a grid; a file that is missing or damaged is left out, with a note.

        Parameters
        ----------
        uri : str
        line : int
        within : str
            Of an ``.nvdb`` file, the name of the grid. But for the density, the draft has it by both names.

        Returns
        -------
        str or None
            Name in the draft's grids.

        Raises
        ------
        SceneError
            See `mesh_of_file`.
        """
        if within == "density":
            return self._kept(uri, line, self.draft.grids, read_grid)
        read: dict[str, GridData] = {}
        name = self._kept(uri, line, read, partial(read_grid, within=within))
        if name is not None:
            self.draft.grids[f"{name} {within}"] = read[name]
        return name

    def has_grid(self, uri: str, line: int, within: str) -> bool:
        """Whether an ``.nvdb`` file, which was read before, has a grid of this name."""
        name = self.files.name(uri, f"line {line}")
        label = f"{self.files.source}: line {line}"
        return within in grid_names(name, self.files.folder, self.files.allow_paths, label)

    def measured_of_file(self, uri: str, line: int) -> str | None:
        """Read a file of measured reflectance; the result is its name in the draft's. See `grid_of_file`."""
        return self._kept(uri, line, self.draft.measured, read_measured)

    def curves_of_file(self, uri: str, line: int, *, hair: bool = False) -> CurveData | None:
        """Strands of a text file, or of one of Mitsuba 0.6's `hair`; one that is missing or damaged is left out, with a
        note. See `grid_of_file`.
        """
        read: dict[str, CurveData] = {}
        name = self._kept(uri, line, read, read_mitsuba_hair if hair else partial(read_curves, ending=".txt"))
        return None if name is None else read[name]

    def _kept(self, uri: str, line: int, kept: dict[str, _T], read: Callable[..., _T]) -> str | None:
        """Read a file if it is not kept yet, and return its name; one that cannot be read is left out, with a note."""
        place = f"line {line}"
        name = self.files.name(uri, place)
        label = f"{self.files.source}: {place}"
        allowed_file(name, self.files.folder, self.files.allow_paths, f"{label}: {quoted(name)}")
        if name not in kept:
            try:
                kept[name] = read(name, self.files.folder, self.files.allow_paths, label)
            except SceneError as fault:
                self.draft.leave_out(fault, self.files.source, self.files.strict)
                return None
        return name

    def measured(self, uri: str, line: int) -> dict[str, Any]:
        """A material of measured reflectance; without its file a diffuse grey, with a note. See `grid_of_file`."""
        name = self.measured_of_file(uri, line)
        if name is None:
            self.note("of measured materials whose file cannot be read: a diffuse grey of 0.5 in their place")
            return {"type": "lambert", "reflectance": [0.5, 0.5, 0.5]}
        tables = self.draft.measured[name].tables
        if isinstance(tables, RglTables) and not tables.isotropic:
            self.note(f"the x axis of {quoted(name)}, which is anisotropic, is the direction around the y axis")
        return {"type": "measured", "file": name}

    def reflectance(self, color: Color, of: str) -> list[float]:
        """A reflectance: clamped to 0 to 1, with a note if it was outside."""
        if all(0.0 <= x <= 1.0 for x in color):
            return list(color)
        self.note(f"{of} goes beyond 0 to 1, which no surface does: clipped")
        return [min(max(x, 0.0), 1.0) if math.isfinite(x) else 0.0 for x in color]

    def within(self, value: float, least: float, most: float, of: str) -> float:
        """A number clamped to what is possible here, with a note if it was outside."""
        inside = min(max(value, least), most)
        if inside != value:
            self.note(f"{quoted(of)} is {value:g}, but must be from {least:g} to {most:g}: {inside:g} in its place")
        return inside

    def share(self, value: float, of: str) -> float:
        """A fraction: clamped to 0 to 1, with a note if it was outside."""
        return self.reflectance((value, value, value), of)[0]
