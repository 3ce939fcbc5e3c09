"""Images of wavelengths: colours, spectra, glass that disperses light, and the same bits however they are rendered."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import OpenEXR
import pytest

import clrender
from clrender.errors import UsageError
from clrender.exact.matrices import inverse, times
from clrender.scene import Scene
from clrender.spectra.colors import TO_REC709, table_wavelengths
from clrender.spectra.film import film_color, integral, reflectance_film_weights
from clrender.spectra.glasses import GLASSES, sellmeier_indices
from clrender.spectra.illuminants import illuminant_spectrum
from clrender.spectra.lifting import reflectance_spectra, unbounded_spectra

if TYPE_CHECKING:
    from clrender.device import Device

_ROOT = Path(__file__).resolve().parents[2]
CAMERA = {"position": [0.0, 0.0, 5.0], "target": [0.0, 0.0, 0.0], "vertical_fov": 40.0}


def scene(**more: Any) -> Scene:
    return Scene.model_validate({"camera": CAMERA, **more})


def around(radiance: Any) -> dict[str, Any]:
    return {"type": "environment", "radiance": radiance}


def mean(device: Device, what: Scene, **settings: Any) -> Any:
    """The mean colour of an image."""
    given = {"size": (16, 16), "spp": 64, "spectral": True, **settings}
    return clrender.render(what, device=device, **given).linear.astype(np.float64).mean(axis=(0, 1))


def busy(**glass: Any) -> Scene:
    """Dispersive glass, coloured surfaces of several kinds, a medium, and lights by spectra and by colours."""
    return scene(
        materials={
            "glass": {"type": "dielectric", "dispersion": {"glass": "SF11"}, **glass},
            "ramp": {"type": "oren_nayar", "reflectance": {"wavelengths": [400, 700], "values": [0.1, 0.9]}},
            "gold": {"type": "conductor", "metal": "Au", "roughness": 0.3},
            "checks": {
                "type": "principled",
                "base_color": {"checker": [[0.8, 0.2, 0.1], [0.1, 0.3, 0.7]]},
                "coat": 0.5,
            },
            "floor": {"type": "lambert", "reflectance": [0.6, 0.5, 0.3]},
        },
        media={
            "dust": {
                "absorption": {"wavelengths": [400, 550, 560, 700], "values": [0.1, 0.2, 0.6, 0.1]},
                "scattering": [0.3, 0.2, 0.1],
            }
        },
        shapes=[
            {"type": "sphere", "center": [0.0, 0.0, 0.0], "radius": 0.8, "material": "glass"},
            {"type": "sphere", "center": [1.6, 0.0, -0.5], "radius": 0.7, "material": "gold"},
            {"type": "sphere", "center": [-1.6, 0.0, -0.5], "radius": 0.7, "material": "checks"},
            {"type": "sphere", "center": [0.0, 1.6, -0.5], "radius": 0.6, "interior": "dust"},
            {"type": "quad", "origin": [-4, -0.8, 3], "edge_u": [8, 0, 0], "edge_v": [0, 0, -8], "material": "floor"},
            {"type": "disk", "center": [0, -0.79, 0], "normal": [0, 1, 0], "radius": 1.2, "material": "ramp"},
            {
                "type": "disk",
                "center": [0.0, 3.5, 0.0],
                "normal": [0.0, -1.0, 0.0],
                "radius": 0.8,
                "emission": {"illuminant": "FL11", "scale": 6.0},
            },
        ],
        lights=[around([0.2, 0.3, 0.5])],
    )


def hashes(device: Device, what: Scene, *ways: dict[str, Any], **settings: Any) -> set[str]:
    given = {"size": (24, 20), "spp": 4, "spectral": True, **settings}
    return {clrender.render(what, device=device, **given, **way).stats["image_sha256"] for way in ways}


def test_one_hash_over_lanes_and_cuts(device: Device) -> None:
    ways: list[dict[str, Any]] = [{}, {"lanes": 1}, {"tile": 8, "samples_per_pass": 1}]
    assert len(hashes(device, busy(roughness=0.3), *ways)) == 1


@pytest.mark.long
@pytest.mark.parametrize("roughness", [0.0, 0.3])
def test_one_hash_over_lanes_cuts_and_stages(device: Device, roughness: float) -> None:
    ways: list[dict[str, Any]] = [{}, {"lanes": 1}, {"lanes": 4}, {"kernels": "staged"}]
    ways.append({"tile": 8, "samples_per_pass": 1})
    assert len(hashes(device, busy(roughness=roughness), *ways)) == 1


@pytest.mark.long
def test_colors_of_plugins_beside_rough_glass_that_disperses(device: Device) -> None:
    """A packet's other lanes are evaluated at each of its wavelengths, too, where only glass needs it."""
    what = busy(roughness=0.3)
    dusty = {"type": "plugin", "plugin": "minnaert", "parameters": {"reflectance": [0.7, 0.5, 0.2]}}
    what = what.with_plugins([_ROOT / "scenes" / "plugins" / "minnaert.cl"])
    what = what.changed({"materials.dusty": dusty, "shapes[2].material": "dusty", "shapes[4].material": "dusty"})
    assert len(hashes(device, what, {}, {"lanes": 1}, {"lanes": 8}, size=(48, 40))) == 1


