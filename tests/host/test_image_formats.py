"""Image files as their specifications say, also those of other programs, and what damaged ones are answered with."""

from __future__ import annotations

import io
import os
import struct
import subprocess
import sys
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import OpenEXR
import pytest
from cases import for_each
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from PIL import Image
from special_files import special

import clrender
from clrender.errors import UsageError
from clrender.files.access import open_input
from clrender.image.colorimetry import REC_709, rec_709_matrix
from clrender.image.files import read_image, read_provenance, write_image
from clrender.image.pictures import open_picture
from clrender.image.tone_map import srgb_decode, to_display

Picture = npt.NDArray[np.float32]
REC_2020 = (0.708, 0.292, 0.170, 0.797, 0.131, 0.046, 0.3127, 0.3290)
ACES_AP1 = (0.713, 0.293, 0.165, 0.830, 0.128, 0.044, 0.32168, 0.33767)
XYZ = (1.0, 0.0, 0.0, 1.0, 0.0, 0.0, 1 / 3, 1 / 3)


def ramp(height: int = 20, width: int = 30) -> Picture:
    y, x = np.mgrid[0:height, 0:width]
    return np.stack([x / 7, y / 5, (x + y) / 9], -1).astype(np.float32)


def window(left: int, top: int, width: int, height: int) -> tuple[npt.NDArray[np.int32], npt.NDArray[np.int32]]:
    return np.array([left, top], np.int32), np.array([left + width - 1, top + height - 1], np.int32)


def exr(path: Path, channels: Mapping[str, Any], **header: Any) -> Path:
    full = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage, **header}
    with OpenEXR.File(full, dict(channels)) as file:
        file.write(str(path))
    return path


def planes(image: npt.NDArray[Any]) -> dict[str, npt.NDArray[Any]]:
    return {name: np.ascontiguousarray(image[..., i]) for i, name in enumerate("RGB")}


# --- EXR -------------------------------------------------------------------------------------------------------------


def test_exr_is_its_display_window(tmp_path: Path) -> None:
    image = ramp(20, 30)
    cropped = read_image(
        exr(tmp_path / "a.exr", {"RGB": image}, dataWindow=window(5, -4, 30, 20), displayWindow=window(0, 0, 24, 18))
    )
    assert cropped.shape == (18, 24, 3)
    np.testing.assert_array_equal(cropped[:16, 5:], image[4:20, :19])
    assert not cropped[16:].any() and not cropped[:, :5].any()
    apart = exr(tmp_path / "b.exr", {"RGB": image}, dataWindow=window(99, 99, 30, 20), displayWindow=window(0, 0, 8, 8))
    assert not read_image(apart).any()


@pytest.mark.parametrize("given", [REC_2020, ACES_AP1, XYZ])
def test_exr_of_other_primaries_is_converted(tmp_path: Path, given: tuple[float, ...]) -> None:
    matrix = rec_709_matrix(given)
    assert matrix is not None
    image = ramp()
    loaded = read_image(exr(tmp_path / "a.exr", {"RGB": image}, chromaticities=given))
    np.testing.assert_allclose(loaded, image @ matrix.T, rtol=1e-5, atol=1e-5)
    assert np.abs(loaded - image).max() > 0.1


