"""Curves and hair of other formats: what pbrt and Mitsuba mean by them, and what is left out."""

from __future__ import annotations

import re
import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cases import for_each
from PIL import Image

import clrender
from clrender.curves import read_mitsuba_hair
from clrender.errors import SceneError
from clrender.exporters import exported_to_mitsuba
from clrender.flatten.hair import hair_absorption, hair_color, hair_numbers
from clrender.scene import Curves
from clrender.scene.materials import Hair

PBRT = 'LookAt 0 0 5  0 0 0  0 1 0\nCamera "perspective"\nWorldBegin\nLightSource "infinite" "rgb L" [1 1 1]\n'
POINTS = "-1 0 0  -0.3 1 0  0.3 -1 0  1 0 0"
MITSUBA = '<scene version="3.0.0"><sensor type="perspective"/><emitter type="constant"/>{}</scene>'


def pbrt(folder: Path, world: str) -> clrender.Scene:
    (folder / "a.pbrt").write_text(PBRT + world)
    return clrender.load(folder / "a.pbrt")


def mitsuba(folder: Path, shapes: str) -> clrender.Scene:
    (folder / "a.xml").write_text(MITSUBA.format(shapes))
    return clrender.load(folder / "a.xml")


def strands(scene: clrender.Scene) -> list[tuple[Curves, Any]]:
    found = [(at, shape) for at, shape in scene.all_shapes() if isinstance(shape, Curves)]
    return [(shape, scene.strands(at, shape)) for at, shape in found]


def hair_of(scene: clrender.Scene) -> Hair:
    (found,) = (each for each in scene.materials.values() if isinstance(each, Hair))
    return found


def test_pbrt_curves_of_a_material_become_one_shape(tmp_path: Path) -> None:
    curve = f'Shape "curve" "point3 P" [{POINTS}] "float width0" 0.2 "float width1" 0.05\n'
    scene = pbrt(
        tmp_path, f'Translate 0 1 0\n{curve}Scale 2 2 2\n{curve}Material "diffuse" "rgb reflectance" [1 0 0]\n{curve}'
    )
    assert not scene.notes
    (first, data), (second, its) = strands(scene)
    assert first.basis == "bezier" and data.counts.tolist() == [4, 4] and its.counts.tolist() == [4]
    assert first.material != second.material
    assert data.points[:4, 1] == pytest.approx([1.0, 2.0, 0.0, 1.0])
    assert data.points[4:, 1] == pytest.approx([1.0, 3.0, -1.0, 1.0])
    assert data.radii[:4] == pytest.approx([0.1, 0.075, 0.05, 0.025])
    assert data.radii[4:] == pytest.approx([0.2, 0.15, 0.1, 0.05])


def test_pbrt_curves_may_end_in_a_point(tmp_path: Path) -> None:
    """0.1 + (0 - 0.1) * 3 / 3 is below 0, by a rounding."""
    curve = f'Shape "curve" "point3 P" [{POINTS}] "float width0" 0.1 "float width1" 0\n'
    ((_, data),) = strands(pbrt(tmp_path, curve))
    assert data.radii.min() == data.radii[-1] == 0.0 and data.radii[0] == 0.05
    far = curve.replace("1 0 0]", "1e13 0 0]")
    with pytest.raises(SceneError, match=r"a\.pbrt: curves 1 has 1e\+13 in point 3"):
        pbrt(tmp_path, far)


@pytest.mark.parametrize(("basis", "degree", "count"), [("bspline", 3, 6), ("bspline", 2, 5), ("bezier", 2, 5)])
def test_pbrt_curves_of_other_bases(tmp_path: Path, basis: str, degree: int, count: int) -> None:
    """Against the polynomials of their basis, in the middle of each segment."""
    points = np.random.RandomState(count).uniform(-1.0, 1.0, (count, 3))
    text = " ".join(f"{x:.17g}" for x in points.ravel())
    words = f'"string basis" "{basis}" "integer degree" {degree} "float width" 0.1'
    ((shape, data),) = strands(pbrt(tmp_path, f'Shape "curve" "point3 P" [{text}] {words}'))
    assert shape.basis == "bezier"
    cubics = data.points[np.arange(0, len(data.points) - 1, 3)[:, None] + np.arange(4)]
    middles = np.einsum("k,nkj->nj", np.array([1.0, 3.0, 3.0, 1.0]) / 8.0, cubics)
    if basis == "bezier":
        weights, starts = np.array([1.0, 2.0, 1.0]) / 4.0, np.arange(0, count - 2, 2)
    elif degree == 2:
        weights, starts = np.array([1.0, 6.0, 1.0]) / 8.0, np.arange(count - 2)
    else:
        weights, starts = np.array([1.0, 23.0, 23.0, 1.0]) / 48.0, np.arange(count - 3)
    expected = [weights @ points[start : start + len(weights)] for start in starts]
    assert middles == pytest.approx(np.array(expected))