@pytest.mark.long
@pytest.mark.parametrize("integrator", ["bdpt", "photon", "reuse", "whitted", "direct"])
def test_one_hash_of_every_integrator(device: Device, integrator: str) -> None:
    more: dict[str, Any] = {"integrator": integrator}
    if integrator == "reuse":
        more["max_depth"] = 6
    what = busy() if integrator not in ("reuse", "whitted") else without_medium()
    assert len(hashes(device, what, {}, {"lanes": 1}, {"tile": 8}, **more)) == 1


def without_medium() -> Scene:
    content = busy().model_dump(mode="json", exclude_unset=True)
    content["shapes"] = [shape for shape in content["shapes"] if "interior" not in shape]
    return Scene.model_validate(content)


def test_colors_of_light_are_seen_as_they_are(device: Device) -> None:
    for color in ([1.0, 1.0, 1.0], [0.2, 0.4, 0.9], [30.0, 12.0, 3.0], [0.0, 1.0, 0.1]):
        found = mean(device, scene(lights=[around(color)]))
        assert np.abs(found - color).max() < 0.004 * max(color)


@pytest.mark.parametrize("name", ["A", "D50", "FL2", "FL11", "HP1", "LED-V1"])
def test_white_under_each_illuminant_has_its_chromaticity(device: Device, name: str) -> None:
    def xy(color: Any) -> Any:
        xyz = times(inverse(TO_REC709), color)
        return xyz[:2] / xyz.sum()

    what = scene(
        materials={"white": {"type": "lambert", "reflectance": [0.8, 0.8, 0.8]}},
        shapes=[{"type": "sphere", "center": [0.0, 0.0, 0.0], "radius": 9.0, "material": "white"}],
        lights=[{"type": "point", "position": [0.0, 1.0, 0.0], "intensity": {"illuminant": name, "scale": 50.0}}],
    )
    found = mean(device, what, spp=1024, max_depth=1, size=(8, 8))
    assert np.abs(xy(found) - xy(film_color(illuminant_spectrum(name)))).max() < 1e-4


