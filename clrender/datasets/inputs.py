"""What the files of a data set depend on beside its description and the hash of its scene."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Mapping
from typing import Any

from clrender.datasets.files import json_bytes
from clrender.datasets.variation import DatasetPlan
from clrender.scene.content_hash import names_sha256

__all__ = ["inputs_of"]


def inputs_of(plan: DatasetPlan) -> dict[str, Any]:
    """What changes files of a data set, but neither its description nor the hash of its scene.

    Parameters
    ----------
    plan : DatasetPlan

    Returns
    -------
    dict
        JSON-able, equal for all parts of one data set. ``names_sha256``: of names and categories; and if there are
        any: ``exposure``, of the scene's camera; ``flow_step``, seconds; ``render``, the scene's settings that the
        description leaves to it; ``cameras_sha256``, of those of its file of cameras; ``files``, SHA-256 by name of
        the files that only `[vary]` names.
    """
    base, spec = plan.base, plan.spec
    own = base.render.model_dump(mode="json", exclude_defaults=True)
    settings = {name: value for name, value in own.items() if name not in spec.render and name != "seed"}
    cameras = [[name, camera.model_dump(mode="json")] for name, camera in plan.cameras]
    files = {name: digest for name in sorted({*_texts(spec.vary)}) if (digest := base.file_sha256(name)) is not None}
    optional = {
        "exposure": base.camera.exposure,
        "flow_step": base.camera.flow_step,
        "render": settings,
        "cameras_sha256": hashlib.sha256(json_bytes(cameras)).hexdigest() if cameras else None,
        "files": files,
    }
    return {"names_sha256": names_sha256(base), **{name: value for name, value in optional.items() if value}}


def _texts(value: Any) -> Iterator[str]:
    """The texts in a value, any of which may name a file."""
    if isinstance(value, str):
        yield value
    elif isinstance(value, Mapping):
        for each in value.values():
            yield from _texts(each)
    elif isinstance(value, list | tuple):
        for each in value:
            yield from _texts(each)
