"""What Mitsuba and pbrt define otherwise than we do, against the formula of each conversion."""

from __future__ import annotations

import io
import math
from pathlib import Path
from typing import Any

import numpy as np
import peer_scenes
import pytest
from cases import for_each
from PIL import Image

import clrender.importers.mitsuba
import clrender.importers.pbrt
from clrender.errors import SceneError
from clrender.flatten.flat_scene import flatten
from clrender.image.pictures import open_picture
from clrender.image.tone_map import srgb_decode
from clrender.importers import load
from clrender.importers.asset_files import AssetFiles
from clrender.importers.shared.fresnel import external_reflectance, internal_reflectance
from clrender.importers.shared.matrices import rotation
from clrender.importers.shared.meshes import cube_mesh, cylinder_mesh, smoothed, sphere_mesh
from clrender.importers.shared.sky_maps import square_place
from clrender.meshes.data import MeshData
from clrender.scene import Scene
from clrender.spectra.colors import blackbody_color, light_color, luminance, reflectance_color

GREY = '<bsdf type="diffuse"/>'
AREA = '<emitter type="area"><rgb name="radiance" value="2"/></emitter>'


def mitsuba(folder: Path, inside: str, version: str = "3.0.0") -> Scene:
    """The scene of an XML file."""
    path = folder / "scene.xml"
    path.write_text(f'<scene version="{version}">\n{inside}\n</scene>', encoding="utf-8")
    return load(path)


def pbrt(folder: Path, world: str, before: str = 'Camera "perspective"') -> Scene:
    """The scene of a pbrt file."""
    path = folder / "scene.pbrt"
    path.write_text(f"{before}\nWorldBegin\n{world}\n", encoding="utf-8")
    return load(path)


def dump(part: Any) -> dict[str, Any]:
    """What is not left at its default."""
    found: dict[str, Any] = part.model_dump(exclude_unset=True)
    return found


BALL = 'Shape "sphere"\n'


# --- colours


def test_spectra_of_light_have_the_luminance_of_their_integral() -> None:
    assert luminance(light_color([300.0, 900.0], [1.0, 1.0])) == pytest.approx(1.0, abs=1e-4)
    # The equal-energy white of CIE 1931, x = y = 1/3, in Rec. 709
    assert light_color([300.0, 900.0], [1.0, 1.0]) == pytest.approx((1.2048, 0.9483, 0.9090), abs=5e-4)
    # A line at 555 nm is as bright as the sum of the observer's function says: 5 / 106.857
    assert luminance(light_color([555.0], [1.0])) > 5.0 / 106.857  # clipped: no colour of Rec. 709 is so pure


def test_reflectances_are_seen_in_daylight() -> None:
    assert reflectance_color([300.0, 900.0], [0.3, 0.3]) == pytest.approx((0.3, 0.3, 0.3), abs=1e-4)
    # Of Mitsuba 3.9 in RGB mode
    found = reflectance_color([400.0, 500.0, 600.0, 700.0], [0.1, 0.5, 0.9, 0.2])
    assert found == pytest.approx((0.833826, 0.689122, 0.265243), abs=2e-3)


def test_a_black_body_shines_by_plancks_law() -> None:
    red, green, blue = blackbody_color(3000.0)
    assert red > green > blue > 0.0
    # Wien's approximation, good to 1 % there: the ratio of luminances is that near 555 nm
    wien = math.exp(-0.014387768775 / 570e-9 * (1.0 / 3000.0 - 1.0 / 2500.0))
    assert luminance(blackbody_color(3000.0)) / luminance(blackbody_color(2500.0)) == pytest.approx(wien, rel=0.05)


def test_uniform_spectra_of_lights_and_surfaces_differ(tmp_path: Path) -> None:
    scene = mitsuba(
        tmp_path,
        '<shape type="sphere"><bsdf type="diffuse"><spectrum name="reflectance" value="0.3"/></bsdf></shape>'
        '<emitter type="constant"><spectrum name="radiance" value="1"/></emitter>',
    )
    assert scene.environment is not None and scene.environment.radiance is not None
    assert scene.environment.radiance == pytest.approx((1.2048, 0.9483, 0.9090), abs=5e-4)
    assert dump(scene.materials["diffuse"])["reflectance"] == pytest.approx((0.3, 0.3, 0.3))


def test_spectra_of_pbrts_lights_have_unit_luminance(tmp_path: Path) -> None:
    lights = 'LightSource "point" "blackbody I" 3000 "float scale" 4\nLightSource "point" "rgb I" [1 2 3]'
    hot, plain = (light.intensity for light in pbrt(tmp_path, BALL + lights).lights)  # type: ignore[union-attr]
    assert luminance(hot) == pytest.approx(4.0, rel=1e-6)
    assert hot[0] > hot[2]
    assert plain == (1.0, 2.0, 3.0)


def test_spectra_of_other_formats_stay_spectra(tmp_path: Path) -> None:
    scene: Any = mitsuba(
        tmp_path,
        '<shape type="sphere"><bsdf type="diffuse"><spectrum name="reflectance" value="400:0.2, 700:0.6"/></bsdf>'
        '<emitter type="area"><spectrum name="radiance" value="400:1, 500:3, 700:2"/></emitter></shape>'
        '<emitter type="constant"><spectrum type="blackbody" name="radiance"><float name="temperature" value="4000"/>'
        "</spectrum></emitter>",
    )
    shape, paint, around = (dump(part) for part in (scene.shapes[0], scene.materials["diffuse"], scene.lights[0]))
    assert shape["emission"] == {"wavelengths": [400.0, 500.0, 700.0], "values": [1.0, 3.0, 2.0]}
    assert paint["reflectance"]["values"] == [0.0, 0.2, 0.6, 0.0]
    assert around["radiance"]["blackbody"] == 4000.0
    wanted = luminance(blackbody_color(4000.0))
    assert luminance(scene.lights[0].radiance) == pytest.approx(wanted, rel=1e-3)

    world = 'Material "dielectric" "spectrum eta" "glass-F11"\nShape "sphere"\n'
    world += 'Material "dielectric" "spectrum eta" [400 1.6 700 1.5]\nShape "sphere"\n'
    world += 'Material "diffuse" "spectrum reflectance" [300 0.5 900 0.1]\nShape "sphere"\n'
    world += 'LightSource "point" "spectrum I" "stdillum-F2" "float scale" 3\n'
    world += 'AreaLightSource "diffuse" "spectrum L" [400 1 700 1] "float scale" 2\nShape "sphere"\n'
    read: Any = pbrt(tmp_path, world)
    named, table, paint = (dump(read.materials[shape.material]) for shape in read.shapes[:3])
    assert named["dispersion"] == {"glass": "SF11"} and named["ior"] == pytest.approx(1.78472, abs=2e-5)
    assert list(table["dispersion"]["values"]) == [1.6, 1.5] and table["ior"] == pytest.approx(1.5375, abs=1e-3)
    assert paint["reflectance"] == {"wavelengths": [300.0, 900.0], "values": [0.5, 0.1]}
    lamp, shines = read.lights[0], read.shapes[3]
    assert dump(lamp)["intensity"] == {"illuminant": "FL2", "scale": 3.0}
    assert luminance(lamp.intensity) == pytest.approx(3.0, rel=1e-3)
    assert luminance(shines.emission) == pytest.approx(2.0, rel=2e-3)


