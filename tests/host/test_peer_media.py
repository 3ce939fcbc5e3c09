"""Where media of pbrt and Mitsuba are: around the camera, in shapes and in bubbles; and names that come too late."""

from __future__ import annotations

import gzip
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cases import for_each

from clrender.errors import SceneError
from clrender.importers import load
from clrender.importers.shared.white_balance import white_balance
from clrender.scene import Scene
from clrender.spectra.colors import blackbody_color, luminance

SMOKE = 'MakeNamedMedium "m" "string type" "homogeneous" "rgb sigma_a" [1 2 4] "rgb sigma_s" [0 0 0] {}\n'
CAMERA = 'Camera "perspective"\n'
BALL = 'Shape "sphere"\n'
NULL = 'Material "interface"\n'
GLASS = 'Material "dielectric"\n'


def pbrt(folder: Path, text: str) -> Scene:
    """The scene of a pbrt file."""
    (folder / "scene.pbrt").write_text(text, encoding="utf-8")
    return load(folder / "scene.pbrt")


def in_fog(folder: Path, world: str) -> Scene:
    """A scene whose camera is in the medium m."""
    return pbrt(folder, f'{SMOKE.format("")}MediumInterface "" "m"\n{CAMERA}WorldBegin\n{world}')


def interiors(scene: Scene) -> list[str | None]:
    return [shape.interior for shape in scene.shapes]


def is_vacuum(scene: Scene, name: str | None) -> bool:
    """Whether a medium weakens no light by as much as rounding does."""
    medium = scene.media[str(name)]
    return max(medium.absorption) <= 1e-9 and medium.scattering == (0.0, 0.0, 0.0)


# --- pbrt


def test_the_medium_of_the_camera_ends_at_its_shape(tmp_path: Path) -> None:
    outside = f'{NULL}MediumInterface "m" ""\n{BALL}'
    scene = in_fog(tmp_path, outside)
    assert scene.fog is None and interiors(scene) == ["m"]
    # A shape that the medium is but around is no end of it
    scene = in_fog(tmp_path, f'{GLASS}MediumInterface "" "m"\n{BALL}')
    assert scene.fog == "m" and interiors(scene) == [None]


def test_glass_between_equal_media_is_filled_by_them(tmp_path: Path) -> None:
    world = f'{GLASS}MediumInterface "m"\n{BALL}MediumInterface "" ""\n{BALL}Material "conductor"\n{BALL}'
    scene = in_fog(tmp_path, world + f'{NULL}{BALL}Material "thindielectric"\n{BALL}')
    assert scene.fog == "m" and interiors(scene) == ["m", "m", None, None]
    assert not any("glass that names" in note for note in scene.notes)
    scene = in_fog(tmp_path, f'{NULL}MediumInterface "m" ""\n{BALL}{GLASS}MediumInterface ""\n{BALL}')
    assert interiors(scene) == ["m", None] and any("glass that names no media" in note for note in scene.notes)


@pytest.mark.parametrize("smoke", [False, True])
def test_bubbles(tmp_path: Path, smoke: bool) -> None:
    bubble = f'{NULL}MediumInterface "" "m"\n{BALL}'
    ball = f'AttributeBegin\n{NULL}MediumInterface "m" ""\nScale 3 3 3\n{BALL}AttributeEnd\n'
    scene = (
        pbrt(tmp_path, f"{SMOKE.format('')}{CAMERA}WorldBegin\n{ball}{bubble}") if smoke else in_fog(tmp_path, bubble)
    )
    assert scene.fog == (None if smoke else "m")
    assert is_vacuum(scene, scene.shapes[-1].interior)


def test_reversed_boundaries_have_their_sides_exchanged(tmp_path: Path) -> None:
    world = f'ReverseOrientation\n{NULL}MediumInterface "" "m"\n{BALL}MediumInterface "m" ""\n{BALL}'
    scene = pbrt(tmp_path, f"{SMOKE.format('')}{CAMERA}WorldBegin\n{world}{GLASS}{BALL}")
    first, second, glass = scene.shapes
    assert first.interior == "m" and is_vacuum(scene, second.interior) and glass.interior == "m"
    assert [shape.model_dump()["flip_normals"] for shape in scene.shapes] == [False, False, True]


