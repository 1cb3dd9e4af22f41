"""Tests of delays that follow a measured distribution, and of the true times of samples and motions."""

import math
import random
import struct
from collections.abc import Sequence
from functools import reduce
from operator import xor
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from emulators.arm.loops import ServoProfile
from emulators.arm.waypoints import Waypoint, WaypointArm
from emulators.devices.jr3 import (
    Gateway,
    GatewayProfile,
    Jr3Sensor,
    SensorProfile,
    UartGateway,
    UartGatewayProfile,
)
from emulators.devices.s3 import S3Controller, S3Profile, S3Profiles
from emulators.quantiles import draw
from emulators.seams import StartPose
from emulators.sensing import KnownWrench
from emulators.surface.contact import SurfaceProfile
from emulators.surface.materials import MaterialKind, MaterialProfile
from protocol.can.frame import CanFrame
from protocol.geometry import Pose
from tests.paper_cell import PaperCell, PaperCellProfile, s3_jr3_cell

T0 = 1234.5
TICK, DELAY = 0.02, 0.02
DOWN = (0.0, 1.0, 0.0, 0.0)
START = (0.9, -0.1, 0.6)
COUNTS_PER_S = 100_000.0
FORCES_ID = 0x601
UNIT = 115.0 / 16384
ODD = (1.0, 1.5, 2.0, 7.0, 40.0)


def quantiles_of(values: Sequence[float], count: int = 5) -> list[float]:
    return [float(value) for value in np.quantile(values, np.linspace(0.0, 1.0, count))]


# --- the draw


def test_draws_match_quantiles() -> None:
    source = random.Random(3)
    drawn = [draw(ODD, source) for _ in range(20_000)]
    assert quantiles_of(drawn) == pytest.approx(ODD, rel=0.02)


@pytest.mark.parametrize(("number", "value"), [(0.0, 1.0), (0.25, 1.5), (0.875, 23.5), (1 - 2**-53, 40.0)])
def test_draw_interpolates_between_quantiles(number: float, value: float) -> None:
    class Source(random.Random):
        def random(self) -> float:
            return number

    assert draw(ODD, Source()) == pytest.approx(value)


@pytest.mark.parametrize(
    ("profile", "name"),
    [
        (S3Profile, "status_turnaround_ms"),
        (S3Profile, "move_turnaround_ms"),
        (GatewayProfile, "delay_ms"),
        (UartGatewayProfile, "delay_ms"),
    ],
)
@pytest.mark.parametrize("wrong", [(3.0,), (2.0, 1.0), (-1.0, 1.0)])
def test_invalid_distribution_is_refused_by_name(profile: Any, name: str, wrong: tuple[float, ...]) -> None:
    with pytest.raises(ValueError, match=name):
        profile(**{name: wrong})


# --- turnaround


def block(function: int, suffix: int = 0, data: bytes = b"") -> bytes:
    telegram = struct.pack(">HBBBBH", 8 + len(data), 1, 0, function, 1, suffix) + data
    return b"\x10\x02" + telegram + b"\x10\x03" + bytes([reduce(xor, telegram, 3)])


STATUS, STOP, START_MOVE = block(19), block(3), block(24, 2, bytes(44))


def turnarounds(profile: S3Profile, order: bytes, count: int, seed: int = 1) -> list[float]:
    """Return times from the end of an order to the ENQ for its answer, s, of many orders on an instantaneous line."""
    robot = S3Controller(S3Profiles(profile), StartPose(START, DOWN, 0.2), T0, seed)
    now, waits = T0 + 1.0, []
    for _ in range(count):
        for piece, reply in ((b"\x05", b"\x06"), (order, b"\x06"), (b"\x04", b"")):
            robot.endpoint.receive(piece, now)
            assert robot.endpoint.data_to_send(now) == reply
        due = robot.endpoint.next_deadline()
        assert due is not None
        robot.endpoint.handle_deadline(due)
        assert robot.endpoint.data_to_send(due) == b"\x05"
        waits.append(due - now)
        now = due
        robot.endpoint.receive(b"\x06", now)
        assert robot.endpoint.data_to_send(now)
        robot.endpoint.receive(b"\x06", now)
        assert robot.endpoint.data_to_send(now) == b"\x04"
        now += 0.01
    return waits


def test_each_order_kind_has_measured_turnaround() -> None:
    profile = S3Profile(status_turnaround_ms=ODD, move_turnaround_ms=(50.0, 51.0))
    status = np.array(turnarounds(profile, STATUS, 2000)) * 1e3
    moves = np.array(turnarounds(profile, START_MOVE, 50)) * 1e3
    others = np.array(turnarounds(profile, STOP, 50)) * 1e3
    assert quantiles_of(status.tolist()) == pytest.approx(ODD, rel=0.12)
    assert moves.min() >= 50.0 - 1e-6
    assert moves.max() <= 51.0 + 1e-6
    assert others.min() >= 8.0 - 1e-6
    assert others.max() <= 16.0 + 1e-6


