"""Has every kernel work on small things, on the first device there is, and prints what came out.

``python interpreted.py NAME …`` with names as of `perform`; test_oclgrind.py starts it inside Oclgrind, and calls
`perform` itself on another device, for comparison.
"""

from __future__ import annotations

import hashlib
import sys
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Final
from unittest.mock import patch

import numpy as np
from measured_files import rgl_fields, write_merl, write_tensors
from meshes import icosphere
from PIL import Image

from clrender import layout
from clrender.aov import FIRST_HITS, LAYER_KINDS, LayerArguments, LayerKind
from clrender.bidirectional.light_paths import LightPaths
from clrender.device import bvh, radix_sort
from clrender.device.bvh import cost
from clrender.device.device import Buffer, Device, Program
from clrender.device.device_film import DeviceFilm
from clrender.device.formulas import Formula
from clrender.device.info import DeviceInfo
from clrender.device.launch import LaunchConfig, Scratch
from clrender.device.preparation import DevicePreparation
from clrender.device.radix_sort import CHUNK
from clrender.device.replicates import ReplicateSums
from clrender.device.scene_arrays import SceneArrays
from clrender.device.worker import DeviceWorker
from clrender.drivers.arithmetic import check as arithmetic_check
from clrender.drivers.discover import drivers, load_platforms
from clrender.files.package_data import scenes_folder
from clrender.film import Film
from clrender.film.unit import Unit, UnitSums, slot_count
from clrender.flatten.flat_box import scene_box
from clrender.flatten.flat_scene import flatten
from clrender.flatten.plugin_lights import light_grid
from clrender.furnace.directions import incident
from clrender.furnace.surfaces import Surfaces
from clrender.guiding.field import FACES, GuidingField, cell_rows, empty_field, histogram_words
from clrender.guiding.preparation import PIPELINE as GUIDED
from clrender.guiding.preparation import GuidedPaths
from clrender.guiding.training import PIPELINE as TRAINING
from clrender.guiding.training import FieldSums
from clrender.image.files import write_image
from clrender.inspection.pipelines import PIPELINES as RECORDING
from clrender.inspection.reading import as_rows, written
from clrender.integrators import INTEGRATORS
from clrender.photon.maps import PhotonMaps
from clrender.plugins import plugin as plugin_of
from clrender.radiosity.atlas import atlas_of
from clrender.radiosity.display import GATHER, Display, Gather, looks_of
from clrender.radiosity.dynamic import DynamicRadiosity
from clrender.radiosity.factors import hemicube_cells
from clrender.radiosity.solution import RadiositySettings
from clrender.radiosity.tracer import Tracer
from clrender.scene import Scene
from clrender.scene.environment import EnvironmentPicture
from clrender.settings import RenderSettings

if TYPE_CHECKING:
    from clrender.flatten.flat_scene import FlatScene

__all__ = ["RENDERS", "Run", "perform"]

WIDTH: Final = 7
HEIGHT: Final = 6
TILE: Final = 8


@dataclass(frozen=True)
class Run:
    """One render.

    Attributes
    ----------
    kernel : str
        An integrator's name, or one of `others`.
    lanes : int
    traversal : str
    samples : int
    large : bool
        With a mesh whose triangles need more than one chunk of the builder's sort, and a tree of several levels.
    rough : bool
        With rough materials.
    sky : bool
        With a picture of the environment.
    interiors : bool
        With dielectrics that overlap and absorb, and the camera in one of them.
    textured : bool
        With textures, also as emission, and normal and bump maps.
    filter : str
        Of pixels.
    media : bool
        With media that scatter, in shapes and around them.
    skin : bool
        With subsurface materials, of which one has a lamp inside.
    lamps : bool
        With spots and IES files, so many that there is a tree of lights.
    opacity : str
        Of materials: ``holes`` where textures say so, or ``veil``, the same everywhere.
    sun : bool
        With sun and sky in the place of an environment.
    instances : bool
        With all shapes but the floor in a group, which stands there twice, once mirrored.
    replicate : int
        Samples of a replicate; 0: none.
    universal : bool
        By the program for any scene.
    calibrated : str
        Distortion of the camera's lens; empty: none.
    motion : bool
        With shapes, a lamp and the camera that move while the shutter is open.
    plugins : bool
        With BSDFs, a texture and lights of plugins.
    grids : bool
        With media whose density is a grid, and which shine.
    strands : bool
        With curves of hair and of the matt material.
    measured : bool
        With the reflectance of measured surfaces, one of them anisotropic, in the place of mirror and metal.
    films : bool
        With thin films on glass, metal and plastic, one of them as thick as a picture says.
    spectral : str
        At wavelengths: ``colors`` that the scene has, or ``spectra`` of lights and materials and glass that disperses.
    """

    kernel: str
    lanes: int
    traversal: str = "packet"
    samples: int = 1
    large: bool = False
    rough: bool = False
    sky: bool = False
    interiors: bool = False
    textured: bool = False
    filter: str = "box"
    media: bool = False
    skin: bool = False
    lamps: bool = False
    opacity: str = ""
    sun: bool = False
    instances: bool = False
    replicate: int = 0
    universal: bool = False
    calibrated: str = ""
    motion: bool = False
    plugins: bool = False
    grids: bool = False
    strands: bool = False
    measured: bool = False
    films: bool = False
    spectral: str = ""


