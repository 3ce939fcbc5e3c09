"""The sensor: radiance to numbers as a camera would record them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from clrender.errors import UsageError
from clrender.exact.angles import power_of_two
from clrender.exact.counters import key_of, philox, units
from clrender.image.exact_display import srgb_bytes
from clrender.limits import Choice, Domain, Flag, NotAllowed, Range
from clrender.sensor.bayer import PATTERNS, demosaiced, filter_colors
from clrender.sensor.noise import normal, poisson

__all__ = ["DOMAINS", "Sensor"]

_SHOT, _READ = 0, 1
_CHUNK: Final = 1 << 18
"""Pixels at a time, which keeps temporaries small."""

DOMAINS: Final[dict[str, Domain]] = {
    "full_well": Range(1.0, 1e7),
    "exposure": Range(-64.0, 64.0),
    "read_noise": Range(0.0, 1e5),
    "bits": Range(1, 16, whole=True),
    "black_level": Range(0, 65534, whole=True),
    "gain": Range(0.0, 1e6, above=True),
    "bayer": Choice(tuple(PATTERNS)),
    "encoding": Choice(("linear", "srgb")),
    "shot_noise": Flag(),
    "demosaic": Flag(),
}
"""Allowed values; None is allowed for `gain` and `bayer` too."""


@dataclass(frozen=True)
class Sensor:
    """An image sensor. A radiance of 1 fills its pixels at an exposure of 0.

    Each pixel gets a number of photoelectrons of Poisson's law, at most the full well, to which normally distributed
    read noise is added. Amplified and offset by the black level, it is rounded half to even and clipped to the range of
    its bits.

    Attributes
    ----------
    full_well : float
        Electrons that a pixel holds.
    exposure : float
        Stops: electrons are full_well x 2^exposure x radiance.
    read_noise : float
        Standard deviation, electrons.
    shot_noise : bool
        Whether numbers of electrons are random; else they are their means.
    bits : int
        Of the numbers that are recorded, 1 to 16.
    black_level : int
        The number that no light gives.
    gain : float or None
        Numbers per electron; None: the full well gives the largest number.
    bayer : str or None
        The filters over the first two pixels of the first two rows, ``rggb``, ``bggr``, ``grbg`` or ``gbrg``; None:
        every pixel measures three colours.
    demosaic : bool
        Whether `image` interpolates the colours of a mosaic, bilinearly.
    encoding : str
        ``linear``: images hold the recorded numbers; ``srgb``: 8 bits, from the black level to the largest number.

    Raises
    ------
    UsageError
        A value is not allowed.
    """

    full_well: float = 20000.0
    exposure: float = 0.0
    read_noise: float = 2.0
    shot_noise: bool = True
    bits: int = 12
    black_level: int = 0
    gain: float | None = None
    bayer: str | None = None
    demosaic: bool = True
    encoding: str = "linear"

    def __post_init__(self) -> None:
        for name, domain in DOMAINS.items():
            value = getattr(self, name)
            if value is None and name in ("gain", "bayer"):
                continue
            try:
                object.__setattr__(self, name, domain.accept(value))
            except NotAllowed as error:
                raise UsageError(f"{name} {error}") from None
        if self.black_level >= self.largest:
            raise UsageError(
                f"black_level is {self.black_level}, but must be below {self.largest}, the largest number of "
                f"{self.bits} bits"
            )

    @property
    def largest(self) -> int:
        """The largest number that is recorded."""
        return (1 << self.bits) - 1

    @property
    def numbers_per_electron(self) -> float:
        """The gain."""
        return (self.largest - self.black_level) / self.full_well if self.gain is None else self.gain

    def raw(self, linear: npt.ArrayLike, seed: int = 0, index: int = 0) -> npt.NDArray[np.uint16]:
        """The numbers that the sensor records.

        Parameters
        ----------
        linear : (height, width, 3) floats
            Radiance; negative values and NaN count as 0.
        seed : int
            Of the noise.
        index : int
            Number of the image: each has its own noise, below 2^32.

        Returns
        -------
        (height, width) or (height, width, 3) uint16
            The former with a `bayer` mosaic. The same bits on every machine.

        Raises
        ------
        UsageError
            `linear` is no image, or a number is out of range.
        """
        image = _checked(linear)
        if not (isinstance(index, int) and 0 <= index < 1 << 32):
            raise UsageError(f"index is {index!r}, but must be a whole number from 0 to 4294967295")
        height, width = image.shape[:2]
        if self.bayer is not None:
            if min(height, width) < 2:
                raise UsageError(f"an image of {width} x {height} pixels has no mosaic; two a side are needed")
            channels = filter_colors(self.bayer, height, width)
            image = np.take_along_axis(image, channels[..., None], axis=2)[..., 0]
        light = image.reshape(-1)
        numbers, key = np.empty(len(light), np.uint16), key_of(seed, "sensor")
        for first in range(0, len(light), _CHUNK):
            part = slice(first, first + _CHUNK)
            numbers[part] = self._recorded(light[part], first, key, index)
        return numbers.reshape(image.shape)

    def _recorded(self, light: npt.NDArray[np.float32], first: int, key: int, index: int) -> npt.NDArray[np.uint16]:
        """Numbers of some pixels, the first of which has this number in the image."""
        values = np.nan_to_num(light.astype(np.float64), nan=0.0, posinf=1e30, neginf=0.0)
        # What is far brighter fills the well anyhow
        means = np.clip(values * (power_of_two(self.exposure) * self.full_well), 0.0, 16.0 * self.full_well + 1000.0)

        def uniforms(
            purpose: int, pixels: npt.NDArray[np.int64], attempt: int
        ) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
            return units(philox(key, (pixels + first, purpose, attempt, index)))

        electrons = means
        if self.shot_noise:
            electrons = poisson(means, lambda pixels, attempt: uniforms(_SHOT, pixels, attempt)).astype(np.float64)
        electrons = np.minimum(electrons, self.full_well)
        if self.read_noise > 0.0:
            every = np.arange(len(light))
            noise = normal(every, lambda pixels, attempt: uniforms(_READ, pixels, attempt))
            electrons = electrons + self.read_noise * noise
        numbers = np.rint(self.black_level + self.numbers_per_electron * electrons)
        return np.clip(numbers, 0.0, self.largest).astype(np.uint16)

    def image(self, linear: npt.ArrayLike, seed: int = 0, index: int = 0) -> npt.NDArray[Any]:
        """The image that a camera with this sensor would write.

        Parameters
        ----------
        linear : (height, width, 3) floats
            Radiance.
        seed, index : int
            See `raw`.

        Returns
        -------
        (height, width, 3) uint8 or uint16, or (height, width) of a mosaic
            uint8 with up to 8 bits or the encoding ``srgb``, else uint16.

        Raises
        ------
        UsageError
            See `raw`.
        """
        numbers: npt.NDArray[Any] = self.raw(linear, seed, index)
        if self.bayer is not None and self.demosaic:
            numbers = demosaiced(numbers, self.bayer)
        if self.encoding == "srgb":
            return srgb_bytes((numbers.astype(np.float64) - self.black_level) / (self.largest - self.black_level))
        return numbers.astype(np.uint8 if self.bits <= 8 else np.uint16)


def _checked(linear: npt.ArrayLike) -> npt.NDArray[np.float32]:
    try:
        image = np.asarray(linear, np.float32)
    except (TypeError, ValueError):
        image = np.zeros(0, np.float32)
    if image.ndim != 3 or image.shape[2] != 3 or 0 in image.shape:
        raise UsageError(f"linear has the shape {image.shape}, but must be an image of (height, width, 3) numbers")
    return image
