"""Force/torque sensor for the control cycle. Control uses the newest frame, the recorder every frame."""

import asyncio
import math
from collections import deque
from collections.abc import Sequence
from contextlib import suppress
from itertools import takewhile
from typing import Any, Protocol

from hil_bridge.clock import Clock
from hil_bridge.devices.device_log import DeviceLog
from hil_bridge.devices.sensors.axis_watch import AxisWatch
from hil_bridge.devices.sensors.lateness_watch import LatenessWatch
from hil_bridge.devices.sensors.replay_watch import ReplayWatch
from hil_bridge.errors import BridgeError, Cause, DeviceError, TransportClosed
from hil_bridge.errors.event_kinds import EventKind
from hil_bridge.errors.failures import code_failed
from hil_bridge.transports import Transport
from hil_bridge.transports.pump import Pump
from protocol.geometry import Wrench
from protocol.wrench import (
    AXES,
    SensorClient,
    SensorEvent,
    SensorFacts,
    SensorFailed,
    SensorNotice,
    SensorReady,
    SensorRestarted,
    SensorStopped,
    WrenchFrame,
    Zeroed,
    wrench_of,
)

_HISTORY = 256
"""Minimum number of frames in the history. Chosen: 2.6 s of the default stream, which covers several answers of the
robot's link.
"""
_HISTORY_S = 2.56
"""Duration of the history of a faster stream, s. Chosen: as for the default stream."""
_HISTORY_LIMIT = 20_000
"""Maximum number of frames in the history. Chosen: the number for a stream at 7 kHz."""


READY_S = 60.0
"""Longest start-up of a sensor, s, regardless of the client's own limit. Chosen: a UART gateway takes approximately
ten seconds.
"""


class FrameJudge(Protocol):
    """Tracker of the extremes of all frames until they are read. `values` are six counts in the order of `AXES`.

    Forces are relative to the newest zero, in newtons; a pressing force is positive along the approach.
    """

    saturated: bool
    """Whether any frame was at the end of the sensor's range."""

    def frame(self, values: Sequence[float]) -> None:
        """Process a frame on its arrival."""

    def rezero(self, wrench: Sequence[float]) -> None:
        """Use this contact wrench as the zero, N and N·m in the tool frame."""

    def along(self, values: Sequence[float]) -> float:
        """Return the contact force of a frame along the approach, N."""

    def resultant(self, values: Sequence[float]) -> float:
        """Return the magnitude of the contact force of a frame, N."""

    def take(self) -> tuple[float, float, float, bool]:
        """Return the extremes since the last call: force along the approach and resultant in N, moment in N·m,
        saturation.
        """


