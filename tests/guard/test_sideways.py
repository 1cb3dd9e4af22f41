"""Forces across the approach where the tool's weight verifies no axis: dead, mirrored or turned from power-up."""

import math
from collections.abc import Callable
from typing import Any

import pytest

from hil_bridge.control.course.sideways import Lever, compare_moment, is_confirmed_by_moments
from hil_bridge.control.course.zero import doubtful_axes
from hil_bridge.control.geometry.wrist import Wrist
from hil_bridge.errors import Cause
from hil_bridge.record import Outcome
from hil_bridge.runs.axis_evidence import AxisEvidence
from hil_bridge.settings.configuration import Config
from tests.near_surface import awake_config, merged

pytestmark = pytest.mark.sweep

Guarded = Any
Run = Callable[..., Guarded]

RETRACT = {"do": "retract", "back_mm": 3.0}
LINE = {"kind": "line", "length_mm": 15.0}
ASIDE = {"kind": "line", "length_mm": 15.0, "direction_deg": 90.0}
TASKS: dict[str, list[dict[str, Any]]] = {
    "plain": [],
    "seek": [
        {"do": "seek", "direction_deg": 0.0, "at_most_mm": 15.0, "contact_n": 2.0},
        {"do": "approach"},
        RETRACT,
    ],
    "move": [{"do": "move", "to_mm": [15.0, 0.0], "speed_mm_s": 10.0}, {"do": "approach"}, RETRACT],
    "track": [
        {"do": "approach"},
        {"do": "track", "path": LINE, "speed_mm_s": 5.0, "lateral_limit_n": 20.0},
        RETRACT,
    ],
    "across": [
        {"do": "approach"},
        {"do": "track", "path": ASIDE, "across": "force", "across_n": -5.0},
        RETRACT,
    ],
}
FAULTS = {"dead": {}, "sign": {}, "scale": {"factor": 0.1}}


def near_wall(robot: str, task: str, fault: str, stiffness: float, wall: bool = True) -> Config:
    """Return the settings of a wall 4 mm along the path or 1 mm next to it, with Fy wrong from power-up. `fault` is a
    fault of the signal, or an error of the sensor's mounting angle.
    """
    surface: dict[str, Any] = {"stiffness_n_m": stiffness}
    if wall:
        wall_at = -99.0 if task == "across" else -96.0
        surface |= {"wall_at_mm": wall_at, "wall_stiffness_n_m": stiffness, "wall_height_mm": 30.0}
    values: dict[str, Any] = {
        "run": {"duration_s": 3.0},
        "cell": {
            "start_position_mm": (900.0, -100.0, 591.0),
            "surface": surface,
        },
        "task": {"expected_stiffness_n_m": stiffness, "retract_mm": 3.0, "step": TASKS[task]},
    }
    if robot != "s3":
        stream = {"run": {"period_ms": 20}, "controller": {"sample_ms": 20}, "sensor": {"emulated": "netft"}}
        values = merged(values, {**stream, "robot": {"emulated": robot}})
    if fault in FAULTS:
        how = {"axis": "fy", **FAULTS[fault]}
        values["faults"] = [{"on": "signal", "fault": fault, "phase": "connect", "for_s": 600.0, "with": how}]
    else:
        values = merged(values, {"sensor": {"mounting_deg": float(fault)}})
    return awake_config(values)


@pytest.mark.parametrize(
    ("robot", "task", "fault", "stiffness", "most"),
    [
        ("s3", "plain", "dead", 5e3, 25.0),
        ("s3", "plain", "90", 5e4, 75.0),
        ("egm", "plain", "sign", 5e4, 25.0),
        ("rtde", "plain", "dead", 5e4, 35.0),
        ("rsi", "plain", "180", 5e3, 35.0),
        ("s3", "seek", "sign", 5e4, 15.0),
        ("egm", "seek", "90", 5e4, 15.0),
        ("rtde", "seek", "dead", 5e3, 10.0),
        ("rsi", "seek", "scale", 5e4, 15.0),
        ("s3", "move", "dead", 5e4, 65.0),
        ("egm", "move", "sign", 5e4, 35.0),
        ("rsi", "move", "90", 5e4, 30.0),
        ("egm", "track", "dead", 5e4, 30.0),
        ("rsi", "track", "180", 5e3, 30.0),
        ("s3", "across", "sign", 5e4, 25.0),
        ("rtde", "across", "dead", 5e3, 25.0),
    ],
)
def test_unverified_axis_at_wall_is_stopped_and_comes_off(
    guarded: Run, robot: str, task: str, fault: str, stiffness: float, most: float
) -> None:
    run = guarded(near_wall(robot, task, fault, stiffness))
    assert run.result.outcome is Outcome.STOPPED
    assert run.largest < most
    # an S3 that presses the wall by a wrong axis does not come off in steps of 0.125 mm, and reports that
    stays = (robot, task) == ("s3", "across")
    assert run.last < (10.0 if stays else 1.0)
    assert run.result.rest.retracted is not stays
    assert run.result.rest.unverified or fault not in FAULTS


