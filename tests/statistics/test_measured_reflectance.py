"""Measured reflectance on devices: values of Mitsuba and of tables, sampling by its density, and all strategies."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from material_support import Floats, chances, counted, directions, evaluated, sampled, towards
from measured_files import gray, part_of, rgl_fields, write_merl, write_tensors
from render_support import Studio, hashes_by_lanes_and_cuts
from stats_support import Evidence

import clrender
from clrender.furnace import findings, measure, subjects_of
from clrender.measured import MerlTable, read_measured

if TYPE_CHECKING:
    from clrender.device import Device
    from clrender.scene import Scene

PARTS = {"isotropic": (0.4, 1, 1), "anisotropic": (0.25, 9, 9), "halves": (0.25, 9, 5), "quarters": (0.25, 9, 3)}
"""Alpha, azimuths of a turn, and how many of them are in the file."""
KINDS = [*PARTS, "merl"]
WO = [[-0.28, -0.214, 0.936], [0.281, 0.354, 0.892], [-0.273, -0.69, 0.67]]
SKY = {"type": "environment", "radiance": [1.0, 1.0, 1.0]}
SUN = {"type": "directional", "direction": [-1.0, -1.5, -0.6], "irradiance": [4.0, 4.0, 3.5]}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Files of known surfaces."""
    made = tmp_path_factory.mktemp("measured")
    for name, (alpha, azimuths, kept) in PARTS.items():
        fields = gray(part_of(rgl_fields(alpha, azimuths, spectral=True, side=16, views=5), kept))
        write_tensors(made / f"{name}.bsdf", fields)
    # What leaves at grazing angles is much darker, whatever came in
    fields = gray(rgl_fields(0.5, spectral=True, side=16, views=5))
    fields["spectra"] = fields["spectra"] * np.array([1.0, 0.9, 0.6, 0.2, 0.05], np.float32)[:, None, None, None]
    write_tensors(made / "irreciprocal.bsdf", fields)
    fields = {**gray(rgl_fields(0.4, spectral=True, side=32, views=5)), "jacobian": np.zeros(1, np.uint8)}
    fields["spectra"] = fields["spectra"] * np.float32(0.2)
    write_tensors(made / "plain.bsdf", fields)
    write_merl(made / "merl.binary", merl)
    return made


def merl(half: Any, difference: Any, turn: Any) -> Any:
    """1/sr of a surface with a broad highlight that is brighter where both directions lie on one side."""
    lobe = 0.2 + 3.0 * np.exp(-((half / 0.2) ** 2))
    return np.array([0.3, 0.2, 0.1]) * lobe * (1.0 + 0.3 * np.cos(2.0 * turn) * np.sin(difference))


def material(kind: str, **more: Any) -> dict[str, Any]:
    return {"type": "measured", "file": f"{kind}.{'binary' if kind == 'merl' else 'bsdf'}", **more}


def _pairs() -> tuple[Floats, Floats]:
    """Six directions towards the viewer and six towards light, (6, 3) each."""
    dice = np.random.RandomState(5)

    def six() -> Floats:
        vectors = dice.normal(size=(6, 3))
        vectors[:, 2] = np.abs(vectors[:, 2]) + 0.1
        rounded = (vectors / np.linalg.norm(vectors, axis=1)[:, None]).round(3)
        return np.asarray(rounded / np.linalg.norm(rounded, axis=1)[:, None])

    return six(), six()


OF_MITSUBA = {
    "isotropic": [
        (0.0564799, 0.1454564), (0.0329487, 0.0851179), (0.2458412, 0.6606907),
        (0.0225232, 0.0746785), (0.0328634, 0.0896799), (0.0764154, 0.2111326),
    ],
    "anisotropic": [
        (0.0300646, 0.0763943), (0.0144325, 0.0367272), (0.3375333, 0.9189476),
        (0.0082923, 0.0269084), (0.019235, 0.0530217), (0.04366, 0.1188755),
    ],
    "halves": [
        (0.0300646, 0.0763943), (0.0182579, 0.0466881), (0.3375333, 0.9189476),
        (0.0082923, 0.0269084), (0.0137738, 0.0379649), (0.0561473, 0.1528191),
    ],
    "quarters": [
        (0.0416377, 0.1058714), (0.0144325, 0.0367272), (0.3375333, 0.9189476),
        (0.0082923, 0.0269084), (0.019235, 0.0530217), (0.04366, 0.1188755),
    ],
}  # fmt: skip
"""f cosθ and density that Mitsuba 3.9.1 (scalar_spectral) has for the same files and pairs of directions."""


