"""Differences between one S3 computer link and the next, as one profile."""

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, ClassVar, Literal, Self, TypeAlias

from protocol.marks import Mark, SettingError, above, at_least, between, check_settings, setting

DleStuffing: TypeAlias = Literal["off", "double"]
LengthStyle: TypeAlias = Literal["whole", "data"]
BlockEnd: TypeAlias = Literal["length", "trailer"]

CHUNK = 20
"""Characters that may come at once after as long a silence. Standard: 16 in the FIFO of a 16550A, and four times
that of one until it hands over fewer.
"""
DEFAULT_PROFILE, OBSERVED_CLIENT = "default", "observed-client"
PROFILES: Mapping[str, Mapping[str, Any]] = MappingProxyType(
    {
        DEFAULT_PROFILE: MappingProxyType({}),
        OBSERVED_CLIENT: MappingProxyType(
            {
                "dle_stuffing": "off",
                "stx_alternation": "parity",
                "bid_ahead": False,
                "length_style": "data",
                "move_length": 60,
            }
        ),
    }
)
"""Named sets of settings. `observed-client` is how the one client spoke whose moves a real S3 is known to have obeyed:
it bid when a message was there, never before. Mark: observed.
"""


@dataclass(frozen=True)
class LinkProfile:
    """Line, link and telegram settings of one computer link. Raises ValueError for a value out of bounds."""

    __pydantic_config__: ClassVar[dict[str, Any]] = {"extra": "forbid"}

    profile: str = setting(
        DEFAULT_PROFILE,
        Mark.CHOSEN,
        f"named set of settings, which holds as a whole: {', '.join(PROFILES)}",
    )
    # --- line
    baudrate: int = setting(9600, Mark.OBSERVED, "line rate", at_least(300), unit="Bd")
    parity: Literal["N", "E", "O"] = setting("E", Mark.OBSERVED, "parity: N none, E even, O odd")
    stop_bits: Literal[1, 2] = setting(1, Mark.OBSERVED, "stop bits a character")
    # --- data link
    dle_stuffing: Literal["off", "double"] = setting(
        "off", Mark.ASSUMED, "whether a DLE inside the telegram travels twice: off, double"
    )
    stx_alternation: Literal["off", "toggle", "parity"] = setting(
        "off",
        Mark.ASSUMED,
        "which blocks begin with STX 82, the others with 02: off (none), toggle (every second one of a message), "
        "parity (a telegram of odd length, as of the observed client)",
    )
    block_end: Literal["length", "trailer"] = setting(
        "length",
        Mark.CHOSEN,
        "how a controller that takes DLE once finds a block's end: length, trailer (the first DLE ETX, data or not); "
        "for the emulated one",
    )
    avoid_trailer: bool = setting(
        True,
        Mark.CHOSEN,
        "give way by one step where a place or orientation in a move would hold DLE ETX, 10 03; without effect while "
        "DLE travels twice; for the PC",
    )
    answer_timeout_s: float = setting(
        2.0, Mark.ASSUMED, "wait for the ACK after the end of an ENQ or of a block", above(0.0), unit="s"
    )
    gap_timeout_s: float = setting(
        0.22,
        Mark.STANDARD,
        f"longest silence inside a block, and before an EOT; on a slow line the time of {CHUNK} characters, if longer",
        above(0.0),
        unit="s",
    )
    bid_limit: int = setting(3, Mark.ASSUMED, "ENQ sent for one message before it is given up", at_least(1))
    bid_ahead: bool = setting(
        True,
        Mark.ASSUMED,
        "bid for the next order while it is decided: that the controller takes a bid at once behind its EOT was "
        "observed, that it then waits for the block was not; for the PC",
    )
    repeat_limit: int = setting(3, Mark.ASSUMED, "repeats of one block before it is given up", at_least(0))
    wack_limit: int = setting(
        10, Mark.STANDARD, "WACK taken for one message before it is given up", at_least(0)
    )
    collision_winner: Literal["robot", "host"] = setting(
        "robot", Mark.ASSUMED, "side that goes first when both bid at once: robot, host"
    )
    max_telegram: int = setting(
        128, Mark.ASSUMED, "largest telegram of one block", between(60, 65535), unit="byte"
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
        52, Mark.DERIVED, "length of a move telegram, header included", at_least(32), unit="byte"
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
        above(0.0),
        unit="s",
    )

    def __post_init__(self) -> None:
        check_settings(self)
        for name, value in settings_of_profile(self.profile).items():
            if (given := getattr(self, name)) != value:
                raise SettingError(
                    name,
                    f"must be {_text(value)} in the profile {self.profile}, got {_text(given)}; leave it or the "
                    "profile out",
                )
        if self.move_length > self.max_telegram:
            raise SettingError(
                "move_length", f"must be at most max_telegram ({self.max_telegram}), got {self.move_length}"
            )

    @classmethod
    def named(cls, profile: str, **changes: Any) -> Self:
        """Return the profile of this name, with settings that it leaves open. Raises ValueError."""
        return cls(**with_profile({**changes, "profile": profile}))

    @classmethod
    def __get_pydantic_core_schema__(cls, source: Any, handler: Any) -> Any:
        """As of any dataclass, but that a profile's name stands for its settings."""
        expand = {"type": "no-info", "function": with_profile}
        return {"type": "function-before", "function": expand, "schema": handler(source)}

    @property
    def avoids_trailer(self) -> bool:
        """Whether a move gives way so that no 10 03 stands in its data."""
        return self.avoid_trailer and self.dle_stuffing == "off"

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


def settings_of_profile(name: str) -> Mapping[str, Any]:
    """Return the settings that a profile fixes. Raises ValueError with the known names."""
    if name not in PROFILES:
        raise SettingError("profile", f"must be one of {', '.join(PROFILES)}, got {name!r}")
    return PROFILES[name]


def with_profile(values: Any) -> Any:
    """Complete a table of settings from the profile that it names; its own values take precedence."""
    name = values.get("profile") if isinstance(values, Mapping) else None
    if not isinstance(name, str) or name not in PROFILES:
        return values
    return {**PROFILES[name], **values}


def _text(value: object) -> str:
    return str(value).lower() if isinstance(value, bool) else str(value)
