"""Tests of the errors and oscillations of the emulated Universal Robot's force mode, against published measurements.

Forces over the work space: Trochimczuk et al., Sensors 26 (2026) 1709, doi:10.3390/s26051709 (a UR5e). Bounces:
Universal Robots' forum, thread 22537 (a UR10e). Acceleration and settling: Gadringer et al., Mech. Sci. 13 (2022) 361,
doi:10.5194/ms-13-361-2022, and their plots in JKU-Linz-Institute-of-Robotics/ur10e_force_control_comparison (a UR10e).
"""

import math
import statistics
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from emulators.arm.own_force import WITNESS_FAULTS
from emulators.devices.rtde import RtdeProfile, RtdeRobot
from emulators.devices.rtde.kinematics import ARMS, USUAL, Joints, compose, invert, nearest
from emulators.devices.rtde.pose_error import PoseError
from emulators.faults import Ledger
from emulators.seams import StartPose
from hil_bridge.runs.compose import make_cell
from hil_bridge.runs.setup import Setup
from hil_bridge.settings.configuration import read_config
from protocol.devices.rtde.states import SafetyMode
from protocol.devices.rtde.wires import Port
from protocol.geometry import Pose
from tests.emulation.exact_arm import EXACT, exact_profile
from tests.emulation.test_urscript_force import HOLD, Surface
from tests.emulation.test_urscript_motion import T0, Bench

DOWN = (0.0, 1.0, 0.0, 0.0)
PUBLISHED_N = (8.95, 13.26)
"""Least and largest mean contact force over 25 places, for 10 N desired."""
UR5E = RtdeProfile(model="ur5e")
PLACES = [
    StartPose((radius * math.cos(angle), radius * math.sin(angle), 0.15), DOWN, 0.1)
    for radius in (0.35, 0.44, 0.53, 0.62, 0.71)
    for angle in (math.radians(degrees) for degrees in (-60, -30, 0, 30, 60))
]
"""25 places of the work space of a UR5e with its tool down."""


def hold(bench: Bench, seconds: float, newtons: float = 10.0, settings: str = "") -> None:
    line = HOLD.replace("-10", str(-newtons)).replace("0.1,0.1,0.1", "0.25,0.25,0.25")
    bench.send(f"def hold():\n  zero_ftsensor()\n{settings}  {line}\n  sleep({seconds})\nend\n")


def held_forces(
    bench: Surface, seconds: float = 3.0, newtons: float = 10.0, settings: str = ""
) -> list[float]:
    """Return the contact force in each cycle, N, from the first contact on."""
    hold(bench, seconds + 1.0, newtons, settings)
    forces = bench.forces(seconds)
    assert bench.controller.state.safety == SafetyMode.NORMAL
    return forces[next(index for index, force in enumerate(forces) if force > 0.0) :]


def losses(forces: list[float]) -> int:
    """Return how often the tool left the surface."""
    return sum(before > 0.0 == after for before, after in pairwise(forces))


def mean_force(start: StartPose, profile: RtdeProfile, seed: int) -> float:
    """Return the mean contact force for 10 N desired on a surface of 20 kN/m, N."""
    return statistics.mean(held_forces(Surface(20e3, profile, start, seed), 1.4)[-250:])


def joints_at(start: StartPose) -> Joints:
    tool = invert(Pose((0.0, 0.0, start.tool_length), (1.0, 0.0, 0.0, 0.0)))
    joints = nearest(ARMS["ur5e"], compose(Pose(start.position, start.quaternion), tool), USUAL)
    assert joints is not None
    return joints


# --- error over the work space


def test_mean_force_over_places_errs_as_published() -> None:
    """With noise and drift of the force, which the program has zeroed: 0.3 N."""
    means = [mean_force(start, UR5E, 7) for start in PLACES]
    print(f"\n{min(means):.2f} to {max(means):.2f} N, standard deviation {statistics.stdev(means):.2f} N")
    assert len(means) == 25
    assert min(means) > PUBLISHED_N[0] - 0.3
    assert max(means) < PUBLISHED_N[1] + 0.3
    assert max(means) - min(means) > 0.7 * (PUBLISHED_N[1] - PUBLISHED_N[0])