RENDERS: Final = {
    "path-1": Run("path", 1, samples=2),
    "path-4": Run("path", 4),
    "path-8-single": Run("path", 8, "single"),
    "path-1-rough": Run("path", 1, rough=True),
    "path-4-rough": Run("path", 4, samples=2, rough=True),
    "path-4-sky": Run("path", 4, samples=2, sky=True),
    "path-1-sky": Run("path", 1, sky=True),
    "photon-4-sky": Run("photon", 4, sky=True),
    "path-4-interiors": Run("path", 4, samples=2, interiors=True),
    "photon-4-interiors": Run("photon", 4, samples=2, interiors=True),
    "whitted-1-interiors": Run("whitted", 1, samples=2, interiors=True),
    "path-4-media": Run("path", 4, samples=2, media=True),
    "path-1-media": Run("path", 1, rough=True, media=True),
    "path-4-instances": Run("path", 4, samples=2, instances=True),
    "path-8-single-instances": Run("path", 8, "single", instances=True, textured=True),
    "path-4-instances-holes": Run("path", 4, instances=True, opacity="holes"),
    "path-1-instances-holes": Run("path", 1, instances=True, opacity="holes"),
    "path-4-skin": Run("path", 4, samples=2, skin=True),
    "path-1-skin": Run("path", 1, rough=True, textured=True, skin=True),
    "path-4-textured": Run("path", 4, samples=2, textured=True),
    "whitted-1-textured": Run("whitted", 1, textured=True),
    "photon-4-textured": Run("photon", 4, textured=True),
    "path-4-filter": Run("path", 4, samples=2, filter="mitchell"),
    "reuse-4-filter": Run("reuse", 4, samples=2, filter="mitchell"),
    "path-1-filter": Run("path", 1, filter="gaussian"),
    "path-4-lamps": Run("path", 4, samples=2, lamps=True),
    "path-4-universal": Run("path", 4, samples=2, universal=True),
    "path-1-universal": Run("path", 1, universal=True),
    "path-4-sky-universal": Run("path", 4, sky=True, universal=True),
    "path-4-media-universal": Run("path", 4, media=True, universal=True),
    "path-4-holes-universal": Run("path", 4, opacity="holes", universal=True),
    "path-4-veil-universal": Run("path", 4, opacity="veil", universal=True),
    "reuse-4-universal": Run("reuse", 4, samples=2, universal=True),
    "whitted-4-universal": Run("whitted", 4, universal=True),
    "path-1-lamps": Run("path", 1, lamps=True),
    "whitted-1-lamps": Run("whitted", 1, lamps=True),
    "photon-4-lamps": Run("photon", 4, lamps=True),
    "path-4-holes": Run("path", 4, samples=2, opacity="holes"),
    "path-8-single-holes": Run("path", 8, "single", opacity="holes"),
    "path-1-veil": Run("path", 1, opacity="veil"),
    "reuse-4-veil": Run("reuse", 4, opacity="veil"),
    "photon-4-holes": Run("photon", 4, opacity="holes"),
    "path-4-sun": Run("path", 4, samples=2, sun=True),
    "path-1-sun": Run("path", 1, rough=True, lamps=True, sun=True),
    "whitted-1-sun": Run("whitted", 1, sun=True),
    "photon-4-sun": Run("photon", 4, sun=True),
    "staged-1": Run("staged", 1, samples=2),
    "staged-1-media": Run("staged", 1, rough=True, media=True, skin=True),
    "staged-1-holes": Run("staged", 1, instances=True, opacity="holes", lamps=True),
    "staged-splits-1": Run("staged-splits", 1, samples=2, filter="mitchell"),
    "path-4-calibrated": Run("path", 4, samples=2, calibrated="brown-conrady"),
    "bdpt-1-calibrated": Run("bdpt", 1, calibrated="kannala-brandt"),
    "path-4-motion": Run("path", 4, samples=2, textured=True, motion=True),
    "path-8-single-motion": Run("path", 8, "single", instances=True, motion=True),
    "path-4-grids": Run("path", 4, samples=2, media=True, grids=True),
    "path-1-grids": Run("path", 1, media=True, grids=True),
    "bdpt-1-grids": Run("bdpt", 1, media=True, grids=True),
    "path-4-measured": Run("path", 4, samples=2, measured=True),
    "path-1-measured": Run("path", 1, measured=True, textured=True),
    "bdpt-1-measured": Run("bdpt", 1, measured=True),
    "photon-4-measured": Run("photon", 4, measured=True),
    "path-4-films": Run("path", 4, samples=2, films=True),
    "path-1-films": Run("path", 1, rough=True, textured=True, films=True),
    "bdpt-1-films": Run("bdpt", 1, rough=True, films=True),
    "path-4-films-colors": Run("path", 4, films=True, spectral="colors"),
    "path-4-strands": Run("path", 4, samples=2, strands=True, instances=True),
    "path-1-strands": Run("path", 1, strands=True, textured=True, opacity="veil"),
    "path-8-single-strands": Run("path", 8, "single", strands=True),
    "staged-1-strands": Run("staged", 1, strands=True),
    "bdpt-1-strands": Run("bdpt", 1, strands=True, instances=True),
    "photon-4-strands": Run("photon", 4, strands=True, instances=True),
    "path-1-motion": Run("path", 1, rough=True, media=True, motion=True),
    "staged-1-motion": Run("staged", 1, samples=2, motion=True),
    "bdpt-1-motion": Run("bdpt", 1, motion=True),
    "reuse-4-motion": Run("reuse", 4, samples=2, motion=True),
    "photon-4-motion": Run("photon", 4, motion=True),
    "path-4-colors": Run("path", 4, samples=2, textured=True, sky=True, spectral="colors"),
    "path-4-spectra": Run("path", 4, samples=2, spectral="spectra"),
    "path-1-spectra": Run("path", 1, samples=2, rough=True, media=True, spectral="spectra"),
    "path-4-rough-spectra": Run("path", 4, rough=True, textured=True, instances=True, spectral="spectra"),
    "staged-1-spectra": Run("staged", 1, rough=True, interiors=True, spectral="spectra"),
    "bdpt-1-spectra": Run("bdpt", 1, rough=True, media=True, spectral="spectra"),
    "bdpt-4-colors": Run("bdpt", 4, sun=True, spectral="colors"),
    "photon-4-spectra": Run("photon", 4, spectral="spectra"),
    "reuse-4-spectra": Run("reuse", 4, samples=2, spectral="spectra"),
    "whitted-4-spectra": Run("whitted", 4, spectral="spectra"),
    "guided-4-spectra": Run("guided", 4, rough=True, spectral="spectra"),
    "chains-4-spectra": Run("chains", 4, spectral="spectra"),
    "path-1-plugins": Run("path", 1, plugins=True),
    "path-4-plugins": Run("path", 4, samples=2, plugins=True, instances=True),
    "bdpt-1-plugins": Run("bdpt", 1, plugins=True, motion=True),
    "photon-4-plugins": Run("photon", 4, plugins=True),
    "path-4-replicates": Run("path", 4, samples=4, replicate=2),
    "path-16": Run("path", 16, samples=2),
    "path-1-large": Run("path", 1, large=True),
    "path-8-large": Run("path", 8, large=True),
    "path-16-large-single": Run("path", 16, "single", large=True),
    "whitted-4": Run("whitted", 4),
    "reuse-4": Run("reuse", 4, samples=2),
    "photon-4": Run("photon", 4, samples=2),
    "photon-4-media": Run("photon", 4, samples=2, media=True, skin=True),
    "bdpt-4": Run("bdpt", 4, samples=2),
    "bdpt-1-rough": Run("bdpt", 1, rough=True, lamps=True),
    "bdpt-4-sky": Run("bdpt", 4, sky=True, filter="mitchell"),
    "bdpt-4-media": Run("bdpt", 4, samples=2, media=True, skin=True),
    "bdpt-4-interiors": Run("bdpt", 4, interiors=True),
    "bdpt-4-holes": Run("bdpt", 4, opacity="holes", replicate=1),
    "bdpt-4-sun": Run("bdpt", 4, sun=True, instances=True, textured=True),
    "guided-4": Run("guided", 4, samples=2),
    "guided-1-media": Run("guided", 1, rough=True, media=True, replicate=1),
    "training-4": Run("training", 4, samples=2, textured=True),
    "chains-4": Run("chains", 4, samples=2),
    "chains-1-rough": Run("chains", 1, rough=True, lamps=True, interiors=True),
    "chains-4-instances": Run("chains", 4, sun=True, instances=True, textured=True),
    "chains-bdpt-4": Run("chains-bdpt", 4, media=True, interiors=True),
    "whitted-1-large": Run("whitted", 1, samples=2, large=True),
}


