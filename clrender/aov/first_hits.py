"""Renders the layers: one pass over the image, by a pipeline of its own, for each thing that is asked of first hits."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Final

import numpy as np
import numpy.typing as npt

from clrender import layout
from clrender.aov.cryptomatte import matte_names, name_id, ranked
from clrender.aov.names import MATTES, OF_FILM, RANKS
from clrender.aov.samples import PrimitiveSamples
from clrender.device.scene_arrays import scene_array_names
from clrender.film import Film
from clrender.film.unit import tile_side
from clrender.integrators.descriptor import Pipeline
from clrender.memory import largest_tile
from clrender.scene.assembly import assemble
from clrender.scene.surfaces import flat_surfaces
from clrender.scheduling.contributions import MOST_BYTES
from clrender.scheduling.policy import Plan
from clrender.scheduling.pool import WorkerPool, most_slots
from clrender.scheduling.run import Receiver, run
from clrender.scheduling.tally import failures_told

if TYPE_CHECKING:
    from clrender.device import Device
    from clrender.device.device import Argument, Buffer
    from clrender.device.worker import DeviceWorker
    from clrender.flatten import FlatScene
    from clrender.scene import Scene
    from clrender.settings import RenderSettings

__all__ = [
    "FIRST_HITS",
    "GUIDES",
    "GUIDE_SAMPLES",
    "LAYER_KINDS",
    "LAYER_SAMPLES",
    "LayerArguments",
    "LayerKind",
    "first_hits",
]

_Array = npt.NDArray[np.float32]

LAYER_SAMPLES: Final = 64
"""A layer is a mean over the first samples of a pixel, no more than these: what is seen first has little noise."""

GUIDES: Final = ("albedo", "normal")
GUIDE_SAMPLES: Final = 16
"""What guides the denoiser, and how many samples of it are enough (`DECISIONS.md` 14)."""

FIRST_HITS: Final = Pipeline("integrator/first_hit.cl", "integrator_first_hit", squares=False)
"""How layers are made; its kernel takes what is asked for, and attributes of all primitives, as its last arguments."""

LAYER_KINDS: Final[Mapping[str, int]] = {
    "albedo": layout.FIRST_HIT_ALBEDO,
    "normal": layout.FIRST_HIT_NORMAL,
    "depth": layout.FIRST_HIT_DEPTH,
    "position": layout.FIRST_HIT_POSITION,
    "primitive": layout.FIRST_HIT_PRIMITIVE,
    "emission": layout.FIRST_HIT_EMISSION,
    "uv": layout.FIRST_HIT_UV,
    "tangent": layout.FIRST_HIT_TANGENT,
}

_COORDINATES: Final = ("uv", "tangent")
_NUMBERS: Final = ("object", "material")
_CHANNELS: Final[Mapping[str, int]] = {"depth": 1, "uv": 2}
"""Where a layer has not three."""

_SAMPLES_BYTES: Final = 128 << 20
"""Memory of the samples that are told apart for mattes at a time."""


@dataclass
class LayerKind:
    """What the kernel is asked for, from launch to launch."""

    kind: int = 0


class LayerArguments:
    """The last arguments of the kernel on one device.

    Parameters
    ----------
    worker : DeviceWorker
    asked : LayerKind
        Read at each launch.
    coordinates : (P, 16) float32, optional
        Attributes of all primitives, where `asked` may ask for what they hold.
    """

    def __init__(self, worker: DeviceWorker, asked: LayerKind, coordinates: _Array | None = None) -> None:
        self._device, self._asked = worker.device, asked
        self._own: Buffer | None = None if coordinates is None else worker.device.upload(coordinates)
        self._given = worker.scene_arguments[scene_array_names().index("attribute_rows")]

    def arguments(self, sample: int) -> Sequence[Argument]:
        return [np.uint32(self._asked.kind), self._own or self._given]

    def take_rays(self) -> int:
        """None are traced beforehand."""
        return 0

    def release(self) -> None:
        """Give the device's memory back."""
        if self._own is not None:
            self._device.release(self._own)


