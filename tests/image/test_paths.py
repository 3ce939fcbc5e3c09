"""The light paths of a pixel add up to the pixel of a render, bit for bit, and say what the integrator did."""

from __future__ import annotations

import json
import random
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from paths_support import bits, paths_of, same_as_render

import clrender
from clrender import layout
from clrender.errors import RenderError, UsageError
from clrender.inspection import PixelPaths

if TYPE_CHECKING:
    from clrender.device import Device

SIZE = (50, 38)
PIXELS = ((25, 19), (12, 30), (49, 0))
WAYS: list[dict[str, Any]] = [
    {"filter": "mitchell", "shadow_rays": 3},
    {"filter": "gaussian", "indirect_rays": 4},
    {"indirect_rays": 0, "replicate_spp": 4},
    {"roulette": "constant", "termination": 0.3, "max_depth": 5},
    {"roulette": "none", "sampling": "bsdf", "max_depth": 8},
    {"sampling": "light", "light_sampler": "uniform"},
    {"specular_chains": "on"},
    {"guiding": "on", "guiding_paths": 20000},
    {"guiding": "on", "guiding_paths": 20000, "filter": "mitchell", "sampling": "light"},
    {"spectral": True, "filter": "mitchell"},
    {"spectral": True, "guiding": "on", "guiding_paths": 20000},
    {"integrator": "direct", "shadow_rays": 2},
    {"integrator": "whitted", "filter": "tent"},
    {"integrator": "bdpt", "filter": "mitchell"},
    {"integrator": "bdpt", "replicate_spp": 4},
    {"integrator": "bdpt", "roulette": "none", "max_depth": 5, "light_paths": 99},
    {"integrator": "bdpt", "specular_chains": "on"},
    {"integrator": "bdpt", "spectral": True, "light_sampler": "uniform"},
]
SCENES = (
    *("room-glass", "drink", "textures", "surfaces", "haze", "cloud", "campfire", "candles", "sky", "foliage"),
    *("metals", "lamps", "chick", "bumpy", "fisheye", "sundial"),
)
SPECTRAL = ("prism", "drink")


@pytest.fixture(scope="module")
def session(device: Device) -> Iterator[clrender.Session]:
    with clrender.Session(device.info.index) as opened:
        yield opened


def test_paths_add_up_to_the_pixel(session: clrender.Session) -> None:
    for found in same_as_render(session, clrender.load("room"), PIXELS, size=SIZE, spp=8, seed=3):
        assert len(found.samples) == 8 and found.about["spp"] == 8
        brightness = [abs(float(np.dot(each.value, (0.2126, 0.7152, 0.0722)))) for each in found.samples]
        assert brightness == sorted(brightness, reverse=True)
        assert sum(each.share for each in found.samples) == pytest.approx(1.0)


@pytest.mark.thorough
@pytest.mark.parametrize("way", [{"integrator": "whitted"}, {"integrator": "direct"}], ids=str)
def test_paths_of_integrators_add_up(session: clrender.Session, way: dict[str, Any]) -> None:
    same_as_render(session, clrender.load("room"), PIXELS, size=SIZE, spp=8, **way)


@pytest.mark.long
@pytest.mark.parametrize("way", WAYS, ids=str)
def test_paths_add_up_in_every_way(session: clrender.Session, way: dict[str, Any]) -> None:
    same_as_render(session, clrender.load("room"), PIXELS, size=SIZE, spp=8, **way)


@pytest.mark.long
@pytest.mark.parametrize("name", SCENES)
def test_paths_of_scenes_add_up(session: clrender.Session, name: str) -> None:
    """Glass, media, grids, environments, textures, rough and layered materials, instances, lamps, hair, holes."""
    same_as_render(session, clrender.load(name), PIXELS, size=SIZE, spp=8, integrator="path")


@pytest.mark.long
@pytest.mark.parametrize("name", SCENES)
def test_bidirectional_paths_of_scenes_add_up(session: clrender.Session, name: str) -> None:
    made = same_as_render(session, clrender.load(name), PIXELS, size=SIZE, spp=8, integrator="bdpt")
    assert all(found.splats is not None for found in made)


