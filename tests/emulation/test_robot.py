"""Tests of the emulated S3 at its wire: raw bytes in, raw bytes out, on a simulated clock.

Blocks marked golden come from the specification of the computer link, section 4. The others are built here by hand from
its section 3, not by the project's codec.
"""

import math
import struct
from functools import reduce
from operator import xor

import pytest

from emulators.arm.loops import ServoProfile
from emulators.devices.s3 import S3Controller, S3Profile, S3Profiles
from emulators.seams import StartPose
from protocol.devices.s3.adlp import LinkProfile

T0 = 5000.25
START = (0.9, -0.1, 0.6)
DOWN = (0.0, 1.0, 0.0, 0.0)

GOLDEN_STATUS = bytes.fromhex("10 02 00 08 01 00 13 01 00 00 10 03 18")
GOLDEN_STOP = bytes.fromhex("10 02 00 08 01 00 03 01 00 00 10 03 08")
GOLDEN_OPERATION = bytes.fromhex("10 02 00 08 01 00 14 01 00 01 10 03 1E")

ENQ, ACK, EOT, NAK = b"\x05", b"\x06", b"\x04", b"\x15"
RESPONSE, REFUSAL = 2, 6
START_MOVE, POINT, END = 2, 0, 3


def block(
    function: int, suffix: int = 0, data: bytes = b"", length: int | None = None, kind: int = 1
) -> bytes:
    size = 8 + len(data) if length is None else length
    telegram = struct.pack(">HBBBBH", size, 1, 0, function, kind, suffix) + data
    return b"\x10\x02" + telegram + b"\x10\x03" + bytes([reduce(xor, telegram, 3)])


def move(
    suffix: int,
    xyz_mm: tuple[float, float, float] = (0.0, 0.0, 0.0),
    mm_s: float = 100.0,
    *,
    quaternion: tuple[int, ...] = (0, 16384, 0, 0),
    run_speed: int = 8192,
    flags: int | None = None,
    size: int = 52,
    length: int | None = None,
) -> bytes:
    if flags is None:
        flags = 0 if suffix == POINT else 2
    words = [round(v / 0.125) for v in xyz_mm]
    data = struct.pack(">5xBHH3h4h", flags, round(mm_s / 0.125), run_speed, *words, *quaternion)
    return block(24, suffix, data.ljust(size - 8, b"\0"), length)


class Pendant:
    """Host that follows the exchange byte by byte, without line time."""

    def __init__(
        self,
        profile: S3Profile | None = None,
        link: LinkProfile | None = None,
        servo: ServoProfile | None = None,
        seed: int = 1,
        tool_length: float = 0.2,
    ) -> None:
        self.now = T0
        self.robot = S3Controller(
            S3Profiles(profile or S3Profile(), link or LinkProfile(), servo or ServoProfile()),
            StartPose(START, DOWN, tool_length),
            T0,
            seed,
        )

    def put(self, data: bytes) -> bytes:
        self.robot.receive(data, self.now)
        return self.robot.data_to_send(self.now)

    def order(self, sent: bytes) -> None:
        assert self.put(ENQ) == ACK
        assert self.put(sent) == ACK
        assert self.put(EOT) == b""

    def run(self, seconds: float) -> bytes:
        """Let time pass deadline by deadline until the robot sends something or the time is over."""
        end = self.now + seconds
        while (due := self.robot.next_deadline()) is not None and due <= end:
            self.now = due
            self.robot.handle_deadline(due)
            if data := self.robot.data_to_send(due):
                return data
        self.now = end
        return b""

    def answer(self, seconds: float = 5.0) -> bytes:
        """Return the robot's next telegram."""
        assert self.run(seconds) == ENQ
        return self.take()

    def take(self) -> bytes:
        """Accept the telegram for which the robot has just sent an ENQ."""
        data = self.put(ACK)
        telegram = data[2:-3]
        assert data[:2] == b"\x10\x02"
        assert data[-3:] == b"\x10\x03" + bytes([reduce(xor, telegram, 3)])
        assert struct.unpack(">HBB", telegram[:4]) == (len(telegram), 0, 0)
        assert self.put(ACK) == EOT
        return telegram

    def do(self, sent: bytes) -> bytes:
        self.order(sent)
        return self.answer()

    def refusal(self, sent: bytes) -> int:
        answer = self.do(sent)
        assert answer[5] == REFUSAL
        return int.from_bytes(answer[8:], "big")

    def accepts(self, sent: bytes) -> bool:
        answer = self.do(sent)
        assert answer[4] == sent[6], "an answer carries its order's function code"
        return answer[5] == RESPONSE

    def status(self) -> tuple[int, ...]:
        """Return the flags of byte 17, then X Y Z in 0.125 mm."""
        answer = self.do(GOLDEN_STATUS)
        assert len(answer) == 32
        return struct.unpack(">B3h", answer[17:24])


