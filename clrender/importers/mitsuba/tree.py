"""Builds objects from XML: defaults, includes, references and the names of 0.6."""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Callable, Mapping
from pathlib import PurePosixPath
from typing import Final

from clrender.errors import SceneError
from clrender.importers.asset_files import AssetFiles
from clrender.importers.mitsuba.plugins import Plugin
from clrender.importers.mitsuba.values import VALUE_TAGS, ValueReader
from clrender.importers.mitsuba.xml_elements import FILE_LIMIT, Element, parsed
from clrender.wording import printable, quoted, suggestion

__all__ = ["scene_tree"]

_KINDS: Final = frozenset(
    [
        "shape",
        "bsdf",
        "emitter",
        "texture",
        "sensor",
        "film",
        "rfilter",
        "sampler",
        "integrator",
        "medium",
        "phase",
        "volume",
        "subsurface",
    ]
)
_MOVING: Final = frozenset(["emitter", "shape", "sensor"])
"""What follows animated transforms."""
_OTHER_NAMES: Final = {"camera": "sensor", "luminaire": "emitter"}
_LEFT_OUT: Final = frozenset(["mode", "hide"])
"""Elements of other programs, which Mitsuba 0.6 ignores in practice."""
_INCLUDE_DEPTH: Final = 8
_INCLUDES: Final = 256
_TEXT_LIMIT: Final = 2**20
_LENGTH: Final = 2**22
"""Most characters of all attributes after parameter substitution."""
_ALIASES: Final = 64
_PARAMETER: Final = re.compile(r"\$([A-Za-z_][A-Za-z0-9_]*)")


