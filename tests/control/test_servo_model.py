"""Model of the robot's servo that replaces a noisy reported position."""

import math
from statistics import fmean
from typing import Any

import pytest
from msgspec.structs import replace

from hil_bridge.api import simulate
from hil_bridge.control import Measurement, Pairing, Predictive, Stiffness
from hil_bridge.control.laws.servo import Served, Servo
from hil_bridge.control.laws.stiffness import observe
from hil_bridge.control.types import FINE_STEP_MM
from hil_bridge.devices.facts import RobotFacts, ServoFacts
from hil_bridge.devices.robots.ramp import Pace, Ramp
from hil_bridge.runs.pace import set_pace
from hil_bridge.runs.setup import Setup
from hil_bridge.settings.configuration import Config, read_config
from protocol.geometry import Pose
from protocol.marks import SettingError
from tests.near_surface import CLOSE, merged

pytestmark = pytest.mark.sweep

FORCE = 10.0
DT = 0.002
LAG, DAMPING, BOUND = 0.034, 0.67, 0.15e-3
SERVO = Servo(LAG, DAMPING, BOUND)
TUNED: dict[str, Any] = {"resolution_mm": 0.015, "landing_ms": 100.0}


def at(position: float, commanded: float, force: float = FORCE, dt: float = DT, **more: Any) -> Measurement:
    return Measurement(0.0, force, position, commanded, dt=dt, **more)


# --- the model


def test_servo_model_starts_at_reported_position() -> None:
    ordered = at(1e-3, 1e-3 + 0.01 * LAG)
    assert SERVO.begin(ordered, coming=False) == Served(1e-3, 0.0, ordered.commanded)
    assert SERVO.begin(ordered, coming=True).position == 1e-3
    assert SERVO.begin(ordered, coming=True).speed == pytest.approx(0.01)


def test_servo_model_continues_constant_approach_smoothly() -> None:
    """The robot approaches at 5 mm/s, and so does the model from its first sample on."""
    served = SERVO.begin(at(0.0, 5e-3 * LAG), coming=True)
    for k in range(1, 20):
        served = SERVO.after(served, at(5e-3 * DT * k, 5e-3 * (LAG + DT * k)))
        assert served.position == pytest.approx(5e-3 * DT * k, rel=0.05)


@pytest.mark.parametrize("dt", [0.001, 0.002, 0.008])
@pytest.mark.parametrize("damping", [0.5, 1.0, 2.0])
def test_servo_model_lags_steady_motion(dt: float, damping: float) -> None:
    servo, speed = Servo(LAG, damping, math.inf), 0.01
    served = Served(0.0)
    samples = round(1.0 / dt)
    for k in range(samples):
        served = servo.after(served, at(0.0, speed * dt * k, dt=dt))
    assert served.speed == pytest.approx(speed, rel=1e-6)
    assert speed * dt * (samples - 1) - served.position == pytest.approx(speed * LAG, rel=1e-6)


@pytest.mark.parametrize("dt", [0.0005, 0.002, 0.36])
@pytest.mark.parametrize("lag", [1e-6, LAG, 1.0])
def test_servo_model_settles_without_growing_oscillation(dt: float, lag: float) -> None:
    servo, served = Servo(lag, DAMPING, math.inf), Served(0.0)
    for _ in range(round(20 * max(lag, dt) / dt)):
        served = servo.after(served, at(0.0, 1e-3, dt=dt))
        assert -1e-12 <= served.position < 1.1e-3
    assert served.position == pytest.approx(1e-3, rel=1e-3)


@pytest.mark.parametrize("direction", [1.0, -1.0])
def test_servo_model_stays_near_reported_position(direction: float) -> None:
    """With a blocked robot, the model must neither run away from it nor keep the orders of the meantime."""
    served = Served(0.0)
    for k in range(500):
        served = SERVO.after(served, at(0.0, direction * 1e-5 * k))
        assert abs(served.position) <= BOUND
    assert served.position == direction * BOUND
    back = SERVO.after(replace(served, speed=0.0), at(0.0, 0.0))
    assert abs(back.position) < BOUND