def test_a_lamp_of_a_file_has_its_own_spectrum(device: Device, tmp_path: Path) -> None:
    """Twice as bright as the file says, in the colour of a gas discharge."""
    lines = ["IESNA:LM-63-2002", "TILT=NONE", "1 -1 1 2 1 1 2 0 0 0", "1 1 0", "0 180", "0", "683 683"]
    (tmp_path / "even.ies").write_text("\n".join(lines))
    wall = {"type": "quad", "origin": [-1.0, -1.0, 0.0], "edge_u": [2.0, 0.0, 0.0], "edge_v": [0.0, 2.0, 0.0]}

    def seen(**light: Any) -> Any:
        lights = [{"position": [0.0, 0.0, 3.0], **light}]
        what = scene(
            materials={"white": {"type": "lambert", "reflectance": [1.0, 1.0, 1.0]}},
            shapes=[{**wall, "material": "white"}],
            lights=lights,
        )
        return mean(device, what.placed("test", tmp_path))

    lamp = seen(type="ies", file="even.ies", scale={"illuminant": "HP1", "scale": 2.0})
    assert lamp == pytest.approx(seen(type="point", intensity={"illuminant": "HP1", "scale": 2.0}), rel=1e-4)
    assert seen(type="ies", file="even.ies", scale=2.0) == pytest.approx(
        seen(type="point", intensity=[2.0, 2.0, 2.0]), rel=1e-4
    )


def test_surfaces_in_daylight_have_the_colors_of_the_other_mode(device: Device) -> None:
    for color in ([0.7, 0.3, 0.1], [0.05, 0.2, 0.6], [0.5, 0.5, 0.5]):
        what = scene(
            materials={"paint": {"type": "lambert", "reflectance": color}},
            shapes=[{"type": "sphere", "center": [0.0, 0.0, 0.0], "radius": 9.0, "material": "paint"}],
            lights=[{"type": "point", "position": [0.0, 1.0, 0.0], "intensity": [50.0, 50.0, 50.0]}],
        )
        found, wanted = (mean(device, what, max_depth=1, spectral=spectral) for spectral in (True, False))
        assert np.abs(found - wanted).max() < 0.004 * max(wanted)


def test_colored_light_on_a_colored_surface_is_the_product_of_their_spectra(device: Device) -> None:
    light, paint = np.array([2.0, 0.6, 0.2]), np.array([0.1, 0.3, 0.8])
    what = scene(
        materials={"paint": {"type": "mirror", "reflectance": paint.tolist()}},
        shapes=[
            {"type": "quad", "origin": [-9, -9, -1], "edge_u": [18, 0, 0], "edge_v": [0, 18, 0], "material": "paint"}
        ],
        lights=[around(light.tolist())],
    )
    wanted = reflectance_film_weights().T @ (unbounded_spectra(light) * reflectance_spectra(paint))
    found = mean(device, what, spp=256)
    assert np.abs(found - wanted).max() < 0.015 * max(wanted)
    assert np.abs(found - light * paint).max() > 0.1 * max(wanted)


LINES: Any = {"wavelengths": [400.0, 470.0, 540.0, 600.0, 700.0], "values": [0.2, 0.1, 1.8, 0.3, 0.05]}
COLD: Any = {"wavelengths": [400.0, 480.0, 560.0, 700.0], "values": [1.0, 1.2, 0.5, 0.1]}


def slab(medium: dict[str, Any], radiance: Any) -> Scene:
    """Two metres of a medium before an environment, seen straight on."""
    box = {"type": "box", "center": [0.0, 0.0, 0.0], "size": [4.0, 4.0, 2.0], "interior": "filled"}
    camera = {**CAMERA, "vertical_fov": 0.1}
    return scene(camera=camera, shapes=[box], media={"filled": medium}, lights=[around(radiance)])


def spectrum_at(table: Any) -> Any:
    return clrender.scene.spectra.Spectrum(**table).reflectance()


@pytest.mark.long
@pytest.mark.parametrize("integrator", ["path", "bdpt"])
def test_a_medium_absorbs_by_its_spectrum(device: Device, integrator: str) -> None:
    """exp(-2 a) at each wavelength, which no three numbers can say."""
    what = slab({"absorption": LINES}, {"illuminant": "A", "scale": 1.0})
    wanted = film_color(illuminant_spectrum("A") * np.exp(-2.0 * spectrum_at(LINES)))
    found = mean(device, what, integrator=integrator, spp=256)
    np.testing.assert_allclose(found, wanted, rtol=2e-3, atol=1e-3)
    three = mean(device, what, integrator=integrator, spectral=False)
    assert np.abs(three - wanted).max() > 0.02, "red, green and blue are only near it"


