"""What is wrong in files of Mitsuba and pbrt is answered with one sentence that names the line."""

from __future__ import annotations

import re
import time
from pathlib import Path

import peer_scenes
import pytest
from cases import for_each

from clrender.errors import SceneError
from clrender.importers import load
from clrender.scene.shapes import Mesh

BALL = '<shape type="sphere"><bsdf type="diffuse"/></shape>'


def refusal(path: Path, text: str | bytes) -> str:
    """The sentence that a file is refused with."""
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    start = time.process_time()
    with pytest.raises(SceneError) as caught:
        load(path)
    message = str(caught.value)
    assert time.process_time() - start < 5.0
    assert "\n" not in message and message.isascii() and path.name in message and len(message) < 600
    return message


@for_each(
    ("inside", "line", "words"),
    [
        ("<shape", 3, "is no sound XML"),
        ('<shape type="sphere">\n</shap>', 3, "is no sound XML (mismatched tag)"),
        ("\n\nwords", 4, 'has the text "words" between elements'),
        ("<shape/>", 2, '<shape> has no "type"'),
        ('<float name="x" value="1,5"/>', 2, '"1,5" is no finite number'),
        ('<float name="x" value="nan"/>', 2, '"nan" is no finite number'),
        ('<float name="x" value="1e999"/>', 2, '"1e999" is no finite number'),
        ('<integer name="x" value="1.5"/>', 2, "must be a whole number"),
        ('<boolean name="x" value="yes"/>', 2, "must be true or false"),
        ('<float name="x" value="$y"/>', 2, "the parameter $y has no value"),
        ('<rgb name="x" value="1 2"/>', 2, 'holds 2 numbers, but must hold 1 or 3'),
        ('<spectrum name="x" value="500:1, 400:2"/>', 2, "do not grow"),
        ('<spectrum name="x" value="500:1:2"/>', 2, "is no spectrum"),
        ('<transform name="x"><turn/></transform>', 2, "is no step of a transform"),
        ('<transform name="x"><rotate angle="5"/></transform>', 2, "has no direction"),
        ('<transform name="x"><matrix value="1 2 3"/></transform>', 2, "must hold 9 or 16"),
        ('<transform name="x"><lookat origin="1 1 1" target="1 1 1"/></transform>', 2, "looks at its own place"),
        ('<bsdff type="diffuse"/>', 2, 'did you mean "bsdf"?'),
        ('<shape type="sphere">\n<ref id="gold"/></shape>\n<bsdf type="diffuse" id="bold"/>', 3, 'mean "bold"?'),
        ('<shape type="sphere"><bsdf type="diffuse"><string name="reflectance" value="x"/></bsdf></shape>', 2, "<str"),
        ('<shape type="sphere"><bsdf type="dielectric"><string name="int_ior" value="ayr"/></bsdf></shape>', 2, "air"),
        ('<shape type="sphere"><bsdf type="conductor"><string name="material" value="Zz"/></bsdf></shape>', 2, "metal"),
        ('<shape type="sphere"><bsdf type="twosided"/></shape>', 2, "has 0 BSDFs inside"),
        ('<bsdf type="twosided" id="a"><ref id="a"/></bsdf>\n<shape type="ply"><ref id="a"/></shape>', 2, "themselves"),
        ('<shape type="shapegroup" id="a"><shape type="instance"><ref id="a"/></shape></shape>\n\
<shape type="instance"><ref id="a"/></shape>', 2, "contain themselves"),
        ('<texture type="scale" id="a"><ref id="a"/></texture>\n<shape type="sphere"><bsdf type="diffuse">\
<ref name="reflectance" id="a"/></bsdf></shape>', 2, "contains itself"),
        ('<shape type="ply"/>', 2, 'has no "filename"'),
        ('<shape type="serialized"/>', 2, 'has no "filename"'),
        ('<shape type="ply"><string name="filename" value="none.ply"/></shape>', 2, "none.ply"),
        ('<shape type="ply"><string name="filename" value="../x.ply"/></shape>', 2, "outside the scene's own folder"),
        ('<shape type="ply"><string name="filename" value="http://x/x.ply"/></shape>', 2, "nothing is fetched"),
        ('<include filename="/etc/hostname"/>', 2, "outside the scene's own folder"),
        ('<include filename="scene.xml"/>', 2, "more than 8 deep"),
        ('<shape type="sphere"><transform name="to_world"><scale x="0"/></transform></shape>', 2, "no affine one"),
        ('<shape type="sphere"><float name="radius" value="-1"/></shape>', 2, "must be above 0"),
        ('<sensor type="perspective"><float name="fov" value="180"/></sensor>', 2, "below 180"),
        ('<sensor type="perspective"><string name="fov_axis" value="z"/></sensor>', 2, "fov_axis"),
        ('<sensor type="perspective"><film type="f"><integer name="width" value="0"/></film></sensor>', 2, "65536"),
        ('<emitter type="constant"/>\n<emitter type="constant"/>', 3, "second environment"),
        ("<a>" * 80 + "</a>" * 80, 2, "nested more than 32 deep"),
    ],
)  # fmt: skip
def test_faults_of_mitsubas_files(tmp_path: Path, inside: str, line: int, words: str) -> None:
    message = refusal(tmp_path / "scene.xml", f'<scene version="3.0.0">\n{inside}\n</scene>')
    assert f"line {line}: " in message and words in message, message


