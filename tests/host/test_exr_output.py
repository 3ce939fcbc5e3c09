"""OpenEXR output: precision, compression and tiles as asked for, layers as the naming conventions have them."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import OpenEXR
import pytest

from clrender.aov import AOVS, exact_channels, exr_channels
from clrender.errors import UsageError
from clrender.film import Film
from clrender.image.exr_write import COMPRESSIONS, ExrFormat
from clrender.image.files import read_image, read_provenance
from clrender.rendering.rendered_image import RenderedImage

HEIGHT, WIDTH = 70, 90
RNG = np.random.default_rng(5)


def rendered(*names: str) -> RenderedImage:
    """Noise in every layer, with what layers have where nothing is hit."""
    layers = {}
    for name in names:
        channels = 12 if name.startswith("crypto") else len(AOVS[name])
        planes = RNG.normal(size=(channels, HEIGHT, WIDTH)).astype(np.float32)
        planes[:, :5] = {"depth": np.inf, "position": np.nan, "uv": np.nan}.get(name, 0.0)
        layers[name] = np.moveaxis(planes, 0, 2)
    linear = RNG.gamma(0.5, 3.0, size=(HEIGHT, WIDTH, 3)).astype(np.float32)
    mattes = {name: ["\u00e4", None] for name in names if name.startswith("crypto")}
    return RenderedImage(linear, {"seed": 7}, Film(WIDTH, HEIGHT), False, None, layers, mattes)


def held(path: Path) -> tuple[dict[str, Any], dict[str, npt.NDArray[Any]]]:
    with OpenEXR.File(str(path), separate_channels=True) as file:
        return dict(file.header()), {name: np.array(channel.pixels) for name, channel in file.channels().items()}


@pytest.mark.thorough
@pytest.mark.parametrize("tile", [None, 16, 64])
@pytest.mark.parametrize("compression", [name for name, lossy in COMPRESSIONS.items() if not lossy])
def test_every_bit_of_every_layer(tmp_path: Path, compression: str, tile: int | None) -> None:
    image = rendered(*AOVS)
    image.save(tmp_path / "a.exr", exr_compression=compression, exr_tile=tile)
    header, found = held(tmp_path / "a.exr")
    expected = {**{name: image.linear[..., i] for i, name in enumerate("RGB")}, **exr_channels(image.aovs)}
    assert found.keys() == expected.keys()
    for name, plane in expected.items():
        assert found[name].dtype == np.float32 and found[name].tobytes() == plane.tobytes(), name
    assert str(header["compression"]).startswith(
        f"Compression.{'NO' if compression == 'none' else compression.upper()}"
    )
    assert ("tiles" in header) == (tile is not None)
    assert tile is None or (header["tiles"].xSize, header["tiles"].ySize) == (tile, tile)
    assert np.array_equal(read_image(tmp_path / "a.exr"), image.linear)
    stored = {"exr_type": "float", "exr_compression": compression, "exr_tile": tile}
    assert read_provenance(tmp_path / "a.exr") == {"seed": 7, "stored": stored}


def test_names_of_channels() -> None:
    image = rendered("uv", "tangent", "crypto_object")
    pairs = [f"CryptoObject{number:02}.{letter}" for number in range(3) for letter in "RGBA"]
    assert list(exr_channels(image.aovs)) == ["uv.U", "uv.V", "tangent.X", "tangent.Y", "tangent.Z", *pairs]


def test_channels_of_layers_are_not_copied() -> None:
    layers = rendered(*AOVS).aovs
    for name, plane in exr_channels(layers).items():
        assert any(np.shares_memory(plane, layer) for layer in layers.values()), name


@pytest.mark.parametrize("tile", [None, 32])
def test_half_is_for_what_it_is_enough_for(tmp_path: Path, tile: int | None) -> None:
    image = rendered(*AOVS)
    image.linear[0, 0] = (1e6, -1e6, np.inf)
    image.linear[0, 1] = (65519.0, 65520.0, 6e-8)
    image.save(tmp_path / "a.exr", exr_type="half", exr_tile=tile)
    _, found = held(tmp_path / "a.exr")
    halves = {name for name, plane in found.items() if plane.dtype == np.float16}
    narrow = ("alpha", "albedo", "emission", "normal", "normal_camera", "tangent")
    assert halves == {*"RGB", *exr_channels({name: image.aovs[name] for name in narrow})}
    assert not halves & exact_channels(AOVS)
    assert [found[name][0, 0] for name in "RGB"] == [65504.0, -65504.0, np.inf]
    assert [found[name][0, 1] for name in "RG"] == [65504.0, 65504.0] and found["B"][0, 1] == np.float16(6e-8)
    for i, name in enumerate("RGB"):
        assert np.array_equal(found[name][1:], image.linear[1:, :, i].astype(np.float16))
    assert found["depth.Z"].tobytes() == np.ascontiguousarray(image.aovs["depth"][..., 0]).tobytes()


@pytest.mark.parametrize("compression", [name for name, lossy in COMPRESSIONS.items() if lossy])
def test_lossy_compressions_are_near(tmp_path: Path, compression: str) -> None:
    y, x = np.mgrid[0:HEIGHT, 0:WIDTH]
    image = rendered("depth")
    image.linear[:] = np.stack([np.sin(x / 20) + 2.0, y / 70 + 0.1, x / 90 + 0.1], axis=2)
    image.save(tmp_path / "a.exr", exr_compression=compression)
    found = read_image(tmp_path / "a.exr")
    assert np.abs(found - image.linear).max() < 0.02 and not np.array_equal(found, image.linear)


def test_mattes_are_not_lost(tmp_path: Path) -> None:
    image = rendered("crypto_material")
    for compression, lossy in COMPRESSIONS.items():
        if lossy:
            with pytest.raises(UsageError, match=f"{compression}.*crypto_material.*zip"):
                image.save(tmp_path / "a.exr", exr_compression=compression)
    assert not list(tmp_path.iterdir())
    image.save(tmp_path / "a.exr", exr_type="half")
    header, found = held(tmp_path / "a.exr")
    keys = {name for name in header if name.startswith("cryptomatte/")}
    assert {name.split("/")[2] for name in keys} == {"name", "hash", "conversion", "manifest"}
    assert any("\u00e4" in str(header[name]) for name in keys)
    plane = np.ascontiguousarray(image.aovs["crypto_material"][..., 9])
    assert found["CryptoMaterial02.G"].tobytes() == plane.tobytes()


@pytest.mark.parametrize(
    "wrong", [{"exr_type": "double"}, {"exr_compression": "lzw"}, {"exr_tile": 15}, {"exr_tile": 1.5}]
)
def test_what_is_not_written(tmp_path: Path, wrong: dict[str, Any]) -> None:
    with pytest.raises(UsageError, match=f"{next(iter(wrong))} is"):
        rendered().save(tmp_path / "a.exr", **wrong)
    assert not list(tmp_path.iterdir())


LARGE = """
import sys
import numpy as np
from clrender.film import Film
from clrender.image.exr_write import ExrFormat
from clrender.rendering.statistics import peak_rss
from clrender.rendering.rendered_image import RenderedImage
height, width = 750, 1000
layers = {
    name: np.moveaxis(np.full((3, height, width), 0.5, np.float32), 0, 2)
    for name in ("albedo", "normal", "position", "emission", "tangent")
}
image = RenderedImage(np.full((height, width, 3), 0.25, np.float32), {}, Film(1, 1), False, None, layers)
image.save(sys.argv[1], exr_tile=16)  # what the library needs itself
image.linear[0, 0, 0] = 1.0
before = peak_rss()
image.save(sys.argv[1], exr_type=sys.argv[2], exr_tile=int(sys.argv[3]) or None)
print(peak_rss() - before)
"""


@pytest.mark.long
@pytest.mark.parametrize(("kind", "tile", "most"), [("float", 0, 8), ("float", 64, 8), ("half", 64, 30)])
def test_memory_of_writing(tmp_path: Path, kind: str, tile: int, most: int) -> None:
    """52 MiB of image and layers: nothing of it is copied as float, and 22 MiB as half."""
    done = subprocess.run(
        [sys.executable, "-c", LARGE, str(tmp_path / "a.exr"), kind, str(tile)],
        capture_output=True,
        text=True,
        check=True,
    )
    assert not done.stderr and int(done.stdout) < most << 20


def test_formats_are_checked_when_they_are_made() -> None:
    assert not ExrFormat().lossy and ExrFormat(compression="dwaa").lossy
