"""A session renders again without starting over, and gives everything back at its end, however it ends."""

from __future__ import annotations

import dataclasses
import threading
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

import clrender
from clrender import layout
from clrender.device import Buffer, Device
from clrender.errors import DeviceError, RenderError, UsageError
from clrender.film import Film
from clrender.rendering.rendered_image import IncompleteRender

SIZE = (64, 64)


@dataclass
class Watched:
    """What goes to a device: how many bytes at a time, and what is allocated and not released yet."""

    writes: list[int] = field(default_factory=list)
    held: set[int] = field(default_factory=set)


@pytest.fixture
def watched(monkeypatch: pytest.MonkeyPatch) -> Iterator[Watched]:
    seen = Watched()
    write, upload, held, release = Device.write, Device.upload, Device._held, Device.release

    def watched_write(device: Device, buffer: Buffer, array: npt.NDArray[Any]) -> None:
        seen.writes.append(array.nbytes)
        write(device, buffer, array)

    def watched_upload(device: Device, array: npt.NDArray[Any]) -> Buffer:
        before = len(seen.writes)
        buffer = upload(device, array)
        if len(seen.writes) == before:  # buffers may be made with what is in them
            seen.writes.append(array.nbytes)
        return buffer

    def watched_held(device: Device, handle: Any, size: int) -> Buffer:
        buffer = held(device, handle, size)
        seen.held.add(id(buffer.handle))
        return buffer

    def watched_release(device: Device, buffer: Buffer) -> None:
        seen.held.remove(id(buffer.handle))
        release(device, buffer)

    monkeypatch.setattr(Device, "write", watched_write)
    monkeypatch.setattr(Device, "upload", watched_upload)
    monkeypatch.setattr(Device, "_held", watched_held)
    monkeypatch.setattr(Device, "release", watched_release)
    yield seen


CHANGES: dict[str, dict[str, Any]] = {
    "nothing": {},
    "seed": {"seed": 9},
    "samples": {"samples": (1, 2)},
    "settings": {"max_depth": 3, "roulette": "none", "sampling": "light"},
    "size": {"size": (32, 48)},
    "tile": {"tile": 16},
}


@pytest.mark.parametrize("change", CHANGES)
def test_rendering_again_uploads_only_camera_and_settings(device: Device, watched: Watched, change: str) -> None:
    room = clrender.load("room")
    how: dict[str, Any] = {"size": SIZE, "spp": 2, "code": "fast", **CHANGES[change]}
    with clrender.Session(device) as session:
        session.render(room, size=SIZE, spp=2, code="fast")
        builds, many = device.builds, len(watched.writes)
        assert many > 10
        watched.writes.clear()
        image = session.render(room, **how)
        camera, settings = layout.dtype("Camera").itemsize, watched.writes[-1]
        assert sorted(watched.writes) == sorted([camera, settings])
        assert settings == layout.dtype("Settings").itemsize
        assert device.builds == builds
    fresh = clrender.render(room, device=device, **how)
    assert image.stats["image_sha256"] == fresh.stats["image_sha256"]


@pytest.mark.long
def test_another_medium_is_another_scene(device: Device) -> None:
    """Everything else is the same object, so that nothing but the medium tells the scenes apart."""
    haze = clrender.load("haze")
    name, medium = next(iter(haze.media.items()))
    thin = medium.model_copy(update={"scattering": tuple(0.1 * each for each in medium.scattering)})
    other = haze.model_copy(update={"media": {**haze.media, name: thin}})
    with clrender.Session(device) as session:
        session.render(haze, size=SIZE, spp=1)
        second = session.render(other, size=SIZE, spp=1).stats["image_sha256"]
    assert second == clrender.render(other, device=device, size=SIZE, spp=1).stats["image_sha256"]


def test_another_camera_uploads_no_scene(device: Device, watched: Watched) -> None:
    room = clrender.load("room")
    camera = room.camera.model_copy(update={"position": (0.3, 0.1, -3.0), "vertical_fov": 40.0})
    moved = room.model_copy(update={"camera": camera})
    with clrender.Session(device) as session:
        first = session.render(room, size=SIZE, spp=1)
        watched.writes.clear()
        second = session.render(moved, size=SIZE, spp=1)
        assert len(watched.writes) == 2
        again = session.render(clrender.load("room"), size=SIZE, spp=1)  # equal, though another object
        assert len(watched.writes) == 4
    assert first.stats["image_sha256"] == again.stats["image_sha256"] != second.stats["image_sha256"]
    assert second.stats["image_sha256"] == clrender.render(moved, device=device, size=SIZE, spp=1).stats["image_sha256"]


