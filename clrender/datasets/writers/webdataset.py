"""The writer `webdataset`: images in archives that training programs read in one go, with the same bytes each time."""

from __future__ import annotations

import hashlib
import io
import tarfile
from collections.abc import Callable, Mapping
from typing import IO, Any

import numpy as np

from clrender.datasets.files import ImageFiles, json_bytes, png_of
from clrender.datasets.rendered import Rendered
from clrender.datasets.variation import DatasetPlan
from clrender.datasets.writers.images import mask_pixels
from clrender.datasets.writers.writer import Records

__all__ = ["END", "WebDataset", "archive_of", "part_of"]

END = bytes(1024)
"""What ends an archive."""


def archive_of(index: int, images_per_shard: int) -> str:
    """Name of the archive that holds an image."""
    return f"webdataset/data-{index // images_per_shard:06d}.tar"


def part_of(name: str) -> str:
    """Name of the file of one image's members, until all of its archive are there."""
    return f"webdataset/parts/{name}.tar"


class WebDataset:
    """``webdataset/data-NUMBER.tar`` with ``NUMBER.png``, ``.json`` and ``.LAYER.png`` of each image.

    The members of an image are written to a file of their own first; an archive is these files one after the other.
    """

    layers = ()
    amodal = False

    def write(self, rendered: Rendered, files: ImageFiles) -> Any:
        """See `Writer`."""
        name, archive = rendered.name, archive_of(rendered.varied.index, rendered.plan.spec.images_per_shard)
        pictures = {f"{name}.png": rendered.picture}
        pictures |= {f"{name}.{layer}.png": mask_pixels(rendered, layer) for layer in rendered.label_layers}
        told = json_bytes(rendered.told())
        members = {f"{name}.json": told} | {member: png_of(pixels) for member, pixels in pictures.items()}
        for member, pixels in pictures.items():
            files.note(f"{archive}#{member}", {"": pixels})
        files.note(f"{archive}#{name}.json", {"": np.frombuffer(told, np.uint8)})
        data = _archived(members)
        files.put(part_of(name), data)
        # Its place in the archive is known from those before it
        return {
            "part": part_of(name),
            "archive": archive,
            "bytes": len(data),
            "sha256": hashlib.sha256(data).hexdigest(),
        }

    def summary(self, plan: DatasetPlan, records: Records) -> dict[str, Callable[[IO[bytes]], None]]:
        """See `Writer`: archives are made by `clrender.datasets.archives`."""
        return {}


def _archived(members: Mapping[str, bytes]) -> bytes:
    """Members of an archive, sorted, without what ends it, and without owners and times."""
    file = io.BytesIO()
    for name in sorted(members):
        member = tarfile.TarInfo(name)
        member.size, member.mode, member.mtime = len(members[name]), 0o644, 0
        file.write(member.tobuf(tarfile.USTAR_FORMAT))
        file.write(members[name])
        file.write(bytes(-len(members[name]) % 512))
    return file.getvalue()