@for_each(
    "words, text",
    [
        (f'"point3 P" [{POINTS} 1 1 1]', "line 5: a bezier of degree 3 cannot have 5 points"),
        (f'"point3 P" [{POINTS}] "string basis" "nurbs"', "not a nurbs of 3"),
        (f'"point3 P" [{POINTS}] "integer degree" 4', "of 4"),
        (f'"point3 P" [{POINTS}] "float width" 0', "the curve has no width"),
        ('"float width" 1', "cannot have 0 points"),
        (f'"point3 P" [{POINTS}] "string type" "ribbon"', 'the ribbon has 0 normals; give 2 as "N"'),
    ],
)
def test_pbrt_curves_that_are_none_are_refused(tmp_path: Path, words: str, text: str) -> None:
    with pytest.raises(SceneError, match=text):
        pbrt(tmp_path, f'Shape "curve" {words}')


def test_what_pbrt_curves_lose_is_noted(tmp_path: Path) -> None:
    curve = f'Shape "curve" "point3 P" [{POINTS}] "float width" 0.1'
    glass = f'AttributeBegin\nMaterial "dielectric"\n{curve}\nAttributeEnd\n'
    scene = pbrt(tmp_path, f'AreaLightSource "diffuse"\n{curve}\n{glass}Scale 1 2 1\n{curve}')
    said = " ".join(scene.notes)
    for text in (
        "curves do not shine here",
        "what has an inside are left out",
        "keep round",
    ):
        assert text in said, text
    assert len(strands(scene)) == 1


def test_pbrt_ribbons_are_meshes_of_their_width(tmp_path: Path) -> None:
    """All of a material one mesh, whose normals are the given ones, turned evenly."""
    straight = "0 0 0  0 1 0  0 2 0  0 3 0"
    words = '"string type" "ribbon" "float width0" 0.4 "float width1" 0.2 "normal N" [0 0 1 1 0 0]'
    ribbon = f'Shape "curve" "point3 P" [{straight}] {words}\n'
    scene = pbrt(tmp_path, f"{ribbon}Translate 5 0 0\nScale -1 1 1\n{ribbon}")
    assert not scene.notes and not strands(scene)
    (mesh,) = (scene.mesh_of(at, shape) for at, shape in scene.mesh_files())
    assert mesh.normals is not None and mesh.uvs is not None
    first, other = mesh.vertices[:18].reshape(9, 2, 3), mesh.vertices[18:].reshape(9, 2, 3)
    assert np.sqrt(((first[:, 1] - first[:, 0]) ** 2).sum(axis=1)) == pytest.approx(np.linspace(0.4, 0.2, 9))
    assert first.mean(axis=1)[:, 1] == pytest.approx(np.linspace(0.0, 3.0, 9))
    assert other[..., 0].mean() == pytest.approx(5.0)
    assert mesh.normals[0] == pytest.approx([0.0, 0.0, 1.0], abs=1e-6)
    assert mesh.normals[8] == pytest.approx([0.5**0.5, 0.0, 0.5**0.5], abs=1e-6)
    assert mesh.normals[17] == pytest.approx([1.0, 0.0, 0.0], abs=1e-6)
    a, b, c = (mesh.vertices[mesh.triangles[:, k]] for k in range(3))
    facing = (np.cross(b - a, c - a) * mesh.normals[mesh.triangles[:, 0]]).sum(axis=1)
    assert (facing > 0.0).all()
    assert mesh.uvs[:, :, 0].min() == 0.0 and mesh.uvs[:, :, 0].max() == 1.0


