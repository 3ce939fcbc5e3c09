"""What a scene is: the validated model behind a scene file, without any file access.

Every table of the file is one frozen pydantic model with unknown keys forbidden, so that a misspelt key is an error
and never ignored. Numbers are finite and bounded here; what needs more than one number (a camera that looks at itself,
a transform that squashes a sphere) is checked by the model that holds them. `validation_errors.py` words the errors.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, BinaryIO

import numpy as np
from numpy.typing import NDArray
from pydantic import FailFast, Field, PrivateAttr, Strict, create_model, model_validator

from clrender.errors import SceneError
from clrender.exposure import PHOTOGRAPHIC, photographic_stops
from clrender.integrators import INTEGRATORS
from clrender.scene.camera import Camera
from clrender.scene.environment import EnvironmentPicture
from clrender.scene.groups import Group, Instance, ShapeOrInstance, TransformArray
from clrender.scene.ies import IesProfile, read_ies
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
    BASE_COLORS,
    MATERIAL_TYPES,
    MIX_DEPTH,
    Dielectric,
    Lambert,
    Material,
    Mirror,
    Mix,
    Principled,
    Subsurface,
    material_without_color,
)
from clrender.scene.medium import Medium
from clrender.scene.mesh_data import MeshData, inline_mesh
from clrender.scene.mesh_io import read_mesh
from clrender.scene.named_files import open_named_file
from clrender.scene.shapes import AnyShape, Mesh
from clrender.scene.texels import StoredPicture, TexelStore
from clrender.scene.textures import AnyTexture, BumpMap, Checker, ImageTexture, NormalMap, Ramp, textures_of
from clrender.scene.values import (
    POWER_LIMIT,
    SHAPE_LIMIT,
    Name,
    Part,
    SettingValue,
    fault,
)
from clrender.scene.vertex_colors import VertexColors
from clrender.scene.wording import place, quoted, suggestion
from clrender.settings import PIXEL_LIMIT, SETTINGS, not_taken

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

# --- image, render ---------------------------------------------------------------------------------------------------


def _keys(section: str) -> dict[str, Any]:
    """What a table of the scene file may hold, of the table of settings."""
    of_it = [setting for setting in SETTINGS.values() if setting.section == section]
    return {setting.name: (Annotated[Any, SettingValue(setting)], setting.default) for setting in of_it}


class _Size(Part):
    @model_validator(mode="after")
    def _fits(self) -> _Size:
        assert isinstance(self, Image)
        if self.width * self.height > PIXEL_LIMIT:
            size = f"{self.width} x {self.height} is {self.width * self.height} pixels"
            raise fault("image", f"is too large: {size}, but {PIXEL_LIMIT} is the most")
        return self


class _Defaults(Part):
    @model_validator(mode="after")
    def _go_together(self) -> _Defaults:
        values = self.model_dump()
        for name, allowed in INTEGRATORS[values["integrator"]].takes.items():
            if values[name] not in allowed:
                raise fault("setting", not_taken(name, values[name], values["integrator"]), name)
        return self


if TYPE_CHECKING:

    class Image(_Size):
        """Size of the image."""

        width: int = 800
        height: int = 800

    class Render(_Defaults):
        """Defaults of a render's settings; the command line wins."""

        def __getattr__(self, name: str) -> Any: ...

else:
    Image = create_model("Image", __base__=_Size, __doc__="Size of the image.", **_keys("image"))
    Render = create_model(
        "Render",
        __base__=_Defaults,
        __doc__="Defaults of a render's settings; the command line wins.",
        **_keys("render"),
    )


# --- the whole -------------------------------------------------------------------------------------------------------


def _working_folder() -> Path:
    try:
        return Path.cwd()
    except FileNotFoundError:  # deleted under our feet; only a scene that names files has to know
        return Path()


