"""`clrender schema`: prints the JSON Schema of the scene file, for editors and programs."""

from __future__ import annotations

import json

import click

from clrender.scene import Scene

__all__ = ["schema"]


@click.command()
def schema() -> None:
    """Print the JSON Schema of a scene file."""
    document = {"$schema": "https://json-schema.org/draft/2020-12/schema", **Scene.model_json_schema()}
    click.echo(json.dumps(document, indent=2))
