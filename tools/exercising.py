"""Pytest plug-in that records what the tests actually exercise.

`python -m pytest -p tools.exercising --exercised FILE` writes which causes ended or held a run, which injected
faults had an effect, and which promises and criteria were missed, each with the first test that did it.
`tools.exercised` reads the file. Every run in a test process is observed; runs in other processes are not. Each run
is also checked against the model of the guard.
"""

import json
import sys
from collections.abc import Callable, Iterator, Mapping
from functools import wraps
from pathlib import Path
from typing import Any

import pytest

from hil_bridge.control import Clamp, ControlLoop, Stop, Supervisor
from hil_bridge.control.course.touch import TouchTest
from hil_bridge.control.decision import Decision
from hil_bridge.control.program.program import Program
from hil_bridge.control.program.state import ProgramState
from hil_bridge.errors import BridgeError, Reason
from hil_bridge.lab.campaign.criteria import Criterion
from hil_bridge.lab.campaign.fault_effects import causes_of, struck_faults
from hil_bridge.lab.campaign.plan import code_version
from hil_bridge.lab.invariants import CHECKERS, Evidence, Promise, Violation
from hil_bridge.lab.invariants.model import GuardModel
from hil_bridge.lab.invariants.tracing import first_unaccepted
from hil_bridge.record import CycleRecord, EventRecord, Recording
from hil_bridge.runs.running import Running
from hil_bridge.runs.watchers import Listener

GROUPS = ("causes", "faults", "promises", "criteria", "unaccepted")


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--exercised", metavar="FILE", help="file for the evidence of the tests")


def pytest_configure(config: pytest.Config) -> None:
    config.pluginmanager.register(Exercising(config), "what tests strike")


class _Watched(Listener):
    """Run under observation: its cycles and events, as in a recording."""

    def __init__(self, running: Running) -> None:
        self.cycles: list[CycleRecord] = []
        self.events: list[EventRecord] = []
        self.end: Mapping[str, str] | None = None
        self.running = running
        super().__init__({CycleRecord: self.cycles.append, EventRecord: self.events.append})

    def close(self, end: Mapping[str, str]) -> None:
        """Store the result of the run."""
        self.end = end

    def recording(self) -> Recording:
        """Return the run as a recording, without the events that precede the opening of its devices."""
        return Recording(tuple(self.cycles), events=tuple(self.events), end=dict(self.end or {}))


