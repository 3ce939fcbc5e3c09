"""`clrender report`: measures the founding report's table and figures again on this machine."""

from __future__ import annotations

import sys
from pathlib import Path

import click

from clrender.cli.completing import complete_devices
from clrender.cli.interrupt import interruptible
from clrender.cli.options import size as parse_size
from clrender.errors import UsageError
from clrender.wording import counted

__all__ = ["report"]


@click.command()
@click.option(
    "-o", "--output", "folder", metavar="DIR", type=click.Path(path_type=Path), required=True,
    help="Output folder, new or empty.",
)  # fmt: skip
@click.option("--quick", is_flag=True, help="160x160 pixels and fewer runs: about one minute instead of ten.")
@click.option(
    "--size", "wanted", type=parse_size, metavar="WxH", help="Image size, pixels (800x800 as in the original report)."
)
@click.option("-d", "--device", metavar="SPEC", shell_complete=complete_devices, help="As for `clrender render`.")
@click.option("--quiet", is_flag=True, help="No progress; only errors on stderr.")
def report(folder: Path, quick: bool, wanted: tuple[int, int] | None, device: str | None, quiet: bool) -> None:
    """Reproduce the report on which clrender is based: its benchmark table and its figures.

    Writes report.html, a self-contained page; report.md with its figures; and report.json with all numbers to DIR.
    """
    _check_folder(folder)
    with interruptible() as interrupt:
        from clrender.report import Stopped, make_report, write_files

        def say(line: str) -> None:
            if not quiet:
                click.echo(line, err=True)

        size = wanted or ((160, 160) if quick else (800, 800))
        try:
            files = make_report(size, quick, device, interrupt.wanted, say)
        except Stopped:
            click.echo("error: interrupted; nothing was written", err=True)
            sys.exit(interrupt.exit_code)
        interrupt.has_picture.set()  # writing is short and should not be interrupted
        write_files(folder, files)
    click.echo(
        f"{folder / 'report.html'}: {sum(map(len, files.values())) / 1e6:.1f} MB in {counted(len(files), 'file')}"
    )


def _check_folder(folder: Path) -> None:
    """Check that the folder is empty and can be written to, or can be created."""
    from clrender.files.access import check_writable

    if not folder.exists():
        check_writable(folder)
        return
    if not folder.is_dir():
        raise UsageError(f"{folder}: is a file; name a folder.")
    try:
        if any(folder.iterdir()):
            raise UsageError(f"{folder}: is not empty; name a new folder, or empty this one.")
    except PermissionError as error:
        raise UsageError(f"{folder}: cannot be read ({error.strerror}); choose another place.") from None
    check_writable(folder / "report.html")
