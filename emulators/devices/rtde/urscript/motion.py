"""Functions for motion, kinematics, tool and payload."""

import math
from collections.abc import Generator, Iterator
from typing import Any, TypeAlias

from emulators.devices.rtde.kinematics import RANGE
from emulators.devices.rtde.urscript.failures import ScriptError
from emulators.devices.rtde.urscript.host import ORDERED, Host, Profile, Six
from emulators.devices.rtde.urscript.limits import SOLVE_STEPS, TCP_MAX_M
from emulators.devices.rtde.urscript.poses import pose, value_of
from emulators.devices.rtde.urscript.table import Function, modelled, waiting
from emulators.devices.rtde.urscript.values import PoseValue, Value, number, string, vector
from protocol.devices.rtde.rotation import pose_of, six_of
from protocol.geometry import Pose

Wait: TypeAlias = Generator[None, None, None]
_SPEED_REACHED = 1e-3
"""Difference within which a joint speed counts as reached, rad/s. Chosen."""


def _six(value: Value) -> Six:
    a, b, c, d, e, f = vector(value, 6)
    return a, b, c, d, e, f


def finite_six(value: Value) -> Six:
    six = _six(value)
    if not all(map(math.isfinite, six)):
        raise ScriptError("a value that is not a number")
    return six


def _finite(*arguments: Value) -> list[float]:
    numbers = [number(value) for value in arguments]
    if not all(map(math.isfinite, numbers)):
        raise ScriptError("a value that is not a number")
    return numbers


def _joints(host: Host, value: Value, near: Six | None = None) -> Six:
    """Return the given joint angles, or joint angles that hold the given pose."""
    if not isinstance(value, PoseValue):
        return finite_six(value)
    solution = host.solve(pose(value), near)
    if solution is None:
        raise ScriptError("no joints hold this pose")
    return solution


def _pose(host: Host, value: Value) -> Pose:
    """Return the given pose, or the pose at the given joint angles."""
    return pose(value) if isinstance(value, PoseValue) else host.forward(finite_six(value))


def _profile(acceleration: Value, speed: Value, time: Value = 0.0) -> Profile:
    a, v, t = _finite(acceleration, speed, time)
    return Profile(v, a, t)


# --- moves


def _walk(task: Any, walk: Iterator[object] | None, radius: Value) -> Wait:
    if walk is None:
        raise ScriptError("no joints hold the end of this move")
    if number(radius) > 0.0:
        task.report_tagged("blend radius")
    for _ in walk:
        yield


def _movej(task: Any, q: Value, *rest: Value) -> Wait:
    """Move linearly in joint space. `rest` are a, v, t and r. A target beyond a joint's range ends the program
    before the arm moves.

    Derived: a test of Universal Robots' C++ client library sends such a target and waits indefinitely for the end
    of the program. It does not unlock a stop.
    """
    host, (a, v, t, r) = task.host, rest
    goal = _joints(host, q)
    walk = host.swing(goal, _profile(a, v, t))
    if max(map(abs, goal)) > RANGE:
        raise ScriptError("the end of this move is beyond a joint's range")
    return _walk(task, walk, r)


def _movel(task: Any, goal: Value, *rest: Value) -> Wait:
    """Move along a line. `rest` are a, v, t and r. If the line leaves the workspace, a protective stop occurs
    there.

    Source: tests of Universal Robots' C++ client library.
    """
    host, (a, v, t, r) = task.host, rest
    walk = host.line(_pose(host, goal), _profile(a, v, t))
    if walk is None:
        host.protective_stop("a move along a line with invalid values")
        yield
    else:
        yield from _walk(task, walk, r)


def _movep(task: Any, goal: Value, a: Value, v: Value, r: Value) -> Wait:
    return _movel(task, goal, a, v, 0.0, r)


def _movec(task: Any, via: Value, goal: Value, *rest: Value) -> Wait:
    """Move along a circle. `rest` are a, v, r and mode. In every mode, the tool rotates evenly towards the target
    (assumed).
    """
    host, (a, v, r, _) = task.host, rest
    return _walk(task, host.arc(_pose(host, via), _pose(host, goal), _profile(a, v)), r)


def _servoj(task: Any, q: Value, *rest: Value) -> Wait:
    """Command servoj to joint angles. `rest` are a and v, which a controller ignores, t, lookahead_time and gain."""
    t, lookahead, gain = map(number, rest[2:])
    for _ in range(task.host.servo(_six(q), t, lookahead, gain)):
        yield


