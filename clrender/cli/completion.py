"""`clrender completion`: prints the script with which a shell completes clrender's command lines."""

from __future__ import annotations

from typing import Final

import click
from click.shell_completion import get_completion_class

from clrender.cli.options import DomainType
from clrender.errors import UsageError
from clrender.limits import Choice

__all__ = ["completion"]

_SHELLS: Final = ("bash", "zsh", "fish")


@click.command()
@click.argument("shell", type=DomainType(Choice(_SHELLS)))
@click.pass_context
def completion(ctx: click.Context, /, shell: str) -> None:
    """Print a script for bash (4.4 or newer), zsh or fish that completes commands, options, scenes, files and devices.

    \b
    bash:  clrender completion bash > ~/.local/share/bash-completion/completions/clrender
    zsh:   clrender completion zsh > DIR/_clrender, with DIR in fpath before compinit
    fish:  clrender completion fish > ~/.config/fish/completions/clrender.fish
    """
    made = get_completion_class(shell)
    assert made is not None
    try:
        click.echo(made(ctx.find_root().command, {}, "clrender", "_CLRENDER_COMPLETE").source())
    except (OSError, RuntimeError) as error:  # bash is run to get its version
        reason = str(error).rstrip(".") or type(error).__name__
        raise UsageError(f"{shell} cannot be set up: {reason}; install it, or choose another shell") from None
