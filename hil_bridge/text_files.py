"""Text and TOML that a person or a recording hands us, read without trusting it.

Whatever is in a file, reading it ends in values of ordinary size or in one line that says what is wrong.
"""

import json
import re
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any, BinaryIO

from hil_bridge.errors import ConfigError

TEXT_LIMIT_BYTES = 1 << 28
"""Longest text file that is read. Chosen: a day and a half of a busy computer link as a text capture."""
TOML_LIMIT_BYTES = 1 << 20
"""Longest TOML file. Chosen: our largest, with every setting and its comment, is 40 times shorter."""
DEPTH_LIMIT = 32
"""Tables and arrays within each other at most. Chosen: our deepest settings lie 5 deep."""
INTEGER_LIMIT = 1 << 63
"""Whole numbers lie below this, and not below its negative. Standard: TOML 1.0 asks for 64 bits and allows no more."""
SHOWN_CHARACTERS = 80
"""Most characters of a wrong value in a message. Chosen: a line of a terminal."""

_PIECE_BYTES = 1 << 20
_BARE_KEY = re.compile(r"[A-Za-z0-9_-]+")


def read_text(path: Path, limit: int = TEXT_LIMIT_BYTES, encoding: str = "utf-8") -> str:
    """The text of a file of at most `limit` bytes. Raises ConfigError naming the file."""
    try:
        with path.open("rb") as file:
            data = read_up_to(file, limit + 1)
        if len(data) > limit:
            raise ConfigError(
                f"{format_path(path)} is longer than {limit} bytes: it is not what is wanted here"
            )
        return data.decode(encoding).replace("\r\n", "\n")
    except OSError as error:
        raise ConfigError(f"cannot read {format_path(path)}: {error.strerror or error}") from error
    except UnicodeDecodeError as error:
        raise ConfigError(f"{format_path(path)} is no text in {encoding}: {error.reason}") from error
    except ValueError as error:  # a NUL in the path
        raise ConfigError(f"cannot read {format_path(path)}: {error}") from error


def read_up_to(file: BinaryIO, limit: int) -> bytes:
    """The next bytes of a file, `limit` at most, without the memory for more than there are."""
    data = bytearray()
    while piece := file.read(min(_PIECE_BYTES, limit - len(data))):
        data += piece
    return bytes(data)


def read_toml(path: Path) -> dict[str, Any]:
    """The values of a TOML file. Raises ConfigError as `read_text` and `parse_toml` do."""
    return parse_toml(read_text(path, TOML_LIMIT_BYTES), format_path(path))


def parse_toml(text: str, source: str) -> dict[str, Any]:
    """The values of a TOML text. Raises ConfigError that names `source`."""
    try:
        values = tomllib.loads(text)
    except RecursionError as error:
        raise ConfigError(f"{source} is no TOML of ours: {_TOO_DEEP}") from error
    except ValueError as error:  # TOMLDecodeError is one; a number of 5000 digits is a plain one
        raise ConfigError(f"{source} is no TOML: {_in_words(str(error))}") from error
    for problem in _problems(values):
        raise ConfigError(f"{source}: {problem}")
    return values


def _in_words(problem: str) -> str:
    """What the parser of TOML says, in words of a file; of the rest its first clause."""
    if (twice := _TWICE.match(problem)) is None:
        return problem.partition(";")[0]
    table = ".".join(re.findall(r"'([^']*)'", twice[1]))
    return f"it has the table [{table}] twice {twice[2]}; put the lines of the second into the first"


def toml_value(value: object) -> str:
    """A plain value, an array or an inline table as TOML writes it.

    The standard library writes no TOML, and no small library writes the comments that our files mostly are.
    """
    match value:
        case bool():
            return str(value).lower()
        case str():
            return json.dumps(value, ensure_ascii=False)
        case tuple() | list():
            return "[" + ", ".join(map(toml_value, value)) + "]"
        case dict():
            return "{" + ", ".join(toml_pair(key, item) for key, item in value.items()) + "}"
        case _:
            return repr(value)


def toml_pair(key: str, value: object) -> str:
    """`key = value`; a key that is no bare one is quoted."""
    return f"{key if _BARE_KEY.fullmatch(key) else toml_value(key)} = {toml_value(value)}"


def parse_json(text: str) -> Any:
    """Value of a JSON text in a recording. Raises ValueError with the reason."""
    try:
        value = json.loads(text)
    except RecursionError as error:
        raise ValueError(_TOO_DEEP) from error
    for problem in _problems(value):
        raise ValueError(problem)
    return value


def format_value(value: object) -> str:
    """A value for a message, cut where it is long."""
    text = repr(value)
    return text if len(text) <= SHOWN_CHARACTERS else f"{text[:SHOWN_CHARACTERS]}…"


def format_path(path: Path) -> str:
    """A path for a message, which stays one line."""
    text = str(path)
    return text if text.isprintable() else repr(text)


def harmless(text: str) -> str:
    """The same text without characters that act on a terminal, as a device or a package may tell them.

    Each is shown as its escape in Python; line ends and tabs stay.
    """
    if text.isprintable():
        return text
    return "".join(sign if sign.isprintable() or sign in "\n\t" else repr(sign)[1:-1] for sign in text)


_TWICE = re.compile(r"Cannot declare \((.+)\) twice (\(at line \d+, column \d+\))")
_TOO_DEEP = f"tables and arrays lie more than {DEPTH_LIMIT} deep in each other"


def _problems(value: object) -> Iterator[str]:
    """Properties that none of our values has, found without recursion."""
    waiting: list[tuple[str, int, object]] = [("", 0, value)]
    while waiting:
        key, depth, found = waiting.pop()
        match found:
            case dict() | list() if depth >= DEPTH_LIMIT:
                yield _TOO_DEEP
            case dict():
                for name, item in found.items():
                    if not name.isprintable():
                        yield f"the key {format_value(name)} holds a character that cannot be printed"
                    waiting.append((f"{key}.{name}" if key else name, depth + 1, item))
            case list():
                waiting += ((key, depth + 1, item) for item in found)
            case str() if "\0" in found:
                yield f"{_cut(key)}: a text must not hold a NUL character, got {format_value(found)}"
            case int() if not -INTEGER_LIMIT <= found < INTEGER_LIMIT:
                yield f"{_cut(key)}: a whole number must fit 64 bits"


def _cut(key: str) -> str:
    return key if len(key) <= SHOWN_CHARACTERS else f"{key[:SHOWN_CHARACTERS]}…"
