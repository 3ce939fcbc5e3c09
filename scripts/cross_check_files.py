"""Random scenes as Mitsuba's XML and pbrt's files: does clrender read them as Mitsuba does, and as its own scenes?

    .venv/bin/python scripts/cross_check_files.py FIRST LAST --mitsuba PYTHON [--with media,cameras] [--folder DIR]

Writes the scenes of `cross_check.py` with the seeds FIRST to LAST - 1, and what `--with` adds to them there, as
``scene.json``, ``scene.xml`` (by `clrender.exporters.write_mitsuba`) and ``scene.pbrt``. Each is rendered by clrender,
and the XML by Mitsuba, six times; means and tiles are compared as there: clrender's XML with Mitsuba's, and clrender's
pbrt with clrender's JSON, without what pbrt has not: skies, plastics, and pictures of opacity and of roughness.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
from cross_check import _MORE, _SIDE, _SPP, _comparison, _for_mitsuba, _Maker, _seeds, _verdict
from peer_files import as_pbrt_has_it, pbrt_text


def _write(folder: Path, seed: int, more: frozenset[str]) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    scene = _Maker(seed, folder, more).make()
    (folder / "scene.json").write_text(json.dumps(scene), encoding="utf-8")
    metals = as_pbrt_has_it(scene)
    (folder / "metals.json").write_text(json.dumps(metals), encoding="utf-8")
    _for_mitsuba(folder)
    (folder / "scene.pbrt").write_text(pbrt_text(metals, _SIDE, _SPP), encoding="utf-8")


def _in_mitsuba(folders: list[Path]) -> None:
    import mitsuba
    import mitsuba_plastic

    mitsuba.set_variant("llvm_ad_rgb")
    mitsuba_plastic.register(mitsuba)
    for number, folder in enumerate(folders):
        # Mitsuba 3.9.1 omits merged meshes from the scene's bounding box, and shadow rays to a sky then end too early
        file = mitsuba_plastic.with_plastics(folder / "scene.xml")
        scene = mitsuba.load_file(str(file), optimize=False)
        images = [np.array(mitsuba.render(scene, spp=_SPP, seed=seed)) for seed in _seeds(number)]
        np.save(folder / "mitsuba_xml.npy", np.array(images, np.float32))
        print(folder.name, flush=True)


def _ours(session: Any, path: Path, number: int) -> Any:
    import clrender

    scene = clrender.load(path)
    images = [session.render(scene, spp=_SPP, size=(_SIDE, _SIDE), seed=seed) for seed in _seeds(number)]
    return np.array([image.linear for image in images])


def _compare(folders: list[Path]) -> bool:
    import clrender

    found: dict[str, list[Any]] = {"XML, Mitsuba": [], "pbrt, JSON": []}
    with clrender.Session() as session:
        for number, folder in enumerate(folders):
            xml = _ours(session, folder / "scene.xml", number)
            pbrt = _ours(session, folder / "scene.pbrt", number)
            # Other seeds for one of our two images, which would otherwise have the same paths
            metals = _ours(session, folder / "metals.json", number + 1000)
            pairs = ((xml, np.load(folder / "mitsuba_xml.npy")), (pbrt, metals))
            line = []
            for key, pair in zip(found, pairs, strict=True):
                one = _comparison(folder.name, *pair)
                found[key].append(one)
                line.append(f"{key} {one.ratio:.5f} z {one.deviate:+.1f}")
            print(f"{folder.name}: {'; '.join(line)}", flush=True)
    agree = []
    for key, ones in found.items():
        print(f"{key}: ", end="")
        agree.append(_verdict(ones))
    return all(agree)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("scenes", nargs="+", metavar="FIRST LAST")
    parser.add_argument(
        "--mitsuba", help="a Python that has Mitsuba; without it the images of an earlier run are taken"
    )
    parser.add_argument("--with", dest="more", default="", metavar="KINDS", help=", ".join(_MORE) + ", by commas")
    parser.add_argument("--folder", type=Path, default=Path("cross_check_files"))
    parser.add_argument("--in-mitsuba", action="store_true", help=argparse.SUPPRESS)
    asked = parser.parse_args()
    folder = asked.folder.resolve()
    if asked.in_mitsuba:
        _in_mitsuba([folder / name for name in asked.scenes])
        return
    if len(asked.scenes) != 2 or not all(text.isdecimal() for text in asked.scenes):
        parser.error("give the first seed and the one after the last, such as 0 100")
    more = frozenset(filter(None, asked.more.split(",")))
    if not more <= set(_MORE):
        parser.error(f"--with takes {', '.join(_MORE)}")
    first, last = map(int, asked.scenes)
    folders = [folder / str(seed) for seed in range(first, last)]
    for seed, place in enumerate(folders, first):
        _write(place, seed, more)
    if asked.mitsuba:
        command = [asked.mitsuba, __file__, *(place.name for place in folders), "--folder", str(folder), "--in-mitsuba"]
        subprocess.run(command, check=True, env={**os.environ, "PYTHONPATH": ""})
    sys.exit(0 if _compare(folders) else 1)


if __name__ == "__main__":
    main()
