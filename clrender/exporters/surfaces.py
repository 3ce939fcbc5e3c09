"""Properties of surfaces as other programs ask for them: emission, roughness, texture coordinates, and the inside."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from clrender.exporters.pictures import turns_slopes
from clrender.exporters.target import Target
from clrender.exporters.triangles import DISK_EDGES, SPHERE_STEPS, At, texture_sets
from clrender.flatten.measured import measured_color
from clrender.flatten.media import absorption_coefficients
from clrender.flatten.subsurface import single_scattering
from clrender.flatten.tubes import AROUND
from clrender.meshes.data import MeshData
from clrender.scene import Curves, Disk, Mesh, Scene, Sphere
from clrender.scene.materials import (
    SMOOTH_BELOW,
    Conductor,
    Dielectric,
    Iridescent,
    Lambert,
    Material,
    Measured,
    Principled,
    Subsurface,
    material_parts,
)
from clrender.scene.medium import Grids
from clrender.scene.shapes import AnyShape
from clrender.scene.textures import Texture
from clrender.scene.values import Vector

__all__ = [
    "BUMP_BESIDE",
    "GLOSS_OF_SHEETS",
    "ONCE",
    "Inside",
    "alphas_of",
    "boundaries",
    "inside_named",
    "inside_of",
    "inside_of_subsurface",
    "is_boundary",
    "is_brushed",
    "is_rough",
    "maps_normals",
    "passes",
    "radiance_of",
    "tell_of_film",
    "tell_of_glow",
    "tell_of_grid",
    "tell_of_meshes",
    "tell_of_round",
    "texture_set",
    "turns_green",
    "without_measured",
]

BUMP_BESIDE: Final = "the bump map beside a normal map"
GLOSS_OF_SHEETS: Final = "the gloss of sheets with diffuse transmission"
ONCE: Final = "multiple scattering between microfacets, so that rough surfaces are darker"
"""What most programs leave out."""


def tell_of_film(target: Target, material: Material, at: At) -> None:
    """Note that a thin film is left out.

    Parameters
    ----------
    target : Target
    material : Material
    at : tuple of str or int
        Its location.
    """
    if isinstance(material, Iridescent) and material.filmed:
        target.leave_out("thin films, so that surfaces do not iridesce", *at, "iridescence")


def without_measured(target: Target, material: Material, at: At, written_as: str) -> Material:
    """A material, in whose place there is a diffuse one of its mean colour if its reflectance is measured.

    Parameters
    ----------
    target : Target
    material : Material
    at : tuple of str or int
        Its location.
    written_as : str
        What the program calls diffuse surfaces.
    """
    if not isinstance(material, Measured):
        return material
    target.leave_out(f"measured reflectance, which is written as {written_as}", *at)
    kept = material.model_dump(exclude={"type", "file", "anisotropy_rotation"}, exclude_unset=True)
    color = measured_color(target.scene, str(at[-1]), material)
    return Lambert.model_validate({"type": "lambert", "reflectance": color, **kept})


@dataclass(frozen=True)
class Inside:
    """A medium behind a surface.

    Attributes
    ----------
    key : str
        Distinguishes it from others.
    name : str
        A name for it.
    absorption, scattering : three floats
        Coefficients, per metre.
    g : float
        Mean cosine of scattering.
    grids : Grids or None
        Those by which both are multiplied, and others.
    glows : bool
        Whether it shines.
    """

    key: str
    name: str
    absorption: Vector
    scattering: Vector
    g: float
    grids: Grids | None = None
    glows: bool = False


def is_boundary(material: Material) -> bool:
    """Whether light passes a material into a medium."""
    return material.solid and not (isinstance(material, Subsurface) and material.ior is None)


def boundaries(scene: Scene) -> set[At]:
    """Places of the shapes that light passes into a medium: each is closed in itself."""
    return {at for at, shape in scene.all_shapes() if passes(scene, shape)}


def passes(scene: Scene, shape: AnyShape) -> bool:
    """Whether light passes a shape into a medium, or nothing but a medium is there."""
    if shape.material is None:
        return shape.interior is not None
    return is_boundary(scene.materials[shape.material])


def inside_named(scene: Scene, name: str) -> Inside:
    """One of the scene's media, such as that of shapes or the fog."""
    medium = scene.media[name]
    numbers = medium.absorption, medium.scattering, medium.g
    return Inside(f"media.{name}", name, *numbers, medium.grids, medium.glows)


def inside_of(scene: Scene, shape: AnyShape) -> Inside | None:
    """The medium behind a shape's front, if any."""
    if shape.interior is not None:
        return inside_named(scene, shape.interior)
    name = shape.material
    material = None if name is None else scene.materials[name]
    key, wanted = f"materials.{name}", f"inside of {name}"
    if isinstance(material, Dielectric | Principled) and material.attenuation_color is not None:
        return Inside(key, wanted, absorption_coefficients(material), (0.0, 0.0, 0.0), 0.0)
    if isinstance(material, Subsurface) and material.ior is not None:
        return inside_of_subsurface(key, wanted, material)
    return None


def tell_of_glow(target: Target, inside: Inside | None) -> None:
    """Note that a medium does not shine there."""
    if inside is not None and inside.glows:
        target.leave_out("the emission of media", "media", inside.name, "emission")


