"""Python interface: stable names, same run as the command's, arrays, controllers, observers, controlled runs."""

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
"""Signatures of all functions; for an asynchronous context manager, with the type that it yields."""
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
    """Controller of a user: a step proportional to the error."""

    gain_m_n: float = 2e-5
    name = "own"

    def initial(self) -> None:
        """Return no state."""

    def step(self, state: None, measurement: api.Measurement, reference: float) -> tuple[None, api.Command]:
        error = reference - measurement.force
        if not measurement.is_finite:
            return None, api.Command(measurement.commanded, 0.0)
        step = self.gain_m_n * error
        return None, api.Command(measurement.commanded + step, step)


@pytest.fixture(scope="module")
def result() -> api.Result:
    return api.simulate(SHORT, seed=7)


def comparable(records: Any) -> list[bytes]:
    """Return records in a form that compares equal with NaN."""
    topics = {topic.record: topic for topic in TOPICS}
    return [topics[type(record)].encode(record) for record in records]


def test_api_stable_names() -> None:
    assert api.__all__ == sorted([*SIGNATURES, *ERRORS.split(), *TYPES.split()])
    assert set(api.__all__) <= set(dir(hil_bridge))
    for name in api.__all__:
        assert getattr(hil_bridge, name) is getattr(api, name)
    with pytest.raises(AttributeError, match="nothing"):
        _ = hil_bridge.nothing


def test_api_stable_signatures() -> None:
    for name, expected in SIGNATURES.items():
        signature = inspect.signature(getattr(api, name))
        bare = [each.replace(annotation=each.empty) for each in signature.parameters.values()]
        annotation = getattr(signature.return_annotation, "__args__", (signature.return_annotation,))[0]
        bare_text = str(inspect.Signature(bare))
        assert f"{bare_text} -> {annotation.__name__}" == expected, name


def test_api_stable_members(result: api.Result) -> None:
    async def main() -> list[Any]:
        async with api.open_devices(SHORT) as devices:
            contents: list[Any] = [result, devices]
        async with api.simulation(SHORT) as running:
            contents.append(running)
        return contents

    for value, (name, members) in zip(api.run_virtual(main), MEMBERS.items(), strict=True):
        assert type(value) is getattr(api, name)
        assert [member for member in dir(value) if not member.startswith("_")] == members.split()


def test_api_package_import_is_light() -> None:
    code = "import sys, hil_bridge; print(sorted(n for n in sys.modules if n in ('numpy', 'pydantic', 'asyncio')))"
    process = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert process.stdout.strip() == "[]"


@pytest.mark.full
def test_simulate_recording_matches_command(result: api.Result, tmp_path: Any) -> None:
    config = tmp_path / "short.toml"
    config.write_text(f"{AWAKE_TOML}{CLOSE_TOML}run.duration_s = 0.5\n", encoding="utf-8")
    path = tmp_path / "run.mcap"
    command = f"run {config} --virtual --no-view --seed 7 --record {path}".split()
    subprocess.run([sys.executable, "-m", "hil_bridge", *command], check=True, stdout=subprocess.DEVNULL)
    recording, traffic = read_with_traffic(path)
    assert len(recording.cycles) > 5
    for recorded, simulated in zip(recording.cycles, result.cycles, strict=True):
        assert comparable([recorded]) == comparable([simulated]), f"cycle {recorded.cycle}"
    pairs: list[tuple[tuple[Record, ...], tuple[Record, ...]]] = [
        (recording.sensors, result.recording.sensors),
        (recording.truths, result.truths),
        (recording.events, result.events),
        (traffic.robot, result.traffic.robot),
        (traffic.sensor, result.traffic.sensor),
    ]
    for theirs, ours in pairs:
        assert comparable(theirs) == comparable(ours)
    for name in ("metadata", "end", "truncated", "devices", "unix_zero_ns", "steps", "removed"):
        assert getattr(recording, name) == getattr(result.recording, name), name
    assert result.save(tmp_path / "own.mcap").read_bytes() == path.read_bytes()
    with pytest.raises(api.ConfigError, match="already exists"):
        result.save(path)