def test_what_a_name_means_may_be_said_later(tmp_path: Path) -> None:
    late = 'Texture "t" "spectrum" "constant" "rgb value" [1 0 0]\n' + SMOKE.format("")
    late += 'MakeNamedMaterial "x" "string type" "diffuse" "texture reflectance" "t"\n'
    world = f'{NULL}MediumInterface "m" ""\n{BALL}MediumInterface ""\nNamedMaterial "x"\n{BALL}'
    world += f'Material "diffuse" "texture reflectance" "t"\n{BALL}'
    world += f'Material "mix" "string materials" ["x" "x"]\n{BALL}'
    scene = pbrt(tmp_path, f"{CAMERA}WorldBegin\n{world}{late}")
    ball, named, plain, mixed = scene.shapes
    assert ball.interior == "m" and scene.media["m"].absorption == (1.0, 2.0, 4.0)
    for shape in (named, plain):
        assert scene.materials[str(shape.material)].model_dump()["reflectance"] == (1.0, 0.0, 0.0)
    assert scene.materials[str(mixed.material)].model_dump()["materials"] == ("x", "x")


def test_a_name_of_two_things_means_the_one_before(tmp_path: Path) -> None:
    world = ""
    for red in (0.25, 0.75):
        world += (
            f'MakeNamedMaterial "x" "string type" "diffuse" "rgb reflectance" [{red} 0 0]\nNamedMaterial "x"\n{BALL}'
        )
    scene = pbrt(tmp_path, f"{CAMERA}WorldBegin\n{world}")
    colors = [scene.materials[str(shape.material)].model_dump()["reflectance"] for shape in scene.shapes]
    assert colors == [(0.25, 0.0, 0.0), (0.75, 0.0, 0.0)]


@for_each(
    ("world", "words"),
    [
        ('NamedMaterial "x"\n', "the material .x. is not defined"),
        ('MakeNamedMaterial "x" "string type" "mix" "string materials" ["x" "x"]\n', "the material .x. is not defined"),
        ('Texture "t" "float" "scale" "texture tex" "t"\n', "the float texture .t. is not defined"),
    ],
)
def test_names_without_a_meaning(tmp_path: Path, world: str, words: str) -> None:
    with pytest.raises(SceneError, match=words):
        pbrt(tmp_path, f"{CAMERA}WorldBegin\n{world}{BALL}")


def test_media_without_a_definition_are_told(tmp_path: Path) -> None:
    scene = pbrt(tmp_path, f'{CAMERA}WorldBegin\n{GLASS}MediumInterface "nope" ""\n{BALL}')
    assert interiors(scene) == [None] and any('the medium "nope" is not defined' in note for note in scene.notes)


def test_a_grid_around_the_camera_is_told(tmp_path: Path) -> None:
    grid = SMOKE.format('"integer nx" 1 "integer ny" 1 "integer nz" 1 "float density" [1]')
    grid = grid.replace("homogeneous", "uniformgrid")
    scene = pbrt(tmp_path, f'{grid}MediumInterface "" "m"\n{CAMERA}WorldBegin\n{BALL}')
    assert scene.fog is None and any("whose grid ends at no shape" in note for note in scene.notes)


# --- light of media


def shining(folder: Path, light: str, film: str = "", more: str = "") -> Scene:
    """The scene of a ball that shines."""
    before = f"{SMOKE.format(light)}{film}{CAMERA}"
    return pbrt(folder, f'{before}WorldBegin\n{more}{NULL}MediumInterface "m" ""\n{BALL}')


@for_each(
    ("light", "color"),
    [
        ('"rgb Le" [3 2 1]', (3.0, 2.0, 1.0)),
        (
            '"blackbody Le" 3000 "float Lescale" 5',
            5.0 * np.array(blackbody_color(3000.0)) / luminance(blackbody_color(3000.0)),
        ),
        ('"spectrum Le" "stdillum-D65"', (1.0, 1.0, 1.0)),
    ],
)
def test_light_of_media_is_normalised_as_that_of_lamps(tmp_path: Path, light: str, color: Any) -> None:
    scene = shining(tmp_path, light)
    np.testing.assert_allclose(scene.media["m"].emission, np.array(color) * (1.0, 2.0, 4.0), rtol=1e-12)
    assert not any("not known" in note for note in scene.notes)