@pytest.mark.long
@pytest.mark.parametrize("integrator", ["path", "bdpt"])
@pytest.mark.parametrize("name", SPECTRAL)
def test_paths_of_wavelengths_add_up(session: clrender.Session, name: str, integrator: str) -> None:
    way = {"spectral": True, "integrator": integrator}
    for found in same_as_render(session, clrender.load(name), PIXELS, size=SIZE, spp=8, **way):
        for sample in found.samples:
            assert sample.wavelengths is not None
            assert ((sample.wavelengths >= 360.0) & (sample.wavelengths <= 830.0)).all()


@pytest.mark.slow
def test_paths_of_a_thousand_pixels_add_up(session: clrender.Session) -> None:
    rng = random.Random(5)
    ways: tuple[tuple[str, dict[str, Any]], ...] = (
        ("room", {}),
        ("haze", {"filter": "mitchell"}),
        ("textures", {"seed": 7}),
        ("caustic", {"specular_chains": "on"}),
        ("room", {"integrator": "bdpt"}),
        ("haze", {"integrator": "bdpt", "filter": "mitchell"}),
        ("caustic", {"integrator": "bdpt", "seed": 4}),
    )
    for name, way in ways:
        pixels = [(rng.randrange(SIZE[0]), rng.randrange(SIZE[1])) for _ in range(250)]
        same_as_render(session, clrender.load(name), pixels, size=SIZE, spp=4, **way)


@pytest.mark.thorough
def test_bidirectional_paths_add_up(session: clrender.Session) -> None:
    """Those of the camera by themselves, and with what light paths splat; connections have their light paths."""
    rng = random.Random(8)
    pixels = [(rng.randrange(SIZE[0]), rng.randrange(SIZE[1])) for _ in range(4)]
    made = same_as_render(session, clrender.load("room"), pixels, size=SIZE, spp=8, integrator="bdpt")
    assert {found.about["integrator"] for found in made} == {"bdpt"}
    assert any(found.splats is not None and found.splats.splatted.all() for found in made)
    every = [
        each for found in made for sample in found.samples for vertex in sample.vertices for each in vertex.additions
    ]
    ways = {(each.strategy, each.light_vertices) for each in every if each.arrives}
    assert {("emission", 0), ("light sample", 1), ("connection", 2), ("connection", 3)} <= ways
    for found in made:
        assert found.splats is not None
        assert found.splats.count == len(found.splats.paths)
        shares = sum(each.share for each in found.samples)
        luminance = [0.2126, 0.7152, 0.0722]
        assert shares == pytest.approx(found.splats.camera @ luminance / (found.radiance @ luminance), rel=1e-5)


def scene_of(*shapes: dict[str, Any], **more: Any) -> clrender.Scene:
    """A camera at z = 4 that looks at the origin, a lamp above, and these shapes."""
    return clrender.Scene.model_validate(
        {
            "camera": {"position": [0.0, 0.0, 4.0], "target": [0.0, 0.0, 0.0], "vertical_fov": 30.0},
            "materials": {
                "white": {"type": "lambert", "reflectance": [0.5, 0.5, 0.5]},
                "mirror": {"type": "mirror", "reflectance": [0.9, 0.9, 0.9]},
                "glass": {"type": "dielectric", "ior": 1.5},
            },
            "shapes": [*shapes],
            "lights": [{"type": "point", "position": [0.0, 3.0, 3.0], "intensity": [9.0, 9.0, 9.0]}],
            **more,
        }
    )


WALL: dict[str, Any] = {
    "type": "quad", "origin": [-2.0, -2.0, 0.0], "edge_u": [4.0, 0.0, 0.0], "edge_v": [0.0, 4.0, 0.0],
    "material": "white", "name": "wall",
}  # fmt: skip
PANE: dict[str, Any] = {**WALL, "origin": [-2.0, -2.0, 2.0], "material": "glass", "name": "pane"}