# --- lights


def test_power_of_pbrts_lights(tmp_path: Path) -> None:
    lights = 'LightSource "point" "float power" 100\nLightSource "distant" "float illuminance" 3\n'
    lights += 'LightSource "spot" "float power" 100 "float coneangle" 40 "float conedeltaangle" 10\n'
    lights += 'LightSource "infinite" "float illuminance" 3'
    point, distant, spot, infinite = (dump(light) for light in pbrt(tmp_path, BALL + lights).lights)
    assert point["intensity"][1] == pytest.approx(100.0 / (4.0 * math.pi))
    assert distant["irradiance"][1] == pytest.approx(3.0)
    assert infinite["radiance"][1] == pytest.approx(3.0 / math.pi)
    edge = math.cos(math.radians(40.0))
    flux = 2.0 * math.pi * (1.0 - edge) * (1.0 - spot["blend"] / 2.0) * spot["intensity"][1]  # docs/scenes.md
    assert flux == pytest.approx(100.0)
    assert edge + spot["blend"] * (1.0 - edge) == pytest.approx(math.cos(math.radians(30.0)))


def test_power_of_pbrts_area_lights_is_that_of_both_sides(tmp_path: Path) -> None:
    light = (
        'AreaLightSource "diffuse" "float power" 100 "bool twosided" true\nScale 2 2 2\nShape "disk" "float radius" 3'
    )
    shapes = pbrt(tmp_path, light).plain_shapes
    assert len(shapes) == 2 and [shape.flip_normals for shape in shapes] == [False, True]
    for shape in shapes:
        assert dump(shape)["emission"][0] == pytest.approx(100.0 / (2.0 * math.pi * math.pi * 36.0))
    # The second one stands behind the first
    assert shapes[1].transform.matrix is not None and -1e-3 < shapes[1].transform.matrix[2][3] < 0.0


def test_the_imaging_ratio_of_the_film_is_a_factor_of_light(tmp_path: Path) -> None:
    before = 'Camera "perspective" "float shutterclose" 0.5\nFilm "rgb" "float iso" 300'
    world = 'LightSource "point" "rgb I" [2 2 2]\nAreaLightSource "diffuse" "rgb L" [4 4 4]\n' + BALL
    scene = pbrt(tmp_path, world, before)
    assert dump(scene.lights[0])["intensity"][0] == pytest.approx(3.0)
    assert dump(scene.shapes[0])["emission"][0] == pytest.approx(6.0)
    assert any("exposure of the film, 1.5" in note for note in scene.notes)


def front(scene: Scene, index: int) -> Any:
    """Mean normal of a flat shape's front, in the world."""
    flat = flatten(scene, 8, 8)
    arrays = flat.arrays
    of_it = arrays["triangles"][arrays["primitive_shape"][: len(arrays["triangles"])] == index]
    a, b, c = (arrays["vertices"][of_it[:, i]].astype(float) for i in range(3))
    total = np.cross(b - a, c - a).sum(axis=0)
    return total / np.linalg.norm(total)


@pytest.mark.parametrize(
    ("steps", "flip", "expected"),
    [
        ("", "false", (0, 0, 1)),
        ("", "true", (0, 0, -1)),
        ('<scale z="-1"/>', "false", (0, 0, -1)),
        ('<scale x="-1"/>', "false", (0, 0, 1)),
        ('<rotate x="1" angle="90"/>', "false", (0, -1, 0)),
    ],
)
def test_fronts_of_mitsubas_rectangles(tmp_path: Path, steps: str, flip: str, expected: Any) -> None:
    inside = f'<transform name="to_world">{steps}</transform><boolean name="flip_normals" value="{flip}"/>'
    scene = mitsuba(tmp_path, f'<shape type="rectangle">{inside}{GREY}{AREA}</shape>')
    assert front(scene, 0) == pytest.approx(expected, abs=1e-6)


@pytest.mark.parametrize(("mirrored", "expected"), [("1", (0, 0, 1)), ("-1", (0, 0, -1))])
def test_the_winding_of_a_mesh_without_normals_decides_and_a_mirror_turns_it(
    tmp_path: Path, mirrored: str, expected: Any
) -> None:
    peer_scenes.write_parts(tmp_path)
    name, flat = '<string name="filename" value="part.ply"/>', '<boolean name="face_normals" value="true"/>'
    steps = f'<transform name="to_world"><scale x="{mirrored}"/></transform>'
    scene = mitsuba(tmp_path, f'<shape type="ply">{name}{flat}{steps}{AREA}</shape>')
    assert front(scene, 0) == pytest.approx(expected, abs=1e-6)


@for_each(
    ("before", "normals", "expected"),
    [
        ("", "", (0, 0, 1)),
        ("Scale -1 1 1", "", (0, 0, 1)),
        ("Scale 1 1 -1", "", (0, 0, -1)),
        ("ReverseOrientation", "", (0, 0, -1)),
        ("", '"normal N" [0 0 -1 0 0 -1 0 0 -1]', (0, 0, -1)),
        ("ReverseOrientation", '"normal N" [0 0 -1 0 0 -1 0 0 -1]', (0, 0, 1)),
    ],
)
def test_fronts_of_pbrts_triangles(tmp_path: Path, before: str, normals: str, expected: Any) -> None:
    world = f'{before}\nAreaLightSource "diffuse"\nShape "trianglemesh" "point3 P" [0 0 0 1 0 0 0 1 0] {normals}'
    assert front(pbrt(tmp_path, world), 0) == pytest.approx(expected, abs=1e-6)


# --- materials


def test_surfaces_of_mitsuba_have_one_side_and_those_of_pbrt_two(tmp_path: Path) -> None:
    shapes = f'<shape type="sphere">{GREY}</shape><shape type="sphere"><bsdf type="twosided">{GREY}</bsdf></shape>'
    scene = mitsuba(tmp_path, shapes)
    sides = [scene.materials[shape.material or ""].two_sided for shape in scene.shapes]  # type: ignore[union-attr]
    assert sides == [False, True]
    assert pbrt(tmp_path, 'Material "diffuse"\n' + BALL).materials["diffuse"].two_sided  # type: ignore[union-attr]


@pytest.mark.parametrize(("remap", "alpha"), [("true", 0.3), ("false", 0.09)])
def test_roughness_is_squared_or_not(tmp_path: Path, remap: str, alpha: float) -> None:
    """Ours squared is alpha; Mitsuba gives alpha; pbrt's root is alpha unless it is not remapped."""
    metal = f'Material "conductor" "float roughness" 0.09 "bool remaproughness" {remap}\n'
    assert dump(pbrt(tmp_path, metal + BALL).materials["conductor"])["roughness"] ** 2 == pytest.approx(alpha)
    bsdf = (
        '<bsdf type="roughconductor"><string name="distribution" value="ggx"/><float name="alpha" value="0.09"/></bsdf>'
    )
    scene = mitsuba(tmp_path, f'<shape type="sphere">{bsdf}</shape>')
    assert dump(scene.materials["roughconductor"])["roughness"] ** 2 == pytest.approx(0.09)


