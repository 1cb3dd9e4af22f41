"""`hil-bridge probe sensor`: what a force sensor reports about itself, its mounting, and its wrench.

Nothing is sent but the requests of a run's start, and no zero. The wrench shown is the device's own, with the weight of
all that hangs below the sensor in it.
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
    Answer,
    angle_deg,
    expect_push,
    judge_push,
    mounting_of,
    push_threshold,
)
from protocol.wrench import AXES, WrenchFrame

NOISE_S = 1.0
"""Time for the stream's rate and noise, and for the force before a push. Chosen."""
HOLD_S = 0.5
"""Time for which a push must be held. Chosen."""
LOOK_S = 0.1
"""How often it is looked for. Chosen."""
PATIENCE_S = 60.0
"""Longest wait for a push, and then for its end. Chosen: an operator has to walk to the cell."""
FIRST_S = 5.0
"""For how long the first frame is waited for once the device says that it streams. Chosen: behind the slowest filter
of a UART gateway it comes within a second.
"""
SHOW_S = 1.0
"""Time from one live line to the next."""
STEADY_SHARE = 0.25
"""How much a push that is held may vary, rms, as a share of itself. Chosen: more is a knock, or a hand on its way."""

Seen = TypeVar("Seen")


@dataclass(frozen=True, slots=True)
class Screen:
    """Screen of a probe."""

    say: Callable[[str], object]
    """Shown a line that stays."""
    show: Callable[[str], object]
    """Shown a line that the next one may replace."""


class Session(NamedTuple):
    """The person's side of a probe."""

    screen: Screen
    entered: asyncio.Event | None
    """Set by an operator to continue without the push that is asked for; None: no pushes are asked for."""
    duration_s: float | None
    """For how long the wrench is shown, s; None: until Ctrl-C."""


@dataclass(frozen=True, slots=True)
class Stream:
    """Frames over a stretch of time."""

    rate_hz: float
    mean: tuple[float, ...]
    """Mean wrench in the sensor frame, N and N·m."""
    rms: tuple[float, ...]
    """About the mean, per axis."""


@dataclass(frozen=True, slots=True)
class Findings:
    """Facts that a sensor tells of itself and of its stream. Wrenches are in the sensor frame, N and N·m."""

    sensor: str
    """Its URL."""
    full_scales: tuple[float, ...]
    """Empty where the device does not tell them."""
    filter_delay_s: float
    stream_hz: float
    noise: tuple[float, ...]
    """Root mean square of each axis about its mean."""
    wrench: tuple[float, ...]
    """Mean, the weight below the sensor included."""
    notes: tuple[tuple[str, str], ...] = ()
    """Kinds and texts of what the device told meanwhile."""

    @property
    def rows(self) -> Iterator[tuple[str, str]]:
        """Names and texts, for people."""
        scales = self.full_scales
        yield "sensor", self.sensor
        yield (
            "full scales",
            f"{_row(scales, 0, 1)}; compare them with the sensor's plate" if scales else "not told",
        )
        yield "filter delay", f"{self.filter_delay_s * 1e3:.1f} ms"
        yield "stream", f"{self.stream_hz:.0f} frames a second"
        yield "noise", f"{_row(self.noise, 3, 4)} rms over {NOISE_S:g} s"
        yield "wrench", f"{_row(self.wrench, 2, 3)}, the weight below the sensor included"


def probe_sensor(url: str, config: Config, push: bool, duration_s: float | None) -> None:
    """Probe in real time until Ctrl-C, or for so long.

    Without a terminal to answer on, no pushes are asked for. Raises ConfigError for the URL, TransportUnavailable for
    the wire, DeviceError for a sensor that does not stream.
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
    """Set the event whenever Enter is pressed."""
    loop, terminal = asyncio.get_running_loop(), sys.stdin.fileno()

    def read() -> None:
        if not os.read(terminal, 4096):  # the terminal has gone
            loop.remove_reader(terminal)
        entered.set()

    loop.add_reader(terminal, read)
    try:
        yield
    finally:
        loop.remove_reader(terminal)


def find_sensor(url: str, config: Config) -> Findings:
    """Look at a sensor in real time for NOISE_S, without an operator. Errors as of `probe_sensor`."""

    async def main() -> Findings:
        clock = Clock.running()
        notes: list[tuple[str, str]] = []
        try:
            async with _opened(url, config, clock, lambda kind, text: notes.append((kind, text))) as (
                sensor,
                look,
            ):
                return replace(await _find(sensor, look, url), notes=tuple(notes))
        finally:
            clock.close()

    return run_real(main)


async def probe(url: str, config: Config, clock: Clock, session: Session) -> None:
    """Open a sensor, tell of it, ask for pushes where an operator answers, then show the wrench; errors as above."""
    screen, entered, duration_s = session
    async with _opened(url, config, clock, lambda kind, text: screen.say(f"{kind}: {text}")) as (
        sensor,
        look,
    ):
        found = await _find(sensor, look, url)
        for name, text in found.rows:
            screen.say(f"{name:<13}{text}")
        if entered is not None:
            await _pushes(config, look, found.noise, screen, entered)
        await _live(look, screen, duration_s)


@asynccontextmanager
async def _opened(
    url: str, config: Config, clock: Clock, note: Callable[[str, str], object]
) -> AsyncIterator[tuple[ForceSensor, "_Look"]]:
    """Open a sensor that streams, and a view of its last moments. `note` receives the device's notices."""
    frames: deque[WrenchFrame] = deque()

    def take(frame: WrenchFrame) -> None:
        frames.append(frame)
        while frame.at - frames[0].at > 2.0 * NOISE_S:
            frames.popleft()

    def pass_on(kind: str, text: str) -> None:
        if not sensor.has_failed:  # its failure is raised, and so said once
            note(kind, text)

    sensor = await connect_sensor(sensor_at(config, url), Wiring("sensor", clock, CallbackLog(take, pass_on)))
    sensor.start()
    try:
        yield sensor, _Look(sensor, frames, clock)
    finally:
        await sensor.aclose()