def test_pbrt_curves_in_objects_and_in_motion(tmp_path: Path) -> None:
    curve = f'Shape "curve" "point3 P" [{POINTS}] "float width" 0.1\n'
    twice = 'Translate 0 2 0\nObjectInstance "tuft"\nTranslate 1 0 0\nObjectInstance "tuft"\n'
    world = f'ObjectBegin "tuft"\n{curve}{curve}ObjectEnd\n{twice}'
    scene = pbrt(tmp_path, world)
    assert [data.counts.tolist() for _, data in strands(scene)] == [[4, 4]] * 2
    assert not scene.notes
    times = "TransformTimes 0 1\nActiveTransform EndTime\nTranslate {} 0 0\nActiveTransform All\n"
    both = "".join(f"AttributeBegin\n{times.format(by)}{curve}{curve}AttributeEnd\n" for by in (1, 2))
    # Also if all are in one line of the file
    for text in (both, both.replace("\n", " ")):
        moving = pbrt(tmp_path, text)
        assert [data.counts.tolist() for _, data in strands(moving)] == [[4, 4]] * 2
        ways = {(shape.motion[-1].matrix or [[0.0]])[0][-1] for shape, _ in strands(moving) if shape.motion}
        assert ways == {1.0, 2.0}
    (note,) = pbrt(tmp_path, f'ObjectBegin "tuft"\n{times.format(1)}{curve}ObjectEnd\nObjectInstance "tuft"').notes
    assert "inside of objects do not move" in note


def test_pbrt_curves_of_glass_are_left_out(tmp_path: Path) -> None:
    curve = f'Shape "curve" "point3 P" [{POINTS}] "float width" 0.1\nShape "sphere"\n'
    parts = 'MakeNamedMaterial "glass" "string type" "dielectric"\nMakeNamedMaterial "red" "string type" "diffuse"\n'
    mixed = 'Material "mix" "string materials" ["red" "glass"] "float amount" 0.5\n'
    for world in (f'Material "dielectric"\n{curve}', f"{parts}{mixed}{curve}"):
        scene = pbrt(tmp_path, world)
        assert not strands(scene) and any("curves of what has an inside" in note for note in scene.notes)


def test_pbrt_hair(tmp_path: Path) -> None:
    curve = f'Shape "curve" "point3 P" [{POINTS}] "float width" 0.1'
    plain = hair_of(pbrt(tmp_path, f'Material "hair"\n{curve}'))
    assert plain == Hair(type="hair") and plain.absorption_of == pytest.approx((0.5447, 0.9061, 1.781))
    words = '"float eumelanin" 0.3 "float pheomelanin" 0.5 "float beta_m" 0.2 "float beta_n" 0.4 '
    words += '"float alpha" 3 "float eta" 1.6'
    made = hair_of(pbrt(tmp_path, f'Material "hair" {words}\n{curve}'))
    assert made == Hair(
        type="hair", eumelanin=0.3, pheomelanin=0.5, roughness=0.2, azimuthal_roughness=0.4, tilt_degrees=3.0, ior=1.6
    )
    assert hair_of(pbrt(tmp_path, f'Material "hair" "rgb sigma_a" [1 2 3]\n{curve}')).absorption_of == (1.0, 2.0, 3.0)
    colored = hair_of(pbrt(tmp_path, f'Material "hair" "rgb reflectance" [0.1 0.2 0.3]\n{curve}'))
    assert colored.reflectance == pytest.approx((0.1, 0.2, 0.3))


@for_each(
    "words, note",
    [
        ('"texture beta_m" "t"', 'a texture as "beta_m" is left out: 0.3 in its place'),
        ('"texture eumelanin" "t"', 'a texture as "eumelanin" is left out'),
        ('"float alpha" 45', '"alpha" is 45, but must be from -20 to 20'),
        ('"float eta" 9', '"eta" is 9, but must be from 1.05 to 3'),
        ('"rgb sigma_a" [2000 1 1]', '"sigma_a" is 2000'),
    ],
)
def test_what_pbrt_hair_cannot_be_here_is_told(tmp_path: Path, words: str, note: str) -> None:
    texture = 'Texture "t" "float" "checkerboard" "float tex1" 0.1 "float tex2" 0.4\n'
    curve = f'Shape "curve" "point3 P" [{POINTS}] "float width" 0.1'
    scene = pbrt(tmp_path, f'{texture}Material "hair" {words}\n{curve}')
    assert any(note in each for each in scene.notes) and hair_of(scene)


