"""Tests of the emulated KUKA controller with each of its faults, and with the faults of its wire."""

from typing import Any

import pytest

from emulators.devices.rsi import RSI_FAULTS
from emulators.devices.rsi.correction import TOO_FAR, TOO_FAST
from emulators.devices.rsi.ethernet import TIMED_OUT
from emulators.devices.rsi.session import State
from protocol.devices.rsi import decode
from protocol.endpoint import RemoteProtocolError
from tests.emulation.rsi_rig import PLAIN, T0, Rig, actual, answer, rig

# --- faults


def test_every_fault_has_handler() -> None:
    one = rig()
    for target, faults in RSI_FAULTS.items():
        assert set(one.robot.handlers[target]) == set(faults)


def run_fault(target: str, fault: str, cycles: int = 150, **parameters: Any) -> Rig:
    """Return a rig that runs into a fault after 50 cycles; its client answers every readable telegram."""
    one = rig(send=(*PLAIN, "ProgStatus.R"))
    one.run(50, z=-0.02)
    one.ledger.inject(target, fault, one.now + 0.001, parameters)
    end = one.now + cycles * 0.004
    while one.now < end:
        for raw in one.next(plain=False):
            try:
                telegram = decode(raw)
            except RemoteProtocolError:
                continue
            one.sent.append(telegram)
            one.robot.endpoint.receive([answer(telegram.ipoc, z=-0.02)], one.now)
    assert one.ledger.injections[0].struck > 0
    return one


def test_emergency_stop_is_reported_and_stops_motion() -> None:
    one = run_fault("robot", "emergency-stop", for_s=0.2)
    stopped = [telegram for telegram in one.sent if telegram.values["ProgStatus.R"] == "4"]
    assert len(stopped) == pytest.approx(50, abs=1)
    assert actual(stopped[-1])[2] == pytest.approx(actual(stopped[30])[2], abs=2e-3)
    assert one.sent[-1].values["ProgStatus.R"] == "3"
    assert one.z() == pytest.approx(-0.02 * 150, abs=0.05)


def test_stuck_arm_is_not_reported() -> None:
    one = run_fault("robot", "stands")
    assert one.z() == pytest.approx(-1.0, abs=0.03)
    assert {telegram.values["ProgStatus.R"] for telegram in one.sent} == {"3"}


@pytest.mark.parametrize(
    ("target", "fault", "error"),
    [
        ("robot", "drives-stop", TOO_FAST),
        ("robot", "out-of-limits", TOO_FAR),
        ("wire", "off", TIMED_OUT),
        ("wire", "deaf", TIMED_OUT),
        ("wire", "mute", TIMED_OUT),
        ("wire", "late", TIMED_OUT),
        ("wire", "malformed", TIMED_OUT),
    ],
)
def test_faults_lead_to_controller_refusal(target: str, fault: str, error: str) -> None:
    one = run_fault(target, fault)
    assert (one.robot.error, one.robot.state) == (error, State.ERROR)
    assert one.next() == []
    assert one.z() == pytest.approx(-1.0, abs=0.03)


def test_ended_program_is_silent() -> None:
    one = run_fault("robot", "guidance-ended")
    assert (one.robot.state, one.robot.error) == (State.CREATED, "")
    assert len(one.sent) == 50


def test_reset_program_corrects_from_current_pose() -> None:
    one = run_fault("robot", "program-restarted")
    assert one.sent[-1].values["RSol.Z"] == "499.0400"
    assert one.robot.state is State.MOVECORR


def test_narrow_limit_lasts_as_long_as_fault() -> None:
    one = run_fault("robot", "limit", mm=0.3, for_s=0.4)
    heights = [actual(telegram)[2] for telegram in one.sent]
    assert sum(abs(height - (500.0 - 0.96 - 0.3)) < 0.021 for height in heights) > 20
    assert one.z() < -1.5


def test_lost_telegrams_and_answers_count_as_late() -> None:
    for direction in ("from", "to"):
        one = run_fault("wire", "lost", probability=1.0, count=7, way=direction)
        assert one.robot.late == 7
        assert (one.robot.error, one.ledger.injections[0].struck) == ("", 7)
        assert one.z() == pytest.approx(-0.02 * (200 - 7), abs=0.05)


def test_duplicated_telegrams_act_once() -> None:
    one = run_fault("wire", "twice", probability=1.0, way="from")
    assert one.robot.late == 0
    assert one.z() == pytest.approx(-0.02 * 200, abs=0.05)


def test_reordered_telegrams_get_late_answers() -> None:
    one = run_fault("wire", "reordered", way="from")
    clocks = [telegram.ipoc for telegram in one.sent[50:]]
    assert clocks != sorted(clocks)
    assert one.robot.late == pytest.approx(75, abs=2)
    assert one.robot.error == ""  # never so many in a row


