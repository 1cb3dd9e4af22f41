"""The emulated controller as people find it at its panel: states, stored programs, and every fault on purpose.

The host here is the project's own, over a wire without delay: what counts is how it lives through each fault.
"""

import itertools
import json
import math
from collections.abc import Iterator
from contextlib import suppress

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from emulators.devices.s3 import (
    CHANGES,
    S3_CONTROLS,
    S3_FAULTS,
    Activity,
    MoveStep,
    S3Controller,
    S3Profile,
    S3Profiles,
    S3Site,
    State,
    Stimulus,
    WaitStep,
    read_state,
    read_steps,
    refusal,
)
from emulators.panel import Panel
from emulators.seams import StartPose
from protocol.devices.s3.adlp import LinkProfile
from protocol.devices.s3.arap import (
    Answered,
    ArapEvent,
    ArapHost,
    Mode,
    Move,
    MoveKind,
    OrderFailed,
    Refused,
    SpontaneousReceived,
    Status,
    Telegram,
    read_status,
    start_program,
    stop_program,
    write_mode,
)

FAULTS = {name: fault for faults in S3_FAULTS.values() for name, fault in faults.items()}
T0 = 4000.375
START = (0.9, -0.1, 0.6)
DOWN = (0.0, 1.0, 0.0, 0.0)
PROFILE = S3Profile()


class Bench:
    """A controller, its panel and a host."""

    def __init__(self, profile: S3Profile = PROFILE, **programs: bytes) -> None:
        site = S3Site(programs={int(name.removeprefix("p")): text for name, text in programs.items()})
        self.now = T0
        self.robot = S3Controller(S3Profiles(profile), StartPose(START, DOWN, 0.2), T0, 1, site)
        self.panel = Panel(self.robot, S3_CONTROLS, self.robot.faults)
        self.host = ArapHost(LinkProfile())
        self.told: list[ArapEvent] = []
        self.to_host = bytearray()
        """Everything that the controller has said."""

    def exchange(self) -> None:
        """Carry bytes to and fro until neither has more to say."""
        while True:
            to_robot = self.host.data_to_send(self.now)
            if to_robot:
                self.robot.endpoint.receive(to_robot, self.now)
            to_host = self.robot.endpoint.data_to_send(self.now)
            if to_host:
                self.to_host += to_host
                self.host.receive(to_host, self.now)
            while (event := self.host.next_event()) is not None:
                self.told.append(event)
            if not to_robot and not to_host:
                return

    def steps(self, seconds: float) -> Iterator[None]:
        """Every moment at which something happens within a time."""
        end = self.now + seconds
        self.exchange()
        yield
        while True:
            due = [
                at
                for at in (self.robot.endpoint.next_deadline(), self.host.next_deadline())
                if at is not None
            ]
            if not due or min(due) > end:
                self.now = end
                return
            self.now = max(self.now, min(due))
            self.robot.endpoint.handle_deadline(self.now)
            self.host.handle_deadline(self.now)
            self.exchange()
            yield

    def wait(self, seconds: float) -> None:
        for _ in self.steps(seconds):
            pass

    def ask(self, order: Telegram, within: float = 60.0) -> Answered | Refused | OrderFailed:
        self.host.order(order)
        for _ in self.steps(within):
            for event in self.told:
                if isinstance(event, Answered | Refused | OrderFailed):
                    self.told.remove(event)
                    return event
        raise AssertionError("no answer")

    def accepts(self, order: Telegram) -> bool:
        return isinstance(self.ask(order), Answered)

    def code(self, order: Telegram) -> int:
        answer = self.ask(order)
        assert isinstance(answer, Refused)
        return answer.refusal.code

    def status(self) -> Status:
        answer = self.ask(read_status())
        assert isinstance(answer, Answered)
        return Status.from_telegram(answer.answer)

    def count(self, name: str) -> int:
        return self.host.link.counters[name]

    def operation(self) -> "Bench":
        assert self.accepts(write_mode(Mode.OPERATION))
        return self

    def moving(self, y: float = 0.3, speed: float = 0.05) -> "Bench":
        """In the middle of a movement sequence, on the way to y, m."""
        assert self.operation().accepts(move(MoveKind.START))
        assert self.accepts(move(MoveKind.POINT, y, speed))
        return self

    @property
    def true_position(self) -> list[float]:
        return self.robot.motion.path.trajectory(np.array([self.now]))[0][0].tolist()


