"""Arithmetic of the host has the same bits on every processor: a scene has one hash, whatever BLAS and libraries do."""

from __future__ import annotations

import importlib
import importlib.util
import json
import math
import os
import random
import subprocess
import sys
from collections.abc import Callable
from decimal import Decimal, localcontext
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from cases import for_each
from gltf_files import Model
from peer_scenes import MITSUBA, MITSUBA_06, PBRT, write_parts

from clrender.exact import angles, elementary, matrices
from clrender.image.tone_map import srgb_decode
from clrender.importers.shared.meshes import smoothed, sphere_mesh
from clrender.meshes.data import MeshData

ROOT = Path(__file__).resolve().parents[2]

# --- one hash per file, in processes that see other processors

_CHILD = """
import json, sys
import clrender
moment = {path: {"time_at": 0.4} if path.endswith(".glb") else {} for path in sys.argv[1:]}
print(json.dumps({path: clrender.load(path, **moment[path]).sha256() for path in sys.argv[1:]}))
"""


def _processors() -> dict[str, dict[str, str]]:
    """Environments in which libraries take the code of other processors than this one's."""
    newer = np.lib.NumpyVersion(np.__version__) >= "2.0.0"
    core = importlib.import_module(f"numpy.{'_core' if newer else 'core'}._multiarray_umath")
    features = " ".join(core.__cpu_dispatch__)
    old = "glibc.cpu.hwcaps=-AVX512F,-AVX2,-FMA,-FMA4,-AVX2_Usable,-FMA_Usable"
    return {
        "this one": {},
        "Haswell": {"OPENBLAS_CORETYPE": "Haswell"},
        "Sandybridge": {
            "OPENBLAS_CORETYPE": "Sandybridge",
            "NPY_DISABLE_CPU_FEATURES": features,
            "GLIBC_TUNABLES": old,
        },
        "SkylakeX": {"OPENBLAS_CORETYPE": "SkylakeX"},
    }


def _turned(rng: random.Random, count: int) -> tuple[str, str]:
    """Shapes and lights with odd transforms, for Mitsuba and for pbrt."""
    mitsuba, pbrt = [], []
    for _ in range(count):
        angle, x, y, z = rng.uniform(-200, 200), rng.uniform(-1, 1), rng.uniform(-1, 1), rng.uniform(0.1, 1)
        steps = (
            f'<rotate x="{x}" y="{y}" z="{z}" angle="{angle}"/><scale x="{z}" y="1.3" z="{1 + x * x}"/>'
            f'<lookat origin="{x}, {y}, {z}" target="3, {x}, 2" up="0, 1, {y}"/><rotate y="1" angle="{angle / 3}"/>'
        )
        mitsuba += [
            f'<shape type="{kind}"><transform name="to_world">{steps}</transform></shape>'
            for kind in ("sphere", "disk", "cube", "rectangle")
        ]
        mitsuba.append(
            f'<shape type="cylinder"><point name="p1" x="{x}" y="{y}" z="{z}"/>'
            f'<transform name="to_world">{steps}</transform></shape>'
            f'<shape type="ply"><string name="filename" value="bumpy.ply"/><transform name="to_world">{steps}'
            f'</transform><emitter type="area"><blackbody name="radiance" temperature="{4000 + 3000 * x}K"/></emitter>'
            f'</shape><emitter type="spot"><transform name="to_world">{steps}</transform>'
            f'<spectrum name="intensity" value="400:{z}, 520:{1 + x}, 700:{2 + y}"/>'
            f'<float name="cutoff_angle" value="{30 + 20 * x}"/></emitter>'
        )
        moved = f"Rotate {angle} {x} {y} {z} LookAt {x} {y} {z} 3 {x} 2 0 1 {y} Rotate {angle / 3} 0 1 0"
        pbrt.append(
            f'AttributeBegin {moved} Scale 1.3 {z} 1 AreaLightSource "diffuse" "blackbody L" {4000 + 3000 * x} '
            f'"float power" 20 "bool twosided" true Shape "disk" "float radius" {z} AttributeEnd\n'
            f'AttributeBegin {moved} AreaLightSource "diffuse" "float power" 9 Shape "sphere" "float radius" {z} '
            f'AttributeEnd AttributeBegin {moved} LightSource "spot" "spectrum I" [400 {z} 700 3] AttributeEnd\n'
        )
    return "\n".join(mitsuba), "\n".join(pbrt)


