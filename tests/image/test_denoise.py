"""Denoising: how much nearer to the truth it comes, what it leaves alone, and what is said when it cannot be done."""

from __future__ import annotations

import platform
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import clrender
from clrender.errors import UsageError
from clrender.film import Film
from clrender.image.compare import compare_images
from clrender.image.denoise import Denoiser
from clrender.image.files import image_sha256, read_image, read_provenance
from clrender.rendering.rendered_image import Progress

needs_library = pytest.mark.skipif(
    not (sys.platform == "linux" and platform.machine() == "x86_64"),
    reason="the test extra has no Open Image Denoise for this machine",
)
SIZE = (96, 96)


@pytest.mark.long
@needs_library
def test_a_noisy_room_comes_eight_times_nearer_to_the_truth(device: object) -> None:
    """The reference's own error is 1/64 of the noisy image's, so it can only hide some of the gain."""
    room = clrender.load("room")
    truth = clrender.render(room, size=SIZE, spp=1024, seed=1).linear
    image = clrender.render(room, size=SIZE, spp=16, denoise=True)
    assert image.denoised is not None
    before, after = (compare_images(each, truth)["relmse"] for each in (image.linear, image.denoised))
    assert before >= 8.0 * after, f"relMSE {before:.4f} became {after:.4f}"


@needs_library
def test_edges_of_albedo_and_normal_stay_sharp() -> None:
    """White noise over a step that only the albedo shows, and one that only the normal shows."""
    noise = np.random.default_rng(7).gamma(2.0, 0.5, (64, 64, 1)).astype(np.float32)
    albedo, normal = np.full((64, 64, 3), 0.2, np.float32), np.zeros((64, 64, 3), np.float32)
    albedo[:, 32:] = 0.8
    normal[:32, :, 1] = normal[32:, :, 2] = 1.0
    light = np.where(np.arange(64) < 32, 0.25, 1.0).astype(np.float32)[:, None, None]
    denoised = Denoiser()(noise * light * albedo, albedo, normal)
    expected = light * albedo
    wrong = np.abs(denoised - expected)[2:-2, 2:-2] / expected[2:-2, 2:-2]
    # With a flat albedo the second is 0.17, with a flat normal the third 0.19.
    assert wrong.mean() < 0.05 and wrong[:, 28:32].mean() < 0.1 and wrong[28:32].mean() < 0.15


@needs_library
def test_black_stays_black_and_dim_images_as_dim() -> None:
    """They were grey of 0.0013, whatever the scene."""
    flat, normal = np.full((32, 32, 3), 0.5, np.float32), np.zeros((32, 32, 3), np.float32)
    denoiser = Denoiser()
    assert not denoiser(np.zeros((32, 32, 3)), flat, normal).any()
    noise = np.random.default_rng(3).gamma(2.0, 0.5, (32, 32, 1)).astype(np.float32) * flat
    usual = denoiser(noise, flat, normal).mean()
    for exponent in (-14, -27, -40, -110):
        dim = denoiser(np.ldexp(noise, exponent), flat, normal)
        assert np.ldexp(dim.mean(), -exponent) == pytest.approx(usual, rel=0.02)


@needs_library
def test_coverage_and_colours_stay_together_at_edges() -> None:
    """Over any background the edges are those of the coverage, and beyond them is nothing."""
    random = np.random.default_rng(5)
    rows, columns = np.mgrid[:48, :48] - 23.5
    coverage = np.clip(18.0 - np.hypot(rows, columns), 0.0, 1.0)
    coverage = (random.binomial(4, coverage) / 4.0).astype(np.float32)
    share = coverage[..., None]
    noise = random.gamma(4.0, 0.25, (48, 48, 1))
    image = np.array([0.7, 0.4, 0.2], np.float32) * noise * share
    albedo, normal = 0.7 * share * np.ones(3), share * np.array([0.0, 0.0, 1.0], np.float32)
    image[0, 0] = 0.25  # glows without covering anything
    denoised = Denoiser()(image, albedo, normal, coverage)
    edge = (coverage > 0.0) & (coverage < 1.0)
    colors = denoised[edge] / coverage[edge][:, None]
    np.testing.assert_allclose(colors.mean(axis=0), [0.7, 0.4, 0.2], rtol=0.05)
    before = image[edge] / coverage[edge][:, None]
    # 0.44 times; 0.89 without the coverage
    assert (colors / [0.7, 0.4, 0.2]).std() < 0.6 * (before / [0.7, 0.4, 0.2]).std()
    assert (denoised[0, 0] == 0.25).all()
    denoised[0, 0] = 0.0
    assert not denoised[coverage == 0.0].any()


