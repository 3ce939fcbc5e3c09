"""Layers beside an image: what each pixel sees first, of the same camera rays as the image."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import numpy.typing as npt

from clrender import layout
from clrender.errors import UsageError
from clrender.film import Film
from clrender.film.unit import tile_side
from clrender.integrators.descriptor import Pipeline
from clrender.scene.wording import suggestion
from clrender.scheduling.policy import Plan
from clrender.scheduling.pool import WorkerPool
from clrender.scheduling.run import run

if TYPE_CHECKING:
    from clrender.device import Device
    from clrender.device.worker import DeviceWorker
    from clrender.flatten import FlatScene
    from clrender.settings import RenderSettings

__all__ = [
    "AOVS",
    "FIRST_HITS",
    "GUIDES",
    "GUIDE_SAMPLES",
    "LAYER_KINDS",
    "LAYER_SAMPLES",
    "LayerKind",
    "check_aovs",
    "exr_channels",
    "first_hits",
]

_Array = npt.NDArray[np.float32]

AOVS: Final[Mapping[str, str]] = {
    "albedo": "RGB",
    "normal": "XYZ",
    "depth": "Z",
    "position": "XYZ",
    "object": "V",
    "material": "V",
    "samples": "V",
}
"""Every layer, and the letters of its channels."""

LAYER_SAMPLES: Final = 64
"""A layer is a mean over the first samples of a pixel, no more than these: what is seen first has little noise."""

GUIDES: Final = ("albedo", "normal")
GUIDE_SAMPLES: Final = 16
"""What guides the denoiser, and how many samples of it are enough (`DECISIONS.md` 14)."""

FIRST_HITS: Final = Pipeline("integrator/first_hit.cl", "integrator_first_hit")
"""How layers are made; its kernel takes what is asked for as its last argument."""

LAYER_KINDS: Final[Mapping[str, int]] = {
    "albedo": layout.FIRST_HIT_ALBEDO,
    "normal": layout.FIRST_HIT_NORMAL,
    "depth": layout.FIRST_HIT_DEPTH,
    "position": layout.FIRST_HIT_POSITION,
    "primitive": layout.FIRST_HIT_PRIMITIVE,
}


def check_aovs(names: Iterable[str]) -> tuple[str, ...]:
    """The layers asked for, each once.

    Raises
    ------
    UsageError
        When one is unknown.
    """
    wanted = tuple(dict.fromkeys(names))
    for name in wanted:
        if name not in AOVS:
            raise UsageError(f"aov: there is no layer {name!r}{suggestion(name, AOVS)}")
    return wanted


def exr_channels(layers: Mapping[str, _Array]) -> dict[str, _Array]:
    """The layers as channels of an EXR file: ``albedo.R``, ``normal.X``, ``depth.Z``, ``object.V``, …

    Parameters
    ----------
    layers : mapping of str to (H, W, C) float32

    Returns
    -------
    dict of str to (H, W) float32
    """
    return {
        f"{name}.{letter}": np.ascontiguousarray(layer[..., channel])
        for name, layer in layers.items()
        for channel, letter in enumerate(AOVS[name])
    }


@dataclass
class LayerKind:
    """What the kernel is asked for: its last argument."""

    kind: int = 0

    def arguments(self, sample: int) -> Sequence[np.generic]:
        return [np.uint32(self.kind)]

    def take_rays(self) -> int:
        """None are traced beforehand."""
        return 0

    def release(self) -> None:
        """Nothing is held."""


def first_hits(
    devices: Sequence[Device],
    make: Callable[..., DeviceWorker],
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
    flat : FlatScene
    settings : RenderSettings
        Those of the image: the layers have its size, seed and camera samples.
    names : iterable of str
        Of `AOVS`; ``samples`` is passed over, for only the image knows them.
    most_samples : int
        Of the image's samples of a pixel, the first so many are looked at.
    should_stop : callable, optional
        Asked between launches; after a yes, samples are missing.
    notify : callable, optional
        Told, in a line, of devices that failed.

    Returns
    -------
    dict of str to (H, W, C) float32
        ``albedo`` : reflectance, and radiance of what shines, 0 to 1, of the first surface that is neither mirror nor
        glass, times the colour of the mirrors on the way. ``normal`` : shading normal on the side it is seen
        from, world space; zero where nothing is hit.
        ``position`` : world space, metres; NaN where nothing is hit. ``depth`` : from the camera's position, metres;
        infinite where nothing is hit. ``object``, ``material`` : places in the scene's lists of shapes and of
        materials, from 0, of what the pixel's first sample hits; -1 where that is nothing. The others are means over
        samples, of depth and position over those that hit something.

    Raises
    ------
    DeviceError, RenderError
        When the devices fail.
    """
    wanted = [name for name in names if name != "samples"]
    passes = list(dict.fromkeys("primitive" if name in ("object", "material") else name for name in wanted))
    if not passes:
        return {}
    side = tile_side(settings.tile, settings.width, settings.height)
    asked = LayerKind()
    films: dict[str, Film] = {}
    with WorkerPool(devices, partial(make, pipeline=FIRST_HITS, on_device=lambda _: asked)) as pool:
        for name in passes:
            asked.kind = LAYER_KINDS[name]
            samples = 1 if name == "primitive" else min(settings.spp, most_samples)
            films[name] = Film(settings.width, settings.height)
            plan = Plan(settings.width, settings.height, 0, samples, side)
            tally = run(plan, pool.candidates, films[name], None, should_stop)
            tally.raise_failure()
            for failure in tally.failures:
                (notify or (lambda line: None))(f"warning: {failure}; its work was done by the others")
    means = {name: (film.develop(), film.counts > 0) for name, film in films.items()}
    return {name: _layer(name, means, flat) for name in wanted}


def _layer(name: str, means: Mapping[str, tuple[_Array, npt.NDArray[np.bool_]]], flat: FlatScene) -> _Array:
    mean, hit = means["primitive" if name in ("object", "material") else name]
    if name == "position":
        mean[~hit] = np.nan
    elif name == "depth":
        mean = np.where(hit, mean[..., 0], np.float32(np.inf))[..., None]
    elif name in ("object", "material"):
        primitive = mean[..., 0].astype(np.int64) + (mean[..., 1].astype(np.int64) << 16)
        row, instance = flat.instances.rows_of(primitive)
        number: npt.NDArray[Any] = flat.arrays["primitive_shape"][row]
        if name == "material":
            number = flat.arrays["shapes"]["material"][number]
        else:
            number = flat.instances.shapes_of(number, instance)
        mean = np.where(hit, number.astype(np.float32), np.float32(-1.0))[..., None]
    return np.ascontiguousarray(mean, np.float32)
