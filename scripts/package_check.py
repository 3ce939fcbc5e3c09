"""Check the package as users get it: sdist and wheel, installed into empty environments, with old and new dependencies.

For each Python and each of the resolutions `oldest` (the least versions that setup.cfg allows) and `newest` it makes an
environment that holds nothing, installs the wheel with its extras, and uses each of them. All have to come to the same
bits. Called by `scripts/package_check`, which makes the environment with the tools.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import subprocess
import sys
import tarfile
import tempfile
import time
import zipfile
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Final

__all__ = ["main"]

ROOT: Final = Path(__file__).resolve().parents[1]
VERSIONS: Final = ("3.10", "3.11", "3.12", "3.13")
RESOLUTIONS: Final = {"oldest": "lowest-direct", "newest": "highest"}
EXTRAS: Final = ("all",)

SCENE: Final = ("--size", "48x32", "--spp", "4", "--seed", "7")


def main() -> int:
    """Check, print a line for each step, and return the exit code."""
    options = _options()
    found = dict(item.split("=", 1) if "=" in item else (item, item) for item in options.python) or _pythons()
    missing = [version for version in VERSIONS if version not in found] if not options.python else []
    with tempfile.TemporaryDirectory(prefix="clrender-package-") as scratch:
        folder = Path(scratch)
        wheel = _build(folder, options.keep)
        hashes = {}
        failed = []
        for name, python in found.items():
            for age in options.resolution or RESOLUTIONS:
                label = f"Python {name}, {age} dependencies"
                try:
                    hashes[label] = _try(folder / f"{name}-{age}".replace("/", "_"), python, wheel, age, options)
                except CheckError as error:
                    failed.append(label)
                    print(f"FAILED  {label}: {error}", flush=True)
    for version in missing:
        print(f"absent  Python {version}: not on this machine; name it with --python {version}=PATH")
    if len(set(hashes.values())) > 1:
        failed.append("equal bits")
        print(f"FAILED  images differ: {json.dumps(hashes, indent=2)}")
    print(f"package_check: {'FAILED: ' + '; '.join(failed) if failed else 'all passed'}")
    return 1 if failed else 0


class CheckError(Exception):
    """A step failed."""


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="scripts/package_check", description=__doc__)
    parser.add_argument(
        "--python", action="append", default=[], metavar="VERSION=PATH", help="an interpreter (all python3.N on PATH)"
    )
    parser.add_argument("--resolution", action="append", choices=RESOLUTIONS, help="only these dependencies (both)")
    parser.add_argument("--extras", default=",".join(EXTRAS), help="of the package, or '' for none (%(default)s)")
    parser.add_argument("--tests", nargs="+", metavar="PATH", help="also run these tests against the installed wheel")
    parser.add_argument("--keep", type=Path, metavar="DIR", help="copy sdist and wheel there")
    return parser.parse_args()


def _pythons() -> dict[str, str]:
    """Interpreters by version: the one that runs this, those on PATH and those of pyenv."""
    found = {f"{sys.version_info.major}.{sys.version_info.minor}": getattr(sys, "_base_executable", sys.executable)}
    pyenv = Path(os.environ.get("PYENV_ROOT", Path.home() / ".pyenv")) / "versions"
    for version in VERSIONS:
        candidates = [shutil.which(f"python{version}"), *sorted(pyenv.glob(f"{version}.*/bin/python{version}"))]
        # One on PATH may be a launcher of pyenv that runs no interpreter.
        runs = (str(each) for each in candidates if each is not None and _is_version(str(each), version))
        if (path := next(runs, None)) is not None:
            found.setdefault(version, path)
    return {version: found[version] for version in VERSIONS if version in found}


def _is_version(python: str, version: str) -> bool:
    tell = [python, "-c", "import sys; print('%d.%d' % sys.version_info[:2])"]
    done = subprocess.run(tell, check=False, capture_output=True, text=True, timeout=60)
    return done.returncode == 0 and done.stdout.strip() == version


def _build(folder: Path, keep: Path | None) -> Path:
    """Build the wheel from the sdist, which is built from the files that git would track."""
    source, dist = folder / "source", folder / "dist"
    listed = _run(["git", "-C", str(ROOT), "ls-files", "--cached", "--others", "--exclude-standard", "-z"]).stdout
    for name in filter(None, listed.split("\0")):
        if (ROOT / name).is_file():
            (source / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(ROOT / name, source / name)
    _stamp(source)
    # Without options, `build` makes the wheel from the sdist.
    _run([sys.executable, "-m", "build", "--outdir", str(dist), str(source)])
    (sdist,), (wheel,) = dist.glob("*.tar.gz"), dist.glob("*.whl")
    with tarfile.open(sdist) as archive, zipfile.ZipFile(wheel) as packed:
        inside = {name.partition("/")[2] for name in archive.getnames()}
        packed_names = set(packed.namelist())
    _demand_files(source, inside, packed_names)
    print(f"ok      sdist ({sdist.stat().st_size / 1e6:.1f} MB) and wheel ({wheel.stat().st_size / 1e6:.1f} MB)")
    if keep is not None:
        keep.mkdir(parents=True, exist_ok=True)
        shutil.copy2(sdist, keep)
        shutil.copy2(wheel, keep)
    return wheel


def _stamp(source: Path) -> None:
    """Name the commit in the copy, which has no git, as setup.py does where git is."""
    git = ["git", "-C", str(ROOT)]
    commit = _run([*git, "rev-parse", "HEAD"]).stdout.strip()
    dirty = "-dirty" if _run([*git, "status", "--porcelain"]).stdout else ""
    (source / "clrender" / "commit.txt").write_text(f"{commit}{dirty}\n")


def _demand_files(source: Path, sdist: set[str], wheel: set[str]) -> None:
    """Check that both contain the whole package with kernels, scenes and manual page, and the wheel nothing else."""
    wanted = {
        path.relative_to(source).as_posix()
        for room in ("clrender", "kernels", "scenes")
        for path in (source / room).rglob("*")
        if path.is_file()
    }
    inside = {name if name.startswith("clrender/") else f"clrender/{name}" for name in wanted}
    lacking = sorted((wanted | {"man/clrender.1", "LICENSE", "README.md"}) - sdist) + sorted(inside - wheel)
    if lacking:
        raise SystemExit(f"FAILED  lacking in sdist or wheel: {', '.join(lacking)}")
    if not any(name.endswith("share/man/man1/clrender.1") for name in wheel):
        raise SystemExit("FAILED  the wheel lacks the manual page")
    if odd := sorted(name for name in wheel if not name.startswith(("clrender/", "clrender-"))):
        raise SystemExit(f"FAILED  the wheel has what is none of its own: {', '.join(odd)}")


def _try(environment: Path, python: str, wheel: Path, age: str, options: argparse.Namespace) -> str:
    """Install the wheel into an empty environment and use it; returns the hash of an image."""
    begun = time.monotonic()
    uv = [sys.executable, "-m", "uv"]
    _run([*uv, "venv", "--quiet", "--no-project", "--python", python, str(environment)])
    before = _size(environment)
    target = f"{wheel}[{options.extras}]" if options.extras else str(wheel)
    install = [*uv, "pip", "install", "--quiet", "--python", str(environment), "--resolution", RESOLUTIONS[age]]
    _run([*install, "--only-binary", ":all:", target, *_requirements(wheel, options.extras.split(","), environment)])
    size = _size(environment) - before
    installed = time.monotonic() - begun
    _run([*uv, "pip", "check", "--quiet", "--python", str(environment)])
    digest = _use(environment, environment.with_name(f"{environment.name}-work"), options.extras)
    if options.tests:
        _test(environment, install, wheel, options.tests)
    version = _run([str(environment / "bin" / "python"), "-c", "import sys; print(sys.version.split()[0])"]).stdout
    print(
        f"ok      Python {version.strip()}, {age} dependencies: {size / 1e6:.0f} MB in {installed:.0f} s, "
        f"{time.monotonic() - begun:.0f} s in all, image {digest[:12]}",
        flush=True,
    )
    shutil.rmtree(environment)
    return digest


def _requirements(wheel: Path, extras: Sequence[str], environment: Path) -> list[str]:
    """Requirements of the wheel, to be passed explicitly: uv takes the oldest versions only of direct requirements."""
    from packaging.requirements import Requirement

    with zipfile.ZipFile(wheel) as packed:
        (name,) = (each for each in packed.namelist() if each.endswith(".dist-info/METADATA"))
        lines = packed.read(name).decode().splitlines()
    asked = [Requirement(line.partition(": ")[2]) for line in lines if line.startswith("Requires-Dist: ")]
    tell = "import sys; print('%d.%d' % sys.version_info[:2])"
    version = _run([str(environment / "bin" / "python"), "-c", tell]).stdout.strip()
    wanted = {"", *extras}
    found: dict[str, str] = {}
    for _ in range(2):  # extras refer to other extras
        for each in asked:
            marker = each.marker
            if marker is None or any(marker.evaluate({"extra": one, "python_version": version}) for one in wanted):
                if each.name == "clrender":
                    wanted |= each.extras
                else:
                    found[each.name] = f"{each.name}{each.specifier}"
    return list(found.values())


def _use(environment: Path, work: Path, extras: str) -> str:
    """Use each part of the program once, as a user would, in a separate folder."""
    work.mkdir()
    program = str(environment / "bin" / "clrender")

    def clrender(*arguments: str) -> str:
        return _run([program, *arguments], folder=work).stdout

    def everything(name: str) -> bool:
        return name in extras.split(",") or "all" in extras.split(",")

    if "\ncommit " not in (said := clrender("--version")):
        raise CheckError(f"`clrender --version` names no commit: {said}")
    clrender("render", "room", *SCENE, "-o", "a.png", "-o", "a.exr", "-o", "a.npy", "-o", "a.film", "--stats", "a.json",
             "--aov", "albedo,normal", "--progress", "json")  # fmt: skip
    digest: str = json.loads((work / "a.json").read_text())["image_sha256"]
    clrender("new", "first")
    clrender("check", "first/scene.toml")
    clrender("convert", "first/scene.toml", "second.json")
    clrender("render", "second.json", "--size", "16x16", "--spp", "1", "-o", "b.jpg", "-o", "b.hdr")
    for scene in ("textures", "lamps", "sundial"):  # textures, IES files, and the position of the sun
        clrender("render", scene, "--size", "16x16", "--spp", "1", "-o", "c.exr")
    clrender("tonemap", "a.exr", "--tone-map", "agx", "-o", "d.png")
    clrender("compare", "a.exr", "a.npy", "--json")
    clrender("verify", "a.film", "--fraction", "1")
    json.loads(clrender("schema"))
    clrender("completion", "bash")
    if everything("denoise"):
        clrender("render", "room", *SCENE, "--denoise", "-o", "e.png")
    if everything("report"):
        clrender("furnace", "lambert", "--quick", "-o", "furnace")
    if everything("cluster"):
        clrender("render", "room", *SCENE, "--cluster", "local:1", "-o", "f.npy", "--stats", "f.json")
        if json.loads((work / "f.json").read_text())["image_sha256"] != digest:
            raise CheckError("the image of a cluster is another one")
    if everything("gltf"):
        decoders = "import sys, DracoPy, opengl_basisu; sys.version_info < (3, 11) or __import__('meshopt')"
        _run([str(environment / "bin" / "python"), "-c", decoders])
    if not (environment / "share" / "man" / "man1" / "clrender.1").is_file():
        raise CheckError("the manual page is not installed")
    return digest


def _test(environment: Path, install: Sequence[str], wheel: Path, tests: Sequence[str]) -> None:
    """Run tests against the installed package, with the newest pytest and plugins."""
    newest = [part if part != RESOLUTIONS["oldest"] else RESOLUTIONS["newest"] for part in install]
    _run([*newest, "pytest", "hypothesis", "jsonschema", "scipy", "pytest-xdist"])
    python = str(environment / "bin" / "python")
    folder = environment.with_name(f"{environment.name}-tests")
    shutil.copytree(ROOT / "tests", folder / "tests")
    for name in ("setup.cfg", "scripts", "docs", "README.md", "scenes"):
        source = ROOT / name
        (shutil.copytree if source.is_dir() else shutil.copy2)(source, folder / name)
    _run([python, "-m", "pytest", "-q", "-n", "0", *tests], folder=folder)


def _size(folder: Path) -> int:
    return sum(path.stat().st_size for path in folder.rglob("*") if path.is_file() and not path.is_symlink())


def _run(command: Sequence[str], folder: Path | None = None) -> subprocess.CompletedProcess[str]:
    """Run a command to its end; if it fails, the error contains its output."""
    alone: Callable[[Mapping[str, str]], dict[str, str]] = lambda env: {  # noqa: E731
        name: value for name, value in env.items() if name not in ("PYTHONPATH", "VIRTUAL_ENV", "PYTHONHOME")
    }
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False, env=alone(os.environ))
    if done.returncode:
        said = (done.stdout + done.stderr).strip().splitlines()[-25:]
        raise CheckError(
            f"{' '.join(command[:8])} … exited with {done.returncode}:\n        " + "\n        ".join(said)
        )
    return done


if __name__ == "__main__":
    sys.exit(main())
