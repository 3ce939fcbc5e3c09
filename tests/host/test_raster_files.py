"""Pictures in TGA, BMP, PNM, TIFF, GIF, DDS and PFM hold what the same pictures in PNG and EXR do."""

from __future__ import annotations

import io
import struct
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt
import pytest
from cases import for_each
from PIL import Image

from clrender.errors import SceneError, UsageError
from clrender.image.deep_png import deep_png_bytes
from clrender.image.files import read_image, write_image
from clrender.image.pictures import open_picture, picture_room
from clrender.scene.environment import EnvironmentPicture

RNG = np.random.default_rng(0)
COLORS = RNG.integers(0, 256, (9, 13, 3), np.uint8)
WITH_ALPHA = np.dstack([COLORS, COLORS[..., :1]])
WORDS = RNG.integers(0, 65536, (9, 13), np.uint16)
FLOATS = RNG.random((9, 13, 3), np.float32) * 100.0


def saved(path: Path, pixels: npt.NDArray[Any], **options: Any) -> Path:
    Image.fromarray(pixels).save(path, **options)
    return path


def pfm(path: Path, image: npt.NDArray[np.float32], scale: str = "-1.0") -> Path:
    kind = b"PF" if image.ndim == 3 else b"Pf"
    order = "<f4" if scale.startswith("-") else ">f4"
    head = b"%b\n%d %d\n%b\n" % (kind, image.shape[1], image.shape[0], scale.encode())
    path.write_bytes(head + image[::-1].astype(order).tobytes())
    return path


def texels(path: Path) -> npt.NDArray[Any]:
    with path.open("rb") as file:
        return np.concatenate(list(open_picture(file, path.suffix).bands()))


FILES: dict[str, tuple[str, npt.NDArray[Any], dict[str, Any]]] = {
    "TGA": ("a.tga", COLORS, {}),
    "TGA in runs": ("a.tga", COLORS, {"compression": "tga_rle"}),
    "TGA with alpha": ("a.tga", WITH_ALPHA, {}),
    "TGA, grey": ("a.tga", COLORS[..., 0], {}),
    "BMP": ("a.bmp", COLORS, {}),
    "PPM": ("a.ppm", COLORS, {}),
    "PGM": ("a.pgm", COLORS[..., 0], {}),
    "TIFF": ("a.tif", COLORS, {}),
    "TIFF by LZW": ("a.tiff", WITH_ALPHA, {"compression": "tiff_lzw"}),
    "TIFF by deflate": ("a.tiff", COLORS, {"compression": "tiff_adobe_deflate"}),
    "DDS": ("a.dds", WITH_ALPHA, {}),
}


@pytest.mark.parametrize("name", FILES)
def test_it_holds_what_a_png_holds(tmp_path: Path, name: str) -> None:
    file, pixels, options = FILES[name]
    made, plain = saved(tmp_path / file, pixels, **options), saved(tmp_path / "a.png", pixels)
    np.testing.assert_array_equal(texels(made), texels(plain))
    np.testing.assert_array_equal(read_image(made), read_image(plain))


def test_a_gif_has_its_palette(tmp_path: Path) -> None:
    Image.fromarray(COLORS).convert("P", palette=Image.Palette.ADAPTIVE).save(tmp_path / "a.gif")
    with Image.open(tmp_path / "a.gif") as picture:
        picture.convert("RGBA").save(tmp_path / "a.png")
    np.testing.assert_array_equal(texels(tmp_path / "a.gif"), texels(tmp_path / "a.png"))


DEEP = RNG.integers(0, 65536, (9, 13, 3), np.uint16)
DEEP_ALPHA = np.dstack([DEEP, DEEP[..., :1]])


