"""Renders the layers: one pass over the image, with its own pipeline, for each quantity of first hits."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, Final

import numpy as np
import numpy.typing as npt

from clrender import layout
from clrender.aov.cryptomatte import matte_names, name_id, ranked
from clrender.aov.label_numbers import LabelNumbers, majority
from clrender.aov.labels import Labelling
from clrender.aov.names import FLOWS, LABELS, MATTES, OF_FILM, OF_RENDERS, RANKS
from clrender.aov.samples import PrimitiveSamples
from clrender.device.scene_arrays import scene_array_names
from clrender.device.team import DeviceTeam, most_slots
from clrender.exact.matrices import inner
from clrender.film import Film
from clrender.film.unit import tile_side
from clrender.flatten.assembly import assemble
from clrender.flatten.flat_scene import moving_from
from clrender.flatten.surfaces import flat_surfaces
from clrender.integrators.descriptor import Pipeline
from clrender.process.memory import largest_tile
from clrender.scheduling.contributions import MOST_BYTES
from clrender.scheduling.policy import Plan
from clrender.scheduling.run import Receiver, run
from clrender.scheduling.tally import failures_told

if TYPE_CHECKING:
    from clrender.device import Device
    from clrender.device.device import Argument, Buffer
    from clrender.device.worker import DeviceWorker
    from clrender.flatten.flat_scene import FlatScene
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
    "alpha_samples",
    "first_hits",
    "hit_counts",
]

_Array = npt.NDArray[np.float32]

LAYER_SAMPLES: Final = 64
"""Most samples of a pixel for the mean of a layer: first hits have little noise."""

_ALPHA_SAMPLES: Final = 256
"""Most samples of alpha where it is not known how many the image will have."""

GUIDES: Final = ("albedo", "normal")
GUIDE_SAMPLES: Final = 16
"""Number of samples that suffices for the denoiser's guides (`DECISIONS.md` 14)."""

FIRST_HITS: Final = Pipeline("integrator/first_hit.cl", "integrator_first_hit", squares=False)
"""Pipeline of layers; its kernel's last arguments are the requested quantity and attributes of all primitives."""

_HITS_APART: Final = replace(FIRST_HITS, apart=True)

LAYER_KINDS: Final[Mapping[str, int]] = {
    "albedo": layout.FIRST_HIT_ALBEDO,
    "normal": layout.FIRST_HIT_NORMAL,
    "normal_camera": layout.FIRST_HIT_NORMAL_CAMERA,
    "depth": layout.FIRST_HIT_DEPTH,
    "z_depth": layout.FIRST_HIT_Z_DEPTH,
    "position": layout.FIRST_HIT_POSITION,
    "primitive": layout.FIRST_HIT_PRIMITIVE,
    "emission": layout.FIRST_HIT_EMISSION,
    "uv": layout.FIRST_HIT_UV,
    "tangent": layout.FIRST_HIT_TANGENT,
    "alpha": layout.FIRST_HIT_ALPHA,
    "flow": layout.FIRST_HIT_FLOW,
    "scene_flow": layout.FIRST_HIT_SCENE_FLOW,
}

_COORDINATES: Final = ("uv", "tangent")
_NUMBERS: Final = ("object", "material")
_TURNED: Final = "normal_camera"
_CHANNELS: Final[Mapping[str, int]] = {"depth": 1, "z_depth": 1, "uv": 2, "flow": 2, "alpha": 1}
"""Number of channels of layers that do not have three."""

_SAMPLES_BYTES: Final = 128 << 20
"""Memory for the individual samples of mattes at a time."""


@dataclass
class LayerKind:
    """The quantity that the kernel computes, which changes between launches."""

    kind: int = 0


class LayerArguments:
    """The last arguments of the kernel on one device.

    Parameters
    ----------
    worker : DeviceWorker
    asked : LayerKind
        Read at each launch.
    coordinates : (P, 16) float32, optional
        Attributes of all primitives, if `asked` may need them.
    """

    def __init__(self, worker: DeviceWorker, asked: LayerKind, coordinates: _Array | None = None) -> None:
        self._device, self._asked = worker.device, asked
        self._own: Buffer | None = None if coordinates is None else worker.device.upload(coordinates)
        self._given = worker.scene_arguments[scene_array_names().index("attribute_rows")]

    def arguments(self, sample: int) -> Sequence[Argument]:
        return [np.uint32(self._asked.kind), self._own or self._given]

    def take_rays(self) -> int:
        """No rays are traced beforehand."""
        return 0

    def release(self) -> None:
        """Release the device's memory."""
        if self._own is not None:
            self._device.release(self._own)


