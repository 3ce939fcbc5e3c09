"""One image of a data set, rendered, with what its writers need."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from clrender.aov import LABELS, Labelling, exr_channels, matte_attributes
from clrender.datasets.placing import matrix_of
from clrender.datasets.variation import DatasetPlan, Varied
from clrender.datasets.views import camera_told
from clrender.image.exact_display import display_bytes
from clrender.image.files import image_sha256
from clrender.rendering.amodal import amodal_channels
from clrender.rendering.rendered_image import RenderedImage
from clrender.scene.groups import Instance
from clrender.scene.motion import rests
from clrender.scene.resting import placements
from clrender.scene.shapes import Transform
from clrender.scene.transforms import Affine, affine, combined

__all__ = ["Rendered", "Seen", "box_of"]


@dataclass(frozen=True)
class Seen:
    """An instance that an image shows, or would show if nothing stood before it.

    Attributes
    ----------
    number : int
        In the layer ``instance``.
    name : str
    category : str or None
    area, whole_area : float
        Pixels; the latter is None without amodal masks.
    model : str
        Name of its group, else its own.
    pose : Affine
        From the space of its group, or of its shape before its transform, to world space, when the shutter opens.
    """

    number: int
    name: str
    category: str | None
    area: float
    whole_area: float | None
    model: str
    pose: Affine

    def told(self) -> dict[str, Any]:
        """All of it, JSON-able."""
        found = {"number": self.number, "name": self.name, "category": self.category, "area": self.area}
        found |= {} if self.whole_area is None else {"whole_area": self.whole_area}
        return {**found, "model": self.model, "object_to_world": matrix_of(self.pose)}


@dataclass(frozen=True)
class Rendered:
    """One image.

    Attributes
    ----------
    plan : DatasetPlan
    varied : Varied
        Its scene.
    image : RenderedImage
        With all layers that are needed.
    """

    plan: DatasetPlan
    varied: Varied
    image: RenderedImage

    @property
    def name(self) -> str:
        """Its number, with leading zeros, for names of files."""
        return f"{self.varied.index:0{max(6, len(str(self.plan.spec.images - 1)))}d}"

    @cached_property
    def linear_sha256(self) -> str:
        """Hash of its radiance."""
        return image_sha256(self.image.linear)

    @cached_property
    def picture(self) -> npt.NDArray[Any]:
        """What a camera would write: from its sensor, or for display, (H, W, 3) or (H, W) uint8 or uint16."""
        spec = self.plan.spec
        if spec.sensor is None:
            return display_bytes(self.image.linear, spec.exposure + self.image.camera_stops)
        linear = self.image.linear
        return spec.sensor.sensor().image(linear, spec.seed, self.varied.index & 0xFFFFFFFF)

    @cached_property
    def category_numbers(self) -> npt.NDArray[np.int64]:
        """Numbers in the data set of the scene's categories, by their number in the scene; 0 is 0."""
        names = Labelling.of(self.varied.scene).categories
        return np.array([0, *(self.plan.categories.index(name) + 1 for name in names)], np.int64)

    def mask(self, layer: str) -> npt.NDArray[np.int64]:
        """Numbers of a layer of labels, (H, W) int64; categories have those of the data set."""
        numbers = self.image.mask(layer).astype(np.int64)
        return self.category_numbers[numbers] if layer == "category" else numbers

    @cached_property
    def layers(self) -> dict[str, npt.NDArray[np.float32]]:
        """Layers of the data set as channels of an `.exr`."""
        wanted = {name: self.image.aovs[name] for name in self.plan.spec.layers}
        if "category" in wanted:
            layer = wanted["category"].copy()
            layer[..., 0] = self.mask("category")
            wanted["category"] = layer
        channels = exr_channels(wanted)
        return channels | (amodal_channels(self.image.amodal) if self.plan.spec.amodal else {})

    @property
    def attributes(self) -> dict[str, str]:
        """What the header of an `.exr` says of the layers: names of mattes."""
        return matte_attributes(self.image.mattes)

    @cached_property
    def label_layers(self) -> list[str]:
        """The layers of labels among those of the data set."""
        return [name for name in self.plan.spec.layers if name in LABELS]

    @cached_property
    def seen(self) -> list[Seen]:
        """Its instances; of data sets with categories only those that have one."""
        labelling = Labelling.of(self.varied.scene)
        every = [self._seen(labelling, label.number) for label in self.image.labels.get("instance", ())]
        return [each for each in every if each.category is not None] if self.plan.categories else every

    def _seen(self, labelling: Labelling, number: int) -> Seen:
        label = next(each for each in self.image.labels["instance"] if each.number == number)
        entries = list(labelling.entries(number))
        name, scene = label.name, self.varied.moment
        shape = scene.shapes[entries[0][0]]
        model = shape.group if isinstance(shape, Instance) else name
        if len(entries) > 1:
            model, pose = name, self.varied.poses.get(name, affine(Transform()))
            if keys := self.varied.scene.shapes[entries[0][0]].motion:
                moved = rests(keys, *scene.camera.interval)
                assert moved is not None
                pose = combined(moved, pose)
        elif isinstance(shape, Instance):
            entry, turn = entries[0]
            rows = placements(scene, entry)[turn or 0].tolist()
            pose = affine(Transform(matrix=(*map(tuple, rows), (0.0, 0.0, 0.0, 1.0))))
        else:
            pose = affine(shape.transform)
        return Seen(number, name, label.category, label.area, label.whole_area, model, pose)

    def told(self, layers: Mapping[str, Any] | None = None) -> dict[str, Any]:
        """What it is, JSON-able: its camera, objects and what was drawn."""
        return {
            "image": self.varied.index,
            "camera": self.camera,
            "drawn": self.varied.drawn,
            "seed": self.varied.seed,
            "scene_sha256": self.varied.scene.sha256(),
            "linear_sha256": self.linear_sha256,
            **({"objects": [each.told() for each in self.seen]} if self.image.labels else {}),
            **({"categories": list(self.plan.categories)} if self.plan.categories else {}),
            **(layers or {}),
        }

    @property
    def camera(self) -> dict[str, Any]:
        """Its camera; see `clrender.datasets.views`."""
        return camera_told(self.varied.moment.camera, self.varied.size)


def box_of(mask: npt.NDArray[np.bool_]) -> list[int]:
    """The box of a mask: left, top, width, height; -1, -1, -1, -1 if it is empty, as BOP has it."""
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    if not len(rows):
        return [-1, -1, -1, -1]
    left, top = int(columns[0]), int(rows[0])
    return [left, top, int(columns[-1]) - left + 1, int(rows[-1]) - top + 1]
