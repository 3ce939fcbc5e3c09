"""Labels and amodal masks: every sample counted, exact areas of polygons, and the same whatever is in the way."""

from __future__ import annotations

import json
import math
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np
import numpy.typing as npt
import pytest

import clrender
from clrender.aov.label_numbers import majority
from clrender.aov.labels import Labelling
from clrender.errors import SceneError, UsageError
from clrender.image.files import read_provenance
from clrender.scene import Scene

if TYPE_CHECKING:
    from clrender.device import Device

WIDTH, HEIGHT = 8, 4
GREY = {"type": "lambert", "reflectance": [0.5, 0.5, 0.5]}
ALL = ("instance", "category", "part")


def scene(*shapes: dict[str, Any], **more: Any) -> Scene:
    """Pixels of an image of 8 x 4 are squares of one metre; the middle of the image is x = 0."""
    camera = {"type": "orthographic", "position": [0, 0, 9], "target": [0, 0, 0], "height": 4.0}
    given = {"camera": camera, "materials": {"grey": GREY}, "shapes": list(shapes), **more}
    return Scene(**given)


def strip(left: float, right: float, **more: Any) -> dict[str, Any]:
    """From top to bottom of the view."""
    edges = {"origin": [left, -9.0, 0.0], "edge_u": [right - left, 0.0, 0.0], "edge_v": [0.0, 18.0, 0.0]}
    return {"type": "quad", "material": "grey", **edges, **more}


def rendered(device: Device, what: Scene, **settings: Any) -> clrender.RenderedImage:
    given = {"size": (WIDTH, HEIGHT), "spp": 64, "aov": ALL, **settings}
    return clrender.render(what, device=device, **given)


def pixel(image: clrender.RenderedImage, layer: str, x: int, y: int = 1) -> tuple[float, float]:
    number, share = image.aovs[layer][y, x].tolist()
    return number, share


def test_what_covers_most_of_a_pixel(device: Device) -> None:
    """The 64 samples of a pixel stand one in each 64th of its width."""
    shapes = [
        strip(-4.0, -3.5, name="half"),
        strip(-3.0, -2.0 - 31 / 64, name="more"),
        strip(-2.0, -1.0 - 33 / 64, name="less"),
        strip(0.25, 1.0, category="b"),
        strip(0.0, 0.25, category="a"),
        strip(1.0, 1.5, category="b"),
        strip(1.5, 2.0, category="b"),
    ]
    image = rendered(device, scene(*shapes))
    assert pixel(image, "instance", 0) == (0, 0.5), "of equal shares the smaller number, which is nothing"
    assert pixel(image, "instance", 1) == (2, 33 / 64)
    assert pixel(image, "instance", 2) == (0, 33 / 64)
    assert pixel(image, "instance", 4) == (4, 0.75) and pixel(image, "category", 4) == (2, 0.75)
    assert pixel(image, "instance", 5) == (6, 0.5), "the smaller of two"
    assert pixel(image, "category", 5) == (2, 1.0), "both are b"
    assert pixel(image, "category", 1) == (0, 1.0) and pixel(image, "part", 1) == (2, 33 / 64)
    told = {label.name: (label.number, label.category, label.area) for label in image.labels["instance"]}
    assert told == {
        "half": (1, None, 4 * 0.5),
        "more": (2, None, 4 * 33 / 64),
        "less": (3, None, 4 * 31 / 64),
        "quad_3": (4, "b", 3.0),
        "quad_4": (5, "a", 1.0),
        "quad_5": (6, "b", 2.0),
        "quad_6": (7, "b", 2.0),
    }
    assert [(each.number, each.name, each.area) for each in image.labels["category"]] == [(1, "a", 1.0), (2, "b", 7.0)]
    np.testing.assert_array_equal(image.mask("instance"), image.aovs["instance"][..., 0])


