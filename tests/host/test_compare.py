"""Comparison of images: formulas by hand, and FLIP against its properties and its authors' own program."""

from __future__ import annotations

import tracemalloc

import numpy as np
import numpy.typing as npt
import pytest

from clrender.errors import UsageError
from clrender.image.compare import compare_images
from clrender.image.flip import PIXELS_PER_DEGREE, flip_map


def flat(*color: float) -> npt.NDArray[np.float64]:
    return np.full((40, 40, 3), color, np.float64)


def picture_pair() -> tuple[npt.NDArray[np.float32], npt.NDArray[np.float32]]:
    """A reference with ramps, waves and a white square, and a noisy copy with a green square."""
    rng = np.random.default_rng(3)
    y, x = np.mgrid[0:90, 0:130]
    reference = np.stack([0.5 + 0.5 * np.sin(x / 5), y / 90, 0.5 + 0.5 * np.cos((x + y) / 9)], -1).astype(np.float32)
    reference[30:50, 40:60] = 1
    test = np.clip(reference + rng.normal(0, 0.15, reference.shape), 0, 1).astype(np.float32)
    test[60:70, 80:90] = [0, 1, 0]
    return test, reference


def test_numbers_of_two_pixels() -> None:
    image = np.array([[[1.0, 2.0, 3.0], [0.0, 0.0, 0.5]]])
    reference = np.array([[[1.0, 1.0, 1.0], [0.0, 0.5, 0.5]]])
    numbers = compare_images(image, reference)
    assert numbers["mean"] == [0.5, 1.0, 1.75] and numbers["reference_mean"] == [0.5, 0.75, 0.75]
    assert numbers["difference_of_means"] == pytest.approx((6.5 - 4.0) / 4.0)
    assert numbers["rmse"] == pytest.approx(((1 + 4 + 0.25) / 6) ** 0.5)
    assert numbers["relmse"] == pytest.approx((1 / 1.01 + 4 / 1.01 + 0.25 / 0.26) / 6)
    assert numbers["mean_relative_difference"] == pytest.approx((1 / 1.01 + 2 / 1.01 + 0.5 / 0.51) / 6)
    assert numbers["max_difference"] == 2.0
    assert not numbers["identical"]
    assert (numbers["width"], numbers["height"]) == (2, 1)


def test_an_image_is_identical_to_itself() -> None:
    image = picture_pair()[1]
    numbers = compare_images(image, image)
    zero = ("difference_of_means", "rmse", "relmse", "mean_relative_difference", "max_difference", "flip")
    assert numbers["identical"] and all(numbers[key] == 0.0 for key in zero)


def test_a_black_reference_has_no_relative_difference_of_means() -> None:
    assert compare_images(flat(1, 1, 1), flat(0, 0, 0))["difference_of_means"] is None
    assert compare_images(flat(0, 0, 0), flat(0, 0, 0))["difference_of_means"] == 0.0


@pytest.mark.parametrize(
    ("image", "words"),
    [
        (np.zeros((3, 4, 3)), "4 x 3 and 40 x 40"),
        (np.zeros((40, 40)), "height, width, 3"),
        (flat(np.nan, 0, 0), "1600 pixels that are not finite"),
        (flat(0, np.inf, 0), "not finite"),
    ],
)
def test_what_cannot_be_compared_is_refused(image: npt.NDArray[np.float64], words: str) -> None:
    with pytest.raises(UsageError, match=words):
        compare_images(image, flat(0, 0, 0))


def test_flip_is_symmetric_and_bounded() -> None:
    test, reference = picture_pair()
    forth, back = flip_map(test, reference), flip_map(reference, test)
    np.testing.assert_array_equal(forth, back)
    assert forth.min() >= 0.0 and forth.max() <= 1.0 and forth.shape == (90, 130)


def test_the_largest_difference_of_colors_is_green_and_blue() -> None:
    assert flip_map(flat(0, 1, 0), flat(0, 0, 1)) == pytest.approx(np.ones((40, 40)), abs=1e-12)