ENTITIES = """<?xml version="1.0"?>
<!DOCTYPE scene [<!ENTITY a "aaaaaaaaaa"><!ENTITY b "&a;&a;&a;&a;&a;&a;&a;&a;&a;&a;">
<!ENTITY x SYSTEM "file:///etc/hostname">]>
<scene version="3.0.0"><string name="x" value="&b;"/></scene>"""


@for_each(
    ("text", "words"),
    [
        (ENTITIES, "line 2: has a document type or entities"),
        ('<scene version="3.0.0"><string name="x" value="&x;"/></scene>', "undefined entity"),
        ('<!DOCTYPE scene>\n<scene version="3.0.0"/>', "line 1: has a document type"),
        ("<World/>", "line 1: begins with <World>"),
        ('<scene version="new"/>', 'line 1: the version is "new"'),
        (b"\xff\xfe\x00", "is no sound XML"),
        (b"", "is no sound XML"),
        (b'<?xml version="1.0" encoding="utf-77"?><scene version="3.0.0"/>', "line 1"),
        (b"<scene version='3.0.0'>\xe9</scene>", "is no sound XML"),
    ],
)
def test_faults_of_xml(tmp_path: Path, text: str | bytes, words: str) -> None:
    assert words in refusal(tmp_path / "scene.xml", text)


def test_parameters_do_not_expand_without_end(tmp_path: Path) -> None:
    steps = ['<default name="p0" value="aaaaaaaaaa"/>']
    steps += [f'<default name="p{i + 1}" value="{f"$p{i}" * 10}"/>' for i in range(9)]
    message = refusal(tmp_path / "scene.xml", f'<scene version="3.0.0">{"".join(steps)}</scene>')
    assert "become too long" in message


