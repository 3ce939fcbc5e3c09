"""`clrender compare`: measures the error of an image against a reference, or tests whether integrators agree."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import click

from clrender.cli.completing import complete_devices, complete_files, complete_scenes
from clrender.cli.inputs import read_linear
from clrender.cli.options import allow_path_option, number, plugin_option, setting_option
from clrender.cli.options import size as parse_size
from clrender.cli.outputs import check_distinct
from clrender.cli.pages import check_page, write_page
from clrender.wording import counted, grouped

if TYPE_CHECKING:
    import numpy as np
    import numpy.typing as npt

__all__ = ["compare"]

_DISPLAYED: Final = (".png", ".jpg", ".jpeg")
_LINES: Final = (
    ("difference_of_means", "difference of means"),
    ("rmse", "RMSE"),
    ("relmse", "relMSE"),
    ("mean_relative_difference", "mean relative difference"),
    ("max_difference", "largest difference"),
    ("max_alpha_difference", "largest alpha difference"),
    ("flip", "FLIP"),
)


@click.command()
@click.argument("first", metavar="A|SCENE", shell_complete=complete_scenes)
@click.argument("second", metavar="[B]", required=False, shell_complete=complete_files)
@click.option("--json", "as_json", is_flag=True, help="Print JSON.")
@click.option(
    "--integrators", metavar="NAME,NAME…", help="Compare integrators on SCENE; the options below apply to it."
)
@setting_option("spp", help="Samples per pixel, total of all batches (256).")
@click.option(
    "--size", type=parse_size, metavar="WxH", help="Image size, pixels (from the scene, longer side at most 160)."
)
@setting_option("seed")
@click.option("--batches", type=number(8, 4096, whole=True), help="Independent batches per integrator (16).")
@click.option("--tile-size", type=number(1, 65536, whole=True), help="Side length of the compared tiles, pixels (8).")
@click.option(
    "-d", "--device", "devices", metavar="SPEC", multiple=True, shell_complete=complete_devices,
    help="As for `clrender render`; repeatable.",
)  # fmt: skip
@click.option(
    "-o",
    "--output",
    type=click.Path(path_type=Path),
    metavar="FILE|DIR",
    help="For two images: write an .html page with the images and difference maps. For integrators: write mean images, "
    "maps of z-scores and all numbers to a folder.",
)
@click.option("--check", is_flag=True, help="Exit with code 1 if integrators differ that should agree.")
@click.option("--quiet", is_flag=True, help="No progress; only errors on stderr.")
@plugin_option
@allow_path_option
@click.pass_context
def compare(ctx: click.Context, /, first: str, second: str | None, integrators: str | None, **options: Any) -> None:
    """Measure the error of image A relative to the reference B.

    Reads .npy .exr .hdr .film, and .png .jpg as displayed; colours are compared over black where there is alpha. Two
    films with replicates and different seeds are also tested for differences beyond their noise, per pixel and in the
    mean, with a family-wise error rate of 1 %.

    With --integrators: renders SCENE with each integrator, as independent batches of small images, and tests for each
    pair whether their means agree. Tiles are compared by t-tests, with a family-wise error rate of 1 % as long as
    fireflies are rare. Radiosity is compared by its final gather. The exit code is 0 whatever the result, unless
    --check is given.
    """
    as_json = options.pop("as_json")
    if integrators is not None:
        if second is not None:
            raise click.UsageError(f"--integrators takes one scene, and there is also {second!r}.", ctx)
        from clrender.cli.compare_integrators import compare_on_scene

        compare_on_scene(first, integrators.split(","), as_json=as_json, **options)
        return
    output = options.pop("output")
    for name, value in options.items():
        if value is not None and value is not False and value != ():  # 0 is a value
            parameter = next(each for each in ctx.command.params if each.name == name)
            raise click.UsageError(f"{parameter.opts[-1]} goes with --integrators NAME,NAME… SCENE.", ctx)
    if second is None:
        raise click.UsageError("missing argument 'B', the reference; or give --integrators and a scene.", ctx)
    from clrender.image.compare import compare_images

    files = Path(first), Path(second)
    if output is not None:
        check_distinct([output], files)
        check_page(output)
    tested = _films(*files)
    (image, alpha), (reference, other) = (_covered(file) for file in files)
    numbers = compare_images(image, reference) | _difference_of_alpha(alpha, other) | tested
    numbers["identical"] &= not numbers.get("max_alpha_difference")
    if (alpha is None) != (other is None):
        with_alpha, without = (first, second) if other is None else (second, first)
        text = f"{with_alpha} has alpha, and {without} has none, which counts as 1 everywhere"
        click.echo(f"note: {text}", err=True)
    shown = [file.suffix.lower() in _DISPLAYED for file in files]
    if any(shown) and not all(shown):
        picture, linear = (first, second) if shown[0] else (second, first)
        text = f"{picture} is a display image, with a tone curve, and {linear} is linear; compare two of a kind"
        click.echo(f"note: {text}", err=True)
    if output is not None:
        from clrender.agreement.page import compare_page

        write_page(output, compare_page((first, second), image, reference, _lines(numbers)))
    click.echo(json.dumps(numbers, indent=2) if as_json else _table(_lines(numbers)))


def _covered(file: Path) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.float32] | None]:
    """A linear image, over black where it has alpha, and its alpha, (H, W), from 0 to 1."""
    import numpy as np

    from clrender.image.files import DISPLAY_ENDINGS, read_alpha, read_coverage

    image, _ = read_linear(file)
    if file.suffix.lower() not in DISPLAY_ENDINGS:
        return image, read_coverage(file)
    bytes_of_alpha = read_alpha(file)
    if bytes_of_alpha is None:
        return image, None
    alpha = bytes_of_alpha.astype(np.float32) / np.float32(255.0)
    return image * alpha[..., None], alpha


def _difference_of_alpha(
    first: npt.NDArray[np.float32] | None, second: npt.NDArray[np.float32] | None
) -> dict[str, float]:
    """The largest difference of coverage, if there is any."""
    if first is None and second is None:
        return {}
    import numpy as np

    one, other = (np.float32(1.0) if each is None else each for each in (first, second))
    return {"max_alpha_difference": float(np.abs(one - other).max())}


def _films(first: Path, second: Path) -> dict[str, Any]:
    """Result of the test of two films, or the reason why there is none; empty for other files."""
    from clrender.image.files import FILM_ENDINGS

    if not {first.suffix.lower(), second.suffix.lower()} <= set(FILM_ENDINGS):
        return {}
    from clrender.agreement.films import compare_films
    from clrender.errors import UsageError
    from clrender.film import Film

    films = Film.load(first), Film.load(second)
    try:
        return {"z_test": compare_films(*films, (str(first), str(second))), "z_test_refused": None}
    except UsageError as error:
        return {"z_test": None, "z_test_refused": str(error)}


def _verdict(found: dict[str, Any]) -> str:
    """Result of the test of two films, as one line of text."""
    if found["agree"]:
        return f"agree: no pixel of {found['pixels']} differs, nor does the mean, at the level {found['level']:g}"
    what = (
        [f"{grouped(found['differing_pixels'])} of {counted(found['pixels'], 'pixel')}"]
        if found["differing_pixels"]
        else []
    )
    if found["first_differing"]:
        what[0] += " (most significant: column {}, row {})".format(*found["first_differing"])
    what += ["the mean of the image"] if found["mean_differs"] else []
    return f"differ, at the level {found['level']:g}: {' and '.join(what)}"


def _lines(numbers: dict[str, Any]) -> list[tuple[str, str]]:
    """Names and values of the measures, as text."""
    means = [
        ("mean of A", " ".join(f"{value:.6g}" for value in numbers["mean"])),
        ("mean of B", " ".join(f"{value:.6g}" for value in numbers["reference_mean"])),
    ]
    lines = [(numbers[key], name) for key, name in _LINES if key in numbers]
    rows = means + [(name, "-" if value is None else f"{value:.6g}") for value, name in lines]
    rows.append(("identical", "yes" if numbers["identical"] else "no"))
    if "z_test" in numbers:
        tested = numbers["z_test"]
        rows.append(("z-test", _verdict(tested) if tested else f"none: {numbers['z_test_refused']}"))
    return rows


def _table(lines: Sequence[tuple[str, str]]) -> str:
    return "\n".join(f"{name:<26}{value}" for name, value in lines)