@pytest.mark.long
def test_a_medium_shines_by_its_spectrum(device: Device) -> None:
    """e / a (1 - exp(-2 a)) at each wavelength."""
    what = slab({"absorption": LINES, "emission": COLD}, 0.0)
    lost = spectrum_at(LINES)
    shining = clrender.scene.spectra.Spectrum(**COLD).light()
    found = mean(device, what, spp=1024)
    np.testing.assert_allclose(found, film_color(shining / lost * (1.0 - np.exp(-2.0 * lost))), rtol=0.03, atol=0.003)


@pytest.mark.long
def test_a_medium_that_only_scatters_loses_nothing(device: Device) -> None:
    white = mean(device, slab({"scattering": LINES, "g": 0.3}, 1.0), spp=2048)
    np.testing.assert_allclose(white, 1.0, rtol=5e-3)
    fog = scene(media={"fog": {"scattering": LINES}}, fog="fog", camera={**CAMERA, "vertical_fov": 0.1})
    assert np.abs(mean(device, fog, spp=16)).max() == 0.0


def test_spectra_of_media_are_checked() -> None:
    wrong: list[tuple[dict[str, Any], str]] = [
        ({"absorption": {"illuminant": "A"}}, "is of light; a coefficient needs wavelengths and values"),
        ({"scattering": {"wavelengths": [500.0], "values": [1.0, 2.0]}}, "has 1 wavelength and 2 values"),
        ({"emission": COLD, "absorption": {"wavelengths": [600, 605], "values": [1, 0]}}, "shines at 605 nm without"),
        ({"emission": COLD}, "without absorbing or scattering it"),
    ]
    for medium, words in wrong:
        with pytest.raises(clrender.SceneError, match=words):
            Scene(camera=CAMERA, media={"filled": medium})
    dyed = scene(media={"filled": {"absorption": LINES}}).media["filled"].absorption
    assert len(dyed) == 3 and min(dyed) > 0.0


def test_metamers_part_in_another_light(device: Device) -> None:
    grey = {"wavelengths": [360.0, 830.0], "values": [0.5, 0.5]}
    places = np.arange(95)
    spectrum = 0.5 + 0.3 * np.cos(places * 0.45)
    weights = reflectance_film_weights()
    # Take away what daylight sees of the waves
    waves = spectrum - 0.5
    seen = weights @ np.linalg.solve(weights.T @ weights, weights.T @ waves)
    table = (0.5 + waves - seen).clip(0.0, 1.0)
    other = {"wavelengths": (360.0 + 5.0 * places).tolist(), "values": table.tolist()}
    found = {}
    for light in ("D65", "FL11"):
        for name, reflectance in (("grey", grey), ("waves", other)):
            what = scene(
                materials={"paint": {"type": "lambert", "reflectance": reflectance}},
                shapes=[{"type": "sphere", "center": [0.0, 0.0, 0.0], "radius": 9.0, "material": "paint"}],
                lights=[{"type": "point", "position": [0.0, 1.0, 0.0], "intensity": {"illuminant": light}}],
            )
            found[light, name] = mean(device, what, max_depth=1, spp=256, size=(8, 8))
    for light, apart in (("D65", False), ("FL11", True)):
        difference = np.abs(found[light, "waves"] / found[light, "grey"] - 1.0).max()
        assert (difference > 0.05) if apart else (difference < 0.01)


def refracted(direction: Any, normal: Any, ratio: float) -> Any:
    """A unit vector after a surface; the ratio is the index before it over that behind it."""
    cosine = -float(np.dot(direction, normal))
    return ratio * direction + (ratio * cosine - math.sqrt(1.0 - ratio * ratio * (1.0 - cosine * cosine))) * normal


