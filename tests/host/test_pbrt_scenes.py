"""What pbrt-v4 defines otherwise than we do: coats, sensors, subsurface scattering, holes and subdivision."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cases import for_each
from moved_points import placed_at
from PIL import Image

import clrender.importers.pbrt
from clrender.errors import SceneError
from clrender.exact.matrices import times
from clrender.flatten.subsurface import single_scattering
from clrender.image.pictures import open_picture
from clrender.importers import load
from clrender.importers.asset_files import AssetFiles
from clrender.importers.draft import Draft
from clrender.importers.shared.half_space import h_function, returned
from clrender.importers.shared.white_balance import daylight_xyz, white_balance
from clrender.scene import Scene
from clrender.scene.spectra import SpectralColor
from clrender.spectra.colors import TO_REC709, table_wavelengths

BALL = 'Shape "sphere"\n'


def text(world: str, before: str = 'Camera "perspective"') -> str:
    return f"{before}\nWorldBegin\n{world}\n"


def pbrt(folder: Path, world: str, before: str = 'Camera "perspective"') -> Scene:
    """The scene of a pbrt file."""
    path = folder / "scene.pbrt"
    path.write_text(text(world, before), encoding="utf-8")
    return load(path)


def draft_of(folder: Path, world: str) -> Draft:
    """What its reader makes of a pbrt file."""
    path = folder / "scene.pbrt"
    path.write_text(text(world), encoding="utf-8")
    return clrender.importers.pbrt.read(path, AssetFiles("scene.pbrt", folder))


def dump(part: Any) -> dict[str, Any]:
    """What is not left at its default."""
    found: dict[str, Any] = part.model_dump(exclude_unset=True)
    return found


# --- coats


def layered(reflectance: float, ior: float) -> float:
    """Reflectance of a metal below a smooth boundary, straight on, by following the light up and down in it.

    Parameters
    ----------
    reflectance : float
        Of the metal in the coat.
    ior : float
        Index of refraction of the coat.
    """
    boundary = ((ior - 1.0) / (ior + 1.0)) ** 2
    found, inside = boundary, 1.0 - boundary
    for _ in range(200):
        inside *= reflectance
        found += inside * (1.0 - boundary)
        inside *= boundary
    return found


def seen(made: dict[str, Any], base: Any) -> Any:
    """Reflectance of our metal below its coat, straight on."""
    coat = 0.04 * made["coat"]
    return coat + (1.0 - coat) * np.asarray(base, np.float64)


@for_each(("given", "ior"), [("", 1.5), ('"float interface.eta" 1.3', 1.3)])
def test_a_coated_metal_reflects_what_its_layers_do(tmp_path: Path, given: str, ior: float) -> None:
    index = '"rgb conductor.eta" [0.2 0.9 1.1] "rgb conductor.k" [3.9 2.5 2.1]'
    rough = '"float interface.roughness" 0.0016 "float conductor.roughness" 0.0256'
    scene = pbrt(tmp_path, f'Material "coatedconductor" {index} {given} {rough}\n{BALL}')
    made = dump(next(iter(scene.materials.values())))
    wanted = []
    for eta, k in zip((0.2, 0.9, 1.1), (3.9, 2.5, 2.1), strict=True):
        inside = complex(eta, k) / ior
        wanted.append(layered(abs((inside - 1.0) / (inside + 1.0)) ** 2, ior))
    np.testing.assert_allclose(seen(made, made["base_color"]), wanted, rtol=1e-12)
    assert made["type"] == "principled" and made["metallic"] == 1.0
    # Alpha is the root of pbrt's roughness and the square of ours
    assert made["coat_roughness"] ** 4 == pytest.approx(0.0016) and made["roughness"] ** 4 == pytest.approx(0.0256)
    assert any("coatedconductor" in note for note in scene.notes)


def test_a_coated_metal_of_a_picture_is_that_of_its_colours(tmp_path: Path) -> None:
    """pbrt makes a metal of index 1 + i k of a reflectance r, with r = k² / (4 + k²)."""
    shares = np.array([0.0, 0.3, 0.9], np.float32)
    (tmp_path / "t.pfm").write_bytes(b"PF\n3 1\n-1\n" + np.repeat(shares, 3).astype("<f4").tobytes())
    picture = 'Texture "t" "spectrum" "imagemap" "string filename" "t.pfm"\n'
    draft = draft_of(tmp_path, f'{picture}Material "coatedconductor" "texture reflectance" "t"\n{BALL}')
    (made,) = draft.description["materials"].values()
    data, ending = draft.pictures[made["base_color"]["texture"]]
    (band,) = open_picture(io.BytesIO(data), ending).bands()
    wanted = []
    for share in shares.astype(float):
        inside = complex(1.0, 2.0 * np.sqrt(share / (1.0 - share))) / 1.5
        wanted.append(layered(abs((inside - 1.0) / (inside + 1.0)) ** 2, 1.5))
    np.testing.assert_allclose(seen(made, band.view(np.float16)[0, :, 0]), wanted, rtol=2e-3)
    plain = pbrt(tmp_path, f'Material "coatedconductor" "rgb reflectance" [0 0.3 0.9]\n{BALL}')
    color = dump(next(iter(plain.materials.values())))["base_color"]
    np.testing.assert_allclose(seen(made, color), wanted, rtol=1e-7)


def test_a_coat_of_a_larger_index_is_told(tmp_path: Path) -> None:
    scene = pbrt(tmp_path, f'Material "coatedconductor" "float interface.eta" 2\n{BALL}')
    assert dump(next(iter(scene.materials.values())))["coat"] == 1.0
    assert any("a coat of index 2 reflects as one of 1.5" in note for note in scene.notes)


# --- film


def test_daylight_has_the_chromaticities_of_the_standard() -> None:
    """Illuminants D50, D55, D65 and D75 of CIE 15:2004, whose temperatures are those of 1964 times 1.4388 / 1.4380."""
    for kelvin, x, y in (
        (5000, 0.3457, 0.3585),
        (5500, 0.3324, 0.3474),
        (6500, 0.3127, 0.3290),
        (7500, 0.2990, 0.3149),
    ):
        xyz = daylight_xyz(float(kelvin))
        assert (xyz / xyz.sum())[:2] == pytest.approx((x, y), abs=2e-4) and xyz[1] == 1.0
    # Planck's locus at 3000 K (Wyszecki & Stiles, table 1(3.11))
    xyz = daylight_xyz(3000.0 * 1.4380 / 1.4388)
    assert (xyz / xyz.sum())[:2] == pytest.approx((0.4369, 0.4041), abs=1e-4)


def test_a_white_balance_makes_its_light_white() -> None:
    for kelvin in (2800.0, 5000.0, 9000.0):
        light = times(TO_REC709, daylight_xyz(kelvin))
        np.testing.assert_allclose(times(white_balance(kelvin), light), 1.0, rtol=1e-12)
    np.testing.assert_allclose(white_balance(6500.0), np.eye(3), atol=1e-3)
    # Bradford's matrix from D50 to D65 on XYZ, as published by Lindbloom
    wanted = [
        [0.9555766, -0.0230393, 0.0631636],
        [-0.0282895, 1.0099416, 0.0210077],
        [0.0122982, -0.0204830, 1.3299098],
    ]
    to_xyz = np.linalg.inv(TO_REC709)
    np.testing.assert_allclose(to_xyz @ white_balance(5000.0) @ TO_REC709, wanted, atol=2e-3)


@for_each("light", ["point", "area", "map", "constant"])
def test_the_white_balance_of_the_film_is_that_of_all_lights(tmp_path: Path, light: str) -> None:
    """Light of a black body of 3000 K is as white as the film says, whichever lamp it comes from."""
    (red, green, blue) = (float(x) for x in times(TO_REC709, daylight_xyz(3000.0)))
    pixels = np.broadcast_to(np.array([red, green, blue], "<f4"), (16, 16, 3)).tobytes()
    (tmp_path / "sky.pfm").write_bytes(b"PF\n16 16\n-1\n" + pixels)
    world = {
        "point": f'LightSource "point" "rgb I" [{red} {green} {blue}]\n' + BALL,
        "area": f'AreaLightSource "diffuse" "rgb L" [{red} {green} {blue}]\n' + BALL,
        "map": 'LightSource "infinite" "string filename" "sky.pfm"\n' + BALL,
        "constant": f'LightSource "infinite" "rgb L" [{red} {green} {blue}]\n' + BALL,
    }[light]
    film = 'Film "gbuffer" "float iso" 150 "float whitebalance" 3000 "string sensor" "nikon_d810"'
    scene = pbrt(tmp_path, world, f'Camera "perspective"\n{film}')
    if light == "map":
        (lamp,) = (dump(each) for each in scene.lights)
        found = scene.environment_picture().pixels[8, 8] * np.array(lamp["scale"])  # type: ignore[union-attr]
    elif light == "area":
        found = dump(scene.shapes[0])["emission"]
    else:
        (lamp,) = (dump(each) for each in scene.lights)
        found = lamp["intensity" if light == "point" else "radiance"]
    np.testing.assert_allclose(found, 1.5, atol=2e-3)
    said = " ".join(scene.notes)
    assert "white balance of the film, 3000 K" in said and '"nikon_d810" is read as cie1931' in said
    assert "not understood" not in said


def test_sensors_without_a_white_balance_change_no_colour(tmp_path: Path) -> None:
    """Named sensors are balanced for 6500 K, which is the white of the image."""
    film = 'Film "rgb" "string sensor" "canon_eos_100d"'
    scene = pbrt(tmp_path, 'LightSource "point" "rgb I" [1 2 3]\n' + BALL, f'Camera "perspective"\n{film}')
    assert dump(scene.lights[0])["intensity"] == (1.0, 2.0, 3.0)


def test_a_white_balance_is_a_temperature(tmp_path: Path) -> None:
    with pytest.raises(SceneError, match=r'line 2: "whitebalance" is 10, but must be 1000 to 25000 kelvin'):
        pbrt(tmp_path, BALL, 'Camera "perspective"\nFilm "rgb" "float whitebalance" 10')


# --- subsurface scattering


def test_half_spaces_without_a_boundary_return_their_albedo() -> None:
    """Against the renderer's own table, which comes from another method."""
    for albedo in (0.05, 0.3, 0.7, 0.97):
        plain, entered = returned(np.sqrt(1.0 - single_scattering(albedo, 0.0)), 1.0)
        assert plain == pytest.approx(albedo, rel=2e-4) and entered == pytest.approx(plain, rel=1e-9)
    assert returned(0.0, 1.5) == pytest.approx((1.0, 1.0), abs=1e-7)
    # Chandrasekhar's H at 1, without absorption, is 2.9078
    cosines, weights = np.polynomial.legendre.leggauss(64)
    found = h_function(0.0, (cosines + 1.0) / 2.0, weights / 2.0)
    assert np.interp(1.0, (cosines + 1.0) / 2.0, found) == pytest.approx(2.9078, abs=2e-3)