def in_operation(profile: S3Profile | None = None, **more: object) -> Pendant:
    pendant = Pendant(profile, **more)  # type: ignore[arg-type]
    assert pendant.accepts(GOLDEN_OPERATION)
    return pendant


def in_sequence(profile: S3Profile | None = None, **more: object) -> Pendant:
    pendant = in_operation(profile, **more)
    assert pendant.accepts(move(START_MOVE))
    return pendant


def test_status_answer_is_32_bytes_of_state_and_pose() -> None:
    answer = Pendant().do(GOLDEN_STATUS)
    assert answer == bytes.fromhex(
        "0020 00 00 13 02 0000"  # header: 32 bytes, from the robot, read status, response
        "0000 0000 0000 0000 08 01"  # program, instruction, TCP, frame; key in AUTO; standby
        "1C20 FCE0 12C0"  # 900, -100, 600 mm
        "0000 4000 0000 0000"
    )


def test_modes_are_written_and_reported() -> None:
    pendant = Pendant()
    for suffix, flags in ((1, 0b0010), (0, 0b0001), (3, 0b0010), (2, 0b0001)):
        assert pendant.accepts(block(20, suffix))
        assert pendant.status()[0] == flags


@pytest.mark.parametrize("seed", range(5))
def test_turnaround_is_12_ms_within_4(seed: int) -> None:
    pendant = Pendant(seed=seed)
    observed = set()
    for _ in range(40):
        pendant.order(GOLDEN_STATUS)
        requested = pendant.now
        pendant.answer()
        observed.add(pendant.now - requested)
    assert 0.008 <= min(observed) < 0.0095
    assert 0.0145 < max(observed) <= 0.016 + 1e-9


def test_same_seed_gives_same_answer_times() -> None:
    def times(seed: int) -> list[float]:
        pendant = Pendant(seed=seed)
        return [pendant.now for _ in range(5) if pendant.do(GOLDEN_STATUS)]

    assert times(3) == times(3)
    assert times(3) != times(4)


@pytest.mark.parametrize("size", [52, 60])
@pytest.mark.parametrize("is_complete", [True, False])
def test_movement_sequence_of_any_style_moves_robot(size: int, is_complete: bool) -> None:
    pendant = in_operation()
    length = size if is_complete else size - 8
    target = (900.0, -80.0, 595.0)
    for suffix, point in ((START_MOVE, (0.0, 0.0, 0.0)), (POINT, target), (END, target)):
        assert pendant.accepts(move(suffix, point, size=size, length=length))
    assert pendant.status()[0] & 4, "execution while the robot moves"
    pendant.run(1.0)
    assert pendant.status() == (0b0010, 7200, -640, 4760)


def test_velocity_and_run_speed_multiply() -> None:
    pendant = in_sequence()
    pendant.accepts(move(POINT, (900.0, 0.0, 600.0), mm_s=80.0, run_speed=4096))
    begun = pendant.now
    pendant.run(1.0)
    # 40 mm/s for 1 s, less delay (20 … 40 ms) and the loop's lag of 50 ms; the answer takes up to 16 ms.
    position = (pendant.status()[2] + 800) * 0.125
    assert position == pytest.approx(40.0 * (pendant.now - begun - 0.08), abs=0.7)


def test_full_queue_delays_answer_until_space_is_free() -> None:
    pendant = in_sequence()
    times = []
    for k in range(1, 5):
        assert pendant.accepts(move(POINT, (900.0, -100.0 + 10.0 * k, 600.0), mm_s=20.0))
        times.append(pendant.now)
    first = times[0]
    assert pendant.now - first < 0.06
    pendant.order(move(POINT, (900.0, -50.0, 600.0), mm_s=20.0))
    assert pendant.answer()[5] == RESPONSE
    # The first 10 mm at 20 mm/s take 0.5 s from the tick after the order was taken.
    assert pendant.now == pytest.approx(first + 0.5, abs=0.025)