def test_rough_surfaces_have_the_facets_that_the_file_names(tmp_path: Path) -> None:
    """Beckmann's are Mitsuba's default."""
    for kind in ("roughconductor", "roughdielectric", "roughplastic"):
        for given, expected in (("", "beckmann"), ('<string name="distribution" value="ggx"/>', "ggx")):
            scene = mitsuba(tmp_path, f'<shape type="sphere"><bsdf type="{kind}">{given}</bsdf></shape>')
            assert dump(scene.materials[kind])["microfacets"] == expected


def test_a_grey_specular_reflectance_is_a_share_of_the_light(tmp_path: Path) -> None:
    bsdf = '<bsdf type="conductor"><rgb name="eta" value="0.2"/><rgb name="k" value="3"/>{}</bsdf>'
    dim = bsdf.format('<rgb name="specular_reflectance" value="0.3"/>')
    scene = mitsuba(tmp_path, f'<shape type="sphere">{dim}</shape>')
    mixture = dump(scene.materials[scene.shapes[0].material or ""])
    assert mixture["type"] == "mix" and mixture["weight"] == pytest.approx(0.7)
    whole, black = (dump(scene.materials[name]) for name in mixture["materials"])
    assert whole["type"] == "conductor" and whole["eta"] == (0.2,) * 3 and black["reflectance"] == (0.0,) * 3


def test_mean_reflectance_of_a_boundary() -> None:
    # Known values for an index of 1.5: 0.0918 from outside and 0.5963 from inside (Judd 1942)
    assert external_reflectance(1.5) == pytest.approx(0.0918, abs=1e-4)
    assert internal_reflectance(1.5) == pytest.approx(0.5964, abs=2e-4)
    assert external_reflectance(1.0) == pytest.approx(0.0, abs=1e-12)


def test_light_under_a_coat_is_reflected_again_and_again(tmp_path: Path) -> None:
    inner = internal_reflectance(1.5)
    expected = 0.4 * (1.0 - inner) / (1.0 - 0.4 * inner)
    plain = pbrt(tmp_path, 'Material "coateddiffuse" "rgb reflectance" [0.4 0.4 0.4]\n' + BALL)
    assert dump(plain.materials["coateddiffuse"])["base_color"][0] == pytest.approx(expected)
    body = '<rgb name="diffuse_reflectance" value="0.4"/><float name="int_ior" value="1.5"/>'
    body += '<float name="ext_ior" value="1"/>'
    for nonlinear, base in (("true", expected), ("false", 0.4)):
        option = f'<boolean name="nonlinear" value="{nonlinear}"/>'
        scene = mitsuba(tmp_path, f'<shape type="sphere"><bsdf type="plastic">{body}{option}</bsdf></shape>')
        assert dump(scene.materials["plastic"])["base_color"][0] == pytest.approx(base)


def test_names_of_media_and_metals(tmp_path: Path) -> None:
    scene = mitsuba(tmp_path, '<shape type="sphere"><bsdf type="dielectric"/></shape>')
    assert dump(scene.materials["dielectric"])["ior"] == 1.5046
    assert dump(scene.materials["dielectric"])["exterior_ior"] == 1.000277
    old = mitsuba(tmp_path, '<shape type="sphere"><bsdf type="conductor"/></shape>', "0.6.0")
    assert dump(old.materials["conductor"])["eta"] == (0.201, 0.9237, 1.1022)  # copper
    new = mitsuba(tmp_path, '<shape type="sphere"><bsdf type="conductor"/></shape>')
    assert dump(new.materials["conductor"])["type"] == "mirror"  # "none"


# --- cameras and settings


SENSOR = (
    '<sensor type="{}"><film type="hdrfilm"><integer name="width" value="200"/><integer name="height" value="100"/>\
<rfilter type="box"/></film>{}</sensor>'
)


@pytest.mark.parametrize(
    ("given", "across"),
    [
        ('<float name="fov" value="60"/>', 200.0),
        ('<float name="fov" value="60"/><string name="fov_axis" value="y"/>', 100.0),
        ('<float name="fov" value="60"/><string name="fov_axis" value="smaller"/>', 100.0),
        ('<float name="fov" value="60"/><string name="fov_axis" value="diagonal"/>', math.hypot(200.0, 100.0)),
    ],
)
def test_the_angle_is_across_what_the_axis_says(tmp_path: Path, given: str, across: float) -> None:
    scene = mitsuba(tmp_path, SENSOR.format("perspective", given) + f'<shape type="sphere">{GREY}</shape>')
    half = math.tan(math.radians(scene.camera.vertical_fov) / 2.0)
    assert half * across / 100.0 == pytest.approx(math.tan(math.radians(30.0)))


def test_a_focal_length_is_for_film_of_36_by_24(tmp_path: Path) -> None:
    scene = mitsuba(tmp_path, SENSOR.format("perspective", "") + f'<shape type="sphere">{GREY}</shape>')
    half = math.tan(math.radians(scene.camera.vertical_fov) / 2.0) * math.hypot(200.0, 100.0) / 100.0
    assert half == pytest.approx(math.hypot(36.0, 24.0) / (2.0 * 50.0))


@pytest.mark.parametrize(("size", "across"), [((200, 100), 100.0), ((100, 200), 100.0)])
def test_pbrts_angle_is_across_the_shorter_side(tmp_path: Path, size: tuple[int, int], across: float) -> None:
    before = f'Film "rgb" "integer xresolution" {size[0]} "integer yresolution" {size[1]}\n'
    scene = pbrt(tmp_path, BALL, before + 'Camera "perspective" "float fov" 60')
    half = math.tan(math.radians(scene.camera.vertical_fov) / 2.0)
    assert half * across / size[1] == pytest.approx(math.tan(math.radians(30.0)))


def test_parallel_cameras(tmp_path: Path) -> None:
    steps = '<transform name="to_world"><scale x="3" y="3"/></transform>'
    scene = mitsuba(tmp_path, SENSOR.format("orthographic", steps) + f'<shape type="sphere">{GREY}</shape>')
    assert scene.camera.height == pytest.approx(2.0 * 3.0 / 2.0)  # 2 wide before the scale
    before = 'Film "rgb" "integer xresolution" 200 "integer yresolution" 100\nCamera "orthographic"'
    assert pbrt(tmp_path, BALL, before).camera.height == pytest.approx(2.0)  # the shorter side from -1 to 1


@pytest.mark.parametrize(("before", "mirrored"), [("", True), ("Scale -1 1 1\n", False)])
def test_pbrts_world_is_left_handed(tmp_path: Path, before: str, mirrored: bool) -> None:
    """Seen along +z with +y up, its +x is to the right; ours is to the left."""
    scene = pbrt(tmp_path, BALL, before + 'LookAt 1 2 3  1 2 4  0 1 0\nCamera "perspective"')
    assert scene.camera.mirrored is mirrored
    assert scene.camera.position == pytest.approx((1.0, 2.0, 3.0))
    view = np.subtract(scene.camera.target, scene.camera.position)
    assert view / np.linalg.norm(view) == pytest.approx((0.0, 0.0, 1.0))
    row = flatten(scene, 20, 10).camera[0]
    assert np.sign(row["right"][0]) == (1.0 if mirrored else -1.0)


