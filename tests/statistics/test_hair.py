"""Curves and hair in images: against triangles, in furnaces, by several strategies, with the same bits everywhere."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from render_support import Studio, hashes_by_lanes_and_cuts
from stats_support import Evidence

import clrender
from clrender.flatten.tubes import curve_mesh
from clrender.furnace import findings, measure, subjects_of
from clrender.scene import Curves

if TYPE_CHECKING:
    from clrender.device import Device
    from clrender.scene import Scene

SKY = {"type": "environment", "radiance": [1.0, 1.0, 1.0]}
SUN = {"type": "directional", "direction": [-1.0, -1.5, -0.6], "irradiance": [4.0, 4.0, 3.5]}
CAMERA = {"position": [0.0, 0.6, 2.6], "target": [0.0, 0.15, 0.0]}
CLAY = {"type": "lambert", "reflectance": [0.7, 0.4, 0.2]}
GROUND = {"type": "quad", "origin": [-3.0, -0.5, 3.0], "edge_u": [6.0, 0.0, 0.0], "edge_v": [0.0, 0.0, -6.0]}


def tuft(count: int = 300, radius: float = 0.01) -> np.ndarray[Any, np.dtype[np.float64]]:
    """Strands that grow from a ball and hang down, (count, 6, 4)."""
    dice = np.random.RandomState(2)
    way = dice.normal(size=(count, 3))
    way /= np.linalg.norm(way, axis=1)[:, None]
    way[:, 1] = np.abs(way[:, 1])
    place, rows = way * 0.4, np.zeros((count, 6, 4))
    for number in range(6):
        rows[:, number, :3], rows[:, number, 3] = place, radius * (1.0 - 0.14 * number)
        way = way + dice.normal(size=(count, 3)) * 0.1 + (0.0, -0.25, 0.0)
        way /= np.linalg.norm(way, axis=1)[:, None]
        place = place + way * 0.12
    return rows


def with_strands(material: dict[str, Any], lights: list[Any], rows: Any = None, **curves: Any) -> Scene:
    shapes = [
        {"type": "curves", "file": "hair", "material": "hair", **curves},
        {"type": "sphere", "radius": 0.4, "material": "ground"},
        {**GROUND, "material": "ground"},
    ]
    scene = clrender.Scene(camera=CAMERA, shapes=shapes, lights=lights, materials={"hair": material, "ground": CLAY})
    return scene.with_arrays(curves={"hair": tuft() if rows is None else rows})


def arches() -> np.ndarray[Any, np.dtype[np.float64]]:
    """Bent strands of constant radius whose ends are out of sight, (6, 7, 4)."""
    rows, t = np.zeros((6, 7, 4)), np.linspace(0.0, 1.0, 7)
    for number in range(6):
        rows[number, :, 0] = (number - 2.5) * 0.4 + 0.4 * t
        rows[number, :, 1] = [-2.5, -1.7, -0.7, 0.9, -0.7, -1.7, -2.5]
        rows[number, :, 2], rows[number, :, 3] = 0.1 * np.cos(4.0 * t + 2.0 * number), 0.08
    return rows


@pytest.mark.thorough
@pytest.mark.parametrize(
    "integrator", ["path", *(pytest.param(name, marks=pytest.mark.long) for name in ("bdpt", "photon"))]
)
def test_curves_are_what_their_triangles_are(evidence: Evidence, studio: Studio, integrator: str) -> None:
    curves = with_strands(CLAY, [SKY, SUN], arches())
    (strands,) = (shape for shape in curves.shapes if isinstance(shape, Curves))
    mesh = curve_mesh(strands, curves.strands(("shapes", 0), strands), steps=24, around=64)
    content = curves.model_dump(exclude_unset=True)
    content["shapes"] = ({"type": "mesh", "file": "tubes", "material": "hair"}, *content["shapes"][1:])
    arrays = {"vertices": mesh.vertices, "faces": mesh.triangles, "normals": mesh.normals}
    triangles = clrender.Scene(**content).with_arrays(meshes={"tubes": arrays})
    settings: dict[str, Any] = {"spp": 64, "integrator": integrator, "size": 32}
    first, second = (studio.tiles(each, range(n, n + 8), **settings) for each, n in ((curves, 0), (triangles, 50)))
    # Less than the chords of 64 edges leave out
    evidence.equal("radiance", first, second, rounding=2e-3)


@pytest.mark.thorough
@pytest.mark.parametrize("integrator", ["path", pytest.param("bdpt", marks=pytest.mark.long)])
def test_white_hair_in_white_light_cannot_be_seen(evidence: Evidence, studio: Studio, integrator: str) -> None:
    white = {"type": "hair", "reflectance": [1.0, 1.0, 1.0]}
    scene = with_strands(white, [SKY])
    content = scene.model_dump(exclude_unset=True)
    content["shapes"] = content["shapes"][:1]
    alone = clrender.Scene(**content).with_arrays(curves={"hair": tuft(400, 0.02)})
    evidence.mean_is("radiance", studio.tiles(alone, spp=64, size=24, integrator=integrator), 1.0)


@pytest.mark.parametrize(
    "keys",
    [
        {},
        pytest.param({"roughness": 0.1, "azimuthal_roughness": 1.0, "tilt_degrees": 8.0}, marks=pytest.mark.long),
        pytest.param({"roughness": 1.0, "azimuthal_roughness": 0.1, "ior": 1.3}, marks=pytest.mark.long),
    ],
)
def test_hair_loses_no_light_and_is_sampled_by_its_density(device: Device, keys: dict[str, Any]) -> None:
    table = ", ".join(f"{key} = {value}" for key, value in keys.items())
    subject = subjects_of(f'{{type = "hair", reflectance = [1.0, 1.0, 1.0]{", " if table else ""}{table}}}')
    (found,) = measure(subject, device, side=16)
    assert [each.sentence for each in findings(found, 3) if each.fault] == []
    assert found.transmits and not found.only_deltas
    for energy in found.energies:
        np.testing.assert_allclose(energy.sampled, 1.0, atol=1e-3)


@pytest.mark.long
@pytest.mark.parametrize(
    "settings",
    [
        {"guiding": "on"},
        {"sampling": "bsdf"},
        {"sampling": "light"},
        {"integrator": "reuse"},
        {"integrator": "bdpt"},
        {"kernels": "staged"},
        {"specular_chains": "on"},
        {"indirect_rays": 2, "shadow_rays": 2},
    ],
    ids=lambda given: "-".join(map(str, given.values())),
)
def test_strategies_see_the_same_hair(evidence: Evidence, studio: Studio, settings: dict[str, Any]) -> None:
    hair = {"type": "hair", "reflectance": [0.8, 0.5, 0.2], "roughness": 0.5, "azimuthal_roughness": 0.6}
    scene = with_strands(hair, [SKY, SUN])
    first = studio.tiles(scene, range(10), size=16, tiles=2, spp=128)
    second = studio.tiles(scene, range(50, 60), size=16, tiles=2, spp=128, **settings)
    evidence.equal("radiance", first, second)


def bows(radius: float, lift: float = 0.6) -> np.ndarray[Any, np.dtype[np.float64]]:
    """Bent strands beside each other above the ground, (6, 6, 4)."""
    rows, t = np.zeros((6, 6, 4)), np.linspace(0.0, 1.0, 6)
    for number in range(6):
        rows[number, :, 0] = (number - 2.5) * 0.4 + 0.1 * np.sin(3.0 * t)
        rows[number, :, 1] = -0.2 + lift * np.sin(np.pi * t)
        rows[number, :, 2], rows[number, :, 3] = 2.0 * (t - 0.5), radius
    return rows


LAMP = {"type": "point", "position": [1.5, 1.5, 1.0], "intensity": [6.0, 6.0, 6.0]}
FROM_ABOVE = {"position": [0.0, 2.5, 0.01], "target": [0.0, -0.5, 0.0]}


@pytest.mark.long
@pytest.mark.parametrize("radius", [0.06, 0.02])
def test_photons_leave_hair_as_light_does(evidence: Evidence, studio: Studio, radius: float) -> None:
    """On the ground, which is where they are gathered; its own light from the lamp has less noise."""
    white = {"type": "hair", "reflectance": [1.0, 1.0, 1.0], "roughness": 0.4}
    content = with_strands(white, [LAMP]).model_dump(exclude_unset=True)
    content |= {"camera": FROM_ABOVE, "shapes": [content["shapes"][0], content["shapes"][2]]}
    scene = clrender.Scene(**content).with_arrays(curves={"hair": bows(radius)})
    ways: tuple[dict[str, Any], ...] = (
        {"spp": 160},
        {"spp": 20, "integrator": "photon", "photons": 40000, "photon_radius": 0.03},
    )
    # What has come by hair to the ground, and by the ground to hair
    first, second = (
        np.array(
            [
                [studio.image(scene, 32, seed=seed, max_depth=depth, **way).mean() for depth in (2, 1)]
                for seed in range(24)
            ]
        )
        for way in ways
    )
    evidence.equal("radiance", first[:, 0] - first[:, 1], second[:, 0] - second[:, 1], rounding=0.01)


@pytest.mark.long
@pytest.mark.parametrize(
    "material",
    [
        {"type": "principled", "base_color": [0.9, 0.9, 0.9], "diffuse_transmission": 0.7, "roughness": 0.6},
        {"type": "hair", "reflectance": [0.8, 0.5, 0.2], "roughness": 0.5, "azimuthal_roughness": 0.6},
    ],
    ids=lambda given: given["type"],
)
def test_light_that_passes_curves_is_found_from_both_ends(
    evidence: Evidence, studio: Studio, material: dict[str, Any]
) -> None:
    """Where it leaves a curve, no light path has met it; by those that scatter there, 4 to 9 % too much is found."""
    behind = {"type": "point", "position": [0.3, 0.8, -1.2], "intensity": [6.0, 6.0, 6.0]}
    content = with_strands(material, [behind]).model_dump(exclude_unset=True)
    content["shapes"] = [content["shapes"][0], content["shapes"][2]]
    scene = clrender.Scene(**content).with_arrays(curves={"hair": bows(0.1)})
    first, second = (
        studio.tiles(scene, range(n, n + 10), size=32, tiles=2, spp=64, integrator=integrator)
        for n, integrator in ((0, "path"), (50, "bdpt"))
    )
    evidence.equal("radiance", first, second)


def thicket(count: int = 12000) -> np.ndarray[Any, np.dtype[np.float64]]:
    """Strands that stand in a block, so many that no light passes between them, (count, 6, 4)."""
    dice, rows = np.random.RandomState(1), np.full((count, 6, 4), 0.012)
    x, z = dice.uniform(-1.5, 1.5, count), dice.uniform(-1.2, 0.0, count)
    for number, y in enumerate(np.linspace(-1.5, 1.5, 6)):
        rows[:, number, :3] = np.stack([x, np.full(count, y), z], axis=1)
        x, z = x + dice.normal(size=count) * 0.03, z + dice.normal(size=count) * 0.03
    return rows


@pytest.mark.long
@pytest.mark.parametrize("roughness", [0.1, 0.3, 0.6])
def test_the_colour_of_many_strands(studio: Studio, roughness: float) -> None:
    """A thicket below a white sky has the reflectance that it is given, as far as the published fit goes.

    The absorption is that of Chiang et al. 2016, a polynomial in the azimuthal roughness that they fitted to images.
    """
    wanted = np.array([0.15, 0.4, 0.7])
    material = {"type": "hair", "reflectance": wanted.tolist(), "azimuthal_roughness": roughness}
    camera = {"type": "orthographic", "position": [0.0, 0.0, 6.0], "target": [0.0, 0.0, 0.0], "height": 0.8}
    shapes = [{"type": "curves", "file": "hair", "material": "hair"}]
    scene = clrender.Scene(camera=camera, shapes=shapes, lights=[SKY], materials={"hair": material})
    seen = studio.image(scene.with_arrays(curves={"hair": thicket()}), 32, spp=64).mean(axis=(0, 1))
    assert (wanted < seen).all() and (seen < wanted + 0.09).all()


@pytest.mark.long
@pytest.mark.parametrize(
    ("material", "integrator"),
    [("hair", "path"), ("clay", "path"), ("fibre and holes", "path"), ("hair", "bdpt"), ("hair", "photon")],
)
def test_strands_have_the_same_bits_however_they_are_rendered(device: Device, material: str, integrator: str) -> None:
    kinds: dict[str, dict[str, Any]] = {
        "hair": {"type": "hair"},
        "clay": CLAY,
        "fibre and holes": {"type": "hair", "reflectance": [0.8, 0.5, 0.2], "opacity": 0.5},
    }
    scene = with_strands(kinds[material], [SKY, SUN])
    assert len(hashes_by_lanes_and_cuts(device, scene, integrator=integrator)) == 1


@pytest.mark.long
def test_instances_of_strands_are_strands(evidence: Evidence, studio: Studio) -> None:
    """A group that is placed, turned and scaled, against the same strands written out; and one that moves."""
    hair = {"type": "hair", "reflectance": [0.8, 0.5, 0.2]}
    plain = with_strands(hair, [SKY, SUN])
    content = plain.model_dump(exclude_unset=True)
    half = {"scale": 0.5, "rotate_degrees": [0.0, 40.0, 0.0], "translate": [0.3, 0.0, 0.2]}
    strands, *others = content["shapes"]
    grouped = {**content, "groups": {"tuft": {"shapes": [strands]}}}
    placed = [{"type": "instance", "group": "tuft", "transform": each} for each in (half, {})]
    grouped["shapes"] = [*placed, *others]
    written = {**content, "shapes": [{**strands, "transform": half}, strands, *others]}
    first, second = (
        studio.tiles(clrender.Scene(**each).with_arrays(curves={"hair": tuft()}), range(n, n + 8), spp=64)
        for each, n in ((grouped, 0), (written, 20))
    )
    evidence.equal("radiance", first, second)
    keys = [{"time": 0.0, **half}, {"time": 1.0, **half}]
    moving = {**content, "camera": {**CAMERA, "shutter": [0.0, 1.0]}}
    moving["shapes"] = [{**strands, "motion": [*keys[:1], {**keys[1], "translate": [0.31, 0.0, 0.2]}]}, *others]
    still = {**content, "shapes": [{**strands, "transform": half}, *others]}
    first, second = (
        studio.tiles(clrender.Scene(**each).with_arrays(curves={"hair": tuft()}), range(n, n + 8), spp=64, tiles=2)
        for each, n in ((moving, 40), (still, 60))
    )
    evidence.equal("in motion", first, second, rounding=2e-2)


@pytest.mark.long
@pytest.mark.parametrize("kind", ["lambert", "hair"])
def test_textures_run_along_strands(studio: Studio, kind: str) -> None:
    """From the root, u = 0, to the tip, 1; a strand of two cut halves included."""
    bent = [[-0.4, -1.0, 0.0], [-0.4, 0.0, 0.4], [-0.4, 0.0, -0.4], [-0.4, 1.0, 0.0]]
    straight = [[x, y, 0.0] for x in (0.0,) for y in (-1.0, -1.0 / 3.0, 1.0 / 3.0, 1.0)]
    rows = np.concatenate([np.array([bent, straight]), np.full((2, 4, 1), 0.12)], axis=2)
    material = {"type": kind, "reflectance": {"ramp": [[0.05, 0.05, 0.05], [0.85, 0.85, 0.85]]}}
    camera = {"type": "orthographic", "position": [0.0, 0.0, 5.0], "target": [0.0, 0.0, 0.0], "height": 2.0}
    shapes = [{"type": "curves", "file": "hair", "material": "hair", "basis": "bezier"}]
    scene = clrender.Scene(camera=camera, shapes=shapes, lights=[SKY], materials={"hair": material})
    albedo = studio.layer(scene.with_arrays(curves={"hair": rows}), 32, "albedo")[:, :, 0]
    middle = albedo[2:30, 16]
    if kind == "lambert":
        heights = (np.arange(32)[2:30] + 0.5) / 32.0
        np.testing.assert_allclose(middle, 0.85 - 0.8 * heights, atol=0.03)
    assert (np.diff(middle) < 0.02).all() and middle[0] > 1.2 * middle[-1]
    at = albedo[2:30, 9]
    assert (np.diff(at[at > 0.0]) < 0.05).all(), "and does not jump where a curve is cut"


def blade(material: dict[str, Any], place: str, length: float = 1.0) -> Scene:
    """One straight strand that leans to the left, as a shape of its own or in an instance that turns it."""
    half = 0.5 * length
    points = [[0.0, n * 0.5 * half, 0.0] for n in range(-2, 3)]
    strand: dict[str, Any] = {"type": "curves", "points": points, "basis": "linear"}
    strand |= {"radius": 0.1 * length, "material": "blade"}
    turned = {"rotate_degrees": [0.0, 0.0, 90.0]}
    shapes: dict[str, list[dict[str, Any]]] = {
        "upright": [strand],
        "turned": [{**strand, "transform": turned}],
        "in an instance": [
            {"type": "instance", "group": "blade", "transform": each}
            for each in (turned, {**turned, "translate": [0.0, 0.0, -50.0]})
        ],
    }
    groups = {"blade": {"shapes": [strand]}} if place == "in an instance" else {}
    camera = {"type": "orthographic", "position": [0.0, 0.0, 5.0], "target": [0.0, 0.0, 0.0], "height": 1.5 * length}
    return clrender.Scene(
        camera=camera, shapes=shapes[place], groups=groups, lights=[SKY], materials={"blade": material}
    )


@pytest.mark.long
def test_textures_along_strands_of_instances(studio: Studio) -> None:
    """The coordinates of a strand were turned by the instance, as if they had been the axes of a sphere."""
    ramp = {"type": "lambert", "reflectance": {"ramp": [[0.05, 0.05, 0.05], [0.85, 0.85, 0.85]]}}
    own, placed = (studio.layer(blade(ramp, place), 24, "albedo") for place in ("turned", "in an instance"))
    assert own[12].max() > 0.7
    np.testing.assert_allclose(placed, own, atol=1e-3)


@pytest.mark.long
def test_layers_of_strands(studio: Studio) -> None:
    """Coordinates and tangents of a strand in layers were those of a disk."""
    scene = blade(CLAY, "upright")
    uv, tangent = (studio.layer(scene, 24, name) for name in ("uv", "tangent"))
    heights = 1.25 - (np.arange(5, 19) + 0.5) / 16.0
    np.testing.assert_allclose(uv[5:19, 12, 0], heights, atol=0.02)
    np.testing.assert_allclose(uv[5:19, 12, 1], 0.5, atol=1e-6)
    np.testing.assert_allclose(tangent[5:19, 12], [[0.0, 1.0, 0.0]] * 14, atol=1e-5)


@pytest.mark.long
@pytest.mark.parametrize("length", [0.1, 1.0])
def test_bumps_on_strands_are_in_metres(studio: Studio, length: float) -> None:
    """A height that grows by a tenth of the length along it has a slope of a tenth, however long the strand is."""
    material = {**CLAY, "bump_map": {"texture": "ramp", "scale": 0.1 * length}}
    ramp = np.linspace(0.0, 1.0, 64, dtype=np.float32)[None, :, None].repeat(2, 0).repeat(3, 2)
    scene = blade(material, "upright", length).with_arrays(textures={"ramp": ramp})
    normal = studio.layer(scene, 24, "normal")[12, 12]
    assert abs(normal[1] + 0.1 / np.sqrt(1.01)) < 0.01


@pytest.mark.parametrize("change", ["another course", "one sphere more"])
def test_trees_of_strands_are_kept_only_for_the_same(device: Device, change: str) -> None:
    """In a session the BVH of a group was taken for that of other curves, and of the same with other numbers."""

    def scene(turned: bool, spheres: int) -> Scene:
        side = -0.6 if turned else 0.6
        strand = {"type": "curves", "points": [[-0.8, -side, 0.0], [0.8, side, 0.0]], "basis": "linear"}
        balls = [{"type": "sphere", "center": [0.0, 0.0, -3.0 - n], "radius": 0.1} for n in range(spheres)]
        return clrender.Scene(
            camera={"position": [0.0, 0.0, 4.0], "target": [0.0, 0.0, 0.0], "vertical_fov": 30.0},
            groups={"strand": {"shapes": [{**strand, "radius": 0.1}]}},
            shapes=[*balls, {"type": "instance", "group": "strand", "transform": {"translate": [0.01, 0.0, 0.0]}}],
            lights=[SKY],
        )

    second = scene(change == "another course", 2 if change == "one sphere more" else 1)
    with clrender.Session(device) as session:
        session.render(scene(False, 1), size=(16, 16), spp=1)
        image = session.render(second, size=(16, 16), spp=1)
    with clrender.Session(device) as session:
        np.testing.assert_array_equal(session.render(second, size=(16, 16), spp=1).linear, image.linear)


@pytest.mark.parametrize("integrator", ["path", pytest.param("bdpt", marks=pytest.mark.long)])
def test_ribbons_are_lit_like_the_quads_that_they_are(evidence: Evidence, studio: Studio, integrator: str) -> None:
    """A straight one, also in a group that is placed, against two quads."""
    blade = {"type": "curves", "profile": "ribbon", "basis": "linear", "radius": 0.25, "material": "clay"}
    blade |= {"points": [[0.0, -0.4, 0.0], [0.0, 0.2, 0.0], [0.0, 0.8, 0.0]], "normals": [[0.3, 0.0, 1.0]]}
    side = np.array([1.0, 0.0, -0.3]) / np.hypot(1.0, 0.3)
    corner = np.array([0.0, -0.4, 0.0]) - 0.25 * side
    flat = {"type": "quad", "origin": corner.tolist(), "edge_u": (0.5 * side).tolist(), "edge_v": [0.0, 1.2, 0.0]}
    placed = {"translate": [-0.9, 0.1, -0.3], "rotate_degrees": [0.0, 50.0, 20.0], "scale": 0.8}
    common: dict[str, Any] = {"camera": CAMERA, "lights": [SKY, SUN], "materials": {"clay": CLAY}}
    floor = {**GROUND, "material": "clay"}
    instance = {"type": "instance", "group": "blade", "transform": placed}
    first = clrender.Scene(**common, shapes=[blade, instance, floor], groups={"blade": {"shapes": [blade]}})
    quad = {**flat, "material": "clay"}
    second = clrender.Scene(**common, shapes=[quad, {**quad, "transform": placed}, floor])
    settings: dict[str, Any] = {"size": 32, "spp": 32, "integrator": integrator}
    evidence.equal(
        "radiance", studio.tiles(first, range(8), **settings), studio.tiles(second, range(40, 48), **settings)
    )
