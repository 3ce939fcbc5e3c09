"""`clrender convert`: what is read from its output is the scene that went in, and no output is half written."""

from __future__ import annotations

import dataclasses
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import IO

import click
import numpy as np
import pytest
from assets import ASSETS, needs_assets
from cases import for_each
from PIL import Image

import clrender
from clrender.cli import main
from clrender.errors import SceneError, UsageError
from clrender.exporters import exported, scene_text
from clrender.exporters.mesh_ply import write_ply
from clrender.flatten.flat_scene import flatten
from clrender.image.files import write_image
from clrender.meshes.data import MeshData
from clrender.meshes.read import read_mesh
from clrender.scene import Scene, builtin_names

ROOT = Path(__file__).resolve().parents[2]
ENDINGS = (".obj", ".ply", ".stl", ".gltf", ".glb", ".xml", ".pbrt")


def convert(*arguments: object) -> None:
    main.main([str(each) for each in ("convert", *arguments)], standalone_mode=False)


def written(scene: Scene, output: Path) -> Scene:
    """The scene, converted and read again."""
    export = exported(scene, f"{output.stem}-files")
    for name, write in export.files.items():
        (output.parent / name).parent.mkdir(exist_ok=True)
        with (output.parent / name).open("wb") as file:
            write(file)
    output.write_bytes(scene_text(export.description, output.suffix, "a test"))
    return clrender.load(output)


@for_each("ending", [".toml", ".json"])
@for_each("name", list(builtin_names()))
def test_built_in_scenes(tmp_path: Path, name: str, ending: str) -> None:
    scene = clrender.load(name)
    again = written(scene, tmp_path / f"out{ending}")
    assert again.sha256() == scene.sha256() and again.render == scene.render and again.title == scene.title


@pytest.mark.long
@pytest.mark.parametrize("name", list(builtin_names()))
def test_what_goes_to_devices_is_the_same(tmp_path: Path, name: str) -> None:
    scene = clrender.load(name)
    again = written(scene, tmp_path / "out.toml")
    assert flatten(again, 8, 8).arrays_sha256 == flatten(scene, 8, 8).arrays_sha256


CAMERA = {"position": [0.1, 0.2, 5.0], "target": [0.0, 0.0, 0.0]}
BALL = {"type": "sphere", "radius": 1.0, "material": "glass"}
FEATURES: dict[str, dict[str, object]] = {
    "orthographic": {"camera": {**CAMERA, "type": "orthographic", "height": 3.0}},
    "fisheye": {"camera": {**CAMERA, "type": "fisheye", "vertical_fov": 190.0}},
    "panoramic": {"camera": {**CAMERA, "type": "panoramic"}},
    "lens with blades": {"camera": {**CAMERA, "aperture_radius": 0.1, "focus_distance": 3.3, "blades": 6}},
    "mirrored and exposed": {"camera": {**CAMERA, "mirrored": True, "f_stop": 8.0, "shutter": 0.01, "iso": 200.0}},
    "spot": {
        "lights": [
            {"type": "spot", "position": [0, 3, 0], "direction": [0, -1, 0.1], "intensity": [1, 2, 3], "blend": 0.3}
            | {"cone_degrees": 40.0}
        ]
    },
    "sky": {"lights": [{"type": "sun_sky", "sun_direction": [0.1, 0.8, 0.3], "turbidity": 3.3, "sun_scale": 0.5}]},
    "media and fog": {
        "media": {"milk": {"scattering": [3, 2, 1], "g": 0.4}, "haze": {"absorption": 0.01, "scattering": 0.1}},
        "fog": "haze",
        "shapes": [{**BALL, "interior": "milk"}, {"type": "box", "size": [1, 1, 1], "interior": "milk"}],
    },
    "opacity": {
        "materials": {
            "glass": {"type": "lambert", "reflectance": [0.1, 0.2, 0.3], "opacity": {"checker": [0.25, 1.0]}},
            "cut": {"type": "mirror", "reflectance": [1, 1, 1], "opacity": 0.5, "opacity_cutoff": 0.4},
        },
        "shapes": [BALL, {**BALL, "material": "cut"}],
    },
    "names": {"shapes": [{**BALL, "name": 'K\u00f6nig "a" \\ 1'}]},
}


@pytest.mark.parametrize("ending", [".toml", ".json"])
@pytest.mark.parametrize("feature", FEATURES)
def test_features(tmp_path: Path, feature: str, ending: str) -> None:
    plain = {"camera": CAMERA, "materials": {"glass": {"type": "dielectric", "ior": 1.4}}, "shapes": [BALL]}
    scene = Scene.model_validate({**plain, **FEATURES[feature]})
    again = written(scene, tmp_path / f"out{ending}")
    assert again.sha256() == scene.sha256() and again.camera == scene.camera
    assert [shape.name for shape in again.shapes] == [shape.name for shape in scene.shapes]
    assert flatten(again, 8, 8).sha256 == flatten(scene, 8, 8).sha256


REFUSED = {
    "obj-ply/OBJ/number_formats.obj",  # a number without digits before its exponent
    "osl-testrender/render-furnace-diffuse/scene.xml",  # another program's
    "osl-testrender/render-oren-nayar/scene.xml",
}