def test_servo_model_ignores_sample_without_duration() -> None:
    served = Served(1e-4, 0.02)
    assert SERVO.after(served, at(1e-4, 9e-3, dt=0.0)) == served


def test_servo_model_follows_setpoints_of_link() -> None:
    """A step of 1 mm, of which the link sends set points as `Ramp` does: the model follows them and not the order."""
    speed, acceleration = 0.02, 2.0
    servo = Servo(LAG, DAMPING, math.inf, speed, acceleration)
    ideal, served, followed = Servo(LAG, DAMPING, math.inf), Served(0.0), Served(0.0)
    ramp, pace = Ramp(DT), Pace(speed, 1.0, acceleration, 1.0)
    setpoint, goal = (Pose((0.0, 0.0, depth), (1.0, 0.0, 0.0, 0.0)) for depth in (0.0, 1e-3))
    for _ in range(100):
        setpoint = ramp.step(setpoint, goal, pace, DT)
        served = servo.after(served, at(0.0, 1e-3))
        followed = ideal.after(followed, at(0.0, setpoint.position[2]))
        assert served.position == pytest.approx(followed.position, abs=1e-5)
    assert served.setpoint == 1e-3


def test_servo_model_setpoint_drops_speed_at_reversal() -> None:
    servo = Servo(LAG, DAMPING, math.inf, 0.05, 2.0)
    served = servo.after(Served(0.0, setpoint_speed=0.05), at(0.0, -1e-3))
    assert served.setpoint == pytest.approx(-2.0 * DT * DT)


# --- the controller with it


@pytest.mark.parametrize(
    ("lag_ms", "dt", "move"), [(34.0, DT, 0.05 * DT), (0.0, DT, 1e-3), (0.0, 0.03, 1.5e-3)]
)
def test_predictive_order_covers_what_link_can_send(lag_ms: float, dt: float, move: float) -> None:
    """The target falls by 10 N, 2 mm at 5 kN/m, and the link sends 50 mm/s: with a model of the servo, an order covers
    that in a sample; without it, it leads the robot by that in 20 ms or a sample.
    """
    controller = Predictive(**TUNED, servo_lag_ms=lag_ms, servo_speed_mm_s=50.0)
    known = replace(controller.initial(), estimate=Stiffness(moved=1e-6, pressed=5e-3))
    state, _ = controller.step(known, at(4e-3, 4e-3, 20.0, dt), 20.0)
    state, command = controller.step(state, at(4e-3, 4e-3, 20.0, dt), FORCE)
    assert command.correction == pytest.approx(-move)
    if not lag_ms:
        _, command = controller.step(state, at(4e-3, command.position, 20.0, dt), FORCE)
        assert command.correction == pytest.approx(0.0)


def control_error(**parameters: float) -> tuple[float, str]:
    """Root mean square of the force error after 0.5 s on 50 kN/m, N, and why the run stopped. The arm is rigid and on
    its targets, and reports where it is with noise. The resolution is that of its position; with the larger default of
    this robot, the controller rests within 2.5 N.
    """
    settings = {
        "run": {"duration_s": 1.5, "seed": 1},
        "robot": {"emulated": "rtde"},
        "sensor": {"emulated": "netft"},
        "controller": {"parameters": {"resolution_mm": FINE_STEP_MM, **parameters}},
        "cell": {
            "surface": {"stiffness_n_m": 5e4},
            "arm": {"compliance": "rigid"},
            "rtde": {"follow_error_urad": 0.0, "fast_follow_error_urad": 0.0},
        },
    }
    config = read_config(merged(CLOSE, settings))
    run = simulate(config)
    track = [cycle for cycle in run.cycles if cycle.phase == "track"]
    steady = [cycle.force for cycle in track if cycle.sample.sensor_at >= track[0].sample.sensor_at + 0.5]
    return math.sqrt(fmean((force - FORCE) ** 2 for force in steady)), run.text