def lamps(folder: Path) -> list[dict[str, Any]]:
    """Lights with cones of all widths, and lamps that shine up or down, whose IES files are written into `folder`."""
    head = "IESNA91\nTILT=NONE\n1 -1 1 {} 1 2 0 0 0\n1 1 1\n"
    (folder / "down.ies").write_text(head.format("3 1") + "0 50 90\n0\n900 400 0\n")
    (folder / "up.ies").write_text(head.format("4 3") + "90 100 130 180\n0 50 180\n0 9 30 70\n0 80 2 70\n0 5 60 70\n")
    found: list[dict[str, Any]] = []
    for number in range(10):
        at = {"position": (0.2 * number - 1.0, 1.2, 0.3 * (number % 3)), "direction": (0.1 * number - 0.4, -1, 0.2)}
        spot = {"cone_degrees": 8.0 + 30.0 * number, "blend": number / 9.0, "intensity": (1, 0.8, 0.6)}
        found.append({"type": "spot", **at, **spot})
        found.append({"type": "ies", **at, "file": ("down.ies", "up.ies")[number % 2], "scale": (1, 2, 0.5)})
    Image.fromarray(np.arange(90, dtype=np.uint8).reshape(5, 6, 3)).save(folder / "slide.png")
    for number in range(3):
        at = {"position": (0.5 * number - 0.5, 1.1, 0.4), "direction": (0.3 * number - 0.4, -1, 0.2)}
        found.append(
            {"type": "projector", **at, "file": "slide.png", "even": number > 0, "vertical_fov": 20 + 60 * number}
        )
    return found


def beams(moving: bool) -> list[dict[str, Any]]:
    """Lights of plugins, one of which turns."""
    keys = ({"time": 0.0}, {"time": 1.0, "rotate_degrees": (0, 40, 0), "translate": (0.2, 0.0, 0.0)})
    led = {"plugin": "led", "position": (-0.6, 1.4, 0.5), "direction": (0.2, -1, -0.1), "up": (1, 0, 0)}
    beam: dict[str, Any] = {"plugin": "searchlight", "position": (0.7, 1.2, 0.9), "direction": (-0.5, -1, -0.6)}
    beam["parameters"] = {"power": 2.0, "divergence": 15.0}
    return [{"type": "plugin", **led, **({"motion": keys} if moving else {})}, {"type": "plugin", **beam}]


def maps(folder: Path) -> dict[str, Any]:
    """A normal map and a bump map, written into `folder` with the picture that has 8 bits."""
    rng = np.random.default_rng(71)
    Image.fromarray(rng.integers(0, 256, (9, 7, 3), np.uint8)).save(folder / "p.png")
    Image.fromarray(rng.integers(0, 65536, (5, 6), np.uint16)).save(folder / "deep.png")
    write_image(folder / "n.exr", rng.random((5, 6, 3)))
    return {"normal_map": {"texture": "n.exr"}, "bump_map": {"texture": "deep.png", "scale": 0.1}}