def test_a_path_is_that_of_the_formulae(session: clrender.Session) -> None:
    """A point light over a diffuse wall: the radiance is known, and so is everything on the way."""
    found = paths_of(session, scene_of(WALL), (16, 16), size=(32, 32), spp=4, max_depth=0)
    for sample in found.samples:
        (vertex,) = sample.vertices
        assert (vertex.object, vertex.material, vertex.material_type) == ("wall", "white", "lambert")
        assert vertex.ended == "depth" and vertex.event == "end" and vertex.depth == 0
        assert vertex.position is not None and abs(vertex.position[2]) < 1e-6 and vertex.normal is not None
        assert vertex.normal.tolist() == [0.0, 0.0, 1.0] and vertex.throughput_in.tolist() == [1.0, 1.0, 1.0]
        assert vertex.distance == pytest.approx(float(np.linalg.norm(vertex.position - sample.origin)), rel=1e-5)
        assert vertex.additions == () and not sample.value.any()
    found = paths_of(session, scene_of(WALL), (16, 16), size=(32, 32), spp=4, max_depth=1)
    for sample in found.samples:
        vertex = sample.vertices[0]
        (light,) = vertex.additions
        assert vertex.position is not None
        to = np.array([0.0, 3.0, 3.0]) - vertex.position
        square = float(to @ to)
        expected = 0.5 / np.pi * 9.0 / square * to[2] / np.sqrt(square)
        np.testing.assert_allclose(light.added, [expected] * 3, rtol=1e-4)
        assert (light.strategy, light.light_kind, light.delta, light.arrives) == ("light sample", "point", True, True)
        assert (light.light_weight, light.bsdf_weight) == (1.0, 0.0)
        assert light.bsdf_pdf == pytest.approx(to[2] / np.sqrt(square) / np.pi, rel=1e-4)
        assert light.position is not None
        np.testing.assert_allclose(light.position, [0.0, 3.0, 3.0], atol=1e-6)


@pytest.mark.thorough
def test_bidirectional_weights_are_those_of_the_formulae(session: clrender.Session) -> None:
    """A point light over a diffuse wall is found by light samples and by splats: how dense either is can be told."""
    side, fov, count = 32, 30.0, 200_000
    way: dict[str, Any] = {"size": (side, side), "spp": 8, "max_depth": 1, "integrator": "bdpt", "light_paths": count}
    (found,) = same_as_render(session, scene_of(WALL), [(16, 16)], **way)
    pitch = 2.0 * np.tan(np.radians(fov / 2.0)) / side
    assert found.splats is not None
    for sample in found.samples:
        (light,) = sample.vertices[0].additions
        point = sample.vertices[0].position
        assert point is not None and (light.camera_vertices, light.light_vertices) == (2, 1)
        to, back = np.array([0.0, 3.0, 3.0]) - point, sample.origin - point
        near, far = float(to @ to), float(back @ back)
        cosine = back[2] / np.sqrt(far)
        # Points of the wall that paths of all pixels, and that light paths, find in a square metre
        by_camera = 1.0 / (pitch * pitch * cosine**3) * cosine / far
        by_light = count / (4.0 * np.pi) * to[2] / np.sqrt(near) / near
        assert light.weight == pytest.approx(by_camera / (by_camera + by_light), rel=1e-3)
        whole = 0.5 / np.pi * 9.0 / near * to[2] / np.sqrt(near)
        np.testing.assert_allclose(light.added, [whole * light.weight] * 3, rtol=1e-3)
    # Splats bring the rest, in the mean; of so many light paths none comes here by a chance of exp(-8)
    assert by_light / by_camera > 1.0 and found.splats.splatted[0] > 0.0


def test_glass_and_what_ends_paths(session: clrender.Session) -> None:
    """Through a pane a path is straight in the middle, and its throughput divided by the squared index within."""
    glass = {"type": "box", "center": [0.0, 0.0, 2.0], "size": [4.0, 4.0, 0.5], "material": "glass", "name": "slab"}
    found = paths_of(session, scene_of(WALL, glass), (16, 16), size=(32, 32), spp=16, max_depth=6)
    through = [each for each in found.samples if len(each.vertices) > 2 and each.vertices[2].object == "wall"]
    assert len(through) > 10
    for sample in through:
        first, second, wall = sample.vertices[:3]
        assert [first.event, second.event] == ["specular transmission"] * 2
        assert first.pdf == second.pdf == 0.0 and first.index_squared == pytest.approx(2.25)
        np.testing.assert_allclose(first.throughput, 1.0 / 2.25, rtol=1e-5)
        np.testing.assert_allclose(wall.throughput_in, 1.0, rtol=1e-5)
        assert not first.additions and not second.additions
        assert [each.arrives for each in wall.additions] == [False]  # no shadow ray passes glass
        assert wall.additions[0].shadow_ray
    ends = {each.vertices[-1].ended for each in found.samples}
    assert ends <= {"escape", "roulette", "depth", "absorbed"} and "escape" in ends


