"""Layers that take renders of their own beside that of the image: its samples again, in other light or other scenes."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from clrender.aov import LAYER_SAMPLES, SHADOW_CATCHER, Labelling, labels_told
from clrender.rendering.amodal import alone
from clrender.rendering.job import RenderJob
from clrender.rendering.light_groups import adding_up
from clrender.rendering.rendered_image import RenderedImage
from clrender.rendering.shadow_catchers import caught, whole_and_bare
from clrender.spectra.kernel_table import band_edges

if TYPE_CHECKING:
    from clrender.guiding.field import GuidingField

__all__ = ["FurtherRenders"]


class _Stopped(Exception):
    """A further render was stopped early."""


@dataclass(frozen=True)
class FurtherRenders:
    """The layers of an image that are rendered after it.

    Attributes
    ----------
    image : RenderedImage
        It gets the layers, and their times in its statistics.
    job : RenderJob
    groups : sequence of str
        The scene's light groups.
    areas : mapping of str to mapping of int to float
        Pixels that instances, classes and parts cover, by the layer and the number.
    render : callable
        Renders another job, by whoever has rendered the image.
    count_hits : callable
        Given a job and a number of samples, counts how many of these hit anything, (height, width) uint32.
    field : callable
        The field that guided the image; None for none.
    stopped : callable
        Whether the user has asked to stop.
    tell : callable
        Called with one line of text for the user.
    """

    image: RenderedImage
    job: RenderJob
    groups: Sequence[str]
    areas: Mapping[str, Mapping[int, float]]
    render: Callable[[RenderJob], RenderedImage]
    count_hits: Callable[[RenderJob, int], npt.NDArray[np.uint32]]
    field: Callable[[], GuidingField | None]
    stopped: Callable[[], bool]
    tell: Callable[[str], None]

    def add(self) -> None:
        """Render the layers that the job asks for. Where that is stopped, a line of text says what is missing."""
        if self.job.light_groups:
            self._add(self._light_groups, "light_groups", "are no layers of light groups")
        if self.job.bands:
            self._add(self._bands, "spectrum", "are no bands of the spectrum")
        if self.job.amodal:
            self._add(self._amodal, "amodal", "are no amodal masks")
        if SHADOW_CATCHER in self.job.aov:
            self._add(self._shadow_catchers, "shadow_catcher", "is no layer of shadow catchers")

    def _add(self, make: Callable[[], None], name: str, missing: str) -> None:
        begin = time.perf_counter()
        try:
            make()
        except _Stopped:
            self.tell(f"warning: there {missing}, as the render was stopped early")
        else:
            self.image.stats[f"{name}_seconds"] = time.perf_counter() - begin

    def _part(self, job: RenderJob) -> RenderedImage:
        """The image of another job."""
        part = None if self.image.interrupted else self.render(job)
        if part is None or part.interrupted:
            raise _Stopped
        return part

    def _bare(self, **changes: Any) -> RenderJob:
        """The job without layers that are rendered after the image."""
        return dataclasses.replace(self.job, denoise=False, light_groups=False, amodal=(), bands=0, **changes)

    def _again(self, **settings: Any) -> RenderJob:
        """The job that takes the samples of the image once more, without layers, under these settings."""
        return self._bare(aov=(), **self._samples_again(**settings))

    def _samples_again(self, **settings: Any) -> dict[str, Any]:
        """The parts of a job that say which samples it takes and what guides them: as the image's, to the last one."""
        field, count = self.field(), self.image.stats["sample_count"]
        settings |= {"spp": self.job.first_sample + count, "guiding": "off" if field is None else "on"}
        again = dataclasses.replace(self.job.settings, error=None, time_limit=None, **settings)
        return {"settings": again, "sample_count": count, "guiding_field": field}

    def _light_groups(self) -> None:
        """The parts of the light groups: the same samples again, with the lights of one group at a time."""
        job = self._again()
        parts = {name: self._part(dataclasses.replace(job, lit_by=name)).linear for name in self.groups}
        self.image.stats["light_groups"] = list(parts)
        self.image.light_groups = adding_up(self.image.linear, parts)

    def _bands(self) -> None:
        """Radiance in bands of the spectrum: as many samples again for each three of them."""
        count = self.job.bands
        found = np.zeros((*self.image.linear.shape[:2], count), np.float32)
        for first in (*range(0, count - 3, 3), count - 3):
            found[..., first : first + 3] = self._part(self._again(bands=(first, count))).linear
        self.image.stats["spectrum_nm"] = [round(edge, 6) for edge in band_edges(count).tolist()]
        self.image.spectrum = found

    def _amodal(self) -> None:
        """Masks of instances as if nothing stood before them: the same camera samples, in scenes of each one alone."""
        image, labelling = self.image, Labelling.of(self.job.scene)
        samples = min(self.job.settings.spp, LAYER_SAMPLES)
        masks, areas = dict[int, npt.NDArray[np.float32]](), dict[int, float]()
        for number in labelling.numbered(self.job.amodal):
            counts = self.count_hits(self._bare(aov=(), scene=alone(self.job.scene, labelling, number)), samples)
            if self.stopped():
                raise _Stopped
            masks[number] = (counts / np.float64(samples)).astype(np.float32)
            areas[number] = int(counts.sum(dtype=np.int64)) / samples
        image.labels = labels_told(self.job.scene, self.areas, areas)
        image.stats["labels"] = {layer: [each.told() for each in some] for layer, some in image.labels.items()}
        image.amodal = masks

    def _shadow_catchers(self) -> None:
        """The layer of shadow catchers, and their shadows in alpha: the same samples, with and without objects."""
        alpha, parts = self.image.alpha, []
        if alpha is None:
            raise _Stopped
        common = self._bare(aov=("alpha",), **self._samples_again())
        for scene in whole_and_bare(self.job.scene):
            part = self._part(dataclasses.replace(common, scene=scene))
            assert part.alpha is not None, "it is asked for"
            parts.append((part.linear, part.alpha))
        factor, whole = caught(self.image.linear, alpha, *parts)
        self.image.aovs |= {SHADOW_CATCHER: factor, "alpha": whole[..., None]}
