"""Converts the lights of UsdLux: those with an area become shapes that shine."""

from __future__ import annotations

import dataclasses
import io
import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np

from clrender.errors import SceneError, UsageError
from clrender.exact.angles import power_of_two, root, sin_cos_degrees
from clrender.exact.matrices import determinant, length, product
from clrender.files.named import allowed_file
from clrender.image.files import read_open_image
from clrender.importers.asset_files import AssetFiles
from clrender.importers.draft import Draft
from clrender.importers.shared.matrices import Matrix, inverse, is_affine, is_similarity, rotation, transform_key
from clrender.importers.shared.meshes import cylinder_mesh, disk_mesh, sphere_mesh
from clrender.importers.shared.motions import fault_of_motion, light_motion, motion_keys
from clrender.importers.shared.sky_maps import turn_about_y, turned_pixels
from clrender.importers.usd.textures import packaged_file, scene_name
from clrender.meshes.data import MeshData
from clrender.scene.environment import EnvironmentPicture
from clrender.wording import quoted

__all__ = ["Lights", "radiance_of"]

_LUMENS_PER_WATT: Final = 683.0
_MOST: Final = 1e12
_PIXEL_LIMIT: Final = 2**28
_ALL_AROUND: Final = {"SphereLight": 180.0, "CylinderLight": 180.0}
"""Cone angles that shape nothing, degrees; of others 90."""
_CHANGED: Final = 1.0 + 1e-6
"""Ratio of volumes above which a light changes its size."""
_MAPS: Final = ("automatic", "latlong", None)


def radiance_of(light: dict[str, Any]) -> list[float]:
    """Colour times intensity, exposure and colour temperature: the radiance of a light that is not normalised."""
    strength = float(light.get("intensity") or 0.0) * power_of_two(
        min(max(float(light.get("exposure") or 0.0), -900), 900)
    )
    color = light.get("color") or [1.0] * 3
    body = light.get("blackbody") or [1.0] * 3
    found = [strength * x * float(f"{b:.6g}") for x, b in zip(color, body, strict=True)]
    return [min(max(x, 0.0), _MOST) if math.isfinite(x) else 0.0 for x in found]


