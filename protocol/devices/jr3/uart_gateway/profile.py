"""Settings and assumptions of a UART gateway's client."""

from dataclasses import dataclass

from protocol.devices.jr3.firmware import check_cutoff
from protocol.devices.jr3.gateway_profile import AnyGatewayClientProfile
from protocol.devices.jr3.uart_gateway.messages import DATA_FRAME_S, UART_BAUDRATE, sendable_near
from protocol.marks import Mark, SettingError, above, at_least, setting


@dataclass(frozen=True)
class UartGatewayClientProfile(AnyGatewayClientProfile):
    """Settings of the client of a UART gateway."""

    period_ms: float = setting(
        10.0,
        Mark.CHOSEN,
        "time between frames, at least the 1.5625 that one takes on the line; the counter wraps every 8.4 s",
        above(0.0, 4000.0),
        unit="ms",
    )
    pause_s: float = setting(
        1.1,
        Mark.DERIVED,
        "time between an acknowledge and the next command: the gateway does not receive for 1 s, "
        "and clocks differ",
        at_least(0.0),
        unit="s",
    )
    ack_timeout_s: float = setting(
        1.25,
        Mark.DERIVED,
        "timeout of an acknowledge, after which the command is repeated: more than the 1 s "
        "without reception, or the repetition is lost too; a stop waits for one more period of "
        "the stream",
        above(0.0),
        unit="s",
    )
    ready_timeout_s: float = setting(
        12.0,
        Mark.CHOSEN,
        "timeout of a gateway that is silent or not ready: more than twice its boot time of 5 s",
        above(0.0),
        unit="s",
    )
    settle_s: float = setting(
        0.1,
        Mark.OBSERVED,
        "time between start and first use, for the filter to settle",
        at_least(0.0),
        unit="s",
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        check_uart_cutoff(self.cutoff_hz)
        if self.period_ms < DATA_FRAME_S * 1e3:
            raise SettingError(
                "period_ms",
                f"must be at least {DATA_FRAME_S * 1e3:g}, what a frame takes at {UART_BAUDRATE} baud, "
                f"got {self.period_ms:g}",
            )
        _check_sendable("period_ms", self.period_ms, 1000, 4)


def check_uart_cutoff(cutoff_hz: float) -> None:
    """Raise ValueError if a cut-off cannot be sent to the gateway over this line."""
    check_cutoff(cutoff_hz)
    _check_sendable("cutoff_hz", cutoff_hz, 100, 2)


def _check_sendable(name: str, value: float, steps: int, size: int) -> None:
    """Raise an error if a value cannot be sent: a gateway ends a command at any byte 3E and skips any byte 3C."""
    nearest = sendable_near(round(value * steps), size)
    if len(nearest) > 1:
        below, above = (f"{number / steps:g}" for number in nearest)
        raise SettingError(
            name,
            f"must not be {value:g}: on the line a byte of it looks like < or > to the gateway; "
            f"take {below} or {above}",
        )
