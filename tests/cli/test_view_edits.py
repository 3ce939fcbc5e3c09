"""Edits in the live view's engine on a real device: lights, undo, outlines, crops, and scenes that are kept."""

from __future__ import annotations

import io
import time
import zipfile
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import pytest
from cli_support import call
from PIL import Image
from view_clients import EngineClient, Page, Server

import clrender
from clrender.device import Device
from clrender.film import Film
from clrender.view.keep import write_archive

pytestmark = pytest.mark.usefixtures("only_driver")


def rendered(device: Device, scene: clrender.Scene, **settings: Any) -> Any:
    with clrender.Session(device) as session:
        return session.render(scene, size=(96, 64), **{"spp": 4, **settings})


def changed_to(page: EngineClient, *names: str) -> None:
    """Wait for a state in which these things are changed."""
    page.until(lambda m: m.kind == "state" and m.content["changed"] == list(names))


def test_a_changed_light_gives_the_image_of_that_scene(opened: Callable[..., Any], device: Device) -> None:
    _, page = opened()
    before = page.until_done()
    known = page.newest["scene"].content["emitters"]
    place = next(name for name in known if name.startswith("shapes"))
    page.say("light", name=place, values={"emission": [4.0, 1.0, 0.5]})
    digest = page.until_done()
    scene = clrender.load("room").changed({f"{place}.emission": (4.0, 1.0, 0.5)})
    assert digest == rendered(device, scene).stats["image_sha256"] != before
    page.say("reset", what="lights")
    assert page.until_done() == before


@pytest.mark.long
def test_lights_and_environments_that_are_added_are_those_of_the_scene(
    opened: Callable[..., Any], device: Device
) -> None:
    """And of the scene that is kept: a file beside it, and lamps that later ones are numbered after."""
    engine, page = opened()
    first = page.until_done()
    page.say("add_light", position=[0.2, 0.0, 0.3], id=1, kind="sphere")
    page.until_kind("added", id=1, name="shapes[13]")
    one = page.until_done()
    page.say("add_light", position=None, id=2, kind="point")
    page.until_kind("added", id=2, name="lights[0]")
    page.until_done()
    page.say("environments", id=3)
    assert page.until_kind("environments", id=3).content["files"] == ["sky.hdr"]
    page.say("environment", file="sky.hdr", kind="file")
    page.until_done()
    page.say("light", name="lights[1]", values={"rotate_degrees": 40.0, "visible_to_camera": False})
    digest = page.until_done()
    scene = engine.edited_scene.job.scene
    assert [light.type for light in scene.lights] == ["point", "environment"] and len(scene.shapes) == 14
    assert rendered(device, scene).stats["image_sha256"] == digest
    archive = io.BytesIO()
    write_archive(engine.scene_to_keep().result(60), archive)
    folder = Path(engine.edited_scene.scene.base_folder)
    assert not (folder / "scene.zip").exists()
    with TemporaryDirectory() as kept, zipfile.ZipFile(archive) as packed:
        packed.extractall(kept)
        again = clrender.load(Path(kept) / "scene.toml")
        assert rendered(device, again).stats["image_sha256"] == digest
    for _ in range(3):
        page.say("undo")
    page.say("undo", id=9)
    page.until_kind("undone", id=9)
    assert page.until_done() == first
    page.say("redo")
    assert page.until_done() == one
    page.say("remove_light", name="shapes[13]")
    assert page.until_done() == first


@pytest.mark.thorough
def test_alpha_is_that_of_a_render_and_is_in_what_is_saved(
    opened: Callable[..., Any], device: Device, tmp_path: Path
) -> None:
    path = tmp_path / "a.png"
    engine, page = opened("sky", outputs=[path])
    page.say("light", name="lights[0]", values={"visible_to_camera": False})
    digest = page.until_done(2)
    page.say("show", layers=["image", "alpha"], format="float32")
    image = rendered(device, clrender.load("sky").with_hidden_environment(), aov=("alpha",))
    assert image.stats["image_sha256"] == digest
    shown = page.until(lambda m: m.kind == "frame" and m.content["layer"] == "alpha" and not m.content["coarse"])
    # Of 16 samples where the image has four
    assert np.abs(shown.pixels - image.alpha[..., None]).max() <= 0.8
    assert np.abs(shown.pixels - image.alpha[..., None]).mean() < 0.02
    page.say("save", name=str(path), alpha=True)
    page.until_kind("saved")
    image.save(tmp_path / "b.png")
    with Image.open(path) as saved, Image.open(tmp_path / "b.png") as expected:
        assert saved.mode == "RGBA" and np.array_equal(np.asarray(saved), np.asarray(expected))
    page.say("save", name=str(path))
    page.until_kind("saved")
    with Image.open(path) as saved:
        assert saved.mode == "RGB"
    assert engine.image(alpha=True).result(60).alpha.shape == (64, 96)