def _servoc(task: Any, goal: Value, *rest: Value) -> Wait:
    """Move like movel with a, v and r (assumed: the circular path is not modelled)."""
    a, v, r = rest
    return _movel(task, goal, a, v, 0.0, r)


def _speedj(task: Any, speeds: Value, acceleration: Value, time: Value) -> Wait:
    host, desired = task.host, finite_six(speeds)
    (a,) = _finite(acceleration)
    for _ in _turns(host, time, desired):
        host.speed(desired, a)
        yield


def _speedl(task: Any, velocity: Value, acceleration: Value, time: Value, turning: Value) -> Wait:
    """Move the tool at this velocity. `turning` is the angular acceleration, which follows the linear one (assumed)."""
    host, desired = task.host, finite_six(velocity)
    (a,) = _finite(acceleration)
    for _ in _turns(host, time, None):
        if not host.speed_line(desired, a):
            raise ScriptError("no joints follow this speed")
        yield


def _turns(host: Host, time: Value, desired: Six | None) -> Iterator[int]:
    """Yield once per cycle of a speed command, for a time or until the speed is reached, but at least once."""
    seconds = 0.0 if time is None else _finite(time)[0]
    count = max(1, math.ceil(seconds / host.period - 1e-6))
    yield from range(count)
    while seconds <= 0.0 and desired is not None and not _reached(host, desired):
        yield 0


def _reached(host: Host, desired: Six) -> bool:
    """Return whether the joints have these speeds, scaled by the speed slider."""
    share = host.speed_scaling
    return max(abs(a - share * b) for a, b in zip(host.target_speeds, desired, strict=True)) < _SPEED_REACHED


def _stopj(task: Any, deceleration: Value) -> Wait:
    (rate,) = _finite(deceleration)
    while not task.host.still:
        task.host.brake(rate if rate > 0.0 else 1.0)
        yield


def _stopl(task: Any, deceleration: Value, turning: Value) -> Wait:
    (rate,) = _finite(deceleration)
    while not task.host.still:
        task.host.brake_line(rate if rate > 0.0 else 1.0)
        yield


# --- kinematics


def _inverse(task: Any, x: Value, near: Value, *rest: Value) -> Value:
    return _solved(task, x, near, rest[2]) or _no_joints()


def _no_joints() -> Value:
    raise ScriptError("no joints hold this pose")


def _has_inverse(task: Any, x: Value, near: Value, *rest: Value) -> Value:
    return _solved(task, x, near, rest[2]) is not None


def _solved(task: Any, x: Value, near: Value, tcp: Value) -> Six | None:
    """Return joint angles that hold a pose, with another tool if one is given."""
    task.spend(SOLVE_STEPS)
    host: Host = task.host
    goal, start = _numbers_or_stop(host, x), None if near is None else finite_six(near)
    if goal is None:
        return None
    return host.solve(goal, start, None if tcp is None else pose(tcp))


def _numbers_or_stop(host: Host, x: Value) -> Pose | None:
    """Return the pose. Trigger a protective stop if it contains a non-finite value."""
    six = vector(x, 6)
    if all(map(math.isfinite, six)):
        return pose_of(six)
    host.protective_stop("a target that is not a number")
    return None


def _forward(task: Any, q: Value, tcp: Value) -> Value:
    host = task.host
    joints = host.joints if q is None else finite_six(q)
    return value_of(host.forward(joints, None if tcp is None else pose(tcp)))


def _inside(task: Any, place: Value) -> Value:
    host = task.host
    joints = host.solve(pose(place)) if isinstance(place, PoseValue) else _six(place)
    return joints is not None and all(abs(angle) <= RANGE for angle in joints)


# --- tool, payload


def _set_payload(task: Any, mass: Value, centre: Value, *rest: Value) -> None:
    (kilograms,) = _finite(mass)
    if kilograms < 0.0:  # assumed
        raise ScriptError(f"a payload must be at least 0 kg, got {kilograms:g} kg")
    host: Host = task.host
    host.set_payload(kilograms, host.payload[1:] if centre is None else vector(centre, 3))


