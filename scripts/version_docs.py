"""Bring docs/cite.md up to date with docs/versions.json: kernels and known images of each released version.

``--record`` first renders the known images with this tree, and keeps them and the kernel hash as those of its version.
"""

from __future__ import annotations

import json
import re
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

from made_part import with_part

import clrender
from clrender.files.kernel_hash import kernels_sha256

__all__ = ["IMAGES", "PAGE", "TABLE", "current", "images", "released", "tables"]

_ROOT: Final = Path(__file__).resolve().parents[1]
PAGE: Final = _ROOT / "docs" / "cite.md"
TABLE: Final = _ROOT / "docs" / "versions.json"

IMAGES: Final = (
    "room",
    "cornell",
    "surfaces",
    "textures",
    "sky",
    "drink",
    "haze",
    "prism",
    "room --integrator photon",
    "caustic --integrator bdpt",
)
"""Scene and options of the known images; each is rendered with `_SIZE` and `_SPP`, and otherwise with defaults."""
_SIZE: Final = (48, 32)
_SPP: Final = 4


def images(*names: str, device: str = "auto") -> dict[str, str]:
    """Hashes of known images, rendered with this tree.

    Parameters
    ----------
    *names : str
        Of `IMAGES`.
    device : str
    """
    with clrender.Session(device=device) as session:
        return {name: _image(session, *name.split(" --integrator ")) for name in names}


def _image(session: clrender.Session, scene: str, integrator: str | None = None) -> str:
    settings: dict[str, Any] = {} if integrator is None else {"integrator": integrator}
    stats = session.render(clrender.load(scene), spp=_SPP, size=_SIZE, **settings).stats
    return str(stats["image_sha256"])


def released(changes: str) -> dict[str, str]:
    """Dates of versions, by the headings of a changelog.

    Parameters
    ----------
    changes : str
        Text of CHANGELOG.md.
    """
    return dict(re.findall(r"^## (\d\S*) – (\d{4}-\d{2}-\d{2})$", changes, re.MULTILINE))


def current(page: str, data: Mapping[str, Any]) -> str:
    """The page with updated tables.

    Parameters
    ----------
    page : str
        Text with the two marks around the tables.
    data : mapping
        As in docs/versions.json.
    """
    return with_part(page, "version_docs.py", tables(data))


def tables(data: Mapping[str, Any]) -> str:
    """Tables in Markdown: the versions, newest first, and the known images of the newest.

    Parameters
    ----------
    data : mapping
        As in docs/versions.json, oldest first.
    """
    rows = [
        "| version | released | kernel hash | known images with the bits of the version before |",
        "|---|---|---|---|",
    ]
    before: dict[str, str] = {}
    lines = []
    for version, entry in data.items():
        same = [name for name, image in entry["images"].items() if before.get(name) == image]
        told = f"{len(same)} of {len(entry['images'])}" if before else "the first version"
        lines.append(f"| {version} | {entry['date']} | `{entry['kernel_sha256']}` | {told} |")
        before = entry["images"]
    newest = list(data)[-1]
    known = [f"| `{name}` | `{image}` |" for name, image in data[newest]["images"].items()]
    width, height = _SIZE
    about = f"Known images of {newest}, rendered by `clrender render SCENE --size {width}x{height} --spp {_SPP}`:"
    head = ["| scene and options | `image_sha256` |", "|---|---|"]
    return "\n".join([*rows, *reversed(lines), "", about, "", *head, *known, ""])


def main() -> int:
    """Record, if asked to, and rewrite the page."""
    data = json.loads(TABLE.read_text()) if TABLE.exists() else {}
    if sys.argv[1:] == ["--record"]:
        version = clrender.__version__
        date = released((_ROOT / "CHANGELOG.md").read_text()).get(version)
        if date is None:
            print(f"CHANGELOG.md has no section `## {version} – DATE`", file=sys.stderr)
            return 2
        data[version] = {"date": date, "kernel_sha256": kernels_sha256(), "images": images(*IMAGES)}
        TABLE.write_text(json.dumps(data, indent=1) + "\n")
    elif sys.argv[1:]:
        print(__doc__, file=sys.stderr)
        return 2
    PAGE.write_text(current(PAGE.read_text(), data))
    return 0


if __name__ == "__main__":
    sys.exit(main())
