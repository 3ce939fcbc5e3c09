"""Spectra: what the film sees of them, illuminants, spectra of colours, glasses, and what scenes say of all this."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from clrender import layout
from clrender.errors import SceneError
from clrender.exact.matrices import inverse, times
from clrender.flatten.flat_scene import flatten
from clrender.flatten.spectral import spectral_arrays
from clrender.scene import Scene
from clrender.scene.spectra import DispersiveIndex, SpectralColor
from clrender.spectra.colors import TO_REC709, observer, table_wavelengths
from clrender.spectra.film import film_color, film_table, integral, reflectance_film_weights
from clrender.spectra.glasses import GLASSES, LINE_C, LINE_D, LINE_F, abbe_indices, cauchy_indices, sellmeier_indices
from clrender.spectra.illuminants import ILLUMINANTS, blackbody_spectrum, illuminant_spectrum
from clrender.spectra.kernel_table import kernel_table, wavelength_distribution
from clrender.spectra.lifting import lifting_table, reflectance_spectra, unbounded_spectra

CHROMATICITIES = {
    "A": (0.44758, 0.40745),
    "D50": (0.34570, 0.35850),
    "D55": (0.33243, 0.34744),
    "D65": (0.31270, 0.32900),
    "D75": (0.29903, 0.31488),
    "E": (1.0 / 3.0, 1.0 / 3.0),
    "FL1": (0.3131, 0.3371),
    "FL2": (0.3721, 0.3751),
    "FL3": (0.4091, 0.3941),
    "FL4": (0.4402, 0.4031),
    "FL5": (0.3138, 0.3452),
    "FL6": (0.3779, 0.3882),
    "FL7": (0.3129, 0.3292),
    "FL8": (0.3458, 0.3586),
    "FL9": (0.3741, 0.3727),
    "FL10": (0.3458, 0.3588),
    "FL11": (0.3805, 0.3769),
    "FL12": (0.4370, 0.4042),
    "HP1": (0.5330, 0.4150),
    "HP2": (0.4778, 0.4158),
    "HP3": (0.4302, 0.4075),
    "HP4": (0.3812, 0.3797),
    "HP5": (0.3776, 0.3713),
    "LED-B1": (0.4560, 0.4078),
    "LED-B2": (0.4357, 0.4012),
    "LED-B3": (0.3756, 0.3723),
    "LED-B4": (0.3422, 0.3502),
    "LED-B5": (0.3118, 0.3236),
    "LED-BH1": (0.4474, 0.4066),
    "LED-RGB1": (0.4557, 0.4211),
    "LED-V1": (0.4548, 0.4044),
    "LED-V2": (0.3781, 0.3775),
}
"""Of the illuminants in CIE 15:2018, x and y."""


def chromaticity(values: Any) -> Any:
    """Of a spectrum, as the film sees it."""
    xyz = times(inverse(TO_REC709), film_color(values))
    return xyz[:2] / xyz.sum()


def described(**more: Any) -> dict[str, Any]:
    return {
        "camera": {"position": [0.0, 0.0, 5.0], "target": [0.0, 0.0, 0.0]},
        "materials": {"thing": {"type": "lambert", "reflectance": [0.5, 0.5, 0.5]}},
        "shapes": [{"type": "sphere", "center": [0.0, 0.0, 0.0], "radius": 1.0, "material": "thing"}],
        "lights": [{"type": "environment", "radiance": [1.0, 1.0, 1.0]}],
        **more,
    }


def with_material(**keys: Any) -> dict[str, Any]:
    return described(materials={"thing": keys})


RAMP = {"wavelengths": [400.0, 500.0, 600.0, 700.0], "values": [0.1, 0.2, 0.8, 0.9]}
DARK = {"wavelengths": [400.0, 700.0], "values": [0.0, 1.0]}


@pytest.mark.parametrize("name", ILLUMINANTS)
def test_illuminants_have_the_chromaticities_that_the_cie_gives(name: str) -> None:
    assert np.abs(chromaticity(illuminant_spectrum(name)) - CHROMATICITIES[name]).max() < 1e-4


@pytest.mark.parametrize("name", ["A", "FL11", "D65"])
def test_illuminants_have_luminance_one(name: str) -> None:
    values = illuminant_spectrum(name)
    matching = observer()[:, 1]
    assert (values * matching).sum() / matching.sum() == pytest.approx(1.0, abs=2e-4)


def test_daylight_is_white_and_equal_energy_has_luminance_one() -> None:
    table = film_table()
    assert film_color(table[:, 3]) == pytest.approx([1.0, 1.0, 1.0], abs=1e-12)
    assert float(np.dot((0.212671, 0.715160, 0.072169), film_color(np.ones(95)))) == pytest.approx(1.0, abs=3e-4)


def test_integrals_with_the_film_are_the_sums_of_the_cie() -> None:
    values = np.random.default_rng(1).random(95)
    sums = times(TO_REC709, observer().T @ values) / observer()[:, 1].sum()
    assert np.abs(film_color(values) / sums - 1.0).max() < 3e-4  # the channels are scaled so that daylight is white


def test_a_black_body_is_at_the_known_place() -> None:
    # Planckian locus at 5000 K: Wyszecki and Stiles, Color Science, table 1(3.3.8)
    assert np.abs(chromaticity(blackbody_spectrum(5000.0)) - (0.34510, 0.35161)).max() < 2e-4


def test_reflectances_of_colors_have_these_colors() -> None:
    colors = np.random.default_rng(2).random((40, 3)) * 0.9 + 0.02
    weights = reflectance_film_weights()
    for color in colors:
        values = reflectance_spectra(color)
        assert float(values.min()) >= 0.0 and float(values.max()) <= 1.0
        assert np.abs(weights.T @ values - color).max() < 1e-6


@pytest.mark.parametrize("color", [(0.9999, 0.01, 0.01), (0.0, 0.0, 0.7), (1e-5, 2e-5, 3e-6), (0.99, 1.0, 0.98)])
def test_extreme_colors_are_near(color: Any) -> None:
    values = reflectance_spectra(np.array(color))
    assert float(values.max()) <= 1.0
    assert np.abs(reflectance_film_weights().T @ values - color).max() < 0.015 * max(color)


def test_grey_is_the_same_at_all_wavelengths() -> None:
    assert set(reflectance_spectra(np.array([0.3, 0.3, 0.3])).tolist()) == {0.3}
    assert set(unbounded_spectra(np.array([7.0, 7.0, 7.0])).tolist()) == {7.0}


def test_what_has_no_bound_scales() -> None:
    color = np.array([3.0, 1.0, 0.5])
    assert unbounded_spectra(color * 100.0) == pytest.approx(unbounded_spectra(color) * 100.0, rel=1e-12)
    assert reflectance_film_weights().T @ unbounded_spectra(color) == pytest.approx(color, rel=1e-6)


def test_the_table_of_colors_is_finite_and_every_run_makes_the_same() -> None:
    table = lifting_table()
    assert np.isfinite(table).all() and float(np.abs(table).max()) < 100.0
    assert len(kernel_table()) == layout.SPECTRA_GIVEN
    lifting_table.cache_clear()
    assert lifting_table().tobytes() == table.tobytes()


def test_wavelengths_ascend_and_their_density_is_that_of_the_table() -> None:
    lines, spread = wavelength_distribution().T
    assert lines[0] == 0.0 and lines[-1] == pytest.approx(94.0, abs=1e-9)
    steps = (spread[1:] + spread[:-1]) / 2.0 / layout.SPECTRA_SEGMENTS
    assert np.diff(lines) == pytest.approx(steps, rel=1e-9) and float(steps.min()) > 0.0


@pytest.mark.parametrize(
    ("name", "index", "abbe"),
    [("BK7", 1.51680, 64.17), ("SF11", 1.78472, 25.68), ("water", 1.33334, 55.8), ("diamond", 2.41749, 55.3)],
)
def test_glasses_have_the_index_and_abbe_number_of_their_data_sheets(name: str, index: float, abbe: float) -> None:
    d, f, c = sellmeier_indices(GLASSES[name], np.array([LINE_D, LINE_F, LINE_C]))
    assert d == pytest.approx(index, abs=2e-5) and (d - 1.0) / (f - c) == pytest.approx(abbe, rel=2e-3)


def test_an_abbe_number_gives_indices_with_that_number() -> None:
    d, f, c = abbe_indices(1.6, 30.0, np.array([LINE_D, LINE_F, LINE_C]))
    assert d == pytest.approx(1.6, abs=1e-12) and (d - 1.0) / (f - c) == pytest.approx(30.0, rel=1e-12)
    assert cauchy_indices((1.5, 0.004), np.array([500.0])) == pytest.approx([1.516], abs=1e-12)


def test_a_scene_says_spectra_and_says_them_again() -> None:
    scene = Scene.model_validate(
        with_material(type="lambert", reflectance=RAMP)
        | {"lights": [{"type": "environment", "radiance": {"illuminant": "A", "scale": 2.0}}]}
    )
    color = scene.materials["thing"].reflectance  # type: ignore[union-attr]
    assert isinstance(color, SpectralColor) and color[0] > color[2]
    again = Scene.model_validate(scene.model_dump(mode="json", exclude_unset=True))
    assert again == scene and again.content_sha256() == scene.content_sha256()
    brighter = scene.changed({"lights[0].radiance": {"illuminant": "A", "scale": 3.0}})
    assert brighter.content_sha256() != scene.content_sha256()
    assert scene.changed({"camera.vertical_fov": 30.0}).materials == scene.materials


def test_a_coefficient_may_have_a_color_of_its_own() -> None:
    """Where wavelengths are not rendered; it is part of the hash."""
    own, plain = (
        Scene.model_validate(described(media={"dye": {"absorption": {**RAMP, **more}}}, fog="dye"))
        for more in ({"color": [0.1, 0.2, 0.3]}, {})
    )
    found = own.media["dye"].absorption
    assert isinstance(found, SpectralColor) and tuple(found) == (0.1, 0.2, 0.3)
    other = plain.media["dye"].absorption
    assert isinstance(other, SpectralColor) and np.array_equal(found.values, other.values)
    assert own.content_sha256() != plain.content_sha256()
    assert "color" not in str(plain.model_dump(mode="json", exclude_unset=True)["media"])


def test_a_spectrum_of_light_has_the_color_that_it_has() -> None:
    scene = Scene.model_validate(
        described(lights=[{"type": "environment", "radiance": {"blackbody": 2700.0, "scale": 4.0}}])
    )
    color = scene.lights[0].constant  # type: ignore[union-attr]
    assert float(np.dot((0.212671, 0.715160, 0.072169), color)) == pytest.approx(4.0, rel=1e-3)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (with_material(type="lambert", reflectance={"illuminant": "A"}), "is of light"),
        (with_material(type="lambert", reflectance={"wavelengths": [400.0], "values": []}), "1 wavelength and 0"),
        (with_material(type="lambert", reflectance={**RAMP, "scale": 1.5}), "has a reflectance of 1.35"),
        (with_material(type="lambert", reflectance={"wavelengths": [500.0, 400.0], "values": [0.1, 0.1]}), "ascend"),
        (with_material(type="lambert", reflectance={"wavelengths": [], "values": []}), "one of these"),
        (described(lights=[{"type": "environment", "radiance": {"illuminant": "A", "blackbody": 5000.0}}]), "one of"),
        (described(lights=[{"type": "environment", "radiance": {"illuminant": "F99"}}]), "illuminant"),
        (described(lights=[{"type": "environment", "radiance": {"blackbody": 5.0}}]), "blackbody"),
        (described(lights=[{"type": "environment", "radiance": {"colour": 5.0}}]), "colour"),
        (with_material(type="lambert", reflectance={**RAMP, "color": [0.1, 0.2, 0.3]}), "is of coefficients of media"),
        (described(lights=[{"type": "environment", "radiance": {**RAMP, "color": 0.5}}]), "is of coefficients"),
        (described(media={"dye": {"absorption": {**RAMP, "color": 0.0}}}), "0 together, or neither"),
        (described(media={"dye": {"absorption": {**RAMP, "scale": 0.0, "color": 1.0}}}), "0 together, or neither"),
        (with_material(type="conductor", eta=DARK, k=DARK), "eta.values has an index of 0; at least 1e-06 is known"),
        (with_material(type="conductor", eta=1e-9, k=0.0), "eta.0. is 1e-09, but must be at least 1e-06"),
        (with_material(type="dielectric", dispersion={"glass": "BK7", "abbe": 60.0}), "needs one of"),
        (with_material(type="dielectric", dispersion={"glass": "BK8"}), "glass"),
        (with_material(type="dielectric", dispersion={"sellmeier": [1.0]}), "dispersion.sellmeier"),
        (with_material(type="dielectric", dispersion={"sellmeier": [1.0, 0.3, 1.0]}), "a C for each B"),
        (with_material(type="dielectric", dispersion={"cauchy": [0.2]}), "not from 1 to 10"),
        (with_material(type="dielectric", dispersion={"abbe": 40.0}), "ior"),
        (with_material(type="dielectric", ior=1.6, dispersion={"glass": "BK7"}), "dispersion says 1.5168"),
    ],
)
def test_wrong_spectra_are_refused(content: dict[str, Any], words: str) -> None:
    with pytest.raises(SceneError, match=words):
        Scene(**content)


def test_indices_of_metals_out_of_gamut_are_not_zero() -> None:
    """Of a narrow line the colour red is below 0; Fresnel's formula has no value for an index of 0."""
    line = {"wavelengths": [360.0, 500.0, 505.0, 510.0, 830.0], "values": [1e-6, 1e-6, 3.0, 1e-6, 1e-6]}
    scene = Scene.model_validate(with_material(type="conductor", eta=line, k={**line, "scale": 0.0}))
    assert min(scene.materials["thing"].eta) == 1e-6  # type: ignore[union-attr, arg-type]
    flat = flatten(scene, 4, 4)
    assert all(
        np.isfinite(array).all()
        for array in spectral_arrays(flat.arrays, flat.spectral).values()
        if array.dtype.kind == "f"
    )