class Lights:
    """Adds lights to a draft.

    Parameters
    ----------
    draft : Draft
    files : AssetFiles
    meters : float
        Length of the stage's unit: areas and distances count in these.
    """

    def __init__(self, draft: Draft, files: AssetFiles, meters: float) -> None:
        self._draft, self._files, self._meters = draft, files, meters
        self._domes = 0

    def add(self, light: dict[str, Any], matrix: Matrix, keys: Sequence[tuple[float, Matrix]] = ()) -> None:
        """Add a light.

        Parameters
        ----------
        light : dict
            See `clrender.importers.usd.networks.Networks.light`.
        matrix : (4, 4) float64
            From its space to world space.
        keys : sequence of (float, (4, 4) float64)
            The same at the times of its motion, seconds.
        """
        place = quoted(light["path"])
        if not is_affine(matrix):
            text = f"{place} has a transform that cannot be inverted; give it another"
            self._draft.leave_out(SceneError(f"{self._files.source}: {text}"), self._files.source, self._files.strict)
            return
        self.note_extras(light)
        color = radiance_of(light)
        kind = light["type"]
        lights, shapes = self._draft.description["lights"], self._draft.description["shapes"]
        before = len(lights), len(shapes)
        # How bright it is follows from its size, which may be nothing at the time of the image
        largest = max([matrix, *(each for _, each in keys)], key=_volume)
        changes = _volume(largest) > _CHANGED * min(_volume(each) for each in (matrix, *(each for _, each in keys)))
        matrix = largest if changes else matrix
        if kind.startswith("DomeLight"):
            self._dome(light, matrix, color)
        elif kind == "DistantLight":
            self._distant(light, matrix, color)
        else:
            self._area(light, matrix, color)
        if keys:
            self._move(light, matrix, keys, lights[before[0] :], shapes[before[1] :])
        sized = kind != "DistantLight" and not kind.startswith("DomeLight")
        if changes and sized and (light.get("normalize") or len(lights) > before[0]):
            self._draft.note(f"{place} changes its size while the shutter is open, and is as bright as at its largest")

    def _move(
        self,
        light: dict[str, Any],
        matrix: Matrix,
        keys: Sequence[tuple[float, Matrix]],
        lights: list[dict[str, Any]],
        shapes: list[dict[str, Any]],
    ) -> None:
        """Give a light, or the shape that shines in its place, the keys of its motion, if it can follow them."""
        fault = ""
        for made in lights:
            if made["type"] == "environment":
                fault = "it is all around"
            else:
                made["motion"] = light_motion(matrix, keys)
        for made in shapes:
            fault = fault_of_motion(made["type"], [each for _, each in keys])
            if not fault:
                # What its transform does before that of the light, such as to turn a cylinder, stays
                back = inverse(matrix)
                made["motion"] = motion_keys([(time, product(each, back)) for time, each in keys])
        if fault:
            self._draft.note(f"{quoted(light['path'])} rests while the shutter is open: {fault}")

    def note_extras(self, light: dict[str, Any]) -> None:
        """Note what is not read of a light."""
        place = quoted(light["path"])
        if any(light.get(name) not in (None, 1.0) for name in ("diffuse", "specular")):
            self._draft.note(f"{place}: diffuse and specular were left out: light is light")
        if light.get("linked"):
            self._draft.note(f"{place} lights everything: light linking is not read")
        if light.get("filtered"):
            self._draft.note(f"{place}: its filters were left out")
        if light.get("shadow:enable") is False:
            self._draft.note(f"{place} has shadows, though its shadow:enable is false")

    def _distant(self, light: dict[str, Any], matrix: Matrix, color: list[float]) -> None:
        angle = min(max(float(light.get("angle") or 0.0), 0.0), 180.0)
        sine, _ = sin_cos_degrees(angle / 2.0)
        if angle > 0.0:
            self._draft.note(f"{quoted(light['path'])}: its light is parallel, not from an angle of {angle:g} degrees")
        share = 1.0 if light.get("normalize") or angle == 0.0 else math.pi * sine * sine
        direction = [-float(x) for x in matrix[:3, 2]]
        irradiance = [x * share for x in color]
        self._draft.description["lights"].append(
            {"type": "directional", "direction": direction, "irradiance": irradiance}
        )

    def _dome(self, light: dict[str, Any], matrix: Matrix, color: list[float]) -> None:
        place = quoted(light["path"])
        self._domes += 1
        if self._domes > 1:
            self._draft.note(f"{place} was left out: a scene has one environment, and there is one already")
            return
        lights = self._draft.description["lights"]
        asset = light.get("texture:file")
        if not asset:
            lights.append({"type": "environment", "radiance": color})
            return
        if light.get("texture:format") not in _MAPS:
            self._draft.note(
                f"{place}: a map in the format {quoted(light['texture:format'])} is not read: an even light"
            )
            lights.append({"type": "environment", "radiance": color})
            return
        if light.get("pole") == "Z" or (light.get("pole") == "scene" and light["up"] == "Z"):
            matrix = product(matrix, rotation((1.0, 0.0, 0.0), 90.0))
        name, picture = self._map(asset, place)
        turn = turn_about_y(matrix)
        if turn is None:
            picture = turned_pixels(self._read(name, picture, place).pixels, matrix, f"{self._files.source}: {place}")
            name, turn = f"{name} (turned)", 0.0
        if picture is not None:
            self._draft.environments[name] = picture
        lights.append(
            {"type": "environment", "file": name, "scale": color, **({"rotate_degrees": turn} if turn else {})}
        )

    def _map(self, asset: list[str], place: str) -> tuple[str, EnvironmentPicture | None]:
        """Name of an environment map in the draft, and its content if it is in a package."""
        name = scene_name(self._files, asset[1])
        if not asset[1].endswith("]"):
            return name, None
        data, label = packaged_file(self._files, asset[1], place), f"{self._files.source}: {place}"
        try:
            pixels = read_open_image(
                io.BytesIO(data), Path(asset[1][:-1]).suffix.lower(), f"{label} is not readable", _PIXEL_LIMIT
            )
        except UsageError as error:
            raise SceneError(str(error).rstrip(".")) from None
        return name, EnvironmentPicture.checked(pixels, label)

    def _read(self, name: str, picture: EnvironmentPicture | None, place: str) -> EnvironmentPicture:
        if picture is not None:
            return picture
        files = self._files
        return EnvironmentPicture.read(name, files.folder, files.allow_paths, f"{files.source}: {place}")

    def _area(self, light: dict[str, Any], matrix: Matrix, color: list[float]) -> None:
        kind, place = light["type"], quoted(light["path"])
        x, y, z = (length(matrix[:3, axis]) / self._meters for axis in range(3))
        radius, width = float(light.get("radius") or 0.0), float(light.get("width") or 0.0)
        height, long = float(light.get("height") or 0.0), float(light.get("length") or 0.0)
        across = float(np.float64(length(np.cross(matrix[:3, 0], matrix[:3, 1])))) / (self._meters * self._meters)
        # Area that shines, and area that is seen along the axis, in units of the stage
        if kind == "SphereLight":
            size = x if is_similarity(matrix) else root(x * y * z, 3)
            area = 4.0 * math.pi * radius * radius * size * size
            seen = area / 4.0
        elif kind == "RectLight":
            area = seen = width * height * across
        elif kind == "DiskLight":
            area = seen = math.pi * radius * radius * across
        else:
            area = 2.0 * math.pi * radius * y * long * x
            seen = 2.0 * radius * y * long * x
        normalized = bool(light.get("normalize"))
        pointed = light.get("point") or (kind == "SphereLight" and radius == 0.0)
        if area == 0.0 and not pointed:
            self._draft.note(f"{place} was left out: it has no area")
            return
        meters = self._meters * self._meters
        if area == 0.0:
            if not normalized:
                self._draft.note(f"{place} has no radius: its intensity is that of a light that is normalised")
            power = meters / (4.0 if kind == "SphereLight" else math.pi)
        else:
            power = seen * meters / (area if normalized else 1.0)
        cone = light.get("shaping:cone:angle")
        shaped = cone is not None and float(cone) < _ALL_AROUND.get(kind, 90.0)
        if shaped or light.get("shaping:ies:file") or (light.get("shaping:focus") or 0.0) > 0.0:
            self._shaped(light, matrix, [x * power for x in color])
        elif pointed and kind == "SphereLight":
            position = [float(x) for x in matrix[:3, 3]]
            intensity = [x * power for x in color]
            self._draft.description["lights"].append({"type": "point", "position": position, "intensity": intensity})
        else:
            self._shape(light, matrix, [x / (area if normalized else 1.0) for x in color])

    def _shaped(self, light: dict[str, Any], matrix: Matrix, intensity: list[float]) -> None:
        """A light whose directions are limited, without extent."""
        place, lights = quoted(light["path"]), self._draft.description["lights"]
        position, direction = [float(x) for x in matrix[:3, 3]], [-float(x) for x in matrix[:3, 2]]
        common = {"position": position, "direction": direction}
        if (light.get("shaping:focus") or 0.0) > 0.0:
            self._draft.note(f"{place}: its focus was left out")
        cone = float(light.get("shaping:cone:angle") or 90.0)
        profile = light.get("shaping:ies:file")
        self._draft.note(f"{place}: what limits its directions makes it a light without extent")
        if profile and not profile[1].endswith("]"):
            if light.get("shaping:ies:normalize") or light.get("shaping:ies:angleScale"):
                self._draft.note(f"{place}: normalize and angleScale of its IES file were left out")
            name = scene_name(self._files, profile[1])
            allowed_file(name, self._files.folder, self._files.allow_paths, f"{self._files.source}: {place}")
            scale = [_LUMENS_PER_WATT * x for x in intensity]
            zero = [float(x) for x in matrix[:3, 0]]
            lights.append({"type": "ies", **common, "file": name, "scale": scale, "horizontal_zero": zero})
            return
        if profile:
            self._draft.note(f"{place}: an IES file in a package is not read")
        softness = min(max(float(light.get("shaping:cone:softness") or 0.0), 0.0), 1.0)
        cone = min(max(cone, 0.005), 180.0)
        edge, inner = sin_cos_degrees(cone)[1], sin_cos_degrees(cone * (1.0 - softness))[1]
        blend = min(max((inner - edge) / (1.0 - edge), 0.0), 1.0)
        lights.append({"type": "spot", **common, "intensity": intensity, "cone_degrees": 2.0 * cone, "blend": blend})

    def _shape(self, light: dict[str, Any], matrix: Matrix, radiance: list[float]) -> None:
        kind = light["type"]
        radius = float(light.get("radius") or 0.0)
        emission: Any = radiance
        common: dict[str, Any] = {"name": light["path"][-200:], "visible_to_camera": False}
        if kind == "SphereLight":
            if is_similarity(matrix):
                common |= {"type": "sphere", "radius": radius}
            else:
                common |= self._mesh(f"sphere of radius {radius!r}", lambda: sphere_mesh(radius))
        elif kind == "RectLight":
            w, h = float(light["width"]), float(light["height"])
            # Towards -z, and a picture upright for who looks at the light
            common |= {"type": "quad", "origin": [w / 2.0, -h / 2.0, 0.0], "edge_u": [-w, 0.0, 0.0]}
            common |= {"edge_v": [0.0, h, 0.0]}
            asset = light.get("texture:file")
            if asset:
                emission = self._pictured(asset, radiance, quoted(light["path"]))
        elif kind == "DiskLight":
            if is_similarity(matrix):
                common |= {"type": "disk", "radius": radius, "normal": [0.0, 0.0, -1.0]}
            else:
                common |= self._mesh("disk light", _disk_towards_minus_z)
                matrix = matrix.copy()
                matrix[:3, :2] *= radius
        else:
            long = float(light["length"])
            name = f"cylinder of radius {radius!r}, {long!r} long"
            common |= self._mesh(name, lambda: cylinder_mesh(radius, -long / 2.0, long / 2.0))
            matrix = product(matrix, rotation((0.0, 1.0, 0.0), 90.0))
        common["emission"] = emission
        self._draft.description["shapes"].append({**common, **transform_key(matrix)})

    def _pictured(self, asset: list[str], radiance: list[float], place: str) -> Any:
        name = scene_name(self._files, asset[1])
        if asset[1].endswith("]"):
            try:
                data = packaged_file(self._files, asset[1], place)
            except SceneError as fault:
                self._draft.leave_out(fault, self._files.source, self._files.strict)
                return radiance
            self._draft.pictures[name] = data, "." + asset[1][:-1].rpartition(".")[2].lower()
        else:
            allowed_file(name, self._files.folder, self._files.allow_paths, f"{self._files.source}: {place}")
        return {"texture": name, "scale": radiance, "wrap": "clamp"}

    def _mesh(self, name: str, make: Callable[[], MeshData]) -> dict[str, Any]:
        if name not in self._draft.meshes:
            self._draft.meshes[name] = make()
        return {"type": "mesh", "file": name}


def _volume(matrix: Matrix) -> float:
    return abs(determinant(matrix[:3, :3]))


def _disk_towards_minus_z() -> MeshData:
    """A disk of radius 1 whose front faces -z."""
    made = disk_mesh(1.0)
    uvs = None if made.uvs is None else made.uvs[:, ::-1].copy()
    return dataclasses.replace(made, triangles=made.triangles[:, ::-1].copy(), uvs=uvs)
