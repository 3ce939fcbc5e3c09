"""Program of the one-core process: renders what its argument asks for, and prints a line of JSON per render."""

from __future__ import annotations

import json
import sys

import clrender

__all__ = ["main"]


def main(task: str) -> None:
    """Render a task that `clrender.report.one_core` wrote."""
    wanted = json.loads(task)
    scene = clrender.load(wanted["scene"])
    with clrender.Session(wanted["device"]) as session:
        for number, settings in enumerate([{**wanted["wanted"][0], "spp": 1}, *wanted["wanted"]]):
            image = session.render(scene, size=tuple(wanted["size"]), **settings)
            if number:
                print(json.dumps(image.stats), flush=True)


if __name__ == "__main__":
    main(sys.argv[1])
