"""Image files: `.png .jpg` for display, `.exr .hdr .npy` linear, with provenance, written atomically."""

from __future__ import annotations

import hashlib
import json
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence, Set
from contextlib import contextmanager
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any, Final

import numpy as np
import numpy.typing as npt

from clrender.errors import ClrenderError, UsageError
from clrender.files.access import atomic_write, check_writable, open_input
from clrender.files.npy import read_npy_header, read_npy_items, write_npy
from clrender.image.display import PIXEL_LIMIT, check_size, jpeg_bytes, png_note, read_display
from clrender.image.display import png_bytes as display_png
from clrender.image.raster import RASTER_ENDINGS
from clrender.image.tone_map import DisplayMap, to_display

if TYPE_CHECKING:
    from clrender.image.exr_write import ExrFormat

__all__ = [
    "DISPLAY_ENDINGS",
    "FILM_ENDINGS",
    "LINEAR_ENDINGS",
    "OUTPUT_ENDINGS",
    "check_output",
    "image_sha256",
    "png_bytes",
    "read_coverage",
    "read_image",
    "read_open_image",
    "read_provenance",
    "write_image",
]

DISPLAY_ENDINGS: Final = (".png", ".jpg", ".jpeg")
LINEAR_ENDINGS: Final = (".exr", ".npy", ".hdr")
FILM_ENDINGS: Final = (".film",)
OUTPUT_ENDINGS: Final = (*DISPLAY_ENDINGS, *LINEAR_ENDINGS, *FILM_ENDINGS)
"""File extensions that a render can be written to."""

_NOTE: Final = "clrender"
"""Name under which provenance is stored."""
_NPY_HEADER_LIMIT: Final = 10_000
_Image = npt.NDArray[np.float32]


def image_sha256(linear: npt.ArrayLike) -> str:
    """SHA-256 of the little-endian float32 (H, W, 3) bytes in C order, as 64 hexadecimal digits."""
    return hashlib.sha256(np.ascontiguousarray(linear, "<f4").data).hexdigest()


