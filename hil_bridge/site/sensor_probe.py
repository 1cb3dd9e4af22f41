"""Implementation of `hil-bridge probe sensor`: the force sensor's self-description, its mounting, and its wrench.

Only the requests at the start of a run are sent, and no zero is set. The displayed wrench is the output of the
device, including the weight of everything below the sensor.
"""

import asyncio
import math
import os
import signal
import sys
from collections import deque
from collections.abc import AsyncIterator, Callable, Iterator, Sequence
from contextlib import asynccontextmanager, contextmanager, nullcontext, suppress
from dataclasses import dataclass, replace
from typing import NamedTuple, TypeVar

import click

from hil_bridge.clock import Clock, run_real
from hil_bridge.devices.device_log import CallbackLog
from hil_bridge.devices.sensors.stream import ForceSensor
from hil_bridge.devices.wiring import Wiring
from hil_bridge.errors import DeviceError
from hil_bridge.runs.compose import connect_sensor
from hil_bridge.runs.zeroing import wrist
from hil_bridge.settings.configuration import Config
from hil_bridge.settings.devices import sensor_at
from hil_bridge.site.push import (
    RIGHT_ANGLE_DEG,
    PushResponse,
    angle_deg,
    expect_push,
    judge_push,
    mounting_of,
    push_threshold,
)
from protocol.wrench import AXES, WrenchFrame

NOISE_S = 1.0
"""Time for measuring the rate and noise of the stream, and the force before a push, s. Chosen."""
HOLD_S = 0.5
"""Time for which a push must be held, s. Chosen."""
POLL_S = 0.1
"""Interval at which the probe checks for a push, s. Chosen."""
PATIENCE_S = 60.0
"""Longest wait for a push, and for the end of a push, s. Chosen: an operator has to walk to the cell."""
FIRST_S = 5.0
"""Longest wait for the first frame after the device reports that it streams, s.

Chosen: with the slowest filter of a UART gateway, the frame arrives within a second.
"""
SHOW_S = 1.0
"""Time between two live lines, s."""
STEADY_SHARE = 0.25
"""Largest variation of a held push, rms, as a share of the push. Chosen: a larger variation is a knock, or a moving
hand.
"""

Value = TypeVar("Value")


@dataclass(frozen=True, slots=True)
class Screen:
    """Output functions of a probe."""

    say: Callable[[str], object]
    """Shows a permanent line."""
    show: Callable[[str], object]
    """Shows a line that the next line may replace."""


class Session(NamedTuple):
    """Interaction of a probe with the operator."""

    screen: Screen
    entered: asyncio.Event | None
    """Event that the operator sets to skip the requested push. None: no pushes are requested."""
    duration_s: float | None
    """Time for which the wrench is displayed, s. None: until Ctrl-C."""


@dataclass(frozen=True, slots=True)
class Stream:
    """Mean and variation of the frames over a period of time."""

    rate_hz: float
    mean: tuple[float, ...]
    """Mean wrench in the sensor frame, N and N·m."""
    rms: tuple[float, ...]
    """Root mean square deviation from the mean, per axis."""


@dataclass(frozen=True, slots=True)
class Findings:
    """Description of a sensor and its stream. Wrenches are in the sensor frame, N and N·m."""

    sensor: str
    """URL of the sensor."""
    full_scales: tuple[float, ...]
    """Full scales, N and N·m; empty if the device does not report them."""
    filter_delay_s: float
    stream_hz: float
    noise: tuple[float, ...]
    """Root mean square deviation of each axis from its mean, N and N·m."""
    wrench: tuple[float, ...]
    """Mean wrench, including the weight below the sensor, N and N·m."""
    notes: tuple[tuple[str, str], ...] = ()
    """Kind and text of each notice from the device."""

    @property
    def rows(self) -> Iterator[tuple[str, str]]:
        """Names and values of the findings, as text for display."""
        scales = self.full_scales
        yield "sensor", self.sensor
        yield (
            "full scales",
            f"{_row(scales, 0, 1)}; compare them with the sensor's name plate" if scales else "not reported",
        )
        yield "filter delay", f"{self.filter_delay_s * 1e3:.1f} ms"
        yield "stream", f"{self.stream_hz:.0f} frames per second"
        yield "noise", f"{_row(self.noise, 3, 4)} rms over {NOISE_S:g} s"
        yield "wrench", f"{_row(self.wrench, 2, 3)}, including the weight below the sensor"


