"""States of the S3 controller as three tables: events that change them, bits of the status, and refused orders.

The codes are observed. The conditions under which they occur are assumed, and so is everything that a row does not
mark otherwise. Source: project specification of the computer link, section 3.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from enum import StrEnum
from typing import Any

from emulators.devices.s3.profile import S3Profile
from protocol.devices.s3.arap import FunctionCode, Mode, MoveKind, RefusalCode
from protocol.marks import Mark


class Activity(StrEnum):
    """Source of the arm's orders."""

    NONE = "none"
    SEQUENCE = "movement sequence"
    """The computer link, from the start of a sequence to its end."""
    PROGRAM = "program"


@dataclass(frozen=True, slots=True)
class State:
    """State that decides which orders are accepted."""

    mode: Mode
    link_control: bool
    """Whether the pendant has given control to the link."""
    activity: Activity = Activity.NONE
    emergency_stop: bool = False
    work_stop: bool = False
    key_auto: bool = True
    programming_unit: bool = False
    """Whether the programming unit is connected. This affects only the status."""
    interrupt_permitted: bool = False
    """Whether interrupts are permitted. This affects only the status."""
    starting: bool = False
    """Whether the controller is powered up but not ready. It then neither receives nor sends."""

    @property
    def operation(self) -> bool:
        """Whether the controller is in operation mode, with or without synchronisation, so that the arm may move."""
        return bool(self.mode & Mode.OPERATION)


class Stimulus(StrEnum):
    """Events that change a controller's state."""

    POWER_UP = "power-up"
    READY = "ready"
    EMERGENCY_STOP = "emergency stop pressed"
    EMERGENCY_RELEASE = "emergency stop released"
    WORK_STOP = "work stop"
    WORK_RELEASE = "work stop released"
    KEY_AUTO = "key to AUTO"
    KEY_MANUAL = "key to MANUAL"
    CONTROL_GRANTED = "link control given"
    CONTROL_WITHDRAWN = "link control taken back"
    UNIT_CONNECTED = "programming unit connected"
    UNIT_REMOVED = "programming unit removed"
    INTERRUPT_PERMITTED = "interrupt permitted"
    INTERRUPT_FORBIDDEN = "interrupt forbidden"
    STANDBY = "standby ordered"
    OPERATION = "operation ordered"
    SYNCHRONISE = "synchronise ordered"
    OPERATION_SYNCHRONISE = "operation and synchronise ordered"
    SEQUENCE_START = "movement sequence started"
    SEQUENCE_END = "movement sequence ended"
    PROGRAM_START = "program started"
    PROGRAM_END = "program ended"
    STOP = "stop ordered"


@dataclass(frozen=True, slots=True)
class Change:
    """Effect of an event on the state."""

    values: Mapping[str, Any]
    halts: bool
    """Whether the arm stops at its current position. Queued points, the sequence and the program are then cancelled."""
    mark: Mark


def _sets(mark: Mark = Mark.ASSUMED, **values: Any) -> Change:
    return Change(values, False, mark)


def _halts(mark: Mark = Mark.ASSUMED, **values: Any) -> Change:
    return Change({**values, "activity": Activity.NONE}, True, mark)


CHANGES: Mapping[Stimulus, Change] = {
    Stimulus.POWER_UP: _halts(starting=True),  # mode and link control are reset to the profile's values
    Stimulus.READY: _sets(starting=False),
    #
    Stimulus.EMERGENCY_STOP: _halts(Mark.OBSERVED, emergency_stop=True, mode=Mode.STANDBY),
    Stimulus.EMERGENCY_RELEASE: _sets(emergency_stop=False),  # operation mode must be selected again
    Stimulus.WORK_STOP: _halts(work_stop=True),  # the mode does not change
    Stimulus.WORK_RELEASE: _sets(work_stop=False),
    Stimulus.KEY_AUTO: _sets(key_auto=True),
    Stimulus.KEY_MANUAL: _halts(key_auto=False),  # the mode does not change
    Stimulus.CONTROL_GRANTED: _sets(Mark.OBSERVED, link_control=True),
    Stimulus.CONTROL_WITHDRAWN: _sets(link_control=False),  # a motion continues
    Stimulus.UNIT_CONNECTED: _sets(programming_unit=True),
    Stimulus.UNIT_REMOVED: _sets(programming_unit=False),
    Stimulus.INTERRUPT_PERMITTED: _sets(interrupt_permitted=True),
    Stimulus.INTERRUPT_FORBIDDEN: _sets(interrupt_permitted=False),
    #
    Stimulus.STANDBY: _halts(Mark.OBSERVED, mode=Mode.STANDBY),
    Stimulus.OPERATION: _sets(Mark.OBSERVED, mode=Mode.OPERATION),
    Stimulus.SYNCHRONISE: _halts(Mark.OBSERVED, mode=Mode.SYNCHRONISE),
    Stimulus.OPERATION_SYNCHRONISE: _sets(Mark.OBSERVED, mode=Mode.OPERATION_SYNCHRONISE),
    #
    Stimulus.SEQUENCE_START: _sets(Mark.OBSERVED, activity=Activity.SEQUENCE),
    Stimulus.SEQUENCE_END: _sets(Mark.OBSERVED, activity=Activity.NONE),  # queued points are still reached
    Stimulus.PROGRAM_START: _sets(Mark.OBSERVED, activity=Activity.PROGRAM),
    Stimulus.PROGRAM_END: _sets(activity=Activity.NONE),
    Stimulus.STOP: _halts(Mark.OBSERVED),  # assumed: it also ends a movement sequence
}
"""Effect of every event. Fields that an effect does not name keep their values."""

