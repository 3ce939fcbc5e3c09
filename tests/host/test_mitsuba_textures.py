"""Textures and colours within others in Mitsuba's files, and what of plastic is told."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cases import for_each
from PIL import Image

import clrender.importers.mitsuba
from clrender.importers.asset_files import AssetFiles
from clrender.importers.draft import Draft
from clrender.importers.shared.curved import mean_color


def mitsuba(folder: Path, inside: str, version: str = "0.6.0") -> Draft:
    Image.fromarray(np.array([[[0, 255, 255], [255, 255, 0]]], np.uint8)).save(folder / "t.png")
    (folder / "s.xml").write_text(f'<scene version="{version}">{inside}</scene>', encoding="utf-8")
    return clrender.importers.mitsuba.read(folder / "s.xml", AssetFiles("s", folder))


def surface(texture: str) -> str:
    return f'<shape type="sphere"><bsdf type="diffuse">{texture}</bsdf></shape>'


def lamp(texture: str) -> str:
    return f'<shape type="sphere"><emitter type="area">{texture}</emitter></shape>'


def scaled(factor: str, inside: str, name: str = "") -> str:
    return f'<texture {name} type="scale">{factor}{inside}</texture>'


HALF = '<float name="scale" value="0.5"/>'
PICTURE = '<texture type="bitmap"><string name="filename" value="t.png"/></texture>'
CHECKER = '<texture type="checkerboard"><rgb name="color0" value="0.8"/><rgb name="color1" value="0.4"/></texture>'
NAME = 'name="reflectance"'


@for_each(
    ("texture", "key", "expected"),
    [
        (scaled(HALF, PICTURE, NAME), "scale", 0.5),
        (scaled(HALF, scaled(HALF, PICTURE), NAME), "scale", 0.25),
        (scaled('<rgb name="scale" value="0.2,0.4,0.6"/>', PICTURE, NAME), "scale", [0.2, 0.4, 0.6]),
        (scaled('<float name="value" value="0.5"/>', PICTURE, NAME), "scale", 0.5),
        (scaled(HALF, CHECKER, NAME), "checker", [[0.4] * 3, [0.2] * 3]),
    ],
)
def test_scaled_textures_of_old_files(tmp_path: Path, texture: str, key: str, expected: Any) -> None:
    draft = mitsuba(tmp_path, surface(texture))
    (material,) = draft.description["materials"].values()
    np.testing.assert_allclose(material["reflectance"][key], expected)
    assert not draft.notes


def test_lamps_may_be_scaled_beyond_1(tmp_path: Path) -> None:
    texture = scaled('<float name="scale" value="5"/>', CHECKER, 'name="radiance"')
    (shape,) = mitsuba(tmp_path, lamp(texture)).description["shapes"]
    np.testing.assert_allclose(shape["emission"]["checker"], [[4.0] * 3, [2.0] * 3])


D65 = '<emitter type="point"><spectrum name="intensity" type="d65">{}</spectrum></emitter>'


@for_each(
    ("inside", "expected"),
    [
        ("", [1.0] * 3),
        ('<float name="scale" value="3"/>', [3.0] * 3),
        ('<rgb name="color" value="3,2,1"/>', [3.0, 2.0, 1.0]),
        ('<rgb name="color" value="3,2,1"/><float name="scale" value="2"/>', [6.0, 4.0, 2.0]),
    ],
)
def test_colours_of_d65(tmp_path: Path, inside: str, expected: list[float]) -> None:
    draft = mitsuba(tmp_path, D65.format(inside) + surface(""), "3.0.0")
    assert draft.description["lights"][0]["intensity"] == pytest.approx(expected) and not draft.notes


def test_what_is_lost_in_d65_is_told(tmp_path: Path) -> None:
    texture = '<texture name="color" type="bitmap"><string name="filename" value="t.png"/></texture>'
    draft = mitsuba(tmp_path, D65.format(texture) + surface(""), "3.0.0")
    assert any('"color" of the spectrum of type "d65"' in note for note in draft.notes)


def test_what_is_in_checkerboards(tmp_path: Path) -> None:
    picture = PICTURE.replace("<texture", '<texture name="color0"')
    grey = '<spectrum name="color1" type="uniform"><float name="value" value="0.25"/></spectrum>'
    draft = mitsuba(tmp_path, surface(f'<texture {NAME} type="checkerboard">{picture}{grey}</texture>'), "3.0.0")
    (material,) = draft.description["materials"].values()
    np.testing.assert_allclose(material["reflectance"]["checker"], [[0.5, 1.0, 0.5], [0.25] * 3], rtol=1e-3)
    assert any("a texture in a checkerboard" in note for note in draft.notes)


def test_means_of_pictures_are_weighed_by_their_scale(tmp_path: Path) -> None:
    Image.fromarray(np.array([[[0, 0, 0], [255, 255, 255]]], np.uint8)).save(tmp_path / "u.png")
    from clrender.importers.shared.staging import Staging

    staging = Staging(AssetFiles("s", tmp_path))
    assert mean_color(staging, {"texture": "u.png", "scale": [0.5, 1.0, 4.0]}, 0.3, 1) == pytest.approx(
        [0.25, 0.5, 1.0]
    )
    assert mean_color(staging, {"texture": "none.png"}, 0.3, 1) == [0.3] * 3


@for_each(("given", "told"), [("", False), ('<float name="specular_reflectance" value="0.5"/>', True)])
def test_weaker_highlights_of_plastic_are_told(tmp_path: Path, given: str, told: bool) -> None:
    draft = mitsuba(tmp_path, f'<shape type="sphere"><bsdf type="plastic">{given}</bsdf></shape>', "3.0.0")
    assert any("specular_reflectance" in note for note in draft.notes) == told


@for_each(("scale", "told"), [('x="2" y="2"', False), ('x="2" y="1.5"', True)])
def test_parallel_cameras_that_are_stretched_are_told(tmp_path: Path, scale: str, told: bool) -> None:
    sensor = f'<sensor type="orthographic"><transform name="to_world"><scale {scale}/></transform></sensor>'
    draft = mitsuba(tmp_path, sensor + surface(""), "3.0.0")
    assert any("scales differently" in note for note in draft.notes) == told
