"""The guiding field as data: its histograms, its growth, its file."""

from __future__ import annotations

import errno
import os
from pathlib import Path

import numpy as np
import pytest

import clrender
from clrender import UsageError, layout
from clrender.files.npy import write_npy
from clrender.guiding.field import GuidingField, cell_rows, empty_field, histogram_words, octets
from clrender.guiding.octree import LEAST_RECORDS, SPLIT_RECORDS, Growing, Sums
from clrender.rendering.job import RenderJob

LEAF, NONE = layout.FIELD_LEAF, layout.NONE


def histograms(count: int) -> np.ndarray[tuple[int, ...], np.dtype[np.float64]]:
    """Weights of all kinds: even, of a few bins, of a single one."""
    rng = np.random.default_rng(3)
    weights = np.floor(rng.pareto(0.7, (count, layout.FIELD_BINS)) * 1000.0)
    weights[0], weights[1], weights[2] = 1.0, 0.0, 0.0
    weights[1, 77] = weights[2, 255] = 5.0
    return weights


def test_histograms_have_256_shares_that_agree_with_their_weights() -> None:
    weights = histograms(40)
    words = histogram_words(weights)
    of_bins, shares = octets(words[:, :64]), octets(words[:, 64:])
    assert (shares.sum(axis=1, dtype=int) == layout.FIELD_BINS).all()
    for own, counted in zip(of_bins, shares, strict=True):
        assert (np.bincount(own, minlength=layout.FIELD_BINS) == counted).all()
        assert (np.diff(own.astype(int)) >= 0).all()
    exact = weights / weights.sum(axis=1, keepdims=True) * layout.FIELD_BINS
    assert (np.abs(shares[3:] - exact[3:]) <= 1.0).all()
    assert shares[1, 77] == 255 and shares[1, 76] == 1, "256 shares of one bin do not fit into a word"
    assert shares[2, 255] == 255 and shares[2, 254] == 1


def grown(rounds: int = 3, most: int = 100_000) -> tuple[Growing, list[int]]:
    """A field that grows where records are in one corner, and how many leaves it has after each round."""
    growing, leaves = Growing(empty_field(np.zeros(3), 1.0), most), []
    rng = np.random.default_rng(1)
    for _ in range(rounds):
        field = growing.field(final=False)
        records = np.zeros((len(field.nodes), 8), np.int64)
        of_leaf = field._leaves()
        records[of_leaf[0], :4] = 5 * SPLIT_RECORDS
        records[of_leaf[-1], 6] = LEAST_RECORDS
        cells = np.floor(rng.random((len(field.cells), layout.TRAINING_SUMS)) * 2.0**30)
        growing.learn(Sums(cells, records))
        growing.grow(records, 1.0)
        leaves.append(len(growing.field(final=False)._leaves()))
    return growing, leaves


def test_leaves_with_many_records_are_divided_and_inherit() -> None:
    growing, leaves = grown()
    assert leaves == sorted(leaves) and leaves[0] > 8
    field = growing.field(final=True)
    assert field.cell_count == len(field.cells)
    again = GuidingField.of_words(field.words)
    assert (again.nodes == field.nodes).all() and (again.cells == field.cells).all()
    shares = field.cells[:, 128].view(np.float32)
    assert set(shares.tolist()) <= {0.0, 0.25, 0.5, 0.75}
    assert set(growing.field(final=False).cells[:, 128].view(np.float32).tolist()) <= {0.0, 0.5}


def test_memory_bounds_the_cells_and_the_nodes() -> None:
    growing, _ = grown(rounds=5, most=20)
    field = growing.field(final=False)
    assert 0 < field.cell_count <= 20 and len(field.nodes) <= 8 * 20 + 17


def test_a_field_is_kept_in_a_file(tmp_path: Path) -> None:
    field = grown()[0].field(final=True)
    field.save(tmp_path / "a.npy")
    again = GuidingField.read(tmp_path / "a.npy")
    assert again.sha256() == field.sha256() and (again.words == field.words).all()
    assert empty_field(np.zeros(3), 1.0).sha256() != field.sha256()


