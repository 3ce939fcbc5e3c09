"""Scene descriptions: the validated model, scene files, and what the files hold that they name."""

from __future__ import annotations

from clrender.errors import SceneError
from clrender.meshes.data import MeshData
from clrender.scene.description import (
    Camera,
    DirectionalLight,
    EnvironmentLight,
    IesLight,
    Image,
    Light,
    PluginLight,
    PointLight,
    ProjectorLight,
    Render,
    Scene,
    SpotLight,
    SunSkyLight,
)
from clrender.scene.load import builtin_names, load
from clrender.scene.materials import (
    Conductor,
    Dielectric,
    Lambert,
    Material,
    Mirror,
    Mix,
    OrenNayar,
    PluginMaterial,
    Principled,
    Subsurface,
)
from clrender.scene.shapes import Box, Curves, Disk, Mesh, Quad, Shape, Sphere, Tetrahedron, Transform, Triangle

__all__ = [
    "Box",
    "Camera",
    "Conductor",
    "Curves",
    "Dielectric",
    "DirectionalLight",
    "Disk",
    "EnvironmentLight",
    "IesLight",
    "Image",
    "Lambert",
    "Light",
    "Material",
    "Mesh",
    "MeshData",
    "Mirror",
    "Mix",
    "OrenNayar",
    "PluginLight",
    "PluginMaterial",
    "PointLight",
    "Principled",
    "ProjectorLight",
    "Quad",
    "Render",
    "Scene",
    "SceneError",
    "Shape",
    "Sphere",
    "SpotLight",
    "Subsurface",
    "SunSkyLight",
    "Tetrahedron",
    "Transform",
    "Triangle",
    "builtin_names",
    "load",
]
