"""Tests of robot, tool, surface and sensor together: the force frames for a position of the robot."""

import struct
from typing import Any

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from pydantic import TypeAdapter, ValidationError

from emulators.arm.history import History
from emulators.arm.waypoints import Waypoint
from emulators.cell import Cell, Parts
from emulators.devices.jr3 import Gateway, GatewayProfile, SensorProfile
from emulators.surface.contact import SurfaceProfile
from emulators.tool import ToolProfile, force_to_wrench, moment_matrix, rotation_matrix
from protocol.can.frame import CanFrame
from tests.paper_cell import PaperCell, PaperCellProfile, s3_jr3_cell

T0 = 777.125
DOWN = (0.0, 1.0, 0.0, 0.0)
AT_ONCE = 1000.0
FULL_SCALE_FZ = 185.0
NO_TOOL = ToolProfile(mass_kg=0.0)


def time_when_settled(
    cell: PaperCell, xyz: tuple[float, float, float], quaternion: tuple[float, ...] = DOWN
) -> float:
    """Move the tip to a position; return the time at which it is stationary."""
    w, x, y, z = quaternion
    cell.robot.motion.enqueue(Waypoint(xyz, (w, x, y, z), AT_ONCE), T0)
    return T0 + 5.0


def read_frames(cell: PaperCell, begin: float, seconds: float) -> np.ndarray:
    """Return forces in N (n, 3) of an unfiltered stream at 1 kHz, decoded here by hand."""
    gateway = cell.sensor
    assert isinstance(gateway, Gateway)
    gateway.receive([CanFrame(0x201, bytes.fromhex("0000E8030000"))], begin)
    frames: list[CanFrame] = []
    while (due := gateway.next_deadline()) is not None and due <= begin + seconds:
        gateway.handle_deadline(due)
        frames.extend(gateway.data_to_send(due))
    counts = np.array([struct.unpack("<3hH", f.data)[:3] for f in frames if f.identifier == 0x601])
    return counts * np.array([115.0, 111.0, FULL_SCALE_FZ]) / 16384.0


def test_robot_that_reads_a_sensor_receives_that_of_the_cell() -> None:
    plain = s3_jr3_cell(PaperCellProfile(tool=NO_TOOL), T0, seed=5)
    equipped: list[object] = []

    class Reader:
        def __getattr__(self, name: str) -> Any:
            return getattr(plain.robot, name)

        def equip(self, sensor: object) -> None:
            equipped.append(sensor)

    parts: Parts[Any, Any] = Parts(lambda *given: Reader(), lambda *given: plain.sensor)
    Cell(PaperCellProfile(tool=NO_TOOL), T0, 5, parts)
    assert equipped == [plain.sensor]


def test_pressing_2_mm_into_sponge_reads_10_n() -> None:
    cell = s3_jr3_cell(PaperCellProfile(tool=NO_TOOL), T0, seed=5)
    at = time_when_settled(cell, (0.9, 0.0, 0.588))
    truth = cell.true_state(at)
    forces = read_frames(cell, at, 0.5)[10:]
    assert len(forces) > 400
    # Dead band: the tip may stand half a resolution step, 0.31 N, beside where it was sent.
    assert truth.contact_force == pytest.approx((0.0, 0.0, 10.0), abs=5000.0 * 0.0000625 + 1e-9)
    # Pressing down is a force into the flange, -z.
    count = FULL_SCALE_FZ / 16384.0
    assert forces[:, 2].mean() == pytest.approx(-truth.contact_force[2], abs=0.2 * count)
    assert 0.5 * count < forces[:, 2].std() < 1.5 * count
    assert np.abs(forces[:, :2].mean(axis=0)).max() < 0.02


def test_sensor_in_free_space_reads_tool_weight() -> None:
    cell = s3_jr3_cell(
        PaperCellProfile(tool=ToolProfile(mass_kg=2.0, centre_of_gravity_mm=(10.0, -20.0, 80.0))), T0, 1
    )
    wrench = cell.wrench(np.array([T0, T0 + 0.1]))
    weight = 2.0 * 9.80665
    # Tool z points down, tool y along -y of the base: r × f with r = (10, -20, 80) mm and f = (0, 0, weight).
    expected = [0.0, 0.0, weight, -0.02 * weight, -0.01 * weight, 0.0]
    np.testing.assert_allclose(wrench, [expected] * 2, rtol=0, atol=1e-12)


