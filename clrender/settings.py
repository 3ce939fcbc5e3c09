"""What a render is asked for: the settings, where they come from, and what makes sense."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import numpy.typing as npt

from clrender import layout
from clrender.errors import UsageError
from clrender.integrators import INTEGRATORS, RADIOSITY_DISPLAYS
from clrender.scene.lights import LIGHT_SAMPLERS

if TYPE_CHECKING:
    from clrender.scene import Scene

__all__ = ["RenderSettings", "settings_for"]

_OWN_SETTINGS: Final = {
    "reuse": ("reuse",),
    "photon": ("photons", "photon_radius"),
    "radiosity": ("patches", "patch_rays", "radiosity_display"),
}
"""Settings that decide the image of one integrator only, by its name."""
_ROULETTES: Final = {
    "none": layout.ROULETTE_NONE,
    "throughput": layout.ROULETTE_THROUGHPUT,
    "absorption": layout.ROULETTE_ABSORPTION,
}
_STRATEGIES: Final = {"mis": (1, 1), "light": (1, 0), "bsdf": (0, 1)}
"""Whether the weights of multiple importance sampling count samples of lights, and of the BSDF."""


@dataclass(frozen=True)
class RenderSettings:
    """What is asked for. The first group decides the image, the second only how it is computed.

    Attributes
    ----------
    spp, width, height, seed : int
    integrator : str
        A name in `clrender.integrators.INTEGRATORS`.
    shadow_rays, indirect_rays : int
        To sampled lights at a diffuse hit; from the first diffuse hit.
    max_depth : int or None
        Scattering events at most; None: no limit.
    roulette : str
        ``throughput``, ``absorption`` or ``none``.
    absorption : float or None
        Probability to end a path, for every material; None: each material's own.
    sampling : str
        How light from surfaces is found: ``mis`` (both, weighted), ``light`` or ``bsdf`` sampling alone.
    light_sampler : str
        How one of many lights is picked: by a ``tree`` of what they can give at the point, by ``power``, each alike
        (``uniform``), or ``auto``: the tree where there are many.
    reuse : int
        Pixels that share their indirect light, for the integrator of that name: 1, 2, 4, 8 or 16.
    photons : int
        Emitted for each sample, for the integrator ``photon``.
    photon_radius : float or None
        Within which the first sample looks for photons, metres; None: a hundredth of the scene's radius.
    patches, patch_rays : int
        Of ``radiosity``: how many patches, about, and rays from each.
    radiosity_display : str
        ``constant``, ``smooth`` or ``gather``.
    tile, samples_per_pass, work_group, lanes, traversal
        How work is cut; None: by the device.
    time_limit : float or None
        Seconds after which to stop.
    """

    spp: int = 64
    width: int = 800
    height: int = 800
    seed: int = 0
    integrator: str = "path"
    shadow_rays: int = 1
    indirect_rays: int = 1
    max_depth: int | None = None
    roulette: str = "throughput"
    absorption: float | None = None
    sampling: str = "mis"
    light_sampler: str = "auto"
    reuse: int = 16
    photons: int = 131072
    photon_radius: float | None = None
    patches: int = 8000
    patch_rays: int = 256
    radiosity_display: str = "smooth"
    tile: int = 64
    samples_per_pass: int | None = None
    work_group: int | None = None
    lanes: int | None = None
    traversal: str | None = None
    time_limit: float | None = None

    def request(self) -> dict[str, Any]:
        """The settings that decide the image, JSON-able; not the number of samples, of which a film may hold some."""
        names = ("width", "height", "seed", "integrator", "shadow_rays", "indirect_rays", "max_depth", "roulette")
        own = ("absorption", "sampling", "light_sampler", *_OWN_SETTINGS.get(self.integrator, ()))
        return {name: getattr(self, name) for name in (*names, *own)}

    def struct(self, tile: int) -> npt.NDArray[np.void]:
        """The `Settings` that kernels read, for tiles of this side.

        Returns
        -------
        (1,) `Settings`
        """
        settings = np.zeros(1, layout.dtype("Settings"))
        indirect = 0 if self.integrator in ("direct", "photon") else self.indirect_rays
        lights, bsdf = _STRATEGIES[self.sampling]
        values: dict[str, int] = {
            "width": self.width,
            "height": self.height,
            "tile": tile,
            "seed": self.seed,
            "shadow_rays": self.shadow_rays,
            "indirect_rays": indirect,
            "max_depth": layout.NONE if self.max_depth is None else self.max_depth,
            "roulette": _ROULETTES[self.roulette],
            # Without indirect rays only light samples find light on diffuse surfaces.
            "light_samples": self.shadow_rays if lights or indirect == 0 else 0,
            "bsdf_samples": bsdf * indirect,
            "reuse": self.reuse,
        }
        for name, value in values.items():
            settings[name] = value
        return settings


def settings_for(scene: Scene, size: tuple[int, int] | None, given: Mapping[str, Any]) -> RenderSettings:
    """The settings of a render: those given, else the scene's, else the defaults.

    Parameters
    ----------
    scene : Scene
    size : (int, int) or None
        Width and height.
    given : mapping
        Fields of `RenderSettings`.

    Raises
    ------
    UsageError
        When a name is unknown or a value makes no sense.
    """
    known = {field.name for field in dataclasses.fields(RenderSettings)}
    for name in given:
        if name not in known:
            raise UsageError(f"render() has no setting {name!r}; it has {', '.join(sorted(known))}")
    values = {**scene.render.model_dump(), "width": scene.image.width, "height": scene.image.height}
    if size is not None:
        values["width"], values["height"] = size
    wanted = RenderSettings(**{**values, **given})
    for name, least, most in (
        ("spp", 1, 2**20), ("width", 1, 65536), ("height", 1, 65536), ("seed", 0, 2**32 - 1), ("shadow_rays", 1, 4096),
        ("indirect_rays", 0, 4096), ("tile", 1, 65536), ("photons", 1, 2**26), ("patches", 1, 2**20),
        ("patch_rays", 1, 2**16),
    ):  # fmt: skip
        value = getattr(wanted, name)
        if not isinstance(value, (int, np.integer)) or not least <= value <= most:
            raise UsageError(f"{name} is {value!r}; it must be a whole number from {least} to {most}")
    for name, choices in (
        ("integrator", INTEGRATORS),
        ("roulette", _ROULETTES),
        ("sampling", _STRATEGIES),
        ("light_sampler", LIGHT_SAMPLERS),
        ("radiosity_display", RADIOSITY_DISPLAYS),
    ):
        if getattr(wanted, name) not in choices:
            raise UsageError(f"{name} is {getattr(wanted, name)!r}; it must be one of {', '.join(choices)}")
    if wanted.reuse not in (1, 2, 4, 8, 16):
        raise UsageError(f"reuse is {wanted.reuse!r}; it must be 1, 2, 4, 8 or 16")
    if wanted.integrator in ("reuse", "photon") and wanted.indirect_rays != 1:
        raise UsageError(f"indirect_rays is {wanted.indirect_rays}; the integrator {wanted.integrator} takes only 1")
    if wanted.photon_radius is not None and not 0.0 < wanted.photon_radius < math.inf:
        raise UsageError(f"photon_radius is {wanted.photon_radius!r}; it must be above 0 and finite")
    if wanted.lanes not in (None, 1, 4, 8, 16):
        raise UsageError(f"lanes is {wanted.lanes!r}; it must be 1, 4, 8 or 16")
    if wanted.absorption is not None and not 0.0 <= wanted.absorption < 1.0:
        raise UsageError(f"absorption is {wanted.absorption!r}; it must be at least 0 and below 1")
    return wanted
