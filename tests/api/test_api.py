"""The Python interface: stable names, the same run as the command's, arrays, controllers, observers, a run by hand."""

import asyncio
import inspect
import math
import pickle
import subprocess
import sys
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest

import hil_bridge
from hil_bridge import api
from hil_bridge.control.laws.linear import Pi
from hil_bridge.control.sample import Sample
from hil_bridge.record import CycleRecord, EventKind, read_with_traffic
from hil_bridge.record.ending import reason_of
from hil_bridge.record.topics import TOPICS, Record
from tests.near_surface import AWAKE_TOML, CLOSE_TOML, SHORT, merged

pytestmark = pytest.mark.sweep

STOP = {"on": "robot", "fault": "emergency-stop", "phase": "track"}
SIGNATURES = {
    "load": "(config=None, *, faults=(), controller=None, seed=None) -> Config",
    "simulate": "(config=None, *, faults=(), controller=None, observe=None, seed=None) -> Result",
    "simulate_async": "(config=None, *, faults=(), controller=None, observe=None, seed=None) -> Result",
    "simulation": "(config=None, *, faults=(), controller=None, observe=None, seed=None) -> Simulation",
    "open_devices": "(config=None) -> OpenDevices",
    "read": "(path, bag=None) -> Recording",
    "run_virtual": "(main) -> T",
    "run_real": "(main, busy_poll_s=0.0) -> T",
}
"""Of every function; what an asynchronous context manager gives stands for it."""
MEMBERS = {
    "Result": "arrays cause cycles events exit_code figures followed left outcome plot recording report retracted save "
    "steps text traffic truths",
    "OpenDevices": "cell clock panel robot sensor truth",
    "Simulation": "cell clock config finished interrupt panel reached result robot sensor start truth",
}
ERRORS = (
    "BridgeError ConfigError DeviceError OrderRefused SafetyStop TransportBroken TransportClosed TransportEnded "
    "TransportError TransportUnavailable"
)
TYPES = (
    "BagChoices Cause Command Config Configuration Controller CycleRecord Measurement OpenDevices Outcome Part Reason "
    "Recording Result Simulation"
)


@dataclass(frozen=True)
class Proportional:
    """A user's own controller: a step that is proportional to the error."""

    gain_m_n: float = 2e-5
    name = "own"

    def initial(self) -> None:
        """It remembers nothing."""

    def step(self, state: None, measurement: api.Measurement, reference: float) -> tuple[None, api.Command]:
        error = reference - measurement.force
        if not measurement.is_finite:
            return None, api.Command(measurement.commanded, 0.0)
        step = self.gain_m_n * error
        return None, api.Command(measurement.commanded + step, step)


@pytest.fixture(scope="module")
def result() -> api.Result:
    return api.simulate(SHORT, seed=7)


def encoded(records: Any) -> list[bytes]:
    """Records with NaN are equal when their messages are."""
    topics = {topic.record: topic for topic in TOPICS}
    return [topics[type(record)].encode(record) for record in records]


def test_stable_names_are_these() -> None:
    assert api.__all__ == sorted([*SIGNATURES, *ERRORS.split(), *TYPES.split()])
    assert set(api.__all__) <= set(dir(hil_bridge))
    for name in api.__all__:
        assert getattr(hil_bridge, name) is getattr(api, name)
    with pytest.raises(AttributeError, match="nothing"):
        _ = hil_bridge.nothing


def test_stable_signatures_are_these() -> None:
    for name, wanted in SIGNATURES.items():
        signature = inspect.signature(getattr(api, name))
        bare = [each.replace(annotation=each.empty) for each in signature.parameters.values()]
        given = getattr(signature.return_annotation, "__args__", (signature.return_annotation,))[0]
        told = str(inspect.Signature(bare))
        assert f"{told} -> {given.__name__}" == wanted, name


def test_stable_members_are_these(result: api.Result) -> None:
    async def main() -> list[Any]:
        async with api.open_devices(SHORT) as devices:
            found: list[Any] = [result, devices]
        async with api.simulation(SHORT) as running:
            found.append(running)
        return found

    for thing, (name, members) in zip(api.run_virtual(main), MEMBERS.items(), strict=True):
        assert type(thing) is getattr(api, name)
        assert [member for member in dir(thing) if not member.startswith("_")] == members.split()


def test_import_of_the_package_alone_is_light() -> None:
    code = "import sys, hil_bridge; print(sorted(n for n in sys.modules if n in ('numpy', 'pydantic', 'asyncio')))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


