"""`probe robot` on every kind, healthy and with faults: the answer, its time, and that nothing moves."""

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner

from emulators.orders import Act, HeardOrder
from hil_bridge.cli import cli
from hil_bridge.clock import Clock, run_virtual
from hil_bridge.devices.kinds import robot_of
from hil_bridge.devices.robots.probing import Probed
from hil_bridge.errors import BridgeError, ConfigError
from hil_bridge.runs.compose import emulated_cell
from hil_bridge.runs.setup import Listen, Setup
from hil_bridge.settings.configuration import load_config
from hil_bridge.site.robot_probe import probe, probe_rows

MOST_S = 5.0
"""An answer comes within so long."""


@dataclass
class Probing:
    """A probe of an emulated robot, and what became of the robot."""

    found: Probed | None = None
    error: BridgeError | None = None
    took: float = 0.0
    way: float = 0.0
    """Distance of the tool from where it stood, m."""
    accepted: int = 0
    """Orders that the robot has taken."""
    heard: list[Any] = field(default_factory=list)

    @property
    def words(self) -> str:
        """All that a person reads."""
        if self.found is None:
            return str(self.error)
        return "\n".join(f"{name} {text}" for name, text in probe_rows(self.found))


def place(robot: Any, now: float) -> list[float]:
    """True position of the tool, m."""
    robot.path.advance(now)
    positions, _ = robot.path.trajectory(np.array([now]))
    return [float(value) for value in positions[0]]


def probed(kind: str, target: str = "", fault: str = "", given: dict[str, object] | None = None) -> Probing:
    """Probe the emulated robot of a kind, with a fault that begins before."""
    result = Probing()

    async def main() -> None:
        clock = Clock.running()
        setup = Setup(load_config(None, {"robot.emulated": kind}), Listen("", None))
        async with emulated_cell(setup, clock, lambda cause: None) as served:
            robot = served.cell.robot
            assert served.robot is not None
            before = place(robot, clock.now())
            await clock.sleep_until(clock.now() + 0.2)
            if fault:
                served.cell.ledger.inject(target, fault, clock.now(), given or {})
            begun = clock.now()
            try:
                result.found = await probe(served.robot.kind, served.robot.url, served.robot.settings, clock)
            except BridgeError as error:
                result.error = error
            result.took = clock.now() - begun
            result.way = math.dist(before, place(robot, clock.now()))
            result.accepted = robot.accepted
        clock.close()

    run_virtual(main)
    return result


@pytest.mark.parametrize(
    ("kind", "words"),
    [
        ("s3", ["robot ABB S3", "state in standby"]),
        ("egm", ["robot ABB, Externally", "rate 250 Hz; 250 Hz by its settings", "state ready"]),
        ("rtde", ["robot Universal", "rate 500 Hz; 500 Hz by its settings", "state ready", "version 5."]),
        ("rsi", ["robot KUKA", "by its settings", "state ready"]),
    ],
)
def test_a_healthy_robot_tells_what_it_is_and_that_a_run_would_begin(kind: str, words: list[str]) -> None:
    result = probed(kind)
    assert result.found is not None, result.error
    for part in (*words, "position 900.0 -100.0 600.0 mm", "a run would begin"):
        assert part in result.words
    assert_nothing_moved(kind, result)


