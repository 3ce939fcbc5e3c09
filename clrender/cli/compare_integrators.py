"""`clrender compare --integrators`: tests whether integrators agree on a scene; writes a table, maps and numbers."""

from __future__ import annotations

import itertools
import json
import sys
from collections.abc import Iterator, Sequence
from contextlib import nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import click

from clrender.cli.folder import output_folder
from clrender.cli.interrupt import interruptible
from clrender.cli.outputs import check_distinct, scene_files
from clrender.cli.progress import ProgressDisplay
from clrender.cli.streams import tell
from clrender.integrators import INTEGRATORS
from clrender.wording import counted

if TYPE_CHECKING:
    import numpy as np
    import numpy.typing as npt

    from clrender.agreement.batches import Batches, Pair
    from clrender.scene import Scene

__all__ = ["compare_on_scene"]

_NUMBERS: Final = "agreement.json"
_MEANS: Final = (".png", ".exr")
_FULL: Final = 6
"""|z| at full colour in the maps: hardly any tile reaches it by chance."""
_COLUMNS: Final = ("ratio of means", "95 % interval", "tiles that differ", "largest z")


def compare_on_scene(
    scene: str,
    integrators: Sequence[str],
    *,
    devices: Sequence[str],
    output: Path | None,
    as_json: bool,
    check: bool,
    quiet: bool,
    allow_paths: Sequence[Path],
    plugins: Sequence[Path],
    **options: int | tuple[int, int] | None,
) -> None:
    """Compare integrators on a scene; write and print the results.

    Raises
    ------
    ClrenderError
        See `clrender.agreement.integrators.compare_integrators`; also when files cannot be written.
    """
    from clrender.agreement.integrators import check_integrators, compare_integrators, labels
    from clrender.importers import load

    names = [name.strip() for name in integrators]
    check_integrators(names)
    description = load(scene, allow_paths=allow_paths, plugins=plugins)
    if output is not None:
        check_distinct(_files(output, labels(names)), scene_files(scene, description))
    given: dict[str, Any] = {name: value for name, value in options.items() if value is not None}
    folder = nullcontext() if output is None else output_folder(output, _NUMBERS)
    with folder, interruptible() as interrupt, ProgressDisplay(quiet=quiet) as display:

        def on_progress(progress: Any) -> None:
            if interrupt.wanted():
                raise KeyboardInterrupt
            display(progress)

        try:
            made, pairs = compare_integrators(
                description, names, device=list(devices) or None, on_progress=on_progress, notify=display.say, **given
            )
        except KeyboardInterrupt:
            click.echo("error: interrupted; nothing was written", err=True)
            sys.exit(interrupt.exit_code)
    numbers = _numbers(description, given, made, pairs)
    if output is not None:
        _write(output, made, pairs, numbers)
    tell(json.dumps(numbers, indent=2) if as_json else _table(numbers))
    from clrender.agreement.verdict import FAULT

    if check and any(pair.verdict.kind == FAULT for pair in pairs):
        sys.exit(1)


def _numbers(
    description: Scene, given: dict[str, Any], made: Sequence[Batches], pairs: Sequence[Pair]
) -> dict[str, Any]:
    """All results, as JSON values."""
    from clrender.agreement.batches import LEVEL
    from clrender.version import __version__

    height, width = made[0].image.shape[:2]
    return {
        "scene": description.source,
        "scene_sha256": description.sha256(),
        "version": __version__,
        "width": width,
        "height": height,
        "seed": given.get("seed", 0),
        "batches": len(made[0].whole),
        "tile_size": made[0].tile_size,
        "tiles": list(made[0].tiles.shape[2:0:-1]),
        "level": LEVEL,
        "integrators": [
            {
                "label": one.label,
                "integrator": one.name,
                "bias": INTEGRATORS[one.name].bias,
                "leaves_out": list(INTEGRATORS[one.name].leaves_out),
                "mean": one.image.mean(axis=(0, 1), dtype="float64").tolist(),
                **one.numbers,
            }
            for one in made
        ],
        "pairs": [
            {"first": pair.first, "second": pair.second}
            | pair.numbers
            | {"verdict": pair.verdict.kind, "reason": pair.verdict.reason, "sentence": _sentence(pair)}
            for pair in pairs
        ],
    }