def test_what_mitsuba_hair_cannot_be_here_is_told(tmp_path: Path) -> None:
    (tmp_path / "c.txt").write_text(TEXT)
    words = '<float name="scale_tilt" value="50"/><texture name="eumelanin" type="checkerboard"/>'
    notes = mitsuba(tmp_path, SHAPE.format("linearcurve", f'<bsdf type="hair">{words}</bsdf>')).notes
    assert any('"scale_tilt" is 50' in each for each in notes)
    assert any('a texture as "eumelanin" of hair' in each for each in notes)


TEXT = "0 0 0 0.1\n0 1 0 0.1\n0 2 0 0.05\n0 3 0 0.05\n\n1 0 0 0.1\n1 1 0 0.1\n1 2 0 0.1\n1 3 0 0.1\n"
SHAPE = '<shape type="{}"><string name="filename" value="c.txt"/>{}</shape>'


def test_mitsuba_curves(tmp_path: Path) -> None:
    (tmp_path / "c.txt").write_text(TEXT)
    scaled = '<transform name="to_world"><scale value="2"/></transform>'
    hair = '<bsdf type="hair"><float name="eumelanin" value="0.2"/><float name="scale_tilt" value="3"/></bsdf>'
    scene = mitsuba(tmp_path, SHAPE.format("bsplinecurve", scaled) + SHAPE.format("linearcurve", hair))
    assert not scene.notes
    (first, data), (second, its) = strands(scene)
    assert first.basis == "bspline" and second.basis == "linear"
    assert data.points[3].tolist() == [0.0, 6.0, 0.0] and its.points[3].tolist() == [0.0, 3.0, 0.0]
    assert data.radii.tolist() == its.radii.tolist() and data.radii[0] == 0.1, "their own transform scales no radius"
    assert hair_of(scene) == Hair(
        type="hair", eumelanin=0.2, tilt_degrees=3.0, roughness=0.3, azimuthal_roughness=0.3, ior=hair_of(scene).ior
    )
    assert hair_of(scene).ior == pytest.approx(1.55, abs=1e-3)


def test_mitsuba_curves_of_what_they_cannot_follow(tmp_path: Path) -> None:
    (tmp_path / "c.txt").write_text(TEXT)
    Image.fromarray(np.full((2, 2, 3), 128, np.uint8)).save(tmp_path / "b.png")
    bumps = '<texture type="bitmap"><string name="filename" value="b.png"/></texture>'
    (note,) = mitsuba(
        tmp_path, SHAPE.format("linearcurve", f'<bsdf type="bumpmap">{bumps}<bsdf type="hair"/></bsdf>')
    ).notes
    assert "of hair are left out" in note
    keys = '<transform time="0"><scale x="2"/></transform><transform time="1"><scale x="3"/></transform>'
    scene = mitsuba(tmp_path, SHAPE.format("bsplinecurve", f'<animation name="to_world">{keys}</animation>'))
    ((shape, _),) = strands(scene)
    assert not shape.motion and any("stretches a sphere, disk or curve" in note for note in scene.notes)


def test_mitsuba_instances_scale_radii(tmp_path: Path) -> None:
    (tmp_path / "c.txt").write_text(TEXT)
    group = f'<shape type="shapegroup" id="g">{SHAPE.format("bsplinecurve", "")}</shape>'
    instance = '<shape type="instance"><ref id="g"/><transform name="to_world"><scale {}/></transform></shape>'
    scene = mitsuba(tmp_path, group + instance.format('value="2"'))
    ((shape, data),) = strands(scene)
    assert data.radii[0] == 0.1 and shape.transform.is_similarity() and not scene.notes
    uneven = mitsuba(tmp_path, group + instance.format('x="1" y="8" z="1"'))
    ((_, data),) = strands(uneven)
    assert data.radii[0] == pytest.approx(0.2) and "keep round cross sections" in " ".join(uneven.notes)


def test_pbrt_instances_stretch_curves(tmp_path: Path) -> None:
    """One copy of the strands for each transform; radii grow by its mean scale."""
    curve = f'Shape "curve" "point3 P" [{POINTS}] "float width" 0.1\n'
    instances = "".join(
        f'AttributeBegin\n{where}\nObjectInstance "a"\nAttributeEnd\n'
        for where in ("Scale 1 8 1", "Scale 1 8 1", "Scale 2 2 2", "Scale 8 1 -1")
    )
    scene = pbrt(tmp_path, f'ObjectBegin "a"\n{curve}ObjectEnd\n{instances}')
    (note,) = scene.notes
    assert "keep round cross sections" in note
    same, equal, even, mirrored = strands(scene)
    assert same[0].file == equal[0].file and len({shape.file for shape, _ in strands(scene)}) == 3
    for (shape, data), scale in ((same, [1, 8, 1]), (mirrored, [8, 1, -1])):
        assert shape.transform.is_similarity() and data.radii == pytest.approx(np.full(4, 0.1))
        assert data.points == pytest.approx(np.reshape(list(map(float, POINTS.split())), (4, 3)) * scale)
    assert even[1].radii == pytest.approx(np.full(4, 0.05))