def test_contact_at_wall_with_turned_sensor_is_reported(guarded: Run) -> None:
    """A lateral force rotated with the sensor moves the tool back along the wall; the last line reports the contact."""
    run = guarded(near_wall("egm", "across", "90", 5e4))
    assert run.last > 5.0
    assert not run.result.rest.retracted
    assert run.result.rest.force == pytest.approx(run.last, abs=1.0)


@pytest.mark.parametrize("robot", ["s3", "egm", "rtde", "rsi"])
def test_retracted_after_confirmed_friction_names_no_axis(guarded: Run, robot: str) -> None:
    run = guarded(near_wall(robot, "plain", "0", 5e3, wall=False))
    assert run.result.outcome is Outcome.COMPLETED
    assert run.result.rest.unverified == ()


def test_free_motion_only_names_unverified_axes(guarded: Run) -> None:
    run = guarded(near_wall("egm", "move", "0", 5e3, wall=False))
    assert run.result.outcome is Outcome.COMPLETED
    assert run.result.left.endswith("(Fx Fy not verified)")
    assert run.result.rest.values["unverified"] == ["Fx", "Fy"]


# --- moments in addition to forces

LEVER = Lever((0.0, 0.0, 0.2), (0.0, 0.0, 0.0))
DOWN = (0.0, 0.0, 1.0)


def wrench_of(force: tuple[float, float, float], arm: float = 0.2) -> tuple[float, ...]:
    """Force at the tool's end and its moment about the sensor."""
    x, y, _ = force
    return (*force, -arm * y, arm * x, 0.0)


@pytest.mark.parametrize("force", [(3.0, -20.0, -10.0), (0.0, 0.0, -10.0), (30.0, 0.0, -10.0)])
def test_compare_moment_of_true_force_hides_nothing(force: tuple[float, float, float]) -> None:
    result = compare_moment(LEVER, wrench_of(force), DOWN, 10.0)
    assert result.hidden == 0.0
    assert result.confirmed == (math.hypot(*force[:2]) > 0.5)


@pytest.mark.parametrize(("reported", "hidden"), [(0.0, 20.0), (20.0, 40.0), (-2.0, 18.0), (-40.0, 0.0)])
def test_compare_moment_of_wrong_axis_shows_the_rest(reported: float, hidden: float) -> None:
    _, _, *rest = wrench_of((0.0, -20.0, -10.0))
    result = compare_moment(LEVER, (0.0, reported, *rest), DOWN, 10.0)
    slack = 1.0 + 0.1 * 10.0
    assert result.hidden == pytest.approx(max(hidden - slack, 0.0))
    assert not result.confirmed or reported == -40.0


def test_compare_moment_counts_from_the_sensor_not_the_frame() -> None:
    """The tool frame is at the tool's end: a force there has no moment about it, but a moment about the sensor."""
    lever = Lever((0.0, 0.0, 0.2), (0.0, 0.0, -0.2))
    about_end = (0.0, 0.0, -10.0, 0.2 * 20.0, 0.0, 0.0)  # Fy of -20 N that no axis shows
    assert compare_moment(lever, about_end, DOWN, 10.0).hidden == pytest.approx(18.0)
    assert compare_moment(lever, (0.0, -20.0, -10.0, 0.0, 0.0, 0.0), DOWN, 10.0) == (0.0, True)


def test_compare_moment_of_tilted_approach_leaves_its_force_out() -> None:
    approach = (0.5, 0.0, math.sqrt(0.75))
    force = tuple(-10.0 * part for part in approach)
    x, y, z = force
    assert compare_moment(LEVER, wrench_of((x, y, z)), approach, 10.0).hidden == 0.0


def test_confirmed_by_moments_needs_perpendicular_lever() -> None:
    assert is_confirmed_by_moments(LEVER, (1.0, 0.0, 0.0))
    assert not is_confirmed_by_moments(LEVER, (0.0, 0.0, 1.0))
    assert not is_confirmed_by_moments(None, (1.0, 0.0, 0.0))


