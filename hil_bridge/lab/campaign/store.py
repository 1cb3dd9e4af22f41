"""Results of a campaign in one SQLite file, which can be read while it is being written."""

import json
import re
import sqlite3
import time
from collections.abc import Iterable, Iterator, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass, fields
from pathlib import Path
from platform import platform, python_version
from socket import gethostname
from types import TracebackType
from typing import Any, Self, TypeVar

import msgspec

from hil_bridge.errors import ConfigError
from hil_bridge.errors.text_files import format_path, refuse_other_kinds
from hil_bridge.lab.campaign.criteria import Criterion, Figures
from hil_bridge.lab.campaign.drawing import Draw
from hil_bridge.lab.campaign.plan import Case, Plan, PrimaryFigure

FORMAT = "hil-bridge campaign 2"
"""Format identifier of the results file."""
BUSY_S = 30.0
"""Timeout while another process writes to the file, s. Chosen."""
READ_BUSY_S = 5.0
"""Timeout while another process writes to the file, s, if the results are only read. Chosen: a writer locks the
file for milliseconds.
"""
RESULTS_LIMIT_BYTES = 1 << 32
"""Largest results file that is read, bytes. Chosen: some million runs."""
VALUE_LIMIT_BYTES = 1 << 24
"""Largest size of one value in the file, bytes. Chosen: a thousand times the configuration of a case."""
FAILED_SUFFIX = "-failed"
"""Suffix that turns the name of the results file into the name of the folder with the recordings of failed runs."""

_COMPUTES = re.compile(r"\b(VIRTUAL|AS)\b", re.IGNORECASE)
Row = TypeVar("Row")

_SCHEMA = """
CREATE TABLE facts (name TEXT PRIMARY KEY, value TEXT NOT NULL);
CREATE TABLE cases (
    number INTEGER PRIMARY KEY, cell TEXT NOT NULL, head TEXT NOT NULL, fault TEXT NOT NULL, phase TEXT NOT NULL,
    config TEXT NOT NULL, fault_table TEXT NOT NULL, impossible TEXT NOT NULL);
CREATE TABLE runs (
    key TEXT PRIMARY KEY, number INTEGER NOT NULL REFERENCES cases (number),
    config_hash TEXT NOT NULL, code TEXT NOT NULL, fault TEXT NOT NULL, phase TEXT NOT NULL, seed INTEGER NOT NULL,
    outcome TEXT NOT NULL, cause TEXT NOT NULL, passed INTEGER NOT NULL, failed TEXT NOT NULL,
    figures TEXT NOT NULL, wall_s REAL NOT NULL, recording TEXT NOT NULL,
    UNIQUE (config_hash, code, fault, phase, seed));
CREATE TABLE sittings (began TEXT NOT NULL, wall_s REAL NOT NULL, runs INTEGER NOT NULL, workers INTEGER NOT NULL);
"""


@dataclass(frozen=True, slots=True)
class Done:
    """Result of an executed run."""

    key: str
    number: int
    """Index of the case in the plan."""
    seed: int
    outcome: str
    cause: str
    failed: tuple[str, ...]
    """Criteria that the run did not meet."""
    figures: Figures
    wall_s: float
    """Computing time of the run, s."""
    recording: str
    """File name of the run's recording; empty if there is none."""
    table: str = "{}"
    """Overlay of the case's configuration, as JSON: the fault of the case, or all drawn settings and faults."""

    @property
    def passed(self) -> bool:
        """Whether the run met every applicable criterion."""
        return not self.failed


@dataclass(frozen=True, slots=True)
class Sitting:
    """One session of the campaign, from its start until it completed or was interrupted."""

    began: str
    wall_s: float
    runs: int
    workers: int


