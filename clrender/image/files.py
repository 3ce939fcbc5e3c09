"""Images on disk: `.png .jpg` for display, `.exr .hdr .npy` linear, with provenance, and never half written."""

from __future__ import annotations

import hashlib
import importlib
import io
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import IO, Any, Final

import numpy as np
import numpy.typing as npt

from clrender.errors import UsageError
from clrender.files import atomic_write, check_writable, open_input
from clrender.image.tone_map import to_display

__all__ = [
    "DISPLAY_ENDINGS",
    "FILM_ENDINGS",
    "JPEG_SIDE_LIMIT",
    "LINEAR_ENDINGS",
    "OUTPUT_ENDINGS",
    "check_output",
    "image_sha256",
    "png_bytes",
    "read_image",
    "read_provenance",
    "write_image",
]

DISPLAY_ENDINGS: Final = (".png", ".jpg", ".jpeg")
LINEAR_ENDINGS: Final = (".exr", ".npy", ".hdr")
FILM_ENDINGS: Final = (".film",)
OUTPUT_ENDINGS: Final = (*DISPLAY_ENDINGS, *LINEAR_ENDINGS, *FILM_ENDINGS)
"""What a render can be written to."""

JPEG_SIDE_LIMIT: Final = 65500
"""Most pixels along a side of a .jpg."""
_PNG_KEY: Final = "clrender"
_PIXEL_LIMIT: Final = 1 << 30
_Image = npt.NDArray[np.float32]


def image_sha256(linear: npt.ArrayLike) -> str:
    """SHA-256 of the little-endian float32 (H, W, 3) bytes in C order, as 64 hexadecimal digits."""
    return hashlib.sha256(np.ascontiguousarray(linear, "<f4").data).hexdigest()


def check_output(path: str | Path, endings: Sequence[str] = OUTPUT_ENDINGS) -> None:
    """Make sure, before any work is done, that an image can be written to `path`.

    Raises
    ------
    UsageError
        An ending that is not one of `endings`, no such folder, or a place that cannot be written.
    """
    path = Path(path)
    if path.suffix.lower() not in endings:
        known = f"{', '.join(endings[:-1])} or {endings[-1]}" if len(endings) > 1 else endings[0]
        what = f"the ending {path.suffix!r} is unknown" if path.suffix else "the name has no ending"
        raise UsageError(f"{path}: {what}; end it in {known}.")
    check_writable(path)


def write_image(
    path: str | Path,
    linear: npt.ArrayLike,
    provenance: Mapping[str, Any] | None = None,
    tone_map: str = "srgb",
    exposure: float = 0.0,
    channels: Mapping[str, npt.NDArray[np.float32]] | None = None,
) -> None:
    """Write an image in the format that the ending of `path` names, all of it or nothing.

    Parameters
    ----------
    path : path
        `.png .jpg .jpeg` are toned for display; `.exr .npy .hdr` keep the linear values (`.hdr` in 8-bit
        mantissas, negative values as 0).
    linear : (H, W, 3) float32
        Radiance, linear Rec. 709.
    provenance : mapping, optional
        JSON-able; kept in `.png` (iTXt chunk `clrender`) and `.exr` (string attribute `clrender`).
    tone_map, exposure
        Of display images; see `clrender.image.tone_map.to_display`.
    channels : mapping of str to (H, W) float32, optional
        More channels, kept in `.exr` beside R, G and B; the other formats have no room for them.

    Raises
    ------
    UsageError
        Unknown ending or tone map, or an array that is no image.
    RenderError
        The file cannot be written.
    """
    path = Path(path)
    image = _as_image(linear)
    ending = path.suffix.lower()
    with atomic_write(path) as file:
        if ending == ".png":
            file.write(png_bytes(image, provenance, tone_map, exposure))
        elif ending in (".jpg", ".jpeg"):
            file.write(_jpeg_bytes(image, tone_map, exposure))
        elif ending == ".exr":
            _write_exr(file, image, provenance, channels or {})
        elif ending == ".npy":
            description = {"descr": "<f4", "fortran_order": False, "shape": image.shape}
            np.lib.format.write_array_header_1_0(file, description)
            file.write(image.data)  # NumPy's own writer does not say why a disk refused
        elif ending == ".hdr":
            from clrender.image.radiance_hdr import write_hdr

            write_hdr(file, image)
        else:
            raise UsageError(
                f"{path}: the ending {path.suffix!r} is unknown; end it in "
                f"{', '.join(DISPLAY_ENDINGS + LINEAR_ENDINGS)}."
            )


def read_image(path: str | Path) -> _Image:
    """Linear image from `.exr`, `.npy` or `.hdr`, or a display image as its sRGB-decoded values.

    Returns
    -------
    (H, W, 3) float32
        Linear Rec. 709; for `.png .jpg` between 0 and 1, as a display would show them.

    Raises
    ------
    UsageError
        No such file, an unknown ending, or a file that is not what its ending says.
    """
    path = Path(path)
    readers = {".exr": _read_exr, ".npy": _read_npy, ".hdr": _read_hdr}
    ending = path.suffix.lower()
    reader = _read_display if ending in DISPLAY_ENDINGS else readers.get(ending)
    if reader is None:
        raise UsageError(
            f"{path}: the ending {path.suffix!r} is unknown; expected one of "
            f"{', '.join(DISPLAY_ENDINGS + LINEAR_ENDINGS)}."
        )
    with open_input(path) as file:
        try:
            return reader(file)
        except (ValueError, TypeError, KeyError, EOFError, RuntimeError, SyntaxError, MemoryError) as error:
            reason = str(error).strip().splitlines()[0] if str(error).strip() else type(error).__name__
            raise UsageError(f"{path}: not a readable {ending} image ({reason}).") from None


