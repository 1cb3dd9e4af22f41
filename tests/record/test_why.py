"""Paragraph on how a run ended: for every fault of the S3 and the JR3, and samples of the other devices."""

import json
import re
from collections.abc import Mapping
from dataclasses import replace
from html import unescape
from pathlib import Path
from typing import Any, NamedTuple

import pytest
from click.testing import CliRunner
from msgspec.structs import replace as replace_struct

from emulators.devices.rtde.packages import PACKAGES
from hil_bridge import api
from hil_bridge.cli import cli
from hil_bridge.clock import Heartbeat
from hil_bridge.errors import Cause, Part, Reason
from hil_bridge.errors.cause_table import ROWS
from hil_bridge.record import EventKind, Outcome, Recording, RunEnd
from hil_bridge.record.analysis.summary import summarise
from hil_bridge.record.analysis.why import why, why_values
from hil_bridge.record.ending import reason_of
from hil_bridge.record.records import EventRecord
from tests.near_surface import CLOSE, SHORT, STREAMED, merged
from tests.recordings import Recordings
from tools.faults_doc import CELL, GIVEN, faults_of_device

pytestmark = pytest.mark.sweep

BLAMED = {
    **dict.fromkeys(("robot", "pose", "wire"), "robot"),
    **dict.fromkeys(("signal", "sensor-wire", "sensor", "bus"), "force sensor"),
    "surface": "surface",
    "obstacle": "what the tool touches",
    "computer": "computer",
}
"""Part that the text names if a fault of this target ended the run."""
CLOSE_RUN = merged(CLOSE, {"run": {"duration_s": 1.0}})
GUIDED = merged(
    STREAMED, {"robot": {"emulated": "egm"}, "sensor": {"emulated": "ft300"}, "run": {"duration_s": 0.8}}
)
SEED = 7
PARAMETERS = {**GIVEN, ("pose", "encoder-offset"): {"z_mm": 20.0}, ("computer", "pause"): {"seconds": 2.0}}


class Job(NamedTuple):
    """Run of a device with a fault."""

    device: str
    on: str
    fault: str


OURS = [
    Job(device, on, fault)
    for device in ("s3", "jr3")
    for on, faults in faults_of_device(device).items()
    for fault in faults
]
BORNE = ("lost", "twice", "reordered")
"""Faults of a wire that a streamed robot tolerates with their defaults."""
SAMPLES = [
    Job("egm", "robot", "motors-off"),
    Job("egm", "wire", "off"),
    Job("rtde", "robot", "slider"),
    Job("rtde", "wire", "dropped"),
    *(Job("rtde", "wire", fault) for fault in PACKAGES.faults),
    Job("rtde", "pose", "nan"),
    *(Job("rsi", "wire", fault) for fault in ("off", "corrupted", "garbled", "late")),
    Job("netft", "sensor", "saturated"),
    Job("netft", "sensor", "wrong-scales"),
    Job("ati-can", "sensor", "other-host"),
    Job("ati-can", "bus", "off"),
    Job("ft300", "sensor", "unplugged"),
    Job(CELL, "surface", "hole"),
    Job(CELL, "surface", "hard"),
    Job(CELL, "obstacle", "above"),
    Job(CELL, "computer", "pause"),
]


def settings(job: Job) -> dict[str, Any]:
    if job in OURS:
        return CLOSE_RUN
    chosen = GUIDED
    if job.device in ("rtde", "rsi"):
        chosen = merged(chosen, {"robot": {"emulated": job.device}})
    if job.device in ("netft", "ati-can"):
        chosen = merged(chosen, {"sensor": {"emulated": job.device}, "cell": {"netft": {"rate_hz": 500}}})
    if job.on == "obstacle" or job.device == "rsi":
        # on a longer retraction the tool meets the obstacle, and damaged answers are consecutive
        chosen = {**chosen, "task": {}}
    return chosen


def fault(job: Job) -> dict[str, Any]:
    trigger = {"phase": "connect"} if job.fault == "wrong-scales" else {"phase": "track", "after_s": 0.2}
    return {"on": job.on, "fault": job.fault, "with": PARAMETERS.get((job.on, job.fault), {}), **trigger}


