"""A JR3 board with plain words in simulated time: its memory, and the source of its samples."""

from collections.abc import Sequence
from typing import Any

from protocol.devices.jr3.board import (
    REGISTERS,
    CommandCode,
    check_instructions,
    check_range,
    from_signed,
    pack_words,
)
from protocol.devices.jr3.registers import (
    BoardClientProfile,
    Garbage,
    Load,
    Read,
    RegisterServer,
    Reset,
    ResetRefused,
    Response,
    Step,
    Steps,
    Wait,
    Write,
    response_reader,
)

EPOCH = 4321.5
"""Start of virtual time, deliberately not 0."""


class Words:
    """Memory of a board that executes commands instantly; filter2 holds fixed values."""

    def __init__(self) -> None:
        self.memory = [0] * 0x4000
        self.resets = 0
        self.may_reset = True
        self.commands: list[int] = []
        self.loads: list[tuple[int, ...]] = []
        self.answers: dict[int, int] = {}
        """Next value of command_word0, by command; 0 otherwise."""
        self.poke("serial_no", 4711)
        self.poke("model_no", 67)
        self.poke("units", 1)
        for i, scale in enumerate((400, 400, 800, 250, 250, 260)):
            self.poke("max_full_scale", scale, i)

    def poke(self, name: str, value: int, index: int = 0) -> None:
        self.memory[REGISTERS[name].address + index] = from_signed(value)

    def peek(self, name: str, count: int = 1) -> list[int]:
        at = REGISTERS[name].address
        return self.memory[at : at + count]

    def read(self, address: int, count: int, now: float) -> tuple[int, ...]:
        check_range(address, count)
        return tuple(self.memory[address : address + count])

    def burst(self, address: int, count: int, now: float) -> bytes:
        return pack_words(self.read(address, count, now))

    def write(self, address: int, words: Sequence[int], now: float) -> None:
        check_range(address, len(words))
        self.memory[address : address + len(words)] = words
        if address <= 0xE7 < address + len(words):
            code = self.memory[0xE7]
            self.commands.append(code)
            if code == CommandCode.BIT_RESET:
                self.memory[self.memory[0xE6]] &= ~self.memory[0xE5]
            self.memory[0xE7] = from_signed(self.answers.get(code, 0))

    def reset(self, now: float) -> None:
        if not self.may_reset:
            raise ResetRefused("not this one")
        self.resets += 1

    def load(self, address: int, words: Sequence[int], now: float) -> None:
        check_instructions(address, words)
        self.loads.append((address, *words))


def tick(board: Words, counter: int, fz: int = 0, number: int = 2) -> None:
    board.poke(f"filter{number}", fz, 2)
    board.poke(f"count{max(number, 1)}", counter)


def perform(board: Words, sequence: Steps[Any], now: float = EPOCH) -> tuple[Any, list[Step], float]:
    """Run a sequence directly on a board; return its result, its steps, and its duration."""
    steps: list[Step] = []
    begin = now
    try:
        step = next(sequence)
        while True:
            steps.append(step)
            answer: Sequence[int] = ()
            match step:
                case Read(address, count):
                    answer = board.read(address, count, now)
                case Write(address, values):
                    board.write(address, values, now)
                case Reset():
                    board.reset(now)
                case Load(address, values):
                    board.load(address, values, now)
                case Wait(duration):
                    now += duration
            step = sequence.send(answer)
    except StopIteration as end:
        return end.value, steps, now - begin


PROFILE = BoardClientProfile()


def responses_of(server: RegisterServer, now: float) -> list[Response | Garbage]:
    reader, result = response_reader(), list[Response | Garbage]()
    while data := server.data_to_send(now):
        result += reader.feed(data)
    return result