def check_output(path: str | Path, endings: Sequence[str] = OUTPUT_ENDINGS) -> None:
    """Check, before any work is done, that an image can be written to `path`.

    Raises
    ------
    UsageError
        The extension is not one of `endings`, or the folder does not exist or is not writable.
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
    tone_map: str | DisplayMap = "srgb",
    exposure: float = 0.0,
    channels: Mapping[str, npt.NDArray[np.float32]] | None = None,
    *,
    exr: ExrFormat | None = None,
    exact: Set[str] = frozenset(),
    attributes: Mapping[str, str] | None = None,
    alpha: npt.NDArray[np.float32] | None = None,
) -> None:
    """Write an image atomically, in the format of the extension of `path`.

    Parameters
    ----------
    path : path
        `.png .jpg .jpeg` are tone-mapped for display; `.exr .npy .hdr` store linear values (`.hdr` with 8-bit
        mantissas, negative values as 0).
    linear : (H, W, 3) float32
        Radiance, linear Rec. 709.
    provenance : mapping, optional
        JSON-able; stored in `.png` (iTXt chunk `clrender`) and `.exr` (string attribute `clrender`).
    tone_map, exposure
        For display images; see `clrender.image.tone_map.to_display`.
    channels : mapping of str to (H, W) float32, optional
        Additional channels of `.exr` files, beside R, G and B; other formats omit them.
    exr : ExrFormat, optional
        Storage format of `.exr` files.
    exact : set of str
        Channels that are always 32-bit floats in `.exr` files.
    attributes : mapping of str to str, optional
        Additional texts for the header of `.exr` files.
    alpha : (H, W) float32, optional
        Coverage, 0 to 1, as fourth channel of `.png` files, whose colours are then divided by it.

    Raises
    ------
    UsageError
        Unknown extension or tone map, or an array that is not an image.
    RenderError
        The file cannot be written.
    """
    path = Path(path)
    image = _as_image(linear)
    ending = path.suffix.lower()
    with atomic_write(path) as file:
        if ending == ".png":
            covered = None if alpha is None else np.rint(alpha * np.float32(255.0)).astype(np.uint8)
            file.write(png_bytes(image, provenance, tone_map, exposure, covered))
        elif ending in (".jpg", ".jpeg"):
            file.write(jpeg_bytes(to_display(image, tone_map, exposure)))
        elif ending == ".exr":
            from clrender.image.exr_write import write_exr

            notes = {} if provenance is None else {_NOTE: json.dumps(provenance, sort_keys=True)}
            write_exr(file, image, {**notes, **(attributes or {})}, channels or {}, exr, exact)
        elif ending == ".npy":
            write_npy(file, image)
        elif ending == ".hdr":
            from clrender.image.radiance_hdr import write_hdr

            write_hdr(file, image)
        else:
            raise UsageError(
                f"{path}: the ending {path.suffix!r} is unknown; end it in "
                f"{', '.join(DISPLAY_ENDINGS + LINEAR_ENDINGS)}."
            )


def read_image(path: str | Path, also: Sequence[str] = ()) -> _Image:
    """Linear image from `.exr`, `.npy`, `.hdr` or `.pfm`, or a display image as its sRGB-decoded values.

    Memory is limited by the image that the file's size and format allow, and by 2^30 pixels of 12 bytes each.

    Parameters
    ----------
    path : path
    also : sequence of str
        Extensions that the caller reads by other means, named in errors.

    Returns
    -------
    (H, W, 3) float32
        Linear Rec. 709; of display images between 0 and 1, as displayed.

    Raises
    ------
    UsageError
        No such file, an unknown extension, or a file that is not of its extension's format.
    """
    path = Path(path)
    ending = path.suffix.lower()
    if ending not in _READERS:
        if path.is_dir():
            raise UsageError(f"{path}: is a folder; name an image in it")
        what = f"the ending {path.suffix!r} is unknown" if path.suffix else "the name has no ending"
        known = (*_READERS, *also)
        raise UsageError(f"{path}: {what}; expected one of {', '.join(known)}.")
    with open_input(path) as file:
        return read_open_image(file, ending, f"{path}: not a readable {ending} image")


def read_open_image(file: IO[bytes], ending: str, problem: str, most: int = PIXEL_LIMIT) -> _Image:
    """Like `read_image`, from an open file.

    Parameters
    ----------
    file : binary file
    ending : str
        Extension of its format, one of `DISPLAY_ENDINGS` and `LINEAR_ENDINGS`.
    problem : str
        Prefix of error messages.
    most : int
        Largest number of pixels; checked before memory is allocated.

    Raises
    ------
    UsageError
        It is not of that format, or too large.
    """
    with _whatever_a_library_trips_over(problem):
        return _READERS[ending](file, most)
    raise AssertionError("unreachable")


def read_provenance(path: str | Path) -> dict[str, Any] | None:
    """Provenance of a `.png` or `.exr` written by clrender; None if it has none.

    Raises
    ------
    UsageError
        The file cannot be read.
    """
    path = Path(path)
    with open_input(path) as file, _whatever_a_library_trips_over(f"{path}: its provenance cannot be read"):
        text: str | None = None
        if path.suffix.lower() == ".exr":
            from clrender.image.exr import exr_attribute

            text = exr_attribute(file, _NOTE)
        elif path.suffix.lower() == ".png":
            text = png_note(file, _NOTE)
        return None if text is None else dict(json.loads(text))
    raise AssertionError("unreachable")


@contextmanager
def _whatever_a_library_trips_over(problem: str) -> Iterator[None]:
    """Replace any exception by one sentence: for damaged files, image libraries raise almost any exception."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # the libraries repair what they warn about
            yield
    except (ClrenderError, NameError):
        raise
    except MemoryError:
        raise UsageError(f"{problem} (it is too large for the memory of this machine).") from None
    except Exception as error:
        words = str(error).strip().splitlines()
        raise UsageError(f"{problem} ({words[0][:300] if words else type(error).__name__}).") from None