@pytest.mark.parametrize(("theirs", "ours"), [(-1, None), (1, 0), (2, 1), (8, 7)])
def test_mitsubas_depth_counts_segments(tmp_path: Path, theirs: int, ours: int | None) -> None:
    depth = f'<integrator type="path"><integer name="max_depth" value="{theirs}"/></integrator>'
    assert mitsuba(tmp_path, depth + f'<shape type="sphere">{GREY}</shape>').render.max_depth == ours


def test_pbrts_depth_counts_scattering_as_ours_does(tmp_path: Path) -> None:
    scene = pbrt(tmp_path, BALL, 'Camera "perspective"\nIntegrator "path" "integer maxdepth" 7\nSampler "sobol"')
    assert (scene.render.max_depth, scene.render.spp, scene.image.width, scene.image.height) == (7, 16, 1280, 720)


# --- places and textures


def test_steps_of_a_transform_follow_each_other(tmp_path: Path) -> None:
    steps = '<translate x="1" y="2" z="3"/><scale value="2"/><rotate z="1" angle="90"/>'
    scene = mitsuba(tmp_path, f'<shape type="cube"><transform name="to_world">{steps}</transform>{GREY}</shape>')
    matrix = np.array(scene.shapes[0].transform.matrix)
    assert matrix @ [1.0, 1.0, 1.0, 1.0] == pytest.approx([-6.0, 4.0, 8.0, 1.0])


def test_pbrts_transforms_go_the_other_way(tmp_path: Path) -> None:
    world = "Rotate 90 0 0 1 Scale 2 2 2 Translate 1 2 3\n" + BALL
    matrix = np.array(pbrt(tmp_path, world).shapes[0].transform.matrix)
    assert (matrix @ [0.0, 0.0, 0.0, 1.0]) == pytest.approx([-4.0, 2.0, 6.0, 1.0])
    columns = "Transform [1 0 0 0  0 1 0 0  0 0 1 0  5 6 7 1]\n"
    assert np.array(pbrt(tmp_path, columns + BALL).shapes[0].transform.matrix)[:3, 3] == pytest.approx([5.0, 6.0, 7.0])


def test_rotations() -> None:
    assert rotation((0.0, 0.0, 5.0), 90.0)[:3, :3] @ [1.0, 0.0, 0.0] == pytest.approx([0.0, 1.0, 0.0], abs=1e-15)
    whole = rotation((1.0, 2.0, 3.0), 77.0)
    assert whole @ whole.T == pytest.approx(np.eye(4), abs=1e-14)


def test_instances_are_written_out(tmp_path: Path) -> None:
    cube = f'<shape type="cube"><transform name="to_world"><scale value="2"/></transform>{GREY}</shape>'
    group = f'<shape type="shapegroup" id="g">{cube}</shape>'
    use = '<shape type="instance"><ref id="g"/><transform name="to_world"><translate x="{}"/></transform></shape>'
    scene = mitsuba(tmp_path, use.format(5) + group + use.format(7))  # also before it is defined
    places = [np.array(shape.transform.matrix)[0] for shape in scene.shapes]
    assert [list(row) for row in places] == [[2.0, 0.0, 0.0, 5.0], [2.0, 0.0, 0.0, 7.0]]
    use = 'ObjectInstance "o"\n'
    world = f'ObjectBegin "o"\nScale 2 2 2\n{BALL}ObjectEnd\nTranslate 5 0 0 {use} Translate 2 0 0 {use}'
    spheres = pbrt(tmp_path, world).shapes
    assert [np.array(shape.transform.matrix)[0][3] for shape in spheres] == [5.0, 7.0]


def test_pictures_stand_on_their_heads_in_mitsuba_3(tmp_path: Path) -> None:
    peer_scenes.write_parts(tmp_path)
    steps = (
        '<transform name="to_uv"><scale x="2" y="3"/><rotate z="1" angle="25"/><translate x="0.2" y="0.1"/></transform>'
    )
    picture = (
        f'<texture name="reflectance" type="bitmap"><string name="filename" value="picture.png"/>{steps}</texture>'
    )
    scene = mitsuba(tmp_path, f'<shape type="sphere"><bsdf type="diffuse">{picture}</bsdf></shape>')
    transform = scene.materials["diffuse"].reflectance.transform  # type: ignore[union-attr]
    turn, rng = math.radians(transform.rotate_degrees), np.random.default_rng(1)
    for u, v in rng.uniform(-1.0, 2.0, (20, 2)):
        x, y = u * transform.scale[0], v * transform.scale[1]
        turned = [math.cos(turn) * x - math.sin(turn) * y, math.sin(turn) * x + math.cos(turn) * y]
        ours = np.add(turned, transform.offset)
        a = math.radians(25.0)
        theirs = (math.cos(a) * 2 * u - math.sin(a) * 3 * v + 0.2, math.sin(a) * 2 * u + math.cos(a) * 3 * v + 0.1)
        assert ours == pytest.approx([theirs[0], 1.0 - theirs[1]])


def test_the_square_of_pbrts_environments_keeps_areas() -> None:
    rng = np.random.default_rng(2)
    directions = rng.normal(size=(200000, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    u, v = square_place(directions)
    counts, _, _ = np.histogram2d(u, v, bins=8, range=[[0.0, 1.0], [0.0, 1.0]])
    expected = 200000 / 64
    # 63 degrees of freedom: 120 is exceeded with a probability of 2e-5
    assert ((counts - expected) ** 2 / expected).sum() < 120.0
    corners = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, -1.0, 0.0]])
    assert np.stack(square_place(corners), axis=1) == pytest.approx(
        np.array([[0.5, 0.5], [1.0, 0.5], [0.5, 1.0], [0.5, 0.0]])
    )


def test_meshes_that_shapes_become() -> None:
    for mesh in (cube_mesh(), sphere_mesh(2.0)):
        a, b, c = (mesh.vertices[mesh.triangles[:, i]] for i in range(3))
        outward = (np.cross(b - a, c - a) * (a + b + c)).sum(axis=1)
        assert (outward >= -1e-12).all()
    tube = cylinder_mesh(2.0, -1.0, 3.0)
    assert tube.vertices[:, 2].min() == -1.0 and tube.vertices[:, 2].max() == 3.0
    assert np.hypot(tube.vertices[:, 0], tube.vertices[:, 1]) == pytest.approx(2.0)


def area_and_outward(mesh: MeshData) -> tuple[float, bool]:
    """The area, and whether all triangles face as their vertices' normals do."""
    a, b, c = (mesh.vertices[mesh.triangles[:, i]] for i in range(3))
    double = np.cross(b - a, c - a)
    assert mesh.normals is not None
    return float(np.linalg.norm(double, axis=1).sum() / 2.0), bool(
        ((double * mesh.normals[mesh.triangles].sum(axis=1)).sum(axis=1) >= -1e-12).all()
    )


