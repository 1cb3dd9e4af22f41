"""`hil-bridge config explain` and `list conditions` from the command line."""

from pathlib import Path

from click.testing import CliRunner

from hil_bridge.cli import cli
from hil_bridge.site.guard.conditions import as_text


def answer(*arguments: str) -> list[str]:
    result = CliRunner().invoke(cli, arguments)
    assert (result.exit_code, result.exception) == (0, None)
    return result.output.splitlines()


def test_table_prints_every_condition() -> None:
    assert answer("list", "conditions") == list(as_text())


def test_explain_prints_verdict_cause_setting_and_reaction() -> None:
    lines = answer("config", "explain", "--force", "120", "--age-ms", "30")
    assert lines[:9] == [
        "verdict        stop: force",
        "because        contact force 120.0 N is beyond 50 N",
        "decided by     limits.force_limit_n = 50",
        "then           the tool retracts, now to 0 mm; the run ends when it is back",
        "leads to       retracts and ends, exit code 3",
        "check          the force before the stop in the report: a jump in one frame is the sensor, a ramp a contact",
        "force          120 N, stops beyond 50 N: 70 too much",
        "resultant      120 N, stops beyond 100 N: 20 too much",
        "age            30 ms, stops beyond 200 ms: 170 left",
    ]


def test_explain_uses_configuration(tmp_path: Path) -> None:
    config = tmp_path / "site.toml"
    config.write_text("[limits]\nforce_limit_n = 150.0\nresultant_limit_n = 110.0\n")
    lines = answer("config", "explain", str(config), "--force", "120")
    assert lines[0] == "verdict        stop: resultant-force"
    assert lines[2] == "decided by     limits.resultant_limit_n = 110"


def test_explain_accepts_every_option() -> None:
    lines = answer(
        *("config", "explain", "--phase", "retract", "--force", "0", "--resultant", "30", "--lowest", "12"),
        *("--retracting-ms", "300"),
        *("--from-air", "--commanded-mm", "1", "--start-m", "0.9", "0", "0.5"),
    )
    assert lines[:5] == [
        "verdict        stop: retract-rise",
        "because        the force rose from 12.0 N to 30.0 N while the tool retracted",
        "decided by     limits.retract_rise_n = 5",
        "then           the tool stops at 1 mm; the run ends",
        "leads to       stands still and ends, exit code 3",
    ]
    lines = answer("config", "explain", "--saturated", "--fault", "", "--dead-axis", "Fz", "--gap-ms", "1")
    assert lines[0] == "verdict        stop: saturated"
    assert "decided by     no setting" in lines
