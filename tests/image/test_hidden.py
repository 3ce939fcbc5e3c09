"""What is hidden from the camera: its rays pass it, and all others meet it, to the bit."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

import clrender
from clrender.errors import SceneError
from clrender.exporters import write_mitsuba
from clrender.scene import Scene

if TYPE_CHECKING:
    from clrender.device import Device

SIZE = (48, 48)
SKY = (0.25, 0.5, 1.0)
LAMP = 1
"""Number of the lamp among the shapes."""


def described(lamp: bool = True, sky: bool = True, group: bool = False) -> dict[str, Any]:
    """A floor, a mirror and a lamp below a sky; what of both the camera sees, and whether the lamp is an instance."""
    shines: dict[str, Any] = {"type": "sphere", "center": [0.0, 1.0, 0.0], "radius": 0.4}
    floor = {"type": "quad", "origin": [-3, 0, 3], "edge_u": [6, 0, 0], "edge_v": [0, 0, -6], "material": "white"}
    mirror = {"type": "sphere", "center": [1.5, 0.7, 0.0], "radius": 0.5, "material": "mirror"}
    shines |= {} if group else {"emission": [5.0, 4.0, 3.0]}
    shines |= {} if lamp else {"visible_to_camera": False}
    return {
        "camera": {"position": [0, 1, 5], "target": [0, 1, 0]},
        "materials": {"white": {"type": "lambert", "reflectance": [0.7, 0.6, 0.5]}, "mirror": {"type": "mirror"}},
        "groups": {"lamp": {"shapes": [shines]}},
        "shapes": [floor, {"type": "instance", "group": "lamp"} if group else shines, mirror],
        "lights": [
            {"type": "environment", "radiance": SKY} | ({} if sky else {"visible_to_camera": False}),
        ],
    }


def rendered(device: Device, scene: dict[str, Any], **more: Any) -> clrender.RenderedImage:
    return clrender.render(Scene.model_validate(scene), device=device, size=SIZE, **{"spp": 8, **more})


def meets(device: Device, scene: dict[str, Any], shape: int) -> tuple[Any, Any]:
    """Pixels of which each of 64 rays of the camera meets a shape first, and those of which none does."""
    found = rendered(device, scene, spp=64, aov=["object"], filter="box").aovs["object"]
    share = np.asarray(found[..., 0] == shape) if found.ndim == 3 else np.asarray(found == shape)
    wide = np.pad(share, 1)
    around = [wide[y : y + share.shape[0], x : x + share.shape[1]] for y in range(3) for x in range(3)]
    return np.logical_and.reduce(around), ~np.logical_or.reduce(around)


@pytest.mark.long
@pytest.mark.parametrize(
    "integrator", ["path", "bdpt", "direct", "reuse", pytest.param("photon", marks=pytest.mark.slow)]
)
def test_a_hidden_lamp_lights_the_scene_as_before(device: Device, integrator: str) -> None:
    more = {"photons": 512} if integrator == "photon" else {}
    seen, hidden = (rendered(device, described(lamp), integrator=integrator, **more).linear for lamp in (True, False))
    within, without = meets(device, described(), LAMP)
    assert within.sum() > 20 and without.sum() > 1000
    assert (seen[within] == (5.0, 4.0, 3.0)).all()
    np.testing.assert_allclose(hidden[within], np.broadcast_to(SKY, hidden[within].shape), rtol=1e-6)
    if integrator != "reuse":  # whose pixels share what their neighbours found
        assert (hidden[without] == seen[without]).all()
    else:
        np.testing.assert_allclose(hidden[without].mean(), seen[without].mean(), rtol=0.02)


@pytest.mark.long
@pytest.mark.parametrize(
    "integrator",
    [
        "path",
        "bdpt",
        "reuse",
        *(pytest.param(each, marks=pytest.mark.slow) for each in ("direct", "photon", "whitted")),
    ],
)
def test_a_hidden_sky_is_black_to_the_camera_only(device: Device, integrator: str) -> None:
    more = {"photons": 512} if integrator == "photon" else {}
    seen, hidden = (rendered(device, described(sky=sky), integrator=integrator, **more).linear for sky in (True, False))
    assert (hidden[:8] == 0.0).all() and (seen[:8] == np.array(SKY, np.float32)).all()
    for shape in (0, 2):  # the floor, and the mirror that shows the sky
        within, _ = meets(device, described(), shape)
        assert within.sum() > 20
        assert (hidden[within] == seen[within]).all() and hidden[within].max() > 0.1


@pytest.mark.long
def test_a_hidden_surface_with_a_texture_and_no_other_parameters(device: Device) -> None:
    """Its material has a colour where others have the number of their row."""
    scene = described(lamp=False)
    scene["materials"]["checked"] = {"type": "lambert", "reflectance": {"checker": [0.2, 0.9]}}
    scene["shapes"][LAMP] |= {"material": "checked"}
    hidden = rendered(device, scene).linear
    scene["shapes"][LAMP].pop("visible_to_camera")
    seen = rendered(device, scene).linear
    within, without = meets(device, described(), LAMP)
    np.testing.assert_allclose(hidden[within], np.broadcast_to(SKY, hidden[within].shape), rtol=1e-6)
    assert (hidden[without] == seen[without]).all()


@pytest.mark.long
def test_a_hidden_sun_and_sky(device: Device) -> None:
    scene = described()
    scene["lights"] = [{"type": "sun_sky", "sun_direction": [0.0, 0.25, -1.0], "scale": 0.01}]
    seen = rendered(device, scene).linear
    scene["lights"][0]["visible_to_camera"] = False
    hidden = rendered(device, scene).linear
    assert (hidden[:8] == 0.0).all() and seen[:8].min() > 0.0
    within, _ = meets(device, described(), 0)
    assert (hidden[within] == seen[within]).all()


@pytest.mark.long
def test_a_hidden_instance_is_in_the_mirror_and_shades_the_floor(device: Device) -> None:
    seen, hidden = (rendered(device, described(lamp, group=True)).linear for lamp in (True, False))
    within, without = meets(device, described(), LAMP)
    np.testing.assert_allclose(hidden[within], np.broadcast_to(SKY, hidden[within].shape), rtol=1e-6)
    assert (hidden[without] == seen[without]).all()


@pytest.mark.slow
def test_layers_and_lanes_know_what_is_hidden(device: Device) -> None:
    images = [rendered(device, described(lamp=False, sky=False), aov=["depth", "emission"], lanes=n) for n in (16, 1)]
    assert images[0].stats["image_sha256"] == images[1].stats["image_sha256"]
    within, _ = meets(device, described(), LAMP)
    assert np.isinf(images[0].aovs["depth"][within]).all() and (images[0].aovs["emission"][within] == 0.0).all()


def test_what_is_seen_has_the_hash_that_it_always_had() -> None:
    plain = described()
    said = described()
    said["shapes"][LAMP]["visible_to_camera"] = said["lights"][0]["visible_to_camera"] = True
    hashes = [
        Scene.model_validate(each).sha256() for each in (plain, said, described(lamp=False), described(sky=False))
    ]
    assert hashes[0] == hashes[1] and len(set(hashes)) == 3


@pytest.mark.parametrize("inside", [{"material": "glass"}, {"interior": "smoke"}])
def test_what_has_an_inside_cannot_be_hidden(inside: dict[str, str]) -> None:
    scene = described()
    scene["materials"]["glass"] = {"type": "dielectric", "ior": 1.5}
    scene["media"] = {"smoke": {"scattering": [1.0, 1.0, 1.0]}}
    scene["shapes"].append({"type": "sphere", "radius": 0.1, "visible_to_camera": False, **inside})
    with pytest.raises(ValueError, match="cannot be false for what has an inside"):
        Scene.model_validate(scene)


@pytest.mark.parametrize(("changes", "where"), [({"lamp": False}, r"shapes\[1\]"), ({"sky": False}, r"lights\[0\]")])
def test_radiosity_refuses_what_is_hidden(device: Device, changes: dict[str, bool], where: str) -> None:
    scene = described(**changes)
    scene["materials"]["mirror"] = scene["materials"]["white"]
    with pytest.raises(SceneError, match=rf"{where}\.visible_to_camera is false, which the integrator radiosity"):
        rendered(device, scene, integrator="radiosity")


def test_radiosity_says_that_alpha_hides_the_environment(device: Device) -> None:
    scene = described()
    scene["materials"]["mirror"] = scene["materials"]["white"]
    hidden = Scene.model_validate(scene).with_hidden_environment()
    with pytest.raises(
        SceneError, match=r"the environment is hidden \(--alpha, hide_environment\), which the integrator"
    ):
        clrender.render(hidden, device=device, size=SIZE, spp=8, integrator="radiosity")


def test_hide_emitters_of_mitsuba(tmp_path: Path) -> None:
    """Lights that are shapes, and the environment; written again when nothing else is hidden."""
    text = """<scene version="3.0.0"><integrator type="path"><boolean name="hide_emitters" value="true"/></integrator>
        <sensor type="perspective"/><emitter type="constant"/><shape type="rectangle"><bsdf type="diffuse"/></shape>
        <shape type="sphere"><emitter type="area"><rgb name="radiance" value="1"/></emitter></shape></scene>"""
    (tmp_path / "a.xml").write_text(text)
    scene = clrender.load(tmp_path / "a.xml")
    assert [shape.visible_to_camera for shape in scene.plain_shapes] == [True, False]
    assert scene.environment is not None and not scene.environment.visible_to_camera
    assert not any("hide_emitters" in note for note in scene.notes)
    notes = write_mitsuba(scene, tmp_path / "b.xml")
    assert not any("camera does not see" in note for note in notes)
    again = clrender.load(tmp_path / "b.xml")
    assert [shape.visible_to_camera for shape in again.plain_shapes] == [True, False]
    turn = '<transform name="to_world"><rotate x="1" angle="-90"/></transform>'
    sky = text.replace('<emitter type="constant"/>', f'<emitter type="sunsky">{turn}</emitter>')
    glass = '<bsdf type="principled"><float name="spec_trans" value="0.5"/></bsdf><emitter type="area">'
    (tmp_path / "d.xml").write_text(sky.replace('<emitter type="area">', glass))
    other = clrender.load(tmp_path / "d.xml")
    assert other.sky is not None and not other.sky.visible_to_camera
    assert other.plain_shapes[1].visible_to_camera and any("a light with an inside" in note for note in other.notes)
    mixed = scene.changed({"shapes[0].visible_to_camera": False, "shapes[1].visible_to_camera": True})
    notes = write_mitsuba(mixed, tmp_path / "c.xml")
    assert any("camera does not see" in note for note in notes)
