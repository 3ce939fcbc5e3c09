"""Spectra in the place of colours in a scene: they have a colour, and are spectra where wavelengths are rendered."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import pairwise
from typing import TYPE_CHECKING, Annotated, Any, Final, Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray
from pydantic import (
    AfterValidator,
    BeforeValidator,
    Discriminator,
    Field,
    PlainSerializer,
    Tag,
    WithJsonSchema,
    model_validator,
)

from clrender.exact.matrices import interpolated, times, total
from clrender.scene.values import (
    NUMBER_OR_TRIPLE,
    POWER_LIMIT,
    Color,
    Extinction,
    Finite,
    Index,
    Part,
    Power,
    Reflectance,
    fault,
    number_as_triple,
)
from clrender.spectra.colors import table_wavelengths
from clrender.spectra.film import film_color, reflectance_film_weights, sensor_table
from clrender.spectra.glasses import GLASSES, LINE_D, abbe_indices, cauchy_indices, sellmeier_indices
from clrender.spectra.illuminants import ILLUMINANTS, blackbody_spectrum, illuminant_spectrum
from clrender.wording import counted

__all__ = [
    "Coefficient",
    "Dispersion",
    "DispersiveIndex",
    "ExtinctionColor",
    "IndexColor",
    "LightColor",
    "Response",
    "SpectralColor",
    "Spectrum",
    "light_branch",
    "reflectance_branch",
    "spectrum_form",
]

_MOST_VALUES: Final = 4096
_MOST_INDEX: Final = 1000.0
LEAST_INDEX: Final = 1e-6
"""Of metals: below it, the square of its square is 0 in single precision, and Fresnel's formula has no value."""
_WIDTH: Final = 5.0
"""Distance of the lines of tables, nanometres."""


_Wavelengths: TypeAlias = Annotated[
    tuple[Annotated[Finite, Field(gt=0.0, le=1e6)], ...], Field(max_length=_MOST_VALUES)
]


def _check_table(wavelengths: tuple[float, ...], values: tuple[float, ...]) -> None:
    if len(wavelengths) != len(values):
        counts = f"{counted(len(wavelengths), 'wavelength')} and {counted(len(values), 'value')}"
        raise fault("spectrum", f"has {counts}; give a value for each wavelength", "values")
    if any(b <= a for a, b in pairwise(wavelengths)):
        raise fault("spectrum", "have to ascend; sort them, and leave out repeated ones", "wavelengths")


class Spectrum(Part):
    """A spectrum: a table, or, of light, an illuminant or a black body."""

    wavelengths: _Wavelengths = Field((), description="of `values`, nanometres, ascending; linear in between")
    values: Annotated[tuple[Power, ...], Field(max_length=_MOST_VALUES)] = Field(
        (), description="reflectance, constant beyond its ends, or of light per wavelength, and none beyond"
    )
    illuminant: Literal[ILLUMINANTS] | None = Field(  # type: ignore[valid-type]
        None, description="of the CIE, of luminance 1"
    )
    blackbody: Annotated[Finite, Field(ge=100.0, le=1e5)] | None = Field(
        None, description="temperature, kelvin; of luminance 1"
    )
    scale: Power = Field(1.0, description="factor of it")
    color: Color | None = Field(
        None, description="of a coefficient: what it is in red, green and blue; default: the spectrum's own colour"
    )

    @model_validator(mode="after")
    def _is_one(self) -> Spectrum:
        given = [bool(self.wavelengths or self.values), self.illuminant is not None, self.blackbody is not None]
        if sum(given) != 1:
            raise fault("spectrum", "needs wavelengths and values, or an illuminant, or a blackbody: one of these")
        _check_table(self.wavelengths, self.values)
        return self

    def light(self) -> NDArray[np.float64]:
        """Radiance at the lines of tables of spectra, (95,) float64."""
        if self.illuminant is not None:
            return illuminant_spectrum(self.illuminant) * self.scale
        if self.blackbody is not None:
            return blackbody_spectrum(self.blackbody) * self.scale
        return self._table(outside=0.0) * self.scale

    def reflectance(self) -> NDArray[np.float64]:
        """Shares of light there, (95,) float64."""
        return self._table(outside=None) * self.scale

    def _table(self, outside: float | None) -> NDArray[np.float64]:
        """The table at the lines; where it is finer than they are, means around them, so that no peak is missed."""
        at, given, values = table_wavelengths(), np.array(self.wavelengths), np.array(self.values)
        if len(given) == 1:
            width = 1.0 if outside is None else 0.0
            found = np.where(np.abs(at - given[0]) <= _WIDTH / 2.0, values[0], values[0] * width)
            return np.asarray(found, np.float64)
        if bool(np.all(given[1:] - given[:-1] >= _WIDTH)):
            return np.asarray(interpolated(at, given, values, outside), np.float64)
        fine = np.linspace(at[0] - _WIDTH / 2.0, at[-1] + _WIDTH / 2.0, 50 * len(at) + 1)
        middle = (fine[1:] + fine[:-1]) / 2.0
        means = total(interpolated(middle, given, values, outside).reshape(len(at), 50).T) / 50.0
        return np.asarray(means, np.float64)


