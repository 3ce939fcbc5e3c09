"""Verifies data sets: every file against the manifest, and some images rendered again, bit for bit."""

from __future__ import annotations

import hashlib
import math
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from numbers import Integral, Real
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from clrender.datasets.files import ImageFiles, read_json
from clrender.datasets.making import produce
from clrender.datasets.records import FORMAT, MANIFEST, manifest_head
from clrender.datasets.spec import Spec
from clrender.datasets.stored import StoredFiles
from clrender.datasets.variation import DatasetPlan
from clrender.errors import UsageError
from clrender.plugins import Plugin, as_plugins
from clrender.rendering.session import Session
from clrender.rendering.telling import once
from clrender.scene import builtin_names
from clrender.verification.checking import check_plugins
from clrender.verification.confidence import SampledCheck
from clrender.wording import counted

if TYPE_CHECKING:
    from clrender.device import Device

__all__ = ["DatasetVerification", "verify_dataset"]

_HASHES: Final = ("scene_sha256", "linear_sha256")
_INPUTS: Final = {
    "names_sha256": "names or categories in the scene",
    "exposure": "exposure of the camera (f_stop, shutter, iso)",
    "flow_step": "flow_step of the camera",
    "render": "settings in the scene's table render",
    "cameras_sha256": "cameras in camera.file",
    "files": "files that only [vary] names",
}
"""What each of the inputs of a manifest is in messages."""


@dataclass(frozen=True)
class DatasetVerification(SampledCheck):
    """Result of the verification of a data set.

    Attributes
    ----------
    images : int
        Images of the data set; the files of all of them were compared with its manifest.
    files : int
        Files, and members of stored, that were compared.
    checked : int
        Images that were rendered again.
    faults : tuple of str
        Sentences about what is wrong; empty if nothing is.
    """

    images: int
    files: int
    checked: int
    faults: tuple[str, ...]

    @property
    def parts(self) -> int:
        """Number of images: those whose manifest is wrong as well are found by rendering them only."""
        return self.images


def verify_dataset(
    folder: str | Path,
    fraction: float = 0.1,
    *,
    sample: int | None = None,
    scene: str | Path | None = None,
    allow_paths: Sequence[str | Path] = (),
    plugins: Any = None,
    device: str | int | Device | Sequence[str | int | Device] | None = None,
    seed: int | None = None,
    on_progress: Callable[[int, int], None] | None = None,
    notify: Callable[[str], None] | None = None,
) -> DatasetVerification:
    """Compare all files of a data set with its manifest, and render some of its images again.

    Parameters
    ----------
    folder : path
        Of the data set.
    fraction : float
        Fraction of the images to render again, above 0 and at most 1; at least one is.
    sample : int, optional
        Their number instead.
    scene : path, optional
        The data set's scene; by default the one that it names, from the working folder, the data set's folder or the
        one around it.
    allow_paths, plugins
        See `clrender.load`; a manifest never names where plugins are.
    device : str, int, Device, sequence of them, optional
        See `clrender.render`; any device will do.
    seed : int, optional
        Seed of the choice of images; by default unpredictable.
    on_progress : callable, optional
        Called with the number of images rendered again, and of all that will be.
    notify : callable, optional
        See `make_dataset`.

    Returns
    -------
    DatasetVerification

    Raises
    ------
    UsageError
        There is no manifest, its scene or a plugin is missing or another one, or it was made by other kernels.
    SceneError, DeviceError, RenderError
        See `clrender.render`.
    """
    folder = Path(folder)
    manifest = _manifest(folder)
    spec = Spec.of(manifest["spec"], f"{folder / MANIFEST}: spec")
    images: list[Mapping[str, Any]] = manifest["images"]
    count = _count(len(images), fraction, sample)
    faults = _contradictions(manifest, spec, images)
    files, damaged, found = _files_checked(folder, manifest, images)
    faults += found
    chosen = np.random.default_rng(seed).choice(len(images), count, replace=False).tolist() if images else []
    again = sorted({*chosen, *damaged})
    plan = _plan(folder, manifest, spec, scene, allow_paths, as_plugins(plugins))
    with Session(device, notify=once(notify)) as session:
        for number, index in enumerate(again, 1):
            made = ImageFiles(None, keep=index in damaged)
            record = produce(plan, session, index, made)
            faults += _differences(index, images[index], record)
            for name in damaged.get(index, ()):
                faults.append(StoredFiles(folder).difference(name, made.arrays.get(name)))
            if on_progress is not None:
                on_progress(number, len(again))
    return DatasetVerification(len(images), files, len(again), tuple(faults))


def _manifest(folder: Path) -> dict[str, Any]:
    path = folder / MANIFEST
    if not path.is_file():
        cure = "finish the data set with `clrender dataset`"
        raise UsageError(f"{folder}: has no {MANIFEST}, which is written when all images are there; {cure}")
    manifest = read_json(path)
    keys = ("spec", "spec_sha256", "scene_sha256", "kernel_sha256", "version", "files", "images")
    if not isinstance(manifest, dict) or manifest.get("format") != FORMAT or any(key not in manifest for key in keys):
        raise UsageError(f"{path}: is no manifest of the format {FORMAT!r}; make the data set again")
    sound = isinstance(manifest["images"], list) and isinstance(manifest["files"], dict)
    sound = sound and all(_is_image(each, number) for number, each in enumerate(manifest["images"]))
    if not sound:
        raise UsageError(f"{path}: its images are not numbered, or lack their hashes; make the data set again")
    return manifest


