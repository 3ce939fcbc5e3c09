"""What a shell completes in the place of a scene, a device, layers or files; none of it fails or prints."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import suppress

import click
from click.shell_completion import CompletionItem

__all__ = ["complete_benchmarks", "complete_devices", "complete_files", "complete_layers", "complete_scenes"]

_Items = list[CompletionItem]


def complete_scenes(_ctx: click.Context, _param: click.Parameter, incomplete: str) -> _Items:
    """Names of built-in scenes; files where none begins so."""
    from clrender.scene.load import builtin_names

    # Not both: bash would be told to forget the names.
    return _beginning(builtin_names, incomplete) or complete_files(_ctx, _param, incomplete)


def complete_files(_ctx: click.Context, _param: click.Parameter, incomplete: str) -> _Items:
    """Files."""
    return [CompletionItem(incomplete, type="file")]


def complete_devices(_ctx: click.Context, _param: click.Parameter, incomplete: str) -> _Items:
    """What `--device` knows by word, and the indices of the devices that there are."""

    def names() -> dict[str, str]:
        from clrender.device import inventory

        return {str(index): info.title for index, info in enumerate(inventory())}

    words = {
        "auto": "the best working device, GPU before CPU",
        "cpu": "the CPU",
        "gpu": "the GPU",
        "all": "all working devices",
    }
    return _beginning(lambda: words, incomplete) + _beginning(names, incomplete)


def complete_layers(_ctx: click.Context, _param: click.Parameter, incomplete: str) -> _Items:
    """A list of layers with commas; the last of them is completed."""
    from clrender.aov import AOVS

    before, comma, last = incomplete.rpartition(",")
    taken = before.split(",")
    return [
        CompletionItem(f"{before}{comma}{name}") for name in AOVS if name.startswith(last) and name not in taken
    ]  # fmt: skip


def complete_benchmarks(_ctx: click.Context, _param: click.Parameter, incomplete: str) -> _Items:
    """Scenes of `clrender bench`."""
    from clrender.bench import SCENES

    return _beginning(lambda: SCENES, incomplete)


def _beginning(names: Callable[[], Mapping[str, str]], incomplete: str) -> _Items:
    """Of names and what they mean, those that begin so; none where they cannot be told."""
    with suppress(Exception):
        return [CompletionItem(name, help=words) for name, words in names().items() if name.startswith(incomplete)]
    return []
