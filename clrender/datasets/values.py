"""Values of a data set that are drawn for each image: distributions in the place of values of a scene file.

A table with one of the keys of `DISTRIBUTIONS` is a distribution; all other values are themselves, and lists and
tables may hold distributions.
"""

from __future__ import annotations

import difflib
import math
from collections.abc import Callable, Mapping
from typing import Any, Final

from clrender.exact.angles import exponential_of, logarithm_of, sin_cos
from clrender.exact.counters import Draws
from clrender.scene.values import fault
from clrender.spectra.colors import blackbody_color
from clrender.wording import shown

__all__ = ["DISTRIBUTIONS", "checked_value", "drawn", "named_in"]

DISTRIBUTIONS: Final[Mapping[str, tuple[str, ...]]] = {
    "uniform": (),
    "log_uniform": (),
    "normal": ("within",),
    "integer": (),
    "choice": ("weights",),
    "temperature": ("power",),
}
"""Keys of distributions, and the other keys that they may have."""

_ATTEMPTS: Final = 1000
_NEAR: Final = 0.8
"""Similarity from which a key is a distribution's, misspelt: no key of a scene file is so near."""
_LUMINANCE: Final = (0.2126, 0.7152, 0.0722)
_KELVIN: Final = (100.0, 1e5)


def _kind(value: Any) -> str | None:
    """Which distribution a value is; None if it is none."""
    if not isinstance(value, Mapping):
        return None
    kinds = [key for key in value if key in DISTRIBUTIONS]
    if len(kinds) == 1 and set(value) <= {kinds[0], *DISTRIBUTIONS[kinds[0]]}:
        return str(kinds[0])
    return None


def checked_value(value: Any) -> Any:
    """Check the distributions in a value, for models of pydantic.

    Raises
    ------
    pydantic_core.PydanticCustomError
        See `clrender.scene.values.fault`.
    """
    _check(value, ())
    return value


def named_in(value: Any) -> list[str]:
    """The names that a value is, or that are drawn for it."""
    if isinstance(value, str):
        return [value]
    return [name for each in value["choice"] for name in named_in(each)] if _kind(value) == "choice" else []


def _check(value: Any, at: tuple[str | int, ...]) -> None:
    kind = _kind(value)
    if kind is not None:
        _CHECKS[kind](value, at)
    elif isinstance(value, Mapping):
        for key, each in value.items():
            near = difflib.get_close_matches(str(key)[:40], DISTRIBUTIONS, n=1, cutoff=_NEAR)
            if near and key != near[0] and len(value) <= 2:
                raise fault("value", f"is no distribution; did you mean {near[0]}?", *at, str(key))
            _check(each, (*at, str(key)))
    elif isinstance(value, list | tuple):
        for index, each in enumerate(value):
            _check(each, (*at, index))
    elif isinstance(value, float) and not math.isfinite(value):
        raise fault("value", f"is {shown(value)}, but must be a finite number", *at)


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)


def _pair(value: Mapping[str, Any], kind: str, at: tuple[str | int, ...]) -> tuple[Any, Any]:
    """The two ends of an interval: numbers, or lists of as many."""
    given = value[kind]
    if isinstance(given, list | tuple) and len(given) == 2:
        low, high = given
        if _is_number(low) and _is_number(high):
            return low, high
        lists = all(isinstance(end, list | tuple) for end in given)
        if lists and len(low) == len(high) > 0 and all(_is_number(each) for each in (*low, *high)):
            return low, high
    example = {"normal": "[mean, deviation]"}.get(kind, "[lowest, highest]")
    raise fault("value", f"is {shown(given)}, but must be {example}: two numbers, or two lists of as many", *at, kind)


def _ends(low: Any, high: Any) -> list[tuple[float, float]]:
    return list(zip(low, high, strict=True)) if isinstance(low, list | tuple) else [(low, high)]


def _check_interval(value: Mapping[str, Any], at: tuple[str | int, ...]) -> None:
    kind = _kind(value) or ""
    for low, high in _ends(*_pair(value, kind, at)):
        if low > high:
            raise fault("value", f"goes from {low} to {high}; give the smaller number first", *at, kind)
        if kind == "log_uniform" and low <= 0.0:
            raise fault("value", f"begins at {low}, but must begin above 0", *at, kind)
        if kind == "integer" and not (isinstance(low, int) and isinstance(high, int)):
            raise fault("value", f"goes from {low} to {high}, but must have whole numbers", *at, kind)


def _check_normal(value: Mapping[str, Any], at: tuple[str | int, ...]) -> None:
    for mean, deviation in _ends(*_pair(value, "normal", at)):
        if deviation < 0.0:
            raise fault("value", f"has a deviation of {deviation}, but it must not be negative", *at, "normal")
        if "within" in value:
            low, high = _pair(value, "within", at)
            if not (_is_number(low) and _is_number(high) and low < high):
                raise fault("value", "must be two numbers, the smaller first", *at, "within")
            if not low <= mean <= high:
                raise fault("value", f"goes from {low} to {high}, which leaves out the mean {mean}", *at, "within")


