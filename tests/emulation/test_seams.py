"""Tests of a cell of third-party devices that use only `emulators.seams`."""

import math
import struct
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
import pytest
from numpy.typing import NDArray

from emulators.arm.followed import FollowedArm, FollowedProfile
from emulators.cell import Cell, CellProfile, Parts
from emulators.faults import FOREVER, Fault, Handler, Injection, Parameter
from emulators.seams import ArmPath, EmulatedRobot, EmulatedSensor, StartPose, Surface, WrenchSource
from emulators.sensing import KnownWrench, NoisyWrench, NumberedNoise, Samples
from emulators.surface.contact import Contact, SurfaceProfile
from emulators.tool import ToolProfile
from protocol.geometry import Pose
from tests.paper_cell import PaperCellProfile, s3_jr3_cell

Floats = NDArray[np.float64]

T0 = 1234.5
DOWN = (0.0, 1.0, 0.0, 0.0)
NO_TOOL = ToolProfile(mass_kg=0.0)
STIFFNESS = 2000.0
FLOOR = 0.59
STREAM_FAULTS = {"stream": {"deaf": Fault("no target is heard", {"from_s": Parameter(0.0, "when")}, FOREVER)}}


class StreamedRobot:
    """Robot that accepts positions as datagrams of three numbers, m, and has no kinematics. Also its endpoint."""

    def __init__(self, start: StartPose, now: float, seed: int) -> None:
        self.arm = FollowedArm(FollowedProfile(), Pose(start.position, start.quaternion), now)
        self.path = self.arm.path
        self.targets = self.arm.path.targets
        self.deaf: list[Injection] = []
        self.handlers = {"stream": {"deaf": Handler(self.deaf.append)}}

    @property
    def endpoint(self) -> "StreamedRobot":
        return self

    def joints_holding(self, pose: Pose, at: float) -> None:
        return None

    def receive(self, data: Sequence[bytes], now: float) -> None:
        for datagram in data:
            if any(injection.holds(now) for injection in self.deaf):
                self.deaf[0].struck += 1
            else:
                x, y, z = struct.unpack("<3d", datagram)
                self.arm.follow(Pose((x, y, z), DOWN), now)

    def next_event(self) -> None: ...

    def data_to_send(self, now: float) -> Sequence[bytes]:
        return ()

    def next_deadline(self) -> float | None:
        return None

    def handle_deadline(self, now: float) -> None: ...


class PolledSensor:
    """Sensor with 500 samples per second that a test reads without a wire."""

    def __init__(self, source: WrenchSource, now: float, seed: int) -> None:
        self.reading = NoisyWrench(source, 500.0, (0.1, 0.1, 0.1, 0.01, 0.01, 0.01), seed)
        self.handlers: Mapping[str, Mapping[str, Handler]] = {}
        self.endpoint = None

    def force(self, now: float) -> float:
        return self.reading.sample(self.reading.number_at(now))[2]

    def sampled_at(self, counter: int) -> float | None:
        return counter / 500.0


@dataclass
class Spring:
    """Floor without damping, friction or memory."""

    height: float
    handlers: Mapping[str, Handler] = field(default_factory=dict)
    remembered_until: float | None = None

    def force(self, positions: Floats, velocities: Floats, times: Floats) -> Floats:
        force = np.zeros_like(positions)
        force[:, 2] = STIFFNESS * np.maximum(self.height - positions[:, 2], 0.0)
        return force

    def aside(self) -> "Spring":
        return self

    def rewind(self, time: float) -> None: ...


def toy_cell(
    surface: Callable[..., Surface] | None = lambda changed: Spring(FLOOR),
) -> Cell[StreamedRobot, PolledSensor]:
    parts = Parts(StreamedRobot, PolledSensor, surface, STREAM_FAULTS)
    return Cell(CellProfile(tool=NO_TOOL), T0, 1, parts)


def lower(cell: Cell[StreamedRobot, PolledSensor], z: float, now: float) -> None:
    cell.robot.endpoint.receive([struct.pack("<3d", 0.9, -0.1, z)], now)


def test_third_party_devices_make_cell() -> None:
    cell = toy_cell()
    lower(cell, FLOOR - 0.005, T0 + 0.001)
    assert cell.sensor.force(T0 + 0.02) == pytest.approx(0.0, abs=0.6)
    cell.robot.path.advance(T0 + 1.0)
    assert cell.robot.targets.accepted == 1
    assert cell.robot.targets.begun_at(1) == pytest.approx(T0 + 0.012)
    # A tool pointing down: a push up is a negative fz.
    readings = [cell.sensor.force(T0 + 1.0 + k / 500.0) for k in range(500)]
    assert np.mean(readings) == pytest.approx(-STIFFNESS * 0.005, abs=0.02)
    assert np.std(readings) == pytest.approx(0.1, rel=0.15)
    truth = cell.true_state(T0 + 2.0)
    assert truth.contact_force == pytest.approx((0.0, 0.0, STIFFNESS * 0.005), abs=1e-6)
    assert truth.joints is None
    assert truth.normal is None


def test_profile_contact_model_is_default() -> None:
    profile = CellProfile(tool=NO_TOOL, surface=SurfaceProfile(stiffness_n_m=3000.0, friction=0.0))
    cell = Cell(profile, T0, 1, Parts(StreamedRobot, PolledSensor))
    lower(cell, FLOOR - 0.002, T0)
    assert cell.true_state(T0 + 2.0).contact_force[2] == pytest.approx(6.0, abs=1e-6)
    cell.inject("surface", "step", T0 + 2.0, mm=1.0)
    assert cell.true_state(T0 + 3.0).contact_force[2] == pytest.approx(9.0, abs=1e-6)


