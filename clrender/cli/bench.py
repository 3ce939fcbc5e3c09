"""`clrender bench`: measures the speed of clrender and of other renderers on this machine."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import click

from clrender.cli.completing import complete_benchmarks, complete_devices
from clrender.cli.options import number, setting_option, size
from clrender.cli.pages import check_page, write_page
from clrender.cli.streams import tell
from clrender.wording import counted

__all__ = ["bench"]


@click.command()
@click.argument("names", metavar="[SCENE]...", nargs=-1, shell_complete=complete_benchmarks)
@click.option("--size", "wanted", type=size, default="800x800", show_default=True, help="Image size, pixels.")
@setting_option("spp", 16)
@click.option(
    "--repeats",
    type=number(1, 1000, whole=True),
    default=3,
    show_default=True,
    help="Measured runs per renderer, after one warm-up run.",
)
@click.option("-d", "--device", shell_complete=complete_devices, help="As for `clrender render`.")
@click.option(
    "--peer",
    "peers",
    multiple=True,
    metavar="NAME=PYTHON",
    help="Another renderer, and the Python interpreter in which it is installed. Repeatable.",
)
@setting_option("light_sampler", "auto", "Light sampler of clrender (auto); Mitsuba selects lights uniformly.")
@click.option(
    "--errors",
    is_flag=True,
    help="Also measure error and efficiency, against references with 64 times as many samples.",
)
@click.option(
    "--plot",
    type=click.Path(path_type=Path),
    metavar="FILE",
    help="Write a self-contained .html page with plots.",
)
@click.option("--list", "listed", is_flag=True, help="List the scenes and the other renderers.")
def bench(
    names: tuple[str, ...], wanted: tuple[int, int], spp: int, repeats: int, device: str | None, peers: tuple[str, ...],
    light_sampler: str, errors: bool, plot: Path | None, listed: bool,
) -> None:  # fmt: skip
    """Render benchmark scenes (default: S1 and S2), or scene files, and print one line of JSON per run.

    Paths have 14 segments and no Russian roulette. Renderers run alternately. Rates are per second of CPU time, so
    other load on the machine has little influence. A summary table is printed to stderr.
    """
    from clrender.bench import PEERS, SCENES, measure, peer_from, summary
    from clrender.bench.peers import Task

    if listed:
        for name, description in SCENES.items():
            click.echo(f"{name:<8}  {description}")
        click.echo(f"\npeers: {', '.join(PEERS)}")
        return
    if plot is not None:
        check_page(plot)
    others = [peer_from(text) for text in peers]
    task = Task(*wanted, spp, errors, light_sampler)
    say = click.echo if plot is None else tell  # a page is made for others than the reader of the lines
    runs = measure(names or ("S1", "S2"), others, task, repeats, device, lambda run: say(json.dumps(run.line())))
    rows = summary(runs)
    click.echo(_table(rows), err=True)
    if plot is not None:
        from clrender.bench.page import bench_page

        how = (
            f"{wanted[0]} × {wanted[1]} pixels, {counted(spp, 'sample')} per pixel, {counted(repeats, 'run')}; "
            "paths have 14 segments."
        )
        write_page(plot, bench_page(rows, [run.line() for run in runs], [how]))


def _table(rows: list[dict[str, Any]]) -> str:
    lines = [
        f"{'scene':<8}  {'renderer':<15}  {'Mpaths/s':>8}  {'lowest':>7}  {'highest':>7}  {'relMSE':>8}  "
        "relative speed of clrender"
    ]
    for row in rows:
        better = f", efficiency {row['efficiency_ratio']:.2f}" if "efficiency_ratio" in row else ""
        ratio = f"{row['ratio']:.2f}{better}" if "ratio" in row else ""
        rate = row.get("mpaths_per_second", row.get("mrays_per_second"))
        error = f"{row['rel_mse']:>8.5f}" if "rel_mse" in row else " " * 8
        unit = " (Mrays/s)" if "mrays_per_second" in row else ""
        numbers = f"{rate:>8.3f}  {row['lowest']:>7.3f}  {row['highest']:>7.3f}  {error}"
        lines.append(f"{row['scene']:<8}  {row['renderer']:<15}  {numbers}  {ratio}{unit}".rstrip())
    return "\n".join(lines)