def test_sessions_that_share_a_device_release_only_what_is_theirs(device: Device) -> None:
    room = clrender.load("room")
    how: dict[str, Any] = {"size": (16, 16), "spp": 1}
    before, first, second = device.buffers, clrender.Session(device), clrender.Session(device)
    digest = second.render(room, **how).stats["image_sha256"]
    its = device.buffers - before
    assert its
    first.render(room, **how)  # once the other is open
    own = device.buffers - before - its
    assert own
    second.close()
    assert device.buffers - before == own
    assert first.render(room, **how).stats["image_sha256"] == digest
    second = clrender.Session(device)
    second.render(room, **how)
    first.close()
    assert not device.buffers & own
    assert second.render(room, **how).stats["image_sha256"] == digest
    second.close()
    assert device.buffers == before


def test_sessions_that_share_a_device_hear_of_the_compiling_of_their_own_renders(device: Device) -> None:
    sessions: list[clrender.Session] = []
    heard: list[bool] = []

    def opened(number: int) -> clrender.Session:
        def hear(stage: str) -> None:
            heard.append(device.on_compile == sessions[number].stages.compiling)

        return clrender.Session(device, on_stage=hear)

    sessions += [opened(0), opened(1)]
    room = clrender.load("room")
    for number in (0, 1, 0):
        sessions[number].render(room, size=(16, 16), spp=1)
        assert device.on_compile is None
    sessions[1].close()
    sessions[0].render(clrender.load("caustic"), size=(16, 16), spp=1)
    sessions[0].close()
    assert len(heard) > 8 and all(heard)


def test_another_camera_looks_at_no_shape(device: Device, monkeypatch: pytest.MonkeyPatch) -> None:
    """A moving camera takes the same time in scenes of any number of shapes."""
    job = clrender.RenderJob.of(clrender.load("room"), size=(16, 16), spp=1)
    camera = job.scene.camera
    x, y, z = camera.position
    cameras = [camera.changed(position=(x + 0.1 * step, y, z)) for step in range(3)]
    moved = [dataclasses.replace(job, scene=job.scene.changed(camera=each)) for each in cameras]
    other = job.scene.changed(shapes=job.scene.shapes[:-1])
    with clrender.Session(device=device) as session:
        session.render(job)
        for name in ("all_shapes", "instances", "placed_textures", "place_of"):
            monkeypatch.setattr(clrender.Scene, name, lambda *_: pytest.fail("looked at the shapes"))
        images = [session.refine(each).mean() for each in moved]
        assert not np.array_equal(images[0], images[1])
        # Nor does a new job, or the hash of the scene that a film records
        hashes = {session.render(each.scene, size=(16, 16), spp=1).stats["scene_sha256"] for each in moved}
        assert len(hashes) == len(moved)
        with pytest.raises(pytest.fail.Exception, match="looked at the shapes"):
            session.refine(dataclasses.replace(job, scene=other))


@pytest.mark.long
def test_other_scenes_and_integrators_in_turn(device: Device) -> None:
    """What the one leaves behind is nothing that another one stumbles over."""
    cases: list[tuple[str, dict[str, Any]]] = [
        ("room", {}),
        ("cornell", {"integrator": "photon", "photons": 5000}),
        ("room", {"integrator": "bdpt"}),
        ("room", {"guiding": "on", "guiding_paths": 20000}),
        ("room", {"specular_chains": "on"}),
        ("room", {"integrator": "whitted", "aov": ("albedo", "depth")}),
        ("room-diffuse", {"integrator": "radiosity", "patches": 200, "patch_rays": 16}),
        ("room-diffuse", {"integrator": "reuse"}),
        ("room", {"termination": 0.5, "roulette": "constant"}),
        ("room", {"light_sampler": "uniform"}),
    ]
    alone = [clrender.render(clrender.load(name), device=device, size=(24, 16), spp=2, **how) for name, how in cases]
    with clrender.Session(device) as session:
        for _ in range(2):
            for (name, how), expected in zip(cases, alone, strict=True):
                image = session.render(clrender.load(name), size=(24, 16), spp=2, **how)
                assert image.stats["image_sha256"] == expected.stats["image_sha256"], (name, how)
                assert {k: v.tobytes() for k, v in image.aovs.items()} == {
                    k: v.tobytes() for k, v in expected.aovs.items()
                }