def test_turnaround_follows_seed_or_default() -> None:
    profile = S3Profile(status_turnaround_ms=ODD)
    assert turnarounds(profile, STATUS, 20, seed=5) == turnarounds(profile, STATUS, 20, seed=5)
    assert turnarounds(profile, STATUS, 20, seed=5) != turnarounds(profile, STATUS, 20, seed=6)
    before = random.Random(5)
    expected = [(12.0 + before.uniform(-4.0, 4.0)) * 1e-3 for _ in range(20)]
    assert turnarounds(S3Profile(), STATUS, 20, seed=5) == pytest.approx(expected)


# --- the sensor's delay and the true moments of its samples


def sensor() -> Jr3Sensor:
    """Return a sensor whose fx grows linearly from T0 on, so that a sample shows when it was measured."""

    def ramp(times: NDArray[np.float64]) -> NDArray[np.float64]:
        wrench = np.zeros((len(times), 6))
        wrench[:, 0] = np.maximum(times - T0, 0.0) % 0.3 * COUNTS_PER_S * UNIT
        return wrench

    return Jr3Sensor(SensorProfile(noise_counts=0.0), KnownWrench(ramp), seed=3)


def can_frames(
    profile: GatewayProfile, seconds: float, seed: int = 1
) -> tuple[Gateway, list[tuple[float, int, int]]]:
    """Return time, counts of fx and counter of each force frame of an unfiltered 10 ms stream."""
    gateway = Gateway(profile, sensor(), T0, seed)
    now = T0 + 2.5
    gateway.endpoint.handle_deadline(now)
    gateway.endpoint.receive([CanFrame(0x201, bytes.fromhex("000010270000"))], now)
    reported = []
    while (due := gateway.endpoint.next_deadline()) is not None and due < now + seconds:
        gateway.endpoint.handle_deadline(due)
        reported += [
            (due, *struct.unpack("<h4xH", frame.data))
            for frame in gateway.endpoint.data_to_send(due)
            if frame.identifier == FORCES_ID
        ]
    return gateway, reported


def uart_frames(
    profile: UartGatewayProfile, seconds: float
) -> tuple[UartGateway, list[tuple[float, int, int]]]:
    gateway = UartGateway(profile, sensor(), T0)
    now = T0 + 5.1
    gateway.endpoint.handle_deadline(now)
    gateway.endpoint.data_to_send(now)
    gateway.endpoint.receive(bytes.fromhex("3C30320000102700003E"), now)
    gateway.endpoint.data_to_send(now)
    reported = []
    while (due := gateway.endpoint.next_deadline()) is not None and due < now + seconds:
        gateway.endpoint.handle_deadline(due)
        data = gateway.endpoint.data_to_send(due)
        if len(data) == 18:
            reported.append((due, *struct.unpack("<h10xH", data[3:17])))
    return gateway, reported


@pytest.mark.parametrize("frames", [can_frames, uart_frames])
def test_frame_delay_matches_draw(frames: Any) -> None:
    profile = GatewayProfile if frames is can_frames else UartGatewayProfile
    _, prompt = frames(profile(), 1.0)
    _, late = frames(profile(delay_ms=(1.0, 5.0, 9.0)), 1.0)
    assert len(prompt) > 90
    arrived = {counter: (at, counts) for at, counts, counter in late}
    both = [(row, arrived[row[2]]) for row in prompt[1:] if row[2] in arrived]
    assert len(both) > 90
    assert all(before[1] == after[1] for before, after in both), "the samples are the same"
    delays = [(after[0] - before[0]) * 1e3 for before, after in both]
    assert min(delays) >= 1.0 - 1e-6
    assert max(delays) <= 9.0 + 1e-6
    assert quantiles_of(delays, 3) == pytest.approx([1.0, 5.0, 9.0], rel=0.25)


@pytest.mark.parametrize("frames", [can_frames, uart_frames])
def test_sampled_at_is_time_of_measurement(frames: Any) -> None:
    gateway, reported = frames(GatewayProfile() if frames is can_frames else UartGatewayProfile(), 0.5)
    assert len(reported) > 40
    for sent_at, counts, counter in reported[1:]:
        sampled_at = gateway.sampled_at(counter)
        assert sampled_at is not None
        assert sampled_at <= sent_at < sampled_at + 300e-6
        assert (sampled_at - T0) % 0.3 * COUNTS_PER_S == pytest.approx(counts, abs=2.0)


def test_sampled_at_is_none_without_sample() -> None:
    gateway = Gateway(GatewayProfile(), sensor(), T0)
    assert gateway.sampled_at(5) is None
    gateway, reported = can_frames(GatewayProfile(), 0.1)
    assert gateway.sampled_at(reported[-1][2] + 1000) is None, "that many were not taken yet"