def probe_sensor(url: str, config: Config, push: bool, duration_s: float | None) -> None:
    """Probe a sensor in real time until Ctrl-C, or for the given duration.

    If standard input is not a terminal, no pushes are requested. Raises ConfigError for an invalid URL,
    TransportUnavailable if the wire cannot be opened, DeviceError if the sensor does not stream.
    """
    by_hand = push and sys.stdin.isatty()
    redrawn = sys.stdout.isatty()
    screen = Screen(
        lambda text: click.echo(f"\r\x1b[K{text}" if redrawn else text),
        lambda text: click.echo(f"\r\x1b[K{text}", nl=False) if redrawn else click.echo(text),
    )

    async def main() -> None:
        clock, entered = Clock.running(), asyncio.Event()
        try:
            with _answers(entered) if by_hand else nullcontext():
                session = Session(screen, entered if by_hand else None, duration_s)
                probing = asyncio.create_task(probe(url, config, clock, session))
                for number in (signal.SIGINT, signal.SIGTERM):
                    with suppress(NotImplementedError):  # no signal handlers in loops of other platforms
                        clock.loop.add_signal_handler(number, probing.cancel)
                with suppress(asyncio.CancelledError):
                    await probing
        finally:
            clock.close()
            if redrawn:
                click.echo()

    run_real(main)


@contextmanager
def _answers(entered: asyncio.Event) -> Iterator[None]:
    """Set the event whenever Enter is pressed, inside the context."""
    loop, terminal = asyncio.get_running_loop(), sys.stdin.fileno()

    def read() -> None:
        if not os.read(terminal, 4096):  # the terminal is closed
            loop.remove_reader(terminal)
        entered.set()

    loop.add_reader(terminal, read)
    try:
        yield
    finally:
        loop.remove_reader(terminal)


def find_sensor(url: str, config: Config) -> Findings:
    """Observe a sensor in real time for NOISE_S, without an operator. Errors as for `probe_sensor`."""

    async def main() -> Findings:
        clock = Clock.running()
        notes: list[tuple[str, str]] = []
        try:
            async with _opened(url, config, clock, lambda kind, text: notes.append((kind, text))) as (
                sensor,
                recent,
            ):
                return replace(await _find(sensor, recent, url), notes=tuple(notes))
        finally:
            clock.close()

    return run_real(main)


async def probe(url: str, config: Config, clock: Clock, session: Session) -> None:
    """Open a sensor, describe it, request pushes if an operator is present, then show the wrench.

    Errors as for `probe_sensor`.
    """
    screen, entered, duration_s = session
    async with _opened(url, config, clock, lambda kind, text: screen.say(f"{kind}: {text}")) as (
        sensor,
        recent,
    ):
        findings = await _find(sensor, recent, url)
        for name, text in findings.rows:
            screen.say(f"{name:<13}{text}")
        if entered is not None:
            await _pushes(config, recent, findings.noise, screen, entered)
        await _live(recent, screen, duration_s)


@asynccontextmanager
async def _opened(
    url: str, config: Config, clock: Clock, note: Callable[[str, str], object]
) -> AsyncIterator[tuple[ForceSensor, "_RecentFrames"]]:
    """Open a streaming sensor and a view of its newest frames. `note` receives the device's notices."""
    frames: deque[WrenchFrame] = deque()

    def take(frame: WrenchFrame) -> None:
        frames.append(frame)
        while frame.at - frames[0].at > 2.0 * NOISE_S:
            frames.popleft()

    def pass_on(kind: str, text: str) -> None:
        if not sensor.has_failed:  # a failure is raised, so it is reported only once
            note(kind, text)

    sensor = await connect_sensor(sensor_at(config, url), Wiring("sensor", clock, CallbackLog(take, pass_on)))
    sensor.start()
    try:
        yield sensor, _RecentFrames(sensor, frames, clock)
    finally:
        await sensor.aclose()


class _RecentFrames:
    """Newest part of the stream."""

    def __init__(self, sensor: ForceSensor, frames: Sequence[WrenchFrame], clock: Clock) -> None:
        self._sensor = sensor
        self._frames = frames
        self._clock = clock

    async def after(self, seconds: float) -> None:
        """Wait for a time, s. Raises DeviceError or TransportError if the sensor ends during the wait."""
        await self._clock.sleep_until(self._clock.now() + seconds)
        self._sensor.check()

    def back(self, seconds: float) -> Stream:
        """Return the frames of the last `seconds`. Raises DeviceError if there are too few frames for a stream."""
        since = self._clock.now() - seconds
        recent = [self._sensor.wrench(frame) for frame in list(self._frames) if frame.at > since]
        if len(recent) < 2:
            raise DeviceError(
                f"force sensor on {self._sensor.name}: {len(recent)} frames in the last {seconds:g} s: it does not "
                "stream; check its supply, and whether another program stopped it"
            )
        axes = list(zip(*recent, strict=True))
        means = tuple(sum(axis) / len(axis) for axis in axes)
        rms = tuple(
            math.sqrt(sum((value - mean) ** 2 for value in axis) / len(axis))
            for axis, mean in zip(axes, means, strict=True)
        )
        return Stream(len(recent) / seconds, means, rms)


