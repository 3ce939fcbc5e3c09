"""Wheels for a machine without network: `scripts/gpu_check --pack DIR` here, `scripts/gpu_check --from DIR` there.

Only the standard library is needed, so that any Python can do it.
"""

from __future__ import annotations

import argparse
import configparser
import re
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Final

__all__ = ["MOST_BYTES", "pack", "requirements", "unpack"]

MOST_BYTES: Final = 64 << 20
"""Largest size that is carried with a checkout."""
_ROOT: Final = Path(__file__).resolve().parents[1]
_PLATFORMS: Final = ("manylinux_2_28_{}", "manylinux_2_27_{}", "manylinux_2_17_{}", "manylinux2014_{}", "linux_{}")


def requirements(root: Path = _ROOT) -> list[str]:
    """Requirements of clrender from ``setup.cfg``, and pip, which a container's Python may lack."""
    parser = configparser.ConfigParser()
    parser.read(root / "setup.cfg", encoding="utf-8")
    return [*filter(None, parser["options"]["install_requires"].splitlines()), "pip"]


def for_python(wanted: Sequence[str], python: str) -> list[str]:
    """Requirements for a version of Python, without markers, which pip would evaluate for its own version.

    Parameters
    ----------
    wanted : sequence of str
    python : str
    """
    version, held = int(python.split(".")[1]), []
    for each in wanted:
        name, _, condition = (part.strip() for part in each.partition(";"))
        found = re.fullmatch(r'python_version\s*(<|>=)\s*"3\.(\d+)"', condition)
        if condition and not found:
            raise ValueError(f'{each}: only conditions such as python_version < "3.11" are understood')
        if not found or (version < int(found[2])) == (found[1] == "<"):
            held.append(name)
    return held


def pack(folder: Path, pythons: Sequence[str], machine: str, wanted: Sequence[str]) -> int:
    """Download wheels of the requirements; returns the size of the folder in bytes.

    Parameters
    ----------
    folder : Path
        Created if it does not exist; its contents are kept.
    pythons : sequence of str
        Versions such as ``3.12``.
    machine : str
        ``x86_64`` or ``aarch64``.
    wanted : sequence of str
        Requirements.

    Raises
    ------
    ValueError
        An invalid version, or a failure of pip, with its last output.
    """
    folder.mkdir(parents=True, exist_ok=True)
    for python in pythons:
        if not re.fullmatch(r"3\.\d+", python):
            raise ValueError(f"--python {python} is no version; say 3.12, for example")
        command = [sys.executable, "-m", "pip", "download", "--quiet", "--disable-pip-version-check"]
        command += ["--only-binary=:all:", "--python-version", python, "--implementation", "cp"]
        command += ["--abi", f"cp{python.replace('.', '')}", "--abi", "abi3", "--abi", "none"]
        for platform in _PLATFORMS:
            command += ["--platform", platform.format(machine)]
        done = subprocess.run(
            [*command, "--dest", str(folder), *for_python(wanted, python)], capture_output=True, text=True, check=False
        )
        if done.returncode:
            last = next((line for line in reversed(done.stderr.splitlines()) if line.strip()), "no word from pip")
            raise ValueError(f"pip found no wheels for Python {python} on {machine}: {last.strip()}")
    return sum(path.stat().st_size for path in folder.iterdir())


def unpack(folder: Path, environment: Path, wanted: Sequence[str]) -> None:
    """Make a Python environment from a folder of wheels, without network.

    Parameters
    ----------
    folder : Path
    environment : Path
        Path of the environment, which is created anew.
    wanted : sequence of str
        Requirements, all of which must be in the folder.

    Raises
    ------
    ValueError
        There is no pip in the folder, or a wheel is missing.
    """
    pip = next(iter(sorted(folder.glob("pip-*.whl"), reverse=True)), None)
    if pip is None:
        raise ValueError(
            f"{folder} holds no pip-*.whl: fill it by `scripts/gpu_check --pack {folder}` where there is network"
        )
    make = [sys.executable, "-m", "venv", "--clear", "--without-pip", str(environment)]
    install = [str(environment / "bin" / "python"), f"{pip}/pip", "install", "--quiet", "--disable-pip-version-check"]
    install += ["--no-index", "--find-links", str(folder), *wanted]
    for command in (make, install):
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        if done.returncode:
            version = ".".join(map(str, sys.version_info[:2]))
            last = next((line for line in reversed(done.stderr.splitlines()) if line.strip()), "")
            raise ValueError(
                f"{folder} does not make an environment for this Python {version}: {last.strip()}; "
                f"pack it with --python {version}"
            )


def main() -> int:
    """Pack, or with --environment unpack; returns 0 on success, 2 for wrong arguments."""
    parser = argparse.ArgumentParser(prog="scripts/gpu_check", description=__doc__)
    parser.add_argument("folder", type=Path, help="of the wheels")
    here = ".".join(map(str, sys.version_info[:2]))
    parser.add_argument("--python", action="append", help=f"the other machine's version; repeatable (default: {here})")
    parser.add_argument("--machine", default="x86_64", choices=("x86_64", "aarch64"))
    parser.add_argument("--with", dest="more", action="append", default=[], help="one more requirement, say mitsuba")
    parser.add_argument("--environment", type=Path, help="make a Python environment there, from the folder")
    options = parser.parse_args()
    wanted = [*requirements(), *options.more]
    try:
        if options.environment:
            unpack(options.folder, options.environment, wanted)
            return 0
        size = pack(options.folder, options.python or [here], options.machine, wanted)
    except (OSError, ValueError) as error:
        print(f"gpu_check: {error}", file=sys.stderr)
        return 2
    count = len(list(options.folder.glob("*.whl")))
    print(f"{options.folder}: {count} wheels, {size / 2**20:.1f} MiB", file=sys.stderr)
    if size > MOST_BYTES:
        cure = "empty the folder and pack fewer versions of Python, or less --with"
        print(f"gpu_check: that is more than the {MOST_BYTES >> 20} MiB that may travel; {cure}", file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
