"""Parts of a data set are of one: whatever changes its files, but no hash of its scene, is in what they are told by."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from clrender.datasets import DatasetPlan, Spec, merge_datasets, verify_dataset
from clrender.datasets.checking import _plan
from clrender.datasets.records import Records
from clrender.errors import UsageError

OTHERS = "has images of another data set"


def _sphere(x: float, **more: Any) -> dict[str, Any]:
    return {"type": "sphere", "radius": 0.5, "center": [x, 0, 0], "material": "m", **more}


SCENE: dict[str, Any] = {
    "camera": {"position": [0.0, 0.0, 4.0], "target": [0.0, 0.0, 0.0], "f_stop": 4.0, "shutter": 0.02, "iso": 100.0},
    "materials": {"m": {"type": "lambert", "reflectance": 0.5}},
    "groups": {"g": {"shapes": [_sphere(0, name="part", category="toy")]}},
    "shapes": [
        _sphere(-1, name="left", category="cat"),
        _sphere(1, name="right", category="dog"),
        {"type": "instance", "group": "g", "name": "one", "category": "toy"},
    ],
    "lights": [{"type": "environment", "radiance": [1, 1, 1]}],
    "render": {"spp": 1},
}
SPEC: dict[str, Any] = {"scene": "scene.json", "images": 2, "size": [8, 6], "writers": ["images", "coco"]}
VARIED = {"vary": {"materials.m.reflectance": {"choice": [{"texture": "a.png"}]}}}
FROM_FILE = {"camera": {"type": "file", "file": "transforms.json"}}


def _cameras(z: float) -> str:
    pose = [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, z], [0, 0, 0, 1]]
    return json.dumps({"fl_x": 8.0, "w": 8, "h": 6, "frames": [{"file_path": "0.png", "transform_matrix": pose}]})


def _files(folder: Path) -> None:
    folder.mkdir(exist_ok=True)
    (folder / "scene.json").write_text(json.dumps(SCENE))
    Image.fromarray(np.full((2, 2, 3), 20, np.uint8)).save(folder / "a.png")
    (folder / "transforms.json").write_text(_cameras(3.0))


def _part(folder: Path, spec: dict[str, Any]) -> DatasetPlan:
    """A plan, and in the folder `a` of it what stands for its first image: nothing is rendered."""
    plan = DatasetPlan.from_table({**SPEC, **spec}, folder)
    record = {"linear_sha256": "0", "pixels": {}, "told": {}, "written": {}}
    Records(plan, folder / "a").write(0, {**record, "scene_sha256": plan.image(0).scene.sha256()})
    return plan


def _edited(edit: Callable[[dict[str, Any]], object]) -> Callable[[Path], None]:
    def change(folder: Path) -> None:
        scene = json.loads((folder / "scene.json").read_text())
        edit(scene)
        (folder / "scene.json").write_text(json.dumps(scene))

    return change


def _swapped(scene: dict[str, Any]) -> None:
    scene["shapes"][0]["category"], scene["shapes"][1]["category"] = "dog", "cat"


def _picture(folder: Path) -> None:
    Image.fromarray(np.full((2, 2, 3), 250, np.uint8)).save(folder / "a.png")


CASES: dict[str, tuple[dict[str, Any], Callable[[Path], object], str]] = {
    "categories exchanged": ({}, _edited(_swapped), "names or categories"),
    "a category": ({}, _edited(lambda scene: scene["shapes"][0].update(category="toy")), "names or categories"),
    "a name": ({}, _edited(lambda scene: scene["shapes"][0].update(name="other")), "names or categories"),
    "in a group": (
        {},
        _edited(lambda scene: scene["groups"]["g"]["shapes"][0].update(name="other")),
        "names or categories",
    ),
    "of an instance": ({}, _edited(lambda scene: scene["shapes"][2].update(category=None)), "names or categories"),
    "exposure": ({}, _edited(lambda scene: scene["camera"].update(f_stop=16.0)), "exposure of the camera"),
    "settings": ({}, _edited(lambda scene: scene["render"].update(spp=2)), "settings in the scene's table render"),
    "a flow": ({}, _edited(lambda scene: scene["camera"].update(flow_step=0.5)), "flow_step"),
    "a varied file": (VARIED, _picture, "files that only"),
    "cameras": (FROM_FILE, lambda folder: (folder / "transforms.json").write_text(_cameras(8.0)), "cameras in camera"),
}


@pytest.mark.parametrize("case", CASES)
def test_what_changes_files_but_no_hash_of_the_scene_is_refused(tmp_path: Path, case: str) -> None:
    """Going on, merging and verifying, after something was edited between two parts."""
    spec, change, told = CASES[case]
    folder = tmp_path / "set"
    _files(folder)
    plan = _part(folder, spec)
    again = DatasetPlan.from_table({**SPEC, **spec}, folder)
    Records(again, folder / "a").refuse_others()
    Records(plan, folder / "a").write_manifest({})
    manifest = json.loads((folder / "a" / "manifest.json").read_text())
    arguments: Any = (folder / "a", manifest, Spec.of(manifest["spec"], "spec"), None, (), ())
    assert _plan(*arguments).base.sha256() == plan.base.sha256()
    former = {key: value for key, value in manifest.items() if key != "inputs"}
    change(folder)
    other = DatasetPlan.from_table({**SPEC, **spec}, folder)
    assert other.base.sha256() == plan.base.sha256()  # so that only this tells them apart
    with pytest.raises(UsageError, match=rf"{OTHERS}.* \(manifest\.json\)"):
        Records(other, folder / "a").refuse_others()
    with pytest.raises(UsageError, match=OTHERS):
        merge_datasets(other, folder / "b", [folder / "a"])
    with pytest.raises(UsageError, match=f"was made with other {told}"):
        verify_dataset(folder / "a")
    assert _plan(arguments[0], former, *arguments[2:]).spec == plan.spec  # what did not record it can be verified
    (folder / "a" / "manifest.json").unlink()
    with pytest.raises(UsageError, match=rf"{OTHERS}.* \(records/000000\.json\)"):
        Records(other, folder / "a").refuse_others()


def test_settings_of_the_description_and_notes_of_the_scene_do_not_matter(tmp_path: Path) -> None:
    _files(tmp_path)
    spec = {"render": {"spp": 4}}
    _part(tmp_path, spec)
    _edited(lambda scene: scene.update(title="new", render={"spp": 2, "seed": 3}))(tmp_path)
    Records(DatasetPlan.from_table({**SPEC, **spec}, tmp_path), tmp_path / "a").refuse_others()


def test_a_record_of_another_scene_is_refused(tmp_path: Path) -> None:
    _files(tmp_path)
    plan = _part(tmp_path, {})
    records = Records(plan, tmp_path / "a")
    said = json.loads(records.path(0).read_text())
    records.refuse_others()
    records.path(0).write_text(json.dumps({**said, "scene_sha256": "0" * 64}))
    with pytest.raises(UsageError, match=rf"{OTHERS}.* \(records/000000\.json\)"):
        records.refuse_others()
