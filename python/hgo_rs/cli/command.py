"""The `hgo` command.

Exit status: 0 all well, 1 a row missed its tolerance or a scenario failed, 2 bad usage or bad
input (one line on standard error), 130 interrupted, 143 terminated.
"""

from __future__ import annotations

import os
import signal
import sys
import threading
from collections.abc import Sequence

import click

from hgo_rs.cli.bench import compare_laws_command
from hgo_rs.cli.estimate import estimate_command
from hgo_rs.cli.export import export_command
from hgo_rs.cli.look import look_command
from hgo_rs.cli.scenarios import list_command, reproduce_command, run_command
from hgo_rs.cli.terminal import INTERRUPTED, TERMINATED, USAGE, complain, unknown
from hgo_rs.cli.tune import tune_command
from hgo_rs.cli.whole import compare_command, fit_command, smooth_command
from hgo_rs.errors import HgoError


def main(args: Sequence[str] | None = None) -> None:
    """Run the command and exit with its status; every error is one clear line."""
    try:
        if threading.current_thread() is threading.main_thread():
            signal.signal(signal.SIGTERM, _terminated)  # workers end, half-written files go
        status = command.main(args=args, prog_name="hgo", standalone_mode=False)
    except click.ClickException as error:
        complain(error.format_message())
        sys.exit(USAGE)
    except HgoError as error:
        complain(str(error))
        sys.exit(USAGE)
    except (KeyboardInterrupt, click.Abort):
        complain("interrupted")
        sys.exit(INTERRUPTED)
    except BrokenPipeError:  # `hgo list | head`
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        sys.exit(0)
    sys.exit(status if isinstance(status, int) else 0)


def _terminated(*_: object) -> None:
    sys.exit(TERMINATED)


class _Commands(click.Group):
    """A group that names the nearest command for an unknown one."""

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        name = args[0]
        if not name.startswith("-") and self.get_command(ctx, name) is None:
            raise click.UsageError(unknown("command", name, self.list_commands(ctx)))
        return super().resolve_command(ctx, args)


@click.group(
    cls=_Commands,
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100},
)
@click.version_option(package_name="hgo_rs", prog_name="hgo")
def command() -> None:
    """High-gain observers: recompute five papers and a textbook, or estimate states from a log."""


for _command in (
    list_command,
    run_command,
    reproduce_command,
    look_command,
    estimate_command,
    tune_command,
    smooth_command,
    fit_command,
    compare_command,
    compare_laws_command,
    export_command,
):
    command.add_command(_command)
