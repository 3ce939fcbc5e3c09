"""Path reuse against path tracing: the same mean, less noise, and why the visibility has to be in both sums."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt
import pytest
from compiled_support import compile_with
from render_support import Studio, lambert, quad, scene, sphere
from stats_support import Evidence

import clrender
from clrender.image.files import write_image

if TYPE_CHECKING:
    from clrender.device import Device
    from clrender.scene import Scene

# Everything that decides which pixels may share: how paths end, how far they go, how many share.
WAYS: dict[str, dict[str, Any]] = {
    "16": {},
    "2": {"reuse": 2, "shadow_rays": 2},
    "limited depth": {"max_depth": 3},
    "constant": {"roulette": "constant", "termination": 0.2},
    "materials alone": {"sampling": "bsdf", "max_depth": 4},
}


def plain(settings: dict[str, Any]) -> dict[str, Any]:
    return {name: value for name, value in settings.items() if name != "reuse"}


def compare(evidence: Evidence, studio: Studio, what: Scene, seeds: int, **settings: Any) -> None:
    path = studio.tiles(what, range(seeds), size=16, spp=16, **plain(settings))
    reuse = studio.tiles(what, range(1000, 1000 + seeds), size=16, spp=16, integrator="reuse", **settings)
    evidence.equal("tiles", path, reuse)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["cornell", "room-mirror", "bumpy"])
def test_reuse_is_unbiased_over_64_seeds(evidence: Evidence, studio: Studio, name: str) -> None:
    """Mirrors in two of the scenes, so that anchors lie behind them, and interpolated normals in one."""
    compare(evidence, studio, clrender.load(name), 64)


def test_reuse_is_unbiased_behind_mirrors(evidence: Evidence, studio: Studio) -> None:
    compare(evidence, studio, clrender.load("room-mirror"), 16)


def test_reuse_is_unbiased_behind_glass(evidence: Evidence, studio: Studio) -> None:
    """Anchors in a denser medium, so late on their paths that the roulette is played: by flux, as everywhere."""
    glass = [
        {"type": "box", "size": [4.0, 4.0, 4.0]},
        {"type": "box", "center": [0.0, 0.0, 3.0], "size": [6.0, 6.0, 0.1]},
    ]
    walls = [
        quad([-1.5, -1.5, -1.5], [3.0, 0.0, 0.0], [0.0, 3.0, 0.0], material="wall"),
        quad([-1.5, -1.5, -1.5], [0.0, 3.0, 0.0], [0.0, 0.0, 3.0], material="wall"),
        quad([1.5, -1.5, -1.5], [0.0, 0.0, 3.0], [0.0, 3.0, 0.0], material="wall"),
        quad([-1.5, -1.5, -1.5], [0.0, 0.0, 3.0], [3.0, 0.0, 0.0], material="wall"),
        quad([-0.4, 1.49, -0.4], [0.8, 0.0, 0.0], [0.0, 0.0, 0.8], emission=5.0),
    ]
    camera = {"position": [0.0, 0.0, 8.0], "target": [0.0, 0.0, 0.0], "vertical_fov": 22.0}
    materials = {"wall": lambert([0.5, 0.4, 0.3]), "glass": {"type": "dielectric", "ior": 1.5}}
    what = scene([*({**box, "material": "glass"} for box in glass), *walls], (), camera, **materials)
    compare(evidence, studio, what, 16)


@pytest.mark.long
@pytest.mark.parametrize("way", WAYS)
def test_every_way_of_reuse_is_unbiased(evidence: Evidence, studio: Studio, way: str) -> None:
    compare(evidence, studio, clrender.load("cornell"), 16, **WAYS[way])


def partitioned_furnace(
    studio: Studio, partition: dict[str, Any] | None = None, **settings: Any
) -> npt.NDArray[np.float64]:
    """(16, 16) radiance of the tiles of an image, of sixteen seeds; 1 / (1 - 0.8) = 5 is exact.

    A thin wall, seen from its edge, parts a room: pixels beside each other do not see what their neighbours see.
    """
    glow = {"material": "wall", "emission": [1.0, 1.0, 1.0]}
    room = {"type": "box", "size": [4.0, 4.0, 4.0], "flip_normals": True, **glow}
    thin = {"material": "thin"} if partition else glow
    walls = [{"type": "box", "center": [x, -0.5, 0.0], "size": [0.02, 2.9, 3.9], **thin} for x in (-0.9, 0.0, 0.9)]
    camera = {"position": [0.1, 1.9, 0.2], "target": [0.1, 0.0, 0.1], "up": [0, 0, -1], "vertical_fov": 70.0}
    materials = {"wall": lambert(0.8), "thin": partition or lambert(0.8)}
    return studio.tiles(scene([room, *walls], (), camera, **materials), spp=16, **settings)


def test_reuse_is_exact_in_a_furnace(evidence: Evidence, studio: Studio) -> None:
    evidence.mean_is("radiance", partitioned_furnace(studio, integrator="reuse"), 5.0)


def rich_room(where: Path) -> Scene:
    """Matt surfaces among all others: behind a rough metal, in a mixture, and with normals that point elsewhere."""
    slopes = np.random.default_rng(5).random((8, 8, 3)).astype(np.float32)
    slopes[..., 2] = 0.6
    write_image(where / "n.exr", slopes)
    bumpy = {"texture": "n.exr", "filter": "nearest"}
    materials: dict[str, Any] = {
        "wall": lambert([0.8, 0.6, 0.4]),
        "floor": {"type": "lambert", "reflectance": {"checker": [0.2, 0.9], "size": 0.25}, "normal_map": bumpy},
        "gold": {"type": "conductor", "metal": "Au", "roughness": 0.5},
        "plastic": {"type": "principled", "base_color": [0.7, 0.3, 0.2], "roughness": 0.4, "coat": 1.0},
        "back": {"type": "lambert", "reflectance": [0.7, 0.7, 0.9], "two_sided": False},
        "mirror": {"type": "mirror"},
        "mixed": {"type": "mix", "materials": ["wall", "mirror"], "weight": 0.4},
    }
    shapes: list[dict[str, Any]] = [
        {"type": "box", "size": [2.0, 2.0, 2.0], "flip_normals": True, "material": "wall"},
        quad((-1, -0.99, 1), (2, 0, 0), (0, 0, -2), material="floor"),
        quad((-0.4, 0.98, -0.4), (0.8, 0, 0), (0, 0, 0.8), emission=4.0),
        quad((-0.9, -0.9, -0.8), (0.0, 1.2, 0.0), (0.6, 0, -0.1), material="back"),
        sphere((-0.5, -0.6, -0.1), 0.35, material="gold"),
        sphere((0.3, -0.65, 0.2), 0.3, material="plastic"),
        {"type": "box", "center": [0.5, -0.5, -0.6], "size": [0.5, 0.9, 0.4], "material": "mixed"},
    ]
    camera = {"position": [0.0, 0.1, 0.95], "target": [0.0, -0.4, -0.2], "vertical_fov": 80.0}
    return scene(shapes, (), camera, **materials).placed("here", where)


@pytest.mark.long
def test_reuse_is_unbiased_around_rough_metal(evidence: Evidence, studio: Studio) -> None:
    """Metal and matt surfaces in one block of sixteen pixels, which share all that they find.

    Where neighbours are alike, a wrong density stands above and below the line, and next to nothing is wrong.
    """
    metal = {"type": "conductor", "f0": [0.9, 0.9, 0.9], "roughness": 0.4}
    shapes = [
        {"type": "box", "size": [2.0, 2.0, 2.0], "flip_normals": True, "material": "dark"},
        quad((-1, -0.98, 1), (2, 0, 0), (0, 0, -2), material="metal"),
        quad((-0.98, -1, 1), (0, 0, -2), (0, 2, 0), material="metal"),
        quad((0.2, -1, -0.98), (0.7, 0, 0), (0, 2, 0), material="white"),
        quad((0.97, -1, -0.9), (0, 0, 0.3), (0, 2, 0), emission=3.0),
    ]
    camera = {"position": [0.3, 0.0, 0.9], "target": [0.0, -0.6, -0.6], "vertical_fov": 75.0}
    materials = {"dark": lambert(0.7), "white": lambert(0.9), "metal": metal}
    what, block = scene(shapes, (), camera, **materials), {"size": 4, "spp": 512}
    path = studio.tiles(what, range(12), **block)
    evidence.equal("pixels", path, studio.tiles(what, range(1000, 1012), integrator="reuse", **block))


@pytest.mark.long
def test_what_metal_sends_into_one_direction_is_not_shared(evidence: Evidence, studio: Studio) -> None:
    """A lamp that turns its back on the floor, and a metal wall that mirrors it to some places of the floor only."""
    metal = {"type": "conductor", "f0": [0.9, 0.9, 0.9], "roughness": 0.4}
    shapes = [
        quad((-1, 0, 1), (2, 0, 0), (0, 0, -2), material="white"),
        quad((-1, 0, -1), (2, 0, 0), (0, 1.5, 0), material="metal"),
        quad((-0.7, 0.4, -0.3), (0, 0.5, 0), (0.5, 0, 0), emission=8.0),
    ]
    camera = {"position": [0.0, 2.5, 0.0], "target": [0.0, 0.0, 0.0], "up": [0, 0, -1], "vertical_fov": 42.0}
    what, block = scene(shapes, (), camera, white=lambert(0.8), metal=metal), {"size": 4, "spp": 1024}
    path = studio.tiles(what, range(16), **block)
    evidence.equal("pixels", path, studio.tiles(what, range(1000, 1016), integrator="reuse", **block))


@pytest.mark.slow
@pytest.mark.parametrize("seeds", [96])
def test_reuse_is_unbiased_among_all_materials(evidence: Evidence, studio: Studio, tmp_path: Path, seeds: int) -> None:
    compare(evidence, studio, rich_room(tmp_path), seeds)


@pytest.mark.slow
def test_reuse_is_unbiased_in_a_scene_with_textures(evidence: Evidence, studio: Studio) -> None:
    compare(evidence, studio, clrender.load("textures"), 48)


@pytest.mark.slow
def test_a_furnace_with_walls_of_white_metal(evidence: Evidence, studio: Studio) -> None:
    """Its thin walls reflect all light; to a thousandth is what a compensated metal promises (docs/furnace.md)."""
    metal = {"type": "conductor", "f0": [1.0, 1.0, 1.0], "roughness": 0.5}
    evidence.mean_is("radiance", partitioned_furnace(studio, metal, integrator="reuse"), 5.0, rounding=1e-3)


@pytest.mark.long
def test_an_anchor_that_does_not_see_may_not_be_counted(
    evidence: Evidence, studio: Studio, monkeypatch: pytest.MonkeyPatch
) -> None:
    """With all anchors assumed to see all targets, light behind edges is divided by densities that are none."""
    compile_with(monkeypatch, REUSE_ASSUMES_VISIBLE=1)
    tiles = partitioned_furnace(studio, integrator="reuse")
    assert tiles.mean() < 4.9
    with pytest.raises(AssertionError, match="radiance"):
        evidence.mean_is("radiance", tiles, 5.0)


@pytest.mark.long
def test_sharing_lessens_noise_where_light_is_diffuse(studio: Studio) -> None:
    box = clrender.load("cornell")
    reference = studio.image(box, 32, spp=4096)[8:]  # without the light: its edges are not what is shared

    def error(**settings: Any) -> float:
        images = [studio.image(box, 32, seed=seed, spp=16, **settings)[8:] for seed in range(4)]
        return float(np.mean([((image - reference) / reference.mean()) ** 2 for image in images]))

    errors = [error(), *(error(integrator="reuse", reuse=n) for n in (1, 4, 16))]
    assert 0.8 < errors[1] / errors[0] < 1.25  # alone, a pixel gains nothing
    assert errors[2] < errors[1] / 1.5
    assert errors[3] < errors[2] / 1.5


@pytest.mark.long
@pytest.mark.parametrize("shared", ["wavelengths", "time"])
def test_errors_of_means_where_all_pixels_share(device: Device, shared: str) -> None:
    """Wavelengths and times are those of a sample of the whole image; errors were those of independent blocks."""
    room = scene(
        [sphere((0.0, 0.8, 0.0), 5.0, material="wall", flip_normals=True)],
        lights=[{"type": "point", "position": [0.0, 1.2, -1.0], "intensity": {"illuminant": "FL2", "scale": 10.0}}],
        camera={"position": [0.0, 1.0, -3.0], "target": [0.0, 0.8, 0.0], "vertical_fov": 40.0},
        wall=lambert(0.5),
    )
    if shared == "time":
        lamp = {"type": "point", "position": [0.0, 1.2, -1.0], "intensity": [10.0, 10.0, 10.0]}
        keys = [{"time": 0.0}, {"time": 1.0, "translate": [0.0, 0.0, 3.5]}]
        room = room.changed({"camera.shutter": [0.0, 1.0], "lights": [{**lamp, "motion": keys}]})
    settings: dict[str, Any] = {"size": (16, 16), "spp": 32, "replicate_spp": 4, "spectral": shared == "wavelengths"}
    with clrender.Session(device) as session:
        images = [session.render(room, integrator="reuse", seed=seed, **settings) for seed in range(20)]
    spread = np.std([image.linear.mean(axis=(0, 1), dtype=np.float64) for image in images], axis=0, ddof=1)
    told = np.sqrt(np.mean([np.square(image.stats["mean_stderr"]) for image in images], axis=0))
    assert (told > 0.7 * spread).all()