@pytest.mark.parametrize("kind", ["homogeneous", "rgbgrid"])
def test_the_film_exposes_light_of_media(tmp_path: Path, kind: str) -> None:
    def emitted(film: str) -> Any:
        light = '"rgb Le" [1 1 1]'
        grid = f'"integer nx" 1 "integer ny" 1 "integer nz" 1 {light}' if kind == "rgbgrid" else light
        text = f"{SMOKE.format(grid).replace('homogeneous', kind)}{film}{CAMERA}WorldBegin\n"
        scene = pbrt(tmp_path, f'{text}{NULL}MediumInterface "m" ""\n{BALL}')
        return np.array(scene.media["m"].emission)

    plain = emitted('Film "rgb"\n')
    np.testing.assert_allclose(emitted('Film "rgb" "float iso" 200\n'), 2.0 * plain)
    if kind == "homogeneous":
        wanted = white_balance(3000.0) @ np.ones(3) * plain
        np.testing.assert_allclose(emitted('Film "rgb" "float whitebalance" 3000\n'), wanted, rtol=1e-9)


def test_media_that_shine_are_the_light_of_a_scene(tmp_path: Path) -> None:
    assert not any("there is no light in it" in note for note in shining(tmp_path, '"rgb Le" [1 1 1]').notes)
    assert any("there is no light in it" in note for note in shining(tmp_path, "").notes)


def test_boundaries_of_media_are_no_lamps(tmp_path: Path) -> None:
    scene = shining(tmp_path, "", more='AreaLightSource "diffuse"\n')
    (shape,) = scene.shapes
    assert shape.interior == "m" and not shape.shines
    assert any("area lights on" in note and "as in pbrt" in note for note in scene.notes)


# --- packed files


def test_packed_files_are_included(tmp_path: Path) -> None:
    (tmp_path / "part.pbrt.gz").write_bytes(gzip.compress(BALL.encode()))
    scene = pbrt(tmp_path, f'{CAMERA}WorldBegin\nInclude "part.pbrt.gz"\nImport "part.pbrt.gz"\n')
    assert len(scene.shapes) == 2


@for_each("data", [b"no file of gzip", gzip.compress(BALL.encode())[:-9], b""])
def test_damaged_packed_files_are_refused(tmp_path: Path, data: bytes) -> None:
    (tmp_path / "part.pbrt.gz").write_bytes(data)
    if not data:
        assert len(pbrt(tmp_path, f'{CAMERA}WorldBegin\nInclude "part.pbrt.gz"\n{BALL}').shapes) == 1
        return
    with pytest.raises(SceneError, match=r"line 3: .part.pbrt.gz. is no sound file of gzip"):
        pbrt(tmp_path, f'{CAMERA}WorldBegin\nInclude "part.pbrt.gz"\n')


# --- Mitsuba


def mitsuba(folder: Path, inside: str) -> Scene:
    """The scene of an XML file."""
    (folder / "scene.xml").write_text(f'<scene version="3.0.0">\n{inside}\n</scene>', encoding="utf-8")
    return load(folder / "scene.xml")


FOG = '<medium name="{}" type="homogeneous" id="fog"><rgb name="sigma_t" value="1"/></medium>'
GLASS_BALL = '<shape type="sphere"><bsdf type="dielectric"/>{}</shape>'


def ball(inside: str) -> str:
    return f'<shape type="sphere"><float name="radius" value="0.5"/><bsdf type="null"/>{inside}</shape>'


def test_bubbles_of_mitsuba(tmp_path: Path) -> None:
    scene = mitsuba(tmp_path, ball(FOG.format("exterior")))
    assert is_vacuum(scene, scene.shapes[0].interior)
    scene = mitsuba(tmp_path, ball('<boolean name="flip_normals" value="true"/>' + FOG.format("exterior")))
    (shape,) = scene.shapes
    assert shape.interior == "fog" and not shape.model_dump()["flip_normals"]


def test_invisible_surfaces_are_not_misunderstood(tmp_path: Path) -> None:
    scene = mitsuba(tmp_path, ball("") + GLASS_BALL.format(""))
    assert len(scene.shapes) == 1 and not any("not understood" in note for note in scene.notes)


@pytest.mark.parametrize("where", ["sensor", "ball"])
def test_glass_of_mitsuba_without_media(tmp_path: Path, where: str) -> None:
    both = GLASS_BALL.format("") + GLASS_BALL.format(FOG.format("exterior"))
    given = f'<sensor type="perspective">{FOG.format("medium")}</sensor>'
    scene = mitsuba(tmp_path, both + (given if where == "sensor" else ball(FOG.format("interior"))))
    told = any("glass that names no media" in note for note in scene.notes)
    if where == "sensor":
        assert scene.fog == "fog" and interiors(scene) == ["fog", None] and not told
    else:
        assert scene.fog is None and interiors(scene)[:2] == [None, None] and told