@pytest.mark.full
def test_recording_is_that_of_the_command(result: api.Result, tmp_path: Any) -> None:
    config = tmp_path / "short.toml"
    config.write_text(f"{AWAKE_TOML}{CLOSE_TOML}run.duration_s = 0.5\n", encoding="utf-8")
    path = tmp_path / "run.mcap"
    command = f"run {config} --virtual --no-view --seed 7 --record {path}".split()
    subprocess.run([sys.executable, "-m", "hil_bridge", *command], check=True, stdout=subprocess.DEVNULL)
    recording, traffic = read_with_traffic(path)
    assert len(recording.cycles) > 5
    for there, here in zip(recording.cycles, result.cycles, strict=True):
        assert encoded([there]) == encoded([here]), f"cycle {there.cycle}"
    pairs: list[tuple[tuple[Record, ...], tuple[Record, ...]]] = [
        (recording.sensors, result.recording.sensors),
        (recording.truths, result.truths),
        (recording.events, result.events),
        (traffic.robot, result.traffic.robot),
        (traffic.sensor, result.traffic.sensor),
    ]
    for theirs, ours in pairs:
        assert encoded(theirs) == encoded(ours)
    for name in ("metadata", "end", "truncated", "devices", "unix_zero_ns", "steps", "removed"):
        assert getattr(recording, name) == getattr(result.recording, name), name
    assert result.save(tmp_path / "own.mcap").read_bytes() == path.read_bytes()
    with pytest.raises(api.ConfigError, match="there already"):
        result.save(path)


def test_same_seed_gives_the_same_run_and_another_another(result: api.Result) -> None:
    assert encoded(api.simulate(api.load(SHORT), seed=7).cycles) == encoded(result.cycles)
    assert encoded(api.simulate(SHORT, seed=8).cycles) != encoded(result.cycles)


def test_arrays_hold_the_records_by_field(result: api.Result) -> None:
    arrays, cycles = result.arrays, result.cycles
    assert arrays.force.tolist() == [cycle.force for cycle in cycles]
    assert arrays.position.shape == (len(cycles), 3)
    assert arrays.wrench[-1].tolist() == list(cycles[-1].sample.wrench)
    assert arrays.in_contact.dtype == bool
    assert arrays.phase[-1] == "retract"
    assert math.isnan(arrays.stiffness[0])
    assert np.isnan(arrays.quaternion_commanded).all()
    assert arrays.quaternion_commanded.shape == (len(cycles), 4)
    assert arrays.explanation["feedback_m"].shape == (len(cycles),)
    assert arrays.reasons[0] == cycles[0].reasons
    assert arrays.truths.force.shape == (len(result.truths), 3)
    assert arrays.sensors.counts.shape == (len(result.recording.sensors), 6)
    assert "retract" in arrays.events.text
    assert arrays.steps.count == 0
    fields, sampled = {*CycleRecord.__struct_fields__}, {*Sample.__struct_fields__}
    twice = fields & sampled
    assert set(arrays) == {"time"} | fields - {"sample"} | sampled - twice | {
        f"sample_{name}" for name in twice
    }
    assert dict(arrays)["force"] is arrays.force
    assert len(arrays) == len(list(arrays))
    assert arrays.time[0] == pytest.approx(cycles[0].controlled_at - result.events[0].at)
    assert 0.0 < arrays.time[0] < 30.0
    with pytest.raises(ValueError, match="read-only"):
        arrays.force[0] = 1.0
    with pytest.raises(AttributeError, match="no field is called 'forces'"):
        _ = arrays.forces


def test_result_tells_figures_and_goes_to_other_processes(result: api.Result) -> None:
    assert result.outcome == "completed"
    assert result.left.startswith("retracted")
    largest = result.figures.figures["largest_force_n"]
    assert largest is not None
    tracked = result.arrays.force[result.arrays.phase == "track"]
    assert largest == pytest.approx(max(tracked), abs=1e-9)
    there = pickle.loads(pickle.dumps(result))
    assert encoded(there.cycles) == encoded(result.cycles)


def test_faults_come_after_those_of_the_configuration() -> None:
    noise = {"on": "signal", "fault": "noise", "phase": "track"}
    stopped = api.simulate({**SHORT, "faults": [noise]}, faults=[STOP])
    assert stopped.outcome == "stopped"
    assert "emergency stop" in stopped.text
    told = [event.text for event in stopped.events if event.kind == EventKind.FAULT]
    assert any(text.startswith("signal: noise") for text in told)
    assert any(text.startswith("robot: emergency-stop") for text in told)


