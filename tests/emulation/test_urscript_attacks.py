"""Tests of hostile programs: bounded time and memory, one error of the controller, and the next client is served."""

import math
import random
import time

import pytest

from emulators.devices.rtde import RtdeProfile
from emulators.devices.rtde.urscript import FUNCTIONS, Message
from emulators.devices.rtde.urscript.limits import MEMORY_MAX, TOKENS_MAX
from protocol.devices.rtde.states import SafetyMode
from tests.emulation.test_urscript_motion import Bench

pytestmark = pytest.mark.sweep

CYCLE_S = 1.5
"""Maximum processor time of one cycle. Each of these programs takes less than 0.1 s; without limits it took 3 to 40 s.
"""
LONG = f"[{', '.join(['1'] * 4000)}]"
ENDLESS = "without waiting"


def program(body: str, inside: str = "") -> str:
    return f"def mine():\n{inside}{body}\nend\n"


def endless_program(statement: str, first: str = "") -> str:
    return program(f"{first}\nwhile True:\n  {statement}\nend")


MEMBERS = ", ".join(f"a{number}=1" for number in range(3000))
LOOPS: dict[str, str] = {
    "a member of a large struct": endless_program("s.a1 = 2", f"s = struct({MEMBERS})"),
    "an element of a list in a list": endless_program("x[0][0] = 2", f"x = [{LONG}]"),
    "a list in a list continues": endless_program("x.append([])\nx.pop()", f"x = [{LONG}]"),
    "a list in a list, negative": endless_program("y = -x", f"x = [{LONG}]"),
    "a list in a list as text": endless_program("y = to_str(x)", f"x = [{LONG}]"),
    "a struct as text": endless_program("y = to_str(x)", f"x = struct(a={LONG})"),
    "a struct in a list": endless_program("y = [x]", f"x = struct(a={LONG})"),
    "structs compared": endless_program("y = x == z", f"x = struct(a={LONG})\nz = struct(a={LONG})"),
    "a long list made": endless_program("y = make_list(4096, 1.5)"),
    "a matrix of one row": endless_program("y = transpose(x)", "x = make_list(1, make_list(4000, 1.5))"),
    "inverse kinematics": endless_program(
        "y = get_inverse_kin_has_solution(p[0.5, 0.1, 0.4, 0, random(), 0])"
    ),
    "threads that end at once": program(
        "while True:\n  join run t()\nend",
        "thread t():\n  i = 0\n  while i < 5000:\n    i = i + 1\n  end\nend\n",
    ),
    "threads that take nearly all": program(
        "i = 0\nwhile i < 30:\n  i = i + 1\n  run t()\nend\nsleep(9)",
        "thread t():\n while True:\n  i = 0\n    while i < 8000:\n      i = i + 1\n    end\n    sync()\n  end\nend\n",
    ),
    "pop-ups": endless_program('popup("a")'),
    "messages": endless_program('textmsg("a")'),
    "sockets": endless_program('socket_open("127.0.0.1", 5000, to_str(random()))'),
}
"""Programs that never wait; each does much in few statements."""


def slowest_cycle(bench: Bench, cycles: int) -> float:
    """Return the longest processor time of a cycle, s."""
    longest = 0.0
    for _ in range(cycles):
        begun = time.process_time()
        bench.run(bench.controller.period)
        longest = max(longest, time.process_time() - begun)
    return longest


def served(bench: Bench) -> bool:
    """Return whether the next program plays."""
    bench.run(0.02)
    bench.send('\nend\ntextmsg("served")\n')
    bench.run(0.1)
    return bench.messages(Message.TEXT)[-1:] == ["served"]


@pytest.mark.parametrize("name", LOOPS)
def test_program_that_never_waits_is_stopped_in_bounded_time(name: str) -> None:
    bench = Bench(RtdeProfile(start_delay_ms=2.0))
    bench.send(LOOPS[name])
    assert slowest_cycle(bench, 3) < CYCLE_S
    assert ENDLESS in bench.messages(Message.RUNTIME)[-1]
    assert served(bench)