@for_each("alpha", [False, True])
@for_each("how", [(1, 1), (5, 1), (5, 2), (8, 1)])
def test_sixteen_bits_of_colour_in_a_tiff(tmp_path: Path, alpha: bool, how: tuple[int, int]) -> None:
    """Plain, by LZW without and with differences, and by deflate."""
    pixels, path = DEEP_ALPHA if alpha else DEEP, tmp_path / "a.tif"
    turned = pixels[..., [2, 1, 0, 3]] if alpha else pixels[..., ::-1]
    cv2.imwrite(str(path), turned, [cv2.IMWRITE_TIFF_COMPRESSION, how[0], cv2.IMWRITE_TIFF_PREDICTOR, how[1]])
    (tmp_path / "a.png").write_bytes(deep_png_bytes(DEEP))
    assert texels(path).dtype == np.uint16
    np.testing.assert_array_equal(texels(path)[..., : pixels.shape[2]], pixels)
    np.testing.assert_array_equal(read_image(path), read_image(tmp_path / "a.png"))
    with path.open("rb") as file:
        assert picture_room(file, ".tif") == (13, 9, 8)


def test_a_tiff_of_the_other_order_of_bytes(tmp_path: Path) -> None:
    """Written by hand: uncompressed, big-endian."""
    rows = DEEP.astype(">u2").tobytes()
    tags = [(256, 3, 1, 13), (257, 3, 1, 9), (258, 3, 3, 8 + 126), (259, 3, 1, 1), (262, 3, 1, 2), (273, 4, 1, 146)]
    tags += [(277, 3, 1, 3), (278, 3, 1, 9), (279, 4, 1, len(rows)), (284, 3, 1, 1)]
    entries = b"".join(
        struct.pack(">HHI", tag, kind, count) + struct.pack(">HH" if kind == 3 and count == 1 else ">I", *(
            (value, 0) if kind == 3 and count == 1 else (value,)
        ))
        for tag, kind, count, value in tags
    )  # fmt: skip
    head = b"MM\0*" + struct.pack(">IH", 8, len(tags)) + entries + struct.pack(">I", 0)
    path = tmp_path / "a.tif"
    path.write_bytes(head.ljust(134, b"\0") + struct.pack(">HHH", 16, 16, 16).ljust(12, b"\0") + rows)
    np.testing.assert_array_equal(texels(path)[..., :3], DEEP)


@for_each("most", [65535, 1023])
@for_each("plain", [False, True])
def test_sixteen_bits_of_colour_in_a_ppm(tmp_path: Path, most: int, plain: bool) -> None:
    numbers, path = DEEP & np.uint16(most), tmp_path / "a.ppm"
    body = " ".join(map(str, numbers.ravel())).encode() if plain else numbers.astype(">u2").tobytes()
    path.write_bytes(b"P%d 13 9 %d\n" % (3 if plain else 6, most) + body)
    found = texels(path)
    assert found.dtype == np.uint16
    np.testing.assert_array_equal(found[..., :3], np.rint(numbers.astype(np.float64) * 65535.0 / most))
    (tmp_path / "a.png").write_bytes(deep_png_bytes(np.ascontiguousarray(found[..., :3])))
    np.testing.assert_array_equal(read_image(path), read_image(tmp_path / "a.png"))
    path.write_bytes(path.read_bytes()[:-9])
    with pytest.raises(ValueError, match="truncated"):
        texels(path)


@pytest.mark.parametrize("file", ["a.tif", "a.pgm"])
def test_sixteen_bits_of_grey(tmp_path: Path, file: str) -> None:
    path = saved(tmp_path / file, WORDS)
    np.testing.assert_array_equal(texels(path)[..., 0], WORDS)
    assert texels(path).dtype == np.uint16
    np.testing.assert_array_equal(read_image(path), read_image(saved(tmp_path / "a.png", WORDS)))


@pytest.mark.parametrize("scale", ["-1.0", "1.0", "-7"])
def test_floats(tmp_path: Path, scale: str) -> None:
    path = pfm(tmp_path / "a.pfm", FLOATS, scale)
    np.testing.assert_array_equal(read_image(path), FLOATS)
    np.testing.assert_array_equal(texels(path)[..., :3], FLOATS)
    np.testing.assert_array_equal(texels(pfm(tmp_path / "g.pfm", FLOATS[..., 0], scale))[..., 0], FLOATS[..., 0])
    np.testing.assert_array_equal(texels(saved(tmp_path / "f.tif", FLOATS[..., 1]))[..., 0], FLOATS[..., 1])
    with path.open("rb") as file:
        assert picture_room(file, ".pfm") == (13, 9, 16)


