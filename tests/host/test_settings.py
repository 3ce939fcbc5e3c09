"""The table of settings: what it allows, wherever a value comes from, and that every user of the table agrees."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from fractions import Fraction
from typing import Any

import click
import jsonschema
import numpy as np
import pytest
from cases import for_each
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from clrender.cli import main
from clrender.cli.render import render as render_command
from clrender.errors import ClrenderError, SceneError, UsageError
from clrender.integrators import INTEGRATORS
from clrender.limits import Bands, Bytes, Choice, Flag, Range, Region
from clrender.scene import Scene
from clrender.scene.load import load
from clrender.settings import (
    IMAGE,
    PIXEL_LIMIT,
    SETTINGS,
    STOP,
    WORK,
    RenderSettings,
    present,
    settings_for,
    settings_of,
)

CAMERA = {"position": [0, 0, 3], "target": [0, 0, 0]}
ROOM = load("room")
PLAIN = Scene.model_validate({"camera": CAMERA})
IN_FILES = [name for name, setting in SETTINGS.items() if setting.section == "render"]
FLAGS = [name for name, setting in SETTINGS.items() if isinstance(setting.domain, Flag)]
ON_THE_COMMAND_LINE = [name for name, setting in SETTINGS.items() if setting.option and name not in FLAGS]
SCHEMA = Scene.model_json_schema()
VALIDATORS = {
    name: jsonschema.Draft202012Validator(SCHEMA["$defs"]["Render" if setting.section == "render" else "Image"])
    for name, setting in SETTINGS.items()
    if setting.section
}

# `derandomize` keeps a run repeatable.
MANY = settings(
    max_examples=1000, deadline=None, derandomize=True, suppress_health_check=list(HealthCheck), database=None
)
SOME = settings(MANY, max_examples=500)

NAMES = sorted({str(m) for s in SETTINGS.values() if isinstance(s.domain, Choice) for m in s.domain.members})
EDGES = [
    0,
    1,
    -1,
    2,
    3,
    4,
    7,
    8,
    15,
    16,
    17,
    4096,
    4097,
    65536,
    65537,
    2**16,
    2**20,
    2**20 + 1,
    2**26,
    2**31,
    2**32,
    10**40,
]
NUMBERS = st.one_of(
    st.sampled_from(EDGES), st.integers(), st.floats(), st.sampled_from([0.0, -0.0, 0.5, 1.0, 8.0, 1e-300, 1e12, 1e300])
)
JUNK = st.one_of(
    NUMBERS,
    st.none(),
    st.booleans(),
    st.sampled_from([*NAMES, "packt", "PATH", "path ", "", "nan", "-1", "\x00", "\udcff", "9" * 5000]),
    st.text(max_size=8),
    st.sampled_from([[], {}, (), [1], {"spp": 1}, (4, 4)]),
)
ODD = st.sampled_from(
    [object(), np.array([1, 2]), np.bool_(True), np.float32(np.nan), Fraction(1, 3), 1j, b"path", int, np.array(4)]
)  # fmt: skip


def allowed(name: str) -> st.SearchStrategy[Any]:
    """Values that a setting takes, half of them NumPy's."""
    domain = SETTINGS[name].domain
    if isinstance(domain, Choice):
        return st.sampled_from([*domain.members, *(np.int64(m) for m in domain.members if isinstance(m, int))])
    if isinstance(domain, Bytes):
        return st.integers(domain.low, domain.high)
    if isinstance(domain, Region):
        return st.tuples(*(st.integers(low, domain.most) for low in (0, 0, 1, 1)))
    if isinstance(domain, Flag):
        return st.booleans()
    if isinstance(domain, Bands):
        return st.tuples(st.integers(0, 3), st.integers(6, 300))
    assert isinstance(domain, Range)
    high = min(domain.high, 1e9)
    if domain.whole:
        plain = st.integers(int(domain.low), int(high))
        return st.one_of(plain, plain.map(np.int64), plain.map(np.uint64))
    real = st.floats(domain.low, high, exclude_min=domain.above, exclude_max=domain.below)
    return st.one_of(real, real.map(np.float64))


