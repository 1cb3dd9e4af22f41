"""Tests of texts whose compilation is spread over cycles, as in real time: behaviour before it is complete."""

from collections.abc import Callable
from itertools import pairwise

import pytest

from emulators.devices.rtde.uploads import WAITING_MAX
from emulators.devices.rtde.urscript import Message, statements
from protocol.devices.rtde import packets
from protocol.devices.rtde.packets import Kind
from protocol.devices.rtde.states import Runtime, SafetyMode
from protocol.devices.rtde.wires import Port
from tests.emulation.exact_arm import EXACT
from tests.emulation.rtde_desk import Desk, outputs_of, values_of

ROW = "  if read_input_integer_register(24) == 7:\n    servoj(q, 0, 0, 0.002, 0.1, 300)\n  end\n"


def program(name: str, kilobytes: int = 0) -> str:
    """Return a program that plays until it is stopped, of about this length."""
    rows = ROW * (kilobytes * 1000 // len(ROW))
    return f"def {name}():\n  q = get_actual_joint_positions()\n  while True:\n{rows}    sync()\n  end\nend\n"


@pytest.fixture(autouse=True)
def nothing_is_compiled(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(statements, "_newest", {})


class Spread(Desk):
    """Controller whose texts are compiled when `compile` is called."""

    def __init__(self) -> None:
        super().__init__(EXACT)
        self.controller.player.uploads.spread = lambda: None

    def compile(self) -> int:
        """Compile all texts; return the number of steps."""
        count = 1
        while self.controller.player.uploads.step():
            count += 1
        return count

    @property
    def playing(self) -> str:
        """Return the name of the playing program, after its start."""
        self.run(0.1)
        program = self.controller.player.program
        return (
            program.name if program is not None and self.controller.player.runtime == Runtime.PLAYING else ""
        )


def test_upload_of_80_kb_delays_no_rtde_cycle() -> None:
    desk = Spread()
    client = desk.plug()
    recipe = outputs_of(client, "timestamp", "runtime_state")
    client.send(packets.encode(Kind.START))
    desk.upload(program("long", 80))
    steps = 0

    def step() -> None:
        nonlocal steps
        steps += desk.controller.player.uploads.step()

    desk.run(2.0, step)
    stamps = [float(str(values["timestamp"])) for values in values_of(client, recipe)]
    assert len(stamps) == 1000
    assert {round((b - a) / 0.002) for a, b in pairwise(stamps)} == {1}
    assert steps == 1000, "a step is small"
    assert desk.playing == ""
    desk.compile()
    assert desk.playing == "long"


def test_later_text_does_not_overtake_earlier_one() -> None:
    desk = Spread()
    desk.upload(program("first", 40))
    desk.upload(program("second"))
    desk.upload("sec third():\n  set_digital_out(1, True)\nend\n")
    desk.compile()
    assert desk.playing == "second"
    starts = [s.text for s in desk.controller.console.program_messages if s.message is Message.STARTED]
    assert starts == ["second"], "the first one was stopped before it began"
    assert desk.controller.io.outputs["actual_digital_output_bits"] == 2


def test_call_after_long_definition_keeps_it_playing() -> None:
    desk = Spread()
    desk.upload(program("mine", 10) + "mine()\n")
    desk.compile()
    assert desk.playing == "mine"
    assert desk.robot.unmodelled.things == ()


def test_closed_connection_keeps_its_program() -> None:
    desk = Spread()
    script = desk.plug(Port.SCRIPT)
    script.send(program("mine", 10).encode())
    desk.controller.player.uploads.step()
    desk.unplug(script, Port.SCRIPT)
    desk.compile()
    assert desk.playing == "mine"


STOPS: dict[str, Callable[[Desk], object]] = {
    "script port": lambda desk: desk.upload("stop program\n"),
    "dashboard": lambda desk: desk.plug(Port.DASHBOARD).line("stop"),
    "power off": lambda desk: desk.plug(Port.DASHBOARD).line("power off"),
    "protective stop": lambda desk: desk.controller.protective_stop("a test"),
    "load": lambda desk: desk.plug(Port.DASHBOARD).line("load stored.urp"),
}


@pytest.mark.parametrize("stop", STOPS)
def test_stop_during_compilation_cancels_the_program(stop: str) -> None:
    desk = Spread()
    desk.controller.player.stored = {"stored": b"sync()"}
    desk.upload(program("mine", 10))
    desk.controller.player.uploads.step()
    STOPS[stop](desk)
    desk.compile()
    assert desk.playing == ""
    assert desk.controller.counts["programs refused"] == 1


def test_ended_program_does_not_cancel_next_one() -> None:
    desk = Spread()
    desk.upload("def brief():\n  sleep(0.2)\nend\n")
    desk.compile()
    desk.run(0.1)
    desk.upload(program("mine", 10))
    desk.run(0.3)
    assert desk.controller.player.runtime == Runtime.STOPPED
    desk.compile()
    assert desk.playing == "mine"


def test_text_received_during_stop_does_not_start() -> None:
    desk = Spread()
    desk.controller.protective_stop("a test")
    desk.run(6.0)
    desk.upload(program("mine", 10))
    assert desk.plug(Port.DASHBOARD).line("unlock protective stop") == "Protective stop releasing"
    assert desk.controller.state.safety == SafetyMode.NORMAL
    desk.compile()
    assert desk.playing == ""


def test_texts_above_limit_are_dropped() -> None:
    desk = Spread()
    script = desk.plug(Port.SCRIPT)
    for number in range(WAITING_MAX + 2):
        script.send(program(f"p{number}", 1).encode())
        desk.run(0.002)
    assert desk.controller.counts["programs dropped"] == 2
    desk.compile()
    assert desk.playing == f"p{WAITING_MAX - 1}"


# --- the dashboard's play


def load(desk: Desk, text: str) -> None:
    """Load a stored program."""
    desk.controller.player.stored = {"mine": text.encode()}
    desk.plug(Port.DASHBOARD).line("load mine.urp")


def answers(got: bytes) -> list[str]:
    return got.decode().splitlines()[1:]


def test_play_is_answered_after_compilation() -> None:
    desk = Spread()
    load(desk, program("mine", 10))
    dashboard = desk.plug(Port.DASHBOARD)
    dashboard.send(b"play\nrobotmode\n")
    desk.run(0.1)
    assert answers(dashboard.got) == []
    desk.compile()
    desk.run(0.01)
    assert answers(dashboard.got) == ["Starting program", "Robotmode: RUNNING"]
    assert desk.playing == "mine"


@pytest.mark.parametrize("text", ["def mine():\n  x = = 1\nend\n", "def mine():\n  unheard_of()\nend\n"])
def test_play_of_uncompilable_program_fails(text: str) -> None:
    desk = Desk()
    load(desk, text)
    dashboard = desk.plug(Port.DASHBOARD)
    assert dashboard.line("play") == "Failed to execute: play"
    assert dashboard.line("running") == "Program running: false"


def test_play_stopped_before_start_fails() -> None:
    desk = Spread()
    load(desk, program("mine", 10))
    dashboard = desk.plug(Port.DASHBOARD)
    dashboard.send(b"play\n")
    desk.upload("stop program\n")
    desk.compile()
    desk.run(0.01)
    assert answers(dashboard.got) == ["Failed to execute: play"]


def test_concurrent_plays_are_answered_in_order() -> None:
    desk = Desk()
    load(desk, program("mine"))
    dashboard = desk.plug(Port.DASHBOARD)
    dashboard.send(b"play\n" * 2000 + b"quit\nplay\n")
    assert answers(dashboard.got) == ["Starting program"] * 2000 + ["Disconnected"]
