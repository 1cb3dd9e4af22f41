"""Settings of a client about its FT 300."""

from dataclasses import dataclass
from typing import Literal

from protocol.marks import Mark, SettingError, above, at_least, between, check_settings, setting


@dataclass(frozen=True, slots=True)
class Ft300ClientProfile:
    """Settings in `[sensor.ft300]`."""

    mode: Literal["stream", "modbus"] = setting(
        "stream", Mark.CHOSEN, "100 messages a second, or one question after the other, some 60 a second"
    )
    rated_n: float = setting(
        300.0,
        Mark.OBSERVED,
        "rated force of each axis; from there on a value is not trusted",
        above(0.0),
        unit="N",
    )
    rated_nm: float = setting(30.0, Mark.OBSERVED, "rated moment of each axis", above(0.0), unit="N·m")
    answer_timeout_s: float = setting(0.4, Mark.OBSERVED, "wait for an answer", above(0.0), unit="s")
    tries: int = setting(5, Mark.CHOSEN, "times that a question is asked", at_least(1))
    rest_s: float = setting(
        0.1,
        Mark.OBSERVED,
        "pause between the end of the stream and the first question",
        at_least(0.0),
        unit="s",
    )
    silence_s: float = setting(
        1.0, Mark.CHOSEN, "silence of the stream after which the session is over", above(0.0), unit="s"
    )
    zero_s: float = setting(
        0.1, Mark.CHOSEN, "time of which the mean makes a zero", between(0.0, 10.0), unit="s"
    )
    urcap_measured: int = setting(
        100, Mark.CHOSEN, "texts of a URCap by which its period is measured first", between(10, 1000)
    )

    def __post_init__(self) -> None:
        check_settings(self)
        if self.mode not in ("stream", "modbus"):
            raise SettingError("mode", f"must be stream or modbus, got {self.mode}")
