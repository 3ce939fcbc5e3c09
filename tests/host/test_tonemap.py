"""Tone mapping against known values and properties."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from cases import for_each

from clrender.errors import UsageError
from clrender.image.tone_map import TONE_MAPS, display_values, record_of, srgb_decode, srgb_encode, to_display


def gray(value: float, tone_map: str, exposure: float = 0.0) -> float:
    values = display_values(np.full(3, value), tone_map, exposure)
    assert np.ptp(values) < 5e-4  # grey stays grey
    return float(values[1])


@for_each(
    ("linear", "display"),
    [
        (0.0, 0.0),
        (1.0, 1.0),
        (0.0031308, 0.04045),  # where the straight part ends
        (0.002, 0.02584),
        (0.18, 0.46135612950044164),
        (0.5, 0.7353569830524495),
        (0.21404114048223255, 0.5),
    ],
)
def test_srgb_of_known_values(linear: float, display: float) -> None:
    assert float(srgb_encode(linear)) == pytest.approx(display, abs=2e-7)
    assert float(srgb_decode(display)) == pytest.approx(linear, abs=2e-7)


def test_eight_bits_survive_srgb() -> None:
    codes = np.arange(256, dtype=np.uint8)
    linear = srgb_decode(codes / 255.0)
    np.testing.assert_array_equal(to_display(np.stack([linear] * 3, -1)[None]), np.stack([codes] * 3, -1)[None])


def test_simple_operators() -> None:
    assert gray(0.3, "linear") == pytest.approx(0.3)
    assert gray(0.25, "sqrt") == pytest.approx(0.5)
    assert gray(1.0, "reinhard") == pytest.approx(float(srgb_encode(0.5)))
    assert gray(3.0, "reinhard") == pytest.approx(float(srgb_encode(0.75)))


def test_reinhard_keeps_hue() -> None:
    values = srgb_decode(display_values(np.array([2.0, 1.0, 0.5]), "reinhard"))
    assert values[0] / values[1] == pytest.approx(2.0) and values[1] / values[2] == pytest.approx(2.0)
    luminance = 2.0 * 0.2126 + 0.7152 + 0.5 * 0.0722
    assert values[1] == pytest.approx(1.0 / (1.0 + luminance))


def test_aces_of_gray_is_the_fitted_curve() -> None:
    # The rows of both matrices sum to 1 (to the five digits given), so grey sees the rational curve alone.
    for v in (0.05, 0.18, 1.0, 4.0):
        curve = (v * (v + 0.0245786) - 0.000090537) / (v * (0.983729 * v + 0.4329510) + 0.238081)
        assert srgb_decode(gray(v, "aces")) == pytest.approx(curve, abs=3e-4)
    assert gray(1e6, "aces") == pytest.approx(1.0, abs=1e-9)


def test_agx_of_gray_is_the_sigmoid() -> None:
    def sigmoid(x: float) -> float:
        return 15.5 * x**6 - 40.14 * x**5 + 31.96 * x**4 - 6.868 * x**3 + 0.4298 * x**2 + 0.1191 * x - 0.00232

    for v in (0.01, 0.18, 1.0, 10.0):
        position = min(max((math.log2(v) + 12.47393) / 16.5, 0.0), 1.0)
        assert gray(v, "agx") == pytest.approx(sigmoid(position), abs=5e-4)
    assert gray(0.0, "agx") == 0.0
    assert 0.45 < gray(0.18, "agx") < 0.55  # middle grey is about the middle


def test_agx_turns_a_strong_color_towards_white() -> None:
    strong = [display_values(np.array([0.0, 0.0, v]), "agx") for v in (0.1, 1.0, 100.0)]
    saturation = [(value.max() - value.min()) / value.max() for value in strong]
    assert saturation[0] > saturation[1] > saturation[2]


@for_each("tone_map", TONE_MAPS)
def test_operators_grow_and_stay_within_bounds(tone_map: str) -> None:
    grays = np.concatenate([[0.0], np.logspace(-8, 8, 400)])
    values = display_values(np.stack([grays] * 3, -1), tone_map)
    assert values.min() >= 0.0 and values.max() <= 1.0
    assert np.diff(values[:, 1]).min() >= -1e-4  # AgX's polynomial dips by less than that at its end


@for_each("tone_map", TONE_MAPS)
def test_what_is_no_radiance_is_still_a_color(tone_map: str) -> None:
    odd = np.array([[np.nan, -1.0, 0.0], [np.inf, 3e38, 1e30], [-np.inf, -0.0, 1e-45]], np.float32)
    image = to_display(odd[None], tone_map)
    assert image.shape == (1, 3, 3) and image.dtype == np.uint8
    assert not image[0, 0].any()


@for_each("tone_map", TONE_MAPS)
def test_exposure_counts_stops(tone_map: str) -> None:
    values = np.random.default_rng(0).random((50, 3))
    np.testing.assert_array_equal(display_values(values, tone_map, 2.0), display_values(values * 4, tone_map))
    np.testing.assert_allclose(
        display_values(values, tone_map, -0.5), display_values(values * 2**-0.5, tone_map), atol=1e-12
    )


def test_eight_bits_round_half_to_even() -> None:
    values = np.array([[[0.5, 1.5, 2.5], [2.4999, 2.5001, 254.5]]]) / 255.0
    assert to_display(values, "linear").tolist() == [[[0, 2, 2], [2, 3, 254]]]


def test_large_images_are_treated_alike_throughout() -> None:
    image = np.random.default_rng(1).random((300, 300, 3)).astype(np.float32)
    parts = [to_display(image[:150]), to_display(image[150:])]
    np.testing.assert_array_equal(to_display(image), np.concatenate(parts))


@pytest.mark.parametrize("exposure", [math.nan, math.inf, 129.0])
def test_exposures_that_are_none_are_refused(exposure: float) -> None:
    with pytest.raises(UsageError, match="exposure"):
        display_values(np.zeros(3), "srgb", exposure)


def test_an_unknown_operator_is_refused() -> None:
    with pytest.raises(UsageError, match=r"filmic.*linear, sqrt"):
        display_values(np.zeros(3), "filmic")


def test_what_is_no_tone_map_is_refused() -> None:
    wrongs: list[Any] = [123, None, b"srgb"]
    for wrong in wrongs:
        with pytest.raises(UsageError, match=r"tone_map is .*, but must be the name of a tone map; choose one of"):
            display_values(np.zeros(3), wrong)
        with pytest.raises(UsageError, match="tone_map is"):
            record_of(wrong, 0.0)
