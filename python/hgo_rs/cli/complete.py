"""What the shell is offered for an argument or an option, and the script that asks for it."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import click
from click.shell_completion import CompletionItem, get_completion_class

from hgo_rs.config import OBSERVERS
from hgo_rs.design.discrete import METHODS, MOTIONS, TIMINGS
from hgo_rs.errors import HgoError
from hgo_rs.logs import column_names

Completer = Callable[[click.Context, click.Parameter, str], list[CompletionItem]]

SHELLS = ("bash", "zsh", "fish")
"""Shells that can be told what to offer."""


@click.command("completion", short_help="Print the completion script for bash, zsh or fish.")
@click.argument("shell", type=click.Choice(SHELLS))
def completion_command(shell: str) -> int:
    """Print the script by which SHELL completes commands, options, choices and columns of a log.

    \b
    Where it goes
      bash   eval "$(hgo completion bash)" in ~/.bashrc
      zsh    eval "$(hgo completion zsh)" in ~/.zshrc
      fish   hgo completion fish > ~/.config/fish/completions/hgo.fish
    """
    made = get_completion_class(shell)
    assert made is not None
    root = click.get_current_context().find_root()
    click.echo(made(root.command, {}, "hgo", "_HGO_COMPLETE").source())
    return 0


def of(words: Iterable[str] | Callable[[], Iterable[str]]) -> Completer:
    """Words, or those that a function gives when it is asked."""

    def offered(
        _context: click.Context, _parameter: click.Parameter, begun: str
    ) -> list[CompletionItem]:
        known = words() if callable(words) else words
        return [CompletionItem(word) for word in known if word.startswith(begun)]

    return offered


def columns(
    context: click.Context, _parameter: click.Parameter, begun: str
) -> list[CompletionItem]:
    """The columns of the log that stands before the option."""
    # an option that still lacks its value leaves the arguments unread
    log = context.params.get("log") or next(iter(context.args), None)
    try:
        known = column_names(Path(log)) if log else []
    except (HgoError, OSError):
        return []
    return [CompletionItem(name) for name in known if name.startswith(begun)]


def _scenarios() -> Iterable[str]:
    from hgo_rs import scenarios

    return scenarios.load()


observers = of(OBSERVERS)
methods = of(METHODS)
motions = of(MOTIONS)
timings = of(TIMINGS)
scenario_ids = of(_scenarios)
any_column: dict[str, Any] = {"metavar": "COL", "multiple": True, "shell_complete": columns}
"""Of an option that names columns of the log."""
