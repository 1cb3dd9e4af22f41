"""Settings that differ between S3 computer links, combined in one profile."""

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, ClassVar, Literal, Self, TypeAlias

from protocol.marks import Mark, SettingError, above, at_least, between, check_settings, setting

DleStuffing: TypeAlias = Literal["off", "double"]
LengthStyle: TypeAlias = Literal["whole", "data"]
BlockEnd: TypeAlias = Literal["length", "trailer"]

CHUNK = 20
"""Number of characters that may arrive at once after a silence of the same length. Standard: the FIFO of a 16550A
holds 16 characters, and passes on fewer after four character times.
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
"""Named sets of settings. `observed-client` reproduces the only client whose moves a real S3 is known to have
executed; it bid only when a message was ready. Mark: observed.
"""


@dataclass(frozen=True)
class LinkProfile:
    """Line, link and telegram settings of one computer link. Raises ValueError if a value is out of range."""

    __pydantic_config__: ClassVar[dict[str, Any]] = {"extra": "forbid"}

    profile: str = setting(
        DEFAULT_PROFILE,
        Mark.CHOSEN,
        f"named set of settings, applied together: {', '.join(PROFILES)}",
    )
    # --- line
    baudrate: int = setting(9600, Mark.OBSERVED, "line rate", at_least(300), unit="Bd")
    parity: Literal["N", "E", "O"] = setting("E", Mark.OBSERVED, "parity: N (none), E (even), O (odd)")
    stop_bits: Literal[1, 2] = setting(1, Mark.OBSERVED, "stop bits per character")
    # --- data link
    dle_stuffing: Literal["off", "double"] = setting(
        "off", Mark.ASSUMED, "DLE stuffing, whether a DLE inside the telegram is sent twice: off, double"
    )
    stx_alternation: Literal["off", "toggle", "parity"] = setting(
        "off",
        Mark.ASSUMED,
        "blocks that begin with STX 82; the others begin with 02: off (none), toggle (every "
        "second one of a message), parity (a telegram of odd length, as in the observed client)",
    )
    block_end: Literal["length", "trailer"] = setting(
        "length",
        Mark.CHOSEN,
        "end of a block for a controller without DLE stuffing: length, trailer (the first DLE "
        "ETX, data or not); for the emulated one",
    )
    avoid_trailer: bool = setting(
        True,
        Mark.CHOSEN,
        "change a position or orientation in a move by one step where it would contain DLE ETX, "
        "10 03; no effect with DLE stuffing; for the PC",
    )
    answer_timeout_s: float = setting(
        2.0, Mark.ASSUMED, "timeout of the ACK after the end of an ENQ or of a block", above(0.0), unit="s"
    )
    gap_timeout_s: float = setting(
        0.22,
        Mark.STANDARD,
        f"longest silence inside a block, and before an EOT; on a slow line, the time of {CHUNK} characters if longer",
        above(0.0),
        unit="s",
    )
    bid_limit: int = setting(3, Mark.ASSUMED, "ENQs sent for one message before it fails", at_least(1))
    bid_ahead: bool = setting(
        True,
        Mark.ASSUMED,
        "bid for the next order while it is decided. That the controller accepts a bid right "
        "after its EOT was observed; that it then waits for the block was not; for the PC",
    )
    repeat_limit: int = setting(3, Mark.ASSUMED, "repetitions of one block before it fails", at_least(0))
    wack_limit: int = setting(
        10, Mark.STANDARD, "WACKs accepted for one message before it fails", at_least(0)
    )
    collision_winner: Literal["robot", "host"] = setting(
        "robot", Mark.ASSUMED, "side that takes precedence when both bid at once: robot, host"
    )
    max_telegram: int = setting(
        128, Mark.ASSUMED, "largest telegram in one block", between(60, 65535), unit="byte"
    )
    # --- telegrams
    length_style: Literal["whole", "data"] = setting(
        "whole",
        Mark.OBSERVED,
        "bytes counted by the length of a telegram from the PC: whole, data (without the header)",
    )
    accepted_lengths: Literal["both", "whole", "data"] = setting(
        "both",
        Mark.OBSERVED,
        "lengths that a controller accepts: both, whole, data; for the emulated one",
    )
    move_length: int = setting(
        52, Mark.DERIVED, "length of a move telegram, including the header", at_least(32), unit="byte"
    )
    check_flags: bool = setting(
        True,
        Mark.ASSUMED,
        "a run checks bits 0 and 3 of status byte 16, link control and key; set it to false if "
        "they have other meanings",
    )
    order_timeout_s: float = setting(
        10.0,
        Mark.ASSUMED,
        "timeout of the answer telegram after an order was acknowledged",
        above(0.0),
        unit="s",
    )

    def __post_init__(self) -> None:
        check_settings(self)
        for name, value in settings_of_profile(self.profile).items():
            if (current := getattr(self, name)) != value:
                raise SettingError(
                    name,
                    f"must be {_text(value)} in the profile {self.profile}, got {_text(current)}; leave it or the "
                    "profile out",
                )
        if self.move_length > self.max_telegram:
            raise SettingError(
                "move_length", f"must be at most max_telegram ({self.max_telegram}), got {self.move_length}"
            )

    @classmethod
    def named(cls, profile: str, **changes: Any) -> Self:
        """Create the profile with a given name. `changes` are the values of settings that the name does not fix.
        Raises ValueError.
        """
        return cls(**with_profile({**changes, "profile": profile}))

    @classmethod
    def __get_pydantic_core_schema__(cls, source: Any, handler: Any) -> Any:
        """Return a pydantic schema in which the name of a profile supplies its settings."""
        expand = {"type": "no-info", "function": with_profile}
        return {"type": "function-before", "function": expand, "schema": handler(source)}

    @property
    def avoids_trailer(self) -> bool:
        """Whether a move is changed so that its data does not contain 10 03."""
        return self.avoid_trailer and self.dle_stuffing == "off"

    @property
    def character_time(self) -> float:
        """Transmission time of one character, s: start bit, 8 data bits, parity, stop bits."""
        return (1 + 8 + (self.parity != "N") + self.stop_bits) / self.baudrate

    @property
    def gap_time(self) -> float:
        """Silence after which a block has ended, s: `gap_timeout_s`, but at least the gaps that a port's FIFO
        causes in a steady flow of characters.
        """
        return max(self.gap_timeout_s, CHUNK * self.character_time)


def settings_of_profile(name: str) -> Mapping[str, Any]:
    """Return the settings that a profile fixes. Raises ValueError, which lists the known names, if the name is
    unknown.
    """
    if name not in PROFILES:
        raise SettingError("profile", f"must be one of {', '.join(PROFILES)}, got {name!r}")
    return PROFILES[name]


def with_profile(values: Any) -> Any:
    """Complete a table of settings with the settings of the profile that it names. Values in the table take
    precedence.
    """
    name = values.get("profile") if isinstance(values, Mapping) else None
    if not isinstance(name, str) or name not in PROFILES:
        return values
    return {**PROFILES[name], **values}


def _text(value: object) -> str:
    return str(value).lower() if isinstance(value, bool) else str(value)
