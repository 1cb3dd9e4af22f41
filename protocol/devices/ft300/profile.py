"""Settings of a client about its FT 300."""

from dataclasses import dataclass
from typing import Literal

from protocol.marks import Mark, check_settings, setting


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
        unit="N",
        above=0.0,
    )
    rated_nm: float = setting(30.0, Mark.OBSERVED, "rated moment of each axis", unit="N·m", above=0.0)
    answer_timeout_s: float = setting(0.4, Mark.OBSERVED, "wait for an answer", unit="s", above=0.0)
    tries: int = setting(5, Mark.CHOSEN, "times that a question is asked", minimum=1)
    rest_s: float = setting(
        0.1,
        Mark.OBSERVED,
        "pause between the end of the stream and the first question",
        unit="s",
        minimum=0.0,
    )
    silence_s: float = setting(
        1.0, Mark.CHOSEN, "silence of the stream after which the session is over", unit="s", above=0.0
    )
    zero_s: float = setting(
        0.1, Mark.CHOSEN, "time of which the mean makes a zero", unit="s", minimum=0.0, maximum=10.0
    )

    def __post_init__(self) -> None:
        check_settings(self)
        if self.mode not in ("stream", "modbus"):
            raise ValueError(f"mode must be stream or modbus, got {self.mode}")
