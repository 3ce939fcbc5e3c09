"""`verify` finds what it says, as often as it says, and tells what is wrong: around a renderer that is none."""

from __future__ import annotations

import json
import math
import subprocess
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np
import pytest
from cases import for_each
from click.testing import CliRunner
from scipy.stats import binomtest, hypergeom

import clrender
from clrender.cli import main
from clrender.errors import ClrenderError, UsageError
from clrender.film import Film
from clrender.film.ledger import Ledger
from clrender.film.unit import Unit, UnitSums, tile_side
from clrender.image.exr_write import ExrFormat
from clrender.image.files import image_sha256, write_image
from clrender.rendering.job import RenderJob
from clrender.verification import detection_probability, least_detected, verify

SCENE = """
[camera]
position = [0.0, 0.0, -3.0]
target = [0.0, 0.0, 0.0]
[[lights]]
type = "environment"
radiance = [1.0, 1.0, 1.0]
"""
WIDTH, HEIGHT, SPP = 150, 66, 3  # 10 x 5 tiles of 16 x 16, some of them cut off
TILES = 50


def sums(seed: int) -> UnitSums:
    """Of all pixels, some exact numbers that depend on the seed."""
    side = tile_side(1024, WIDTH, HEIGHT)
    words = np.random.default_rng(seed).integers(0, 2**32, (side * side, 3, 4), np.uint32)
    words[..., 2], words[..., 3] = words[..., 2] % 4, 0  # up to 4, with 64 bits behind the point
    return UnitSums(words, np.full(side * side, SPP, np.uint32), np.full(side * side // 16, SPP, np.uint32), 0, 0, 0)


def truth(job: RenderJob) -> Film:
    """What the renderer gives for a job."""
    film = Film(WIDTH, HEIGHT, {**job.request(), "arrays_sha256": "a"})
    film.commit(Unit(0, film_side() ** 2, 0, SPP, film_side()), sums(job.settings.seed))
    return film


def film_side() -> int:
    return tile_side(1024, WIDTH, HEIGHT)


class Renderer:
    """In the place of a session: looks up what it should compute."""

    wanted: Ledger

    def __init__(self, device: Any = None, *, notify: Any = None) -> None:
        self.closed = False

    def __enter__(self) -> Renderer:
        return self

    def __exit__(self, *details: Any) -> None:
        self.closed = True

    def render_part(
        self, job: RenderJob, wanted: Ledger, check: Callable[[Mapping[str, Any]], None], on_progress: Any
    ) -> Film:
        film = truth(job)
        check(film.request)
        Renderer.wanted = film.ledger = wanted
        across = -(-WIDTH // 4)
        for block in np.flatnonzero(wanted.taken() == 0).tolist():
            rows, columns = (slice(4 * place, 4 * place + 4) for place in divmod(block, across))
            film.counts[rows, columns] = 0
            film.bands()[0][rows, columns] = 0
        return film


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The working folder, with a scene; nothing is rendered."""
    monkeypatch.setattr("clrender.verification.checking.Session", Renderer)
    monkeypatch.chdir(tmp_path)
    (tmp_path / "scene.toml").write_text(SCENE)
    return tmp_path


def job_of(time_at: float | None = None, **how: Any) -> RenderJob:
    return RenderJob.of(clrender.load("scene.toml", time_at=time_at), size=(WIDTH, HEIGHT), spp=SPP, **how)


def told(job: RenderJob, film: Film) -> dict[str, Any]:
    """Provenance of its files."""
    from clrender.rendering.statistics import job_stats

    samples = {"samples": film.ledger.samples, "nonfinite_samples": 0, "denoised": False}
    return {**job_stats(job, film.request), **samples, "image_sha256": image_sha256(film.mean())}


def saved(path: str = "a.film", change: Callable[[Film], None] = lambda film: None, **how: Any) -> Path:
    """A film, changed before it is written, whose provenance says no more than which scene it is of."""
    film = truth(job_of(**how))
    change(film)
    film.save(path, {"scene": {"name": "scene.toml"}})
    return Path(path)


def add(film: Film, row: int, column: int, channel: int, quanta: int) -> None:
    """Change a sum, as another sample would."""
    band = film.bands()[row // film.band_rows][row % film.band_rows, column, channel]
    total = (int(band[0]) + (int(band[1]) << 64) + quanta) % 2**128
    band[:] = total % 2**64, total >> 64


# --- what is found ---------------------------------------------------------------------------------------------------


def test_a_sound_film(folder: Path) -> None:
    found = verify(saved(), 1.0)
    assert found.sound and (found.tiles, found.checked) == (TILES, TILES)
    assert found.samples == WIDTH * HEIGHT * SPP == Renderer.wanted.samples
    assert found.detection(1) == 1.0 and found.detected() == 1


def test_each_changed_sample_is_found(folder: Path) -> None:
    """Any pixel, channel and change, down to the last quantum, either way."""
    rng = np.random.default_rng(4)
    for _ in range(30):
        film, row, column = truth(job_of()), int(rng.integers(HEIGHT)), int(rng.integers(WIDTH))
        quanta = int(rng.choice([-1, 1])) * 2 ** int(rng.integers(0, 64))
        add(film, row, column, int(rng.integers(3)), quanta)
        film.save("a.film", {"scene": {"name": "scene.toml"}})
        found = verify("a.film", 1.0)
        assert not found.sound and found.pixels == ((column, row),)
        assert f"the pixel in column {column} of row {row}" in found.faults[0]


def test_a_sample_that_was_left_out_is_found(folder: Path) -> None:
    def drop(film: Film) -> None:
        film.counts[17, 40] -= 1

    found = verify(saved(change=drop), 1.0)
    assert found.pixels == ((40, 17),) and found.differing == ((32, 16, 48, 32),)


@pytest.mark.long
@pytest.mark.parametrize("wrong", [1, 3, 8])
def test_a_share_finds_as_often_as_it_says(folder: Path, wrong: int) -> None:
    rng = np.random.default_rng(wrong)

    def spoil(film: Film) -> None:
        for tile in rng.choice(TILES, wrong, replace=False).tolist():
            add(film, tile // 10 * 16 + 1, tile % 10 * 16 + 2, 0, 1)

    path = saved(change=spoil)
    runs, hits, stated = 100, 0, 0.0
    for _ in range(runs):
        found = verify(path, 0.2)
        stated = found.detection(wrong)
        assert found.checked == 10 and found.tiles == TILES
        hits += not found.sound
    assert binomtest(hits, runs, stated).pvalue > 1e-4, (hits / runs, stated)


def test_the_choice_is_random_or_as_its_seed_says(folder: Path) -> None:
    path = saved()
    chosen = []
    for seed in (None, None, 5, 5):
        verify(path, 0.3, seed=seed)
        chosen.append(Renderer.wanted)
    assert chosen[0] != chosen[1] and chosen[2] == chosen[3]


def test_only_what_has_samples_is_drawn(folder: Path) -> None:
    """A film that was stopped: some blocks have a sample more, some none."""
    film = Film(WIDTH, HEIGHT, truth(job_of()).request)
    side = film_side()
    done = sums(0)
    partly = np.zeros_like(done.done)
    partly[:100] = SPP
    counts = np.where(np.repeat(partly, 16) > 0, done.counts, 0).astype(np.uint32)
    words = np.where(counts[:, None, None] > 0, done.sums, 0).astype(np.uint32)
    film.commit(Unit(0, side * side, 0, SPP, side), UnitSums(words, counts, partly, 0, 0, 0))
    film.save("part.film", {"scene": {"name": "scene.toml"}})
    found = verify("part.film", 1.0)
    assert found.sound and 0 < found.tiles < TILES and found.samples == film.ledger.samples


# --- what it looks like ----------------------------------------------------------------------------------------------


def sentence(path: Path, fraction: float = 1.0) -> str:
    found = verify(path, fraction)
    assert not found.sound
    (fault,) = found.faults
    return fault


def test_a_wrong_seed(folder: Path) -> None:
    def relabel(film: Film) -> None:
        film.request["seed"] = 9

    assert "another seed than recorded" in sentence(saved(change=relabel))


def test_another_image(folder: Path) -> None:
    def brighter(film: Film) -> None:
        for row in range(HEIGHT):
            for column in range(WIDTH):
                add(film, row, column, 0, 2**66)

    assert "another scene or with other settings than recorded" in sentence(saved(change=brighter))


def test_other_rounding(folder: Path) -> None:
    def rounded(film: Film) -> None:
        for band in film.bands():
            band[..., 0] ^= np.uint64(1 << 30)

    assert "but only by rounding" in sentence(saved(change=rounded))


def test_a_film_that_contradicts_itself(folder: Path) -> None:
    job = job_of()
    film = truth(job)
    film.save("a.film", {**told(job, film), "seed": 1})
    assert sentence(Path("a.film")) == "it contains contradictory values of seed: 0 and 1"
    film.save("b.film", {**told(job, film), "image_sha256": "0" * 64})
    assert "the hash of the pixels does not match" in sentence(Path("b.film"))
    film = truth(job)
    film.counts[0, 0] = 0
    film.save("c.film", {"scene": {"name": "scene.toml"}})
    assert "pixels without samples have nonzero sums" in sentence(Path("c.film"))


@pytest.mark.parametrize(
    ("key", "words"),
    [
        ("kernel_sha256", "was made by the kernels of clrender"),
        ("sampler_sha256", "was made by the kernels of clrender"),
        ("version", "the kernels of clrender x; those of this clrender"),
        ("scene_sha256", "was made from another scene"),
        ("arrays_sha256", "arrays made of the scene"),
    ],
)
def test_what_cannot_be_verified_here(folder: Path, key: str, words: str) -> None:
    def relabel(film: Film) -> None:
        film.request[key] = "x"

    with pytest.raises(UsageError, match=words):
        verify(saved(change=relabel))


def test_settings_that_there_are_not(folder: Path) -> None:
    def relabel(film: Film) -> None:
        film.request["sead"] = 9

    with pytest.raises(UsageError, match=r"a\.film: cannot be rendered again here"):
        verify(saved(change=relabel))


# --- where the scene is ----------------------------------------------------------------------------------------------


def test_the_scene_is_found_beside_the_image_or_named(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = saved().resolve()
    (folder / "else").mkdir()
    (folder / "away").mkdir()
    monkeypatch.chdir(folder / "else")
    assert verify(path).sound, "beside the image"
    moved = (folder / "scene.toml").rename(folder / "away" / "s.toml")
    with pytest.raises(
        UsageError, match=r"made from 'scene\.toml', which was not found; give its location with --scene"
    ):
        verify(path)
    assert verify(path, scene=moved).sound
    assert verify(path, scene=clrender.load(moved)).sound
    moved.write_text(SCENE.replace("-3.0", "-3.5"))
    with pytest.raises(UsageError, match="another scene, or the scene has changed since"):
        verify(path, scene=moved)


def test_a_scene_made_in_code_is_nowhere(folder: Path) -> None:
    truth(job_of()).save("a.film", {})
    with pytest.raises(UsageError, match="does not name its scene"):
        verify("a.film")


def test_what_a_scene_was_loaded_with_is_kept(folder: Path) -> None:
    Path("bare.toml").write_text(SCENE[: SCENE.index("[[lights]]")])
    scene = clrender.load("bare.toml", environment=0.5)
    assert scene.with_exposure(8.0, 0.1).origin == {"name": "bare.toml", "environment": 0.5}
    film = truth(RenderJob.of(scene, size=(WIDTH, HEIGHT), spp=SPP))
    film.save("a.film", {"scene": scene.origin})
    assert verify("a.film").sound
    with pytest.raises(UsageError, match="another scene"):
        verify("a.film", environment=0.6)


# --- images ----------------------------------------------------------------------------------------------------------


def image(path: str, how: Mapping[str, str], more: Mapping[str, Any] | None = None, spoil: int = 0) -> Path:
    """A picture of the film as `RenderedImage.save` writes it, of which a pixel may be changed."""
    job = job_of()
    film = truth(job)
    linear = film.mean()
    linear[20, 30] *= 1.0 + spoil
    display = path.endswith(".png")
    stored = {"tone_map": "srgb", "exposure": -2.0} if display else {"exr_type": "float", "exr_compression": "zip"}
    provenance = {**told(job, film), "stored": {**stored, **how}, "image_sha256": image_sha256(linear), **(more or {})}
    exr = ExrFormat(how.get("exr_type", "float"), how.get("exr_compression", "zip"))
    write_image(path, linear, provenance, "srgb", -2.0, exr=exr)
    return Path(path)


@pytest.mark.parametrize(
    ("name", "how"),
    [("a.exr", {}), ("a.exr", {"exr_type": "half"}), ("a.exr", {"exr_compression": "piz"}), ("a.png", {})],
)
def test_pictures(folder: Path, name: str, how: dict[str, str]) -> None:
    found = verify(image(name, how), 1.0)
    assert found.sound and found.checked == TILES
    found = verify(image(name, how, spoil=1), 1.0)
    assert found.pixels == ((30, 20),) and found.differing == ((16, 16, 32, 32),)


@pytest.mark.parametrize(
    ("name", "more", "how", "words"),
    [
        ("a.exr", {"denoised": True}, {}, "is denoised"),
        ("a.exr", {"samples": 17}, {}, "was stopped early, and only a .film records"),
        ("a.exr", {}, {"exr_compression": "dwaa"}, "the compression dwaa is lossy"),
        ("a.png", {"stored": {}}, {}, "does not record how its pixels were stored"),
        ("a.exr", {"settings": 3}, {}, "its settings are invalid"),
        ("a.exr", {"first_sample": -3}, {}, "cannot be rendered again here"),
        ("a.exr", {"settings": {"width": 3, "height": 4}}, {}, "was rendered in another size"),
    ],
)
def test_pictures_that_are_no_renders(
    folder: Path, name: str, more: dict[str, Any], how: dict[str, str], words: str
) -> None:
    with pytest.raises(UsageError, match=words):
        verify(image(name, how, more))


def test_files_that_say_nothing(folder: Path) -> None:
    write_image("a.exr", np.zeros((4, 4, 3), np.float32))
    write_image("b.exr", np.zeros((4, 4, 3), np.float32), {"seed": 1})
    write_image("c.npy", np.zeros((4, 4, 3), np.float32))
    for name, words in (
        ("a.exr", "does not contain its settings"),
        ("b.exr", "settings is missing"),
        ("c.npy", "only .film, .exr"),
    ):
        with pytest.raises(UsageError, match=words):
            verify(name)
    for fraction in (0.0, 1.1, math.nan):
        with pytest.raises(UsageError, match="above 0 and at most 1"):
            verify(saved(), fraction)
    Path("set/images").mkdir(parents=True)
    Path("set/manifest.json").write_text("{}")
    write_image("set/images/a.exr", np.zeros((4, 4, 3), np.float32))
    with pytest.raises(UsageError, match=r"it belongs to a data set, which `clrender verify .*set` checks"):
        verify("set/images/a.exr")


JUNK: list[Any] = [None, 3, -1, 2**70, 0.5, "x", "\0", [], [1], {}, {"x": 1}, True, 1e300]


@pytest.mark.parametrize("name", ["a.png", "a.exr", "a.film"])
def test_whatever_a_file_says_ends_in_a_sentence(folder: Path, name: str) -> None:
    """Anything in the place of anything: an error that users understand, a fault, or no matter."""
    job = job_of(time_at=1.0)
    film = truth(job)
    stored = {"tone_map": "srgb", "exposure": -2.0} if name == "a.png" else {"exr_type": "float"}
    good = {**told(job, film), "stored": {**stored, "exr_compression": "zip"}, "scene": {"name": "scene.toml"}}
    good["scene"] = {**good["scene"], "time_at": 1.0, "variant": "x"}
    if name != "a.film":
        write_image(name, film.mean(), good, "srgb", -2.0)
    else:
        film.save(name, good)
    assert verify(name).sound
    rng, ends = np.random.default_rng(3), 0
    for _ in range(150):
        said, place = json.loads(json.dumps({**good, "request": film.request})), str(rng.choice(sorted(good)))
        inner = said[place]
        junk = JUNK[int(rng.integers(len(JUNK)))]
        if isinstance(inner, dict) and inner and rng.random() < 0.7:
            inner[str(rng.choice(sorted(inner)))] = junk
        else:
            said[place] = junk
        claim = {key: value for key, value in said.items() if key != "request"}
        try:
            with monkeypatched_provenance(name, claim, film):
                ends += not verify(name).sound
        except ClrenderError as error:
            ends += 1
            assert name in str(error) or "scene.toml" in str(error)
    assert ends > 30


@contextmanager
def monkeypatched_provenance(name: str, claim: dict[str, Any], film: Film) -> Iterator[None]:
    """While it lasts, a file says something else, and so does a film's request."""
    settings = claim.get("settings")
    request = {**film.request, **(settings if isinstance(settings, dict) else {})}
    request.pop("spp", None)
    if name == "a.film":
        film.request, before = request, film.request
        film.save(name, claim)
        film.request = before
    with patch("clrender.verification.claim.read_provenance", lambda path: claim):
        yield


def test_another_hash_than_it_says(folder: Path) -> None:
    assert "the hash of the pixels does not match" in sentence(image("a.exr", {}, {"image_sha256": "0" * 64}), 0.1)


@pytest.mark.parametrize("spp", [10**12, -1, None])
def test_another_number_of_samples_than_its_settings_say(folder: Path, spp: Any) -> None:
    assert f"it contains contradictory values of spp: {spp} and " in sentence(image("a.exr", {}, {"spp": spp}), 0.1)


# --- how surely ------------------------------------------------------------------------------------------------------


@for_each(("total", "checked"), [(1, 1), (7, 3), (50, 10), (2500, 250), (2500, 2400)])
def test_probabilities_are_those_of_the_hypergeometric_distribution(total: int, checked: int) -> None:
    for wrong in {0, 1, total // 3, total // 2, total - checked, total - checked + 1, total}:
        expected = hypergeom.sf(0, total, wrong, checked)
        assert detection_probability(total, checked, wrong) == pytest.approx(expected, abs=1e-12)
    least = least_detected(total, checked, 0.95)
    assert detection_probability(total, checked, least) >= 0.95
    assert least == 1 or detection_probability(total, checked, least - 1) < 0.95


# --- the command -----------------------------------------------------------------------------------------------------


def command(*arguments: str) -> subprocess.CompletedProcess[str]:
    done = CliRunner().invoke(main, ["verify", *arguments, "--quiet"])
    return subprocess.CompletedProcess(arguments, done.exit_code, done.stdout, done.stderr)


def test_the_command_says_how_surely(folder: Path) -> None:
    saved()
    done = command("a.film", "--fraction", "0.2")
    assert done.returncode == 0 and not done.stderr
    assert done.stdout.startswith("a.film: 10 of 50 tiles rendered again (")
    assert (
        "if 12 or more of the 50 tiles were wrong, this check would have detected it with probability 95."
        in done.stdout
    )
    assert "a single wrong tile with 20.0%" in done.stdout
    assert "50 of 50 tiles" in command("a.film", "--fraction", "1").stdout
    numbers = json.loads(command("a.film", "--json", "--seed", "3").stdout)
    assert numbers["sound"] and numbers["detected_95"] == least_detected(50, 5, 0.95) and numbers["checked"] == 5


def test_the_command_says_what_is_wrong(folder: Path) -> None:
    saved(change=lambda film: add(film, 3, 4, 1, 1))
    done = command("a.film", "--fraction", "1")
    assert done.returncode == 1 and not done.stdout
    assert done.stderr.startswith("error: a.film: verification failed: 1 of 50 tiles") and done.stderr.count("\n") == 1
    numbers = command("a.film", "--fraction", "1", "--json")
    assert numbers.returncode == 1 and json.loads(numbers.stdout)["pixels"] == [[4, 3]]


def test_the_command_s_bad_uses(folder: Path) -> None:
    saved()
    for arguments in (("b.film",), ("a.film", "--fraction", "0"), ("a.film", "--fraction", "2"), ("scene.toml",)):
        done = command(*arguments)
        assert done.returncode == 2 and done.stderr.startswith("error: ") and done.stderr.count("\n") == 1