@pytest.mark.full
def test_servo_model_suppresses_position_noise() -> None:
    modelled, cause = control_error()
    assert cause == ""
    assert modelled < 0.5
    reported, _ = control_error(servo_lag_ms=0.0)
    assert reported > 4 * modelled


@pytest.mark.full
@pytest.mark.parametrize("parameters", [{"servo_lag_ms": 24.0}, {"servo_lag_ms": 44.0, "servo_damping": 1.0}])
def test_servo_model_with_wrong_lag_is_stable(parameters: dict[str, float]) -> None:
    rms, cause = control_error(**parameters)
    assert cause == ""
    assert rms < 1.0


def test_servo_model_blocked_robot_order_is_bounded() -> None:
    """The robot is stationary and the force stays too low: the order must not drift into the surface."""
    controller = Predictive(**TUNED, servo_lag_ms=34.0)
    state, commanded, stiffness = controller.initial(), 0.0, 2e4
    for k in range(40):  # it learns the stiffness in motion
        position = k * 1e-5
        state, command = controller.step(state, at(position, position, stiffness * position + 2.0), FORCE)
    deepest = 0.0
    for _ in range(1000):
        state, command = controller.step(state, at(position, commanded, 4.0), FORCE)
        commanded = command.position
        deepest = max(deepest, commanded - position)
    assert command.stiffness is not None
    assert deepest <= (FORCE - 4.0) / command.stiffness + BOUND + 1e-5


def test_servo_model_restarts_after_contact_loss() -> None:
    controller = Predictive(servo_lag_ms=34.0)
    state, _ = controller.step(controller.initial(), at(0.0, 1e-4), FORCE)
    assert state.served is not None
    assert state.served.speed == pytest.approx(1e-4 / LAG), "at a first touch the tool is moving"
    state, _ = controller.step(state, at(0.0, 1e-4), FORCE)
    assert state.served is not None
    assert state.served.position > 0.0
    state, _ = controller.step(state, at(0.0, 1e-4, 0.0, in_contact=False), FORCE)
    assert state.served is None
    known = replace(state, estimate=Stiffness(moved=1e-8, pressed=1e-4))
    state, _ = controller.step(known, at(5e-4, 7e-4), FORCE)
    assert state.served == Served(5e-4, 0.0, 7e-4)


def test_servo_model_without_lag_uses_reported_position() -> None:
    controller = Predictive()
    state, _ = controller.step(controller.initial(), at(0.0, 1e-4), FORCE)
    state, _ = controller.step(state, at(3e-4, 1e-4), FORCE)
    assert state.served is None
    assert state.pairs[-1][1] == 3e-4


@pytest.mark.parametrize(
    "wrong",
    [{"servo_lag_ms": -1.0}, {"servo_damping": 0.0}, {"servo_error_mm": 0.0}, {"servo_lag_ms": math.nan}],
)
def test_servo_model_invalid_settings_are_refused(wrong: dict[str, Any]) -> None:
    with pytest.raises(SettingError, match=next(iter(wrong))):
        Predictive(**wrong)


# --- small moves that add up


def test_servo_model_lets_small_moves_add_up() -> None:
    assert Predictive(servo_lag_ms=34.0).pairing.span_ms == 100.0
    assert Predictive().pairing.span_ms == 0.0


@pytest.mark.parametrize(("span_ms", "is_estimated"), [(0.0, False), (50.0, True)])
def test_pairing_small_moves_add_up_within_span(span_ms: float, is_estimated: bool) -> None:
    """The surface is twice as hard as estimated; no two adjacent samples are far enough apart to show it."""
    pairing = Pairing(resolution_mm=0.01, span_ms=span_ms)
    estimate = Stiffness(moved=1e-8, pressed=1e-8 * 1e4, force=2.0, position=0.0)
    for k in range(1, 40):
        position = k * 2e-6
        estimate = observe(estimate, pairing, at(position, position, 2.0 + 2e4 * position))
    assert (estimate.value != pytest.approx(1e4, rel=1e-6)) is is_estimated


