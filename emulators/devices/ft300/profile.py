"""Settings of an emulated FT 300."""

from dataclasses import dataclass
from typing import Literal

from protocol.marks import Mark, SettingError, above, at_least, between, check_settings, setting


@dataclass(frozen=True, slots=True)
class Ft300Profile:
    """Settings in `[cell.ft300]`."""

    noise_n: float = setting(0.1, Mark.CHOSEN, "noise of the forces, rms", at_least(0.0), unit="N")
    noise_nm: float = setting(0.003, Mark.CHOSEN, "noise of the moments, rms", at_least(0.0), unit="N·m")
    latency_s: float = setting(
        0.010, Mark.ASSUMED, "from a sample to its message", between(0.0, 0.1), unit="s"
    )
    jitter_s: float = setting(
        0.0005, Mark.ASSUMED, "by so much a message may come later", between(0.0, 0.005), unit="s"
    )
    stream_start_s: float = setting(
        0.01, Mark.ASSUMED, "from the answer to the first message", between(0.0, 1.0), unit="s"
    )
    stop_after_ff: int = setting(1, Mark.ASSUMED, "bytes FF that end the stream", between(1, 50))
    power_up: Literal["modbus", "stream"] = setting("modbus", Mark.ASSUMED, "state after power-up")
    modbus_turnaround_s: float = setting(
        0.004, Mark.ASSUMED, "from a question to its answer", between(0.0, 1.0), unit="s"
    )
    frame_timeout_s: float = setting(
        0.05, Mark.ASSUMED, "after so long without a byte a question is forgotten", above(0.0), unit="s"
    )
    fc04: bool = setting(True, Mark.ASSUMED, "whether function 04 reads as 03 does")
    fc06: bool = setting(True, Mark.ASSUMED, "whether function 06 writes the mode as 16 does")
    boot_s: float = setting(0.5, Mark.ASSUMED, "deaf and silent after power-up", between(0.0, 60.0), unit="s")
    version: tuple[int, int, int] = setting(
        (1, 0, 0), Mark.CHOSEN, "numbers of its firmware", between(0, 255)
    )
    serial: int = setting(1234, Mark.CHOSEN, "its number", between(0, 2**32 - 1))
    year: int = setting(2021, Mark.CHOSEN, "year of its production", between(0, 65535))

    def __post_init__(self) -> None:
        check_settings(self)
        if len(self.version) != 3:
            raise SettingError("version", f"must be three numbers, got {len(self.version)}")
        if self.power_up not in ("modbus", "stream"):
            raise SettingError("power_up", f"must be modbus or stream, got {self.power_up}")
