"""Keys of our calibrated camera from the parameters of other programs' lens models."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final

from clrender.wording import counted

__all__ = ["MODELS", "from_model", "opencv_distortion"]

MODELS: Final[Mapping[str, tuple[str, ...]]] = {
    "SIMPLE_PINHOLE": ("f", "cx", "cy"),
    "PINHOLE": ("fx", "fy", "cx", "cy"),
    "SIMPLE_RADIAL": ("f", "cx", "cy", "k1"),
    "RADIAL": ("f", "cx", "cy", "k1", "k2"),
    "OPENCV": ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2"),
    "OPENCV_FISHEYE": ("fx", "fy", "cx", "cy", "k1", "k2", "k3", "k4"),
    "FULL_OPENCV": ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6"),
    "SIMPLE_RADIAL_FISHEYE": ("f", "cx", "cy", "k1"),
    "RADIAL_FISHEYE": ("f", "cx", "cy", "k1", "k2"),
}
"""COLMAP's camera models that ours includes, with their parameters (colmap/src/colmap/sensor/models.h)."""


def from_model(model: str, parameters: Sequence[float]) -> dict[str, Any]:
    """Keys of a camera of one of `MODELS`.

    Parameters
    ----------
    model : str
    parameters : sequence of float
        As many as the model has.

    Returns
    -------
    dict
        Type, focal lengths, principal point and distortion.
    """
    given = dict(zip(MODELS[model], parameters, strict=True))
    keys = {"type": "intrinsics", "fx": given.get("fx", given.get("f")), "cx": given["cx"], "cy": given["cy"]}
    if "fy" in given:
        keys["fy"] = given["fy"]
    fisheye = model.endswith("FISHEYE")
    k = [given.get(f"k{n}", 0.0) for n in range(1, 5 if fisheye else 7)]
    distortion = _distortion(fisheye, k, [given.get("p1", 0.0), given.get("p2", 0.0)])
    return keys | ({"distortion": distortion} if distortion else {})


def opencv_distortion(coefficients: Sequence[float], fisheye: bool) -> dict[str, Any]:
    """Table `distortion` of coefficients in OpenCV's order; empty if there is none.

    Parameters
    ----------
    coefficients : sequence of float
        k1, k2, p1, p2, k3, k4, k5, k6 and those of a thin prism and a tilted sensor, or k1 to k4 of a fisheye.
    fisheye : bool

    Raises
    ------
    ValueError
        There are other numbers of them, or a thin prism or a tilted sensor; the message continues a sentence.
    """
    given = list(coefficients)
    if fisheye:
        if len(given) > 4:
            raise ValueError(f"has {counted(len(given), 'number')}, but the fisheye model has 4")
        return _distortion(True, given, [0.0, 0.0])
    if len(given) > 14:
        raise ValueError(f"has {counted(len(given), 'number')}, but OpenCV knows 14 at most")
    if any(given[8:]):
        raise ValueError("describes a thin prism or a tilted sensor, which clrender has not; calibrate without them")
    k1, k2, p1, p2, k3, k4, k5, k6 = (given + [0.0] * 8)[:8]
    return _distortion(False, [k1, k2, k3, k4, k5, k6], [p1, p2])


def _distortion(fisheye: bool, k: Sequence[float], p: Sequence[float]) -> dict[str, Any]:
    if fisheye:  # even without coefficients: the angle is proportional to the distance
        return {"model": "kannala-brandt", "k": list(k)}
    if not any(k) and not any(p):
        return {}
    last = max([n + 1 for n, each in enumerate(k) if each], default=0)
    return {"model": "brown-conrady", "k": list(k[:last]), **({"p": list(p)} if any(p) else {})}