def move(kind: MoveKind, y: float = -0.1, speed: float = 0.05) -> Telegram:
    if kind is MoveKind.START:
        return Move(kind).to_telegram()
    return Move(kind, (0.9, y, 0.6), DOWN, speed).to_telegram()


# --- states


POINT, BEGIN = move(MoveKind.POINT), move(MoveKind.START)
RUN, STOP, STANDBY, OPERATION = (
    start_program(1),
    stop_program(),
    write_mode(Mode.STANDBY),
    write_mode(Mode.OPERATION),
)
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
def test_what_is_refused_in_which_state(name: str) -> None:
    """Read off the specification's section 3, order by order."""
    values, expected = REFUSED_IN[name]
    state = State(**{"mode": Mode.OPERATION, "link_control": True, **values})  # type: ignore[arg-type]
    refused = {
        order: code
        for order, telegram in ORDERS.items()
        if (code := refusal(state, telegram.function, telegram.suffix, PROFILE)) is not None
    }
    assert refused == expected
    assert refusal(state, read_status().function, 0, PROFILE) is None


def test_every_stimulus_has_its_row() -> None:
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
def test_each_lever_shows_in_status_and_panel_and_goes_back(lever: str) -> None:
    bench = Bench()
    before = bench.status()
    shown = bench.panel.perform({"do": lever, "to": TO[lever][0]}, bench.now)["state"]
    bench.wait(5.0)
    if lever in FLAGS:
        flag, value = FLAGS[lever]
        assert getattr(bench.status(), flag) is value is not getattr(before, flag)
        assert shown["flags"][flag] is value
    else:
        assert shown["flags"]["work_stop"] is True
    bench.panel.perform({"do": lever, "to": TO[lever][1]}, bench.now)
    assert bench.status() == before


@pytest.mark.parametrize(("lever", "code"), [("emergency-stop", 13), ("work-stop", 16), ("key", 5)])
def test_what_halts_stops_the_arm_at_once_and_ends_the_sequence(lever: str, code: int) -> None:
    bench = Bench().moving()
    bench.wait(1.0)
    bench.panel.perform({"do": lever, "to": TO[lever][0]}, bench.now)
    begun = bench.true_position[1]
    bench.wait(1.0)
    stood = bench.true_position[1]
    assert 0.0 < stood - begun < 0.006, "two ticks and the loop's lag at 50 mm/s"
    bench.wait(1.0)
    assert bench.true_position[1] == stood
    assert bench.code(POINT) == code
    bench.panel.perform({"do": lever, "to": TO[lever][1]}, bench.now)
    assert bench.accepts(OPERATION)
    assert bench.code(POINT) == 15, "a sequence has to be started again"


def test_link_control_taken_away_lets_what_moves_go_on() -> None:
    bench = Bench().moving()
    bench.robot.set_link_control(False, bench.now)
    bench.wait(10.0)
    assert bench.true_position[1] == pytest.approx(0.3, abs=1e-4)
    assert bench.code(STOP) == 5


def test_the_emergency_stop_is_told_once_however_often_it_is_pressed() -> None:
    bench = Bench()
    for _ in range(3):
        bench.robot.press_emergency_stop(bench.now)
        bench.wait(1.0)
    assert [e.spontaneous.text for e in bench.told if isinstance(e, SpontaneousReceived)] == [
        "operational error 13.0"
    ]


@pytest.mark.parametrize("kind", [MoveKind.POINT, MoveKind.END])
def test_a_point_answered_when_reached_is_judged_on_the_way(kind: MoveKind) -> None:
    bench = Bench(S3Profile(move_reply="reached")).operation()
    assert bench.accepts(BEGIN)
    assert bench.accepts(move(kind, -0.08)), "also the end, after which no sequence is open"
    assert bench.true_position[1] == pytest.approx(-0.08, abs=1e-4)
    assert bench.accepts(BEGIN)
    bench.host.order(move(kind, 0.3))
    bench.wait(1.0)
    bench.robot.set_key(False, bench.now)
    bench.wait(1.0)
    assert [event.refusal.code for event in bench.told if isinstance(event, Refused)] == [5]


