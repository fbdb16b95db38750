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
from hgo_rs.cli.complete import completion_command
from hgo_rs.cli.estimate import estimate_command
from hgo_rs.cli.export import export_command
from hgo_rs.cli.lists import list_command
from hgo_rs.cli.look import look_command
from hgo_rs.cli.new import new_command
from hgo_rs.cli.plot import plot_command
from hgo_rs.cli.scenarios import reproduce_command, run_command
from hgo_rs.cli.simulate import simulate_command
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
    except click.MissingParameter as error:
        complain(_lacking(error))
        sys.exit(USAGE)
    except click.ClickException as error:
        complain(error.format_message())
        sys.exit(USAGE)
    except HgoError as error:
        complain(str(error).replace("allow_unstable=True", "--allow-unstable of hgo estimate"))
        sys.exit(USAGE)
    except (KeyboardInterrupt, click.Abort):
        complain("interrupted")
        sys.exit(INTERRUPTED)
    except BrokenPipeError:  # `hgo list | head`
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        sys.exit(0)
    sys.exit(status if isinstance(status, int) else 0)


_ARGUMENTS = {
    "log": "a recorded log, such as axis.csv (`hgo look LOG` shows what it holds)",
    "config": "an observer.toml (`hgo new LOG` writes one)",
    "id": "a scenario (`hgo list` lists all)",
    "shell": "one of bash, zsh, fish",
}
"""What stands for each argument."""


def _lacking(error: click.MissingParameter) -> str:
    """What is said of an argument that was left out: what to give, and an example."""
    if error.ctx is None or not isinstance(error.param, click.Argument):
        return error.format_message()
    name, verb = error.param.name or "", error.ctx.command
    told = f"hgo {verb.name} needs {name.upper()}: {_ARGUMENTS[name]}"
    lines = [line.strip() for line in (verb.help or "").splitlines()]
    example = next((line for line in lines if line.startswith(f"hgo {verb.name} ")), None)
    return f"{told}; for example {example}" if example else told


def _terminated(*_: object) -> None:
    sys.exit(TERMINATED)


class _Commands(click.Group):
    """A group that names the nearest command for an unknown one, and lists them as they came."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        return list(self.commands)

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
    """High-gain observers: estimate states from recorded logs, tune and compare observers, export
    them as source code, and run the experiments of five papers and a textbook.
    """


for _command in (  # as a job goes
    look_command,
    new_command,
    tune_command,
    estimate_command,
    smooth_command,
    fit_command,
    compare_command,
    plot_command,
    simulate_command,
    export_command,
    list_command,
    run_command,
    reproduce_command,
    compare_laws_command,
    completion_command,
):
    command.add_command(_command)
