"""Transforms as a scene file says them, and the keys of a motion."""

from __future__ import annotations

from itertools import pairwise
from typing import Annotated, Any, Final, TypeAlias

from pydantic import AfterValidator, BeforeValidator, FailFast, Field, WithJsonSchema, model_validator

from clrender.meshes.data import COORDINATE_LIMIT
from clrender.scene.values import (
    INLINE_LIMIT,
    NUMBER_OR_TRIPLE,
    FileName,
    Finite,
    Matrix,
    Part,
    Vector,
    cross,
    fault,
    length,
    number_as_triple,
)

__all__ = [
    "KEY_LIMIT",
    "TIME_LIMIT",
    "MeshPose",
    "Motion",
    "MotionKey",
    "Poses",
    "Seconds",
    "Transform",
    "ascending",
]

TIME_LIMIT: Final = 1e6
"""Largest time of a scene, seconds: all times are multiples of a tenth of a nanosecond there."""
KEY_LIMIT: Final = 65536
"""Most keys of a motion."""

Seconds = Annotated[Finite, Field(ge=-TIME_LIMIT, le=TIME_LIMIT)]


def _matrix_rows(value: Any) -> Any:
    """Accepts sixteen numbers as four rows of four."""
    if isinstance(value, list | tuple) and len(value) == 16 and not any(isinstance(v, list | tuple) for v in value):
        return [list(value[4 * row : 4 * row + 4]) for row in range(4)]
    return value


class Transform(Part):
    """Scale, then rotation about x, y and z, then translation; or a matrix."""

    translate: Vector = (0.0, 0.0, 0.0)
    rotate_degrees: Vector = Field((0.0, 0.0, 0.0), description="rotation about the x axis, then y, then z")
    scale: Annotated[Vector, BeforeValidator(number_as_triple), WithJsonSchema(NUMBER_OR_TRIPLE)] = (1.0, 1.0, 1.0)
    matrix: Annotated[Matrix, BeforeValidator(_matrix_rows)] | None = Field(None, description="4x4 matrix, row-major")

    @model_validator(mode="after")
    def _is_invertible(self) -> Transform:
        if self.matrix is None:
            if 0.0 in self.scale:
                raise fault("transform", "must not be zero: it would flatten the shape", "scale")
            return self
        if others := sorted(self.model_fields_set - {"matrix", "time"}):
            other = others[0]
            raise fault("transform", f"cannot be given together with `matrix`; keep one of them, not `{other}`", other)
        if self.matrix[3] != (0.0, 0.0, 0.0, 1.0):
            raise fault("transform", "must be [0, 0, 0, 1]: only affine transforms are known", "matrix", 3)
        rows: list[Vector] = [(row[0], row[1], row[2]) for row in self.matrix[:3]]
        size = max(abs(x) for row in self.matrix[:3] for x in row)
        if size > COORDINATE_LIMIT:
            raise fault("transform", f"holds {size:g}, but {COORDINATE_LIMIT:g} is the most", "matrix")
        volume = sum(a * b for a, b in zip(rows[0], cross(rows[1], rows[2]), strict=True))
        if abs(volume) <= 1e-12 * length(rows[0]) * length(rows[1]) * length(rows[2]):
            raise fault("transform", "cannot be inverted: it would flatten the shape", "matrix")
        return self

    def moved(self, by: tuple[float, float, float]) -> Transform:
        """This transform followed by a translation in world space, metres."""
        if self.matrix is None:
            return self.with_checked(translate=tuple(a + b for a, b in zip(self.translate, by, strict=True)))
        rows = [(*row[:3], row[3] + step) for row, step in zip(self.matrix, (*by, 0.0), strict=True)]
        return self.with_checked(matrix=tuple(rows))

    def is_similarity(self) -> bool:
        """Whether it scales uniformly, so that a sphere stays a sphere."""
        if self.matrix is None:
            size = abs(self.scale[0])
            return all(abs(abs(s) - size) <= 1e-6 * size for s in self.scale)
        columns: list[Vector] = [(self.matrix[0][i], self.matrix[1][i], self.matrix[2][i]) for i in range(3)]
        gram = [[sum(p * q for p, q in zip(a, b, strict=True)) for b in columns] for a in columns]
        size = gram[0][0]
        return all(abs(gram[i][j] - (size if i == j else 0.0)) <= 2e-6 * size for i in range(3) for j in range(3))


def _determinant_sign(key: Transform) -> float:
    """1 or -1: whether a transform mirrors."""
    if key.matrix is None:
        x, y, z = key.scale
        volume = x * y * z
    else:
        a, b, c = ((row[0], row[1], row[2]) for row in key.matrix[:3])
        volume = sum(p * q for p, q in zip(a, cross(b, c), strict=True))
    return -1.0 if volume < 0.0 else 1.0


class MotionKey(Transform):
    """Where a motion is at a time; between two keys it is interpolated, before the first and after the last it rests.

    Two keys without a matrix are interpolated by their translations, rotations and scales, so that a rotation by 720
    degrees is two turns. Else by polar decomposition: the rotation along the shortest way.
    """

    time: Seconds = Field(description="seconds")


def ascending(keys: tuple[Any, ...]) -> tuple[Any, ...]:
    """Refuse keys whose times do not ascend."""
    for index, (before, after) in enumerate(pairwise(keys), 1):
        if not before.time < after.time:
            text = f"is {after.time:g}, but must be later than that of the key before, {before.time:g}"
            raise fault("motion", text, index, "time")
    return keys


def _unfolded(keys: tuple[MotionKey, ...]) -> tuple[MotionKey, ...]:
    """Refuse motions that flatten a shape on their way."""
    for index, (before, after) in enumerate(pairwise(keys), 1):
        by_parts = before.matrix is None and after.matrix is None
        if by_parts and any(a * b < 0.0 for a, b in zip(before.scale, after.scale, strict=True)):
            raise fault(
                "motion", "has another sign than in the key before: the shape would be flat on the way", index, "scale"
            )
        if _determinant_sign(before) != _determinant_sign(after):
            raise fault("motion", "mirrors, and the key before does not, or the other way round", index)
    return keys


Motion: TypeAlias = Annotated[
    tuple[MotionKey, ...], FailFast(), Field(max_length=KEY_LIMIT), AfterValidator(ascending), AfterValidator(_unfolded)
]


class MeshPose(Part):
    """The form of a mesh at a time; between two poses every vertex goes straight, before and after them it rests."""

    time: Seconds = Field(description="seconds")
    file: FileName | None = Field(None, description="a mesh with the same triangles")
    vertices: Annotated[tuple[Vector, ...], FailFast(), Field(max_length=INLINE_LIMIT)] = Field(
        (), description="of an inline mesh"
    )

    @model_validator(mode="after")
    def _has_one_source(self) -> MeshPose:
        if (self.file is None) == (not self.vertices):
            raise fault("pose", "needs either `file` or `vertices`")
        return self


Poses: TypeAlias = Annotated[tuple[MeshPose, ...], FailFast(), Field(max_length=KEY_LIMIT), AfterValidator(ascending)]
