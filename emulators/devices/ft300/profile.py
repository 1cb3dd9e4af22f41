"""Settings of an emulated FT 300."""

from dataclasses import dataclass
from typing import Literal

from protocol.marks import Mark, check_settings, setting


@dataclass(frozen=True, slots=True)
class Ft300Profile:
    """Settings in `[cell.ft300]`."""

    noise_n: float = setting(0.1, Mark.CHOSEN, "noise of the forces, rms", unit="N", minimum=0.0)
    noise_nm: float = setting(0.003, Mark.CHOSEN, "noise of the moments, rms", unit="N·m", minimum=0.0)
    latency_s: float = setting(
        0.010, Mark.ASSUMED, "from a sample to its message", unit="s", minimum=0.0, maximum=0.1
    )
    jitter_s: float = setting(
        0.0005, Mark.ASSUMED, "by so much a message may come later", unit="s", minimum=0.0, maximum=0.005
    )
    stream_start_s: float = setting(
        0.01, Mark.ASSUMED, "from the answer to the first message", unit="s", minimum=0.0, maximum=1.0
    )
    stop_after_ff: int = setting(1, Mark.ASSUMED, "bytes FF that end the stream", minimum=1, maximum=50)
    power_up: Literal["modbus", "stream"] = setting("modbus", Mark.ASSUMED, "state after power-up")
    modbus_turnaround_s: float = setting(
        0.004, Mark.ASSUMED, "from a question to its answer", unit="s", minimum=0.0, maximum=1.0
    )
    frame_timeout_s: float = setting(
        0.05, Mark.ASSUMED, "after so long without a byte a question is forgotten", unit="s", above=0.0
    )
    fc04: bool = setting(True, Mark.ASSUMED, "whether function 04 reads as 03 does")
    fc06: bool = setting(True, Mark.ASSUMED, "whether function 06 writes the mode as 16 does")
    boot_s: float = setting(
        0.5, Mark.ASSUMED, "deaf and silent after power-up", unit="s", minimum=0.0, maximum=60.0
    )
    version: tuple[int, int, int] = setting(
        (1, 0, 0), Mark.CHOSEN, "numbers of its firmware", minimum=0, maximum=255
    )
    serial: int = setting(1234, Mark.CHOSEN, "its number", minimum=0, maximum=2**32 - 1)
    year: int = setting(2021, Mark.CHOSEN, "year of its production", minimum=0, maximum=65535)

    def __post_init__(self) -> None:
        check_settings(self)
        if len(self.version) != 3:
            raise ValueError(f"version must be three numbers, got {len(self.version)}")
        if self.power_up not in ("modbus", "stream"):
            raise ValueError(f"power_up must be modbus or stream, got {self.power_up}")
