"""pbrt's goniometric lights, whose intensity is a picture over all directions, there and back."""

from __future__ import annotations

import io
import math
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

import clrender
from clrender.errors import SceneError
from clrender.exporters import exported, scene_text
from clrender.flatten.lamps import lamp_directions
from clrender.image.exr_write import write_exr
from clrender.scene.ies import IesProfile
from clrender.scene.light_kinds import IesLight
from clrender.scene.portable import scene_from_portable, scene_to_portable

Floats = npt.NDArray[np.float64]
PBRT = """Camera "perspective"
WorldBegin
{}
LightSource "goniometric" "string filename" "lobes.exr" {}
Shape "sphere" "float radius" 0.1
"""
SIDE = 64


def sphere_of_square(x: Floats, y: Floats) -> Floats:
    """Directions (..., 3) of points of the square, each coordinate -1 to 1 (Clarberg 2008)."""
    far = 1.0 - (np.abs(x) + np.abs(y))
    radius = 1.0 - np.abs(far)
    phi = np.divide(np.abs(y) - np.abs(x), radius, out=np.zeros_like(radius), where=radius > 0.0)
    phi = (phi + 1.0) * math.pi / 4.0
    z = np.copysign(1.0 - radius * radius, far)
    around = radius * np.sqrt(2.0 - radius * radius)
    return np.stack([np.copysign(np.cos(phi), x) * around, np.copysign(np.sin(phi), y) * around, z], axis=-1)


def grid() -> Floats:
    """Directions of the picture's pixels, in the light's space: the middle of the square is at +y."""
    at = (np.arange(SIDE) + 0.5) / SIDE * 2.0 - 1.0
    own = sphere_of_square(*np.meshgrid(at, at))
    return own[..., [0, 2, 1]]


def lobes(directions: Floats) -> Floats:
    """A smooth intensity without any symmetry."""
    x, y, z = np.moveaxis(directions, -1, 0)
    value: Floats = np.exp(1.2 * x - 0.7 * y + 0.4 * z) + 0.3 * (1.0 + x * z)
    return value


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """With a picture whose three channels are not alike: their mean counts."""
    write(tmp_path, lobes(grid())[..., None] * (0.5, 1.5, 1.0))
    return tmp_path


def write(folder: Path, pixels: npt.NDArray[Any]) -> None:
    data = io.BytesIO()
    write_exr(data, pixels.astype(np.float32), {}, {})
    (folder / "lobes.exr").write_bytes(data.getvalue())


def lamp(scene: clrender.Scene) -> tuple[IesLight, IesProfile]:
    (light,) = scene.lights
    assert isinstance(light, IesLight)
    return light, scene.ies_profile(0)


def world(light: IesLight, profile: IesProfile) -> tuple[Floats, Floats]:
    """World directions of the table's entries, and their intensities, W/sr per unit of colour."""
    axis, zero, side = (np.array(each) for each in lamp_directions(light))
    theta, phi = np.radians(profile.vertical)[:, None, None], np.radians(profile.horizontal)[None, :, None]
    directions = np.cos(theta) * axis + np.sin(theta) * (np.cos(phi) * zero + np.sin(phi) * side)
    return directions, profile.candela / 683.0


@pytest.mark.parametrize(
    ("transform", "matrix"),
    [
        ("", np.eye(3)),
        ("Scale -1 1 1", np.diag([-1.0, 1.0, 1.0])),
        ("Scale 1 2 3", np.diag([1.0, 2.0, 3.0])),
        ("Rotate 90 1 0 0", np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])),
    ],
    ids=["as it is", "mirrored", "stretched", "turned"],
)
def test_each_direction_has_the_intensity_of_the_picture(folder: Path, transform: str, matrix: Floats) -> None:
    (folder / "a.pbrt").write_text(PBRT.format(f"Translate 1 2 3\n{transform}", '"rgb I" [1 2 3] "float scale" 2'))
    light, profile = lamp(clrender.load(folder / "a.pbrt"))
    assert light.position == (1.0, 2.0, 3.0) and light.scale == (2.0, 4.0, 6.0)
    directions, found = world(light, profile)
    own = directions @ np.linalg.inv(matrix).T
    expected = lobes(own / np.linalg.norm(own, axis=-1, keepdims=True))
    assert np.abs(found / expected - 1.0).max() < 0.16  # pixels are 3 degrees wide, and some twice as long
    assert np.abs(found / expected - 1.0).mean() < 0.02


