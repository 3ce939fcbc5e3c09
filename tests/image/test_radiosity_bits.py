"""The picture of a radiosity solution is the same bits however its work is cut; refusals are clear."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

import clrender
from clrender.errors import SceneError, UsageError
from clrender.rendering.rendered_image import RenderedImage

if TYPE_CHECKING:
    from clrender.device import Device

DISPLAYS = ("constant", "smooth", "gather")
CUTS = [
    pytest.param({"lanes": 4, "tile": 16, "traversal": "single"}, marks=pytest.mark.slow),
    {"lanes": 1, "tile": 24, "work_group": 2, "samples_per_pass": 1},
]


def render(device: Device, display: str, **more: Any) -> RenderedImage:
    settings: dict[str, Any] = {"spp": 2, "size": (40, 30), "patches": 700, "patch_rays": 48, "integrator": "radiosity"}
    settings |= {"radiosity_display": display, "device": device.info.index, **more}
    return clrender.render(clrender.load("room-diffuse"), **settings)


@pytest.fixture(scope="module")
def expected(device: Device) -> dict[str, str]:
    return {display: render(device, display).stats["image_sha256"] for display in DISPLAYS}


@pytest.mark.long
@pytest.mark.parametrize("cut", CUTS, ids=str)
def test_the_same_bits_however_cut(device: Device, expected: dict[str, str], cut: dict[str, Any]) -> None:
    for display in DISPLAYS:
        assert render(device, display, **cut).stats["image_sha256"] == expected[display], display


@pytest.mark.slow
def test_the_same_bits_on_every_driver(all_devices: list[Device], expected: dict[str, str]) -> None:
    for device in all_devices[1:]:
        for display in DISPLAYS:
            image = render(device, display)
            assert image.stats["image_sha256"] == expected[display], f"{display} on {device.info.title}"


@pytest.mark.slow
def test_textures_in_every_number_of_lanes_and_on_every_driver(all_devices: list[Device]) -> None:
    """A room whose diffuse shapes have checkers: means on the host, the texture itself in the kernels."""
    room = clrender.load("room-diffuse")
    checked = {"type": "lambert", "reflectance": {"checker": [[0.9, 0.1, 0.3], [0.0, 0.8, 0.5]], "size": 0.3}}
    painted = clrender.Scene.model_validate(
        {**room.model_dump(exclude_none=True), "materials": dict.fromkeys(room.materials, checked)}
    )
    settings: dict[str, Any] = {"spp": 2, "size": (40, 30), "patches": 700, "patch_rays": 48, "integrator": "radiosity"}
    for display in DISPLAYS:
        made = set()
        for device in all_devices:
            if "rusticl" in device.info.platform:
                continue  # its compiler takes minutes over textures
            for each in (1, 4, 8, 16):
                image = clrender.render(
                    painted, device=device.info.index, lanes=each, radiosity_display=display, **settings
                )
                made.add(image.stats["image_sha256"])
        assert len(made) == 1, display


@pytest.mark.long
def test_what_decides_the_picture(device: Device, expected: dict[str, str]) -> None:
    changed = [
        render(device, "constant", **change).stats["image_sha256"]
        for change in ({"seed": 1}, {"patches": 3000}, {"patch_rays": 64})
    ]
    assert len({*changed, *expected.values()}) == 6


@pytest.mark.long
def test_gathered_and_smooth_pictures_agree_with_paths(device: Device) -> None:
    """Blocks of a picture within a few percent of path tracing: noise, and that patches are not infinitely small."""
    paths = clrender.render(clrender.load("room-diffuse"), device=device.info.index, size=(40, 30), spp=256)

    def blocks(image: RenderedImage) -> Any:
        return image.linear.astype(np.float64).reshape(5, 6, 5, 8, 3).mean(axis=(1, 3))

    truth = blocks(paths)
    for display in ("smooth", "gather"):
        shown = blocks(render(device, display, spp=64, patches=4000, patch_rays=256))
        assert np.abs(shown / truth - 1.0).max() < 0.12, display
        assert abs(shown.mean() / truth.mean() - 1.0) < 0.015, display


def test_mirrors_and_glass_are_refused_by_name(device: Device) -> None:
    for name, kind, shape in (("room", "mirror", 10), ("furnace-glass", "dielectric", None)):
        with pytest.raises(SceneError, match=rf"of type {kind}.*lambert.*--integrator path") as error:
            clrender.render(clrender.load(name), device=device.info.index, size=(4, 4), integrator="radiosity")
        assert "shapes[" in str(error.value) and (shape is None or f"shapes[{shape}].material" in str(error.value))


def test_what_makes_no_sense_is_refused(device: Device) -> None:
    with pytest.raises(UsageError, match="patches is 0"):
        render(device, "smooth", patches=0)
    with pytest.raises(UsageError, match=r"radiosity_display is 'nice'.*constant, smooth or gather"):
        render(device, "nice")
    nothing = clrender.Scene(camera={"position": [0, 0, 1], "target": [0, 0, 0]})
    with pytest.raises(SceneError, match="no shapes"):
        clrender.render(nothing, device=device.info.index, size=(4, 4), integrator="radiosity")


def test_it_stops_when_told(device: Device) -> None:
    image = render(device, "smooth", should_stop=lambda: True)
    assert image.interrupted and image.film.samples == 0
