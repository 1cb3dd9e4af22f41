"""Codes in ARAP telegrams and their meanings, all observed.

Source: computer-link specification, section 3.
"""

from enum import IntEnum


class FunctionCode(IntEnum):
    """Function of a telegram. The payloads are known only for 2, 3, 19, 20, 24, 29 and 127."""

    SEND_PROGRAM = 1
    START_PROGRAM = 2
    STOP_PROGRAM = 3
    READ_TCP = 4
    READ_LOCATION = 5
    READ_REGISTER = 6
    READ_SENSOR = 7
    READ_INPUT = 8
    READ_OUTPUT = 9
    READ_CONFIG = 10
    READ_FRAME = 11
    WRITE_TCP = 12
    WRITE_LOCATION = 13
    WRITE_REGISTER = 14
    WRITE_SENSOR = 15
    WRITE_OUTPUT = 16
    WRITE_CONFIG = 17
    WRITE_FRAME = 18
    READ_STATUS = 19
    WRITE_MODE = 20
    READ_PROGRAM_STATUS = 21
    DELETE_PROGRAM = 22
    LOAD_PROGRAM = 23
    """Load a program from disk."""
    MOVE = 24
    ARC_WELD_VALUE = 25
    RECEIVE_PROGRAM = 29
    ARAP_VERSION = 45
    RESOLVER_VALUE = 46
    SPONTANEOUS = 127
    """Unsolicited status or error of the controller."""

    @property
    def text(self) -> str:
        """Name of the function for display."""
        return self.name.lower().replace("_", " ").replace("tcp", "TCP").replace("arap", "ARAP")


class TelegramType(IntEnum):
    """Role of a telegram in an exchange."""

    ORDER = 0x01
    """Order or query from the PC."""
    RESPONSE = 0x02
    SPONTANEOUS = 0x03
    REFUSAL = 0x06
    FURTHER_FROM_PC = 0x09
    """Part of a telegram from the PC; a further block follows."""
    FURTHER_FROM_ROBOT = 0x0A
    """Part of a telegram from the controller; a further block follows."""

    @property
    def text(self) -> str:
        """Name of the type for display."""
        return _TYPE_TEXTS[self]


TYPE_FLAG = 0x10
"""Number that the observed client sometimes added to a type, depending on a variable that it never set. Its effect
is unknown. An emulated controller refuses such an order with code 11 (assumed). Mark: observed.
"""
TYPE_FLAG_TEXT = "with a flag of the observed client, effect unknown"

_TYPE_TEXTS = {
    TelegramType.ORDER: "order",
    TelegramType.RESPONSE: "response",
    TelegramType.SPONTANEOUS: "spontaneous",
    TelegramType.REFUSAL: "refusal",
    TelegramType.FURTHER_FROM_PC: "further block follows, from PC",
    TelegramType.FURTHER_FROM_ROBOT: "further block follows, from S3",
}


class RefusalCode(IntEnum):
    """Reason why the controller refuses an order."""

    UNSPECIFIED_0 = 0
    PROGRAM_RUNNING = 1
    WRONG_SUFFIX = 2
    WRONG_PROGRAM_NUMBER = 3
    WRONG_BLOCK_NUMBER = 4
    WRONG_KEY_MODE = 5
    WRONG_OPERATION_MODE = 6
    NO_SUCH_PROGRAM = 7
    UNSPECIFIED_8 = 8
    BLOCK_TOO_BIG = 9
    NO_SPACE_LEFT = 10
    WRONG_FUNCTION_CODE = 11
    DISC_ERROR = 12
    STOPPED = 13
    UNSPECIFIED_14 = 14
    OUTSIDE_WORK_AREA = 15
    WORK_STOP = 16
    DEPENDENCY_NULL = 17
    NO_WELDING_ROBOT = 18
    CONFIGURATION_CHECKSUM = 30
    NOT_POSSIBLE = 31
    WELDING_DATA_RELEASE = 32
    LOCATION_NOT_READABLE = 33
    NO_MOVE_WITH_TCP = 34
    RESOLVER_NOT_CHANGEABLE = 35
    ANALOG_OUT_OF_RANGE = 36
    TIME_OUT = 99
    TELEGRAM_INCOMPLETE = 255

    @property
    def text(self) -> str:
        """Text of the reason for display."""
        return _REFUSAL_TEXTS.get(self, "unspecified")


_REFUSAL_TEXTS = {
    RefusalCode.PROGRAM_RUNNING: "program running",
    RefusalCode.WRONG_SUFFIX: "wrong function suffix",
    RefusalCode.WRONG_PROGRAM_NUMBER: "wrong program number",
    RefusalCode.WRONG_BLOCK_NUMBER: "wrong block number",
    RefusalCode.WRONG_KEY_MODE: "wrong key mode",
    RefusalCode.WRONG_OPERATION_MODE: "wrong operation mode",
    RefusalCode.NO_SUCH_PROGRAM: "no such program",
    RefusalCode.BLOCK_TOO_BIG: "block too big",
    RefusalCode.NO_SPACE_LEFT: "no space left",
    RefusalCode.WRONG_FUNCTION_CODE: "wrong function code",
    RefusalCode.DISC_ERROR: "floppy disc error",
    RefusalCode.STOPPED: "stop or emergency stop",
    RefusalCode.OUTSIDE_WORK_AREA: "outside the work area, or no start point",
    RefusalCode.WORK_STOP: "work stop",
    RefusalCode.DEPENDENCY_NULL: "dependency is null",
    RefusalCode.NO_WELDING_ROBOT: "no welding robot",
    RefusalCode.CONFIGURATION_CHECKSUM: "configuration checksum",
    RefusalCode.NOT_POSSIBLE: "not possible to proceed",
    RefusalCode.WELDING_DATA_RELEASE: "welding data release",
    RefusalCode.LOCATION_NOT_READABLE: "location register not readable with TCP 20–29 active",
    RefusalCode.NO_MOVE_WITH_TCP: "no move with TCP 20–29 active",
    RefusalCode.RESOLVER_NOT_CHANGEABLE: "resolver data not changeable",
    RefusalCode.ANALOG_OUT_OF_RANGE: "analog output out of range",
    RefusalCode.TIME_OUT: "time-out",
    RefusalCode.TELEGRAM_INCOMPLETE: "telegram incomplete",
}


