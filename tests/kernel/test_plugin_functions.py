"""The functions that the host makes of plugins, against formulas, and with the same bits in any number of lanes."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt
import pytest
from kernel_support import FOLDER
from plugin_files import PAPER, example

from clrender.plugins import Plugin, kernel_files, plugin

if TYPE_CHECKING:
    from clrender.device import Device

Floats = npt.NDArray[np.float64]
COUNT = 4096
PLUGINS = (example("ashikhmin_shirley"), example("minnaert"), plugin(PAPER), example("wood"))
"""In the order of their numbers."""


def launched(device: Device, kernel: str, number: int, points: Floats, numbers: list[float], lanes: int) -> Floats:
    padded = np.zeros(16, np.float32)
    padded[: len(numbers)] = numbers
    outputs = 10 if kernel == "plugin_bsdf" else 3
    buffers = [device.upload(padded), device.upload(np.ascontiguousarray(points, np.float32))]
    results, out = device.empty(4 * outputs * COUNT), np.empty((outputs, COUNT), np.float32)
    program = device.program(FOLDER / "plugin_functions.cl", {"LANES": lanes, **kernel_files(PLUGINS)})
    arguments: list[Any] = [*buffers, np.uint32(number), np.uint32(COUNT), results]
    device.launch(program, kernel, COUNT // lanes, 16, arguments)
    device.read(results, out)
    for buffer in (*buffers, results):
        device.release(buffer)
    return out.astype(np.float64)


def points() -> Floats:
    """wo and wi above the surface, and three random numbers."""
    rng = np.random.default_rng(9)

    def hemisphere() -> Floats:
        z, turn = rng.random(COUNT), rng.random(COUNT) * 2.0 * math.pi
        r = np.sqrt(1.0 - z * z)
        return np.array([r * np.cos(turn), r * np.sin(turn), np.maximum(z, 1e-3)])

    given = np.concatenate([hemisphere(), hemisphere(), rng.random((3, COUNT))])
    return given.astype(np.float32).astype(np.float64)


def numbers_of(each: Plugin) -> list[float]:
    return [number for parameter in each.parameters for number in parameter.default]


def test_minnaert(device: Device) -> None:
    given = points()
    found = launched(device, "plugin_bsdf", 2, given, [0.6, 0.5, 0.4, 2.5], 1 if not device.is_cpu else 8)
    mu_o, mu_i = given[2], given[5]
    f = 3.5 / (2.0 * math.pi) * (mu_o * mu_i) ** 1.5
    np.testing.assert_allclose(found[:3], np.array([[0.6], [0.5], [0.4]]) * f, rtol=3e-5)
    np.testing.assert_allclose(found[3], 3.5 / (2.0 * math.pi) * mu_i**2.5, rtol=3e-5)
    np.testing.assert_allclose(found[6], given[6] ** (1.0 / 3.5), rtol=3e-5)
    np.testing.assert_allclose(np.linalg.norm(found[4:7], axis=0), 1.0, rtol=1e-6)
    np.testing.assert_allclose(found[7], 0.6 * mu_o**1.5, rtol=3e-5)


def test_a_plugin_says_nothing_below_the_surface_but_where_it_transmits(device: Device) -> None:
    given = points()
    given[5] *= -1.0
    for number in (1, 2):
        below = launched(device, "plugin_bsdf", number, given, numbers_of(PLUGINS[number - 1]), 1)
        assert not below[:4].any()
    through = launched(device, "plugin_bsdf", 3, given, numbers_of(PLUGINS[2]), 1)
    np.testing.assert_allclose(through[:3], 0.4 / math.pi, rtol=1e-5)
    assert (through[6] < 0.0).mean() == pytest.approx(0.4, abs=0.05)
    nobody = launched(device, "plugin_bsdf", 0, given, [], 1)
    assert not nobody[:7].any()


@pytest.mark.parametrize("lanes", [4, 8, 16])
def test_the_bits_do_not_depend_on_lanes(device: Device, lanes: int) -> None:
    if not device.is_cpu:
        pytest.skip("a GPU has one lane")
    given = points()
    for number, each in enumerate(PLUGINS, 1):
        kernel = "plugin_bsdf" if each.kind == "bsdf" else "plugin_texture"
        made = [
            launched(device, kernel, number, given[: 9 if each.kind == "bsdf" else 5], numbers_of(each), n)
            for n in (1, lanes)
        ]
        np.testing.assert_array_equal(made[0], made[1])
        assert np.isfinite(made[0]).all() and made[0].std() > 0.0