def test_matrices_are_those_of_the_standards() -> None:
    # Rec. ITU-R BT.2087, its inverse; XYZ to linear sRGB of IEC 61966-2-1, annex F.
    to_709 = [[1.660491, -0.587641, -0.072850], [-0.124550, 1.132900, -0.008349], [-0.018151, -0.100579, 1.118730]]
    from_2020, from_xyz, adapted = (rec_709_matrix(given) for given in (REC_2020, XYZ, ACES_AP1))
    assert from_2020 is not None and from_xyz is not None and adapted is not None
    np.testing.assert_allclose(from_2020, np.array(to_709), atol=2e-6)
    srgb = [[3.2406, -1.5372, -0.4986], [-0.9689, 1.8758, 0.0415], [0.0557, -0.2040, 1.0570]]
    np.testing.assert_allclose(from_xyz, np.array(srgb), atol=5e-4)
    np.testing.assert_allclose(adapted @ np.ones(3), np.ones(3), atol=1e-9)
    # ACES to Rec. 709 as the Academy's own transforms have it (CAT02 there, Bradford here).
    aces = [[1.7051, -0.6218, -0.0833], [-0.1303, 1.1408, -0.0105], [-0.0240, -0.1290, 1.1530]]
    np.testing.assert_allclose(adapted, np.array(aces), atol=2e-2)
    assert rec_709_matrix(REC_709) is None
    for bad in ((0.3, 0.3) * 4, (*REC_709[:7], 0.0), (np.nan, *REC_709[1:]), REC_709[:6]):
        with pytest.raises(ValueError, match=r"chromaticities|white point"):
            rec_709_matrix(bad)


def test_exr_of_several_parts_is_the_one_with_colours(tmp_path: Path) -> None:
    image, header = ramp(), {"type": OpenEXR.scanlineimage, "compression": OpenEXR.ZIP_COMPRESSION}
    depth = OpenEXR.Part({"name": "depth", **header}, {"Z": np.ascontiguousarray(image[..., 0])})
    beauty = OpenEXR.Part({"name": "beauty", **header}, {"RGB": image})
    right = OpenEXR.Part({"name": "right", **header}, {"RGB": image})
    OpenEXR.File([depth, beauty]).write(str(tmp_path / "a.exr"))
    np.testing.assert_array_equal(read_image(tmp_path / "a.exr"), image)
    OpenEXR.File([depth, beauty, right]).write(str(tmp_path / "b.exr"))
    with pytest.raises(UsageError, match="2 images, the parts beauty, right"):
        read_image(tmp_path / "b.exr")
    OpenEXR.File([depth]).write(str(tmp_path / "c.exr"))
    with pytest.raises(UsageError, match="its channels are Z, not R, G, B"):
        read_image(tmp_path / "c.exr")


def test_exr_of_mixed_and_grey_channels(tmp_path: Path) -> None:
    image = ramp()
    mixed = {**planes(image), "G": image[..., 1].astype(np.float16), "id": np.zeros(image.shape[:2], np.uint32)}
    expected = image.copy()
    expected[..., 1] = image[..., 1].astype(np.float16)
    np.testing.assert_array_equal(read_image(exr(tmp_path / "a.exr", mixed)), expected)
    grey = read_image(exr(tmp_path / "b.exr", {"Y": np.ascontiguousarray(image[..., 0])}))
    np.testing.assert_array_equal(grey, np.repeat(image[..., :1], 3, axis=2))


@for_each("kind", ["RGB", "Y", "half"])
def test_exr_pictures_have_their_alpha(tmp_path: Path, kind: str) -> None:
    image, alpha = ramp(), ramp()[..., 1] / np.float32(8.0)
    if kind == "half":
        image, alpha = image.astype(np.float16), alpha.astype(np.float16)
    colors = {"Y": np.ascontiguousarray(image[..., 0])} if kind == "Y" else planes(image)
    exr(tmp_path / "a.exr", {**colors, "A": np.ascontiguousarray(alpha)})
    with (tmp_path / "a.exr").open("rb") as file:
        picture = open_picture(file, ".exr")
        texels = np.concatenate(list(picture.bands()))
    assert (picture.channels, picture.coding) == (4, "half" if kind == "half" else "float")
    texels = texels.view(np.float16) if kind == "half" else texels
    np.testing.assert_array_equal(texels[..., :3], np.repeat(image[..., :1], 3, axis=2) if kind == "Y" else image)
    np.testing.assert_array_equal(texels[..., 3], np.clip(alpha, 0.0, 1.0))
    assert texels[..., 3].min() < texels[..., 3].max()
    exr(tmp_path / "b.exr", {"Y": np.ascontiguousarray(image[..., 0]), "A": np.ones_like(image[..., 0])})
    with (tmp_path / "b.exr").open("rb") as file:
        assert open_picture(file, ".exr").channels == 1  # opaque


