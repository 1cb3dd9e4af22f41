"""Defective emulated devices and surfaces fail the suites: every test can fail."""

import dataclasses
import random
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from emulators.surface.contact import Contact, SurfaceProfile
from emulators.target_times import TargetTimes
from hil_bridge.devices.kinds import ROBOTS, SENSORS, SurfaceKind
from hil_bridge.devices.robots.seam import MotionLimits
from hil_bridge.testing import (
    RobotCase,
    SensorCase,
    SurfaceCase,
    robot_clients,
    robot_emulators,
    sensor_emulators,
    surfaces,
)


class Around:
    """Wrapper that overrides some attributes of an object."""

    def __init__(self, inner: Any, **own: Any) -> None:
        self._inner = inner
        vars(self).update(own)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._inner, name)


# --- robots


def moved(path: Any, by: Callable[[Any], Any]) -> Any:
    """Return a path whose x positions are offset, m, by a function of the times."""

    def trajectory(times: Any) -> tuple[Any, Any]:
        positions, velocities = path.trajectory(times)
        positions = positions.copy()
        positions[:, 0] += by(np.asarray(times))
        return positions, velocities

    return Around(path, trajectory=trajectory)


def spoilt_robot(spoil: Callable[[Any, float], Any], kind: str = "rsi") -> RobotCase:
    room = ROBOTS.kind(kind)
    assert room.emulation is not None

    def make(settings: Any) -> Any:
        factory = room.emulation.make(settings)  # type: ignore[union-attr]
        return lambda start, now, seed: spoil(factory(start, now, seed), now)

    return RobotCase(dataclasses.replace(room, emulation=dataclasses.replace(room.emulation, make=make)))


def read_changes(robot: Any, now: float) -> Any:
    reads = [0]

    def by(times: Any) -> float:
        reads[0] += 1
        return reads[0] * 1e-6

    return Around(robot, path=moved(robot.path, by))


def raises(robot: Any, now: float) -> Any:
    def receive(data: Any, at: float) -> None:
        for datagram in data:
            if not bytes(datagram).startswith(b"<Sen"):
                raise ValueError("no telegram")
        robot.endpoint.receive(data, at)

    return Around(robot, endpoint=Around(robot.endpoint, receive=receive))


SPOILT_ROBOTS: dict[str, tuple[Callable[[Any, float], Any], str]] = {
    "test_it_is_powered_up_where_it_is_told": (
        lambda robot, now: Around(robot, path=moved(robot.path, lambda times: 1e-3)),
        "the robot starts at",
    ),
    "test_without_orders_it_stands": (
        lambda robot, now: Around(robot, path=moved(robot.path, lambda times: 0.01 * (times - now))),
        "nothing was ordered, and: the robot moved",
    ),
    "test_path_is_one_of_an_arm": (
        lambda robot, now: Around(robot, path=moved(robot.path, lambda times: 0.05 * (times > now + 0.3))),
        "the path jumps",
    ),
    "test_committed_path_never_changes": (
        lambda robot, now: Around(robot, path=moved(robot.path, lambda times: 1e-6 * robot.targets.accepted)),
        "the committed part of the path",
    ),
    "test_reading_changes_nothing": (read_changes, "reading the path changed the path"),
    "test_same_seed_does_the_same": (
        lambda robot, now: Around(robot, path=moved(robot.path, lambda times: random.random() * 1e-6)),
        "took different paths",
    ),
    "test_targets_are_counted_and_begin_after_their_order": (
        lambda robot, now: Around(robot, targets=TargetTimes()),
        "`accepted` stays at 0",
    ),
    "test_every_fault_of_the_robot_can_begin": (
        lambda robot, now: Around(robot, handlers={**robot.handlers, "own": {"secret": None}}),
        "is not in the table of its faults",
    ),
}


@pytest.mark.parametrize("test", SPOILT_ROBOTS)
def test_defective_robot_fails_suite(test: str) -> None:
    spoil, text = SPOILT_ROBOTS[test]
    with pytest.raises(AssertionError, match=text):
        getattr(robot_emulators, test)(spoilt_robot(spoil))


def test_robot_failing_on_malformed_bytes_fails_suite() -> None:
    with pytest.raises(ValueError, match="no telegram"):
        robot_emulators.test_hostile_bytes_neither_break_nor_move_it(spoilt_robot(raises), "garbage")


def test_client_above_speed_limit_fails() -> None:
    room = ROBOTS.kind("s3")

    async def connect(url: str, settings: Any, wiring: Any) -> Any:
        link = await room.connect(url, settings, wiring)
        return Around(link, motion=lambda limits: link.motion(MotionLimits(4.0 * limits.speed)))

    with pytest.raises(AssertionError, match="mm/s; allowed: at most 50"):
        robot_clients.test_speed_of_a_movement_is_kept(RobotCase(dataclasses.replace(room, connect=connect)))


# --- sensors


