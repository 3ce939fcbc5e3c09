"""The pictures of a scene's textures: read, validated, and stored once in tiles."""

from __future__ import annotations

import io
import warnings
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, BinaryIO, Final

import numpy as np
from numpy.typing import NDArray

from clrender.errors import OutOfMemory, SceneError
from clrender.files.named import open_named_file
from clrender.image.pictures import PICTURE_ENDINGS, Picture, open_picture, picture_room
from clrender.image.texel_tiles import (
    TILE_BYTES,
    StoredPicture,
    aligned_tiles,
    fill_tiles,
    picture_sha256,
    tile_count,
    tile_shape,
    tiled_picture,
)
from clrender.scene.textures import AnyTexture, Checker, Ramp
from clrender.wording import counted, quoted

__all__ = ["TexelStore"]

FILE_LIMIT: Final = 2**32
_BYTES_LIMIT: Final = 2**36
"""Most bytes of all texels of a scene: tile numbers stay below 2^30."""


class TexelStore:
    """Images by their names in textures, and their texels.

    Parameters
    ----------
    textures : sequence of (str, texture)
        The scene's textures, each with its location, for messages.
    base_folder, allow_paths
        See `clrender.meshes.read.read_mesh`.
    given : mapping of str to (StoredPicture, (tiles, 64) uint8)
        Replace files of these names.
    encoded : mapping of str to (bytes, str)
        Likewise, as the content of such files and their extensions.

    Attributes
    ----------
    pictures : dict of str to StoredPicture
        By file name, or the key of a checker or ramp; equal contents share an image.
    texels : (tiles, 64) uint8
        Aligned to a memory page, so that a CPU's driver can use it in place; at least one tile.

    Raises
    ------
    SceneError
        A file may not be read or is not a valid image, or there are too many texels.
    """

    def __init__(
        self,
        textures: Sequence[tuple[str, AnyTexture]],
        base_folder: Path,
        allow_paths: Sequence[Path],
        given: Mapping[str, tuple[StoredPicture, NDArray[np.uint8]]],
        encoded: Mapping[str, tuple[bytes, str]],
    ) -> None:
        self.pictures: dict[str, StoredPicture] = {}
        places: dict[str, str] = {}
        drawn: dict[str, Picture] = {name: tiled_picture(*each) for name, each in given.items()}
        for place, texture in textures:
            name = _name(texture)
            places.setdefault(name, f"{place}: {quoted(name)}")
            if isinstance(texture, Checker | Ramp):
                drawn[name] = _drawn(texture)
        files = _Files(base_folder, allow_paths, encoded)
        room = 0
        for name, label in places.items():
            room += tile_count(drawn[name]) if name in drawn else files.mosttile_count(name, label)
            if room * TILE_BYTES > _BYTES_LIMIT:
                text = f"more than {counted(_BYTES_LIMIT, 'byte')} of texels, which is the most; use smaller pictures"
                raise SceneError(f"{label} and the scene's other pictures need {text}")
        self._used = 0
        try:
            self.texels = aligned_tiles(max(room, 1))
        except MemoryError:
            raise OutOfMemory(f"{next(iter(places.values()))} and others are too large for this machine") from None
        for name, label in places.items():
            if name in drawn:
                self._add(name, drawn[name], label)
            else:
                with files.opened(name, label) as (file, ending), _Telling(label):
                    self._add(name, open_picture(file, ending), label)
        self.texels = self.texels[: max(self._used, 1)]
        self.texels[self._used :] = 0
        self.texels.flags.writeable = False

    def holds(self, textures: Iterable[AnyTexture]) -> bool:
        """Whether it contains the images of all these textures."""
        return all(_name(texture) in self.pictures for texture in textures)

    def picture(self, texture: AnyTexture) -> StoredPicture:
        """The image of one of the textures."""
        return self.pictures[_name(texture)]

    def tiles_of(self, picture: StoredPicture) -> NDArray[np.uint8]:
        """The tiles of one of the images, (tiles, 64)."""
        return self.texels[picture.first_tile : picture.first_tile + picture.tiles]

    def _add(self, name: str, picture: Picture, label: str) -> None:
        """Append an image, and discard it again if its content is already present."""
        first, count = self._used, tile_count(picture)
        tiles = self.texels[first : first + count]
        with _Telling(label):
            fill_tiles(tiles, picture)
        sha256 = picture_sha256(picture, tiles)
        same = next((each for each in self.pictures.values() if each.sha256 == sha256), None)
        if same is None:
            self._used += count
        size = (picture.width, picture.height, picture.channels, picture.coding)
        self.pictures[name] = same or StoredPicture(*size, first, count, sha256)


