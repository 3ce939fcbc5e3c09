"""Scenes of Mitsuba and pbrt that have something of all that is read, for tests of their readers."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from PIL import Image

from clrender.image.files import write_image

__all__ = ["MITSUBA", "MITSUBA_06", "PBRT", "write_parts"]

MITSUBA = """<?xml version="1.0" encoding="utf-8"?>
<scene version="3.5.0">
  <default name="spp" value="16"/>
  <default name="wide" value="1"/>
  <integrator type="path"><integer name="max_depth" value="6"/></integrator>
  <sensor type="thinlens">
    <float name="fov" value="40"/><string name="fov_axis" value="larger"/>
    <float name="aperture_radius" value="0.05"/><float name="focus_distance" value="4"/>
    <transform name="to_world"><lookat origin="0, 1, 5" target="0, 0.5, 0" up="0, 1, 0"/></transform>
    <sampler type="independent"><integer name="sample_count" value="$spp"/></sampler>
    <film type="hdrfilm"><integer name="width" value="64"/><integer name="height" value="48"/>
      <rfilter type="gaussian"/></film>
  </sensor>
  <texture type="bitmap" id="picture"><string name="filename" value="picture.png"/>
    <transform name="to_uv"><scale x="2" y="2"/></transform></texture>
  <bsdf type="diffuse" id="grey"><spectrum name="reflectance" value="0.4"/></bsdf>
  <bsdf type="twosided" id="boards"><bsdf type="diffuse"><texture name="reflectance" type="checkerboard">
    <rgb name="color0" value="0.1"/><rgb name="color1" value="0.8, 0.7, 0.6"/></texture></bsdf></bsdf>
  <bsdf type="roughconductor" id="gold"><string name="material" value="Au"/><float name="alpha" value="0.09"/>
    <string name="distribution" value="ggx"/></bsdf>
  <bsdf type="roughdielectric" id="frosted"><float name="alpha" value="0.04"/>
    <string name="int_ior" value="water"/></bsdf>
  <bsdf type="mask" id="leaf"><texture name="opacity" type="bitmap"><string name="filename" value="picture.png"/>
    </texture><ref id="boards"/></bsdf>
  <bsdf type="blendbsdf" id="both"><float name="weight" value="0.3"/><ref id="grey"/><ref id="gold"/></bsdf>
  <bsdf type="bumpmap" id="bumpy"><texture name="arbitrary" type="bitmap"><string name="filename" value="picture.png"/>
    </texture><float name="scale" value="0.1"/>
    <bsdf type="roughplastic"><rgb name="diffuse_reflectance" value="0.2, 0.4, 0.6"/></bsdf></bsdf>
  <bsdf type="principled" id="paint"><rgb name="base_color" value="0.8, 0.1, 0.1"/><float name="roughness" value="0.3"/>
    <float name="clearcoat" value="1"/></bsdf>
  <medium type="homogeneous" id="smoke"><rgb name="albedo" value="0.8"/><float name="sigma_t" value="2"/>
    <phase type="hg"><float name="g" value="0.4"/></phase></medium>
  <shape type="rectangle"><transform name="to_world"><scale value="3"/><rotate x="1" angle="-90"/></transform>
    <bsdf type="twosided"><bsdf type="diffuse"><ref name="reflectance" id="picture"/></bsdf></bsdf></shape>
  <shape type="cube"><transform name="to_world"><scale x="0.3" y="0.3" z="0.3"/><translate x="-1" y="0.3"/></transform>
    <ref id="both"/></shape>
  <shape type="sphere"><point name="center" x="0" y="0.5" z="0"/><float name="radius" value="0.5"/>
    <ref id="frosted"/></shape>
  <shape type="sphere"><float name="radius" value="0.4"/><transform name="to_world"><scale x="$wide" y="1" z="2"/>
    <translate x="1.2" y="0.6"/></transform><bsdf type="null"/><ref name="interior" id="smoke"/></shape>
  <shape type="disk"><transform name="to_world"><scale value="0.2"/><translate y="2"/></transform>
    <ref id="bumpy"/></shape>
  <shape type="cylinder"><point name="p0" x="-2" y="0" z="0"/><point name="p1" x="-2" y="1" z="0"/>
    <float name="radius" value="0.2"/><ref id="paint"/></shape>
  <shape type="ply"><string name="filename" value="part.ply"/><ref id="leaf"/></shape>
  <shape type="shapegroup" id="group">
    <shape type="obj"><string name="filename" value="part.obj"/><ref id="gold"/></shape>
  </shape>
  <shape type="instance"><ref id="group"/><transform name="to_world"><translate z="-1"/></transform></shape>
  <shape type="rectangle"><transform name="to_world"><scale value="0.3"/><rotate x="1" angle="90"/><translate y="3"/>
    </transform><emitter type="area"><rgb name="radiance" value="10, 9, 8"/></emitter></shape>
  <emitter type="point"><point name="position" x="1" y="2" z="1"/><rgb name="intensity" value="2"/></emitter>
  <emitter type="spot"><transform name="to_world"><lookat origin="0,3,3" target="0,0,0" up="0,1,0"/></transform>
    <spectrum name="intensity" value="400:1, 700:3"/><float name="cutoff_angle" value="25"/></emitter>
  <emitter type="envmap"><string name="filename" value="sky.exr"/>
    <transform name="to_world"><rotate x="1" angle="90"/></transform></emitter>
