"""The command line: one click group whose commands are loaded only when they are called.

No slow modules are imported here, so that `clrender --version` and `--help` answer at once.
"""

from __future__ import annotations

import contextlib
import difflib
import importlib
import os
import shlex
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final, NoReturn

import click
from click.shell_completion import CompletionItem

from clrender.cli.interrupt import Terminated, exit_code_of, raising_signals
from clrender.cli.streams import ReaderLeft
from clrender.errors import ClrenderError
from clrender.limits import nearest
from clrender.wording import printable

__all__ = ["COMMANDS", "STARTED", "main"]

STARTED: Final = time.perf_counter()
"""Start time of the command line, by `time.perf_counter`."""

COMMANDS: Final[dict[str, str]] = {
    "render": "Render a scene to image files.",
    "view": "Show a scene live in the browser.",
    "paths": "Show the light paths of a pixel: vertices, densities, weights, contributions.",
    "dataset": "Make a labelled data set of many images.",
    "devices": "List OpenCL devices and their check results.",
    "doctor": "Diagnose OpenCL on this machine: problems, causes and fixes.",
    "new": "Write a commented example scene.",
    "scenes": "List the built-in scenes.",
    "check": "Check a scene file without rendering it.",
    "convert": "Convert a scene to clrender's format.",
    "blender": "Write the add-on for Blender.",
    "schema": "Print the JSON Schema of scene files.",
    "tonemap": "Tone-map a linear image for display.",
    "compare": "Compare an image with a reference, or integrators with each other.",
    "furnace": "Measure the physics of materials: energy, reciprocity, sampling.",
    "report": "Reproduce the original report: its table, figures and conclusions.",
    "merge": "Merge films of the same render, or write the image of one.",
    "verify": "Render parts of an image or a data set again and compare them bit for bit.",
    "radiosity": "Animate a moving shape in a diffuse scene.",
    "bench": "Benchmark clrender, optionally against other renderers.",
    "warmup": "Compile kernels before they are needed.",
    "completion": "Print a shell completion script.",
}
"""Name -> first line of the help; the command `NAME` is the function `NAME` in the module `clrender.cli.NAME`."""


_MEANT: Final = {
    **dict.fromkeys(("samples", "samples-per-pixel", "sample-count"), "--spp"),
    **dict.fromkeys(("bounces", "depth", "max-bounces"), "--max-depth"),
    **dict.fromkeys(("width", "height", "resolution", "dimensions"), "--size"),
    **dict.fromkeys(("gpu", "cpu", "platform", "backend"), "--device"),
    **dict.fromkeys(("timeout", "time-limit", "seconds"), "--time"),
    **dict.fromkeys(("noise", "quality", "tolerance"), "--error"),
    **dict.fromkeys(("out", "output-file", "outfile"), "--output"),
    **dict.fromkeys(("layers", "aovs", "passes"), "--aov"),
}
"""What other renderers call an option."""


