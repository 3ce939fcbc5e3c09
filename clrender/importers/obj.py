"""Importer of OBJ files with their material libraries: a shape for each material of each object."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from clrender.errors import SceneError
from clrender.exact.matrices import length
from clrender.importers.asset_files import AssetFiles
from clrender.importers.draft import Draft
from clrender.importers.mtl_file import MtlMaterial, read_mtl
from clrender.importers.mtl_materials import GREY, Converted, converted
from clrender.importers.mtl_pictures import MtlPictures
from clrender.meshes.data import MeshData
from clrender.meshes.obj import ObjFaces, Smoothing
from clrender.meshes.obj_records import ObjRecords, Statement, read_records
from clrender.meshes.read import FILE_LIMIT, checked_mesh
from clrender.scene.materials import BASE_COLORS
from clrender.scene.values import NAME_LIMIT
from clrender.wording import counted, quoted

__all__ = ["read"]

_SHAPE_LIMIT: Final = 4096
"""Most shapes; beyond it, shapes with the same material are merged."""
_LIBRARY_LIMIT: Final = 2**24
_MOST_LIBRARIES: Final = 256
_MISSING_SHOWN: Final = 17
"""Most missing material names that are listed, including the empty one."""
_Whole = NDArray[np.int64]


@dataclass
class _Runs:
    """Statements in effect for each face.

    Attributes
    ----------
    objects, materials : (F,) int64
        Indices into the lists of names; 0: none.
    smoothing : (F,) int64
        Smoothing groups; 0: none.
    names : list of str
        Names of materials; the first entry stands for none.
    object_names : list of str
    """

    objects: _Whole
    materials: _Whole
    smoothing: _Whole
    names: list[str]
    object_names: list[str]


def read(path: Path, files: AssetFiles) -> Draft:
    """The scene of an OBJ file.

    Raises
    ------
    SceneError
        It, or its material library, is truncated or damaged.
    """
    draft = Draft()
    file, size = files.open_scene(path, FILE_LIMIT)
    label = files.source
    with file:
        if size == 0:
            raise SceneError(f"{label} is empty; it must hold a mesh")
        try:
            records = read_records(file, label, None, statements=True, strict=files.strict)
        except OSError as error:
            raise SceneError(f"{label} cannot be read: {error.strerror or error}") from None
    for said in records.told:
        draft.note(said)
    draft.left_out += len(records.faults)
    draft.forgiven += len(records.forgiven)
    records.faults.clear()  # or each mesh would tell them too
    records.forgiven.clear()
    faces = ObjFaces(records, label)
    runs = _runs(records.statements, records.counts["f"])
    _note_statements(records, faces, draft)
    library = _library(records.statements, files, draft)
    with np.errstate(over="ignore", invalid="ignore"):  # coordinates out of range are rejected below
        diagonal = length(np.ptp(faces.positions, axis=0))

    def note(sentence: str) -> None:
        draft.note(sentence.removeprefix(f"{files.source}: "))

    def leave_out(fault: SceneError) -> None:
        draft.leave_out(fault, files.source, files.strict)

    pictures = MtlPictures(files, note, leave_out, diagonal)
    _forget_missing(runs, library, note)
    _add_shapes(draft, faces, runs, _materials(runs, library, pictures, note))
    return draft


def _runs(statements: list[Statement], count: int) -> _Runs:
    """Object, material and smoothing group of every face."""
    tables: dict[str, dict[str, int]] = {"o": {"": 0}, "usemtl": {"": 0}, "s": {"0": 0, "off": 0, "": 0}}
    found = {}
    for keyword, numbers in tables.items():
        own = [each for each in statements if each.keyword == keyword]
        starts = np.array([0, *(each.faces for each in own)], np.int64)
        values = [0, *(numbers.setdefault(each.rest, len(numbers)) for each in own)]
        found[keyword] = np.repeat(np.array(values, np.int64), np.diff(starts, append=count))
    return _Runs(found["o"], found["usemtl"], found["s"], list(tables["usemtl"]), list(tables["o"]))


def _note_statements(records: ObjRecords, faces: ObjFaces, draft: Draft) -> None:
    """Note the contents of the file that were not used."""
    kinds = {"p": "points", "l": "lines", "curv": "curves", "curv2": "curves", "surf": "free-form surfaces"}
    listed = [each for each in records.others.items() if each[0] != "g"]
    for keyword, count in listed[:8]:
        what = f", {kinds[keyword]}," if keyword in kinds else ""
        draft.note(f"{counted(count, 'line')} with {quoted(keyword)}{what} not read")
    if len(listed) > 8:
        draft.note(f"{counted(len(listed) - 8, 'more kind of line is', 'more kinds of lines are')} not read")
    widths = {part.shape[1] for part in records.positions}
    if len(widths) > 1 or records.some_colored:
        draft.note("some vertices have colours and others have none: none is read")
    elif faces.colors is not None and not _has_colors(faces):
        draft.note("colours of vertices are not all from 0 to 1: none is read")


def _library(statements: list[Statement], files: AssetFiles, draft: Draft) -> dict[str, MtlMaterial]:
    """Materials of all readable libraries."""
    found: dict[str, MtlMaterial] = {}
    tried: set[str] = set()
    for statement in statements:
        if statement.keyword != "mtllib" or not statement.rest or statement.rest in tried:
            continue
        if len(tried) == _MOST_LIBRARIES:
            draft.note(f"line {statement.line} names one more material library: only {_MOST_LIBRARIES} are read")
            break
        tried.add(statement.rest)
        # The name may contain blanks, but the standard allows several names
        for names in ([statement.rest], statement.rest.split()):
            contents, problems = {}, []
            for name in names:
                try:
                    contents[name] = _content(name.replace("\\", "/"), f"line {statement.line}", files)
                except SceneError as error:
                    problems.append(str(error).removeprefix(f"{files.source}: "))
            if contents:
                break
        for problem in problems:
            draft.note(f"{problem}: its materials are missing")
        for name, data in contents.items():
            folder = str(Path(name.replace("\\", "/")).parent)
            found = {**read_mtl(data, f"{files.source}: {quoted(name)}", "" if folder == "." else folder), **found}
    return found


def _content(name: str, place: str, files: AssetFiles) -> bytes:
    file, size = files.open(name, place, _LIBRARY_LIMIT)
    with file:
        return file.read(size)


def _forget_missing(runs: _Runs, library: dict[str, MtlMaterial], note: Callable[[str], None]) -> None:
    """Treat faces whose material is in no library as faces without a material."""
    missing = np.array([name not in library for name in runs.names])
    for number in np.flatnonzero(missing)[1:_MISSING_SHOWN].tolist():
        note(f"the material {quoted(runs.names[number])} is in no library: grey is taken")
    if (more := int(missing.sum()) - _MISSING_SHOWN) > 0:
        note(f"{counted(more, 'more material is', 'more materials are')} in no library")
    runs.materials[missing[runs.materials]] = 0


def _materials(
    runs: _Runs, library: dict[str, MtlMaterial], pictures: MtlPictures, note: Callable[[str], None]
) -> dict[int, tuple[str | None, Converted]]:
    """Materials of faces, by index, each with its name."""
    found: dict[int, tuple[str | None, Converted]] = {}
    used: set[str] = set()
    for number in np.unique(runs.materials).tolist():
        wanted = runs.names[number]
        source = library.get(wanted)
        if source is None:
            found[number] = None, Converted({"type": "lambert", "reflectance": [GREY] * 3}, None)
            continue
        name = wanted[:200] or "unnamed"
        while name in used:
            name = f"{name[:190]} {len(used)}"
        used.add(name)
        found[number] = name, converted(source, pictures, note)
    return found


def _add_shapes(draft: Draft, faces: ObjFaces, runs: _Runs, materials: dict[int, tuple[str | None, Converted]]) -> None:
    """Add a shape for each material of each object; faces with normals and those without form separate shapes."""
    of_object = 2 * len(runs.names)
    keys = runs.objects * of_object + (runs.materials * 2 + faces.with_normals)
    if bool((keys == keys[0]).all()):
        smoothing = faces.smoothing(runs.smoothing, keys)
        _add_shape(draft, faces, runs, smoothing, None, materials[int(runs.materials[0])])
        return
    parts = len(np.unique(keys))
    if parts > _SHAPE_LIMIT:
        draft.note(f"{counted(parts, 'part')} of objects are too many: those of one material are one shape")
        keys = keys % of_object
    smoothing = faces.smoothing(runs.smoothing, keys)
    order = np.argsort(keys, kind="stable")
    begins = np.flatnonzero(np.diff(keys[order], prepend=-1))
    for some in np.split(order, begins[1:]):
        _add_shape(draft, faces, runs, smoothing, some, materials[int(runs.materials[some[0]])])


def _add_shape(
    draft: Draft,
    faces: ObjFaces,
    runs: _Runs,
    smoothing: Smoothing | None,
    some: _Whole | None,
    of: tuple[str | None, Converted],
) -> None:
    """Add a shape of some faces, or of all; they have one material and object."""
    name, (material, emission) = of
    colored = _has_colors(faces)
    plain = not any(material.get(key) is not None for key in BASE_COLORS)
    if colored and plain:
        draft.note(f"colours of vertices are not read where the material {quoted(name or '')} has no colour")
    shaded = colored and not plain
    mesh = faces.mesh(some, "auto" if shaded else None, smoothing)
    if mesh.uvs is None and (_has_textures(material) or isinstance(emission, dict)):
        draft.note(f"faces of the material {quoted(name or '')} have no texture coordinates, and got (0, 0)")
        mesh = _with_blank_uvs(mesh)
    number = len(draft.description["shapes"])
    first = 0 if some is None else int(some[0])
    file = f"{runs.object_names[int(runs.objects[first])][:60]} {(name or '')[:60]} {number}".strip()
    draft.meshes[file] = checked_mesh(mesh, faces.label)
    materials = draft.description["materials"]
    if name is None:
        # White, if vertex colours are the whole colour
        name = "no material" if not shaded else "no material, coloured"
        material = {**material, "reflectance": [1.0 if shaded else GREY] * 3}
    materials[name] = material
    shape: dict[str, Any] = {"type": "mesh", "file": file, "material": name}
    objects = runs.objects if some is None else runs.objects[some]
    if (called := runs.object_names[int(runs.objects[first])][:NAME_LIMIT]) and bool((objects == objects[0]).all()):
        shape["name"] = called
    if shaded:
        shape["vertex_colors"] = "linear"
    if emission is not None:
        shape["emission"] = emission
    draft.description["shapes"].append(shape)


def _has_colors(faces: ObjFaces) -> bool:
    """Whether all vertices have valid colours."""
    colors = faces.colors
    return colors is not None and float(colors.min()) >= 0.0 and float(colors.max()) <= 1.0


def _has_textures(material: dict[str, Any]) -> bool:
    return any(isinstance(value, dict) for value in material.values())


def _with_blank_uvs(mesh: MeshData) -> MeshData:
    return replace(mesh, uvs=np.zeros((len(mesh.triangles), 3, 2), np.float32))
