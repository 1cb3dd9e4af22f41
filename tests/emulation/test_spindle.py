"""Tests of a turning tool: unbalance and run-out in the wrench, in the true force, and in the motion of the arm."""

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from emulators.arm.compliance import ArmProfile
from emulators.arm.compliant_path import FINE_STEP_S
from emulators.arm.waypoints import Waypoint
from emulators.devices.egm.controller import EgmController
from emulators.seams import ContactSource, Floats
from emulators.surface.contact import SurfaceKind, SurfaceProfile
from emulators.surface.materials import MaterialKind, MaterialProfile
from emulators.surface.removal import RemovalProfile
from emulators.tool import ToolProfile
from hil_bridge.runs.compose import make_cell
from hil_bridge.runs.setup import Setup
from hil_bridge.settings.configuration import read_config
from protocol.geometry import Vector
from protocol.marks import SettingError
from tests.paper_cell import RIGID_ARM, PaperCell, PaperCellProfile, s3_jr3_cell

T0 = 777.125
DOWN = (0.0, 1.0, 0.0, 0.0)
SETTLED = T0 + 8.0
LENGTH = 0.2
FREE, PRESSED = 0.6, 0.589
STIFFNESS = 20e3
ARM_STIFFNESS = 30e3
CARTESIAN = ArmProfile(compliance="cartesian", frequency_hz=15.0, damping_ratio=0.03)
EXACT: dict[str, Any] = {"radial_run_out_um": 0.0, "axial_run_out_um": 0.0}
"""Settings of a tool without run-out."""
SMOOTH: dict[str, Any] = {"stiffness_n_m": STIFFNESS, "damping_ns_m": 0.0, "friction": 0.0}


def cell_at(
    height: float, surface: SurfaceProfile | None = None, arm: ArmProfile | None = None, **tool: Any
) -> PaperCell:
    """Return a cell whose tool stands at this height, m, from `SETTLED` on."""
    profile = PaperCellProfile(
        tool=ToolProfile(**tool),
        surface=surface or SurfaceProfile(stiffness_n_m=STIFFNESS),
        arm=arm or RIGID_ARM,
    )
    cell = s3_jr3_cell(profile, T0, seed=5)
    cell.robot.motion.enqueue(Waypoint((0.9, 0.0, height), DOWN, 1000.0), T0)
    return cell


def second_at(rate_hz: int) -> Floats:
    """Return the sample times of a second, s."""
    return SETTLED + np.arange(rate_hz) / rate_hz


def spectrum(signal: Floats) -> np.ndarray:
    """Return the complex amplitudes of the columns of a second (n, m): row k belongs to k Hz."""
    amplitudes = np.fft.rfft(signal, axis=0) / len(signal)
    amplitudes[1:] *= 2.0
    return amplitudes


def centrifugal(rpm: float, unbalance_g_mm: float = 2.5) -> float:
    return unbalance_g_mm * 1e-6 * (rpm * math.tau / 60.0) ** 2


@pytest.mark.parametrize(("rpm", "hertz"), [(900.0, 15), (6000.0, 100), (12_000.0, 200)])
def test_unbalance_adds_rotating_force_and_its_moment(rpm: float, hertz: int) -> None:
    wrench = cell_at(FREE, spindle_rpm=rpm, unbalance_g_mm=4.0).wrench(second_at(8000))
    fx, fy, fz, mx, my, mz = spectrum(wrench - cell_at(FREE).wrench(second_at(8000))).T
    assert abs(fx[hertz]) == pytest.approx(centrifugal(rpm, 4.0), rel=1e-9)
    # right-handed about tool z: y follows x by a quarter of a turn
    assert fy[hertz] == pytest.approx(-1j * fx[hertz], abs=1e-9)
    assert mx == pytest.approx(-LENGTH * fy, abs=1e-12)
    assert my == pytest.approx(LENGTH * fx, abs=1e-12)
    assert np.abs(np.concatenate((fz, mz))).max() == 0.0
    others = np.delete(np.stack((fx, fy)), hertz, axis=1)
    assert np.abs(others).max() < 1e-9


@pytest.mark.parametrize(("rate_hz", "alias_hz"), [(100, 10), (80, 30), (63, 16), (110, 0)])
def test_slow_samples_alias_unbalance_at_full_amplitude(rate_hz: int, alias_hz: int) -> None:
    rpm = 6600.0  # 110 Hz
    wrench = cell_at(FREE, spindle_rpm=rpm).wrench(second_at(rate_hz))
    moving = np.abs(spectrum(wrench[:, :2]))
    if alias_hz == 0:  # once per turn: a constant force
        assert np.linalg.norm(wrench[0, :2]) == pytest.approx(centrifugal(rpm))
        assert moving[1:].max() < 1e-9
    else:
        assert moving[alias_hz] == pytest.approx([centrifugal(rpm)] * 2, rel=1e-9)
        assert np.delete(moving, alias_hz, axis=0).max() < 1e-9


