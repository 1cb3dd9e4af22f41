"""Tests of the emulated KUKA controller: cycles, late answers and their limit, corrections and their limits."""

import math
from collections.abc import Callable, Sequence

import pytest
from hypothesis import given
from hypothesis import strategies as st

from emulators.devices.rsi import RsiProfile
from emulators.devices.rsi.correction import TOO_FAR, TOO_FAST, Correction
from emulators.devices.rsi.ethernet import TIMED_OUT
from emulators.devices.rsi.session import State
from protocol.devices.rsi import SENSOR, Telegram, decode, encode
from protocol.geometry import Pose, from_angles
from tests.emulation.rsi_rig import actual, answer, rig


@pytest.mark.parametrize(("cycle_ms", "lag_ms"), [(4, 47.3), (12, 60.5)])
def test_reported_position_lag_matches_real_robot(cycle_ms: int, lag_ms: float) -> None:
    """60.3 to 60.9 ms were recorded at 12 ms and 3.38 mm/s; no data for 4 ms."""
    mm_s = 3.38
    one = rig(mode="absolute", cycle_ms=cycle_ms)
    behind = []
    for count in range(100):
        reported = one.cycle(lambda ipoc, x=mm_s * count * cycle_ms / 1e3: answer(ipoc, x=x))  # type: ignore[misc]
        behind.append(one.robot.ordered_pose.position[0] * 1e3 - actual(reported)[0])
    assert sum(behind[50:]) / 50 / mm_s * 1e3 == pytest.approx(lag_ms, abs=0.3)


# --- telegrams


def test_first_telegrams_match_specification() -> None:
    """The specification's axes are only an example: these are the axes of this arm."""
    one = rig()
    assert one.next() == [
        b'<Rob Type="KUKA"><RIst X="600.0000" Y="0.0000" Z="500.0000" A="0.0000" B="0.0000" C="180.0000"/>'
        b'<RSol X="600.0000" Y="0.0000" Z="500.0000" A="0.0000" B="0.0000" C="180.0000"/>'
        b'<AIPos A1="0.0000" A2="-71.0668" A3="147.8283" A4="0.0000" A5="13.2385" A6="180.0000"/>'
        b'<ASPos A1="0.0000" A2="-71.0668" A3="147.8283" A4="0.0000" A5="13.2385" A6="180.0000"/>'
        b'<Delay D="0"/><IPOC>123456</IPOC></Rob>'
    ]
    other = rig(send=("DEF_RIst", "DEF_AIPos", "DEF_EIPos", "DEF_Delay"), ipoc_start=123468)
    for _ in range(4):
        (raw,) = other.next()
    assert raw == (
        b'<Rob Type="KUKA"><RIst X="600.0000" Y="0.0000" Z="500.0000" A="0.0000" B="0.0000" C="180.0000"/>'
        b'<AIPos A1="0.0000" A2="-71.0668" A3="147.8283" A4="0.0000" A5="13.2385" A6="180.0000"/>'
        b'<EIPos E1="0.0000" E2="0.0000" E3="0.0000" E4="0.0000" E5="0.0000" E6="0.0000"/>'
        b'<Delay D="3"/><IPOC>123480</IPOC></Rob>'
    )


@pytest.mark.parametrize("cycle_ms", [4, 12])
def test_clock_counts_milliseconds(cycle_ms: int) -> None:
    one = rig(cycle_ms=cycle_ms)
    first = one.cycle(answer)
    began = one.now
    for _ in range(250):
        last = one.cycle(answer)
    assert last.ipoc - first.ipoc == 250 * cycle_ms
    assert one.now - began == pytest.approx(0.25 * cycle_ms)


def test_stalled_process_misses_cycles_without_late_count() -> None:
    one = rig()
    one.run(2)
    one.now += 1.0
    one.robot.endpoint.handle_deadline(one.now)
    (raw,) = one.robot.endpoint.data_to_send(one.now)
    assert decode(raw).ipoc == 123460 + 1000
    assert one.robot.late == 0
    assert one.robot.endpoint.next_deadline() == pytest.approx(one.now + 0.004)


def test_late_process_sends_state_of_due_cycle() -> None:
    """It wakes 3 ms after a cycle, while the arm moves: the telegram equals that of a punctual process."""
    telegrams: list[bytes] = []
    for late_s in (0.0, 0.003):
        one = rig()
        one.run(40, z=-0.1)
        due = one.robot.endpoint.next_deadline()
        assert due is not None
        one.robot.endpoint.handle_deadline(due + 0.004 + late_s)
        telegrams += one.robot.endpoint.data_to_send(due + 0.004 + late_s)
    assert telegrams[0] == telegrams[1]
    assert b'Z="500.0000"' not in telegrams[0].split(b"<RSol")[0], "the arm has moved"


