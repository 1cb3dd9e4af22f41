"""`hil-bridge list plugins` and `list controllers`: list the kinds by name, with their packages."""

import sys
from typing import Any

import click

from hil_bridge.console.options import echo_json, echo_lines, json_option

OWN = "hil-bridge"
"""Name of the package of built-in kinds."""


@click.command(short_help="List plug-ins, and what is wrong with them.")
@click.option("--all", "with_own", is_flag=True, help="List built-in kinds too.")
@json_option
def plugins(with_own: bool, as_json: bool) -> None:
    """List the controllers, steps, robots, sensors, surfaces and commands of plug-ins, with their package and state.

    Each is imported, as when it is used; a controller and a step are run on one sample. The exit code is 2 if one of
    them cannot be used.
    """
    rows = _rows(with_own)
    if as_json:
        echo_json(rows)
    elif not rows:
        echo_lines(["no plug-ins are installed; docs/how-to/devices.md describes how to write one"])
    else:
        widths = [max(len(row[key]) for row in rows) for key in ("thing", "name", "package")]
        for row in rows:
            columns = zip((row["thing"], row["name"], row["package"]), widths, strict=True)
            echo_lines(
                ["  ".join((*(f"{text:{width}}" for text, width in columns), row["told"] or row["source"]))]
            )
    sys.exit(2 if any(row["state"] != "ok" for row in rows) else 0)


@click.command(short_help="List the controllers and their parameters.")
@click.argument("name", metavar="[NAME]", required=False)
@json_option
def controllers(name: str | None, as_json: bool) -> None:
    """List the force controllers; with NAME one of them, with its parameters.

    Units are part of the names: _n is N, _mm is mm. A tuning gives other defaults for a sample time.
    """
    from hil_bridge.control.controllers import controller_names

    facts = [controller_facts(each) for each in ([name] if name else controller_names())]
    if as_json:
        echo_json(facts)
        return
    for number, one in enumerate(facts):
        lines = [""] if number else []
        lines.append(f"{one['name']}: {one['meaning']}")
        lines.append(f"  made for a sample every {one['sample_ms']:g} ms; {one['package']}")
        for tuning in one["tunings"]:
            others = ", ".join(f"{key} = {value:g}" for key, value in tuning["parameters"].items())
            lines.append(f"  at {tuning['sample_ms']:g} ms: {others or 'the same'}")
        for parameter in one["parameters"]:
            among = "" if parameter["range"] is None else "   tune: {:g} … {:g}".format(*parameter["range"])
            lines.append(f"    {parameter['name']} = {parameter['default']}{among}")
            if parameter["meaning"]:
                lines.append(f"        {parameter['meaning']}")
        echo_lines(lines)


def _rows(with_own: bool) -> list[dict[str, str]]:
    """Return one row for each plug-in, by type and name. `with_own` adds a row for each built-in kind."""
    from functools import partial

    from hil_bridge.cli.entry_points import COMMANDS, load_command
    from hil_bridge.control import controllers
    from hil_bridge.control.steps import kinds
    from hil_bridge.devices.kinds import ROBOTS, SENSORS, SURFACES
    from hil_bridge.errors import ConfigError
    from hil_bridge.errors.offers import GROUPS
    from hil_bridge.errors.plugins import offers

    sources: list[tuple[str, Any, str, list[str]]] = [
        ("controller", controllers.controller_kind, controllers.GROUP, list(controllers.OURS)),
        ("step", kinds.step_kind, kinds.GROUP, list(kinds.BUILT_IN)),
    ]
    sources += [
        (f"{group.removeprefix(COMMANDS)[1:]} command".lstrip(), partial(load_command, group), group, [])
        for group in GROUPS
        if group.startswith(COMMANDS)
    ]
    trials = {"controller": controllers.trial, "step": kinds.trial}
    sources += [(one.thing, one.kind, one.group, list(one.own)) for one in (ROBOTS, SENSORS, SURFACES)]
    rows = []
    for thing, choose, group, own in sources:
        mine = [(name, OWN, "") for name in own] if with_own else []
        for name, package, source in (*mine, *offers(group)):
            try:
                chosen = choose(name)
                state, text = "ok", _summary(chosen)
                if thing in trials and package != OWN and (fault := trials[thing](name)):
                    state, text = "wrong", f"WRONG: {thing} {name!r} of {package}: {fault}"
            except ConfigError as error:
                state, text = "wrong", f"WRONG: {error}"
            row = {
                "thing": thing,
                "name": name,
                "package": package,
                "source": source,
                "state": state,
                "told": text,
            }
            rows.append(row)
    return rows


def _summary(chosen: Any) -> str:
    """Return the author's one-line summary of a kind, a controller or a command."""
    if isinstance(chosen, click.Command):
        return chosen.get_short_help_str(100)
    return str(getattr(chosen, "summary", "") or _first_line(chosen))


def _first_line(thing: Any) -> str:
    text = " ".join((thing.__doc__ or "").split("\n\n")[0].split())
    return "" if text.startswith(f"{getattr(thing, '__name__', '')}(") else text


def controller_facts(name: str) -> dict[str, Any]:
    """Return a controller with its parameters. Raises ConfigError if the name is unknown or the package is broken."""
    import dataclasses

    from hil_bridge.control.controllers import GROUP, OURS, controller_kind, sample_time
    from hil_bridge.control.types import Tuning
    from hil_bridge.errors.plugins import offers
    from hil_bridge.record.field_docstrings import field_docstrings

    kind: Any = controller_kind(name)
    texts = field_docstrings(kind)
    package = OWN if name in OURS else {one: owner for one, owner, _ in offers(GROUP)}[name]
    tunings = [tuning for tuning in getattr(kind, "tunings", ()) if isinstance(tuning, Tuning)]
    return {
        "name": name,
        "package": package,
        "meaning": _first_line(kind),
        "sample_ms": sample_time(kind) * 1e3,
        "tunings": [{"sample_ms": one.sample_ms, "parameters": dict(one.parameters)} for one in tunings],
        "parameters": [
            {
                "name": field.name,
                "default": _default(field),
                "meaning": texts.get(field.name, ""),
                "range": _range(kind, field.name),
            }
            for field in dataclasses.fields(kind)
            if field.init
        ],
    }


def _range(kind: Any, name: str) -> list[float] | None:
    """Return the bounds for tuning a parameter, or None if its controller does not declare any."""
    from hil_bridge.control.types import Range

    bounds = getattr(kind, "ranges", {}).get(name)
    return [bounds.low, bounds.high] if isinstance(bounds, Range) else None


def _default(field: Any) -> str:
    """Return the default of a parameter in TOML notation, or a note that it has none."""
    import dataclasses

    from hil_bridge.errors.text_files import format_value

    if field.default is not dataclasses.MISSING:
        return format_value(getattr(field.default, "value", field.default))  # of an enumeration
    if field.default_factory is not dataclasses.MISSING:
        return format_value(field.default_factory())
    return "(must be given)"
