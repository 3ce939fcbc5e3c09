"""Random materials, media and textures of mixed scenes: of all types, with every key that the schema has."""

from __future__ import annotations

import json
import random
from collections.abc import Sequence
from typing import Any, TypeAlias, TypeVar

from mixed_files import COLOR_PICTURES, NUMBER_PICTURES

from clrender.scene.metals import METALS

__all__ = ["Draw", "Json", "emission_for_white", "mapping", "material", "medium", "texture"]

Json: TypeAlias = dict[str, Any]
_T = TypeVar("_T")
_TYPES = ("lambert", "mirror", "dielectric", "oren_nayar", "conductor", "principled", "subsurface", "mix")


class Draw:
    """Random choices of one scene, a function of its name only.

    Parameters
    ----------
    name : str
        Kind and number of the scene.
    white : bool
        Whether nothing may absorb light or depend on the side from which it is seen.
    """

    def __init__(self, name: str, white: bool) -> None:
        self._random = random.Random(name)
        self.white = white

    def unit(self) -> float:
        """Uniform in [0, 1)."""
        return self._random.random()

    def chance(self, probability: float) -> bool:
        """True with this probability."""
        return self.unit() < probability

    def between(self, low: float, high: float) -> float:
        """Uniform, of few digits: scenes are read by people."""
        return float(f"{low + (high - low) * self.unit():.4g}")

    def decades(self, low: float, high: float) -> float:
        """Uniform in the logarithm, between powers of ten."""
        return float(f"{10.0 ** (low + (high - low) * self.unit()):.4g}")

    def one(self, things: Sequence[_T]) -> _T:
        """One of them."""
        return things[int(self.unit() * len(things))]

    def count(self, low: int, high: int) -> int:
        """An integer from `low` to `high`."""
        return low + int(self.unit() * (high - low + 1))

    def color(self, low: float = 0.05, high: float = 0.9) -> list[float]:
        """Three of them."""
        return [self.between(low, high) for _ in range(3)]

    def direction(self) -> list[float]:
        """A vector of length 0.5 to 1.7."""
        vector = [self.between(-1.0, 1.0) for _ in range(3)]
        return vector if sum(x * x for x in vector) > 0.25 else self.direction()

    def point(self, reach: float) -> list[float]:
        """In a cube around the origin."""
        return [self.between(-reach, reach) for _ in range(3)]


def texture(draw: Draw, low: float, high: float, number: bool) -> Json:
    """A texture whose values lie between two numbers; pictures have values from 0 to 1 times `high`.

    Parameters
    ----------
    draw : Draw
    low, high : float
    number : bool
        Whether it stands for a number, rather than for a colour.
    """

    def value() -> Any:
        return draw.between(low, high) if number or draw.chance(0.5) else draw.color(low, high)

    kind = draw.one(("checker", "ramp", "picture"))
    made: Json
    if kind == "checker":
        made = {"checker": [value(), value()]}
        if draw.chance(0.5):
            made["size"] = draw.one((0.125, [0.25, 0.1]))
    elif kind == "ramp":
        made = {"ramp": [value() for _ in range(draw.count(2, 4))]}
    else:
        made = {"texture": draw.one(NUMBER_PICTURES if number else COLOR_PICTURES), "scale": high}
        made |= _optional(draw, wrap=lambda: draw.one(("repeat", "clamp", "mirror", ["mirror", "clamp"])))
        made |= _optional(draw, filter=lambda: draw.one(("linear", "nearest")))
        if number or draw.chance(0.2):
            channels = ("r", "g", "b", "luminance", *(("a",) if made["texture"] == "alpha.png" else ()))
            made |= _optional(draw, channel=lambda: draw.one(channels))
        elif draw.chance(0.3):
            made["scale"] = draw.color(low, high)
        if made["texture"].endswith(("png", "webp", "jpg")):
            made |= _optional(draw, color_space=lambda: draw.one(("srgb", "linear")))
    return made | mapping(draw)


def _optional(draw: Draw, **keys: Any) -> Json:
    return {key: make() for key, make in keys.items() if draw.chance(0.4)}


def mapping(draw: Draw) -> Json:
    """Set and transform of texture coordinates, as all textures may have them.

    Parameters
    ----------
    draw : Draw
    """
    made: Json = {"uv_set": draw.one((0, 1))} if draw.chance(0.3) else {}
    if draw.chance(0.4):
        made["transform"] = _optional(
            draw,
            offset=lambda: [draw.between(-2, 2), draw.between(-2, 2)],
            rotate_degrees=lambda: draw.between(-180, 180),
            scale=lambda: draw.one((3.0, [2.0, -1.5])),
        )
    return made


