"""Which extensions are supported, which are refused, and fallbacks for the others."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from clrender.importers.gltf.document import Document
from clrender.importers.gltf.rules import Walk, many, text
from clrender.wording import quoted

__all__ = ["check_declared", "check_required"]

_READ: Final = frozenset(
    {
        "EXT_mesh_gpu_instancing",
        "EXT_meshopt_compression",
        "EXT_texture_webp",
        "KHR_draco_mesh_compression",
        "KHR_lights_punctual",
        "KHR_materials_anisotropy",
        "KHR_materials_clearcoat",
        "KHR_materials_diffuse_transmission",
        "KHR_materials_dispersion",
        "KHR_materials_emissive_strength",
        "KHR_materials_ior",
        "KHR_materials_iridescence",
        "KHR_materials_pbrSpecularGlossiness",
        "KHR_materials_sheen",
        "KHR_materials_specular",
        "KHR_materials_transmission",
        "KHR_materials_unlit",
        "KHR_materials_variants",
        "KHR_materials_volume",
        "KHR_mesh_quantization",
        "KHR_meshopt_compression",
        "KHR_node_visibility",
        "KHR_texture_basisu",
        "KHR_texture_transform",
        # About the file, not about the image
        "KHR_xmp",
        "KHR_xmp_json_ld",
    }
)
_CURES: Final[Mapping[str, str]] = {
    "EXT_lights_image_based": "light of cube maps is not read; export it without, and give its light with "
    "--environment FILE",
    "KHR_lights_image_based": "light of cube maps is not read; export it without, and give its light with "
    "--environment FILE",
}
"""Why some required extensions are refused."""
_INSTEAD: Final[Mapping[str, str]] = {
    "KHR_animation_pointer": "what it moves stays as it is in the file",
    "EXT_lights_image_based": "give the environment with --environment FILE",
    "KHR_lights_image_based": "give the environment with --environment FILE",
    "EXT_lights_ies": "give such lamps as `ies` lights in a scene file",
}


def check_required(document: Document) -> None:
    """Refuse a file that requires an unsupported extension.

    Raises
    ------
    SceneError
        It requires one, or its lists of extensions are inconsistent.
    """
    walk = Walk(document)
    for key in ("extensionsUsed", "extensionsRequired"):
        if key in document.root:
            many(text(), distinct=True)(walk, document.root[key], f"/{key}")
    used, required = document.items("extensionsUsed"), document.items("extensionsRequired")
    for index, name in enumerate(required):
        if name not in used:
            lacks = f"is {quoted(name)}, but extensionsUsed lacks it; add it there"
            document.forgive(f"/extensionsRequired/{index}", lacks)
        if name not in _READ:
            why = _CURES.get(name, "that extension is not known; export it without")
            raise document.fault(f"/extensionsRequired/{index}", f"is {quoted(name)}: {why}")


def check_declared(walk: Walk, document: Document) -> None:
    """Note which extensions of a file are ignored.

    Parameters
    ----------
    walk : Walk
        After it has visited the whole file.
    document : Document

    Raises
    ------
    SceneError
        The file uses an extension that it does not declare.
    """
    used = document.items("extensionsUsed")
    for name, at in walk.met.items():
        if name not in used:
            document.forgive(at, "is an extension that extensionsUsed does not name; add it there")
    for name in dict.fromkeys((*used, *walk.met)):
        if name not in _READ:
            instead = _INSTEAD.get(name, "it was left out")
            document.note(f"{quoted(name)[1:-1]} is not read: {instead}")
