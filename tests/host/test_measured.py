"""Measured reflectance: its files, what they say, and scenes that name them."""

from __future__ import annotations

import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from measured_files import gray, part_of, rgl_fields, write_merl, write_tensors

import clrender
from clrender import layout
from clrender.errors import SceneError
from clrender.exporters import exported, exported_to_cycles, exported_to_luxcore, scene_text, write_mitsuba
from clrender.flatten.flat_scene import flatten
from clrender.flatten.measured import measured_color
from clrender.measured import MeasuredFile, MerlTable, RglTables, read_measured
from clrender.scene.materials import Measured
from clrender.scene.portable import scene_from_portable, scene_to_portable
from clrender.spectra.colors import reflectance_color, reflectance_weights

SMALL: dict[str, Any] = {"side": 8, "views": 3}


@pytest.fixture
def paint(tmp_path: Path) -> Path:
    return write_tensors(tmp_path / "paint.bsdf", rgl_fields(spectral=True, **SMALL))


def described(file: str = "paint.bsdf", **more: Any) -> dict[str, Any]:
    return {
        "camera": {"position": [0.0, 0.0, 5.0], "target": [0.0, 0.0, 0.0]},
        "materials": {"paint": {"type": "measured", "file": file, **more}},
        "shapes": [{"type": "sphere", "radius": 1.0, "material": "paint"}],
        "lights": [{"type": "environment", "radiance": [1.0, 1.0, 1.0]}],
    }


def scene_in(folder: Path, file: str = "paint.bsdf", **more: Any) -> clrender.Scene:
    return clrender.Scene(**described(file, **more)).placed("test", folder, ())


def test_tables_of_rgb_and_of_spectra(tmp_path: Path) -> None:
    fields = rgl_fields(**SMALL)
    tables = read_measured(write_tensors(tmp_path / "a.bsdf", fields).name, tmp_path, (), "here").tables
    assert isinstance(tables, RglTables) and tables.isotropic and tables.symmetry == 1 and tables.has_jacobian
    np.testing.assert_array_equal(tables.values, np.moveaxis(fields["rgb"], 2, -1))
    spectral = gray(rgl_fields(spectral=True, **SMALL))
    tables = MeasuredFile.checked(np.fromfile(write_tensors(tmp_path / "b.bsdf", spectral), np.uint8), "b").tables
    assert isinstance(tables, RglTables)
    for channel in range(3):
        np.testing.assert_allclose(tables.values[..., channel], spectral["luminance"] * 0.7, rtol=1e-6)


def test_spectra_have_their_colour_in_daylight() -> None:
    wavelengths = np.linspace(380.0, 780.0, 81)
    values = 0.5 + 0.3 * np.sin(wavelengths / 60.0)
    color = values @ reflectance_weights(wavelengths.tolist())
    np.testing.assert_allclose(color, reflectance_color(wavelengths.tolist(), values.tolist()), atol=2e-3)
    np.testing.assert_allclose(reflectance_weights([500.0, 600.0]).sum(axis=0), 1.0, rtol=1e-12)


@pytest.mark.parametrize(("azimuths", "symmetry"), [(9, 1), (5, 2), (3, 4)])
def test_parts_of_a_turn_that_were_measured(tmp_path: Path, azimuths: int, symmetry: int) -> None:
    fields = part_of(rgl_fields(0.3, 9, **SMALL), azimuths)
    tables = read_measured(write_tensors(tmp_path / "a.bsdf", fields).name, tmp_path, (), "here").tables
    assert isinstance(tables, RglTables) and not tables.isotropic and tables.symmetry == symmetry


def test_a_merl_table_has_its_scales_and_no_light_below_zero(tmp_path: Path) -> None:
    def reflected(half: Any, difference: Any, turn: Any) -> Any:
        return np.array([0.1, 0.2, 0.3]) * (half + difference + turn) - np.array([0.0, 0.0, 0.5])

    write_merl(tmp_path / "a.binary", reflected)
    tables = read_measured("a.binary", tmp_path, (), "here").tables
    assert isinstance(tables, MerlTable)
    half, difference, turn = (10.5 / 90) ** 2 * np.pi / 2, 20.5 / 90 * np.pi / 2, 30.5 / 180 * np.pi
    wanted = np.maximum(reflected(half, difference, turn), 0.0)
    np.testing.assert_allclose(tables.values[10, 20, 30], wanted, rtol=1e-6)
    assert wanted[2] == 0.0


def _without(name: str) -> dict[str, Any]:
    fields = rgl_fields(**SMALL)
    del fields[name]
    return fields


def _with(**changed: Any) -> dict[str, Any]:
    return {**rgl_fields(**SMALL), **changed}


