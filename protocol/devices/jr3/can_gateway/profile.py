"""Settings and assumptions of a client of a CAN gateway."""

from dataclasses import dataclass

from protocol.devices.jr3.firmware import check_cutoff
from protocol.devices.jr3.gateway_profile import AnyGatewayClientProfile
from protocol.marks import Mark, above, at_least, between, setting


@dataclass(frozen=True)
class GatewayClientProfile(AnyGatewayClientProfile):
    """Settings of the client of a CAN gateway."""

    node: int = setting(1, Mark.OBSERVED, "node number of the gateway", between(1, 127))
    period_ms: float = setting(
        10.0,
        Mark.CHOSEN,
        "time between frames; tested by the firmware's authors from 1 on; the counter wraps every 8.4 s",
        above(0.0, 4000.0),
        unit="ms",
    )
    ack_timeout_s: float = setting(
        0.25,
        Mark.OBSERVED,
        "timeout of an acknowledge, after which the command is repeated; a stop waits for one "
        "more period of the stream",
        above(0.0),
        unit="s",
    )
    ready_timeout_s: float = setting(
        10.0, Mark.CHOSEN, "timeout of a gateway that is silent or not ready", above(0.0), unit="s"
    )
    settle_s: float = setting(
        0.1,
        Mark.OBSERVED,
        "time between start and first use or zero, for the filter to settle",
        at_least(0.0),
        unit="s",
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        check_cutoff(self.cutoff_hz)