GIVEN: dict[tuple[str, str], dict[str, object]] = {
    ("s3", "offset"): {"x_mm": 5.0},
    **{(kind, "off"): {"for_s": 9.0} for kind in ("egm", "rtde", "rsi")},
}
FAULTS = [
    ("s3", "robot", "emergency-stop", "emergency"),
    ("s3", "robot", "safeguard-stop", "in standby"),
    ("s3", "robot", "key-manual", "key not in AUTO"),
    ("s3", "robot", "local-control", "control"),
    ("s3", "robot", "motors-off", "standby"),
    ("s3", "wire", "off", "position 900.0"),
    ("s3", "wire", "mute", "answer"),
    ("s3", "wire", "deaf", "answer"),
    ("s3", "wire", "line-break", "position 900.0"),
    ("s3", "pose", "offset", "position 905.0"),
    ("egm", "robot", "emergency-stop", "the motors are off"),
    ("egm", "robot", "motors-off", "the motors are off"),
    ("egm", "robot", "program-stopped", "the RAPID program is stopped"),
    ("egm", "robot", "guidance-ended", "sent nothing"),
    ("egm", "robot", "out-of-limits", "sent nothing"),
    ("egm", "robot", "cannot-send", "sent nothing"),
    ("egm", "wire", "off", "sent nothing"),
    ("egm", "wire", "garbled", "a datagram is not heeded"),
    ("egm", "pose", "nan", "position"),
    ("egm", "pose", "missing", "tells no pose"),
    ("rtde", "robot", "protective-stop", "PROTECTIVE_STOP"),
    ("rtde", "robot", "emergency-stop", "POWER_OFF"),
    ("rtde", "robot", "safeguard-stop", "SAFEGUARD_STOP"),
    ("rtde", "robot", "local-control", "local control"),
    ("rtde", "robot", "motors-off", "POWER_OFF"),
    ("rtde", "robot", "slider", "speed slider"),
    ("rtde", "wire", "off", "sent nothing"),
    ("rtde", "wire", "mute", "sent nothing"),
    ("rtde", "wire", "deaf", "sent nothing"),
    ("rtde", "pose", "nan", "position"),
    ("rsi", "robot", "emergency-stop", "stop"),
    ("rsi", "robot", "guidance-ended", "sent nothing"),
    ("rsi", "robot", "drives-stop", "position 900.0"),
    ("rsi", "robot", "out-of-limits", "sent nothing"),
    ("rsi", "wire", "off", "sent nothing"),
    ("rsi", "wire", "mute", "sent nothing"),
    ("rsi", "wire", "garbled", "not understood"),
    ("rsi", "wire", "malformed", "not understood"),
    ("rsi", "pose", "nan", "position"),
    ("rsi", "pose", "missing", "position"),
]


@pytest.mark.parametrize(("kind", "target", "fault", "words"), FAULTS)
def test_a_fault_is_told_in_time_and_nothing_moves(kind: str, target: str, fault: str, words: str) -> None:
    result = probed(kind, target, fault, GIVEN.get((kind, fault)))
    assert words.lower() in result.words.lower(), result.words
    assert_nothing_moved(kind, result)


def assert_nothing_moved(kind: str, result: Probing) -> None:
    """No tool moved, no order was taken but RSI's answers, which say to stand, and it took less than 5 s."""
    assert result.way == 0.0
    assert kind == "rsi" or result.accepted == 0
    assert result.took < MOST_S


def test_a_universal_robot_is_sent_no_program_and_no_input() -> None:
    async def main() -> list[HeardOrder]:
        clock = Clock.running()
        setup = Setup(load_config(None, {"robot.emulated": "rtde"}), Listen("", None))
        async with emulated_cell(setup, clock, lambda cause: None) as served:
            assert served.robot is not None
            orders: list[HeardOrder] = []
            served.cell.robot.orders.listener = orders.append
            await probe(served.robot.kind, served.robot.url, served.robot.settings, clock)
            clock.close()
            return orders

    assert {order.act for order in run_virtual(main)} <= {Act.CONTACT}


@pytest.mark.parametrize(
    ("url", "words"),
    [
        ("rtde://10.0.0.5", "rtde+tcp://10.0.0.5"),
        ("egm://10.0.0.5/", "egm+udp-bind://0.0.0.0:6510"),
        ("rsi://10.0.0.5", "rsi+udp-bind://0.0.0.0:49152"),
        ("s3://server", "s3+tcp://server:4000"),
        ("10.0.0.5", "s3+tcp://10.0.0.5:4000 or egm+udp-bind://0.0.0.0:6510"),
        ("localhost", "rtde+tcp://localhost"),
    ],
)
def test_a_url_without_a_wire_is_answered_with_the_url_to_write(url: str, words: str) -> None:
    with pytest.raises(ConfigError) as told:
        robot_of(url)
    assert words in str(told.value)
    for written in str(told.value).partition("write ")[2].split(" or "):
        kind, wire = robot_of(written)
        assert kind.parse(wire, None) is not None  # type: ignore[arg-type]


def test_an_output_file_is_for_a_link_with_settings() -> None:
    done = CliRunner().invoke(cli, ["probe", "robot", "egm+udp-bind://127.0.0.1:0", "-o", "x.toml"])
    assert "for an s3" in str(done.exception)