def _moving_model() -> Model:
    """A model with animated rotation, a turned texture, a spot and a camera."""
    model = Model()
    texture = model.texture(np.arange(48).reshape(4, 4, 3) * 5)
    model.extend("KHR_texture_transform", "KHR_lights_punctual")
    picture = {"index": texture, "extensions": {"KHR_texture_transform": {"rotation": 0.7, "offset": [0.2, 0.3]}}}
    material = model.add("materials", {"pbrMetallicRoughness": {"baseColorTexture": picture}, "normalTexture": picture})
    rng = np.random.default_rng(5)
    model.node(mesh=model.quad(material), rotation=[0.0, 0.0, 0.0, 1.0])
    spot = {"type": "spot", "spot": {"innerConeAngle": 0.31, "outerConeAngle": 0.77}}
    model.root["extensions"] = {"KHR_lights_punctual": {"lights": [spot]}}
    model.node(extensions={"KHR_lights_punctual": {"light": 0}}, translation=[0.1, 2.0, 3.0])
    turns = rng.normal(size=(3, 4))
    turns /= np.sqrt((turns * turns).sum(axis=1))[:, None]
    sampler = {"input": model.times([0.0, 0.5, 1.0]), "output": model.accessor(turns)}
    channel = {"sampler": 0, "target": {"node": 0, "path": "rotation"}}
    model.add("animations", {"samplers": [sampler], "channels": [channel]})
    return model


def _write(folder: Path) -> list[Path]:
    write_parts(folder)
    rng = random.Random(7)
    mitsuba, pbrt = _turned(rng, 6)
    vertices = "".join(f"{rng.uniform(-1, 1)} {rng.uniform(-1, 1)} {rng.uniform(-1, 1)}\n" for _ in range(60))
    corners = [rng.sample(range(60), 3) for _ in range(90)]
    faces = "".join(f"3 {a} {b} {c}\n" for a, b, c in corners)
    head = "ply\nformat ascii 1.0\nelement vertex 60\nproperty float x\nproperty float y\nproperty float z\n"
    head += "element face 90\nproperty list uchar int vertex_indices\nend_header\n"
    (folder / "bumpy.ply").write_text(head + vertices + faces)
    obj = "mtllib m.mtl\nusemtl m\n" + "".join(f"v {line}\n" for line in vertices.splitlines())
    (folder / "m.obj").write_text(obj + "".join(f"f {a + 1} {b + 1} {c + 1}\n" for a, b, c in corners))
    (folder / "m.mtl").write_text("newmtl m\nKd 0.3 0.5 0.7\nKs 0.2 0.2 0.2\nNs 37\n")
    solid = b"".join(np.zeros(3, "<f4").tobytes() + bytes([7 * i % 90, 0, 128, 63] * 9) + b"\0\0" for i in range(20))
    (folder / "m.stl").write_bytes(bytes(80) + (20).to_bytes(4, "little") + solid)
    (folder / "a.xml").write_text(MITSUBA.replace("</scene>", mitsuba + "</scene>"))
    (folder / "old.xml").write_text(MITSUBA_06)
    (folder / "a.pbrt").write_text(PBRT + pbrt)
    _moving_model().write(folder / "a.glb")
    primaries = "0.7 0.29 0.2 0.7 0.14 0.05 0.33 0.34"
    head = f"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\nPRIMARIES={primaries}\n\n-Y 4 +X 8\n"
    (folder / "wide.hdr").write_bytes(
        head.encode() + b"".join(bytes([90 + 7 * i % 60, 90, 80 + i, 129]) for i in range(32))
    )
    camera = "[camera]\nposition = [0.0, 0.0, 3.0]\ntarget = [0.0, 0.0, 0.0]\n"
    (folder / "a.toml").write_text(camera + '[[lights]]\ntype = "environment"\nfile = "wide.hdr"\n')
    names = ("a.toml", "a.xml", "old.xml", "a.pbrt", "a.glb", "m.obj", "bumpy.ply", "m.stl")
    return [folder / name for name in names]


