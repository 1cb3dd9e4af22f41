"""The matrix: each requirement with the tests that show it, their verdicts and recordings."""

from collections.abc import Iterable, Sequence
from enum import StrEnum
from typing import NamedTuple


class State(StrEnum):
    """Verdict of a test, and of a requirement."""

    PASSED = "passed"
    FAILED = "failed"
    SKIPPED = "skipped"
    """The test was not run."""
    NO_TEST = "no test"
    """No test names the requirement."""


class Requirement(NamedTuple):
    """A thing that has to be shown."""

    name: str
    """Such as R-12; unique in a list."""
    text: str


class Tried(NamedTuple):
    """A test with its verdict, as a JUnit file tells it."""

    name: str
    state: State
    reason: str
    """Words of a failure, or of a skip; empty for one that passed."""
    requirements: tuple[str, ...]
    recordings: tuple[str, ...]
    """Files of its runs, where they were kept."""


class Row(NamedTuple):
    """A requirement and its tests."""

    requirement: Requirement
    tests: tuple[Tried, ...]

    @property
    def state(self) -> State:
        """Failed where a test failed; passed only where one passed."""
        states = {test.state for test in self.tests}
        order = (State.FAILED, State.PASSED, State.SKIPPED)
        return next((state for state in order if state in states), State.NO_TEST)


class Matrix(NamedTuple):
    """All requirements of a list, and tests whose requirements are not in it."""

    rows: tuple[Row, ...]
    strangers: tuple[tuple[str, Tried], ...]
    """Names that the list does not have, each with a test that names it."""

    @property
    def shown(self) -> bool:
        """Whether each requirement has passed, and the list has each name."""
        return not self.strangers and all(row.state is State.PASSED for row in self.rows)

    def count(self, state: State) -> int:
        """Requirements in this state."""
        return sum(row.state is state for row in self.rows)


def matrix_of(requirements: Sequence[Requirement], tests: Iterable[Tried]) -> Matrix:
    """The matrix of a list and of tests. A test that names none of them is left out."""
    by_name: dict[str, list[Tried]] = {one.name: [] for one in requirements}
    strangers = []
    for test in tests:
        for name in dict.fromkeys(test.requirements):
            if name in by_name:
                by_name[name].append(test)
            else:
                strangers.append((name, test))
    return Matrix(tuple(Row(one, tuple(by_name[one.name])) for one in requirements), tuple(strangers))