def test_position_may_be_nan() -> None:
    one = run_fault("pose", "nan")
    assert [one.sent[-1].values[f"RIst.{axis}"] for axis in "XYZ"] == ["NaN"] * 3
    assert one.sent[-1].values["RIst.A"] == one.sent[49].values["RIst.A"]


def test_position_may_be_missing() -> None:
    one = run_fault("pose", "missing")
    assert "RIst.X" in one.sent[49].values
    assert not any(tag.startswith("RIst") for tag in one.sent[-1].values)
    assert "RSol.X" in one.sent[-1].values


def test_clock_may_jump() -> None:
    one = run_fault("robot", "clock-jump", ms=-50_000)
    assert one.sent[50].ipoc == one.sent[49].ipoc - 50_000 + 4
    assert one.robot.late == 0


def test_late_telegrams_keep_their_order() -> None:
    one = rig()
    one.ledger.inject("wire", "late", T0, {"ms": 6.0, "way": "from"})
    times: list[tuple[float, int]] = []
    for _ in range(20):
        times.extend((one.now - T0, decode(raw).ipoc) for raw in one.next())
    assert times == [(pytest.approx(0.006 + 0.004 * k), 123456 + 4 * k) for k in range(len(times))]


@pytest.mark.parametrize(
    ("fault", "parameters", "reported"),
    [
        ("offset", {"x_mm": 5.0, "z_mm": -1.0}, (605.0, 0.0, 499.0, 180.0)),
        ("drift", {"y_mm_s": 10.0}, (600.0, 1.0, 500.0, 180.0)),
        ("turned", {"degrees": 5.0}, (600.0, 0.0, 500.0, -175.0)),
        ("mirrored", {"axis": "x"}, (600.0, 0.0, 500.0, 180.0)),
        ("late", {"ms": 40.0}, (600.0, 0.0, 500.0, 180.0)),
        ("frozen", {}, (600.0, 0.0, 500.0, 180.0)),
    ],
)
def test_reported_pose_may_be_wrong_without_arm_motion(
    fault: str, parameters: dict[str, float], reported: tuple[float, ...]
) -> None:
    one = rig()
    one.run(10)
    one.ledger.inject("pose", fault, one.now, parameters)
    for _ in range(25):
        x, y, z, *_, c = actual(one.cycle(answer))
    assert (x, y, z, c) == pytest.approx(reported, abs=0.05)
    assert one.height_mm() == pytest.approx(500.0)
    changes = fault in ("offset", "drift", "turned")
    assert one.ledger.injections[0].struck == pytest.approx(25 if changes else 0, abs=1)


def test_late_and_mirrored_pose_follow_arm() -> None:
    true = run_fault("robot", "limit", mm=1000.0)
    late, mirrored = run_fault("pose", "late", ms=40.0), run_fault("pose", "mirrored", axis="z")
    heights, behind, other = ([actual(each)[2] for each in one.sent[50:]] for one in (true, late, mirrored))
    assert behind[10:] == pytest.approx(heights[:-10], abs=0.011)
    assert [a + b for a, b in zip(heights, other, strict=True)] == pytest.approx(
        [2.0 * heights[0]] * len(heights), abs=0.011
    )


def test_frozen_pose_stays_while_arm_moves() -> None:
    one = run_fault("pose", "frozen")
    assert len({tuple(actual(telegram)) for telegram in one.sent[50:]}) == 1
    assert one.z() == pytest.approx(-4.0, abs=0.1)


# --- the wire


def test_cut_wire_loses_telegrams_that_count_as_late() -> None:
    one = rig()
    one.run(2)
    before = one.sent[-1].ipoc
    one.ledger.inject("wire", "lost", one.now, {"probability": 1.0, "count": 3, "way": "from"})
    assert [one.next() for _ in range(3)] == [[], [], []]
    assert decode(one.next()[0]).ipoc == before + 4 * one.profile.cycle_ms


def test_slow_wire_delays_telegrams_and_answers() -> None:
    one = rig()
    one.run(2)
    assert one.robot.late == 0
    one.ledger.inject("wire", "late", one.now, {"ms": 2.0, "way": "to"})
    (raw,) = one.next()
    one.robot.endpoint.receive([answer(decode(raw).ipoc)], one.now)
    assert one.robot.endpoint.next_deadline() == pytest.approx(one.now + 0.002)
    assert one.next() == []  # the answer comes, in time
    one.ledger.inject("wire", "late", one.now, {"ms": 1000.0, "way": "from"})
    assert one.next() == []
    assert one.robot.late == 0
    one.next()
    assert one.robot.late == 1