@pytest.mark.parametrize(
    ("fields", "said"),
    [
        (_without("vndf"), "has no field vndf"),
        (_without("theta_i"), "has no field theta_i"),
        (_without("rgb"), "has no field spectra"),
        (_without("jacobian"), "no field jacobian"),
        (_with(theta_i=np.array([0.5, 0.2, 1.0], np.float32)), "theta_i must ascend"),
        (_with(theta_i=np.array([0.5, np.nan, 1.0], np.float32)), "theta_i must be"),
        (_with(sigma=np.full((8, 8), -1.0, np.float32)), "sigma has no numbers, or such"),
        (_with(sigma=np.zeros((8, 8), np.float32)), "sigma is below 0.0001 somewhere"),
        (_with(ndf=np.zeros((8, 8), np.float32)), "ndf is 0 everywhere"),
        (_with(ndf=np.full((8, 8), np.inf, np.float32)), "ndf has no numbers, or such"),
        (_with(ndf=np.ones((8, 1), np.float32)), "2 to 4096 along each side"),
        (_with(vndf=np.zeros((1, 3, 8, 8), np.float32)), "vndf is 0 for all half vectors"),
        (_with(vndf=np.ones((1, 2, 8, 8), np.float32)), "does not fit its angles"),
        (_with(rgb=np.ones((1, 3, 3, 4, 4), np.float32)), "rgb has the shape"),
        (_with(rgb=np.full((1, 3, 3, 8, 8), np.nan, np.float32)), "colours are not finite"),
        (_with(luminance=np.ones((1, 3, 8, 8))), "luminance holds float64"),
    ],
)
def test_damaged_tables_are_refused(tmp_path: Path, fields: dict[str, Any], said: str) -> None:
    write_tensors(tmp_path / "a.bsdf", fields)
    with pytest.raises(SceneError, match=rf'here: "a.bsdf" is no readable file of measured reflectance: .*{said}'):
        read_measured("a.bsdf", tmp_path, (), "here")


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (b"", "numbers of steps are none"),
        (b"tensor_file\0\2\0\0\0\0\0", "version is 2.0"),
        (b"tensor_file\0\1\0\xff\0\0\0", "255 fields"),
        (b"tensor_file\0\1\0\1\0\0\0\3\0abc\1\0\1" + struct.pack("<QQ", 0, 2**62), "reaches beyond its end"),
        (b"tensor_file\0\1\0\1\0\0\0\3\0abc\2\0\1" + struct.pack("<QQQ", 0, 2**62, 0), "reaches beyond its end"),
        (b"tensor_file\0\1\0\1\0\0\0\3\0abc\1\0\x2f" + struct.pack("<QQ", 0, 1), "unknown type"),
        (struct.pack("<3i", 90, 90, 360), "90 x 90 x 360, but"),
        (struct.pack("<3i", 90, 90, 180), "its head promises 34992012"),
    ],
)
def test_other_files_are_refused(tmp_path: Path, content: bytes, said: str) -> None:
    (tmp_path / "a.bsdf").write_bytes(content)
    with pytest.raises(SceneError, match=said):
        read_measured("a.bsdf", tmp_path, (), "here")


def test_names_are_checked(tmp_path: Path) -> None:
    with pytest.raises(SceneError, match=r"measured reflectance may be \.bsdf, \.binary"):
        read_measured("a.txt", tmp_path, (), "here")
    with pytest.raises(SceneError, match="lies outside"):
        read_measured("../a.bsdf", tmp_path, (), "here")
    with pytest.raises(SceneError, match=r'test: materials\.paint\.file: "paint.bsdf"'):
        flatten(scene_in(tmp_path), 8, 8)


def test_mutated_files_are_read_or_refused_in_one_sentence(tmp_path: Path, paint: Path) -> None:
    whole, dice = paint.read_bytes(), np.random.RandomState(3)
    outcomes = set()
    for _ in range(150):
        data = bytearray(whole)
        for place in dice.randint(0, 700 if dice.rand() < 0.8 else len(data), dice.randint(1, 4)):
            data[place] = dice.randint(256)
        data = data[: dice.randint(len(data))] if dice.rand() < 0.2 else data
        try:
            file = MeasuredFile.checked(np.frombuffer(bytes(data), np.uint8), "a")
            scene = scene_in(tmp_path).with_files(measured={"paint.bsdf": file})
            outcomes.add(bool(np.isfinite(flatten(scene, 8, 8).arrays["measured_words"]).all()))
        except SceneError as error:
            assert "\n" not in str(error) and len(str(error)) < 400
            outcomes.add(False)
    assert outcomes == {True, False}


def test_every_density_integrates_to_one(paint: Path) -> None:
    arrays = flatten(scene_in(paint.parent), 8, 8).arrays
    words, head = arrays["measured_words"], arrays["measured_rows"].reshape(-1).view(np.uint32)
    columns = layout.columns("MEASURED")
    for name in ("NORMALS", "LUMINANCE"):
        at, height = head[columns[f"{name}_COLUMN"]], 8
        column = words[at : at + 3 * height].reshape(3, height)
        np.testing.assert_allclose(column[:, 0], 0.0)
        np.testing.assert_allclose(column[:, -1], 1.0, rtol=1e-6)
        assert (np.diff(column, axis=1) >= 0.0).all()


def test_the_colour_of_a_material(paint: Path) -> None:
    scene = scene_in(paint.parent)
    ((name, material),) = scene.measured_materials()
    red, green, blue = measured_color(scene, name, material)
    assert 0.15 < blue < green < red < 0.45, "warm"