MODE_ORDERS: Mapping[Mode, Stimulus] = {
    Mode.STANDBY: Stimulus.STANDBY,
    Mode.OPERATION: Stimulus.OPERATION,
    Mode.SYNCHRONISE: Stimulus.SYNCHRONISE,
    Mode.OPERATION_SYNCHRONISE: Stimulus.OPERATION_SYNCHRONISE,
}


def initial(profile: S3Profile) -> State:
    """Return the initial state of a running controller with this profile. No button is pressed and no key is turned."""
    return State(Mode(profile.power_up_mode), profile.link_control)


def after(state: State, stimulus: Stimulus, profile: S3Profile) -> State:
    """Return the state after an event. A power-up does not change buttons, keys and plugs."""
    if stimulus is Stimulus.POWER_UP:
        state = replace(state, mode=Mode(profile.power_up_mode), link_control=profile.link_control)
    return replace(state, **CHANGES[stimulus].values)


def status_flags(state: State, moving: bool, profile: S3Profile) -> dict[str, bool]:
    """Return the bits of bytes 16 (assumed) and 17 (observed) of the status, by name. `moving` states whether the
    arm moves.
    """
    stopped = state.emergency_stop and not profile.emergency_stop_keeps_standby
    return {
        "local": not state.link_control,
        "interrupt_permitted": state.interrupt_permitted,
        "programming_unit": state.programming_unit,
        "key_auto": state.key_auto,
        "standby": not state.operation and not stopped,
        "operation": state.operation,
        "execution": moving or state.activity is Activity.PROGRAM,
        "emergency_stop": state.emergency_stop,
    }


@dataclass(frozen=True, slots=True)
class RefusalRule:
    """Rule that refuses certain orders in certain states."""

    code: int | None
    """Refusal code; None selects the profile's `no_control_refusal`."""
    when: Mapping[str, object]
    """Values of fields and properties of `State` for which the rule applies."""
    functions: tuple[int, ...] = ()
    """Function codes that are refused; if empty, all except the one that reads the status."""
    suffixes: tuple[int, ...] = ()
    """Suffixes that are refused; if empty, all."""
    includes_accepted: bool = True
    """Whether the rule also refuses an accepted point whose answer waits until it is reached."""
    mark: Mark = field(default=Mark.ASSUMED, kw_only=True)
    """Mark of the rule's condition."""


_START, _MOVE, _MODE = FunctionCode.START_PROGRAM, FunctionCode.MOVE, FunctionCode.WRITE_MODE
_OPERATION_MODES = Mode.OPERATION, Mode.OPERATION_SYNCHRONISE

REFUSALS: tuple[RefusalRule, ...] = (
    RefusalRule(None, {"link_control": False}),
    RefusalRule(RefusalCode.STOPPED, {"emergency_stop": True}, (_START, _MOVE)),
    RefusalRule(RefusalCode.STOPPED, {"emergency_stop": True}, (_MODE,), _OPERATION_MODES),
    RefusalRule(RefusalCode.WORK_STOP, {"work_stop": True}, (_START, _MOVE)),
    RefusalRule(RefusalCode.WRONG_KEY_MODE, {"key_auto": False}, (_START, _MOVE)),
    RefusalRule(RefusalCode.WRONG_KEY_MODE, {"key_auto": False}, (_MODE,), _OPERATION_MODES),
    RefusalRule(RefusalCode.WRONG_OPERATION_MODE, {"operation": False}, (_START, _MOVE)),
    RefusalRule(RefusalCode.PROGRAM_RUNNING, {"activity": Activity.PROGRAM}, (_START, _MOVE)),
    RefusalRule(RefusalCode.NOT_POSSIBLE, {"activity": Activity.SEQUENCE}, (_START,)),
    RefusalRule(
        RefusalCode.OUTSIDE_WORK_AREA,  # the code also means that there is no start point
        {"activity": Activity.NONE},
        (_MOVE,),
        (MoveKind.POINT, MoveKind.END),
        includes_accepted=False,
    ),
)
"""Refusal rules. The first matching rule applies. Errors of the order itself are checked afterwards."""


def refusal(state: State, function: int, suffix: int, profile: S3Profile, taken: bool = False) -> int | None:
    """Return the code that refuses an order in this state, or None. `taken` states whether the point was accepted
    before.
    """
    for rule in REFUSALS:
        concerned = function in rule.functions if rule.functions else function != FunctionCode.READ_STATUS
        if (
            not concerned
            or (rule.suffixes and suffix not in rule.suffixes)
            or (taken and not rule.includes_accepted)
        ):
            continue
        if all(getattr(state, name) == value for name, value in rule.when.items()):
            return profile.no_control_refusal if rule.code is None else rule.code
    return None
