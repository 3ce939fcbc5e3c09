"""Projectors in files: of our own, of Mitsuba and of pbrt, there and back."""

from __future__ import annotations

import io
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import clrender
from clrender.errors import SceneError
from clrender.exporters import exported, scene_text, write_mitsuba
from clrender.image.exr_write import write_exr
from clrender.scene import ProjectorLight
from clrender.scene.portable import scene_from_portable, scene_to_portable

PIXELS = np.random.default_rng(54).uniform(0.0, 3.0, (4, 6, 3)).astype(np.float32)
MITSUBA = """<scene version="3.0.0">
<sensor type="perspective"/>
<emitter type="projector">
  <transform name="to_world">{}<lookat origin="1, 2, 3" target="1, 2, 0" up="0, 1, 0"/></transform>
  <texture type="bitmap" name="irradiance"><string name="filename" value="slide.exr"/></texture>
  <float name="fov" value="60"/><float name="scale" value="2"/>
</emitter>
</scene>"""
PBRT = """Camera "perspective"
WorldBegin
{}
LightSource "projection" "string filename" "slide.exr" "float fov" 60 {}
"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """With a picture."""
    data = io.BytesIO()
    write_exr(data, PIXELS, {}, {})
    (tmp_path / "slide.exr").write_bytes(data.getvalue())
    return tmp_path


def own(folder: Path, **more: Any) -> clrender.Scene:
    light = {"type": "projector", "position": [0, 1, 2], "direction": [0.2, -1, 0.3], "file": "slide.exr", **more}
    camera = {"position": [0, 0, 5], "target": [0, 0, 0]}
    return clrender.Scene.model_validate({"camera": camera, "lights": [light]}).placed("here", folder)


def projector(scene: clrender.Scene) -> tuple[ProjectorLight, np.ndarray[Any, Any]]:
    """The only light, and its pixels."""
    (light,) = scene.lights
    assert isinstance(light, ProjectorLight)
    return light, scene.light_picture(0).pixels


def test_the_picture_is_part_of_the_scene(folder: Path) -> None:
    scene = own(folder)
    description, assets = scene_to_portable(scene)
    again = scene_from_portable(description, assets)
    assert again.sha256() == scene.sha256()
    np.testing.assert_array_equal(projector(again)[1], PIXELS)
    for change in ({"even": False}, {"vertical_fov": 31.0}, {"up": [0.1, 1.0, 0.0]}):
        assert own(folder, **change).sha256() != scene.sha256()
    with (folder / "slide.exr").open("wb") as file:
        write_exr(file, PIXELS + 1.0, {}, {})
    assert own(folder).sha256() != scene.sha256()


def test_written_to_our_own_files(folder: Path) -> None:
    scene = own(folder, scale=[1, 2, 3])
    export = exported(scene, "files")
    (folder / "again.toml").write_bytes(scene_text(export.description, ".toml", "A projector"))
    for name, write in export.files.items():
        (folder / name).parent.mkdir(exist_ok=True)
        with (folder / name).open("wb") as file:
            write(file)
    again = clrender.load(folder / "again.toml")
    assert again.sha256() == scene.sha256()


def test_mitsuba(folder: Path) -> None:
    """Its picture is the irradiance over pi at distance 1, its field of view that along x."""
    (folder / "a.xml").write_text(MITSUBA.format(""))
    light, pixels = projector(clrender.load(folder / "a.xml"))
    assert light.position == (1.0, 2.0, 3.0) and light.even
    np.testing.assert_allclose((light.direction, light.up), ((0, 0, -1), (0, 1, 0)), atol=1e-12)
    np.testing.assert_allclose(light.scale, 2.0 * math.pi)
    assert math.tan(math.radians(light.vertical_fov / 2)) == pytest.approx(math.tan(math.radians(30)) * 4 / 6)
    np.testing.assert_array_equal(pixels, PIXELS)


def test_mitsuba_mirrored(folder: Path) -> None:
    (folder / "a.xml").write_text(MITSUBA.format('<scale x="-1"/>'))
    light, pixels = projector(clrender.load(folder / "a.xml"))
    np.testing.assert_array_equal(pixels, PIXELS[:, ::-1])
    np.testing.assert_allclose(light.direction, (0, 0, -1), atol=1e-12)


def test_mitsuba_without_a_picture(folder: Path) -> None:
    text = MITSUBA.format("")
    begin, end = text.index("  <texture"), text.index("  <float")
    (folder / "a.xml").write_text(text[:begin] + text[end:])
    scene = clrender.load(folder / "a.xml")
    assert not [light for light in scene.lights if isinstance(light, ProjectorLight)]
    assert "left out" in " ".join(scene.notes)


def test_mitsuba_and_back(folder: Path) -> None:
    scene = own(folder, scale=[3, 1, 2], vertical_fov=50, up=[1, 0, 0])
    assert write_mitsuba(scene, folder / "out.xml") == ()
    light, pixels = projector(clrender.load(folder / "out.xml"))
    assert light.vertical_fov == pytest.approx(50.0)
    np.testing.assert_allclose(light.scale * pixels, PIXELS * np.array([3, 1, 2], np.float32), rtol=1e-6)
    up = np.cross(np.cross((0.2, -1.0, 0.3), (1.0, 0.0, 0.0)), (0.2, -1.0, 0.3))
    np.testing.assert_allclose(light.up, up / np.linalg.norm(up), atol=1e-12)


def test_pbrt(folder: Path) -> None:
    """Its field of view is that along the shorter side, its right is +x, and so the left of a right-handed space."""
    (folder / "a.pbrt").write_text(PBRT.format("", '"float scale" 3'))
    light, pixels = projector(clrender.load(folder / "a.pbrt"))
    assert not light.even and light.direction == (0.0, 0.0, 1.0) and light.up == (0.0, 1.0, 0.0)
    assert light.vertical_fov == pytest.approx(60.0) and light.scale == (3.0, 3.0, 3.0)
    np.testing.assert_array_equal(pixels, PIXELS[:, ::-1])
    (folder / "a.pbrt").write_text(PBRT.format("Scale -1 1 1", ""))
    np.testing.assert_array_equal(projector(clrender.load(folder / "a.pbrt"))[1], PIXELS)


def test_power_of_pbrt(folder: Path) -> None:
    """Of white light of the picture's luminance, by a fine grid."""
    (folder / "a.pbrt").write_text(PBRT.format("", '"float power" 7'))
    light, pixels = projector(clrender.load(folder / "a.pbrt"))
    fine = 50
    bright = np.kron(pixels.astype(np.float64) @ (0.2126, 0.7152, 0.0722), np.ones((fine, fine))) * light.scale[0]
    top = math.tan(math.radians(30.0))
    y, x = (((np.arange(n) + 0.5) / n * 2 - 1) * top for n in bright.shape)
    solid = (2 * top / len(bright)) ** 2 / (1.0 + (y * y)[:, None] + (x * x)[None, :] * 2.25) ** 1.5
    assert float((bright * solid).sum()) == pytest.approx(7.0, rel=0.02)