async def _find(sensor: ForceSensor, recent: _RecentFrames, url: str) -> Findings:
    """Return the self-description of the device, its stream, and the noise of each axis."""
    scales = (await sensor.ready()).full_scales
    try:
        async with asyncio.timeout(FIRST_S):
            await sensor.frame()
    except TimeoutError as error:
        raise DeviceError(
            f"force sensor on {sensor.name} reports that it streams, but sent no frame for {FIRST_S:g} s"
        ) from error
    await recent.after(NOISE_S)
    stream = recent.back(NOISE_S)
    return Findings(
        url, tuple(scales) if scales else (), sensor.delay, stream.rate_hz, stream.rms, stream.mean
    )


def _row(wrench: Sequence[float], force_digits: int, moment_digits: int) -> str:
    """Format six values with their names and units."""

    def part(axes: range, digits: int) -> str:
        # adding zero turns −0.0 into 0.0
        return "  ".join(f"{AXES[k].capitalize()} {round(wrench[k], digits) + 0.0:.{digits}f}" for k in axes)

    return f"{part(range(3), force_digits)} N  {part(range(3, 6), moment_digits)} N·m"


async def _live(recent: _RecentFrames, screen: Screen, duration_s: float | None) -> None:
    shown_at = 0.0
    while duration_s is None or shown_at < duration_s:
        await recent.after(SHOW_S)
        shown_at += SHOW_S
        screen.show(_row(recent.back(SHOW_S).mean, 2, 3))


async def _pushes(
    config: Config, recent: _RecentFrames, noise: Sequence[float], screen: Screen, entered: asyncio.Event
) -> None:
    """Request a push along each tool axis, and print the resulting mounting."""
    sits = wrist(config)
    responses: dict[int, PushResponse] = {}
    wrong = False
    for axis, name in enumerate("XYZ"):
        screen.say(f"push along +{name} of the tool and hold; Enter skips it")
        entered.clear()
        answer = await _push(recent, noise, screen, entered)
        if answer is None:
            screen.say(f"  +{name}: skipped")
            continue
        should = expect_push(sits, axis)
        off = angle_deg(answer.direction, should.direction)
        fits = off <= RIGHT_ANGLE_DEG
        verdict = "as configured" if fits else f"{off:.0f}° off the mounting in [sensor] of the configuration"
        screen.say(f"  +{name}: {answer.text}; {verdict}")
        if answer.sure or fits:
            responses[axis] = answer
        wrong |= not fits
    if not wrong:
        return
    mounting = mounting_of(responses)
    if mounting is None:
        screen.say("[sensor] cannot be determined without a clear push along all three axes; probe again")
        return
    screen.say(f"then set in [sensor] (the pushes deviate from it by {mounting.off_deg:.0f}° at most):")
    for line in mounting.settings:
        screen.say(f"  {line}")


async def _push(
    recent: _RecentFrames, noise: Sequence[float], screen: Screen, entered: asyncio.Event
) -> PushResponse | None:
    """Return the response to one push once it is held, or None if the operator pressed Enter or the wait timed out."""
    before = recent.back(NOISE_S).mean

    def held() -> PushResponse | None:
        stream = recent.back(HOLD_S)
        answer = judge_push(before, stream.mean, noise)
        steady = answer is not None and math.hypot(*stream.rms[:3]) <= STEADY_SHARE * answer.force_n
        return answer if steady else None

    answer = await _until(recent, screen, entered, held)
    if answer is not None:
        screen.say("  thank you; let go")
        least = push_threshold(noise)
        await _until(
            recent,
            screen,
            entered,
            lambda: math.dist(recent.back(2.0 * POLL_S).mean[:3], before[:3]) < least or None,
        )
        await recent.after(NOISE_S)
    return answer


async def _until(
    recent: _RecentFrames, screen: Screen, entered: asyncio.Event, poll: Callable[[], Value | None]
) -> Value | None:
    """Poll `seen` and return its first value, or None if the operator pressed Enter or the wait timed out."""
    for number in range(round(PATIENCE_S / POLL_S)):
        await recent.after(POLL_S)
        if (value := poll()) is not None or entered.is_set():
            return value
        if number % round(SHOW_S / POLL_S) == 0:
            screen.show(_row(recent.back(HOLD_S).mean, 2, 3))
    return None