COMPRESSIONS = ("NO", "RLE", "ZIPS", "ZIP", "PIZ", "PXR24", "B44", "B44A", "DWAA", "DWAB")


@pytest.mark.parametrize("compression", COMPRESSIONS)
def test_black_exr_of_every_compression(tmp_path: Path, compression: str) -> None:
    # The most that each can shrink an image.
    kind = getattr(OpenEXR, f"{compression}_COMPRESSION")
    image = np.zeros((1500, 700, 3), np.float16)
    assert not read_image(exr(tmp_path / "a.exr", {"RGB": image}, compression=kind)).any()


@pytest.mark.parametrize("compression", ["NO", "ZIP", "PIZ", "DWAB"])
def test_truncated_exr_is_one_line_and_no_chatter(tmp_path: Path, compression: str) -> None:
    kind = getattr(OpenEXR, f"{compression}_COMPRESSION")
    data = exr(tmp_path / "a.exr", {"RGB": ramp(200, 300)}, compression=kind).read_bytes()
    for name, cut in (("b", len(data) - 1), ("c", len(data) // 2), ("d", 400), ("e", 120)):
        (tmp_path / f"{name}.exr").write_bytes(data[:cut])
    code = (
        "import sys; from clrender.image.files import read_image\n"
        "for path in sys.argv[1:]:\n"
        "    try: read_image(path); print('read', path)\n"
        "    except Exception as error: print(type(error).__name__, error)\n"
    )
    paths = [str(tmp_path / f"{name}.exr") for name in "bcde"]
    done = subprocess.run([sys.executable, "-c", code, *paths], capture_output=True, text=True, check=True)
    assert done.stderr == ""
    lines = done.stdout.splitlines()
    assert len(lines) == 4
    for line, path in zip(lines, paths, strict=True):
        assert line.startswith(f"UsageError {path}: not a readable .exr image (")


@pytest.mark.parametrize("streams", ["2>&-", ">&- 2>&-", "<&- >&- 2>&-"])
def test_exr_is_read_without_an_error_output(tmp_path: Path, streams: str) -> None:
    exr(tmp_path / "a.exr", {"RGB": ramp()})
    code = """
import numpy as np
from clrender.image.files import read_image
np.save("b.npy", read_image("a.exr"))
with open("c.txt", "w") as file:
    read_image("a.exr")
    file.write("whole")
"""
    (tmp_path / "code.py").write_text(code)
    root = str(Path(clrender.__file__).parents[1])
    command = ["bash", "-c", f'"{sys.executable}" code.py {streams}']
    done = subprocess.run(command, cwd=tmp_path, env={**os.environ, "PYTHONPATH": root}, check=False)
    assert done.returncode == 0
    np.testing.assert_array_equal(np.load(tmp_path / "b.npy"), ramp())
    assert (tmp_path / "c.txt").read_text() == "whole"


def test_damaged_exr_pixels_are_refused(tmp_path: Path) -> None:
    # The library fills what it cannot decode with zeros, and says so on the error output only, if at all.
    data = bytearray(exr(tmp_path / "a.exr", {"RGB": ramp(200, 300)}).read_bytes())
    for place in (len(data) // 3, len(data) // 2, len(data) - 50):
        data[place : place + 8] = bytes(8)
    (tmp_path / "b.exr").write_bytes(data)
    with pytest.raises(UsageError, match="truncated or damaged"):
        read_image(tmp_path / "b.exr")


def test_exr_windows_that_no_file_of_its_size_fills_take_no_memory(tmp_path: Path) -> None:
    good = exr(tmp_path / "a.exr", {"RGB": ramp()}).read_bytes()
    for name in (b"dataWindow", b"displayWindow"):
        at = good.index(name) + len(name) + 1 + len(b"box2i\0") + 4
        for right, bottom in ((29_999, 29_999), (2**31 - 1, 2**31 - 1), (-5, -5)):
            bad = good[: at + 8] + struct.pack("<ii", right, bottom) + good[at + 16 :]
            (tmp_path / "b.exr").write_bytes(bad)
            with pytest.raises(UsageError, match=r"b\.exr: not a readable \.exr image"):
                read_image(tmp_path / "b.exr")


# --- Radiance HDR ----------------------------------------------------------------------------------------------------


def hdr(path: Path, header: str = "", size: str = "-Y 2 +X 3", body: bytes = bytes(range(128, 152))) -> Path:
    path.write_bytes(f"#?RADIANCE\n{header}FORMAT=32-bit_rle_rgbe\n\n{size}\n".encode() + body)
    return path


def test_hdr_exposures_are_divided_out(tmp_path: Path) -> None:
    plain = read_image(hdr(tmp_path / "a.hdr"))
    assert plain.shape == (2, 3, 3)
    exposed = read_image(hdr(tmp_path / "b.hdr", "EXPOSURE=2\n\tEXPOSURE=100\nEXPOSURE = 3\nEXPOSURE= 2.0e0\n"))
    np.testing.assert_allclose(exposed, plain / 4, rtol=1e-6)
    corrected = read_image(hdr(tmp_path / "c.hdr", "COLORCORR=1 2 4\nEXPOSURE=.5\n"))
    np.testing.assert_allclose(corrected, plain / [0.5, 1, 2], rtol=1e-6)
    for bad in ("EXPOSURE=0\n", "EXPOSURE=-1\n", "EXPOSURE=nan\n", "EXPOSURE=much\n", "COLORCORR=1 2\n"):
        with pytest.raises(UsageError, match=bad[:8]):
            read_image(hdr(tmp_path / "d.hdr", bad))


def test_hdr_primaries_are_converted(tmp_path: Path) -> None:
    plain = read_image(hdr(tmp_path / "a.hdr"))
    words = " ".join(map(str, REC_2020))
    matrix = rec_709_matrix(REC_2020)
    assert matrix is not None
    converted = read_image(hdr(tmp_path / "b.hdr", f"PRIMARIES={words}\n"))
    np.testing.assert_allclose(converted, plain.astype(np.float64) @ matrix.T, rtol=1e-5)
    same = " ".join(map(str, REC_709))
    np.testing.assert_array_equal(read_image(hdr(tmp_path / "c.hdr", f"PRIMARIES={same}\n")), plain)
    with pytest.raises(UsageError, match="32-bit_rle_xyze, not 32-bit_rle_rgbe"):
        read_image(hdr(tmp_path / "d.hdr", "FORMAT=32-bit_rle_xyze\n"))


def test_hdr_begins_in_any_corner(tmp_path: Path) -> None:
    upright = read_image(hdr(tmp_path / "a.hdr"))
    turned = {
        "+Y 2 +X 3": upright[::-1],
        "-Y 2 -X 3": upright[:, ::-1],
        "+Y 2 -X 3": upright[::-1, ::-1],
        "+X 2 -Y 3": upright.transpose(1, 0, 2),
        "-X 2 -Y 3": upright.transpose(1, 0, 2)[:, ::-1],
        "+X 2 +Y 3": upright.transpose(1, 0, 2)[::-1],
        "-X 2 +Y 3": upright.transpose(1, 0, 2)[::-1, ::-1],
    }
    for size, expected in turned.items():
        np.testing.assert_array_equal(read_image(hdr(tmp_path / "b.hdr", size=size)), expected)
    for size in ("-Y 2 +Y 3", "-Z 2 +X 3", "2 3"):
        with pytest.raises(UsageError, match="size"):
            read_image(hdr(tmp_path / "b.hdr", size=size))


def test_hdr_with_the_run_lengths_of_before_1991(tmp_path: Path) -> None:
    a, b = b"\x80\x90\xa0\x81", b"\xff\x01\x02\x82"
    body = a + b"\1\1\1\5" + b + b"\1\1\1\1" + b"\1\1\1\1"
    loaded = read_image(hdr(tmp_path / "a.hdr", size="-Y 1 +X 264", body=body))
    flat = read_image(hdr(tmp_path / "b.hdr", size="-Y 1 +X 7", body=a * 6 + b))
    np.testing.assert_array_equal(loaded[0, :7], flat[0])
    assert (loaded[0, 7:] == flat[0, 6]).all()


def test_hdr_is_as_limited_as_every_image(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="65536 x 65536 pixels are not between 1 and 1073741824"):
        read_image(hdr(tmp_path / "a.hdr", size="-Y 65536 +X 65536"))


# --- PNG and JPEG ----------------------------------------------------------------------------------------------------


def png(pixels: npt.NDArray[Any], color: int, clear: tuple[int, ...] = ()) -> bytes:
    """PNG of 16 bits a channel; Pillow writes none of colours."""

    def chunk(name: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data))

    height, width = pixels.shape[:2]
    rows = b"".join(b"\0" + row.astype(">u2").tobytes() for row in pixels)
    header = chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, 16, color, 0, 0, 0))
    if clear:
        header += chunk(b"tRNS", struct.pack(f">{len(clear)}H", *clear))
    return b"\x89PNG\r\n\x1a\n" + header + chunk(b"IDAT", zlib.compress(rows)) + chunk(b"IEND", b"")