class ForceSensor:
    """Force sensor of any manufacturer. `client` implements its protocol over `transport`; `log` receives every
    frame and notice.
    """

    def __init__(
        self, transport: Transport[Any], client: SensorClient[Any], clock: Clock, log: DeviceLog
    ) -> None:
        self.name = transport.name
        self.newest: WrenchFrame | None = None
        """Newest frame; None until the first frame, and after a zero until the next frame."""
        self.decoded_at = math.nan
        """Time at which the newest frame had been decoded, s on the run's clock; `at` of the frame is its arrival."""
        self.received = 0
        """Number of complete frames received."""
        self.repeated = 0
        """Number of consecutive frames up to the newest that have identical values on all axes."""
        self.unchanged_since = math.nan
        """Arrival of the first of these identical frames, s on the run's clock."""
        self.saturated_axes = 0
        """Bit mask of saturated axes. Bit k is set if axis k was at the end of its range in the newest frame."""
        self.peaks: FrameJudge | None = None
        """Judge that receives every frame; None while frames are not evaluated."""
        self._history: deque[WrenchFrame] = deque(maxlen=_HISTORY)
        self._transport = transport
        self._clock = clock
        self._log = log
        self._client = client
        self._pump: Pump[Any, SensorEvent] = Pump(client, transport, clock, self._take, self._ended)
        self.zeroed_from: WrenchFrame | None = None
        """Newest frame at the time when the device reported that it had taken its zero; None before."""
        self._facts: SensorFacts | None = None
        self._watch: AxisWatch
        """Watch over the axes, active since the device was ready."""
        self._lateness = LatenessWatch(None)
        self._replay = ReplayWatch(_HISTORY)
        self._converted: WrenchFrame | None = None
        """Frame whose wrench was computed last; None before the first."""
        self._wrench: Wrench = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
        """Wrench of the frame `_converted`."""
        self._failure: BridgeError | None = None
        self._waiters: list[tuple[type, asyncio.Future[None]]] = []

    @property
    def lost(self) -> int:
        """Number of frames that were sent according to the frame counter but never arrived."""
        return self._client.statistics.lost

    @property
    def stands(self) -> str:
        """Description of a device whose frames continue while its frame counter does not; "" if the counter
        advances.
        """
        if not self._client.statistics.stands:
            return ""
        return "frames arrive, but their counter does not change, as after the sensor is unplugged"

    @property
    def is_ready(self) -> bool:
        """Whether the device has started to stream, so that its facts are known."""
        return self._facts is not None

    @property
    def facts(self) -> SensorFacts:
        """Facts that the device reports about itself. Available once the device is ready."""
        assert self._facts is not None, "the device is ready first"
        return self._facts

    @property
    def delay(self) -> float:
        """Delay of the device's filter, s. Available once the device is ready."""
        return self.facts.delay

    @property
    def late(self) -> float:
        """Lateness of the newest frame relative to the device's earliest frames, s; 0 if it is jitter."""
        return self._lateness.late

    @property
    def newest_at(self) -> float:
        """Time of the newest information, s: the arrival of the newest frame minus the lateness of the stream, or,
        if the stream repeats an earlier part, the start of the repetition. NaN before the first frame.
        """
        if self.newest is None:
            return math.nan
        at, since = self.newest.at - self.late, self._replay.since
        return min(at, since) if since == since else at

    @property
    def saturated(self) -> tuple[str, ...]:
        """Axes that were at the end of their range in the newest frame."""
        bits = self.saturated_axes
        return tuple([axis for k, axis in enumerate(AXES) if bits >> k & 1]) if bits else ()

    @property
    def dead(self) -> tuple[int, ...]:
        """Numbers of the axes that have not changed for a long time since the zero although another axis moved far."""
        return self._watch.dead

    def start(self) -> None:
        """Start receiving and initialize the device. Frames may come together while no task waits for one."""
        self._clock.may_defer = True
        self._pump.start()

    async def ready(self) -> SensorFacts:
        """Wait until the device streams, and return its facts.

        Raises DeviceError with the reason if the device stays silent, has no sensor, or reports an impossible full
        scale.
        """
        if self._facts is None:
            try:
                async with asyncio.timeout(READY_S):
                    await self._until(SensorReady)
            except TimeoutError:
                raise DeviceError(
                    f"force sensor on {self.name} has not begun to stream within {READY_S:g} s",
                    remedy="check its supply, its cable and its address",
                    cause=Cause.STREAM,
                ) from None
        return self.facts

    async def tare(self) -> None:
        """Let the device set its present filtered output as zero. Earlier frames are discarded.

        The output before the zero is checked first, because a zero shifts the values but not the end of the range.
        """
        await self.frame()
        self._client.zero()
        self._pump.kick()
        await self._until(Zeroed)

    async def frame(self) -> WrenchFrame:
        """Return the newest frame; wait for one if none has arrived since the sensor was zeroed."""
        if self.newest is None:
            await self._until(WrenchFrame)
        assert self.newest is not None
        return self.newest

    def window(self, since: float) -> list[tuple[float, ...]]:
        """Return the wrenches (see `wrench`) of the stored frames that arrived after this time, s, oldest first."""
        newer = takewhile(lambda frame: frame.at > since, reversed(self._history))
        return [self.wrench(frame) for frame in reversed(list(newer))]

    @property
    def has_failed(self) -> bool:
        """Whether the stream has ended with a failure."""
        return self._failure is not None

    def check(self) -> None:
        """Raise the failure that ended the sensor, if any. The control cycle calls this before it uses the newest
        frame.
        """
        if self._failure is not None:
            raise self._failure

    def wrench(self, frame: WrenchFrame) -> Wrench:
        """Return the wrench of a frame in the sensor frame: fx fy fz mx my mz, in N and N·m."""
        if frame is not self._converted:
            assert self._facts is not None, "no frame comes before the facts"
            self._wrench = wrench_of(frame.values, self._facts.scales)
            self._converted = frame
        return self._wrench

    def wrench_at(self, at: float) -> tuple[float, ...] | None:
        """Return the wrench at a past arrival time, interpolated linearly between frames.

        After the newest frame, return the wrench of the newest frame. Before the oldest stored frame since the last
        tare, return None.
        """
        later: WrenchFrame | None = None
        for frame in reversed(self._history):
            if frame.at <= at:
                if later is None:
                    return self.wrench(frame)
                share = (at - frame.at) / (later.at - frame.at)
                after = self.wrench(later)  # computed first, because the newest wrench is cached
                before = self.wrench(frame)
                return tuple([a + share * (b - a) for a, b in zip(before, after, strict=True)])
            later = frame
        return None

    async def aclose(self) -> None:
        """Stop the stream, wait until the device acknowledges this, and close the wire.

        The time is sufficient for a second stop request, in case the device misses the first one.
        """
        try:
            if self._failure is None:
                self._client.stop()
                self._pump.kick()
                with suppress(BridgeError, TimeoutError):
                    async with asyncio.timeout(self._client.stop_patience):
                        await self._until(SensorStopped)
        finally:  # even if the wait is cancelled
            await self._transport.aclose()

    async def _until(self, event: type) -> None:
        self.check()
        waiter: asyncio.Future[None] = asyncio.get_running_loop().create_future()
        self._waiters.append((event, waiter))
        self._clock.may_defer = False
        try:
            await waiter
        finally:
            self._clock.may_defer = not self._waiters

    def _take(self, event: SensorEvent) -> None:
        match event:
            case WrenchFrame():
                if not math.isfinite(sum(event.values, event.at)):  # no limit detects NaN
                    text = f"force sensor on {self.name} reported a value that is not a number: {event}"
                    self._fail(DeviceError(text))
                    return
                previous = self.newest
                same = previous is not None and previous.values == event.values
                self.repeated = self.repeated + 1 if same else 0
                if not same:
                    self.unchanged_since = event.at
                self.newest = event
                self.decoded_at = self._clock.now()
                self._history.append(event)
                self._watch.frame(event.values, event.at)
                self._replay.frame(event.values, event.at)
                self.saturated_axes = event.saturated
                if (peaks := self.peaks) is not None:
                    peaks.frame(event.values)
                    if event.saturated:
                        peaks.saturated = True
                self.received += 1
                self._lateness.frame(event.at, self.received + self._client.statistics.lost)
                self._log.frame(event)
            case SensorReady(facts=facts):
                self._facts, self._converted = facts, None
                if facts.period is not None:
                    frames = min(max(_HISTORY, math.ceil(_HISTORY_S / facts.period)), _HISTORY_LIMIT)
                    self._history = deque(self._history, maxlen=frames)
                self._watch = AxisWatch(facts)
                self._lateness = LatenessWatch(facts.period)
                self._replay = ReplayWatch(self._history.maxlen or _HISTORY)
            case Zeroed(crossing=crossing):
                if crossing is not None:
                    self.received += 1
                    self._log.frame(crossing)
                self._watch.zeroed()
                self._lateness.begin()
                self._replay.zeroed()
                self.zeroed_from = self.newest
                self.newest = None
                self._history.clear()
            case SensorNotice(text=text):
                self._log.notice(EventKind.SENSOR, text)
            case SensorFailed(text=text, remedy=remedy):
                self._fail(DeviceError(f"force sensor on {self.name}: {text}", remedy=remedy))
            case SensorRestarted():
                if self._facts is None:
                    self._log.notice(EventKind.SENSOR, "the device booted")
                else:
                    self._fail(
                        DeviceError(
                            f"force sensor on {self.name} restarted in mid-run; its zero is lost",
                            remedy="check its supply, then start again",
                        )
                    )
        if self._waiters:
            self._wake(type(event))

    def _wake(self, event: type) -> None:
        done = [waiter for kind, waiter in self._waiters if kind is event]
        self._waiters = [pair for pair in self._waiters if pair[0] is not event]
        for waiter in done:
            if not waiter.done():
                waiter.set_result(None)

    def _ended(self, cause: BaseException) -> None:
        self._fail(
            code_failed(f"force sensor {self.name}", cause, Cause.SENSOR_FAILED),
            quiet=isinstance(cause, TransportClosed),
        )

    def _fail(self, failure: BridgeError, quiet: bool = False) -> None:
        if self._failure is not None:
            return
        failure.blame(Cause.SENSOR_FAILED)
        self._failure = failure
        if not quiet:
            self._log.notice(EventKind.SENSOR, str(failure))
        waiters, self._waiters = self._waiters, []
        for _, waiter in waiters:
            if not waiter.done():
                waiter.set_exception(failure)