def test_additional_channels_and_spellings_are_sent() -> None:
    one = rig(
        send=("DEF_RIst", "DEF_MACur", "ProgStatus.R"), rob_type_attr="TYPE", precision=2, empty_first=True
    )
    (raw,) = one.next()
    assert raw == b'<Rob TYPE="KUKA"><IPOC>123456</IPOC></Rob>'
    (raw,) = one.next()
    assert raw == (
        b'<Rob TYPE="KUKA"><RIst X="600.00" Y="0.00" Z="500.00" A="0.00" B="0.00" C="180.00"/>'
        b'<MACur A1="0.00" A2="0.00" A3="0.00" A4="0.00" A5="0.00" A6="0.00"/>'
        b'<ProgStatus R="3"/><IPOC>123460</IPOC></Rob>'
    )


@pytest.mark.parametrize("tag", ["", "a.b.c", "a b", "<", "1a"])
def test_invalid_tag_is_refused(tag: str) -> None:
    with pytest.raises(ValueError, match="is not a valid tag"):
        RsiProfile(send=(tag,))


# --- corrections


def test_relative_values_add_up_and_arm_follows() -> None:
    one = rig()
    one.run(250, z=-0.02)
    before = actual(one.cycle())
    assert one.z() == pytest.approx(-5.0)
    assert -5.0 <= before[2] - 500.0 < -4.6  # it lags behind
    one.run(100)
    reported = one.cycle(lambda ipoc: answer(ipoc))
    assert actual(reported)[2] == pytest.approx(495.0, abs=1e-3)
    assert reported.values["RSol.Z"] == "500.0000"


def test_absolute_values_are_total_correction() -> None:
    one = rig(mode="absolute")
    one.run(50, z=-0.5)
    assert one.z() == -0.5
    one.run(50)
    assert one.z() == 0.0


def test_repeated_or_missing_relative_answers_move_nothing() -> None:
    one = rig()
    one.run(10, z=-0.02)
    one.cycle(*[lambda ipoc: answer(ipoc, z=-0.02)] * 5)
    one.cycle()
    assert one.z() == pytest.approx(-0.22)
    for _ in range(5):
        one.cycle()
    assert one.z() == pytest.approx(-0.22)
    assert one.robot.discarded == {"second answer in a cycle": 4}


def test_holdon_of_lost_answers_matches_specification() -> None:
    for holdon, total in (("keep", -0.30), ("zero", -0.20), ("by mode", -0.20)):
        one = rig(holdon=holdon)
        one.run(10, z=-0.02)
        for _ in range(5):
            one.cycle()
        one.next()
        assert one.z() == pytest.approx(total), holdon


def test_holdon_keeps_absolute_correction() -> None:
    one = rig(mode="absolute")
    one.run(5, z=-0.9)
    one.run(5, z=-1.8)
    one.cycle()
    one.next()
    assert (one.z(), one.robot.error) == (-1.8, "")
    other = rig(mode="absolute", holdon="zero")
    other.run(5, z=-0.9)
    other.run(5, z=-1.8)
    other.cycle()
    other.next()
    assert other.robot.error == TOO_FAST  # one answer was lost, and 0 is a jump
    assert other.robot.state is State.ERROR


def test_second_of_two_answers_may_apply() -> None:
    one = rig(double_reply="last")
    one.cycle(lambda ipoc: answer(ipoc, z=-0.02), lambda ipoc: answer(ipoc, z=-0.03))
    one.next()
    assert one.z() == -0.03


def test_missing_channel_follows_holdon() -> None:
    only_x = encode(Telegram(SENSOR, "ImFree", {"RKorr.X": "0.01"}, 0))

    def reply(ipoc: int) -> bytes:
        return only_x.replace(b"<IPOC>0<", b"<IPOC>%d<" % ipoc)

    one = rig(mode="absolute")
    one.run(1, z=-0.5)
    one.cycle(reply)
    one.next()
    assert one.robot.correction[:3] == (0.01, 0.0, -0.5)


def test_corrections_before_motion_are_dropped() -> None:
    one = rig(move_after_ms=40.0)
    one.run(10, z=-0.02)
    assert (one.robot.state, one.z()) == (State.ON, 0.0)
    one.run(5, z=-0.02)
    assert one.robot.state is State.MOVECORR
    assert one.z() == pytest.approx(-0.1)


def test_stop_channel_edge_ends_motion_not_telegrams() -> None:
    one = rig(off_after_ms=0.0)
    one.run(10, z=-0.02)
    one.cycle(lambda ipoc: answer(ipoc, z=-0.02, Stop="1"))
    one.run(5, z=-0.02)
    assert one.robot.state is State.ON
    assert one.z() == pytest.approx(-0.2)
    assert one.robot.late == 0