@needs_library
def test_images_with_alpha_are_denoised_by_it_where_nothing_is_behind(device: object) -> None:
    ball: dict[str, Any] = {
        "camera": {"position": [0, 0, 4], "target": [0, 0, 0], "vertical_fov": 40.0},
        "materials": {"white": {"type": "lambert", "reflectance": [0.8, 0.4, 0.2]}},
        "shapes": [{"type": "sphere", "radius": 1.0, "material": "white"}],
        "lights": [{"type": "environment", "radiance": [1, 1, 1]}],
    }
    scene = clrender.Scene(**ball)
    how: dict[str, Any] = {"size": (32, 32), "spp": 4, "denoise": True, "aov": "alpha"}
    hidden = clrender.render(scene.with_hidden_environment(), **how)
    alpha, denoised = hidden.alpha, hidden.denoised
    assert alpha is not None
    assert denoised is not None
    edge = (alpha > 0.0) & (alpha < 1.0)
    np.testing.assert_allclose(
        denoised[edge] / alpha[edge][:, None], hidden.linear[edge] / alpha[edge][:, None], rtol=0.2
    )
    assert not denoised[alpha == 0.0].any()
    seen = clrender.render(scene, **how)
    assert seen.denoised is not None
    assert (seen.denoised[alpha == 0.0] > 0.8).all()


@needs_library
def test_what_is_denoised_and_what_is_not(device: object, tmp_path: Path) -> None:
    room = clrender.load("room")
    plain = clrender.render(room, size=(32, 20), spp=2)
    image = clrender.render(room, size=(32, 20), spp=2, denoise=True)
    assert plain.denoised is None and not plain.stats["denoised"] and "denoiser" not in plain.stats
    assert image.denoised is not None and image.denoised.shape == image.linear.shape
    assert (image.linear == plain.linear).all() and image.stats["image_sha256"] == plain.stats["image_sha256"]
    assert image.stats["denoised"] and image.stats["denoiser"].startswith("Open Image Denoise 2.")
    assert image.stats["denoised_sha256"] == image_sha256(image.denoised) != image.stats["image_sha256"]
    for ending in (".npy", ".exr", ".png", ".film"):
        image.save(tmp_path / f"a{ending}")
    assert (read_image(tmp_path / "a.npy") == image.denoised).all()
    assert (read_image(tmp_path / "a.exr") == image.denoised).all()
    assert (read_provenance(tmp_path / "a.png") or {})["denoised"]
    film = Film.load(tmp_path / "a.film")
    assert (film.mean() == image.linear).all()
    assert film.provenance["denoised"] is False and "denoiser" not in film.provenance


@needs_library
def test_an_image_stopped_early_is_denoised(device: object) -> None:
    done: list[Progress] = []
    room = clrender.load("room")
    image = clrender.render(
        room, size=SIZE, spp=4096, denoise=True, on_progress=done.append, should_stop=lambda: len(done) > 2
    )
    assert image.interrupted and image.denoised is not None and image.denoised.mean() > 0.1


def test_without_the_extra_it_is_said_before_anything_is_rendered(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pyoidn", None)
    monkeypatch.setattr("clrender.rendering.residency.select", lambda *_, **__: pytest.fail("a device was looked for"))
    with pytest.raises(UsageError, match=r"is not installed; install it with `.*pip install 'pyoidn[^']*'`"):
        clrender.render(clrender.load("room"), denoise=True)