def test_orders_after_waiting_one_are_answered_in_order() -> None:
    pendant = in_sequence(S3Profile(queue_depth=1, order_backlog=2))
    pendant.accepts(move(POINT, (900.0, -90.0, 600.0), mm_s=20.0))
    pendant.order(move(POINT, (900.0, -80.0, 600.0), mm_s=20.0))
    pendant.order(GOLDEN_STATUS)
    pendant.order(GOLDEN_STOP)
    assert pendant.run(1.0) == ENQ
    assert pendant.put(ACK)[6] == 24
    assert pendant.put(ACK) == EOT + ENQ, "the answer to the next order was ready"
    assert pendant.take()[4] == 19
    assert pendant.run(3.0) == b""


def test_move_may_be_answered_when_reached() -> None:
    pendant = in_sequence(S3Profile(move_reply="reached"))
    requested = pendant.now
    assert pendant.accepts(move(POINT, (900.0, -90.0, 600.0), mm_s=20.0))
    assert 0.5 < pendant.now - requested < 0.8
    assert pendant.status() == (0b0010, 7200, -720, 4800)


def test_emergency_stop_refuses_unreached_move() -> None:
    pendant = in_sequence(S3Profile(move_reply="reached"))
    pendant.order(move(POINT, (900.0, -50.0, 600.0), mm_s=20.0))
    assert pendant.run(0.3) == b""
    pendant.robot.press_emergency_stop(pendant.now)
    assert pendant.robot.data_to_send(pendant.now) == ENQ
    assert pendant.take()[4:8] == bytes.fromhex("7F 03 0011")
    refusal = pendant.answer()
    assert (refusal[4], refusal[5], refusal[9]) == (24, REFUSAL, 13)


def test_emergency_stop_stops_refuses_and_is_reported() -> None:
    pendant = in_sequence()
    pendant.accepts(move(POINT, (900.0, 100.0, 600.0)))
    pendant.run(0.5)
    pendant.robot.press_emergency_stop(pendant.now)
    assert pendant.robot.data_to_send(pendant.now) == ENQ
    assert pendant.take() == bytes.fromhex("000C 00 00 7F 03 0011 000D 0000")
    pendant.run(0.5)
    flags, _, y, _ = pendant.status()
    assert flags == 0b1000, "the stop alone"
    assert -800 < y < -350
    assert pendant.refusal(move(POINT, (900.0, 0.0, 600.0))) == 13
    assert pendant.refusal(GOLDEN_OPERATION) == 13
    assert pendant.refusal(block(2, 0, b"\0\1")) == 13
    pendant.robot.release_emergency_stop(pendant.now)
    assert pendant.refusal(move(START_MOVE)) == 6
    assert pendant.accepts(GOLDEN_OPERATION)
    assert pendant.refusal(move(POINT, (900.0, 0.0, 600.0))) == 15
    assert pendant.status()[2] == y


@pytest.mark.parametrize(("keeps", "flags"), [(False, 0b1000), (True, 0b1001)])
def test_emergency_stop_may_keep_standby_flag(keeps: bool, flags: int) -> None:
    pendant = Pendant(S3Profile(emergency_stop_keeps_standby=keeps))
    assert pendant.status()[0] == 0b0001
    pendant.robot.press_emergency_stop(pendant.now)
    assert pendant.robot.data_to_send(pendant.now) == ENQ
    pendant.take()
    assert pendant.status()[0] == flags
    pendant.robot.release_emergency_stop(pendant.now)
    assert pendant.status()[0] == 0b0001


def test_stop_program_ends_movement() -> None:
    pendant = in_sequence()
    pendant.accepts(move(POINT, (900.0, 100.0, 600.0)))
    assert pendant.accepts(GOLDEN_STOP)
    pendant.run(0.5)
    before = pendant.status()
    pendant.run(0.5)
    assert pendant.status() == before
    assert before[2] < -750
    assert pendant.refusal(move(POINT, (900.0, 0.0, 600.0))) == 15


def test_programs_start_stop_and_continue() -> None:
    pendant = in_operation(S3Profile(programs=(1, 7)))
    assert pendant.refusal(block(2, 1, b"\0\7")) == 3, "nothing to continue"
    assert pendant.accepts(block(2, 0, b"\0\7"))
    assert pendant.do(GOLDEN_STATUS)[8:18] == bytes.fromhex("0007 0001 0000 0000 08 06")
    assert pendant.refusal(block(2, 0, b"\0\7")) == 1
    assert pendant.refusal(move(START_MOVE)) == 1
    assert pendant.accepts(GOLDEN_STOP)
    assert pendant.status()[0] == 0b0010
    assert pendant.accepts(block(2, 1, b"\0\7"))