# --- stored programs


LINES = b"""# emulated program
move 900 -50 600 100   # 0.5 s
wait 1.5

move 900 -50 620 100   # 0.2 s
"""


def test_a_program_moves_waits_and_counts_its_instructions() -> None:
    bench = Bench(p7=LINES).operation()
    assert bench.accepts(start_program(7))
    seen = []
    for _ in range(60):
        status = bench.status()
        seen.append((status.program, status.instruction, status.execution))
        bench.wait(0.05)
    assert [key for key, _ in itertools.groupby(seen)] == [
        (7, 1, True),
        (7, 2, True),
        (7, 3, True),
        (7, 3, False),
    ]
    assert bench.status().position == pytest.approx((0.9, -0.05, 0.62))
    assert bench.code(start_program(7, from_start=False)) == 31, "nothing is left to continue"


def test_a_stopped_program_goes_on_where_it_was_or_begins_anew() -> None:
    bench = Bench(p7=LINES).operation()
    assert bench.accepts(start_program(7))
    bench.wait(1.0)
    assert bench.accepts(STOP)
    bench.wait(5.0)
    stopped = bench.status()
    assert (stopped.instruction, stopped.execution) == (2, False)
    assert bench.accepts(start_program(7, from_start=False))
    bench.wait(1.4)
    assert bench.status().instruction == 2, "the wait began anew"
    bench.wait(0.2)
    assert bench.status().instruction == 3
    assert bench.accepts(STOP)
    assert bench.accepts(start_program(7))
    assert bench.status().instruction == 1
    assert bench.code(start_program(1, from_start=False)) == 1


def test_a_program_interrupted_in_mid_line_ends_at_its_point() -> None:
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


def test_a_program_of_a_real_controller_or_of_none_takes_its_time() -> None:
    bench = Bench(S3Profile(program_s=2.0), p9=b"\x03\xff\x00anything").operation()
    for number in (1, 9):
        assert bench.accepts(start_program(number))
        bench.wait(1.9)
        assert bench.status().execution
        bench.wait(0.2)
        assert not bench.status().execution


def test_a_program_that_leaves_the_work_area_ends_with_an_error() -> None:
    bench = Bench(p7=b"# emulated program\nmove 3000 0 0 100\nwait 1\n").operation()
    assert bench.accepts(start_program(7))
    bench.wait(1.0)
    assert [e.spontaneous.text for e in bench.told if isinstance(e, SpontaneousReceived)] == [
        "operational error 15.0"
    ]
    assert not bench.status().execution


def test_program_text_is_read_strictly() -> None:
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


# --- faults


def test_every_fault_has_a_hand_that_takes_its_parameters() -> None:
    bench = Bench()
    handled = {target: set(handlers) for target, handlers in bench.robot.handlers.items()}
    assert handled == {target: set(faults) for target, faults in S3_FAULTS.items()}
    for target, faults in S3_FAULTS.items():
        for name, fault in faults.items():
            for parameter in fault.parameters.values():
                assert parameter.check(parameter.default) == parameter.default
            bench.robot.faults.inject(target, name, bench.now, dict.fromkeys(fault.amounts, 1.0))
    with pytest.raises(ValueError, match=r"^late is a fault of pose and of wire; name its target$"):
        bench.robot.inject("late", bench.now)


LIVED_THROUGH: dict[str, tuple[dict[str, object], str, float]] = {
    "drop-ack": ({}, "messages failed", 0.22),
    "drop-ack of a bid": ({"of": "bid"}, "bid repeated", 2.0),
    "nak-block": ({}, "NAK received", 0.22),
    "corrupt-block": ({}, "NAK sent", 0.0),
    "lose-eot": ({}, "missing EOT", 0.22),
    "late-answer": ({"seconds": 4.0}, "", 4.0),
    "babble": ({"count": 30}, "noise", 2.0),
    "off": ({"for_s": 1.0}, "bid repeated", 2.0),
    "line-break": ({"for_s": 1.0}, "noise bytes", 2.0),
}


