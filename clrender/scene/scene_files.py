"""The files that a scene names: where to find them, and their contents, each read once and cached."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from io import BytesIO
from pathlib import Path
from typing import Any, BinaryIO, Final

from numpy import uint8
from numpy.typing import NDArray

from clrender.curves import CurveData, read_curves
from clrender.errors import SceneError
from clrender.files.named import open_named_file
from clrender.grids import GridData, read_grid
from clrender.image.texel_tiles import StoredPicture
from clrender.measured import MeasuredFile, read_measured
from clrender.meshes.data import MeshData
from clrender.meshes.read import read_mesh
from clrender.meshes.smooth import smoothed
from clrender.meshes.vertex_colors import VertexColors
from clrender.scene.environment import EnvironmentPicture
from clrender.scene.frozen import FrozenDict, frozen
from clrender.scene.groups import TransformArray
from clrender.scene.ies import IesProfile, read_ies
from clrender.scene.medium import Grid
from clrender.scene.shapes import Mesh
from clrender.wording import place, quoted, shown, suggestion

__all__ = ["SceneFiles"]

_PICTURE_BYTES = 2**33
_KINDS: Final[Mapping[str, type]] = {
    "meshes": MeshData,
    "transforms": TransformArray,
    "environments": EnvironmentPicture,
    "profiles": IesProfile,
    "grids": GridData,
    "curves": CurveData,
    "measured": MeasuredFile,
    "textures": tuple,
    "encoded": tuple,
}
"""What each kind of file holds."""


def _working_folder() -> Path:
    try:
        return Path.cwd()
    except FileNotFoundError:  # the folder was deleted; this matters only to a scene that names files
        return Path()


@dataclass(frozen=True)
class SceneFiles:
    """Contents by name in the scene; missing ones are read from the file of that name.

    Attributes
    ----------
    source : str
        Name of the scene in messages.
    base_folder : pathlib.Path
        Folder to which file names are relative. Files are read only from it and below ...
    allow_paths : tuple of pathlib.Path
        ... and from these folders and below.
    meshes : dict of (str, VertexColors or None) to MeshData
        By file name and colour encoding: see `clrender.scene.Mesh.asset`.
    transforms : dict of str to TransformArray
    environments : dict of str to EnvironmentPicture
    profiles : dict of str to IesProfile
    grids : dict of str to GridData
        By `clrender.scene.medium.Grid.asset`.
    curves : dict of str to CurveData
    measured : dict of str to MeasuredFile
    textures : dict of str to (StoredPicture, (tiles, 64) uint8)
    encoded : dict of str to (bytes, str)
        Encoded images: file content, and the format's extension such as ``.png``.
    """

    source: str = "Scene"
    base_folder: Path = field(default_factory=_working_folder)
    allow_paths: tuple[Path, ...] = ()
    meshes: dict[tuple[str, VertexColors | None], MeshData] = field(default_factory=FrozenDict)
    transforms: dict[str, TransformArray] = field(default_factory=FrozenDict)
    environments: dict[str, EnvironmentPicture] = field(default_factory=FrozenDict)
    profiles: dict[str, IesProfile] = field(default_factory=FrozenDict)
    grids: dict[str, GridData] = field(default_factory=FrozenDict)
    curves: dict[str, CurveData] = field(default_factory=FrozenDict)
    measured: dict[str, MeasuredFile] = field(default_factory=FrozenDict)
    textures: dict[str, tuple[StoredPicture, NDArray[uint8]]] = field(default_factory=FrozenDict)
    encoded: dict[str, tuple[bytes, str]] = field(default_factory=FrozenDict)
    _smoothed: dict[tuple[str, VertexColors | None, float], tuple[MeshData, MeshData]] = field(
        default_factory=dict, repr=False, compare=False
    )

    def in_folder(self, source: str, base_folder: Path, allow_paths: tuple[Path, ...]) -> SceneFiles:
        """Files of the same names in another folder; only images that were given are kept."""
        return SceneFiles(source, base_folder, allow_paths, textures=self.textures, encoded=self.encoded)

    def with_contents(self, **contents: Mapping[Any, Any]) -> SceneFiles:
        """A copy with more contents: attributes of this class, by name. Arrays are copied unless they are read-only.

        Raises
        ------
        SceneError
            There is no such attribute, or a content is of another kind.
        """
        merged: dict[str, Any] = {}
        for kind, more in contents.items():
            if kind not in _KINDS:
                raise SceneError(f"{quoted(kind)} is no kind of a scene's files{suggestion(kind, _KINDS)}")
            given = {(name, None) if kind == "meshes" and isinstance(name, str) else name: more[name] for name in more}
            for name, content in given.items():
                if not isinstance(content, _KINDS[kind]):
                    text = f"is {shown(content)}, but must be a {_KINDS[kind].__name__}"
                    file = name[0] if isinstance(name, tuple) else name
                    raise SceneError(f"{kind}: the content of {quoted(str(file))} {text}")
            read_only = {name: frozen(content, copied=True) for name, content in given.items()}
            merged[kind] = FrozenDict({**getattr(self, kind), **read_only})
        return replace(self, **merged)

    def _read(self, kind: str, name: Any, content: Any) -> None:
        """Keep the content of a file, read-only."""
        dict.__setitem__(getattr(self, kind), name, frozen(content))

    def mesh(self, at: tuple[str | int, ...], shape: Mesh) -> MeshData:
        """Triangles of a mesh that names a file.

        Parameters
        ----------
        at : tuple of str or int
            Location of the mesh in the scene's description, for messages.
        shape : Mesh

        Raises
        ------
        SceneError
            The file cannot be read or is not a usable mesh.
        """
        if shape.asset not in self.meshes:
            assert shape.file is not None
            where = f"{self.source}: {place((*at, 'file'))}"
            mesh = read_mesh(shape.file, self.base_folder, self.allow_paths, where, shape.vertex_colors)
            self._read("meshes", shape.asset, mesh)
        mesh = self.meshes[shape.asset]
        return mesh if shape.smooth_angle is None else self._smooth(mesh, shape)

    def _smooth(self, mesh: MeshData, shape: Mesh) -> MeshData:
        """The mesh with vertex normals by its `smooth_angle`, computed once."""
        assert shape.smooth_angle is not None
        key = *shape.asset, shape.smooth_angle
        of, found = self._smoothed.get(key, (None, None))
        if of is not mesh or found is None:
            found = frozen(smoothed(mesh, shape.smooth_angle))
            self._smoothed[key] = mesh, found
        return found

    def transform_array(self, name: str, where: str) -> TransformArray:
        """Transforms of an instance; `where` is the location of the name, for messages. Raises like `mesh`."""
        if name not in self.transforms:
            where = f"{self.source}: {where}"
            self._read("transforms", name, TransformArray.read(name, self.base_folder, self.allow_paths, where))
        return self.transforms[name]

    def environment(self, name: str, where: str) -> EnvironmentPicture:
        """An environment map; `where` is the location of the name, for messages. Raises like `mesh`."""
        if name not in self.environments:
            where = f"{self.source}: {where}"
            picture = EnvironmentPicture.read(name, self.base_folder, self.allow_paths, where)
            self._read("environments", name, picture)
        return self.environments[name]

    def profile(self, name: str, where: str) -> IesProfile:
        """Content of an IES file; `where` is the location of the name, for messages. Raises like `mesh`."""
        if name not in self.profiles:
            profile = read_ies(name, self.base_folder, self.allow_paths, f"{self.source}: {where}")
            self._read("profiles", name, profile)
        return self.profiles[name]

    def grid(self, grid: Grid, where: str) -> GridData:
        """Content of a file of a grid; `where` is the location of the name, for messages. Raises like `mesh`."""
        if grid.asset not in self.grids:
            label = f"{self.source}: {where}"
            read = read_grid(grid.file, self.base_folder, self.allow_paths, label, grid.name)
            self._read("grids", grid.asset, read)
        return self.grids[grid.asset]

    def strands(self, name: str, where: str) -> CurveData:
        """Content of a file of curves; `where` is the location of the name, for messages. Raises like `mesh`."""
        if name not in self.curves:
            curves = read_curves(name, self.base_folder, self.allow_paths, f"{self.source}: {where}")
            self._read("curves", name, curves)
        return self.curves[name]

    def measured_file(self, name: str, where: str) -> MeasuredFile:
        """Content of a file of reflectance; `where` is the location of the name, for messages. Raises like `mesh`."""
        if name not in self.measured:
            measured = read_measured(name, self.base_folder, self.allow_paths, f"{self.source}: {where}")
            self._read("measured", name, measured)
        return self.measured[name]

    @contextmanager
    def opened(self, name: str, where: str) -> Iterator[tuple[BinaryIO, str]]:
        """Open an encoded image or IES file.

        Parameters
        ----------
        name : str
            Name in the scene.
        where : str
            Location of the name, for error messages.

        Yields
        ------
        file : binary file
        ending : str
            Such as ``.png``.

        Raises
        ------
        SceneError
            See `clrender.files.named.open_named_file`.
        """
        if name in self.encoded:
            data, ending = self.encoded[name]
            yield BytesIO(data), ending
            return
        label = f"{self.source}: {where}: {quoted(name)}"
        file, _ = open_named_file(name, self.base_folder, self.allow_paths, label, _PICTURE_BYTES)
        with file:
            yield file, Path(name).suffix.lower()