def test_choices_are_passed_on(tmp_path: Path) -> None:
    for option, value in (("--up", "y"), ("--variant", "red")):
        with pytest.raises(SceneError, match=option[2:]):
            convert("room", tmp_path / "out.toml", option, value)


def assets() -> Iterator[Path]:
    return (path for path in sorted(ASSETS.rglob("*")) if path.suffix in ENDINGS and "invalid" not in str(path))


@needs_assets
@pytest.mark.parametrize(
    "folder", ["meshes", "obj-ply", "ignis-eval", pytest.param("", marks=pytest.mark.slow, id="all")]
)
def test_assets(tmp_path: Path, folder: str) -> None:
    read = 0
    for path in assets():
        if not path.is_relative_to(ASSETS / folder):
            continue
        try:
            scene = clrender.load(path, allow_paths=[ASSETS])
        except SceneError:
            assert path.relative_to(ASSETS).as_posix() in REFUSED
            continue
        assert written(scene, tmp_path / "out.toml").sha256() == scene.sha256(), path
        read += 1
        shutil.rmtree(tmp_path / "out-files", ignore_errors=True)
    assert read >= 4


# --- meshes -----------------------------------------------------------------------------------------------------------

RNG = np.random.default_rng(1)
WHOLE = MeshData(
    RNG.normal(size=(70_000, 3)),
    RNG.integers(0, 70_000, (100_000, 3)).astype(np.uint32),
    RNG.normal(size=(70_000, 3)).astype(np.float32),
    uvs=RNG.normal(size=(100_000, 3, 2)).astype(np.float32),
    uvs_1=RNG.normal(size=(100_000, 3, 2)).astype(np.float32),
    colors=RNG.random((100_000, 3, 3)).astype(np.float32),
)


@pytest.mark.parametrize(
    "mesh",
    [
        WHOLE,
        dataclasses.replace(WHOLE, vertices=WHOLE.vertices.astype(np.float32)),
        dataclasses.replace(WHOLE, normals=None, uvs=None),
        dataclasses.replace(WHOLE, uvs_1=None, colors=None),
        dataclasses.replace(WHOLE, vertices=-0.0 * WHOLE.vertices),
    ],
)
def test_every_bit_of_a_mesh(tmp_path: Path, mesh: MeshData) -> None:
    with (tmp_path / "m.ply").open("wb") as file:
        write_ply(file, mesh)
    again = read_mesh("m.ply", tmp_path, (), "x", None if mesh.colors is None else "srgb")
    for name in ("vertices", "triangles", "normals", "uvs", "uvs_1", "colors"):
        before, after = getattr(mesh, name), getattr(again, name)
        assert (before is None) == (after is None), name
        if before is not None:
            assert np.array_equal(after, before) and np.array_equal(np.signbit(after), np.signbit(before)), name
    assert again.sha256() == mesh.sha256()