@pytest.mark.long
def test_a_scene_has_one_hash_on_all_processors(tmp_path: Path) -> None:
    paths = [str(path) for path in _write(tmp_path)]
    children = {
        name: subprocess.Popen(
            [sys.executable, "-c", _CHILD, *paths],
            env={**os.environ, **environment},
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
        )
        for name, environment in _processors().items()
    }
    said = {name: child.communicate(timeout=240) for name, child in children.items()}
    assert not any(child.returncode for child in children.values()), said
    found = {name: json.loads(out) for name, (out, _) in said.items()}
    expected = found["this one"]
    assert len(set(expected.values())) == len(paths)
    for name, hashes in found.items():
        differing = [Path(path).name for path in paths if hashes[path] != expected[path]]
        assert not differing, f"{differing} have another hash with the code for {name}"


# --- the functions themselves


def _decimal_sine(x: float) -> float:
    with localcontext() as context:
        context.prec = 80
        term = total = Decimal(x)
        n = 1
        while abs(term) > Decimal("1e-60"):
            n += 2
            term = -term * Decimal(x) * Decimal(x) / (n * (n - 1))
            total += term
    return float(total)


def test_elementary_functions_of_numbers_are_rounded_correctly() -> None:
    rng = random.Random(1)
    for x in [rng.uniform(-7.0, 7.0) for _ in range(300)] + [0.0, 1e-300, 1e-17, math.pi, -math.pi / 2.0]:
        sine, cosine = angles.sin_cos(x)
        assert sine == _decimal_sine(x)
        assert abs(sine * sine + cosine * cosine - 1.0) < 4e-16
        assert angles.tangent(x) == pytest.approx(math.tan(x), rel=4e-16)
        y = rng.uniform(-3.0, 3.0)
        assert angles.angle_of(y, x) == pytest.approx(math.atan2(y, x), rel=4e-16)
        assert angles.arccosine(y / 3.0) == pytest.approx(math.acos(y / 3.0), rel=4e-16)
        assert angles.root(abs(x), 3) == pytest.approx(abs(x) ** (1.0 / 3.0), rel=4e-16)
        assert angles.exponential_minus_one(abs(x)) == pytest.approx(math.expm1(abs(x)), rel=4e-16)
    assert angles.exponential_minus_one(1e4) == math.inf
    signed = (0.0, -0.0, 1.0, -1.0, 1e-19, -1e-19, 5e-324, 1e300)
    for y in signed:
        for x in signed:
            assert math.copysign(1.0, angles.angle_of(y, x)) == math.copysign(1.0, math.atan2(y, x))
            assert angles.angle_of(y, x) == pytest.approx(math.atan2(y, x), rel=4e-16, abs=0.0)


def test_elementary_functions_of_arrays() -> None:
    rng = np.random.default_rng(3)
    x, y = rng.uniform(-50.0, 50.0, 20000), rng.normal(size=20000)
    sines, cosines = elementary.sines_cosines(x)
    assert max(np.abs(sines - np.sin(x)).max(), np.abs(cosines - np.cos(x)).max()) < 4e-16
    assert np.abs(elementary.angles_of(y, x) - np.arctan2(y, x)).max() < 2e-15
    positive = rng.uniform(0.05, 2.0, 20000)
    assert np.abs(elementary.power_two_fifths(positive) / positive**0.4 - 1.0).max() < 1e-15
    codes = np.arange(65536) / 65535.0
    plain = np.where(codes <= 0.04045, codes / 12.92, ((codes + 0.055) / 1.055) ** 2.4)
    assert (srgb_decode(codes).astype(np.float32) == plain.astype(np.float32)).mean() > 0.9999


