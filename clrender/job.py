"""A render as data: what is asked for, checked once, and the hashes of all that makes its image what it is."""

from __future__ import annotations

import dataclasses
import hashlib
import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any, Final

from clrender.aov import ERRORS, check_aovs
from clrender.device.source import kernels_sha256
from clrender.errors import UsageError
from clrender.integrators import INTEGRATORS, Integrator
from clrender.resources import kernels_folder
from clrender.scene import Scene
from clrender.scene.portable import scene_from_portable, scene_to_portable
from clrender.scene.taken import check_materials
from clrender.settings import REPLICATE_SPP, RenderSettings, check_memory, settings_for
from clrender.version import __version__

__all__ = ["RenderJob"]

FORMAT: Final = "clrender job 1"


@dataclass(frozen=True)
class RenderJob:
    """A scene, the settings of its render, and which of its samples are wanted; make one with `RenderJob.of`.

    Attributes
    ----------
    scene : Scene
    settings : RenderSettings
    first_sample, sample_count : int
        Of each pixel; the whole render has the samples from 0 to `settings.spp`.
    aov : tuple of str
        Layers beside the image.
    denoise : bool
    """

    scene: Scene
    settings: RenderSettings
    first_sample: int
    sample_count: int
    aov: tuple[str, ...] = ()
    denoise: bool = False

    @classmethod
    def of(
        cls,
        scene: Scene,
        *,
        size: tuple[int, int] | None = None,
        samples: tuple[int, int] | None = None,
        aov: Iterable[str] = (),
        denoise: bool = False,
        **settings: Any,
    ) -> RenderJob:
        """A job, checked.

        Parameters
        ----------
        scene : Scene
        size : (int, int), optional
            Width and height; default: the scene's.
        samples : (int, int), optional
            The first sample of each pixel, and the first that is not wanted any more; default: all, (0, spp).
        aov : iterable of str
            Layers, of `clrender.aov.AOVS`.
        denoise : bool
        **settings
            Fields of `RenderSettings`; what is not given comes from the scene, then from the defaults.

        Returns
        -------
        RenderJob

        Raises
        ------
        UsageError
            When something makes no sense.
        SceneError
            When the integrator does not take a material of the scene.
        """
        return cls._checked(scene, settings_for(scene, size, settings), samples, aov, denoise)

    @classmethod
    def _checked(
        cls,
        scene: Scene,
        settings: RenderSettings,
        samples: tuple[int, int] | None,
        aov: Iterable[str],
        denoise: bool,
    ) -> RenderJob:
        layers = check_aovs(aov)
        if "unconverged" in layers and settings.error is None:
            raise UsageError("aov: the layer unconverged needs error, which says what counts as converged")
        if not ERRORS.isdisjoint(layers) and settings.replicate_spp is None:
            settings = dataclasses.replace(settings, replicate_spp=REPLICATE_SPP)
            check_memory(settings)
        first, stop = samples if samples is not None else (0, settings.spp)
        if not 0 <= first < stop <= settings.spp:
            raise UsageError(f"samples is {(first, stop)}; it must be a range within the {settings.spp} of a pixel")
        _check_parts(settings, first, stop)
        if not ERRORS.isdisjoint(layers) and stop - first < 2 * (settings.replicate_spp or 1):
            raise UsageError(
                f"aov: standard errors take two replicates or more, and {stop - first} samples are fewer than two of "
                f"{settings.replicate_spp}; ask for more samples, or for smaller replicates"
            )
        check_materials(scene, settings.integrator)
        return cls(scene, settings, first, stop - first, layers, denoise)

    @classmethod
    def given(cls, scene: Scene | RenderJob, **settings: Any) -> RenderJob:
        """A job as it is, or the one that a scene and settings make.

        Parameters
        ----------
        scene : Scene or RenderJob
        **settings
            Of a scene: as `RenderJob.of` takes them.

        Returns
        -------
        RenderJob

        Raises
        ------
        UsageError
            When something makes no sense, neither is given, or a job comes with settings: it has its own.
        """
        if isinstance(scene, Scene):
            return cls.of(scene, **settings)
        if not isinstance(scene, RenderJob):
            raise UsageError(f"{scene!r:.60} is no scene; read one with clrender.load(…), and render that")
        if settings:
            raise UsageError(f"a job has its own settings; {', '.join(sorted(settings))} cannot be given beside it")
        return scene

    @property
    def integrator(self) -> Integrator:
        """What the settings name."""
        return INTEGRATORS[self.settings.integrator]

    def shard(self, number: int, count: int) -> RenderJob:
        """One of some disjoint parts of the samples that together are the job.

        Parameters
        ----------
        number : int
            From 1 to `count`.
        count : int
            Of parts, each of one sample of every pixel at least.

        Returns
        -------
        RenderJob

        Raises
        ------
        UsageError
            There is no such part.
        """
        if not 1 <= number <= count:
            raise UsageError(f"shard {number}/{count}: there are the shards 1/{count} to {count}/{count}")
        whole = self.settings.replicate_spp or 1
        parts = self.sample_count // whole
        if count > parts:
            what = "samples" if whole == 1 else f"replicates of {whole} samples"
            raise UsageError(
                f"shard {number}/{count}: {parts} {what} a pixel make at most {parts} shards; ask for fewer shards or "
                "for more samples"
            )
        if self.settings.error is not None:
            raise UsageError(
                f"shard {number}/{count}: no part of the samples says when the whole image is good enough; leave out "
                "the error, or render it in one piece, on as many devices as there are"
            )
        begin, stop = (parts * part // count * whole for part in (number - 1, number))
        return dataclasses.replace(self, first_sample=self.first_sample + begin, sample_count=stop - begin)

    def request(self) -> dict[str, Any]:
        """What makes the image what it is, JSON-able: the same for all parts of one image, and for no other image.

        Neither the number of samples is in it, of which a film may hold some, nor how the work is cut and by whom.
        """
        return {
            **self.settings.request(),
            "scene_sha256": self.scene.sha256(),
            "kernel_sha256": kernels_sha256(),
            "sampler_sha256": _sampler_sha256(),
            "version": __version__,
        }

    def sha256(self) -> str:
        """Hash of the request: equal for jobs whose films can be merged."""
        text = json.dumps(self.request(), sort_keys=True, separators=(",", ":"))
        return hashlib.sha256(text.encode()).hexdigest()

    def to_json(self) -> tuple[str, dict[str, bytes]]:
        """The job as JSON text, and the files that it names by their hashes, for another process or machine.

        Returns
        -------
        text : str
        assets : dict of str to bytes

        Raises
        ------
        SceneError
            A file cannot be read.
        """
        scene, assets = scene_to_portable(self.scene)
        content = {
            "format": FORMAT,
            "scene": scene,
            "settings": dataclasses.asdict(self.settings),
            "samples": [self.first_sample, self.first_sample + self.sample_count],
            "aov": list(self.aov),
            "denoise": self.denoise,
            "request": self.request(),
        }
        return json.dumps(content), assets  # in the scene's own order, by which materials have their numbers

    @classmethod
    def from_json(cls, text: str, assets: Mapping[str, bytes]) -> RenderJob:
        """The job that `to_json` wrote, checked anew.

        Parameters
        ----------
        text : str
            What `to_json` gave.
        assets : mapping of str to bytes
            The files that it names, by their hashes.

        Returns
        -------
        RenderJob

        Raises
        ------
        UsageError
            It is no job, or here it would give another image: other kernels, another version.
        SceneError
            Its scene is not valid, or an asset is missing or damaged.
        """
        try:
            content = json.loads(text)
            if content["format"] != FORMAT:
                raise ValueError(f"its format is {content['format']!r}")
            settings = RenderSettings(**content["settings"])
            first, stop = content["samples"]
            aov, denoise, request = tuple(content["aov"]), bool(content["denoise"]), dict(content["request"])
            description = dict(content["scene"])
        except (KeyError, TypeError, ValueError) as error:
            raise UsageError(f"this is no clrender job of the format {FORMAT!r} ({error})") from None
        scene = scene_from_portable(description, assets, "job")
        job = cls._checked(scene, settings, (first, stop), aov, denoise)
        here = job.request()
        if different := sorted(key for key in {*here, *request} if here.get(key) != request.get(key)):
            raise UsageError(
                f"the job was made for another image: {', '.join(different)} differ here; make it with this version "
                "of clrender"
            )
        return job


def _check_parts(settings: RenderSettings, first: int, stop: int) -> None:
    """A part of the samples holds whole replicates, and only the whole stops by its error."""
    whole = settings.replicate_spp or 1
    if first % whole or stop % whole:
        raise UsageError(f"samples is {(first, stop)}; with replicates of {whole} samples both must be multiples of it")
    if settings.error is not None and (first, stop) != (0, settings.spp):
        raise UsageError(f"samples is {(first, stop)}; a render that stops by its error takes all of them, from 0 on")


def _sampler_sha256() -> str:
    """Hash of the kernels' sampler: the points that a seed, a pixel and a sample stand for."""
    return hashlib.sha256((kernels_folder() / "core" / "sampler.h").read_bytes()).hexdigest()