def walked(alpha: float, ior: float, walks: int) -> float:
    """Share of the diffuse light that enters a half-space which leaves again, by random walks."""
    random = np.random.default_rng(1)
    outside = np.sqrt(random.random(walks))
    entering = np.sqrt(1.0 - (1.0 - outside**2) / ior**2)

    def mirrored(inside: Any) -> Any:
        beyond = np.sqrt(np.maximum(1.0 - ior**2 * (1.0 - inside**2), 0.0))
        s, p = (ior * inside - beyond) / (ior * inside + beyond), (inside - ior * beyond) / (inside + ior * beyond)
        return (s**2 + p**2) / 2.0

    enters = random.random(walks) >= mirrored(entering)
    down, depth = entering[enters], np.zeros(int(enters.sum()))
    count, left = len(down), 0
    while len(down):
        depth += down * -np.log(1.0 - random.random(len(down)))
        above = depth <= 0.0
        leaves = above & (random.random(len(down)) >= mirrored(np.abs(down)))
        left += int(leaves.sum())
        # What is mirrored goes on from the surface; the rest scatters where it is, or is absorbed
        depth = np.where(above, 0.0, depth)
        down = np.where(above, -down, 2.0 * random.random(len(down)) - 1.0)
        kept = ~leaves & (above | (random.random(len(down)) < alpha))
        down, depth = down[kept], depth[kept]
    return left / count


