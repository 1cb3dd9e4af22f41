"""Rows of a monitor on a terminal, and its end by a signal or by its wire."""

import asyncio
import math
import signal
from collections.abc import Mapping
from contextlib import suppress
from functools import partial
from typing import NamedTuple

import click

from hil_bridge.clock import Clock
from hil_bridge.errors import TransportError
from hil_bridge.errors.text_files import harmless


class Row(NamedTuple):
    """Row of a monitor."""

    at: float
    """Time, s; NaN if unknown."""
    direction: str
    text: str
    data: bytes = b""
    """Its bytes, printed on request."""
    trouble: bool = False
    line_time: float | None = None
    """Time that it took on the line, s; None if unknown."""


class Printer:
    """Prints rows with their times since the first and since the last row."""

    def __init__(self, raw: bool, begun: float | None = None) -> None:
        self._raw = raw
        self._begun = begun
        self._before = begun

    def row(self, row: Row) -> None:
        """Print a row: time, time since the last row, direction, line time, text."""
        self._begun = row.at if self._begun is None else self._begun
        since = row.at - (row.at if self._before is None else self._before)
        self._before = row.at
        took = "" if row.line_time is None else f"{row.line_time * 1e3:.1f} ms"
        times = f"{row.at - self._begun:12.6f} {since:+10.6f}"
        if math.isnan(row.at):
            times = f"{'-':>12} {'-':>10}"
        times += f" {row.direction:<6} {took:>8}"
        hexed = f"  {{{row.data.hex(' ').upper()}}}" if self._raw and row.data else ""
        click.echo(f"{times} {'!' if row.trouble else ' '} {harmless(row.text)}{hexed}")


def field_text(field: Mapping[str, object], zeros: bool = False) -> str:
    """Return name, value and unit of a decoded field; "" for one that is 0, unless `zeros` is set."""
    name, value, unit = str(field["name"]), field["value"], str(field["unit"])
    if isinstance(value, (int, float)):
        if not value and not zeros:
            return ""
        value = f"{value:.7g}"
    return " ".join(filter(None, (name.replace("_", " "), str(value), unit)))


def end(ended: "asyncio.Future[None]", cause: TransportError | None = None) -> None:
    """End a monitor, with the cause if its wire has failed."""
    if ended.done():
        return
    if cause is None:
        ended.set_result(None)
    else:
        ended.set_exception(cause)


def stop_on_signals(clock: Clock, ended: "asyncio.Future[None]") -> None:
    """Let SIGINT and SIGTERM end a monitor."""
    with suppress(NotImplementedError):  # no signal handlers in loops of other platforms
        for number in (signal.SIGINT, signal.SIGTERM):
            clock.loop.add_signal_handler(number, partial(end, ended))
