"""Progress of many runs if standard error is not a terminal: a line per minute, with rate and remaining time."""

import pytest

from hil_bridge.console import progress


def test_progress_log_has_one_line_per_minute(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    now = 1000.0
    monkeypatch.setattr(progress.time, "monotonic", lambda: now)
    with progress.run_progress(300) as advance:
        for second in range(1, 131):
            now = 1000.0 + second
            advance(1, int(second == 70))
    lines = capsys.readouterr().err.splitlines()
    assert lines == [
        "60 of 300 runs, 1.0 runs/s, 4 min left",
        "120 of 300 runs, 1.0 runs/s, 3 min left, 1 failed",
    ]
