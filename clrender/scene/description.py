"""What a scene is: the validated model behind a scene file.

Every table of the file is one frozen pydantic model with unknown keys forbidden, so that a misspelt key is an error
and never ignored. Numbers are finite and bounded here; what needs more than one number (a camera that looks at itself,
a transform that squashes a sphere) is checked by the model that holds them. `validation_errors.py` words the errors.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, BinaryIO

from pydantic import FailFast, Field, PrivateAttr, Strict, model_validator

from clrender.errors import SceneError
from clrender.exposure import photographic_stops
from clrender.scene.camera import Camera
from clrender.scene.content_hash import content_sha256
from clrender.scene.defaults import Image, Render
from clrender.scene.environment import EnvironmentPicture
from clrender.scene.groups import Group, Instance, ShapeOrInstance, TransformArray
from clrender.scene.ies import IesProfile
from clrender.scene.light_kinds import (
    LIGHT_TYPES,
    DirectionalLight,
    EnvironmentLight,
    IesLight,
    Light,
    PointLight,
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
from clrender.scene.mesh_data import MeshData, inline_mesh
from clrender.scene.references import check_references
from clrender.scene.scene_files import SceneFiles
from clrender.scene.shapes import AnyShape, Mesh
from clrender.scene.texels import TexelStore
from clrender.scene.textures import AnyTexture, BumpMap, Checker, ImageTexture, NormalMap, Ramp, textures_of
from clrender.scene.values import (
    POWER_LIMIT,
    SHAPE_LIMIT,
    Name,
    Part,
)
from clrender.scene.wording import place

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
    "PointLight",
    "Render",
    "Scene",
    "SpotLight",
    "SunSkyLight",
]


class Scene(Part):
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

    title: Annotated[str, Strict()] = ""
    camera: Camera
    image: Image = Image()
    render: Render = Render()
    materials: Annotated[dict[Name, Material], Field(max_length=65536)] = Field(default_factory=dict)
    shapes: Annotated[tuple[ShapeOrInstance, ...], FailFast(), Field(max_length=SHAPE_LIMIT)] = ()
    groups: Annotated[dict[Name, Group], Field(max_length=65536)] = Field(default_factory=dict)
    lights: Annotated[tuple[Light, ...], FailFast(), Field(max_length=SHAPE_LIMIT)] = ()
    media: Annotated[dict[Name, Medium], Field(max_length=65536)] = Field(default_factory=dict)
    fog: Name | None = Field(
        None, description="name of the medium that fills all space outside other media, to infinity"
    )

    _files: SceneFiles = PrivateAttr(default_factory=SceneFiles)
    _store: list[TexelStore] = PrivateAttr(default_factory=list)
    _places: tuple[tuple[str | int, ...], ...] = PrivateAttr(default=())
    _notes: tuple[str, ...] = PrivateAttr(default=())
    _read_files: tuple[Path, ...] = PrivateAttr(default=())
    _default_light: tuple[Light | None, str] = PrivateAttr(default=(None, ""))
    _origin: dict[str, Any] | None = PrivateAttr(default=None)

    @model_validator(mode="after")
    def _names_resolve(self) -> Scene:
        check_references(self)
        return self

    def all_shapes(self) -> Iterator[tuple[tuple[str | int, ...], AnyShape]]:
        """Its shapes and those of its groups, each with its place in the scene's description; no instances.

        Yields
        ------
        place : tuple of str or int
            Keys and indices that lead to the shape in the description.
        shape : AnyShape
        """
        for index, shape in enumerate(self.shapes):
            if not isinstance(shape, Instance):
                yield ("shapes", index), shape
        for name, group in self.groups.items():
            for index, shape in enumerate(group.shapes):
                yield ("groups", name, "shapes", index), shape

    @property
    def plain_shapes(self) -> tuple[AnyShape, ...]:
        """Its shapes, where it is known that none is an instance: `clrender.scene.assembly` has taken them apart."""
        return self.shapes  # type: ignore[return-value]

    def instances(self) -> Iterator[tuple[int, Instance]]:
        """Those of its shapes that place a group, each with its index.

        Yields
        ------
        index : int
            In `shapes`.
        instance : Instance
        """
        for index, shape in enumerate(self.shapes):
            if isinstance(shape, Instance):
                yield index, shape

    def place_of(self, index: int) -> tuple[str | int, ...]:
        """Where `shapes[index]` stands in the description: there, or in a group if `clrender.scene.assembly` put it.

        Parameters
        ----------
        index : int
            In `shapes`.

        Returns
        -------
        tuple of str or int
        """
        return self._places[index] if self._places else ("shapes", index)

    def assembled(self, shapes: Sequence[tuple[tuple[str | int, ...], AnyShape]]) -> Scene:
        """The same scene with these shapes, each with its place in the description, and no groups.

        Parameters
        ----------
        shapes : sequence of (place, shape)
            As `all_shapes` gives them.

        Returns
        -------
        Scene
        """
        scene = self.model_copy(update={"shapes": tuple(shape for _, shape in shapes), "groups": {}})
        scene._places = tuple(at for at, _ in shapes)
        return scene

    @property
    def base_folder(self) -> Path:
        """Folder against which files are looked up: the scene file's own, or the working folder."""
        return self._files.base_folder

    @property
    def source(self) -> str:
        """Name of the scene file for messages."""
        return self._files.source

    @property
    def origin(self) -> dict[str, Any] | None:
        """Arguments of `clrender.load` that gave this scene, or the one that it was made from; None: made in code."""
        return self._origin

    def with_origin(self, origin: Mapping[str, Any]) -> Scene:
        """The same scene, which was loaded with these arguments, JSON-able.

        Parameters
        ----------
        origin : mapping
            Arguments of `clrender.load` by their names.

        Returns
        -------
        Scene
        """
        scene = self.model_copy()
        scene._origin = dict(origin)
        return scene

    def placed(self, source: str, base_folder: Path, allow_paths: Sequence[Path] = ()) -> Scene:
        """The same scene, looking for its files in another folder.

        Parameters
        ----------
        source : str
            What messages call the scene.
        base_folder : pathlib.Path
            Files are looked up in it and read only from it and below ...
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
        """The same scene with these contents in the place of the files of their names.

        Parameters
        ----------
        **contents : mapping
            By the kind of file and its name: `meshes`, `transforms`, `environments`, `profiles`, `textures` and
            `encoded`, as of `clrender.scene.scene_files.SceneFiles`.

        Returns
        -------
        Scene
        """
        scene = self.model_copy()
        scene._files = self._files.with_contents(**contents)
        if contents.keys() & {"textures", "encoded"}:
            scene._store = []
        return scene

    def remeshed(self, meshes: Sequence[MeshData], lights: Sequence[Light], emitting: bool = True) -> Scene:
        """The same scene with other triangles, in world space, for each of its shapes.

        Parameters
        ----------
        meshes : sequence of MeshData
            One for each shape.
        lights : sequence of Light
            In place of the scene's own.
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
        scene = self.model_copy(update={"shapes": shapes, "lights": tuple(lights)})
        scene._files = replace(self._files, meshes={(f"shape {i}", None): mesh for i, mesh in enumerate(meshes)})
        return scene

    def opened(self, name: str, where: str) -> AbstractContextManager[tuple[BinaryIO, str]]:
        """A picture or IES file that the scene names: `clrender.scene.scene_files.SceneFiles.opened`.

        Parameters
        ----------
        name : str
            As the scene has it.
        where : str
            Place of the name, for messages.

        Returns
        -------
        context manager of (binary file, str)
            The file, and the ending of its format, such as ``.png``.
        """
        return self._files.opened(name, where)

    @property
    def notes(self) -> tuple[str, ...]:
        """What its reader did not understand, and what it did instead; a sentence each."""
        return self._notes

    @property
    def read_files(self) -> tuple[Path, ...]:
        """Files that its reader has read besides the scene file, and that the description does not name."""
        return self._read_files

    def with_notes(self, notes: Iterable[str], read_files: Iterable[Path] = ()) -> Scene:
        """The same scene with these notes, and these more files that were read.

        Parameters
        ----------
        notes : iterable of str
            Sentences.
        read_files : iterable of pathlib.Path

        Returns
        -------
        Scene
        """
        scene = self.model_copy()
        scene._notes, scene._read_files = tuple(notes), (*self._read_files, *read_files)
        return scene

    def with_default_light(self, light: EnvironmentLight, note: str) -> Scene:
        """The same scene, which has no environment, in one that `with_environment` replaces, along with its note.

        Parameters
        ----------
        light : EnvironmentLight
        note : str
            What is told of it.

        Returns
        -------
        Scene
        """
        scene = self.model_copy(update={"lights": (*self.lights, light)})
        scene._default_light = light, note
        return scene

    def placed_textures(self) -> list[tuple[tuple[str | int, ...], AnyTexture]]:
        """All textures of materials and shapes, each with its place in the scene's description."""
        found: list[tuple[tuple[str | int, ...], AnyTexture]] = []
        for name, material in self.materials.items():
            found += [(("materials", name, key), texture) for key, texture in textures_of(material)]
        for at, shape in self.all_shapes():
            if isinstance(shape.emission, ImageTexture | Checker | Ramp):
                found.append(((*at, "emission"), shape.emission))
        return found

    def texture_files(self) -> list[tuple[tuple[str | int, ...], ImageTexture | NormalMap | BumpMap]]:
        """Those that name a file, each with the place of its name."""
        placed = self.placed_textures()
        return [((*at, "texture"), each) for at, each in placed if not isinstance(each, Checker | Ramp)]

    def textures(self) -> TexelStore:
        """The pictures that its materials and shapes name; the files are read once and kept.

        Raises
        ------
        SceneError
            If a file cannot be read or is no sound picture.
        """
        placed = self.placed_textures()
        if self._store and self._store[0].holds(texture for _, texture in placed):
            return self._store[0]
        files = self._files
        textures = [(f"{files.source}: {place((*at, 'texture'))}", texture) for at, texture in placed]
        store = TexelStore(textures, files.base_folder, files.allow_paths, files.textures, files.encoded)
        if self._store:
            self._store = [store]  # this is a copy with other textures of the scene that the store is for
        else:
            self._store.append(store)  # for all copies
        return store

    def mesh(self, index: int) -> MeshData:
        """Triangles of the mesh `shapes[index]`, before its transform; a file is read once and kept.

        Parameters
        ----------
        index : int
            In `shapes`, of a mesh.

        Returns
        -------
        MeshData

        Raises
        ------
        SceneError
            If the file cannot be read or is not a usable mesh.
        """
        shape = self.shapes[index]
        assert isinstance(shape, Mesh)
        return self.mesh_of(self.place_of(index), shape)

    def mesh_of(self, at: tuple[str | int, ...], shape: Mesh) -> MeshData:
        """The same of a mesh of its own or of a group, as of `all_shapes`.

        Parameters
        ----------
        at : tuple of str or int
            Place of the mesh, for messages.
        shape : Mesh

        Returns
        -------
        MeshData
        """
        if shape.file is None:
            return inline_mesh(shape.vertices, shape.faces, shape.uvs, shape.uvs_1, shape.colors)
        return self._files.mesh(at, shape)

    def read_named(self) -> None:
        """Read every file that the scene names, so that nothing is read later.

        Raises
        ------
        SceneError
            If one cannot be read or is not sound.
        """
        for at, shape in self.all_shapes():
            if isinstance(shape, Mesh) and shape.file is not None:
                self.mesh_of(at, shape)
        for index, _ in self.instances():
            self.transforms(index)
        if self.texture_files():
            self.textures()
        self.environment_picture()
        for index, _ in self.ies_lights():
            self.ies_profile(index)

    def transforms(self, index: int) -> TransformArray:
        """Where the instance `shapes[index]` stands; a file is read once and kept.

        Parameters
        ----------
        index : int
            In `shapes`, of an instance.

        Returns
        -------
        TransformArray

        Raises
        ------
        SceneError
            If the file cannot be read or holds no usable transforms.
        """
        instance = self.shapes[index]
        assert isinstance(instance, Instance)
        if instance.file is None:
            return TransformArray.of(instance)
        return self._files.transform_array(instance.file, f"shapes[{index}].transforms")

    @property
    def environment(self) -> EnvironmentLight | None:
        """The scene's only one."""
        return next((light for light in self.lights if isinstance(light, EnvironmentLight)), None)

    @property
    def sky(self) -> SunSkyLight | None:
        """The scene's only one; beside it there is no environment."""
        return next((light for light in self.lights if isinstance(light, SunSkyLight)), None)

    def environment_picture(self) -> EnvironmentPicture | None:
        """The picture of the environment, if it has one; its file is read once and kept.

        Raises
        ------
        SceneError
            If the file cannot be read or is not a usable picture.
        """
        light = self.environment
        if light is None or light.file is None:
            return None
        return self._files.environment(light.file, f"lights[{self.lights.index(light)}].file")

    def with_exposure(
        self, f_stop: float | None = None, shutter: float | None = None, iso: float | None = None
    ) -> Scene:
        """The same scene, its display images exposed otherwise; what is not given stays.

        Parameters
        ----------
        f_stop, shutter, iso : float, optional
            As of `clrender.exposure.photographic_stops`.

        Returns
        -------
        Scene

        Raises
        ------
        UsageError
            When a number is not allowed, or f-stop or shutter is missing then.
        """
        asked = {"f_stop": f_stop, "shutter": shutter, "iso": iso}
        asked = {name: value for name, value in asked.items() if value is not None}
        if not asked:
            return self
        given = {**(self.camera.exposure or {}), **asked}
        photographic_stops(**given)
        return self.model_copy(update={"camera": self.camera.model_copy(update=given)})

    def ies_lights(self) -> list[tuple[int, IesLight]]:
        """The lights that an IES file describes, each with its index."""
        return [(index, light) for index, light in enumerate(self.lights) if isinstance(light, IesLight)]

    def ies_profile(self, index: int) -> IesProfile:
        """What the file of the IES light `lights[index]` says; it is read once and kept.

        Parameters
        ----------
        index : int
            In `lights`, of an IES light.

        Returns
        -------
        IesProfile

        Raises
        ------
        SceneError
            If the file cannot be read or is no sound IES file.
        """
        light = self.lights[index]
        assert isinstance(light, IesLight)
        return self._files.profile(light.file, f"lights[{index}].file")

    def with_environment(self, environment: str | Path | float) -> Scene:
        """The same scene, which has no environment of its own, in one.

        Parameters
        ----------
        environment : str, pathlib.Path or float
            A `.exr`, `.hdr` or `.png` in latitude and longitude, anywhere; or a radiance, W/(sr m2), the same from all
            around.

        Returns
        -------
        Scene

        Raises
        ------
        SceneError
            If the scene has an environment, or the file cannot be read or is not a usable picture, or the number is no
            radiance.
        """
        around = self.environment or self.sky
        if around is not None and around is not self._default_light[0]:
            place = f"{self.source}: lights[{self.lights.index(around)}]"
            raise SceneError(f"{place}: is an environment already; remove it, or do not ask for another")
        default, note = self._default_light
        others = tuple(light for light in self.lights if light is not default)
        light, pictures = _environment(environment)
        scene = self.model_copy(update={"lights": (*others, light)}).with_files(environments=pictures)
        scene._default_light = None, ""
        return scene.with_notes(each for each in self._notes if default is None or not each.endswith(note))

    def sha256(self) -> str:
        """Hash of what the scene holds, wherever it lies and however it was written.

        Its title, the names of its shapes, its defaults for a render's settings and the exposure of display images do
        not count; which settings made an image is said beside it.

        Returns
        -------
        str
            64 hexadecimal digits. A mesh file counts by its vertices, normals and triangles, a picture by its pixels,
            an IES file by its intensities, none by its name.
        """
        return content_sha256(self, {"title", "render"})

    def content_sha256(self) -> str:
        """The same of shapes, materials and lights alone: whoever looks at them, and however."""
        return content_sha256(self, {"title", "camera", "image", "render"})


def _environment(asked: str | Path | float) -> tuple[EnvironmentLight, dict[str, EnvironmentPicture]]:
    """The environment that a user asks for, and its picture by the name that it has there."""
    if not isinstance(asked, str | Path):
        if not 0.0 <= asked <= POWER_LIMIT:
            raise SceneError(f"the environment is {asked!r}, but a radiance must be from 0 to {POWER_LIMIT:g}")
        return EnvironmentLight(type="environment", radiance=(float(asked),) * 3), {}
    path = Path(asked).absolute()
    picture = EnvironmentPicture.read(path.name, path.parent, [path.resolve().parent], "the environment")
    return EnvironmentLight(type="environment", file=str(path)), {str(path): picture}
