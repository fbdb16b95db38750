"""`hgo list`: what there is to choose from."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Mapping

import click

from hgo_rs import models, observers, scenarios
from hgo_rs.cli.terminal import say
from hgo_rs.config import GAINS, MODELS, OBSERVERS, SHAPES, TOLD, TOP, schema
from hgo_rs.laws import LAWS

METHODS = {
    "euler": "explicit Euler; stable below a step limit, as all down to bogacki-shampine",
    "staggered-euler": "Euler, each state by the new one before it",
    "rk4": "Runge-Kutta of order 4, the measurement held over a step",
    "rk4-innovation-held": "the same, the innovation held",
    "bogacki-shampine": "Runge-Kutta of order 3, the measurement held",
    "zoh": "default of the standard, low-power and peaking-free laws with a constant gain: chain "
    "solved exactly, poles exp(dt lambda); stable at any step, peaking-free up to order 3",
    "bilinear": "the same, poles by the bilinear rule",
    "implicit-map": "the same, poles 1/(1 - dt lambda)",
    "proper": "chain moved exactly, dt times the injection added; below a step limit",
    "inter-sample": "the output predicted between samples; below a step limit",
    "implicit": "backward Euler in chain and injection; stable at any step",
}
"""Discretisations, in words."""


def _observers() -> Mapping[str, str]:
    chains = "several outputs: a chain and an observer for each"
    return {kind: LAWS[kind].title if kind in LAWS else chains for kind in OBSERVERS}


def _classes(known: Mapping[str, tuple[str, object]], module: object) -> dict[str, str]:
    """Names, and the first lines of their classes' docstrings."""
    return {
        name: str(getattr(module, made).__doc__).splitlines()[0]
        for name, (made, _) in known.items()
    }


LISTS: dict[str, Callable[[], Mapping[str, str]]] = {
    "observers": _observers,
    "gains": lambda: _classes(GAINS, observers),
    "shapes": lambda: _classes(SHAPES, observers),
    "models": lambda: _classes(MODELS, models),
    "methods": lambda: METHODS,
    "keys": lambda: {key: TOLD[key] for key in TOP},
}
"""What is listed by name and description, and how it is found."""


@click.command("list", short_help="List scenarios, observers, gains, models, methods or keys.")
@click.argument(
    "what", type=click.Choice(["scenarios", *LISTS, "schema"]), default="scenarios", required=False
)
@click.option("--json", "as_json", is_flag=True, help="Print one JSON array.")
def list_command(what: str, as_json: bool) -> None:
    """List WHAT: scenarios (the default), observers, gains, shapes, models, methods; the keys of an
    observer.toml, or their JSON Schema for editors.

    \b
    Example: an editor that knows observer.toml
      hgo list schema > observer-1.schema.json
    """
    if what == "schema":
        click.echo(schema.text(), nl=False)
    elif what == "scenarios":
        _scenarios(as_json)
    elif as_json:
        items = [{"name": name, "told": told} for name, told in LISTS[what]().items()]
        click.echo(json.dumps(items, ensure_ascii=False))
    else:
        known = LISTS[what]()
        width = max(map(len, known))
        say("\n".join(f"{name:<{width}}  {told}" for name, told in known.items()))


def _scenarios(as_json: bool) -> None:
    """Id and title, paper by paper."""
    known = scenarios.load()
    if as_json:
        items = [{"id": s.id, "title": s.title, "paper": s.paper} for s in known.values()]
        click.echo(json.dumps(items, ensure_ascii=False))
        return
    width = max((len(id) for id in known), default=0)
    paper = ""
    for s in known.values():
        if s.paper != paper and sys.stdout.isatty():
            paper = s.paper
            info = scenarios.PAPERS[paper]
            click.secho(f"\n{info.title}", bold=True)
            click.secho(info.authors, dim=True)
        click.echo(f"{s.id:<{width}}  {s.title}")
