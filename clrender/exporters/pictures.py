"""Textures as files that another program reads as clrender does."""

from __future__ import annotations

import hashlib
import json
import shutil
from collections.abc import Callable, Collection
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import IO, Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from clrender.exact.angles import sin_cos_degrees
from clrender.exact.elementary import degrees_of
from clrender.exact.matrices import length, product, times
from clrender.exporters.target import Target
from clrender.image.exr_write import write_exr
from clrender.image.pictures import CODED_ENDINGS, Picture, open_picture
from clrender.image.texel_values import texel_colors, texel_numbers
from clrender.scene.textures import BumpMap, Checker, ImageTexture, NormalMap, Ramp, Texture, TextureTransform
from clrender.wording import place

__all__ = [
    "Bitmap",
    "Curve",
    "Inverted",
    "PictureFiles",
    "Squares",
    "height_picture",
    "normal_picture",
    "scale_turn_offset",
    "turns_slopes",
    "write_picture",
]

_Floats: TypeAlias = NDArray[np.float64]
Curve: TypeAlias = Callable[[NDArray[np.floating]], NDArray[np.floating]]
"""What is done to texels."""


@dataclass(frozen=True)
class Inverted:
    """A curve: 1 minus some of the channels of a colour, which pictures of 8 bits have exactly.

    Attributes
    ----------
    channels : tuple of int
    """

    channels: tuple[int, ...]

    def __call__(self, pixels: NDArray[np.floating]) -> NDArray[np.floating]:
        """The texels."""
        made = np.array(pixels)
        made[..., self.channels] = 1 - made[..., self.channels]
        return made


@dataclass(frozen=True)
class Bitmap:
    """A texture that is a picture.

    Attributes
    ----------
    file : str
        Relative to the scene file.
    linear : bool
        Whether its numbers are linear, and not sRGB.
    wrap : two str
        How it goes on along u and v: ``repeat``, ``clamp`` or ``mirror``.
    nearest : bool
        Whether texels are not interpolated.
    plane : (2, 3) float64
        From texture coordinates to the picture, whose lower left corner is (0, 0).
    """

    file: str
    linear: bool
    wrap: tuple[str, str]
    nearest: bool
    plane: _Floats


@dataclass(frozen=True)
class Squares:
    """A texture that is a checkerboard.

    Attributes
    ----------
    colors : two (1,) or (3,) floating
    plane : (2, 3) float64
        From texture coordinates to a plane in which squares have side 1, the first of them at (0, 0).
    """

    colors: tuple[NDArray[np.floating], NDArray[np.floating]]
    plane: _Floats


class PictureFiles:
    """Makes files of textures; pictures that the program would read otherwise are computed anew.

    Parameters
    ----------
    target : Target
    same : collection of str
        Endings of files that the program reads as clrender does.
    decodes : bool
        Whether it decodes sRGB.
    """

    def __init__(self, target: Target, same: Collection[str], decodes: bool = True) -> None:
        self._target, self._same, self._decodes = target, same, decodes

    def resolved(
        self, given: Texture, at: tuple[str | int, ...], number: bool, factor: Any = 1.0, curve: Curve | None = None
    ) -> Bitmap | Squares:
        """A texture as a picture or a checkerboard.

        Parameters
        ----------
        given : Texture
        at : tuple of str or int
            Its place in the scene.
        number : bool
            Whether it stands for a number, and not for a colour.
        factor : float or three floats
            Factor for its values.
        curve : callable, optional
            What is done to them.
        """
        plane, factor = _plane(given.transform), np.atleast_1d(np.asarray(factor, np.float64))
        if isinstance(given, Checker):
            colors: list[Any] = [np.array(color[:1] if number else color) * factor for color in given.checker]
            first, second = colors if curve is None else [curve(color) for color in colors]
            return Squares((first, second), product(np.diag([1.0 / size for size in given.size]), plane))
        if isinstance(given, Ramp):
            count = len(given.ramp)
            texels = np.array([given.ramp], np.float32)[..., : 1 if number else 3] * factor
            file = self.made("ramp", np.asarray(texels if curve is None else curve(texels), np.float32))
            # From the centre of the first texel to that of the last
            plane[0] = plane[0] * ((count - 1) / count) + [0.0, 0.0, 0.5 / count]
            plane[1] = [-plane[0, 1], plane[0, 0], 0.5]  # any row is the same, and programs have no shear
            return Bitmap(file, True, ("clamp", "clamp"), False, plane)
        file, linear = self._file(given, at, number, factor, curve)
        return Bitmap(file, linear, given.wrap, given.filter == "nearest", plane)

    def made(self, stem: str, pixels: NDArray[np.float32]) -> str:
        """The name of a new picture of linear values, (H, W, 1 or 3)."""
        digest = hashlib.sha256(json.dumps(pixels.shape).encode() + pixels.tobytes()).hexdigest()
        write = partial(write_picture, pixels=pixels)
        return self._target.files.add(self._target.folder, stem, ".exr", digest, write)

    def _file(
        self, given: ImageTexture, at: tuple[str | int, ...], number: bool, factor: _Floats, curve: Curve | None
    ) -> tuple[str, bool]:
        """Name of a picture of these values, and whether they are linear."""
        where = place((*at, "texture"))
        with self._target.scene.files.opened(given.texture, where) as (file, ending):
            coded = ending in CODED_ENDINGS
            srgb = coded and (given.color_space or ("linear" if number else "srgb")) == "srgb"
            picture = open_picture(file, ending)
            channel = given.channel or ("r" if number else None)
            plain = curve is None and bool((np.array(given.scale) * factor == 1.0).all())
            plain = plain and (self._decodes or not srgb or channel == "a")
            if plain and ending in self._same and (channel is None or (picture.channels == 1 and channel != "a")):
                return self._copied(given.texture, where), not srgb
            if plain and picture.coding == "unorm8" and picture.channels > 1 and channel not in (None, "luminance"):
                return self._channel(given.texture, channel, picture), not srgb or channel == "a"
            stem = Path(given.texture).stem or given.texture
            if isinstance(curve, Inverted) and picture.coding == "unorm8" and not srgb and channel is None:
                return self._inverted(stem, curve, picture), True
            pixels = _values(picture, srgb, channel)
        pixels = pixels * np.asarray(np.array(given.scale)[: 1 if number else 3] * factor, np.float32)
        return self.made(stem, np.asarray(pixels if curve is None else curve(pixels), np.float32)), True

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
        grey = np.concatenate([band[..., "rgba".index(channel)] for band in picture.bands()])
        return self._of_bytes(f"{Path(name).stem or name}-{channel}", grey)

    def _inverted(self, stem: str, curve: Inverted, picture: Picture) -> str:
        """A picture of 8 bits with some of its channels inverted."""
        bands = [np.broadcast_to(band, (*band.shape[:2], max(3, band.shape[2])))[..., :3] for band in picture.bands()]
        pixels = np.concatenate(bands)
        pixels[..., curve.channels] = 255 - pixels[..., curve.channels]
        return self._of_bytes(f"{stem}-inverted", pixels)

    def _of_bytes(self, stem: str, pixels: NDArray[np.uint8]) -> str:
        """The name of a new picture of 8 bits, (H, W) or (H, W, 3)."""
        from PIL import Image

        digest = hashlib.sha256(json.dumps(pixels.shape).encode() + pixels.tobytes()).hexdigest()

        def write(into: IO[bytes]) -> None:
            Image.fromarray(pixels).save(into, "png")

        return self._target.files.add(self._target.folder, stem, ".png", digest, write)


