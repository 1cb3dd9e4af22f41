"""The compliant arm against closed forms, and against an integration step by step that shares no code with it."""

import copy
import math
from collections.abc import Callable, Iterable
from typing import Any, cast

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from emulators.arm import compliance
from emulators.arm.compliance import ArmProfile, Load, joint_compliance
from emulators.arm.compliant_path import STEP_S, Bearing, CompliantPath, Contact, Grid
from emulators.arm.mode import Mode
from emulators.arm.waypoints import Waypoint
from emulators.cell import Cell, Parts
from emulators.devices.jr3 import make_gateway
from emulators.devices.s3 import EMPTY_SITE, make_robot
from emulators.seams import Floats
from emulators.surface.contact import SurfaceProfile
from emulators.surface.faults import ObstacleProfile
from emulators.surface.materials import MaterialKind, MaterialProfile
from emulators.tool import ToolProfile
from protocol.arm_size import PerAxis
from protocol.geometry import Quaternion
from protocol.marks import SettingError
from tests.paper_cell import RIGID_ARM, PaperCell, PaperCellProfile, s3_jr3_cell

T0 = 777.125
DOWN = (0.0, 1.0, 0.0, 0.0)
STIFFNESS = 30e3
CARTESIAN = ArmProfile(compliance="cartesian")
JOINTS = ArmProfile(compliance="joints")
NO_TOOL = ToolProfile(mass_kg=0.0)
MODE = Mode(15.0, 0.03)
OMEGA = 2.0 * math.pi * MODE.frequency_hz
SOFT = np.eye(3) / STIFFNESS


class ExactPath:
    """A rigid arm's tool on the base z axis, by functions of time for its height and vertical speed."""

    def __init__(self, height: Callable[[Floats], Floats], speed: Callable[[Floats], Floats]) -> None:
        self._height, self._speed = height, speed
        self.on_change: Callable[[float], object] = print

    def advance(self, now: float) -> None:
        """Nothing happens."""

    def committed_until(self, now: float) -> float:
        return now

    def predicted_until(self, now: float) -> float:
        return now

    def trajectory(self, times: Floats) -> tuple[Floats, Floats]:
        positions, velocities = np.zeros((len(times), 3)), np.zeros((len(times), 3))
        positions[:, 2], velocities[:, 2] = self._height(times), self._speed(times)
        return positions, velocities

    def orientations(self, times: Floats) -> list[tuple[slice, Quaternion]]:
        return [(slice(0, len(times)), DOWN)]


class Spring:
    """A surface at height 0 that pushes up, with a damper, and never pulls."""

    def __init__(self, stiffness: float, damping: float = 0.0) -> None:
        self.stiffness, self.damping = stiffness, damping

    def __call__(self, times: Floats, positions: Floats, velocities: Floats) -> Floats:
        force = np.zeros_like(positions)
        depth = -positions[:, 2]
        pressing = self.stiffness * depth - self.damping * velocities[:, 2]
        force[:, 2] = np.where(depth > 0.0, np.maximum(pressing, 0.0), 0.0)
        return force


def bearing_of(compliance: Floats, sag: Floats | None = None) -> Callable[[float], Bearing]:
    wrench = np.zeros((6, 6))
    wrench[:3, :3] = compliance
    return lambda time: Bearing(wrench, np.zeros(6) if sag is None else sag)


def press(
    height: Callable[[Floats], Floats], speed: Callable[[Floats], Floats], spring: Spring
) -> CompliantPath:
    return CompliantPath(ExactPath(height, speed), MODE, bearing_of(SOFT), Contact(spring), Grid(0.0))


def step_by_step(
    height: Callable[[Floats], Floats], speed: Callable[[Floats], Floats], spring: Spring, times: Floats
) -> Floats:
    """Height of the tip (n,) at these times, by small semi-implicit steps of the tip's own equation of motion."""
    mass, step = STIFFNESS / OMEGA**2, 2e-6
    tip, velocity, now = float(height(times[:1])[0]), float(speed(times[:1])[0]), float(times[0])
    tips = []
    for time in times:
        while now < time - step / 2:
            arm, arm_speed = float(height(np.array([now]))[0]), float(speed(np.array([now]))[0])
            pull = STIFFNESS * (arm - tip) + 2.0 * MODE.damping_ratio * OMEGA * mass * (arm_speed - velocity)
            push = max(-spring.stiffness * tip - spring.damping * velocity, 0.0) if tip < 0.0 else 0.0
            velocity += (pull + push) / mass * step
            tip += velocity * step
            now += step
        tips.append(tip)
    return np.array(tips)


def six(values: Iterable[float]) -> PerAxis:
    a, b, c, d, e, f = values
    return a, b, c, d, e, f