def test_half_spaces_below_a_boundary_return_what_walks_do() -> None:
    for alpha, ior in ((0.6, 1.33), (0.95, 1.5), (0.99, 1.33)):
        assert returned(np.sqrt(1.0 - alpha), ior)[1] == pytest.approx(walked(alpha, ior, 100_000), abs=0.006)


def test_subsurface_by_reflectance_returns_it_below_its_boundary(tmp_path: Path) -> None:
    given = '"rgb reflectance" [0.2 0.5 1] "rgb mfp" [0.1 0.2 0.3] "float scale" 0.5 "float g" 0.4'
    scene = pbrt(tmp_path, f'Material "subsurface" {given} "float roughness" 0.0016\n{BALL}')
    made = dump(next(iter(scene.materials.values())))
    assert made["type"] == "subsurface" and made["ior"] == 1.33 and made["g"] == 0.4
    assert made["radius"] == pytest.approx((0.05, 0.1, 0.15)) and made["roughness"] ** 4 == pytest.approx(0.0016)
    assert made["albedo"][2] == 1.0
    for wanted, albedo in zip((0.2, 0.5), made["albedo"], strict=False):
        root = np.sqrt(1.0 - single_scattering(albedo, 0.0))
        assert returned(root, 1.33)[1] == pytest.approx(wanted, rel=3e-4)


