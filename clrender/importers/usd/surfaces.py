"""Converts the meshes of a USD stage to triangles, a mesh for each material."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Final, NoReturn

import numpy as np
from numpy.typing import NDArray

from clrender.errors import SceneError
from clrender.importers.asset_files import AssetFiles
from clrender.importers.draft import Draft
from clrender.importers.shared.meshes import smoothed, without_area
from clrender.importers.usd.materials import Materials, Used
from clrender.importers.usd.process import Stage
from clrender.meshes.data import COORDINATE_LIMIT, TRIANGLE_LIMIT, MeshData
from clrender.meshes.polygons import triangulate
from clrender.meshes.read import UV_LIMIT
from clrender.wording import counted, quoted

__all__ = ["Part", "Surfaces"]

_Floats = NDArray[np.float64]
_PER_POINT: Final = ("vertex", "varying")
_SMOOTH: Final = ("catmullClark", "loop")


@dataclass(frozen=True)
class Part:
    """The faces of a mesh that have one material.

    Attributes
    ----------
    mesh : str
        Name in the draft.
    material : Used
    colored : bool
        Whether its vertices have colours.
    poses : tuple of str
        Names of the same mesh at the other times, if its points move.
    """

    mesh: str
    material: Used
    colored: bool
    poses: tuple[str, ...] = ()


@dataclass(frozen=True)
class _Faces:
    """The faces that are drawn.

    Attributes
    ----------
    faces : (T,) int64
        The face of each triangle.
    corners : (T, 3) int64
        Its corners, as numbers of the corners of the file.
    points : (T, 3) int64
        Their points.
    """

    faces: NDArray[np.int64]
    corners: NDArray[np.int64]
    points: NDArray[np.int64]

    def only(self, kept: NDArray[np.bool_]) -> _Faces:
        return _Faces(self.faces[kept], self.corners[kept], self.points[kept])


class Surfaces:
    """Converts meshes when something shows them, each once for its materials.

    Parameters
    ----------
    draft : Draft
    files : AssetFiles
    stage : Stage
    materials : Materials
    """

    def __init__(self, draft: Draft, files: AssetFiles, stage: Stage, materials: Materials) -> None:
        self._draft, self._files, self._stage, self._materials = draft, files, stage, materials
        self._made: dict[tuple[Any, ...], list[Part]] = {}
        self._begun: set[int] = set()

    def parts(self, item: dict[str, Any]) -> list[Part]:
        """The meshes of an item; none if it was left out.

        Raises
        ------
        SceneError
            It is damaged, and the files are strict.
        """
        bound = (item["material"], *((number, material) for number, material in item["subsets"]))
        key = (item["mesh"], item["material"], tuple(material for _, material in item["subsets"]))
        if key not in self._made:
            try:
                again = item["mesh"] in self._begun
                self._begun.add(item["mesh"])
                self._made[key] = self._parts(self._stage.tables["meshes"][item["mesh"]], bound, again)
            except SceneError as fault:
                self._draft.leave_out(fault, self._files.source, self._files.strict)
                self._made[key] = []
        return self._made[key]

    def _refuse(self, mesh: dict[str, Any], sentence: str) -> NoReturn:
        raise SceneError(f"{self._files.source}: {quoted(mesh['path'])} {sentence}")

    def _parts(self, mesh: dict[str, Any], bound: tuple[Any, ...], again: bool) -> list[Part]:
        faces, points = self._faces(mesh)
        if len(faces.faces) == 0:
            self._draft.note(f"{quoted(mesh['path'])} was left out: it has no faces")
            return []
        count = int(self._required(mesh, "counts").shape[0])
        owner = np.zeros(count, np.int64)
        for number, (indices, _) in enumerate(bound[1:], start=1):
            chosen = self._stage.array(indices)
            if chosen is not None:
                owner[chosen[(chosen >= 0) & (chosen < count)]] = number
        keys = [bound[0], *(material for _, material in bound[1:])]
        parts: list[Part] = []
        # Subsets without a material of their own, and of the same one, are one part
        groups: dict[str | None, list[int]] = {}
        for number, each in enumerate(keys):
            groups.setdefault(each, []).append(number)
        smooth = self._smooth(mesh, faces, points)
        for each, numbers in groups.items():
            kept = np.isin(owner[faces.faces], numbers)
            if kept.any():
                name = mesh["path"] if len(groups) == 1 else f"{mesh['path']} ({each or 'no material'})"
                name = f"{name} of {len(self._draft.meshes)}" if again else name
                part = self._part(mesh, faces.only(kept), points, smooth, each, name)
                parts += [] if part is None else [part]
        return parts

    def _smooth(self, mesh: dict[str, Any], faces: _Faces, points: list[_Floats]) -> list[_Floats]:
        """Normals of the points at all times, of the whole mesh before it is cut; none if it is not smooth."""
        smooth = mesh["scheme"] in _SMOOTH
        if mesh["scheme"] != "none":
            self._draft.note("subdivision surfaces are drawn as the meshes of their cages, with smooth normals")
        elif mesh["deformed"] and self._normals(mesh, faces):
            self._draft.note("meshes that a skeleton deforms have smooth normals in the place of their own")
            smooth = True
        triangles = faces.points.astype(np.uint32)
        return [np.asarray(smoothed(MeshData(each, triangles)).normals) for each in points] if smooth else []

    def _required(self, mesh: dict[str, Any], name: str) -> NDArray[Any]:
        found = self._stage.array(mesh[name] if isinstance(mesh[name], int | None) else mesh[name][0])
        if found is None:
            self._refuse(mesh, f"has no {name}; export it again")
        return found

    def _faces(self, mesh: dict[str, Any]) -> tuple[_Faces, list[_Floats]]:
        """The triangles of the faces that can be drawn, and the points at all times."""
        names = {"counts": "faceVertexCounts", "indices": "faceVertexIndices", "points": "points"}
        found = {key: self._stage.array(mesh[key][0] if key == "points" else mesh[key]) for key in names}
        for key, told in names.items():
            if found[key] is None:
                self._refuse(mesh, f"has no {told}; export it again")
        counts, indices = np.asarray(found["counts"]), np.asarray(found["indices"])
        points = [
            np.asarray(each).reshape(-1, 3) for each in map(self._stage.array, mesh["points"]) if each is not None
        ]
        if int(np.maximum(counts, 0).sum()) != len(indices) or (len(counts) and counts.min() < 0):
            text = f"has {len(indices)} faceVertexIndices, but its faceVertexCounts are of another number"
            self._refuse(mesh, f"{text}; export it again")
        if max(len(points[0]), len(indices)) > TRIANGLE_LIMIT:
            self._refuse(mesh, f"has more than {counted(TRIANGLE_LIMIT, 'point')} or corners; export it in parts")
        if any(len(each) != len(points[0]) for each in points):
            self._draft.note(
                f"{quoted(mesh['path'])}: its number of points changes; it is drawn as at the image's time"
            )
            points = points[:1]
        if any(np.abs(np.where(np.isfinite(each), each, 0.0)).max(initial=0.0) > COORDINATE_LIMIT for each in points):
            self._refuse(mesh, f"has coordinates beyond {COORDINATE_LIMIT:g}; make it smaller")
        first = np.cumsum(counts) - counts
        drawn = counts >= 3
        if not drawn.all():
            self._draft.note(f"{quoted(mesh['path'])}: faces of fewer than three corners were left out")
        holes = self._stage.array(mesh["holes"])
        if holes is not None and len(holes):
            drawn[holes[(holes >= 0) & (holes < len(counts))]] = False
        bad = (indices < 0) | (indices >= len(points[0]))
        gaps = np.zeros(len(points[0]), bool)
        for each in points:
            gaps |= ~np.isfinite(each).all(axis=1)
        bad |= gaps[np.where(bad, 0, indices)] if len(points[0]) else True
        if bad.any():
            sound = np.ones(len(counts), bool)
            sound[np.repeat(np.arange(len(counts)), counts)[bad]] = False
            lost = int(np.count_nonzero(drawn & ~sound))
            if lost:
                text = (
                    f"{quoted(mesh['path'])}: {counted(lost, 'face has', 'faces have')} points that there are "
                    "not, or that are not finite"
                )
                fault = SceneError(f"{self._files.source}: {text}; export it again")
                self._draft.leave_out(fault, self._files.source, self._files.strict)
            drawn &= sound
        kept = np.flatnonzero(drawn)
        empty = np.empty((0, 3), np.int64)
        if not len(kept):
            return _Faces(np.empty(0, np.int64), empty, empty), points
        sizes = counts[kept]
        starts = np.cumsum(sizes) - sizes
        where = np.repeat(first[kept] - starts, sizes) + np.arange(int(sizes.sum()))
        triangles, crossed = triangulate(points[0], indices[where], sizes, self._files.source)
        if crossed:
            self._draft.note(
                f"{quoted(mesh['path'])}: "
                f"{counted(crossed, 'face crosses its own outline', 'faces cross their own outlines')}"
            )
        if mesh["left_handed"]:
            triangles = triangles[:, ::-1]
        corners = where[triangles]
        corners, points = self._fronts(mesh, corners, indices, points)
        return _Faces(np.repeat(kept, sizes - 2), corners, indices[corners]), points

    def _fronts(
        self, mesh: dict[str, Any], corners: NDArray[np.int64], indices: NDArray[np.int64], points: list[_Floats]
    ) -> tuple[NDArray[np.int64], list[_Floats]]:
        """The corners, reversed where joints mirror, so that fronts stay fronts; and the points."""
        sides = [self._stage.array(number) for number in mesh["sides"]]
        of_triangles = [1 if each is None else each[indices[corners]].sum(axis=1) for each in sides]
        if len(points) > 1 and any((np.asarray(of_triangles[0] * each) < 0).any() for each in of_triangles[1:]):
            text = "it rests while the shutter is open: on its way joints make its mirror image"
            self._draft.note(f"{quoted(mesh['path'])}: {text}")
            points = points[:1]
        mirrored = np.asarray(of_triangles[0] < 0 if of_triangles else False)
        return (np.where(mirrored[:, None], corners[:, ::-1], corners) if mirrored.any() else corners), points

    def _part(
        self,
        mesh: dict[str, Any],
        faces: _Faces,
        points: list[_Floats],
        smooth: list[_Floats],
        material: str | None,
        name: str,
    ) -> Part | None:
        colors, opacity = self._display(mesh, faces)
        plain = material is None
        constant = None
        if plain and colors is not None and not np.ptp(colors.reshape(-1, 3), axis=0).any():
            constant, colors = [float(x) for x in colors[0, 0]], None
        used = self._materials.of(material, [1.0] * 3 if plain and colors is not None else constant, opacity)
        if not plain:
            colors = None if used.colors is None else self._colors(mesh, faces, used.colors)
        uvs = [self._uvs(mesh, faces, each, used) for each in used.sets]
        own = self._normals(mesh, faces)[: len(points)] if mesh["scheme"] == "none" and not smooth else []
        if own:
            number, triangles, normals = _split(faces.points, own)
        else:
            number, triangles = _compact(faces.points)
            normals = [each[number] for each in smooth]
        if all(without_area(each[number], triangles) for each in points):
            self._draft.note(f"{quoted(name)} was left out: it has no area")
            return None
        made: list[str] = []
        for time, each in enumerate(points):
            data = MeshData(each[number], triangles, normals[min(time, len(normals) - 1)] if normals else None)
            if time == 0:  # poses have vertices and normals only
                data = replace(data, uvs=uvs[0] if uvs else None, uvs_1=uvs[1] if len(uvs) > 1 else None, colors=colors)
            made.append(name if time == 0 else f"{name} at time {time}")
            self._draft.meshes[made[-1]] = data
        if mesh["double_sided"] and used.shines:
            self._draft.note("double-sided meshes shine from their fronts only; they reflect on both sides")
        return Part(name, used, colors is not None, tuple(made[1:]))

    def _display(self, mesh: dict[str, Any], faces: _Faces) -> tuple[NDArray[np.float32] | None, float]:
        """Colours of corners, (T, 3, 3), and an opacity, for what has no material."""
        opacity = 1.0
        given = self._corners(mesh, faces, "displayOpacity", 1)
        if given is not None:
            opacity = float(given.min())
            if float(given.max()) != opacity:
                self._draft.note(f"{quoted(mesh['path'])}: its displayOpacity varies, and was left out")
                opacity = 1.0
        return self._colors(mesh, faces, "displayColor"), opacity

    def _colors(self, mesh: dict[str, Any], faces: _Faces, name: str) -> NDArray[np.float32] | None:
        found = self._corners(mesh, faces, name, 3)
        if found is None:
            return None
        if not (float(found.min()) >= 0.0 and float(found.max()) <= 1.0):
            self._draft.note(f"{quoted(mesh['path'])}: {name} goes beyond 0 to 1, where it was cut off")
            found = np.clip(np.nan_to_num(found), 0.0, 1.0)
        return np.ascontiguousarray(found, np.float32)

    def _uvs(self, mesh: dict[str, Any], faces: _Faces, name: str, used: Used) -> NDArray[np.float32]:
        found = self._corners(mesh, faces, name, 2)
        if found is None:
            text = f"{quoted(mesh['path'])} has no coordinates {quoted(name)}, which {quoted(used.name)} needs"
            self._draft.note(f"{text}: its textures show one place there")
            return np.zeros((len(faces.faces), 3, 2), np.float32)
        if not np.abs(found).max() <= UV_LIMIT:
            self._refuse(mesh, f"has coordinates {quoted(name)} beyond {UV_LIMIT:g}; make them smaller")
        return np.ascontiguousarray(found, np.float32)

    def _normals(self, mesh: dict[str, Any], faces: _Faces) -> list[_Floats]:
        """Normals of the triangles' corners, (T, 3, 3), at all times if they change; none if it has none."""
        made: list[_Floats] = []
        for number in mesh["normals"]:
            values = self._stage.array(number)
            if values is None or not len(values):
                break
            found = self._spread(mesh, faces, values.reshape(-1, 3), mesh["normals_interpolation"], "normals")
            if found is None:
                break
            if not np.isfinite(found).all():
                self._draft.note(f"{quoted(mesh['path'])}: normals that are not finite were left out")
                found = np.where(np.isfinite(found).all(axis=2, keepdims=True), found, 0.0)
            made.append(np.asarray(found, np.float64))
        return made if len(made) == len(mesh["normals"]) else made[:1]

    def _corners(self, mesh: dict[str, Any], faces: _Faces, name: str, size: int) -> NDArray[Any] | None:
        """A primvar at the triangles' corners, (T, 3, size)."""
        given = mesh["primvars"].get(name)
        values = None if given is None else self._stage.array(given["values"])
        if given is None or values is None or not len(values):
            return None
        if values.size % size or values.size // size != len(values):
            self._draft.note(f"{quoted(mesh['path'])}: the primvar {quoted(name)} has no {size} numbers: left out")
            return None
        return self._spread(mesh, faces, values.reshape(-1, size), given["interpolation"], name)

    def _spread(
        self, mesh: dict[str, Any], faces: _Faces, values: NDArray[Any], interpolation: str, name: str
    ) -> NDArray[Any] | None:
        shape = (*faces.corners.shape, values.shape[1])
        if interpolation == "constant":
            return np.broadcast_to(values[:1, None], shape)
        where = faces.corners
        if interpolation in _PER_POINT:
            where = faces.points
        elif interpolation == "uniform":
            where = np.broadcast_to(faces.faces[:, None], faces.corners.shape)
        if int(where.max()) >= len(values):
            text = (
                f"{quoted(mesh['path'])}: {quoted(name)} has {counted(len(values), 'value')}, fewer than its "
                f"{interpolation} ones"
            )
            self._draft.note(f"{text} must be: left out")
            return None
        return np.asarray(values[where])


def _compact(points: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.uint32]]:
    """The points that are used, and the triangles by their places among these."""
    number, triangles = np.unique(points, return_inverse=True)
    return number, triangles.reshape(points.shape).astype(np.uint32)


def _split(
    points: NDArray[np.int64], normals: list[_Floats]
) -> tuple[NDArray[np.int64], NDArray[np.uint32], list[_Floats]]:
    """Points, triangles and normals of vertices, a vertex for each point and each of its normals at all times."""
    labels = points.reshape(-1)
    for each in normals:
        rows = np.concatenate([labels[:, None].astype(np.float64), each.reshape(-1, 3) + 0.0], axis=1)
        _, first, labels = np.unique(rows, axis=0, return_index=True, return_inverse=True)
        labels = labels.reshape(-1)
    triangles = labels.reshape(points.shape).astype(np.uint32)
    return points.reshape(-1)[first], triangles, [each.reshape(-1, 3)[first] + 0.0 for each in normals]