def test_deviation_over_places_fills_published_range() -> None:
    joints = [joints_at(start) for start in PLACES]
    spreads = []
    for seed in range(100):
        error = PoseError(UR5E.force_pose_error_n, seed)
        forces = [10.0 + error.deviation(each) for each in joints]
        assert PUBLISHED_N[0] - 1e-9 <= min(forces) <= max(forces) <= PUBLISHED_N[1] + 1e-9
        spreads.append(max(forces) - min(forces))
    assert 3.4 < statistics.median(spreads) < 4.31


def test_measured_force_lacks_deviation_at_10_n_and_more() -> None:
    error, joints = PoseError((-1.05, 3.26), 3), joints_at(PLACES[4])
    deviation = error.deviation(joints)
    assert abs(deviation) > 0.1
    for contact in (10.0 + deviation, 40.0, 150.0):
        assert error.measure((0.0, 0.0, contact), joints)[2] == pytest.approx(contact - deviation)
    half = 0.5 * (10.0 + deviation)
    assert error.measure((0.0, 0.6 * half, 0.8 * half), joints) == pytest.approx((0.0, 3.0, 4.0))
    assert error.measure((0.0, 0.0, 0.0), joints) == (0.0, 0.0, 0.0)


def test_force_mode_repeats_for_seed_alone() -> None:
    forces = [held_forces(Surface(20e3, UR5E, PLACES[12], seed), 0.8) for seed in (1, 1, 2)]
    assert forces[0] == forces[1] != forces[2]


def test_pose_error_of_zero_leaves_exact_force() -> None:
    profile = exact_profile(model="ur5e")
    for start in PLACES[::8]:
        assert mean_force(start, profile, 7) == pytest.approx(10.0, abs=0.01)
        erring = replace(profile, force_pose_error_n=(1.0, 1.0))
        assert mean_force(start, erring, 7) == pytest.approx(11.0, abs=0.01)


# --- other sensors


@pytest.mark.parametrize("kind", ["ft300", "netft"])
def test_sensor_at_wrist_ignores_pose_error(kind: str) -> None:
    """The tool moves 1 mm deep into the surface; its sensor measures the same, the arm does not."""
    wrenches, own_forces = [], []
    for error in ((0.0, 0.0), (1.0, 1.0)):
        profile = {"force_pose_error_n": list(error)}
        config = read_config(
            {"robot": {"emulated": "rtde"}, "sensor": {"emulated": kind}, "cell": {"rtde": profile}}
        )
        cell = make_cell(Setup(config), T0)
        robot, depth_mm = cell.robot, config.cell.start_position_mm[2] - config.cell.surface.height_mm + 1.0
        assert isinstance(robot, RtdeRobot)
        port = robot.connect(Port.SCRIPT, T0)
        assert port is not None
        port.receive(
            f"movel(pose_add(get_actual_tcp_pose(), p[0,0,{-depth_mm * 1e-3},0,0,0]), t=1)\n".encode(), T0
        )
        for cycle in range(1, 701):
            robot.controller.advance(T0 + cycle * robot.controller.period)
        wrenches.append(cell.wrench(T0 + np.linspace(0.5, 1.3, 50)))
        own_forces.append(robot.controller.force.tool_force[2])
    np.testing.assert_array_equal(wrenches[0], wrenches[1])
    assert np.abs(wrenches[0]).max() > 1.0
    assert abs(own_forces[0] - own_forces[1]) > 0.1


def test_force_mode_by_external_force_ignores_pose_error() -> None:
    """The client sends the contact force in the axes of the flange, which points down."""
    places = []
    for error in ((0.0, 0.0), (-1.05, 3.26)):
        bench = Surface(5e3, exact_profile(force_pose_error_n=error))
        hold(bench, 9.0, settings="  set_payload(0)\n  ft_rtde_input_enable(True)\n")
        for _ in range(1500):
            wrench = (0.0, 0.0, -bench.force, 0.0, 0.0, 0.0)
            bench.controller.write_inputs(("external_force_torque",), {"external_force_torque": wrench})
            bench.run(bench.controller.period)
        assert bench.force == pytest.approx(10.0, abs=0.05)
        places.append(bench.place)
    assert places[0] == places[1]


# --- acceleration, bounces and settling


