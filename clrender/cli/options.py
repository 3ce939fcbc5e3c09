"""Option types of the commands, and options shared by several: settings of the table, sizes, folders to read from."""

from __future__ import annotations

import functools
import math
import re
from collections.abc import Callable, Container
from pathlib import Path
from typing import Any, Final

import click
from click.core import ParameterSource
from click.shell_completion import CompletionItem

from clrender.cli.completing import complete_devices, complete_files, complete_scenes
from clrender.errors import UsageError
from clrender.image.exposure import PHOTOGRAPHIC
from clrender.limits import Choice, Domain, Flag, NotAllowed, Range, shown
from clrender.settings import PIXEL_LIMIT, SETTINGS
from clrender.wording import counted

__all__ = [
    "TONE_MAPS",
    "DomainType",
    "EnvironmentType",
    "allow_path_option",
    "device_option",
    "environment_option",
    "exr_options",
    "load_options",
    "number",
    "numbers",
    "outputs_option",
    "plugin_option",
    "progress_options",
    "scene_argument",
    "setting_option",
    "setting_options",
    "size",
    "size_option",
    "tone_options",
    "view_options",
]

TONE_MAPS: Final = ("linear", "sqrt", "srgb", "reinhard", "aces", "agx")
"""The names of `clrender.image.tone_map.TONE_MAPS`, without loading NumPy for `--help`."""


class DomainType(click.ParamType):  # type: ignore[type-arg]  # not generic before click 8.3
    """Option type: values of a domain, with an error that says what is allowed."""

    def __init__(self, domain: Domain) -> None:
        self.name = domain.metavar
        self.domain = domain

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        try:
            return self.domain.parse(value) if isinstance(value, str) else self.domain.accept(value)
        except NotAllowed as error:
            raise click.UsageError(f"{param.opts[-1] if param else 'the value'} {error}", ctx) from None

    def get_metavar(self, param: click.Parameter, ctx: click.Context | None = None) -> str:
        return self.domain.metavar

    def shell_complete(self, ctx: click.Context, param: click.Parameter, incomplete: str) -> list[CompletionItem]:
        members = self.domain.members if isinstance(self.domain, Choice) else ()
        return [CompletionItem(str(each)) for each in members if str(each).startswith(incomplete)]


def number(
    low: float, high: float = math.inf, *, whole: bool = False, above: bool = False, below: bool = False
) -> DomainType:
    """Option type: a finite number of `clrender.limits.Range`."""
    return DomainType(Range(low, high, whole, above, below))


def numbers(metavar: str, example: str, most: float = math.inf) -> Callable[[Any], tuple[float, ...]]:
    """Option type: finite numbers separated by commas, as many as the letters of `metavar`."""
    count = {2: "two", 3: "three"}[len(metavar.split(","))]

    def parsed(value: Any) -> tuple[float, ...]:
        try:
            found = tuple(float(part) for part in str(value).split(","))
        except ValueError:
            found = ()
        if len(found) != len(metavar.split(",")):
            raise click.BadParameter(f"{str(value)[:60]!r} is not {count} numbers such as {example}.")
        if not all(math.isfinite(each) and abs(each) <= most for each in found):
            limit = f" of at most {most:g} in size" if math.isfinite(most) else ""
            raise click.BadParameter(f"has to be {count} finite numbers{limit}.")
        return found

    parsed.__name__ = metavar
    return parsed


def setting_option(name: str, default: Any = None, help: str = "") -> Callable[[Any], Any]:
    """Decorator: the option of one setting of the table.

    Parameters
    ----------
    name : str
        Name of the setting and of the argument, which is None if the option is not given.
    default
        Default of this command, if it differs from the scene's or the table's.
    help : str
        Help text, if the option has a different meaning in this command.
    """
    setting = SETTINGS[name]
    assert setting.option is not None
    words = default if default is not None else setting.default_words
    if isinstance(setting.domain, Flag):
        both = f"{setting.option}/--no-{setting.option.removeprefix('--')}"
        return click.option(both, name, default=default, help=help or f"{setting.help} ({words}).")
    return click.option(
        setting.option,
        name,
        type=DomainType(setting.domain),
        default=default,
        metavar=setting.metavar,
        help=help or f"{setting.help} ({words}).",
    )