def test_undo_and_redo_give_the_images_of_before_and_after(opened: Callable[..., Any]) -> None:
    _, page = opened()
    first = page.until_done()
    page.say("camera", camera={"vertical_fov": 30.0})
    second = page.until_done()
    page.say("material", name="white", values={"reflectance": [0.2, 0.3, 0.4]})
    third = page.until_done()
    state = page.until(lambda m: m.kind == "state" and m.content["status"] == "done").content
    assert (state["undo"], state["redo"]) == ("reflectance of material white", None)
    page.say("undo", id="a")
    told = page.until_kind("undone", id="a").content
    assert told["label"] == "reflectance of material white"
    assert page.until_done() == second
    page.say("undo")
    assert page.until_done() == first
    changed_to(page)
    page.say("undo", id="b")
    assert "no edit" in page.until_kind("refused", id="b").content["message"]
    page.say("redo")
    page.say("redo", id="c")
    assert page.until_kind("redone", id="c").content["label"] == "reflectance of material white"
    assert page.until_done() == third
    changed_to(page, "camera", "materials.white")


def test_an_edit_that_changes_nothing_is_none_to_undo(opened: Callable[..., Any]) -> None:
    engine, page = opened()
    page.until_done()
    page.say("camera", camera={"vertical_fov": engine.edited_scene.camera.vertical_fov})
    page.say("reset", what="materials")
    page.say("copy", what="camera", id=1)
    assert "[camera]" in page.until_kind("table", id=1).content["text"]
    page.say("undo", id=2)
    assert page.until(lambda m: m.content.get("id") == 2).kind == "refused"


def test_the_outline_of_a_picked_object_is_where_its_number_is(opened: Callable[..., Any], device: Device) -> None:
    _, page = opened()
    page.until_done()
    page.say("probe", x=48, y=40)
    number = page.until_kind("probe").content["object"]["index"]
    page.say("outline", object=number)
    told = page.until_kind("outline").content
    assert (told["width"], told["height"]) == (96, 64)
    seen = rendered(device, clrender.load("room"), spp=1, aov=("object",)).aovs["object"][..., 0] == number
    assert seen.any()
    # Filling the path by the even-odd rule: each level edge turns the pixels below it over.
    inside = np.zeros((65, 96), bool)
    for piece in told["path"].split("M")[1:]:
        if "h" in piece:
            (x, y), length = map(int, piece.split("h")[0].split()), int(piece.split("h")[1])
            inside[y:, x : x + length] ^= True
    assert (inside[:64] == seen).mean() > 0.99  # the first sample of a pixel may see another one at an edge
    page.say("outline", object=10**6)
    assert page.until_kind("outline", object=10**6).content["path"] == ""


def test_a_crop_is_shown_as_the_image_that_it_is(opened: Callable[..., Any], device: Device) -> None:
    _, page = opened(crop=(10, 7, 41, 30), spp=4)
    digest = page.until_done()
    whole = rendered(device, clrender.load("room"), aov=("depth",))
    assert digest == rendered(device, clrender.load("room"), crop=(10, 7, 41, 30)).stats["image_sha256"]
    for layer, wanted in (("image", whole.linear), ("depth", None)):
        page.say("show", layers=[layer], format="float32")
        frame = page.until(
            lambda m, name=layer: m.kind == "frame" and m.content["layer"] == name and m.content["final"]
        )
        assert (frame.content["image_width"], frame.content["image_height"]) == (41, 30)
        assert frame.pixels.shape[:2] == (30, 41)
        if wanted is not None:
            assert np.array_equal(frame.pixels, wanted[7:37, 10:51])
    page.say("probe", x=40, y=29)
    assert page.until_kind("probe").content["radiance"] == whole.linear[36, 50].tolist()
    page.say("probe", x=41, y=0, id=9)
    page.until_kind("refused", id=9)
    page.say("set", settings={"crop": [0, 0, 96, 64]})
    assert page.until_done() == whole.stats["image_sha256"]