@pytest.mark.parametrize(("color", "channels"), [(0, 1), (2, 3), (6, 4)])
def test_png_of_sixteen_bits_keeps_them(tmp_path: Path, color: int, channels: int) -> None:
    pixels = np.random.default_rng(1).integers(0, 65536, (9, 11, channels))
    (tmp_path / "a.png").write_bytes(png(pixels, color))
    expected = srgb_decode(pixels[..., :3] / 65535).astype(np.float32)
    np.testing.assert_array_equal(read_image(tmp_path / "a.png"), np.broadcast_to(expected, (9, 11, 3)))


@for_each("clear", [(40000,), (40000, 3, 65535)])
def test_png_of_sixteen_bits_with_a_clear_colour(tmp_path: Path, clear: tuple[int, ...]) -> None:
    """Of 16 bits: what differs in the lower eight is not clear."""
    pixels = np.full((2, 3, len(clear)), 257)
    pixels[0, 1] = clear
    pixels[1, 2] = np.array(clear) ^ 1
    (tmp_path / "a.png").write_bytes(png(pixels, 0 if len(clear) == 1 else 2, clear))
    with (tmp_path / "a.png").open("rb") as file:
        picture = open_picture(file, ".png")
        texels = np.concatenate(list(picture.bands()))
    assert (picture.channels, picture.coding) == (4, "unorm16")
    np.testing.assert_array_equal(texels[..., :3], np.broadcast_to(pixels, (2, 3, 3)))
    assert texels[..., 3].tolist() == [[65535, 0, 65535], [65535, 65535, 65535]]
    expected = srgb_decode(pixels / 65535).astype(np.float32)
    np.testing.assert_array_equal(read_image(tmp_path / "a.png"), np.broadcast_to(expected, (2, 3, 3)))


