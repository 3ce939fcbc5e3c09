"""Statistics of a render, for ``--stats`` and the metadata of files."""

from __future__ import annotations

import re
import sys
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import numpy.typing as npt

from clrender.aov.names import FLOWS, NAMED
from clrender.film.convergence import Convergence, interval_of_mean
from clrender.film.replicates import image_error, replicate_counts
from clrender.image.files import image_sha256
from clrender.scene.content_hash import names_sha256

if TYPE_CHECKING:
    from clrender.film import Film
    from clrender.film.checkpoint import Checkpoint
    from clrender.flatten.flat_scene import FlatScene
    from clrender.rendering.job import RenderJob
    from clrender.scheduling.member import Member
    from clrender.scheduling.run import Tally

__all__ = ["asked_layers", "error_stats", "film_layers", "job_stats", "layer_stats", "peak_rss", "render_stats"]

_PEAK: Final = re.compile(rb"VmHWM:\s+(\d+) kB")


def job_stats(job: RenderJob, request: Mapping[str, Any]) -> dict[str, Any]:
    """Statistics that are known from the job before it is rendered.

    Parameters
    ----------
    job : RenderJob
    request : mapping
        Request of its film.
    """
    settings, field = job.settings, dict[str, Any]()
    if "guiding_field_sha256" in request:
        field = {"guiding_field_sha256": request["guiding_field_sha256"]}
    if "plugins" in request:
        field["plugins"] = request["plugins"]
    layers = asked_layers(job)
    return {
        **field,
        **({"layers": layers} if layers else {}),
        **layer_stats(job),
        "camera_exposure": job.scene.camera.exposure,
        "scene": job.scene.origin,
        "faults": job.scene.faults,
        "scene_sha256": request["scene_sha256"],
        "kernel_sha256": request["kernel_sha256"],
        "version": request["version"],
        "width": job.film_size[0],
        "height": job.film_size[1],
        **({} if settings.crop is None else {"crop": [*settings.crop, settings.width, settings.height]}),
        "spp": settings.spp,
        "seed": settings.seed,
        "integrator": settings.integrator,
        "settings": {**settings.request(), "spp": settings.spp},
        "first_sample": job.first_sample,
        "sample_count": job.sample_count,
    }


def asked_layers(job: RenderJob) -> list[str]:
    """What a job renders beside its image: names of its layers, light groups, amodal masks and bands of the spectrum.

    Parameters
    ----------
    job : RenderJob
    """
    groups = ["light_groups"] if job.light_groups else []
    bands = [f"spectrum {job.bands}"] if job.bands else []
    return [*job.aov, *groups, *(f"amodal {name}" for name in job.amodal), *bands]


def layer_stats(job: RenderJob) -> dict[str, Any]:
    """What the layers of a job depend on, though its image and so the hash of its scene do not.

    Parameters
    ----------
    job : RenderJob

    Returns
    -------
    dict
        ``names_sha256`` with layers, masks or light groups that tell of names; ``flow_step`` with layers of flows.
    """
    told = dict[str, Any]()
    if job.light_groups or job.amodal or not NAMED.isdisjoint(job.aov):
        told["names_sha256"] = names_sha256(job.scene)
    if not FLOWS.isdisjoint(job.aov):
        told["flow_step"] = job.scene.camera.flow_step
    return told