@pytest.mark.parametrize("robot", ["s3", "egm"])
def test_a_controller_of_ones_own_decides(robot: str) -> None:
    config: dict[str, Any] = {"run": {"duration_s": 2.0, "period_ms": 180.0}, "robot": {"emulated": robot}}
    done = api.simulate(config, controller=Proportional(3e-5))
    assert done.outcome == "completed"
    assert done.recording.metadata["controller"] == "own"
    assert '"parameters":{"gain_m_n":3e-05}' in done.recording.metadata["config"]
    tracked = [cycle for cycle in done.cycles if cycle.phase == "track"]
    steps = [cycle.explanation["feedback_m"] for cycle in tracked]
    expected = [3e-5 * (cycle.force_reference - cycle.force) for cycle in tracked]
    assert steps == pytest.approx(expected, abs=1e-12)


def test_a_controller_by_name_and_what_is_none() -> None:
    assert api.simulate(SHORT, controller="pi").recording.metadata["controller"] == "pi"
    with pytest.raises(api.ConfigError, match="no controller 'pj'"):
        api.simulate(SHORT, controller="pj")
    with pytest.raises(api.ConfigError, match="has no method initial"):
        api.simulate(SHORT, controller=object())  # type: ignore[arg-type]


EGM = {**SHORT, "robot": {"emulated": "egm"}}


def test_a_controller_without_a_sample_time_is_told_how_rarely_it_decides() -> None:
    with pytest.warns(
        UserWarning,
        match="decides every 180 ms, but the robot takes an order every 4 ms",
    ) as warned:
        slow = api.simulate(EGM, controller=Proportional())
    assert [event.text for event in slow.events if event.kind == EventKind.PACE] == [
        "controller own declares no sample time, so it decides every 180 ms, but the robot takes an order every 4 ms: "
        "write sample_ms = 4 into its class, or set controller.sample_ms, where its parameters fit that"
    ]
    assert warned[0].filename == __file__, "it names the line of the program that called"


@pytest.mark.filterwarnings("error")
def test_nothing_is_told_of_the_pace_where_it_was_chosen_or_fits() -> None:
    @dataclass(frozen=True)
    class Declared(Proportional):
        sample_ms = 180.0

    for config, controller in (
        (SHORT, Proportional()),
        (EGM, Declared()),
        (merged(EGM, {"run": {"period_ms": 180.0}}), Proportional()),
        ({**EGM, "controller": {"sample_ms": 4.0}}, Proportional(1e-6)),
        (EGM, None),
    ):
        done = api.simulate(config, controller=controller)
        assert not [event for event in done.events if event.kind == EventKind.PACE]


def test_tunings_of_an_object_count_for_parameters_that_have_their_defaults() -> None:
    named = api.simulate(EGM, controller="pi")
    given = api.simulate(EGM, controller=Pi())
    assert [one.force for one in given.cycles] == [one.force for one in named.cycles]
    own = api.simulate(EGM, controller=Pi(proportional=0.1))
    assert '"proportional":0.1' in own.recording.metadata["config"]
    assert [one.force for one in own.cycles] != [one.force for one in named.cycles]


def test_a_class_for_an_object_is_answered_in_words() -> None:
    with pytest.raises(
        api.ConfigError, match=r"Proportional is a class; give an instance, Proportional\(…\)"
    ):
        api.simulate(SHORT, controller=Proportional)  # type: ignore[arg-type]


def test_observer_is_told_each_cycle_and_its_error_comes_out_after_the_retraction() -> None:
    told: list[api.CycleRecord] = []
    done = api.simulate(SHORT, observe=told.append)
    assert tuple(told) == done.cycles

    class Enough(Exception):
        pass

    phases = []

    def observe(record: api.CycleRecord) -> None:
        phases.append(record.phase)
        if record.phase == "track":
            raise Enough("seen")

    with pytest.raises(Enough, match="seen"):
        api.simulate(SHORT, observe=observe)
    assert phases[-1] == "track"


def test_errors_name_the_key(tmp_path: Any) -> None:
    with pytest.raises(api.ConfigError, match=r"run\.duraton_s is no setting; did you mean duration_s\?"):
        api.simulate({"run": {"duraton_s": 2.0}})
    with pytest.raises(api.ConfigError, match=r"faults.0"):
        api.simulate(faults=[{"on": "robot", "fault": "tired"}])
    with pytest.raises(api.ConfigError, match="cannot read"):
        api.simulate(tmp_path / "none.toml")
    with pytest.raises(api.ConfigError, match="virtual"):
        api.simulate({"sensor": {"url": "jr3+can+socketcan://can0"}})


async def test_simulate_works_where_a_loop_runs_already() -> None:
    assert api.simulate(SHORT).outcome == "completed"


def test_a_run_by_hand() -> None:
    async def main() -> tuple[api.Simulation, float]:
        async with api.simulation(SHORT, seed=7) as running:
            await running.reached("track")
            force = running.truth().contact_force[2]
            running.panel.inject("robot", "emergency-stop")
            ended = await running.finished()
            assert ended.outcome == "stopped"
            with pytest.raises(api.ConfigError, match="context"):
                _ = running.result
        return running, force

    running, force = api.run_virtual(main)
    assert force > 0.1
    assert "emergency stop" in running.result.text
    assert [event.text for event in running.result.events if event.kind == EventKind.PHASE][:4] == [
        "connect",
        "tare",
        "approach",
        "track",
    ]


