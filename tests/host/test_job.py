"""A job is checked once, goes through JSON with its assets, and its hash says which films belong together."""

from __future__ import annotations

import json
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cases import for_each

import clrender
from clrender.errors import SceneError, UsageError
from clrender.integrators import INTEGRATORS
from clrender.rendering.job import RenderJob
from clrender.scene import Scene

SCENE: dict[str, Any] = {
    "camera": {"position": [0, 0, 3], "target": [0, 0, 0]},
    "materials": {"white": {"type": "lambert", "reflectance": [0.5, 0.5, 0.5]}},
    "shapes": [
        {"type": "mesh", "file": "a.obj", "material": "white"},
        {"type": "mesh", "file": "b.obj", "material": "white"},
        {"type": "mesh", "file": "copy of a.obj", "material": "white", "transform": {"translate": [1, 0, 0]}},
        {"type": "sphere", "center": [0, 1, 0], "radius": 0.1, "emission": [1, 1, 1]},
    ],
}
TRIANGLE = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"
SQUARE = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nf 1 2 3 4\n"


@pytest.fixture
def scene(tmp_path: Path) -> Scene:
    for name, text in (("a.obj", TRIANGLE), ("b.obj", SQUARE), ("copy of a.obj", TRIANGLE)):
        (tmp_path / name).write_text(text)
    (tmp_path / "scene.json").write_text(json.dumps(SCENE))
    return clrender.load(tmp_path / "scene.json")


def refused_calls() -> dict[str, tuple[Callable[[], object], str]]:
    """What callers may give by mistake, and what is said of it."""
    room = clrender.load("room")
    of: Any = partial(RenderJob.of, room)
    scene: Any = Scene
    session = clrender.Session()
    return {
        "should_stop": (lambda: session.render(room, should_stop=3), "should_stop is 3, but must be a function"),  # type: ignore[arg-type]
        "on_progress": (lambda: session.render(room, on_progress=3), "on_progress is 3, but must be a function"),  # type: ignore[arg-type]
        "resume": (lambda: session.render(room, resume="no"), "resume is 'no', but must be true or false"),  # type: ignore[arg-type]
        "notify": (lambda: clrender.Session(notify=3), "notify is 3, but must be a function"),  # type: ignore[arg-type]
        "notify of a render": (lambda: clrender.render(room, notify=3), "notify is 3, but must be a function"),  # type: ignore[arg-type]
        "on_stage": (lambda: clrender.Session(on_stage=3), "on_stage is 3, but must be a function"),  # type: ignore[arg-type]
        "refit": (lambda: clrender.Session(refit="x"), "refit is 'x', but must be true or false"),  # type: ignore[arg-type]
        "light_groups": (lambda: of(light_groups="no"), "light_groups is 'no', but must be true or false"),
        "denoise": (lambda: of(denoise="no"), "denoise is 'no', but must be true or false"),
        "amodal": (lambda: of(amodal=[1]), "amodal is [1], but must be names of instances, or all"),
        "spectrum": (lambda: of(spectral=True, spectrum=True), "spectrum is True, but must be a whole number"),
        "a scene's content": (lambda: scene({"shapes": []}), "a Scene takes its tables by name"),
    }


@for_each("name", [*refused_calls()])
def test_what_is_no_value_is_refused_in_a_sentence(name: str) -> None:
    call, words = refused_calls()[name]
    with pytest.raises(UsageError) as told:
        call()
    assert words in str(told.value)


def test_values_of_numpy_and_paths_are_taken() -> None:
    room = clrender.load("room")
    of: Any = RenderJob.of
    job = of(room, spectral=True, spectrum=np.int64(4), light_groups=np.bool_(True))
    assert type(job.bands) is int and job.light_groups is True
    assert clrender.load(Path("room")).sha256() == room.sha256()


