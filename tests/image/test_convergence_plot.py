"""The plot of convergence: the errors it tells are those of the images, and it shows itself."""

from __future__ import annotations

import re
import sys
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import clrender
from clrender.device import Device
from clrender.errors import UsageError
from clrender.image.compare import compare_images
from clrender.image.tone_map import LUMINANCE
from clrender.rendering.convergence_plot import ConvergencePlot
from clrender.rendering.rendered_image import Progress, RenderedImage

SIZE = (40, 30)


def rendered(device: Device, plot: Callable[[Progress], None], **settings: Any) -> RenderedImage:
    return clrender.render(clrender.load("cornell"), device=device, size=SIZE, on_progress=plot, **settings)


def luminance(pixels: Any) -> np.ndarray[Any, np.dtype[np.float64]]:
    found: np.ndarray[Any, np.dtype[np.float64]] = np.asarray(pixels, np.float64) @ np.asarray(LUMINANCE)
    return found


@pytest.fixture(scope="module")
def truth(device: Device) -> RenderedImage:
    return rendered(device, ConvergencePlot(), spp=2048, seed=9)


def test_errors_by_replicates_are_those_of_the_image_and_hold(device: Device, truth: RenderedImage) -> None:
    plot = ConvergencePlot()
    image = rendered(device, plot, spp=256, replicate_spp=16, aov=("stderr",))
    last = plot.points[-1]
    assert last.samples == 256
    told = luminance(image.aovs["stderr"])
    assert last.error == pytest.approx(np.sqrt(np.mean(told**2)) / luminance(image.linear).mean(), rel=1e-4)
    distance = np.sqrt(np.mean(luminance(image.linear - truth.linear) ** 2)) / luminance(truth.linear).mean()
    assert 0.6 < last.error / distance < 1.6  # 16 replicates know it to 18 % in each of 1200 pixels
    samples = [point.samples for point in plot.points]
    assert samples == sorted(set(samples))
    assert all(np.diff([point.seconds for point in plot.points]) >= 0.0)


def test_errors_by_a_reference_are_distances_from_it(device: Device, truth: RenderedImage) -> None:
    plot = ConvergencePlot(truth)
    image = rendered(device, plot, spp=64)
    distance = np.sqrt(np.mean(luminance(image.linear - truth.linear) ** 2)) / luminance(truth.linear).mean()
    assert plot.points[-1].samples == 64
    assert plot.points[-1].error == pytest.approx(distance, rel=1e-5)
    rendered(device, plot, spp=16, seed=1)  # another render begins another plot
    assert [point.samples for point in plot.points][-1] == 16


def test_without_either_it_tells_samples_over_time(device: Device) -> None:
    plot = ConvergencePlot(live=True)  # outside of a notebook nothing is shown, and nothing breaks
    rendered(device, plot, spp=16)
    assert [point.error for point in plot.points] == [None] * len(plot.points)
    drawn = plot._repr_html_()
    assert "samples per pixel" in drawn and "relative error" not in drawn


def test_it_is_drawn_or_said_what_is_missing(device: Device, monkeypatch: pytest.MonkeyPatch) -> None:
    plot = ConvergencePlot()
    assert "on_progress" in plot._repr_html_()
    with pytest.raises(UsageError, match="nothing to plot yet"):
        plot.svg()
    rendered(device, plot, spp=64, replicate_spp=16)
    svg = plot.svg()
    assert svg.startswith("<svg") and "relative error (RMS)" in svg and "1 / √samples" in svg
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    html = plot._repr_html_()
    assert "pip install" in html and "<table>" in html and "<td>64</td>" in html


def test_a_reference_that_does_not_fit_is_refused(device: Device) -> None:
    with pytest.raises(UsageError, match=r"the reference has 7 x 5 pixels, but the image 40 x 30"):
        rendered(device, ConvergencePlot(np.ones((5, 7, 3))), spp=1)
    for wrong in (np.ones((5, 7)), np.full((5, 7, 3), np.nan), np.ones((0, 7, 3))):
        with pytest.raises(UsageError, match=r"must be \(height, width, 3\) of finite numbers"):
            ConvergencePlot(wrong)