def test_simulate_depends_on_seed_only(result: api.Result) -> None:
    assert comparable(api.simulate(api.load(SHORT), seed=7).cycles) == comparable(result.cycles)
    assert comparable(api.simulate(SHORT, seed=8).cycles) != comparable(result.cycles)


def test_result_arrays_contain_records_by_field(result: api.Result) -> None:
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
    with pytest.raises(AttributeError, match="unknown field 'forces'"):
        _ = arrays.forces


def test_result_has_figures_and_can_be_pickled(result: api.Result) -> None:
    assert result.outcome == "completed"
    assert result.left.startswith("retracted")
    largest = result.figures.figures["largest_force_n"]
    assert largest is not None
    tracked = result.arrays.force[result.arrays.phase == "track"]
    assert largest == pytest.approx(max(tracked), abs=1e-9)
    copy = pickle.loads(pickle.dumps(result))
    assert comparable(copy.cycles) == comparable(result.cycles)


def test_simulate_adds_faults_after_configured_ones() -> None:
    noise = {"on": "signal", "fault": "noise", "phase": "track"}
    stopped = api.simulate({**SHORT, "faults": [noise]}, faults=[STOP])
    assert stopped.outcome == "stopped"
    assert "emergency stop" in stopped.text
    faults = [event.text for event in stopped.events if event.kind == EventKind.FAULT]
    assert any(text.startswith("signal: noise") for text in faults)
    assert any(text.startswith("robot: emergency-stop") for text in faults)


@pytest.mark.parametrize("robot", ["s3", "egm"])
def test_simulate_uses_controller_object(robot: str) -> None:
    config: dict[str, Any] = {"run": {"duration_s": 2.0, "period_ms": 180.0}, "robot": {"emulated": robot}}
    result = api.simulate(config, controller=Proportional(3e-5))
    assert result.outcome == "completed"
    assert result.recording.metadata["controller"] == "own"
    assert '"parameters":{"gain_m_n":3e-05}' in result.recording.metadata["config"]
    tracked = [cycle for cycle in result.cycles if cycle.phase == "track"]
    steps = [cycle.explanation["feedback_m"] for cycle in tracked]
    expected = [3e-5 * (cycle.force_reference - cycle.force) for cycle in tracked]
    assert steps == pytest.approx(expected, abs=1e-12)


def test_simulate_selects_controller_by_name() -> None:
    assert api.simulate(SHORT, controller="pi").recording.metadata["controller"] == "pi"
    with pytest.raises(api.ConfigError, match="no controller 'pj'"):
        api.simulate(SHORT, controller="pj")
    with pytest.raises(api.ConfigError, match="has no method initial"):
        api.simulate(SHORT, controller=object())  # type: ignore[arg-type]


EGM = {**SHORT, "robot": {"emulated": "egm"}}


def test_simulate_reports_pace_of_untuned_controller() -> None:
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
def test_simulate_reports_no_pace_if_chosen_or_matching() -> None:
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
        result = api.simulate(config, controller=controller)
        assert not [event for event in result.events if event.kind == EventKind.PACE]


def test_simulate_tuning_keeps_changed_parameters() -> None:
    named = api.simulate(EGM, controller="pi")
    default = api.simulate(EGM, controller=Pi())
    assert [one.force for one in default.cycles] == [one.force for one in named.cycles]
    own = api.simulate(EGM, controller=Pi(proportional=0.1))
    assert '"proportional":0.1' in own.recording.metadata["config"]
    assert [one.force for one in own.cycles] != [one.force for one in named.cycles]


def test_simulate_refuses_controller_class() -> None:
    with pytest.raises(
        api.ConfigError, match=r"Proportional is a class; give an instance, Proportional\(…\)"
    ):
        api.simulate(SHORT, controller=Proportional)  # type: ignore[arg-type]


def test_simulate_observer_error_is_raised_after_retraction() -> None:
    records: list[api.CycleRecord] = []
    result = api.simulate(SHORT, observe=records.append)
    assert tuple(records) == result.cycles

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


