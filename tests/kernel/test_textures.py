"""Textures against NumPy: every format, wrap mode, filter, transform and set of coordinates; normal and bump maps."""

from __future__ import annotations

import itertools
import math
import struct
import zlib
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import numpy as np
import numpy.typing as npt
import pytest
from cases import for_each
from kernel_support import FOLDER
from PIL import Image

import clrender
from clrender.device import scene_arrays
from clrender.device.scene_arrays import texel_pages
from clrender.flatten.texture_rows import FlatTextures, flat_textures
from clrender.image.files import write_image
from clrender.image.tone_map import srgb_decode
from clrender.scene import Scene

if TYPE_CHECKING:
    from clrender.device import Device
    from clrender.device.device import Buffer

Floats = npt.NDArray[np.float64]

SOURCE = FOLDER / "textures.cl"
COUNT = 2048
RNG = np.random.default_rng(700)
BYTES = RNG.integers(0, 256, (13, 10, 4), np.uint8)
WORDS = RNG.integers(0, 65536, (13, 10, 3), np.uint16)
FLOATS = RNG.random((13, 10, 3)).astype(np.float32)


def textured(folder: Path, name: str = "reflectance", **texture: Any) -> Scene:
    """A scene whose one material has one texture."""
    material = {"type": "lambert", "reflectance": [0.5] * 3, name: texture}
    camera = {"position": [0, 0, 5], "target": [0, 0, 0]}
    return Scene(camera=camera, materials={"m": material}).placed("here", folder)


