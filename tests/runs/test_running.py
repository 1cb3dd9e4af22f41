"""Harness of a run: what it closes, and that a failing close does not prevent the others."""

import asyncio
from collections.abc import AsyncIterator, Callable, Mapping, Sequence
from contextlib import asynccontextmanager
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from emulators.cell import Cell, TrueState
from hil_bridge import api
from hil_bridge.clock import Clock, run_real, run_virtual
from hil_bridge.devices.device_log import CallbackLog
from hil_bridge.errors import Cause, ConfigError
from hil_bridge.record import CycleRecord, EventKind, EventRecord, LinkRecord, Outcome, RunEnd, TruthRecord
from hil_bridge.runs import compose
from hil_bridge.runs.background_tasks import background_task
from hil_bridge.runs.checks import check
from hil_bridge.runs.faults.schedule import FaultSchedule
from hil_bridge.runs.outputs import Outputs
from hil_bridge.runs.result import RunResult
from hil_bridge.runs.run_log import RunLog
from hil_bridge.runs.running import Running, running
from hil_bridge.runs.session import execute
from hil_bridge.runs.setup import Setup
from hil_bridge.runs.truth import GroundTruth
from hil_bridge.runs.views import health_of
from hil_bridge.runs.watchers import Listener, Watcher
from hil_bridge.settings.configuration import read_config
from hil_bridge.settings.faults import Condition
from hil_bridge.transports.wrappers import Direction
from tests.near_surface import SHORT


def test_failing_close_does_not_skip_others(monkeypatch: pytest.MonkeyPatch) -> None:
    closed: list[str] = []

    def failing(name: str) -> Callable[[object], None]:
        def close(part: object) -> None:
            closed.append(name)
            raise AssertionError(name)

        return close

    monkeypatch.setattr(FaultSchedule, "close", failing("faults"))
    monkeypatch.setattr(GroundTruth, "close", failing("truth"))

    async def main() -> None:
        listener = Listener({TruthRecord: lambda record: None})
        async with running(Setup(read_config({})), RunLog(Clock.running(), [listener])):
            closed.append("body")

    with pytest.raises(AssertionError, match="truth"):
        run_virtual(main)
    assert closed == ["body", "faults", "truth"]


def run_in_harness(
    config: Mapping[str, Any],
    watchers: Sequence[Watcher] = (),
    act: Callable[[Running], object] = lambda run: None,
) -> RunResult:
    """Run in virtual time with these watchers; `act` receives the run before it begins."""

    async def main() -> RunResult:
        setup = Setup(read_config(config))
        async with running(setup, RunLog(Clock.running(), watchers)) as run:
            act(run)
            return await run()

    return run_virtual(main)


def test_faults_and_truth_end_after_the_devices(monkeypatch: pytest.MonkeyPatch) -> None:
    order: list[str] = []
    opened, close_faults, close_truth = compose.open_devices, FaultSchedule.close, GroundTruth.close

    @asynccontextmanager
    async def open_devices(*arguments: Any) -> AsyncIterator[compose.Devices]:
        async with opened(*arguments) as devices:
            yield devices
        order.append("devices")

    monkeypatch.setattr(compose, "open_devices", open_devices)

    def noting(name: str, close: Callable[[Any], None]) -> Callable[[Any], None]:
        def close_and_note(part: Any) -> None:
            order.append(name)
            close(part)

        return close_and_note

    monkeypatch.setattr(FaultSchedule, "close", noting("faults", close_faults))
    monkeypatch.setattr(GroundTruth, "close", noting("truth", close_truth))
    run_in_harness(SHORT, [Listener({TruthRecord: lambda record: None})])
    assert order == ["devices", "faults", "truth"]