def test_png_of_sixteen_bits_that_cannot_be_read(tmp_path: Path) -> None:
    (tmp_path / "a.png").write_bytes(png(np.zeros((3, 3, 2), int), 4))
    with pytest.raises(UsageError, match="save it without alpha"):
        read_image(tmp_path / "a.png")


@for_each("mode", ["1", "L", "LA", "P", "RGBA", "RGB"])
def test_png_of_every_mode(tmp_path: Path, mode: str) -> None:
    picture = Image.fromarray(to_display(ramp() / 5)).convert(mode)
    picture.save(tmp_path / "a.png")
    expected = srgb_decode(np.asarray(picture.convert("RGB")) / 255).astype(np.float32)
    np.testing.assert_array_equal(read_image(tmp_path / "a.png"), expected)


@pytest.mark.parametrize("ending", [".png", ".jpg"])
def test_what_is_written_is_read_however_large(tmp_path: Path, ending: str, monkeypatch: pytest.MonkeyPatch) -> None:
    # Pillow refuses images of more than twice this many pixels, 179 million by default.
    monkeypatch.setattr(Image, "MAX_IMAGE_PIXELS", 100)
    write_image(tmp_path / f"a{ending}", ramp(40, 50), {"seed": 4})
    assert read_image(tmp_path / f"a{ending}").shape == (40, 50, 3)
    assert ending == ".jpg" or read_provenance(tmp_path / f"a{ending}") == {"seed": 4}


