"""A debug build of the kernels finds no path on which a struct violates its invariants (kernels/core/invariant.h)."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import pytest
from mixed_files import written
from mixed_moves import compiled_for_volumes, with_all_features
from mixed_scenes import KINDS, Mixed, mixed_scene

import clrender
from clrender.device.device import Device, Program
from clrender.files.package_data import kernels_folder

TEXT = (kernels_folder() / "core/invariant.h").read_text(encoding="utf-8")
INVARIANTS = {name: int(bit) for name, bit in re.findall(r"#define INVARIANT_(\w+) (\d+)u\n", TEXT)}
"""The kinds, and the bit that has each of them checked."""
ALL = {"INVARIANTS": sum(INVARIANTS.values())}
FEW = (("light", 18), ("black", 2))
"""Of one program."""


class DebugBuild(Device):
    """The test's device, whose programs are built with other macros beside their own."""

    def __init__(self, device: Device) -> None:
        super().__init__(device.info, device._handle)
        self.macros: Mapping[str, int | str] = ALL

    def program(
        self, entry: str | Path, defines: Mapping[str, int | str] | None = None, samples: int | None = None
    ) -> Program:
        return super().program(entry, {**(defines or {}), **self.macros}, samples)


@pytest.fixture
def debug(device: Device) -> Iterator[DebugBuild]:
    build = DebugBuild(device)
    yield build
    build.close()


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of the files of mixed scenes."""
    return written(tmp_path_factory.mktemp("mixed"))


def paths(debug: DebugBuild, scene: clrender.Scene, **settings: Any) -> int:
    """The number of paths that violate an invariant that is checked."""
    with clrender.Session([debug]) as session:
        image = session.render(scene, **{"size": (40, 32), "spp": 16, **settings})
    return int(image.stats["nonfinite_samples"])


def violated(debug: DebugBuild, scene: clrender.Scene, **settings: Any) -> dict[str, int]:
    """The number of paths that violate each kind of invariant."""
    debug.macros = ALL
    if paths(debug, scene, **settings) == 0:
        return {}
    found = dict[str, int]()
    for name, bit in INVARIANTS.items():
        debug.macros = {"INVARIANTS": bit}
        found[name] = paths(debug, scene, **settings)
    return {name: count for name, count in found.items() if count}


def mixed(kind: str, number: int, folder: Path) -> clrender.Scene:
    made = mixed_scene(kind, number)
    return Mixed(made.name, with_all_features(made.content)).scene(folder)


@pytest.mark.long
def test_mixed_scenes_violate_none(debug: DebugBuild, folder: Path) -> None:
    with compiled_for_volumes():
        found = {f"{kind} {number}": violated(debug, mixed(kind, number, folder)) for kind, number in FEW}
    assert not {name: kinds for name, kinds in found.items() if kinds}


@pytest.mark.long
def test_violations_are_found(debug: DebugBuild) -> None:
    """On every path, if unit vectors are to have no length."""
    debug.macros = {**ALL, "INVARIANT_SLACK": "-1.0f"}
    assert paths(debug, clrender.load("room"), spp=1) == 40 * 32


@pytest.mark.slow
@pytest.mark.parametrize("name", INVARIANTS)
def test_violations_of_every_kind_are_found(debug: DebugBuild, name: str) -> None:
    """If unit vectors are to have no length, and 0 is the largest number."""
    debug.macros = {"INVARIANTS": INVARIANTS[name], "INVARIANT_SLACK": "-1.0f", "INVARIANT_MOST": "0.0f"}
    assert paths(debug, clrender.load("surfaces"), spp=1) > 0


@pytest.mark.slow
@pytest.mark.parametrize("lanes", [1, 16])
def test_many_mixed_scenes_violate_none(debug: DebugBuild, folder: Path, lanes: int) -> None:
    numbers = [(kind, number) for kind in KINDS for number in range(25)]
    found = dict[str, dict[str, int]]()
    with compiled_for_volumes():
        for kind, number in numbers:
            found[f"{kind} {number}"] = violated(debug, mixed(kind, number, folder), lanes=lanes)
    assert not {name: kinds for name, kinds in found.items() if kinds}


@pytest.mark.slow
@pytest.mark.parametrize("scene", ["room", "cornell", "bumpy", "surfaces", "sky", "drink", "haze", "textures", "lamps"])
def test_built_in_scenes_violate_none(debug: DebugBuild, scene: str) -> None:
    assert violated(debug, clrender.load(scene)) == {}


@pytest.mark.slow
@pytest.mark.parametrize("scene", ["room", "drink", "haze", "surfaces"])
def test_bidirectional_paths_violate_none(debug: DebugBuild, scene: str) -> None:
    assert violated(debug, clrender.load(scene), integrator="bdpt") == {}


@pytest.mark.slow
def test_photon_mapping_violates_none(debug: DebugBuild) -> None:
    assert violated(debug, clrender.load("drink"), integrator="photon", photons=2000) == {}


@pytest.mark.long
def test_the_debug_build_has_the_same_image(device: Device, debug: DebugBuild) -> None:
    with clrender.Session([debug]) as one, clrender.Session([device]) as two:
        made = [each.render(clrender.load("room"), size=(40, 32), spp=4).stats["image_sha256"] for each in (one, two)]
    assert made[0] == made[1]
