"""Plugins without a device: headers, the rules of their code, what scenes may say of them, and what no file can."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from cases import for_each
from doc_blocks import blocks
from plugin_files import EXAMPLES, GRAIN, MINNAERT, PAPER, SHIRLEY, WOOD, edited, example

import clrender
from clrender.device.source import load_source
from clrender.errors import SceneError, UsageError
from clrender.flatten.features import Features
from clrender.flatten.flat_scene import flatten
from clrender.flatten.plugin_rows import parameter_numbers, used_plugins
from clrender.plugins import combined, kernel_files, plugin
from clrender.plugins.code_rules import signatures
from clrender.plugins.program import SLOTS
from clrender.rendering.job import RenderJob
from clrender.scene import Scene
from clrender.scene.description import MATERIAL_TYPES
from clrender.view.edited_scene import EditedScene
from clrender.view.parameters import parameters

CAMERA = {"position": [0.0, 0.0, 4.0], "target": [0.0, 0.0, 0.0]}
BALL = {"type": "sphere", "radius": 1.0, "material": "moon"}
MOON: dict[str, Any] = {"type": "plugin", "plugin": "minnaert"}
HEAD = MINNAERT.split("\n")


def scene(material: dict[str, Any] = MOON, **others: Any) -> Scene:
    return Scene(camera=CAMERA, materials={"moon": material}, shapes=[BALL], **others)


def refused(text: str) -> str:
    with pytest.raises(UsageError) as error:
        plugin(text)
    return str(error.value)


def line_of(text: str, words: str) -> int:
    return next(number for number, line in enumerate(text.split("\n"), 1) if words in line)


# --- what a plugin is ----------------------------------------------------------------------------------------------


def test_the_examples_are_read() -> None:
    moon, gloss, wood = (example(name) for name in ("minnaert", "ashikhmin_shirley", "wood"))
    assert (moon.name, moon.kind, wood.kind) == ("minnaert", "bsdf", "texture")
    assert [(each.name, each.type, each.default) for each in moon.parameters] == [
        ("reflectance", "color", (0.5, 0.5, 0.5)),
        ("k", "number", (1.3,)),
    ]
    assert gloss.header.needs == ("tangents",) and gloss.header.claims == ("reciprocal",)
    assert moon.header.about.startswith("Minnaert's law") and not moon.header.transmits
    assert plugin(PAPER).header.transmits and plugin(GRAIN).header.needs == ("uv",)
    assert len(MINNAERT.split("\n")) <= 41


def test_a_text_is_a_plugin_and_has_the_hash_of_the_file() -> None:
    assert plugin(MINNAERT).sha256 == example("minnaert").sha256 == plugin(str(EXAMPLES / "minnaert.cl")).sha256
    assert plugin(MINNAERT.replace("\n", "\r\n")).sha256 == plugin(MINNAERT).sha256
    assert plugin(MINNAERT + "// more\n").sha256 != plugin(MINNAERT).sha256


@for_each(
    ("old", "new", "at", "words"),
    [
        ('// name = "minnaert"', '// name = "Minnaert"', "name", "small letters"),
        ('// name = "minnaert"', "// title = 1", "title", "unknown key"),
        ('// kind = "bsdf"', '// kind = "lamp"', "kind", "one of bsdf, texture, light"),
        ('// kind = "bsdf"', '// kind = "bsdf', "kind", "no valid TOML"),
        ('claims = ["reciprocal"]', 'claims = ["recipocal"]', "claims", 'did you mean "reciprocal"'),
        ('claims = ["reciprocal"]', 'needs = ["uv"]', "needs", "uv"),
        ('claims = ["reciprocal"]', 'transmits = "no"', "transmits", "true or false"),
        ("default = 1.3", "default = 9.0", "k = {", "must be from 1 to 4"),
        ("default = 1.3", 'default = "a"', "k = {", "must be a number"),
        ("default = 1.3", "defalt = 1.3", "k = {", 'did you mean "default"'),
        ("min = 1.0, max = 4.0", "min = 4.0, max = 1.0", "k = {", "less than max"),
        ('k = { type = "number"', 'k = { type = "float"', "k = {", "number or color"),
        ('k = { type = "number"', 'for = { type = "number"', "for = {", "no name of a parameter"),
        ("default = [0.5, 0.5, 0.5]", "default = [0.5, 0.5]", "reflectance = {", "three numbers"),
        ("// [parameters]", "// [parameter]", "[parameter]", 'did you mean "parameters"'),
    ],
)
def test_faults_of_headers(old: str, new: str, at: str, words: str) -> None:
    text = edited(MINNAERT, (old, new))
    said = refused(text)
    assert said.startswith(f"plugin:{line_of(text, at)}: ") and words in said and said.count("\n") == 0, said


def test_headers_that_are_too_large() -> None:
    many = "\n".join(f'// p{i} = {{ type = "color", default = [0.5, 0.5, 0.5] }}' for i in range(5))
    assert "at most 16" in refused(edited(MINNAERT, ("// [parameters]", f"// [parameters]\n{many}")))
    shares = "\n".join(f'// p{i} = {{ type = "number", default = 0.5 }}' for i in range(len(SLOTS)))
    assert "at most 10" in refused(edited(MINNAERT, ("// [parameters]", f"// [parameters]\n{shares}")))


def test_what_is_no_plugin(tmp_path: Path) -> None:
    assert "this is no plugin" in refused("int a;\nint b;\n")
    assert "this is no plugin" in refused("// a\n// b\n")
    for name, words in (("missing.cl", "missing"), (".", "a folder")):
        with pytest.raises(UsageError, match=words):
            plugin(tmp_path / name)
    (tmp_path / "a.cl").write_bytes(b"// a\n// \xff\n")
    with pytest.raises(UsageError, match=r"a\.cl:2: not UTF-8"):
        plugin(tmp_path / "a.cl")
    with pytest.raises(UsageError, match="must be the name of a file"):
        plugin(3)  # type: ignore[arg-type]


# --- the rules of its code -----------------------------------------------------------------------------------------

LIMB = "const vfloat limb = power(wo.z * wi.z, p->k - 1.0f);"


@for_each(
    ("line", "words"),
    [
        ("const vfloat limb = pow(wo.z, p->k);", "write power(x, y)"),
        ("const vfloat limb = sin(wo.z);", "write cos_sin_turn"),
        ("const vfloat limb = wo.z / wi.z;", "write quotient(a, b)"),
        ("vfloat limb = wo.z; limb /= wi.z;", "write quotient(a, b)"),
        ("const vfloat limb = sqrt(wo.z);", "write root(x)"),
        ("const vfloat limb = native_exp(wo.z);", "no function that a plugin may call"),
        ("const vfloat limb = wo.z * 2.0;", "needs the suffix f"),
        ("const vfloat limb = wo.z * 0x1p-2;", "is a double"),
        ("double limb = 1.0f;", "not possible in a plugin"),
        ("float4 limb = 1.0f;", "a fixed number of lanes"),
        ("const __global float* limb = 0;", "begins with an underscore"),
        ("const global float* limb = 0;", "no memory but its parameters"),
        ("const vfloat limb = splat((float)get_global_id(0));", "no function that a plugin may call"),
        ("const vfloat limb = splat((float)lane_count(wo.z > 0.5f));", "no function that a plugin may call"),
        ("const vfloat limb = splat((float)LANES);", "no constant or type"),
        ("barrier(0);", "no function that a plugin may call"),
        ("while (1) {}", "write `for"),
        ("for (;;) {}", "has to read"),
        ("for (int i = 0; i < 1000000; ++i) {}", "at most 1024"),
        ("for (int i = 0; i < 8; --i) {}", "away from its end"),
        ("for (int i = 0; i < 8; ++i) { i = 0; }", "changed elsewhere"),
        ("for (int i = 0; i < wo.z; ++i) {}", "has to read"),
        ("const vfloat limb = minnaert_eval(p, wo, wi).x;", "calls itself"),
        ("const vfloat limb = lambert_pdf(wi);", '#include "material/lambert.h" has it'),
        ("const vmask m = ~(wo.z > 0.5f);", "write !mask"),
        ("const int m = 3 % 0;", "needs a whole number"),
        ('const vfloat limb = wo.z; asm("nop");', "not possible in a plugin"),
        ("_Pragma(1)", "begins with an underscore"),
        ("const vfloat limb = wo.z; \\", "not possible in a plugin"),
        ("static vfloat limb = 1.0f;", "within a function"),
        ("wo.z = splat(1.0f);", "given by value"),
        ("const long limb = 1;", "not possible in a plugin"),
        ("const vfloat limb = wo.z; // ok\n#pragma OPENCL FP_CONTRACT ON", "no directives but"),
    ],
)
def test_the_rules_of_kernels_apply(line: str, words: str) -> None:
    text = edited(MINNAERT, (LIMB, line))
    said = refused(text)
    place = line_of(text, line.rpartition("\n")[2])
    assert said.startswith(f"plugin:{place}: ") and words in said and said.count("\n") == 0, said


@for_each(
    ("added", "words"),
    [
        ("#include <stdio.h>", "is not possible"),
        ('#include "core/search.h"', "is not possible"),
        ('#include "../../secrets.h"', "is not possible"),
        ("#define PI 3.0f", "has to begin with MINNAERT_"),
        ("#define minnaert_eval lambert_eval", "has to begin with MINNAERT_"),
        ("#define MINNAERT_SINE sin", "is no constant"),
        ("#define MINNAERT_F(x) x", "a name and arithmetic of numbers"),
        ("#define MINNAERT_END } static int other;", "a name and arithmetic of numbers"),
        ("#undef PI", "no directives but"),
        ("#ifdef LANES", "no directives but"),
        ("vfloat other;", "outside of functions"),
        ("__kernel void minnaert_run(float a) {}", "this is no function"),
        ("static vfloat other(vfloat x) { return x; }", "has to be called minnaert_"),
        ("static vfloat minnaert_pdf(vfloat x) { return x; }", "is there already"),
        ("static half minnaert_more(vfloat x) { return x; }", "it has to return one of"),
        ("static vec3 minnaert_albedo2(vec3 x) {", "has no end"),
        ("%:define PI 3.0f", "not possible in a plugin"),
    ],
)
def test_nothing_reaches_beyond_a_plugin(added: str, words: str) -> None:
    text = MINNAERT + added + "\n"
    said = refused(text)
    assert said.startswith(f"plugin:{line_of(text, added)}: ") and words in said, said


@for_each(
    "hidden",
    [
        "/* *\\\n/ int other; /* */",
        "// a comment \r int other;",
        "// a comment \u2028 int other;",
        "// a comment \x0c int other;",
        "/* *??/\n/ int other; /* */",
        "// a comment that goes on \\  ",
        "// zero \x00",
    ],
)
def test_no_code_is_hidden_from_the_rules(hidden: str) -> None:
    said = refused(f"{MINNAERT}{hidden}\n")
    assert said.startswith(f"plugin:{MINNAERT.count(chr(10)) + 1}: ") and "not even in comments" in said


def test_functions_that_are_missing_or_others() -> None:
    without = MINNAERT[: MINNAERT.index("// A direction of light")]
    assert "has no function `static vec3 minnaert_sample(" in refused(without)
    other = edited(MINNAERT, ("vec3 wo, vfloat u, vfloat v, vfloat w)", "vec3 wo, vfloat u, vfloat v)"))
    assert (
        "has to be `static vec3 minnaert_sample(const MinnaertParameters*, vec3, vfloat, vfloat, vfloat)`"
        in refused(other)
    )
    assert set(signatures(example("wood").header)) == {"value"}


def test_what_the_rules_allow() -> None:
    more = """#define MINNAERT_STEPS 4
