"""scripts/setup.sh removes only what it made, and installs system packages only where it may. Its tools are stubs."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

SETUP = Path(__file__).parents[2] / "scripts" / "setup.sh"
NO_PIP = '#!/bin/bash\n[[ $1 == -c ]] && exit 0\necho "No module named pip" >&2; exit 1\n'
BROKEN = "#!/bin/bash\nexit 126\n"


class Machine:
    """A checkout and a folder of stubs, each of which writes what it is called with to a common log."""

    def __init__(self, folder: Path) -> None:
        self.root = folder / "checkout"
        self.tools = folder / "tools"
        self.log = folder / "log"
        self.root.mkdir()
        self.tools.mkdir()
        (self.root / "setup.cfg").touch()
        for name in ("bash", "touch", "mkdir", "rm", "tail", "flock", "env", "cat"):
            (self.tools / name).symlink_to(shutil.which(name) or f"/bin/{name}")
        self.stub("id", "echo ${USER_NUMBER}")
        self.stub("apt-get")
        self.stub("sudo", 'while [[ $1 == -n ]]; do shift; done; "$@"')
        self.stub("python3", f'if [[ $1 == -c ]]; then exec {sys.executable} "$@"; fi')

    def stub(self, name: str, does: str = "") -> None:
        file = self.tools / name
        file.write_text(f'#!/bin/bash\necho "ran {name} $*" >>{self.log}\n{does}\n')
        file.chmod(0o755)

    def environment(self, python: str, made: bool = False) -> Path:
        """An environment with something of the user's in it."""
        folder = self.root / ".venv"
        (folder / "bin").mkdir(parents=True)
        (folder / "bin" / "python").write_text(python)
        (folder / "bin" / "python").chmod(0o755)
        (folder / "mine").touch()
        if made:
            (folder / ".made-by-clrender-set-up").touch()
        return folder

    def run(self, command: str, user: int = 1000, **changes: str) -> tuple[int, list[str]]:
        """Exit status, and lines of what was said and run, in order; without a terminal."""
        env = {"PATH": str(self.tools), "USER_NUMBER": str(user), "HOME": os.environ.get("HOME", "/"), **changes}
        script = f"exec 2>>{self.log}; set -euo pipefail; root={self.root}; source {SETUP}; {command}"
        done = subprocess.run(
            [str(self.tools / "bash"), "-c", script],
            check=False, env=env, stdin=subprocess.DEVNULL, timeout=60,
        )  # fmt: skip
        return done.returncode, [line for line in self.log.read_text().splitlines() if not line.startswith("ran id ")]


@pytest.fixture
def machine(tmp_path: Path) -> Machine:
    return Machine(tmp_path)


@pytest.mark.parametrize("python", [NO_PIP, BROKEN], ids=["no pip", "broken"])
def test_an_environment_it_did_not_make_stays(machine: Machine, python: str) -> None:
    folder = machine.environment(python)
    code, lines = machine.run("ensure_environment plain")
    assert code == 1
    assert lines[-1].startswith("error: ")
    assert str(folder) in lines[-1]
    assert (folder / "mine").exists()
    assert (folder / "bin" / "python").read_text() == python


def test_one_made_without_pip_is_filled_by_uv(machine: Machine) -> None:
    folder = machine.environment(NO_PIP)
    machine.stub("uv")
    code, lines = machine.run("ensure_environment test")
    assert code == 0
    assert f"ran uv pip install --python {folder}/bin/python --editable {machine.root}[test]" in lines
    assert (folder / "mine").exists()
    assert (folder / ".ready-test").read_text() == str(machine.root)


def test_one_it_made_itself_is_made_anew_when_it_broke(machine: Machine) -> None:
    folder = machine.environment(BROKEN, made=True)
    _, lines = machine.run("ensure_environment plain")
    assert f"ran python3 -m venv {folder}" in lines
    assert not (folder / "mine").exists()


@pytest.mark.parametrize(
    ("user", "told", "installs"),
    [(1000, "", False), (1000, "1", True), (1000, "0", False), (0, "", True), (0, "1", True), (0, "0", False)],
)
def test_who_may_install_system_packages(machine: Machine, user: int, told: str, installs: bool) -> None:
    code, lines = machine.run("install_packages some-driver", user, CLRENDER_INSTALL=told)
    assert (code == 0) == installs
    ran = [number for number, line in enumerate(lines) if "ran apt-get" in line]
    assert bool(ran) == installs
    if installs:
        said = lines.index("clrender set-up: installing the system packages some-driver")
        assert said < ran[0]
        assert any(line.startswith("ran sudo -n") for line in lines) == (user != 0)
    elif told != "0":
        assert "not installing the system packages some-driver: as root, or with CLRENDER_INSTALL=1" in lines[-1]