@pytest.mark.parametrize("job", [*OURS, *SAMPLES], ids=lambda job: "-".join(job))
def test_why_names_part_hit_by_fault(job: Job, recordings: Recordings) -> None:
    refused = job.fault == "wrong-scales"  # detected before the tool moves
    recording = recordings(settings(job), faults=[fault(job)], seed=SEED, refused=refused)
    events = [event.text for event in recording.events if event.kind == EventKind.FAULT]
    assert re.match(rf"{job.on}: {job.fault} (\(.*\) )?(begins|happens)", events[0])
    assert re.match(rf"{job.on}: {job.fault} struck [1-9]", events[-1])
    text = why(recording)
    assert "\n" not in text
    assert "{" not in text
    if recording.end["outcome"] == "completed":
        assert job in OURS or job.fault in BORNE, "a run that continues does not test the sentence"
        assert text.startswith("The run completed after ")
        assert text.count(". ") == 0
        return
    cause = recording.end["text"]
    before, _, rest = text.partition(" A fault had been injected on purpose ")
    assert f"{job.on}: {job.fault}" in rest.partition(". ")[0]
    ended = before[before.index("The cause was") :]
    assert cause in ended
    blamed = ended.partition(cause)[0]
    assert BLAMED[job.on] in blamed, text
    assert "Check: " in rest
    if recording.cycles:
        assert "The last good cycle was number " in before
        assert "The tool was " in rest
        assert "hil-bridge free" not in rest, "the emulated cell ended with its run"
    else:
        assert refused
        assert "The tool had not been moved." in rest


@pytest.fixture
def unplugged(recordings: Recordings) -> Path:
    return recordings.path(CLOSE_RUN, faults=[fault(Job("jr3", "sensor-wire", "off"))], seed=SEED)


def output_of(*arguments: str) -> str:
    result = CliRunner().invoke(cli, arguments, catch_exceptions=False)
    assert result.exit_code == 0, result.output
    return result.stdout


def test_why_command_and_report_agree(unplugged: Path, tmp_path: Path) -> None:
    text = why(api.read(unplugged))
    assert output_of("why", str(unplugged)) == text + "\n"
    output_of("report", str(unplugged), "--output", str(tmp_path))
    assert text.partition("`")[0] in unescape((tmp_path / "report.html").read_text(encoding="utf-8"))


def test_why_silence_is_first_symptom(unplugged: Path) -> None:
    recording = api.read(unplugged)
    stop = next(event.at for event in recording.events if event.kind == EventKind.STOP)
    last = max(frame.at for frame in recording.sensors if frame.at <= stop)
    expected = f"The first symptom came {stop - last:.2f} s before that: the last frame of the force sensor."
    assert expected in why(recording)