def test_small_matrices() -> None:
    rng = np.random.default_rng(4)
    a, b, points = rng.normal(size=(4, 4)), rng.normal(size=(4, 4)), rng.normal(size=(50, 4))
    np.testing.assert_allclose(matrices.product(a, b), a @ b, atol=1e-14)
    np.testing.assert_allclose(matrices.times(a, points), points @ a.T, atol=1e-14)
    np.testing.assert_allclose(matrices.times(a, points[0]), a @ points[0], atol=1e-14)
    np.testing.assert_allclose(matrices.inverse(a) @ a, np.eye(4), atol=1e-13)
    np.testing.assert_allclose(matrices.determinant(a[:3, :3]), np.linalg.det(a[:3, :3]), rtol=1e-13)
    np.testing.assert_allclose(matrices.lengths(points), np.linalg.norm(points, axis=1), rtol=1e-15)
    assert matrices.product(a, np.eye(4)).tolist() == a.tolist()
    assert matrices.inverse(np.diag([2.0, -4.0, 0.5])).tolist() == np.diag([0.5, -0.25, 2.0]).tolist()
    for singular in (np.zeros((3, 3)), [[1.0, 2.0], [2.0, 4.0]], [[math.nan, 0.0], [0.0, 1.0]]):
        with pytest.raises(ValueError, match="cannot be inverted"):
            matrices.inverse(singular)
    places, values = np.sort(rng.uniform(0.0, 9.0, 12)), rng.normal(size=12)
    at = np.concatenate([rng.uniform(-1.0, 10.0, 500), places])
    assert matrices.interpolated(at, places, values).tolist() == np.interp(at, places, values).tolist()
    zeroed = np.interp(at, places, values, left=0.0, right=0.0)
    assert matrices.interpolated(at, places, values, 0.0).tolist() == zeroed.tolist()
    assert matrices.interpolated(3.0, [1.0], [2.0]) == 2.0
    assert matrices.total(values) == pytest.approx(values.sum())


def test_meshes_are_where_they_were() -> None:
    mesh = sphere_mesh(2.0)
    np.testing.assert_allclose(np.linalg.norm(mesh.vertices, axis=1), 2.0, rtol=1e-7)
    assert np.abs(mesh.vertices.max(axis=0) - 2.0).max() < 1e-6
    bare = MeshData(mesh.vertices, mesh.triangles)
    normals = np.asarray(smoothed(bare).normals, np.float64)
    sizes = np.linalg.norm(normals, axis=1)
    used = sizes > 0.0  # each pole is there once for each column of the grid
    away = (normals[used] * bare.vertices[used]).sum(axis=1) / sizes[used] / 2.0
    assert used.mean() > 0.97
    assert np.median(np.abs(away)) > 0.999


# --- the linter


def _linter() -> ModuleType:
    spec = importlib.util.spec_from_file_location("lint_host", ROOT / "scripts" / "lint_host.py")
    assert spec and spec.loader
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


LINTER = _linter()
lint_text: Callable[[str, str], list[str]] = LINTER.lint_text


def test_the_host_keeps_its_rules() -> None:
    assert LINTER.lint(ROOT / "clrender") == []


@for_each(
    "line",
    [
        *("a @ b", "a @= b", "np.dot(a, b)", "a.dot(b)", "np.linalg.norm(a)", "numpy.einsum('ij,j', a, b)"),
        *("np.sin(x)", "math.atan2(y, x)", "x ** 0.5", "x ** 2", "x **= 3", "np.power(x, 2.4)", "math.hypot(x, y)"),
        *("from math import cos", "from numpy import matmul, ones", "np.interp(x, a, b)"),
    ],
)
def test_the_linter_finds(line: str) -> None:
    faults = lint_text("scene/a.py", f"import numpy as np\n\n{line}\n")
    assert faults and faults[0].startswith("scene/a.py:3: ")


def test_the_linter_leaves_good_code_alone() -> None:
    good = "'np.dot'  # a @ b", "x = 2**20 + 10**n + 2.0**k", "np.cross(a, b)", "math.sqrt(x)", "inner(a, b)", "log(x)"
    assert lint_text("a.py", "\n".join(good)) == []
