"""`scripts/gpu_check --pack` and `--from`: wheels for a machine without network, as far as a test has none either."""

from __future__ import annotations

import importlib.util
import json
import subprocess
import sys
from pathlib import Path
from types import ModuleType

import pytest

ROOT = Path(__file__).resolve().parents[2]


def _script(name: str) -> ModuleType:
    spec = importlib.util.spec_from_file_location(name, ROOT / "scripts" / f"{name}.py")
    assert spec is not None and spec.loader is not None
    module = sys.modules[name] = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


PACK = _script("gpu_check_pack")


def run(*arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, str(ROOT / "scripts" / "gpu_check_pack.py"), *arguments],
        capture_output=True,
        text=True,
        check=False,
    )


def test_what_is_packed_is_what_the_package_asks_for() -> None:
    wanted = PACK.requirements()
    assert any(each.startswith("pyopencl") for each in wanted)
    assert any(each.startswith("numpy") for each in wanted)
    assert "pip" in wanted


def test_conditions_are_those_of_the_other_python() -> None:
    wanted = ["numpy>=1.24", 'tomli>=2; python_version < "3.11"', 'new; python_version >= "3.12"']
    assert PACK.for_python(wanted, "3.10") == ["numpy>=1.24", "tomli>=2"]
    assert PACK.for_python(wanted, "3.11") == ["numpy>=1.24"]
    assert PACK.for_python(wanted, "3.12") == ["numpy>=1.24", "new"]
    with pytest.raises(ValueError, match="only conditions"):
        PACK.for_python(['a; sys_platform == "win32"'], "3.12")
    for version in ("3.10", "3.13"):
        assert PACK.for_python(PACK.requirements(), version)


def test_each_python_is_asked_for(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    commands: list[list[str]] = []

    def pip(command: list[str], **_: object) -> subprocess.CompletedProcess[str]:
        commands.append(command)
        (tmp_path / f"{len(commands)}.whl").write_bytes(bytes(100))
        return subprocess.CompletedProcess(command, 0, "", "")

    monkeypatch.setattr(PACK.subprocess, "run", pip)
    assert PACK.pack(tmp_path, ["3.10", "3.13"], "aarch64", ["numpy"]) == 200
    assert [command[command.index("--python-version") + 1] for command in commands] == ["3.10", "3.13"]
    assert "manylinux_2_28_aarch64" in commands[0] and "cp310" in commands[0] and commands[0][-1] == "numpy"


def test_a_pack_that_is_too_large_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(PACK, "pack", lambda *_: PACK.MOST_BYTES + 1)
    monkeypatch.setattr(sys, "argv", ["gpu_check", str(tmp_path)])
    assert PACK.main() == 2
    assert "64 MiB that may travel" in capsys.readouterr().err


def test_a_version_that_is_none_is_named(tmp_path: Path) -> None:
    done = run(str(tmp_path), "--python", "12")
    assert done.returncode == 2
    assert "--python 12 is no version" in done.stderr and "Traceback" not in done.stderr


def test_an_empty_folder_is_named(tmp_path: Path) -> None:
    done = run(str(tmp_path), "--environment", str(tmp_path / "venv"))
    assert done.returncode == 2
    assert "holds no pip-*.whl" in done.stderr and "--pack" in done.stderr
    assert not (tmp_path / "venv").exists()


def test_the_known_images_are_those_that_are_rendered() -> None:
    known = json.loads((ROOT / "scripts" / "gpu_check_hashes.json").read_text())
    text = (ROOT / "scripts" / "gpu_check.py").read_text()
    before = list(sys.path)
    sys.path[:0] = [str(ROOT / "tests" / kind) for kind in ("image", "statistics")]
    try:
        from image_support import SCENES
        from mixed_scenes import KINDS

        mixed = {f"mixed {kind} {number}" for kind in KINDS for number in range(_script("gpu_check")._MIXED)}
    finally:
        sys.path[:] = before
    assert {*SCENES, *mixed} < known.keys()
    assert all(title in {*SCENES, *mixed} or f'"{title}"' in text for title in known)
    assert all(len(each) == 64 for each in known.values())