@pytest.mark.parametrize(("user", "told", "installs"), [(1000, "", False), (1000, "1", True), (0, "", True)])
def test_who_may_install_a_driver_that_is_not_free(machine: Machine, user: int, told: str, installs: bool) -> None:
    machine.environment('#!/bin/bash\n[[ "$*" == *clrender.drivers* ]] && exit 3\necho "ran python $*"\n')
    code, lines = machine.run("ensure_device", user, CLRENDER_INSTALL=told)
    assert code == 1
    log = (machine.root / ".venv" / "install.log").read_text()
    assert ("intel-opencl-rt" in log) == installs
    assert any("Intel End User License Agreement" in line for line in lines)


@pytest.mark.parametrize(("seconds", "tries"), [({}, 2), ({"CLRENDER_PROBE_SECONDS": "9"}, 1)], ids=["unset", "set"])
def test_a_probe_that_ran_out_of_time_gets_more_before_other_drivers(
    machine: Machine, seconds: dict[str, Any], tries: int
) -> None:
    asked = '[[ "$*" == *clrender.drivers* ]] && { echo "probed in ${CLRENDER_PROBE_SECONDS:-240}" >&2; exit %s; }'
    machine.environment("#!/bin/bash\n" + asked % "$([[ ${CLRENDER_PROBE_SECONDS:-0} -gt 1000 ]] && echo 0 || echo 4)")
    code, lines = machine.run("ensure_device", CLRENDER_INSTALL="0", **seconds)
    probes = [line for line in lines if line.startswith("probed in")]
    if tries == 2:
        assert (code, probes) == (0, ["probed in 240", "probed in 1200"])
        assert not any("no OpenCL driver" in line for line in lines)
    else:
        assert (code, probes[0]) == (1, "probed in 9"), "who set a limit gets no other"


PACKAGES = "starlette<2,>=0.40 uvicorn<1,>=0.35"


def with_extras(machine: Machine, pip: str = "exit 0") -> Path:
    """An environment whose clrender declares two packages for each extra."""
    printed = "; ".join(f"echo '{each}'" for each in PACKAGES.split())
    return machine.environment(
        f'#!/bin/bash\nif [[ $1 == -c ]]; then {printed}; exit 0; fi\n[[ $3 == --version ]] && exit 0\n'
        f'echo "ran python $*" >>{machine.log}\n{pip}\n'
    )  # fmt: skip


@pytest.mark.parametrize(
    ("user", "told", "installs"),
    [(1000, "", False), (1000, "1", True), (1000, "0", False), (0, "", True), (0, "0", False)],
)
def test_who_may_install_an_extra(machine: Machine, user: int, told: str, installs: bool) -> None:
    with_extras(machine)
    code, lines = machine.run("install_extra view; echo goes on >&2", user, CLRENDER_INSTALL=told)
    assert code == 0 and lines[-1] == "goes on", "without permission the command itself says what it lacks"
    ran = [line for line in lines if line.startswith("ran python -m pip install")]
    if installs:
        said = f"clrender set-up: installing what this command needs (the extra view): {PACKAGES}"
        assert lines == [said, *ran, "goes on"] and ran[0].endswith(f" {PACKAGES}")
    else:
        assert not ran


def test_an_extra_that_cannot_be_installed_is_one_clear_error(machine: Machine) -> None:
    with_extras(machine, pip="echo 'no route to host'; exit 1")
    code, lines = machine.run("install_extra view; echo goes on >&2", 0)
    assert code == 1
    assert lines[-1].startswith(
        "error: the packages of the extra view could not be installed: no route to host. Is there"
    )


def test_bytecode_is_kept(machine: Machine) -> None:
    """Else each of them compiles all its modules at each start, for pip has not."""
    _, lines = machine.run("env >&2", PYTHONDONTWRITEBYTECODE="1")
    assert any(line.startswith("HOME=") for line in lines)
    assert not any(line.startswith("PYTHONDONTWRITEBYTECODE") for line in lines)
