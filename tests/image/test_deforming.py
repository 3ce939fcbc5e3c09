"""Meshes that change their form while the shutter is open: what they pass, and with everything they can meet."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt
import pytest

import clrender
from clrender.errors import SceneError
from clrender.exporters.mesh_ply import write_ply
from clrender.flatten.flat_scene import flatten
from clrender.meshes.data import MeshData
from clrender.scene import Scene
from clrender.scene.portable import scene_from_portable, scene_to_portable

if TYPE_CHECKING:
    from clrender.device import Device

_Table = dict[str, Any]
Points = npt.NDArray[np.float64]

SIDE = 10
GRID = np.stack(np.meshgrid(np.linspace(-1.0, 1.0, SIDE), np.linspace(-1.0, 1.0, SIDE)), 2).reshape(-1, 2)
FACES = [
    face
    for row in range(SIDE - 1)
    for a in range(SIDE * row, SIDE * row + SIDE - 1)
    for face in ([a, a + 1, a + SIDE], [a + 1, a + SIDE + 1, a + SIDE])
]
SIZE = (48, 36)


def sheet(height: float) -> list[list[float]]:
    return [[x, y, height * float(np.sin(3.0 * x) * np.cos(2.0 * y))] for x, y in GRID.tolist()]


WAVES = [
    {"time": 0.0, "vertices": sheet(0.3)},
    {"time": 0.6, "vertices": sheet(-0.4)},
    {"time": 1.0, "vertices": sheet(0.5)},
]


def ball(radius: float, squeeze: float, count: int = 12) -> tuple[Points, npt.NDArray[np.int64]]:
    """A closed mesh: an ellipsoid from a cube's faces."""
    cube = [(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]
    faces = np.array(
        [
            (0, 1, 3), (0, 3, 2), (4, 6, 7), (4, 7, 5), (0, 4, 5), (0, 5, 1),
            (2, 3, 7), (2, 7, 6), (0, 2, 6), (0, 6, 4), (1, 5, 7), (1, 7, 3),
        ]
    )  # fmt: skip
    points = np.array(cube, np.float64)
    for _ in range(3):
        edges: dict[tuple[int, int], int] = {}
        some, grown = [*points], []

        def middle(a: int, b: int, some: list[Any] = some, edges: dict[tuple[int, int], int] = edges) -> int:
            key = (min(a, b), max(a, b))
            if key not in edges:
                edges[key] = len(some)
                some.append((some[a] + some[b]) / 2.0)
            return edges[key]

        for a, b, c in faces.tolist():
            ab, bc, ca = middle(a, b), middle(b, c), middle(c, a)
            grown += [(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)]
        points, faces = np.array(some), np.array(grown)
    points /= np.sqrt((points * points).sum(axis=1))[:, None]
    return points * np.array([radius, radius * squeeze, radius / squeeze]), faces


def scene_of(*shapes: _Table, shutter: Any = (0.0, 1.0), **more: Any) -> Scene:
    camera = {"position": [0.0, -3.0, 3.0], "target": [0.0, 0.0, 0.0], "up": [0.0, 0.0, 1.0], "vertical_fov": 45.0}
    floor = {"type": "quad", "origin": [-3, -3, -1], "edge_u": [6, 0, 0], "edge_v": [0, 6, 0], "material": "grey"}
    return Scene.model_validate(
        {
            "camera": {**camera, "shutter": None if shutter is None else list(shutter)},
            "materials": {
                "grey": {"type": "lambert", "reflectance": [0.7, 0.5, 0.4]},
                "mirror": {"type": "mirror"},
                "glass": {"type": "dielectric", "ior": 1.5},
                "net": {"type": "lambert", "reflectance": [0.6, 0.6, 0.6], "opacity": 0.5},
            },
            "shapes": [*shapes, floor],
            "lights": [
                {"type": "environment", "radiance": [0.5, 0.5, 0.6]},
                {"type": "point", "position": [2.0, -2.0, 4.0], "intensity": [20.0, 20.0, 20.0]},
            ],
            **more,
        }
    )


def waving(material: str = "grey", poses: list[_Table] = WAVES, **more: Any) -> _Table:
    return {"type": "mesh", "vertices": sheet(0.3), "faces": FACES, "material": material, "poses": poses, **more}


def hashes(device: Device, scene: Scene, *ways: _Table, **settings: Any) -> set[str]:
    with clrender.Session(device) as session:
        common = {"size": SIZE, "spp": 4, **settings}
        return {session.render(scene, **{**common, **way}).stats["image_sha256"] for way in ways}


WAYS: tuple[_Table, ...] = (
    {},
    {"lanes": 1},
    {"traversal": "single"},
    {"tile": 16, "samples_per_pass": 1},
    {"kernels": "staged"},
)


@pytest.mark.parametrize(
    ("material", "ways"),
    [("grey", WAYS[:3]), *(pytest.param(material, WAYS, marks=pytest.mark.long) for material in ("grey", "net"))],
)
def test_the_bits_do_not_depend_on_lanes_and_traversal(device: Device, material: str, ways: tuple[_Table, ...]) -> None:
    assert len(hashes(device, scene_of(waving(material)), *ways)) == 1


def mean_of_moments(device: Device, shape: _Table, count: int, spp: int, **settings: Any) -> npt.NDArray[np.float64]:
    total = np.zeros((SIZE[1], SIZE[0], 3))
    with clrender.Session(device) as session:
        for number in range(count):
            still = scene_of(shape, shutter=None).changed({"camera.time": (number + 0.5) / count})
            total += session.render(still, size=SIZE, spp=spp, seed=number, **settings).linear
    return total / count


@pytest.mark.parametrize(
    ("material", "settings"),
    [
        ("grey", {}),
        *(
            pytest.param(material, settings, marks=pytest.mark.long)
            for material, settings in (
                ("mirror", {}),
                ("net", {}),
                ("grey", {"integrator": "bdpt"}),
                ("grey", {"integrator": "whitted"}),
                ("grey", {"integrator": "photon", "photons": 20000}),
                ("grey", {"sampling": "bsdf"}),
            )
        ),
    ],
)
def test_it_is_the_mean_of_its_moments(device: Device, material: str, settings: _Table) -> None:
    """Of a sheet that waves through three poses, on its way between which every vertex goes straight."""
    shape = waving(material)
    blurred = clrender.render(scene_of(shape), device=device, size=SIZE, spp=128, **settings).linear
    moments = mean_of_moments(device, shape, 32, 4, **settings)
    difference = (blurred - moments).reshape(6, 6, 8, 6, 3).mean(axis=(1, 3))
    assert abs(difference.mean()) < 0.004 * moments.mean()
    assert np.abs(difference).max() < 0.06 * moments.mean()
    first = mean_of_moments(device, shape, 1, 16, **settings)
    assert np.abs((blurred - first).reshape(6, 6, 8, 6, 3).mean(axis=(1, 3))).max() > 0.04 * moments.mean(), "it moves"


def test_an_edge_sweeps_as_it_must(device: Device) -> None:
    """A square grows from nothing to two metres: a point at x is covered from the time x on."""
    start = [[0.0, -1.0, 0.0], [0.001, -1.0, 0.0], [0.001, 1.0, 0.0], [0.0, 1.0, 0.0]]
    end = [[0.0, -1.0, 0.0], [2.0, -1.0, 0.0], [2.0, 1.0, 0.0], [0.0, 1.0, 0.0]]
    poses = [{"time": 0.0, "vertices": start}, {"time": 1.0, "vertices": end}]
    square = {"type": "mesh", "vertices": start, "faces": [[0, 1, 2], [0, 2, 3]], "poses": poses}
    camera = {
        "type": "orthographic",
        "position": [1.0, 0.0, 2.0],
        "target": [1.0, 0.0, 0.0],
        "up": [0, 1, 0],
        "height": 1.0,
    }
    scene = Scene.model_validate(
        {
            "camera": {**camera, "shutter": [0.0, 1.0]},
            "shapes": [square],
            "lights": [{"type": "environment", "radiance": [1, 1, 1]}],
        }
    )
    image = clrender.render(scene, device=device, size=(64, 32), spp=256)
    x = (np.arange(64) + 0.5) / 32.0
    np.testing.assert_allclose(image.linear[..., 0].mean(axis=0), (x - 0.001) / 1.999, atol=0.01)


def grown(flat: float) -> Scene:
    """A quad that grows upward from a line in a second, seen from above, beside a triangle that rests."""
    rest = [[3.0, 3.0, 0.0], [4.0, 3.0, 0.0], [3.0, 4.0, 0.0]]
    forms: list[Any] = [[[-1, -1, 0], [1, -1, 0], [1, top, 0], [-1, top, 0], *rest] for top in (-1.0 + flat, 1.0)]
    poses = [{"time": float(time), "vertices": form} for time, form in enumerate(forms)]
    quad: _Table = {"type": "mesh", "vertices": forms[0], "faces": [[4, 5, 6], [0, 1, 2], [0, 2, 3]], "poses": poses}
    quad["uvs"] = [[x / 2 + 0.5, y / 2 + 0.5] for x, y, _ in forms[1]]
    camera = {"type": "orthographic", "position": [0, 0, 2], "target": [0, 0, 0], "height": 2.0, "shutter": [0.0, 1.0]}
    lights = [{"type": "environment", "radiance": [1.0, 1.0, 1.0]}]
    return Scene.model_validate({"camera": camera, "shapes": [quad], "lights": lights})


def test_triangles_without_area_at_one_time_are_there_at_others() -> None:
    with np.errstate(divide="raise", invalid="raise"):
        flat = flatten(grown(0.0), 8, 8)
    assert flat.triangle_count == 3 and not flat.warnings
    assert flatten(grown(0.0).changed({"camera.shutter": [-1.0, 0.0]}), 8, 8).triangle_count == 1


@pytest.mark.long
def test_what_grows_from_a_line_is_seen(device: Device) -> None:
    """It is black, and covers half of the picture in the mean of the time."""
    for flat in (0.0, 1e-3):
        assert len(hashes(device, grown(flat), *WAYS)) == 1
        image = clrender.render(grown(flat), device=device, size=(8, 8), spp=64, aov=("uv",))
        across = image.aovs["uv"][-1, :, 0]
        np.testing.assert_allclose(across / across.max(), (np.arange(8) + 0.5) / 7.5, atol=0.05)
        np.testing.assert_allclose(image.linear[::-1].mean(axis=(1, 2)), (np.arange(8) + 0.5) / 8, atol=0.03)


def test_a_closed_mesh_has_no_gaps_at_any_time(device: Device) -> None:
    """Seen from within, all is black: every triangle shares its corners with its neighbours, wherever they are."""
    (wide, faces), (narrow, _) = ball(2.0, 1.0), ball(2.0, 0.6)
    poses = [{"time": 0.0, "vertices": wide.tolist()}, {"time": 1.0, "vertices": narrow.tolist()}]
    shape = {"type": "mesh", "vertices": wide.tolist(), "faces": faces.tolist(), "poses": poses}
    camera = {"type": "panoramic", "position": [0.1, 0.05, 0.02], "target": [1.0, 0.0, 0.0], "shutter": [0.0, 1.0]}
    scene = Scene.model_validate(
        {"camera": camera, "shapes": [shape], "lights": [{"type": "environment", "radiance": [1, 1, 1]}]}
    )
    ways: tuple[_Table, ...] = ({}, {"traversal": "single"})
    for way in ways:
        assert not clrender.render(scene, device=device, size=(256, 128), spp=16, **way).linear.any()


def test_what_rests_is_the_mesh_of_that_moment(device: Device) -> None:
    """With and without a shutter, before the first pose, at one, and after the last."""

    def plain(height: float) -> Scene:
        return scene_of({**waving(poses=[]), "vertices": sheet(height)}, shutter=None)

    for height, camera in (
        (0.3, {"time": -1.0}),
        (-0.4, {"time": 0.6}),
        (0.5, {"time": 3.0}),
        (0.5, {"shutter": [1.0, 2.0]}),
        (0.3, {"shutter": [-2.0, 0.0]}),
    ):
        posed = scene_of(waving(), shutter=None).changed({f"camera.{key}": value for key, value in camera.items()})
        assert hashes(device, posed, {}) == hashes(device, plain(height), {})


def files(folder: Path, smooth: bool) -> _Table:
    """A ball that is squeezed, as files, with normals if asked for."""
    for name, squeeze in (("a", 1.0), ("b", 0.7)):
        points, faces = ball(0.8, squeeze)
        normals = None
        if smooth:
            normals = points / np.array([1.0, squeeze, 1.0 / squeeze]) ** 2
            normals = normals / np.sqrt((normals * normals).sum(axis=1))[:, None]
        with (folder / f"{name}.ply").open("wb") as file:
            write_ply(file, MeshData(points, faces.astype(np.uint32), normals))
    poses = [{"time": 0.0, "file": "a.ply"}, {"time": 1.0, "file": "b.ply"}]
    return {"type": "mesh", "file": "a.ply", "material": "grey", "poses": poses}


@pytest.mark.long
@pytest.mark.parametrize("material", ["grey", "glass"])
def test_vertex_normals_follow(device: Device, tmp_path: Path, material: str) -> None:
    shape = {**files(tmp_path, True), "material": material}
    scene = scene_of(shape).placed("scene", tmp_path)
    assert len(hashes(device, scene, *WAYS)) == 1
    total = np.zeros((SIZE[1], SIZE[0], 3))
    with clrender.Session(device) as session:
        blurred = session.render(scene, size=SIZE, spp=128).linear
        for number in range(16):
            still = (
                scene_of(shape, shutter=None).placed("scene", tmp_path).changed({"camera.time": (number + 0.5) / 16})
            )
            total += session.render(still, size=SIZE, spp=8, seed=number).linear
    difference = (blurred - total / 16).reshape(6, 6, 8, 6, 3).mean(axis=(1, 3))
    assert np.abs(difference).max() < 0.08 * blurred.mean()


def test_files_of_poses_count_by_what_they_hold(tmp_path: Path) -> None:
    scene = scene_of(files(tmp_path, False)).placed("scene", tmp_path)
    again = scene_from_portable(*scene_to_portable(scene))
    assert again.sha256() == scene.sha256() and flatten(again, 8, 8).sha256 == flatten(scene, 8, 8).sha256
    other = scene.changed({"shapes[0].poses[1].file": "a.ply"})
    assert other.sha256() != scene.sha256()
    assert scene.changed({"camera.shutter": [0.0, 0.5]}).sha256() != scene.sha256()
    from clrender.exporters import exported

    export = exported(scene, "files")
    assert export.description["shapes"][0]["poses"][1]["file"].startswith("files/b")


def test_poses_from_arrays(device: Device) -> None:
    names = ("body", "later", "last")
    poses = [{"time": pose["time"], "file": name} for pose, name in zip(WAVES, names, strict=True)]
    described = scene_of({"type": "mesh", "file": "body", "material": "grey", "poses": poses})
    faces = np.array(FACES)
    arrays = {
        name: {"vertices": np.array(pose["vertices"]), "faces": faces} for pose, name in zip(WAVES, names, strict=True)
    }
    assert hashes(device, described.with_arrays(meshes=arrays), {}) == hashes(device, scene_of(waving()), {})


def test_it_may_move_as_a_whole_too(device: Device) -> None:
    """Its motion acts after its form: the same as moving the vertices of all poses."""
    keys = [{"time": 0.0}, {"time": 1.0, "translate": [0.3, 0.1, 0.2]}]
    two = [WAVES[0], {**WAVES[2], "time": 1.0}]
    whole = clrender.render(scene_of(waving(poses=two, motion=keys)), device=device, size=SIZE, spp=64).linear
    there = [[x + 0.3, y + 0.1, z + 0.2] for x, y, z in sheet(0.5)]
    moved = [WAVES[0], {"time": 1.0, "vertices": there}]
    same = clrender.render(scene_of(waving(poses=moved)), device=device, size=SIZE, spp=64).linear
    np.testing.assert_allclose(whole.mean(), same.mean(), rtol=1e-3)
    assert np.median(np.abs(whole - same)) < 1e-5


@pytest.mark.parametrize("step", [1.0, -1.0])
def test_flow_is_that_of_the_vertices(device: Device, step: float) -> None:
    """Forward from the first form, and back from the last."""
    poses = [
        {"time": 0.0, "vertices": sheet(0.0)},
        {"time": 1.0, "vertices": [[1.2 * x, y, z + 0.1] for x, y, z in sheet(0.0)]},
    ]
    later = {"camera.time": 0.0 if step > 0.0 else 1.0, "camera.flow_step": step}
    scene = scene_of(waving(poses=poses), shutter=None).changed(later)
    image = clrender.render(scene, device=device, size=SIZE, spp=4, aov=("scene_flow", "position"), filter="box")
    flow, place = image.aovs["scene_flow"], image.aovs["position"]
    height, stretch = (0.0, 0.2) if step > 0.0 else (0.1, 0.2 / 1.2)
    on = (np.abs(place[..., 2] - height) < 1e-4) & (np.abs(place[..., :2]) < 0.9).all(axis=2)
    assert on.sum() > 100
    across = place[on][:, 0]
    expected = step * np.stack([stretch * across, 0.0 * across, np.full(on.sum(), 0.1)], 1)
    np.testing.assert_allclose(flow[on], expected, atol=1e-5)


@pytest.mark.parametrize(
    ("shape", "words"),
    [
        (waving(emission=[1.0, 1.0, 1.0]), "are given for what shines"),
        (waving(poses=[{"time": 0.0}]), "needs either `file` or `vertices`"),
        (waving(poses=[{"time": 0.0, "file": "a.ply"}]), "needs `vertices`, as the mesh itself has"),
        (waving(poses=[{"time": 0.0, "vertices": sheet(0.1)[:-1]}]), "has 99 entries, but the mesh has 100 vertices"),
        (waving(poses=[WAVES[1], WAVES[0]]), "must be later than that of the key before"),
    ],
)
def test_what_is_refused(shape: _Table, words: str) -> None:
    with pytest.raises((SceneError, ValueError), match=words):
        scene_of(shape)


def test_files_that_do_not_fit(tmp_path: Path) -> None:
    shape = files(tmp_path, False)
    points, faces = ball(0.8, 1.0)
    normals = points / np.sqrt((points * points).sum(axis=1))[:, None]
    for name, mesh, words in (
        (
            "less",
            MeshData(points[:-1], faces[(faces < len(points) - 1).all(axis=1)].astype(np.uint32)),
            "vertices, and the mesh has",
        ),
        ("turned", MeshData(points, faces[::-1].astype(np.uint32)), "has other triangles than the mesh"),
        (
            "smooth",
            MeshData(points, faces.astype(np.uint32), normals),
            "this pose has vertex normals, and the mesh has none",
        ),
    ):
        with (tmp_path / f"{name}.ply").open("wb") as file:
            write_ply(file, mesh)
        poses = [{"time": 0.0, "file": "a.ply"}, {"time": 1.0, "file": f"{name}.ply"}]
        with pytest.raises(SceneError, match=rf"shapes\[0\].poses\[1\].file:? .*{words}"):
            flatten(scene_of({**shape, "poses": poses}).placed("scene", tmp_path), 8, 8)
