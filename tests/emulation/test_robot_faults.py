"""Tests of every fault of an emulated S3: the host handles each."""

import numpy as np
import pytest

from emulators.devices.s3 import S3_FAULTS, S3Profile, read_state
from protocol.devices.s3.arap import MoveKind, SpontaneousReceived, read_status
from tests.emulation.s3_bench import OPERATION, POINT, START, T0, Bench, move


def test_every_fault_has_handler_for_its_parameters() -> None:
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


TOLERATED_FAULTS: dict[str, tuple[dict[str, object], str, float]] = {
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


@pytest.mark.parametrize("name", TOLERATED_FAULTS)
def test_fault_acts_is_counted_and_ends(name: str) -> None:
    parameters, counter, seconds = TOLERATED_FAULTS[name]
    bench = Bench()
    first = bench.status()
    bench.robot.inject(name.partition(" ")[0], bench.now, **parameters)
    requested = bench.now
    assert bench.status() == first
    assert seconds <= bench.now - requested < seconds + 0.6
    bench.wait(1.0)
    if counter:
        assert bench.count(counter) > 0
    assert bench.robot.armed == {}
    troubles, requested = dict(bench.host.link.counters), bench.now
    assert bench.status() == first
    assert bench.now - requested < 0.02
    if counter:
        assert bench.count(counter) == troubles[counter], "once is once"


def test_waiting_fault_can_be_cancelled() -> None:
    bench = Bench()
    for fault, row in (*TOLERATED_FAULTS.items(), ("refuses", ({}, "", 0.0))):
        if fault not in ("babble", "off", "line-break"):
            bench.robot.inject(fault.partition(" ")[0], bench.now, **row[0])
    bench.robot.inject("power-cycle", bench.now, after_bytes=1)
    assert len(bench.robot.armed) == 8
    bench.robot.disarm()
    requested = bench.now
    assert bench.status().standby
    assert bench.now - requested < 0.02
    assert not any(bench.count(name) for name in ("time-out", "NAK sent", "NAK received", "missing EOT"))


def test_fault_strikes_count_times() -> None:
    bench = Bench()
    bench.robot.inject("corrupt-block", bench.now, count=3)
    assert bench.robot.armed == {"corrupt-block": 3}
    bench.status()
    assert bench.count("NAK sent") == 3


def test_block_damage_starts_with_next_message() -> None:
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


def test_next_order_of_function_is_refused_with_code() -> None:
    bench = Bench().operation()
    bench.robot.inject("refuses", bench.now, code=12, function=20)
    assert bench.status()
    assert bench.code(OPERATION) == 12
    assert bench.accepts(OPERATION)
    bench.robot.inject("refuses", bench.now)
    assert bench.code(read_status()) == 31
    assert read_state(bench.robot, bench.now).last_refusal == "read status: 31 not possible to proceed"


def test_spontaneous_message_is_sent_as_configured() -> None:
    bench = Bench()
    bench.robot.inject("spontaneous", bench.now, kind=7, x=40, y=2)
    bench.wait(1.0)
    assert [e.spontaneous.text for e in bench.events if isinstance(e, SpontaneousReceived)] == [
        "system error 40.2"
    ]


@pytest.mark.parametrize(("eot", "missing"), [("always", 0), ("never", 40), ("sometimes", 20)])
def test_only_spontaneous_message_may_lack_eot(eot: str, missing: int) -> None:
    bench = Bench(S3Profile(spontaneous_eot=eot))  # type: ignore[arg-type]
    for _ in range(40):
        bench.robot.inject("spontaneous", bench.now)
        bench.wait(1.0)
    assert bench.count("missing EOT") == pytest.approx(missing, abs=10 if eot == "sometimes" else 0)
    before = bench.count("missing EOT")
    bench.status()
    assert bench.count("missing EOT") == before
    assert sum(isinstance(e, SpontaneousReceived) for e in bench.events) == 40


def test_power_cycle_is_silence_then_restarted_controller() -> None:
    bench = Bench(S3Profile(start_up_s=3.0)).moving()
    bench.wait(1.0)
    bench.robot.press_emergency_stop(bench.now)
    bench.robot.inject("power-cycle", bench.now)
    messages = len(bench.to_host)
    displayed = read_state(bench.robot, bench.now)
    assert (displayed.mode, displayed.points_waiting) == ("starting", 0)
    bench.robot.inject("spontaneous", bench.now)
    bench.wait(2.99)
    assert len(bench.to_host) == messages
    bench.wait(0.02)
    assert read_state(bench.robot, bench.now).mode == "standby"
    status = bench.status()
    assert (status.standby, status.emergency_stop) == (False, True), "a latched button stays"
    bench.robot.release_emergency_stop(bench.now)
    assert bench.operation().code(POINT) == 15
    bench.wait(10.0)
    assert not any(isinstance(event, SpontaneousReceived) for event in bench.events)


def test_power_cycle_drops_unanswered_order() -> None:
    bench = Bench(S3Profile(start_up_s=0.001))
    bench.host.order(OPERATION)
    bench.exchange()
    bench.robot.inject("power-cycle", bench.now)
    messages = len(bench.to_host)
    bench.wait(1.0)
    assert len(bench.to_host) == messages
    assert read_state(bench.robot, bench.now).mode == "standby"


def test_block_damage_applies_after_power_cycle_in_block() -> None:
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
def test_host_recovers_from_reset_during_message(size: int) -> None:
    bench = Bench(S3Profile(start_up_s=0.5))
    first = bench.status()
    messages = len(bench.to_host)
    bench.robot.inject("power-cycle", bench.now, after_bytes=size)
    bench.host.order(read_status())
    for _ in bench.steps(0.4):
        pass
    assert len(bench.to_host) == messages + size
    bench.events.clear()
    bench.wait(30.0)
    bench.events.clear()
    assert bench.status() == first


def test_half_message_at_end_of_start_up_is_noise() -> None:
    bench = Bench(S3Profile(start_up_s=1.0))
    bench.robot.inject("power-cycle", bench.now)
    order = bytes.fromhex("05 10 02 00 08 01 00 13 01 00 00 10 03 18 04")
    bench.robot.endpoint.receive(order[:7], T0 + 0.5)
    bench.now = T0 + 1.0
    bench.robot.endpoint.receive(order[7:], bench.now)
    bench.wait(3.0)
    assert bench.to_host == b""
    assert bench.status().standby


def test_frozen_interpolator_queues_points_and_resumes() -> None:
    bench = Bench().moving(0.0)
    bench.wait(0.5)
    bench.robot.inject("stands", bench.now, for_s=3.0)
    bench.wait(0.5)
    stopped_at = bench.true_position
    for y in (0.01, 0.02, 0.03):
        assert bench.accepts(move(MoveKind.POINT, y))
    requested = bench.now
    assert bench.accepts(move(MoveKind.POINT, 0.04)), "when a place is free"
    assert bench.now - requested > 2.0
    assert stopped_at == pytest.approx([0.9, -0.078, 0.6], abs=0.003)
    bench.wait(5.0)
    assert bench.true_position[1] == pytest.approx(0.04, abs=1e-4)


def test_encoder_offset_is_corrected_by_true_motion() -> None:
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
    displayed = read_state(bench.robot, bench.now)
    assert displayed.position_mm[2] - displayed.true_position_mm[2] == pytest.approx(2.0, abs=0.1)
    bench.robot.inject("encoder-offset", bench.now, z_mm=-2.0)
    bench.wait(1.0)
    assert bench.true_position == pytest.approx(list(START), abs=1e-4)
    bench.robot.inject("encoder-offset", bench.now, x_mm=-100.0)
    with pytest.raises(ValueError, match="±100 mm"):
        bench.robot.inject("encoder-offset", bench.now, x_mm=-0.1)


def test_fault_keeps_committed_path() -> None:
    bench = Bench().moving()
    bench.wait(0.7)
    certain = bench.robot.motion.path.committed_until(bench.now)
    times = np.linspace(bench.now, certain, 50)
    before = bench.robot.motion.path.trajectory(times)[0]
    bench.robot.inject("encoder-offset", bench.now, y_mm=50.0)
    bench.robot.inject("stands", bench.now)
    bench.wait(1.0)
    assert np.array_equal(bench.robot.motion.path.trajectory(times)[0], before)
