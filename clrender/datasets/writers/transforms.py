"""The writer `transforms`: pictures with their cameras as NeRF, instant-ngp and nerfstudio read them."""

from __future__ import annotations

import json
from collections.abc import Callable
from typing import IO, Any

from clrender.datasets.files import ImageFiles
from clrender.datasets.rendered import Rendered
from clrender.datasets.variation import DatasetPlan
from clrender.datasets.views import camera_pose, pinhole, refuse_camera
from clrender.datasets.writers.writer import Records
from clrender.scene import Camera

__all__ = ["Transforms"]


class Transforms:
    """``transforms/images/NUMBER.png`` and ``transforms/transforms.json``."""

    layers = ()
    amodal = False

    def write(self, rendered: Rendered, files: ImageFiles) -> Any:
        """See `Writer`."""
        camera = rendered.varied.moment.camera
        frame = _lens(camera, rendered.varied.size)
        files.png(f"transforms/images/{rendered.name}.png", rendered.picture)
        return {
            "file_path": f"images/{rendered.name}.png",
            **frame,
            "transform_matrix": camera_pose(camera, "opengl").tolist(),
        }

    def summary(self, plan: DatasetPlan, records: Records) -> dict[str, Callable[[IO[bytes]], None]]:
        """See `Writer`."""

        def write(file: IO[bytes]) -> None:
            file.write(b'{"frames":[')
            for number, record in enumerate(records()):
                line = json.dumps(record["told"], sort_keys=True, separators=(",", ":")).encode()
                file.write((b",\n" if number else b"\n") + line)
            file.write(b"\n]}\n")

        return {"transforms/transforms.json": write}


def _lens(camera: Camera, size: tuple[int, int]) -> dict[str, Any]:
    """Projection of a frame, by the names of nerfstudio."""
    width, height = size
    if camera.type == "panoramic":
        return {"camera_model": "EQUIRECTANGULAR", "w": width, "h": height}
    numbers = pinhole(camera, size)
    if numbers is None or numbers["skew"] or camera.mirrored:
        raise refuse_camera(camera, "transforms", "describes no parallel, skewed or mirrored cameras, such as this one")
    found: dict[str, Any] = {"w": width, "h": height, "fl_x": numbers["fx"], "fl_y": numbers["fy"]}
    found |= {"cx": numbers["cx"], "cy": numbers["cy"], "camera_model": "OPENCV"}
    distortion = camera.distortion
    if camera.type == "fisheye":
        return {**found, "camera_model": "OPENCV_FISHEYE", **dict.fromkeys(("k1", "k2", "k3", "k4"), 0.0)}
    if distortion is None:
        return found
    fisheye = distortion.model == "kannala-brandt"
    k = [*distortion.k, *[0.0] * 6]
    if not fisheye and any(k[3:6]):
        raise refuse_camera(camera, "transforms", "knows radial terms k1 to k3 only, and not this camera's")
    terms = {f"k{n}": k[n - 1] for n in range(1, 5 if fisheye else 4)}
    if fisheye:
        return {**found, "camera_model": "OPENCV_FISHEYE", **terms}
    return {**found, **terms, "p1": distortion.p[0], "p2": distortion.p[1]}
