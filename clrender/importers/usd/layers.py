"""Opens the layers of a USD stage one by one, and only those in allowed folders; runs in the child process."""

from __future__ import annotations

import os
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

from pxr import Ar, Sdf, Tf, Usd

from clrender.errors import SceneError
from clrender.files.named import allowed_file
from clrender.wording import counted, quoted

__all__ = ["Layers", "reason"]

_MOST: Final = 2**16
"""Most layers of a stage."""
_SOURCE: Final = re.compile(r" in file \S+ : ")
_PLACE: Final = re.compile(r"/\S+:([0-9]+):[0-9]+: ")


def reason(error: Exception) -> str:
    """What USD says about a failure, in one line, without the places in its own sources."""
    said = _SOURCE.split(str(error))[-1].replace("'", "")
    said = " ".join(_PLACE.sub(r" line \1: ", said).split())
    return said[:200] or "USD gives no reason"


class Layers:
    """The layers of a stage, which USD keeps in its registry, so that composition opens no others.

    Parameters
    ----------
    source : str
        Name of the scene file, for messages.
    path : pathlib.Path
        The scene file.
    allowed : sequence of pathlib.Path
        Folders besides its own.

    Attributes
    ----------
    opened : list of str
        Paths of the files.
    missing : list of str
        A sentence for each that cannot be read.
    root : Sdf.Layer

    Raises
    ------
    SceneError
        The scene file cannot be read, or it names a layer in a folder that is not allowed.
    """

    def __init__(self, source: str, path: Path, allowed: Sequence[Path]) -> None:
        self._source, self._folder, self._allowed = source, path.parent, tuple(allowed)
        self.opened: list[str] = []
        self.missing: list[str] = []
        self._kept: list[Any] = []
        try:
            self.root = Sdf.Layer.FindOrOpen(os.path.abspath(path))  # noqa: PTH100  # links in it stay
        except (Tf.ErrorException, RuntimeError) as error:
            raise SceneError(f"{source}: it is no readable USD file: {reason(error)}; export it again") from None
        if self.root is None:
            raise SceneError(f"{source}: it is no readable USD file; export it again")
        self._follow()

    def _follow(self) -> None:
        ahead, seen = [self.root], {self.root.identifier}
        while ahead:
            layer = ahead.pop()
            self._check_clips(layer)
            for named in sorted(layer.GetCompositionAssetDependencies()):
                if not named:
                    continue
                at = f"{self._source}: the layer {quoted(named)}"
                self._check_name(named, at)
                identifier = Sdf.ComputeAssetPathRelativeToLayer(layer, named)
                if identifier in seen:
                    continue
                seen.add(identifier)
                if len(seen) > _MOST:
                    raise SceneError(f"{self._source}: it has more than {counted(_MOST, 'layer')}; flatten it")
                found = self._opened(identifier, at)
                if found is not None:
                    ahead.append(found)
                    self._kept.append(found)

    def _opened(self, identifier: str, at: str) -> Any:
        path, _ = Sdf.Layer.SplitIdentifier(identifier)
        outer = self.checked(path, at)
        if outer is None:
            self.missing.append(f"{at} cannot be opened; put it there")
            return None
        try:
            found = Sdf.Layer.FindOrOpen(identifier)
        except (Tf.ErrorException, RuntimeError) as error:
            self.missing.append(f"{at} is no readable USD file: {reason(error)}; export it again")
            return None
        if found is None:
            self.missing.append(f"{at} is no readable USD file; export it again")
            return None
        if outer not in self.opened:
            self.opened.append(outer)
        return found

    def checked(self, path: str, at: str) -> str | None:
        """The file on disk of a path that is absolute, also within a package, if it exists; it has to be allowed."""
        outer = Ar.SplitPackageRelativePathOuter(path)[0] if Ar.IsPackageRelativePath(path) else path
        allowed_file(outer, self._folder, self._allowed, at)
        return outer if Path(outer).is_file() else None

    def stage(self) -> Any:
        """The composed stage.

        Raises
        ------
        SceneError
            It cannot be composed.
        """
        try:
            return Usd.Stage.Open(self.root)
        except (Tf.ErrorException, RuntimeError) as error:
            raise SceneError(f"{self._source}: it cannot be composed: {reason(error)}; export it again") from None

    def _check_clips(self, layer: Any) -> None:
        """Check that value clips, which composition opens, are in allowed folders."""
        ahead = list(layer.rootPrims)
        while ahead:
            prim = ahead.pop()
            ahead += prim.nameChildren
            for variants in prim.variantSets:
                ahead += [each.primSpec for each in variants.variants]
            for clips in (prim.GetInfo("clips") or {}).values() if prim.HasInfo("clips") else ():
                manifest = clips.get("manifestAssetPath")
                named = [*(clips.get("assetPaths") or ()), *([] if manifest is None else [manifest])]
                files = [*(each.path for each in named), *filter(None, [clips.get("templateAssetPath")])]
                for file in filter(None, files):
                    at = f"{self._source}: {quoted(str(prim.path))}: the clip {quoted(file)}"
                    self._check_name(file, at)
                    self.checked(Sdf.ComputeAssetPathRelativeToLayer(layer, file), at)

    def _check_name(self, name: str, at: str) -> None:
        if Sdf.VariableExpression.IsExpression(name):
            raise SceneError(f"{at} is named by an expression, which is not read; name the file itself")
        if "://" in name:
            raise SceneError(f"{at} is no file beside the scene, and nothing is fetched; save it there and name it")
