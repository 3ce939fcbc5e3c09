"""Images of material libraries: finds them and converts them to our textures."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

import numpy as np

from clrender.errors import SceneError
from clrender.image.pictures import PICTURE_ENDINGS, open_picture
from clrender.importers.asset_files import AssetFiles
from clrender.importers.mtl_file import MtlPicture
from clrender.scene.values import POWER_LIMIT
from clrender.wording import quoted

__all__ = ["BUMP_SHARE", "MtlPictures"]

BUMP_SHARE: Final = 0.01
"""Height of a value of 1 with ``-bm 1``, as a fraction of the model's diagonal: the format has no unit for it."""
_UV_LIMIT: Final = 1e6
_CHANNELS: Final = {"r": "r", "g": "g", "b": "b", "m": "a", "l": "luminance"}
_NOT_READ: Final = ("-blendu", "-blendv", "-cc", "-boost", "-texres", "-t", "-type")
_AS_BY_DEFAULT: Final = {"-blendu": "on", "-blendv": "on", "-cc": "off"}


class MtlPictures:
    """Finds images, once each: first in the folder of their library.

    Parameters
    ----------
    files : AssetFiles
    note : callable
        Called with a sentence for the user.
    leave_out : callable
        Called with the fault of a picture that cannot be read.
    diagonal : float
        Diagonal of the model, metres.
    """

    def __init__(
        self,
        files: AssetFiles,
        note: Callable[[str], None],
        leave_out: Callable[[SceneError], None],
        diagonal: float,
    ) -> None:
        self._files, self._diagonal = files, diagonal
        self._note, self._leave_out = note, leave_out
        self._found: dict[tuple[str, str], str | None] = {}

    def lost(self, picture: MtlPicture | None) -> bool:
        """Whether a picture is named that cannot be read."""
        return picture is not None and self._name(picture) is None

    def color(self, picture: MtlPicture | None, factor: tuple[float, float, float]) -> dict[str, Any] | None:
        """A colour texture times a factor; None if it is not available."""
        table = self._table(picture)
        if table is None or picture is None:
            return None
        if picture.word("-imfchan") in _CHANNELS:
            table["channel"] = _CHANNELS[picture.word("-imfchan")]
        gain = self._gain(picture)
        return {**table, "scale": [min(gain * each, POWER_LIMIT) for each in factor]}

    def share(self, picture: MtlPicture | None, factor: float, channel: str) -> dict[str, Any] | None:
        """A scalar texture, likewise; `channel` is the default if the file does not specify it."""
        table = self._table(picture)
        if table is None or picture is None:
            return None
        channel = _CHANNELS.get(picture.word("-imfchan"), channel)
        return {**table, "channel": channel, "scale": [min(factor * self._gain(picture), POWER_LIMIT)] * 3}

    def relief(self, picture: MtlPicture, normals: bool) -> tuple[str, dict[str, Any]] | None:
        """A normal map or bump map, and the key of a material for it.

        Parameters
        ----------
        picture : MtlPicture
        normals : bool
            Whether the file declares normals; else this is detected from the pixels.
        """
        table = self._table(picture)
        if table is None:
            return None
        (strength,), (base, gain) = picture.numbers("-bm", (1.0,)), picture.numbers("-mm", (0.0, 1.0))
        if not normals and self._holds_normals(table["texture"]):
            self._note(f"{picture.place}: {quoted(picture.name)} holds normals, not heights: taken as a normal map")
            normals = True
        if normals:
            if (base, gain) != (0.0, 1.0):
                self._note(f"{picture.place}: -mm is not read of normal maps")
            return "normal_map", {**table, "scale": _bounded(strength, 100.0)}
        scale = strength * gain * BUMP_SHARE * self._diagonal  # the base of -mm moves all heights alike
        self._note(f"heights of bump maps have no unit: -bm 1 is {BUMP_SHARE:g} of the model's diagonal")
        table["channel"] = _CHANNELS.get(picture.word("-imfchan"), "luminance")
        return "bump_map", {**table, "scale": _bounded(scale, 1e6)}

    def _gain(self, picture: MtlPicture) -> float:
        base, gain = picture.numbers("-mm", (0.0, 1.0))
        if base != 0.0:
            self._note(f"{picture.place}: the base {base:g} of -mm is not added; only its factor is read")
        return max(gain, 0.0)

    def _table(self, picture: MtlPicture | None) -> dict[str, Any] | None:
        """Name, wrap and transform of a texture."""
        name = None if picture is None else self._name(picture)
        if picture is None or name is None:
            return None
        for option in _NOT_READ:
            if option in picture.options and picture.word(option) != _AS_BY_DEFAULT.get(option, None):
                self._note(f"the option {option} of pictures is not read")
        if picture.word("-imfchan") == "z":
            self._note(f"{picture.place}: depth (-imfchan z) is not read; the picture's colours are")
        table: dict[str, Any] = {"texture": name}
        if picture.word("-clamp") == "on":
            table["wrap"] = "clamp"
        scale = [_bounded(x, _UV_LIMIT) for x in picture.numbers("-s", (1.0, 1.0, 1.0))[:2]]
        offset = [_bounded(x, _UV_LIMIT) for x in picture.numbers("-o", (0.0, 0.0, 0.0))[:2]]
        if scale != [1.0, 1.0] or offset != [0.0, 0.0]:
            table["transform"] = {"scale": scale, "offset": offset}
        return table

    def _name(self, picture: MtlPicture) -> str | None:
        """The name, relative to the scene's folder, of a file that can be opened; else adds a note."""
        key = picture.folder, picture.name
        if key not in self._found:
            self._found[key] = self._search(picture)
        return self._found[key]

    def _search(self, picture: MtlPicture) -> str | None:
        plain = picture.name.replace("\\", "/")
        first = str(Path(picture.folder) / plain)
        beside = str(Path(picture.folder) / plain.rpartition("/")[2])
        problem: SceneError | None = None
        for name in dict.fromkeys((first, plain, str(Path(picture.folder) / picture.name), beside)):
            try:
                self._files.open(name, picture.place)[0].close()
            except SceneError as error:
                # Its place already names the scene file
                problem = problem or SceneError(str(error).removeprefix(f"{self._files.source}: "))
                continue
            if Path(name).suffix.lower() not in PICTURE_ENDINGS:
                kinds = " ".join(PICTURE_ENDINGS)
                self._note(f"{picture.place}: {quoted(picture.name)} is left out: pictures may be {kinds}")
                return None
            if name == beside and name not in (first, plain):
                self._note(f"{picture.place}: {quoted(picture.name)} is not there: {quoted(name)} is taken")
            return name
        if problem is not None:
            self._leave_out(problem)
        return None

    def _holds_normals(self, name: str) -> bool:
        """Whether the colours of an image are mostly those of normals: around (0.5, 0.5, 1), and no greys."""
        file, _ = self._files.open(name, "a bump map")
        with file:
            try:
                band = next(open_picture(file, Path(name).suffix.lower()).bands())
            except Exception:
                return False  # the actual reader reports what is wrong with it
        if band.shape[2] != 4 or band.dtype not in (np.uint8, np.uint16):
            return False
        red, green, blue = (float(x) / np.iinfo(band.dtype).max for x in band[..., :3].mean((0, 1)))
        return 0.35 < red < 0.65 and 0.35 < green < 0.65 and blue > 0.7


def _bounded(value: float, limit: float) -> float:
    return math.copysign(min(abs(value), limit), value)