def _set_tcp(task: Any, tcp: Value, *rest: Value) -> None:
    offset = pose(tcp)
    if max(map(abs, offset.position)) > TCP_MAX_M:
        raise ScriptError(f"a tool centre point must be at most {TCP_MAX_M:g} m from the flange")
    task.host.set_tcp(offset)


def read_output(name: str) -> Any:
    return lambda task: _to_pose_or_joints(task.host.output(name))


def _to_pose_or_joints(solution: tuple[float, ...]) -> Value:
    return solution if len(solution) > 1 else solution[0]


MOTION: tuple[Function, ...] = (
    waiting("movej(q, a=1.4, v=1.05, t=0, r=0)", _movej),
    waiting("movel(pose, a=1.2, v=0.25, t=0, r=0)", _movel),
    waiting("movep(pose, a=1.2, v=0.25, r=0)", _movep),
    waiting("movec(pose_via, pose_to, a=1.2, v=0.25, r=0, mode=0)", _movec),
    waiting("optimovej(goal, a=0.3, v=0.3, r=0)", lambda task, q, a, v, r: _movej(task, q, a, v, 0.0, r)),
    waiting("optimovel(goal, a=0.3, v=0.3, r=0)", lambda task, q, a, v, r: _movel(task, q, a, v, 0.0, r)),
    waiting("servoj(q, a=0, v=0, t=0.002, lookahead_time=0.1, gain=300)", _servoj),
    waiting("servoc(pose, a=1.2, v=0.25, r=0)", _servoc),
    waiting("speedj(qd, a=1.4, t=None)", _speedj),
    waiting("speedl(xd, a=1.2, t=None, aRot=None)", _speedl),
    waiting("stopj(a=2)", _stopj),
    waiting("stopl(a=2, aRot=None)", _stopl),
    modelled(
        "get_inverse_kin(x, qnear=None, maxPositionError=1e-10, maxOrientationError=1e-10, tcp=None)",
        _inverse,
    ),
    modelled(
        "get_inverse_kin_has_solution(pose, qnear=None, maxPositionError=1e-10, maxOrientationError=1e-10, tcp=None)",
        _has_inverse,
    ),
    modelled("get_forward_kin(q=None, tcp=None)", _forward),
    modelled("is_within_safety_limits(pose)", _inside),
    modelled("is_steady()", lambda task: task.host.still),
    modelled("get_actual_joint_positions()", lambda task: task.host.joints),
    modelled("get_joint_positions()", lambda task: task.host.joints),
    modelled("get_actual_joint_speeds()", lambda task: task.host.speeds),
    modelled("get_target_joint_positions()", lambda task: task.host.target),
    modelled("get_target_joint_speeds()", lambda task: task.host.target_speeds),
    modelled("get_actual_tcp_pose()", lambda task: value_of(task.host.forward(task.host.joints))),
    modelled("get_target_tcp_pose()", lambda task: value_of(task.host.forward(task.host.target))),
    modelled("tool_pose()", lambda task: value_of(task.host.forward(task.host.target))),
    modelled("get_target_waypoint()", lambda task: value_of(task.host.forward(task.host.target))),
    modelled(
        "get_actual_tool_flange_pose()",
        lambda task: value_of(task.host.forward(task.host.joints, Pose((0.0,) * 3, (1.0, 0.0, 0.0, 0.0)))),
    ),
    modelled("get_actual_tcp_speed()", read_output("actual_TCP_speed")),
    modelled("get_target_tcp_speed()", read_output("target_TCP_speed")),
    modelled("get_rtde_value(key)", lambda task, key: _to_pose_or_joints(task.host.output(string(key)))),
    modelled("get_tcp_offset()", lambda task: PoseValue(six_of(task.host.tcp))),
    modelled("set_tcp(pose, tcp_name=None)", _set_tcp),
    modelled("get_target_payload()", lambda task: task.host.payload[0]),
    modelled("get_target_payload_cog()", lambda task: tuple(task.host.payload[1:])),
    modelled("set_payload(m, cog=None)", _set_payload),
    modelled("set_payload_mass(m)", lambda task, mass: _set_payload(task, mass, None)),
    modelled("set_payload_cog(cog)", lambda task, cog: _set_payload(task, task.host.payload[0], cog)),
    modelled("set_target_payload(m, cog=None, inertia=None, transition_time=0)", _set_payload),
    modelled("protective_stop()", lambda task: task.host.protective_stop(ORDERED)),
    modelled("powerdown()", lambda task: task.host.power_off()),
)
