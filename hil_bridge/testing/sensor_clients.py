"""Tests that every force sensor client must pass, for the author's test module.

    import pytest
    from hil_bridge.testing import SensorCase
    from hil_bridge.testing.sensor_clients import *
    from my_package.room import SENSOR

    @pytest.fixture
    def sensor_client():
        return SensorCase(SENSOR, numbered=True)

The client is the object that `SENSOR.connect` returns. In virtual time, it reads the emulated sensor of the same kind,
to which the tests apply loads. `--hil-live KIND+URL` runs `test_live_sensor_frames` on a real sensor.
"""

import itertools
import math
from collections import deque
from collections.abc import Callable, Sequence
from contextlib import suppress
from typing import Any

import pytest

from hil_bridge.devices.sensors.stream import ForceSensor
from hil_bridge.errors import BridgeError
from hil_bridge.testing.cases import SensorCase, declared
from hil_bridge.testing.live import check_live_sensor
from hil_bridge.testing.naming import Finding, wrench_mistake
from hil_bridge.testing.rig import try_each_fault
from hil_bridge.testing.sensor_model import check_any_push
from hil_bridge.testing.sensor_rig import NOTHING, SensorRig, full_scales, run_sensor
from hil_bridge.testing.tampering import flipped, garbage, lengthened, shortened
from protocol.wrench import AXES, WrenchFrame

__all__ = [
    "test_any_sequence_of_pushes_and_zeros",
    "test_damaged_frames_are_not_believed",
    "test_every_frame_is_told_once",
    "test_frames_tell_the_wrench_in_the_right_frame_sign_and_unit",
    "test_frames_that_come_again_are_not_told_again",
    "test_live_sensor_frames",
    "test_lost_frames_advance_the_sequence",
    "test_nothing_is_told_while_the_sensor_is_silent",
    "test_overload_is_told_axis_by_axis",
    "test_pieces_of_frames_are_put_together",
    "test_sensor_client_cancelled_at_any_await_leaves_nothing",
    "test_sensor_client_stands_every_fault_in_every_phase",
    "test_zero_is_taken_off_in_the_unit_of_the_frame",
]

_SHARES = (0.05, -0.08, 0.11, 0.06, -0.09, 0.12)
"""Share of each axis' range to be loaded, different for every axis."""
_CUT_S = 0.1
"""Time for which the wire is cut, s. Chosen: frames are lost, and no client gives up."""
_RECENT = 100
"""Number of frames among which no counter may repeat. Chosen: fewer than a counter of one byte has values."""


def _allowed(rig: SensorRig, sensor: ForceSensor) -> list[float]:
    return [rig.case.noise * full for full in full_scales(rig.case, sensor.facts)]


async def _pushed(rig: SensorRig, sensor: ForceSensor, wrench: Sequence[float]) -> list[float]:
    rig.push(wrench)
    return await rig.settled(sensor)


def test_frames_tell_the_wrench_in_the_right_frame_sign_and_unit(sensor_client: SensorCase) -> None:
    """A force along +x is reported as +fx, a moment about +x as +mx, and so on, each alone and with the right
    magnitude.
    """

    async def check(rig: SensorRig) -> None:
        async with rig.started() as sensor:
            allowed, full = _allowed(rig, sensor), full_scales(rig.case, sensor.facts)
            before = await rig.settled(sensor)
            for axis in range(6):
                wrench = [0.0] * 6
                wrench[axis] = 0.3 * full[axis]
                reported = await _pushed(rig, sensor, wrench)
                change = [a - b for a, b in zip(reported, before, strict=True)]
                if mistake := wrench_mistake(change, wrench, [2.0 * one for one in allowed]):
                    raise Finding(mistake)

    run_sensor(sensor_client, check)


def test_zero_is_taken_off_in_the_unit_of_the_frame(sensor_client: SensorCase) -> None:
    async def check(rig: SensorRig) -> None:
        async with rig.started() as sensor:
            allowed, full = _allowed(rig, sensor), full_scales(rig.case, sensor.facts)
            first = [share * one for share, one in zip(_SHARES, full, strict=True)]
            raw = await _pushed(rig, sensor, first)
            await rig.within(sensor.tare(), "zero")
            reported = await rig.settled(sensor)
            _check_zero(reported, raw, allowed)
            after = await _pushed(rig, sensor, [1.5 * one for one in first])
            expected = [0.5 * one for one in first]
            if mistake := wrench_mistake(after, expected, [2.0 * one for one in allowed]):
                raise Finding(f"after a zero, {mistake}")
            await rig.within(sensor.tare(), "zero")
            _check_zero(await rig.settled(sensor), after, allowed)

    run_sensor(sensor_client, check)