def test_load_errors_name_key(tmp_path: Any) -> None:
    with pytest.raises(api.ConfigError, match=r"run\.duraton_s is not a setting; did you mean duration_s\?"):
        api.simulate({"run": {"duraton_s": 2.0}})
    with pytest.raises(api.ConfigError, match=r"faults.0"):
        api.simulate(faults=[{"on": "robot", "fault": "tired"}])
    with pytest.raises(api.ConfigError, match="cannot read"):
        api.simulate(tmp_path / "none.toml")
    with pytest.raises(api.ConfigError, match="virtual"):
        api.simulate({"sensor": {"url": "jr3+can+socketcan://can0"}})


async def test_simulate_works_inside_running_loop() -> None:
    assert api.simulate(SHORT).outcome == "completed"


def test_simulation_can_be_controlled() -> None:
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


def test_simulation_retracts_on_leaving_active_run() -> None:
    async def main() -> api.Simulation:
        async def fail() -> None:
            async with api.simulation({"run": {"duration_s": 100.0}}) as running:
                simulations.append(running)
                await running.reached("track")
                _ = 1 / 0

        simulations: list[api.Simulation] = []
        with pytest.raises(ZeroDivisionError):
            await fail()
        return simulations[0]

    result = api.run_virtual(main).result
    assert result.outcome == "interrupted"
    assert result.left.startswith("retracted")
    assert len(result.cycles) < 60


def test_simulation_retracts_when_cancelled() -> None:
    simulations: list[api.Simulation] = []

    async def watch() -> None:
        async with api.simulation({"run": {"duration_s": 100.0}}) as running:
            simulations.append(running)
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
    result = simulations[0].result
    assert result.outcome == "interrupted"
    assert result.left.startswith("retracted")
    assert result.cycles[-1].phase == "retract"


def test_simulation_without_start_reports_it() -> None:
    async def main() -> api.Simulation:
        async with api.simulation(SHORT) as running:
            pass
        return running

    result = api.run_virtual(main).result
    assert (result.outcome, result.cycles) == ("interrupted", ())
    with pytest.raises(api.ConfigError, match="before its first control cycle"):
        _ = result.figures


def test_simulation_early_device_failure_keeps_recording() -> None:
    simulations: list[api.Simulation] = []

    async def main() -> None:
        fault = {"on": "sensor", "fault": "wrong-scales", "phase": "connect"}
        async with api.simulation(SHORT, faults=[fault]) as running:
            simulations.append(running)
            await running.finished()

    with pytest.raises(api.BridgeError, match="force sensor") as error:
        api.run_virtual(main)
    result = simulations[0].result
    assert (result.outcome, result.text) == ("stopped", str(error.value))
    assert str(reason_of(result.recording.end)) == result.text
    assert result.cause is api.Cause.WEIGHT


def test_simulate_names_failing_controller() -> None:
    class Failing(Proportional):
        def step(
            self, state: None, measurement: api.Measurement, reference: float
        ) -> tuple[None, api.Command]:
            raise ZeroDivisionError("no gain")

    failed = api.simulate(SHORT, controller=Failing())
    assert failed.outcome == "stopped"
    assert "no gain" in failed.text
    assert failed.left.startswith("retracted")


def test_simulation_reports_unreached_phase() -> None:
    async def main() -> None:
        stop = {"on": "robot", "fault": "emergency-stop", "phase": "approach"}
        async with api.simulation(SHORT, faults=[stop]) as running:
            with pytest.raises(api.ConfigError, match=r"before the phase 'track'.*emergency stop"):
                await running.reached("track")

    api.run_virtual(main)


def test_open_devices_without_run() -> None:
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
            with pytest.raises(api.ConfigError, match="unknown fault 'tired' for target 'sensor-wire'"):
                cell.panel.inject("sensor-wire", "tired")

    api.run_virtual(main)


def test_submodule_import_does_not_load_api() -> None:
    """Modules of the interface import each other in this way; loading it for them would be a circular import."""
    code = "import sys; from hil_bridge import transports; sys.exit('hil_bridge.api' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
    with pytest.raises(ImportError, match="cannot import name 'nonsense' from 'hil_bridge'"):
        exec("from hil_bridge import nonsense")
