"""`hil-bridge panel`: press, turn and break things at an emulated controller that runs in another terminal."""

from typing import Any

import click


def _ask(context: click.Context, request: dict[str, Any]) -> dict[str, Any]:
    from hil_bridge.devices.panel import ask

    return ask(context.find_root().meta["panel"], request)


def _do(context: click.Context, request: dict[str, Any]) -> None:
    """Ask, and show the state afterwards."""
    from hil_bridge.devices.panel import state_text

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


_COMMANDS: dict[str, tuple[str, tuple[str, ...]]] = {
    "show": ("Show mode, flags, queue, position, joints and orders.", ()),
    "key": ("Turn the key.", ("auto", "manual")),
    "link-control": ("Give the link control at the pendant, or take it back.", ("give", "take")),
    "work-stop": ("Stop work, or let it go on.", ("on", "off")),
    "programming-unit": (
        "Connect the programming unit, or remove it.",
        ("connect", "remove"),
    ),
    "interrupt": ("Permit interrupts, or forbid them; the status tells it.", ("permit", "forbid")),
    "disarm": ("Forget the faults that wait for their moment.", ()),
    "mend": ("End the faults that last.", ()),
}
"""Commands that are one request: what each does, and what may be said to it."""


def _command(name: str, text: str, choices: tuple[str, ...], default: str | None = None) -> click.Command:
    @click.pass_context
    def act(context: click.Context, /, **said: str) -> None:
        _do(context, {"do": name, **said})

    to = click.Argument(["to"], type=click.Choice(choices), default=default, required=default is None)
    return click.Command(name, callback=act, params=[to] if choices else [], help=text, short_help=text)


for _name, (_text, _choices) in _COMMANDS.items():
    panel.add_command(_command(_name, _text, _choices))
panel.add_command(
    _command("emergency-stop", "Press the emergency stop, or release it.", ("press", "release"), "press")
)


@panel.command()
@click.argument("words", nargs=-1, required=True, metavar="[TARGET] FAULT [PARAM=VALUE]...")
@click.pass_context
def inject(context: click.Context, words: tuple[str, ...]) -> None:
    """Let one fault happen; `faults` lists them. A fault of the controller needs no target."""
    from hil_bridge.devices.kinds import fault_targets

    target, rest = ({"target": words[0]}, words[1:]) if words[0] in fault_targets() else ({}, words)
    if not rest:
        raise click.BadParameter(f"{words[0]} is a target; name one of its faults too")
    given: dict[str, str] = {}
    for item in rest[1:]:
        name, sign, value = item.partition("=")
        if not (name and sign) or name in given:
            raise click.BadParameter(f"each parameter once, as NAME=VALUE, got {item!r}")
        given[name] = value
    _do(context, {"do": "inject", **target, "fault": rest[0], "with": given})


@panel.command(short_help="List the faults that can be injected.")
@click.pass_context
def faults(context: click.Context) -> None:
    """List the faults that can be injected, with their parameters and defaults."""
    from hil_bridge.devices.panel import faults_text

    click.echo(faults_text(_ask(context, {"do": "faults"}).get("faults", {})))
