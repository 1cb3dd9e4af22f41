"""Errors, as a tree by the part at fault. Messages are one line: what, where, what to do."""

from collections.abc import Sequence

from hil_bridge.errors.cause_row import CONFIGURATION, STOPPED
from hil_bridge.errors.cause_table import ROWS
from hil_bridge.errors.causes import Cause, Part, Reason, describe_lateness

__all__ = [
    "BridgeError",
    "Cause",
    "ConfigError",
    "DeviceError",
    "GateStop",
    "OrderRefused",
    "Part",
    "Reason",
    "SafetyStop",
    "SettingRefused",
    "StepError",
    "TransportBroken",
    "TransportClosed",
    "TransportEnded",
    "TransportError",
    "TransportUnavailable",
]


class BridgeError(Exception):
    """Every error that an operator is meant to read. `exit_code` is what the command line ends with."""

    exit_code = STOPPED
    cause: Cause | None = None
    """Row of the table of causes; None where the place that raises it does not know whose fault it is."""
    late_s: float = 0.0
    """Longest time by which this computer was late in the second before, s; 0 where it was in time."""

    def __init__(self, text: str = "", *, remedy: str = "", cause: Cause | None = None) -> None:
        """`text` is the fact; `remedy` what else is known of it, and what an operator can do."""
        super().__init__(text)
        self.remedy = remedy
        if cause is not None:
            self.cause = cause

    @property
    def part(self) -> Part | None:
        """Part at fault; None where that is not known."""
        return None if self.cause is None else ROWS[self.cause].part

    @property
    def fact(self) -> str:
        """The message without its remedy."""
        return super().__str__()

    @property
    def without_source(self) -> str:
        """The message without the file that it begins with."""
        return str(self)

    def blame(self, cause: Cause) -> None:
        """Name the cause where none is named yet."""
        self.cause = self.cause or cause

    def reason(self, otherwise: Cause) -> Reason:
        """Return the error as a value; `otherwise` is its cause if it names none."""
        return Reason(self.cause or otherwise, self.fact, self.remedy, late_s=self.late_s)

    def __str__(self) -> str:
        return "; ".join(filter(None, (self.fact, describe_lateness(self.late_s), self.remedy)))

    def __reduce__(self) -> tuple[object, ...]:
        return (type(self), self.args, self.__dict__)


class ConfigError(BridgeError):
    """The configuration, a command-line value or a file that was named is wrong."""

    exit_code = CONFIGURATION
    cause = Cause.CONFIGURATION


class SettingRefused(ConfigError):
    """A setting has a value that cannot be, or there is no such setting."""

    def __init__(
        self, source: str, key: Sequence[str], problem: str, joint: str = ": ", further: int = 0
    ) -> None:
        """`source` is the file or the option that gives it; empty where its reader knows.

        `key` has its sections and its name, or nothing where the source says all. `joint` stands between the key and
        the problem: a space where they make one sentence. `further` settings are wrong too.
        """
        self.source, self.key, self.problem, self.joint, self.further = (
            source,
            tuple(key),
            problem,
            joint,
            further,
        )
        super().__init__(
            f"{source}{': ' if self.key else joint}{self.without_source}" if source else self.without_source
        )

    @property
    def without_source(self) -> str:
        return self.below(0)

    def below(self, depth: int) -> str:
        """Return the same message for a reader who knows the source and the first `depth` parts of the key."""
        name = ".".join(self.key[depth:])
        more = f" (and {self.further} more)" if self.further else ""
        return f"{name}{self.joint if name else ''}{self.problem}{more}"

    def __reduce__(self) -> tuple[object, ...]:
        return (type(self), (self.source, self.key, self.problem, self.joint, self.further), self.__dict__)


class StepError(ConfigError):
    """A step of a program cannot be carried out."""

    def __init__(self, problem: str, label: str = "") -> None:
        """`label` is its number and its word, as "2 (track)"; without one the program as a whole is wrong."""
        super().__init__(_in_table("task.step", label, problem))
        self.label, self.problem = label, problem

    def in_table(self, key: str) -> str:
        """Return the message for a file whose table of steps has this name."""
        return _in_table(key, self.label, self.problem)

    def __reduce__(self) -> tuple[object, ...]:
        return (type(self), (self.problem, self.label), self.__dict__)


def _in_table(key: str, label: str, problem: str) -> str:
    return f"{key}{label and f' {label}'}: {problem}"


class TransportError(BridgeError):
    """A wire failed. The subclass says which end of it."""


class TransportClosed(TransportError):
    """We closed it."""


class TransportBroken(TransportError):
    """The peer vanished or the cable broke."""


class TransportEnded(TransportError):
    """The other side ended the stream in an orderly way."""


class TransportUnavailable(TransportError):
    """The port, host or interface could not be opened."""


class DeviceError(BridgeError):
    """A device is there but refuses, stays silent or says what it must not."""


class SafetyStop(BridgeError):
    """The supervisor stopped the run; the message is the latched cause."""


class OrderRefused(DeviceError):
    """The robot refused an order; `code` is its own number for the reason, 0 where it tells none."""

    cause = Cause.REFUSED_ORDER

    def __init__(self, text: str, code: int = 0, *, remedy: str = "", cause: Cause | None = None) -> None:
        super().__init__(text, remedy=remedy, cause=cause)
        self.code = code


class GateStop(OrderRefused):
    """The last gate stopped an order, which is a bug of this program; nothing of it was sent."""

    cause = Cause.GATE
