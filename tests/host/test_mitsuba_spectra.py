"""Spectra of Mitsuba's media, and spectra that are objects: they stay spectra, and are multiplied as such."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cases import for_each
from grid_files import vol_bytes

from clrender.errors import SceneError
from clrender.importers import load
from clrender.scene.medium import Medium
from clrender.scene.spectra import SpectralColor
from clrender.spectra.colors import reflectance_color, table_wavelengths
from clrender.spectra.lifting import reflectance_spectra, unbounded_spectra


def mitsuba(folder: Path, inside: str) -> Any:
    """The scene of an XML file."""
    path = folder / "scene.xml"
    path.write_text(f'<scene version="3.0.0">\n{inside}\n</scene>', encoding="utf-8")
    return load(path)


def medium(folder: Path, inside: str) -> Any:
    """The medium of a Mitsuba scene."""
    scene = mitsuba(
        folder,
        f'<shape type="sphere"><bsdf type="null"/><medium type="homogeneous" name="interior">{inside}</medium></shape>',
    )
    assert not any("not" in note for note in scene.notes), scene.notes
    (found,) = scene.media.values()
    return found


def seen(*parts: Any) -> Any:
    """Product of tables that are linear between wavelengths and 0 beyond: means around the lines of our tables."""
    fine = np.linspace(357.5, 832.5, 95 * 200 + 1)
    middle = (fine[1:] + fine[:-1]) / 2.0
    product = np.prod([np.interp(middle, part[0], part[1], left=0.0, right=0.0) for part in parts], axis=0)
    return product.reshape(95, 200).mean(axis=1)


def close(coefficient: Any, wanted: Any) -> bool:
    """Whether a spectrum has these values; at both ends of ours, what is beyond them may count."""
    if not isinstance(coefficient, SpectralColor):
        return False
    return float(np.abs(coefficient.values - wanted)[1:-1].max()) < 5e-4 * float(np.max(wanted))


SIGMA: Any = ("400:0.5, 500:3, 701:1.2", ([400.0, 500.0, 701.0], [0.5, 3.0, 1.2]))
SHARES: Any = ("350:0.9, 840:0.2", ([350.0, 840.0], [0.9, 0.2]))
REST: Any = ([350.0, 840.0], [0.1, 0.8])
COLOR = reflectance_spectra(np.array([0.9, 0.5, 0.1]))
WIDE = np.concatenate([[350.0], table_wavelengths(), [840.0]])
AROUND = np.pad(COLOR, 1, "edge")


@for_each("scale", [1.0, 7.0])
@for_each(
    ("albedo", "shares", "rest"),
    [
        (f'<spectrum name="albedo" value="{SHARES[0]}"/>', SHARES[1], REST),
        ('<float name="albedo" value="0.25"/>', (WIDE, np.full(97, 0.25)), (WIDE, np.full(97, 0.75))),
        ("", (WIDE, np.full(97, 0.75)), (WIDE, np.full(97, 0.25))),
        ('<rgb name="albedo" value="0.9, 0.5, 0.1"/>', (WIDE, AROUND), (WIDE, 1.0 - AROUND)),
        (
            f'<volume type="constvolume" name="albedo"><spectrum name="value" value="{SHARES[0]}"/></volume>',
            SHARES[1],
            REST,
        ),
    ],
)
def test_spectra_of_media_are_multiplied(tmp_path: Path, scale: float, albedo: str, shares: Any, rest: Any) -> None:
    extinction = f'<spectrum name="sigma_t" value="{SIGMA[0]}"/><float name="scale" value="{scale}"/>'
    found = medium(tmp_path, extinction + albedo)
    for coefficient, part in ((found.scattering, shares), (found.absorption, rest)):
        assert close(coefficient, scale * seen(SIGMA[1], part))
    # In red, green and blue they are products of colours, as there
    color, share = scale * np.array(reflectance_color(*SIGMA[1])), np.array(reflectance_color(*shares))
    share = np.array([0.9, 0.5, 0.1]) if "rgb" in albedo else share
    assert np.allclose(found.scattering, color * share, rtol=1e-3)
    assert np.allclose(found.absorption, color * (1.0 - share), rtol=1e-3)
    exact = np.ptp(shares[1]) > 0.0
    assert (found.scattering.spectrum.color is not None) == exact
    again = Medium.model_validate(found.model_dump(mode="json", exclude_unset=True))
    assert again == found and np.array_equal(again.scattering, found.scattering)


def test_albedos_that_are_spectra_beside_colors(tmp_path: Path) -> None:
    spectrum = f'<spectrum name="albedo" value="{SHARES[0]}"/>'
    found = medium(tmp_path, f'<rgb name="sigma_t" value="3, 2, 1"/>{spectrum}')
    extinction = (WIDE, np.pad(unbounded_spectra(np.array([3.0, 2.0, 1.0])), 1, "edge"))
    for coefficient, part in ((found.scattering, SHARES[1]), (found.absorption, REST)):
        assert close(coefficient, seen(extinction, part))
    assert np.add(found.scattering, found.absorption) == pytest.approx((3.0, 2.0, 1.0), rel=1e-12)
    plain = medium(tmp_path, '<rgb name="sigma_t" value="3, 2, 1"/><rgb name="albedo" value="0.5, 0.25, 0"/>')
    assert plain.scattering == (1.5, 0.5, 0.0) and plain.absorption == (1.5, 1.5, 1.0)
    assert not isinstance(plain.scattering, SpectralColor)


def test_coefficients_of_old_media(tmp_path: Path) -> None:
    inside = f'<spectrum name="sigma_a" value="{SIGMA[0]}"/><rgb name="sigma_s" value="1, 2, 3"/>'
    found = medium(tmp_path, inside + '<float name="scale" value="10"/>')
    assert close(found.absorption, 10.0 * seen(SIGMA[1]))
    assert found.scattering == (10.0, 20.0, 30.0) and not isinstance(found.scattering, SpectralColor)


def test_albedos_beside_a_density(tmp_path: Path) -> None:
    """Of a grid, which is the extinction; and a grid of albedos beside an extinction that is a spectrum."""
    for name in ("density", "share"):
        (tmp_path / f"{name}.vol").write_bytes(vol_bytes(np.full((2, 3, 4), 0.5, np.float32)))
    volume = '<volume type="gridvolume" name="{}"><string name="filename" value="{}.vol"/></volume>'
    spectrum = '<spectrum name="{}" value="{}"/>'
    grid = medium(tmp_path, volume.format("sigma_t", "density") + spectrum.format("albedo", SHARES[0]))
    assert grid.density is not None and grid.albedo is None
    assert close(grid.scattering, seen(SHARES[1]))
    assert close(grid.absorption, seen(REST))
    beside = medium(tmp_path, volume.format("albedo", "share") + spectrum.format("sigma_t", SIGMA[0]))
    assert beside.albedo is not None and not any(beside.absorption)
    assert close(beside.scattering, seen(SIGMA[1]))


@for_each("given", ['<spectrum name="sigma_t" value="0.3"/>', '<spectrum name="sigma_t" value="500:3, 600:-1"/>'])
def test_what_stays_colors(tmp_path: Path, given: str) -> None:
    """What is the same at all wavelengths, and what no medium has."""
    found = medium(tmp_path, given)
    assert not isinstance(found.scattering, SpectralColor) and not isinstance(found.absorption, SpectralColor)


@for_each(
    "inside",
    [
        '<spectrum {} type="irregular"><string name="wavelengths" value="400, 500, 600"/>'
        '<string name="values" value="0.5, 0.25, 0.75"/></spectrum>',
        '<spectrum {} type="regular"><float name="wavelength_min" value="400"/>'
        '<float name="wavelength_max" value="600"/><string name="values" value="0.5 0.25 0.75"/></spectrum>',
    ],
)
def test_spectra_that_are_objects(tmp_path: Path, inside: str) -> None:
    """Of media, surfaces and lights; they are 0 beyond their ends."""
    values = seen(([400.0, 500.0, 600.0], [0.5, 0.25, 0.75]))
    found = medium(tmp_path, inside.format('name="sigma_t"') + '<float name="albedo" value="0"/>')
    assert close(found.absorption, values)
    paint, lamp = (inside.format(f'name="{name}"') for name in ("reflectance", "radiance"))
    surface = f'<bsdf type="diffuse">{paint}</bsdf><emitter type="area">{lamp}</emitter>'
    scene = mitsuba(tmp_path, f'<shape type="sphere">{surface}</shape>')
    assert not any("not" in note for note in scene.notes), scene.notes
    assert close(scene.materials["diffuse"].reflectance, values)
    shining = scene.shapes[0].emission
    assert list(shining.spectrum.wavelengths) == [400.0, 500.0, 600.0]
    assert list(shining.spectrum.values) == [0.5, 0.25, 0.75]


@for_each(
    ("inside", "words"),
    [
        (
            '<string name="wavelengths" value="400, 500"/><string name="values" value="1"/>',
            "2 wavelengths and 1 value;",
        ),
        ('<string name="wavelengths" value="500, 400"/><string name="values" value="1, 2"/>', "do not grow"),
        ('<string name="wavelengths" value="400, 5_0"/><string name="values" value="1, 2"/>', "no finite number"),
        ('<string name="wavelengths" value="400"/>', 'has 0 numbers in "values"'),
    ],
)
def test_faulty_spectra_are_refused(tmp_path: Path, inside: str, words: str) -> None:
    given = f'<spectrum name="sigma_t" type="irregular">{inside}</spectrum>'
    with pytest.raises(SceneError, match=words):
        medium(tmp_path, given)
