"""clrender's plastics for Mitsuba, written down from their definition: a diffuse surface below Schlick's reflection.

Mitsuba's own `plastic` and `roughplastic` have Fresnel's reflectance instead of Schlick's approximation to it, which is
glTF's. Otherwise they are of the same form, with R the albedo of the reflecting layer along a direction:

    f = F(h) D(h) G(i, o) / (4 cos i cos o) + base (1 - R(i)) (1 - R(o)) / (pi (1 - R_average)).

Of a smooth plastic the first part is a mirror. Albedos are sums over visible normals, computed in NumPy.

Mitsuba 3.9.1's `roughplastic` also has another G, of masking and shadowing that are independent. For the share that is
reflected within it takes a mean of 64 values instead of the integral, which makes it 2 % darker at an alpha of 0.1.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final
from xml.etree import ElementTree

import numpy as np
import numpy.typing as npt

__all__ = ["register", "with_plastics"]

_SMOOTH: Final = "smooth_plastic_of_schlick"
"""In the place of Mitsuba's `plastic`, with its parameters."""
_ROUGH: Final = "rough_plastic_of_schlick"
"""In the place of Mitsuba's `principled`, with its base_color, roughness and eta."""
_ALPHAS: Final = 48
_COSINES: Final = 96
_NORMALS: Final = 48
"""Square root of the number of normals of an albedo."""
_MOST: Final = 0.5
"""Largest alpha in the table."""


def _albedos() -> npt.NDArray[np.float32]:
    """Albedos of GGX facets that reflect once.

    Returns
    -------
    (_ALPHAS, _COSINES, 4) float32
        For alpha from 0 to `_MOST` and the cosine from 0 to 1, at the centres of texels: the albedo of facets that
        reflect everything, that with Schlick's weight (1 - cos)^5, and the averages of both over the hemisphere.
    """
    alpha = (((np.arange(_ALPHAS) + 0.5) / _ALPHAS) * _MOST)[:, None, None]
    cosine = ((np.arange(_COSINES) + 0.5) / _COSINES)[None, :, None]
    grid = (np.arange(_NORMALS) + 0.5) / _NORMALS
    one, two = (x.ravel()[None, None] for x in np.meshgrid(grid, grid))
    sine = np.sqrt(1.0 - cosine * cosine)
    # Visible normals (Heitz 2018): a disk, of which the part towards the viewer is seen from that side
    stretched = np.sqrt((alpha * sine) ** 2 + cosine**2)
    x, z = alpha * sine / stretched, cosine / stretched
    radius, angle = np.sqrt(one), 2.0 * np.pi * two
    t, u = radius * np.cos(angle), radius * np.sin(angle)
    u = (1.0 - (1.0 + z) / 2.0) * np.sqrt(1.0 - t * t) + (1.0 + z) / 2.0 * u
    w = np.sqrt(np.maximum(0.0, 1.0 - t * t - u * u))
    # The axes are (0, 1, 0), (-z, 0, x) and (x, 0, z)
    normal = np.stack([alpha * (w * x - u * z), alpha * t + 0.0 * w, np.maximum(1e-9, u * x + w * z)])
    normal /= np.linalg.norm(normal, axis=0)
    within = sine * normal[0] + cosine * normal[2]
    out = 2.0 * within * normal[2] - cosine
    tangent2 = np.maximum(0.0, 1.0 - out * out) / np.maximum(out * out, 1e-12)
    hidden = [(np.sqrt(1.0 + alpha**2 * x) - 1.0) / 2.0 for x in ((sine / cosine) ** 2, tangent2)]
    weight = np.where(out > 0.0, (1.0 + hidden[0]) / (1.0 + hidden[0] + hidden[1]), 0.0)
    each = np.stack([weight.mean(-1), (weight * (1.0 - within) ** 5).mean(-1)], axis=-1)
    average = (2.0 * each * cosine).mean(1, keepdims=True)
    return np.concatenate([each, np.broadcast_to(average, each.shape)], axis=-1).astype(np.float32)


def with_plastics(file: Path) -> Path:
    """A scene in which these plastics are in the place of Mitsuba's.

    Parameters
    ----------
    file : pathlib.Path
        An XML file of `clrender.exporters.write_mitsuba`.

    Returns
    -------
    pathlib.Path
        The new file, beside it.
    """
    tree = ElementTree.parse(file)
    for bsdf in tree.iter("bsdf"):
        kind = bsdf.get("type", "")
        bsdf.set("type", {"plastic": _SMOOTH, "principled": _ROUGH}.get(kind, kind))
    made = file.with_stem(f"{file.stem}-plastics")
    tree.write(made)
    return made


