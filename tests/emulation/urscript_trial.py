"""A program in URScript and the controller on which it runs, without a moving arm."""

from emulators.devices.rtde.controller import Controller
from emulators.devices.rtde.script_host import ControllerHost
from emulators.devices.rtde.urscript import FUNCTIONS, Machine, Message, compile_program
from emulators.seams import StartPose
from tests.emulation.exact_arm import EXACT

START = StartPose((0.9, -0.1, 0.6), (0.0, 1.0, 0.0, 0.0), 0.2)


class ProgramTrial:
    """Program, and the controller on which it plays."""

    def __init__(self, text: str, steps: int = 20_000) -> None:
        self.controller = Controller(EXACT, START, 100.25, 7)
        self.machine = Machine(compile_program(text, FUNCTIONS), ControllerHost(self.controller), steps)

    def play(self, cycles: int) -> int:
        """Return the cycle in which it ends, or -1."""
        return next((number for number in range(cycles) if not self.machine.cycle()), -1)

    def messages(self, kind: Message = Message.TEXT) -> list[str]:
        return [str(saying) for saying in self.controller.console.program_messages if saying.message == kind]


def output_of(text: str, cycles: int = 50) -> list[str]:
    trial = ProgramTrial(text)
    assert trial.play(cycles) >= 0
    assert trial.messages(Message.RUNTIME) == []
    return trial.messages()


def program(body: str) -> str:
    return "def mine():\n" + "".join(f"  {line}\n" for line in body.splitlines()) + "end\n"
