"""`clrender devices`: lists all OpenCL devices and whether they compute correctly."""

from __future__ import annotations

import json

import click

__all__ = ["devices"]


@click.command()
@click.option("--json", "as_json", is_flag=True, help="Print a JSON list of objects instead of a table.")
def devices(as_json: bool) -> None:
    """List OpenCL devices and whether each computes correct results."""
    from clrender.drivers import devices as list_devices

    found = list_devices(notify=lambda line: click.echo(line, err=True))
    if as_json:
        click.echo(json.dumps(found, indent=2))
        return
    if not found:
        click.echo("no OpenCL device found; run `clrender doctor` for help")
        return
    header = ("", "name", "platform", "driver", "type", "units", "memory", "probe")
    rows = [
        (
            str(each["index"]),
            each["name"],
            each["platform"],
            each["driver"],
            each["type"],
            str(each["compute_units"]),
            f"{each['memory_bytes'] / 2**30:.1f} GiB",
            each["probe"],
        )
        for each in found
    ]
    widths = [max(len(row[column]) for row in (header, *rows)) for column in range(len(header))]
    for row in (header, *rows):
        click.echo("  ".join(text.ljust(width) for text, width in zip(row, widths, strict=True)).rstrip())
