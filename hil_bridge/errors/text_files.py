"""Text and TOML that an operator or a recording hands us, read without trusting it.

Whatever is in a file, reading it ends in values of ordinary size or in one line that says what is wrong.
"""

import codecs
import errno
import json
import os
import re
import stat
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, BinaryIO

from hil_bridge.errors import ConfigError
from hil_bridge.errors.file_kinds import HEAD_BYTES, refuse_known, refuse_table

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
NUMBER_CHARACTERS = 12
"""A number that is longer is rounded in messages. Chosen: longer ones come from arithmetic."""

_MARKS = {
    codecs.BOM_UTF8: "utf-8-sig",
    codecs.BOM_UTF32_LE: "utf-32",  # before UTF-16, whose mark it begins with
    codecs.BOM_UTF16_LE: "utf-16",
    codecs.BOM_UTF16_BE: "utf-16",
}
_PIECE_BYTES = 1 << 20
_KINDS = (
    (stat.S_ISFIFO, "a pipe"),
    (stat.S_ISCHR, "a device"),
    (stat.S_ISBLK, "a device"),
    (stat.S_ISSOCK, "a socket"),
)
_DEEP_KEY = re.compile(rf"(?<![\w-])(?>[\w-]++[ \t\"']*+\.[ \t\"']*+){{{DEPTH_LIMIT}}}")
"""A key of too many parts, for which the parser would take time by the square of their number. It has the same look in
a text, where none of ours has it.
"""
_BARE_KEY = re.compile(r"[A-Za-z0-9_-]+")


def read_text(path: Path, limit: int = TEXT_LIMIT_BYTES, encoding: str = "utf-8") -> str:
    """Read a text file of at most `limit` bytes; a byte-order mark gives its encoding. Raises ConfigError naming the
    file.
    """
    with open_ordinary(path) as file:
        data = read_up_to(file, limit + 1)
    if len(data) > limit:
        refuse_known(format_path(path), data)
        raise ConfigError(f"{format_path(path)} is longer than {limit} bytes: it is not what is wanted here")
    marks = (name for mark, name in _MARKS.items() if data.startswith(mark) and len(data) > len(mark))
    encoding = next(marks, encoding)
    try:
        return data.decode(encoding).replace("\r\n", "\n")
    except UnicodeDecodeError as error:
        refuse_known(format_path(path), data)
        line, name = data.count(b"\n", 0, error.start) + 1, encoding.removesuffix("-sig")
        raise ConfigError(
            f"{format_path(path)} is no text in {name}: {error.reason} in line {line}; save it as {name}"
        ) from error


@contextmanager
def open_ordinary(path: Path, what: str = "") -> Iterator[BinaryIO]:
    """Open an ordinary file to be read: not a device, a pipe or a folder, which might never end or never begin.

    `what` says what it is, as "the recording". Raises ConfigError naming the file, also for an error while inside.
    """
    name = f"{what} {format_path(path)}".lstrip()
    refuse_nul(path, name)
    try:
        # a pipe without a writer must not keep us waiting
        with os.fdopen(os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC), "rb") as file:
            refuse_other_kinds(os.fstat(file.fileno()).st_mode, name)
            yield file
    except OSError as error:
        raise ConfigError(f"cannot read {name}: {error.strerror or error}") from error
    except ValueError as error:
        raise ConfigError(f"cannot read {name}: {error}") from error


def refuse_nul(path: Path, name: str) -> None:
    """Raise ConfigError for a path that no file can have. Each version of Python answers it in words of its own."""
    if "\0" in str(path):
        raise ConfigError(f"cannot read {name}: a NUL stands in it")


def refuse_other_kinds(mode: int, name: str) -> None:
    """Raise ConfigError for a file whose mode, as stat(2) tells it, is of no ordinary file."""
    if stat.S_ISDIR(mode):
        raise ConfigError(f"cannot read {name}: {os.strerror(errno.EISDIR)}")
    if not stat.S_ISREG(mode):
        kind = next((text for is_kind, text in _KINDS if is_kind(mode)), "something else")
        raise ConfigError(f"cannot read {name}: it is {kind}; name an ordinary file")


def refuse_known_file(path: Path) -> None:
    """Raise ConfigError for a file that a reader of recordings refuses, and that is known by its first bytes, a table,
    or TOML.
    """
    try:
        with open_ordinary(path) as file:
            head = file.read(HEAD_BYTES)
    except ConfigError:
        return
    refuse_table(format_path(path), head)
    if path.suffix == ".toml":
        raise ConfigError(f"{format_path(path)} is a TOML file; `hil-bridge run` takes a configuration")


def read_up_to(file: BinaryIO, limit: int) -> bytes:
    """Read the next bytes of a file, `limit` at most, without the memory for more than there are."""
    data = bytearray()
    while piece := file.read(min(_PIECE_BYTES, limit - len(data))):
        data += piece
    return bytes(data)


def read_toml(path: Path) -> dict[str, Any]:
    """Read the values of a TOML file. Raises ConfigError as `read_text` and `parse_toml` do."""
    return parse_toml(read_text(path, TOML_LIMIT_BYTES), format_path(path))


def parse_toml(text: str, source: str) -> dict[str, Any]:
    """Parse the values of a TOML text. Raises ConfigError that names `source`."""
    if _DEEP_KEY.search(text):
        raise ConfigError(f"{source} is no TOML of ours: {_TOO_DEEP}")
    import tomllib

    try:
        values = tomllib.loads(text)
    except RecursionError as error:
        raise ConfigError(f"{source} is no TOML of ours: {_TOO_DEEP}") from error
    except ValueError as error:  # TOMLDecodeError is one; a number of 5000 digits is a plain one
        refuse_table(source, text[:HEAD_BYTES].encode())
        raise ConfigError(f"{source} is no TOML: {_in_words(str(error))}") from error
    for problem in _problems(values):
        raise ConfigError(f"{source}: {problem}")
    return values


def _in_words(problem: str) -> str:
    """Translate the TOML parser's message to words of a file; of the rest its first clause."""
    if (twice := _TWICE.match(problem)) is None:
        return problem.partition(";")[0]
    table = ".".join(re.findall(r"'([^']*)'", twice[1]))
    return f"it has the table [{table}] twice {twice[2]}; put the lines of the second into the first"


def toml_value(value: object) -> str:
    """Format a plain value, an array or an inline table as TOML.

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
    """Format a value for a message: a number with nine digits at most, and anything else cut if it is long."""
    text = (
        f"{value:.9g}" if isinstance(value, float) and len(repr(value)) > NUMBER_CHARACTERS else repr(value)
    )
    return text if len(text) <= SHOWN_CHARACTERS else f"{text[:SHOWN_CHARACTERS]}…"


def format_path(path: Path) -> str:
    """Format a path for a message, on one line."""
    text = str(path)
    return text if text.isprintable() else repr(text)


def harmless(text: str) -> str:
    """Remove characters that act on a terminal from a text of a device or a package.

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
