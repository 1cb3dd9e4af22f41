"""Differences between one S3 computer link and the next, as one profile."""

from dataclasses import dataclass
from typing import Any, ClassVar, Literal, TypeAlias

from protocol.marks import Mark, check_settings, setting

DleStuffing: TypeAlias = Literal["off", "double"]
LengthStyle: TypeAlias = Literal["whole", "data"]

CHUNK = 20
"""Characters that may come at once after as long a silence. Standard: 16 in the FIFO of a 16550A, and four times
that of one until it hands over fewer.
"""


@dataclass(frozen=True)
class LinkProfile:
    """Line, link and telegram settings of one computer link. Raises ValueError for a value out of bounds."""

    __pydantic_config__: ClassVar[dict[str, Any]] = {"extra": "forbid"}

    # --- line
    baudrate: int = setting(9600, Mark.OBSERVED, "line rate", unit="Bd", minimum=300)
    parity: Literal["N", "E", "O"] = setting("E", Mark.OBSERVED, "parity: N none, E even, O odd")
    stop_bits: Literal[1, 2] = setting(1, Mark.OBSERVED, "stop bits a character")
    # --- data link
    dle_stuffing: Literal["off", "double"] = setting(
        "off", Mark.ASSUMED, "whether a DLE inside the telegram travels twice: off, double"
    )
    stx_alternation: Literal["off", "toggle"] = setting(
        "off", Mark.ASSUMED, "whether blocks of a message begin with STX 02 and 82 in turn: off, toggle"
    )
    answer_timeout_s: float = setting(
        2.0, Mark.ASSUMED, "wait for the ACK after the end of an ENQ or of a block", unit="s", above=0.0
    )
    gap_timeout_s: float = setting(
        0.22,
        Mark.STANDARD,
        f"longest silence inside a block, and before an EOT; on a slow line the time of {CHUNK} characters, if longer",
        unit="s",
        above=0.0,
    )
    bid_limit: int = setting(3, Mark.ASSUMED, "ENQ sent for one message before it is given up", minimum=1)
    bid_ahead: bool = setting(
        True,
        Mark.ASSUMED,
        "bid for the next order while it is decided: the controller takes a bid at once behind its EOT and waits for "
        "the block; for the PC",
    )
    repeat_limit: int = setting(3, Mark.ASSUMED, "repeats of one block before it is given up", minimum=0)
    wack_limit: int = setting(
        10, Mark.STANDARD, "WACK taken for one message before it is given up", minimum=0
    )
    collision_winner: Literal["robot", "host"] = setting(
        "robot", Mark.ASSUMED, "who goes first when both sides bid at once: robot, host"
    )
    max_telegram: int = setting(
        128, Mark.ASSUMED, "largest telegram of one block", unit="byte", minimum=60, maximum=65535
    )
    # --- telegrams
    length_style: Literal["whole", "data"] = setting(
        "whole", Mark.OBSERVED, "what the length of a telegram from the PC counts: whole, data (no header)"
    )
    accepted_lengths: Literal["both", "whole", "data"] = setting(
        "both",
        Mark.OBSERVED,
        "which of these a controller understands: both, whole, data; for the emulated one",
    )
    move_length: int = setting(
        52, Mark.DERIVED, "length of a move telegram, header included", unit="byte", minimum=32
    )
    check_flags: bool = setting(
        True,
        Mark.ASSUMED,
        "whether a run goes by bits 0 and 3 of status byte 16, link control and key; off where they tell other things",
    )
    order_timeout_s: float = setting(
        10.0,
        Mark.ASSUMED,
        "wait for the answer telegram after an order was acknowledged",
        unit="s",
        above=0.0,
    )

    def __post_init__(self) -> None:
        check_settings(self)
        if self.move_length > self.max_telegram:
            raise ValueError(
                f"move_length must be at most max_telegram ({self.max_telegram}), got {self.move_length}"
            )

    @property
    def character_time(self) -> float:
        """Time of one character on the line: start bit, 8 data bits, parity, stop bits; seconds."""
        return (1 + 8 + (self.parity != "N") + self.stop_bits) / self.baudrate

    @property
    def gap_time(self) -> float:
        """Silence after which a block is over, s: `gap_timeout_s`, and no less than a port's FIFO makes of a steady
        flow of characters.
        """
        return max(self.gap_timeout_s, CHUNK * self.character_time)