def some(*values: st.SearchStrategy[Any]) -> st.SearchStrategy[dict[str, Any]]:
    """A few settings; of each, values that it takes and others."""
    one = st.sampled_from(list(SETTINGS)).flatmap(
        lambda name: st.tuples(st.just(name), st.one_of(allowed(name), *values))
    )
    return st.lists(one, max_size=5).map(dict)


def fits(name: str, value: Any) -> bool:
    """Whether a plain value is allowed, said once more and by other means than the table's: JSON Schema's."""
    setting = SETTINGS[name]
    schema = {**setting.schema()}
    if isinstance(value, (np.ndarray, complex)):
        return False  # JSON Schema's library cannot compare them
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, tuple):
        value = list(value)
    if isinstance(value, Fraction):
        value = float(value)
    # What JSON Schema does not know: that 8.0 is not written as a whole number, and numbers that are not finite
    if isinstance(value, float) and (not math.isfinite(value) or "integer" in json.dumps(schema)):
        return False
    return bool(jsonschema.Draft202012Validator(schema).is_valid(value))


def assert_one_sentence(error: Exception) -> None:
    message = str(error)
    assert isinstance(error, ClrenderError) and error.exit_code == 2
    assert message.isprintable() and message.isascii() and "\n" not in message and len(message) < 700, message


def outcome(scene: Scene, given_settings: Mapping[str, Any]) -> RenderSettings | None:
    """The settings, or None where they are refused as they should be."""
    try:
        return settings_for(scene, None, given_settings)
    except UsageError as error:
        assert_one_sentence(error)
        return None


# --- every value, everywhere -----------------------------------------------------------------------------------------


@pytest.mark.long
@MANY
@given(chosen=some(JUNK, ODD))
def test_a_call_takes_what_the_table_allows_and_refuses_the_rest(chosen: dict[str, Any]) -> None:
    try:
        made = settings_for(PLAIN, None, chosen)
    except UsageError as error:
        assert_one_sentence(error)
        together = (
            "has no effect",
            "takes",
            "pixels",
            "a multiple of replicate_spp",
            "cannot be estimated from the spread of its",
            "first test needs",
            "not within the image",
            "share light in blocks",
        )
        # Two numbers of bands may fit the table one by one, and not each other
        bad = [name for name, value in chosen.items() if not fits(name, value) or name == "bands"]
        assert any(name in str(error) for name in bad) if bad else any(word in str(error) for word in together)
        return
    assert all(fits(name, value) for name, value in chosen.items())
    for name, value in chosen.items():
        kept = getattr(made, name)
        if name == "replicate_spp" and value is None and made.error is not None:
            assert kept == 16  # an error takes replicates
            continue
        assert kept == (float(value) if isinstance(kept, float) else value) and type(kept) in (
            bool,
            int,
            float,
            str,
            tuple,
            type(None),
        )
    again = json.loads(json.dumps(made.request()))
    assert RenderSettings(**present(again)).request() == made.request() == again
    assert made.struct(16).shape == (1,)


@pytest.mark.long
@SOME
@given(chosen=some(JUNK))
def test_a_scene_file_takes_what_a_call_takes(chosen: dict[str, Any]) -> None:
    """And the schema, which editors know it by, says the same."""
    section = {name: value for name, value in chosen.items() if SETTINGS[name].section == "render"}
    plain = {name: value.item() if isinstance(value, np.generic) else value for name, value in section.items()}
    try:
        scene = Scene(camera=CAMERA, render=plain)
    except SceneError as error:
        assert_one_sentence(error)
        assert "render" in str(error)
        bad = [name for name, value in plain.items() if not fits(name, value)]
        assert bad or "takes" in str(error), (plain, str(error))
        return
    assert all(fits(name, value) for name, value in plain.items())
    try:
        VALIDATORS["spp"].validate(plain)
    except jsonschema.ValidationError as error:
        pytest.fail(f"the schema refuses {plain}: {error.message}")
    made = settings_for(scene, None, {})
    assert {name: getattr(made, name) for name in plain} == plain
    assert Scene.model_validate_json(scene.model_dump_json()).render == scene.render


