"""Data packets with the client's recipe: their variables, and the state of the robot derived from the values."""

import math

from protocol.devices.rtde import packets
from protocol.devices.rtde.program import INPUT_NAMES, State
from protocol.devices.rtde.rotation import pose_of
from protocol.devices.rtde.states import Runtime, name_of
from protocol.devices.rtde.stops import find_stop
from protocol.endpoint import NO_TROUBLE, Trouble
from protocol.geometry import Pose, Vector, angle_between, turn_by

OUTPUT_NAMES = (
    "timestamp",
    "actual_TCP_pose",
    "actual_TCP_speed",
    "actual_TCP_force",
    "target_TCP_pose",
    "runtime_state",
    "robot_mode",
    "safety_status_bits",
    "robot_status_bits",
    "output_int_register_24",
    "output_int_register_25",
    "output_int_register_26",
    "speed_scaling",
)
"""Names of the variables in the client's output recipe."""
EXPECTED = {
    OUTPUT_NAMES: (
        "DOUBLE",
        *("VECTOR6D",) * 4,
        "UINT32",
        "INT32",
        *("UINT32",) * 2,
        *("INT32",) * 3,
        "DOUBLE",
    ),
    INPUT_NAMES: (*("DOUBLE",) * 9, "INT32", "INT32"),
}
"""Types of the client's variables, by the tuple of their names."""
_SPEED, _TARGET, STATES = 7, 19, 25
"""Indices of `actual_TCP_speed`, `target_TCP_pose` and `runtime_state` among the values. `actual_TCP_pose` starts
at index 1.
"""
_FORCE = slice(13, 16)
"""Indices of the force in `actual_TCP_force` among the values."""
APART_M, APART_RAD = 1e-3, math.radians(1.0)
"""Largest difference between the arm's pose and its target, m and rad. Chosen: a multiple of the joint deflection
when the tool presses. An arm farther away reports another pose than the ordered one.
"""
STATIONARY_M_S = 1e-3
"""Tool speed up to which an arm counts as stationary, m/s. Chosen."""
FULL_SPEED = 0.995
"""Speed scaling below which the speed slider counts as reduced. Chosen."""
Values = tuple[float, ...]


def describe_strange_types(names: tuple[str, ...], answer: packets.Types) -> str:
    """Describe a response to a list of variables whose types differ from the vendor's guide."""
    for name, kind, expected in zip(names, answer.types, EXPECTED[names], strict=False):
        if kind != expected:
            return f"it reports {name} as type {kind[:24]!r}, but the vendor's guide says {expected}"
    return f"it answers a request for {len(names)} variables with {len(answer.types)} types and recipe {answer.recipe}"


def read_pose(values: Values) -> Pose:
    """Return the pose in a packet. Its position is NaN if one of the pose's numbers is not finite."""
    if all(map(math.isfinite, values[1:7])):
        return pose_of(values[1:7])
    return Pose((math.nan,) * 3, (1.0, 0.0, 0.0, 0.0))


def read_force(values: Values) -> Vector | None:
    """Return the force estimated by the robot, N; None if the arm has no force estimate and therefore reports zeros."""
    a, b, c = force = values[_FORCE]
    return (a, b, c) if math.isfinite(a + b + c) and any(force) else None


_WHY_STOPPED = (
    "check at the pendant whether an operator, another client or the watchdog ended it, and start again"
)


def find_slow(scaling: float) -> Trouble:
    """Return the trouble if the speed slider is below full speed."""
    if scaling >= FULL_SPEED:
        return NO_TROUBLE
    return Trouble(f"its speed slider is at {100.0 * scaling:.0f} %", "set it to 100 %")


def find_trouble(values: Values, moving: bool) -> Trouble:
    """Return the reason why no order can be given."""
    if stop := find_stop(values[STATES + 1], int(values[STATES + 2])):
        return stop
    runtime, _, _, _, state, _, _, scaling = values[STATES:]
    if runtime != Runtime.PLAYING:
        remedy = _WHY_STOPPED if runtime == Runtime.STOPPED else "start again"
        return Trouble(f"our program is {name_of(Runtime, runtime)}", remedy)
    if state == State.REFUSED:
        return Trouble(
            "no joints near the current ones reach the ordered pose",
            "choose another position, or rotate the tool less",
        )
    if moving and state == State.STARVED:
        return Trouble(
            "our program had no new target for too long and has braked",
            "check the network, and start again",
        )
    if state == State.ENDED:
        return Trouble("our program has ended", "start again")
    return find_slow(scaling)


def find_pose_mismatch(values: Values) -> Trouble:
    """Return the reason why no movement may begin at the reported pose of a stationary arm."""
    actual, target = values[1:7], values[_TARGET : _TARGET + 6]
    if not math.hypot(*values[_SPEED : _SPEED + 3]) <= STATIONARY_M_S:
        return NO_TROUBLE
    off = math.dist(actual[:3], target[:3])
    turned = angle_between(turn_by(actual[3:]), turn_by(target[3:]))
    if off <= APART_M and turned <= APART_RAD:
        return NO_TROUBLE
    return Trouble(
        f"it reports a pose {off * 1e3:.1f} mm and {math.degrees(turned):.1f}° from its own target",
        "check its tool centre point and payload, and start again",
    )