@pytest.mark.parametrize("ending", [".pfm", ".jpg", ".tga", ".bmp", ".ppm", ".tif", ".gif", ".dds"])
def test_environments(tmp_path: Path, ending: str) -> None:
    made = pfm(tmp_path / "a.pfm", FLOATS) if ending == ".pfm" else saved(tmp_path / f"a{ending}", COLORS)
    read = EnvironmentPicture.read(made.name, tmp_path, (), "here")
    np.testing.assert_array_equal(read.pixels, read_image(made))
    write_image(tmp_path / "b.exr", read.pixels)
    assert EnvironmentPicture.read("b.exr", tmp_path, (), "here").sha256() == read.sha256()


def tga(width: int, height: int, kind: int = 10) -> bytes:
    return struct.pack("<3B5x2x2xHH2B", 0, 0, kind, width, height, 24, 0)


def bmp(width: int, height: int, bits: int = 8, compression: int = 1) -> bytes:
    return (
        b"BM"
        + struct.pack("<IHHIIiiHHIIiiII", 200, 0, 0, 58, 40, width, height, 1, bits, compression, 0, 1, 1, 1, 0)
        + bytes(4)
    )


def gif(width: int, height: int) -> bytes:
    file = io.BytesIO()
    Image.new("P", (1, 1)).save(file, "GIF")
    data = bytearray(file.getvalue())
    data[6:10] = struct.pack("<HH", width, height)
    return bytes(data)


def tiff(width: int, height: int) -> bytes:
    file = io.BytesIO()
    Image.new("L", (300, 300)).save(file, "TIFF", compression="tiff_adobe_deflate")
    data = file.getvalue()
    for tag, value in ((256, width), (257, height)):
        found = data.index(struct.pack("<HHI", tag, 4, 1)) if struct.pack("<HHI", tag, 4, 1) in data else -1
        at = found if found >= 0 else data.index(struct.pack("<HHI", tag, 3, 1))
        data = data[:at] + struct.pack("<HHII", tag, 4, 1, value) + data[at + 12 :]
    return data


BOMBS = {
    "TGA": ("a.tga", tga(60000, 60000) + bytes(100)),
    "BMP": ("a.bmp", bmp(16000, 16000) + bytes(200)),
    "GIF": ("a.gif", gif(16000, 16000)),
    "TIFF": ("a.tif", tiff(16000, 16000)),
    "PPM": ("a.ppm", b"P6\n16000 16000\n255\n" + bytes(100)),
    "PNM of one bit": ("a.pbm", b"P4\n160000 160000\n" + bytes(100)),
    "PFM": ("a.pfm", b"PF\n16000 16000\n-1\n" + bytes(100)),
    "DDS": (
        "a.dds",
        b"DDS "
        + struct.pack("<7I44x8I16x4x", 124, 0x1007, 16000, 16000, 0, 0, 0, 32, 4, 0x31545844, 0, 0, 0, 0, 0)
        + bytes(64),
    ),
}


@pytest.mark.parametrize("name", BOMBS)
def test_bombs_are_refused_by_their_headers(tmp_path: Path, name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Before anything is unpacked."""
    file, data = BOMBS[name]
    path = tmp_path / file
    path.write_bytes(data)

    def unpacked(*_: Any, **__: Any) -> None:
        raise AssertionError("pixels were asked for")

    monkeypatch.setattr(Image.Image, "load", unpacked)
    with pytest.raises(UsageError, match=r"a\.\w+: .*(truncated|pixels are not between)"):
        read_image(path)


def test_files_that_are_no_pictures(tmp_path: Path) -> None:
    for ending in (".tga", ".bmp", ".ppm", ".tif", ".gif", ".dds", ".pfm"):
        path = tmp_path / f"a{ending}"
        for data in (
            b"",
            b"a text that is longer than any signature or header of a picture",
            b"PF\n3 3\n0\n" + bytes(108),
        ):
            path.write_bytes(data)
            with pytest.raises(UsageError, match=r"not a readable|the file is empty"):
                read_image(path)
            with pytest.raises(SceneError, match=r"here: \"a\.\w+\""):
                EnvironmentPicture.read(path.name, tmp_path, (), "here")
