"""Makes data sets: image by image, each complete or not there, by as many processes and machines as one likes."""

from __future__ import annotations

import hashlib
import shutil
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any

from clrender.datasets.files import ImageFiles
from clrender.datasets.records import MANIFEST, Records
from clrender.datasets.rendered import Rendered
from clrender.datasets.variation import DatasetPlan
from clrender.datasets.writers import WRITERS_BY_NAME
from clrender.errors import RenderError, UsageError
from clrender.files.access import atomic_write
from clrender.film.lock import FileLock
from clrender.rendering.session import Session
from clrender.rendering.telling import once

if TYPE_CHECKING:
    from clrender.device import Device

__all__ = ["DatasetProgress", "make_dataset", "merge_datasets", "produce"]


@dataclass(frozen=True)
class DatasetProgress:
    """Progress of a data set.

    Attributes
    ----------
    index : int
        The image that was just finished, or found.
    done, total : int
        Images of this call.
    rendered : int
        Those that were rendered; the others were there already.
    seconds : float
        Time since the begin of the call.
    missing : int or None
        At the end: images of the whole data set that are not there yet, and 0 if the manifest was written; else None.
    """

    index: int
    done: int
    total: int
    rendered: int
    seconds: float
    missing: int | None = None


def make_dataset(
    plan: DatasetPlan,
    folder: str | Path,
    *,
    images: range | None = None,
    device: str | int | Device | Sequence[str | int | Device] | None = None,
    on_progress: Callable[[DatasetProgress], None] | None = None,
    notify: Callable[[str], None] | None = None,
) -> DatasetProgress:
    """Render the images of a data set that are not there yet, and write its manifest when all are.

    Several processes may make parts of one data set in the same folder. A call that is killed leaves complete images
    only; the next one goes on.

    Parameters
    ----------
    plan : DatasetPlan
    folder : path
        It is created if it does not exist.
    images : range, optional
        Numbers of the images to make; default: all.
    device : str, int, Device, sequence of them, optional
        See `clrender.render`.
    on_progress : callable, optional
        Called after each image.
    notify : callable, optional
        Called with lines about devices and the scene, each once.

    Returns
    -------
    DatasetProgress
        Of the end.

    Raises
    ------
    UsageError
        The folder has images of another data set, or `images` are none of this one.
    SceneError, DeviceError, RenderError
        An image cannot be made or written; those before it are kept.
    """
    folder, begin = Path(folder), time.perf_counter()
    wanted = range(plan.spec.images) if images is None else images
    if wanted and not (wanted[0] >= 0 and wanted[-1] < plan.spec.images):
        raise UsageError(f"images {wanted[0]} to {wanted[-1]}: there are the images 0 to {plan.spec.images - 1}")
    _make_folder(folder)
    records, rendered = Records(plan, folder), 0
    records.refuse_others()
    progress = DatasetProgress(-1, 0, len(wanted), 0, 0.0)
    if notify is not None:
        for line in plan.warnings:
            notify(line)
    with Session(device, notify=once(notify)) as session:
        for done, index in enumerate(wanted, 1):
            if not records.proved(index):
                files = ImageFiles(folder)
                record = produce(plan, session, index, files)
                records.write(index, {**record, "written": files.written})
                rendered += 1
            progress = DatasetProgress(index, done, len(wanted), rendered, time.perf_counter() - begin)
            if on_progress is not None:
                on_progress(progress)
    missing = records.missing(wanted)
    if not missing:
        _finish(plan, records)
    seconds = time.perf_counter() - begin
    return DatasetProgress(progress.index, len(wanted), len(wanted), rendered, seconds, missing)


