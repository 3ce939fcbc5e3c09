"""Reads a pbrt-v4 scene into a draft by executing its directives in order."""

from __future__ import annotations

import gzip
import io
import zlib
from collections import deque
from collections.abc import Callable, Hashable
from dataclasses import replace
from functools import cache, partial
from pathlib import Path, PurePosixPath
from typing import Any, Final

import numpy as np

from clrender.exact.matrices import product
from clrender.importers.asset_files import AssetFiles
from clrender.importers.draft import Draft
from clrender.importers.pbrt.film import Camera, Settings
from clrender.importers.pbrt.lights import LightReader
from clrender.importers.pbrt.materials import MaterialReader
from clrender.importers.pbrt.media import MediumReader
from clrender.importers.pbrt.parameters import Parameters
from clrender.importers.pbrt.placing import Part, Placer
from clrender.importers.pbrt.shapes import ShapeReader
from clrender.importers.pbrt.state import TRANSFORMS, Graphics, moved
from clrender.importers.pbrt.textures import TextureReader
from clrender.importers.pbrt.tokens import FILE_LIMIT, Directive, directives
from clrender.importers.shared.matrices import Matrix, inverse, is_affine
from clrender.importers.shared.normal_maps import with_green_across
from clrender.importers.shared.staging import Staging
from clrender.importers.shared.strands import StrandCollector
from clrender.wording import printable, quoted, suggestion

__all__ = ["read"]

_DEPTH: Final = 64
_INCLUDE_DEPTH: Final = 8
_BARE: Final = frozenset(
    [
        "WorldBegin",
        "AttributeBegin",
        "AttributeEnd",
        "TransformBegin",
        "TransformEnd",
        "ObjectEnd",
        "ReverseOrientation",
    ]
)
_TIMES: Final = frozenset(["All", "StartTime", "EndTime"])
"""Words without quotes that follow ActiveTransform."""
_WITHOUT_EFFECT: Final = frozenset(["Accelerator", "Option"])


def read(path: Path, files: AssetFiles) -> Draft:
    """The scene of a pbrt file.

    Raises
    ------
    SceneError
        It is not a valid scene; the message names the line.
    """
    world = _World(files)
    world.run(files.scene(path, FILE_LIMIT), files.source, 0)
    world.finish()
    return world.staging.draft


