"""The two ports through which a host on an ISA bus reaches the board's memory. Source: JR3 manual 5907E."""

from dataclasses import dataclass
from typing import Any, ClassVar

from protocol.devices.jr3.board import MEMORY_WORDS, WORD_MODULUS, Registers
from protocol.endpoint import RemoteProtocolError
from protocol.marks import Mark, SettingError, between, check_settings, setting

_PAGE = 0x100
"""Words over which the address counts on; it wraps within them, for only its low 8 bits count."""


@dataclass(frozen=True)
class IsaProfile:
    """Where the ports are."""

    __pydantic_config__: ClassVar[dict[str, Any]] = {"extra": "forbid"}

    base: int = setting(
        0x314,
        Mark.OBSERVED,
        "port of the address register; the data register is 2 above",
        between(0, 0xFFFC),
    )

    def __post_init__(self) -> None:
        check_settings(self)
        if self.base % 2:
            raise SettingError("base", f"must be even, got {self.base:#x}")


class IsaPorts:
    """Address register and data register, 16 bits each. Every access to data moves the address on by one.

    Assumed: the bits of an address beyond the memory do not count, and the address can be read back.
    """

    def __init__(self, profile: IsaProfile, registers: Registers) -> None:
        self._address_port, self._data_port = profile.base, profile.base + 2
        self._registers = registers
        self._address = 0

    def read_port(self, port: int, now: float) -> int:
        """A 16-bit input. Raises RemoteProtocolError for a port that is not the board's."""
        if self._is_address(port):
            return self._address
        return self._registers.read(self._next(), 1, now)[0]

    def write_port(self, port: int, value: int, now: float) -> None:
        """A 16-bit output. Raises RemoteProtocolError for a port that is not the board's."""
        if self._is_address(port):
            self._address = value % WORD_MODULUS % MEMORY_WORDS
        else:
            self._registers.write(self._next(), (value,), now)

    def _is_address(self, port: int) -> bool:
        if port not in (self._address_port, self._data_port):
            raise RemoteProtocolError(
                f"port {port:#06x} is not the board's {self._address_port:#06x} or {self._data_port:#06x}"
            )
        return port == self._address_port

    def _next(self) -> int:
        address = self._address
        self._address = address - address % _PAGE + (address + 1) % _PAGE
        return address
