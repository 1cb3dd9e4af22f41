"""`probe robot` on every kind, healthy and with every fault: result, duration, and absence of motion."""

import asyncio
import re
from functools import cache
from pathlib import Path

import pytest
from click.testing import CliRunner

from emulators.orders import Act
from hil_bridge.cli import cli
from hil_bridge.clock import Clock, run_virtual
from hil_bridge.devices.device_log import NullLog
from hil_bridge.devices.kinds import robot_of
from hil_bridge.devices.robots.probe import ProbeResult
from hil_bridge.devices.robots.seam import MotionLimits
from hil_bridge.devices.wiring import Wiring
from hil_bridge.errors import ConfigError
from hil_bridge.runs.compose import emulated_cell
from hil_bridge.runs.setup import Listen, Setup
from hil_bridge.settings.configuration import load_config
from hil_bridge.site.robot_probe import probe, site_toml
from protocol.geometry import Pose
from tools.probe_doc import KINDS, Case, Look, cases, look_at

pytestmark = pytest.mark.sweep

MOST_S = 5.0
"""Longest time for a response, except for an S3, where many link settings are tried."""
SEARCH_S = 18.0
"""Longest search of an S3: 21 lines, two of them three times, 0.7 s each."""
FLIPPED_BIT_M = 1e-8
"""RSI has no checksum and relies on that of UDP; a bit flipped after it becomes a correction."""


@cache
def probe_robot(kind: str, target: str = "", fault: str = "") -> Look:
    """Probe the emulated robot of a kind, with a fault that begins before."""
    return look_at(Case(kind, target, fault))


@pytest.mark.parametrize(
    ("kind", "expected"),
    [
        ("s3", ["robot ABB S3", "state in standby"]),
        ("egm", ["robot ABB, Externally", "rate 250 Hz; 250 Hz by its settings", "state ready"]),
        ("rtde", ["robot Universal", "rate 500 Hz; 500 Hz by its settings", "state ready", "version 5."]),
        ("rsi", ["robot KUKA", "by its settings", "state ready"]),
    ],
)
def test_probe_of_healthy_robot_reports_it_is_ready(kind: str, expected: list[str]) -> None:
    view = probe_robot(kind)
    assert not view.refusals
    for part in (*expected, "position 900.0 -100.0 600.0 mm"):
        assert part in view.words


FAULTS = [
    ("s3", "robot", "emergency-stop", "emergency"),
    ("s3", "robot", "safeguard-stop", "in standby"),
    ("s3", "robot", "key-manual", "key not in AUTO"),
    ("s3", "robot", "local-control", "control"),
    ("s3", "robot", "motors-off", "standby"),
    ("s3", "wire", "off", "no answer at any rate"),
    ("s3", "wire", "mute", "answer"),
    ("s3", "wire", "deaf", "answer"),
    ("s3", "wire", "line-break", "no answer at any rate"),
    ("s3", "robot", "power-cycle", "no other program uses the link"),
    ("s3", "pose", "offset", "position 905.0"),
    ("egm", "robot", "emergency-stop", "the motors are off"),
    ("egm", "robot", "motors-off", "the motors are off"),
    ("egm", "robot", "program-stopped", "the RAPID program is stopped"),
    ("egm", "robot", "guidance-ended", "sent nothing for 3.5 s; start its program"),
    ("egm", "robot", "out-of-limits", "mciState ERROR"),
    ("egm", "robot", "cannot-send", "mciState ERROR"),
    ("egm", "wire", "off", "sent nothing for 3.5 s; start its program, have it send to this computer's"),
    ("egm", "wire", "garbled", "a datagram is ignored"),
    ("egm", "wire", "malformed", "a datagram is ignored"),
    ("egm", "wire", "twice", "stale packets"),
    ("egm", "wire", "wrong-seqno", "is ignored"),
    ("egm", "pose", "nan", "position invalid"),
    ("egm", "pose", "missing", "reports no pose"),
    ("rtde", "robot", "protective-stop", "PROTECTIVE_STOP"),
    ("rtde", "robot", "emergency-stop", "ROBOT_EMERGENCY_STOP"),
    ("rtde", "robot", "safeguard-stop", "SAFEGUARD_STOP"),
    ("rtde", "robot", "local-control", "local control"),
    ("rtde", "robot", "motors-off", "POWER_OFF"),
    ("rtde", "robot", "slider", "speed slider"),
    ("rtde", "robot", "in-use", "another client holds its input registers"),
    ("rtde", "wire", "off", "its dashboard does not respond; check the cable"),
    ("rtde", "wire", "mute", "its dashboard does not respond"),
    ("rtde", "wire", "deaf", "its dashboard does not respond"),
    ("rtde", "wire", "garbled", "its dashboard does not respond"),
    ("rtde", "pose", "nan", "position"),
    ("rsi", "robot", "emergency-stop", "stop"),
    ("rsi", "robot", "guidance-ended", "sent nothing"),
    ("rsi", "robot", "drives-stop", "its packets have ended"),
    ("rsi", "robot", "out-of-limits", "sent nothing"),
    ("rsi", "wire", "off", "sent nothing"),
    ("rsi", "wire", "mute", "sent nothing"),
    ("rsi", "wire", "garbled", "not valid UTF-8"),
    ("rsi", "wire", "deaf", "it has not accepted 50 answers"),
    ("rsi", "wire", "lost", "packets missing"),
    ("rsi", "wire", "malformed", "invalid telegram"),
    ("rsi", "pose", "nan", "position"),
    ("rsi", "pose", "missing", "it has no RIst"),
]


