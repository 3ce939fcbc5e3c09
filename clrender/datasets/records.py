"""Records of finished images, by which they are proved, and the manifest of the whole data set."""

from __future__ import annotations

import hashlib
import itertools
import json
from collections.abc import Container, Iterator, Mapping
from contextlib import suppress
from pathlib import Path, PurePosixPath
from typing import IO, Any, Final

from clrender.datasets.files import json_bytes
from clrender.datasets.inputs import inputs_of
from clrender.datasets.variation import DatasetPlan
from clrender.datasets.writers.webdataset import END, archive_of
from clrender.errors import RenderError, UsageError
from clrender.files.access import atomic_write
from clrender.files.kernel_hash import kernels_sha256
from clrender.flatten.plugin_rows import plugin_hashes
from clrender.version import __version__

__all__ = ["FORMAT", "MANIFEST", "RECORDS", "Records", "file_sha256", "manifest_head"]

MANIFEST: Final = "manifest.json"
RECORDS: Final = "records"
FORMAT: Final = "clrender dataset 1"
_CHUNK: Final = 1 << 20
_PARTS: Final = {"scene_sha256": str, "linear_sha256": str, "pixels": dict}


def manifest_head(plan: DatasetPlan) -> dict[str, Any]:
    """What a manifest says of the whole data set."""
    plugins = plugin_hashes(plan.base.plugins)
    return {
        "format": FORMAT,
        "spec": plan.spec.content(),
        "spec_sha256": plan.spec.sha256(),
        "scene_sha256": plan.base.sha256(),
        "inputs": inputs_of(plan),
        "kernel_sha256": kernels_sha256(),
        "version": __version__,
        **({"plugins": plugins} if plugins else {}),
    }


