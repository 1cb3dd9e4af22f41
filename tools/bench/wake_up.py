"""Wake-up delay of a periodic wait for absolute times, compared with plain asyncio and with a loop in C.

The three take turns, so that other work on the machine affects all of them.
"""

import asyncio
import subprocess
import time
from collections.abc import Callable

from hil_bridge.clock import Clock, run_real
from tools.bench import machine
from tools.bench.bridge import AWAKE, BUSY_POLL_MS, processors_awake
from tools.bench.figures import Figure, Report, Spread, Target

RATES_HZ = (100, 1000)
TURNS = 3
TURN_S = 2.0
NANO = 1e-9
MICRO = 1e6
QUARTER = Target("ratio", 0.25)
OURS, POLLING, ASYNCIO, C = "ours", "ours, busy polling", "asyncio's sleep", "C, clock_nanosleep"


async def ours(period: float, count: int) -> list[float]:
    """Return the delays of waits on the bridge's clock, s."""
    clock = Clock.running()
    try:
        anchor, late = clock.now(), []
        for beat in range(1, count + 1):
            await clock.sleep_until(anchor + beat * period)
            late.append(time.monotonic() - (anchor + beat * period))
    finally:
        clock.close()
    return late


async def plain(period: float, count: int) -> list[float]:
    """Return the delays of asyncio's own sleep until the same absolute times, s."""
    loop = asyncio.get_running_loop()
    anchor, late = loop.time(), []
    for beat in range(1, count + 1):
        await asyncio.sleep(anchor + beat * period - loop.time())
        late.append(time.monotonic() - (anchor + beat * period))
    return late


def in_c(period: float, count: int) -> list[float]:
    """Return the delays of clock_nanosleep until absolute times, s; empty if there is no compiler."""
    program = machine.compile_program("sleeper")
    if program is None:
        return []
    arguments = [str(program), str(round(period / NANO)), str(count)]
    text = subprocess.run(arguments, check=True, capture_output=True, text=True).stdout
    return [int(line) * NANO for line in text.split()]


def measure_in_turns(rate: int) -> dict[str, Spread]:
    """Return the delays of all three kinds of wait at this rate, µs."""
    period, count = 1.0 / rate, round(TURN_S * rate)
    late: dict[str, list[float]] = {name: [] for name in (OURS, POLLING, ASYNCIO, C)}
    for _ in range(TURNS):
        late[OURS] += run_real(ours(period, count))
        late[POLLING] += run_real(ours(period, count), BUSY_POLL_MS / 1e3)
        late[ASYNCIO] += run_real(plain(period, count))
        late[C] += in_c(period, count)
    return {name: Spread([each * MICRO for each in values]) for name, values in late.items() if values}


def figures_of(rate: int, spreads: dict[str, Spread], how: str) -> list[Figure]:
    """Return the figures of the bridge's clock, with the other two waits as baselines. `how` names the state of the
    machine.
    """
    figures = []
    for percentile in ("p50", "p99"):
        for kind, manner in ((OURS, ""), (POLLING, ", busy polling")):
            for name in [name for name in (ASYNCIO, C) if name in spreads]:
                has_target = rate == 1000 and percentile == "p99" and name == ASYNCIO
                value, base = getattr(spreads[kind], percentile), getattr(spreads[name], percentile)
                title = f"lateness at {rate} Hz, {percentile}{manner}{how}"
                figures.append(Figure(title, value, "µs", base, name, QUARTER if has_target else None))
    return figures


def measure(report_step: Callable[[str], None]) -> Report:
    """Measure both rates with the machine in its normal state, and the higher rate with its processors kept awake."""
    figures: list[Figure] = []
    left_out = [] if machine.compile_program("sleeper") else [machine.NO_COMPILER]
    for rate in RATES_HZ:
        report_step(f"{rate} Hz")
        figures += figures_of(rate, measure_in_turns(rate), "")
    with processors_awake(left_out) as ready:
        if ready:
            report_step(f"{RATES_HZ[-1]} Hz{AWAKE}")
            figures += figures_of(RATES_HZ[-1], measure_in_turns(RATES_HZ[-1]), AWAKE)
    return Report(tuple(figures), tuple(left_out))