def test_glass_has_the_index_that_its_dispersion_says() -> None:
    scene = Scene.model_validate(with_material(type="dielectric", dispersion={"glass": "SF11"}))
    glass = scene.materials["thing"]
    assert glass.ior == pytest.approx(1.78472, abs=2e-5)  # type: ignore[union-attr]
    assert isinstance(glass.spectral_ior, DispersiveIndex)  # type: ignore[union-attr]
    assert glass.spectral_ior.values[0] > glass.spectral_ior.values[-1]  # type: ignore[union-attr]


def spectra_of(content: dict[str, Any]) -> tuple[dict[str, Any], Any]:
    """The arrays of a scene where wavelengths are rendered, and its own spectra."""
    flat = flatten(Scene.model_validate(content), 4, 4)
    arrays = spectral_arrays(flat.arrays, flat.spectral)
    return arrays, arrays["spectra"][layout.SPECTRA_GIVEN :].reshape(-1, 95)


def test_arrays_say_which_spectrum_stands_for_a_number() -> None:
    arrays, spectra = spectra_of(
        with_material(type="lambert", reflectance=RAMP)
        | {"lights": [{"type": "environment", "radiance": {"illuminant": "E", "scale": 3.0}}]}
    )
    row = arrays["materials"]["color"][0]
    assert row[:2].tolist() == [-1.0, 1.0] and 0.0 < row[3] < 1.0
    at = table_wavelengths()
    assert spectra[0] == pytest.approx(np.interp(at, RAMP["wavelengths"], RAMP["values"]), abs=1e-7)
    light = arrays["lights"]["radiance"][0]
    assert light[0] == -2.0 and spectra[1] * light[1] == pytest.approx(np.full(95, 3.0), rel=1e-3)


