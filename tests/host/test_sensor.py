"""The sensor: Poisson's law by chi-squared tests, means and variances of what it records, and fixed bits."""

from __future__ import annotations

import hashlib
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt
import pytest
from scipy.stats import chi2, kstest
from scipy.stats import poisson as law

from clrender.errors import UsageError
from clrender.exact.counters import key_of, philox, units
from clrender.image.deep_png import deep_png_bytes
from clrender.image.exact_display import display_bytes, srgb_bytes
from clrender.image.tone_map import to_display
from clrender.sensor import Sensor
from clrender.sensor.bayer import PATTERNS, demosaiced, filter_colors
from clrender.sensor.noise import normal, poisson

ALARM = 1e-6
"""Chance that a correct sensor fails a test of its law; bits are fixed, so it either always passes or never."""


def uniforms(key: int) -> Any:
    def given(pixels: npt.NDArray[np.int64], attempt: int) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
        return units(philox(key, (pixels, 0, attempt, 0)))

    return given


@pytest.mark.parametrize("mean", [1e-3, 0.3, 3.0, 9.99, 10.0, 11.5, 25.0, 400.0, 3e4, 1e7])
def test_numbers_have_poissons_law(mean: float) -> None:
    count = 1 << 17
    found = poisson(np.full(count, mean), uniforms(key_of(2, str(mean))))
    edges = np.unique(law.ppf(np.linspace(0.0, 1.0, 65)[1:-1], mean))
    expected = count * np.diff(np.concatenate([[0.0], law.cdf(edges, mean), [1.0]]))
    seen = np.bincount(np.searchsorted(edges, found), minlength=len(edges) + 1)
    keep = expected > 5.0
    seen, expected = np.append(seen[keep], seen[~keep].sum()), np.append(expected[keep], expected[~keep].sum() + 1e-9)
    keep = expected > 1.0
    statistic = float((np.square(seen - expected)[keep] / expected[keep]).sum())
    assert chi2.sf(statistic, max(1, int(keep.sum()) - 1)) > ALARM
    assert abs(found.mean() - mean) < 5.0 * np.sqrt(mean / count)
    # The variance of a sample variance: (kurtosis + 2) variance^2 / n, and the excess kurtosis is 1 / mean
    assert abs(found.var() - mean) < 5.0 * mean * np.sqrt((2.0 + 1.0 / mean) / count)


def test_no_light_and_many_means() -> None:
    means = np.array([0.0, 5.0, 50.0, 0.0, 1e6])
    found = poisson(np.tile(means, 100), uniforms(1)).reshape(100, 5)
    assert (found[:, [0, 3]] == 0).all() and (np.abs(found.mean(axis=0) - means) <= 5.0 * np.sqrt(means / 100)).all()


def test_normal_numbers() -> None:
    found = normal(np.arange(1 << 17), uniforms(9))
    assert kstest(found, "norm").pvalue > ALARM
    assert abs(found.mean()) < 5.0 / np.sqrt(len(found)) and abs(found.var() - 1.0) < 5.0 * np.sqrt(2.0 / len(found))


def test_what_is_recorded() -> None:
    """Mean and variance of photon transfer: gain x electrons, gain^2 x (electrons + read noise^2) + 1/12."""
    sensor = Sensor(full_well=5000.0, exposure=-1.0, read_noise=6.0, bits=14, black_level=300, gain=2.0)
    light = np.broadcast_to(np.array([0.02, 0.2, 0.8], np.float32), (200, 300, 3))
    found = sensor.raw(light, seed=4).astype(np.float64)
    for channel, radiance in enumerate((0.02, 0.2, 0.8)):
        electrons, count = 2500.0 * float(np.float32(radiance)), 60000
        variance = 4.0 * (electrons + 36.0) + 1.0 / 12.0
        assert abs(found[..., channel].mean() - (300.0 + 2.0 * electrons)) < 5.0 * np.sqrt(variance / count)
        assert abs(found[..., channel].var() - variance) < 5.0 * variance * np.sqrt(2.2 / count)
    flat = found.reshape(-1, 3)
    assert np.abs(np.corrcoef(flat.T) - np.eye(3)).max() < 5.0 / np.sqrt(len(flat)), "channels are independent"
    ahead = np.corrcoef(flat[:-1, 1], flat[1:, 1])[0, 1]
    assert abs(ahead) < 5.0 / np.sqrt(len(flat)), "and so are neighbours"