def settled_cell(profile: PaperCellProfile, height: float) -> PaperCell:
    cell = s3_jr3_cell(profile, T0, seed=5)
    cell.robot.motion.enqueue(Waypoint((0.9, 0.0, height), DOWN, 1000.0), T0)
    return cell


def test_press_at_rest_has_series_stiffness() -> None:
    surface = SurfaceProfile(stiffness_n_m=50e3)
    rigid, soft = (
        settled_cell(PaperCellProfile(arm=arm, tool=NO_TOOL, surface=surface), 0.589).true_state(T0 + 8.0)
        for arm in (RIGID_ARM, CARTESIAN)
    )
    series = 1.0 / (1.0 / 50e3 + 1.0 / STIFFNESS)
    assert rigid.contact_force[2] == pytest.approx(50e3 * 1e-3, rel=0.07)
    assert soft.contact_force[2] == pytest.approx(rigid.contact_force[2] * series / 50e3, rel=1e-6)
    assert soft.position[2] - rigid.position[2] == pytest.approx(soft.contact_force[2] / STIFFNESS, rel=1e-6)
    assert soft.joints == rigid.joints


def test_joint_compliance_agrees_with_turned_joints() -> None:
    cell = settled_cell(PaperCellProfile(arm=JOINTS), 0.65)
    angles = cell.true_state(T0 + 8.0).joints
    assert angles is not None
    joints = six(angles)
    force = np.array([30.0, -20.0, 50.0])
    compliance = joint_compliance(cell.robot, joints, cell.robot.joint_stiffness)
    torques = []
    for axis in range(6):  # by virtual work, from turns of 0.1 mrad
        turned = six(q + (1e-4 if k == axis else 0.0) for k, q in enumerate(joints))
        difference = np.subtract(
            cell.robot.tool_pose_at(turned).position, cell.robot.tool_pose_at(joints).position
        )
        torques.append(float(difference @ force) / 1e-4)
    yielded = six(q + t / k for q, t, k in zip(joints, torques, cell.robot.joint_stiffness, strict=True))
    difference = np.subtract(
        cell.robot.tool_pose_at(yielded).position, cell.robot.tool_pose_at(joints).position
    )
    assert compliance[:3, :3] @ force == pytest.approx(difference, rel=2e-3, abs=1e-8)
    assert np.linalg.eigvalsh(compliance)[0] > 0.0


def test_weight_of_tool_lowers_it() -> None:
    tool = ToolProfile(mass_kg=2.0, centre_of_gravity_mm=(0.0, 0.0, 80.0))
    rigid, soft = (
        settled_cell(PaperCellProfile(arm=arm, tool=tool), 0.65).true_state(T0 + 8.0)
        for arm in (RIGID_ARM, CARTESIAN)
    )
    assert soft.position[2] - rigid.position[2] == pytest.approx(-2.0 * 9.80665 / STIFFNESS, rel=1e-6)
    assert rigid.contact_force == soft.contact_force == pytest.approx((0.0, 0.0, 0.0))


def test_reported_position_is_that_of_the_encoders() -> None:
    cells = [settled_cell(PaperCellProfile(arm=arm), 0.589) for arm in (RIGID_ARM, CARTESIAN)]
    rigid, soft = (cell.robot.motion.path.trajectory(np.array([T0 + 8.0]))[0] for cell in cells)
    np.testing.assert_array_equal(rigid, soft)


def test_free_tool_rings_with_its_frequency_and_damping() -> None:
    # the arm moves up at a constant speed and stops at time 1
    path = press(lambda t: 1.0 + 0.1 * np.minimum(t, 1.0), lambda t: np.where(t < 1.0, 0.1, 0.0), Spring(0.0))
    times = np.arange(0.9, 2.0, 0.0002)
    height = path.trajectory(times)[0][:, 2] - 1.1
    after = times - 1.0
    damped = OMEGA * math.sqrt(1.0 - MODE.damping_ratio**2)
    expected = 0.1 / damped * np.exp(-MODE.damping_ratio * OMEGA * after) * np.sin(damped * after)
    late = after > STEP_S
    np.testing.assert_allclose(height[late], expected[late], atol=3e-3 * 0.1 / damped)


@pytest.mark.parametrize(
    ("stiffness", "damping", "error"),
    [(5e3, 0.0, 0.005), (50e3, 20.0, 0.01), (100e3, 0.0, 0.03), (200e3, 0.0, 0.1)],
)
def test_impact_agrees_with_small_steps(stiffness: float, damping: float, error: float) -> None:
    def height(t: Floats) -> Floats:
        return 0.0005 - 0.02 * np.minimum(t, 0.1)

    def speed(t: Floats) -> Floats:
        return np.where(t < 0.1, -0.02, 0.0)

    spring = Spring(stiffness, damping)
    times = np.arange(0.001, 0.3, 0.0007)
    tips = press(height, speed, spring).trajectory(np.concatenate(([0.0], times)))[0][1:, 2]
    expected = step_by_step(height, speed, spring, np.concatenate(([0.0], times)))[1:]
    force, expected_force = (np.maximum(-stiffness * np.minimum(tip, 0.0), 0.0) for tip in (tips, expected))
    assert np.abs(force - expected_force).max() < error * expected_force.max()
    assert force[-1] == pytest.approx(expected_force[-1], rel=error)


