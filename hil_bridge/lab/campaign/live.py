"""The results of a campaign that goes on, for its page in the browser: counts, cases, and the newest and worst runs."""

from collections import Counter, deque
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

from hil_bridge.errors import ConfigError
from hil_bridge.lab.campaign.store import Done, Store

NEWEST, WORST = 100, 100
"""Runs that the page lists. Chosen: a person reads no more."""
AT_ONCE = 2000
"""Runs that are read at one look. Chosen: a hundredth of a second."""
LOOK_EVERY = 10
"""Pictures of a page between two looks at the file: half a second."""


@dataclass(slots=True)
class Seen:
    """The state of one page: the version that it shows."""

    version: int = -1
    waits: int = 0


class Results:
    """Tells pages of a campaign's results, which another process may be writing."""

    over = False
    """The file is there until the server is ended."""

    def __init__(self, store: Store) -> None:
        self._store = store
        self._plan = store.plan()
        self._row = 0
        self._version = 0
        self._passed = self._failed = 0
        self._cases: Counter[tuple[int, bool]] = Counter()
        self._newest: deque[dict[str, Any]] = deque(maxlen=NEWEST)
        self._worst: list[tuple[float, int, dict[str, Any]]] = []
        self._trouble = ""

    def first(self) -> Seen:
        """A page that knows nothing."""
        return Seen()

    def asked(self, state: Any, message: Mapping[str, Any]) -> None:
        """A page of results asks for nothing."""
        raise ValueError("a page of results asks for nothing")

    def news(self, state: Any) -> Mapping[str, Any] | None:
        """The whole state, when it has changed."""
        state.waits = (state.waits + 1) % LOOK_EVERY
        if state.waits == 1:
            self._look()
        if state.version == self._version:
            return None
        state.version = self._version
        return self._values()

    def _look(self) -> None:
        try:
            rows = self._store.newer(self._row, AT_ONCE)
            if rows:
                self._plan = replace(self._plan, seeds=self._store.seeds())
            self._trouble = ""
        except ConfigError as error:
            self._trouble, rows = str(error), []
            self._version += 1
        for row, done in rows:
            self._row = row
            self._take(done)
        self._version += bool(rows) or not self._version

    def _take(self, done: Done) -> None:
        self._passed += done.passed
        self._failed += not done.passed
        self._cases[done.number, done.passed] += 1
        row = self._row_of(done)
        self._newest.append(row)
        if not done.passed:
            force = done.figures.get("force_true_max_n")
            rank = len(done.failed) * 1e6 + (force if isinstance(force, (int, float)) else 0.0)
            self._worst.append((-rank, self._row, row))
            self._worst = sorted(self._worst, key=lambda one: one[:2])[:WORST]

    def _row_of(self, done: Done) -> dict[str, Any]:
        case = self._plan.cases[done.number]
        force = done.figures.get("force_true_max_n")
        return {
            "key": done.key,
            "seed": done.seed,
            "cell": case.cell,
            "fault": f"{case.fault} {case.phase}".strip(),
            "outcome": done.outcome,
            "passed": done.passed,
            "failed": "; ".join(done.failed),
            "cause": done.cause[:300],
            "force": force if isinstance(force, (int, float)) else None,
            "wall_s": done.wall_s,
        }

    def _values(self) -> dict[str, Any]:
        cases = [
            {
                "cell": case.cell,
                "fault": f"{case.fault} {case.phase}".strip(),
                "passed": self._cases[number, True],
                "failed": self._cases[number, False],
            }
            for number, case in enumerate(self._plan.cases)
            if self._cases[number, True] or self._cases[number, False]
        ]
        cases.sort(key=lambda case: (-case["failed"], case["cell"], case["fault"]))  # type: ignore[operator]
        return {
            "name": self._plan.name,
            "file": str(self._store.path),
            "count": self._plan.count,
            "passed": self._passed,
            "failed": self._failed,
            "trouble": self._trouble,
            "cases": cases[:500],
            "newest": list(self._newest)[::-1],
            "worst": [row for _, _, row in self._worst],
        }