@for_each("kind", ["cylinder", "flat", "ribbon"])
def test_pbrt_curves_that_are_made_flat_are_left_out(tmp_path: Path, kind: str) -> None:
    facing = '"normal N" [0 0 1  0 0 1]' if kind == "ribbon" else ""
    curve = f'Shape "curve" "string type" "{kind}" "point3 P" [{POINTS}] "float width" 0.1 {facing}'
    (note,) = pbrt(tmp_path, f'Shape "sphere"\nScale 0 1 1\n{curve}').notes
    assert note.endswith("line 7: the curve's transform cannot be inverted; give it another: left out")


OLD = '<scene version="0.6.0"><sensor type="perspective"/><emitter type="constant"/>{}</scene>'
OLD_HAIR = """<shape type="hair"><string name="filename" value="a.hair"/><float name="radius" value="0.02"/>
    <float name="angleThreshold" value="2"/>{}</shape>"""
STRANDS = ([[0, 0, 0], [0, 1, 0], [0, 2, 0.5]], [[9, 9, 9]], [[1, 0, 0], [1, 1.5, 0]])


def hair_text(*strands: Any) -> bytes:
    return "# two\n{}".format("\n\n".join("\n".join(" ".join(map(str, p)) for p in each) for each in strands)).encode()


def hair_bytes(*strands: Any, begin: float = np.inf) -> bytes:
    numbers = [number for each in strands for number in [begin, *np.ravel(each).tolist()]]
    return b"BINARY_HAIR" + struct.pack(f"<I{len(numbers) - 1}f", sum(map(len, strands)), *numbers[1:])


@pytest.mark.parametrize("written", [hair_text, hair_bytes])
def test_hair_of_mitsuba_06(tmp_path: Path, written: Any) -> None:
    """Its transform scales the radius; a strand of a single point has nothing to see."""
    (tmp_path / "a.hair").write_bytes(written(*STRANDS))
    scaled = '<transform name="toWorld"><scale value="3"/></transform><bsdf type="diffuse"/>'
    (tmp_path / "a.xml").write_text(OLD.format(OLD_HAIR.format(scaled)))
    scene = clrender.load(tmp_path / "a.xml")
    assert not scene.notes
    ((shape, data),) = strands(scene)
    assert shape.basis == "linear" and shape.profile == "round"
    assert data.counts.tolist() == [3, 2] and data.radii == pytest.approx(np.full(5, 0.06))
    assert data.points.tolist() == [[0, 0, 0], [0, 3, 0], [0, 6, 1.5], [3, 0, 0], [3, 4.5, 0]]


def test_hair_of_mitsuba_06_says_what_is_left_out(tmp_path: Path) -> None:
    (tmp_path / "a.hair").write_bytes(hair_text(*STRANDS))
    (tmp_path / "a.xml").write_text(OLD.format(OLD_HAIR.format('<float name="reduction" value="0.5"/>')))
    (note,) = clrender.load(tmp_path / "a.xml").notes
    assert '"reduction" of hair is left out' in note
    (tmp_path / "a.xml").write_text(OLD.format(OLD_HAIR.format("").replace("0.02", "-0.02")))
    with pytest.raises(SceneError, match=re.escape('the "radius" of the shape of type "hair" is -0.02')):
        clrender.load(tmp_path / "a.xml")