class Store:
    """Results file of a campaign. Use an instance as a context manager."""

    def __init__(self, path: Path, connection: sqlite3.Connection) -> None:
        self.path = path
        self._connection = connection

    @classmethod
    def begin(cls, path: Path, plan: Plan) -> Self:
        """Create the results file of this plan, or open it to resume. Raises ConfigError if the file has other
        contents.
        """
        connection = _connect(path, "rwc")
        store = cls(path, connection)
        try:
            if connection.execute("SELECT count(*) FROM sqlite_master").fetchone()[0]:
                store._check(plan)
            else:
                store._create(plan)
            # Earlier seeds remain, even if the plan has fewer this time.
            seeds = dict.fromkeys((*store.seeds(), *plan.seeds))
            hosts = dict.fromkeys((*store.hosts(), gethostname()))
            # The plan of a resumed campaign may have other requirements and primary figures: they change no run.
            facts = {
                "seeds": [*seeds],
                "hosts": [*hosts],
                "requirements": plan.requirements,
                "primary": plan.primary,
                "axes": plan.axes,
            }
            rows = [(name, msgspec.json.encode(value).decode()) for name, value in facts.items()]
            connection.executemany("INSERT OR REPLACE INTO facts VALUES (?, ?)", rows)
            connection.commit()
        except sqlite3.Error as error:
            connection.close()
            raise ConfigError(
                f"cannot write results to {path}: {error}; give another file with --output"
            ) from error
        except BaseException:
            connection.close()
            raise
        return store

    @classmethod
    def open(cls, path: Path) -> Self:
        """Open an existing results file for reading. Raises ConfigError."""
        if path.is_dir():
            raise ConfigError(f"{path} is a folder; give a results file in it")
        if not path.is_file():
            raise ConfigError(f"no such file {path}; create one with `hil-bridge campaign FILE.toml`")
        if (size := path.stat().st_size) > RESULTS_LIMIT_BYTES:
            raise ConfigError(f"{path} has {size} bytes; at most {RESULTS_LIMIT_BYTES} are allowed")
        store = cls(path, _connect(path, "rw", READ_BUSY_S))
        try:
            store._check_format()
        except BaseException:
            store.close()
            raise
        return store

    def _create(self, plan: Plan) -> None:
        self._connection.execute("PRAGMA journal_mode = WAL")
        facts = {
            "format": FORMAT,
            "name": plan.name,
            "identity": plan.identity,
            "code": plan.code,
            "begun": now(),
            "platform": f"Python {python_version()}, {platform()}",
            "seeds": json.dumps(plan.seeds),
            "cases_per_seed": str(plan.cases_per_seed),
            "draw": "" if plan.draw is None else plan.draw.text,
            "criteria": json.dumps([[item.figure, item.allowed] for item in plan.criteria]),
        }
        rows = [
            (number, case.cell, case.head, case.fault, case.phase, case.config, case.table, case.impossible)
            for number, case in enumerate(plan.cases)
        ]
        # One transaction: a process that is killed here leaves an empty file, not half a plan.
        self._connection.executescript("BEGIN IMMEDIATE;" + _SCHEMA)
        self._connection.executemany("INSERT INTO facts VALUES (?, ?)", facts.items())
        self._connection.executemany("INSERT INTO cases VALUES (?, ?, ?, ?, ?, ?, ?, ?)", rows)
        self._connection.commit()

    def _check_format(self) -> None:
        try:
            file_format = "" if self._holds_programs() else self.fact("format")
        except sqlite3.Error:
            file_format = ""
        if file_format and file_format != FORMAT:
            raise ConfigError(
                f"{self.path} has the format {file_format!r} of another version, and this one reads {FORMAT!r}; "
                "read it with the version that wrote it, or run the campaign again"
            )
        if file_format != FORMAT:
            raise ConfigError(f"{self.path} is not a results file of a campaign; give another file")

    def _holds_programs(self) -> bool:
        """Return whether reading the file would execute code: a view, a trigger or a generated column.

        Such code might never end, and no results file of hil-bridge contains any.
        """
        rows = self._connection.execute("SELECT type, coalesce(sql, '') FROM sqlite_master").fetchall()
        return any(kind not in ("table", "index") or _COMPUTES.search(sql) for kind, sql in rows)

    def _check(self, plan: Plan) -> None:
        self._check_format()
        for name, mine, what in (
            ("identity", plan.identity, "another plan, with other matrix, faults, settings or criteria"),
            ("code", plan.code, "results of another version of the code, or of a plug-in"),
        ):
            if self.fact(name) != mine:
                raise ConfigError(f"{self.path} contains {what}; give a new file with --output")

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()
        if isinstance(error, (sqlite3.Error, json.JSONDecodeError)):  # a full disk, a damaged file
            raise ConfigError(f"cannot use the results in {self.path}: {error}") from error

    def close(self) -> None:
        """Close the file. Idempotent."""
        self._connection.close()

    @property
    def folder(self) -> Path:
        """Folder of the recordings of failed runs."""
        return self.path.with_name(self.path.stem + FAILED_SUFFIX)

    def fact(self, name: str) -> str:
        """Return a fact of the campaign; empty if it is unknown."""
        row = self._connection.execute("SELECT value FROM facts WHERE name = ?", (name,)).fetchone()
        return str(row[0]) if row else ""

    def keep(self, name: str, value: str) -> None:
        """Store a fact of the campaign, replacing an earlier fact of this name."""
        with self._connection:
            self._connection.execute("INSERT OR REPLACE INTO facts VALUES (?, ?)", (name, value))

    def put(self, done: Sequence[Done], cases: Sequence[Case]) -> None:
        """Store runs, either all or none of them. A run that is already stored is left unchanged."""
        code = self.fact("code")
        rows = [
            (
                run.key, run.number, cases[run.number].config_hash, code, run.table,
                cases[run.number].phase, run.seed, run.outcome, run.cause, run.passed,
                json.dumps(run.failed), _json(run.figures), run.wall_s, run.recording,
            )
            for run in done
        ]  # fmt: skip
        marks = ", ".join("?" * 14)
        with self._connection:
            self._connection.executemany(f"INSERT OR IGNORE INTO runs VALUES ({marks})", rows)

    def add_sitting(self, began: str, wall_s: float, runs: int, workers: int) -> None:
        """Store the duration of a session."""
        with self._connection:
            self._connection.execute(
                "INSERT INTO sittings VALUES (?, ?, ?, ?)", (began, wall_s, runs, workers)
            )

    def keys(self) -> set[str]:
        """Return the keys of all stored runs."""
        return {key for (key,) in self._connection.execute("SELECT key FROM runs")}

    def plan(self) -> Plan:
        """Return the checked plan of the campaign. Raises ConfigError."""
        query = "SELECT cell, head, fault, phase, config, fault_table, impossible FROM cases ORDER BY number"
        with self._readable():
            cases = tuple(_as(Case, row) for row in self._connection.execute(query))
            if not cases:
                raise ValueError("no cases")
            for text in {case.config for case in cases}:
                msgspec.json.decode(text, type=_Cell)
            for text in {case.table for case in cases}:
                msgspec.json.decode(text, type=dict[str, Any])
            criteria = tuple(
                Criterion(figure, allowed) for figure, allowed in json.loads(self.fact("criteria"))
            )
            if (share := int(self.fact("cases_per_seed") or 0)) < 0:
                raise ValueError(f"{share} cases for each seed")
            draw = Draw.read(text) if (text := self.fact("draw")) else None
            required = msgspec.json.decode(self.fact("requirements") or "[]", type=tuple[str, ...])
            primary = msgspec.json.decode(self.fact("primary") or "[]", type=tuple[PrimaryFigure, ...])
            axes = msgspec.json.decode(self.fact("axes") or "[]", type=tuple[tuple[str, ...], ...])
            return Plan(
                self.fact("name"), self.seeds(), cases, criteria, share, draw, required, primary, axes
            )

    def seeds(self) -> tuple[int, ...]:
        """Return the current seeds of the campaign, to which a later session may add seeds. Raises ConfigError."""
        with self._readable():
            return tuple(map(int, json.loads(self.fact("seeds"))))

    def hosts(self) -> tuple[str, ...]:
        """Return the names of the computers on which the campaign was started; empty for older results. Raises
        ConfigError.
        """
        with self._readable():
            return msgspec.json.decode(self.fact("hosts") or "[]", type=tuple[str, ...])

    def runs(self, where: str = "1", values: Iterable[object] = ()) -> Iterator[Done]:
        """Yield the stored runs, by case and seed. Raises ConfigError."""
        columns = "key, number, seed, outcome, cause, failed, figures, wall_s, recording, fault"
        with self._readable():
            cases = self._connection.execute("SELECT count(*) FROM cases").fetchone()[0]
            query = f"SELECT {columns} FROM runs WHERE {where} ORDER BY number, seed"
            for row in self._connection.execute(query, tuple(values)):
                columns_of_run = list(row)
                columns_of_run[5:7] = map(json.loads, columns_of_run[5:7])
                done = _as(Done, columns_of_run)
                if not 0 <= done.number < cases:
                    raise ValueError(f"run {done.key} has case {done.number}, but there are only {cases}")
                yield done

    def copy(self, path: Path) -> None:
        """Copy all results to a new, self-contained file. Raises ConfigError."""
        with self._readable(), closing(sqlite3.connect(path)) as target:
            self._connection.backup(target)
            target.execute("PRAGMA journal_mode = DELETE")

    def version(self) -> int:
        """Return a number that changes whenever another process changes the file. Raises ConfigError."""
        with self._readable():
            return int(self._connection.execute("PRAGMA data_version").fetchone()[0])

    def sittings(self) -> list[Sitting]:
        """Return every session so far that completed or was interrupted. Raises ConfigError."""
        with self._readable():
            rows = self._connection.execute("SELECT * FROM sittings ORDER BY began")
            return [_as(Sitting, row) for row in rows]

    @contextmanager
    def _readable(self) -> Iterator[None]:
        """Convert every error from the file to a ConfigError, since another program may have written the file."""
        try:
            yield
        except (sqlite3.Error, msgspec.MsgspecError, ValueError, TypeError, RecursionError) as error:
            raise ConfigError(f"cannot read {self.path}: {error}") from error


