"""Interpreter of URScript: processor time of a controller's cycle with a program, against one without."""

import time
from collections.abc import Callable

from emulators.devices.rtde import RtdeProfile
from emulators.devices.rtde.controller import Controller
from emulators.devices.rtde.programs import start_text
from emulators.seams import StartPose
from protocol.devices.rtde.program import INPUT_NAMES, NAME, program_text
from protocol.devices.rtde.states import Runtime
from tools.bench.figures import Figure, Report, Spread

CYCLES, TURNS = 2000, 5
WARM_CYCLES = 100
"""Cycles before the first that counts: the program starts within them."""
START = StartPose((0.9, -0.1, 0.6), (0.0, 1.0, 0.0, 0.0), 0.2)
INPUTS = {name: 0.0 if "double" in name else 0 for name in INPUT_NAMES}
"""A package that orders nothing."""
MICRO = 1e-3
"""µs in a ns."""
LOOP = """def loop():
  global command = 0
  global target = get_actual_joint_positions()
  thread servo():
    while True:
      enter_critical
      q = target
      exit_critical
      servoj(q, t=get_steptime(), lookahead_time=0.03, gain=2000)
    end
  end
  run servo()
  count = 0
  while True:
    given = [0, 0, 0, 0, 0, 0]
    i = 0
    while i < 6:
      given[i] = read_input_float_register(24 + i)
      i = i + 1
    end
    command = read_input_integer_register(24)
    if command == 1:
      target = given
    end
    count = count + 1
    write_output_integer_register(24, count)
    sync()
  end
end
"""
"""A servo loop in a thread, with targets from registers; it stands, for its command is 0."""


def controller(text: str) -> Controller:
    """A controller that plays a program; an empty text is none."""
    robot = Controller(RtdeProfile(), START, 100.25, 7)
    if text:
        start_text(robot, NAME, text.encode())
    return robot


def cycles_us(robot: Controller, count: int = CYCLES) -> list[float]:
    """Processor time of each cycle, µs. The package of inputs, which is not in it, keeps the program alive."""
    times = []
    for _ in range(count):
        robot.write_inputs(tuple(INPUTS), INPUTS)
        began = time.process_time_ns()
        robot.advance(robot.now + robot.period)
        times.append((time.process_time_ns() - began) * MICRO)
    return times


def measure(say: Callable[[str], None]) -> Report:
    """An idle controller, our streaming program, and a servo loop with a thread, in turn."""
    cases = {"our streaming program": program_text(50, 10.0, 2.0, 0.03), "a servo loop with a thread": LOOP}
    robots = {title: controller(text) for title, text in {"idle": "", **cases}.items()}
    times: dict[str, list[float]] = {title: [] for title in robots}
    for robot in robots.values():
        cycles_us(robot, WARM_CYCLES)
    assert all(robots[title].runtime == Runtime.PLAYING for title in cases), "each program plays"
    for turn in range(TURNS):
        say(f"turn {turn + 1} of {TURNS}")
        for title, robot in robots.items():
            times[title] += cycles_us(robot)
    assert all(robots[title].runtime == Runtime.PLAYING for title in cases), "each program plays on"
    idle = Spread(times["idle"]).p50
    figures = [Figure("an idle cycle, p50", idle, "µs")]
    figures += [
        Figure(f"a cycle, {title}, p50", Spread(times[title]).p50, "µs", idle, "an idle cycle")
        for title in cases
    ]
    return Report(tuple(figures))
