"""The live view's engine on a real device: the same image as `render`, answers to a page, and what it never does."""

from __future__ import annotations

import gc
import json
import threading
import time
import weakref
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from view_clients import EngineClient, Received

import clrender
from clrender.device import Buffer, Device
from clrender.device.compiler import build
from clrender.errors import RenderError, SceneError, UsageError
from clrender.film.film import Film
from clrender.film.replicates import standard_error
from clrender.film.running import RunningFilm
from clrender.image.files import image_sha256
from clrender.view.broadcaster import MOST_VIEWERS
from clrender.view.progressive import Progressive

pytestmark = pytest.mark.usefixtures("only_driver")


def rendered(device: Device, scene: Any = "room", **settings: Any) -> str:
    """The hash of `render`."""
    description = clrender.load(scene) if isinstance(scene, (str, Path)) else scene
    with clrender.Session(device) as session:
        image = session.render(description, size=(96, 64), **{"spp": 4, **settings})
    digest: str = image.stats["image_sha256"]
    return digest


def test_a_view_begins_as_it_is_asked_to(opened: Callable[..., Any]) -> None:
    _, page = opened("room", tone_map="agx", exposure=2)
    assert page.until_kind("hello").content["look"] == {"tone_map": "agx", "exposure": 2.0}
    for wrong, words in (({"tone_map": "film"}, "tone map 'film' is unknown"), ({"exposure": 200.0}, "exposure 200")):
        with pytest.raises(UsageError, match=words):
            opened("room", **wrong)


@pytest.mark.long
@pytest.mark.parametrize(
    ("scene", "settings"),
    [
        ("room", {"spp": 5}),
        ("room", {"spp": 32, "replicate_spp": 8}),
        ("room", {"integrator": "photon", "photons": 2048}),
        ("room-diffuse", {"integrator": "radiosity", "patches": 300, "patch_rays": 32}),
        ("cornell", {"integrator": "reuse", "seed": 3}),
    ],
    ids=lambda value: value if isinstance(value, str) else "-".join(map(str, value.values())),
)
def test_the_finished_image_is_that_of_render(
    opened: Callable[..., Any], device: Device, scene: str, settings: dict[str, Any]
) -> None:
    _, page = opened(scene, **settings)
    assert page.until_done() == rendered(device, scene, **settings)


def test_it_is_so_after_a_camera_that_moved_and_a_render_that_stopped_and_went_on(
    opened: Callable[..., Any], device: Device
) -> None:
    engine, page = opened(spp=2**16)
    for number in range(20):
        page.say("camera", id=number, camera={"position": [0.05 * number, 2.0, 5.0]})
        if number % 4 == 0:
            page.until(lambda m, wanted=number: m.kind == "frame" and m.content["answers"] == wanted)
    for stop in range(3):
        page.say("run", run=True)
        page.until(lambda m: m.kind == "frame" and m.content["answers"] == 19 and not m.content["coarse"])
        page.say("run", run=False)
        page.say("probe", id=stop, x=0, y=0)
        page.until_kind("probe", id=stop)  # by then it has stopped
    spp = int(engine.image_state.film.ledger.taken().max()) + 3
    page.say("set", settings={"spp": spp})
    page.say("run", run=True)
    scene = clrender.load("room")
    moved = scene.camera.changed({"position": (0.05 * 19, 2.0, 5.0)})
    assert page.until_done() == rendered(device, scene.changed({"camera": moved}), spp=spp)


def test_more_samples_are_added_to_those_that_are_there(
    opened: Callable[..., Any], device: Device, monkeypatch: pytest.MonkeyPatch
) -> None:
    taken: list[int] = []
    commit = Film.commit

    def counted(film: Film, unit: Any, result: Any, part: Film | None = None) -> int:
        taken.append(commit(film, unit, result, part))
        return taken[-1]

    engine, page = opened(spp=4)
    assert page.until_done() == rendered(device)
    monkeypatch.setattr(Film, "commit", counted)
    page.say("set", settings={"spp": 9})
    digest = page.until_done()
    assert sum(taken) == 5 * 96 * 64  # those that were there are not taken again
    monkeypatch.undo()
    assert digest == rendered(device, spp=9)
    revision = engine.image_state.revision
    page.say("set", settings={"spp": 4})  # fewer than there are: anew
    assert page.until_done() == rendered(device)
    assert engine.image_state.revision == revision + 1