def test_without_noise_it_is_linear_and_clips() -> None:
    sensor = Sensor(full_well=1000.0, read_noise=0.0, shot_noise=False, bits=10, black_level=23)
    ramp = np.linspace(-0.5, 1.5, 401, dtype=np.float32)
    found = sensor.raw(np.repeat(ramp[None, :, None], 3, axis=2))
    np.testing.assert_array_equal(found[0, :, 1], np.rint(23 + 1000 * np.clip(ramp.astype(np.float64), 0, 1)))
    assert found.max() == 1023 and found.min() == 23 and found.dtype == np.uint16
    dim = Sensor(full_well=1000.0, read_noise=0.0, shot_noise=False, bits=10, black_level=23, exposure=-2.0)
    assert dim.raw(np.ones((1, 1, 3)))[0, 0, 0] == 273
    assert (
        sensor.raw(np.full((1, 1, 3), np.nan))[0, 0, 0] == 23 and sensor.raw(np.full((1, 1, 3), np.inf)).max() == 1023
    )


def test_dark_pixels_show_the_read_noise() -> None:
    sensor = Sensor(read_noise=3.0, bits=12, black_level=64, gain=1.0)
    found = sensor.raw(np.zeros((100, 100, 3)))
    assert abs(found.astype(float).std() - np.sqrt(9.0 + 1.0 / 12.0)) < 0.1 and abs(found.mean() - 64.0) < 0.1
    assert (Sensor(read_noise=3.0, gain=1.0).raw(np.zeros((100, 100, 3))) == 0).mean() > 0.5, "there is nothing below 0"


def test_noise_is_a_function_of_seed_and_index(monkeypatch: pytest.MonkeyPatch) -> None:
    sensor, light = Sensor(), np.random.default_rng(1).random((37, 41, 3)).astype(np.float32)
    first = sensor.raw(light, 5, 7)
    np.testing.assert_array_equal(sensor.raw(light, 5, 7), first)
    assert (sensor.raw(light, 6, 7) != first).mean() > 0.5 and (sensor.raw(light, 5, 8) != first).mean() > 0.5
    monkeypatch.setattr("clrender.sensor.sensor._CHUNK", 100)
    np.testing.assert_array_equal(sensor.raw(light, 5, 7), first)


def test_its_bits_are_these() -> None:
    """On every machine."""
    y, x = np.mgrid[0:16, 0:24]
    light = np.stack([x / 24.0, y / 16.0, (x + y) / 400.0], axis=2).astype(np.float32)
    shown = [
        Sensor(bayer="grbg", exposure=0.3, read_noise=4.5).image(light, 11, 3),
        Sensor(full_well=30.0, bits=8).image(light),
        Sensor(encoding="srgb", black_level=100).image(light, 1, 1),
    ]
    digest = hashlib.sha256(b"".join(each.tobytes() for each in shown)).hexdigest()
    assert digest == "43ba2356ca4cb383fe2f7f7c1d5e877fadadaf70d5b72f8e6b6bc779e5041670"


@pytest.mark.parametrize("pattern", PATTERNS)
def test_mosaics(pattern: str) -> None:
    colors = filter_colors(pattern, 6, 7)
    assert "".join("rgb"[c] for c in colors[:2, :2].reshape(-1)) == pattern
    flat = np.broadcast_to(np.array([100, 200, 300]), (6, 7, 3))
    mosaic = np.take_along_axis(flat, colors[..., None], axis=2)[..., 0]
    np.testing.assert_array_equal(demosaiced(mosaic, pattern), flat)
    # Of a ramp, interpolation is exact away from the edges
    ramp = np.add.outer(8 * np.arange(6), 4 * np.arange(7))
    np.testing.assert_array_equal(demosaiced(ramp, pattern)[1:-1, 1:-1], np.repeat(ramp[1:-1, 1:-1, None], 3, axis=2))
    sensor = Sensor(bayer=pattern, shot_noise=False, read_noise=0.0)
    light = np.random.default_rng(3).random((6, 7, 3)).astype(np.float32)
    raw = sensor.raw(light)
    chosen = np.take_along_axis(light, colors[..., None], axis=2)[..., 0]
    assert raw.shape == (6, 7)
    np.testing.assert_array_equal(raw, np.rint(4095 / 20000 * (20000.0 * chosen.astype(np.float64))))
    np.testing.assert_array_equal(sensor.image(light), demosaiced(raw, pattern))
    plain = Sensor(bayer=pattern, demosaic=False, shot_noise=False, read_noise=0.0)
    np.testing.assert_array_equal(plain.image(light), raw)