def test_program_ends_normally_after_stop_channel() -> None:
    """Public programs call RSI_OFF after RSI_MOVECORR. KUKA's client library waits for the silence."""
    one = rig(off_after_ms=12.0, restart_s=1.0)
    one.run(10, z=-0.02)
    one.cycle(lambda ipoc: answer(ipoc, Stop="1"))
    one.run(3)
    assert one.robot.state is State.ON
    assert one.next() == []
    assert (one.robot.state, one.robot.error) == (State.CREATED, "")
    began = one.now
    while not (out := one.next()):
        pass
    assert one.now - began == pytest.approx(1.0)
    assert actual(decode(out[0]))[2] == pytest.approx(499.8), "it has gone the way that was ordered"
    one.run(10, z=-0.02)
    assert one.robot.state is State.MOVECORR


# --- limits


def test_poscorr_limit_cuts_silently() -> None:
    one = rig(lim_mm=5.0, mon_mm=6.0)
    one.run(300, z=-0.02)
    assert one.z() == -5.0
    assert one.robot.error == ""
    one.run(10, z=0.02)
    one.next()
    assert one.z() == pytest.approx(-4.8)


def test_monitor_ends_rsi_at_combined_limit() -> None:
    for norm, error in (("euclid", TOO_FAR), ("component", "")):
        one = rig(lim_mm=5.0, mon_mm=6.0, mon_norm=norm)
        for _ in range(300):
            for raw in one.next():
                one.robot.endpoint.receive([answer(decode(raw).ipoc, x=0.02, y=0.02)], one.now)
        assert one.robot.error == error
        assert math.hypot(*one.robot.correction[:2]) == pytest.approx(
            6.0 if error else math.hypot(5, 5), abs=0.03
        )


def test_jump_stops_robot_in_place() -> None:
    for value in ({"z": -1.1}, {"c": 0.5}, {"x": 0.8, "y": 0.8}):
        one = rig()
        one.run(5)
        one.cycle(lambda ipoc, value=value: answer(ipoc, **value))  # type: ignore[misc]
        assert one.next() == []
        assert (one.robot.error, one.robot.correction) == (TOO_FAST, (0.0,) * 12)
    slow = rig(cycle_ms=12)
    slow.run(2, z=-2.9)  # as fast as 0.97 mm in 4 ms
    slow.next()
    assert slow.robot.error == ""


def test_orientation_has_one_limit() -> None:
    one = rig(lim_deg=2.0)
    one.run(100, c=0.05)
    one.next()
    assert one.robot.correction[5] == pytest.approx(2.0)
    reported = actual(one.cycle())
    assert reported[5] == pytest.approx(-178.0, abs=0.1)


def test_relative_turns_may_be_composed_in_order() -> None:
    start = Pose((0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0))
    added, composed = (
        Correction(RsiProfile(rel_rot=how, max_step_deg=10.0), start) for how in ("add", "compose")
    )
    for correction in (added, composed):
        assert correction.take((0.0, 0.0, 0.0, 3.0, 0.0, 0.0)) == ""
        assert correction.take((0.0, 0.0, 0.0, 0.0, 4.0, 0.0)) == ""
    assert added.total[3:] == (3.0, 4.0, 0.0)
    assert composed.total[3:] == pytest.approx((3.0, 4.0, 0.0), abs=0.3)
    assert composed.total[5] != 0.0


def test_tool_frame_corrections_turn_with_tool() -> None:
    down = Pose((0.6, 0.0, 0.5), from_angles(0.0, 0.0, 180.0))
    for frame in ("start", "current"):
        correction = Correction(RsiProfile(ref="tool", tool_frame=frame), down)
        assert correction.take((0.0, 0.0, 0.5, 0.0, 0.2, 0.0)) == ""
        assert correction.pose.position == pytest.approx((0.6, 0.0, 0.4995), abs=3e-6)
    base = Correction(RsiProfile(), down)
    assert base.take((0.1, 0.2, 0.4, 0.0, 0.0, 0.0)) == ""
    assert base.pose.position == pytest.approx((0.6001, 0.0002, 0.5004))


# --- late answers


@pytest.mark.parametrize(("count", "fails_in"), [("consecutive", 8), ("total", 6)])
def test_late_answer_count_matches_specification(count: str, fails_in: int) -> None:
    one = rig(timeout=3, late_count=count)
    reported = []
    for valid in (1, 0, 0, 1, 0, 0, 0, 0):
        telegram = one.cycle(*[answer] * valid)
        reported.append(int(telegram.values["Delay.D"]))
        if len(one.sent) == fails_in:
            break
    assert one.next() == []
    assert (one.robot.error, one.robot.state) == (TIMED_OUT, State.ERROR)
    assert reported[:5] == [0, 0, 1, 2, 2]
    assert one.robot.late == (6 if count == "consecutive" else 4)