def launch(
    device: Device, kernel: str, points: npt.NDArray[Any], outputs: int, *more: Any, defines: Mapping[str, int]
) -> Floats:
    """(outputs, count) results of a kernel of textures.cl, in 8 lanes if nothing else is said."""
    count = points.shape[1]
    given = device.upload(np.ascontiguousarray(points, np.float32))
    results = device.empty(4 * outputs * count)
    program = device.program(SOURCE, {"LANES": 8, **defines})
    device.launch(program, kernel, count // defines.get("LANES", 8), 16, [given, *more, np.uint32(count), results])
    out = np.empty((outputs, count), np.float32)
    device.read(results, out)
    for buffer in (given, results):
        device.release(buffer)
    return out.astype(np.float64)


@contextmanager
def uploaded(device: Device, flat: FlatTextures) -> Iterator[tuple[list[Buffer], dict[str, int]]]:
    """Arguments of the kernels that read textures, and their definitions."""
    pages, bits = texel_pages(device, flat.texels)
    buffers = [device.upload(flat.rows), device.upload(flat.values)]
    yield [*buffers, *pages], {} if bits is None else {"TEXEL_PAGE_BITS": bits}
    for buffer in dict.fromkeys([*buffers, *pages]):
        device.release(buffer)


def values(device: Device, scene: Scene, points: Floats, random: bool = False, lanes: int = 16) -> Floats:
    """(count, 6): value, and normal of a normal map, at (count, 2 or 4) points."""
    whole = np.zeros((4, len(points)))
    whole[: points.shape[1]] = points.T
    with uploaded(device, flat_textures(scene)) as (buffers, defines):
        more = [*buffers, np.uint32(0), np.uint32(random)]
        return launch(device, "texture_values", whole, 6, *more, defines={**defines, "LANES": lanes}).T


def some_points(spread: float = 2.0) -> Floats:
    rng = np.random.default_rng(701)
    return rng.uniform(-spread, spread, (COUNT, 2)).astype(np.float32).astype(np.float64)


# --- what the kernels shall do, in double precision -------------------------------------------------------------------

WRAPS: Mapping[str, Callable[[npt.NDArray[np.int64], int], npt.NDArray[np.int64]]] = {
    "repeat": np.mod,
    "clamp": lambda i, n: np.clip(i, 0, n - 1),
    "mirror": lambda i, n: np.where(np.mod(i, 2 * n) < n, np.mod(i, 2 * n), 2 * n - 1 - np.mod(i, 2 * n)),
}


def looked_up(picture: Floats, points: Floats, wraps: tuple[str, str], linear: bool = True) -> Floats:
    """Values of a picture (rows from its top) at texture coordinates whose (0, 0) is its lower left corner."""
    height, width = picture.shape[:2]
    x, y = points[:, 0] * width, (1.0 - points[:, 1]) * height

    def texel(column: Floats, row: Floats) -> Floats:
        across, down = WRAPS[wraps[0]](column.astype(np.int64), width), WRAPS[wraps[1]](row.astype(np.int64), height)
        return picture[down, across].reshape(len(points), -1)

    if not linear:
        return texel(np.floor(x), np.floor(y))
    left, top = np.floor(x - 0.5), np.floor(y - 0.5)
    a, b = (x - 0.5 - left)[:, None], (y - 0.5 - top)[:, None]
    above = texel(left, top) * (1 - a) + texel(left + 1, top) * a
    below = texel(left, top + 1) * (1 - a) + texel(left + 1, top + 1) * a
    value: Floats = above * (1 - b) + below * b
    return value


def unambiguous(points: Floats, width: int, height: int) -> npt.NDArray[np.bool_]:
    """Points that rounding cannot move to another texel."""
    x, y = points[:, 0] * width, points[:, 1] * height
    return (np.abs(x - np.round(x)) > 1e-4) & (np.abs(y - np.round(y)) > 1e-4)


# --- files and formats ------------------------------------------------------------------------------------------------


def files() -> dict[str, tuple[Callable[[Path], None], Floats, dict[str, Any]]]:
    """How each kind of file is written, and the values that it shall have."""
    share, deep = BYTES / 255.0, WORDS / 65535.0
    grey, color = Image.fromarray(BYTES[..., 0]), Image.fromarray(BYTES[..., :3])
    paletted = color.quantize(16)
    half = FLOATS.astype(np.float16).astype(np.float32)
    found: dict[str, tuple[Callable[[Path], None], Floats, dict[str, Any]]] = {
        "rgb.png": (color.save, srgb_decode(share[..., :3]), {}),
        "linear.png": (color.save, share[..., :3], {"color_space": "linear"}),
        "rgba.png": (Image.fromarray(BYTES).save, srgb_decode(share[..., :3]), {}),
        "grey.png": (grey.save, srgb_decode(share[..., :1].repeat(3, 2)), {}),
        "alpha.png": (Image.fromarray(BYTES).save, share[..., 3:].repeat(3, 2), {"channel": "a"}),
        "green.png": (color.save, srgb_decode(share[..., 1:2].repeat(3, 2)), {"channel": "g"}),
        "palette.png": (paletted.save, srgb_decode(np.asarray(paletted.convert("RGB")) / 255.0), {}),
        "grey-alpha.png": (Image.fromarray(BYTES[..., :2], "LA").save, srgb_decode(share[..., :1].repeat(3, 2)), {}),
        "lossless.webp": (
            lambda path: color.save(path, lossless=True, quality=0),
            srgb_decode(share[..., :3]),
            {"scale": [0.5, 0.25, 1.0]},
        ),
        "deep.png": (Image.fromarray(WORDS[..., 0]).save, srgb_decode(deep[..., :1].repeat(3, 2)), {}),
        "deep-linear.png": (
            Image.fromarray(WORDS[..., 0]).save,
            deep[..., :1].repeat(3, 2),
            {"color_space": "linear"},
        ),
        "float.exr": (lambda path: write_image(path, FLOATS), FLOATS.astype(np.float64), {}),
        "half.exr": (lambda path: write_image(path, half), half.astype(np.float64), {}),
        "grey.exr": (
            lambda path: write_image(path, FLOATS[..., :1].repeat(3, 2)),
            FLOATS[..., :1].repeat(3, 2).astype(np.float64),
            {},
        ),
        "luminance.exr": (
            lambda path: write_image(path, FLOATS),
            (FLOATS @ [0.2126, 0.7152, 0.0722])[..., None].repeat(3, 2),
            {"channel": "luminance"},
        ),
    }
    return found


@for_each("name", files())
def test_every_kind_of_file(device: Device, tmp_path: Path, name: str) -> None:
    write, expected, keys = files()[name]
    write(tmp_path / name)
    scene = textured(tmp_path, texture=name, filter="nearest", **keys)
    points = some_points()
    points = points[unambiguous(points, 10, 13)][: COUNT // 2]
    found = values(device, scene, points)[:, :3]
    factor = np.array(keys.get("scale", [1.0] * 3))
    exact = looked_up(expected, points, ("repeat", "repeat"), linear=False) * factor
    np.testing.assert_allclose(found, exact, rtol=2e-7, atol=1e-9)


def test_lossy_pictures_are_what_pillow_says(device: Device, tmp_path: Path) -> None:
    Image.fromarray(BYTES[..., :3]).save(tmp_path / "a.jpg")
    Image.fromarray(BYTES[..., :3]).convert("CMYK").save(tmp_path / "c.jpg")
    write_image(tmp_path / "h.hdr", FLOATS)
    decoded = {name: np.asarray(Image.open(tmp_path / name).convert("RGB")) for name in ("a.jpg", "c.jpg")}
    expected = {name: srgb_decode(each / 255.0) for name, each in decoded.items()}
    expected["h.hdr"] = clrender.image.files.read_image(tmp_path / "h.hdr").astype(np.float64)
    points = some_points()
    points = points[unambiguous(points, 10, 13)][: COUNT // 2]
    for name, picture in expected.items():
        found = values(device, textured(tmp_path, texture=name, filter="nearest"), points)[:, :3]
        exact = looked_up(picture, points, ("repeat", "repeat"), linear=False)
        np.testing.assert_allclose(found, exact, rtol=2e-7, atol=1e-9, err_msg=name)


def test_colours_of_sixteen_bits(device: Device, tmp_path: Path) -> None:
    """Written by hand, since Pillow writes none."""

    def chunk(kind: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    rows = b"".join(b"\0" + row.astype(">u2").tobytes() for row in WORDS)
    head = struct.pack(">IIBBBBB", 10, 13, 16, 2, 0, 0, 0)
    (tmp_path / "deep.png").write_bytes(
        b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", zlib.compress(rows)) + chunk(b"IEND", b"")
    )
    points = some_points()
    points = points[unambiguous(points, 10, 13)][: COUNT // 2]
    for space, expected in (("linear", WORDS / 65535.0), ("srgb", srgb_decode(WORDS / 65535.0))):
        scene = textured(tmp_path, texture="deep.png", color_space=space, filter="nearest")
        exact = looked_up(expected, points, ("repeat", "repeat"), linear=False)
        np.testing.assert_allclose(values(device, scene, points)[:, :3], exact, rtol=2e-7)


def test_the_table_of_srgb_is_exact(tmp_path: Path) -> None:
    """Rounded from values so far from the middle of two floats that no machine's power function rounds otherwise."""
    Image.fromarray(np.zeros((1, 1), np.uint8)).save(tmp_path / "a.png")
    table = flat_textures(textured(tmp_path, texture="a.png")).values[:256]
    linear = srgb_decode(np.arange(256) / 255.0)
    np.testing.assert_array_equal(table, linear.astype(np.float32))
    below, above = linear * (1.0 - 1e-13), linear * (1.0 + 1e-13)
    np.testing.assert_array_equal(below.astype(np.float32), above.astype(np.float32))
    assert np.all(np.round(clrender.image.tone_map.srgb_encode(table.astype(np.float64)) * 255.0) == np.arange(256))


# --- coordinates ------------------------------------------------------------------------------------------------------


@for_each("wraps", list(itertools.product(WRAPS, WRAPS)))
def test_wrap_modes(device: Device, tmp_path: Path, wraps: tuple[str, str]) -> None:
    write_image(tmp_path / "a.exr", FLOATS)
    points = some_points(3.0)
    for kind in ("linear", "nearest"):
        scene = textured(tmp_path, texture="a.exr", wrap=list(wraps), filter=kind)
        clear = np.ones(COUNT, bool) if kind == "linear" else unambiguous(points, 10, 13)
        found = values(device, scene, points)[clear, :3]
        expected = looked_up(FLOATS.astype(np.float64), points[clear], wraps, kind == "linear")
        np.testing.assert_allclose(found, expected, atol=2e-5 if kind == "linear" else 1e-7)


@pytest.mark.parametrize("size", [(1, 1), (1, 7), (5, 1), (17, 33)], ids=str)
def test_pictures_of_any_size(device: Device, tmp_path: Path, size: tuple[int, int]) -> None:
    picture = RNG.random((*size, 3)).astype(np.float32)
    bytes_ = RNG.integers(0, 256, size, np.uint8)
    write_image(tmp_path / "a.exr", picture)
    Image.fromarray(bytes_).save(tmp_path / "b.png")
    points = some_points()
    for wrap in WRAPS:
        for name, exact in (("a.exr", picture.astype(np.float64)), ("b.png", (bytes_ / 255.0)[..., None])):
            scene = textured(tmp_path, texture=name, wrap=wrap, color_space="linear")
            expected = looked_up(exact, points, (wrap, wrap))
            np.testing.assert_allclose(values(device, scene, points)[:, :3], expected + np.zeros(3), atol=3e-5)


def test_transforms(device: Device, tmp_path: Path) -> None:
    write_image(tmp_path / "a.exr", FLOATS)
    points = some_points()
    angle, scale, offset = 33.0, (1.5, -0.7), (0.25, -3.0)
    keys = {"rotate_degrees": angle, "scale": list(scale), "offset": list(offset)}
    c, s = math.cos(math.radians(angle)), math.sin(math.radians(angle))
    moved = (points * scale) @ np.array([[c, s], [-s, c]]) + offset
    found = values(device, textured(tmp_path, texture="a.exr", transform=keys), points)[:, :3]
    np.testing.assert_allclose(found, looked_up(FLOATS.astype(np.float64), moved, ("repeat", "repeat")), atol=3e-5)


def test_sets_of_coordinates(device: Device, tmp_path: Path) -> None:
    """The kernel gives them in exchanged order as set 1."""
    write_image(tmp_path / "a.exr", FLOATS)
    points = some_points()
    found = values(device, textured(tmp_path, texture="a.exr", uv_set=1), points)[:, :3]
    expected = looked_up(FLOATS.astype(np.float64), points[:, ::-1], ("repeat", "repeat"))
    np.testing.assert_allclose(found, expected, atol=2e-5)


def test_checker_and_ramp(device: Device, tmp_path: Path) -> None:
    points = some_points()
    scene = textured(tmp_path, checker=[[0.1, 0.2, 0.3], 0.9], size=[0.25, 0.5])
    odd = (np.floor(points[:, 0] / 0.25) + np.floor(points[:, 1] / 0.5)) % 2
    clear = unambiguous(points, 4, 2)
    expected = np.where(odd[:, None] == 0, [0.1, 0.2, 0.3], [0.9] * 3)
    np.testing.assert_allclose(values(device, scene, points)[clear, :3], expected[clear], atol=1e-7)
    stops = np.array([[0.0, 0.5, 1.0], [0.25, 0.25, 0.0], [1.0, 0.0, 0.5]])
    scene = textured(tmp_path, ramp=stops.tolist())
    expected = np.stack([np.interp(points[:, 0], [0.0, 0.5, 1.0], stops[:, k]) for k in range(3)], axis=1)
    for random in (False, True):  # it has no use for random numbers
        np.testing.assert_allclose(values(device, scene, points, random)[:, :3], expected, atol=1e-6)


def test_one_texel_at_random_has_the_mean_of_four(device: Device, tmp_path: Path) -> None:
    """z-tests at 64 points; a false alarm in 1e-4 of runs with other seeds (Šidák)."""
    write_image(tmp_path / "a.exr", FLOATS)
    scene = textured(tmp_path, texture="a.exr", wrap="mirror")
    rng = np.random.default_rng(702)
    points = rng.uniform(-2.0, 2.0, (64, 2)).astype(np.float32).astype(np.float64)
    n = 4096
    whole = np.concatenate([points.repeat(n, 0), rng.random((64 * n, 2), np.float32)], axis=1)
    found = values(device, scene, whole, random=True)[:, 0].reshape(64, n)
    expected = looked_up(FLOATS.astype(np.float64), points, ("mirror", "mirror"))[:, 0]
    z = (found.mean(axis=1) - expected) / (found.std(axis=1, ddof=1) / math.sqrt(n))
    assert np.abs(z).max() < 4.85, z
    assert len(np.unique(found[0])) <= 4


@pytest.mark.parametrize("lanes", [1, *(pytest.param(lanes, marks=pytest.mark.long) for lanes in (4, 16))])
def test_lanes_change_nothing(device: Device, tmp_path: Path, lanes: int) -> None:
    Image.fromarray(BYTES).save(tmp_path / "a.png")
    scene, points = textured(tmp_path, texture="a.png", wrap=["mirror", "clamp"]), some_points()
    np.testing.assert_array_equal(values(device, scene, points), values(device, scene, points, lanes=lanes))


def test_pages(device: Device, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Pictures that do not fit into one buffer, as if the largest were of four tiles; and too many."""
    picture = RNG.integers(0, 256, (16, 14, 3), np.uint8)
    Image.fromarray(picture).save(tmp_path / "a.png")
    scene, points = textured(tmp_path, texture="a.png"), some_points()
    whole = values(device, scene, points)
    monkeypatch.setattr(scene_arrays, "LARGEST_PAGE", 5 * 64)
    pages, bits = texel_pages(device, flat_textures(scene).texels)
    assert bits == 2 and len(set(pages)) == 4
    for page in set(pages):
        device.release(page)
    np.testing.assert_array_equal(values(device, scene, points), whole)
    monkeypatch.setattr(scene_arrays, "LARGEST_PAGE", 3 * 64)
    with pytest.raises(clrender.RenderError, match=r"takes 512 bytes of textures, but the scene has 1024; use smaller"):
        texel_pages(device, flat_textures(scene).texels)


class Shelf:
    """Stands for a device with much memory: it keeps the shapes of buffers alone."""

    max_allocation_bytes = 1 << 50

    def share(self, array: np.ndarray[Any, Any]) -> tuple[int, int]:
        return len(array), array.shape[1]


@pytest.mark.parametrize(("more", "bits"), [(0, None), (1, 28)])
def test_a_page_has_words_of_32_bits(more: int, bits: int | None) -> None:
    """Texels of 16 GiB, here without memory, are one page, whose last word has the largest address; more are two."""
    tiles = (1 << 28) + more
    texels = np.broadcast_to(np.zeros(64, np.uint8), (tiles, 64))
    pages, found = texel_pages(cast("Device", Shelf()), texels)
    shapes = cast("list[Any]", pages)
    assert found == bits
    assert set(shapes) == {(min(tiles, 1 << 28), 64), *([(more, 64)] if more else [])}
    assert all(count * 16 - 1 < 1 << 32 for count, _ in shapes)


# --- shapes -----------------------------------------------------------------------------------------------------------


def test_spheres(device: Device) -> None:
    rng = np.random.default_rng(703)
    directions = rng.normal(size=(COUNT, 3))
    directions[:6] = [(0, 1, 0), (0, -1, 0), (0, 0, 1), (1, 0, 0), (-1, 0, 0), (0, 1e-3, -1)]
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    out = launch(device, "texture_sphere", directions.T, 8, defines={}).T
    x, y, z = directions.T
    u = np.arctan2(x, z) / (2 * math.pi) + 0.5
    v = np.arcsin(np.clip(y, -1, 1)) / math.pi + 0.5
    away = np.abs(y) < 0.9999
    np.testing.assert_allclose(out[:, 1], v, atol=3e-7)
    np.testing.assert_allclose(out[away, 0], u[away], atol=2e-6)
    east = np.stack([z, np.zeros(COUNT), -x], axis=1) * 4 * math.pi
    north = np.cross(directions, np.stack([z, np.zeros(COUNT), -x], axis=1)) * 2 * math.pi
    north /= np.sqrt(x * x + z * z)[:, None] + 1e-30
    np.testing.assert_allclose(out[:, 2:5], east, atol=1e-5)
    np.testing.assert_allclose(out[away, 5:], north[away], atol=2e-3)


# --- normals ----------------------------------------------------------------------------------------------------------


def test_normal_maps(device: Device, tmp_path: Path) -> None:
    """Flat ones give the normal to the bit, in every depth; others what their colours say."""
    up = np.array([0.0, 0.0, 1.0])
    flat8 = np.full((4, 4, 3), (128, 128, 255), np.uint8)
    Image.fromarray(flat8).save(tmp_path / "flat8.png")
    Image.fromarray(np.full((4, 4), 32768, np.uint16)).save(tmp_path / "flat16.png")
    write_image(tmp_path / "flat.exr", np.tile(np.array([0.5, 0.5, 1.0], np.float32), (4, 4, 1)))
    points = some_points()
    for name in ("flat8.png", "flat16.png", "flat.exr"):
        for random in (False, True):
            scene = textured(tmp_path, "normal_map", texture=name, scale=3.0)
            np.testing.assert_array_equal(values(device, scene, points, random)[:, 3:], np.tile(up, (COUNT, 1)))
    tilted = RNG.integers(64, 192, (13, 10, 3), np.uint8)
    tilted[..., 2] = 255
    Image.fromarray(tilted).save(tmp_path / "tilted.png")
    scene = textured(tmp_path, "normal_map", texture="tilted.png", scale=0.5)
    expected = looked_up((tilted - 128.0) / 127.0, points, ("repeat", "repeat")) * [0.5, 0.5, 1.0]
    expected /= np.linalg.norm(expected, axis=1, keepdims=True)
    np.testing.assert_allclose(values(device, scene, points)[:, 3:], expected, atol=2e-5)


def bumps(device: Device, scene: Scene, points: Floats) -> Floats:
    with uploaded(device, flat_textures(scene)) as (buffers, defines):
        return launch(device, "texture_bumps", points.T, 3, *buffers, np.uint32(0), defines=defines).T


@pytest.mark.parametrize("wrap", WRAPS)
def test_bump_maps(device: Device, tmp_path: Path, wrap: str) -> None:
    """Against differences of the heights, where one texel's slope reaches."""
    heights = RNG.random((13, 10)).astype(np.float32)
    write_image(tmp_path / "a.exr", heights[..., None].repeat(3, 2))
    keys = {"transform": {"rotate_degrees": 90.0, "scale": [0.5, 1.0]}, "scale": 0.2, "wrap": wrap}
    points, step = some_points(), 1e-4

    def height(at: Floats) -> Floats:
        turned = np.stack([-at[:, 1], at[:, 0] * 0.5], axis=1)
        return 0.2 * looked_up(heights[..., None].astype(np.float64), turned, (wrap, wrap))[:, 0]

    turned = np.stack([-points[:, 1], points[:, 0] * 0.5], axis=1) * [10, 13] - 0.5
    inside = (np.abs(turned - np.round(turned)) > 4e-3).all(axis=1)
    steps = np.eye(2) * step
    slope = np.stack([height(points + each) - height(points - each) for each in steps], axis=1) / (2 * step)
    expected = np.concatenate([-slope, np.ones((COUNT, 1))], axis=1)
    expected /= np.linalg.norm(expected, axis=1, keepdims=True)
    found = bumps(device, textured(tmp_path, "bump_map", texture="a.exr", **keys), points)
    np.testing.assert_allclose(found[inside], expected[inside], atol=2e-4)


def test_no_normal_turns_the_view_into_the_surface(device: Device) -> None:
    rng = np.random.default_rng(704)
    n, side, view = rng.normal(size=(3, 65536, 3))
    n, side, view = (each / np.linalg.norm(each, axis=1, keepdims=True) for each in (n, side, view))
    view *= np.sign((view * side).sum(axis=1))[:, None]
    out = launch(device, "texture_bent", np.concatenate([n.T, side.T, view.T]), 3, defines={}).T
    np.testing.assert_allclose(np.linalg.norm(out, axis=1), 1.0, atol=1e-5)

    def mirrored(normal: Floats) -> Floats:
        above: Floats = ((2 * (normal * view).sum(axis=1)[:, None] * normal - view) * side).sum(axis=1)
        return above

    limit = np.minimum(0.9 * (view * side).sum(axis=1), 0.01)
    good = (mirrored(n) >= limit + 1e-5) & ((n * side).sum(axis=1) > 1e-5)
    bad = (mirrored(n) < limit - 1e-5) | ((n * side).sum(axis=1) < -1e-5)
    np.testing.assert_allclose(out[good], n[good], atol=1e-7)
    assert good.sum() > 1000 and bad.sum() > 1000
    # Bent no further than it must be, in the plane of both normals; where these are nearly opposite, that is ill-posed
    across = np.cross(side, n)
    clear = bad & (np.linalg.norm(across, axis=1) > 0.1)
    np.testing.assert_allclose(mirrored(out)[clear], limit[clear], atol=2e-5)
    assert np.abs((out * across).sum(axis=1))[bad].max() < 1e-5
