"""An image as it shows itself in a notebook: pictures of known layers, numbers, and a size that a notebook bears."""

from __future__ import annotations

import base64
import io
import re
from typing import Any

import numpy as np
import numpy.typing as npt
from cases import for_each
from PIL import Image

from clrender.film import Film
from clrender.image.files import png_bytes
from clrender.rendering.image_html import IMAGE_SIDE, LAYER_SIDE, shrunk
from clrender.rendering.rendered_image import RenderedImage

_Array = npt.NDArray[np.float32]


def image_of(linear: _Array, **more: Any) -> RenderedImage:
    height, width, _ = linear.shape
    stats = {"width": width, "height": height, "samples": 16 * width * height, "image_sha256": "ab" * 32}
    return RenderedImage(linear, {**stats, **more.pop("stats", {})}, Film(width, height), False, **more)


def pictures(html: str) -> list[npt.NDArray[np.uint8]]:
    data = [base64.b64decode(each) for each in re.findall(r'src="data:image/\w+;base64,([^"]+)"', html)]
    return [np.asarray(Image.open(io.BytesIO(each)).convert("RGB")) for each in data]


def grey(height: int, width: int, value: float = 0.2) -> _Array:
    return np.full((height, width, 3), value, np.float32)


def test_an_image_alone_has_no_buttons() -> None:
    html = image_of(grey(40, 60))._repr_html_()
    assert "<input" not in html
    assert "60 × 40 pixels" in html
    assert "16" in re.findall(r"Samples per pixel</th><td>(.*?)</td>", html)
    assert "ab" * 32 in html
    (picture,) = pictures(html)
    assert picture.shape == (40, 60, 3)
    assert np.abs(picture.astype(int) - 124).max() <= 1  # 0.2 as sRGB


def test_layers_are_chosen_by_buttons_and_are_the_colours_they_say() -> None:
    normal = np.zeros((8, 8, 3), np.float32)
    normal[:, 4:, 0], normal[:, :4, 1] = 1.0, -1.0
    depth = np.full((8, 8, 1), 2.0, np.float32)
    depth[0], depth[7] = np.inf, 6.0
    object_ = np.repeat(np.array([-1, 3], np.float32), 4)[None, :, None].repeat(8, axis=0)
    layers = {"normal": normal, "depth": depth, "object": object_, "stderr": np.full((8, 8, 3), np.nan, np.float32)}
    html = image_of(grey(8, 8), aovs=layers, denoised=grey(8, 8, 0.5))._repr_html_()
    labels = re.findall(r"<label [^>]*>(.*?)</label>", html)
    assert labels == ["Denoised", "Before denoising", "normal", "depth", "object", "stderr"]
    assert html.count(" checked>") == 1
    denoised, noisy, of_normal, of_depth, of_object, unknown = pictures(html)
    assert denoised[0, 0, 0] > noisy[0, 0, 0]
    assert np.abs(of_normal[4, 7].astype(int) - [255, 128, 128]).max() <= 3
    assert np.abs(of_normal[4, 0].astype(int) - [128, 0, 128]).max() <= 3
    assert (of_depth[7] > 250).all() and (of_depth[0] < 5).all() and (of_depth[3] < 5).all()
    assert "distance from 2 (black) to 6 m (white)" in html
    assert (of_object[:, :4] == 0).all() and (of_object[:, 4:] >= 64).all()
    assert "no finite value" in html and not unknown.any()


def test_colours_tell_names_of_mattes_apart() -> None:
    layer = np.zeros((2, 3, 12), np.float32)
    layer[0, :, 0] = np.array([0x3F800000, 0x3F800001, 0], np.uint32).view(np.float32)
    layer[0, :2, 1] = 1.0
    shown = pictures(image_of(grey(2, 3), aovs={"crypto_object": layer})._repr_html_())[1]
    assert len({tuple(pixel) for pixel in shown[0].tolist()}) == 3
    assert not shown[1].any() and not shown[0, 2].any()


@for_each("key", ["albedo", "emission", "tangent", "position", "uv", "samples", "unconverged", "material"])
def test_every_layer_has_a_picture(key: str) -> None:
    channels = {"uv": 2, "samples": 1, "unconverged": 1, "material": 1}.get(key, 3)
    layer = np.linspace(0.0, 1.0, 20 * 30 * channels, dtype=np.float32).reshape(20, 30, channels)
    shown = pictures(image_of(grey(20, 30), aovs={key: layer})._repr_html_())[1]
    assert shown.shape == (20, 30, 3)
    assert shown.std() > 1.0


def test_it_stays_small_and_says_so() -> None:
    noise = np.random.default_rng(1).gamma(0.5, 0.5, (1400, 2600, 3)).astype(np.float32)
    image = image_of(noise, aovs={"albedo": noise, "material": np.floor(noise[..., :1] * 9)})
    html = image._repr_html_()
    assert "866 × 466 of 2600 × 1400 pixels" in html
    assert [
        max(each.shape) <= side for each, side in zip(pictures(html), (IMAGE_SIDE, LAYER_SIDE, LAYER_SIDE), strict=True)
    ]
    assert len(html) < 3_000_000
    assert max(Image.open(io.BytesIO(image._repr_png_())).size) <= IMAGE_SIDE


def test_a_small_image_is_its_own_png() -> None:
    linear = np.random.default_rng(2).random((30, 50, 3), np.float32)
    assert image_of(linear)._repr_png_() == png_bytes(linear)


def test_shrinking_takes_means_of_squares() -> None:
    linear = np.random.default_rng(3).random((60, 90, 3), np.float32)
    small = shrunk(linear, 30)
    assert small.shape == (20, 30, 3)
    np.testing.assert_allclose(small[4, 7], linear[12:15, 21:24].mean(axis=(0, 1)), rtol=1e-6)
    assert shrunk(linear, 90) is linear
    assert shrunk(np.ones((1, 5000, 3), np.float32), 100).shape[0] == 1


def test_nothing_of_it_comes_from_elsewhere_or_runs() -> None:
    html = image_of(grey(4, 4), stats={"devices": [{"name": "<script>alert(1)</script>"}]})._repr_html_()
    assert "<script" not in html and "http" not in html
    assert "&lt;script&gt;" in html


def test_two_images_of_a_notebook_do_not_share_buttons() -> None:
    layers = {"albedo": grey(4, 4)}
    names = [
        re.findall(r'<div class="clrender-image" id="(.*?)"', image_of(grey(4, 4), aovs=layers)._repr_html_())
        for _ in range(2)
    ]
    assert names[0] != names[1]