def test_leaving_a_run_that_goes_retracts_first() -> None:
    async def main() -> api.Simulation:
        async def fail() -> None:
            async with api.simulation({"run": {"duration_s": 100.0}}) as running:
                kept.append(running)
                await running.reached("track")
                _ = 1 / 0

        kept: list[api.Simulation] = []
        with pytest.raises(ZeroDivisionError):
            await fail()
        return kept[0]

    result = api.run_virtual(main).result
    assert result.outcome == "interrupted"
    assert result.left.startswith("retracted")
    assert len(result.cycles) < 60


def test_a_cancelled_program_leaves_the_tool_off_the_surface() -> None:
    kept: list[api.Simulation] = []

    async def watch() -> None:
        async with api.simulation({"run": {"duration_s": 100.0}}) as running:
            kept.append(running)
            await running.finished()

    async def main() -> None:
        task = asyncio.create_task(watch())
        await asyncio.sleep(15.0)
        task.cancel()
        await asyncio.sleep(0.5)
        task.cancel()  # a second time, while the tool retracts
        with pytest.raises(asyncio.CancelledError):
            await task

    api.run_virtual(main)
    result = kept[0].result
    assert result.outcome == "interrupted"
    assert result.left.startswith("retracted")
    assert result.cycles[-1].phase == "retract"


def test_a_run_that_never_began_says_so() -> None:
    async def main() -> api.Simulation:
        async with api.simulation(SHORT) as running:
            pass
        return running

    result = api.run_virtual(main).result
    assert (result.outcome, result.cycles) == ("interrupted", ())
    with pytest.raises(api.ConfigError, match="before its first control cycle"):
        _ = result.figures


def test_a_device_that_fails_before_the_movement_raises_and_leaves_a_recording() -> None:
    kept: list[api.Simulation] = []

    async def main() -> None:
        fault = {"on": "sensor", "fault": "wrong-scales", "phase": "connect"}
        async with api.simulation(SHORT, faults=[fault]) as running:
            kept.append(running)
            await running.finished()

    with pytest.raises(api.BridgeError, match="force sensor") as error:
        api.run_virtual(main)
    result = kept[0].result
    assert (result.outcome, result.text) == ("stopped", str(error.value))
    assert str(reason_of(result.recording.end)) == result.text
    assert result.cause is api.Cause.WEIGHT


def test_a_controller_that_fails_is_blamed() -> None:
    class Failing(Proportional):
        def step(
            self, state: None, measurement: api.Measurement, reference: float
        ) -> tuple[None, api.Command]:
            raise ZeroDivisionError("no gain")

    failed = api.simulate(SHORT, controller=Failing())
    assert failed.outcome == "stopped"
    assert "no gain" in failed.text
    assert failed.left.startswith("retracted")


def test_a_phase_that_never_comes_is_told() -> None:
    async def main() -> None:
        stop = {"on": "robot", "fault": "emergency-stop", "phase": "approach"}
        async with api.simulation(SHORT, faults=[stop]) as running:
            with pytest.raises(api.ConfigError, match=r"before the phase 'track'.*emergency stop"):
                await running.reached("track")

    api.run_virtual(main)


def test_devices_without_a_run() -> None:
    async def main() -> None:
        async with api.open_devices({"robot": {"emulated": "egm"}}) as cell:
            report = await cell.robot.ready()
            await cell.sensor.ready()
            first = await cell.sensor.frame()
            assert len(cell.sensor.wrench(first)) == 6
            assert report.pose.position == pytest.approx(cell.truth().position, abs=1e-3)
            cell.panel.inject("sensor", "unplugged")
            before = cell.sensor.newest
            assert before is not None
            await cell.clock.sleep_until(cell.clock.now() + 0.1)
            after = cell.sensor.newest
            assert after is not None
            assert after.at - before.at < 0.05
            with pytest.raises(api.ConfigError, match="this sensor-wire cannot have"):
                cell.panel.inject("sensor-wire", "tired")

    api.run_virtual(main)


def test_a_module_of_the_package_is_had_without_the_interface() -> None:
    """Modules of the interface ask for others so: to load it for them would go round in a circle."""
    code = "import sys; from hil_bridge import transports; sys.exit('hil_bridge.api' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
    with pytest.raises(ImportError, match="cannot import name 'nonsense' from 'hil_bridge'"):
        exec("from hil_bridge import nonsense")