def test_roulette_is_as_recorded(session: clrender.Session) -> None:
    found = paths_of(session, clrender.load("cornell"), (16, 16), size=(32, 32), spp=32)
    played = [each.roulette for sample in found.samples for each in sample.vertices if each.roulette]
    assert {each.survived for each in played} == {True, False}
    for sample in found.samples:
        for vertex in sample.vertices:
            if vertex.roulette is None or vertex.weight is None:
                continue
            assert vertex.roulette.survived == (vertex.roulette.random < vertex.roulette.survival)
            assert (vertex.ended == "roulette") == (not vertex.roulette.survived)
            expected = vertex.throughput_in * vertex.weight / np.float32(vertex.roulette.survival)
            np.testing.assert_allclose(vertex.throughput, expected, rtol=1e-6)


@pytest.mark.thorough
def test_paths_that_split_come_back(session: clrender.Session) -> None:
    (found,) = same_as_render(session, clrender.load("room"), [(25, 19)], size=SIZE, spp=8, indirect_rays=4)
    for sample in found.samples:
        again = [place for place, each in enumerate(sample.vertices) if each.again]
        assert len(again) == 3
        first = next(each for each in sample.vertices if each.position is not None and each.additions)
        for place in again:
            vertex = sample.vertices[place]
            assert vertex.position is not None and first.position is not None
            np.testing.assert_array_equal(vertex.position, first.position)
            np.testing.assert_allclose(vertex.throughput_in, first.throughput_in / 4.0, rtol=1e-6)
            assert sample.vertices[place - 1].ended is not None and not vertex.additions


def test_a_long_path_says_what_was_left_out(session: clrender.Session) -> None:
    """Within a white ball paths are long; the values are exact all the same."""
    ball = {"type": "sphere", "center": [0.0, 0.0, 4.0], "radius": 2.0, "material": "white", "flip_normals": True}
    white = {"white": {"type": "lambert", "reflectance": [1.0, 1.0, 1.0]}}
    lights = [{"type": "point", "position": [0.0, 1.0, 4.0], "intensity": [1.0, 1.0, 1.0]}]
    scene = scene_of(ball, materials=white, lights=lights)
    (found,) = same_as_render(session, scene, [(3, 3)], size=(8, 8), spp=4, max_depth=400)
    for sample in found.samples:
        # A vertex for each of 401 depths, and a light sample for each of the first 400
        assert sample.rows_left_out == 801 - (layout.INSPECT_ROWS - 1)
        recorded = np.sum([each.contribution for each in sample.vertices], axis=0, dtype=np.float64)
        np.testing.assert_allclose(recorded + sample.rest, sample.radiance, rtol=1e-4)
        assert sample.rest[0] > 0.0


def test_samples_that_are_left_out_come_first(session: clrender.Session) -> None:
    """A point light close to a wall: beside its foot the radiance is more than the film takes."""
    light = {"type": "point", "position": [0.0, 0.0, 0.02], "intensity": [1e12] * 3}
    (found,) = same_as_render(session, scene_of(WALL, lights=[light]), [(11, 10)], size=(21, 21), spp=64, max_depth=1)
    lost = found.nonfinite_samples
    assert 0 < lost < 64
    assert [each.finite for each in found.samples] == [False] * lost + [True] * (64 - lost)
    assert found.samples[0].value[0] > 2.0**43 > found.radiance[0] > 0.0


def test_only_some_samples_are_kept(session: clrender.Session) -> None:
    room = clrender.load("room")
    whole = paths_of(session, room, (25, 19), size=SIZE, spp=300, seed=3)
    some = paths_of(session, room, (25, 19), size=SIZE, spp=300, seed=3, samples=3)
    assert len(whole.samples) == 256 and len(whole.values) == len(some.values) == 300
    assert [each.index for each in some.samples] == [each.index for each in whole.samples[:3]]
    assert bits(some.radiance) == bits(whole.radiance)


def test_json_has_the_numbers(session: clrender.Session, tmp_path: Path) -> None:
    found = paths_of(session, clrender.load("room"), (25, 19), size=SIZE, spp=8)
    found.save(tmp_path / "paths.json")
    read = json.loads((tmp_path / "paths.json").read_text())
    assert read["format"] == "clrender light paths 1" and read["pixel"] == [25, 19]
    assert bits(read["radiance"]) == bits(found.radiance) and bits(read["values"]) == bits(found.values)
    assert len(read["samples"]) == 8
    for one, sample in zip(read["samples"], found.samples, strict=True):
        assert one["index"] == sample.index and len(one["vertices"]) == len(sample.vertices)
        for vertex, other in zip(one["vertices"], sample.vertices, strict=True):
            assert vertex["event"] == other.event and bits(vertex["throughput"]) == bits(other.throughput)
            assert [each["strategy"] for each in vertex["additions"]] == [each.strategy for each in other.additions]
    with pytest.raises(UsageError, match=r"\.json or an \.html"):
        found.save(tmp_path / "paths.txt")