@dataclass
class _Passes:
    """The passes of one render, each over a layer or a sample."""

    team: DeviceTeam
    asked: LayerKind
    settings: RenderSettings
    should_stop: Callable[[], bool] | None
    notify: Callable[[str], None]
    apart: int
    most_slots: int

    def __post_init__(self) -> None:
        settings = self.settings
        self.tile = tile_side(largest_tile(settings.max_memory, settings.tile), *settings.film_size)

    def run(self, what: str, samples: int, receiver: Receiver, rows: tuple[int, int] | None = None) -> None:
        """Render one quantity of first hits, for the whole image, or for some rows of tiles."""
        self.asked.kind = LAYER_KINDS[what]
        width, height = self.settings.film_size
        plan = Plan(width, height, 0, samples, self.tile, rows=rows, most_slots=self.most_slots)
        tally = run(plan, self.team.candidates, receiver, None, self.should_stop, self.notify, apart_bytes=self.apart)
        tally.raise_failure()
        for line in failures_told(tally):
            self.notify(line)

    def mean(self, what: str, samples: int) -> tuple[_Array, npt.NDArray[np.bool_]]:
        """The mean of each pixel, and which pixels have one. The film's sums are freed immediately."""
        film = Film(*self.settings.film_size)
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
    areas: dict[str, dict[int, float]] | None = None,
) -> dict[str, _Array]:
    """Layers of first hits, with the same bits however the work is divided.

    Parameters
    ----------
    devices : sequence of Device
    make : callable
        Makes a worker for the scene and settings, from a device, ``pipeline`` and ``on_device``.
    scene : Scene
    flat : FlatScene
        Arrays of the scene.
    settings : RenderSettings
        Settings of the image: the layers have its size, seed and camera samples.
    names : iterable of str
        From `clrender.aov.AOVS`; those of `clrender.aov.names.OF_FILM` and `OF_RENDERS` come from elsewhere, and are
        skipped.
    most_samples : int
        Largest number of samples of a pixel, which are the image's first ones.
    should_stop : callable, optional
        Called between launches; if it returns True, samples are missing.
    notify : callable, optional
        Called with a line about each device that failed.
    areas : dict, optional
        Receives, for each layer of labels, the pixels that each of its numbers covers.

    Returns
    -------
    dict of str to (H, W, C) float32
        Each channel is contiguous in memory.
        ``alpha`` : share of light from behind the scene that does not reach the pixel, 0 to 1, weighted as the image's
        samples are: composited over a background C, the image, which lacks the environment, is L + (1 - alpha) C.
        ``albedo`` : reflectance, and radiance of emitters, 0 to 1, of the first surface that is neither mirror nor
        glass, times the colour of the mirrors on the way. ``emission`` : radiance, W/(sr m2), that the first surface
        emits towards the camera. ``normal`` : shading normal on the visible side, world space; zero where nothing is
        hit. ``tangent`` : unit vector perpendicular to it along which the first texture coordinate grows, world space;
        zero where nothing is hit or there are no coordinates. ``position`` : world space, metres; NaN where nothing is
        hit. ``flow`` : where what is seen at the time of the image, or when the shutter opens, will be after
        `Camera.flow_step`, or when the shutter closes, less where it is then: pixels to the right and down; NaN where
        nothing is hit or the camera sees it at one end only. ``scene_flow`` : the same in world space, metres; NaN
        where nothing is hit. ``uv`` : texture coordinates of the first set; NaN where nothing is hit, 0 on meshes
        without any. ``normal_camera`` : the normal along the image's right, its up, and backward. ``depth`` : distance
        from the camera's position, metres; ``z_depth`` : the same along the view; infinite where nothing is hit.
        ``object``, ``material`` : indices in the scene's lists of shapes and of materials, from 0, of the first
        sample's hit; -1 if it hits nothing, or a shape without a material. ``instance``, ``category``, ``part`` : the
        number that most samples of the pixel have (`clrender.aov.labels.Labelling`), 0 for nothing, and the share of
        its samples that have it. ``crypto_object``, ``crypto_material`` :
        `clrender.aov.cryptomatte.ranked` of the names of shapes and materials. The others are means over samples;
        those of depth, z_depth, position and uv are over samples that hit something.

    Raises
    ------
    DeviceError, RenderError
        If the devices fail.
    SceneError
        A mesh file cannot be read.
    """
    wanted = [name for name in dict.fromkeys(names) if name not in OF_FILM | OF_RENDERS]
    if not wanted:
        return {}
    asked = LayerKind()
    needed = any(name in _COORDINATES for name in wanted)
    coordinates = None
    if needed:
        assembly = assemble(scene)
        origin, own = flat.origin, assembly.own_shapes
        coordinates = flat_surfaces(assembly.scene, origin, own, assembly, all_attributes=True).attributes
    if coordinates is not None and not len(coordinates):
        coordinates = None
    on_device = partial(LayerArguments, asked=asked, coordinates=coordinates)
    found: dict[str, _Array] = {}
    samples = min(settings.spp, most_samples)
    with DeviceTeam(devices, partial(make, pipeline=FIRST_HITS, on_device=on_device)) as team:
        apart = MOST_BYTES if settings.max_memory is None else 0
        most = most_slots(devices, settings.max_memory)
        passes = _Passes(team, asked, settings, should_stop, notify or (lambda line: None), apart, most)
        for name in wanted:
            if name not in (*_NUMBERS, *MATTES, *FLOWS, *LABELS, _TURNED):
                found[name] = _layer(name, *passes.mean(name, alpha_samples(settings) if name == "alpha" else samples))
        if _TURNED in wanted:
            kind = _TURNED if flat.camera["segments"].any() else "normal"
            normal = found[kind] if kind in found else _layer(kind, *passes.mean(kind, samples))
            found[_TURNED] = _planar(_in_camera(normal, scene))
        if any(name in _NUMBERS for name in wanted):
            seen = _seen(*passes.mean("primitive", 1), flat)
            found |= {name: _numbers(name, seen, scene) for name in _NUMBERS if name in wanted}
    if counted := [name for name in wanted if name in MATTES or name in LABELS]:
        on_device = partial(LayerArguments, asked=asked)
        with DeviceTeam(devices, partial(make, pipeline=_HITS_APART, on_device=on_device)) as team:
            areas = {} if areas is None else areas
            found |= _counted(counted, replace(passes, team=team), samples, scene, flat, areas)
    flows = [name for name in wanted if name in FLOWS]
    if flows:
        moving = partial(make, pipeline=FIRST_HITS, on_device=partial(LayerArguments, asked=asked))
        with DeviceTeam(
            devices, partial(moving, flat=moving_from(flat, scene, (settings.width, settings.height)))
        ) as team:
            passes = replace(passes, team=team)
            found |= {name: _layer(name, *passes.mean(name, samples)) for name in flows}
    return {name: found[name] for name in wanted}