def test_demosaicing_is_that_of_opencv_inside() -> None:
    raw = np.random.default_rng(2).integers(0, 4096, (20, 30)).astype(np.uint16)
    ours = demosaiced(raw, "rggb")[1:-1, 1:-1]
    theirs = cv2.cvtColor(raw, cv2.COLOR_BayerRGGB2RGB)[1:-1, 1:-1]
    assert np.abs(ours - theirs.astype(np.int64)).max() <= 1, "but for the rounding of halves"


def test_display_values() -> None:
    light = np.random.default_rng(5).gamma(0.5, 1.0, (50, 60, 3)).astype(np.float32)
    light[0, 0] = (np.nan, np.inf, -1.0)
    for exposure in (0.0, 1.3, -2.25):
        np.testing.assert_array_equal(display_bytes(light, exposure), to_display(light, "srgb", exposure))
    np.testing.assert_array_equal(srgb_bytes(np.array([0.0, 1.0, 0.5, np.nan])), [0, 255, 188, 0])
    assert Sensor(encoding="srgb", shot_noise=False, read_noise=0.0).image(np.full((2, 2, 3), 0.6))[0, 0, 0] == 203


@pytest.mark.parametrize("shape", [(5, 7), (5, 7, 3), (1, 1), (64, 3, 3)])
def test_deep_png_files(shape: tuple[int, ...]) -> None:
    pixels = np.random.default_rng(1).integers(0, 65536, shape).astype(np.uint16)
    found = cv2.imdecode(np.frombuffer(deep_png_bytes(pixels), np.uint8), cv2.IMREAD_UNCHANGED)
    assert found is not None and found.dtype == np.uint16
    np.testing.assert_array_equal(found[..., ::-1] if len(shape) == 3 else found, pixels)


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"bits": 17}, "bits is 17"),
        ({"full_well": 0}, "full_well is 0"),
        ({"bayer": "rgbg"}, "bayer is"),
        ({"encoding": "gamma"}, "encoding is"),
        ({"gain": 0.0}, "gain is 0.0"),
        ({"shot_noise": "no"}, "shot_noise is .*no.*, but must be true or false"),
        ({"demosaic": 3}, "demosaic is 3, but must be true or false"),
        ({"black_level": 4095}, "black_level is 4095, but must be below 4095"),
    ],
)
def test_what_is_refused(given: dict[str, Any], words: str) -> None:
    with pytest.raises(UsageError, match=words):
        Sensor(**given)


@pytest.mark.filterwarnings("error")
def test_what_is_no_radiance_is_recorded() -> None:
    sensor = Sensor(read_noise=0.0, shot_noise=np.False_, black_level=10)  # type: ignore[arg-type]
    image = np.array([-np.inf, np.nan, -1.0, np.inf], np.float32)[:, None, None] * np.ones((1, 1, 3), np.float32)
    np.testing.assert_array_equal(sensor.raw(image)[:, 0, 0], [10, 10, 10, sensor.largest])


def test_images_that_are_none() -> None:
    with pytest.raises(UsageError, match=r"linear has the shape \(4, 4\)"):
        Sensor().raw(np.zeros((4, 4)))
    with pytest.raises(UsageError, match="index is -1"):
        Sensor().raw(np.zeros((4, 4, 3)), 0, -1)
    with pytest.raises(UsageError, match="no mosaic"):
        Sensor(bayer="rggb").raw(np.zeros((1, 4, 3)))
