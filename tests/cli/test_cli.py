"""The command line in this process: help, refusals, settings, and commands other than a run."""

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import click
import pytest
from click.shell_completion import ShellComplete

from hil_bridge.cli import HELP_SECTIONS, MOVED, cli
from hil_bridge.runs.serve import client_of
from protocol.marks import Mark
from tests.command_line import VIRTUAL, Command, refused

STATUS_ORDER = "10 02 00 08 01 00 13 01 00 00 10 03"

TITLES = {"Commands", *HELP_SECTIONS}
"""Titles of command lists in a help text."""


def test_help_does_not_import_heavy_libraries() -> None:
    program = (
        "import sys, hil_bridge.cli\nsys.argv = ['hil-bridge', '--help']\n"
        "try: hil_bridge.cli.main()\n"
        "except SystemExit: pass\n"
        "print([n for n in ('numpy', 'scipy', 'matplotlib', 'rich', 'can', 'serial', 'pydantic', 'mcap', 'asyncio')"
        " if n in sys.modules], file=sys.stderr)"
    )
    process = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert "Exit codes" in process.stdout
    assert process.stderr == "[]\n"


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ([*VIRTUAL, "--duration", "0"], "--duration: must be greater than 0, got 0.0"),
        ([*VIRTUAL, "--duration", "-1"], "--duration: must be greater than 0, got -1.0"),
        ([*VIRTUAL, "--duration", "inf"], "--duration: must be a finite number"),
        ([*VIRTUAL, "--duration", "soon"], "'soon' is not a valid float; see `hil-bridge run --help`"),
        ([*VIRTUAL, "--force-n", "-3"], "--force-n must be a number above 0, got -3.0"),
        ([*VIRTUAL, "--force-n", "nan"], "--force-n must be a number above 0, got nan"),
        ([*VIRTUAL, "--force-n", "1000"], "must be below limits.force_limit_n of 50 N"),
        ([*VIRTUAL, "--seed", "-1"], "--seed: must be greater than or equal to 0"),
        (
            [*VIRTUAL, "--controller", "pid"],
            "--controller: there is no controller 'pid'; choose one of fuzzy, ",
        ),
        ([*VIRTUAL, "--robot", "s3+tcp://h:1"], "leave it out to use real ports"),
        ([*VIRTUAL, "--bogus"], "No such option"),
        ([*VIRTUAL, "--record", "."], "it is a folder; name a file in it"),
        ([*VIRTUAL, "--summary", "file/s.json"], "cannot make the folder file"),
        ([*VIRTUAL, "--report", "file"], "cannot make the folder file"),
        (["run", "--robot", ""], "it is empty; leave the option out"),
        (["run", "--robot", "s3+tcp://h:1"], "give --sensor (sensor.url) too"),
        (
            ["run", "--unchecked", "--robot", "s3+foo:", "--sensor", "jr3+can+slcan:///dev/x"],
            "'s3+foo:': unknown scheme 'foo'; allowed: serial, tcp, rfc2217, memory; for example s3+serial:///dev/tty",
        ),
        (  # before the robot, which is not there, is connected
            ["run", "--unchecked", "--robot", "rtde+tcp://127.0.0.1:1", "--sensor", "netft+nonsense://x"],
            "'netft+nonsense://x': unknown scheme 'nonsense'; allowed: udp, udp+memory; for example netft+udp://127",
        ),
        (
            ["run", "--unchecked", "--robot", "s3+serial://", "--sensor", "jr3+can+slcan:///dev/x"],
            "the target is missing; for example",
        ),
        (
            [
                "run",
                "--unchecked",
                "--robot",
                "s3+serial:///dev/x?parity=X",
                "--sensor",
                "jr3+can+slcan:///dev/x",
            ],
            "parity must be one of N, E, O, got 'X'",
        ),
        (
            [
                "run",
                "--unchecked",
                "--robot",
                "s3+serial:///dev/x?speed=1",
                "--sensor",
                "jr3+can+slcan:///dev/x",
            ],
            "unknown option 'speed'; allowed: baudrate",
        ),
        (
            ["run", "--unchecked", "--sensor", "jr3+tcp://h:1"],
            "a CAN gateway has no such wire; did you mean jr3-board+tcp://h:1",
        ),
        (["run", "--link-profile", "x"], "--link-profile must be one of default, observed-client, got 'x'"),
        (
            ["emulate", "robot", "--link-profile", "x"],
            "--link-profile must be one of default, observed-client",
        ),
        (
            ["emulate", "cell", "--robot-port", "s3+foo:"],
            "'s3+foo:': unknown scheme 'foo'; allowed: pty, tcp-listen",
        ),
        (["emulate", "cell", "--sensor-port", "jr3+can+foo:"], "unknown scheme 'can+foo'; allowed: can+"),
        (
            ["emulate", "robot", "--robot-port", "s3+tcp-listen://h"],
            "host and port must be such as 127.0.0.1:4000",
        ),
        (["emulate", "robot", "--sensor", "netft"], "No such option '--sensor'"),
        (["emulate", "sensor", "--robot", "egm"], "No such option '--robot'"),
        (
            ["emulate", "robot", "--robot", "egm", "--link-profile", "default"],
            "--link-profile applies only to the computer link of an s3, and the robot is egm",
        ),
        (
            ["run", "--virtual", "--robot", "egm", "--link-profile", "default"],
            "--link-profile applies only to the computer link of an s3, and the robot is egm",
        ),
        (["emulate", "robot", "--panel", "tcp-listen://0.0.0.0:1"], "listens on this computer only"),
        (["emulate", "robot", "--panel", "tcp://127.0.0.1:1"], "unknown scheme 'tcp'; allowed: tcp-listen"),
        (["emulate", "arm"], "No such command 'arm'; see `hil-bridge emulate --help`"),
        (["report", "none.mcap"], "cannot read the recording none.mcap: No such file"),
        (["report", "file"], "file is not an MCAP file"),
        (["report", "."], "is not a ROS 2 bag: no file in it ends in .mcap or .db3"),
        (["report", "r.mcap", "--out", "x"], "--out is -o or --output now: write -o x"),
        (["list", "facts", "file"], "file is not valid TOML"),
        (["config", "init", "file"], "file already exists"),
        (["config", "init", "none/c.toml"], "cannot write none/c.toml: no such folder"),
        (["decode"], "Missing command; see `hil-bridge decode --help`"),
        (["decode", "computer-link", ""], "nothing to decode"),
        (["decode", "computer-link", "10", "0"], "3 digits are not complete bytes"),
        (["decode", "computer-link", "1g"], "'g' at digit 2 is not a hexadecimal digit"),
        (["decode", "jr3-can", "201"], "a # between identifier and data is missing"),
        (["decode", "jr3-can", "xyz#00"], "'x' is not a hexadecimal digit"),
        (
            ["run", "--surface", "mujoco", "--virtual"],
            "there is no surface 'mujoco'; choose one of soft-body",
        ),
        (["bogus"], "No such command 'bogus'; see `hil-bridge --help`"),
    ],
)
def test_invalid_input_is_one_line_with_remedy(
    hil: Command, tmp_path: Path, arguments: list[str], message: str
) -> None:
    (tmp_path / "file").write_text("no TOML, no recording")
    assert message in refused(hil(*arguments))