def test_indices_of_glass_are_spectra_of_their_own() -> None:
    arrays, spectra = spectra_of(with_material(type="dielectric", dispersion={"cauchy": [1.5, 0.004]}))
    number = int(-1.0 - arrays["materials"]["ior"][0])
    assert spectra[number] == pytest.approx(cauchy_indices((1.5, 0.004), table_wavelengths()), abs=1e-6)


def test_media_scatter_no_more_than_they_meet() -> None:
    content = described(
        media={"milk": {"absorption": [0.0, 0.1, 0.9], "scattering": [3.0, 2.0, 0.1]}},
        shapes=[{"type": "sphere", "center": [0.0, 0.0, 0.0], "radius": 1.0, "interior": "milk"}],
    )
    arrays, spectra = spectra_of(content)
    columns = layout.columns("MEDIUM")
    row = arrays["media_rows"][1]
    met, scattered = (spectra[int(-1.0 - row[columns[name]])] for name in ("EXTINCTION", "SCATTERING"))
    assert (scattered <= met).all() and (scattered > 0.0).all()
    assert reflectance_film_weights().T @ met == pytest.approx([3.0, 2.1, 1.0], rel=1e-5)


def test_a_scene_without_spectra_has_the_hash_that_it_had() -> None:
    flat = flatten(Scene.model_validate(described()), 4, 4)
    assert flat.spectral == () and not flat.features.dispersion
    said = {"wavelengths": [300.0, 900.0], "values": [0.5, 0.5]}
    other = flatten(Scene.model_validate(with_material(type="lambert", reflectance=said)), 4, 4)
    assert other.arrays_sha256 != flat.arrays_sha256


def test_integral_of_lines_is_exact() -> None:
    x = np.arange(95.0)
    assert integral(x, np.ones(95)) == pytest.approx(94.0**2 / 2.0) and integral(x, x) == pytest.approx(94.0**3 / 3.0)
