"""`hgo look`: what a recorded log holds."""

from __future__ import annotations

from pathlib import Path

import click

from hgo_rs.cli.terminal import say
from hgo_rs.logs import look


@click.command("look", short_help="Show what a recorded log holds, and how to read it.")
@click.argument("log", type=click.Path(path_type=Path))
def look_command(log: Path) -> int:
    """Show what the LOG holds: columns, types, units, ranges, resolution, standstills, rate,
    jitter, gaps, and a command that reads it.

    \b
    Example: an unknown log
      hgo look axis.csv
    """
    say(str(look(log)))
    return 0
