"""Checks of a command's output files: all must be distinct, and none may be an input file."""

from __future__ import annotations

import os
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import click
from click.core import ParameterSource

from clrender.errors import UsageError

if TYPE_CHECKING:
    from clrender.scene import Scene

__all__ = ["check_distinct", "check_formats", "check_image_size", "scene_files"]


def check_distinct(outputs: Sequence[Path], inputs: Iterable[Path]) -> None:
    """Check that the command does not overwrite a file that it reads or has just written.

    Parameters
    ----------
    outputs, inputs : paths
        Links and other spellings of a name count as the file that they refer to.

    Raises
    ------
    UsageError
    """
    read = list(inputs)
    for index, output in enumerate(outputs):
        for other in outputs[:index]:
            if _same_file(output, other):
                raise UsageError(f"{output}: is named twice as an output; give each output a name of its own")
        for source in read:
            if _same_file(output, source):
                raise UsageError(f"{output}: is an input of this command ({source}); give the output another name")


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


def _same_file(a: Path, b: Path) -> bool:
    if os.path.realpath(a) == os.path.realpath(b):
        return True
    try:
        return a.samefile(b)
    except OSError:  # one of them does not exist
        return False