def register(mi: Any) -> None:
    """Make both known to Mitsuba.

    Parameters
    ----------
    mi : module
        Mitsuba, whose variant has been chosen.
    """
    import drjit as dr

    table = mi.Texture2f(mi.TensorXf(_albedos()))

    class Plastic(mi.BSDF):  # type: ignore[misc]
        """A plastic, smooth or rough."""

        def __init__(self, properties: Any) -> None:
            mi.BSDF.__init__(self, properties)
            self.smooth = properties.plugin_name() == _SMOOTH
            if self.smooth:
                eta = properties["int_ior"] / properties["ext_ior"]
                self.base = properties.get_texture("diffuse_reflectance")
                self.tint = properties.get_texture("specular_reflectance", 1.0)
            else:
                eta = properties["eta"]
                self.base = properties.get_texture("base_color")
                self.roughness = properties.get_texture("roughness", 0.5)
                properties.mark_queried("metallic")  # it is 0
            self.f0 = ((eta - 1.0) / (eta + 1.0)) ** 2
            reflection = mi.BSDFFlags.DeltaReflection if self.smooth else mi.BSDFFlags.GlossyReflection
            both = (reflection, mi.BSDFFlags.DiffuseReflection)
            self.m_components = [flag | mi.BSDFFlags.FrontSide for flag in both]
            self.kinds = [int(flag.value) for flag in both]
            self.m_flags = self.m_components[0] | self.m_components[1]

        def _schlick(self, cosine: Any) -> Any:
            return self.f0 + (1.0 - self.f0) * dr.power(dr.maximum(0.0, 1.0 - cosine), 5)

        def _alpha(self, si: Any, active: Any) -> Any:
            return dr.square(self.roughness.eval_1(si, active))

        def _layer(self, alpha: Any, cosine: Any) -> tuple[Any, Any]:
            """Albedo of the layer, and its average over the hemisphere."""
            if self.smooth:
                return self._schlick(cosine), self.f0 + (1.0 - self.f0) / 21.0
            one, grazing, one_average, grazing_average = table.eval([cosine, alpha / _MOST])
            f0 = self.f0
            return f0 * one + (1.0 - f0) * grazing, f0 * one_average + (1.0 - f0) * grazing_average

        def _chance(self, albedo: Any) -> Any:
            """The probability of sampling reflection."""
            return 0.1 + 0.8 * albedo

        def sample(self, ctx: Any, si: Any, sample1: Any, sample2: Any, active: Any = True) -> Any:
            cosine = mi.Frame3f.cos_theta(si.wi)
            active &= cosine > 0.0
            alpha = 0.0 if self.smooth else self._alpha(si, active)
            chance = self._chance(self._layer(alpha, cosine)[0])
            mirrored = active & (sample1 < chance)
            bs = mi.BSDFSample3f()
            bs.eta = 1.0
            normal = mi.Normal3f(0.0, 0.0, 1.0) if self.smooth else self._facets(alpha).sample(si.wi, sample2)[0]
            reflected = 2.0 * dr.dot(si.wi, normal) * mi.Vector3f(normal) - si.wi
            bs.wo = dr.select(mirrored, reflected, mi.warp.square_to_cosine_hemisphere(sample2))
            bs.sampled_component = dr.select(mirrored, mi.UInt32(0), mi.UInt32(1))
            bs.sampled_type = dr.select(mirrored, *(mi.UInt32(each) for each in self.kinds))
            value, bs.pdf = self.eval_pdf(ctx, si, bs.wo, active)
            weight = dr.select(active & (bs.pdf > 0.0), value / bs.pdf, 0.0)
            if self.smooth:
                tint = self.tint.eval(si, mirrored)
                weight = dr.select(mirrored, tint * (self._schlick(cosine) / chance), weight)
                bs.pdf = dr.select(mirrored, chance, bs.pdf)
            return bs, weight & active

        def _facets(self, alpha: Any) -> Any:
            return mi.MicrofacetDistribution(mi.MicrofacetType.GGX, alpha)

        def eval_pdf(self, ctx: Any, si: Any, wo: Any, active: Any = True) -> Any:
            i, o = mi.Frame3f.cos_theta(si.wi), mi.Frame3f.cos_theta(wo)
            active &= (i > 0.0) & (o > 0.0)
            alpha = 0.0 if self.smooth else self._alpha(si, active)
            (seen, average), (lit, _) = self._layer(alpha, i), self._layer(alpha, o)
            chance = self._chance(seen)
            value = self.base.eval(si, active) * ((1.0 - seen) * (1.0 - lit) / (1.0 - average) * o / dr.pi)
            pdf = (1.0 - chance) * o / dr.pi
            if not self.smooth:
                half, facets = dr.normalize(si.wi + wo), self._facets(alpha)
                density, within = facets.eval(half), dr.dot(si.wi, half)
                hidden = [self._hidden(alpha, each) for each in (i, o)]
                # Masking and shadowing that are correlated in height
                value += self._schlick(within) * density / ((1.0 + hidden[0] + hidden[1]) * 4.0 * i)
                pdf += chance * density / ((1.0 + hidden[0]) * 4.0 * i)
            return dr.select(active, value, 0.0), dr.select(active, pdf, 0.0)

        def _hidden(self, alpha: Any, cosine: Any) -> Any:
            """Smith's Lambda."""
            square = dr.square(cosine)
            return (dr.sqrt(1.0 + dr.square(alpha) * (1.0 - square) / square) - 1.0) / 2.0

        def eval(self, ctx: Any, si: Any, wo: Any, active: Any = True) -> Any:
            return self.eval_pdf(ctx, si, wo, active)[0]

        def pdf(self, ctx: Any, si: Any, wo: Any, active: Any = True) -> Any:
            return self.eval_pdf(ctx, si, wo, active)[1]

        def to_string(self) -> str:
            return "Plastic[]"

    for name in (_SMOOTH, _ROUGH):
        mi.register_bsdf(name, Plastic)