@settings(max_examples=30, deadline=None)
@given(
    stiffness=st.floats(1e3, 200e3),
    speed=st.floats(0.002, 0.1),
    depth=st.floats(1e-4, 2e-3),
    pieces=st.integers(1, 40),
)
def test_contact_never_adds_energy(stiffness: float, speed: float, depth: float, pieces: int) -> None:
    """The arm stands still; the tool is let go above the surface with a velocity, and hits it again and again.

    A third of the usual damping removes more than the steps of the grid may add at an impact.
    """
    path = CompliantPath(
        ExactPath(lambda t: np.full(len(t), -depth), np.zeros_like),
        Mode(15.0, 0.01),
        bearing_of(SOFT),
        Contact(Spring(stiffness)),
        Grid(0.0),
    )
    path.trajectory(np.array([0.0]))
    path._rows[0, :9] = [0.0, 0.0, 2.0 * depth, 0.0, 0.0, -speed, 0.0, 0.0, 0.0]
    times = np.arange(0, 501) * STEP_S  # between two points, the interpolation adds up to 2 %
    parts = [path.trajectory(part) for part in np.array_split(times, pieces)]
    tip, velocity = (np.concatenate([part[k][:, 2] for part in parts]) for k in (0, 1))
    mass = STIFFNESS / OMEGA**2
    energy = 0.5 * mass * velocity**2 + 0.5 * STIFFNESS * (tip + depth) ** 2
    energy += 0.5 * stiffness * np.minimum(tip, 0.0) ** 2
    assert energy.max() < 1.01 * energy[0]


@settings(max_examples=25, deadline=None)
@given(cuts=st.lists(st.floats(0.0, 0.25), max_size=12))
def test_reads_do_not_change_the_motion(cuts: list[float]) -> None:
    def made() -> CompliantPath:
        return press(lambda t: 0.001 - 0.02 * t, lambda t: np.full(len(t), -0.02), Spring(50e3, 30.0))

    once, often = made(), made()
    for cut in sorted(cuts):
        often.trajectory(np.array([cut]))
    times = np.arange(0.0, 0.25, STEP_S)
    np.testing.assert_allclose(often.trajectory(times)[0], once.trajectory(times)[0], atol=1e-8)


def test_changed_order_is_followed_from_its_time_on() -> None:
    changed, plain = (settled_cell(PaperCellProfile(arm=CARTESIAN), 0.59) for _ in range(2))
    ahead = np.arange(T0, changed.predicted_until(T0 + 0.5), 0.001)
    changed.contact_forces(ahead)
    for cell in (changed, plain):
        cell.robot.motion.enqueue(Waypoint((0.9, 0.01, 0.588), DOWN, 1000.0), T0 + 0.5)
    times = T0 + np.arange(0.0, 3.0, 0.001)
    np.testing.assert_allclose(changed.contact_forces(times), plain.contact_forces(times), atol=1e-3)


def test_path_is_read_ahead_to_points_of_the_grid() -> None:
    cell = settled_cell(PaperCellProfile(arm=JOINTS), 0.59)
    for now in T0 + np.arange(0.0, 0.5, 0.0123):
        for ours, arms in (
            (cell.path.committed_until, cell.robot.path.committed_until),
            (cell.path.predicted_until, cell.robot.path.predicted_until),
        ):
            limit, arms_limit = ours(now), arms(now)
            assert now <= limit <= max(now, arms_limit)
            assert limit == now or (limit - T0) / STEP_S == pytest.approx(
                round((limit - T0) / STEP_S), abs=1e-4
            )


def test_faults_of_surface_and_obstacle_act_on_compliant_arm() -> None:
    def forces(arm: ArmProfile) -> list[float]:
        profile = PaperCellProfile(
            arm=arm,
            tool=NO_TOOL,
            obstacle=ObstacleProfile(5.0, 2e3),
            surface=SurfaceProfile(stiffness_n_m=2e3),
        )
        cell = settled_cell(profile, 0.588)
        cell.inject("surface", "step", T0 + 10.0, mm=1.0, for_s=5.0)
        cell.robot.motion.enqueue(Waypoint((0.9, 0.0, 0.608), DOWN, 1000.0), T0 + 15.0)
        return [cell.contact_forces(np.array([T0 + second]))[0, 2] for second in (9.0, 14.0, 25.0)]

    rigid, soft = forces(RIGID_ARM), forces(CARTESIAN)
    assert rigid == pytest.approx([4.0, 6.0, -6.0], abs=0.3)
    assert soft == pytest.approx(STIFFNESS / (STIFFNESS + 2e3) * np.array(rigid), rel=1e-3)