def test_a_scene_that_is_read_again_has_nothing_to_undo(opened: Callable[..., Any], tmp_path: Path) -> None:
    """And a model in another format is read again too, also when only a file beside it has changed."""
    model, library = tmp_path / "model.obj", tmp_path / "model.mtl"
    library.write_text("newmtl red\nKd 0.8 0.1 0.1\n")
    model.write_text("mtllib model.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl red\nf 1 2 3\n")

    class Source:
        def read(self) -> clrender.Scene:
            return clrender.load(model)

        def files(self, scene: clrender.Scene) -> list[Path]:
            from clrender.cli.outputs import scene_files

            return scene_files(str(model), scene)

    _, page = opened(model, source=Source())
    before = page.until_done()
    page.say("camera", camera={"vertical_fov": 20.0})
    assert page.until_done() != before
    red = next(name for name in clrender.load(model).materials if "red" in name)
    page.say("material", name=red, values={"reflectance": [0.5, 0.5, 0.5]})
    page.until_done()
    time.sleep(0.3)  # a change that comes while the files are looked at for the first time is none
    library.write_text("newmtl red\nKd 0.1 0.1 0.8\n")
    page.until(lambda m: m.kind == "scene")
    page.until(lambda m: m.kind == "notice" and f"1 edit ended: materials.{red}" in m.content["message"])
    page.until(lambda m: m.kind == "state" and m.content["undo"] is None and m.content["status"] == "done")
    scene = clrender.load(model)
    name = next(name for name in scene.materials if "red" in name)
    told = page.newest["scene"].content["materials"][name]["parameters"]
    assert [0.1, 0.1, 0.8] in [each["value"] for each in told]


@pytest.mark.long
def test_a_downloaded_scene_renders_to_the_image_of_the_view(cache_folder: Path, tmp_path: Path) -> None:
    with Server("room", "--size", "96x64", "--spp", "8", "-d", "cpu") as server, Page(server.address) as page:
        page.until_done()
        known = page.newest["scene"].content["emitters"]
        place = next(name for name in known if name.startswith("shapes"))
        page.say("camera", camera={"position": [0.5, 1.5, 4.5]})
        page.say("material", name="white", values={"reflectance": [0.3, 0.6, 0.9]})
        page.say("light", name=place, values={"emission": [3.0, 3.0, 1.0]})
        page.say("set", settings={"width": 80, "spp": 5, "seed": 2, "crop": [8, 8, 40, 32]})
        page.until(lambda m: m.kind == "state" and "crop" in m.content["changed"])
        status, body, headers = server.get(f"/download/scene.zip?token={server.token}")
        assert status == 200
        assert headers["content-type"] == "application/zip"
        assert 'filename="scene.zip"' in headers["content-disposition"]
        digest = page.until_done(page.newest["state"].content["revision"])
        assert server.get("/download/scene.zip")[0] == 403
    with zipfile.ZipFile(io.BytesIO(body)) as archive:
        archive.extractall(tmp_path)
    command = (tmp_path / "command.txt").read_text().splitlines()[-1].split()
    assert call(*command[1:-1], "a.film", "-d", "cpu", folder=tmp_path).returncode == 0
    assert Film.load(tmp_path / "a.film").provenance["image_sha256"] == digest


@pytest.mark.long
def test_a_view_begins_with_the_camera_of_a_file_and_follows_it(cache_folder: Path, tmp_path: Path) -> None:
    camera = tmp_path / "camera.toml"
    camera.write_text("[camera]\nposition = [1.0, 1.5, 4.0]\ntarget = [0.0, 1.0, 0.0]\nvertical_fov = 50.0\n")
    with (
        Server("room", "--size", "96x64", "--spp", "2", "-d", "cpu", "--camera", str(camera)) as server,
        Page(server.address) as page,
    ):
        page.until_done()
        assert page.newest["state"].content["camera"]["position"] == [1.0, 1.5, 4.0]
        assert page.newest["state"].content["changed"] == []
        page.say("copy", what="settings", name="", id=1)
        assert f"--camera {camera} -o" in page.until_kind("table", id=1).content["text"]
        time.sleep(1.0)
        camera.write_text(camera.read_text().replace("1.0, 1.5, 4.0", "1.0, 1.25, 4.5"))
        page.until(lambda m: m.kind == "state" and m.content["camera"]["position"] == [1.0, 1.25, 4.5])