def hit_counts(
    devices: Sequence[Device],
    make: Callable[..., DeviceWorker],
    settings: RenderSettings,
    samples: int,
    should_stop: Callable[[], bool] | None = None,
    notify: Callable[[str], None] | None = None,
) -> npt.NDArray[np.uint32]:
    """Number of the samples of each pixel that hit anything.

    Parameters
    ----------
    devices, make, settings, should_stop, notify
        See `first_hits`.
    samples : int
        Samples of each pixel, which are the image's first ones.

    Returns
    -------
    (H, W) uint32
    """
    asked = LayerKind()
    on_device = partial(LayerArguments, asked=asked)
    with DeviceTeam(devices, partial(make, pipeline=FIRST_HITS, on_device=on_device)) as team:
        apart = MOST_BYTES if settings.max_memory is None else 0
        most = most_slots(devices, settings.max_memory)
        passes = _Passes(team, asked, settings, should_stop, notify or (lambda line: None), apart, most)
        film = Film(*settings.film_size)
        passes.run("primitive", samples, film)
        return np.array(film.counts, np.uint32)


def alpha_samples(settings: RenderSettings) -> int:
    """Samples of the layer alpha: those of the image, so that both have the same edges, or some if it may end early."""
    ends_early = settings.time_limit is not None or settings.error is not None
    return min(settings.spp, _ALPHA_SAMPLES) if ends_early else settings.spp