def setting_options(command: Any, without: Container[str] = ()) -> Any:
    """Decorator: the options of all settings of the table, in its order, except some; former names are hidden."""
    for setting in reversed(list(SETTINGS.values())):
        if setting.option is not None and setting.name not in without:
            command = setting_option(setting.name)(command)
            if setting.former:
                former = "--" + setting.former.replace("_", "-")
                kind = DomainType(setting.domain)
                command = click.option(former, setting.former, type=kind, default=None, hidden=True)(command)
    return command


def size(value: Any) -> tuple[int, int]:
    """Option type: an image size such as 800x600, as (width, height) in pixels."""
    match = re.fullmatch(r"(\d{1,9})[xX×](\d{1,9})", str(value), re.ASCII)
    if match is None:
        raise click.BadParameter(f"{shown(value)} is not a size in pixels such as 800x600.")
    width, height = int(match[1]), int(match[2])
    for side, name in ((width, "width"), (height, "height")):
        try:
            SETTINGS[name].accept(side)
        except NotAllowed as error:
            raise click.BadParameter(f"the {name} of {shown(value)} {error}.") from None
    if width * height > PIXEL_LIMIT:
        raise click.BadParameter(f"{shown(value)} is more than {counted(PIXEL_LIMIT, 'pixel')}.")
    return width, height


def shard(value: Any) -> tuple[int, int]:
    """Option type: a part of the samples such as 1/3, as (number, count)."""
    match = re.fullmatch(r"(\d{1,7})/(\d{1,7})", str(value), re.ASCII)
    if match is None or not 1 <= int(match[1]) <= int(match[2]):
        raise click.BadParameter(f"{shown(value)} is not a shard such as 1/3, from 1/N to N/N.")
    return int(match[1]), int(match[2])


class _ShutterType(DomainType):
    """Option type: seconds, possibly as a fraction such as 1/125."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        if (
            isinstance(value, str)
            and (match := re.fullmatch(r"(\d{1,9})/(\d{1,9})", value, re.ASCII))
            and int(match[2])
        ):
            value = int(match[1]) / int(match[2])
        return super().convert(value, param, ctx)


class _IntervalType(_ShutterType):
    """Option type: an exposure time, or when a shutter opens and closes, such as 0:1/48."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        if not (isinstance(value, str) and ":" in value):
            return super().convert(value, param, ctx)
        ends = []
        for end in value.split(":"):
            match = re.fullmatch(r"(-?\d{1,9})/(\d{1,9})", end, re.ASCII)
            try:
                ends.append(int(match[1]) / int(match[2]) if match else float(end))
            except (ValueError, ZeroDivisionError):
                ends.clear()
                break
        if len(ends) != 2 or not all(math.isfinite(end) for end in ends) or ends[1] < ends[0]:
            self.fail(
                f"{shown(value)} is no interval such as 0:1/48, in seconds from the time of the image.", param, ctx
            )
        return tuple(ends)


def display_options(command: Any, *, of: str) -> Any:
    """Decorator: tone mapping and exposure, of what is said."""
    exposed = click.option(
        "--exposure",
        type=number(-128, 128),
        default=0.0,
        show_default=True,
        metavar="EV",
        help=f"Exposure of {of}, in stops.",
    )
    mapped = click.option(
        "--tone-map",
        type=DomainType(Choice(TONE_MAPS)),
        default="srgb",
        show_default=True,
        help=f"Tone mapping of {of}.",
    )
    return mapped(exposed(command))