def test_force_at_tip_has_textbook_moment() -> None:
    cell = s3_jr3_cell(
        PaperCellProfile(
            tool=ToolProfile(length_mm=250.0, mass_kg=0.0),
            surface=SurfaceProfile(friction=0.5, friction_smoothing_mm_s=1e-3),
        ),
        T0,
        1,
    )
    cell.robot.motion.enqueue(Waypoint((0.9, -0.1, 0.588), DOWN, AT_ONCE), T0)
    cell.robot.motion.enqueue(Waypoint((0.9, 0.1, 0.588), DOWN, 0.05), T0 + 0.5)
    at = T0 + 2.0
    force = cell.true_state(at).contact_force
    fx, fy, fz, mx, my, mz = cell.wrench(np.array([at]))[0]
    assert force[1] == pytest.approx(-0.5 * force[2], rel=1e-3)
    # Pointing down, tool y is base -y: friction against +y of the base is +y of the tool, at 0.25 m along z.
    assert (fx, fy, fz) == pytest.approx((force[0], -force[1], -force[2]), abs=1e-12)
    assert (mx, my, mz) == pytest.approx((-0.25 * fy, 0.25 * fx, 0.0), abs=1e-12)


unit = st.floats(-1.0, 1.0)


@settings(max_examples=50)
@given(st.tuples(unit, unit, unit, unit), st.tuples(unit, unit, unit), st.tuples(unit, unit, unit))
def test_force_to_wrench_preserves_power(
    q: tuple[float, ...], force: tuple[float, ...], twist: tuple[float, ...]
) -> None:
    norm = np.linalg.norm(q)
    if norm < 0.1:
        q, norm = (1.0, 0.0, 0.0, 0.0), np.float64(1.0)
    a, b, c, d = (np.array(q) / norm).tolist()
    rotation = rotation_matrix((a, b, c, d))
    arm, omega, speed = np.array([0.1, -0.2, 0.3]), np.array(twist), np.array([0.3, 0.1, -0.2])
    np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-12)
    wrench = np.array(force) @ force_to_wrench(rotation, moment_matrix((0.1, -0.2, 0.3)))
    at_tip = rotation @ (speed + np.cross(omega, arm))
    assert wrench @ np.concatenate((speed, omega)) == pytest.approx(np.array(force) @ at_tip, abs=1e-12)


def test_wrench_turns_with_tool_within_block() -> None:
    cell = s3_jr3_cell(PaperCellProfile(tool=ToolProfile(mass_kg=1.0)), T0, 1)
    # A quarter turn about base x at 90°/s, from tool down to tool along base y.
    time_when_settled(cell, (0.9, -0.1, 0.6), (0.7071067811865476, -0.7071067811865476, 0.0, 0.0))
    times = T0 + np.arange(0.0, 1.5, 0.001)
    wrench = cell.wrench(times)
    np.testing.assert_allclose(np.linalg.norm(wrench[:, :3], axis=1), 9.80665, rtol=1e-12)
    np.testing.assert_allclose(wrench[-1, :3], [0.0, 9.80665, 0.0], rtol=0, atol=1e-9)
    halfway = wrench[np.searchsorted(times, T0 + 0.53)]
    assert halfway[1] == pytest.approx(halfway[2], rel=0.1)
    np.testing.assert_array_equal(np.concatenate([cell.wrench(t) for t in np.split(times, 60)]), wrench)


def test_empty_times_give_empty_wrenches() -> None:
    assert s3_jr3_cell(PaperCellProfile(), T0, 1).wrench(np.empty(0)).shape == (0, 6)


def test_same_seed_gives_same_frames() -> None:
    def frames(seed: int) -> np.ndarray:
        cell = s3_jr3_cell(PaperCellProfile(gateway=GatewayProfile(boot_s=0.0)), T0, seed)
        return read_frames(cell, time_when_settled(cell, (0.9, 0.0, 0.589)), 0.1)

    np.testing.assert_array_equal(frames(2), frames(2))
    assert (frames(2) != frames(3)).any()


def test_both_rest_positions_differ_little() -> None:
    cell = s3_jr3_cell(PaperCellProfile(surface=SurfaceProfile(stiffness_n_m=20_000.0), tool=NO_TOOL), T0, 1)
    motion, forces, reported = cell.robot.motion, [], []
    for k, height in enumerate((0.588, 0.5875, 0.588)):
        motion.enqueue(Waypoint((0.9, 0.0, height), DOWN, AT_ONCE), T0 + k)
        forces.append(cell.true_state(T0 + k + 0.9).contact_force[2])
        reported.append(motion.reported(T0 + k + 0.9)[2])
    assert reported[0] == reported[2]
    assert 0.05 < abs(forces[2] - forces[0]) <= 20_000.0 * 0.000125