def _layer(name: str, mean: _Array, hit: npt.NDArray[np.bool_]) -> _Array:
    """Convert a mean to a layer."""
    if name in ("position", "uv", *FLOWS):
        mean[~hit] = np.nan
    elif name in ("depth", "z_depth"):
        mean[~hit] = np.inf
    elif name == "alpha":
        share, weight = mean[..., 0].astype(np.float64), mean[..., 1].astype(np.float64)
        through = np.divide(share, weight, out=np.zeros_like(share), where=weight != 0.0)
        mean = np.clip(1.0 - through, 0.0, 1.0).astype(np.float32)[..., None]
    return _planar(mean[..., : _CHANNELS.get(name, 3)])


def _in_camera(normal: _Array, scene: Scene) -> _Array:
    """Normals along the image's right, its up and backward, as cameras of OpenGL and Blender have their axes."""
    right, upward, forward = (np.array(axis) for axis in scene.camera.opened.axes)
    turned = [inner(normal, axis) for axis in (right, upward, -forward)]
    return np.stack(turned, axis=2).astype(np.float32)


def _planar(layer: _Array) -> _Array:
    """The (H, W, C) layer with contiguous channels, as files need them."""
    return np.moveaxis(np.ascontiguousarray(np.moveaxis(layer, 2, 0), np.float32), 0, 2)


def _seen(mean: _Array, hit: npt.NDArray[np.bool_], flat: FlatScene) -> npt.NDArray[np.int64]:
    """Objects that first samples hit, as numbered by `FlatInstances.seen`, from 1; 0: nothing."""
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


def _counted(
    names: Sequence[str],
    passes: _Passes,
    samples: int,
    scene: Scene,
    flat: FlatScene,
    areas: dict[str, dict[int, float]],
) -> dict[str, _Array]:
    """Mattes and labels, for some rows of tiles at a time: samples are kept individually until they are counted."""
    (width, height), tile = passes.settings.film_size, passes.tile
    mattes, labels = ([name for name in names if name in kind] for kind in (MATTES, LABELS))
    ids = {name: _ids(each) for name, each in matte_names(scene).items()} if mattes else {}
    numbering = LabelNumbers(Labelling.of(scene), flat) if labels else None
    counts: dict[str, Counter[int]] = {name: Counter() for name in labels}
    planes = {name: np.zeros((2 if name in labels else 2 * RANKS, height, width), np.float32) for name in names}
    all_rows = -(-height // tile)
    most = min(_SAMPLES_BYTES, (passes.settings.max_memory or 2**62) // 16)
    step = max(1, most // (8 * samples * tile * width))
    for first in range(0, all_rows, step):
        rows = (first, min(first + step, all_rows))
        seen = PrimitiveSamples(width, height, rows, samples, tile)
        passes.run("primitive", samples, seen, rows)
        taken, band = seen.taken.reshape(-1), slice(seen.top, seen.bottom)
        numbers = seen.told_apart(flat) if mattes else seen.numbers
        for name in mattes:
            planes[name][:, band] = ranked(numbers, taken, ids[name]).reshape(2 * RANKS, -1, width)
        for name in labels:
            assert numbering is not None
            numbers = seen.labelled(name, numbering, flat)
            planes[name][:, band] = majority(numbers, taken).reshape(2, -1, width)
            values, found = np.unique(numbers, return_counts=True)
            counts[name].update(dict(zip(values.tolist(), found.tolist(), strict=True)))
    areas |= {name: {n: count / samples for n, count in sorted(each.items()) if n} for name, each in counts.items()}
    return {name: np.moveaxis(plane, 0, 2) for name, plane in planes.items()}


def _ids(names: Sequence[str | None]) -> npt.NDArray[np.uint32]:
    """Ids for `ranked`: first that of no hit, then those of the shapes."""
    return np.array([0, *(0 if name is None else name_id(name) for name in names)], np.uint32)
