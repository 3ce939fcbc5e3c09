"""Make docs/equal-time.jpg: built-in scenes by clrender and by peers, each in the same CPU time.

    python scripts/equal_time_docs.py --peer mitsuba=PYTHON --peer cycles=PYTHON [--seconds 60]

Peers render the scene that their exporter writes; setting it up does not count. One row for each scene, one column for
each renderer, clrender first. Prints samples a pixel and CPU seconds of each, and relMSE against a render of clrender
with eight times the samples: of a peer it also counts what its exporter leaves out.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Final

import numpy as np
from doc_pictures import write_sheet
from hard_bench import Floats, Subject, relative_error, renders_by, renders_by_peer, samples_for
from PIL import Image

import clrender
from clrender.bench.peers import peer_from
from clrender.files.package_data import scenes_folder
from clrender.image.tone_map import to_display

__all__: list[str] = []

_SCENES: Final = ("interior", "canal")
_SIZE: Final = (480, 320)
_CROP: Final = ((190, 130), (160, 120))
"""Of each image: the left upper corner and the size of what is shown, pixels; twice as large in the picture."""


def part(image: Floats, stops: float) -> Image.Image:
    """The part of an image that is shown."""
    (left, top), (width, height) = _CROP
    shown = to_display(image[top : top + height, left : left + width].astype(np.float32), exposure=stops)
    return Image.fromarray(shown).resize((2 * width, 2 * height), Image.Resampling.NEAREST)


def main(given: Sequence[str] | None = None) -> None:
    """Render, print what was measured, and write the picture."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--peer", type=peer_from, action="append", default=[], help="NAME=PYTHON, repeated")
    parser.add_argument("--seconds", type=float, default=60.0, help="CPU seconds of each image (60)")
    parser.add_argument("--device", help="as for `clrender render`")
    arguments = parser.parse_args(given)
    rows = []
    with tempfile.TemporaryDirectory() as folder, clrender.Session(arguments.device) as session:
        for name in _SCENES:
            scene = clrender.load(name)
            of = Subject(scenes_folder() / f"{name}.toml", scene, _SIZE)
            own = renders_by(session, of, {"integrator": "path"})
            every = {"clrender": own} | {peer.name: renders_by_peer(peer, of, Path(folder)) for peer in arguments.peer}
            samples = {way: samples_for(arguments.seconds, renders) for way, renders in every.items()}
            reference = own(8 * samples["clrender"], 1).image
            stops = session.render(scene, spp=1, size=(16, 16)).camera_stops
            row = []
            for way, renders in every.items():
                done = renders(samples[way], 2)
                error = relative_error(done.image, reference)
                print(f"{name} {way}: {samples[way]} spp, {done.cpu_seconds:.1f} CPU s, relMSE {error:.4f}", flush=True)
                row.append(part(done.image, stops))
            rows.append(row)
    write_sheet("equal-time.jpg", rows, quality=88)


if __name__ == "__main__":
    main()
