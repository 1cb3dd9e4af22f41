"""Tests of ur_rtde's program on the emulated controller, driven by its registers, with arbitrary values."""

import math
from collections.abc import Sequence

import pytest
from hypothesis import Phase, given, settings
from hypothesis import strategies as st

from protocol.devices.rtde.program import INPUT_NAMES, program_text
from protocol.devices.rtde.rotation import six_of
from protocol.devices.rtde.states import Runtime, SafetyMode
from protocol.geometry import Pose
from tests.emulation.rtde_desk import CONTROL, DT, START, Desk, inputs_of


class UrClient:
    """Sends commands to ur_rtde's control program, as its library does."""

    def __init__(self, desk: Desk) -> None:
        self.desk = desk
        self.plug = desk.plug()
        self.recipe = inputs_of(
            self.plug,
            "input_int_register_0",
            *(f"input_double_register_{n}" for n in range(12)),
            "input_int_register_1",
        )
        desk.upload(CONTROL)
        desk.run(0.06)

    def command(self, number: int, values: Sequence[float] = (), flag: int = 0) -> None:
        laid = [*values, *[0.0] * (12 - len(values))]
        self.plug.send(self.recipe.pack(number, *laid, flag))

    def do(self, number: int, values: Sequence[float] = (), flag: int = 0, seconds: float = 0.01) -> None:
        self.command(number, values, flag)
        self.desk.run(seconds)
        assert self.desk.controller.io.outputs["output_int_register_0"] == 2
        self.command(0)
        self.desk.run(2 * DT)
        assert self.desk.controller.io.outputs["output_int_register_0"] == 1

    @property
    def reported_values(self) -> list[float]:
        out = self.desk.controller.io.outputs
        return [float(out.get(f"output_double_register_{n}", 0.0)) for n in range(6)]  # type: ignore[arg-type]


def test_ur_rtde_servo_is_followed_until_stopped() -> None:
    desk = Desk()
    ur = UrClient(desk)
    six = list(six_of(Pose(START.position, START.quaternion)))
    for step in range(500):
        six[0] = 0.9 - 0.04 * step / 500.0
        ur.command(24, [*six, 0.0, 0.0, 0.002, 0.1, 300.0])
        desk.run(DT)
    assert desk.place[0] - six[0] == pytest.approx(0.04 * 0.1, abs=4e-4)
    assert desk.controller.io.outputs["output_int_register_0"] == 1
    desk.run(1.0)
    assert desk.place[0] == pytest.approx(six[0], abs=1e-6), "the last target is repeated for ever"
    ur.do(16, [10.0], seconds=0.1)
    assert desk.controller.manipulator.still
    ur.command(255)
    desk.run(2 * DT)
    assert desk.controller.player.runtime == Runtime.STOPPED


def test_ur_rtde_moves_queries_and_settings() -> None:
    desk = Desk()
    ur = UrClient(desk)
    six = list(six_of(Pose(START.position, START.quaternion)))
    ur.do(3, [six[0] - 0.05, *six[1:], 0.25, 1.2], seconds=1.0)
    assert desk.place == pytest.approx((0.85, -0.1, 0.6), abs=1e-9)
    ur.do(46, six)
    joints = ur.reported_values
    ur.do(1, [*joints, 1.0, 1.4], seconds=1.0)
    assert desk.place == pytest.approx(START.position, abs=1e-6)
    ur.do(44, [*joints, 0.0, 0.0, 0.2])
    assert ur.reported_values[:3] == pytest.approx(START.position, abs=1e-6)
    ur.do(44, joints)
    assert ur.reported_values[:3] == pytest.approx((0.9, -0.1, 0.8), abs=1e-6)
    ur.do(40)
    assert ur.reported_values == [0.0, 0.0, 0.2, 0.0, 0.0, 0.0]
    ur.do(29, [0.0, 0.0, 0.1, 0.0, 0.0, 0.0])
    ur.do(43)
    assert ur.reported_values[2] == pytest.approx(0.7, abs=1e-6)
    ur.do(60, [9.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    assert desk.controller.io.outputs.get("output_int_register_1", 0) == 0
    ur.do(47)
    assert desk.controller.io.outputs["output_int_register_1"] == 1
    ur.do(19)  # one that has no effect here


def test_asynchronous_move_reports_progress() -> None:
    desk = Desk()
    ur = UrClient(desk)
    six = list(six_of(Pose(START.position, START.quaternion)))
    ur.do(3, [six[0] - 0.05, *six[1:], 0.1, 1.0], flag=1)
    running = desk.controller.io.outputs["output_int_register_2"]
    assert int(running) & 1 << 15  # type: ignore[arg-type]
    ur.do(33, [2.0], seconds=0.3)
    assert desk.controller.manipulator.still
    assert not int(desk.controller.io.outputs["output_int_register_2"]) & 1 << 15  # type: ignore[arg-type]
    assert 0.85 < desk.place[0] < 0.9


def test_pose_out_of_reach_ends_ur_rtde_program() -> None:
    desk = Desk()
    ur = UrClient(desk)
    ur.command(24, [9.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.002, 0.1, 300.0])
    desk.run(0.02)
    assert (desk.controller.player.runtime, desk.controller.state.safety) == (
        Runtime.STOPPED,
        SafetyMode.NORMAL,
    )


def test_ur_rtde_watchdog_stops_program() -> None:
    desk = Desk()
    ur = UrClient(desk)
    ur.do(35, [10.0])
    desk.run(0.09)
    assert desk.controller.player.runtime == Runtime.PLAYING
    desk.run(0.02)
    assert desk.controller.player.runtime == Runtime.STOPPED


UNSHRUNK = (Phase.explicit, Phase.generate)
"""Settings that report a failing example without shrinking it, which would take minutes."""
WILD = st.one_of(
    st.sampled_from([0.0, 1.0, -1.0, 1e-300, 5e-324, 1e300, -1.7e308, math.inf, -math.inf, math.nan]),
    st.floats(-4.0, 4.0),
)


@given(
    st.lists(st.tuples(st.integers(-2, 75), st.lists(WILD, min_size=12, max_size=12)), max_size=3),
    st.sampled_from([1, 0, -5]),
)
@settings(max_examples=100, phases=UNSHRUNK)
def test_arbitrary_ur_rtde_commands_do_not_break_controller(
    commands: list[tuple[int, list[float]]], flag: int
) -> None:
    desk = Desk()
    ur = UrClient(desk)
    for number, values in commands:
        ur.command(number, values, flag)
        desk.run(0.02)
        ur.command(0)
        desk.run(0.004)
    assert all(map(math.isfinite, desk.place))


@given(st.lists(WILD, min_size=9, max_size=9), st.integers(0, 3))
@settings(max_examples=100, phases=UNSHRUNK)
def test_arbitrary_inputs_do_not_break_controller(values: list[float], command: int) -> None:
    desk = Desk()
    plug = desk.plug()
    recipe = inputs_of(plug, *INPUT_NAMES)
    desk.upload(program_text(50, 10.0, 2.0, 0.1))
    desk.run(0.06)
    for sequence in range(5):
        plug.send(recipe.pack(*values, command, sequence))
        desk.run(0.004)
    assert all(map(math.isfinite, desk.place))