def test_why_reports_cut_recording(unplugged: Path, tmp_path: Path) -> None:
    cut = tmp_path / "cut.mcap"
    data = unplugged.read_bytes()
    cut.write_bytes(data[: len(data) * 2 // 3])
    text = output_of("why", str(cut))
    assert text.startswith("The recording ends ")
    assert "the process was killed, or the file is cut" in text


def test_why_distinguishes_key_from_signal(recordings: Recordings) -> None:
    recording = recordings(SHORT)
    key = EventRecord(1.0, EventKind.OPERATOR, "requested the end with the key r", Cause.KEY, by="r")
    page = EventRecord(1.0, EventKind.OPERATOR, "requested the end on the page in the browser", Cause.PAGE)
    signal = EventRecord(1.0, EventKind.SIGNAL, "SIGINT", Cause.SIGNAL, by="SIGINT")
    mark = EventRecord(1.0, EventKind.MARK, key.text)
    for events, cause, reported in (
        ((key, signal), Cause.KEY, "the key r"),
        ((page, signal), Cause.PAGE, "the page in the browser"),
        ((signal,), Cause.SIGNAL, "SIGINT"),
        ((mark, signal), Cause.SIGNAL, "SIGINT"),
    ):
        end = {**recording.end, "outcome": "interrupted", "cause": cause, "text": ""}
        text = why(replace(recording, events=events, end=end))
        assert f"It was ended by {reported}." in text
        assert "symptom" not in text or mark in events


def interrupted(settings: Mapping[str, Any], phase: str, after_s: float) -> tuple[Recording, float]:
    """Return a run that is requested to end this long after the start of a phase, and the time of that request, s.

    The time is relative to the start of the run.
    """
    requested: list[float] = []

    async def main() -> api.Simulation:
        async with api.simulation(settings) as running:
            await running.reached(phase)
            await running.clock.sleep_until(running.clock.now() + after_s)
            running.interrupt()
            requested.append(running.clock.now())
        return running

    recording = api.run_virtual(main).result.recording
    return recording, requested[0] - recording.events[0].at


def test_why_interrupted_run_blames_no_device() -> None:
    text = why(interrupted(CLOSE_RUN, "track", 0.0)[0])
    assert text.startswith("The run was interrupted ")
    assert "The cause was" not in text
    assert "The tool was retracted" in text


@pytest.mark.parametrize(
    ("settings", "cycle_s"), [(CLOSE_RUN, 0.2), (GUIDED, 0.02)], ids=["complete cycles", "streamed"]
)
def test_why_interrupt_time_is_its_arrival(settings: Mapping[str, Any], cycle_s: float) -> None:
    recording, requested_s = interrupted(settings, "track", 0.3)
    (ended,) = (cycle for cycle in recording.cycles if cycle.asked)
    before = recording.cycles[ended.cycle - 1]
    values = why_values(recording)
    assert values.after_s == ended.sample.now - recording.events[0].at
    assert 0.0 <= values.after_s - requested_s <= cycle_s
    assert (values.phase, values.step, values.first_symptom) == ("track", "", None)
    assert values.last_good is not None
    assert values.last_good.cycle == before.cycle
    assert values.last_good.before_s == ended.sample.now - before.answered_at
    assert before.phase == "track"
    assert values.text.startswith(
        f"The run was interrupted {values.after_s:.2f} s after its start, in the phase track. "
        f"The last good cycle was number {before.cycle}, {values.last_good.before_s:.2f} s before that: "
    )


def test_why_interrupt_names_program_step() -> None:
    path = {"kind": "line", "to_mm": [20.0, 0.0]}
    steps = [{"do": "approach"}, {"do": "track", "path": path, "speed_mm_s": 10.0}, {"do": "retract"}]
    recording, requested_s = interrupted(merged(GUIDED, {"task": {"step": steps}}), "track", 0.5)
    values = why_values(recording)
    assert 0.0 <= values.after_s - requested_s <= 0.02
    assert (values.phase, values.step) == ("track", "2 (track)")
    assert values.last_good is not None
    assert recording.cycles[values.last_good.cycle + 1].asked
    assert values.text.startswith(
        f"The run was interrupted {values.after_s:.2f} s after its start, in the phase track, in step 2 (track). "
    )


def test_why_interrupt_during_retraction_is_located_there() -> None:
    recording, requested_s = interrupted(CLOSE_RUN, "retract", 0.1)
    values = why_values(recording)
    assert 0.0 <= values.after_s - requested_s <= 0.2
    assert values.phase == "retract"
    assert values.last_good is not None
    assert recording.cycles[values.last_good.cycle].phase == "retract"


def test_why_request_before_first_cycle_uses_event(short: Recording) -> None:
    """No cycle contains it, and the devices close later."""
    begin = short.events[0].at
    key = EventRecord(begin + 0.5, EventKind.OPERATOR, "requested the end with the key r", Cause.KEY, by="r")
    wire = EventRecord(begin + 4.0, EventKind.WIRE_LOST, "the connection broke")
    tare = next(event for event in short.events if event.text == "tare")
    assert tare.at < key.at
    end = RunEnd(Outcome.INTERRUPTED, Reason(Cause.KEY, "before the movement began")).as_metadata()
    values = why_values(replace(short, cycles=(), events=(short.events[0], tare, key, wire), end=end))
    assert (values.after_s, values.phase, values.first_symptom) == (key.at - begin, "tare", None)


def test_why_recording_cut_during_retraction_ends_at_cut() -> None:
    recording, _ = interrupted(CLOSE_RUN, "track", 0.3)
    last = max(event.at for event in recording.events)
    values = why_values(replace(recording, end={}))
    assert values.after_s == last - recording.events[0].at
    assert values.text.startswith(
        f"The recording ends {values.after_s:.2f} s after its start, in the phase retract"
    )


def test_why_retraction_after_stop_is_not_its_phase(unplugged: Path) -> None:
    """In real time the event of the stop comes a few microseconds after the event of the retraction."""
    recording = api.read(unplugged)
    events = [
        replace_struct(event, at=event.at + 5e-5) if event.kind == EventKind.STOP else event
        for event in recording.events
    ]
    late = replace(recording, events=tuple(events))
    assert why_values(late).phase == why_values(recording).phase == "track"


def test_why_program_step_is_named_but_no_symptom() -> None:
    path = {"kind": "line", "to_mm": [20.0, 0.0]}
    steps = [{"do": "approach"}, {"do": "track", "path": path, "speed_mm_s": 10.0}, {"do": "retract"}]
    sensor_off = {"on": "sensor-wire", "fault": "off", "phase": "track", "after_s": 0.3}
    text = why(api.simulate({"task": {"step": steps}}, faults=[sensor_off], seed=3).recording)
    assert "the last frame of the force sensor" in text
    assert "in step 2 (track)" in text


def ended_by(recording: Recording, reason: Reason) -> str:
    """Return the paragraph of a run with this end."""
    end = RunEnd(Outcome.STOPPED, reason, left="retracted, 0.0 N", place="retracted, 0.0 N").as_metadata()
    return why(replace(recording, end=end))


@pytest.fixture
def short(recordings: Recordings) -> Recording:
    return recordings(SHORT)


@pytest.mark.parametrize(
    ("cause", "text", "part", "remedy"),
    [
        (Cause.OSCILLATION, "the force continues to oscillate by ±4.0 N", "controller", "[oscillation]"),
        (Cause.INCONSISTENT, "requested depth and position differ", "the program itself", "bug report"),
        (Cause.NO_PROGRESS, "a lateral force of 9.0 N holds the feed", "what the tool touches", "next to"),
        (Cause.NO_EDGE, "no edge within 10 mm", "the surface", "at_most_mm"),
        (Cause.PLACE_UNKNOWN, "the robot does not report where the tool was left", "the link", "cable"),
    ],
)
def test_why_unmatched_cause_names_part_and_remedy(
    short: Recording, cause: Cause, text: str, part: str, remedy: str
) -> None:
    """Causes are compared, not texts: these texts match no known pattern."""
    reported = ended_by(short, Reason(cause, text))
    blamed, _, rest = reported.partition(f": {text}.")
    assert part in blamed[blamed.index("The cause was ") :]
    assert remedy in rest[rest.index("Check: ") :]


@pytest.mark.parametrize(
    ("cause", "text", "message"),
    [
        (
            Cause.FORCE_TOO_OLD,
            "the newest force is 260 ms old",
            " just before. That, or the force sensor (jr3), ended it: ",
        ),
        (Cause.FORCE, "the force is 60 N", ": the force is 60 N. This computer was late"),
    ],
)
def test_why_names_late_computer(short: Recording, cause: Cause, text: str, message: str) -> None:
    """A late computer looks like a silent sensor; it does not look like another surface, but may have affected its
    force.
    """
    in_time = ended_by(short, Reason(cause, text))
    late = ended_by(short, Reason(cause, text, late_s=0.259))
    assert "late by" not in in_time
    assert "This computer was late by up to 259 ms just before." in late
    assert message in late
    assert "what else runs on that computer" in late


@pytest.mark.parametrize("late_s", [0.0, 0.259])
def test_run_end_records_lateness_of_computer(monkeypatch: pytest.MonkeyPatch, late_s: float) -> None:
    """Cause, record and summary contain it. Virtual time is never late, so the clock's lateness is injected."""
    monkeypatch.setattr(Heartbeat, "recent", lambda *_: late_s)
    sensor_off = {"on": "sensor-wire", "fault": "off", "phase": "track", "after_s": 0.1}
    result = api.simulate({"run": {"duration_s": 1.0}}, faults=[sensor_off])
    reason = reason_of(result.recording.end)
    assert reason is not None
    assert reason.cause is Cause.FORCE_TOO_OLD
    assert reason.late_s == summarise(result.recording).late_s == late_s
    assert ("this computer was late by up to 259 ms" in summarise(result.recording).text) == bool(late_s)


@pytest.mark.parametrize(
    ("urls", "can_lift"), [(("", ""), False), (("tcp://h:1", ""), False), (("tcp://h:1", "udp://h:2"), True)]
)
def test_why_suggests_free_only_for_a_lasting_cell(
    short: Recording, urls: tuple[str, str], can_lift: bool
) -> None:
    """An emulated device ends with the run, so nothing can lift its tool afterwards."""
    end = RunEnd(
        Outcome.STOPPED, Reason(Cause.FORCE, "60 N"), place="NOT retracted", rest={"retracted": False}
    )
    robot, sensor = urls
    config = json.dumps({"robot": {"url": robot}, "sensor": {"url": sensor}})
    recording = replace(short, end=end.as_metadata(), metadata={**short.metadata, "config": config})
    assert ("hil-bridge free" in why(recording)) is can_lift


@pytest.fixture
def motors_off(recordings: Recordings) -> Recording:
    """Return a run of an EGM robot whose motors went off."""
    job = Job("egm", "robot", "motors-off")
    return recordings(settings(job), faults=[fault(job)], seed=SEED)


@pytest.mark.parametrize("host", ["plain", "lost-and-found", "closed", "noise", "workspace", "link-stopped"])
def test_why_host_name_blames_nothing(motors_off: Recording, host: str) -> None:
    """Motors that go off are blamed on the robot, whatever its URL contains."""
    cause = reason_of(motors_off.end)
    assert cause is not None
    assert ROWS[cause.cause].part is Part.ROBOT
    assert "the motors are off" in cause.text
    message = f"robot on udp://{host}:6510 cannot move: the motors are off"
    text = why(replace(motors_off, end={**motors_off.end, "text": message}))
    assert "The cause was the robot (egm): " in text
    assert "the link to" not in text
    assert "the path" not in text
