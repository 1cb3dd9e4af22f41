"""Tests of texts that a controller compiles before it runs them: what is refused, and what continues meanwhile."""

import math
from typing import Literal

import pytest

from emulators.devices.rtde.urscript import Message
from emulators.orders import Act, ReceivedOrder
from emulators.unmodelled import NotModelled
from protocol.devices.rtde.states import Runtime
from protocol.devices.rtde.wires import Port
from tests.emulation.exact_arm import EXACT
from tests.emulation.rtde_desk import Desk

MOVE = "def f():\n  p = get_actual_tcp_pose()\n  movel(pose_add(p, p[0, 0.05, 0, 0, 0, 0]), 1.2, 0.25)\nend\n".replace(
    "pose_add(p, p[", "pose_add(here, p["
).replace("  p = get", "  here = get")
MOVED_MM = 50.0


def moved_mm(desk: Desk, text: str, seconds: float = 1.5) -> float:
    start = desk.place
    desk.upload(text)
    desk.run(seconds)
    return math.dist(start, desk.place) * 1e3


def errors(desk: Desk) -> list[str]:
    return [s.text for s in desk.controller.console.program_messages if s.message is Message.SYNTAX]


@pytest.mark.parametrize("call", ["", "f()\n", "\nf()\n", "unknown_name\n", "movej()\n"])
def test_line_after_definition_keeps_it_playing(call: str) -> None:
    assert moved_mm(Desk(), MOVE + call) == pytest.approx(MOVED_MM, abs=0.05)


def test_call_after_definition_is_reported_as_error() -> None:
    desk = Desk()
    desk.upload(MOVE + "f()\n")
    assert errors(desk) == ["compile_error_name_not_found:f:"]
    assert desk.robot.unmodelled.things == ()


def test_call_after_secondary_program_keeps_arm_moving() -> None:
    desk = Desk()
    assert moved_mm(desk, MOVE + "sec g():\n  set_digital_out(1, True)\nend\ng()\n") == pytest.approx(
        MOVED_MM, abs=0.05
    )
    assert desk.controller.io.outputs["actual_digital_output_bits"] == 2


@pytest.mark.parametrize(
    "wrong",
    ["  if False:\n    nothing_such()\n  end\n", "  thread t():\n    x = nothing\n  end\n", "  sin(1, 2)\n"],
)
def test_uncompilable_text_moves_nothing(wrong: str) -> None:
    desk = Desk()
    assert moved_mm(desk, MOVE.replace("end\n", wrong + "end\n")) == 0.0
    assert len(errors(desk)) == 1


def test_uncompilable_text_stops_no_program() -> None:
    desk = Desk()
    desk.upload("def mine():\n  while True:\n    sync()\n  end\nend\n")
    desk.run(0.2)
    desk.upload("def other():\n  nothing_such()\nend\n")
    desk.run(0.2)
    assert desk.controller.player.runtime is Runtime.PLAYING
    assert desk.controller.player.program is not None
    assert desk.controller.player.program.name == "mine"
    assert desk.robot.unmodelled.things == (
        NotModelled("rtde", "URScript nothing_such()", "not known: the text does not compile"),
    )


NEWER = {
    ("5.8.2.0", "get_inverse_kin_has_solution(p[1, 2, 3, 0, 0, 0])"): False,
    ("5.9.4.0", "get_inverse_kin_has_solution(p[1, 2, 3, 0, 0, 0])"): True,
    ("3.3.0.0", "tool_contact([1, 0, 0, 0, 0, 0])"): False,
    ("5.12.0.0", "tool_contact([1, 0, 0, 0, 0, 0])"): True,
    ("5.9.4.0", "interpreter_mode(clearOnEnd=False)"): False,
    ("5.10.0.0", "interpreter_mode(clearOnEnd=False)"): True,
    ("3.15.0.0", "end_interpreter()"): False,
    ("5.20.0.0", "optimovej([0, 0, 0, 0, 0, 0])"): False,
    ("5.21.0.0", "optimovej([0, 0, 0, 0, 0, 0])"): True,
    ("5.13.0.0", 'modbus_get_error("a")'): False,
    ("5.14.0.0", 'modbus_get_error("a")'): True,
    ("5.16.0.0", 'eip_reader_factory("1", 8)'): False,
    ("5.17.0.0", 'eip_reader_factory("1", 8)'): True,
    ("5.22.0.0", "get_jacobian()"): False,
    ("5.23.0.0", "get_jacobian()"): True,
    ("3.15.0.0", "get_mass_matrix()"): False,
    ("3.5.0.0", "get_tcp_offset()"): False,
    ("3.6.0.0", "get_tcp_offset()"): True,
}


