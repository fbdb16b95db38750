"""What the command says, and how it ends."""

from __future__ import annotations

from collections.abc import Sequence

import click

from hgo_rs.errors import nearest, printable

MISSED, USAGE, INTERRUPTED, TERMINATED = 1, 2, 130, 143


def complain(message: str) -> None:
    say("hgo: " + " ".join(message.split("\n")), err=True)


def say(text: str, err: bool = False) -> None:
    """Print lines whose names, from files and arguments, do nothing to the terminal."""
    click.echo("\n".join(map(printable, text.split("\n"))), err=err)


def unknown(kind: str, name: str, known: Sequence[str]) -> str:
    near = nearest(name, known)
    hint = f"nearest: {', '.join(near)}; " if near else ""
    return f"unknown {kind} {name!r}; {hint}known: {', '.join(known)}"