_Sensitivities: TypeAlias = Annotated[tuple[Power, ...], Field(min_length=2, max_length=_MOST_VALUES)]


class Response(Part):
    """Sensitivity of a camera's three colours, relative to each other at different wavelengths."""

    wavelengths: Annotated[_Wavelengths, Field(min_length=2)] = Field(
        description="of the numbers, nanometres, ascending"
    )
    red: _Sensitivities = Field(description="response to light of 1 per wavelength; linear in between, 0 beyond")
    green: _Sensitivities
    blue: _Sensitivities
    white: Literal[ILLUMINANTS] = Field(  # type: ignore[valid-type]
        "D65", description="illuminant of the CIE that is white: of luminance 1 it is [1, 1, 1]"
    )

    @model_validator(mode="after")
    def _sees(self) -> Response:
        _check_table(self.wavelengths, self.wavelengths)
        for key in ("red", "green", "blue"):
            if len(getattr(self, key)) != len(self.wavelengths):
                counts = (
                    f"has {counted(len(getattr(self, key)), 'number')}, and there are "
                    f"{counted(len(self.wavelengths), 'wavelength')}"
                )
                raise fault("response", f"{counts}; give one for each", key)
            if not self._table(key).any():
                raise fault("response", "sees nothing from 360 to 830 nm; give the numbers of a sensor", key)
        return self

    def _table(self, key: str) -> NDArray[np.float64]:
        return Spectrum(wavelengths=self.wavelengths, values=getattr(self, key)).light()

    def film(self) -> NDArray[np.float64]:
        """What the film sees, (95, 4) float64: see `clrender.spectra.film.sensor_table`."""
        seen = np.stack([self._table(key) for key in ("red", "green", "blue")], axis=1)
        return sensor_table(seen, illuminant_spectrum(self.white))


class SpectralColor(tuple[float, float, float]):
    """The colour of a spectrum.

    Attributes
    ----------
    spectrum : Spectrum
    values : (95,) float64
        At the lines of tables of spectra: of light, or of a reflectance.
    """

    spectrum: Spectrum
    values: NDArray[np.float64]

    def __new__(cls, spectrum: Spectrum, values: NDArray[np.float64], color: Any) -> SpectralColor:
        """A colour, not negative."""
        made = super().__new__(cls, (max(0.0, float(x)) for x in color))
        made.spectrum, made.values = spectrum, values
        return made

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), (self.spectrum, self.values, tuple(self))

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, tuple):
            return NotImplemented
        same = tuple.__eq__(self, other)
        return bool(same) and (not isinstance(other, SpectralColor) or self.spectrum == other.spectrum)

    def __hash__(self) -> int:
        return tuple.__hash__(self)


def of_light(spectrum: Spectrum) -> SpectralColor:
    """The colour of light with this spectrum; what is out of the gamut of Rec. 709 is clipped."""
    _check_colorless(spectrum)
    values = spectrum.light()
    return SpectralColor(spectrum, values, film_color(values))


def of_reflectance(spectrum: Spectrum) -> SpectralColor:
    """The colour of a reflectance in daylight."""
    if spectrum.illuminant is not None or spectrum.blackbody is not None:
        raise fault("spectrum", "is of light; a reflectance needs wavelengths and values")
    _check_colorless(spectrum)
    values = spectrum.reflectance()
    if float(values.max()) > 1.0:
        raise fault("spectrum", f"has a reflectance of {float(values.max()):g}; at most 1 is possible", "values")
    color = reflectance_film_weights()
    shares = [float(total(color[:, channel] * values)) for channel in range(3)]
    return SpectralColor(spectrum, values, [min(share, 1.0) for share in shares])


def of_index(spectrum: Spectrum) -> SpectralColor:
    """The real part of an index of refraction, of which red, green and blue see the means in daylight."""
    found = of_extinction(spectrum)
    least = float(found.values.min())
    if not least >= LEAST_INDEX:
        raise fault("spectrum", f"has an index of {least:g}; at least {LEAST_INDEX:g} is known", "values")
    # A colour that is out of gamut is not 0 either
    return SpectralColor(spectrum, found.values, [max(each, LEAST_INDEX) for each in found])