def test_scenes_are_known_by_the_content_of_the_file(tmp_path: Path, paint: Path) -> None:
    first = scene_in(tmp_path).sha256()
    write_tensors(tmp_path / "other.bsdf", rgl_fields(0.3, spectral=True, **SMALL))
    (tmp_path / "same.bsdf").write_bytes(paint.read_bytes())
    assert scene_in(tmp_path, "same.bsdf").sha256() == first
    assert scene_in(tmp_path, "other.bsdf").sha256() != first
    arrays = {file: flatten(scene_in(tmp_path, file), 8, 8).arrays_sha256 for file in ("paint.bsdf", "same.bsdf")}
    assert len(set(arrays.values())) == 1
    assert flatten(scene_in(tmp_path, "other.bsdf"), 8, 8).arrays_sha256 != arrays["paint.bsdf"]


def test_other_processes_and_our_own_files_have_the_same_scene(tmp_path: Path, paint: Path) -> None:
    scene = scene_in(paint.parent, two_sided=False, anisotropy_rotation=30.0)
    description, assets = scene_to_portable(scene)
    again = scene_from_portable(description, assets)
    assert again.sha256() == scene.sha256()
    export = exported(again, "files")
    with export.written(tmp_path / "out.toml"):
        (tmp_path / "out.toml").write_bytes(scene_text(export.description, ".toml", "a test"))
    assert clrender.load(tmp_path / "out.toml").sha256() == scene.sha256()


MITSUBA = """<scene version="3.0.0"><sensor type="perspective"/><emitter type="constant"/>
<shape type="sphere"><bsdf type="measured"><string name="filename" value="{0}"/></bsdf></shape>
<shape type="sphere"><bsdf type="twosided"><bsdf type="measured"><string name="filename" value="{0}"/></bsdf></bsdf>
</shape></scene>"""
PBRT = """Camera "perspective"
WorldBegin
LightSource "infinite"
Material "measured" "string filename" "{0}"
Shape "sphere"
"""


def test_mitsuba_and_pbrt_name_them(tmp_path: Path, paint: Path) -> None:
    (tmp_path / "a.xml").write_text(MITSUBA.format(paint.name))
    (tmp_path / "a.pbrt").write_text(PBRT.format(paint.name))
    scene = clrender.load(tmp_path / "a.xml")
    made = [scene.materials[str(shape.material)] for _, shape in scene.all_shapes()]
    assert [(each.type, each.two_sided) for each in made if isinstance(each, Measured)] == [
        ("measured", False),
        ("measured", True),
    ]
    (described,) = clrender.load(tmp_path / "a.pbrt").materials.values()
    assert isinstance(described, Measured) and described.two_sided
    for file, text in (("b.xml", MITSUBA), ("b.pbrt", PBRT)):
        (tmp_path / file).write_text(text.format("missing.bsdf"))
        (left,) = {each.type for each in clrender.load(tmp_path / file).materials.values()}
        assert left == "lambert"


def test_mitsuba_gets_the_same_file_and_other_programs_a_colour(tmp_path: Path, paint: Path) -> None:
    assert write_mitsuba(scene_in(tmp_path), tmp_path / "out.xml") == ()
    (written,) = (tmp_path / "out-files").glob("*.bsdf")
    assert written.read_bytes() == paint.read_bytes()
    again = clrender.load(tmp_path / "out.xml")
    ((name, material),) = again.measured_materials()
    assert again.measured(name, material).content.tobytes() == paint.read_bytes()
    write_tensors(tmp_path / "plain.bsdf", rgl_fields(**SMALL))
    (note,) = write_mitsuba(scene_in(tmp_path, "plain.bsdf"), tmp_path / "other.xml")
    assert "measured reflectance" in note and 'type="diffuse"' in (tmp_path / "other.xml").read_text()
    for export in (exported_to_cycles(scene_in(tmp_path), "f"), exported_to_luxcore(scene_in(tmp_path), "f")):
        assert any("measured reflectance" in each for each in export.notes)


def test_anisotropic_ones_follow_the_tangents_of_meshes(tmp_path: Path, paint: Path) -> None:
    write_tensors(tmp_path / "brushed.bsdf", rgl_fields(0.3, 5, **SMALL))
    corners = {
        "vertices": [[0, 0, 0], [1, 0, 0], [0, 1, 0]],
        "faces": [[0, 1, 2]],
        "tangents": [[1.0, 0.0, 0.0, 1.0]] * 3,
    }
    mixture = {"type": "mix", "materials": ["paint", "other"]}
    for file, asked in ((paint.name, False), ("brushed.bsdf", True)):
        for material in ("paint", "mixed"):
            content = described(file)
            content["shapes"] = [{"type": "mesh", "file": "m", "material": material}]
            content["materials"] |= {"other": {"type": "lambert", "reflectance": [0.5] * 3}, "mixed": mixture}
            scene = clrender.Scene(**content).placed("test", tmp_path, ()).with_arrays(meshes={"m": corners})
            assert flatten(scene, 8, 8).features.tangents == asked
