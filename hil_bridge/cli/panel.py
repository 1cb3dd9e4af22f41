"""`hil-bridge panel`: operate the panel of an emulated controller in another terminal, and inject faults."""

from typing import Any

import click

_URL = "panel"
"""Key under which the metadata of click's context contain the panel's URL."""


def _ask(context: click.Context, request: dict[str, Any]) -> dict[str, Any]:
    from hil_bridge.devices.panel import ask

    return ask(context.find_root().meta[_URL], request)


def _do(context: click.Context, request: dict[str, Any]) -> None:
    """Send a request and print the resulting state."""
    from hil_bridge.devices.panel import state_text

    click.echo(state_text(_ask(context, request)))


def _robots_with() -> dict[str, tuple[str, list[str]]]:
    """Return each control with its positions, its meaning, and the kinds of robot that have it."""
    from hil_bridge.devices.kinds import ROBOTS

    known: dict[str, tuple[str, list[str]]] = {}
    for kind in map(ROBOTS.kind, ROBOTS.own):
        controls = None if kind.emulation is None else kind.emulation.controls
        for name, control in ({} if controls is None else controls.controls).items():
            call = f"{name} {'|'.join(control.choices)}"
            known.setdefault(call, (control.meaning, []))[1].append(kind.name)
    return known


class _Controls(click.Group):
    """Commands that every panel accepts, and the controls of the panel at the URL."""

    def get_command(self, context: click.Context, name: str) -> click.Command | None:
        own = super().get_command(context, name)
        return own if own is not None or name.startswith("-") else _control(name)

    def format_commands(self, context: click.Context, formatter: click.HelpFormatter) -> None:
        super().format_commands(context, formatter)
        with formatter.section("Controls, by the robots that have them"):
            formatter.write_dl(
                [
                    (call, f"{meaning}  [{', '.join(kinds)}]")
                    for call, (meaning, kinds) in _robots_with().items()
                ]
            )


def _control(name: str) -> click.Command:
    """Return the command that moves a control. The panel knows its positions and its default."""

    @click.pass_context
    def move(context: click.Context, to: str | None) -> None:
        _do(context, {"do": name} if to is None else {"do": name, "to": to})

    calls = {
        f"{', '.join(kinds)}: {call}\n  {meaning}"
        for call, (meaning, kinds) in _robots_with().items()
        if call.partition(" ")[0] == name
    }
    return click.Command(
        name,
        callback=move,
        params=[click.Argument(["to"], required=False)],
        help="\b\n" + "\n".join(sorted(calls)) if calls else "Move this control.",
    )


@click.group(
    cls=_Controls, invoke_without_command=True, short_help="Operate the panel of an emulated controller."
)
@click.argument("url")
@click.pass_context
def panel(context: click.Context, url: str) -> None:
    """Operate the panel of an emulated controller; without a command, show it.

    URL is what `hil-bridge emulate` or `hil-bridge run` with --panel prints, like tcp://127.0.0.1:7300.
    """
    context.find_root().meta[_URL] = url
    if context.invoked_subcommand is None:
        _do(context, {"do": "show"})


def _request(name: str, text: str) -> click.Command:
    """Return a command that sends one request."""

    @click.pass_context
    def act(context: click.Context) -> None:
        _do(context, {"do": name})

    return click.Command(name, callback=act, help=text, short_help=text)


@panel.command(short_help="Show the panel continuously, until Ctrl-C.")
@click.option(
    "--every", "every_s", type=click.FloatRange(0.05, 60.0), default=0.5, show_default=True, metavar="S"
)
@click.pass_context
def watch(context: click.Context, every_s: float) -> None:
    """Show state, position, program and faults continuously, until Ctrl-C. Operate it from another terminal."""
    from hil_bridge.console.redraw import redraw_until_interrupted
    from hil_bridge.devices.panel import state_text

    url = context.find_root().meta[_URL]
    redraw_until_interrupted(lambda: f"{url}\n\n{state_text(_ask(context, {'do': 'show'}))}", every_s)


@panel.command()
@click.pass_context
def controls(context: click.Context) -> None:
    """List the controls of this robot, with their positions."""
    from hil_bridge.devices.panel import controls_text

    click.echo(controls_text(_ask(context, {"do": "controls"}).get("controls", {})))


panel.add_command(_request("show", "Show state, position, program and faults."))
panel.add_command(_request("disarm", "Cancel pending faults."))
panel.add_command(_request("mend", "End active faults."))


@panel.command()
@click.argument("words", nargs=-1, required=True, metavar="[TARGET] FAULT [PARAM=VALUE]...")
@click.pass_context
def inject(context: click.Context, words: tuple[str, ...]) -> None:
    """Inject one fault; `faults` lists them. A fault of the controller needs no target."""
    from hil_bridge.devices.kinds import fault_targets

    target, rest = ({"target": words[0]}, words[1:]) if words[0] in fault_targets() else ({}, words)
    if not rest:
        raise click.BadParameter(f"{words[0]} is a target; also name one of its faults")
    given: dict[str, str] = {}
    for item in rest[1:]:
        name, sign, value = item.partition("=")
        if not (name and sign) or name in given:
            raise click.BadParameter(f"give each parameter once, as NAME=VALUE, got {item!r}")
        given[name] = value
    _do(context, {"do": "inject", **target, "fault": rest[0], "with": given})


@panel.command(short_help="List the faults that can be injected.")
@click.pass_context
def faults(context: click.Context) -> None:
    """List the faults that can be injected, with their parameters and defaults."""
    from hil_bridge.devices.panel import faults_text

    click.echo(faults_text(_ask(context, {"do": "faults"}).get("faults", {})))
