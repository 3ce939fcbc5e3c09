"""The materials of a scene on a device, each on a triangle: the kernels sample and evaluate directions."""

from __future__ import annotations

import copy
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final, TypeAlias

import numpy as np
import numpy.typing as npt

from clrender import layout
from clrender.device.launch import LaunchConfig
from clrender.device.worker import DeviceWorker
from clrender.flatten.flat_scene import flatten
from clrender.furnace.directions import Floats
from clrender.integrators.descriptor import Pipeline
from clrender.scene import Camera
from clrender.scene.materials import Mix
from clrender.scene.shapes import Mesh

if TYPE_CHECKING:
    from clrender.device import Device
    from clrender.scene import Scene

__all__ = ["Samples", "Surfaces", "Uv"]

_ENTRY: Final = "material/furnace.cl"
_PIPELINE: Final = Pipeline(_ENTRY, "furnace_sample")
Uv: TypeAlias = tuple[float, float]
_CORNERS: Final = ((0.0, 0.0), (1.0, 0.0), (1.0, 1.0))
"""Default texture coordinates of a triangle: half of a quad's."""
_POINT: Final = (0.58, 0.31)
"""Texture coordinates of the measured point, which ``kernels/material/furnace.cl`` defines."""
_CHOICES: Final = 1 << 16
"""Number of choices among mixed materials, to determine their frequencies."""
_GOLDEN: Final = (math.sqrt(5.0) - 1.0) / 2.0
_PADDING: Final = 16
"""Directions are padded to a multiple of this, the most lanes of a work-item."""


@dataclass(frozen=True)
class Samples:
    """Samples of `bsdf_sample`, and `bsdf_eval` of their directions.

    Attributes
    ----------
    directions : (n, 3) float64, unit vectors, the surface's frame
    weights : (n, 3) float64, f |cosθ| / pdf by colour; zero if the path ends
    pdf : (n,) float64, per steradian; 0 for a delta
    values : (n, 3) float64, f |cosθ| of `bsdf_eval`
    density : (n,) float64, pdf of `bsdf_eval`
    """

    directions: Floats
    weights: Floats
    pdf: Floats
    values: Floats
    density: Floats

    @property
    def delta(self) -> npt.NDArray[np.bool_]:
        """Which samples are deltas: without density, but with light."""
        return np.asarray((self.pdf == 0.0) & (self.weights != 0.0).any(axis=1))

    @property
    def lost(self) -> npt.NDArray[np.bool_]:
        """Which samples end the path although light would come from there: failed samples."""
        return np.asarray((self.weights == 0.0).all(axis=1) & (self.values > 0.0).any(axis=1))