@for_each(
    ("kind", "more", "area", "low", "high", "normal"),
    [
        ("cylinder", '"float radius" 2 "float zmin" -1 "float zmax" 3', 16.0 * math.pi, (-2, -2, -1), (2, 2, 3), None),
        ("cylinder", '"float phimax" 90', math.pi, (0, 0, -1), (1, 1, 1), None),
        ("sphere", '"float radius" 2 "float zmin" 1', 4.0 * math.pi, (-math.sqrt(3), -math.sqrt(3), 1), None, None),
        ("sphere", '"float phimax" 180', 2.0 * math.pi, (-1, 0, -1), (1, 1, 1), None),
        ("disk", '"float innerradius" 0.5 "float height" 3', 0.75 * math.pi, (-1, -1, 3), (1, 1, 3), (0, 0, 1)),
        ("disk", '"float phimax" 90', 0.25 * math.pi, (0, 0, 0), (1, 1, 0), (0, 0, 1)),
    ],
)
def test_parts_of_round_shapes(
    tmp_path: Path, kind: str, more: str, area: float, low: Any, high: Any, normal: Any
) -> None:
    scene = pbrt(tmp_path, f'Material "diffuse"\nShape "{kind}" {more}\n')
    assert not [note for note in scene.notes if "approximated" in note or "whole" in note]
    mesh = scene.mesh(0)
    found, faces = area_and_outward(mesh)
    assert faces and found == pytest.approx(area, rel=1e-4)
    assert mesh.vertices.min(axis=0) == pytest.approx(low, abs=1e-4)
    assert high is None or mesh.vertices.max(axis=0) == pytest.approx(high, abs=1e-4)
    assert mesh.normals is not None and mesh.uvs is not None
    if normal is not None:
        assert (mesh.normals == normal).all()
    elif kind == "sphere":
        radius = np.linalg.norm(mesh.vertices, axis=1).max()
        np.testing.assert_allclose(mesh.normals * radius, mesh.vertices, rtol=0.0, atol=1e-5)
    assert (mesh.uvs.min(), mesh.uvs.max()) == (0.0, 1.0)


def test_equal_cylinders_share_a_mesh(tmp_path: Path) -> None:
    one = 'Shape "cylinder" "float radius" 0.1\nTranslate 4 0 0\n'
    scene = pbrt(tmp_path, f'Material "diffuse"\n{one}{one}')
    assert len(scene.shapes) == 2 and scene.mesh(0) is scene.mesh(1)


@for_each("more", ['"float phimax" 0', '"float zmin" 2', '"float zmin" 0.5 "float zmax" 0.5'])
def test_parts_of_spheres_that_are_nothing_are_refused(tmp_path: Path, more: str) -> None:
    with pytest.raises(SceneError, match="nothing is left"):
        pbrt(tmp_path, f'Material "diffuse"\nShape "sphere" {more}\n')


def test_bilinear_patches_are_where_the_formula_has_them(tmp_path: Path) -> None:
    """A saddle, z = u v, of whose surface every vertex is, and no triangle farther than 1e-4 of its size."""
    corners = "0 0 0  1 0 0  0 1 0  1 1 1"
    scene = pbrt(tmp_path, f'Material "diffuse"\nShape "bilinearmesh" "point3 P" [{corners}]\n')
    mesh = scene.mesh(0)
    x, y, z = np.asarray(mesh.vertices, np.float64).T
    np.testing.assert_allclose(z, x * y, rtol=0.0, atol=1e-7)
    a, b, c = (np.asarray(mesh.vertices, np.float64)[mesh.triangles[:, i]] for i in range(3))
    middle = (a + b + c) / 3.0
    assert np.abs(middle[:, 2] - middle[:, 0] * middle[:, 1]).max() < 1e-4
    assert mesh.normals is not None and mesh.uvs is not None
    normals = mesh.normals / np.linalg.norm(mesh.normals, axis=1, keepdims=True)
    expected = np.stack([-y, -x, np.ones_like(x)], axis=1)
    assert normals == pytest.approx(expected / np.linalg.norm(expected, axis=1, keepdims=True), abs=1e-6)
    assert area_and_outward(mesh)[1]
    at = np.asarray(mesh.vertices, np.float64)[mesh.triangles][..., :2]
    assert mesh.uvs == pytest.approx(at, abs=1e-6)


def test_bilinear_patches_of_three_corners_have_normals(tmp_path: Path) -> None:
    corners = "0 0 0  1 0 0  0 1 1  0 1 1"
    text = f'Material "diffuse"\nShape "bilinearmesh" "point3 P" [{corners}] "point2 uv" [0 0  1 0  0 1  1 1]\n'
    mesh = pbrt(tmp_path, text).mesh(0)
    assert mesh.normals is not None and (np.linalg.norm(mesh.normals, axis=1) > 0.0).all()
    flat = np.array([0.0, -1.0, 1.0]) / math.sqrt(2.0)
    normals = mesh.normals / np.linalg.norm(mesh.normals, axis=1, keepdims=True)
    assert normals == pytest.approx(np.tile(flat, (len(normals), 1)), abs=1e-6)


def test_meshes_without_normals_are_smooth_by_angles() -> None:
    vertices = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 0, 1]], float)
    mesh = smoothed(MeshData(vertices, np.array([[0, 1, 2], [0, 3, 1]], np.uint32)))
    assert mesh.normals is not None
    normals = mesh.normals / np.linalg.norm(mesh.normals, axis=1, keepdims=True)
    # At the origin the first triangle has 90 degrees and faces +z, the second 45 and +y; at the next corner 45 and 90
    long, short = 2.0 / math.sqrt(5.0), 1.0 / math.sqrt(5.0)
    assert normals == pytest.approx(np.array([[0, short, long], [0, long, short], [0, 0, 1], [0, 1, 0]]))


# --- all of it


def test_all_that_is_known_is_read_without_a_word_of_what_is_not(tmp_path: Path) -> None:
    peer_scenes.write_parts(tmp_path)
    for name, text in (
        ("a.xml", peer_scenes.MITSUBA),
        ("b.xml", peer_scenes.MITSUBA_06),
        ("c.pbrt", peer_scenes.PBRT),
    ):
        (tmp_path / name).write_text(text, encoding="utf-8")
        scene = load(tmp_path / name)
        flatten(scene, 8, 8)
        assert not [note for note in scene.notes if "not understood" in note or "not known" in note]


def test_what_is_not_understood_is_said_once(tmp_path: Path) -> None:
    odd = '<bsdf type="diffuse"><float name="fuzz" value="1"/></bsdf>'
    scene = mitsuba(tmp_path, f'<shape type="sphere">{odd}</shape><shape type="sphere">{odd}</shape>')
    assert [note.partition(": ")[2] for note in scene.notes if "fuzz" in note] == [
        '"fuzz" of the bsdf of type "diffuse" is not understood and does nothing'
    ]
    ball = 'Material "diffuse" "float fuzz" 1\n' + BALL
    assert len([note for note in pbrt(tmp_path, ball + ball).notes if "fuzz" in note]) == 1


