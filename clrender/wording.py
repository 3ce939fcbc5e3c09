"""Parts of messages: quoted values, numbers, locations in a file, and the nearest known name."""

from __future__ import annotations

import difflib
import re
import sys
from collections.abc import Iterable
from typing import Any, Final

__all__ = ["counted", "grouped", "place", "printable", "quoted", "rounded", "shown", "suggestion"]

_PLAIN = re.compile(r"[A-Za-z0-9_-]{1,60}\Z")
_MEANT: Final = {
    **dict.fromkeys(("fov", "yfov", "field_of_view", "vfov"), ("vertical_fov",)),
    **dict.fromkeys(("look_at", "lookat", "interest"), ("target",)),
    **dict.fromkeys(("origin", "eye", "location"), ("position", "origin")),
    **dict.fromkeys(("samples", "sample_count", "samples_per_pixel"), ("spp",)),
    **dict.fromkeys(("bounces", "max_bounces", "depth"), ("max_depth",)),
    **dict.fromkeys(("color", "colour", "albedo", "kd", "diffuse_color"), ("reflectance", "base_color")),
    **dict.fromkeys(("basecolor", "reflectance"), ("base_color", "f0")),
    **dict.fromkeys(("metalness", "metallic_factor"), ("metallic",)),
    **dict.fromkeys(("index_of_refraction", "int_ior", "refraction_index"), ("ior",)),
    **dict.fromkeys(("power", "energy", "strength"), ("intensity", "irradiance", "radiance", "emission")),
    **dict.fromkeys(("angle", "cone_angle", "cutoff_angle", "spot_size"), ("cone_degrees",)),
    **dict.fromkeys(("rotate", "rotation", "translate", "translation", "scale", "to_world"), ("transform",)),
    **dict.fromkeys(("filename", "file_name", "path", "src"), ("file",)),
    **dict.fromkeys(("bsdf", "shader"), ("material",)),
    **dict.fromkeys(("diffuse", "matte"), ("lambert",)),
    **dict.fromkeys(("glass", "refractive"), ("dielectric",)),
    **dict.fromkeys(("metal", "glossy"), ("conductor",)),
    **dict.fromkeys(("plastic", "standard", "disney", "pbr", "openpbr"), ("principled",)),
    **dict.fromkeys(("cube", "cuboid"), ("box",)),
    **dict.fromkeys(("plane", "rectangle", "rect", "square"), ("quad",)),
    **dict.fromkeys(("obj", "ply", "trimesh", "trianglemesh"), ("mesh",)),
    **dict.fromkeys(("sun", "distant"), ("directional",)),
    **dict.fromkeys(("sky",), ("sun_sky",)),
    **dict.fromkeys(("hdri", "dome", "envmap", "infinite", "constant"), ("environment",)),
}
"""What other programs call a key or a type, and its names here, of which a place knows one at most."""
_ALIKE: Final = 0.85
"""Similarity from which on a name is a slip of the pen, whatever it means elsewhere."""


def _shortened(text: str, limit: int) -> str:
    return text if len(text) <= limit else text[: limit - 3] + "..."


def printable(text: str) -> str:
    """A text on one line, such as the name of a file: letters of all languages as they are, all else as escapes.

    Escapes are backslashes, and what could deceive the eye or a terminal: control characters, those that turn the
    direction of writing, and bytes that are no text.
    """
    return "".join(each if each.isprintable() and each != "\\" else ascii(each)[1:-1] for each in text)


def quoted(name: str) -> str:
    """A name in double quotes, on one line, printable and truncated."""
    inner = printable(_shortened(name, 60)).replace('"', '\\"')
    return f'"{inner}"'


def shown(value: Any) -> str:
    """An invalid value, formatted for a sentence."""
    if isinstance(value, str):
        return f"the text {quoted(value)}"
    if value is None or isinstance(value, bool):
        return {None: "null", True: "true", False: "false"}[value]
    if isinstance(value, dict):
        return "a table"
    numpy = sys.modules.get("numpy")  # commands that compute nothing do not load it
    if numpy is not None and isinstance(value, numpy.ndarray):
        return f"an array of shape {value.shape}"
    if isinstance(value, list | tuple):
        return f"a list of {len(value)}" if len(value) != 1 else "a list of one"
    if isinstance(value, int):
        # Python refuses to format integers of thousands of digits, and nobody would read them.
        return str(value) if abs(value) < 10**30 else "an integer of more than 30 digits"
    if isinstance(value, float):
        return repr(value)
    return _shortened(ascii(value), 40)


def grouped(number: int) -> str:
    """A whole number with all digits, in groups of three if there are more than four: 1470, 58,880,000."""
    return f"{number:,}" if abs(number) >= 10_000 else f"{number}"


def counted(number: int, one: str, many: str | None = None) -> str:
    """A number and what is counted, in the singular or the plural: 1 sample, 58,880,000 samples.

    Parameters
    ----------
    number : int
    one : str
        What is counted, in the singular.
    many : str, optional
        The plural; default: the singular and an s.
    """
    return f"{grouped(number)} {one if number == 1 else many or one + 's'}"


def rounded(number: float, digits: int = 3) -> str:
    """A number with so many significant digits, but all those of a whole number, and no exponent: 0.125, 1470, 58,880.

    Below a ten-thousandth it has an exponent, as no digit could be told from the zeros.
    """
    number = float(f"{number:.{digits}g}") if abs(number) < 10.0**digits else round(number)
    return grouped(int(number)) if number == int(number) else f"{number:.{digits}g}"


def suggestion(wrong: object, known: Iterable[str]) -> str:
    """The end of a sentence: the nearest known name, or all of them if there are few, or nothing."""
    names = [str(name) for name in known]
    if not names:
        return "; there is none here"
    near = difflib.get_close_matches(str(wrong)[:200], names, n=1, cutoff=_ALIKE)
    near = near or [name for name in _MEANT.get(str(wrong).lower().replace("-", "_"), ()) if name in names]
    near = near or difflib.get_close_matches(str(wrong)[:200], names, n=1, cutoff=0.6)
    if near:
        return f"; did you mean {quoted(near[0])}?"
    if len(names) <= 16:
        return f"; known here: {', '.join(quoted(name)[1:-1] for name in names)}"
    return ""


def place(location: Iterable[str | int]) -> str:
    """A location in a file, such as ``materials.white.reflectance[1]``."""
    text = ""
    for step in location:
        if isinstance(step, int):
            text += f"[{step}]"
        else:
            name = step if _PLAIN.match(step) else quoted(step)
            text += f".{name}" if text else name
    return text
