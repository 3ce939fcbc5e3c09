"""Every array of a film counts: `verify` compares all, and a film that contradicts itself is not added to."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from replicate_support import film_of, samples_of

import clrender
from clrender.errors import UsageError
from clrender.film import Film
from clrender.film.checkpoint import Checkpoint
from clrender.film.consistency import contradictions
from clrender.film.ledger import Ledger
from clrender.film.merge import merge_films
from clrender.rendering.job import RenderJob
from clrender.verification import verify

WIDTH, HEIGHT, SPP, SIZE = 20, 12, 8, 2
SCENE = """
[camera]
position = [0.0, 0.0, -3.0]
target = [0.0, 0.0, 0.0]
[[lights]]
type = "environment"
radiance = [1.0, 1.0, 1.0]
"""


def job() -> RenderJob:
    return RenderJob.of(clrender.load("scene.toml"), size=(WIDTH, HEIGHT), spp=SPP, replicate_spp=SIZE)


def made() -> Film:
    """A sound film with replicates."""
    request = {**job().request(), "arrays_sha256": "a"}
    return film_of(samples_of(3, WIDTH * HEIGHT, SPP), WIDTH, HEIGHT, (4, SPP), request)


class Renderer:
    """In the place of a session: returns what it should compute."""

    def __init__(self, device: Any = None, *, notify: Any = None) -> None:
        pass

    def __enter__(self) -> Renderer:
        return self

    def __exit__(self, *details: Any) -> None:
        pass

    def render_part(
        self, job: RenderJob, wanted: Ledger, check: Callable[[Mapping[str, Any]], None], on_progress: Any
    ) -> Film:
        film = made()
        check(film.request)
        return film


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setattr("clrender.verification.checking.Session", Renderer)
    monkeypatch.chdir(tmp_path)
    (tmp_path / "scene.toml").write_text(SCENE)
    return tmp_path


def saved(change: Callable[[Film], None] = lambda film: None, **said: Any) -> Path:
    film = made()
    change(film)
    film.save("a.film", {"scene": {"name": "scene.toml"}, "nonfinite_samples": 0, **said})
    return Path("a.film")


def zero_squares(film: Film) -> None:
    for band in film.square_bands():
        band[:] = 0


def zero_counts(film: Film) -> None:
    film.counts[:] = 0


def zero_counts_and_sums(film: Film) -> None:
    film.counts[:4] = 0
    for band in (*film.bands(), *film.square_bands()):
        band[:4] = 0


def one_count_less(film: Film) -> None:
    film.counts[5, 6] -= 1


CONTRADICTIONS: list[tuple[Callable[[Film], None], str]] = [
    (zero_squares, "its squares are smaller than its sums allow"),
    (zero_counts, "pixels without samples have nonzero sums"),
    (zero_counts_and_sums, "fewer samples than its ledger records"),
    (one_count_less, "fewer samples than its ledger records"),
]


def test_a_sound_film_is_sound(folder: Path) -> None:
    assert contradictions(Film.load(saved())) == []
    assert verify("a.film", 1.0).sound


@pytest.mark.parametrize("factor", [2.0**-3, 3.0, 1.0 + 2.0**-50])
def test_changed_squares_are_found(folder: Path, factor: float) -> None:
    def scaled(film: Film) -> None:
        for band in film.square_bands():
            words = band.astype(object)
            value = sum((2**64) ** k * words[..., k] for k in range(4))
            changed = [int(each * int(factor * 2**50)) >> 50 for each in np.ravel(value)]
            for k in range(4):
                band[..., k] = np.array([each >> 64 * k & 2**64 - 1 for each in changed], np.uint64).reshape(
                    value.shape
                )

    found = verify(saved(scaled), 1.0)
    assert not found.sound
    if factor > 1.0:
        assert "in their squares, on which error estimates rest, and not in the image" in found.faults[0]


def test_one_changed_square_is_found(folder: Path) -> None:
    def change(film: Film) -> None:
        film.square_bands()[0][7, 9, 1, 0] ^= np.uint64(1)

    found = verify(saved(change), 1.0)
    assert found.pixels == ((9, 7),)


@pytest.mark.parametrize(("change", "words"), CONTRADICTIONS)
def test_what_contradicts_itself_is_not_added_to(folder: Path, change: Callable[[Film], None], words: str) -> None:
    path = saved(change)
    assert any(words in fault for fault in verify(path, 1.0).faults)
    with pytest.raises(UsageError, match=rf"a\.film: is not a sound film: .*{words}.*; render it again"):
        Checkpoint(path, True, print).__enter__()
    made().save("b.film", {})
    for paths in ([path], [Path("b.film"), path]):
        with pytest.raises(UsageError, match=rf"a\.film: is not a sound film: .*{words}"):
            merge_films(paths)
    with Checkpoint("b.film", True, print) as checkpoint:
        assert checkpoint.loaded


def test_samples_that_were_not_finite_are_no_contradiction(folder: Path) -> None:
    assert contradictions(Film.load(saved(one_count_less, nonfinite_samples=1))) == []
    assert contradictions(Film.load(saved(one_count_less, nonfinite_samples=None))) == []
    with Checkpoint(saved(one_count_less, nonfinite_samples=1), True, print) as checkpoint:
        assert checkpoint.loaded


@pytest.mark.parametrize("scale", [1e-15, 1e-6, 1.0, -1.0, 1e9])
def test_samples_of_any_size_and_sign_are_no_contradiction(scale: float) -> None:
    """Equal samples, whose squares are as small as they may be, and others."""
    equal = np.full((SPP, 64, 3), np.float32(scale))
    mixed = samples_of(5, 64, SPP) * np.float32(scale) * np.where(np.arange(SPP) % 2, -1.0, 1.0)[:, None, None]
    for values in (equal, mixed.astype(np.float32)):
        film = film_of(values, 8, 8, (SPP,), {"replicate_spp": SIZE})
        assert contradictions(film) == []