def test_program_exceeding_memory_is_stopped() -> None:
    """Each cycle adds a list of unique strings, within the limits of a cycle."""
    bench = Bench(RtdeProfile(start_delay_ms=2.0))
    body = (
        's = "ab"\nwhile str_len(s) < 8000:\n  s = str_cat(s, s)\nend\nx = make_list(4000, "")\ni = 0\n'
        "while i < 3999:\n  i = i + 1\n  x[i] = str_cat(s, i)\n  sync()\nend\n"
    )
    bench.send(program(body))
    assert slowest_cycle(bench, 1000) < CYCLE_S
    assert bench.messages(Message.RUNTIME) == ["the program uses too much memory"]
    assert served(bench)


def test_program_below_memory_limit_runs() -> None:
    bench = Bench(RtdeProfile(start_delay_ms=2.0))
    rows = "".join(f"x{number} = make_list(4000, {number})\nsync()\n" for number in range(MEMORY_MAX // 8000))
    waste = (
        "i = 0\nwhile i < 300:\n  i = i + 1\n  j = 0\n  while j < 1000:\n    j = j + 1\n  end\n  sync()\nend"
    )
    bench.send(program(f"{rows}{waste}\ntextmsg(x0[0])"))
    bench.run(2.0)
    assert bench.messages(Message.RUNTIME) == []
    assert bench.messages(Message.TEXT) == ["0"]


BAD_TEXTS = {
    "a number of 100 000 digits": ("x = 0x" + "f" * 100_000, "a number is too large"),
    "a string of 100 000 characters": (f'x = "{"a" * 100_000}"', "a string is too long"),
    "more words than a program has": ("\n".join(["x=1"] * (TOKENS_MAX // 3)), "the program is too long"),
    "signs before signs": ("x = " + "-" * 5000 + "1", "the program is nested too deeply"),
}


@pytest.mark.parametrize("name", BAD_TEXTS)
def test_too_large_text_is_syntax_error(name: str) -> None:
    body, message = BAD_TEXTS[name]
    bench = Bench()
    bench.send(program(body))
    assert message in bench.messages(Message.SYNTAX)[-1]
    assert served(bench)


def test_long_call_chain_is_analysed_in_time() -> None:
    """3000 functions: each calls the next one, and the last one waits."""
    bench = Bench(RtdeProfile(start_delay_ms=2.0))
    inside = "".join(f"def f{n}():\nf{n + 1}()\nend\n" for n in range(3000)) + "def f3000():\nsync()\nend\n"
    begun = time.process_time()
    bench.send(program("f0()", inside))
    assert time.process_time() - begun < 4.0
    bench.run(0.01)
    assert "function calls are nested too deeply" in bench.messages(Message.RUNTIME)[-1]


def test_number_of_concurrent_long_programs_is_limited() -> None:
    bench = Bench()
    text = program("# " + "a" * 100_000)
    bench.send(text * 5)
    assert bench.controller.counts["programs dropped"] == 3


@pytest.mark.parametrize(
    "statement",
    ["speedj([1e300, 0, 0, 0, 0, 0], 1e300, 1)", "movel(p[0.8, 0, 0.5, 0, 3.1, 0], a=1e300, v=1e300)"],
)
def test_impossible_order_does_not_move_arm(statement: str) -> None:
    """The arm does not move at all: the cycle that would be too fast does not happen."""
    bench = Bench(RtdeProfile(start_delay_ms=2.0))
    before = bench.controller.arm.joints
    bench.send(statement + "\n")
    bench.run(0.1)
    assert bench.controller.state.safety == SafetyMode.PROTECTIVE_STOP
    assert bench.controller.state.stop_reason == "a joint is too fast"
    assert bench.controller.arm.joints == before
    assert served_after_unlock(bench)


def served_after_unlock(bench: Bench) -> bool:
    bench.run(5.1)
    bench.controller.state.unlock(bench.controller.now)
    return served(bench)


# --- fuzz over the grammar, and over bytes, by seed

ATOMS = (  # noqa: SIM905 (a list of thirty lines)
    "0 1 -1 0.5 1e-9 1e9 (1e308*10) (0/0.0) -1e300 2147483647 0x7FFFFFFF True None 'a' [] x y s [x,x] "
    "p[0.8,0,0.5,0,3.1,0] p[1e300,0,0,0,0,0] [1e300,0,0,0,0,0] [1,1,1,1,1,1] struct(a=1,b=x) make_list(4000,1.5) "
    "get_actual_tcp_pose() random() [[1,2],[3,4]] run_t"
).split()
SIGNS = ("+", "-", "*", "/", "%", "==", "<", ">=", " and ", " or ", " xor ")
NAMES = sorted(FUNCTIONS)


class Writer:
    """Generates programs with hostile values, from a seed."""

    def __init__(self, seed: int) -> None:
        self.rng = random.Random(seed)

    def value(self, depth: int) -> str:
        rng = self.rng
        kind = rng.randrange(8) if depth else 0
        if kind < 3:
            return rng.choice(ATOMS).replace("run_t", "run t()")
        if kind == 3:
            return f"({self.value(depth - 1)}{rng.choice(SIGNS)}{self.value(depth - 1)})"
        if kind == 4:
            return f"[{', '.join(self.value(depth - 1) for _ in range(rng.randrange(6)))}]"
        if kind == 5:
            return f"x[{self.value(depth - 1)}]"
        return self.call(depth - 1)

    def call(self, depth: int) -> str:
        function = FUNCTIONS[self.rng.choice(NAMES)]
        return f"{function.name}({', '.join(self.value(depth) for _ in function.parameters)})"

    def rows(self, count: int, depth: int) -> list[str]:
        rng, rows = self.rng, list[str]()
        for _ in range(count):
            kind = rng.randrange(8 if depth else 6)
            if kind < 2:
                rows.append(f"{rng.choice('xys')} = {self.value(3)}")
            elif kind == 2:
                rows.append(f"x[{self.value(1)}] = {self.value(2)}")
            elif kind < 5:
                rows.append(self.call(2))
            elif kind == 5:
                rows.append(rng.choice(["sync()", "f(x)", f"join {self.value(1)}", f"kill {self.value(1)}"]))
            else:
                word = "if" if kind == 6 else "while"
                rows += [f"{word} {self.value(2)}:", *self.rows(2, depth - 1), "sync()", "end"]
        return rows

    def text(self) -> str:
        first = ["global x = [1, 2, 3]", "global y = 1", 'global s = "ab"']
        inside = ["thread t():", *self.rows(2, 1), "end", "def f(a):", *self.rows(2, 1), "return a", "end"]
        return program("\n".join([*first, *inside, *self.rows(8, 2)]))

    def spoilt(self) -> bytes:
        """Return a text with changed, lost and repeated bytes."""
        rng, data = self.rng, bytearray(self.text().encode())
        for _ in range(rng.randrange(1, 10)):
            at = rng.randrange(len(data) + 1)
            match rng.randrange(4):
                case 0:
                    data[at : at + 1] = bytes((rng.randrange(256),))
                case 1:
                    del data[at : at + rng.randrange(20)]
                case 2:
                    data[at:at] = rng.choice(
                        (b"(", b"end\n", b"def ", b"\x00", b"[[", b'"', b"9" * 50, b"\r", b"$1")
                    )
                case _:
                    data[at:at] = data[max(0, at - 30) : at] * rng.randrange(4)
        return bytes(data)


@pytest.mark.parametrize("seed", range(4))
def test_arbitrary_programs_do_not_break_controller(seed: int) -> None:
    writer = Writer(seed)
    for _ in range(60):
        bench = Bench(RtdeProfile(start_delay_ms=2.0, script_steps=20_000))
        bench.send(writer.text())
        bench.port.receive(writer.spoilt(), bench.now)
        for _ in range(6):
            bench.run(bench.controller.period)
            assert all(map(math.isfinite, (*bench.controller.arm.joints, *bench.controller.arm.motion)))
    bench.port.receive(b"\n" + b"end\n" * 80, bench.now)
    if bench.controller.state.safety == SafetyMode.NORMAL:
        bench.run(0.1)
        assert served(bench)
