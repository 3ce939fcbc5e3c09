"""Where the light of an image comes from: what each bounce adds, how long paths are, and what is noisy."""

from __future__ import annotations

import dataclasses
import io
import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import numpy.typing as npt

from clrender.errors import RenderError, UsageError
from clrender.files.access import atomic_write
from clrender.files.kernel_hash import kernels_sha256
from clrender.image.exr_write import write_exr
from clrender.image.tone_map import LUMINANCE
from clrender.inspection.document import plain
from clrender.limits import shown
from clrender.rendering.job import RenderJob
from clrender.rendering.session import Session
from clrender.rendering.telling import once
from clrender.settings import REPLICATE_SPP
from clrender.version import __version__
from clrender.wording import counted

if TYPE_CHECKING:
    from clrender.device import Device
    from clrender.guiding.field import GuidingField
    from clrender.rendering.rendered_image import Progress, RenderedImage
    from clrender.scene import Scene

__all__ = ["ENDINGS", "MOST_BOUNCES", "STRATEGIES", "PathMaps", "check_maps_ending", "maps_in", "path_maps"]

FORMAT: Final = "clrender path maps 1"
ENDINGS: Final = (".html", ".json", ".exr")
STRATEGIES: Final = ("mis", "light", "bsdf")
"""Values of the setting ``sampling`` whose errors are compared."""
MOST_BOUNCES: Final = 32

_Floats = npt.NDArray[np.float32]


@dataclass(frozen=True)
class PathMaps:
    """Maps of an image.

    Attributes
    ----------
    about : mapping
        What they are of, as JSON values: ``scene``, ``scene_sha256``, ``kernel_sha256``, ``version``, ``width``,
        ``height``, ``seed``, ``spp``, ``image_sha256``.
    image : (height, width, 3) float32
        Radiance, W/(sr m2): that of a render with these settings and the layer ``stderr``, bit for bit.
    bounces : (n + 2, height, width, 3) float32
        Parts of it, which add up to it but for rounding: light that is seen directly or through nothing but what does
        not scatter, then after 1, 2, ... n scattering events, and after more. Noise may make them negative.
    errors : mapping of str to (height, width) float32
        Standard error of the luminance with each of `STRATEGIES` alone, at the same number of samples.
    stops : float
        Exposure of pictures on a page, stops: that of the scene's camera.
    """

    about: Mapping[str, Any]
    image: _Floats
    bounces: _Floats
    errors: Mapping[str, _Floats]
    stops: float = 0.0

    @property
    def length(self) -> _Floats:
        """Mean number of scattering events on the way of the light of each pixel, (height, width) float32.

        Weighted by luminance. Light after more events than there are parts counts with the least number of these; NaN
        where a pixel is black.
        """
        bright = np.maximum(self.bounces @ np.array(LUMINANCE), 0.0)
        total = bright.sum(axis=0)
        weighted = np.tensordot(np.arange(len(bright), dtype=np.float64), bright, 1)
        length = np.divide(weighted, total, out=np.full(total.shape, np.nan), where=total > 0.0)
        return np.asarray(length, np.float32)

    @property
    def shares(self) -> npt.NDArray[np.float64]:
        """Share of each part in the luminance of the whole image, (n + 2,) float64; zeros for a black image."""
        bright = (self.bounces.astype(np.float64) @ np.array(LUMINANCE)).sum(axis=(1, 2))
        return bright / bright.sum() if bright.sum() > 0.0 else np.zeros(len(bright))

    @property
    def noise(self) -> dict[str, float]:
        """Root mean square of `errors` over the image, relative to its mean luminance; by strategy."""
        mean = float((self.image.astype(np.float64) @ np.array(LUMINANCE)).mean())
        return {
            name: float(np.sqrt(np.mean(error.astype(np.float64) ** 2))) / mean if mean > 0.0 else 0.0
            for name, error in self.errors.items()
        }

    def to_json(self) -> str:
        """All numbers, in the format ``clrender path maps 1``."""
        return (
            json.dumps(
                {
                    "format": FORMAT,
                    **plain(dict(self.about)),
                    "shares": plain(self.shares),
                    "noise": self.noise,
                    "length": plain(self.length),
                    "bounces": plain(self.bounces),
                    "errors": {name: plain(error) for name, error in self.errors.items()},
                },
                allow_nan=False,
                separators=(",", ":"),
            )
            + "\n"
        )

    def to_html(self) -> str:
        """A page of the maps, in one file."""
        from clrender.inspection.maps_page import Shown, maps_page

        parts = self.about, self.image, self.bounces, self.length, self.errors, self.shares, self.noise, self.stops
        return maps_page(Shown(*parts))

    def save(self, path: str | Path) -> None:
        """Write the maps to a file.

        Parameters
        ----------
        path : str or pathlib.Path
            Of an ``.html``, ``.json`` or ``.exr`` file. The latter has layers ``bounce.0.R`` and so on, ``length`` and
            ``error.mis``, ``error.light``, ``error.bsdf``.

        Raises
        ------
        UsageError
            When the file has another ending, or cannot be written.
        """
        check_maps_ending(path)
        match Path(path).suffix.lower():
            case ".exr":
                data = self._exr()
            case ".html":
                data = self.to_html().encode()
            case _:
                data = self.to_json().encode()
        with atomic_write(path) as file:
            file.write(data)

    def _exr(self) -> bytes:
        layers = {"length": self.length, **{f"error.{name}": error for name, error in self.errors.items()}}
        for number, bounce in enumerate(self.bounces):
            for channel, name in enumerate("RGB"):
                layers[f"bounce.{number}.{name}"] = bounce[..., channel]
        file = io.BytesIO()
        attributes = {key: str(value) for key, value in self.about.items()}
        write_exr(file, self.image, attributes, {name: np.ascontiguousarray(each) for name, each in layers.items()})
        return file.getvalue()