class Fault(Exception):
    """Of whoever uses a session."""


@pytest.mark.thorough
@pytest.mark.parametrize("end", ["well", "by the user", "by a callback", "by bad settings", "by a device"])
@pytest.mark.parametrize("integrator", ["path", "photon", pytest.param("radiosity", marks=pytest.mark.long)])
def test_everything_is_released_however_it_ends(
    device: Device, watched: Watched, monkeypatch: pytest.MonkeyPatch, end: str, integrator: str
) -> None:
    scene = clrender.load("room-diffuse")
    how: dict[str, Any] = {"size": (24, 16), "spp": 2, "integrator": integrator, "patches": 100}
    if integrator != "radiosity":
        how.pop("patches")

    def breaks(*_: object) -> None:
        raise Fault

    def fails(*_: object, **__: object) -> None:
        raise RenderError("told to fail")

    try:
        with clrender.Session(device) as session:
            session.render(scene, aov=("albedo",), **how)
            if end == "by the user":
                raise Fault
            if end == "by a callback":
                session.render(scene, on_progress=breaks, **how)
            if end == "by bad settings":
                session.render(scene, **{**how, "spp": 0})
            if end == "by a device":
                monkeypatch.setattr(Device, "launch", fails)
                session.render(scene, **{**how, "seed": 1})
    except (Fault, UsageError, RenderError):
        assert end != "well"
    else:
        assert end == "well"
    assert not watched.held
    with pytest.raises(UsageError, match="closed"):
        session.render(scene, **how)


def test_a_session_closes_what_it_opened_and_nothing_else(device: Device) -> None:
    with clrender.Session("cpu") as session:
        (own,) = session.devices
        session.render(clrender.load("room"), size=(8, 8), spp=1)
    assert own is not device
    with pytest.raises(AttributeError):
        own.finish()
    with clrender.Session(device) as session:
        session.render(clrender.load("room"), size=(8, 8), spp=1)
    device.finish()