def _check_zero(after: Sequence[float], before: Sequence[float], allowed: Sequence[float]) -> None:
    """Fail if a steady wrench does not read 0 after zeroing. The message names the unit if the zero was subtracted
    with another scale factor.
    """
    wrong = [k for k in range(6) if abs(after[k]) > 2.0 * allowed[k]]
    if not wrong:
        return
    k = wrong[0]
    text = f"the zero is wrong: {AXES[k]} was {before[k]:.4g}, and is {after[k]:.4g} after it"
    if abs(after[k] - before[k]) <= 2.0 * allowed[k] and abs(before[k]) > 4.0 * allowed[k]:
        raise Finding(f"{text}: it is not subtracted, or not in the unit of the frame")
    factor = (before[k] - after[k]) / before[k]
    raise Finding(f"{text}: {factor:.4g} times of it was subtracted, not in the unit of the frame")


def test_every_frame_is_told_once(sensor_client: SensorCase) -> None:
    """The client reports as many frames as the sensor sends. Each has a later time than the previous one and the
    next number.
    """

    async def check(rig: SensorRig) -> None:
        async with rig.started() as sensor:
            await rig.within(sensor.frame(), "frame")
            await rig.wait(0.2)
            rig.frames.clear()
            began = rig.clock.now()
            await rig.wait(1.0)
            frames = list(rig.frames)
            if not frames:
                raise Finding("the sensor sends, but no frame is reported")
            _check_rising(frames)
            steps = {b.sequence - a.sequence for a, b in itertools.pairwise(frames)}
            if max(steps) > 1.5 * min(steps) and sensor.facts.period is not None:
                raise Finding(f"frames are missing: their numbers increase by {sorted(steps)}")
            period = sensor.facts.period
            if period is not None and abs(len(frames) * period - 1.0) > 0.1:
                raise Finding(
                    f"{len(frames)} frames were reported in 1 s, but the sensor sends {1.0 / period:.0f}"
                )
            if any(not began <= frame.at <= rig.clock.now() for frame in frames):
                raise Finding("a frame has a time before its completion")
            if sensor.lost:
                raise Finding(f"{sensor.lost} frames are reported as lost, but none was")

    run_sensor(sensor_client, check)


def _check_rising(frames: Sequence[WrenchFrame]) -> None:
    for a, b in itertools.pairwise(frames):
        if b.sequence <= a.sequence:
            raise Finding(f"an old frame is reported as a new one: number {b.sequence} after {a.sequence}")
        if b.at < a.at:
            raise Finding(f"a frame is older than the previous one: {b.at:.6f} s after {a.at:.6f} s")


def test_nothing_is_told_while_the_sensor_is_silent(sensor_client: SensorCase) -> None:
    async def check(rig: SensorRig) -> None:
        with suppress(BridgeError):
            async with rig.started() as sensor:
                await rig.within(sensor.frame(), "frame")
                for wire in rig.wires:
                    wire.cut = True
                await rig.wait(0.05)
                rig.frames.clear()
                await rig.wait(1.0)
                frames = len(rig.frames)
                for wire in rig.wires:
                    wire.cut = False
                if frames:
                    raise Finding(
                        f"an old frame is reported as a new one: {frames} frames while the sensor was silent"
                    )

    run_sensor(sensor_client, check)


def test_frames_that_come_again_are_not_told_again(sensor_client: SensorCase) -> None:
    """Each arrival is followed by a copy of one 20 arrivals earlier, of which only the last datagram or frame comes
    again; the copies are not reported.
    """
    declared(sensor_client.numbered, "frames with a counter (SensorCase.numbered)")

    async def check(rig: SensorRig) -> None:
        with suppress(BridgeError):
            async with rig.started() as sensor:
                await rig.wait(0.5)
                wire = rig.wires[0]
                wire.alter = lambda data: (
                    data,
                    _last_of(wire.arrivals[-20 if len(wire.arrivals) > 20 else 0]),
                )
                rig.frames.clear()
                await rig.wait(0.5)
                _check_rising(rig.frames)
                _check_counters(rig.frames)
                wire.alter = None
                sensor.check()

    run_sensor(sensor_client, check)