def test_who_looks_just_before_the_end_sees_the_end_too(
    opened: Callable[..., Any], device: Device, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A frame of all samples, made before the image was known to be finished, was kept in place of the finished one."""
    early: list[bool] = []
    is_open = threading.Event()

    def hashed(linear: Any) -> str:
        is_open.wait()
        frame = None
        while frame is None or frame.changes != engine.image_state.changes:  # it may not be time for another yet
            frame = engine.frames.newest(engine.image_state, "image", 2048, (-1, -1))
        early.append(frame.final)
        return image_sha256(linear)

    monkeypatch.setattr("clrender.view.progressive.image_sha256", hashed)
    engine, page = opened()
    is_open.set()
    page.until(lambda m: m.kind == "frame" and m.content["final"], seconds=60)
    assert early == [False]


def test_who_is_told_that_it_is_done_knows_the_numbers_of_the_end(
    opened: Callable[..., Any], device: Device, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The progress came after the state, and a page that looked between the two saw two thirds of the samples."""
    error = Progressive.error

    def slow(progressive: Progressive) -> float | None:
        time.sleep(0.2)  # time for a page to look
        return error(progressive)

    monkeypatch.setattr(Progressive, "error", slow)
    _, page = opened(spp=4)
    for spp in (4, 6):
        page.say("set", settings={"spp": spp})
        page.until(lambda m, spp=spp: m.kind == "state" and m.content["status"] == "done" and _spp(m) == spp)
        assert page.newest["progress"].content["samples"] == spp
        assert page.newest["progress"].content["sha256"]


def _spp(state: Received) -> int:
    return int(state.content["settings"]["spp"])


def test_a_camera_that_moves_uploads_nothing_else_and_compiles_nothing(
    opened: Callable[..., Any], device: Device, monkeypatch: pytest.MonkeyPatch
) -> None:
    engine, page = opened("room", spp=2)
    page.until_done()
    page.say("camera", id="warm", camera={"position": [0.0, 2.0, 5.5]})
    page.until(lambda m: m.kind == "frame" and m.content["answers"] == "warm" and m.content["final"])
    writes: list[int] = []
    uploads: list[int] = []
    write, upload = Device.write, Device.upload

    def watched(device: Device, buffer: Buffer, array: npt.NDArray[Any]) -> None:
        writes.append(array.nbytes)
        write(device, buffer, array)

    def uploaded(device: Device, array: npt.NDArray[Any]) -> Buffer:
        uploads.append(array.nbytes)
        return upload(device, array)

    monkeypatch.setattr(Device, "write", watched)
    monkeypatch.setattr(Device, "upload", uploaded)
    builds = device.builds
    for number in range(5):
        page.say("camera", id=number, camera={"position": [0.1 * number, 2.0, 5.0]})
        page.until(lambda m, wanted=number: m.kind == "frame" and m.content["answers"] == wanted and m.content["final"])
    assert engine.image_state.revision > 5
    assert device.builds == builds
    assert not uploads
    assert writes
    assert max(writes) < 16384  # cameras and settings; the settings hold the filter's table


def test_a_material_that_changes_gives_the_image_of_that_scene(opened: Callable[..., Any], device: Device) -> None:
    _, page = opened()
    before = page.until_done()
    revision = page.newest["state"].content["revision"]
    page.say("material", name="white", values={"reflectance": [0.9, 0.1, 0.1]})
    told = page.until(
        lambda m: m.kind == "scene" and m.content["materials"]["white"]["parameters"][-1]["value"][0] > 0.8
    )
    assert told.content["materials"]["red"]["type"] == "lambert"
    assert page.newest["state"].content["revision"] > revision, "the finished image passed for that of the edited scene"
    scene = clrender.load("room")
    red = scene.materials["white"].changed({"reflectance": (0.9, 0.1, 0.1)})
    changed = scene.changed({"materials": {**scene.materials, "white": red}})
    assert page.until_done() == rendered(device, changed) != before
    page.say("reset", what="materials")
    assert page.until_done() == before


def test_a_material_that_was_probed_is_listed_from_then_on(
    opened: Callable[..., Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Also where there are too many to list, and after its edits were undone: a page that shows it is not mistaken."""
    monkeypatch.setattr("clrender.view.tables.MOST_MATERIALS", 0)
    _, page = opened()
    page.until_done()
    assert page.newest["scene"].content["materials"] == {}
    page.say("probe", id="p", x=40, y=30)
    probed = page.until_kind("probe", id="p").content["material"]
    other = next(name for name in clrender.load("room").materials if name != probed)
    page.say("material", name=other, values={"two_sided": False})
    page.until(lambda m: m.kind == "scene" and m.content["materials"].keys() == {probed, other})
    page.say("undo", id="u")
    page.until_kind("undone", id="u")
    assert page.newest["scene"].content["materials"].keys() == {probed, other}


def test_a_pixel_is_told_as_it_is_in_the_film(opened: Callable[..., Any], device: Device) -> None:
    engine, page = opened(spp=16, replicate_spp=4)
    page.until_done()
    with clrender.Session(device) as session:
        image = session.render(
            clrender.load("room"), size=(96, 64), spp=16, replicate_spp=4, aov=("object", "material")
        )
    errors = standard_error(image.film)
    scene = clrender.load("room")
    for x, y in ((0, 0), (95, 63), (40, 30), (60, 50), (20, 45)):
        page.say("probe", id=f"{x},{y}", x=x, y=y)
        told = page.until_kind("probe", id=f"{x},{y}").content
        assert told["radiance"] == image.linear[y, x].tolist()
        assert told["samples"] == 16
        assert told["standard_error"] == errors[y, x].tolist()
        assert told["object"]["index"] == image.aovs["object"][y, x, 0]
        assert told["material"] == list(scene.materials)[int(image.aovs["material"][y, x, 0])]
        assert told["object"]["type"] == scene.shapes[told["object"]["index"]].type
        away = np.linalg.norm(np.subtract(told["position"], scene.camera.position))
        assert told["depth"] == pytest.approx(float(away), rel=1e-3)
        assert 0.0 < told["focus_distance"] <= told["depth"] * 1.001
    page.say("probe", x=96, y=0)
    assert "no pixel" in page.until_kind("refused", to="probe").content["message"]
    assert engine.image_state.sha256


def test_every_layer_is_shown(opened: Callable[..., Any], device: Device) -> None:
    _, page = opened(spp=16, replicate_spp=4)
    page.until_done()
    names = [each["name"] for each in page.newest["hello"].content["layers"]]
    assert {"image", "albedo", "normal", "depth", "stderr", "error", "object"} <= set(names)
    with clrender.Session(device) as session:
        image = session.render(clrender.load("room"), size=(96, 64), spp=16, replicate_spp=4, aov=("stderr", "object"))
    for name in names:
        page.say("show", layers=[name], format="float32")
        shown = page.until(lambda m, wanted=name: m.kind == "frame" and m.content["layer"] == wanted)
        assert shown.pixels.shape[:2] == (64, 96)
        assert np.isfinite(shown.pixels).any()
        if name in ("stderr", "object"):
            assert np.array_equal(shown.pixels, image.aovs[name], equal_nan=True)
        if name == "image":
            assert np.array_equal(shown.pixels, image.linear)
    page.say("show", layers=["image", "denoised"])
    for name in ("image", "denoised"):
        page.until(lambda m, wanted=name: m.kind == "frame" and m.content["layer"] == wanted)


def test_a_large_image_comes_in_fewer_pixels(opened: Callable[..., Any]) -> None:
    _, page = opened(spp=1)
    page.until_done()
    page.say("show", layers=["image"], max_side=32)
    shown = page.until(lambda m: m.kind == "frame" and m.content["width"] <= 32 and not m.content["coarse"])
    assert (shown.content["width"], shown.content["height"]) == (32, 22)
    assert (shown.content["image_width"], shown.content["image_height"]) == (96, 64)


class _File:
    """A scene file as the command line names it."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def read(self) -> clrender.Scene:
        return clrender.load(self.path)

    def files(self, scene: clrender.Scene) -> list[Path]:
        return [self.path]


@pytest.mark.thorough
def test_a_scene_file_that_changes_is_read_again_and_a_broken_one_is_told(
    opened: Callable[..., Any], device: Device, tmp_path: Path
) -> None:
    path = tmp_path / "scene.toml"
    text = Path(clrender.__path__[0], "..", "scenes", "room.toml").read_text()
    path.write_text(text)
    engine, page = opened(path, source=_File(path))
    page.until_done()
    page.say("camera", camera={"vertical_fov": 50.0})
    page.until_done()
    path.write_text(text.replace("vertical_fov = 45.0", "vertical_fov = nonsense"))
    told = page.until(lambda m: m.kind == "state" and m.content["problem"] is not None).content
    assert told["problem"]["where"] == "scene"
    assert "line" in told["problem"]["message"]
    assert told["status"] == "done"  # the last good image stays
    assert engine.image_state.film is not None
    other = text.replace("[0.63, 0.065, 0.05]", "[0.05, 0.065, 0.63]")
    path.write_text(other)
    digest = page.until_done()
    assert page.newest["state"].content["problem"] is None
    scene = clrender.load(path)
    camera = scene.camera.changed({"vertical_fov": 50.0})  # the file's has not changed: the page's stays
    assert digest == rendered(device, scene.changed({"camera": camera}))
    path.unlink()
    assert page.until(lambda m: m.kind == "state" and m.content["problem"] is not None)


def test_only_files_of_the_command_line_are_written(opened: Callable[..., Any], device: Device, tmp_path: Path) -> None:
    wanted = [tmp_path / name for name in ("a.png", "a.exr", "a.film")]
    _, page = opened(outputs=wanted)
    digest = page.until_done()
    assert page.newest["hello"].content["saves"] == [str(path) for path in wanted]
    for path in wanted:
        page.say("save", name=str(path), id=path.name)
        assert page.until_kind("saved", id=path.name).content["bytes"] == path.stat().st_size
    with clrender.Session(device) as session:
        image = session.render(clrender.load("room"), size=(96, 64), spp=4)
    image.save(tmp_path / "b.png")
    film = Film.load(tmp_path / "a.film")
    assert np.array_equal(film.mean(), image.linear)
    assert film.request == image.film.request
    assert film.provenance["image_sha256"] == digest
    assert film.provenance["samples"] == 4 * 96 * 64
    for name in ("b.exr", "../a.png", str(tmp_path / "c.png"), "a.png", "/etc/passwd", ""):
        page.say("save", name=name)
        assert "no file of the command line" in page.until_kind("refused", to="save").content["message"]
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.exr", "a.film", "a.png", "b.png"]


def test_who_takes_nothing_slows_nobody(opened: Callable[..., Any]) -> None:
    engine, page = opened(spp=64)
    idle = engine.connect(lambda: None)
    for number in range(400):
        page.say("camera", id=number, camera={"position": [0.001 * number, 2.0, 5.0]})
    page.until(lambda m: m.kind == "frame" and m.content["answers"] == 399)
    page.until_done()
    taken = list(iter(idle.take, None))
    assert len([each for each in taken if isinstance(each, bytes)]) == 1
    assert len(taken) < 60


def test_there_are_not_too_many_viewers(opened: Callable[..., Any]) -> None:
    engine, page = opened()
    more = [EngineClient(engine) for _ in range(MOST_VIEWERS - 1)]
    with pytest.raises(UsageError, match="viewers"):
        engine.connect(lambda: None)
    more[0].viewer.close()
    engine.connect(lambda: None)
    assert page.until_done()


def test_what_is_refused_leaves_the_image(opened: Callable[..., Any], device: Device) -> None:
    _, page = opened()
    page.until_done()
    bad: dict[str, dict[str, Any]] = {
        "camera": {"camera": {"vertical_fov": 500}},
        "set": {"settings": {"integrator": "radiosity"}},  # the room has glass
        "material": {"name": "white", "values": {"reflectance": {"texture": "x.png"}}},
        "device": {"device": "no such device"},
    }
    for kind, content in bad.items():
        page.say(kind, id=kind, **content)
        assert page.until_kind("refused", to=kind, id=kind).content["message"]
    page.say("restart")
    assert page.until_done() == rendered(device)


def test_a_failing_device_is_told_and_the_view_goes_on(
    opened: Callable[..., Any], device: Device, monkeypatch: pytest.MonkeyPatch
) -> None:
    _, page = opened()
    digest = page.until_done()

    def failing(*_: Any, **__: Any) -> Any:
        raise SceneError("made up")

    with monkeypatch.context() as broken:
        broken.setattr(clrender.Session, "refine", failing)
        page.say("set", settings={"seed": 5})
        told = page.until_kind("state", status="failed").content
        assert told["problem"] == {"where": "render", "message": "made up"}
    page.say("reset", what="settings")
    assert page.until_done() == digest


def test_a_compiler_that_runs_is_told_until_it_has_ended(
    opened: Callable[..., Any], device: Device, monkeypatch: pytest.MonkeyPatch
) -> None:
    """So that nobody takes a view that waits for it for one that hangs; who connects meanwhile is told too."""
    engine, page = opened()
    digest = page.until_done()
    told = threading.Event()

    def waiting(*arguments: Any) -> Any:
        told.wait(60.0)
        return build(*arguments)

    monkeypatch.setattr("clrender.device.device.build", waiting)
    monkeypatch.setattr(device, "_programs", {})
    try:
        page.say("restart")
        page.until_kind("compiling", compiling=True)
        assert EngineClient(engine).until_kind("compiling").content["compiling"]
    finally:
        told.set()
    page.until_kind("compiling", compiling=False)
    assert page.until_done() == digest
    engine.close()
    assert device.on_compile is None


def test_a_black_image_is_told(opened: Callable[..., Any]) -> None:
    """A camera below the floor, while it moves on, and back."""
    _, page = opened(spp=64)
    assert not page.until_kind("state", status="rendering").content["is_black"]
    for number in range(3):
        page.say("camera", id=number, camera={"position": [0.1 * number, -3.0, 0.1], "target": [0.0, -9.0, 0.0]})
        assert page.until_kind("state", is_black=True)
    page.until_done()
    assert page.newest["state"].content["is_black"]
    page.say("reset", what="camera")
    page.until_kind("state", is_black=False)
    page.until_done()
    assert not page.newest["state"].content["is_black"]


def test_a_black_preview_is_told(opened: Callable[..., Any]) -> None:
    """Where no samples are taken, previews are all there is."""
    _, page = opened(spp=2**16)
    page.until_kind("state", status="rendering")
    page.say("run", run=False)
    page.say("camera", id=1, camera={"position": [0.0, -3.0, 0.1], "target": [0.0, -9.0, 0.0]})
    assert page.until_kind("state", is_black=True).content["status"] == "stopped"
    page.say("reset", what="camera")
    page.until_kind("state", is_black=False)


def test_what_was_finished_before_a_failure_can_be_saved(
    opened: Callable[..., Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    refine = clrender.Session.refine

    def failing(session: Any, job: Any, film: Any = None, *, on_progress: Any = None, **how: Any) -> Any:
        def advance(progress: Any) -> None:
            on_progress(progress)
            if progress.film.changes:
                raise RenderError("made up")

        return refine(session, job, film, on_progress=on_progress and advance, **how)

    monkeypatch.setattr(clrender.Session, "refine", failing)
    path = tmp_path / "a.film"
    _, page = opened(outputs=[path], spp=2**12)
    page.until_kind("state", status="failed")
    page.say("save", name=str(path))
    assert page.until_kind("saved").content["bytes"] == path.stat().st_size
    assert 0 < Film.load(path).ledger.samples < 2**12 * 96 * 64


def test_an_image_that_is_handed_out_stays_as_its_numbers_say(opened: Callable[..., Any]) -> None:
    engine, page = opened(spp=2**16)
    page.until(lambda m: m.kind == "frame" and m.content["samples"] > 0)
    image = engine.image().result(60)
    page.until(lambda m: m.kind == "frame" and m.content["samples"] * 96 * 64 > image.stats["samples"])
    assert image.film.ledger.samples == image.stats["samples"]
    assert image_sha256(image.film.mean()) == image.stats["image_sha256"]


def test_a_finished_image_that_gets_more_samples_is_final_no_more(
    opened: Callable[..., Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    engine, page = opened()
    page.until_done()
    waits, goes_on = threading.Event(), threading.Event()
    refine = clrender.Session.refine

    def waiting(*arguments: Any, **how: Any) -> Any:
        waits.set()
        goes_on.wait()
        return refine(*arguments, **how)

    monkeypatch.setattr(clrender.Session, "refine", waiting)
    page.say("set", settings={"spp": 9})
    assert waits.wait(60)
    try:
        assert not EngineClient(engine).until_kind("frame").content["final"]
    finally:
        goes_on.set()
    assert page.until_done()


def test_nothing_is_kept_of_earlier_images_and_of_viewers_that_are_gone(
    opened: Callable[..., Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    engine, page = opened(replicate_spp=1)
    page.until_done()
    page.say("probe", id=1, x=3, y=3)
    page.until_kind("probe", id=1)
    page.say("show", layers=["depth"])
    page.until(lambda m: m.kind == "frame" and m.content["layer"] == "depth")
    film = weakref.ref(engine.image_state.film)
    page.say("show", layers=["image"])
    other = EngineClient(engine)
    waits, goes_on = threading.Event(), threading.Event()

    def waiting() -> None:
        waits.set()
        goes_on.wait()

    engine._inbox.call(waiting)
    assert waits.wait(60)
    other.say("camera", id="other", camera={"position": [0.1, 2.0, 5.0]})
    other.viewer.close()  # before what it said is followed
    goes_on.set()
    page.say("camera", id=2, camera={"position": [0.2, 2.0, 5.0]})
    page.until(lambda m: m.kind == "frame" and m.content["answers"] == 2)
    gc.collect()
    assert film() is None
    assert engine.image_state.camera_ids == {page.viewer.number: 2}


def test_a_broken_scene_file_neither_hides_a_failure_nor_costs_samples(
    opened: Callable[..., Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    engine, page = opened()
    page.until_done()
    revision = engine.image_state.revision
    engine._inbox.call(lambda: engine._problems.add("scene", "made up"))
    page.say("set", settings={"spp": 9})
    page.until_done()
    assert engine.image_state.revision == revision

    def failing(*_: Any, **__: Any) -> Any:
        raise RenderError("no more")

    with monkeypatch.context() as broken:
        broken.setattr(clrender.Session, "refine", failing)
        page.say("restart")
        page.until_kind("state", status="failed")
        engine._inbox.call(lambda: engine._problems.add("scene", "made up again"))
        told = page.until(lambda m: m.kind == "state" and "again" in m.content["problem"]["message"]).content
        assert told["status"] == "failed"


@pytest.mark.filterwarnings("ignore::pytest.PytestUnhandledThreadExceptionWarning")
def test_viewers_hear_of_a_renderer_that_dies(opened: Callable[..., Any], monkeypatch: pytest.MonkeyPatch) -> None:
    engine, page = opened()
    page.until_done()

    def failing(*_: Any) -> Any:
        raise RuntimeError("made up")

    with monkeypatch.context() as broken:
        broken.setattr("clrender.view.tables.state", failing)
        page.say("restart")
        assert "made up" in page.until_kind("bye").content["reason"]
    assert "made up" in engine.problem
    assert engine.ended


def test_a_view_that_ends_before_its_first_picture_looks_for_no_devices(
    opened: Callable[..., Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    looked: list[int] = []

    def devices() -> list[Any]:
        looked.append(1)
        return []

    def slow(*_: Any, **__: Any) -> RunningFilm:
        time.sleep(1.0)
        return RunningFilm(96, 64)

    monkeypatch.setattr("clrender.view.tables.devices", devices)
    monkeypatch.setattr(clrender.Session, "refine", slow)
    before = set(threading.enumerate())
    engine, _ = opened()
    started = set(threading.enumerate()) - before
    engine.close()
    for thread in started:
        thread.join(30)
    assert not looked


def test_another_device_gives_the_same_image(opened: Callable[..., Any]) -> None:
    _, page = opened()
    digest = page.until_done()
    page.say("device", device="cpu")
    assert page.until_done() == digest


def test_it_ends_while_it_renders(opened: Callable[..., Any]) -> None:
    engine, page = opened(spp=2**16)
    page.until_kind("frame")
    engine.close()
    assert not engine._thread.is_alive()
    assert json.loads(json.dumps(page.until_kind("bye").content))["reason"]
    assert page.viewer.closed


def test_the_image_before_is_displayed_until_the_next_one_has_pixels(opened: Callable[..., Any]) -> None:
    """A moving camera replaces images faster than viewers take them; those that were rendered are sent all the same."""
    engine, page = opened()
    page.until_done()

    def restarted() -> tuple[int, int]:
        engine._progressive.restart(engine.edited_scene.job, {})
        return engine.displayed.revision, engine.image_state.revision

    before = engine.image_state.revision
    assert engine._inbox.call(restarted).result(60) == (before, before + 1)
    page.until_done()
    assert engine.displayed is engine.image_state
