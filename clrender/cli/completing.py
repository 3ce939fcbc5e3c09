"""Shell completion of scenes, devices, layers and files; these functions never fail or print."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import suppress

import click
from click.shell_completion import CompletionItem

__all__ = ["complete_benchmarks", "complete_devices", "complete_files", "complete_layers", "complete_scenes"]

_Items = list[CompletionItem]


def complete_scenes(_ctx: click.Context, _param: click.Parameter, incomplete: str) -> _Items:
    """Complete names of built-in scenes, or files if no name matches."""
    from clrender.scene.load import builtin_names

    # Not both: with a file item, bash discards the names.
    return _beginning(builtin_names, incomplete) or complete_files(_ctx, _param, incomplete)


def complete_files(_ctx: click.Context, _param: click.Parameter, incomplete: str) -> _Items:
    """Complete files."""
    return [CompletionItem(incomplete, type="file")]


def complete_devices(_ctx: click.Context, _param: click.Parameter, incomplete: str) -> _Items:
    """Complete the keywords of `--device`, and the indices of existing devices."""

    def names() -> dict[str, str]:
        from clrender.drivers import inventory

        return {str(index): info.title for index, info in enumerate(inventory())}

    words = {
        "auto": "the best working device, GPU before CPU",
        "cpu": "the CPU",
        "gpu": "the GPU",
        "all": "all working devices",
    }
    return _beginning(lambda: words, incomplete) + _beginning(names, incomplete)


def complete_layers(_ctx: click.Context, _param: click.Parameter, incomplete: str) -> _Items:
    """Complete the last item of a comma-separated list of layers."""
    from clrender.aov import AOVS

    before, comma, last = incomplete.rpartition(",")
    taken = before.split(",")
    return [
        CompletionItem(f"{before}{comma}{name}") for name in AOVS if name.startswith(last) and name not in taken
    ]  # fmt: skip


def complete_benchmarks(_ctx: click.Context, _param: click.Parameter, incomplete: str) -> _Items:
    """Complete scenes of `clrender bench`, or files if no name matches."""
    from clrender.bench import SCENES

    return _beginning(lambda: SCENES, incomplete) or complete_files(_ctx, _param, incomplete)


def _beginning(names: Callable[[], Mapping[str, str]], incomplete: str) -> _Items:
    """The names that begin with `incomplete`, with their descriptions; none if they cannot be determined."""
    with suppress(Exception):
        return [CompletionItem(name, help=words) for name, words in names().items() if name.startswith(incomplete)]
    return []