@pytest.mark.parametrize("name", LIVED_THROUGH)
def test_a_fault_is_lived_through_counted_and_over(name: str) -> None:
    parameters, counter, seconds = LIVED_THROUGH[name]
    bench = Bench()
    first = bench.status()
    bench.robot.inject(name.partition(" ")[0], bench.now, **parameters)
    asked = bench.now
    assert bench.status() == first
    assert seconds <= bench.now - asked < seconds + 0.6
    bench.wait(1.0)
    if counter:
        assert bench.count(counter) > 0
    assert bench.robot.armed == {}
    troubles, asked = dict(bench.host.link.counters), bench.now
    assert bench.status() == first
    assert bench.now - asked < 0.02
    if counter:
        assert bench.count(counter) == troubles[counter], "once is once"


def test_what_waits_for_its_moment_can_be_called_off() -> None:
    bench = Bench()
    for fault, row in (*LIVED_THROUGH.items(), ("refuses", ({}, "", 0.0))):
        if fault not in ("babble", "off", "line-break"):
            bench.robot.inject(fault.partition(" ")[0], bench.now, **row[0])
    bench.robot.inject("power-cycle", bench.now, after_bytes=1)
    assert len(bench.robot.armed) == 8
    bench.robot.disarm()
    asked = bench.now
    assert bench.status().standby
    assert bench.now - asked < 0.02
    assert not any(bench.count(name) for name in ("time-out", "NAK sent", "NAK received", "missing EOT"))


def test_a_fault_of_several_strikes_as_often() -> None:
    bench = Bench()
    bench.robot.inject("corrupt-block", bench.now, count=3)
    assert bench.robot.armed == {"corrupt-block": 3}
    bench.status()
    assert bench.count("NAK sent") == 3


def test_a_block_is_damaged_from_the_next_message_on() -> None:
    bench = Bench()
    order = bytes.fromhex("10 02 00 08 01 00 13 01 00 00 10 03 18")
    bench.robot.endpoint.receive(b"\x05" + order[:4], T0)
    assert bench.robot.endpoint.data_to_send(T0) == b"\x06"
    bench.robot.inject("nak-block", T0)
    bench.robot.endpoint.receive(order[4:], T0)
    assert bench.robot.endpoint.data_to_send(T0) == b"\x06", "it was under way"
    bench.robot.endpoint.receive(b"\x04", T0)
    assert bench.robot.armed
    for byte in b"\x05" + order:
        bench.robot.endpoint.receive(bytes((byte,)), T0 + 0.001)
    bench.robot.endpoint.handle_deadline(T0 + 0.001)
    assert bench.robot.endpoint.data_to_send(T0 + 0.001) == b"\x06"
    bench.robot.endpoint.handle_deadline(T0 + 0.3)
    assert bench.robot.endpoint.data_to_send(T0 + 0.3) == b"\x15"


def test_the_next_order_of_a_function_is_refused_with_the_code() -> None:
    bench = Bench().operation()
    bench.robot.inject("refuses", bench.now, code=12, function=20)
    assert bench.status()
    assert bench.code(OPERATION) == 12
    assert bench.accepts(OPERATION)
    bench.robot.inject("refuses", bench.now)
    assert bench.code(read_status()) == 31
    assert read_state(bench.robot, bench.now).last_refusal == "read status: 31 not possible to proceed"


def test_a_spontaneous_message_is_told_as_asked_for() -> None:
    bench = Bench()
    bench.robot.inject("spontaneous", bench.now, kind=7, x=40, y=2)
    bench.wait(1.0)
    assert [e.spontaneous.text for e in bench.told if isinstance(e, SpontaneousReceived)] == [
        "system error 40.2"
    ]


@pytest.mark.parametrize(("eot", "missing"), [("always", 0), ("never", 40), ("sometimes", 20)])
def test_a_spontaneous_message_may_lack_its_eot_and_others_never_do(eot: str, missing: int) -> None:
    bench = Bench(S3Profile(spontaneous_eot=eot))  # type: ignore[arg-type]
    for _ in range(40):
        bench.robot.inject("spontaneous", bench.now)
        bench.wait(1.0)
    assert bench.count("missing EOT") == pytest.approx(missing, abs=10 if eot == "sometimes" else 0)
    before = bench.count("missing EOT")
    bench.status()
    assert bench.count("missing EOT") == before
    assert sum(isinstance(e, SpontaneousReceived) for e in bench.told) == 40