class _Commands(click.Group):
    def list_commands(self, ctx: click.Context) -> list[str]:
        return list(COMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        if cmd_name not in COMMANDS:
            return None
        command: click.Command = getattr(importlib.import_module(f"clrender.cli.{cmd_name}"), cmd_name)
        return command

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        if args[0] not in COMMANDS and not args[0].startswith("-"):
            cure = nearest(args[0], COMMANDS) or f"; choose one of {', '.join(COMMANDS)}."
            if _is_scene(args[0]):
                cure = f"; did you mean `clrender render {shlex.quote(printable(args[0]))} -o image.png`?"
            raise click.UsageError(f"there is no command {args[0]!r}{cure}", ctx)
        return super().resolve_command(ctx, args)

    def shell_complete(self, ctx: click.Context, incomplete: str) -> list[CompletionItem]:
        # click's implementation would import every command as well.
        names = [CompletionItem(name, help=line) for name, line in COMMANDS.items() if name.startswith(incomplete)]
        return names + click.Command.shell_complete(self, ctx, incomplete)

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        # click's implementation would import every command for its first line.
        with formatter.section("Commands"):
            formatter.write_dl(list(COMMANDS.items()))

    def main(
        self,
        args: Sequence[str] | None = None,
        prog_name: str | None = None,
        complete_var: str | None = None,
        standalone_mode: bool = True,
        **extra: Any,
    ) -> Any:
        """Run the command line, and end the process with the exit code of the error, if any."""
        if not standalone_mode:
            return super().main(args, prog_name, complete_var, standalone_mode=False, **extra)
        try:
            with raising_signals():
                code = super().main(args, prog_name or "clrender", complete_var, standalone_mode=False, **extra)
            sys.stdout.flush()
        except ClrenderError as error:
            if error.extra is not None:
                _install_and_restart(error.extra, sys.argv[1:] if args is None else args)
            _fail(str(error), error.exit_code)
        except click.ClickException as error:
            _fail(_sentence(error), 2)
        except (KeyboardInterrupt, click.Abort) as error:
            _fail("interrupted.", exit_code_of(error if isinstance(error, Terminated) else error.__cause__))
        except RuntimeError as error:
            # Python 3.11 converts Ctrl-C during the creation of a class to this error
            if not isinstance(error.__cause__, KeyboardInterrupt):
                raise
            _fail("interrupted.", exit_code_of(error.__cause__))
        except MemoryError:
            _fail("out of memory; render a smaller image or close other programs.", 1)
        except FileNotFoundError:
            # Every path that does not begin with a slash depends on the working directory.
            if _has_working_folder():
                raise
            _fail("the working folder has been deleted; change to one that exists", 2)
        except ReaderLeft:
            sys.exit(0)
        sys.exit(code if isinstance(code, int) else 0)


def _install_and_restart(extra: str, args: Sequence[str]) -> None:
    """Let the script that started this process install an extra and start the command anew.

    Returns if no script did, or if it has already tried.
    """
    script = os.environ.get("CLRENDER_SCRIPT")
    if script is None or os.environ.get("CLRENDER_EXTRA") == extra:
        return
    sys.stdout.flush()
    with contextlib.suppress(OSError):
        os.execv(script, [script, "--extra", extra, *args])


def _has_working_folder() -> bool:
    try:
        Path.cwd()
    except FileNotFoundError:
        return False
    return True


def _fail(message: str, code: int) -> NoReturn:
    # Some messages end with a full stop, some do not.
    print(f"error: {message.rstrip('.')}", file=sys.stderr)
    sys.exit(code)


def _sentence(error: click.ClickException) -> str:
    """Message of a usage error, with a pointer to the help."""
    message = _no_such_option(error) if isinstance(error, click.NoSuchOption) else error.format_message()
    context = error.ctx if isinstance(error, click.UsageError) else None
    where = context.command_path if context is not None else "clrender"
    message = message[:1].lower() + message[1:]
    return f"{message.rstrip('.')}{'' if message.endswith('?') else ';'} see '{where} --help'"


def _is_scene(name: str) -> bool:
    """Whether a name is that of a file or of a built-in scene."""
    from clrender.files.package_data import scenes_folder

    with contextlib.suppress(OSError, ClrenderError):
        return Path(name).is_file() or (scenes_folder() / f"{name}.toml").is_file()
    return False


def _no_such_option(error: click.NoSuchOption) -> str:
    """The message of an unknown option, with those of the same meaning or a similar name."""
    command = error.ctx.command if error.ctx is not None else None
    known = [name for each in command.params for name in each.opts if name.startswith("--")] if command else []
    meant = _MEANT.get(error.option_name.lstrip("-"), "")
    near = [meant] if meant in known else difflib.get_close_matches(error.option_name, known, 2, 0.75)
    return f"no such option {error.option_name!r}" + (f"; did you mean {' or '.join(map(repr, near))}?" if near else "")


def _print_version(ctx: click.Context, _: click.Parameter, wanted: bool) -> None:
    if wanted:
        from clrender.version import info

        version, commit, kernels = info()
        lines = [f"clrender {version}", *([f"commit {commit}"] if commit else []), f"kernels {kernels}"]
        click.echo("\n".join(lines))
        ctx.exit()


@click.command(
    cls=_Commands,
    invoke_without_command=True,
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 110},
)
@click.option(
    "--version",
    is_flag=True,
    is_eager=True,
    expose_value=False,
    callback=_print_version,
    help="Print version, commit and kernel hash.",
)
@click.pass_context
def main(ctx: click.Context) -> None:
    """clrender: a physically based renderer that gives the same image, bit for bit, on every OpenCL device."""
    if ctx.invoked_subcommand is None:
        click.echo(ctx.get_help())