def test_included_files(tmp_path: Path) -> None:
    part = '<scene version="3.0.0"><bsdf type="diffuse" id="$name"/></scene>'
    (tmp_path / "part.xml").write_text(part, encoding="utf-8")
    inside = '<default name="name" value="grey"/><include filename="part.xml"/><alias id="grey" as="other"/>'
    scene = mitsuba(tmp_path, inside + '<shape type="sphere"><ref id="other"/></shape>')
    assert scene.shapes[0].material == "grey"
    (tmp_path / "part.pbrt").write_text(
        'Translate 5 0 0\nMakeNamedMaterial "m" "string type" "diffuse"', encoding="utf-8"
    )
    kept = pbrt(tmp_path, f'Include "part.pbrt" NamedMaterial "m" {BALL}')
    assert kept.shapes[0].material == "m" and np.array(kept.shapes[0].transform.matrix)[0][3] == 5.0


@for_each("kind", ["png", "grey png", "pfm", "checker"])
def test_textured_plastics_are_those_of_their_colours(tmp_path: Path, kind: str) -> None:
    """Each texel has the colour that a constant would have, to half precision; a checkerboard exactly."""
    begin = 'LookAt 0 0 5 0 0 0 0 1 0\nCamera "perspective"\nWorldBegin\n'
    codes = np.array([(186, 120, 230), (3, 250, 77)], np.uint8)
    linear = srgb_decode(codes / 255.0)
    texture = '"imagemap" "string filename" "t.png"'
    if kind == "checker":
        tex = [" ".join(f"{x!r}" for x in color.tolist()) for color in linear]
        texture = f'"checkerboard" "rgb tex1" [{tex[0]}] "rgb tex2" [{tex[1]}]'
    elif kind == "pfm":
        texture = texture.replace("png", "pfm")
        (tmp_path / "t.pfm").write_bytes(b"PF\n2 1\n-1\n" + linear.astype("<f4").tobytes())
    else:
        codes = codes if kind == "png" else np.repeat(codes[:, :1], 3, axis=1)
        linear = srgb_decode(codes / 255.0)
        Image.fromarray(codes[None] if kind == "png" else codes[None, :, 0]).save(tmp_path / "t.png")
    (tmp_path / "a.pbrt").write_text(
        f'{begin}Texture "t" "spectrum" {texture}\nMaterial "coateddiffuse" "texture reflectance" "t"\nShape "sphere"\n'
    )
    scene = load(tmp_path / "a.pbrt")
    made: Any = next(iter(scene.materials.values()))
    wanted = []
    for color in linear:
        numbers = " ".join(map(repr, color.tolist()))
        (tmp_path / "b.pbrt").write_text(
            f'{begin}Material "coateddiffuse" "rgb reflectance" [{numbers}]\nShape "sphere"\n'
        )
        constant: Any = next(iter(load(tmp_path / "b.pbrt").materials.values()))
        wanted.append(constant.base_color)
        assert (made.ior, made.roughness) == (constant.ior, constant.roughness)
    if kind == "checker":
        np.testing.assert_allclose(made.base_color.checker, wanted, rtol=1e-12)
        return
    draft = clrender.importers.pbrt.read(tmp_path / "a.pbrt", AssetFiles("a.pbrt", tmp_path))
    data, ending = draft.pictures[made.base_color.texture]
    bands = list(open_picture(io.BytesIO(data), ending).bands())
    found = bands[0].view(np.float16) if bands[0].dtype == np.uint16 else bands[0]
    np.testing.assert_allclose(np.broadcast_to(found[0, :, :3], (2, 3)), wanted, rtol=1e-3, atol=1e-6)
    assert not any("coateddiffuse" in note for note in scene.notes)


def test_mitsuba_3_takes_the_axis_of_a_rotation_as_it_is(tmp_path: Path) -> None:
    """Matrices of Mitsuba 3.7: an axis of another length than 1 makes no rotation. 0.6 makes it a unit vector."""

    def matrix(axis: str, angle: float, version: str = "3.0.0") -> Any:
        turn = f'<transform name="to_world"><rotate {axis} angle="{angle}"/></transform>'
        (shape,) = mitsuba(tmp_path, f'<shape type="rectangle">{turn}{GREY}</shape>', version).shapes
        return np.array(shape.transform.matrix)[:3, :3]

    long = [[0.0, -2.0, 0.0], [2.0, 0.0, 0.0], [0.0, 0.0, 4.0]]
    np.testing.assert_allclose(matrix('x="0" y="0" z="2"', 90.0), long, atol=1e-6)
    slanted = [[1.0, 0.233956, 0.642788], [0.233956, 1.0, -0.642788], [-0.642788, 0.642788, 0.766044]]
    np.testing.assert_allclose(matrix('x="1" y="1" z="0"', 40.0), slanted, atol=1e-6)
    np.testing.assert_allclose(matrix('x="0" y="0" z="2"', 90.0, "0.6.0"), np.array(long) / [[2], [2], [4]], atol=1e-6)


@pytest.mark.parametrize("version", ["0.6.0", "3.0.0"])
def test_what_shines_reflects_nothing_unless_its_bsdf_says_so(tmp_path: Path, version: str) -> None:
    inside = ("", AREA, AREA + GREY)
    scene = mitsuba(tmp_path, "".join(f'<shape type="rectangle">{each}</shape>' for each in inside), version)
    found = [dump(scene.materials[shape.material or ""])["reflectance"][0] for shape in scene.plain_shapes]
    assert found == [0.5, 0.0, 0.5]


@pytest.mark.parametrize("mirrored", ["1", "-1"])
@pytest.mark.parametrize("flip", [True, False])
def test_fronts_of_cylinders_are_outside_even_if_they_are_mirrored(tmp_path: Path, mirrored: str, flip: bool) -> None:
    """As rays see them in Mitsuba 3.9.1: the opposite of its spheres."""
    steps = f'<transform name="to_world"><scale x="{mirrored}" y="1" z="1"/><translate x="3"/></transform>'
    flag = f'<boolean name="flip_normals" value="{str(flip).lower()}"/>'
    scene = mitsuba(tmp_path, f'<shape type="cylinder">{steps}{flag}{GREY}</shape>')
    arrays = flatten(scene, 8, 8).arrays
    a, b, c = (arrays["vertices"][arrays["triangles"][:, i]].astype(float) for i in range(3))
    outward = (np.cross(b - a, c - a) * (a - [3.0, 0.0, 0.0]) * [1.0, 1.0, 0.0]).sum(axis=1)
    assert ((outward > 0.0) != flip).all()


def test_an_area_light_with_a_name_is_not_left_out(tmp_path: Path) -> None:
    scene = mitsuba(
        tmp_path, '<shape type="rectangle"><ref id="lamp"/></shape>' + AREA.replace('"area"', '"area" id="lamp"')
    )
    assert scene.shapes[0].emission is not None and not any("left out" in note for note in scene.notes)