def test_lost_frames_advance_the_sequence(sensor_client: SensorCase) -> None:
    """After a short cut, the sequence has increased in proportion to the time."""
    declared(sensor_client.numbered, "frames with a counter (SensorCase.numbered)")

    async def check(rig: SensorRig) -> None:
        async with rig.started():
            await rig.wait(0.3)
            rig.frames.clear()
            await rig.wait(0.2)
            before = list(rig.frames)
            for wire in rig.wires:
                wire.cut = True
            await rig.wait(_CUT_S)
            for wire in rig.wires:
                wire.cut = False
            await rig.wait(0.1)
            if len(before) < 2 or rig.frames[-1] is before[-1]:
                raise Finding(f"no frame is reported before or after a cut of {_CUT_S:g} s")
            steps, expected = _advance(before[-1], rig.frames[-1]), _advance(before[0], before[-1])
            if not 0.9 < steps / expected < 1.1:
                raise Finding(
                    f"after a cut, the sequence has increased by {steps:.0f} a second, before by {expected:.0f}"
                )

    run_sensor(sensor_client, check)


def _advance(first: WrenchFrame, last: WrenchFrame) -> float:
    """Return the increase of the sequence per second."""
    return (last.sequence - first.sequence) / (last.at - first.at)


def _check_counters(frames: Sequence[WrenchFrame]) -> None:
    recent: deque[int] = deque(maxlen=_RECENT)
    for frame in frames:
        if frame.counter in recent:
            raise Finding(f"an old frame is reported as a new one: counter {frame.counter} comes again")
        recent.append(frame.counter)


def _last_of(arrival: Any) -> Any:
    return arrival if isinstance(arrival, (bytes, bytearray)) else arrival[-1:]


def test_overload_is_told_axis_by_axis(sensor_client: SensorCase) -> None:
    declared(sensor_client.overload, "a detectable overload (SensorCase.overload)")

    async def check(rig: SensorRig) -> None:
        async with rig.started() as sensor:
            full = full_scales(rig.case, sensor.facts)
            ends = sensor.facts.range or full
            await rig.settled(sensor)
            for axis in range(6):
                for sign in (1.0, -1.0):
                    wrench = list(NOTHING)
                    wrench[axis] = sign * rig.case.overload * max(full[axis], ends[axis])
                    await _pushed(rig, sensor, wrench)
                    if not all(frame.saturated >> axis & 1 for frame in rig.frames[-5:]):
                        raise Finding(
                            f"an overload is not reported: {AXES[axis]} is {wrench[axis]:.4g}, beyond its range of "
                            f"{full[axis]:.4g}, and `saturated` has no bit for it"
                        )
            await _pushed(rig, sensor, NOTHING)
            if rig.frames[-1].saturated:
                raise Finding(f"an overload is reported without a cause: {rig.frames[-1].saturated:06b}")

    run_sensor(sensor_client, check)


def _frames_with(
    case: SensorCase, alter: Callable[[Any, int], Sequence[Any]] | None
) -> list[tuple[float, ...]]:
    """Return the values of the frames that arrive in half a second while arrivals are altered, N and N·m, without
    zeroing.
    """
    reported: list[tuple[float, ...]] = []

    async def check(rig: SensorRig) -> None:
        count = 0

        def meddle(data: Any) -> Sequence[Any]:
            nonlocal count
            count += 1
            return alter(data, count) if alter is not None else (data,)

        with suppress(BridgeError):
            async with rig.started() as sensor:
                await rig.within(sensor.frame(), "frame")
                rig.push([0.3 * full for full in full_scales(rig.case, sensor.facts)])
                await rig.wait(rig.case.settle_s)
                rig.frames.clear()
                for wire in rig.wires:
                    wire.alter = meddle
                with suppress(BridgeError):
                    await rig.wait(0.5)
                    sensor.check()
                _check_rising(rig.frames)
                reported.extend(frame.values for frame in rig.frames)
                for wire in rig.wires:
                    wire.alter = None

    run_sensor(case, check)
    return reported


