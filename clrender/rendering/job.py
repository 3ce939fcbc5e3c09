"""A render as data: the checked request, and hashes of everything that determines its image."""

from __future__ import annotations

import dataclasses
import hashlib
import inspect
import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cache
from numbers import Integral
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from clrender.aov import ERRORS, FLOWS, SHADOW_CATCHER, Labelling, check_aovs
from clrender.errors import UsageError
from clrender.files.kernel_hash import kernels_sha256
from clrender.files.package_data import kernels_folder
from clrender.flatten.plugin_rows import plugin_hashes, used_plugins
from clrender.flatten.supported import check_materials, check_motion
from clrender.integrators import INTEGRATORS, Integrator
from clrender.limits import MOST_BANDS, checked_flag, checked_path, shown
from clrender.scene import Camera, Scene
from clrender.scene.portable import scene_from_portable, scene_to_portable
from clrender.settings import REPLICATE_SPP, RenderSettings, check_memory, present, settings_for
from clrender.version import __version__
from clrender.wording import counted

if TYPE_CHECKING:
    from clrender.guiding.field import GuidingField

__all__ = ["RenderJob"]

FORMAT: Final = "clrender job 1"


@dataclass(frozen=True)
class RenderJob:
    """A scene, its render settings and the range of samples to take; create one with `RenderJob.of`.

    Attributes
    ----------
    scene : Scene
    settings : RenderSettings
    first_sample, sample_count : int
        Range of the samples of each pixel; the whole render has the samples from 0 to `settings.spp`.
    aov : tuple of str
        Layers in addition to the image.
    denoise : bool
    guiding_field : GuidingField, optional
        The field that guides paths, in place of one that is trained.
    light_groups : bool
        Whether the part of each light group is rendered as well.
    lit_by : str or None
        The only light group that shines; see `clrender.flatten.light_groups.lit_by`.
    views : tuple of Camera
        Cameras whose images are rendered together, below each other; empty: that of the scene.
    amodal : tuple of str
        Instances whose amodal masks are rendered, or ``all``.
    bands : int
        Number of bands of the spectrum whose radiance is rendered as well.
    """

    scene: Scene
    settings: RenderSettings
    first_sample: int
    sample_count: int
    aov: tuple[str, ...] = ()
    denoise: bool = False
    guiding_field: GuidingField | None = None
    light_groups: bool = False
    lit_by: str | None = None
    views: tuple[Camera, ...] = ()
    amodal: tuple[str, ...] = ()
    bands: int = 0

    @classmethod
    def of(
        cls,
        scene: Scene,
        *,
        size: tuple[int, int] | None = None,
        samples: tuple[int, int] | None = None,
        aov: Iterable[str] = (),
        denoise: bool = False,
        guiding_field: GuidingField | str | Path | None = None,
        light_groups: bool = False,
        amodal: str | Iterable[str] = (),
        spectrum: int = 0,
        plugins: Any = None,
        **settings: Any,
    ) -> RenderJob:
        """Create a job and check it.

        Parameters
        ----------
        scene : Scene
        size : (int, int), optional
            Width and height; default: the scene's.
        samples : (int, int), optional
            Half-open range of the samples of each pixel; default: all, (0, spp).
        aov : iterable of str
            Layers, named in `clrender.aov.AOVS`.
        denoise : bool
        guiding_field : GuidingField or path, optional
            A field that was kept (`RenderedImage.guiding_field`), or its file, instead of training; `guiding` is then
            on.
        light_groups : bool
            Whether to render the part of each light group as well, in as many renders again.
        amodal : str or iterable of str
            Names of instances whose masks are rendered as well as if nothing stood before them, or ``all``; with
            the layer ``instance``.
        spectrum : int
            Number of bands of equal width, from 360 to 830 nm, whose radiance is rendered as well, in a third as many
            renders again; with `spectral`.
        plugins : Plugin, str, pathlib.Path, or iterable of them, optional
            Plugins that the scene's materials use, besides those that it was loaded with; see `clrender.plugin`.
        **settings
            Fields of `RenderSettings`; those not given come from the scene, else from the defaults.

        Returns
        -------
        RenderJob

        Raises
        ------
        UsageError
            When a setting is invalid.
        SceneError
            When the integrator does not support a material of the scene, or a plugin that it uses is not given.
        """
        if guiding_field is not None:
            settings = {"guiding": "on", **settings}
            guiding_field = _field(guiding_field)
        scene = scene.with_plugins(plugins)
        if not isinstance(amodal, Iterable):
            raise UsageError(f"amodal is {shown(amodal)}, but must be names of instances, or all")
        masks = tuple(each.strip() for each in amodal.split(",")) if isinstance(amodal, str) else tuple(amodal)
        if not all(isinstance(each, str) for each in masks):
            raise UsageError(f"amodal is {shown(amodal)}, but must be names of instances, or all")
        denoise, light_groups = checked_flag(denoise, "denoise"), checked_flag(light_groups, "light_groups")
        aov = (*check_aovs(aov), "instance") if masks else aov
        aov = _with_catchers(scene, check_aovs(aov))
        job = cls._checked(scene, settings_for(scene, size, settings, _beside()), samples, aov, denoise, guiding_field)
        if masks:
            Labelling.of(scene).numbered(masks)
            job = dataclasses.replace(job, amodal=masks)
        if spectrum:
            job = dataclasses.replace(job, bands=_checked_bands(spectrum, job.settings))
        if not light_groups:
            return job
        if job.integrator.bias == "discretised":
            name = job.settings.integrator
            raise UsageError(f"light_groups: the integrator {name} solves for all light at once; leave one of them out")
        return dataclasses.replace(job, light_groups=True)

    @classmethod
    def _checked(
        cls,
        scene: Scene,
        settings: RenderSettings,
        samples: tuple[int, int] | None,
        aov: Iterable[str],
        denoise: bool,
        guiding_field: GuidingField | None = None,
    ) -> RenderJob:
        if guiding_field is not None and settings.guiding != "on":
            raise UsageError(f"guiding_field has no effect with guiding {settings.guiding}; leave one of them out")
        layers = check_aovs(aov)
        if "unconverged" in layers and settings.error is None:
            raise UsageError("aov: the layer unconverged needs error, which says what counts as converged")
        if (moving := FLOWS.intersection(layers)) and not scene.camera.flow_step:
            begin, end = scene.camera.interval
            if begin == end:
                raise UsageError(
                    f"aov: the layer {min(moving)} leads from one time to another; give camera.flow_step, or a shutter "
                    "that opens and closes (camera.shutter = [t0, t1], --shutter T0:T1)"
                )
        first, stop = _range(samples) if samples is not None else (0, settings.spp)
        if not 0 <= first < stop <= settings.spp:
            raise UsageError(f"samples is {(first, stop)}; it must be a range within the {settings.spp} of a pixel")
        if not ERRORS.isdisjoint(layers):
            size = settings.replicate_spp or REPLICATE_SPP
            if stop - first < 2 * size:
                raise UsageError(
                    "aov: standard errors take two replicates or more, and "
                    f"{counted(stop - first, 'sample is', 'samples are')} fewer than two "
                    f"of {size}; ask for {counted(2 * size, 'sample')} or more, or for smaller replicates"
                )
            if settings.replicate_spp is None:
                settings = dataclasses.replace(settings, replicate_spp=size)
                check_memory(settings)
        _check_parts(settings, first, stop)
        scene.of_contents(f"taken by {settings.integrator}", lambda: check_materials(scene, settings.integrator))
        check_motion(scene, settings.integrator)
        return cls(scene, settings, first, stop - first, layers, denoise, guiding_field)

    @classmethod
    def given(cls, scene: Scene | RenderJob, **settings: Any) -> RenderJob:
        """Return a given job as it is, or create one from a scene and settings.

        Parameters
        ----------
        scene : Scene or RenderJob
        **settings
            Only with a scene; see `RenderJob.of`.

        Returns
        -------
        RenderJob

        Raises
        ------
        UsageError
            When a setting is invalid, `scene` is neither a scene nor a job, or settings are given with a job.
        """
        if isinstance(scene, Scene):
            return cls.of(scene, **settings)
        if not isinstance(scene, RenderJob):
            raise UsageError(f"{scene!r:.60} is no scene; read one with clrender.load(…), and render that")
        if settings:
            raise UsageError(f"a job has its own settings; {', '.join(sorted(settings))} cannot be given beside it")
        return scene

    @property
    def film_size(self) -> tuple[int, int]:
        """Width and height of the film, pixels."""
        width, height = self.settings.film_size
        return width, height * (len(self.views) or 1)

    @property
    def integrator(self) -> Integrator:
        """The integrator that the settings name."""
        return INTEGRATORS[self.settings.integrator]

    @property
    def guided(self) -> bool:
        """Whether paths may be guided; a scene may ask for it, and then be rendered by another integrator."""
        return self.settings.guiding != "off" and bool(self.integrator.guiding)

    @property
    def preparation(self) -> str:
        """The module that computes what the integrator needs before the first sample; empty: none."""
        return self.integrator.guiding if self.guided else self.integrator.preparation

    def shard(self, number: int, count: int) -> RenderJob:
        """One of several disjoint shards of the samples that together make up the job.

        Parameters
        ----------
        number : int
            From 1 to `count`.
        count : int
            Number of shards; each has at least one sample (or replicate) of every pixel.

        Returns
        -------
        RenderJob

        Raises
        ------
        UsageError
            When there is no such shard, or the render stops by its error.
        """
        if not 1 <= number <= count:
            raise UsageError(f"shard {number}/{count}: there are the shards 1/{count} to {count}/{count}")
        whole = self.settings.replicate_spp or 1
        parts = self.sample_count // whole
        if count > parts:
            held = counted(parts, "sample")
            if whole > 1:
                held = counted(parts, f"replicate of {whole} samples", f"replicates of {whole} samples")
            raise UsageError(
                f"shard {number}/{count}: {held} a pixel {'makes' if parts == 1 else 'make'} at most "
                f"{counted(parts, 'shard')}; ask for fewer shards or for more samples"
            )
        if self.settings.error is not None:
            raise UsageError(
                f"shard {number}/{count}: no part of the samples says when the whole image is good enough; leave out "
                "the error, or render it in one piece, on as many devices as there are"
            )
        begin, stop = (parts * part // count * whole for part in (number - 1, number))
        return dataclasses.replace(self, first_sample=self.first_sample + begin, sample_count=stop - begin)

    @property
    def shares(self) -> str:
        """Which pixels share light, as `Integrator.shares` says.

        Those that share the light of a block also share the wavelengths and the time of each sample, with all pixels.
        """
        begin, end = self.scene.camera.interval
        moves = begin < end and (self.scene.has_motion or bool(self.scene.camera.motion))
        shares = self.integrator.shares
        return "image" if shares and self.integrator.times == "image" and (self.settings.spectral or moves) else shares

    def request(self) -> dict[str, Any]:
        """Everything that determines the image, as JSON values: equal for all parts of one image, and only for these.

        It contains neither the number of samples, as a film may hold fewer, nor the division of the work, nor the
        devices.
        """
        field = {} if self.guiding_field is None else {"guiding_field_sha256": self.guiding_field.sha256()}
        plugins = plugin_hashes(used_plugins(self.scene))
        return {
            **self.settings.request(),
            **field,
            **({"plugins": plugins} if plugins else {}),
            **({"shares": self.shares} if self.shares != self.integrator.shares else {}),
            "scene_sha256": self.scene.sha256(),
            "kernel_sha256": kernels_sha256(),
            "sampler_sha256": _sampler_sha256(),
            "version": __version__,
        }

    def check_for_cluster(self) -> None:
        """Check that a cluster can render it.

        Raises
        ------
        UsageError
            When the scene uses plugins, which are programs: no message of a cluster carries any.
        """
        if plugins := used_plugins(self.scene):
            raise UsageError(
                f"{self.scene.source}: the scene uses the plugin {plugins[0].name}, and a cluster's jobs carry no "
                "plugins, which are programs; render it without a cluster"
            )

    def sha256(self) -> str:
        """Hash of the request: equal for jobs whose films can be merged."""
        text = json.dumps(self.request(), sort_keys=True, separators=(",", ":"))
        return hashlib.sha256(text.encode()).hexdigest()

    def to_json(self) -> tuple[str, dict[str, bytes]]:
        """Serialize the job for another process or machine: JSON text, and the files that it refers to by hash.

        Returns
        -------
        text : str
        assets : dict of str to bytes

        Raises
        ------
        SceneError
            When a file cannot be read.
        UsageError
            When the scene uses plugins.
        """
        self.check_for_cluster()
        scene, assets = scene_to_portable(self.scene)
        field = None
        if self.guiding_field is not None:
            field = self.guiding_field.sha256()
            assets = {**assets, field: self.guiding_field.words.tobytes()}
        content = {
            "format": FORMAT,
            "scene": scene,
            "settings": dataclasses.asdict(self.settings),
            "samples": [self.first_sample, self.first_sample + self.sample_count],
            "aov": list(self.aov),
            "denoise": self.denoise,
            "guiding_field": field,
            "light_groups": self.light_groups,
            "lit_by": self.lit_by,
            "amodal": list(self.amodal),
            "bands": self.bands,
            "request": self.request(),
        }
        return json.dumps(content), assets  # in the scene's own order, which numbers the materials

    @classmethod
    def from_json(cls, text: str, assets: Mapping[str, bytes]) -> RenderJob:
        """Read a job that `to_json` wrote, and check it again.

        Parameters
        ----------
        text : str
            Text from `to_json`.
        assets : mapping of str to bytes
            The files that it refers to, by hash.

        Returns
        -------
        RenderJob

        Raises
        ------
        UsageError
            When the text is no job, or would give another image here because the kernels or the version differ.
        SceneError
            When its scene is not valid, or an asset is missing or damaged.
        """
        try:
            content = json.loads(text)
            if content["format"] != FORMAT:
                raise ValueError(f"its format is {content['format']!r}")
            settings = RenderSettings(**present(dict(content["settings"])))
            first, stop = content["samples"]
            aov, denoise, request = tuple(content["aov"]), bool(content["denoise"]), dict(content["request"])
            description, field = dict(content["scene"]), content["guiding_field"]
            groups = bool(content.get("light_groups", False)), content.get("lit_by")
            amodal, bands = tuple(content.get("amodal", ())), int(content.get("bands", 0))
        except (KeyError, TypeError, ValueError) as error:
            raise UsageError(f"this is no clrender job of the format {FORMAT!r} ({error})") from None
        scene = scene_from_portable(description, assets, "job")
        job = cls._checked(scene, settings, (first, stop), aov, denoise, _shipped_field(field, assets))
        here = job.request()
        if different := sorted(key for key in {*here, *request} if here.get(key) != request.get(key)):
            raise UsageError(
                f"the job was made for another image: {', '.join(different)} differ here; make it with this version "
                "of clrender"
            )
        return dataclasses.replace(job, light_groups=groups[0], lit_by=groups[1], amodal=amodal, bands=bands)


def _checked_bands(count: Any, settings: RenderSettings) -> int:
    if not isinstance(count, Integral) or isinstance(count, bool) or not 3 <= int(count) <= MOST_BANDS:
        raise UsageError(f"spectrum is {shown(count)}, but must be a whole number from 3 to {MOST_BANDS}, of bands")
    if not settings.spectral:
        raise UsageError("spectrum has no effect without spectral; set that as well, or leave spectrum out")
    return int(count)


def _with_catchers(scene: Scene, layers: tuple[str, ...]) -> tuple[str, ...]:
    """The layers, with those that come together where there are shadow catchers."""
    if SHADOW_CATCHER in layers and not scene.has_shadow_catchers:
        raise UsageError(f"aov: the layer {SHADOW_CATCHER} needs a shape with shadow_catcher = true")
    if not scene.has_shadow_catchers or {"alpha", SHADOW_CATCHER}.isdisjoint(layers):
        return layers
    return (*layers, "alpha", SHADOW_CATCHER)


def _field(given: GuidingField | str | Path) -> GuidingField:
    from clrender.guiding.field import GuidingField

    return given if isinstance(given, GuidingField) else GuidingField.read(checked_path(given, "guiding_field"))


def _shipped_field(sha256: object, assets: Mapping[str, bytes]) -> GuidingField | None:
    """The field of a job that was sent, from its assets."""
    if sha256 is None:
        return None
    from clrender.guiding.field import GuidingField

    try:
        field = GuidingField.of_words(np.frombuffer(assets[str(sha256)], "<u4"))
        if field.sha256() != sha256:
            raise ValueError("it is damaged")
    except (KeyError, ValueError) as error:
        raise UsageError(f"the job's guiding field is missing or no field ({error})") from None
    return field


@cache
def _beside() -> tuple[str, ...]:
    """What `RenderJob.of` takes beside settings."""
    kinds = inspect.signature(RenderJob.of).parameters.values()
    return tuple(each.name for each in kinds if each.kind is each.KEYWORD_ONLY)


def _range(samples: object) -> tuple[int, int]:
    """The two ends of a range of samples, given by a caller."""
    ends = tuple(samples) if isinstance(samples, Iterable) else ()
    if len(ends) != 2 or not all(isinstance(end, Integral) for end in ends):
        cure = f"; for {samples} samples per pixel, give spp" if isinstance(samples, Integral) else ""
        raise UsageError(
            f"samples is {samples!r}, but must be two whole numbers, the first and the one after the last{cure}"
        )
    return int(ends[0]), int(ends[1])


def _check_parts(settings: RenderSettings, first: int, stop: int) -> None:
    """Check that a range of samples holds whole replicates, and all samples if the render stops by its error."""
    whole = settings.replicate_spp or 1
    if first % whole or stop % whole:
        raise UsageError(
            f"samples is {(first, stop)}; with replicates of {counted(whole, 'sample')} both must be multiples of it"
        )
    if settings.error is not None and (first, stop) != (0, settings.spp):
        raise UsageError(f"samples is {(first, stop)}; a render that stops by its error takes all of them, from 0 on")


@cache
def _sampler_sha256() -> str:
    """Hash of the kernels' sampler, which maps a seed, a pixel and a sample to sample points."""
    return hashlib.sha256((kernels_folder() / "core" / "sampler.h").read_bytes()).hexdigest()
