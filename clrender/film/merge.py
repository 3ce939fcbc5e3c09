"""Merging of films of one render: each sample is counted once, and their provenance is combined."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

from clrender.errors import UsageError
from clrender.film.consistency import check_consistency
from clrender.film.film import Film
from clrender.image.files import image_sha256
from clrender.wording import shown

__all__ = ["merge_films"]

_SUMMED: Final = ("samples", "rays", "shadow_rays", "render_seconds", "render_cpu_seconds")
_SAME: Final = (
    "scene",
    "scene_sha256",
    "kernel_sha256",
    "version",
    "width",
    "height",
    "seed",
    "integrator",
    "settings",
    "camera_exposure",
    "triangles",
    "crop",
    "faults",
    "plugins",
    "guiding_field_sha256",
)


def merge_films(paths: Sequence[str | Path]) -> Film:
    """Merge films of one request.

    Only two of them are in memory at a time.

    Parameters
    ----------
    paths : sequence of path
        Film files, at least one; their order does not matter.

    Returns
    -------
    Film
        The merged film with the combined provenance.

    Raises
    ------
    UsageError
        When a file is no complete film, is of a session that refits BVHs, is of another request, or shares samples with
        another file; the message names both files.
    """
    if isinstance(paths, str | bytes) or not isinstance(paths, Iterable):
        raise UsageError(f"paths is {shown(paths)}, but must be a list of film files, such as [{str(paths)!r}]")
    paths = list(paths)
    if not paths:
        raise UsageError("no film was given; name the films to merge")
    merged = _loaded(paths[0])
    accounts = [merged.provenance]
    names = [str(paths[0])]
    for path in paths[1:]:
        film = _loaded(path)
        _add(merged, film, names, str(path))
        accounts.append(film.provenance)
        names.append(str(path))
    merged.provenance = _account(merged, accounts)
    return merged


def _loaded(path: str | Path) -> Film:
    film = Film.load(path)
    check_consistency(film, path)
    if film.request.get("refit"):
        raise UsageError(
            f"{path}: was rendered by a session that refits BVHs, so its last digits depend on the scenes before it; "
            "merge films of sessions without refit"
        )
    return film


def _add(merged: Film, film: Film, names: Sequence[str], path: str) -> None:
    """Merge one more film; if it fails, find the earlier film that conflicts."""
    try:
        merged.merge(film, names[0], path)
    except UsageError:
        for name in names:
            Film.load(name).merge(film, name, path)
        raise


def _account(film: Film, accounts: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Provenance of the merged film, from those of its parts."""
    told = {name: accounts[0][name] for name in _SAME if name in accounts[0]}
    told |= {name: sum(_number(each, name) for each in accounts) for name in _SUMMED}
    taken = film.ledger.taken()
    # That of the request, as in the statistics of a render, unless the films are of several with different numbers.
    spp = int(max(taken.max(), *(_number(each, "spp") for each in accounts)))
    if isinstance(told.get("settings"), Mapping):
        told["settings"] = {**told["settings"], "spp": spp}
    return {
        **told,
        **_range_of(film),
        "image_sha256": image_sha256(film.mean()),
        "denoised": False,
        "spp": spp,
        "max_depth": int(max(_number(each, "max_depth") for each in accounts)),
        "nonfinite_samples": film.ledger.samples - film.samples,
        "devices": [device for each in accounts for device in _list(each, "devices")],
        "merged_films": len(accounts),
    }


def _range_of(film: Film) -> dict[str, int]:
    """The samples of each pixel, where all pixels have the same, without which an image cannot be verified."""
    (first, last), *others = film.ledger.ranges(0, 0) or ((0, 0),)
    return {} if others or not film.ledger.holds(first, last) else {"first_sample": first, "sample_count": last - first}


def _number(account: Mapping[str, Any], name: str) -> float:
    """A number of a film's provenance; 0 if missing or invalid, as it does not affect the image."""
    value = account.get(name, 0)
    # Both comparisons are false for NaN
    sound = isinstance(value, (int, float)) and not isinstance(value, bool) and 0 <= value < 2**63
    return value if sound else 0


def _list(account: Mapping[str, Any], name: str) -> list[Any]:
    """The tables in a list of a film's provenance."""
    value = account.get(name)
    return [each for each in value if isinstance(each, Mapping)] if isinstance(value, list) else []