def tone_options(command: Any, *, moving: bool = False) -> Any:
    """Decorator: the options of every command that writes display images; of `moving` ones with motion blur."""
    interval = " Or when it opens and closes, such as 0:1/48, for motion blur." if moving else ""
    options = [
        click.option(
            "--f-stop",
            type=DomainType(PHOTOGRAPHIC["f_stop"]),
            metavar="N",
            help="F-number; with --shutter, sets the photographic exposure (none).",
        ),
        click.option(
            "--shutter",
            type=(_IntervalType if moving else _ShutterType)(PHOTOGRAPHIC["shutter"]),
            metavar="S",
            help=f"Exposure time in seconds, such as 1/125; see --f-stop (none).{interval}",
        ),
        click.option(
            "--iso", type=DomainType(PHOTOGRAPHIC["iso"]), metavar="S", help="Film speed; see --f-stop (100)."
        ),
    ]
    for option in reversed(options):
        command = option(command)
    return display_options(command, of=".png and .jpg")


def view_options(command: Any) -> Any:
    """Decorator: options that take a view of OpenColorIO for `tone_map`, above `tone_options`."""

    @functools.wraps(command)
    def chosen(*args: Any, ocio: str | None, display: str | None, view: str | None, **more: Any) -> Any:
        asked = {"--display": display, "--view": view}
        for option in (each for each, value in asked.items() if value is not None and ocio is None):
            raise UsageError(
                f"{option}: is for --ocio; name a configuration, such as `--ocio builtin`, or leave it out"
            )
        if ocio is not None:
            context = click.get_current_context()
            if context.get_parameter_source("tone_map") == ParameterSource.COMMANDLINE:
                raise UsageError("--ocio: --tone-map is another way to make display images; leave one of them out")
            from clrender.image.ocio import display_view

            more["tone_map"] = display_view(ocio, display, view)
        return command(*args, **more)

    for option in (
        click.option("--view", metavar="NAME", help="View of the display (the configuration's default)."),
        click.option("--display", metavar="NAME", help="Display of --ocio (the configuration's default)."),
        click.option(
            "--ocio",
            metavar="CONFIG",
            help="OpenColorIO configuration that makes .png and .jpg, instead of --tone-map: a file, ocio://NAME, or "
            "builtin, with ACES 2.0 (none).",
        ),
    ):
        chosen = option(chosen)
    return chosen


class EnvironmentType(click.ParamType):  # type: ignore[type-arg]  # not generic before click 8.3
    """Option type: a number or the name of a file."""

    name = "environment"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Path | float:
        try:
            return float(value)
        except ValueError:
            return Path(value)


EXR_COMPRESSIONS: Final = ("none", "rle", "zips", "zip", "piz", "pxr24", "dwaa", "dwab")
"""The names of `clrender.image.exr_write.COMPRESSIONS`, without loading it."""


def exr_options(command: Any) -> Any:
    """Decorator: the options for the storage of pixels in an ``.exr``."""
    options = [
        click.option(
            "--exr-type",
            type=DomainType(Choice(("float", "half"))),
            default="float",
            show_default=True,
            help="Precision of colours and directions in .exr; other channels are always float.",
        ),
        click.option(
            "--exr-compression",
            type=DomainType(Choice(EXR_COMPRESSIONS)),
            default="zip",
            show_default=True,
            help="Compression of .exr; pxr24, dwaa and dwab are lossy.",
        ),
        click.option(
            "--exr-tile", type=number(16, 4096, whole=True), metavar="N", help="Tile size of .exr (scan lines)."
        ),
    ]
    for option in reversed(options):
        command = option(command)
    return command


PROGRESS_STYLES: Final = ("auto", "json")
"""The names of `clrender.cli.progress.STYLES`, without loading it."""


def progress_options(command: Any) -> Any:
    """Decorator: the options for the progress of a render on stderr."""
    options = [
        click.option(
            "--progress",
            type=DomainType(Choice(PROGRESS_STYLES)),
            default="auto",
            show_default=True,
            help="Progress on stderr: a bar on a terminal, else occasional lines; json: one object per line.",
        ),
        click.option(
            "--preview", is_flag=True, help="Show the image in the terminal, if supported (kitty, iTerm2, sixel)."
        ),
        click.option("--quiet", is_flag=True, help="No progress; only errors on stderr."),
    ]
    for option in reversed(options):
        command = option(command)
    return command


