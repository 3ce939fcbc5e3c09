"""A device that does not round divisions and square roots gives the same image: the correction is in every kernel.

Simulated: PoCL is built as such a device would be, and what it gives is off by up to 3 units in the last place, which
is what OpenCL allows, before it is corrected.
"""

from __future__ import annotations

import pytest
from image_support import Cutting, render

from clrender.device.device import Device


@pytest.mark.long
@pytest.mark.parametrize(
    ("scene", "lanes"),
    [
        pytest.param("room", None, marks=pytest.mark.slow),
        ("room", 1),
        *(
            pytest.param(scene, 1, marks=pytest.mark.slow)
            for scene in ("surfaces", "drink", "haze", "textures", "lamps", "sky", "S4")
        ),
    ],
)
def test_the_image_is_the_same(device: Device, scene: str, lanes: int | None) -> None:
    cutting = Cutting(lanes=lanes)
    wanted = render(scene, [device], cutting).stats["image_sha256"]
    for options in ("-D CORRECT_DIVIDE=1", "-D CORRECT_DIVIDE=1 -D QUOTIENT_ERROR=3u"):
        other = Device(device.info, device._handle)
        other.options += f" {options}"
        assert render(scene, [other], cutting).stats["image_sha256"] == wanted, options
        other.close()
