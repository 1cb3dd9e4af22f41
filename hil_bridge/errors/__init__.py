"""Exception hierarchy, by the part at fault. Messages are one line: what is wrong, where, and what to do."""

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
    """Base class of all errors with a message for the operator. The command line exits with `exit_code`."""

    exit_code = STOPPED
    cause: Cause | None = None
    """Cause from the table of causes; None if the code that raises the error does not know the part at fault."""
    late_s: float = 0.0
    """Longest time by which this computer was late during the previous second, s; 0 if it was on time."""

    def __init__(
        self, text: str = "", *, remedy: str = "", facts: str = "", cause: Cause | None = None
    ) -> None:
        """Create the error. `text` states the fact, `facts` further ones, and `remedy` what an operator can do."""
        super().__init__(text)
        self.remedy, self.facts = remedy, facts
        if cause is not None:
            self.cause = cause

    @property
    def part(self) -> Part | None:
        """Part at fault; None if unknown."""
        return None if self.cause is None else ROWS[self.cause].part

    @property
    def fact(self) -> str:
        """Message without its remedy."""
        return super().__str__()

    @property
    def without_source(self) -> str:
        """Message without the file name at its start."""
        return str(self)

    def blame(self, cause: Cause) -> None:
        """Set the cause of the error, unless it is already set."""
        self.cause = self.cause or cause

    def reason(self, otherwise: Cause) -> Reason:
        """Return the error as a value. `otherwise` is its cause if none is set."""
        return Reason(self.cause or otherwise, self.fact, self.remedy, late_s=self.late_s, facts=self.facts)

    def __str__(self) -> str:
        return "; ".join(filter(None, (self.fact, describe_lateness(self.late_s), self.facts, self.remedy)))

    def __reduce__(self) -> tuple[object, ...]:
        return (type(self), self.args, self.__dict__)


class ConfigError(BridgeError):
    """Error in the configuration, a command-line value or an input file."""

    exit_code = CONFIGURATION
    cause = Cause.CONFIGURATION


class SettingRefused(ConfigError):
    """Error about an invalid value of a setting, or an unknown setting."""

    def __init__(
        self, source: str, key: Sequence[str], problem: str, joint: str = ": ", further: int = 0
    ) -> None:
        """Create the error. `source` is the file or the option that sets the setting; empty if the reader knows it.

        `key` consists of the setting's sections and name; empty if the source alone identifies the setting. `joint`
        separates the key and the problem: a space if they form one sentence. `further` is the number of other
        invalid settings.
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
        """Return the message without the source and without the first `depth` parts of the key."""
        name = ".".join(self.key[depth:])
        more = f" (and {self.further} more)" if self.further else ""
        return f"{name}{self.joint if name else ''}{self.problem}{more}"

    def __reduce__(self) -> tuple[object, ...]:
        return (type(self), (self.source, self.key, self.problem, self.joint, self.further), self.__dict__)


class StepError(ConfigError):
    """Error about a step of a program that cannot be executed."""

    def __init__(self, problem: str, label: str = "") -> None:
        """Create the error. `label` is the number and the word of the step, for example "2 (track)"; empty for the
        entire program.
        """
        super().__init__(_in_table("task.step", label, problem))
        self.label, self.problem = label, problem

    def in_table(self, key: str) -> str:
        """Return the message for a file in which the table of steps has the given name."""
        return _in_table(key, self.label, self.problem)

    def __reduce__(self) -> tuple[object, ...]:
        return (type(self), (self.problem, self.label), self.__dict__)


def _in_table(key: str, label: str, problem: str) -> str:
    return f"{key}{label and f' {label}'}: {problem}"


class TransportError(BridgeError):
    """Failure of a transport. The subclasses name the side at fault."""


class TransportClosed(TransportError):
    """Transport closed by this program."""


class TransportBroken(TransportError):
    """Connection lost, because the peer vanished or the cable broke."""


class TransportEnded(TransportError):
    """Stream that the peer has closed in an orderly manner."""


class TransportUnavailable(TransportError):
    """Port, host or interface that cannot be opened."""


class DeviceError(BridgeError):
    """Error of a device that is reachable, but refuses a request, is silent or violates its protocol."""


class SafetyStop(BridgeError):
    """Stop of a run by the supervisor. The message is the latched cause."""


class OrderRefused(DeviceError):
    """Order refused by the robot. `code` is the robot's own error code, or 0 if it reports none."""

    cause = Cause.REFUSED_ORDER

    def __init__(self, text: str, code: int = 0, *, remedy: str = "", cause: Cause | None = None) -> None:
        super().__init__(text, remedy=remedy, cause=cause)
        self.code = code


class GateStop(OrderRefused):
    """Order stopped by the gate before it was sent, which indicates a bug in this program."""

    cause = Cause.GATE
