"""Tests of the emulated controller's panel: states, stored programs, and requests."""

import itertools
import json
import math
from contextlib import suppress

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from emulators.devices.s3 import (
    CHANGES,
    S3_FAULTS,
    Activity,
    MoveStep,
    S3Profile,
    State,
    Stimulus,
    WaitStep,
    read_steps,
    refusal,
)
from protocol.devices.s3.arap import (
    Mode,
    MoveKind,
    Refused,
    SpontaneousReceived,
    read_status,
    start_program,
    write_mode,
)
from tests.emulation.s3_bench import BEGIN, OPERATION, POINT, PROFILE, RUN, STANDBY, STOP, Bench, move

FAULTS = {name: fault for faults in S3_FAULTS.values() for name, fault in faults.items()}


# --- states


ORDERS = {
    "point": POINT,
    "begin": BEGIN,
    "run": RUN,
    "stop": STOP,
    "standby": STANDBY,
    "operation": OPERATION,
}
REFUSED_IN: dict[str, tuple[dict[str, object], dict[str, int]]] = {
    "ready": ({}, {"point": 15}),
    "in a sequence": ({"activity": Activity.SEQUENCE}, {"run": 31}),
    "in a program": ({"activity": Activity.PROGRAM}, {"point": 1, "begin": 1, "run": 1}),
    "standby": ({"mode": Mode.STANDBY}, {"point": 6, "begin": 6, "run": 6}),
    "synchronise": ({"mode": Mode.SYNCHRONISE}, {"point": 6, "begin": 6, "run": 6}),
    "both": ({"mode": Mode.OPERATION_SYNCHRONISE}, {"point": 15}),
    "emergency stop": (
        {"mode": Mode.STANDBY, "emergency_stop": True},
        {"point": 13, "begin": 13, "run": 13, "operation": 13},
    ),
    "work stop": ({"work_stop": True}, {"point": 16, "begin": 16, "run": 16}),
    "key in MANUAL": ({"key_auto": False}, {"point": 5, "begin": 5, "run": 5, "operation": 5}),
    "no link control": ({"link_control": False}, dict.fromkeys(ORDERS, 5)),
    "programming unit": ({"programming_unit": True, "interrupt_permitted": True}, {"point": 15}),
}


@pytest.mark.parametrize("name", REFUSED_IN)
def test_refusals_by_state(name: str) -> None:
    """Taken from the specification's section 3, order by order."""
    values, expected = REFUSED_IN[name]
    state = State(**{"mode": Mode.OPERATION, "link_control": True, **values})  # type: ignore[arg-type]
    refused = {
        order: code
        for order, telegram in ORDERS.items()
        if (code := refusal(state, telegram.function, telegram.suffix, PROFILE)) is not None
    }
    assert refused == expected
    assert refusal(state, read_status().function, 0, PROFILE) is None


def test_every_stimulus_has_row() -> None:
    assert set(CHANGES) == set(Stimulus)


LEVERS = ("emergency-stop", "key", "link-control", "work-stop", "programming-unit", "interrupt")
TO = {
    "emergency-stop": ("press", "release"),
    "key": ("manual", "auto"),
    "link-control": ("take", "give"),
    "work-stop": ("on", "off"),
    "programming-unit": ("connect", "remove"),
    "interrupt": ("permit", "forbid"),
}
FLAGS = {
    "emergency-stop": ("emergency_stop", True),
    "key": ("key_auto", False),
    "link-control": ("local", True),
    "programming-unit": ("programming_unit", True),
    "interrupt": ("interrupt_permitted", True),
}


@pytest.mark.parametrize("lever", LEVERS)
def test_each_control_shows_in_status_and_panel(lever: str) -> None:
    bench = Bench()
    before = bench.status()
    displayed = bench.panel.perform({"do": lever, "to": TO[lever][0]}, bench.now)["state"]
    bench.wait(5.0)
    if lever in FLAGS:
        flag, value = FLAGS[lever]
        assert getattr(bench.status(), flag) is value is not getattr(before, flag)
        assert displayed["flags"][flag] is value
    else:
        assert displayed["flags"]["work_stop"] is True
    bench.panel.perform({"do": lever, "to": TO[lever][1]}, bench.now)
    assert bench.status() == before


@pytest.mark.parametrize(("lever", "code"), [("emergency-stop", 13), ("work-stop", 16), ("key", 5)])
def test_halting_control_stops_arm_and_ends_sequence(lever: str, code: int) -> None:
    bench = Bench().moving()
    bench.wait(1.0)
    bench.panel.perform({"do": lever, "to": TO[lever][0]}, bench.now)
    begun = bench.true_position[1]
    bench.wait(1.0)
    stopped_at = bench.true_position[1]
    assert 0.0 < stopped_at - begun < 0.006, "two ticks and the loop's lag at 50 mm/s"
    bench.wait(1.0)
    assert bench.true_position[1] == stopped_at
    assert bench.code(POINT) == code
    bench.panel.perform({"do": lever, "to": TO[lever][1]}, bench.now)
    assert bench.accepts(OPERATION)
    assert bench.code(POINT) == 15, "a sequence has to be started again"