def normal_picture(given: NormalMap, signs: tuple[float, float] = (1.0, 1.0)) -> tuple[ImageTexture, Curve | None]:
    """A normal map as a picture whose middle value is 0.5, and what is done to its texels.

    Parameters
    ----------
    given : NormalMap
    signs : two floats
        Factors, 1 or -1, for red and green.
    """
    slopes = given.scale * np.array(signs)[:, None] * _slopes(given.transform)

    def turned(pixels: NDArray[np.floating]) -> NDArray[np.floating]:
        made = pixels.copy()
        made[..., :2] = times(slopes, pixels[..., :2] - 0.5) + 0.5
        return made

    curve: Curve | None = turned
    if (np.abs(slopes) == np.eye(2)).all():
        against = tuple(np.flatnonzero(np.diag(slopes) < 0.0).tolist())
        curve = Inverted(against) if against else None
    picture = ImageTexture(texture=given.texture, color_space="linear", wrap=given.wrap, filter=given.filter)
    picture = picture.with_checked(uv_set=given.uv_set, transform=given.transform)
    return picture, curve


def height_picture(given: BumpMap) -> ImageTexture:
    """A bump map as a picture of heights, before its factor."""
    picture = ImageTexture(texture=given.texture, color_space="linear", wrap=given.wrap, channel=given.channel)
    return picture.with_checked(uv_set=given.uv_set, transform=given.transform)


def scale_turn_offset(plane: _Floats) -> tuple[tuple[float, float], float, tuple[float, float], bool]:
    """An affine map of the plane, (2, 3), as a scale, then a rotation, degrees, then an offset.

    The fourth is whether it has a shear beside them, which is left out.
    """
    (a, b, u), (c, d, v) = plane.tolist()
    across, along = length([a, c]), length([b, d])
    sheared = abs(a * b + c * d) > 1e-6 * abs(across * along)
    return (across, -along if a * d - b * c < 0.0 else along), degrees_of(c, a), (u, v), sheared


def write_picture(file: IO[bytes], pixels: NDArray[np.float32]) -> None:
    """Write linear (H, W, 1 or 3) pixels as OpenEXR."""
    write_exr(file, np.ascontiguousarray(np.broadcast_to(pixels, (*pixels.shape[:2], 3)), np.float32), {}, {})


def _values(picture: Picture, srgb: bool, channel: str | None) -> NDArray[np.float32]:
    """Linear values of a picture, (H, W, 1 or 3)."""
    if channel is None:
        return np.concatenate([texel_colors(picture, band, srgb) for band in picture.bands()])
    return np.concatenate([texel_numbers(picture, band, srgb, channel) for band in picture.bands()])


def turns_slopes(given: NormalMap) -> bool:
    """Whether the transform of a normal map's texture coordinates turns or mirrors its slopes."""
    return bool((_slopes(given.transform) != np.eye(2)).any())


def _slopes(given: TextureTransform) -> _Floats:
    """From slopes along a picture's right and upper side to those along u and v, (2, 2).

    Other programs take red and green along u and v, whatever the transform of the texture coordinates.
    """
    (a, b), (c, d) = _plane(given)[:, :2].tolist()
    side = -1.0 if a * d - b * c < 0.0 else 1.0
    size = length([c, d])
    right, up = (side * d / size, -side * c / size) if size > 0.0 else (1.0, 0.0)
    return np.array([[right, -side * up], [up, side * right]]) + 0.0


def _plane(given: TextureTransform) -> _Floats:
    """Scale, then rotation, then offset of texture coordinates, (2, 3)."""
    sine, cosine = sin_cos_degrees(given.rotate_degrees)
    u, v = given.scale
    return np.array([[cosine * u, -sine * v, given.offset[0]], [sine * u, cosine * v, given.offset[1]]])
