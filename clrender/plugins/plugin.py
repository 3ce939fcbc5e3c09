"""Plugins as values: read from a file or a text, checked by the rules, and known by the hash of their text."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from clrender.errors import UsageError
from clrender.plugins.code_rules import check_code
from clrender.plugins.header import Header, Parameter, header_of
from clrender.wording import counted, printable, shown

__all__ = ["PLUGIN_FILE_LIMIT", "Plugin", "as_plugins", "combined", "plugin"]

PLUGIN_FILE_LIMIT: Final = 2**20
"""Largest file of a plugin, bytes."""
_HIDING: Final = re.compile(r"\\[ \t]*\n|\?\?/|[^\n\t\x20-\x7e\xa0-\ud7ff\ue000-\U0010ffff]|[\u2028\u2029]")
"""Continued lines, and control characters and others at which some programs end a line."""


@dataclass(frozen=True)
class Plugin:
    """A BSDF, texture or light in OpenCL C, checked; make one with `clrender.plugin`.

    Attributes
    ----------
    header : Header
        What it says about itself.
    text : str
        The whole file, lines ending in ``\\n``.
    source : str
        Name of its file in messages.
    """

    header: Header
    text: str
    source: str

    @property
    def name(self) -> str:
        """Name by which scenes use it."""
        return self.header.name

    @property
    def kind(self) -> str:
        """``bsdf``, ``texture`` or ``light``."""
        return self.header.kind

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """Its parameters, in the order of the file."""
        return self.header.parameters

    @property
    def sha256(self) -> str:
        """Hash of the text, which determines all that it does to an image."""
        return hashlib.sha256(self.text.encode()).hexdigest()

    def __repr__(self) -> str:
        return f"<clrender plugin {self.name} ({self.kind}) of {self.source}>"


def plugin(given: str | Path) -> Plugin:
    """Read a plugin: a BSDF, texture or light in OpenCL C, which scenes can then use by its name.

    A plugin is compiled and run on the device: take only those that you trust as you trust a program.

    Parameters
    ----------
    given : str or pathlib.Path
        Name of a file, or the text itself, which has more than one line.

    Returns
    -------
    Plugin

    Raises
    ------
    UsageError
        It cannot be read, its header is wrong, or it breaks a rule of kernels; with file and line, and what would be
        right.

    Examples
    --------
    >>> moon = clrender.plugin("minnaert.cl")  # doctest: +SKIP
    >>> clrender.render(scene, plugins=[moon])  # doctest: +SKIP
    """
    if not isinstance(given, str | Path) or (isinstance(given, str) and not given.strip()):
        raise UsageError(f"a plugin is {shown(given)}, but must be the name of a file, or a text of several lines")
    if isinstance(given, str) and "\n" in given:
        text, source = given, "plugin"
    else:
        text, source = _read(Path(given)), printable(str(given))
    if text.startswith("\ufeff"):
        text = text[1:]
    text = text.replace("\r\n", "\n")
    _check_lines(text, source)
    header = header_of(text, source)
    check_code(header, text, source)
    return Plugin(header, text, source)


def _check_lines(text: str, source: str) -> None:
    """Refuse what begins or ends lines for a compiler but not here: rules could not see all of the code."""
    if found := _HIDING.search(text):
        line = text.count("\n", 0, found.start()) + 1
        what = "a line that goes on on the next one" if "\n" in found.group() else f"the characters {found.group()!a}"
        raise UsageError(f"{source}:{line}: {what}: not possible in a plugin, not even in comments; leave it out")


def _read(path: Path) -> str:
    name = printable(str(path))
    try:
        if not path.is_file():
            what = "a folder" if path.is_dir() else "no regular file" if path.exists() else "missing"
            raise UsageError(f"{name}: the plugin is {what}; name its .cl file")
        if path.stat().st_size > PLUGIN_FILE_LIMIT:
            raise UsageError(
                f"{name}: the plugin is larger than {counted(PLUGIN_FILE_LIMIT, 'byte')}; name its .cl file"
            )
        return path.read_bytes().decode("utf-8")
    except UnicodeDecodeError as error:
        line = error.object.count(b"\n", 0, error.start) + 1
        raise UsageError(f"{name}:{line}: not UTF-8; save the plugin in that encoding") from None
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or error
        raise UsageError(f"{name}: the plugin cannot be read ({reason})") from None


def as_plugins(given: Any, what: str = "plugins") -> tuple[Plugin, ...]:
    """Plugins that a caller gave, each only once.

    Parameters
    ----------
    given : Plugin, str, pathlib.Path, iterable of them, or None
        See `plugin`.
    what : str
        Name of the argument in messages.

    Raises
    ------
    UsageError
        Like `plugin` and `combined`; or it is something else.
    """
    if given is None:
        return ()
    several = isinstance(given, Iterable) and not isinstance(given, str)
    found: list[Plugin] = []
    for each in given if several else [given]:
        if not isinstance(each, Plugin | str | Path):
            raise UsageError(f"{what} has {shown(each)}, but must be files of plugins, or what clrender.plugin returns")
        found.append(each if isinstance(each, Plugin) else plugin(each))
    return combined((), found)


def combined(first: Iterable[Plugin], more: Iterable[Plugin]) -> tuple[Plugin, ...]:
    """Plugins together, sorted by name.

    Parameters
    ----------
    first, more : iterable of Plugin

    Raises
    ------
    UsageError
        Two plugins with different texts have one name, or names that the compiler would mistake for each other.
    """
    found: dict[str, Plugin] = {}
    for each in (*first, *more):
        other = found.setdefault(each.name, each)
        if other.text != each.text:
            raise UsageError(
                f"{each.source}: the plugin is called {each.name}, and so is that of {other.source}, whose text is "
                "another one; leave one of them out, or rename it"
            )
    names = sorted(found)
    for name in names:
        for other_name in names:
            a, b = found[name], found[other_name]
            if other_name.startswith(f"{name}_") or (name != other_name and a.header.struct == b.header.struct):
                raise UsageError(
                    f"{b.source}: the plugin {b.name} and the plugin {a.name} of {a.source} could have functions of "
                    "the same name; rename one of them"
                )
    return tuple(found[name] for name in names)
