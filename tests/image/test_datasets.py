"""Data sets: what writers write is what is rendered, one manifest however the work is divided, and proofs of it."""

from __future__ import annotations

import hashlib
import json
import shutil
import tarfile
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np
import numpy.typing as npt
import OpenEXR
import pytest
from dataset_support import SCENE, write_dataset

import clrender
from clrender.datasets import DatasetPlan, load_spec, make_dataset, merge_datasets, verify_dataset
from clrender.datasets.files import ImageFiles
from clrender.datasets.making import _finish
from clrender.datasets.records import Records
from clrender.datasets.writers.coco import run_lengths
from clrender.errors import SceneError, UsageError
from clrender.image.exact_display import display_bytes
from clrender.scene.transforms import affine

if TYPE_CHECKING:
    from clrender.device import Device

IMAGES = 6
SCENES = Path(__file__).parents[2] / "scenes" / "plugins"
BOP = "bop/train/000000"


def plan_of(folder: Path, **changes: Any) -> DatasetPlan:
    path = write_dataset(folder, **changes)
    return DatasetPlan.of(load_spec(path), str(path), folder)


@pytest.fixture(scope="module")
def made(device: Device, tmp_path_factory: pytest.TempPathFactory) -> tuple[DatasetPlan, Path]:
    """A whole data set, made in one go."""
    folder = tmp_path_factory.mktemp("datasets")
    plan = plan_of(folder)
    progress = make_dataset(plan, folder / "whole", device=device)
    assert (progress.done, progress.rendered, progress.missing) == (IMAGES, IMAGES, 0)
    return plan, folder / "whole"


def picture(path: Path) -> npt.NDArray[Any]:
    found = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    assert found is not None, path
    return found[..., ::-1] if found.ndim == 3 else found


def channels(path: Path) -> dict[str, npt.NDArray[Any]]:
    with OpenEXR.File(str(path), separate_channels=True) as file:
        return {name: np.array(channel.pixels) for name, channel in file.channels().items()}


def told(folder: Path, name: str) -> Any:
    return json.loads((folder / name).read_text())


# --- writers ---------------------------------------------------------------------------------------------------------


def test_images_are_those_of_a_render(made: tuple[DatasetPlan, Path], device: Device) -> None:
    plan, folder = made
    for index in (0, 3):
        varied = plan.image(index)
        aov = ("z_depth", "instance", "category", "part")
        image = clrender.render(varied.scene, size=(36, 28), spp=4, seed=varied.seed, aov=aov, device=device)
        held, said = channels(folder / f"images/{index:06d}.exr"), told(folder, f"images/{index:06d}.json")
        linear = np.stack([held[name] for name in "RGB"], axis=2)
        assert linear.tobytes() == image.linear.tobytes()
        assert said["linear_sha256"] == image.stats["image_sha256"] and said["drawn"] == varied.drawn
        np.testing.assert_array_equal(picture(folder / f"images/{index:06d}.png"), display_bytes(image.linear))
        assert held["z_depth.Z"].tobytes() == image.aovs["z_depth"][..., 0].tobytes()
        for layer in ("instance", "part"):
            np.testing.assert_array_equal(picture(folder / f"images/{index:06d}.{layer}.png"), image.mask(layer))
        names = {each["number"]: each["name"] for each in said["objects"]}
        assert {"stool"} <= set(names.values()) and "floor" not in names.values(), "only what has a category"


def test_categories_have_the_same_numbers_in_all_images(made: tuple[DatasetPlan, Path]) -> None:
    plan, folder = made
    assert plan.categories == ("furniture", "toy")
    for index in range(IMAGES):
        said, numbers = told(folder, f"images/{index:06d}.json"), picture(folder / f"images/{index:06d}.category.png")
        instances = picture(folder / f"images/{index:06d}.instance.png")
        held = channels(folder / f"images/{index:06d}.exr")
        np.testing.assert_array_equal(held["category.V"], numbers)
        for each in said["objects"]:
            number = {"furniture": 1, "toy": 2}[each["category"]]
            inside = numbers[instances == each["number"]]
            # Several things of a category may cover more of a pixel than each
            assert (inside == number).mean() > 0.9 if inside.size > 20 else True


def test_numbers_of_categories_are_those_listed(device: Device, tmp_path: Path) -> None:
    plan = plan_of(
        tmp_path, categories=["toy", "nothing", "furniture"], images=1, writers=["images", "coco"], amodal=True
    )
    make_dataset(plan, tmp_path / "a", device=device)
    numbers = set(np.unique(picture(tmp_path / "a/images/000000.category.png")).tolist())
    assert 3 in numbers and numbers <= {0, 1, 3}
    annotations = told(tmp_path, "a/coco/annotations.json")
    assert [each["name"] for each in annotations["categories"]] == ["toy", "nothing", "furniture"]
    assert all(0.0 <= each["visibility"] <= 1.0 for each in annotations["annotations"])
    assert any(name.startswith("amodal.") for name in channels(tmp_path / "a/images/000000.exr"))


