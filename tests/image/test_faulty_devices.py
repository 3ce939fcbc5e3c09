"""Devices that fail, hang, lie or come back, through the one way on which every call of a driver goes.

Whatever happens to one device, the image keeps its bits, the render ends, and it says what happened.
"""

from __future__ import annotations

import os
import random
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import pytest
from faulty_device import CALLS, Fault, FaultyDevice, Lie

import clrender
from clrender.device import Device
from clrender.errors import DeviceError
from clrender.film import Film
from clrender.rendering.rendered_image import IncompleteRender, RenderedImage
from clrender.scheduling import run as scheduling
from clrender.scheduling.watchdog import TimeLimits

ROOT = Path(__file__).resolve().parents[2]
HOW: Final[dict[str, Any]] = {"size": (96, 64), "spp": 32, "tile": 16, "samples_per_pass": 2}
_SLOW: Final = pytest.mark.slow
_REST: Final = ("write", "launch", "allocate")
HASTE: Final = TimeLimits(call=3.0, compile=12.0, hurry=1.0, pause=0.02)
"""What such small launches take is milliseconds, but the machine may be busy."""


# pyopencl makes a name for the code that it generates for each kernel, and these may meet after some thousands
pytestmark = pytest.mark.filterwarnings("ignore:Overwriting existing generated code")