@for_each(
    ("given", "scattering", "absorption"),
    [
        ("", (2.55, 3.21, 3.77), (0.0011, 0.0024, 0.014)),
        ('"string name" "Skin1" "float g" 0.8', (0.74, 0.88, 1.01), (0.032, 0.17, 0.48)),
        ('"rgb sigma_s" [1 2 3] "rgb sigma_a" [4 5 6]', (1.0, 2.0, 3.0), (4.0, 5.0, 6.0)),
    ],
)
def test_subsurface_by_coefficients_is_glass_with_a_medium(
    tmp_path: Path, given: str, scattering: tuple[float, ...], absorption: tuple[float, ...]
) -> None:
    scene = pbrt(tmp_path, f'Material "subsurface" {given} "float scale" 10 "float eta" 1.4\n{BALL}')
    (shape,) = scene.shapes
    assert shape.material is not None and shape.interior is not None
    glass, medium = dump(scene.materials[shape.material]), dump(scene.media[shape.interior])
    assert glass["type"] == "dielectric" and glass["ior"] == 1.4
    assert medium["scattering"] == pytest.approx(np.multiply(scattering, 10.0))
    assert medium["absorption"] == pytest.approx(np.multiply(absorption, 10.0))
    assert medium["g"] == 0.0 and not any("not understood" in note for note in scene.notes)


@for_each("material", [True, False])
def test_coefficients_of_media_may_be_spectra(tmp_path: Path, material: bool) -> None:
    """They are 0 beyond their ends."""
    given = '"spectrum sigma_a" [400 0.5 500 0 600 2] "rgb sigma_s" [1 2 3] "float scale" 10'
    if material:
        world = f'Material "subsurface" {given}\n{BALL}'
    else:
        world = f'MakeNamedMedium "m" "string type" "homogeneous" {given} "rgb Le" [0.1 0.1 0.1]\n'
        world += f'MediumInterface "m" ""\nMaterial "interface"\n{BALL}'
    scene = pbrt(tmp_path, world)
    (medium,) = scene.media.values()
    assert isinstance(medium.absorption, SpectralColor)
    lines = table_wavelengths()
    np.testing.assert_allclose(medium.absorption.values[lines == 450.0], 2.5)
    np.testing.assert_allclose(medium.absorption.values[lines == 550.0], 10.0)
    assert not medium.absorption.values[(lines < 395.0) | (lines > 605.0)].any()
    assert medium.scattering == (10.0, 20.0, 30.0) and not isinstance(medium.scattering, SpectralColor)
    assert medium.glows != material
    assert not any("not understood" in note for note in scene.notes)


def test_equal_surfaces_of_other_media_stay_apart(tmp_path: Path) -> None:
    world = f'Material "subsurface" "string name" "Skin1"\n{BALL}Material "subsurface" "string name" "Skin2"\n{BALL}'
    first, second = pbrt(tmp_path, world + 'Material "dielectric" "float eta" 1.33\n').shapes
    assert first.interior != second.interior and first.material != second.material


def test_textured_subsurface_has_the_mean_colour_of_its_picture(tmp_path: Path) -> None:
    pixels = np.array([[[0.2, 0.4, 0.6], [0.4, 0.6, 0.8]]], "<f4")
    (tmp_path / "t.pfm").write_bytes(b"PF\n2 1\n-1\n" + pixels.tobytes())
    picture = 'Texture "t" "spectrum" "imagemap" "string filename" "t.pfm"\n'
    skin = 'Material "subsurface" "texture reflectance" "t" "float eta" 1\n'
    scene = pbrt(tmp_path, picture + skin + BALL)
    assert dump(scene.materials["subsurface"])["albedo"] == pytest.approx((0.3, 0.5, 0.7), abs=1e-6)
    assert any("mean colour" in note for note in scene.notes)


