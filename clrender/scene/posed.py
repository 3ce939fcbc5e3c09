"""Meshes that change their form: poses in time, between which every vertex goes straight."""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from clrender.errors import SceneError
from clrender.wording import counted, place

if TYPE_CHECKING:
    from collections.abc import Sequence

    from clrender.meshes.data import MeshData
    from clrender.scene.contents import SceneContents
    from clrender.scene.description import Scene
    from clrender.scene.shapes import Mesh

__all__ = ["Deformation", "deformation_of", "deforms", "pose_meshes", "standing"]

_Place = tuple[str | int, ...]


@dataclasses.dataclass(frozen=True)
class Deformation:
    """A mesh while the shutter is open.

    Attributes
    ----------
    shares : (K,) float64
        Times, as shares of the interval: the first is 0, the last 1.
    meshes : tuple of MeshData
        At these times, with the same triangles.
    """

    shares: npt.NDArray[np.float64]
    meshes: tuple[MeshData, ...]


def pose_meshes(scene: SceneContents, at: _Place, shape: Mesh) -> list[MeshData]:
    """The meshes of a shape's poses: its own, with the vertices, normals and tangents of each.

    Where a pose moves vertices and brings no tangents, they follow from the texture coordinates, if there are any.

    Parameters
    ----------
    scene : SceneContents
    at : tuple of str or int
        Location of the shape, for messages.
    shape : Mesh

    Returns
    -------
    list of MeshData
        In the order of the poses.

    Raises
    ------
    SceneError
        A file cannot be read, or has other triangles than the shape's own mesh.
    """
    own, found = scene.mesh_of(at, shape), []
    for number in range(len(shape.poses)):
        here = (*at, "poses", number)
        posed = scene.mesh_of(here, shape.posed(number))
        key = "vertices" if shape.file is None else "file"
        where = f"{scene.source}: {place((*here, key))}"
        if len(posed.vertices) != len(own.vertices):
            text = f"has {counted(len(posed.vertices), 'vertex', 'vertices')}, and the mesh has {len(own.vertices)}"
            raise SceneError(f"{where} {text}; a pose moves the vertices of one mesh")
        if not np.array_equal(posed.triangles, own.triangles):
            raise SceneError(f"{where} has other triangles than the mesh; a pose moves the vertices of one mesh")
        if (posed.normals is None) != (own.normals is None):
            has, lacks = ("the mesh", "this pose") if posed.normals is None else ("this pose", "the mesh")
            raise SceneError(f"{where}: {has} has vertex normals, and {lacks} has none; export both alike")
        tangents = posed.tangents
        if tangents is None and (own.uvs is None or np.array_equal(posed.vertices, own.vertices)):
            tangents = own.tangents
        found.append(dataclasses.replace(own, vertices=posed.vertices, normals=posed.normals, tangents=tangents))
    return found


def deforms(shape: Mesh, begin: float, end: float) -> bool:
    """Whether a mesh changes its form in an interval of time, seconds."""
    times = [pose.time for pose in shape.poses]
    return bool(begin < end and len(times) > 1 and begin < times[-1] and end > times[0])


def _at(meshes: Sequence[MeshData], times: npt.NDArray[np.float64], time: float) -> MeshData:
    """The mesh at a time: that of the first pose before it, and of the last one after it."""
    after = int(np.searchsorted(times, time, side="right"))
    if after == 0 or after == len(times):
        return meshes[max(after - 1, 0)]
    one, other = meshes[after - 1], meshes[after]
    share = (time - float(times[after - 1])) / float(times[after] - times[after - 1])
    if share == 0.0:
        return one

    def between(a: npt.NDArray[np.floating], b: npt.NDArray[np.floating]) -> npt.NDArray[np.float64]:
        first, second = a.astype(np.float64), b.astype(np.float64)
        return np.asarray((1.0 - share) * first + share * second)

    normals = tangents = None
    if one.normals is not None and other.normals is not None:
        normals = between(one.normals, other.normals)
    if one.tangents is not None and other.tangents is not None:
        tangents = between(one.tangents, other.tangents).astype(np.float32)
        tangents[..., 3] = one.tangents[..., 3]
    return dataclasses.replace(one, vertices=between(one.vertices, other.vertices), normals=normals, tangents=tangents)


def deformation_of(scene: Scene, at: _Place, shape: Mesh) -> Deformation:
    """A shape's mesh over the interval of the scene's camera: at its ends, and at all poses between them."""
    begin, end = scene.camera.interval
    times = np.array([pose.time for pose in shape.poses])
    meshes = pose_meshes(scene, at, shape)
    moments = np.array([begin, *times[(times > begin) & (times < end)].tolist(), end])
    return Deformation((moments - begin) / (end - begin), tuple(_at(meshes, times, time) for time in moments.tolist()))


def standing(scene: Scene, shapes: Sequence[tuple[_Place, Mesh]]) -> tuple[list[Mesh], Scene]:
    """Meshes as they are when the shutter opens.

    Parameters
    ----------
    scene : Scene
    shapes : sequence of (place, Mesh)
        Shapes with poses.

    Returns
    -------
    shapes : list of Mesh
        Without poses.
    scene : Scene
        The scene, with what their files hold.
    """
    time, made, meshes = scene.camera.interval[0], [], {}
    for at, shape in shapes:
        times = np.array([pose.time for pose in shape.poses])
        mesh = _at(pose_meshes(scene, at, shape), times, time)
        if shape.file is None:
            rows = tuple(map(tuple, mesh.vertices.tolist()))
            made.append(shape.with_checked(vertices=rows, poses=()))
            continue
        name = f"{shape.file} of {place(at)} at {time!r} s"
        meshes[name, shape.vertex_colors] = mesh
        made.append(shape.with_checked(file=name, poses=()))
    return made, scene.with_files(meshes=meshes) if meshes else scene