def test_a_power_cycle_is_silence_then_a_fresh_controller() -> None:
    bench = Bench(S3Profile(start_up_s=3.0)).moving()
    bench.wait(1.0)
    bench.robot.press_emergency_stop(bench.now)
    bench.robot.inject("power-cycle", bench.now)
    said = len(bench.to_host)
    shown = read_state(bench.robot, bench.now)
    assert (shown.mode, shown.points_waiting) == ("starting", 0)
    bench.robot.inject("spontaneous", bench.now)
    bench.wait(2.99)
    assert len(bench.to_host) == said
    bench.wait(0.02)
    assert read_state(bench.robot, bench.now).mode == "standby"
    status = bench.status()
    assert (status.standby, status.emergency_stop) == (False, True), "a latched button stays"
    bench.robot.release_emergency_stop(bench.now)
    assert bench.operation().code(POINT) == 15
    bench.wait(10.0)
    assert not any(isinstance(event, SpontaneousReceived) for event in bench.told)


def test_an_order_without_answer_is_dropped_at_a_power_cycle() -> None:
    bench = Bench(S3Profile(start_up_s=0.001))
    bench.host.order(OPERATION)
    bench.exchange()
    bench.robot.inject("power-cycle", bench.now)
    said = len(bench.to_host)
    bench.wait(1.0)
    assert len(bench.to_host) == said
    assert read_state(bench.robot, bench.now).mode == "standby"


def test_a_block_is_damaged_after_a_power_cycle_in_the_middle_of_one() -> None:
    bench = Bench(S3Profile(start_up_s=0.001))
    bench.robot.inject("nak-block", T0)
    bench.robot.endpoint.receive(bytes.fromhex("05 10 02 00 08 01"), T0)
    assert bench.robot.endpoint.data_to_send(T0) == b"\x06"
    bench.robot.inject("power-cycle", T0)
    bench.now = T0 + 1.0
    bench.robot.endpoint.handle_deadline(bench.now)
    bench.status()
    assert bench.count("NAK received") == 1


@pytest.mark.parametrize("size", range(1, 40))
def test_a_reset_in_mid_message_leaves_half_and_the_host_recovers(size: int) -> None:
    bench = Bench(S3Profile(start_up_s=0.5))
    first = bench.status()
    said = len(bench.to_host)
    bench.robot.inject("power-cycle", bench.now, after_bytes=size)
    bench.host.order(read_status())
    for _ in bench.steps(0.4):
        pass
    assert len(bench.to_host) == said + size
    bench.told.clear()
    bench.wait(30.0)
    bench.told.clear()
    assert bench.status() == first


def test_half_a_message_at_the_end_of_the_start_up_is_noise() -> None:
    bench = Bench(S3Profile(start_up_s=1.0))
    bench.robot.inject("power-cycle", bench.now)
    order = bytes.fromhex("05 10 02 00 08 01 00 13 01 00 00 10 03 18 04")
    bench.robot.endpoint.receive(order[:7], T0 + 0.5)
    bench.now = T0 + 1.0
    bench.robot.endpoint.receive(order[7:], bench.now)
    bench.wait(3.0)
    assert bench.to_host == b""
    assert bench.status().standby


def test_a_frozen_interpolator_takes_points_and_goes_on_later() -> None:
    bench = Bench().moving(0.0)
    bench.wait(0.5)
    bench.robot.inject("stands", bench.now, for_s=3.0)
    bench.wait(0.5)
    stood = bench.true_position
    for y in (0.01, 0.02, 0.03):
        assert bench.accepts(move(MoveKind.POINT, y))
    asked = bench.now
    assert bench.accepts(move(MoveKind.POINT, 0.04)), "when a place is free"
    assert bench.now - asked > 2.0
    assert stood == pytest.approx([0.9, -0.078, 0.6], abs=0.003)
    bench.wait(5.0)
    assert bench.true_position[1] == pytest.approx(0.04, abs=1e-4)