def _sentence(pair: Pair) -> str:
    from clrender.agreement.verdict import AGREE, FAULT

    n, kind, reason = pair.numbers, pair.verdict.kind, pair.verdict.reason
    text = f"{kind}: {reason}" if reason else kind
    if kind == AGREE:
        seen = " and ".join(
            f"{100.0 * n[key]:.2g} % of {what}"
            for key, what in (("visible_in_tile", "a tile"), ("visible_in_mean", "the mean"))
            if n[key] is not None
        )
        text += f"; differences of {seen} would have been detected" if seen else "; both are black"
    elif kind == FAULT and n["tiles_with_fireflies"] > n["tiles"] / 100:
        text += (
            f"; fireflies in {counted(n['tiles_with_fireflies'], 'tile')} make the test unreliable; repeat it "
            "with more samples"
        )
    return text


def _table(numbers: dict[str, Any]) -> str:
    """A line of numbers for every pair, followed by their interpretation."""
    width = max(len(f"{pair['first']} / {pair['second']}") for pair in numbers["pairs"])
    spp = numbers["integrators"][0]["spp"]
    lines = [
        f"{numbers['scene']}: {numbers['width']}x{numbers['height']}, {counted(spp, 'sample')} per pixel "
        f"in {counted(numbers['batches'], 'batch', 'batches')}, {numbers['tiles'][0]}x{numbers['tiles'][1]} tiles",
        "",
        f"{'':<{width}}  {_COLUMNS[0]:>14}  {_COLUMNS[1]:>19}  {_COLUMNS[2]:>17}  {_COLUMNS[3]:>9}",
    ]
    for pair in numbers["pairs"]:
        low_high = pair["mean_ratio_95"]
        ratio = "-" if low_high is None else f"{pair['mean_ratio']:.5f}"
        interval = "-" if low_high is None else f"{low_high[0]:.5f} to {low_high[1]:.5f}"
        share = f"{pair['tiles_differ']} of {pair['tiles']}"
        name = f"{pair['first']} / {pair['second']}"
        lines.append(f"{name:<{width}}  {ratio:>14}  {interval:>19}  {share:>17}  {pair['largest_z']:>9.2f}")
    lines.append("")
    lines += [f"{pair['first']} and {pair['second']} {pair['sentence']}" for pair in numbers["pairs"]]
    dropped = {one["label"]: one["nonfinite_samples"] for one in numbers["integrators"]}
    if left_out := [f"{label}: {count}" for label, count in dropped.items() if count]:
        lines.append(f"discarded samples that were not finite: {', '.join(left_out)}")
    return "\n".join(lines)


def _write(folder: Path, made: Sequence[Batches], pairs: Sequence[Pair], numbers: dict[str, Any]) -> None:
    """Write mean images, maps of z whose file names give the meaning of their colours, and the numbers."""
    from clrender.files.access import atomic_write
    from clrender.image.files import write_image

    height, width = made[0].image.shape[:2]
    for one, its in zip(made, numbers["integrators"], strict=True):
        notes = {"scene_sha256": numbers["scene_sha256"], "version": numbers["version"], **its}
        for ending in _MEANS:
            write_image(folder / f"{one.label}{ending}", one.image, notes)
    for pair, its in zip(pairs, numbers["pairs"], strict=True):
        write_image(
            folder / _map_name(pair.first, pair.second),
            _map(pair.scores, height, width, made[0].tile_size),
            its,
            "linear",
        )
    with atomic_write(folder / _NUMBERS) as file:
        file.write(json.dumps(numbers, indent=2).encode() + b"\n")


def _map_name(first: str, second: str) -> str:
    return f"z_{first}-minus-{second}_blue-{_FULL}_white-0_red+{_FULL}.png"


def _files(folder: Path, names: Sequence[str]) -> Iterator[Path]:
    """All files that `_write` makes for integrators with these labels."""
    yield folder / _NUMBERS
    yield from (folder / f"{name}{ending}" for name in names for ending in _MEANS)
    yield from (folder / _map_name(*pair) for pair in itertools.combinations(names, 2))


def _map(
    scores: npt.NDArray[np.float64], height: int, width: int, side: int
) -> npt.NDArray[np.float64]:  # fmt: skip
    """Map of z, (height, width, 3) float64: blue where the first is darker, red where brighter, white if unknown."""
    import numpy as np

    from clrender.drawing.pictures import diverging

    return diverging(scores / _FULL)[np.arange(height) // side][:, np.arange(width) // side] / 255.0
