"""Safe reading of text, TOML and JSON from untrusted files and recordings.

Regardless of the content, reading returns values of limited size, or raises an error with a one-line message.
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
"""Maximum size of a text file, bytes. Chosen: a day and a half of a busy computer link as a text capture."""
TOML_LIMIT_BYTES = 1 << 20
"""Maximum size of a TOML file, bytes. Chosen: 40 times the size of the project's largest file, which contains every
setting with its comment.
"""
DEPTH_LIMIT = 32
"""Maximum depth of nested tables and arrays. Chosen: the project's settings have at most 5 levels."""
INTEGER_LIMIT = 1 << 63
"""Exclusive upper limit of integers. Its negative is the inclusive lower limit. Standard: TOML 1.0, 64 bits."""
SHOWN_CHARACTERS = 80
"""Maximum number of characters of an invalid value in a message. Chosen: a line of a terminal."""
NUMBER_CHARACTERS = 12
"""Maximum number of characters of a number in a message. A longer number is rounded. Chosen: longer numbers come
from arithmetic.
"""

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
"""Pattern for a key with too many parts, because the parser's time grows with the square of their number. The
pattern also matches such a text in a string, which none of the project's files contains.
"""
_BARE_KEY = re.compile(r"[A-Za-z0-9_-]+")


def read_text(path: Path, limit: int = TEXT_LIMIT_BYTES, encoding: str = "utf-8") -> str:
    """Return the text of a file of at most `limit` bytes. A byte-order mark determines its encoding. Raises
    ConfigError with the file.
    """
    with open_ordinary(path) as file:
        data = read_up_to(file, limit + 1)
    if len(data) > limit:
        refuse_known(format_path(path), data)
        raise ConfigError(f"{format_path(path)} is too large; allowed: at most {limit} bytes")
    marks = (name for mark, name in _MARKS.items() if data.startswith(mark) and len(data) > len(mark))
    encoding = next(marks, encoding)
    try:
        return data.decode(encoding).replace("\r\n", "\n")
    except UnicodeDecodeError as error:
        refuse_known(format_path(path), data)
        line, name = data.count(b"\n", 0, error.start) + 1, encoding.removesuffix("-sig")
        raise ConfigError(
            f"{format_path(path)} is not valid {name}: {error.reason} in line {line}; save it as {name}"
        ) from error


@contextmanager
def open_ordinary(path: Path, what: str = "") -> Iterator[BinaryIO]:
    """Open a regular file for reading. A device, a pipe or a folder is refused, because reading it may block.

    `what` describes the file, for example "the recording". Raises ConfigError with the file, also if an OSError or
    a ValueError is raised inside the context.
    """
    name = f"{what} {format_path(path)}".lstrip()
    refuse_nul(path, name)
    try:
        # opening a pipe without a writer must not block
        with os.fdopen(os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC), "rb") as file:
            refuse_other_kinds(os.fstat(file.fileno()).st_mode, name)
            yield file
    except OSError as error:
        raise ConfigError(f"cannot read {name}: {error.strerror or error}") from error
    except ValueError as error:
        raise ConfigError(f"cannot read {name}: {error}") from error


def refuse_nul(path: Path, name: str) -> None:
    """Raise ConfigError for a path that contains a NUL. The message of Python's own error depends on the version of
    Python.
    """
    if "\0" in str(path):
        raise ConfigError(f"cannot read {name}: its path contains a NUL")


def refuse_other_kinds(mode: int, name: str) -> None:
    """Raise ConfigError unless the given mode from stat(2) is the mode of a regular file."""
    if stat.S_ISDIR(mode):
        raise ConfigError(f"cannot read {name}: {os.strerror(errno.EISDIR)}")
    if not stat.S_ISREG(mode):
        kind = next((text for is_kind, text in _KINDS if is_kind(mode)), "something else")
        raise ConfigError(f"cannot read {name}: it is {kind}, not a regular file")