def read_provenance(path: str | Path) -> dict[str, Any] | None:
    """What a `.png` or `.exr` written by clrender says of its making; None when it says nothing.

    Raises
    ------
    UsageError
        The file cannot be read.
    """
    path = Path(path)
    with open_input(path) as file:
        try:
            if path.suffix.lower() == ".exr":
                text = _openexr().File(file, header_only=True).header().get("clrender")
            elif path.suffix.lower() == ".png":
                from PIL import Image

                with Image.open(file, formats=("PNG",)) as picture:
                    text = picture.info.get(_PNG_KEY)
            else:
                return None
            return None if text is None else dict(json.loads(str(text)))
        except (ValueError, TypeError, RuntimeError, SyntaxError) as error:
            raise UsageError(f"{path}: its provenance cannot be read ({error}).") from None


def png_bytes(
    linear: npt.ArrayLike,
    provenance: Mapping[str, Any] | None = None,
    tone_map: str = "srgb",
    exposure: float = 0.0,
) -> bytes:
    """PNG file of a linear image, toned for display; parameters as of `write_image`."""
    from PIL import Image
    from PIL.PngImagePlugin import PngInfo

    notes = PngInfo()
    if provenance is not None:
        notes.add_itxt(_PNG_KEY, json.dumps(provenance, sort_keys=True))
    data = io.BytesIO()
    Image.fromarray(to_display(_as_image(linear), tone_map, exposure)).save(data, "PNG", pnginfo=notes)
    return data.getvalue()


def _jpeg_bytes(image: _Image, tone_map: str, exposure: float) -> bytes:
    from PIL import Image

    if max(image.shape) > JPEG_SIDE_LIMIT:
        raise UsageError(
            f"a .jpg holds at most {JPEG_SIDE_LIMIT} pixels a side, not {image.shape[1]} x {image.shape[0]}; use .png."
        )
    data = io.BytesIO()
    Image.fromarray(to_display(image, tone_map, exposure)).save(data, "JPEG", quality=95, subsampling=0)
    return data.getvalue()


def _openexr() -> Any:
    """The OpenEXR library, which has no types and is only loaded for `.exr` files."""
    return importlib.import_module("OpenEXR")


def _write_exr(
    file: IO[bytes], image: _Image, provenance: Mapping[str, Any] | None, channels: Mapping[str, _Image]
) -> None:
    library = _openexr()
    header: dict[str, Any] = {"compression": library.ZIP_COMPRESSION, "type": library.scanlineimage}
    if provenance is not None:
        header["clrender"] = json.dumps(provenance, sort_keys=True)
    # Through memory: the library's own words for a full disk are not an OSError.
    data = io.BytesIO()
    with library.File(header, {"RGB": image, **channels}) as picture:
        picture.write(data)
    file.write(data.getbuffer())


def _read_exr(file: IO[bytes]) -> _Image:
    library = _openexr()
    header = library.File(file, header_only=True).header()
    low, high = header["dataWindow"]
    _check_size(int(high[0]) - int(low[0]) + 1, int(high[1]) - int(low[1]) + 1)
    file.seek(0)
    with library.File(file) as picture:
        channels = picture.channels()
        for name in ("RGB", "RGBA"):
            if name in channels:
                return np.array(channels[name].pixels[..., :3], np.float32)
        raise ValueError(f"its channels are {', '.join(sorted(channels))}, not R, G, B")


def _read_npy(file: IO[bytes]) -> _Image:
    major = np.lib.format.read_magic(file)
    readers = {(1, 0): np.lib.format.read_array_header_1_0, (2, 0): np.lib.format.read_array_header_2_0}
    if major not in readers:
        raise ValueError(f"NumPy's format {major} is not known")
    shape, _, kind = readers[major](file)
    if len(shape) != 3 or shape[2] != 3 or kind.kind != "f":
        raise ValueError(f"it holds {kind} {shape}, not float32 (height, width, 3)")
    _check_size(shape[1], shape[0])
    file.seek(0)
    return _as_image(np.load(file, allow_pickle=False))


def _read_hdr(file: IO[bytes]) -> _Image:
    from clrender.image.radiance_hdr import read_hdr

    return read_hdr(file)


def _read_display(file: IO[bytes]) -> _Image:
    from PIL import Image

    from clrender.image.tone_map import srgb_decode

    try:
        with Image.open(file, formats=("PNG", "JPEG")) as picture:
            _check_size(*picture.size)
            pixels = np.asarray(picture.convert("RGB"))
    except OSError as error:  # Pillow's word for a damaged file
        raise ValueError(str(error)) from None
    return srgb_decode(pixels.astype(np.float64) / 255.0).astype(np.float32)


def _check_size(width: int, height: int) -> None:
    if width < 1 or height < 1 or width * height > _PIXEL_LIMIT:
        raise ValueError(f"{width} x {height} pixels are not between 1 and {_PIXEL_LIMIT}")


def _as_image(linear: npt.ArrayLike) -> _Image:
    image = np.ascontiguousarray(linear, "<f4")
    if image.ndim != 3 or image.shape[2] != 3 or 0 in image.shape:
        raise UsageError(f"an image is an array of (height, width, 3) numbers, not {image.shape}.")
    return image