def produce(plan: DatasetPlan, session: Session, index: int, files: ImageFiles) -> dict[str, Any]:
    """Render an image and write its files.

    Parameters
    ----------
    plan : DatasetPlan
    session : Session
    index : int
    files : ImageFiles
        Where they go.

    Returns
    -------
    dict
        Its record, without the files on disk.
    """
    writers = {name: WRITERS_BY_NAME[name] for name in plan.spec.writers}
    layers = dict.fromkeys((*plan.spec.layers, *(layer for each in writers.values() for layer in each.layers)))
    amodal = plan.spec.amodal or any(each.amodal for each in writers.values())
    varied = plan.image(index)
    image = session.render(plan.job(varied, tuple(layers), amodal), keep_film=False)
    if image.interrupted:
        raise RenderError(f"image {index}: was stopped early; make the data set again, which goes on from here")
    rendered = Rendered(plan, varied, image)
    told = {name: writer.write(rendered, files) for name, writer in writers.items()}
    return {
        "scene_sha256": image.stats["scene_sha256"],
        "linear_sha256": rendered.linear_sha256,
        "pixels": files.pixels,
        "told": told,
    }


def merge_datasets(plan: DatasetPlan, folder: str | Path, others: Iterable[str | Path]) -> DatasetProgress:
    """Copy the images of parts of a data set that were made in other folders, and finish it if all are there.

    Parameters
    ----------
    plan : DatasetPlan
    folder : path
    others : iterable of path
        Images that are damaged are left out.

    Returns
    -------
    DatasetProgress
        `missing` says how many images lack.

    Raises
    ------
    UsageError
        A folder does not exist, or has images of another data set.
    """
    folder, begin = Path(folder), time.perf_counter()
    _make_folder(folder)
    records, copied, proved = Records(plan, folder), 0, set[int]()
    records.refuse_others()
    for other in map(Path, others):
        if not other.is_dir():
            raise UsageError(f"{other}: is no folder; name those in which parts of the data set were made")
        there = Records(plan, other)
        there.refuse_others()
        for index in range(plan.spec.images):
            record = None if index in proved else there.read(index)
            if record is None:
                continue
            if records.proved(index):
                proved.add(index)
                continue
            if not there.proved(index):
                continue
            for name in record["written"]:
                target = folder / name
                target.parent.mkdir(parents=True, exist_ok=True)
                data = there.part(record, name)
                with atomic_write(target) as file:
                    if data is not None:
                        file.write(data)
                    else:
                        with (other / name).open("rb") as source:
                            shutil.copyfileobj(source, file)
            records.write(index, {key: value for key, value in record.items() if key not in ("image", "key")})
            proved.add(index)
            copied += 1
    missing = records.missing(proved)
    if not missing:
        _finish(plan, records)
    total = plan.spec.images
    return DatasetProgress(total - 1, total - missing, total, copied, time.perf_counter() - begin, missing)


def _make_folder(folder: Path) -> None:
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise UsageError(f"{folder}: cannot be made ({error.strerror}); name a folder that can") from None


def _finish(plan: DatasetPlan, records: Records) -> None:
    """Write what is of the whole data set, of several processes one after the other."""
    lock = FileLock(records.folder / MANIFEST, "another process finishes the data set")
    lock.wait()
    try:
        _write_whole(plan, records)
    finally:
        lock.release()


def _write_whole(plan: DatasetPlan, records: Records) -> None:
    """Write archives, what writers say of all images, and the manifest last."""
    if "webdataset" in plan.spec.writers:
        records.make_archives()
    digests = dict[str, str]()
    for writer in plan.spec.writers:

        def told(writer: str = writer) -> Iterable[dict[str, Any]]:
            return ({"image": each["image"], "told": each["told"][writer]} for each in records.every())

        for name, write in WRITERS_BY_NAME[writer].summary(plan, told).items():
            path = records.folder / name
            path.parent.mkdir(parents=True, exist_ok=True)
            with atomic_write(path) as file:
                hashed = _Hashed(file)
                write(hashed)  # type: ignore[arg-type]  # it writes only
            digests[name] = hashed.digest.hexdigest()
    records.write_manifest(digests)


class _Hashed:
    """A file whose bytes are hashed while they are written."""

    def __init__(self, file: IO[bytes]) -> None:
        self._file, self.digest = file, hashlib.sha256()

    def write(self, data: bytes) -> int:
        self.digest.update(data)
        return self._file.write(data)
