"""guiding/field.h: histograms are sampled with the density that they say, and points find their cells."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from clrender import layout
from clrender.guiding.field import GuidingField, cell_rows, empty_field, histogram_words, octets

if TYPE_CHECKING:
    from clrender.device import Device

KERNEL = str(Path(__file__).with_name("field_lookup.cl"))
COUNT = 1 << 18
LANES = 4


def field_of(weights: np.ndarray[tuple[int, ...], np.dtype[np.float64]]) -> GuidingField:
    nodes = empty_field(np.array([-1.0, -2.0, -3.0]), 4.0)
    numbers = np.full((len(weights), 4), 0.5)
    return GuidingField(nodes.nodes, cell_rows(histogram_words(weights), numbers), nodes.frame)


def run(device: Device, kernel: str, field: GuidingField, arguments: list[Any], results: list[Any]) -> None:
    """Run a kernel over COUNT elements; arrays become buffers, and results are read back."""
    program = device.program(KERNEL, {"LANES": LANES})
    held = [device.upload(each) for each in (field.nodes, field.cells)]
    given = [device.upload(each) if isinstance(each, np.ndarray) else each for each in arguments]
    made = [device.upload(each) for each in results]
    buffers = [*held, *(each for each in given if not isinstance(each, np.generic)), *made]
    device.launch(program, kernel, COUNT // LANES, 16, [*held, field.frame, *given, *made])
    for buffer, each in zip(made, results, strict=True):
        device.read(buffer, each)
    for buffer in buffers:
        device.release(buffer)


def solid_angles() -> np.ndarray[tuple[int, ...], np.dtype[np.float64]]:
    """Of the bins: sixteen equal heights, and in each quadrant four equal steps of y / (|x| + |y|)."""
    steps = np.linspace(0.0, 1.0, 5)
    widths = np.diff(np.arctan2(steps, 1.0 - steps))
    return np.tile(np.tile(widths, 4) * 2.0 / 16.0, 16)


@pytest.mark.parametrize("kind", ["even", "steep", "one bin"])
def test_samples_have_the_density_that_is_said(device: Device, kind: str) -> None:
    """Bins by chi squared; in each, the mean of 1 / density is its solid angle; and nothing lies elsewhere."""
    rng = np.random.default_rng(7)
    weights = np.zeros((2, layout.FIELD_BINS))
    weights[0] = 1.0
    weights[1] = 1.0 if kind == "even" else np.floor(rng.pareto(1.0, layout.FIELD_BINS) * 100.0)
    if kind == "one bin":
        weights[1] = 0.0
        weights[1, 18] = 1.0
    field = field_of(weights)
    shares = octets(field.cells[1:, 64:128])[0].astype(int)
    bits = rng.integers(0, 2**32, (2, COUNT), np.uint32)
    directions, densities = np.zeros((3, COUNT), np.float32), np.zeros(COUNT, np.float32)
    bins = np.zeros(COUNT, np.uint32)
    run(device, "sample_field", field, [np.uint32(1), np.uint32(COUNT), bits], [directions, densities, bins])
    assert np.abs(np.linalg.norm(directions.astype(float), axis=0) - 1.0).max() < 1e-6
    expected = shares / layout.FIELD_BINS * COUNT
    counted = np.bincount(bins, minlength=layout.FIELD_BINS)
    # A direction on the edge of a bin may round into its neighbour
    assert counted[shares == 0].sum() <= COUNT * 1e-5
    used = shares > 0
    chi = (np.square(counted - expected)[used] / expected[used]).sum()
    degrees = used.sum() - 1
    assert chi < degrees + 5.0 * np.sqrt(2.0 * max(degrees, 1)) + 1e-2, chi
    there = densities > 0.0
    assert (~there).sum() <= COUNT * 1e-5
    inverse = np.bincount(bins[there], 1.0 / densities[there].astype(float), layout.FIELD_BINS)[used] / COUNT
    squares = np.bincount(bins[there], 1.0 / np.square(densities[there].astype(float)), layout.FIELD_BINS)[used] / COUNT
    error = np.sqrt((squares - np.square(inverse)) / COUNT)
    assert (np.abs(inverse - solid_angles()[used]) < 5.0 * error).all()


def test_densities_are_one_over_the_sphere(device: Device) -> None:
    rng = np.random.default_rng(8)
    field = field_of(np.floor(rng.pareto(1.0, (1, layout.FIELD_BINS)) * 100.0) + 1.0)
    directions = rng.standard_normal((3, COUNT))
    directions[:, :6] = np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]]).T
    directions = (directions / np.linalg.norm(directions, axis=0)).astype(np.float32)
    densities = np.zeros(COUNT, np.float32)
    run(device, "density_of_field", field, [np.uint32(0), np.uint32(COUNT), directions], [densities])
    assert np.isfinite(densities).all()
    scaled = densities.astype(float) * 4.0 * np.pi
    assert abs(scaled.mean() - 1.0) < 5.0 * scaled.std() / np.sqrt(COUNT)


def walked(nodes: np.ndarray[Any, Any], place: np.ndarray[Any, Any], face: int) -> int:
    """The place of a point, at `place` of 0 to 1 along each axis."""
    node, place = 0, place.copy()
    while True:
        octant = (place >= 0.5).astype(int)
        place = place * 2.0 - octant
        child = int(nodes[node][int(octant @ (1, 2, 4))])
        node = child & (layout.FIELD_LEAF - 1)
        if child >= layout.FIELD_LEAF:
            return node * 8 + face


def test_points_find_their_cells(device: Device) -> None:
    """In a tree with leaves of three sizes; what is outside belongs to the cells at the sides."""
    rng = np.random.default_rng(9)
    nodes = np.full((25, 8), layout.NONE, np.uint32)
    leaf = np.uint32(layout.FIELD_LEAF)
    nodes[0] = leaf | np.arange(1, 9, dtype=np.uint32)
    nodes[0][3], nodes[3 + 1] = 4, leaf | np.arange(9, 17, dtype=np.uint32)
    nodes[4][6], nodes[15] = 15, leaf | np.arange(17, 25, dtype=np.uint32)
    low, side = np.array([-1.0, -2.0, -3.0]), 4.0
    field = GuidingField(nodes, np.zeros((1, layout.FIELD_WORDS), np.uint32), empty_field(low, side).frame)
    inside = (rng.integers(0, 256, (3, COUNT)) + 0.5) / 256.0
    points = (low[:, None] + side * inside).astype(np.float32)
    normals = rng.standard_normal((3, COUNT)).astype(np.float32)
    points[:, 0], points[:, 1] = -100.0, 100.0
    inside[:, 0], inside[:, 1] = 0.0, 0.999
    places = np.zeros(COUNT, np.uint32)
    run(device, "place_in_field", field, [np.uint32(COUNT), points, normals], [places])
    for k in range(500):
        axis = int(np.abs(normals[:, k]).argmax())
        face = 2 * axis + int(normals[axis, k] < 0.0)
        assert places[k] == walked(nodes, inside[:, k], face), k
