"""Guided paths against those that are not: by fields that were trained, and by fields that know nothing true."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import pytest
from parts_support import SIZE, apart, judge, rendered
from render_support import down, lambert, quad, scene, sphere

import clrender
from clrender import layout
from clrender.bench import write_scene
from clrender.film.replicates import standard_error
from clrender.guiding.field import GuidingField, cell_rows, histogram_words

if TYPE_CHECKING:
    from clrender.device import Device

TRAINED: Final[dict[str, Any]] = {"guiding": "on", "guiding_paths": 1 << 15}
SCENES: Final = ("room", "haze", "caustic", "drink", "textures", "surfaces", "lamps", "foliage")


@pytest.fixture(scope="module")
def session(device: Device) -> Iterator[clrender.Session]:
    """One device for all tests."""
    with clrender.Session(device.info.index) as made:
        yield made


def misleading(field: GuidingField, seed: int) -> GuidingField:
    """A field of the same cells, all of whose numbers are drawn by chance."""
    rng = np.random.default_rng(seed)
    count = len(field.cells)
    weights = np.floor(rng.pareto(0.8, (count, layout.FIELD_BINS)) * 100.0) + 1.0
    shares, light = rng.choice([0.25, 0.5, 0.75], count), rng.choice([0.3, 1.0], count)
    numbers = np.column_stack([shares, rng.pareto(1.0, (count, 2)), light])
    return GuidingField(field.nodes, cell_rows(histogram_words(weights), numbers), field.frame)


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=pytest.mark.long) if name in SCENES[1:] else name for name in SCENES]
)
def test_whatever_the_field_says_the_mean_is_that_of_paths(session: clrender.Session, name: str) -> None:
    what = clrender.load(name)
    plain = rendered(session, what, 0, {"spp": 256})
    found = [("trained", apart(plain, rendered(session, what, 100, {"spp": 128, **TRAINED})))]
    field = session.render(what, size=SIZE, spp=1, **TRAINED).guiding_field
    assert field is not None and field.cell_count > 5
    plain = rendered(session, what, 0, {"spp": 256})
    for seed, settings in ((1, {}), (2, {"sampling": "light"}), (3, {"shadow_rays": 2, "indirect_rays": 2})):
        given = {"spp": 256, "guiding_field": misleading(field, seed), **settings}
        found.append((f"misleading {settings}", apart(plain, rendered(session, what, 200 * seed, given))))
    judge(found)


def test_light_samples_are_weighed_with_the_mixture(session: clrender.Session) -> None:
    """Below a ceiling that shines, which either way to sample finds as often."""
    floor = quad((-2.0, 0.0, -2.0), (0.0, 0.0, 4.0), (4.0, 0.0, 0.0), material="grey")
    lamp = quad((-2.0, 1.0, -2.0), (4.0, 0.0, 0.0), (0.0, 0.0, 4.0), material="grey", emission=1.0)
    what = scene([floor, lamp], (), down(height=0.9, degrees=60.0), grey=lambert(0.5))
    field = session.render(what, size=SIZE, spp=1, **TRAINED).guiding_field
    assert field is not None
    plain = rendered(session, what, 0, {"spp": 256, "max_depth": 2})
    asked = {"spp": 256, "max_depth": 2, "guiding_field": misleading(field, 1)}
    judge([("misleading", apart(plain, rendered(session, what, 100, asked)))])


def test_weights_do_not_grow_whatever_the_field_says(session: clrender.Session) -> None:
    """Between two plates that shine and reflect nine tenths paths are long; the bound is 20 squared means."""
    floor = quad((-50.0, 0.0, -50.0), (0.0, 0.0, 100.0), (100.0, 0.0, 0.0), material="grey", emission=1.0)
    ceiling = quad((-50.0, 1.0, -50.0), (100.0, 0.0, 0.0), (0.0, 0.0, 100.0), material="grey", emission=1.0)
    what = scene([floor, ceiling], (), down(height=0.5, degrees=60.0), grey=lambert(0.9))
    field = session.render(what, size=SIZE, spp=1, **TRAINED).guiding_field
    assert field is not None
    for seed in (1, 2, 3):
        image = session.render(
            what, size=(32, 32), spp=64, replicate_spp=1, seed=seed, guiding_field=misleading(field, seed)
        )
        assert image.film is not None
        radiance = image.linear[..., 1].astype(np.float64)
        variance = 64.0 * np.square(standard_error(image.film)[..., 1]).mean()
        assert abs(radiance.mean() - 10.0) < 0.5
        assert variance < 20.0 * 10.0**2


def test_training_finds_light_that_paths_seldom_find(session: clrender.Session, tmp_path: Path) -> None:
    """A room that is lit through a slit: what its training says, which is the same on every machine."""
    ajar = clrender.load(write_scene("X1", tmp_path))
    numbers = session.render(ajar, size=(128, 128), spp=1, guiding="auto").stats
    assert numbers["guided"] and numbers["guiding_gain"] > 1.5
    assert numbers["guiding_paths"] <= 2**19 and numbers["guiding_cells"] > 100
    assert 0 < numbers["guiding_bytes"] <= 64 << 20


def test_auto_leaves_alone_what_does_not_pay(session: clrender.Session) -> None:
    """A ball in the open: there is no light but that of the lamp."""
    lamp = {"type": "point", "position": [0, 3, 2], "intensity": [10, 10, 10]}
    alone = scene(
        [sphere((0.0, 0.0, 0.0), 1.0, material="grey")], [lamp], down(height=4.0, degrees=30.0), grey=lambert(0.5)
    )
    asked: dict[str, Any] = {"size": (32, 32), "spp": 4}
    auto = session.render(alone, guiding="auto", guiding_paths=1 << 18, **asked)
    assert not auto.stats["guided"] and auto.guiding_field is None
    assert auto.stats["image_sha256"] == session.render(alone, **asked).stats["image_sha256"]


def test_the_dark_teaches_nothing(session: clrender.Session) -> None:
    dark = scene([sphere((0.0, 0.0, 0.0), 1.0, material="grey")], (), down(height=4.0, degrees=30.0), grey=lambert(0.5))
    image = session.render(dark, size=SIZE, spp=2, guiding="on", guiding_paths=4096)
    assert not image.linear.any() and image.stats["guiding_gain"] == 1.0