def test_named_media_and_what_is_not_one(tmp_path: Path) -> None:
    medium = 'MakeNamedMedium "m" "string type" "homogeneous" "string preset" "Coke" "float scale" 2\n'
    scene = pbrt(tmp_path, medium + f'MediumInterface "m" ""\nMaterial "interface"\n{BALL}')
    assert dump(scene.media["m"])["absorption"] == pytest.approx((0.20028, 0.33006, 0.4936))
    plain = pbrt(tmp_path, f'MakeNamedMedium "m"\nMediumInterface "m" ""\nMaterial "interface"\n{BALL}')
    assert dump(plain.media["m"])["scattering"] == (1.0, 1.0, 1.0) == dump(plain.media["m"])["absorption"]
    with pytest.raises(SceneError, match=r'the medium "Skin" is not known; did you mean "Skin.".'):
        pbrt(tmp_path, f'Material "subsurface" "string name" "Skin"\n{BALL}')


def test_subsurface_scattering_in_a_mixture_is_diffuse(tmp_path: Path) -> None:
    made = 'MakeNamedMaterial "a" "string type" "subsurface" "rgb reflectance" [0 0 1]\n'
    made += 'MakeNamedMaterial "b" "string type" "diffuse"\n'
    scene = pbrt(tmp_path, made + 'Material "mix" "string materials" ["a" "b"]\n' + BALL)
    assert dump(scene.materials["a, diffuse"]) == {"type": "lambert", "reflectance": (0.0, 0.0, 1.0)}
    assert any("in a mixture" in note for note in scene.notes)


# --- pictures as numbers, and holes


def opacity_of(folder: Path, texture: str, pixels: Any) -> Any:
    """The values of a shape's alpha, with a picture of 8 bits."""
    Image.fromarray(np.array([pixels], np.uint8)).save(folder / "t.png")
    world = f'Texture "t" "float" "imagemap" "string filename" "t.png" {texture}\n'
    draft = draft_of(folder, f'{world}Material "diffuse"\nShape "sphere" "texture alpha" "t"')
    (name,) = {shape["material"] for shape in draft.description["shapes"]}
    opacity = draft.description["materials"][name]["opacity"]
    if opacity["texture"] in draft.pictures:
        data, ending = draft.pictures[opacity["texture"]]
        (band,) = open_picture(io.BytesIO(data), ending).bands()
        assert opacity["channel"] == "r" and not {"scale", "color_space"} & set(opacity)
        return band.view(np.float16)[0, :, 0].astype(float)
    return opacity


def test_holes_are_of_the_alpha_of_their_picture(tmp_path: Path) -> None:
    """pbrt takes the alpha of a picture that has one, decoded like its colours, unless it is opaque everywhere."""
    leaf = [[10, 20, 30, 0], [10, 20, 30, 128], [10, 20, 30, 255]]
    wanted = [0.0, ((128 / 255 + 0.055) / 1.055) ** 2.4, 1.0]
    assert opacity_of(tmp_path, "", leaf) == pytest.approx(wanted, rel=1e-3)
    assert opacity_of(tmp_path, '"bool invert" true', leaf) == pytest.approx(np.subtract(1.0, wanted), rel=1e-3)
    linear = opacity_of(tmp_path, '"string encoding" "linear" "float scale" 0.5', leaf)
    assert linear["channel"] == "a" and linear["color_space"] == "linear" and linear["scale"] == [0.5] * 3
    for pixels, channel in (
        ([[10, 10, 10, 255], [200, 200, 200, 255]], "r"),
        ([[10, 20, 30], [4, 5, 6]], "luminance"),
        ([10, 200], "r"),
    ):
        found = opacity_of(tmp_path, "", pixels)
        assert found["channel"] == channel and found["color_space"] == "srgb"


def test_holes_of_numbers_and_other_textures(tmp_path: Path) -> None:
    board = 'Texture "t" "float" "checkerboard" "float tex1" 0.25 "float tex2" 0\n'
    world = board + 'Shape "sphere" "float alpha" 0.5\nShape "disk" "texture alpha" "t"'
    scene = pbrt(tmp_path, world)
    first, second = (scene.materials[str(shape.material)] for shape in scene.shapes)
    assert first.opacity == 0.5 and dump(second)["opacity"]["checker"] == ((0.25,) * 3, (0.0,) * 3)


def test_lamps_of_alpha_0_shine(tmp_path: Path) -> None:
    scene = pbrt(tmp_path, 'AreaLightSource "diffuse"\nMaterial "diffuse"\nShape "sphere" "float alpha" 0')
    (shape,) = scene.shapes
    assert shape.emission == (1.0, 1.0, 1.0) and scene.materials[str(shape.material)].opacity == 1.0
    assert any("a lamp of alpha 0" in note for note in scene.notes)


