"""`verify()`: renders random tiles of an image again, with all their samples, and compares bits."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from numbers import Real
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import numpy.typing as npt

from clrender.errors import UsageError
from clrender.film.request import differences
from clrender.film.unit import BLOCK, blocks_across
from clrender.flatten.plugin_rows import plugin_hashes
from clrender.importers import CHOICES, load
from clrender.limits import checked_path
from clrender.plugins import Plugin, as_plugins
from clrender.rendering.job import RenderJob
from clrender.rendering.session import Session
from clrender.rendering.telling import once
from clrender.scene import Scene, builtin_names
from clrender.verification.claim import Claim, claim_of
from clrender.verification.confidence import SampledCheck
from clrender.verification.findings import Comparison, explanation

if TYPE_CHECKING:
    from clrender.device import Device
    from clrender.guiding.field import GuidingField
    from clrender.rendering.rendered_image import Progress

__all__ = ["Verification", "check_plugins", "verify"]

TILE: Final = 16
"""Side of the sampled tiles, pixels: small, so that a fraction of them is informative about the rest."""


@dataclass(frozen=True)
class Verification(SampledCheck):
    """Result of a verification.

    Attributes
    ----------
    tiles : int
        Number of tiles of 16 by 16 pixels that have samples.
    checked : int
        Number of tiles that were drawn at random and rendered again.
    differing : tuple of (int, int, int, int)
        Tiles that differ: the first column and row, and those after the last.
    pixels : tuple of (int, int)
        Pixels in them that differ, column and row.
    faults : tuple of str
        Sentences about what is wrong with the file; empty if nothing is.
    samples : int
        Number of samples rendered again, over all pixels.
    """

    tiles: int
    checked: int
    differing: tuple[tuple[int, int, int, int], ...]
    pixels: tuple[tuple[int, int], ...]
    faults: tuple[str, ...]
    samples: int

    @property
    def parts(self) -> int:
        """Number of tiles."""
        return self.tiles


def verify(
    path: str | Path,
    fraction: float = 0.1,
    *,
    scene: Scene | str | Path | None = None,
    environment: str | Path | float | None = None,
    guiding_field: GuidingField | str | Path | None = None,
    allow_paths: Sequence[str | Path] = (),
    plugins: Any = None,
    device: str | int | Device | Sequence[str | int | Device] | None = None,
    seed: int | None = None,
    on_progress: Callable[[Progress], None] | None = None,
    notify: Callable[[str], None] | None = None,
) -> Verification:
    """Render random tiles of an image again, with all their samples, and compare bits.

    Parameters
    ----------
    path : path
        A `.film`, or an `.exr` or `.png` of a finished render.
    fraction : float
        Fraction of the tiles with samples to check, above 0 and at most 1; at least one tile is checked.
    scene : Scene or path, optional
        The image's scene; by default the one that it names, from the working folder or beside the image.
    environment : path or float, optional
        The environment that was given to the render; default as for `scene`.
    guiding_field : GuidingField or path, optional
        The field that was given to the render.
    allow_paths : sequence of path
        See `clrender.load`.
    plugins : Plugin, str, pathlib.Path, or iterable of them, optional
        The plugins that the scene uses; a file never names where they are.
    device : str, int, Device, sequence of them, optional
        See `clrender.render`; any device will do.
    seed : int, optional
        Seed of the choice of tiles; by default unpredictable, from the system's randomness.
    on_progress, notify : callable, optional
        See `clrender.render`.

    Returns
    -------
    Verification

    Raises
    ------
    UsageError
        The file does not record how it was made, its scene is missing or different, or the kernels are different.
    SceneError, DeviceError, RenderError
        See `clrender.render`.
    """
    path = checked_path(path, "path")
    allowed = as_plugins(plugins)
    if not (isinstance(fraction, Real) and 0.0 < fraction <= 1.0):
        raise UsageError(f"fraction is {fraction}; it must be above 0 and at most 1")
    claim = claim_of(path)
    if claim.request.get("refit") or claim.provenance.get("refit"):
        raise UsageError(
            f"{path}: was rendered by a session that refits BVHs, so its last digits depend on the scenes before it; "
            "verify an image of a session without refit"
        )
    tiles = _tiles_with_samples(claim)
    count = min(len(tiles), math.ceil(fraction * len(tiles)))
    if claim.faults or not count:
        faults = claim.faults or ["it has no samples"]
        return Verification(len(tiles), 0, (), (), tuple(faults), 0)
    chosen = tiles[np.sort(np.random.default_rng(seed).choice(len(tiles), count, replace=False))]
    wanted = claim.ledger.restricted(_blocks_of(claim, chosen))
    found = _scene(path, claim, scene, environment, allow_paths).with_plugins(allowed)
    check_plugins(str(path), claim.request.get("plugins", {}), found.plugins)
    job = _job(path, claim, found, guiding_field)
    with Session(device, notify=once(notify)) as session:
        film = session.render_part(job, wanted, lambda here: _check(path, claim, here), on_progress)
        # Of shadow catchers the coverage comes from renders of its own
        covers = claim.has_alpha and not found.has_shadow_catchers
        layers = session.layers(_alpha_job(job, claim)) if covers else {}
    alpha = layers["alpha"][..., 0] if "alpha" in layers else None
    comparison = Comparison.of(claim, film, [_rectangle(claim, tile) for tile in chosen.tolist()], alpha)
    faults = [explanation(comparison)] if comparison.differing else []
    return Verification(len(tiles), count, comparison.differing, comparison.pixels, tuple(faults), film.ledger.samples)


def _across(claim: Claim) -> int:
    return -(-claim.ledger.width // TILE)


def _tile_of_blocks(claim: Claim) -> npt.NDArray[np.int64]:
    """Index of the tile of every block, row by row."""
    row, column = np.divmod(np.arange(len(claim.ledger.taken())), blocks_across(claim.ledger.width))
    numbers: npt.NDArray[np.int64] = row * BLOCK // TILE * _across(claim) + column * BLOCK // TILE
    return numbers


def _tiles_with_samples(claim: Claim) -> npt.NDArray[np.int64]:
    return np.unique(_tile_of_blocks(claim)[claim.ledger.taken() > 0])


def _blocks_of(claim: Claim, tiles: npt.NDArray[np.int64]) -> npt.NDArray[np.bool_]:
    return np.isin(_tile_of_blocks(claim), tiles)


def _rectangle(claim: Claim, tile: int) -> tuple[int, int, int, int]:
    """First column and row of a tile, and those after the last."""
    row, column = divmod(tile, _across(claim))
    right, bottom = min((column + 1) * TILE, claim.ledger.width), min((row + 1) * TILE, claim.ledger.height)
    return column * TILE, row * TILE, right, bottom


def _scene(
    path: Path,
    claim: Claim,
    given: Scene | str | Path | None,
    environment: str | Path | float | None,
    allow_paths: Sequence[str | Path],
) -> Scene:
    """The scene that a file was made from."""
    if isinstance(given, Scene):
        return given
    if given is not None and not isinstance(given, (str, Path)):
        raise UsageError(f"scene is {given!r}, but must be a Scene or the name of a file")
    origin = _origin(claim)
    if given is None and "name" not in origin:
        raise UsageError(f"{path}: does not name its scene; name it with --scene (scene=…)")
    source = given if given is not None else _found(path, origin["name"], "--scene")
    ending = Path(source).suffix.lower()
    origin |= {key: None for key, endings in CHOICES.items() if ending not in endings}
    around = environment if environment is not None else origin.get("environment")
    if environment is None and isinstance(around, str):
        around = _found(path, around, "--environment")
    return load(
        source,
        allow_paths=allow_paths,
        time_at=origin.get("time_at"),
        shutter=origin.get("shutter"),
        variant=origin.get("variant"),
        up=origin.get("up"),
        define=origin.get("define"),
        environment=around,
        camera=origin.get("camera"),
        hide_environment=origin.get("hide_environment", False),
    )


def _origin(claim: Claim) -> dict[str, Any]:
    """Arguments of `clrender.load` that a file records."""
    said = claim.provenance.get("scene")
    kinds = {
        "name": (str,),
        "time_at": (int, float),
        "shutter": (list,),
        "variant": (str,),
        "up": (str,),
        "define": (dict,),
        "environment": (str, int, float),
        "camera": (dict,),
        "hide_environment": (bool,),
    }
    if not isinstance(said, Mapping):
        return {}
    return {key: said[key] for key, kind in kinds.items() if isinstance(said.get(key), kind)}


def _found(path: Path, name: str, option: str) -> str | Path:
    """A file that an image names, from the working folder or beside the image; or the name of a built-in scene."""
    if option == "--scene" and name in builtin_names():
        return name
    with suppress(OSError, ValueError):  # invalid file names
        for place in (Path(name), path.parent / name, path.parent / Path(name).name):
            if place.is_file():
                return place
    raise UsageError(f"{path}: was made from {name!r}, which was not found; give its location with {option} FILE")


def check_plugins(path: str, said: Any, plugins: Sequence[Plugin]) -> None:
    """Check that all plugins of an image or a data set are given, and with the texts that it was made with.

    Parameters
    ----------
    path : str
        Of what was made, for messages.
    said : mapping of str to str
        Names of its plugins and the SHA-256 of their texts; anything else says nothing.
    plugins : sequence of Plugin
        Those that are given.

    Raises
    ------
    UsageError
        One is missing, or has another text.
    """
    given = plugin_hashes(plugins)
    for name, sha256 in sorted(said.items()) if isinstance(said, Mapping) else ():
        if name not in given:
            raise UsageError(
                f"{path}: was made with the plugin {name} (sha256 {sha256}); give its file with --plugin FILE "
                "(plugins=…)"
            )
        if given[name] != sha256:
            raise UsageError(
                f"{path}: was made with another text of the plugin {name}: that had the sha256 {sha256}, and this "
                f"has {given[name]}; give the original file with --plugin FILE (plugins=…)"
            )


def _job(path: Path, claim: Claim, scene: Scene, field: GuidingField | str | Path | None) -> RenderJob:
    """The render job that made a file, for this scene."""
    said = {name: value for name, value in claim.request.items() if name not in _NOT_SETTINGS}
    if said.pop("guiding_field_sha256", None) is not None:
        if field is None:
            raise UsageError(
                f"{path}: was guided by a field from a file; name it with --guiding-field (guiding_field=…)"
            )
        said["guiding_field"] = field
    size = said.pop("width", None), said.pop("height", None)
    try:
        return RenderJob.of(scene, size=size, spp=claim.samples_end, **said)
    except (UsageError, TypeError, ValueError, OverflowError) as error:
        raise UsageError(f"{path}: cannot be rendered again here ({error})") from None


def _alpha_job(job: RenderJob, claim: Claim) -> RenderJob:
    """The job of the layer alpha alone, with as many samples as the file's."""
    settings = replace(job.settings, spp=claim.provenance["alpha_samples"], error=None, time_limit=None)
    return replace(job, settings=settings, aov=("alpha",))


_NOT_SETTINGS: Final = (
    *("scene_sha256", "kernel_sha256", "sampler_sha256", "arrays_sha256", "version", "plugins", "shares"),
)


def _check(path: Path, claim: Claim, here: Mapping[str, Any]) -> None:
    """Check that a render here would make the same image, as far as the file's records tell."""
    found = differences(claim.request, {key: here[key] for key in claim.request if key in here})
    if "scene_sha256" in found:
        raise UsageError(
            f"{path}: was made from another scene, or the scene has changed since; name the original scene with --scene"
        )
    if {"kernel_sha256", "sampler_sha256", "version"} & set(found):
        raise UsageError(
            f"{path}: was made by the kernels of clrender {claim.request.get('version')}; those of this clrender, "
            f"{here['version']}, may give other bits: verify it with the original version"
        )
    if found:
        raise UsageError(f"{path}: cannot be rendered again here: {'; '.join(found.values())}")
