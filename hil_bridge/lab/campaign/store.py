"""The results of a campaign: one SQLite file, which may be read while it is written."""

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
from hil_bridge.lab.campaign.plan import Case, Plan, code_version

FORMAT = "hil-bridge campaign 2"
"""Format of the file, for a later version that reads it."""
BUSY_S = 30.0
"""Chosen: how long is waited for another process that writes."""
READ_BUSY_S = 5.0
"""Chosen: the same where results are only read. A writer holds the file for milliseconds."""
RESULTS_LIMIT_BYTES = 1 << 32
"""Longest file of results that is read. Chosen: some million runs."""
VALUE_LIMIT_BYTES = 1 << 24
"""Longest text in it. Chosen: the configuration of a case is 1000 times shorter."""
FAILED_SUFFIX = "-failed"
"""Recordings of failing runs lie in a folder of the file's name with this."""

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
    """A run that has ended."""

    key: str
    number: int
    """Number of its case."""
    seed: int
    outcome: str
    cause: str
    failed: tuple[str, ...]
    """Criteria that it did not meet."""
    figures: Figures
    wall_s: float
    """Time that it took on its core, s."""
    recording: str
    """File name of its recording; empty where none was left."""
    table: str = "{}"
    """The values laid over the configuration of its case, as JSON: its fault, or all that was drawn."""

    @property
    def passed(self) -> bool:
        """It met every criterion that concerns it."""
        return not self.failed


@dataclass(frozen=True, slots=True)
class Sitting:
    """One start of the campaign, until it ended or was interrupted."""

    began: str
    wall_s: float
    runs: int
    workers: int