def test_nothing_is_opened_for_a_job_that_makes_no_sense(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("clrender.rendering.residency.select", lambda *_, **__: pytest.fail("a device was looked for"))
    with clrender.Session() as session, pytest.raises(UsageError, match="spp"):
        session.render(clrender.load("room"), spp=-1)


def test_a_render_can_be_watched(device: Device) -> None:
    """A smaller image of what is done, taken in another thread while the render goes on."""
    seen: list[npt.NDArray[Any]] = []
    films: list[Film] = []

    def watch(film: Film) -> None:
        seen.append(film.snapshot(16))

    def progress(now: clrender.Progress) -> None:
        assert now.film is not None
        films.append(now.film)
        thread = threading.Thread(target=watch, args=(now.film,))
        thread.start()
        thread.join()

    image = clrender.render(clrender.load("room"), device=device, size=(96, 64), spp=40, tile=16, on_progress=progress)
    assert len(seen) > 2 and {each.shape for each in seen} == {(11, 16, 3)}
    assert all(np.isfinite(each).all() for each in seen) and seen[-1].mean() > 0.0
    assert (image.film.snapshot(16) == image.linear[::6, ::6]).all()
    assert set(films) == {image.film}


def test_samples_that_are_left_out_are_said_aloud(device: Device) -> None:
    """A point light a millimetre above the ground: what it lights there is brighter than a film takes."""
    ground = {"type": "quad", "origin": [-1, 0, 1], "edge_u": [2, 0, 0], "edge_v": [0, 0, -2], "material": "white"}
    scene = clrender.Scene.model_validate(
        {
            "camera": {"position": [0, 1, 0], "target": [0, 0, 0], "up": [0, 0, -1], "vertical_fov": 1.0},
            "materials": {"white": {"type": "lambert", "reflectance": [0.8, 0.8, 0.8]}},
            "shapes": [ground],
            "lights": [{"type": "point", "position": [0, 0.001, 0], "intensity": [1e9, 1e9, 1e9]}],
        }
    )
    told: list[str] = []
    image = clrender.render(scene, device=device, notify=told.append, size=(16, 16), spp=4)
    lost = image.stats["nonfinite_samples"]
    assert 0 < lost == image.stats["samples"] - image.film.samples
    (warning,) = [line for line in told if line.startswith("warning: ")]
    assert f"{lost} of 1024 samples were not finite, or brighter than 2^43, and left out" in warning


@pytest.mark.parametrize("turned", [False, True])
def test_a_black_image_is_said_aloud(turned: bool, device: Device) -> None:
    """A lamp that is turned away from everything."""
    lamp = {"type": "quad", "origin": [-1, 2, 1], "edge_u": [2, 0, 0], "edge_v": [0, 0, -2], "emission": [5, 5, 5]}
    scene = clrender.Scene.model_validate(
        {
            "camera": {"position": [0, 1, 5], "target": [0, 0, 0]},
            "materials": {"white": {"type": "lambert", "reflectance": [0.8, 0.8, 0.8]}},
            "shapes": [{"type": "sphere", "radius": 1.0, "material": "white"}, {**lamp, "flip_normals": turned}],
        }
    )
    told: list[str] = []
    image = clrender.render(scene, device=device, notify=told.append, size=(32, 32), spp=4)
    assert image.linear.any() == turned
    warned = [line for line in told if line.startswith("warning: every pixel is black")]
    assert len(warned) == (0 if turned else 1)


def test_a_camera_in_a_closed_ball_below_the_sky_sees_a_black_image(device: Device) -> None:
    scene = clrender.Scene.model_validate(
        {
            "camera": {"position": [0, 0, 0.5], "target": [0, 0, 0]},
            "shapes": [{"type": "sphere", "radius": 1.0}],
            "lights": [{"type": "environment", "radiance": [1, 1, 1]}],
        }
    )
    told: list[str] = []
    image = clrender.render(scene, device=device, notify=told.append, size=(16, 16), spp=4)
    assert not image.linear.any()
    (warned,) = [line for line in told if line.startswith("warning: every pixel is black")]
    assert "front" not in warned, "no shape emits"


@pytest.mark.parametrize("where", ["in glass", "behind a wall", "in fog"])
def test_what_makes_an_image_black_is_said_once(where: str, device: Device) -> None:
    ball = {"type": "sphere", "radius": 1.0, "material": "glass" if where == "in glass" else "white"}
    endless = {"type": "directional", "direction": [0, -1, 0], "irradiance": [1, 1, 1]}
    in_ball = {"type": "point", "position": [0, 0, 0], "intensity": [1, 1, 1]}
    scene = clrender.Scene.model_validate(
        {
            "camera": {"position": [0, 0.5, 4], "target": [0, 0, 0]},
            "materials": {
                "white": {"type": "lambert", "reflectance": [0.8, 0.8, 0.8]},
                "glass": {"type": "dielectric", "ior": 1.5},
            },
            "shapes": [
                ball,
                {"type": "quad", "origin": [-2, -2, 2], "edge_u": [4, 0, 0], "edge_v": [0, 0, -4], "material": "white"},
            ],
            "lights": [endless if where == "in fog" else in_ball],
            **({"media": {"mist": {"absorption": [0.1] * 3}}, "fog": "mist"} if where == "in fog" else {}),
        }
    )
    told: list[str] = []
    image = clrender.render(scene, device=device, notify=told.append, size=(16, 16), spp=4)
    (warning,) = [line for line in told if line.startswith("warning: ")]
    assert not image.linear.any()
    cause = {"in glass": "only the integrators bdpt", "behind a wall": "every pixel is black", "in fog": "to infinity"}
    assert cause[where] in warning and "front" not in warning


# --- devices that fail -----------------------------------------------------------------------------------------------


class Broken(Device):
    """A device that fails in one of its calls, from the n-th on."""

    def __init__(self, device: Device, call: str, after: int = 0) -> None:
        self.__dict__.update(device.__dict__)
        self._programs, self._buffers = {}, {}
        self._call_name, self._left = call, after

    def _count(self, call: str, error: type[Exception]) -> None:
        if call == self._call_name:
            self._left -= 1
            if self._left < 0:
                raise error(f"told to fail at {call}")

    def program(self, *args: Any, **more: Any) -> Any:
        self._count("program", DeviceError)
        return super().program(*args, **more)

    def empty(self, nbytes: int) -> Buffer:
        self._count("empty", RenderError)
        return super().empty(nbytes)

    def launch(self, *args: Any) -> None:
        self._count("launch", RenderError)
        super().launch(*args)

    def read(self, *args: Any) -> None:
        self._count("read", RenderError)
        super().read(*args)


FAILURES = [("program", 0), ("program", 6), ("empty", 3), ("launch", 2), ("launch", 18), ("read", 0), ("read", 12)]


@pytest.mark.thorough
@pytest.mark.parametrize(("call", "after"), FAILURES)
@pytest.mark.parametrize("integrator", ["path", "photon", "bdpt", "guided"])
def test_a_device_that_fails_anywhere_leaves_the_image_to_the_other(
    device: Device, watched: Watched, call: str, after: int, integrator: str
) -> None:
    how: dict[str, Any] = {"size": SIZE, "spp": 8, "tile": 16, "integrator": integrator}
    if integrator == "guided":
        how |= {"integrator": "path", "guiding": "on", "guiding_paths": 10000}
    if integrator == "photon":
        how["photons"] = 2000
    room = clrender.load("cornell")
    expected = clrender.render(room, device=device, **how).stats["image_sha256"]
    told: list[str] = []
    with clrender.Session([Broken(device, call, after), device], notify=told.append) as session:
        image = session.render(room, aov=("normal",), **how)
    assert image.stats["image_sha256"] == expected and not image.interrupted
    assert not watched.held
    failed = [line for line in told if "told to fail" in line]
    assert failed and all(line.startswith("warning: ") for line in failed)


@pytest.mark.slow
@pytest.mark.parametrize(
    "how",
    [
        {"integrator": "bdpt"},
        {"integrator": "photon", "photons": 2000},
        {"guiding": "on", "guiding_paths": 10000},
        {"specular_chains": "on"},
        {"integrator": "bdpt", "specular_chains": "on"},
        {"guiding": "on", "guiding_paths": 10000, "specular_chains": "on"},
    ],
    ids=str,
)
def test_two_and_three_devices_make_the_bits_of_one(device: Device, how: dict[str, Any]) -> None:
    asked: dict[str, Any] = {"size": SIZE, "spp": 8, "tile": 16, **how}
    room = clrender.load("room-glass")
    expected = clrender.render(room, device=device, **asked).stats["image_sha256"]
    for count in (2, 3):
        with clrender.Session([Broken(device, "never") for _ in range(count)]) as session:
            image = session.render(room, **asked)
        assert image.stats["image_sha256"] == expected
        assert len(image.stats["devices"]) == count


def test_when_the_last_device_fails_what_was_finished_is_kept(device: Device, watched: Watched) -> None:
    room = clrender.load("room")
    how: dict[str, Any] = {"size": SIZE, "spp": 200, "samples_per_pass": 1, "tile": 16}
    broken = Broken(device, "launch", 400)
    with pytest.raises(IncompleteRender, match="told to fail at launch") as caught:
        clrender.render(room, device=[broken], **how)
    image = caught.value.image
    assert image.interrupted and 0 < image.film.samples == image.film.ledger.samples < 64 * 64 * 200
    assert not watched.held
    whole = clrender.render(room, device=device, **{**how, "spp": 16})
    done = image.film.ledger.ranges(0, 0)
    assert done and done[0][0] == 0
    if done == ((0, 16),):
        assert (image.linear[0, 0] == whole.linear[0, 0]).all()


def test_a_device_that_never_worked_says_why(device: Device) -> None:
    with pytest.raises(DeviceError, match="told to fail at program"):
        clrender.render(clrender.load("room"), device=Broken(device, "program"), size=(8, 8), spp=1)


# --- threads and callbacks -------------------------------------------------------------------------------------------


@pytest.mark.parametrize("shared", ["session", "device"])
def test_threads_wait_for_each_other(device: Device, shared: str) -> None:
    """Each image is that of a render that nobody disturbed."""
    room, found = clrender.load("room"), dict[int, str]()
    how: dict[str, Any] = {"size": SIZE, "spp": 32, "samples_per_pass": 1}

    def render(session: clrender.Session, seed: int) -> None:
        found[seed] = session.render(room, seed=seed, **how).stats["image_sha256"]

    def render_alone(seed: int) -> None:
        with clrender.Session(device) as own:
            render(own, seed)

    with clrender.Session(device) as session:
        alone = {seed: session.render(room, seed=seed, **how).stats["image_sha256"] for seed in range(4)}
        threads = [
            threading.Thread(target=render, args=(session, seed))
            if shared == "session"
            else threading.Thread(target=render_alone, args=(seed,))
            for seed in alone
        ]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join(60.0)
    assert found == alone


def test_a_callback_can_neither_render_nor_close(device: Device) -> None:
    room = clrender.load("room")
    refused: list[str] = []
    with clrender.Session(device) as session:
        whole = session.render(room, size=SIZE, spp=8)

        def meddle(_progress: object) -> None:
            for attempt in (
                lambda: session.render(room, size=(8, 8), spp=1),
                lambda: clrender.render(room, device=device, size=(8, 8), spp=1),
                session.close,
            ):
                with pytest.raises(UsageError, match=r"is rendering; .*wait for the render to end") as caught:
                    attempt()
                refused.append(str(caught.value))

        image = session.render(room, size=SIZE, spp=8, on_progress=meddle)
        assert len(refused) >= 3 and image.stats["image_sha256"] == whole.stats["image_sha256"]
        # Whatever a callback raises, the session is free again
        with pytest.raises(ZeroDivisionError):
            session.render(room, size=SIZE, spp=8, should_stop=lambda: bool(1 // 0))
        assert session.render(room, size=SIZE, spp=8).stats["image_sha256"] == whole.stats["image_sha256"]


@pytest.mark.parametrize("device", [1.5, True, object(), [None, 2.0]])
def test_what_is_no_device_is_refused(device: Any) -> None:
    with pytest.raises(UsageError, match=r"^device is .*; give an index"):
        clrender.Session(device)


def test_a_name_is_no_scene() -> None:
    with pytest.raises(UsageError, match=r"^'room' is no scene; read one with clrender.load"):
        clrender.render("room", size=SIZE)  # type: ignore[arg-type]


# --- time ------------------------------------------------------------------------------------------------------------


def test_too_little_time_for_a_sample_is_an_error_and_no_black_image(device: Device) -> None:
    with pytest.raises(RenderError, match="no sample was finished within 1e-09 s"):
        clrender.render(clrender.load("room"), device=device, size=(8, 8), time_limit=1e-9)


@pytest.mark.long
def test_time_ends_a_long_render(device: Device) -> None:
    clrender.render(clrender.load("room"), device=device, size=SIZE, spp=1)
    image = clrender.render(clrender.load("room"), device=device, size=SIZE, spp=2**20, time_limit=3.0)
    assert image.interrupted and image.film.samples > 0 and image.stats["wall_seconds"] < 10.0


@pytest.mark.long
def test_reading_and_flattening_are_told_apart(device: Device, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A mesh that a scene made in code names is read by its first render, before that flattens it."""
    rng = np.random.default_rng(4)
    lines = [f"v {x} {y} {z}" for x, y, z in rng.random((30000, 3))]
    lines += [f"f {a} {a + 1} {a + 2}" for a in range(1, 29998)]
    (tmp_path / "m.obj").write_text("\n".join(lines))
    monkeypatch.chdir(tmp_path)
    camera = {"position": [0, 0, 5], "target": [0, 0, 0]}
    scene = clrender.Scene.model_validate({"camera": camera, "shapes": [{"type": "mesh", "file": "m.obj"}]})
    with clrender.Session(device) as session:
        first = session.render(scene, size=(8, 8), spp=1).stats
        second = session.render(scene, size=(8, 8), spp=1, seed=1).stats
    assert first["load_seconds"] == first["read_seconds"] + first["flatten_seconds"]
    assert first["read_seconds"] > 10 * second["read_seconds"], "it is read once"
    assert first["flat_bytes"] > 29997 * 12
    assert 0 < first["read_peak_rss_bytes"] <= first["flatten_peak_rss_bytes"] <= first["peak_rss_bytes"]