def png_bytes(
    linear: npt.ArrayLike,
    provenance: Mapping[str, Any] | None = None,
    tone_map: str | DisplayMap = "srgb",
    exposure: float = 0.0,
    alpha: npt.NDArray[np.uint8] | None = None,
) -> bytes:
    """PNG file of a linear image, tone-mapped for display; for the parameters see `write_image`."""
    notes = {} if provenance is None else {_NOTE: json.dumps(provenance, sort_keys=True)}
    image = _as_image(linear)
    if alpha is None:
        return display_png(to_display(image, tone_map, exposure), notes)
    shown = to_display(uncovered(image, alpha), tone_map, exposure)
    return display_png(np.concatenate([shown, alpha[..., None]], axis=2), notes)


def uncovered(linear: npt.NDArray[np.float32], alpha: npt.NDArray[np.uint8]) -> npt.NDArray[np.float32]:
    """Colours of a premultiplied image, as files with straight alpha have them.

    Parameters
    ----------
    linear : (H, W, 3) float32
    alpha : (H, W) uint8
        255: opaque.

    Returns
    -------
    (H, W, 3) float32
        Black where `alpha` is 0.
    """
    share = np.divide(255.0, alpha, out=np.zeros(alpha.shape), where=alpha > 0)
    return (linear.astype(np.float64) * share[..., None]).astype(np.float32)


def read_alpha(path: str | Path) -> npt.NDArray[np.uint8] | None:
    """Alpha of a PNG with 8 bits per channel, (H, W); None if it has none.

    Raises
    ------
    UsageError
        It cannot be read.
    """
    from PIL import Image

    path = Path(path)
    with open_input(path) as file:
        try:
            picture = Image.open(file)
            return np.asarray(picture.getchannel("A"), np.uint8) if "A" in picture.getbands() else None
        except (OSError, ValueError, SyntaxError) as error:
            raise UsageError(f"{path}: not a readable image ({error})") from None


def read_coverage(path: str | Path) -> npt.NDArray[np.float32] | None:
    """Coverage beside the colours of an `.exr`, which are premultiplied by it, (H, W) float32 from 0 to 1.

    Returns
    -------
    ndarray or None
        None if the file is another one, or has no channel ``A``.

    Raises
    ------
    UsageError
        The file cannot be read.
    """
    path = Path(path)
    if path.suffix.lower() != ".exr":
        return None
    from clrender.image.exr import exr_alpha

    with open_input(path) as file, _whatever_a_library_trips_over(f"{path}: not a readable .exr image"):
        return exr_alpha(file)
    raise AssertionError("unreachable")


def _read_exr(file: IO[bytes], most: int) -> _Image:
    from clrender.image.exr import read_exr

    return read_exr(file, most)


def _read_npy(file: IO[bytes], most: int) -> _Image:
    header = read_npy_header(file)
    shape, kind = header.shape, header.kind
    if len(shape) != 3 or shape[2] != 3 or kind.kind != "f" or kind.itemsize > 8:
        raise ValueError(f"it holds {header}, not float32 (height, width, 3)")
    check_size(shape[1], shape[0], most)
    pixels = read_npy_items(file, header)
    with np.errstate(over="ignore"):
        return _as_image(pixels)


def _read_hdr(file: IO[bytes], most: int) -> _Image:
    from clrender.image.radiance_hdr import read_hdr

    return read_hdr(file, most)


def _read_pfm(file: IO[bytes], most: int) -> _Image:
    from clrender.image.pfm import read_pfm

    return read_pfm(file, most)


def _read_raster(file: IO[bytes], most: int) -> _Image:
    from clrender.image.raster import read_raster

    return read_raster(file, most)


_READERS: Final[Mapping[str, Callable[[IO[bytes], int], _Image]]] = {
    ".exr": _read_exr,
    ".npy": _read_npy,
    ".hdr": _read_hdr,
    ".pfm": _read_pfm,
    **dict.fromkeys(DISPLAY_ENDINGS, read_display),
    **dict.fromkeys(RASTER_ENDINGS, _read_raster),
}


def _as_image(linear: npt.ArrayLike) -> _Image:
    image = np.ascontiguousarray(linear, "<f4")
    if image.ndim != 3 or image.shape[2] != 3 or 0 in image.shape:
        raise UsageError(f"an image is an array of (height, width, 3) numbers, not {image.shape}.")
    return image