def test_inverted_pictures(tmp_path: Path) -> None:
    """One minus the scaled colour, and of that the mean of a picture, as of any other."""
    pixels = np.array([[[0.2, 0.4, 0.6], [0.4, 0.6, 0.8]]], "<f4")
    (tmp_path / "t.pfm").write_bytes(b"PF\n2 1\n-1\n" + pixels.tobytes())
    inverted = '"imagemap" "string filename" "t.pfm" "bool invert" true "float scale" 0.5'
    world = f'Texture "t" "spectrum" {inverted}\nMaterial "diffuse" "texture reflectance" "t"\n{BALL}'
    world += f'Material "subsurface" "texture reflectance" "t" "float eta" 1\n{BALL}'
    draft = draft_of(tmp_path, world)
    made = draft.description["materials"]
    data, ending = draft.pictures[made["diffuse"]["reflectance"]["texture"]]
    (band,) = open_picture(io.BytesIO(data), ending).bands()
    np.testing.assert_allclose(band.view(np.float16)[0, :, :3], 1.0 - pixels[0] / 2.0, rtol=1e-3)
    assert made["subsurface"]["albedo"] == pytest.approx([0.85, 0.75, 0.65], rel=1e-3)


@pytest.mark.parametrize("kind", ["perspective", "orthographic"])
def test_screen_windows_off_the_middle_shift_the_lens(tmp_path: Path, kind: str) -> None:
    """The window's edges are those of the image, where pbrt's screen has its units."""
    window = 'Film "rgb" "integer xresolution" 60 "integer yresolution" 40\n'
    camera = f'Camera "{kind}" "float screenwindow" [-0.5 2.5 -1.5 0.5]'
    scene = pbrt(tmp_path, BALL, f"{window}{camera}" + (' "float fov" 90' if kind == "perspective" else ""))
    assert scene.camera.lens_shift == pytest.approx((1.0 / 3.0, -0.25))
    right, upward, forward = (np.array(each) for each in scene.camera.axes)
    position = np.array(scene.camera.position)
    for x, y, pixel in ((-0.5, 0.5, (0.0, 0.0)), (2.5, -1.5, (60.0, 40.0)), (0.0, 0.0, (10.0, 10.0))):
        place = position + 1.0 * forward + x * right + y * upward
        np.testing.assert_allclose(scene.camera.project(place, size=(60, 40)), pixel, atol=1e-9)


def test_a_scaled_camera_space_scales_the_film_and_the_lens(tmp_path: Path) -> None:
    scene = pbrt(
        tmp_path, BALL, 'Scale 0.5 0.5 0.5\nCamera "orthographic" "float lensradius" 0.25 "float focaldistance" 3'
    )
    camera = dump(scene.camera)
    assert camera["height"] == 4.0 and camera["aperture_radius"] == 0.5 and camera["focus_distance"] == 6.0
    assert not any("scales" in note for note in scene.notes)
    scene = pbrt(tmp_path, BALL, 'Scale 0.5 0.25 1\nCamera "orthographic"')
    assert dump(scene.camera)["height"] == 8.0 and any(
        "scales along its axes differently" in note for note in scene.notes
    )


# --- power and illuminance


def pfm(path: Path, pixels: Any) -> None:
    """A picture (H, W, 3); rows go from the bottom to the top."""
    height, width, _ = pixels.shape
    path.write_bytes(f"PF\n{width} {height}\n-1\n".encode() + pixels[::-1].astype("<f4").tobytes())


def test_the_power_of_a_lamp_is_that_of_its_picture(tmp_path: Path) -> None:
    pfm(tmp_path / "t.pfm", np.array([[[3.0, 3.0, 3.0], [1.0, 1.0, 1.0]]]))
    given = 'AreaLightSource "diffuse" "string filename" "t.pfm" "float power" 8\n'
    quad = 'Shape "bilinearmesh" "point3 P" [-1 -1 0 1 -1 0 -1 1 0 1 1 0]\n'
    (shape,) = draft_of(tmp_path, given + quad).description["shapes"]
    # Radiance of mean 2 from 4 square metres: 8 / (2 * 4 pi)
    np.testing.assert_allclose(shape["emission"]["scale"], 1.0 / np.pi, rtol=1e-5)