def _is_image(entry: Any, number: int) -> bool:
    sound = isinstance(entry, dict) and entry.get("image") == number and isinstance(entry.get("pixels"), dict)
    return sound and all(key in entry for key in _HASHES)


def _count(images: int, fraction: object, sample: object) -> int:
    """Number of images to render again."""
    if sample is None:
        if not (isinstance(fraction, Real) and 0.0 < float(fraction) <= 1.0):
            raise UsageError(f"fraction is {fraction}; it must be above 0 and at most 1")
        return min(images, math.ceil(float(fraction) * images))
    if not isinstance(sample, Integral) or isinstance(sample, bool) or sample < 1:
        raise UsageError(f"sample is {sample!r}; it must be a whole number of at least 1")
    return min(images, int(sample))


def _contradictions(manifest: Mapping[str, Any], spec: Spec, images: Sequence[Mapping[str, Any]]) -> list[str]:
    faults = []
    if manifest["spec_sha256"] != spec.sha256():
        faults.append(f"{MANIFEST}: the hash of the description does not match its spec_sha256")
    if len(images) != spec.images:
        faults.append(f"{MANIFEST}: has {counted(len(images), 'image')}, but the description says {spec.images}")
    return faults


def _files_checked(
    folder: Path, manifest: Mapping[str, Any], images: Sequence[Mapping[str, Any]]
) -> tuple[int, dict[int, list[str]], list[str]]:
    """Number of files compared, those of each image that differ, and sentences about those of the whole set."""
    count, damaged, faults = 0, dict[int, list[str]](), list[str]()
    stored = StoredFiles(folder)
    for name, sha256 in manifest["files"].items():
        count += 1
        data = stored.bytes_of(name)
        if data is None:
            faults.append(f"{name}: is missing")
        elif hashlib.sha256(data).hexdigest() != sha256:
            faults.append(f"{name}: its bytes are not those of the manifest")
    for index, image in enumerate(images):
        for name, sha256 in image["pixels"].items():
            count += 1
            if stored.pixels_sha256(name) != sha256:
                damaged.setdefault(index, []).append(name)
    archives = Counter(name.partition("#")[0] for image in images for name in image["pixels"] if "#" in name)
    for name, members in archives.items():
        if stored.has_more(name, members):
            faults.append(f"{name}: has other members than the manifest says, or bytes behind its end")
    return count, damaged, faults


def _plan(
    folder: Path,
    manifest: Mapping[str, Any],
    spec: Spec,
    scene: str | Path | None,
    allow_paths: Sequence[str | Path],
    plugins: Sequence[Plugin],
) -> DatasetPlan:
    """The data set's plan, with the scene that it was made from."""
    named = [spec.camera.file] if spec.camera.file is not None else []
    named += [spec.load.environment] if isinstance(spec.load.environment, str) else []
    named += [spec.scene] if scene is None and spec.scene not in builtin_names() else []
    base = next(
        (each for each in (Path(), folder, folder.parent) if all((each / name).exists() for name in named)), None
    )
    if base is None:
        what = ", ".join(named)
        raise UsageError(
            f"{folder}: was made from {what}, not found here; go to the folder with it, or name the scene with --scene"
        )
    check_plugins(str(folder), manifest.get("plugins", {}), plugins)
    plan = DatasetPlan.of(spec, str(folder / MANIFEST), base, scene, allow_paths, plugins)
    here = manifest_head(plan)
    if here["scene_sha256"] != manifest["scene_sha256"]:
        raise UsageError(
            f"{folder}: was made from another scene, or the scene has changed since; name the original with --scene"
        )
    # Manifests of former versions do not say what else their files depend on
    said = manifest.get("inputs", here["inputs"])
    if said != here["inputs"]:
        told = said if isinstance(said, dict) else {}
        differing = sorted(key for key in {*told, *here["inputs"]} if told.get(key) != here["inputs"].get(key))
        what = ", ".join(_INPUTS[key] for key in differing if key in _INPUTS) or "inputs"
        raise UsageError(f"{folder}: was made with other {what} than those found here; restore the original ones")
    for key in ("kernel_sha256", "version"):
        if here[key] != manifest[key]:
            raise UsageError(
                f"{folder}: was made by the kernels of clrender {manifest['version']}; those of this clrender, "
                f"{here['version']}, may give other bits: verify it with the original version"
            )
    return plan


def _differences(index: int, said: Mapping[str, Any], made: Mapping[str, Any]) -> Iterator[str]:
    """Sentences about an image that was rendered again and is not what the manifest says."""
    if said["scene_sha256"] != made["scene_sha256"]:
        yield f"image {index}: its scene is not that of the manifest"
    names = [
        name for name in {**said["pixels"], **made["pixels"]} if said["pixels"].get(name) != made["pixels"].get(name)
    ]
    if said["linear_sha256"] != made["linear_sha256"] or names:
        which = f" ({', '.join(sorted(names)[:4])})" if names else ""
        yield f"image {index}: rendered again, it is not what the manifest says{which}"