@pytest.mark.parametrize(
    ("first", "second", "mean"),
    [  # by the authors' program flip-evaluator, single precision
        ((1, 1, 1), (0, 0, 0), 0.9673994183540344),
        ((0.5, 0.5, 0.5), (0.25, 0.25, 0.25), 0.45190298557281494),
        ((1, 0, 0), (0.2, 0.2, 0.2), 0.9509199261665344),
    ],
)
def test_flip_of_flat_colors(first: tuple[float, ...], second: tuple[float, ...], mean: float) -> None:
    assert flip_map(flat(*first), flat(*second)).mean() == pytest.approx(mean, abs=1e-4)


def test_flip_of_a_picture_is_that_of_its_authors() -> None:
    test, reference = picture_pair()
    assert flip_map(test, reference).mean() == pytest.approx(0.24047212302684784, abs=1e-6)


@pytest.mark.parametrize("seed", range(4))
def test_flip_is_the_published_one_at_every_pixel(seed: int) -> None:
    # The authors' program computes in single precision, and the square root of the feature difference takes a rounding
    # of 6e-8 to 2.4e-4.
    published = pytest.importorskip("flip_evaluator", reason="flip-evaluator has a wheel for x86-64 Linux only")
    test, reference = picture_pair()
    if seed:
        rng = np.random.default_rng(seed)
        reference = rng.random((30 + 40 * seed, 150 - 40 * seed, 3), np.float32) ** np.float32(seed)
        test = np.clip(reference + rng.normal(0, 0.02 * seed, reference.shape), 0, 1).astype(np.float32)
    theirs, mean, _ = published.evaluate(reference, test, "LDR", inputsRGB=False, applyMagma=False)
    ours = flip_map(test, reference)
    np.testing.assert_allclose(ours, theirs[..., 0], atol=3e-4)
    assert ours.mean() == pytest.approx(mean, abs=1e-6)


def test_bands_of_rows_change_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    test, reference = picture_pair()
    test, reference = np.tile(test, (4, 1, 1)), np.tile(reference, (4, 1, 1))
    whole, numbers = flip_map(test, reference), compare_images(test, reference)
    monkeypatch.setattr("clrender.image.flip._BAND", 1)
    monkeypatch.setattr("clrender.image.compare._BAND", 1000)
    np.testing.assert_allclose(flip_map(test, reference), whole, atol=1e-12)
    banded = compare_images(test, reference)
    assert banded.keys() == numbers.keys()
    for name, value in numbers.items():
        assert banded[name] == pytest.approx(value, rel=1e-12), name


@pytest.mark.long
def test_comparing_takes_little_memory_beside_the_images(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("clrender.image.flip._BAND", 1 << 14)
    monkeypatch.setattr("clrender.image.compare._BAND", 1 << 14)
    image = np.zeros((2000, 500, 3), np.float32)
    tracemalloc.start()
    try:
        compare_images(image, image)
        assert tracemalloc.get_traced_memory()[1] < 3 * image.nbytes
    finally:
        tracemalloc.stop()


def test_flip_sees_less_from_further_away() -> None:
    test, reference = picture_pair()
    near, far = flip_map(test, reference), flip_map(test, reference, ppd=2 * PIXELS_PER_DEGREE)
    assert far.mean() < near.mean()


def test_flip_sees_an_edge_beyond_its_color() -> None:
    # A checkerboard too fine to see and its mean: the colour part alone would be near 0.
    y, x = np.mgrid[0:40, 0:40]
    board = np.stack([((x // 2 + y // 2) % 2) * 1.0] * 3, -1)
    assert flip_map(board, flat(0.5, 0.5, 0.5)).mean() > 0.05


def test_flip_cuts_what_a_display_cannot_show() -> None:
    np.testing.assert_array_equal(flip_map(flat(5, 2, 1), flat(1, 1, 1)), np.zeros((40, 40)))
