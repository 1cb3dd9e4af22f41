"""Pace of a run: its control period, the controller's tuning for it, and the resulting loop.

A polled robot responds as fast as its link allows, and controllers are tuned for that. A streaming robot has a
cycle of a few milliseconds. A controller with a tuning for this cycle decides in every cycle, but no faster than
the sensor delivers a new force. A controller without such a tuning keeps the sample time that it was made for. Both
use a whole number of robot cycles.
"""

import math
from collections.abc import AsyncIterator, Callable
from dataclasses import fields, replace
from typing import Any

from hil_bridge.clock import Clock
from hil_bridge.control import ControlLoop, Stroke, Supervisor, TaskParameters, make_controller
from hil_bridge.control.controllers import PERIOD_FACTOR, check_period, controller_kind, sample_time
from hil_bridge.control.course.witness import witness_of
from hil_bridge.control.geometry.work_frame import Face, WorkFrame
from hil_bridge.control.program.legs import Ground, legs_of, seconds
from hil_bridge.control.program.program import Program
from hil_bridge.control.program.resume import resume_row
from hil_bridge.control.steps.track import Track
from hil_bridge.control.types import Controller, Tuning
from hil_bridge.devices.facts import RobotFacts
from hil_bridge.errors import ConfigError, StepError
from hil_bridge.record import EventKind
from hil_bridge.runs.force_bound import ANSWERED_SHARE
from hil_bridge.runs.reaction_times import following
from hil_bridge.settings.configuration import Config
from hil_bridge.settings.given import GivenController
from hil_bridge.settings.program import in_file
from protocol.geometry import Vector


def set_pace(config: Config, robot: RobotFacts, frame_s: float) -> Config:
    """Return the configuration with period, sample time, tuning and rise of the travel filled in, for recording and
    replay.

    `robot` holds the known facts of the robot. `frame_s` is the time between two frames of the sensor, or 0 if
    unknown. The configuration is unchanged if the robot has no cycle of its own, or if the configuration sets
    `controller.sample_ms` itself. Parameters in the configuration take precedence over parameters of a tuning.
    Raises ConfigError for an unknown controller, or for a controller that declares no sample time.
    """
    cycle_s = robot.cycle_s
    if cycle_s is None or config.controller.sample_ms is not None:
        return config
    cycle_ms = cycle_s * 1e3
    shortest_ms = math.ceil(max(frame_s, robot.decision_s or 0.0) * 1e3 / cycle_ms - 1e-6) * cycle_ms
    passed_controller = _object_controller(config)
    kind: Any = controller_kind(config.controller.name) if passed_controller is None else passed_controller
    made_for = Tuning(sample_time(kind) * 1e3, {})
    period_ms = config.run.period_ms or max(cycle_ms, shortest_ms)
    fits = [tuning for tuning in (made_for, *_tunings(kind)) if _off(tuning, period_ms) <= PERIOD_FACTOR]
    if fits:
        tuning = min(fits, key=lambda tuning: _off(tuning, period_ms))
    elif config.run.period_ms or made_for.sample_ms < cycle_ms:
        return config
    else:
        tuning = made_for
        period_ms = round(made_for.sample_ms / cycle_ms) * cycle_ms
    if period_ms > cycle_ms:
        config = config.model_copy(update={"run": config.run.model_copy(update={"period_ms": period_ms})})
    section = config.controller
    if isinstance(section, GivenController):
        section = section.tuned(tuning)
    else:
        parameters = {**tuning.parameters, **_servo_parameters(kind, config, robot), **section.parameters}
        section = section.model_copy(update={"sample_ms": tuning.sample_ms, "parameters": parameters})
    task = config.task
    if task.travel_rise_s is None and config.frame.follow_normal:
        task = replace(task, travel_rise_s=_RISE_S)
    return config.model_copy(update={"controller": section, "task": task})