class _Builder:
    """Builds objects in one pass over the elements."""

    def __init__(self, files: AssetFiles, note: Callable[[str], None], define: Mapping[str, str]) -> None:
        self._files, self._note = files, note
        self._defaults = dict(define)
        self.used: set[str] = set()
        self._by_id: dict[str, Plugin] = {}
        self._included = self._put_in = 0
        self.old = False

    def scene(self, data: bytes, source: str, depth: int = 0) -> Plugin:
        root = parsed(data, source)
        if root.tag != "scene":
            cure = "Mitsuba's files begin with <scene version=...>"
            raise SceneError(f"{source}: line {root.line}: begins with <{quoted(root.tag)[1:-1]}>; {cure}")
        version = root.attributes.get("version", "3.0.0").split(".")[0]
        if not version.isdecimal():
            text = quoted(root.attributes["version"])
            raise SceneError(f"{source}: line {root.line}: the version is {text}, but must be as 3.0.0")
        if depth == 0:
            self.old = int(version) < 2
        plugin = Plugin("scene", "scene", "", "", source, root.line)
        self._fill(plugin, root, depth)
        return plugin

    def _fill(self, plugin: Plugin, element: Element, depth: int) -> None:
        values = ValueReader(plugin.source, self._note, self._text_file, self.old)
        for child in element.children:
            child.attributes = {
                key: self._with_parameters(values, child, text) for key, text in child.attributes.items()
            }
            tag = _OTHER_NAMES.get(child.tag, child.tag)
            nested_spectrum = tag == "spectrum" and "type" in child.attributes
            if tag == "default":
                name = values.attribute(child, "name")
                self._defaults.setdefault(name, values.attribute(child, "value"))
            elif tag == "include":
                self._include(plugin, child, values, depth)
            elif tag == "alias":
                wanted, other = values.attribute(child, "id"), values.attribute(child, "as")
                self._by_id[other] = Plugin("ref", "ref", "", wanted, plugin.source, child.line)
            elif tag == "ref":
                self._refer(plugin, child, values)
            elif tag == "path":
                self._files.search(values.attribute(child, "value"))
            elif tag in _KINDS or nested_spectrum:
                plugin.children.append(self._plugin(plugin, tag, child, values, depth))
            elif tag in VALUE_TAGS:
                self._put_steps_in(child, values)
                name = self._renamed(values.attribute(child, "name"))
                plugin.values[name] = values.read(child)
                if plugin.values[name].keys and plugin.kind not in _MOVING:
                    self._note(f"the animated transform of {plugin.label} is read as it is at its first moment")
            elif tag not in _LEFT_OUT:
                known = sorted((_KINDS | VALUE_TAGS) | {"default", "include", "alias", "ref"})
                raise values.fault(child, f"<{quoted(tag)[1:-1]}> is not known{suggestion(tag, known)}")

    def _plugin(self, parent: Plugin, tag: str, element: Element, values: ValueReader, depth: int) -> Plugin:
        name = self._renamed(element.attributes.get("name", ""))
        made = Plugin(
            tag,
            values.attribute(element, "type"),
            name,
            element.attributes.get("id", ""),
            parent.source,
            element.line,
        )
        self._fill(made, element, depth)
        if made.id:
            self._by_id[made.id] = made
        return made

    def _refer(self, plugin: Plugin, element: Element, values: ValueReader) -> None:
        """Insert a placeholder for a reference, whose target may come later."""
        name = self._renamed(element.attributes.get("name", ""))
        plugin.children.append(Plugin("ref", "ref", name, values.attribute(element, "id"), plugin.source, element.line))

    def resolve(self, scene: Plugin) -> None:
        """Replace references by their targets."""
        ahead, seen = [scene], {id(scene)}
        while ahead:
            plugin = ahead.pop()
            plugin.children = [self._referred(child) if child.kind == "ref" else child for child in plugin.children]
            for child in plugin.children:
                if id(child) not in seen:
                    seen.add(id(child))
                    ahead.append(child)

    def _referred(self, mark: Plugin) -> Plugin:
        wanted = mark.id
        for _ in range(_ALIASES):
            found = self._by_id.get(wanted)
            if found is None:
                text = f"refers to {quoted(mark.id)}, which is not defined{suggestion(mark.id, self._by_id)}"
                raise mark.fault(text)
            if found.kind != "ref":
                break
            wanted = found.id
        else:
            raise mark.fault(f"refers to {quoted(mark.id)}, whose aliases go round in a circle")
        if not mark.name or mark.name == found.name:
            return found
        # The same object under another name; they share the list `children`, so its references are replaced once
        return dataclasses.replace(found, name=mark.name)

    def _include(self, plugin: Plugin, element: Element, values: ValueReader, depth: int) -> None:
        self._included += 1
        if depth >= _INCLUDE_DEPTH or self._included > _INCLUDES:
            text = f"files include others more than {_INCLUDE_DEPTH} deep, or more than {_INCLUDES} in all"
            raise values.fault(element, f"{text}; put them together")
        name = values.attribute(element, "filename")
        data = self._files.read(name, f"line {element.line}", FILE_LIMIT)
        source = f"{self._files.source}: {PurePosixPath(printable(name)).name}"
        inner = self.scene(data, source, depth + 1)
        plugin.children.extend(inner.children)
        plugin.values.update(inner.values)

    def _put_steps_in(self, element: Element, values: ValueReader) -> None:
        """Substitute parameters in the children of a value, such as the steps of a transform."""
        for child in element.children:
            child.attributes = {
                key: self._with_parameters(values, child, text) for key, text in child.attributes.items()
            }
            self._put_steps_in(child, values)

    def _with_parameters(self, values: ValueReader, element: Element, text: str) -> str:
        if "$" not in text:
            return text

        def value(match: re.Match[str]) -> str:
            if match[1] not in self._defaults:
                cure = "give it a <default>"
                raise values.fault(element, f"the parameter ${match[1][:60]} has no value; {cure}")
            self.used.add(match[1])
            return self._defaults[match[1]]

        replaced = _PARAMETER.sub(value, text)
        self._put_in += len(replaced)
        if self._put_in > _LENGTH:
            raise values.fault(element, "values become too long when their parameters are put in")
        return replaced

    def _renamed(self, name: str) -> str:
        """The current name for one of 0.6."""
        return re.sub(r"(?<=[a-z0-9])(?=[A-Z])", "_", name).lower() if self.old else name

    def _text_file(self, name: str, line: int) -> str:
        return self._files.read(name, f"line {line}", _TEXT_LIMIT).decode("utf-8", "replace")


def scene_tree(
    data: bytes, files: AssetFiles, note: Callable[[str], None], define: Mapping[str, str] | None = None
) -> tuple[Plugin, bool]:
    """Parse a scene into objects.

    Parameters
    ----------
    data : bytes
        Content of the file.
    files : AssetFiles
    note : callable
        Called with a sentence about a deviation from the file.
    define : mapping of str to str, optional
        Values of parameters, before the file's defaults.

    Returns
    -------
    scene : Plugin
    old : bool
        Whether it is one of 0.6 or older, whose defaults differ.

    Raises
    ------
    SceneError
        It is not valid XML, or not a Mitsuba scene.
    """
    builder = _Builder(files, note, define or {})
    scene = builder.scene(data, files.source)
    for name in sorted((define or {}).keys() - builder.used):
        note(f"the parameter ${name[:60]} is defined, but the scene does not use it")
    builder.resolve(scene)
    return scene, builder.old