def through_prism(direction: Any, index: float, first: Any, second: Any) -> Any:
    inside = refracted(direction, first, 1.0 / index)
    return refracted(inside, second, index)


@pytest.mark.parametrize("line", [450.0, 550.0, 650.0])
def test_a_prism_sends_each_wavelength_where_sellmeier_says(device: Device, line: float) -> None:
    half = math.radians(20.0)
    first = np.array([math.sin(half), 0.0, math.cos(half)])  # towards the camera
    second = np.array([math.sin(half), 0.0, -math.cos(half)])
    index = float(sellmeier_indices(GLASSES["SF11"], np.array([line]))[0])
    # The prism's edge is on the right: rays bend to its base, on the left
    towards = through_prism(np.array([0.0, 0.0, -1.0]), index, first, -second)
    far = 4000.0 * towards
    width = 1.0
    corners = [[width, y, 0.0] for y in (-2.0, 2.0)] + [
        [-width, y, side * 2.0 * width * math.tan(half)] for y in (-2.0, 2.0) for side in (1.0, -1.0)
    ]
    right_low, right_high = 0, 1
    front_low, back_low, front_high, back_high = 2, 3, 4, 5
    faces = [
        [front_low, right_low, right_high],
        [front_low, right_high, front_high],
        [right_low, back_low, back_high],
        [right_low, back_high, right_high],
        [back_low, front_low, front_high],
        [back_low, front_high, back_high],
        [front_low, back_low, right_low],
        [front_high, right_high, back_high],
    ]
    narrow = {"wavelengths": [line - 2.6, line - 2.5, line + 2.5, line + 2.6], "values": [0.0, 1.0, 1.0, 0.0]}
    what = scene(
        camera={"position": [0.0, 0.0, 6.0], "target": [0.0, 0.0, 0.0], "vertical_fov": 4.0},
        materials={"glass": {"type": "dielectric", "dispersion": {"glass": "SF11"}}},
        shapes=[
            {"type": "mesh", "vertices": corners, "faces": faces, "material": "glass"},
            {
                "type": "sphere",
                "center": [float(far[0]), float(far[1]), float(far[2]) + 6.0],
                "radius": 12.0,
                "emission": {**narrow, "scale": 100.0},
            },
        ],
    )
    image = clrender.render(what, device=device, size=(41, 41), spp=256, spectral=True, filter="box").linear
    light = np.abs(image.astype(np.float64)).sum(axis=2)
    assert light.sum() > 0.0
    columns = np.arange(41) - 20.0
    assert abs(float((light * columns[None, :]).sum() / light.sum())) < 1.0
    assert abs(float((light * columns[:, None]).sum() / light.sum())) < 1.0


@pytest.mark.long
def test_integrators_agree(device: Device) -> None:
    ways: dict[str, dict[str, Any]] = {
        "path": {},
        "guided": {"guiding": "on"},
        "splitting": {"indirect_rays": 2},
        "bdpt": {"integrator": "bdpt"},
        "photon": {"integrator": "photon"},
    }
    what = busy(roughness=0.4)
    found = {name: mean(device, what, spp=512, size=(12, 12), **more) for name, more in ways.items()}
    for name, color in found.items():
        assert np.abs(color / found["path"] - 1.0).max() < (0.05 if name == "photon" else 0.03), (name, found)


@pytest.mark.long
@pytest.mark.parametrize("roughness", [0.0, 0.3])
def test_paths_of_three_wavelengths_find_what_those_of_one_do(device: Device, roughness: float) -> None:
    """`reuse` has one wavelength a path where glass disperses light."""
    smooth = {"illuminant": "D50", "scale": 6.0}  # of lines, one wavelength a path makes much noise
    what = without_medium().changed({"materials.glass.roughness": roughness, "shapes[5].emission": smooth})
    one = mean(device, what, spp=2048, integrator="reuse")
    for way in ({}, {"sampling": "bsdf"}, {"indirect_rays": 2}, {"guiding": "on"}, {"roulette": "none"}):
        found = mean(device, what, spp=1024, **way)
        assert np.abs(found / one - 1.0).max() < 0.01, (way, found, one)


