"""The files that commands of the documentation speak of, as a reader would have them."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Final

import numpy as np
from gltf_files import Model
from measured_files import rgl_fields, write_tensors

__all__ = ["make_files"]

_SCENES: Final = Path(__file__).resolve().parents[2] / "scenes"
_SCENE: Final = """
[camera]
position = [0.0, 0.0, -3.0]
target = [0.0, 0.0, 0.0]
[materials.gold]
type = "conductor"
metal = "Au"
roughness = 0.4
[[shapes]]
type = "sphere"
radius = 1.0
material = "gold"
[[lights]]
type = "environment"
radiance = [1.0, 1.0, 1.0]
"""
_MITSUBA: Final = """<scene version="3.0.0">
<sensor type="perspective">
<transform name="to_world"><lookat origin="0,0,-3" target="0,0,0" up="0,1,0"/></transform>
</sensor>
<shape type="sphere"><bsdf type="diffuse"/></shape>
<emitter type="constant"/>
</scene>
"""
_OBJ: Final = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"
_USD: Final = """#usda 1.0
def Mesh "plate"
{
    int[] faceVertexCounts = [4]
    int[] faceVertexIndices = [0, 1, 2, 3]
    point3f[] points = [(-1, 0, 1), (1, 0, 1), (1, 0, -1), (-1, 0, -1)]
}
"""


def make_files(folder: Path) -> None:
    """Write them.

    Parameters
    ----------
    folder : Path
        The reader's.
    """
    (folder / "my").mkdir()
    for name in ("scene.toml", "my/scene.toml"):
        (folder / name).write_text(_SCENE)
    (folder / "scene.xml").write_text(_MITSUBA)
    (folder / "model.obj").write_text(_OBJ)
    (folder / "stage.usda").write_text(_USD)
    model = Model()
    model.node(mesh=model.quad())
    (folder / "model.glb").write_bytes(model.glb())
    for name in ("sky.hdr", "tiles.png", "tiles-normal.png", "leaf.png", "cumulus.npy", "plume.npy", "down.npy"):
        shutil.copy(_SCENES / name, folder / name)
    shutil.copy(_SCENES / "tiles.png", folder / "slide.png")
    shutil.copytree(_SCENES / "plugins", folder / "scenes" / "plugins")
    moon = (_SCENES / "plugins" / "minnaert.cl").read_text()
    (folder / "bright.cl").write_text(moon.replace("* limb);", "* limb * 2.5f);"))
    for name in ("bunny", "bunny-leaping", "bunny-landed"):
        shutil.copy(_SCENES / "bumpy.ply", folder / f"{name}.ply")
    write_tensors(folder / "paint.bsdf", rgl_fields(spectral=True, side=8, views=4))
    np.save(folder / "warren.npy", np.eye(4)[None])