@for_each(
    ("world", "line", "words"),
    [
        ("Shpae", 3, 'did you mean "Shape"?'),
        ('Shape "sphere" "float radius', 3, "a text in quotes has no end"),
        ('Shape "sphere"\n"float radius" [1', 4, "a list has no end"),
        ('Shape "sphere" "float radius" [1 [2] ]', 3, "a list"),
        ('Shape "sphere" "float radius"', 3, "the file ends"),
        ('Shape "sphere" "float radius" x', 3, '"x" is no finite number'),
        ('Shape "sphere" "float radius" [ "1" ]', 3, "must have numbers"),
        ('Shape "sphere" "float radius" 0', 3, "must be above 0"),
        ('Shape "sphere" "float radius" [1 2]', 3, "has 2 numbers, but must have one"),
        ('Shape "sphere" "flaot radius" 1', 3, "is no type and name of a parameter"),
        ('Shape "trianglemesh"', 3, 'has no points "P"'),
        ('Shape "trianglemesh" "point3 P" [0 0 0 1]', 3, "no multiple of 3"),
        ('Shape "trianglemesh" "point3 P" [0 0 0 1 0 0 0 1 0]\n"integer indices" [0 1 3]', 4, "from 0 to 2"),
        ('Shape "trianglemesh" "point3 P" [0 0 0 1 0 0 0 1 0] "integer indices" [0 1 1.5]', 3, "whole numbers"),
        ('Shape "trianglemesh" "point3 P" [0 0 0 1 0 0 0 1 0] "normal N" [0 0 1]', 3, "3 points, but 1"),
        ('Shape "trianglemesh" "point3 P" [0 0 0 1 0 0 0 1 0] "point2 uv" [0 0 1 1 1e9 0]', 3, "larger than 1e+06"),
        ('Shape "plymesh" "string filename" "../x.ply"', 3, "outside the scene's own folder"),
        ('Material "diffuse" "texture reflectance" "none"', 3, "is not defined"),
        ('Material "diffuse" "rgb reflectance" [1 2]', 3, "must have three numbers"),
        ('Material "conductor" "spectrum eta" "metal-Xx-eta"', 3, "is not known"),
        ('Material "diffuse" "spectrum reflectance" [500 1 400 2]', 3, "do not grow"),
        ('Material "mix" "string materials" ["a"]', 3, "must have two"),
        ('NamedMaterial "gold"', 3, "is not defined"),
        ("AttributeEnd", 3, "did not begin"),
        ("AttributeBegin " * 80, 3, "nested more than 64 deep"),
        ("ObjectEnd", 3, "did not begin"),
        ('ObjectInstance "x"', 3, "is not defined"),
        ("WorldBegin", 3, "a second time"),
        ("Scale 1 1", 3, "has 2 numbers, but must have 3"),
        ("Rotate 5 0 0 0", 3, "has no direction"),
        ("Transform [1 2 3]", 3, "has 3 numbers, but must have 16"),
        ('CoordSysTransform "x"', 3, "is not defined"),
        ('Include "scene.pbrt"', 2, "WorldBegin stands here a second time"),
        ('Include "/etc/hostname"', 3, "outside the scene's own folder"),
        ('LightSource "infinite" LightSource "infinite"', 3, "second infinite light"),
        ('LightSource "point" "blackbody I" [0]', 3, "kelvin"),
        ('LightSource "spot" "float coneangle" 200', 3, "below 180"),
        ("Shape", 3, "in quotes"),
        ('"sphere"', 2, "WorldBegin takes nothing"),
        ("] Shape", 3, "where the name of a directive should"),
    ],
)
def test_faults_of_pbrts_files(tmp_path: Path, world: str, line: int, words: str) -> None:
    message = refusal(tmp_path / "scene.pbrt", f'Camera "perspective"\nWorldBegin\n{world}\n')
    assert f"line {line}: " in message and words in message, message


@for_each(
    ("numbers", "words"),
    [
        ("400 0.5 500 nan", '"s.spd" has a number that is not finite'),
        ("400 inf 500 1", '"s.spd" has a number that is not finite'),
        ("400 0.5 500 x", '"s.spd" holds other things'),
    ],
)
def test_files_of_spectra_are_refused(tmp_path: Path, numbers: str, words: str) -> None:
    (tmp_path / "s.spd").write_text(numbers)
    world = 'Material "diffuse" "spectrum reflectance" "s.spd"\nShape "sphere"\n'
    assert words in refusal(tmp_path / "scene.pbrt", f'Camera "perspective"\nWorldBegin\n{world}')