def test_work_stop_refuses_with_16() -> None:
    pendant = in_sequence()
    pendant.robot.set_work_stop(True, pendant.now)
    assert pendant.refusal(move(POINT, (900.0, 0.0, 600.0))) == 16
    pendant.robot.set_work_stop(False, pendant.now)
    assert pendant.accepts(move(START_MOVE))


def test_link_without_control_answers_status_only() -> None:
    pendant = Pendant(S3Profile(link_control=False))
    assert pendant.refusal(GOLDEN_OPERATION) == 5
    assert pendant.do(GOLDEN_STATUS)[16] & 1
    pendant.robot.set_link_control(True, pendant.now)
    assert pendant.accepts(GOLDEN_OPERATION)
    assert not pendant.do(GOLDEN_STATUS)[16] & 1


HERE = (900.0, -99.0, 600.0)
REFUSED = {
    "wrong suffix of a move": (move(1, HERE), 2),
    "wrong suffix of a query": (block(19, 1), 2),
    "wrong suffix of a mode": (block(20, 4), 2),
    "unknown function": (block(99), 11),
    "function without a known payload": (block(4), 11),
    "function only the robot says": (block(127), 11),
    "not an order": (block(19, kind=2), 11),
    "move of another size": (move(POINT, HERE, size=56), 255),
    "move without a pose": (block(24, 0, bytes(10)), 255),
    "start without a number": (block(2, 0, b"\1"), 255),
    "no such program": (block(29, 1, b"\0\1\0\0\0\0"), 7),
    "too far": (move(POINT, (1600.0, 0.0, 600.0)), 15),
    "too near": (move(POINT, (0.0, 0.0, 500.0)), 15),
    "no speed": (move(POINT, HERE, mm_s=0.0), 31),
    "no run speed": (move(POINT, HERE, run_speed=0), 31),
    "no orientation": (move(POINT, HERE, quaternion=(0, 0, 0, 0)), 31),
    "half an orientation": (move(POINT, HERE, quaternion=(0, 8192, 0, 0)), 31),
    "robot coordinates": (move(POINT, HERE, flags=4), 31),
}


@pytest.mark.parametrize(("sent", "code"), REFUSED.values(), ids=REFUSED.keys())
def test_invalid_orders_are_refused(sent: bytes, code: int) -> None:
    pendant = in_sequence()
    assert pendant.refusal(sent) == code
    assert pendant.status() == (0b0010, 7200, -800, 4800)
    assert pendant.accepts(move(POINT, HERE)), "a refused order leaves the sequence as it was"


def test_unknown_program_is_refused() -> None:
    pendant = in_operation()
    assert pendant.refusal(block(2, 0, b"\0\2")) == 3
    assert pendant.accepts(move(START_MOVE))
    assert pendant.refusal(block(2, 0, b"\0\1")) == 31


def test_telegram_of_other_sender_is_incomplete() -> None:
    telegram = bytes.fromhex("00 08 05 00 13 01 00 00")
    sent = b"\x10\x02" + telegram + b"\x10\x03" + bytes([reduce(xor, telegram, 3)])
    answer = Pendant().do(sent)
    assert answer[4:] == bytes.fromhex("13 06 0000 00FF")


@pytest.mark.parametrize("suffix", [POINT, END])
def test_point_without_start_is_refused_with_15(suffix: int) -> None:
    pendant = in_operation()
    assert pendant.refusal(move(suffix, HERE)) == 15


def test_standby_prevents_motion() -> None:
    pendant = Pendant()
    assert pendant.refusal(move(START_MOVE)) == 6
    assert pendant.refusal(block(2, 0, b"\0\1")) == 6


def test_ended_sequence_accepts_no_points() -> None:
    pendant = in_sequence()
    assert pendant.accepts(move(END, HERE))
    assert pendant.refusal(move(POINT, HERE)) == 15


def test_standby_ends_sequence_and_stops() -> None:
    pendant = in_sequence()
    pendant.accepts(move(POINT, (900.0, 100.0, 600.0)))
    assert pendant.accepts(block(20, 0))
    assert pendant.accepts(GOLDEN_OPERATION)
    assert pendant.refusal(move(POINT, HERE)) == 15


def test_power_up_in_operation_needs_no_mode() -> None:
    assert Pendant(S3Profile(power_up_mode=1)).accepts(move(START_MOVE))


def test_damaged_block_is_repeated_and_executed_once() -> None:
    pendant = Pendant()
    assert pendant.put(ENQ) == ACK
    # While the length may still count without the header, only the gap tells that nothing follows.
    assert pendant.put(GOLDEN_OPERATION[:-1] + b"\0") == b""
    assert pendant.run(0.3) == NAK
    assert pendant.put(GOLDEN_OPERATION) == ACK
    pendant.put(EOT)
    assert pendant.answer()[5] == RESPONSE
    assert pendant.run(5.0) == b""


