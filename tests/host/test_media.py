"""Media of dielectrics: their numbers, what they absorb, which of them a point is in, and what is refused."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pytest
from cases import for_each

from clrender import layout
from clrender.errors import SceneError
from clrender.flatten.flat_scene import flatten, seen_by
from clrender.flatten.interiors import media_with_lights, packed
from clrender.flatten.media import absorption_coefficients, scene_media
from clrender.rendering.job import RenderJob
from clrender.scene import Scene
from clrender.scene.description import Camera, Dielectric

SPHERE: Mapping[str, Any] = {"type": "sphere", "radius": 1.0}


def glass(ior: float = 1.5, **more: Any) -> dict[str, Any]:
    return {"type": "dielectric", "ior": ior, **more}


def tinted(ior: float = 1.5, **more: Any) -> dict[str, Any]:
    return glass(ior, attenuation_color=[0.5, 1.0, 0.25], attenuation_distance=2.0, **more)


def scene(shapes: Sequence[Mapping[str, Any]], position: Sequence[float] = (0.0, 0.0, 5.0), **materials: Any) -> Scene:
    target = [position[0], position[1], position[2] - 1.0]
    return Scene(camera={"position": position, "target": target}, shapes=tuple(shapes), materials=materials)


def of_each(**materials: Any) -> Scene:
    """A sphere of each material."""
    return scene([{**SPHERE, "material": name} for name in materials], **materials)


def around(what: Scene) -> list[int]:
    """The list of media with which the camera's rays begin."""
    row = flatten(what, 8, 8).camera[0]
    entries = [*int(row["interior_first"]).to_bytes(4, "big"), *int(row["interior_last"]).to_bytes(4, "big")]
    return [entry for entry in entries if entry]


def test_media_are_numbered_by_priority() -> None:
    what = of_each(a=glass(priority=2), b=glass(1.3), c=glass(1.2, priority=7), d=tinted(1.1, priority=0), e=glass(1.4))
    media = scene_media(what)
    assert media.of_solid == {("b", None): 1, ("e", None): 2, ("d", None): 3, ("a", None): 4, ("c", None): 5}
    assert media.rows[:, 0].tolist() == np.array([1.0, 1.3, 1.4, 1.1, 1.5, 1.2], np.float32).tolist()
    assert media.rows[0, 4].view(np.uint32) == 2
    np.testing.assert_allclose(media.rows[3, 1:4], [math.log(2.0) / 2.0, 0.0, math.log(4.0) / 2.0], rtol=1e-7)
    assert not media.rows[[0, 1, 2, 4, 5], 1:4].any()


def test_of_equal_priorities_the_first_material_wins() -> None:
    assert scene_media(of_each(a=glass(priority=1), b=glass(1.3, priority=1))).of_solid == {
        ("b", None): 1,
        ("a", None): 2,
    }


def test_equal_media_are_one() -> None:
    assert scene_media(of_each(a=glass(priority=1), b=glass(priority=1), c=glass(priority=2))).of_solid == {
        ("a", None): 1,
        ("b", None): 1,
        ("c", None): 2,
    }


@pytest.mark.parametrize("materials", [{"a": glass()}, {"a": glass(), "b": glass(1.33, exterior_ior=1.5)}], ids=str)
def test_without_priorities_and_absorption_there_is_no_account(materials: dict[str, Any]) -> None:
    arrays = flatten(of_each(**materials), 8, 8).arrays
    assert len(arrays["media_rows"]) == 1
    assert not arrays["materials"]["medium"].any()


def test_clear_principled_materials_are_media() -> None:
    """With absorption of their own, or beside a dielectric that keeps an account; none of index 1 seems no boundary."""
    clear = {"type": "principled", "transmission": 0.5}
    absorbs = {"attenuation_color": [0.5, 1.0, 0.25], "attenuation_distance": 2.0}
    what = of_each(
        a={**clear, **absorbs}, b={**clear, "ior": 1.0}, c={"type": "principled"}, d={**clear, "thin": True}, e=tinted()
    )
    media = scene_media(what)
    assert media.of_solid == {("a", None): 1, ("b", None): 2, ("e", None): 1} and not media.no_boundary
    np.testing.assert_allclose(media.rows[1, 1:4], [math.log(2.0) / 2.0, 0.0, math.log(4.0) / 2.0], rtol=1e-7)
    rows = flatten(what, 8, 8).arrays["materials"]
    assert 1.0 < rows["ior"][1] < 1.000001 and rows["ior"][[0, 2, 3, 4]].tolist() == [1.5] * 4
    assert len(scene_media(of_each(a={**clear, "ior": 1.0})).rows) == 1
    assert flatten(of_each(a={**clear, "ior": 1.0}), 8, 8).arrays["materials"]["ior"][0] == 1.0


