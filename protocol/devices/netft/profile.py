"""Settings of a client about its Net F/T."""

from dataclasses import dataclass

from protocol.devices.netft.page import HTTP_PORT
from protocol.devices.netft.records import INTERNAL_RATE_HZ
from protocol.marks import Mark, above, at_least, between, check_settings, setting


@dataclass(frozen=True, slots=True)
class NetFtClientProfile:
    """Settings in `[sensor.netft]`."""

    http_port: int = setting(
        HTTP_PORT,
        Mark.OBSERVED,
        "port of its configuration page, where the URL does not name it",
        between(1, 65535),
    )
    page_timeout_s: float = setting(
        1.0, Mark.OBSERVED, "wait for one answer of the page, as netft-cpp does", above(0.0), unit="s"
    )
    page_patience_s: float = setting(
        15.0, Mark.CHOSEN, "patience with a page that does not come: a boot and more", above(0.0), unit="s"
    )
    silence_s: float = setting(
        0.1, Mark.OBSERVED, "silence after which the stream is asked for again", above(0.0), unit="s"
    )
    starts: int = setting(10, Mark.OBSERVED, "requests for a stream before it is given up", at_least(1))
    internal_rate_hz: float = setting(
        INTERNAL_RATE_HZ,
        Mark.OBSERVED,
        "internal samples a second, by which a record's age is told: 7000 of a Net Box; an Axia has other rates",
        above(0.0),
        unit="Hz",
    )
    zero_s: float = setting(
        0.1, Mark.CHOSEN, "time of which the mean makes a zero", between(0.0, 10.0), unit="s"
    )

    def __post_init__(self) -> None:
        check_settings(self)