@pytest.mark.parametrize(
    ("robot", "message"),
    [
        ("s3+serial:///dev/there-is-none", "cannot be opened: there is no such port; check the cable"),
        ("s3+tcp://127.0.0.1:1", "no program listens there; start the other side first"),
    ],
)
def test_unavailable_wire_is_device_error(hil: Command, robot: str, message: str) -> None:
    code, _, errors = hil(
        *("run", "--unchecked", "--no-view", "--robot", robot, "--sensor", "jr3+can+slcan:///dev/none"),
        *("--record", "r.mcap"),
    )
    assert (code, errors.count("\n")) == (3, 1)
    assert robot.removeprefix("s3+") in errors
    assert message in errors
    assert Path("r.mcap").stat().st_size


def test_port_without_permission_names_group(hil: Command, monkeypatch: pytest.MonkeyPatch) -> None:
    opened = os.open

    def forbidden(path: str, *arguments: int, **options: int) -> int:
        if path == "/dev/ttyFORBIDDEN":
            raise PermissionError(13, "Permission denied", path)
        return opened(path, *arguments, **options)

    monkeypatch.setattr(os, "open", forbidden)
    code, _, errors = hil(
        *("run", "--unchecked", "--no-view"),
        *("--robot", "s3+serial:///dev/ttyFORBIDDEN", "--sensor", "jr3+can+slcan:///dev/none"),
    )
    assert (code, errors.count("\n")) == (3, 1)
    assert "no permission; add yourself to the group dialout" in errors


