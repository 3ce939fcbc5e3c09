"""Means of emission textures: the bits of plain sampling, kept during edits, and no work for black texels."""

from __future__ import annotations

import itertools
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from PIL import Image

import clrender
from clrender.flatten import emission_means
from clrender.flatten.emission_means import EmissionMeans
from clrender.flatten.flat_scene import flatten
from clrender.flatten.texture_means import TextureMeans
from clrender.flatten.texture_rows import flat_textures
from clrender.image.files import write_image

Floats = npt.NDArray[np.float64]
HEIGHT, WIDTH = 26, 21


def picture(seed: int, lit: float) -> npt.NDArray[np.float32]:
    """Black but for a part of its blocks of five by five pixels."""
    rng = np.random.default_rng(seed)
    blocks = np.repeat(np.repeat(rng.random((6, 5)) < lit, 5, axis=0), 5, axis=1)[:HEIGHT, :WIDTH, None]
    return np.where(blocks, rng.random((HEIGHT, WIDTH, 3)), 0.0).astype(np.float32)


def lamp(folder: Path, count: int, strength: float, **how: Any) -> clrender.Scene:
    """A mesh that shines as a picture; its triangles have random texture coordinates, some far outside."""
    rng = np.random.default_rng(8)
    uvs = (
        rng.random((count, 1, 2)) * 2.0
        - 0.5
        + rng.random((count, 3, 2)) * np.where(rng.random((count, 1, 1)) < 0.3, 3.0, 0.2)
    )
    emission = {"texture": "p.exr"} | how
    material = {"type": "principled", "emission": emission, "emission_strength": strength}
    mesh = {
        "type": "mesh", "vertices": rng.random((3 * count, 3)).tolist(), "uvs": uvs.reshape(-1, 2).tolist(),
        "faces": np.arange(3 * count).reshape(-1, 3).tolist(), "material": "m",
    }  # fmt: skip
    whole = {"camera": {"position": [0, 0, 3], "target": [0, 0, 0]}, "materials": {"m": material}, "shapes": (mesh,)}
    return clrender.Scene.model_validate(whole).placed("here", folder)


def corners_of(scene: clrender.Scene) -> npt.NDArray[np.float32]:
    return np.asarray(scene.shapes[0].uvs, np.float32)[np.asarray(scene.shapes[0].faces)]  # type: ignore[union-attr]


def plain_mean(pixels: Floats, triangle: Floats, wraps: tuple[str, str], nearest: bool) -> Floats:
    """The mean over one triangle by its definition, point by point, from the picture's rows and columns."""

    def texel(column: int, row: int) -> Floats:
        places = []
        for at, count, wrap in ((column, WIDTH, wraps[0]), (row, HEIGHT, wraps[1])):
            turned = at % (2 * count)
            mirrored = turned if turned < count else 2 * count - 1 - turned
            places.append({"clamp": min(max(at, 0), count - 1), "repeat": at % count, "mirror": mirrored}[wrap])
        value: Floats = pixels[places[1], places[0]]
        return value

    size = np.array([WIDTH, HEIGHT], float)
    steep = np.abs(triangle - np.roll(triangle, 1, axis=0)).astype(float) * size
    steps = 2
    while steps < min(np.ceil(steep.max() / (1.0 if nearest else 2.0)), 512):
        steps *= 2
    total = np.zeros(3)
    a, b, c = triangle
    for third in (1 / 3, 2 / 3):
        for i, j in itertools.product(range(steps), repeat=2):
            if i + j < steps - (third > 0.5):
                u, v = a + (b - a) * ((i + third) / steps) + (c - a) * ((j + third) / steps)
                x, y = u * WIDTH, (v * -1.0 + 1.0) * HEIGHT
                if nearest:
                    total = total + texel(int(np.floor(x)), int(np.floor(y)))
                    continue
                left, top = int(np.floor(x - 0.5)), int(np.floor(y - 0.5))
                across, down = (x - 0.5) - left, (y - 0.5) - top
                p, q, r, s = (texel(left + i, top + j) for j in (0, 1) for i in (0, 1))
                above, below = p + across * (q - p), r + across * (s - r)
                total = total + (above + down * (below - above))
    return total / steps**2


@pytest.mark.long
@pytest.mark.parametrize(
    ("wrap", "filter_"),
    [(("repeat", "clamp"), "linear"), (("mirror", "repeat"), "nearest"), (("clamp", "mirror"), "linear")],
    ids=["repeat-clamp", "mirror-repeat", "clamp-mirror"],
)
def test_means_are_those_of_the_definition(tmp_path: Path, wrap: tuple[str, str], filter_: str) -> None:
    """Bit for bit, whatever the order in which strengths were asked for; many triangles are on black texels only."""
    pixels = picture(3, 0.15)
    write_image(tmp_path / "p.exr", pixels)
    scenes = {strength: lamp(tmp_path, 40, strength, wrap=list(wrap), filter=filter_) for strength in (1.0, 0.37, 2.6)}
    black = 0
    for strength, scene in scenes.items():
        corners = corners_of(scene)
        means = EmissionMeans(flat_textures(scene), 0).triangles(corners)
        scaled = pixels.astype(np.float64) * float(np.float32(strength))
        for mean, triangle in zip(means, corners.astype(np.float64), strict=True):
            wanted = plain_mean(scaled, triangle, wrap, filter_ == "nearest")
            assert np.array_equal(mean.astype(np.float32), wanted.astype(np.float32))
            black += not wanted.any()
    assert 3 < black < 110