def test_cell_failing_while_opening_ends_run(monkeypatch: pytest.MonkeyPatch) -> None:
    opened = compose.open_devices

    @asynccontextmanager
    async def open_devices(
        setup: Setup, clock: Clock, log: RunLog, *rest: Any
    ) -> AsyncIterator[compose.Devices]:
        log.notice(EventKind.FAILED, "the emulated cell failed: planted")
        async with opened(setup, clock, log, *rest) as devices:
            yield devices

    monkeypatch.setattr(compose, "open_devices", open_devices)
    result = run_in_harness(SHORT)
    assert result.reason is not None
    assert (result.reason.cause, result.reason.text) == (
        Cause.CELL_FAILED,
        "the emulated cell failed: planted",
    )


def test_emulated_robot_is_served_with_real_sensor() -> None:
    config = read_config(
        {"robot": {"emulated": "s3"}, "sensor": {"url": "netft+udp://127.0.0.1:49152", "unchecked": True}}
    )

    async def main() -> None:
        clock = Clock.running()
        try:
            async with compose.open_devices(Setup(config), clock, CallbackLog()) as devices:
                assert devices.served is not None
                assert devices.served.robot is not None
                assert devices.served.sensor is None
        finally:
            clock.close()

    run_real(main)


def test_health_has_time_and_force_of_newest_frame() -> None:
    def health_with(newest: object, peaks: object = None) -> Any:
        robot, facts = (
            SimpleNamespace(counters={"retries": 2, "orders": 7}),
            SimpleNamespace(errors=("retries",)),
        )
        sensor = SimpleNamespace(newest=newest, lost=3, peaks=peaks)
        run: Any = SimpleNamespace(robot=robot, sensor=sensor, facts=facts)
        return health_of(run)

    frame = SimpleNamespace(at=4.5, values=(0.0, 0.0, -7.5))
    health = health_with(frame, SimpleNamespace(along=lambda values: -values[2]))
    assert (health.link_errors, health.frames_lost, health.sensor_at) == (2, 3, 4.5)
    assert health.force == 7.5
    assert health_with(frame).force is None, "there is no zero yet"
    assert health_with(None).sensor_at is None, "no frame has arrived yet"
    assert health_of(None).sensor_at is None


def test_run_ended_by_error_enters_retract_phase() -> None:
    phases: list[str] = []
    cycles: list[CycleRecord] = []

    def note(record: EventRecord) -> None:
        if record.kind == EventKind.PHASE:
            phases.append(record.text)

    def fail(record: CycleRecord) -> None:
        cycles.append(record)
        if len(cycles) == 3:
            raise ValueError("planted")

    result = run_in_harness(SHORT, [Listener({EventRecord: note}), Listener({CycleRecord: fail})])
    assert result.outcome is Outcome.STOPPED
    assert "retract" in phases


def test_log_has_byte_time_of_line() -> None:
    pauses: list[float] = []

    class Ear(Listener):
        def pause(self, seconds: float) -> None:
            pauses.append(seconds)

    reported: list[float] = []
    run_in_harness(
        SHORT, [Ear({LinkRecord: lambda record: None})], lambda run: reported.append(run.log.byte_time_s)
    )
    assert reported == [pytest.approx(11 / 9600)]  # the S3's line: 9600 baud, eight bits with parity
    assert min(pauses) > reported[0]


def test_truth_is_queried_only_for_a_watcher(monkeypatch: pytest.MonkeyPatch) -> None:
    requested: list[CycleRecord] = []
    monkeypatch.setattr(GroundTruth, "cycle", lambda truth, record: requested.append(record))
    run_in_harness(SHORT)
    assert not requested
    run_in_harness(SHORT, [Listener({TruthRecord: lambda record: None})])
    assert requested


