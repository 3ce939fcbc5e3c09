"""What pbrt-v4 defines otherwise than we do: coats, sensors, subsurface scattering, holes and subdivision."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cases import for_each

import clrender.importers.pbrt
from clrender.image.pictures import open_picture
from clrender.importers import load
from clrender.importers.asset_files import AssetFiles
from clrender.importers.draft import Draft
from clrender.scene import Scene

BALL = 'Shape "sphere"\n'


def text(world: str, before: str = 'Camera "perspective"') -> str:
    return f"{before}\nWorldBegin\n{world}\n"


def pbrt(folder: Path, world: str, before: str = 'Camera "perspective"') -> Scene:
    """The scene of a pbrt file."""
    path = folder / "scene.pbrt"
    path.write_text(text(world, before), encoding="utf-8")
    return load(path)


def draft_of(folder: Path, world: str) -> Draft:
    """What its reader makes of a pbrt file."""
    path = folder / "scene.pbrt"
    path.write_text(text(world), encoding="utf-8")
    return clrender.importers.pbrt.read(path, AssetFiles("scene.pbrt", folder))


def dump(part: Any) -> dict[str, Any]:
    """What is not left at its default."""
    found: dict[str, Any] = part.model_dump(exclude_unset=True)
    return found


# --- coats


def layered(reflectance: float, ior: float) -> float:
    """Reflectance of a metal below a smooth boundary, straight on, by following the light up and down in it.

    Parameters
    ----------
    reflectance : float
        Of the metal in the coat.
    ior : float
        Index of refraction of the coat.
    """
    boundary = ((ior - 1.0) / (ior + 1.0)) ** 2
    found, inside = boundary, 1.0 - boundary
    for _ in range(200):
        inside *= reflectance
        found += inside * (1.0 - boundary)
        inside *= boundary
    return found


def seen(made: dict[str, Any], base: Any) -> Any:
    """Reflectance of our metal below its coat, straight on."""
    coat = 0.04 * made["coat"]
    return coat + (1.0 - coat) * np.asarray(base, np.float64)


@for_each(("given", "ior"), [("", 1.5), ('"float interface.eta" 1.3', 1.3)])
def test_a_coated_metal_reflects_what_its_layers_do(tmp_path: Path, given: str, ior: float) -> None:
    index = '"rgb conductor.eta" [0.2 0.9 1.1] "rgb conductor.k" [3.9 2.5 2.1]'
    rough = '"float interface.roughness" 0.0016 "float conductor.roughness" 0.0256'
    scene = pbrt(tmp_path, f'Material "coatedconductor" {index} {given} {rough}\n{BALL}')
    made = dump(next(iter(scene.materials.values())))
    wanted = []
    for eta, k in zip((0.2, 0.9, 1.1), (3.9, 2.5, 2.1), strict=True):
        inside = complex(eta, k) / ior
        wanted.append(layered(abs((inside - 1.0) / (inside + 1.0)) ** 2, ior))
    np.testing.assert_allclose(seen(made, made["base_color"]), wanted, rtol=1e-12)
    assert made["type"] == "principled" and made["metallic"] == 1.0
    # Alpha is the root of pbrt's roughness and the square of ours
    assert made["coat_roughness"] ** 4 == pytest.approx(0.0016) and made["roughness"] ** 4 == pytest.approx(0.0256)
    assert any("coatedconductor" in note for note in scene.notes)


def test_a_coated_metal_of_a_picture_is_that_of_its_colours(tmp_path: Path) -> None:
    """pbrt makes a metal of index 1 + i k of a reflectance r, with r = k² / (4 + k²)."""
    shares = np.array([0.0, 0.3, 0.9], np.float32)
    (tmp_path / "t.pfm").write_bytes(b"PF\n3 1\n-1\n" + np.repeat(shares, 3).astype("<f4").tobytes())
    picture = 'Texture "t" "spectrum" "imagemap" "string filename" "t.pfm"\n'
    draft = draft_of(tmp_path, f'{picture}Material "coatedconductor" "texture reflectance" "t"\n{BALL}')
    (made,) = draft.description["materials"].values()
    data, ending = draft.pictures[made["base_color"]["texture"]]
    (band,) = open_picture(io.BytesIO(data), ending).bands()
    wanted = []
    for share in shares.astype(float):
        inside = complex(1.0, 2.0 * np.sqrt(share / (1.0 - share))) / 1.5
        wanted.append(layered(abs((inside - 1.0) / (inside + 1.0)) ** 2, 1.5))
    np.testing.assert_allclose(seen(made, band.view(np.float16)[0, :, 0]), wanted, rtol=2e-3)
    plain = pbrt(tmp_path, f'Material "coatedconductor" "rgb reflectance" [0 0.3 0.9]\n{BALL}')
    color = dump(next(iter(plain.materials.values())))["base_color"]
    np.testing.assert_allclose(seen(made, color), wanted, rtol=1e-7)


def test_a_coat_of_a_larger_index_is_told(tmp_path: Path) -> None:
    scene = pbrt(tmp_path, f'Material "coatedconductor" "float interface.eta" 2\n{BALL}')
    assert dump(next(iter(scene.materials.values())))["coat"] == 1.0
    assert any("a coat of index 2 reflects as one of 1.5" in note for note in scene.notes)
