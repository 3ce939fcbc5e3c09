"""Importer of STL files: one grey shape."""

from __future__ import annotations

from pathlib import Path

from clrender.importers.asset_files import AssetFiles
from clrender.importers.draft import Draft
from clrender.importers.mtl_materials import GREY

__all__ = ["read"]


def read(path: Path, files: AssetFiles) -> Draft:
    """The scene of an STL file; the mesh is read later, like those that scenes name."""
    del files
    draft = Draft()
    draft.description["materials"]["no material"] = {"type": "lambert", "reflectance": [GREY] * 3}
    draft.description["shapes"].append({"type": "mesh", "file": path.name, "material": "no material"})
    return draft