class _World:
    """Executes directives."""

    def __init__(self, files: AssetFiles) -> None:
        self.staging = Staging(files)
        self._textures = TextureReader(self.staging)
        self._media = MediumReader(self.staging, self._textures)
        self._materials = MaterialReader(self.staging, self._textures, self._media)
        self._strands = StrandCollector(self.staging.draft, self.staging.files.source)
        self._shapes = ShapeReader(self.staging, self._textures, self._materials, self._strands)
        self._lights = LightReader(self.staging, self._textures)
        self._placer = Placer(self.staging, self._textures, self._strands)
        self._settings = Settings(self.staging)
        self._state = Graphics()
        self._stack: list[Graphics] = []
        self._systems: dict[str, tuple[Matrix, Matrix]] = {}
        self._objects: dict[str, list[Part]] = {}
        self._object: list[Part] | None = None
        self._later: deque[Callable[[], object]] = deque()
        """What is done at the end, in the order of the file: what it needs may be defined behind it."""
        self._around = ""
        """Name of the medium around the camera."""
        self._transitions: list[Graphics] = []
        """Of shapes between two media."""
        self._fog: str | None = None
        self._in_world = False
        self._included = 0

    def run(self, data: bytes, source: str, depth: int) -> None:
        """Execute all directives of a file."""
        known: dict[str, Callable[[Directive], None]] = {
            "WorldBegin": self._world_begin,
            "AttributeBegin": self._begin,
            "AttributeEnd": self._end,
            "TransformBegin": self._begin,
            "TransformEnd": self._end,
            "ReverseOrientation": self._reverse,
            "Attribute": self._attribute,
            "Camera": self._camera,
            "Film": self._settings.film,
            "Sampler": self._settings.sampler,
            "Integrator": self._settings.integrator,
            "PixelFilter": self._settings.pixel_filter,
            "ColorSpace": self._color_space,
            "Texture": self._texture,
            "Material": self._material,
            "MakeNamedMaterial": self._make_named_material,
            "NamedMaterial": self._named_material,
            "MakeNamedMedium": self._medium,
            "MediumInterface": self._medium_interface,
            "LightSource": self._light,
            "AreaLightSource": self._area_light,
            "Shape": self._shape,
            "ObjectBegin": self._object_begin,
            "ObjectEnd": self._object_end,
            "ObjectInstance": self._instance,
            "ActiveTransform": self._active,
            "TransformTimes": self._transform_times,
        }
        before = ""
        for directive in directives(data, source):
            name = directive.name
            if before == "ActiveTransform" and name in _TIMES:
                self._state = replace(self._state, active=name)
                before = name
                continue
            before = name
            if name in _BARE and (directive.texts or directive.numbers):
                raise directive.fault(f"{name} takes nothing; remove what stands behind it")
            if name in TRANSFORMS:
                self._state = moved(self._state, directive, self._systems)
            elif name in known:
                known[name](directive)
            elif name in ("Include", "Import"):
                self._include(directive, depth)
            elif name not in _WITHOUT_EFFECT:
                names = [*known, *TRANSFORMS, "Include", "Import"]
                raise directive.fault(f"{quoted(name)} is no directive of pbrt-v4{suggestion(name, names)}")

    def finish(self) -> None:
        """Complete the scene after the last directive."""
        around = self._media.named(self._around)
        if around is not None and all(_sides(state)[0] != self._around for state in self._transitions):
            self._fog = self.staging.fog(around)
        while self._later:
            self._later.popleft()()
        self._strands.finish()
        with_green_across(self.staging)
        if self._stack:
            self.staging.note("blocks of attributes are left open at the end of the file")
        self._settings.finish(self._placer.times, self._placer.moves)

    # --- structure

    def _world_begin(self, directive: Directive) -> None:
        if self._in_world:
            raise directive.fault("WorldBegin stands here a second time; remove it")
        self._in_world = True
        self._state = replace(self._state.with_both(np.eye(4), np.eye(4)), active="All")
        self._systems["world"] = np.eye(4), np.eye(4)
        self._placer.exposure = self._lights.exposure = self._media.exposure = self._settings.exposure()

    def _begin(self, directive: Directive) -> None:
        if len(self._stack) >= _DEPTH:
            raise directive.fault(f"blocks are nested more than {_DEPTH} deep; close some")
        self._stack.append(self._state)

    def _end(self, directive: Directive) -> None:
        if not self._stack:
            raise directive.fault(f"{directive.name} ends a block that did not begin; remove it")
        self._state = self._stack.pop()

    def _reverse(self, directive: Directive) -> None:
        self._state = replace(self._state, reversed=not self._state.reversed)

    def _attribute(self, directive: Directive) -> None:
        what = directive.text(0, "target")
        own: dict[str, Any] = {**(self._state.defaults.get(what, {})), **directive.parameters.values}
        self._state = replace(self._state, defaults={**self._state.defaults, what: own})

    def _parameters(self, directive: Directive, what: str) -> Parameters:
        """The parameters of a directive, with the defaults of ``Attribute``."""
        values = {**self._state.defaults.get(what, {}), **directive.parameters.values}
        return replace(directive.parameters, values=values)

    def _include(self, directive: Directive, depth: int) -> None:
        self._included += 1
        if depth >= _INCLUDE_DEPTH or self._included > 4096:
            raise directive.fault(
                f"files include others more than {_INCLUDE_DEPTH} deep, or too many; put them together"
            )
        name = directive.text(0, "file")
        data = self.staging.files.read(name, f"line {directive.line}", FILE_LIMIT)
        if name.lower().endswith(".gz"):
            data = _unpacked(data, directive)
        source = f"{self.staging.files.source}: {PurePosixPath(printable(name)).name}"
        before = self._state, list(self._stack)
        self.run(data, source, depth + 1)
        if directive.name == "Import":
            self._state, self._stack = before

    def _active(self, directive: Directive) -> None:
        if directive.texts:  # between quotes; else it is the next word
            if directive.texts[0] not in _TIMES:
                words = ", ".join(sorted(_TIMES))
                raise directive.fault(f"ActiveTransform is {quoted(directive.texts[0])}, but must be one of {words}")
            self._state = replace(self._state, active=directive.texts[0])

    def _transform_times(self, directive: Directive) -> None:
        begin, end = directive.floats(2)
        self._placer.times = begin, end

    def _color_space(self, directive: Directive) -> None:
        if directive.text(0, "name") != "srgb":
            self.staging.note(f"colours of the colour space {quoted(directive.texts[0])} are read as those of srgb")

    # --- scene contents

    def _camera(self, directive: Directive) -> None:
        into_world = late = inverse(self._matrix(directive))
        if self._state.moves:
            if is_affine(self._state.late):
                late = inverse(self._state.late)
            else:
                self.staging.note("the camera's transform cannot be inverted at the end: it stands still")
        self._systems["camera"] = into_world, late
        self._settings.camera = Camera(directive, into_world, late)
        self._around = self._state.outside

    def _texture(self, directive: Directive) -> None:
        name, kind, made_of = (directive.text(i, what) for i, what in enumerate(("name", "kind", "type")))
        if kind not in ("spectrum", "float"):
            raise directive.fault(f'a texture is of {quoted(kind)}, but must be of "spectrum" or "float"')
        self._later.append(self._textures.define(name, kind, made_of, self._parameters(directive, "texture")))

    def _material(self, directive: Directive) -> None:
        kind, parameters = directive.text(0, "type"), self._parameters(directive, "material")
        self._set_material(lambda: self._materials.made(kind, parameters))

    def _make_named_material(self, directive: Directive) -> None:
        self._later.append(self._materials.define(directive.text(0, "name"), self._parameters(directive, "material")))

    def _named_material(self, directive: Directive) -> None:
        name = directive.text(0, "name")
        self._set_material(lambda: self._materials.named(name, directive.parameters))

    def _set_material(self, make: Callable[[], str | None]) -> None:
        """The current material from here on: made at the end, also if no shape has it."""
        material = cache(make)
        self._later.append(material)
        self._state = replace(self._state, material=material)

    def _medium(self, directive: Directive) -> None:
        parameters, matrix = self._parameters(directive, "medium"), self._matrix(directive)
        self._later.append(self._media.define(directive.text(0, "name"), parameters, matrix))

    def _medium_interface(self, directive: Directive) -> None:
        inside = directive.text(0, "name")
        outside = directive.texts[1] if len(directive.texts) > 1 else inside
        self._state = replace(self._state, inside=inside, outside=outside)

    def _light(self, directive: Directive) -> None:
        if self._state.moves:
            self.staging.note("lights that are no shapes do not move, as in pbrt: they stand where they are at first")
        self._lights.read(directive.text(0, "type"), self._parameters(directive, "light"), self._matrix(directive))

    def _area_light(self, directive: Directive) -> None:
        if directive.text(0, "type") != "diffuse":
            self.staging.note(f'an area light of type {quoted(directive.texts[0])} is read as "diffuse"')
        self._state = replace(self._state, emission=self._parameters(directive, "light"))

    def _shape(self, directive: Directive) -> None:
        if not self._in_world:
            raise directive.fault("a shape stands before WorldBegin; put it behind")
        parameters, state, group = self._parameters(directive, "shape"), self._state, self._object
        kind = directive.text(0, "type")
        if kind == "curve":
            self._later.append(partial(self._curve, parameters, state, group))
            return
        if state.inside != state.outside:
            self._transitions.append(state)
        self._later.append(partial(self._add, kind, parameters, state, group))

    def _add(self, kind: str, parameters: Parameters, state: Graphics, group: list[Part] | None) -> None:
        """Add a shape, to an object if there is one."""
        if state.emission is not None and state.material() is None:
            self.staging.note('area lights on "interface" are left out, as in pbrt')
            state = replace(state, emission=None)
        for described in self._shapes.read(kind, parameters, state, self._interior(state)):
            part = Part(described, state.emission, state.matrix, parameters.line)
            if group is not None:
                if part.emission is not None:
                    self.staging.note("lights inside of objects do not shine, as in pbrt")
                if state.moves:
                    self.staging.note("shapes inside of objects do not move by themselves: they are as at first")
                group.append(replace(part, emission=None))
            elif state.moves:
                self._placer.put(part, np.eye(4), (state.matrix, state.late))
            else:
                self._placer.put(part, part.matrix)

    def _interior(self, state: Graphics) -> str | None:
        """Name of the medium inside of a shape."""
        inside, outside = _sides(state)
        material = state.material()
        if inside != outside:
            medium = self._media.named(inside)
            bubble = medium is None and material is None and self._media.named(outside) is not None
            return self.staging.vacuum() if bubble else medium
        if not material or not self.staging.is_solid(material):
            return None
        # Between equal media a ray of pbrt stays in its own, whatever that is
        medium = self._media.named(inside) or self._fog
        if medium is None and self._transitions:
            self.staging.note_empty_glass()
        return medium

    def _curve(self, parameters: Parameters, state: Graphics, within: list[Part] | None) -> None:
        """A curve: those that do not move are collected in the space of the world, or of their object."""
        moves = state.moves and within is None
        moved = (state.matrix.tobytes(), state.late.tobytes()) if moves else None
        group: Hashable = id(within) if within is not None else None, moved
        matrix = np.eye(4) if moves else state.matrix
        described = self._shapes.curve(parameters, state, matrix, group)
        if described is None:
            return
        part = Part(described, None, np.eye(4), parameters.line)
        if within is not None:
            if state.moves:
                self.staging.note("shapes inside of objects do not move by themselves: they are as at first")
            within.append(part)
        elif moves:
            self._placer.put(part, np.eye(4), (state.matrix, state.late))
        else:
            self._placer.put(part, np.eye(4))

    def _matrix(self, directive: Directive) -> Matrix:
        """The current transform, for what cannot do without its inverse."""
        if not is_affine(self._state.matrix):
            raise directive.fault("the transform cannot be inverted; give other numbers")
        return self._state.matrix

    # --- objects

    def _object_begin(self, directive: Directive) -> None:
        if self._object is not None:
            raise directive.fault("an object begins inside of another; end that first")
        self._begin(directive)
        name = directive.text(0, "name")
        self._object = self._objects[name] = []

    def _object_end(self, directive: Directive) -> None:
        if self._object is None:
            raise directive.fault("ObjectEnd ends an object that did not begin; remove it")
        self._object = None
        self._end(directive)

    def _instance(self, directive: Directive) -> None:
        name = directive.text(0, "name")
        if name not in self._objects or self._object is not None:
            known = suggestion(name, self._objects)
            raise directive.fault(f"the object {quoted(name)} is not defined before, or this is inside of one{known}")
        parts, state = self._objects[name], self._state
        self._later.append(lambda: self._put(parts, directive, state))

    def _put(self, parts: list[Part], directive: Directive, state: Graphics) -> None:
        """Place an instance of an object."""
        for part in parts:
            placed = replace(part, line=directive.line)
            if state.moves:
                self._placer.put(placed, part.matrix, (state.matrix, state.late))
            else:
                self._placer.put(placed, product(state.matrix, part.matrix))


def _sides(state: Graphics) -> tuple[str, str]:
    """Names of the media inside and outside of a shape, of which an invisible one is never reversed here."""
    reversed_only = state.reversed and state.material() is None
    return (state.outside, state.inside) if reversed_only else (state.inside, state.outside)


def _unpacked(data: bytes, directive: Directive) -> bytes:
    """Content of a file that is packed by gzip."""
    try:
        with gzip.GzipFile(fileobj=io.BytesIO(data)) as file:
            found = file.read(FILE_LIMIT + 1)
    except (OSError, EOFError, zlib.error):
        raise directive.fault(f"{quoted(directive.texts[0])} is no sound file of gzip; pack it again") from None
    if len(found) > FILE_LIMIT:
        raise directive.fault(f"{quoted(directive.texts[0])} unpacks to more than {FILE_LIMIT} bytes; split it")
    return found
