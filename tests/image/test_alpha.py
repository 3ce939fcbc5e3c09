"""Alpha: an image over a background is the image that would have been rendered before it."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from PIL import Image

import clrender
from clrender.aov.first_hits import _Passes
from clrender.cli import main
from clrender.image.files import read_alpha, read_image
from clrender.scene import Scene

if TYPE_CHECKING:
    from clrender.device import Device

COLOR = np.array([0.7, 0.4, 0.9])
SIZE = (40, 30)


def described(**more: Any) -> Scene:
    """Things of all kinds before an even environment."""
    materials = {
        "matt": {"type": "lambert", "reflectance": [0.6, 0.5, 0.4]},
        "glass": {"type": "dielectric", "ior": 1.5},
        "leaf": {"type": "lambert", "reflectance": [0.2, 0.6, 0.2], "opacity": 0.4},
        "mirror": {"type": "mirror", "reflectance": [0.9, 0.9, 0.9]},
    }
    shapes = [
        {"type": "sphere", "center": [-0.8, 0.1, 0.0], "radius": 0.6, "material": "matt"},
        {"type": "sphere", "center": [0.7, 0.2, 0.4], "radius": 0.5, "material": "glass"},
        {
            "type": "quad",
            "origin": [-0.5, -0.9, 0.6],
            "edge_u": [1.4, 0, 0],
            "edge_v": [0, 0.7, 0.2],
            "material": "leaf",
        },
        {"type": "box", "center": [0.3, 0.9, -0.5], "size": [0.5, 0.5, 0.5], "material": "mirror"},
        {"type": "sphere", "center": [0.1, 0.2, 1.2], "radius": 0.4, "interior": "ink"},
        {"type": "sphere", "center": [-0.4, 0.9, 0.9], "radius": 0.3, "interior": "smoke"},
    ]
    content: dict[str, Any] = {
        "camera": {"position": [0.1, 0.3, 4.0], "target": [0, 0.1, 0], "vertical_fov": 40.0},
        "media": {"ink": {"absorption": 1.5}, "smoke": {"scattering": 2.0, "absorption": 0.2}},
        "materials": materials, "shapes": shapes,
        "lights": [{"type": "environment", "radiance": COLOR.tolist()}],
    }  # fmt: skip
    return Scene(**{**content, **more})


@pytest.mark.parametrize(
    "more",
    [
        {},
        *(
            pytest.param(more, marks=pytest.mark.long)
            for more in ({"filter": "mitchell"}, {"filter": "gaussian", "seed": 3}, {"integrator": "bdpt"})
        ),
    ],
    ids=str,
)
def test_an_image_over_a_background(device: Device, more: dict[str, Any]) -> None:
    scene = described()
    how = {"size": SIZE, "spp": 16, **more}
    with clrender.Session(device.info.index) as session:
        before = session.render(scene, **how).linear.astype(np.float64)
        image = session.render(scene.with_hidden_environment(), **how, aov="alpha")
    assert image.alpha is not None and image.alpha.shape == (30, 40)
    alpha = image.alpha.astype(np.float64)[..., None]
    over = image.linear + (1.0 - alpha) * COLOR
    assert over.mean() == pytest.approx(before.mean(), rel=0.01)
    # To the last digits, but for smoke, through which rays pass by chance, and where shares are cut at 0 and 1
    close = np.abs(over - before).max(axis=2) < 1e-5
    if more.get("filter") != "mitchell" and more.get("integrator") != "bdpt":
        y, x = np.mgrid[:30, :40]
        assert close[(x - 14) ** 2 + (y - 4) ** 2 > 6**2].all()
        assert (image.linear[alpha[..., 0] == 0.0] == 0.0).all()
    assert alpha.min() == 0.0 and alpha.max() == 1.0


def test_shares_that_pass(device: Device) -> None:
    """A veil, ink in all of the view, and smoke, which hides what it scatters away."""
    wide = {"type": "quad", "origin": [-9, -9, 0], "edge_u": [18, 0, 0], "edge_v": [0, 18, 0], "material": "veil"}
    slab = {"type": "box", "center": [0, 0, 0], "size": [40, 40, 0.5]}
    camera = {"position": [0, 0, 4], "target": [0, 0, 0], "vertical_fov": 1.0}
    veil = {"type": "lambert", "reflectance": [0.5] * 3, "opacity": 0.25}
    smoke = {"absorption": 0.5, "scattering": 1.5}
    cases: dict[str, tuple[dict[str, Any], float, float]] = {
        "veil": ({"materials": {"veil": veil}, "shapes": [wide]}, 0.25, 0.01),
        "ink": (
            {"shapes": [{**slab, "interior": "m"}], "media": {"m": {"absorption": [1.0, 1.0, 1.0]}}, "materials": {}},
            1.0 - np.exp(-0.5), 1e-4,
        ),
        "smoke": (
            {"shapes": [{**slab, "interior": "m"}], "media": {"m": smoke}, "materials": {}},
            1.0 - np.exp(-1.0), 1e-4,
        ),
        "nothing": ({"shapes": [], "materials": {}}, 0.0, 0.0),
    }  # fmt: skip
    with clrender.Session(device.info.index) as session:
        for name, (parts, wanted, error) in cases.items():
            image = session.render(described(camera=camera, **parts), size=(16, 16), spp=64, aov=["alpha"])
            assert image.alpha is not None
            assert image.alpha.mean() == pytest.approx(wanted, abs=error), name


def test_alpha_does_not_wait_for_all_samples_of_a_render_that_ends_early(
    device: Device, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It is rendered before the image, of whose samples most may never be taken."""
    asked: list[tuple[str, int]] = []
    mean = _Passes.mean

    def noted(passes: _Passes, what: str, samples: int) -> Any:
        asked.append((what, samples))
        return mean(passes, what, samples)

    monkeypatch.setattr(_Passes, "mean", noted)
    ways: list[dict[str, Any]] = [
        {"spp": 300, "error": 0.9, "replicate_spp": 1},
        {"spp": 300, "time_limit": 1000.0},
        {"spp": 300},
    ]
    with clrender.Session(device.info.index) as session:
        for how in ways:
            session.render(described(), size=(8, 6), aov="alpha", **how)
    assert asked == [("alpha", 256), ("alpha", 256), ("alpha", 300)]


