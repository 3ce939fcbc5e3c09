"""LuxCore's properties: lines of text, each a name and its values."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any, Final

import numpy as np

__all__ = ["NO_ID", "Properties", "property_text"]

Properties = dict[str, Any]
NO_ID: Final = re.compile(r"[^A-Za-z0-9_-]")
"""What LuxCore's names lack: dots and blanks, which separate them."""


def property_text(properties: Mapping[str, Any]) -> bytes:
    """The lines of properties.

    Parameters
    ----------
    properties : mapping of str to value
        Values: a bool, int, float or str, or several floats.
    """
    lines = (f"{name} = {_words(value)}" for name, value in properties.items())
    return "".join(f"{line}\n" for line in lines).encode("utf-8")


def _words(value: Any) -> str:
    if isinstance(value, bool | int):
        return str(int(value))
    if isinstance(value, str):
        return f'"{value}"'
    return " ".join(repr(float(x)) for x in np.asarray(value, np.float64).ravel())