def test_cell_profile_is_read_from_tables() -> None:
    adapter = TypeAdapter(PaperCellProfile)
    profile = adapter.validate_python(
        {
            "tool": {"length_mm": 150.0, "mass_kg": 1.0},
            "surface": {"kind": "sinusoidal", "amplitude_mm": 3.0},
            "robot": {"move_reply": "reached", "programs": [1, 2]},
            "sensor": {"noise_counts": 0.0},
            "start_position_mm": [900, 0, 650],
        }
    )
    assert profile.surface.kind == "sinusoidal"
    assert profile.robot.programs == (1, 2)
    assert profile.sensor == SensorProfile(noise_counts=0.0)
    assert profile.start_position_mm == (900.0, 0.0, 650.0)
    assert s3_jr3_cell(profile, T0, 1).true_state(T0).position == pytest.approx((0.9, 0.0, 0.65))
    with pytest.raises(ValidationError, match="stifness"):
        adapter.validate_python({"surface": {"stifness_n_m": 1.0}})
    with pytest.raises(ValidationError, match="mass_kg must be at least 0"):
        adapter.validate_python({"tool": {"mass_kg": -1.0}})
    with pytest.raises(ValidationError, match="damping_ratio"):
        adapter.validate_python({"servo": {"damping_ratio": 0.0}})


def test_start_out_of_reach_is_refused() -> None:
    with pytest.raises(ValueError, match="work area"):
        s3_jr3_cell(PaperCellProfile(start_position_mm=(3000.0, 0.0, 0.0)), T0, 1)


Orders = list[tuple[float, int, float]]


def frames_of(profile: PaperCellProfile, orders: Orders) -> list[str]:
    """Return messages of the gateway during these orders: pauses in s, the order, and its distance in mm."""
    cell = s3_jr3_cell(profile, T0, seed=3)
    gateway, motion = cell.sensor, cell.robot.motion
    assert isinstance(gateway, Gateway)
    gateway.handle_deadline(T0 + 3.0)
    gateway.receive([CanFrame(0x201, struct.pack("<HI", 0, 7000))], T0 + 3.0)
    reported, now = [], T0 + 3.0
    for pause, what, far in [*orders, (0.3, 3, 0.0)]:
        now += pause
        while (due := gateway.next_deadline()) is not None and due <= now:
            gateway.handle_deadline(due)
            reported += [str(frame) for frame in gateway.data_to_send(due)]
        match what:
            case 0:
                motion.enqueue(Waypoint((0.9, -0.1, 0.6 - far / 1000.0), DOWN, 0.05), now)
            case 1:
                motion.offset_encoders((0.0, 0.0, far / 1e4), now)
            case 2:
                motion.freeze(now, now + 0.05)
            case _:
                motion.halt(now)
    return reported


@settings(max_examples=15, deadline=None)
@given(
    st.lists(
        st.tuples(st.floats(0.001, 0.4), st.sampled_from((0, 0, 0, 1, 2, 3)), st.floats(0.0, 12.0)),
        min_size=1,
        max_size=8,
    ),
    st.sampled_from(("linear", "standard_linear_solid")),
)
@example([(0.01, 0, 13.0), (0.25, 3, 0.0), (0.1, 0, 12.0), (0.1, 1, 3.0), (0.1, 2, 0.0)], "linear")
def test_readings_are_independent_of_look_ahead(orders: Orders, material: str) -> None:
    profile = TypeAdapter(PaperCellProfile).validate_python({"surface": {"material": {"kind": material}}})
    looking = frames_of(profile, orders)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(History, "predicted_until", History.committed_until)
        assert frames_of(profile, orders) == looking
    assert len(looking) > 80


def test_start_deep_inside_surface_is_refused() -> None:
    deep = PaperCellProfile(start_position_mm=(900.0, 0.0, 390.0))
    with pytest.raises(ValueError, match=r"the tool starts 200 mm inside the surface .*; start above 590 mm"):
        s3_jr3_cell(deep, T0, seed=5)
    pressed = PaperCellProfile(start_position_mm=(900.0, 0.0, 588.0))
    assert s3_jr3_cell(pressed, T0, seed=5).true_state(T0).contact_force[2] == pytest.approx(10.0)