#define MINNAERT_THIRD (1.0f / 3.0f)
static vfloat minnaert_more(vec3 wo) {
    vfloat sum = splat(0.0f);
    for (int i = 0; i < MINNAERT_STEPS; ++i) {
        if (!lane_any(wo.z > 0.5f)) continue;
        sum = fma(sum, splat(MINNAERT_THIRD), fresnel_grazing(wo.z) * 0.5f);
    }
    for (int i = 3; i >= 0; i -= 1) sum = sum + splat((float)i);
    return sum * (2.0f / 3.0f);
}
"""
    assert plugin(f'{MINNAERT}#include "material/fresnel.h"\n{more}').name == "minnaert"
    assert "fresnel_grazing" in refused(MINNAERT + more)


@for_each("name", ["lambert", "closure", "plugin", "path", "eon", "sampler", *(set(MATERIAL_TYPES) - {"plugin"})])
def test_a_plugin_is_not_called_like_a_part_of_clrender(name: str) -> None:
    struct = "".join(part.capitalize() for part in name.split("_")) + "Parameters"
    text = MINNAERT.replace("minnaert_", f"{name}_").replace("MinnaertParameters", struct)
    text = text.replace('name = "minnaert"', f'name = "{name}"')
    with pytest.raises(UsageError, match=r"functions of its own|material of clrender's own") as error:
        scene().with_plugins(text)
    assert f"my_{name}" in str(error.value)


def test_names_that_would_be_mistaken_for_each_other() -> None:
    moon = plugin(MINNAERT)
    assert combined([moon], [plugin(MINNAERT)]) == (moon,)
    with pytest.raises(UsageError, match="whose text is another"):
        combined([moon], [plugin(edited(MINNAERT, ("0.5f * INV_PI) * limb", "0.4f * INV_PI) * limb")))])
    longer = MINNAERT.replace("minnaert", "minnaert_b").replace("MinnaertParameters", "MinnaertBParameters")
    with pytest.raises(UsageError, match="the same name"):
        combined([moon], [plugin(longer)])


# --- programs ------------------------------------------------------------------------------------------------------


def test_programs_without_plugins_know_nothing_of_them() -> None:
    """Their text is that of the kernels, whatever plugins are at hand, and so are their keys in caches."""
    plain = {"LANES": 1, **Features(materials=True, textures=True).macros}
    assert not any("plugin" in name.lower() for name in plain)
    at_hand = clrender.load("room").with_plugins([example("minnaert"), example("wood")])
    assert flatten(at_hand, 8, 8).features == flatten(clrender.load("room"), 8, 8).features
    assert RenderJob.of(at_hand).request() == RenderJob.of(clrender.load("room")).request()
    assert flatten(at_hand, 8, 8).arrays_sha256 == flatten(clrender.load("room"), 8, 8).arrays_sha256
    text = load_source("integrator/path.cl", plain).text
    assert "minnaert" not in text and "#define PLUGINS" not in text


def test_programs_with_plugins_have_their_text_and_lines() -> None:
    given = dict(Features(materials=True, plugins=tuple(kernel_files([example("minnaert")]).items())).macros)
    source = load_source("integrator/path.cl", {"LANES": 1, **given})
    assert source.plugins == (str(EXAMPLES / "minnaert.cl"),)
    lines = source.text.split("\n")
    at = next(number for number, line in enumerate(lines, 1) if LIMB in line)
    assert source.place(at) == f"{EXAMPLES / 'minnaert.cl'}:{line_of(MINNAERT, LIMB)}"
    after = next(number for number, line in enumerate(lines, 1) if "plugin_read_1(const" in line)
    text = given["plugin/given.h"]
    assert isinstance(text, str)
    assert source.place(after) == f"plugin/given.h:{line_of(text, 'plugin_read_1(const')}"
    other = load_source("integrator/path.cl", {"LANES": 1, **given, "plugin/given.h": text.replace("limb", "lamb")})
    assert other.sha256 != source.sha256


# --- scenes --------------------------------------------------------------------------------------------------------


def test_parameters_are_numbers_in_the_order_of_the_plugin() -> None:
    made = scene({**MOON, "parameters": {"k": 2.0, "reflectance": [0.1, 0.2, 0.3]}}).with_plugins(MINNAERT)
    material = made.materials["moon"]
    assert parameter_numbers(made, material) == [0.1, 0.2, 0.3, 2.0]  # type: ignore[arg-type]
    assert parameter_numbers(scene().with_plugins(MINNAERT), scene().materials["moon"]) == [0.5, 0.5, 0.5, 1.3]  # type: ignore[arg-type]
    assert [each.name for each in used_plugins(made)] == ["minnaert"]
    flat = flatten(made, 8, 8)
    assert flat.arrays["materials"]["color"][0].tolist()[:3] == pytest.approx([0.1, 0.2, 0.3])


@for_each(
    ("material", "words"),
    [
        ({"plugin": "minart"}, ('materials.moon.plugin names the plugin "minart"', "--plugin FILE", 'mean "minnaert"')),
        ({"plugin": "wood"}, ("which is the plugin of a texture",)),
        ({"parameters": {"K": 1.0}}, ("materials.moon.parameters.K is no parameter", "known here: reflectance, k")),
        ({"parameters": {"k": 9.0}}, ("materials.moon.parameters.k is 9, but must be from 1 to 4",)),
        ({"parameters": {"k": [1.0, 2.0, 3.0]}}, ("is a colour, but must be a number",)),
        ({"parameters": {"reflectance": 0.5}}, ("is a number, but must be a colour of three numbers",)),
        ({"parameters": {"k": {"checker": [0.1, 0.2]}}}, ("is a texture, whose values are from 0 to 1",)),
        ({"parameters": {"reflectance": {"plugin": "minnaert"}}}, ("which is the plugin of a BSDF",)),
        ({"parameters": {"reflectance": {"plugin": "wood", "parameters": {"rings": 0.0}}}}, ("from 0.1 to 1000",)),
        ({"anisotropy_rotation": 30.0}, ("needs no tangents",)),
    ],
)
def test_faults_of_scenes_with_plugins(material: dict[str, Any], words: tuple[str, ...]) -> None:
    made = scene({**MOON, **material}).with_plugins([MINNAERT, WOOD])
    with pytest.raises(SceneError) as error:
        RenderJob.of(made)
    assert all(each in str(error.value) for each in words), error.value
    with pytest.raises(SceneError):
        flatten(made, 8, 8)


def test_a_plugin_that_is_not_given_is_asked_for() -> None:
    with pytest.raises(
        SceneError, match=r'plugin names the plugin "minnaert", which is not given; give its file with --plugin'
    ):
        RenderJob.of(scene())
    for material, place in (
        ({"type": "lambert", "reflectance": {"plugin": "wood"}}, "materials.moon.reflectance.plugin"),
        ({**MOON, "parameters": {"reflectance": {"plugin": "wood"}}}, "materials.moon.parameters.reflectance.plugin"),
    ):
        with pytest.raises(SceneError, match="wood") as error:
            RenderJob.of(scene(material), plugins=MINNAERT)
        assert place in str(error.value)


@for_each("file", ["minnaert.cl", "./minnaert.cl", str(EXAMPLES / "minnaert.cl")])
def test_no_scene_file_can_name_a_file_to_load(file: str, tmp_path: Path) -> None:
    """A plugin is a program: in a scene file there are names of plugins alone, and a path is none."""
    (tmp_path / "minnaert.cl").write_text(MINNAERT)
    content = {"camera": CAMERA, "materials": {"moon": {"type": "plugin", "plugin": file}}, "shapes": [BALL]}
    (tmp_path / "a.json").write_text(json.dumps(content))
    loaded = clrender.load(tmp_path / "a.json")
    assert loaded.plugins == ()
    with pytest.raises(SceneError, match="which is not given"):
        RenderJob.of(loaded)
    for key in ("file", "source", "code", "plugins"):
        (tmp_path / "b.json").write_text(json.dumps({**content, "materials": {"moon": {**MOON, key: file}}}))
        with pytest.raises(SceneError, match=rf"materials\.moon\.{key} is an unknown key"):
            clrender.load(tmp_path / "b.json")
    (tmp_path / "c.json").write_text(json.dumps({**content, "plugins": [file]}))
    with pytest.raises(SceneError, match=r"plugins:? is an unknown key"):
        clrender.load(tmp_path / "c.json")


def test_no_message_can_bring_a_plugin() -> None:
    """Neither that of a view nor that of a cluster."""
    made = scene().with_plugins(MINNAERT)
    edited_scene = EditedScene.of(made, {})
    for key, value in (("plugin", "wood"), ("plugin", str(EXAMPLES / "wood.cl")), ("parameters", {"k": 2.0})):
        with pytest.raises(UsageError, match="cannot be changed here"):
            edited_scene.with_material("moon", {key: value})
    told = {each["name"]: each for each in parameters(made.materials["moon"])}
    assert told["plugin"]["kind"] == "fixed" and told["plugin"]["value"] == "minnaert"
    job = RenderJob.of(made)
    with pytest.raises(UsageError, match="jobs carry no plugins"):
        job.to_json()
    plain = RenderJob.of(
        Scene(camera=CAMERA, materials={"moon": {"type": "lambert", "reflectance": [0.5] * 3}}, shapes=[BALL])
    )
    text, assets = plain.to_json()
    content = json.loads(text)
    content["scene"]["materials"]["moon"] = {"type": "plugin", "plugin": "minnaert"}
    with pytest.raises(SceneError, match="which is not given"):
        RenderJob.from_json(json.dumps(content), assets)
    with pytest.raises(UsageError, match="jobs carry no plugins"):
        clrender.render(made, cluster="local:2")


def test_plugins_are_part_of_the_request() -> None:
    one, other = (
        RenderJob.of(scene(), plugins=text)
        for text in (MINNAERT, edited(MINNAERT, ("0.5f * INV_PI) * limb", "0.4f * INV_PI) * limb")))
    )
    assert one.request()["plugins"] == {"minnaert": plugin(MINNAERT).sha256}
    assert one.request()["scene_sha256"] == other.request()["scene_sha256"] and one.sha256() != other.sha256()
    assert flatten(one.scene, 8, 8).arrays_sha256 != flatten(other.scene, 8, 8).arrays_sha256


def test_plugins_stay_with_a_scene() -> None:
    made = scene().with_plugins(MINNAERT)
    for copy in (
        made.changed({"materials.moon.parameters": {"k": 2.0}}),
        made.with_environment(1.0),
        made.placed("a", Path()),
    ):
        assert [each.name for each in copy.plugins] == ["minnaert"]
    assert made.with_plugins(MINNAERT) is made and made.with_plugins(None) is made
    assert [each.name for each in made.with_plugins([WOOD, SHIRLEY]).plugins] == [
        "ashikhmin_shirley",
        "minnaert",
        "wood",
    ]
    with pytest.raises(UsageError, match="plugins has 3"):
        made.with_plugins([3])


def test_textures_of_plugins_are_for_what_reflects() -> None:
    wood = {"plugin": "wood"}
    for material, at in (
        ({"type": "lambert", "reflectance": [0.5] * 3, "opacity": wood}, "opacity"),
        ({"type": "principled", "emission": wood}, "emission"),
    ):
        with pytest.raises(SceneError, match=f"{at} is the texture of a plugin"):
            scene(material)
    with pytest.raises(SceneError, match="emission is the texture of a plugin"):
        Scene(camera=CAMERA, shapes=[{"type": "sphere", "radius": 1.0, "emission": wood}])
    with pytest.raises(SceneError, match="radiosity"):
        RenderJob.of(scene({"type": "lambert", "reflectance": wood}), plugins=WOOD, integrator="radiosity")
    with pytest.raises(SceneError, match="radiosity"):
        RenderJob.of(scene(), plugins=MINNAERT, integrator="radiosity")


def test_other_programs_get_no_plugins(tmp_path: Path) -> None:
    from clrender.exporters import exported, exported_to_cycles, exported_to_luxcore, exported_to_mitsuba

    for material in (MOON, {"type": "lambert", "reflectance": {"plugin": "wood"}}):
        made = scene(material).with_plugins([MINNAERT, WOOD])
        for export in (exported_to_cycles, exported_to_luxcore, exported_to_mitsuba):
            with pytest.raises(SceneError, match="is made by the plugin"):
                export(made, "files")
        kept = exported(made, "own-files")
        assert "plugin" in json.dumps(kept.description)


def test_the_page_shows_the_files_as_they_are() -> None:
    page = Path(__file__).resolve().parents[2] / "docs" / "write-a-material.md"
    shown = {each.file: each.text for each in blocks(page) if each.file is not None}
    for name in ("minnaert", "ashikhmin_shirley", "wood", "led", "searchlight"):
        assert shown[f"scenes/plugins/{name}.cl"] == (EXAMPLES / f"{name}.cl").read_text()
