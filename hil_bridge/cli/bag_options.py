"""Options of commands that read ROS 2 bags in addition to recordings."""

import functools
from collections.abc import Callable
from typing import Any

import click

_GIVEN = ("topic", "axis", "wrench_in", "sign", "zero_s", "contact_n", "stamps")


def bag_options(command: Callable[..., Any]) -> Callable[..., Any]:
    """Add the options to a command. The command receives their values as the argument `bag`."""
    for option in reversed(_OPTIONS):
        command = option(command)

    @functools.wraps(command)
    def gather(**given: Any) -> Any:
        from hil_bridge.record.foreign import BagChoices

        chosen = {name: given.pop(name) for name in _GIVEN}
        topics: dict[str, list[str]] = {}
        for role, name in chosen.pop("topic"):
            topics.setdefault(role, []).append(name)
        return command(bag=BagChoices(topics=topics, **chosen), **given)

    return gather


def _topics(_context: click.Context, _parameter: click.Parameter, given: tuple[str, ...]) -> list[list[str]]:
    """Return the role and the topic of each value."""
    pairs = [one.split("=", 1) for one in given]
    for text, pair in zip(given, pairs, strict=True):
        if len(pair) != 2 or not all(pair):
            raise click.BadParameter(f"{text!r} must be ROLE=TOPIC, as wrench=/ft/wrench")
    return pairs


_OPTIONS = (
    click.option(
        "--topic",
        multiple=True,
        callback=_topics,
        metavar="ROLE=TOPIC",
        help="Topic of a bag for wrench, pose or target; pose=/tf:CHILD takes a frame of /tf. Of several for a role, "
        "the first that a bag has is used.  [default: wrench and pose by their types]",
    ),
    click.option(
        "--axis",
        default="tool:z",
        show_default=True,
        metavar="FRAME:AXIS",
        help="Direction in which the tool of a bag presses: tool or base, and x, y, z, -x, -y, -z.",
    ),
    click.option(
        "--wrench-in",
        type=click.Choice(("tool", "base")),
        default="tool",
        show_default=True,
        help="Frame in which a bag's wrench is expressed: the pose's child frame (tool) or its parent (base).",
    ),
    click.option(
        "--sign",
        type=click.Choice(("1", "-1")),
        default="1",
        show_default=True,
        callback=lambda _context, _parameter, given: int(given),
        help="1: a bag's wrench acts on the tool; -1: it is exerted by the tool.",
    ),
    click.option(
        "--zero",
        "zero_s",
        type=click.FloatRange(0),
        default=0.0,
        metavar="SECONDS",
        help="Time at the start of a bag whose mean wrench is subtracted.  [default: none]",
    ),
    click.option(
        "--contact",
        "contact_n",
        type=click.FloatRange(0),
        default=1.0,
        show_default=True,
        metavar="NEWTON",
        help="Least force at which the tool of a bag counts as in contact.",
    ),
    click.option(
        "--stamps",
        type=click.Choice(("header", "log")),
        default="header",
        show_default=True,
        help="Time stamps of a bag's messages: from their headers, or from when they were logged.",
    ),
)