def scene(run: Run, folder: Path) -> FlatScene:
    """Triangles, smooth and flat, spheres, disks; every material; every kind of light, in front and behind and around.

    A mesh file is written into `folder`.
    """
    points, faces = icosphere(3 if run.large else 0)
    lines = [f"v {x:.7f} {y:.7f} {z:.7f}" for x, y, z in (points * 0.4 + [-0.8, 0.3, 0.2]).tolist()]
    lines += [f"vn {x:.7f} {y:.7f} {z:.7f}" for x, y, z in points.tolist()]
    lines += [f"vt {x:.7f} {y:.7f}" for x, y, _ in points.tolist()]
    lines += [f"f {a}/{a}/{a} {b}/{b}/{b} {c}/{c}/{c}" for a, b, c in (faces + 1).tolist()]
    (folder / "ball.obj").write_text("\n".join([*lines, ""]))
    color = (0.7, 0.6, 0.5)
    shapes: list[dict[str, Any]] = [
        {"type": "quad", "origin": (-3, -0.5, 3), "edge_u": (6, 0, 0), "edge_v": (0, 0, -6), "material": "matt"},
        {"type": "box", "center": (0.8, -0.2, -0.6), "size": (0.7, 0.6, 0.7), "material": "mirror"},
        {"type": "tetrahedron", "vertices": ((-0.2, -0.5, 0.9), (0.3, -0.5, 1.0), (0.0, -0.5, 1.4), (0.0, 0.0, 1.1))},
        {"type": "sphere", "center": (0.2, 0.1, 0.3), "radius": 0.4, "material": "glass"},
        {"type": "sphere", "center": (1.1, 0.6, 0.5), "radius": 0.2, "emission": (3, 2, 1), "material": "matt"},
        {"type": "disk", "center": (-0.5, 1.2, 0.5), "normal": (0.3, -1, 0), "radius": 0.3, "emission": (4, 4, 4)},
        {"type": "disk", "center": (0, 0.5, -1.5), "normal": (0, 0.2, 1), "radius": 0.8, "material": "mirror"},
        {"type": "triangle", "vertices": ((-1, 1.5, -0.5), (0, 1.5, -0.5), (-0.5, 1.5, 0.5)), "emission": (2, 3, 4)},
        {"type": "mesh", "file": "ball.obj", "material": "matt"},
    ]
    once = {"multiple_scattering": False, "microfacets": "beckmann"}
    rough = {
        "clay": {"type": "oren_nayar", "reflectance": color, "roughness": 0.7},
        "paint": {"type": "principled", "coat": 0.5, "sheen_color": color, "transmission": 0.3, "metallic": 0.2},
        "matt": {"type": "mix", "materials": ("clay", "paint")},
        "mirror": {"type": "conductor", "metal": "Au", "roughness": 0.4, "anisotropy": 0.5, **once},
        "glass": {"type": "dielectric", "ior": 1.5, "roughness": 0.4, "microfacets": "beckmann"},
    }
    if run.interiors:
        shapes += [
            {"type": "box", "center": (0.2, -0.1, 0.5), "size": (0.6, 0.7, 0.6), "material": "water"},
            {"type": "sphere", "center": (0.2, 0.8, 3.0), "radius": 0.1, "material": "air"},
            {"type": "tetrahedron", "vertices": ((0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)), "material": "old"},
        ]
    if run.media:
        shapes += [
            {"type": "box", "center": (0.2, -0.1, 0.5), "size": (1.6, 0.7, 1.6), "interior": "smoke"},
            {"type": "sphere", "center": (0.2, 0.1, 0.3), "radius": 0.3, "material": "glass", "interior": "milk"},
        ]
    if run.skin:
        shapes += [
            {"type": "box", "center": (0.2, -0.1, 0.9), "size": (0.8, 0.7, 0.6), "material": "skin"},
            {"type": "sphere", "center": (1.1, 0.6, 0.5), "radius": 0.4, "material": "wax"},
        ]
    walks = {
        "skin": {"type": "subsurface", "albedo": (0.8, 0.5, 0.3), "radius": (0.3, 0.2, 0.1)},
        "wax": {"type": "subsurface", "albedo": 0.8, "radius": 0.2, "g": 0.5, "ior": 1.4, "roughness": 0.3 * run.rough},
    }
    media = {
        "glass": {"type": "dielectric", "ior": 1.5, "priority": 2},
        "water": {
            "type": "dielectric", "ior": 1.33, "priority": 1,
            "attenuation_color": (0.9, 0.8, 0.3), "attenuation_distance": 0.5,
        },
        "air": {"type": "dielectric", "ior": 1.0, "priority": 3},
        "old": {"type": "dielectric", "ior": 1.4},
    }  # fmt: skip
    textured = {
        "matt": {"type": "lambert", "reflectance": {"texture": "p.png", "wrap": ["mirror", "clamp"]}, **maps(folder)},
        "mirror": {"type": "mirror", "reflectance": {"ramp": [color, 0.5]}, "normal_map": {"texture": "p.png"}},
    }
    if run.opacity:
        share: Any = {"texture": "p.png", "channel": "g"} if run.opacity == "holes" else 0.6
        maps(folder)
        holes = {"opacity": share, "opacity_cutoff": 0.5} if run.opacity == "holes" else {"opacity": share}
        textured = {
            "matt": {"type": "lambert", "reflectance": color, **holes},
            "mirror": {"type": "mirror", "opacity": {"checker": [0.3, 1.0]} if run.opacity == "holes" else 0.5},
            "glass": {"type": "dielectric", "ior": 1.5, "thin": True, "opacity": share},
        }
    if run.textured:
        for number, emission in (
            (4, {"texture": "p.png"}),
            (5, {"ramp": [color, 4.0]}),
            (7, {"checker": [color, 0.0]}),
        ):
            shapes[number]["emission"] = emission
    given = {
        "moon": {
            "type": "plugin",
            "plugin": "minnaert",
            "parameters": {"k": 2.0, "reflectance": {"ramp": [0.2, color]}},
        },
        "wood": {"type": "lambert", "reflectance": {"plugin": "wood", "parameters": {"rings": 3.0}}},
        "matt": {"type": "mix", "materials": ("moon", "wood")},
        "mirror": {"type": "plugin", "plugin": "ashikhmin_shirley", "parameters": {"diffuse": {"plugin": "wood"}}},
    }
    scattering: dict[str, Any] = {
        "media": {"smoke": {"scattering": (1, 2, 0.5), "absorption": 0.2, "g": 0.6}, "milk": {"scattering": 6.0}},
        "fog": "smoke",
    }
    if run.grids:
        np.save(folder / "cloud.npy", np.random.RandomState(7).uniform(-0.5, 2.0, (5, 7, 6)).clip(0.0))
        density = {"file": "cloud.npy", "box": ((-0.6, -0.5, -0.3), (1.0, 0.3, 1.3)), "edges": "fall"}
        np.save(folder / "tints.npy", np.random.RandomState(8).uniform(0.1, 1.0, (3, 1, 4, 3)))
        np.save(folder / "heat.npy", np.random.RandomState(9).uniform(0.0, 4000.0, (2, 5, 3)))
        tints = {"file": "tints.npy", "box": density["box"]}
        milk = {"scattering": (6.0, 1.0, 0.0), "absorption": 0.3, "emission": (0.0, 1.0, 0.5), "emission_grid": tints}
        smoke = {"scattering": (1, 2, 0.5), "absorption": 0.2, "emission": 0.3, "temperature": {"file": "heat.npy"}}
        scattering["media"] |= {
            "smoke": {**smoke, "albedo": tints, "density": density},
            "milk": {**milk, "density": {"file": "cloud.npy", "transform": {"translate": (-0.3, -0.4, -0.2)}}},
            "air": {"scattering": 0.05},
        }
        scattering["fog"] = "air"
    around: dict[str, Any] = {"type": "environment", "radiance": (0.2, 0.2, 0.2)}
    if run.sky:
        around = {"type": "environment", "file": "sky"}
    elif run.sun:
        around = {"type": "sun_sky", "sun_direction": (0.4, 0.9, 0.5), "scale": 1e-4}
    camera: dict[str, Any] = {"position": (0.2, 0.8, 3), "target": (0.1, 0.1, 0), "aperture_radius": 0.01}
    if run.calibrated:
        distortion = {"model": run.calibrated, "k": (-0.2, 0.05, 0.01)}
        camera |= {
            "type": "intrinsics",
            "fx": 8.0,
            "skew": 0.5,
            "resolution": (WIDTH, HEIGHT),
            "distortion": distortion,
        }
        if run.calibrated == "brown-conrady":
            distortion["p"] = (0.01, -0.02)
        else:
            camera["aperture_radius"] = 0.0
    if run.motion:
        camera |= {"shutter": (0.0, 1.0), "motion": ({"time": 0.0}, {"time": 1.0, "position": (0.3, 0.8, 3)})}
    described: dict[str, Any] = {
        **(scattering if run.media else {}),
        "camera": camera,
        "materials": {
            "matt": {"type": "lambert", "reflectance": color},
            "mirror": {"type": "mirror", "reflectance": color},
            "glass": {"type": "dielectric", "ior": 1.5},
            **(rough if run.rough else {}),
            **(media if run.interiors else {}),
            **(walks if run.skin else {}),
            **(textured if run.textured or run.opacity else {}),
            **(given if run.plugins else {}),
        },
        "shapes": shapes,
        "lights": [
            {"type": "point", "position": (0.5, 1.8, 1.5), "intensity": (1, 1, 1)},
            {"type": "directional", "direction": (0.2, -1, -0.3), "irradiance": (0.5, 0.4, 0.3)},
            *(lamps(folder) if run.lamps else []),
            *(beams(run.motion) if run.plugins else []),
            around,
        ],
    }
    if run.measured:
        write_tensors(folder / "a.bsdf", rgl_fields(0.5, side=8, views=3))
        write_tensors(folder / "b.bsdf", rgl_fields(0.3, 5, side=8, views=3))
        write_merl(folder / "c.binary", lambda half, difference, turn: 0.2 + 0.1 * turn + 0.0 * np.ones(3))
        names = ("a.bsdf", "b.bsdf", "c.binary")
        described["materials"] |= {name: {"type": "measured", "file": name} for name in names}
        described["materials"]["mirror"] = {"type": "mix", "materials": ("a.bsdf", "c.binary")}
        described["materials"]["glass"] = {"type": "measured", "file": "b.bsdf", "anisotropy_rotation": 30.0}
    if run.films:
        film: dict[str, Any] = {"iridescence": 0.8, "iridescence_thickness": 350.0}
        its_roughness = 0.4 * run.rough
        described["materials"] |= {
            "glass": {"type": "dielectric", "ior": 1.5, "roughness": its_roughness, **film},
            "mirror": {"type": "conductor", "metal": "Au", "roughness": its_roughness, **film},
            "matt": {"type": "principled", "base_color": (0.6, 0.5, 0.3), "metallic": 0.3, "coat": 0.5, **film},
        }
        if run.textured:
            picture = {"texture": "p.png", "range": (100.0, 700.0)}
            described["materials"]["mirror"] |= {"iridescence": {"ramp": [0.2, 1.0]}, "iridescence_thickness": picture}
    if run.spectral == "spectra":
        leaf = {"wavelengths": (400, 550, 700), "values": (0.1, 0.5, 0.9)}
        tables = {"eta": leaf, "k": {"wavelengths": (400, 700), "values": (2.0, 4.0)}}
        described["materials"] |= {
            "glass": {"type": "dielectric", "dispersion": {"glass": "SF11"}, "roughness": 0.4 * run.rough},
            "matt": {"type": "lambert", "reflectance": leaf},
            "mirror": {"type": "conductor", "roughness": 0.3, **tables} if run.rough else {"type": "mirror"},
        }
        point, sun, *_ = described["lights"]
        point["intensity"], sun["irradiance"] = {"illuminant": "FL11", "scale": 2.0}, {"blackbody": 4000}
        shapes[5]["emission"] = {"wavelengths": (588, 589, 590), "values": (0.0, 90.0, 0.0)}
    if run.strands:
        described["materials"]["hair"] = {"type": "hair", "eumelanin": 0.3, "opacity": 0.7 if run.opacity else 1.0}
        line = [[0.05 * k * k - 0.5, 0.25 * k - 0.2, 0.5 - 0.1 * k] for k in range(5)]
        strand: dict[str, Any] = {"type": "curves", "points": line, "radius": (0.12, 0.02), "material": "hair"}
        shapes += [
            strand,
            {**strand, "basis": "linear", "transform": {"translate": (0.5, 0.1, 0.1)}, "material": "matt"},
        ]
    if run.instances:
        floor, *others = shapes
        described["groups"] = {"others": {"shapes": others}}
        again = {"translate": (-0.6, 0.3, -1.0), "rotate_degrees": (0, 60, 0), "scale": -0.7}
        placed = ({"type": "instance", "group": "others", **where} for where in ({}, {"transform": again}))
        described["shapes"] = [floor, *placed]
    if run.motion:
        keys = {"time": 0.0}, {"time": 0.5, "translate": (0.1, 0.1, 0.0), "rotate_degrees": (0, 9, 0)}, {"time": 1.0}
        for shape in described["shapes"][1:]:
            shape["motion"] = keys
    pixels = np.random.default_rng(71).random((3, 5, 3), np.float32)
    what = Scene.model_validate(described).placed("everything", folder)
    what = what.with_plugins(sorted(scenes_folder().glob("plugins/*.cl")) if run.plugins else None)
    # Photons start at lights, for which a tree has no answer
    choice = "power" if run.kernel in ("photon", "bdpt", "chains-bdpt") else "auto"
    return flatten(what.with_files(environments={"sky": EnvironmentPicture(pixels)}), WIDTH, HEIGHT, choice)