</scene>
"""

MITSUBA_06 = """<scene version="0.6.0">
  <integrator type="path"><integer name="maxDepth" value="5"/></integrator>
  <sensor type="perspective"><float name="fov" value="35"/><string name="fovAxis" value="smaller"/>
    <transform name="toWorld"><matrix value="-1 0 0 0 0 1 0 1 0 0 -1 6.8 0 0 0 1"/></transform>
    <film type="ldrfilm"><integer name="width" value="32"/><integer name="height" value="32"/></film></sensor>
  <bsdf type="roughconductor" id="copper"><float name="extEta" value="1"/><float name="alpha" value="0.1"/></bsdf>
  <bsdf type="plastic" id="shiny"><srgb name="diffuseReflectance" value="#a08060"/><float name="intIOR" value="1.5"/>
    <boolean name="nonlinear" value="true"/></bsdf>
  <shape type="cube"><ref id="copper"/></shape>
  <shape type="rectangle"><transform name="toWorld"><rotate y="1" angle="30"/></transform><ref id="shiny"/>
    <emitter type="area"><blackbody name="radiance" temperature="3000K" scale="1e-9"/></emitter></shape>
  <emitter type="constant"><spectrum name="radiance" value="0.5"/></emitter>
</scene>
"""

PBRT = """# everything
Scale -1 1 1
LookAt 0 1 5  0 0.5 0  0 1 0
Camera "perspective" "float fov" [40] "float lensradius" 0.05 "float focaldistance" [4]
Film "rgb" "integer xresolution" [64] "integer yresolution" 48 "float iso" 200 "string filename" "x.exr"
  "string sensor" "nikon_d810" "float whitebalance" 5000
Sampler "halton" "integer pixelsamples" [16]
Integrator "volpath" "integer maxdepth" [6]
PixelFilter "gaussian"
MakeNamedMedium "smoke" "string type" "homogeneous" "rgb sigma_s" [1 2 3] "rgb sigma_a" [0.1 0.1 0.1] "float g" 0.4
WorldBegin
Texture "picture" "spectrum" "imagemap" "string filename" "picture.png" "float uscale" 2
Texture "dim" "spectrum" "scale" "texture tex" "picture" "float scale" 0.5
Texture "squares" "spectrum" "checkerboard" "rgb tex1" [0.1 0.1 0.1] "rgb tex2" [0.8 0.7 0.6] "float uscale" 4
Texture "holes" "float" "imagemap" "string filename" "picture.png"
MakeNamedMaterial "gold" "string type" "conductor" "spectrum eta" "metal-Au-eta" "spectrum k" "metal-Au-k"
  "float roughness" 0.05