@for_each("format", ["pbrt", "pbrt without remapping", "mitsuba", "checker"])
def test_textured_roughness_is_that_of_its_numbers(tmp_path: Path, format: str) -> None:
    """Our roughness is the root of alpha; that of pbrt is the root of its roughness, unless remapping is off."""
    numbers = np.array([0.04, 0.25, 0.81], np.float32)
    pfm = b"Pf\n3 1\n-1\n" + numbers.astype("<f4").tobytes()
    (tmp_path / "t.pfm").write_bytes(pfm)
    roots = 2 if format in ("pbrt", "checker") else 1
    if format == "mitsuba":
        bitmap = '<texture type="bitmap" name="alpha"><string name="filename" value="t.pfm"/></texture>'
        text = (
            f'<scene version="3.0.0"><shape type="sphere"><bsdf type="roughconductor">{bitmap}</bsdf></shape></scene>'
        )
        (tmp_path / "a.xml").write_text(text)
        draft = clrender.importers.mitsuba.read(tmp_path / "a.xml", AssetFiles("a.xml", tmp_path))
    else:
        kind = (
            '"checkerboard" "float tex1" 0.04 "float tex2" 0.81'
            if format == "checker"
            else '"imagemap" "string filename" "t.pfm"'
        )
        more = '"bool remaproughness" false' if roots == 1 else ""
        text = f'Camera "perspective"\nWorldBegin\nTexture "t" "float" {kind}\n'
        text += f'Material "conductor" "texture roughness" "t" {more}\nShape "sphere"\n'
        (tmp_path / "a.pbrt").write_text(text)
        draft = clrender.importers.pbrt.read(tmp_path / "a.pbrt", AssetFiles("a.pbrt", tmp_path))
    (made,) = draft.description["materials"].values()
    assert not any("left out" in note for note in draft.notes), draft.notes
    wanted = numbers.astype(float) ** (0.5**roots)
    if format == "checker":
        np.testing.assert_allclose(np.reshape(made["roughness"]["checker"], (2, -1))[:, 0], wanted[[0, 2]], rtol=1e-7)
        return
    data, ending = draft.pictures[made["roughness"]["texture"]]
    (band,) = open_picture(io.BytesIO(data), ending).bands()
    np.testing.assert_allclose(band.view(np.float16)[0, :, 0], wanted, rtol=1e-3)
    assert made["roughness"]["channel"] == "r"


@for_each(
    ("reflected", "transmitted", "scale"),
    [
        ((0.25, 0.25, 0.25), (0.25, 0.25, 0.25), 1.0),
        ((0.5, 0.2, 0.1), (0.1, 0.3, 0.4), 1.0),
        ((0.6, 0.0, 0.0), (0.0, 0.0, 0.2), 0.5),
        ((0.3, 0.3, 0.3), (0.0, 0.0, 0.0), 1.0),
        ((0.0, 0.0, 0.0), (1.0, 0.5, 0.25), 1.0),
    ],
)
def test_sheets_of_pbrt_reflect_and_transmit_their_colours(
    tmp_path: Path, reflected: tuple[float, ...], transmitted: tuple[float, ...], scale: float
) -> None:
    first, second = (" ".join(map(str, color)) for color in (reflected, transmitted))
    sheet = f'"diffusetransmission" "rgb reflectance" [{first}] "rgb transmittance" [{second}] "float scale" {scale}'
    scene = pbrt(tmp_path, f'Material {sheet}\nShape "disk"')
    made: Any = next(iter(scene.materials.values()))
    assert made.type == "principled" and made.specular == 0.0
    share = made.diffuse_transmission
    np.testing.assert_allclose(np.multiply(made.base_color, 1.0 - share), np.multiply(reflected, scale), atol=1e-9)
    color = made.diffuse_transmission_color or (0.0, 0.0, 0.0)
    np.testing.assert_allclose(np.multiply(color, share), np.multiply(transmitted, scale), atol=1e-9)
    assert not any("diffusetransmission" in note for note in scene.notes)


@for_each(
    ("kind", "parameter", "name", "radius", "noted"),
    [
        ("box", "", "box", None, False),
        ("box", '<float name="radius" value="1"/>', "box", 1.0, False),
        ("tent", "", "tent", None, False),
        ("tent", '<float name="radius" value="1"/>', "tent", None, False),
        ("tent", '<float name="radius" value="2"/>', "tent", 2.0, False),
        ("tent", '<float name="radius" value="9"/>', "tent", 8.0, True),
        ("gaussian", "", "gaussian", None, False),
        ("gaussian", '<float name="stddev" value="0.4"/>', "gaussian", 1.2, False),
        ("mitchell", "", "mitchell", None, False),
        ("mitchell", '<float name="C" value="0.5"/>', "mitchell", None, True),
        ("lanczos", "", "mitchell", None, True),
    ],
)
def test_pixel_filters_of_mitsuba(
    tmp_path: Path, kind: str, parameter: str, name: str, radius: float | None, noted: bool
) -> None:
    film = f'<film type="hdrfilm"><rfilter type="{kind}">{parameter}</rfilter></film>'
    scene = mitsuba(tmp_path, f'<sensor type="perspective">{film}</sensor><shape type="sphere">{GREY}</shape>')
    assert (scene.render.filter, scene.render.filter_radius) == (name, pytest.approx(radius))
    assert any("pixel filter" in note for note in scene.notes) is noted


@for_each(
    ("given", "name", "radius", "noted"),
    [
        ('"box"', "box", None, False),
        ('"triangle" "float xradius" 1 "float yradius" 1', "tent", None, False),
        ('"triangle"', "tent", 2.0, False),
        ('"triangle" "float xradius" 1', "tent", None, True),  # and along y 2
        ('"gaussian"', "gaussian", None, False),
        ('"gaussian" "float xradius" 3 "float yradius" 3 "float sigma" 1', "gaussian", 3.0, False),
        ('"gaussian" "float xradius" 2 "float yradius" 2', "gaussian", None, True),
        ('"mitchell"', "mitchell", None, False),
        ('"mitchell" "float B" 0', "mitchell", None, True),
        ('"sinc"', "mitchell", None, True),
        ('"other"', "gaussian", None, True),
    ],
)
def test_pixel_filters_of_pbrt(tmp_path: Path, given: str, name: str, radius: float | None, noted: bool) -> None:
    scene = pbrt(tmp_path, BALL, f"PixelFilter {given}\n")
    assert (scene.render.filter, scene.render.filter_radius) == (name, pytest.approx(radius))
    assert any("pixel filter" in note for note in scene.notes) is noted


@for_each(("kind", "name", "noted"), [("path", "path", False), ("sppm", "photon", False), ("other", "path", True)])
def test_integrators(tmp_path: Path, kind: str, name: str, noted: bool) -> None:
    scene = mitsuba(tmp_path, f'<integrator type="{kind}"/><shape type="sphere">{GREY}</shape>')
    assert (scene.render.integrator or "path") == name
    assert any('is read as "path"' in note for note in scene.notes) is noted
    scene = pbrt(tmp_path, BALL, f'Integrator "{kind}"')
    assert (scene.render.integrator or "path") == name
    assert any('is read as "path"' in note for note in scene.notes) is noted