def medium(draw: Draw, depth: float = 3.0) -> Json:
    """A medium of at most so many mean free paths per metre."""
    depth *= 10.0 if draw.white and draw.chance(0.2) else 1.0
    made: Json = {"scattering": draw.one((draw.between(0.1, depth), draw.color(0.1, depth)))}
    made |= _optional(draw, g=lambda: draw.between(-0.8, 0.9))
    if not draw.white:
        made |= _optional(draw, absorption=lambda: draw.one((draw.between(0.1, 1.0), draw.color(0.1, 1.0))))
        if draw.chance(0.2):
            made = {"absorption": draw.color(0.1, 1.0)}
    return made


def _share(draw: Draw, low: float = 0.0, high: float = 1.0) -> Any:
    """A number, or a texture of one."""
    return texture(draw, low, high, number=True) if draw.chance(0.3) else draw.between(low, high)


def _color(draw: Draw, low: float = 0.05, high: float = 0.9) -> Any:
    if draw.white:
        plain = ([1.0, 1.0, 1.0], {"checker": [1.0, 1.0]}, {"ramp": [1.0, [1.0, 1.0, 1.0]]}, {"texture": "white.png"})
        return plain[0] if draw.chance(0.6) else draw.one(plain)
    return texture(draw, low, high, number=False) if draw.chance(0.35) else draw.color(low, high)


def _roughness(draw: Draw) -> Any:
    """Not so low that light samples alone would rarely find what it reflects; 0 is smooth."""
    return 0.0 if draw.chance(0.2) else _share(draw, 0.02 if draw.white else 0.3, 1.0)


def _facets(draw: Draw) -> Json:
    made = _optional(draw, microfacets=lambda: draw.one(("ggx", "beckmann")))
    return made | ({} if draw.white else _optional(draw, multiple_scattering=lambda: draw.chance(0.5)))


def _lambert(draw: Draw) -> Json:
    return {"reflectance": _color(draw)}


def _mirror(draw: Draw) -> Json:
    return _optional(draw, reflectance=lambda: _color(draw))


def _oren_nayar(draw: Draw) -> Json:
    return {"reflectance": _color(draw), **_optional(draw, roughness=lambda: _share(draw))}


def _conductor(draw: Draw) -> Json:
    made = {"f0": _color(draw, 0.2)}
    if not draw.white:
        index = {"eta": draw.color(0.2, 3.0), "k": draw.color(1.0, 5.0)}
        made = draw.one((made, {"metal": draw.one(tuple(METALS))}, index))
    made |= _facets(draw) | {"roughness": _roughness(draw)} | _anisotropy(draw)
    return made


def _anisotropy(draw: Draw) -> Json:
    made = _optional(draw, anisotropy=lambda: _share(draw))
    return made | (_optional(draw, anisotropy_rotation=lambda: draw.between(-180, 180)) if made else {})


def _attenuation(draw: Draw) -> Json:
    if draw.white or draw.chance(0.5):
        return {}
    return {"attenuation_color": draw.color(0.2, 0.95), "attenuation_distance": draw.between(0.2, 2.0)}


def _dielectric(draw: Draw) -> Json:
    made = {"ior": draw.one((1.0, draw.between(1.1, 2.2))), "roughness": _roughness(draw), **_facets(draw)}
    if draw.chance(0.25):
        return {**made, "thin": True} | _optional(draw, exterior_ior=lambda: draw.between(1.0, 1.4))
    made |= _attenuation(draw)
    if draw.chance(0.5):
        return {**made, "priority": draw.count(0, 4)}
    return made | _optional(draw, exterior_ior=lambda: draw.between(1.0, 1.4))


def _principled(draw: Draw) -> Json:
    made: Json = _optional(
        draw,
        base_color=lambda: _color(draw),
        metallic=lambda: _share(draw),
        roughness=lambda: _share(draw, 0.02 if draw.white else 0.3),
        ior=lambda: draw.between(1.0, 2.0),
        specular=lambda: _share(draw),
        specular_color=lambda: texture(draw, 0.1, 1.0, number=False) if draw.chance(0.3) else draw.color(0.1, 1.0),
        diffuse_roughness=lambda: _share(draw),
        coat=lambda: _share(draw),
        coat_roughness=lambda: _share(draw, 0.02 if draw.white else 0.3),
        sheen_color=lambda: texture(draw, 0.1, 1.0, number=False) if draw.chance(0.3) else draw.color(0.1, 1.0),
        sheen_roughness=lambda: _share(draw, 0.1),
    )
    if draw.white and "sheen_color" in made:
        # What is below a coloured sheen loses by its largest channel (KHR_materials_sheen), so others are not white
        sheen = made["sheen_color"]
        made["sheen_color"] = [max(sheen) if isinstance(sheen, list) else 0.6] * 3
    made |= _anisotropy(draw)
    if draw.chance(0.4):
        made["transmission"] = draw.one((1.0, _share(draw)))
        if draw.white:  # light that a layer reflects back into glass is lost
            made = {key: value for key, value in made.items() if not key.startswith(("coat", "sheen"))}
        made |= {"thin": True} if draw.chance(0.4) else _attenuation(draw)
    elif not draw.white and draw.chance(0.15):
        made["emission"] = texture(draw, 0.1, 0.9, number=False) if draw.chance(0.5) else draw.color()
        made |= _optional(draw, emission_strength=lambda: draw.between(0.5, 2.0))
    if not made.keys() & {"transmission", "coat", "sheen_color"}:
        made |= _optional(draw, microfacets=lambda: draw.one(("ggx", "beckmann")))
    return made