@pytest.mark.parametrize(("kind", "target", "fault", "message"), FAULTS)
def test_probe_reports_robot_fault(kind: str, target: str, fault: str, message: str) -> None:
    view = probe_robot(kind, target, fault)
    assert message.lower() in view.words.lower(), view.words


@pytest.mark.parametrize(
    ("kind", "settings", "message"),
    [
        ("egm", {"cell.egm.rw": "6.06"}, "state ready"),
        ("egm", {"cell.egm.rw": "6.10"}, "state ready"),
        (
            "egm",
            {"cell.egm.sample_ms": 8.0},
            "it sends every 8.0 ms instead of every 4 ms; set robot.egm.sample_ms",
        ),
        ("rtde", {"cell.rtde.version": "3.15.0.0", "cell.rtde.model": "ur10"}, "version 3.15.0.0"),
    ],
)
def test_probe_of_robot_with_other_version(kind: str, settings: dict[str, object], message: str) -> None:
    view = look_at(Case(kind, settings=settings))
    assert message in view.words
    assert view.took_s < MOST_S


@pytest.mark.parametrize(
    "case",
    [case for kind in KINDS for case in cases(kind)],
    ids=lambda case: "-".join(filter(None, case[:3])),
)
def test_probe_moves_nothing_and_responds_in_time(case: Case) -> None:
    """The robot accepts no order except RSI's responses, which hold the position.

    A Universal Robot receives no program and no input.
    """
    view = probe_robot(*case[:3])
    flipped = case[:3] == ("rsi", "wire", "corrupted")
    if case.fault != "encoder-offset":  # by itself it moves the arm
        assert view.way_m <= (FLIPPED_BIT_M if flipped else 0.0)
    assert case.kind == "rsi" or view.accepted == 0
    assert case.kind != "rtde" or set(view.acts) <= {Act.CONTACT}
    assert view.took_s < (SEARCH_S if case.kind == "s3" else MOST_S)
    assert view.rows or view.refusals


def test_probe_during_run_does_not_disturb_it() -> None:
    """The registers of a Universal Robot belong to the run: the probe that requests them is refused, three times."""

    async def main() -> tuple[list[str], list[str], int]:
        clock = Clock.running()
        setup = Setup(load_config(None, {"robot.emulated": "rtde"}), Listen("", None))
        async with emulated_cell(setup, clock, lambda cause: None) as served:
            assert served.robot is not None
            kind, url, settings = served.robot.kind, served.robot.url, served.robot.settings
            link = await kind.connect(url, settings, Wiring("robot", clock, NullLog()))
            link.start()
            start = (await link.ready()).pose
            faults: list[str] = []
            answers: list[str] = []

            async def run_probe() -> None:
                for _ in range(3):
                    await clock.sleep_until(clock.now() + 0.2)
                    result = await probe(kind, url, settings, clock)
                    answers.extend(trouble.fact for trouble in result.refusals)

            probing = asyncio.create_task(run_probe())
            async with link.motion(MotionLimits(0.02)) as motion:
                begun = clock.now()
                while not probing.done():
                    faults.append((await link.report()).fault)
                    x, y, z = start.position
                    await motion.to(Pose((x, y + 0.002 * (clock.now() - begun), z), start.quaternion))
            await probing
            await link.aclose()
        clock.close()
        return answers, [fault for fault in faults if fault], len(faults)

    answers, faults, steps = run_virtual(main)
    assert len(answers) == 3
    assert all("another client holds its input registers" in answer for answer in answers)
    assert faults == []
    assert steps > 1000, "each packet of 2 ms had its target"


@pytest.mark.parametrize(
    ("url", "message"),
    [
        ("rtde://10.0.0.5", "rtde+tcp://10.0.0.5"),
        ("egm://10.0.0.5/", "egm+udp-bind://0.0.0.0:6510"),
        ("rsi://10.0.0.5", "rsi+udp-bind://0.0.0.0:49152"),
        ("s3://server", "s3+tcp://server:4000"),
        (
            "10.0.0.5",
            "egm+udp-bind://0.0.0.0:6510 or rsi+udp-bind://0.0.0.0:49152 or rtde+tcp://10.0.0.5 or s3+tcp",
        ),
        ("localhost", "rtde+tcp://localhost"),
    ],
)
def test_probe_url_without_wire_suggests_complete_url(url: str, message: str) -> None:
    with pytest.raises(ConfigError) as reported:
        robot_of(url)
    assert message in str(reported.value)
    for written in str(reported.value).partition("write ")[2].split(" or "):
        kind, wire = robot_of(written)
        assert kind.parse(wire, None) is not None  # type: ignore[arg-type]


def test_probe_file_is_a_loadable_configuration(tmp_path: Path) -> None:
    result = ProbeResult((("position", "900 mm"), ("program", "a\nurl = 'forged'\x1b")))
    file = tmp_path / "cell.toml"
    file.write_text(site_toml("rtde+tcp://192.0.2.1", result))
    assert load_config(file, {}).robot.url == "rtde+tcp://192.0.2.1"
    text = file.read_text()
    assert "# position: 900 mm\n# program: a url = 'forged'\\x1b\nurl = " in text, (
        "text from the robot stays in comments"
    )
    every = re.sub("^#= ", "", text, flags=re.MULTILINE).replace(
        "jr3+can+socketcan://can0", "netft+udp://192.0.2.2"
    )
    file.write_text(every)
    assert load_config(file, {}).tool.mass_kg == 0.5, "the fields for an operator are settings"


def test_probe_keeps_existing_file(tmp_path: Path) -> None:
    file = tmp_path / "cell.toml"
    file.touch()
    result = CliRunner().invoke(cli, ["probe", "robot", "egm+udp-bind://127.0.0.1:0", "-o", str(file)])
    assert "already exists" in str(result.exception)