def test_removed_link_control_lets_motion_continue() -> None:
    bench = Bench().moving()
    bench.robot.set_link_control(False, bench.now)
    bench.wait(10.0)
    assert bench.true_position[1] == pytest.approx(0.3, abs=1e-4)
    assert bench.code(STOP) == 5


def test_repeated_emergency_stop_is_reported_once() -> None:
    bench = Bench()
    for _ in range(3):
        bench.robot.press_emergency_stop(bench.now)
        bench.wait(1.0)
    assert [e.spontaneous.text for e in bench.events if isinstance(e, SpontaneousReceived)] == [
        "operational error 13.0"
    ]


@pytest.mark.parametrize("kind", [MoveKind.POINT, MoveKind.END])
def test_point_answered_when_reached_is_judged_under_way(kind: MoveKind) -> None:
    bench = Bench(S3Profile(move_reply="reached")).operation()
    assert bench.accepts(BEGIN)
    assert bench.accepts(move(kind, -0.08)), "also the end, after which no sequence is open"
    assert bench.true_position[1] == pytest.approx(-0.08, abs=1e-4)
    assert bench.accepts(BEGIN)
    bench.host.order(move(kind, 0.3))
    bench.wait(1.0)
    bench.robot.set_key(False, bench.now)
    bench.wait(1.0)
    assert [event.refusal.code for event in bench.events if isinstance(event, Refused)] == [5]


# --- stored programs


LINES = b"""# emulated program
move 900 -50 600 100   # 0.5 s
wait 1.5

move 900 -50 620 100   # 0.2 s
"""


def test_program_moves_waits_and_counts_instructions() -> None:
    bench = Bench(p7=LINES).operation()
    assert bench.accepts(start_program(7))
    observed = []
    for _ in range(60):
        status = bench.status()
        observed.append((status.program, status.instruction, status.execution))
        bench.wait(0.05)
    assert [key for key, _ in itertools.groupby(observed)] == [
        (7, 1, True),
        (7, 2, True),
        (7, 3, True),
        (7, 3, False),
    ]
    assert bench.status().position == pytest.approx((0.9, -0.05, 0.62))
    assert bench.code(start_program(7, from_start=False)) == 31, "nothing is left to continue"


def test_stopped_program_resumes_or_restarts() -> None:
    bench = Bench(p7=LINES).operation()
    assert bench.accepts(start_program(7))
    bench.wait(1.0)
    assert bench.accepts(STOP)
    bench.wait(5.0)
    stopped = bench.status()
    assert (stopped.instruction, stopped.execution) == (2, False)
    assert bench.accepts(start_program(7, from_start=False))
    bench.wait(1.4)
    assert bench.status().instruction == 2, "the wait restarted"
    bench.wait(0.2)
    assert bench.status().instruction == 3
    assert bench.accepts(STOP)
    assert bench.accepts(start_program(7))
    assert bench.status().instruction == 1
    assert bench.code(start_program(1, from_start=False)) == 1


def test_interrupted_program_ends_at_its_point() -> None:
    bench = Bench(p7=b"# emulated program\nmove 900 200 600 100\n").operation()
    assert bench.accepts(start_program(7))
    bench.wait(1.0)
    bench.robot.press_emergency_stop(bench.now)
    bench.wait(1.0)
    assert -0.05 < bench.status().position[1] < 0.05
    bench.robot.release_emergency_stop(bench.now)
    assert bench.accepts(OPERATION)
    assert bench.accepts(start_program(7, from_start=False))
    bench.wait(3.0)
    assert bench.status().position[1] == pytest.approx(0.2)


def test_unknown_or_empty_program_takes_its_time() -> None:
    bench = Bench(S3Profile(program_s=2.0), p9=b"\x03\xff\x00anything").operation()
    for number in (1, 9):
        assert bench.accepts(start_program(number))
        bench.wait(1.9)
        assert bench.status().execution
        bench.wait(0.2)
        assert not bench.status().execution


def test_program_leaving_work_area_ends_with_error() -> None:
    bench = Bench(p7=b"# emulated program\nmove 3000 0 0 100\nwait 1\n").operation()
    assert bench.accepts(start_program(7))
    bench.wait(1.0)
    assert [e.spontaneous.text for e in bench.events if isinstance(e, SpontaneousReceived)] == [
        "operational error 15.0"
    ]
    assert not bench.status().execution


def test_program_text_is_parsed_strictly() -> None:
    assert read_steps(LINES) == (
        MoveStep((0.9, -0.05, 0.6), 0.1),
        WaitStep(1.5),
        MoveStep((0.9, -0.05, 0.62), 0.1),
    )
    assert read_steps(b"move 1 2 3 4\n") is None
    assert read_steps(b"# emulated program\r\nwait 2\r\n") == (WaitStep(2.0),)
    for line in ("wait", "wait -1", "wait inf", "move 1 2 3", "move 1 2 3 0", "move 1 nan 3 4", "dance 1"):
        with pytest.raises(ValueError, match="line 3: expected"):
            read_steps(f"# emulated program\nwait 1\n{line}\n".encode())
    with pytest.raises(ValueError, match="1 to 65535 steps"):
        read_steps(b"# emulated program\n# nothing\n")
    with pytest.raises(ValueError, match="program 7: line 2"):
        Bench(p7=b"# emulated program\njump\n")


