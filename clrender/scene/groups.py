"""Groups of shapes, and instances: the same group in many places, kept once."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any, ClassVar, Final, Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray
from pydantic import Discriminator, FailFast, Field, Tag, model_validator

from clrender.errors import SceneError
from clrender.files.named import open_named_file
from clrender.files.npy import read_npy_header, read_npy_items
from clrender.meshes.data import COORDINATE_LIMIT
from clrender.scene.poses import Motion
from clrender.scene.shapes import AnyShape, Shape, Transform
from clrender.scene.transforms import affine
from clrender.scene.values import INLINE_LIMIT, SHAPE_LIMIT, FileName, Matrix, Name, Part, fault
from clrender.wording import counted, grouped

__all__ = ["INSTANCE_LIMIT", "Group", "Instance", "ShapeOrInstance", "TransformArray"]

INSTANCE_LIMIT: Final = 2**26
"""Most instances of a scene."""

_FILE_LIMIT: Final = INSTANCE_LIMIT * 16 * 8 + 4096
_MOST_SCALE: Final = 1e9
"""Largest factor by which a map may enlarge or shrink a group: squares of coordinates stay finite."""


class _FailFast(FailFast):
    """A hashable `FailFast`, which pydantic's unions need."""

    __hash__ = object.__hash__


_Transforms: TypeAlias = Annotated[
    Annotated[tuple[Matrix, ...], _FailFast(), Field(min_length=1, max_length=INLINE_LIMIT), Tag("<matrices>")]
    | Annotated[FileName, Tag("<file>")],
    Discriminator(lambda value: "<file>" if isinstance(value, str) else "<matrices>"),
]


class Group(Part):
    """A group of shapes, placed in the scene by instances."""

    shapes: Annotated[tuple[Shape, ...], FailFast(), Field(min_length=1, max_length=SHAPE_LIMIT)]


class Instance(Part):
    """An instance of a group: placed once by `transform`, or many times by `transforms`."""

    # It has none of the other shapes' keys: the group's shapes have them.
    material: ClassVar[None] = None
    emission: ClassVar[None] = None
    interior: ClassVar[None] = None
    shines: ClassVar[bool] = False
    late_keys: ClassVar[frozenset[str]] = frozenset({"motion"})

    type: Literal["instance"]
    name: Name | None = Field(None, description="name in Cryptomatte layers; several shapes may have the same name")
    category: Name | None = Field(
        None,
        description="what it is, such as chair, for the layer of categories; all shapes of the group are then that",
    )
    group: Name = Field(description="name of a group in `[groups]`")
    transform: Transform = Transform()
    motion: Motion = Field((), description="keys of a motion, which acts after the transforms; times ascend")
    transforms: _Transforms | None = Field(
        None,
        description="row-major 4x4 matrices, one per instance; or the name of a NumPy file (.npy) with an array of "
        "shape (n, 3, 4) or (n, 4, 4)",
    )

    @model_validator(mode="after")
    def _is_placed_once(self) -> Instance:
        if self.transforms is None:
            return self
        if "transform" in self.model_fields_set:
            raise fault("instance", "cannot be given together with `transforms`; keep one of them", "transform")
        if isinstance(self.transforms, tuple):
            for i, matrix in enumerate(self.transforms):
                if problem := _problem(np.array([matrix])):
                    raise fault("instance", problem[1], "transforms", i)
        return self

    @property
    def file(self) -> str | None:
        """Name of the file of its transforms, if any."""
        return self.transforms if isinstance(self.transforms, str) else None