@for_each(
    ("more", "message"),
    [
        ({"transmission": 0.0}, r"materials.a.attenuation_color does nothing without transmission; give it some"),
        ({"thin": True}, r"materials.a.attenuation_color cannot be given beside thin: such a wall has no inside"),
        ({"attenuation_color": None}, r"materials.a.attenuation_distance needs attenuation_color beside it"),
        ({"attenuation_distance": None}, r"materials.a.attenuation_color needs attenuation_distance beside it"),
        ({"attenuation_color": [0.5, 0.0, 1.0]}, r"attenuation_color\[1\] is 0, which no thickness of a medium does"),
        ({"attenuation_distance": -1.0}, r"materials.a.attenuation_distance"),
    ],
)
def test_principled_absorption_that_is_refused(more: dict[str, Any], message: str) -> None:
    absorbs = {"transmission": 1.0, "attenuation_color": [0.5, 1.0, 0.25], "attenuation_distance": 2.0}
    with pytest.raises(SceneError, match=message):
        of_each(a={"type": "principled", **absorbs, **more})


@for_each("other", [{"transmission": 0.5}, {"coat": {"checker": [0.0, 1.0]}}, {"sheen_color": [0.0, 0.1, 0.0]}])
def test_beckmanns_facets_are_refused_beside_what_knows_ggx_only(other: dict[str, Any]) -> None:
    with pytest.raises(SceneError, match=rf"materials.a.microfacets is given beside {next(iter(other))}"):
        of_each(a={"type": "principled", "microfacets": "beckmann", **other})


def test_what_no_shape_uses_does_not_count() -> None:
    what = scene([{**SPHERE, "material": "a"}], a=glass(), b=glass(priority=3))
    assert len(scene_media(what).rows) == 1


@for_each(
    "materials, left_out",
    [
        ({"a": glass(1.0, priority=0), "b": glass(priority=1)}, "a"),
        ({"a": glass(1.0, priority=1), "b": glass(priority=0)}, ""),
        ({"a": glass(1.0, priority=1), "b": glass(1.0, priority=0)}, "ab"),
        ({"a": tinted(1.0, priority=0), "b": glass(priority=1)}, ""),
        ({"a": glass(1.0), "b": glass(priority=1)}, "a"),
        ({"a": tinted(1.0)}, ""),
        ({"a": glass(1.0, attenuation_color=[1.0] * 3, attenuation_distance=1.0)}, "a"),
    ],
)
def test_what_changes_nothing_is_left_out(materials: dict[str, Any], left_out: str) -> None:
    what = of_each(**materials)
    assert scene_media(what).no_boundary == {(name, None) for name in left_out}
    assert flatten(what, 8, 8).analytic_count == len(materials) - len(left_out)


def test_absorption_is_the_logarithm_of_what_is_left() -> None:
    material = Dielectric(type="dielectric", ior=1.5, attenuation_color=(1.0, 0.3, 1e-30), attenuation_distance=0.07)
    expected = [0.0, -math.log(0.3) / 0.07, 30.0 * math.log(10.0) / 0.07]
    np.testing.assert_allclose(absorption_coefficients(material), expected, rtol=1e-14)


TETRAHEDRON = {"type": "tetrahedron", "vertices": [[0, 0, 0], [3, 0, 0], [0, 3, 0], [0, 0, 3]]}


