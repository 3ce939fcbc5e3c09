"""`clrender radiosity`: an animation of a moving shape, in which the solution is updated instead of solved again."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from clrender.cli.completing import complete_devices, complete_scenes
from clrender.cli.folder import output_folder
from clrender.cli.options import allow_path_option, number, numbers, setting_option, tone_options
from clrender.cli.options import size as parse_size
from clrender.cli.outputs import check_distinct, scene_files
from clrender.cli.streams import tell
from clrender.errors import UsageError
from clrender.image.exposure import photographic_stops
from clrender.settings import SETTINGS, settings_for
from clrender.wording import counted

if TYPE_CHECKING:
    from clrender.radiosity.dynamic import DynamicRadiosity

__all__ = ["radiosity"]


@click.command()
@click.argument("scene", metavar="SCENE", shell_complete=complete_scenes)
@click.option(
    "-o",
    "--output",
    "folder",
    metavar="DIR",
    type=click.Path(path_type=Path),
    required=True,
    help="Output folder for frame-0000.png, frame-0001.png, …",
)
@click.option(
    "--move",
    "shape",
    type=number(0, 2**31 - 1, whole=True),
    required=True,
    help="Index of the moving shape, from 0.",
)
@click.option(
    "--by", type=numbers("X,Y,Z", "0.05,0,0"), metavar="X,Y,Z", required=True, help="Translation per frame, metres."
)
@click.option(
    "--frames", "count", type=number(1, 10**6, whole=True), default=24, show_default=True, help="Number of frames."
)
@setting_option("spp", 16)
@click.option("--size", type=parse_size, metavar="WxH", help="Image size, pixels (from the scene, else 800x800).")
@setting_option("patches", SETTINGS["patches"].default)
@setting_option("patch_rays", SETTINGS["patch_rays"].default)
@setting_option("radiosity_display", SETTINGS["radiosity_display"].default)
@click.option("-d", "--device", metavar="SPEC", shell_complete=complete_devices, help="As for `clrender render`.")
@tone_options
@allow_path_option
def radiosity(
    *,
    scene: str,
    folder: Path,
    shape: int,
    by: tuple[float, float, float],
    count: int,
    spp: int,
    size: tuple[int, int] | None,
    patches: int,
    patch_rays: int,
    radiosity_display: str,
    device: str | None,
    tone_map: str,
    exposure: float,
    allow_paths: tuple[Path, ...],
    **photograph: float | None,
) -> None:
    """Animate SCENE: a shape moves, and only the affected light transport is computed again.

    Each frame is written as a .png file, and its statistics are printed on one line.
    """
    from clrender.drivers import select
    from clrender.film.unit import tile_side
    from clrender.flatten.assembly import numbers_written_out
    from clrender.image.files import write_image
    from clrender.importers import load
    from clrender.meshes.data import COORDINATE_LIMIT
    from clrender.radiosity.animate import Motion, frames
    from clrender.radiosity.dynamic import DynamicRadiosity
    from clrender.radiosity.solution import RadiositySettings

    description = load(scene, allow_paths=allow_paths)
    if shape >= len(description.shapes):
        raise UsageError(f"--move: there is no shape {shape}; the scene has {len(description.shapes)}, from 0")
    reach = (count - 1) * max(map(abs, by))
    if reach > COORDINATE_LIMIT:
        raise UsageError(
            f"--by: {counted(count, 'frame')} would move the shape {reach:g} metres; {COORDINATE_LIMIT:g} is the most"
        )
    exposure += photographic_stops(**(description.with_exposure(**photograph).camera.exposure or {}))
    every = (folder / f"frame-{index:04}.png" for index in range(count))
    check_distinct(every, scene_files(scene, description))
    own = {"patches": patches, "patch_rays": patch_rays, "radiosity_display": radiosity_display}
    wanted = settings_for(description, size, {"spp": spp, "integrator": "radiosity", **own})
    with output_folder(folder, "frame-0000.png"):
        chosen = select(device)[0]
        struct = wanted.struct(tile_side(wanted.tile, wanted.width, wanted.height))
        sought = RadiositySettings(wanted.patches, wanted.patch_rays, tolerance=1e-3, refine=False, seed=wanted.seed)
        dynamic = DynamicRadiosity(description, chosen, sought, (wanted.width, wanted.height))
        seconds = []
        try:
            motions = [Motion(number, by) for number in numbers_written_out(description, shape)]
            display = wanted.radiosity_display
            for index, frame in enumerate(frames(dynamic, chosen, struct, motions, count, wanted.spp, display)):
                path = folder / f"frame-{index:04}.png"
                write_image(path, frame.linear, {}, tone_map, exposure)
                did = frame.update
                seconds.append(did.seconds)
                share = did.rays / did.all_rays
                tell(
                    f"{path}: {share:.1%} of {counted(did.all_rays, 'ray')}, {counted(did.sweeps, 'sweep')}, "
                    f"{did.seconds:.3f} s"
                )
            if len(seconds) > 1:
                tell(_verdict(dynamic, seconds[1:]))
        finally:
            dynamic.release()


def _verdict(dynamic: DynamicRadiosity, seconds: list[float]) -> str:
    """Comparison of the last frame with one that is solved from scratch."""
    import numpy as np

    updated = dynamic.reflected
    fresh = dynamic.start_again().seconds
    anew = dynamic.reflected
    areas = np.append(np.repeat(dynamic.patches.areas, 2), 0.0)[:, None]
    difference = float((np.abs(updated - anew) * areas).sum() / (anew * areas).sum())
    middle = sorted(seconds)[len(seconds) // 2]
    return (
        f"median update of a frame: {middle:.3f} s; full solution: {fresh:.3f} s, {fresh / middle:.1f} times as long; "
        f"difference: {difference:.2%} of the radiosity"
    )