class _Chosen(msgspec.Struct):
    emulated: str


class _Cell(msgspec.Struct):
    """Parts of a case's configuration that the results page reads."""

    robot: _Chosen
    sensor: _Chosen
    cell: dict[str, Any]


def _as(kind: type[Row], values: Iterable[object]) -> Row:
    """Convert a row to a dataclass, and check the types of its fields. Raises msgspec.ValidationError."""
    names = [field.name for field in fields(kind)]  # type: ignore[arg-type]
    return msgspec.convert(dict(zip(names, values, strict=True)), kind)


def _json(figures: Figures) -> str:
    """Encode figures as JSON. Infinity is encoded as a number that is read back as infinity."""
    return json.dumps(figures).replace("Infinity", "1e999")


def now() -> str:
    """Return the current time in UTC, as text."""
    return time.strftime("%Y-%m-%d %H:%M:%S", time.gmtime())


def _connect(path: Path, mode: str, patience_s: float = BUSY_S) -> sqlite3.Connection:
    try:
        if path.exists():
            refuse_other_kinds(path.stat().st_mode, format_path(path))
        connection = sqlite3.connect(f"{path.resolve().as_uri()}?mode={mode}", timeout=patience_s, uri=True)
        connection.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, VALUE_LIMIT_BYTES)
    except (OSError, sqlite3.Error) as error:
        raise ConfigError(f"cannot open {path}: {error}") from error
    return connection
