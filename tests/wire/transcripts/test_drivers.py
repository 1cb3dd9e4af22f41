"""A session of a compiled driver that other people wrote, replayed: at the emulated KUKA, and through our decoder.

The driver's own source was compiled outside of this project with stubs for ROS. It swings three axes by a sine of 10°,
counted from the axes of the start; 60 cycles of that are kept. What it read and sent it tells in its own numbers.
"""

from pathlib import Path

import pytest

from protocol.devices.rsi import axis_tags, decode
from tools.client_transcripts import CLIENT, DEVICE, read, replayed

DRIVER = read(Path(__file__).with_name("drivers") / "rsi-kuka-experimental.txt")


def test_the_emulated_kuka_says_every_byte_to_a_driver_of_axes_again() -> None:
    assert replayed(DRIVER) == [step for step in DRIVER.steps if step.side == DEVICE]


def test_axes_are_read_and_understood_as_the_driver_does() -> None:
    told = [decode(data) for data in DRIVER.made_by(DEVICE, "rsi")]
    answered = [decode(data) for data in DRIVER.made_by(CLIENT, "rsi")]
    assert [telegram.ipoc for telegram in answered] == [telegram.ipoc for telegram in told]
    rows = zip(told[1:], answered[1:], DRIVER.reads, DRIVER.sends, strict=True)
    for robot, client, values, corrections in rows:
        axes = [float(robot.values[tag]) for tag in axis_tags("AIPos")]
        assert axes == pytest.approx(values["positions_deg"], abs=1e-6)
        sent = [float(client.values[tag]) for tag in axis_tags("AK")]
        assert sent == pytest.approx(corrections["corrections_deg"], abs=2e-6)


def test_the_emulated_arm_comes_along_with_the_driver() -> None:
    told = [decode(data) for data in DRIVER.made_by(DEVICE, "rsi")]
    start, end = (
        [float(telegram.values[tag]) for tag in axis_tags("AIPos")] for telegram in (told[0], told[-1])
    )
    behind = DRIVER.sends[-12]["corrections_deg"]
    moved = [there - here for there, here in zip(end, start, strict=True)]
    assert moved[:3] == pytest.approx(behind[:3], abs=0.15)
    assert min(map(abs, moved[:3])) > 2.0
    assert all(telegram.values["Delay.D"] == "0" for telegram in told)