@SOME
@given(data=st.data())
def test_the_command_line_takes_what_a_call_takes(data: st.DataObject) -> None:
    name = data.draw(st.sampled_from(ON_THE_COMMAND_LINE))
    domain = SETTINGS[name].domain
    words = isinstance(domain, Choice) and isinstance(domain.members[0], str)
    value = data.draw(st.sampled_from([*NAMES, "packt", "PATH", ""]) if words else st.one_of(NUMBERS, allowed(name)))
    value = value.item() if isinstance(value, np.generic) else value
    written = Region.text(value) if isinstance(value, tuple) else value
    line = ["room", "-oa.png", f"{SETTINGS[name].option}={written}"]
    try:
        taken = render_command.make_context("render", line, main.make_context("clrender", ["render"])).params[name]
    except click.UsageError as error:
        message = error.format_message()
        assert f"{SETTINGS[name].option} is " in message and "but must be" in message and message.isprintable()
        assert not fits(name, value)
        return
    assert taken == (float(value) if isinstance(taken, float) else value) and fits(name, value)


@pytest.mark.parametrize("name", FLAGS)
def test_a_flag_is_an_option_and_its_opposite(name: str) -> None:
    option = str(SETTINGS[name].option)
    for line, value in (([], None), ([option], True), ([option.replace("--", "--no-")], False)):
        context = render_command.make_context(
            "render", ["room", "-oa.png", *line], main.make_context("clrender", ["render"])
        )
        assert context.params[name] is value


# --- what the table makes --------------------------------------------------------------------------------------------


def test_every_setting_is_an_option_a_key_of_the_schema_and_of_the_request() -> None:
    options = {option for parameter in render_command.params for option in parameter.opts}
    render, image = SCHEMA["$defs"]["Render"]["properties"], SCHEMA["$defs"]["Image"]["properties"]
    assert list(render) == IN_FILES and list(image) == ["width", "height"]
    for name, setting in SETTINGS.items():
        assert setting.option is None or setting.option in options
        assert setting.group in (IMAGE, WORK, STOP) and setting.help and (setting.unset or setting.default is not None)
        if setting.section:
            described = (render if setting.section == "render" else image)[name]
            assert setting.help in described["description"] and described["default"] == setting.default
        for integrator in INTEGRATORS:
            decides = setting.group == IMAGE and setting.integrator in (None, integrator) and not setting.late
            assert ((setting.former or name) in RenderSettings(integrator=integrator).request()) == decides
    assert RenderSettings() == settings_for(PLAIN, None, {})


def test_the_scenes_hash_knows_nothing_of_settings() -> None:
    """Or every new setting would make another scene of each."""
    other = Scene.model_validate({"camera": CAMERA, "render": {"spp": 7, "integrator": "direct"}})
    assert other.sha256() == PLAIN.sha256()


# --- one sentence ----------------------------------------------------------------------------------------------------

