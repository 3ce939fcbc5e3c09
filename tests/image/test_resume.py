"""Resumed on whatever devices, cut however, with more samples than before: the image is that of one render."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np
import pytest

import clrender
from clrender.device import Device
from clrender.errors import RenderError, UsageError
from clrender.film import Film
from clrender.film.merge import merge_films
from clrender.rendering.rendered_image import IncompleteRender, Progress, RenderedImage

SIZE = (50, 39)


class Stopper:
    """Says yes after so many launches."""

    def __init__(self, launches: int) -> None:
        self.left = launches

    def __call__(self, progress: Progress) -> None:
        self.left -= 1

    def stops(self) -> bool:
        return self.left <= 0


def stopped(session: clrender.Session, scene: str, path: Path, launches: int = 3, **how: Any) -> RenderedImage:
    """A render of many slow launches that somebody stops."""
    stopper, launch = Stopper(launches), Device.launch

    def slow(self: Device, *arguments: Any) -> None:
        time.sleep(0.02)
        launch(self, *arguments)

    with_film: dict[str, Any] = {"checkpoint": path, "on_progress": stopper, "should_stop": stopper.stops}
    with patch.object(Device, "launch", slow):
        return session.render(clrender.load(scene), **with_film, **{"samples_per_pass": 1, **how})


CASES: dict[str, tuple[str, dict[str, Any], dict[str, Any]]] = {
    "cut in other ways": ("room", {"tile": 8, "lanes": 4}, {"tile": 64, "lanes": 16, "samples_per_pass": 3}),
    "photon maps": ("room", {"integrator": "photon", "photons": 2000}, {"integrator": "photon", "photons": 2000}),
    "light paths": ("room", {"integrator": "bdpt", "tile": 16}, {"integrator": "bdpt", "filter": "box"}),
    "guided": (
        "room",
        {"guiding": "on", "guiding_paths": 20000, "tile": 16},
        {"guiding": "on", "guiding_paths": 20000},
    ),
    "chains": ("room", {"specular_chains": "on", "tile": 16}, {"specular_chains": "on"}),
    "shared light": ("room-diffuse", {"integrator": "reuse", "tile": 16}, {"integrator": "reuse"}),
    "a shard": ("room", {"samples": (5, 17)}, {"samples": (5, 17), "tile": 12}),
}


@pytest.mark.thorough
@pytest.mark.parametrize("case", CASES)
def test_the_image_is_that_of_one_render(device: Device, tmp_path: Path, case: str) -> None:
    scene, first, then = CASES[case]
    path = tmp_path / "a.film"
    with clrender.Session(device) as session:
        once = session.render(clrender.load(scene), size=SIZE, spp=18, **then)
        part = stopped(session, scene, path, size=SIZE, spp=18, **first)
        assert part.interrupted and 0 < part.film.samples < once.film.samples
        image = session.render(clrender.load(scene), size=SIZE, spp=18, checkpoint=path, resume=True, **then)
    assert image.stats["image_sha256"] == once.stats["image_sha256"]
    assert image.stats["resumed_samples"] == part.film.ledger.samples
    assert image.stats["samples"] == once.stats["samples"] and not image.interrupted
    assert image.film.ledger == once.film.ledger == Film.load(path).ledger
    # Photons and light paths are traced once more for samples that were begun
    assert image.stats["rays"] == once.stats["rays"] or case in ("photon maps", "light paths")


def test_more_samples_later_and_what_is_whole_needs_no_work(device: Device, tmp_path: Path) -> None:
    path, room = tmp_path / "a.film", clrender.load("room")
    seen: list[Progress] = []
    with clrender.Session(device) as session:
        once = session.render(room, size=SIZE, spp=20)
        for spp in (3, 11, 20):
            image = session.render(room, size=SIZE, spp=spp, checkpoint=path, resume=True, on_progress=seen.append)
        assert image.stats["image_sha256"] == once.stats["image_sha256"]
        assert seen[-1].samples_done == seen[-1].samples_total == 20 * 50 * 39
        assert seen[-1].samples_resumed == 11 * 50 * 39
        units = sum(each["samples"] for each in image.stats["devices"])
        assert units == 9 * 50 * 39 and image.stats["spp"] == 20
        before = len(seen)
        again = session.render(
            room, size=SIZE, spp=20, checkpoint=path, resume=True, on_progress=seen.append, aov=("depth",)
        )
        assert again.stats["image_sha256"] == once.stats["image_sha256"] and len(seen) == before
        assert not again.interrupted and "depth" in again.aovs and again.stats["rays"] == once.stats["rays"]
        with pytest.raises(UsageError, match="holds samples, up to 20 of a pixel"):
            session.render(room, size=SIZE, spp=19, checkpoint=path, resume=True)


def test_several_devices_go_on_together(all_devices: list[Device], tmp_path: Path) -> None:
    """One device stops, all go on; the film cannot tell."""
    path, room = tmp_path / "a.film", clrender.load("room")
    with clrender.Session(all_devices[0]) as session:
        once = session.render(room, size=SIZE, spp=9)
        stopped(session, "room", path, size=SIZE, spp=9)
    pair = [all_devices[0], all_devices[0]] if len(all_devices) == 1 else all_devices[:2]
    with clrender.Session(pair[0] if pair[0] is pair[1] else pair) as session:
        image = session.render(room, size=SIZE, spp=9, checkpoint=path, resume=True)
    assert image.stats["image_sha256"] == once.stats["image_sha256"]


def test_shards_with_checkpoints_merge(device: Device, tmp_path: Path) -> None:
    job = clrender.RenderJob.of(clrender.load("room"), size=SIZE, spp=8)
    with clrender.Session(device) as session:
        once = session.render(job)
        for number in (1, 2):
            session.render(job.shard(number, 2), checkpoint=tmp_path / f"{number}.film")
    merged = merge_films([tmp_path / "1.film", tmp_path / "2.film"])
    assert np.array_equal(merged.mean(), once.linear)
    assert merged.provenance["rays"] == once.stats["rays"]


def test_the_time_limit_counts_anew(device: Device, tmp_path: Path) -> None:
    how: dict[str, Any] = {"size": SIZE, "spp": 2**20, "checkpoint": tmp_path / "a.film", "resume": True}
    with clrender.Session(device) as session:
        first = session.render(clrender.load("room"), time_limit=0.7, **how)
        second = session.render(clrender.load("room"), time_limit=0.7, **how)
        # What was there is shown, though there is no time for anything
        third = session.render(clrender.load("room"), time_limit=1e-9, **how)
    assert 0 < first.film.samples < second.film.samples == third.film.samples
    assert np.array_equal(second.linear, third.linear)


def test_a_device_that_dies_leaves_a_checkpoint(device: Device, tmp_path: Path) -> None:
    path, room, launches = tmp_path / "a.film", clrender.load("room"), [12]
    launch = Device.launch

    def dying(self: Device, *arguments: Any) -> None:
        launches[0] -= 1
        if launches[0] < 0:
            raise RenderError(f"{self.info.title} died")
        launch(self, *arguments)

    with clrender.Session(device) as session:
        once = session.render(room, size=SIZE, spp=64)
        with patch.object(Device, "launch", dying), pytest.raises(IncompleteRender):
            session.render(room, size=SIZE, spp=64, samples_per_pass=1, checkpoint=path)
        held = Film.load(path).ledger.samples
        image = session.render(room, size=SIZE, spp=64, checkpoint=path, resume=True)
    assert 0 < held < once.stats["samples"]
    assert image.stats["image_sha256"] == once.stats["image_sha256"]
    assert image.stats["resumed_samples"] == held


def test_an_exception_of_the_caller_s_leaves_a_checkpoint(device: Device, tmp_path: Path) -> None:
    path = tmp_path / "a.film"

    def interrupted(progress: Progress) -> None:
        if progress.film is not None and progress.film.samples:
            raise KeyboardInterrupt

    with clrender.Session(device) as session, pytest.raises(KeyboardInterrupt):
        session.render(clrender.load("room"), size=SIZE, spp=2**20, checkpoint=path, on_progress=interrupted)
    assert Film.load(path).samples > 0
    assert [each.name for each in tmp_path.iterdir()] == ["a.film"]


def test_resume_without_a_checkpoint(device: Device) -> None:
    with pytest.raises(UsageError, match="resume has no effect without a checkpoint"):
        clrender.render(clrender.load("room"), device=device, size=SIZE, spp=1, resume=True)
