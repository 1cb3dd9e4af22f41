"""Descriptions of the flags in a status that keep an S3 robot from moving."""

from collections.abc import Sequence

from protocol.devices.s3.arap import Status

_STATES = (
    ("emergency_stop", True, "emergency stop", "release it at the controller's panel"),
    ("key_auto", False, "key not in AUTO", "turn it (or see robot.s3.link.check_flags)"),
    (
        "local",
        True,
        "link control taken back",
        "give it at the teach pendant (or see robot.s3.link.check_flags)",
    ),
    ("operation", False, "in standby", "start again"),
)
"""Flags of a status that keep the robot from moving: flag, value, text, remedy."""
_SURE = ("emergency_stop", "operation")
"""Flags whose position was observed; that of the others is assumed."""


def describe_stop(status: Status, check_flags: bool, standby: bool = True) -> tuple[str, str] | None:
    """Describe what keeps the robot from moving, with the first remedy; None if nothing does.

    `check_flags`: include flags whose position is assumed. `standby`: include standby.
    """
    shown = [
        (words, remedy)
        for name, value, words, remedy in _STATES
        if getattr(status, name) is value
        and (check_flags or name in _SURE)
        and (standby or name != "operation")
    ]
    return (_together([words for words, _ in shown]), shown[0][1]) if shown else None


def describe_new_stop(status: Status, fit: Status | None) -> str:
    """Describe what keeps the robot from moving, except what already did when its status was `fit`; "" if
    nothing does.
    """
    new = [
        words
        for name, value, words, _ in _STATES
        if getattr(status, name) is value and (fit is None or getattr(fit, name) is not value)
    ]
    return _together(new)


def _together(states: Sequence[str]) -> str:
    return (
        "in standby, as after a restart or by hand" if list(states) == ["in standby"] else ", ".join(states)
    )