class Scene(Part):
    """A scene: what a scene file says, validated.

    Read one with `clrender.scene.load`, or build one in code from the classes of this package; a bad value raises
    `clrender.errors.SceneError` either way.
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
    fog: Name | None = Field(None, description="name of a medium that is wherever no other one is, without end")

    _base_folder: Path = PrivateAttr(default_factory=_working_folder)
    _allow_paths: tuple[Path, ...] = PrivateAttr(default=())
    _source: str = PrivateAttr(default="Scene")
    _meshes: dict[tuple[str, VertexColors | None], MeshData] = PrivateAttr(default_factory=dict)
    _pictures: dict[str, EnvironmentPicture] = PrivateAttr(default_factory=dict)
    _profiles: dict[str, IesProfile] = PrivateAttr(default_factory=dict)
    _given: dict[str, tuple[StoredPicture, NDArray[np.uint8]]] = PrivateAttr(default_factory=dict)
    _transforms: dict[str, TransformArray] = PrivateAttr(default_factory=dict)
    _places: tuple[tuple[str | int, ...], ...] = PrivateAttr(default=())
    _encoded: dict[str, tuple[bytes, str]] = PrivateAttr(default_factory=dict)
    _store: list[TexelStore] = PrivateAttr(default_factory=list)
    _notes: tuple[str, ...] = PrivateAttr(default=())
    _read_files: tuple[Path, ...] = PrivateAttr(default=())
    _default_light: tuple[Light | None, str] = PrivateAttr(default=(None, ""))
    _origin: dict[str, Any] | None = PrivateAttr(default=None)

    @model_validator(mode="after")
    def _names_resolve(self) -> Scene:
        for at, shape in self.all_shapes():
            if shape.material is not None and shape.material not in self.materials:
                sentence = f"names a material {quoted(shape.material)} that does not exist"
                raise fault("reference", sentence + suggestion(shape.material, self.materials), *at, "material")
            if shape.material is not None and shape.emission is not None and _shines(self.materials[shape.material]):
                other = place(("materials", shape.material, "emission"))
                raise fault("reference", f"is given beside {other}; keep one of them", *at, "emission")
        for i, instance in self.instances():
            if instance.group not in self.groups:
                sentence = f"names a group {quoted(instance.group)} that does not exist"
                raise fault("reference", sentence + suggestion(instance.group, self.groups), "shapes", i, "group")
        self._media_resolve()
        self._mixtures_resolve()
        self._colors_have_materials()
        environments = [i for i, light in enumerate(self.lights) if isinstance(light, EnvironmentLight | SunSkyLight)]
        for i in environments[1:]:
            sentence = f"is a second environment beside lights[{environments[0]}]; a scene can have only one"
            raise fault("light", sentence, "lights", i)
        return self

    def _media_resolve(self) -> None:
        """The media that shapes and the fog name exist, and light gets into them."""
        named: list[tuple[str | None, tuple[str | int, ...]]] = [(self.fog, ("fog",))]
        named += [(shape.interior, (*at, "interior")) for at, shape in self.all_shapes()]
        for name, at in named:
            if name is not None and name not in self.media:
                sentence = f"names a medium {quoted(name)} that does not exist"
                raise fault("reference", sentence + suggestion(name, self.media), *at)
        for at, shape in self.all_shapes():
            if shape.interior is None or shape.material is None:
                continue
            material = self.materials[shape.material]
            if isinstance(material, Subsurface):
                sentence = f"is given, but the material {quoted(shape.material)} is subsurface and fills its shapes"
                raise fault("reference", f"{sentence}; leave one of them out", *at, "interior")
            if not isinstance(material, Dielectric | Principled) or not material.solid:
                sentence = f"is given, but the material {quoted(shape.material)} lets no light inside"
                cure = "give the shape a dielectric, or leave its material out"
                raise fault("reference", f"{sentence}; {cure}", *at, "interior")
            if material.attenuation_color is not None:
                other = place(("materials", shape.material, "attenuation_color"))
                raise fault("reference", f"is given beside {other}; keep one of them", *at, "interior")

    def _mixtures_resolve(self) -> None:
        """Each material of a mixture exists, and none contains itself."""
        for name, material in self.materials.items():
            if not isinstance(material, Mix):
                continue
            for i, part in enumerate(material.materials):
                if part not in self.materials:
                    sentence = f"names a material {quoted(part)} that does not exist"
                    sentence += suggestion(part, self.materials)
                    raise fault("reference", sentence, "materials", name, "materials", i)
                if self.materials[part].masked:
                    sentence = f"names {quoted(part)}, which has an opacity; give the mixture one instead"
                    raise fault("reference", sentence, "materials", name, "materials", i)
                if isinstance(self.materials[part], Subsurface):
                    sentence = f"names {quoted(part)}, which is subsurface: what fills a shape cannot be mixed"
                    raise fault("reference", f"{sentence}; name another", "materials", name, "materials", i)
                if _shines(self.materials[part]):
                    sentence = f"names {quoted(part)}, which has emission; in a mixture it must have none"
                    sentence += ": give the emission to the shapes instead"
                    raise fault("reference", sentence, "materials", name, "materials", i)
        for name in self.materials:
            parts, depth = {name}, 0
            while mixed := {p for n in parts if isinstance(m := self.materials[n], Mix) for p in m.materials}:
                parts, depth = mixed, depth + 1
                if name in parts or depth > MIX_DEPTH:
                    reason = "contains itself" if name in parts else f"is nested more than {MIX_DEPTH} deep"
                    raise fault("reference", f"{reason}; give two other materials", "materials", name, "materials")

    def _colors_have_materials(self) -> None:
        """What colours of vertices multiply is there."""
        for at, shape in self.all_shapes():
            if not isinstance(shape, Mesh) or shape.color_key is None:
                continue
            if shape.material is None:
                sentence = "is given, but the shape has no material whose colour it could multiply; name one"
                raise fault("mesh", sentence, *at, shape.color_key)
            plain = material_without_color(self.materials, shape.material)
            if plain is not None:
                sentence = f"would multiply the colour of the material {quoted(plain)}, which has none"
                cure = f"give it one of {', '.join(BASE_COLORS)}, or leave {shape.color_key} out"
                raise fault("mesh", f"{sentence}; {cure}", *at, shape.color_key)

    def all_shapes(self) -> Iterator[tuple[tuple[str | int, ...], AnyShape]]:
        """Its shapes and those of its groups, each with its place in the scene's description; no instances."""
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
        """Those of its shapes that place a group, each with its index."""
        for index, shape in enumerate(self.shapes):
            if isinstance(shape, Instance):
                yield index, shape

    def place_of(self, index: int) -> tuple[str | int, ...]:
        """Where `shapes[index]` stands in the description: there, or in a group if `clrender.scene.assembly` put it."""
        return self._places[index] if self._places else ("shapes", index)

    def assembled(self, shapes: Sequence[tuple[tuple[str | int, ...], AnyShape]]) -> Scene:
        """The same scene with these shapes, each with its place in the description, and no groups."""
        scene = self.model_copy(update={"shapes": tuple(shape for _, shape in shapes), "groups": {}})
        scene._places = tuple(at for at, _ in shapes)
        return scene

    @property
    def base_folder(self) -> Path:
        """Folder against which files are looked up: the scene file's own, or the working folder."""
        return self._base_folder

    @property
    def source(self) -> str:
        """Name of the scene file for messages."""
        return self._source

    @property
    def origin(self) -> dict[str, Any] | None:
        """Arguments of `clrender.load` that gave this scene, or the one that it was made from; None: made in code."""
        return self._origin

    def with_origin(self, origin: Mapping[str, Any]) -> Scene:
        """The same scene, which was loaded with these arguments, JSON-able."""
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
        """
        scene = self.model_copy()
        scene._source, scene._base_folder, scene._allow_paths = source, base_folder, tuple(allow_paths)
        scene._meshes, scene._pictures, scene._profiles, scene._store = {}, {}, {}, []
        scene._transforms = {}
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
        """
        shapes = tuple(
            Mesh(type="mesh", file=f"shape {i}", material=s.material, emission=s.emission if emitting else None)
            for i, s in enumerate(self.shapes)
        )
        scene = self.model_copy(update={"shapes": shapes, "lights": tuple(lights)})
        scene._meshes = {(f"shape {i}", None): mesh for i, mesh in enumerate(meshes)}
        return scene

    def with_meshes(self, meshes: Mapping[tuple[str, VertexColors | None], MeshData]) -> Scene:
        """The same scene with these meshes in the place of files: `clrender.scene.Mesh.asset`."""
        scene = self.model_copy()
        scene._meshes = {**self._meshes, **meshes}
        return scene

    def with_textures(self, pictures: Mapping[str, tuple[StoredPicture, NDArray[np.uint8]]]) -> Scene:
        """The same scene with these pictures, each with its tiles, in the place of the files of these names."""
        scene = self.model_copy()
        scene._given, scene._store = {**self._given, **pictures}, []
        return scene

    def with_encoded_textures(self, pictures: Mapping[str, tuple[bytes, str]]) -> Scene:
        """The same scene with these encoded pictures and their formats' endings in place of such files."""
        scene = self.model_copy()
        scene._encoded, scene._store = {**self._encoded, **pictures}, []
        return scene

    @contextmanager
    def opened(self, name: str, where: str) -> Iterator[tuple[BinaryIO, str]]:
        """A picture or lamp that the scene names, encoded as it is, and the ending of its format.

        Parameters
        ----------
        name : str
            As the scene has it.
        where : str
            Place of the name, for messages.

        Raises
        ------
        SceneError
            As of `clrender.scene.named_files.open_named_file`.
        """
        if name in self._encoded:
            data, ending = self._encoded[name]
            yield BytesIO(data), ending
            return
        label = f"{self._source}: {where}: {quoted(name)}"
        file, _ = open_named_file(name, self._base_folder, self._allow_paths, label, 2**33)
        with file:
            yield file, Path(name).suffix.lower()

    @property
    def notes(self) -> tuple[str, ...]:
        """What its reader did not understand, and what it did instead; a sentence each."""
        return self._notes

    @property
    def read_files(self) -> tuple[Path, ...]:
        """Files that its reader has read besides the scene file, and that the description does not name."""
        return self._read_files

    def with_notes(self, notes: Iterable[str], read_files: Iterable[Path] = ()) -> Scene:
        """The same scene with these notes, and these more files that were read."""
        scene = self.model_copy()
        scene._notes, scene._read_files = tuple(notes), (*self._read_files, *read_files)
        return scene

    def with_default_light(self, light: EnvironmentLight, note: str) -> Scene:
        """The same scene, which has no environment, in one that `with_environment` replaces, along with its note."""
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
        textures = [(f"{self._source}: {place((*at, 'texture'))}", texture) for at, texture in placed]
        store = TexelStore(textures, self._base_folder, self._allow_paths, self._given, self._encoded)
        if self._store:
            self._store = [store]  # this is a copy with other textures of the scene that the store is for
        else:
            self._store.append(store)  # for all copies
        return store

    def mesh(self, index: int) -> MeshData:
        """Triangles of the mesh `shapes[index]`, before its transform; a file is read once and kept.

        Raises
        ------
        SceneError
            If the file cannot be read or is not a usable mesh.
        """
        shape = self.shapes[index]
        assert isinstance(shape, Mesh)
        return self.mesh_of(self.place_of(index), shape)

    def mesh_of(self, at: tuple[str | int, ...], shape: Mesh) -> MeshData:
        """The same of a mesh of its own or of a group, as of `all_shapes`."""
        if shape.file is None:
            return inline_mesh(shape.vertices, shape.faces, shape.uvs, shape.uvs_1, shape.colors)
        if shape.asset not in self._meshes:
            where = f"{self._source}: {place((*at, 'file'))}"
            self._meshes[shape.asset] = read_mesh(
                shape.file, self._base_folder, self._allow_paths, where, shape.vertex_colors
            )
        return self._meshes[shape.asset]

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

        Raises
        ------
        SceneError
            If the file cannot be read or holds no usable transforms.
        """
        instance = self.shapes[index]
        assert isinstance(instance, Instance)
        if instance.file is None:
            return TransformArray.of(instance)
        if instance.file not in self._transforms:
            where = f"{self._source}: shapes[{index}].transforms"
            self._transforms[instance.file] = TransformArray.read(
                instance.file, self._base_folder, self._allow_paths, where
            )
        return self._transforms[instance.file]

    def with_transforms(self, arrays: Mapping[str, TransformArray]) -> Scene:
        """The same scene with these in the place of the files of these names."""
        scene = self.model_copy()
        scene._transforms = {**self._transforms, **arrays}
        return scene

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
        if light.file not in self._pictures:
            place = f"{self._source}: lights[{self.lights.index(light)}].file"
            self._pictures[light.file] = EnvironmentPicture.read(
                light.file, self._base_folder, self._allow_paths, place
            )
        return self._pictures[light.file]

    def with_pictures(self, pictures: Mapping[str, EnvironmentPicture]) -> Scene:
        """The same scene with these pictures in the place of the files of these names."""
        scene = self.model_copy()
        scene._pictures = {**self._pictures, **pictures}
        return scene

    def with_exposure(
        self, f_stop: float | None = None, shutter: float | None = None, iso: float | None = None
    ) -> Scene:
        """The same scene, its display images exposed otherwise; what is not given stays.

        Parameters
        ----------
        f_stop, shutter, iso : float, optional
            As of `clrender.exposure.photographic_stops`.

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

        Raises
        ------
        SceneError
            If the file cannot be read or is no sound IES file.
        """
        light = self.lights[index]
        assert isinstance(light, IesLight)
        if light.file not in self._profiles:
            where = f"{self._source}: lights[{index}].file"
            self._profiles[light.file] = read_ies(light.file, self._base_folder, self._allow_paths, where)
        return self._profiles[light.file]

    def with_profiles(self, profiles: Mapping[str, IesProfile]) -> Scene:
        """The same scene with these in the place of the IES files of these names."""
        scene = self.model_copy()
        scene._profiles = {**self._profiles, **profiles}
        return scene

    def with_environment(self, environment: str | Path | float) -> Scene:
        """The same scene, which has no environment of its own, in one.

        Parameters
        ----------
        environment : str, pathlib.Path or float
            A `.exr`, `.hdr` or `.png` in latitude and longitude, anywhere; or a radiance, W/(sr m2), the same from all
            around.

        Raises
        ------
        SceneError
            If the scene has an environment, or the file cannot be read or is not a usable picture, or the number is no
            radiance.
        """
        around = self.environment or self.sky
        if around is not None and around is not self._default_light[0]:
            place = f"{self._source}: lights[{self.lights.index(around)}]"
            raise SceneError(f"{place}: is an environment already; remove it, or do not ask for another")
        default, note = self._default_light
        others = tuple(light for light in self.lights if light is not default)
        light, pictures = _environment(environment)
        scene = self.model_copy(update={"lights": (*others, light)}).with_pictures(pictures)
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
        return self._hash_without({"title", "render"})

    def content_sha256(self) -> str:
        """The same of shapes, materials and lights alone: whoever looks at them, and however."""
        return self._hash_without({"title", "camera", "image", "render"})

    def _hash_without(self, left_out: set[str]) -> str:
        content = self.model_dump(mode="json", exclude=left_out)
        for key in PHOTOGRAPHIC:
            content.get("camera", {}).pop(key, None)
        if not self.camera.mirrored:  # a key that is younger than hashes in films
            content.get("camera", {}).pop("mirrored", None)
        if not self.groups:  # likewise
            content.pop("groups", None)
        for index in range(len(self.shapes)):
            content["shapes"][index].pop("name", None)
        for at, shape in self.all_shapes():
            if at[0] == "groups":
                content["groups"][at[1]]["shapes"][at[3]].pop("name", None)
            if isinstance(shape, Mesh) and shape.file is not None:
                put_at(content, (*at, "file"), self.mesh_of(at, shape).sha256())
        for index, instance in self.instances():
            if instance.file is not None:
                content["shapes"][index]["transforms"] = self.transforms(index).sha256()
        picture = self.environment_picture()
        for light in content["lights"]:
            if light["type"] == "environment" and picture is not None:
                light["file"] = picture.sha256()
        for index, _ in self.ies_lights():
            content["lights"][index]["file"] = self.ies_profile(index).sha256()
        if named := self.texture_files():
            store = self.textures()
            for at, texture in named:
                put_at(content, at, store.picture(texture).sha256)
        return hashlib.sha256(json.dumps(content, sort_keys=True, separators=(",", ":")).encode()).hexdigest()


def _environment(asked: str | Path | float) -> tuple[EnvironmentLight, dict[str, EnvironmentPicture]]:
    """The environment that a user asks for, and its picture by the name that it has there."""
    if not isinstance(asked, str | Path):
        if not 0.0 <= asked <= POWER_LIMIT:
            raise SceneError(f"the environment is {asked!r}, but a radiance must be from 0 to {POWER_LIMIT:g}")
        return EnvironmentLight(type="environment", radiance=(float(asked),) * 3), {}
    path = Path(asked).absolute()
    picture = EnvironmentPicture.read(path.name, path.parent, [path.resolve().parent], "the environment")
    return EnvironmentLight(type="environment", file=str(path)), {str(path): picture}


def _shines(material: Material) -> bool:
    return isinstance(material, Principled) and material.shines


def put_at(description: Any, at: tuple[str | int, ...], value: str) -> None:
    """Write a text into nested tables and lists."""
    for step in at[:-1]:
        description = description[step]
    description[at[-1]] = value