_REFUSAL_REMEDIES = {
    RefusalCode.PROGRAM_RUNNING: "stop the program first",
    RefusalCode.WRONG_SUFFIX: "this controller supports the order in another form: compare suffix and version",
    RefusalCode.WRONG_PROGRAM_NUMBER: "select a program that is in the controller's memory",
    RefusalCode.WRONG_BLOCK_NUMBER: "send the whole order again; does it allow several blocks?",
    RefusalCode.WRONG_KEY_MODE: (
        "turn the controller's key to AUTO and enable link control at the pendant (TO SC)"
    ),
    RefusalCode.WRONG_OPERATION_MODE: "the controller is in standby: switch it to operation",
    RefusalCode.NO_SUCH_PROGRAM: "select a program that is in the controller's memory",
    RefusalCode.BLOCK_TOO_BIG: "lower the link profile's max_telegram",
    RefusalCode.NO_SPACE_LEFT: "delete programs from the controller's memory",
    RefusalCode.WRONG_FUNCTION_CODE: "this controller does not support the order, or lacks the option for it",
    RefusalCode.DISC_ERROR: "check the disc in the controller's drive",
    RefusalCode.STOPPED: "release the stop at the controller's panel, then start again",
    RefusalCode.OUTSIDE_WORK_AREA: (
        "check the workspace, and whether something has ended the movement in between: a stop, the key, a restart"
    ),
    RefusalCode.WORK_STOP: "release the work stop, then start again",
    RefusalCode.LOCATION_NOT_READABLE: "activate a TCP below 20",
    RefusalCode.NO_MOVE_WITH_TCP: "activate a TCP below 20",
    RefusalCode.ANALOG_OUT_OF_RANGE: "order a value inside the output's range",
    RefusalCode.TELEGRAM_INCOMPLETE: "the telegram is shorter than the controller expects: compare its length",
}


class Mode(IntEnum):
    """Operation mode, used as the suffix of the order write mode."""

    STANDBY = 0
    OPERATION = 1
    SYNCHRONISE = 2
    OPERATION_SYNCHRONISE = 3


class MoveKind(IntEnum):
    """Role of a telegram in a movement sequence, used as the suffix of the order move."""

    POINT = 0
    START = 2
    END = 3


class SpontaneousKind(IntEnum):
    """Kind of an unsolicited telegram, used as its suffix."""

    SYSTEM_ERROR = 7
    VISION_INIT = 9
    VISION_TEST = 10
    OPERATIONAL_ERROR = 17


def function_text(code: int) -> str:
    """Return the name of a function code, which may be unknown."""
    return FunctionCode(code).text if code in _FUNCTIONS else f"unknown function {code}"


def refusal_remedy(code: int) -> str:
    """Return an operator's remedy for a refusal; empty if none is known."""
    return _REFUSAL_REMEDIES.get(RefusalCode(code), "") if code in _REFUSALS else ""


def suffixes_of(function: int) -> dict[int, str]:
    """Return the known suffixes of a function, with their meanings."""
    return dict(_SUFFIXES.get(function, {}))


def type_text(code: int) -> str:
    """Return the name of a telegram type, which may be unknown."""
    if code in _TYPES:
        return TelegramType(code).text
    if (plain := plain_type(code)) in _TYPES:
        return f"{TelegramType(plain).text} {TYPE_FLAG_TEXT}"
    return f"unknown type {code:02X}"


def plain_type(code: int) -> int:
    """Return the type of a telegram from the PC without `TYPE_FLAG`. Other types are returned unchanged."""
    return code & ~TYPE_FLAG if code in _FLAGGED else code


def refusal_text(code: int) -> str:
    """Return the text of a refusal code, which may be unknown."""
    return RefusalCode(code).text if code in _REFUSALS else f"unknown refusal code {code}"


_FUNCTIONS = frozenset(FunctionCode)
_TYPES = frozenset(TelegramType)
_FLAGGED = frozenset(code | TYPE_FLAG for code in (TelegramType.ORDER, TelegramType.FURTHER_FROM_PC))
_REFUSALS = frozenset(RefusalCode)

_STARTS = {0: "from the start", 1: "continue"}
_SUFFIXES: dict[int, dict[int, str]] = {
    FunctionCode.START_PROGRAM: _STARTS,
    **{
        function: {int(item): item.name.lower().replace("_", " ") for item in kinds}
        for function, kinds in (
            (FunctionCode.WRITE_MODE, Mode),
            (FunctionCode.MOVE, MoveKind),
            (FunctionCode.SPONTANEOUS, SpontaneousKind),
        )
    },
}


def suffix_text(function: int, suffix: int) -> str:
    """Return the meaning of a function suffix; empty if it is unknown."""
    return _SUFFIXES.get(function, {}).get(suffix, "")