def test_only_what_has_a_category_is_an_object(device: Device, tmp_path: Path) -> None:
    """Also where an image shows nothing that has one: its floor was written as an object of the category "object"."""
    gone = [{"name": name, "position": [0.0, 0.0, 0.0], "present": 0.0} for name in ("stool", "ball")]
    plan = plan_of(
        tmp_path, categories=["object", "toy", "furniture"], images=1, objects=gone, distractors=None,
        writers=["images", "coco", "bop"],
    )  # fmt: skip
    make_dataset(plan, tmp_path / "a", device=device)
    assert told(tmp_path, "a/coco/annotations.json")["annotations"] == []
    assert told(tmp_path, f"a/{BOP}/scene_gt.json") == {"0": []}
    assert told(tmp_path, "a/images/000000.json")["objects"] == []


def test_mattes_and_orthographic_cameras_are_described(device: Device, tmp_path: Path) -> None:
    """As the `.exr` of a render has it, and as the projection is."""
    camera = {"type": "orthographic", "position": [0, 1, 4], "target": [0, 0, 0], "height": 3.0, "lens_shift": [0.1, 0]}
    layers, plain = ["crypto_object", "crypto_material"], {"vary": None, "objects": None, "distractors": None}
    path = write_dataset(tmp_path, writers=["images"], layers=layers, size=[32, 24], camera={"type": "scene"}, **plain)
    (tmp_path / "scene.json").write_text(json.dumps({**SCENE, "camera": camera}))
    make_dataset(DatasetPlan.load(path), tmp_path / "out", images=range(1), device=device.info.index)
    told = json.loads((tmp_path / "out/images/000000.json").read_text())["camera"]
    assert told["region"] == pytest.approx({"left": -1.6, "top": -1.5, "width": 4.0, "height": 3.0})
    header = OpenEXR.File(str(tmp_path / "out/images/000000.exr"), header_only=True).header()
    manifests = [str(text) for key, text in header.items() if key.startswith("cryptomatte/") and "manifest" in key]
    names = {name for text in manifests for name in json.loads(text)}
    assert len(manifests) == 2 and {"floor", "ball", "red", "gold"} <= names