@pytest.mark.parametrize("kind", PARTS)
def test_values_and_densities_are_those_of_mitsuba(device: Device, folder: Path, kind: str) -> None:
    wo, wi = _pairs()
    fill = np.ones((122, 1)) * [[0.0, 0.0, 1.0]]
    f, pdf, _ = evaluated(device, material(kind), np.concatenate([wo, fill]), np.concatenate([wi, fill]), folder=folder)
    np.testing.assert_allclose(f[:6].T, np.broadcast_to([pair[0] for pair in OF_MITSUBA[kind]], (3, 6)), rtol=2e-5)
    np.testing.assert_allclose(pdf[:6], [pair[1] for pair in OF_MITSUBA[kind]], rtol=2e-5)


def test_values_of_merl_are_those_of_the_table(device: Device, folder: Path) -> None:
    """At the middles of its steps, its numbers; in between, on a line. Directions are made of Rusinkiewicz's angles."""
    tables = read_measured("merl.binary", folder, (), "here").tables
    assert isinstance(tables, MerlTable)
    dice = np.random.RandomState(1)
    step = np.stack([dice.randint(1, 60, 1024), dice.randint(1, 45, 1024), dice.randint(0, 180, 1024)])
    half = ((step[0] + 0.5) / 90.0) ** 2 * np.pi / 2.0
    difference, turn = (step[1] + 0.5) / 90.0 * np.pi / 2.0, (step[2] + 0.5) / 180.0 * np.pi
    around = dice.uniform(0.0, 2.0 * np.pi, 1024)

    def turned(v: Floats, angle: Floats, axes: tuple[int, int]) -> Floats:
        made = v.copy()
        made[:, axes[0]] = v[:, axes[0]] * np.cos(angle) - v[:, axes[1]] * np.sin(angle)
        made[:, axes[1]] = v[:, axes[0]] * np.sin(angle) + v[:, axes[1]] * np.cos(angle)
        return made

    d = np.stack([np.sin(difference) * np.cos(turn), np.sin(difference) * np.sin(turn), np.cos(difference)], axis=1)
    wi, wo = (turned(turned(v, half, (2, 0)), around, (0, 1)) for v in (d, d * (-1.0, -1.0, 1.0)))
    seen = (wi[:, 2] > 0.05) & (wo[:, 2] > 0.05)
    f, _, _ = evaluated(device, material("merl"), wo, wi, folder=folder)
    wanted = tables.values[step[0], step[1], step[2]] * wi[:, 2:]
    assert seen.sum() > 500
    np.testing.assert_allclose(f[seen], wanted[seen], rtol=3e-4)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("degrees", [8.0, 50.0, 82.0])
def test_directions_have_the_density_that_is_said(
    device: Device, evidence: Evidence, folder: Path, kind: str, degrees: float
) -> None:
    wo, cells = towards(degrees), (8, 8)
    expected = chances(device, material(kind), wo, cells, 64, folder=folder)
    wi, weight, _ = sampled(device, material(kind), wo, 7, folder=folder)
    found, lost = counted(wi, weight, cells)
    evidence.histogram("directions", np.append(found, lost), np.append(expected, 1.0 - expected.sum()))
    assert weight.max() < 1.5


@pytest.mark.parametrize("kind", [*KINDS, "plain"])
def test_the_albedo_is_what_is_reflected(device: Device, folder: Path, kind: str) -> None:
    for degrees in (10.0, 45.0, 70.0):
        wo = towards(degrees)
        _, weight, _ = sampled(device, material(kind), wo, 3, folder=folder)
        _, _, albedo = evaluated(device, material(kind), np.repeat(wo[None], 128, 0), directions(1, 128), folder=folder)
        np.testing.assert_allclose(weight.mean(axis=0), albedo[0], rtol=0.06)


@pytest.mark.parametrize("kind", [KINDS[0], *(pytest.param(each, marks=pytest.mark.long) for each in KINDS[1:])])
def test_the_furnace_finds_no_fault(device: Device, folder: Path, monkeypatch: pytest.MonkeyPatch, kind: str) -> None:
    monkeypatch.chdir(folder)
    (found,) = measure(subjects_of(f'{{type = "measured", file = "{material(kind)["file"]}"}}'), device, side=16)
    assert [each.sentence for each in findings(found, 3) if each.fault] == []


