"""Tests that every force sensor emulator must pass, for the author's test module.

    import pytest
    from hil_bridge.testing import SensorCase
    from hil_bridge.testing.sensor_emulators import *
    from my_package.room import SENSOR

    @pytest.fixture
    def sensor_emulator():
        return SensorCase(SENSOR)

The tests use only the interface `emulators.seams.EmulatedSensor`, and read frames through the client of the same kind.
"""

from contextlib import suppress

import pytest

from hil_bridge.errors import BridgeError
from hil_bridge.testing.cases import SensorCase
from hil_bridge.testing.naming import Finding, wrench_mistake
from hil_bridge.testing.rig import DAMAGES
from hil_bridge.testing.sensor_rig import NOTHING, SensorRig, full_scales, run_sensor
from protocol.wrench import AXES, wrench_of

__all__ = [
    "test_change_that_was_read_ahead_is_heeded",
    "test_every_fault_of_the_sensor_can_begin",
    "test_hostile_bytes_do_not_break_it",
    "test_overload_stays_at_the_end_of_the_range",
    "test_same_seed_tells_the_same",
    "test_sample_has_a_time",
    "test_wrench_is_not_told_before_it_is_felt",
]


def _reported_frames(case: SensorCase) -> list[tuple[float, ...]]:
    reported: list[tuple[float, ...]] = []

    async def check(rig: SensorRig) -> None:
        async with rig.started() as sensor:
            await rig.within(sensor.frame(), "frame")
            rig.push([0.1 * one for one in full_scales(case, sensor.facts)])
            await rig.wait(0.3)
            reported.extend(frame.values for frame in rig.frames)

    run_sensor(case, check)
    return reported


def test_same_seed_tells_the_same(sensor_emulator: SensorCase) -> None:
    first, again = _reported_frames(sensor_emulator), _reported_frames(sensor_emulator)
    if first != again:
        raise Finding("two sensors with the same seed and load reported different values")


def test_sample_has_a_time(sensor_emulator: SensorCase) -> None:
    """`sampled_at` of each sample is shortly before the arrival of its frame, and increases."""

    async def check(rig: SensorRig) -> None:
        async with rig.started() as sensor:
            await rig.within(sensor.frame(), "frame")
            newest = -1.0
            for _ in range(20):
                await rig.wait(0.02)
                frame = rig.frames[-1]
                at = rig.sensor.sampled_at(frame.counter)
                if at is None:
                    raise Finding(f"the sensor has no measurement time for its sample {frame.counter}")
                if not frame.at - 1.0 < at <= frame.at + 1e-6:
                    raise Finding(
                        f"sample {frame.counter} arrived at {frame.at:.4f} s, but its measurement time is {at:.4f} s"
                    )
                if at < newest:
                    raise Finding("a later sample was measured earlier")
                newest = at

    run_sensor(sensor_emulator, check)


def test_wrench_is_not_told_before_it_is_felt(sensor_emulator: SensorCase) -> None:
    """Until the time of a wrench step, every sample reports the previous wrench."""

    async def check(rig: SensorRig) -> None:
        async with rig.started() as sensor:
            before, full = await rig.settled(sensor), full_scales(rig.case, sensor.facts)
            await rig.wait(0.0137)
            stepped_at = rig.clock.now()
            rig.push([0.3 * one for one in full])
            rig.frames.clear()
            await rig.wait(0.5)
            early = [
                frame
                for frame in rig.frames
                if (rig.sensor.sampled_at(frame.counter) or stepped_at) < stepped_at
            ]
            allowed = [0.1 * one for one in full]
            for frame in early:
                reported = wrench_of(frame.values, sensor.facts.scales)
                if mistake := wrench_mistake(reported, before, allowed):
                    raise Finding(f"a sample from before a step already contains it: {mistake}")

    run_sensor(sensor_emulator, check)


def test_change_that_was_read_ahead_is_heeded(sensor_emulator: SensorCase) -> None:
    """If the wrench was read ahead and then changes, the sensor is notified of the time of the change."""

    async def check(rig: SensorRig) -> None:
        rig.source.predicted_until = lambda now: now + 0.05
        async with rig.started() as sensor:
            before, full = await rig.settled(sensor), full_scales(rig.case, sensor.facts)
            for share in (0.2, -0.2, 0.1):
                wrench = [share * one for one in full]
                rig.push(wrench)
                reported = await rig.settled(sensor)
                change = [a - b for a, b in zip(reported, before, strict=True)]
                allowed = [2.0 * rig.case.noise * one for one in full]
                if mistake := wrench_mistake(change, wrench, allowed):
                    raise Finding(f"a change of the wrench was ignored: {mistake}")

    run_sensor(sensor_emulator, check)


def test_overload_stays_at_the_end_of_the_range(sensor_emulator: SensorCase) -> None:
    """Far beyond its range, an axis reports the end of the range without wrapping around. It recovers afterwards."""

    async def check(rig: SensorRig) -> None:
        async with rig.started() as sensor:
            before, full = await rig.settled(sensor), full_scales(rig.case, sensor.facts)
            for axis in range(6):
                for sign in (1.0, -1.0):
                    wrench = list(NOTHING)
                    wrench[axis] = sign * 50.0 * full[axis]
                    rig.push(wrench)
                    reported = (await rig.settled(sensor))[axis] - before[axis]
                    if reported * sign < 0.5 * full[axis]:
                        raise Finding(
                            f"{AXES[axis]} is far beyond its range of {full[axis]:g} and reported as {reported:.4g}: "
                            "it must saturate at full scale"
                        )
            rig.push(NOTHING)
            allowed = [2.0 * rig.case.noise * one for one in full]
            if mistake := wrench_mistake(await rig.settled(sensor), before, allowed):
                raise Finding(f"after an overload, {mistake}")

    run_sensor(sensor_emulator, check)


@pytest.mark.parametrize("damage", DAMAGES)
def test_hostile_bytes_do_not_break_it(sensor_emulator: SensorCase, damage: str) -> None:
    """Every second piece of data from the client is damaged. The emulator raises no error."""

    async def check(rig: SensorRig) -> None:
        with suppress(BridgeError):
            sensor = await rig.connect()
            try:
                rig.damage_sent(damage, 1, 2)
                sensor.start()
                with suppress(BridgeError):
                    await rig.within(sensor.ready(), "ready")
                await rig.wait(0.3)
            finally:
                await sensor.aclose()

    run_sensor(sensor_emulator, check)


def test_every_fault_of_the_sensor_can_begin(sensor_emulator: SensorCase) -> None:
    async def check(rig: SensorRig) -> None:
        async with rig.started():
            await rig.begin_each(rig.sensor.handlers, "sensor")

    with suppress(BridgeError):
        run_sensor(sensor_emulator, check)