@pytest.mark.parametrize(("version", "call"), NEWER)
def test_function_compiles_only_in_its_versions(version: str, call: str) -> None:
    model: Literal["ur10", "ur10e"] = "ur10" if version.startswith("3") else "ur10e"
    desk = Desk(EXACT.__class__(version=version, model=model))
    reported: list[ReceivedOrder] = []
    desk.controller.orders.listener = reported.append
    desk.upload(f"def f():\n  {call}\nend\n")
    assert (errors(desk) == []) is NEWER[version, call]
    refused = [order.words for order in reported if order.act is Act.UNREADABLE]
    name, number = call.partition("(")[0], version.rpartition(".")[0]
    assert refused == ([] if NEWER[version, call] else [f"URScript {name}(), which {number} does not have"])


@pytest.mark.parametrize("line", ["set sim", "set real"])
def test_cb3_accepts_simulation_orders(line: str) -> None:
    """As python-urx sends them to the secondary interface."""
    cb3, e_series = Desk(EXACT.__class__(version="3.15.0.0", model="ur10")), Desk()
    for desk in (cb3, e_series):
        desk.upload("def mine():\n  while True:\n    sync()\n  end\nend\n")
        desk.run(0.2)
        desk.plug(Port.SECONDARY).send(f"{line}\n".encode())
        assert desk.controller.player.runtime is Runtime.PLAYING
    assert errors(cb3) == []
    assert len(cb3.robot.unmodelled.things) == (line == "set sim")
    assert len(errors(e_series)) == 1


def test_flag_is_kept_for_next_program() -> None:
    desk = Desk()
    desk.upload("def f():\n  set_flag(3, True)\nend\n")
    desk.run(0.2)
    desk.upload("def g():\n  textmsg(get_flag(3), get_flag(4))\nend\n")
    desk.run(0.2)
    assert [s.text for s in desk.controller.console.program_messages if s.message is Message.TEXT] == [
        "TrueFalse"
    ]


def test_force_node_with_feature_tool_plays() -> None:
    """PolyScope exports `tool_pose()` for a Force node."""
    desk = Desk()
    desk.upload(
        "def f():\n  force_mode(tool_pose(), [0, 0, 1, 0, 0, 0], [0, 0, 5, 0, 0, 0], 2, [0.1, 0.1, 0.1, 1, 1, 1])\n"
        "  sleep(0.5)\n  end_force_mode()\n  textmsg(point_dist(tool_pose(), get_target_tcp_pose()))\nend\n"
    )
    desk.run(1.0)
    texts = [s.text for s in desk.controller.console.program_messages if s.message is not Message.STARTED]
    assert texts == ["0", "f"]


def test_array_of_outputs_can_be_set_and_read() -> None:
    desk = Desk()
    desk.upload("def f():\n  digital_out[2] = True\n  textmsg(digital_out[2], digital_in[2])\nend\n")
    desk.run(0.2)
    assert desk.controller.io.outputs["actual_digital_output_bits"] == 4
    assert "TrueFalse" in [s.text for s in desk.controller.console.program_messages]
    desk.upload("digital_out[2] = False\n")
    desk.run(0.2)
    assert desk.controller.io.outputs["actual_digital_output_bits"] == 0