@pytest.mark.parametrize("radius_mm", [0.0, 10.0])
@pytest.mark.parametrize("damping", [0.0, 30.0])
def test_axial_run_out_adds_force_by_stiffness(damping: float, radius_mm: float) -> None:
    surface = SurfaceProfile(**{**SMOOTH, "damping_ns_m": damping})
    tool: dict[str, Any] = {"face_radius_mm": radius_mm, "face_rings": 1}
    turning: dict[str, Any] = {
        "spindle_rpm": 6000.0,
        "unbalance_g_mm": 0.0,
        "radial_run_out_um": 0.0,
        "axial_run_out_um": 30.0,
    }
    times = second_at(2000)
    force = cell_at(PRESSED, surface, **tool, **turning).contact_forces(times)
    still = cell_at(PRESSED, surface, **tool).contact_forces(times)
    amplitudes = np.abs(spectrum(force - still))
    expected = math.hypot(STIFFNESS, damping * 100.0 * math.tau) * 15e-6
    assert amplitudes[100, 2] == pytest.approx(expected, rel=1e-6)
    assert np.delete(amplitudes, 100, axis=0).max() < 1e-9


def test_radial_run_out_changes_depth_on_slope() -> None:
    slope = 30.0
    surface = SurfaceProfile(**SMOOTH, kind=SurfaceKind.SLOPED, slope_deg=slope)
    turning: dict[str, Any] = {
        "spindle_rpm": 6000.0,
        "unbalance_g_mm": 0.0,
        "radial_run_out_um": 40.0,
        "axial_run_out_um": 0.0,
    }
    force = cell_at(PRESSED, surface, **turning).contact_forces(second_at(2000))
    along_normal = np.linalg.norm(force, axis=1)[:, None]
    expected = STIFFNESS * 20e-6 * math.sin(math.radians(slope))
    assert abs(spectrum(along_normal)[100, 0]) == pytest.approx(expected, rel=1e-6)


def test_true_force_has_run_out_but_no_unbalance() -> None:
    times = second_at(2000)
    free, pressed = (
        cell_at(height, SurfaceProfile(**SMOOTH), spindle_rpm=6000.0) for height in (FREE, PRESSED)
    )
    assert not free.contact_forces(times).any()
    force, wrench = pressed.contact_forces(times), pressed.wrench(times)
    assert abs(spectrum(force)[100, 2]) == pytest.approx(STIFFNESS * 10e-6, rel=1e-6)
    assert not force[:, :2].any()
    assert abs(spectrum(wrench)[100, 0]) == pytest.approx(centrifugal(6000.0), rel=1e-6)
    states = pressed.true_states(times[:50].tolist())
    np.testing.assert_array_equal([state.contact_force for state in states], force[:50])
    assert {state.position for state in states} == {states[0].position}


def test_robot_estimates_contact_without_unbalance(monkeypatch: pytest.MonkeyPatch) -> None:
    sources: list[ContactSource] = []
    monkeypatch.setattr(EgmController, "feel", lambda self, contact: sources.append(contact))
    tool = {"spindle_rpm": 6000.0, "unbalance_g_mm": 100.0}
    surface = {"stiffness_n_m": STIFFNESS, "friction": 0.0}
    config = {
        "robot": {"emulated": "egm"},
        "cell": {"tool": tool, "surface": surface, "start_position_mm": (900.0, -100.0, 589.0)},
    }
    cell = make_cell(Setup(read_config(config)), T0)
    forces: list[Vector] = [sources[0](T0 + 0.002 * k) for k in range(5)]
    assert forces[0][2] != forces[1][2]
    assert all(force[:2] == (0.0, 0.0) for force in forces)
    np.testing.assert_array_equal(cell.contact_forces(T0 + 0.002 * np.arange(5.0)), forces)


@settings(max_examples=20, deadline=None)
@given(cuts=st.lists(st.integers(0, 1400), max_size=12), radius_mm=st.sampled_from((0.0, 10.0)))
def test_wrench_is_independent_of_reads(cuts: list[int], radius_mm: float) -> None:
    times = SETTLED + np.arange(1400) / 7000
    tool: dict[str, Any] = {"spindle_rpm": 11_234.0, "face_radius_mm": radius_mm, "face_rings": 1}
    once, cut = (cell_at(PRESSED, **tool) for _ in range(2))
    parts = [cut.wrench(part) for part in np.split(times, sorted(cuts))]
    np.testing.assert_array_equal(np.concatenate(parts), once.wrench(times))


def test_material_with_memory_receives_run_out_between_reads() -> None:
    surface = SurfaceProfile(
        stiffness_n_m=STIFFNESS, material=MaterialProfile(MaterialKind.STANDARD_LINEAR_SOLID)
    )
    often, seldom = (cell_at(PRESSED, surface, spindle_rpm=6000.0) for _ in range(2))
    times = T0 + np.arange(1, 16_001) / 8000
    expected = often.wrench(times)
    for k in range(15_000, 16_000, 160):
        np.testing.assert_allclose(seldom.wrench(times[k : k + 1])[0], expected[k], rtol=0, atol=1e-9)
    assert np.ptp(expected[15_000:, 2]) > 0.1