CAMERAS: dict[str, dict[str, Any]] = {
    "perspective": {"position": [0.3, 0.4, 3.0], "target": [0, 0, 0], "vertical_fov": 50.0},
    "lens": {
        "position": [0.3, 0.4, 3.0],
        "target": [0, 0, 0],
        "vertical_fov": 50.0,
        "aperture_radius": 0.2,
        "focus_distance": 2.0,
    },
    "panoramic": {"type": "panoramic", "position": [0.1, 0.0, 0.1], "target": [0, 0, 0]},
    "intrinsics": {
        "type": "intrinsics",
        "position": [0.3, 0.4, 3.0],
        "target": [0, 0, 0],
        "fx": 24.0,
        "fy": 26.0,
        "cx": 11.0,
        "resolution": [24, 20],
        "skew": 1.0,
        "distortion": {"model": "brown-conrady", "k": [-0.2, 0.05], "p": [0.01, -0.01]},
    },
}


def glowing() -> list[dict[str, Any]]:
    """Many shapes before each other, each of a radiance of its own: samples of the image tell what they hit."""
    random = np.random.default_rng(4)
    shapes: list[dict[str, Any]] = []
    for number in range(1, 25):
        emission = [float(number % 3 + 1), float(number // 3 % 3 + 1), float(number // 9 + 1)]
        center = random.uniform(-1.2, 1.2, 3)
        center *= max(1.0, 1.2 / np.abs(center).max())  # not around a camera in the middle: insides do not shine
        if number % 3:
            shape = {"type": "tetrahedron", "vertices": (center + random.uniform(-0.5, 0.5, (4, 3))).tolist()}
        else:
            shape = {"type": "sphere", "center": center.tolist(), "radius": float(random.uniform(0.05, 0.3))}
        shapes.append({**shape, "emission": emission, "category": "odd" if number % 2 else "even"})
    return shapes


@pytest.mark.parametrize("camera", CAMERAS)
@pytest.mark.parametrize("more", [{}, {"crop": (5, 3, 11, 9), "filter": "gaussian"}], ids=["whole", "crop"])
def test_every_sample_is_counted(device: Device, camera: str, more: dict[str, Any]) -> None:
    """A render of one sample shows the radiance of what it hits."""
    shapes = glowing()
    what = Scene(camera=CAMERAS[camera], shapes=shapes)
    codes = np.array([[0, 0, 0], *(shape["emission"] for shape in shapes)]) @ (1, 10, 100)
    order = np.argsort(codes)
    odd = {"even": 1, "odd": 2}
    category = np.array([0, *(odd[shape["category"]] for shape in shapes)])
    samples = []
    with clrender.Session(device) as session:
        common = {"size": (24, 20), "spp": 12, "max_depth": 0, **more}
        image = session.render(what, aov=ALL, **common)
        for k in range(12):
            seen = session.render(what, samples=(k, k + 1), **common).linear.astype(np.float64)
            code = np.rint(seen @ (1, 10, 100)).astype(int)
            assert np.isin(code, codes).all()
            samples.append(order[np.searchsorted(codes, code, sorter=order)])
    for layer, number_of in (("instance", np.arange(25)), ("category", category)):
        told = [number_of[each] for each in samples]
        counts = np.stack([np.sum([each == n for each in told], axis=0) for n in range(26)])
        best = counts.argmax(axis=0)  # the first of the largest
        np.testing.assert_array_equal(image.aovs[layer][..., 0], best)
        share = (counts.max(axis=0) / 12).astype(np.float32)
        np.testing.assert_array_equal(image.aovs[layer][..., 1], share)
        areas = {each.number: each.area for each in image.labels[layer]}
        for number in range(1, 25):
            assert areas.get(number, 0.0) == counts[number].sum() / 12
    assert len(np.unique(image.aovs["instance"][..., 0])) >= 3
    np.testing.assert_array_equal(image.aovs["part"], image.aovs["instance"])


@pytest.mark.parametrize("camera", ["perspective", "intrinsics"])
def test_areas_are_those_of_polygons(device: Device, camera: str) -> None:
    """Each pixel that an edge passes has a variance of at most 1/4 a sample; five standard deviations are allowed."""
    triangle = np.array([[-0.9, -0.7, 0.2], [0.8, -0.4, -0.5], [-0.1, 0.9, 0.4]])
    given = {key: value for key, value in CAMERAS[camera].items() if key != "distortion"}
    what = Scene(camera=given, materials={"grey": GREY}, shapes=[
        {"type": "triangle", "vertices": triangle.tolist(), "material": "grey", "flip_normals": True},
    ])  # fmt: skip
    size, spp = (120, 100), 64
    image = rendered(device, what, size=size, spp=spp)
    (x0, y0), (x1, y1), (x2, y2) = what.camera.project(triangle, size)
    exact = abs((x1 - x0) * (y2 - y0) - (x2 - x0) * (y1 - y0)) / 2.0
    edges = float(((image.aovs["instance"][..., 1] > 0.0) & (image.aovs["instance"][..., 1] < 1.0)).sum())
    bound = 5.0 * math.sqrt(edges / (4.0 * spp))
    (label,) = image.labels["instance"]
    assert exact > 1000.0 and abs(label.area - exact) < bound < 0.01 * exact


def test_instances_of_groups(device: Device) -> None:
    """A group with a lamp in it, which is written out; placed once, thrice, and from a file's array."""
    group = {"shapes": [
        strip(0.0, 0.625, name="leg", category="leg"),
        strip(0.625, 0.75, emission=[1, 1, 1]),
            strip(0.75, 0.8125, emission=[2, 2, 2]),
    ]}  # fmt: skip
    for lamp in group["shapes"][1:]:
        del lamp["material"]

    def at(x: float) -> list[list[float]]:
        return [[1, 0, 0, x], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]

    shapes: list[dict[str, Any]] = [
        {
            "type": "instance",
            "group": "chair",
            "name": "chairs",
            "transforms": [at(-4), at(-3), at(-1)],
            "category": "chair",
        },
        {"type": "instance", "group": "chair", "transform": {"translate": [1, 0, 0]}},
        strip(2.0, 2.75, name="chairs"),
        strip(3.0, 3.75, name="chairs"),
    ]
    what = scene(*shapes, groups={"chair": group})
    image = rendered(device, what, amodal="all")
    assert image.mask("instance")[1].tolist() == [1, 2, 0, 3, 0, 4, 5, 5]
    assert image.mask("category")[1].tolist() == [1, 1, 0, 1, 0, 2, 0, 0], "the instance's, else that of the shape"
    assert image.mask("part")[1].tolist() == [3, 3, 0, 3, 0, 3, 1, 2]
    assert [image.aovs[layer][1, 0, 1] for layer in ALL] == [0.8125, 0.8125, 0.625]
    told = {label.number: (label.name, label.category, label.area) for label in image.labels["instance"]}
    assert all(label.whole_area == label.area for label in image.labels["instance"])
    assert told == {
        1: ("chairs[0]", "chair", 3.25),
        2: ("chairs[1]", "chair", 3.25),
        3: ("chairs[2]", "chair", 3.25),
        4: ("instance_1", None, 3.25),
        5: ("chairs", None, 6.0),
    }
    parts = {label.number: (label.name, label.area) for label in image.labels["part"]}
    assert parts == {
        1: ("chairs", 3.0),
        2: ("chairs", 3.0),
        3: ("chair/leg", 10.0),
        4: ("chair/quad_1", 2.0),
        5: ("chair/quad_2", 1.0),
    }
    assert Labelling.of(what).numbered(["chairs"]) == [1, 2, 3, 5]
    assert Labelling.of(what).numbered(["chairs[1]", "instance_1"]) == [2, 4]


def test_small_groups_are_written_out(device: Device, monkeypatch: pytest.MonkeyPatch) -> None:
    """Which changes neither numbers nor, but for roundings of edges, the pixels."""
    random = np.random.default_rng(2)
    places = []
    for x, y in random.uniform(-3.0, 3.0, (7, 2)).tolist():
        places.append([[0.4, 0, 0, x], [0, 0.4, 0, y], [0, 0, 0.4, x * y], [0, 0, 0, 1]])
    groups = {
        f"g{n}": {"shapes": [{"type": "box", "size": [1, 1, 1], "material": "grey", "category": f"c{n}"}]}
        for n in (0, 1)
    }
    shapes = [{"type": "instance", "group": f"g{n}", "transforms": places[3 * n : 3 * n + 4]} for n in (0, 1)]
    images = []
    for many in (64, 0):
        monkeypatch.setattr("clrender.flatten.placed_shapes._MANY", many)
        images.append(rendered(device, scene(*shapes, groups=groups), size=(48, 40), spp=16))
    for layer in ALL:
        assert np.mean(images[0].aovs[layer] == images[1].aovs[layer]) > 0.998
        pairs = zip(images[0].labels[layer], images[1].labels[layer], strict=True)
        assert all((a.number, a.name, a.category) == (b.number, b.name, b.category) for a, b in pairs)
    assert {each.name for each in images[0].labels["instance"]} <= {
        f"instance_{n}[{k}]" for n in (0, 1) for k in range(4)
    }


def test_holes_and_glass(device: Device) -> None:
    """Through the holes of a texture things are seen; glass is what is seen first."""
    holes = {"type": "lambert", "reflectance": [0.5] * 3, "opacity": {"checker": [0.0, 1.0], "size": 0.5}}
    glass = {"type": "dielectric", "ior": 1.5}
    board = {"type": "quad", "origin": [-4.0, -2.0, 1.0], "edge_u": [4.0, 0, 0], "edge_v": [0, 4.0, 0], "name": "board"}
    shapes = [
        strip(-9.0, 9.0, name="wall"),
        {**board, "material": "holes"},
        {"type": "box", "center": [2, 0, 2], "size": [2.0, 2.0, 0.5], "material": "glass", "name": "pane"},
    ]
    image = rendered(device, scene(*shapes, materials={"grey": GREY, "holes": holes, "glass": glass}), amodal="all")
    told = {label.name: label for label in image.labels["instance"]}
    assert told["board"].area == 8.0, "half of 4 by 4 squares"
    assert told["wall"].area == 32.0 - 8.0 - 4.0
    assert told["pane"].area == 4.0 and (image.mask("instance")[1:3, 5:7] == 3).all()
    assert (told["wall"].whole_area, told["board"].whole_area, told["pane"].whole_area) == (32.0, 8.0, 4.0)
    assert told["wall"].hidden == 12.0 / 32.0 and told["pane"].hidden == 0.0


def occluded() -> Scene:
    """A ball behind a strip, one before it, and one that is hidden altogether."""
    ball = {"type": "sphere", "material": "grey"}
    cube = {"shapes": [{"type": "box", "size": [0.5, 0.5, 0.5], "material": "grey"}]}
    return Scene(
        camera={"position": [0.2, 0.3, 6.0], "target": [0, 0, 0], "vertical_fov": 40.0},
        materials={"grey": GREY},
        groups={"cube": cube},
        shapes=[
            strip(-0.4, 0.3, name="wall"),
            {**ball, "center": [0.3, 0.0, -1.0], "radius": 0.8, "name": "behind", "category": "ball"},
            {**ball, "center": [-0.2, 0.8, 1.0], "radius": 0.3, "name": "before", "category": "ball"},
            {**ball, "center": [-0.05, -0.3, -0.5], "radius": 0.1, "name": "hidden", "category": "ball"},
            {
                "type": "instance",
                "group": "cube",
                "name": "cubes",
                "transforms": [
                    [[1, 0, 0, 1.2], [0, 1, 0, 0.2], [0, 0, 1, 0.5], [0, 0, 0, 1]],
                    [[1, 0, 0, 1.4], [0, 1, 0, -0.9], [0, 0, 1, -3.0], [0, 0, 0, 1]],
                ],
            },
        ],
    )


def test_amodal_masks(device: Device) -> None:
    what, size = occluded(), (60, 50)
    with clrender.Session(device) as session:
        image = session.render(what, size=size, spp=32, amodal="all")
        plain = session.render(what, size=size, spp=32, aov=("instance",))
        one = session.render(what, size=size, spp=32, amodal=["before", "cubes[1]"])
        only = {}
        for index, name in ((1, "behind"), (2, "before"), (3, "hidden")):
            alone = what.changed({("shapes", at): None for at in range(5) if at != index})
            only[name] = session.render(alone, size=size, spp=32, aov=("instance",)).labels["instance"][0].area
    np.testing.assert_array_equal(image.linear, plain.linear)
    np.testing.assert_array_equal(image.aovs["instance"], plain.aovs["instance"])
    told = {label.name: label for label in image.labels["instance"]}
    assert list(told) == ["wall", "behind", "before", "hidden", "cubes[0]", "cubes[1]"]
    assert all(told[name].whole_area == area for name, area in only.items())
    assert told["before"].hidden == 0.0 and told["hidden"].hidden == 1.0 and told["hidden"].area == 0.0
    assert 0.2 < (told["behind"].hidden or 0.0) < 0.9 and 0.0 < (told["cubes[1]"].hidden or 0.0) < 1.0
    for number, mask in image.amodal.items():
        own = image.aovs["instance"]
        seen = np.where(own[..., 0] == number, own[..., 1], 0.0)
        assert (mask >= seen).all() and mask.max() == 1.0, "what is seen is part of the whole"
        assert mask.sum(dtype=np.float64) == pytest.approx(image.labels["instance"][number - 1].whole_area)
    assert list(one.amodal) == [3, 6]
    np.testing.assert_array_equal(one.amodal[6], image.amodal[6])
    assert json.loads(json.dumps(image.stats["labels"]))["instance"][3] == told["hidden"].told()


def test_the_same_bits_however_the_work_is_cut(device: Device, monkeypatch: pytest.MonkeyPatch) -> None:
    what = occluded()
    expected = rendered(device, what, size=(40, 50), spp=6, amodal="all")
    monkeypatch.setattr(sys.modules["clrender.aov.first_hits"], "_SAMPLES_BYTES", 1)  # one row of tiles at a time
    found = rendered(device, what, size=(40, 50), spp=6, amodal="all", lanes=4, tile=8, samples_per_pass=1)
    assert all(found.aovs[layer].tobytes() == expected.aovs[layer].tobytes() for layer in ALL)
    assert {n: mask.tobytes() for n, mask in found.amodal.items()} == {
        n: mask.tobytes() for n, mask in expected.amodal.items()
    }
    assert found.labels == expected.labels


def test_files(device: Device, tmp_path: Path) -> None:
    import OpenEXR

    image = rendered(device, occluded(), size=(40, 32), spp=8, amodal="hidden,behind")
    image.save(tmp_path / "a.exr")
    with OpenEXR.File(str(tmp_path / "a.exr"), separate_channels=True) as file:
        held = {name: np.array(channel.pixels) for name, channel in file.channels().items()}
    for layer in ALL:
        for at, letter in enumerate("VA"):
            assert held[f"{layer}.{letter}"].tobytes() == image.aovs[layer][..., at].tobytes()
    assert held["amodal.2.V"].tobytes() == image.amodal[2].tobytes()
    assert clrender.verify(tmp_path / "a.exr", 1.0, scene=occluded(), device=device).sound
    said = read_provenance(tmp_path / "a.exr")
    assert said is not None and said["labels"]["instance"][1]["name"] == "behind"
    assert said["labels"]["category"][0]["name"] == "ball"
    for layer in ALL:
        image.save_mask(tmp_path / "m.png", layer)
        image.save_mask(tmp_path / "m.npy", layer)
        there = cv2.imread(str(tmp_path / "m.png"), cv2.IMREAD_UNCHANGED)
        assert there is not None and there.dtype == np.uint16
        np.testing.assert_array_equal(there, image.mask(layer))
        np.testing.assert_array_equal(np.load(tmp_path / "m.npy"), image.mask(layer))
    with pytest.raises(UsageError, match=r"m\.tif.*\.png and \.npy"):
        image.save_mask(tmp_path / "m.tif", "part")
    with pytest.raises(UsageError, match="instance, category, part"):
        image.mask("object")
    with pytest.raises(UsageError, match=r"pxr24.*instance.*zip"):
        image.save(tmp_path / "a.exr", exr_compression="pxr24")
    assert "a colour for each number" in image._repr_html_()


def test_what_is_refused(device: Device) -> None:
    with pytest.raises(SceneError, match='no instance "behnd"; did you mean "behind"'):
        clrender.render(occluded(), device=device, amodal="behnd")


def test_names_and_categories_change_no_hash() -> None:
    plain = scene(strip(0.0, 1.0))
    assert scene(strip(0.0, 1.0, name="a", category="b")).sha256() == plain.sha256()
    group = {"shapes": [strip(0.0, 1.0)]}
    instance = {"type": "instance", "group": "g"}
    one = scene(instance, groups={"g": group})
    named = {"shapes": [strip(0.0, 1.0, category="x")]}
    assert scene({**instance, "category": "b"}, groups={"g": named}).sha256() == one.sha256()


def test_majority() -> None:
    numbers = np.array([[3, 3, 1, 1], [0, 0, 5, 5], [7, 7, 0, 0], [0, 0, 0, 0], [2, 0, 0, 0]], np.uint32)
    taken = np.array([4, 4, 2, 0, 3], np.uint32)
    found: npt.NDArray[np.float32] = majority(numbers, taken)
    assert found[0].tolist() == [1, 0, 7, 0, 0]
    assert found[1].tolist() == [0.5, 0.5, 1.0, 0.0, np.float32(2 / 3)]


def test_what_moves(device: Device) -> None:
    """A group with a lamp in it, placed twice, moves by a pixel while the shutter is open; so does a plain shape."""
    group = {"shapes": [strip(0.0, 0.5, name="leg"), strip(0.5, 1.0, emission=[1, 1, 1])]}
    del group["shapes"][1]["material"]
    motion = [{"time": 0.0, "translate": [0, 0, 0]}, {"time": 1.0, "translate": [1, 0, 0]}]
    places = [[[1, 0, 0, x], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]] for x in (-4.0, -1.0)]
    shapes: list[dict[str, Any]] = [
        {"type": "instance", "group": "g", "name": "chair", "category": "c", "transforms": places, "motion": motion},
        strip(2.0, 3.0, name="plank", motion=motion),
    ]
    what = scene(*shapes, groups={"g": group}).changed({"camera.shutter": [0.0, 1.0]})
    image = rendered(device, what, amodal="all")
    labels = image.labels["instance"]
    assert [each.name for each in labels] == ["chair[0]", "chair[1]", "plank"]
    for each, columns in zip(labels, ((0, 1), (3, 4), (6, 7)), strict=True):
        assert each.area == each.whole_area and abs(each.area - 4.0) < 0.25
        assert set(np.unique(image.mask("instance")[:, columns])) <= {0, each.number}
        np.testing.assert_allclose(image.amodal[each.number][:, columns].mean(axis=0), 0.5, atol=0.1)
        assert not np.delete(image.amodal[each.number], columns, axis=1).any()
    parts = {each.name: each.area for each in image.labels["part"]}
    assert parts.keys() == {"g/leg", "g/quad_1", "plank"} and parts["g/leg"] == pytest.approx(4.0, abs=0.3)
    (category,) = image.labels["category"]
    assert category.area == labels[0].area + labels[1].area
