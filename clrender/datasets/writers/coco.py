"""The writer `coco`: pictures, and annotations of instances with masks as run lengths (cocodataset.org)."""

from __future__ import annotations

import itertools
import json
from collections.abc import Callable, Iterator
from typing import IO, Any, Final

import numpy as np
import numpy.typing as npt

from clrender.datasets.files import ImageFiles
from clrender.datasets.rendered import Rendered, box_of
from clrender.datasets.variation import DatasetPlan
from clrender.datasets.writers.writer import Records

__all__ = ["Coco", "run_lengths"]

_OTHERS: Final = "object"
"""Category of everything, in data sets without categories."""


def run_lengths(mask: npt.NDArray[np.bool_]) -> str:
    """A mask as COCO's compressed run lengths.

    Columns from left to right, each from top to bottom: alternating counts of pixels outside and inside. From the third
    on, the difference from the one before the last is stored: five bits a character from 48 on, the lowest first,
    followed by others where the sixth bit is set.

    Parameters
    ----------
    mask : (H, W) bool
    """
    flat = np.concatenate([[False], mask.T.reshape(-1)])
    changes = np.flatnonzero(flat[1:] != flat[:-1])
    counts = np.diff(np.concatenate([[0], changes, [mask.size]])).tolist()
    characters = []
    for index, count in enumerate(counts):
        number = count - counts[index - 2] if index > 2 else count
        more = True
        while more:
            bits = number & 31
            number >>= 5
            more = number != (-1 if bits & 16 else 0)
            characters.append(chr(48 + (bits | 32 if more else bits)))
    return "".join(characters)


class Coco:
    """``coco/images/NUMBER.png`` and ``coco/annotations.json``."""

    layers = ("instance",)
    amodal = False

    def write(self, rendered: Rendered, files: ImageFiles) -> Any:
        """See `Writer`."""
        files.png(f"coco/images/{rendered.name}.png", rendered.picture)
        numbers, annotations = rendered.mask("instance"), []
        for each in rendered.seen:
            mask = numbers == each.number
            if not mask.any():
                continue
            annotation = {
                "category": each.category or _OTHERS,
                "segmentation": {"size": list(mask.shape), "counts": run_lengths(mask)},
                "bbox": box_of(mask),
                "area": int(mask.sum()),
                "iscrowd": 0,
                "name": each.name,
                "number": each.number,
            }
            if each.whole_area is not None:
                annotation["visibility"] = min(1.0, each.area / each.whole_area) if each.whole_area else 0.0
            annotations.append(annotation)
        width, height = rendered.varied.size
        return {
            "file_name": f"images/{rendered.name}.png",
            "width": width,
            "height": height,
            "annotations": annotations,
        }

    def summary(self, plan: DatasetPlan, records: Records) -> dict[str, Callable[[IO[bytes]], None]]:
        """See `Writer`."""
        names = plan.categories or (_OTHERS,)
        categories = {name: number for number, name in enumerate(names, 1)}

        def write(file: IO[bytes]) -> None:
            told = [{"id": number, "name": name, "supercategory": name} for name, number in categories.items()]
            file.write(b'{"categories":' + _dumped(told) + b',\n"images":[\n')
            _listed(file, (_image(record) for record in records()))
            file.write(b'],\n"annotations":[\n')
            _listed(file, self._annotations(records, categories))
            file.write(b"]}\n")

        return {"coco/annotations.json": write}

    def _annotations(self, records: Records, categories: dict[str, int]) -> Iterator[dict[str, Any]]:
        ids = itertools.count(1)
        for record in records():
            for annotation in record["told"]["annotations"]:
                number = categories[annotation["category"]]
                others = {key: value for key, value in annotation.items() if key != "category"}
                yield {"id": next(ids), "image_id": record["image"], "category_id": number, **others}


def _image(record: Any) -> dict[str, Any]:
    return {"id": record["image"], **{key: record["told"][key] for key in ("file_name", "width", "height")}}


def _dumped(content: Any) -> bytes:
    return json.dumps(content, sort_keys=True, separators=(",", ":")).encode()


def _listed(file: IO[bytes], contents: Iterator[dict[str, Any]]) -> None:
    """Write the entries of a list, one a line."""
    for number, content in enumerate(contents):
        file.write((b",\n" if number else b"") + _dumped(content))