def render_stats(
    job: RenderJob,
    flat: FlatScene,
    film: Film,
    linear: npt.NDArray[np.float32],
    tally: Tally,
    members: Sequence[Member],
    measured: Mapping[str, float],
    resumed: Mapping[str, int],
    checkpoint: Checkpoint | None = None,
) -> dict[str, Any]:
    """The statistics that ``--stats`` writes.

    Parameters
    ----------
    job, flat, film, tally
        Of the render.
    linear : (height, width, 3) float32
        The image.
    members : sequence of Member
        The workers that took part, in the order of the tally.
    measured : mapping
        The keys that end in ``_seconds``, and those about the memory of reading and flattening.
    resumed : mapping
        ``samples``, ``rays``, ``shadow_rays`` and ``max_depth`` of the film before this render. They are included in
        the totals, but not in the counts of this render's devices.
    checkpoint : Checkpoint, optional
    """
    seconds = max(measured["render_seconds"], 1e-9)
    return {
        "image_sha256": image_sha256(linear),
        "denoised": False,
        **job_stats(job, film.request),
        "samples": tally.samples + resumed["samples"],
        "rays": tally.rays + resumed["rays"],
        "shadow_rays": tally.shadow_rays + resumed["shadow_rays"],
        "max_depth": max(tally.deepest, resumed["max_depth"]),
        "nonfinite_samples": tally.samples + resumed["samples"] - film.samples,
        **(checkpoint.stats() if checkpoint else {}),
        **measured,
        "msamples_per_second": tally.samples / seconds / 1e6,
        "mrays_per_second": tally.rays / seconds / 1e6,
        "peak_rss_bytes": peak_rss(),
        "device_bytes": sum(member.device_bytes for member in members),
        "triangles": flat.triangle_count,
        "spot_check": {
            "samples": tally.check_samples,
            "pieces": tally.checks,
            "differences": tally.differences,
        },
        "failures": [str(error) for error in (*tally.failures, *tally.recovered)],
        "devices": [
            {
                "name": member.name,
                **({"host": member.host} if member.host else {}),
                "driver": member.driver,
                "type": member.type,
                "units": done.units,
                "samples": done.samples,
                "seconds": member.busy_seconds,
                "requeued": done.requeued,
                "failures": done.failures,
                "state": done.state,
                "checked": done.checked,
            }
            for member, done in zip(members, tally.workers, strict=True)
        ],
    }


def error_stats(
    job: RenderJob,
    film: Film,
    errors: npt.NDArray[np.float64],
    found: Convergence | None,
    complete: bool,
) -> dict[str, Any]:
    """Entries of ``--stats`` for a film with replicates.

    Parameters
    ----------
    job, film
        Of the render.
    errors : (height, width, 3) float64
        Standard errors of the pixels.
    found : Convergence, optional
        The convergence, if the render stops by its error.
    complete : bool
        Whether the render met the error criterion or took all samples.
    """
    of_mean = image_error(errors, job.shares) if np.isfinite(errors).all() else None
    replicates = int(replicate_counts(film).min())
    stats: dict[str, Any] = {"replicates": replicates, "mean_stderr": None if of_mean is None else of_mean.tolist()}
    if found is None:
        return stats
    settings, taken = job.settings, int(film.ledger.taken().max())
    interval = None if of_mean is None else interval_of_mean(settings, replicates, of_mean).tolist()
    if complete:  # the sample count of the image, which its verification uses
        stats |= {"spp": taken, "sample_count": taken, "settings": {**settings.request(), "spp": taken}}
    return stats | {
        "error": settings.error,
        "confidence": settings.confidence,
        "mean_interval": interval,
        "share": settings.share,
        "error_floor": settings.error_floor,
        "spp_limit": settings.spp,
        "converged": found.reached,
        "unconverged_pixels": int(np.count_nonzero(found.unconverged)),
        "unconverged_share": 1.0 - found.share,
    }


def film_layers(
    film: Film, errors: npt.NDArray[np.float64] | None, found: Convergence | None
) -> dict[str, npt.NDArray[np.float32]]:
    """The layers that come from the image's own film, each (height, width, channels) float32."""
    layers = {"samples": film.counts[..., None].astype(np.float32)}
    if errors is not None:
        # Stored channel by channel, as in files, so that writing needs no copy
        layers["stderr"] = np.moveaxis(np.moveaxis(errors, 2, 0).astype(np.float32, order="C"), 0, 2)
    if found is not None:
        layers["unconverged"] = found.unconverged[..., None].astype(np.float32)
    return layers


def peak_rss() -> int:
    """Peak resident memory of this process, bytes; 0 if the system does not report it."""
    # `ru_maxrss` starts at the value of the parent process. Each image asks, so as bytes, without a reader of text
    with suppress(OSError), Path("/proc/self/status").open("rb", buffering=0) as status:
        if match := _PEAK.search(status.read(1 << 14)):
            return int(match[1]) * 1024
    try:
        import resource
    except ImportError:
        return 0
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak if sys.platform == "darwin" else peak * 1024