MakeNamedMaterial "boards" "string type" "diffuse" "texture reflectance" "squares"
MakeNamedMaterial "both" "string type" "mix" "string materials" ["gold" "boards"] "float amount" 0.3
AttributeBegin
  Rotate -90 1 0 0
  Material "diffuse" "texture reflectance" "dim"
  Shape "bilinearmesh" "point3 P" [-3 -3 0 3 -3 0 -3 3 0 3 3 0]
AttributeEnd
AttributeBegin
  Translate 0 0.5 0
  Material "dielectric" "spectrum eta" "glass-BK7" "float roughness" 0.1
  Shape "sphere" "float radius" 0.5
AttributeEnd
AttributeBegin
  Translate 1.2 0.6 0 Scale 1 1 2
  Material "interface"
  MediumInterface "smoke" ""
  Shape "sphere" "float radius" 0.4
AttributeEnd
ObjectBegin "part"
  NamedMaterial "both"
  Shape "plymesh" "string filename" "part.ply" "texture alpha" "holes"
  Shape "cylinder" "float radius" 0.2 "float zmax" 0.5
ObjectEnd
AttributeBegin
  Translate -1 0 0 ReverseOrientation
  ObjectInstance "part"
AttributeEnd
AttributeBegin
  AreaLightSource "diffuse" "blackbody L" 3000 "float power" 100 "bool twosided" true
  Translate 0 3 0 Rotate 90 1 0 0
  Shape "disk" "float radius" 0.3
AttributeEnd
AttributeBegin
  Translate 1 0.3 1
  Material "subsurface" "rgb reflectance" [0.2 0.5 0.8] "rgb mfp" [0.01 0.02 0.03]
  Shape "sphere" "float radius" 0.3
  Material "coatedconductor" "float interface.roughness" 0.01 "float conductor.roughness" 0.1
  Translate -0.7 0 0
  Shape "loopsubdiv" "integer levels" 2 "point3 P" [0.3 0 0 -0.3 0 0 0 0.3 0 0 -0.3 0 0 0 0.3 0 0 -0.3]
    "integer indices" [0 2 4 2 1 4 1 3 4 3 0 4 2 0 5 1 2 5 3 1 5]
AttributeEnd
Attribute "shape" "float alpha" 1
Material "coateddiffuse" "rgb reflectance" [0.2 0.4 0.6] "float roughness" 0.1
Shape "trianglemesh" "integer indices" [0 1 2 0 2 3] "point3 P" [-2 0 -2 2 0 -2 2 2 -2 -2 2 -2]
  "point2 uv" [0 0 1 0 1 1 0 1] "normal N" [0 0 1 0 0 1 0 0 1 0 0 1]
LightSource "point" "point3 from" [1 2 1] "rgb I" [2 2 2] "float scale" 0.5
LightSource "spot" "point3 from" [0 3 3] "point3 to" [0 0 0] "spectrum I" [400 1 700 3]
LightSource "distant" "float illuminance" 3
LightSource "infinite" "string filename" "square.exr" "float scale" 0.2
"""

_PLY = """ply
format ascii 1.0
element vertex 3
property float x
property float y
property float z
property float u
property float v
element face 1
property list uchar int vertex_indices
end_header
0 0 0 0 0
1 0 0 1 0
0 1 0 0 1
3 0 1 2
"""


def write_parts(folder: Path) -> None:
    """The files that these scenes name.

    Parameters
    ----------
    folder : pathlib.Path
    """
    rng = np.random.default_rng(1)
    Image.fromarray(rng.integers(0, 255, (4, 8, 3)).astype(np.uint8)).save(folder / "picture.png")
    write_image(folder / "sky.exr", rng.uniform(0.1, 1.0, (8, 16, 3)).astype(np.float32))
    write_image(folder / "square.exr", rng.uniform(0.1, 1.0, (8, 8, 3)).astype(np.float32))
    (folder / "part.ply").write_text(_PLY, encoding="ascii")
    (folder / "part.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 2 3\nf 1 4 2\n", encoding="ascii")
