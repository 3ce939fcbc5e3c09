"""Converts pbrt's camera, film, sampler and integrator to ours."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from clrender.exact.angles import angle_of, tangent
from clrender.exact.matrices import length, times
from clrender.importers.pbrt.parameters import Parameters
from clrender.importers.pbrt.tokens import Directive
from clrender.importers.shared.cameras import camera_keys, vertical_angle
from clrender.importers.shared.matrices import Matrix, is_similarity
from clrender.importers.shared.staging import Staging
from clrender.importers.shared.white_balance import white_balance
from clrender.settings import SPP_LIMIT
from clrender.wording import quoted

__all__ = ["Camera", "Exposure", "Settings"]

_KELVIN: Final = (1000.0, 25000.0)
"""Range of white balances."""
_FILTERS: Final = {
    "box": ("box", 0.5),
    "gaussian": ("gaussian", 1.5),
    "mitchell": ("mitchell", 2.0),
    "triangle": ("tent", 2.0),
}
"""Ours, and pbrt's default radius, pixels."""
_NEAR_FILTER: Final = {"sinc": "mitchell"}
_MITCHELL: Final = 1.0 / 3.0
_SIGMAS: Final = 3.0
"""Radius of our Gaussian, standard deviations."""
_PATHS: Final = frozenset(["path", "volpath", "simplepath", "simplevolpath", "mlt"])
_BIDIRECTIONAL: Final = frozenset(["bdpt", "lightpath"])


@dataclass(frozen=True)
class Exposure:
    """What the film makes of radiance, which all lights have here.

    Attributes
    ----------
    ratio : float
        pbrt's imaging ratio.
    balance : (3, 3) float64, or None
        Its white balance, on linear Rec. 709.
    """

    ratio: float = 1.0
    balance: NDArray[np.float64] | None = None

    def balanced(self, colors: Any) -> Any:
        """Colours of lights, (..., 3), behind the white balance, without the ratio."""
        return colors if self.balance is None else np.maximum(times(self.balance, colors), 0.0)


@dataclass(frozen=True)
class Camera:
    """The camera in the file.

    Attributes
    ----------
    directive : Directive
    matrix, late : (4, 4) float64
        From camera space to world space, when the motion begins and ends.
    """

    directive: Directive
    matrix: Matrix
    late: Matrix