def test_true_states_are_queried_only_if_they_are_kept(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    requested: list[int] = []
    true_states = Cell.true_states

    def counted(cell: Cell[Any, Any], times: Sequence[float]) -> list[TrueState]:
        requested.append(len(times))
        return true_states(cell, times)

    monkeypatch.setattr(Cell, "true_states", counted)
    config = read_config(SHORT)
    assert execute(config, True, Outputs(), view=False) == 0
    assert not requested, "the figures do not use them"
    assert execute(config, True, Outputs(record=tmp_path / "run.mcap"), view=False) == 0
    assert requested


def test_every_watcher_is_closed_and_the_first_error_is_raised() -> None:
    order: list[str] = []

    class Failing(Listener):
        def __init__(self, name: str) -> None:
            super().__init__({LinkRecord: lambda record: order.append("traffic")})
            self.name = name

        def close(self, end: Mapping[str, str]) -> None:
            order.append(self.name)
            raise ConfigError(self.name)

    async def main() -> None:
        log = RunLog(Clock.running(), [Failing("first"), Failing("second")])
        log.traffic("robot", Direction.SENT, b"\x05")
        with pytest.raises(ConfigError, match="first"):
            log.close(RunEnd(Outcome.COMPLETED))

    run_virtual(main)
    assert order == ["traffic", "traffic", "first", "second"], "the rest of the wire arrives before the end"


def test_fault_condition_is_parsed_once(monkeypatch: pytest.MonkeyPatch) -> None:
    reads: list[str] = []
    read = Condition.read

    def count(text: str) -> Condition:
        reads.append(text)
        return read(text)

    def begin(run: Running) -> None:
        monkeypatch.setattr(Condition, "read", count)

    cycles: list[CycleRecord] = []
    fault = {"on": "signal", "fault": "dead", "when": "force > 1000"}
    run_in_harness({**SHORT, "faults": [fault]}, [Listener({CycleRecord: cycles.append})], begin)
    assert len(cycles) > 5
    assert not reads, "the schedule has read it before the run begins"


@pytest.mark.parametrize("begin", ["command", "program"])
def test_cell_is_made_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, begin: str) -> None:
    made: list[object] = []
    make = compose.make_cell

    def count(setup: Setup, now: float) -> object:
        made.append(cell := make(setup, now))
        return cell

    monkeypatch.setattr(compose, "make_cell", count)
    if begin == "command":
        assert execute(read_config(SHORT), True, Outputs(record=tmp_path / "run.mcap"), view=False) == 0
    else:
        assert api.simulate(SHORT).outcome == "completed"
    assert len(made) == 1


def test_run_uses_cell_of_the_checks() -> None:
    async def main() -> None:
        clock = Clock.running()
        setup = Setup(read_config(SHORT))
        cell = check(setup, True, clock.now())
        assert cell is setup.cell is not None
        async with running(setup, RunLog(clock, []), cell) as run:
            assert run.cell is cell

    run_virtual(main)


def test_failing_watcher_does_not_affect_others() -> None:
    order: list[str] = []

    def failing(name: str) -> Listener:
        def take(record: EventRecord) -> None:
            order.append(name)
            raise AssertionError(name)

        return Listener({EventRecord: take})

    async def main() -> None:
        log = RunLog(Clock.running(), [failing("first"), failing("second")])
        with pytest.raises(AssertionError, match="first"):
            log.notice(EventKind.MARK, "number 1")

    run_virtual(main)
    assert order == ["first", "second"]


def test_background_task_ends_with_run() -> None:
    order: list[str] = []

    async def fail() -> None:
        order.append("fails")
        raise ValueError("a view")

    async def wait() -> None:
        try:
            await asyncio.sleep(1e6)
        except asyncio.CancelledError:
            order.append("cancelled")
            raise

    async def move() -> None:
        async with background_task(fail(), "view"):
            await asyncio.sleep(1.0)
            order.append("the run ends")

    async def stop() -> None:
        async with background_task(wait(), "view"):
            await asyncio.sleep(1.0)
            raise ConfigError("the run's own")

    with pytest.raises(ValueError, match="a view"):
        run_virtual(move)
    with pytest.raises(ConfigError, match="the run's own"):
        run_virtual(stop)
    assert order == ["fails", "the run ends", "cancelled"]
