"""Detection of common robotics file types by their first bytes, with advice, for readers that refuse such a file."""

import codecs
import re

from hil_bridge.errors import ConfigError

HEAD_BYTES = 4096
"""Number of bytes that are checked. Chosen: extends past the licence text at the start of a file."""

_BINARY = (
    (
        rb"\x89MCAP0\r\n.{,64}hil-bridge",
        "a recording of a run; `hil-bridge view`, `report`, `why` and `replay` read it",
    ),
    (
        rb"\x89MCAP0\r\n",
        "an MCAP file of another program; `hil-bridge report`, `view`, `compare` and `identify fidelity` read those of "
        "ROS 2",
    ),
    (
        rb"#ROSBAG V",
        "a bag of ROS 1; `rosbags-convert --src FILE --dst FOLDER` makes one of ROS 2, which `hil-bridge report`, "
        "`view`, `compare` and `identify fidelity` read",
    ),
    (
        rb"SQLite format 3\0",
        "an SQLite database; `hil-bridge view` shows results of a campaign (.sqlite) and bags of ROS 2 (.db3)",
    ),
    (rb"PK\x03\x04", "a ZIP archive, such as .xlsx; unpack it, or save the sheet as CSV"),
    (
        rb"\x89HDF\r\n|MATLAB \d|PAR1|MDF     ",
        "a binary table (HDF5, MATLAB, Parquet or MDF); write it as CSV for `hil-bridge identify fidelity` and "
        "`identify cell`",
    ),
    (
        rb"LOGG",
        "a CAN log in BLF; `can_logconvert FILE FILE.log` makes lines of candump for `hil-bridge monitor`",
    ),
)
_XML = (
    (
        rb"<ROOT\b.*<SENTYPE\b",
        "KUKA's Ethernet configuration of RSI; `hil-bridge doctor CONFIG.toml FILE` compares it with a configuration",
    ),
    (
        rb"<rSIModel\b",
        "a signal flow of KUKA's RSI; it stays on the controller, and its limits go into [robot.rsi]",
    ),
    (
        rb"<robot\b",
        "a robot description (URDF), which is not used: each kind of robot has its dimensions, and "
        "`hil-bridge config init` writes its settings",
    ),
    (
        rb"<FTSensor\b",
        "a calibration of an ATI sensor; the sensor's box applies it, and `factor` in a mapping of "
        "`hil-bridge identify fidelity` is the size of one count",
    ),
)
CANDUMP = (
    rb"(?:\([^()\r\n]{1,40}\)\s+)?[A-Za-z][\w.-]*\s+(?:[RT]X\s+[B-]\s[E-]\s+)?[0-9A-F]{3,8}(?:#|\s+\[\d)"
)
"""Pattern for the start of a candump line, in console format or in the format of `candump -l`."""
_TEXT = (
    (CANDUMP, "a log of candump; `hil-bridge monitor FILE` and `hil-bridge decode KIND LINE` read it"),
    (
        rb"&ACCESS\b|(?:GLOBAL )?DEF(?:DAT|FCT)?\s[\w ]+\(|DEFDAT\s",
        "a KUKA program (KRL); it runs on the controller; connect to it with --robot rsi+udp-bind://ADDRESS:PORT",
    ),
    (
        rb"(?i:(?:VERSION:\d+\s+LANGUAGE:\w+\s+%%%\s+)?(?:SYS)?MODULE\s+\w+)",
        "an ABB program module (RAPID); it runs on the controller; connect to it with --robot "
        "egm+udp-bind://ADDRESS:PORT",
    ),
    (
        rb"(?:def|sec)\s+\w+\s*\([^()\r\n]*\)\s*:",
        "a URScript program; an emulated UR accepts it on port 30002, or from the folder cell.rtde.program_folder",
    ),
)
_SKIPPED_XML = re.compile(rb"\s+|<\?.*?\?>|<!--.*?-->", re.DOTALL)
_SKIPPED_TEXT = re.compile(rb"(?:\s+|[#;!%][^\n]*\n)*")

_NUMBER = rb'"?[-+]?\d[\d.eE+-]*"?'
_TABLE = re.compile(rb"(?!\[)(?:[^=\r\n]*\r?\n){0,8}? *%b(?: *[;,\t] *%b)+ *\r?\n" % (_NUMBER, _NUMBER))
"""Pattern for lines without an assignment, followed by a line of numbers."""


def describe_content(head: bytes) -> str:
    """Return a description of a file from its first bytes, with advice; empty if the type is unknown."""
    head = _decode(head[:HEAD_BYTES])
    at = 0
    while head.lstrip().startswith(b"<") and (skipped := _SKIPPED_XML.match(head, at)):
        at = skipped.end()
    text = head[_SKIPPED_TEXT.match(head).end() :]  # type: ignore[union-attr]  # it matches nothing, too
    for table, data in ((_BINARY, head), (_XML, head[at:]), (_TEXT, text)):
        for pattern, what in table:
            if re.match(pattern, data, re.DOTALL):
                return what
    return ""


def _decode(head: bytes) -> bytes:
    """Return the first bytes of a text without a byte-order mark, and with UTF-16 reduced to ASCII."""
    if head.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        head = head[2:].replace(b"\0", b"")
    return head.removeprefix(codecs.BOM_UTF8)


def refuse_known(name: str, head: bytes) -> None:
    """Raise ConfigError for a file of a known type. `name` is the name of the file in the message."""
    if what := describe_content(head):
        raise ConfigError(f"{name} is {what}")


def refuse_table(name: str, head: bytes) -> None:
    """Raise ConfigError for a text table, or a file of a known type. `name` is the name of the file in the message."""
    refuse_known(name, head)
    if _TABLE.match(_decode(head[:HEAD_BYTES])):
        raise ConfigError(
            f"{name} is a text table; `hil-bridge identify fidelity` and `identify cell` read it with "
            "--columns MAPPING.toml"
        )