@pytest.mark.parametrize("damage", ["flipped", "shortened", "lengthened", "garbage"])
def test_damaged_frames_are_not_believed(sensor_client: SensorCase, damage: str) -> None:
    """Every third arrival is damaged. Frames may be missing, but none may contain a value that no undamaged frame
    had.
    """
    if damage == "flipped":
        declared(sensor_client.checked, "frames with a checksum (SensorCase.checked)")
    alter: Callable[[Any], Sequence[Any]] = {
        "flipped": lambda data: (data,),
        "shortened": lambda data: (shortened(data),),
        "lengthened": lambda data: (lengthened(data),),
        "garbage": lambda data: (garbage(data), data),
    }[damage]

    def every_third(data: Any, count: int) -> Sequence[Any]:
        if count % 3:
            return (data,)
        return (flipped(data, 13 * count),) if damage == "flipped" else alter(data)

    good = set(_frames_with(sensor_client, None))
    reported = _frames_with(sensor_client, every_third)
    false = [values for values in reported if values not in good]
    if false:
        raise Finding(
            f"a damaged frame ({damage}) is accepted, its checksum was ignored: it contains {false[0]}"
        )


def test_pieces_of_frames_are_put_together(sensor_client: SensorCase) -> None:
    """A byte wire splits data anywhere: data arrive in pieces of 1, 3, 7 and 50 bytes."""
    kept = b""

    _check_byte_wire(sensor_client)

    def pieces(size: int) -> Callable[[Any, int], Sequence[Any]]:
        def cut(data: Any, count: int) -> Sequence[Any]:
            nonlocal kept
            kept += data
            ready = len(kept) - len(kept) % size
            complete, kept = kept[:ready], kept[ready:]
            return [complete[k : k + size] for k in range(0, len(complete), size)]

        return cut

    good = _frames_with(sensor_client, None)
    for size in (1, 3, 7, 50):
        kept = b""
        reported = _frames_with(sensor_client, pieces(size))
        # the last pieces may not have arrived, and the answers to a polling client may be delayed
        if any(values not in good for values in reported) or len(reported) < 0.8 * len(good):
            raise Finding(
                f"a frame in pieces of {size} bytes is reassembled incorrectly: {len(reported)} of {len(good)} "
                f"frames were reported, {sum(values not in good for values in reported)} of them false"
            )


def _check_byte_wire(case: SensorCase) -> None:
    """Skip the test if the first arrival does not consist of bytes."""

    async def check(rig: SensorRig) -> None:
        async with rig.started():
            if not isinstance(rig.wires[0].arrivals[0], (bytes, bytearray)):
                pytest.skip("not a byte wire: data are not split")

    run_sensor(case, check)


def test_sensor_client_cancelled_at_any_await_leaves_nothing(sensor_client: SensorCase) -> None:
    """Cancel a session at its first await, its second, and so on to its end. Its wire must be closed, and no task
    may remain.
    """

    async def check(rig: SensorRig) -> None:
        async def session() -> None:
            sensor = await rig.connect()
            try:
                sensor.start()
                await sensor.ready()
                await sensor.tare()
                await sensor.frame()
            finally:
                await sensor.aclose()

        await rig.cancel_everywhere(session)

    run_sensor(sensor_client, check)


@pytest.mark.parametrize("phase", ["start", "stream"])
def test_sensor_client_stands_every_fault_in_every_phase(sensor_client: SensorCase, phase: str) -> None:
    """Under each fault of the emulator, calls raise only BridgeError, no call waits forever, and frames are finite."""
    assert sensor_client.kind.emulation is not None

    def attempt(target: str, fault: str) -> None:
        async def check(rig: SensorRig) -> None:
            if phase == "start":
                rig.inject(target, fault)
            with suppress(BridgeError):
                async with rig.started() as sensor:
                    rig.inject(target, fault)
                    await rig.wait(0.15)
                    for frame in rig.frames:
                        if not all(map(math.isfinite, frame.values)):
                            raise Finding(f"a frame contains {frame.values}, which is not a number")
                    sensor.check()

        run_sensor(sensor_client, check)

    try_each_fault(sensor_client.kind, phase, attempt)


def test_any_sequence_of_pushes_and_zeros(sensor_client: SensorCase) -> None:
    """Loads, zeros, cuts and pauses in any order agree with a model of the sensor."""
    check_any_push(sensor_client)


def test_live_sensor_frames(sensor_client: SensorCase, hil_live: list[str]) -> None:
    """Frames of a real sensor arrive at its rate and are finite; after zeroing they are about 0."""
    check_live_sensor(sensor_client, hil_live)