def test_wavelengths_that_go_on_in_glass_are_evenly_spaced(device: Device) -> None:
    """In white light each path brings what its wavelength is to the film, and nothing else."""
    what = scene(
        camera={**CAMERA, "vertical_fov": 10.0},
        materials={"glass": {"type": "dielectric", "dispersion": {"glass": "SF11"}}},
        shapes=[{"type": "sphere", "center": [0.0, 0.0, 0.0], "radius": 1.0, "material": "glass"}],
        lights=[around([1.0, 1.0, 1.0])],
    )
    given: dict[str, Any] = {"spp": 64, "spectral": True, "filter": "box", "roulette": "none", "max_depth": 64}
    image = clrender.render(what, device=device, size=(16, 16), **given).linear
    assert np.abs(image - 1.0).max() < 0.02


def test_radiosity_refuses_wavelengths(device: Device) -> None:
    with pytest.raises(UsageError, match="spectral is True, but the integrator radiosity"):
        clrender.render(busy(), device=device, size=(8, 8), spp=1, integrator="radiosity", spectral=True)


def test_bands_add_up_to_the_spectrum(device: Device) -> None:
    """A light of a table below a mirror: each band has the mean of the spectrum in it."""
    ramp = {"wavelengths": [360.0, 830.0], "values": [1.0, 5.0]}
    paint = {"wavelengths": [360.0, 830.0], "values": [0.2, 0.8]}
    what = scene(
        materials={"paint": {"type": "mirror", "reflectance": paint}},
        shapes=[
            {"type": "quad", "origin": [-9, -9, -1], "edge_u": [18, 0, 0], "edge_v": [0, 18, 0], "material": "paint"}
        ],
        lights=[around(ramp)],
    )
    image = clrender.render(what, device=device, size=(8, 8), spp=64, spectral=True, spectrum=10)
    assert image.spectrum is not None and image.spectrum.shape == (8, 8, 10)
    fine = (np.arange(1000) + 0.5) / 1000.0
    wanted = ((1.0 + 4.0 * fine) * (0.2 + 0.6 * fine)).reshape(10, 100).mean(axis=1)
    assert image.spectrum.mean(axis=(0, 1)) == pytest.approx(wanted, rel=2e-3)
    assert image.stats["spectrum_nm"][:2] == [360.0, 407.0]
    plain = clrender.render(what, device=device, size=(8, 8), spp=64, spectral=True)
    assert plain.stats["image_sha256"] == image.stats["image_sha256"]


def test_bands_of_glass_that_disperses_light(device: Device, tmp_path: Path) -> None:
    image = clrender.render(busy(), device=device, size=(8, 8), spp=256, spectral=True, spectrum=6)
    image.save(tmp_path / "bands.exr")
    assert image.spectrum is not None
    same = clrender.render(busy(), device=device, size=(8, 8), spp=256, spectral=True, spectrum=6, lanes=1, tile=4)
    assert same.spectrum is not None and same.spectrum.tobytes() == image.spectrum.tobytes()
    with OpenEXR.File(str(tmp_path / "bands.exr"), separate_channels=True) as file:
        names = [name for name in file.channels() if name.startswith("S0.")]
    assert sorted(names)[0] == "S0.399,166667nm" and len(names) == 6
    # The bands of a spectrum weigh what the film sees of them
    assert float(image.spectrum.min()) >= 0.0


def sensor(**more: Any) -> dict[str, Any]:
    """The sensitivities of a sensor."""
    lines = table_wavelengths()

    def peak(middle: float, width: float) -> list[float]:
        return [float(x) for x in np.exp(-0.5 * ((lines - middle) / width) ** 2)]

    return {
        "wavelengths": lines.tolist(),
        "red": peak(600.0, 40.0),
        "green": peak(540.0, 45.0),
        "blue": [50.0 * x for x in peak(450.0, 30.0)],
        **more,
    }