def test_faults_are_those_of_parts() -> None:
    cell = toy_cell()
    deaf = cell.inject("stream", "deaf", T0 + 0.5, for_s=1.0)
    lower(cell, FLOOR, T0 + 1.0)
    assert (cell.robot.targets.accepted, deaf.struck) == (0, 1)
    lower(cell, FLOOR, T0 + 1.5)
    assert cell.robot.targets.accepted == 1
    with pytest.raises(ValueError, match=r"^unknown target 'robot'; known: stream, bus, surface[^\n]+$"):
        cell.inject("robot", "motors-off", T0 + 2.0)
    with pytest.raises(ValueError, match=r"^this cell cannot have surface: step; [^\n]+$"):
        cell.inject("surface", "step", T0 + 2.0)


def test_sensor_is_notified_of_surface_change() -> None:
    changes: list[Callable[[float], object]] = []
    spring = Spring(0.0)

    def made(changed: Callable[[float], object]) -> Spring:
        changes.append(changed)
        return spring

    cell = toy_cell(made)
    # Read ahead of its time, as far as it is committed.
    ahead = cell.sensor.reading.samples.starting(round(T0 * 500) + 500, round(T0 * 500) + 500)
    reported: list[int] = []
    cell.sensor.reading.samples.on_invalidate.append(reported.append)
    assert len(ahead) > 1
    spring.height = 0.61
    changes[0](T0 + 1.0 + 1 / 500)
    assert reported == [round(T0 * 500) + 501]
    assert cell.sensor.force(T0 + 1.0) == pytest.approx(0.0, abs=0.6)
    assert cell.sensor.force(T0 + 1.0 + 2 / 500) == pytest.approx(-20.0, abs=0.6)


def test_built_in_parts_implement_protocols() -> None:
    cell = s3_jr3_cell(PaperCellProfile(), T0, 1)
    robot: EmulatedRobot = cell.robot
    path: ArmPath = cell.robot.path
    sensor: EmulatedSensor = cell.sensor
    surface: Surface = Contact(SurfaceProfile())
    source: WrenchSource = cell
    for seam, part in (
        (EmulatedRobot, robot),
        (ArmPath, path),
        (EmulatedSensor, sensor),
        (Surface, surface),
        (WrenchSource, source),
    ):
        names = {*seam.__annotations__, *vars(seam)}
        assert not [name for name in names if not name.startswith("_") and not hasattr(part, name)]


# --- samples


def swinging(times: Floats) -> Floats:
    return np.outer(np.sin(7.0 * times), (1.0, 2.0, 3.0, 0.1, 0.2, 0.3))


def test_samples_are_computed_once_until_invalidated() -> None:
    requested: list[tuple[int, int]] = []
    source = KnownWrench(swinging, lambda now: now + 0.01, lambda now: now + 0.05)

    def make(first: int, stop: int) -> Floats:
        requested.append((first, stop))
        return source.wrench(np.arange(first, stop) / 1000.0)

    samples = Samples(source, 1000.0, make)
    reported: list[int] = []
    samples.on_invalidate.append(reported.append)
    assert len(samples.starting(5000, 5003)) == 53
    samples.starting(5010, 5012)
    assert requested == [(5000, 5053)]
    source.on_change(5.02)
    assert reported == [5020]
    np.testing.assert_array_equal(samples.starting(5015, 5030)[:16], swinging(np.arange(5015, 5031) / 1000.0))
    assert requested[1][0] == 5020
    assert (samples.committed_until(5.0), samples.predicted_until(5.0)) == (5.01, 5.05)


def test_noise_depends_on_sample_number() -> None:
    rms = (1.0, 2.0, 3.0, 0.1, 0.2, 0.3)
    source = KnownWrench(lambda times: np.zeros((len(times), 6)))
    first = 5_000_000
    single = NoisyWrench(source, 7000.0, rms, seed=3)
    one_by_one = np.array([single.sample(first + k) for k in range(3000)])
    block = NoisyWrench(source, 7000.0, rms, seed=3).samples.starting(first, first + 2999)
    np.testing.assert_array_equal(one_by_one, block)
    assert one_by_one.std(axis=0) == pytest.approx(rms, rel=0.05)
    other = NoisyWrench(source, 7000.0, rms, seed=4).sample(first)
    assert not np.allclose(one_by_one[0], other)


def test_number_at_returns_newest_sample() -> None:
    reading = NoisyWrench(KnownWrench(swinging), 500.0, (0.0,) * 6, 1)
    assert [reading.number_at(5.0 + k / 500.0) for k in range(100)] == list(range(2500, 2600))
    assert reading.number_at(5.0019) == 2500
    assert reading.sample(2500)[2] == pytest.approx(3.0 * math.sin(35.0))


def test_noise_can_be_altered() -> None:
    noise, rows = NumberedNoise(1.0, 7), np.zeros((6, 2000))
    noise.add(rows, 100)
    louder = np.zeros((6, 2000))
    NumberedNoise(1.0, 7).add(louder, 100, lambda part, first: part * (first >= 1024))
    assert not louder[:, : 1024 - 100].any()
    np.testing.assert_array_equal(louder[:, 1024 - 100 :], rows[:, 1024 - 100 :])
