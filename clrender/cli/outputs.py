"""Output files of a command: all must be distinct, none may be an input file, and each is written if it can be."""

from __future__ import annotations

import functools
import os
from collections.abc import Callable, Container, Iterable, Iterator, Mapping
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Final

import click
from click.core import ParameterSource

from clrender.errors import ClrenderError, RenderError, UsageError

if TYPE_CHECKING:
    from clrender.scene import Scene

__all__ = [
    "check_distinct",
    "check_folder",
    "check_formats",
    "check_image_size",
    "raise_last",
    "scene_files",
    "write_each",
]


_GIVEN: Final = (
    "scene",
    "spec",
    "subject",
    "films",
    "image",
    "camera",
    "environment",
    "guiding_field",
    "ocio",
    "plugins",
)
"""Parameters of commands that name files to read."""


def check_distinct(outputs: Iterable[Path], inputs: Iterable[Path] = ()) -> None:
    """Check that the command does not overwrite a file that it reads or has just written.

    Parameters
    ----------
    outputs, inputs : iterable of pathlib.Path
        Links and other spellings of a name count as the file that they refer to. Files that the command line names are
        inputs in any case. There may be a million outputs.

    Raises
    ------
    UsageError
    """
    identity = _identities()
    read = {identity(source): source for source in (*_given_files(), *inputs)}
    seen = set()
    for output in outputs:
        file = identity(output)
        if file in seen:
            raise UsageError(f"{output}: is named twice as an output; give each output a name of its own")
        if file in read:
            raise UsageError(f"{output}: is an input of this command ({read[file]}); give the output another name")
        seen.add(file)


def check_folder(folder: Path, names: Container[str], inputs: Iterable[Path]) -> None:
    """Check that no input of the command is among the files that it writes to a folder.

    Parameters
    ----------
    folder : pathlib.Path
    names : container of str
        Files and folders in it that are written.
    inputs : iterable of pathlib.Path
        Besides those that the command line names.

    Raises
    ------
    UsageError
    """
    here = Path(os.path.realpath(folder))
    for source in (*_given_files(), *inputs):
        real = Path(os.path.realpath(source))
        if real.is_file() and here in real.parents and real.relative_to(here).parts[0] in names:
            raise UsageError(f"{folder}: has an input of this command ({source}) where its output goes; name another")


def _given_files() -> Iterator[Path]:
    """What the command line names as files to read; some may be names of other things, such as built-in scenes."""
    context = click.get_current_context(silent=True)
    for value in (context.params.get(name) for name in _GIVEN) if context is not None else ():
        for name in value if isinstance(value, tuple) else (value,):
            if isinstance(name, str | Path):
                yield Path(name)
                yield Path(str(name).partition("#")[0])  # a camera of a file


def check_formats(ctx: click.Context, outputs: Iterable[Path]) -> None:
    """Check that an output has the format that `tone_options` and `exr_options` of the command line are for.

    Raises
    ------
    UsageError
    """
    from clrender.image.files import DISPLAY_ENDINGS

    endings = {path.suffix.lower() for path in outputs}
    given = {name for name in ctx.params if ctx.get_parameter_source(name) == ParameterSource.COMMANDLINE}
    for name in ("tone_map", "ocio", "exposure", "f_stop", "shutter", "iso"):
        interval = isinstance(ctx.params.get(name), tuple)  # of a shutter, for motion blur
        if name in given and not interval and not endings.intersection(DISPLAY_ENDINGS):
            option = name.replace("_", "-")
            raise UsageError(f"--{option}: only .png and .jpg files are tone-mapped; name one with -o, or leave it out")
    for name in ("exr_type", "exr_compression", "exr_tile"):
        if name in given and ".exr" not in endings:
            raise UsageError(f"--{name.replace('_', '-')}: no output is an .exr; name one with -o, or leave it out")


def check_image_size(outputs: Iterable[Path], width: int, height: int) -> None:
    """Check that the format of every output supports an image of this size.

    Raises
    ------
    UsageError
    """
    from clrender.image.display import JPEG_SIDE_LIMIT

    for output in outputs:
        if output.suffix.lower() in (".jpg", ".jpeg") and max(width, height) > JPEG_SIDE_LIMIT:
            raise UsageError(
                f"{output}: a .jpg holds at most {JPEG_SIDE_LIMIT} pixels a side, not {width} x {height}; use .png"
            )


def write_each(outputs: Iterable[Path], write: Callable[[Path], None]) -> dict[Path, ClrenderError]:
    """Write outputs, each even if another cannot be written; returns the errors of those that cannot."""
    failures = {}
    for path in outputs:
        try:
            write(path)
        except ClrenderError as error:
            failures[path] = error
    return failures


def raise_last(failures: Mapping[Path, ClrenderError], kept: str = "") -> None:
    """Tell all errors of `write_each`, and raise the last one, if there are any.

    Raises
    ------
    RenderError
        Its sentence ends in `kept`.
    """
    messages = [str(error).rstrip(".") for error in failures.values()]
    for message in messages[:-1]:
        click.echo(f"error: {message}", err=True)
    if messages:
        raise RenderError(f"{messages[-1]}{kept}")


def scene_files(name: str, scene: Scene) -> list[Path]:
    """All files that a scene, loaded by this name, was read from."""
    from clrender.scene import Mesh

    files = [shape.file for _, shape in scene.all_shapes() if isinstance(shape, Mesh) and shape.file is not None]
    files += [shape.file for _, shape in scene.curve_files() if shape.file is not None]
    files += [material.file for _, material in scene.measured_materials()]
    files += [grid.file for _, grid in scene.grids()]
    files += [instance.file for _, instance in scene.instances() if instance.file is not None]
    files += [light.file for _, light in scene.pictured_lights() if light.file is not None]
    files += [texture.texture for _, texture in scene.texture_files()]
    files += [light.file for _, light in scene.ies_lights()]
    return [
        Path(name),
        scene.base_folder / f"{name}.toml",
        *(scene.base_folder / file for file in files),
        *scene.read_files,
    ]


def _identities() -> Callable[[Path], object]:
    """A function to what all names of a file have in common."""
    folder = functools.cache(os.path.realpath)

    def identity(path: Path) -> object:
        with suppress(OSError, ValueError):
            found = path.stat()
            return found.st_dev, found.st_ino
        with suppress(OSError):
            path = Path(os.path.realpath(path)) if path.is_symlink() else path
        return folder(path.parent), path.name

    return identity