def test_pairing_old_sample_is_replaced_after_span() -> None:
    pairing = Pairing(resolution_mm=0.01, span_ms=62.5)
    estimate = Stiffness(moved=1e-8, pressed=1e-8 * 1e4, force=2.0, position=0.0)
    for _ in range(3):
        estimate = observe(estimate, pairing, at(1e-6, 1e-6, 2.0, dt=2**-6))
    assert estimate.position == 0.0
    estimate = observe(estimate, pairing, at(1e-6, 1e-6, 2.0, dt=2**-6))  # as old as the span, to the bit
    assert estimate.position == 1e-6


# --- robots


def parameters(robot: str, controller: dict[str, Any] | None = None, **more: Any) -> dict[str, Any]:
    sections: dict[str, Any] = {"robot": {"emulated": robot}, "sensor": {"emulated": "netft"}}
    config = Setup(
        read_config({**sections, "controller": controller or {"name": "predictive"}, **more})
    ).config
    return dict(config.controller.parameters)


def test_set_pace_noisy_robot_uses_servo_model() -> None:
    result = parameters("rtde")
    # 30 ms of servoj's lookahead, and two cycles to the arm
    assert result["servo_lag_ms"] == pytest.approx(34.0)
    assert result["servo_damping"] == pytest.approx(0.67, abs=0.01)
    assert (result["servo_speed_mm_s"], result["servo_acceleration_mm_s2"]) == (50.0, 2000.0)
    slow = parameters("rtde", cell={"rtde": {"servo_gain_scale": 0.25}})
    assert slow["servo_damping"] == pytest.approx(result["servo_damping"] / 2)


@pytest.mark.parametrize("robot", ["egm", "rsi"])
def test_set_pace_streaming_robot_gets_speed_of_its_link(robot: str) -> None:
    result = parameters(robot)
    assert {name: value for name, value in result.items() if name.startswith("servo")} == {
        "servo_speed_mm_s": 50.0
    }


def test_set_pace_trailing_set_point_adds_lag() -> None:
    servo = ServoFacts(
        interpolation_s=0.004,
        transport_delay_s=0.01,
        natural_frequency_rad_s=50.0,
        damping_ratio=0.5,
        trail_s=0.03,
    )
    assert servo.lag_s == pytest.approx(0.06)
    assert replace(servo, trail_s=0.0).lag_s == pytest.approx(0.03)


@pytest.mark.parametrize(("decision_s", "period_ms"), [(None, 0.0), (0.09, 96.0)])
def test_set_pace_slow_robot_gets_its_period(decision_s: float | None, period_ms: float) -> None:
    robot = RobotFacts(cycle_s=0.012, decision_s=decision_s)
    assert set_pace(Config(), robot, 0.001).run.period_ms == period_ms


@pytest.mark.parametrize("robot", ["egm", "rsi"])
def test_set_pace_exact_robot_uses_reported_position(robot: str) -> None:
    assert "servo_lag_ms" not in parameters(robot)


@pytest.mark.parametrize("name", ["pi", "fuzzy-adaptive"])
def test_set_pace_passes_no_servo_to_other_controllers(name: str) -> None:
    assert "servo_lag_ms" not in parameters("rtde", {"name": name})


def test_set_pace_passes_servo_to_matching_plugin_fields(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    class Lagging:
        sample_ms = 2.0
        servo_lag_ms = 0.0

    monkeypatch.setattr("hil_bridge.runs.pace.controller_kind", lambda name: Lagging)
    assert parameters("rtde", {"name": "pi"}) == {"servo_lag_ms": pytest.approx(34.0)}
    assert parameters("egm", {"name": "pi"}) == {}


def test_set_pace_keeps_configured_lag_and_sample_time() -> None:
    configured = parameters("rtde", {"name": "predictive", "parameters": {"servo_lag_ms": 0.0}})
    assert configured["servo_lag_ms"] == 0.0
    assert "servo_lag_ms" not in parameters("rtde", {"name": "predictive", "sample_ms": 2.0}), (
        "as in a recording from before the model"
    )