def test_frames_never_overtake_each_other() -> None:
    _, reported = can_frames(GatewayProfile(delay_ms=(0.0, 0.0, 80.0)), 2.0)
    counters = [counter for _, _, counter in reported]
    assert counters == sorted(counters)


# --- the begin of a motion


def test_motion_begins_with_first_set_point_of_loops() -> None:
    motion = WaypointArm(ServoProfile(), Pose(START, DOWN), T0)
    motion.enqueue(Waypoint((0.91, -0.1, 0.6), DOWN, 0.1), T0 + 0.005)
    motion.enqueue(Waypoint((0.91, -0.1, 0.59), DOWN, 0.1), T0 + 0.006)
    assert motion.path.targets.accepted == 2
    assert motion.path.targets.begun_at(1) is None, "no reader has looked on since"
    motion.path.advance(T0 + 1.0)
    first, second = motion.path.targets.begun_at(1), motion.path.targets.begun_at(2)
    assert first == pytest.approx(T0 + TICK + DELAY)
    # 10 mm at 100 mm/s are five ticks.
    assert second == pytest.approx(T0 + 6 * TICK + DELAY)
    assert first is not None
    assert second is not None
    positions, _ = motion.path.trajectory(np.array([first, first + 1e-3, second, second + 1e-3]))
    assert positions[0, 0] == pytest.approx(0.9, abs=1e-12)
    assert positions[1, 0] > 0.9
    assert positions[2, 2] == pytest.approx(0.6, abs=1e-12)
    assert positions[3, 2] < 0.6


def test_dropped_target_never_begins() -> None:
    motion = WaypointArm(ServoProfile(), Pose(START, DOWN), T0)
    for x in (0.95, 0.96):
        motion.enqueue(Waypoint((x, -0.1, 0.6), DOWN, 0.1), T0 + 0.005)
    motion.halt(T0 + 0.05)
    motion.enqueue(Waypoint(START, DOWN, 0.1), T0 + 0.051)
    motion.path.advance(T0 + 1.0)
    begun = motion.path.targets.begun_at(2)
    assert begun is not None
    assert math.isnan(begun)
    assert motion.path.targets.begun_at(1) == pytest.approx(T0 + TICK + DELAY)
    assert motion.path.targets.begun_at(3) == pytest.approx(T0 + 3 * TICK + DELAY)
    assert motion.path.targets.begun_at(4) is None


def test_number_of_kept_motion_starts_is_limited() -> None:
    motion = WaypointArm(ServoProfile(), Pose(START, DOWN), T0)
    for k in range(1100):
        motion.enqueue(Waypoint((0.9 + 1e-3 * (k % 2), -0.1, 0.6), DOWN, 10.0), T0 + 0.02 * k)
    motion.path.advance(T0 + 25.0)
    forgotten, kept = motion.path.targets.begun_at(10), motion.path.targets.begun_at(1100)
    assert forgotten is not None
    assert math.isnan(forgotten)
    assert kept == pytest.approx(T0 + 1100 * TICK + DELAY)


# --- the truth of many moments


def lowered_cell(kind: MaterialKind) -> PaperCell:
    """Return a cell whose tool moves 2 mm down into the surface and then along it."""
    surface = SurfaceProfile(material=MaterialProfile(kind))
    cell = s3_jr3_cell(PaperCellProfile(surface=surface), T0, seed=1)
    for position in ((0.9, -0.1, 0.588), (0.9, -0.05, 0.588)):
        cell.robot.motion.enqueue(Waypoint(position, DOWN, 0.05), T0)
    return cell


@pytest.mark.parametrize("kind", [MaterialKind.LINEAR, MaterialKind.STANDARD_LINEAR_SOLID])
def test_true_states_match_single_states(kind: MaterialKind) -> None:
    times = [T0 + 0.05 + 0.17 * k for k in range(8)]
    cell = lowered_cell(kind)
    single = [lowered_cell(kind).true_state(time) for time in times]
    together = cell.true_states(times)
    for one, other in zip(single, together, strict=True):
        assert one.position == pytest.approx(other.position, abs=1e-12)
        assert one.quaternion == other.quaternion
        assert one.joints == pytest.approx(other.joints, abs=1e-12)
        if kind is MaterialKind.LINEAR:
            assert one.contact_force == pytest.approx(other.contact_force, abs=1e-9)


def test_material_with_memory_limits_available_truth() -> None:
    assert not lowered_cell(MaterialKind.LINEAR).has_memory
    assert lowered_cell(MaterialKind.LINEAR).truth_available_from(T0 + 0.5) == T0 + 0.5
    cell = lowered_cell(MaterialKind.STANDARD_LINEAR_SOLID)
    assert cell.has_memory
    cell.wrench(np.arange(T0, T0 + 0.5, 1 / 8000))
    assert cell.truth_available_from(T0 + 0.3) == pytest.approx(T0 + 0.5, abs=2e-4)
    assert cell.truth_available_from(T0 + 0.7) == T0 + 0.7