def test_tool_without_spindle_ignores_its_errors() -> None:
    times = second_at(2000)
    errors: dict[str, Any] = {
        "unbalance_g_mm": 500.0,
        "radial_run_out_um": 900.0,
        "axial_run_out_um": 900.0,
    }
    for arm in (RIGID_ARM, CARTESIAN):
        plain, still = cell_at(PRESSED, arm=arm), cell_at(PRESSED, arm=arm, **errors)
        np.testing.assert_array_equal(still.wrench(times), plain.wrench(times))
        np.testing.assert_array_equal(still.contact_forces(times), plain.contact_forces(times))


@pytest.mark.parametrize("rpm", [600.0, 900.0, 3000.0, 12_000.0, 20_000.0])
def test_unbalance_moves_compliant_arm(rpm: float) -> None:
    """The arm receives the force as linear between the points of its grid, which lowers it by sinc² of their ratio.

    Above a tenth of the grid's rate, the harmonics of these lines add 0.5 %, and 7 % at 20 000 turns a minute.
    """
    cell = cell_at(FREE, arm=CARTESIAN, spindle_rpm=rpm, unbalance_g_mm=50.0)
    times = SETTLED + 2.0 + np.arange(0.0, 1.0, FINE_STEP_S)
    offset = cell.path.trajectory(times)[0]
    hertz = rpm / 60.0
    ratio = hertz / 15.0
    response = 1.0 / (1.0 - ratio**2 + 2j * 0.03 * ratio)
    expected = centrifugal(rpm, 50.0) / ARM_STIFFNESS * abs(response) * np.sinc(hertz * FINE_STEP_S) ** 2
    # by a fit, because 20 000 turns a minute do not have an integer number of periods in a second
    base = np.column_stack((np.exp(1j * math.tau * hertz * times), np.exp(-1j * math.tau * hertz * times)))
    base = np.column_stack((base, np.ones(len(times))))
    fitted = np.linalg.lstsq(base, offset[:, :2].astype(complex), rcond=None)[0]
    assert 2.0 * np.abs(fitted[0]) == pytest.approx([expected] * 2, rel=3e-3 if hertz < 100.0 else 0.07)


def test_unbalance_of_compliant_arm_is_not_contact() -> None:
    cell = cell_at(PRESSED, SurfaceProfile(**SMOOTH), CARTESIAN, spindle_rpm=900.0, **EXACT)
    times = second_at(2000)
    force = cell.contact_forces(times)
    assert not force[:, :2].any()
    assert force[:, 2] == pytest.approx(force[0, 2], rel=1e-6)
    assert abs(spectrum(cell.wrench(times))[15, 0]) == pytest.approx(centrifugal(900.0), rel=1e-6)


def test_spinning_face_has_torsional_friction_and_no_drag() -> None:
    radius, friction = 0.02, 0.3
    surface = SurfaceProfile(stiffness_n_m=STIFFNESS, damping_ns_m=0.0, friction=friction)
    cell = cell_at(
        PRESSED, surface, face_radius_mm=1e3 * radius, spindle_rpm=3000.0, unbalance_g_mm=0.0, **EXACT
    )
    cell.robot.motion.enqueue(Waypoint((0.9, 0.2, PRESSED), DOWN, 0.02), SETTLED)
    fx, fy, _, _, _, mz = cell.wrench(np.array([SETTLED + 3.0]))[0]
    truth = cell.true_state(SETTLED + 3.0)
    normal, speed = truth.contact_force[2], np.linalg.norm(truth.velocity)
    assert speed == pytest.approx(0.02, rel=0.02)
    # Right-handed about tool z, so friction acts left-handed, with a lever arm of 2/3 of the radius.
    assert mz == pytest.approx(-2.0 / 3.0 * radius * friction * normal, rel=0.02)
    # one of the 37 points is in the middle, and has no speed but that of the path
    assert math.hypot(fx, fy) == pytest.approx(
        friction * normal * (1.0 / 37.0 + 36.0 / 37.0 * speed / (radius * 100.0 * math.pi)), rel=0.1
    )


def test_spinning_face_removes_by_its_sliding_speed() -> None:
    surface = SurfaceProfile(**SMOOTH, removal=RemovalProfile(0.01))
    cell = cell_at(PRESSED, surface, face_radius_mm=10.0, spindle_rpm=3000.0, unbalance_g_mm=0.0, **EXACT)
    cell.wrench(np.array([SETTLED]))
    before = cell.removed
    cell.wrench(np.arange(SETTLED, SETTLED + 0.5, 1 / 8000)[1:])
    after = cell.removed
    assert before is not None
    assert after is not None
    volume = (after.depths - before.depths).sum() * after.spacing**2
    force = cell.contact_forces(np.array([SETTLED + 0.5]))[0, 2]
    mean_speed = 2.0 / 3.0 * 0.01 * 100.0 * math.pi
    assert volume == pytest.approx(0.01 * 1e-10 * force * mean_speed * 0.5, rel=0.03)


def test_spindle_above_limit_is_refused() -> None:
    with pytest.raises(SettingError, match="spindle_rpm must be at most 30000, got 40000"):
        ToolProfile(spindle_rpm=40_000.0)
