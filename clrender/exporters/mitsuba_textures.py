"""Colours, numbers, textures and maps of materials as Mitsuba's."""

from __future__ import annotations

import hashlib
import json
import shutil
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import IO, Any, Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from clrender.exact.angles import sin_cos_degrees
from clrender.exact.matrices import product
from clrender.exporters.mitsuba_xml import Element, Target, element, transform, value
from clrender.image.exr_write import write_exr
from clrender.image.pictures import CODED_ENDINGS, Picture, open_picture
from clrender.image.texel_values import texel_colors, texel_numbers
from clrender.scene.textures import BumpMap, Checker, ImageTexture, NormalMap, Ramp, Texture, TextureTransform
from clrender.wording import place

__all__ = ["TextureWriter", "write_picture"]

_Floats: TypeAlias = NDArray[np.float64]
_Curve: TypeAlias = Callable[[NDArray[np.floating]], NDArray[np.floating]]
_COPIED: Final = (".png", ".jpg", ".jpeg", ".bmp", ".tga", ".ppm", ".exr", ".pfm")
"""Endings of pictures that Mitsuba reads as clrender does. It reads mantissas of ``.hdr`` as m, not m + 1/2."""
_FLIP: Final = np.array([[1.0, 0.0, 0.0], [0.0, -1.0, 1.0]])
"""Mitsuba's v of a picture is 0 at its upper edge."""


def write_picture(file: IO[bytes], pixels: NDArray[np.float32]) -> None:
    """Write linear (H, W, 1 or 3) pixels as OpenEXR."""
    write_exr(file, np.ascontiguousarray(np.broadcast_to(pixels, (*pixels.shape[:2], 3)), np.float32), {}, {})


