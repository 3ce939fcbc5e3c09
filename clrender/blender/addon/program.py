"""Finds and runs the program `clrender`."""

from __future__ import annotations

import importlib.util
import json
import os
import queue
import shlex
import shutil
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO, Any, Final

__all__ = [
    "INTERRUPTED",
    "Finished",
    "RenderOptions",
    "child_environment",
    "found_program",
    "region",
    "render_command",
    "run",
]

INTERRUPTED: Final = 130
"""Exit code of a render that was stopped, and has written its image."""
_POLL: Final = 0.1
_PATIENCE: Final = 30.0
"""Seconds in which a program that was interrupted has to end."""
_REPLICATE: Final = 16
_LEAST_OF_ERROR: Final = 16 * _REPLICATE
"""Samples per pixel of a replicate, by which `--error` estimates, and before its first test; as `clrender.settings`."""
_OWN: Final = ("PYTHONHOME", "PYTHONEXECUTABLE")
"""Variables with which Blender's Python would disturb another one."""


@dataclass(frozen=True)
class RenderOptions:
    """What a render of Blender asks for.

    Attributes
    ----------
    spp : int
        With an error the most that a pixel gets; too few for its first test stand for no limit but clrender's own.
    seed : int
    integrator : str
    light_sampler : str
        ``auto``: what clrender takes for the integrator.
    filter : str
    max_depth : int
        0: no limit.
    error : float
        Relative error at which the render stops; 0: none.
    seconds : float
        After which it stops; 0: no limit.
    device : str
        Empty: chosen by clrender.
    denoise, alpha : bool
    crop : tuple of int or None
        Left and upper edge, width and height, pixels.
    more : str
        Other options, as on a command line.
    """

    spp: int = 64
    seed: int = 0
    integrator: str = "path"
    light_sampler: str = "auto"
    filter: str = "blackman-harris"
    max_depth: int = 0
    error: float = 0.0
    seconds: float = 0.0
    device: str = ""
    denoise: bool = False
    alpha: bool = False
    crop: tuple[int, int, int, int] | None = None
    more: str = ""


@dataclass
class Finished:
    """How a run ended.

    Attributes
    ----------
    code : int
        Exit code.
    error : str
        What went wrong, one line; empty unless it did.
    messages : list of str
        Notes and warnings.
    """

    code: int = 0
    error: str = ""
    messages: list[str] = field(default_factory=list)


def found_program(chosen: str) -> list[str]:
    """The command that starts clrender.

    Parameters
    ----------
    chosen : str
        Of the preferences: the program, or a Python in which it is installed; empty: on the PATH.

    Raises
    ------
    FileNotFoundError
        There is none.
    """
    if chosen.strip():
        path = Path(chosen.strip()).expanduser()
        if not path.is_file():
            raise FileNotFoundError(f"{path}: there is no such file; choose clrender in the add-on's preferences")
        return [str(path), "-m", "clrender"] if path.name.startswith("python") else [str(path)]
    program = shutil.which("clrender")
    if program is not None:
        return [program]
    if importlib.util.find_spec("clrender") is not None:
        return [sys.executable, "-m", "clrender"]
    python = shutil.which("python3") or shutil.which("python")
    if python is None or subprocess.run([python, "-c", "import clrender"], capture_output=True, check=False).returncode:
        raise FileNotFoundError("clrender was not found on the PATH; choose it in the add-on's preferences")
    return [python, "-m", "clrender"]


def render_command(scene: Path, output: Path, options: RenderOptions) -> list[str]:
    """What follows the program's name to render a scene file.

    Parameters
    ----------
    scene, output : Path
    options : RenderOptions
    """
    words = ["render", str(scene), "-o", str(output), "--progress", "json"]
    words += [*_samples(options), "--seed", str(options.seed), "--integrator", options.integrator]
    words += ["--light-sampler", options.light_sampler] if options.light_sampler != "auto" else []
    words += ["--filter", options.filter]
    # Blender's filter of that name is 1.5 pixels wide
    words += ["--filter-radius", "0.75"] if options.filter == "blackman-harris" else []
    words += ["--max-depth", str(options.max_depth)] if options.max_depth > 0 else []
    words += ["--error", f"{options.error:g}"] if options.error > 0.0 else []
    words += ["--time", f"{options.seconds:g}"] if options.seconds > 0.0 else []
    words += ["--device", options.device] if options.device else []
    words += ["--denoise"] if options.denoise else []
    words += ["--alpha"] if options.alpha else []
    if options.crop is not None:
        left, upper, width, height = options.crop
        words += ["--crop", f"{left},{upper},{width}x{height}"]
    return words + shlex.split(options.more)