class Records:
    """The records in a folder: one file an image, written when all of its other files are there.

    Parameters
    ----------
    plan : DatasetPlan
    folder : Path
        Of the data set.
    """

    def __init__(self, plan: DatasetPlan, folder: Path) -> None:
        self.plan, self.folder = plan, folder
        self.head = manifest_head(plan)
        self._key = hashlib.sha256(json_bytes(self.head)).hexdigest()
        self._sizes = dict[int, int]()  # of images in archives, so that each record is read once to find a place

    def refuse_others(self) -> None:
        """Refuse a folder with images of another data set: files of both would be in one folder.

        Raises
        ------
        UsageError
            It has a manifest or a record that is not of this data set, or a record of an image with another scene.
        SceneError
            That image cannot be drawn.
        """
        records = itertools.islice((self.folder / RECORDS).glob("*.json"), 1)
        for path, expected in ((self.folder / MANIFEST, self.head), *((each, {"key": self._key}) for each in records)):
            try:
                said = json.loads(path.read_bytes())
            except (OSError, ValueError):
                continue  # what is damaged is made again
            if not isinstance(said, dict):
                continue
            if any(said.get(key, value) != value for key, value in expected.items()) or self._has_other_scene(said):
                raise UsageError(
                    f"{self.folder}: has images of another data set, or by another version of clrender "
                    f"({path.relative_to(self.folder)}); name another folder, or delete this one"
                )

    def _has_other_scene(self, record: Mapping[str, Any]) -> bool:
        """Whether a record is of another scene than the one drawn for its image here. This renders nothing."""
        index, said = record.get("image"), record.get("scene_sha256")
        if not (isinstance(index, int) and 0 <= index < self.plan.spec.images):
            return False
        return said is not None and said != self.plan.image(index).scene.sha256()

    def path(self, index: int) -> Path:
        """The file of an image's record."""
        return self.folder / RECORDS / f"{index:06d}.json"

    def write(self, index: int, record: Mapping[str, Any]) -> None:
        """Write the record of an image."""
        path = self.path(index)
        path.parent.mkdir(parents=True, exist_ok=True)
        with atomic_write(path, durable=False) as file:
            file.write(json_bytes({**record, "image": index, "key": self._key}))
        self._sizes.pop(index, None)

    def read(self, index: int) -> dict[str, Any] | None:
        """The record of an image of this data set; None if there is none, or one of another data set."""
        try:
            record = json.loads(self.path(index).read_bytes())
        except (OSError, ValueError):
            return None
        sound = isinstance(record, dict) and record.get("key") == self._key and record.get("image") == index
        return record if sound and self._is_whole(record) else None

    def _is_whole(self, record: Mapping[str, Any]) -> bool:
        """Whether a record has all that is read of it; those of other folders may name any file."""
        written, told, writers = record.get("written"), record.get("told"), self.plan.spec.writers
        if not isinstance(written, dict) or not isinstance(told, dict) or set(told) != set(writers):
            return False
        if not all(isinstance(record.get(key), kind) for key, kind in _PARTS.items()):
            return False
        for name, entry in written.items():
            parts = PurePosixPath(name).parts
            if not parts or parts[0] not in writers or ".." in parts or not isinstance(entry, list) or len(entry) != 2:
                return False
        if "webdataset" not in told:
            return True
        stored = told["webdataset"]
        archive = archive_of(record["image"], self.plan.spec.images_per_shard)
        if not isinstance(stored, dict) or stored.get("archive") != archive or stored.get("part") not in written:
            return False
        return isinstance(stored.get("bytes"), int) and isinstance(stored.get("sha256"), str)

    def every(self) -> Iterator[dict[str, Any]]:
        """The records of all images, in order; those that are missing are left out."""
        for index in range(self.plan.spec.images):
            record = self.read(index)
            if record is not None:
                yield record

    def missing(self, proved: Container[int] = ()) -> int:
        """Number of images without a record; if all have one, of those whose files are not there or damaged.

        Parameters
        ----------
        proved : container of int
            Images whose files need not be read again.
        """
        every = range(self.plan.spec.images)
        unrecorded = sum(self.read(index) is None for index in every)
        return unrecorded or sum(index not in proved and not self.proved(index) for index in every)

    def proved(self, index: int) -> bool:
        """Whether an image is there: its record, and all files that it names with the bytes that it says."""
        record = self.read(index)
        if record is None:
            return False
        for name, (size, sha256) in record["written"].items():
            path, sound = self.folder / name, False
            with suppress(OSError):  # another process may just put it into an archive
                sound = path.is_file() and path.stat().st_size == size and file_sha256(path) == sha256
            if not sound and self.part(record, name) is None:
                return False
        return True

    def part(self, record: Mapping[str, Any], name: str) -> bytes | None:
        """An image's members of an archive, from their own file or from the archive; None if they are not there."""
        told = record["told"].get("webdataset")
        if told is None or told["part"] != name:
            return None
        with suppress(OSError):
            data = (self.folder / name).read_bytes()
            return data if hashlib.sha256(data).hexdigest() == told["sha256"] else None
        per_shard = self.plan.spec.images_per_shard
        begin = 0
        for index in range(record["image"] // per_shard * per_shard, record["image"]):
            if index not in self._sizes:
                before = self.read(index)
                if before is None:
                    return None
                self._sizes[index] = before["told"]["webdataset"]["bytes"]
            begin += self._sizes[index]
        with suppress(OSError), (self.folder / told["archive"]).open("rb") as file:
            file.seek(begin)
            data = file.read(told["bytes"])
            return data if hashlib.sha256(data).hexdigest() == told["sha256"] else None
        return None

    def make_archives(self) -> None:
        """Write the archives whose images are all there, and remove the files that they were made of."""
        spec = self.plan.spec
        for first in range(0, spec.images, spec.images_per_shard):
            indices = range(first, min(first + spec.images_per_shard, spec.images))
            path = self.folder / archive_of(first, spec.images_per_shard)
            told = [record["told"]["webdataset"] for index in indices if (record := self.read(index)) is not None]
            if len(told) < len(indices):
                continue
            parts = [self.folder / each["part"] for each in told]
            if any(part.is_file() for part in parts) or not path.is_file():
                if not all(part.is_file() for part in parts):
                    # Some of its images were made again: the others are still in the archive
                    self._unpacked(indices)
                lost = next((part for part in parts if not part.is_file()), None)
                if lost is not None:
                    raise RenderError(f"{lost}: is missing; make the data set again, which makes its image again")
                with atomic_write(path) as file:
                    for part in parts:
                        file.write(part.read_bytes())
                    file.write(END)
            for part in parts:
                part.unlink(missing_ok=True)
        with suppress(OSError):
            (self.folder / "webdataset" / "parts").rmdir()

    def _unpacked(self, indices: range) -> None:
        """Write the parts of an archive's images to files of their own again."""
        for index in indices:
            record = self.read(index)
            assert record is not None
            name = record["told"]["webdataset"]["part"]
            data = self.part(record, name)
            if data is not None and not (self.folder / name).is_file():
                (self.folder / name).parent.mkdir(parents=True, exist_ok=True)
                with atomic_write(self.folder / name) as file:
                    file.write(data)

    def write_manifest(self, summaries: Mapping[str, str]) -> Path:
        """Write the manifest: the same bytes for the same data set.

        Parameters
        ----------
        summaries : mapping of str to str
            SHA-256 of the files of the whole data set.

        Returns
        -------
        Path
        """
        path = self.folder / MANIFEST
        with atomic_write(path) as file:
            write_manifest(file, {**self.head, "files": dict(summaries)}, self.every())
        return path


def write_manifest(file: IO[bytes], head: Mapping[str, Any], records: Iterator[Mapping[str, Any]]) -> None:
    """Write a manifest, one image a line."""
    file.write(json.dumps(head, sort_keys=True, indent=1).encode()[:-2] + b',\n "images": [\n')
    for number, record in enumerate(records):
        kept = {key: record[key] for key in ("image", "scene_sha256", "linear_sha256", "pixels")}
        file.write((b",\n" if number else b"") + json_bytes(kept).rstrip())
    file.write(b"\n ]\n}\n")


def file_sha256(path: Path) -> str:
    """SHA-256 of a file, of any size."""
    digest = hashlib.sha256()
    with path.open("rb") as file:
        while data := file.read(_CHUNK):
            digest.update(data)
    return digest.hexdigest()