def test_longer_tool_brings_point_within_reach() -> None:
    far = move(POINT, (1500.0, 0.0, 100.0))
    assert in_sequence(tool_length=0.2).accepts(far)
    assert in_sequence(tool_length=0.9).accepts(move(POINT, (1500.0, 0.0, -300.0)))
    assert in_sequence(tool_length=0.2).refusal(move(POINT, (1500.0, 0.0, -300.0))) == 15


def test_farthest_point_is_arm_and_tool_stretched() -> None:
    # Level with axis 2, the tool along base x: 710 + hypot(125, 850) + 150 + 200 mm.
    reach = 710.0 + math.hypot(125.0, 850.0) + 350.0
    forward = (11585, 0, 11585, 0)
    assert in_sequence().accepts(move(POINT, (reach - 0.2, 0.0, 780.0), quaternion=forward))
    assert in_sequence().refusal(move(POINT, (reach + 0.2, 0.0, 780.0), quaternion=forward)) == 15


def test_point_without_straight_line_is_refused() -> None:
    pendant = in_sequence()
    # In reach after a turn of axis 1, but the straight line runs through the column.
    assert pendant.refusal(move(POINT, (-900.0, -100.0, 600.0))) == 15
    assert pendant.accepts(move(POINT, (0.0, -900.0, 600.0), mm_s=8000.0))
    assert pendant.accepts(move(POINT, (-900.0, -100.0, 600.0), mm_s=8000.0)), "from the point before it"
    pendant.run(5.0)
    assert pendant.status() == (0b0010, -7200, -800, 4800)
    assert pendant.robot.joints(pendant.now)[0] == pytest.approx(math.atan2(-100.0, -900.0), abs=1e-3)


def test_steep_forearm_is_beyond_range_of_axis_3() -> None:
    assert in_sequence().refusal(move(POINT, (900.0, -100.0, 300.0))) == 15
    wider = S3Profile(axis_ranges_deg=(180.0, 100.0, 70.0, 200.0, 120.0, 200.0))
    assert in_sequence(wider).accepts(move(POINT, (900.0, -100.0, 300.0)))


def test_joint_speed_limit_slows_move() -> None:
    # 51.3° of axis 1 at 115°/s take 0.45 s at least, where 8 m/s would take 0.125 s.
    def interpolated(speed_deg_s: float) -> float:
        pendant = in_sequence(S3Profile(axis_speeds_deg_s=(speed_deg_s, *(300.0,) * 5)))
        begun = pendant.robot.motion.next_tick()
        assert pendant.accepts(move(POINT, (900.0, 900.0, 600.0), mm_s=8000.0))
        now = begun
        while pendant.robot.motion.waiting(now):
            now += 0.001
        return now - begun

    assert interpolated(115.0) == pytest.approx(0.46, abs=0.03)
    assert interpolated(57.5) == pytest.approx(0.9, abs=0.03)


def test_point_waiting_for_queue_ends_at_stop() -> None:
    pendant = in_sequence(S3Profile(queue_depth=1))
    assert pendant.accepts(move(POINT, (900.0, 0.0, 600.0), mm_s=20.0))
    pendant.order(move(POINT, (900.0, 100.0, 600.0), mm_s=20.0))
    assert pendant.run(0.5) == b""
    pendant.robot.set_work_stop(True, pendant.now)
    pendant.robot.set_work_stop(False, pendant.now)
    refusal = pendant.answer()
    assert (refusal[5], refusal[9]) == (REFUSAL, 15)
    assert pendant.accepts(move(START_MOVE))
    assert pendant.accepts(move(POINT, (900.0, 100.0, 600.0)))


def test_invalid_profile_is_refused() -> None:
    with pytest.raises(ValueError, match="work area"):
        S3Controller(S3Profiles(), StartPose((3.0, 0.0, 0.0), DOWN), T0, 1)
    with pytest.raises(ValueError, match="turnaround_spread_ms"):
        S3Profile(turnaround_ms=2.0)
    with pytest.raises(ValueError, match="queue_depth"):
        S3Profile(queue_depth=0)


def test_host_that_never_reads_costs_no_memory() -> None:
    pendant = Pendant()
    for _ in range(100):
        pendant.robot.press_emergency_stop(pendant.now)
    reported = 0
    while pendant.run(1000.0):
        reported += 1
    assert reported <= 3 * 16
