"""Page of robots and sensors: every kind has its evidence, and each witness is on the page of fidelity."""

from pathlib import Path

import pytest

from hil_bridge.devices.kinds import ROBOTS, SENSORS
from hil_bridge.settings.configuration import with_all_kinds
from protocol.marks import Mark
from tools.known_devices import EVIDENCE, count_marks, known_devices

DOCS = Path(__file__).resolve().parents[2] / "docs"
FIDELITY = (DOCS / "explanation" / "fidelity.md").read_text(encoding="utf-8")


def test_every_built_in_kind_has_evidence() -> None:
    assert set(EVIDENCE) == {*ROBOTS.own, *SENSORS.own}


@pytest.mark.parametrize("kind", EVIDENCE)
def test_each_witness_and_page_exists(kind: str) -> None:
    evidence = EVIDENCE[kind]
    assert evidence.witnesses
    assert [name for name in evidence.witnesses if name not in FIDELITY] == []
    assert (DOCS / "reference" / f"{evidence.page}.md").is_file()


def test_device_marks_are_counted_from_settings() -> None:
    marks = count_marks(with_all_kinds(), "ft300")
    assert marks[Mark.ASSUMED] > marks[Mark.OBSERVED] > 0
    row = next(line for line in known_devices().splitlines() if line.startswith("| `ft300`, `ft300-urcap` |"))
    assert [int(cell) for cell in row.split("|")[2:-1]] == [
        marks[mark] for mark in (Mark.OBSERVED, Mark.DERIVED, Mark.STANDARD, Mark.ASSUMED, Mark.CHOSEN)
    ]