def test_a_job_goes_through_json_with_its_assets(scene: Scene, tmp_path: Path) -> None:
    job = RenderJob.of(scene, size=(30, 20), spp=48, seed=5, aov=("depth",), shadow_rays=2, tile=32).shard(2, 3)
    text, assets = job.to_json()
    assert len(assets) == 2, "a mesh that is there twice travels once"
    for name in ("a.obj", "b.obj", "copy of a.obj"):
        (tmp_path / name).unlink()
    there = RenderJob.from_json(text, assets)
    assert (there.settings, there.first_sample, there.sample_count, there.aov) == (job.settings, 16, 16, ("depth",))
    assert there.sha256() == job.sha256() and there.request() == job.request()
    assert there.scene.sha256() == scene.sha256()
    assert there.to_json()[0] == text and there.to_json()[1].keys() == assets.keys()
    assert str(tmp_path) not in text


@pytest.mark.parametrize("name", ["room", "bumpy", "cornell"])
def test_built_in_scenes_go_through_json(name: str) -> None:
    job = RenderJob.of(clrender.load(name))
    there = RenderJob.from_json(*job.to_json())
    assert there.sha256() == job.sha256()


def damaged(text: str, **changes: Any) -> str:
    return json.dumps({**json.loads(text), **changes})


def test_what_is_no_job_is_refused(scene: Scene) -> None:
    text, assets = RenderJob.of(scene).to_json()
    content = json.loads(text)
    first = next(iter(assets))
    with pytest.raises(SceneError, match=f"the asset {first} is missing"):
        RenderJob.from_json(text, {name: data for name, data in assets.items() if name != first})
    with pytest.raises(SceneError, match="has another content than its hash says"):
        RenderJob.from_json(text, dict(zip(assets, reversed(list(assets.values())), strict=True)))
    with pytest.raises(SceneError, match="cannot be read"):
        RenderJob.from_json(text, {name: data[:-40] for name, data in assets.items()})
    for broken in ("", "[]", "{}", text[:-1], damaged(text, format="clrender job 9"), damaged(text, samples=[0])):
        with pytest.raises(UsageError, match="no clrender job"):
            RenderJob.from_json(broken, assets)
    with pytest.raises(UsageError, match="samples is"):
        RenderJob.from_json(damaged(text, samples=[3, 2]), assets)
    with pytest.raises(UsageError, match="spp is 0"):
        RenderJob.from_json(damaged(text, settings={**content["settings"], "spp": 0}), assets)
    with pytest.raises(SceneError, match="camera"):
        RenderJob.from_json(damaged(text, scene={"shapes": []}), assets)
    other = {**content["request"], "kernel_sha256": "0" * 64, "version": "9"}
    with pytest.raises(UsageError, match="kernel_sha256, version differ here"):
        RenderJob.from_json(damaged(text, request=other), assets)


def test_files_are_never_read_for_a_job(scene: Scene) -> None:
    text, assets = RenderJob.of(scene).to_json()
    content = json.loads(text)
    content["scene"]["shapes"][0]["file"] = "a.obj"
    with pytest.raises(SceneError, match="assets are named by their hash"):
        RenderJob.from_json(json.dumps(content), assets)


@pytest.mark.parametrize("count", [1, 2, 3, 7, 64])
def test_shards_are_disjoint_and_make_up_the_job(scene: Scene, count: int) -> None:
    job = RenderJob.of(scene, spp=64)
    shards = [job.shard(number, count) for number in range(1, count + 1)]
    samples = [n for each in shards for n in range(each.first_sample, each.first_sample + each.sample_count)]
    assert samples == list(range(64))
    assert max(each.sample_count for each in shards) - min(each.sample_count for each in shards) <= 1
    assert {each.sha256() for each in shards} == {job.sha256()}


@pytest.mark.parametrize(("number", "count"), [(0, 3), (4, 3), (-1, 3), (1, 0), (1, 65)])
def test_shards_that_there_are_not(scene: Scene, number: int, count: int) -> None:
    with pytest.raises(UsageError, match=f"shard {number}/{count}"):
        RenderJob.of(scene, spp=64).shard(number, count)