class Exercising:
    """Pytest plug-in that records in the worker processes, and collects in the main process."""

    def __init__(self, config: pytest.Config) -> None:
        self._path = config.getoption("--exercised")
        self._config = config
        self._model = GuardModel()
        self._test = ""
        self._runs: list[_Watched] = []
        """Runs of the current test."""
        self._found: dict[str, dict[str, str]] = {group: {} for group in GROUPS}
        self._listen()

    def _strike(self, group: str, name: str) -> None:
        self._found[group].setdefault(name, self._test)

    # --- where things are struck

    def _listen(self) -> None:
        """Wrap the methods through which every run, decision, refusal and verdict passes."""
        _observe(Running, "__init__", lambda answer, running, setup, log, *args: self._join(running, log))
        _observe(ControlLoop, "judge", lambda answer, *args: self._record_decision(answer[1]))
        for name in ("step", "retreat", "stop"):
            _observe(Supervisor, name, lambda answer, *args: self._record_verdict(answer[1]))
        _observe(Program, "step", lambda answer, *args: self._record_course(answer[0]))
        _observe(TouchTest, "after", lambda answer, *args: self._record_reason(answer[2]))
        _observe(BridgeError, "__init__", lambda answer, error, *args, **more: self._record_refusal(error))
        _observe(
            Criterion, "judge", lambda answer, criterion, figures: self._record_criterion(answer, criterion)
        )
        for promise, check in CHECKERS.items():
            CHECKERS[promise] = self._recording_checker(promise, check)  # type: ignore[index]

    def _join(self, running: Running, log: Any) -> None:
        ended = [run for run in self._runs if run.end is not None]
        self._judge_runs(ended)  # so that a test with a hundred runs keeps only one of them in memory
        watched = _Watched(running)
        self._runs = [run for run in self._runs if run not in ended] + [watched]
        log.join(watched)

    def _record_decision(self, decision: Decision) -> None:
        self._record_verdict(decision.verdict)
        if decision.intent.failed and decision.intent.reason is not None:
            self._strike("causes", decision.intent.reason.cause)

    def _record_verdict(self, verdict: object) -> None:
        if isinstance(verdict, Clamp):
            for reason in verdict.holds:
                self._strike("causes", reason.cause)
        elif isinstance(verdict, Stop):
            self._strike("causes", verdict.reason.cause)

    def _record_course(self, state: ProgramState) -> None:
        self._record_reason(state.course.reason)
        self._record_reason(state.course.travelled)

    def _record_reason(self, reason: Reason | None) -> None:
        if reason is not None:
            self._strike("causes", reason.cause)

    def _record_refusal(self, error: BridgeError) -> None:
        """Count a refusal that the product raised, but not one that a test raised."""
        frame = sys._getframe(2)
        while frame.f_back is not None and frame.f_code.co_name in ("__init__", "beside"):
            frame = frame.f_back
        if error.cause is not None and str(frame.f_globals.get("__name__")).startswith("hil_bridge."):
            self._strike("causes", error.cause)

    def _record_criterion(self, met: bool | None, criterion: Criterion) -> None:
        if met is False:
            self._strike("criteria", criterion.figure)

    def _recording_checker(
        self, promise: Promise, check: Callable[[Evidence], Iterator[Violation]]
    ) -> Callable[[Evidence], Iterator[Violation]]:
        def checked(evidence: Evidence) -> Iterator[Violation]:
            for violation in check(evidence):
                self._strike("promises", promise)
                yield violation

        return checked

    # --- tests and processes

    def pytest_runtest_logstart(self, nodeid: str) -> None:
        self._test = nodeid

    @pytest.hookimpl(trylast=True)
    def pytest_runtest_teardown(self) -> None:
        runs, self._runs = self._runs, []
        self._judge_runs(runs)

    def _judge_runs(self, runs: list[_Watched]) -> None:
        for run in runs:
            recording, running = run.recording(), run.running
            for cause in causes_of(recording):
                self._strike("causes", cause)
            cell = running.cell
            for fault in () if cell is None else struck_faults(running.setup.config, cell.faults):
                self._strike("faults", fault)
            if (result := first_unaccepted(recording, self._model)) is not None:
                self._strike("unaccepted", f"{self._test}: cycle {result.cycle}")

    def pytest_sessionfinish(self) -> None:
        if hasattr(self._config, "workeroutput"):
            self._config.workeroutput["exercised"] = json.dumps(self._found)
        elif self._path:
            self._write(Path(self._path))

    @pytest.hookimpl(optionalhook=True)
    def pytest_testnodedown(self, node: Any) -> None:
        """Collect the evidence of a worker process that has ended."""
        result = json.loads(getattr(node, "workeroutput", {}).get("exercised", "{}"))
        for group, struck in result.items():
            for name, test in struck.items():
                self._found[group].setdefault(name, test)

    def _write(self, path: Path) -> None:
        path.parent.mkdir(parents=True, exist_ok=True)
        text = json.dumps({"code": code_version(), **self._found}, indent=1, sort_keys=True)
        path.write_text(text + "\n", encoding="utf-8")


def _observe(owner: Any, name: str, look: Callable[..., None]) -> None:
    """Wrap a method so that a function receives each of its results."""
    method = getattr(owner, name)

    @wraps(method)
    def beside(*args: Any, **more: Any) -> Any:
        answer = method(*args, **more)
        look(answer, *args, **more)
        return answer

    setattr(owner, name, beside)
