"""Image files: every bit comes back, provenance is inside, and no file is ever half written."""

from __future__ import annotations

import errno
import hashlib
import io
import json
import os
import random
import resource
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Any, cast

import numpy as np
import numpy.typing as npt
import pytest
from cases import for_each
from PIL import Image

import clrender
from clrender.errors import ClrenderError, RenderError, UsageError
from clrender.files.access import atomic_write, check_writable, open_input
from clrender.film import Film
from clrender.image.files import OUTPUT_ENDINGS, check_output, image_sha256, read_image, read_provenance, write_image
from clrender.image.radiance_hdr import read_hdr, write_hdr
from clrender.image.tone_map import srgb_decode, to_display

Picture = npt.NDArray[np.float32]
IMAGE_ENDINGS = [ending for ending in OUTPUT_ENDINGS if ending != ".film"]
PROVENANCE = {"seed": 3, "title": "Žluťoučký kůň", "nested": {"list": [1, 2.5, None]}}


def picture(height: int = 13, width: int = 17) -> Picture:
    """Radiance of many magnitudes."""
    rng = np.random.default_rng(5)
    return (10.0 ** rng.uniform(-8, 8, (height, width, 3))).astype(np.float32)


def odd_picture() -> Picture:
    """Values that only a bit-exact format keeps."""
    values = picture()
    odd = [-1, -0.0, 0, 1e-45, -1e-45, 1e-38, 3e38, -3e38, 65504, 65536, 1e9, 1e-9, 2, 2, 2, 0.1, 0.1, 0.1]
    values[0, :6] = np.reshape(odd, (6, 3))
    return values


# --- formats ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("ending", [".exr", ".npy"])
def test_linear_files_keep_every_bit(tmp_path: Path, ending: str) -> None:
    image = odd_picture()
    write_image(tmp_path / f"a{ending}", image, PROVENANCE)
    loaded = read_image(tmp_path / f"a{ending}")
    assert loaded.dtype == np.float32 and loaded.tobytes() == image.tobytes()


@pytest.mark.parametrize("ending", [".exr", ".png"])
def test_provenance_is_inside(tmp_path: Path, ending: str) -> None:
    write_image(tmp_path / f"a{ending}", picture(), PROVENANCE)
    assert read_provenance(tmp_path / f"a{ending}") == PROVENANCE
    write_image(tmp_path / f"b{ending}", picture())
    assert read_provenance(tmp_path / f"b{ending}") is None


def test_png_is_the_toned_image_with_an_itxt_chunk(tmp_path: Path) -> None:
    image = picture()
    write_image(tmp_path / "a.png", image, PROVENANCE, "reinhard", -2.0)
    with Image.open(tmp_path / "a.png") as file:
        np.testing.assert_array_equal(np.asarray(file), to_display(image, "reinhard", -2.0))
    assert b"iTXtclrender\0" in (tmp_path / "a.png").read_bytes()


def test_jpeg_is_close_to_the_toned_image(tmp_path: Path) -> None:
    y, x = np.mgrid[0:64, 0:64]
    image = np.stack([x / 64, y / 64, 0.3 + 0 * x], -1).astype(np.float32)
    write_image(tmp_path / "a.jpg", image)
    with Image.open(tmp_path / "a.jpg") as file:
        difference = np.asarray(file).astype(int) - to_display(image)
    assert np.abs(difference).mean() < 2


def test_png_reads_back_as_linear_light(tmp_path: Path) -> None:
    image = picture()
    write_image(tmp_path / "a.png", image)
    expected = srgb_decode(to_display(image) / 255.0).astype(np.float32)
    np.testing.assert_array_equal(read_image(tmp_path / "a.png"), expected)


@pytest.mark.parametrize("width", [1, 7, 8, 300])
def test_hdr_keeps_eight_bits_of_the_largest_channel(tmp_path: Path, width: int) -> None:
    image = picture(5, width)
    write_image(tmp_path / "a.hdr", image)
    loaded = read_image(tmp_path / "a.hdr")
    assert (np.abs(loaded - image).max(axis=2) <= image.max(axis=2) / 256).all()


def test_hdr_of_odd_values() -> None:
    odd = np.array([[[0, 0, 0], [-1, np.nan, 2], [3e38, np.inf, 1], [1e-39, 0, 0], [1e-45, 0, 0]]], np.float32)
    data = io.BytesIO()
    write_hdr(data, odd)
    data.seek(0)
    loaded = read_hdr(data)
    assert np.isfinite(loaded).all() and (loaded >= 0).all()
    assert not loaded[0, 0].any() and loaded[0, 1, 2] == pytest.approx(2, rel=0.01) and loaded[0, 2, 0] > 1e38


