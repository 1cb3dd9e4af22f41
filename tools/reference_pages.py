"""Reference pages that are generated from the code whenever the site is built: docs/conf.py calls `write_pages`."""

import inspect
import re
from collections.abc import Callable, Iterator, Mapping
from functools import partial
from pathlib import Path
from typing import Any
from unittest.mock import patch

import click

from hil_bridge.cli import cli
from hil_bridge.cli.plugins import controller_facts
from hil_bridge.control.controllers import OURS
from hil_bridge.devices.kinds import ROBOTS, SENSORS, Registry
from hil_bridge.errors import extras
from hil_bridge.errors.event_kinds import ALARMS, CAUTIONS, EventKind
from hil_bridge.record.scenes import SCENE_TOPICS
from hil_bridge.record.topics import TOPICS
from hil_bridge.settings.template import setting_rows
from hil_bridge.transports import urls
from protocol.devices.ati_can import messages as ati_can
from protocol.devices.ft300 import messages as ft300
from protocol.devices.jr3.can_gateway import messages as can_gateway
from protocol.devices.netft import records as netft
from protocol.devices.rsi.elements import ELEMENTS, POSE_AXES, Element
from protocol.devices.rtde import packets
from protocol.devices.rtde.fields import INPUTS, OUTPUTS, Variable
from protocol.fields import Layout
from tools.author_names import author_names, package_names
from tools.computer_link_doc import field_table
from tools.known_devices import known_devices
from tools.pages import table

ROOT = Path(__file__).resolve().parent.parent
FOLDER = ROOT / "docs" / "reference" / "generated"
WIDTH = 100
"""Width of a command's help text, columns."""


def write_pages(folder: Path = FOLDER) -> None:
    """Write every page that is missing or differs. Unchanged pages are not written, so that a second build does not
    read them again.
    """
    folder.mkdir(exist_ok=True)
    for name, make in PAGES.items():
        place, text = folder / f"{name}.md", make()
        if not place.exists() or place.read_text(encoding="utf-8") != text:
            place.write_text(text, encoding="utf-8")
    for place in folder.glob("*.md"):
        if place.stem not in PAGES:
            place.unlink()


def command_line() -> str:
    """Return the page of all commands with their options, as `--help` shows them."""
    parts = [
        "# Command line",
        "Each command prints the same text with `--help`. "
        + " ".join((cli.help or "").partition("\n\n")[2].split()),
    ]
    for names, command in _commands(cli, ("hil-bridge",)):
        context = click.Context(
            command, info_name=" ".join(names), terminal_width=WIDTH, max_content_width=WIDTH
        )
        with patch.object(extras, "_origin", return_value=None):  # as for a copy from a package index
            text = command.get_help(context)
        parts += [f"{'#' * min(len(names) + 1, 4)} {' '.join(names)}", f"```text\n{text}\n```"]
    return "\n\n".join(parts) + "\n"


def _commands(
    command: click.Command, names: tuple[str, ...]
) -> Iterator[tuple[tuple[str, ...], click.Command]]:
    yield names, command
    if isinstance(command, click.Group):
        context = click.Context(command)
        for name in command.list_commands(context):
            inner = command.get_command(context, name)
            if inner is not None and not inner.hidden:
                yield from _commands(inner, (*names, name))


def configuration() -> str:
    """Return the page of all settings of a configuration file."""
    parts = [
        "# Configuration",
        "All keys of a configuration file, for all built-in devices. `hil-bridge config init` writes a file with all "
        "of them, `hil-bridge config schema` prints the JSON schema. The mark in square brackets is the source of the "
        "default: *observed* on a device, *derived* from observations, *standard* for such devices, *assumed* if it "
        "is unknown, *chosen* if it is not a fact about a device.",
    ]
    section = None
    rows: list[tuple[str, ...]] = []
    head = ("key", "type", "default", "meaning")

    def end() -> None:
        if rows:
            parts.append(table(head, rows))
            rows.clear()

    for row in setting_rows():
        if row.section != section:
            end()
            section = row.section
            parts.append(f"## {section or 'top level'}")
        rows.append(
            (f"`{row.name}`", row.type, f"`{row.default}`" if row.default else "", _cell(row.meaning))
        )
    end()
    return "\n\n".join(parts) + "\n"