def describe_pace(config: Config, paced: Config, cycle_s: float | None) -> str:
    """Return one line for the user if a controller without a sample time decides far less often than it could;
    otherwise an empty text.

    `config` is the original configuration, and `paced` is the result of `set_pace`.
    """
    kind: Any = _object_controller(config) or controller_kind(config.controller.name)
    declares = getattr(kind, "sample_ms", None) is not None or config.controller.sample_ms is not None
    if cycle_s is None or declares or config.run.period_ms:
        return ""
    cycle_ms, period_ms = cycle_s * 1e3, paced.run.period_ms or cycle_s * 1e3
    if period_ms <= PERIOD_FACTOR * cycle_ms:
        return ""
    return (
        f"controller {config.controller.name} declares no sample time, so it decides every {period_ms:g} ms, but the "
        f"robot takes an order every {cycle_ms:g} ms: write sample_ms = {cycle_ms:g} into its class, or set "
        "controller.sample_ms, where its parameters fit that"
    )


def _object_controller(config: Config) -> Controller[Any] | None:
    """Return the controller that a program passed as an object."""
    return config.controller.controller if isinstance(config.controller, GivenController) else None


def _tunings(kind: Any) -> tuple[Tuning, ...]:
    """Return the tunings that a controller declares. A controller of a plug-in may declare anything."""
    declared = getattr(kind, "tunings", ())
    return tuple(tuning for tuning in declared if isinstance(tuning, Tuning))


def _servo_parameters(kind: Any, config: Config, robot: RobotFacts) -> dict[str, float]:
    """Return the speed of the link's set points, and the servo of a robot whose reported position is noisy, as
    parameters that the controller accepts.
    """
    known = {"servo_speed_mm_s": config.robot.velocity_mm_s}
    if robot.servo is not None and robot.position_noise_m:
        known |= {
            "servo_lag_ms": robot.servo.lag_s * 1e3,
            "servo_damping": robot.servo.damping_ratio,
            "servo_acceleration_mm_s2": config.robot.acceleration_mm_s2,
        }
    return {name: value for name, value in known.items() if hasattr(kind, name)}


def _off(tuning: Tuning, period_ms: float) -> float:
    """Return the ratio between a tuning's sample time and the period, in the direction that gives at least 1."""
    return max(tuning.sample_ms / period_ms, period_ms / tuning.sample_ms)


def control_loop(config: Config, robot: RobotFacts) -> ControlLoop:
    """Return the control loop of a run with this configuration. `robot` holds the known facts of the robot.

    Raises ConfigError for an invalid parameter, or for a controller that is tuned for another control period.
    """
    controller = _object_controller(config)
    if controller is None:
        controller = make_controller(config.controller.name, **config.controller.parameters)
    tuned = sample_time(controller, config.controller.sample_ms)
    detector, samples = config.oscillation, 2 * config.oscillation.peaks
    if detector.window_ms * 1e-3 < samples * tuned:
        raise ConfigError(
            f"oscillation.window_ms of {detector.window_ms:g} ms must hold at least {samples} samples of "
            f"{tuned * 1e3:g} ms, twice oscillation.peaks: set it to {samples * tuned * 1e3:g} or more"
        )
    if not (config.run.period_ms or robot.cycle_s or robot.line_floor_s):
        raise ConfigError(f"a {robot.kind} reports no cycle time of its own: set run.period_ms")
    check_period(config.run.period_ms * 1e-3 or robot.cycle_s, controller, config.controller.sample_ms)
    line_ms = (robot.line_floor_s or 0.0) * ANSWERED_SHARE * 1e3
    if config.controller.sample_ms is not None and line_ms > config.controller.sample_ms * PERIOD_FACTOR:
        raise ConfigError(
            f"controller.sample_ms of {config.controller.sample_ms:g} ms is shorter than the line of a {robot.kind} "
            f"allows, where a decision takes {line_ms:.0f} ms: set {line_ms:.0f} where the parameters fit that"
        )
    escape_mm_s = min(config.limits.escape_mm_s, config.robot.velocity_mm_s)
    limits, step, numbers = (
        config.limits,
        robot.order_step_m,
        TaskParameters(**{field.name: getattr(config.task, field.name) for field in fields(TaskParameters)}),
    )
    stroke = Stroke(
        parameters=numbers,
        controller=controller,
        force_limit_n=limits.force_limit_n,
        position_step=step,
        escape_mm_s=escape_mm_s,
        friction_share=limits.friction_share,
    )
    own = robot.witness
    witness = None if own is None else witness_of(config.limits, own.ordinary_n, own.delay_s)
    return ControlLoop(
        program=program(config, stroke),
        supervisor=Supervisor(config.limits, config.robot.velocity_mm_s * 1e-3, witness),
        detector=config.oscillation if config.limits.oscillation_guard else None,
        following=following(robot, max(config.run.period_ms * 1e-3, tuned)),
        sample_time=tuned,
    )


