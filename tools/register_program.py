"""Our own robot program that executes the commands of ur_rtde's library, for tests and for the replay of its
sessions.

ur_rtde's own program belongs to its authors. It is used unchanged where the library itself is run.
"""

import re
from pathlib import Path

_TEXT = Path(__file__).with_suffix(".script").read_text(encoding="utf-8")
_RECORDED = re.compile(rb"def rtde_control\(\):\n# float register offset\n(\d{1,2})\nend\n")
_OFFSET = re.compile(rb"# float register offset[^\n]*\n\s*(\d{1,2})\b")


def register_program(offset: int = 0) -> str:
    """Return the program, with its registers starting at an offset of 0 or 24."""
    return _TEXT.replace("OFFSET", str(offset))


def recorded_form(name: bytes, text: bytes) -> bytes:
    """Return the short form that replaces a client's program in a transcript."""
    match = _OFFSET.search(text)
    offset = 24 if match is not None and int(match[1]) == 24 else 0
    return b"def %s():\n# float register offset\n%d\nend\n" % (name, offset)


def played_form(data: bytes) -> bytes:
    """Return data of a transcript for the script port, with our program in place of its short form."""
    return _RECORDED.sub(lambda match: register_program(int(match[1])).encode(), data)
