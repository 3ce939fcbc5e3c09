"""Where pixels look, and how far out of focus edges blur: against the analytic circle of confusion of a thin lens."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from exact import Floats, lens_share
from render_support import Studio, quad, scene, sphere
from stats_support import Evidence

SIZE = 32
HALF = math.tan(math.radians(22.5))
FOCUS = 3.0


def seen(shape: dict[str, Any], aperture: float) -> Any:
    """A light seen along -z from (0, 0, 0), 45 degrees high, in focus at distance 3."""
    camera = {
        "position": [0.0, 0.0, 0.0],
        "target": [0.0, 0.0, -1.0],
        "vertical_fov": 45.0,
        "aperture_radius": aperture,
        "focus_distance": FOCUS,
    }
    return scene([shape], camera=camera)


def half_plane(axis: int, edge: float, distance: float) -> dict[str, Any]:
    """Light where the coordinate `axis` is below `edge`, at that distance."""
    origin, u, v = [-50.0, -50.0, -distance], [100.0, 0.0, 0.0], [0.0, 100.0, 0.0]
    (u if axis == 0 else v)[axis] = edge + 50.0
    return quad(origin, u, v, emission=1.0)


def edge_profile(aperture: float, edge: float, distance: float) -> Floats:
    """Radiance of the 32 pixels across an edge: of each film position the share of the lens that sees light.

    A ray from the point l of the lens through the film's image f at FOCUS passes l (1 - k) + f k at the distance, with
    k = distance / FOCUS; the share of the disk with that below the edge, averaged over the pixel.
    """
    fine = 512
    k = distance / FOCUS
    film = ((np.arange(SIZE * fine) + 0.5) / (SIZE * fine) * 2.0 - 1.0) * HALF * FOCUS
    room = edge - film * k
    blur = aperture * abs(1.0 - k)
    value = lens_share(room / blur) if blur > 0.0 else (room > 0.0).astype(np.float64)
    profile: Floats = value.reshape(SIZE, fine).mean(axis=1)
    return profile


@pytest.mark.parametrize(
    "aperture, distance", [(0.0, 5.0), (0.2, 3.0), (0.2, 5.0), (0.2, 1.5), (0.5, 20.0)],
    ids=["pinhole", "in focus", "behind", "before", "far behind"],
)  # fmt: skip
@pytest.mark.parametrize("axis", [0, 1])
def test_edge(evidence: Evidence, studio: Studio, axis: int, aperture: float, distance: float) -> None:
    # All pixels along the edge see the same, so they are the batches; across it pixels are the columns.
    edge = 0.237 * distance * HALF
    picture = studio.gray(seen(half_plane(axis, edge, distance), aperture), SIZE, spp=256)
    # Image right is +x here, and rows run downwards.
    rows = picture if axis == 0 else picture.T[:, ::-1]
    evidence.mean_is("profile", rows, edge_profile(aperture, edge, distance), scale=1.0, rounding=2e-5)


def test_tilted_edge_in_a_wide_picture(evidence: Evidence, studio: Studio) -> None:
    # Square pixels in any format: the picture 48 x 16 is the middle of 48 x 48 with a third of its tan(fov / 2).
    camera = {"position": [1.0, 2.0, 3.0], "target": [4.0, 1.0, 5.0], "up": [0.2, 1.0, 0.1]}
    shape = sphere([4.2, 1.1, 5.1], 0.7, emission=1.0)
    wide = scene([shape], camera={**camera, "vertical_fov": 2.0 * math.degrees(math.atan(HALF / 3.0))})
    square = scene([shape], camera={**camera, "vertical_fov": 45.0})
    first = [studio.gray(wide, (48, 16), spp=16, seed=s).ravel() for s in range(16)]
    second = [studio.gray(square, (48, 48), spp=16, seed=100 + s)[16:32].ravel() for s in range(16)]
    evidence.equal("pictures", first, second)


def test_blurred_point(evidence: Evidence, studio: Studio) -> None:
    # A tiny light behind the focus is a disk of radius A (k - 1) / k at the focus, evenly bright. By area of the disk:
    # the light's solid angle is so small that what is bright is counted, ring by ring.
    aperture, distance, radius = 0.3, 6.0, 0.02
    k = distance / FOCUS
    what = seen(sphere([0.0, 0.0, -distance], radius, emission=1.0), aperture)
    picture = np.sum([studio.gray(what, 64, spp=1024, seed=seed) for seed in range(4)], axis=0)
    # Rings as wide as three pixels; each pixel spans 2 HALF FOCUS / 64 at the focus.
    place = ((np.arange(64) + 0.5) / 64.0 * 2.0 - 1.0) * HALF * FOCUS
    away = np.hypot(place[:, None], place[None, :])
    blur = aperture * (k - 1.0) / k
    pixel = 2.0 * HALF * FOCUS / 64.0
    assert not np.any(picture[away > blur + radius / k + pixel])
    inside = away < blur - radius / k - pixel
    hits = picture[inside] * 1024.0
    # Expected share of the lens: the light projected through the film point onto the lens is a disk of this radius.
    share = (radius / (k - 1.0)) ** 2 / aperture**2
    count = int(inside.sum())
    evidence.share("hits", round(float(hits.sum())), 4 * 1024 * count, share)
    middle = away[inside] < blur / 2.0
    evidence.share("hits in the inner half", round(float(hits[middle].sum())), 4 * 1024 * int(middle.sum()), share)


def test_aperture_collects_what_a_pinhole_does(evidence: Evidence, studio: Studio) -> None:
    # Radiance does not depend on the lens: an even light stays even.
    for aperture in (0.0, 0.5):
        what = seen(half_plane(0, 50.0, 4.0), aperture)
        evidence.mean_is(f"aperture {aperture}", studio.pixels(what, 16, spp=16), 1.0)
