"""Checks that the names by which parts of a scene refer to each other exist and are compatible."""

from __future__ import annotations

from typing import TYPE_CHECKING

from clrender.scene.light_kinds import EnvironmentLight, SunSkyLight
from clrender.scene.materials import (
    BASE_COLORS,
    MIX_DEPTH,
    Dielectric,
    Material,
    Mix,
    Principled,
    Subsurface,
    material_parts,
    material_without_color,
    passes_light,
)
from clrender.scene.shapes import Curves, Mesh
from clrender.scene.values import fault
from clrender.wording import place, quoted, suggestion

if TYPE_CHECKING:
    from clrender.scene.contents import SceneContents

__all__ = ["check_references"]


def check_references(scene: SceneContents) -> None:
    """Raise an error for the first name that is undefined or incompatible.

    Raises
    ------
    pydantic_core.PydanticCustomError
        With the location of the name; see `clrender.scene.values.fault`.
    """
    for at, shape in scene.all_shapes():
        if shape.material is not None and shape.material not in scene.materials:
            sentence = f"names a material {quoted(shape.material)} that does not exist"
            raise fault("reference", sentence + suggestion(shape.material, scene.materials), *at, "material")
        if shape.material is not None and shape.emission is not None and _shines(scene.materials[shape.material]):
            other = place(("materials", shape.material, "emission"))
            raise fault("reference", f"is given beside {other}; keep one of them", *at, "emission")
    for i, instance in scene.instances():
        if instance.group not in scene.groups:
            sentence = f"names a group {quoted(instance.group)} that does not exist"
            raise fault("reference", sentence + suggestion(instance.group, scene.groups), "shapes", i, "group")
    _check_media(scene)
    _check_mixtures(scene)
    _check_colors(scene)
    _check_terminators(scene)
    _check_hidden(scene)
    _check_catchers(scene)
    _check_poses(scene)
    _check_curves(scene)
    environments = [i for i, light in enumerate(scene.lights) if isinstance(light, EnvironmentLight | SunSkyLight)]
    for i in environments[1:]:
        sentence = f"is a second environment beside lights[{environments[0]}]; a scene can have only one"
        raise fault("light", sentence, "lights", i)


def _check_media(scene: SceneContents) -> None:
    """Check that the media of shapes and fog exist, and that light can enter them."""
    named: list[tuple[str | None, tuple[str | int, ...]]] = [(scene.fog, ("fog",))]
    named += [(shape.interior, (*at, "interior")) for at, shape in scene.all_shapes()]
    for name, at in named:
        if name is not None and name not in scene.media:
            sentence = f"names a medium {quoted(name)} that does not exist"
            raise fault("reference", sentence + suggestion(name, scene.media), *at)
    if scene.fog is not None and scene.media[scene.fog].density is not None:
        sentence = f"names the medium {quoted(scene.fog)}, whose density is a grid and ends with its box"
        raise fault("reference", f"{sentence}; give a box as large an `interior` instead", "fog")
    for at, shape in scene.all_shapes():
        if shape.interior is None or shape.material is None:
            continue
        material = scene.materials[shape.material]
        if isinstance(material, Subsurface):
            sentence = f"is given, but the material {quoted(shape.material)} is subsurface and fills its shapes"
            raise fault("reference", f"{sentence}; leave one of them out", *at, "interior")
        if not isinstance(material, Dielectric | Principled) or not material.solid:
            sentence = f"is given, but the material {quoted(shape.material)} lets no light inside"
            cure = "give the shape a dielectric, or leave its material out"
            raise fault("reference", f"{sentence}; {cure}", *at, "interior")
        if material.attenuation_color is not None:
            other = place(("materials", shape.material, "attenuation_color"))
            raise fault("reference", f"is given beside {other}; keep one of them", *at, "interior")


def _check_mixtures(scene: SceneContents) -> None:
    """Check that each material of a mixture exists, and that none contains itself."""
    for name, material in scene.materials.items():
        if not isinstance(material, Mix):
            continue
        for i, part in enumerate(material.materials):
            if part not in scene.materials:
                sentence = f"names a material {quoted(part)} that does not exist"
                sentence += suggestion(part, scene.materials)
                raise fault("reference", sentence, "materials", name, "materials", i)
            if scene.materials[part].masked:
                sentence = f"names {quoted(part)}, which has an opacity; give the mixture one instead"
                raise fault("reference", sentence, "materials", name, "materials", i)
            if isinstance(scene.materials[part], Subsurface):
                sentence = f"names {quoted(part)}, which is subsurface: what fills a shape cannot be mixed"
                raise fault("reference", f"{sentence}; name another", "materials", name, "materials", i)
            if _shines(scene.materials[part]):
                sentence = f"names {quoted(part)}, which has emission; in a mixture it must have none"
                sentence += ": give the emission to the shapes instead"
                raise fault("reference", sentence, "materials", name, "materials", i)
    for name in scene.materials:
        parts, depth = {name}, 0
        while mixed := {p for n in parts if isinstance(m := scene.materials[n], Mix) for p in m.materials}:
            parts, depth = mixed, depth + 1
            if name in parts or depth > MIX_DEPTH:
                reason = "contains itself" if name in parts else f"is nested more than {MIX_DEPTH} deep"
                raise fault("reference", f"{reason}; give two other materials", "materials", name, "materials")