@pytest.mark.parametrize("white", ["D65", "A"])
def test_a_sensor_sees_light_by_its_response(device: Device, white: str) -> None:
    response = sensor(white=white)
    for light in ("D65", "A", "FL11"):
        sky = [around({"illuminant": light})]
        seen = mean(device, Scene.model_validate({"camera": {**CAMERA, "response": response}, "lights": sky}), spp=256)
        wanted = [
            integral(np.array(response[key]), illuminant_spectrum(light))
            / integral(np.array(response[key]), illuminant_spectrum(white))
            for key in ("red", "green", "blue")
        ]
        assert seen == pytest.approx(wanted, rel=1e-4)


def test_cameras_in_turn_see_their_own_colors(device: Device) -> None:
    """In one session, and in a batch."""
    plain = scene(lights=[around({"illuminant": "A"})])
    colored = Scene.model_validate({"camera": {**CAMERA, "response": sensor()}, "lights": plain.lights})
    settings: dict[str, Any] = {"size": (8, 8), "spp": 64, "spectral": True}
    told: list[str] = []
    with clrender.Session(device, notify=told.append) as session:
        alone = [session.render(each, **settings) for each in (plain, colored, plain)]
        both = session.render_batch(plain, [plain.camera, colored.camera], **settings)
        assert not any("response" in line for line in told)
        session.render(colored, size=(8, 8), spp=1)
        assert any("response of the camera counts with wavelengths only" in line for line in told)
    assert alone[0].stats["image_sha256"] == alone[2].stats["image_sha256"] != alone[1].stats["image_sha256"]
    assert alone[0].stats["scene_sha256"] != alone[1].stats["scene_sha256"]
    for image, whole in zip(both, alone, strict=False):
        np.testing.assert_array_equal(image, whole.linear)


@pytest.mark.parametrize(
    ("more", "words"),
    [
        ({"red": [0.0, 1.0]}, "response.red: has 2 numbers, and there are 95 wavelengths"),
        ({"green": [0.0] * 95}, "response.green: sees nothing"),
        ({"white": "D64"}, "response.white"),
        ({"blue": [-1.0] * 95}, "response.blue"),
    ],
)
def test_what_is_no_response(more: dict[str, Any], words: str) -> None:
    with pytest.raises(clrender.SceneError, match=words.replace(".", r"\.").split(":")[0]) as raised:
        Scene(camera={**CAMERA, "response": sensor(**more)})
    assert words.rsplit(": ", maxsplit=1)[-1] in str(raised.value)


@pytest.mark.parametrize(("count", "spectral", "words"), [(2, True, "from 3 to 300"), (6, False, "without spectral")])
def test_bands_are_refused(device: Device, count: int, spectral: bool, words: str) -> None:
    with pytest.raises(UsageError, match=words):
        clrender.render(busy(), device=device, size=(4, 4), spp=1, spectral=spectral, spectrum=count)


def test_layers_show_colors(device: Device) -> None:
    what = busy()
    layers = [
        clrender.render(what, device=device, size=(16, 16), spp=4, spectral=spectral, aov=["albedo"]).aovs["albedo"]
        for spectral in (False, True)
    ]
    assert np.array_equal(layers[0], layers[1])


def test_a_scene_file_may_ask_for_wavelengths(device: Device) -> None:
    what = scene(lights=[around([0.2, 0.4, 0.9])], render={"spectral": True})
    said = clrender.render(what, device=device, size=(8, 8), spp=4)
    assert said.stats["image_sha256"] == next(iter(hashes(device, what, {}, size=(8, 8))))
    plain = clrender.render(what, device=device, size=(8, 8), spp=4, spectral=False)
    assert np.abs(plain.linear - np.array([0.2, 0.4, 0.9], np.float32)).max() < 1e-6