def test_hdr_with_run_lengths() -> None:
    # Two rows of 10 pixels as other programs write them: a run, then literal bytes, for each of four planes.
    row = (
        b"\2\2\0\12" + b"".join(bytes([128 + 6, value, 4, 1, 2, 3, 200]) for value in (128, 64, 32)) + bytes([138, 129])
    )
    loaded = read_hdr(io.BytesIO(b"#?RADIANCE\n# note\nFORMAT=32-bit_rle_rgbe\n\n-Y 2 +X 10\n" + row * 2))
    assert loaded.shape == (2, 10, 3)
    np.testing.assert_array_equal(loaded[0, 0], np.array([128.5, 64.5, 32.5]) / 128)
    np.testing.assert_array_equal(loaded[1, 9], np.array([200.5] * 3) / 128)


def test_the_hash_is_that_of_the_bytes() -> None:
    image = picture()
    expected = hashlib.sha256(image.astype("<f4").tobytes()).hexdigest()
    assert (
        image_sha256(image)
        == expected
        == image_sha256(image.astype(np.float64))
        == image_sha256(np.asfortranarray(image))
    )


def test_equal_images_make_equal_files(tmp_path: Path) -> None:
    for ending in IMAGE_ENDINGS:
        for name in "ab":
            write_image(tmp_path / f"{name}{ending}", picture(), PROVENANCE)
        assert (tmp_path / f"a{ending}").read_bytes() == (tmp_path / f"b{ending}").read_bytes()


# --- bad files and places --------------------------------------------------------------------------------------------


