"""Files of version 0.5 in the form of now: settings of the S3 and the JR3 stand in sections of their kinds.

Version 0.5 is the last that reads such a file. Here its text is rewritten, so that its comments stay.
"""

import re
from collections.abc import Callable, Mapping, Sequence

from hil_bridge.record.reader import LAST_READER

MOVED: Mapping[str, str] = {
    "robot.orders_file": "robot.s3.orders_file",
    "robot.link": "robot.s3.link",
    "sensor.gateway": "sensor.jr3.gateway",
    "sensor.uart": "sensor.jr3.uart",
    "sensor.board": "sensor.jr3.board",
    "cell.robot": "cell.s3.robot",
    "cell.link": "cell.s3.link",
    "cell.servo": "cell.s3.servo",
    "cell.sensor": "cell.jr3.sensor",
    "cell.gateway": "cell.jr3.gateway",
    "cell.uart_gateway": "cell.jr3.uart",
    "cell.board": "cell.jr3.board",
}
"""The present key by the one of version 0.5; all keys below it move with it."""
RENAMED_KINDS: Mapping[str, str] = {"gateway": "jr3", "uart": "jr3-uart", "board": "jr3-board"}
"""The kinds of a JR3's receivers by the names that `sensor.emulated` had."""

_TABLE = re.compile(r"(\s*#?\s*\[\[?\s*)([A-Za-z_][\w.-]*)(\s*\]\]?.*)", re.DOTALL)
"""The head of a table, in use or commented out."""
_PAIR = re.compile(r"(?P<before>(?:^\s*#?\s*|[{,]\s*))(?P<key>[A-Za-z_][\w.-]*)(?P<equals>\s*=\s*)")
"""A key before its value, at the begin of a line or inside an inline table."""
_TEXT = re.compile(r"\"[^\"\n]*\"|'[^'\n]*'")
_OPENS, _CLOSES = "{", "}"


def older_setting(location: Sequence[str]) -> str:
    """Words for a setting of version 0.5, to follow its key; empty for a key that is none."""
    for length in range(len(location), 1, -1):
        old = ".".join(location[:length])
        if old in MOVED:
            new = ".".join((MOVED[old], *location[length:]))
            return (
                f"is now {new}: version {LAST_READER} is the last that reads this form; "
                "`hil-bridge config upgrade` rewrites the file"
            )
    return ""


def upgrade_text(text: str) -> tuple[str, list[str]]:
    """A file of version 0.5 in the form of now, its comments kept, and each change in words."""
    changes: list[str] = []
    table, lines = "", []
    for line in text.splitlines():
        if head := _TABLE.fullmatch(line):
            new = _present(head[2])
            if new != head[2]:
                changes.append(f"[{head[2]}] is now [{new}]")
            table = head[2]
            lines.append(f"{head[1]}{new}{head[3]}")
        else:
            lines.append(_Line(line, table, changes).rewritten())
    return "\n".join(lines) + "\n", changes


class _Line:
    """A line of keys and values, rewritten from left to right."""

    def __init__(self, text: str, table: str, changes: list[str]) -> None:
        self._text, self._changes = text, changes
        self._tables = [table]
        """Dotted keys of the tables around a place, the innermost last."""

    def rewritten(self) -> str:
        """The line in the form of now."""
        parts, at, key = [], 0, ""
        while at < len(self._text):
            if pair := _PAIR.match(self._text, at):
                key = pair["key"]
                self._enter(pair["before"])
                parts.append(f"{pair['before']}{self._present_key(key)}{pair['equals']}")
                at = pair.end()
                if self._text[at : at + 1] == _OPENS:
                    self._tables.append(_join(self._tables[-1], key))
                continue
            if value := _TEXT.match(self._text, at):
                parts.append(self._value(_join(self._tables[-1], key), value[0]))
                at = value.end()
                continue
            character = self._text[at]
            if character == "#" and at:  # a comment behind a value
                return "".join(parts) + self._text[at:]
            if character == _CLOSES and len(self._tables) > 1:
                self._tables.pop()
            parts.append(character)
            at += 1
        return "".join(parts)

    def _enter(self, before: str) -> None:
        """An inline table that no key names, as in a list: its keys are told from the top of the file."""
        if before.startswith(_OPENS) and len(self._tables) == 1:
            self._tables.append("")

    def _present_key(self, key: str) -> str:
        """The key as it is called now, told from the same table as before."""
        table = self._tables[-1]
        old = _join(table, key)
        new = _present(old)
        present_key = new.removeprefix(f"{_present(table)}.") if table else new
        if present_key != key:
            self._changes.append(f"{old} is now {new}")
        return present_key

    def _value(self, key: str, quoted: str) -> str:
        """A text as it is written now."""
        rewrite = _VALUES.get(key)
        if rewrite is None:
            return quoted
        mark, text = quoted[0], quoted[1:-1]
        new = rewrite(text)
        if new != text:
            self._changes.append(f"{key} = {quoted} is now {mark}{new}{mark}")
        return f"{mark}{new}{mark}"


def _join(table: str, key: str) -> str:
    return f"{table}.{key}" if table else key


def _present(key: str) -> str:
    """The dotted key of now for one of version 0.5."""
    for old, new in MOVED.items():
        if key == old or key.startswith(f"{old}."):
            return new + key[len(old) :]
    return key


def _robot_url(url: str) -> str:
    """A URL without a kind was one of an S3."""
    scheme = url.partition(":")[0]
    return f"s3+{url}" if url and "+" not in scheme else url


def _sensor_url(url: str) -> str:
    """A URL without a kind was one of a JR3, whose receiver followed from the wire."""
    head, _, query = url.partition("?")
    if url.startswith("can+"):
        return f"jr3+{url}"
    if url.startswith(("jr3+tcp", "jr3+memory")):
        return f"jr3-board+{url.removeprefix('jr3+')}"
    options = query.split("&")
    if "gateway=jr3" not in options:
        return url
    options.remove("gateway=jr3")
    return f"jr3-uart+{head}{'?' if options else ''}{'&'.join(options)}"


_VALUES: Mapping[str, Callable[[str], str]] = {
    "robot.url": _robot_url,
    "sensor.url": _sensor_url,
    "sensor.emulated": lambda name: RENAMED_KINDS.get(name, name),
}
"""How a text is written now, by its key."""