@pytest.mark.parametrize(
    ("newtons", "scaling", "measured"),
    [(15.0, 0.5, 0.13), (15.0, 1.0, 0.231), (35.0, 0.5, 0.277), (35.0, 1.0, 0.485), (55.0, 0.5, 0.42)],
)
def test_free_axis_accelerates_as_recorded(newtons: float, scaling: float, measured: float) -> None:
    """The recorded accelerations, m/s², are means from the start of the motion to the contact, at a damping of 0."""
    bench = Bench(EXACT)
    settings = f"  force_mode_set_damping(0)\n  force_mode_set_gain_scaling({scaling})\n"
    hold(bench, 9.0, newtons, settings)
    bench.run(0.1)
    first = bench.place[2]
    bench.run(0.1)
    second = bench.place[2]
    bench.run(0.1)
    acceleration = -(bench.place[2] - 2.0 * second + first) / 0.1**2
    assert acceleration == pytest.approx(measured, rel=0.15)


def test_axis_accelerates_from_rest_after_pause() -> None:
    bench = Bench(EXACT)
    hold(bench, 9.0, 15.0, "  force_mode_set_damping(0)\n")
    bench.run(0.4)
    bench.controller.player.pause()
    bench.run(0.2)
    before = bench.place[2]
    bench.controller.play()
    bench.run(0.05)
    assert (
        0.0 < before - bench.place[2] < 0.5 * 0.25 * 0.05**2
    )  # 0.23 m/s²; 4 mm at the speed before the pause


def test_force_mode_continues_after_invalid_force() -> None:
    """The force is not a number for a time; the robot stops, is released and holds the force again."""
    bench = Surface(20e3, EXACT)
    hold(bench, 60.0)
    bench.run(1.0)
    ledger = Ledger({"witness": WITNESS_FAULTS})
    ledger.attach("witness", bench.robot.handlers["witness"])
    ledger.inject("witness", "nan", bench.now, {"for_s": 0.1})
    bench.run(0.2)
    state = bench.controller.state
    assert state.safety == SafetyMode.PROTECTIVE_STOP
    bench.run(6.0)
    assert state.unlock(bench.now)
    bench.controller.play()
    assert bench.forces(2.0)[-1] == pytest.approx(10.0, abs=0.1)
    assert state.safety == SafetyMode.NORMAL


@pytest.mark.parametrize(
    ("stiffness_n_m", "least_losses"), [(50e3, 1), (100e3, 3), (200e3, 10)], ids=["50", "100", "200"]
)
def test_default_gain_bounces_on_stiff_surface(stiffness_n_m: float, least_losses: int) -> None:
    forces = held_forces(Surface(stiffness_n_m, EXACT))
    print(f"\n{stiffness_n_m:g} N/m: left {losses(forces)} times, peak {max(forces):.1f} N")
    assert losses(forces) >= least_losses
    assert max(forces) > 35.0


def test_stiffest_surface_keeps_tool_oscillating() -> None:
    forces = held_forces(Surface(200e3, EXACT))
    assert statistics.pstdev(forces[-250:]) > 5.0
    damped = held_forces(Surface(200e3, EXACT), settings="  force_mode_set_damping(0.1)\n")
    assert damped[-250:] == pytest.approx([10.0] * 250, abs=0.1)


@pytest.mark.parametrize(("stiffness_n_m", "scaling"), [(50e3, 0.1), (100e3, 0.1), (5e3, 1.0), (20e3, 1.0)])
def test_low_gain_or_soft_surface_is_calm(stiffness_n_m: float, scaling: float) -> None:
    settings = f"  force_mode_set_gain_scaling({scaling})\n"
    forces = held_forces(Surface(stiffness_n_m, EXACT), settings=settings)
    assert losses(forces) == 0
    assert forces[-250:] == pytest.approx([10.0] * 250, abs=0.1)


@pytest.mark.parametrize(("newtons", "measured_s"), [(15.0, 0.6), (35.0, 0.72), (55.0, 0.84)])
def test_force_settles_within_recorded_time(newtons: float, measured_s: float) -> None:
    """Published: 0.58 to 0.64 s, 0.69 to 0.76 s and 0.81 to 0.86 s for these forces. Their error band is not stated;
    10 % here.
    """
    bench = Surface(50e3, EXACT)
    forces = held_forces(bench, 2.0, newtons, "  force_mode_set_damping(0)\n")
    last = max(index for index, force in enumerate(forces) if abs(force - newtons) > 0.1 * newtons)
    settling_s = last * bench.controller.period
    print(f"\n{newtons:g} N: {settling_s:.2f} s")
    assert settling_s == pytest.approx(measured_s, rel=0.4)