def test_png_and_jpeg_that_are_too_small_for_their_size_take_no_memory(tmp_path: Path) -> None:
    Image.new("RGB", (8, 8)).save(tmp_path / "a.png")
    Image.new("RGB", (8, 8)).save(tmp_path / "a.jpg")
    data = bytearray((tmp_path / "a.png").read_bytes())
    data[16:24] = struct.pack(">II", 30000, 30000)
    data[29:33] = struct.pack(">I", zlib.crc32(data[12:29]))
    (tmp_path / "a.png").write_bytes(data)
    data = bytearray((tmp_path / "a.jpg").read_bytes())
    at = data.index(b"\xff\xc0")
    data[at + 5 : at + 9] = struct.pack(">HH", 30000, 30000)
    (tmp_path / "a.jpg").write_bytes(data)
    for name in ("a.png", "a.jpg"):
        with pytest.raises(UsageError, match="too small for the size its header gives"):
            read_image(tmp_path / name)


# --- NumPy -----------------------------------------------------------------------------------------------------------


def npy(header: str | bytes, body: bytes = bytes(12), version: int = 1) -> bytes:
    text = header if isinstance(header, bytes) else header.encode()
    return b"\x93NUMPY" + bytes([version, 0]) + struct.pack("<H" if version == 1 else "<I", len(text)) + text + body


GOOD = "{'descr': '<f4', 'fortran_order': False, 'shape': (1, 1, 3)}"


@for_each(
    "data",
    [
        npy(GOOD.replace("}", "")),
        npy(GOOD.replace("'<f4'", "'<f4")),
        npy(GOOD.replace("(1, 1, 3)", "(1L, 1L, 3)")),
        npy(GOOD.replace("(1, 1, 3)", "(1, 1, 3")),
        npy("(" * 9000),
        npy("-" * 9000),
        npy(GOOD.replace("<f4", "|O")),
        npy(GOOD.replace("<f4", "<f16")),
        npy(GOOD.replace("1, 1, 3", "True, 1, 3")),
        npy(GOOD.replace("1, 1, 3", "-1, -1, 3")),
        npy(GOOD.replace("1, 1, 3", "1, 1, 3.0")),
        npy(GOOD, b""),
        npy(GOOD, bytes(13)),
        npy(GOOD + " " * 20_000, version=2),
        npy(b"\xff\xfe\0" * 30),
        npy("{'descr': '<f4'}"),
        npy("5"),
        npy(GOOD, version=9),
    ],
)
def test_malformed_npy_is_one_sentence(tmp_path: Path, data: bytes) -> None:
    (tmp_path / "a.npy").write_bytes(data)
    with pytest.raises(UsageError, match=r"a\.npy: not a readable \.npy image"):
        read_image(tmp_path / "a.npy")