def of_extinction(spectrum: Spectrum) -> SpectralColor:
    """The imaginary part, likewise."""
    if spectrum.illuminant is not None or spectrum.blackbody is not None:
        raise fault("spectrum", "is of light; an index needs wavelengths and values")
    _check_colorless(spectrum)
    values = spectrum.reflectance()
    if not float(values.max()) <= _MOST_INDEX:
        raise fault("spectrum", f"has an index of {float(values.max()):g}; at most {_MOST_INDEX:g} is known", "values")
    return SpectralColor(spectrum, values, times(reflectance_film_weights().T, values))


def of_coefficient(spectrum: Spectrum) -> SpectralColor:
    """A coefficient of a medium, of which red, green and blue see the means in daylight."""
    if spectrum.illuminant is not None or spectrum.blackbody is not None:
        raise fault("spectrum", "is of light; a coefficient needs wavelengths and values")
    values = spectrum.reflectance()
    if not float(values.max()) <= POWER_LIMIT:
        raise fault("spectrum", f"reaches {float(values.max()):g}; at most {POWER_LIMIT:g} is possible", "values")
    if spectrum.color is None:
        return SpectralColor(spectrum, values, times(reflectance_film_weights().T, values))
    if (max(spectrum.color) > 0.0) != bool(values.any()):
        raise fault("spectrum", "and the spectrum have to be 0 together, or neither of them", "color")
    return SpectralColor(spectrum, values, spectrum.color)


def _check_colorless(spectrum: Spectrum) -> None:
    if spectrum.color is not None:
        raise fault("spectrum", "is of coefficients of media; leave it out", "color")


def _said(value: Any) -> Any:
    return value.spectrum if isinstance(value, SpectralColor) else value


def _dumped(value: Any) -> dict[str, Any]:
    dumped: dict[str, Any] = value.spectrum.model_dump(mode="json", exclude_defaults=True)
    return dumped


def spectrum_form(value: Any) -> bool:
    """Whether a value is meant for a spectrum."""
    if isinstance(value, Mapping):
        return not value.keys().isdisjoint(("wavelengths", "values", "illuminant", "blackbody"))
    return isinstance(value, SpectralColor | Spectrum)


def _color_form(value: Any) -> str:
    return "<spectrum>" if isinstance(value, Mapping) or spectrum_form(value) else "<constant>"


_SCHEMA: Final = PlainSerializer(_dumped, return_type=dict[str, Any])
if TYPE_CHECKING:
    light_branch: TypeAlias = Color
    reflectance_branch: TypeAlias = Reflectance
    index_branch: TypeAlias = Color
    extinction_branch: TypeAlias = Color
    coefficient_branch: TypeAlias = Color
else:
    coefficient_branch: TypeAlias = Annotated[
        Spectrum, BeforeValidator(_said), AfterValidator(of_coefficient), _SCHEMA, Tag("<spectrum>")
    ]
    index_branch: TypeAlias = Annotated[
        Spectrum, BeforeValidator(_said), AfterValidator(of_index), _SCHEMA, Tag("<spectrum>")
    ]
    extinction_branch: TypeAlias = Annotated[
        Spectrum, BeforeValidator(_said), AfterValidator(of_extinction), _SCHEMA, Tag("<spectrum>")
    ]
    light_branch: TypeAlias = Annotated[
        Spectrum, BeforeValidator(_said), AfterValidator(of_light), _SCHEMA, Tag("<spectrum>")
    ]
    reflectance_branch: TypeAlias = Annotated[
        Spectrum, BeforeValidator(_said), AfterValidator(of_reflectance), _SCHEMA, Tag("<spectrum>")
    ]
_MetalIndex = Annotated[Index, Field(ge=LEAST_INDEX)]
_Indices: TypeAlias = Annotated[
    tuple[_MetalIndex, _MetalIndex, _MetalIndex],
    BeforeValidator(number_as_triple),
    WithJsonSchema(NUMBER_OR_TRIPLE),
    Tag("<constant>"),
]
_Extinctions: TypeAlias = Annotated[
    tuple[Extinction, Extinction, Extinction],
    BeforeValidator(number_as_triple),
    WithJsonSchema(NUMBER_OR_TRIPLE),
    Tag("<constant>"),
]
IndexColor: TypeAlias = Annotated[_Indices | index_branch, Discriminator(_color_form)]
"""The real part of an index of refraction: at red, green and blue, or a spectrum."""
ExtinctionColor: TypeAlias = Annotated[_Extinctions | extinction_branch, Discriminator(_color_form)]
"""The imaginary part, likewise."""
Coefficient: TypeAlias = Annotated[Annotated[Color, Tag("<constant>")] | coefficient_branch, Discriminator(_color_form)]
"""A coefficient of a medium: of red, green and blue, or a spectrum."""
LightColor: TypeAlias = Annotated[Annotated[Color, Tag("<constant>")] | light_branch, Discriminator(_color_form)]
"""The colour of light: red, green and blue, or a spectrum."""