def field_over(flat: FlatScene) -> GuidingField:
    """A field of cells that know something by chance."""
    low, high = scene_box(flat)
    empty, rng = empty_field(low, float((high - low).max())), np.random.default_rng(4)
    nodes = empty.nodes.copy()
    nodes[1:, :FACES] = np.arange(8 * FACES).reshape(8, FACES)
    weights = np.floor(rng.pareto(1.0, (8 * FACES, layout.FIELD_BINS)) * 100.0) + 1.0
    numbers = np.column_stack(
        [rng.choice([0.0, 0.25, 0.75], 8 * FACES), rng.random((8 * FACES, 2)), rng.choice([0.3, 1.0], 8 * FACES)]
    )
    return GuidingField(nodes, cell_rows(histogram_words(weights), numbers), empty.frame)


def render(device: Device, run: Run) -> str:
    """Hash of the sums of an image."""
    settings = RenderSettings(filter=run.filter).struct(TILE)
    once = ("reuse", "bdpt", "training", "chains", "chains-bdpt", "staged")
    indirect = 0 if run.kernel == "photon" else 1 if run.kernel in once else 2
    shadow = 1 if run.kernel in ("bdpt", "chains-bdpt", "training", "staged") else 2
    for name, value in {
        "width": WIDTH, "height": HEIGHT, "tile": TILE, "seed": 5, "shadow_rays": shadow, "max_depth": 6, "reuse": 16,
        "indirect_rays": indirect, "roulette": layout.ROULETTE_THROUGHPUT, "light_samples": shadow,
        "bsdf_samples": indirect, "replicate_spp": run.replicate, "light_paths": 40,
        "specular_chains": run.kernel.startswith("chains"), "spectral": bool(run.spectral),
    }.items():  # fmt: skip
        settings[name] = value
    with tempfile.TemporaryDirectory() as folder:
        flat = scene(run, Path(folder))
    prepare: Callable[[DeviceWorker], DevicePreparation] | None = None
    if run.kernel == "photon":
        prepare = partial(PhotonMaps, flat=flat, photons=40, radius=0.5)
    elif run.kernel in ("bdpt", "chains-bdpt"):
        prepare = partial(LightPaths, flat=flat, count=40)
    elif run.kernel == "guided":
        prepare = partial(GuidedPaths, field=field_over(flat))
    trained = FieldSums(device, field_over(flat), 2.0) if run.kernel == "training" else None
    if trained is not None:
        prepare = lambda _: trained  # noqa: E731
    staged = run.kernel.startswith("staged")
    cut = LaunchConfig(run.lanes, 2, None, run.traversal, staged=staged, code="any" if run.universal else None)
    others = {"guided": GUIDED, "training": TRAINING}
    others |= dict.fromkeys(("chains", "staged", "staged-splits"), INTEGRATORS["path"].pipeline)
    others["chains-bdpt"] = INTEGRATORS["bdpt"].pipeline
    pipeline = others[run.kernel] if run.kernel in others else INTEGRATORS[run.kernel].pipeline
    with patch("clrender.device.worker._staged_paths", lambda *_: 32):  # others take the places of those that end
        worker = DeviceWorker(device, flat, settings, pipeline, cut, prepare)
    sums = worker.render(Unit(0, slot_count(WIDTH, HEIGHT, TILE), 0, run.samples, TILE))
    learned = b"" if trained is None else b"".join(array.tobytes() for array in trained.read())
    worker.release()
    assert (sums.done == run.samples).all()
    assert sums.counts.sum() == run.samples * WIDTH * HEIGHT
    squares = b"" if sums.squares is None else sums.squares.tobytes()
    return hashlib.sha256(sums.sums.tobytes() + sums.counts.tobytes() + squares + learned).hexdigest()