@for_each(
    "data, said",
    [
        (b"0 0 0\n0 1\n", "line 2 does not begin with the three numbers"),
        (b"0 0 0\n0 1 x 2\n", "line 2 does not begin with the three numbers"),
        (b"0 0 0\n0 nan 0\n", "has nan in point 1"),
        (b"", "has no control points"),
        (b"0 0 0\n\n1 1 1\n", "has no control points"),
        (b"BINARY_HAIR\1\0", "ends too early"),
        (hair_bytes(*STRANDS)[:-1], "ends too early"),
        (hair_bytes([[0.0, 0.0, np.inf]], [[1.0, 2.0, 3.0]]), "a strand begins within a point"),
        (b"BINARY_HAIR\xff\xff\xff\xff", "has more than"),
    ],
)
def test_damaged_hair_of_mitsuba_06(tmp_path: Path, data: bytes, said: str) -> None:
    (tmp_path / "a.hair").write_bytes(data)
    with pytest.raises(SceneError, match=re.escape(said)) as info:
        read_mitsuba_hair("a.hair", tmp_path, (), "here")
    assert 'here: "a.hair"' in str(info.value)
    (tmp_path / "a.xml").write_text(OLD.format(OLD_HAIR.format("") + '<shape type="sphere"/>'))
    assert any(said in note for note in clrender.load(tmp_path / "a.xml").notes)


@for_each(
    "text, said",
    [
        ("0 0 0 0.1\n0 1\n", "line 2 has 2 numbers"),
        ("0 0 0\n0 1 0\n0 2 0\n0 3 0\n", "has no radii"),
        ("", "no control"),
    ],
)
def test_damaged_mitsuba_curves_are_left_out_or_refused(tmp_path: Path, text: str, said: str) -> None:
    (tmp_path / "c.txt").write_text(text)
    try:
        scene = mitsuba(tmp_path, SHAPE.format("bsplinecurve", "") + '<shape type="sphere"/>')
    except SceneError as error:
        assert said in str(error)
    else:
        assert said in " ".join(scene.notes)


def test_hair_goes_to_mitsuba_and_back(tmp_path: Path) -> None:
    material = {"type": "hair", "reflectance": [0.6, 0.3, 0.1], "roughness": 0.2, "tilt_degrees": 3.0, "ior": 1.5}
    camera = {"position": [0.0, 0.0, 5.0], "target": [0.0, 0.0, 0.0]}
    shape = {"type": "curves", "points": [[0.0, y, 0.0] for y in range(5)], "radius": [0.2, 0.1], "material": "hair"}
    scene = clrender.Scene(camera=camera, shapes=[shape], materials={"hair": material})
    export = exported_to_mitsuba(scene, "files")
    for name, write in export.files.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        with (tmp_path / name).open("wb") as file:
            write(file)
    (tmp_path / "a.xml").write_bytes(export.text)
    again = clrender.load(tmp_path / "a.xml")
    ((_, data),) = strands(again)
    assert data.points == pytest.approx(np.array(shape["points"])) and data.radii[0] == 0.2 and data.radii[4] == 0.1
    own, read = scene.materials["hair"], hair_of(again)
    assert isinstance(own, Hair)
    assert read.absorption_of == pytest.approx(hair_absorption(own))
    assert (read.roughness, read.tilt_degrees, read.ior) == pytest.approx((0.2, 3.0, 1.5))


def test_colors_and_absorption_stand_for_each_other() -> None:
    for color in ((0.9, 0.5, 0.05), (1.0, 1.0, 1.0), (0.3, 0.3, 0.3)):
        given = Hair(type="hair", reflectance=color, azimuthal_roughness=0.6)
        again = Hair(type="hair", absorption_coefficient=hair_absorption(given), azimuthal_roughness=0.6)
        assert hair_color(again) == pytest.approx(color, rel=1e-12)
    numbers = hair_numbers(Hair(type="hair", tilt_degrees=30.0 / 2))
    assert numbers.tilt == pytest.approx((np.sin(np.pi / 12.0), np.cos(np.pi / 12.0)))
    assert numbers.variance == pytest.approx((0.726 * 0.3 + 0.812 * 0.09 + 3.7 * 0.3**20) ** 2)
    assert hair_numbers(Hair(type="hair", roughness=0.0, azimuthal_roughness=0.0)).variance > 0.0


@for_each(
    "keys, text",
    [
        ({"reflectance": [0.5] * 3, "absorption_coefficient": [1.0] * 3}, "given beside reflectance"),
        ({"reflectance": [0.5] * 3, "eumelanin": 1.0}, "given beside reflectance"),
        ({"absorption_coefficient": [1.0] * 3, "pheomelanin": 1.0}, "given beside absorption_coefficient"),
        ({"tilt_degrees": 45.0}, "tilt_degrees"),
        ({"ior": 1.0}, "ior"),
    ],
)
def test_hair_has_one_color(keys: dict[str, Any], text: str) -> None:
    with pytest.raises(SceneError, match=text):
        Hair(type="hair", **keys)
