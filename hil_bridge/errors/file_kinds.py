"""Files of this trade by their first bytes: what each is, and where it goes. Readers ask when they refuse a file."""

import codecs
import re

from hil_bridge.errors import ConfigError

HEAD_BYTES = 4096
"""Bytes that are looked at. Chosen: behind the licence that a file may begin with."""

_BINARY = (
    (
        rb"\x89MCAP0\r\n.{,64}hil-bridge",
        "a recording of a run; `hil-bridge view`, `report`, `why` and `replay` read it",
    ),
    (
        rb"\x89MCAP0\r\n",
        "an MCAP file of another program; `hil-bridge report`, `view`, `compare` and `identify fidelity` read one of "
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
    (rb"PK\x03\x04", "a ZIP archive, as .xlsx is one; unpack it, or save the sheet as CSV"),
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
        "a robot description (URDF); none is read here: a kind of robot has its sizes, and `hil-bridge config init` "
        "writes its settings",
    ),
    (
        rb"<FTSensor\b",
        "a calibration of an ATI sensor; the sensor's box applies it, and `factor` in a mapping of "
        "`hil-bridge identify fidelity` takes the size of one count",
    ),
)
CANDUMP = (
    rb"(?:\([^()\r\n]{1,40}\)\s+)?[A-Za-z][\w.-]*\s+(?:[RT]X\s+[B-]\s[E-]\s+)?[0-9A-F]{3,8}(?:#|\s+\[\d)"
)
"""Begin of a line of candump, of its console or of `candump -l`."""
_TEXT = (
    (CANDUMP, "a log of candump; `hil-bridge monitor FILE` and `hil-bridge decode KIND LINE` read it"),
    (
        rb"&ACCESS\b|(?:GLOBAL )?DEF(?:DAT|FCT)?\s[\w ]+\(|DEFDAT\s",
        "a KUKA program (KRL); it runs on the controller, and a run joins it by --robot rsi+udp-bind://ADDRESS:PORT",
    ),
    (
        rb"(?i:(?:VERSION:\d+\s+LANGUAGE:\w+\s+%%%\s+)?(?:SYS)?MODULE\s+\w+)",
        "an ABB program module (RAPID); it runs on the controller, and a run joins it by --robot "
        "egm+udp-bind://ADDRESS:PORT",
    ),
    (
        rb"(?:def|sec)\s+\w+\s*\([^()\r\n]*\)\s*:",
        "a URScript program; an emulated UR takes it on port 30002, or from the folder cell.rtde.program_folder",
    ),
)
_SKIPPED_XML = re.compile(rb"\s+|<\?.*?\?>|<!--.*?-->", re.DOTALL)
_SKIPPED_TEXT = re.compile(rb"(?:\s+|[#;!%][^\n]*\n)*")

_NUMBER = rb'"?[-+]?\d[\d.eE+-]*"?'
_TABLE = re.compile(rb"(?!\[)(?:[^=\r\n]*\r?\n){0,8}? *%b(?: *[;,\t] *%b)+ *\r?\n" % (_NUMBER, _NUMBER))
"""Some lines that assign nothing, then one of numbers."""


def describe_content(head: bytes) -> str:
    """Describe a file with these first bytes, and what to do with it; empty if it is unknown."""
    head = _decoded(head[:HEAD_BYTES])
    at = 0
    while head.lstrip().startswith(b"<") and (skipped := _SKIPPED_XML.match(head, at)):
        at = skipped.end()
    text = head[_SKIPPED_TEXT.match(head).end() :]  # type: ignore[union-attr]  # it matches nothing, too
    for table, data in ((_BINARY, head), (_XML, head[at:]), (_TEXT, text)):
        for pattern, what in table:
            if re.match(pattern, data, re.DOTALL):
                return what
    return ""


def _decoded(head: bytes) -> bytes:
    """Decode the first bytes of a text without its byte-order mark; characters of UTF-16 as those of ASCII."""
    if head.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        head = head[2:].replace(b"\0", b"")
    return head.removeprefix(codecs.BOM_UTF8)


def refuse_known(name: str, head: bytes) -> None:
    """Raise ConfigError for a file that is known, and that its reader refuses. `name` names it."""
    if what := describe_content(head):
        raise ConfigError(f"{name} is {what}")


def refuse_table(name: str, head: bytes) -> None:
    """Raise ConfigError for a table of text at a reader that takes none. `name` names it."""
    refuse_known(name, head)
    if _TABLE.match(_decoded(head[:HEAD_BYTES])):
        raise ConfigError(
            f"{name} is a table of text; `hil-bridge identify fidelity` and `identify cell` read one with "
            "--columns MAPPING.toml"
        )