@pytest.mark.parametrize("reach", [(0.0, 0.1, 0.1), (0.1, 0.0, 0.1), (0.1, 0.1, 0.0)])
def test_confirmed_by_moments_not_along_slanted_lever(reach: tuple[float, float, float]) -> None:
    lever = Lever(reach, (0.0, 0.0, 0.0))
    x, y, z = (part / lever.length for part in reach)
    assert not is_confirmed_by_moments(lever, (x, y, z))
    first = next(k for k, part in enumerate(reach) if part)
    x, y, z = (-part / lever.length if k == first else part / lever.length for k, part in enumerate(reach))
    assert is_confirmed_by_moments(lever, (x, y, z))


# --- shares of a direction

UPRIGHT = (1.0, 0.0, 0.0, 0.0)


@pytest.mark.parametrize(
    ("tilt_deg", "axes"), [(0.0, ()), (15.0, ()), (20.0, (1,)), (45.0, (1,)), (90.0, (1,))]
)
def test_doubtful_axes_of_tilted_direction_have_a_share(tilt_deg: float, axes: tuple[int, ...]) -> None:
    angle = math.radians(tilt_deg)
    direction = (0.0, math.sin(angle), math.cos(angle))
    assert doubtful_axes(Wrist(), direction, UPRIGHT, (0, 1)) == axes


def test_doubtful_axes_add_up_small_shares() -> None:
    direction = (0.25, 0.25, math.sqrt(1.0 - 0.125))
    assert doubtful_axes(Wrist(), direction, UPRIGHT, (0,)) == ()
    assert doubtful_axes(Wrist(), direction, UPRIGHT, (0, 1)) == (0, 1)


def test_axis_evidence_contradicted_once_stays_unverified() -> None:
    wrist = Wrist().at_orientation(UPRIGHT, UPRIGHT, DOWN)
    axes = AxisEvidence(LEVER)
    axes.across = (0, 1)
    true = wrench_of((0.0, -20.0, -10.0))
    x, _, *rest = true
    assert axes.hidden(wrist, true, 10.0) == 0.0  # type: ignore[arg-type]
    assert axes.unverified(aside=True) == ()
    axes.hidden(wrist, (x, 0.0, *rest), 10.0)  # type: ignore[arg-type]
    assert axes.unverified(aside=True) == ("Fx", "Fy")
    assert axes.unverified(aside=False) == ()


def test_axis_without_moment_is_not_confirmed_by_others() -> None:
    """A force across the tool says nothing about the axis along it."""
    wrist = Wrist().at_orientation(UPRIGHT, UPRIGHT, DOWN)
    axes = AxisEvidence(LEVER)
    axes.across, axes.unconfirmable = (0, 2), (2,)
    axes.hidden(wrist, wrench_of((20.0, 0.0, -10.0)), 10.0)  # type: ignore[arg-type]
    assert axes.unverified(aside=True) == ("Fz",)
    assert axes.unverified(aside=False) == ()


# --- approaches that nothing verified


@pytest.mark.parametrize(("robot", "stiffness"), [("s3", 5e3), ("egm", 5e4), ("rtde", 5e4), ("rsi", 5e3)])
def test_approach_on_doubtful_diagonal_is_refused(guarded: Run, robot: str, stiffness: float) -> None:
    angle = math.radians(30.0)
    config = near_wall(robot, "plain", "sign", stiffness)
    approach = 0.0, math.sin(angle), -math.cos(angle)
    frame = type(config.frame)(approach=approach, travel=(1.0, 0.0, 0.0))
    run = guarded(config.model_copy(update={"frame": frame}))
    assert run.error is not None
    assert run.error.cause is Cause.UNVERIFIED_AXIS
    assert "the approach presses on Fy (0.00 N of weight)" in run.cause
    assert not run.cycles


def test_travel_along_the_tool_is_refused_by_axis(guarded: Run) -> None:
    """A level tool: the moments do not show a force along it, and no weight verifies its axis."""
    level = {
        "cell": {"start_quaternion": (0.7071067811865476, 0.7071067811865476, 0.0, 0.0)},
        "frame": {"travel": (0.0, 1.0, 0.0)},
    }
    config = near_wall("egm", "plain", "0", 5e3)
    run = guarded(awake_config(merged(config.model_dump(exclude_unset=True), level)))
    assert run.error is not None
    assert run.error.cause is Cause.UNVERIFIED_AXIS
    assert "the run goes on Fz" in run.cause
