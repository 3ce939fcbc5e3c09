"""Values as callers have them: NumPy's numbers, paths, texts and arrays are accepted, or refused in one sentence."""

from __future__ import annotations

import copy
import pickle
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cases import for_each
from replicate_support import film_of, same, samples_of

import clrender
from clrender import RenderedImage, SceneError, Session, UsageError, verify
from clrender.aov.names import check_aovs
from clrender.cluster.address import local_workers
from clrender.film import Film
from clrender.film.checkpoint import Checkpoint
from clrender.rendering.job import RenderJob
from clrender.rendering.session import requested_devices
from clrender.scene import Scene

LONE = {"camera": {"position": (0.0, 0.0, 1.0), "target": (0.0, 0.0, 0.0)}}


def scene() -> Scene:
    return Scene.model_validate(LONE)


def film() -> Film:
    return film_of(samples_of(1, 8 * 8, 4), 8, 8, (4,), {"replicate_spp": 2})


@pytest.mark.parametrize(
    "copied", [copy.copy, copy.deepcopy, lambda each: pickle.loads(pickle.dumps(each))], ids=["copy", "deep", "pickle"]
)
def test_films_and_images_are_copied(copied: Callable[[Any], Any]) -> None:
    original = film()
    other = copied(original)
    assert same(original, other)
    other.bands()[0][0, 0, 0, 0] += np.uint64(1)
    assert not same(original, other)
    whole = film_of(samples_of(1, 8 * 8, 8), 8, 8, (4, 8), {"replicate_spp": 2})
    again = copied(whole)
    again.take_out(original)
    again.merge(original)
    assert same(whole, again)
    image = RenderedImage(original.mean(), {"width": 8}, original, interrupted=False)
    assert (copied(image).linear == image.linear).all()
    assert copied(image).stats == image.stats


def test_layers_may_be_one_text() -> None:
    assert check_aovs("albedo") == check_aovs(["albedo"]) == check_aovs(np.array(["albedo"])) == ("albedo",)
    assert check_aovs("albedo, normal") == check_aovs(each for each in ("albedo", "normal")) == ("albedo", "normal")
    with pytest.raises(UsageError, match="no layer 'albdo'; did you mean \"albedo\""):
        check_aovs("albdo")
    for wrong in (5, None):
        with pytest.raises(UsageError, match="must be names of layers"):
            check_aovs(wrong)  # type: ignore[arg-type]


def test_devices_may_be_numbers_of_numpy() -> None:
    for given in (np.int64(1), [np.int32(1)], np.array([1]), 1):
        requested = requested_devices(given)
        assert requested == [1]
        assert type(requested[0]) is int
    for wrong in (1.0, True, Path("cpu"), b"x", bytearray(b"x")):
        with pytest.raises(UsageError, match=r"give an index of clrender\.devices"):
            Session(wrong)  # type: ignore[arg-type]


def test_environments() -> None:
    pixels = np.random.default_rng(1).uniform(0.0, 2.0, (4, 8, 3))
    made = scene().with_environment(pixels)
    picture = made.environment_picture()
    assert picture is not None
    assert picture.pixels.tolist() == pixels.astype(np.float32).tolist()
    pixels[:] = 0.0
    assert made.sha256() == scene().with_environment(picture.pixels).sha256() != scene().sha256()
    grey = scene().with_environment(0.5).sha256()
    for same_grey in (np.float32(0.5), np.array(0.5), (0.5, 0.5, 0.5), [0.5] * 3, np.full(3, 0.5)):
        assert scene().with_environment(same_grey).sha256() == grey
    others: list[Any] = [None, True, b"sky.hdr", {}, np.zeros((3, 4)), np.zeros((0, 2, 3)), [[1], [1, 2]]]
    for wrong in others:
        with pytest.raises(SceneError, match="must be the name of an image, a radiance"):
            scene().with_environment(wrong)
    negative: list[Any] = [-1.0, float("nan"), (0.5, 0.5, -1.0), np.full((2, 2, 3), -1.0)]
    for wrong in negative:
        with pytest.raises(SceneError, match="radiance must be"):
            scene().with_environment(wrong)
    loaded = clrender.load("room-diffuse", environment=np.float32(0.5))  # type: ignore[arg-type]
    assert loaded.origin == {"name": "room-diffuse", "environment": 0.5}


