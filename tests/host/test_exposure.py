"""Exposure by f-stop, shutter and film speed: the formula, where it may be said; radiance knows nothing of it."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cases import for_each
from click.testing import CliRunner

from clrender.cli import main
from clrender.errors import SceneError, UsageError
from clrender.film import Film
from clrender.image.display import open_display
from clrender.image.exposure import camera_exposure, photographic_stops
from clrender.image.files import write_image
from clrender.image.tone_map import display_values
from clrender.rendering.rendered_image import RenderedImage
from clrender.scene import Scene
from clrender.scene.portable import scene_from_portable, scene_to_portable

SUNNY_16 = {"f_stop": 16.0, "shutter": 0.01, "iso": 100.0}


def scene(**camera: Any) -> Scene:
    return Scene.model_validate({"camera": {"position": [0, 0, 3], "target": [0, 0, 0], **camera}})


def test_white_is_the_luminance_that_saturates() -> None:
    """ISO 12232: H = 78 / S lx s, and on the sensor H = 0.65 L t / N^2."""
    for f_stop, shutter, iso in ((16.0, 0.01, 100.0), (1.4, 1 / 30, 3200.0), (8.0, 2.0, 50.0)):
        luminance = 78.0 / iso * f_stop**2 / (0.65 * shutter)
        radiance = np.full(3, luminance / 683.0)
        shown = display_values(radiance * 0.999, "linear", photographic_stops(f_stop, shutter, iso))
        np.testing.assert_allclose(shown, 0.999, rtol=1e-12)


def test_it_is_the_exposure_value_of_engines() -> None:
    """EV of ISO 100 is log2(100 N^2 / (t S)), and luminance is divided by 1.2 2^EV (Lagarde and de Rousiers)."""
    value = math.log2(16.0**2 / 0.01)
    assert photographic_stops(**SUNNY_16) == pytest.approx(math.log2(683.0 / 1.2) - value, abs=1e-12)
    assert photographic_stops(16.0, 0.01) == photographic_stops(**SUNNY_16)
    assert photographic_stops() == 0.0


@pytest.mark.parametrize(("change", "stops"), [({"shutter": 0.02}, 1), ({"f_stop": 32.0}, -2), ({"iso": 400.0}, 2)])
def test_each_counts_in_stops(change: dict[str, float], stops: float) -> None:
    assert photographic_stops(**{**SUNNY_16, **change}) - photographic_stops(**SUNNY_16) == pytest.approx(stops)


@for_each(
    ("given", "words"),
    [
        ({"f_stop": 8.0}, "f_stop makes no exposure without shutter; give f_stop and shutter"),
        ({"iso": 100.0}, "iso makes no exposure without f_stop"),
        ({"shutter": 0.02}, "or only exposure, and for motion blur two times, such as 0:1/48"),
        ({"shutter": 1.0, "iso": 100.0}, "shutter and iso make no exposure without f_stop"),
        ({**SUNNY_16, "f_stop": 0.0}, "f_stop is 0.0, but must be a number of at least 0.1 and at most 1000"),
        ({**SUNNY_16, "iso": math.nan}, "iso is nan, but must be"),
        ({**SUNNY_16, "shutter": "long"}, "shutter is 'long', but must be"),
    ],
)
def test_what_makes_no_exposure_is_refused(given: dict[str, Any], words: str) -> None:
    with pytest.raises(UsageError, match=words):
        photographic_stops(**given)


@pytest.mark.parametrize(
    ("camera", "words"),
    [
        ({"f_stop": 8.0}, "camera.f_stop is given without shutter; give f_stop and shutter, or leave f_stop out"),
        ({"iso": 100.0}, "camera.iso is given without f_stop"),
        ({"f_stop": 8.0, "shutter": 0.0}, "camera.shutter"),
    ],
)
def test_scenes_that_say_half_of_it_are_refused(camera: dict[str, float], words: str) -> None:
    with pytest.raises(SceneError, match=words.replace(".", r"\.")):
        Scene(camera={"position": [0, 0, 3], "target": [0, 0, 0], **camera})


def test_it_is_no_part_of_what_is_rendered() -> None:
    plain, exposed = scene(), scene(**SUNNY_16)
    assert plain.camera.exposure is None and exposed.camera.exposure == SUNNY_16
    assert exposed.sha256() == plain.sha256()
    assert plain.sha256() != scene(vertical_fov=30.0).sha256()
    again = scene_from_portable(*scene_to_portable(exposed))
    assert again.camera.exposure == SUNNY_16


def test_what_is_asked_for_comes_before_what_the_scene_says() -> None:
    exposed = scene(**SUNNY_16)
    assert exposed.with_exposure(iso=400.0).camera.exposure == {**SUNNY_16, "iso": 400.0}
    assert exposed.with_exposure() is exposed
    assert scene().with_exposure(2.0, 0.5).camera.exposure == {"f_stop": 2.0, "shutter": 0.5}
    with pytest.raises(UsageError, match="without shutter"):
        scene().with_exposure(f_stop=2.0)


def test_images_are_saved_as_their_camera_asks_for_and_brighter_by_stops(tmp_path: Path) -> None:
    radiance = 0.25 * 2.0 ** -photographic_stops(**SUNNY_16)
    linear = np.full((2, 3, 3), radiance, np.float32)
    image = RenderedImage(linear, {"camera_exposure": SUNNY_16}, Film(3, 2), False)
    for name, stops, value in (("a.png", 0.0, 0.25), ("b.png", 1.0, 0.5)):
        image.save(tmp_path / name, "linear", stops)
        with (tmp_path / name).open("rb") as file:
            assert np.asarray(open_display(file)).max() == round(255 * value)
    image.save(tmp_path / "a.npy")
    np.testing.assert_array_equal(np.load(tmp_path / "a.npy"), linear)


def test_tonemap_exposes_as_the_image_says_unless_it_is_told(tmp_path: Path) -> None:
    radiance = 0.25 * 2.0 ** -photographic_stops(**SUNNY_16)
    write_image(tmp_path / "a.exr", np.full((2, 3, 3), radiance, np.float32), {"camera_exposure": SUNNY_16})
    for options, value in (([], 0.25), (["--iso", "200"], 0.5), (["--shutter", "1/50", "--exposure", "-2"], 0.125)):
        made = tmp_path / "a.png"
        done = CliRunner().invoke(
            main, ["tonemap", str(tmp_path / "a.exr"), "-o", str(made), "--tone-map", "linear", *options]
        )
        assert done.exit_code == 0, done.output
        with made.open("rb") as file:
            assert np.asarray(open_display(file)).max() == round(255 * value), options


@pytest.mark.parametrize("note", [None, {}, {"camera_exposure": None}, {"camera_exposure": "f/8"}])
def test_images_that_say_nothing_of_it_are_shown_as_they_are(note: dict[str, Any] | None) -> None:
    assert camera_exposure(note, {"iso": None}) == {}
