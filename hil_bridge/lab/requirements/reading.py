"""A list of requirements as CSV, and results of tests as JUnit XML. Neither is trusted."""

import csv
import hashlib
import io
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

from hil_bridge.errors import ConfigError
from hil_bridge.lab.junit import RECORDING, REQUIREMENT
from hil_bridge.lab.requirements.matrix import Requirement, State, Tried

_LARGEST = 64 * 2**20
"""Chosen: a larger file is no list and no result, bytes."""
_ENDS = {"failure": State.FAILED, "error": State.FAILED, "skipped": State.SKIPPED}


def _content(path: Path) -> bytes:
    try:
        with path.open("rb") as file:
            data = file.read(_LARGEST + 1)
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read: {error.strerror}") from error
    if len(data) > _LARGEST:
        raise ConfigError(f"{path}: is larger than {_LARGEST // 2**20} MB; name a smaller file")
    return data


def read_digests(paths: Iterable[Path]) -> Iterator[tuple[str, str]]:
    """Name of each file, and the SHA-256 of its content. Raises ConfigError for a file that cannot be read."""
    for path in paths:
        yield path.name, hashlib.sha256(_content(path)).hexdigest()


def read_requirements(path: Path) -> list[Requirement]:
    """The requirements of a CSV file with the columns `id` and `text`; other columns are left out.

    Raises ConfigError for a file that is no such list, or names one twice.
    """
    try:
        text = _content(path).decode("utf-8-sig")
        rows = csv.DictReader(io.StringIO(text, newline=""), strict=True)
        titles = [title.strip().lower() for title in rows.fieldnames or ()]
        if not {"id", "text"} <= set(titles):
            raise ConfigError(f"{path}: needs the columns id and text in its first line")
        rows.fieldnames = titles
        found: dict[str, Requirement] = {}
        for row in rows:
            name, words = (row["id"] or "").strip(), (row["text"] or "").strip()
            if not name:
                raise ConfigError(f"{path}, line {rows.line_num}: a requirement needs an id")
            if name in found:
                raise ConfigError(f"{path}, line {rows.line_num}: {name} is there twice")
            found[name] = Requirement(name, words)
    except (UnicodeDecodeError, csv.Error) as error:
        raise ConfigError(f"{path}: is no CSV file in UTF-8: {error}") from error
    if not found:
        raise ConfigError(f"{path}: has no requirement below its first line")
    return list(found.values())


def read_tests(path: Path) -> list[Tried]:
    """The tests of a JUnit file. Raises ConfigError for a file that is none."""
    data = _content(path)
    if b"<!DOCTYPE" in data or b"<!ENTITY" in data:
        raise ConfigError(f"{path}: declares a document type, which no JUnit file needs; remove it")
    try:
        root = ElementTree.fromstring(data)
    except (ElementTree.ParseError, ValueError, LookupError) as error:
        raise ConfigError(f"{path}: is no XML: {error}") from error
    if root.tag not in ("testsuites", "testsuite"):
        raise ConfigError(f"{path}: is no JUnit file: it begins with <{root.tag[:40]}>")
    return [_test(case) for case in root.iter("testcase")]


def _test(case: Any) -> Tried:
    state, reason = State.PASSED, ""
    for part in case:
        if part.tag in _ENDS and state is not State.FAILED:
            state, reason = _ENDS[part.tag], part.get("message") or (part.text or "").strip()
    name = ".".join(filter(None, (case.get("classname"), case.get("name")))) or "a test without a name"
    given = list(_properties(case))
    return Tried(
        name,
        state,
        " ".join(reason.split()),
        tuple(value for key, value in given if key == REQUIREMENT),
        tuple(value for key, value in given if key == RECORDING),
    )


def _properties(case: Any) -> Iterator[tuple[str, str]]:
    for one in case.iterfind("properties/property"):
        value = one.get("value")
        yield one.get("name") or "", ((one.text or "") if value is None else value).strip()