def light_paths(device: Device) -> str:
    """Hash of the recorded paths of a pixel, by all kernels that record any."""
    digest = hashlib.sha256()
    some = {"path": "path-1-rough", "guided": "guided-1-media", "whitted": "path-4", "bdpt": "bdpt-1-rough"}
    for kernel, name in some.items():
        settings = RenderSettings(integrator="path" if kernel == "guided" else kernel).struct(4)
        for key, value in {
            "width": WIDTH, "height": HEIGHT, "left": 3, "top": 3, "less_width": WIDTH - 1, "less_height": HEIGHT - 1,
            "seed": 5, "max_depth": 6,
        }.items():  # fmt: skip
            settings[key] = value
        with tempfile.TemporaryDirectory() as folder:
            flat = scene(RENDERS[name], Path(folder))
        prepare: Callable[[DeviceWorker], DevicePreparation] | None = None
        if kernel == "guided":
            prepare = partial(GuidedPaths, field=field_over(flat))
        elif kernel == "bdpt":
            prepare = partial(LightPaths, flat=flat, count=640)
        worker = DeviceWorker(device, flat, settings, RECORDING[f"integrator_{kernel}"], LaunchConfig(1, 2), prepare)
        sums = worker.render(Unit(0, 16, 0, 2, 4))
        if sums.listed is not None:
            assert len(sums.listed)
            for rows in worker.recorded_splats(sums.listed):
                digest.update(written(rows).tobytes())
            digest.update(sums.listed.tobytes())
        worker.release()
        assert (sums.listed is not None) == (kernel == "bdpt")
        assert sums.records is not None and sums.counts.sum() == 2
        for rows in as_rows(sums.records):
            used = int(rows[0, layout.columns("INSPECT_SAMPLE")["USED"]])
            assert 1 < used <= layout.INSPECT_ROWS
            digest.update(rows[:used].tobytes())
    return digest.hexdigest()