def check_maps_ending(path: str | Path) -> None:
    """Check that a file of maps can have this name.

    Raises
    ------
    UsageError
    """
    if Path(path).suffix.lower() not in ENDINGS:
        raise UsageError(f"{path}: maps are written to a .html, .json or .exr file; name one, such as maps.html")


def path_maps(
    scene: Scene,
    *,
    bounces: int = 6,
    device: str | int | Device | Sequence[str | int | Device] | None = None,
    on_progress: Callable[[Progress], None] | None = None,
    should_stop: Callable[[], bool] | None = None,
    notify: Callable[[str], None] | None = None,
    **settings: Any,
) -> PathMaps:
    """Render an image with maps of where its light comes from; see `PathMaps`.

    The image is rendered again for each part and each strategy, with the same samples.

    Parameters
    ----------
    scene : Scene
    bounces : int
        Largest number of scattering events that has a part of its own, from 0 to 32.
    device : str, int, Device, sequence of them, optional
    on_progress, should_stop : callable, optional
        See `clrender.render`.
    notify : callable, optional
        See `Session`.
    **settings
        See `clrender.render`: ``size``, ``plugins`` and the fields of `RenderSettings`. The integrator is ``path``.

    Returns
    -------
    PathMaps

    Raises
    ------
    SceneError, UsageError, DeviceError, RenderError
        See `Session.render`. `UsageError` also for settings that have no effect on maps.

    Examples
    --------
    >>> maps = clrender.path_maps(clrender.load("room"), size=(200, 150), spp=64)  # doctest: +SKIP
    >>> maps.shares  # of light after 0, 1, 2, ... events  # doctest: +SKIP
    """
    job = RenderJob.of(scene, **settings)
    with Session(device, notify=once(notify)) as session:
        return maps_in(session, job, bounces, on_progress, should_stop)


def maps_in(
    session: Session,
    job: RenderJob,
    bounces: int = 6,
    on_progress: Callable[[Progress], None] | None = None,
    should_stop: Callable[[], bool] | None = None,
) -> PathMaps:
    """Render maps in a session; see `path_maps`.

    Parameters
    ----------
    session : Session
    job : RenderJob
    bounces, on_progress, should_stop
        See `path_maps`.
    """
    most = _checked(job, bounces)
    # Errors need replicates, which have samples of their own
    replicate = job.settings.replicate_spp or REPLICATE_SPP
    settings = dataclasses.replace(job.settings, replicate_spp=replicate)
    if job.sample_count < 2 * replicate:
        raise UsageError(
            f"spp is {job.sample_count}, but errors need at least two replicates of {counted(replicate, 'sample')}; "
            "give "
            f"{2 * replicate} or more"
        )

    def rendered(
        aov: tuple[str, ...] = (), field: GuidingField | None = job.guiding_field, **changes: Any
    ) -> RenderedImage:
        one = dataclasses.replace(job, settings=dataclasses.replace(settings, **changes), aov=aov, guiding_field=field)
        image = session.render(one, keep_film=False, on_progress=on_progress, should_stop=should_stop)
        if image.stats["spp"] < job.sample_count or (should_stop is not None and should_stop()):
            raise RenderError("the maps are not complete: they were stopped early")
        return image

    whole = rendered(("stderr",))
    # One field guides all of them, for the same samples
    guided: dict[str, Any] = {"field": (field := whole.guiding_field), "guiding": "off" if field is None else "on"}
    by_strategy = {
        name: whole if name == settings.sampling else rendered(("stderr",), sampling=name, **guided)
        for name in STRATEGIES
    }
    limit = settings.max_depth
    depths = [depth for depth in range(most + 1) if limit is None or depth < limit]
    sums = [rendered(max_depth=depth, **guided).linear for depth in depths]
    sums += [whole.linear] * (most + 2 - len(sums))
    parts = np.diff(np.stack(sums).astype(np.float64), axis=0, prepend=0.0)
    weights = np.array(LUMINANCE)
    # Channels of a sample rise and fall together, so that their errors add up
    errors = {name: (image.aovs["stderr"] @ weights).astype(np.float32) for name, image in by_strategy.items()}
    about = {
        "scene": job.scene.source,
        "scene_sha256": job.scene.sha256(),
        "kernel_sha256": kernels_sha256(),
        "version": __version__,
        "width": settings.width,
        "height": settings.height,
        "seed": settings.seed,
        "spp": job.sample_count,
        "image_sha256": whole.stats["image_sha256"],
    }
    return PathMaps(about, whole.linear, parts.astype(np.float32), errors, whole.camera_stops)


def _checked(job: RenderJob, bounces: Any) -> int:
    if job.settings.integrator != "path":
        raise UsageError(f"integrator {job.settings.integrator} has no maps of paths; they are of the integrator path")
    if type(bounces) is not int or not 0 <= bounces <= MOST_BOUNCES:
        raise UsageError(f"bounces is {shown(bounces)}, but must be a whole number from 0 to {MOST_BOUNCES}")
    for name in ("time_limit", "error", "crop"):
        if getattr(job.settings, name):
            raise UsageError(f"{name} has no effect on maps; leave it out")
    for name in ("aov", "denoise", "light_groups", "amodal", "bands"):
        if getattr(job, name):
            raise UsageError(f"{'spectrum' if name == 'bands' else name} has no effect on maps; leave it out")
    return int(bounces)