class _Look:
    """The stream of the last moments."""

    def __init__(self, sensor: ForceSensor, frames: Sequence[WrenchFrame], clock: Clock) -> None:
        self._sensor = sensor
        self._frames = frames
        self._clock = clock

    async def after(self, seconds: float) -> None:
        """Wait. Raises DeviceError or TransportError when the sensor has ended meanwhile."""
        await self._clock.sleep_until(self._clock.now() + seconds)
        self._sensor.check()

    def back(self, seconds: float) -> Stream:
        """Frames of the last so many seconds. Raises DeviceError when they are no stream."""
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


async def _find(sensor: ForceSensor, look: _Look, url: str) -> Findings:
    """Facts that the device tells of itself and of its stream, and the noise of each axis."""
    scales = (await sensor.ready()).full_scales
    try:
        async with asyncio.timeout(FIRST_S):
            await sensor.frame()
    except TimeoutError as error:
        raise DeviceError(
            f"force sensor on {sensor.name} reports that it streams, but sent no frame for {FIRST_S:g} s"
        ) from error
    await look.after(NOISE_S)
    stream = look.back(NOISE_S)
    return Findings(
        url, tuple(scales) if scales else (), sensor.delay, stream.rate_hz, stream.rms, stream.mean
    )


def _row(wrench: Sequence[float], force_digits: int, moment_digits: int) -> str:
    """Six values with their names and units."""

    def part(axes: range, digits: int) -> str:
        # adding zero turns −0.0 into 0.0
        return "  ".join(f"{AXES[k].capitalize()} {round(wrench[k], digits) + 0.0:.{digits}f}" for k in axes)

    return f"{part(range(3), force_digits)} N  {part(range(3, 6), moment_digits)} N·m"


async def _live(look: _Look, screen: Screen, duration_s: float | None) -> None:
    shown = 0.0
    while duration_s is None or shown < duration_s:
        await look.after(SHOW_S)
        shown += SHOW_S
        screen.show(_row(look.back(SHOW_S).mean, 2, 3))


async def _pushes(
    config: Config, look: _Look, noise: Sequence[float], screen: Screen, entered: asyncio.Event
) -> None:
    """Ask for a push along each axis of the tool, and say what the answers mean."""
    sits = wrist(config)
    found: dict[int, Answer] = {}
    wrong = False
    for axis, name in enumerate("XYZ"):
        screen.say(f"push along +{name} of the tool and hold; Enter skips it")
        entered.clear()
        answer = await _push(look, noise, screen, entered)
        if answer is None:
            screen.say(f"  +{name}: skipped")
            continue
        should = expect_push(sits, axis)
        off = angle_deg(answer.direction, should.direction)
        fits = off <= RIGHT_ANGLE_DEG
        verdict = "as configured" if fits else f"{off:.0f}° off the mounting in [sensor] of the configuration"
        screen.say(f"  +{name}: {answer.text}; {verdict}")
        if answer.sure or fits:
            found[axis] = answer
        wrong |= not fits
    if not wrong:
        return
    mounting = mounting_of(found)
    if mounting is None:
        screen.say("[sensor] cannot be determined without a clear push along all three axes; probe again")
        return
    screen.say(f"then set in [sensor] (the pushes deviate from it by {mounting.off_deg:.0f}° at most):")
    for line in mounting.settings:
        screen.say(f"  {line}")


async def _push(look: _Look, noise: Sequence[float], screen: Screen, entered: asyncio.Event) -> Answer | None:
    """Return the answer to one push once it is held; None if an operator pressed Enter or the wait ran out."""
    before = look.back(NOISE_S).mean

    def held() -> Answer | None:
        stream = look.back(HOLD_S)
        answer = judge_push(before, stream.mean, noise)
        steady = answer is not None and math.hypot(*stream.rms[:3]) <= STEADY_SHARE * answer.force_n
        return answer if steady else None

    answer = await _until(look, screen, entered, held)
    if answer is not None:
        screen.say("  thank you; let go")
        least = push_threshold(noise)
        await _until(
            look,
            screen,
            entered,
            lambda: math.dist(look.back(2.0 * LOOK_S).mean[:3], before[:3]) < least or None,
        )
        await look.after(NOISE_S)
    return answer


async def _until(
    look: _Look, screen: Screen, entered: asyncio.Event, seen: Callable[[], Seen | None]
) -> Seen | None:
    """Poll `seen` and return its first value; None once an operator pressed Enter or the wait ran out."""
    for number in range(round(PATIENCE_S / LOOK_S)):
        await look.after(LOOK_S)
        if (found := seen()) is not None or entered.is_set():
            return found
        if number % round(SHOW_S / LOOK_S) == 0:
            screen.show(_row(look.back(HOLD_S).mean, 2, 3))
    return None
