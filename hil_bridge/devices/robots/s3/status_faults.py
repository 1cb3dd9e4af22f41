"""Descriptions of the status flags that prevent an S3 robot from moving."""

from collections.abc import Sequence

from protocol.devices.s3.arap import Status

_STATES = (
    ("emergency_stop", True, "emergency stop", "release the emergency stop at the controller's panel"),
    ("key_auto", False, "key not in AUTO", "turn it (or see robot.s3.link.check_flags)"),
    (
        "local",
        True,
        "link control taken back",
        "give it at the teach pendant (or see robot.s3.link.check_flags)",
    ),
    ("operation", False, "in standby", "start again"),
)
"""Status flags that prevent the robot from moving: flag, value, text, remedy."""
_SURE = ("emergency_stop", "operation")
"""Flags whose position in the status was observed. The position of the other flags is assumed."""


def describe_stop(status: Status, check_flags: bool, standby: bool = True) -> tuple[str, str] | None:
    """Describe the flags that prevent the robot from moving, with the first remedy. Return None if there are none.

    `check_flags` includes the flags whose position is assumed. `standby` includes standby.
    """
    states = [
        (text, remedy)
        for name, value, text, remedy in _STATES
        if getattr(status, name) is value
        and (check_flags or name in _SURE)
        and (standby or name != "operation")
    ]
    return (_together([text for text, _ in states]), states[0][1]) if states else None


def describe_new_stop(status: Status, fit: Status | None) -> str:
    """Describe the flags that prevent the robot from moving, except the flags that were already set in its status
    `fit`. Return "" if there are none.
    """
    new = [
        text
        for name, value, text, _ in _STATES
        if getattr(status, name) is value and (fit is None or getattr(fit, name) is not value)
    ]
    return _together(new)


def _together(states: Sequence[str]) -> str:
    return (
        "in standby, as after a restart or by hand" if list(states) == ["in standby"] else ", ".join(states)
    )