def program(config: Config, stroke: Stroke) -> Program:
    """Return the program of a run. `stroke` has the parameters of the run.

    Raises ConfigError with the number of the first invalid step.
    """
    frame, point, written = config.frame, config.task.resume, bool(config.task.step)
    origin = None if frame.origin_mm is None else metres(frame.origin_mm)
    facing = frame.facing if written else frame.contour
    ground = Ground(
        stroke=stroke,
        limits=config.limits,
        speed_mm_s=config.robot.velocity_mm_s,
        origin_known=origin is not None,
        follows=frame.follow_normal,
        shows_ground=facing.shows_ground,
    )
    try:
        steps = config.task.program(config.run.duration_s)
        if not written and getattr(stroke.controller, "turns", False) is True:
            steps = tuple(
                replace(step, orientation="led") if isinstance(step, Track) else step for step in steps
            )
        row = legs_of(steps, ground, written)
        seconds(row)
    except StepError as error:
        if not config.task.file:
            raise
        raise in_file(error, "", config.task.file) from error
    if point is not None:
        row = resume_row(row, point, stroke)
    orientations = {leg.step.orientation for leg in row.legs}
    tips = next((one for one in ("normal", "led") if one in orientations), "")
    if tips and config.sensor.url and not config.tool.mass_kg:
        raise ConfigError(
            f'a step with orientation = "{tips}" turns the tool, and its weight with it: set tool.mass_kg '
            "(hil-bridge identify tool measures it)"
        )
    safe = None if point is None else point.start_m
    return Program(
        row=row,
        stroke=stroke,
        frame=WorkFrame(frame.approach, frame.travel, frame.across, origin or safe, safe),
        facing=facing,
        face=face(config),
        safe_height=config.task.safe_height_mm * 1e-3,
    )


def face(config: Config) -> Face:
    """Return the end face of the tool, from the configuration or the emulated cell."""
    centre, radius = config.tool.face_mm, config.tool.face_radius_mm
    if not config.sensor.url:
        own = config.cell.tool
        centre = (0.0, 0.0, own.length_mm) if centre is None else centre
        radius = own.face_radius_mm if radius is None else radius
    x, y, z = (
        a + b
        for a, b in zip(metres(centre or (0.0, 0.0, 0.0)), metres(config.sensor.position_mm), strict=True)
    )
    return Face((x, y, z), (radius or 0.0) * 1e-3)


def metres(vector_mm: Vector) -> Vector:
    """Return a vector converted from mm to m."""
    x, y, z = vector_mm
    return x * 1e-3, y * 1e-3, z * 1e-3


async def cycle_starts(
    clock: Clock, period: float, tell: Callable[[str, str], object]
) -> AsyncIterator[tuple[int, float]]:
    """Yield the number and start time of each cycle, as fast as the robot reports, or at multiples of a period, s.

    After an overrun, missed cycles are skipped and never caught up. `tell` is called with the kind and text of an
    event.
    """
    anchor, place, cycle = clock.now(), 0, 0
    while True:
        yield cycle, clock.now()
        cycle += 1
        if not period:
            continue
        next_index = max(place + 1, math.ceil((clock.now() - anchor) / period))
        if (skipped := next_index - place - 1) > 0:
            tell(EventKind.OVERRUN, f"{skipped} cycles of {period * 1e3:g} ms skipped")
        place = next_index
        await clock.sleep_until(anchor + place * period)


_RISE_S = 1.2
"""`task.travel_rise_s` on an unknown slope, s. Chosen: with EGM, a slope of 0.126 and 50 kN/m, the force overshoots
by 8 to 10 % with this value, by 10 to 12 % with 0.8 s, and by no less with 2 s.
"""
