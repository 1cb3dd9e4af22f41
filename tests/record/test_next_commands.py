"""Commands that terminal and page offer after the end of a run."""

from pathlib import Path

import pytest

from hil_bridge.record.next_commands import RunPlaces
from hil_bridge.runs.outputs import Outputs, run_places
from hil_bridge.settings.configuration import load_config

WHY, REPORT, FREE = "hil-bridge why r.mcap", "hil-bridge report r.mcap", "hil-bridge free cell.toml"
URLS = {"robot.url": "s3+serial:///dev/ttyUSB0", "sensor.url": "jr3+can+socketcan://can0"}
FILE = """
[robot]
url = "s3+serial:///dev/ttyUSB0"
[sensor]
url = "jr3+can+socketcan://can0"
[tool]
mass_kg = 0.5
"""


@pytest.mark.parametrize(
    ("places", "outcome", "moved", "retracted", "expected"),
    [
        (RunPlaces("r.mcap"), "stopped", True, True, [WHY, REPORT]),
        (RunPlaces("r.mcap"), "stopped", True, False, [WHY, REPORT]),
        (RunPlaces("r.mcap", free=("cell.toml",)), "stopped", True, False, [FREE, WHY, REPORT]),
        (RunPlaces("r.mcap", free=("cell.toml",)), "stopped", True, True, [WHY, REPORT]),
        (RunPlaces("r.mcap", free=("cell.toml",)), "stopped", False, None, [WHY]),
        (RunPlaces("r.mcap", free=("cell.toml",)), "gone", True, None, [FREE, WHY, REPORT]),
        (RunPlaces("r.mcap", reports=True), "stopped", True, True, [WHY]),
        (RunPlaces("r.mcap"), "interrupted", True, True, [REPORT]),
        (RunPlaces("r.mcap"), "completed", True, True, [REPORT]),
        (RunPlaces(), "stopped", True, False, []),
    ],
)
def test_next_commands_fit_the_end(
    places: RunPlaces, outcome: str, moved: bool, retracted: bool | None, expected: list[str]
) -> None:
    assert [command for _, command in places.next_commands(outcome, moved, retracted)] == expected


def test_paths_in_commands_are_quoted() -> None:
    assert RunPlaces("my run.mcap").next_commands("completed", True, True)[0].command == (
        "hil-bridge report 'my run.mcap'"
    )


@pytest.mark.parametrize(
    ("overrides", "expected"),
    [
        ({}, ("cell.toml",)),
        (
            {"robot.url": "s3+serial:///dev/ttyS1", "tool.mass_kg": 0.8},
            ("cell.toml", "--robot", "s3+serial:///dev/ttyS1", "--tool-mass-kg", "0.8"),
        ),
        ({"frame.approach": (1.0, 0.0, 0.0), "frame.travel": (0.0, 1.0, 0.0)}, ("CONFIG.toml",)),
    ],
)
def test_free_uses_settings_of_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, overrides: dict[str, object], expected: tuple[str, ...]
) -> None:
    monkeypatch.chdir(tmp_path)
    file = Path("cell.toml")
    file.write_text(FILE)
    places = run_places(load_config(file, overrides), Outputs(Path("r.mcap")), file)
    assert places == RunPlaces("r.mcap", free=expected)


def test_free_is_not_offered_for_emulated_cell() -> None:
    assert run_places(load_config(None, {}), Outputs(Path("r.mcap")), None).free == ()
    assert run_places(load_config(None, URLS), Outputs(), None).free == (
        "--robot",
        URLS["robot.url"],
        "--sensor",
        URLS["sensor.url"],
    )
