"""Force source in real time, which runs until it is stopped."""

import asyncio
import signal
from contextlib import suppress

from hil_bridge.clock import Clock, run_real
from hil_bridge.clock.realtime import real_time_thread
from hil_bridge.device_commands.rtde.force_source import ForceOptions, feed
from hil_bridge.devices.device_log import NullLog
from hil_bridge.devices.wiring import Wiring
from hil_bridge.settings.configuration import Config


def run_source(url: str, config: Config, options: ForceOptions, duration_s: float | None) -> str:
    """Send forces to a controller for `duration_s`, or until SIGINT or SIGTERM. Return a summary. Errors as for
    `feed`.
    """
    with real_time_thread(config.realtime):
        return run_real(lambda: _run(url, config, options, duration_s), config.realtime.busy_poll_ms * 1e-3)


async def _run(url: str, config: Config, options: ForceOptions, duration_s: float | None) -> str:
    clock = Clock.running()
    stopped = asyncio.Event()
    with suppress(NotImplementedError):  # no signal handlers in loops of other platforms
        for number in (signal.SIGINT, signal.SIGTERM):
            clock.loop.add_signal_handler(number, stopped.set)
    if duration_s is not None:
        clock.call_at(clock.now() + duration_s, stopped.set)
    try:
        source = await feed(url, config, options, Wiring("robot", clock, NullLog()), stopped)
    finally:
        clock.close()
    return (
        f"sent the force for {source.counts['packets']} packets; the largest was {source.largest_n:.1f} N, "
        f"the last {source.newest_n:.1f} N"
    )
