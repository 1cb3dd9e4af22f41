"""Settings and assumptions of a board's client and of a register server."""

from dataclasses import dataclass
from typing import Any, ClassVar, Final, Literal

from protocol.devices.jr3.board import FILTERS
from protocol.marks import Mark, SettingError, above, at_least, between, check_settings, setting

SAMPLE_RATE_HZ = 8000.0
"""Rate of the unfiltered samples, Hz. Source: JR3 manual 5907E."""

FILTER_DELAYS: Final = (0.0, 1.320e-3, 6.598e-3, 27.71e-3, 112.2e-3, 450e-3, 1801e-3)
"""Phase delay of filter0 … filter6 at low frequencies, s. Derived from the manual's plots."""


def filter_tick(number: int) -> float:
    """Return the time between two outputs of a filter, s. From filter2 on, each filter runs at a quarter of the rate of
    the previous one.
    """
    return 4.0 ** max(number - 1, 0) / SAMPLE_RATE_HZ


@dataclass(frozen=True)
class BoardClientProfile:
    """Settings of the client of a receiver board that is accessed through its registers."""

    __pydantic_config__: ClassVar[dict[str, Any]] = {"extra": "forbid"}

    filter: int = setting(
        2, Mark.CHOSEN, "number of the board's filter to read; 0: unfiltered", between(0, FILTERS - 1)
    )
    period_ms: float = setting(
        10.0,
        Mark.CHOSEN,
        "time between samples; at least the filter's own period",
        between(0.25, 4000.0),
        unit="ms",
    )
    mode: Literal["stream", "poll"] = setting(
        "stream", Mark.CHOSEN, "stream: the server sends by its own clock; poll: each sample is requested"
    )
    bursts: int = setting(1, Mark.CHOSEN, "samples per message of a stream", between(1, 64))
    start_up: Literal["driver", "none"] = setting(
        "driver",
        Mark.CHOSEN,
        "driver: reset and initialize the board as the kernel's driver does; none: use it as it "
        "is, for a second client",
    )
    program: str = setting(
        "",
        Mark.CHOSEN,
        "path of the firmware that is loaded into the board after its reset, JR3's jr3pci.idm; "
        "empty: the board or its server has it",
    )
    reset_ms: float = setting(25.0, Mark.OBSERVED, "pause after a reset", at_least(0.0), unit="ms")
    poll_s: float = setting(1.0, Mark.OBSERVED, "time between two checks for a sensor", above(0.0), unit="s")
    offset_polls: int = setting(
        10,
        Mark.OBSERVED,
        "further checks, because the board zeroes its offsets by itself within 10 s",
        at_least(0),
    )
    command_ms: float = setting(
        20.0,
        Mark.OBSERVED,
        "time between a command and the first check of its completion",
        above(0.0),
        unit="ms",
    )
    use_offset_ms: float = setting(
        40.0,
        Mark.OBSERVED,
        "time between the first use of an offset and the first check of its completion",
        above(0.0),
        unit="ms",
    )
    command_timeout_s: float = setting(
        1.0, Mark.CHOSEN, "timeout of a command; the slowest needs 16 ms", above(0.0), unit="s"
    )
    ready_timeout_s: float = setting(
        10.0, Mark.CHOSEN, "timeout of a board without a sensor", above(0.0), unit="s"
    )
    answer_timeout_s: float = setting(
        1.0, Mark.CHOSEN, "timeout of a server that does not answer", above(0.0), unit="s"
    )
    data_timeout_s: float = setting(
        1.0, Mark.CHOSEN, "timeout of a new sample, in addition to five periods", above(0.0), unit="s"
    )
    settle_delays: float = setting(
        15.0,
        Mark.DERIVED,
        "settling time of a step to within a count, in multiples of the filter's delay",
        at_least(0.0),
    )

    def __post_init__(self) -> None:
        check_settings(self)
        if self.mode not in ("stream", "poll"):
            raise SettingError("mode", f"must be stream or poll, got {self.mode}")
        if self.start_up not in ("driver", "none"):
            raise SettingError("start_up", f"must be driver or none, got {self.start_up}")
        if self.program and self.start_up == "none":
            raise SettingError("program", "is loaded only with start_up = driver; remove one of the two")

    @property
    def period(self) -> float:
        """Time between samples, s: a whole number of microseconds, and at least the filter's own period."""
        return round(max(self.period_ms * 1e-3, filter_tick(self.filter)) * 1e6) * 1e-6

    @property
    def delay(self) -> float:
        """Delay of the filter output relative to the force at low frequencies, s."""
        return FILTER_DELAYS[self.filter]

    @property
    def settling(self) -> float:
        """Time from a step in the force until the filter output no longer contains the previous force, s."""
        return self.settle_delays * self.delay


@dataclass(frozen=True)
class RegisterServerProfile:
    """Settings of a register server for one connection."""

    __pydantic_config__: ClassVar[dict[str, Any]] = {"extra": "forbid"}

    idle_timeout_s: float = setting(
        60.0,
        Mark.CHOSEN,
        "time after which a silent client without a stream is disconnected; 0: never",
        at_least(0.0),
        unit="s",
    )
    shortest_period_us: int = setting(
        250, Mark.CHOSEN, "shortest period of a stream: two samples of the sensor", at_least(1), unit="µs"
    )

    def __post_init__(self) -> None:
        check_settings(self)