# --- decode, config, profile


def test_decode_valid_input_exits_with_code_0(hil: Command) -> None:
    code, output, _ = hil("decode", "computer-link", *STATUS_ORDER.split(), "18")
    assert (code, json.loads(output)[0]["header"]["function_text"]) == (0, "read status")
    assert hil("decode", "computer-link", f"05{STATUS_ORDER}18".replace(" ", ":"))[0] == 0
    code, output, _ = hil("decode", "jr3-can", "201#C80010270000")
    assert (code, json.loads(output)[0]["op"]) == (0, "start async")


def test_decode_faulty_block_reports_position_and_code_2(hil: Command) -> None:
    code, output, errors = hil("decode", "computer-link", STATUS_ORDER, "19")
    (item,) = json.loads(output)
    assert (code, errors) == (2, "")
    assert item["problem"] == "check character is 19, the telegram needs 18"
    assert item["problem_offset"] == 12
    for broken in ("10 02 00 08 01 00", "55", f"{STATUS_ORDER} 18 55"):
        assert hil("decode", "computer-link", broken)[0] == 2, broken


@pytest.mark.parametrize("frame", ["201#C800", "201#", "7FF#00", "080#R", "00000201#C80010270000"])
def test_decode_invalid_frames_exits_with_code_2(hil: Command, frame: str) -> None:
    code, output, errors = hil("decode", "jr3-can", "201#C80010270000", frame)
    sound, broken = json.loads(output)
    assert (code, errors, sound["problems"]) == (2, "", [])
    assert broken["problems"]


def test_config_commands(hil: Command) -> None:
    assert hil("config", "init") == (0, "wrote hil-bridge.toml\n", "")
    assert hil("list", "facts", "hil-bridge.toml") == hil("list", "facts")
    assert "Write and explain configuration files; check programs." in hil("config", "--help")[1]
    code, output, _ = hil("config", "schema")
    assert (code, json.loads(output)["type"]) == (0, "object")


def test_list_facts_shows_assumed_and_changed_values(hil: Command) -> None:
    Path("c.toml").write_text("[robot.s3.link]\nbid_limit = 7\n")
    *assumed, counts = hil("list", "facts", "c.toml")[1].splitlines()
    *everything, same = hil("list", "facts", "c.toml", "--all")[1].splitlines()
    assert counts == same
    marks = [sum(f"  [{mark}]  " in line for line in everything) for mark in Mark]
    assert (
        counts == f"settings by mark: {', '.join(f'{n} {mark}' for n, mark in zip(marks, Mark, strict=True))}"
    )
    assert sum(marks) == len(everything)
    assert all("  [assumed]  " in line for line in assumed)
    assert [line for line in everything if "  [assumed]  " in line] == assumed
    assert len(everything) > len(assumed)
    assert any(line.startswith("robot.s3.link.bid_limit = 7 (default 3)  [assumed]  ") for line in assumed)
    assert any(line.startswith("robot.s3.link.baudrate = 9600 Bd  [observed]") for line in everything)


