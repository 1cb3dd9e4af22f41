"""The toys themselves: an arm that streams, a load cell, and a spring that the tool presses on."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from emulators.arm.followed import FollowedArm, FollowedProfile
from emulators.faults import Handler
from emulators.seams import ArmPath, Floats, Handlers, Joints, StartPose, Surface, WrenchSource
from emulators.sensing import NoisyWrench
from protocol.geometry import Pose, Wrench
from protocol.marks import Mark, check_settings, setting
from toydevices.wire import (
    ARM_CYCLE_S,
    ARM_HELLO,
    LOAD_BYE,
    LOAD_HELLO,
    LOAD_PERIOD_S,
    RANGE_COUNTS,
    REPORT,
    SAMPLE,
    SCALES,
    TARGET,
)


@dataclass(frozen=True, slots=True)
class LoadProfile:
    """Differences between one load cell and the next."""

    noise_n: float = setting(
        0.02, Mark.CHOSEN, "noise of the forces, root mean square", unit="N", minimum=0.0
    )

    def __post_init__(self) -> None:
        check_settings(self)


@dataclass(frozen=True, slots=True)
class SpringProfile:
    """A level plate on springs."""

    height_mm: float = setting(590.0, Mark.CHOSEN, "height of the plate", unit="mm")
    stiffness_n_mm: float = setting(5.0, Mark.CHOSEN, "its stiffness", unit="N/mm", above=0.0)

    def __post_init__(self) -> None:
        check_settings(self)


class Arm:
    """An arm that reports each cycle, and follows the set point that it is answered with: an `EmulatedRobot`."""

    def __init__(self, profile: FollowedProfile, start: StartPose, now: float) -> None:
        self._arm = FollowedArm(profile, Pose(start.position, start.quaternion), now)
        self._number = 0
        self._report_at: float | None = None
        self._out: list[bytes] = []
        self.endpoint = self
        self.path: ArmPath = self._arm.path
        self.handlers: Handlers = {}

    @property
    def accepted(self) -> int:
        return self._arm.path.accepted

    def begun_at(self, target: int) -> float | None:
        return self._arm.path.begun_at(target)

    def joints_holding(self, pose: Pose, at: float) -> Joints | None:
        return None

    def receive(self, data: Sequence[bytes], now: float) -> None:
        for datagram in data:
            if datagram == ARM_HELLO:
                self._report_at = now
            elif len(datagram) == TARGET.size and datagram.startswith(b"AT"):
                _, _, x, y, z, w, i, j, k = TARGET.unpack(datagram)
                if all(map(math.isfinite, (x, y, z, w, i, j, k))) and any((w, i, j, k)):
                    self._arm.follow(Pose((x, y, z), (w, i, j, k)), now)

    def next_event(self) -> None:
        return None

    def data_to_send(self, now: float) -> Sequence[bytes]:
        out, self._out = self._out, []
        return out

    def next_deadline(self) -> float | None:
        return self._report_at

    def handle_deadline(self, now: float) -> None:
        while self._report_at is not None and self._report_at <= now:
            pose = self._arm.pose(now)
            self._number += 1
            self._out.append(REPORT.pack(b"AR", self._number, *pose.position, *pose.quaternion, 0))
            self._report_at += ARM_CYCLE_S


class LoadCell:
    """A load cell that samples while it is asked to: an `EmulatedSensor`."""

    def __init__(self, profile: LoadProfile, source: WrenchSource, seed: int) -> None:
        noise: Wrench = (*(profile.noise_n,) * 3, *(profile.noise_n / 10.0,) * 3)
        self._wrench = NoisyWrench(source, 1.0 / LOAD_PERIOD_S, noise, seed)
        self._first: int | None = None
        """Number of the sample that had the counter 0."""
        self._next = 0
        self._out: list[bytes] = []
        self.endpoint = self
        self.handlers: Handlers = {}

    def sampled_at(self, counter: int) -> float | None:
        return None if self._first is None else (self._first + counter) * LOAD_PERIOD_S

    def receive(self, data: Sequence[bytes], now: float) -> None:
        for datagram in data:
            if datagram == LOAD_HELLO and self._first is None:
                self._first = self._next = self._wrench.number_at(now)
            elif datagram == LOAD_BYE:
                self._first = None

    def next_event(self) -> None:
        return None

    def data_to_send(self, now: float) -> Sequence[bytes]:
        out, self._out = self._out, []
        return out

    def next_deadline(self) -> float | None:
        return None if self._first is None else self._next * LOAD_PERIOD_S

    def handle_deadline(self, now: float) -> None:
        while self._first is not None and self._next * LOAD_PERIOD_S <= now:
            sample = zip(self._wrench.sample(self._next), SCALES, strict=True)
            counts = [round(value / scale) for value, scale in sample]
            ends = sum(1 << axis for axis, count in enumerate(counts) if abs(count) >= RANGE_COUNTS)
            kept = [max(-RANGE_COUNTS, min(RANGE_COUNTS, count)) for count in counts]
            self._out.append(SAMPLE.pack(b"LS", self._next - self._first, *kept, ends))
            self._next += 1


class Spring:
    """The plate: a contact model without memory."""

    remembered_until = None

    def __init__(self, profile: SpringProfile, changed: Callable[[float], object]) -> None:
        self._height, self._stiffness = profile.height_mm * 1e-3, profile.stiffness_n_mm * 1e3
        self.handlers: Mapping[str, Handler] = {}

    def force(self, positions: Floats, velocities: Floats, times: Floats) -> Floats:
        force = np.zeros_like(positions)
        force[:, 2] = self._stiffness * np.maximum(self._height - positions[:, 2], 0.0)
        return force

    def aside(self) -> Surface:
        return self

    def rewind(self, time: float) -> None:
        """Nothing is remembered."""