def spoiled(words: np.ndarray[tuple[int, ...], np.dtype[np.uint32]], how: str) -> object:
    """A field's words, wrong in one way."""
    words = words.copy()
    nodes = int(words[1])
    cells = 7 + 8 * nodes
    match how:
        case "short":
            return words[:-1]
        case "another format":
            words[0] += 1
        case "a wrong number of nodes":
            words[1] += 1
        case "a box without size":
            words[6] = np.float32(0.0).view(np.uint32)
        case "a box that is no number":
            words[3] = np.float32(np.nan).view(np.uint32)
        case "a child that is not there":
            words[7] = nodes + 5
        case "a leaf that is not there":
            words[7] = LEAF | (nodes + 5)
        case "a circle":
            words[7] = 0
        case "a cell that is not there":
            words[7 + 8 * (int(words[7 + 7]) & (LEAF - 1))] = 10**6
        case "a share that is no quarter":
            words[cells + 128] = np.float32(0.3).view(np.uint32)
        case "a share that is no number":
            words[cells + 128] = np.float32(np.inf).view(np.uint32)
        case "no light samples":
            words[cells + 131] = 0
        case "a histogram that contradicts itself":
            words[cells + 128] = np.float32(0.5).view(np.uint32)
            words[cells + 64] += 1
        case "floats":
            return words.astype(np.float32)
        case "two axes":
            return words[None]
    return words


@pytest.mark.parametrize(
    "how",
    [
        "short", "another format", "a wrong number of nodes", "a box without size", "a box that is no number",
        "a child that is not there", "a leaf that is not there", "a circle", "a cell that is not there",
        "a share that is no quarter", "a share that is no number", "no light samples",
        "a histogram that contradicts itself", "floats", "two axes",
    ],
)  # fmt: skip
def test_files_that_would_make_images_wrong_are_refused(tmp_path: Path, how: str) -> None:
    np.save(tmp_path / "a.npy", spoiled(grown()[0].field(final=True).words, how))  # type: ignore[arg-type]
    with pytest.raises(UsageError, match="is no guiding field"):
        GuidingField.read(tmp_path / "a.npy")


def test_other_files_are_refused(tmp_path: Path) -> None:
    (tmp_path / "a.npy").write_bytes(b"something else")
    with pytest.raises(UsageError, match="is no guiding field"):
        GuidingField.read(tmp_path / "a.npy")
    with pytest.raises(UsageError, match=r"nothing.npy"):
        GuidingField.read(tmp_path / "nothing.npy")


def test_rows_of_no_cells_are_one_that_nothing_refers_to() -> None:
    assert cell_rows(np.zeros((0, 128), np.uint32), np.zeros((0, 4))).shape == (1, layout.FIELD_WORDS)
    assert empty_field(np.zeros(3), 2.0).cell_count == 0


def test_a_job_carries_its_field() -> None:
    """To workers of a cluster: as an asset, whose hash is part of the request."""
    field, room = grown()[0].field(final=True), clrender.load("room")
    job = RenderJob.of(room, guiding_field=field)
    text, assets = job.to_json()
    again = RenderJob.from_json(text, assets)
    assert again.guiding_field is not None and again.guiding_field.sha256() == field.sha256()
    assert again.sha256() == job.sha256() != RenderJob.of(room, guiding="on").sha256()
    assets[field.sha256()] = assets[field.sha256()][:-4]
    with pytest.raises(UsageError, match="guiding field is missing or no field"):
        RenderJob.from_json(text, assets)
    with pytest.raises(UsageError, match="no effect with guiding auto"):
        RenderJob.of(room, guiding="auto", guiding_field=field)


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs a disk that is always full")
def test_a_full_disk_is_told() -> None:
    with (
        pytest.raises(OSError, match=os.strerror(errno.ENOSPC)) as told,
        Path("/dev/full").open("wb") as file,
    ):
        write_npy(file, np.zeros(1 << 20, np.uint32))
    assert told.value.errno == errno.ENOSPC


def test_a_scene_that_asks_for_guiding_may_be_rendered_by_others() -> None:
    content = clrender.load("room").model_dump(mode="json", exclude_unset=True)
    room = clrender.Scene.model_validate({**content, "render": {"guiding": "on"}})
    assert RenderJob.of(room).preparation == "clrender.guiding.preparation"
    photon, direct = RenderJob.of(room, integrator="photon"), RenderJob.of(room, integrator="direct")
    assert photon.preparation == "clrender.photon.maps" and direct.preparation == "" and not direct.guided
    assert "guiding" not in photon.request()