def wires() -> str:
    """Return the page of wire URLs, from the docstring of the module that parses them."""
    text = inspect.getdoc(urls) or ""
    registries: dict[str, Registry[Any]] = {"robot": ROBOTS, "sensor": SENSORS}
    kinds = [
        (f"`{kind.name}`", thing, kind.summary)
        for thing, registry in registries.items()
        for kind in map(registry.kind, registry.own)
    ]
    return (
        "# URLs of robots, sensors and wires\n\n"
        "The URL of a device is `KIND+WIRE`, such as `rtde+tcp://192.168.1.20`. Without a kind it is an S3's, or a "
        "JR3's.\n\n"
        + table(("kind", "device", "meaning"), kinds)
        + "\n\n## Wires\n\n"
        # a list needs an empty line before it
        + re.sub(r"([^\n])\n- (?=`)", r"\1\n\n- ", text.partition("\n\n")[2], count=0)
        + "\n"
    )


def panels() -> str:
    """Return the page of the panel controls and faults of each emulated robot, from the tables that the panel uses."""
    parts = [
        "# Panels of emulated robots",
        "`hil-bridge panel URL CONTROL POSITION` moves a control; `--panel` of `emulate` and `run` prints the URL. The "
        "page of `emulate --web` and of `run --web` has the same controls as buttons. "
        "[The robot alone](../../how-to/robot-alone.md) shows both.",
    ]
    for kind in map(ROBOTS.kind, ROBOTS.own):
        emulation = kind.emulation
        assert emulation is not None
        assert emulation.controls is not None
        rows = [
            (f"`{name} {'|'.join(control.choices)}`", control.meaning)
            for name, control in emulation.controls.controls.items()
        ]
        targets = emulation.controls.faults.items()
        faults = [(f"`{target}`", ", ".join(f"`{name}`" for name in named)) for target, named in targets]
        parts += [
            f"## {kind.name}",
            f"{kind.summary}.",
            table(("control", "effect"), rows),
            "`inject [TARGET] FAULT` injects one of these; `faults` lists them with their parameters:",
            table(("target", "faults"), faults),
        ]
    return "\n\n".join(parts) + "\n"


def events() -> str:
    """Return the page of event kinds in a record."""
    weight = {**dict.fromkeys(CAUTIONS, "caution"), **dict.fromkeys(ALARMS, "alarm")}
    rows = [(f"`{kind}`", weight.get(kind, ""), kind.meaning) for kind in EventKind]
    return (
        "# Events\n\nKinds of the events in a recording, topic `/event`, and in the view. The log panel of Foxglove "
        "shows an alarm as an error, a caution as a warning.\n\n"
        + table(("kind", "weight", "meaning"), rows)
        + "\n"
    )


def topics() -> str:
    """Return the page of recording topics with the fields of their messages."""
    parts = [
        "# Topics of a recording",
        "A recording is an MCAP file with JSON messages. Its log times are the wall clock. Times in the messages are "
        "seconds on the run's clock. A number that is not finite or unknown is left out of its message.",
    ]
    for topic in TOPICS:
        properties: Mapping[str, Any] = topic.schema["properties"]  # type: ignore[assignment]
        rows = [
            (f"`{name}`", one["type"], _cell(one.get("description", ""))) for name, one in properties.items()
        ]
        meaning = (inspect.getdoc(topic.record) or "").partition("\n\n")[0]
        parts += [f"## {topic.name}", _cell(meaning), table(("field", "type", "meaning"), rows)]
    scenes = [(f"`{topic.name}`", f"`{topic.schema_name}`") for topic in SCENE_TOPICS]
    parts += [
        "## For the panels of Foxglove",
        "These topics are derived from the records above, with Foxglove's own schemas. Their frames are `base`, `tool` "
        "(the reported pose) and `tool_true` (the true pose of an emulated cell).",
        table(("topic", "schema"), scenes),
    ]
    return "\n\n".join(parts) + "\n"