class Dispersion(Part):
    """How an index of refraction depends on the wavelength: by a glass's name, an Abbe number, or an equation."""

    glass: Literal[tuple(GLASSES)] | None = Field(None, description="the substance")  # type: ignore[valid-type]
    abbe: Annotated[Finite, Field(ge=1.0, le=1e6)] | None = Field(
        None, description="(n(d) - 1) / (n(F) - n(C)), beside `ior`, which is n(d)"
    )
    cauchy: Annotated[tuple[Finite, ...], Field(min_length=1, max_length=6)] | None = Field(
        None, description="A, B, ...: n = A + B / w^2 + C / w^4 ..., w in micrometres"
    )
    sellmeier: Annotated[tuple[Finite, ...], Field(min_length=2, max_length=12)] | None = Field(
        None, description="B1, C1, B2, C2, ...: n^2 = 1 + the sum of B w^2 / (w^2 - C), w in micrometres"
    )

    wavelengths: _Wavelengths = Field((), description="of `values`, nanometres, ascending; linear in between")
    values: Annotated[tuple[Finite, ...], Field(max_length=_MOST_VALUES)] = Field(
        (), description="indices at these wavelengths, constant beyond"
    )

    @model_validator(mode="after")
    def _is_one(self) -> Dispersion:
        given = [name for name in ("glass", "abbe", "cauchy", "sellmeier") if getattr(self, name) is not None]
        given += ["values"] if self.wavelengths or self.values else []
        if len(given) != 1:
            raise fault("dispersion", "needs one of glass, abbe, cauchy, sellmeier and a table")
        _check_table(self.wavelengths, self.values)
        if self.sellmeier is not None and len(self.sellmeier) % 2:
            raise fault("dispersion", f"has {counted(len(self.sellmeier), 'number')}; give a C for each B", "sellmeier")
        if self.abbe is None:
            self._check(self._indices(table_wavelengths(), 1.0), given[0])
        return self

    def indices(self, ior: float) -> DispersiveIndex:
        """The index at the line d, and at all lines of tables of spectra.

        Parameters
        ----------
        ior : float
            Index at the line d, where there is an Abbe number.
        """
        values = self._indices(table_wavelengths(), ior)
        at_d = ior if self.abbe is not None else float(self._indices(np.array([LINE_D]), ior)[0])
        return DispersiveIndex(at_d, values)

    def _indices(self, wavelengths: NDArray[np.float64], ior: float) -> NDArray[np.float64]:
        if self.glass is not None:
            return sellmeier_indices(GLASSES[self.glass], wavelengths)
        if self.sellmeier is not None:
            return sellmeier_indices(self.sellmeier, wavelengths)
        if self.cauchy is not None:
            return cauchy_indices(self.cauchy, wavelengths)
        if self.values:
            return np.asarray(interpolated(wavelengths, self.wavelengths, self.values), np.float64)
        assert self.abbe is not None
        return abbe_indices(ior, self.abbe, wavelengths)

    def _check(self, values: NDArray[np.float64], key: str) -> None:
        with np.errstate(invalid="ignore"):
            sound = bool(np.all((values >= 1.0) & (values <= 10.0)))
        if not sound:
            raise fault("dispersion", "gives an index that is not from 1 to 10 between 360 and 830 nm", key)


class DispersiveIndex(float):
    """An index of refraction at the line d, where wavelengths are not rendered, and its values.

    Attributes
    ----------
    values : (95,) float64
        At the lines of tables of spectra.
    """

    values: NDArray[np.float64]

    def __new__(cls, at_d: float, values: NDArray[np.float64]) -> DispersiveIndex:
        made = super().__new__(cls, at_d)
        made.values = values
        return made

    def over(self, other: float) -> DispersiveIndex:
        """The same relative to another index."""
        return DispersiveIndex(float(self) / other, self.values / other)

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, DispersiveIndex):
            return False
        return float(self) == float(other) and self.values.tobytes() == other.values.tobytes()

    def __ne__(self, other: object) -> bool:
        return not self == other

    def __hash__(self) -> int:
        return hash((float(self), self.values.tobytes()))