@for_each("ending", IMAGE_ENDINGS)
@for_each("damage", ["empty", "text", "half", "missing", "folder"])
def test_damaged_images_are_refused_in_one_sentence(tmp_path: Path, ending: str, damage: str) -> None:
    path = tmp_path / f"a{ending}"
    write_image(path, picture(40, 50))
    data = path.read_bytes()
    path.unlink()
    if damage == "folder":
        path.mkdir()
    elif damage != "missing":
        path.write_bytes({"empty": b"", "text": b"no image\n" * 9, "half": data[: len(data) // 2]}[damage])
    with pytest.raises(UsageError) as caught:
        read_image(path)
    assert str(path) in str(caught.value) and "\n" not in str(caught.value)


@for_each(
    "array",
    [np.zeros((3, 4)), np.zeros((3, 4, 4)), np.zeros((3, 4, 3), int), np.array([[["x"] * 3]]), np.zeros((0, 4, 3))],
)
def test_arrays_that_are_no_image_are_refused(tmp_path: Path, array: npt.NDArray[Any]) -> None:
    np.save(tmp_path / "a.npy", array)
    with pytest.raises(UsageError, match=r"a\.npy"):
        read_image(tmp_path / "a.npy")


def test_a_huge_size_takes_no_memory(tmp_path: Path) -> None:
    header = io.BytesIO()
    np.lib.format.write_array_header_1_0(header, {"descr": "<f4", "fortran_order": False, "shape": (2**31, 2**31, 3)})
    (tmp_path / "a.npy").write_bytes(header.getvalue())
    (tmp_path / "a.hdr").write_bytes(b"#?RADIANCE\n\n-Y 999999999 +X 999999999\n")
    for name in ("a.npy", "a.hdr"):
        with pytest.raises(UsageError, match="pixels are not between"):
            read_image(tmp_path / name)


def test_pickles_are_not_opened(tmp_path: Path) -> None:
    np.save(tmp_path / "a.npy", np.array([{}], object), allow_pickle=True)
    with pytest.raises(UsageError):
        read_image(tmp_path / "a.npy")


@for_each("name", ["a.gif", "a", "a.exr.bak", "png", ".png"])
def test_unknown_endings_are_refused(tmp_path: Path, name: str) -> None:
    with pytest.raises(UsageError, match=r"end it in \.png"):
        check_output(tmp_path / name)
    with pytest.raises(UsageError, match="ending"):
        write_image(tmp_path / name, picture())
    with pytest.raises(UsageError, match="ending"):
        read_image(tmp_path / name)
    assert list(tmp_path.iterdir()) == []


def bad_places(folder: Path) -> list[Path]:
    (folder / "folder.png").mkdir()
    (folder / "file").write_text("")
    os.mkfifo(folder / "pipe.png")
    (folder / "loop.png").symlink_to("loop.png")
    return [
        folder / "missing" / "a.png",
        folder / "folder.png",
        folder / "file" / "a.png",
        folder / "pipe.png",
        folder / ("n" * 300 + ".png"),
        Path("/proc/a.png"),
    ]


def test_bad_places_are_refused_before_and_while_writing(tmp_path: Path) -> None:
    for path in bad_places(tmp_path):
        with pytest.raises(UsageError) as before:
            check_output(path)
        with pytest.raises(ClrenderError) as during:
            write_image(path, picture())
        for caught in (before, during):
            assert str(path) in str(caught.value) and "\n" not in str(caught.value)
    assert (tmp_path / "pipe.png").is_fifo()
    assert not [path for path in tmp_path.iterdir() if path.name.endswith(".part")]


def test_a_check_leaves_nothing_behind(tmp_path: Path) -> None:
    check_output(tmp_path / "a.png")
    check_writable(tmp_path / "numbers.json")
    assert list(tmp_path.iterdir()) == []


# --- whole or not at all ---------------------------------------------------------------------------------------------


def test_a_failure_leaves_the_old_file(tmp_path: Path) -> None:
    path = tmp_path / "a.png"
    path.write_bytes(b"old")
    with pytest.raises(ZeroDivisionError), atomic_write(path) as file:
        file.write(b"new")
        raise ZeroDivisionError
    assert path.read_bytes() == b"old"
    assert [entry.name for entry in tmp_path.iterdir()] == ["a.png"]


def test_rights_follow_the_umask_and_the_old_file(tmp_path: Path) -> None:
    old = os.umask(0o027)
    try:
        with atomic_write(tmp_path / "new") as file:
            file.write(b"1")
    finally:
        os.umask(old)
    assert (tmp_path / "new").stat().st_mode & 0o777 == 0o640
    (tmp_path / "new").chmod(0o604)
    with atomic_write(tmp_path / "new") as file:
        file.write(b"2")
    assert (tmp_path / "new").stat().st_mode & 0o777 == 0o604


WRITER = """
import sys, time
from clrender.files.access import atomic_write
with atomic_write("a.png") as file:
    print("writing", flush=True)
    time.sleep(600)
"""


def test_what_killed_processes_left_is_removed_and_what_others_write_is_not(tmp_path: Path) -> None:
    command = [sys.executable, "-c", WRITER]
    environment = {**os.environ, "PYTHONPATH": str(Path(clrender.__path__[0]).parent)}
    processes = [
        subprocess.Popen(command, cwd=tmp_path, env=environment, stdout=subprocess.PIPE, text=True) for _ in range(2)
    ]
    try:
        for process in processes:
            assert process.stdout is not None and process.stdout.readline() == "writing\n"
        processes[0].kill()
        processes[0].wait()
        (tmp_path / ".clrender-notes.part").write_text("not ours")
        (tmp_path / ".clrender-1-0123456789ab.part").symlink_to(tmp_path / ".clrender-notes.part")
        assert len(list(tmp_path.glob(".clrender-*-*.part"))) == 3
        check_writable(tmp_path / "b.png")
        left = sorted(path.name for path in tmp_path.iterdir())
        assert left == sorted(
            [".clrender-1-0123456789ab.part", ".clrender-notes.part"]
            + [path.name for path in tmp_path.glob(f".clrender-{processes[1].pid}-*.part")]
        )
        assert len(left) == 3, "the file of the process that lives"
    finally:
        for process in processes:
            process.kill()
            process.communicate()


def test_a_file_taken_for_a_left_one_before_it_was_locked_is_begun_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from clrender.files import access as files

    lock, taken = files._lock, list[Path]()

    def slow_lock(descriptor: int) -> None:
        if not taken:
            (part,) = tmp_path.glob(".clrender-*.part")
            files._remove_if_left(part)
            taken.append(part)
        lock(descriptor)

    monkeypatch.setattr(files, "_lock", slow_lock)
    with atomic_write(tmp_path / "new") as file:
        file.write(b"1")
    assert taken and (tmp_path / "new").read_bytes() == b"1" and len(list(tmp_path.iterdir())) == 1


def test_threads_write_beside_each_other(tmp_path: Path) -> None:
    def write(number: int) -> None:
        for _ in range(50):
            with atomic_write(tmp_path / "one") as file:
                file.write(bytes([number]) * 5000)

    with ThreadPoolExecutor(8) as pool:
        list(pool.map(write, range(8)))
    data = (tmp_path / "one").read_bytes()
    assert len(data) == 5000 and len(set(data)) == 1 and len(list(tmp_path.iterdir())) == 1


def test_links_are_written_through(tmp_path: Path) -> None:
    (tmp_path / "far").mkdir()
    (tmp_path / "link.png").symlink_to(tmp_path / "far" / "real.png")
    write_image(tmp_path / "link.png", picture())
    assert (tmp_path / "link.png").is_symlink()
    assert read_image(tmp_path / "far" / "real.png").shape == (13, 17, 3)


def save_film(path: Path) -> None:
    Film(200, 200).save(path)


WRITERS: dict[str, Callable[[Path], None]] = {
    **{ending: lambda path: write_image(path, picture(200, 200), PROVENANCE) for ending in IMAGE_ENDINGS},
    ".film": save_film,
}


@contextmanager
def largest_file(size: int) -> Iterator[None]:
    """No file may grow beyond `size`, as on a disk without room."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


@pytest.mark.parametrize("ending", WRITERS)
def test_no_room_is_one_sentence_and_leaves_nothing(tmp_path: Path, ending: str) -> None:
    path = tmp_path / f"a{ending}"
    with largest_file(4096), pytest.raises(RenderError) as caught:
        WRITERS[ending](path)
    assert str(path) in str(caught.value) and "no room is left" in str(caught.value)
    assert list(tmp_path.iterdir()) == []
    with largest_file(0), pytest.raises(UsageError, match="no room is left"):
        check_output(path)


class FullDisk(io.RawIOBase):
    """A file on a disk that fills up after `room` bytes."""

    def __init__(self, file: IO[bytes], room: int) -> None:
        self._file, self._room = file, room

    def writable(self) -> bool:
        return True

    def seekable(self) -> bool:
        return True

    def fileno(self) -> int:
        return self._file.fileno()

    def tell(self) -> int:
        return self._file.tell()

    def seek(self, offset: int, whence: int = 0) -> int:
        return self._file.seek(offset, whence)

    def write(self, data: Any) -> int:
        size = memoryview(data).nbytes
        if size > self._room:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        self._room -= size
        return self._file.write(data)

    def close(self) -> None:
        self._file.close()
        super().close()


@pytest.mark.parametrize("ending", WRITERS)
def test_a_full_disk_is_one_sentence_and_leaves_the_old_file(
    tmp_path: Path, ending: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / f"a{ending}"
    path.write_bytes(b"old")
    real = os.fdopen
    monkeypatch.setattr("clrender.files.access.os.fdopen", lambda *args: FullDisk(cast(IO[bytes], real(*args)), 2000))
    with pytest.raises(RenderError, match=r"a\..*no room is left \(No space left on device\)"):
        WRITERS[ending](path)
    assert path.read_bytes() == b"old" and len(list(tmp_path.iterdir())) == 1


WRITERS_TO_KILL = """
import os
import sys
import numpy as np
from pathlib import Path
from clrender.film import Film
from clrender.image.files import write_image
path = Path(sys.argv[1])
noise = np.random.default_rng(0).random((2, 220, 220, 3)).astype(np.float32)
film = Film(150, 150)
for line in sys.stdin:
    writer = os.fork()
    if writer == 0:
        break
    print(writer, flush=True)
    os.waitpid(writer, 0)
    print("gone", flush=True)
else:
    sys.exit()
turn = 0
while True:
    turn += 1
    film.save(path / "a.film", {"turn": turn})
    for ending in ("png", "exr", "npy", "hdr"):
        write_image(path / f"a.{ending}", noise[turn % 2], {"turn": turn})
"""
"""A process that forks a writer for each line that it reads, so that only one has to import all that."""


@pytest.mark.thorough
@pytest.mark.parametrize("kills", [12, pytest.param(100, marks=pytest.mark.slow)])
def test_a_killed_writer_leaves_whole_files(tmp_path: Path, kills: int) -> None:
    """Whatever lies there under its own name is complete. A writer in place is found by every second kill."""
    rng = random.Random(8)
    formats = {".film", ".png", ".exr", ".npy", ".hdr"}
    command = [sys.executable, "-c", WRITERS_TO_KILL, str(tmp_path)]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as parent:
        assert parent.stdin is not None and parent.stdout is not None
        for turn in range(kills):
            print(file=parent.stdin, flush=True)
            writer = int(parent.stdout.readline())
            if turn == 0:
                # However slow the machine, each format is there once before anything is killed.
                while {path.suffix for path in tmp_path.glob("a.*")} != formats:
                    time.sleep(0.01)
            time.sleep(rng.uniform(0.0, 0.12))
            os.kill(writer, signal.SIGKILL)
            assert parent.stdout.readline() == "gone\n"
            for path in tmp_path.glob("a.*"):
                if path.suffix == ".film":
                    assert Film.load(path).provenance["turn"] > 0
                else:
                    assert read_image(path).shape == (220, 220, 3)
    assert {path.suffix for path in tmp_path.glob("a.*")} == formats


def test_open_input_names_what_is_missing(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="no such file"), open_input(tmp_path / "none.exr"):
        pass
    write_image(tmp_path / "a.png", picture(), {"x": 1})
    assert json.dumps(read_provenance(tmp_path / "a.png")) == '{"x": 1}'
