"""Renders with replicates: the same bits however they are made, and an end that depends on the samples alone."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import OpenEXR
import pytest
import scipy.stats
from faulty_device import FaultyDevice, Lie
from image_support import Cutting, render
from test_resume import stopped

import clrender
from clrender.device import Device
from clrender.errors import UsageError
from clrender.film import Film
from clrender.film.merge import merge_films
from clrender.film.replicates import standard_error
from clrender.integrators import INTEGRATORS
from clrender.settings import SETTINGS

SIZE = (50, 39)
ONE = Cutting(1, "packet", 16, 1, 16, "shuffled")


def same(a: Film, b: Film) -> bool:
    pairs = zip([*a.bands(), *a.square_bands()], [*b.bands(), *b.square_bands()], strict=True)
    return a.ledger == b.ledger and np.array_equal(a.counts, b.counts) and all(np.array_equal(x, y) for x, y in pairs)


@pytest.mark.long
@pytest.mark.parametrize(
    "settings",
    [
        {},
        pytest.param({"filter": "mitchell", "shadow_rays": 2}, marks=pytest.mark.slow),
        pytest.param({"indirect_rays": 3, "max_depth": 4}, marks=pytest.mark.slow),
        pytest.param({"integrator": "reuse"}, marks=pytest.mark.slow),
        pytest.param({"integrator": "whitted"}, marks=pytest.mark.slow),
    ],
    ids=str,
)
def test_no_cut_changes_a_bit(all_devices: list[Device], settings: dict[str, Any]) -> None:
    asked = {"spp": 24, "replicate_spp": 4, **settings}
    whole = render("room", all_devices[:1], **asked).film
    assert same(render("room", all_devices[:1], ONE, **asked).film, whole)
    cutting = Cutting(16, "single", 65536, 7, 64, "in order")
    assert same(render("room", all_devices[:1], cutting, **asked).film, whole)


@pytest.mark.long
def test_devices_change_nothing(all_devices: list[Device]) -> None:
    asked: dict[str, Any] = {"size": (33, 9), "spp": 4, "replicate_spp": 2}  # a sample takes rusticl long
    whole = render("room", all_devices[:1], **asked).film
    for device in all_devices[1:]:
        assert same(render("room", [device], **asked).film, whole), device.info.title
    assert same(render("room", all_devices, Cutting(tile=16), **asked).film, whole)


def test_replicates_are_independent_and_the_first_is_the_sequence(device: Device) -> None:
    """A replicate is the beginning of a sequence of its own, so the first one is the image of so many samples."""
    plain = render("room", [device], spp=8)
    assert plain.film.square_bands() == []
    one = render("room", [device], spp=8, replicate_spp=8)
    assert one.stats["image_sha256"] == plain.stats["image_sha256"]
    two = render("room", [device], spp=16, replicate_spp=8)
    first, second = plain.linear.astype(np.float64), 2.0 * two.linear - plain.linear
    long = render("room", [device], spp=1024).linear
    a, b = ((each - long).mean(axis=2).ravel() for each in (first, second))
    correlation = float((a * b).sum() / np.sqrt((a * a).sum() * (b * b).sum()))
    assert abs(correlation) < 5.0 / np.sqrt(len(a))  # five standard deviations of none
    assert float((b * b).mean() / (a * a).mean()) == pytest.approx(1.0, abs=0.5)


def test_shards_and_interruptions_come_to_the_same(device: Device, tmp_path: Path) -> None:
    room = clrender.load("room")
    how: dict[str, Any] = {"size": SIZE, "spp": 48, "replicate_spp": 16}
    with clrender.Session(device) as session:
        whole = session.render(room, **how).film
        job = clrender.RenderJob.of(room, **how)
        for number in (1, 2):
            session.render(job.shard(number, 2)).save(tmp_path / f"{number}.film")
        part = stopped(session, "room", tmp_path / "a.film", launches=9, **how)
        assert part.interrupted
        assert part.film.ledger.divides(16)
        resumed = session.render(room, checkpoint=tmp_path / "a.film", resume=True, tile=16, **how).film
    assert same(merge_films([tmp_path / "2.film", tmp_path / "1.film"]), whole)
    assert same(resumed, whole)
    assert same(Film.load(tmp_path / "a.film"), whole)
    with pytest.raises(UsageError, match="3 replicates of 16 samples a pixel make at most 3 shards"):
        job.shard(1, 4)


@pytest.mark.long
def test_a_lying_device_leaves_no_squares(device: Device) -> None:
    how: dict[str, Any] = {"size": (96, 64), "spp": 128, "tile": 16, "replicate_spp": 8, "samples_per_pass": 2}
    room = clrender.load("cornell")
    liar, honest = FaultyDevice(device, Lie(constant=True), name="liar"), FaultyDevice(device, name="honest")
    with clrender.Session([liar, honest]) as session:
        image = session.render(room, **how)
    assert [each["state"] for each in image.stats["devices"]] == ["wrong", "ok"]
    with clrender.Session(device) as session:
        assert same(image.film, session.render(room, **how).film)


def test_layers_say_what_is_known(device: Device, tmp_path: Path) -> None:
    image = render("room", [device], spp=64, aov=("stderr", "albedo", "samples"))
    assert image.stats["settings"]["replicate_spp"] == 16
    errors = standard_error(image.film)
    assert image.aovs["stderr"] == pytest.approx(errors, rel=1e-6)
    assert (errors > 0.0).mean() > 0.9
    image.save(tmp_path / "a.exr")
    assert image.stats["mean_stderr"] == pytest.approx(np.sqrt((errors**2).sum((0, 1))) / errors[..., 0].size)
    with OpenEXR.File(str(tmp_path / "a.exr"), separate_channels=True) as file:
        channels = file.channels()
        written = np.stack([channels[f"stderr.{letter}"].pixels for letter in "RGB"], axis=2)
    assert np.array_equal(written, image.aovs["stderr"])


@pytest.mark.long
def test_errors_are_as_large_as_they_say(device: Device) -> None:
    """Of two images of other seeds: their median distance is that of a normal deviate, 0.6745, within 5 sigma."""
    pair = [render("textures", [device], spp=1024, replicate_spp=16, seed=seed) for seed in (0, 7)]
    errors = np.sqrt(sum(standard_error(image.film) ** 2 for image in pair))
    distance = np.abs(pair[0].linear.astype(np.float64) - pair[1].linear)
    known = errors > 0.0
    assert float(np.median(distance[known] / errors[known])) == pytest.approx(0.6745, abs=0.09)


@pytest.mark.long
def test_a_render_ends_by_its_error(device: Device, tmp_path: Path) -> None:
    room, path = clrender.load("cornell"), tmp_path / "a.film"
    how: dict[str, Any] = {"size": (24, 20), "error": 0.2, "share": 0.9, "replicate_spp": 4}
    with clrender.Session(device) as session:
        image = session.render(room, aov=("unconverged",), **how)
        stop = image.stats["spp"]
        assert not image.interrupted and image.stats["converged"] and 64 < stop < image.stats["spp_limit"]
        assert image.film.ledger.holds(0, stop)
        left = int((image.aovs["unconverged"] == 1.0).sum())
        assert left == image.stats["unconverged_pixels"] <= 48
        assert set(np.unique(image.aovs["unconverged"])) <= {0.0, 1.0}
        # Looks after 64, 128, ... samples, up to the most that can be asked for, and one at the end share the 5 %
        replicates, most = image.stats["replicates"], SETTINGS["spp"].schema()["maximum"]
        looks = 1 + sum(64 << doublings < most for doublings in range(40))
        quantile = scipy.stats.t.ppf(1.0 - 0.025 / looks, replicates - 1)
        assert image.stats["mean_interval"] == pytest.approx(quantile * np.array(image.stats["mean_stderr"]), rel=1e-6)
        part = stopped(session, "cornell", path, launches=5, **how)
        assert part.interrupted and not part.stats["converged"]
        again = session.render(room, checkpoint=path, resume=True, lanes=1, tile=8, **how)
        assert same(again.film, image.film)
        most = session.render(room, spp=64, **how)
        assert not most.stats["converged"] and not most.interrupted and most.stats["spp"] == 64
    image.save(tmp_path / "a.exr")
    assert clrender.verify(tmp_path / "a.exr", 1.0, device=device).sound
    image.save(tmp_path / "b.film")
    assert clrender.verify(tmp_path / "b.film", 1.0, device=device).sound


@pytest.mark.parametrize("integrator", [name for name, each in INTEGRATORS.items() if each.bias != "unbiased"])
@pytest.mark.parametrize("asked", [{"error": 0.1}, {"aov": ("stderr",)}, {"replicate_spp": 4}], ids=str)
def test_what_is_biased_has_no_errors(integrator: str, asked: dict[str, Any]) -> None:
    with pytest.raises(UsageError, match=rf"integrator {integrator} is .*neither replicates nor standard errors"):
        clrender.RenderJob.of(clrender.load("room-diffuse"), integrator=integrator, **asked)


@pytest.mark.parametrize(
    ("asked", "problem"),
    [
        ({"replicate_spp": 16, "spp": 40}, "spp is 40.*multiple of replicate_spp, 16: for example 32 or 48"),
        ({"replicate_spp": 3}, "replicate_spp is 3"),
        ({"error": 0.1, "spp": 64}, "needs 16 replicates of 16; set it to 256 or more"),
        ({"confidence": 0.9}, "confidence has no effect without error"),
        ({"error_floor": 0.9}, "error_floor has no effect without error"),
        ({"share": 0.9}, "share has no effect without error"),
        ({"error": 0.0}, "error is 0"),
        ({"aov": ("unconverged",)}, "unconverged needs error"),
        ({"aov": ("stderr",), "spp": 16}, "two replicates or more"),
        ({"replicate_spp": 16, "samples": (8, 64), "spp": 64}, "both must be multiples"),
        ({"error": 0.1, "samples": (0, 256)}, "takes all of them"),
    ],
    ids=str,
)
def test_what_makes_no_sense_is_refused(asked: dict[str, Any], problem: str) -> None:
    with pytest.raises(UsageError, match=problem):
        clrender.RenderJob.of(clrender.load("room"), **asked)


def test_a_shard_does_not_end_by_an_error() -> None:
    job = clrender.RenderJob.of(clrender.load("room"), error=0.1, spp=4096)
    with pytest.raises(UsageError, match="no part of the samples"):
        job.shard(1, 2)