REFUSED: dict[str, tuple[dict[str, Any], str]] = {
    "truth value": ({"spp": True}, "spp is True, but must be a whole number of at least 1 and at most 1048576"),
    "NumPy's": ({"spp": np.bool_(True)}, "spp is "),
    "fraction": ({"spp": 4.0}, "spp is 4.0, but must be a whole number"),
    "text": ({"spp": "4"}, "spp is '4', but must be a whole number"),
    "digits": ({"seed": 10**5000}, "seed is an integer of more than 30 digits, but must be"),
    "misspelt value": ({"traversal": "packt"}, "is 'packt', but must be packet or single; did you mean 'packet'?"),
    "misspelt name": ({"sp": 4}, "there is no setting 'sp'; did you mean 'spp'?"),
    "unknown name": ({"quality": 4}, "there is no setting 'quality'; there are size, spp, width"),
    "samples per pass": ({"samples_per_pass": 0}, "samples_per_pass is 0, but must be a whole number of at least 1"),
    "work-group": ({"work_group": -3}, "work_group is -3, but must be a whole number of at least 1"),
    "time": ({"time_limit": math.nan}, "time_limit is nan, but must be a number of seconds above 0"),
    "endless time": ({"time_limit": math.inf}, "time_limit is inf, but must be a finite number of seconds above 0"),
    "depth": ({"max_depth": -1}, "max_depth is -1, but must be a whole number of at least 0"),
    "pixels": ({"width": 65536, "height": 65536}, f"has 4,294,967,296 pixels; at most {PIXEL_LIMIT:,} fit"),
    "photon radius": (
        {"integrator": "photon", "photon_radius": 1e-30},
        "photon_radius is 1e-30, but must be a number of at least 1e-06 and at most 1e+12",
    ),
    "light BVH": (
        {"integrator": "photon", "light_sampler": "bvh"},
        "light_sampler is 'bvh', but the integrator photon takes auto, power or uniform only",
    ),
    "branching": ({"integrator": "reuse", "indirect_rays": 2}, "is 2, but the integrator reuse takes 1 only"),
    "direct": ({"integrator": "direct", "indirect_rays": 2}, "integrator direct takes 1 or 0 only"),
    "photons": ({"photons": 1000}, "photons has no effect with the integrator path; it belongs to photon"),
    "patches": ({"integrator": "photon", "patches": 9}, "patches has no effect with the integrator photon"),
    "bands": ({"bands": (0, 6)}, "bands has no effect without spectral; set that as well, or leave it out"),
    "termination": ({"termination": 0.5}, "has no effect with the roulette throughput; it belongs to constant"),
}  # fmt: skip


@for_each("case", REFUSED)
def test_what_makes_no_sense_is_refused_in_one_sentence(case: str) -> None:
    chosen, words = REFUSED[case]
    with pytest.raises(UsageError) as caught:
        settings_for(ROOM, None, chosen)
    assert words in str(caught.value)
    assert_one_sentence(caught.value)


@for_each("size", [(800,), 800, "800x800", (1, 2, 3), (0, 4), (4.0, 4), (True, 4)])
def test_a_size_is_two_whole_numbers(size: Any) -> None:
    with pytest.raises(UsageError, match=r"size is|width is") as caught:
        settings_for(ROOM, size, {})
    assert_one_sentence(caught.value)


def test_memory_is_looked_at_before_it_is_taken(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("clrender.process.memory.os.sysconf", lambda name: 4096 if name == "SC_PAGE_SIZE" else 1000)
    with pytest.raises(UsageError, match=r"1000 x 1000 pixels takes 61.0 MiB of memory"):
        settings_for(ROOM, (1000, 1000), {})


def test_what_the_scene_says_may_be_for_another_integrator() -> None:
    scene = Scene.model_validate(
        {"camera": CAMERA, "render": {"indirect_rays": 4, "light_sampler": "bvh", "photons": 9, "termination": 0.5}}
    )
    made = settings_for(scene, None, {"integrator": "photon"})
    assert (made.indirect_rays, made.light_sampler, made.photons) == (1, "auto", 9)
    assert settings_for(scene, None, {}).indirect_rays == 4
    assert outcome(scene, {"integrator": "photon", "indirect_rays": 4}) is None
    with pytest.raises(SceneError, match=r"render.indirect_rays is 4, but the integrator photon takes 1 only"):
        Scene(camera=CAMERA, render={"indirect_rays": 4, "integrator": "photon"})


def test_of_many_settings_those_of_an_integrator() -> None:
    given_to_all = {"photons": 9, "patches": 8, "spp": 4, "no setting": 1}
    assert settings_of("photon", given_to_all) == {"photons": 9, "spp": 4, "no setting": 1}
