"""A scene as the text of a scene file, and the files that this text names."""

from __future__ import annotations

import hashlib
import json
import re
import shutil
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import IO, Any, Final

import numpy as np
from numpy.typing import NDArray

from clrender.curves import CurveData
from clrender.errors import SceneError
from clrender.exporters.files import NamedFiles, write_bytes
from clrender.exporters.mesh_ply import write_ply
from clrender.scene import Scene
from clrender.scene.content_hash import put_at
from clrender.scene.environment import ENDINGS
from clrender.scene.grid_placement import grid_placement
from clrender.scene.ies import ies_text
from clrender.scene.load import SCENE_FILE_LIMIT
from clrender.wording import place, quoted

__all__ = ["Export", "exported", "scene_text", "toml_text"]

_TILT: Final = re.compile(r"\s*TILT\s*=(.*)", re.IGNORECASE)
_ROW: Final = re.compile(r"\[\n((?:[ \t]*[-+.\w]+,\n)+)[ \t]*\]")
"""A TOML list of numbers with one number per line; strings contain no line breaks there."""

_KEPT: Final = ("edges", "scale", "offset")
"""Keys of a grid that are no place of it."""


@dataclass
class Export(NamedFiles):
    """A self-contained scene and its files.

    Attributes
    ----------
    description : dict
        In the form of a scene file.
    """

    description: dict[str, Any] = field(default_factory=dict)


def exported(scene: Scene, folder: str) -> Export:
    """A scene, with its meshes, images and IES profiles as files in a folder.

    Parameters
    ----------
    scene : Scene
    folder : str
        Relative to the scene file that will be written.

    Returns
    -------
    Export
        Scenes read from it have the same hash. Encoded images are copied unchanged.

    Raises
    ------
    SceneError
        A file cannot be read.
    """
    export = Export(description=scene.model_dump(mode="json", exclude_none=True, exclude_unset=True))
    for at, shape in scene.mesh_files():
        assert shape.file is not None
        mesh = scene.mesh_of(at, shape)
        name = export.add(folder, Path(shape.file).stem, ".ply", mesh.sha256(), partial(write_ply, mesh=mesh))
        put_at(export.description, (*at, "file"), name)
    for at, curves in scene.curve_files():
        assert curves.file is not None
        strands = scene.strands(at, curves)
        write = partial(_write_array, array=_parted(strands))
        put_at(
            export.description,
            (*at, "file"),
            export.add(folder, Path(curves.file).stem, ".npy", strands.sha256(), write),
        )
    for index, instance in scene.instances():
        if instance.file is not None:
            array = scene.transforms(index)
            write = partial(_write_array, array=array.maps)
            name = export.add(folder, Path(instance.file).stem, ".npy", array.sha256(), write)
            export.description["shapes"][index]["transforms"] = name
    for (_, medium, key), grid in scene.grids():
        numbers = scene.grid(medium, key, grid)
        write = partial(_write_array, array=numbers.values)
        name = export.add(folder, Path(grid.file).stem, ".npy", numbers.sha256(), write)
        placed = [*grid_placement(grid, numbers).tolist(), [0.0, 0.0, 0.0, 1.0]]
        table = {each: value for each, value in export.description["media"][medium][key].items() if each in _KEPT}
        export.description["media"][medium][key] = {**table, "file": name, "transform": {"matrix": placed}}
    for material, measured in scene.measured_materials():
        file = scene.measured(material, measured)
        write = partial(write_bytes, data=file.content.tobytes())
        name = export.add(folder, Path(measured.file).stem, file.ending, file.sha256(), write)
        put_at(export.description, ("materials", material, "file"), name)
    copied: dict[str, str] = {}
    named = [(at, texture.texture) for at, texture in scene.texture_files()]
    for index, pictured in scene.pictured_lights():
        assert pictured.file is not None
        if Path(pictured.file).suffix.lower() in ENDINGS:
            named.append((("lights", index, "file"), pictured.file))
            continue
        # An image that an importer made, which cannot be a file name: it has no image extension
        picture = scene.light_picture(index)
        write = partial(_write_radiance, pixels=picture.pixels)
        name = export.add(folder, Path(pictured.file).stem, ".exr", picture.sha256(), write)
        put_at(export.description, ("lights", index, "file"), name)
    for at, name in named:
        if name not in copied:
            copied[name] = _copied(export, scene, folder, name, place(at))
        put_at(export.description, at, copied[name])
    for index, light in scene.ies_lights():
        at = ("lights", index, "file")
        data = _lamp(scene, light.file, place(at))
        digest = hashlib.sha256(data).hexdigest()
        name = export.add(folder, Path(light.file).stem, ".ies", digest, partial(write_bytes, data=data))
        put_at(export.description, at, name)
    return export