def test_the_power_of_an_ellipsoid_is_that_of_its_area(tmp_path: Path) -> None:
    """An oblate spheroid of 1 by 0.1: 2 pi (1 + (1 - e^2) / e artanh e)."""
    e = np.sqrt(1.0 - 0.01)
    area = 2.0 * np.pi * (1.0 + 0.01 / e * np.arctanh(e))
    world = f'AreaLightSource "diffuse" "float power" 10\nScale 1 1 0.1\n{BALL}'
    (shape,) = draft_of(tmp_path, world).description["shapes"]
    np.testing.assert_allclose(shape["emission"], 10.0 / (np.pi * area), rtol=2e-3)
    (shape,) = draft_of(tmp_path, world.replace("1 1 0.1", "2 2 2")).description["shapes"]
    np.testing.assert_allclose(shape["emission"], 10.0 / (np.pi * 16.0 * np.pi), rtol=1e-6)


def square_of(radiance: Any, side: int = 32) -> Any:
    """A square environment map whose radiance depends on z alone; +z is within the diamond."""
    at = np.abs((np.arange(side) + 0.5) / side * 2.0 - 1.0)
    far = at[:, None] + at[None]
    z = np.where(far < 1.0, 1.0 - far * far, (2.0 - far) ** 2 - 1.0)
    return np.repeat(radiance(z)[..., None], 3, axis=2)


@for_each("turn", ["", "Rotate -90 1 0 0\n", "Rotate 180 1 0 0\n"])
@for_each(("radiance", "found"), [(lambda z: 0.0 * z + 1.0, 1.0), (lambda z: np.maximum(z, 0.0), 2.0 / 3.0)])
def test_the_illuminance_of_a_picture_is_that_of_its_own_space(
    tmp_path: Path, turn: str, radiance: Any, found: float
) -> None:
    """Integrals of the radiance times z over the half sphere, in pi; pbrt finds half of them."""
    pfm(tmp_path / "t.pfm", square_of(radiance))
    world = f'{turn}LightSource "infinite" "string filename" "t.pfm" "float illuminance" {np.pi!r}\n{BALL}'
    (light,) = draft_of(tmp_path, world).description["lights"]
    np.testing.assert_allclose(light["scale"], 2.0 / found, rtol=2e-2)


def test_pictures_without_illuminance_are_told(tmp_path: Path) -> None:
    pfm(tmp_path / "t.pfm", square_of(lambda z: np.maximum(-z, 0.0)))
    draft = draft_of(tmp_path, f'LightSource "infinite" "string filename" "t.pfm" "float illuminance" 3\n{BALL}')
    (light,) = draft.description["lights"]
    assert light["scale"] == [1.0] * 3 and any("is black about +z" in note for note in draft.notes)


def test_portals_are_told(tmp_path: Path) -> None:
    world = f'LightSource "infinite" "point3 portal" [0 0 0 1 0 0 1 1 0 0 1 0]\n{BALL}'
    assert any("it shines from all sides" in note for note in draft_of(tmp_path, world).notes)


def test_names_that_look_escaped(tmp_path: Path) -> None:
    pfm(tmp_path / "w%20x.pfm", np.ones((1, 1, 3)))
    pfm(tmp_path / "a b.pfm", np.ones((1, 1, 3)))
    files = AssetFiles("scene", tmp_path)
    assert files.name("w%20x.pfm", "") == "w%20x.pfm" and files.name("a%20b.pfm", "") == "a b.pfm"
    assert files.name("none%20x.pfm", "") == "none x.pfm"
    files.search("sub")
    (tmp_path / "sub").mkdir()
    pfm(tmp_path / "sub" / "w%20x.pfm", np.ones((1, 1, 3)))
    assert files.name("w%20x.pfm", "") == "sub/w%20x.pfm" and files.name("a%20b.pfm", "") == "a b.pfm"


# --- motion


MOVING = "ActiveTransform EndTime\n{}\nActiveTransform All\n"


def test_a_shape_moves_between_two_transforms(tmp_path: Path) -> None:
    scene = pbrt(tmp_path, MOVING.format("Translate 1 2 3") + BALL + BALL)
    first, second = scene.shapes
    assert [key.time for key in first.motion] == [0.0, 1.0] and first.motion == second.motion
    assert placed_at(scene, 0, 0.5, (0.0, 0.0, 0.0)) == pytest.approx([0.5, 1.0, 1.5], abs=1e-12)
    assert scene.camera.shutter == (0.0, 1.0)
    assert not any("moves like that" in note for note in scene.notes)


