"""Importer of PLY files: one shape, with vertex colours or grey."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

from clrender.errors import SceneError
from clrender.importers.asset_files import AssetFiles
from clrender.importers.draft import Draft
from clrender.importers.mtl_materials import GREY
from clrender.meshes.ply import READ_OF_FACES, READ_OF_VERTICES, has_colors
from clrender.meshes.ply_header import PlyHeader, read_header
from clrender.meshes.read import FILE_LIMIT
from clrender.wording import quoted

__all__ = ["read"]

_LISTED: Final = 8


def read(path: Path, files: AssetFiles) -> Draft:
    """The scene of a PLY file.

    Raises
    ------
    SceneError
        Its header is invalid; the rest is read later, like the meshes that scenes name.
    """
    file, _ = files.open_scene(path, FILE_LIMIT)
    with file:
        header = read_header(file, files.source)
    draft = Draft()
    colored = has_colors(header)
    name = "no material, coloured" if colored else "no material"
    draft.description["materials"][name] = {"type": "lambert", "reflectance": [1.0 if colored else GREY] * 3}
    shape: dict[str, Any] = {"type": "mesh", "file": path.name, "material": name}
    if colored:
        shape["vertex_colors"] = "auto"
    draft.description["shapes"].append(shape)
    if header.texture:
        _add_texture(header.texture, files, draft, name)
    for sentence in _left_out(header)[:_LISTED]:
        draft.note(sentence)
    return draft


def _add_texture(picture: str, files: AssetFiles, draft: Draft, material: str) -> None:
    """Give the material the picture of a comment TextureFile, as MeshLab means it."""
    try:
        name = files.name(picture.replace("\\", "/"), "the comment TextureFile")
        files.open(name, "the comment TextureFile")[0].close()
    except SceneError as fault:
        draft.leave_out(fault, files.source, files.strict)
        return
    draft.description["materials"][material]["reflectance"] = {"texture": name}


def _left_out(header: PlyHeader) -> list[str]:
    """Contents of the file that are not used."""
    found = []
    for element in header.elements:
        if element is not header.element("vertex") and element is not header.surface:
            found.append(f"the element {quoted(element.name)} is not read")
            continue
        known = READ_OF_VERTICES if element.name == "vertex" else READ_OF_FACES
        kind = "vertices" if element.name == "vertex" else "faces"
        names = [quoted(entry.name) for entry in element.properties if entry.name not in known]
        if names:
            shown = ", ".join(names[:_LISTED]) + (", …" if len(names) > _LISTED else "")
            found.append(f"of its {kind} {shown} {'is' if len(names) == 1 else 'are'} not read")
    return found
