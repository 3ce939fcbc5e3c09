"""Reads a USD stage: a `.usd`, `.usda` or `.usdc` with the layers that it names, or a `.usdz` package."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from clrender.errors import SceneError
from clrender.exact.matrices import product
from clrender.importers.asset_files import AssetFiles
from clrender.importers.choices import Choices
from clrender.importers.draft import Draft
from clrender.importers.instancing import place_group
from clrender.importers.shared.matrices import Matrix, is_affine, transform_key
from clrender.importers.shared.motions import fault_of_motion, motion_keys, unflattened
from clrender.importers.usd.cameras import camera_of, image_of
from clrender.importers.usd.lights import Lights, radiance_of
from clrender.importers.usd.materials import Materials
from clrender.importers.usd.places import Places, instance_matrices, root_matrix
from clrender.importers.usd.process import Stage, read_stage
from clrender.importers.usd.solids import solid
from clrender.importers.usd.strands import Strands
from clrender.importers.usd.surfaces import Surfaces
from clrender.scene.groups import INSTANCE_LIMIT
from clrender.scene.values import NAME_LIMIT, SHAPE_LIMIT
from clrender.wording import counted, grouped, quoted

__all__ = ["read", "read_cameras"]

_PARTS: Final = 16
"""Pieces of the time for which the shutter is open; between their ends poses are interpolated."""


def read(path: Path, files: AssetFiles, choices: Choices | None = None) -> Draft:
    """The scene of a USD stage.

    Parameters
    ----------
    path : pathlib.Path
    files : AssetFiles
    choices : Choices, optional
        Moment of its animation, and shutter.

    Raises
    ------
    SceneError
        It cannot be read.
    """
    choices = choices or Choices()
    offsets: list[float] = []
    if choices.shutter is not None:
        begin, end = choices.shutter
        offsets = [begin + (end - begin) * part / _PARTS for part in range(_PARTS + 1)]
    stage = read_stage(path, files, choices.time_at, offsets)
    with _sound_values(files):
        return _Reader(files, stage, [(choices.time_at or 0.0) + each for each in offsets]).draft_of(choices)


def read_cameras(path: Path, files: AssetFiles, choices: Choices) -> list[tuple[str, dict[str, Any], dict[str, int]]]:
    """The cameras of a USD stage: the path of each, and tables `camera` and `image` of a scene file.

    Parameters
    ----------
    path : pathlib.Path
    files : AssetFiles
    choices : Choices
        Moment of its animation.

    Raises
    ------
    SceneError
        It cannot be read.
    """
    stage = read_stage(path, files, choices.time_at, ())
    with _sound_values(files):
        return _Reader(files, stage, []).cameras()


@contextmanager
def _sound_values(files: AssetFiles) -> Iterator[None]:
    """Refuse a stage for values of types that its schemas do not have: damaged files have such."""
    try:
        yield
    except (ArithmeticError, LookupError, TypeError, ValueError) as error:
        told = " ".join(str(error).split())[:200]
        text = f"a value in it is missing, or not of the type that its schema has ({told})"
        raise SceneError(f"{files.source}: {text}; export it again") from None


class _Reader:
    """A stage that becomes a draft."""

    def __init__(self, files: AssetFiles, stage: Stage, times: list[float]) -> None:
        tables = stage.tables
        self._files, self._stage, self._times = files, stage, times
        self._draft = Draft(wants_light=True, wants_exposure=True)
        self._places = Places(stage)
        self._root = root_matrix(tables["up"], float(tables["meters"]))
        self._materials = Materials(self._draft, files, tables)
        self._surfaces = Surfaces(self._draft, files, stage, self._materials)
        self._lights = Lights(self._draft, files, float(tables["meters"]))
        self._strands = Strands(self._draft, files, stage)
        self._cameras: list[tuple[dict[str, Any], list[Matrix]]] = []
        self._count = 0

    def draft_of(self, choices: Choices) -> Draft:
        """The draft."""
        tables, draft = self._stage.tables, self._draft
        for each in tables["layers"]:
            self._files.opened.append(Path(each))
        for sentence in tables["missing"]:
            draft.leave_out(SceneError(sentence), self._files.source, self._files.strict)
        for sentence in tables["notes"]:
            draft.note(sentence)
        if tables["animated"] and choices.time_at is None and choices.shutter is None:
            draft.note("it is animated; the image is of its first moment, another with --time-at SECONDS")
        elif not tables["animated"] and choices.time_at is not None:
            draft.note("it has no animation, so that the time asked for changes nothing")
        self._list("", np.array([self._root]), True)
        self._strands.finish()
        self._camera(tables["render"])
        description = draft.description
        if not description["shapes"]:
            draft.note("nothing in it has a surface: the image is of what is around it")
            description.setdefault("camera", {"position": [0.0, 0.0, 1.0], "target": [0.0, 0.0, 0.0]})
        return draft

    def cameras(self) -> list[tuple[str, dict[str, Any], dict[str, int]]]:
        """The cameras that can be used."""
        found = []
        for item in self._stage.tables["lists"][""]:
            if item["type"] == "Camera":
                made = camera_of(self._draft, item, product(self._root, self._places.chain(item["node"])))
                found += [] if made is None else [(item["path"], made, image_of(item, None))]
        return found

    def _list(self, key: str, bases: NDArray[np.float64], world: bool) -> None:
        """Add what is drawn of a list, at each of the places, (n, 4, 4).

        `world` is whether it is the stage itself, in which things move.
        """
        for item in self._stage.tables["lists"].get(key, []):
            self._count += len(bases)
            if self._count > INSTANCE_LIMIT:
                raise SceneError(
                    f"{self._files.source}: it has more than {grouped(INSTANCE_LIMIT)} things to draw; export fewer"
                )
            places = product(bases, self._places.chain(item["node"]))
            kind, worlds = item["type"], self._worlds(item["node"])
            if worlds and world:
                places = np.array(worlds[:1])
            if worlds and kind != "Camera" and (not world or kind in ("PointInstancer", "BasisCurves")):
                self._rests(item, "what point instancers place, and curves, do not move")
                worlds = []
            if kind == "PointInstancer":
                self._instances(item, places)
            elif kind == "Camera":
                if world:
                    self._cameras.append((item, worlds or [places[0]]))
            elif "Light" in kind:
                light = {**item, "up": self._stage.tables["up"]}
                for matrix in places:
                    self._lights.add(light, matrix, list(zip(self._times, worlds[1:], strict=False)))
                self._draft.wants_light = False
            elif kind == "BasisCurves":
                color, opacity = item["color"]
                used = self._materials.of(item["material"], color, 1.0 if opacity is None else opacity[0])
                self._strands.add(item, used.name, places)
            else:
                self._shapes(item, places, worlds)

    def _worlds(self, node: int) -> list[Matrix]:
        """World transforms at the times of the shutter, after that of the image; none if it rests.

        What is flat at one of them leaves something there.
        """
        if not self._times or not self._places.moves(node):
            return []
        numbers = range(len(self._times) + 1)
        return unflattened([product(self._root, self._places.chain(node, number)) for number in numbers])

    def _rests(self, item: dict[str, Any], why: str) -> None:
        self._draft.note(f"{quoted(item['path'])} rests while the shutter is open: {why}")

    def _instances(self, item: dict[str, Any], places: NDArray[np.float64]) -> None:
        indices = self._stage.array(item["indices"])
        assert indices is not None
        count = len(indices)
        names = ("positions", "orientations", "scales")
        found = {name: self._stage.array(item[name]) for name in names}
        if found["positions"] is None or any(each is not None and len(each) != count for each in found.values()):
            text = f"{quoted(item['path'])} has {count} protoIndices, but its positions, orientations or scales are of"
            fault = SceneError(f"{self._files.source}: {text} another number; export it again")
            self._draft.leave_out(fault, self._files.source, self._files.strict)
            return
        local = instance_matrices(found["positions"], found["orientations"], found["scales"], count)
        shown = np.ones(count, bool)
        mask = self._stage.array(item["mask"])
        if mask is not None and len(mask) == count:
            shown = mask.astype(bool)
        if len(places) * count > INSTANCE_LIMIT:
            raise SceneError(
                f"{self._files.source}: it has more than {counted(INSTANCE_LIMIT, 'instance')}; export fewer"
            )
        for number, key in enumerate(item["prototypes"]):
            chosen = local[shown & (indices == number)]
            if len(chosen):
                self._list(key, product(places[:, None], chosen[None]).reshape(-1, 4, 4), False)

    def _shapes(self, item: dict[str, Any], places: NDArray[np.float64], worlds: list[Matrix]) -> None:
        """Add a mesh or a solid at each of its places."""
        sound = np.array([is_affine(matrix) for matrix in places])
        if not sound.all():
            text = f"{quoted(item['path'])} has a transform that cannot be inverted; give it another"
            self._draft.leave_out(SceneError(f"{self._files.source}: {text}"), self._files.source, self._files.strict)
            places = places[sound]
        name = item["path"][-NAME_LIMIT:]
        if item["type"] != "Mesh":
            for matrix in places:
                self._solid(item, matrix, worlds, name)
            return
        made = []
        for part in self._surfaces.parts(item):
            shape: dict[str, Any] = {"type": "mesh", "file": part.mesh, "material": part.material.name}
            shape |= {"vertex_colors": "linear"} if part.colored else {}
            if item.get("light"):
                self._shine(item, shape, part.material.shines)
            if part.poses and ("emission" in shape or part.material.shines):
                self._rests(item, "it changes its form, and shines")
            elif part.poses:
                times = zip(self._times, part.poses, strict=True)
                shape["poses"] = [{"time": time, "file": mesh} for time, mesh in list(times)[::2]]
            made.append(shape)
        fault = fault_of_motion("mesh", worlds) if worlds and len(places) else ""
        if worlds and len(places) and not fault:
            moves = motion_keys(list(zip(self._times, worlds[1:], strict=True)))
            self._draft.description["shapes"] += [{**shape, "name": name, "motion": moves} for shape in made]
            return
        if fault:
            self._rests(item, fault)
        if not made or not len(places):
            return
        if len(places) > 1 and place_group(self._draft, made, places[:, :3], name):
            return
        if len(self._draft.description["shapes"]) + len(places) * len(made) > SHAPE_LIMIT:
            raise SceneError(
                f"{self._files.source}: it makes more than {counted(SHAPE_LIMIT, 'shape')} of the scene; export fewer"
            )
        for matrix in places:
            self._draft.description["shapes"] += [{**shape, "name": name, **transform_key(matrix)} for shape in made]

    def _shine(self, item: dict[str, Any], shape: dict[str, Any], shines: bool) -> None:
        """Make a mesh a light (MeshLightAPI)."""
        light = {**item["light"], "path": item["path"]}
        self._lights.note_extras(light)
        place = quoted(item["path"])
        if light.get("normalize"):
            self._draft.note(f"{place}: a light that is a mesh is not normalised")
        if shines:
            self._draft.note(f"{place} is a light and has a material that shines, which counts")
        elif any(radiance_of(light)):
            shape["emission"] = radiance_of(light)
            self._draft.wants_light = False

    def _solid(self, item: dict[str, Any], matrix: Matrix, worlds: list[Matrix], name: str) -> None:
        color, opacity = item["color"]
        found = solid(self._draft, item, matrix)
        if found is None:
            self._draft.note(f"{quoted(item['path'])} was left out: it has no extent")
            return
        used = self._materials.of(item["material"], color, 1.0 if opacity is None else opacity[0])
        described, placed = found
        shape = {**described, "name": name, "material": used.name}
        fault = fault_of_motion(described["type"], worlds) if worlds else ""
        if worlds and not fault:
            turned = [solid(self._draft, item, world) for world in worlds[1:]]
            keys = [(time, each[1]) for time, each in zip(self._times, turned, strict=True) if each is not None]
            self._draft.description["shapes"].append({**shape, "motion": motion_keys(keys)})
            return
        if fault:
            self._rests(item, fault)
        self._draft.description["shapes"].append({**shape, **transform_key(placed)})

    def _camera(self, settings: dict[str, Any]) -> None:
        """Add the camera that the render settings name, or the first one."""
        usable = []
        for item, worlds in self._cameras:
            made = camera_of(self._draft, item, worlds[0])
            if made is not None:
                usable.append((item, worlds, made))
        if not usable:
            return
        named = [each for each in usable if each[0]["path"] == settings.get("camera")]
        item, worlds, made = (named or usable)[0]
        if len(usable) > 1:
            which = "that of its render settings" if named else "the first"
            self._draft.note(
                f"it has {counted(len(usable), 'camera')}; the image is of {which}, {quoted(item['path'])}"
            )
        if len(worlds) > 1:
            posed = [camera_of(self._draft, item, world) for world in worlds[1:]]
            keys = ("position", "target", "up")
            moving = zip(self._times, posed, strict=True)
            made["motion"] = [
                {"time": time, **{key: each[key] for key in keys}} for time, each in moving if each is not None
            ]
        self._draft.description["camera"] = made
        self._draft.description["image"] = image_of(item, settings.get("resolution"))
