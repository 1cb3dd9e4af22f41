"""What the tests really strike: a plug-in of pytest.

`python -m pytest -p tools.exercising --exercised FILE` writes which causes ended or held something, which injected
faults had an effect, and which promises and criteria were missed, each with the first test that did it.
`tools.exercised` reads the file. Every run in a process of the tests is watched; runs in other processes are not. Each
run is also held against the model of the guard.
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
    parser.addoption("--exercised", metavar="FILE", help="file for what the tests have struck")


def pytest_configure(config: pytest.Config) -> None:
    config.pluginmanager.register(Exercising(config), "what tests strike")


class _Watched(Listener):
    """One run: its cycles and events, as a recording has them."""

    def __init__(self, running: Running) -> None:
        self.cycles: list[CycleRecord] = []
        self.events: list[EventRecord] = []
        self.end: Mapping[str, str] | None = None
        self.running = running
        super().__init__({CycleRecord: self.cycles.append, EventRecord: self.events.append})

    def close(self, end: Mapping[str, str]) -> None:
        """Keep the end."""
        self.end = end

    def recording(self) -> Recording:
        """As a file would have it, without what the run tells before its devices are open."""
        return Recording(tuple(self.cycles), events=tuple(self.events), end=dict(self.end or {}))


class Exercising:
    """Listens in the process that runs a test; gathers in the one that was started."""

    def __init__(self, config: pytest.Config) -> None:
        self._path = config.getoption("--exercised")
        self._config = config
        self._model = GuardModel()
        self._test = ""
        self._runs: list[_Watched] = []
        """Runs of the present test."""
        self._found: dict[str, dict[str, str]] = {group: {} for group in GROUPS}
        self._listen()

    def _strike(self, group: str, name: str) -> None:
        self._found[group].setdefault(name, self._test)

    # --- where things are struck

    def _listen(self) -> None:
        """Stand beside the places through which every run, decision, refusal and judgement goes."""
        _beside(Running, "__init__", lambda answer, running, setup, log, *given: self._join(running, log))
        _beside(ControlLoop, "judge", lambda answer, *given: self._decided(answer[1]))
        for name in ("step", "retreat", "stop"):
            _beside(Supervisor, name, lambda answer, *given: self._judged(answer[1]))
        _beside(Program, "step", lambda answer, *given: self._led(answer[0]))
        _beside(TouchTest, "after", lambda answer, *given: self._told(answer[2]))
        _beside(BridgeError, "__init__", lambda answer, error, *given, **more: self._raised(error))
        _beside(Criterion, "judge", lambda answer, criterion, figures: self._criterion(answer, criterion))
        for promise, check in CHECKERS.items():
            CHECKERS[promise] = self._checked(promise, check)  # type: ignore[index]

    def _join(self, running: Running, log: Any) -> None:
        ended = [run for run in self._runs if run.end is not None]
        self._judge_runs(ended)  # a test of a hundred runs keeps one of them in memory
        watched = _Watched(running)
        self._runs = [run for run in self._runs if run not in ended] + [watched]
        log.join(watched)

    def _decided(self, decision: Decision) -> None:
        self._judged(decision.verdict)
        if decision.intent.failed and decision.intent.reason is not None:
            self._strike("causes", decision.intent.reason.cause)

    def _judged(self, verdict: object) -> None:
        if isinstance(verdict, Clamp):
            for reason in verdict.holds:
                self._strike("causes", reason.cause)
        elif isinstance(verdict, Stop):
            self._strike("causes", verdict.reason.cause)

    def _led(self, state: ProgramState) -> None:
        self._told(state.course.reason)
        self._told(state.course.travelled)

    def _told(self, reason: Reason | None) -> None:
        if reason is not None:
            self._strike("causes", reason.cause)

    def _raised(self, error: BridgeError) -> None:
        """Count a refusal if the product made it, not a test."""
        frame = sys._getframe(2)
        while frame.f_back is not None and frame.f_code.co_name in ("__init__", "beside"):
            frame = frame.f_back
        if error.cause is not None and str(frame.f_globals.get("__name__")).startswith("hil_bridge."):
            self._strike("causes", error.cause)

    def _criterion(self, met: bool | None, criterion: Criterion) -> None:
        if met is False:
            self._strike("criteria", criterion.figure)

    def _checked(
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
            if (found := first_unaccepted(recording, self._model)) is not None:
                self._strike("unaccepted", f"{self._test}: cycle {found.cycle}")

    def pytest_sessionfinish(self) -> None:
        if hasattr(self._config, "workeroutput"):
            self._config.workeroutput["exercised"] = json.dumps(self._found)
        elif self._path:
            self._write(Path(self._path))

    @pytest.hookimpl(optionalhook=True)
    def pytest_testnodedown(self, node: Any) -> None:
        """Collect the evidence of a process of tests that has ended."""
        found = json.loads(getattr(node, "workeroutput", {}).get("exercised", "{}"))
        for group, struck in found.items():
            for name, test in struck.items():
                self._found[group].setdefault(name, test)

    def _write(self, path: Path) -> None:
        path.parent.mkdir(parents=True, exist_ok=True)
        text = json.dumps({"code": code_version(), **self._found}, indent=1, sort_keys=True)
        path.write_text(text + "\n", encoding="utf-8")


def _beside(owner: Any, name: str, look: Callable[..., None]) -> None:
    """Let a function look at each answer of a method."""
    method = getattr(owner, name)

    @wraps(method)
    def beside(*given: Any, **more: Any) -> Any:
        answer = method(*given, **more)
        look(answer, *given, **more)
        return answer

    setattr(owner, name, beside)