class TextureWriter:
    """Writes constants and textures; pictures that Mitsuba would read otherwise are computed anew.

    Parameters
    ----------
    target : Target
    """

    def __init__(self, target: Target) -> None:
        self._target = target

    def color(self, name: str, given: Any, at: tuple[str | int, ...], factor: Any = 1.0) -> Element:
        """A colour.

        Parameters
        ----------
        name : str
            Mitsuba's name for it.
        given : three floats or Texture
        at : tuple of str or int
            Its place in the scene.
        factor : float or three floats
            Factor for it.
        """
        if isinstance(given, Texture):
            return self._texture(name, given, at, False, np.asarray(factor, np.float64), None)
        return value("rgb", name, np.array(given) * factor)

    def number(
        self, name: str, given: Any, at: tuple[str | int, ...], curve: _Curve | None = None, told: str = ""
    ) -> Element:
        """A number.

        Parameters
        ----------
        name, at
            See `color`.
        given : float or Texture
        curve : callable, optional
            What is done to it.
        told : str
            Distinguishes this curve from others.
        """
        if isinstance(given, Texture):
            return self._texture(name, given, at, True, np.ones(1), curve, told)
        return value("float", name, given if curve is None else float(curve(np.array(given, np.float64))))

    def normal_map(self, given: NormalMap, at: tuple[str | int, ...]) -> Element:
        """A map of normals, with the middle value at 0.5."""

        def steeper(pixels: NDArray[np.floating]) -> NDArray[np.floating]:
            made = pixels.copy()
            made[..., :2] = (pixels[..., :2] - 0.5) * given.scale + 0.5
            return made

        curve, told = (None, "") if given.scale == 1.0 else (steeper, f"slopes {given.scale!r}")
        picture = ImageTexture(texture=given.texture, color_space="linear", wrap=given.wrap, filter=given.filter)
        picture = picture.with_checked(uv_set=given.uv_set, transform=given.transform)
        return self._texture("normalmap", picture, at, False, np.ones(3), curve, told)

    def bump_map(self, given: BumpMap, at: tuple[str | int, ...]) -> Element:
        """A map of heights."""
        picture = ImageTexture(texture=given.texture, color_space="linear", wrap=given.wrap, channel=given.channel)
        picture = picture.with_checked(uv_set=given.uv_set, transform=given.transform)
        return self._texture("heights", picture, at, True, np.ones(1), None)

    def _texture(
        self,
        name: str,
        given: Texture,
        at: tuple[str | int, ...],
        number: bool,
        factor: _Floats,
        curve: _Curve | None,
        told: str = "",
    ) -> Element:
        plane = _plane(given.transform)
        if isinstance(given, Checker):
            colors: list[Any] = [np.array(color[:1] if number else color) * factor for color in given.checker]
            colors = colors if curve is None else [curve(color) for color in colors]
            # The side of Mitsuba's squares is half a unit
            scale = np.diag([0.5 / given.size[0], 0.5 / given.size[1]])
            both = [value("rgb", f"color{i}", np.broadcast_to(color, 3)) for i, color in enumerate(colors)]
            return element("texture", *both, *_to_uv(product(scale, plane)), type="checkerboard", name=name)
        if isinstance(given, Ramp):
            count = len(given.ramp)
            texels = np.array([given.ramp], np.float32)[..., : 1 if number else 3] * factor
            pixels = np.asarray(texels if curve is None else curve(texels), np.float32)
            file, raw, wrap, between = self._made("ramp", pixels), True, "clamp", "linear"
            # From the centre of the first texel to that of the last
            plane[0] = plane[0] * ((count - 1) / count) + [0.0, 0.0, 0.5 / count]
        else:
            file, raw = self._file(given, at, number, factor, curve, told)
            (wrap, other), between = given.wrap, given.filter
            if other != wrap:
                self._target.leave_out("another way of repeating a texture along v; it is that along u", *at)
        inside = [
            value("string", "filename", file),
            value("boolean", "raw", raw),
            value("string", "wrap_mode", wrap),
            value("string", "filter_type", "nearest" if between == "nearest" else "bilinear"),
        ]
        upright = product(_FLIP[:, :2], plane)
        upright[:, 2] += _FLIP[:, 2]
        return element("texture", *inside, *_to_uv(upright), type="bitmap", name=name)

    def _file(
        self,
        given: ImageTexture,
        at: tuple[str | int, ...],
        number: bool,
        factor: _Floats,
        curve: _Curve | None,
        told: str,
    ) -> tuple[str, bool]:
        """Name of a picture of these values, and whether they are linear."""
        where = place((*at, "texture"))
        with self._target.scene.files.opened(given.texture, where) as (file, ending):
            coded = ending in CODED_ENDINGS
            srgb = coded and (given.color_space or ("linear" if number else "srgb")) == "srgb"
            picture = open_picture(file, ending)
            plain = curve is None and bool((np.array(given.scale) * factor == 1.0).all())
            channel = given.channel or ("r" if number else None)
            if plain and ending in _COPIED and (channel is None or (picture.channels == 1 and channel != "a")):
                return self._copied(given.texture, where), not srgb
            if plain and picture.coding == "unorm8" and picture.channels > 1 and channel not in (None, "luminance"):
                return self._channel(given.texture, channel, picture), not srgb or channel == "a"
            stem = Path(given.texture).stem or given.texture
            pixels = _values(picture, srgb, channel)
        pixels = pixels * np.asarray(np.array(given.scale)[: 1 if number else 3] * factor, np.float32)
        return self._made(stem, np.asarray(pixels if curve is None else curve(pixels), np.float32)), True

    def _copied(self, name: str, where: str) -> str:
        """A picture copied unchanged."""
        opened = self._target.scene.files.opened
        digest = hashlib.sha256()
        with opened(name, where) as (file, ending):
            while block := file.read(2**20):
                digest.update(block)

        def write(into: IO[bytes]) -> None:
            with opened(name, where) as (file, _):
                shutil.copyfileobj(file, into, 2**20)

        return self._target.files.add(self._target.folder, Path(name).stem or name, ending, digest.hexdigest(), write)

    def _channel(self, name: str, channel: str, picture: Picture) -> str:
        """One channel of 8 bits as a grey picture of the same numbers."""
        from PIL import Image

        grey = np.concatenate([band[..., "rgba".index(channel)] for band in picture.bands()])
        digest = hashlib.sha256(json.dumps(grey.shape).encode() + grey.tobytes()).hexdigest()

        def write(into: IO[bytes]) -> None:
            Image.fromarray(grey).save(into, "png")

        stem = f"{Path(name).stem or name}-{channel}"
        return self._target.files.add(self._target.folder, stem, ".png", digest, write)

    def _made(self, stem: str, pixels: NDArray[np.float32]) -> str:
        """A picture of linear values."""
        digest = hashlib.sha256(json.dumps(pixels.shape).encode() + pixels.tobytes()).hexdigest()
        write = partial(write_picture, pixels=pixels)
        return self._target.files.add(self._target.folder, stem, ".exr", digest, write)


def _values(picture: Picture, srgb: bool, channel: str | None) -> NDArray[np.float32]:
    """Linear values of a picture, (H, W, 1 or 3)."""
    if channel is None:
        return np.concatenate([texel_colors(picture, band, srgb) for band in picture.bands()])
    return np.concatenate([texel_numbers(picture, band, srgb, channel) for band in picture.bands()])


def _plane(given: TextureTransform) -> _Floats:
    """Scale, then rotation, then offset of texture coordinates, (2, 3)."""
    sine, cosine = sin_cos_degrees(given.rotate_degrees)
    u, v = given.scale
    return np.array([[cosine * u, -sine * v, given.offset[0]], [sine * u, cosine * v, given.offset[1]]])


def _to_uv(plane: _Floats) -> list[Element]:
    """The transform of texture coordinates; none for the identity."""
    made = np.eye(4)
    made[:2, :2], made[:2, 3] = plane[:, :2], plane[:, 2]
    return [] if (made == np.eye(4)).all() else [transform(made, "to_uv")]