def controllers() -> str:
    """Return the page of controllers with their parameters."""
    parts = [
        "# Controllers and their parameters",
        "`controller.name` selects one; its parameters are set in `[controller.parameters]`. Units are part of the "
        "names: `_n` is N, `_mm` is mm. `hil-bridge list controllers` also lists those of plug-ins. "
        "[Write a controller](../../how-to/controllers.md) describes how to write one.",
    ]
    for name in OURS:
        facts = controller_facts(name)
        parts += [
            f"## {name}",
            _cell(facts["meaning"]),
            f"Designed for a sample every {facts['sample_ms']:g} ms.",
        ]
        for tuning in facts["tunings"]:
            others = ", ".join(f"`{key}` = {value:g}" for key, value in tuning["parameters"].items())
            parts.append(f"At {tuning['sample_ms']:g} ms: {others or 'the same'}.")
        rows = [
            (
                f"`{one['name']}`",
                f"`{one['default']}`",
                "" if one["range"] is None else "{:g} … {:g}".format(*one["range"]),
                _cell(one["meaning"]),
            )
            for one in facts["parameters"]
        ]
        if rows:
            parts.append(table(("parameter", "default", "range for `tune`", "meaning"), rows))
    return "\n\n".join(parts) + "\n"


def _cell(text: str) -> str:
    """Return a text as one line without the markup of tables, links or lists."""
    return " ".join(text.split()).replace("[", "\\[").replace("<", "&lt;")


def fields() -> str:
    """Return the page of all fields of the frames, datagrams and messages of every device that are defined in a
    table.
    """
    parts = [
        "# Fields on the wires",
        "The tables that the bridge uses to read and write messages; `hil-bridge decode`, `monitor` and "
        "`hil-bridge export --to dbc` use them too. Bytes are counted from the start of the payload. "
        "[The S3's computer link](../computer-link.md) has its own page.",
    ]
    for device, layouts in FIELD_TABLES.items():
        parts.append(f"## {device}")
        for layout in dict.fromkeys(layouts):
            if layout.fields:
                order = "low byte first" if layout.byte_order == "<" else "high byte first"
                parts += [
                    f"### {device}: {layout.name}",
                    f"{layout.size} bytes, {order}.",
                    field_table(layout, 0),
                ]
    parts += [
        "## RSI",
        "Elements of a common configuration; a configuration may name any channel.",
        table(
            ("element", "content", "unit", "meaning"),
            (
                (f"`{name}`", element.content.value, ", ".join(_units(element)), element.meaning)
                for name, element in ELEMENTS.items()
            ),
        ),
        "## RTDE: outputs",
        _variables(OUTPUTS),
        "## RTDE: inputs",
        _variables(INPUTS),
    ]
    return "\n\n".join(parts) + "\n"


def _units(element: Element) -> list[str]:
    return list(dict.fromkeys(unit for axis in POSE_AXES if (unit := element.unit(axis))))


def _variables(variables: Mapping[str, Variable]) -> str:
    rows = []
    for name, one in variables.items():
        if "_register" not in name:
            since = ".".join(map(str, one.since)) if any(one.since) else ""
            rows.append((f"`{name}`", one.type, one.unit, since, one.mark, one.meaning))
    return table(("variable", "type", "unit", "since", "mark", "meaning"), rows)


FIELD_TABLES: Mapping[str, tuple[Layout, ...]] = {
    "JR3 CAN gateway": (can_gateway.FULL_SCALES, *can_gateway.LAYOUTS.values()),
    "ATI NETCANOEM": tuple(ati_can.LAYOUTS.values()),
    "ATI Net F/T": (netft.REQUEST, netft.RECORD),
    "Robotiq FT 300": (ft300.MESSAGE,),
    "RTDE": (packets.VERSION_REQUEST, packets.CONTROLLER_VERSION, packets.OUTPUTS_HEAD),
}
"""Tables of payloads, by device."""


def package_page(package: Path) -> str:
    """Return the README of a package, with links that are valid on the site."""
    return (package / "README.md").read_text(encoding="utf-8").replace("](../../docs/", "](../../")


PAGES: Mapping[str, Callable[[], str]] = {
    "known-devices": known_devices,
    "command-line": command_line,
    "configuration": configuration,
    "wires": wires,
    "panels": panels,
    "events": events,
    "topics": topics,
    "controllers": controllers,
    "fields": fields,
    "names": package_names,
    "authors": author_names,
    **{
        path.parent.name: partial(package_page, path.parent)
        for path in ROOT.glob("packages/*/pyproject.toml")
    },
}
"""Functions that make the pages, by file name."""
