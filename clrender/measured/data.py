"""A file of measured reflectance."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from clrender.errors import SceneError
from clrender.measured.tables import MerlTable, RglTables, merl_table, rgl_tables
from clrender.measured.tensors import TENSOR_MAGIC, read_tensors

__all__ = ["MeasuredFile"]


@dataclass(frozen=True)
class MeasuredFile:
    """The bytes of a file, which also other renderers read, and what they say.

    Attributes
    ----------
    content : (N,) uint8
    """

    content: NDArray[np.uint8]

    @property
    def ending(self) -> str:
        """``.bsdf`` of the RGL database, or ``.binary`` of the MERL database."""
        return ".bsdf" if self.content[: len(TENSOR_MAGIC)].tobytes() == TENSOR_MAGIC else ".binary"

    def sha256(self) -> str:
        """Hash of the bytes."""
        return self._sha256

    @cached_property
    def _sha256(self) -> str:
        return hashlib.sha256(np.ascontiguousarray(self.content).data).hexdigest()

    @property
    def has_spectra(self) -> bool:
        """Whether it has spectra, not only RGB."""
        return self.ending == ".bsdf" and "spectra" in read_tensors(self.content)

    @cached_property
    def tables(self) -> RglTables | MerlTable:
        """What they say.

        Raises
        ------
        ValueError
            It is no such file, or a damaged one. Files that `checked` made do not raise it.
        """
        if self.ending == ".bsdf":
            return rgl_tables(read_tensors(self.content))
        return merl_table(self.content)

    @classmethod
    def checked(cls, content: NDArray[Any], label: str) -> MeasuredFile:
        """A file with these bytes.

        Parameters
        ----------
        content : (N,) uint8
        label : str
            Beginning of error messages.

        Raises
        ------
        SceneError
            It is no such file, or a damaged one.
        """
        if content.ndim != 1 or content.dtype != np.uint8:
            raise SceneError(f"{label} holds {content.dtype} {content.shape}, but must hold bytes")
        file = cls(content)
        try:
            file.tables  # noqa: B018  # computed here, so that no later use fails
        except ValueError as error:
            raise SceneError(f"{label} is no readable file of measured reflectance: {error}") from None
        return file
