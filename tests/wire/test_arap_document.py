"""The reference page of the computer link matches the code."""

from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
DOCUMENT = (ROOT / "docs" / "reference" / "computer-link.md").read_text(encoding="utf-8")


def test_tables_match_the_specification():
    # Computer-link specification, sections 3 and 4.
    for line in (
        "| 18–19 | `x` | s16 | 1/8000 m | -4.096 … 4.09588 | observed | position X |",
        "| 16 | `flags_16` | u8 |  |  | assumed |",
        "| 12… | `content` | bytes |",
        "| 33 | location register not readable with TCP 20–29 active |",
        "| read status | `10 02 00 08 01 00 13 01 00 00 10 03 18` | `18` |",
        "| stop program | `10 02 00 08 01 00 03 01 00 00 10 03 08` | `08` |",
        "| write mode, operation | `10 02 00 08 01 00 14 01 00 01 10 03 1E` | `1E` |",
        "| `dle_stuffing` | `off` |  | assumed |",
    ):
        assert line in DOCUMENT
