"""Settings of the client of a SCHUNK FTS."""

from dataclasses import dataclass

from hil_schunk.messages import DATA_PORT, FILTERS, PERIOD_S, TOOLS
from protocol.marks import Mark, above, at_least, between, check_settings, setting


@dataclass(frozen=True, slots=True)
class FtsClientSettings:
    """Settings in `[sensor.schunk_fts]`."""

    data_port: int = setting(
        DATA_PORT,
        Mark.OBSERVED,
        "UDP port of this computer to which the sensor sends, if the URL does not name one",
        between(1, 65535),
    )
    data_address: str = setting(
        "",
        Mark.CHOSEN,
        "address of this computer at which measurements arrive; empty: loopback for a sensor on it, else any",
    )
    filter: int = setting(
        0,
        Mark.CHOSEN,
        "number of the noise filter, which the client selects: running mean of 1, 2, 4, 8 or 16 samples",
        between(0, len(FILTERS) - 1),
    )
    tool: int = setting(
        -1,
        Mark.CHOSEN,
        "number of the tool setting, which the client selects: 0 to 3; -1: leave it",
        between(-1, TOOLS - 1),
    )
    answer_s: float = setting(
        2.0, Mark.OBSERVED, "timeout of an answer, as in the maker's library", above(0.0), unit="s"
    )
    silence_s: float = setting(
        0.1,
        Mark.OBSERVED,
        "time without a packet after which the stream is requested again; the maker's library then reconnects",
        above(0.0),
        unit="s",
    )
    starts: int = setting(10, Mark.CHOSEN, "requests for a stream before the session fails", at_least(1))
    ready_s: float = setting(
        15.0, Mark.CHOSEN, "timeout of a sensor that reports that it is not ready", above(0.0), unit="s"
    )
    zero_s: float = setting(
        0.1, Mark.CHOSEN, "duration over which a zero is averaged", between(0.0, 10.0), unit="s"
    )

    @property
    def delay(self) -> float:
        """Delay of the filter, s. Mark: derived."""
        return (FILTERS[self.filter] - 1) / 2.0 * PERIOD_S

    def __post_init__(self) -> None:
        check_settings(self)
