"""`clrender check`: validates a scene and prints its size."""

from __future__ import annotations

import json
from typing import Any

import click

from clrender import layout
from clrender.cli.completing import complete_scenes
from clrender.cli.options import load_options
from clrender.flatten.flat_scene import FlatScene, flatten
from clrender.importers import load
from clrender.wording import counted, grouped

__all__ = ["check"]


@click.command()
@click.argument("scene", shell_complete=complete_scenes)
@load_options
@click.option("--json", "as_json", is_flag=True, help="Print one JSON object, with the notes and the counts of faults.")
def check(
    scene: str,
    reading: dict[str, Any],
    as_json: bool,
) -> None:
    """Validate SCENE (a file or the name of a built-in scene) and print its statistics."""
    loaded = load(scene, **reading)
    flat = flatten(loaded, loaded.image.width, loaded.image.height)
    rows = [
        ("image", f"{loaded.image.width} x {loaded.image.height}"),
        ("shapes", grouped(len(loaded.shapes))),
        ("triangles", grouped(flat.triangle_count)),
        ("spheres and disks", grouped(flat.analytic_count - flat.curve_count)),
        *([("curves", grouped(flat.curve_count))] if flat.curve_count else []),
        *([("instances", grouped(flat.instances.count))] if flat.instances.count else []),
        *([("with instances", counted(flat.primitive_total, "primitive"))] if flat.instances.count else []),
        ("lights", f"{grouped(flat.light_count)}{_each(flat)}"),
        ("materials", grouped(len(loaded.materials))),
        ("bytes on the device", f"{grouped(flat.nbytes)} (without the BVH)"),
        ("scene sha256", loaded.sha256()),
    ]
    if as_json:
        found = {
            "image": [loaded.image.width, loaded.image.height],
            "shapes": len(loaded.shapes),
            "triangles": flat.triangle_count,
            "spheres_and_disks": flat.analytic_count - flat.curve_count,
            "curves": flat.curve_count,
            "instances": flat.instances.count,
            "primitives": flat.primitive_total,
            "lights": flat.light_count,
            "materials": len(loaded.materials),
            "bytes": flat.nbytes,
            "scene_sha256": loaded.sha256(),
            "messages": list(flat.messages),
            "faults": loaded.faults,
        }
        click.echo(json.dumps(found, indent=1))
        return
    for line in flat.messages:
        click.echo(line, err=True)
    click.echo(f"{loaded.source}: sound")
    for name, value in rows:
        click.echo(f"{name:<20} {value}")


def _each(flat: FlatScene) -> str:
    """Why there are more lights than in the file, if there are."""
    triangles = (flat.arrays["lights"]["kind"][: flat.light_count] == layout.LIGHT_AREA_TRIANGLE).any()
    return " (each triangle that emits light is one)" if triangles else ""
