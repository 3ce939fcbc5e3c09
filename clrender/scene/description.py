"""What a scene is: the validated model behind a scene file.

Every table of the file is one frozen pydantic model with unknown keys forbidden, so that a misspelt key is an error
and never ignored. Numbers are finite and bounded here; what needs more than one number (a camera that looks at itself,
a transform that squashes a sphere) is checked by the model that has them. `validation_errors.py` words the errors.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt
from pydantic import PrivateAttr, model_validator

from clrender.errors import SceneError, UsageError
from clrender.image.exposure import photographic_stops
from clrender.meshes.data import MeshData
from clrender.plugins import as_plugins, combined
from clrender.scene.arrays import (
    environment_of_array,
    grid_of_array,
    mesh_of_arrays,
    picture_of_array,
    strands_of_array,
)
from clrender.scene.camera import Camera
from clrender.scene.changes import Changes, table_values, validated
from clrender.scene.content_hash import content_sha256
from clrender.scene.contents import HEAD, Head, SceneContents
from clrender.scene.defaults import Image, Render
from clrender.scene.environment import EnvironmentPicture
from clrender.scene.frozen import FrozenDict, frozen
from clrender.scene.light_kinds import (
    LIGHT_TYPES,
    DirectionalLight,
    EnvironmentLight,
    IesLight,
    Light,
    PluginLight,
    PointLight,
    ProjectorLight,
    SpotLight,
    SunSkyLight,
)
from clrender.scene.materials import (
    MATERIAL_TYPES,
    Dielectric,
    Lambert,
    Material,
    Mirror,
)
from clrender.scene.medium import Medium
from clrender.scene.references import check_references
from clrender.scene.shapes import AnyShape, Mesh
from clrender.scene.values import (
    POWER_LIMIT,
    Part,
)
from clrender.wording import quoted, shown, suggestion

if TYPE_CHECKING:
    from typing_extensions import Self

__all__ = [
    "LIGHT_TYPES",
    "MATERIAL_TYPES",
    "Camera",
    "Dielectric",
    "DirectionalLight",
    "EnvironmentLight",
    "IesLight",
    "Image",
    "Lambert",
    "Light",
    "Material",
    "Mirror",
    "PluginLight",
    "PointLight",
    "ProjectorLight",
    "Render",
    "Scene",
    "SpotLight",
    "SunSkyLight",
]


class Scene(SceneContents):
    """A scene: what a scene file says, validated.

    Read one with `clrender.scene.load`, or build one in code from the classes of this package; a bad value raises
    `clrender.errors.SceneError` either way.

    Attributes are the tables and keys of a scene file; given as mappings, they become objects.

    Attributes
    ----------
    title : str
    camera : Camera
    image : Image
        Size of the image, pixels.
    render : Render
        Settings of a render, where nobody says anything else.
    materials : dict of str to Material
    shapes : tuple of shapes and Instance
    groups : dict of str to Group
    lights : tuple of Light
        Those that are no shapes.
    media : dict of str to Medium
    fog : str or None
        Name of the medium that is wherever no other one is.
    """

    _notes: tuple[str, ...] = PrivateAttr(default=())
    _faults: tuple[int, int] = PrivateAttr(default=(0, 0))
    _read_files: tuple[Path, ...] = PrivateAttr(default=())
    _default_light: tuple[Light | None, str] = PrivateAttr(default=(None, ""))
    _origin: dict[str, Any] | None = PrivateAttr(default=None)

    def __new__(cls, *given: object, **_content: Any) -> Self:
        if given:
            raise UsageError(
                "a Scene takes its tables by name: clrender.Scene(**content); scene files are read by clrender.load"
            )
        return super().__new__(cls)

    @model_validator(mode="after")
    def _names_resolve(self) -> Scene:
        check_references(self)
        return self

    def _changed(self, changes: Changes) -> Self:
        values = table_values(self, changes, (), self.source)
        if changes.keys() <= HEAD:  # shapes and names, of which there may be many, are as they were
            head = {name: value for name, value in values.items() if name in HEAD}
            made: Part = validated(Head, head, (), self.source)
        else:
            made = validated(type(self), values, (), self.source)
        return self.with_checked(**{name: getattr(made, str(name)) for name in map(str, changes)})

    def assembled(
        self, shapes: Sequence[tuple[tuple[str | int, ...], AnyShape]], media: Mapping[str, Medium] | None = None
    ) -> Scene:
        """A copy of the scene with these shapes, each with its location in the description, and no groups.

        Parameters
        ----------
        shapes : sequence of (place, shape)
            As `all_shapes` yields them.
        media : mapping of str to Medium, optional
            Further media that they name.

        Returns
        -------
        Scene
        """
        more = {"media": {**self.media, **media}} if media else {}
        scene = self.with_checked(shapes=tuple(shape for _, shape in shapes), groups={}, **more)
        scene._places = tuple(at for at, _ in shapes)
        return scene

    @property
    def origin(self) -> dict[str, Any] | None:
        """Arguments of `clrender.load` that loaded this scene or its original; None if it was built in code."""
        return self._origin

    def with_origin(self, origin: Mapping[str, Any]) -> Scene:
        """A copy of the scene that records these arguments of `clrender.load`, JSON-able.

        Parameters
        ----------
        origin : mapping
            Arguments of `clrender.load` by name.

        Returns
        -------
        Scene
        """
        scene = self.model_copy()
        scene._origin = FrozenDict(origin)
        return scene

    def placed(self, source: str, base_folder: Path, allow_paths: Sequence[Path] = ()) -> Scene:
        """A copy of the scene that looks for its files in another folder.

        Parameters
        ----------
        source : str
            Name of the scene in messages.
        base_folder : pathlib.Path
            Folder to which file names are relative. Files are read only from it and below ...
        allow_paths : sequence of pathlib.Path
            ... and from these folders and below.

        Returns
        -------
        Scene
        """
        scene = self.model_copy()
        scene._files, scene._store = self._files.in_folder(source, base_folder, tuple(allow_paths)), []
        return scene

    def with_files(self, **contents: Mapping[Any, Any]) -> Scene:
        """A copy of the scene that uses these contents instead of the files of these names.

        Parameters
        ----------
        **contents : mapping
            By kind of file and name: `meshes`, `transforms`, `environments`, `profiles`, `grids`, `textures` and
            `encoded`; see
            `clrender.scene.scene_files.SceneFiles`. A mesh may be named by its file alone. Arrays are copied unless
            they are read-only.

        Returns
        -------
        Scene

        Raises
        ------
        SceneError
            There is no such kind of file, or a content is of another kind.
        """
        scene = self.model_copy()
        scene._files = self._files.with_contents(**contents)
        if contents.keys() & {"textures", "encoded"}:
            scene._store = []
        return scene

    def with_arrays(
        self,
        *,
        meshes: Mapping[str, Mapping[str, Any]] | None = None,
        textures: Mapping[str, npt.ArrayLike] | None = None,
        environments: Mapping[str, npt.ArrayLike] | None = None,
        grids: Mapping[str, npt.ArrayLike] | None = None,
        curves: Mapping[str, npt.ArrayLike] | None = None,
    ) -> Scene:
        """A copy of the scene that uses arrays in the place of the files of these names.

        Arrays are NumPy's, or anything that can be turned into those, such as tensors in the memory of the host. They
        are copied unless they are read-only and nothing else can write to their memory.

        Parameters
        ----------
        meshes : mapping of str to mapping of str to array_like, optional
            By the `file` of shapes of type ``mesh``: ``vertices`` (V, 3), metres; ``faces`` (T, 3), indices from 0;
            ``normals`` (V, 3); ``uvs``, ``uvs_1``, ``colors`` (linear, 0 to 1) and ``tangents`` for each vertex,
            (V, 2), (V, 3) and (V, 4), or for each corner, (T, 3, n). Of a mesh that was given before, arrays that are
            not given stay as they are; None takes one away.
        textures : mapping of str to array_like, optional
            By the `texture` of materials: (H, W), or (H, W, 1, 3 or 4), first row on top. Of uint8 or uint16, which
            are encoded as `color_space` says, or floats.
        environments : mapping of str to array_like, optional
            By the `file` of the environment: (H, W, 3) floats, latitude-longitude, radiance.
        grids : mapping of str to array_like, optional
            By the `file` of the density of media, or of their albedo, emission or temperature: (nz, ny, nx), or of
            colours (nz, ny, nx, 3), not below 0. In the place of a ``.vdb`` or ``.nvdb`` file a grid of another name
            than density has the name of the file, a space and its own.
        curves : mapping of str to array_like, optional
            By the `file` of shapes of type ``curves``: (strands, points, 3 or 4), metres, the fourth the radius; or
            (points, 3 or 4), in which rows that are not numbers part two strands.

        Returns
        -------
        Scene

        Raises
        ------
        SceneError
            An array is missing, or has another shape or other numbers than it may have; or nothing in the scene has
            the name.

        Examples
        --------
        >>> scene = Scene(camera=camera, shapes=[{"type": "mesh", "file": "body"}])  # doctest: +SKIP
        >>> scene = scene.with_arrays(meshes={"body": {"vertices": points, "faces": faces}})  # doctest: +SKIP
        """
        every: dict[str, Mapping[str, Any] | None] = {
            "meshes": meshes,
            "textures": textures,
            "environments": environments,
            "grids": grids,
            "curves": curves,
        }
        for kind, arrays in every.items():
            if not isinstance(arrays, Mapping | None):
                raise SceneError(f"{kind} is {shown(arrays)}, but must be a table of arrays by the names of files")
            named = self._named_files(kind) if arrays else set()
            for name in arrays or ():
                if not isinstance(name, str):
                    raise SceneError(
                        f"{kind}: {shown(name)} is no text; give the name of a file as the scene writes it"
                    )
                if name not in named:
                    raise SceneError(f"{kind}: nothing in the scene names {quoted(name)}{suggestion(name, named)}")
        contents: dict[str, dict[Any, Any]] = {}
        if meshes:
            former = {name: mesh for (name, _), mesh in self._files.meshes.items()}
            made = {name: mesh_of_arrays(name, given, former.get(name)) for name, given in meshes.items()}
            assets = {shape.asset for _, shape in self.mesh_files() if shape.file in made}
            names = {file for file, _ in assets}
            contents["meshes"] = {asset: made[asset[0]] for asset in assets}
            contents["meshes"] |= {(name, None): mesh for name, mesh in made.items() if name not in names}
        if textures:
            contents["textures"] = {name: picture_of_array(name, array) for name, array in textures.items()}
        if environments:
            contents["environments"] = {name: environment_of_array(name, each) for name, each in environments.items()}
        if grids:
            contents["grids"] = {name: grid_of_array(name, array) for name, array in grids.items()}
        if curves:
            contents["curves"] = {name: strands_of_array(name, array) for name, array in curves.items()}
        return self.with_files(**contents)

    def _named_files(self, kind: str) -> set[str]:
        """Names of files that arrays of a kind of `with_arrays` may stand for."""
        if kind == "meshes":
            return {str(shape.file) for _, shape in self.mesh_files()}
        if kind == "textures":
            return {texture.texture for _, texture in self.texture_files()}
        if kind == "environments":
            return {str(light.file) for _, light in self.pictured_lights()}
        if kind == "grids":
            return {grid.asset for _, grid in self.grids()}
        return {str(shape.file) for _, shape in self.curve_files()}

    def with_plugins(self, plugins: Any) -> Self:
        """A copy of the scene whose materials may use these plugins, too.

        Parameters
        ----------
        plugins : Plugin, str, pathlib.Path, or iterable of them
            Plugins, or their files; see `clrender.plugin`.

        Returns
        -------
        Scene

        Raises
        ------
        UsageError
            A file is no plugin, or two plugins have one name.
        """
        given = as_plugins(plugins)
        if not given or set(given) <= set(self._plugins):
            return self
        for each in given:
            if each.name in MATERIAL_TYPES:
                text = f"the plugin is called {each.name}, as a material of clrender's own; call it my_{each.name}"
                raise UsageError(f"{each.source}: {text}")
        scene = self.model_copy()
        scene._plugins = combined(self._plugins, given)
        return scene

    def remeshed(self, meshes: Sequence[MeshData], lights: Sequence[Light], emitting: bool = True) -> Scene:
        """A copy of the scene with other triangles, in world space, for each of its shapes.

        Parameters
        ----------
        meshes : sequence of MeshData
            One for each shape.
        lights : sequence of Light
            Lights that replace the scene's own.
        emitting : bool
            Whether shapes keep their emission.

        Returns
        -------
        Scene
        """
        shapes = tuple(
            Mesh(type="mesh", file=f"shape {i}", material=s.material, emission=s.emission if emitting else None)
            for i, s in enumerate(self.shapes)
        )
        scene = self.with_checked(shapes=shapes, lights=tuple(lights))
        given = FrozenDict({(f"shape {i}", None): frozen(mesh) for i, mesh in enumerate(meshes)})
        scene._files = replace(self._files, meshes=given)
        return scene

    @property
    def notes(self) -> tuple[str, ...]:
        """Notes of the importer on what it does not support and did instead; a sentence each."""
        return self._notes

    @property
    def faults(self) -> dict[str, int]:
        """How many faults of its file the importer has ``forgiven``, and for how many it has ``left_out`` a part."""
        return dict(zip(("forgiven", "left_out"), self._faults, strict=True))

    @property
    def read_files(self) -> tuple[Path, ...]:
        """Files that its importer has read besides the scene file, and that the description does not name."""
        return self._read_files

    def with_notes(
        self, notes: Iterable[str], read_files: Iterable[Path] = (), faults: tuple[int, int] | None = None
    ) -> Scene:
        """A copy of the scene with these notes and additional files that were read.

        Parameters
        ----------
        notes : iterable of str
            Sentences.
        read_files : iterable of pathlib.Path
        faults : (int, int), optional
            Numbers of faults that were forgiven, and for which a part was left out; default: as before.

        Returns
        -------
        Scene
        """
        scene = self.model_copy()
        scene._faults = self._faults if faults is None else faults
        scene._notes, scene._read_files = tuple(notes), (*self._read_files, *read_files)
        return scene

    def with_default_light(self, light: EnvironmentLight, note: str) -> Scene:
        """A copy of the scene, which has no environment, in a default one; `with_environment` replaces it and its note.

        Parameters
        ----------
        light : EnvironmentLight
        note : str
            Note about the light.

        Returns
        -------
        Scene
        """
        scene = self.with_checked(lights=(*self.lights, light))
        scene._default_light = light, note
        return scene

    def with_exposure(
        self, f_stop: float | None = None, shutter: float | None = None, iso: float | None = None
    ) -> Scene:
        """A copy of the scene with another exposure of display images; settings not given stay.

        Parameters
        ----------
        f_stop, shutter, iso : float, optional
            See `clrender.image.exposure.photographic_stops`.

        Returns
        -------
        Scene

        Raises
        ------
        UsageError
            If a number is not allowed, or the result lacks an f-stop or shutter.
        """
        asked = {"f_stop": f_stop, "shutter": shutter, "iso": iso}
        asked = {name: value for name, value in asked.items() if value is not None}
        if not asked:
            return self
        given = {**(self.camera.exposure or {}), **asked}
        photographic_stops(**given)
        return self.with_checked(camera=self.camera.changed(given))

    def with_environment(self, environment: str | Path | float | npt.ArrayLike) -> Scene:
        """A copy of the scene, which has no environment of its own, in this environment.

        Parameters
        ----------
        environment : str, pathlib.Path, float, three floats or (H, W, 3) array
            An equirectangular `.exr`, `.hdr` or `.png` in any folder, such an image, or a constant radiance,
            W/(sr m2).

        Returns
        -------
        Scene

        Raises
        ------
        SceneError
            If the scene has an environment, the file cannot be read or is not a usable image, or the number is not a
            valid radiance.
        """
        around = self.environment or self.sky
        if around is not None and around is not self._default_light[0]:
            place = f"{self.source}: lights[{self.lights.index(around)}]"
            raise SceneError(
                f"{place}: is an environment already; delete it from the scene, or leave out the other one"
            )
        default, note = self._default_light
        others = tuple(light for light in self.lights if light is not default)
        light, pictures = _environment(environment)
        scene = self.with_checked(lights=(*others, light)).with_files(environments=pictures)
        scene._default_light = None, ""
        return scene.with_notes(each for each in self._notes if default is None or not each.endswith(note))

    def with_hidden_environment(self) -> Scene:
        """A copy of the scene whose environment lights it, but is not seen by the camera; the same if it has none.

        Returns
        -------
        Scene
        """
        around = (self.environment, self.sky)
        lights = tuple(
            light.changed(visible_to_camera=False) if any(light is each for each in around) else light
            for light in self.lights
        )
        return self.with_checked(lights=lights).with_origin({**(self.origin or {}), "hide_environment": True})

    def shares_contents(self, other: Scene) -> bool:
        """Whether another scene has the very same objects, except for its camera, title and defaults.

        Parameters
        ----------
        other : Scene

        Returns
        -------
        bool
            True only if `content_sha256` of both is equal; it may be equal otherwise too.
        """
        return all(a is b for a, b in zip(self._contents(), other._contents(), strict=True))

    def sha256(self) -> str:
        """Hash of the scene's content, independent of its location and spelling.

        Its title, the names of its shapes, its default render settings and the exposure of display images do not count.
        Films record a render's settings separately.

        Returns
        -------
        str
            64 hexadecimal digits. A mesh file counts by its vertices, normals and triangles, an image by its pixels,
            an IES file by its intensities, and none by its name.
        """
        return content_sha256(self, {"title", "render"})

    def file_sha256(self, name: str) -> str | None:
        """Hash of the bytes of a file as its description could name it.

        Parameters
        ----------
        name : str
            Relative to its folder, or absolute.

        Returns
        -------
        str or None
            64 hexadecimal digits; None if there is no such file, or it may not be read.
        """
        digest = hashlib.sha256()
        try:
            with self._files.opened(name, "file") as (file, _):
                while data := file.read(1 << 20):
                    digest.update(data)
        except (SceneError, OSError):
            return None
        return digest.hexdigest()

    def content_sha256(self) -> str:
        """Hash of shapes, materials and lights alone, without camera and settings."""
        return self.of_contents("sha256", lambda: content_sha256(self, HEAD))


def _environment(asked: Any) -> tuple[EnvironmentLight, dict[str, EnvironmentPicture]]:
    """The environment light for a user's value, and its environment map, if any, by name."""
    if isinstance(asked, str | Path):
        path = Path(asked).absolute()
        picture = EnvironmentPicture.read(path.name, path.parent, [path.resolve().parent], "the environment")
        return EnvironmentLight(type="environment", file=str(path)), {str(path): frozen(picture)}
    try:
        values = np.asarray(asked, np.float64)
    except (TypeError, ValueError):
        values = np.zeros(0)
    if values.shape in ((), (3,)) and asked is not None and not isinstance(asked, bool):
        color = (values if values.shape else np.repeat(values, 3)).tolist()
        if not all(0.0 <= each <= POWER_LIMIT for each in color):
            raise SceneError(f"the environment is {asked!r}, but a radiance must be from 0 to {POWER_LIMIT:g}")
        return EnvironmentLight(type="environment", radiance=tuple(color)), {}
    if values.ndim == 3 and values.shape[2] == 3 and values.size:
        with np.errstate(over="ignore"):  # infinite, which is refused
            picture = EnvironmentPicture.checked(values.astype(np.float32), "the environment")
        name = f"array {picture.sha256()[:8]}"
        return EnvironmentLight(type="environment", file=name), {name: frozen(picture)}
    raise SceneError(
        f"the environment is {shown(asked)}, but must be the name of an image, a radiance (one number or three), or an "
        "array of shape (height, width, 3)"
    )