def test_timeout_ends_telegrams_and_motion() -> None:
    one = rig(timeout=10)
    one.run(100, z=-0.1)
    for _ in range(11):
        one.cycle()
    assert one.next() == []
    before = one.robot.correction
    for _ in range(50):
        assert one.next() == []
        one.robot.endpoint.receive([answer(one.sent[-1].ipoc, z=-0.1)], one.now)
    assert one.robot.correction == before
    height = one.height_mm()
    for _ in range(100):
        one.next()
    assert one.height_mm() == pytest.approx(height, abs=1e-3)


def test_reset_program_starts_at_current_pose() -> None:
    for restart, clock in (("continue", 123456 + 1000), ("anew", 123456)):
        one = rig(timeout=10, restart_s=0.9, ipoc_restart=restart)
        one.run(50, z=-0.1)
        while not one.robot.error:
            one.next()
        stopped_at = one.now
        while one.robot.error:
            (*raw,) = one.next()
        assert one.now - stopped_at == pytest.approx(0.9, abs=0.005)
        telegram = decode(raw[0])
        assert telegram.values["Delay.D"] == "0"
        assert telegram.values["RSol.Z"] == "495.0000"
        assert actual(telegram)[2] == pytest.approx(495.0, abs=0.01)
        assert telegram.ipoc == pytest.approx(clock, abs=200)
        assert one.robot.correction == (0.0,) * 12


@pytest.mark.parametrize(
    ("reply", "why"),
    [
        (lambda ipoc: answer(ipoc - 4), "late"),
        (lambda ipoc: answer(ipoc + 4), "an IPOC that was never sent"),
        (lambda ipoc: answer(ipoc).replace(b"ImFree", b"imfree"), "wrong SENTYPE"),
        (lambda ipoc: answer(ipoc).replace(b"</Sen>", b""), "not a telegram"),
        (lambda ipoc: answer(ipoc).replace(b"Sen", b"Rob"), "a Rob telegram"),
        (lambda ipoc: answer(ipoc).replace(b'Z="0.000000"', b'Z="NaN"'), "'NaN' is not a number"),
        (lambda ipoc: b"<!DOCTYPE x>" + answer(ipoc), "a telegram must not have"),
        (lambda ipoc: b"\0" * 60_000, "a telegram of 60000 bytes"),
        (lambda ipoc: b'<?xml version="1.0"?>' + answer(ipoc), "a telegram must not have"),
        (lambda ipoc: answer(ipoc) + b"\0", "not a telegram"),
    ],
)
def test_invalid_answer_counts_as_late(reply: Callable[[int], bytes], why: str) -> None:
    one = rig()
    one.run(3, z=-0.02)
    one.cycle(reply, reply)
    one.next()
    assert one.robot.late == 1
    assert one.z() == pytest.approx(-0.06)
    ((reason, times),) = one.robot.discarded.items()
    assert reason.startswith(why)
    assert times == 2
    # and a valid one behind it is taken
    one.robot.endpoint.receive([answer(one.sent[-1].ipoc, z=-0.02)], one.now)
    one.next()
    assert one.robot.late == 1


def test_xml_declaration_and_nul_are_accepted_if_set() -> None:
    """Public sources do not say what a controller does; both forms are reported once."""
    for choice, z in (("take", -0.04), ("discard", -0.02)):
        one = rig(answer_prolog=choice, answer_nul=choice)
        one.cycle(lambda ipoc: answer(ipoc, z=-0.02))
        one.cycle(lambda ipoc: b'<?xml version="1.0" encoding="UTF-8"?>\n' + answer(ipoc, z=-0.02) + b"\0\0")
        one.next()
        assert one.z() == pytest.approx(z)
        things = [thing.thing for thing in one.robot.unmodelled.things]
        assert things == ["NUL characters after an answer", "an XML declaration"]


def test_send_only_robot_never_times_out() -> None:
    one = rig(onlysend=True, timeout=3)
    one.run(20, z=-0.02)
    assert (one.robot.late, one.z(), one.robot.error) == (0, 0.0, "")


# --- hostile input


@given(st.lists(st.binary(max_size=200), max_size=5))
def test_arbitrary_bytes_do_not_move_robot(data: Sequence[bytes]) -> None:
    one = rig()
    one.run(2)
    one.robot.endpoint.receive(data, one.now)
    one.next()
    assert one.robot.correction == (0.0,) * 12


def test_flood_of_answers_is_read_partly() -> None:
    one = rig()
    one.cycle()
    one.robot.endpoint.receive([b"<%d" % number for number in range(10_000)], one.now)
    assert sum(one.robot.discarded.values()) == 64
    assert len(one.robot.discarded) <= 65