def scene_text(description: dict[str, Any], ending: str, title: str) -> bytes:
    """The content of a scene file.

    Parameters
    ----------
    description : dict
    ending : str
        ``.toml`` or ``.json``.
    title : str
        One line of description, written if the format has comments.

    Raises
    ------
    SceneError
        It exceeds the size limit of scene files.
    """
    if ending == ".json":
        text = json.dumps(description, indent=1, ensure_ascii=False) + "\n"
    else:
        text = f"# {title}\n{toml_text(description)}"
    data = text.encode("utf-8")
    if len(data) > SCENE_FILE_LIMIT:
        raise SceneError(f"the scene file would have {len(data)} bytes, but at most {SCENE_FILE_LIMIT} are read")
    return data


def toml_text(description: dict[str, Any]) -> str:
    """Tables of a scene file, with each list of numbers in one line."""
    import tomli_w

    return _ROW.sub(_in_a_row, tomli_w.dumps(description))


def _in_a_row(found: re.Match[str]) -> str:
    return f"[{', '.join(line.strip(' ,') for line in found[1].splitlines())}]".replace("\t", "")


def _copied(export: Export, scene: Scene, folder: str, name: str, where: str) -> str:
    """Copy an image unchanged."""
    digest = hashlib.sha256()
    with scene.files.opened(name, where) as (file, ending):
        while block := file.read(2**20):
            digest.update(block)

    def write(into: IO[bytes]) -> None:
        with scene.files.opened(name, where) as (file, _):
            shutil.copyfileobj(file, into, 2**20)

    return export.add(folder, Path(name).stem or name, ending, digest.hexdigest(), write)


def _lamp(scene: Scene, name: str, where: str) -> bytes:
    """An IES file, with the tilt factors included if it names a file of them."""
    if " (" in Path(name).suffix:  # an importer made it
        return ies_text(scene.files.profile(name, where)).encode("latin-1")
    with scene.files.opened(name, where) as (file, _):
        data = file.read()
    lines = data.decode("latin-1").replace("\x1a", "").replace("\r\n", "\n").replace("\r", "\n").split("\n")
    at, what = next(((i, found[1].strip()) for i, line in enumerate(lines) if (found := _TILT.match(line))), (0, ""))
    if what.upper() in ("", "NONE", "INCLUDE"):
        return data
    with scene.files.opened(str(Path(name).parent / what), f"{where}: {quoted(name)}") as (file, _):
        factors = file.read().decode("latin-1").replace("\x1a", "")
    return "\r\n".join([*lines[:at], "TILT=INCLUDE", *factors.split(), *lines[at + 1 :]]).encode("latin-1")


def _write_radiance(file: IO[bytes], pixels: NDArray[np.float32]) -> None:
    from clrender.image.exr_write import write_exr

    write_exr(file, pixels, {}, {})


def _write_array(file: IO[bytes], array: NDArray[Any]) -> None:
    np.lib.format.write_array(file, array, allow_pickle=False)


def _parted(strands: CurveData) -> NDArray[np.float64]:
    """(N, 3, 4 or 7) points of strands, with rows that are not numbers between them."""
    rows = strands.rows
    ends = np.cumsum(strands.counts)[:-1]
    return np.insert(rows, ends, np.nan, axis=0)
