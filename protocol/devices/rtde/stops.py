"""Stop conditions of a Universal Robots arm, derived from the reported state."""

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
            Trouble("emergency stop", "release the emergency stop, power the robot on, and start again"),
        ),
        (
            SafetyBits.VIOLATION | SafetyBits.FAULT,
            Trouble("safety violation or fault", "restart its safety system"),
        ),
        (
            SafetyBits.PROTECTIVE_STOPPED,
            Trouble("protective stop", "find its cause, unlock it after 5 s at the pendant, and start again"),
        ),
        (SafetyBits.SAFEGUARD_STOPPED, Trouble("safeguard stop", "close the safeguard, and start again")),
        (SafetyBits.RECOVERY, Trouble("recovery mode", "move it back inside its safety limits by hand")),
    )
)
"""Stop bits with their troubles, the most severe first. The bits are plain integers, because flags are slow to
combine.
"""


def find_stop(mode: float, bits: int) -> Trouble:
    """Return the reason why the robot itself cannot move, derived from `robot_mode` and `safety_status_bits`."""
    for stop, trouble in _STOPS:
        if bits & stop:
            return trouble
    if mode != RobotMode.RUNNING:
        return Trouble(
            f"it is in the mode {name_of(RobotMode, mode)!r}", "power it on and release its brakes"
        )
    if not bits & _RUNS:
        return Trouble("it is stopped for safety", "check the pendant, and start again")
    return NO_TROUBLE