@for_each("kind", ["pbrt", "xml"])
@for_each("textured", [True, False])
def test_meshes_without_texture_coordinates_show_the_picture_on_each_triangle(
    tmp_path: Path, kind: str, textured: bool
) -> None:
    """Barycentric coordinates in Mitsuba, those of the corners (0, 0), (1, 0) and (1, 1) in pbrt; also if turned."""
    Image.new("RGB", (2, 2), (9, 9, 9)).save(tmp_path / "t.png")
    head = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
    head += "property float nx\nproperty float ny\nproperty float nz\nelement face 1\n"
    head += "property list uchar int vertex_indices\nend_header\n"
    (tmp_path / "a.ply").write_text(head + "0 0 0 0 0 -1\n1 0 0 0 0 -1\n0 1 0 0 0 -1\n3 0 1 2\n")
    if kind == "pbrt":
        color = '"texture reflectance" "t"' if textured else ""
        picture = 'Texture "t" "spectrum" "imagemap" "string filename" "t.png"\n'
        scene = pbrt(tmp_path, f'{picture}Material "diffuse" {color}\nShape "plymesh" "string filename" "a.ply"')
    else:
        color = '<texture name="reflectance" type="bitmap"><string name="filename" value="t.png"/></texture>'
        inside = f'<bsdf type="diffuse">{color if textured else ""}</bsdf>'
        scene = mitsuba(tmp_path, f'<shape type="ply"><string name="filename" value="a.ply"/>{inside}</shape>')
    ((at, shape),) = scene.all_shapes()
    mesh = scene.mesh_of(at, shape)  # type: ignore[arg-type]
    if not textured:
        assert mesh.uvs is None
        return
    assert mesh.uvs is not None and mesh.triangles.tolist() == [[2, 1, 0]]
    last = [1.0, 1.0] if kind == "pbrt" else [0.0, 1.0]
    assert mesh.uvs.tolist() == [[last, [1.0, 0.0], [0.0, 0.0]]]
    flatten(scene, 8, 8)


def colored_ply(folder: Path, colors: bool = True) -> str:
    """A mesh of one triangle in Mitsuba's form, with colours of 8 bits."""
    head = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
    head += "property uchar red\nproperty uchar green\nproperty uchar blue\n" if colors else ""
    head += "element face 1\nproperty list uchar int vertex_indices\nend_header\n"
    shades = (" 255 0 0", " 0 128 0", " 0 0 64") if colors else ("",) * 3
    rows = [f"{place}{shade}\n" for place, shade in zip(("0 0 0", "1 0 0", "0 1 0"), shades, strict=True)]
    (folder / "a.ply").write_text(f"{head}{''.join(rows)}3 0 1 2\n")
    return '<string name="filename" value="a.ply"/>'


ATTRIBUTE = '<texture type="mesh_attribute" name="reflectance"><string name="name" value="vertex_color"/></texture>'


def test_colours_of_vertices_are_those_of_the_mesh(tmp_path: Path) -> None:
    """Integers are sRGB, as in Mitsuba; a material of the same constant colour stays without them."""
    shape = f'<shape type="ply">{colored_ply(tmp_path)}'
    plain = '<bsdf type="diffuse"><rgb name="reflectance" value="1"/></bsdf>'
    inside = f'{shape}<bsdf type="diffuse">{ATTRIBUTE}</bsdf></shape>{shape}{plain}</shape>'
    scene = mitsuba(tmp_path, inside)
    (at, first), (_, second) = scene.all_shapes()
    mesh: Any = scene.mesh_of(at, first)  # type: ignore[arg-type]
    wanted = srgb_decode(np.array([[[255, 0, 0], [0, 128, 0], [0, 0, 64]]]) / 255.0)
    np.testing.assert_allclose(mesh.colors, wanted, atol=1e-4)
    assert first.vertex_colors == "linear" and second.vertex_colors is None  # type: ignore[union-attr]
    assert first.material != second.material
    assert dump(scene.materials[first.material])["reflectance"] == (1.0, 1.0, 1.0)  # type: ignore[index]
    assert not any("not known" in note or "not understood" in note for note in scene.notes)
    flatten(scene, 8, 8)


def test_meshes_without_colours_of_vertices_are_white(tmp_path: Path) -> None:
    bsdf = f'<bsdf type="diffuse">{ATTRIBUTE}</bsdf>'
    inside = f'<shape type="ply">{colored_ply(tmp_path, colors=False)}{bsdf}</shape><shape type="sphere">{bsdf}</shape>'
    scene = mitsuba(tmp_path, inside)
    assert [dump(scene.materials[str(shape.material)])["reflectance"] for shape in scene.shapes] == [
        (1.0, 1.0, 1.0)
    ] * 2
    assert len([note for note in scene.notes if "has no colours of vertices: white" in note]) == 2


def test_colours_of_vertices_in_a_mixture(tmp_path: Path) -> None:
    """Also if its part was made before, for another shape."""
    part = f'<bsdf type="diffuse" id="part">{ATTRIBUTE}</bsdf>'
    both = '<bsdf type="blendbsdf"><float name="weight" value="0.5"/><ref id="part"/><bsdf type="diffuse"/></bsdf>'
    shape = f'<shape type="ply">{colored_ply(tmp_path)}'
    scene = mitsuba(tmp_path, f'{part}{shape}<ref id="part"/></shape>{shape}{both}</shape>')
    assert [shape.vertex_colors for shape in scene.shapes] == ["linear", "linear"]  # type: ignore[union-attr]
    assert any("both parts of a mixture" in note for note in scene.notes)


@pytest.mark.parametrize(("outside", "fog"), [("", None), ('<ref name="exterior" id="smoke"/>', "smoke")])
def test_medium_of_mitsubas_camera(tmp_path: Path, outside: str, fog: str | None) -> None:
    """It is fog, unless it ends at a shape, in which the camera then is. Equal media of references are one."""
    smoke = '<medium type="homogeneous" id="smoke"><float name="sigma_t" value="2"/></medium>'
    sensor = '<sensor type="perspective"><ref name="medium" id="smoke"/></sensor>'
    ball = f'<shape type="sphere"><bsdf type="null"/><ref name="interior" id="smoke"/>{outside}</shape>'
    (tmp_path / "a.xml").write_text(f'<scene version="3.0.0">{smoke}{sensor}{ball}</scene>')
    scene = load(tmp_path / "a.xml")
    assert scene.fog == fog and list(scene.media) == ["smoke"] and scene.shapes[0].interior == "smoke"


@pytest.mark.parametrize("own", [1, -1])
@pytest.mark.parametrize("place", [1, -1])
def test_fronts_under_mitsubas_instances(tmp_path: Path, own: int, place: int) -> None:
    """A shape's own reflection turns it inside out, that of an instance does not (compared with images of Mitsuba)."""
    (tmp_path / "a.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    mirror = '<transform name="to_world"><scale x="{}"/></transform>'
    flat = '<string name="filename" value="a.obj"/><boolean name="face_normals" value="true"/>'
    shapes = "".join(
        f'<shape type="{kind}">{inside}{mirror.format(own)}</shape>' for kind, inside in (("sphere", ""), ("obj", flat))
    )
    instance = f'<shape type="instance"><ref id="g"/>{mirror.format(place)}</shape>'
    group = f'<shape type="shapegroup" id="g">{shapes}</shape>'
    (tmp_path / "a.xml").write_text(f'<scene version="3.0.0">{group}{instance}</scene>')
    assert [shape.flip_normals for _, shape in load(tmp_path / "a.xml").all_shapes()] == [own < 0] * 2