def _definitions(_ctx: click.Context, _param: click.Parameter, given: tuple[str, ...]) -> dict[str, str]:
    """Values by name."""
    parts = [each.partition("=") for each in given]
    for (name, equals, _), whole in zip(parts, given, strict=True):
        if not (name and equals):
            raise click.BadParameter(f"{whole!a} is no definition; write it as NAME=VALUE")
    return {name: value for name, _, value in parts}


def allow_path_option(command: Any) -> Any:
    """Decorator: the option for folders from which a scene may read files."""
    return click.option(
        "--allow-path",
        "allow_paths",
        type=click.Path(path_type=Path, exists=True, file_okay=False),
        metavar="DIR",
        multiple=True,
        help="Additional folder from which the scene may read files. Repeatable.",
    )(command)


def plugin_option(command: Any) -> Any:
    """Decorator: the option for plugins that materials of a scene may use."""
    return click.option(
        "--plugin",
        "plugins",
        type=click.Path(path_type=Path),
        metavar="FILE",
        multiple=True,
        shell_complete=complete_files,
        help="BSDF, texture or light in OpenCL C that scenes may use; it is compiled and run. Repeatable.",
    )(command)


def load_options(command: Any) -> Any:
    """Decorator: the options of `clrender.importers.load`, which the command gets together as `reading`."""
    names = ("allow_paths", "time_at", "variant", "up", "define", "camera", "hide_environment", "strict", "plugins")

    @functools.wraps(command)
    def run(*arguments: Any, **options: Any) -> Any:
        reading = {name: options.pop(name) for name in names}
        return command(*arguments, reading=reading, **options)

    return _choice_options(allow_path_option(plugin_option(run)))


def _choice_options(command: Any) -> Any:
    """Decorator: the options for choices that a file of another format leaves open."""
    command = click.option(
        "--strict", is_flag=True, help="Refuse a file of another format for faults that are otherwise noted."
    )(command)
    command = click.option(
        "-D",
        "--define",
        "define",
        metavar="NAME=VALUE",
        multiple=True,
        callback=_definitions,
        help="Value of a parameter of a Mitsuba scene. Repeatable.",
    )(command)
    command = click.option(
        "--up",
        type=click.Choice(["y", "z"]),
        help="Upward axis of a model in .obj, .ply or .stl, which has no camera; default: z for .stl, else y.",
    )(command)
    command = click.option(
        "--hide-environment",
        is_flag=True,
        help="The camera does not see the environment, which lights the scene all the same.",
    )(command)
    command = click.option(
        "--camera",
        metavar="FILE[#NAME]",
        shell_complete=complete_files,
        help="Camera in place of the scene's: a .toml or .json with a camera or a camera matrix, or one of "
        "transforms.json, a folder of COLMAP or a glTF file.",
    )(command)
    command = click.option("--variant", metavar="NAME", help="Material variant of a glTF file.")(command)
    return click.option(
        "--time-at",
        type=float,
        metavar="S",
        help="Time of the image, seconds, in a scene with motions or a glTF file with an animation; default: that of "
        "the camera (0), or the rest pose.",
    )(command)


scene_argument = click.argument("scene", metavar="SCENE", shell_complete=complete_scenes)
"""The scene to render."""

outputs_option = click.option(
    "-o",
    "--output",
    "outputs",
    metavar="FILE",
    type=click.Path(path_type=Path),
    multiple=True,
    required=True,
    help="Output file: .png .jpg for display, .exr .npy .hdr linear, .film exact sums. Repeatable.",
)
"""Images and films of every command that writes them."""

size_option = click.option("--size", type=size, metavar="WxH", help="Image size, pixels (800x800).")
"""The size of the image."""

device_option = click.option(
    "-d",
    "--device",
    "devices",
    metavar="SPEC",
    multiple=True,
    shell_complete=complete_devices,
    help="auto, cpu, gpu, all, an index from `clrender devices` or part of a name; repeatable "
    "(CLRENDER_DEVICE, else auto).",
)
"""The device that renders."""

environment_option = click.option(
    "--environment",
    type=EnvironmentType(),
    shell_complete=complete_files,
    metavar="FILE",
    help="Environment map (lat-long .exr, .hdr or .png), or a number as constant radiance, for scenes without one.",
)
"""The environment of the scene."""