def layers(device: Device) -> str:
    """Hash of the sums of all that is asked of what is seen first."""
    with tempfile.TemporaryDirectory() as folder:
        flat = scene(RENDERS["path-4"], Path(folder))
    settings, asked = RenderSettings(width=WIDTH, height=HEIGHT, seed=5).struct(TILE), LayerKind()
    rows = np.random.default_rng(3).random((flat.triangle_count + flat.analytic_count, 16), np.float32)
    more = partial(LayerArguments, asked=asked, coordinates=rows)
    worker = DeviceWorker(device, flat, settings, FIRST_HITS, LaunchConfig(4, 2), more)
    digest = hashlib.sha256()
    for asked.kind in LAYER_KINDS.values():
        sums = worker.render(Unit(0, slot_count(WIDTH, HEIGHT, TILE), 0, 1, TILE))
        digest.update(sums.sums.tobytes() + sums.counts.tobytes())
    worker.release()
    return digest.hexdigest()


def radiosity(device: Device) -> str:
    """Hash of what patches meet and reflect, before and after one of two boxes moves, and of pictures of it."""
    camera = {"position": (0, 1, 2.5), "target": (0, 0.5, 0)}
    shapes = [
        {"type": "quad", "origin": (-2, 0, 2), "edge_u": (4, 0, 0), "edge_v": (0, 0, -4), "material": "matt"},
        {"type": "box", "center": (0.3, 0.4, 0.2), "size": (0.7, 0.8, 0.7), "material": "matt"},
        {"type": "quad", "origin": (-1, 2, -1), "edge_u": (1, 0, 0), "edge_v": (0, 0, 1), "emission": (3, 2, 1)},
    ]
    matt = {"type": "lambert", "reflectance": (0.7, 0.6, 0.5)}
    what = Scene.model_validate({"camera": camera, "materials": {"matt": matt}, "shapes": shapes})
    cut = LaunchConfig(4, 2)
    sought, size = RadiositySettings(24, 4, 2, 1e-2, refine=False), (WIDTH, HEIGHT)
    dynamic = DynamicRadiosity(what, device, sought, size, cut)
    digest = hashlib.sha256(dynamic.reflected.tobytes())
    dynamic.move(1, (0.2, 0.0, 0.1))
    digest.update(dynamic.reflected.tobytes())
    tracer = Tracer(device, dynamic.flat, 4, cut=cut)
    digest.update(tracer.hemicube(np.arange(4, dtype=np.uint32), hemicube_cells(4)[0]).tobytes())
    table = looks_of(dynamic.patches, dynamic.reflected, dynamic.used, None)
    settings = RenderSettings(width=WIDTH, height=HEIGHT, seed=5).struct(TILE)
    known = dynamic.rows
    atlas = atlas_of(dynamic.patches, known.indirect(dynamic.patches), known.used, known.open_share)
    for shown, pipeline, prepare in (
        (dynamic.flat, INTEGRATORS["radiosity"].pipeline, partial(Display, table=table)),
        (dynamic.patches.whole(WIDTH, HEIGHT), GATHER, partial(Gather, atlas=atlas)),
    ):
        worker = DeviceWorker(device, shown, settings, pipeline, cut, prepare)
        digest.update(worker.render(Unit(0, slot_count(WIDTH, HEIGHT, TILE), 0, 1, TILE)).sums.tobytes())
        worker.release()
    for each in (tracer, dynamic):
        each.release()
    return digest.hexdigest()


def formulas(device: Device) -> str:
    """Of a plugin's light, one that says how directions are sampled."""
    plugin = plugin_of(scenes_folder() / "plugins" / "searchlight.cl")
    formula = Formula(device, (plugin,), 1, [x for each in plugin.parameters for x in each.default], 4)
    grid, random = light_grid(0.5, 8, 4), np.random.default_rng(5).random((48, 2), np.float32)
    made = [formula.intensities(grid.directions), formula.densities(0.5, grid.directions), formula.samples(0.5, random)]
    return hashlib.sha256(b"".join(each.tobytes() for each in made)).hexdigest()


def furnace(device: Device) -> str:
    """Hash of what materials sample, and of what they evaluate to, on both sides; and of the parts of a mixture."""
    rough = {"type": "conductor", "metal": "Au", "roughness": 0.5}
    materials = {"rough": rough, "glass": {"type": "dielectric", "ior": 1.5}}
    mixture = {"type": "mix", "materials": ["rough", "glass"], "weight": 0.25}
    camera = {"position": (0, 1, 2.5), "target": (0, 0.5, 0)}
    described = {"camera": camera, "materials": {**materials, "mixture": mixture}}
    surfaces = Surfaces(device, Scene.model_validate(described), LaunchConfig(4, 2))
    numbers = np.random.default_rng(71).random((2, 20))
    digest = hashlib.sha256()
    for name in materials:
        for below in (False, True):
            samples = surfaces.sample(name, incident(50.0, below), numbers)
            values, pdf = surfaces.evaluate(name, incident(50.0, below), samples.directions)
            assert np.array_equal(pdf, samples.density) and np.array_equal(values, samples.values)
            digest.update(samples.directions.tobytes() + samples.weights.tobytes() + samples.pdf.tobytes())
    parts = surfaces.parts("mixture")
    assert sorted(share for share, _ in parts) == [0.25, 0.75]
    digest.update(repr(parts).encode())
    surfaces.release()
    return digest.hexdigest()