def test_python_takes_what_render_takes(device: Device) -> None:
    room = clrender.load("room")
    found = clrender.paths(room, (25, 19), size=SIZE, spp=4, seed=9, device=device.info.index)
    assert isinstance(found, PixelPaths) and "4 of 4 samples" in repr(found)
    image = clrender.render(room, size=SIZE, spp=4, seed=9, device=device.info.index)
    assert bits(found.radiance) == bits(image.linear[19, 25])


@pytest.mark.parametrize("calls", [0, 3])
def test_paths_that_are_stopped_are_an_error(device: Device, calls: int) -> None:
    asked = iter([False] * calls)
    given: dict[str, Any] = {"size": SIZE, "spp": 5000, "device": device.info.index}
    with pytest.raises(RenderError, match="not complete"):
        clrender.paths(clrender.load("room"), (25, 19), should_stop=lambda: next(asked, True), **given)


@pytest.mark.parametrize(
    ("pixel", "settings", "words"),
    [
        ((50, 0), {}, "50,0 is not within the image of 50 x 38"),
        ((0, -1), {}, "0,-1 is not within"),
        ("middle", {}, "must be a column and a row"),
        ((1.5, 2), {}, "must be a column and a row"),
        ((1, 2), {"integrator": "photon"}, "integrator photon gathers photons.* of path, direct, whitted, bdpt"),
        ((1, 2), {"integrator": "reuse"}, "integrator reuse shares paths"),
        ((1, 2), {"crop": (0, 0, 4, 4)}, "crop has no effect"),
        ((1, 2), {"error": 0.1}, "error has no effect"),
        ((1, 2), {"aov": ("normal",)}, "aov has no effect"),
        ((1, 2), {"samples": 0}, "samples is 0"),
    ],
)
def test_bad_input_gives_one_sentence(pixel: Any, settings: dict[str, Any], words: str) -> None:
    with pytest.raises(UsageError, match=words) as raised:
        clrender.paths(clrender.load("room"), pixel, size=SIZE, **settings)
    assert "\n" not in str(raised.value)


def test_radiosity_has_no_paths() -> None:
    with pytest.raises(UsageError, match="integrator radiosity solves"):
        clrender.paths(clrender.load("cornell"), (1, 2), size=SIZE, integrator="radiosity")


@pytest.mark.long
def test_a_list_of_splats_grows(session: clrender.Session, monkeypatch: pytest.MonkeyPatch) -> None:
    """Where there is room for one, what is found is traced once more, and adds to the pixel once."""
    way: dict[str, Any] = {"size": SIZE, "spp": 4, "integrator": "bdpt", "light_paths": 20000}
    made = []
    for room in (1, 1 << 14):
        monkeypatch.setattr("clrender.bidirectional.listed_splats._LISTED", room)
        (found,) = same_as_render(session, clrender.load("room"), [(25, 30)], **way)
        made.append(found)
    assert made[0].to_json() == made[1].to_json()
    assert made[0].splats is not None and made[0].splats.count > 4


@pytest.mark.long
def test_the_brightest_splats_are_kept(session: clrender.Session, monkeypatch: pytest.MonkeyPatch) -> None:
    """Also where they are written down a few at a time."""
    scene, way = clrender.load("room"), {"size": SIZE, "spp": 4, "integrator": "bdpt", "light_paths": 20000}
    every, some = (paths_of(session, scene, (25, 30), samples=count, **way) for count in (1000, 3))
    monkeypatch.setattr("clrender.inspection.tracing._RECORDED", 2)
    assert paths_of(session, scene, (25, 30), samples=1000, **way).to_json() == every.to_json()
    assert every.splats is not None and some.splats is not None
    assert len(every.splats.paths) == every.splats.count == some.splats.count > 3 == len(some.splats.paths)
    for kept, first in zip(some.splats.paths, every.splats.paths, strict=False):
        assert (kept.sample, kept.path, kept.share) == (first.sample, first.path, first.share)
    assert np.array_equal(every.splats.values, some.splats.values)