class Surfaces:
    """Flat surfaces that face z, one for each material of a scene.

    Each point of a mixed material has one of its parts. The measurement covers many points: each sample is at another
    point, and an evaluation is the mean over all.

    Parameters
    ----------
    device : Device
    scene : Scene
        Only its materials matter.
    cut : LaunchConfig, optional
    faults : mapping, optional
        Macros of ``kernels/material/furnace.cl`` that falsify materials, for tests.
    uvs : sequence of (float, float)
        Texture coordinates at which surfaces can be measured, besides the default ones.

    Attributes
    ----------
    names : tuple of str
        Names of the materials.
    lanes : int
        Paths of a work-item.

    Raises
    ------
    SceneError
        If a material names a file that cannot be read.
    RenderError, DeviceError
        If the driver fails.
    """

    def __init__(
        self,
        device: Device,
        scene: Scene,
        cut: LaunchConfig | None = None,
        faults: Mapping[str, str] | None = None,
        uvs: Sequence[Uv] = (),
    ) -> None:
        self.names = tuple(scene.materials)
        places = [(name, uv) for uv in (None, *uvs) for name in self.names]
        side = math.isqrt(max(len(places) - 1, 0)) + 1
        # Separated, so that the BVH over them is an ordinary one
        shapes = tuple(_triangle(float(i % side), float(i // side), *place) for i, place in enumerate(places))
        camera = Camera(position=(0.0, 0.0, 4.0), target=(0.0, 0.0, 0.0))
        flat = flatten(scene.with_checked(camera=camera, shapes=shapes, lights=()), 8, 8)
        first = flat.arrays["shapes"]["first_primitive"]
        self._primitive = {place: np.uint32(first[i]) for i, place in enumerate(places)}
        self._uv: Uv | None = None
        self._mixtures = {name for name in self.names if isinstance(scene.materials[name], Mix)}
        self._parts: dict[tuple[str, Uv | None], list[tuple[float, float]]] = {}
        settings = np.zeros(1, layout.dtype("Settings"))
        self._device = device
        self._worker = DeviceWorker(device, flat, settings, _PIPELINE, cut)
        self.lanes = self._worker.lanes
        self._program = self._worker.program(_ENTRY, {"PACKETS": 1, **(faults or {})})

    def at(self, uv: Uv | None) -> Surfaces:
        """The same surfaces, measured at these texture coordinates; released with this object."""
        other = copy.copy(self)
        other._uv = uv
        return other

    def sample(self, name: str, wo: Floats, numbers: Floats) -> Samples:
        """Sample directions of incidence for the view direction `wo`.

        Parameters
        ----------
        name : str
            Name of the material.
        wo : (3,) float64
            Unit vector, towards the viewer; z below 0: on the back side.
        numbers : (2, n) float64
            Within [0, 1).
        """
        count = numbers.shape[1]
        bits = np.zeros((2, _padded(count)), np.uint32)
        bits[:, :count] = (numbers * 2.0**32).astype(np.uint64)
        four = np.append(wo, 0.0).astype(np.float32)
        # Evenly, and not correlated with the strata of the samples
        choices = np.mod((np.arange(bits.shape[1]) + 0.5) * _GOLDEN, 1.0)
        out = self._run("furnace_sample", choices, bits, 11, [self._primitive[name, self._uv], four])[:, :count]
        return Samples(out[:3].T, out[3:6].T, out[6], out[7:10].T, out[10])

    def evaluate(self, name: str, wo: Floats, wi: Floats) -> tuple[Floats, Floats]:
        """Evaluate f |cosθ| and the density of directions.

        Parameters
        ----------
        name : str
            Name of the material.
        wo : (3,) or (n, 3) float64
        wi : (n, 3) float64

        Returns
        -------
        values : (n, 3) float64, 1/sr
        pdf : (n,) float64, 1/sr
        """
        count = len(wi)
        directions = np.zeros((6, _padded(count)), np.float32)
        directions[2] = directions[5] = 1.0
        directions[:3, :count] = np.broadcast_to(wo, wi.shape).T
        directions[3:, :count] = wi.T
        out: Floats = np.zeros((4, count))
        for share, choice in self.parts(name):
            choices = np.full(directions.shape[1], choice)
            found = self._run("furnace_eval", choices, directions, 4, [self._primitive[name, self._uv]])
            out += share * found[:, :count]
        return out[:3].T, out[3]

    def parts(self, name: str) -> list[tuple[float, float]]:
        """Fractions of a mixture's materials, each with a choice that selects it; one entry for other materials."""
        if name not in self._mixtures:
            return [(1.0, 0.5)]
        place = name, self._uv
        if place not in self._parts:
            choices = ((np.arange(_CHOICES) + 0.5) / _CHOICES).astype(np.float32)
            rows = self._launch("furnace_choose", [choices], np.uint32, 1, [self._primitive[place]])[0]
            _, first, count = np.unique(rows, return_index=True, return_counts=True)
            self._parts[place] = [(float(n) / _CHOICES, float(choices[i])) for n, i in zip(count, first, strict=True)]
        return self._parts[place]

    def _run(
        self, kernel: str, choices: Floats, numbers: npt.NDArray[Any], outputs: int, arguments: list[Any]
    ) -> Floats:
        below_one = np.minimum(choices, 1.0 - 2.0**-24).astype(np.float32)
        return self._launch(kernel, [below_one, numbers], np.float32, outputs, arguments).astype(np.float64)

    def _launch(
        self, kernel: str, given: Sequence[npt.NDArray[Any]], kind: type, outputs: int, arguments: list[Any]
    ) -> npt.NDArray[Any]:
        """Results of a kernel, (outputs, n), of dtype `kind`, with as many lanes as a row of `given` has numbers."""
        device, count = self._device, given[0].shape[-1]
        buffers = [device.upload(each) for each in given]
        results = device.empty(4 * outputs * count)
        out: npt.NDArray[Any] = np.empty((outputs, count), kind)
        try:
            self._worker.launch_over(self._program, kernel, count, [*buffers, *arguments, np.uint32(count), results])
            device.read(results, out)
        finally:
            for buffer in (*buffers, results):
                device.release(buffer)
        return out

    def release(self) -> None:
        """Release the device's memory."""
        self._worker.release()


def _triangle(x: float, y: float, material: str, uv: Uv | None) -> Mesh:
    """Half of a square, with texture coordinates shifted so that the measured point has `uv`."""
    u, v = (0.0, 0.0) if uv is None else (uv[0] - _POINT[0], uv[1] - _POINT[1])
    return Mesh(
        type="mesh",
        vertices=((x, y, 0.0), (x + 0.5, y, 0.0), (x + 0.5, y + 0.5, 0.0)),
        faces=((0, 1, 2),),
        uvs=tuple((u + a, v + b) for a, b in _CORNERS),
        material=material,
    )


def _padded(count: int) -> int:
    return -(-count // _PADDING) * _PADDING