@pytest.mark.parametrize(
    "shape, inside, outside",
    [
        (SPHERE, (0.1, 0.9, 0.2), (0.7, 0.7, 0.7)),
        ({"type": "box", "size": [2, 2, 2], "transform": {"rotate_degrees": [0, 0, 45]}}, (1.3, 0, 0), (0.9, 0.9, 0)),
        ({"type": "box", "size": [2, 2, 2], "transform": {"scale": [-1, 2, 1]}}, (0.9, 1.9, 0.9), (1.1, 0.0, 0.0)),
        (TETRAHEDRON, (0.9, 0.9, 0.9), (1.1, 1.1, 1.1)),
    ],
    ids=str,
)
def test_the_camera_knows_where_it_is(shape: Any, inside: Sequence[float], outside: Sequence[float]) -> None:
    media = {"a": glass(priority=2), "b": glass(1.33, priority=1)}
    shapes = [{**shape, "material": "a"}, {**SPHERE, "radius": 9.0, "material": "b"}]
    assert around(scene(shapes, inside, **media)) == [2, 1]
    assert around(scene(shapes, outside, **media)) == [1]
    assert around(scene(shapes, (0.0, 0.0, 50.0), **media)) == []
    # Another camera for the same arrays
    flat = flatten(scene(shapes, outside, **media), 8, 8)
    assert seen_by(flat, scene(shapes, inside, **media), 8, 8).camera[0]["interior_first"] == 0x02010000


def test_a_film_or_lens_that_cuts_a_medium_is_known() -> None:
    shapes = [{**SPHERE, "material": "a"}, {"type": "box", "size": [20, 1, 1], "center": [0, 9, 0], "material": "a"}]
    what = scene(shapes, (0.0, 0.0, 5.0), a=glass(priority=1))

    def cuts(**camera: Any) -> int:
        seen = what.model_copy(update={"camera": Camera(**{"position": (0, 0, 5), "target": (0, 0, 0)} | camera)})
        row = flatten(seen, 8, 8).camera[0]
        assert row == seen_by(flatten(what, 8, 8), seen, 8, 8).camera[0]
        return int(row["cuts_media"])

    film = {"type": "orthographic", "height": 2.0}
    assert not cuts() and not cuts(aperture_radius=3.9) and not cuts(**film)
    assert cuts(aperture_radius=6.0, position=(0.0, 0.0, 0.5))
    assert cuts(**film, position=(0.0, 0.0, 0.5))
    assert cuts(**film, position=(0.0, 9.0, 1.0), target=(0.0, 0.0, 1.0), up=(0, 0, 1))
    assert not cuts(position=(0.0, 0.0, 0.5)), "of a pinhole all rays begin in the same place"


def test_a_hollow_of_two_spheres_is_empty() -> None:
    inner = {**SPHERE, "radius": 0.8, "material": "a", "flip_normals": True}
    shapes = [{**SPHERE, "material": "a"}, inner]
    assert around(scene(shapes, (0.0, 0.1, 0.0), a=glass(priority=1))) == []
    assert around(scene(shapes, (0.0, 0.9, 0.0), a=glass(priority=1))) == [1]


def test_a_volume_around_twice_is_in_the_list_twice() -> None:
    shapes = [{**SPHERE, "material": "a"}, {**SPHERE, "radius": 2.0, "material": "a"}]
    assert around(scene(shapes, (0.0, 0.1, 0.0), a=glass(priority=1))) == [1, 1]


def test_without_priority_the_smallest_volume_comes_first() -> None:
    shapes = [{**SPHERE, "material": "a"}, {**SPHERE, "radius": 0.5, "material": "b"}]
    materials = {"a": tinted(), "b": glass(1.3), "c": glass(priority=1)}
    assert around(scene([*shapes, {**SPHERE, "radius": 3.0, "material": "c"}], (0.0, 0.1, 0.0), **materials)) == [
        3,
        2,
        1,
    ]


def test_a_list_is_two_words() -> None:
    assert packed([]) == (0, 0)
    assert packed([9, 8, 7]) == (0x09080700, 0)
    assert packed([255, 8, 7, 6, 5, 4, 3, 2, 1]) == (0xFF080706, 0x05040302)


def test_too_many_media() -> None:
    with pytest.raises(
        SceneError, match=r"^Scene: materials: .* are 256 different media, but paths tell 255 apart; let"
    ):
        scene_media(of_each(**{f"m{i}": glass(1.0 + 0.001 * i, priority=i) for i in range(257)}))