def test_an_encoder_offset_jumps_is_driven_back_and_stays_in_the_arm() -> None:
    bench = Bench()
    bench.robot.inject("encoder-offset", bench.now, z_mm=2.0)
    motion = bench.robot.motion
    tick = motion.next_tick()
    times = np.array([tick + 0.0199, tick + 0.0201, tick + 0.08, tick + 1.0])
    assert motion.path.trajectory(times)[0][:, 2] == pytest.approx([0.6, 0.6, 0.5986, 0.598], abs=2e-4)
    assert motion.reported(tick + 0.0201)[2] == pytest.approx(0.602)
    bench.wait(1.0)
    assert bench.status().position == START
    assert bench.true_position == pytest.approx([0.9, -0.1, 0.598], abs=1e-4)
    shown = read_state(bench.robot, bench.now)
    assert shown.position_mm[2] - shown.true_position_mm[2] == pytest.approx(2.0, abs=0.1)
    bench.robot.inject("encoder-offset", bench.now, z_mm=-2.0)
    bench.wait(1.0)
    assert bench.true_position == pytest.approx(list(START), abs=1e-4)
    bench.robot.inject("encoder-offset", bench.now, x_mm=-100.0)
    with pytest.raises(ValueError, match="±100 mm"):
        bench.robot.inject("encoder-offset", bench.now, x_mm=-0.1)


def test_a_certain_path_stays_as_it_was_told() -> None:
    bench = Bench().moving()
    bench.wait(0.7)
    certain = bench.robot.motion.path.committed_until(bench.now)
    times = np.linspace(bench.now, certain, 50)
    before = bench.robot.motion.path.trajectory(times)[0]
    bench.robot.inject("encoder-offset", bench.now, y_mm=50.0)
    bench.robot.inject("stands", bench.now)
    bench.wait(1.0)
    assert np.array_equal(bench.robot.motion.path.trajectory(times)[0], before)


# --- the panel


def test_the_panel_shows_what_is_there() -> None:
    bench = Bench().moving()
    bench.code(write_mode(4))  # type: ignore[arg-type]
    bench.wait(1.0)
    shown = bench.panel.perform({"do": "show"}, bench.now)["state"]
    assert shown["mode"] == "operation"
    assert shown["activity"] == "movement sequence"
    assert [flag for flag, on in shown["flags"].items() if on] == ["key_auto", "operation", "execution"]
    assert (shown["points_waiting"], shown["queue_depth"]) == (1, 4)
    assert shown["position_mm"][1] == pytest.approx(-54.0, abs=3.0)
    assert shown["joints_deg"][0] == pytest.approx(math.degrees(math.atan2(-54.0, 900.0)), abs=0.2)
    assert (shown["answered"], shown["refused"], shown["lost"]) == (4, 1, 0)
    assert shown["last_refusal"] == "write mode: 2 wrong function suffix"
    json.dumps(shown)


def test_looking_changes_nothing() -> None:
    seen, unseen = Bench().moving(), Bench().moving()
    for _ in range(200):
        seen.now += 0.0071
        seen.panel.show(seen.now)
    unseen.now = seen.now
    times = np.linspace(seen.now - 1.5, seen.now, 300)
    assert np.array_equal(
        seen.robot.motion.path.trajectory(times)[0], unseen.robot.motion.path.trajectory(times)[0]
    )
    assert seen.status() == unseen.status()


@pytest.mark.parametrize(
    ("request_", "text"),
    [
        ({}, "no action is called None; known: show, emergency-stop, key"),
        ({"do": ["show"]}, "no action"),
        ({"do": "key"}, "key goes to auto or manual, not None"),
        ({"do": "key", "to": {}}, "key goes to"),
        ({"do": "inject"}, "needs the name of a fault"),
        ({"do": "inject", "fault": "refuses", "with": 3}, "table of parameters"),
        ({"do": "inject", "fault": "flood"}, "no fault is called 'flood'; known: emergency-stop"),
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
def test_what_cannot_be_asked_is_refused_in_one_line(request_: dict[str, object], text: str) -> None:
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


@settings(max_examples=150, deadline=None)
@given(st.lists(REQUESTS, max_size=6))
def test_whatever_is_asked_the_controller_can_be_brought_back(requests: list[dict[str, object]]) -> None:
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