@pytest.mark.parametrize(
    "group",
    [[], ["campaign"], ["config"], ["decode"], ["emulate"], ["identify"], ["list"], ["panel"], ["probe"]],
)
def test_help_summaries_fit_80_columns(
    hil: Command, group: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    _, output, _ = hil(*group, "--help")
    parts = re.split(r"\n\n([A-Z][^\n]*):\n", output)
    commands = [part for title, part in zip(parts[1::2], parts[2::2], strict=True) if title in TITLES]
    summaries = [line for one in commands for line in one.strip("\n").splitlines()]
    assert summaries
    assert all(line.endswith(".") and not line.endswith("...") for line in summaries)


@pytest.mark.parametrize(
    ("where", "command"),
    [
        (
            {"robot": "r", "sensor": "s", "panel": "p", "tool-mass-kg": "0.5"},
            "hil-bridge run --robot 'r' --sensor 's' --tool-mass-kg 0.5",
        ),
        ({"robot": "s3+pty:", "panel": "p"}, "hil-bridge probe robot 's3+pty:'"),
        (
            {"robot": "egm+udp-bind://127.0.0.1:6510"},
            "hil-bridge run --robot 'egm+udp-bind://127.0.0.1:6510' --sensor URL, "
            "with a sensor that feels what the robot touches",
        ),
        ({"sensor": "s", "tool-mass-kg": "0.5"}, "hil-bridge run --sensor 's' --tool-mass-kg 0.5"),
    ],
)
def test_emulate_prints_command_for_client(where: dict[str, str], command: str) -> None:
    assert client_of(where, where.get("robot", "").startswith("s3+")) == command


def test_bare_command_line_shows_first_commands(hil: Command) -> None:
    code, output, errors = hil()
    assert (code, errors) == (0, "")
    commands = [line.split() for line in output.splitlines() if line.startswith("  hil-bridge ")]
    assert [columns[1] for columns in commands] == ["run", "view", "report", "config", "doctor"]
    assert "All commands: hil-bridge --help\n" in output


def test_command_line_has_at_most_22_commands() -> None:
    assert len(cli.list_commands(click.Context(cli))) <= 22


@pytest.mark.parametrize("name", MOVED)
def test_renamed_command_reports_new_name(hil: Command, name: str) -> None:
    line = refused(hil(name, "x"))
    assert line.startswith(f"hil-bridge: the command {name!r} is now '")
    for group, command, *_ in map(str.split, MOVED[name]):
        assert f"'{group} {command}" in line
        assert hil(group, *([] if command.isupper() else [command]), "--help")[0] == 0


def test_command_of_package_reports_installation(hil: Command) -> None:
    line = refused(hil("experiment", "all"))
    assert (
        "in a package of its own; install it from a checkout: pip install ./examples/paper-experiments"
        in line
    )


def test_output_never_overwrites_input(hil: Command, tmp_path: Path) -> None:
    (tmp_path / "c.toml").write_text("[run]\nduration_s = 1\n")
    assert "--record c.toml would overwrite the configuration" in refused(
        hil(*VIRTUAL, "c.toml", "--record", "c.toml")
    )
    assert "--summary x would overwrite --record" in refused(
        hil(*VIRTUAL, "--record", "x", "--summary", "./x")
    )
    assert (tmp_path / "c.toml").read_text() == "[run]\nduration_s = 1\n"


def test_output_is_escaped_for_limited_terminal(tmp_path: Path) -> None:
    process = subprocess.run(
        [sys.executable, "-m", "hil_bridge", "decode", "computer-link", f"{STATUS_ORDER} 18"],
        env={**os.environ, "PYTHONIOENCODING": "latin-1"},
        capture_output=True,
        check=True,
    )
    assert b"PC \\u2192 S3" in process.stdout


def test_help_lists_every_command_once_by_purpose(hil: Command) -> None:
    _, output, _ = hil("--help")
    commands_listed = [
        line.split()[0] for line in output.splitlines() if re.match(r"  [a-z]", line) and "  " in line[2:]
    ]
    assert sorted(commands_listed) == cli.list_commands(click.Context(cli))
    assert "\nOn site:\n" in output


def test_set_option_overrides_setting(hil: Command) -> None:
    code, output, errors = hil(
        *VIRTUAL, "--no-record", "--set", "run.duration_s=0.5", "--set", "controller.name=pi"
    )
    assert (code, errors) == (0, "")
    assert "pi" in output
    for wrong, message in (
        ("limits.force_limit_n=x", "--set limits.force_limit_n: must be a valid number"),
        (
            "limits.force=1",
            "--set limits.force is not a setting; did you mean force_limit_n",
        ),
        ("limits.force_limit_n", "write KEY=VALUE"),
        ("=1", "write KEY=VALUE"),
    ):
        code, _, errors = hil(*VIRTUAL, "--set", wrong)
        assert code == 2
        assert message in errors
    code, _, errors = hil(*VIRTUAL, "--set", "run.seed=1", "--set", "run.seed=2")
    assert (code, "run.seed is given twice" in errors) == (2, True)


def test_dedicated_option_takes_precedence_over_set(hil: Command) -> None:
    hil(*VIRTUAL, "--set", "run.seed=5", "--seed", "9", "--duration", "0.5")
    assert json.loads(hil("list", "runs", "--json")[1])[-1]["outcome"] == "completed"
    (folder,) = Path("runs").iterdir()
    assert json.loads((folder / "summary.json").read_text())["seed"] == "9"


def test_list_runs_shows_readable_part_of_each(hil: Command) -> None:
    code, _, errors = hil("list", "runs")
    assert (code, "name the folder that contains the runs" in errors) == (2, True)
    hil(*VIRTUAL, "--duration", "0.5")
    for name, text in (("2020-broken", "{"), ("2020-list", "[]"), ("2020-\x1b[2J", '{"outcome": "\x1b[2J"}')):
        (Path("runs") / name).mkdir()
        (Path("runs") / name / "summary.json").write_text(text)
    (Path("runs") / "9999-empty").mkdir()
    code, output, _ = hil("list", "runs")
    assert code == 0
    assert "\x1b" not in output
    head, *rows = output.splitlines()
    assert head.split() == [
        "run",
        "outcome",
        "controller",
        "RMS",
        "error,",
        "N",
        "largest",
        "force,",
        "N",
        "cause",
    ]
    assert len(rows) == 4
    assert "completed  predictive" in rows[-1]
    assert len(hil("list", "runs", "--last", "1")[1].splitlines()) == 2
    assert hil("list", "runs", str(Path("runs") / "9999-empty"))[1].startswith(
        "no runs: a run is a folder with the summary.json"
    )


@pytest.mark.parametrize(
    ("arguments", "incomplete", "names"),
    [
        (["run", "--robot"], "r", ["rsi", "rtde"]),
        (["run", "--sensor"], "jr3-", ["jr3-board", "jr3-uart"]),
        (["run", "--controller"], "fuzzy", ["fuzzy", "fuzzy-adaptive"]),
        (["emulate", "cell", "--robot"], "e", ["egm"]),
        (["run", "--set"], "limits.force_l", ["limits.force_limit_n="]),
        (["conform"], "net", ["netft"]),
        (["conform", "rtde", "--only"], "nom", ["nominal"]),
        (["conform", "--only"], "nom", []),
    ],
)
def test_shell_completion_offers_values(arguments: list[str], incomplete: str, names: list[str]) -> None:
    completed = ShellComplete(cli, {}, "hil-bridge", "_HIL_BRIDGE_COMPLETE").get_completions(
        arguments, incomplete
    )
    assert [one.value for one in completed] == names