class Store:
    """The file of a campaign. Use it as a context."""

    def __init__(self, path: Path, connection: sqlite3.Connection) -> None:
        self.path = path
        self._connection = connection

    @classmethod
    def begin(cls, path: Path, plan: Plan) -> Self:
        """The file of this plan: a new one, or one that was begun. Raises ConfigError for every other file."""
        connection = _connect(path, "rwc")
        store = cls(path, connection)
        try:
            if connection.execute("SELECT count(*) FROM sqlite_master").fetchone()[0]:
                store._check(plan)
            else:
                store._create(plan)
            # Seeds that were run before stay: fewer of them this time take nothing away.
            seeds = dict.fromkeys((*store.seeds(), *plan.seeds))
            connection.execute("UPDATE facts SET value = ? WHERE name = 'seeds'", (json.dumps([*seeds]),))
            hosts = dict.fromkeys((*store.hosts(), gethostname()))
            connection.execute("INSERT OR REPLACE INTO facts VALUES ('hosts', ?)", (json.dumps([*hosts]),))
            connection.commit()
        except sqlite3.Error as error:
            connection.close()
            raise ConfigError(
                f"cannot keep results in {path}: {error}; name another file with --output"
            ) from error
        except BaseException:
            connection.close()
            raise
        return store

    @classmethod
    def open(cls, path: Path) -> Self:
        """A file that is there, to be read. Raises ConfigError."""
        if path.is_dir():
            raise ConfigError(f"{path} is a folder; name a file of results in it")
        if not path.is_file():
            raise ConfigError(f"there is no file {path}; `hil-bridge campaign FILE.toml` makes one")
        if (size := path.stat().st_size) > RESULTS_LIMIT_BYTES:
            raise ConfigError(f"{path} has {size} bytes, of which at most {RESULTS_LIMIT_BYTES} are read")
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
            "code": code_version(),
            "begun": now(),
            "platform": f"Python {python_version()}, {platform()}",
            "seeds": json.dumps(plan.seeds),
            "cases_per_seed": str(plan.cases_per_seed),
            "draw": "" if plan.draw is None else plan.draw.text,
            "criteria": json.dumps([[item.figure, item.wanted] for item in plan.criteria]),
            "requirements": json.dumps(plan.requirements),
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
            told = "" if self._holds_programs() else self.fact("format")
        except sqlite3.Error:
            told = ""
        if told and told != FORMAT:
            raise ConfigError(
                f"{self.path} has results in the form {told!r} of another version, and this one reads {FORMAT!r}; "
                "read it with the version that wrote it, or run the campaign anew"
            )
        if told != FORMAT:
            raise ConfigError(f"{self.path} holds no results of a campaign; name another file")

    def _holds_programs(self) -> bool:
        """Whether the file holds what computes by itself when it is read: a view, a trigger, a made column. It could
        go on for ever, and no file of ours has any.
        """
        rows = self._connection.execute("SELECT type, coalesce(sql, '') FROM sqlite_master").fetchall()
        return any(kind not in ("table", "index") or _COMPUTES.search(sql) for kind, sql in rows)

    def _check(self, plan: Plan) -> None:
        self._check_format()
        for name, mine, what in (
            ("identity", plan.identity, "another plan: its matrix, faults, settings or criteria differ"),
            ("code", code_version(), "results of another version of the code"),
        ):
            if self.fact(name) != mine:
                raise ConfigError(f"{self.path} holds {what}; name a new file with --output")

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()
        if isinstance(error, (sqlite3.Error, json.JSONDecodeError)):  # a full disk, a damaged file
            raise ConfigError(f"cannot use the results in {self.path}: {error}") from error

    def close(self) -> None:
        """Close the file. Harmless when called again."""
        self._connection.close()

    @property
    def folder(self) -> Path:
        """Recordings of failing runs."""
        return self.path.with_name(self.path.stem + FAILED_SUFFIX)

    def fact(self, name: str) -> str:
        """A fact of the campaign; empty where it is not told."""
        row = self._connection.execute("SELECT value FROM facts WHERE name = ?", (name,)).fetchone()
        return str(row[0]) if row else ""

    def keep(self, name: str, value: str) -> None:
        """Keep a fact; it replaces an earlier one of this name."""
        with self._connection:
            self._connection.execute("INSERT OR REPLACE INTO facts VALUES (?, ?)", (name, value))

    def put(self, done: Sequence[Done], cases: Sequence[Case]) -> None:
        """Keep runs, all or none of them; one that is kept already stays as it is."""
        code = code_version()
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

    def sat(self, began: str, wall_s: float, runs: int, workers: int) -> None:
        """Keep how long this start took."""
        with self._connection:
            self._connection.execute(
                "INSERT INTO sittings VALUES (?, ?, ?, ?)", (began, wall_s, runs, workers)
            )

    def keys(self) -> set[str]:
        """Keys of all runs that are kept."""
        return {key for (key,) in self._connection.execute("SELECT key FROM runs")}

    def plan(self) -> Plan:
        """The campaign as it was checked. Raises ConfigError."""
        query = "SELECT cell, head, fault, phase, config, fault_table, impossible FROM cases ORDER BY number"
        with self._readable():
            cases = tuple(_as(Case, row) for row in self._connection.execute(query))
            for text in {case.config for case in cases}:
                msgspec.json.decode(text, type=_Cell)
            for text in {case.table for case in cases}:
                msgspec.json.decode(text, type=dict[str, Any])
            criteria = tuple(
                Criterion(figure, wanted) for figure, wanted in json.loads(self.fact("criteria"))
            )
            if (share := int(self.fact("cases_per_seed") or 0)) < 0:
                raise ValueError(f"{share} cases for each seed")
            draw = Draw.read(text) if (text := self.fact("draw")) else None
            required = msgspec.json.decode(self.fact("requirements") or "[]", type=tuple[str, ...])
            return Plan(self.fact("name"), self.seeds(), cases, criteria, share, draw, required)

    def seeds(self) -> tuple[int, ...]:
        """Seeds that the campaign has now; a later start may add some. Raises ConfigError."""
        with self._readable():
            return tuple(map(int, json.loads(self.fact("seeds"))))

    def hosts(self) -> tuple[str, ...]:
        """Names of the computers on which it was started; empty in older results. Raises ConfigError."""
        with self._readable():
            return msgspec.json.decode(self.fact("hosts") or "[]", type=tuple[str, ...])

    def runs(self, where: str = "1", values: Iterable[object] = ()) -> Iterator[Done]:
        """Runs that are kept, by case and seed. Raises ConfigError."""
        columns = "key, number, seed, outcome, cause, failed, figures, wall_s, recording, fault"
        with self._readable():
            cases = self._connection.execute("SELECT count(*) FROM cases").fetchone()[0]
            query = f"SELECT {columns} FROM runs WHERE {where} ORDER BY number, seed"
            for row in self._connection.execute(query, tuple(values)):
                found = list(row)
                found[5:7] = map(json.loads, found[5:7])
                done = _as(Done, found)
                if not 0 <= done.number < cases:
                    raise ValueError(f"run {done.key} is of case {done.number}, and there are {cases}")
                yield done

    def copy(self, path: Path) -> None:
        """Write all of it into one new file, which needs no other beside it. Raises ConfigError."""
        with self._readable(), closing(sqlite3.connect(path)) as target:
            self._connection.backup(target)
            target.execute("PRAGMA journal_mode = DELETE")

    def version(self) -> int:
        """Another number whenever another process has changed the file. Raises ConfigError."""
        with self._readable():
            return int(self._connection.execute("PRAGMA data_version").fetchone()[0])

    def sittings(self) -> list[Sitting]:
        """Every start so far that came to its end, or was interrupted. Raises ConfigError."""
        with self._readable():
            rows = self._connection.execute("SELECT * FROM sittings ORDER BY began")
            return [_as(Sitting, row) for row in rows]

    @contextmanager
    def _readable(self) -> Iterator[None]:
        """Turn every fault of the file into a ConfigError: another program may have written it."""
        try:
            yield
        except (sqlite3.Error, msgspec.MsgspecError, ValueError, TypeError, RecursionError) as error:
            raise ConfigError(f"cannot read {self.path}: {error}") from error


class _Chosen(msgspec.Struct):
    emulated: str


class _Cell(msgspec.Struct):
    """The parts of a case's configuration that the page reads."""

    robot: _Chosen
    sensor: _Chosen
    cell: dict[str, Any]


def _as(kind: type[Row], values: Iterable[object]) -> Row:
    """A row as a plain value of this kind, each part of the declared type. Raises msgspec.ValidationError."""
    names = [field.name for field in fields(kind)]  # type: ignore[arg-type]
    return msgspec.convert(dict(zip(names, values, strict=True)), kind)


def _json(figures: Figures) -> str:
    """JSON has no infinity, but a number that is read as one."""
    return json.dumps(figures).replace("Infinity", "1e999")


def now() -> str:
    """The present time for people, UTC."""
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