class _Files:
    """Image files, from disk or from the scene's own contents."""

    def __init__(
        self, base_folder: Path, allow_paths: Sequence[Path], encoded: Mapping[str, tuple[bytes, str]]
    ) -> None:
        self._base_folder, self._allow_paths, self._encoded = base_folder, allow_paths, encoded

    @contextmanager
    def opened(self, name: str, label: str) -> Iterator[tuple[BinaryIO, str]]:
        """A file and its extension."""
        if name in self._encoded:
            data, ending = self._encoded[name]
            yield io.BytesIO(data), ending
            return
        file, size = open_named_file(name, self._base_folder, self._allow_paths, label, FILE_LIMIT)
        with file:
            ending = Path(name).suffix.lower()
            if ending not in PICTURE_ENDINGS:
                raise SceneError(f"{label} is of no kind that can be read; textures may be {' '.join(PICTURE_ENDINGS)}")
            if size == 0:
                raise SceneError(f"{label} is empty; it must hold a picture")
            yield file, ending

    def mosttile_count(self, name: str, label: str) -> int:
        """Upper bound of the number of tiles, from the file's header."""
        with self.opened(name, label) as (file, ending), _Telling(label):
            width, height, texel = picture_room(file, ending)
        across, down = tile_shape(texel.bit_length() - 1)
        return -(-width // across) * -(-height // down)


class _Telling:
    """Replaces whatever an image library raises for a damaged file, almost any exception, by one sentence."""

    def __init__(self, label: str) -> None:
        self._label = label
        self._quiet = warnings.catch_warnings()

    def __enter__(self) -> None:
        self._quiet.__enter__()
        warnings.simplefilter("ignore")  # the libraries repair what they warn about

    def __exit__(self, kind: Any, error: BaseException | None, trace: Any) -> None:
        self._quiet.__exit__(kind, error, trace)
        if isinstance(error, MemoryError):
            raise OutOfMemory(f"{self._label} is too large for the memory of this machine") from None
        if isinstance(error, Exception) and not isinstance(error, SceneError | NameError):
            words = str(error).strip().splitlines()
            why = ascii(words[0][:200])[1:-1] if words else type(error).__name__
            raise SceneError(f"{self._label} is no sound picture: {why}; export it again") from None


def _name(texture: AnyTexture) -> str:
    """The file name of an image, or a key for a checker or ramp, which has no image extension."""
    if isinstance(texture, Checker):
        return f"checker {texture.checker}"
    return f"ramp {texture.ramp}" if isinstance(texture, Ramp) else texture.texture


def _drawn(texture: Checker | Ramp) -> Picture:
    """A checker as 2 x 2 texels, or a ramp as a row of texels: texture filtering does the rest."""
    if isinstance(texture, Checker):
        first, second = texture.checker
        colors = np.array([[second, first], [first, second]], np.float32)
    else:
        colors = np.array([texture.ramp], np.float32)
    alpha = np.ones((*colors.shape[:2], 1), np.float32)
    whole = np.concatenate([colors, alpha], axis=2)
    return Picture(colors.shape[1], colors.shape[0], 4, "float", lambda: iter((whole,)))