# --- the panel


def test_panel_shows_available_controls() -> None:
    bench = Bench().moving()
    bench.code(write_mode(4))  # type: ignore[arg-type]
    bench.wait(1.0)
    displayed = bench.panel.perform({"do": "show"}, bench.now)["state"]
    assert displayed["mode"] == "operation"
    assert displayed["activity"] == "movement sequence"
    assert [flag for flag, on in displayed["flags"].items() if on] == ["key_auto", "operation", "execution"]
    assert (displayed["points_waiting"], displayed["queue_depth"]) == (1, 4)
    assert displayed["position_mm"][1] == pytest.approx(-54.0, abs=3.0)
    assert displayed["joints_deg"][0] == pytest.approx(math.degrees(math.atan2(-54.0, 900.0)), abs=0.2)
    assert (displayed["answered"], displayed["refused"], displayed["lost"]) == (4, 1, 0)
    assert displayed["last_refusal"] == "write mode: 2 wrong function suffix"
    json.dumps(displayed)


def test_show_changes_nothing() -> None:
    observed, unseen = Bench().moving(), Bench().moving()
    for _ in range(200):
        observed.now += 0.0071
        observed.panel.show(observed.now)
    unseen.now = observed.now
    times = np.linspace(observed.now - 1.5, observed.now, 300)
    assert np.array_equal(
        observed.robot.motion.path.trajectory(times)[0], unseen.robot.motion.path.trajectory(times)[0]
    )
    assert observed.status() == unseen.status()


@pytest.mark.parametrize(
    ("request_", "text"),
    [
        ({}, "unknown action None; known: show, emergency-stop, key"),
        ({"do": ["show"]}, "unknown action"),
        ({"do": "key"}, "key goes to auto or manual, not None"),
        ({"do": "key", "to": {}}, "key goes to"),
        ({"do": "inject"}, "needs the name of a fault"),
        ({"do": "inject", "fault": "refuses", "with": 3}, "table of parameters"),
        ({"do": "inject", "fault": "flood"}, "unknown fault 'flood'; known: emergency-stop"),
        (
            {"do": "inject", "fault": "refuses", "with": {"cod": 1}},
            "refuses has no parameter 'cod'; known: code",
        ),
        (
            {"do": "inject", "fault": "refuses", "with": {"code": 65536}},
            "refuses: code must be a number of 0 … 65535",
        ),
        ({"do": "inject", "fault": "refuses", "with": {"code": 1.5}}, "whole number"),
        ({"do": "inject", "fault": "refuses", "with": {"code": True}}, "must be a number"),
        (
            {"do": "inject", "fault": "late-answer", "with": {"seconds": "nan"}},
            "must be a number of 0 … ",
        ),
        ({"do": "inject", "fault": "late-answer", "with": {"seconds": 10**400}}, "must be a number"),
        ({"do": "inject", "fault": "drop-ack", "with": {"of": "all"}}, "must be block or bid"),
    ],
)
def test_invalid_request_is_refused(request_: dict[str, object], text: str) -> None:
    bench = Bench()
    with pytest.raises(ValueError, match=r"^[^\n]+$") as error:
        bench.panel.perform(request_, bench.now)
    assert text in str(error.value)


JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=2) | st.dictionaries(st.text(max_size=5), inner, max_size=2),
    max_leaves=4,
)
REQUESTS = st.fixed_dictionaries(
    {},
    optional={
        "do": st.sampled_from(("show", "inject", "disarm", "mend", "faults", *LEVERS)) | JSON,
        "to": st.sampled_from([to for pair in TO.values() for to in pair]) | JSON,
        "fault": st.sampled_from(sorted(FAULTS)) | JSON,
        "with": JSON
        | st.dictionaries(
            st.sampled_from(sorted({key for fault in FAULTS.values() for key in fault.parameters})),
            JSON | st.sampled_from(("block", "bid")),
            max_size=2,
        ),
    },
)


@pytest.mark.full
@settings(max_examples=150, deadline=None)
@given(st.lists(REQUESTS, max_size=6))
def test_controller_recovers_after_any_requests(requests: list[dict[str, object]]) -> None:
    bench = Bench(S3Profile(start_up_s=1.0)).moving()
    for request in requests:
        with suppress(ValueError):
            json.dumps(bench.panel.perform(request, bench.now))
        bench.wait(0.05)
    bench.panel.perform({"do": "mend"}, bench.now)
    for lever, (_, back) in TO.items():
        bench.panel.perform({"do": lever, "to": back}, bench.now)
    bench.panel.perform({"do": "inject", "fault": "power-cycle"}, bench.now)
    bench.wait(4000.0)
    assert bench.panel.perform({"do": "disarm"}, bench.now)["state"]["armed"] == {}
    assert bench.status().standby