def with_balls(folder: Path, kind: str, **more: Any) -> Scene:
    """A ball and a floor of the material, and a diffuse wall."""
    floor = {"type": "quad", "origin": [-3.0, -0.5, 3.0], "edge_u": [6.0, 0.0, 0.0], "edge_v": [0.0, 0.0, -6.0]}
    wall = {"type": "quad", "origin": [-3.0, -0.5, -1.0], "edge_u": [6.0, 0.0, 0.0], "edge_v": [0.0, 3.0, 0.0]}
    lamp = {"type": "sphere", "center": [0.9, 1.2, 0.4], "radius": 0.2, "emission": [6.0, 5.0, 4.0]}
    shapes = [
        {"type": "sphere", "radius": 0.5, "material": "m"},
        {**floor, "material": "m"},
        {**wall, "material": "clay"},
        lamp,
    ]
    materials = {"m": material(kind, **more), "clay": {"type": "lambert", "reflectance": [0.7, 0.4, 0.2]}}
    camera = {"position": [0.0, 0.8, 3.0], "target": [0.0, 0.0, 0.0]}
    scene = clrender.Scene(camera=camera, shapes=shapes, lights=[SKY, SUN], materials=materials)
    return scene.placed("test", folder, ())


@pytest.mark.long
@pytest.mark.parametrize("kind", ["anisotropic", "irreciprocal", "merl"])
@pytest.mark.parametrize(
    "settings",
    [
        {"integrator": "bdpt"},
        {"integrator": "photon", "photons": 16384},
        {"integrator": "reuse"},
        {"guiding": "on"},
        {"sampling": "bsdf"},
        {"sampling": "light"},
        {"kernels": "staged"},
        {"indirect_rays": 2, "shadow_rays": 2},
    ],
    ids=lambda given: "-".join(map(str, given.values())),
)
def test_strategies_see_the_same(
    evidence: Evidence, studio: Studio, folder: Path, kind: str, settings: dict[str, Any]
) -> None:
    scene = with_balls(folder, kind)
    first = studio.tiles(scene, range(10), size=16, tiles=2, spp=128)
    second = studio.tiles(scene, range(50, 60), size=16, tiles=2, spp=128, **settings)
    # Photons are gathered from disks, which do not end where a surface does
    evidence.equal("radiance", first, second, rounding=1e-2 if settings.get("integrator") == "photon" else 0.0)


@pytest.mark.long
@pytest.mark.parametrize("kind", ["anisotropic", "merl"])
def test_the_bits_are_the_same_however_they_are_rendered(device: Device, folder: Path, kind: str) -> None:
    assert len(hashes_by_lanes_and_cuts(device, with_balls(folder, kind))) == 1


def test_the_back_is_black_or_the_same(studio: Studio, folder: Path) -> None:
    """Of one side only, or of both."""
    camera = {"type": "orthographic", "position": [0.0, 0.0, -2.0], "target": [0.0, 0.0, 0.0], "height": 0.5}
    quad = {"type": "quad", "origin": [-1.0, -1.0, 0.0], "edge_u": [2.0, 0.0, 0.0], "edge_v": [0.0, 2.0, 0.0]}

    def mean(two_sided: bool) -> float:
        materials = {"m": material("isotropic", two_sided=two_sided)}
        shapes = [{**quad, "material": "m"}]
        scene = clrender.Scene(camera=camera, shapes=shapes, lights=[SKY], materials=materials)
        return float(studio.image(scene.placed("test", folder, ()), 8, spp=16).mean())

    assert mean(two_sided=False) == 0.0 and mean(two_sided=True) > 0.2


@pytest.mark.long
@pytest.mark.parametrize("kind", ["isotropic", "anisotropic", "plain"])
def test_the_albedo_is_what_a_white_sky_shows(studio: Studio, folder: Path, kind: str) -> None:
    """As a layer; light that would have come from below the surface was counted, a fifth to a half of it."""
    scene = clrender.Scene(
        camera={"position": [0.0, 0.0, 3.0], "target": [0.0, 0.0, 0.0], "vertical_fov": 5.0},
        materials={"measured": material(kind)},
        shapes=[
            {
                "type": "quad",
                "origin": [-2.0, -2.0, 0.0],
                "edge_u": [4.0, 0.0, 0.0],
                "edge_v": [0.0, 4.0, 0.0],
                "material": "measured",
                "transform": {"rotate_degrees": [0.0, 40.0, 0.0]},
            }
        ],
        lights=[SKY],
    ).placed("test", folder, ())
    reflected = studio.image(scene, 8, spp=512).mean(axis=(0, 1))
    np.testing.assert_allclose(studio.layer(scene, 8, "albedo").mean(axis=(0, 1)), reflected, rtol=0.05)
