"""Places pbrt's shapes in the scene, with their emission."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from clrender.exact.matrices import inner, length, lengths, product, times, total
from clrender.importers.pbrt.film import Exposure
from clrender.importers.pbrt.parameters import Parameters
from clrender.importers.pbrt.textures import TextureReader
from clrender.importers.shared.curved import mean_of_picture
from clrender.importers.shared.matrices import Matrix, handedness, is_affine, is_similarity, translation
from clrender.importers.shared.meshes import sphere_mesh
from clrender.importers.shared.motions import fault_of_motion, motion_keys
from clrender.importers.shared.staging import Staging
from clrender.importers.shared.strands import StrandCollector
from clrender.meshes.data import MeshData
from clrender.spectra.colors import LUMINANCE
from clrender.wording import quoted

__all__ = ["Part", "Placer"]

_APART: Final = 1e-5
"""Distance between the sides of a two-sided light, as a fraction of its size."""


@dataclass
class Part:
    """A shape that is not placed yet.

    Attributes
    ----------
    described : dict
        As returned by `clrender.importers.pbrt.shapes.ShapeReader.read`.
    emission : Parameters or None
        Parameters of its area light.
    matrix : (4, 4) float64
    line : int
    """

    described: dict[str, Any]
    emission: Parameters | None
    matrix: Matrix
    line: int


class Placer:
    """Adds parts to a draft.

    Parameters
    ----------
    staging : Staging
    textures : TextureReader
    strands : StrandCollector
        Those of the curves.
    """

    def __init__(self, staging: Staging, textures: TextureReader, strands: StrandCollector) -> None:
        self._staging, self._textures, self._strands = staging, textures, strands
        self.exposure = Exposure()
        """What the film makes of all light."""
        self.times = 0.0, 1.0
        """When motions begin and end, seconds."""
        self.moves = False
        """Whether anything moves that was placed."""

    def put(self, part: Part, matrix: Matrix, way: tuple[Matrix, Matrix] | None = None) -> None:
        """Add a shape, with its emission.

        Parameters
        ----------
        part : Part
        matrix : (4, 4) float64
            Its transform to world space; that of the part itself is ignored.
        way : pair of (4, 4) float64, optional
            What follows the transform when the motion begins and when it ends, if it moves.
        """
        if way is not None and (cause := self._unmoved(part, way)):
            self._staging.note(f"{cause}: what moves like that stands where it is at first")
            matrix, way = product(way[0], matrix), None
        if not is_affine(matrix):
            self._staging.leave_out(part.line, "the shape's transform cannot be inverted; give it another")
            return
        described = dict(part.described)
        if described["type"] == "curves" and not is_similarity(matrix):
            described["file"], matrix = self._strands.stretched(described["file"], matrix), np.eye(4)
        if way is not None:
            self.moves = True
            described["motion"] = motion_keys(list(zip(self.times, way, strict=True)))
        if part.emission is None:
            _placed(self._staging, described, matrix, part.line)
            return
        parameters = part.emission
        two_sided, power = parameters.flag("twosided", False), parameters.number("power", -1.0)
        factor = parameters.number("scale", 1.0) * self.exposure.ratio
        if power > 0.0:
            area = _area_of(self._staging, described, matrix if way is None else product(way[0], matrix))
            area *= self._mean_brightness(parameters)
            factor *= power / max((2.0 if two_sided else 1.0) * area * np.pi, 1e-30)
        color = [max(float(x * factor), 0.0) for x in self.exposure.balanced(self._textures.light(parameters, "L"))]
        described["emission"] = self._shining(parameters, color, factor)
        for unknown in parameters.unused():
            self._staging.note(f"{quoted(unknown)} of an area light is not understood and does nothing")
        _placed(self._staging, described, matrix, part.line)
        if two_sided:
            back = _other_side(self._staging, described, matrix)
            if back is None:
                self._staging.note("a light with two sides that is not flat shines from its front only")
            else:
                _placed(self._staging, *back, part.line)

    def _unmoved(self, part: Part, way: tuple[Matrix, Matrix]) -> str:
        """Why a shape cannot go this way; empty if it can."""
        if not self.times[0] < self.times[1]:
            return "TransformTimes do not ascend"
        return fault_of_motion(part.described["type"], way)

    def _mean_brightness(self, parameters: Parameters) -> float:
        """The mean luminance of the picture of an area light; 1 without one."""
        file = parameters.text("filename")
        if not file:
            return 1.0
        picture = {"texture": self._staging.files.name(file, f"line {parameters.line}")}
        mean = mean_of_picture(self._staging, picture, parameters.line)
        return 1.0 if mean is None else float(inner(mean, LUMINANCE)) or 1.0

    def _shining(self, parameters: Parameters, color: list[float], factor: float) -> Any:
        """A colour, a spectrum, which the white balance of a film cannot change, or a picture."""
        file = parameters.text("filename")
        if not file:
            even = self.exposure.balance is None
            return (even and self._textures.spectrum_of_light(parameters, "L", factor)) or color
        if self.exposure.balance is not None:
            self._staging.note("a picture that shines gets the white balance of white")
        name = self._staging.files.name(file, f"line {parameters.line}")
        return {"texture": name, "scale": color}


def _placed(staging: Staging, described: dict[str, Any], matrix: Matrix, line: int) -> None:
    """Add a description of `ShapeReader` with its transform."""
    described = dict(described)
    own = described.pop("own", None)
    if described["type"] == "sphere":
        radius = described.pop("radius")
        described.pop("type")
        staging.sphere(described, radius, product(matrix, own), line)
    elif described["type"] == "disk":
        described.pop("type")
        staging.disk(described, described.pop("radius"), described.pop("height"), matrix, line)
    else:
        staging.shape(described, matrix, line)


def _area_of(staging: Staging, described: dict[str, Any], matrix: Matrix) -> float:
    """Area of a shape in world space, square metres."""
    if described["type"] == "sphere":
        radius = described["radius"]
        if is_similarity(matrix):
            radius *= length(matrix[:3, 0])
            return float(4.0 * np.pi * radius * radius)
        return float(total(lengths(_vector_areas(sphere_mesh(radius), product(matrix, described["own"])))))
    if described["type"] == "disk":
        across = length(np.cross(matrix[:3, 0], matrix[:3, 1]))
        return float(np.pi * described["radius"] * described["radius"] * across)
    return float(total(lengths(_face_areas(staging, described, matrix))))


def _face_areas(staging: Staging, described: dict[str, Any], matrix: Matrix) -> NDArray[np.float64]:
    """Vector areas of the triangles of a shape that is a mesh, in world space."""
    return _vector_areas(staging.draft.meshes[described["file"]], matrix)


def _vector_areas(mesh: MeshData, matrix: Matrix) -> NDArray[np.float64]:
    """Vector areas of a mesh's triangles in world space."""
    vertices = times(matrix[:3, :3], mesh.vertices)
    a, b, c = (vertices[mesh.triangles[:, i]] for i in range(3))
    return np.asarray(np.cross(b - a, c - a) / 2.0)


def _other_side(staging: Staging, described: dict[str, Any], matrix: Matrix) -> tuple[dict[str, Any], Matrix] | None:
    """The back of a flat two-sided light, slightly behind its front; None if it is not flat."""
    if described["type"] == "sphere":
        return None
    if described["type"] == "disk":
        normal = np.cross(matrix[:3, 0], matrix[:3, 1])
        size = described["radius"] * length(matrix[:3, 0])
    else:
        areas = _face_areas(staging, described, matrix)
        normal = total(areas)
        area = float(total(lengths(areas)))
        if length(normal) < 0.999 * area:
            return None
        size = math.sqrt(area)
    if not length(normal) > 0.0:
        return None
    sign = -1.0 if described.get("flip_normals", False) != (handedness(matrix) < 0.0) else 1.0
    x, y, z = -sign * _APART * size * normal / length(normal)
    back = {**described, "flip_normals": not described.get("flip_normals", False)}
    return back, product(translation(x, y, z), matrix)