@pytest.mark.parametrize("strength", [1.0, 0.731, 1e-6, 3e5])
def test_the_whole_picture_has_the_bits_of_plain_sampling(tmp_path: Path, strength: float) -> None:
    write_image(tmp_path / "p.exr", picture(4, 0.5))
    textures = flat_textures(lamp(tmp_path, 1, strength))
    mean, least, most = EmissionMeans(textures, 0).whole()
    wanted, lows, highs, _ = TextureMeans(textures, 0).whole()
    assert np.array_equal(mean.astype(np.float32), wanted.astype(np.float32))
    assert (least, most) == (lows.min(), highs.max())


@pytest.mark.parametrize("channel", [None, "g", "luminance", "a"])
@pytest.mark.parametrize("mode", ["L", "RGB", "RGBA", "I;16"])
def test_black_tiles_are_known_from_their_bytes(tmp_path: Path, mode: str, channel: str | None) -> None:
    """In every way that texels are stored: the sums, the bounds and the tiles are those of all texels, one by one."""
    channels = {"RGB": (3,), "RGBA": (4,)}.get(mode, ())
    depth = np.uint16 if mode == "I;16" else np.uint8
    pixels = np.zeros((95, 83, *channels), depth)
    pixels[40:52, 30:50] = np.random.default_rng(6).integers(1, np.iinfo(depth).max, (12, 20, *channels))
    if mode == "RGBA":
        pixels[..., 3] = 200
    Image.fromarray(pixels).save(tmp_path / "p.png")
    how = {} if channel is None else {"channel": channel}
    textures = flat_textures(lamp(tmp_path, 1, 0.7, texture="p.png", **how))
    means = TextureMeans(textures, 0)
    mean, least, most, lit = means.whole()
    table = means.table
    values = np.stack(table.at(np.arange(table.first, table.first + table.count)), axis=-1)
    tiles = values.reshape(-1, table.per_tile, 3)
    assert np.array_equal(lit, tiles.any(axis=(1, 2)))
    assert lit.all() == (channel == "a" or (lit.size == 1))
    assert np.array_equal(mean, np.cumsum(values, axis=0)[-1] / (95 * 83))
    assert np.array_equal(least, values.min(axis=0)) and np.array_equal(most, values.max(axis=0))


def points_sampled(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """Grows by the number of points of each call of the sampler."""
    found: list[int] = []
    plain = TextureMeans._values

    def counted(self: TextureMeans, u: Floats, v: Floats) -> list[Floats]:
        found.append(u.size)
        return plain(self, u, v)

    monkeypatch.setattr(TextureMeans, "_values", counted)
    return found


def test_an_edit_samples_nothing_anew(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of the strength, or of anything else; only numbers close to a limit of rounding are computed again."""
    write_image(tmp_path / "p.exr", picture(5, 1.0))
    scene, stronger = (lamp(tmp_path, 300, strength) for strength in (1.0, 1.7))
    monkeypatch.setattr(emission_means, "_KEPT", emission_means._Kept(1 << 20))
    points = points_sampled(monkeypatch)
    first = flatten(scene, 8, 8)
    once = sum(points)
    assert once > 300 * 4
    assert flatten(scene, 8, 8).arrays_sha256 == first.arrays_sha256 and sum(points) == once
    kept = flatten(stronger, 8, 8).arrays_sha256
    assert sum(points) < 1.1 * once
    monkeypatch.setattr(emission_means, "_KEPT", emission_means._Kept(0))
    assert flatten(stronger, 8, 8).arrays_sha256 == kept
    assert sum(points) > 1.9 * once, "what takes more memory than is allowed is computed each time"


def test_triangles_on_black_texels_are_not_sampled(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pixels = np.zeros((HEIGHT, WIDTH, 3), np.float32)
    pixels[3, 4] = 1.0
    write_image(tmp_path / "p.exr", pixels)
    scene = lamp(tmp_path, 300, 1.0, wrap=["clamp", "clamp"])
    corners = corners_of(scene)
    points = points_sampled(monkeypatch)
    textures = flat_textures(scene)
    wanted, all_points = TextureMeans(textures, 0).triangles(corners), sum(points)
    assert np.array_equal(EmissionMeans(textures, 0).triangles(corners), wanted)
    assert sum(points) - all_points < 0.75 * all_points and wanted.any()


def test_an_edit_does_not_sample_triangles_on_black_texels(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pixels = np.zeros((HEIGHT, WIDTH, 3), np.float32)
    pixels[3, 4] = 1.0
    write_image(tmp_path / "p.exr", pixels)
    first, stronger = (lamp(tmp_path, 300, strength, wrap=["clamp", "clamp"]) for strength in (1.0, 1.7))
    corners = corners_of(first)
    means = EmissionMeans(flat_textures(first), 0).triangles(corners)
    points = points_sampled(monkeypatch)
    edited = EmissionMeans(flat_textures(stronger), 0).triangles(corners)
    assert not points
    wanted = TextureMeans(flat_textures(stronger), 0).triangles(corners)
    assert np.array_equal(edited.astype(np.float32), wanted.astype(np.float32))
    assert 0 < means.any(axis=1).sum() < 250