class TransformArray:
    """Transforms of instances.

    Parameters
    ----------
    maps : (N, 3, 4) float64
        Affine maps from group space to world space, metres.
    """

    def __init__(self, maps: NDArray[np.float64]) -> None:
        self.maps = maps

    @cached_property
    def _digest(self) -> str:
        return hashlib.sha256(np.ascontiguousarray(self.maps, "<f8").tobytes()).hexdigest()

    def sha256(self) -> str:
        """Hash of the numbers."""
        return self._digest

    @classmethod
    def checked(cls, array: NDArray[Any], place: str) -> TransformArray:
        """Validate an array from outside.

        Parameters
        ----------
        array : (N, 3, 4) or (N, 4, 4) float32 or float64
        place : str
            Prefix of error messages.

        Raises
        ------
        SceneError
            If it is not such an array, or one of its maps is not affine, out of range or not invertible.
        """
        cls._check_shape(array.shape, array.dtype, place)
        if problem := _problem(array):
            raise SceneError(f"{place}[{problem[0]}] {problem[1]}")
        return cls(np.array(array[:, :3], np.float64))

    @classmethod
    def read(cls, name: str, base_folder: Path, allow_paths: Sequence[Path], place: str) -> TransformArray:
        """Read a file that a scene names.

        Raises
        ------
        SceneError
            If it cannot be read or contains no such array.
        """
        file, _ = open_named_file(name, base_folder, allow_paths, f"{place}: {name!r}", _FILE_LIMIT)
        with file:
            try:
                header = read_npy_header(file)
                cls._check_shape(header.shape, header.kind, f"{place}: {name!r}")
                array = read_npy_items(file, header)
            except (ValueError, OSError, MemoryError) as error:
                raise SceneError(
                    f"{place}: {name!r} is no sound NumPy file ({error}); write it with numpy.save"
                ) from None
        return cls.checked(array, f"{place}: {name!r}")

    @staticmethod
    def _check_shape(shape: tuple[int, ...], kind: np.dtype[Any], place: str) -> None:
        if len(shape) != 3 or shape[1:] not in ((3, 4), (4, 4)) or kind.kind != "f" or not shape[0]:
            text = f"holds an array {shape} of {kind}, but must hold (n, 3, 4) or (n, 4, 4) floating-point"
            raise SceneError(f"{place} {text} numbers")
        if shape[0] > INSTANCE_LIMIT:
            raise SceneError(
                f"{place} holds {counted(shape[0], 'transform')}, but {grouped(INSTANCE_LIMIT)} is the most"
            )

    @classmethod
    def of(cls, instance: Instance) -> TransformArray:
        """Transforms of an instance that are written in the scene itself."""
        if isinstance(instance.transforms, tuple):
            return cls(np.array(instance.transforms, np.float64)[:, :3])
        place = affine(instance.transform)
        return cls(np.concatenate([np.array(place.linear), np.array(place.offset)[:, None]], axis=1)[None])


def _problem(array: NDArray[Any]) -> tuple[int, str] | None:
    """Index of the first invalid map, and what is wrong with it."""
    with np.errstate(over="ignore", invalid="ignore"):
        linear = np.asarray(array[:, :3, :3], np.float64)
        wild = ~np.isfinite(array).all(axis=(1, 2)) | (np.abs(array[:, :3]).max(axis=(1, 2)) > COORDINATE_LIMIT)
        bent = (
            (array[:, 3] != np.array([0.0, 0.0, 0.0, 1.0])).any(axis=1) if array.shape[1] == 4 else np.zeros_like(wild)
        )
        (ax, ay, az), (bx, by, bz), c = linear[:, 0].T, linear[:, 1].T, linear[:, 2]
        cross = np.stack([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx], axis=1)
        sizes = np.sqrt((linear * linear).sum(axis=2))
        volume = np.abs((cross * c).sum(axis=1))
        flat = ~(volume > 1e-12 * sizes.prod(axis=1))
        # The smallest factor is at least the volume divided by the square of the largest
        extreme = ~((sizes.max(axis=1) <= _MOST_SCALE) & (volume >= np.square(sizes.max(axis=1)) / _MOST_SCALE))
    for faulty, sentence in (
        (wild, f"holds a number that is not finite, or beyond {COORDINATE_LIMIT:g}"),
        (bent, "does not end with the row [0, 0, 0, 1]: only affine transforms are known"),
        (flat, "cannot be inverted: it would flatten the group"),
        (extreme, f"scales by more than {_MOST_SCALE:g} or less than its inverse; scale the group's shapes instead"),
    ):
        if faulty.any():
            return int(np.argmax(faulty)), sentence
    return None


ShapeOrInstance: TypeAlias = Annotated[AnyShape | Instance, Field(discriminator="type")]