def _check_colors(scene: SceneContents) -> None:
    """Check that there is a base colour for vertex colours to multiply."""
    for at, shape in scene.all_shapes():
        if not isinstance(shape, Mesh) or shape.color_key is None:
            continue
        if shape.material is None:
            sentence = "is given, but the shape has no material whose colour it could multiply; name one"
            raise fault("mesh", sentence, *at, shape.color_key)
        plain = material_without_color(scene.materials, shape.material)
        if plain is not None:
            sentence = f"would multiply the colour of the material {quoted(plain)}, which has none"
            cure = f"give it one of {', '.join(BASE_COLORS)}, or leave {shape.color_key} out"
            raise fault("mesh", f"{sentence}; {cure}", *at, shape.color_key)


def _check_terminators(scene: SceneContents) -> None:
    """Check that only opaque shapes without emission have their shadow terminator moved."""
    for at, shape in scene.all_shapes():
        if not isinstance(shape, Mesh) or not shape.shadow_terminator_offset:
            continue
        material = None if shape.material is None else scene.materials[shape.material]
        if shape.emission is not None or (material is not None and _shines(material)):
            why = "is a light, whose light leaves the triangles themselves"
        elif shape.interior is not None or (material is not None and passes_light(scene.materials, material)):
            why = "lets light inside, which begins at the triangles themselves"
        else:
            continue
        raise fault("mesh", f"is given, but the shape {why}; leave it out", *at, "shadow_terminator_offset")


def _check_hidden(scene: SceneContents) -> None:
    """Check that no shape with an inside is hidden from the camera, whose rays would enter it through no boundary."""
    for at, shape in scene.all_shapes():
        material = None if shape.material is None else scene.materials[shape.material]
        if not shape.visible_to_camera and (shape.interior is not None or (material is not None and material.solid)):
            sentence = "cannot be false for what has an inside: rays of the camera would get there through no boundary"
            raise fault("reference", f"{sentence}; leave it out", *at, "visible_to_camera")


def _check_catchers(scene: SceneContents) -> None:
    """Check that the camera could see shadow catchers, and that they are seen by light of others alone."""
    for at, shape in scene.all_shapes():
        if not shape.shadow_catcher:
            continue
        material = None if shape.material is None else scene.materials[shape.material]
        if not shape.visible_to_camera:
            raise fault("reference", "is given for what the camera does not see; leave it out", *at, "shadow_catcher")
        if shape.shines or (material is not None and _shines(material)):
            sentence = "is given for what shines, and its own light is no shadow; leave it out, or the emission"
            raise fault("reference", sentence, *at, "shadow_catcher")


def _check_poses(scene: SceneContents) -> None:
    """Check that what changes its form does not shine: its light is sampled in one place."""
    for at, shape in scene.all_shapes():
        if not isinstance(shape, Mesh) or not shape.poses:
            continue
        material = None if shape.material is None else scene.materials[shape.material]
        if shape.shines or (material is not None and _shines(material)):
            raise fault(
                "reference", "are given for what shines, which keeps its form; leave one of them out", *at, "poses"
            )


def _check_curves(scene: SceneContents) -> None:
    """Check that curves are opaque or thin: rays that are within one meet no surface of it."""
    for at, shape in scene.all_shapes():
        if not isinstance(shape, Curves) or shape.material is None:
            continue
        parts = list(material_parts(scene.materials, shape.material))
        if any(part.solid for part in parts):
            sentence = f"names {quoted(shape.material)}, which has an inside, and curves have none"
            raise fault("reference", f"{sentence}; give them an opaque or thin material", *at, "material")
        if any(_shines(part) for part in parts):
            sentence = f"names {quoted(shape.material)}, which shines, and curves cannot"
            raise fault("reference", f"{sentence}; give them another", *at, "material")


def _shines(material: Material) -> bool:
    return isinstance(material, Principled) and material.shines