def _check_choice(value: Mapping[str, Any], at: tuple[str | int, ...]) -> None:
    given = value["choice"]
    if not isinstance(given, list | tuple) or not given:
        raise fault("value", f"is {shown(given)}, but must be a list of what is chosen from", *at, "choice")
    weights = value.get("weights")
    if weights is not None:
        sound = isinstance(weights, list | tuple) and all(isinstance(each, int) and each >= 0 for each in weights)
        if not sound or len(weights) != len(given) or not 0 < sum(weights) < 1 << 62:
            text = f"must be {len(given)} whole numbers of at least 0, one for each choice, and not all 0"
            raise fault("value", text, *at, "weights")
    for index, each in enumerate(given):
        _check(each, (*at, "choice", index))


def _check_temperature(value: Mapping[str, Any], at: tuple[str | int, ...]) -> None:
    for key in ("temperature", "power"):
        if key in value:
            _check(value[key], (*at, key))
            if not (_is_number(value[key]) or _kind(value[key]) in ("uniform", "log_uniform", "normal", "choice")):
                raise fault("value", f"is {shown(value[key])}, but must be a number or its distribution", *at, key)


_CHECKS: Final[Mapping[str, Callable[[Mapping[str, Any], tuple[str | int, ...]], None]]] = {
    **dict.fromkeys(("uniform", "log_uniform", "integer"), _check_interval),
    "normal": _check_normal,
    "choice": _check_choice,
    "temperature": _check_temperature,
}


def drawn(value: Any, draws: Callable[[str], Draws], place: str = "") -> Any:
    """A value with a number, or whatever is chosen, in the place of each distribution.

    Parameters
    ----------
    value
        That `checked_value` accepts.
    draws : callable
        Random numbers for the distribution at a place within the value: each has its own, whatever the order of tables.
    place : str
        Of the value.
    """
    kind = _kind(value)
    if kind is None:
        if isinstance(value, Mapping):
            return {key: drawn(each, draws, f"{place}.{key}") for key, each in value.items()}
        if isinstance(value, list | tuple):
            return [drawn(each, draws, f"{place}[{index}]") for index, each in enumerate(value)]
        return value
    if kind == "choice":
        index = _chosen(value, draws(place))
        return drawn(value["choice"][index], draws, f"{place}.choice[{index}]")
    if kind == "temperature":
        kelvin = drawn(value["temperature"], draws, f"{place}.temperature")
        return _light(kelvin, drawn(value.get("power", 1.0), draws, f"{place}.power"))
    low, high = value[kind]
    one = {"uniform": _uniform, "log_uniform": _log_uniform, "integer": _integer, "normal": _normal}[kind]
    numbers = draws(place)
    if isinstance(low, list | tuple):
        return [one(*ends, value, numbers) for ends in zip(low, high, strict=True)]
    return one(low, high, value, numbers)


def _chosen(value: Mapping[str, Any], draws: Draws) -> int:
    weights = value.get("weights")
    if weights is None:
        return draws.below(len(value["choice"]))
    left = draws.below(sum(weights))
    for index, weight in enumerate(weights):
        left -= weight
        if left < 0:
            return index
    raise AssertionError("unreachable")


def _uniform(low: float, high: float, _value: Mapping[str, Any], draws: Draws) -> float:
    return min(max(low + (high - low) * draws.unit(), float(low)), float(high))


def _log_uniform(low: float, high: float, _value: Mapping[str, Any], draws: Draws) -> float:
    first, last = logarithm_of(low), logarithm_of(high)
    return min(max(exponential_of(first + (last - first) * draws.unit()), float(low)), float(high))


def _integer(low: int, high: int, _value: Mapping[str, Any], draws: Draws) -> int:
    return low + draws.below(high - low + 1)


def _normal(mean: float, deviation: float, value: Mapping[str, Any], draws: Draws) -> float:
    """By Box and Muller; numbers outside of `within` are drawn again."""
    low, high = value.get("within", (-math.inf, math.inf))
    number = float(mean)
    for _ in range(_ATTEMPTS):
        radius = math.sqrt(-2.0 * logarithm_of(1.0 - draws.unit()))
        number = mean + deviation * (radius * sin_cos(2.0 * math.pi * draws.unit())[1])
        if low <= number <= high:
            return number
    return min(max(number, float(low)), float(high))


def _light(kelvin: float, power: float) -> list[float]:
    """The colour of a black body, with this luminance."""
    kelvin = min(max(kelvin, _KELVIN[0]), _KELVIN[1])
    red, green, blue = blackbody_color(kelvin)
    luminance = (_LUMINANCE[0] * red + _LUMINANCE[1] * green) + _LUMINANCE[2] * blue
    return [max(0.0, power) * each / luminance for each in (red, green, blue)]
