"""A program of ours that goes by the commands of ur_rtde's library, for tests and for the replay of its sessions.

ur_rtde's own text is its authors', and is played as it stands where the library itself is run.
"""

import re
from pathlib import Path

_TEXT = Path(__file__).with_suffix(".script").read_text(encoding="utf-8")
_RECORDED = re.compile(rb"def rtde_control\(\):\n# float register offset\n(\d{1,2})\nend\n")
_OFFSET = re.compile(rb"# float register offset[^\n]*\n\s*(\d{1,2})\b")


def register_program(offset: int = 0) -> str:
    """Return the program, with its registers from an offset on: 0 or 24."""
    return _TEXT.replace("OFFSET", str(offset))


def recorded_form(name: bytes, text: bytes) -> bytes:
    """Return a program that stands in a transcript for that of a client."""
    found = _OFFSET.search(text)
    offset = 24 if found is not None and int(found[1]) == 24 else 0
    return b"def %s():\n# float register offset\n%d\nend\n" % (name, offset)


def played_form(data: bytes) -> bytes:
    """Restore data of a transcript for the script port, with our program in the place of its short form."""
    return _RECORDED.sub(lambda found: register_program(int(found[1])).encode(), data)
