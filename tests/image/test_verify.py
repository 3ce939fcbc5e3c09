"""`verify` with the real renderer: sound files of all kinds, and every single sample that was changed."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from exact_sums import quanta
from scipy.stats import binomtest

import clrender
from clrender.device import Device
from clrender.film import Film
from clrender.film.merge import merge_films
from clrender.rendering.rendered_image import RenderedImage

SIZE = (50, 39)  # 4 x 3 tiles, cut off at two sides

CASES: dict[str, tuple[str, dict[str, Any]]] = {
    "paths": ("room", {"filter": "mitchell"}),
    "photon maps": ("room", {"integrator": "photon", "photons": 2000, "photon_radius": 0.05}),
    "light paths": ("room", {"integrator": "bdpt", "filter": "mitchell", "light_paths": 3000}),
    "guided": ("room", {"guiding": "on", "guiding_paths": 20000, "guiding_memory": 1 << 20}),
    "chains": ("room", {"specular_chains": "on"}),
    "shared light": ("room-diffuse", {"integrator": "reuse", "reuse": 4}),
    "radiosity": ("room-diffuse", {"integrator": "radiosity", "patches": 200, "patch_rays": 16}),
    "roulette": ("room", {"roulette": "constant", "termination": 0.3, "seed": 4}),
}


LONG = ("shared light", "roulette")


@pytest.mark.parametrize(
    "case", [pytest.param(case, marks=pytest.mark.long) if case in LONG else case for case in CASES]
)
def test_sound_files(device: Device, tmp_path: Path, case: str) -> None:
    scene, how = CASES[case]
    image = clrender.render(clrender.load(scene), device=device, size=SIZE, spp=3, **how)
    for name in ("a.film", "a.exr", "a.png"):
        image.save(tmp_path / name, "agx", 0.5)
        found = clrender.verify(tmp_path / name, 1.0 if name == "a.film" else 0.3, device=device)
        assert found.sound, found.faults
        assert found.checked == (12 if name == "a.film" else 4) and found.tiles == 12


def test_a_field_from_a_file_is_needed(device: Device, tmp_path: Path) -> None:
    room = clrender.load("room")
    made: dict[str, Any] = {"device": device, "size": SIZE, "spp": 2, "guiding_paths": 20000}
    field = clrender.render(room, guiding="on", **made).guiding_field
    assert field is not None
    field.save(tmp_path / "a.npy")
    image = clrender.render(room, guiding_field=tmp_path / "a.npy", **made)
    image.save(tmp_path / "a.film")
    whole = merge_films([tmp_path / "a.film"])
    for name in ("a.film", "a.png", "merged.exr"):
        if name == "merged.exr":
            RenderedImage(whole.mean(), whole.provenance, whole, False).save(tmp_path / name)
        else:
            image.save(tmp_path / name)
        with pytest.raises(clrender.UsageError, match="name it with --guiding-field"):
            clrender.verify(tmp_path / name, device=device)
        assert clrender.verify(tmp_path / name, 0.2, guiding_field=field, device=device).sound


WAYS_TO_END: tuple[dict[str, Any], ...] = (
    {"spp": 512, "time_limit": 1000.0},
    {"spp": 16, "samples": (0, 8)},
    {"spp": 320, "error": 0.9, "replicate_spp": 1},
)


@pytest.mark.parametrize("how", WAYS_TO_END, ids=str)
def test_coverage_of_other_samples_than_the_image(device: Device, tmp_path: Path, how: dict[str, Any]) -> None:
    """It has as many samples as its statistics say, in files for display of half precision, too."""
    ball = clrender.Scene(
        camera={"position": (0.0, 0.0, 3.0), "target": (0.0, 0.0, 0.0)},
        shapes=[{"type": "sphere", "radius": 0.8}],
        lights=[{"type": "environment", "radiance": (3.0, 1.0, 0.5)}],
    ).with_hidden_environment()
    image = clrender.render(ball, device=device, size=(32, 32), aov=("alpha",), **how)
    for name in ("a.exr", "a.png"):
        image.save(tmp_path / name)
        found = clrender.verify(tmp_path / name, 1.0, scene=ball, device=device)
        assert found.sound, found.faults


def test_films_of_sessions_that_refit_are_alone(device: Device, tmp_path: Path) -> None:
    """They neither merge nor are resumed or verified."""
    room = clrender.load("room")
    with clrender.Session(device, refit=True) as session:
        image = session.render(room, size=(16, 16), spp=2, checkpoint=tmp_path / "a.film")
        with pytest.raises(clrender.UsageError, match="resume in a session without refit"):
            session.render(room, size=(16, 16), spp=4, checkpoint=tmp_path / "a.film", resume=True)
    image.save(tmp_path / "b.film")
    for refused in (lambda: merge_films([tmp_path / "b.film"]), lambda: clrender.verify(tmp_path / "b.film")):
        with pytest.raises(clrender.UsageError, match="a session that refits BVHs"):
            refused()


@pytest.mark.long
def test_on_another_device(all_devices: list[Device], tmp_path: Path) -> None:
    clrender.render(clrender.load("room"), device=all_devices[0], size=SIZE, spp=2).save(tmp_path / "a.film")
    found = clrender.verify(tmp_path / "a.film", 0.2, device=all_devices[-1])
    assert found.sound and 0 < found.samples < 50 * 39 * 2


def test_a_checkpoint_in_mid_render_and_what_is_merged(device: Device, tmp_path: Path) -> None:
    """Ragged ledgers, and films whose samples begin elsewhere than at 0."""
    room = clrender.load("room")
    with clrender.Session(device) as session:
        session.render(room, size=SIZE, samples=(0, 2), spp=9, checkpoint=tmp_path / "a.film")
        session.render(room, size=SIZE, samples=(5, 9), spp=9).save(tmp_path / "b.film")
    assert clrender.verify(tmp_path / "b.film", 1.0, device=device).samples == 4 * 50 * 39
    merge_films([tmp_path / "a.film", tmp_path / "b.film"]).save(tmp_path / "c.film")
    found = clrender.verify(tmp_path / "c.film", 1.0, device=device)
    assert found.sound and found.samples == 6 * 50 * 39


def change_a_sample(film: Film, rng: np.random.Generator) -> tuple[int, int]:
    """Exchange what a sample gave one channel of a pixel for something a little else; the pixel."""
    row, column, channel = (int(rng.integers(n)) for n in (film.height, film.width, 3))
    words = film.bands()[0][row, column, channel]
    before = int(words[0]) | int(words[1]) << 64
    value = np.float32(rng.uniform(0.0, 2.0))
    other = np.nextafter(value, np.float32(9.0)) if rng.random() < 0.5 else np.float32(rng.uniform(0.0, 2.0))
    after = (before - quanta(value) + quanta(other)) % 2**128
    words[:] = after % 2**64, after >> 64
    return column, row


def find_changes(device: Device, folder: Path, changes: int) -> None:
    """Change one sample of a film, each time another one, and verify all of it."""
    path, rng = folder / "a.film", np.random.default_rng(8)
    clrender.render(clrender.load("room"), device=device, size=SIZE, spp=4).save(path)
    for _ in range(changes):
        film = Film.load(path)
        pixel = change_a_sample(film, rng)
        film.save(folder / "b.film", {"scene": {"name": "room"}})
        found = clrender.verify(folder / "b.film", 1.0, device=device)
        assert not found.sound and found.pixels == (pixel,)


def test_changed_samples_are_found(device: Device, tmp_path: Path) -> None:
    find_changes(device, tmp_path, 10)


@pytest.mark.slow
def test_a_thousand_changed_samples_are_found(device: Device, tmp_path: Path) -> None:
    find_changes(device, tmp_path, 1000)


@pytest.mark.slow
@pytest.mark.parametrize("wrong", [1, 4])
def test_a_share_finds_as_often_as_it_says(device: Device, tmp_path: Path, wrong: int) -> None:
    path = tmp_path / "a.film"
    image = clrender.render(clrender.load("room"), device=device, size=(160, 96), spp=1)  # 60 tiles
    for tile in np.random.default_rng(wrong).choice(60, wrong, replace=False).tolist():
        row, column = divmod(tile, 10)
        image.film.bands()[0][row * 16 + 3, column * 16 + 5, 1, 0] ^= np.uint64(1)
    image.film.save(path, {"scene": {"name": "room"}})
    hits, runs, stated = 0, 400, 0.0
    for _ in range(runs):
        found = clrender.verify(path, 0.25, device=device)
        stated = found.detection(wrong)
        hits += not found.sound
    print(f"{wrong} wrong of 60, 15 checked: stated {stated:.3f}, found {hits / runs:.3f}")
    assert binomtest(hits, runs, stated).pvalue > 1e-3
