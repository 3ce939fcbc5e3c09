"""The tables of a scene, and what the files hold that they name."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Final, TypeVar

import numpy as np
from pydantic import AfterValidator, FailFast, Field, PrivateAttr

from clrender.curves import CurveData
from clrender.errors import SceneError
from clrender.grids import GridData
from clrender.measured import MeasuredFile
from clrender.meshes.data import MeshData, inline_mesh
from clrender.meshes.smooth import smoothed
from clrender.plugins import Plugin
from clrender.scene.camera import Camera
from clrender.scene.contents_memo import ContentsMemo
from clrender.scene.defaults import Image, Render
from clrender.scene.environment import EnvironmentPicture
from clrender.scene.frozen import FrozenDict
from clrender.scene.groups import Group, Instance, ShapeOrInstance, TransformArray
from clrender.scene.ies import IesProfile
from clrender.scene.light_kinds import (
    MOVING_LIGHTS,
    EnvironmentLight,
    IesLight,
    Light,
    ProjectorLight,
    SunSkyLight,
)
from clrender.scene.materials import (
    Material,
    Measured,
)
from clrender.scene.medium import Grid, Medium
from clrender.scene.pictures import TexelStore
from clrender.scene.scene_files import SceneFiles
from clrender.scene.shapes import AnyShape, Curves, Mesh
from clrender.scene.textures import (
    AnyTexture,
    BumpMap,
    Checker,
    ImageTexture,
    NormalMap,
    PluginTexture,
    Ramp,
    ThicknessMap,
    textures_of,
)
from clrender.scene.values import (
    SHAPE_LIMIT,
    Name,
    Part,
    Text,
)
from clrender.wording import place

if TYPE_CHECKING:
    pass

__all__ = ["HEAD", "Head", "SceneContents"]

HEAD: Final = frozenset({"title", "camera", "image", "render"})
"""Attributes of a scene that are not part of its contents."""

_T = TypeVar("_T")
_FREEZE: Final = AfterValidator(FrozenDict)


class Head(Part):
    """What a scene says besides its contents."""

    title: Text = ""
    camera: Camera
    image: Image = Image()
    render: Render = Render()


class SceneContents(Head):
    """Everything that a scene says; see `clrender.scene.description.Scene`."""

    materials: Annotated[dict[Name, Material], Field(max_length=65536), _FREEZE] = Field(default_factory=FrozenDict)
    shapes: Annotated[tuple[ShapeOrInstance, ...], FailFast(), Field(max_length=SHAPE_LIMIT)] = ()
    groups: Annotated[dict[Name, Group], Field(max_length=65536), _FREEZE] = Field(default_factory=FrozenDict)
    lights: Annotated[tuple[Light, ...], FailFast(), Field(max_length=SHAPE_LIMIT)] = ()
    media: Annotated[dict[Name, Medium], Field(max_length=65536), _FREEZE] = Field(default_factory=FrozenDict)
    fog: Name | None = Field(
        None, description="name of the medium that fills all space outside other media, to infinity"
    )

    _files: SceneFiles = PrivateAttr(default_factory=SceneFiles)
    _store: list[TexelStore] = PrivateAttr(default_factory=list)
    _memo: list[ContentsMemo] = PrivateAttr(default_factory=list)
    _places: tuple[tuple[str | int, ...], ...] = PrivateAttr(default=())
    _plugins: tuple[Plugin, ...] = PrivateAttr(default=())

    def all_shapes(self) -> Iterator[tuple[tuple[str | int, ...], AnyShape]]:
        """Its shapes and those of its groups, without instances, each with its location in the description.

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

    def mesh_files(self) -> Iterator[tuple[tuple[str | int, ...], Mesh]]:
        """Its meshes from files, also those of poses, each with the location of its table in the description."""
        for at, shape in self.all_shapes():
            if isinstance(shape, Mesh) and shape.file is not None:
                yield at, shape
                for number in range(len(shape.poses)):
                    yield (*at, "poses", number), shape.posed(number)

    def curve_files(self) -> Iterator[tuple[tuple[str | int, ...], Curves]]:
        """Its curves from files, each with the location of its table in the description."""
        for at, shape in self.all_shapes():
            if isinstance(shape, Curves) and shape.file is not None:
                yield at, shape

    @property
    def has_motion(self) -> bool:
        """Whether any shape, instance or light has keys of a motion, or poses, whenever they are."""

        def found() -> bool:
            if any(isinstance(light, MOVING_LIGHTS) and light.motion for light in self.lights):
                return True
            if any(isinstance(each, Instance) and each.motion for each in self.shapes):
                return True
            return any(each.motion or (isinstance(each, Mesh) and each.poses) for _, each in self.all_shapes())

        return self.of_contents("has motion", found)

    @property
    def has_shadow_catchers(self) -> bool:
        """Whether any shape is a shadow catcher. Then the camera does not see the environment, either."""
        return self.of_contents("shadow catchers", lambda: any(shape.shadow_catcher for _, shape in self.all_shapes()))

    @property
    def shows_environment(self) -> bool:
        """Whether the camera sees an environment, or the sky, behind everything."""
        around = (self.environment, self.sky)
        return not self.has_shadow_catchers and any(light is not None and light.visible_to_camera for light in around)

    @property
    def plain_shapes(self) -> tuple[AnyShape, ...]:
        """Its shapes, of a scene whose instances `clrender.flatten.assembly` has resolved."""
        return self.shapes  # type: ignore[return-value]

    def instances(self) -> Iterator[tuple[int, Instance]]:
        """Its instances, each with its index.

        Yields
        ------
        index : int
            Index in `shapes`.
        instance : Instance
        """
        for index, shape in enumerate(self.shapes):
            if isinstance(shape, Instance):
                yield index, shape

    def place_of(self, index: int) -> tuple[str | int, ...]:
        """Location of `shapes[index]` in the description: in `shapes`, or in a group after `clrender.flatten.assembly`.

        Parameters
        ----------
        index : int
            Index in `shapes`.

        Returns
        -------
        tuple of str or int
        """
        return self._places[index] if self._places else ("shapes", index)

    @property
    def files(self) -> SceneFiles:
        """The files that the scene names, and what they hold."""
        return self._files

    @property
    def plugins(self) -> tuple[Plugin, ...]:
        """The plugins that were given for it, sorted by name; a scene file names none."""
        return self._plugins

    @property
    def base_folder(self) -> Path:
        """Folder to which file names are relative: the scene file's own, or the working folder."""
        return self._files.base_folder

    @property
    def source(self) -> str:
        """Name of the scene file, for messages."""
        return self._files.source

    @property
    def environment(self) -> EnvironmentLight | None:
        """The environment light, of which a scene has at most one."""
        return next((light for light in self.lights if isinstance(light, EnvironmentLight)), None)

    @property
    def sky(self) -> SunSkyLight | None:
        """The sun and sky, of which a scene has at most one, and then no environment light."""
        return next((light for light in self.lights if isinstance(light, SunSkyLight)), None)

    def ies_lights(self) -> list[tuple[int, IesLight]]:
        """The IES lights, each with its index."""
        return [(index, light) for index, light in enumerate(self.lights) if isinstance(light, IesLight)]

    def pictured_lights(self) -> list[tuple[int, EnvironmentLight | ProjectorLight]]:
        """The lights that name a picture, each with its index."""
        kinds = (EnvironmentLight, ProjectorLight)
        found = ((index, light) for index, light in enumerate(self.lights) if isinstance(light, kinds))
        return [(index, light) for index, light in found if light.file is not None]

    def placed_textures(self) -> list[tuple[tuple[str | int, ...], AnyTexture]]:
        """All textures of materials and shapes but those of plugins, each with its location in the description."""
        found: list[tuple[tuple[str | int, ...], AnyTexture]] = []
        for name, material in self.materials.items():
            for key, texture in textures_of(material):
                if not isinstance(texture, PluginTexture):
                    found.append((("materials", name, *key.split(".", 1)), texture))
        for at, shape in self.all_shapes():
            if isinstance(shape.emission, ImageTexture | Checker | Ramp):
                found.append(((*at, "emission"), shape.emission))
        return found

    def texture_files(self) -> list[tuple[tuple[str | int, ...], ImageTexture | NormalMap | BumpMap | ThicknessMap]]:
        """Textures that name a file, each with the location of the name."""
        placed = self.placed_textures()
        return [((*at, "texture"), each) for at, each in placed if not isinstance(each, Checker | Ramp)]

    def textures(self) -> TexelStore:
        """The images that its materials and shapes name; files are read once and cached.

        Raises
        ------
        SceneError
            If a file cannot be read or is not a valid image.
        """
        placed = self.placed_textures()
        if self._store and self._store[0].holds(texture for _, texture in placed):
            return self._store[0]
        files = self._files
        textures = [(f"{files.source}: {place((*at, 'texture'))}", texture) for at, texture in placed]
        store = TexelStore(textures, files.base_folder, files.allow_paths, files.textures, files.encoded)
        if self._store:
            self._store = [store]  # this copy has other textures than the scene that the store was made for
        else:
            self._store.append(store)  # for all copies
        return store

    def mesh(self, index: int) -> MeshData:
        """Triangles of the mesh `shapes[index]`, before its transform; a file is read once and cached.

        Parameters
        ----------
        index : int
            Index of a mesh in `shapes`.

        Raises
        ------
        SceneError
            If the file cannot be read or is not a usable mesh.
        """
        shape = self.shapes[index]
        assert isinstance(shape, Mesh)
        return self.mesh_of(self.place_of(index), shape)

    def mesh_of(self, at: tuple[str | int, ...], shape: Mesh) -> MeshData:
        """Like `mesh`, for any mesh that `all_shapes` yields.

        Parameters
        ----------
        at : tuple of str or int
            Location of the mesh, for error messages.
        shape : Mesh
        """
        if shape.file is None:
            mesh = inline_mesh(shape.vertices, shape.faces, shape.uvs, shape.uvs_1, shape.colors)
            return mesh if shape.smooth_angle is None else smoothed(mesh, shape.smooth_angle)
        return self._files.mesh(at, shape)

    def strands(self, at: tuple[str | int, ...], shape: Curves) -> CurveData:
        """Control points of curves, before their transform; a file is read once and cached.

        Parameters
        ----------
        at : tuple of str or int
            Location of the shape in the description, for error messages.
        shape : Curves

        Raises
        ------
        SceneError
            If the file cannot be read or holds no strands.
        """
        if shape.file is not None:
            return self._files.strands(shape.file, place((*at, "file")))
        points = np.array(shape.points, np.float64)
        return CurveData(points, None, np.array(shape.counts or [len(points)], np.int64))

    def transforms(self, index: int) -> TransformArray:
        """Transforms of the instance `shapes[index]`; a file is read once and cached.

        Parameters
        ----------
        index : int
            Index of an instance in `shapes`.

        Raises
        ------
        SceneError
            If the file cannot be read or contains no usable transforms.
        """
        instance = self.shapes[index]
        assert isinstance(instance, Instance)
        if instance.file is None:
            return TransformArray.of(instance)
        return self._files.transform_array(instance.file, f"shapes[{index}].transforms")

    def environment_picture(self) -> EnvironmentPicture | None:
        """The environment map, if there is one; its file is read once and cached.

        Raises
        ------
        SceneError
            If the file cannot be read or is not a usable image.
        """
        light = self.environment
        if light is None or light.file is None:
            return None
        return self.light_picture(self.lights.index(light))

    def light_picture(self, index: int) -> EnvironmentPicture:
        """Picture that `lights[index]` names; its file is read once and cached.

        Parameters
        ----------
        index : int
            Index in `lights`, one of `pictured_lights`.

        Raises
        ------
        SceneError
            If the file cannot be read or is not a usable image.
        """
        light = self.lights[index]
        assert isinstance(light, EnvironmentLight | ProjectorLight) and light.file is not None
        return self._files.environment(light.file, f"lights[{index}].file")

    def ies_profile(self, index: int) -> IesProfile:
        """Profile of the IES light `lights[index]`; its file is read once and cached.

        Parameters
        ----------
        index : int
            Index of an IES light in `lights`.

        Returns
        -------
        IesProfile

        Raises
        ------
        SceneError
            If the file cannot be read or is not a valid IES file.
        """
        light = self.lights[index]
        assert isinstance(light, IesLight)
        return self._files.profile(light.file, f"lights[{index}].file")

    def measured_materials(self) -> Iterator[tuple[str, Measured]]:
        """Its measured materials, each with its name."""
        for name, material in self.materials.items():
            if isinstance(material, Measured):
                yield name, material

    def measured(self, name: str, material: Measured) -> MeasuredFile:
        """The reflectance that a material names; its file is read once and cached.

        Parameters
        ----------
        name : str
            Name of the material, for error messages.
        material : Measured

        Raises
        ------
        SceneError
            If the file cannot be read or holds no measured reflectance.
        """
        return self._files.measured_file(material.file, place(("materials", name, "file")))

    def used_media(self) -> set[str]:
        """Names of the media that shapes or the fog are of."""
        names = {shape.interior for _, shape in self.all_shapes()} | {self.fog}
        return {name for name in names if name is not None}

    def grids(self) -> Iterator[tuple[tuple[str, str, str], Grid]]:
        """The grids of its media, each with the location of its table in the description."""
        for name, medium in self.media.items():
            for key, grid in medium.grids.given() if medium.grids is not None else ():
                yield ("media", name, key), grid

    def grid(self, medium: str, key: str, grid: Grid) -> GridData:
        """The grid that a medium names; its file is read once and cached.

        Parameters
        ----------
        medium, key : str
            Name of the medium, and key of the grid in its table.
        grid : Grid

        Raises
        ------
        SceneError
            If the file cannot be read or is no usable grid.
        """
        where = place(("media", medium, key, "file"))
        data = self._files.grid(grid, where)
        if key in ("density", "temperature") and data.channels != 1:
            raise SceneError(f"{self.source}: {where} has colours, but a {key} is one number; convert it")
        if key == "albedo" and float(data.values.max()) > 1.0:
            raise SceneError(f"{self.source}: {where} goes beyond 1, which scatters more light than it gets; divide it")
        return data

    def read_named(self) -> None:
        """Read every file that the scene names, so that none is read later.

        Raises
        ------
        SceneError
            If one cannot be read or is invalid.
        """
        for at, shape in self.mesh_files():
            self.mesh_of(at, shape)
        for index, _ in self.instances():
            self.transforms(index)
        if self.texture_files():
            self.textures()
        for at, curves in self.curve_files():
            self.strands(at, curves)
        for (_, name, key), grid in self.grids():
            self.grid(name, key, grid)
        for name, material in self.measured_materials():
            self.measured(name, material)
        self.read_lights()

    def read_lights(self) -> None:
        """Read the files that its lights name. Raises like `read_named`."""
        for index, _ in self.pictured_lights():
            self.light_picture(index)
        for index, _ in self.ies_lights():
            self.ies_profile(index)

    def of_contents(self, name: str, compute: Callable[[], _T]) -> _T:
        """A value that depends on the contents alone, kept for all copies of the scene that share them.

        Parameters
        ----------
        name : str
            Of the value.
        compute : callable
            Returns the value; called if it is not known yet. If it raises an error, nothing is kept.

        Returns
        -------
        object
            As `compute` returns it.
        """
        contents = self._contents()
        if not self._memo:
            self._memo.append(ContentsMemo(contents))  # for all copies
        elif not self._memo[0].holds(contents):
            self._memo = [ContentsMemo(contents)]
        return self._memo[0].value(name, compute)

    def _contents(self) -> tuple[object, ...]:
        """Its files, plugins, and every object but those of `HEAD`, in the order of their names."""
        return (
            self._files,
            self._plugins,
            *(self.__dict__[name] for name in _content_names(type(self))),
        )


@cache
def _content_names(kind: type[SceneContents]) -> tuple[str, ...]:
    return tuple(sorted(kind.model_fields.keys() - HEAD))