def scan(device: Device) -> str:
    """Prefix sums of more numbers than one chunk has, which a tree needs only from thousands of primitives on."""
    numbers = np.random.default_rng(70).integers(0, 1000, 3000, dtype=np.uint32)
    program = device.program("geometry/build_order.cl", {"LANES": 1})
    chunks = -(-len(numbers) // CHUNK)
    buffers = [device.upload(numbers), device.empty(4 * chunks), device.empty(4)]
    device.launch(program, "build_scan", 16, 16, [buffers[0], np.uint32(len(numbers)), buffers[1]])
    device.launch(program, "build_scan", 16, 16, [buffers[1], np.uint32(chunks), buffers[2]])
    device.launch(program, "build_scan_add", 3008, 16, [buffers[0], np.uint32(len(numbers)), buffers[1]])
    result = np.empty_like(numbers)
    device.read(buffers[0], result)
    assert np.array_equal(result, np.cumsum(numbers) - numbers)
    return "right"


def arithmetic(device: Device) -> str:
    """The check of single operations, which every device goes through."""
    differences = arithmetic_check(device)
    assert differences == [], differences
    return "right"


def statistics(device: Device) -> str:
    """Sums over more work-items than one reads by itself, which only launches for GPUs have."""
    stats = np.random.default_rng(71).integers(0, 1000, (1001, 4), dtype=np.uint32)
    program, rows = device.program("film/accumulate.cl", {"LANES": 1}), 20
    buffers = [device.upload(stats), device.empty(32 * rows)]
    device.launch(program, "film_total_stats", 32, 16, [buffers[0], np.uint32(len(stats)), buffers[1], np.uint32(rows)])
    result = np.empty((rows, 4), np.uint64)
    device.read(buffers[1], result)
    assert np.array_equal(result[:, :2].sum(axis=0), stats[:, :2].sum(axis=0))
    return "right"


def film(device: Device) -> str:
    """A film on the device: two units, the second of which is stopped within a replicate, and what became of them."""
    settings = RenderSettings(filter="box").struct(TILE)
    settings["width"], settings["height"], settings["tile"], settings["replicate_spp"] = WIDTH, HEIGHT, TILE, 3
    slots, rng, scratch = slot_count(WIDTH, HEIGHT, TILE), np.random.default_rng(73), Scratch(device)
    program, given = device.program("film/accumulate.cl", {"LANES": 1}), device.upload(settings)
    replicates, on_host = ReplicateSums(device, scratch, 3), Film(WIDTH, HEIGHT, {"replicate_spp": 3})
    on_device = DeviceFilm(device, given, on_host)
    sums, counts = scratch.buffer("sums", 48 * slots), scratch.buffer("counts", 4 * slots)
    for first, taken in ((0, 6), (6, 5)):
        unit = Unit(0, slots, first, 6, TILE)
        samples = device.upload(rng.random((taken, 3, slots), np.float32))
        device.launch_each(program, "film_clear", slots, [sums, counts, np.uint32(slots)])
        device.launch_each(program, "film_clear_replicates", slots, replicates.begin(slots, first))
        numbers = [np.uint32(number) for number in (0, slots, first, taken, 0)]
        arguments: list[Any] = [given, samples, *numbers, sums, counts, *replicates.buffers]
        device.launch_each(program, "film_accumulate_replicates", slots, arguments)
        words, counted = np.empty((slots, 3, 4), np.uint32), np.empty(slots, np.uint32)
        device.read(sums, words)
        device.read(counts, counted)
        done = np.full(slots // 16, taken, np.uint32)
        squares = replicates.read(words, counted, done)
        on_host.commit(unit, UnitSums(words, counted, done, 0, 0, 0, squares))
        done[:] = taken
        on_device.add(unit, sums, counts, replicates.cut(sums, counts, done))
        device.release(samples)
    copy = on_device.copy(sums=True, image=True)
    assert copy.bands is not None and copy.image is not None
    for ours, theirs in zip([*copy.bands, *copy.squares], [*on_host.bands(), *on_host.square_bands()], strict=True):
        assert np.array_equal(ours, theirs)
    assert np.array_equal(copy.counts, on_host.counts) and np.array_equal(copy.image, on_host.mean())
    return hashlib.sha256(copy.image.tobytes()).hexdigest()


def refit(device: Device) -> str:
    """Costs of a tree that is made to fit where its triangles, spheres and instances are, and others after them."""
    with tempfile.TemporaryDirectory() as folder:
        flat = scene(RENDERS["path-4-instances"], Path(folder))
    vertices = flat.arrays["vertices"]
    there = replace(flat, arrays={**flat.arrays, "vertices": (vertices * np.float32(0.75)).astype(np.float32)})
    arrays = SceneArrays(device, flat)
    found = [arrays.refit(each) and cost(device, arrays.tree) for each in (flat, there)]
    arrays.release()
    assert all(found), found
    return " ".join(f"{each:.9g}" for each in found)


def trees(device: Device) -> str:
    """A tree by the kernels for many primitives, which is that of few by one work-item."""
    with tempfile.TemporaryDirectory() as folder:
        flat = scene(RENDERS["path-4"], Path(folder))
    found = []
    for few in (bvh._FEW, 0):
        with patch.object(bvh, "_FEW", few), patch.object(radix_sort, "_FEW", few):
            arrays = SceneArrays(device, flat)
        nodes = np.empty(arrays.tree.nodes.nbytes // 4, np.uint32)
        device.read(arrays.tree.nodes, nodes)
        arrays.release()
        found.append(hashlib.sha256(nodes.tobytes()).hexdigest())
    assert found[0] == found[1]
    return found[0]


def perform(device: Device, name: str) -> str:
    """Do one of `RENDERS`, or another function of this file by name; gives what must be equal everywhere."""
    functions = (scan, trees, statistics, arithmetic, light_paths, layers, radiosity, furnace, formulas, film, refit)
    others = {function.__name__: function for function in functions}
    return others[name](device) if name in others else render(device, RENDERS[name])


class _Interpreter(Device):
    """Notes what was launched, and gives no memory back.

    Oclgrind 21.10 says of a buffer in the place of a released, smaller one that what lies beyond the smaller one's end
    was never written, whatever is written there.
    """

    kept: ClassVar[list[Buffer]] = []
    launched: ClassVar[set[str]] = set()

    def release(self, buffer: Buffer) -> None:
        self.kept.append(buffer)

    def launch(self, program: Program, kernel: str, global_size: int, local_size: int, args: Sequence[Any]) -> None:
        self.launched.add(kernel)
        super().launch(program, kernel, global_size, local_size, args)


def open_first() -> Device:
    """The first device of the process's drivers, without a probe: under Oclgrind the interpreter, and it alone."""
    platform = load_platforms(drivers())[0]
    handle = platform.get_devices()[0]
    info = DeviceInfo(0, handle.name, platform.name, handle.driver_version, "cpu", 1, 2**30, version=platform.version)
    return _Interpreter(info, handle)


if __name__ == "__main__":
    opened = open_first()
    print("device", opened.info.platform, flush=True)
    for each in sys.argv[1:]:
        print(each, perform(opened, each), flush=True)
    print("launched", *sorted(_Interpreter.launched), flush=True)