@pytest.mark.parametrize("material", MaterialKind)
def test_every_material_settles_in_series(material: MaterialKind) -> None:
    surface = SurfaceProfile(stiffness_n_m=20e3, material=MaterialProfile(kind=material))
    cell = settled_cell(PaperCellProfile(arm=CARTESIAN, tool=NO_TOOL, surface=surface), 0.589)
    state = cell.true_state(T0 + 20.0)
    arm = cell.robot.path.trajectory(np.array([T0 + 20.0]))[0][0, 2]
    assert state.contact_force[2] == pytest.approx(STIFFNESS * (state.position[2] - arm), rel=1e-3)
    assert state.contact_force[2] > 5.0


class CountingSurface:
    """A spring at 0.59 m, as of a plug-in, with a fault. It counts its samples, and turns its normal with them."""

    def __init__(self, has_memory: bool) -> None:
        self.handlers: dict[str, Any] = {"soft": print}
        self.samples, self._has_memory, self._until = 0, has_memory, -math.inf

    @property
    def remembered_until(self) -> float | None:
        return self._until if self._has_memory else None

    def force(self, positions: Floats, velocities: Floats, times: Floats) -> Floats:
        self.samples += len(times)
        self._until = float(times[-1])
        return Spring(20e3)(times, positions - [0.0, 0.0, 0.59], velocities)

    def aside(self) -> Any:
        return copy.copy(self)

    def rewind(self, time: float) -> None:
        self._until = min(self._until, time)

    def normals(self, positions: Floats, times: Floats) -> Floats:
        angle = self._until - T0
        return np.tile([math.sin(angle), 0.0, math.cos(angle)], (len(times), 1))


def plugin_cell(arm: ArmProfile, surface: CountingSurface) -> Cell[Any, Any]:
    profile = PaperCellProfile(arm=arm)
    sensor = make_gateway(profile.sensor, profile.gateway)
    cell = Cell(profile, T0, 5, Parts(make_robot(profile, EMPTY_SITE), sensor, lambda on_change: surface))
    cell.robot.motion.enqueue(Waypoint((0.9, 0.0, 0.589), DOWN, 1000.0), T0)
    return cell


@pytest.mark.parametrize("arm", [RIGID_ARM, JOINTS])
def test_faulty_plugin_surface_receives_each_sample(arm: ArmProfile) -> None:
    surface = CountingSurface(has_memory=False)
    cell = plugin_cell(arm, surface)
    cell.wrench(T0 + np.arange(1, 1001) / 1000)
    assert surface.samples == 1000


def test_true_normal_is_that_after_the_motion() -> None:
    cell = plugin_cell(RIGID_ARM, CountingSurface(has_memory=True))
    normal = cell.true_state(T0 + 0.5).normal
    assert normal == pytest.approx((math.sin(0.5), 0.0, math.cos(0.5)), abs=1e-3)


def test_compliance_follows_turn_of_tool() -> None:
    class TurningPath(ExactPath):
        def orientations(self, times: Floats) -> list[tuple[slice, Quaternion]]:
            turned = int(np.searchsorted(times, 0.1995))
            sideways = (math.sqrt(0.5), 0.0, math.sqrt(0.5), 0.0)
            parts = [(slice(0, turned), DOWN), (slice(turned, len(times)), sideways)]
            return [(part, quaternion) for part, quaternion in parts if part.start < part.stop]

    computed_at: list[float] = []

    def bearing(time: float) -> Bearing:
        computed_at.append(time)
        return bearing_of(SOFT)(time)

    path = TurningPath(np.zeros_like, np.zeros_like)
    CompliantPath(path, MODE, bearing, Contact(Spring(5e3)), Grid(0.0)).trajectory(np.array([0.0, 0.5]))
    assert computed_at == pytest.approx([0.0, 0.2], abs=1e-8)


def test_joint_compliance_without_joints_is_refused() -> None:
    with pytest.raises(ValueError, match="has no model of its joints"):
        compliance.bearing_of(JOINTS, cast(Any, object()), Load(0.0, (0.0, 0.0, 0.0)))


def test_stiffness_without_inverse_is_refused() -> None:
    with pytest.raises(SettingError, match="stiffness_n_m must be a positive definite matrix"):
        ArmProfile(stiffness_n_m=(1e4, 1e4, 1e4, 2e4, 0.0, 0.0))
    with pytest.raises(SettingError, match="joint_stiffness_nm_rad must be more than 0"):
        ArmProfile(joint_stiffness_nm_rad=(1e4, 1e4, 1e4, 0.0, 1e4, 1e4))
