"""Media as Mitsuba's, and which medium is on each side of a surface."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from clrender.exact.matrices import inner, length
from clrender.exporters.grid_vol import write_vol
from clrender.exporters.mitsuba_xml import Element, element, spectrum, transform, value
from clrender.exporters.surfaces import Inside, inside_named, inside_of, tell_of_glow
from clrender.exporters.target import Target
from clrender.flatten.interiors import winding_number
from clrender.scene import Sphere
from clrender.scene.grid_placement import grid_placement
from clrender.scene.medium import Density, Grid, Grids
from clrender.scene.shapes import AnyShape
from clrender.scene.spectra import SpectralColor
from clrender.scene.values import Vector
from clrender.spectra.lifting import unbounded_spectra

__all__ = ["MediumWriter", "Volume"]

_TINY: Final = 1e-30
_EQUAL: Final = 1e-12
"""Relative difference of extinctions that are the same but for roundings."""
_POINTS: Final = 16
"""Points of a boundary that decide about the volume around it."""


@dataclass(frozen=True)
class Volume:
    """What a boundary encloses.

    Attributes
    ----------
    shape : AnyShape
    vertices : (V, 3) float64
        World space.
    triangles : (T, 3) uint32
        Counter-clockwise seen from outside; of a sphere none, and its points on the axes as vertices.
    medium : str or None
        Id of the medium in it.
    index : float
        Index of refraction in it.
    """

    shape: AnyShape
    vertices: NDArray[np.float64]
    triangles: NDArray[np.uint32]
    medium: str | None
    index: float

    @property
    def size(self) -> float:
        """Volume of its box."""
        return float(np.prod(self.vertices.max(axis=0) - self.vertices.min(axis=0)))

    def contains(self, point: NDArray[np.float64], camera: NDArray[np.float64]) -> bool:
        """Whether a point is inside.

        A surface that does not close, such as the front of a room of smoke whose other sides are its walls, has behind
        it what a straight way from the camera to the point enters by it.
        """
        if isinstance(self.shape, Sphere) or self._closed:
            return self._encloses(point)
        return self._encloses(camera) + self._entries(camera, point) > 0

    @cached_property
    def _closed(self) -> bool:
        """Whether every edge, between places of corners, is that of one triangle in each direction."""
        _, places = np.unique(self.vertices, axis=0, return_inverse=True)
        corners = places.reshape(-1)[self.triangles].astype(np.int64)
        begins, ends = corners.reshape(-1), np.roll(corners, -1, axis=1).reshape(-1)
        count = len(self.vertices)
        edges, counts = np.unique(begins * count + ends, return_counts=True)
        back, others = np.unique(ends * count + begins, return_counts=True)
        return np.array_equal(edges, back) and np.array_equal(counts, others)

    def _entries(self, start: NDArray[np.float64], end: NDArray[np.float64]) -> int:
        """How often a straight way enters by the triangles' fronts, less how often it leaves by their backs."""
        a, b, c = (self.vertices[self.triangles[:, i]] for i in range(3))
        across = np.cross(b - a, c - a)
        before, behind = inner(across, start - a), inner(across, end - a)
        sides = [inner(np.cross(p - start, q - start), end - start) for p, q in ((a, b), (b, c), (c, a))]
        enters = (before > 0.0) & (behind <= 0.0) & np.all([side <= 0.0 for side in sides], axis=0)
        leaves = (before <= 0.0) & (behind > 0.0) & np.all([side >= 0.0 for side in sides], axis=0)
        return int(np.count_nonzero(enters)) - int(np.count_nonzero(leaves))

    def _encloses(self, point: NDArray[np.float64]) -> bool:
        low, high = self.vertices.min(axis=0), self.vertices.max(axis=0)
        if not ((low < point) & (point < high)).all():
            return False
        if isinstance(self.shape, Sphere):
            return length(point - (low + high) / 2.0) < float((high - low)[0]) / 2.0
        arrays: dict[str, NDArray[Any]] = {"vertices": self.vertices, "triangles": self.triangles}
        return abs(winding_number(arrays, np.arange(len(self.triangles)), point)) > 0.5