@dataclass
class _Passes:
    """The passes of one render over the image, a layer or a sample each."""

    pool: WorkerPool
    asked: LayerKind
    settings: RenderSettings
    should_stop: Callable[[], bool] | None
    notify: Callable[[str], None]
    apart: int
    most_slots: int

    def __post_init__(self) -> None:
        settings = self.settings
        self.tile = tile_side(largest_tile(settings.max_memory, settings.tile), settings.width, settings.height)

    def run(self, what: str, samples: int, receiver: Receiver, rows: tuple[int, int] | None = None) -> None:
        """One kind of what is seen first, of the whole image or of some rows of tiles sample by sample."""
        self.asked.kind = LAYER_KINDS[what]
        width, height = self.settings.width, self.settings.height
        plan = Plan(width, height, 0, samples, self.tile, rows is not None, rows, most_slots=self.most_slots)
        tally = run(plan, self.pool.candidates, receiver, None, self.should_stop, self.notify, apart_bytes=self.apart)
        tally.raise_failure()
        for line in failures_told(tally):
            self.notify(line)

    def mean(self, what: str, samples: int) -> tuple[_Array, npt.NDArray[np.bool_]]:
        """The mean of each pixel, and where there is one. The film's sums are given back at once."""
        film = Film(self.settings.width, self.settings.height)
        self.run(what, samples, film)
        return film.develop(), film.counts > 0


def first_hits(
    devices: Sequence[Device],
    make: Callable[..., DeviceWorker],
    scene: Scene,
    flat: FlatScene,
    settings: RenderSettings,
    names: Iterable[str],
    most_samples: int = LAYER_SAMPLES,
    should_stop: Callable[[], bool] | None = None,
    notify: Callable[[str], None] | None = None,
) -> dict[str, _Array]:
    """Layers of what is seen first, the same bits however the work is cut.

    Parameters
    ----------
    devices : sequence of Device
    make : callable
        Makes a worker of the scene and settings, given a device, ``pipeline`` and ``on_device``.
    scene : Scene
    flat : FlatScene
        Of the scene.
    settings : RenderSettings
        Those of the image: the layers have its size, seed and camera samples.
    names : iterable of str
        Of `clrender.aov.AOVS`; those of `clrender.aov.OF_FILM` are passed over, for only the image knows them.
    most_samples : int
        Of the image's samples of a pixel, the first so many are looked at.
    should_stop : callable, optional
        Asked between launches; after a yes, samples are missing.
    notify : callable, optional
        Told, in a line, of devices that failed.

    Returns
    -------
    dict of str to (H, W, C) float32
        Each channel in one piece of memory.
        ``albedo`` : reflectance, and radiance of what shines, 0 to 1, of the first surface that is neither mirror nor
        glass, times the colour of the mirrors on the way. ``emission`` : radiance, W/(sr m2), that the first surface
        sends to the camera by itself. ``normal`` : shading normal on the side it is seen
        from, world space; zero where nothing is hit. ``tangent`` : unit vector at right angles to it in which the first
        texture coordinate grows, world space; zero where nothing is hit or there are no coordinates.
        ``position`` : world space, metres; NaN where nothing is hit. ``uv`` : texture coordinates of the first set; NaN
        where nothing is hit, 0 on meshes that have none. ``depth`` : from the camera's position, metres;
        infinite where nothing is hit. ``object``, ``material`` : places in the scene's lists of shapes and of
        materials, from 0, of what the pixel's first sample hits; -1 where that is nothing, or a shape without a
        material. ``crypto_object``, ``crypto_material`` : `clrender.aov.cryptomatte.ranked` of the names of shapes and
        materials. The others are means over samples, of depth, position and uv over those that hit something.

    Raises
    ------
    DeviceError, RenderError
        When the devices fail.
    SceneError
        A mesh file cannot be read.
    """
    wanted = [name for name in dict.fromkeys(names) if name not in OF_FILM]
    if not wanted:
        return {}
    asked = LayerKind()
    needed = any(name in _COORDINATES for name in wanted)
    coordinates = None
    if needed:
        assembly = assemble(scene)
        coordinates = flat_surfaces(assembly.scene, flat.origin, assembly.own_shapes, all_attributes=True).attributes
    if coordinates is not None and not len(coordinates):
        coordinates = None
    on_device = partial(LayerArguments, asked=asked, coordinates=coordinates)
    found: dict[str, _Array] = {}
    samples = min(settings.spp, most_samples)
    with WorkerPool(devices, partial(make, pipeline=FIRST_HITS, on_device=on_device)) as pool:
        apart = MOST_BYTES if settings.max_memory is None else 0
        most = most_slots(devices, settings.max_memory)
        passes = _Passes(pool, asked, settings, should_stop, notify or (lambda line: None), apart, most)
        for name in wanted:
            if name not in (*_NUMBERS, *MATTES):
                found[name] = _layer(name, *passes.mean(name, samples))
        if any(name in _NUMBERS for name in wanted):
            seen = _seen(*passes.mean("primitive", 1), flat)
            found |= {name: _numbers(name, seen, scene) for name in _NUMBERS if name in wanted}
        mattes = [name for name in wanted if name in MATTES]
        if mattes:
            found |= _mattes(mattes, passes, samples, scene, flat)
    return {name: found[name] for name in wanted}