@pytest.fixture(autouse=True)
def haste(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(scheduling, "TIME_LIMITS", HASTE)


@pytest.fixture(scope="module")
def expected(device: Device) -> str:
    return str(clrender.render(clrender.load("cornell"), device=device, **HOW).stats["image_sha256"])


@dataclass
class Outcome:
    image: RenderedImage
    told: list[str]

    @property
    def states(self) -> list[str]:
        return [each["state"] for each in self.image.stats["devices"]]


def share(*devices: Device, **more: Any) -> Outcome:
    """One render by these devices together."""
    told: list[str] = []
    with clrender.Session(list(devices), notify=told.append) as session:
        image = session.render(clrender.load("cornell"), **{**HOW, **more})
    return Outcome(image, told)


@pytest.fixture
def threads() -> Iterator[None]:
    """All threads end, those that hung as well once they are let go."""
    before = threading.active_count()
    yield
    end = time.monotonic() + 20.0
    while threading.active_count() > before and time.monotonic() < end:
        time.sleep(0.02)
    assert threading.active_count() <= before


def random_fault(rng: random.Random) -> Fault:
    call = rng.choice(CALLS)
    # From set-up to well into the samples: about so many calls of a kind there are
    after = rng.randrange({"build": 2, "allocate": 40, "write": 25, "launch": 150, "read": 40, "finish": 2}[call])
    return Fault(call, after, rng.choice(("error", "error", "error", "gone", "gone", "hang")), rng.choice((1, 1, 2, 5)))


def suffer(device: Device, expected: str, seed: int) -> int:
    """A render in which things go wrong; gives how many did."""
    rng = random.Random(seed)
    kinds: list[Fault | Lie] = [random_fault(rng) for _ in range(rng.choice((1, 1, 2)))]
    if rng.random() < 0.15:
        kinds.append(Lie(constant=rng.random() < 0.5, seed=seed))
    bad, good = FaultyDevice(device, *kinds, name="bad"), FaultyDevice(device, name="good")
    try:
        outcome = share(*((bad, good) if rng.random() < 0.5 else (good, bad)))
    finally:
        for fault in bad.faults:
            fault.released.set()
    assert not any(line.startswith("warning: good") for line in outcome.told), (seed, kinds, outcome.told)
    assert outcome.image.stats["image_sha256"] == expected and not outcome.image.interrupted, (seed, kinds)
    met = sum(fault.met > 0 for fault in bad.faults)
    lied = any(lie.told for lie in bad.lies)
    assert bool(met or lied) == any("bad" in line for line in outcome.told), (seed, kinds, outcome.told)
    assert bool(met) <= any(each["failures"] for each in outcome.image.stats["devices"]) | lied
    return met + lied


@pytest.mark.long
@pytest.mark.parametrize("seed", range(4))
def test_whatever_fails_the_image_stays(device: Device, expected: str, threads: None, seed: int) -> None:
    suffer(device, expected, seed)


@pytest.mark.slow
@pytest.mark.parametrize("part", range(5))
def test_five_hundred_faults(device: Device, expected: str, threads: None, part: int) -> None:
    """Of all kinds, at random moments, until 100 have happened in each part; those that come too late do not count."""
    met, seed = 0, 1000 * (part + 1)
    while met < 100:
        met += suffer(device, expected, seed)
        seed += 1
    print(f"{met} faults in {seed - 1000 * (part + 1)} renders")
    assert seed < 1000 * (part + 1) + 400


def suffer_alone(device: Device, expected: str, seed: int) -> int:
    """A render by one device that fails now and then; gives how often it did."""
    rng = random.Random(seed)
    after = {"build": 2, "allocate": 60, "write": 12, "launch": 200, "read": 60}
    call = rng.choice(list(after))
    fault = Fault(call, rng.randrange(after[call]), times=rng.choice((1, 2, 3)))
    alone = FaultyDevice(device, fault, name="alone")
    outcome = share(alone)
    assert outcome.image.stats["image_sha256"] == expected and not outcome.image.interrupted, (seed, fault)
    film = outcome.image.film
    assert film.ledger.holds(0, HOW["spp"]) and film.samples == film.ledger.samples, (seed, fault)
    assert bool(fault.met) == bool(outcome.image.stats["devices"][0]["failures"]) or call == "allocate", (seed, fault)
    return fault.met


@pytest.mark.parametrize("seed", [pytest.param(seed, marks=pytest.mark.long if seed > 2 else ()) for seed in range(40)])
def test_a_device_that_fails_alone_loses_nothing(device: Device, expected: str, seed: int) -> None:
    suffer_alone(device, expected, 7000 + seed)


@pytest.mark.parametrize("call", [pytest.param(call, marks=_SLOW if call in _REST else ()) for call in CALLS])
def test_the_only_device_comes_back(device: Device, expected: str, call: str) -> None:
    after = {"build": 1, "finish": 0}.get(call, 12)
    alone = FaultyDevice(device, fault := Fault(call, after, times=2), name="alone")
    if call == "finish":
        outcome = share(alone, integrator="photon", photons=500, spp=4)
        undisturbed = clrender.render(
            clrender.load("cornell"), device=device, **{**HOW, "integrator": "photon", "photons": 500, "spp": 4}
        )
        expected = undisturbed.stats["image_sha256"]
    else:
        outcome = share(alone)
    assert fault.met == 2 and outcome.image.stats["image_sha256"] == expected
    assert outcome.states == ["ok"] and outcome.image.stats["devices"][0]["failures"] >= 1
    assert any("it is set up again in" in line for line in outcome.told)
    assert "it worked again when it was set up anew" in outcome.told[-1]


def test_the_only_device_is_given_up_in_the_end(device: Device) -> None:
    alone = FaultyDevice(device, Fault("launch", 400, "gone"), name="alone")
    with pytest.raises(IncompleteRender, match=r"alone .* failed at ") as caught:
        share(alone, spp=2048)
    image = caught.value.image
    assert image.interrupted and image.film.samples == image.film.ledger.samples > 0
    (stats,) = image.stats["devices"]
    assert stats["state"] == "failed" and stats["failures"] == 1 + HASTE.retries


@pytest.mark.long
def test_a_device_that_hangs_alone_keeps_what_it_did(device: Device, threads: None) -> None:
    alone = FaultyDevice(device, fault := Fault("read", 90, "hang"), name="alone")
    with pytest.raises(IncompleteRender, match=r"alone .* hangs: a call of its driver did not come back") as caught:
        share(alone, spp=2048)
    assert caught.value.image.film.samples > 0
    fault.released.set()


@pytest.mark.long
def test_a_session_goes_on_without_a_device_that_hung(device: Device, expected: str, threads: None) -> None:
    bad = FaultyDevice(device, fault := Fault("launch", 36, "hang"), name="bad")
    good = FaultyDevice(device, name="good", waits_for=fault)
    with clrender.Session([bad, good]) as session:
        assert session.render(clrender.load("cornell"), **HOW).stats["image_sha256"] == expected
        assert fault.met
        assert session.devices == [good]
        assert session.render(clrender.load("cornell"), **HOW).stats["image_sha256"] == expected
    fault.released.set()


HANGS: Final = """
import sys, clrender
from faulty_device import Fault, FaultyDevice
from clrender.scheduling import run
from clrender.scheduling.watchdog import TimeLimits
import clrender.rendering.residency
run.TIME_LIMITS = TimeLimits(call=1.0, compile=4.0)
real = clrender.rendering.residency.select
def faulty(*given, **more):
    (device,) = real(*given, **more)
    fault = Fault("read", 4, "hang")
    return [FaultyDevice(device, fault, name="bad"), FaultyDevice(device, name="good", waits_for=fault)]
clrender.rendering.residency.select = faulty
sys.argv = ["clrender", "render", "cornell", "--size", "96x64", "--spp", "64", "--tile", "16", "-o", sys.argv[1]]
from clrender.__main__ import main
main()
"""


@pytest.mark.long
def test_a_program_with_a_thread_that_hangs_ends(device: Device, tmp_path: Path) -> None:
    done = subprocess.run(
        [sys.executable, "-c", HANGS, str(tmp_path / "a.png")],
        env={**os.environ, "PYTHONPATH": f"{ROOT}:{ROOT / 'scripts'}"},
        capture_output=True,
        text=True,
        check=False,
        timeout=90,
    )
    assert done.returncode == 0, done.stderr
    assert "bad (" in done.stderr and "hangs" in done.stderr
    assert (tmp_path / "a.png").stat().st_size > 1000


# --- devices that lie ------------------------------------------------------------------------------------------------


@pytest.mark.long
@pytest.mark.parametrize(
    ("constant", "places"), [(False, (0, 1)), (True, (1, 0))], ids=["another error each time", "always the same error"]
)
def test_a_lying_device_is_found_and_its_work_done_again(
    device: Device, expected: str, constant: bool, places: tuple[int, int]
) -> None:
    lie = Lie(constant=constant)
    liar, honest = FaultyDevice(device, lie, name="liar"), FaultyDevice(device, name="honest", waits_for=lie)
    pair = (liar, honest)
    outcome = share(*(pair[place] for place in places), spp=128)
    truth = share(honest, spp=128).image.stats["image_sha256"]
    assert lie.told
    assert outcome.image.stats["image_sha256"] == truth
    assert [outcome.states[place] for place in places] == ["wrong", "ok"]
    (line,) = [line for line in outcome.told if line.startswith("warning: ")]
    why = "it fails the probe that every device has to pass" if constant else "it gets different ones each time"
    assert line.startswith("warning: liar (") and f"computes wrong results: {why}" in line


@pytest.mark.long
def test_a_checkpoint_keeps_nothing_of_a_liar(device: Device, tmp_path: Path) -> None:
    """Nor does what is resumed: the film gives samples back while it is saved."""
    lie, path = Lie(), tmp_path / "a.film"
    honest = FaultyDevice(device, name="honest", waits_for=lie)
    outcome = share(FaultyDevice(device, lie, name="liar"), honest, spp=128, checkpoint=path)
    truth = share(honest, spp=128).image
    assert outcome.states == ["wrong", "ok"]
    saved = Film.load(path)
    assert saved.mean().tobytes() == truth.linear.tobytes() and saved.ledger == truth.film.ledger
    more = share(honest, spp=160, checkpoint=path, resume=True).image
    assert more.stats["resumed_samples"] == saved.ledger.samples
    assert more.stats["image_sha256"] == share(honest, spp=160).image.stats["image_sha256"]
    # And one that lies about what a checkpoint lacks, in parts of tiles
    lie = Lie()
    late = FaultyDevice(device, name="honest", waits_for=lie)
    last = share(FaultyDevice(device, lie, name="liar"), late, spp=256, tile=8, checkpoint=path, resume=True)
    assert last.states == ["wrong", "ok"]
    assert last.image.stats["image_sha256"] == share(honest, spp=256).image.stats["image_sha256"]


@pytest.mark.long
def test_layers_that_a_liar_may_have_made_are_made_again(device: Device) -> None:
    truth = share(FaultyDevice(device), aov=("albedo", "depth")).image
    lie = Lie()
    honest = FaultyDevice(device, waits_for=lie)
    outcome = share(FaultyDevice(device, lie, name="liar"), honest, aov=("albedo", "depth"))
    assert outcome.states[0] == "wrong"
    for name, layer in truth.aovs.items():
        assert outcome.image.aovs[name].tobytes() == layer.tobytes(), name


def test_two_that_differ_and_pass_the_probe_are_both_refused(device: Device, monkeypatch: pytest.MonkeyPatch) -> None:
    """Nobody guesses which image is right."""
    monkeypatch.setattr("clrender.rendering.job_render.passes_probe", lambda device: True)
    lie = Lie(constant=True)
    liar, honest = FaultyDevice(device, lie, name="one"), FaultyDevice(device, name="two", waits_for=lie)
    with pytest.raises(clrender.RenderError, match="give different results for the same samples, each the same every"):
        share(liar, honest)


def test_two_of_one_driver_outvote_a_third(device: Device, expected: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("clrender.rendering.job_render.passes_probe", lambda device: pytest.fail("they need no probe"))
    lie = Lie(constant=True)
    honest = [FaultyDevice(device, name=name, waits_for=lie) for name in ("a", "b")]
    outcome = share(honest[0], FaultyDevice(device, lie, name="liar"), honest[1], spp=256)
    assert outcome.states == ["ok", "wrong", "ok"]


def test_healthy_devices_are_checked_at_little_cost(device: Device) -> None:
    outcome = share(FaultyDevice(device, name="a"), FaultyDevice(device, name="b"), spp=256)
    check = outcome.image.stats["spot_check"]
    assert check["differences"] == 0 and check["pieces"] >= 2
    assert 0 < check["samples"] <= 0.01 * outcome.image.stats["samples"]
    assert sum(each["checked"] for each in outcome.image.stats["devices"]) == check["samples"]
    assert share(device).image.stats["spot_check"] == {"samples": 0, "pieces": 0, "differences": 0}


def lie_and_see(device: Device, seed: int) -> tuple[bool, float]:
    """Whether a device that lies now and then was found, and which share of the samples was done twice."""
    rng = random.Random(seed)
    lie = Lie(share=rng.choice((1.0, 0.3)), blocks=rng.choice((1.0, 0.2)), constant=rng.random() < 0.3, seed=seed)
    liar, honest = FaultyDevice(device, lie, name="liar"), FaultyDevice(device, name="honest")
    # A render has to be long enough for a hundredth of it to contain wrong blocks, where few are
    spp = 512 if lie.share * lie.blocks > 0.1 else 2048
    try:
        outcome = share(*((liar, honest) if seed % 2 else (honest, liar)), spp=spp, size=(192, 128))
    except clrender.RenderError as error:
        print(f"seed {seed}: {lie}: {error}")
        return False, 0.0  # it was seen that one of them lies, but not which
    check = outcome.image.stats["spot_check"]
    found = outcome.states[1 - seed % 2] == "wrong"
    assert outcome.states[seed % 2] == "ok", seed
    if lie.told and not found:
        print(f"seed {seed}: {lie}: not found")
    return found or not lie.told, check["samples"] / outcome.image.stats["samples"]


@pytest.mark.slow
def test_a_hundred_lying_devices(device: Device) -> None:
    """Each spoils all or a third of its units, whole or a fifth of their blocks."""
    seen = [lie_and_see(device, seed) for seed in range(100)]
    print(f"found {sum(found for found, _ in seen)}, most {max(cost for _, cost in seen):.4f} done twice")
    assert sum(found for found, _ in seen) >= 99
    assert max(cost for _, cost in seen) <= 0.01


def test_a_refused_program_is_tried_once_more(device: Device, monkeypatch: pytest.MonkeyPatch) -> None:
    tries = 0

    def refuse(*_: object, **__: object) -> None:
        nonlocal tries
        tries += 1
        raise DeviceError("cannot build: no such instruction")

    monkeypatch.setattr("clrender.device.device.build", refuse)
    with pytest.raises(DeviceError, match="no such instruction"):
        share(FaultyDevice(device))
    assert tries == 2