def test_colours_that_hold_what_alpha_leaves_out_are_noted(device: Device) -> None:
    lines: list[str] = []
    with clrender.Session(device.info.index, notify=lines.append) as session:
        for scene in (described(), described().with_hidden_environment(), described(lights=[])):
            session.render(scene, size=(8, 6), spp=1, aov="alpha")
        session.render(described(), size=(8, 6), spp=1, aov="depth")
    noted = [line for line in lines if "alpha" in line]
    assert len(noted) == 1
    assert noted[0].startswith("note: the colours hold the environment, which alpha leaves out; hide it")


def test_a_png_may_be_the_only_output_of_alpha(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "s.json").write_text(
        described().changed({"lights[0].visible_to_camera": False}).model_dump_json(exclude_unset=True)
    )
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SystemExit) as end:
        main(["render", "s.json", "-o", "a.png", "--aov", "alpha", "--size", "8x6", "--spp", "1", "--quiet"])
    assert end.value.code == 0
    assert np.asarray(Image.open(tmp_path / "a.png")).shape == (6, 8, 4)


def test_files_with_a_fourth_channel(device: Device, tmp_path: Path) -> None:
    with clrender.Session(device.info.index) as session:
        image = session.render(described().with_hidden_environment(), size=SIZE, spp=8, aov=("alpha", "depth"))
        for name in ("a.png", "a.exr"):
            image.save(tmp_path / name)
            found = clrender.verify(tmp_path / name, scene=described().with_hidden_environment(), fraction=1.0)
            assert found.sound and found.checked == found.tiles
    assert image.alpha is not None
    covered = np.rint(image.alpha * 255).astype(np.uint8)
    alpha = read_alpha(tmp_path / "a.png")
    assert alpha is not None
    np.testing.assert_array_equal(alpha, covered)
    with Image.open(tmp_path / "a.png") as picture:
        assert picture.mode == "RGBA"
    straight = read_image(tmp_path / "a.png")
    inside = (covered > 0) & (image.linear.max(axis=2) < 0.9 * image.alpha)
    np.testing.assert_allclose((straight * image.alpha[..., None])[inside], image.linear[inside], atol=0.01)
    np.testing.assert_array_equal(read_image(tmp_path / "a.exr"), image.linear)
    import OpenEXR

    with OpenEXR.File(str(tmp_path / "a.exr"), separate_channels=True) as file:
        channels = file.channels()
        np.testing.assert_array_equal(channels["A"].pixels, image.alpha)
        assert {"R", "G", "B", "A", "depth.Z"} == set(channels)


def test_a_changed_pixel_of_a_png_with_alpha_is_found(device: Device, tmp_path: Path) -> None:
    scene = described().with_hidden_environment()
    with clrender.Session(device.info.index) as session:
        session.render(scene, size=SIZE, spp=8, aov="alpha").save(tmp_path / "a.png")
    with Image.open(tmp_path / "a.png") as picture:
        notes, pixels = picture.info, np.array(picture)
    from clrender.image.display import png_bytes

    pixels[15, 12, 1] ^= 1
    (tmp_path / "b.png").write_bytes(png_bytes(pixels, {"clrender": notes["clrender"]}))
    assert not clrender.verify(tmp_path / "b.png", scene=scene, fraction=1.0).sound


@pytest.mark.parametrize("ending", [".png", ".exr"])
def test_coverage_is_verified(tmp_path: Path, device: Device, ending: str) -> None:
    """What a file's own alpha hid was taken for right, and an object that was erased for one that was never there."""
    (tmp_path / "s.toml").write_text(
        "[camera]\nposition = [0.0, 0.0, 4.0]\ntarget = [0.0, 0.0, 0.0]\n[[lights]]\ntype = 'environment'\n"
        "radiance = 1.0\n[[shapes]]\ntype = 'sphere'\nradius = 1.0\n",
        encoding="utf-8",
    )
    image = clrender.render(clrender.load(tmp_path / "s.toml"), device=device, size=(16, 16), spp=2, aov=["alpha"])
    name = tmp_path / f"a{ending}"
    image.save(name)
    assert clrender.verify(name, 1.0, scene=tmp_path / "s.toml", device=device).sound
    image.aovs["alpha"][8, 8] = 0.0
    image.linear[8, 8] = 0.0 if ending == ".png" else image.linear[8, 8]
    image.save(name)
    found = clrender.verify(name, 1.0, scene=tmp_path / "s.toml", device=device)
    assert found.pixels == ((8, 8),)