def test_the_hash_is_that_of_the_image(scene: Scene) -> None:
    job = RenderJob.of(scene, spp=4)
    same: list[dict[str, Any]] = [
        {"spp": 8},
        {"tile": 8},
        {"lanes": 1},
        {"aov": ("depth",)},
        {"time_limit": 3.0},
        {"samples": (1, 3)},
    ]
    assert {RenderJob.of(scene, **{"spp": 4, **how}).sha256() for how in same} == {job.sha256()}
    others: list[dict[str, Any]] = [
        {"seed": 1},
        {"size": (9, 9)},
        {"integrator": "direct"},
        {"max_depth": 3},
        {"sampling": "bsdf"},
    ]
    hashes = {RenderJob.of(scene, spp=4, **how).sha256() for how in others}
    assert len(hashes) == len(others) and job.sha256() not in hashes


def test_a_job_has_its_own_settings(scene: Scene) -> None:
    job = RenderJob.of(scene)
    assert RenderJob.given(job) is job
    with pytest.raises(UsageError, match="spp cannot be given beside it"):
        RenderJob.given(job, spp=3)


@pytest.mark.parametrize(
    "how", [{"integrator": "photon", "light_sampler": "bvh"}, {"integrator": "reuse", "indirect_rays": 2}]
)
def test_what_an_integrator_does_not_take_is_refused(scene: Scene, how: dict[str, Any]) -> None:
    with pytest.raises(UsageError, match=f"but the integrator {how['integrator']} takes .* only"):
        RenderJob.of(scene, **how)


@for_each("kind", ["oren_nayar", "conductor", "principled", "mix", "dielectric", "lambert"])
@for_each("integrator", INTEGRATORS)
def test_materials_that_an_integrator_does_not_take_are_refused(integrator: str, kind: str) -> None:
    materials = {
        "oren_nayar": {"type": "oren_nayar", "reflectance": (0.5, 0.5, 0.5)},
        "conductor": {"type": "conductor", "metal": "Au"},
        "principled": {"type": "principled"},
        "mix": {"type": "mix", "materials": ("plain", "plain")},
        "dielectric": {"type": "dielectric", "ior": 1.5, "roughness": 0.5},
        "lambert": {"type": "lambert", "reflectance": (0.5, 0.5, 0.5), "two_sided": False},
    }
    plain = {"type": "mirror"}
    scene = Scene.model_validate(
        {
            "camera": {"position": (0, 0, 3), "target": (0, 0, 0)},
            "materials": {"rough": materials[kind], "plain": plain},
            "shapes": [{"type": "sphere", "center": (0, 0, 0), "radius": 1, "material": "rough"}],
        }
    )
    if integrator == "radiosity":
        with pytest.raises(
            SceneError, match=rf"shapes\[0\].material: 'rough' is of type {kind}.*, .* use --integrator"
        ):
            RenderJob.of(scene, integrator=integrator)
    else:
        assert RenderJob.of(scene, integrator=integrator).integrator is INTEGRATORS[integrator]


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        ({"samples": 256}, "for 256 samples per pixel, give spp"),
        ({"samples": "all"}, "must be two whole numbers, the first and the one after the last$"),
        ({"sampels": (0, 2)}, "there is no setting 'sampels'; did you mean 'samples'"),
        ({"denoised": True}, "there is no setting 'denoised'; did you mean 'denoise'"),
        ({"resolution": (8, 8)}, "there is no setting 'resolution'; there are size, samples, .*, spp, "),
    ],
)
def test_names_beside_the_settings_are_known(scene: Scene, wrong: dict[str, Any], said: str) -> None:
    with pytest.raises(UsageError, match=said):
        RenderJob.of(scene, **wrong)