@pytest.mark.parametrize("kind", ["<f2", ">f4", "<f8", ">f8"])
def test_npy_of_every_float(tmp_path: Path, kind: str) -> None:
    for order in "CF":
        np.save(tmp_path / "a.npy", np.asarray(ramp(), kind, order=order))  # type: ignore[call-overload]
        np.testing.assert_array_equal(read_image(tmp_path / "a.npy"), ramp().astype(kind).astype(np.float32))


# --- round trips -----------------------------------------------------------------------------------------------------

IMAGES = hnp.arrays(
    np.float32,
    st.tuples(st.integers(1, 20), st.integers(1, 20), st.just(3)),
    elements=st.floats(width=32, allow_nan=True, allow_infinity=True),
)
TEXTS = st.text(max_size=20)
PROVENANCE = st.dictionaries(
    TEXTS,
    st.recursive(
        st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False, allow_infinity=False) | TEXTS,
        lambda inner: st.lists(inner, max_size=3) | st.dictionaries(TEXTS, inner, max_size=3),
        max_leaves=6,
    ),
    max_size=4,
)
TRIPS = settings(max_examples=60, deadline=None, derandomize=True)


@TRIPS
@given(image=IMAGES, provenance=PROVENANCE)
def test_linear_round_trip(
    image: Picture, provenance: dict[str, Any], tmp_path_factory: pytest.TempPathFactory
) -> None:
    folder = tmp_path_factory.getbasetemp()
    for ending in (".exr", ".npy"):
        write_image(folder / f"trip{ending}", image, provenance)
        loaded = read_image(folder / f"trip{ending}")
        assert loaded.tobytes() == image.tobytes() and loaded.shape == image.shape
    assert read_provenance(folder / "trip.exr") == provenance


@TRIPS
@given(image=hnp.arrays(np.uint8, st.tuples(st.integers(1, 20), st.integers(1, 20), st.just(3))), provenance=PROVENANCE)
def test_display_round_trip(
    image: npt.NDArray[np.uint8], provenance: dict[str, Any], tmp_path_factory: pytest.TempPathFactory
) -> None:
    path = tmp_path_factory.getbasetemp() / "trip.png"
    write_image(path, srgb_decode(image / 255), provenance)
    np.testing.assert_array_equal(to_display(read_image(path)), image)
    assert read_provenance(path) == provenance


@TRIPS
@given(image=IMAGES)
def test_hdr_round_trip(image: Picture, tmp_path_factory: pytest.TempPathFactory) -> None:
    path = tmp_path_factory.getbasetemp() / "trip.hdr"
    write_image(path, image)
    once = read_image(path)
    largest = np.minimum(np.nan_to_num(np.maximum(image, 0), nan=0.0, posinf=1.7e38), 1.69e38)
    error = np.abs(once.astype(np.float64) - largest).max(axis=2)
    assert (error <= np.maximum(largest.max(axis=2) / 128, 1e-38)).all()
    write_image(path, once)
    np.testing.assert_array_equal(read_image(path), once)


# --- files that are none ---------------------------------------------------------------------------------------------


@for_each("kind", ["pipe", "socket", "device", "folder"])
@for_each("ending", [".exr", ".npy", ".hdr", ".png", ".jpg"])
def test_what_is_no_file_is_refused_at_once(tmp_path: Path, kind: str, ending: str) -> None:
    path = tmp_path / f"a{ending}"
    with special(path, kind):
        for read in (read_image, read_provenance):
            with pytest.raises(UsageError, match=r"only regular files are read|is a folder"):
                read(path)


def test_regular_files_are_opened_for_reading_in_peace(tmp_path: Path) -> None:
    (tmp_path / "a").write_bytes(b"abc")
    with open_input(tmp_path / "a") as file:
        assert isinstance(file, io.BufferedReader) and file.read() == b"abc"