def test_two_processes_that_finish_a_set_do_it_one_after_the_other(
    made: tuple[DatasetPlan, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Both found all images there; one read the parts of archives that the other had removed."""
    plan, whole = made
    shutil.copytree(whole, tmp_path / "a")
    most, inside = [0], [0]
    archives = Records.make_archives

    def slow(records: Records) -> None:
        inside[0] += 1
        most[0] = max(most[0], inside[0])
        time.sleep(0.2)
        archives(records)
        inside[0] -= 1

    monkeypatch.setattr(Records, "make_archives", slow)
    with ThreadPoolExecutor(2) as pool:
        list(pool.map(lambda _: _finish(plan, Records(plan, tmp_path / "a")), range(2)))
    assert most == [1] and not list((tmp_path / "a").glob("*.lock"))
    assert told(tmp_path, "a/manifest.json") == told(whole, "manifest.json")


def unpacked(counts: str, height: int, width: int) -> npt.NDArray[np.bool_]:
    """A decoder of COCO's run lengths, from their description."""
    numbers, at = list[int](), 0
    while at < len(counts):
        value, shift, more = 0, 0, True
        while more:
            bits = ord(counts[at]) - 48
            value |= (bits & 31) << shift
            at, shift, more = at + 1, shift + 5, bool(bits & 32)
            if not more and bits & 16:
                value |= -1 << shift
        numbers.append(value + (numbers[-2] if len(numbers) > 2 else 0))
    flat = np.repeat(np.arange(len(numbers)) % 2 == 1, numbers)
    return flat.reshape(width, height).T


@pytest.mark.filterwarnings("ignore::DeprecationWarning")
@pytest.mark.parametrize("density", [0.0, 0.01, 0.3, 1.0])
@pytest.mark.parametrize("shape", [(1, 1), (7, 5), (40, 300), (300, 40)])
def test_run_lengths(density: float, shape: tuple[int, int]) -> None:
    random = np.random.default_rng(int(100 * density) + shape[0])
    mask = random.random(shape) < density
    mask[: shape[0] // 2] ^= random.random() < 0.5
    text = run_lengths(mask)
    np.testing.assert_array_equal(unpacked(text, *shape), mask)
    coder = pytest.importorskip("pycocotools.mask")
    theirs = coder.encode(np.asfortranarray(mask.astype(np.uint8)))
    assert theirs["counts"].decode() == text
    np.testing.assert_array_equal(coder.decode({"size": list(shape), "counts": text}), mask)


@pytest.mark.filterwarnings("ignore::DeprecationWarning")
def test_coco(made: tuple[DatasetPlan, Path]) -> None:
    _, folder = made
    content = told(folder, "coco/annotations.json")
    assert [each["id"] for each in content["images"]] == list(range(IMAGES))
    assert [each["id"] for each in content["annotations"]] == list(range(1, len(content["annotations"]) + 1))
    assert {each["id"]: each["name"] for each in content["categories"]} == {1: "furniture", 2: "toy"}
    assert len(content["annotations"]) >= IMAGES
    for each in content["annotations"]:
        numbers = picture(folder / f"images/{each['image_id']:06d}.instance.png")
        mask = unpacked(each["segmentation"]["counts"], *each["segmentation"]["size"])
        np.testing.assert_array_equal(mask, numbers == each["number"])
        rows, columns = np.nonzero(mask)
        left, top = columns.min(), rows.min()
        assert each["bbox"] == [left, top, columns.max() - left + 1, rows.max() - top + 1]
        assert each["area"] == mask.sum()
    for image in content["images"]:
        assert picture(folder / "coco" / image["file_name"]).shape == (image["height"], image["width"], 3)
    reader = pytest.importorskip("pycocotools.coco").COCO(str(folder / "coco/annotations.json"))
    for each in reader.loadAnns(reader.getAnnIds()):
        assert reader.annToMask(each).sum() == each["area"]


def test_bop(made: tuple[DatasetPlan, Path]) -> None:
    """The middle of the ball, and the corners of the stool's seat, are seen where its pose and the camera say."""
    plan, folder = made
    cameras, truth, info = (told(folder, f"{BOP}/scene_{name}.json") for name in ("camera", "gt", "gt_info"))
    models = told(folder, "bop/objects.json")
    assert set(models.values()) == {"ball", "cube", "orb", "stool"}, "groups, and the names of single shapes"
    balls = 0
    for index in range(IMAGES):
        scene, (width, height) = plan.image(index).scene, plan.image(index).size
        K = np.array(cameras[str(index)]["cam_K"]).reshape(3, 3)
        depth = picture(folder / f"{BOP}/depth/{index:06d}.png").astype(float)
        held = channels(folder / f"images/{index:06d}.exr")["z_depth.Z"]
        np.testing.assert_array_equal(depth, np.where(np.isfinite(held), np.rint(1000.0 * held.astype(float)), 0))
        for number, (each, counted) in enumerate(zip(truth[str(index)], info[str(index)], strict=True)):
            R, t = np.array(each["cam_R_m2c"]).reshape(3, 3), np.array(each["cam_t_m2c"])
            np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-9)
            assert np.linalg.det(R) == pytest.approx(1.0)
            mask, visible = (
                picture(folder / f"{BOP}/{k}/{index:06d}_{number:06d}.png") > 0 for k in ("mask", "mask_visib")
            )
            assert (visible <= mask).all() and counted["px_count_all"] == mask.sum()
            assert counted["px_count_visib"] == visible.sum() and counted["px_count_valid"] <= counted["px_count_all"]
            assert counted["visib_fract"] == (visible.sum() / mask.sum() if mask.any() else 0.0)
            model, points = models[str(each["obj_id"])], np.zeros((1, 3))
            if model == "ball":
                points = np.array([[0.7, 0.3, 0.0]])
            elif model == "stool":
                points = np.array([[x, 0.53, z] for x in (-0.25, 0.25) for z in (-0.25, 0.25)])
            seen = (R @ (1000.0 * each.get("scale", 1.0) * points).T + t[:, None]).T @ K.T
            pixels = seen[:, :2] / seen[:, 2:]
            (shape,) = [s for s in scene.shapes if s.name == model] if model in ("ball", "stool") else [None]
            if shape is None:
                continue
            place = affine(shape.transform)
            world = np.array([place.point((x, y, z)) for x, y, z in points.tolist()])
            np.testing.assert_allclose(pixels + 0.5, scene.camera.project(world, (width, height)), atol=1e-6)
            column, row = np.rint(pixels[0]).astype(int)
            inside = 0 <= column < width and 0 <= row < height
            if model == "ball" and inside:
                balls += 1
                assert mask[row, column]
                if visible[row, column]:
                    assert 0.0 < seen[0, 2] - depth[row, column] < 310.0, "its near side is a radius nearer, or less"
    assert balls > 1


def test_transforms_are_read_back(made: tuple[DatasetPlan, Path]) -> None:
    plan, folder = made
    cameras = clrender.load_cameras(folder / "transforms/transforms.json")
    assert list(cameras) == [f"images/{n:06d}.png" for n in range(IMAGES)]
    points = np.random.default_rng(1).uniform(-0.5, 0.5, (20, 3))
    for index, (name, camera) in enumerate(cameras.items()):
        there = plan.image(index)
        np.testing.assert_allclose(camera.position, there.scene.camera.position, atol=1e-9)
        np.testing.assert_allclose(camera.axes, there.scene.camera.axes, atol=1e-9)
        np.testing.assert_allclose(camera.project(points), there.scene.camera.project(points, there.size), atol=1e-6)
        assert picture(folder / "transforms" / name).shape == (28, 36, 3)


LENSES: dict[str, dict[str, Any]] = {
    "brown-conrady": {"type": "intrinsics", "fx": 40.0, "fy": 41.0, "cx": 15.0, "resolution": [36, 28],
                      "distortion": {"model": "brown-conrady", "k": [-0.1, 0.01, 0.002], "p": [0.001, 0.002]}},
    "kannala-brandt": {"type": "intrinsics", "fx": 20.0, "resolution": [36, 28],
                       "distortion": {"model": "kannala-brandt", "k": [0.1, -0.01]}},
    "fisheye": {"type": "fisheye", "vertical_fov": 150.0},
    "panoramic": {"type": "panoramic"},
    "shifted": {"vertical_fov": 40.0, "lens_shift": [0.1, -0.2]},
}  # fmt: skip


@pytest.mark.parametrize("lens", LENSES)
def test_lenses_of_transforms_are_read_back(device: Device, tmp_path: Path, lens: str) -> None:
    vary = {f"camera.{key}": value for key, value in LENSES[lens].items() if key != "type"}
    vary |= {"camera.type": LENSES[lens]["type"]} if "type" in LENSES[lens] else {}
    if "vertical_fov" not in LENSES[lens]:
        vary["camera.vertical_fov"] = None
    plan = plan_of(tmp_path, images=1, writers=["transforms"], vary=vary, layers=None)
    make_dataset(plan, tmp_path / "a", device=device)
    (camera,) = clrender.load_cameras(tmp_path / "a/transforms/transforms.json").values()
    points = np.random.default_rng(1).uniform(-0.5, 0.5, (20, 3))
    np.testing.assert_allclose(
        camera.project(points, (36, 28)), plan.image(0).scene.camera.project(points, (36, 28)), atol=1e-6
    )


@pytest.mark.parametrize(
    ("writer", "vary"),
    [
        ("transforms", {"camera.type": "orthographic", "camera.vertical_fov": None}),
        ("bop", {"camera.type": "panoramic", "camera.vertical_fov": None}),
        (
            "bop",
            {f"camera.{key}": value for key, value in LENSES["kannala-brandt"].items()} | {"camera.vertical_fov": None},
        ),
    ],
)
def test_cameras_that_writers_do_not_know(device: Device, tmp_path: Path, writer: str, vary: dict[str, Any]) -> None:
    plan = plan_of(tmp_path, images=1, writers=[writer], vary=vary)
    with pytest.raises(SceneError, match=f"the writer {writer} .*leave it out, or use another camera"):
        make_dataset(plan, tmp_path / "a", device=device)


def test_webdataset(made: tuple[DatasetPlan, Path]) -> None:
    _, folder = made
    names = sorted(path.name for path in (folder / "webdataset").iterdir())
    assert names == ["data-000000.tar", "data-000001.tar"], "four images in each, and no parts"
    index = 0
    for name in names:
        with tarfile.open(folder / "webdataset" / name) as archive:
            members = archive.getmembers()
            keys = [each.name.partition(".")[0] for each in members]
            assert (
                keys == sorted(keys)
                and {each.mtime for each in members} == {0}
                and {each.uid for each in members} == {0}
            )
            for key in dict.fromkeys(keys):
                for ending in ("png", "instance.png", "json", "category.png", "part.png"):
                    file = archive.extractfile(f"{key}.{ending}")
                    assert file is not None
                    assert file.read() == (folder / f"images/{index:06d}.{ending}").read_bytes()
                index += 1
    assert index == IMAGES


# --- one manifest ----------------------------------------------------------------------------------------------------


def own_hash(arrays: dict[str, npt.NDArray[Any]]) -> str:
    """As the documentation says it."""
    parts = [
        f"{name} {arrays[name].dtype.str} {arrays[name].shape}\n".encode() + arrays[name].tobytes()
        for name in sorted(arrays)
    ]
    return hashlib.sha256(b"".join(parts)).hexdigest()


def test_the_manifest_has_the_hashes_of_all_pixels(made: tuple[DatasetPlan, Path]) -> None:
    plan, folder = made
    manifest = told(folder, "manifest.json")
    assert manifest["spec_sha256"] == plan.spec.sha256() and manifest["scene_sha256"] == plan.base.sha256()
    assert [each["image"] for each in manifest["images"]] == list(range(IMAGES))
    said = {name: sha256 for image in manifest["images"] for name, sha256 in image["pixels"].items()}
    there = {path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file()}
    there -= {"manifest.json", *manifest["files"], *(f"records/{n:06d}.json" for n in range(IMAGES))}
    assert {name.partition("#")[0] for name in said} == there, "every file is proved"
    for name, sha256 in said.items():
        path = folder / name
        if name.endswith(".exr"):
            assert own_hash(channels(path)) == sha256
        elif "#" not in name:
            content = picture(path) if name.endswith(".png") else np.frombuffer(path.read_bytes(), np.uint8)
            assert own_hash({"": np.ascontiguousarray(content)}) == sha256, name
    for name, sha256 in manifest["files"].items():
        assert hashlib.sha256((folder / name).read_bytes()).hexdigest() == sha256
    linear = {image["image"]: image["linear_sha256"] for image in manifest["images"]}
    assert linear[2] == told(folder, "images/000002.json")["linear_sha256"]


def same(a: Path, b: Path) -> bool:
    """Whether two data sets have the same files with the same bytes."""
    files = [{p.relative_to(x): p.read_bytes() for p in x.rglob("*") if p.is_file()} for x in (a, b)]
    return files[0] == files[1]


def test_parts_in_one_folder_and_in_several(made: tuple[DatasetPlan, Path], device: Device, tmp_path: Path) -> None:
    plan, folder = made
    parts = [range(1), range(1, 2), range(2, 5), range(5, 6)]
    for number in (2, 0, 3, 1):
        assert not (tmp_path / "one" / "manifest.json").exists()
        progress = make_dataset(plan, tmp_path / "one", images=parts[number], device=device)
    assert progress.missing == 0 and same(tmp_path / "one", folder)
    for number, part in enumerate(parts):
        make_dataset(plan, tmp_path / f"{number}", images=part, device=device)
    progress = merge_datasets(plan, tmp_path / "merged", [tmp_path / f"{n}" for n in (3, 1, 0)])
    assert progress.missing == 3 and not (tmp_path / "merged" / "manifest.json").exists()
    progress = merge_datasets(plan, tmp_path / "merged", [tmp_path / f"{n}" for n in range(4)])
    assert progress.missing == 0 and same(tmp_path / "merged", folder)
    with pytest.raises(UsageError, match="is no folder"):
        merge_datasets(plan, tmp_path / "merged", [tmp_path / "none"])


class Killed(BaseException):
    """The end of the process."""


def test_killed_at_any_moment(
    made: tuple[DatasetPlan, Path], device: Device, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """After any number of files, a file half of which was written, and at any step of the end."""
    plan, folder = made
    moments: Iterator[int] = iter([1, 5, 17, 2, 30, 9, 40, 3, 21, 11, 60])
    left = [next(moments)]

    def put(self: ImageFiles, name: str, data: bytes, write: Callable[..., None] = ImageFiles.put) -> None:
        left[0] -= 1
        if left[0] == 0:
            write(self, name, data[: len(data) // 2])  # under its own name: worse than a kill can be
            raise Killed
        write(self, name, data)

    ends = {"clrender.datasets.records.Records.make_archives", "clrender.datasets.records.Records.write_manifest"}
    monkeypatch.setattr(ImageFiles, "put", put)
    deaths = 0
    for moment in moments:
        try:
            make_dataset(plan, tmp_path / "a", device=device)
            break
        except Killed:
            deaths += 1
            left[0] = moment
            assert not (tmp_path / "a" / "manifest.json").exists()
    left[0] = 10**9
    for end in sorted(ends):
        if not (tmp_path / "a" / "manifest.json").exists():
            with monkeypatch.context() as patch:
                patch.setattr(end, lambda *_: (_ for _ in ()).throw(Killed()))
                with pytest.raises(Killed):
                    make_dataset(plan, tmp_path / "a", device=device)
    progress = make_dataset(plan, tmp_path / "a", device=device)
    assert deaths >= 5 and progress.missing == 0 and same(tmp_path / "a", folder)


def test_what_is_there_is_not_rendered_again(made: tuple[DatasetPlan, Path], device: Device, tmp_path: Path) -> None:
    plan, folder = made
    shutil.copytree(folder, tmp_path / "a")
    assert make_dataset(plan, tmp_path / "a", device=device).rendered == 0
    (tmp_path / "a/images/000001.png").unlink()
    data = bytearray((tmp_path / "a/coco/images/000004.png").read_bytes())
    data[-20] ^= 1
    (tmp_path / "a/coco/images/000004.png").write_bytes(data)
    (tmp_path / "a/records/000005.json").write_text("{}")
    archive = tmp_path / "a/webdataset/data-000000.tar"
    content = bytearray(archive.read_bytes())
    content[3000] ^= 1  # in image 0
    archive.write_bytes(content)
    progress = make_dataset(plan, tmp_path / "a", device=device)
    assert progress.rendered == 4 and same(tmp_path / "a", folder)


def test_files_that_are_lost_or_damaged_are_missing(device: Device, tmp_path: Path) -> None:
    """Images with a record are counted only if their files are there; sound ones of other folders are copied."""
    render, none = {"spp": 1}, {"camera": None, "objects": None, "distractors": None, "vary": None}
    plan = plan_of(tmp_path, images=2, size=[8, 12], render=render, writers=["images", "webdataset"], **none)
    make_dataset(plan, tmp_path / "sound", device=device)
    for name in ("part", "both"):
        make_dataset(plan, tmp_path / name, images=range(1, 2), device=device)
        (tmp_path / name / "webdataset/parts/000001.tar").unlink()
    assert make_dataset(plan, tmp_path / "part", images=range(1), device=device).missing == 1
    assert merge_datasets(plan, tmp_path / "part", []).missing == 1
    assert merge_datasets(plan, tmp_path / "part", [tmp_path / "both"]).missing == 1
    assert not (tmp_path / "part/manifest.json").exists()
    changed_pixel(tmp_path / "part/images/000000.png")
    progress = merge_datasets(plan, tmp_path / "part", [tmp_path / "sound"])
    assert (progress.rendered, progress.missing) == (2, 0) and same(tmp_path / "part", tmp_path / "sound")
    (tmp_path / "part/images/000001.png").unlink()
    assert make_dataset(plan, tmp_path / "part", images=range(1), device=device).missing == 1


def test_another_data_set_in_the_same_folder(made: tuple[DatasetPlan, Path], device: Device, tmp_path: Path) -> None:
    _, folder = made
    shutil.copytree(folder, tmp_path / "a")
    other = plan_of(tmp_path, seed=8, images=2, writers=["images"])
    with pytest.raises(
        UsageError, match=r"a: has images of another data set.* \(manifest\.json\); name another folder"
    ):
        make_dataset(other, tmp_path / "a", device=device)
    assert same(tmp_path / "a", folder)


def test_a_sensor(device: Device, tmp_path: Path) -> None:
    """Its pictures are those of the sensor, noise and all, also where they have 16 bits or are a mosaic."""
    for name, table, dtype in (
        ("deep", {"bits": 12, "bayer": "grbg"}, np.uint16),
        ("flat", {"bits": 8}, np.uint8),
        ("mosaic", {"bits": 10, "bayer": "rggb", "demosaic": False}, np.uint16),
        ("encoded", {"encoding": "srgb", "exposure": 0.5}, np.uint8),
    ):
        plan = plan_of(tmp_path, images=2, writers=["images", "webdataset"], layers=None, sensor=table)
        make_dataset(plan, tmp_path / name, device=device)
        for index in range(2):
            held = channels(tmp_path / name / f"images/{index:06d}.exr")
            linear = np.stack([held[each] for each in "RGB"], axis=2)
            expected = clrender.Sensor(**table).image(linear, seed=7, index=index)
            found = picture(tmp_path / name / f"images/{index:06d}.png")
            assert found.dtype == dtype
            np.testing.assert_array_equal(found, expected)
        assert verify_dataset(tmp_path / name, 1.0, device=device).sound


# --- proofs ----------------------------------------------------------------------------------------------------------


def test_a_sound_data_set(made: tuple[DatasetPlan, Path], device: Device) -> None:
    _, folder = made
    found = verify_dataset(folder, sample=2, device=device, seed=3)
    assert found.sound and (found.images, found.checked) == (IMAGES, 2) and found.files > 10 * IMAGES
    assert found.detection(1) == pytest.approx(1 / 3) and found.detected(0.61) == 3
    assert verify_dataset(folder, 1.0, device=device).checked == IMAGES


def changed_pixel(path: Path) -> None:
    image = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    assert image is not None
    image[9, 4] ^= 1
    assert cv2.imwrite(str(path), image)


def changed_channel(path: Path) -> None:
    with OpenEXR.File(str(path), separate_channels=True) as file:
        held = {name: np.array(channel.pixels) for name, channel in file.channels().items()}
        held["G"][9, 4] = np.nextafter(held["G"][9, 4], np.float32(9.0))
        OpenEXR.File({"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}, held).write(str(path))


def changed_text(path: Path) -> None:
    path.write_text(path.read_text().replace('"seed":', '"seed": ', 1).replace('"id":1', '"id":2', 1))


def changed_member(path: Path) -> None:
    content = path.read_bytes()
    at = content.index(b'"camera_to_world"')
    path.write_bytes(content[:at] + b'"camera_to_wrold"' + content[at + 17 :])


TAMPERED: dict[str, tuple[str, Callable[[Path], Any], str]] = {
    "a pixel of a picture": (
        "images/000002.png",
        changed_pixel,
        "images/000002.png: 1 pixel differs from the manifest, in column 4 of row 9",
    ),
    "a pixel of an .exr": (
        "images/000003.exr",
        changed_channel,
        "images/000003.exr: 1 pixel differs from the manifest, in column 4 of row 9",
    ),
    "a pixel of a mask": (
        f"{BOP}/mask_visib/000001_000000.png",
        changed_pixel,
        "mask_visib/000001_000000.png: 1 pixel differs",
    ),
    "a distance": (f"{BOP}/depth/000004.png", changed_pixel, "depth/000004.png: 1 pixel differs"),
    "a number of an instance": ("images/000000.instance.png", changed_pixel, "000000.instance.png: 1 pixel differs"),
    "a text": ("images/000005.json", changed_text, "images/000005.json: its bytes are not those of the manifest"),
    "annotations": ("coco/annotations.json", changed_text, "coco/annotations.json: its bytes are not those"),
    "a member of an archive": (
        "webdataset/data-000001.tar",
        changed_member,
        "data-000001.tar#000004.json: its bytes are not those",
    ),
    "bytes behind an archive": (
        "webdataset/data-000001.tar",
        lambda path: path.write_bytes(path.read_bytes() + b"x"),
        "data-000001.tar: has other members than the manifest says, or bytes behind its end",
    ),
    "a file that is missing": ("coco/images/000003.png", Path.unlink, "coco/images/000003.png: is missing"),
    "a file that is none": (
        "images/000001.exr",
        lambda path: path.write_bytes(b"v/1\1" + bytes(50)),
        "images/000001.exr: is damaged",
    ),
    "an archive that is missing": ("webdataset/data-000001.tar", Path.unlink, "data-000001.tar#000005.png: is missing"),
    "truth that is missing": (f"{BOP}/scene_gt.json", Path.unlink, "scene_gt.json: is missing"),
}


@pytest.mark.parametrize("case", TAMPERED)
def test_what_was_changed_is_found_and_named(
    made: tuple[DatasetPlan, Path], device: Device, tmp_path: Path, case: str
) -> None:
    _, folder = made
    name, change, words = TAMPERED[case]
    shutil.copytree(folder, tmp_path / "a")
    shutil.copy(folder.parent / "scene.json", tmp_path)
    change(tmp_path / "a" / name)
    found = verify_dataset(tmp_path / "a", sample=1, device=device, seed=1)
    assert not found.sound and any(words in fault for fault in found.faults), found.faults
    assert all(words.partition(":")[0].partition("#")[0] in fault for fault in found.faults)


def test_a_manifest_that_was_changed_too(made: tuple[DatasetPlan, Path], device: Device, tmp_path: Path) -> None:
    """A pixel and its hash: only rendering the image again can tell."""
    _, folder = made
    shutil.copytree(folder, tmp_path / "a")
    shutil.copy(folder.parent / "scene.json", tmp_path)
    changed_pixel(tmp_path / "a/images/000002.png")
    manifest = told(tmp_path, "a/manifest.json")
    manifest["images"][2]["pixels"]["images/000002.png"] = own_hash(
        {"": np.ascontiguousarray(picture(tmp_path / "a/images/000002.png"))}
    )
    (tmp_path / "a/manifest.json").write_text(json.dumps(manifest))
    found = verify_dataset(tmp_path / "a", 1.0, device=device)
    assert found.faults == ("image 2: rendered again, it is not what the manifest says (images/000002.png)",)
    manifest["spec"]["seed"] = 9
    (tmp_path / "a/manifest.json").write_text(json.dumps(manifest))
    found = verify_dataset(tmp_path / "a", sample=1, device=device)
    assert "the hash of the description does not match" in found.faults[0] and any(
        "its scene" in each for each in found.faults
    )


def test_what_cannot_be_verified(made: tuple[DatasetPlan, Path], device: Device, tmp_path: Path) -> None:
    _, folder = made
    (tmp_path / "b").mkdir()
    with pytest.raises(UsageError, match=r"has no manifest\.json, .*finish the data set"):
        verify_dataset(tmp_path / "b")
    shutil.copytree(folder, tmp_path / "c" / "a")
    with pytest.raises(UsageError, match=r"was made from scene\.json, not found here"):
        verify_dataset(tmp_path / "c" / "a")
    scene = json.loads((folder.parent / "scene.json").read_text())
    assert verify_dataset(tmp_path / "c" / "a", sample=1, scene=folder.parent / "scene.json", device=device).sound
    scene["materials"]["floor"]["reflectance"] = [0.5] * 3
    (tmp_path / "c" / "scene.json").write_text(json.dumps(scene))
    with pytest.raises(UsageError, match="was made from another scene"):
        verify_dataset(tmp_path / "c" / "a", device=device)
    shutil.copy(folder.parent / "scene.json", tmp_path / "c")
    manifest = told(tmp_path, "c/a/manifest.json")
    (tmp_path / "c/a/manifest.json").write_text(json.dumps({**manifest, "kernel_sha256": "0"}))
    with pytest.raises(UsageError, match="was made by the kernels of clrender"):
        verify_dataset(tmp_path / "c" / "a", device=device)
    (tmp_path / "c/a/manifest.json").write_text(json.dumps({**manifest, "format": "x"}))
    with pytest.raises(UsageError, match="is no manifest of the format"):
        verify_dataset(tmp_path / "c" / "a", device=device)
    for wrong in ({"fraction": 0.0}, {"fraction": 2}, {"sample": 0}):
        with pytest.raises(UsageError, match=f"{next(iter(wrong))} is"):
            verify_dataset(folder, **wrong, device=device)


def test_sets_with_a_plugin_are_proved_with_its_text(device: Device, tmp_path: Path) -> None:
    text = (SCENES / "minnaert.cl").read_text()
    (tmp_path / "minnaert.cl").write_text(text)
    shutil.copy(SCENES / "moon.toml", tmp_path)
    content = {"scene": "moon.toml", "images": 2, "size": [8, 6], "render": {"spp": 1}}
    with pytest.raises(SceneError, match="minnaert"):
        DatasetPlan.from_table(content, tmp_path)
    plan = DatasetPlan.from_table(content, tmp_path, plugins=tmp_path / "minnaert.cl")
    assert make_dataset(plan, tmp_path / "a", device=device).missing == 0
    assert verify_dataset(tmp_path / "a", plugins=tmp_path / "minnaert.cl", device=device).sound
    with pytest.raises(UsageError, match=r"was made with the plugin minnaert .* --plugin FILE"):
        verify_dataset(tmp_path / "a", device=device)
    (tmp_path / "minnaert.cl").write_text(text.replace("0.5f * INV_PI", "0.4f * INV_PI"))
    with pytest.raises(UsageError, match="another text of the plugin minnaert"):
        verify_dataset(tmp_path / "a", plugins=tmp_path / "minnaert.cl", device=device)
    changed = DatasetPlan.from_table(content, tmp_path, plugins=tmp_path / "minnaert.cl")
    with pytest.raises(
        UsageError, match=r"a: has images of another data set.* \(manifest\.json\); name another folder"
    ):
        make_dataset(changed, tmp_path / "a", device=device)


def test_folders_of_other_data_sets_are_refused(device: Device, tmp_path: Path) -> None:
    def plan(seed: int) -> DatasetPlan:
        return DatasetPlan.from_table(
            {"scene": "room", "images": 2, "size": [8, 6], "seed": seed, "render": {"spp": 1}}
        )

    make_dataset(plan(1), tmp_path / "part", images=range(1), device=device)
    words = r"part: has images of another data set.* \(records/000000\.json\)"
    with pytest.raises(UsageError, match=words):
        make_dataset(plan(2), tmp_path / "part", device=device)
    with pytest.raises(UsageError, match=words):
        merge_datasets(plan(2), tmp_path / "b", [tmp_path / "part"])
    assert make_dataset(plan(1), tmp_path / "part", device=device).rendered == 1
    with pytest.raises(UsageError, match="image -1: images are numbered from 0 on"):
        plan(1).image(-1)


@pytest.mark.parametrize("what", ["shape", "instance", "several", "camera"])
def test_poses_are_those_of_the_opening_of_the_shutter(device: Device, tmp_path: Path, what: str) -> None:
    """The centre of a ball is where its mask is, whichever way it moves; a placed camera does not move."""
    motion = [{"time": 0.0, "translate": [-0.6, 0.0, 0.0]}, {"time": 1.0, "translate": [0.6, 0.4, 0.0]}]
    ball: dict[str, Any] = {"type": "sphere", "radius": 0.2, "emission": [1, 1, 1]}
    named, shapes = {"name": "ball", "category": "ball"}, list[dict[str, Any]]()
    if what == "instance":
        shapes = [{"type": "instance", "group": "g", "transform": {"scale": 0.8}, "motion": motion, **named}]
    elif what == "several":
        shapes = [{**ball, **named, "motion": motion}, {**ball, **named, "radius": 0.1, "motion": motion}]
    else:
        shapes = [{**ball, **named, "motion": motion if what == "shape" else []}]
    camera: dict[str, Any] = {"position": [0, 0, 4], "target": [0, 0, 0], "vertical_fov": 40.0}
    if what == "camera":
        camera["motion"] = [{"time": 0.0, "target": [-0.6, 0, 0]}, {"time": 1.0, "target": [0.5, 0.2, 0]}]
    scene = {"camera": camera, "shapes": shapes, "groups": {"g": {"shapes": [ball]}}}
    (tmp_path / "scene.json").write_text(json.dumps(scene))
    content = {"scene": "scene.json", "images": 3, "size": [64, 64], "render": {"spp": 16}, "layers": ["instance"],
               "writers": ["images", "bop"], "vary": {"camera.time": {"choice": [0.0, 0.3, 1.0]}}}  # fmt: skip
    plan = DatasetPlan.from_table(content, tmp_path)
    make_dataset(plan, tmp_path / "a", device=device)
    truth, cameras = told(tmp_path, f"a/{BOP}/scene_gt.json"), told(tmp_path, f"a/{BOP}/scene_camera.json")
    for index in range(3):
        x, y, z = truth[f"{index}"][0]["cam_t_m2c"]
        fx, _, cx, _, fy, cy, *_ = cameras[f"{index}"]["cam_K"]
        rows, columns = np.nonzero(picture(tmp_path / f"a/images/{index:06d}.instance.png"))
        assert abs(columns.mean() - (cx + fx * x / z)) < 0.5
        assert abs(rows.mean() - (cy + fy * y / z)) < 0.5
    placed = {**content, "vary": {}, "camera": {"type": "box", "position": [0, 0, 6]}}
    place = DatasetPlan.from_table(placed, tmp_path).image(0).scene.camera
    assert place.position == (0.0, 0.0, 6.0) and not place.motion


def test_a_time_without_motion_is_refused(tmp_path: Path) -> None:
    content = {"scene": "room", "images": 1, "vary": {"camera.time": {"uniform": [0, 1]}}}
    with pytest.raises(SceneError, match=r"vary\.camera\.time has no effect"):
        DatasetPlan.from_table(content, tmp_path)


def test_names_do_not_lead_out_of_the_folder(made: tuple[DatasetPlan, Path], device: Device, tmp_path: Path) -> None:
    plan, folder = made
    shutil.copytree(folder, tmp_path / "a")
    shutil.copy(folder.parent / "scene.json", tmp_path)
    (tmp_path / "secret.txt").write_text("x")
    (tmp_path / "a" / "link.txt").symlink_to(tmp_path / "secret.txt")
    manifest = told(tmp_path, "a/manifest.json")
    sha256 = hashlib.sha256(b"x").hexdigest()
    manifest["files"] |= dict.fromkeys(("../secret.txt", str(tmp_path / "secret.txt"), "link.txt"), sha256)
    (tmp_path / "a/manifest.json").write_text(json.dumps(manifest))
    found = verify_dataset(tmp_path / "a", sample=1, device=device)
    assert len(found.faults) == 3 and all(fault.endswith("is missing") for fault in found.faults)
    path = tmp_path / "a/records/000003.json"
    record = json.loads(path.read_text())
    record["written"]["images/../../stolen.txt"] = [1, sha256]
    path.write_text(json.dumps(record))
    (tmp_path / "a/records/000004.json").write_text(
        json.dumps({**json.loads(path.read_text()), "image": 4, "told": []})
    )
    (tmp_path / "stolen.txt").write_text("x")
    assert merge_datasets(plan, tmp_path / "c" / "d", [tmp_path / "a"]).missing == 3, (
        "the archive of 5 has lost its order"
    )
    assert not (tmp_path / "c" / "stolen.txt").exists()


@pytest.mark.slow
def test_the_same_manifest_on_every_device(all_devices: list[Device], tmp_path: Path) -> None:
    """Of matt things: rusticl compiles other materials for longer."""
    path = write_dataset(tmp_path, images=2, writers=["images", "coco"], vary=None, objects=None, distractors=None)
    scene = {**SCENE, "materials": {key: {"type": "lambert", "reflectance": [0.5] * 3} for key in SCENE["materials"]}}
    scene["shapes"] = [shape for shape in SCENE["shapes"] if shape["type"] != "instance"]
    (tmp_path / "scene.json").write_text(json.dumps({**scene, "groups": {}}))
    plan, digests = DatasetPlan.load(path), set()
    for number, device in enumerate(all_devices):
        make_dataset(plan, tmp_path / f"{number}", device=device)
        digests.add((tmp_path / f"{number}" / "manifest.json").read_bytes())
    assert len(digests) == 1
