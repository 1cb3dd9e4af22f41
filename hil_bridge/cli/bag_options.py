"""The options of commands that read a bag of ROS 2 beside recordings."""

import functools
from collections.abc import Callable
from typing import Any

import click

_GIVEN = ("topic", "axis", "wrench_in", "sign", "zero_s", "contact_n", "stamps")


def bag_options(command: Callable[..., Any]) -> Callable[..., Any]:
    """Gives a command the options, and the argument `bag` with what they chose."""
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
    """Role and topic of each."""
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
        help="Topic of a bag as wrench, pose or target; pose=/tf:CHILD takes a frame of /tf. Of several for a role, "
        "the first that a bag has.  [default: wrench and pose by their types]",
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
        help="Axes along which a bag's wrench is told: those of the pose's child frame, or of its parent.",
    ),
    click.option(
        "--sign",
        type=click.Choice(("1", "-1")),
        default="1",
        show_default=True,
        callback=lambda _context, _parameter, given: int(given),
        help="1: a bag's wrench acts on the tool; -1: the tool's on its surroundings.",
    ),
    click.option(
        "--zero",
        "zero_s",
        type=click.FloatRange(0),
        default=0.0,
        metavar="SECONDS",
        help="Begin of a bag whose mean wrench is taken off.  [default: none]",
    ),
    click.option(
        "--contact",
        "contact_n",
        type=click.FloatRange(0),
        default=1.0,
        show_default=True,
        metavar="NEWTON",
        help="Force from which the tool of a bag is in contact.",
    ),
    click.option(
        "--stamps",
        type=click.Choice(("header", "log")),
        default="header",
        show_default=True,
        help="Times of a bag's messages: the stamps in their headers, or those of the recording.",
    ),
)
