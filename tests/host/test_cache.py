"""The cache: whose folder it is, what a full or missing one costs, and what a process that dies takes with it."""

from __future__ import annotations

import json
import mmap
import os
import shutil
import stat
import subprocess
import sys
import threading
import time
from pathlib import Path
from typing import Any

import pytest

from clrender.device import cache, program_cache
from clrender.drivers import discover
from clrender.drivers.discover import Driver
from clrender.errors import DeviceError

ROOT = str(Path(cache.__file__).parents[2])


@pytest.fixture(autouse=True)
def _own_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.delenv("POCL_CACHE_DIR", raising=False)


@pytest.fixture
def temporary(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The one place for temporary folders, where no other cache can be; open to all, as /tmp is."""
    blocker = tmp_path / "file"
    blocker.touch()
    monkeypatch.setenv("XDG_CACHE_HOME", str(blocker))
    place = tmp_path / "tmp"
    place.mkdir()
    place.chmod(0o1777)
    monkeypatch.setenv("TMPDIR", str(place))
    monkeypatch.setattr(cache, "_TEMPORARY_PLACES", ())
    return place


def planted(folder: Path) -> None:
    """Somebody's binary, checksum and all."""
    before = os.environ["XDG_CACHE_HOME"]
    os.environ["XDG_CACHE_HOME"] = str(folder.parent / "of-another")
    program_cache.store_binary("key", b"evil")
    assert program_cache.load_binary("key") == b"evil"
    os.environ["XDG_CACHE_HOME"] = before
    shutil.rmtree(folder, ignore_errors=True)  # a thread of an earlier test may just have made it
    (folder.parent / "of-another" / "clrender").rename(folder)


def test_a_folder_of_ones_own_takes_the_place_of_one_that_cannot_be_written(temporary: Path) -> None:
    folder = cache.cache_folder()
    assert folder == temporary / f"clrender-cache-{os.geteuid()}"
    assert stat.S_IMODE(folder.stat().st_mode) == 0o700
    program_cache.store_binary("key", b"mine")
    assert program_cache.load_binary("key") == b"mine"


@pytest.mark.parametrize("mode", [0o777, 0o770, 0o702])
def test_nothing_is_loaded_from_a_folder_that_others_may_write(temporary: Path, mode: int) -> None:
    folder = temporary / f"clrender-cache-{os.geteuid()}"
    planted(folder)
    folder.chmod(mode)
    assert cache.cache_folder() is None
    assert program_cache.load_binary("key") is None


def test_nothing_is_loaded_from_a_folder_of_another_user(temporary: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    another = os.geteuid() + 1
    folder = temporary / f"clrender-cache-{another}"
    planted(folder)
    monkeypatch.setattr(os, "geteuid", lambda: another)
    assert cache.cache_folder() is None
    assert program_cache.load_binary("key") is None


def test_nothing_is_loaded_through_a_link(temporary: Path) -> None:
    planted(temporary / "elsewhere")
    (temporary / f"clrender-cache-{os.geteuid()}").symlink_to(temporary / "elsewhere")
    assert cache.cache_folder() is None
    assert program_cache.load_binary("key") is None


@pytest.mark.parametrize(("mode", "fits"), [(0o777, False), (0o775, False), (0o1777, True), (0o755, True)])
def test_nor_from_below_a_folder_where_others_may_rename(tmp_path: Path, mode: int, fits: bool) -> None:
    folder = cache.cache_folder()
    assert folder == tmp_path / "cache" / "clrender"
    (tmp_path / "cache").chmod(mode)
    assert (cache.cache_folder() == folder) == fits
    assert bool(cache.no_cache_reason()) != fits


def test_a_relative_cache_folder_is_none(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("XDG_CACHE_HOME", "here")
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    assert cache.cache_folder() == tmp_path / "home" / ".cache" / "clrender"
    assert not (tmp_path / "here").exists()


def test_a_user_without_a_home(temporary: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def no_home() -> Path:
        raise RuntimeError("Could not determine home directory.")

    monkeypatch.delenv("XDG_CACHE_HOME")
    monkeypatch.setattr(Path, "home", no_home)
    assert cache.cache_folder() == temporary / f"clrender-cache-{os.geteuid()}"


def test_without_room_nothing_is_kept_and_nothing_fails(temporary: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cache, "ROOM_BYTES", 1 << 62)
    cache.process_folder.cache_clear()
    assert cache.cache_folder() is None
    program_cache.store_binary("key", b"binary")
    cache.write_json("drivers/x.json", {})
    assert program_cache.load_binary("key") is None
    assert cache.read_json("drivers/x.json") is None
    program_cache.limit_compiler_folder()
    sentinel = program_cache.Sentinel()
    sentinel.put("key")
    sentinel.take()
    assert "POCL_CACHE_DIR" not in discover.driver_variables()
    with pytest.raises(DeviceError, match="MiB are free in none; make room"):
        discover.load_platforms([Driver("/nowhere/libpocl.so", "pocl.icd")])
    cache.process_folder.cache_clear()


def test_a_folder_that_another_process_removes_meanwhile_is_passed_over(monkeypatch: pytest.MonkeyPatch) -> None:
    folder = program_cache.compiler_folder()
    assert folder is not None
    (folder / "pocl" / "goes").mkdir(parents=True)
    scan = os.scandir

    def late(path: Any) -> Any:
        if str(path).endswith("goes"):
            (folder / "pocl" / "goes").rmdir()
        return scan(path)

    monkeypatch.setattr(os, "scandir", late)
    program_cache.limit_compiler_folder()
    assert not (folder / "pocl" / "goes").exists()


def test_without_a_cache_what_is_compiled_lies_in_a_folder_of_the_process(temporary: Path) -> None:
    (temporary / f"clrender-cache-{os.geteuid()}").symlink_to(temporary)
    code = (
        f"import sys; sys.path.insert(0, {ROOT!r})\n"
        "from clrender.device import cache, program_cache\ncache._TEMPORARY_PLACES = ()\n"
        "folder = program_cache.compiler_folder()\nassert folder.is_dir() and cache.is_private(folder)\nprint(folder)\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert Path(done.stdout.strip()).parent == temporary
    assert not Path(done.stdout.strip()).exists()


def test_folders_of_killed_processes_go_when_the_next_is_made(temporary: Path) -> None:
    code = (
        f"import os, sys; sys.path.insert(0, {ROOT!r})\n"
        "from clrender.device import cache\nwith cache.temporary_folder():\n    os.kill(os.getpid(), 9)\n"
    )
    with subprocess.Popen([sys.executable, "-c", code]) as killed:
        pass
    (left,) = temporary.glob(f"*-{killed.pid}-*")
    with cache.temporary_folder() as mine:
        assert mine.is_dir() and not left.exists()
    assert not mine.exists()


def test_a_kept_binary_with_one_wrong_byte_is_not_used() -> None:
    program_cache.store_binary("key", b"binary")
    assert program_cache.load_binary("key") == b"binary"
    path = folder_of_compiled() / "programs" / "key"
    data = bytearray(path.read_bytes())
    data[-1] ^= 1
    path.write_bytes(bytes(data))
    assert program_cache.load_binary("key") is None
    assert not path.exists()


def folder_of_compiled() -> Path:
    folder = program_cache.compiler_folder()
    assert folder is not None
    return folder


def pocl_program(name: str, written: float, loaded: float) -> Path:
    """A program as it lies in PoCL's cache."""
    folder = folder_of_compiled() / "pocl" / "AB" / name
    folder.mkdir(parents=True)
    for file, when in (("program.bc", written), ("last_accessed", loaded)):
        (folder / file).touch()
        os.utime(folder / file, (when, when))
    return folder


def die(how: str) -> None:
    """End a process that compiles what is kept as ``mine``."""
    code = (
        f"import os, sys; sys.path.insert(0, {ROOT!r})\n"
        f"from clrender.device import program_cache\nprogram_cache.Sentinel().put('mine')\n{how}\n"
    )
    subprocess.run([sys.executable, "-c", code], check=False)


KILLED = "os.kill(os.getpid(), 9)"
INTERRUPTED = "program_cache.leave(); os._exit(130)"


@pytest.mark.parametrize("how", [KILLED, INTERRUPTED, "os.abort()"])
def test_a_process_that_ends_while_it_compiles_costs_what_it_compiled_and_no_more(how: str) -> None:
    before = folder_of_compiled()
    program_cache.store_binary("mine", b"half")
    program_cache.store_binary("other", b"whole")
    for key in ("mine", "other"):
        program_cache.note_run(key)
    now = time.time()
    old, loaded, written = (pocl_program(*each) for each in (("old", 0, 0), ("loaded", 0, now), ("written", now, now)))
    die(how)
    assert folder_of_compiled() == before
    assert program_cache.load_binary("mine") is None
    assert program_cache.load_binary("other") == b"whole"
    assert [program_cache.has_run(key) for key in ("mine", "other")] == [False, True]
    assert [old.exists(), written.exists()] == [True, False]
    # One that was loaded may be what it died of, unless somebody wanted it to end.
    assert loaded.exists() == (how == INTERRUPTED)


@pytest.mark.parametrize("how", [KILLED, "os.abort()"])
def test_what_another_process_runs_is_kept(how: str) -> None:
    """A killed process cannot have damaged what others have in their memory and run."""
    now = time.time()
    used, unused = pocl_program("used", 0, now), pocl_program("unused", 0, now)
    for entry in (used, unused):
        (entry / "kernel" / "16-1-1").mkdir(parents=True)
        (entry / "kernel" / "16-1-1" / "kernel.so").write_bytes(b"code")
    with (
        (used / "kernel" / "16-1-1" / "kernel.so").open("rb") as file,
        mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ),
    ):
        die(how)
        folder_of_compiled()
        assert [used.exists(), unused.exists()] == [True, False]


def test_a_process_that_ends_well_costs_nothing() -> None:
    program_cache.store_binary("mine", b"whole")
    die("")
    assert program_cache.load_binary("mine") == b"whole"


def test_two_devices_have_a_sentinel_each() -> None:
    first, second = program_cache.Sentinel(), program_cache.Sentinel()
    first.put("mine")
    second.put("other")
    busy = folder_of_compiled().parent / "busy"
    assert len(list(busy.iterdir())) == 2
    first.take()
    (left,) = busy.iterdir()
    assert json.loads(left.read_text())["keys"] == ["other"]
    second.take()
    assert not list(busy.iterdir())


def test_nothing_is_removed_while_another_process_compiles() -> None:
    sentinel = program_cache.Sentinel()
    sentinel.put("other")
    program_cache.store_binary("mine", b"half")
    die(KILLED)
    assert program_cache.load_binary("mine") == b"half"
    sentinel.take()
    assert program_cache.load_binary("mine") is None


def test_nobody_begins_to_compile_while_something_is_removed(monkeypatch: pytest.MonkeyPatch) -> None:
    """Else what a compiler has just written would be gone before it reads it."""
    folder, sentinel, purge = folder_of_compiled(), program_cache.Sentinel(), program_cache._purge
    (folder / "pocl").mkdir()
    die(KILLED)
    written = threading.Event()

    def compile_something() -> None:
        sentinel.put("other")
        (folder / "pocl" / "tempfile").touch()
        written.set()

    def purge_meanwhile(base: Path, record: dict[str, Any]) -> None:
        monkeypatch.setattr(program_cache, "_purge", purge)
        threading.Thread(target=compile_something).start()
        written.wait(0.3)
        purge(base, record)

    monkeypatch.setattr(program_cache, "_purge", purge_meanwhile)
    folder_of_compiled()
    assert written.wait(10.0)
    assert (folder / "pocl" / "tempfile").exists()
    sentinel.take()


@pytest.mark.parametrize("content", [b"", b"{", b"[]", b'{"keys": ["../../x"]}', b"\xff"])
def test_a_sentinel_that_says_nothing_costs_all(content: bytes) -> None:
    """One of this process's number, too, that is none of its own: numbers come again."""
    before = folder_of_compiled()
    sentinel = program_cache.Sentinel()
    sentinel.put("key")
    (file,) = (before.parent / "busy").iterdir()
    sentinel.take()
    file.write_bytes(content)
    assert folder_of_compiled() != before
    assert folder_of_compiled() == folder_of_compiled()


def test_ctrl_c_says_that_nothing_crashed() -> None:
    code = (
        f"import os, signal, sys, time; sys.path.insert(0, {ROOT!r})\n"
        "from clrender.cli.interrupt import interruptible\nfrom clrender.device.program_cache import Sentinel\n"
        "Sentinel().put('mine')\n"
        "with interruptible():\n    os.kill(os.getpid(), signal.SIGINT)\n    time.sleep(30)\n"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False, capture_output=True).returncode == 130
    (left,) = (folder_of_unknown() / "busy").iterdir()
    assert json.loads(left.read_text())["interrupted"] is True


def folder_of_unknown() -> Path:
    """The folder of all generations, without looking for dead processes."""
    folder = cache.cache_folder()
    assert folder is not None
    return folder / "compiled"