@pytest.mark.parametrize(
    "light",
    [
        {"type": "quad", "origin": [-0.1, 0, 0], "edge_u": [0.2, 0, 0], "edge_v": [0, 0.2, 0], "emission": [1, 1, 1]},
        {"type": "sphere", "radius": 0.1, "emission": [1, 1, 1]},
        {"type": "disk", "center": [0.95, 0, 0], "normal": [0, 1, 0], "radius": 0.5, "emission": [1, 1, 1]},
    ],
    ids=lambda light: str(light["type"]),
)
def test_lights_inside_are_found(light: dict[str, Any]) -> None:
    volume = {**SPHERE, "material": "a"}
    far = {**light, "transform": {"translate": [5.0, 0.0, 0.0]}}
    for shapes, exact in (([volume, far, light], True), ([volume, far], False)):
        flat = flatten(scene(shapes, a=glass(priority=1)), 8, 8)
        assert bool(media_with_lights(flat.arrays, flat.triangle_count, flat.light_count)) == exact
    flat = flatten(scene([volume, light], a=glass()), 8, 8)
    assert not media_with_lights(flat.arrays, flat.triangle_count, flat.light_count)


def test_a_volume_that_shines_is_no_light_inside_itself() -> None:
    for shape in (SPHERE, {"type": "box", "size": [1, 1, 1]}):
        flat = flatten(scene([{**shape, "material": "a", "emission": [1, 1, 1]}], a=glass(priority=1)), 8, 8)
        assert flat.light_count > 0
        assert not media_with_lights(flat.arrays, flat.triangle_count, flat.light_count)


@pytest.mark.parametrize("key, material", [("priority", glass(priority=1)), ("attenuation_color", tinted())])
def test_reuse_refuses_them(key: str, material: dict[str, Any]) -> None:
    with pytest.raises(
        SceneError, match=rf"shapes\[0\]\.material: 'a' has {key}, which the integrator reuse does not take"
    ):
        RenderJob.of(of_each(a=material), integrator="reuse")
    assert RenderJob.of(of_each(a=glass()), integrator="reuse")


@for_each(
    "center, size, warned",
    [
        ((0.0, 0.0, 2.0), (2.0, 2.0, 2.0), True),  # face to face
        ((0.0, 0.0, 1.0), (2.0, 2.0, 2.0), True),  # half in, with common sides
        ((0.1, 0.2, 1.0), (2.0, 2.0, 2.0), False),  # overlapping
        ((0.0, 0.0, 2.01), (2.0, 2.0, 2.0), False),  # a gap
        ((2.0, 0.0, 2.0), (2.0, 2.0, 2.0), False),  # an edge in common
        ((3.0, 0.0, 0.0), (2.0, 2.0, 2.0), False),  # in the same planes, apart
    ],
)
@for_each("turn", [[0, 0, 0], [10, 20, 30]])
def test_faces_that_coincide_are_told(center: Sequence[float], size: Sequence[float], turn: Any, warned: bool) -> None:
    def box(center: Sequence[float], size: Sequence[float], material: str) -> dict[str, Any]:
        rotated = {"rotate_degrees": turn}
        return {"type": "box", "center": center, "size": size, "material": material, "transform": rotated}

    shapes = [SPHERE, box([0, 0, 0], [2, 2, 2], "a"), box(center, size, "b")]
    for material, exact in ((glass(1.3, priority=1), warned), (glass(priority=2), warned), (glass(1.3), warned)):
        flat = flatten(scene(shapes, a=glass(priority=2), b=material), 8, 8)
        told = [warning for warning in flat.warnings if "shapes[1] and shapes[2]: faces of two dielectrics" in warning]
        assert bool(told) == exact


def test_the_list_has_the_kernels_length() -> None:
    from clrender.files.package_data import kernels_folder
    from clrender.flatten.interiors import LIST_LENGTH

    text = (kernels_folder() / "material" / "interior.h").read_text(encoding="utf-8")
    assert f"#define INTERIOR_ENTRIES {LIST_LENGTH}\n" in text
    assert layout.dtype("Camera").itemsize % 16 == 0
