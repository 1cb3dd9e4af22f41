"""Stops of a Universal Robot, from what its controller tells, in words."""

from protocol.devices.rtde.states import RobotMode, SafetyBits, name_of
from protocol.endpoint import NO_TROUBLE, Trouble

_RUNS = int(SafetyBits.NORMAL | SafetyBits.REDUCED)
_STOPS = tuple(
    (int(bits), trouble)
    for bits, trouble in (
        (
            SafetyBits.ROBOT_EMERGENCY_STOPPED
            | SafetyBits.SYSTEM_EMERGENCY_STOPPED
            | SafetyBits.EMERGENCY_STOPPED,
            Trouble("emergency stop", "release it, power the robot on, and begin again"),
        ),
        (
            SafetyBits.VIOLATION | SafetyBits.FAULT,
            Trouble("safety violation or fault", "restart its safety system"),
        ),
        (
            SafetyBits.PROTECTIVE_STOPPED,
            Trouble("protective stop", "see its cause, unlock it after 5 s at the pendant, and begin again"),
        ),
        (SafetyBits.SAFEGUARD_STOPPED, Trouble("safeguard stop", "close the safeguard, and begin again")),
        (SafetyBits.RECOVERY, Trouble("recovery mode", "move it back inside its safety limits by hand")),
    )
)
"""Bits of stops, the gravest first, in words. Plain numbers, for flags are slow to join."""


def find_stop(mode: float, bits: int) -> Trouble:
    """Reason for which the robot itself cannot move, from `robot_mode` and `safety_status_bits`."""
    for stop, trouble in _STOPS:
        if bits & stop:
            return trouble
    if mode != RobotMode.RUNNING:
        return Trouble(
            f"it is in the mode {name_of(RobotMode, mode)!r}", "power it on and release its brakes"
        )
    if not bits & _RUNS:
        return Trouble("it is stopped for safety", "see the pendant, and begin again")
    return NO_TROUBLE