def test_a_fault_in_an_included_file_names_it(tmp_path: Path) -> None:
    (tmp_path / "part.xml").write_text('<scene version="3.0.0">\n<ball/></scene>', encoding="utf-8")
    message = refusal(tmp_path / "scene.xml", '<scene version="3.0.0"><include filename="part.xml"/></scene>')
    assert "scene.xml: part.xml: line 2: <ball>" in message
    (tmp_path / "part.pbrt").write_text("\n\nBall", encoding="utf-8")
    assert "scene.pbrt: part.pbrt: line 3: " in refusal(tmp_path / "scene.pbrt", 'WorldBegin Include "part.pbrt"')


def test_lines_are_counted_through_lists_and_comments(tmp_path: Path) -> None:
    text = 'WorldBegin # one\n# two\nShape "trianglemesh" "point3 P" [ 0 0 0\n1 0 0 # four\n0 1 0 ]\n\nShape "sphere" x'
    assert re.search(r"line 7: ", refusal(tmp_path / "scene.pbrt", text))
    assert re.search(r"line 7: ", refusal(tmp_path / "scene.pbrt", text.replace(" # four", "")))


def test_what_the_scene_names_may_be_allowed(tmp_path: Path) -> None:
    inner, outer = tmp_path / "inner", tmp_path / "outer"
    inner.mkdir()
    outer.mkdir()
    peer_scenes.write_parts(outer)
    (inner / "a.xml").write_text(
        '<scene version="3.0.0"><shape type="ply"><string name="filename" value="../outer/part.ply"/></shape></scene>'
    )
    with pytest.raises(SceneError, match="outside"):
        load(inner / "a.xml")
    assert len(load(inner / "a.xml", allow_paths=[outer]).shapes) == 1


def test_folders_of_path_are_searched(tmp_path: Path) -> None:
    """The last one first, then beside the scene file; folders elsewhere have to be allowed."""
    places = [tmp_path / "scene" / name for name in (".", "inside/meshes")] + [tmp_path / "outside"]
    for number, place in enumerate(places):
        place.mkdir(parents=True, exist_ok=True)
        (place / f"{number}.obj").write_text(f"v 0 0 0\nv {number + 1} 0 0\nv 0 1 0\nf 1 2 3\n")
    (places[1] / "0.obj").write_text("v 0 0 0\nv 7 0 0\nv 0 1 0\nf 1 2 3\n")
    text = '<scene version="3.0.0"><path value="inside/meshes"/><path value="../outside"/>'
    for number in range(3):
        text += f'<shape type="obj"><string name="filename" value="{number}.obj"/></shape>'
    path = places[0] / "scene.xml"
    path.write_text(f"{text}</scene>")
    with pytest.raises(SceneError, match=r"2\.obj.*outside the scene's own folder.*--allow-path"):
        load(path)
    scene = load(path, allow_paths=[places[2]])
    widths = [
        float(scene.mesh_of(at, shape).vertices[:, 0].max())
        for at, shape in scene.all_shapes()
        if isinstance(shape, Mesh)
    ]
    assert widths == [7.0, 2.0, 3.0]


def test_parameters_are_set_from_outside(tmp_path: Path) -> None:
    """Before the file's own defaults; what is not used is told, and `verify` finds them in the film's origin."""
    path = tmp_path / "scene.xml"
    ball = '<shape type="sphere"><float name="radius" value="$r"/></shape>'
    path.write_text(f'<scene version="3.0.0"><default name="r" value="1"/>{ball}</scene>')
    scene = load(path, define={"r": "2.5", "other": "1"})
    assert scene.shapes[0].radius == 2.5 and load(path).shapes[0].radius == 1.0  # type: ignore[union-attr]
    assert any("$other is defined, but the scene does not use it" in note for note in scene.notes)
    with pytest.raises(SceneError, match=r"takes no define, which is for \.xml"):
        load("room", define={"r": "1"})
