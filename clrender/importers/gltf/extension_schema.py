"""Schema tables of supported extensions; see `clrender.importers.gltf.extensions` for all others."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

from clrender.importers.gltf.rules import (
    Rule,
    Table,
    Walk,
    choice,
    flag,
    integer,
    many,
    named,
    number,
    ref,
    share,
    text,
)

__all__ = [
    "BUFFER_EXTENSIONS",
    "LIGHTS",
    "MATERIAL_EXTENSIONS",
    "MESHOPT",
    "NODE_EXTENSIONS",
    "PRIMITIVE_EXTENSIONS",
    "TEXTURE_EXTENSIONS",
    "TEXTURE_INFO",
    "TEXTURE_TRANSFORM",
    "VARIANTS",
    "VIEW_EXTENSIONS",
]

_SHARE: Final = share()
_COLOR: Final = many(_SHARE, 3, 3)
_PAIR: Final = many(number(-1e6, 1e6), 2, 2)

TEXTURE_TRANSFORM: Final[Mapping[str, Rule]] = {
    "KHR_texture_transform": Table(
        "KHR_texture_transform",
        {"offset": _PAIR, "rotation": number(), "scale": _PAIR, "texCoord": integer()},
    )
}
TEXTURE_INFO: Final = Table(
    "a reference to a texture", {"index": ref("textures"), "texCoord": integer()}, ("index",), TEXTURE_TRANSFORM
)
_NORMAL: Final = Table(
    "a normal texture", {**TEXTURE_INFO.properties, "scale": number()}, ("index",), TEXTURE_TRANSFORM
)


def _material(name: str, **properties: Rule) -> tuple[str, Rule]:
    return f"KHR_materials_{name}", Table(f"KHR_materials_{name}", properties)


MATERIAL_EXTENSIONS: Final[Mapping[str, Rule]] = dict(
    [
        _material("anisotropy", anisotropyStrength=_SHARE, anisotropyRotation=number(), anisotropyTexture=TEXTURE_INFO),
        _material(
            "clearcoat",
            clearcoatFactor=_SHARE,
            clearcoatTexture=TEXTURE_INFO,
            clearcoatRoughnessFactor=_SHARE,
            clearcoatRoughnessTexture=TEXTURE_INFO,
            clearcoatNormalTexture=_NORMAL,
        ),
        _material(
            "diffuse_transmission",
            diffuseTransmissionFactor=_SHARE,
            diffuseTransmissionTexture=TEXTURE_INFO,
            diffuseTransmissionColorFactor=_COLOR,
            diffuseTransmissionColorTexture=TEXTURE_INFO,
        ),
        _material("emissive_strength", emissiveStrength=number(0.0)),
        _material("ior", ior=number(0.0)),
        _material("dispersion", dispersion=number(0.0)),
        _material(
            "iridescence",
            iridescenceFactor=_SHARE,
            iridescenceTexture=TEXTURE_INFO,
            iridescenceIor=number(1.0),
            iridescenceThicknessMinimum=number(0.0),
            iridescenceThicknessMaximum=number(0.0),
            iridescenceThicknessTexture=TEXTURE_INFO,
        ),
        _material(
            "pbrSpecularGlossiness",
            diffuseFactor=many(_SHARE, 4, 4),
            diffuseTexture=TEXTURE_INFO,
            specularFactor=_COLOR,
            glossinessFactor=_SHARE,
            specularGlossinessTexture=TEXTURE_INFO,
        ),
        _material(
            "sheen",
            sheenColorFactor=_COLOR,
            sheenColorTexture=TEXTURE_INFO,
            sheenRoughnessFactor=_SHARE,
            sheenRoughnessTexture=TEXTURE_INFO,
        ),
        _material(
            "specular",
            specularFactor=_SHARE,
            specularTexture=TEXTURE_INFO,
            specularColorFactor=many(number(0.0), 3, 3),
            specularColorTexture=TEXTURE_INFO,
        ),
        _material("transmission", transmissionFactor=_SHARE, transmissionTexture=TEXTURE_INFO),
        _material("unlit"),
        _material(
            "volume",
            thicknessFactor=number(0.0),
            thicknessTexture=TEXTURE_INFO,
            attenuationDistance=number(above=0.0),
            attenuationColor=_COLOR,
        ),
    ]
)
MESHOPT: Final = ("EXT_meshopt_compression", "KHR_meshopt_compression")
"""Names of one extension. The second adds a filter and a version of the data; both are read under either name."""
BUFFER_EXTENSIONS: Final[Mapping[str, Rule]] = {name: Table(name, {"fallback": flag()}) for name in MESHOPT}
VIEW_EXTENSIONS: Final[Mapping[str, Rule]] = {
    name: Table(
        name,
        {
            "buffer": ref("buffers"),
            "byteOffset": integer(),
            "byteLength": integer(1),
            "byteStride": integer(1),
            "count": integer(1),
            "mode": text(),
            "filter": text(),
        },
        ("buffer", "byteLength", "byteStride", "count", "mode"),
    )
    for name in MESHOPT
}
PRIMITIVE_EXTENSIONS: Final[Mapping[str, Rule]] = {
    "KHR_draco_mesh_compression": Table(
        "KHR_draco_mesh_compression",
        {"bufferView": ref("bufferViews"), "attributes": named(integer())},
        ("bufferView", "attributes"),
    ),
    "KHR_materials_variants": Table(
        "KHR_materials_variants",
        {
            "mappings": many(
                Table(
                    "a mapping of variants",
                    {"variants": many(integer()), "material": ref("materials")},
                    ("variants", "material"),
                )
            )
        },
        ("mappings",),
    ),
}
VARIANTS: Final = Table("KHR_materials_variants", {"variants": many(Table("a variant", {}, ("name",)))}, ("variants",))
TEXTURE_EXTENSIONS: Final[Mapping[str, Rule]] = {
    "EXT_texture_webp": Table("EXT_texture_webp", {"source": ref("images")}),
    "KHR_texture_basisu": Table("KHR_texture_basisu", {"source": ref("images")}),
}


def _light_of_node(walk: Walk, value: Any, at: str) -> Any:
    found = Table("a light's place", {"light": integer()}, ("light",))(walk, value, at)
    lights = walk.root.get("extensions", {})
    for key in ("KHR_lights_punctual", "lights"):
        lights = lights.get(key) if isinstance(lights, dict) else None
    size = len(lights) if isinstance(lights, list) else 0
    if found["light"] >= size:
        raise walk.fault(
            f"{at}/light", f"is {found['light']}, but there are {size or 'no'} lights; name one that exists"
        )
    return found


NODE_EXTENSIONS: Final[Mapping[str, Rule]] = {
    "KHR_lights_punctual": _light_of_node,
    "EXT_mesh_gpu_instancing": Table(
        "EXT_mesh_gpu_instancing", {"attributes": named(ref("accessors"))}, ("attributes",)
    ),
    "KHR_node_visibility": Table("KHR_node_visibility", {"visible": flag()}),
}
LIGHTS: Final = Table(
    "KHR_lights_punctual",
    {
        "lights": many(
            Table(
                "a light",
                {
                    "type": choice("directional", "point", "spot"),
                    "color": many(number(0.0), 3, 3),
                    "intensity": number(0.0),
                    "range": number(above=0.0),
                    "spot": Table("a spot", {"innerConeAngle": number(0.0), "outerConeAngle": number(above=0.0)}),
                },
                ("type",),
            ),
            0,
        )
    },
    ("lights",),
)
