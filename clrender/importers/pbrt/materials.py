"""Converts pbrt's materials to ours."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from clrender.importers.pbrt.definitions import Definitions
from clrender.importers.pbrt.media import MediumReader
from clrender.importers.pbrt.parameters import Parameters
from clrender.importers.pbrt.textures import TextureReader
from clrender.importers.shared.curved import below_boundary, coated_metal, map_of
from clrender.importers.shared.fresnel import below_coat, conductor_reflectance
from clrender.importers.shared.half_space import albedo_without_boundary
from clrender.importers.shared.measured_media import MEASURED_MEDIA
from clrender.importers.shared.staging import Staging
from clrender.spectra.colors import Color
from clrender.wording import counted, quoted, suggestion

__all__ = ["MaterialReader"]

_COAT_REFLECTANCE: Final = 0.04
"""Reflectance of our coat at normal incidence: of an index of 1.5."""
_SKIN_INDEX: Final = 1.33
"""Default index of refraction of subsurface materials."""
_LEAST_INDEX: Final = 1.01
"""Lowest index of our subsurface materials with a boundary."""
_LEAST_PATH: Final = 1e-9
"""Shortest mean free path, metres."""
_MOST_G: Final = 0.95
"""Largest mean cosine of our subsurface materials."""
_MOST_REFLECTANCE: Final = 0.9999
"""Largest reflectance of a metal, as in pbrt."""


class MaterialReader:
    """Converts materials, and maps pbrt's names to them.

    Parameters
    ----------
    staging : Staging
    textures : TextureReader
    media : MediumReader

    Attributes
    ----------
    fillings : dict of str to str
        Media that fill shapes of a material, by its name.
    """

    def __init__(self, staging: Staging, textures: TextureReader, media: MediumReader) -> None:
        self._staging, self._textures, self._media = staging, textures, media
        self._named: Definitions[str, str | None] = Definitions()
        self.fillings: dict[str, str] = {}

    def named(self, name: str, parameters: Parameters) -> str | None:
        """The material of that name."""
        if name not in self._named:
            raise parameters.fault(f"the material {quoted(name)} is not defined{suggestion(name, self._named)}")
        return self._named[name]

    def define(self, name: str, parameters: Parameters) -> Callable[[], None]:
        """Define a named material; the result makes it: see `Definitions.define`."""
        return self._named.define(name, lambda: self.made(parameters.text("type", "diffuse"), parameters, name))

    def made(self, kind: str, parameters: Parameters, wanted: str = "") -> str | None:
        """The name of a new material; None for an invisible surface.

        Parameters
        ----------
        kind : str
        parameters : Parameters
        wanted : str
            Preferred name, used if it is free.
        """
        known: dict[str, Callable[[Parameters], dict[str, Any]]] = {
            "diffuse": self._diffuse,
            "coateddiffuse": self._coated_diffuse,
            "conductor": self._conductor,
            "coatedconductor": self._coated_conductor,
            "dielectric": self._dielectric,
            "thindielectric": self._dielectric,
            "diffusetransmission": self._diffuse_transmission,
            "hair": self._hair,
            "measured": self._measured,
            "mix": self._mix,
        }
        parameters.ignore("type")
        if kind in ("interface", "", "none"):
            return None
        filling = None
        if kind == "subsurface":
            described, filling = self._subsurface(parameters, wanted or kind)
        elif kind in known:
            described = known[kind](parameters)
            if kind == "thindielectric":
                described["thin"] = True
                described.pop("roughness", None)
        else:
            self._staging.note(f"a material of type {quoted(kind)} is not known: a diffuse grey of 0.5 in its place")
            parameters.ignore(*parameters.values)
            described = {"type": "lambert", "reflectance": [0.5] * 3}
        self._add_maps(described, parameters)
        for unknown in parameters.unused():
            self._staging.note(
                f"{quoted(unknown)} of a material of type {quoted(kind)} is not understood and does nothing"
            )
        # By the name of the medium, since equal surfaces may have different insides
        name = self._staging.material(filling or wanted or kind, described)
        if filling is not None:
            self.fillings[name] = filling
        return name

    def _add_maps(self, described: dict[str, Any], parameters: Parameters) -> None:
        normals = parameters.text("normalmap")
        heights = self._textures.share(parameters, "displacement", 0.0) if parameters.get("displacement") else 0.0
        if described["type"] in ("mix", "hair"):
            return
        if normals:
            described["normal_map"] = {"texture": self._staging.files.name(normals, f"line {parameters.line}")}
        if isinstance(heights, dict) and "texture" in heights:
            scale = heights.get("scale", [1.0])
            described["bump_map"] = {**map_of(self._staging, heights, parameters.line), "scale": scale[0]}
        elif isinstance(heights, dict):
            self._staging.note("a displacement that is no picture is left out")

    def _measured(self, parameters: Parameters) -> dict[str, Any]:
        name = parameters.text("filename", "")
        if not name:
            raise parameters.fault('a material of type "measured" needs a "filename"')
        return self._staging.measured(name, parameters.line)

    def _hair(self, parameters: Parameters) -> dict[str, Any]:
        made: dict[str, Any] = {
            "type": "hair",
            "ior": self._staging.within(self._textures.index(parameters, "eta", 1.55), 1.05, 3.0, "eta"),
        }
        for key, name, default in (("roughness", "beta_m", 0.3), ("azimuthal_roughness", "beta_n", 0.3)):
            made[key] = self._staging.share(self._textures.plain_number(parameters, name, default), name)
        tilt = self._textures.plain_number(parameters, "alpha", 2.0)
        made["tilt_degrees"] = self._staging.within(tilt, -20.0, 20.0, "alpha")
        color = "color" if "color" in parameters.values else "reflectance"
        if parameters.get("sigma_a") is not None:
            absorbed = self._textures.coefficients(parameters, "sigma_a", (1.3, 1.3, 1.3))
            made["absorption_coefficient"] = [self._staging.within(x, 0.0, 1000.0, "sigma_a") for x in absorbed]
        elif parameters.get(color) is not None:
            made["reflectance"] = self._textures.color(parameters, color, 0.5)
        else:
            for name in ("eumelanin", "pheomelanin"):
                if parameters.get(name) is not None:
                    amount = self._textures.plain_number(parameters, name, 0.0)
                    made[name] = self._staging.within(amount, 0.0, 100.0, name)
        parameters.ignore("sigma_a", "color", "reflectance", "eumelanin", "pheomelanin")
        return made

    def _diffuse(self, parameters: Parameters) -> dict[str, Any]:
        return {"type": "lambert", "reflectance": self._textures.reflecting(parameters, "reflectance", 0.5)}

    def _diffuse_transmission(self, parameters: Parameters) -> dict[str, Any]:
        """A sheet whose two colours become those of a share that is reflected and one that is transmitted."""
        reflected = self._textures.color(parameters, "reflectance", 0.25)
        transmitted = self._textures.color(parameters, "transmittance", 0.25)
        scale = parameters.number("scale", 1.0)
        if isinstance(reflected, dict) or isinstance(transmitted, dict):
            self._staging.note("a textured diffusetransmission is read as a diffuse surface: it lets no light through")
            return {"type": "lambert", "reflectance": reflected}
        first, second = (np.clip(np.array(color) * scale, 0.0, 1.0) for color in (reflected, transmitted))
        # Each share has to be at least the largest of its colour, and both are 1 together
        least, most = float(second.max()), 1.0 - float(first.max())
        share = (least + most) / 2.0 if least <= most else least / (least + 1.0 - most)
        if least > most + 1e-6:
            self._staging.note("a diffusetransmission whose colours go beyond 1 together is read as darker")
        made: dict[str, Any] = {"type": "principled", "specular": 0.0, "roughness": 1.0}
        made["base_color"] = _over(first, 1.0 - share)
        if share > 0.0:
            made |= {"diffuse_transmission": share, "diffuse_transmission_color": _over(second, share)}
        return made

    def _microfacets(self, parameters: Parameters, prefix: str = "") -> dict[str, Any]:
        """Options of metal and glass, which lose light by multiple scattering in pbrt."""
        roughness = self._textures.roughness(parameters, prefix)
        return {"roughness": roughness, "multiple_scattering": False} if roughness else {"roughness": 0.0}

    def _coated_diffuse(self, parameters: Parameters) -> dict[str, Any]:
        ior = max(self._textures.index(parameters), 1.0)
        base = self._textures.color(parameters, "reflectance", 0.5)
        base = below_boundary(self._staging, base, ior, parameters.line)
        self._layers(parameters)
        roughness = self._textures.roughness(parameters)
        return {"type": "principled", "base_color": base, "roughness": roughness, "ior": ior}

    def _layers(self, parameters: Parameters) -> None:
        if any(self._textures.coefficients(parameters, "albedo", (0.0, 0.0, 0.0))):
            self._staging.note("media inside of coats are left out")
        parameters.ignore("thickness", "interface.thickness", "g", "maxdepth", "nsamples")

    def _metal(self, parameters: Parameters, prefix: str) -> dict[str, Any]:
        color = self._reflectance(parameters, prefix)
        if isinstance(color, dict):
            return {"f0": color}
        if color is not None:
            color = [min(x, _MOST_REFLECTANCE) for x in color]
            return {"eta": [1.0] * 3, "k": [2.0 * math.sqrt(x / (1.0 - x)) for x in color]}
        eta, k = self._index_of_metal(parameters, prefix)
        return {"eta": [min(max(x, 1e-3), 1000.0) for x in eta], "k": [min(max(x, 0.0), 1000.0) for x in k]}

    def _reflectance(self, parameters: Parameters, prefix: str) -> Any:
        """The reflectance of a metal, or a texture of it; None if its index of refraction is given instead."""
        for name in (f"{prefix}reflectance", "reflectance"):
            if parameters.get(name) is not None:
                return self._textures.color(parameters, name, 0.5)
        return None

    def _index_of_metal(self, parameters: Parameters, prefix: str) -> tuple[Color, Color]:
        return (
            self._textures.metal(parameters, f"{prefix}eta", "metal-Cu-eta"),
            self._textures.metal(parameters, f"{prefix}k", "metal-Cu-k"),
        )

    def _conductor(self, parameters: Parameters) -> dict[str, Any]:
        return {"type": "conductor", **self._metal(parameters, ""), **self._microfacets(parameters)}

    def _coated_conductor(self, parameters: Parameters) -> dict[str, Any]:
        """A metal below a clear coat, which at normal incidence reflect together what pbrt's layers do."""
        self._staging.note('"coatedconductor" is read as "principled": off the perpendicular by Schlick\'s formula')
        ior = max(self._textures.index(parameters, "interface.eta"), 1.0)
        share = conductor_reflectance(ior, 0.0)
        if share > _COAT_REFLECTANCE:
            self._staging.note(f"a coat of index {ior:g} reflects as one of 1.5, which is the most")
        self._layers(parameters)
        base = self._reflectance(parameters, "conductor.")
        if base is None:
            metal = zip(*self._index_of_metal(parameters, "conductor."), strict=True)
            inside = np.array([conductor_reflectance(eta / ior, k / ior) for eta, k in metal])
            base = below_coat(inside, ior).tolist()
        else:
            base = coated_metal(self._staging, base, ior, parameters.line)
        return {
            "type": "principled",
            "metallic": 1.0,
            "base_color": base,
            "roughness": self._textures.roughness(parameters, "conductor."),
            "coat": min(share / _COAT_REFLECTANCE, 1.0),
            "coat_roughness": self._textures.roughness(parameters, "interface."),
        }

    def _dielectric(self, parameters: Parameters) -> dict[str, Any]:
        return {"type": "dielectric", **self._textures.refraction(parameters), **self._microfacets(parameters)}

    def _subsurface(self, parameters: Parameters, wanted: str) -> tuple[dict[str, Any], str | None]:
        """A material, and the medium in it if that is given by coefficients."""
        self._staging.note('"subsurface" is computed by random walks here, and by a profile of diffusion in pbrt')
        ior = min(max(self._textures.index(parameters, default=_SKIN_INDEX), 1e-3), 1000.0)
        microfacets = self._microfacets(parameters)
        measured = self._media.measured(parameters, "name")
        diffuse = measured is None and parameters.get("sigma_a") is None and parameters.get("sigma_s") is None
        if diffuse and parameters.get("reflectance") is not None:
            return self._diffusing(parameters, max(ior, 1.0), microfacets["roughness"]), None
        if measured is None:
            default = MEASURED_MEDIA["Wholemilk"]
            scattering = self._textures.coefficients(parameters, "sigma_s", default[0])
            absorption = self._textures.coefficients(parameters, "sigma_a", default[1])
        else:
            parameters.values.pop("g", None)  # the measured scattering is the reduced one, which is of g = 0
            scattering, absorption = measured
        spectra = self._media.spectra(parameters) if measured is None else {}
        filling = self._media.added(wanted, scattering, absorption, parameters, spectra)
        return {"type": "dielectric", "ior": ior, **microfacets}, filling

    def _diffusing(self, parameters: Parameters, ior: float, roughness: Any) -> dict[str, Any]:
        """Subsurface scattering by the share of the light inside that leaves again, and the mean free path."""
        albedo = self._textures.mean_color(parameters, "reflectance", 0.5)
        path = self._textures.coefficients(parameters, "mfp", (1.0, 1.0, 1.0))
        scale = parameters.number("scale", 1.0)
        made: dict[str, Any] = {
            "type": "subsurface",
            "radius": [min(max(x * scale, _LEAST_PATH), 1e6) for x in path],
            "g": min(max(parameters.number("g", 0.0), -_MOST_G), _MOST_G),
        }
        if ior < _LEAST_INDEX:
            return {**made, "albedo": albedo}
        # Our albedo is that without the boundary, which returns light to the inside
        albedo = [albedo_without_boundary(x, ior) for x in albedo]
        return {**made, "albedo": albedo, "ior": ior, "roughness": roughness}

    def _part(self, name: str) -> str:
        """What stands for a material in a mixture, where there is no subsurface scattering."""
        described = self._staging.draft.description["materials"][name]
        if described["type"] != "subsurface" and name not in self.fillings:
            return name
        self._staging.note("subsurface scattering in a mixture is read as a diffuse surface")
        color = described.get("albedo", [0.5] * 3)
        return self._staging.material(f"{name}, diffuse", {"type": "lambert", "reflectance": color})

    def _mix(self, parameters: Parameters) -> dict[str, Any]:
        names = parameters.texts("materials")
        if len(names) != 2:
            raise parameters.fault(f"the mixture has {counted(len(names), 'material')}, but must have two", "materials")
        parts = [self.named(name, parameters) for name in names]
        if None in parts:
            raise parameters.fault('a mixture with "interface" is not read; use alpha instead', "materials")
        parts = [self._part(name) for name in parts if name is not None]
        return {"type": "mix", "materials": parts, "weight": self._textures.share(parameters, "amount", 0.5)}


def _over(color: NDArray[np.float64], share: float) -> list[float]:
    """The colour of a share of the surface that returns this much light."""
    return [min(x / share, 1.0) if share > 0.0 else 0.0 for x in color.tolist()]
