"""Schema tables of glTF 2.0: the properties of objects, and their valid values (specification, section 5)."""

from __future__ import annotations

from typing import Final

from clrender.importers.gltf.extension_schema import (
    BUFFER_EXTENSIONS,
    LIGHTS,
    MATERIAL_EXTENSIONS,
    NODE_EXTENSIONS,
    PRIMITIVE_EXTENSIONS,
    TEXTURE_EXTENSIONS,
    TEXTURE_INFO,
    TEXTURE_TRANSFORM,
    VARIANTS,
    VIEW_EXTENSIONS,
)
from clrender.importers.gltf.rules import Table, choice, flag, integer, many, named, number, ref, share, text

__all__ = ["COMPONENTS", "ROOT"]

_COMPONENT_TYPES: Final = (5120, 5121, 5122, 5123, 5125, 5126)
COMPONENTS: Final = {
    "SCALAR": (1, 1),
    "VEC2": (1, 2),
    "VEC3": (1, 3),
    "VEC4": (1, 4),
    "MAT2": (2, 2),
    "MAT3": (3, 3),
    "MAT4": (4, 4),
}
"""Columns, and components per column, by accessor type."""
_COUNT: Final = integer(1)

_SPARSE = Table(
    "accessor.sparse",
    {
        "count": _COUNT,
        "indices": Table(
            "accessor.sparse.indices",
            {
                "bufferView": ref("bufferViews"),
                "byteOffset": integer(),
                "componentType": integer(among=(5121, 5123, 5125)),
            },
            ("bufferView", "componentType"),
        ),
        "values": Table(
            "accessor.sparse.values", {"bufferView": ref("bufferViews"), "byteOffset": integer()}, ("bufferView",)
        ),
    },
    ("count", "indices", "values"),
)
_ACCESSOR = Table(
    "an accessor",
    {
        "bufferView": ref("bufferViews"),
        "byteOffset": integer(),
        "componentType": integer(among=_COMPONENT_TYPES),
        "normalized": flag(),
        "count": _COUNT,
        "type": choice(*COMPONENTS),
        "max": many(number(), 1, 16),
        "min": many(number(), 1, 16),
        "sparse": _SPARSE,
    },
    ("componentType", "count", "type"),
)
_ASSET = Table(
    "asset", {"copyright": text(), "generator": text(), "version": text(), "minVersion": text()}, ("version",)
)
_BUFFER = Table("a buffer", {"uri": text(), "byteLength": _COUNT}, ("byteLength",), BUFFER_EXTENSIONS)
_BUFFER_VIEW = Table(
    "a buffer view",
    {
        "buffer": ref("buffers"),
        "byteOffset": integer(),
        "byteLength": integer(),
        "byteStride": integer(4, 252),
        "target": integer(among=(34962, 34963)),
    },
    ("buffer", "byteLength"),
    VIEW_EXTENSIONS,
)
_FAR = {"znear": number(0.0), "zfar": number(above=0.0)}
_CAMERA = Table(
    "a camera",
    {
        "type": choice("perspective", "orthographic"),
        "perspective": Table(
            "a perspective camera",
            {
                **_FAR,
                "znear": number(above=0.0),
                "aspectRatio": number(above=0.0),
                "yfov": number(above=0.0),
            },
            ("yfov", "znear"),
        ),
        "orthographic": Table(
            "an orthographic camera",
            {**_FAR, "xmag": number(), "ymag": number()},
            ("xmag", "ymag", "zfar", "znear"),
        ),
    },
    ("type",),
)
_IMAGE = Table("an image", {"uri": text(), "mimeType": text(), "bufferView": ref("bufferViews")})
_MATERIAL = Table(
    "a material",
    {
        "pbrMetallicRoughness": Table(
            "pbrMetallicRoughness",
            {
                "baseColorFactor": many(share(), 4, 4),
                "baseColorTexture": TEXTURE_INFO,
                "metallicFactor": share(),
                "roughnessFactor": share(),
                "metallicRoughnessTexture": TEXTURE_INFO,
            },
        ),
        "normalTexture": Table(
            "a normal texture",
            {**TEXTURE_INFO.properties, "scale": number()},
            ("index",),
            TEXTURE_TRANSFORM,
        ),
        "occlusionTexture": Table(
            "an occlusion texture",
            {**TEXTURE_INFO.properties, "strength": share()},
            ("index",),
            TEXTURE_TRANSFORM,
        ),
        "emissiveTexture": TEXTURE_INFO,
        "emissiveFactor": many(number(0.0, 1.0), 3, 3),
        "alphaMode": choice("OPAQUE", "MASK", "BLEND"),
        "alphaCutoff": number(0.0),
        "doubleSided": flag(),
    },
    (),
    MATERIAL_EXTENSIONS,
)
_PRIMITIVE = Table(
    "a primitive",
    {
        "attributes": named(ref("accessors")),
        "indices": ref("accessors"),
        "material": ref("materials"),
        "mode": integer(0, 6),
        "targets": many(named(ref("accessors"))),
    },
    ("attributes",),
    PRIMITIVE_EXTENSIONS,
)
_NODE = Table(
    "a node",
    {
        "camera": ref("cameras"),
        "children": many(ref("nodes"), distinct=True),
        "skin": ref("skins"),
        "matrix": many(number(), 16, 16),
        "mesh": ref("meshes"),
        "rotation": many(number(), 4, 4),
        "scale": many(number(), 3, 3),
        "translation": many(number(), 3, 3),
        "weights": many(number()),
    },
    (),
    NODE_EXTENSIONS,
)
_ANIMATION = Table(
    "an animation",
    {
        "channels": many(
            Table(
                "a channel",
                {
                    "sampler": integer(),
                    "target": Table(
                        "a channel's target",
                        {
                            "node": ref("nodes"),
                            "path": choice("translation", "rotation", "scale", "weights", "pointer"),
                        },
                        ("path",),
                    ),
                },
                ("sampler", "target"),
            )
        ),
        "samplers": many(
            Table(
                "an animation sampler",
                {
                    "input": ref("accessors"),
                    "interpolation": choice("LINEAR", "STEP", "CUBICSPLINE"),
                    "output": ref("accessors"),
                },
                ("input", "output"),
            )
        ),
    },
    ("channels", "samplers"),
)
_WRAP = integer(among=(33071, 33648, 10497))
_SAMPLER = Table(
    "a sampler",
    {
        "magFilter": integer(among=(9728, 9729)),
        "minFilter": integer(among=(9728, 9729, 9984, 9985, 9986, 9987)),
        "wrapS": _WRAP,
        "wrapT": _WRAP,
    },
)
_SKIN = Table(
    "a skin",
    {
        "inverseBindMatrices": ref("accessors"),
        "skeleton": ref("nodes"),
        "joints": many(ref("nodes"), distinct=True, filled=True),
    },
    ("joints",),
)
ROOT: Final = Table(
    "a glTF file",
    {
        "extensionsUsed": many(text(), distinct=True),
        "extensionsRequired": many(text(), distinct=True),
        "accessors": many(_ACCESSOR),
        "animations": many(_ANIMATION),
        "asset": _ASSET,
        "buffers": many(_BUFFER),
        "bufferViews": many(_BUFFER_VIEW),
        "cameras": many(_CAMERA),
        "images": many(_IMAGE),
        "materials": many(_MATERIAL),
        "meshes": many(
            Table("a mesh", {"primitives": many(_PRIMITIVE, filled=True), "weights": many(number())}, ("primitives",))
        ),
        "nodes": many(_NODE),
        "samplers": many(_SAMPLER),
        "scene": ref("scenes"),
        "scenes": many(Table("a scene", {"nodes": many(ref("nodes"), distinct=True)})),
        "skins": many(_SKIN),
        "textures": many(
            Table("a texture", {"sampler": ref("samplers"), "source": ref("images")}, (), TEXTURE_EXTENSIONS)
        ),
    },
    ("asset",),
    {"KHR_lights_punctual": LIGHTS, "KHR_materials_variants": VARIANTS},
)
"""The whole file."""