class Settings:
    """Collects the directives before the world block.

    Parameters
    ----------
    staging : Staging

    Attributes
    ----------
    camera : Camera or None
    """

    def __init__(self, staging: Staging) -> None:
        self._staging = staging
        self.camera: Camera | None = None
        self._film: Directive | None = None
        self._size = (1280, 720)
        self._render: dict[str, Any] = {"spp": 16, "max_depth": 5, "filter": "gaussian"}

    def _tell_unused(self, parameters: Parameters, what: str) -> None:
        for unknown in parameters.unused():
            self._staging.note(f"{quoted(unknown)} of the {what} is not understood and does nothing")

    def film(self, directive: Directive) -> None:
        """Size of the image; its exposure is evaluated when the world block begins."""
        parameters = directive.parameters
        width, height = parameters.whole("xresolution", 1280), parameters.whole("yresolution", 720)
        if not (1 <= width <= 65536 and 1 <= height <= 65536):
            raise directive.fault(f"the film's size is {width} x {height}, but must be 1 to 65536")
        self._size, self._film = (width, height), directive
        parameters.ignore("filename", "savefp16", "diagonal", "coordinatesystem", "iso", "sensor", "whitebalance")
        if parameters.get("maxcomponentvalue") is not None:
            self._staging.note('"maxcomponentvalue" of the film is left out: bright samples stay as they are')
        if parameters.get("cropwindow") is not None or parameters.get("pixelbounds") is not None:
            self._staging.note("the crop of the film is left out: the whole image is rendered")
        self._tell_unused(parameters, "film")

    def exposure(self) -> Exposure:
        """The imaging ratio, exposure time times ISO speed / 100, and the white balance (PBR 4ed, 5.4.2)."""
        ratio, balance = 1.0, None
        if self._film is not None:
            parameters = self._film.parameters
            ratio *= parameters.number("iso", 100.0) / 100.0
            sensor = parameters.text("sensor", "cie1931")
            if sensor != "cie1931":
                # Its matrix makes the colours of a chart those of CIE 1931 again, in light of its white balance
                self._staging.note(f"the sensor {quoted(sensor)} is read as cie1931: without its own errors of colour")
            kelvin = parameters.number("whitebalance", 0.0)
            if kelvin != 0.0:
                balance = self._balance(parameters, kelvin)
        if self.camera is not None:
            parameters = self.camera.directive.parameters
            seconds = parameters.number("shutterclose", 1.0) - parameters.number("shutteropen", 0.0)
            if seconds > 0.0:
                ratio *= seconds
            else:
                self._staging.note("the shutter does not open, and is read as open for 1 second")
        if ratio != 1.0:
            self._staging.note(f"the exposure of the film, {ratio:g}, is a factor of all lights here")
        return Exposure(max(ratio, 0.0), balance)

    def _balance(self, parameters: Parameters, kelvin: float) -> NDArray[np.float64]:
        least, most = _KELVIN
        if not least <= kelvin <= most:
            text = f'"whitebalance" is {kelvin:g}, but must be {least:g} to {most:g} kelvin'
            raise parameters.fault(text, "whitebalance")
        self._staging.note(f"the white balance of the film, {kelvin:g} K, changes the colours of all lights here")
        return white_balance(kelvin)

    def sampler(self, directive: Directive) -> None:
        """Samples per pixel."""
        parameters = directive.parameters
        if directive.texts[:1] == ("stratified",):
            spp = parameters.whole("xsamples", 4) * parameters.whole("ysamples", 4)
        else:
            spp = parameters.whole("pixelsamples", 16)
        self._render["spp"] = min(max(spp, 1), SPP_LIMIT)
        parameters.ignore("seed", "randomization", "jitter")

    def integrator(self, directive: Directive) -> None:
        """The maximum depth, which counts scattering events like ours."""
        kind, parameters = directive.text(0, "type"), directive.parameters
        if kind == "sppm":
            self._render["integrator"] = "photon"
            parameters.ignore("photonsperiteration", "radius")
        elif kind in _BIDIRECTIONAL:
            self._render["integrator"] = "bdpt"
            parameters.ignore("visualizestrategies", "visualizeweights")
        elif kind not in _PATHS:
            self._staging.note(f'the integrator {quoted(kind)} is read as "path"')
        self._render["max_depth"] = min(max(parameters.whole("maxdepth", 5), 0), 2**31 - 1)
        parameters.ignore("lightsampler", "samplelights", "samplebsdf", "usemis")
        if parameters.flag("regularize", False):
            self._staging.note('"regularize" is left out: rough paths stay as they are')
        self._tell_unused(parameters, "integrator")

    def pixel_filter(self, directive: Directive) -> None:
        """Our closest pixel filter."""
        kind, parameters = directive.text(0, "type"), directive.parameters
        parameters.ignore("tau")
        if kind not in _FILTERS:
            near = _NEAR_FILTER.get(kind, "gaussian")
            parameters.ignore("xradius", "yradius", "sigma", "B", "C")
            self._staging.note(f"the pixel filter {quoted(kind)} is not known: {quoted(near)} in its place")
            self._render["filter"] = near
            return
        name, default = _FILTERS[kind]
        radius = parameters.number("xradius", default)
        given = {"yradius": (parameters.number("yradius", default), radius)}
        if kind == "mitchell":
            given |= {key: (parameters.number(key, _MITCHELL), _MITCHELL) for key in ("B", "C")}
        elif kind == "gaussian":
            wide = _SIGMAS * parameters.number("sigma", default / _SIGMAS)
            given["radius"], radius = (radius, wide), wide
        parameters.ignore("sigma", "B", "C")
        for key, (wanted, ours) in given.items():
            if abs(wanted - ours) > 1e-3 * abs(ours):
                self._staging.note(f"the pixel filter {quoted(kind)} has a {key} of {wanted:g}: {ours:g} in its place")
        self._render |= self._staging.pixel_filter(name, radius)

    def finish(self, times: tuple[float, float], moves: bool) -> None:
        """Write everything to the draft.

        Parameters
        ----------
        times : (float, float)
            When motions begin and end, seconds.
        moves : bool
            Whether a shape moves.
        """
        description = self._staging.draft.description
        description["render"] = self._render
        description["image"] = {"width": self._size[0], "height": self._size[1]}
        if self.camera is not None:
            self._write_camera(self.camera, times, moves)

    def _write_camera(self, camera: Camera, times: tuple[float, float], moves: bool) -> None:
        parameters, (width, height) = camera.directive.parameters, self._size
        kind = camera.directive.text(0, "type")
        shutter = parameters.number("shutteropen", 0.0), parameters.number("shutterclose", 1.0)
        if kind not in ("perspective", "orthographic"):
            self._staging.note(f"a camera of type {quoted(kind)} is not known: another one in its place")
            return
        # Without a screen window, the shorter side of the image spans -1 to 1
        aspect = parameters.number("frameaspectratio", width / height)
        if abs(aspect - width / height) > 1e-6 * aspect:
            self._staging.note('"frameaspectratio" is left out: pixels are square')
        window = parameters.numbers("screenwindow")
        upward, shift = (1.0 if width >= height else height / width), [0.0, 0.0]
        if window is not None:
            if len(window) != 4 or not (window[1] > window[0] and window[3] > window[2]):
                raise parameters.fault(
                    '"screenwindow" must have four numbers: two along x, two along y, that grow', "screenwindow"
                )
            upward = float(window[3] - window[2]) / 2.0
            shift = [float(0.5 * (window[n] + window[n + 1]) / (window[n + 1] - window[n])) for n in (0, 2)]
            across = float(window[1] - window[0]) / 2.0
            if abs(across * height - upward * width) > 1e-6 * upward * width:
                self._staging.note('"screenwindow" has another shape than the image: its height is taken')
        lens = parameters.number("lensradius", 0.0)
        distance = parameters.number("focaldistance", 1e6)
        keys = camera_keys(camera.matrix, rightward=True)
        if not is_similarity(camera.matrix):
            self._staging.note(
                "the camera's transform scales along its axes differently: the image is that of the scale along y"
            )
        if not np.array_equal(camera.matrix, camera.late) and times[0] < times[1]:
            ends = [camera_keys(each, rightward=True) for each in (camera.matrix, camera.late)]
            if [end.pop("mirrored", False) for end in ends].count(True) == 1:
                self._staging.note("the camera's transform mirrors on its way: it stands still")
            else:
                moves = True
                keys["motion"] = [{"time": time, **end} for time, end in zip(times, ends, strict=True)]
        if moves:
            keys |= {"shutter": list(shutter)} if shutter[0] < shutter[1] else {"time": shutter[0]}
        if lens > 0.0:
            across, along = _scale(camera.matrix, 1), _scale(camera.matrix, 2)
            keys |= {"aperture_radius": lens * across, "focus_distance": distance * along}
        if any(abs(each) > 1e-9 for each in shift):
            keys["lens_shift"] = shift
        if kind == "orthographic":
            keys |= {"type": "orthographic", "height": 2.0 * upward * _scale(camera.matrix, 1)}
        else:
            degrees = parameters.number("fov", 90.0)
            if not 0.0 < degrees < 180.0:
                raise parameters.fault(f'"fov" is {degrees:g}, but must be above 0 and below 180 degrees', "fov")
            if window is None:
                keys["vertical_fov"] = vertical_angle(degrees, "smaller", width, height)
            else:
                half = tangent(math.radians(degrees) / 2.0) * upward
                keys["vertical_fov"] = math.degrees(2.0 * angle_of(half, 1.0))
        self._staging.draft.description["camera"] = keys
        self._tell_unused(parameters, "camera")


def _scale(matrix: Matrix, axis: int) -> float:
    """How much a matrix stretches an axis; exactly 1 if only rounding tells it from 1."""
    size = length(matrix[:3, axis])
    return 1.0 if abs(size - 1.0) < 1e-9 else size