# --- whatever a scene names -------------------------------------------------------------------------------------------


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A scene with everything in it, whose file names are as bad as they get."""
    base = tmp_path / "in"
    (base / "sub").mkdir(parents=True)
    Image.fromarray(RNG.integers(0, 255, (5, 7, 3), np.uint8)).save(base / "A b.png")
    Image.fromarray(RNG.integers(0, 255, (5, 7, 3), np.uint8)).save(base / "sub" / "a_B.png")
    Image.fromarray(RNG.integers(0, 255, (8, 8, 3), np.uint8)).save(base / "sub" / "\u00fc \u00e4.jpg")
    write_image(base / "around.exr", RNG.random((4, 8, 3)).astype(np.float32), None)
    (base / "m.ply").write_text(
        "ply\nformat ascii 1.0\nelement vertex 3\nproperty double x\nproperty float y\nproperty float z\n"
        "property float s\nproperty float t\nproperty uchar red\nproperty uchar green\nproperty uchar blue\n"
        "element face 1\nproperty list uchar int vertex_indices\nend_header\n"
        "0.1 0 0 0 0 9 8 7\n1 0 0 1 0 6 5 4\n0 1 0 0 1 3 2 1\n3 0 1 2\n"
    )
    lamp = (ROOT / "scenes" / "scallop.ies").read_text()
    (base / "lamp.ies").write_text(lamp.replace("TILT=NONE", "TILT=sub/tilt.dat"))
    (base / "sub" / "tilt.dat").write_text("1\n3\n0 45 90\n1.0 0.9 0.5\n")
    (base / "scene.toml").write_text(
        """title = "Ein \\"Titel\\" \\\\ \\u00fc"
        [camera]
        position = [1e-30, 0.1, 12345678901234567.0e-12]
        target = [-0.0, 0, 0]
        [render]
        spp = 3
        integrator = "direct"
        [materials."a.b \\" c"]
        type = "principled"
        base_color = { texture = "A b.png", scale = [0.1, 0.2, 0.3] }
        roughness = { texture = "sub/a_B.png", wrap = ["clamp", "mirror"], transform = { scale = 3 } }
        normal_map = { texture = "sub/\u00fc \u00e4.jpg" }
        [[shapes]]
        type = "mesh"
        file = "m.ply"
        material = "a.b \\" c"
        vertex_colors = "srgb"
        transform = { matrix = [1, 0, 0, 0.1, 0, 2, 0, 0, 0, 0, 3, 0, 0, 0, 0, 1] }
        [[shapes]]
        type = "mesh"
        file = "m.ply"
        emission = { checker = [0.1, [1, 2, 3]], size = 0.25 }
        [[shapes]]
        type = "mesh"
        vertices = [[0, 0, 0], [1, 0, 0], [0, 1, 0.1]]
        faces = [[0, 1, 2]]
        [[lights]]
        type = "ies"
        position = [0, 1, 0]
        direction = [0.1, -1, 0]
        file = "lamp.ies"
        [[lights]]
        type = "environment"
        file = "around.exr"
        rotate_degrees = 33.3
        """,
        encoding="utf-8",
    )
    return base


@pytest.mark.parametrize("ending", [".toml", ".json"])
def test_everything_that_a_scene_may_name(folder: Path, tmp_path: Path, ending: str) -> None:
    output = tmp_path / "out" / f"my scene{ending}"
    output.parent.mkdir()
    convert(folder / "scene.toml", output)
    scene = clrender.load(folder / "scene.toml")
    hashes, flat = scene.sha256(), flatten(scene, 8, 8).arrays_sha256
    shutil.rmtree(folder)  # nothing of it is needed any more
    again = clrender.load(output)
    assert (
        again.sha256() == hashes
        and flatten(again, 8, 8).arrays_sha256 == flat
        and again.title == 'Ein "Titel" \\ \u00fc'
    )
    names = [path.name for path in (tmp_path / "out" / "my scene-files").iterdir()]
    # Two meshes of one file: with colours, and without
    assert len(names) == len({name.lower() for name in names}) == 7
    assert all(name.isascii() and " " not in name for name in names)
    assert {name.partition("-")[0] for name in names} == {"a", "a_b", "file", "around", "m", "lamp"}
    convert(output, tmp_path / f"again{ending}")
    assert clrender.load(tmp_path / f"again{ending}").sha256() == hashes


def test_pictures_are_copied_as_they_are(folder: Path, tmp_path: Path) -> None:
    convert(folder / "scene.toml", tmp_path / "out.toml")
    for name, ending in (("A b.png", "a-b-*.png"), ("around.exr", "around-*.exr")):
        (copy,) = (tmp_path / "out-files").glob(ending)
        assert copy.read_bytes() == (folder / name).read_bytes()


def test_model_with_its_own_camera_and_light(tmp_path: Path) -> None:
    (tmp_path / "m.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    convert(tmp_path / "m.obj", tmp_path / "out.toml")
    scene = clrender.load(tmp_path / "out.toml")
    assert scene.sha256() == clrender.load(tmp_path / "m.obj").sha256() and not scene.notes


# --- the command ------------------------------------------------------------------------------------------------------


def test_overwriting(folder: Path, tmp_path: Path) -> None:
    output = tmp_path / "out.toml"
    output.write_text("precious")
    with pytest.raises(UsageError, match="exists already; choose another name, or overwrite it with --force"):
        convert(folder / "scene.toml", output)
    assert output.read_text() == "precious" and not (tmp_path / "out-files").exists()
    convert(folder / "scene.toml", output, "--force")
    before = {path: path.read_bytes() for path in (tmp_path / "out-files").iterdir()}
    convert(folder / "scene.toml", output, "--force")
    assert before == {path: path.read_bytes() for path in (tmp_path / "out-files").iterdir()}


def test_what_is_not_written(folder: Path, tmp_path: Path) -> None:
    for output, expected in (
        (tmp_path / "out.obj", "is not that of a scene file"),
        (tmp_path / "none" / "out.toml", "there is no folder"),
        (folder / "scene.toml", "is an input of this command"),
        (tmp_path, "is not that of a scene file"),
    ):
        with pytest.raises(UsageError, match=expected):
            convert(folder / "scene.toml", output, "--force")
    (tmp_path / "out-files").write_text("a file")
    with pytest.raises(UsageError, match="out-files"):
        convert(folder / "scene.toml", tmp_path / "out.toml")
    assert not (tmp_path / "out.toml").exists() and (tmp_path / "out-files").read_text() == "a file"
    with pytest.raises(click.UsageError):
        convert(folder / "scene.toml")


def test_a_failure_leaves_nothing(folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fails(file: IO[bytes], mesh: MeshData) -> None:
        file.write(b"half")
        raise KeyboardInterrupt

    monkeypatch.setattr("clrender.exporters.own.write_ply", fails)
    (tmp_path / "out-files").mkdir()
    (tmp_path / "out-files" / "mine").write_text("x")
    with pytest.raises(click.Abort):
        convert(folder / "scene.toml", tmp_path / "out.toml")
    with pytest.raises(click.Abort):
        convert(folder / "scene.toml", tmp_path / "other.toml")
    assert [path.name for path in sorted(tmp_path.rglob("*")) if "in" not in path.relative_to(tmp_path).parts] == [
        "out-files",
        "mine",
    ]