def tell_of_grid(target: Target, inside: Inside | None) -> None:
    """Note that a medium is written as if it were the same everywhere."""
    if inside is not None and inside.grids is not None:
        target.leave_out("grids of densities, of which media have 1 everywhere", "media", inside.name, "density")
        if inside.grids.albedo is not None:
            target.leave_out("grids of albedos, of which media have 1 everywhere", "media", inside.name, "albedo")


def inside_of_subsurface(key: str, name: str, material: Subsurface) -> Inside:
    """The medium in which light walks at random; for `key` and `name` see `Inside`."""
    shares = np.array([single_scattering(albedo, material.g) for albedo in material.albedo])
    whole = 1.0 / np.array(material.radius)
    lost, turned = (tuple(each.tolist()) for each in (whole * (1.0 - shares), whole * shares))
    return Inside(key, name, lost, turned, material.g)


def radiance_of(scene: Scene, at: At, shape: AnyShape) -> tuple[Any, At, float]:
    """Colour or texture of the radiance of a shape that emits, its place in the scene, and a factor for it."""
    if shape.emission is not None:
        return shape.emission, (*at, "emission"), 1.0
    assert shape.material is not None
    material = scene.materials[shape.material]
    assert isinstance(material, Principled)
    return material.emission, ("materials", shape.material, "emission"), material.emission_strength


def texture_set(target: Target, at: At, shape: AnyShape) -> int | None:
    """The set of texture coordinates that a shape's textures use; None if it has no textures."""
    sets = texture_sets(target.scene, shape)
    if len(sets) > 1:
        target.leave_out("the second set of texture coordinates, where both are used", *at)
    return sets[0] if sets else None


def maps_normals(scene: Scene, shape: AnyShape) -> bool:
    """Whether a shape's material has normal maps."""
    return any(getattr(part, "normal_map", None) for part in material_parts(scene.materials, shape.material))


def turns_green(target: Target, at: At, shape: AnyShape, mesh: MeshData) -> bool:
    """Whether green of normal maps points against front × red, where most programs look for it.

    Parameters
    ----------
    target : Target
    at : tuple of str or int
        Place of the shape.
    shape : AnyShape
        One with normal maps.
    mesh : MeshData
        Its triangles, counter-clockwise seen from the front.
    """
    uvs = mesh.uvs if texture_set(target, at, shape) == 0 else mesh.uvs_1
    assert uvs is not None  # which normal maps need
    u, v = np.moveaxis(uvs[:, 1:] - uvs[:, :1], 2, 0).astype(np.float64)
    areas = u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]
    forward, backward = int(np.count_nonzero(areas > 0.0)), int(np.count_nonzero(areas < 0.0))
    maps = (getattr(part, "normal_map", None) for part in material_parts(target.scene.materials, shape.material))
    turned = any(each is not None and turns_slopes(each) for each in maps)
    if turned and isinstance(shape, Mesh) and target.scene.mesh_of(at, shape).tangents is not None:
        target.leave_out("tangents of meshes with normal maps that are turned, which turn with the picture", *at)
    if forward and backward:
        sentence = "normal maps where a part of the texture coordinates is mirrored: green is that of most triangles"
        target.leave_out(sentence, *at)
    return backward > forward


def tell_of_meshes(target: Target, at: At, shape: AnyShape) -> None:
    """Note what other programs' meshes lack."""
    if isinstance(shape, Mesh):
        if shape.color_key is not None:
            target.leave_out("colours of vertices", *at, shape.color_key)
        if shape.shadow_terminator_offset:
            target.leave_out("the shadow terminator offset", *at)


def tell_of_round(target: Target, at: At, shape: AnyShape) -> None:
    """Note that spheres and disks become triangles."""
    if isinstance(shape, Sphere):
        faces = 4 * SPHERE_STEPS * (SPHERE_STEPS - 1)
        target.leave_out(f"the roundness of spheres, which have {faces:,} triangles and interpolated normals", *at)
    elif isinstance(shape, Disk):
        target.leave_out(f"the roundness of disks, which have {DISK_EDGES} edges", *at)
    elif isinstance(shape, Curves):
        tell_of_curves(target, shape, at)


def tell_of_curves(target: Target, shape: Curves, at: At) -> None:
    """Note that round curves become triangles."""
    if shape.profile == "round":
        target.leave_out(f"the roundness of curves, which have {AROUND} edges around them and flat ends", *at)


def is_rough(roughness: Any) -> bool:
    """Whether it is more than a delta distribution, at least at some points."""
    return isinstance(roughness, Texture) or roughness * roughness >= SMOOTH_BELOW


def is_brushed(material: Any) -> bool:
    """Whether it is anisotropic."""
    return isinstance(material, Conductor | Principled) and material.anisotropy != 0.0


def alphas_of(target: Target, material: Conductor | Principled, at: At) -> tuple[float, float] | None:
    """Alpha along u and along v; None if the surface is isotropic, or has textures of them."""
    if material.anisotropy == 0.0:
        return None
    if not isinstance(material.anisotropy, float) or not isinstance(material.roughness, float):
        target.leave_out("anisotropy where it, or the roughness, is a texture", *at)
        return None
    quarters = material.anisotropy_rotation / 90.0
    if quarters != round(quarters):
        target.leave_out("the rotation of anisotropy by other than quarter turns", *at)
    least = material.roughness * material.roughness
    most = least + (1.0 - least) * material.anisotropy * material.anisotropy
    return (least, most) if round(quarters) % 2 else (most, least)