@pytest.mark.parametrize("fov", [0, 180])
def test_pbrt_fields_that_are_none(folder: Path, fov: float) -> None:
    (folder / "a.pbrt").write_text(PBRT.replace("60", str(fov)).format("", ""))
    with pytest.raises(SceneError, match=r'"fov" is .*line|line.*"fov" is'):
        clrender.load(folder / "a.pbrt")


@pytest.mark.parametrize(
    ("format_", "fault"),
    [*((each, fault) for each in ("xml", "pbrt") for fault in ("missing", "damaged", "wide")), ("xml", "flat")],
)
def test_one_that_cannot_shine_is_left_out(folder: Path, format_: str, fault: str) -> None:
    """And the rest is drawn; with ``strict`` the file is refused."""
    text = MITSUBA.format("<scale x='0'/>" if fault == "flat" else "") if format_ == "xml" else PBRT.format("", "")
    if fault == "missing":
        (folder / "slide.exr").unlink()
    elif fault == "damaged":
        (folder / "slide.exr").write_bytes(b"no picture")
    elif fault == "wide":
        text = text.replace("60", "179")
    text = text.replace("</scene>", '<shape type="sphere"/></scene>') + ('Shape "sphere"' if format_ == "pbrt" else "")
    (folder / f"a.{format_}").write_text(text)
    scene = clrender.load(folder / f"a.{format_}")
    assert not [light for light in scene.lights if isinstance(light, ProjectorLight)]
    assert "left out" in " ".join(scene.notes)
    with pytest.raises(SceneError):
        clrender.load(folder / f"a.{format_}", strict=True)