@pytest.mark.parametrize("integrator", ["path", "bdpt", "photon"])
def test_runs_of_several_integrators_end_at_the_errors_of_their_images(
    device: Device, truth: RenderedImage, integrator: str
) -> None:
    plot = ConvergencePlot(truth, metric="relmse")
    image = rendered(device, plot.run(integrator), spp=8, integrator=integrator)
    (last,) = [points[-1] for points in plot.runs.values()]
    assert list(plot.runs) == [integrator] and last.samples == 8 and plot.points[-1] == last
    assert last.error == pytest.approx(compare_images(image.linear, truth.linear)["relmse"], rel=1e-5)


def test_runs_are_told_apart_and_replaced_by_their_names(device: Device, truth: RenderedImage) -> None:
    plot = ConvergencePlot(truth)
    for name, seed in (("first", 0), ("second", 1), ("first", 2)):
        image = rendered(device, plot.run(name), spp=16, seed=seed)
    assert list(plot.runs) == ["first", "second"]
    distance = np.sqrt(np.mean(luminance(image.linear - truth.linear) ** 2)) / luminance(truth.linear).mean()
    assert plot.runs["first"][-1].error == pytest.approx(distance, rel=1e-5)
    svg, shown = plot.svg(), repr(plot)
    dashes = set(re.findall(r"stroke-dasharray: ([\d., ]+)", svg))
    assert len(dashes) >= 2  # that of the second run and that of the slope
    for name in ("first", "second"):
        assert f">{name}</text>" in svg and f"{name}: " in plot.description and f"{name}: " in shown
    assert "<desc id=" in svg and plot.description in svg
    assert plot._repr_html_().count("<td>second</td>") == len(plot.runs["second"])


def test_finished_images_are_points(device: Device, truth: RenderedImage) -> None:
    plot, own = ConvergencePlot(truth), ConvergencePlot()
    images = [rendered(device, ConvergencePlot(), spp=spp, aov=("stderr",)) for spp in (128, 32)]
    plot.add("path", images)
    own.add("path", images[0])
    own.add("path", images[1])
    for each in (plot, own):
        assert [point.samples for point in each.points] == [32, 128]
        assert [point.seconds for point in each.points] == [image.stats["render_seconds"] for image in images[::-1]]
    distance = np.sqrt(np.mean(luminance(images[0].linear - truth.linear) ** 2)) / luminance(truth.linear).mean()
    assert plot.points[-1].error == pytest.approx(distance, rel=1e-5)
    told = np.sqrt(np.mean(luminance(images[0].aovs["stderr"]) ** 2)) / luminance(images[0].linear).mean()
    assert own.points[-1].error == pytest.approx(told, rel=1e-5)
    bare = ConvergencePlot()
    bare.add("path", [rendered(device, ConvergencePlot(), spp=4)])
    assert [point.error for point in bare.points] == [None] and "per pixel over time" in bare.svg()
    with pytest.raises(UsageError, match=r"the reference has 7 x 5 pixels, but the image 40 x 30"):
        ConvergencePlot(np.ones((5, 7, 3))).add("path", images)


def test_its_labels_are_plain_numbers(device: Device, truth: RenderedImage) -> None:
    plot = ConvergencePlot(truth)
    images = [rendered(device, ConvergencePlot(), spp=spp) for spp in (1, 16, 256)]
    plot.add("path", images)
    labels = re.findall(r"<text[^>]*>([^<]+)</text>", plot.svg())
    assert {"1", "10", "100"} <= set(labels) and [each for each in labels if each.endswith(" %")]
    assert not [each for each in labels if re.search(r"\de[-+]?\d|10\^|mathdefault", each)]


def test_a_metric_that_does_not_exist_is_refused() -> None:
    with pytest.raises(UsageError, match="the metric is 'mse', but must be rms or relmse"):
        ConvergencePlot(metric="mse")  # type: ignore[arg-type]