@for_each(
    ("call", "words"),
    [
        (lambda: clrender.load(5), "a scene to load is 5, but must be the name of a file"),  # type: ignore[arg-type]
        (lambda: clrender.load(None), "a scene to load is None"),  # type: ignore[arg-type]
        (lambda: clrender.load(b"room"), "a scene to load is b'room'"),  # type: ignore[arg-type]
        (lambda: clrender.load("room", allow_paths=5), "allow_paths is 5, but must be a list"),  # type: ignore[arg-type]
        (lambda: clrender.load("room", allow_paths=[5]), "allow_paths is 5, but must be the name"),  # type: ignore[list-item]
        (lambda: local_workers(3), "cluster is 3, but must be an address"),  # type: ignore[arg-type]
        (lambda: Checkpoint(5, False, print), "checkpoint is 5, but must be the name"),  # type: ignore[arg-type]
        (lambda: verify(5), "path is 5, but must be the name"),  # type: ignore[arg-type]
        (lambda: verify("a.film", ".5"), "fraction is .5; it must be above 0"),  # type: ignore[arg-type]
        (lambda: RenderJob.of(scene(), samples=5), "samples is 5, but must be two whole numbers"),  # type: ignore[arg-type]
        (lambda: RenderJob.of(scene(), samples=(0.0, 1.0)), "must be two whole numbers"),  # type: ignore[arg-type]
    ],
)
def test_what_is_nothing_of_the_kind_is_refused(call: Callable[[], object], words: str) -> None:
    with pytest.raises(UsageError, match=words.replace("(", r"\(")):
        call()


def test_a_loaded_scene_is_not_loaded_again() -> None:
    with pytest.raises(SceneError, match="a Scene is loaded already"):
        clrender.load(scene())  # type: ignore[arg-type]


def test_a_folder_is_a_list_of_one(tmp_path: Path) -> None:
    for folder in (tmp_path, str(tmp_path), [tmp_path], (each for each in [str(tmp_path)])):
        assert clrender.load("room", allow_paths=folder).sha256() == clrender.load("room").sha256()  # type: ignore[arg-type]


def test_images_are_saved_with_numbers_of_numpy(tmp_path: Path) -> None:
    image = RenderedImage(np.ones((8, 8, 3), np.float32), {"width": 8}, film(), interrupted=False)
    image.save(str(tmp_path / "a.png"), exposure=np.float32(1.0))  # type: ignore[arg-type]
    image.save(tmp_path / "b.png", exposure=1)
    assert (tmp_path / "a.png").read_bytes() == (tmp_path / "b.png").read_bytes()
    for wrong in (None, "1", [1]):
        with pytest.raises(UsageError, match=r"exposure is .*, but must be a number of stops"):
            image.save(tmp_path / "c.png", exposure=wrong)  # type: ignore[arg-type]
    for path in (5, None, b"a.png"):
        with pytest.raises(UsageError, match="but must be the name of a file"):
            image.save(path)  # type: ignore[arg-type]


def test_images_are_arrays() -> None:
    linear = np.arange(192, dtype=np.float32).reshape(8, 8, 3)
    image = RenderedImage(linear, {"width": 8}, film(), interrupted=False)
    assert np.shares_memory(np.asarray(image), linear)
    assert np.mean(image) == linear.mean()
    copied, double = np.array(image), np.asarray(image, np.float64)
    assert not np.shares_memory(copied, linear)
    assert (copied == linear).all()
    assert double.dtype == np.float64
    assert (double == linear).all()
    with pytest.raises(ValueError, match="by a copy only"):
        image.__array__(np.float64, copy=False)