def test_its_flux_is_that_of_the_picture(folder: Path) -> None:
    (folder / "a.pbrt").write_text(PBRT.format("", '"float power" 7'))
    light, profile = lamp(clrender.load(folder / "a.pbrt"))
    _, found = world(light, profile)
    sines = np.sin(np.radians(profile.vertical))
    flux = 4.0 * math.pi * float((found[:, :-1].mean(axis=1) * sines).sum() / sines.sum())
    assert flux * light.scale[0] == pytest.approx(7.0, rel=1e-6)


def test_each_light_of_a_file_that_is_included_twice_has_its_table(folder: Path) -> None:
    (folder / "lamp.pbrt").write_text('LightSource "goniometric" "string filename" "lobes.exr"\n')
    both = 'Include "lamp.pbrt"\nScale -1 1 1\nInclude "lamp.pbrt"\n'
    (folder / "a.pbrt").write_text(f'Camera "perspective"\nWorldBegin\n{both}Shape "sphere"\n')
    scene = clrender.load(folder / "a.pbrt")
    plain, mirrored = (scene.ies_profile(index).candela for index in range(2))
    assert not np.array_equal(plain, mirrored)


@pytest.mark.long
def test_it_lights_a_wall(folder: Path, device: Any) -> None:
    """The brightness of a small quad in some directions, by the renderer, against the formula."""
    with clrender.Session(device.info.index) as session:
        for toward in (np.array([0.0, 0.0, 1.0]), np.array([0.6, 0.0, -0.8]), np.array([0.36, -0.8, 0.48])):
            up = np.array([0.0, 1.0, 0.0])
            across = np.cross(up, toward) / np.linalg.norm(np.cross(up, toward))
            above = np.cross(toward, across)
            corners = [10.0 * toward + a * across + b * above for a, b in ((-9, -9), (9, -9), (9, 9), (-9, 9))]
            points = " ".join(f"{x:.9g}" for corner in corners for x in corner)
            eye, at = 3.0 * toward, 10.0 * toward
            view = " ".join(f"{x:.9g}" for x in (*eye, *at, *up))
            (folder / "a.pbrt").write_text(
                f'LookAt {view}\nCamera "perspective" "float fov" 2\nFilm "rgb" "integer xresolution" 8 '
                '"integer yresolution" 8\nWorldBegin\n'
                'LightSource "goniometric" "string filename" "lobes.exr" "rgb I" [1 1 1] "float scale" 100\n'
                'Material "diffuse" "rgb reflectance" [0.5 0.5 0.5]\n'
                f'Shape "trianglemesh" "integer indices" [0 1 2 0 2 3] "point3 P" [{points}]\n'
            )
            image = session.render(clrender.load(folder / "a.pbrt"), integrator="direct", spp=4)
            expected = 100.0 * float(lobes(toward)) / 100.0 * 0.5 / math.pi
            assert float(image.linear.mean()) == pytest.approx(expected, rel=0.06)


def test_written_to_our_own_files(folder: Path) -> None:
    (folder / "a.pbrt").write_text(PBRT.format("", ""))
    scene = clrender.load(folder / "a.pbrt")
    again = scene_from_portable(*scene_to_portable(scene))
    assert again.sha256() == scene.sha256()
    export = exported(scene, "files")
    (folder / "again.toml").write_bytes(scene_text(export.description, ".toml", "A lamp"))
    for name, made in export.files.items():
        (folder / name).parent.mkdir(exist_ok=True)
        with (folder / name).open("wb") as file:
            made(file)
    assert clrender.load(folder / "again.toml").sha256() == scene.sha256()


@pytest.mark.parametrize("fault", ["missing", "damaged", "oblong", "black"])
def test_one_that_cannot_shine_is_left_out(folder: Path, fault: str) -> None:
    """And the rest is drawn; with ``strict`` the file is refused."""
    if fault == "missing":
        (folder / "lobes.exr").unlink()
    elif fault == "damaged":
        (folder / "lobes.exr").write_bytes(b"no picture")
    else:
        write(folder, np.ones((4, 6, 3)) if fault == "oblong" else np.zeros((4, 4, 3)))
    (folder / "a.pbrt").write_text(PBRT.format("", ""))
    scene = clrender.load(folder / "a.pbrt")
    assert not [light for light in scene.lights if isinstance(light, IesLight)]
    assert "left out" in " ".join(scene.notes)
    with pytest.raises(SceneError):
        clrender.load(folder / "a.pbrt", strict=True)