def refuse_known_file(path: Path) -> None:
    """Raise ConfigError for a file of a known type that is not a recording: a type known by its first bytes, a
    table, or TOML.
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
    """Return at most `limit` bytes from a file, without allocating more memory than the content needs."""
    data = bytearray()
    while piece := file.read(min(_PIECE_BYTES, limit - len(data))):
        data += piece
    return bytes(data)


def read_toml(path: Path) -> dict[str, Any]:
    """Return the values of a TOML file. Raises ConfigError for the same reasons as `read_text` and `parse_toml`."""
    return parse_toml(read_text(path, TOML_LIMIT_BYTES), format_path(path))


def parse_toml(text: str, source: str) -> dict[str, Any]:
    """Return the values of a TOML text. Raises ConfigError with `source`."""
    if _DEEP_KEY.search(text):
        raise ConfigError(f"{source} cannot be read: {_TOO_DEEP}")
    import tomllib

    try:
        values = tomllib.loads(text)
    except RecursionError as error:
        raise ConfigError(f"{source} cannot be read: {_TOO_DEEP}") from error
    except ValueError as error:  # includes TOMLDecodeError; a number of 5000 digits raises a plain one
        refuse_table(source, text[:HEAD_BYTES].encode())
        raise ConfigError(f"{source} is not valid TOML: {_explain(str(error))}") from error
    for problem in _problems(values):
        raise ConfigError(f"{source}: {problem}")
    return values


def _explain(problem: str) -> str:
    """Return an explanation of the TOML parser's message about a repeated table, or the first clause of any other
    message.
    """
    if (twice := _TWICE.match(problem)) is None:
        return problem.partition(";")[0]
    table = ".".join(re.findall(r"'([^']*)'", twice[1]))
    return f"it contains the table [{table}] twice {twice[2]}; merge the second into the first"


def toml_value(value: object) -> str:
    """Return a plain value, an array or an inline table formatted as TOML.

    The standard library does not write TOML, and no small library writes comments, which make up most of the
    project's files.
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
    """Return `key = value`, with the key in quotes if it is not a bare key."""
    return f"{key if _BARE_KEY.fullmatch(key) else toml_value(key)} = {toml_value(value)}"


def parse_json(text: str) -> Any:
    """Return the value of a JSON text from a recording. Raises ValueError with the reason."""
    try:
        value = json.loads(text)
    except RecursionError as error:
        raise ValueError(_TOO_DEEP) from error
    for problem in _problems(value):
        raise ValueError(problem)
    return value


def format_value(value: object) -> str:
    """Return a value formatted for a message: a number with at most nine digits; any other value, truncated if it
    is long.
    """
    text = (
        f"{value:.9g}" if isinstance(value, float) and len(repr(value)) > NUMBER_CHARACTERS else repr(value)
    )
    return text if len(text) <= SHOWN_CHARACTERS else f"{text[:SHOWN_CHARACTERS]}…"


def format_path(path: Path) -> str:
    """Return a path formatted for a message, on one line."""
    text = str(path)
    return text if text.isprintable() else repr(text)


def harmless(text: str) -> str:
    """Return a text from a device or a plug-in with its control characters escaped as in Python. Line ends and tabs
    are kept.
    """
    if text.isprintable():
        return text
    return "".join(sign if sign.isprintable() or sign in "\n\t" else repr(sign)[1:-1] for sign in text)


_TWICE = re.compile(r"Cannot declare \((.+)\) twice (\(at line \d+, column \d+\))")
_TOO_DEEP = f"tables and arrays are nested more than {DEPTH_LIMIT} levels deep"


def _problems(value: object) -> Iterator[str]:
    """Yield descriptions of unsupported properties of the values, without recursion."""
    waiting: list[tuple[str, int, object]] = [("", 0, value)]
    while waiting:
        key, depth, item = waiting.pop()
        match item:
            case dict() | list() if depth >= DEPTH_LIMIT:
                yield _TOO_DEEP
            case dict():
                for name, child in item.items():
                    if not name.isprintable():
                        yield f"the key {format_value(name)} contains a non-printable character"
                    waiting.append((f"{key}.{name}" if key else name, depth + 1, child))
            case list():
                waiting += ((key, depth + 1, child) for child in item)
            case str() if "\0" in item:
                yield f"{_cut(key)}: a string must not contain a NUL character, got {format_value(item)}"
            case int() if not -INTEGER_LIMIT <= item < INTEGER_LIMIT:
                yield f"{_cut(key)}: an integer must fit into 64 bits"


def _cut(key: str) -> str:
    return key if len(key) <= SHOWN_CHARACTERS else f"{key[:SHOWN_CHARACTERS]}…"