def _samples(options: RenderOptions) -> list[str]:
    if options.error <= 0.0:
        return ["--spp", str(options.spp)]
    # Whole replicates, unless the other options say how large those are
    size = 1 if "--replicate-spp" in options.more else _REPLICATE
    return ["--spp", str(options.spp // size * size)] if options.spp >= _LEAST_OF_ERROR else []


def region(
    size: tuple[int, int], across: tuple[float, float], upward: tuple[float, float]
) -> tuple[int, int, int, int]:
    """A part of the image that Blender's render region has, as `--crop` takes it.

    Parameters
    ----------
    size : tuple of int
        Width and height of the image, pixels.
    across, upward : tuple of float
        Its sides as shares of the width from the left, and of the height from below.

    Returns
    -------
    tuple of int
        Left and upper edge, width and height, pixels; cut to whole pixels as Blender does.
    """
    left, right = (int(share * size[0]) for share in across)
    lower, upper = (int(share * size[1]) for share in upward)
    return left, size[1] - upper, right - left, upper - lower


def child_environment() -> dict[str, str]:
    """The environment of the program, without what is for Blender's Python only."""
    return {name: value for name, value in os.environ.items() if name not in _OWN}


def run(
    command: Sequence[str],
    stopped: Callable[[], bool] = lambda: False,
    on_event: Callable[[dict[str, Any]], None] = lambda event: None,
) -> Finished:
    """Run the program until it ends.

    Parameters
    ----------
    command : sequence of str
    stopped : callable
        Asked often; when it says so, the program is interrupted, writes the image so far, and ends.
    on_event : callable
        Receives events of progress, in this thread.
    """
    process = subprocess.Popen(
        command,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
        encoding="utf-8",
        errors="replace",
        env=child_environment(),
    )
    assert process.stderr is not None
    lines: queue.Queue[str | None] = queue.Queue()
    reader = threading.Thread(target=_read, args=(process.stderr, lines), daemon=True)
    reader.start()
    finished, other = Finished(), list[str]()
    waited, interrupted = 0.0, False
    try:
        while True:
            try:
                line = lines.get(timeout=_POLL)
            except queue.Empty:
                waited += _POLL if interrupted else 0.0
                if waited > _PATIENCE:
                    process.kill()
            else:
                if line is None:
                    break
                _take(line.rstrip("\n"), finished, other, on_event)
            if not interrupted and stopped():
                _interrupt(process)
                interrupted = True
    finally:
        if process.poll() is None:
            _interrupt(process)
        finished.code = process.wait()
        reader.join()
        process.stderr.close()
    if finished.code not in (0, INTERRUPTED) and not finished.error:
        finished.error = other[-1] if other else f"clrender ended with the exit code {finished.code}"
    return finished


def _interrupt(process: subprocess.Popen[str]) -> None:
    if os.name == "nt":
        process.terminate()
    else:
        process.send_signal(signal.SIGINT)


def _read(file: IO[str], lines: queue.Queue[str | None]) -> None:
    for line in file:
        lines.put(line)
    lines.put(None)


def _take(line: str, finished: Finished, other: list[str], on_event: Callable[[dict[str, Any]], None]) -> None:
    """A line of what the program says: JSON of `--progress json`, an error, or a note."""
    if line.startswith("error:"):
        finished.error = line.removeprefix("error:").strip()
        return
    try:
        event = json.loads(line) if line.startswith("{") else None
    except ValueError:
        event = None
    if isinstance(event, dict) and event.get("event") == "message":
        finished.messages.append(str(event.get("text", "")))
    elif isinstance(event, dict):
        on_event(event)
    elif line.startswith(("note:", "warning:")):
        finished.messages.append(line)
    elif line.strip():
        other.append(line.strip())
