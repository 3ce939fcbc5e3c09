"""Writers of data sets: what each needs of an image, the files that it writes of it, and those of the whole set."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from clrender.datasets.writers.bop import Bop
from clrender.datasets.writers.coco import Coco
from clrender.datasets.writers.images import Images
from clrender.datasets.writers.transforms import Transforms
from clrender.datasets.writers.webdataset import WebDataset
from clrender.datasets.writers.writer import Writer

__all__ = ["WRITERS_BY_NAME", "Writer"]

WRITERS_BY_NAME: Final[Mapping[str, Writer]] = {
    "images": Images(),
    "coco": Coco(),
    "bop": Bop(),
    "transforms": Transforms(),
    "webdataset": WebDataset(),
}
"""Every writer."""