def test_a_shape_that_turns_about_itself_stays_in_its_place(tmp_path: Path) -> None:
    """Both transforms are interpolated as they are, and not one relative to the other."""
    world = "Translate 5 0 0\n" + MOVING.format("Rotate 90 0 0 1") + BALL
    scene = pbrt(tmp_path, world)
    assert placed_at(scene, 0, 0.5, (0.0, 0.0, 0.0)) == pytest.approx([5.0, 0.0, 0.0], abs=1e-12)
    x, y, z = placed_at(scene, 0, 0.0, (1.0, 0.0, 0.0))
    half = 0.5**0.5
    turned = [5.0 + half * (x - 5.0 - y), half * (x - 5.0 + y), z]
    assert placed_at(scene, 0, 0.5, (1.0, 0.0, 0.0)) == pytest.approx(turned, abs=1e-12)


def test_the_camera_moves(tmp_path: Path) -> None:
    before = 'TransformTimes 2 4\nActiveTransform EndTime\nTranslate -1 0 0\nActiveTransform All\nCamera "perspective"'
    scene = pbrt(tmp_path, BALL, before + ' "float shutteropen" 2 "float shutterclose" 3')
    assert [key.time for key in scene.camera.motion] == [2.0, 4.0] and scene.camera.shutter == (2.0, 3.0)
    assert [key.position for key in scene.camera.motion] == [(0.0, 0.0, 0.0), (1.0, 0.0, 0.0)]
    assert not scene.shapes[0].motion  # the world does not begin where the camera is


def test_objects_move_as_a_whole(tmp_path: Path) -> None:
    world = f'ObjectBegin "a"\nTranslate 1 0 0\n{BALL}ObjectEnd\nAttributeBegin\n{MOVING.format("Rotate 180 0 1 0")}'
    scene = pbrt(tmp_path, world + 'ObjectInstance "a"\nAttributeEnd\nObjectInstance "a"\n')
    assert placed_at(scene, 0, 0.5, (0.0, 0.0, 0.0)) == pytest.approx([0.0, 0.0, -1.0], abs=1e-12)
    assert not scene.shapes[1].motion


def test_blocks_and_named_systems_keep_both_transforms(tmp_path: Path) -> None:
    world = f"""AttributeBegin
ActiveTransform EndTime
Translate 1 0 0
CoordinateSystem "there"
AttributeEnd
Translate 0 1 0
{BALL}CoordSysTransform "there"
{BALL}Identity
{BALL}"""
    scene = pbrt(tmp_path, world)
    assert [len(shape.motion) for shape in scene.shapes] == [0, 2, 0]
    assert placed_at(scene, 1, 1.0, (0.0, 0.0, 0.0)) == pytest.approx([1.0, 0.0, 0.0], abs=1e-12)


@for_each(
    ("world", "words"),
    [
        (MOVING.format("Scale 1 1 2") + BALL, "stretches a sphere, disk or curve: what moves like that stands"),
        (MOVING.format("Scale -1 1 1") + BALL, "makes a shape flat on its way"),
        (MOVING.format("Scale 0 1 1") + BALL, "makes a shape flat on its way"),
        (MOVING.format("Translate 1 0 0") + 'LightSource "point"\n' + BALL, "lights that are no shapes do not move"),
        (
            f'ObjectBegin "a"\n{MOVING.format("Translate 1 0 0")}{BALL}ObjectEnd\nObjectInstance "a"\n',
            "inside of objects do not move by themselves",
        ),
    ],
)
def test_what_does_not_move_is_named(tmp_path: Path, world: str, words: str) -> None:
    scene = pbrt(tmp_path, world)
    assert words in " ".join(scene.notes)
    assert not any(shape.motion for shape in scene.shapes) or "lights" in words
    assert scene.camera.shutter is None or "lights" in words


def test_times_and_words_of_motion(tmp_path: Path) -> None:
    backwards = pbrt(tmp_path, MOVING.format("Translate 1 0 0") + BALL, 'TransformTimes 1 1\nCamera "perspective"')
    assert "TransformTimes do not ascend" in " ".join(backwards.notes) and not backwards.shapes[0].motion
    closed = 'Camera "perspective" "float shutteropen" 0.5 "float shutterclose" 0.5'
    still = pbrt(tmp_path, MOVING.format("Translate 1 0 0") + BALL, closed)
    assert still.camera.shutter is None and still.camera.time == 0.5
    with pytest.raises(SceneError, match='ActiveTransform is "Now", but must be one of All, EndTime, StartTime'):
        pbrt(tmp_path, 'ActiveTransform "Now"\n' + BALL)


def test_moving_lamps_shine(tmp_path: Path) -> None:
    lamp = 'AreaLightSource "diffuse" "rgb L" [2 2 2]\n'
    scene = pbrt(tmp_path, MOVING.format("Translate 1 0 0") + lamp + BALL)
    assert scene.shapes[0].motion and scene.shapes[0].emission is not None
