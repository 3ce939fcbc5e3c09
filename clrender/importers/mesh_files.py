"""A mesh alone is a scene of one grey shape."""

from __future__ import annotations

from pathlib import Path

from clrender.importers.asset_files import AssetFiles
from clrender.importers.draft import Draft

__all__ = ["read"]


def read(path: Path, files: AssetFiles) -> Draft:
    """The scene of a mesh file.

    Parameters
    ----------
    path : pathlib.Path
    files : AssetFiles
    """
    draft = Draft()
    draft.description["materials"]["grey"] = {"type": "lambert", "reflectance": [0.6, 0.6, 0.6]}
    draft.description["shapes"].append({"type": "mesh", "file": path.name, "material": "grey"})
    return draft