def spoilt_sensor(
    spoil: Callable[[Any], Any], source: Callable[[Any], Any] = lambda source: source
) -> SensorCase:
    room = SENSORS.kind("ft300")
    assert room.emulation is not None

    def make(settings: Any) -> Any:
        factory = room.emulation.make(settings)  # type: ignore[union-attr]
        return lambda moments, now, seed: spoil(factory(source(moments), now, seed))

    emulation = dataclasses.replace(room.emulation, make=make)
    return SensorCase(dataclasses.replace(room, emulation=emulation), settle_s=0.3)


def random_source(source: Any) -> Any:
    return Around(source, wrench=lambda times: source.wrench(times) + random.random())


SPOILT_SENSORS: dict[str, tuple[SensorCase, str]] = {
    "test_sample_has_a_time": (
        spoilt_sensor(lambda sensor: Around(sensor, sampled_at=lambda counter: None)),
        "has no measurement time",
    ),
    "test_same_seed_tells_the_same": (
        spoilt_sensor(lambda sensor: sensor, random_source),
        "different values",
    ),
    "test_wrench_is_not_told_before_it_is_felt": (
        spoilt_sensor(
            lambda sensor: Around(
                sensor, sampled_at=lambda counter: (sensor.sampled_at(counter) or 0.0) - 0.3
            )
        ),
        "a sample from before a step already contains it",
    ),
    "test_every_fault_of_the_sensor_can_begin": (
        spoilt_sensor(lambda sensor: Around(sensor, handlers={**sensor.handlers, "own": {"secret": None}})),
        "is not in the table of its faults",
    ),
}


@pytest.mark.parametrize("test", SPOILT_SENSORS)
def test_defective_sensor_fails_suite(test: str) -> None:
    case, text = SPOILT_SENSORS[test]
    with pytest.raises(AssertionError, match=text):
        getattr(sensor_emulators, test)(case)


# --- surfaces


def spoilt_surface(spoil: Callable[[Any], Any]) -> SurfaceCase:
    faults: Any = dict.fromkeys(Contact(SurfaceProfile()).handlers)

    def make(profile: SurfaceProfile) -> Any:
        return lambda changed: spoil(Contact(profile, changed))

    return SurfaceCase(SurfaceKind("spoilt", "", SurfaceProfile, make, faults), friction=0.2)


def with_force(change: Callable[..., Any]) -> Callable[[Any], Any]:
    """Return a surface whose force is changed by a function of force, positions, velocities and times."""

    def spoil(surface: Any) -> Any:
        def force(positions: Any, velocities: Any, times: Any) -> Any:
            return change(surface.force(positions, velocities, times), positions, velocities, times)

        return Around(surface, force=force)

    return spoil


def forgetful(surface: Any) -> Any:
    """Return a surface that counts its calls, including those of its copies."""
    calls = [0]

    def force(positions: Any, velocities: Any, times: Any) -> Any:
        calls[0] += 1
        return surface.force(positions, velocities, times) * (1.0 + 0.01 * calls[0])

    spoilt: Any = Around(surface, force=force)
    spoilt.aside = lambda: spoilt
    return spoilt


def nothing_above(force: Any, positions: Any, velocities: Any, times: Any) -> Any:
    return np.add(force, 0.1)


SPOILT_SURFACES: dict[str, tuple[Callable[[Any], Any], str]] = {
    "test_above_it_nothing_is_felt": (with_force(nothing_above), "above the surface"),
    "test_it_never_pulls": (with_force(lambda force, *rest: -force), "pulls|sign of the force"),
    "test_deeper_is_never_softer": (
        with_force(lambda force, *rest: np.minimum(force, 10.0 - force)),
        "decreases with depth",
    ),
    "test_any_numbers_are_answered_with_numbers": (
        with_force(lambda force, positions, *rest: force / np.where(positions == 0.0, np.nan, 1.0)),
        "not a number",
    ),
    "test_pieces_of_a_path_are_answered_as_the_whole": (forgetful, "in pieces"),
    "test_questions_aside_change_nothing": (forgetful, "aside"),
    "test_shown_again_it_answers_the_same": (forgetful, "the same samples give other forces"),
    "test_friction_acts_against_the_sliding": (
        with_force(lambda force, *rest: force * [-1.0, -1.0, 1.0]),
        "its sign is wrong",
    ),
    "test_normals_are_those_of_the_force": (
        lambda surface: Around(
            surface, normals=lambda positions, times: np.tile([1.0, 0.0, 0.0], (len(times), 1))
        ),
        "outward normal",
    ),
    "test_every_fault_of_the_surface_has_a_handler": (
        lambda surface: Around(surface, handlers={}),
        "not handled",
    ),
}


@pytest.mark.parametrize("test", SPOILT_SURFACES)
def test_defective_surface_fails_suite(test: str) -> None:
    spoil, text = SPOILT_SURFACES[test]
    with pytest.raises(AssertionError, match=text):
        getattr(surfaces, test)(spoilt_surface(spoil))