def _subsurface(draw: Draw) -> Json:
    made: Json = {"albedo": 1.0} if draw.white else {"albedo": draw.one((draw.between(0.1, 0.9), draw.color()))}
    made["radius"] = draw.one((draw.between(0.1, 0.4), draw.color(0.1, 0.4)))
    made |= _optional(draw, g=lambda: draw.between(-0.8, 0.8), priority=lambda: draw.count(0, 4))
    if draw.chance(0.4):
        made |= {"ior": draw.between(1.1, 1.6)} | _optional(draw, roughness=lambda: _roughness(draw))
    return made


_MAKERS = {
    "lambert": _lambert,
    "mirror": _mirror,
    "dielectric": _dielectric,
    "oren_nayar": _oren_nayar,
    "conductor": _conductor,
    "principled": _principled,
    "subsurface": _subsurface,
}


def material(draw: Draw, kind: str | None = None) -> Json:
    """A material of this type or of any; a mixture still lacks the names of its parts.

    Parameters
    ----------
    draw : Draw
    kind : str, optional
        Type.
    """
    kind = kind or draw.one(_TYPES)
    if kind == "mix":
        made: Json = {"type": kind, **_optional(draw, weight=lambda: _share(draw))}
    else:
        made = {"type": kind, **_MAKERS[kind](draw)}
        if draw.chance(0.25):
            made["normal_map"] = {"texture": "flat.png" if draw.white else "bent.png", **mapping(draw)}
            made["normal_map"] |= _optional(
                draw,
                scale=lambda: draw.between(-1.0, 1.0),
                wrap=lambda: draw.one(("repeat", "clamp", ["mirror", "repeat"])),
                filter=lambda: draw.one(("linear", "nearest")),
            )
        elif not draw.white and draw.chance(0.15):
            made["bump_map"] = {
                "texture": draw.one(("heights.png", "alpha.png")),
                "scale": draw.between(-0.1, 0.1),
                **mapping(draw),
            }
            made["bump_map"] |= _optional(
                draw,
                wrap=lambda: draw.one(("repeat", "mirror", ["clamp", "repeat"])),
                channel=lambda: draw.one(("r", "g", "b", "a", "luminance")),
            )
    made |= _optional(draw, termination=lambda: draw.between(0.05, 0.3))
    if kind in ("lambert", "mirror", "oren_nayar", "conductor", "principled") and not draw.white:
        made |= {"two_sided": draw.chance(0.5)} if draw.chance(0.3) else {}
    solid = kind in ("dielectric", "subsurface") or made.get("transmission", 0.0) != 0.0
    if kind == "principled" and not solid and made.get("two_sided", True):
        aside = Draw(json.dumps(made), draw.white)  # apart, so that all else of the scenes stays as it was
        if aside.chance(0.3):
            made["diffuse_transmission"] = aside.one((1.0, aside.between(0.1, 0.9)))
            if not aside.white and aside.chance(0.7):
                made["diffuse_transmission_color"] = aside.color()
    if (not solid or made.get("thin")) and draw.chance(0.25):
        made["opacity"] = _share(draw, 0.1, 1.0)
        if draw.chance(0.4):
            made["opacity_cutoff"] = draw.between(0.2, 0.8)
    return made


def emission_for_white(draw: Draw, second_set: bool = True) -> tuple[Any, Any]:
    """Reflectance and emission of a Lambertian surface that sends out radiance 1 wherever radiance 1 arrives.

    Parameters
    ----------
    draw : Draw
    second_set : bool
        Whether the shape has a second set of texture coordinates.
    """
    kind = draw.one(("color", "checker", "ramp", "picture"))
    first = draw.color(0.97, 0.995) if draw.chance(0.3) else draw.color(0.2, 0.8)
    second = draw.color(0.2, 0.8)

    def rest(color: list[float]) -> list[float]:
        return [1.0 - share for share in color]

    if kind == "color":
        return first, rest(first)
    more = mapping(draw)
    if not second_set:
        more.pop("uv_set", None)
    if kind == "picture":
        more["color_space"] = "linear"
        return {"texture": "colors.png", **more}, {"texture": "inverse.png", **more}
    return {kind: [first, second], **more}, {kind: [rest(first), rest(second)], **more}
