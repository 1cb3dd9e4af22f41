"""Where in a TOML text each key stands: the standard library's reader does not tell, and errors should."""

import re
import tomllib
from bisect import bisect_right
from collections.abc import Mapping
from typing import TypeAlias

KeyPath: TypeAlias = tuple[str | int, ...]
"""Keys from the top down; a number is a place in an array."""

_BARE = re.compile(r"[A-Za-z0-9_-]+")
_BLANK = re.compile(r"(?:[ \t\r\n]|#[^\n]*)*")
_SPACE = re.compile(r"[ \t]*")
_STRING = re.compile(
    r'"""(?:\\.|[^\\])*?"{3,5}' r"|'''.*?'{3,5}" r'|"(?:\\.|[^"\\])*"' r"|'[^']*'",
    re.DOTALL,
)
_PLAIN = re.compile(r"[^,\]}#\n]*")


def key_lines(text: str) -> Mapping[KeyPath, int]:
    """The line, counted from 1, of every key, table and array item of a text that `tomllib` accepts."""
    scanner = _Scanner(text)
    scanner.document()
    return scanner.lines


class _Scanner:
    """Walks a text that is known to be TOML: it only has to find the keys, not to doubt them."""

    def __init__(self, text: str) -> None:
        self.lines: dict[KeyPath, int] = {}
        self._text = text
        self._at = 0
        self._breaks = [match.start() for match in re.finditer("\n", text)]
        self._tables: dict[KeyPath, int] = {}
        """How many tables each array of tables has so far."""

    def document(self) -> None:
        """Note every key of the text."""
        table: KeyPath = ()
        while self._skip(_BLANK):
            if self._next("[["):
                table = self._header(many=True)
            elif self._next("["):
                table = self._header(many=False)
            else:
                self._pair(table)

    def _header(self, many: bool) -> KeyPath:
        begin = self._at
        path: KeyPath = ()
        parts = self._key()
        for part in parts[:-1]:
            path = self._into((*path, part), begin)
        path = (*path, parts[-1])
        if many:
            count = self._tables[path] = self._tables.get(path, 0) + 1
            self._note(path, begin)
            path = (*path, count - 1)
        self._note(path, begin)
        self._skip(_SPACE)
        self._at += 2 if many else 1
        return path

    def _into(self, path: KeyPath, begin: int) -> KeyPath:
        """A table on the way to another; of an array of tables the newest."""
        self._note(path, begin)
        return (*path, self._tables[path] - 1) if path in self._tables else path

    def _pair(self, table: KeyPath) -> None:
        begin = self._at
        path = table
        for part in self._key():
            path = (*path, part)
            self._note(path, begin)
        self._skip(_SPACE)
        self._at += 1  # the equals sign
        self._skip(_SPACE)
        self._value(path)

    def _value(self, path: KeyPath) -> None:
        if self._next("["):
            index = 0
            while self._skip(_BLANK) and not self._next("]"):
                self._note((*path, index), self._at)
                self._value((*path, index))
                index += 1
                self._skip(_BLANK)
                self._next(",")
        elif self._next("{"):
            while self._skip(_BLANK) and not self._next("}"):
                self._pair(path)
                self._skip(_BLANK)
                self._next(",")
        elif not self._take(_STRING):
            self._take(_PLAIN)

    def _key(self) -> tuple[str, ...]:
        parts = []
        while True:
            self._skip(_SPACE)
            if quoted := self._take(_STRING):
                parts.append(str(tomllib.loads(f"key = {quoted}")["key"]))
            else:
                parts.append(self._take(_BARE))
            self._skip(_SPACE)
            if not self._next("."):
                return tuple(parts)

    def _note(self, path: KeyPath, at: int) -> None:
        self.lines.setdefault(path, bisect_right(self._breaks, at - 1) + 1)

    def _skip(self, what: re.Pattern[str]) -> bool:
        """Pass over it; whether anything is left."""
        self._take(what)
        return self._at < len(self._text)

    def _take(self, what: re.Pattern[str]) -> str:
        match = what.match(self._text, self._at)
        if match is None:
            return ""
        self._at = match.end()
        return match.group()

    def _next(self, token: str) -> bool:
        """Pass over this token if it stands here."""
        if not self._text.startswith(token, self._at):
            return False
        self._at += len(token)
        return True
