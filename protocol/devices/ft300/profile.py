"""Settings of the client of an FT 300."""

from dataclasses import dataclass
from typing import Literal

from protocol.marks import Mark, SettingError, above, at_least, between, check_settings, setting


@dataclass(frozen=True, slots=True)
class Ft300ClientProfile:
    """Settings in `[sensor.ft300]`."""

    mode: Literal["stream", "modbus"] = setting(
        "stream",
        Mark.CHOSEN,
        "source of samples: a stream of 100 messages per second, or one request after the other, "
        "about 60 per second",
    )
    rated_n: float = setting(
        300.0,
        Mark.OBSERVED,
        "rated force of each axis; a larger value is not trusted",
        above(0.0),
        unit="N",
    )
    rated_nm: float = setting(
        30.0,
        Mark.OBSERVED,
        "rated moment of each axis; a larger value is not trusted",
        above(0.0),
        unit="N·m",
    )
    answer_timeout_s: float = setting(0.4, Mark.OBSERVED, "timeout of a response", above(0.0), unit="s")
    tries: int = setting(5, Mark.CHOSEN, "attempts per request", at_least(1))
    rest_s: float = setting(
        0.1,
        Mark.OBSERVED,
        "pause between the end of the stream and the first request",
        at_least(0.0),
        unit="s",
    )
    silence_s: float = setting(
        1.0, Mark.CHOSEN, "time without a message after which the stream has failed", above(0.0), unit="s"
    )
    zero_s: float = setting(0.1, Mark.CHOSEN, "averaging time for a zero", between(0.0, 10.0), unit="s")
    urcap_measured: int = setting(
        100, Mark.CHOSEN, "texts of a URCap over which its period is measured at the start", between(10, 1000)
    )

    def __post_init__(self) -> None:
        check_settings(self)
        if self.mode not in ("stream", "modbus"):
            raise SettingError("mode", f"must be stream or modbus, got {self.mode}")
