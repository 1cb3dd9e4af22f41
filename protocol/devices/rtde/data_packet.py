"""Data packets as the client asks for them: its variables, and what their values say of the robot."""

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
"""Output recipe of the client."""
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
"""Types of the client's variables, by its lists of names."""
_SPEED, _TARGET, STATES = 7, 19, 25
"""Places of `actual_TCP_speed`, `target_TCP_pose` and `runtime_state` among the values; the pose stands from 1 on."""
_FORCE = slice(13, 16)
"""Place of the force of `actual_TCP_force`."""
APART_M, APART_RAD = 1e-3, math.radians(1.0)
"""Chosen: an arm that stands farther from its own target reports another pose than was ordered; a few times what its
joints give way by when the tool presses.
"""
STANDS_M_S = 1e-3
"""Chosen: an arm whose tool is slower stands."""
FULL_SPEED = 0.995
"""Chosen: below, the speed slider is down."""
Values = tuple[float, ...]


def describe_strange_types(names: tuple[str, ...], answer: packets.Types) -> str:
    """Words for an answer to a list of variables that is not as its maker's guide has it."""
    for name, kind, expected in zip(names, answer.types, EXPECTED[names], strict=False):
        if kind != expected:
            return f"it says that {name} is of type {kind[:24]!r}, and its maker's guide says {expected}"
    return f"it answers {len(names)} variables with {len(answer.types)} types and recipe {answer.recipe}"


def read_pose(values: Values) -> Pose:
    """Return the pose of a packet; NaN where one of its numbers is."""
    if all(map(math.isfinite, values[1:7])):
        return pose_of(values[1:7])
    return Pose((math.nan,) * 3, (1.0, 0.0, 0.0, 0.0))


def read_force(values: Values) -> Vector | None:
    """Return the robot's own force, N; None from an arm without a force estimate, which reports zeros."""
    a, b, c = force = values[_FORCE]
    return (a, b, c) if math.isfinite(a + b + c) and any(force) else None


_WHY_STOPPED = (
    "see at the pendant whether an operator, another client or the watchdog ended it, and begin again"
)


def find_slow(scaling: float) -> Trouble:
    """Report a speed slider below full speed."""
    if scaling >= FULL_SPEED:
        return NO_TROUBLE
    return Trouble(f"its speed slider stands at {100.0 * scaling:.0f} %", "put it to 100 %")


def find_trouble(values: Values, moving: bool) -> Trouble:
    """Reason for which nothing can be ordered."""
    if stop := find_stop(values[STATES + 1], int(values[STATES + 2])):
        return stop
    runtime, _, _, _, state, _, _, scaling = values[STATES:]
    if runtime != Runtime.PLAYING:
        remedy = _WHY_STOPPED if runtime == Runtime.STOPPED else "begin again"
        return Trouble(f"our program is {name_of(Runtime, runtime)}", remedy)
    if state == State.REFUSED:
        return Trouble(
            "no joints near the present ones hold the pose that was ordered",
            "choose another place, or turn the tool less",
        )
    if moving and state == State.STARVED:
        return Trouble(
            "our program had no new target for too long and has braked",
            "look at the network, and begin again",
        )
    if state == State.ENDED:
        return Trouble("our program has ended", "begin again")
    return find_slow(scaling)


def find_misplacement(values: Values) -> Trouble:
    """Return the reason for which no movement may begin at the reported pose of a standing arm."""
    actual, target = values[1:7], values[_TARGET : _TARGET + 6]
    if not math.hypot(*values[_SPEED : _SPEED + 3]) <= STANDS_M_S:
        return NO_TROUBLE
    off = math.dist(actual[:3], target[:3])
    turned = angle_between(turn_by(actual[3:]), turn_by(target[3:]))
    if off <= APART_M and turned <= APART_RAD:
        return NO_TROUBLE
    return Trouble(
        f"it tells to stand {off * 1e3:.1f} mm and {math.degrees(turned):.1f}° from its own target",
        "look at its tool centre point and payload, and begin again",
    )