def _layer(name: str, mean: _Array, hit: npt.NDArray[np.bool_]) -> _Array:
    """A mean as a layer."""
    if name in ("position", "uv"):
        mean[~hit] = np.nan
    elif name == "depth":
        mean[~hit] = np.inf
    return _planar(mean[..., : _CHANNELS.get(name, 3)])


def _planar(layer: _Array) -> _Array:
    """The same (H, W, C), channel after channel in memory, as files want them."""
    return np.moveaxis(np.ascontiguousarray(np.moveaxis(layer, 2, 0), np.float32), 0, 2)


def _seen(mean: _Array, hit: npt.NDArray[np.bool_], flat: FlatScene) -> npt.NDArray[np.int64]:
    """What first samples hit, as of `FlatInstances.seen`, from 1; 0: nothing."""
    primitive = mean[..., 0].astype(np.int64) + (mean[..., 1].astype(np.int64) << 16)
    number = np.zeros(hit.shape, np.int64)
    number[hit] = flat.instances.seen(primitive[hit], flat.arrays["primitive_shape"]) + 1
    return number


def _numbers(name: str, seen: npt.NDArray[np.int64], scene: Scene) -> _Array:
    assembly = assemble(scene)
    if name == "object":
        of_seen = assembly.seen_place.tolist()
    else:
        places = {material: place for place, material in enumerate(scene.materials)}
        materials = (assembly.scene.shapes[at].material for at in assembly.seen_shape.tolist())
        of_seen = [-1 if material is None else places[material] for material in materials]
    return _planar(np.array([-1, *of_seen], np.float32)[seen][..., None])


def _mattes(names: Sequence[str], passes: _Passes, samples: int, scene: Scene, flat: FlatScene) -> dict[str, _Array]:
    """Mattes of some rows of tiles after the other: all samples of a pixel are told apart until they are counted."""
    width, height, tile = passes.settings.width, passes.settings.height, passes.tile
    ids = {name: _ids(each) for name, each in matte_names(scene).items()}
    planes = {name: np.zeros((2 * RANKS, height, width), np.float32) for name in names}
    all_rows = -(-height // tile)
    most = min(_SAMPLES_BYTES, (passes.settings.max_memory or 2**62) // 16)
    step = max(1, most // (4 * samples * tile * width))
    for first in range(0, all_rows, step):
        rows = (first, min(first + step, all_rows))
        seen = PrimitiveSamples(width, height, rows, samples, tile)
        passes.run("primitive", samples, seen, rows)
        numbers, taken = seen.told_apart(flat), seen.taken.reshape(-1)
        for name, plane in planes.items():
            plane[:, seen.top : seen.bottom] = ranked(numbers, taken, ids[name]).reshape(2 * RANKS, -1, width)
    return {name: np.moveaxis(plane, 0, 2) for name, plane in planes.items()}


def _ids(names: Sequence[str | None]) -> npt.NDArray[np.uint32]:
    """As `ranked` takes them: of nothing first, then of each shape."""
    return np.array([0, *(0 if name is None else name_id(name) for name in names)], np.uint32)
