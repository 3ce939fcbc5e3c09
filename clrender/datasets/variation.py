"""The images of a data set: each is a function of the data set's description and its own number."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

from clrender.datasets.placing import Drawer, overruled, placed_camera, with_distractors, with_objects
from clrender.datasets.spec import Spec, load_spec
from clrender.datasets.values import named_in
from clrender.errors import SceneError, UsageError
from clrender.exact.counters import key_of, philox
from clrender.importers.cameras.read import load_cameras, with_camera
from clrender.importers.load import load
from clrender.rendering.job import RenderJob
from clrender.scene import Camera, Scene, builtin_names
from clrender.scene.resting import opened
from clrender.scene.transforms import Affine
from clrender.wording import printable, quoted, suggestion

__all__ = ["DatasetPlan", "Varied"]


@dataclass(frozen=True)
class Varied:
    """The scene of one image.

    Attributes
    ----------
    index : int
    scene : Scene
    size : (int, int)
        Width and height, pixels.
    seed : int
        Of its render.
    drawn : dict
        What was drawn, by place.
    poses : dict of str to Affine
        Of objects that were placed.
    """

    index: int
    scene: Scene
    size: tuple[int, int]
    seed: int
    drawn: dict[str, Any]
    poses: dict[str, Affine]

    @cached_property
    def moment(self) -> Scene:
        """The scene when the shutter opens, at rest: where its camera and objects are said to be."""
        return opened(self.scene)


@dataclass(frozen=True)
class DatasetPlan:
    """A data set with the scene and the cameras that it names.

    Attributes
    ----------
    spec : Spec
    source : str
        Name of its file in messages.
    base : Scene
    cameras : tuple of (str, Camera)
        Of its file of cameras, if it has one.
    categories : tuple of str
        Names of the numbers from 1 on.
    """

    spec: Spec
    source: str
    base: Scene
    cameras: tuple[tuple[str, Camera], ...] = ()
    categories: tuple[str, ...] = field(default=())

    @classmethod
    def load(
        cls,
        path: str | Path,
        writers: Iterable[str] | None = None,
        allow_paths: Sequence[str | Path] = (),
        plugins: Any = None,
    ) -> DatasetPlan:
        """Read the file of a data set and what it names, and check its first image.

        Parameters
        ----------
        path : path
            `.toml` or `.json`; names of files in it are relative to its folder.
        writers : iterable of str, optional
            In place of those of the file.
        allow_paths, plugins
            See `clrender.load`.

        Raises
        ------
        SceneError, UsageError
            See `of`.
        """
        spec = load_spec(path, writers)
        return cls.of(spec, printable(str(path)), Path(path).parent, allow_paths=allow_paths, plugins=plugins)

    @classmethod
    def from_table(cls, content: Mapping[str, Any], folder: str | Path = ".", plugins: Any = None) -> DatasetPlan:
        """A data set as its file would say it.

        Parameters
        ----------
        content : mapping
        folder : path
            That names of files are relative to.
        plugins : Plugin, path, or iterable of them, optional
            See `clrender.load`.

        Raises
        ------
        SceneError, UsageError
            See `of`.
        """
        return cls.of(Spec.of(content, "data set"), "data set", Path(folder), plugins=plugins)

    @classmethod
    def of(
        cls,
        spec: Spec,
        source: str,
        folder: Path,
        scene: str | Path | None = None,
        allow_paths: Sequence[str | Path] = (),
        plugins: Any = None,
    ) -> DatasetPlan:
        """Load the scene of a data set, and check its first image.

        Parameters
        ----------
        spec : Spec
        source : str
            Name of its file in messages.
        folder : Path
            That names of files are relative to.
        scene : path, optional
            In place of the one that it names.
        allow_paths, plugins
            See `clrender.load`.

        Raises
        ------
        SceneError, UsageError
            A file cannot be read, or the first image cannot be made.
        """
        wanted: str | Path = spec.scene if scene is None else scene
        if scene is None and wanted not in builtin_names():
            wanted = folder / spec.scene
        options = {key: value for key, value in spec.load.model_dump().items() if value is not None}
        if isinstance(options.get("environment"), str):
            options["environment"] = folder / options["environment"]
        base = load(wanted, allow_paths=allow_paths, plugins=plugins, **options)
        cameras: tuple[tuple[str, Camera], ...] = ()
        if spec.camera.file is not None:
            cameras = tuple(load_cameras(folder / spec.camera.file).items())
            if not cameras:
                raise SceneError(f"{source}: camera.file has no camera; name another file")
        _check_groups(spec, source, base)
        plan = cls(spec, source, base, cameras, _categories(spec, base))
        plan.job(plan.image(0))
        return plan

    def image(self, index: int) -> Varied:
        """The scene of an image.

        Parameters
        ----------
        index : int
            From 0.

        Raises
        ------
        UsageError
            No image has this number.
        SceneError
            What was drawn is no valid scene.
        """
        if not 0 <= index < 1 << 64:
            raise UsageError(f"image {index}: images are numbered from 0 on")
        spec, drawer = self.spec, Drawer(self.spec.seed, index)
        try:
            scene = self.base
            if self.cameras:
                number = index % len(self.cameras)
                if spec.camera.order == "random":
                    number = drawer.draws("camera.file").below(len(self.cameras))
                name, camera = self.cameras[number]
                drawer.drawn["camera.file"] = name
                scene = with_camera(scene, camera)
            if spec.vary:
                scene = scene.changed({place: drawer.value(f"vary.{place}", each) for place, each in spec.vary.items()})
                self._check_effects(scene)
            poses = dict[str, Affine]()
            if spec.objects or spec.distractors:
                shapes = with_objects(scene.shapes, spec.objects, spec.up, drawer, poses)
                shapes = with_distractors(shapes, spec.distractors, spec.up, drawer, poses)
                scene = scene.changed({("shapes",): shapes})
            scene = scene.with_checked(camera=placed_camera(scene, spec.camera, spec.up, drawer))
            self._check_categories(scene)
            if "camera.time" in spec.vary and not (scene.has_motion or scene.camera.motion):
                raise SceneError(
                    "vary.camera.time has no effect, since nothing in the scene has a motion; leave it out"
                )
        except SceneError as error:
            raise SceneError(f"{self.source}: image {index}: {error}") from None
        width, height = spec.size or (scene.image.width, scene.image.height)
        if spec.sensor is not None and spec.sensor.bayer is not None and min(width, height) < 2:
            text = f"an image of {width} x {height} pixels has no mosaic; two a side are needed (size)"
            raise SceneError(f"{self.source}: image {index}: sensor.bayer: {text}")
        words = philox(key_of(spec.seed, "render"), (0, 0, index & 0xFFFFFFFF, index >> 32))
        return Varied(index, scene, (width, height), int(words[0]), drawer.drawn, poses)

    def job(self, varied: Varied, layers: tuple[str, ...] = (), amodal: bool = False) -> RenderJob:
        """The render of an image.

        Parameters
        ----------
        varied : Varied
        layers : tuple of str
        amodal : bool
            Whether masks are rendered as if nothing stood before their instances.

        Raises
        ------
        UsageError
            A setting is not allowed.
        """
        try:
            masks = ("all",) if amodal and varied.scene.shapes else ()
            return RenderJob.of(
                varied.scene, size=varied.size, seed=varied.seed, aov=layers, amodal=masks, **self.spec.render
            )
        except UsageError as error:
            raise UsageError(f"{self.source}: render: {error}") from None

    @property
    def warnings(self) -> tuple[str, ...]:
        """One line for each listed category that nothing in the images has, whose annotations stay empty."""
        if any(key.rpartition(".")[2] == "category" for key in self.spec.vary):
            return ()
        there = _categories_there(self.spec, self.base)
        return tuple(
            f"warning: {self.source}: categories[{number}]: nothing in the scene has the category {quoted(name)}, so "
            f"that no image shows it{suggestion(name, sorted(there))}"
            for number, name in enumerate(self.categories)
            if name not in there
        )

    def _check_effects(self, scene: Scene) -> None:
        """Refuse what is drawn of the camera though something else says it: it would be recorded as if it were so."""
        without = overruled(scene.camera, self.spec.camera)
        for place in self.spec.vary:
            first, *keys = re.split(r"[.\[]", place)
            if first == "camera" and keys and keys[0] in without:
                raise SceneError(f"vary.{place} has no effect, since {without[keys[0]]}; leave it out")

    def _check_categories(self, scene: Scene) -> None:
        known = set(self.categories)
        for _, shape in (*scene.all_shapes(), *scene.instances()):
            if shape.category is not None and shape.category not in known:
                raise SceneError(
                    f"the category {quoted(shape.category)} is not in categories; list all that images may have there"
                )


def _check_groups(spec: Spec, source: str, base: Scene) -> None:
    """Refuse names of groups that the scene does not have, before the image that draws them."""
    named = [(f"distractors[{n}].groups", name) for n, each in enumerate(spec.distractors) for name in each.groups]
    named += [(f"objects[{n}].group", name) for n, each in enumerate(spec.objects) for name in named_in(each.group)]
    for place, name in named:
        if name not in base.groups:
            text = f"names the group {quoted(name)}, which the scene does not have{suggestion(name, base.groups)}"
            raise SceneError(f"{source}: {place} {text}")


def _categories(spec: Spec, base: Scene) -> tuple[str, ...]:
    """The data set's categories: as listed, else those of the scene and of distractors, sorted."""
    if spec.categories is not None:
        return spec.categories
    return tuple(sorted(_categories_there(spec, base)))


def _categories_there(spec: Spec, base: Scene) -> set[str]:
    """The categories of the scene and of distractors."""
    found = {shape.category for _, shape in (*base.all_shapes(), *base.instances())}
    found |= {table.category for table in spec.distractors}
    return {each for each in found if each is not None}
