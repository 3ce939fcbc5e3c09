"""The writer `bop`: poses, masks and depth as the benchmark for 6D object pose estimation has them (BOP, 2024).

Lengths are millimetres, cameras are those of OpenCV, and pixels count from the centre of the first one.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import IO, Any

import numpy as np
import numpy.typing as npt

from clrender.datasets.files import ImageFiles, json_bytes
from clrender.datasets.rendered import Rendered, Seen, box_of
from clrender.datasets.variation import DatasetPlan
from clrender.datasets.views import camera_pose, pinhole, refuse_camera
from clrender.datasets.writers.writer import Records
from clrender.errors import SceneError
from clrender.exact.matrices import inverse, lengths, product
from clrender.wording import quoted

__all__ = ["Bop"]

_FOLDER = "bop/train/000000"
_MILLIMETRES = 1000.0
_EVEN = 1e-6


class Bop:
    """``bop/train/000000`` with ``rgb``, ``depth``, ``mask``, ``mask_visib`` and the JSON files of a scene."""

    layers = ("instance", "z_depth")
    amodal = True

    def write(self, rendered: Rendered, files: ImageFiles) -> Any:
        """See `Writer`."""
        name, spec, camera = rendered.name, rendered.plan.spec, rendered.varied.moment.camera
        numbers = pinhole(camera, rendered.varied.size)
        if numbers is None or camera.type == "fisheye" or camera.distortion is not None or camera.mirrored:
            raise refuse_camera(camera, "bop", "describes cameras without distortion, and not this one")
        files.png(f"{_FOLDER}/rgb/{name}.png", rendered.picture)
        depth = rendered.image.aovs["z_depth"][..., 0].astype(np.float64) * (_MILLIMETRES / spec.depth_scale)
        known = np.isfinite(depth) & (depth >= 0.5) & (depth < 65535.5)
        files.png(f"{_FOLDER}/depth/{name}.png", np.rint(np.where(known, depth, 0.0)).astype(np.uint16))
        to_camera, visible = inverse(camera_pose(camera, "opencv")), rendered.mask("instance")
        objects = []
        for index, each in enumerate(rendered.seen):
            seen, whole = visible == each.number, rendered.image.amodal[each.number] >= 0.5
            whole = whole | seen
            for kind, mask in (("mask", whole), ("mask_visib", seen)):
                files.png(f"{_FOLDER}/{kind}/{name}_{index:06d}.png", mask.astype(np.uint8) * np.uint8(255))
            objects.append(_object(each, to_camera, seen, whole, known))
        matrix = [
            [numbers["fx"], numbers["skew"], numbers["cx"] - 0.5],
            [0.0, numbers["fy"], numbers["cy"] - 0.5],
            [0.0, 0.0, 1.0],
        ]
        told = {
            "cam_K": [each for row in matrix for each in row],
            "depth_scale": spec.depth_scale,
            "cam_R_w2c": [each for row in to_camera[:3, :3].tolist() for each in row],
            "cam_t_w2c": (to_camera[:3, 3] * _MILLIMETRES).tolist(),
        }
        return {"camera": told, "objects": objects}

    def summary(self, plan: DatasetPlan, records: Records) -> dict[str, Callable[[IO[bytes]], None]]:
        """See `Writer`."""
        models = {each["model"] for record in records() for each in record["told"]["objects"]}
        ids = {name: number for number, name in enumerate(sorted(models), 1)}

        def table(entry: Callable[[Mapping[str, Any]], Any]) -> Callable[[IO[bytes]], None]:
            def write(file: IO[bytes]) -> None:
                file.write(b"{")
                for number, record in enumerate(records()):
                    file.write(b",\n" if number else b"\n")
                    file.write(f'"{record["image"]}":'.encode() + json_bytes(entry(record["told"])).rstrip())
                file.write(b"\n}\n")

            return write

        def truth(told: Mapping[str, Any]) -> list[dict[str, Any]]:
            return [{**each["truth"], "obj_id": ids[each["model"]]} for each in told["objects"]]

        return {
            f"{_FOLDER}/scene_camera.json": table(lambda told: told["camera"]),
            f"{_FOLDER}/scene_gt.json": table(truth),
            f"{_FOLDER}/scene_gt_info.json": table(lambda told: [each["info"] for each in told["objects"]]),
            "bop/objects.json": lambda file: _write(file, {str(number): name for name, number in ids.items()}),
        }


def _write(file: IO[bytes], content: Any) -> None:
    file.write(json_bytes(content))


def _object(
    each: Seen,
    to_camera: npt.NDArray[np.float64],
    seen: npt.NDArray[np.bool_],
    whole: npt.NDArray[np.bool_],
    known: npt.NDArray[np.bool_],
) -> dict[str, Any]:
    """The true pose of an object, and counts of its pixels."""
    to_world = np.eye(4)
    to_world[:3, :3], to_world[:3, 3] = each.pose.linear, each.pose.offset
    pose = product(to_camera, to_world)
    sizes = lengths(pose[:3, :3].T)
    if np.abs(sizes - sizes[0]).max() > _EVEN * sizes[0] or each.pose.determinant < 0.0:
        text = "is scaled unevenly or mirrored, and BOP's poses are rotations; scale its model instead"
        raise SceneError(f"the writer bop: {quoted(each.name)} {text}")
    scale = float(sizes[0])
    truth: dict[str, Any] = {
        "cam_R_m2c": [number for row in (pose[:3, :3] / scale).tolist() for number in row],
        "cam_t_m2c": (pose[:3, 3] * _MILLIMETRES).tolist(),
    }
    if abs(scale - 1.0) > _EVEN:
        truth["scale"] = scale  # of its model: BOP itself has none
    all_pixels, visible = int(whole.sum()), int(seen.sum())
    info = {
        "bbox_obj": box_of(whole),
        "bbox_visib": box_of(seen),
        "px_count_all": all_pixels,
        "px_count_valid": int((whole & known).sum()),
        "px_count_visib": visible,
        "visib_fract": visible / all_pixels if all_pixels else 0.0,
    }
    return {"model": each.model, "truth": truth, "info": info}