class MediumWriter:
    """Writes media, and finds those around surfaces.

    Parameters
    ----------
    target : Target

    Attributes
    ----------
    written : list of Element
    fog : str or None
        Id of the medium outside of all others.
    """

    def __init__(self, target: Target) -> None:
        self._target = target
        self._ids: dict[str, str] = {}
        self.written: list[Element] = []
        self.volumes: list[Volume] = []
        fog = target.scene.fog
        self.fog = None if fog is None else self._named(inside_named(target.scene, fog))

    def _named(self, inside: Inside) -> str:
        """The id of a medium."""
        tell_of_glow(self._target, inside)
        return self._id(inside.key, inside.name, inside.absorption, inside.scattering, inside.g, inside.grids)

    def _id(self, key: str, wanted: str, absorption: Vector, scattering: Vector, g: float, grids: Grids | None) -> str:
        """The id of a medium of these coefficients, per metre, times its density."""
        if key not in self._ids:
            lost, turned = self._coefficients(wanted, absorption, scattering, grids)
            extinction = lost + turned
            scale = max(float(extinction.max()), _TINY)
            # Where there is no extinction it has the mean, so that one that is a number elsewhere stays one
            none = 0.0 if len(turned) == 3 else math.fsum(turned) / max(math.fsum(extinction), _TINY)
            albedo = np.divide(turned, extinction, out=np.full(len(turned), none), where=extinction > 0.0)
            # Its extinction is a colour, which is at most 1
            share, kind = extinction / scale, "homogeneous" if grids is None else "heterogeneous"
            write = _coefficient if len(share) > 3 else partial(value, "rgb")
            inside = [write("albedo", albedo), write("sigma_t", share)]
            if grids is not None:
                inside[1] = self._grid(wanted, "density", grids.density, share if len(share) == 3 else np.ones(3))
            if grids is not None and grids.albedo is not None:
                inside[0] = self._grid(wanted, "albedo", grids.albedo, albedo)
            phase = element("phase", value("float", "g", g), type="hg")
            inside += [value("float", "scale", scale), phase]
            self._ids[key] = self._target.id("medium", wanted)
            self.written.append(element("medium", *inside, type=kind, id=self._ids[key]))
        return self._ids[key]

    def _coefficients(
        self, name: str, absorption: Vector, scattering: Vector, grids: Grids | None
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Absorption and scattering, (3,), or (95,) if one of them is a spectrum that can be written."""
        given = absorption, scattering
        if not any(isinstance(each, SpectralColor) for each in given):
            return np.array(absorption), np.array(scattering)
        lost, turned = (
            each.values if isinstance(each, SpectralColor) else unbounded_spectra(np.array(each)) for each in given
        )
        if grids is None:
            return lost, turned
        extinction = lost + turned
        if grids.albedo is None and float(extinction.max() - extinction.min()) <= _EQUAL * float(extinction.max()):
            return lost, turned  # the numbers of its grid have one factor
        self._target.leave_out("spectra of media with grids, which are written as colours", "media", name)
        return np.array(absorption), np.array(scattering)

    def _grid(self, name: str, key: str, grid: Grid, factors: NDArray[np.float64]) -> Element:
        """A volume with a grid of a medium, times a factor for each channel."""
        data = self._target.scene.grid(name, key, grid)
        if isinstance(grid, Density) and grid.edges == "fall":
            self._target.leave_out("grids that fall to zero at their edges, which keep their numbers", "media", name)
        equal = (factors == factors[0]).all() and data.channels == 1
        # Extinctions were divided by their largest
        channels = [float(factors[0])] if equal else factors.tolist()
        digest = hashlib.sha256(f"{data.sha256()} {channels}".encode()).hexdigest()
        write = partial(write_vol, grid=data, factors=channels)
        file = self._target.files.add(self._target.folder, name, ".vol", digest, write)
        placed = np.concatenate([grid_placement(grid, data), [[0.0, 0.0, 0.0, 1.0]]])
        raw = [value("boolean", "raw", True)] if len(channels) > 1 else []
        inside = [value("string", "filename", file), transform(placed), *raw]
        return element("volume", *inside, type="gridvolume", name="sigma_t" if key == "density" else key)

    def inside(self, shape: AnyShape) -> str | None:
        """The id of the medium behind a shape's front, if any."""
        inside = inside_of(self._target.scene, shape)
        return None if inside is None else self._named(inside)

    def add(self, shape: AnyShape, vertices: NDArray[np.float64], triangles: NDArray[np.uint32]) -> None:
        """Add a closed shape that light passes into, in world space; for the arrays see `Volume`."""
        material = None if shape.material is None else self._target.scene.materials[shape.material]
        index = getattr(material, "ior", None) or 1.0
        self.volumes.append(Volume(shape, vertices, triangles, self.inside(shape), index))

    def around(
        self, points: NDArray[np.float64], of: AnyShape | None, told: Callable[[], None]
    ) -> tuple[str | None, float]:
        """The medium around a surface, and its index of refraction.

        Parameters
        ----------
        points : (n, 3) float64
            Of the surface, world space.
        of : AnyShape or None
            The shape that has it, whose own volume does not count.
        told : callable
            Called if parts of the surface are in different volumes.
        """
        others = [each for each in self.volumes if each.shape is not of]
        camera = np.array(self._target.scene.camera.position)
        found = [_innermost(others, each, camera) for each in points[:: max(1, len(points) // _POINTS)]]
        if any(each is not found[0] for each in found):
            told()
        return (self.fog, 1.0) if found[0] is None else (found[0].medium, found[0].index)


def _coefficient(name: str, values: NDArray[np.float64]) -> Element:
    """A spectrum, (95,); one that is the same everywhere is a number."""
    constant = float(values.max() - values.min()) <= _EQUAL * float(values.max())
    return element("spectrum", name=name, value=repr(float(values[0]))) if constant else spectrum(name, values)


def _innermost(volumes: list[Volume], point: NDArray[np.float64], camera: NDArray[np.float64]) -> Volume | None:
    return min((each for each in volumes if each.contains(point, camera)), key=lambda each: each.size, default=None)
