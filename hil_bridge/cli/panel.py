"""`hil-bridge panel`: press, turn and break things at an emulated controller that runs in another terminal."""

from typing import Any

import click


def _ask(context: click.Context, request: dict[str, Any]) -> dict[str, Any]:
    from hil_bridge.robots.s3.panel import ask

    return ask(context.find_root().meta["panel"], request)


def _do(context: click.Context, request: dict[str, Any]) -> None:
    """Ask, and show the state afterwards."""
    from hil_bridge.robots.s3.panel import state_text

    click.echo(state_text(_ask(context, request).get("state", {})))


@click.group(invoke_without_command=True, short_help="Operate the panel of an emulated controller.")
@click.argument("url")
@click.pass_context
def panel(context: click.Context, url: str) -> None:
    """Operate the panel of an emulated controller; without a command, show it.

    URL is what `hil-bridge emulate` or `hil-bridge run` with --panel prints, like tcp://127.0.0.1:7300.
    """
    context.find_root().meta["panel"] = url
    if context.invoked_subcommand is None:
        _do(context, {"do": "show"})


@panel.command()
@click.pass_context
def show(context: click.Context) -> None:
    """Show mode, flags, queue, position, joints and orders."""
    _do(context, {"do": "show"})


@panel.command("emergency-stop")
@click.argument("to", type=click.Choice(["press", "release"]), default="press")
@click.pass_context
def emergency_stop(context: click.Context, to: str) -> None:
    """Press the emergency stop, or release it."""
    _do(context, {"do": "emergency-stop", "to": to})


@panel.command()
@click.argument("to", type=click.Choice(["auto", "manual"]))
@click.pass_context
def key(context: click.Context, to: str) -> None:
    """Turn the key."""
    _do(context, {"do": "key", "to": to})


@panel.command("link-control")
@click.argument("to", type=click.Choice(["give", "take"]))
@click.pass_context
def link_control(context: click.Context, to: str) -> None:
    """Give the link control at the pendant, or take it back."""
    _do(context, {"do": "link-control", "to": to})


@panel.command("work-stop")
@click.argument("to", type=click.Choice(["on", "off"]))
@click.pass_context
def work_stop(context: click.Context, to: str) -> None:
    """Stop work, or let it go on."""
    _do(context, {"do": "work-stop", "to": to})


@panel.command("programming-unit", short_help="Connect the programming unit, or remove it.")
@click.argument("to", type=click.Choice(["connect", "remove"]))
@click.pass_context
def programming_unit(context: click.Context, to: str) -> None:
    """Connect the programming unit, or remove it; the status tells it."""
    _do(context, {"do": "programming-unit", "to": to})


@panel.command()
@click.argument("to", type=click.Choice(["permit", "forbid"]))
@click.pass_context
def interrupt(context: click.Context, to: str) -> None:
    """Permit interrupts, or forbid them; the status tells it."""
    _do(context, {"do": "interrupt", "to": to})


@panel.command()
@click.argument("words", nargs=-1, required=True, metavar="[TARGET] FAULT [PARAM=VALUE]...")
@click.pass_context
def inject(context: click.Context, words: tuple[str, ...]) -> None:
    """Let one fault happen; `faults` lists them. A fault of the controller needs no target."""
    from emulators.cell_faults import CELL_FAULTS

    target, rest = ({"target": words[0]}, words[1:]) if words[0] in CELL_FAULTS else ({}, words)
    if not rest:
        raise click.BadParameter(f"{words[0]} is a target; name one of its faults too")
    given: dict[str, str] = {}
    for item in rest[1:]:
        name, sign, value = item.partition("=")
        if not (name and sign) or name in given:
            raise click.BadParameter(f"each parameter once, as NAME=VALUE, got {item!r}")
        given[name] = value
    _do(context, {"do": "inject", **target, "fault": rest[0], "with": given})


@panel.command()
@click.pass_context
def disarm(context: click.Context) -> None:
    """Forget the faults that wait for their moment."""
    _do(context, {"do": "disarm"})


@panel.command()
@click.pass_context
def mend(context: click.Context) -> None:
    """End the faults that last."""
    _do(context, {"do": "mend"})


@panel.command(short_help="List the faults that can be injected.")
@click.pass_context
def faults(context: click.Context) -> None:
    """List the faults that can be injected, with their parameters and defaults."""
    from hil_bridge.robots.s3.panel import faults_text

    click.echo(faults_text(_ask(context, {"do": "faults"}).get("faults", {})))
